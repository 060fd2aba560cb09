"""Choices from data that are no smooth signal in white noise: all are finite and warn of nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import algdiff

Array = npt.NDArray[np.float64]
K = np.arange(300)
RNG = np.random.default_rng(0)

SIGNALS: dict[str, Any] = {
    "sine": np.sin(K / 20),
    "exponential": np.exp(K / 40),
    "walk": np.cumsum(RNG.standard_normal(300)),
    "white": RNG.standard_normal(300),
    "heavy tails": RNG.standard_t(1.5, 300),
    "step": np.where(K < 150, 0.0, 1.0),
    "ramp": np.maximum(K - 150.0, 0.0),
    "alternating": (-1.0) ** K,
    "zeros": np.zeros(300),
    "ones": np.ones(300),
    "equal": np.full(300, 3.3),
    "huge": 1e300 * np.sin(K / 20),
    "huge noise": 1e300 * RNG.standard_normal(300),
    "tiny": 1e-300 * np.sin(K / 20),
    "tiny noise": 1e-300 * RNG.standard_normal(300),
    "denormal": 5e-324 * np.rint(1000 * np.sin(K / 20)),
    "outlier": (K == 100) * 1e6 + np.sin(K / 20),
    "one": (K == 100) * 1.0,
    "first": (K == 0) * 1.0,
    "far away": 1e15 + K % 7,
    "rows of zeros": np.zeros((3, 300)),
    "equal rows": np.ones((3, 300)),
    "one row that rests": np.stack([np.sin(K / 20), np.zeros(300)]),
    "rows of all sizes": np.stack([1e-200 * np.sin(K / 20), 1e200 * RNG.standard_normal(300)]),
    "complex": np.exp(1j * K / 20),
    "float32": (5e36 * np.sin(K / 20)).astype(np.float32),
    "integers": np.rint(3 * np.sin(K / 20)).astype(int),
    "truths": K % 3 == 0,
}


@pytest.mark.parametrize("name", SIGNALS)
@pytest.mark.parametrize("deriv", [0, 1, 2, 3])
def test_odd_data(name: str, deriv: int) -> None:
    x = SIGNALS[name]
    for kind in ("auto", "ar1"):
        suggestion = algdiff.suggest(x, deriv, noise=kind)
        assert np.isfinite(suggestion(x)).all()
        numbers = (suggestion.rmse, suggestion.noise, suggestion.bias, suggestion.noise_level, *suggestion.noise_range)
        assert np.isfinite(numbers).all()
        assert min(numbers) >= 0
        assert suggestion.explain()
    np.testing.assert_array_equal(algdiff.differentiate(x, deriv=deriv), algdiff.suggest(x, deriv)(x))


@pytest.mark.parametrize(
    "x",
    [
        pytest.param(np.full(300, 1.5e308), id="equal"),
        pytest.param(
            1.5e308 * (-1.0) ** K,
            id="alternating",
            marks=pytest.mark.xfail(strict=True, raises=AssertionError, reason="its differences are infinite"),
        ),
    ],
)
def test_the_largest_numbers(x: Array) -> None:
    assert np.isfinite(algdiff.suggest(x, 0)(x)).all()


@pytest.mark.parametrize("step", [1e-300, 1e-150, 1.0, 1e150, 1e300])
@pytest.mark.parametrize("scale", [5e-324, 1e-310, 1e-300, 1e-150, 1e150, 1e300, 1e308])
def test_what_overflows_or_vanishes_is_said_without_a_warning(scale: float, step: float) -> None:
    """NumPy's warnings are errors here; errors that are infinite times nothing are nothing."""
    rng = np.random.default_rng(11)
    for shape in (np.ones(60), np.where(np.arange(60) > 30, 1.0, -1.0), rng.uniform(-1, 1, 60), np.arange(60) == 20):
        for deriv, local, sigma in ((0, False, None), (1, True, None), (1, True, 1e-320), (1, True, scale)):
            suggestion = algdiff.suggest(shape * scale, deriv, delta=step, local=local, sigma=sigma)
            numbers = (suggestion.rmse, suggestion.noise, suggestion.bias, *suggestion.curve.rmse)
            assert not np.isnan(numbers).any()
            assert suggestion(shape * scale).shape == (60,)


@pytest.mark.parametrize("scale", [1e-300, 1e-200, 1e200, 1e300])
def test_any_scale_chooses_the_same(scale: float) -> None:
    x = np.sin(K / 20) + 0.05 * np.random.default_rng(1).standard_normal(300)
    plain, scaled = algdiff.suggest(x), algdiff.suggest(scale * x)
    window = plain.differentiator.window_length
    assert (scaled.differentiator.window_length, scaled.differentiator.degree) == (window, plain.differentiator.degree)
    np.testing.assert_allclose(scaled(scale * x) / scale, plain(x), rtol=0, atol=1e-9)


def test_an_outlier_is_not_the_noise() -> None:
    x = np.sin(K / 20) + 0.01 * np.random.default_rng(2).standard_normal(300)
    first = algdiff.suggest(x)
    x[100] += 1e3
    second = algdiff.suggest(x)
    # It is followed, and does not make a window longer.
    assert second.differentiator.window_length <= first.differentiator.window_length


def test_a_step_is_not_smoothed_away() -> None:
    x = np.where(K < 150, 0.0, 1.0) + 1e-3 * np.random.default_rng(3).standard_normal(300)
    smooth = algdiff.differentiate(x, deriv=0)
    # A window that smooths over the step errs by up to a half at its samples: 0.05 is three samples of 300.
    assert np.sqrt(np.mean((smooth - x) ** 2)) < 0.05


@pytest.mark.parametrize("deriv", [0, 1, 2, 3])
@pytest.mark.parametrize("kind", ["auto", "ar1"])
def test_few_samples(deriv: int, kind: str) -> None:
    rng = np.random.default_rng(deriv)
    for length in range(max(6, 5 + deriv), 41):
        smooth = np.arange(length) ** 2.0 if length % 2 else np.sin(np.arange(length) / 3)
        for x in (rng.standard_normal(length), smooth):
            suggestion = algdiff.suggest(x, deriv, noise=kind)
            found = suggestion(x)
            assert found.shape == x.shape
            assert np.isfinite(found).all()
            assert np.isfinite(suggestion.rmse)
            assert deriv <= suggestion.differentiator.degree < suggestion.differentiator.window_length <= length


@pytest.mark.parametrize("deriv", [1, 2])
def test_without_noise_nothing_is_lost(deriv: int) -> None:
    truth = 20.0**-deriv * np.sin(K / 20 + deriv * np.pi / 2)
    found = algdiff.differentiate(np.sin(K / 20), deriv=deriv)
    # Samples are taken to be known to 1e-9: over a window of 1/20 rad steps that is a millionth of a slope.
    np.testing.assert_allclose(found, truth, rtol=0, atol=1e-4 * 20.0**-deriv)
