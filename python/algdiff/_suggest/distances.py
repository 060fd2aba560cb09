"""Estimates of all candidates at some places, and how far they lie apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algdiff._suggest.candidates import Family

Floats = NDArray[np.float64]

PLACES = 400
"""About this many places are compared."""


def distances(rows: Floats, family: Family) -> tuple[Floats, Floats]:
    """Return the mean squares of the differences of two candidates, and how many independent ones there are.

    Two candidates are compared wherever both windows lie in the data.

    Parameters
    ----------
    rows : ndarray of shape (R, L)
        Samples; rows share nothing but the signal's kind.
    family : Family
        Candidates of at most L samples.
    """
    count, length = rows.shape
    stride = max(1, count * length // PLACES)
    places = np.arange((length - 1) // 2 % stride, length, stride)
    estimates = np.zeros((family.gain.size, count, places.size))
    inside = [(places >= half) & (places < length - half) for half in family.half]
    for k, one in enumerate(family.designs):
        estimates[k][:, inside[k]] = one(rows, mode="valid")[:, places[inside[k]] - family.half[k]]
    distance, freedom = _compared(estimates, inside, family)
    full = count * np.maximum(length - 2 * np.maximum(family.half, family.half[:, None]), 1)
    # Samples that lie close together say the same; those farther apart are independent.
    return distance, np.maximum(1.0 / (1.0 / freedom + family.memory / full + EXTRA / (count * length)), 1.0)


EXTRA = 4.0
"""Over the number of samples: the share of the uncertainty that is that of the level of the noise."""


def _compared(estimates: Floats, inside: list[NDArray[np.bool_]], family: Family) -> tuple[Floats, Floats]:
    """Return mean squares of differences, and of how many places."""
    total = family.gain.size
    distance, places = np.zeros((total, total)), np.ones((total, total))
    for window in np.unique(family.window):
        mine = np.flatnonzero(family.window == window)
        shorter = mine[-1] + 1
        part = estimates[:shorter][:, :, inside[mine[0]]].reshape(shorter, -1)
        if part.shape[1] == 0:
            continue
        squares = np.einsum("kp,kp->k", part, part)
        apart = squares[mine, None] + squares[None, :] - 2 * part[mine] @ part.T
        apart = np.maximum(apart, 0.0) / part.shape[1]
        distance[mine, :shorter], distance[:shorter, mine] = apart, apart.T
        places[mine, :shorter] = places[:shorter, mine] = part.shape[1]
    return distance, places
