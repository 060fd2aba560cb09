"""The targets: the cost of every window in copies, and the lines that are not about one window."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import algdiff
from common import SAVGOL, best_of, estimator, figure, shortest, signal

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

# Window: at most, and the moonshot; multiples of np.copyto in the same run.
COPIES: dict[int, tuple[float, float]] = {
    11: (2.0, 1.5),
    61: (3.0, 2.0),
    111: (4.0, 2.0),
    501: (5.0, 2.5),
    1001: (5.0, 2.5),
    4001: (6.0, 2.5),
    100_001: (8.0, 3.0),
}
WINDOWS = (61, 1001)


class Line(NamedTuple):
    """One target: what was measured, in `unit`, and its limit from above or below; none if this build cannot do it."""

    name: str
    measured: float | None
    limit: float
    unit: str = ""
    at_least: bool = False

    def met(self) -> bool | None:
        """Say whether it is."""
        if self.measured is None:
            return None
        return self.measured >= self.limit if self.at_least else self.measured <= self.limit

    def cells(self) -> list[str]:
        """Return a row of the table."""
        words = {True: "yes", False: "no", None: "not in this build"}
        limit = f"{'at least' if self.at_least else 'at most'} {figure(self.limit)}{self.unit}"
        measured = "" if self.measured is None else figure(self.measured) + self.unit
        return [self.name, measured, limit, words[self.met()]]


def lines(x: NDArray[np.float64], out: NDArray[np.float64], options: argparse.Namespace) -> list[Line]:
    """Measure all of them."""
    found: list[Line] = []
    for measure in (types, orders, axes, threads):
        found += measure(x, out, options)
    return [*found, *calls()]


def types(x: NDArray[np.float64], out: NDArray[np.float64], options: argparse.Namespace) -> Iterator[Line]:
    """Single against double precision."""
    single, single_out = x.astype(np.float32), np.zeros(len(x), np.float32)
    for window_length in WINDOWS:
        run = estimator("auto", window_length, **SAVGOL)
        best = best_of({
            "double": partial(run, x, out=out, threads=1),
            "single": partial(run, single, out=single_out, threads=1),
        }, options.repeat)  # fmt: skip
        yield Line(f"float32 over float64, window {window_length}", best["single"] / best["double"], 0.6)


def orders(x: NDArray[np.float64], out: NDArray[np.float64], options: argparse.Namespace) -> Iterator[Line]:
    """Three orders in one pass against one."""
    for window_length in WINDOWS:
        name = f"deriv=(0, 1, 2) over deriv=1, window {window_length}"
        three = estimator("auto", window_length, (0, 1, 2), **SAVGOL)
        one = estimator("auto", window_length, **SAVGOL)
        results = np.zeros((3, len(x)))
        best = best_of({
            "one": partial(one, x, out=out, threads=1),
            "three": partial(three, x, out=results, threads=1),
        }, options.repeat)  # fmt: skip
        check = one(x[:10_000]) - three(x[:10_000])[1]
        if not np.abs(check).max() <= 1e-12:
            raise SystemExit("the orders of one pass are not those of one alone")
        yield Line(name, best["three"] / best["one"], 2.5)


def axes(x: NDArray[np.float64], out: NDArray[np.float64], options: argparse.Namespace) -> Iterator[Line]:
    """Every layout against one long row, per sample."""
    run = estimator("auto", 61, **SAVGOL)
    few = 10 if options.quick else 1
    for shape, axis in [((10**6 // few, 64), 0), ((64, 10**6 // few), -1)] + [((200, 300, 400), i) for i in range(3)]:
        y = np.resize(x, shape)
        result = np.zeros(shape)
        best = best_of({
            "row": partial(run, x, out=out, threads=1),
            "array": partial(run, y, axis=axis, out=result, threads=1),
        }, options.repeat)  # fmt: skip
        first = (0,) * (y.ndim - 1)
        row, got = (np.moveaxis(array, axis, -1)[first] for array in (y, result))
        if not np.abs(run(row) - got).max() <= 1e-12:
            raise SystemExit("an axis does not give what its rows give")
        ratio = best["array"] / y.size / (best["row"] / x.size)
        yield Line(f"{shape} along axis {axis} over one row, per sample", ratio, 1.3)


def threads(x: NDArray[np.float64], out: NDArray[np.float64], options: argparse.Namespace) -> Iterator[Line]:
    """Two threads against one: no slower below 10^6 samples, and nearly twice as fast from there on."""
    for window_length in WINDOWS:
        run = estimator("auto", window_length, **SAVGOL)
        for count in (10**4, 10**5, 10**6, 10**7):
            if count > len(x):
                continue
            repeat = options.repeat * max(1, 10**6 // count) * 2
            one, two = (partial(run, x[:count], out=out[:count], threads=n) for n in (1, 2))
            best = best_of({"one": one, "two": two}, repeat, clock=time.perf_counter)
            # Where it may not be slower, a measurement still errs by a few per cent.
            limit = 1.8 if count >= 10**6 else 0.95
            yield Line(
                f"two threads, {count:,} samples, window {window_length}",
                best["one"] / best["two"],
                limit,
                " x",
                at_least=True,
            )


def calls() -> Iterator[Line]:
    """Short calls and designs, as Python sees them."""
    x = signal(1000)
    out = np.empty_like(x)
    run: Callable[..., Any] = algdiff.Differentiator(61, **SAVGOL)
    yield Line("one call, 1,000 samples, window 61", 1e6 * shortest(partial(run, x)), 10, " us")
    yield Line("the same with out", 1e6 * shortest(partial(run, x, out=out)), 10, " us")
    for window_length, limit in ((61, 50), (4001, 1000)):
        for words in ({}, SAVGOL):
            taper = "kappa = mu = 0" if words else "kappa = mu = 1"
            seconds = shortest(partial(algdiff.Differentiator, window_length, **words))
            yield Line(f"one design, window {window_length}, {taper}", 1e6 * seconds, limit, " us")
