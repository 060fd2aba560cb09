"""The calls of the ladder: cells made into arrays and arguments, and what each entry gives as rows."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

import algdiff
from covering import Cell
from ladder import KEPT, degree_of, length_of, point, samples_of, span_of
from support import design

Array = npt.NDArray[Any]
OFFSETS = {
    "f8": 1e6,
    "c16": 1e6,
    "g": 1e6,
    "f4": 1e3,
    "c8": 1e3,
    "f2": 100,
    "i1": 20,
    "u2": 30_000,
    "i8": 2**40,
    "?": 0,
}
CVAL = 2.0


class Given(NamedTuple):
    """What a cell hands over: samples as the caller holds them, and what comes with them.

    `rows` are the same samples as the library should see them, NaN where they are missing; `axis` is that of time.
    """

    x: Any
    rows: Array
    axis: int
    t: Array | None
    weights: Array | None
    gone: Array


def axis_of(shape: str) -> int:
    return {"row": 0, "first of 2": 0, "last of 2": -1, "first of 3": 0, "middle of 3": 1, "last of 3": -1}[shape]


def size_of(cell: Cell) -> tuple[int, ...]:
    """Return the shape of the samples."""
    n = samples_of(cell["samples"], *(cell[name] for name in KEPT))
    shapes = {
        "row": (n,),
        "first of 2": (n, 17),
        "last of 2": (3, n),
        "first of 3": (n, 2, 3),
        "middle of 3": (2, n, 9),
    }
    return shapes.get(cell["shape"], (2, 2, n))


def samples(cell: Cell, rng: np.random.Generator) -> Array:
    """Return the samples in their dtype."""
    dtype, shape, axis = np.dtype(cell["dtype"]), size_of(cell), axis_of(cell["shape"])
    parts = [rng.standard_normal(shape) for _ in range(2 if dtype.kind == "c" else 1)]
    whole = dtype.kind in "iub"
    parts = [np.rint(20 * np.clip(part, -4, 4)) if whole else part for part in parts]
    if cell["signal"] == "offset":
        parts = [part + OFFSETS[cell["dtype"].lstrip(">")] for part in parts]
    elif cell["signal"] == "walk":
        parts = [np.cumsum(part, axis=axis) for part in parts]
    x = parts[0] + 1j * parts[1] if len(parts) == 2 else parts[0]
    if dtype.kind == "b":
        return x > x.mean()
    if dtype.kind in "iu":
        info = np.iinfo(dtype)
        x = np.clip(x, float(max(info.min, -(2**53))), float(min(info.max, 2**53)))
    return x.astype(dtype)


def laid_out(x: Array, layout: str) -> Array:
    """Return the same numbers in another layout."""
    if layout == "F":
        return np.asfortranarray(x)
    if layout == "strided":
        wide = np.zeros((*x.shape[:-1], 2 * x.shape[-1]), x.dtype)
        wide[..., ::2] = x
        return wide[..., ::2]
    if layout == "reversed":
        return np.ascontiguousarray(x[::-1])[::-1]
    if layout == "field":
        records = np.zeros(x.shape, [("tag", "i1"), ("value", x.dtype)])
        records["value"] = x
        return records["value"]
    if layout == "misaligned":
        bytes_ = np.zeros(x.nbytes + 1, np.uint8)
        moved = bytes_[1:].view(x.dtype).reshape(x.shape)
        moved[...] = x
        return moved
    x = np.ascontiguousarray(x)
    x.flags.writeable = layout != "readonly"
    return x


def times(cell: Cell, rng: np.random.Generator, n: int) -> Array | None:
    """Return times of the samples, uneven ones by far."""
    if cell["times"] == "none":
        return None
    if cell["times"] == "uneven":
        return np.asarray(3 + cell["delta"] * np.cumsum(rng.uniform(0.6, 1.4, n)))
    t = cell["delta"] * np.arange(n, dtype=float)
    return -t if cell["times"] == "descending" else t


def given(cell: Cell, rng: np.random.Generator) -> Given:
    """Return what a cell hands over."""
    x, axis = samples(cell, rng), axis_of(cell["shape"])
    n = x.shape[axis]
    gone = np.zeros(x.shape, bool)
    if cell["missing"] != "none":
        gone = rng.random(x.shape) < rng.choice([0, 0.02])  # and one
        gone.reshape(-1)[rng.integers(gone.size)] = True
    nan = complex(np.nan, np.nan) if x.dtype.kind == "c" else np.nan
    if cell["missing"] == "nan":
        x[gone] = nan
    weights = None
    if cell["weights"] != "none":
        weights = rng.uniform(0.2, 5, x.shape if cell["weights"] == "all" else n)
        along = np.moveaxis(gone, axis, -1).reshape(-1, n).any(axis=0)
        taken = (gone if cell["weights"] == "all" else along) | (rng.random(weights.shape) >= 0.05)
        weights[~taken] = 0.0  # of samples that are there: a missing one of weight 0 is not refused
    held = laid_out(x, cell["layout"])
    seen = np.where(gone, nan, x).astype(np.complex128 if x.dtype.kind == "c" else np.float64)
    rows = np.moveaxis(seen, axis, -1).reshape(-1, n)
    masked = np.ma.MaskedArray(held, gone) if cell["missing"] == "masked" else held
    return Given(masked, rows, axis, times(cell, rng, n), weights, np.moveaxis(gone, axis, -1).reshape(-1, n))


def words(cell: Cell) -> dict[str, Any]:
    """Return the keywords of the design."""
    found = {name: cell[name] for name in ("deriv", "kappa", "mu", "rule", "trim", "engine", "delta")}
    found["degree"] = degree_of(cell["deriv"], cell["extra"])
    if cell["tau"] == "delay":
        return {**found, "delay": 1.5 * cell["delta"]}
    return {**found, "tau": cell["tau"]}


def length(cell: Cell) -> int:
    return length_of(*(cell[name] for name in ("window", "deriv", "extra", "rule")))


def tau(cell: Cell) -> float | str:
    return point(cell["tau"], length(cell), cell["rule"])


def working(cell: Cell) -> np.dtype[Any]:
    """Return the documented type of the result."""
    dtype = np.dtype(cell["dtype"])
    if dtype.kind == "c":
        return np.dtype(np.complex64 if dtype.itemsize == 8 else np.complex128)
    return np.dtype(np.float32 if dtype.kind == "f" and dtype.itemsize == 4 else np.float64)


def single(cell: Cell) -> bool:
    return working(cell) in (np.float32, np.complex64)


def _call(cell: Cell, one: Given) -> dict[str, Any]:
    found = {"mode": cell["mode"], "cval": CVAL, "nan_policy": cell["policy"], "threads": cell["threads"]}
    return {**found, "t": one.t, "weights": one.weights}


def _out(cell: Cell, one: Given, rng: np.random.Generator) -> Array | None:
    """Return a place for the result, in some layout."""
    if not cell["out"]:
        return None
    shape = list(one.x.shape)
    if cell["mode"] == "valid":
        shape[one.axis] = max(shape[one.axis] - span_of(cell) + 1, 0)
    shape = [*([len(cell["deriv"])] if isinstance(cell["deriv"], tuple) else []), *shape]
    return laid_out(np.zeros(shape, working(cell)), ("C", "F", "strided", "reversed")[rng.integers(4)])


def _differentiate(cell: Cell, one: Given, rng: np.random.Generator, _: Path) -> Any:
    out, made = _out(cell, one, rng), words(cell)
    if one.t is not None:
        del made["delta"]
    got = algdiff.differentiate(one.x, length(cell), axis=one.axis, out=out, **made, **_call(cell, one))
    assert out is None or np.shares_memory(got, out)
    return got


def _design(cell: Cell, one: Given, rng: np.random.Generator, _: Path) -> Any:
    out = _out(cell, one, rng)
    got = design(length(cell), **words(cell))(one.x, one.axis, out=out, **_call(cell, one))
    assert out is None or np.shares_memory(got, out)
    return got


def _dask(cell: Cell, one: Given, rng: np.random.Generator, _: Path) -> Any:
    from dask import array

    chunks = list(one.x.shape)
    chunks[one.axis] = int(rng.integers(1, chunks[one.axis] + 1))
    out = _out(cell, one, rng)
    lazy = array.from_array(one.x, chunks=tuple(chunks))
    got = design(length(cell), **words(cell))(lazy, one.axis, out=out, **_call(cell, one))
    return got.compute(scheduler="synchronous")


def _savgol(cell: Cell, one: Given, _rng: np.random.Generator, _: Path) -> Any:
    made = {name: cell[name] for name in ("deriv", "delta", "engine", "threads")}
    mode = "interp" if cell["mode"] == "fit" else cell["mode"]
    degree = degree_of(cell["deriv"], cell["extra"])
    return algdiff.savgol_filter(one.x, length(cell), degree, axis=one.axis, mode=mode, cval=CVAL, **made)


def _gradient(cell: Cell, one: Given, _rng: np.random.Generator, _: Path) -> Any:
    made = {name: value for name, value in words(cell).items() if name not in ("deriv", "delta")}
    call = {name: value for name, value in _call(cell, one).items() if name not in ("t", "weights")}
    spacing = cell["delta"] if one.t is None else one.t
    return algdiff.gradient(one.x, spacing, axis=one.axis, window_length=length(cell), **made, **call)


def _stream(cell: Cell, one: Given, _rng: np.random.Generator, _: Path) -> Any:
    channels = None if one.x.ndim == 1 else one.x.shape[1]
    more = {"nan_policy": cell["policy"], "threads": cell["threads"], "dtype": "f4" if single(cell) else "f8"}
    made = design(length(cell), **words(cell))
    got = made.stream(channels=channels, **more).push(one.x, one.t)
    got = np.moveaxis(got, -1 if channels is None else -2, 0)
    warming, span = got[: made.weights.shape[-1] - 1], made.weights.shape[-1]
    assert np.isnan(warming).all()
    return np.moveaxis(got[span - 1 :], 0, -1 if channels is None else -2)


def _chunks(cell: Cell, one: Given, rng: np.random.Generator, _: Path) -> Any:
    made, n = design(length(cell), **words(cell)), one.x.shape[one.axis]
    span = made.weights.shape[-1]
    outputs = max(n - span + 1, 1)  # too few samples are refused as they are
    cuts = np.unique([0, *rng.integers(1, outputs + 1, 3), outputs])
    x = np.ma.MaskedArray(one.x).swapaxes(0, one.axis) if cell["missing"] == "masked" else one.x.swapaxes(0, one.axis)
    call = {name: value for name, value in _call(cell, one).items() if name not in ("t", "weights")}
    parts = [made(x[a : b + span - 1].swapaxes(0, one.axis), one.axis, **call) for a, b in pairwise(cuts)]
    axis = one.axis % one.x.ndim + isinstance(cell["deriv"], tuple)
    joined = np.ma.concatenate(parts, axis) if cell["missing"] == "masked" else np.concatenate(parts, axis)
    if made.engine_for(working(cell)) == "direct" and cell["policy"] != "omit":
        assert np.asarray(joined).tobytes() == np.ascontiguousarray(made(one.x, one.axis, **call)).tobytes()
    return joined


def _file(cell: Cell, one: Given, _rng: np.random.Generator, folder: Path) -> Any:
    np.save(folder / "x.npy", one.x)
    call = {name: value for name, value in _call(cell, one).items() if name not in ("t", "weights")}
    more = {"axis": one.axis, "overwrite": True, **words(cell), **call}
    algdiff.differentiate_file(folder / "x.npy", folder / "y.npy", length(cell), **more)
    return np.load(folder / "y.npy")


ENTRIES: dict[str, Callable[[Cell, Given, np.random.Generator, Path], Any]] = {
    "differentiate": _differentiate,
    "design": _design,
    "dask": _dask,
    "savgol_filter": _savgol,
    "gradient": _gradient,
    "stream": _stream,
    "chunks": _chunks,
    "file": _file,
}


def by_rows(cell: Cell, one: Given, result: Any) -> Array:
    """Return a result as an array with axes over orders, rows and outputs, after a look at its type."""
    if cell["entry"] not in ("stream", "savgol_filter"):
        assert isinstance(result, np.ma.MaskedArray) == (cell["missing"] == "masked")
    if isinstance(result, np.ma.MaskedArray):
        np.testing.assert_array_equal(np.ma.getmaskarray(result), np.isnan(result.data))
        result = result.data.copy()
        result[np.isnan(result)] = complex(np.nan, np.nan) if result.dtype.kind == "c" else np.nan
    assert result.dtype == working(cell)
    several = isinstance(cell["deriv"], tuple)
    orders = len(cell["deriv"]) if several else 1
    assert result.ndim == one.x.ndim + several
    last = np.moveaxis(result, one.axis if one.axis < 0 else one.axis + several, -1)
    return (
        np.asarray(last.reshape(orders, -1, last.shape[-1]))
        if last.size
        else np.zeros((orders, len(one.rows), last.shape[-1]))
    )
