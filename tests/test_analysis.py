"""What the continuous kernel does to signals and noise, against 50-digit formulas, the twin and the theory's numbers.

The grid holds negative, fractional and very large exponents and every kind of tau. Bounds are in EPS = 2^-52 times what
the formula adds up: a sum of terms errs by EPS times the sum of their sizes, exp(i omega T s) by EPS omega T, and a
density whose logarithm holds ln Gamma(x) by EPS times that.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable

import numpy as np
import pytest

import algdiff
import oracle
import reference
import reference_analysis as analysis
from reference_analysis import Design
from support import EPS, Array, kernel_rule

MODERATE = [(0.0, 0.0), (1.0, 1.0), (2.5, 0.25), (3.0, 0.0), (-0.5, 0.5), (-0.9, -0.3)]
LARGE = [(50.0, 50.0), (50.0, 2.5), (2.0, 300.0), (300.0, 300.0)]
ORDERS = [(0, 0), (0, 2), (1, 1), (1, 2), (1, 3), (2, 3), (3, 6)]
POINTS: list[float | str] = [0.0, "root", "center", 1.0, 1.2]
OMEGA_T = np.array([1e-6, 1e-3, 0.1, 1.0, 5.0, 30.0, 100.0, 1e3, 1e5, 1e6])


def grid(exponents: list[tuple[float, float]]) -> list[algdiff.Kernel]:
    """Return kernels of all exponents with all orders, and every tau in turn."""
    turns = itertools.cycle(POINTS)
    pairs = itertools.product(exponents, ORDERS)
    return [algdiff.Kernel(n, degree, kappa, mu, next(turns)) for (kappa, mu), (n, degree) in pairs]


KERNELS = grid(MODERATE)
BROAD = [*KERNELS, *grid(LARGE)]


def design_of(kernel: algdiff.Kernel) -> Design:
    return kernel.deriv, kernel.degree, kernel.kappa, kernel.mu, kernel.tau


def kernel_id(kernel: algdiff.Kernel) -> str:
    return "-".join(f"{value:.4g}" for value in design_of(kernel))


def log_rounding(kernel: algdiff.Kernel) -> float:
    """Return 1 + the largest ln Gamma in the density, what a logarithm costs, times the slope at a singular end."""
    largest = 1 + abs(math.lgamma(kernel.kappa + kernel.mu + 2 * kernel.degree + 2))
    return largest / min(1.0, 1 + kernel.kappa, 1 + kernel.mu)


def pass_band_size(kernel: algdiff.Kernel) -> float:
    """Return what G adds up: the sum of gauss |R_q| without cancellation."""
    n, q = kernel.deriv, kernel.degree - kernel.deriv
    a, b = kernel.kappa + n, kernel.mu + n
    nodes, gauss = reference.gauss_rule(q + 40, a, b)
    at_tau = np.abs(reference.orthonormal(a, b, q, kernel.tau)[:, 0])
    return float(at_tau @ np.abs(reference.orthonormal(a, b, q, nodes)) @ gauss)


def stop_band_size(omega_t: Array, kernel: algdiff.Kernel) -> Array:
    """Return what H adds up far out, where it comes from the two ends: the asymptotes without cancellation."""
    n, q = kernel.deriv, kernel.degree - kernel.deriv
    a, b = kernel.kappa + n, kernel.mu + n
    at_tau = np.abs(reference.orthonormal(a, b, q, kernel.tau)[:, 0])
    total = np.zeros_like(omega_t)
    for exponent, end in ((a, 0.0), (b, 1.0)):
        size = at_tau @ np.abs(reference.orthonormal(a, b, q, end)[:, 0])
        gain = math.lgamma(exponent + 1) - reference.log_beta(a + 1, b + 1) + math.log(size)
        total += np.exp(gain - (exponent - n + 1) * np.log(omega_t))
    return total


def rounding_bound(omega_t: Array, kernel: algdiff.Kernel) -> Array:
    """Return what a sum over the window may err by: EPS times its terms and the turns of exp(i omega T s)."""
    size = pass_band_size(kernel) * np.abs(omega_t) ** kernel.deriv
    return 64 * EPS * (log_rounding(kernel) + np.abs(omega_t)) * size


def response_bound(omega_t: Array, amplitude: Array, kernel: algdiff.Kernel) -> Array:
    """Return the error allowed to a response: of rounding in the pass band, 1e-9 of itself in the stop band.

    In between, any sum over the window cancels: it errs by EPS times its terms, which the response falls below.
    """
    rounding = rounding_bound(omega_t, kernel)
    return np.minimum(rounding, 1e-9 * (amplitude + stop_band_size(omega_t, kernel)))


@pytest.mark.parametrize("kernel", KERNELS, ids=kernel_id)
def test_response_to_every_frequency(kernel: algdiff.Kernel) -> None:
    expected = np.array([oracle.frequency_response(w, design_of(kernel)) for w in OMEGA_T])
    error = np.abs(kernel.frequency_response(OMEGA_T) - expected)
    bound = response_bound(OMEGA_T, np.abs(expected), kernel)
    assert (error <= bound).all(), np.column_stack([OMEGA_T, error / bound])


@pytest.mark.parametrize("kernel", grid(LARGE), ids=kernel_id)
def test_response_of_large_exponents(kernel: algdiff.Kernel) -> None:
    # The stop band falls below 1e-600: there an absolute bound must do.
    expected = np.array([oracle.frequency_response(w, design_of(kernel)) for w in OMEGA_T])
    error = np.abs(kernel.frequency_response(OMEGA_T) - expected)
    bound = rounding_bound(OMEGA_T, kernel)
    assert (error <= bound).all(), np.column_stack([OMEGA_T, error / bound])


@pytest.mark.parametrize("kernel", BROAD, ids=kernel_id)
def test_response_at_zero_of_both_signs_and_from_another_origin(kernel: algdiff.Kernel) -> None:
    at_zero = kernel.frequency_response(0.0)
    assert abs(at_zero - (kernel.deriv == 0)) <= rounding_bound(np.zeros(1), kernel)[0]
    response = kernel.frequency_response(OMEGA_T)
    np.testing.assert_array_equal(kernel.frequency_response(-OMEGA_T), np.conj(response))
    for origin in (0, 1.0, 0.25):
        turned = response * np.exp(1j * OMEGA_T * (kernel.tau - origin))
        ours = kernel.frequency_response(OMEGA_T, reference=origin)
        assert (np.abs(ours - turned) <= 2 * rounding_bound(OMEGA_T, kernel)).all()
    np.testing.assert_array_equal(kernel.frequency_response(OMEGA_T, reference=kernel.tau), response)


def test_response_keeps_the_shape_and_takes_what_is_a_number() -> None:
    kernel = algdiff.Kernel(1, 2)
    square = np.array([[0.0, 1.0, 2.0], [-3.0, 40.0, 5.0]])
    response = kernel.frequency_response(square)
    assert response.shape == (2, 3)
    assert response.dtype == np.complex128
    assert kernel.frequency_response(np.float32(2)) == pytest.approx(response[0, 2], rel=1e-14)
    assert np.ndim(kernel.frequency_response(2)) == 0
    assert kernel.frequency_response([[]]).shape == (1, 0)
    for bad in (np.nan, np.inf, [1.0, -np.inf]):
        with pytest.raises(ValueError, match="omega_T"):
            kernel.frequency_response(bad)
    for worse in ("1", 1j, None):
        with pytest.raises(TypeError, match="omega_T"):
            kernel.frequency_response(worse)
    with pytest.raises(ValueError, match="reference"):
        kernel.frequency_response(1.0, reference=np.nan)


@pytest.mark.parametrize("kernel", [k for k in KERNELS if k.deriv], ids=kernel_id)
def test_response_is_i_omega_times_the_response_of_one_order_less(kernel: algdiff.Kernel) -> None:
    n, degree, kappa, mu, tau = design_of(kernel)
    smoother = algdiff.Kernel(n - 1, degree - 1, kappa + 1, mu + 1, tau)
    if smoother.tau != tau:
        pytest.skip("tau is a root that was rounded differently")
    expected = 1j * OMEGA_T * smoother.frequency_response(OMEGA_T)
    bound = 2 * response_bound(OMEGA_T, np.abs(expected), kernel)
    assert (np.abs(kernel.frequency_response(OMEGA_T) - expected) <= bound).all()


# asymptotes, cutoff, half power


@pytest.mark.parametrize("kernel", BROAD, ids=kernel_id)
def test_asymptote_constants_and_cutoff(kernel: algdiff.Kernel) -> None:
    logs = np.array(oracle.log_asymptote_constants(design_of(kernel)))
    twin = np.array(analysis.log_asymptote_constants(design_of(kernel)))
    zero = np.isneginf(twin)
    rtol = 64 * EPS * log_rounding(kernel) * (kernel.degree + 1) ** 2
    constants = np.array(kernel.asymptote_constants)
    with np.errstate(over="ignore"):
        np.testing.assert_allclose(constants[~zero], np.exp(logs[~zero]), rtol=100 * rtol)
    assert kernel.roll_off == min(kernel.kappa, kernel.mu) + kernel.deriv + 1
    expected = analysis.cutoff(design_of(kernel))
    if expected is None:
        assert kernel.cutoff is None
        return
    assert kernel.cutoff == pytest.approx(expected, rel=100 * rtol)
    omega = np.array([0.25, 1.0, 3.0, 100.0]) * expected
    ours = kernel.asymptotes(omega)
    assert type(ours).__name__ == "Asymptotes"
    upper, lower, model = analysis.asymptotes(omega, design_of(kernel))
    finite = np.isfinite(upper)
    np.testing.assert_allclose(ours.upper, upper, rtol=100 * rtol)
    assert (np.abs(ours.lower - lower)[finite] <= 100 * rtol * upper[finite]).all()  # a difference of the two ends
    np.testing.assert_allclose(ours.low_pass, model, rtol=100 * rtol)
    assert ours.upper.shape == ours.lower.shape == ours.low_pass.shape == omega.shape
    mirrored = kernel.asymptotes(-omega)
    np.testing.assert_array_equal(mirrored.upper, ours.upper)
    np.testing.assert_array_equal(mirrored.low_pass, ours.low_pass)
    assert np.ndim(kernel.asymptotes(2.0).upper) == 0


@pytest.mark.parametrize("kernel", KERNELS, ids=kernel_id)
def test_far_out_the_amplitude_touches_its_upper_bound(kernel: algdiff.Kernel) -> None:
    if np.isneginf(analysis.log_asymptote_constants(design_of(kernel))).any():
        pytest.skip("without its leading term an end falls faster than the bound says")
    omega = 1e5 + np.linspace(0, 2 * np.pi, 400)  # the two ends pass through every relative phase
    ratio = np.abs(kernel.frequency_response(omega)) / kernel.asymptotes(omega).upper
    assert 0.999 <= ratio.max() <= 1.0001
    lower = kernel.asymptotes(omega).lower / kernel.asymptotes(omega).upper
    assert (ratio >= lower - 1e-3).all()


@pytest.mark.parametrize("kernel", [k for k in BROAD[::2] if pass_band_size(k) < 10], ids=kernel_id)
def test_half_power(kernel: algdiff.Kernel) -> None:
    expected = analysis.half_power(design_of(kernel))
    assert kernel.half_power == pytest.approx(expected, rel=1e-9)
    assert kernel.half_power == pytest.approx(oracle.half_power(expected, design_of(kernel)), rel=1e-11)
    gain = abs(kernel.frequency_response(kernel.half_power)) / kernel.half_power**kernel.deriv
    assert gain == pytest.approx(math.sqrt(0.5), rel=1e-11)


def test_half_power_of_slow_and_of_loud_responses() -> None:
    # Most of the weight at one end: a long way to half the power, or none at all.
    # Prediction multiplies the gain, and so the frequency at which it has fallen: beyond the sum over the window.
    for kernel in (algdiff.Kernel(0, 0, -0.95, -0.2, 0.5), algdiff.Kernel(1, 3, 0, 0, 20.0)):
        omega = kernel.half_power
        assert omega is not None
        assert omega > 60
        assert float(abs(oracle.low_pass(omega, design_of(kernel)))) == pytest.approx(math.sqrt(0.5), rel=1e-9)
    assert algdiff.Kernel(0, 0, -0.99, -0.2, 0.5).half_power is None


# (n, N, kappa = mu, tau), cutoff, half power: theory section 6
@pytest.mark.parametrize(
    ("n", "degree", "exponent", "tau", "corner", "half"),
    [
        (1, 1, 0, 0.5, 2.449, 3.630),
        (1, 1, 2, 0.5, 5.384, 4.915),
        (1, 1, 5, 0.5, 9.795, 6.382),
        (1, 2, 0, "root", 4.406, 6.358),
        (1, 2, 0, 1.0, 6.000, 9.043),
        (1, 3, 0, 0.5, 3.873, 7.842),
        (2, 3, 1, 1.0, 9.573, 12.58),
    ],
)
def test_cutoff_and_half_power_of_the_theory(
    n: int, degree: int, exponent: float, tau: float | str, corner: float, half: float
) -> None:
    kernel = algdiff.Kernel(n, degree, exponent, exponent, tau)
    assert kernel.cutoff == pytest.approx(corner, rel=2e-4)
    assert kernel.half_power == pytest.approx(half, rel=4e-4)


def test_no_cutoff_where_the_governing_end_vanishes() -> None:
    for kernel in (algdiff.Kernel(1, 4, 1, 2, 0.5), algdiff.Kernel(2, 3, 2, 1, 0.5)):
        assert kernel.cutoff is None
        assert kernel.half_power > 0


def test_without_a_cutoff_there_is_no_low_pass_model() -> None:
    bounds = algdiff.Kernel(1, 4, 1, 2, 0.5).asymptotes([0.5, 5.0, 500.0])
    assert np.isnan(bounds.low_pass).all()
    assert np.isfinite(bounds.upper).all()


# responses in time


@pytest.mark.parametrize("kernel", BROAD, ids=kernel_id)
def test_impulse_and_step_response(kernel: algdiff.Kernel) -> None:
    t = np.array([-1.0, -1e-9, 1e-6, 0.01, 0.2, 0.5, 0.77, 0.874, 0.9865, 0.999, 1 + 1e-9, 3.0])
    np.testing.assert_array_equal(kernel.impulse_response(t), kernel(1 - t))
    gain = analysis.norm1(design_of(kernel))
    atol = 64 * EPS * log_rounding(kernel) * gain
    expected = [analysis.step_response(float(x), design_of(kernel)) for x in t]
    step = kernel.step_response(t)
    np.testing.assert_allclose(step, expected, rtol=0, atol=atol)
    assert step[0] == step[1] == 0
    assert step[-1] == step[-2] == kernel.step_response(1.0)
    assert abs(step[-1] - (kernel.deriv == 0)) <= atol
    assert kernel.step_response(0.0) == 0
    assert kernel.step_response(t.reshape(3, 4)).shape == kernel.impulse_response(t.reshape(3, 4)).shape == (3, 4)


@pytest.mark.parametrize("kernel", [k for k in BROAD if k.deriv], ids=kernel_id)
def test_the_step_response_is_the_impulse_response_of_one_order_less(kernel: algdiff.Kernel) -> None:
    n, degree, kappa, mu, tau = design_of(kernel)
    t = np.linspace(0.01, 0.99, 50)
    expected = reference.kernel(1 - t, n - 1, degree - 1, kappa + 1, mu + 1, tau)
    atol = 64 * EPS * log_rounding(kernel) * analysis.norm1(design_of(kernel))
    np.testing.assert_allclose(kernel.step_response(t), expected, rtol=0, atol=atol)


def test_the_step_response_is_the_integral_of_the_impulse_response() -> None:
    for kernel in (algdiff.Kernel(1, 3), algdiff.Kernel(0, 2, 2, 3, "newest"), algdiff.Kernel(2, 4, 2, 1, 0.3)):
        t = np.linspace(0, 1, 20_001)
        impulse = kernel.impulse_response(t)
        steps = (impulse[1:] + impulse[:-1]) / 2 * np.diff(t)
        curvature = np.abs(
            np.diff(impulse, 2)
        ).max()  # the trapezoid errs by at most h^3 k''/12 in each of 20,000 steps
        np.testing.assert_allclose(kernel.step_response(t[1:]), np.cumsum(steps), rtol=0, atol=curvature / 12)


@pytest.mark.parametrize("bad", ["1", 1j, None])
def test_times_must_be_numbers(bad: object) -> None:
    kernel = algdiff.Kernel(1, 3)
    for response in (kernel.impulse_response, kernel.step_response):
        assert np.isnan(response(np.nan))
        with pytest.raises(TypeError, match=r"^t must be (real|an array of) numbers, got"):
            response(bad)


# gains


@pytest.mark.parametrize("kernel", BROAD, ids=kernel_id)
def test_norm1_equals_the_reference(kernel: algdiff.Kernel) -> None:
    expected = analysis.norm1(design_of(kernel))
    assert kernel.norm1 == pytest.approx(expected, rel=64 * EPS * log_rounding(kernel) * (kernel.degree + 1))


@pytest.mark.parametrize(
    ("n", "degree", "exponent", "tau", "expected"),
    [
        (1, 1, 0, 0.5, 3.0),
        (1, 1, 2, 0.5, 4.375),
        (1, 2, 0, 1.0, 11.78),
        (1, 2, 0, "root", 5.69),
        (1, 3, 0, 0.5, 7.77),
        (2, 3, 1, "root", 65.6),
        (2, 3, 1, 1.0, 183.3),
        (3, 4, 1, 1.0, 2941.0),
    ],
)
def test_norm1_of_the_theory(n: int, degree: int, exponent: float, tau: float | str, expected: float) -> None:
    kernel = algdiff.Kernel(n, degree, exponent, exponent, tau)
    assert kernel.norm1 == pytest.approx(expected, rel=1e-3)
    s = (np.arange(200_000) + 0.5) / 200_000
    assert kernel.norm1 == pytest.approx(np.abs(kernel(s)).mean(), rel=1e-6)
    assert (kernel(s) * np.sign(kernel(s))).mean() <= kernel.norm1 * (1 + 1e-6)  # attained by the sign of the kernel
    assert kernel.norm1**2 <= kernel.norm2 * (1 + 8 * EPS)  # Cauchy and Schwarz


@pytest.mark.parametrize("degree", [25, 60, 120])
def test_norm1_sees_every_change_of_sign(degree: int) -> None:
    for kernel in (algdiff.Kernel(0, degree, 0, 0, 0.5), algdiff.Kernel(1, degree, 1, 0, 0.8)):
        s = (np.arange(400_000) + 0.5) / 400_000  # some 3000 points between two zeros
        assert kernel.norm1 == pytest.approx(float(np.abs(kernel(s)).mean()), rel=1e-4)


def test_no_window_of_a_smoother_reduces_bounded_noise() -> None:
    with pytest.raises(ValueError, match="deriv must be at least 1 for bounded noise"):
        algdiff.Kernel(0, 2).optimal_duration(0.1, 1.0, bounded=True)


# bias


@pytest.mark.parametrize("kernel", BROAD, ids=kernel_id)
def test_monomials_err_by_the_bias_constant(kernel: algdiff.Kernel) -> None:
    n, p = kernel.deriv, kernel.bias_order
    assert n + p == kernel.exactness + 1
    points, masses = kernel_rule(kernel)
    size = np.abs(masses).sum()
    for m in range(n + p + 1):
        x = points**m
        true = math.perm(m, n) * kernel.tau ** (m - n) if m >= n else 0.0
        error = float(masses @ x) - true
        expected = kernel.bias_constant * math.factorial(n + p) if m == n + p else 0.0
        atol = 64 * EPS * log_rounding(kernel) * (size + abs(true))
        assert error == pytest.approx(expected, rel=0, abs=atol)
    assert kernel.bias_bound == pytest.approx(analysis.bias_bound(design_of(kernel)), rel=64 * EPS)
    assert abs(kernel.bias_constant) <= kernel.bias_bound * (1 + 64 * EPS)


def smooth_signal(rng: np.random.Generator) -> Callable[[Array, int], Array]:
    """Return a random sum of sines as a function of the points and the order of the derivative."""
    amplitude, omega, phase = rng.standard_normal(4), rng.uniform(0.1, 6, 4), rng.uniform(0, 6.3, 4)

    def derivative(t: Array, order: int) -> Array:
        arguments = np.multiply.outer(t, omega) + phase + order * np.pi / 2
        value: Array = np.sin(arguments) @ (amplitude * omega**order)
        return value

    return derivative


@pytest.mark.parametrize("kernel", BROAD, ids=kernel_id)
def test_smooth_signals_stay_within_the_bias_bound(kernel: algdiff.Kernel) -> None:
    rng = np.random.default_rng(7)
    points, masses = kernel_rule(kernel)
    hull = np.linspace(min(0, kernel.tau), max(1, kernel.tau), 2001)
    for _, duration in itertools.product(range(5), (0.1, 1.0, 2.0)):
        signal = smooth_signal(rng)
        estimate = masses @ signal(duration * points, 0) / duration**kernel.deriv
        true = float(signal(np.array(duration * kernel.tau), kernel.deriv))
        order = kernel.deriv + kernel.bias_order
        largest = np.abs(signal(duration * hull, order)).max()
        bound = kernel.bias_bound * duration**kernel.bias_order * largest
        noise = 64 * EPS * log_rounding(kernel) * np.abs(masses).sum() * 8 / duration**kernel.deriv
        assert abs(estimate - true) <= bound + noise


@pytest.mark.parametrize("kernel", BROAD, ids=kernel_id)
def test_moment_delay(kernel: algdiff.Kernel) -> None:
    n, degree, kappa, mu, tau = design_of(kernel)
    mean = (mu + n + 1) / (kappa + mu + 2 * n + 2)  # q = 0: a mean of the derivative, wherever it is said to lie
    expected = 1 - tau if degree > n else mean
    atol = 64 * EPS * log_rounding(kernel) * (1 + analysis.norm1(design_of(kernel)))
    assert kernel.moment_delay == pytest.approx(expected, rel=0, abs=atol)
    slow = 1e-4
    phase = np.angle(kernel.frequency_response(slow, reference=1) / (1j * slow) ** n)
    assert -phase / slow == pytest.approx(kernel.moment_delay, rel=0, abs=1e-6)


# the best window


@pytest.mark.parametrize("kernel", [k for k in KERNELS if min(k.kappa, k.mu) > -0.5], ids=kernel_id)
def test_optimal_duration_is_where_the_error_is_least(kernel: algdiff.Kernel) -> None:
    for noise, bound, delta in [(0.02, 50.0, 1e-3), (1.0, 1e-3, 1.0), (1e-6, 1e6, 0.1)]:
        best = kernel.optimal_duration(noise, bound, delta)
        assert best == pytest.approx(analysis.optimal_duration(noise, bound, delta, design_of(kernel)), rel=1e-12)
        least = kernel.rmse(best, noise, bound, delta)
        assert least == pytest.approx(analysis.rmse(best, noise, bound, delta, design_of(kernel)), rel=1e-12)
        for factor in (0.5, 0.99, 1.01, 2.0):
            assert kernel.rmse(factor * best, noise, bound, delta) > least
    assert kernel.optimal_duration(0.02, 50.0) == kernel.optimal_duration(0.02, 50.0, 1.0)


@pytest.mark.parametrize("kernel", [k for k in KERNELS if k.deriv], ids=kernel_id)
def test_optimal_duration_for_bounded_noise(kernel: algdiff.Kernel) -> None:
    noise, bound = 0.01, 7.0
    best = kernel.optimal_duration(noise, bound, bounded=True)
    assert best == pytest.approx(analysis.optimal_duration_bounded(noise, bound, design_of(kernel)), rel=1e-11)

    def worst(duration: float) -> float:
        bias = abs(kernel.bias_constant) * bound * duration**kernel.bias_order
        return float(bias + noise * kernel.norm1 / duration**kernel.deriv)

    assert worst(best) < min(worst(0.99 * best), worst(1.01 * best))
    assert kernel.optimal_duration(noise, bound, 0.1, bounded=True) == best  # a bound knows no sampling rate


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_the_best_window_needs_positive_numbers(bad: float) -> None:
    kernel = algdiff.Kernel(1, 3)
    for arguments, name in [((bad, 1.0), "noise_level"), ((1.0, bad), "derivative_bound"), ((1.0, 1.0, bad), "delta")]:
        if name == "noise_level" and bad == 0:
            continue  # no noise: the shortest window, or a refusal
        with pytest.raises(ValueError, match=name):
            kernel.optimal_duration(*arguments)
    with pytest.raises(ValueError, match="duration"):
        kernel.rmse(bad, 1.0, 1.0)


def test_the_analysis_is_plain_numbers() -> None:
    kernel = algdiff.Kernel(2, 4, tau="root")
    numbers = [kernel.roll_off, kernel.cutoff, kernel.half_power, kernel.norm1, kernel.norm2, kernel.bias_order]
    numbers += [kernel.bias_constant, kernel.bias_bound, kernel.moment_delay, *kernel.asymptote_constants]
    assert json.loads(json.dumps(numbers)) == numbers
