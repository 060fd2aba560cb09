"""The classical rules and trimming: weights against the twin, what they reproduce, and what they refuse."""

from __future__ import annotations

import itertools
import math
import pickle
from typing import Any

import numpy as np
import pytest

import algdiff
import reference
import reference_analysis as analysis
from support import EPS, Array, design

EXPONENTS = [(0.0, 0.0), (1.0, 1.0), (2.5, 0.5), (-0.5, -0.5), (-0.9, 3.0), (0.3, -0.75), (10.0, 10.0), (50.0, 2.0)]
POINTS: list[float | str] = ["center", "root", "newest", 0.0, 1.25]
ORDERS = [(0, 0), (0, 2), (1, 1), (1, 2), (2, 4), (3, 4), (4, 6)]
RULES = ["midpoint", "cell", "hat", "simpson"]
SAMPLES_THE_ENDS = ("trapezoid", "simpson")


def places(ours: algdiff.Differentiator) -> Array:
    """Return where the samples of the whole window lie, as tau."""
    j = np.arange(ours.window_length)
    return (j + 0.5) / ours.window_length if ours.rule in reference.CELLS else j / (ours.window_length - 1)


@pytest.mark.parametrize(("kappa", "mu"), EXPONENTS)
@pytest.mark.parametrize("rule", RULES)
def test_weights_equal_the_reference(rule: str, kappa: float, mu: float) -> None:
    if rule == "simpson" and min(kappa, mu) < 0:
        pytest.skip("refused")
    for (deriv, degree), length, tau in itertools.product(ORDERS, [9, 40], POINTS):
        length = length | 1 if rule == "simpson" else length
        expected = reference.weights(length, deriv, degree, kappa, mu, tau, rule, delta=0.25)
        ours = design(length, deriv, degree=degree, kappa=kappa, mu=mu, tau=tau, rule=rule, delta=0.25)
        # A sample may fall on a zero of the kernel, and an integral on a piece where it cancels: both err by EPS times
        # the kernel's size, with its logarithm. Differences of integrals from the ends err by EPS times the integral.
        kernel = (deriv, degree, kappa, mu, ours.tau)
        size = analysis.norm1(kernel) / ours.duration**deriv
        inside = np.linspace(0.5 / length, 1 - 0.5 / length, 101)
        size += np.abs(reference.kernel(inside, *kernel)).max() / length / ours.duration**deriv
        cost = 1 + abs(math.lgamma(kappa + mu + 2)) + kappa + mu
        np.testing.assert_allclose(
            ours.weights, expected, rtol=0, atol=64 * EPS * max(cost, 4) * size, err_msg=repr(ours)
        )


@pytest.mark.parametrize(("kappa", "mu"), EXPONENTS)
@pytest.mark.parametrize("rule", ["cell", "hat"])
def test_integrals_leak_no_offset_and_hats_no_slope(rule: str, kappa: float, mu: float) -> None:
    for (deriv, degree), length, tau in itertools.product(ORDERS, [9, 60], POINTS):
        ours = design(length, deriv, degree=degree, kappa=kappa, mu=mu, tau=tau, rule=rule, delta=1 / length)
        bound = 256 * EPS * length * ours.norm1
        t = (places(ours) - ours.tau) * ours.duration
        assert abs(ours.weights.sum() - (deriv == 0)) <= bound
        if rule == "hat" and degree > 0:  # piecewise linear is what a line is
            assert abs(ours.weights @ t - (deriv == 1)) <= bound
            assert ours.exactness >= 1
        assert ours.exactness >= 0


def test_leaks_of_a_constant_follow_their_law() -> None:
    # Theory section 8.2, kappa = mu = 0, n = q = 1: 30 (2 tau - 1)/M^2 on nodes, -15 (2 tau - 1)/L^2 on cells.
    for length, tau in itertools.product([11, 61], [0.0, 0.7, 1.0]):
        options: dict[str, Any] = {"degree": 2, "kappa": 0, "mu": 0, "tau": tau}
        nodes = design(length, rule="trapezoid", delta=1 / (length - 1), **options)
        cells = design(length, rule="midpoint", delta=1 / length, **options)
        assert nodes.weights.sum() == pytest.approx(30 * (2 * tau - 1) / (length - 1) ** 2, rel=0, abs=1e-13)
        assert cells.weights.sum() == pytest.approx(-15 * (2 * tau - 1) / length**2, rel=0, abs=1e-13)
        assert nodes.exactness == cells.exactness == -1


@pytest.mark.parametrize("rule", [*RULES, "trapezoid", "exact"])
def test_all_rules_tend_to_the_kernel(rule: str) -> None:
    misses = []
    for length in (101, 401):
        ours = design(length, 2, degree=4, kappa=2, mu=1, tau="root", rule=rule, delta=1 / length)
        slope, late = np.polynomial.Polynomial([1, 2, -1, 3, 0, 0, 1]), ours.tau * ours.duration
        x = slope(places(ours) * ours.duration)
        continuous = slope.deriv(2)(late) + ours.kernel.bias_constant * slope.deriv(6)(0) * ours.duration**4
        continuous += 0 if ours.kernel.bias_order == 4 else np.nan
        misses.append(abs(ours.weights @ x - continuous))
    assert misses[1] <= misses[0] / 3.5 + 1e-9  # quadrupled samples: order 1 at the least


@pytest.mark.parametrize("rule", [*RULES, "trapezoid", "exact"])
@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.5])
def test_symmetric_designs_have_symmetric_weights(rule: str, exponent: float) -> None:
    for length, deriv in itertools.product([9, 61], range(4)):
        w = design(length, deriv, degree=deriv + 2, kappa=exponent, mu=exponent, rule=rule).weights
        np.testing.assert_allclose(w, (-1) ** deriv * w[::-1], rtol=0, atol=64 * length * EPS * np.abs(w).max())


@pytest.mark.parametrize("rule", [*RULES, "trapezoid"])
@pytest.mark.parametrize("mode", ["fit", "valid", "nan", "nearest"])
def test_estimates_equal_the_reference(rule: str, mode: str) -> None:
    x = np.random.default_rng(11).standard_normal(60)
    for deriv, tau in itertools.product([0, 1, 2], ["center", "root", "newest", 0.3]):
        options: dict[str, Any] = {"degree": 3, "kappa": 1.0, "mu": 0.5, "tau": tau, "delta": 0.5, "rule": rule}
        ours = design(15, deriv, **options)
        expected = reference.differentiate(x, 15, deriv, mode=mode, **options)
        bound = 4096 * EPS * 15 * np.abs(ours.weights).sum() * np.abs(x).max()
        ends = 40.0 if mode == "fit" else 1.0  # the weights at the ends are larger than those inside
        np.testing.assert_allclose(ours(x, mode=mode), expected, rtol=0, atol=ends * bound)


# what is refused


@pytest.mark.parametrize(("kappa", "mu"), [(-0.5, 1.0), (1.0, -1e-9), (-0.99, -0.99)])
def test_negative_exponents(kappa: float, mu: float) -> None:
    for deriv, length, tau in itertools.product(range(3), [7, 8, 61], POINTS):
        options: dict[str, Any] = {"degree": deriv + 1, "kappa": kappa, "mu": mu, "tau": tau}
        for rule in ("exact", "midpoint", "cell", "hat"):
            assert np.isfinite(design(length, deriv, rule=rule, **options).weights).all()
        for rule in SAMPLES_THE_ENDS:
            with pytest.raises(ValueError, match=f"{rule}|kappa|mu"):
                design(length | 1, deriv, rule=rule, **options)


@pytest.mark.parametrize("rule", SAMPLES_THE_ENDS)
def test_the_refusal_of_an_infinite_weight_names_the_rule(rule: str) -> None:
    with pytest.raises(ValueError, match=rule):
        design(9, kappa=-0.5, rule=rule)


def test_lengths_and_words_that_cannot_be() -> None:
    for length in (8, 60):
        with pytest.raises(ValueError, match="odd"):
            design(length, rule="simpson")
    assert len(design(9, rule="simpson").weights) == 9
    for rule in ("trapezoid", "hat"):
        with pytest.raises(ValueError, match="window_length"):
            design(1, 0, degree=0, rule=rule)
    for rule in ("exact", "cell"):
        assert design(1, 0, degree=0, rule=rule).weights == pytest.approx([1], rel=4 * EPS)
    with pytest.raises(ValueError, match="'simpson'"):
        design(9, rule="euler")
    with pytest.raises(TypeError, match="rule"):
        design(9, rule=3)


def test_delays_on_both_grids() -> None:
    for rule in reference.CELLS + reference.NODES:
        cells = rule in reference.CELLS
        ours = design(21, tau=0.3, delta=0.1, rule=rule)
        assert ours.delay_samples == pytest.approx(0.7 * 21 - 0.5 if cells else 0.7 * 20, abs=1e-13)
        assert ours.duration == pytest.approx(2.1 if cells else 2.0)
        assert design(21, tau="newest", rule=rule).delay_samples == 0
        assert design(21, tau="center", rule=rule).delay_samples == 10
        assert design(21, delay=0.25, delta=0.1, rule=rule).delay == pytest.approx(0.25, abs=1e-14)


def test_a_delay_that_is_the_middle_but_for_rounding_is_the_middle() -> None:
    for length in (7, 13, 15, 29):  # of 0.3 / 0.1 and others the quotient is not whole
        for delta in (0.1, 0.01, 0.007):
            ours = design(length, delay=(length - 1) / 2 * delta, delta=delta)
            assert (ours.tau, ours.delay_samples) == (0.5, (length - 1) / 2)
            assert ours.weights.tobytes() == design(length, delta=delta).weights.tobytes()


def test_delays_beyond_all_windows_are_refused_by_name() -> None:
    for delay in (1e300, -1e300, np.inf, np.nan):
        with pytest.raises(ValueError, match="delay must be"):
            design(21, delay=delay)


def test_symmetry_gains_a_degree_that_exactness_counts() -> None:
    # A fit through all of its samples, and hats, for which a line is a line: the middle is right about one degree more.
    for ours, degree in ((design(4, degree=3), 4), (design(31, degree=1, rule="hat"), 2)):
        assert (ours.exactness, ours.bias_order) == (degree, degree)
        t = np.arange(ours.window_length) - (ours.window_length - 1) / 2
        bound = 64 * EPS * ours.window_length * ours.norm1 * float(np.abs(t).max()) ** degree
        for m in range(degree + 1):
            assert ours.weights @ t**m == pytest.approx(float(m == 1), rel=0, abs=bound)


def test_of_two_samples_equally_near_the_newer_one_is_the_estimate_whatever_the_rounding() -> None:
    for length in (22, 49, 93, 98, 103, 107):
        for k in range(1, 12):  # tau lies between samples k - 1 and k; k / length * length may fall short of k
            out = design(length, tau=k / length, kappa=0, mu=0)(np.zeros(length + 5), mode="nan")
            assert np.flatnonzero(~np.isnan(out))[0] == k


# trimming

TRIMMED: list[dict[str, Any]] = [
    {"kappa": 10, "mu": 10},
    {"kappa": 4.5, "mu": 2, "tau": "root"},
    {"kappa": 20, "mu": 0, "tau": "newest"},
    {"kappa": 50, "mu": 50, "deriv": 2, "degree": 3},
    {"kappa": 6, "mu": 6, "deriv": 0, "degree": 1, "tau": 1.1},
]


def dropped(ours: algdiff.Differentiator, whole: algdiff.Differentiator) -> tuple[int, int]:
    """Return how many samples are gone at the oldest and at the newest end, by the delay and the length."""
    newest = whole.delay_samples - ours.delay_samples
    assert newest == pytest.approx(round(newest), abs=1e-9)
    return len(whole.weights) - len(ours.weights) - round(newest), round(newest)


@pytest.mark.parametrize("options", TRIMMED)
@pytest.mark.parametrize("rule", [*RULES, "trapezoid", "exact"])
@pytest.mark.parametrize("trim", [1e-6, 0.001, 0.02])
def test_trim_drops_what_it_may_and_no_more(trim: float, rule: str, options: dict[str, Any]) -> None:
    whole, ours = design(121, rule=rule, **options), design(121, rule=rule, trim=trim, **options)
    assert ours.trim == trim
    assert (ours.window_length, ours.duration, ours.tau) == (121, whole.duration, whole.tau)
    oldest, newest = dropped(ours, whole)
    sizes = np.abs(whole.weights)
    for count, share in ((oldest, sizes.cumsum()), (newest, sizes[::-1].cumsum())):
        assert count >= 0
        assert count == 0 or share[count - 1] <= trim * sizes.sum() * (1 + 1e-9)
        assert share[count] > trim * sizes.sum() * (1 - 1e-9)
    assert ours.delay == pytest.approx(ours.delay_samples * ours.delta)
    if rule != "exact":
        np.testing.assert_array_equal(ours.weights, whole.weights[oldest : 121 - newest])
        return
    assert ours.exactness == whole.exactness
    kept = slice(oldest, 121 - newest)
    kernel = ours.kernel
    expected = reference.exact_weights(
        121, kernel.deriv, ours.exactness, kernel.kappa, kernel.mu, ours.tau, kept
    ) / float(ours.duration**kernel.deriv)
    np.testing.assert_allclose(ours.weights, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("options", TRIMMED)
def test_trimmed_designs_are_as_exact_on_polynomials(options: dict[str, Any]) -> None:
    whole, ours = design(61, **options), design(61, trim=0.01, **options)
    assert len(ours.weights) < 61
    t = np.arange(100.0) - 50
    for m in range(ours.exactness + 1):
        polynomial = np.polynomial.Polynomial.basis(m)
        for filtered in (whole, ours):
            times = t[len(filtered.weights) - 1 :] - filtered.delay_samples
            bound = 256 * EPS * 61 * filtered.norm1 * 50.0**m
            expected = polynomial.deriv(filtered.deriv)(times) if filtered.deriv else polynomial(times)
            np.testing.assert_allclose(filtered(polynomial(t), mode="valid"), expected, rtol=0, atol=bound)
        if m <= ours.degree:
            inside = ours(polynomial(t))
            expected = polynomial.deriv(ours.deriv)(t) if ours.deriv else polynomial(t)
            loudest = max(design(61, **{**options, "tau": end}).norm1 for end in ("newest", 0.0))
            np.testing.assert_allclose(inside, expected, rtol=0, atol=1e4 * EPS * 61 * loudest * 50.0**m)


def test_no_trim_changes_nothing() -> None:
    for rule in reference.CELLS + reference.NODES:
        whole = design(31, kappa=5, mu=5, rule=rule)
        assert whole.trim == 0
        assert design(31, kappa=5, mu=5, rule=rule, trim=0.0) == whole
        assert design(31, kappa=5, mu=5, rule=rule, trim=0.0).weights.tobytes() == whole.weights.tobytes()
    assert len(design(31, kappa=5, mu=5).weights) == 31


def test_trim_counts_a_share_that_is_just_reached() -> None:
    mean: dict[str, Any] = {"deriv": 0, "degree": 0, "kappa": 0, "mu": 0}
    for trim, left in ((0.1249, 8), (0.125, 6), (0.25, 4), (0.26, 4)):  # eighths are exact in binary
        assert len(design(8, trim=trim, **mean).weights) == left


def test_trim_leaves_enough_for_the_fit_or_is_refused() -> None:
    refused = 0
    for length, trim in itertools.product(range(7, 12), np.arange(0.05, 0.5, 0.01)):
        options: dict[str, Any] = {"degree": 4, "kappa": 0, "mu": 0, "tau": 0.3}
        try:
            ours = design(length, 0, trim=trim, **options)
        except ValueError as error:
            assert str(error).startswith("trim must be so small that more than 4 samples are left")  # noqa: PT017
            refused += 1
        else:
            assert len(ours.weights) >= 5
    assert 20 < refused < 200
    with pytest.raises(ValueError, match="trim must be at least 0 and less than 1/2"):
        design(5, 0, degree=0, trim=0.5)


def test_trim_is_part_of_a_design() -> None:
    ours = design(61, kappa=10, mu=10, trim=0.01)
    assert ours != design(61, kappa=10, mu=10)
    assert len({ours, design(61, kappa=10, mu=10, trim=0.01)}) == 1
    assert "trim=0.01" in repr(ours)
    assert pickle.loads(pickle.dumps(ours)) == ours  # noqa: S301
    assert len(ours.replace(trim=0).weights) == 61
    assert ours.replace(window_length=121).trim == 0.01
    assert ours.noise_gain == pytest.approx(float(ours.weights @ ours.weights))
    for bad in (-0.1, 0.5, 1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="trim"):
            design(61, trim=bad)
    with pytest.raises(TypeError, match="trim"):
        design(61, trim="0.1")
