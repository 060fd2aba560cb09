"""The level of the noise: a first guess from differences, then from what a candidate leaves of the samples."""

from __future__ import annotations

import math
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff._noise import noise_level
from algdiff._suggest.candidates import Family, design
from algdiff._suggest.selection import QUANTILE, quantile

Floats = NDArray[np.float64]

SPREAD = {4: 1.44, 10: 2.1}
"""Variance of `noise_level` over its square, times the number of samples, by the order of the differences."""

CAUTION = 3.0
"""Standard errors by which the first guess may be too low."""


def first_guess(rows: Floats) -> float:
    """Return the least level that differences of any order show, and as much more as it may be too low."""
    best = math.inf
    for order, spread in SPREAD.items():
        if rows.shape[1] < 5 * (order + 1):
            break
        levels = np.asarray(noise_level(rows, order=order))
        level = math.sqrt(float(np.square(levels).mean()))
        best = min(best, level * (1.0 + CAUTION * math.sqrt(spread / rows.size)))
    return best if math.isfinite(best) else float(np.std(np.diff(rows, axis=1))) / math.sqrt(2)


class Residuals(NamedTuple):
    """What a smoother leaves of the samples.

    Attributes
    ----------
    values : ndarray
        Residuals in rows.
    weights : ndarray
        The weights of the residual: one at the sample, less those of the smoother.
    """

    values: Floats
    weights: Floats

    def level(self, correlation: float) -> float:
        """Return the level of AR(1) noise of some correlation of neighbours that leaves as much."""
        share = self._autocovariance(correlation)[0]
        return math.sqrt(float((self.values**2).mean()) / share)

    def correlation(self) -> float:
        """Return the correlation of neighbours in AR(1) noise that leaves such residuals, 0 for white noise."""
        count = self.values.size
        if count < 50:
            return 0.0
        seen = float((self.values[:, 1:] * self.values[:, :-1]).mean() / max((self.values**2).mean(), 1e-300))

        def expected(correlation: float) -> float:
            own, next_to = self._autocovariance(correlation)
            return next_to / own

        if abs(seen - expected(0.0)) < COLOURED / math.sqrt(count):
            return 0.0
        candidates = np.linspace(-0.95, 0.99, 98)
        return float(candidates[int(np.argmin([abs(expected(rho) - seen) for rho in candidates]))])

    def _autocovariance(self, correlation: float) -> tuple[float, float]:
        """Return the variance and the covariance of neighbours that AR(1) noise of unit variance leaves."""
        # It is that of the noise seen through that of the weights.
        own = np.correlate(self.weights, self.weights, "full")[self.weights.size - 1 :]
        noise = correlation ** np.arange(own.size + 1.0)
        lags = np.arange(1, own.size)
        variance = own[0] + 2.0 * own[1:] @ noise[1:-1]
        neighbours = own[0] * noise[1] + own[1:] @ (noise[np.abs(lags - 1)] + noise[lags + 1])
        return float(variance), float(neighbours)


COLOURED = 4.0
"""Standard errors of the correlation of neighbours beyond which noise is called coloured."""


def residuals(rows: Floats, window_length: int, degree: int, kappa: float, mu: float) -> Residuals | None:
    """Return what the smoother of some window and degree leaves, or None if it is too little to tell the level by."""
    smoother = _smoother(window_length, degree, kappa, mu)
    half = window_length // 2
    values = rows[:, half : rows.shape[1] - half] - smoother(rows, mode="valid")
    weights = -smoother.weights
    weights[half] += 1.0
    share = float(weights @ weights)
    if values.size < FEWEST or share < LEAST:
        return None
    return Residuals(values, weights)


def coloured(distance: Floats, freedom: Floats, family: Family, sigma: float, steepest: float) -> Floats:
    """Return the level of the noise as it is for each candidate, `sigma` or more.

    Windows of nearly one length see the noise of one band. As windows grow, what lies between the estimates of two
    neighbours falls if it is noise, with the power that is left at low frequencies, and rises if it is bias. So where
    it is more than white noise explains, the level may rise with the window, but no faster than such noise makes it.
    """
    levels = np.full(family.gain.size, sigma**2)
    for degree in np.unique(family.degree):
        chain = np.flatnonzero(family.degree == degree)
        apart = chain[2:], chain[:-2]
        ratios = distance[apart] / family.difference[apart]
        more = ratios > sigma**2 * quantile(freedom[apart], QUANTILE)
        rises = (family.window[chain[1:]] / family.window[chain[:-1]]) ** steepest
        for k in np.flatnonzero(more):
            levels[chain[k + 2]] = max(sigma**2, min(ratios[k], levels[chain[k + 1]] * rises[k + 1]))
    roots: Floats = np.sqrt(levels)
    return roots


_smoother = lru_cache(maxsize=64)(partial(design, 0))


FEWEST = 8
"""Residuals that tell of a level."""

LEAST = 1e-3
"""Share of the noise that a smoother must leave for it."""


def quantum(rows: Floats) -> float:
    """Return the step that all samples are multiples of if most neighbours differ by few of them, else 0."""
    steps = np.abs(np.diff(rows[:, :QUANTUM_SAMPLES], axis=1)).reshape(-1)
    top = float(np.abs(rows).max())
    steps = steps[steps > 8 * np.finfo(np.float64).eps * top]
    if steps.size < 20:
        return 0.0
    least = float(steps.min())
    multiples = steps / least
    whole = np.abs(multiples - np.rint(multiples)) < 1e-3
    return least if whole.all() and float(np.median(multiples)) < 20 else 0.0


QUANTUM_SAMPLES = 20_000
