"""What the shrunken polynomials at the ends leave out, judged by how coefficients decline.

A coefficient that noise hides is not nothing: at the end, where the derivative makes most of it, it may be all of the
error. The coefficients of a smooth signal decline with the degree k much as ``a^k / k!``, which those that are seen
clearly tell. So hidden ones get normal priors of that decline, and their squares are what the prior and the samples
make expect (empirical Bayes). But the signal may as well be a polynomial, which ends with the last clear coefficient;
which of the two holds is weighed by how likely either makes the samples.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

CLEAR = 4.0
"""Standard deviations of a coefficient that is seen clearly."""

LAST = 4
"""So many of the last degrees tell of the decline."""

SLOWEST = 0.5
"""Of the first hidden coefficient over the last clear one, in the prior."""


def squared_bias(scores: Floats, shares: Floats, derivatives: Floats) -> Floats:
    """Return the expected square of what is left out at every place, in units of the variance of the noise.

    Parameters
    ----------
    scores : ndarray of shape (R, K)
        Coefficients of R rows over the level of the noise.
    shares : ndarray of shape (R, K)
        How much of each counts in the estimate.
    derivatives : ndarray of shape (D, H, K)
        Of the polynomials, in D orders at H places.

    Returns
    -------
    ndarray of shape (D, R, H)
    """
    spread = np.stack([prior(row) for row in scores])
    clear = np.isinf(spread)
    squares = np.where(clear, 0.0, np.square(spread))
    # Of a hidden coefficient, this share is what the samples tell of it and the rest what the prior does.
    trust = np.where(clear, 1.0, squares / (1.0 + squares))
    evidence = 0.5 * (np.where(clear, 0.0, trust) * np.square(scores) - np.log1p(squares)).sum(axis=1)
    goes_on = np.where(squares.any(axis=1), 1.0 / (1.0 + np.exp(-np.clip(evidence, -50.0, 50.0))), 0.0)[:, np.newaxis]
    turned = derivatives.swapaxes(1, 2)
    missing = (1.0 - shares) * scores
    known = np.square(np.matmul(np.where(clear, missing, 0.0), turned))
    expected = np.square(np.matmul(trust * missing, turned))
    unsure = np.matmul(np.where(clear, 0.0, np.square(1.0 - shares) * trust), np.square(turned))
    found: Floats = goes_on * (expected + unsure) + (1.0 - goes_on) * known
    return found


def prior(scores: Floats) -> Floats:
    """Return the standard deviations of the priors, in that of the noise: infinite up to the last clear coefficient."""
    spread = np.zeros(scores.size)
    sizes = np.abs(scores)
    clear = np.flatnonzero(sizes[1:] > CLEAR) + 1
    if not clear.size:
        return spread
    last = int(clear[-1])
    spread[: last + 1] = np.inf
    degrees = np.arange(scores.size)
    factorials = np.cumsum(np.log(np.maximum(degrees, 1)))
    logarithms = np.log(sizes[clear]) + factorials[clear]
    level, slope = float(logarithms[-1]), math.log(SLOWEST * (last + 1))
    told = clear > last - LAST
    if told.sum() > 1:
        fitted = np.polyfit(clear[told] - last, logarithms[told], 1)
        if fitted[0] < slope:
            slope, level = fitted
    beyond = degrees[last + 1 :]
    spread[last + 1 :] = np.exp(level + slope * (beyond - last) - factorials[last + 1 :])
    return spread
