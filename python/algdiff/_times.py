"""Time stamps: what they are made into, and whether they are as even as they look."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._orders import highest
from algdiff._refusals import named, shown

EVEN = 1e-9
"""Stamps are even if none lies farther than this share of a step, and its own rounding, from where it would."""

FINE = 1e-6
"""Dates are rounded to their unit, and may be off by half of it, if it is at most about this share of a step."""


class Stamps:
    """Strictly monotone times of the samples of a row, counted from the first.

    Attributes
    ----------
    values : ndarray of float64
        Ascending, in the unit of the stamps; seconds for datetime64 and timedelta64.
    descending : bool
        Whether they were given in descending order, so that `values` and the data are reversed.
    step : float or None
        The step of even stamps.
    """

    def __init__(self, t: ArrayLike, size: int) -> None:
        given = arguments.plain("t", t)
        if given.shape != (size,):
            raise ValueError(f"t must have one time for each of the {size} samples along axis, got shape {given.shape}")
        self._origin = _plain("t", given)[:1]
        times = self.since("t", given)
        if not np.isfinite(times).all():
            wrong = int(np.argmin(np.isfinite(times)))
            raise ValueError(f"t must be finite, and not too far apart, got {given[wrong]} at place {wrong}")
        self.descending = bool(size > 1 and times[-1] < times[0])
        self._shift = float(times[-1]) if self.descending else 0.0
        if self.descending:
            times = times[::-1] - self._shift
        steps = np.diff(times)
        if not (steps > 0).all():
            index = int(np.flatnonzero(~(steps > 0))[0])
            index = size - 2 - index if self.descending else index
            raise ValueError(f"t must be strictly monotone, got {given[index]} followed by {given[index + 1]}")
        self.values: NDArray[np.float64] = np.ascontiguousarray(times)
        self.step = _even_step(self.values, _plain("t", given))

    def since(self, name: str, times: ArrayLike) -> NDArray[np.float64]:
        """Return how long after the first sample `times` are."""
        plain = _plain(name, times)
        if self._origin.size == 0:
            return np.zeros(plain.shape)
        if plain.dtype.kind != self._origin.dtype.kind and "M" in plain.dtype.kind + self._origin.dtype.kind:
            raise TypeError(f"{name} must be of the kind of t, {self._origin.dtype}, got {plain.dtype}")
        if plain.dtype.kind in "mM":
            return _seconds(plain, self._origin)
        if plain.dtype.kind in "iu" and self._origin.dtype.kind in "iu":
            return _integers(plain, self._origin)
        with np.errstate(over="ignore", invalid="ignore"):
            return plain.astype(np.float64) - self._origin.astype(np.float64)

    def located(self, name: str, times: ArrayLike) -> NDArray[np.float64]:
        """Return `times` on the axis of `values`."""
        since = self.since(name, times).reshape(np.shape(times))
        check_times(name, since, times)
        return np.ascontiguousarray(since - self._shift)


def check_times(name: str, times: NDArray[np.float64], given: ArrayLike) -> None:
    """Refuse times that are not in one row or not finite, as they were given."""
    if times.ndim != 1:
        raise ValueError(f"{name} must be a one-dimensional array of finite times, got shape {times.shape}")
    finite = np.isfinite(times)
    if not finite.all():
        place = int(np.argmin(finite))
        wrong = np.ravel(np.asarray(given))[place]
        raise ValueError(f"{name} must be a one-dimensional array of finite times, got {wrong} at place {place}")


SECONDS = {"W": 604800, "D": 86400, "h": 3600, "m": 60, "s": 1}
FRACTIONS = {"ms": 1e3, "us": 1e6, "ns": 1e9, "ps": 1e12, "fs": 1e15, "as": 1e18}


def _seconds(times: NDArray[Any], origin: NDArray[Any]) -> NDArray[np.float64]:
    """Return differences of times in seconds, each rounded once; NaN for NaT."""
    difference = times - origin
    unit, count = np.datetime_data(difference.dtype)
    numbers = difference.astype(np.int64).astype(np.float64) * count
    numbers[np.isnat(difference)] = math.nan
    return np.asarray(numbers * SECONDS[unit] if unit in SECONDS else numbers / FRACTIONS[unit])


def resolution(dtype: np.dtype[Any]) -> float:
    """Return the unit of dates in seconds."""
    return float(_seconds(np.ones(1, dtype), np.zeros(1, dtype))[0])


def _integers(times: NDArray[Any], origin: NDArray[Any]) -> NDArray[np.float64]:
    """Return differences of integers, each rounded once: that 64 bits wrap around does not hurt their sizes."""
    kind = np.uint64 if times.dtype == np.uint64 or origin.dtype == np.uint64 else np.int64
    times, origin = times.astype(kind), origin.astype(kind)
    later = times >= origin
    with np.errstate(over="ignore"):
        forward, back = (times - origin).astype(np.uint64), (origin - times).astype(np.uint64)
    return np.asarray(np.where(later, forward.astype(np.float64), -back.astype(np.float64)))


def _plain(name: str, times: ArrayLike) -> NDArray[Any]:
    array = arguments.plain(name, times)
    if array.dtype.kind not in "fiumM":
        raise TypeError(f"{name} must hold real numbers or datetime64, got dtype {array.dtype}")
    if array.dtype.kind in "mM" and np.datetime_data(array.dtype)[0] == "generic":
        raise TypeError(f"{name} must have a unit of time, got dtype {array.dtype}")
    if array.dtype.kind == "M" and np.datetime_data(array.dtype)[0] in ("Y", "M"):
        array = array.astype("datetime64[D]")
    if array.dtype.kind == "m" and np.datetime_data(array.dtype)[0] in ("Y", "M"):
        raise TypeError(f"{name} must count in units of fixed length, got dtype {array.dtype}")
    return array


def _rounding(given: NDArray[Any], step: float) -> float:
    """Return by how much a stamp may be off for being rounded: dates to their unit, if that is fine for the step."""
    if given.dtype.kind in "mM":
        half = 0.51 * resolution(given.dtype)
        return half if half <= FINE * step else 0.0
    if given.size == 0 or given.dtype.kind in "iu":
        return 0.0
    return float(np.finfo(given.dtype).eps) * float(np.abs(given).max())


def _even_step(times: NDArray[np.float64], given: NDArray[Any]) -> float | None:
    if times.size < 2:
        return None
    step = float(times[-1]) / (times.size - 1)
    # The first stamp is rounded as well, and so is the last, which makes the step.
    allowed = EVEN * step + 2 * _rounding(given, step) + 4 * float(np.finfo(np.float64).eps) * float(times[-1])
    deviation = np.arange(times.size, dtype=np.float64)
    deviation *= step
    deviation -= times
    return step if float(np.abs(deviation, out=deviation).max()) <= allowed else None


def usual_step(times: NDArray[np.float64]) -> float:
    """Return the median step."""
    return float(np.median(np.diff(times))) if times.size > 1 else 1.0


def nearest(times: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the samples nearest to the wanted times, of two the newer one."""
    after = np.searchsorted(times, wanted, side="right").clip(1, max(times.size - 1, 1))
    after = np.minimum(after, times.size - 1)
    before = np.maximum(after - 1, 0)
    older: NDArray[np.bool_] = wanted - times[before] < times[after] - wanted
    return np.asarray(np.where(older, before, after), np.intp)


def duration(name: str, value: object) -> float:
    """Return a positive duration in the unit of the times; a timedelta64 in seconds."""
    if isinstance(value, np.timedelta64):
        value = float(value / np.timedelta64(1, "s"))
    number = arguments.real(name, value)
    if not (np.isfinite(number) and number > 0):
        raise ValueError(f"{name} must be finite and positive, got {number}")
    return number


def lasting(
    window_duration: object, window_length: object, t: ArrayLike | None, step: float, degree: Any, deriv: Any
) -> int:
    """Return how many samples a window of this duration usually holds, but enough for the fit."""
    if window_duration is None:
        raise TypeError(f"window_length must be an integer, got {shown(window_length)}; or give window_duration")
    if window_length is not None:
        both = named(window_length=window_length, window_duration=window_duration)
        raise ValueError(f"give window_length or window_duration, not both: got {both}")
    if t is not None:
        stamps = Stamps(t, np.size(t))
        step = usual_step(stamps.values) if stamps.step is None else stamps.step
    least = (highest(deriv) + 2 if degree is None else arguments.integer("degree", degree, 0)) + 1
    return max(even_length(duration("window_duration", window_duration), step), least)


def even_length(lasting: float, step: float) -> int:
    """Return how many even samples a window of some duration holds."""
    if not lasting / step <= arguments.MAX_WINDOW:
        raise ValueError(f"window_duration must be at most {arguments.MAX_WINDOW} steps of {step:g}, got {lasting:g}")
    return max(round(lasting / step), 1)
