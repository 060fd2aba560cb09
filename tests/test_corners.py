"""Corners of the code that nothing else reaches: each test fails if its corner is cut off."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from scipy import signal as scipy_signal

import algdiff
import reference
from support import EPS, conditioning, design, sum_bound


def test_a_design_at_a_root_is_said_again_to_the_bit() -> None:
    grid = itertools.product(range(3), range(5), [0.0, -0.5, 1.0, 2.5], [0.0, 0.5, 3.0])
    for deriv, extra, kappa, mu in grid:
        for root in algdiff.Kernel(deriv, deriv + extra, kappa, mu).roots:
            said = algdiff.Kernel(deriv, deriv + extra, kappa, mu, float(root)).tau
            assert said == root
            assert algdiff.Kernel(deriv, deriv + extra, kappa, mu, said).tau == said


def test_a_zero_of_the_polynomial_outweighs_a_singular_end() -> None:
    # p_1 = 4 s - 1 and p_1(1/2) = 1: k = rho (1 + 4 s - 1) = 4 s rho, and rho grows like s^(-1/2) only.
    kernel = algdiff.Kernel(0, 1, -0.5, 0.5, 0.5)
    assert kernel(0.0) == 0
    assert kernel(0.25) == pytest.approx(2 / math.pi * 0.25**-0.5 * 0.75**0.5, rel=8 * EPS)


def test_pos_on_a_root_keeps_the_degree() -> None:
    # The roots of the family (3, 3) of degree 2 are 1/3 and 2/3, and (5.5 + 1/2) / 9 is 2/3.
    expected = scipy_signal.savgol_coeffs(9, 4, 3, pos=5.5, use="dot")
    got = algdiff.savgol_coeffs(9, 4, 3, pos=5.5, use="dot")
    powers = np.vander(np.arange(9) - 5.5, 5)
    atol = (8 * np.linalg.cond(powers) + 64 * conditioning(9, 4, 0.0, 0.0)) * EPS * np.abs(expected).max()
    np.testing.assert_allclose(got, expected, rtol=0, atol=atol)


@pytest.mark.parametrize("exponent", [300.0, 2000.0])
def test_exponents_beyond_the_range_of_exp(exponent: float) -> None:
    # The weight at its peak, 4^-exponent, is not a number for exponents above 538.
    ours = design(1001, 1, degree=3, kappa=exponent, mu=exponent, delta=1 / 1001)
    points = (np.arange(1001) + 0.5) / 1001 - 0.5
    bound = 64 * EPS * np.abs(ours.weights).sum()
    for m, expected in enumerate([0.0, 1.0, 0.0, 0.0]):
        assert abs(ours.weights @ points**m - expected) <= bound


@pytest.mark.parametrize("length", [30, 60])
def test_what_is_not_refused_meets_its_moments(length: int) -> None:
    for degree in range(length // 2, length):
        try:
            ours = design(length, 1, degree=degree, kappa=0, mu=0, tau="newest", delta=1 / length)
        except ValueError:
            continue
        points = (np.arange(length) + 0.5) / length
        basis = reference.orthonormal(0.0, 0.0, degree, points)
        expected = reference.derivatives(1, degree, 0.0, 0.0, ours.tau)
        rounding = length * EPS * float((np.abs(basis) @ np.abs(ours.weights)).max())
        error = np.abs(basis @ ours.weights - expected).max()
        assert error <= 1e-10 * np.abs(expected).max() + rounding, degree


@pytest.mark.parametrize(("kappa", "mu"), [(0.0, 0.0), (0.5, 2.0), (-0.5, 1.0)])
@pytest.mark.parametrize("length", [4097, 9000])
def test_polynomials_come_back_at_the_ends_of_long_windows(length: int, kappa: float, mu: float) -> None:
    d = design(length, 1, degree=3, kappa=kappa, mu=mu, delta=1 / length)
    newest = d.replace(tau="newest").weights, d.replace(tau=0.5 / length).weights
    t = np.arange(length + 10) / length - 0.5
    for m in range(4):
        polynomial = np.polynomial.Polynomial.basis(m)
        bound = 8 * max(sum_bound(w, polynomial(t)) for w in newest)
        np.testing.assert_allclose(d(polynomial(t)), polynomial.deriv(1)(t), rtol=0, atol=bound)


def test_trapezoid_refuses_mu_too() -> None:
    with pytest.raises(ValueError, match="mu must be at least 0 with rule = 'trapezoid'"):
        design(21, rule="trapezoid", mu=-0.5)
    with pytest.raises(ValueError, match=r"window_length must be at least degree \+ 1 = 2"):
        design(1, 0, degree=0, rule="trapezoid")
    with pytest.raises(ValueError, match="delta must be large enough"):
        design(11, 2, delta=1e-154 / 11)


@pytest.mark.parametrize(("kappa", "mu"), [(-0.9, -0.1), (-0.25, 0.0), (2.0, -0.01), (-0.99, -0.99)])
def test_every_negative_exponent_is_averaged(kappa: float, mu: float) -> None:
    for length in [5, 40]:
        expected = reference.weights(length, 1, 3, kappa, mu, 0.3)
        ours = design(length, 1, degree=3, kappa=kappa, mu=mu, tau=0.3).weights
        bound = 64 * EPS * conditioning(length, 3, kappa, mu) * np.abs(expected).max()
        np.testing.assert_allclose(ours, expected, rtol=0, atol=bound)


def test_a_place_that_is_a_sample_but_for_rounding_is_that_sample() -> None:
    x = np.random.default_rng(11).standard_normal(130)
    for length in range(4, 61):
        for sample in range(length):
            by_tau = design(length, tau=(sample + 0.5) / length)
            assert by_tau.delay_samples == length - 1 - sample
            delay = (length - 1 - sample) * 0.001
            by_delay = design(length, delay=delay, delta=0.001)
            assert by_delay.delay_samples == length - 1 - sample
            assert (
                by_delay.weights.tobytes() == design(length, tau=(sample + 0.5) / length, delta=0.001).weights.tobytes()
            )
            valid = by_tau(x, mode="valid")
            assert by_tau(x)[sample : sample + len(valid)].tobytes() == valid.tobytes()


def test_a_place_beside_a_sample_is_not_that_sample() -> None:
    for shift in [1e-7, -1e-7]:
        assert design(21, delay=10 + shift).delay_samples == pytest.approx(10 + shift, rel=0, abs=1e-13)


def test_of_two_samples_equally_near_the_newer_counts() -> None:
    for length in range(4, 130):
        x = np.zeros(2 * length)
        for newer in range(1, length):
            # tau = newer / length lies in the middle between the samples newer - 1 and newer.
            got = design(length, degree=1, tau=newer / length)(x, mode="nan")
            assert int(np.isnan(got).argmin()) == newer, (length, newer)


def test_symmetry_gains_a_degree_also_in_the_shortest_window() -> None:
    for deriv, exponent in itertools.product(range(4), [0.0, 1.0, -0.5]):
        for degree in (deriv, deriv + 2):
            ours = design(degree + 1, deriv, degree=degree, kappa=exponent, mu=exponent, delta=1 / (degree + 1))
            assert ours.exactness == degree + 1
            points = (np.arange(degree + 1) + 0.5) / (degree + 1) - 0.5
            # The derivative of t^(degree + 1) is zero in the middle.
            assert abs(ours.weights @ points ** (degree + 1)) <= 64 * EPS * np.abs(ours.weights).sum()
            odd = design(degree + 1, deriv, degree=degree, kappa=exponent, mu=exponent, tau="newest")
            # In a window of one sample the newest is the middle.
            assert odd.exactness == (degree if degree else 1)


@pytest.mark.parametrize(("shape", "axis"), [((3000, 300), 1), ((400, 40, 50), 1)])
def test_more_rows_than_one_task_takes(shape: tuple[int, ...], axis: int) -> None:
    x = np.random.default_rng(12).standard_normal(shape)
    d = algdiff.Differentiator(19)
    expected = np.stack([d(row, axis - 1) for row in x])
    for threads in (1, 3):
        np.testing.assert_array_equal(d(x, axis, threads=threads), expected)


@pytest.mark.parametrize("length", [60, 61, 20_001])
@pytest.mark.parametrize("exponent", [1.0, 10.0])
def test_a_step_sees_the_running_sums_of_the_weights_from_the_nearer_end(length: int, exponent: float) -> None:
    # A step of 1 after the k-th sample of a window gives -(w_0 + ... + w_k) = w_(k+1) + ... + w_(L-1). The weights of
    # this design change their sign in the middle only, so neither sum cancels.
    d = design(length, 1, degree=2, kappa=exponent, mu=exponent, delta=1 / length, engine="direct")
    x = np.zeros(2 * length - 1)
    x[length:] = 1
    got = d(x, mode="valid")[:0:-1]
    w, half = d.weights, (length - 1) // 2
    older = [-math.fsum(w[: k + 1]) for k in [*range(min(half, 50)), half // 2, half - 1]]
    newer = [math.fsum(w[length - 1 - k :]) for k in [*range(min(half, 50)), half // 2, half - 1]]
    places = np.array([*range(min(half, 50)), half // 2, half - 1])
    # One rounding for the sum, one for its correction, one for the product.
    np.testing.assert_allclose(got[places], older, rtol=2 * EPS, atol=0)
    np.testing.assert_allclose(got[length - 2 - places], newer, rtol=2 * EPS, atol=0)


def test_weights_next_to_overflow() -> None:
    # 1 / delta lies between 2^1023 and the largest number.
    d = design(2, 1, degree=1, kappa=0, mu=0, delta=1e-308)
    np.testing.assert_allclose(d([0.0, 1.0, 1.0]), [1e308, 1e308, 0.0], rtol=8 * EPS)


@pytest.mark.parametrize("length", [7, 117])
def test_constants_where_weights_come_to_overflow(length: int) -> None:
    # Engines add the weights up: their sums overflow where they themselves do not yet.
    refused = []
    for exponent in np.linspace(-310, -306, 60):
        try:
            d = design(length, 1, degree=6, kappa=-0.0625, mu=0, tau=0.9999847412109375, delta=10.0**exponent)
        except ValueError as error:
            refused.append(str(error))
            continue
        for x in [np.full(length + 10, 1e9), np.full((length + 10, 3), 1e9)]:
            np.testing.assert_array_equal(d(x, axis=0), 0)
    assert 0 < len(refused) < 60
    assert all(error.startswith("delta must be ") for error in refused)
    # 1, -2, 1: their sums are finite, and the middle is not.
    with pytest.raises(ValueError, match="delta must be large enough for weights that are finite"):
        design(3, 2, degree=2, delta=1e-154)


@pytest.mark.parametrize("name", ["kappa", "mu", "tau", "delay", "delta", "fs"])
@pytest.mark.parametrize("value", [True, np.True_])
def test_truth_is_no_real_number(name: str, value: Any) -> None:
    with pytest.raises(TypeError, match=f"{name} must be .*a real number, got"):
        algdiff.Differentiator(21, **{name: value})


def test_small_refusals() -> None:
    with pytest.raises(ValueError, match="fs must be finite and positive"):
        algdiff.Differentiator(21, fs=float("inf"))
    with pytest.raises(ValueError, match="axis must be from -2 to 1 for 2 dimensions, got -3"):
        algdiff.Differentiator(21)(np.zeros((2, 50)), axis=-3)
    with pytest.raises(ValueError, match="pos must be"):
        algdiff.savgol_coeffs(5, 2, pos=-0.5)


def test_out_must_not_be_the_memory_of_data_that_are_converted() -> None:
    memory = np.arange(100.0)
    before = memory.copy()
    for given in [memory.view(np.int64), memory.view(">f8"), memory.view(np.float16)[:100]]:
        with pytest.raises(ValueError, match="out must not overlap x"):
            algdiff.differentiate(given, 11, out=memory)
    np.testing.assert_array_equal(memory, before)


def test_the_warning_begins_above_its_limit() -> None:
    # 1.5 sqrt(100) = 15 and 1.5 sqrt(4) = 3 exactly; warnings are errors here.
    algdiff.Differentiator(100, degree=15)
    algdiff.Differentiator(4)
    with pytest.warns(algdiff.DesignWarning):
        algdiff.Differentiator(100, degree=16)


def test_replace_by_nothing_keeps_what_was() -> None:
    d = algdiff.Differentiator(33, tau="root", delta=0.1)
    assert d.replace(fs=None) == d
    assert d.replace(delay=None) == d


@pytest.mark.parametrize(
    "change",
    [
        {"window_length": 42},
        {"deriv": 2},
        {"degree": 5},
        {"kappa": 2.0},
        {"mu": 2.0},
        {"tau": 0.4},
        {"delta": 0.2},
        {"rule": "trapezoid"},
    ],
    ids=str,
)
def test_every_argument_tells_designs_apart(change: dict[str, Any]) -> None:
    d = design(41, 1, degree=4, kappa=1.0, mu=1.0, tau=0.3, delta=0.1)
    assert d != d.replace(**change)
    assert hash(d) != hash(d.replace(**change))
    kernel = {name: value for name, value in change.items() if name in ("deriv", "degree", "kappa", "mu", "tau")}
    values = {"deriv": 1, "degree": 4, "kappa": 1.0, "mu": 1.0, "tau": 0.3}
    assert (algdiff.Kernel(**values) != algdiff.Kernel(**{**values, **kernel})) == bool(kernel)


@pytest.mark.parametrize("mode", ["interp", "nearest", "wrap"])
def test_nan_survives_a_derivative_beyond_the_degree(mode: str) -> None:
    x = np.arange(40.0)
    x[20] = np.nan
    got = algdiff.savgol_filter(x, 7, 2, deriv=3, mode=mode)
    np.testing.assert_array_equal(got, scipy_signal.savgol_filter(x, 7, 2, deriv=3, mode=mode))
    assert np.isnan(got[17:24]).all()


def test_coordinates_are_even_to_a_billionth_of_a_step() -> None:
    f = np.arange(21.0)
    for error, even in [(0.5e-9, True), (2e-9, False), (1e-6, False)]:
        coordinates = np.arange(21.0)
        coordinates[7] += error
        slope = algdiff.gradient(f, coordinates, window_length=5)
        assert (np.abs(slope - 1).max() < 1e-13) == even
        np.testing.assert_allclose(algdiff.gradient(coordinates, coordinates, window_length=5), 1, rtol=0, atol=2e-9)


def test_a_single_point_gives_a_number() -> None:
    assert type(algdiff.Kernel(1)(0.25)) is np.float64
    assert isinstance(algdiff.Kernel(1)([0.25]), np.ndarray)


def test_misaligned_samples_are_fitted_as_others_are() -> None:
    raw = np.zeros(8 * 50 + 1, np.uint8)
    x = raw[1:].view(np.float64)
    x[:] = np.random.default_rng(0).standard_normal(50)
    weights = np.linspace(1, 2, 50)
    expected = algdiff.differentiate(x.copy(), 9, weights=weights)
    np.testing.assert_array_equal(algdiff.differentiate(x, 9, weights=weights), expected)


def test_durations_shorter_than_a_fit_are_raised_whatever_else_is_given() -> None:
    x = np.sin(np.arange(60.0))
    expected = algdiff.differentiate(x, window_duration=1.0)
    found = algdiff.differentiate(x, window_duration=1.0, weights=np.ones(60))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_an_empty_out_is_as_good_as_none() -> None:
    out = np.zeros((0, 20))
    assert algdiff.differentiate(out.copy(), 5, out=out) is out


@pytest.mark.parametrize("words", [{}, {"t": np.arange(20.0)}])
def test_times_of_estimates_are_a_row(words: dict[str, Any]) -> None:
    for at, said in ((3.0, r"got shape \(\)"), ([[3.0]], r"got shape \(1, 1\)"), ([np.nan], "got nan at place 0")):
        with pytest.raises(ValueError, match=f"^at must be a one-dimensional array of finite times, {said}$"):
            algdiff.differentiate(np.arange(20.0), 5, at=at, **words)
