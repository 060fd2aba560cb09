"""The choice at one level: the samples themselves, or means of three, nine, ... of them.

Averaging keeps the windows that are compared short. If the best of them is among the longest, the choice is made again
with samples averaged by threes, whose noise is weaker by the root of three; and if noise is coloured, its level there is
that of the slow part, which is what counts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff._suggest import noise
from algdiff._suggest.candidates import LARGEST, Family, family, windows
from algdiff._suggest.distances import distances
from algdiff._suggest.rows import averaged, blocks
from algdiff._suggest.selection import Risk, select

Floats = NDArray[np.float64]

FEW = 3
"""Samples that are averaged from one level to the next."""

LONG = 490
"""A window longer than this is looked for at the next level."""

ROUNDS = 5
"""At most so many times are the level of the noise and the candidate found from one another."""


class Limits(NamedTuple):
    """What windows and degrees may be, in samples of the recording: the longest window by degree, and the least."""

    longest: dict[int, int]
    least: int

    def lengths(self, step: int, length: int) -> tuple[tuple[int, tuple[int, ...]], ...]:
        """Return the windows of every degree, where `step` of the samples were averaged and `length` are left."""
        least = math.ceil(self.least / step)
        return tuple((d, tuple(windows(least, min(LARGEST, length, most // step)))) for d, most in self.longest.items())


class Level(NamedTuple):
    """What was found at a level.

    Attributes
    ----------
    step : int
        How many samples were averaged.
    rows : ndarray
        The rows that were compared.
    family : Family
        The candidates.
    risk : Risk
        Theirs.
    sigma : ndarray
        Level of the noise in the averaged samples, as it is for each candidate.
    correlation, exponent : float
        Of AR(1) noise, and of noise whose power falls with the frequency; 0 for white noise.
    """

    step: int
    rows: Floats
    family: Family
    risk: Risk
    sigma: Floats
    correlation: float
    exponent: float


def choose(
    rows: Floats, deriv: int, limits: Limits, kappa: float, mu: float, sigma: float | None, kind: str
) -> Level:
    """Return the level at which the best window is not among the longest, and what was found there."""
    step = 1
    while True:
        level = _at(rows, step, deriv, limits, kappa, mu, sigma, kind)
        window = int(level.family.window[level.risk.best])
        longer = limits.lengths(step * FEW, rows.shape[1] // FEW)
        if window <= LONG or not any(lengths and lengths[-1] > LARGEST // FEW for _, lengths in longer):
            return level
        rows, step = averaged(rows, FEW), step * FEW


def _at(
    rows: Floats,
    step: int,
    deriv: int,
    limits: Limits,
    kappa: float,
    mu: float,
    sigma: float | None,
    kind: str,
) -> Level:
    """Return what is found at one level."""
    rows = blocks(rows)
    lengths = limits.lengths(step, rows.shape[1])
    members = family(deriv, lengths, kappa, mu)
    distance, freedom = distances(rows, members)
    floor = FLOOR * float(np.abs(rows - rows.mean(axis=1, keepdims=True)).max())
    if sigma is not None:
        level = sigma / math.sqrt(step)
        levels = np.full(members.gain.size, max(level, floor))
        return Level(step, rows, members, select(distance, freedom, members, levels), levels, 0.0, 0.0)
    first = level = max(noise.first_guess(rows), floor)
    levels = np.full(members.gain.size, level)
    correlation, exponent, seen = 0.0, 0.0, None
    for _ in range(ROUNDS):
        risk = select(distance, freedom, members, levels)
        if seen == (risk.best, correlation):
            break
        seen = risk.best, correlation
        if kind == "auto":
            tint = noise.colour(distance, freedom, members, risk.best)
            if tint is not None:
                exponent, levels = tint.exponent, np.maximum(tint.sigma, floor)
                continue
        left = noise.residuals(rows, _moderate(risk.best, members, rows), int(members.degree[risk.best]), kappa, mu)
        if left is None:
            break
        if kind == "ar1" and correlation == 0.0:
            correlation = left.correlation()
            if correlation:
                members, first = family(deriv, lengths, kappa, mu, correlation), math.inf
        levels = np.full(members.gain.size, max(min(left.level, first), floor))
    return Level(step, rows, members, select(distance, freedom, members, levels), levels, correlation, exponent)


def _moderate(best: int, members: Family, rows: Floats) -> int:
    """Return the window of a candidate, or the longest of its degree that leaves two thirds of the residuals."""
    window = int(members.window[best])
    chain = members.window[(members.degree == members.degree[best]) & (members.window <= rows.shape[1] // 3)]
    return min(window, int(chain[-1])) if chain.size else window


FLOOR = 1e-9
"""The noise is at least this share of the samples: their own rounding, and that of what is compared."""
