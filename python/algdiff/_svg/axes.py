"""Axes of charts: their ranges, ticks and numbers, and where values lie."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

DECADES = 12
"""A logarithmic axis reaches down by so many decades at most, unless its range is given."""
DIGITS = 5
"""Numbers at ticks that would take more digits lose a power of ten, or what they have in common."""
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MINUS, TIMES = "\N{MINUS SIGN}", "\N{MULTIPLICATION SIGN}"
LARGEST = 1e307
"""Numbers beyond are drawn as if they were this large."""


class Ticks(NamedTuple):
    """Where ticks stand, what is written there, lines without numbers, and what all numbers lack."""

    places: tuple[float, ...]
    labels: tuple[str, ...]
    minor: tuple[float, ...] = ()
    note: str = ""


class Axis(NamedTuple):
    """One direction of a chart: the values at its ends, and the pixels where these lie."""

    low: float
    high: float
    first: float
    last: float
    log: bool = False

    def at(self, values: Floats) -> Floats:
        """Return pixels; what lies far outside is moved to just outside, what cannot be drawn is NaN."""
        with np.errstate(divide="ignore", invalid="ignore"):
            values = np.where(np.isinf(values), np.nan, values)
            scaled = np.log10(np.maximum(values, 0)) if self.log else values / 2
            low, high = self.ends
            share = (scaled - low) / (high - low)
        return self.first + (self.last - self.first) * np.clip(share, -2.0, 3.0)

    @property
    def ends(self) -> tuple[float, float]:
        """What the share of the axis is counted between; half the values, so that no difference overflows."""
        return (math.log10(self.low), math.log10(self.high)) if self.log else (self.low / 2, self.high / 2)

    def ticks(self, most: int) -> Ticks:
        """Return ticks, `most` of them at most, at round values."""
        return _log_ticks(self.low, self.high, most) if self.log else _linear_ticks(self.low, self.high, most)


def span(parts: list[Floats], *, log: bool, margin: float) -> tuple[float, float]:
    """Return a range that holds all values that can be drawn, with a margin as a share of it."""
    low, high = math.inf, -math.inf
    for part in parts:
        there = part[np.isfinite(part) & ((part > 0) | (not log))]
        if there.size:
            low, high = min(low, float(there.min())), max(high, float(there.max()))
    if low > high:
        return (0.1, 1.0) if log else (0.0, 1.0)
    low, high = (min(max(end, -LARGEST), LARGEST) for end in (low, high))
    return _log_span(low, high, margin) if log else _linear_span(low, high, margin)


def given(limits: tuple[float, float], *, log: bool) -> tuple[float, float]:
    """Return a range that was asked for, if it is one that can be drawn, or the nearest."""
    low, high = sorted(float(min(max(limit, -LARGEST), LARGEST)) for limit in limits)
    if log:
        return _log_span(max(low, 1 / LARGEST), max(high, 1 / LARGEST), 0.0)
    return _linear_span(low, high, 0.0)


def _linear_span(low: float, high: float, margin: float) -> tuple[float, float]:
    wide = high / 2 - low / 2
    least = max(1e-13 * max(abs(low), abs(high)), 1 / LARGEST)
    if wide <= least:
        wide = max(0.25 * max(abs(low), abs(high)), 1e3 * least) if low else 0.5
        return low - wide, high + wide
    return low - 2 * margin * wide, high + 2 * margin * wide


def _log_span(low: float, high: float, margin: float) -> tuple[float, float]:
    high = max(high, 10 / LARGEST)
    low = max(low, 1 / LARGEST, high * 10.0**-DECADES)
    if math.log10(high / low) < 1e-3:
        low, high = low / 2, high * 2
    more = (high / low) ** margin
    return low / more, high * more


def _step(wide: float, most: int) -> float:
    """Return the round step (1, 2 or 5 times a power of ten) of which a range holds `most` at most."""
    rough = wide / most
    power = 10.0 ** math.floor(math.log10(rough))
    return next((factor * power for factor in (1, 2, 5) if factor * power >= rough * (1 - 1e-9)), 10 * power)


def _linear_ticks(low: float, high: float, most: int) -> Ticks:
    step = 2 * _step(high / 2 - low / 2, most)
    step = _step(step * most, most)
    first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
    counts = [first + index for index in range(last - first + 1)]
    places = tuple(count * step for count in counts)
    labels, note = _numbers(counts, step)
    return Ticks(places, labels, (), note)


def _numbers(counts: list[int], step: float) -> tuple[tuple[str, ...], str]:
    """Return short numbers for multiples of a step, and what they lack: a common part, a power of ten."""
    note = ""
    largest = max(map(abs, counts), default=0)
    if largest * (step / 10 ** math.floor(math.log10(step))) >= 10**DIGITS:
        common = min(counts, key=lambda count: len(f"{count * step:.15g}".rstrip("0")))
        counts = [count - common for count in counts]
        largest = max(map(abs, counts))
        note = f"{'+' if common > 0 else MINUS} {abs(common) * step:.15g}"
    power = math.floor(math.log10(step) + 1e-9)
    top = math.floor(math.log10(largest * step) + 1e-9) if largest else power
    shift = 3 * math.floor(top / 3) if top >= DIGITS or power < -DIGITS + 1 else 0
    decimals = max(shift - power, 0)
    if shift:
        note = f"{TIMES}10{str(shift).translate(RAISED)} {note}".strip()
    factor = step / 10.0**power * 10.0 ** (power - shift) if abs(shift) < 290 else step / 10.0**power
    labels = (f"{count * factor:.{decimals}f}" for count in counts)
    return tuple(label.replace("-", MINUS) for label in labels), note


def _log_ticks(low: float, high: float, most: int) -> Ticks:
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    decades = range(first, last + 1)
    if len(decades) < 2:
        return _between(low, high, most)
    every = -(-len(decades) // most)
    shown = [power for power in decades if power % every == 0]
    plain = min(shown) >= -3 and max(shown) <= 4
    labels = tuple(f"{10.0**power:g}" if plain else f"10{str(power).translate(RAISED)}" for power in shown)
    minor: list[float] = []
    if every > 1:
        minor = [10.0**power for power in decades if power not in shown]
    elif len(decades) <= 4:
        minor = [factor * 10.0**power for power in (first - 1, *decades) for factor in range(2, 10)]
    return Ticks(tuple(10.0**power for power in shown), labels, tuple(place for place in minor if low <= place <= high))


def _between(low: float, high: float, most: int) -> Ticks:
    """Return ticks within a decade or two: at 1, 2 and 5, or at round steps if that leaves fewer than two."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    places = [factor * 10.0**power for power in powers for factor in (1, 2, 5)]
    places = [place for place in places if low * (1 - 1e-9) <= place <= high * (1 + 1e-9)]
    if len(places) < 3:
        return _linear_ticks(low, high, max(most - 2, 2))
    plain = places[0] >= 1e-3 and places[-1] < 1e5
    labels = tuple(f"{place:g}" if plain else _scientific(place) for place in places)
    return Ticks(tuple(places), labels)


def _scientific(value: float) -> str:
    power = math.floor(math.log10(value) + 1e-9)
    digit = round(value / 10.0**power)
    return ("" if digit == 1 else f"{digit}·") + f"10{str(power).translate(RAISED)}"
