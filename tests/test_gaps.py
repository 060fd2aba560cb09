"""Even samples some of which are missing: polynomials, a brute force, and what gaps must leave alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import Differentiator, differentiate
from reference_fits import Polynomial, assert_exact, assert_fits, by_order, random_words, twin
from support import EPS

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")

SINGLE = float(np.finfo(np.float32).eps)
MODES = ["fit", "fit", "nan", "valid", "nearest", "mirror", "wrap", "constant"]
INSIDE = MODES[:4]


def gaps(rng: np.random.Generator, n: int, run: int) -> np.ndarray[Any, Any]:
    """Return which of n samples are missing: some here and there, and runs of up to `run`."""
    gone = rng.random(n) < rng.uniform(0, 0.4)
    for _ in range(rng.integers(0, 3)):
        start = rng.integers(n)
        gone[start : start + rng.integers(1, run + 1)] = True
    return gone


def limits(rng: np.random.Generator, words: dict[str, Any]) -> dict[str, Any]:
    """Return what may refuse a fit, now and then."""
    some: dict[str, Any] = {}
    if rng.random() < 0.3:
        some["max_gain"] = float(rng.choice([1.5, 2.0, 10.0, 1e6, np.inf]))
    if rng.random() < 0.3:
        some["min_support"] = int(rng.integers(words["degree"] + 1, words["window_length"] + 1))
    return some


@pytest.mark.parametrize("block", range(10))
def test_polynomials_come_back_around_gaps(block: int) -> None:
    numbers = 0
    for seed in range(50):
        rng = np.random.default_rng([1, block, seed])
        words = random_words(rng, several=True) | {"mode": INSIDE[rng.integers(4)]}
        length, delta = words["window_length"], float(rng.choice([1.0, 0.01, 3.0]))
        n = int(rng.integers(length, 3 * length + 10))
        if words["mode"] == "fit" and rng.random() < 0.3:
            words["edge_window"] = "shrink"
        words |= limits(rng, words)
        t = delta * np.arange(n)
        p = Polynomial(rng, words["degree"], t)
        dtype, eps = [(np.float64, EPS), (np.float64, EPS), (np.float32, SINGLE)][rng.integers(3)]
        x = np.repeat(p(t)[:, None], 2, axis=1).astype(dtype)
        for row in range(2):
            x[gaps(rng, n, length // 2), row] = np.nan
        more = {"return_support": True} if rng.random() < 0.5 else {}  # estimates alone have a way of their own
        call: dict[str, Any] = {**words, **more, "delta": delta, "nan_policy": "omit", "axis": 0}
        found = differentiate(x, **call)
        estimate = found.estimate if more else found
        assert estimate.dtype == dtype
        one = twin(words, delta=delta)
        for row in range(2):
            rows = by_order(estimate[..., row], one)
            only = rng.choice(rows.shape[1], min(rows.shape[1], 5), replace=False)
            numbers += assert_exact(one, x[:, row].astype(float), rows, p, t, only, eps)
    assert numbers > 250


@pytest.mark.parametrize("block", range(12))
def test_equal_to_the_brute_force(block: int) -> None:
    numbers = 0
    for seed in range(20):
        rng = np.random.default_rng([2, block, seed])
        words = random_words(rng, several=True) | {"mode": MODES[rng.integers(8)]}
        words["delta"] = float(rng.choice([1.0, 0.01, 3.0]))
        length, extends = words["window_length"], words["mode"] not in INSIDE
        n = int(rng.integers(max(1, length // 3) if extends else length, 3 * length + 10))
        if words["mode"] == "constant":
            words["cval"] = float(rng.choice([np.nan, 2.0]))
        words |= limits(rng, words)
        if rng.random() < 0.3 and isinstance(words["deriv"], int) and length > 3 * words["degree"] + 8:
            words["trim"] = 0.03
            words.pop("min_support", None)
        elif words["mode"] == "fit" and rng.random() < 0.4:
            words["edge_window"] = "shrink"
        if rng.random() < 0.2:
            words["weights"] = np.where(rng.random(n) < 0.1, 0, rng.uniform(0.2, 5, n))
        x = rng.standard_normal(n)
        x[gaps(rng, n, length // 2)] = np.nan
        found = differentiate(x, nan_policy="omit", return_support=True, **words)
        outputs = found.estimate.shape[-1]
        only = rng.choice(outputs, min(outputs, 10), replace=False)
        numbers += assert_fits(twin(words), x, found, only)
    assert numbers > 100


@pytest.mark.parametrize("block", range(3))
def test_weights_of_rows_and_of_samples(block: int) -> None:
    for seed in range(10):
        rng = np.random.default_rng([3, block, seed])
        words = random_words(rng, longest=30)
        n = 2 * words["window_length"] + 5
        x, weights = rng.standard_normal((n, 3)), rng.uniform(0.2, 5, (n, 3))
        x[rng.random((n, 3)) < 0.1] = np.nan
        call: dict[str, Any] = {**words, "nan_policy": "omit", "axis": 0, "return_support": True}
        each, shared = differentiate(x, weights=weights, **call), differentiate(x, weights=weights[:, 1], **call)
        for row in range(3):
            for given, found in [(weights[:, row], each), (weights[:, 1], shared)]:
                part = algdiff.Estimates(found.estimate[:, row], support=found.support[:, row])
                assert_fits(twin(words, weights=given), x[:, row], part, rng.choice(n, 5, replace=False))


@pytest.mark.parametrize("trim", [0.0, 0.03])
@pytest.mark.parametrize("tau", ["center", "root", "newest", 0.3])
@pytest.mark.parametrize("mode", [*INSIDE[1:], "mirror"])
def test_bias_is_the_difference_from_the_next_degree_that_counts(mode: str, tau: Any, trim: float) -> None:
    rng = np.random.default_rng([4, INSIDE.index(mode) if mode in INSIDE else 9])
    words: dict[str, Any] = {"window_length": 25, "deriv": 1, "degree": 3, "kappa": 2.5, "mu": 2.0, "tau": tau}
    words |= {"mode": mode, "trim": trim}
    x = rng.standard_normal(70)
    x[[20, 21, 55]] = np.nan
    found = differentiate(x, nan_policy="omit", return_bias=True, **words)
    beyond = 1 + Differentiator(**{name: words[name] for name in words if name != "mode"}).exactness
    assert_fits(twin(words), x, found, range(found.estimate.size), beyond)


# What gaps leave alone.


@pytest.mark.parametrize("mode", sorted(set(MODES)))
@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.complex128])
@pytest.mark.parametrize("length", [5, 61, 501])
def test_only_windows_that_touch_a_gap_change(length: int, dtype: Any, mode: str) -> None:
    rng = np.random.default_rng([5, length])
    x = rng.standard_normal((2, 2400)).astype(dtype)
    design = Differentiator(length, (0, 1), degree=2, tau=0.6)

    def plain(x: np.ndarray[Any, Any]) -> Any:  # complex data as two real passes: engines round those in their own way
        parts = [design(np.ascontiguousarray(part), mode=mode) for part in (x.real, x.imag)]
        return parts[0] + 1j * parts[1] if dtype is np.complex128 else parts[0]

    whole = plain(x)
    np.testing.assert_array_equal(design(x, mode=mode, nan_policy="omit"), whole)
    np.testing.assert_array_equal(design(x, mode=mode, nan_policy="omit", return_support=True).estimate, whole)
    x[0, [0, 1100, 1101, 2000]] = x[1, 1300:1310] = complex(np.nan, np.nan) if dtype is np.complex128 else np.nan
    spread = plain(x)
    touched = np.isnan(spread)
    for found in [
        design(x, mode=mode, nan_policy="omit"),
        design(x, mode=mode, nan_policy="omit", return_support=True),
    ]:
        estimate = found.estimate if isinstance(found, algdiff.Estimates) else found
        assert estimate.dtype == np.dtype(dtype)
        np.testing.assert_array_equal(estimate[~touched], spread[~touched])
        if mode == "nan":
            ends = np.isnan(whole)
            assert np.isnan(estimate[ends]).all()
            touched &= ~ends
        assert np.isfinite(estimate[touched]).mean() > (0.9 if length > 5 else 0.2)
        assert (estimate[touched] != whole[touched]).any()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("length", [7, 61, 501, 2001])
def test_many_fits_at_once_equal_single_fits(length: int, dtype: Any, axis: int) -> None:
    rng = np.random.default_rng([6, length, axis])
    n, rows = 3 * length + 100, 9 if length < 2000 else 3
    x = 1e3 + rng.standard_normal((n, rows)).astype(dtype)
    for row in range(rows):  # gaps of each row its own, and as long as part of a window
        start = int(rng.integers(n))
        x[start : start + int(rng.integers(1, length // 2)), row] = np.nan
    x[rng.random((n, rows)) < 3 / length] = np.nan
    x = np.ascontiguousarray(x if axis == 0 else x.T)
    lost = 1e-12 if dtype is np.float64 else 4 * SINGLE
    several: list[dict[str, Any]] = [{}, {"kappa": 0.0, "mu": 2.5, "tau": 0.8}, {"deriv": (0, 1, 2), "degree": 3}]
    for options, mode in [(several[0], "fit"), (several[0], "valid"), (several[1], "fit"), (several[2], "nan")]:
        design = Differentiator(length, **options)
        many = design(x, axis, mode=mode, nan_policy="omit")
        single = design(x, axis, mode=mode, nan_policy="omit", return_support=True).estimate
        np.testing.assert_array_equal(np.isnan(many), np.isnan(single))
        for one, a, b in zip(
            design.orders, *(part if len(design.orders) > 1 else [part] for part in (many, single)), strict=True
        ):
            # At the newest end weights are largest, and gaps may raise the gain a hundredfold, and so |w| tenfold.
            scale = 10 * float(np.abs(one.replace(tau="newest").weights).sum())
            allowed = lost * (5 * scale + np.abs(b))  # the samples lie within 5 of an offset, of which no fit knows
            assert (np.abs(a - b) <= allowed)[np.isfinite(a)].all(), np.nanmax(np.abs(a - b) / allowed)


@pytest.mark.parametrize("more", [{}, {"return_support": True, "return_std": True, "sigma": 1.0, "return_bias": True}])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_any_number_of_threads_gives_the_same_bits(dtype: Any, more: dict[str, Any]) -> None:
    rng = np.random.default_rng(7)
    x = rng.standard_normal((3, 5000)).astype(dtype)
    x[rng.random(x.shape) < 0.05] = np.nan
    for axis, t in [(1, None), (0, None), (1, np.cumsum(rng.uniform(0.5, 2, 5000)))]:
        given = x if axis == 1 else np.ascontiguousarray(x.T)
        call: dict[str, Any] = {"axis": axis, "t": t, "nan_policy": "omit", **more}
        one, many = (differentiate(given, 51, threads=threads, **call) for threads in (1, 4))
        for a, b in zip(one if more else [one], many if more else [many], strict=True):
            np.testing.assert_array_equal(a, b)


# Which windows give an estimate.


def test_windows_of_too_few_samples_give_none() -> None:
    x = np.random.default_rng(8).standard_normal(40)
    x[17:22] = np.nan
    found = differentiate(x, 9, degree=3, nan_policy="omit", return_support=True, max_gain=np.inf)
    assert found.support[19] == 4
    assert np.isfinite(found.estimate).all()
    for least in (5, 9):
        call: dict[str, Any] = {"degree": 3, "nan_policy": "omit", "min_support": least, "max_gain": np.inf}
        limited = differentiate(x, 9, return_support=True, **call)
        np.testing.assert_array_equal(limited.support, found.support)
        np.testing.assert_array_equal(limited.estimate, np.where(found.support >= least, found.estimate, np.nan))
        np.testing.assert_array_equal(np.isnan(differentiate(x, 9, **call)), found.support < least)


def test_a_constant_beyond_the_data_may_be_missing_whether_samples_are_or_not() -> None:
    x = np.random.default_rng(22).standard_normal(40)
    gone = np.where(np.arange(40) == 35, np.nan, x)
    for more in ({}, {"return_support": True}):
        call: dict[str, Any] = {"mode": "constant", "cval": np.nan, "nan_policy": "omit", **more}
        found, other = ((part.estimate if more else part) for part in (differentiate(y, 9, **call) for y in (x, gone)))
        np.testing.assert_array_equal(np.isnan(found[:4]), np.isnan(other[:4]))
        assert np.isfinite(found[4:-4]).all()


def test_fits_that_gaps_make_noisy_give_none() -> None:
    x = np.random.default_rng(10).standard_normal(60)
    x[28:38] = np.nan
    words: dict[str, Any] = {"window_length": 15, "deriv": 1, "degree": 3, "kappa": 1.0, "mu": 1.0, "tau": "center"}
    call: dict[str, Any] = {"degree": 3, "nan_policy": "omit", "return_support": True}
    one, free = twin(words, max_gain=1.0), differentiate(x, 15, max_gain=np.inf, **call).estimate
    windows = one.windows(60)
    gains = np.array([one.output(x, window).gain[0] for window in windows if window is not None])
    assert 100 < np.nanmax(gains) < np.inf
    for limit in (None, 1.5, 20.0):
        refused = gains > (100 if limit is None else limit)
        assert refused.any()
        found = differentiate(x, 15, max_gain=limit, **call).estimate
        np.testing.assert_allclose(found, np.where(refused, np.nan, free), rtol=0, atol=1e-12 * np.nanmax(np.abs(free)))
        found = differentiate(x, 15, degree=3, nan_policy="omit", max_gain=limit)
        np.testing.assert_array_equal(np.isnan(found), refused)


def test_an_order_that_is_refused_or_hard_does_not_cost_the_others() -> None:
    x = np.arange(40.0) ** 2
    x[[20, 22, 23]] = np.nan
    for orders in [(0, 1, 2), (1, 0, 2), (2, 1, 0)]:
        many, single = differentiate(x, 7, orders, degree=3, nan_policy="omit"), []
        for order in orders:
            single.append(differentiate(x, 7, order, degree=3, nan_policy="omit"))
        np.testing.assert_array_equal(np.isnan(many), np.isnan(single))
        np.testing.assert_allclose(many, single, rtol=0, atol=1e-9)  # of samples up to 1521, and |w| up to 20


@pytest.mark.parametrize("tau", ["center", 0.3, "newest"])
def test_the_shortest_windows_are_those_of_the_outermost_samples(tau: Any) -> None:
    x = np.random.default_rng(11).standard_normal(60)
    for length, degree in [(21, 2), (21, 4), (25, 5)]:
        least = 2 * degree + 1
        call: dict[str, Any] = {"degree": degree, "tau": tau}
        found = differentiate(x, length, edge_window="shrink", return_support=True, **call)
        # Where not even the shortest window fits around a sample, it is the first or the last one.
        point = Differentiator(length, **call).tau
        oldest, newest = int(point * least + 1e-9), least - int(point * least + 1e-9) - 1
        first, last = differentiate(x[:least], least, **call), differentiate(x[-least:], least, **call)
        close = 1e-12 * 5 * float(np.abs(Differentiator(least, degree=degree, tau="newest").weights).sum())
        if oldest:
            assert (found.support[:oldest] == least).all()
            np.testing.assert_allclose(found.estimate[:oldest], first[:oldest], rtol=0, atol=close)
        if newest:
            assert (found.support[-newest:] == least).all()
            np.testing.assert_allclose(found.estimate[-newest:], last[-newest:], rtol=0, atol=close)


@pytest.mark.parametrize("tau", ["center", "root", "newest"])
def test_what_else_is_asked_for_does_not_change_the_estimates(tau: str) -> None:
    x = np.random.default_rng(12).standard_normal(80)
    x[[40, 41]] = np.nan
    design = Differentiator(21, kappa=2.0, tau=tau)
    plain = design(x, nan_policy="omit")
    asked: list[dict[str, Any]] = [{"sigma": 2.0}, {"sigma": np.full(80, 2.0)}, {"autocovariance": [4.0, 1.0]}, {}]
    for more in asked:
        found = design(x, nan_policy="omit", return_std=True, return_bias=True, return_support=True, **more)
        # What is asked for may be computed in another way, but is the same fit.
        np.testing.assert_allclose(found.estimate, plain, rtol=0, atol=1e-12 * np.abs(design.weights).sum() * 50)


@pytest.mark.parametrize("exponent", [-0.5, -0.9, -0.99])
@pytest.mark.parametrize("length", [10, 30, 57])
def test_the_weight_of_the_outermost_samples_is_not_left_to_rounding(length: int, exponent: float) -> None:
    # Their cell ends where the window does, and the mean of s^e over it hangs on where exactly that is: a rounding of
    # 1e-17 would change it by 1e-17^(1 + e), which is 2% of it for e = -0.9.
    x = np.random.default_rng(13).standard_normal(4 * length)
    x[2 * length] = np.nan
    for name in ("kappa", "mu"):
        words: dict[str, Any] = {"window_length": length, "deriv": 1, "degree": 2, "kappa": 0.5, "mu": 0.5, "tau": 0.4}
        words[name] = exponent
        for more in ({}, {"weights": np.ones(4 * length)}):
            found = differentiate(x, nan_policy="omit", return_support=True, **words, **more)
            assert_fits(twin(words, **more), x, found, range(0, 4 * length, 3))


# Arrays as they come.


def test_masked_samples_are_missing_ones() -> None:
    rng = np.random.default_rng(14)
    x = rng.standard_normal((3, 50))
    mask = rng.random((3, 50)) < 0.1
    x[mask] = 1e300  # what lies under a mask is no number
    gone = np.where(mask, np.nan, x)
    for given in (np.ma.masked_array(x, mask), np.ma.masked_array(gone, mask), np.ma.masked_invalid(gone)):
        before, held = given.data.copy(), np.ma.getmaskarray(given).copy()
        for policy in ("omit", "propagate"):
            for more in ({}, {"mode": "valid"}, {"deriv": (0, 1)}, {"t": np.cumsum(rng.uniform(1, 2, 50))}):
                call: dict[str, Any] = {"nan_policy": policy, **more}
                found, wanted = differentiate(given, 9, **call), differentiate(gone, 9, **call)
                assert isinstance(found, np.ma.MaskedArray)
                assert type(wanted) is np.ndarray
                np.testing.assert_array_equal(found.data, wanted)
                np.testing.assert_array_equal(found.mask, np.isnan(wanted))
                assert policy == "omit" or found.mask.sum() >= mask[:, 4:-4].sum()
        np.testing.assert_array_equal(given.data, before)
        np.testing.assert_array_equal(np.ma.getmaskarray(given), held)
    found = differentiate(np.ma.masked_array(x, mask), 9, min_support=9, nan_policy="omit", return_std=True, sigma=1.0)
    wanted = differentiate(gone, 9, min_support=9, nan_policy="omit", return_std=True, sigma=1.0)
    for a, b in [(found.estimate, wanted.estimate), (found.std, wanted.std)]:
        assert isinstance(a, np.ma.MaskedArray)
        np.testing.assert_array_equal(a.mask, np.isnan(wanted.estimate))
        np.testing.assert_array_equal(a.data, b)


@pytest.mark.parametrize("dtype", [np.int8, np.uint16, np.int64, bool, np.float32, np.float16])
def test_masked_samples_of_every_dtype(dtype: Any) -> None:
    rng = np.random.default_rng(15)
    x = rng.integers(0, 100, 50).astype(dtype)
    mask = rng.random(50) < 0.1
    found = differentiate(np.ma.masked_array(x, mask), 9, nan_policy="omit")
    wanted = differentiate(
        np.where(mask, np.nan, x).astype(np.float32 if dtype is np.float32 else float), 9, nan_policy="omit"
    )
    assert found.dtype == wanted.dtype == (np.float32 if dtype is np.float32 else np.float64)
    np.testing.assert_array_equal(found.data, wanted)
    assert not np.ma.is_masked(found)
    with pytest.raises(ValueError, match=rf"^x must hold no missing samples .*got {mask.sum()} of 50"):
        differentiate(np.ma.masked_array(x, mask), 9, nan_policy="raise")


def test_raise_refuses_missing_samples_and_nothing_else() -> None:
    x = np.random.default_rng(16).standard_normal((2, 40))
    np.testing.assert_array_equal(differentiate(x, 9, nan_policy="raise"), differentiate(x, 9))
    x[0, 3] = np.inf
    np.testing.assert_array_equal(differentiate(x, 9, nan_policy="raise"), differentiate(x, 9))
    x[1, [5, 7]] = np.nan
    with pytest.raises(ValueError, match=r"^x must hold no missing samples with nan_policy = 'raise', got 2 of 80"):
        differentiate(x, 9, nan_policy="raise")
    for message, words in [
        (r"^nan_policy must be 'propagate', 'omit' or 'raise', got 'drop'", {"nan_policy": "drop"}),
        (r"^min_support must be .*at least 4", {"nan_policy": "omit", "min_support": 3}),
        (r"^min_support must be at most the 9 samples of a window, got 10", {"min_support": 10}),
        (r"^max_gain must be at least 1, got 0.5", {"nan_policy": "omit", "max_gain": 0.5}),
        (r"^max_gain must be at least 1, got nan", {"nan_policy": "omit", "max_gain": np.nan}),
        (r"^rule must be 'exact' with nan_policy = 'omit'", {"nan_policy": "omit", "rule": "midpoint"}),
    ]:
        with pytest.raises(ValueError, match=message):
            differentiate(x, 9, **words)


def test_what_is_infinite_is_not_missing() -> None:
    x = np.random.default_rng(17).standard_normal(60)
    x[[20, 22, 45]] = np.nan
    wanted = differentiate(x, 9, nan_policy="omit")
    for value in (np.inf, -np.inf):
        x[[0, 30, 44]] = value
        touched = np.zeros(60, bool)
        touched[:5] = touched[26:35] = touched[40:49] = True
        for more in ({}, {"return_support": True}):
            found = differentiate(x, 9, nan_policy="omit", **more)
            found = found.estimate if more else found
            assert not np.isfinite(found[touched]).any()
            np.testing.assert_allclose(found[~touched], wanted[~touched], rtol=0, atol=1e-12)


def test_rows_without_a_sample() -> None:
    x = np.random.default_rng(18).standard_normal((3, 40))
    x[1] = np.nan
    alone = differentiate(x[0], 9, nan_policy="omit")
    for more in ({}, {"return_support": True}):
        found = differentiate(x, 9, nan_policy="omit", **more)
        np.testing.assert_array_equal((found.estimate if more else found)[0], alone)
        assert np.isnan((found.estimate if more else found)[1]).all()
    assert (found.support[1] == 0).all()


def test_arrays_in_every_layout() -> None:
    plain = np.random.default_rng(19).standard_normal((40, 40))
    plain[np.random.default_rng(20).random((40, 40)) < 0.1] = np.nan
    read_only = plain.copy()
    read_only.flags.writeable = False
    views = {
        "Fortran order": np.asfortranarray(plain),
        "strided": np.repeat(np.repeat(plain, 2, 0), 3, 1)[::2, ::3],
        "negative strides": plain[::-1, ::-1].copy()[::-1, ::-1],
        "big endian": plain.astype(">f8"),
        "long double": plain.astype(np.longdouble),
        "read-only": read_only,
        "nested lists": plain.tolist(),
        "matrix": plain.view(np.matrix),
    }
    for axis in (0, 1, -2):
        for more in ({}, {"return_support": True}):
            rows = [differentiate(row, 9, nan_policy="omit") for row in np.moveaxis(plain, axis, -1)]
            wanted = np.moveaxis(np.array(rows), -1, axis)
            for name, x in views.items():
                found = differentiate(x, 9, axis=axis, nan_policy="omit", **more)
                found = found.estimate if more else found
                np.testing.assert_array_equal(np.isnan(found), np.isnan(wanted), err_msg=name)
                np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12, err_msg=name)
                np.testing.assert_array_equal(np.asarray(x, float), plain, err_msg=name)


def test_results_go_where_they_are_wanted() -> None:
    x = np.random.default_rng(21).standard_normal((30, 4))
    x[[3, 4, 20], [0, 1, 2]] = np.nan
    for deriv, more in [(1, {}), ((0, 1), {}), (1, {"return_support": True}), (1, {"mode": "valid"})]:
        wanted = differentiate(x, 9, deriv, axis=0, nan_policy="omit", **more)
        expected = wanted.estimate if isinstance(wanted, algdiff.Estimates) else wanted
        out = np.zeros((*expected.shape[:-1], 8))[..., ::2]
        found = differentiate(x, 9, deriv, axis=0, nan_policy="omit", out=out, **more)
        assert (found.estimate if isinstance(found, algdiff.Estimates) else found) is out
        np.testing.assert_array_equal(out, expected)
    masked = differentiate(np.ma.masked_invalid(x), 9, axis=0, nan_policy="omit", out=np.zeros((30, 4)))
    np.testing.assert_array_equal(masked.data, differentiate(x, 9, axis=0, nan_policy="omit"))
    for out, error in [(np.zeros((30, 3)), ValueError), (np.zeros((30, 4), np.float32), TypeError), (x, ValueError)]:
        before = x.copy()
        with pytest.raises(error, match=r"^out"):
            differentiate(x, 9, axis=0, nan_policy="omit", out=out)
        np.testing.assert_array_equal(x, before)
