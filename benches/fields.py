"""Speed of derivatives of images and volumes, in copies of the field on one thread; results are checked before.

The sigma of SciPy's `gaussian_laplace` gives it the noise gain of our Laplacian. It, `laplace` and `numpy.gradient`
estimate the same by other weights, so that there is nothing to check them against.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import algdiff
from common import COPY, best_of, figure, machine, one_thread, table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Samples = NDArray[Any]

AT_MOST = 30.0  # copies for the Laplacian of an image at window 15
WINDOW = 15


def field(shape: tuple[int, ...], dtype: str) -> Samples:
    """Return a product of slow sines with noise."""
    clean = np.ones(shape)
    for axis, size in enumerate(shape):
        clean *= np.sin(0.02 * np.arange(size) + axis).reshape([-1 if one == axis else 1 for one in range(len(shape))])
    return (clean + 0.1 * np.random.default_rng(20).standard_normal(shape)).astype(dtype)


def kernel(window_length: int, orders: Sequence[int]) -> Samples:
    """Return the product of the windows of degree 4 along all axes."""
    product: Samples = np.ones(())
    for order in orders:
        product = np.multiply.outer(product, algdiff.Differentiator(window_length, order, degree=4).weights)
    return product


def check(name: str, result: Samples, f: Samples, weights: Samples, window_length: int) -> None:
    """Compare some of the results with the plain sum over their box in long double, or stop."""
    half, eps = window_length // 2, float(np.finfo(result.dtype).eps)
    # Every axis adds at most window_length products to every sum, and the differences it runs on as many again.
    bound = f.ndim * 4 * (window_length + 8) * eps * float(np.abs(weights).sum()) * float(np.abs(f).max())
    random = np.random.default_rng(0)
    for _ in range(50):
        place = [int(random.integers(half, size - half)) for size in f.shape]
        box = f[tuple(slice(one - half, one + half + 1) for one in place)].astype(np.longdouble)
        off = abs(float((box * weights).sum() - result[tuple(place)]))
        if not off <= bound:
            raise SystemExit(f"{name} is wrong at {place} by {off}, bound {bound}")


def check_all(f: Samples, window_length: int) -> None:
    """Check whatever is timed and ours."""
    axes = range(f.ndim)
    unit = np.eye(f.ndim, dtype=int)
    seconds = {(i, j): kernel(window_length, unit[i] + unit[j]) for i in axes for j in axes}
    trace = np.sum([seconds[i, i] for i in axes], axis=0)
    check("laplacian", algdiff.laplacian(f, window_length, threads=1), f, trace, window_length)
    every = algdiff.hessian(f, window_length, threads=1)
    for (i, j), weights in seconds.items():
        check(f"hessian[{i}, {j}]", every[i, j], f, weights, window_length)
    firsts = algdiff.gradient(f, window_length=window_length, degree=4, smooth=True, threads=1)
    for i in axes:
        check(f"gradient[{i}]", firsts[i], f, kernel(window_length, unit[i]), window_length)


def sigma_like(window_length: int, ndim: int) -> float:
    """Return the width of the Gaussian whose Laplacian has the noise gain of ours, in samples.

    The noise gain of the Laplacian of a Gaussian is the integral of ``|k|**4 exp(-sigma**2 |k|**2) / (2 pi)**n``, which
    is ``n (n + 2) / 4 / (2 sqrt(pi))**n / sigma**(n + 4)``.
    """
    unit = 2 * np.eye(ndim, dtype=int)
    gain = float((np.sum([kernel(window_length, orders) for orders in unit], axis=0) ** 2).sum())
    return float((ndim * (ndim + 2) / 4 / (2 * np.sqrt(np.pi)) ** ndim / gain) ** (1 / (ndim + 4)))


def calls(f: Samples, window_length: int) -> dict[str, Callable[[], object]]:
    """Return what is timed."""
    ours: dict[str, Any] = {"window_length": window_length, "threads": 1}
    timed: dict[str, Callable[[], object]] = {
        COPY: partial(np.copyto, np.zeros_like(f), f),
        "laplacian": partial(algdiff.laplacian, f, **ours),
        "laplacian smooth=False": partial(algdiff.laplacian, f, smooth=False, **ours),
        "hessian": partial(algdiff.hessian, f, **ours),
        "gradient smooth=True": partial(algdiff.gradient, f, smooth=True, degree=4, **ours),
        "gradient": partial(algdiff.gradient, f, degree=4, **ours),
        "numpy.gradient": partial(np.gradient, f),
    }
    try:
        from scipy import ndimage
    except ImportError:
        return timed
    sigma = sigma_like(window_length, f.ndim)
    timed[f"scipy gaussian_laplace, sigma {figure(sigma)}"] = partial(ndimage.gaussian_laplace, f, sigma)
    timed["scipy laplace, 3 samples"] = partial(ndimage.laplace, f)
    return timed


def measure(shape: tuple[int, ...], dtype: str, window_length: int, repeat: int) -> dict[str, float]:
    """Check, then time: copies of every call."""
    f = field(shape, dtype)
    check_all(f, window_length)
    best = best_of(calls(f, window_length), repeat, unit=COPY)
    return {name: seconds / best[COPY] for name, seconds in best.items()}


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return 1 with --strict if the target is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--side", type=int, default=2048, metavar="N", help="of the image; default: %(default)s")
    parser.add_argument("--repeat", type=int, default=7, metavar="N", help="best of this many; default: %(default)s")
    parser.add_argument("--windows", type=int, nargs="+", default=[WINDOW, 31], metavar="N", help="odd")
    parser.add_argument("--strict", action="store_true", help="return 1 if the target is missed")
    options = parser.parse_args(argv)
    print("\n".join(f"- {name}: {value}" for name, value in machine("scipy").items()))
    print(f"- copies of the field, one thread, best of {options.repeat} interleaved repeats\n", flush=True)
    side, missed, rows = options.side, False, []
    depth = max(round(side ** (2 / 3)), 40)
    for shape, dtype in (((side, side), "float64"), ((side, side), "float32"), ((depth,) * 3, "float64")):
        for window_length in options.windows:
            found = measure(shape, dtype, window_length, options.repeat)
            title = f"{' x '.join(map(str, shape))} {dtype}, window {window_length}"
            target = len(shape) == 2 and dtype == "float64" and window_length == WINDOW
            missed = missed or (target and found["laplacian"] > AT_MOST)
            for name, copies in found.items():
                limit = f"at most {figure(AT_MOST)}" if target and name == "laplacian" else ""
                rows.append([title, name, figure(copies, 3), limit])
            print(f"{title} done", file=sys.stderr, flush=True)
    print(table(["field", "call", "copies", "target"], rows))
    return int(options.strict and missed)


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
