"""What the weights of a design do to signals and noise, and windows found by what they shall do."""

from __future__ import annotations

import itertools
import json
import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.special

import algdiff
import reference
import reference_analysis as analysis
from support import EPS, Array, design

RULES = [*reference.CELLS, *reference.NODES]
DESIGNS: list[tuple[int, int, dict[str, Any]]] = [
    (5, 1, {}),
    (21, 1, {"kappa": 0, "mu": 0, "tau": "newest"}),
    (41, 2, {"degree": 5, "tau": "root", "delta": 1e-3}),
    (33, 0, {"degree": 3, "kappa": 2.5, "mu": 0.5, "tau": 0.3, "fs": 50.0}),
    (40, 3, {"kappa": -0.5, "mu": 1, "tau": 1.2}),
    (101, 1, {"degree": 1, "kappa": 50, "mu": 30, "tau": 0.0, "delta": 0.1}),
    (61, 1, {"kappa": 10, "mu": 10, "trim": 0.01}),
    (31, 1, {"rule": "trapezoid", "tau": "newest"}),
    (31, 2, {"rule": "hat", "kappa": -0.3, "mu": 0.5, "delta": 7.0}),
    (31, 1, {"rule": "cell", "degree": 2, "tau": "root"}),
    (31, 0, {"rule": "simpson", "degree": 2, "kappa": 3, "mu": 2}),
    (30, 1, {"rule": "midpoint", "degree": 1, "kappa": 2, "mu": 2}),
    (31, 1, {"rule": "hat", "tau": 0.4}),
    (20, 0, {"rule": "cell", "kappa": 2, "mu": 2}),
]
IDS = [f"L{length}-n{deriv}-{'-'.join(map(str, options.values()))}" for length, deriv, options in DESIGNS]
on_all_designs = pytest.mark.parametrize("ours", [design(length, n, **o) for length, n, o in DESIGNS], ids=IDS)


def times(ours: algdiff.Differentiator) -> Array:
    """Return the times of the samples of the window, 0 being that of the estimate."""
    count = len(ours.weights)
    return (np.arange(count) - (count - 1 - ours.delay_samples)) * ours.delta


@on_all_designs
def test_frequency_response_is_that_of_the_weights(ours: algdiff.Differentiator) -> None:
    nyquist = 0.5 / ours.delta
    f = np.concatenate([[0.0], np.geomspace(1e-6, 1, 20) * nyquist, [3.7 * nyquist]])
    expected = analysis.dtft(f, ours.weights, ours.delta, len(ours.weights) - 1 - ours.delay_samples)
    span = np.abs(times(ours)).max()
    bound = 64 * EPS * (len(ours.weights) + 2 * np.pi * f * span) * ours.norm1
    response = ours.frequency_response(f)
    assert (np.abs(response - expected) <= bound).all()
    np.testing.assert_array_equal(ours.frequency_response(-f), np.conj(response))
    assert response.dtype == np.complex128
    assert ours.frequency_response(f.reshape(2, 11)).shape == (2, 11)
    assert np.ndim(ours.frequency_response(nyquist)) == 0


@on_all_designs
def test_exact_rules_differentiate_slow_signals(ours: algdiff.Differentiator) -> None:
    if ours.rule != "exact":
        pytest.skip("leaks")
    omega = 1e-3 / ours.duration
    ratio = ours.frequency_response(omega / (2 * np.pi)) / (1j * omega) ** ours.deriv
    rounding = 64 * EPS * len(ours.weights) * ours.norm1 / omega**ours.deriv
    size = ours.bias_bound if math.isfinite(ours.bias_bound) else 0
    assert abs(ratio - 1) <= 2 * size * omega**ours.bias_order + rounding


@on_all_designs
def test_numbers_of_the_kernel_in_physical_units(ours: algdiff.Differentiator) -> None:
    kernel, duration = ours.kernel, ours.duration
    steps = ours.window_length - (ours.rule in reference.NODES)
    assert duration == pytest.approx(steps * ours.delta, rel=4 * EPS)
    f = np.array([0.1, 1.0, 5.0]) / duration
    for value, unscaled in zip(ours.asymptotes(f), kernel.asymptotes(2 * np.pi * f * duration), strict=True):
        np.testing.assert_allclose(value, unscaled / duration**ours.deriv, rtol=64 * EPS * (1 + kernel.roll_off))
    corner = kernel.cutoff
    assert corner is not None
    assert ours.cutoff == pytest.approx(corner / (2 * np.pi * duration), rel=8 * EPS)
    at = np.abs(kernel.frequency_response([corner, np.pi * duration / ours.delta]))
    assert ours.nyquist_attenuation == pytest.approx(20 * np.log10(at[0] / at[1]), rel=1e-6, abs=1e-6)


@on_all_designs
def test_half_power_is_the_first_fall_through_it(ours: algdiff.Differentiator) -> None:
    nyquist = 0.5 / ours.delta
    leaks = ours.exactness < ours.deriv  # then the gain starts elsewhere than at 1
    start = 0.2 / ours.duration if leaks else 1e-3 / ours.duration
    f = np.linspace(start, nyquist, 20_001)
    gain = np.abs(ours.frequency_response(f)) / (2 * np.pi * f) ** ours.deriv
    below = np.flatnonzero((gain[1:] < math.sqrt(0.5)) & (gain[:-1] >= math.sqrt(0.5)))
    if len(below) == 0:
        assert ours.half_power is None
        return
    assert ours.half_power == pytest.approx(f[below[0]], abs=1.01 * (f[1] - f[0]))
    at = abs(ours.frequency_response(ours.half_power)) / (2 * np.pi * ours.half_power) ** ours.deriv
    assert at == pytest.approx(math.sqrt(0.5), rel=1e-9)


@on_all_designs
def test_impulse_and_step_response(ours: algdiff.Differentiator) -> None:
    count = len(ours.weights)
    x = np.zeros(3 * count)
    x[count] = 1
    filtered = ours(x, mode="valid")[1:]  # output i belongs to the newest sample count + i
    atol = 64 * EPS * count * ours.norm1
    step = np.arange(2 * count) * ours.delta
    np.testing.assert_allclose(ours.impulse_response(step), filtered, rtol=0, atol=atol)
    np.testing.assert_array_equal(ours.impulse_response(step[:count]), ours.weights[::-1])
    x[count:] = 1
    np.testing.assert_allclose(ours.step_response(step), ours(x, mode="valid")[1:], rtol=0, atol=atol)
    np.testing.assert_array_equal(ours.step_response(step + 0.4 * ours.delta), ours.step_response(step))  # held
    assert ours.impulse_response(-1e-3 * ours.delta) == ours.step_response(-1e-3 * ours.delta) == 0
    assert ours.impulse_response(1e6 * ours.delta) == 0
    assert ours.step_response(1e6 * ours.delta) == pytest.approx(ours.weights.sum(), rel=0, abs=atol)
    assert ours.step_response(step.reshape(2, -1)).shape == (2, count)


@on_all_designs
def test_gains(ours: algdiff.Differentiator) -> None:
    assert ours.noise_gain == pytest.approx(math.fsum(ours.weights**2), rel=EPS * len(ours.weights))
    assert ours.norm1 == pytest.approx(math.fsum(np.abs(ours.weights)), rel=EPS * len(ours.weights))
    worst = np.sign(ours.weights)  # no disturbance of size 1 does more
    atol = 64 * EPS * len(worst) * ours.norm1
    (reached,) = ours(worst, mode="valid")
    assert reached == pytest.approx(ours.norm1, rel=0, abs=atol)
    noise = np.random.default_rng(0).uniform(-1, 1, 5000)
    assert np.abs(ours(noise, mode="valid")).max() <= ours.norm1 + atol


def test_noise_gain_is_the_variance_of_filtered_noise() -> None:
    noise = np.random.default_rng(1).standard_normal(400_000)
    for length, deriv, options in DESIGNS[:6]:
        ours = design(length, deriv, **options)
        variance = np.var(ours(noise, mode="valid"))
        # estimates a window apart are independent: 400,000 / L of them, each square of relative variance 2
        assert variance == pytest.approx(ours.noise_gain, rel=5 * math.sqrt(2 * length / 400_000))


def test_noise_gain_tends_to_that_of_the_kernel() -> None:
    for exponent, tau in itertools.product([0, 1, 2.5], ["center", "root", 1.0]):
        for rule in RULES:
            ours = design(2001, degree=2, kappa=exponent, mu=exponent, tau=tau, rule=rule, delta=1e-3)
            limit = ours.kernel.norm2 * ours.delta / ours.duration**3
            uneven = 10 / 9 if rule == "simpson" else 1  # 4:2 weights: (16 + 4)/2 of 9
            assert ours.noise_gain == pytest.approx(uneven * limit, rel=0.02)


# bias and delay


@on_all_designs
def test_monomials_err_by_the_bias_constant(ours: algdiff.Differentiator) -> None:
    n, p = ours.deriv, ours.bias_order
    assert n + p == ours.exactness + 1
    t = times(ours)
    for m in range(n + p + 1):
        error = float(ours.weights @ t**m) - (math.factorial(n) if m == n else 0)
        expected = ours.bias_constant * math.factorial(n + p) if m == n + p else 0
        rounding = 256 * EPS * len(t) * float(np.abs(ours.weights) @ np.abs(t) ** m) + 4 * EPS * math.factorial(m)
        leak = 1e-10 * ours.norm1 * np.abs(t).max() ** m if m < n + p else 0  # what exactness calls zero
        assert error == pytest.approx(expected, rel=0, abs=rounding + leak)
    assert abs(ours.bias_constant) <= ours.bias_bound * (1 + 1e-12)


def smooth_signal(rng: np.random.Generator, scale: float) -> Callable[[Array, int], Array]:
    """Return a random sum of slow sines as a function of the time and the order of the derivative."""
    amplitude, omega, phase = rng.standard_normal(4), rng.uniform(0.1, 6, 4) / scale, rng.uniform(0, 6.3, 4)

    def derivative(t: Array, order: int) -> Array:
        value: Array = np.sin(np.multiply.outer(t, omega) + phase + order * np.pi / 2) @ (amplitude * omega**order)
        return value

    return derivative


@on_all_designs
def test_smooth_signals_stay_within_the_bias_bound(ours: algdiff.Differentiator) -> None:
    if ours.bias_order < 0:  # a derivative below `deriv` leaks, and that one bounds nothing
        assert ours.bias_bound == math.inf
        return
    assert math.isfinite(ours.bias_bound)  # x^(n) in the mean over the window, and at the estimate
    rng = np.random.default_rng(5)
    t = times(ours)
    hull = np.linspace(min(t[0], 0), max(t[-1], 0), 3001)
    worst = 0.0
    for _ in range(30):
        signal = smooth_signal(rng, ours.duration)
        x = signal(t, 0)
        error = abs(ours.weights @ x - signal(np.zeros(1), ours.deriv)[0])
        bound = ours.bias_bound * np.abs(signal(hull, ours.deriv + ours.bias_order)).max()
        rounding = 64 * EPS * len(t) * ours.norm1 * np.abs(x).max()
        assert error <= bound * (1 + 1e-4) + rounding  # the largest value lies between two points of the hull
        worst = max(worst, error / bound)
    assert worst > 1e-4  # a bound that says something


@pytest.mark.parametrize("rule", ["midpoint", "trapezoid"])
def test_the_bias_bound_covers_a_value_that_no_sample_sees(rule: str) -> None:
    # 1 at every sample and -1 at the estimate, between two of them: what leaks a constant is wrong about both.
    ours = design(21, 0, degree=1, kappa=1, mu=1, delay=4.5, rule=rule)
    assert (ours.exactness, ours.bias_order) == (-1, 0)
    x = np.cos(2 * np.pi * times(ours) + np.pi)
    error = abs(float(ours.weights @ x) - math.cos(np.pi))
    assert error == pytest.approx(2, rel=0.1)
    assert error <= ours.bias_bound * (1 + 64 * EPS)


@on_all_designs
def test_moment_delay(ours: algdiff.Differentiator) -> None:
    n = ours.deriv
    if ours.exactness >= n + 1:
        assert ours.moment_delay == pytest.approx(ours.delay, rel=0, abs=1e-10 * ours.duration)
    elif ours.exactness == n:  # one moment beyond those that hold
        moment = float(ours.weights @ times(ours) ** (n + 1)) / math.factorial(n + 1)
        assert ours.moment_delay == pytest.approx(ours.delay - moment, rel=0, abs=1e-10 * ours.duration)


@pytest.mark.parametrize("tau", [0.0, 0.3, "center", "newest", 1.2])
def test_a_mean_of_the_derivative_has_one_delay_whatever_tau(tau: float | str) -> None:
    for n, kappa, mu in [(0, 2.0, 1.0), (1, 1.0, 3.0), (2, 0.0, 2.5)]:
        ours = design(2001, n, degree=n, kappa=kappa, mu=mu, tau=tau, delta=0.01)
        continuous = (mu + n + 1) / (kappa + mu + 2 * n + 2) * ours.duration
        assert ours.kernel.moment_delay * ours.duration == pytest.approx(continuous, rel=1e-12)
        assert ours.moment_delay == pytest.approx(continuous - ours.delta / 2, abs=2e-5 * ours.duration)


# the discretisation


def l2_error(ours: algdiff.Differentiator, largest: float) -> float:
    """Return the relative error of the response by a plain sum over 4001 frequencies."""
    f = np.linspace(0, largest, 4001)
    continuous = ours.kernel.frequency_response(2 * np.pi * f * ours.duration) / ours.duration**ours.deriv
    weight = np.ones(f.size)
    weight[[0, -1]] = 0.5
    squares = [weight @ np.abs(h) ** 2 for h in (ours.frequency_response(f) - continuous, continuous)]
    return float(math.sqrt(squares[0] / squares[1]))


@on_all_designs
def test_discretisation_error_is_the_distance_of_two_responses(ours: algdiff.Differentiator) -> None:
    assert ours.discretisation_error() == pytest.approx(l2_error(ours, 0.5 / ours.delta), rel=2e-3, abs=1e-12)
    f = 0.7 / ours.duration
    assert ours.discretisation_error(f) == pytest.approx(l2_error(ours, f), rel=2e-3, abs=1e-10)
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="frequency"):
            ours.discretisation_error(bad)


@pytest.mark.parametrize(("exponent", "order"), [(0, 2), (1, 2), (2, 4), (3, 4), (0.25, 1.25), (1.5, 2.5)])
def test_the_trapezoid_converges_as_the_theory_says(exponent: float, order: float) -> None:
    errors = []
    for steps in (100, 200):
        options: dict[str, Any] = {"degree": 2, "kappa": exponent, "mu": exponent, "tau": 1.0, "delta": 1 / steps}
        ours = design(steps + 1, rule="trapezoid", **options)
        errors.append(ours.discretisation_error(ours.kernel.cutoff / (2 * np.pi)))
        exact = design(steps, **options)
        assert exact.discretisation_error(ours.kernel.cutoff / (2 * np.pi)) < errors[-1] or exponent >= 2
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


def test_the_exact_rule_is_nearer_than_the_trapezoid_where_that_leaks() -> None:
    for steps, tau in itertools.product([12, 60], ["root", 1.0]):
        cells = design(steps, degree=2, kappa=0, mu=0, tau=tau)
        nodes = design(steps + 1, degree=2, kappa=0, mu=0, tau=tau, rule="trapezoid")
        assert cells.discretisation_error(cells.cutoff) < 0.5 * nodes.discretisation_error(cells.cutoff)
        assert cells.discretisation_error(0.3 * cells.cutoff) < 0.01 * nodes.discretisation_error(0.3 * cells.cutoff)


# windows by what they shall do

WORDS: list[dict[str, Any]] = [
    {},
    {"tau": "root", "degree": 2},
    {"tau": "newest", "kappa": 2, "mu": 1},
    {"tau": 0.3, "kappa": 0, "mu": 0, "fs": 200.0},
    {"tau": 1.1, "delta": 0.02},
    {"rule": "trapezoid", "degree": 1, "kappa": 3, "mu": 3},
    {"rule": "hat", "tau": "newest", "delta": 5.0},
]


def delta_of(options: dict[str, Any]) -> float:
    return float(options.get("delta", 1 / options.get("fs", 1.0)))


@pytest.mark.parametrize("options", WORDS)
@pytest.mark.parametrize("deriv", [0, 1, 2])
def test_from_duration(deriv: int, options: dict[str, Any]) -> None:
    degree = max(deriv, options.get("degree", deriv + 2))
    for steps in (20.0, 33.3, 99.7):
        duration = steps * delta_of(options)
        ours = algdiff.Differentiator.from_duration(duration, deriv, **{**options, "degree": degree})
        assert ours.duration == pytest.approx(round(steps) * delta_of(options), rel=8 * EPS)
        expected = {**options, "degree": degree}
        assert ours == design(ours.window_length, deriv, **expected)
        again = algdiff.Differentiator.from_duration(ours.duration, deriv, **expected)
        assert again == ours


@pytest.mark.parametrize("options", WORDS)
@pytest.mark.parametrize("unit", ["Hz", "rad/s"])
def test_from_cutoff(unit: str, options: dict[str, Any]) -> None:
    turn = 2 * np.pi if unit == "rad/s" else 1.0
    for relative in (0.01, 0.037):  # of the sampling rate
        wanted = relative / delta_of(options)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", algdiff.DesignWarning)
            ours = algdiff.Differentiator.from_cutoff(wanted * turn, unit=unit, **options)
            again = algdiff.Differentiator.from_cutoff(ours.cutoff * turn, unit=unit, **options)
        assert again.window_length == ours.window_length
        reached = [design(ours.window_length + more, **options).cutoff for more in (-1, 0, 1)]
        assert reached[1] == ours.cutoff
        assert reached[0] >= wanted >= reached[2]
        # as a duration it is right to half a sample, and a neighbour is no better in frequency either
        ideal = ours.kernel.cutoff / (2 * np.pi * wanted)
        assert abs(ours.duration - ideal) <= 0.51 * ours.delta
        assert abs(reached[1] - wanted) <= 1.05 * min(abs(reached[0] - wanted), abs(reached[2] - wanted))


@pytest.mark.parametrize("rule", ["exact", "trapezoid", "hat", "cell"])
@pytest.mark.parametrize("tau", ["center", "root", 0.3, 0.9])
def test_from_delay(tau: float | str, rule: str) -> None:
    for steps, delta in itertools.product([8.0, 20.25, 61.0], [1.0, 0.01]):
        ours = algdiff.Differentiator.from_delay(steps * delta, tau=tau, rule=rule, delta=delta, kappa=1, mu=2)
        per_sample = 1 - ours.tau  # a longer window by one sample delays by so much
        assert abs(ours.delay_samples - steps) <= 0.5 * per_sample + 1e-9
        again = algdiff.Differentiator.from_delay(ours.delay, tau=tau, rule=rule, delta=delta, kappa=1, mu=2)
        assert again == ours
    whole = algdiff.Differentiator.from_delay(10, tau="center", rule=rule)
    assert (whole.delay_samples, whole.window_length) == (10, 21)


def test_delays_that_no_window_has() -> None:
    for options in ({"tau": "newest"}, {"tau": 1.2}, {"tau": 1.0}):
        with pytest.raises(ValueError, match="tau"):
            algdiff.Differentiator.from_delay(5.0, **options)
    for bad in (-1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="delay"):
            algdiff.Differentiator.from_delay(bad)


@pytest.mark.parametrize("maker", ["from_cutoff", "from_duration", "from_notch"])
@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_wishes_must_be_positive(maker: str, bad: float) -> None:
    with pytest.raises(ValueError, match=r"cutoff|duration|frequency"):
        getattr(algdiff.Differentiator, maker)(bad)


def test_wishes_are_checked_by_name() -> None:
    make = algdiff.Differentiator
    for maker in (make.from_cutoff, make.from_notch):
        with pytest.raises(ValueError, match="'rad/s'"):
            maker(0.01, unit="kHz")
    with pytest.raises(TypeError, match="cutoff"):
        make.from_cutoff("1")
    with pytest.raises(TypeError, match="windo"):
        make.from_cutoff(0.01, windo=3)
    with pytest.raises((TypeError, ValueError), match="window_length"):
        make.from_duration(10.0, window_length=3)
    for rule in RULES[3:]:  # on nodes, one sample is no window
        assert make.from_cutoff(0.05, 0, degree=0, rule=rule).cutoff == pytest.approx(0.05, rel=0.2)
    with pytest.raises(ValueError, match="cutoff"):
        make.from_cutoff(0.49, degree=5)  # no window of six samples is that fast
    with pytest.raises(ValueError, match="cutoff"):
        make.from_cutoff(0.01, 1, degree=4, kappa=1, mu=2, tau=0.5)  # the governing end vanishes


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("deriv", [0, 1, 2])
@pytest.mark.parametrize("exponent", [0.0, 1.0, 3.0])
def test_from_notch_annihilates(exponent: float, deriv: int, order: int) -> None:
    for frequency, options in itertools.product([50.0, 23.456], [{}, {"degree": deriv}, {"rule": "midpoint"}]):
        wish: dict[str, Any] = {"kappa": exponent, "mu": exponent, "fs": 1000.0, **options}
        ours = algdiff.Differentiator.from_notch(frequency, deriv, order=order, **wish)
        peak = np.abs(ours.frequency_response(np.linspace(0, 500, 2001))).max()
        assert abs(ours.frequency_response(frequency)) <= 1e-10 * peak
        assert abs(ours.kappa - exponent) <= 0.5 * (1 + exponent)
        assert ours.kappa == ours.mu
        t = np.arange(400) / 1000
        for phase in (0.0, 1.0):
            out = ours(np.sin(2 * np.pi * frequency * t + phase), mode="valid")
            assert np.abs(out).max() <= 1e-10 * peak + 64 * EPS * len(ours.weights) * ours.norm1
    longer = algdiff.Differentiator.from_notch(2 * np.pi * 50, deriv, order=order + 1, unit="rad/s", fs=1000.0)
    assert longer.window_length > algdiff.Differentiator.from_notch(50, deriv, order=order, fs=1000.0).window_length


@pytest.mark.parametrize("rule", RULES)
def test_halves_of_a_step_are_rounded_up(rule: str) -> None:
    more = int(rule in reference.NODES)
    for steps in (20, 21):  # the nearest even number would leave one of them below
        ours = algdiff.Differentiator.from_duration(steps + 0.5, rule=rule)
        if rule == "simpson":
            assert ours.window_length == 2 * ((steps + 1) // 2) + 1
        else:
            assert ours.window_length == steps + 1 + more
    if rule == "simpson":  # 21 is as near to 20 as to 22
        assert algdiff.Differentiator.from_duration(21.0, rule=rule).window_length == 23


@pytest.mark.parametrize("rule", RULES)
def test_the_shortest_window_of_every_rule_can_be_wished_for(rule: str) -> None:
    # degree + 1 samples, which are degree steps on nodes
    for delta in (1.0, 0.01):
        least = design(3, degree=2, rule=rule, delta=delta)
        options: dict[str, Any] = {"degree": 2, "rule": rule, "delta": delta}
        assert algdiff.Differentiator.from_duration(least.duration, **options) == least
        assert algdiff.Differentiator.from_delay(least.delay, **options) == least
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", algdiff.DesignWarning)
            assert algdiff.Differentiator.from_cutoff(least.cutoff, **options) == least
        if rule != "simpson":
            with pytest.raises(ValueError, match=r"duration must be at least .*, that of 3 samples"):
                algdiff.Differentiator.from_duration(0.5 * least.duration, **options)


def test_windows_by_cutoff_and_delay_for_simpson_are_odd() -> None:
    for frequency in (0.011, 0.02, 0.037, 0.05):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", algdiff.DesignWarning)
            ours = algdiff.Differentiator.from_cutoff(frequency, rule="simpson")
        others = [design(ours.window_length + more, rule="simpson").cutoff for more in (-2, 2)]
        assert abs(ours.cutoff - frequency) <= min(abs(other - frequency) for other in others)
    for delay in (8.1, 8.4, 9.3, 20.25):  # two steps more delay by one sample
        ours = algdiff.Differentiator.from_delay(delay, rule="simpson")
        assert abs(ours.delay - delay) <= 0.5


def test_wishes_that_need_too_long_a_window_are_refused_by_name() -> None:
    make = algdiff.Differentiator
    with pytest.raises(ValueError, match="cutoff must be higher: 10000000 samples are not enough for it, got 1e-09 Hz"):
        make.from_cutoff(1e-9)
    with pytest.raises(ValueError, match="delay must be shorter: a window of"):
        make.from_delay(1e9)
    with pytest.raises(ValueError, match=r"duration must be at most 1e\+07, that of 10000000 samples"):
        make.from_duration(1e9)
    with pytest.raises(ValueError, match="frequency must be higher: 10000000 samples are not enough"):
        make.from_notch(1e-9)


@pytest.mark.parametrize(("unit", "turn"), [("Hz", 1.0), ("rad/s", 2 * np.pi)])
def test_a_cutoff_of_the_shortest_window_is_the_highest(unit: str, turn: float) -> None:
    for delta in (1.0, 0.01):
        shortest = design(4, delta=delta)
        highest = shortest.cutoff * turn
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", algdiff.DesignWarning)
            for wanted in (highest, 1.05 * highest):  # nearer to 4 samples than half a sample
                assert algdiff.Differentiator.from_cutoff(wanted, unit=unit, delta=delta) == shortest
        for wanted in (1.2 * highest, 1.8 * highest):
            with pytest.raises(
                ValueError, match=f"cutoff must be at most {highest / turn:.6g} Hz, that of .* 4 samples"
            ):
                algdiff.Differentiator.from_cutoff(wanted, unit=unit, delta=delta)


def test_a_delay_of_the_shortest_window_is_the_least() -> None:
    for tau, least in (("center", 1.5), (0.25, 2.5), (0.9, -0.1)):
        if least > 0:
            shortest = algdiff.Differentiator.from_delay(least, tau=tau)
            assert (shortest.window_length, shortest.delay) == (4, pytest.approx(least))
            assert algdiff.Differentiator.from_delay(least - 0.3, tau=tau) == shortest  # nearer than half a sample
            with pytest.raises(ValueError, match=f"delay must be at least {least}, that of 4 samples"):
                algdiff.Differentiator.from_delay(least - 0.8 * (2 if tau == 0.25 else 1), tau=tau)


@pytest.mark.parametrize("delay", [3.0, 10.0, 20.0])
def test_a_cutoff_at_a_given_delay_is_the_nearest(delay: float) -> None:
    for frequency in (0.01, 0.02):
        ours = algdiff.Differentiator.from_cutoff(frequency, delay=delay)
        assert ours.delay == pytest.approx(delay)
        others = [design(ours.window_length + more, delay=delay).cutoff for more in (-1, 1)]
        assert abs(ours.cutoff - frequency) <= min(abs(other - frequency) for other in others)


def test_a_warning_says_that_the_nyquist_frequency_is_hardly_damped() -> None:
    warned, between = [], 0
    for length, exponent in itertools.product(range(4, 16), (0.0, 0.5, 1.0, 2.0)):
        options: dict[str, Any] = {"kappa": exponent, "mu": exponent}
        wanted = design(length, **options)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", algdiff.DesignWarning)
            assert algdiff.Differentiator.from_cutoff(wanted.cutoff, **options) == wanted
        warned.append(any("the Nyquist frequency is damped by" in str(each.message) for each in caught))
        assert warned[-1] == (wanted.nyquist_attenuation < 10)
        between += 5 < wanted.nyquist_attenuation < 15
    assert between > 1
    assert {True, False} == set(warned)


def test_a_response_that_underflows_is_damped_without_end() -> None:
    ours = design(2001, kappa=300, mu=300)  # at the Nyquist frequency below 1e-600
    assert ours.nyquist_attenuation == math.inf
    assert ours.summary()["nyquist_attenuation"] is None


def test_a_time_that_is_none_gives_an_output_that_is_none() -> None:
    ours = design(21)
    for response in (ours.impulse_response, ours.step_response):
        assert np.isnan(response([np.nan, 3.0])).tolist() == [True, False]


@pytest.mark.parametrize("zero", [63.9, 64.1, 127.8, 128.05])
def test_notches_count_every_zero_once(zero: float) -> None:
    # The minimal kernel has the response of a Bessel function of order kappa + 3/2 at omega T / 2. The window is as
    # long as its zero says, to half a sample: exponents are chosen that put one next to 64 and its multiples.
    def zeros(exponent: float, first: float = 1.0) -> Array:
        omega = np.arange(first, zero + 15, 0.01)
        values = scipy.special.jv(exponent + 1.5, omega / 2)
        return np.asarray(omega[np.flatnonzero(np.diff(np.sign(values)))] + 0.005)

    exponent = min(np.arange(0, 2.2, 0.01), key=lambda k: float(np.abs(zeros(k, zero - 7) - zero).min()))
    turns = 2 * np.pi * 0.01
    for order, expected in enumerate(zeros(exponent), start=1):
        if abs(expected - zero) < 10:
            ours = algdiff.Differentiator.from_notch(0.01, order=order, degree=1, kappa=exponent, mu=exponent)
            assert ours.window_length == pytest.approx(expected / turns, abs=0.6)


def test_notches_of_designs_that_have_none() -> None:
    make = algdiff.Differentiator.from_notch
    for options in ({"kappa": 1, "mu": 2}, {"mu": 0}):
        with pytest.raises(ValueError, match="kappa and mu must be equal for a notch"):
            make(50.0, fs=1000.0, **options)
    for options in ({"tau": "newest"}, {"tau": 0.3}, {"delay": 5e-3}):
        with pytest.raises(ValueError, match="tau must be 'center' for a notch"):
            make(50.0, fs=1000.0, **options)
    assert make(50.0, fs=1000.0, tau=0.5) == make(50.0, fs=1000.0, tau="center") == make(50.0, fs=1000.0)
    for frequency, unit in ((500.0, "Hz"), (700.0, "Hz"), (1000 * np.pi, "rad/s")):
        with pytest.raises(ValueError, match="frequency must be below half the sampling rate"):
            make(frequency, fs=1000.0, unit=unit)
    with pytest.raises(ValueError, match=r"a window of 3 samples is needed and degree \+ 1 = 4 is the least"):
        make(499.0, 0, degree=3, kappa=0, mu=0, fs=1000.0)


@pytest.mark.parametrize(
    "options", [{"degree": 1}, {"degree": 2, "tau": "root"}, {"kappa": 0, "mu": 0, "tau": 1.0}, {}]
)
@pytest.mark.parametrize("deriv", [0, 1, 2])
def test_optimal_window_against_all_windows(deriv: int, options: dict[str, Any]) -> None:
    options = {**options, "degree": deriv + options.get("degree", 3) - 1}
    for noise, bound, delta in [(0.02, 50.0, 1e-3), (1.0, 1e-4, 1.0)]:
        ours = algdiff.optimal_window(noise, deriv, derivative_bound=bound, delta=delta, **options)
        kernel = algdiff.Kernel(deriv, ours.degree, ours.kappa, ours.mu, options.get("tau", "center"))
        lengths = np.arange(max(ours.degree + 1, ours.window_length - 300), ours.window_length + 300)
        errors = [kernel.rmse(length * delta, noise, bound, delta) for length in lengths]
        best = int(lengths[np.argmin(errors)])
        assert abs(ours.window_length - best) <= 1
        assert kernel.rmse(ours.duration, noise, bound, delta) <= min(errors) * (1 + 1e-3)


def test_optimal_windows_of_hardly_any_noise_are_the_shortest() -> None:
    ours = algdiff.optimal_window(1e-12, derivative_bound=1e9, degree=2)
    assert ours.window_length == 3
    curve = algdiff.delay_tradeoff([0.0], 1e-12, bandwidth=0.3, amplitude=1.0, degree=2)
    assert curve.window_length.tolist() == [3]
    with pytest.raises(ValueError, match="delay must be left out"):
        algdiff.optimal_window(0.01, derivative_bound=1.0, delay=0.1)


def test_delays_are_not_those_of_the_caller() -> None:
    delays = np.array([0.0, 3.0])
    curve = algdiff.delay_tradeoff(delays, 0.01, bandwidth=0.01, amplitude=1.0)
    delays[:] = 7.0
    assert curve.delay.tolist() == [0.0, 3.0]


def test_optimal_window_from_a_bandwidth() -> None:
    for deriv, degree in [(0, 1), (1, 3), (2, 3)]:
        kernel = algdiff.Kernel(deriv, degree)
        bound = 2.5 * (2 * np.pi * 3) ** (deriv + kernel.bias_order)
        options: dict[str, Any] = {"degree": degree, "fs": 500.0}
        ours = algdiff.optimal_window(0.05, deriv, bandwidth=3, amplitude=2.5, **options)
        assert ours == algdiff.optimal_window(0.05, deriv, derivative_bound=bound, **options)
    with pytest.raises(ValueError, match="derivative_bound"):
        algdiff.optimal_window(0.05)
    with pytest.raises(ValueError, match="amplitude"):
        algdiff.optimal_window(0.05, bandwidth=3)
    with pytest.raises(ValueError, match="not both"):
        algdiff.optimal_window(0.05, bandwidth=3, amplitude=1, derivative_bound=1)
    with pytest.raises(ValueError, match="noise_level"):
        algdiff.optimal_window(-0.05, derivative_bound=1)
    with pytest.raises(ValueError):  # noqa: PT011
        algdiff.optimal_window(0.05, derivative_bound=1, kappa=-0.6)


def test_optimal_window_is_best_on_a_noisy_sine() -> None:
    # Theory section 6: sin(2 pi t), sigma = 0.01, Ts = 1 ms; the formula comes within a few percent of the best window.
    rng = np.random.default_rng(3)
    t = np.arange(4000) / 1000
    noise = 0.01 * rng.standard_normal((20, t.size))
    slope = 2 * np.pi * np.cos(2 * np.pi * t)

    def error(length: int) -> float:
        estimate = algdiff.Differentiator(length, degree=2, fs=1000)(np.sin(2 * np.pi * t) + noise)[:, 300:-300]
        return float(np.sqrt(np.mean((estimate - slope[300:-300]) ** 2)))

    ours = algdiff.optimal_window(0.01, bandwidth=1, amplitude=1, degree=2, fs=1000)
    lengths = range(ours.window_length // 2, 2 * ours.window_length, 8)
    assert error(ours.window_length) <= 1.1 * min(map(error, lengths))


# prediction


@pytest.mark.parametrize("tau", [1.1, 1.5, 2.0])
def test_predictions_of_polynomials_are_exact(tau: float) -> None:
    t = np.arange(60.0) - 30
    for deriv, degree in [(0, 2), (1, 3), (2, 2)]:
        ours = design(20, deriv, degree=degree, tau=tau)
        assert ours.delay < 0
        for m in range(degree + 1):
            polynomial = np.polynomial.Polynomial.basis(m)
            late = t[19:] - ours.delay
            expected = polynomial.deriv(deriv)(late) if deriv else polynomial(late)
            bound = 256 * EPS * 20 * ours.norm1 * 30.0**m
            np.testing.assert_allclose(ours(polynomial(t), mode="valid"), expected, rtol=0, atol=bound)


@on_all_designs
def test_the_analysis_is_plain_numbers(ours: algdiff.Differentiator) -> None:
    numbers = [ours.cutoff, ours.half_power, ours.nyquist_attenuation, ours.norm1, ours.noise_gain, ours.bias_order]
    numbers += [ours.bias_constant, ours.bias_bound, ours.moment_delay, ours.discretisation_error(), ours.duration]
    assert json.loads(json.dumps(numbers)) == numbers
