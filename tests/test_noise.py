"""`noise_level` against a naive twin, and against levels that are known."""

from __future__ import annotations

import math
import time
import tracemalloc
from typing import Any

import numpy as np
import pytest

import algdiff

noise_level: Any = algdiff.noise_level
EPS = float(np.finfo(float).eps)
RNG = np.random.default_rng
# n times the squared relative standard error on even samples, by order: the variance of the clipped scale, from the
# Hermite series of z**2 up to 3 and the correlations of the differences, C(2m, m + k) / C(2m, m).
VARIANCE = {1: 0.834, 2: 1.070, 3: 1.266, 4: 1.436, 5: 1.588}


def error(n: float, order: int = 3) -> float:
    """Return the relative standard error of the level from n samples."""
    return math.sqrt(VARIANCE[order] / n)


def naive_scale(sizes: list[float]) -> float:
    """Return the clipped root mean square, difference by difference."""
    level = float(np.median(sizes)) / 0.6744897501960817
    for _ in range(100):
        kept = [d for d in sizes if d <= 3 * level]
        level = math.sqrt(1.027393469477902 * sum(d * d for d in kept) / len(kept))
    return level


def naive_sizes(x: Any, t: Any, w: Any, order: int) -> list[float]:
    """Return the moduli of the differences: the unit noise that no polynomial of degree below `order` makes."""
    there = [i for i in range(len(x)) if math.isfinite(x[i]) and w[i] > 0]
    sizes = []
    for start in range(len(there) - order):
        some = there[start : start + order + 1]
        u = np.array([2 * (t[i] - t[some[0]]) / (t[some[-1]] - t[some[0]]) - 1 for i in some])
        root = np.sqrt([w[i] for i in some])
        unit = np.linalg.svd(np.polynomial.legendre.legvander(u, order - 1).T * root)[2][-1]
        sizes.append(abs(sum(float(unit[k]) * float(root[k]) * x[i] for k, i in enumerate(some))))
    return sizes


def naive_scale_of_many(x: Any, w: Any) -> float:
    """Return the level at order 3 of long even samples with weights."""
    plain, n = (1.0, -3.0, 3.0, -1.0), len(x) - 3
    norm = sum(c * c / w[j : j + n] for j, c in enumerate(plain))
    sizes = np.abs(sum(c * x[j : j + n] for j, c in enumerate(plain)) / np.sqrt(norm))
    level = float(np.median(sizes)) / 0.6744897501960817
    for _ in range(100):
        level = math.sqrt(1.027393469477902 * float(np.mean(np.square(sizes[sizes <= 3 * level]))))
    return level


def test_it_is_the_naive_twin() -> None:
    rng = RNG(0)
    for _ in range(200):
        n, order = int(rng.integers(12, 60)), int(rng.integers(1, 6))
        x = rng.standard_normal(n)
        x[rng.random(n) < 0.05] += 30
        options: dict[str, Any] = {}
        if rng.random() < 0.5:
            options["t"] = np.cumsum(rng.uniform(0.1, 1, n)) * rng.choice([-1, 1])
        if rng.random() < 0.5:
            options["weights"] = np.where(rng.random(n) < 0.1, 0, rng.uniform(0.2, 5, n))
        if rng.random() < 0.5:
            x[rng.random(n) < 0.2] = rng.choice([np.nan, np.inf, -np.inf])
        sizes = naive_sizes(x, options.get("t", np.arange(n)), options.get("weights", np.ones(n)), order)
        if sizes:
            np.testing.assert_allclose(noise_level(x, order=order, **options), naive_scale(sizes), rtol=1e-9)


def test_rows_are_alone() -> None:
    rng = RNG(1)
    x = rng.standard_normal((3, 50, 4))
    x[rng.random(x.shape) < 0.1] = np.nan
    x[:2, :, 0] = np.nan
    x[0, 10:14, 0] = x[1, 10:13, 0] = 0
    x[0, 13, 0] = 1
    t, w = np.cumsum(rng.uniform(0.1, 1, 50)), rng.uniform(0, 2, x.shape)
    for weights in (None, w[0, :, 0], w):
        for stamps in (None, t):
            for local in (None, 20):
                got = noise_level(x, t=stamps, axis=1, weights=weights, local=local)
                assert got.dtype == np.float64
                assert got.shape == ((3, 4) if local is None else x.shape)
                for i, k in np.ndindex(3, 4):
                    own = w[i, :, k] if weights is w else weights
                    one = noise_level(x[i, :, k], t=stamps, weights=own, local=local)
                    np.testing.assert_array_equal(got[i, k] if local is None else got[i, :, k], one)
    whole = noise_level(x, axis=1)
    assert math.isfinite(whole[0, 0])
    assert math.isnan(whole[1, 0])
    np.testing.assert_array_equal(whole, noise_level(np.moveaxis(x, 1, -1)))


def test_many_rows_are_worked_on_in_groups() -> None:
    x = RNG(2).standard_normal((700, 1000))
    w = RNG(3).uniform(0.5, 2, x.shape)
    got = noise_level(x, weights=w)
    for i in (0, 261, 262, 263, 699):
        assert got[i] == noise_level(x[i], weights=w[i])
    got = noise_level(x.reshape(-1), weights=w.reshape(-1))
    assert got == pytest.approx(naive_scale_of_many(x.reshape(-1), w.reshape(-1)), rel=1e-9)


@pytest.mark.parametrize("order", VARIANCE)
def test_the_standard_error_is_as_stated(order: int) -> None:
    rows, n = 4000, 400
    levels = noise_level(RNG(4).standard_normal((rows, n)), order=order)
    # The mean within 4 of its own errors, of a bias of half the squared error; the variance too, whose error is
    # sqrt(2 / rows). The differences are `order` fewer than n, and the terms beyond 1 / n are as small.
    own = error(n, order) / math.sqrt(rows)
    assert abs(float(np.mean(levels)) - 1 + error(n, order) ** 2 / 2) < 4 * own + error(n, order) ** 2 / 2
    assert abs(float(np.var(levels)) / error(n, order) ** 2 - 1) < 4 * math.sqrt(2 / rows) + 2 * order / n


@pytest.mark.parametrize("level", [1e-300, 1e-12, 0.1, 1.0, 3e5, 1e300])
@pytest.mark.parametrize("order", VARIANCE)
def test_white_noise_on_a_signal(level: float, order: int) -> None:
    n = 20_000
    u = np.linspace(-1, 1, n)
    noise = RNG(order).standard_normal(n)
    trend = 1e3 * np.polynomial.legendre.legval(u, np.ones(order))
    for signal in (0, trend, 10 * np.sin(2 * np.pi * u)):
        assert abs(noise_level(level * (signal + noise), order=order) / level - 1) < 4 * error(n, order)


def test_a_fast_sine_needs_a_high_order() -> None:
    n = 20_000
    signal = 10 * np.sin(2 * np.pi * np.arange(n) / 60)
    x = signal + RNG(6).standard_normal(n)
    # The differences of the sine have the root mean square 10 / sqrt(2) (2 sin(pi / 60))**m / sqrt(C(2m, m)).
    left = [10 / math.sqrt(2) * (2 * math.sin(math.pi / 60)) ** m / math.sqrt(math.comb(2 * m, m)) for m in (1, 3)]
    assert left[0] > 0.5
    assert noise_level(x, order=1) > 1 + left[0] ** 2 / 4
    assert abs(noise_level(x, order=3) - 1) < 4 * error(n) + left[1] ** 2


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5, 8, 20])
def test_polynomials_leave_rounding(order: int) -> None:
    rng = RNG(7)
    t = np.sort(rng.uniform(-1, 1, 300))
    for stamps in (None, t, t[::-1]):
        u = np.linspace(-1, 1, 300) if stamps is None else stamps
        x = np.polynomial.legendre.legval(u, rng.uniform(-1, 1, order))
        x[rng.random(300) < 0.1] = np.nan
        # Samples of at most `order` terms, each rounded in the sum, and as many operations on coefficients.
        bound = 8 * EPS * order * math.sqrt(order + 1) * float(np.nanmax(np.abs(x)))
        level = noise_level(x, t=stamps, order=order)
        assert isinstance(level, float)
        assert level < bound
        higher = noise_level(x + 1e-3 * np.polynomial.legendre.legval(u, [0] * order + [1]), t=stamps, order=order)
        assert order > 3 or higher > bound


@pytest.mark.parametrize("value", [0.0, 0.1, -7.3, 1e9 + 0.1, 1e300])
def test_a_constant_has_no_noise(value: float) -> None:
    t = np.cumsum(RNG(8).uniform(0.1, 1, 100))
    for options in ({}, {"t": t}, {"weights": t}, {"local": 20}):
        np.testing.assert_array_equal(noise_level(np.full(100, value), **options), 0.0)


def test_outliers_do_little_harm() -> None:
    n = 20_000
    rng = RNG(9)
    clean = rng.standard_normal(n)
    bad = rng.random(n) < 0.05
    t = np.cumsum(rng.uniform(0.1, 1, n))
    for outlier in (100 * rng.choice([-1, 1], n), np.full(n, 100.0), 100 * rng.standard_normal(n), np.full(n, 1e20)):
        for stamps in (None, t):
            before = noise_level(clean, t=stamps)
            assert abs(noise_level(np.where(bad, clean + outlier, clean), t=stamps) / before - 1) < 0.1
    assert abs(noise_level(np.where(bad, 1e38, clean).astype(np.float32)) / noise_level(clean) - 1) < 0.1
    assert abs(noise_level(np.where(bad, np.inf, clean)) - 1) < 5 * error(n)


def test_what_is_missing_costs_accuracy_only() -> None:
    n = 20_000
    rng = RNG(10)
    signal = 1e4 * np.linspace(-1, 1, n) ** 2
    x = signal + 0.5 * rng.standard_normal(n)
    gone = rng.random(n) < 0.3
    gone[5000:9000] = True
    holed = np.where(gone, np.nan, x)
    level = noise_level(holed)
    assert abs(level / 0.5 - 1) < 5 * error(n - gone.sum())
    assert noise_level(np.ma.masked_array(np.where(gone, 7e7, x), gone)) == level
    assert noise_level(np.ma.masked_array(x)) == noise_level(x)
    assert noise_level(x, weights=~gone) == pytest.approx(level, rel=1e-12)
    assert noise_level(holed, t=np.arange(n)) == level
    assert noise_level(holed[~gone], t=np.flatnonzero(~gone)) == level
    assert noise_level(np.ma.masked_array(x[None], gone[None]), axis=1) == [level]


def test_uneven_time_stamps() -> None:
    n = 20_000
    rng = RNG(11)
    pairs = np.repeat(np.arange(n / 2), 2)
    pairs[1::2] += 1e-7
    stamps = {
        "even": 0.01 * np.arange(n),
        "random": np.sort(rng.random(n)),
        "clusters": pairs,
        "years": 1.7e9 + np.cumsum(rng.uniform(0.1, 1, n)),
        "geometric": 2.0 ** (np.arange(n) / 10 - 1000),
        "wide": np.sort(rng.uniform(-1, 1, n)) * 8e307,
    }
    for name, t in stamps.items():
        u = np.linspace(-1, 1, n) if name == "geometric" else 2 * ((t - t[0]) / (t[-1] - t[0])) - 1
        trend = 0 if name == "geometric" else 1e3 * u**2
        x = trend + rng.standard_normal(n)
        level = noise_level(x, t=t)
        # At random stamps the variance is 1.44 / n, the most of these.
        assert abs(level - 1) < 4 * math.sqrt(1.44 / n), name
        assert noise_level(x[::-1], t=t[::-1]) == pytest.approx(level, rel=1e-9)
        assert noise_level(x, t=-t) == pytest.approx(level, rel=1e-9)
    assert noise_level(x, t=stamps["even"]) == pytest.approx(noise_level(x), rel=1e-9)


def test_a_trend_on_clustered_stamps_is_removed_at_high_order() -> None:
    t = np.concatenate([k + 1e-13 * np.arange(1, 8) * (1 + k) for k in range(9)])
    t = np.concatenate([1e-300 * np.arange(5), t[t > 0]])
    x = 1 + t + t**2
    assert noise_level(x, t=t, order=12) < 8 * 12 * EPS * math.sqrt(13) * x.max()
    assert noise_level(RNG(12).standard_normal(t.size), t=t, order=12) > 0.1


def test_weights() -> None:
    n = 20_000
    rng = RNG(13)
    w = 10 ** rng.uniform(-1, 1, n)
    noise = rng.standard_normal(n)
    x = np.linspace(0, 1e3, n) ** 2 + 0.3 * noise / np.sqrt(w)
    # Uneven coefficients: the variance is between those of order 3 and of independent differences, 1.27 and 0.5.
    assert abs(noise_level(x, weights=w) / 0.3 - 1) < 4 * error(n)
    assert noise_level(x, weights=4 * w) == pytest.approx(2 * noise_level(x, weights=w), rel=1e-12)
    assert noise_level(x, weights=np.full(n, 4.0)) == pytest.approx(2 * noise_level(x), rel=1e-9)
    assert noise_level(1e-140 * x, weights=1e300 * w) == pytest.approx(1e10 * noise_level(x, weights=w), rel=1e-9)
    both = noise_level(np.stack([x, noise]), weights=np.stack([w, np.ones(n)]))
    assert both[0] == noise_level(x, weights=w)
    assert both[1] == pytest.approx(noise_level(noise), rel=1e-12)


def test_types() -> None:
    n = 20_000
    rng = RNG(14)
    x = np.linspace(0, 100, n) + rng.standard_normal(n)
    level = noise_level(x)
    assert type(level) is float
    assert noise_level(x.tolist()) == noise_level(x.astype(">f8")) == noise_level(np.repeat(x, 2)[::2]) == level
    single = x.astype(np.float32)
    assert noise_level(single) == noise_level(single.astype(np.float64))
    assert abs(noise_level(np.rint(20 * x).astype(np.int32)) / 20 - level) < 4 * error(n) / 20 + 1 / (24 * 400)
    assert abs(noise_level(rng.random(n) < 0.5) - 0.5) < 0.5 * 4 * error(n)
    wide = x.astype(np.longdouble)
    wide[50] = np.longdouble("1e400")
    assert noise_level(wide) == noise_level(np.where(np.arange(n) == 50, np.nan, x))
    before = x.copy()
    x.flags.writeable = False
    noise_level(x, local=20)
    np.testing.assert_array_equal(x, before)


def test_complex_noise_has_two_parts() -> None:
    n = 20_000
    rng = RNG(15)
    x = rng.standard_normal(n) + 2j * rng.standard_normal(n) + 1e3 * np.exp(2j * np.pi * np.arange(n) / n)
    level = noise_level(x)
    assert type(level) is float
    assert abs(level / math.sqrt(5) - 1) < 4 * error(n)
    assert level == math.hypot(noise_level(x.real), noise_level(x.imag))
    x[::100] += np.nan * 1j
    there = np.isfinite(x)
    assert noise_level(x) == pytest.approx(
        math.hypot(*(noise_level(np.where(there, p, np.nan)) for p in (x.real, x.imag)))
    )
    local = noise_level(np.stack([x, x]), local=500)
    assert local.dtype == np.float64
    np.testing.assert_array_equal(local[0], noise_level(x, local=500))
    assert np.abs(local / math.sqrt(5) - 1).max() < 5 * error(500)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.16, 0.17, 0.18, 0.3, 0.5])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_quantised_signal_at_rest(share: float, dtype: type) -> None:
    n = 40_000
    flips = RNG(16).random(n) < share
    # Of a flip of probability p the squared deviation varies by more than that of a normal variable:
    # (1 / (p (1 - p)) - 4) / n, and the differences repeat each up to 2.31 times; the clipped scale of the few
    # discrete sizes is within 2 percent of the deviation.
    spread = math.sqrt((1.155 + (1 / (share * (1 - share)) - 4) / 4) / n)
    x: Any
    for x in ((1.1 + 0.1 * flips).astype(dtype), 1.1 + 0.1 * flips + 0.1 * np.arange(n)):
        assert abs(noise_level(x) / (0.1 * math.sqrt(share * (1 - share))) - 1) < 0.02 + 4 * spread


def test_spikes_on_a_quantised_signal_at_rest() -> None:
    n = 40_000
    x = (RNG(17).random(n) < 0.05).astype(float)
    spiked = x.copy()
    spiked[::1000] = 1e3
    assert abs(noise_level(spiked) / noise_level(x) - 1) < 0.02
    assert noise_level(np.where(np.arange(100) == 50, 1.0, 0.0)) == pytest.approx(1 / math.sqrt(97), rel=1e-12)


def test_too_few_samples() -> None:
    for order in (1, 3, 20):
        for n in range(order + 1):
            missing = np.full(9 + order, np.nan)
            arrays: list[Any] = [np.ones(n), missing, np.r_[np.ones(n), missing], 1j * np.ones(n)]
            for x in arrays:
                level = noise_level(x, order=order)
                assert isinstance(level, float)
                assert math.isnan(level)
                assert np.isnan(noise_level(x, order=order, local=200)).all()
                assert noise_level(x, order=order, local=200).shape == x.shape
        assert noise_level(np.ones(order + 1), order=order) == 0
    assert noise_level([0, 0, 0, 1, np.nan]) == pytest.approx(naive_scale([1 / math.sqrt(20)]))
    assert np.isnan(noise_level(np.ones((2, 0)), t=[], weights=[])).tolist() == [True, True]
    assert noise_level(np.ones((0, 9))).shape == (0,)
    assert noise_level(np.ones((0, 9)), local=20, weights=np.ones((0, 9))).shape == (0, 9)
    assert noise_level(np.ones((9, 0)), axis=0).shape == (0,)
    assert math.isnan(noise_level(np.ma.masked_array(np.ones(9), True)))


def test_a_level_that_doubles() -> None:
    n, local = 8003, 400  # 39 blocks every 200 differences, the same from either end
    rng = RNG(18)
    level = np.where(np.arange(n) < n // 2, 1.0, 2.0)
    x = 1e3 * np.sin(2 * np.pi * np.arange(n) / n) + level * rng.standard_normal(n)
    far = np.abs(np.arange(n) - n // 2) > local
    t = np.cumsum(rng.uniform(0.1, 1, n))
    for options in ({}, {"t": t}):
        got = noise_level(x, local=local, **options)
        assert got.shape == x.shape
        # The largest of the blocks within 4.5 of their errors, the mean of a half within 4 of its.
        most = 4.5 * math.sqrt(1.44 / local)
        assert np.abs(got / level - 1)[far].max() < most
        for half in (slice(0, n // 2 - local), slice(n // 2 + local, n)):
            assert abs((got / level)[half].mean() - 1) < 4 * math.sqrt(1.44 / (n // 2 - local)) + 1.44 / local
        assert np.all((got[~far] > 1 - most) & (got[~far] < 2 * (1 + most)))
        np.testing.assert_allclose(
            noise_level(x[::-1], local=local, t=-t[::-1] if options else None)[::-1], got, rtol=1e-9
        )


def test_the_local_level_is_that_of_blocks() -> None:
    rng = RNG(19)
    n, local, order = 215, 40, 3
    x = rng.standard_normal(n)
    sizes = naive_sizes(x, np.arange(n), np.ones(n), order)
    blocks = 1 + math.ceil((len(sizes) - local) / 20)
    spacing = (len(sizes) - local) / (blocks - 1)
    starts = [round(k * spacing) for k in range(blocks)]
    centers = np.arange(blocks) * spacing + (local - 1 + order) / 2
    expected = np.interp(np.arange(n), centers, [naive_scale(sizes[s : s + local]) for s in starts])
    np.testing.assert_allclose(noise_level(x, local=local), expected, rtol=1e-9)
    holed = np.insert(x, 100, np.full(7, np.nan))
    got = noise_level(holed, local=local, t=np.r_[np.arange(100), 99 + np.arange(1, 8) / 8, np.arange(100, n)])
    np.testing.assert_allclose(np.delete(got, np.arange(100, 107)), expected, rtol=1e-9)
    np.testing.assert_allclose(got[100:107], (expected[99] + expected[100]) / 2, rtol=1e-9)
    for size in (n, 10**6):
        np.testing.assert_allclose(noise_level(x[:30], local=size), noise_level(x[:30]), rtol=1e-12)


def test_long_samples_are_cheap() -> None:
    x = RNG(20).standard_normal(10**6)
    for local, multiple in ((None, 5), (300, 9)):
        start = time.process_time()
        noise_level(x, local=local)
        assert time.process_time() - start < 2  # tens of times what it takes
        tracemalloc.start()
        noise_level(x, local=local)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < multiple * x.nbytes


@pytest.mark.parametrize(
    ("kind", "match", "options"),
    [
        (TypeError, "x must hold real or complex numbers, got dtype", {"x": ["a", "b"]}),
        (ValueError, "x must have at least one dimension", {"x": 1.0}),
        (ValueError, "x must have at least one dimension", {"x": np.ma.masked}),
        (ValueError, "axis must be from -1 to 0 for 1 dimensions, got 1", {"axis": 1}),
        (TypeError, "axis must be an integer", {"axis": 0.0}),
        (ValueError, "order must be an integer of at least 1, got 0", {"order": 0}),
        (ValueError, "order must be an integer from 1 to 20, got 21", {"order": 21}),
        (TypeError, "order must be an integer, got 2.5", {"order": 2.5}),
        (ValueError, "local must be an integer of at least 20, got 19", {"local": 19}),
        (ValueError, "local must be an integer of at least 10, got 9", {"local": 9, "order": 1}),
        (TypeError, "local must be an integer, got True", {"local": True}),
        (ValueError, r"t must have shape \(9,\).*got \(8,\)", {"t": np.arange(8.0)}),
        (ValueError, r"t must have shape \(9,\).*got \(9, 1\)", {"t": np.ones((9, 1))}),
        (ValueError, "t must be finite, got nan", {"t": [0, 1, 2, np.nan, 4, 5, 6, 7, 8]}),
        (ValueError, "t must span a finite range", {"t": np.linspace(-1, 1, 9) * 1.7e308}),
        (
            ValueError,
            "strictly ascending or descending, got 2.0 and 2.0 at 2 and 3",
            {"t": [0, 1, 2, 2, 4, 5, 6, 7, 8]},
        ),
        (ValueError, "strictly ascending or descending, got 3.0 and 7.0 at 6", {"t": [9, 8, 7, 6, 5, 4, 3, 7, 8]}),
        (TypeError, "t must be real numbers, got dtype", {"t": np.arange("2020-01-01", "2020-01-10", dtype="M8[D]")}),
        (
            ValueError,
            r"weights must have shape \(9,\) or that of x, \(9,\), got \(1, 9\)",
            {"weights": np.ones((1, 9))},
        ),
        (ValueError, "weights must be finite and not negative, got -1.0", {"weights": -np.ones(9)}),
        (ValueError, "weights must be finite and not negative, got inf", {"weights": np.full(9, np.inf)}),
        (ValueError, "weights must be finite and not negative, got nan", {"weights": np.full(9, np.nan)}),
        (TypeError, "weights must be real numbers", {"weights": np.ones(9) * 1j}),
    ],
)
def test_refusals(kind: type[Exception], match: str, options: dict[str, Any]) -> None:
    with pytest.raises(kind, match=match):
        noise_level(**{"x": np.arange(9.0), **options})
