"""Print, as JSON, what the AlgDiff toolbox (PyPI `algdiff` 2.4) says of a grid of its differentiators.

Run it by a Python that has the toolbox, never by one that has this library: on case-insensitive file systems the two
packages are one name. It uses nothing of this project.
"""

from __future__ import annotations

import json
import math
import warnings
from typing import Any

import numpy as np

# alpha, beta, N, theta (None: the toolbox's own choice), and whether theta is a root of its Jacobi polynomial
GRID: list[tuple[float, float, int, float | None, bool]] = [
    (1.0, 1.0, 0, None, True),
    (2.0, 2.0, 0, None, True),
    (5.0, 5.0, 0, None, True),
    (2.0, 3.0, 1, None, True),
    (3.0, 2.0, 1, None, True),
    (2.5, 2.5, 1, 1.0, False),
    (1.5, 3.25, 2, None, True),
    (4.0, 2.0, 2, 1.0, False),
    (3.0, 3.0, 1, 1.1, False),
    (0.5, 0.75, 1, None, True),
    (2.0, 2.0, 2, 0.0, True),
    (10.0, 10.0, 1, None, True),
    (2.0, 5.0, 3, -0.3, False),
    (12.0, 8.0, 2, None, True),
]
WINDOW, STEP = 0.5, 1 / 32  # a whole number of samples in binary, too: the toolbox truncates T/ts
METHODS = ["mid-point", "trapezoidal", "analytic", "analytic trapezoidal"]


def numbers(values: Any) -> list[float | None]:
    """Return floats for JSON, None where the toolbox says NaN."""
    return [float(v) if math.isfinite(v) else None for v in np.ravel(np.asarray(values, dtype=np.float64))]


def describe(alpha: float, beta: float, size: int, theta: float | None, is_root: bool) -> dict[str, Any]:
    """Return what the toolbox says of one differentiator."""
    from AlgDiff import AlgebraicDifferentiator  # here: test runs import this file to look for doctests

    ours = AlgebraicDifferentiator(ts=STEP, alpha=alpha, beta=beta, N=size, T=WINDOW, display=False, corr=False)
    if theta is not None:
        ours.set_theta(theta, is_root)
    orders = [n for n in range(3) if min(alpha, beta) > n - 1]
    t = WINDOW * np.array([0.03, 0.2, 0.45, 0.7, 0.96])
    omega = np.array([0.5, 4.0, 20.0, 150.0, 2000.0])
    amplitude, phase = ours.get_ampAndPhaseFilter(omega)
    upper, lower, low_pass = ours.get_asymptotesAmpFilter(omega.copy())
    methods = [m for m in METHODS if m != "trapezoidal" or min(alpha, beta) >= max(orders)]  # ends must be finite
    weights = {m: {n: numbers(ours.discretize(n, method=m)[n][m]) for n in orders} for m in methods}
    return {
        "alpha": alpha,
        "beta": beta,
        "N": size,
        "theta": float(ours.get_theta()),
        "T": WINDOW,
        "ts": STEP,
        "t": numbers(t),
        "kernel": {n: numbers(ours.evalKernelDer(t.copy(), n)) for n in orders},
        "step": numbers(ours.get_stepResponse(t.copy())),
        "integral": numbers([ours.get_integralKernel(float(at)) for at in t]),
        "omega": numbers(omega),
        "amplitude": numbers(amplitude),
        "phase": numbers(phase),
        "upper": numbers(upper),
        "lower": numbers(lower),
        "low_pass": numbers(low_pass),
        "cutoff": numbers(ours.get_cutoffFreq())[0],
        "delay": float(ours.get_delay()),
        "exactness": {n: int(ours.get_degreeExactness(n)) for n in orders},
        "attenuation": numbers(ours.get_ratioNyquistCutoff(orders)),
        "weights": weights,
    }


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    print(json.dumps([describe(*case) for case in GRID], indent=None, separators=(",", ":")))
