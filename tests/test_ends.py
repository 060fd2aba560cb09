"""Ends: every derivative up to the last sample, of polynomials exactly, whatever the window, the gaps and the times."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import algdiff
from support import EPS, conditioning, design

N, L = 41, 13
RNG = np.random.default_rng(41)
TIMES = {
    "even": 0.1 * np.arange(N),
    "uneven": np.cumsum(RNG.uniform(0.05, 0.15, N)),
    "descending": -np.cumsum(RNG.uniform(0.05, 0.15, N)),
    "bursts": np.cumsum(np.where(np.arange(N) % 4 == 0, 0.22, 0.06)),
}
GAPS = {
    "none": [],
    "ends": [0, 1, 39, 40],
    "near": [2, 3, 36, 38],
    "inside": [5, 12, 13, 14, 20, 31],
}
TAUS: tuple[float | str, ...] = ("center", "root", "newest", 0, 0.3, 1.2)
ORDERS = range(5)


def signal(t: np.ndarray, degree: int, order: int = 0) -> np.ndarray:
    """Return a derivative of a polynomial of `degree` that is of size 1 all over `t`: of Chebyshev's."""
    half = 0.5 * (t.max() - t.min())
    series = np.polynomial.chebyshev.chebder(np.eye(degree + 1)[degree], order) / half**order
    return np.asarray(np.polynomial.chebyshev.chebval((t - t.min()) / half - 1, series))


def check(found: np.ndarray, truth: np.ndarray, std: np.ndarray, degree: int) -> None:
    """Compare estimates of samples of size 1, whose noise gains tell how rounding in them and in the fit grows.

    The weights err by the condition number of the basis times eps, which bad places of the samples worsen, with the
    gain, by another 100 at most; they meet L samples of size 1.
    """
    error = 100 * conditioning(L, degree, 1, 1) * EPS * np.sqrt(L) * std
    assert (np.abs(found - truth) <= error).all(), np.max(np.abs(found - truth) / error)


@pytest.mark.parametrize("spacing", TIMES)
@pytest.mark.parametrize("gaps", GAPS)
@pytest.mark.parametrize("tau", TAUS)
@pytest.mark.parametrize("edge_window", ["full", "shrink"])
def test_polynomials_to_the_last_sample(spacing: str, gaps: str, tau: float | str, edge_window: str) -> None:
    t = TIMES[spacing]
    for order in ORDERS:
        degree = max(order, 2) if order % 2 else order + 1
        x = signal(t, degree)
        x[GAPS[gaps]] = np.nan
        options: dict[str, Any] = {
            "return_std": True,
            "sigma": 1.0,
            "return_support": True,
            "max_gain": 1e300,
            "edge_window": edge_window,
        }
        one = design(L, order, degree=degree, tau=tau, delta=0.1)
        found = one(x, nan_policy="omit", t=None if spacing == "even" else t, **options)
        # A shrunken window may hold too few samples, a full one has enough.
        few = found.support <= degree
        assert edge_window == "shrink" or not few.any()
        np.testing.assert_array_equal(np.isnan(found.estimate), few)
        check(found.estimate[~few], signal(t, degree, order)[~few], found.std[~few], degree)


@pytest.mark.parametrize("spacing", ["uneven", "descending", "bursts"])
@pytest.mark.parametrize("tau", [0, 0.3, 0.5, 1, 1.2])
def test_polynomials_to_the_last_sample_with_durations(spacing: str, tau: float) -> None:
    t = TIMES[spacing]
    for order in ORDERS:
        x = signal(t, order + 1)
        one = design(L, order, degree=order + 1, tau=tau)
        found = one(x, t=t, window_duration=2.0, return_std=True, return_support=True, sigma=1.0)
        check(found.estimate, signal(t, order + 1, order), found.std, order + 1)
        assert found.support.min() > order + 1


@pytest.mark.parametrize("spacing", TIMES)
def test_polynomials_at_any_time(spacing: str) -> None:
    t = TIMES[spacing]
    # Also half a window beyond either end.
    at = np.linspace(t.min() - 0.6, t.max() + 0.6, 301)
    for order in ORDERS:
        degree = order + 1
        x = signal(t, degree)
        x[GAPS["near"]] = np.nan
        half = 0.5 * (t.max() - t.min())
        series = np.polynomial.chebyshev.chebder(np.eye(degree + 1)[degree], order) / half**order
        truth = np.polynomial.chebyshev.chebval((at - t.min()) / half - 1, series)
        found = algdiff.differentiate(
            x, L, order, degree=degree, t=t, at=at, nan_policy="omit", return_std=True, sigma=1.0, max_gain=1e300
        )
        check(found.estimate, truth, found.std, degree)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("order", ORDERS)
def test_the_ends_mirror_each_other(side: int, order: int) -> None:
    x = np.random.default_rng(42).standard_normal((3, N))
    one = design(L, order, delta=0.1)
    for call in ({}, {"t": TIMES["uneven"]}):
        plain = one(x, return_std=True, sigma=1.0, **call)
        back = {name: (-value[::-1] if name == "t" else value) for name, value in call.items()}
        turned = one(x[:, ::-1], return_std=True, sigma=1.0, **back)
        expected = (-1) ** order * turned.estimate[:, ::-1]
        # Even windows would put the moved tau elsewhere; at 13 samples and tau = 1/2 the two are mirror images.
        error = 100 * conditioning(L, order + 2, 1, 1) * EPS * L * np.abs(x).max() * plain.std
        assert (np.abs(plain.estimate - expected) <= error)[:, ::side].all()
        np.testing.assert_allclose(plain.std, turned.std[:, ::-1], rtol=100 * conditioning(L, order + 2, 1, 1) * EPS)


def test_the_last_sample_costs_what_its_tau_costs() -> None:
    rounding = 100 * conditioning(L, 3, 1, 1) * EPS
    one = design(L, (0, 1, 2), degree=3)
    std = one(np.zeros(N), return_std=True, sigma=1.0).std
    middle = design(L, (0, 1, 2), degree=3).noise_gain
    last = design(L, (0, 1, 2), degree=3, tau=1 - 0.5 / L).noise_gain
    np.testing.assert_allclose(std[:, N // 2], np.sqrt(middle), rtol=rounding)
    np.testing.assert_allclose(std[:, -1], np.sqrt(last), rtol=rounding)
    np.testing.assert_allclose(std[:, 0], std[:, -1], rtol=rounding)
    assert (std[:, -1] > 2 * std[:, N // 2]).all()


@pytest.mark.parametrize("tau", [0.5, "newest", 0.3])
@pytest.mark.parametrize(("degree", "min_support"), [(2, None), (2, 8), (5, None), (6, None)])
def test_shrunken_windows_hold_as_many_samples_as_fit(tau: float | str, degree: int, min_support: int | None) -> None:
    one = design(L, 1, degree=degree, tau=tau)
    x = np.random.default_rng(43).standard_normal(N)
    found = one(x, edge_window="shrink", min_support=min_support, return_std=True, return_support=True, sigma=1.0)
    full = one(x, return_std=True, sigma=1.0)
    least = min(max(min_support or degree + 1, 2 * degree + 1), L)
    for i in range(N):
        # As odd or even as the whole window.
        starts = {n: i - int(one.tau * n + 1e-9) for n in range(L, least - 1, -2)}
        counts = [L] if inside(one, i) else [n for n, start in starts.items() if 0 <= start <= N - n]
        count = counts[0] if counts else min(starts)
        assert found.support[i] == count
        start = min(max(i - int(one.tau * count + 1e-9), 0), N - count)
        if inside(one, i):
            assert found.estimate[i] == full.estimate[i]
            continue
        window = design(count, 1, degree=degree, tau=(i - start + 0.5) / count)
        error = 100 * conditioning(count, degree, 1, 1) * EPS * np.linalg.norm(window.weights)
        assert abs(found.estimate[i] - window.weights @ x[start : start + count]) <= count * error * np.abs(x).max()
        assert abs(found.std[i] - np.linalg.norm(window.weights)) <= error


def inside(one: algdiff.Differentiator, i: int) -> bool:
    """Return whether the whole window of sample `i` lies in the data, as mode "nan" shows."""
    return bool(np.isfinite(one(np.zeros(N), mode="nan")[i]))


def test_shrunken_windows_are_less_biased_and_noisier() -> None:
    t = np.arange(N)
    x = np.sin(0.3 * t)
    one = design(L, 1, degree=2)
    full = one(x, return_std=True, sigma=1.0)
    shrunk = one(x, edge_window="shrink", return_std=True, sigma=1.0)
    ends = np.r_[0 : L // 2, N - L // 2 : N]
    error, less = (np.sqrt(np.mean((y.estimate - 0.3 * np.cos(0.3 * t))[ends] ** 2)) for y in (full, shrunk))
    assert less < 0.5 * error
    assert (shrunk.std[ends] > full.std[L]).all()
    middle = np.r_[L // 2 : N - L // 2]
    np.testing.assert_array_equal(shrunk.estimate[middle], full.estimate[middle])
