"""The square of a bias, from how the distances from finer candidates grow with the window.

A candidate's distance from a finer one shows only a part of its bias: the finer one has most of the same. How large a
part depends on how fast the bias falls as windows get shorter. Where an acceleration jumps, it falls by the root of the
window, and a window shorter by a sixth shows a twentieth of the square; where a signal is smooth, more than half. So
the power of the window that distances rise by is taken from the windows about the candidate, and a signal whose
spectrum falls by the power that belongs to it tells the part.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from algdiff._suggest.candidates import Family, design, reproduced

Floats = NDArray[np.float64]

LONGER = 3
"""Windows beyond the candidate by which the power is found."""

SPAN = 2
"""From one of them to another, whose distances from their next shorter ones are compared."""

SEEN = 2.0
"""Standard deviations of what noise puts between two candidates, beyond which they tell of the power."""

POWERS = (0.5, 8.0)
"""Powers that are told apart: a lower one would be noise, higher ones show the same part."""

LESS = 0.5
"""The power stays so far below twice that of a smooth signal, where the lowest frequencies would be all that counts."""

SHORTEST = 2.2
"""A candidate's window over the shortest one that it is compared with."""

HIGHEST = 0.6
"""Of the samples: the longest window whose distances count."""


def squared_bias(
    distance: Floats, freedom: Floats, family: Family, sigma: Floats, best: int, length: int
) -> float | None:
    """Return the mean square of the bias of the candidate `best`, or None if distances do not tell.

    Parameters
    ----------
    distance, freedom : ndarray of shape (K, K)
        Mean squares of the differences of two candidates, and how many independent ones there are.
    family : Family
        The candidates.
    sigma : ndarray of shape (K,)
        Level of the noise, as it is for each candidate.
    best : int
        A candidate.
    length : int
        Samples in a row.
    """
    chain = np.flatnonzero(family.degree == family.degree[best])
    place = int(np.searchsorted(chain, best))
    noise = family.apart(sigma)
    excess, spread = distance - noise, noise * np.sqrt(2.0 / freedom)
    end = min(place + LONGER + 1, int(np.searchsorted(family.window[chain], HIGHEST * length, "right")))
    if end <= place:
        return None
    pairs = [(chain[k], chain[k - 1]) for k in range(max(min(place, end - SPAN - 1), 1), end)]
    one = family.designs[best]
    power = _power([(int(family.window[k]), float(excess[k, j]), float(spread[k, j])) for k, j in pairs])
    finer = chain[:place]
    finer = finer[(family.window[best] <= SHORTEST * family.window[finer]) & (spread[best, finer] > 0)]
    if power is None or not finer.size:
        return None
    power = min(power, 2 * _smooth(one.deriv, one.degree) - LESS)
    shown = shares(one.deriv, one.degree, one.kappa, power, family.window[best] / family.window[finer])
    # The least squares estimate of what they all are a part of.
    weight = shown / spread[best, finer] ** 2
    return max(0.0, float(weight @ excess[best, finer]) / float(weight @ shown))


def _power(neighbours: list[tuple[int, float, float]]) -> float | None:
    """Return the highest power of the window that neighbours' distances rise by, or None if noise explains them.

    For each window and the next shorter one: the longer one, what lies between them beyond noise, and how much noise
    spreads that.
    """
    found = []
    for (short, low, spread), (long, high, noisy) in zip(neighbours, neighbours[SPAN:], strict=False):
        if high > SEEN * noisy:
            low = low if low > SEEN * spread else max(low, 0.0) + spread
            found.append(math.log(high / low) / math.log(long / short))
    return min(max(*found, POWERS[0]), POWERS[1]) if found else None


def shares(deriv: int, degree: int, exponent: float, power: float, ratios: Floats) -> Floats:
    """Return the part of the square of a bias that windows shorter by `ratios` show, if it rises by a power of it."""
    place, passed = _response(deriv, degree, exponent)
    weight = np.exp(-power * place)
    whole = float(weight @ np.square(1.0 - passed))
    return np.array(
        [weight @ np.square(passed - np.interp(place - math.log(ratio), place, passed)) / whole for ratio in ratios]
    )


def _frequency_response(deriv: int, degree: int, exponent: float) -> tuple[Floats, Floats]:
    """Return logarithms of the frequency times half the window, and how much of the derivative there passes."""
    weights = design(deriv, WINDOW, degree, exponent, exponent).weights
    half = WINDOW // 2
    place = np.linspace(math.log(0.01), math.log(3e4), 1500)
    frequency = np.exp(place) / half
    seen = frequency < math.pi
    phases = np.exp(1j * np.outer(frequency[seen], np.arange(-half, half + 1)))
    passed = np.zeros(place.size)
    passed[seen] = ((phases @ weights) / (1j * frequency[seen]) ** deriv).real
    # Lower, what does not pass rises by the power of a smooth signal's bias, and drowns in rounding.
    first = int(np.searchsorted(place, math.log(0.3)))
    passed[:first] = 1.0 - (1.0 - passed[first]) * np.exp(_smooth(deriv, degree) * (place[:first] - place[first]))
    return place, passed


def _smooth(deriv: int, degree: int) -> int:
    """Return the power of the window that the bias of a smooth signal rises by."""
    return reproduced(degree, deriv) + 1 - deriv


_response = lru_cache(maxsize=64)(_frequency_response)

WINDOW = 401
"""Samples of the window whose response stands for those of all."""
