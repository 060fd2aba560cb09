"""Points of curves: which ones are drawn, and as what path."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

COLUMNS = 512
"""A curve is drawn by the least and the largest of its values in so many parts of its width, at most."""


def ascending(x: Floats, *values: Floats) -> tuple[Floats, ...]:
    """Return points in ascending order of pixels `x`, without those that have none."""
    count = min(map(len, (x, *values)))
    x, *rest = (part[:count] for part in (x, *values))
    there = ~np.isnan(x)
    if not there.all():
        x, *rest = (part[there] for part in (x, *rest))
    if x.size > 1 and (np.diff(x) < 0).any():
        order = np.argsort(x, kind="stable")
        x, *rest = (part[order] for part in (x, *rest))
    return x, *rest


def runs(x: Floats, values: tuple[Floats, ...], first: float, last: float) -> list[tuple[Floats, ...]]:
    """Return stretches of points without gaps, thinned: each column keeps the least and the largest of all `values`.

    `x` ascends; `first` and `last` are the pixels where columns begin and end. Points beyond are kept as far as the
    nearest on either side, from which lines come in. A gap that is narrower than a column is not seen.
    """
    start = max(int(np.searchsorted(x, first)) - 1, 0)
    stop = int(np.searchsorted(x, last, side="right")) + 1
    parts = [part[start:stop] for part in (x, *values)]
    gone = np.isnan(parts[1:]).any(axis=0)
    there = np.flatnonzero(~gone)
    if not there.size:
        return []
    broken = np.diff(there) > 1
    columns = min(COLUMNS, int(last - first))
    if there.size > 2 * columns:
        share = (parts[0][there] - first) / (last - first)
        column = np.floor(columns * np.clip(share, -1.0 / columns, 1.0)).astype(np.intp)
        kept = np.unique(np.concatenate([extremes(part[there], column) for part in parts[1:]]))
        there, column = there[kept], column[kept]
        holes = np.cumsum(gone)[there]
        broken = (np.diff(holes) > 0) & (np.diff(column) > 1)
    cuts = np.flatnonzero(broken) + 1
    return [tuple(part[some] for part in parts) for some in np.split(there, cuts)]


def extremes(y: Floats, column: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return where in each column, of which there are few and which ascend, the least and the largest values lie."""
    begins = np.concatenate(([0], np.flatnonzero(np.diff(column)) + 1))
    ends = np.append(begins[1:], y.size)
    kept = [0, y.size - 1]
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        part = y[begin:end]
        kept += (begin + int(part.argmin()), begin + int(part.argmax()))
    return np.array(kept, np.intp)


def line(parts: Iterable[tuple[Floats, ...]]) -> str:
    """Return a path through points; a lone one is a short stroke."""
    return "".join(f"M{_joined(x, y)}" if x.size > 1 else f"M{x[0] - 0.7:.1f},{y[0]:.1f}h1.4" for x, y in parts)


def steps(parts: Iterable[tuple[Floats, ...]]) -> str:
    """Return a path that holds each value up to the next point."""
    return "".join(
        f"M{x[0]:.1f},{y[0]:.1f}" + "".join(f"H{a:.1f}V{b:.1f}" for a, b in zip(x[1:], y[1:], strict=True))
        for x, y in parts
    )


def dots(parts: Iterable[tuple[Floats, ...]]) -> str:
    """Return a path of round dots."""
    return "".join(f"M{a:.1f},{b:.1f}h0" for x, y in parts for a, b in zip(x, y, strict=True))


def band(parts: Iterable[tuple[Floats, ...]]) -> str:
    """Return a path around what lies between two curves."""
    return "".join(f"M{_joined(x, one)}L{_joined(x[::-1], other[::-1])}Z" for x, one, other in parts)


def _joined(x: Floats, y: Floats) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
