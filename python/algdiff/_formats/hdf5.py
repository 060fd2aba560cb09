"""HDF5: arrays by name, in one piece or in chunks; written in one piece, whose place is known from the beginning."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from algdiff._formats import steps
from algdiff._formats.base import Layout, Options, Place, Samples, Source, Target
from algdiff._formats.regions import InPlace, Region

CACHE = 32 << 20
"""Bytes of chunks that are kept between regions, which overlap: more only if one compressed chunk has more."""

LINKS = 16
"""Soft links that are followed on the way to an array, and how deep parts may lie within parts."""

RANK = 32
"""Dimensions that HDF5 can hold."""

UNWRITTEN = "This is a netCDF dimension but not a netCDF variable"
"""How the attribute NAME of a scale without numbers begins."""

DEFAULT = "/x"
"""The name of an output for which none is given."""


def open_source(path: Path, inner: str | None, options: Options) -> Source:
    """Open a dataset for reading."""
    return Hdf5Source(path, inner)


class Hdf5Source(Source):
    """A dataset of an HDF5 file."""

    def __init__(self, path: Path, inner: str | None) -> None:
        with _telling(path):
            super().__init__(path, _opened(path))
        try:
            with _telling(path):
                self.name = _only(self.file, path) if inner is None else _resolved(self.file, path, inner)
                _check(self.file, path, self.name, {})
                self.dataset = _cached(self.file, self.name)
                self.shape, self.dtype, self.chunks = self.dataset.shape, self.dataset.dtype, self.dataset.chunks
                self.attributes = _attributes(self.dataset)
                steps.check_packed(f"{path}:{self.name}", self.attributes, self.dtype)
                names = _dimensions(self.dataset)
                if all(names):
                    self.attributes[steps.DIMENSIONS] = names
        except BaseException:
            self.file.close()
            raise

    def read(self, place: Place, out: Samples) -> None:
        """Fill `out`."""
        if out.size:
            with _telling(self.path):
                self.dataset.read_direct(out, place)

    def step_along(self, axis: int) -> float | None:
        """Return the step that the attributes of the dataset or of a group around it state, or the scale of an axis."""
        with _telling(self.path):
            parts = self.name.strip("/").split("/")
            for length in range(len(parts), -1, -1):
                name = "/" + "/".join(parts[:length])
                step = steps.stated(f"{self.path}:{name}", _attributes(self.file[name]))
                if step is not None:
                    return step
            return self._step_of_scale(axis)

    def _step_of_scale(self, axis: int) -> float | None:
        dims = self.dataset.dims[axis]
        for scale in (dims[index] for index in range(len(dims))):
            attributes = _attributes(scale)
            if _fault(scale) is not None or str(attributes.get("NAME")).startswith(UNWRITTEN):
                continue
            _check(self.file, self.path, scale.name, {})
            coordinate = steps.Coordinate(
                scale.name, scale.shape, scale.dtype, attributes.get("units"), scale.__getitem__
            )
            step = steps.along(self.path, coordinate, self.shape[axis])
            if step is not None:
                return step
        return None


def _opened(path: Path) -> h5py.File:
    open(path, "rb").close()  # of what cannot be opened, errors of the system say more
    return h5py.File(path, "r")


@contextmanager
def _telling(path: Path) -> Iterator[None]:
    """Let errors of the library name the file in one line; errors of the system and our own pass."""
    try:
        yield
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        if isinstance(error, ValueError) and str(error).startswith(str(path)):
            raise
        if isinstance(error, OSError) and error.errno is not None and not isinstance(error, BlockingIOError):
            if error.filename is not None:
                raise
            raise type(error)(error.errno, error.strerror or str(error), str(path)) from None
        said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        said = " ".join(said.split())
        inside = re.search(r"\((.*)\)", said)
        raise ValueError(f"{path}: not a whole HDF5 file ({inside[1] if inside else said})") from None


def _only(file: h5py.File, path: Path) -> str:
    """Return the name of the only dataset of numbers; what is only the scale of a dimension does not count."""
    found = _datasets(file)
    if len(found) == 1:
        return found[0]
    if not found:
        raise ValueError(f"{path}: must hold a dataset of numbers, got none")
    raise ValueError(f"{path}: must be given with one of its datasets, as in {steps.shown(path, found)}")


def _datasets(group: h5py.Group) -> list[str]:
    """Return the names of the datasets of numbers in a group, as far as they need to be known."""
    found: list[str] = []
    scales: list[str] = []

    def visit(_: str, member: Any) -> bool | None:
        if isinstance(member, h5py.Dataset) and isinstance(member.name, str) and _fault(member) is None:
            (scales if h5py.h5ds.is_scale(member.id) else found).append(member.name)
        return True if len(found) > 10 else None

    group.visititems(visit)
    return found or scales


def _parts(name: str) -> list[str]:
    return [part for part in name.split("/") if part not in ("", ".")]


def _resolved(file: h5py.File, path: Path, name: str) -> str:
    """Return the name of an object without soft links; refuse links to other files, which would be read."""
    todo, done, links = _parts(name)[::-1], list[str](), 0
    while todo:
        part, group = todo.pop(), file["/" + "/".join(done)]
        if not isinstance(group, h5py.Group) or not group.id.links.exists(part.encode()):
            raise ValueError(f"{path}: must hold {name}, got {_held(file, path)}")
        kind = group.id.links.get_info(part.encode()).type
        if kind == h5py.h5l.TYPE_HARD:
            done.append(part)
            continue
        if kind != h5py.h5l.TYPE_SOFT or links == LINKS:
            what = "links" if kind == h5py.h5l.TYPE_SOFT else "a link to another file"
            raise ValueError(f"{path}:{name} must be in the file itself, got {what} at {part!r}")
        links += 1
        target = group.id.links.get_val(part.encode()).decode()
        done = [] if target.startswith("/") else done
        todo += _parts(target)[::-1]
    return "/" + "/".join(done)


def _held(file: h5py.Group, path: Path) -> str:
    found = _datasets(file)
    return steps.shown(path, found) if found else "no dataset of numbers"


def _fault(dataset: h5py.Dataset) -> str | None:
    """Return why a dataset is no array of numbers, if it is none."""
    if not dataset.shape:
        return "no dataspace" if dataset.shape is None else "a single value"
    try:
        dtype = dataset.dtype
    except (TypeError, ValueError) as error:
        return str(error)
    if h5py.check_enum_dtype(dtype) is not None:
        return "names of an enumeration"
    return None if dtype.kind in "biufc" else f"dtype {dtype}"


def _check(file: h5py.File, path: Path, name: str, depths: dict[str, int]) -> int:
    """Raise ValueError unless an object is a dataset of numbers that lies in the file, with all its parts.

    Returns, and notes in `depths`, how deep parts lie within parts. The library follows them without looking where: it
    overflows the stack of the process if they are deep, or made of themselves.
    """
    found = file[name]
    if isinstance(found, h5py.Group):
        raise ValueError(f"{path}:{name} must be a dataset, got a group that holds {_held(found, path)}")
    if not isinstance(found, h5py.Dataset):
        raise ValueError(f"{path}:{name} must be a dataset, got a type")
    fault = _fault(found)
    if fault is not None:
        raise ValueError(f"{path}:{name} must be an array of real or complex numbers, got {fault}")
    if found.external is not None:
        raise ValueError(f"{path}:{name} must be in the file itself, got numbers in {found.external[0][0]}")
    depth, depths[name] = 0, LINKS  # whatever leads back here is too deep
    for source in found.virtual_sources() if found.is_virtual else ():
        if source.file_name != ".":
            raise ValueError(f"{path}:{name} must be in the file itself, got parts in {source.file_name}")
        part = _resolved(file, path, source.dset_name)
        depth = max(depth, 1 + (depths[part] if part in depths else _check(file, path, part, depths)))
        if depth > LINKS:
            raise ValueError(f"{path}:{name} must be made of parts at most {LINKS} deep, got deeper ones at {part}")
    depths[name] = depth
    return depth


def _cached(file: h5py.File, name: str) -> h5py.Dataset:
    """Return a dataset with a cache for the chunks at the ends of regions."""
    dataset = file[name]
    if dataset.chunks is None:
        return dataset
    nbytes = dataset.dtype.itemsize * int(np.prod(dataset.chunks, dtype=np.int64))
    size = max(CACHE, nbytes if dataset.id.get_create_plist().get_nfilters() else 0)
    dataset.id.close()  # only who opens it first says how
    access = h5py.h5p.create(h5py.h5p.DATASET_ACCESS)
    access.set_chunk_cache(10007, size, 0.75)
    return h5py.Dataset(h5py.h5d.open(file.id, name.encode(), access))


def _attributes(found: h5py.HLObject) -> dict[str, Any]:
    """Return the attributes that are text and numbers, and no part of the format."""
    values = {}
    for name in found.attrs:
        with suppress(OSError, RuntimeError, KeyError, TypeError, ValueError):
            if found.attrs.get_id(name).get_storage_size() <= steps.MOST:
                values[name] = steps.plain(found.attrs[name])
    own = ("CLASS", "DIMENSION_LABELS", "DIMENSION_LIST", "REFERENCE_LIST")
    return {
        name: value
        for name, value in values.items()
        if value is not None and name not in own and not name.startswith("_Netcdf4")
    }


def _dimensions(dataset: h5py.Dataset) -> list[str]:
    """Return the names of the dimensions: their labels, or those of their scales; "" of what has no name."""
    names = []
    for dims in dataset.dims:
        scales = dims.keys() if not dims.label else []
        names.append(dims.label or (str(scales[0]) if scales else ""))
    return names


def held(path: Path) -> list[str]:
    """Return the names of the datasets of numbers in a file; of what is none, nothing."""
    try:
        with h5py.File(path, "r") as file:
            return _datasets(file)
    except OSError:
        return []


def check(path: Path, inner: str | None, layout: Layout) -> None:
    """Raise ValueError if HDF5 cannot hold that."""
    if len(layout.full_shape) > RANK:
        raise ValueError(f"{path}: an HDF5 file holds at most {RANK} dimensions, got {len(layout.full_shape)}")
    name = DEFAULT if inner is None else inner
    if not _parts(name) or not name.isprintable():
        raise ValueError(f"{path}: the name of a dataset must be printable and not empty, got {name!r}")


def create(path: Path, inner: str | None, layout: Layout) -> Target:
    """Start the dataset under a temporary name."""
    *groups, name = _parts(DEFAULT if inner is None else inner)
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    # In one piece, at a place that is known now; space that is not written stays empty.
    how.set_layout(h5py.h5d.CONTIGUOUS)
    how.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    how.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    space = h5py.h5s.create_simple(layout.full_shape)
    numbers = h5py.h5t.py_create(layout.dtype, logical=True)
    with _telling(path), h5py.File(path, "w") as file:
        group = file.require_group("/" + "/".join(groups))
        dataset = h5py.Dataset(h5py.h5d.create(group.id, name.encode(), numbers, space, how))
        for key, value in steps.kept(layout):
            # What HDF5 cannot hold, as nested data, is left out.
            with suppress(TypeError, ValueError, OSError, RuntimeError):
                dataset.attrs[key] = value
        for axis, label in enumerate(steps.dimensions(layout) or []):
            dataset.dims[axis].label = label
    return reopen(path, inner, layout, 0)


def reopen(path: Path, inner: str | None, layout: Layout, mark: int) -> Target:
    """Go on with a dataset that was started. The library is not needed for that: a kill cannot harm its structures."""
    with _telling(path), _opened(path) as file:
        name = "/" + "/".join(_parts(DEFAULT if inner is None else inner))
        dataset = file[name]
        if (dataset.shape, dataset.dtype, dataset.chunks) != (layout.full_shape, layout.dtype, None):
            raise ValueError(
                f"{path}:{name} must hold {layout.full_shape} of {layout.dtype} in one piece, got {dataset}"
            )
        offset = dataset.id.get_offset()
    return InPlace(path, Region(layout.full_shape, layout.dtype, offset or 0, fortran=False), layout.leading)
