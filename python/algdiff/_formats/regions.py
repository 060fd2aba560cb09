"""Regions of an array that lies in a file as it would in memory, read and written without a memory map.

A map of a file that shrinks, or on a disk that is full, kills the process; reads and writes raise errors.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from algdiff._formats.base import Place, Samples, Target


class Region:
    """Where an array lies in a file.

    Parameters
    ----------
    shape : tuple of int
        Shape of the array.
    dtype : numpy.dtype
        Its type.
    offset : int
        Bytes before it.
    fortran : bool
        Whether the first axis lies closest.
    """

    def __init__(self, shape: tuple[int, ...], dtype: np.dtype[Any], offset: int, *, fortran: bool) -> None:
        self.shape, self.dtype, self.offset, self.fortran = shape, dtype, offset, fortran
        self.nbytes = math.prod(shape) * dtype.itemsize

    def pieces(self, place: Place) -> Iterator[tuple[int, int]]:
        """Yield position and length, in bytes, of the pieces of a region, in the order of the file."""
        shape = self.shape[::-1] if self.fortran else self.shape
        slices = place[::-1] if self.fortran else place
        # The last axes as far as they are whole, and one more, lie together.
        split = len(shape)
        while split > 0 and slices[split - 1] == slice(0, shape[split - 1]):
            split -= 1
        split = max(split - 1, 0)
        steps = [math.prod(shape[axis + 1 :]) * self.dtype.itemsize for axis in range(len(shape))]
        extent = slices[split].stop - slices[split].start if slices else 1
        length = extent * (steps[split] if slices else self.dtype.itemsize)
        start = slices[split].start * steps[split] if slices else 0
        for index in itertools.product(*(range(one.start, one.stop) for one in slices[:split])):
            yield self.offset + start + sum(map(int.__mul__, index, steps)), length

    def read(self, file: Any, path: Path, place: Place, out: Samples) -> None:
        """Fill `out`, whose axes must lie in memory as those of the array do in the file."""
        view, done = _bytes(out, self.fortran), 0
        for position, length in self.pieces(place):
            file.seek(position)
            end = done + length
            while done < end:
                count = file.readinto(view[done:end])
                if not count:
                    raise ValueError(f"{path}: ends before the array does: it was cut off, or is being written")
                done += count

    def write(self, file: Any, place: Place, block: Samples) -> None:
        """Write a region, whatever the layout of `block` in memory."""
        # Contiguous in the order of the file; a copy only if it is not.
        view, done = _bytes(np.require(block, requirements=["F" if self.fortran else "C"]), self.fortran), 0
        for position, length in self.pieces(place):
            file.seek(position)
            end = done + length
            while done < end:
                done += file.write(view[done:end])


def _bytes(array: Samples, fortran: bool) -> memoryview:
    flat = array.reshape(-1, order="F" if fortran else "C")
    return flat.view(np.uint8).data if flat.size else memoryview(b"")


class InPlace(Target):
    """A result whose numbers have their places from the beginning.

    Parameters
    ----------
    path : Path
        The file, which exists with everything but the numbers.
    region : Region
        Where the result lies in it, with the leading axis over the orders if it has one.
    leading : bool
        Whether it has.
    """

    def __init__(self, path: Path, region: Region, leading: bool) -> None:
        self.file = open(path, "r+b", buffering=0)
        self.region, self.leading = region, leading
        # Sparse where the file system can: space is taken by what is written.
        if os.fstat(self.file.fileno()).st_size < region.offset + region.nbytes:
            self.file.truncate(region.offset + region.nbytes)

    def write(self, place: Place, block: Samples, times: Samples | None = None) -> None:
        """Write a region."""
        if self.leading:
            self.region.write(self.file, (slice(0, len(block)), *place), block)
        else:
            self.region.write(self.file, place, block[0])

    def sync(self) -> int:
        """Make durable what was written; places say all that is needed to go on."""
        os.fsync(self.file.fileno())
        return 0

    def close(self) -> None:
        """Close the file."""
        self.file.close()
