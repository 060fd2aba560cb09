"""Times in a column, which must be even."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from algdiff._formats.base import Samples
from algdiff._refusals import shown
from algdiff._times import _seconds

SHARE = 1e-3
"""Times may lie this share of a step from where even ones would.

That moves an estimate by no more than this share of it times the sum of its weights' sizes, in steps: 0.2 % for two
samples, and less for longer windows.
"""

MOST = 0.1
"""Rounding may move them by no more than this share of a step.

One missing sample moves a time by half a step at least, wherever it is missing, so that none is taken for rounding.
"""


class Even:
    """Times that are even from the first to the last, up to what they are rounded to.

    Even times that are rounded to a unit lie less than this unit from the line through the first and the last of them:
    each is off by at most half of it, or if cut off by less than the whole, and the line by no more than its ends.

    Parameters
    ----------
    path : Path
        The file, for errors.
    name : str
        The column, for errors.
    ends : array of float64 or datetime64
        The first time and the last.
    rows : int
        How many there are.
    some : array
        Some of them, which say to what they are rounded.
    rounding : float
        Relative rounding of times that are floats in the file.

    Attributes
    ----------
    step : float or None
        Their step, in seconds; None of a single one.
    """

    def __init__(
        self, path: Path, name: str, ends: Samples, rows: int, some: Samples, rounding: float = 2.0**-53
    ) -> None:
        self.path, self.first = path, ends[:1]
        self.step: float | None = None
        self.allowed = math.inf
        span = float(self._since(ends[-1:])[0])
        step = span / max(rows - 1, 1)
        if rows < 2 and span == 0:
            return
        if not (step > 0 and math.isfinite(step)):
            raise ValueError(f"{path}: the times in {shown(name)} must ascend, got {ends[0]} first and {ends[-1]} last")
        size = 0.0 if ends.dtype.kind == "M" else float(np.abs(ends).max())
        exact = 4 * rounding * size + 8 * 2.0**-53 * span
        self.step, self.allowed = step, min(max(SHARE * step, _unit(some)) + exact, MOST * step)

    def fault(self, first: int, times: Samples) -> tuple[int, str] | None:
        """Return which time is the first that is not even, and what it should be, of times from row `first` on."""
        since = self._since(times)
        expected = np.arange(first, first + len(times), dtype=np.float64) * (self.step or 0.0)
        with np.errstate(invalid="ignore"):
            good = np.abs(since - expected) <= self.allowed
        if good.all():
            return None
        index = int(np.flatnonzero(~good)[0])
        return index, (
            f"must be {self._at(expected[index])} for even times, got {times[index]}; load uneven ones, and use "
            "differentiate(x, ..., t=times)"
        )

    def _since(self, times: Samples) -> Samples:
        if times.dtype.kind == "M":
            return _seconds(times, self.first)
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(times - self.first)

    def _at(self, since: float) -> Any:
        if self.first.dtype.kind != "M":
            return self.first[0] + since
        unit = _unit_of(self.first)
        return (self.first + np.array(round(since / unit)).astype(f"m8[{np.datetime_data(self.first.dtype)[0]}]"))[0]


def _unit_of(times: Samples) -> float:
    """Return the unit of dates, in seconds."""
    one = np.ones(1, np.int64).view(f"M8[{np.datetime_data(times.dtype)[0]}]")
    return float(_seconds(one, np.zeros_like(one))[0])


def _unit(times: Samples) -> float:
    """Return the unit of the last decimal that any of some times has, in seconds; 0 if they have all digits."""
    if times.dtype.kind == "M":
        count, unit = times.astype(np.int64), _unit_of(times)
        scale = 1
        while unit * scale * 10 <= 1.0 and not (count % (scale * 10)).any():
            scale *= 10
        return unit * scale
    with np.errstate(over="ignore", invalid="ignore"):
        for decimals in range(13):
            if np.array_equal(np.round(times, decimals), times):
                return float(10.0**-decimals)
    return 0.0
