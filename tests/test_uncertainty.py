"""Error bars: the standard deviation, the support and the bias indicator of every estimate."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import algdiff
from support import EPS, conditioning, design

N, L, DEGREE = 61, 15, 3
GAP = np.isin(np.arange(N), (0, 7, 20, 21, 22, 23, 35, 58, 60))
UNEVEN = np.cumsum(np.random.default_rng(61).uniform(0.6, 1.4, N)) * 0.1
SIGMA = np.random.default_rng(62).uniform(0.5, 2.0, N)
TIMES = np.sort(np.random.default_rng(63).uniform(UNEVEN[0], UNEVEN[-1], 40))

# What a call makes of unit impulses are its weights, and must agree with its errors.
CALLS: dict[str, dict[str, Any]] = {
    "fit": {},
    "nan": {"mode": "nan"},
    "valid": {"mode": "valid"},
    "shrink": {"edge_window": "shrink"},
    "nearest": {"mode": "nearest"},
    "mirror": {"mode": "mirror"},
    "wrap": {"mode": "wrap"},
    "constant": {"mode": "constant"},
    "t": {"t": UNEVEN},
    "t-backwards": {"t": -UNEVEN},
    "t-nan": {"t": UNEVEN, "mode": "nan"},
    "t-valid": {"t": UNEVEN, "mode": "valid"},
    "t-shrink": {"t": UNEVEN, "edge_window": "shrink"},
    "duration": {"t": UNEVEN, "window_duration": 1.6},
    "duration-even": {"window_duration": 1.7},
    "at": {"t": UNEVEN, "at": TIMES},
    "at-even": {"at": TIMES - UNEVEN[0]},
    "weights": {"weights": SIGMA},
    "weights-t": {"weights": SIGMA, "t": UNEVEN},
    "period": {"period": 10.0},
    "max-gain": {"max_gain": 4.0},
}
GAPS_ALLOWED = ("nearest", "mirror", "wrap", "constant")


def impulses(one: algdiff.Differentiator, gap: np.ndarray | None = None, **call: Any) -> algdiff.Estimates:
    """Return what is made of unit impulses, one a column: the estimates are the weights."""
    x = np.eye(N)
    if gap is not None:
        x[gap] = np.nan
        call["nan_policy"] = "omit"
    found: algdiff.Estimates = one(x, 0, return_std=True, return_support=True, **call)
    return found


def bound(length: int = L, degree: int = DEGREE, eps: float = EPS) -> float:
    """Return by what share the norm of weights found twice may differ.

    A fit errs by the condition number of its basis times eps, on weights whose windows are at worst a quarter full
    here (which costs that basis less than another 100); sums of `length` products by `length` eps more.
    """
    return 100 * (conditioning(length, degree, 1, 1) + length) * eps


def check(found: algdiff.Estimates, expected: np.ndarray, rtol: float) -> None:
    """Compare the standard deviations, the same for every impulse, with what they must be."""
    std = found.std
    assert std is not None
    missing = np.isnan(found.estimate).all(axis=-1)
    assert (np.isnan(std) == missing[..., None]).all()
    there = ~missing
    assert there.any()
    # Weights that add up to zero, of samples that are repeated, leave the rounding of those of other estimates.
    atol = rtol * expected.max(axis=-1, keepdims=True)
    assert (np.abs(std - expected[..., None]) <= np.maximum(rtol * expected, atol)[..., None])[there].all()


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize(
    ("length", "deriv", "tau"),
    [(L, (0, 1, 2), "center"), (L, (0, 1, 2), "newest"), (L, (0, 1, 2), 0.3), (L, 1, "root"), (12, (0, 1), "center")],
)
def test_std_is_the_norm_of_the_weights(length: int, deriv: Any, tau: float | str, name: str, gaps: bool) -> None:
    call = CALLS[name]
    one = design(length, deriv, degree=DEGREE, tau=tau, delta=0.1)
    found = impulses(one, GAP if gaps else None, sigma=0.25, **call)
    weights = np.nan_to_num(found.estimate)
    check(found, 0.25 * np.linalg.norm(weights, axis=-1), bound())
    # Missing samples take no part, the support counts the others; a weight may vanish by symmetry.
    weights = weights.reshape(-1, *weights.shape[-2:])
    missing = np.isnan(found.estimate.reshape(weights.shape)[0]).all(axis=-1)
    assert found.support is not None
    used = np.abs(weights[0]) > bound() * np.abs(weights[0]).max()
    assert (found.support[~missing, 0] >= used.sum(axis=-1)[~missing]).all()
    if gaps:
        assert not weights[..., GAP].any()
        assert (found.support[~missing] < L + 3).all()
    # Levels of the noise, one or many, change errors and nothing else.
    varied = impulses(one, GAP if gaps else None, sigma=SIGMA, **call)
    np.testing.assert_allclose(varied.estimate, found.estimate, rtol=0, atol=bound() * np.nanmax(np.abs(weights)))
    check(varied, np.linalg.norm(np.nan_to_num(found.estimate) * SIGMA, axis=-1), bound())


def test_std_counts_a_repeated_sample_once_and_a_constant_never() -> None:
    one = design(L, 1, degree=DEGREE, tau="newest")
    nearest = impulses(one, mode="nearest", sigma=1.0)
    # The oldest window holds the first sample 15 times: its derivative is 0, whatever the noise.
    assert nearest.std is not None
    assert np.abs(nearest.std[0]).max() <= bound() * np.linalg.norm(one.weights)
    constant = impulses(one, mode="constant", sigma=1.0, cval=5.0)
    assert constant.std is not None
    np.testing.assert_allclose(constant.std[0], abs(one.weights[-1]), rtol=bound())


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("name", ["fit", "nan", "valid", "shrink", "t", "duration", "at", "weights"])
def test_std_of_correlated_noise(name: str, gaps: bool) -> None:
    one = design(L, (0, 1), degree=DEGREE, tau=0.6, delta=0.1)
    # Moving averages of white noise: covariances of 0 to 3 samples apart, none beyond.
    covariance = np.correlate([1.0, 2.0, -1.0, 0.5], [1.0, 2.0, -1.0, 0.5], "full")[3:]
    lag = np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    gamma = np.append(covariance, np.zeros(N))[np.minimum(lag, 4)]
    found = impulses(one, GAP if gaps else None, autocovariance=covariance, **CALLS[name])
    weights = np.nan_to_num(found.estimate)
    variance = np.einsum("...j,jk,...k->...", weights, gamma, weights)
    # The variance is a sum of products of which the largest are those of the norm: cancellation costs their ratio.
    worst = np.max(np.sum(np.abs(weights), axis=-1) ** 2 * covariance[0] / np.where(variance > 0, variance, np.inf))
    check(found, np.sqrt(variance), bound() * worst)


@pytest.mark.parametrize("name", ["fit", "wrap", "t", "shrink"])
def test_std_of_rows_that_miss_different_samples(name: str) -> None:
    gone = np.random.default_rng(64).random((4, N)) < 0.15
    one = design(L, 1, degree=DEGREE, delta=0.1)
    x = np.broadcast_to(np.eye(N), (4, N, N)).copy()
    x[np.broadcast_to(gone[:, :, None], x.shape)] = np.nan
    sigma = np.broadcast_to(np.random.default_rng(65).uniform(0.5, 2, (4, N, 1)), x.shape)
    found = one(x, 1, nan_policy="omit", return_std=True, sigma=sigma, **CALLS[name])
    expected = np.linalg.norm(np.nan_to_num(found.estimate) * sigma[..., 0][:, None], axis=-1)
    check(found, expected, bound())
    turned = one(
        np.moveaxis(x, 1, -1), nan_policy="omit", return_std=True, sigma=np.moveaxis(sigma, 1, -1), **CALLS[name]
    )
    np.testing.assert_allclose(np.moveaxis(turned.std, -1, 1), found.std, rtol=bound())


@pytest.mark.parametrize("name", ["fit", "mirror", "t"])
def test_std_of_complex_and_of_single_precision(name: str) -> None:
    one = design(L, (0, 1), degree=DEGREE, delta=0.1)
    real = impulses(one, GAP, sigma=0.5, **CALLS[name])
    x = np.where(GAP[:, None], np.nan, np.eye(N))
    call: dict[str, Any] = {"nan_policy": "omit", "return_std": True, "sigma": 0.5, **CALLS[name]}
    turned = one((0.6 + 0.8j) * x, 0, **call)
    # Noise of level 0.5 in both parts together: |estimate| has the error of a real one.
    assert turned.std.dtype == np.float64
    np.testing.assert_allclose(turned.std, real.std, rtol=bound())
    single = one(x.astype(np.float32), 0, **call)
    assert single.std.dtype == single.estimate.dtype == np.float32
    np.testing.assert_allclose(single.std, real.std, rtol=2 * float(np.finfo(np.float32).eps))


# Coverage. Of every row only estimates are counted whose windows have no sample in common, so that given the level they
# are independent: 10,000 of them cover 95 % with a standard error of sqrt(0.95 * 0.05 / 10,000) = 0.22 %. A level from
# n = 180 samples errs by sqrt(1.27 / 180) = 8.4 %, which takes 0.88 / 2 * 0.084^2 = 0.3 % off the coverage, its bias of
# half the squared error 0.1 %, and the five estimates of a row share it: the standard error grows by less than a tenth.
# The bound of 2 % is 7 standard errors away.
ROW, WIDE, PLACES = 180, 21, np.array([12, 45, 90, 135, 165])


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("where", ["interior", "gaps", "ends", "uneven", "uneven-gaps", "duration", "weights"])
def test_intervals_cover_the_truth(where: str, known: bool) -> None:
    rng = np.random.default_rng([66, len(where), known])
    rows = 5000 if where == "ends" else 2000
    places = np.array([0, ROW - 1]) if where == "ends" else PLACES
    t = np.cumsum(rng.uniform(0.5, 1.5, ROW)) if where.startswith(("uneven", "duration")) else np.arange(ROW) * 1.0
    coefficients = rng.standard_normal((rows, DEGREE + 1))
    level = rng.uniform(0.1, 10.0, (rows, 1))
    powers = (t / ROW) ** np.arange(DEGREE + 1)[:, None]
    slopes = np.arange(DEGREE + 1)[:, None] * (t / ROW) ** np.maximum(np.arange(DEGREE + 1) - 1, 0)[:, None] / ROW
    call: dict[str, Any] = {"t": t} if t[1] != 1 else {}
    share = rng.uniform(0.3, 3.0, ROW) if where == "weights" else np.ones(ROW)
    if where == "weights":
        call["weights"] = share
    if where == "duration":
        call["window_duration"] = 21.0
    x = coefficients @ powers + level * rng.standard_normal((rows, ROW)) / np.sqrt(share)
    if where.endswith("gaps"):
        x[rng.random(x.shape) < 0.15] = np.nan
        call["nan_policy"] = "omit"
    sigma = np.broadcast_to(level / np.sqrt(share), x.shape) if known else None
    found = algdiff.differentiate(
        x, None if where == "duration" else WIDE, 1, degree=DEGREE, return_std=True, sigma=sigma, **call
    )
    error = (found.estimate - coefficients @ slopes)[:, places]
    inside = np.abs(error) <= 1.96 * found.std[:, places]
    counted = ~np.isnan(error)
    assert counted.sum() >= 9_990
    coverage = inside[counted].mean()
    print(f"coverage {where} known={known}: {coverage:.4f} of {counted.sum()}")
    assert 0.93 <= coverage <= 0.97


@pytest.mark.parametrize("call", ["even", "t", "gaps", "ends", "newest"])
@pytest.mark.parametrize("deriv", [0, 1, 2])
def test_bias_indicator_tells_the_error_of_small_windows(call: str, deriv: int) -> None:
    # exp is its own derivative. Of a window of duration T the error is C T^p exp and the indicator misses it by the
    # error of the next degree, a share O(T) of it: halving the step at least nearly halves the miss.
    misses = []
    for delta in (0.02, 0.01):
        t = delta * (np.arange(N) if call != "t" else UNEVEN * 10)
        x = np.exp(t)
        options: dict[str, Any] = {"delta": delta} if call != "t" else {"t": t}
        if call == "gaps":
            x[GAP] = np.nan
            options["nan_policy"] = "omit"
        tau = "newest" if call == "newest" else "center"
        found = algdiff.differentiate(x, L, deriv, degree=2, tau=tau, return_bias=True, **options)
        error = found.estimate - np.exp(t)
        some = slice(None) if call == "ends" else slice(L, -L)
        # Where the error of the leading order vanishes on the way from one sign to the other, there is nothing to tell.
        large = np.abs(error[some]) > 0.3 * np.median(np.abs(error[some]))
        assert large.mean() > 0.7
        misses.append(np.abs(found.bias[some] / error[some] - 1)[large].max())
    assert misses[1] <= 0.2
    assert misses[1] <= 0.65 * misses[0]


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("tau", ["center", "newest", 0.3, "root"])
@pytest.mark.parametrize(
    "name", ["fit", "nan", "valid", "shrink", "mirror", "t", "t-valid", "duration", "at", "weights"]
)
def test_bias_indicator_is_the_distance_to_the_next_degree(name: str, tau: float | str, gaps: bool) -> None:
    x = np.where(GAP & gaps, np.nan, np.random.default_rng(69).standard_normal(N))
    call = {**CALLS[name], "nan_policy": "omit", "max_gain": 1e300, "return_std": True, "sigma": 1.0}
    if name == "shrink":
        call["min_support"] = 2 * DEGREE + 1
    one = design(L, 1, degree=DEGREE, tau=tau, delta=0.1)
    # The next degree at the same point of the same window: a word might be another point for it.
    further = design(L, 1, degree=one.exactness + 1, tau=one.tau, delta=0.1)(x, **call)
    if name == "shrink":
        # Windows of another degree would shrink to another length.
        whole = ~np.isnan(one(x * 0, mode="nan", nan_policy="omit"))
    else:
        whole = np.ones(further.estimate.shape, bool)
    found = one(x, return_bias=True, **call)
    both = whole & ~np.isnan(found.bias) & ~np.isnan(further.estimate)
    assert both.sum() > 20
    # Where the data are mirrored, the noise of an estimate may vanish, but not its rounding.
    size = np.maximum(found.std, one.noise_gain**0.5) + further.std
    error = 100 * conditioning(L, DEGREE + 2, 1, 1) * EPS * np.sqrt(L) * np.nanmax(np.abs(x)) * size
    assert (np.abs(found.estimate - further.estimate - found.bias) <= error)[both].all()


@pytest.mark.parametrize("name", ["fit", "nan", "valid", "shrink", "t", "duration", "at", "weights"])
def test_bias_indicator_is_zero_on_polynomials(name: str) -> None:
    one = design(L, (0, 1), degree=DEGREE, delta=0.1, tau=0.4)
    t = UNEVEN if "t" in CALLS[name] else UNEVEN[0] + 0.1 * np.arange(N)
    x = (t - 3) ** 3 - t
    found = one(
        np.where(GAP, np.nan, x), nan_policy="omit", return_bias=True, return_std=True, sigma=1.0, **CALLS[name]
    )
    there = ~np.isnan(found.bias)
    assert there.mean() > 0.5
    # Weights of both fits round by their condition number, and meet samples of this size.
    rounding = 100 * conditioning(L, DEGREE + 1, 1, 1) * EPS * np.sqrt(L) * np.abs(x).max()
    assert (np.abs(found.bias) <= 10 * rounding * found.std)[there].all()


def test_bias_indicator_does_not_warn_of_a_degree_nobody_asked_for() -> None:
    # Degree 4 is modest for 9 samples, degree 6 is not.
    assert algdiff.differentiate(np.zeros(N), 9, 1, degree=4, return_bias=True).bias.shape == (N,)


def test_no_bias_indicator_where_the_next_degree_does_not_fit() -> None:
    x = np.random.default_rng(67).standard_normal(N)
    short = algdiff.differentiate(x, 4, 1, degree=1, tau=0.3, return_bias=True)
    assert not np.isnan(short.bias).any()
    one = design(5, 1, degree=4, tau=0.3)
    whole = one(x, return_bias=True)
    assert np.isnan(whole.bias).all()
    assert not np.isnan(whole.estimate).any()
    wide = design(L, 1, degree=DEGREE, tau=0.3)
    few = np.where(np.isin(np.arange(N), range(20, 35)) & ~np.isin(np.arange(N), (20, 24, 30, 34)), np.nan, x)
    found = wide(few, nan_policy="omit", return_bias=True, return_support=True, max_gain=1e6)
    # With tau = 0.3 the window of sample 24 begins at sample 20, and holds four.
    assert found.support[24] == DEGREE + 1
    assert not np.isnan(found.estimate[24])
    assert np.isnan(found.bias[24])
    assert not np.isnan(found.bias[40])


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.complex128])
@pytest.mark.parametrize("name", ["fit", "t", "weights", "masked", "weights-masked"])
def test_the_noise_level_of_every_row_is_the_default(name: str, dtype: type) -> None:
    rng = np.random.default_rng(68)
    noise = rng.standard_normal((2, N, 3)) * [0.1, 1.0, 10.0]
    x = (noise[0] + 1j * noise[1] if dtype is np.complex128 else noise[0]).astype(dtype)
    call = dict(CALLS.get(name.removesuffix("-masked"), {}))
    if name.endswith("masked"):
        x = np.ma.MaskedArray(x, rng.random(x.shape) < 0.1)
        call["nan_policy"] = "omit"
    one = design(L, 1, degree=DEGREE, delta=0.1)
    level = algdiff.noise_level(x, axis=0, t=call.get("t"), weights=call.get("weights"))
    share = np.sqrt(call.get("weights", np.ones(N)))
    found = one(x, 0, return_std=True, **call)
    given = one(x, 0, return_std=True, sigma=np.ones((N, 1)) / share[:, None] * level, **call)
    assert isinstance(found.std, np.ma.MaskedArray) == name.endswith("masked")
    rtol = bound(eps=float(np.finfo(dtype).eps)) if dtype is np.float64 else 8 * float(np.finfo(np.float32).eps)
    assert (np.ma.getmaskarray(found.std) == np.ma.getmaskarray(found.estimate)).all()
    np.testing.assert_allclose(np.ma.filled(found.std, -1), np.ma.filled(given.std, -1), rtol=rtol)
    sizes = np.abs(np.ma.getdata(x)).max(axis=0) * np.linalg.norm(one.weights) * 10
    assert (np.ma.abs(found.estimate - given.estimate) <= rtol * L * sizes).all()
    assert (np.abs(np.log(np.median(np.ma.filled(found.std, 1), axis=0) / level)) < np.log(20)).all()
