"""Raw binary: numbers and nothing else, channels alternating sample by sample."""

from __future__ import annotations

import os
from pathlib import Path

from algdiff._formats.base import Layout, Options, Place, Samples, Source, Target
from algdiff._formats.npy import check_numbers
from algdiff._formats.regions import InPlace, Region


def open_source(path: Path, inner: str | None, options: Options) -> Source:
    """Open the numbers for reading."""
    return RawSource(path, options)


class RawSource(Source):
    """Numbers of one type, from an offset to the end of the file."""

    axis = 0

    def __init__(self, path: Path, options: Options) -> None:
        if options.dtype is None:
            raise ValueError(f"dtype must be given for the raw numbers of {path}, got nothing")
        super().__init__(path, open(path, "rb", buffering=0))
        self.dtype = options.dtype
        try:
            check_numbers(path, (), self.dtype)
            frame = self.dtype.itemsize * (options.channels or 1)
            held = os.fstat(self.file.fileno()).st_size - options.offset
            if held < 0:
                size = held + options.offset
                raise ValueError(f"offset must be at most the {size} bytes of {path}, got {options.offset}")
            if held % frame:
                what = f"{options.channels or 1} x {self.dtype}"
                raise ValueError(f"{path}: must hold whole samples of {frame} bytes ({what}), got {held} bytes")
            shape = (held // frame,) if options.channels is None else (held // frame, options.channels)
            self.shape = check_numbers(path, shape, self.dtype)
            self.region = Region(self.shape, self.dtype, options.offset, fortran=False)
        except BaseException:
            self.file.close()
            raise

    def read(self, place: Place, out: Samples) -> None:
        """Fill `out`."""
        self.region.read(self.file, self.path, place, out)


def check(path: Path, inner: str | None, layout: Layout) -> None:
    """Every result can be held."""


def create(path: Path, inner: str | None, layout: Layout) -> Target:
    """Start the numbers under a temporary name."""
    path.write_bytes(b"")
    return reopen(path, inner, layout, 0)


def reopen(path: Path, inner: str | None, layout: Layout, mark: int) -> Target:
    """Go on with numbers that were started."""
    return _RawTarget(path, Region(layout.rows, layout.dtype, 0, fortran=False), leading=False)


class _RawTarget(InPlace):
    """Rows of numbers: one of every channel, for every order."""

    def write(self, place: Place, block: Samples, times: Samples | None = None) -> None:
        """Write some rows."""
        self.region.write(self.file, (*place, slice(0, self.region.shape[1])), block)
