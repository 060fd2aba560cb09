"""The peers: other ways to the same estimates, each with a derived bound for its difference to ours."""

from __future__ import annotations

import math
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage, signal

import algdiff
from common import EPS, SAVGOL

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Samples = NDArray[np.float64]

DERIV, DEGREE = 1, 3


class Peer(NamedTuple):
    """One way to the same estimates.

    `call` takes the samples; the result is as long, or as long as there are whole windows. `bound` is what its largest
    difference to ours may be, `per_tap` its cost in nanoseconds per sample and sample of the window, roughly.
    """

    name: str
    call: Callable[[Samples], Samples]
    bound: float
    per_tap: float = 0.0


def peers(window_length: int, count: int, top: float) -> list[Peer]:
    """Return what is compared for `count` samples of size up to `top`, with bounds for rounding alone.

    A sum of L products is off by at most L eps sum|w| max|x|. A transform of length N, here at most 16 L or 2^17, adds
    eps log2(N) sqrt(N) times the 2-norm of w and max|x|. SciPy solves for its coefficients with a matrix of powers,
    whose condition number multiplies eps. torch may use another order of summation.
    """
    weights = algdiff.Differentiator(window_length, DERIV, **SAVGOL).weights
    direct = 4 * EPS * (window_length + 8) * float(np.abs(weights).sum()) * top
    points = max(16 * window_length, 2**17)
    fft = 4 * EPS * math.log2(points) * math.sqrt(points) * float(np.linalg.norm(weights)) * top + direct
    powers = np.vander(np.arange(window_length) - window_length // 2, DEGREE + 1).astype(float)
    solve = direct + 4 * EPS * float(np.linalg.cond(powers)) * float(np.abs(weights).sum()) * top
    kernel = weights[::-1].copy()
    sliding, off = moving_moments(window_length, weights)
    found = [
        Peer("savgol_filter", partial(_savgol, window_length), solve, 0.6),
        Peer("np.convolve", lambda x: np.convolve(x, kernel, "valid"), direct, 0.15),
        Peer("oaconvolve", lambda x: signal.oaconvolve(x, kernel, "valid"), fft),
        Peer("convolve1d", lambda x: ndimage.convolve1d(x, kernel, mode="nearest"), direct, 0.7),
        Peer("cumsum moments", sliding, off * top + direct),
    ]
    found += _torch(weights, direct)
    return [peer for peer in found if window_length <= count or not peer.per_tap]


def _savgol(window_length: int, x: Samples) -> Samples:
    result: Samples = signal.savgol_filter(x, window_length, DEGREE, DERIV, mode="interp")
    return result


def moving_moments(window_length: int, weights: Samples) -> tuple[Callable[[Samples], Samples], float]:
    """Return moving sums of t^m x by `np.cumsum`, and its error relative to max|x|.

    The weights are a1 t + a3 t^3 about the middle of the window, so four running sums give every estimate, whatever the
    window. Powers of t lose digits far from 0: blocks of a few windows, each with its own t in [-1, 1], bound that. A
    running sum of N terms up to 1 errs by N^2 eps / 2, which the coefficients of the estimate multiply.
    """
    half, block = window_length // 2, max(4 * window_length, 64)
    columns = block + window_length - 1
    scale = columns / 2
    offsets = (np.arange(window_length) - half) / scale
    a1, a3 = np.linalg.lstsq(np.stack([offsets, offsets**3], axis=1), weights, rcond=None)[0]
    t = (np.arange(columns) - columns / 2) / scale
    s = t[half : half + block]
    # a1 (t - s) + a3 (t - s)^3 as a polynomial in t, its coefficients polynomials in the middle s.
    terms = [-a1 * s - a3 * s**3, a1 + 3 * a3 * s**2, -3 * a3 * s, np.full(block, a3)]
    powers = [t**m for m in range(4)]

    def estimates(rows: Samples, out: Samples) -> None:
        sums = np.zeros((len(rows), rows.shape[1] + 1))
        out[...] = 0
        for power, term in zip(powers, terms, strict=True):
            np.cumsum(power[: rows.shape[1]] * rows, axis=1, out=sums[:, 1:])
            out += term[: out.shape[1]] * (sums[:, window_length:] - sums[:, :-window_length])

    def call(x: Samples) -> Samples:
        outputs = len(x) - window_length + 1
        out = np.empty(outputs)
        whole = outputs // block
        if whole:
            rows, results = sliding_window_view(x, columns)[::block], out[: whole * block].reshape(whole, block)
            for group in range(0, whole, many):
                estimates(rows[group : min(whole, group + many)], results[group : group + many])
        if whole * block < outputs:
            estimates(x[None, whole * block :], out[None, whole * block :])
        return out

    many = max(1, 2**16 // columns)
    largest = float(np.max(np.sum(np.abs(terms), axis=0)))
    return call, EPS * columns**2 * largest


def _torch(weights: Samples, bound: float) -> list[Peer]:
    try:
        torch: Any = import_module("torch")
    except ImportError:
        return []
    torch.set_num_threads(1)
    kernel = torch.from_numpy(weights.copy())[None, None]

    def call(x: Samples) -> Samples:
        with torch.no_grad():
            result: Samples = torch.nn.functional.conv1d(torch.from_numpy(x)[None, None], kernel)[0, 0].numpy()
        return result

    return [Peer("torch conv1d", call, bound, 1.0)]


def moving_mean(window_length: int) -> Callable[[Samples], Samples] | None:
    """Return the moving mean of bottleneck, the floor of what running sums can cost, if it is installed."""
    try:
        bottleneck: Any = import_module("bottleneck")
    except ImportError:
        return None

    def call(x: Samples) -> Samples:
        result: Samples = bottleneck.move_mean(x, window_length)
        return result

    return call
