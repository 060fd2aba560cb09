"""The metadata of Zarr stores: which arrays there are, of which types, and what is said of them."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from algdiff._formats import steps
from algdiff._refusals import told

NUMBERS = re.compile(r"bool|u?int(8|16|32|64)|float(16|32|64)|complex(64|128)")
"""Types of numbers in format 3, as NumPy calls them too."""

FILES = ("zarr.json", ".zarray", ".zgroup", ".zattrs")
"""Names of the files that hold metadata, and of no array."""


class Node(NamedTuple):
    """An array or a group, as its metadata say.

    Attributes
    ----------
    array : bool
        Whether it is an array.
    dtype : numpy.dtype or None
        Its type, if it is one of numbers or times.
    dimensions : list or None
        Names of the dimensions.
    attributes : dict
        All others.
    pickles : bool
        Whether its codecs would run what the chunks say.
    """

    array: bool
    dtype: np.dtype[Any] | None
    dimensions: list[Any] | None
    attributes: dict[str, Any]
    pickles: bool

    @property
    def numeric(self) -> bool:
        """Whether it is an array of numbers."""
        return self.dtype is not None and self.dtype.kind in "biufc"


def node(folder: Path) -> Node | None:
    """Return what the metadata in a folder say, None if there are none."""
    with telling(folder):
        for name in FILES[:3]:
            said = _json(folder / name)
            if said is not None:
                three = name == "zarr.json"
                attributes = said.get("attributes", {}) if three else _json(folder / ".zattrs") or {}
                array = said["node_type"] == "array" if three else name == ".zarray"
                dimensions = attributes.pop(steps.DIMENSIONS, None)
                dimensions = said.get("dimension_names", dimensions) if three else dimensions
                dtype = _dtype(said["data_type"] if three else said["dtype"]) if array else None
                codecs = [said.get(key) for key in ("codecs", "filters", "compressor")]
                return Node(array, dtype, dimensions, dict(attributes), "pickle" in json.dumps(codecs).lower())
    return None


def _json(file: Path) -> Any:
    try:
        return json.loads(file.read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        return None


def _dtype(said: Any) -> np.dtype[Any] | None:
    """Return the type of numbers or times that metadata name; None of any other."""
    if isinstance(said, dict) and said.get("name") in ("numpy.datetime64", "numpy.timedelta64"):
        how = said["configuration"]
        return np.dtype(f"{said['name'].removeprefix('numpy.')}[{int(how['scale_factor'])}{how['unit']}]")
    if not isinstance(said, str) or not (NUMBERS.fullmatch(said) or said[:1] in "<>|"):
        return None
    try:
        dtype = np.dtype(said)
    except TypeError:
        return None
    return dtype if dtype.kind in "biufcmM" else None


@contextmanager
def telling(path: Path) -> Iterator[None]:
    """Let whatever libraries raise of a broken store name it in one line; errors of the system and our own pass."""
    try:
        yield
    except (OSError, MemoryError):
        raise
    except Exception as error:
        if isinstance(error, ValueError) and str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: not a whole Zarr store ({told(error)})") from None


def split(name: str) -> list[str]:
    """Return the groups on the way to an array, and what it is called in the last."""
    return [part for part in name.split("/") if part]


def checked(path: Path, name: str) -> str:
    """Return the name of an array or a group as Zarr knows it."""
    for part in split(name):
        odd = not part.strip(".") or part.startswith("__") or not part.isprintable() or "\\" in part
        if odd or part in FILES:
            raise ValueError(f"{path}: an array must have a printable name that is none of Zarr's own, got {name!r}")
    return "/".join(split(name))


def only(path: Path) -> str:
    """Return the name of the only array of numbers; what is only the coordinate of a dimension does not count."""
    root = node(path)
    if root is not None and root.array:
        return ""
    found = arrays(path, path)
    if len(found) == 1:
        return found[0]
    if not found:
        raise ValueError(f"{path}: must be a Zarr store with an array of numbers, got none")
    raise ValueError(f"{path}: must be given with one of its arrays, as in {_shown(path, found)}")


def _shown(path: Path, names: list[str]) -> str:
    return steps.shown(path, [f"/{name}" for name in names])


def held(path: Path, folder: Path) -> str:
    """Return the names of the arrays of numbers in a group, for errors."""
    found = arrays(path, folder)
    return _shown(path, found) if found else "no array of numbers"


def arrays(path: Path, folder: Path) -> list[str]:
    """Return the names of the arrays of numbers in a group, as far as they need to be known."""
    found: list[str] = []
    coordinates: list[str] = []
    todo = [folder]
    while todo and len(found) <= 10:
        here = todo.pop()
        said = node(here)
        if said is None or not said.array:
            with os.scandir(here) as entries:
                inside = sorted((entry.path for entry in entries if entry.is_dir(follow_symlinks=False)), reverse=True)
            todo += map(Path, inside)
        elif said.numeric:
            (coordinates if said.dimensions == [here.name] else found).append(here.relative_to(path).as_posix())
    return found or coordinates
