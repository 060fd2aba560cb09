"""NumPy's ``.npy``: one array, in C or Fortran order."""

from __future__ import annotations

import os
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np

from algdiff._formats.base import Layout, Options, Place, Samples, Source, Target
from algdiff._formats.regions import InPlace, Region
from algdiff._refusals import told

HEADER = 10_000
"""Bytes of the longest header that is read, as by NumPy."""


def open_source(path: Path, inner: str | None, options: Options) -> Source:
    """Open the array for reading."""
    return NpySource(path)


class NpySource(Source):
    """The array of an ``.npy`` file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, open(path, "rb", buffering=0))
        try:
            self.shape, self.fortran, self.dtype = read_header(self.file, path)
            self.region = Region(self.shape, self.dtype, self.file.tell(), fortran=self.fortran)
            held = os.fstat(self.file.fileno()).st_size - self.region.offset
            if held < self.region.nbytes:
                raise ValueError(
                    f"{path}: not a whole .npy array (shape {self.shape} of {self.dtype} takes {self.region.nbytes} "
                    f"bytes, got {held})"
                )
        except BaseException:
            self.file.close()
            raise

    def read(self, place: Place, out: Samples) -> None:
        """Fill `out`."""
        self.region.read(self.file, self.path, place, out)


def read_header(file: IO[bytes], where: Path | str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, whether in Fortran order, and type; refuse what are no numbers. No pickle is ever loaded."""
    try:
        shape, fortran, dtype = any_header(file)
    except OSError:
        raise
    except Exception as error:  # a header is a Python expression, in which anything may be wrong
        raise ValueError(f"{where}: not a whole .npy array ({told(error)})") from None
    if dtype.hasobject:
        raise ValueError(f"{where} must hold real or complex numbers, got Python objects")
    return check_numbers(where, tuple(shape), dtype), bool(fortran), dtype


def any_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, whether in Fortran order, and type, of whatever kind; of damaged ones any error may come."""
    from numpy.lib import format as npy

    version = npy.read_magic(file)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"format {version[0]}.{version[1]}, which is not for numbers without names")
    size = file.read(2 if version == (1, 0) else 4)
    length = int.from_bytes(size, "little")
    if length > HEADER:
        raise ValueError(f"a header of {length} bytes")
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, fortran, dtype = read(BytesIO(size + file.read(length)))
    return shape, fortran, dtype


def check_numbers(where: Path | str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> tuple[int, ...]:
    """Return `shape`; raise unless the type is one of numbers, of which NumPy can hold that many."""
    if dtype.kind not in "biufc":
        raise ValueError(f"{where} must hold real or complex numbers, got dtype {dtype}")
    try:
        np.broadcast_to(np.zeros((), dtype), shape)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{where}: not a whole array ({error})") from None
    return shape


def check(path: Path, inner: str | None, layout: Layout) -> None:
    """Every result can be held."""


def create(path: Path, inner: str | None, layout: Layout) -> Target:
    """Start the array under a temporary name."""
    with open(path, "wb") as file:
        write_header(file, layout)
    return reopen(path, inner, layout, 0)


def write_header(file: IO[bytes], layout: Layout) -> None:
    """Write what stands before the numbers."""
    from numpy.lib import format as npy

    header = {
        "descr": npy.dtype_to_descr(layout.dtype),
        "fortran_order": layout.fortran and len(layout.full_shape) > 1,
        "shape": layout.full_shape,
    }
    npy.write_array_header_1_0(file, header)


def reopen(path: Path, inner: str | None, layout: Layout, mark: int) -> Target:
    """Go on with an array that was started."""
    with open(path, "rb") as file:
        shape, fortran, dtype = read_header(file, path)
        offset = file.tell()
    return InPlace(path, Region(shape, dtype, offset, fortran=fortran), layout.leading)
