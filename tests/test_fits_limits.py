"""Fits at their limits: samples at the ends of windows and next to each other, long gaps, and long streams."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from algdiff import differentiate
from support import EPS, design

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")

Array = npt.NDArray[np.float64]
LINE: dict[str, Any] = {"degree": 2, "kappa": 0, "mu": 0}
SLOPE = np.arange(-2, 3) / 10  # of the parabola through five samples, in their middle
SIMPLE = np.random.default_rng(1).standard_normal(40)


def nearly_even(step: float, n: int) -> Array:
    """Return times that are even but for the last one, so that they are taken as they come."""
    return np.append(step * np.arange(n - 1), step * (n - 0.7))


def test_windows_of_time_hold_the_samples_at_both_their_ends() -> None:
    found = differentiate(SIMPLE, t=nearly_even(1.0, 40), window_duration=4.0, mode="nan", **LINE)
    np.testing.assert_allclose(found[2:-4], np.correlate(SIMPLE, SLOPE, "valid")[:-2], rtol=0, atol=64 * EPS)


@pytest.mark.parametrize("duration", [0.3, 0.5, 0.7])
def test_windows_of_time_that_just_fit_are_whole(duration: float) -> None:
    """Times and durations that are no binary numbers: rounding does not decide what is whole."""
    for first in range(10):
        t = nearly_even(0.1, 40) + 0.1 * first
        whole = np.isfinite(differentiate(SIMPLE, t=t, window_duration=duration, mode="nan", **LINE))
        # They may reach beyond the data by half a usual step, so far as this and no farther.
        least = round((duration / 0.1 - 1) / 2)
        assert whole.tolist() == [False] * least + [True] * (40 - 2 * least) + [False] * least


def test_between_two_samples_the_window_lies_around_the_newer() -> None:
    t = nearly_even(1.0, 40)
    impulses = [differentiate(one, t=t, at=np.array([20.5]), window_length=5, **LINE)[0] for one in np.eye(40)]
    assert np.flatnonzero(impulses).tolist() == [19, 20, 21, 22, 23]


def test_samples_at_one_time_but_for_rounding_are_too_few() -> None:
    """Windows of four samples at two times and a unit in the last place: no parabola goes through two points."""
    t = np.repeat(np.arange(1.0, 25.0), 2)
    t[1::2] = np.nextafter(t[1::2], np.inf)
    x = np.random.default_rng(2).standard_normal(len(t))
    for degree, there in ((1, True), (3, False)):
        found = differentiate(x, t=t, window_length=4, degree=degree, kappa=0, mu=0)
        assert (np.isfinite(found) == there).all()


@pytest.mark.parametrize(("kappa", "mu"), [(20, 3), (3, 20), (12, 9), (9.5, 0)])
def test_even_times_in_large_unequal_exponents(kappa: float, mu: float) -> None:
    ours = design(21, degree=2, kappa=kappa, mu=mu, delta=0.5)
    found = differentiate(SIMPLE, t=nearly_even(0.5, 40), window_length=21, degree=2, kappa=kappa, mu=mu)
    bound = 256 * EPS * np.abs(ours.weights).sum() * np.abs(SIMPLE).max()
    assert np.abs(found - ours(SIMPLE))[11:-12].max() <= bound


@pytest.mark.parametrize(("length", "degree"), [(21, 2), (31, 4), (31, 5)])
def test_few_samples_beside_a_long_gap_lose_no_digits(length: int, degree: int) -> None:
    t = (np.arange(600) - 300) / 300
    for gap in range(length - degree - 6, length - degree):
        x = t**degree
        x[300 : 300 + gap] = np.nan
        words: dict[str, Any] = {"degree": degree, "kappa": 0, "mu": 0, "nan_policy": "omit", "max_gain": np.inf}
        found = differentiate(x, window_length=length, return_std=True, sigma=1.0, **words)
        wanted = degree * t ** (degree - 1) / 300
        # Rounding of every sample by EPS is noise with at most that standard deviation.
        assert (np.abs(found.estimate - wanted) <= 16 * EPS * found.std).all()


def test_an_infinite_sample_beside_a_missing_one_gives_nan() -> None:
    for degree, deriv, value in itertools.product((0, 1, 2), (0, 1), (np.inf, -np.inf)):
        if deriv <= degree:
            x = np.random.default_rng(3).standard_normal(9000)
            x[5000], x[5007] = np.nan, value
            words: dict[str, Any] = {"degree": degree, "kappa": 0, "mu": 0, "nan_policy": "omit"}
            found = differentiate(x, window_length=11, deriv=deriv, **words)
            assert np.isnan(found[5002:5006]).all()  # windows that hold both
            assert np.isfinite(found[:5002]).all()


# Streams.


def test_long_blocks_have_the_results_of_short_ones() -> None:
    """Longer than what is worked on at a time, in every place of it."""
    ours = design(21, 1, degree=2)
    x = np.random.default_rng(4).standard_normal(50_000)
    x[::1009] = np.nan
    options: dict[str, Any] = {"nan_policy": "omit", "warmup": "grow"}
    whole = ours.stream(**options).push(x)
    stream = ours.stream(**options)
    short = np.concatenate([stream.push(part) for part in np.array_split(x, 11)])
    np.testing.assert_array_equal(whole, short)
    assert np.isfinite(whole[3:]).all()  # the first sample is missing


def test_growing_windows_may_be_as_noisy_as_they_are() -> None:
    """Where a window grows its gain is large, with samples missing or without: only full windows have a limit."""
    for missing in (False, True):
        stream = design(2001, 1, degree=1, kappa=0, mu=0).stream(nan_policy="omit", warmup="grow")
        found = [stream.push(value) for value in ([0.0, np.nan, 2.0, 3.0] if missing else [0.0, 1.0, 2.0, 3.0])]
        np.testing.assert_allclose(found[3], 1.0, rtol=1e-12)
