"""What HDF5 files and Zarr stores say of an array beside its numbers: the sampling step, and what outputs keep."""

from __future__ import annotations

import math
from base64 import b64decode
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from algdiff import _refusals as refusals
from algdiff._formats.base import Layout, Samples
from algdiff._formats.even import Even

STEPS = ("delta", "dt", "sampling_interval", "sample_interval", "time_step")
RATES = ("fs", "sampling_rate", "samplingrate", "sample_rate", "samplerate", "sampling_frequency", "samplingfrequency")
"""Attributes that state a step in seconds or a rate in Hz, in lower case."""

AGREE = 1e-6
"""Attributes that differ by no more than this share mean the same."""

SECONDS = {
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}
"""Units of time, as the CF conventions write them."""

DIMENSIONS = "_ARRAY_DIMENSIONS"
"""The attribute that names the dimensions, as xarray writes it to stores of Zarr 2."""

OF_SAMPLES = {"_FillValue", "missing_value", "valid_min", "valid_max", "valid_range", DIMENSIONS}
OF_VALUES = {"units", "add_offset"}
"""Attributes that hold of samples alone, and those that hold of values but of no derivative."""

MOST = 64 << 10
"""Bytes of an attribute that is looked at."""

LARGE = 1 << 50
"""Integers of this size are taken for counts from a distant origin, of which floats would lose digits."""

PIECE = 1 << 20
"""Coordinates that are read at once."""


def stated(where: str, attributes: Mapping[str, Any]) -> float | None:
    """Return the step that attributes state, in seconds; None if none of them is a number.

    Parameters
    ----------
    where : str
        What has the attributes, for errors.
    attributes : mapping
        Their values, as `plain` returns them.

    Raises
    ------
    ValueError
        One is no number, not positive and finite, or two of them contradict each other.
    """
    found: dict[str, float] = {}
    given = {name.lower(): (name, value) for name, value in attributes.items()}
    for name, value in (given[name] for name in (*STEPS, *RATES) if name in given):
        number = value[0] if isinstance(value, list) and len(value) == 1 else value
        if isinstance(number, str):
            with suppress(ValueError):
                number = float(number)
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise ValueError(
                f"{where}: its attribute {name} must be a number, got {refusals.shown(number)}; give delta or fs"
            )
        step = _positive(number) if name.lower() in STEPS else _positive(1.0 / _positive(number))
        if math.isnan(step):
            raise ValueError(f"{where}: its attribute {name} must be positive and finite, got {number}")
        found[name] = step
        first, *_ = found
        if abs(found[name] - found[first]) > AGREE * found[first]:
            raise ValueError(
                f"{where}: its attributes {first} and {name} must agree, got {found[first]} and {found[name]} s"
            )
    return next(iter(found.values()), None)


def check_packed(where: str, attributes: Mapping[str, Any], dtype: np.dtype[Any]) -> None:
    """Raise ValueError if attributes say, as the CF conventions do, that numbers are packed or some of them missing."""
    for name, plain_value in (("scale_factor", 1), ("add_offset", 0)):
        if attributes.get(name, plain_value) != plain_value:
            raise ValueError(f"{where}: must hold plain numbers, got packed ones ({name}); unpack them, as with xarray")
    for name in ("_FillValue", "missing_value"):
        value = attributes.get(name)
        value = value[0] if isinstance(value, list) and len(value) == 1 else value
        if isinstance(value, str):  # as xarray writes it to stores of Zarr 3
            with suppress(ValueError):
                value = np.frombuffer(b64decode(value, validate=True), dtype.newbyteorder("<"))[0].item()
        if isinstance(value, int | float) and not math.isnan(value):
            what = f"got {name} = {value}; unpack it, as with xarray"
            raise ValueError(f"{where}: must hold NaN for missing samples, {what}")


def _positive(number: float) -> float:
    """Return a number as a float; NaN unless it is positive and finite."""
    with suppress(OverflowError):  # of an integer of any size
        return float(number) if 0 < float(number) < math.inf else math.nan
    return math.nan


class Coordinate(NamedTuple):
    """The coordinate of an axis.

    Attributes
    ----------
    name : str
        What it is called, for errors.
    shape, dtype : tuple of int, numpy.dtype
        Its shape and type.
    units : object
        Its attribute of that name, if it has one.
    read : callable
        Returns a slice of it.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    units: Any
    read: Callable[[slice], Any]

    def times(self, first: int, last: int, origin: int = 0) -> Samples:
        """Return some of it as float64, counted from an origin, or as dates."""
        values = np.asarray(self.read(slice(first, last)))
        values = values.astype(values.dtype.newbyteorder("="))
        if values.dtype.kind in "mM":
            return values.view(values.dtype.str.replace("m8", "M8"))
        return (values - values.dtype.type(origin) if origin else values).astype(np.float64)


def along(path: Path, coordinate: Coordinate, samples: int) -> float | None:
    """Return the step of the coordinate of an axis of some samples, in seconds; None if it is no time.

    A coordinate without units counts in seconds; one in units that are none of time says nothing.

    Raises
    ------
    ValueError
        It does not ascend in even steps, or is not as long as the axis.
    """
    name, kind = coordinate.name, coordinate.dtype.kind
    seconds = 1.0 if kind in "mM" else unit(coordinate.units)
    if seconds is None or kind not in "iufmM":
        return None
    if coordinate.shape != (samples,):
        raise ValueError(f"{path}: {name} must hold a time for each of {samples} samples, got shape {coordinate.shape}")
    if samples < 2:
        return None
    origin = int(coordinate.read(slice(0, 1))[0]) if kind in "iu" else 0
    origin = origin if abs(origin) >= LARGE else 0
    start, end = coordinate.times(0, min(samples, 1000), origin), coordinate.times(samples - 1, samples, origin)
    rounding = float(np.finfo(coordinate.dtype).eps) / 2 if kind == "f" else 2.0**-53
    ends = np.concatenate([start[:1], end])
    even = Even(path, name, ends, samples, np.concatenate([start, end]), rounding)
    for first in range(0, samples, PIECE):
        fault = even.fault(first, coordinate.times(first, min(first + PIECE, samples), origin))
        if fault is not None:
            raise ValueError(f"{path}: the time at place {first + fault[0]} of {refusals.shown(name)} {fault[1]}")
    return None if even.step is None else even.step * seconds


def unit(units: Any) -> float | None:
    """Return what a unit of time, as in "ms" or "days since 2000-01-01", is in seconds; None if it is none."""
    if units is None or units == "":
        return 1.0
    if not isinstance(units, str):
        return None
    word = units.split(" since ")[0].strip()
    return SECONDS.get(word if len(word) < 4 else word.lower())


def plain(value: Any) -> Any:
    """Return an attribute as text, number or list of these; None if it is neither."""
    if isinstance(value, bytes):
        with suppress(UnicodeDecodeError):
            return value.decode()
        return None
    if isinstance(value, np.ndarray | np.generic):
        value = (value.astype(np.float64) if value.dtype.kind == "f" else value).tolist()
        if isinstance(value, bytes):
            return plain(value)
    if isinstance(value, list):
        values = [plain(one) for one in value]
        return None if any(one is None for one in values) else values
    return value if isinstance(value, str | bool | int | float | dict) else None


def kept(layout: Layout) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the attributes of an output: those of the input that still hold, and its own."""
    for name, value in layout.attributes.items():
        own = name.lower() in ("deriv", *STEPS, *RATES)
        if not own and name not in OF_SAMPLES and (name not in OF_VALUES or layout.orders == (0,)):
            yield name, value
    units, order = layout.attributes.get("units"), layout.orders[0]
    if isinstance(units, str) and len(layout.orders) == 1 and order and layout.step is not None:
        yield "units", f"s-{order}" if units == "1" else f"{units} s-{order}"
    yield "deriv", list(layout.orders) if layout.leading else order
    if layout.step is not None:
        yield "delta", layout.step
        yield "fs", 1 / layout.step


def dimensions(layout: Layout) -> list[str] | None:
    """Return the names of the dimensions of an output, if the input names its own."""
    names = layout.attributes.get(DIMENSIONS)
    if not isinstance(names, list) or len(names) != len(layout.shape) or not all(isinstance(one, str) for one in names):
        return None
    return ["deriv", *names] if layout.leading else list(names)


def shown(path: Path, names: list[str]) -> str:
    """Return the names of arrays as a caller would give them: at most ten."""
    return ", ".join(f"{path}:{refusals.told(name)}" for name in names[:10]) + (", ..." if len(names) > 10 else "")
