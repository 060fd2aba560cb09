"""One call of a bank: axis, dtype, layout and memory on this side, samples on the other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff import _blocks as blocks
from algdiff import _threads as threads_of
from algdiff._arguments import Progress, Samples
from algdiff._core import Bank, Plan
from algdiff._layout import around, in_order, like

MODES = ("fit", "valid", "nan", "nearest", "mirror", "wrap", "constant")

DOUBLE, SINGLE = np.dtype(np.float64), np.dtype(np.float32)

FEW = 1 << 20
"""Multiplications for which no engine starts a second thread: asking how many there may be takes as long."""


def run(
    bank: Bank,
    plan: Plan,
    x: ArrayLike,
    *,
    orders: int | None = None,
    axis: int = -1,
    mode: str = "fit",
    cval: complex = 0.0,
    half_sample: bool = False,
    out: Samples | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Samples:
    """Apply `bank`, which holds `plan`, along `axis` of `x`; the result has a leading axis over `orders`, if any.

    Contiguous floats go over at once: a short call takes no longer here than there. `blocks` sees to the rest.
    """
    known = type(x) is np.ndarray and (x.dtype is DOUBLE or x.dtype is SINGLE) and x.ndim > 0
    samples: Any = x if known else arguments.signal("x", x)
    shape, span = samples.shape, plan.span
    axis = len(shape) - 1 if type(axis) is int and axis == -1 else arguments.axis_index(axis, len(shape))
    if type(mode) is not str or mode not in MODES:
        arguments.word("mode", mode, f"a word, one of {', '.join(map(repr, MODES))}")
    if type(cval) is not float:
        cval = (arguments.number if samples.dtype.kind == "c" else arguments.real)("cval", cval)
    threads = 1 if threads is None and samples.size * span < FEW else threads_of.count(threads)

    if mode == "valid":
        shape = (*shape[:axis], max(shape[axis] + 1 - span, 0), *shape[axis + 1 :])
    if orders is not None:
        shape = (orders, *shape)
    plain = known and in_order(samples)
    if out is not None:
        result = arguments.check_output(out, shape, arguments.working_dtype(samples.dtype), samples)
        plain = plain and in_order(result)
    elif plain:
        result = np.empty(shape, samples.dtype)
    else:
        result = like(samples, shape, arguments.working_dtype(samples.dtype))
    options: dict[str, Any] = {"half_sample": half_sample, "threads": threads, "progress": progress}
    if plain:
        layout = around(samples.shape, axis)
        bank.run(samples.reshape(-1), result.reshape(-1), layout, mode, cval.real, **options)
    else:
        stacked = result if orders is not None else result[np.newaxis]
        blocks.run(bank, plan, samples, stacked, axis, mode, cval, **options)
    return result
