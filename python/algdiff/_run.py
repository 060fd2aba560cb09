"""One call of a bank: axis, dtype, layout and memory on this side, samples on the other."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._core import Bank

MODES = ("fit", "valid", "nan", "nearest", "mirror", "wrap", "constant")

Progress = Callable[[float], object]


def run(
    bank: Bank,
    window_length: int,
    x: ArrayLike,
    *,
    axis: int = -1,
    mode: str = "fit",
    cval: complex = 0.0,
    half_sample: bool = False,
    out: Samples | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Samples:
    """Apply `bank` along `axis` of `x`; complex data are two real passes."""
    given = x
    x = arguments.samples("x", x)
    axis = arguments.axis_index(axis, x.ndim)
    if not isinstance(mode, str):
        raise TypeError(f"mode must be a word, one of {', '.join(map(repr, MODES))}, got {mode!r}")
    length = max(x.shape[axis] + 1 - window_length, 0) if mode == "valid" else x.shape[axis]
    result = arguments.output(out, (*x.shape[:axis], length, *x.shape[axis + 1 :]), x.dtype, np.asanyarray(given))
    layout = (math.prod(x.shape[:axis]), x.shape[axis], math.prod(x.shape[axis + 1 :]))
    options: dict[str, Any] = {
        "half_sample": half_sample,
        "threads": arguments.thread_count(threads),
        "progress": progress,
    }
    if x.dtype.kind == "c":
        cval = arguments.number("cval", cval)
        result.real = _pass(bank, x.real, result.shape, layout, mode, cval.real, options)
        result.imag = _pass(bank, x.imag, result.shape, layout, mode, cval.imag, options)
        return result
    cval = arguments.real("cval", cval)
    if result.flags.c_contiguous and result.flags.aligned:
        bank.run(arguments.contiguous(x), result.reshape(-1), layout, mode, cval, **options)
    else:
        result[...] = _pass(bank, x, result.shape, layout, mode, cval, options)
    return result


def _pass(
    bank: Bank,
    x: Samples,
    shape: tuple[int, ...],
    layout: tuple[int, int, int],
    mode: str,
    cval: float,
    options: dict[str, Any],
) -> Samples:
    result = np.empty(shape, x.dtype)
    bank.run(arguments.contiguous(x), result.reshape(-1), layout, mode, cval, **options)
    return result
