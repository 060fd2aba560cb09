"""Rows collected raw, for formats that are written in one go from the first number to the last."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from algdiff._formats.base import Layout, Place, Samples, Target
from algdiff._formats.regions import InPlace, Region

BYTES = 8 << 20
"""Size of the pieces in which a stage is read."""


class Stage(Target):
    """A result that is to be encoded: an array as it is, or the rows of a table, each after its time.

    Parameters
    ----------
    path : Path
        The file of raw numbers; made if it does not exist.
    layout : Layout
        What is to be written.
    table : bool
        Whether as rows and columns.
    """

    def __init__(self, path: Path, layout: Layout, *, table: bool) -> None:
        self.path, self.layout, self.table = path, layout, table
        path.touch()
        if table:
            rows, columns = layout.rows
            self.timed = 8 if layout.time is not None else 0
            width = self.timed + columns * layout.dtype.itemsize
            self.region = Region((rows, width), np.dtype(np.uint8), 0, fortran=False)
        else:
            self.region = Region(layout.full_shape, layout.dtype, 0, fortran=False)
        self.array = InPlace(path, self.region, leading=layout.leading and not table)

    def write(self, place: Place, block: Samples, times: Samples | None = None) -> None:
        """Write a region."""
        if not self.table:
            self.array.write(place, block)
            return
        packed = np.ascontiguousarray(block).view(np.uint8).reshape(len(block), -1)
        if times is not None:
            packed = np.concatenate([np.ascontiguousarray(times).view(np.uint8).reshape(-1, 8), packed], axis=1)
        self.array.write((*place, slice(0, self.region.shape[1])), packed[np.newaxis])

    def rows(self) -> Iterator[tuple[Samples, Samples | None]]:
        """Yield blocks of rows in order, with their times if the table holds times."""
        rows, width = self.region.shape
        length = max(BYTES // max(width, 1), 1)
        with open(self.path, "rb", buffering=0) as file:
            for start in range(0, rows, length):
                packed = np.empty((min(length, rows - start), width), np.uint8)
                place = (slice(start, start + len(packed)), slice(0, width))
                self.region.read(file, self.path, place, packed)
                numbers = np.ascontiguousarray(packed[:, self.timed :]).view(self.layout.dtype)
                times = (
                    np.ascontiguousarray(packed[:, : self.timed]).view(self.layout.time_dtype or np.float64)[:, 0]
                    if self.timed
                    else None
                )
                yield numbers, times

    def bytes(self) -> Iterator[bytes]:
        """Yield the numbers of an array in C order."""
        with open(self.path, "rb") as file:
            while piece := file.read(BYTES):
                yield piece

    def sync(self) -> int:
        """Make durable what was written."""
        return self.array.sync()

    def close(self) -> None:
        """Close the file."""
        self.array.close()
