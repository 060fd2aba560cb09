"""Speed where every window is a fit of its own: gaps, uneven times, error bars; results are checked before.

Gaps are compared with the same call on data without gaps, uneven times with loops of the same fits. SciPy's splines
solve another problem, one curve through all samples, and are named for what their users wait; there is nothing to check
them against.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import algdiff
from common import COPY, best_of, figure, machine, one_thread, signal, table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Samples = NDArray[Any]

WINDOWS = (11, 61, 501, 1001)
UNEVEN = (11, 51, 501)
TARGETS = {"omit, no gaps": 1.3, "omit, 5 % gaps": 50.0}  # in calls that propagate
FASTER = 50.0  # than a loop of fits
SECONDS = 4.0  # for 10^6 uneven samples at window 51


def brute(t: Samples, x: Samples, window_length: int, index: int) -> float:
    """Return the slope at a sample by least squares in NumPy."""
    there = np.isfinite(x)
    start = min(max(index - window_length // 2, 0), x.size - window_length)
    part = slice(start, start + window_length)
    inside = there[part]
    times = t[part]
    step = (times[-1] - times[0]) / (window_length - 1)
    s = (times - times[0] + 0.5 * step) / (step * window_length)
    root = np.sqrt(s * (1 - s))[inside]
    middle, half = times.mean(), 0.5 * (times[-1] - times[0])
    basis = np.polynomial.legendre.legvander((times - middle) / half, 3)[inside]
    level = x[part][inside][0]
    fit = np.linalg.lstsq(root[:, None] * basis, root * (x[part][inside] - level), rcond=None)[0]
    slope = np.polynomial.legendre.legder(fit)
    return float(np.polynomial.legendre.legval((t[index] - middle) / half, slope)) / half


def check(name: str, t: Samples, x: Samples, result: Samples, window_length: int) -> None:
    """Compare some of the estimates with those of NumPy, or stop."""
    random = np.random.default_rng(0)
    scale = float(np.nanmax(np.abs(result)))
    for index in [0, x.size - 1, *random.integers(0, x.size, 50).tolist()]:
        off = abs(brute(t, x, window_length, index) - float(result[index]))
        if np.isfinite(result[index]) and not off <= 1e-9 * scale:
            raise SystemExit(f"{name} is wrong at {index} by {off}, of {scale}")


def gaps(window_length: int, count: int, repeat: int) -> dict[str, float]:
    """Return the time of every call on even samples, in calls that propagate."""
    x = signal(count)
    holes = np.where(np.random.default_rng(1).random(count) < 0.05, np.nan, x)
    rare = x.copy()
    rare[:: 100 * window_length] = np.nan
    # What is timed has the weights of NumPy's fit at every sample, those of its own degree.
    design = algdiff.Differentiator(window_length, degree=3)
    out = np.zeros(count)
    times = np.arange(float(count))
    check("omit", times, holes, design(holes, nan_policy="omit", threads=1), window_length)
    check("omit", times, rare, design(rare, nan_policy="omit", threads=1), window_length)
    calls: dict[str, Callable[[], object]] = {
        "propagate": partial(design, x, threads=1, out=out),
        COPY: partial(np.copyto, out, x),
        "omit, no gaps": partial(design, x, nan_policy="omit", threads=1, out=out),
        "omit, 5 % gaps": partial(design, holes, nan_policy="omit", threads=1, out=out),
        "omit, one sample in 100 windows": partial(design, rare, nan_policy="omit", threads=1, out=out),
        "with std, sigma known": partial(design, x, return_std=True, sigma=0.1, threads=1, out=out),
        "with std": partial(design, x, return_std=True, threads=1, out=out),
        "omit, 5 % gaps, with std": partial(design, holes, nan_policy="omit", return_std=True, threads=1, out=out),
    }
    best = best_of(calls, repeat)
    return {name: seconds / best["propagate"] for name, seconds in best.items()}


def loop(fit: Callable[[Samples, Samples], float], t: Samples, x: Samples, window_length: int, count: int) -> Samples:
    """Return fits at some samples in the middle, one by one."""
    half = window_length // 2
    return np.array(
        [fit(t[i - half : i + half + 1] - t[i], x[i - half : i + half + 1]) for i in range(half, half + count)]
    )


def polyfit(t: Samples, x: Samples) -> float:
    """Return the slope at 0 of `numpy.polyfit`."""
    return float(np.polyfit(t, x, 3)[2])


def lstsq(t: Samples, x: Samples) -> float:
    """Return the slope at 0 by the fastest of SciPy's drivers."""
    from scipy import linalg

    basis = np.vander(t / t[-1], 4, increasing=True)
    return float(linalg.lstsq(basis, x, lapack_driver="gelsy", check_finite=False)[0][1] / t[-1])


def uneven(window_length: int, count: int, repeat: int) -> dict[str, float]:
    """Return the time of every call in seconds a sample."""
    random = np.random.default_rng(2)
    t = np.cumsum(random.uniform(0.5, 1.5, count))
    x, few = signal(count), 200
    design = algdiff.Differentiator(window_length, degree=3)
    check("uneven t", t, x, design(x, t=t, threads=1), window_length)
    calls: dict[str, Callable[[], object]] = {
        "algdiff": partial(design, x, t=t, threads=1),
        "algdiff, with std": partial(design, x, t=t, return_std=True, sigma=0.1, threads=1),
        "loop of numpy.polyfit": partial(loop, polyfit, t, x, window_length, few),
    }
    counts = dict.fromkeys(calls, count) | {"loop of numpy.polyfit": few}
    try:
        from scipy import interpolate
    except ImportError:
        pass
    else:
        part = min(count, 20000)
        some, values = t[:part], x[:part]
        knots = np.r_[(t[0],) * 4, some[2 : -2 : max(window_length // 4, 1)][1:-1], (some[-1],) * 4]
        splines: dict[str, Callable[[], Any]] = {
            "scipy make_lsq_spline, a knot in 1/4 window": partial(interpolate.make_lsq_spline, some, values, knots, 3),
            "scipy make_smoothing_spline, lam known": partial(
                interpolate.make_smoothing_spline, some, values, lam=float(window_length) ** 3
            ),
        }
        calls["loop of scipy.linalg.lstsq"] = partial(loop, lstsq, t, x, window_length, few)
        counts["loop of scipy.linalg.lstsq"] = few
        for name, spline in splines.items():
            calls[name] = lambda spline=spline: spline().derivative()(some)
            counts[name] = part
    best = best_of(calls, repeat, budget=10.0)
    return {name: seconds / counts[name] for name, seconds in best.items()}


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables; return 1 with --strict if a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--samples", type=int, default=10**6, metavar="N", help="default: %(default)s")
    parser.add_argument("--repeat", type=int, default=5, metavar="N", help="best of this many; default: %(default)s")
    parser.add_argument("--strict", action="store_true", help="return 1 if a target is missed")
    options = parser.parse_args(argv)
    print("\n".join(f"- {name}: {value}" for name, value in machine("scipy").items()))
    print(f"- {options.samples} float64 samples, degree 3, one thread, best of {options.repeat} interleaved repeats\n")
    missed, rows = False, []
    for window_length in WINDOWS:
        for name, calls in gaps(window_length, options.samples, options.repeat).items():
            target = TARGETS.get(name)
            missed = missed or (target is not None and calls > target)
            rows.append([window_length, name, figure(calls, 3), "" if target is None else f"at most {figure(target)}"])
        print(f"window {window_length} done", file=sys.stderr, flush=True)
    print("Even samples, in calls that propagate:\n")
    print(table(["window", "call", "times", "target"], rows))
    rows = []
    for window_length in UNEVEN:
        found = uneven(window_length, options.samples, options.repeat)
        for name, seconds in found.items():
            faster = seconds / found["algdiff"]
            target = FASTER if name.startswith("loop") else None
            missed = missed or (target is not None and faster < target)
            rows.append(
                [window_length, name, figure(1e9 * seconds, 3), figure(faster, 3), f">= {FASTER:g}" if target else ""]
            )
        missed = missed or (window_length == 51 and 1e6 * found["algdiff"] > SECONDS)
        print(f"uneven, window {window_length} done", file=sys.stderr, flush=True)
    print("\nUneven times:\n")
    print(table(["window", "call", "ns a sample", "times algdiff", "target"], rows))
    return int(options.strict and missed)


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
