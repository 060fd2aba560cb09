"""A little of everything, checked: what runs under a memory checker, and wherever a wheel was just installed."""

from __future__ import annotations

import tempfile
import threading
from pathlib import Path

import numpy as np

import algdiff
import algdiff.paper

T = np.arange(400) / 100
X = np.sin(3 * T)
TRUTH = 3 * np.cos(3 * T)


def near(found: object, bound: float = 0.2, truth: object = TRUTH) -> None:
    """Stop unless the estimates, where there are such, are near the truth."""
    errors = np.abs(np.asarray(found) - np.asarray(truth))
    assert np.nanmax(errors) < bound, np.nanmax(errors)


def arrays() -> None:
    """Differentiate by every engine, rule, mode, type and layout."""
    for engine in ("direct", "moments", "fft"):
        for dtype in (np.float64, np.float32):
            near(algdiff.differentiate(X.astype(dtype), 31, delta=0.01, engine=engine))
    for rule in ("exact", "midpoint", "cell", "trapezoid", "simpson", "hat"):
        near(algdiff.differentiate(X, 21, delta=0.01, rule=rule)[20:-20], truth=TRUTH[20:-20])
    for mode in ("fit", "nan", "nearest", "mirror", "wrap", "constant"):
        near(algdiff.differentiate(X, 21, delta=0.01, mode=mode)[20:-20], truth=TRUTH[20:-20])
    columns = np.stack([X, 2 * X, -X], axis=1)
    near(algdiff.differentiate(columns, 21, delta=0.01, axis=0, threads=2), 0.05, np.outer(TRUTH, [1, 2, -1]))
    near(algdiff.differentiate(X * (1 + 2j), 21, delta=0.01), 0.05, TRUTH * (1 + 2j))
    near(algdiff.gradient(X, 0.01, window_length=21))
    near(algdiff.savgol_filter(X, 21, 3, deriv=1, delta=0.01))


def fits() -> None:
    """Fit around gaps and at uneven times, with error bars."""
    gaps = X.copy()
    gaps[[5, 100, 101, 250]] = np.nan
    near(algdiff.differentiate(gaps, 21, delta=0.01, nan_policy="omit"))
    uneven = T + 0.003 * np.sin(np.arange(400) ** 2)
    estimates = algdiff.differentiate(np.sin(3 * uneven), 21, t=uneven, return_std=True, sigma=0.1)
    near(estimates.estimate, truth=3 * np.cos(3 * uneven))
    assert np.all(estimates.std > 0)


def analysis() -> None:
    """Ask kernels and designs what they are."""
    kernel = algdiff.Kernel(1, 3, kappa=2, mu=1.5)
    kernel(np.linspace(0, 1, 100))
    design = algdiff.Differentiator(31, delta=0.01)
    design.frequency_response(np.linspace(0, 50, 20))
    assert design.summary()
    assert algdiff.suggest(X + 0.01 * np.random.default_rng(0).standard_normal(400), delta=0.01).explain()
    for wrong in ({"window_length": 2}, {"window_length": 21, "degree": 600}, {"window_length": 21, "kappa": -2}):
        try:
            algdiff.Differentiator(**wrong)
        except ValueError:
            continue
        raise AssertionError(wrong)


def streams() -> None:
    """Push samples singly and in blocks, in several threads."""
    design = algdiff.Differentiator(21, delta=0.01, tau="newest")

    def work() -> None:
        stream = design.stream()
        single = [stream.push(value) for value in X[:200].tolist()]
        near([*single[20:], *stream.push(X[200:])], 0.2, TRUTH[20:])

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def files() -> None:
    """Differentiate a file."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "x.npy", Path(folder) / "dx.npy"
        np.save(source, X)
        algdiff.differentiate_file(source, target, window_length=21, delta=0.01)
        near(np.load(target))


def main() -> None:
    """Run all."""
    for part in (arrays, fits, analysis, streams, files):
        part()
        print(f"{part.__name__}: ok", flush=True)


if __name__ == "__main__":
    main()
