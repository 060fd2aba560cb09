"""The choice of a window from the data: what is compared, by which risk, and what becomes of the ends."""
