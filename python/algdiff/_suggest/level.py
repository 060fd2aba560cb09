"""The choice at one level: the samples themselves, or means of three, nine, ... of them.

Averaging keeps the windows that are compared short. If the best of them is among the longest, the choice is made again
with samples averaged by threes, whose noise is weaker by the root of three.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff._suggest import edges, noise
from algdiff._suggest.bias import squared_bias
from algdiff._suggest.candidates import LARGEST, Family, family, reproduced, windows
from algdiff._suggest.distances import distances
from algdiff._suggest.rows import averaged, blocks
from algdiff._suggest.selection import Risk, select

Floats = NDArray[np.float64]

FEW = 3
"""Samples that are averaged from one level to the next."""

KNOWN = 55
"""Shorter windows are not looked at again at the next level, where they were no worse than longer ones."""

LONG = 490
"""A window longer than this is looked for at the next level."""

ROUNDS = 5
"""At most so many times are the level of the noise and the candidate found from one another."""


class Limits(NamedTuple):
    """What windows and degrees may be, in samples of the recording: the longest window by degree, and the least."""

    longest: dict[int, int]
    least: int

    def lengths(self, step: int, length: int, least: int = 1) -> tuple[tuple[int, tuple[int, ...]], ...]:
        """Return the windows of every degree, where `step` of the samples were averaged and `length` are left."""
        least = max(self.least // step - 1, least) if step > 1 else max(self.least, least)
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
    white, correlation : float
        The least level, and the correlation of neighbours in AR(1) noise.
    """

    step: int
    rows: Floats
    family: Family
    risk: Risk
    sigma: Floats
    white: float
    correlation: float


class Search(NamedTuple):
    """What is looked for.

    Attributes
    ----------
    deriv : int
        Order of the derivative.
    limits : Limits
        What windows may be.
    exponent : float
        kappa and mu.
    sigma : float or None
        The level of the noise, if it is known.
    kind : str
        What kind of noise it is.
    """

    deriv: int
    limits: Limits
    exponent: float
    sigma: float | None
    kind: str

    def run(self, rows: Floats) -> Level:
        """Return the level at which the best window is not among the longest, and what was found there."""
        step = 1
        while 2 * self.limits.least > step * LARGEST:
            rows, step = averaged(rows, FEW), step * FEW
        level = self._first(rows, step)
        while level.family.window[level.risk.best] > LONG:
            rows, step = averaged(rows, FEW), step * FEW
            if not any(lengths for _, lengths in self.limits.lengths(step, rows.shape[1], KNOWN)):
                break
            level = self._next(rows, step, level)
        return level

    def _first(self, rows: Floats, step: int) -> Level:
        """Return what is found at the finest level: from the samples themselves, if windows may be short."""
        rows = blocks(rows)
        members = self._members(rows, step)
        apart = distances(rows, members)
        if self.sigma is not None:
            return self._found(rows, step, members, apart, max(self.sigma / math.sqrt(step), FLOOR), 0.0)
        level, correlation, seen = max(noise.first_guess(rows), FLOOR), 0.0, None
        for _ in range(ROUNDS):
            best = select(*apart, members, self._levels(apart, members, level)).best
            if seen == (best, correlation):
                break
            seen = best, correlation
            window, degree = _moderate(best, members), int(members.degree[best])
            if self.kind == "ar1":
                # Short windows smooth correlated noise as they do a signal.
                window = max(window, min(WIDE, rows.shape[1] // 3))
                degree = min(degree, int(members.degree.min()) + 2)
            left = noise.residuals(rows, window - 1 + window % 2, degree, self.exponent, self.exponent)
            if left is None:
                break
            if self.kind == "ar1" and correlation == 0.0:
                correlation = left.correlation()
                if correlation:
                    members = self._members(rows, step, correlation=correlation)
            level = max(left.level(correlation), FLOOR)
        return self._found(rows, step, members, apart, level, correlation)

    def _next(self, rows: Floats, step: int, last: Level) -> Level:
        """Return what is found from means of samples, from what was found from fewer of them each."""
        rows = blocks(rows)
        members = self._members(rows, step, KNOWN)
        # What is left of correlated noise after averaging is white, and stronger than white noise would be.
        slow = 1.0 if last.step > 1 else math.sqrt((1.0 + last.correlation) / (1.0 - last.correlation))
        sigma = float(last.sigma[last.risk.best]) * slow / math.sqrt(FEW)
        found = self._found(rows, step, members, distances(rows, members), max(sigma, FLOOR), 0.0)
        return found._replace(white=last.white / math.sqrt(FEW), correlation=last.correlation)

    def _members(self, rows: Floats, step: int, least: int = 1, correlation: float = 0.0) -> Family:
        lengths = self.limits.lengths(step, rows.shape[1], least)
        return family(self.deriv, lengths, self.exponent, self.exponent, correlation)

    def _levels(self, apart: tuple[Floats, Floats], members: Family, level: float) -> Floats:
        """Return the level of the noise for each candidate."""
        if self.kind == "auto" and self.sigma is None:
            return noise.coloured(*apart, members, level, STEEPEST * self.deriv)
        return np.full(members.gain.size, level)

    def _found(
        self, rows: Floats, step: int, members: Family, apart: tuple[Floats, Floats], level: float, correlation: float
    ) -> Level:
        levels = self._levels(apart, members, level)
        risk = select(*apart, members, levels)
        if 2 * members.window[risk.best] > rows.shape[1] and not edges.is_polynomial(
            rows, reproduced(int(members.degree[risk.best]), self.deriv), float(levels[risk.best])
        ):
            # Windows of more than half of the rows see too little of their ends to tell of the bias there.
            risk = select(*apart, members, levels, 2 * members.window <= rows.shape[1])
        bias2 = squared_bias(*apart, members, levels, risk.best, rows.shape[1])
        if bias2 is not None:
            risk = risk._replace(found=bias2)
        return Level(step, rows, members, risk, levels, level, correlation)


def _moderate(best: int, members: Family) -> int:
    """Return a window that smooths no more than it must: a candidate's own, or a shorter one of its degree."""
    window, degree = int(members.window[best]), members.degree[best]
    chain = members.window[(members.degree == degree) & (members.window >= SHORT * (degree + 1))]
    return min(window, int(chain[0])) if chain.size else window


STEEPEST = 1.0
"""The power of the window that the power of noise may rise by, over the order of the derivative.

What lies between neighbours would not fall with a power of ``2 deriv + 1``.
"""

WIDE = 61
"""The least window of residuals that tell of a correlation."""

SHORT = 3
"""Samples of a window per coefficient of its polynomial that leave enough noise to tell its level by."""

FLOOR = 1e-9
"""The noise is at least this: of rows whose size is 1, the rounding of what is compared, and more than their own."""
