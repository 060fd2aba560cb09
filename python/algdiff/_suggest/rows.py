"""The rows of samples that a choice is made from: some of a long recording, without those that hold gaps."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from algdiff._arguments import Samples
from algdiff._noise import noise_level

Floats = NDArray[np.float64]

LOUDEST = 1e100
"""Noise that may be stated, in units of the samples: its square is a number."""

BLOCKS, BLOCK = 16, 2048
"""How many blocks of how many samples of a level stand for all of it, if it is longer."""

CHANNELS = 16
"""Rows that stand for all of them."""

LARGEST = 1023
"""Exponent of the largest power of two."""

STRETCH = 1 << 22
"""Samples in the middle of a recording that stand for all of it, together in all rows."""


def finite_rows(x: Samples, axis: int) -> Floats:
    """Return up to `CHANNELS` rows along `axis` in double precision, of complex ones two for each.

    Of a long recording they are a stretch in its middle.

    Where samples are missing, the rows hold the longest run of samples without a gap in any of them. Rows without a
    finite sample have no say.
    """
    turned = np.moveaxis(x, axis, -1)
    outer, length = turned.shape[:-1], turned.shape[-1]
    count = math.prod(outer)
    if count == 0:
        raise ValueError(f"x must hold at least one row of samples to choose a window, got shape {x.shape}")
    picked = spread(count)
    stretch = min(length, max(BLOCK, STRETCH // picked.size))
    first = (length - stretch) // 2
    some = [turned[np.unravel_index(row, outer)][first : first + stretch] for row in picked]
    parts = [part for row in some for part in ((row.real, row.imag) if turned.dtype.kind == "c" else (row,))]
    rows = np.array(parts, np.float64).reshape(-1, stretch)
    finite = np.isfinite(rows)
    alive = finite.any(axis=1)
    if alive.any() and not alive.all():
        rows, finite = rows[alive], finite[alive]
    there = finite.all(axis=0)
    if not there.all():
        edges = np.flatnonzero(np.diff(np.concatenate(([False], there, [False])).astype(np.int8)))
        runs = edges.reshape(-1, 2)
        if runs.size == 0:
            raise ValueError("x must hold samples that are finite, got none")
        first, last = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
        rows = rows[:, first:last]
    return rows


def spread(count: int) -> NDArray[np.intp]:
    """Return which rows, of so many, stand for all of them."""
    return np.linspace(0, count - 1, min(count, CHANNELS)).astype(np.intp)


def scaled(rows: Floats, *, of_noise: bool) -> tuple[Floats, Floats]:
    """Return rows of a size about 1, without their offsets, and what each was divided by.

    Several rows are of one size if `of_noise` is False; else their noise is, so that none drowns the others.
    """
    # Powers of two round nothing; two steps keep offsets and overflow apart.
    first = np.frexp(np.abs(rows).max(axis=1, keepdims=True))[1]
    rows = np.ldexp(rows, -first)
    rows -= rows[:, :1]
    second = np.frexp(np.abs(rows).max(axis=1, keepdims=True))[1]
    if not of_noise:
        second = np.full_like(second, (first + second).max()) - first
    second = np.minimum(second, LARGEST - first)
    rows = np.ldexp(rows, -second)
    scale = np.ldexp(1.0, (first + second)[:, 0])
    if of_noise and len(rows) > 1:
        level = np.atleast_1d(noise_level(blocks(rows)[: len(rows)], order=3))
        level = np.where(level > 0, level, level.max() or 1.0)
        rows, scale = rows / level[:, np.newaxis], scale * level
    return rows, scale


def blocks(rows: Floats) -> Floats:
    """Return blocks evenly spread over rows that are too long to be looked at whole."""
    count, length = rows.shape
    if count * length <= BLOCKS * BLOCK:
        return rows
    size = min(length, max(BLOCK, BLOCKS * BLOCK // count))
    each = max(1, BLOCKS * BLOCK // (count * size))
    starts = np.linspace(0, length - size, each).astype(int)
    return np.concatenate([rows[:, start : start + size] for start in starts])


def averaged(rows: Floats, count: int) -> Floats:
    """Return the means of `count` samples each; what is left over at the end is left out."""
    whole = rows.shape[1] // count * count
    means: Floats = rows[:, :whole].reshape(len(rows), -1, count).mean(axis=-1)
    return means
