"""The least risk among candidates, from how far their estimates lie apart.

The risk of a candidate is its variance, which is known, and the square of its bias, which is not. Where a finer
candidate b (one with more noise) has no bias, ``mean (c - b)^2 - sigma^2 ||w_c - w_b||^2`` estimates the bias of c
without one of its own, but with noise. So the bias counts only where the distance is more than noise can explain
(Lepski 1990; Goldenshluger and Lepski 2011), which a quantile of chi-squared decides; then the neighbours of what was
found, of which all biases are small, are compared by the estimate itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff._suggest.candidates import Family

Floats = NDArray[np.float64]

QUANTILE = 4.5
"""In standard deviations: hundreds of comparisons of one family hardly ever go beyond by chance."""

REACH = 20.0
"""Candidates are compared with those of at most this many times their variance, which drown nothing."""

STEP = 1.05
"""And of at least so many times."""

REFERENCE = (2.0, 8.0)
"""Times the variance of the candidate that was found: where the references of its neighbours lie."""

NEIGHBOURS = 2.0
"""Times its variance: up to where its neighbours lie."""


class Risk(NamedTuple):
    """What was found.

    Attributes
    ----------
    best : int
        The candidate of the least risk.
    bias2, variance : ndarray
        The square of the bias and the variance of every candidate.
    found : float
        The square of the bias of the best one, as compared with its references; or, where `bias` can tell, by that.
    """

    best: int
    bias2: Floats
    variance: Floats
    found: float


def select(
    distance: Floats, freedom: Floats, family: Family, sigma: Floats, allowed: NDArray[np.bool_] | None = None
) -> Risk:
    """Return the risk of the candidates.

    Parameters
    ----------
    distance, freedom : ndarray of shape (K, K)
        Mean squares of the differences of two candidates, and how many independent ones there are.
    family : Family
        The candidates.
    sigma : ndarray of shape (K,)
        Level of the noise, as it is for each candidate.
    allowed : ndarray of bool, optional
        Which candidates may be chosen.
    """
    noise = family.apart(sigma)
    bound = noise * quantile(freedom, QUANTILE)
    seen = np.where(distance > bound, distance - noise, 0.0)
    finer = (family.gain > STEP * family.gain[:, None]) & (family.gain <= REACH * family.gain[:, None])
    # Of a higher degree, finer estimates have less bias; of a lower one, theirs is to be taken off.
    within = finer & (family.degree >= family.degree[:, None])
    across = finer & (family.degree < family.degree[:, None])
    own = _rising(np.where(within, seen, 0.0).max(axis=1), family)
    bias2 = own
    roots = np.where(across, np.sqrt(seen), 0.0)
    for _ in range(2):
        excess = np.maximum(roots - np.sqrt(bias2), 0.0).max(axis=1)
        bias2 = _rising(np.maximum(own, excess**2), family)
    variance = sigma**2 * family.gain
    total = bias2 + variance
    if allowed is not None and allowed.any():
        total = np.where(allowed, total, math.inf)
    return _refined(Risk(int(np.argmin(total)), bias2, variance, math.nan), distance - noise, family)


def _rising(bias2: Floats, family: Family) -> Floats:
    """Make the bias of one degree rise with the window."""
    bias2 = bias2.copy()
    for degree in np.unique(family.degree):
        chain = family.degree == degree
        bias2[chain] = np.maximum.accumulate(bias2[chain])
    return bias2


def _refined(risk: Risk, excess: Floats, family: Family) -> Risk:
    """Return the best of the neighbours of the best candidate."""
    gain, best = family.gain, risk.best
    low, high = (factor * gain[best] for factor in REFERENCE)
    references = (gain > low) & (gain < high) & (family.degree >= family.degree[best])
    near = (gain >= gain[best]) & (gain <= NEIGHBOURS * gain[best]) & (family.degree == family.degree[best])
    if not references.any():
        return risk._replace(found=float(risk.bias2[best]))
    places = np.flatnonzero(near)
    biases = excess[np.ix_(places, np.flatnonzero(references))].mean(axis=1)
    least = int(np.argmin(biases + risk.variance[places]))
    return risk._replace(best=int(places[least]), found=max(0.0, float(biases[least])))


def quantile(freedom: Floats, deviations: float) -> Floats:
    """Return a quantile of chi-squared over its mean, that of so many standard deviations of a normal one.

    By Wilson and Hilferty (1931).
    """
    spread = 2.0 / (9.0 * freedom)
    cube: Floats = np.maximum(1.0 - spread + deviations * np.sqrt(spread), 0.0) ** 3
    return cube
