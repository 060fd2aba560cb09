"""Numbers with units, as the command line takes them."""

from __future__ import annotations

from argparse import ArgumentTypeError

SECONDS = {"s": 0, "ms": -3, "us": -6}
HERTZ = {"Hz": 0, "kHz": 3}
ANGULAR = {**HERTZ, "rad/s": 0}
"""The units, and what power of ten they stand for."""


class Quantity(float):
    """A number in s, Hz or rad/s, and the unit it was given in; None for a plain number.

    Attributes
    ----------
    unit : str or None
        One of `SECONDS` or `ANGULAR`.
    """

    unit: str | None = None


def time(text: str) -> Quantity:
    """Read a time."""
    return _read(text, SECONDS, "a time like 0.1, 0.1s, 20ms or 50us")


def rate(text: str) -> Quantity:
    """Read a sampling rate."""
    return _read(text, HERTZ, "a rate like 1000, 1000Hz or 1kHz")


def frequency(text: str) -> Quantity:
    """Read a frequency."""
    return _read(text, ANGULAR, "a frequency like 20, 20Hz, 0.5kHz or 125rad/s")


def _read(text: str, units: dict[str, int], allowed: str) -> Quantity:
    from decimal import Decimal

    bare = text.strip()
    unit = max((unit for unit in units if bare.endswith(unit)), key=len, default=None)
    number = bare.removesuffix(unit or "").rstrip()
    try:
        quantity = Quantity(Decimal(number).scaleb(units[unit]) if unit else float(number))
    except (ValueError, ArithmeticError):
        raise ArgumentTypeError(f"must be {allowed}, got {text!r}") from None
    quantity.unit = unit
    return quantity
