"""How the axes of an array lie in memory."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from algdiff._arguments import Samples


def in_order(array: Samples) -> bool:
    """Return whether the elements of `array` follow each other in memory, each where one of its type may lie."""
    flags = array.flags
    return flags.c_contiguous and flags.aligned


def around(shape: tuple[int, ...], axis: int) -> tuple[int, int, int]:
    """Return how many elements lie before, along and after an axis of a contiguous array."""
    if len(shape) == 1:
        return 1, shape[0], 1
    return math.prod(shape[:axis]), shape[axis], math.prod(shape[axis + 1 :])


def like(x: Samples, shape: tuple[int, ...], dtype: np.dtype[Any]) -> Samples:
    """Return an array of `shape`, maybe with a leading axis, whose axes lie in memory in the order of those of `x`."""
    leading = len(shape) - x.ndim
    order = [*range(leading), *(leading + axis for axis in memory_order(x))]
    return np.empty([shape[axis] for axis in order], dtype).transpose(np.argsort(order))


def memory_order(x: Samples) -> list[int]:
    """Return the axes of `x` from the one with the widest steps in memory to the one with the closest."""
    # The steps of an axis of one sample say nothing, and neither do those of a repeated one.
    if any(step == 0 and size > 1 for step, size in zip(x.strides, x.shape, strict=True)):
        return list(range(x.ndim))
    wide = [axis for axis in range(x.ndim) if x.shape[axis] != 1]
    ordered = iter(sorted(wide, key=lambda axis: -abs(x.strides[axis])))
    return [axis if x.shape[axis] == 1 else next(ordered) for axis in range(x.ndim)]
