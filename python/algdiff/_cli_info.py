"""``algdiff info``: what a file holds, and how to differentiate it."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from algdiff import _formats as formats
from algdiff import _units as units
from algdiff._cli import UsageError
from algdiff._cli_run import add_reading, reading
from algdiff._places import MEMORY
from algdiff._refusals import printed

if TYPE_CHECKING:
    import argparse

    from algdiff._formats.base import Options, Source

Array = tuple[str, tuple[int, ...], str]
"""Name, shape and type of an array in a file."""
WINDOW = 101
LEAST = 5
"""The window of the suggestion, and the shortest one that is worth one."""
SHOWN = 50
"""Arrays that are listed, at most."""
INFO = """Say what a file holds: format, shape, type, the axis of time, channels and the sampling step, and how it would
be differentiated. Of a file with several arrays, list them; name one after a colon, or with --key, for more."""


def add(verb: argparse.ArgumentParser) -> None:
    """Add the options of ``algdiff info``."""
    verb.description = INFO
    verb.set_defaults(verb=run)
    verb.add_argument("source", metavar="FILE", help="a file, or an array in it: file.h5:/group/x")
    add_reading(verb)
    verb.add_argument("--json", action="store_true", help="print JSON instead of the table")


def run(options: argparse.Namespace) -> None:
    """Print what there is to be said."""
    try:
        place = formats.located("FILE", options.source)
    except ValueError as error:
        raise UsageError(error) from None
    how = replace(reading(options), memory=MEMORY)
    arrays = [] if place.inner is not None or how.key is not None else _arrays(place)
    if len(arrays) > 1:
        known: dict[str, Any] = {
            "file": place.given,
            "format": place.form.name,
            "count": len(arrays),
            "arrays": arrays[:SHOWN],
        }
    else:
        known = _described(place, how, options)
    print(json.dumps(known, indent=1, allow_nan=False) if options.json else printed(_table(known)))


def _described(place: formats.Located, how: Options, options: argparse.Namespace) -> dict[str, Any]:
    """Return what is known of one array."""
    from algdiff import _arguments as arguments

    with formats.open_source(place, how) as source:
        if not source.shape:
            raise ValueError(f"{place.given}: must hold samples, got a single number")
        axis = arguments.axis_index(source.axis if options.axis is None else options.axis, len(source.shape))
        samples = source.shape[axis]
        step = source.step_along(axis)
        return {
            "file": place.given,
            "format": place.form.name,
            "shape": list(source.shape),
            "dtype": source.dtype.name,
            "bytes": math.prod(source.shape) * source.dtype.itemsize,
            "axis": axis,
            "samples": samples,
            "channels": math.prod(source.shape) // samples if samples else 0,
            "delta": step,
            "columns": None if source.names is None else list(source.names),
            "time": source.time,
            "chunks": None if source.chunks is None else list(source.chunks),
            "suggestion": _suggestion(place, how, source, axis, step, options),
        }


def _suggestion(
    place: formats.Located, how: Options, source: Source, axis: int, step: float | None, options: argparse.Namespace
) -> dict[str, Any] | None:
    """Return a command that differentiates the array, and what it will take; None if there is none."""
    from algdiff import Differentiator, _file
    from algdiff._file_job import Job, Spec

    window = min(WINDOW, source.shape[axis] - 1 + source.shape[axis] % 2)
    if window < LEAST:
        return None
    path = place.path
    suffix = path.suffix if place.form.writes and path.suffix.lower() != ".flac" else ".wav"
    out = path.with_name(f"{path.stem}_d1{suffix}")
    design = Differentiator(window, delta=1.0 if step is None else step)
    try:
        target = formats.located("dst", out)
        job = Job(source, Spec(place, target, how, design, axis, "fit", 0.0, step is not None, MEMORY))
    except ValueError:
        return None
    return {
        "command": _command(place.given, str(out), window, step, options),
        "blocks": len(job.cuts),
        "memory": job.cuts.bytes,
        "seconds": _file._estimate(job, None),
    }


def _command(source: str, target: str, window: int, step: float | None, options: argparse.Namespace) -> str:
    import shlex

    words = ["algdiff", "run", source, target, "--window", str(window)]
    if step is None:
        words += ["--fs", "HZ"]
    for name in ("axis", "key", "time", "dtype", "channels", "offset"):
        if getattr(options, name) not in (None, 0):
            words += [f"--{name}", str(getattr(options, name))]
    if options.columns is not None:
        words += ["--columns", ",".join(options.columns)]
    return shlex.join(words)


def _arrays(place: formats.Located) -> list[dict[str, Any]]:
    """Return the arrays of a file that holds arrays by name."""
    listing = {"npz": _of_npz, "hdf5": _of_hdf5, "zarr": _of_zarr}.get(place.form.name)
    if listing is None:
        return []
    # What cannot be listed cannot be opened, either, which says it better; libraries raise whatever they like.
    with suppress(Exception):
        return [{"name": name, "shape": list(shape), "dtype": dtype} for name, shape, dtype in listing(place)]
    return []


def _of_npz(place: formats.Located) -> list[Array]:
    import zipfile

    from algdiff._formats.npy import any_header

    arrays = []
    with zipfile.ZipFile(place.path) as archive:
        for name in archive.namelist():
            if name.endswith(".npy"):
                with archive.open(name) as member:
                    shape, _, dtype = any_header(member)
                    arrays.append((name.removesuffix(".npy"), shape, str(dtype)))
    return arrays


def _of_hdf5(place: formats.Located) -> list[Array]:
    h5py = place.form.module.h5py
    arrays: list[Array] = []

    def note(name: str, found: Any) -> None:
        if isinstance(found, h5py.Dataset):
            arrays.append((f"/{name}", found.shape or (), str(found.dtype)))

    with h5py.File(place.path, "r") as file:
        file.visititems(note)
    return arrays


def _of_zarr(place: formats.Located) -> list[Array]:
    zarr = place.form.module.zarr
    found = zarr.open(place.path, mode="r")
    if not isinstance(found, zarr.Group):
        return []
    members = found.members(max_depth=None)
    return sorted((f"/{name}", one.shape, str(one.dtype)) for name, one in members if isinstance(one, zarr.Array))


def _table(known: dict[str, Any]) -> str:
    if "arrays" in known:
        return _list(known)
    delta, suggestion = known["delta"], known["suggestion"]
    shape = " x ".join(map(str, known["shape"]))
    lines = [
        known["file"],
        f"format      {known['format']}" + (f", in chunks of {known['chunks']}" if known["chunks"] else ""),
        f"shape       {shape} {known['dtype']}, {units.scaled(known['bytes'], 'B')}",
        f"time        axis {known['axis']}, {known['samples']} samples"
        + (f", in {known['time']}" if known["time"] else ""),
        f"channels    {known['channels']}" + (f" ({', '.join(known['columns'])})" if known["columns"] else ""),
        "step        not in the file: give --fs or --delta"
        if delta is None
        else f"step        {delta:g} s ({units.scaled(1 / delta, 'Hz')}), from the file",
    ]
    if suggestion is not None:
        lines += [
            f"to run      {suggestion['command']}",
            f"blocks      {suggestion['blocks']}, with {units.scaled(suggestion['memory'], 'B')} of buffers",
            f"time        about {suggestion['seconds']:.2g} s",
        ]
    return "\n".join(lines)


def _list(known: dict[str, Any]) -> str:
    arrays = known["arrays"]
    join = "" if known["format"] == "npz" else f"{known['file']}:"
    width = max(len(one["name"]) for one in arrays) + len(join)
    rows = [
        f"{join + one['name']:<{width}}  {' x '.join(map(str, one['shape'])):<12}  {one['dtype']}" for one in arrays
    ]
    more = known["count"] - len(arrays)
    how = "--key NAME" if known["format"] == "npz" else "its name after a colon"
    return "\n".join(
        (
            f"{known['file']}",
            f"format      {known['format']}, {known['count']} arrays: give {how} for one of them",
            *rows,
            *([f"and {more} more"] if more else []),
        )
    )
