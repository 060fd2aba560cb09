"""NumPy's ``.npz``: one of the arrays in a zip file, which is read and written in one go."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from algdiff._formats.base import Layout, Options, Place, Samples, Source
from algdiff._formats.npy import read_header, write_header
from algdiff._formats.regions import Region
from algdiff._formats.stage import Stage
from algdiff._refusals import listed, shown, told

PIECE = 1 << 20
"""Bytes that are unpacked at once."""

DATE = (1980, 1, 1, 0, 0, 0)
"""When all arrays are said to have been written, so that equal ones make equal files: the earliest date of a zip."""

NAME = 2**16 - 1
"""Bytes of the longest name in a zip file."""


def open_source(path: Path, inner: str | None, options: Options) -> Source:
    """Read the array."""
    return NpzSource(path, options)


class NpzSource(Source):
    """An array of an ``.npz`` file, in memory: a zip file cannot be read from the middle."""

    def __init__(self, path: Path, options: Options) -> None:
        super().__init__(path)
        with open(path, "rb") as file:
            with _telling(path):
                archive = zipfile.ZipFile(file)
                names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
            self.key = name = _pick(path, names, options.key)
            with _telling(path), archive.open(f"{name}.npy") as member:
                size = archive.getinfo(f"{name}.npy").file_size
                self.array = _unpacked(member, size, f"{path}: array {name!r}", options.memory)
        self.shape, self.dtype = self.array.shape, self.array.dtype
        self.fortran = self.array.flags.fnc

    def read(self, place: Place, out: Samples) -> None:
        """Fill `out`."""
        out[...] = self.array[place]


def _pick(path: Path, names: Sequence[str], key: str | None) -> str:
    if key is None and len(names) == 1:
        return names[0]
    if key is None or key not in names:
        got = "nothing" if key is None else repr(key)
        raise ValueError(f"key must name one array of {path} ({listed(names) or 'it has none'}), got {got}")
    return key


def _unpacked(member: IO[bytes], size: int, where: str, memory: int | None) -> Samples:
    shape, fortran, dtype = read_header(member, where)
    nbytes = Region(shape, dtype, 0, fortran=fortran).nbytes
    if nbytes != size - member.tell():
        takes = f"shape {shape} of {dtype} takes {nbytes} bytes, got {size - member.tell()}"
        raise ValueError(f"{where}: not a whole .npy array ({takes})")
    if memory is not None and nbytes > memory:
        raise ValueError(f"{where} takes {nbytes} bytes, more than the {memory} of memory: save it as .npy")
    array = np.empty(shape, dtype, order="F" if fortran else "C")
    view, done = array.reshape(-1, order="A").view(np.uint8).data if nbytes else memoryview(b""), 0
    while piece := member.read(PIECE):  # to the end, where the checksum is compared
        view[done : done + len(piece)] = piece
        done += len(piece)
    if done < nbytes:
        raise ValueError(f"{where}: not a whole .npy array ({nbytes} bytes, got {done})")
    return array


@contextmanager
def _telling(path: Path) -> Iterator[None]:
    """Let whatever unpacking raises of a broken file name it in one line; errors of the system and our own pass."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        if isinstance(error, ValueError) and str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: not a whole .npz file ({told(error)})") from None


def check(path: Path, inner: str | None, layout: Layout) -> None:
    """Raise ValueError if the name of the array cannot be one."""
    try:
        name = f"{layout.key}.npy".encode()
    except UnicodeEncodeError:
        raise ValueError(f"key must be text, got {layout.key!r}") from None
    if b"\0" in name or len(name) > NAME:
        raise ValueError(f"key must be at most {NAME - 4} bytes of text, got {layout.key[:20]!r} with {len(name) - 4}")
    if layout.key.startswith("/") or ".." in re.split(r"[/\\]", layout.key):
        raise ValueError(f"key must not lead out of the folder that a .npz OUT is unpacked in, got {shown(layout.key)}")


def encode(stage: Stage, path: Path, inner: str | None, layout: Layout) -> None:
    """Write the array, not compressed."""
    info: Any = zipfile.ZipInfo(f"{layout.key}.npy", DATE)
    with zipfile.ZipFile(path, "w") as archive, archive.open(info, "w", force_zip64=True) as member:
        write_header(member, replace(layout, fortran=False))  # stages are in C order
        for piece in stage.bytes():
            member.write(piece)
