"""Pytest reads the pages; what builds them, or was built of them, holds no doctests."""

collect_ignore = ["_ext", "_static", "_templates", "api", "auto_examples", "benchmarks", "conf.py"]
