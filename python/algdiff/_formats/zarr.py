"""Zarr: stores that are folders of chunks, of format 2 and 3; written whole chunk by whole chunk, in format 3."""

from __future__ import annotations

import asyncio
import errno
import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.core.buffer import Buffer, default_buffer_prototype
from zarr.storage import LocalStore

from algdiff._formats import nodes, steps
from algdiff._formats.base import Layout, Options, Place, Samples, Source, Target
from algdiff._formats.chunks import chunks_for
from algdiff._output import sync_folder

CONFIG = {"array.write_empty_chunks": True}
"""Chunks are written whatever they hold, so that one that is missing is one that was lost."""


def open_source(path: Path, inner: str | None, options: Options) -> Source:
    """Open an array for reading."""
    return ZarrSource(path, inner)


class ZarrSource(Source):
    """An array of a Zarr store."""

    def __init__(self, path: Path, inner: str | None) -> None:
        super().__init__(path)
        if path.is_file():
            raise ValueError(f"{path}: must be the folder of a Zarr store, got a file")
        os.stat(path)  # so that an error names it
        self.name = nodes.only(path) if inner is None else nodes.checked(path, inner)
        node = nodes.node(self.folder)
        if node is None or not node.array:
            raise ValueError(f"{path}: must hold an array {self.name}, got {nodes.held(path, path)}")
        if not node.numeric:
            raise ValueError(f"{self.folder} must hold real or complex numbers, got {node.dtype or 'other values'}")
        self.array = _array(path, self.name, node)
        self.shape, self.dtype, self.chunks = self.array.shape, self.array.dtype, self.array.chunks
        if not self.shape:
            raise ValueError(f"{self.folder} must be an array, got a single value")
        if min(self.chunks) < 1:
            raise ValueError(f"{self.folder}: not a whole Zarr store (chunks of shape {self.chunks})")
        self.node = node
        self.attributes = dict(node.attributes)
        steps.check_packed(str(self.folder), self.attributes, self.dtype)
        if node.dimensions is not None:
            self.attributes[steps.DIMENSIONS] = list(node.dimensions)

    @property
    def folder(self) -> Path:
        """The folder of the array."""
        return self.path / self.name

    def read(self, place: Place, out: Samples) -> None:
        """Fill `out`."""
        if out.size:
            with nodes.telling(self.path):
                buffer = default_buffer_prototype().nd_buffer.from_numpy_array(out)
                self.array.get_basic_selection(place, out=buffer)

    def step_along(self, axis: int) -> float | None:
        """Return the step that the attributes of the array or of a group around it state, or its coordinate."""
        parts = self.name.split("/") if self.name else []
        for length in range(len(parts), -1, -1):
            folder = self.path.joinpath(*parts[:length])
            node = nodes.node(folder)
            step = None if node is None else steps.stated(str(folder), node.attributes)
            if step is not None:
                return step
        return self._step_of_coordinate(axis)

    def _step_of_coordinate(self, axis: int) -> float | None:
        dimensions = self.node.dimensions
        dimension = dimensions[axis] if dimensions is not None and len(dimensions) == len(self.shape) else None
        # Its coordinate is the array beside it that is called as it is.
        if not self.name or not isinstance(dimension, str) or len(nodes.split(dimension)) != 1:
            return None
        name = "/".join([*self.name.split("/")[:-1], dimension])
        node = nodes.node(self.path / name)
        if node is None or node.dtype is None or name == self.name:
            return None
        array = _array(self.path, name, node)
        coordinate = steps.Coordinate(name, array.shape, array.dtype, node.attributes.get("units"), array.__getitem__)
        with nodes.telling(self.path):
            return steps.along(self.path, coordinate, self.shape[axis])

    def stamp(self) -> list[int]:
        """Return the size of all files of the array, and the time of the latest change."""
        size = latest = 0
        for file in _files(self.folder):
            status = file.stat()
            size, latest = size + status.st_size, max(latest, status.st_mtime_ns)
        return [size, latest]


def _array(path: Path, name: str, node: nodes.Node) -> zarr.Array[Any]:
    if node.pickles:
        raise ValueError(f"{path / name} must hold numbers, got pickled objects, which could run anything")
    with nodes.telling(path):
        return zarr.open_array(LocalStore(path, read_only=True), path=name, mode="r")


def _files(folder: Path | str) -> Iterator[os.DirEntry[str]]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                yield from _files(entry.path)
            else:
                yield entry


class _Folder(LocalStore):
    """A store whose files appear whole, and which knows those that are not yet durable.

    Until a file is whole it has a name that depends on its own alone. What a kill left under such a name vanishes when
    the same chunk is written again, as it is after every kill; names of the library's making would stay.
    """

    def __init__(self, root: Path | str, *, read_only: bool = False) -> None:
        super().__init__(root, read_only=read_only)
        self.written: set[Path] = set()
        self.turn = threading.Condition()
        self.active, self.stopped = 0, False

    async def set(self, key: str, value: Buffer) -> None:
        """Write a file."""
        await asyncio.to_thread(self.set_sync, key, value)

    async def set_if_not_exists(self, key: str, value: Buffer) -> None:
        """Write a file, unless there is one."""
        if not (self.root / key).exists():
            await self.set(key, value)

    def set_sync(self, key: str, value: Buffer) -> None:
        """Write a file."""
        with self.turn:
            if self.stopped:
                raise OSError(errno.ECANCELED, os.strerror(errno.ECANCELED), str(self.root))
            self.active += 1
        try:
            self._put(self.root / key, value)
        finally:
            with self.turn:
                self.active -= 1
                self.turn.notify_all()

    def _put(self, file: Path, value: Buffer) -> None:
        unfinished = file.with_name(file.name + ".partial")
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            unfinished.write_bytes(value.as_numpy_array().data)
            os.replace(unfinished, file)
        except OSError:
            unfinished.unlink(missing_ok=True)
            raise
        self.written.add(file)

    def stop(self) -> None:
        """Wait for the chunks that are being written, and refuse others: one of them has failed."""
        with self.turn:
            self.stopped = True
            self.turn.wait_for(lambda: self.active == 0)

    def sync(self) -> None:
        """Make durable what was written."""
        done = sorted(self.written)
        for file in done:
            handle = os.open(file, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
        for folder in {folder for file in done for folder in file.parents if folder.is_relative_to(self.root.parent)}:
            sync_folder(folder)
        self.written.difference_update(done)


def held(path: Path) -> list[str]:
    """Return the names of the arrays of numbers in a store."""
    root = nodes.node(path)
    return [] if root is not None and root.array else nodes.arrays(path, path)


def check(path: Path, inner: str | None, layout: Layout) -> None:
    """Raise ValueError if the name of the array cannot be one."""
    nodes.checked(path, inner or "")


def create(path: Path, inner: str | None, layout: Layout) -> Target:
    """Start the array under a temporary name: without compression, which makes noise little smaller."""
    name = nodes.checked(path, inner or "")
    store = _Folder(path)
    chunks = chunks_for(layout)
    with nodes.telling(path):
        zarr.create_array(
            store,
            name=name or None,
            shape=layout.full_shape,
            chunks=(1, *chunks) if layout.leading else chunks,
            dtype=layout.dtype,
            zarr_format=3,
            filters=None,
            compressors=None,
            fill_value=np.nan,
            attributes=dict(_kept(layout)),
            dimension_names=steps.dimensions(layout),
        )
    store.sync()
    return reopen(path, inner, layout, 0)


def _kept(layout: Layout) -> Iterator[tuple[str, Any]]:
    for name, value in steps.kept(layout):
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError):
            continue
        yield name, value


def reopen(path: Path, inner: str | None, layout: Layout, mark: int) -> Target:
    """Go on with an array that was started; several processes may, each with chunks of its own."""
    return _ZarrTarget(path, nodes.checked(path, inner or ""), layout)


class _ZarrTarget(Target):
    """An array that is written in whole chunks."""

    def __init__(self, path: Path, name: str, layout: Layout) -> None:
        self.path, self.layout, self.store = path, layout, _Folder(path)
        os.stat(path)  # the library would make it
        with nodes.telling(path), zarr.config.set(CONFIG):
            self.array = zarr.open_array(self.store, path=name, mode="r+")
        if (self.array.shape, self.array.dtype) != (layout.full_shape, layout.dtype):
            raise ValueError(f"{path / name} must hold {layout.full_shape} of {layout.dtype}, got {self.array}")

    def write(self, place: Place, block: Samples, times: Samples | None = None) -> None:
        """Write a region."""
        try:
            if self.layout.leading:
                self.array[(slice(0, len(block)), *place)] = block
            else:
                self.array[place] = block[0]
        except BaseException:
            self.store.stop()
            raise

    def sync(self) -> int:
        """Make durable what was written; chunks say all that is needed to go on."""
        self.store.sync()
        return 0

    def close(self) -> None:
        """Nothing is open."""
