"""Samples with labels: the step or the times that these stand for, and which of them estimates get."""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algdiff import _orders as orders
from algdiff._arguments import sampling_step
from algdiff._differentiate import differentiate
from algdiff._differentiator import remembered
from algdiff._refusals import shown
from algdiff._results import Estimates
from algdiff._times import Stamps, lasting

DESIGN = {
    "degree": None,
    "kappa": 1.0,
    "mu": 1.0,
    "tau": None,
    "delay": None,
    "delta": None,
    "fs": None,
    "rule": "exact",
    "trim": 0.0,
    "engine": "auto",
}
"""The arguments of a design beside window and orders, and their defaults."""


class Call:
    """A call of `differentiate` on samples along an axis that has labels.

    Attributes
    ----------
    window_length, deriv
        The arguments, several orders as a tuple.
    orders : tuple of int or None
        The orders, if there are several.
    words : dict
        The keywords of `differentiate`, of which `place` adds `delta` or `t`.
    cut : slice or None
        The samples that get an estimate, if not all do.
    """

    def __init__(self, window_length: Any, deriv: Any, words: dict[str, Any], along: str) -> None:
        for name in ("axis", "out"):
            if name in words:
                raise TypeError(f"{name} must be left out, got {shown(words[name])}: {along}")
        self.window_length, self.deriv = window_length, orders.checked(deriv)
        self.orders = self.deriv if isinstance(self.deriv, tuple) else None
        self.words = {name: value for name, value in words.items() if value is not None}
        duration = self.words.get("window_duration")
        if isinstance(duration, (str, datetime.timedelta)):
            import pandas as pd

            try:
                self.words["window_duration"] = pd.Timedelta(duration).to_timedelta64()
            except ValueError as error:
                given = f"{shown(duration)} ({error})"
                raise ValueError(f"window_duration must be a duration like '2s' or 0.5, got {given}") from None
        self.cut: slice | None = None

    @property
    def stepped(self) -> bool:
        """Whether the step was given, so that labels need not be times."""
        return "delta" in self.words or "fs" in self.words

    def place(self, name: str, labels: Any, samples: int) -> None:
        """Take the step or the times from labels, None if there are none; find out which samples get an estimate."""
        if "t" in self.words:
            name, labels = "t", self.words["t"]
        if labels is not None and ("t" in self.words or not self.stepped):
            self._time(name, labels)
        if self.words.get("mode") == "valid" and "at" not in self.words:
            self._keep_whole(samples)

    def _keep_whole(self, samples: int) -> None:
        """Keep the samples whose window lies within the data."""
        even = "t" not in self.words or Stamps(self.words["t"], samples).step is not None
        if "window_duration" in self.words and not even:
            return  # which is refused
        # The estimates of mode "valid" may lie between two samples, those of "nan" are moved to the nearest.
        self.words["mode"] = "nan"
        first, count = self._whole(samples)
        if "t" in self.words and samples > 1 and self.words["t"][0] > self.words["t"][-1]:
            first = samples - first - count
        self.cut = slice(min(max(first, 0), samples), max(min(first + count, samples), 0))

    def _time(self, name: str, labels: Any) -> None:
        counted = getattr(labels, "step", None)  # a RangeIndex, of which nothing else needs to be looked at
        if counted is not None and counted > 0 and not {"t", "at"} & self.words.keys():
            self.words["delta"] = float(counted)
            return
        values = times(name, labels)
        check(name, values, labels)
        stamps = Stamps(values, values.size)
        if "at" in self.words:
            if _zoned(labels) != _zoned(self.words["at"]):
                raise TypeError(f"at must have a time zone if {name} has one, and only then, got one of the two")
            self.words["at"] = times("at", self.words["at"])
        even = stamps.step is not None and not stamps.descending
        if even and not {"t", "at"} & self.words.keys():
            self.words["delta"] = stamps.step
        else:
            self.words["t"] = values

    def _whole(self, samples: int) -> tuple[int, int]:
        """Return the first sample that has a whole window, counted along ascending times, and how many have one."""
        words = {name: self.words.get(name, default) for name, default in DESIGN.items()}
        t, length = self.words.get("t"), self.window_length
        if t is not None:
            words["delta"] = Stamps(t, samples).step
        if length is None or "window_duration" in self.words:
            step = sampling_step(words["delta"], words["fs"])
            length = lasting(self.words.get("window_duration"), length, t, step, words["degree"], self.deriv)
        plan = remembered(
            length,
            self.deriv,
            *(words[name] for name in ("degree", "kappa", "mu", "tau", "delay", "delta", "fs")),
            *(words[name] for name in ("rule", "trim", "engine")),
        )._plan
        if plan.span > samples:
            raise ValueError(f"window_length must be at most the {samples} samples in mode 'valid', got {plan.span}")
        return plan.aligned_position, samples - plan.span + 1

    def run(self, x: Any, axis: int, **words: Any) -> Estimates:
        """Return the estimates of `x`, and what else is asked for; `words` replace those of the call."""
        found = differentiate(x, self.window_length, self.deriv, axis=axis, **{**self.words, **words})
        found = found if isinstance(found, Estimates) else Estimates(found)
        if self.cut is None:
            return found
        leading = int(self.orders is not None)
        places = {name: axis if name == "support" else axis + leading for name in parts_of(found)}
        return Estimates(**{name: kept(getattr(found, name), place, self.cut) for name, place in places.items()})

    def returned(self, made: dict[str, Any]) -> Any:
        """Return what the caller asked for: the estimates, or `Estimates`."""
        return Estimates(**made) if len(made) > 1 else made["estimate"]


def kept(array: Any, axis: int, cut: slice) -> Any:
    """Return the part of an array that `cut` leaves; if it is lazy, in the chunks it had, the last of them shorter."""
    part = array[(*(slice(None),) * axis, cut)]
    if not hasattr(array, "rechunk"):
        return part
    ends = np.minimum(np.cumsum(array.chunks[axis]), part.shape[axis])
    sizes = np.diff(ends, prepend=0)
    return part.rechunk({axis: tuple(int(size) for size in sizes[sizes > 0]) or (0,)})


def parts_of(found: Estimates) -> dict[str, Any]:
    """Return the parts that there are, by name."""
    return {name: part for name, part in found._asdict().items() if part is not None}


def times(name: str, labels: Any) -> NDArray[Any]:
    """Return labels as numbers, datetime64 or timedelta64; datetimes with a time zone as those of UTC."""
    import pandas as pd

    if isinstance(labels, str):
        raise TypeError(f"{name} must be an array of times, got {shown(labels)}: pass the values, not a name")
    index = labels if isinstance(labels, pd.Index) else pd.Index(labels)
    if isinstance(index, pd.PeriodIndex):
        index = index.to_timestamp()
    kind = getattr(index.dtype, "kind", "O")
    if isinstance(index, pd.MultiIndex) or kind not in "fiumM":
        what = "several levels" if isinstance(index, pd.MultiIndex) else f"dtype {index.dtype}"
        raise TypeError(f"{name} must hold numbers or times, got {what}: give delta, fs or t")
    if kind == "M":
        index = pd.DatetimeIndex(index)
        index = index if index.tz is None else index.tz_convert("UTC").tz_localize(None)
    elif kind == "m":
        index = pd.TimedeltaIndex(index)
    elif not isinstance(index.dtype, np.dtype):
        return np.asarray(index.to_numpy(dtype=np.float64, na_value=np.nan))
    return np.asarray(index.to_numpy())


def _zoned(labels: Any) -> bool:
    import pandas as pd

    index = pd.Index(labels)
    return getattr(index.dtype, "kind", "") == "M" and pd.DatetimeIndex(index).tz is not None


def check(name: str, values: NDArray[Any], labels: Any) -> None:
    """Refuse times that are missing or do not go one way, and name the first fault as the caller knows it."""
    gone = np.isnat(values) if values.dtype.kind in "mM" else ~np.isfinite(values)
    if gone.any():
        place = int(gone.argmax())
        raise ValueError(f"{name} must have no missing or infinite times, got {_label(labels, place)} at place {place}")
    if values.size < 2:
        return
    later = values[1:] > values[:-1] if values[-1] > values[0] else values[1:] < values[:-1]
    if not later.all():
        place = int((~later).argmax())
        pair = f"{_label(labels, place)} followed by {_label(labels, place + 1)} at place {place + 1}"
        raise ValueError(f"{name} must be sorted and without duplicates, got {pair}")


def _label(labels: Any, place: int) -> Any:
    return labels.iloc[place] if hasattr(labels, "iloc") else labels[place]
