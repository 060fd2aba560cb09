"""The readable twin of the library: naive NumPy in float64, one short function per formula of the theory.

It is written from the theory alone, so that it can disagree with the library. It loops where the library is clever and
checks little. Conventions: the window is tau in [0, 1], 0 oldest and 1 newest; the weight is tau^kappa (1-tau)^mu;
a = kappa + deriv, b = mu + deriv and q = degree - deriv as in theory section 0; the rules "exact", "midpoint" and
"cell" live on the cells grid tau_j = (j + 1/2)/L with T = L delta, the rules "trapezoid", "simpson" and "hat" on the
nodes grid tau_j = j/(L - 1) with T = (L - 1) delta. What estimates do to signals is in `reference_analysis.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

ROOT_TOLERANCE = 1e-12  # closer than this to a root, tau is that root
SAMPLE_TOLERANCE = 1e-9  # closer than this to a whole sample (relative to its index), tau lies on that sample
CELLS, NODES = ("exact", "midpoint", "cell"), ("trapezoid", "simpson", "hat")  # the rules by their grid
PAD_MODES = {"nearest": "edge", "mirror": "reflect", "wrap": "wrap", "constant": "constant"}  # name here: in np.pad


def log_beta(x: float, y: float) -> float:
    """Return ln B(x, y), the normalisation of rho in theory section 0."""
    return math.lgamma(x) + math.lgamma(y) - math.lgamma(x + y)


def pochhammer(x: float, n: int) -> float:
    """Return (x)_n = x (x+1) ... (x+n-1), the symbol of theory section 3.2."""
    return math.prod(x + i for i in range(n))


def jacobi_coefficients(alpha: float, beta: float, count: int) -> tuple[Array, Array]:
    """Return A_0..A_{count-1} and B_1..B_count of theory section 3.3 (so `B[k]` is B_{k+1})."""
    s = alpha + beta
    a, b_squared = np.empty(count), np.empty(count)
    a[:1] = (alpha + 1) / (s + 2)
    b_squared[:1] = (alpha + 1) * (beta + 1) / ((s + 2) ** 2 * (s + 3))
    for k in range(1, count):
        a[k] = 0.5 * (1 + (alpha - beta) * s / ((2 * k + s) * (2 * k + s + 2)))
    for k in range(2, count + 1):
        numerator = k * (k + alpha) * (k + beta) * (k + s)
        b_squared[k - 1] = numerator / ((2 * k + s) ** 2 * (2 * k + s + 1) * (2 * k + s - 1))
    return a, np.sqrt(b_squared)


def orthonormal(alpha: float, beta: float, degree: int, tau: npt.ArrayLike) -> Array:
    """Return p_m(tau), m = 0..degree, one row per m, by the recurrence of theory section 3.3."""
    tau = np.atleast_1d(np.asarray(tau, dtype=np.float64))
    a, b = jacobi_coefficients(alpha, beta, degree)
    p = np.ones((degree + 1, len(tau)))
    for k in range(degree):
        before = b[k - 1] * p[k - 1] if k > 0 else 0.0
        p[k + 1] = ((tau - a[k]) * p[k] - before) / b[k]
    return p


def derivative_factor(deriv: int, kappa: float, mu: float, m: int) -> float:
    """Return c_m of theory section 3.2: d^n p_m^[kappa,mu] = c_m p_{m-n}^[a,b]."""
    i = m - deriv
    rising = pochhammer(i + 1, deriv) * pochhammer(i + deriv + kappa + mu + 1, deriv)
    norms = pochhammer(kappa + mu + 2, 2 * deriv) / (pochhammer(kappa + 1, deriv) * pochhammer(mu + 1, deriv))
    return math.sqrt(rising * norms)


def derivatives(deriv: int, degree: int, kappa: float, mu: float, tau: float) -> Array:
    """Return d_m = d^n p_m^[kappa,mu](tau) for m = 0..degree, zero for m < n (theory section 3.3)."""
    d = np.zeros(degree + 1)
    shifted = orthonormal(kappa + deriv, mu + deriv, degree - deriv, tau)[:, 0]
    for m in range(deriv, degree + 1):
        d[m] = derivative_factor(deriv, kappa, mu, m) * shifted[m - deriv]
    return d


def roots(deriv: int, degree: int, kappa: float, mu: float) -> Array:
    """Return the q+1 roots of p_{q+1}^[a,b], ascending: Golub-Welsch, then Newton (theory section 5)."""
    a, b, count = kappa + deriv, mu + deriv, degree - deriv + 1
    diagonal, off = jacobi_coefficients(a, b, count)
    matrix = np.diag(diagonal) + np.diag(off[:-1], 1) + np.diag(off[:-1], -1)
    tau: Array = np.linalg.eigvalsh(matrix).astype(np.float64)
    for _ in range(2):
        slope = derivative_factor(1, a, b, count) * orthonormal(a + 1, b + 1, count - 1, tau)[-1]
        tau = tau - orthonormal(a, b, count, tau)[-1] / slope
    return tau


@cache
def gauss_rule(count: int, alpha: float, beta: float) -> tuple[Array, Array]:
    """Return nodes and weights on [0, 1], the weights summing to 1, for the density rho of theory section 0.

    The nodes are the roots of p_count^[alpha,beta]; the weights are 1 / sum_m p_m(node)^2.
    """
    nodes = roots(0, count - 1, alpha, beta)
    gauss = 1 / np.sum(orthonormal(alpha, beta, count - 1, nodes) ** 2, axis=0)
    nodes.flags.writeable = gauss.flags.writeable = False  # shared by all who ask for this rule
    return nodes, gauss


def resolve_tau(
    window_length: int | None, deriv: int, degree: int, kappa: float, mu: float, tau: float | str, rule: str = "exact"
) -> tuple[float, bool]:
    """Return tau as a number and whether it is a root (theory sections 5 and 7); no window length: continuous."""
    zeros = roots(deriv, degree, kappa, mu)
    newest = 1 - 0.5 / window_length if window_length is not None and rule in CELLS else 1.0
    words = {"center": 0.5, "root": float(zeros[-1]), "newest": newest}
    value = words[tau] if isinstance(tau, str) else float(tau)
    nearest = float(zeros[np.argmin(np.abs(zeros - value))])
    if abs(nearest - value) > ROOT_TOLERANCE:
        return value, False
    return (value if tau == "center" else nearest), True


def kernel(points: npt.ArrayLike, deriv: int, degree: int, kappa: float, mu: float, tau: float | str) -> Array:
    """Return k at the points, formula (K3) of theory section 3.2; zero outside [0, 1], infinite at a singular end."""
    points = np.atleast_1d(np.asarray(points, dtype=np.float64))
    tau, _ = resolve_tau(None, deriv, degree, kappa, mu, tau)
    inside = (points >= 0) & (points <= 1)
    t = np.where(inside, points, 0.5)
    polynomial = derivatives(deriv, degree, kappa, mu, tau) @ orthonormal(kappa, mu, degree, t)
    with np.errstate(divide="ignore", over="ignore"):  # 0^kappa is 0, 1 or inf, as it should be
        density = t**kappa * (1 - t) ** mu * math.exp(-log_beta(kappa + 1, mu + 1))
        values = np.multiply(density, polynomial, out=np.zeros_like(t), where=polynomial != 0)
    return np.where(inside, values, 0.0)


def kernel_exactness(deriv: int, degree: int, kappa: float, mu: float, tau: float | str) -> int:
    """Return the polynomial degree up to which the kernel is exact: N, one more at a root (theory section 5)."""
    return degree + int(resolve_tau(None, deriv, degree, kappa, mu, tau)[1])


def bias(deriv: int, degree: int, kappa: float, mu: float, tau: float | str) -> tuple[float, int]:
    """Return C and p of estimate - true = C T^p x^(n+p) + ..., C = -pi_p(tau)/p! (theory section 6)."""
    value, is_root = resolve_tau(None, deriv, degree, kappa, mu, tau)
    order = degree - deriv + 1 + int(is_root)
    a, b = kappa + deriv, mu + deriv
    monic = orthonormal(a, b, order, value)[-1, 0] * np.prod(jacobi_coefficients(a, b, order)[1])
    return float(-monic / math.factorial(order)), order


def norm2(deriv: int, degree: int, kappa: float, mu: float, tau: float | str) -> float:
    """Return the integral of k^2 by Gauss-Jacobi with weight tau^2kappa (1-tau)^2mu (theory section 6)."""
    if min(kappa, mu) <= -0.5:
        return math.inf
    value, _ = resolve_tau(None, deriv, degree, kappa, mu, tau)
    nodes, gauss = gauss_rule(degree + 1, 2 * kappa, 2 * mu)
    mass = math.exp(log_beta(2 * kappa + 1, 2 * mu + 1) - 2 * log_beta(kappa + 1, mu + 1))
    polynomial = derivatives(deriv, degree, kappa, mu, value) @ orthonormal(kappa, mu, degree, nodes)
    return float(mass * np.sum(gauss * polynomial**2))


def log_base_weight(window_length: int, exponent: float) -> Array:
    """Return ln u_e(j) of theory section 8.1: the cell's midpoint value for e >= 0, its average for e < 0."""
    j = np.arange(window_length)
    if exponent >= 0:
        return exponent * np.log((j + 0.5) / window_length)
    e = exponent + 1  # (j+1)^e - j^e = (j+1)^e (1 - (j/(j+1))^e), written without cancellation
    with np.errstate(divide="ignore"):
        difference = -np.expm1(e * np.log1p(-1 / (j + 1)))
    return e * np.log(j + 1) + np.log(difference) - math.log(e) - exponent * math.log(window_length)


def exact_weights(
    window_length: int,
    deriv: int,
    fit_degree: int,
    kappa: float,
    mu: float,
    tau: float,
    kept: slice | None = None,
) -> Array:
    """Return the weights of the discrete weighted fit for T = 1, by QR of sqrt(W) V^T (theory section 8.1).

    The fit may be to the `kept` samples alone, as in a trimmed window: the samples stay where they are.
    """
    kept = slice(None) if kept is None else kept
    j = np.arange(window_length)[kept]
    if len(j) < fit_degree + 1:
        raise ValueError(f"window_length={len(j)} is too short for a fit of degree {fit_degree}")
    log_w = (log_base_weight(window_length, kappa) + log_base_weight(window_length, mu)[::-1])[kept]
    root_w = np.exp((log_w - log_w.max()) / 2)
    basis = orthonormal(kappa, mu, fit_degree, (j + 0.5) / window_length)
    q, r = np.linalg.qr((root_w * basis).T)
    w: Array = root_w * (q @ np.linalg.solve(r.T, derivatives(deriv, fit_degree, kappa, mu, tau)))
    return w


def node_weights(window_length: int, design: tuple[int, int, float, float, float], factors: Array, rule: str) -> Array:
    """Return k(tau_j) on the nodes times the factors of a closed quadrature rule, for T = 1 (theory section 8)."""
    if window_length < 2 or min(design[2:4]) < 0:
        raise ValueError(f"the {rule} rule needs two samples, and kappa, mu >= 0 for finite end weights")
    return kernel(np.arange(window_length) / (window_length - 1), *design) * factors / (window_length - 1)


def trapezoid_factors(window_length: int) -> Array:
    """Return 1/2, 1, 1, ..., 1, 1/2: the paper's rule (theory section 8)."""
    factors = np.ones(window_length)
    factors[[0, -1]] = 0.5
    return factors


def simpson_factors(window_length: int) -> Array:
    """Return 1/3, 4/3, 2/3, ..., 4/3, 1/3 for an odd number of nodes (theory section 8)."""
    if window_length % 2 == 0 or window_length < 3:
        raise ValueError(f"the simpson rule needs an odd window of at least 3, got {window_length}")
    factors = np.where(np.arange(window_length) % 2 == 1, 4 / 3, 2 / 3)
    factors[[0, -1]] = 1 / 3
    return factors


def piece_rule(left: float, right: float, count: int, kappa: float, mu: float) -> tuple[Array, Array]:
    """Return points and weights that integrate rho(s) f(s) over [left, right], f smooth (theory section 8).

    Gauss-Jacobi takes over the end of [0, 1] that the piece touches, so that a singular end costs nothing; the rest of
    rho is evaluated at the points.
    """
    at_old, at_new = left == 0, right == 1
    u, gauss = gauss_rule(count, kappa if at_old else 0.0, mu if at_new else 0.0)
    width = right - left
    points = left + width * u
    to_new = (1 - right) + width * (1 - u)
    log_rho = -log_beta(kappa + 1, mu + 1) * np.ones(count)
    log_rho += kappa * math.log(width) if at_old else kappa * np.log(points)
    log_rho += mu * math.log(width) if at_new else mu * np.log(to_new)
    mass = log_beta(1 + (kappa if at_old else 0.0), 1 + (mu if at_new else 0.0))
    return points, gauss * np.exp(log_rho + mass) * width


def cell_weights(window_length: int, deriv: int, degree: int, kappa: float, mu: float, tau: float) -> Array:
    """Return the integral of k over each cell, as for piecewise constant samples, for T = 1 (theory section 8)."""
    d, count = derivatives(deriv, degree, kappa, mu, tau), quadrature_count(degree, kappa, mu)
    w = np.empty(window_length)
    for j in range(window_length):
        points, mass = piece_rule(j / window_length, (j + 1) / window_length, count, kappa, mu)
        w[j] = (d @ orthonormal(kappa, mu, degree, points)) @ mass
    return w


def hat_weights(window_length: int, deriv: int, degree: int, kappa: float, mu: float, tau: float) -> Array:
    """Return the integral of k times each hat, as for piecewise linear samples, for T = 1 (theory section 8)."""
    if window_length < 2:
        raise ValueError(f"the hat rule needs two samples, got {window_length}")
    d, count, pieces = (
        derivatives(deriv, degree, kappa, mu, tau),
        quadrature_count(degree, kappa, mu),
        window_length - 1,
    )
    w = np.zeros(window_length)
    for j in range(pieces):
        points, mass = piece_rule(j / pieces, (j + 1) / pieces, count, kappa, mu)
        values = (d @ orthonormal(kappa, mu, degree, points)) * mass
        rising = points * pieces - j
        w[j] += (1 - rising) @ values
        w[j + 1] += rising @ values
    return w


def quadrature_count(degree: int, kappa: float, mu: float) -> int:
    """Return enough Gauss points for one piece: for the polynomial, and for a density as narrow as large exponents."""
    return 32 + degree + int(max(kappa, mu) / 2)


def weights(
    window_length: int,
    deriv: int,
    degree: int,
    kappa: float,
    mu: float,
    tau: float | str,
    rule: str = "exact",
    delta: float = 1.0,
    fit_degree: int | None = None,
) -> Array:
    """Return the weights, oldest first, unit 1/delta^deriv: theory section 8 divided by T^n.

    The exact rule fits degree N, and N+1 at a root if the window holds enough samples, unless `fit_degree` says
    otherwise; the other rules fit nothing.
    """
    value, is_root = resolve_tau(window_length, deriv, degree, kappa, mu, tau, rule)
    design = (deriv, degree, kappa, mu, value)
    if rule in NODES:
        duration = (window_length - 1) * delta
        if rule == "hat":
            return hat_weights(window_length, *design) / duration**deriv
        factors = trapezoid_factors if rule == "trapezoid" else simpson_factors
        return node_weights(window_length, design, factors(window_length), rule) / duration**deriv
    duration = window_length * delta
    if rule == "midpoint":
        centers = (np.arange(window_length) + 0.5) / window_length
        return kernel(centers, *design) / window_length / duration**deriv
    if rule == "cell":
        return cell_weights(window_length, *design) / duration**deriv
    if rule != "exact":
        raise ValueError(f"rule={rule!r}; allowed: {', '.join(map(repr, CELLS + NODES))}")
    used = min(degree + int(is_root), max(degree, window_length - 1)) if fit_degree is None else fit_degree
    return exact_weights(window_length, deriv, used, kappa, mu, value) / duration**deriv


def delay_samples(window_length: int, tau: float, rule: str = "exact") -> float:
    """Return how many samples the estimate lies behind the newest one (theory section 7)."""
    return (1 - tau) * window_length - 0.5 if rule in CELLS else (1 - tau) * (window_length - 1)


@dataclass(frozen=True)
class Window:
    """One design and where its samples lie: theory sections 7 and 8."""

    length: int
    deriv: int
    degree: int
    kappa: float
    mu: float
    tau: float | str
    rule: str
    delta: float

    def weights(self, tau: float | str, fit_degree: int | None = None) -> Array:
        """Return the weights at a tau of this window (theory section 8)."""
        design = (self.length, self.deriv, self.degree, self.kappa, self.mu)
        return weights(*design, tau, self.rule, self.delta, fit_degree)

    def weights_at(self, sample: int, fit_degree: int | None = None) -> Array:
        """Return the weights at tau_j of a sample, inside the window or not: a fit of degree N (theory section 8.1)."""
        tau = (sample + 0.5) / self.length if self.rule in CELLS else sample / (self.length - 1)
        return self.weights(tau, self.degree if fit_degree is None else fit_degree)

    def interior(self) -> tuple[int, Array]:
        """Return the sample of the window that the output belongs to, and the weights there (theory section 7).

        A tau between two samples moves to the nearest one; next to a root the fit keeps its degree N+1 there.
        """
        design = (self.length, self.deriv, self.degree, self.kappa, self.mu)
        tau, is_root = resolve_tau(*design, self.tau, self.rule)
        p = tau * self.length - 0.5 if self.rule in CELLS else tau * (self.length - 1)
        if abs(p - round(p)) <= SAMPLE_TOLERANCE * max(1.0, abs(p)):
            return round(p), self.weights(self.tau)
        nearest = math.floor(p + 0.5 + SAMPLE_TOLERANCE * max(1.0, abs(p)))  # rounding must not decide between two
        return nearest, self.weights_at(nearest, min(self.degree + int(is_root), max(self.degree, self.length - 1)))

    def estimate(self, samples: Array, w: Array) -> float:
        """Return the dot product of theory section 7; weights that sum to zero see the differences from samples[0]."""
        differences = self.rule == "exact" and self.deriv >= 1
        return float(w @ (samples - samples[0] if differences else samples))


def filter_row(row: Array, window: Window, mode: str, cval: float) -> Array:
    """Return the estimates of one row: the bookkeeping of theory section 7, with the ends as `mode` says."""
    n, size = len(row), window.length
    if mode == "valid":
        w = window.weights(window.tau)
        return np.array([window.estimate(row[j : j + size], w) for j in range(n - size + 1)])
    c, w = window.interior()
    if mode in PAD_MODES:
        options = {"constant_values": cval} if mode == "constant" else {}
        padded = np.pad(row, (max(0, c), max(0, size - 1 - c)), PAD_MODES[mode], **options)  # type: ignore[call-overload]
        return np.array([window.estimate(padded[s : s + size], w) for s in range(max(0, -c), max(0, -c) + n)])
    out = np.full(n, np.nan)
    for i in range(n):
        start = i - c
        if 0 <= start <= n - size:
            out[i] = window.estimate(row[start : start + size], w)
        elif mode == "fit":  # the first or the last whole window, tau at the sample's own place in it
            whole = 0 if start < 0 else n - size
            out[i] = window.estimate(row[whole : whole + size], window.weights_at(i - whole))
    return out


def differentiate(
    x: npt.ArrayLike,
    window_length: int,
    deriv: int = 1,
    *,
    degree: int | None = None,
    kappa: float = 1.0,
    mu: float = 1.0,
    tau: float | str = "center",
    delta: float = 1.0,
    axis: int = -1,
    mode: str = "fit",
    rule: str = "exact",
    cval: complex = 0.0,
) -> npt.NDArray[np.float64] | npt.NDArray[np.complex128]:
    """Return the derivative along an axis, row by row: the estimator of theory section 8 with the time of section 7.

    Mode "valid" gives one output per whole window, at tau; every other mode one per sample, at the time of that sample.
    """
    data = np.moveaxis(np.asarray(x), axis, -1)
    n = data.shape[-1]
    if mode not in ("fit", "valid", "nan", *PAD_MODES):
        raise ValueError(f"mode={mode!r}; allowed: 'fit', 'valid', 'nan', {', '.join(map(repr, PAD_MODES))}")
    if n < (1 if mode in PAD_MODES else window_length):
        raise ValueError(f"mode={mode!r} with window_length={window_length} has too few samples: {n}")
    window = Window(window_length, deriv, deriv + 2 if degree is None else degree, kappa, mu, tau, rule, delta)
    is_complex = np.iscomplexobj(data)
    shape = (*data.shape[:-1], n - window_length + 1 if mode == "valid" else n)
    out = np.empty(shape, dtype=np.complex128 if is_complex else np.float64)
    for part in ("real", "imag") if is_complex else ("real",):  # complex data are two real passes
        for index in np.ndindex(data.shape[:-1]):
            row = getattr(data, part)[index].astype(np.float64)
            getattr(out, part)[index] = filter_row(row, window, mode, getattr(complex(cval), part))
    return np.moveaxis(out, -1, axis)
