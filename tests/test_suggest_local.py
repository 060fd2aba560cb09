"""Windows that adapt along the signal."""

from __future__ import annotations

import numpy as np
import pytest

import algdiff
from algdiff._suggest import local

DELTA = 0.002
T = DELTA * np.arange(2001)


def chirp(seed: int, level: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """Return a chirp from 0.5 to 5 Hz with noise, and its true derivative."""
    phase, rate = 2 * np.pi * (0.5 * T + 0.5625 * T**2), 2 * np.pi * (0.5 + 1.125 * T)
    return np.sin(phase) + level * np.random.default_rng(seed).standard_normal(T.size), rate * np.cos(phase)


def test_it_errs_less_where_the_pace_changes() -> None:
    plain, adapted = [], []
    for seed in range(5):
        x, truth = chirp(seed)
        suggestion = algdiff.suggest(x, delta=DELTA)
        half = suggestion.differentiator.window_length // 2
        inner = slice(2 * half, -2 * half)
        plain.append(np.mean((suggestion(x) - truth)[inner] ** 2))
        adapted.append(np.mean((algdiff.differentiate(x, delta=DELTA, local=True) - truth)[inner] ** 2))
    # The slow half of a chirp wants windows that are too long for the fast one: a tenth at least is to gain.
    assert np.mean(adapted) < 0.81 * np.mean(plain)


def test_it_is_the_suggestion_called() -> None:
    x, _ = chirp(0)
    suggestion = algdiff.suggest(x, delta=DELTA, local=True)
    assert suggestion.local
    assert "shorter and longer" in suggestion.explain()
    expected = suggestion(x)
    np.testing.assert_array_equal(algdiff.differentiate(x, delta=DELTA, local=True), expected)
    np.testing.assert_array_equal(algdiff.differentiate(x, delta=DELTA, local=True, threads=1), expected)
    np.testing.assert_array_equal(suggestion(x[:, np.newaxis] + 0.0, axis=0).shape, (x.size, 1))


def test_nothing_jumps_where_another_window_takes_over() -> None:
    # Slow, then fast, then slow: windows change twice. From sample to sample an estimate moves by the step times a
    # second derivative, its own noise included; a switch between windows would move it by their noise at once.
    x = np.sin(2 * np.pi * np.where(T < 1.5, T, np.where(T < 2.5, 1.5 + 6 * (T - 1.5), T)))
    x += 0.02 * np.random.default_rng(3).standard_normal(T.size)
    suggestion = algdiff.suggest(x, delta=DELTA, local=True)
    found = local.windows(suggestion.differentiator, T.size)
    steps = np.abs(np.diff(suggestion(x)))
    own = np.max([np.abs(np.diff(one(x, mode="valid"))).max() for one in found.designs])
    assert steps.max() <= 1.5 * own


def test_shares_are_shares_and_prefer_what_has_no_bias() -> None:
    central = algdiff.suggest(chirp(1)[0], delta=DELTA).differentiator.replace(delta=1.0)
    found = local.windows(central, T.size)
    places = np.arange(300, 1700, max(1, central.window_length // local.FINE))
    rng = np.random.default_rng(2)
    noise = rng.standard_normal(T.size)
    alike = np.array([one(noise)[places] for one in found.designs])
    share = local.shares(alike, found, places, T.size, 1.0)
    np.testing.assert_allclose(share.sum(axis=0), 1.0, rtol=1e-12)
    assert (share >= 0).all()
    # Of pure noise the longest window errs least; biased by ten of its standard deviations it is hardly used.
    assert share[-1].mean() > 0.6
    biased = alike.copy()
    biased[-1] += 10 * np.sqrt(found.gain[0])
    assert local.shares(biased, found, places, T.size, 1.0)[-1].mean() < 0.1


@pytest.mark.parametrize("dtype", [np.float32, np.complex64, np.complex128])
def test_kinds_of_samples(dtype: type) -> None:
    x = chirp(4)[0]
    samples = (x + (1j * x[::-1] if np.dtype(dtype).kind == "c" else 0)).astype(dtype)
    found = algdiff.differentiate(samples, deriv=(0, 1), delta=DELTA, local=True)
    assert found.shape == (2, x.size)
    assert found.dtype == dtype
    assert np.isfinite(found).all()
    parts = algdiff.differentiate(samples.real.astype(np.float64), deriv=(0, 1), delta=DELTA, local=True)
    if np.dtype(dtype).kind != "c":
        size = np.abs(parts).max(axis=1)
        assert (np.abs(found - parts).max(axis=1) < 2e-2 * size).all()


def test_refusals() -> None:
    x = chirp(0)[0]
    with pytest.raises(ValueError, match="local must be left out with a given window, got True"):
        algdiff.differentiate(x, 31, delta=DELTA, local=True)
    with pytest.raises(ValueError, match="give local or max_delay, not both"):
        algdiff.suggest(x, delta=DELTA, local=True, max_delay=0.1)
