"""The level of the noise: a first guess from differences, then from what a candidate leaves of the samples."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff._noise import noise_level
from algdiff._suggest.candidates import Family, design

Floats = NDArray[np.float64]

SPREAD = {3: 1.27, 6: 1.7, 10: 2.1}
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
    level : float
        The level of white noise that leaves as much.
    values : ndarray
        Residuals in rows.
    weights : ndarray
        The weights of the residual: one at the sample, less those of the smoother.
    """

    level: float
    values: Floats
    weights: Floats

    def correlation(self) -> float:
        """Return the correlation of neighbours in AR(1) noise that leaves such residuals, 0 for white noise."""
        count = self.values.size
        if count < 50:
            return 0.0
        seen = float((self.values[:, 1:] * self.values[:, :-1]).mean() / max((self.values**2).mean(), 1e-300))
        own = np.correlate(self.weights, self.weights, "full")[self.weights.size - 1 :]
        lags = np.arange(own.size + 1)

        def expected(correlation: float) -> float:
            # The autocovariance of the residuals is that of the noise seen through that of the weights.
            noise = correlation ** np.arange(own.size + 2.0)
            at = [
                float(own[0] * noise[k] + own[1:] @ (noise[np.abs(lags[1:-1] - k)] + noise[lags[1:-1] + k]))
                for k in (0, 1)
            ]
            return at[1] / at[0]

        if abs(seen - expected(0.0)) < COLOURED / math.sqrt(count):
            return 0.0
        candidates = np.linspace(-0.95, 0.99, 98)
        return float(candidates[int(np.argmin([abs(expected(rho) - seen) for rho in candidates]))])


COLOURED = 4.0
"""Standard errors of the correlation of neighbours beyond which noise is called coloured."""


def residuals(rows: Floats, window_length: int, degree: int, kappa: float, mu: float) -> Residuals | None:
    """Return what the smoother of some window and degree leaves, or None if it is too little to tell the level by."""
    smoother = design(0, window_length, degree, kappa, mu)
    half = window_length // 2
    values = rows[:, half : rows.shape[1] - half] - smoother(rows, mode="valid")
    weights = -smoother.weights
    weights[half] += 1.0
    share = float(weights @ weights)
    if values.size < FEWEST or share < LEAST:
        return None
    return Residuals(math.sqrt(float((values**2).mean()) / share), values, weights)


class Colour(NamedTuple):
    """Noise whose power falls with the frequency f as ``f**-exponent``.

    Attributes
    ----------
    exponent : float
        0 for white noise.
    sigma : ndarray
        The level of white noise that does to a candidate what this noise does.
    """

    exponent: float
    sigma: Floats


def colour(distance: Floats, freedom: Floats, family: Family, best: int) -> Colour | None:
    """Return the colour of the noise, if candidates finer than `best` show one.

    Windows that differ by half see the noise of one band. In white noise the squares of their differences over what
    unit noise makes of them are all the same; bias makes them rise with more than the fifth power of the window.
    """
    chain = np.flatnonzero(family.degree == family.degree[best])
    chain = chain[family.window[chain] <= 0.7 * family.window[best]]
    if chain.size < 5:
        return None
    finer, coarser = chain[:-2], chain[2:]
    ratio = distance[coarser, finer] / family.difference[coarser, finer]
    if not (ratio > 0).all():
        return None
    place = 0.5 * np.log(family.window[coarser] * family.window[finer].astype(float))
    shares = np.sqrt(freedom[coarser, finer] / 2)
    slope, offset = np.polyfit(place, np.log(ratio), 1, w=shares)
    spread = 1.0 / math.sqrt(float((shares**2 * (place - np.average(place, weights=shares**2)) ** 2).sum()))
    if slope < STEEP or slope < COLOURED * spread:
        return None
    slope = min(slope, STEEPEST)
    at = np.log(family.window / np.sqrt(1.2))
    return Colour(float(slope), np.exp(0.5 * (offset + slope * at)))


STEEP, STEEPEST = 0.2, 2.0
"""Exponents that count as colour."""

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
