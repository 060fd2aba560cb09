"""Who takes one sample at a time in Python: streams, and what else one would write."""

from __future__ import annotations

import gc
import math
import time
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import signal

import algdiff
from common import EPS, SAVGOL

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Samples = NDArray[Any]
    Push = Callable[[Any], Any]

OURS, RUST, C, C_FLOAT = "algdiff", "algdiff, Rust", "algdiff, C, double", "algdiff, C, float"
RING, QUEUE, FILTER = "ring, np.dot", "deque, np.dot", "lfilter, zi"
RECURSIVE, EMPTY, RESET = "recursive, order 1", "abs(x)", "Stream.reset()"


class Case(NamedTuple):
    """What is estimated with every sample: one or several windows that end with it."""

    name: str
    windows: tuple[int, ...]
    deriv: int | tuple[int, ...] = 1
    channels: int | None = None
    dtype: str = "float64"
    nan_policy: str = "propagate"
    missing: float = 0.0

    def designs(self) -> list[algdiff.Differentiator]:
        """Return the designs, without a delay."""
        return [algdiff.Differentiator(length, self.deriv, tau="newest", **SAVGOL) for length in self.windows]

    def stream(self, **options: Any) -> algdiff.Stream:
        """Return a new stream."""
        designs = self.designs()
        design = designs[0] if len(designs) == 1 else designs
        words: dict[str, Any] = {"channels": self.channels, "dtype": self.dtype, "nan_policy": self.nan_policy}
        return algdiff.Stream(design, **words, **options)

    def block(self, count: int) -> Samples:
        """Return samples, all channels of the same noise: channel c of sample i is number i + c of it."""
        x = noise(count + (self.channels or 1) - 1).astype(self.dtype)
        if self.channels is not None:
            return sliding_window_view(x, self.channels)
        x[np.random.default_rng(1).random(count) < self.missing] = np.nan
        return x

    def samples(self, count: int) -> list[Any]:
        """Return the same one by one, as a program would have them."""
        x = self.block(count)
        return x.tolist() if self.channels is None else list(x)

    def expected(self, count: int) -> Samples:
        """Return what the engine "direct" gives from all windows that are full: orders, samples, channels."""
        x, longest = self.block(count), max(self.windows)
        found = []
        for length, design in zip(self.windows, self.designs(), strict=True):
            own = design.replace(engine="direct")(
                x[longest - length :], axis=0, mode="valid", nan_policy=self.nan_policy
            )
            found.append(own.reshape(-1, len(x) - longest + 1, self.channels or 1))
        return np.concatenate(found)


def noise(count: int) -> Samples:
    """Return numbers between -1 and 1 from the generator that all programs have."""
    state, found = 12345, np.empty(count)
    for i in range(count):
        state = (state * 6364136223846793005 + 1442695040888963407) & (2**64 - 1)
        found[i] = (state >> 11) / 2**52 - 1
    return found


def latencies(push: Push | None, samples: Sequence[Any]) -> Samples:
    """Return the nanoseconds of every push, or those between two readings of the clock."""
    clock, spent = time.perf_counter_ns, [0] * len(samples)
    gc.disable()
    if push is None:
        for i, _ in enumerate(samples):
            started = clock()
            stopped = clock()
            spent[i] = stopped - started
    else:
        for i, sample in enumerate(samples):
            started = clock()
            push(sample)
            stopped = clock()
            spent[i] = stopped - started
    gc.enable()
    return np.array(spent)


def check(name: str, push: Push, case: Case, count: int, bound: float) -> None:
    """Compare what a stream gives with the engine "direct": to the bit if there is no bound. It is warm then."""
    expected = case.expected(count)
    found = np.array([push(sample) for sample in case.samples(count)], case.dtype)[max(case.windows) - 1 :]
    found = found.reshape(expected.swapaxes(0, 1).shape).swapaxes(0, 1)
    if bound == 0 and found.dtype == expected.dtype and found.tobytes() == np.ascontiguousarray(expected).tobytes():
        return
    off = float(np.nanmax(np.abs(found - expected)))
    if bound == 0 or not off <= bound or not np.array_equal(np.isnan(found), np.isnan(expected)):
        raise SystemExit(f"{name}, {case.name} is off by {off}, allowed {bound}")


def rounding(case: Case) -> float:
    """Return what a sum in another order may be off by, where samples are at most 1."""
    eps = EPS if case.dtype == "float64" else float(np.finfo(np.float32).eps)
    return max(
        4 * eps * (length + 8) * float(np.abs(design.weights).sum(axis=-1).max())
        for length, design in zip(case.windows, case.designs(), strict=True)
    )


def ring(case: Case) -> Push:
    """Return NumPy's dot product with a ring that holds every sample twice, so that the window is one slice."""
    length = max(case.windows)
    rows = [
        np.pad(np.atleast_2d(d.weights), [(0, 0), (length - d.weights.shape[-1], 0)]).astype(case.dtype)
        for d in case.designs()
    ]
    weights = np.concatenate(rows)
    dot = (weights if len(weights) > 1 else weights[0]).dot
    held = np.zeros(2 * length if case.channels is None else (2 * length, case.channels), case.dtype)
    place = 0

    def push(sample: Any) -> Any:
        nonlocal place
        held[place] = sample
        held[place + length] = sample
        place += 1
        window = held[place : place + length]
        if place == length:
            place = 0
        return dot(window)

    return push


def queue(case: Case) -> Push:
    """Return NumPy's dot product with what a deque holds, by the fastest of the ways to make it an array."""
    weights = case.designs()[0].weights
    length, dot, fromiter = len(weights), weights.dot, np.fromiter
    held = deque([0.0] * length, length)

    def push(sample: float) -> Any:
        held.append(sample)
        return dot(fromiter(held, float, length))

    return push


def filtered(case: Case) -> Push:
    """Return SciPy's filter with the same taps, and its state."""
    taps, lfilter = case.designs()[0].weights[::-1].copy(), signal.lfilter
    one, state = np.ones(1), np.zeros(len(taps) - 1)

    def push(sample: float) -> Any:
        nonlocal state
        found, state = lfilter(taps, one, [sample], zi=state)
        return found[0]

    return push


def recursive(case: Case) -> Push:
    """Return a difference behind a low-pass filter of first order, in plain Python: simpler, and the floor."""
    keep = math.exp(-2 / case.windows[0])
    gain, slope, last = 1 - keep, 0.0, 0.0

    def push(sample: float) -> float:
        nonlocal slope, last
        slope, last = keep * slope + gain * (sample - last), sample
        return slope

    few = case.block(1000)
    found = [push(sample) for sample in few.tolist()]
    if not np.allclose(found, signal.lfilter([gain, -gain], [1, -keep], few), rtol=0, atol=1e-12):
        raise SystemExit("the recursive filter is wrong")
    return push
