"""Corners of calls that ask for more than sliding weights: what was once wrong, or might be."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import algdiff
from algdiff import Differentiator, differentiate, gradient, hessian, laplacian, noise_level, partial
from support import EPS, design

Array = npt.NDArray[np.float64]
N = 90
RNG = np.random.default_rng(91)
X = RNG.standard_normal(N)
UNEVEN = np.cumsum(RNG.uniform(0.2, 1.8, N))
JITTER = np.arange(N) + RNG.uniform(-0.01, 0.01, N)
SIGMA = RNG.uniform(0.5, 2, N)
EPOCH = 1_700_000_000_123_456_789
EVERYTHING: dict[str, bool] = {"return_std": True, "return_support": True, "return_bias": True}


@pytest.mark.parametrize("dtype", [np.int64, np.uint64])
@pytest.mark.parametrize("even", [True, False])
def test_nanoseconds_since_1970_lose_nothing(dtype: Any, even: bool) -> None:
    since = np.arange(N) * 10_000_000 if even else np.cumsum(np.random.default_rng(95).integers(1, 20_000_000, N))
    since -= since[0]
    t = (since + EPOCH).astype(dtype)
    at = since[3:50:7] + 11
    calls: list[dict[str, Any]] = [{"window_length": 15, "tau": tau} for tau in ("center", "newest", 0.3)]
    for call in [*calls, {"window_duration": int(since[20])}, {"window_length": 15, "deriv": (0, 1, 2)}]:
        expected = differentiate(X, t=since, **call)
        np.testing.assert_array_equal(differentiate(X, t=t, **call), expected)
        np.testing.assert_array_equal(differentiate(X[::-1], t=t[::-1], **call)[..., ::-1], expected)
    found = differentiate(X, 15, t=t, at=(at + EPOCH).astype(dtype))
    np.testing.assert_array_equal(found, differentiate(X, 15, t=since, at=at))


@pytest.mark.parametrize("dtype", [np.int64, np.uint64])
@pytest.mark.parametrize("even", [True, False])
def test_integers_further_apart_than_64_bits_with_a_sign(dtype: Any, even: bool) -> None:
    info = np.iinfo(dtype)
    since = [k * 2**62 for k in range(4)] if even else [0, 2**62, 2**63 + 2**61, 2**63 + 2**62]
    t = np.array([*(int(info.min) + one for one in since), int(info.max)], dtype)
    quarters = np.array([*(one / 2**62 for one in since), 4.0])
    found = differentiate(quarters**2, 5, degree=2, t=t) * 2.0**62
    np.testing.assert_allclose(found, 2 * quarters, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("unit", "a_second", "origin"),
    [
        ("s", 1, 17 * 10**8),
        ("ms", 1e3, 17 * 10**11),
        ("us", 1e6, 17 * 10**14),
        ("ns", 1e9, EPOCH),
        ("as", 1e18, 10**18),
    ],
)
@pytest.mark.parametrize("even", [True, False])
def test_dates_are_seconds(unit: str, a_second: float, origin: int, even: bool) -> None:
    since = 3 * np.arange(N) if even else np.cumsum(np.random.default_rng(96).integers(1, 9, N))
    since -= since[0]
    for stamps in ((origin + since).astype(f"datetime64[{unit}]"), since.astype(f"timedelta64[{unit}]")):
        expected = differentiate(X, 9, t=since / a_second)
        np.testing.assert_array_equal(differentiate(X, 9, t=stamps), expected)


@pytest.mark.parametrize("t", [np.linspace(-1.7e308, 0, 9), [-1.7e308, 1, 2, 3, 4, 5, 6, 7, 1.7e308]])
def test_times_too_far_apart_are_refused(t: Any) -> None:
    t = np.concatenate([t, [1.7e308]]) if t[-1] < 1 else np.asarray(t)
    for times in (t, t[::-1]):
        with pytest.raises(ValueError, match=r"^t must be finite, and not too far apart, got [-1]"):
            differentiate(np.arange(len(t)), 5, t=times)


@pytest.mark.parametrize("call", [{}, {"delta": 0.1}, {"t": np.arange(N)}, {"t": UNEVEN}, {"t": JITTER}])
def test_a_duration_beyond_all_windows_is_refused(call: dict[str, Any]) -> None:
    words = {name: value for name, value in call.items() if name != "delta"}
    for run in (lambda **more: differentiate(X, **call, **more), lambda **more: Differentiator(9)(X, **words, **more)):
        with pytest.raises(ValueError, match=r"^window_duration must be at most"):
            run(window_duration=1e300)


def test_even_times_are_a_step_to_the_bit() -> None:
    for step in (0.1, 0.5, 3e-5, 7.0):
        t = step * np.arange(N)
        for deriv in (1, (0, 1)):
            expected = differentiate(X, 15, deriv, delta=float(t[-1]) / (N - 1))
            np.testing.assert_array_equal(Differentiator(15, deriv)(X, t=t), expected)
            np.testing.assert_array_equal(Differentiator(15, deriv, delta=5.0)(X, t=t), expected)


@pytest.mark.parametrize("name", ["t", "sigma", "weights", "at", "autocovariance"])
def test_masked_values_are_refused(name: str) -> None:
    call: dict[str, Any] = {name: np.ma.masked_array(np.arange(1.0, N + 1), np.arange(N) == 4)}
    with pytest.raises(TypeError, match=rf"^{name} must have no masked values, got 1: fill them"):
        differentiate(X, 9, return_std=True, **call)


def test_complex_numbers_where_there_are_none() -> None:
    for policy in ("propagate", "omit"):
        with pytest.raises(TypeError, match=r"^cval must be a real number, got 1j"):
            differentiate(X, 9, mode="constant", cval=1j, nan_policy=policy)
    assert np.isfinite(differentiate(X + 0j, 9, mode="constant", cval=1j)).all()
    with pytest.raises(TypeError, match=r"^period must come with real samples, got complex"):
        differentiate(X + 0j, 9, period=1.0)
    with pytest.raises(TypeError, match=r"^period must be a real number, got 1j"):
        differentiate(X, 9, period=1j)


@pytest.mark.parametrize("name", ["weights", "sigma"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1.5, -np.inf])
def test_weights_and_levels_that_are_none(name: str, value: float) -> None:
    for shape in [(N,), (2, N)]:
        numbers = np.ones(shape)
        numbers[..., 3] = value
        words: dict[str, Any] = {name: numbers}
        with pytest.raises(ValueError, match=rf"^{name} must be finite and not negative, got {value}$"):
            differentiate(np.stack([X, X]), 9, return_std=True, **words)


WAYS: dict[str, dict[str, Any]] = {
    "even": {},
    "t": {"t": UNEVEN},
    "jitter": {"t": JITTER},
    "weights": {"weights": np.ones(N)},
    "sigma": {"sigma": SIGMA},
    "omit": {"nan_policy": "omit"},
    "wrap": {"mode": "wrap"},
    "shrink": {"edge_window": "shrink"},
    "correlated": {"autocovariance": [1.0, 0.5]},
    "at": {"at": np.arange(N)},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("shape", "axis"), [((0, N), 1), ((N, 0), 0), ((3, N, 0), 1)])
def test_no_rows(shape: tuple[int, ...], axis: int, way: str) -> None:
    for deriv, leading in [(1, ()), ((0, 1), (2,))]:
        found = differentiate(np.ones(shape), 9, deriv, axis=axis, **EVERYTHING, **WAYS[way])
        assert found.estimate.shape == found.std.shape == found.bias.shape == (*leading, *shape)
        assert found.support.shape == shape
        assert differentiate(np.ones(shape), 9, deriv, axis=axis, **WAYS[way]).shape == (*leading, *shape)


@pytest.mark.parametrize("way", [{}, {"t": UNEVEN}, {"t": JITTER}, {"t": UNEVEN, "window_duration": 9.0}])
def test_no_times(way: dict[str, Any]) -> None:
    length = {} if "window_duration" in way else {"window_length": 9}
    for x, shape in [(X, (0,)), (np.stack([X, X]), (2, 0))]:
        for deriv, leading in [(1, ()), ((0, 1), (2,))]:
            found = differentiate(x, deriv=deriv, at=[], **EVERYTHING, **length, **way)
            assert found.estimate.shape == found.std.shape == found.bias.shape == (*leading, *shape)
            assert found.support.shape == shape


# Samples that count for nothing, and infinite ones that count.


@pytest.mark.parametrize("policy", ["propagate", "omit", "raise"])
@pytest.mark.parametrize("way", ["even", "t", "jitter", "at", "duration"])
def test_samples_of_weight_0_are_left_out(way: str, policy: str) -> None:
    call = {"t": UNEVEN, "window_duration": 9.0} if way == "duration" else {"window_length": 9, **WAYS[way]}
    weights = np.where(np.arange(N) == 40, 0.0, 1.0)

    def run(place: int, value: float, **more: Any) -> algdiff.Estimates:
        x = np.where(np.arange(N) == place, value, X)
        found: algdiff.Estimates = differentiate(x, nan_policy=policy, weights=weights, return_std=True, **more, **call)
        return found

    for more in ({"sigma": 1.0}, {}):
        expected = run(40, 0.0, **more)
        assert np.isfinite([expected.estimate, expected.std]).all()
        for value in (np.inf, -np.inf, np.nan):
            found = run(40, value, **more)
            np.testing.assert_array_equal(found.estimate, expected.estimate)
            np.testing.assert_array_equal(found.std, expected.std)
    # Where the estimates change with the sample, and nowhere else.
    touched = run(20, X[20] + 1, sigma=1.0).estimate != run(20, X[20], sigma=1.0).estimate
    gone = np.isnan(run(20, np.inf, sigma=1.0).estimate)
    assert gone.sum() >= touched.sum() >= 6
    assert (gone >= touched).all()


@pytest.mark.parametrize("way", [way for way in WAYS if way not in ("sigma", "correlated")])
def test_levels_of_any_size(way: str) -> None:
    for sigma in (SIGMA, np.ones(N)):
        one = differentiate(X, 9, sigma=sigma, return_std=True, **WAYS[way]).std
        for size in (1e200, 1e-300):
            found = differentiate(X, 9, sigma=size * sigma, return_std=True, **WAYS[way]).std
            np.testing.assert_allclose(found, size * one, rtol=8 * EPS)


@pytest.mark.parametrize("way", ["even", "t", "jitter", "weights", "wrap", "shrink"])
def test_levels_beyond_single_precision(way: str) -> None:
    for sigma in (1e39, np.full(N, 1e39)):
        found = differentiate(X.astype(np.float32), 9, sigma=sigma, return_std=True, **WAYS[way])
        exact = differentiate(X, 9, sigma=sigma, return_std=True, **WAYS[way]).std
        assert np.isposinf(found.std[exact > 4e38]).all()
        assert np.isfinite(found.estimate).all()


@pytest.mark.parametrize("way", ["even", "t", "omit", "shrink"])
def test_covariances_of_any_size(way: str) -> None:
    for covariance in ([1.0], [1.0, 0.5, -0.2]):
        one = differentiate(X, 9, autocovariance=covariance, return_std=True, **WAYS[way]).std
        large = 1e308 * np.array(covariance)
        found = differentiate(X, 9, autocovariance=large, return_std=True, **WAYS[way]).std
        np.testing.assert_allclose(found, 1e154 * one, rtol=1e-12)


def test_long_windows_have_cheap_errors() -> None:
    length, n = 50_001, 1_000_000
    x = np.random.default_rng(92).standard_normal(n)
    begun = time.process_time()
    std = differentiate(x, length, return_std=True, sigma=1.0).std
    assert time.process_time() - begun < 2
    for place in (0, 1, 777, 24_999, 25_000, n // 2, n - 777, n - 1):
        start = min(max(place - length // 2, 0), n - length)
        moved = design(length, 1, degree=3, tau=(place - start + 0.5) / length)
        assert std[place] == pytest.approx(np.sqrt(moved.noise_gain), rel=1e-10)


def test_the_level_of_a_long_row_is_that_of_parts_of_it() -> None:
    for n in (131_073, 400_000):
        x = np.sin(np.arange(n) / 500) + 0.2 * np.random.default_rng(93).standard_normal(n)
        std = differentiate(x, 21, return_std=True).std[n // 2]
        assert std / np.sqrt(Differentiator(21).noise_gain) == pytest.approx(noise_level(x), rel=0.03)


def test_the_bias_warns_of_nothing() -> None:  # a warning is an error
    for length, deriv in [(9, 0), (9, 1), (11, 2), (15, 3), (51, 3)]:
        for call in ({}, {"t": UNEVEN}, {"weights": SIGMA}, {"nan_policy": "omit"}):
            Differentiator(length, deriv)
            assert np.isfinite(differentiate(X, length, deriv, return_bias=True, **call).bias).all()


GAPS = np.where(np.isin(np.arange(N), (5, 6, 30, 86)), np.nan, X)


@pytest.mark.parametrize("way", [*WAYS, "mode nan", "valid", "nearest", "mirror"])
def test_support_counts_what_is_there(way: str) -> None:
    call = {"mode": way.split()[-1]} if way not in WAYS else WAYS[way]
    found = differentiate(GAPS, 9, return_support=True, **{**call, "nan_policy": "propagate"})
    omit = differentiate(GAPS, 9, return_support=True, **{**call, "nan_policy": "omit"})
    np.testing.assert_array_equal(found.support, omit.support)
    assert np.isnan(found.estimate).any()
    if way in ("even", "t"):
        there = [np.isfinite(GAPS[start : start + 9]).sum() for start in np.arange(-4, N - 4).clip(0, N - 9)]
        np.testing.assert_array_equal(found.support, there)


@pytest.mark.parametrize("policy", ["omit", "propagate"])
@pytest.mark.parametrize("way", WAYS)
def test_several_orders_with_gaps_are_single_orders(way: str, policy: str) -> None:
    call = {"degree": 3, "return_std": True, "tau": 0.4, **WAYS[way], "nan_policy": policy}
    call |= {} if {"sigma", "autocovariance"} & set(call) else {"sigma": 1.0}
    several = differentiate(GAPS, 15, (2, 0, 1), **call)
    for place, order in enumerate((2, 0, 1)):
        single = differentiate(GAPS, 15, order, **call)
        np.testing.assert_allclose(several.estimate[place], single.estimate, rtol=0, atol=1e-13)
        np.testing.assert_allclose(several.std[place], single.std, rtol=1e-13)


@pytest.mark.parametrize("length", [9, 15, 21, 14, 20])
def test_windows_that_shrink_do_so_alike_at_both_ends(length: int) -> None:
    for deriv in range(3):
        found, back = (differentiate(x, length, deriv, edge_window="shrink", return_support=True) for x in (X, X[::-1]))
        if length % 2:
            np.testing.assert_allclose(back.estimate[::-1] * (-1) ** deriv, found.estimate, rtol=0, atol=1e-13)
        # A window of even length holds one sample more before its estimate than after it.
        there = back.support[::-1] if length % 2 else np.append(found.support[0], back.support[:0:-1])
        np.testing.assert_array_equal(there, found.support)


@pytest.mark.parametrize("down", [False, True])
def test_fields_with_gaps_on_uneven_coordinates(down: bool) -> None:
    rng = np.random.default_rng(94)
    y, z = np.cumsum(rng.uniform(0.05, 0.2, 24)), np.cumsum(rng.uniform(0.05, 0.2, 31))
    y = -y if down else y
    v, u = np.meshgrid(y, z, indexing="ij")
    f = 1 + 2 * v - u + v**2 * u + 3 * v * u**2 - u**3
    f[rng.random(f.shape) < 0.05] = np.nan
    by_v, by_u = 2 + 2 * v * u + 3 * u**2, -1 + v**2 + 6 * v * u - 3 * u**2
    second = np.array([[2 * u, 2 * v + 6 * u], [2 * v + 6 * u, 6 * v - 6 * u]])
    call: dict[str, Any] = {"spacing": (y, z), "nan_policy": "omit"}
    # Steps of 0.1, twice, make 1e2 of an error; gaps and ends another 1e3.
    close: dict[str, Any] = {"rtol": 0, "atol": 1e5 * EPS * float(np.nanmax(np.abs(f)))}
    for smooth in (False, True):
        found = gradient(f, y, z, window_length=9, nan_policy="omit", smooth=smooth)
        np.testing.assert_allclose(found[0], by_v, **close)
        np.testing.assert_allclose(found[1], by_u, **close)
        np.testing.assert_allclose(laplacian(f, 9, smooth=smooth, **call), second[0, 0] + second[1, 1], **close)
    np.testing.assert_allclose(partial(f, (1, 1), 9, **call), second[0, 1], **close)
    np.testing.assert_allclose(hessian(f, 9, **call), second, **close)
