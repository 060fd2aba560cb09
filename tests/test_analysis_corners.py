"""Corners of the analysis and of windows by what they shall do: what is refused, and what stays finite."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import Differentiator, Kernel


def test_a_cutoff_that_is_no_number_is_none() -> None:
    for kappa, mu in ((-0.999, 50.0), (50.0, -0.999)):
        design = Differentiator(60, 0, degree=1, kappa=kappa, mu=mu)
        assert design.cutoff is None
        assert design.nyquist_attenuation is None
        assert design.summary()["cutoff"] is None


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: Differentiator.from_cutoff(5e-324, fs=100), "cutoff must be higher"),
        (lambda: Differentiator.from_cutoff(1e-9, fs=1000), "cutoff must be higher"),
        (lambda: Differentiator.from_notch(5e-324, fs=100), "frequency must be higher"),
        (lambda: Differentiator.from_notch(5e-324), "frequency must be higher"),
        (lambda: Differentiator.from_notch(0.01, delta=1e-308), "frequency must be higher"),
        (lambda: Differentiator.from_notch(499, fs=1000), "frequency must be lower"),
        (lambda: Differentiator.from_notch(50, 4, fs=1000, kappa=-0.9, mu=-0.9), "frequency must be lower"),
        (lambda: Differentiator.from_cutoff(20, fs=1000, trim=0.01), "trim must be 0 here, got 0.01"),
        (lambda: Differentiator.from_delay(0.02, fs=1000, trim=0.01), "trim must be 0 here, got 0.01"),
        (lambda: algdiff.optimal_window(1, derivative_bound=1, trim=0.01), "trim must be 0 here, got 0.01"),
        (lambda: Differentiator(51, delay=10.0, trim=0.05), "give delay or trim, not both"),
        (lambda: Differentiator(51).discretisation_error(1e300), "frequency must be positive and at most"),
        (lambda: Differentiator(51).discretisation_error(np.nan), "frequency must be positive and at most"),
        (lambda: Differentiator(51, 1, mu=1e4), "mu must be so small that"),
        (lambda: Differentiator(5, 1, degree=2, kappa=1e4, mu=1.0), "kappa must be so small that"),
        (lambda: Kernel(1).frequency_response([1, [2, 3]]), "omega_T must be an array of numbers"),
        (
            lambda: algdiff.delay_tradeoff([1, [2, 3]], 1, bandwidth=1, amplitude=1),
            "delays must be an array of numbers",
        ),
    ],
)
def test_refusals_name_the_argument(call: Callable[[], object], name: str) -> None:
    with pytest.raises(ValueError, match=name):
        call()


@pytest.mark.parametrize("delay", [3.0, 20.0, 40.0, 200.0])
@pytest.mark.parametrize("cutoff", [0.011, 0.02, 0.037])
@pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")
def test_cutoffs_at_a_delay_are_met_or_refused(cutoff: float, delay: float) -> None:
    def miss(length: int) -> float:
        reached = Differentiator(length, delay=delay).cutoff
        return np.inf if reached is None else abs(reached - cutoff)

    lengths = range(max(4, int(delay)), 2000)
    # Half a sample of the window is what rounding may cost.
    highest = max((Differentiator(n, delay=delay).cutoff or 0.0) / (1 - 0.5 / n) for n in lengths)
    if highest < cutoff:
        with pytest.raises(ValueError, match="cutoff must be at most"):
            Differentiator.from_cutoff(cutoff, delay=delay)
        return
    found = Differentiator.from_cutoff(cutoff, delay=delay)
    assert found.delay == delay
    # Next to the best of all windows, and at least as near as its own neighbours.
    assert miss(found.window_length) <= min(miss(found.window_length + step) for step in (-1, 1))
    assert miss(found.window_length) <= 2 * min(map(miss, lengths)) + 0.5 * cutoff / found.window_length


def test_short_durations_are_refused_under_every_rule() -> None:
    for rule in ("exact", "trapezoid", "midpoint", "simpson", "cell", "hat"):
        for degree in (1, 2, 3):
            with pytest.raises(ValueError, match="duration must be at least"):
                Differentiator.from_duration(1e-9, degree=degree, rule=rule)


def test_complex_windows_keep_double_precision() -> None:
    y = np.array([1.0, 1.0 + 1e-12, 1.0]) * (1 + 1j)
    real = algdiff.paper.minimal(y.real, 0, 0, 0, 1.0)
    assert algdiff.paper.minimal(y, 0, 0, 0, 1.0) == real * (1 + 1j)


class Quantity:
    """An array with a unit, as pint has them."""

    magnitude = 1.0

    def __array__(self, *_: Any, **__: Any) -> np.ndarray[Any, Any]:
        return np.ones(2)


@pytest.mark.parametrize("bad", [np.ma.array([1.0, 2.0], mask=[False, True]), Quantity()])
@pytest.mark.parametrize(
    "call",
    [
        Kernel(1),
        Kernel(1).frequency_response,
        Kernel(1).asymptotes,
        Kernel(1).step_response,
        Kernel(1).impulse_response,
        Differentiator(5).frequency_response,
        Differentiator(5).step_response,
        lambda bad: algdiff.paper.lambdas(1, 2, 0, 0, bad),
        lambda bad: algdiff.delay_tradeoff(bad, 1, bandwidth=1, amplitude=1),
    ],
)
def test_masks_and_units_are_refused(call: Callable[[Any], object], bad: object) -> None:
    with pytest.raises(TypeError, match=r"masked values|carries units"):
        call(bad)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: Kernel(1, kappa=np.ma.masked), "kappa must be a real number"),
        (lambda: Differentiator(5, trim=np.ma.masked), "trim must be a real number"),
        (lambda: Differentiator.from_cutoff(0.1, rule=np.ones(2)), "rule must be a word"),
        (lambda: Differentiator.from_cutoff(0.1, unit=np.ones(2)), "unit must be 'Hz' or 'rad/s'"),
        (lambda: Differentiator.from_delay(5, tau=np.ones(2)), r"tau must be a word .* or a real number"),
        (
            lambda: Differentiator.from_notch(0.1, tau=np.ones(2)),
            r"tau must be a word .* or a real number",
        ),
        (lambda: Kernel(1).optimal_duration(1, 1, bounded="no"), "bounded must be True or False, got 'no'"),
    ],
)
def test_wrong_types_name_the_argument(call: Callable[[], object], name: str) -> None:
    with pytest.raises(TypeError, match=name):
        call()


def test_numbers_that_overflow_do_so_in_silence() -> None:
    # Warnings are errors here.
    assert Differentiator(51, delta=1e-160).noise_gain == np.inf
    bounds = Differentiator(51).asymptotes([1e308, -1e308])
    assert np.all(bounds.upper == 0)
    assert np.all(bounds.low_pass == 0)
    late, early = Differentiator(51, 0, delta=0.1).step_response([1e308, -1e308])
    assert (late, early) == (pytest.approx(1.0), 0.0)
    assert Differentiator(51, delta=0.1).impulse_response(1e308) == 0


def test_the_low_pass_model_is_ideal_up_to_the_cutoff_and_falls_beyond() -> None:
    for deriv in range(3):
        kernel = Kernel(deriv)
        assert kernel.cutoff is not None
        below, above = kernel.cutoff * np.array([1e-3, 0.5, 1.0]), kernel.cutoff * np.array([2.0, 10.0])
        np.testing.assert_allclose(kernel.asymptotes(below).low_pass, below**deriv, rtol=1e-14)
        falling = above**deriv * (kernel.cutoff / above) ** kernel.roll_off
        np.testing.assert_allclose(kernel.asymptotes(above).low_pass, falling, rtol=1e-13)
        assert kernel.asymptotes(0.0).low_pass == (deriv == 0)


def test_trim_places_the_estimate_in_the_whole_window() -> None:
    for tau in ("newest", "center", 0.8):
        whole, trimmed = Differentiator(101, tau=tau), Differentiator(101, tau=tau, trim=0.05)
        dropped = np.flatnonzero(np.cumsum(np.abs(whole.weights[::-1])) > 0.05 * whole.norm1)[0]
        assert trimmed.tau == whole.tau
        assert trimmed.delay_samples == pytest.approx(whole.delay_samples - dropped, abs=1e-9)


def test_discretisation_errors_fall_with_the_window_however_long() -> None:
    errors = [Differentiator(length).discretisation_error() for length in (101, 1001, 10_001, 30_001)]
    for before, after, ratio in zip(errors[:-1], errors[1:], (10, 10, 3), strict=True):
        # Both responses tend to zero as 1 / omega^2, and so the part beyond the Nyquist frequency as L^(-3/2).
        assert after == pytest.approx(before / ratio**1.5, rel=0.15)


def test_steps_near_the_smallest_number_end() -> None:
    # Sixteen frequencies to a lobe are infinite in cycles per unit of time: this did not come back.
    summary = Differentiator(101, delta=1e-308).summary()
    assert summary["discretisation_error"] is None or summary["discretisation_error"] >= 0


@pytest.mark.parametrize(("window_length", "exponent"), [(1001, 500.0), (101, 0.0), (101, 8.0)])
def test_the_half_power_point_whatever_the_exponents(window_length: int, exponent: float) -> None:
    ours = Differentiator(window_length, kappa=exponent, mu=exponent)
    assert ours.half_power is not None
    f = np.array([0.999, 1.001]) * ours.half_power
    gain = np.abs(ours.frequency_response(f)) / (2 * np.pi * f)
    assert gain[0] > np.sqrt(0.5) > gain[1]
    below = np.linspace(0.001, 0.999, 500) * ours.half_power
    assert (np.abs(ours.frequency_response(below)) > np.sqrt(0.5) * 2 * np.pi * below).all()


def test_windows_that_last_longer_than_any_number_are_refused() -> None:
    with pytest.raises(ValueError, match=r"delta must be such that a window does not last longer .*, got 1e\+?308"):
        Differentiator(11, 0, delta=1e308)
    assert Differentiator(11, 0, delta=1e306).half_power > 0


def test_samples_without_a_weight_do_not_count_in_the_bound_of_the_bias() -> None:
    with np.errstate(all="ignore"):
        design = Differentiator(39, 1, degree=1, kappa=0, mu=1, tau=0.0018, delta=1.07e211, rule="simpson")
    assert design.bias_bound > 0
