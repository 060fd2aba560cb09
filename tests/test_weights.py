"""Weights and what is known of them, against the reference and against each other."""

from __future__ import annotations

import itertools
import math
import warnings
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import algdiff
import reference
from support import EPS, conditioning, design

EXPONENTS = [(0.0, 0.0), (1.0, 1.0), (-0.5, -0.5), (10.0, 10.0), (2.5, 0.5), (-0.5, 3.0), (0.0, 10.0), (1.0, 0.0)]
POINTS: list[float | str] = ["center", "root", "newest", 0.3, 1.25]


@pytest.mark.parametrize(("kappa", "mu"), EXPONENTS)
@pytest.mark.parametrize("deriv", range(5))
def test_weights_equal_the_reference(deriv: int, kappa: float, mu: float) -> None:
    grid = itertools.product(range(deriv, deriv + 5), [0, 1, 10, 51], POINTS, ["exact", "trapezoid"])
    for degree, extra, tau, rule in grid:
        length = degree + 1 + extra
        if rule == "trapezoid" and (min(kappa, mu) < 0 or length < 2):
            continue
        expected = reference.weights(length, deriv, degree, kappa, mu, tau, rule, delta=0.25)
        ours = design(length, deriv, degree=degree, kappa=kappa, mu=mu, tau=tau, rule=rule, delta=0.25)
        # Two backward stable solvers differ by a modest multiple of eps times the conditioning; 64 covers E + 1 <= 10.
        bound = 64 * EPS * np.abs(expected).max()
        if rule == "exact":
            bound *= conditioning(length, min(degree + 1, length - 1), kappa, mu)
        else:  # samples may fall on zeros of the kernel, whose rounding is relative to its largest value
            peak = np.abs(reference.kernel(np.linspace(0, 1, 101), deriv, degree, kappa, mu, ours.tau)).max()
            bound += 64 * EPS * (1 + kappa + mu) * peak / (length - 1) / ((length - 1) * 0.25) ** deriv
        np.testing.assert_allclose(ours.weights, expected, rtol=0, atol=bound, err_msg=repr(ours))


@pytest.mark.parametrize(("kappa", "mu"), EXPONENTS)
@pytest.mark.parametrize(
    ("length", "degree"), [(1, 0), (2, 1), (7, 3), (20, 5), (61, 3), (4096, 8), (4097, 8), (5000, 2)]
)
def test_moments_hold_up_to_the_exactness_degree_and_no_further(
    length: int, degree: int, kappa: float, mu: float
) -> None:
    for deriv, tau in itertools.product(range(min(degree, 3) + 1), ["center", "root", "newest", 0.3]):
        ours = design(length, deriv, degree=degree, kappa=kappa, mu=mu, tau=tau, delta=1 / length)
        points = (np.arange(length) + 0.5) / length
        family = np.polynomial.Legendre.basis
        errors = []
        for m in range(ours.exactness + 2):
            exact = family(m, domain=[0, 1]).deriv(deriv)(ours.tau)
            errors.append(abs(ours.weights @ family(m, domain=[0, 1])(points) - exact))
        # |P_m| <= 1 on the window: the rounding of the sum and of the moments, which the weights meet to a few eps.
        bound = (length + 64) * EPS * np.abs(ours.weights).sum() + 64 * EPS * (degree + 2) ** (2 * deriv)
        assert max(errors[:-1]) <= bound, repr(ours)
        if length > ours.exactness + 1:
            assert errors[-1] > 100 * bound or errors[-1] > 1e-6, repr(ours)


def test_the_root_gains_a_degree_and_little_else_does() -> None:
    for kappa, mu in EXPONENTS:
        for deriv, degree in [(0, 0), (0, 2), (1, 1), (1, 2), (2, 5), (4, 6)]:
            roots = algdiff.Kernel(deriv, degree, kappa, mu).roots
            for root in roots:
                options: dict[str, Any] = {"degree": degree, "kappa": kappa, "mu": mu}
                assert design(30, deriv, tau=float(root) + 5e-13, **options).exactness == degree + 1
                assert design(30, deriv, tau=float(root) + 5e-12, **options).exactness == degree


def test_delays_on_both_grids() -> None:
    cells = design(20, tau=0.3, delta=0.1)
    assert cells.delay_samples == pytest.approx(0.7 * 20 - 0.5, abs=1e-13)
    assert cells.delay == pytest.approx(1.35, abs=1e-13)
    nodes = design(21, tau=0.3, delta=0.1, rule="trapezoid")
    assert nodes.delay_samples == pytest.approx(14, abs=1e-13)
    for length, rule in itertools.product([5, 20, 61], ["exact", "trapezoid"]):
        assert design(length, tau="newest", rule=rule).delay_samples == 0
        assert design(length, tau="center", rule=rule).delay_samples == (length - 1) / 2
        for delay in (0.0, 0.1, 1.3, -2.0):
            assert design(length, delay=delay, delta=0.1, rule=rule).delay == pytest.approx(delay, abs=1e-14)


def test_weights_at_a_whole_delay_are_exact_there() -> None:
    # 29 * 0.001 / 0.001 is not 29 in floating point; the estimate must lie on the sample all the same.
    ours = design(61, delay=29 * 0.001, delta=0.001)
    assert ours.delay_samples == 29


def test_symmetric_designs_have_symmetric_weights_to_the_bit() -> None:
    for length, deriv, exponent in itertools.product([6, 7, 60, 61], range(4), [0.0, 1.0, 2.5]):
        weights = design(length, deriv, degree=deriv + 2, kappa=exponent, mu=exponent).weights
        np.testing.assert_array_equal(weights, (-1) ** deriv * weights[::-1])


def test_trapezoid_says_what_it_leaks() -> None:
    # A constant leaks by 30 (2 tau - 1) / (L - 1)^2 (theory, section 8.2): nothing is reproduced.
    leaky = design(61, 1, degree=2, kappa=0, mu=0, tau="newest", rule="trapezoid", delta=1 / 60)
    assert leaky.weights.sum() == pytest.approx(30 / 60**2, rel=1e-3)
    assert leaky.exactness == -1
    # kappa = mu = 2 in the middle: constants by symmetry, slopes to -1.6e-6 only.
    slight = design(61, 1, degree=1, kappa=2, mu=2, rule="trapezoid", delta=1 / 60)
    assert slight.exactness == 0
    assert slight.weights @ (np.arange(61) / 60) - 1 == pytest.approx(-1.6e-6, rel=0.05)


@pytest.mark.parametrize(
    ("length", "deriv", "degree", "exponent"), [(13, 5, 9, 100), (9, 1, 3, 50), (13, 2, 4, 300), (15, 0, 10, 40)]
)
def test_large_exponents_on_short_windows(length: int, deriv: int, degree: int, exponent: int) -> None:
    """Weights over hundreds of powers of ten, against the same fit in rational arithmetic."""
    places = [Fraction(2 * j + 1, 2 * length) for j in range(length)]
    base = [place**exponent * (1 - place) ** exponent for place in places]
    offsets = [place - places[-2] for place in places]
    size = degree + 1
    rows = [
        [sum(w * t ** (a + b) for w, t in zip(base, offsets, strict=True)) for b in range(size)] for a in range(size)
    ]
    right = [Fraction(math.factorial(deriv) if a == deriv else 0) for a in range(size)]
    for pivot in range(size):  # Gauss and Jordan
        for row in range(size):
            if row != pivot:
                factor = rows[row][pivot] / rows[pivot][pivot]
                rows[row] = [x - factor * y for x, y in zip(rows[row], rows[pivot], strict=True)]
                right[row] -= factor * right[pivot]
    solution = [right[a] / rows[a][a] for a in range(size)]
    expected = np.array(
        [float(w * sum(c * t**a for a, c in enumerate(solution))) for w, t in zip(base, offsets, strict=True)]
    )
    tau = float(places[-2])
    ours = design(length, deriv, degree=degree, kappa=exponent, mu=exponent, tau=tau, delta=1 / length)
    # The point itself is rounded: half an eps of tau costs the next derivative's weights times that much.
    np.testing.assert_allclose(ours.weights, expected, rtol=0, atol=64 * length * EPS * np.abs(expected).max())


@pytest.mark.parametrize("length", [100_001, 1_000_000])
def test_long_windows_meet_their_moments(length: int) -> None:
    ours = design(length, 2, degree=5, kappa=0.5, mu=2.0, tau="root", delta=1 / length)
    points = (np.arange(length) + 0.5) / length
    for m in range(7):
        polynomial = np.polynomial.Legendre.basis(m, domain=[0, 1])
        error = abs(ours.weights @ polynomial(points) - polynomial.deriv(2)(ours.tau))
        # numpy sums pairwise: log2(length) roundings in a row, not length.
        assert error <= 64 * EPS * np.abs(ours.weights).sum()


@pytest.mark.parametrize(("length", "degree"), [(1601, 5), (20_001, 3), (101, 20), (101, 40)])
def test_where_other_solvers_lose_rank(length: int, degree: int) -> None:
    for tau in ["center", "newest"]:
        ours = design(length, 2, degree=degree, kappa=0, mu=0, tau=tau, delta=1 / length)
        points = (np.arange(length) + 0.5) / length
        for m in range(degree + 1):
            polynomial = np.polynomial.Legendre.basis(m, domain=[0, 1])
            expected = polynomial.deriv(2)(ours.tau)
            error = abs(ours.weights @ polynomial(points) - expected)
            assert error <= 1e-13 * (np.abs(ours.weights).sum() + degree**4)


def test_a_degree_too_high_is_an_error_and_a_high_one_a_warning() -> None:
    with pytest.raises(ValueError, match="degree 59 is too high for window_length 60"):
        design(60, 1, degree=59, kappa=0, mu=0, tau="newest")
    with pytest.warns(
        algdiff.DesignWarning,
        match=r"degree 16 exceeds 1\.5 sqrt\(window_length\) = 15\.1.*the noise gain grows steeply; it is 0.004",
    ) as caught:
        algdiff.Differentiator(101, degree=16)
    assert caught[0].filename == __file__
    with pytest.warns(algdiff.DesignWarning) as caught:
        algdiff.differentiate(np.zeros(200), 101, degree=16)
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        algdiff.Differentiator(101, degree=15)
