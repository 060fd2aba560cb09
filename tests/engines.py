"""Engines against the naive sum: what they run on, how far rounding may take each of them, and signals that show it."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

import algdiff
from support import design

Array = npt.NDArray[Any]
Long = npt.NDArray[np.longdouble]

OTHERS = ("moments", "fft")
DTYPES = (np.float64, np.float32)
MOST, LEAST, LONG = 8, 31, 2001  # moments may refuse higher degrees, and shorter and longer windows
ROWS = 512  # windows that the naive sum takes at a time


class Case(NamedTuple):
    """The arguments of one design, hashable."""

    window_length: int
    deriv: int = 1
    degree: int = 3
    kappa: float = 0.0
    mu: float = 0.0
    tau: float | str = "center"
    rule: str = "exact"

    def words(self) -> dict[str, Any]:
        """Return all but window and order, as keywords."""
        return {name: value for name, value in self._asdict().items() if name not in ("window_length", "deriv")}

    def polynomial(self) -> bool:
        """Say whether the weights are a polynomial in the sample index, but for the end samples."""
        whole = all(value >= 0 and float(value).is_integer() for value in (self.kappa, self.mu))
        return whole and self.rule in ("exact", "trapezoid")

    def size(self) -> float:
        """Return the degree of that polynomial."""
        return self.degree + self.kappa + self.mu


@cache
def designed(case: Case) -> algdiff.Differentiator:
    """Return the design, whatever its engine."""
    return design(case.window_length, case.deriv, **case.words())


@cache
def by_engine(engine: str, case: Case) -> algdiff.Differentiator:
    """Return the design run by `engine`."""
    return design(case.window_length, case.deriv, engine=engine, **case.words())


def accepts(engine: str, case: Case) -> bool:
    """Say whether `engine` has to run this design: moments needs polynomials, low ones, and windows not too short."""
    if engine != "moments":
        return True
    least = LEAST if case.rule == "exact" else 2 * LEAST
    return case.polynomial() and case.size() <= MOST and least <= case.window_length <= LONG


def on_differences(d: algdiff.Differentiator) -> bool:
    """Say whether the engines run on first differences: the weights sum to 0, or to 1 for smoothers."""
    return d.rule in ("exact", "cell", "hat") and not (d.deriv == 0 and len(d.weights) == 1)


def middle(d: algdiff.Differentiator) -> int:
    """Return the sample of the window from which both sides are summed: the anchor of a smoother, else the middle."""
    length = len(d.weights)
    if d.deriv == 0:
        return int(np.clip(math.floor(length - 0.5 - d.delay_samples), 0, length - 1))
    return length // 2


def taps(d: algdiff.Differentiator, anchor: int | None = None) -> Long:
    """Return what multiplies the differences, or the samples: sums of weights, each side of the middle from its end."""
    w = d.weights.astype(np.longdouble)
    if not on_differences(d):
        return w
    m = middle(d) if anchor is None else anchor
    return np.concatenate([-np.cumsum(w[:m]), np.cumsum(w[:m:-1])[::-1]])


def naive(d: algdiff.Differentiator, x: Array, places: Array | None = None) -> Long:
    """Return the estimates of the windows that start at `places`, by default all, as plain sums in long double.

    On differences that is, by summation by parts, the sum of w_j (x_j - x_m), and for smoothers x_m besides.
    """
    windows = sliding_window_view(x, len(d.weights))
    places = np.arange(len(windows)) if places is None else places
    w, m = d.weights.astype(np.longdouble), middle(d)
    out = np.empty(len(places), np.longdouble)
    for start in range(0, len(places), ROWS):
        rows = windows[places[start : start + ROWS]].astype(np.longdouble)
        center = rows[:, m].copy()
        out[start : start + ROWS] = (rows - center[:, None]) @ w if on_differences(d) else rows @ w
        if on_differences(d) and d.deriv == 0:
            out[start : start + ROWS] += center
    return out


def bound(engine: str, d: algdiff.Differentiator, x: Array) -> npt.NDArray[np.float64]:
    """Return how far rounding may take the outputs of `engine` in mode "valid", one bound for each.

    direct
        A sum of L products errs by at most L eps times the sum of their sizes (Higham 2002, 3.1), which is at most
        sum|W| times the largest difference in the window; the differences, the taps and the scaling add a few eps each.
    moments
        At most 64 taps at either end, in three sums; what comes by moments passes D + 1 of them, each with the size of
        the basis, 2 l + 1 for Legendre's l-th, so (D + 1)^2 in all, in blocks and in groups. Weights that differ from a
        polynomial by their own rounding, 1e-14 of the largest, count as one. D is one more for sums of weights.
        Smoothers have the newest sample as their anchor: only then are the sums one polynomial.
    fft
        A transform of N points errs by at most c log2(N) eps in the 2-norm of its block (Higham 2002, 24.1), which the
        spectrum of the taps multiplies by at most their 2-norm: 8 eps log2(N) |W|_2 |s|_2. The block's samples count up
        to 2^10 (single precision: 2^5) times the largest of the window; it holds at most 2^14, or 16 windows.
    """
    newest = len(d.weights) - 1 if engine == "moments" and d.deriv == 0 else None
    w = np.abs(taps(d, newest)).astype(float)
    samples = np.asarray(x, float)
    s = np.abs(np.diff(samples)) if on_differences(d) else np.abs(samples)
    eps, tiny = float(np.finfo(x.dtype).eps), float(np.finfo(x.dtype).smallest_subnormal)
    length, outputs = len(d.weights), len(x) - len(d.weights) + 1
    top = window_maximum(s, len(w), outputs)
    result = (length + 8) * eps * w.sum() * top
    # Products may vanish below the smallest number, before the power of two by which they are scaled.
    lost = (length + 8) * tiny * max(1.0, 2 * float(w.max(initial=0.0)))
    if engine == "moments":
        terms = 3 * 64 + 16 * (d.degree + d.kappa + d.mu + 2) ** 2
        result = (eps * terms * w.sum() + 1e-14 * len(w) * w.max(initial=0.0)) * top
        lost *= 64
    elif engine == "fft":
        points = max(2**14, 2 ** math.ceil(math.log2(16 * length)))
        near = np.minimum((2**10 if x.dtype == np.float64 else 2**5) * top, s.max(initial=0.0))
        result = result + 8 * eps * math.log2(points) * math.sqrt(points) * float(np.linalg.norm(w)) * near
        lost *= points
    if d.deriv == 0:
        result = result + 4 * eps * window_maximum(np.abs(samples), length, outputs)
    return result + lost


def usual(engine: str, d: algdiff.Differentiator, x: Array) -> float:
    """Return what the root mean square of the errors on noise should stay below.

    Rounding errors that are independent add up as their squares: the L partial sums of a dot product have at most the
    size |W|_2 rms(s); each of the log2(N) passes of a transform adds eps to every value; the blocks of moments make
    D + 1 such sums.
    """
    w = taps(d).astype(float)
    s = np.diff(x.astype(float)) if on_differences(d) else x.astype(float)
    factors = {
        "direct": math.sqrt(len(w)),
        "moments": (d.degree + d.kappa + d.mu + 2) * math.sqrt(len(w)),
        "fft": 2 * math.log2(max(2**14, 8 * len(w))),
    }
    own = float(np.linalg.norm(w)) * float(np.sqrt(np.mean(s**2)))
    smoothed = float(np.sqrt(np.mean(x.astype(float) ** 2))) if d.deriv == 0 else 0.0
    return float(np.finfo(x.dtype).eps) * (factors[engine] * own + smoothed)


def window_maximum(values: Array, length: int, outputs: int) -> Array:
    """Return the largest value of every window; none is as 0."""
    if length == 0 or outputs <= 0:
        return np.zeros(max(outputs, 0))
    done, maxima = 1, values
    while 2 * done <= length:
        maxima, done = np.maximum(maxima[:-done], maxima[done:]), 2 * done
    return np.maximum(maxima[:outputs], maxima[length - done : length - done + outputs])


def signals(rng: np.random.Generator, count: int, dtype: Any) -> dict[str, Array]:
    """Return signals that show what rounding, offsets, ranges and neighbours do."""
    noise, t = rng.standard_normal(count), np.arange(count)
    info = np.finfo(dtype)
    huge = float(info.max) ** (300 / 308.25)
    half = np.where(t < count // 2, 1e12, 1.0)
    return {
        "noise": noise.astype(dtype),
        "offset": (1e9 + noise).astype(dtype),
        "walk": np.cumsum(noise).astype(dtype),
        "ramp": (3.0 - 0.37 * t).astype(dtype),
        "loud and quiet": (half * noise).astype(dtype),
        "quiet and loud": (half[::-1] * noise).astype(dtype),
        "subnormal": (np.round(100 * noise) * float(info.smallest_subnormal)).astype(dtype),
        "alternating": np.where(t % 2 == 0, huge, -huge).astype(dtype),
    }


def assert_within(got: Array, expected: Array, allowed: Array | float, message: str = "") -> None:
    """Fail where the error exceeds what is allowed, and say by how much; what is out of range has to be infinite."""
    assert got.shape == expected.shape, message
    with np.errstate(over="ignore"):
        infinite = np.isinf(got) & (got == expected.astype(got.dtype))
    error = np.abs(np.where(infinite, 0, got.astype(np.longdouble)) - np.where(infinite, 0, expected))
    wrong = ~(error <= allowed)
    if wrong.any():
        place = int(np.argmax(np.where(wrong, error / np.maximum(allowed, 5e-324), 0)))
        limit = float(np.broadcast_to(allowed, error.shape)[place])
        raise AssertionError(f"{message}: {wrong.sum()} of {len(wrong)}, at {place} {float(error[place])} > {limit}")
