"""What the functions of this package share: arguments in the symbols of the paper, and weights by its rule."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff import _core

EPS = float(np.finfo(np.float64).eps)
_LARGEST_DEGREE = 500  # of a kernel


def order_and_degree(n: object, N: object) -> tuple[int, int]:
    order, degree = arguments.integer("n", n, 0), arguments.integer("N", N, 0)
    if degree > _LARGEST_DEGREE:
        raise ValueError(f"N must be at most {_LARGEST_DEGREE}, got {degree}")
    if degree < order:
        raise ValueError(f"N must be at least n = {order}, got {degree}")
    return order, degree


def is_causal(window: object) -> bool:
    if not isinstance(window, str):
        raise TypeError(f"window must be 'forward' or 'causal', got {window!r}")
    if window not in ("forward", "causal"):
        raise ValueError(f"window must be 'forward' or 'causal', got {window!r}")
    return window == "causal"


def windows(y: ArrayLike, degree: int, window: str) -> tuple[NDArray[Any], int]:
    """Return the samples from the origin on, in double precision, and the sign of odd derivatives there."""
    backwards = is_causal(window)
    x = arguments.samples("y", y)
    least = max(degree + 1, 2)
    if x.shape[-1] < least:
        raise ValueError(f"y must have at least {least} samples along its last axis, got {x.shape[-1]}")
    x = x.astype(np.complex128 if x.dtype.kind == "c" else np.float64, copy=False)
    return (x[..., ::-1], -1) if backwards else (x, 1)


def step_of(delta: object) -> float:
    step = arguments.real("delta", delta)
    if not 0 < step < math.inf:
        raise ValueError(f"delta must be finite and positive, got {step}")
    return step


def sampled_exponent(name: str, value: object) -> float:
    exponent = arguments.real(name, value)
    if not exponent >= 0:
        raise ValueError(
            f"{name} must be at least 0 for the trapezoidal rule, which samples the ends of the window "
            f"(algdiff.Differentiator with rule='exact' takes exponents above -1), got {exponent}"
        )
    return exponent


def trapezoid_weights(length: int, n: int, N: int, exponents: tuple[float, float], delta: float) -> NDArray[np.float64]:
    """Return the weights of the individual estimator at the origin by the trapezoidal rule."""
    plan = _core.Plan(length, n, N, *exponents, delta, "trapezoid", tau=0.0)
    weights = np.empty(length)
    plan.weights(weights)
    return weights


def digits(growth: float) -> str:
    return f"{min(math.log10(growth), 16):.0f}"
