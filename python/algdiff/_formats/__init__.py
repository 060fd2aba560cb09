"""The formats of recordings: which there are, and where in a path the array inside of a file is named."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from algdiff import _refusals as refusals

if TYPE_CHECKING:
    from collections.abc import Callable

    from algdiff._formats.base import Layout, Options, Source, Target
    from algdiff._formats.stage import Stage


class Format(NamedTuple):
    """What is to be known of a format before its module is loaded.

    Attributes
    ----------
    name : str
        What it is called, and its module.
    suffixes : tuple of str
        How its files end, in lower case; the first is the usual one.
    inner : bool
        Whether a file holds arrays by name: ``file.h5:/path``.
    table : bool
        Whether it holds columns with time along the rows, and is written row after row.
    staged : bool
        Whether it cannot be written piece by piece: numbers are collected raw, and encoded in the end.
    writes : bool
        Whether it can be an output.
    needs : str
        What to install to have it.
    """

    name: str
    suffixes: tuple[str, ...]
    inner: bool = False
    table: bool = False
    staged: bool = False
    writes: bool = True
    needs: str = ""

    @property
    def module(self) -> Any:
        """The module of the format, with ``open_source``, ``check``, and ``create`` and ``reopen`` or ``encode``."""
        try:
            return import_module(f"algdiff._formats.{self.name}")
        except ImportError as error:
            if error.name != self.needs:
                raise
            files = self.suffixes[0]
            raise ImportError(
                f"{files} files need {self.needs}: pip install 'algdiff-rs[{self.name}]' ({error})"
            ) from None


FORMATS = (
    Format("npy", (".npy",)),
    Format("npz", (".npz",), staged=True),
    Format("csv", (".csv",), table=True),
    Format("raw", (".bin", ".raw", ".dat"), table=True),
    Format("hdf5", (".h5", ".hdf5"), inner=True, needs="h5py"),
    Format("zarr", (".zarr",), inner=True, needs="zarr"),
    Format("parquet", (".parquet",), table=True, staged=True, needs="pyarrow"),
    Format("audio", (".wav", ".flac"), table=True, staged=True, needs="soundfile"),
)
SUFFIXES = {suffix: form for form in FORMATS for suffix in form.suffixes}
INNER = re.compile(
    r"(?P<path>.+?(?:"
    + "|".join(re.escape(one) for form in FORMATS if form.inner for one in form.suffixes)
    + r")):(?P<inner>.*)",
    re.IGNORECASE | re.DOTALL,
)


class Located(NamedTuple):
    """A path taken apart.

    Attributes
    ----------
    given : str
        As the caller wrote it, for messages.
    path : Path
        The file, or the folder of a store.
    inner : str or None
        The array in it.
    form : Format
        Its format.
    """

    given: str
    path: Path
    inner: str | None
    form: Format


def located(name: str, path: Any) -> Located:
    """Return what `path` says: file, array in the file, format. `name` is for the error."""
    import os

    try:
        given = os.fsdecode(path)
    except TypeError:
        raise TypeError(f"{name} must be a path, got {refusals.shown(path)}") from None
    inner = None
    if match := INNER.fullmatch(given):
        given_path, inner = match["path"], match["inner"]
    else:
        given_path = given
    suffix = Path(given_path).suffix.lower()
    form = SUFFIXES.get(suffix)
    if form is None:
        *most, last = SUFFIXES
        raise ValueError(f"{name}: the suffix of {given} must be {', '.join(most)} or {last}, got {suffix!r}")
    if inner is not None and inner.strip("/") == "":
        raise ValueError(f"{name} must name an array after {given_path}:, got {given!r}")
    return Located(given, Path(given_path), inner, form)


def open_source(place: Located, options: Options) -> Source:
    """Open the array at a place for reading."""
    source: Source = place.form.module.open_source(place.path, place.inner, options)
    return source


def check(place: Located, layout: Layout) -> None:
    """Raise ValueError if the format of a place cannot hold a result, before anything is done."""
    if place.form.table:
        suffix = place.path.suffix.lower()
        if len(layout.shape) not in (1, 2):
            shape = f"one or two dimensions, got shape {layout.shape}"
            raise ValueError(f"a {suffix} OUT must have {shape}; write .npy or .npz")
        if layout.dtype.kind == "c" and place.form.name != "raw":
            raise ValueError(f"a {suffix} OUT must hold real numbers, got dtype {layout.dtype}; write .npy or .npz")
    place.form.module.check(place.path, place.inner, layout)


def check_others(place: Located) -> None:
    """Raise FileExistsError if the file at a place holds arrays that would be lost if it were replaced."""
    arrays: Callable[[Path], list[str]] | None = getattr(place.form.module, "held", None)
    if arrays is None:
        return
    own = (place.inner or "x").strip("/")
    others = [name for name in arrays(place.path) if name.strip("/") != own]
    if others:
        lost = refusals.listed(others)
        raise FileExistsError(f"{place.given}: the file holds other arrays, which would be lost ({lost}): use another")


def create(place: Located, path: Path, layout: Layout) -> Target:
    """Start a result for a place under a temporary path; of staged formats, its stage."""
    if place.form.staged:
        return _stage(place, path, layout)
    target: Target = place.form.module.create(path, place.inner, layout)
    return target


def reopen(place: Located, path: Path, layout: Layout, mark: int) -> Target:
    """Go on with a result that was started; `mark` is what `Target.sync` returned."""
    if place.form.staged:
        return _stage(place, path, layout)
    target: Target = place.form.module.reopen(path, place.inner, layout, mark)
    return target


def _stage(place: Located, path: Path, layout: Layout) -> Stage:
    from algdiff._formats.stage import Stage

    return Stage(path, layout, table=place.form.table)


def encode(place: Located, stage: Stage, path: Path, layout: Layout) -> None:
    """Write a staged result in its format under a temporary path."""
    place.form.module.encode(stage, path, place.inner, layout)


def grain(place: Located, layout: Layout) -> tuple[int, ...] | None:
    """Return the chunks of one order in which a place is written, if it is written in chunks."""
    chunks: Callable[[Layout], tuple[int, ...]] | None = getattr(place.form.module, "chunks_for", None)
    return None if chunks is None else chunks(layout)
