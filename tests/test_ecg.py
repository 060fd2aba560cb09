"""A real electrocardiogram with missing samples: errors are as large as reported, gaps where they must be."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

import algdiff
from support import EPS, design

FS = 360.0
HOLE = slice(54_000, 54_360)
BEYOND_4 = math.erfc(4 / math.sqrt(2))
"""The share of a normal distribution that lies beyond 4 standard deviations."""


@pytest.fixture(scope="module")
def ecg() -> np.ndarray:
    counts: np.ndarray = np.load(Path(__file__).parent / "data" / "ecg_360hz.npy")
    assert counts.shape == (108_000,)
    assert counts.dtype == np.uint16
    return (counts.astype(float) - 1024) / 200


def with_gaps(ecg: np.ndarray, seed: int) -> np.ndarray:
    """Return the recording without 5 % of its samples, removed at random, and without one second."""
    gone = np.random.default_rng(seed).random(ecg.size) < 0.05
    gone[HOLE] = True
    return np.where(gone, np.nan, ecg)


def fits(there: np.ndarray, positions: np.ndarray, degree: int, orders: int) -> np.ndarray:
    """Return the weights, (windows, orders, samples), of a least squares fit to what is there of each window.

    Every window has the weight tau (1 - tau) of kappa = mu = 1, and is evaluated at the sample `positions`.
    """
    length = there.shape[1]
    tau = (np.arange(length) + 0.5) / length
    root = np.sqrt(tau * (1 - tau)) * there
    legendre = np.polynomial.legendre
    basis = legendre.legvander(2 * tau - 1, degree)
    inverse = np.linalg.pinv(root[:, :, None] * basis) * root[:, None]
    at = [
        legendre.legvander(2 * tau - 1, degree - order) @ legendre.legder(np.eye(degree + 1), order) if order else basis
        for order in range(orders)
    ]
    scale = (2 / length * FS) ** np.arange(orders)
    rows = np.stack([one[positions] for one in at], axis=1) * scale[:, None]
    return np.asarray(rows @ inverse)


def windows(size: int, length: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where the windows of mode "fit" start, and which of their samples the estimate belongs to."""
    start = np.clip(np.arange(size) - length // 2, 0, size - length)
    return start, np.arange(size) - start


# The weights of a window of 15 samples and degree 10 follow the fastest parts, the QRS complexes, whose width is some
# 30 samples: with degree 5 the same window misses them by more than the noise, and a thousand estimates are off by
# more than 4 standard deviations. The noise is that of the muscles, so that its level changes: it is measured around
# every sample.
LENGTH, DEGREE = 15, 10
SEEDS = (0, 1, 2)


def test_estimates_with_gaps_stay_within_their_errors(ecg: np.ndarray) -> None:
    one = design(LENGTH, (0, 1, 2), degree=DEGREE, fs=FS)
    complete = one(ecg)
    beyond, compared = np.zeros(3, int), 0
    for seed in SEEDS:
        x = with_gaps(ecg, seed)
        sigma = algdiff.noise_level(x, local=int(FS))
        found = one(x, nan_policy="omit", return_std=True, sigma=sigma)
        off = np.abs(found.estimate - complete)
        outside = ~np.isnan(off[0])
        outside[HOLE] = False
        # Nearly all of them, of which more than half miss a sample; the others are the same.
        compared += int(outside.sum())
        assert outside.sum() > 0.99 * ecg.size
        assert (off[0, outside] > 0).mean() > 0.5
        beyond += (off > 4 * found.std)[:, outside].sum(axis=1)
    print(f"beyond 4 std: {beyond} of {compared} each; a normal law gives {BEYOND_4 * compared:.1f}")
    # Both results share samples: by that they differ by less than the error of the one with gaps, but for bias.
    assert (beyond <= BEYOND_4 * compared).all()


def test_the_difference_has_the_size_of_the_noise_where_the_signal_is_slow(ecg: np.ndarray) -> None:
    # Away from the QRS complexes even 31 samples of degree 6 show no bias. What differs from the complete result is
    # noise, of variance sigma^2 |w_gaps - w|^2. Most of it is hum of 60 Hz, of which third differences, and so the
    # default sigma, show half: here sigma is the root mean square of what the fits leave. As hum is not white, the
    # errors are right to a third at most.
    length, degree, orders = 31, 6, 3
    slope = np.abs(algdiff.differentiate(ecg, 9, 1, degree=2, kappa=0, mu=0, fs=FS))
    start, position = windows(ecg.size, length)
    slow = sliding_window_view(slope, length)[start].max(axis=1) < 3.0
    smooth = algdiff.differentiate(ecg, length, 0, degree=degree, kappa=0, mu=0)
    # A residual at the center has the variance 1 - w_center of that of the noise.
    share = 1 - design(length, 0, degree=degree, kappa=0, mu=0).weights[length // 2]
    sigma = float(np.sqrt(np.mean((ecg - smooth)[slow] ** 2) / share))
    x = with_gaps(ecg, 3)
    there = ~np.isnan(sliding_window_view(x, length)[start])
    chosen = slow & ~there.all(axis=1)
    chosen[HOLE.start - length : HOLE.stop + length] = False
    one = design(length, tuple(range(orders)), degree=degree, fs=FS)
    found = one(x, nan_policy="omit", return_std=True, sigma=sigma)
    chosen &= ~np.isnan(found.estimate[0])
    assert chosen.sum() > 5000
    partial = fits(there[chosen], position[chosen], degree, orders)
    whole = fits(np.ones((length, length), bool), np.arange(length), degree, orders)[position[chosen]]
    # Both have the rounding of a fit, with gains of 100 at most, of the condition number 10^4.
    np.testing.assert_allclose(
        found.std[:, chosen], np.linalg.norm(partial, axis=-1).T * sigma, rtol=1e4 * length * EPS
    )
    off = np.abs(found.estimate - one(ecg))[:, chosen]
    expected = np.linalg.norm(partial - whole, axis=-1).T * sigma
    # Where the missing sample had no weight, as that at the center of a slope, all that differs is rounding.
    counts = expected > 1e-6 * found.std[:, chosen]
    rms = np.sqrt(np.mean((off / expected) ** 2, axis=1, where=counts))
    beyond = (off > 4 * found.std[:, chosen]).sum(axis=1)
    print(f"sigma {sigma:.4f}, rms {rms}, beyond 4 std {beyond} of {chosen.sum()}")
    assert (np.abs(rms - 1) < 1 / 3).all()
    assert (beyond <= BEYOND_4 * chosen.sum()).all()


@pytest.mark.parametrize(("length", "degree", "limits"), [(15, 3, {}), (15, 10, {}), (21, 4, {"max_gain": 2.0})])
def test_nan_exactly_where_support_or_gain_do_not_suffice(
    ecg: np.ndarray, length: int, degree: int, limits: dict[str, float]
) -> None:
    x = with_gaps(ecg, 4)
    x[:3] = x[-9:] = np.nan
    start, position = windows(ecg.size, length)
    there = ~np.isnan(sliding_window_view(x, length)[start])
    support = there.sum(axis=1)
    enough = support > degree
    gain = np.full(ecg.size, np.inf)
    some = np.flatnonzero(enough & ~there.all(axis=1))
    whole = fits(np.ones((length, length), bool), np.arange(length), degree, 1)[:, 0]
    plain = np.square(whole).sum(axis=-1)
    gain[some] = np.square(fits(there[some], position[some], degree, 1)[:, 0]).sum(axis=-1) / plain[position[some]]
    limit = limits.get("max_gain", 100.0)
    # No window may lie so near the limit that rounding decides.
    assert np.abs(gain[some] / limit - 1).min() > 1e-9
    expected = ~enough | (gain > limit) & ~there.all(axis=1)
    one = design(length, 0, degree=degree, fs=FS)
    found = one(x, nan_policy="omit", return_std=True, return_support=True, **limits)
    np.testing.assert_array_equal(np.isnan(found.estimate), expected)
    np.testing.assert_array_equal(np.isnan(found.std), expected)
    np.testing.assert_array_equal(found.support, support)
    np.testing.assert_array_equal(np.isnan(one(x, nan_policy="omit", **limits)), expected)
    assert expected[HOLE].sum() > HOLE.stop - HOLE.start - length
    assert (expected & enough).any()
    assert (~expected & ~there.all(axis=1)).any()
    # And where there are estimates, they are those of that fit.
    some = some[~expected[some]]
    filled = np.nan_to_num(sliding_window_view(x, length)[start[some]])
    values = np.einsum("ij,ij->i", fits(there[some], position[some], degree, 1)[:, 0], filled)
    # Both have rounding that a fit magnifies by its condition number, at most 1e8 where the gain is limited.
    np.testing.assert_allclose(found.estimate[some], values, rtol=0, atol=1e-8 * np.abs(ecg).max())
