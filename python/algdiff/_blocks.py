"""Data that the core cannot read in place, taken over block by block: no copy of the whole is ever made.

Every block of outputs is computed from the samples that it needs, and told where it lies in its row, so that it has the
bits of one run over everything. Where the data are periodic, a block at an end brings the other end along.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from algdiff._arguments import Progress, Samples
from algdiff._core import Bank, Plan
from algdiff._layout import around, in_order, memory_order

BYTES = 1 << 20
"""Size of a buffer: one holds the samples of a block, one its outputs. Long windows need larger ones."""

COLUMNS = 32
"""Neighbouring columns that are taken together, if the axis of time is not the last, and windows are long."""

INTERVAL = 0.04
"""Seconds between two reports of progress."""

Part = tuple[Samples, Samples, float]
"""Real samples, where their outputs go, and the constant beyond the data."""


class Row(NamedTuple):
    """What the outputs of a row read: output `i` the window that starts at sample `i - center`."""

    samples: int
    outputs: int
    span: int
    center: int
    mode: str
    grid: int
    aligned: bool

    @classmethod
    def of(cls, plan: Plan, mode: str, samples: int, grid: int, *, half_sample: bool = False) -> Row:
        """Return the row of some samples under a plan; blocks that start on the `grid` have the bits of the whole."""
        span = plan.span
        halves = half_sample and span % 2 == 0
        center = 0 if mode == "valid" else span // 2 - 1 if halves else plan.aligned_position
        outputs = max(samples + 1 - span, 0) if mode == "valid" else samples
        return cls(samples, outputs, span, center, mode, grid, not halves)

    def reads(self, first: int, last: int) -> tuple[int, int]:
        """Return the samples that the outputs from `first` to `last` need: in the row, unless that is periodic."""
        start, end = first - self.center, last - self.center + self.span - 1
        if self.mode == "valid":
            return first, last + self.span - 1
        if self.mode in ("fit", "nan"):
            return max(min(start, self.samples - self.span), 0), min(max(end, self.span), self.samples)
        if self.mode != "mirror":
            # Or else the nearest sample, which the mode "constant" does not need.
            inside = min(max(start, 0), self.samples - 1), max(min(end, self.samples), 1)
            return (
                (start, end) if self.mode == "wrap" else (min(inside[0], inside[1] - 1), max(inside[1], inside[0] + 1))
            )
        period = max(2 * (self.samples - 1), 1)
        folded = np.arange(start, end) % period
        sources = np.minimum(folded, period - folded) if self.samples > 1 else folded
        return int(sources.min()), int(sources.max()) + 1

    def call(self, first: int, start: int, end: int) -> dict[str, Any]:
        """Return how to run a block of outputs from `first`, whose samples are those from `start` to `end`."""
        if start >= 0 and end <= self.samples:
            return {"mode": self.mode, "part": (start, self.samples, first)}
        # A row of its own, which starts as far before the data as the first window, in whole steps of the grid.
        before = -(-max(self.center, 0) // self.grid) * self.grid
        samples = before - self.center + self.samples + self.span - 1
        return {"mode": "valid", "aligned": self.aligned, "part": (start + before, samples, start + before)}


def run(
    bank: Bank,
    plan: Plan,
    x: Samples,
    result: Samples,
    axis: int,
    mode: str,
    cval: complex,
    *,
    half_sample: bool,
    threads: int,
    progress: Progress | None,
) -> None:
    """Apply `bank` along `axis` of `x` into `result`, whose leading axis is that of the orders."""
    order = memory_order(x)
    x, axis = x.transpose(order), order.index(axis)
    result = result.transpose(0, *(1 + index for index in order))
    dtype = np.dtype(np.float32 if result.dtype in (np.float32, np.complex64) else np.float64)
    layout = around(x.shape, axis)
    parts = _parts(x, result, cval)
    options: dict[str, Any] = {"half_sample": half_sample, "threads": threads}
    if result.size == 0:
        # Nothing to do, but to say what is wrong with the rest of the call.
        bank.run(np.empty(0, dtype), np.empty(0, dtype), layout, mode, cval.real, **options)
        return
    if len(parts) == 1 and _plain(x, dtype) and _plain(result, dtype):
        bank.run(x.reshape(-1), result.reshape(-1), layout, mode, cval.real, **options, progress=progress)
        return
    grid = bank.grid(single=dtype == np.float32)
    row = Row.of(plan, mode, x.shape[axis], grid, half_sample=half_sample)
    _Blocks(bank, row, parts, axis, dtype, options, progress).run()


def run_part(
    bank: Bank,
    row: Row,
    x: Samples,
    result: Samples,
    axis: int,
    cval: complex,
    *,
    start: int,
    first: int,
    threads: int,
    progress: Progress | None = None,
) -> None:
    """Apply `bank` to a part of longer rows: what `Row.reads` says that some outputs need.

    Parameters
    ----------
    bank : Bank
        What to apply.
    row : Row
        A whole row.
    x : ndarray
        The samples from `start` on, which may lie before or beyond a row whose mode is "wrap".
    result : ndarray
        Where the outputs from `first` on go; its leading axis is that of the orders.
    axis : int
        The axis of time in `x`, counted from the front.
    cval : complex
        The value beyond the data in mode "constant".
    start, first : int
        Where in the row the samples and the outputs begin.
    threads : int
        At most so many; 0 leaves it to the core.
    progress : callable, optional
        Called now and then with the fraction that is done.
    """
    order = memory_order(x)
    x, axis = x.transpose(order), order.index(axis)
    result = result.transpose(0, *(1 + index for index in order))
    dtype = np.dtype(np.float32 if result.dtype in (np.float32, np.complex64) else np.float64)
    if result.size == 0:
        return
    end = start + x.shape[axis]
    around_the_ends = start < 0 or end > row.samples
    if x.dtype.kind != "c" and _plain(x, dtype) and _plain(result, dtype) and not around_the_ends:
        call = row.call(first, start, end)
        layout = around(x.shape, axis)
        bank.run(x.reshape(-1), result.reshape(-1), layout, cval=cval.real, threads=threads, progress=progress, **call)
        return
    options = {"threads": threads}
    _Blocks(bank, row, _parts(x, result, cval), axis, dtype, options, progress, (start, first)).run()


def _parts(x: Samples, result: Samples, cval: complex) -> list[Part]:
    """Return the real part and, of complex samples, the imaginary one."""
    real = (x.real, result.real, cval.real)
    return [real, (x.imag, result.imag, cval.imag)] if x.dtype.kind == "c" else [real]


def _plain(array: Samples, dtype: np.dtype[Any]) -> bool:
    """Return whether the core can take `array` as it is."""
    return array.dtype == dtype and in_order(array)


class _Blocks:
    """One call: what is the same for all its blocks, and two buffers."""

    def __init__(
        self,
        bank: Bank,
        row: Row,
        parts: list[Part],
        axis: int,
        dtype: np.dtype[Any],
        options: dict[str, Any],
        progress: Progress | None,
        origin: tuple[int, int] | None = None,
    ) -> None:
        # Which sample and which output are the first of the arrays, if those are parts of rows.
        self.part, (self.start, self.first) = origin is not None, origin or (0, 0)
        self.bank, self.row, self.parts, self.axis, self.options = bank, row, parts, axis, options
        self.orders, *self.shape = parts[0][1].shape
        self.buffers = {"x": np.empty(0, dtype), "out": np.empty(0, dtype)}
        self.progress, self.done, self.told = progress, 0, time.monotonic()

    def run(self) -> None:
        for place in self.places():
            for part in self.parts:
                self.block(place, *part)

    def places(self) -> Iterator[tuple[slice, ...]]:
        """Yield where in the shape of one order's outputs the blocks lie, in the order of memory."""
        row, inner = self.row, math.prod(self.shape[self.axis + 1 :])
        budget = BYTES // self.buffers["x"].itemsize
        # Lines of memory whole, if blocks stay much longer than the window, which neighbours have in common.
        columns = inner if 4 * self.orders * inner * row.span <= budget else min(inner, COLUMNS)
        least = max(budget // columns // self.orders - row.span + 1, (3 if columns > 1 else 1) * row.span)
        first, last = self.first, self.first + self.shape[self.axis]
        length = min(-(-least // row.grid) * row.grid, max(last - first, 1))
        left = max(budget // max(length + row.span - 1, length * self.orders), 1)
        cuts: list[list[slice]] = [[] for _ in self.shape]
        for axis in reversed(range(len(self.shape))):
            if axis == self.axis:
                # Windows start on the grid, counted from the first sample.
                # Those that reach around the ends of a periodic row are apart from those that do not.
                ends = (row.center, row.outputs - row.span + row.center + 1) if row.mode == "wrap" else ()
                grid = range(first + (row.center - first) % row.grid, last, length)
                starts = sorted({first, *grid, *(end for end in ends if first < end < last)})
            else:
                extent = min(left, self.shape[axis])
                left = max(left // extent, 1) if extent == self.shape[axis] else 1
                starts = list(range(0, self.shape[axis], extent))
            end = last if axis == self.axis else self.shape[axis]
            cuts[axis] = [slice(*pair) for pair in itertools.pairwise((*starts, end))]
        return itertools.product(*cuts)

    def block(self, place: tuple[slice, ...], x: Samples, result: Samples, cval: float) -> None:
        first, last = place[self.axis].start, place[self.axis].stop
        start, end = self.row.reads(first, last)
        samples = self.samples(x, place, start, end)
        where = list(place)
        where[self.axis] = slice(first - self.first, last - self.first)
        target = result[(slice(None), *where)]
        plain = _plain(target, samples.dtype)
        out = target.reshape(-1) if plain else self.buffer("out", target.size)
        options = {**self.row.call(first, start, end), **self.options, "progress": self.fraction(target.size)}
        self.bank.run(samples.reshape(-1), out, around(samples.shape, self.axis), cval=cval, **options)
        if not plain:
            target[...] = out.reshape(target.shape)
        self.finished(target.size)

    def samples(self, x: Samples, place: tuple[slice, ...], start: int, end: int) -> Samples:
        """Return the samples from `start` to `end` of some rows as the core takes them."""
        before, after = place[: self.axis], place[self.axis + 1 :]
        inside = self.part or (start >= 0 and end <= self.row.samples)
        where: Any = slice(start - self.start, end - self.start)
        if not inside:
            where = np.arange(start, end) % self.row.samples
        samples = x[(*before, where, *after)]
        if inside and _plain(samples, self.buffers["x"].dtype):
            return samples
        converted = self.buffer("x", samples.size).reshape(samples.shape)
        np.copyto(converted, samples, casting="unsafe")
        return converted

    def buffer(self, name: str, size: int) -> Samples:
        if self.buffers[name].size < size:
            self.buffers[name] = np.empty(size, self.buffers[name].dtype)
        return self.buffers[name][:size]

    def fraction(self, size: int) -> Progress | None:
        """Return what makes fractions of a block of `size` outputs fractions of the call."""
        progress, done, total = self.progress, self.done, self.total
        if progress is None:
            return None

        def tell(fraction: float) -> None:
            self.told = time.monotonic()
            progress((done + fraction * size) / total)

        return tell

    def finished(self, size: int) -> None:
        """Count a block, and report it if the core has not reported for a while."""
        self.done += size
        if self.progress is not None and time.monotonic() >= self.told + INTERVAL:
            self.told = time.monotonic()
            self.progress(self.done / self.total)

    @property
    def total(self) -> int:
        """Outputs of the call; those of complex data count twice."""
        return len(self.parts) * self.parts[0][1].size
