"""Designs at their limits: as many coefficients as samples, huge or singular exponents, tiny steps, single cells."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from algdiff import Kernel
from algdiff._core import Bank
from support import EPS, design, sum_bound


def interpolation(length: int, position: Fraction) -> list[Fraction]:
    """Return the weights that differentiate, at a position, the polynomial through so many samples: Lagrange's."""
    weights = []
    for j in range(length):
        others = [k for k in range(length) if k != j]
        without = [[k for k in others if k != i] for i in others]
        products = []
        for rest in without:
            product = Fraction(1)
            for k in rest:
                product *= position - k
            products.append(product)
        scale = Fraction(1)
        for k in others:
            scale *= j - k
        weights.append(sum(products, Fraction(0)) / scale)
    return weights


@pytest.mark.parametrize("tau", ["center", "newest"])
def test_interpolating_weights_are_known_to_ten_digits_or_refused(tau: str) -> None:
    refused = []
    for length in range(9, 41, 2):
        position = Fraction(length - 1, 2) if tau == "center" else Fraction(length - 1)
        try:
            ours = design(length, degree=length - 1, kappa=0, mu=0, tau=tau, delta=1).weights
        except ValueError:
            refused.append(length)
        else:
            assert not refused
            exact = np.array([float(weight) for weight in interpolation(length, position)])
            assert np.linalg.norm(ours - exact) <= 1e-10 * np.linalg.norm(exact)
    # They are not known so well for long: at 37 samples the best that doubles can do is off by 6e-9.
    assert refused
    assert refused[0] <= 37


@pytest.mark.parametrize(("name", "kappa", "mu"), [("kappa", 10_000, 0), ("mu", 0, 10_000), ("kappa", 9000, 8000)])
def test_exponents_that_leave_too_few_samples_are_refused_by_name(name: str, kappa: float, mu: float) -> None:
    allowed = "so small that 9 samples of the window have a weight"
    with pytest.raises(ValueError, match=f"^{name} must be {allowed}, got 1?[09]000.0$"):
        design(31, degree=8, kappa=kappa, mu=mu, tau=0.5)


@pytest.mark.parametrize("engine", ["direct", "fft"])
def test_weights_next_to_the_largest_number(engine: str) -> None:
    """Their taps are multiplied by a power of two, which must not be 2^1024."""
    ours = design(3, degree=1, kappa=0, mu=0, delta=2.0**-1024 / 1.5, engine=engine)
    assert 2.0**1023 < ours.weights.max() < np.inf
    x = 1e-3 * np.array([1.0, 3.0, 2.0, 5.0, 4.0])
    expected = (ours.weights[2] * (x[2:] - x[:-2])).tolist()
    np.testing.assert_allclose(ours(x, mode="valid"), expected, rtol=8 * EPS)


@pytest.mark.parametrize("deriv", [0, 1])
@pytest.mark.parametrize("rule", ["cell", "hat", "exact"])
def test_trimmed_rules_leak_what_their_weights_leak(rule: str, deriv: int) -> None:
    ours = design(40, deriv, degree=2, kappa=3, mu=1, rule=rule, trim=0.05)
    leak = abs(ours.weights.sum() - (deriv == 0))
    assert leak > 1e-3 if rule != "exact" else leak <= 40 * EPS * np.abs(ours.weights).sum()
    x = np.random.default_rng(deriv).standard_normal(200) + 1000
    found = ours(x, mode="valid")
    assert np.abs(found - np.correlate(x, ours.weights, "valid")).max() <= 2 * sum_bound(ours.weights, x)


@pytest.mark.parametrize(("kappa", "mu"), [(3, -0.9), (50, -0.9), (50, -0.5), (300, -0.8)])
def test_responses_of_reversed_kernels(kappa: float, mu: float) -> None:
    """Read backwards the exponents change places, and what was late is early."""
    omega = np.array([0.0, 0.1, 1.0, 3.0, 10.0, 25.0, 80.0])
    for deriv, degree, tau in [(0, 1, 0.4), (1, 2, 0.3), (2, 2, 0.9)]:
        here = Kernel(deriv, degree=degree, kappa=kappa, mu=mu, tau=tau).frequency_response(omega)
        there = Kernel(deriv, degree=degree, kappa=mu, mu=kappa, tau=1 - tau).frequency_response(omega)
        assert np.abs(here - (-1) ** deriv * np.conj(there)).max() <= 1e-12 * np.abs(here).max()


@pytest.mark.parametrize(("rule", "length"), [("hat", 2), ("cell", 1)])
def test_rules_on_a_single_cell_keep_constants(rule: str, length: int) -> None:
    for kappa, mu in [(-0.9, 9), (9, -0.9), (0, 9), (9, 0), (-0.5, 30), (30, -0.5), (100, 2)]:
        ours = design(length, 0, degree=0, kappa=kappa, mu=mu, rule=rule)
        assert abs(ours.weights.sum() - 1) <= 64 * EPS
        if rule == "hat":  # and the mean of a line is its value at the mean of the density
            assert abs(ours.weights[1] - (kappa + 1) / (kappa + mu + 2)) <= 64 * EPS


@pytest.mark.parametrize("rule", ["exact", "cell"])
def test_one_sample_alone_stays_itself(rule: str) -> None:
    for kappa, mu in [(-0.9, 9), (9, -0.9), (-0.5, 30), (30, -0.5), (100, 2), (-0.99, -0.99), (0.1, 0.7)]:
        assert design(1, 0, degree=0, kappa=kappa, mu=mu, rule=rule).weights.tolist() == [1.0]


def test_kernels_have_finite_norms_or_are_refused() -> None:
    refused = 0
    for degree in (100, 200, 500):
        for deriv in range(0, 130, 5):
            if deriv <= degree:
                try:
                    assert np.isfinite(Kernel(deriv, degree=degree, kappa=0, mu=0, tau=0.5).norm2)
                except ValueError:
                    refused += 1
    assert 10 < refused < 60


@pytest.mark.parametrize(("kappa", "mu"), [(0, -0.5), (1, -0.5), (0, -0.75)])
def test_a_zero_at_a_singular_end_is_a_zero(kappa: float, mu: float) -> None:
    """A line whose zero lies at the newest end, but for rounding: there the kernel is infinite or 0, and never NaN."""
    mean = (kappa + 1) / (kappa + mu + 2)
    variance = (kappa + 1) * (mu + 1) / (kappa + mu + 3) / (kappa + mu + 2) ** 2
    tau = mean - variance / (1 - mean)
    near = tau + np.arange(-50, 51) * np.spacing(tau)
    values = [Kernel(0, degree=1, kappa=kappa, mu=mu, tau=float(point))(1.0) for point in near]
    assert not np.isnan(values).any()
    assert 0.0 in values
    assert -np.inf in values
    assert np.inf in values


def test_fits_that_are_not_known_at_the_ends_are_refused_there() -> None:
    """Samples of hardly any weight say little about the polynomial next to them, and enough farther away."""
    x = np.random.default_rng(29).standard_normal(40)
    for tau in (0.3, 0.5):
        ours = design(21, 0, degree=5, kappa=-0.9, mu=100, tau=tau)
        assert np.isfinite(ours(x, mode="valid")).all()
        with pytest.raises(ValueError, match=r"^degree 5 is too high for window_length 21: "):
            ours(x, mode="fit")


def test_orders_that_do_not_share_their_point_or_window_are_refused() -> None:
    plan = design(21, degree=3, tau=0.5)._plan
    for other in (design(21, 2, degree=3, tau=0.6), design(23, 2, degree=3, tau=0.5)):
        with pytest.raises(ValueError, match=r"^tau must be the same point for all orders, got 0.5$"):
            Bank([plan, other._plan])


@pytest.mark.parametrize("mode", ["fit", "valid", "nan"])
def test_windows_longer_than_the_data_by_one_are_refused(mode: str) -> None:
    bank = Bank([design(21, degree=3)._plan])
    with pytest.raises(
        ValueError, match=f"^window_length must be at most the 20 samples of x in mode '{mode}', got 21$"
    ):
        bank.run(np.zeros(20), np.zeros(0 if mode == "valid" else 20), (1, 20, 1), mode)
