"""In what chunks an output is written."""

from __future__ import annotations

import math
from collections.abc import Iterable

from algdiff._formats.base import Layout

CHUNK = 4 << 20
"""Bytes of a chunk at most, unless the input has good ones."""

GOOD = range(256 << 10, (16 << 20) + 1)
"""Bytes of chunks that are taken over from the input."""

NEAR = 256
"""Neighbours closer than those in time that a chunk holds."""


def chunks_for(layout: Layout) -> tuple[int, ...]:
    """Return the chunks of one order: those of the input if they are of a good size, or long ones along time.

    Chunks hold up to `NEAR` of the neighbours that lie closer than those in time, and then samples in time: a power of
    two of them, unless all.
    """
    shape = [max(extent, 1) for extent in layout.shape]
    room = CHUNK // layout.dtype.itemsize
    near = range(layout.axis) if layout.fortran else range(len(shape) - 1, layout.axis, -1)
    if layout.chunks is not None:
        given = [min(extent, chunk) for extent, chunk in zip(shape, layout.chunks, strict=True)]
        if math.prod(given) * layout.dtype.itemsize in GOOD or given == shape:
            return tuple(given)
        chunks, most = given, room
    else:
        chunks, most = [1] * len(shape), NEAR
        _widen(chunks, shape, near, NEAR)
    chunks[layout.axis] = 1
    while math.prod(chunks) > most:
        largest = chunks.index(max(chunks))
        chunks[largest] = -(-chunks[largest] // 2)
    length = room // math.prod(chunks)
    chunks[layout.axis] = min(shape[layout.axis], 1 << (length.bit_length() - 1))
    others = [axis for axis in range(len(shape)) if axis != layout.axis]
    _widen(chunks, shape, others if layout.fortran else others[::-1], room)
    return tuple(chunks)


def _widen(chunks: list[int], shape: list[int], axes: Iterable[int], room: int) -> None:
    """Widen chunks along axes, one after the other, to at most `room` samples."""
    for axis in axes:
        chunks[axis] = min(shape[axis], chunks[axis] * max(room // math.prod(chunks), 1))
