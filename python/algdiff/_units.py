"""Numbers with units, as the command line takes them."""

from __future__ import annotations

from argparse import ArgumentTypeError

SECONDS = {"s": 0, "ms": -3, "us": -6}
HERTZ = {"Hz": 0, "kHz": 3}
ANGULAR = {**HERTZ, "rad/s": 0}
"""The units, and what power of ten they stand for."""
BYTES = {"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "KiB": 1 << 10, "MiB": 1 << 20, "GiB": 1 << 30}
"""Units of memory, in bytes."""


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


def window(text: str) -> int | Quantity:
    """Read the length of a window: samples, or a time with its unit."""
    try:
        return int(text)
    except ValueError:
        pass
    allowed = "samples like 101 or a time like 50ms or 0.05s"
    quantity = _read(text, SECONDS, allowed)
    if quantity.unit is None:
        raise ArgumentTypeError(f"must be {allowed}, got {text!r}")
    return quantity


def size(text: str) -> int:
    """Read an amount of memory, in bytes."""
    from decimal import Decimal

    bare = text.strip()
    unit = max((unit for unit in BYTES if bare.endswith(unit)), key=len, default="")
    try:
        amount = int(Decimal(bare.removesuffix(unit).rstrip()) * BYTES.get(unit, 1))
    except (ValueError, ArithmeticError):
        amount = -1
    if amount < 0:
        raise ArgumentTypeError(f"must be a size like 512MiB, 2GB or 1000000, got {text!r}")
    return amount


def scaled(number: float, unit: str) -> str:
    """Return an amount with the prefix that leaves it below a thousand."""
    prefixes = ("", "k", "M", "G", "T", "P")
    power = 0
    while number >= 999.5 and power < len(prefixes) - 1:
        number, power = number / 1000, power + 1
    return f"{number:.3g} {prefixes[power]}{unit}"


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
