"""Designs next to what numbers can hold: as many coefficients as samples, huge exponents, tiny steps, loud samples."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from engines import assert_within, bound, naive
from support import ENGINES, EPS, design, sum_bound


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


@pytest.mark.parametrize(("dtype", "quiet"), [(np.float64, 2.0**-10), (np.float32, 2.0**-5)])
@pytest.mark.parametrize("engine", ENGINES)
def test_windows_just_as_loud_as_a_level_begins(engine: str, dtype: Any, quiet: float) -> None:
    """The largest difference of most windows is the limit at which blocks with louder samples are computed again."""
    rng = np.random.default_rng(3)
    steps = np.round(rng.uniform(-16, 16, 600)) / 16 * quiet
    steps[::7], steps[150] = quiet, 1
    x = np.cumsum(steps).astype(dtype)
    assert np.array_equal(np.diff(x.astype(float)), steps[1:])
    ours = design(61, degree=3, engine=engine)
    assert_within(ours(x, mode="valid"), naive(ours, x), bound(engine, ours, x))
