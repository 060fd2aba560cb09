"""The source's estimators: its equations in exact arithmetic, its misprints, golden values, equality with `Kernel`."""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Callable
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy import special

import algdiff
from algdiff import paper
from support import EPS, Array, Case, case_id, golden

Operator = dict[tuple[int, int], int]  # {(k, m): factor} of s^k (d/ds)^m, applied to y^

INTEGERS = [
    (n, N, kappa, mu) for N in range(6) for n in range(N + 1) for kappa, mu in [(0, 0), (3, 0), (0, 2), (1, 3), (2, 2)]
]
REALS = [
    (n, N, kappa, mu)
    for n, N in [(0, 0), (0, 2), (1, 1), (1, 2), (1, 3), (2, 3), (2, 5), (4, 7)]
    for kappa, mu in [(0.0, 0.0), (0.5, 2.25), (2.0, 1.0), (7.5, 0.25)]
]
POINTS = [Fraction(i, 16) for i in range(17)]
TAU = np.array([float(point) for point in POINTS])
# What golden/README.md allows a kernel, relative to its largest value.
KERNEL = 1e-13


def derivative(terms: Operator, times: int = 1) -> Operator:
    """Return the derivative by s, by the product rule."""
    for _ in range(times):
        result: Operator = {}
        for (k, m), factor in terms.items():
            for key, share in (((k - 1, m), k * factor), ((k, m + 1), factor)):
                result[key] = result.get(key, 0) + share
        terms = {key: factor for key, factor in result.items() if factor}
    return terms


def times_s(terms: Operator, power: int) -> Operator:
    return {(k + power, m): factor for (k, m), factor in terms.items()}


def added(parts: list[tuple[int | Fraction, Operator]]) -> dict[tuple[int, int], int | Fraction]:
    total: dict[tuple[int, int], int | Fraction] = {}
    for scale, terms in parts:
        for key, factor in terms.items():
            total[key] = total.get(key, 0) + scale * factor
    return {key: factor for key, factor in total.items() if factor}


def annihilating(n: int, N: int, kappa: int) -> Operator:
    """Return Pi_kappa^{N,n} s^{N+1}, the operator of (6)."""
    return derivative(times_s(derivative({(N + 1, 0): 1}, N - n), -1), n + kappa)


def horner(coefficients: list[Fraction], point: Fraction) -> Fraction:
    value = Fraction(0)
    for c in reversed(coefficients):
        value = value * point + c
    return value


def rodrigues(n: int, kappa: float, mu: float, tau: Array) -> Array:
    """Return the minimal kernel in closed form, theory section 3.1."""
    jacobi = special.eval_jacobi(n, mu, kappa, 2 * tau - 1)
    values: Array = tau**kappa * (1 - tau) ** mu * jacobi * math.factorial(n) / special.beta(kappa + n + 1, mu + n + 1)
    return values


def trapezoid(n: int, N: int, kappa: float, mu: float, tau: float, length: int, delta: float) -> Array:
    """Return the weights of the same estimator by `Differentiator`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", algdiff.DesignWarning)
        options = {"degree": N, "kappa": kappa, "mu": mu, "tau": tau, "delta": delta}
        return algdiff.Differentiator(length, n, rule="trapezoid", **options).weights  # type: ignore[arg-type]


def solved(N: int, nu: int, T: float, tau: Array) -> Array:
    """Return P^-1 Q(tau) by a general solver."""
    P, Q = paper.simultaneous_matrices(N, nu, T)
    columns: Array = np.linalg.solve(P, Q(tau)).astype(np.float64)
    return columns


# Golden values, within the tolerances of golden/README.md.


@pytest.mark.parametrize("case", golden("simultaneous.json"), ids=lambda c: f"N{c['N']}-nu{c['nu']}-T{c['T']}")
def test_golden_simultaneous(case: Case) -> None:
    N, nu, T = case["N"], case["nu"], case["T"]
    P, Q = paper.simultaneous_matrices(N, nu, T)
    u = np.array(case["tau_over_T"])
    np.testing.assert_allclose(P, case["P"], rtol=1e-13, atol=0)
    expected = np.array(case["Q_columns"]).T
    error = np.abs(Q(u * T) - expected).max(axis=1)
    assert (error <= 1e-13 * np.abs(expected).max(axis=1)).all()
    # A condition number is that of its matrix to the precision in which systems with it are solved.
    assert paper.condition_number(N, nu, T) == pytest.approx(case["cond2"], rel=1e-10)
    kernels = np.array(case["kernel_columns"]).T
    for n in range(N + 1):
        size = np.abs(kernels[n]).max()
        assert np.abs(solved(N, nu, T, u * T)[n] - kernels[n]).max() <= 1e-10 * size
        kernel = paper.simultaneous_kernel(n, N, nu)(u) / T ** (n + 1)
        assert np.abs(kernel - kernels[n]).max() <= KERNEL * size


@pytest.mark.parametrize("case", golden("annihilator.json"), ids=case_id)
def test_golden_annihilator(case: Case) -> None:
    words = case["n"], case["N"], case["kappa"], case["mu"]
    exact = [Fraction(c) for c in case["coeffs_ascending"]]
    assert paper.annihilator_coefficients(*words) == exact
    expected = np.array([float(horner(exact, point)) for point in POINTS])
    assert np.abs(paper.annihilator_kernel(*words)(TAU) - expected).max() <= KERNEL * np.abs(expected).max()


@pytest.mark.parametrize("case", golden("lambdas.json"), ids=lambda c: c["id"])
def test_golden_lambdas(case: Case) -> None:
    n, N, kappa, mu, tau = (case[name] for name in ("n", "N", "kappa", "mu", "tau1"))
    values = paper.lambdas(n, N, kappa, mu, tau)
    expected = np.array(case["lam"])
    assert np.abs(values - expected).max() <= 1e-13 * np.abs(expected).sum()
    inner = TAU[1:-1]  # negative exponents are infinite at the ends
    minimal = [paper.minimal_kernel(n, k, m)(inner) for k, m in zip(case["kappa_l"], case["mu_l"], strict=True)]
    size = sum(abs(factor) * np.abs(kernel).max() for factor, kernel in zip(values, minimal, strict=True))
    assert np.abs(values @ minimal - algdiff.Kernel(n, N, kappa, mu, tau)(inner)).max() <= KERNEL * size


# (3) to (5).


@pytest.mark.parametrize("N", range(7))
@pytest.mark.parametrize("extra", [0, 1, 3])
@pytest.mark.parametrize("T", [1.0, 0.5])
def test_solving_5_gives_the_kernel_with_kappa_0(N: int, extra: int, T: float) -> None:
    nu = N + 2 + extra
    rows = solved(N, nu, T, T * TAU)
    for n in range(N + 1):
        kernel = algdiff.Kernel(n, N, 0, extra, 0.0)
        assert paper.simultaneous_kernel(n, N, nu) == kernel
        expected = kernel(TAU) / T ** (n + 1)
        # T is a power of two, which scales rows and columns without rounding: the condition is that of T = 1.
        allowed = KERNEL + 8 * (N + 1) * EPS * paper.condition_number(N, nu)
        assert np.abs(rows[n] - expected).max() <= allowed * np.abs(expected).max()


def exact_row(N: int, nu: int, i: int, sign: int) -> Callable[[int], Fraction]:
    """Return m -> integral of Q_i(tau) tau^m / m! over [0, 1], exactly, with the exponents nu - N - 2 + sign l.

    Terms with a negative factorial are left out, as the source would need.
    """

    def integral(m: int) -> Fraction:
        total = Fraction(0)
        for k in range(i + 1):
            e = nu - N - 2 + sign * k
            if e < 0:
                continue
            factor = Fraction(
                math.comb(i, k) * math.perm(N + 1, k) * (-1) ** (i - k), math.factorial(e) * math.factorial(m)
            )
            r = i - k + m
            total += factor * Fraction(math.factorial(e) * math.factorial(r), math.factorial(e + r + 1))
        return total

    return integral


@pytest.mark.parametrize(("N", "nu"), [(1, 3), (2, 4), (2, 6), (3, 8), (4, 6), (5, 12)])
def test_q_needs_the_other_sign_than_printed(N: int, nu: int) -> None:
    P = [
        [Fraction(math.perm(N - j, i), math.factorial(nu - N + i + j - 1)) for j in range(N + 1)] for i in range(N + 1)
    ]
    for i in range(N + 1):
        corrected, printed = exact_row(N, nu, i, 1), exact_row(N, nu, i, -1)
        assert [corrected(m) for m in range(N + 1)] == P[i]
        assert i == 0 or [printed(m) for m in range(N + 1)] != P[i]
    np.testing.assert_allclose(
        paper.simultaneous_matrices(N, nu)[0], np.array([[float(p) for p in row] for row in P]), rtol=1e-13
    )


def test_condition_numbers_of_the_theory() -> None:
    for N, least, more in [
        (2, 69, 383),
        (3, 1.3e3, 2.4e4),
        (5, 1.2e6, 2.4e8),
        (8, 1.5e11, 1.1e15),
        (10, 7.3e14, 6.3e19),
    ]:
        assert paper.condition_number(N, N + 2) == pytest.approx(least, rel=0.05)
        assert paper.condition_number(N, 2 * N + 2) == pytest.approx(more, rel=0.05)
    assert paper.condition_number(5, 7, 0.1) == pytest.approx(1.9e15, rel=0.05)
    P, _ = paper.simultaneous_matrices(4, 6, 0.5)
    # numpy's smallest singular value errs by eps times the largest.
    condition = paper.condition_number(4, 6, 0.5)
    assert condition == pytest.approx(float(np.linalg.cond(P)), rel=16 * EPS * condition)


def test_condition_numbers_fall_to_a_factorial_with_the_unit_of_time() -> None:
    # The entries i! T^(nu-1) / (nu-1)! on the other diagonal outgrow all others, of lower powers of T.
    for N in (2, 5, 8):
        assert paper.condition_number(N, N + 2, 1e7) == pytest.approx(math.factorial(N), rel=1e-3)


def test_q_is_zero_outside_of_the_window_and_takes_any_shape() -> None:
    _, Q = paper.simultaneous_matrices(2, 4, 0.5)
    tau = np.linspace(-0.1, 0.6, 24).reshape(2, 3, 4)
    values = Q(tau)
    assert values.shape == (3, 2, 3, 4)
    outside = (tau < 0) | (tau > 0.5)
    assert not values[:, outside].any()
    assert values[:, ~outside].all(axis=0).any()
    np.testing.assert_array_equal(Q(tau[1, 2, 0]), values[:, 1, 2, 0])
    assert Q([]).shape == (3, 0)
    assert np.isnan(Q(math.nan)).all()
    with pytest.raises(TypeError, match="tau must be real numbers, got dtype"):
        Q(["a"])


# (6) to (8), Lemma 1.


@pytest.mark.parametrize(("n", "N", "kappa", "mu"), INTEGERS)
def test_6_is_the_kernel_at_the_origin(n: int, N: int, kappa: int, mu: int) -> None:
    exact = paper.annihilator_coefficients(n, N, kappa, mu)
    assert len(exact) == N + kappa + mu + 1
    for m in range(N + 1):
        moment = sum(c / (i + m + 1) for i, c in enumerate(exact))
        assert moment == (math.factorial(n) if m == n else 0)
    expected = np.array([float(horner(exact, point)) for point in POINTS])
    kernel = paper.annihilator_kernel(n, N, kappa, mu)
    assert kernel == algdiff.Kernel(n, N, kappa, mu, 0.0)
    assert np.abs(kernel(TAU) - expected).max() <= KERNEL * np.abs(expected).max()


@pytest.mark.parametrize(("n", "N", "kappa", "mu"), REALS)
def test_6_with_real_exponents_is_the_kernel_at_the_origin(n: int, N: int, kappa: float, mu: float) -> None:
    # lambda_l(0) of theory section 3.4 with Gamma functions, and minimal kernels in closed form.
    p, q = n + kappa, N - n
    factors = [(-1) ** (q - j) * special.binom(p + q - j, q - j) * special.binom(p + q + 1, j) for j in range(q + 1)]
    terms = [factor * rodrigues(n, kappa + q - j, mu + j, TAU) for j, factor in enumerate(factors)]
    error = np.abs(sum(terms) - paper.annihilator_kernel(n, N, kappa, mu)(TAU))
    assert error.max() <= KERNEL * sum(np.abs(term).max() for term in terms)
    assert np.abs(paper.lambdas(n, N, kappa, mu, 0.0) - factors).max() <= 1e-13 * np.abs(factors).sum()


@pytest.mark.parametrize(("n", "N", "kappa", "mu"), INTEGERS)
def test_lemma_1_holds_over_the_corrected_range_only(n: int, N: int, kappa: int, mu: int) -> None:
    p, q = n + kappa, N - n
    family = paper.lemma1(n, N, kappa, mu)
    assert [(k, m) for k, m, _ in family] == [(kappa + q - j, mu + j) for j in range(q + 1)]
    assert [factor for _, _, factor in family] == [
        (-1) ** (q - j) * math.comb(p + q - j, q - j) * math.comb(p + q + 1, j) for j in range(q + 1)
    ]

    def total(members: list[tuple[int, int, Fraction]]) -> list[Fraction]:
        parts = [[factor * c for c in paper.annihilator_coefficients(n, n, k, m)] for k, m, factor in members]
        return [sum(column, Fraction(0)) for column in zip(*parts, strict=True)]

    exact = paper.annihilator_coefficients(n, N, kappa, mu)
    assert total(family) == exact
    if q > p:  # the printed range min(n + kappa, N - n) is shorter
        assert total(family[: p + 1]) != exact


def expansion(
    n: int, N: int, kappa: int, last: Callable[[int, int, int], int]
) -> dict[tuple[int, int], int | Fraction]:
    """Return the second line of (8) with the upper limit `last(p, q, i)` of j."""
    p, q = n + kappa, N - n
    parts: list[tuple[int | Fraction, Operator]] = []
    for i in range(q + 1):
        for j in range(i, last(p, q, i) + 1):
            a = Fraction(
                math.comb(q, i) * math.comb(p, j - i) * math.factorial(q + 1), (q + 1 - i) * math.factorial(q - j)
            )
            parts.append((a, times_s(annihilating(n, n, kappa + q - j), q - j)))
    return added(parts)


@pytest.mark.parametrize("N", range(6))
def test_8_needs_the_other_limit_than_printed(N: int) -> None:
    for n, kappa in product(range(N + 1), range(3)):
        operator = added([(1, annihilating(n, N, kappa))])
        assert expansion(n, N, kappa, lambda p, q, i: min(p + i, q)) == operator
    if N == 2:  # equation (14), with the printed limit
        assert expansion(1, 2, 0, lambda p, q, i: min(p, q - i)) != added([(1, annihilating(1, 2, 0))])


@pytest.mark.parametrize("kappa", range(4))
def test_9_and_14_as_printed(kappa: int) -> None:
    # Brackets times s^(mu+1), and the operator times s^(mu+1) s^-nu with nu = N + 1 + mu.
    nine: Operator = {(0, kappa + 1): 1, (-1, kappa): kappa + 1}
    assert times_s(annihilating(1, 1, kappa), -1) == nine
    fourteen = added(
        [
            (1, {(0, kappa + 2): 1, (-1, kappa + 1): kappa + 2}),
            (kappa + 3, {(-1, kappa + 1): 1, (-2, kappa): kappa + 1}),
        ]
    )
    assert times_s(annihilating(1, 2, kappa), -2) == fourteen


# (9) to (17).


@pytest.mark.parametrize(("kappa", "mu"), [(0, 0), (2, 2), (1, 3), (4, 0)])
def test_10_and_13(kappa: int, mu: int) -> None:
    factor = (mu + 2) * math.comb(mu + kappa + 3, kappa + 1)
    expected = factor * ((mu + kappa + 2) * TAU - (kappa + 1)) * TAU**kappa * (1 - TAU) ** mu
    kernel = paper.minimal_kernel(1, kappa, mu)
    assert np.abs(kernel(TAU) - expected).max() <= KERNEL * np.abs(expected).max()
    assert paper.delay(kappa, mu) == (kappa + 2) / (mu + kappa + 4)
    assert kernel.tau == pytest.approx(paper.delay(kappa, mu), abs=1e-15)


@pytest.mark.parametrize("n", range(5))
def test_delays_for_every_order_are_where_one_more_degree_is_exact(n: int) -> None:
    for kappa, mu in [(0.0, 0.0), (-0.5, 2.0), (3.0, 0.25)]:
        assert paper.minimal_kernel(n, kappa, mu).exactness == n + 1
        assert algdiff.Kernel(n, n, kappa, mu, paper.delay(kappa, mu, n)).exactness == n + 1


@pytest.mark.parametrize(("kappa", "mu"), [(0, 0), (2, 1), (0, 3)])
@pytest.mark.parametrize("tau", [0.0, 0.25, 0.9])
def test_15_and_17_are_projections(kappa: int, mu: int, tau: float) -> None:
    """The kernel of degree 2 against the derivative of a polynomial y, projected on P_0 and P_1 by exact moments."""
    a, b = kappa + 1, mu + 1

    def inner(f: np.polynomial.Polynomial, g: np.polynomial.Polynomial) -> float:
        return float(sum(c * special.beta(a + 1 + i, b + 1) for i, c in enumerate((f * g).coef)))

    p0, p1 = np.polynomial.Polynomial([1.0]), np.polynomial.Polynomial([-paper.delay(kappa, mu), 1.0])
    y = np.polynomial.Polynomial([0.5, -1.0, 2.0, 1.5, -3.0, 1.0])
    expected = sum(p(tau) * inner(p, y.deriv()) / inner(p, p) for p in (p0, p1))
    factors = paper.lambdas(1, 2, kappa, mu, tau)
    estimate = 0.0
    for (k, m, _), factor in zip(paper.lemma1(1, 2, kappa, mu), factors, strict=True):
        kernel = np.polynomial.Polynomial([float(c) for c in paper.annihilator_coefficients(1, 1, k, m)])
        estimate += factor * float((kernel * y).integ()(1.0))
    # Polynomials of degree 5 + kappa + mu + 2 with coefficients up to some 1e3.
    assert estimate == pytest.approx(expected, abs=1e4 * np.abs(factors).sum() * EPS)


@pytest.mark.parametrize(("kappa", "mu"), [(0.0, 0.0), (0.5, 2.0), (3.0, 1.0)])
@pytest.mark.parametrize("tau", [0.0, 0.3, 0.7236, 1.0])
def test_lambdas_of_the_paper(kappa: float, mu: float, tau: float) -> None:
    first = (kappa + 3) - (mu + kappa + 5) * tau
    expected = np.array([1 - first, first])  # (16) counts the other way
    values = paper.lambdas(1, 2, kappa, mu, tau)
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-13 * np.abs(expected).sum())
    a, c = kappa + 1, kappa + mu + 6
    one, two = c * tau - (a + 1), ((a + 1) * (a + 2) - 2 * c * (a + 2) * tau + c * (c + 1) * tau**2) / 2
    expected = np.array([two, one - 2 * two, 1 - one + two])
    size = (a + 2) ** 2 + c**2  # of the terms of `two`
    np.testing.assert_allclose(paper.lambdas(1, 3, kappa, mu, tau), expected, rtol=0, atol=8 * EPS * size)


def exact_lambdas(n: int, q: int, kappa: float, mu: float, tau: float) -> list[Fraction]:
    """Solve the linear system of theory section 4 in rational numbers."""
    a, t = Fraction(kappa) + n, Fraction(tau)
    c = Fraction(kappa) + Fraction(mu) + 2 * n + q + 2

    def rising(x: Fraction, m: int) -> Fraction:
        return math.prod((x + i for i in range(m)), start=Fraction(1))

    rows = [[rising(a + q - j + 1, m) for j in range(q + 1)] + [rising(c, m) * t**m] for m in range(q + 1)]
    for i in range(q + 1):
        pivot = next(r for r in range(i, q + 1) if rows[r][i])
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for r in range(q + 1):
            if r != i:
                rows[r] = [x - rows[r][i] * y for x, y in zip(rows[r], rows[i], strict=True)]
    return [row[-1] for row in rows]


@pytest.mark.parametrize("q", [0, 1, 2, 3, 5, 8, 16, 32])
@pytest.mark.parametrize("tau", [0.0, 0.3, 0.5, 0.8, 1.0, -0.25, 1.5])
def test_lambdas_solve_their_system(q: int, tau: float) -> None:
    for n, kappa, mu in [(0, 0.0, 0.0), (1, -0.9, 1e4), (3, 10.0, -0.5), (2, 0.3, 1.7), (0, 1e4, 0.25)]:
        exact = exact_lambdas(n, q, kappa, mu, tau)
        values = paper.lambdas(n, n + q, kappa, mu, tau)
        error = max(abs(Fraction(value) - expected) for value, expected in zip(values, exact, strict=True))
        # At the ends all terms have one sign, and the recurrences err by a few eps a step.
        assert error <= (4 * q + 8) * Fraction(EPS) * sum(map(abs, exact))


def test_lambdas_take_many_points() -> None:
    tau = (np.arange(12) / 8 - 0.25).reshape(3, 4)  # so that 1 - tau is exact
    values = paper.lambdas(2, 5, 0.5, 1, tau)
    assert values.shape == (3, 4, 4)
    for index in np.ndindex(3, 4):
        np.testing.assert_array_equal(values[index], paper.lambdas(2, 5, 0.5, 1, tau[index]))
    mirrored = paper.lambdas(2, 5, 1, 0.5, 1 - tau)[..., ::-1]
    assert (np.abs(mirrored - values).max(axis=-1) <= 40 * EPS * np.abs(values).sum(axis=-1)).all()


@pytest.mark.parametrize(("n", "N"), [(1, 2), (1, 3), (2, 3), (0, 2), (3, 6)])
@pytest.mark.parametrize(("kappa", "mu"), [(0.0, 0.0), (2.0, 0.5)])
def test_tau1_is_the_root_of_least_delay(n: int, N: int, kappa: float, mu: float) -> None:
    forward, causal = (paper.tau1(n, N, kappa, mu, window) for window in ("forward", "causal"))
    roots = algdiff.Kernel(n, N, kappa, mu).roots
    assert (forward, causal) == (roots.min(), roots.max())
    assert forward < paper.delay(kappa, mu, n) < causal
    assert algdiff.Kernel(n, N, kappa, mu, causal).exactness == N + 1


def test_tau2_of_the_paper_is_common_to_odd_degrees() -> None:
    for kappa in (0.0, 1.5):
        for N in (1, 3, 5):
            assert np.abs(algdiff.Kernel(1, N, kappa, kappa).roots - 0.5).min() <= EPS
    np.testing.assert_allclose(paper.lambdas(1, 3, 0, 0, 0.5), [-0.75, 2.5, -0.75], rtol=0, atol=4e-13)


# Estimates from samples.


@pytest.mark.parametrize(("n", "N", "kappa", "mu"), [case for case in REALS if case[1] <= 5])
@pytest.mark.parametrize("tau", [0.0, 0.5, 0.9, 1.0])
def test_combinations_are_the_trapezoidal_kernel(n: int, N: int, kappa: float, mu: float, tau: float) -> None:
    rng = np.random.default_rng(n + 10 * N)
    length, delta = 33, 0.1
    y = rng.standard_normal((3, length))
    factors = np.abs(paper.lambdas(n, N, kappa, mu, tau))
    peaks = [
        np.abs(paper.minimal_kernel(n, kappa + N - n - j, mu + j)(np.linspace(0, 1, 65))).max()
        for j in range(N - n + 1)
    ]
    allowed = KERNEL * float(factors @ peaks) / (32 * delta) ** n * np.abs(y).max()
    expected = y @ trapezoid(n, N, kappa, mu, tau, length, delta)
    assert np.abs(paper.combination(y, n, N, kappa, mu, tau, delta) - expected).max() <= allowed
    if tau == 0:
        assert np.abs(paper.annihilator(y, n, N, kappa, mu, delta) - expected).max() <= allowed
        mirrored = y @ trapezoid(n, N, mu, kappa, 1.0, length, delta)
        assert np.abs(paper.annihilator(y, n, N, kappa, mu, delta, "causal") - mirrored).max() <= allowed


@pytest.mark.parametrize("N", range(5))
@pytest.mark.parametrize("nu_extra", [0, 2])
@pytest.mark.parametrize("window", ["forward", "causal"])
def test_simultaneous_estimates_are_the_individual_ones(N: int, nu_extra: int, window: str) -> None:
    y = np.random.default_rng(N).standard_normal((2, 3, 41))
    delta = 0.05
    estimates = paper.simultaneous(y, N, N + 2 + nu_extra, delta, window)
    assert estimates.shape == (2, 3, N + 1)
    for n in range(N + 1):
        individual = paper.annihilator(y, n, N, 0, nu_extra, delta, window)
        peak = np.abs(paper.annihilator_kernel(n, N, 0, nu_extra)(TAU)).max()
        allowed = (KERNEL + 8 * (N + 1) * EPS * paper.condition_number(N, N + 2 + nu_extra)) * peak / 2.0**n
        assert np.abs(estimates[..., n] - individual).max() <= allowed * np.abs(y).max()


def quadrature_bound(n: int, N: int, kappa: int, mu: int, signal: np.polynomial.Polynomial, steps: int) -> float:
    """Return h^2/12 max|f''| on [0, 1] for f = kernel times signal: what the trapezoidal rule may err by."""
    kernel = np.polynomial.Polynomial([float(c) for c in paper.annihilator_coefficients(n, N, kappa, mu)])
    return float(np.abs((kernel * signal).deriv(2)(np.linspace(0, 1, 2001))).max()) * 1.01 / 12 / steps**2


@pytest.mark.parametrize("N", range(5))
@pytest.mark.parametrize(("kappa", "mu"), [(0, 0), (1, 0), (2, 1)])
@pytest.mark.parametrize("window", ["forward", "causal"])
def test_polynomials_keep_the_sign_of_every_derivative(N: int, kappa: int, mu: int, window: str) -> None:
    steps, delta = 20_000, 2.0**-12
    duration = steps * delta
    # Derivatives 1, 2, 6, ... at t, which is the first or the last sample.
    signal = np.polynomial.Polynomial([1.0, 2.0, 3.0, 4.0, 5.0][: N + 1])
    t = delta * np.arange(steps + 1) - (duration if window == "causal" else 0)
    y = signal(t)
    scale = -duration if window == "causal" else duration
    backwards = np.polynomial.Polynomial([float(c) * scale**i for i, c in enumerate(signal.coef)])
    for n in range(N + 1):
        true = float(signal.deriv(n)(0.0)) if n else 1.0
        # Sums of as many products as samples, and the solution of (5).
        growth = steps + 8 + 8 * (N + 1) * paper.condition_number(N, N + 2 + mu)
        rounding = growth * EPS * np.abs(paper.annihilator_kernel(n, N, kappa, mu)(TAU)).max() * np.abs(y).max()
        allowed = (quadrature_bound(n, N, kappa, mu, backwards, steps) + rounding) / duration**n
        assert allowed < abs(true) / 2, "the bound says nothing about the sign"
        assert abs(paper.annihilator(y, n, N, kappa, mu, delta, window) - true) <= allowed
        if kappa == 0:
            assert abs(paper.simultaneous(y, N, N + 2 + mu, delta, window)[n] - true) <= allowed
    if N == 1:
        minimal = paper.minimal(y, 1, kappa, mu, delta, window)
        assert minimal == paper.annihilator(y, 1, 1, kappa, mu, delta, window)


def test_the_printed_causal_rule_is_wrong_for_even_orders() -> None:
    delta = 1 / 4000
    t = delta * np.arange(4001) - 1
    y = 1 + 2 * t + 3 * t**2
    printed = paper.simultaneous(-y[::-1], 2, 4, delta)
    np.testing.assert_allclose(printed, [-1, 2, -6], atol=1e-4)
    np.testing.assert_allclose(paper.simultaneous(y, 2, 4, delta, "causal"), [1, 2, 6], atol=1e-4)


@pytest.mark.parametrize("window", ["forward", "causal"])
@pytest.mark.parametrize(("n", "N"), [(1, 2), (1, 3), (2, 3)])
def test_the_delayed_estimator_gains_a_degree_at_its_point(n: int, N: int, window: str) -> None:
    steps = 20_000
    t = np.linspace(0, 1, steps + 1)
    tau = paper.tau1(n, N, 1, 1, window)
    true = math.perm(N + 1, n) * tau ** (N + 1 - n)
    # |f''| of a kernel of degree N + 2 times t^(N+1), by the largest second difference on a fine grid.
    kernel = algdiff.Kernel(n, N, 1, 1, tau)
    allowed = 1.01 / 12 * np.abs(np.diff(kernel(t) * t ** (N + 1), 2)).max()
    assert abs(paper.combination(t ** (N + 1), n, N, 1, 1, tau, 1 / steps) - true) <= allowed < 1e-4 * true
    # Read from its other end, the window has its points reversed too.
    reverse = (-1) ** n * paper.combination(t[::-1] ** (N + 1), n, N, 1, 1, 1 - tau, 1 / steps)
    assert abs(reverse - true) <= allowed


@pytest.mark.parametrize("window", ["forward", "causal"])
def test_minimal_estimates_belong_to_their_delay(window: str) -> None:
    steps = 20_000
    t = np.linspace(0, 1, steps + 1)
    for n in (0, 1, 2, 3):
        kernel = paper.minimal_kernel(n, 2, 1)
        place = paper.delay(2, 1, n) if window == "forward" else 1 - paper.delay(2, 1, n)
        true = math.factorial(n + 1) * place
        values = kernel(t) * (t if window == "forward" else 1 - t) ** (n + 1)
        allowed = 1.01 / 12 * np.abs(np.diff(values, 2)).max()
        estimate = paper.minimal(t ** (n + 1), n, 2, 1, 1 / steps, window)
        assert abs(estimate - true) <= allowed < 1e-4 * true


@pytest.mark.parametrize(
    "estimate",
    [
        lambda y: paper.simultaneous(y, 2, 4, 0.1),
        lambda y: paper.annihilator(y, 1, 2, 0, 0, 0.1, "causal"),
        lambda y: paper.minimal(y, 1, 0, 0, 0.1),
        lambda y: paper.combination(y, 1, 2, 0, 0, 0.7, 0.1),
    ],
    ids=["simultaneous", "annihilator", "minimal", "combination"],
)
def test_every_kind_of_samples(estimate: Callable[[Any], Any]) -> None:
    y = np.random.default_rng(5).integers(-99, 99, (4, 3, 21))
    before = y.copy()
    expected = estimate(y.astype(float))
    assert expected.dtype == np.float64
    for same in (y, y.astype(np.float32), y.astype(">f8"), y.tolist(), np.asfortranarray(y), y.astype(np.int8)):
        # The order in which the products are added depends on the layout.
        np.testing.assert_allclose(estimate(same), expected, rtol=0, atol=64 * EPS * np.abs(expected).max())
        assert estimate(same).dtype == np.float64
    y.flags.writeable = False
    both = estimate(y + 1j * y[::-1])
    assert both.dtype == np.complex128
    np.testing.assert_allclose(both.imag, estimate(y[::-1]), rtol=0, atol=64 * EPS * np.abs(expected).max())
    np.testing.assert_array_equal(y, before)
    single = estimate(y[1, 2])
    np.testing.assert_allclose(single, expected[1, 2], rtol=0, atol=64 * EPS * np.abs(expected).max())
    assert np.shape(single) == expected.shape[2:]
    assert estimate(np.empty((0, 21))).shape[0] == 0
    spoilt = y.astype(float)
    spoilt[0, 0, 10] = math.nan
    where = np.isnan(estimate(spoilt))
    assert where[0, 0].all()
    assert not where[1:].any()


# Warnings and refusals.


def test_a_warning_where_half_of_the_digits_may_go() -> None:
    y = np.linspace(0, 1, 101) ** 2
    with pytest.warns(algdiff.DesignWarning) as caught:
        paper.simultaneous(y, 8, 10, delta=1e-3)
    message = str(caught[0].message)
    assert message.startswith("P_nu has the condition number 1.5e+11: solving (5) may cost 11 of 16 digits")
    assert "Kernel(n, 8, kappa=0, mu=0, tau=0)" in message
    assert caught[0].filename == __file__
    assert caught[0].lineno == inspect.currentframe().f_lineno - 5  # type: ignore[union-attr]
    with pytest.warns(
        algdiff.DesignWarning, match=r"lambdas add up to .* Kernel\(1, degree=25, kappa=0.0, mu=2.0, tau=1.0\)"
    ):
        paper.combination(y, 1, 25, 0, 2, 1.0)


@pytest.mark.parametrize("delta", [1e-6, 1e-3, 1.0, 1e4])
def test_no_warning_where_only_the_unit_of_time_is_to_blame(delta: float) -> None:
    assert (paper.condition_number(4, 6, 100 * delta) > EPS**-0.5) == (delta < 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimates = paper.simultaneous(np.linspace(0, 1, 101) ** 2, 4, 6, delta)
        paper.combination(np.linspace(0, 1, 101) ** 2, 1, 9, 0, 0, 1.0)
    # The unit changes estimates by powers of it, and no digit.
    scaled = paper.simultaneous(np.linspace(0, 1, 101) ** 2, 4, 6, 1.0) / delta ** np.arange(5)
    np.testing.assert_allclose(estimates, scaled, rtol=64 * EPS)


Y = np.zeros(21)


@pytest.mark.parametrize(
    ("error", "match", "call"),
    [
        (ValueError, "N must be an integer of at least 0, got -1", lambda: paper.simultaneous_matrices(-1, 2)),
        (TypeError, r"N must be an integer, got 2\.0", lambda: paper.simultaneous_matrices(2.0, 4)),  # type: ignore[arg-type]
        (ValueError, r"nu must be at least N \+ 2 = 4, got 3", lambda: paper.simultaneous_matrices(2, 3)),
        (TypeError, "nu must be an integer", lambda: paper.condition_number(2, "4")),  # type: ignore[arg-type]
        (ValueError, "N must be at most 500, got 501", lambda: paper.condition_number(501, 503)),
        (ValueError, "N must be at most 500, got 501", lambda: paper.lambdas(1, 501, 0, 0, 0)),
        (ValueError, r"nu must be at most N \+ 10002", lambda: paper.condition_number(2, 20000)),
        (ValueError, "nu must be small enough", lambda: paper.condition_number(2, 400)),
        (ValueError, "N must be small enough", lambda: paper.condition_number(160, 162)),
        (ValueError, "T must be such that", lambda: paper.condition_number(3, 5, 1e-100)),
        (ValueError, "T must be such that", lambda: paper.simultaneous_matrices(3, 5, 1e100)),
        (ValueError, "T must be finite and positive, got 0", lambda: paper.condition_number(3, 5, 0)),
        (ValueError, "T must be finite and positive, got -1", lambda: paper.simultaneous_matrices(3, 5, -1)),
        (ValueError, "T must be finite and positive, got nan", lambda: paper.condition_number(3, 5, math.nan)),
        (TypeError, "T must be a real number", lambda: paper.condition_number(3, 5, "1")),  # type: ignore[arg-type]
        (ValueError, "N must be at least n = 3, got 2", lambda: paper.simultaneous_kernel(3, 2, 4)),
        (ValueError, r"nu must be at least N \+ 2 = 4", lambda: paper.simultaneous_kernel(1, 2, 3)),
        (ValueError, "N must be at least n = 3, got 2", lambda: paper.annihilator(Y, 3, 2, 0, 0)),
        (ValueError, "N must be at least n = 3, got 2", lambda: paper.lambdas(3, 2, 0, 0, 0)),
        (ValueError, "n must be an integer of at least 0", lambda: paper.minimal(Y, -1, 0, 0)),
        (ValueError, "n must be an integer of at least 0", lambda: paper.delay(0, 0, -1)),
        (TypeError, "kappa must be an integer", lambda: paper.annihilator_coefficients(1, 2, 0.5, 0)),  # type: ignore[arg-type]
        (ValueError, "mu must be an integer of at least 0", lambda: paper.lemma1(1, 2, 0, -1)),
        (ValueError, r"N \+ kappa \+ mu must be at most 500", lambda: paper.lemma1(1, 2, 10**9, 0)),
        (ValueError, r"N \+ kappa \+ mu must be at most 500", lambda: paper.annihilator_coefficients(1, 2, 0, 499)),
        (ValueError, "kappa must be finite and greater than -1", lambda: paper.lambdas(1, 2, -1, 0, 0)),
        (ValueError, "mu must be finite and greater than -1", lambda: paper.delay(0, math.inf)),
        (ValueError, "tau must be finite", lambda: paper.lambdas(1, 2, 0, 0, [0.5, math.nan])),
        (TypeError, "tau must be real numbers", lambda: paper.lambdas(1, 2, 0, 0, ["a"])),
        (ValueError, "tau must be small enough", lambda: paper.lambdas(0, 60, 0, 0, 1e6)),
        (TypeError, "tau must be a real number", lambda: paper.combination(Y, 1, 2, 0, 0, "root")),  # type: ignore[arg-type]
        (
            ValueError,
            "kappa must be at least 0 .*Differentiator.*got -0.5",
            lambda: paper.annihilator(Y, 1, 2, -0.5, 0),
        ),
        (
            ValueError,
            "mu must be at least 0 .*Differentiator.*got nan",
            lambda: paper.combination(Y, 1, 2, 0, math.nan, 1),
        ),
        (ValueError, "mu must be at least 0", lambda: paper.minimal(Y, 1, 0, -0.1)),
        (ValueError, "delta must be finite and positive, got 0", lambda: paper.simultaneous(Y, 2, 4, 0)),
        (ValueError, "delta must be finite and positive, got inf", lambda: paper.annihilator(Y, 1, 2, 0, 0, math.inf)),
        (ValueError, "delta must be finite and positive, got -1", lambda: paper.minimal(Y, 1, 0, 0, -1)),
        (
            ValueError,
            "delta must be finite and positive, got nan",
            lambda: paper.combination(Y, 1, 2, 0, 0, 1, math.nan),
        ),
        (ValueError, r"delta must be such that T\*\*2", lambda: paper.simultaneous(Y, 2, 4, 1e-200)),
        (ValueError, r"delta must be such that T\*\*2", lambda: paper.simultaneous(Y, 2, 4, 1e200)),
        (ValueError, "delta must be such that", lambda: paper.annihilator(Y, 2, 2, 0, 0, 1e-200)),
        (ValueError, "window must be 'forward' or 'causal', got 'x'", lambda: paper.simultaneous(Y, 2, 4, 1, "x")),
        (TypeError, "window must be 'forward' or 'causal', got 1", lambda: paper.minimal(Y, 1, 0, 0, 1, 1)),  # type: ignore[arg-type]
        (ValueError, "window must be 'forward' or 'causal', got 'both'", lambda: paper.tau1(1, 2, 0, 0, "both")),
        (ValueError, "y must have at least 5 samples .* got 4", lambda: paper.simultaneous(Y[:4], 4, 6)),
        (ValueError, "y must have at least 2 samples .* got 1", lambda: paper.annihilator(Y[:1], 0, 0, 0, 0)),
        (ValueError, "y must have at least 3 samples .* got 0", lambda: paper.combination([], 1, 2, 0, 0, 1)),
        (ValueError, "y must have at least one dimension", lambda: paper.minimal(1.0, 1, 0, 0)),
        (TypeError, "y must hold real or complex numbers", lambda: paper.minimal(["a", "b"], 1, 0, 0)),
    ],
)
def test_refusals_name_the_argument(error: type[Exception], match: str, call: Callable[[], object]) -> None:
    with pytest.raises(error, match=match):
        call()


def test_every_public_name_is_documented_with_an_example() -> None:
    assert sorted(paper.__all__) == paper.__all__
    for name in paper.__all__:
        documentation = inspect.getdoc(getattr(paper, name)) or ""
        for section in ["Parameters", "Returns", "Raises", "Examples", ">>>"]:
            assert section in documentation, f"{name}: {section}"


def test_limits_of_the_arguments() -> None:
    assert paper.lemma1(0, 0, 250, 250) == [(250, 250, 1)]
    with pytest.raises(ValueError, match=r"N \+ kappa \+ mu must be at most 500, got 501"):
        paper.lemma1(0, 0, 250, 251)
    for tau in (1e300, -1e300):  # even where the coefficients do not depend on it
        with pytest.raises(ValueError, match="tau must be finite and at most"):
            paper.lambdas(1, 1, 0, 0, tau)
    for delta in (np.inf, np.nan, 0.0):
        with pytest.raises(ValueError, match="delta must be finite and positive"):
            paper.simultaneous([1.0, 2.0, 3.0], 0, 2, delta=delta)


def test_no_more_than_all_digits_cancel() -> None:
    with pytest.warns(algdiff.DesignWarning, match=": 16 of 16 digits may cancel"):
        paper.combination(np.zeros(90), 0, 80, 0, 0, 0.0)
