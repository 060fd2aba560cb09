"""What tests share: golden values, error bounds and nasty arrays."""

from __future__ import annotations

import json
import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import algdiff
import reference

Array = npt.NDArray[np.float64]
Case = dict[str, Any]

EPS = float(np.finfo(np.float64).eps)
ENGINES = ("direct", "moments", "fft")
GOLDEN = Path(__file__).parent / "golden"


def soak(short: int, long: int) -> int:
    """Return how often something is tried: `long` if the environment holds ``ALGDIFF_SOAK=1``, as in `make soak`."""
    return long if os.environ.get("ALGDIFF_SOAK") == "1" else short


def golden(name: str) -> list[Case]:
    """Return the cases of one golden file."""
    cases: list[Case] = json.loads((GOLDEN / name).read_text(encoding="utf-8"))
    return cases


def case_id(case: Case) -> str:
    """Return the numbers that tell golden cases apart."""
    keys = ("n", "q", "N", "kappa", "mu", "tau1", "L", "pos", "method")
    return "-".join(f"{key}{case[key]}" for key in keys if key in case)


def design(*args: Any, **options: Any) -> algdiff.Differentiator:
    """Return a design whatever its noise gain."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", algdiff.DesignWarning)
        return algdiff.Differentiator(*args, **options)


def conditioning(length: int, degree: int, kappa: float, mu: float) -> float:
    """Return the condition number of sqrt(W) V^T, by which any solver may amplify rounding."""
    log_w = reference.log_base_weight(length, kappa) + reference.log_base_weight(length, mu)[::-1]
    basis = reference.orthonormal(kappa, mu, degree, (np.arange(length) + 0.5) / length)
    return float(np.linalg.cond((np.exp((log_w - log_w.max()) / 2) * basis).T))


def sum_bound(weights: Array, x: npt.ArrayLike, eps: float = EPS) -> float:
    """Return a bound for the rounding errors of one estimate, by differences or by a plain sum.

    A sum of L products in any order errs by at most L eps times the sum of their absolute values (Higham 2002, 3.1).
    The products are w_k x_k, or W_k (x_{k+1} - x_k) with |W_k| <= sum|w| and at most L of them; the differences, W
    itself and the final scaling add a few eps each.
    """
    samples = np.asarray(x, dtype=np.complex128)
    length, total = len(weights), float(np.abs(weights).sum())
    steps = float(np.abs(np.diff(samples)).max(initial=0.0))
    return (length + 8) * eps * total * (float(np.abs(samples).max(initial=0.0)) + length * steps)


def difference_bound(weights: Array, x: npt.ArrayLike, eps: float = EPS) -> float:
    """Return the bound for an estimate by differences alone: it knows no offset.

    The sum of |W_k| |x_{k+1} - x_k| is at most L max|W| max|x_{k+1} - x_k|, and every difference carries the rounding
    of its own size, not of the samples'.
    """
    cumulative = float(np.abs(np.cumsum(weights)).max())
    length, steps = len(weights), np.abs(np.diff(np.asarray(x, float)))
    return (length + 8) * eps * length * cumulative * float(steps.max(initial=0.0))


def kernel_rule(kernel: algdiff.Kernel, count: int = 60) -> tuple[Array, Array]:
    """Return points and weights for the integral of the kernel times a smooth signal, by `count` values of the kernel.

    Gauss-Jacobi for the density, which the kernel is divided by: its polynomial factor and the signal remain.
    """
    points, gauss = reference.gauss_rule(count, kernel.kappa, kernel.mu)
    log_density = kernel.kappa * np.log(points) + kernel.mu * np.log1p(-points)
    return points, gauss * kernel(points) * np.exp(reference.log_beta(kernel.kappa + 1, kernel.mu + 1) - log_density)
