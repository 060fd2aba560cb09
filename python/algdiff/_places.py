"""Into what blocks a file is cut."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from algdiff._blocks import Row

MEMORY = 512 << 20
"""Bytes of memory that a run may use, unless it is said otherwise."""

BLOCK = 16 << 20
"""Bytes of the buffers of a block, unless windows are long."""


def _up(value: int, unit: int) -> int:
    return -(-value // unit) * unit


class TooLargeError(Exception):
    """Carries the bytes that the smallest block needs."""


class Cuts:
    """Blocks of outputs, in the order in which they are made.

    Blocks are as long along time as is good for the window, and hold neighbours in the file together. They start where
    the engine starts its own, so that they have the bits of one run over everything; or on the output's `units`.

    Parameters
    ----------
    shape : tuple of int
        Shape of the outputs of one order.
    axis : int
        The axis of time in it.
    row : Row
        What outputs read.
    cost : int
        Bytes that buffers need for one sample and its outputs.
    budget : int
        Bytes for all buffers, at most.
    fortran : bool
        Whether the first axis lies closest in the file.
    units : tuple of int or None
        Chunks of the file; blocks are whole chunks, along time only if `chunked`.
    chunked : bool
        Whether the output is written in these chunks.
    rows : bool
        Whether blocks must hold everything of their samples: the rows of a table.

    Attributes
    ----------
    bytes : int
        Bytes that the buffers of the largest block need.

    Raises
    ------
    TooLargeError
        The smallest block does not fit into `budget`.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        axis: int,
        row: Row,
        *,
        cost: int,
        budget: int,
        fortran: bool = False,
        units: Sequence[int] | None = None,
        chunked: bool = False,
        rows: bool = False,
    ) -> None:
        self.shape, self.axis, self.row, self.fortran = shape, axis, row, fortran
        self.unit = units[axis] if units is not None and chunked else row.grid
        # Windows start on the grid, counted from the first sample: that makes the first block longer.
        self.before = 0 if chunked else row.center % row.grid
        extents = [
            extent if rows else min(unit, extent) for extent, unit in zip(shape, units or [1] * len(shape), strict=True)
        ]
        # The shortest block: as many outputs as the window has samples, each with the window before it; or as a chunk
        # of the input has, which is read whole.
        chunk = 1 if units is None or chunked else units[axis]
        extents[axis] = min(_up(max(row.span, chunk), self.unit), max(shape[axis], 1))
        need = self._need(extents, cost)
        if need > budget:
            raise TooLargeError(need)
        order = range(len(shape)) if fortran else reversed(range(len(shape)))
        nearer, target = True, min(max(BLOCK, 8 * need), budget)
        for index in order:
            if index == axis:
                nearer = False
                self._lengthen(extents, cost, target)
            elif not rows:
                # Neighbours closer than those in time as far as memory reaches, others as far as blocks stay small.
                self._widen(extents, index, cost, budget if nearer else target)
        self.extents = tuple(extents)
        self.bytes = self._need(extents, cost)

    def _need(self, extents: Sequence[int], cost: int) -> int:
        along = min(extents[self.axis] + self.before, max(self.shape[self.axis], 1)) + self.row.span
        return cost * along * math.prod(extents[: self.axis]) * math.prod(extents[self.axis + 1 :])

    def _lengthen(self, extents: list[int], cost: int, limit: int) -> None:
        least, most = extents[self.axis], max(self.shape[self.axis], 1)
        per = cost * math.prod(extents[: self.axis]) * math.prod(extents[self.axis + 1 :])
        room = limit // max(per, 1) - self.row.span
        length = most if room >= most else (room - self.before) // self.unit * self.unit
        extents[self.axis] = min(max(length, least), most)

    def _widen(self, extents: list[int], index: int, cost: int, limit: int) -> None:
        if any(extents[other] < self.shape[other] for other in self._nearer(index)):
            return
        unit = extents[index]
        times = max(limit // max(self._need(extents, cost), 1), 1)
        extents[index] = max(min(unit * times, self.shape[index]), unit)

    def _nearer(self, index: int) -> range:
        return range(index) if self.fortran else range(index + 1, len(self.shape))

    def __len__(self) -> int:
        return math.prod(
            1 + len(starts) if extent else 0 for starts, extent in zip(self._later, self.shape, strict=True)
        )

    def __getitem__(self, index: int) -> tuple[slice, ...]:
        """Return the place of a block in the shape of the outputs; a header may promise more than a list can hold."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        place = []
        cuts = list(zip(self._later, self.shape, strict=True))
        for starts, extent in cuts if self.fortran else reversed(cuts):
            index, turn = divmod(index, 1 + len(starts))
            start = starts[turn - 1] if turn else 0
            place.append(slice(start, starts[turn] if turn < len(starts) else extent))
        return tuple(place if self.fortran else reversed(place))

    def __iter__(self) -> Iterator[tuple[slice, ...]]:
        """Yield the places of the blocks."""
        return map(self.__getitem__, range(len(self)))

    @property
    def _later(self) -> list[range]:
        """Where blocks start along every axis, but for the first."""
        steps = [max(step, 1) for step in self.extents]
        firsts = [step + (self.before if axis == self.axis else 0) for axis, step in enumerate(self.extents)]
        return [
            range(max(first, 1), extent, step) for first, extent, step in zip(firsts, self.shape, steps, strict=True)
        ]
