"""What callers hand over, made into what the core takes, or refused by name."""

import math
import operator
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from algdiff._refusals import LONGEST, SAMPLES, has_units, named, shown, units_of

Samples = NDArray[Any]
Progress = Callable[[float], object]

MAX_WINDOW = 10_000_000
"""The longest window that the core takes."""

LARGEST = 1 << 30
"""Bytes of a dataset in a file that are loaded without asking."""


def integer(name: str, value: object, least: int) -> int:
    """Return `value` as an integer of at least `least`."""
    try:
        if isinstance(value, (bool, np.bool_)):
            raise TypeError
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise TypeError(refused(name, value, "an integer")) from None
    if number < least:
        raise ValueError(f"{name} must be an integer of at least {least}, got {shown(number)}")
    if number > sys.maxsize:
        raise ValueError(f"{name} must be at most {sys.maxsize}, got {shown(number)}")
    return number


def real(name: str, value: object) -> float:
    """Return `value` as a float."""
    try:
        if isinstance(value, (str, bytes, bool, np.ma.MaskedArray)) or (
            hasattr(value, "dtype") and value.dtype.kind not in "fiu"
        ):
            raise TypeError
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise TypeError(refused(name, value, "a real number")) from None


def refused(name: str, value: object, allowed: str) -> str:
    """Return what to say of a value of the wrong type."""
    return units_of(name, value) if has_units(value) else f"{name} must be {allowed}, got {shown(value)}"


def level(name: str, value: object) -> float:
    """Return a standard deviation."""
    number = real(name, value)
    if not (math.isfinite(number) and number >= 0):
        raise ValueError(f"{name} must be finite and not negative, got {number}")
    return number


def number(name: str, value: object) -> complex:
    """Return `value` as a complex number."""
    return complex(value) if isinstance(value, (complex, np.complexfloating)) else complex(real(name, value))


def word_or_real(name: str, value: object) -> str | float:
    """Return a word as it is and anything else as a float."""
    allowed = "a word such as 'center' or a real number"
    try:
        if not isinstance(value, str):
            return real(name, value)
    except TypeError:
        raise TypeError(refused(name, value, allowed)) from None
    return word(name, value, allowed)


def sampling_step(delta: object, fs: object) -> float:
    """Return the sampling step from at most one of `delta` and `fs`."""
    if fs is None:
        return 1.0 if delta is None else real("delta", delta)
    if delta is not None:
        raise ValueError(f"give delta or fs, not both: got {named(delta=delta, fs=fs)}")
    rate = real("fs", fs)
    if not (0 < rate < float("inf") and 1.0 / rate < float("inf")):
        raise ValueError(f"fs must be finite and positive, got {rate}")
    return 1.0 / rate


def axis_index(axis: object, ndim: int) -> int:
    """Return `axis` counted from the front."""
    try:
        if isinstance(axis, (bool, np.bool_)):
            raise TypeError
        index = operator.index(axis)  # type: ignore[arg-type]
    except TypeError:
        raise TypeError(f"axis must be an integer, got {shown(axis)}") from None
    if not -ndim <= index < ndim:
        raise ValueError(f"axis must be from {-ndim} to {ndim - 1} for {ndim} dimensions, got {shown(index)}")
    return index % ndim


def signal(name: str, values: ArrayLike) -> Samples:
    """Return `values` as an array of numbers of any type and layout, in place if they are one."""
    array = plain(name, values)
    if array.dtype.kind not in "fiubc":
        raise TypeError(f"{name} must hold real or complex numbers, got dtype {array.dtype}")
    if array.ndim == 0:
        raise ValueError(f"{name} must have at least one dimension, got a scalar")
    return array


def samples(name: str, values: ArrayLike) -> Samples:
    """Return `values` as a native array of float32, float64, complex64 or complex128."""
    array = signal(name, values)
    return array.astype(working_dtype(array.dtype), copy=False)


def unmasked(name: str, values: ArrayLike) -> Samples:
    """Return `values` as `signal` does, with NaN where they are masked."""
    if not isinstance(values, np.ma.MaskedArray) or not np.ma.is_masked(values):
        return signal(name, np.ma.getdata(values) if isinstance(values, np.ma.MaskedArray) else values)
    array = signal(name, np.ma.getdata(values))
    array = array.astype(working_dtype(array.dtype))
    array[np.ma.getmaskarray(values)] = np.nan
    return array


def remasked(values: ArrayLike, result: Samples) -> Samples:
    """Return `result`, with a mask where it is NaN if `values` have one."""
    return np.ma.MaskedArray(result, np.isnan(result)) if isinstance(values, np.ma.MaskedArray) else result


def working_dtype(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return the type that samples are worked on in: float32 and complex64 stay what they are."""
    if dtype.kind == "c":
        return np.dtype(np.complex64 if dtype.itemsize == 8 else np.complex128)
    return np.dtype(np.float32 if dtype.kind == "f" and dtype.itemsize == 4 else np.float64)


def any_dtype(name: str, dtype: DTypeLike) -> np.dtype[Any]:
    """Return a type as NumPy's."""
    try:
        return np.dtype(dtype)
    except (TypeError, ValueError, SyntaxError):  # words are parsed, and may be anything
        raise TypeError(f"{name} must be a type of numbers like 'float32', got {shown(dtype)}") from None


def real_dtype(name: str, dtype: DTypeLike) -> np.dtype[Any]:
    """Return float64 or float32 as NumPy's."""
    real: np.dtype[Any] | None = None
    with suppress(TypeError):
        real = any_dtype(name, dtype)
    if real not in (np.float64, np.float32):
        raise TypeError(f"{name} must be float64 or float32, got {shown(dtype)}")
    return np.dtype(real.name)


def plain(name: str, values: ArrayLike) -> Samples:
    """Return `values` as an array of any dtype; refuse what would lose a mask or a unit."""
    if isinstance(values, np.ma.MaskedArray):
        if np.ma.is_masked(values):
            gone = np.ma.getmaskarray(values).sum()
            raise TypeError(f"{name} must have no masked values, got {gone}: fill them, or pass what lies between them")
        values = np.ma.getdata(values)
    kind = type(values)
    if is_lazy(values):
        raise TypeError(f"{name} is lazy and would be computed whole: {_lazily(name, kind)}")
    if kind.__module__.partition(".")[0] in ("h5py", "zarr") and getattr(values, "nbytes", 0) > LARGEST:
        raise ValueError(
            f"{name} would be loaded whole, {getattr(values, 'nbytes', 0) / 2**30:.3g} GiB of it: take "
            "algdiff.differentiate_file, or a part of it"
        )
    if has_units(values):
        raise TypeError(units_of(name, values))
    if isinstance(values, str):
        raise TypeError(f"{name} must be an array of numbers, got {shown(values)}: pass the values, not a name")
    try:
        array = np.asarray(values)
    except ValueError as error:
        why = str(error).partition(". ")[0].rstrip(".")
        raise ValueError(f"{name} must be an array of numbers, got {shown(values)}: {why}") from None
    return array


def _lazily(name: str, kind: type) -> str:
    """Return what to do with a lazy argument."""
    if name not in SAMPLES:
        return f"pass {name}.compute(), or give lazy samples, too"
    where = "algdiff.xarray.differentiate" if kind.__module__.startswith("xarray") else "algdiff.differentiate"
    return f"give it to {where}, or pass {name}.compute()"


def is_lazy(values: object) -> bool:
    """Return whether `values` are computed by Dask when they are needed; an xarray in memory also has the method."""
    graph = getattr(type(values), "__dask_graph__", None)
    return graph is not None and values.__dask_graph__() is not None  # type: ignore[attr-defined]


def points(name: str, values: ArrayLike) -> tuple[Samples, tuple[int, ...]]:
    """Return `values` as a flat float64 array, and their shape."""
    array = plain(name, values)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{name} must be real numbers, got dtype {array.dtype}")
    with np.errstate(over="ignore"):
        return contiguous(array.astype(np.float64, copy=False)), array.shape


def word(name: str, value: object, allowed: str) -> str:
    """Return a word as it is."""
    if not isinstance(value, str):
        raise TypeError(f"{name} must be {allowed}, got {shown(value)}")
    if not _is_word(value):
        raise ValueError(f"{name} must be {allowed}, got {shown(value)}")
    return value


def _is_word(value: str) -> bool:
    """Return whether messages may quote a word as it is."""
    return value.isprintable() and len(value) <= LONGEST


def contiguous(array: Samples) -> Samples:
    """Return `array` flat, contiguous and aligned, copied only if it is not so already."""
    return np.require(array, requirements=["C", "A"]).reshape(-1)


def check_output(out: object, shape: tuple[int, ...], dtype: DTypeLike, x: Samples) -> Samples:
    """Return `out` if the result can be written to it."""
    if not isinstance(out, np.ndarray):
        raise TypeError(f"out must be an array, got {type(out).__name__}")
    if out.shape != shape:
        raise ValueError(f"out must have shape {shape}, got {out.shape}")
    if out.dtype != dtype:
        raise TypeError(f"out must have dtype {np.dtype(dtype)}, got {out.dtype}")
    if not out.flags.writeable:
        raise ValueError("out must be writeable, got a read-only array")
    if out.size and any(step == 0 and size > 1 for step, size in zip(out.strides, out.shape, strict=True)):
        raise ValueError("out must have a place for every element, got a broadcast array")
    if np.may_share_memory(out, x):
        raise ValueError("out must not overlap x, got arrays that may share memory")
    return out
