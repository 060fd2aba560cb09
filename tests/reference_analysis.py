"""The readable twin, continued: what the estimates of `reference.py` do to signals and noise (theory sections 6 and 7).

A `design` is (deriv, degree, kappa, mu, tau) for a window of length T = 1; `deriv` is n, q = degree - deriv.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

import reference
from reference import Array

Complex = npt.NDArray[np.complex128]
Design = tuple[int, int, float, float, float]


def christoffel(design: Design, points: npt.ArrayLike) -> Array:
    """Return R_q(tau, points), the kernel (K1) of theory section 3.2 without its density and derivatives."""
    deriv, degree, kappa, mu, tau = design
    a, b, q = kappa + deriv, mu + deriv, degree - deriv
    values: Array = reference.orthonormal(a, b, q, tau)[:, 0] @ reference.orthonormal(a, b, q, points)
    return values


def low_pass(omega_t: npt.ArrayLike, design: Design) -> Complex:
    """Return G = H/(i omega)^n with phase reference 0, by Gauss-Jacobi (theory section 6): absolute error 1e-13 R_q."""
    deriv, degree, kappa, mu, _ = design
    omega = np.atleast_1d(np.asarray(omega_t, dtype=np.float64))
    count = math.ceil(np.abs(omega).max() / 2) + 40 + degree
    nodes, gauss = reference.gauss_rule(count, kappa + deriv, mu + deriv)
    return np.exp(1j * np.outer(omega, nodes)) @ (gauss * christoffel(design, nodes))


def frequency_response(omega_t: npt.ArrayLike, design: Design, origin: float | None = None) -> Complex:
    """Return H T^n with the phase reference `origin`, by default tau (theory section 6)."""
    omega = np.atleast_1d(np.asarray(omega_t, dtype=np.float64))
    phase = np.exp(-1j * omega * (design[4] if origin is None else origin))
    return (1j * omega) ** design[0] * low_pass(omega, design) * phase


def log_asymptote_constants(design: Design) -> tuple[float, float]:
    """Return ln A0 and ln A1 of theory section 6; -inf where R_q vanishes to rounding at that end."""
    deriv, degree, kappa, mu, tau = design
    a, b, q = kappa + deriv, mu + deriv, degree - deriv
    logs = []
    for end, exponent in ((0.0, a), (1.0, b)):
        terms = reference.orthonormal(a, b, q, tau)[:, 0] * reference.orthonormal(a, b, q, end)[:, 0]
        value = abs(terms.sum())
        vanishes = value <= 1e-13 * np.abs(terms).sum()
        gain = math.lgamma(exponent + 1) - reference.log_beta(a + 1, b + 1)
        logs.append(-math.inf if vanishes else gain + math.log(value))
    return logs[0], logs[1]


def cutoff(design: Design) -> float | None:
    """Return omega_c T = A^(1/s) with A of the governing end, the one of the smaller exponent (theory section 6)."""
    deriv, _, kappa, mu, _ = design
    old, new = log_asymptote_constants(design)
    governing = old if kappa < mu else new if mu < kappa else max(old, new)
    return None if governing == -math.inf else math.exp(governing / (min(kappa, mu) + deriv + 1))


def asymptotes(omega_t: npt.ArrayLike, design: Design) -> tuple[Array, Array, Array | None]:
    """Return the upper and lower bound and the low-pass model of |H| T^n for omega T > 0 (theory section 6)."""
    deriv, _, kappa, mu, _ = design
    omega = np.atleast_1d(np.asarray(omega_t, dtype=np.float64))
    log_old, log_new = log_asymptote_constants(design)
    with np.errstate(over="ignore"):  # far below the cutoff
        old = np.exp(log_old - (kappa + 1) * np.log(omega))  # omega^n A0 / omega^(kappa+n+1)
        new = np.exp(log_new - (mu + 1) * np.log(omega))
    corner = cutoff(design)
    slope = min(kappa, mu) + deriv + 1
    model = None if corner is None else omega**deriv * np.minimum(1, corner / omega) ** slope
    lower = np.abs(np.subtract(old, new, out=np.full_like(old, np.inf), where=np.isfinite(old + new)))
    return old + new, lower, model


def half_power(design: Design, step: float = 0.02) -> float:
    """Return the smallest omega T > 0 where |G| falls through 1/sqrt(2): a scan, then bisection."""
    start, at_start = 0.0, 1.0
    while True:
        grid = start + step * np.arange(1, 513)
        gain = np.abs(low_pass(grid, design))
        before = np.concatenate([[at_start], gain[:-1]])
        falls = np.flatnonzero((before >= math.sqrt(0.5)) & (gain < math.sqrt(0.5)))
        if len(falls):
            break
        start, at_start = grid[-1], gain[-1]
    high = float(grid[falls[0]])
    low = high - step
    for _ in range(60):
        middle = (low + high) / 2
        if abs(low_pass(middle, design)[0]) >= math.sqrt(0.5):
            low = middle
        else:
            high = middle
    return low


def integral_from_end(length: float, design: Design, newest: bool, weight_degree: int = 0) -> float:
    """Return the integral of k(s) s^weight_degree over the oldest or newest part of the window, length <= 1/2.

    Gauss-Jacobi at the end, whose singularity it takes over, and where a large exponent makes the rest narrow, pieces.
    """
    deriv, degree, kappa, mu, tau = design
    large = max(kappa, mu, 0.0)
    edges = length * np.linspace(0, 1, 2 + int(large / 10))
    total = 0.0
    for near, far in pairwise(edges.tolist()):
        left, right = (1 - far, 1 - near) if newest else (near, far)
        points, mass = reference.piece_rule(left, right, 64 + degree + int(2 * large**0.5), kappa, mu)
        values = reference.derivatives(deriv, degree, kappa, mu, tau) @ reference.orthonormal(kappa, mu, degree, points)
        total += float(values * points**weight_degree @ mass)
    return total


def kernel_integral(left: float, right: float, design: Design) -> float:
    """Return the integral of k over [left, right], as a difference of integrals from the nearest end."""
    if left < 0.5 < right:
        return kernel_integral(left, 0.5, design) + kernel_integral(0.5, right, design)
    if right <= 0.5:
        return integral_from_end(right, design, False) - (integral_from_end(left, design, False) if left > 0 else 0)
    return integral_from_end(1 - left, design, True) - (integral_from_end(1 - right, design, True) if right < 1 else 0)


def impulse_response(t: npt.ArrayLike, design: Design) -> Array:
    """Return k(1 - t): the output t window lengths after an impulse (theory section 7, causal use)."""
    return reference.kernel(1 - np.asarray(t, dtype=np.float64), *design)


def step_response(t: float, design: Design) -> float:
    """Return the integral of k from 1 - t to 1: the output t window lengths after a step."""
    return 0.0 if t <= 0 else kernel_integral(max(0.0, 1 - t), 1.0, design)


def sign_changes(design: Design) -> Array:
    """Return the points of (0, 1) where k changes sign: a fine scan of its polynomial factor, then bisection."""
    deriv, degree, kappa, mu, tau = design
    d = reference.derivatives(deriv, degree, kappa, mu, tau)

    def factor(points: Array) -> Array:
        values: Array = d @ reference.orthonormal(kappa, mu, degree, points)
        return values

    grid = (1 - np.cos(np.pi * np.linspace(0, 1, 4001))) / 2  # as dense towards the ends as the zeros are
    signs = np.sign(factor(grid))
    index = np.flatnonzero(signs[:-1] * signs[1:] < 0)
    low, high = grid[index], grid[index + 1]
    for _ in range(60):
        middle = (low + high) / 2
        same = np.sign(factor(middle)) == signs[index]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.sort(np.concatenate([low, grid[1:-1][signs[1:-1] == 0]]))


def norm1(design: Design) -> float:
    """Return the integral of |k|: k has one sign between two neighbouring zeros (theory section 6)."""
    edges = [0.0, *sign_changes(design).tolist(), 1.0]
    return sum(abs(kernel_integral(*pair, design)) for pair in pairwise(edges))


def bias_bound(design: Design) -> float:
    """Return B of |estimate - true| <= B T^p sup |x^(n+p)| (theory section 6)."""
    order, tau = reference.bias(*design)[1], design[4]
    return max(abs(tau), abs(1 - tau)) ** order / math.factorial(order)


def moment_delay(design: Design) -> float:
    """Return 1 minus the point whose derivative the estimate of s^(n+1) is: the delay of slow signals."""
    order = design[0] + 1
    moment = sum(integral_from_end(0.5, design, newest, order) for newest in (False, True))
    return 1 - moment / math.factorial(order)


def rmse(duration: float, noise: float, bound: float, delta: float, design: Design) -> float:
    """Return the square root of (C M T^p)^2 + sigma^2 Ts |k|^2 / T^(2n+1) (theory section 6)."""
    constant, order = reference.bias(*design)
    variance = noise**2 * delta * reference.norm2(*design) / duration ** (2 * design[0] + 1)
    return math.sqrt((constant * bound * duration**order) ** 2 + variance)


def optimal_duration(noise: float, bound: float, delta: float, design: Design) -> float:
    """Return T* for white noise (theory section 6)."""
    constant, p = reference.bias(*design)
    n = design[0]
    variance, squared_bias = noise**2 * delta * reference.norm2(*design), (constant * bound) ** 2
    return float(((2 * n + 1) * variance / (2 * p * squared_bias)) ** (1 / (2 * p + 2 * n + 1)))


def optimal_duration_bounded(noise: float, bound: float, design: Design) -> float:
    """Return T* for noise of which only a bound is known, n >= 1 (theory section 6)."""
    constant, p = reference.bias(*design)
    n = design[0]
    return float((n * noise * norm1(design) / (p * abs(constant) * bound)) ** (1 / (n + p)))


def dtft(frequency: npt.ArrayLike, weights: Array, delta: float, position: float) -> Complex:
    """Return the sum of w_j exp(2 pi i f delta (j - position)), the response of the discrete filter."""
    f = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    return np.exp(2j * np.pi * delta * np.outer(f, np.arange(len(weights)) - position)) @ weights
