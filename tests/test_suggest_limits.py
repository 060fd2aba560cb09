"""What is asked of a choice: delays, bands, bounds, and what is known of the noise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import algdiff

Array = npt.NDArray[np.float64]
DELTA = 0.01
RATE = 1.5
SIGNAL = np.sin(RATE * DELTA * np.arange(2000))
SLOPE = RATE * np.cos(RATE * DELTA * np.arange(2000))


def swing(seed: int, level: float = 0.05) -> Array:
    return np.asarray(SIGNAL + level * np.random.default_rng(seed).standard_normal(2000))


def ar1(seed: int, correlation: float, level: float = 0.05) -> Array:
    """Return autoregressive noise of a level, from its stationary distribution."""
    steps = np.random.default_rng(seed).standard_normal(2000)
    noise = np.empty(2000)
    noise[0] = steps[0]
    for k in range(1, 2000):
        noise[k] = correlation * noise[k - 1] + math.sqrt(1 - correlation**2) * steps[k]
    return level * noise


@pytest.mark.parametrize("deriv", [0, 1, 2])
@pytest.mark.parametrize("delay", [0.0, 0.035, 0.3, 2.0, 100.0])
def test_a_delay(deriv: int, delay: float) -> None:
    x = swing(0)
    suggestion = algdiff.suggest(x, deriv, delta=DELTA, max_delay=delay)
    design = suggestion.differentiator
    assert design.delay <= delay + 1e-12
    assert suggestion.limits == (f"max_delay = {delay}",)
    free = algdiff.suggest(x, deriv, delta=DELTA).differentiator
    if delay >= free.delay:
        assert design == free
        return
    # Causal: what is newer than an estimate's time and its delay does not change it, but for the rounding of sums.
    before, after = math.floor(design.delay_samples), math.ceil(design.delay_samples - 1e-9)
    bound = 1e-11 * float(np.abs(suggestion(x)).max())
    changed = x.copy()
    changed[1001 + after :] += 1.0
    np.testing.assert_allclose(suggestion(changed)[:1001], suggestion(x)[:1001], rtol=0, atol=bound)
    changed[1001 + before] += 1.0
    assert abs(suggestion(changed)[1001] - suggestion(x)[1001]) > 1e3 * bound
    # A central design has ends of its own.
    middle = slice(2 * design.window_length, 2000 - 2 * design.window_length)
    np.testing.assert_array_equal(suggestion(x)[middle], design(x)[middle])


def causal(delay: float, level: float = 0.05) -> tuple[float, float]:
    """Return the true error of the estimates that lag by at most a delay, and the one that is expected."""
    squares, expected = [], []
    for seed in range(6):
        x = swing(seed, level)
        suggestion = algdiff.suggest(x, delta=DELTA, max_delay=delay)
        design = suggestion.differentiator
        newest = DELTA * np.arange(design.window_length - 1, 2000)
        truth = RATE * np.cos(RATE * (newest - design.delay))
        squares.append(float(np.mean((design(x, mode="valid") - truth) ** 2)))
        expected.append(suggestion.rmse**2)
    return math.sqrt(float(np.mean(squares))), math.sqrt(float(np.mean(expected)))


def test_more_delay_is_better() -> None:
    errors = [causal(delay)[0] for delay in (0.0, 0.1, 0.2, 0.4)]
    assert (np.diff(errors) < 0).all()
    # Half a period of the sine is 2 s; an estimate without delay is far worse than one that waits for a tenth of it.
    assert errors[-1] < errors[0] / 4


@pytest.mark.parametrize("delay", [0.0, 0.045, 0.405])
@pytest.mark.parametrize("level", [0.05, 1e-4])
def test_the_error_of_causal_estimates(delay: float, level: float) -> None:
    error, expected = causal(delay, level)
    # Where there is little noise, half a sample of delay more or less would be most of it: 0.011 of the slope.
    assert 1 / 1.25 < expected / error < 1.25


def test_too_much_delay_is_not_worse() -> None:
    assert causal(2.9)[0] < 1.2 * causal(1.0)[0]


def test_a_delay_that_does_not_bind_changes_nothing() -> None:
    x = swing(1)
    bound, free = algdiff.suggest(x, delta=DELTA, max_delay=100.0), algdiff.suggest(x, delta=DELTA)
    np.testing.assert_array_equal(bound(x), free(x))
    assert bound.rmse == free.rmse


@pytest.mark.parametrize("deriv", [0, 1, 2])
@pytest.mark.parametrize("bandwidth", [0.05, 0.5, 2.0, 10.0])
def test_a_bandwidth(deriv: int, bandwidth: float) -> None:
    design = algdiff.suggest(swing(2), deriv, delta=DELTA, bandwidth=bandwidth).differentiator
    # The -3 dB point of windows is that of the continuous kernel; of short ones it is a percent or two off.
    assert design.half_power is not None
    assert design.half_power >= 0.97 * bandwidth
    free = algdiff.suggest(swing(2), deriv, delta=DELTA).differentiator
    if free.half_power is not None and free.half_power >= bandwidth:
        assert design == free


def test_a_bandwidth_and_a_delay() -> None:
    x = np.sin(0.05 * DELTA * np.arange(5000)) + 0.05 * np.random.default_rng(3).standard_normal(5000)
    design = algdiff.suggest(x, 2, delta=DELTA, bandwidth=2.0, max_delay=0.05).differentiator
    assert design.half_power is not None
    assert design.half_power >= 0.97 * 2.0


@pytest.mark.parametrize(
    "bounds", [(3, 3), (51, 51), (5, 8), (41, 60), (101, 150), (900, 1000), (739, 1999), (1001, 1001), (3, 2000)]
)
@pytest.mark.parametrize("deriv", [0, 1, 2])
def test_bounds(deriv: int, bounds: tuple[int, int]) -> None:
    least, most = bounds
    suggestion = algdiff.suggest(swing(4), deriv, delta=DELTA, min_window=least, max_window=most)
    assert least <= suggestion.differentiator.window_length <= most
    assert suggestion.limits == (f"min_window = {least}", f"max_window = {most}")
    assert np.isfinite(suggestion(swing(4))).all()


@pytest.mark.parametrize("words", [{"min_window": 301, "max_delay": 0.3}, {"max_window": 101, "max_delay": 0.1}])
def test_bounds_and_a_delay(words: dict[str, Any]) -> None:
    design = algdiff.suggest(swing(5), delta=DELTA, **words).differentiator
    assert words.get("min_window", 3) <= design.window_length <= words.get("max_window", 2000)
    assert design.delay <= words["max_delay"] + 1e-12


def test_bounds_that_do_not_bind() -> None:
    free = algdiff.suggest(swing(6), delta=DELTA)
    for words in ({"min_window": 1}, {"max_window": 2000}, {"max_window": 10**9}, {"bandwidth": 1e-9}):
        assert algdiff.suggest(swing(6), delta=DELTA, **words).differentiator == free.differentiator
    assert free.limits == ()


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_a_degree(degree: int) -> None:
    suggestion = algdiff.suggest(swing(7), delta=DELTA, degree=degree)
    assert suggestion.differentiator.degree == degree
    assert set(suggestion.curve.degree.tolist()) == {degree}
    causal_one = algdiff.suggest(swing(7), delta=DELTA, degree=degree, max_delay=0.1)
    assert causal_one.differentiator.degree == degree
    assert algdiff.differentiate(swing(7), delta=DELTA, degree=degree).shape == (2000,)


@pytest.mark.parametrize("exponent", [-0.4, 0.0, 0.5, 2.0])
def test_exponents(exponent: float) -> None:
    suggestion = algdiff.suggest(swing(8), delta=DELTA, kappa=exponent, mu=exponent)
    assert (suggestion.differentiator.kappa, suggestion.differentiator.mu) == (exponent, exponent)
    # Of a smooth signal in little noise any weight does within a factor of two of another.
    error = float(np.sqrt(np.mean((suggestion(swing(8)) - SLOPE) ** 2)))
    plain = float(np.sqrt(np.mean((algdiff.differentiate(swing(8), delta=DELTA) - SLOPE) ** 2)))
    assert error < 2 * plain


def test_a_known_level() -> None:
    x = swing(9)
    known = algdiff.suggest(x, delta=DELTA, sigma=0.05)
    assert known.noise_level == pytest.approx(0.05, rel=1e-12)
    guessed = algdiff.suggest(x, delta=DELTA)
    assert known.differentiator.degree == guessed.differentiator.degree
    assert 1 / 1.5 < known.differentiator.window_length / guessed.differentiator.window_length < 1.5
    # What is said to be noise is not followed, and what is not, is.
    windows = [
        algdiff.suggest(x, delta=DELTA, degree=2, sigma=sigma).differentiator.window_length
        for sigma in (1e-4, 0.05, 5.0)
    ]
    assert windows[0] < windows[1] < windows[2]
    # Of several rows it is the level of each.
    rows = np.stack([x, swing(10)])
    assert algdiff.suggest(rows, delta=DELTA, sigma=0.05).noise_level == pytest.approx(0.05, rel=1e-12)
    once = algdiff.differentiate(x, delta=DELTA, sigma=0.05, return_std=True)
    np.testing.assert_array_equal(once.std, known.differentiator(x, sigma=0.05, return_std=True).std)


def test_white_noise_by_any_name() -> None:
    for seed in range(4):
        found = {kind: algdiff.suggest(swing(seed), delta=DELTA, noise=kind) for kind in ("auto", "white", "ar1")}
        assert found["ar1"].correlation == 0
        assert found["ar1"].differentiator == found["white"].differentiator
        assert [one.colour for one in found.values()] == [1.0, 1.0, 1.0]


def test_coloured_noise_makes_windows_longer() -> None:
    windows: dict[str, list[int]] = {"auto": [], "white": []}
    for seed in range(6):
        x = SIGNAL + ar1(seed, 0.6)
        for kind, found in windows.items():
            found.append(algdiff.suggest(x, delta=DELTA, noise=kind).differentiator.window_length)
    assert np.median(windows["auto"]) > np.median(windows["white"])


def test_autoregressive_noise() -> None:
    errors: dict[str, list[float]] = {"ar1": [], "white": []}
    correlations = []
    for seed in range(6):
        x = SIGNAL + ar1(seed, 0.8)
        for kind, found in errors.items():
            suggestion = algdiff.suggest(x, delta=DELTA, noise=kind)
            found.append(float(np.mean((suggestion(x) - SLOPE) ** 2)))
            if kind == "ar1":
                correlations.append(suggestion.correlation)
    assert np.abs(np.array(correlations) - 0.8).max() < 0.15
    assert np.mean(errors["ar1"]) < np.mean(errors["white"])
