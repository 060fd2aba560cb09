"""Samples at times of their own: polynomials, a brute force, and what times may be."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import Differentiator, differentiate
from reference_fits import Array, Polynomial, Twin, assert_exact, assert_fits, by_order, random_words, twin
from support import EPS

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")

SINGLE = float(np.finfo(np.float32).eps)


def stamps(rng: np.random.Generator, n: int) -> Array:
    """Return n times: jittered, at random, in clusters, or with steps of all sizes; from 0 on or far from it."""
    kind = rng.integers(5)
    if kind == 0:
        t = np.arange(n) + rng.uniform(-0.4, 0.4, n)
    elif kind == 1:
        t = np.cumsum(rng.exponential(1, n) + 1e-3)
    elif kind == 2:
        t = np.cumsum(np.where(rng.random(n) < 0.2, rng.uniform(3, 20, n), rng.uniform(0.01, 0.1, n)))
    elif kind == 3:
        t = np.cumsum(10 ** rng.uniform(-2, 1, n))
    else:
        t = np.sort(rng.uniform(0, n, n)) + 1e-3 * np.arange(n)
    t *= 10.0 ** rng.integers(-3, 4)
    return np.asarray(t + rng.choice([0, 0, 1]) * 100 * np.ptp(t))


class Case:
    """A call with uneven times, and its twin, which sees times ascend."""

    def __init__(self, rng: np.random.Generator, t: Array | None = None) -> None:
        words = random_words(rng, several=True, longest=60)
        length, mode = words["window_length"], str(rng.choice(["fit", "fit", "nan", "valid"]))
        self.n = int(rng.integers(length, 3 * length + 10)) if t is None else len(t)
        self.t = stamps(rng, self.n) if t is None else t
        rounded = np.asarray if t is None else np.rint  # whole seconds, if times are
        kind = rng.choice(["samples", "at", "duration", "duration at"])
        words["mode"] = mode if kind == "samples" or mode != "valid" else "fit"
        span = float(np.ptp(self.t))
        if "at" in kind:
            words["at"] = rounded(rng.uniform(self.t[0], self.t[-1], 20))
            if kind == "at" and words["mode"] == "fit":  # and beyond the data, in the windows at the ends
                words["at"][:2] = self.t[0] - rounded(0.2 * (self.t[1] - self.t[0])), self.t[-1]
        self.words = dict(words)
        if "duration" in kind:
            del self.words["window_length"]
            self.words["window_duration"] = words["window_duration"] = float(rounded(span * rng.uniform(0.05, 0.9)))
            usual = float(np.median(np.diff(self.t)))
            words["window_length"] = max(round(words["window_duration"] / usual), words["degree"] + 1)
        elif words["mode"] == "fit" and rng.random() < 0.3:
            self.words["edge_window"] = words["edge_window"] = "shrink"
        if rng.random() < 0.3:
            self.words["max_gain"] = words["max_gain"] = float(rng.choice([1.5, 10.0, 1e6, np.inf]))
        if rng.random() < 0.3:
            most = 5 if "duration" in kind else min(5, words["window_length"] - words["degree"])
            self.words["min_support"] = words["min_support"] = words["degree"] + 1 + int(rng.integers(0, most))
        self.down = bool(rng.random() < 0.3)
        self.twin = twin(words, t=self.t)

    def run(self, x: Array, t: Any = None, **more: Any) -> algdiff.Estimates:
        """Return the results in ascending order, with a leading axis over the orders."""
        way = slice(None, None, -1) if self.down else slice(None)
        times = self.t if t is None else t
        found = differentiate(x[way], t=times[way], nan_policy="omit", **{**self.words, **more})
        if not isinstance(found, tuple):
            found = algdiff.Estimates(found)
        way = slice(None) if "at" in self.words else way
        parts = {name: part for name, part in found._asdict().items() if part is not None}
        support = parts.pop("support", None)
        parts = {name: by_order(part, self.twin)[:, way] for name, part in parts.items()}
        return algdiff.Estimates(**parts, support=None if support is None else support[way])


def some(rng: np.random.Generator, found: algdiff.Estimates, count: int) -> Any:
    outputs = found.estimate.shape[-1]
    return rng.choice(outputs, min(outputs, count), replace=False)


@pytest.mark.parametrize("block", range(9))
def test_polynomials_come_back_from_any_times(block: int) -> None:
    numbers = 0
    for seed in range(50):
        rng = np.random.default_rng([21, block, seed])
        case = Case(rng)
        dtype, eps = [(np.float64, EPS), (np.float64, EPS), (np.float32, SINGLE)][rng.integers(3)]
        p = Polynomial(rng, case.twin.degree, case.t)
        x = p(case.t).astype(dtype)
        x[rng.random(case.n) < rng.choice([0, 0.5]) * rng.random()] = np.nan
        found = case.run(x)
        assert found.estimate.dtype == dtype
        numbers += assert_exact(case.twin, x.astype(float), found.estimate, p, case.t, some(rng, found, 6), eps)
    assert numbers > 100


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("kind", ["datetime64", "timedelta64"])
def test_polynomials_come_back_across_a_leap_day(unit: str, kind: str) -> None:
    for seed in range(13):
        rng = np.random.default_rng([22, seed])
        n = int(rng.integers(60, 200))
        whole = (
            np.sort(rng.choice(4 * 86_400, n, replace=False)).astype("timedelta64[s]").astype(f"timedelta64[{unit}]")
        )
        start = np.datetime64("2024-02-27", unit)
        t = start + whole if kind == "datetime64" else whole
        seconds = (whole - whole[0]) / np.timedelta64(1, "s")
        case = Case(rng, seconds)
        p = Polynomial(rng, case.twin.degree, seconds)
        x = p(seconds).astype(float)
        x[rng.random(n) < 0.2 * rng.random()] = np.nan
        more: dict[str, Any] = {}
        if "at" in case.words:
            more["at"] = t[0] + case.words["at"].astype("timedelta64[s]")
        if "window_duration" in case.words:
            more["window_duration"] = np.timedelta64(round(case.words["window_duration"]), "s")
        found = case.run(x, t, **more)
        assert_exact(case.twin, x, found.estimate, p, seconds, some(rng, found, 6))


@pytest.mark.parametrize("block", range(12))
def test_equal_to_the_brute_force(block: int) -> None:
    numbers = 0
    for seed in range(20):
        rng = np.random.default_rng([23, block, seed])
        case, more = Case(rng), {}
        one = case.twin
        if rng.random() < 0.3:
            weights = np.where(rng.random(case.n) < 0.1, 0, rng.uniform(0.2, 5, case.n))
            more["weights"] = weights[::-1] if case.down else weights
            one = replace(one, weights=weights)
        x = rng.standard_normal(case.n)
        x[rng.random(case.n) < rng.choice([0, 0.5]) * rng.random()] = np.nan
        found = case.run(x, return_support=True, return_bias=True, **more)
        assert_fits(one, x, found, some(rng, found, 10), 1 + max(d.exactness for d in designs(one)))
        numbers += int(np.isfinite(found.estimate).sum())
    assert numbers > 200


def designs(one: Twin) -> list[Differentiator]:
    """Return the designs of the orders, of which the bias wants to know the exactness."""
    words: dict[str, Any] = {"degree": one.degree, "kappa": one.kappa, "mu": one.mu, "tau": one.tau}
    return [Differentiator(one.length, order, **words) for order in one.orders]


@pytest.mark.parametrize("mode", ["fit", "nan", "nearest", "mirror", "constant", "wrap"])
@pytest.mark.parametrize("edge_window", ["full", "shrink"])
def test_estimates_elsewhere_on_even_data_are_fits_on_the_nearest_window(mode: str, edge_window: str) -> None:
    rng = np.random.default_rng(24)
    x = rng.standard_normal(60)
    x[[20, 21]] = np.nan
    words: dict[str, Any] = {"window_length": 15, "deriv": (0, 1), "degree": 3, "kappa": 2.0, "mu": 1.0, "tau": 0.5}
    words |= {"delta": 0.1, "at": np.concatenate([rng.uniform(0, 5.9, 60), [-0.3, 0.05, 1.25, 6.2]]), "mode": mode}
    call: dict[str, Any] = {**words, "edge_window": edge_window, "nan_policy": "omit", "return_support": True}
    if mode not in ("fit", "nan") or (mode == "nan" and edge_window == "shrink"):
        with pytest.raises(ValueError, match="mode"):
            differentiate(x, **call)
        return
    assert_fits(twin(words, edge_window=edge_window), x, differentiate(x, **call), range(64))


# Times that are even.


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("mode", ["fit", "valid", "nan", "mirror"])
@pytest.mark.parametrize("tau", ["root", "newest", 0.3])
def test_even_times_are_a_step(tau: Any, mode: str, down: bool) -> None:
    x = np.random.default_rng(25).standard_normal((3, 90))
    x[0, 40:43] = np.nan
    way = slice(None, None, -1) if down else slice(None)
    for start, step in [(0.0, 0.1), (1e6, 0.1), (-3.0, 7.0), (0.0, 1e-9)]:
        for deriv, policy in [(1, "omit"), ((0, 1, 2), "propagate")]:
            kept = 0.9 if tau == "root" and deriv != 1 else tau
            call: dict[str, Any] = {"deriv": deriv, "tau": kept, "mode": mode, "nan_policy": policy}
            t = start + step * np.arange(90)
            found = differentiate(x[:, way], 15, t=t[way], **call)[..., way]
            exactly = float(np.ptp(t)) / 89
            np.testing.assert_allclose(found * exactly, differentiate(x, 15, delta=exactly, **call) * exactly, 1e-12)


def test_even_times_of_every_kind_are_recognised() -> None:
    x = np.random.default_rng(26).standard_normal(90)
    expected = differentiate(x, 15, delta=2.0)
    start = np.datetime64("2024-02-28T23:59", "s")
    for t in [
        2 * np.arange(90),
        (2 * np.arange(90)).astype(np.uint8),
        (2 * np.arange(90)).astype(np.float32),
        list(range(0, 180, 2)),
        start + 2 * np.arange(90),
        (start + 2 * np.arange(90)).astype("datetime64[ns]"),
        2000 * np.arange(90).astype("timedelta64[ms]"),
    ]:
        np.testing.assert_array_equal(differentiate(x, 15, t=t), expected)
    # By less than 1e-9 of a step, and by more.
    jitter = np.random.default_rng(27).uniform(-1, 1, 90)
    jitter[[0, -1]] = 0
    np.testing.assert_array_equal(differentiate(x, 15, t=2 * np.arange(90) + 9e-10 * jitter), expected)
    for size in (1e-7, 1e-3):
        found = differentiate(x, 15, t=2 * np.arange(90) + size * jitter)
        assert 0 < np.abs(found - expected)[8:-8].max() < 10 * size
    with pytest.raises(ValueError, match=r"^mode must be 'fit', 'nan' or 'valid' with uneven t"):
        differentiate(x, 15, t=2 * np.arange(90) + 1e-7 * jitter, mode="mirror")


@pytest.mark.parametrize(("unit", "even"), [("ns", True), ("us", False), ("ms", False)])
def test_dates_are_rounded_to_their_unit(unit: str, even: bool) -> None:
    """60 Hz in nanoseconds is even; coarser units are off by more than 1e-6 of a step, and are taken at their word."""
    x = np.random.default_rng(28).standard_normal(400)
    seconds = np.arange(400) / 60
    per_second = {"ns": 1e9, "us": 1e6, "ms": 1e3}[unit]
    t = np.datetime64("2024-02-28T12:00", unit) + np.rint(per_second * seconds).astype(f"timedelta64[{unit}]")
    found = differentiate(x, 15, t=t)
    same = np.array_equal(found, differentiate(x, 15, delta=float((t[-1] - t[0]) / np.timedelta64(1, "s")) / 399))
    assert same == even
    # One stamp that is off by two units is no rounding.
    t[200] += 2
    assert not np.array_equal(differentiate(x, 15, t=t), found)


@pytest.mark.parametrize("tau", ["center", "root", "newest", 0.3])
def test_a_duration_of_even_samples_is_a_number_of_samples(tau: Any) -> None:
    x, t = np.random.default_rng(28).standard_normal(80), np.arange(80) * 0.5
    expected = differentiate(x, 11, delta=0.5, tau=tau)
    close: dict[str, Any] = {"rtol": 0, "atol": 1e-12 * 50}
    for duration in (5.5, 5.3, 5.7):
        np.testing.assert_array_equal(differentiate(x, window_duration=duration, delta=0.5, tau=tau), expected)
        np.testing.assert_allclose(differentiate(x, window_duration=duration, t=t, tau=tau), expected, **close)
        for other in (5, 31):
            found = Differentiator(other, tau=tau)(x, t=t, window_duration=duration)
            np.testing.assert_allclose(found, expected, **close)
            found = Differentiator(other, tau=tau, delta=0.5)(x, window_duration=duration)
            np.testing.assert_allclose(found, expected, **close)


def test_a_delay_is_one_of_even_times_or_of_a_duration() -> None:
    rng = np.random.default_rng(29)
    x, even, t = rng.standard_normal(80), 0.5 * np.arange(80), np.cumsum(rng.uniform(0.2, 1, 80))
    close: dict[str, Any] = {"rtol": 0, "atol": 1e-10}
    found = differentiate(x, 11, t=even, delay=1.25)
    np.testing.assert_allclose(found, differentiate(x, 11, delta=0.5, delay=1.25), **close)
    with pytest.raises(ValueError, match=r"^delay must come with even t or with window_duration, got uneven t"):
        differentiate(x, 11, t=t, delay=1.25)
    found = differentiate(x, t=t, window_duration=8.0, delay=2.0)
    np.testing.assert_allclose(found, differentiate(x, t=t, window_duration=8.0, tau=0.75), **close)


def test_where_estimates_may_lie() -> None:
    rng = np.random.default_rng(30)
    t = np.cumsum(rng.uniform(0.2, 1, 80))
    at = np.array([t[0] - 0.7, t[40] + 0.01, t[-1] + 0.7, t[3]])  # in any order, beyond the data too
    for call in ({"window_length": 9}, {"window_duration": 6.0}):
        found = differentiate(t**2, t=t, at=at, **call)
        np.testing.assert_allclose(found, 2 * at, rtol=0, atol=1e-9)
        inside = differentiate(t**2, t=t, at=at, mode="nan", **call)
        np.testing.assert_array_equal(np.isnan(inside), [True, False, True, True])
        assert inside[1] == found[1]
        turned = differentiate(t[::-1] ** 2, t=t[::-1], at=at, **call)
        np.testing.assert_allclose(turned, found, rtol=0, atol=1e-9)
        columns = differentiate(np.stack([t**2, 3 * t**2], 1), t=t, at=at, axis=0, **call)
        np.testing.assert_array_equal(columns[:, 0], found)
        assert differentiate(t**2, t=t, at=[], **call).shape == (0,)
    start = np.datetime64("2024-02-28T12:00", "ns")
    dates = start + (t * 1e9).astype("timedelta64[ns]")
    seconds = (dates - start) / np.timedelta64(1, "s")
    wanted = np.array(["2024-02-28T12:00:20", "2024-02-28T12:00:30"], "datetime64[s]")
    found = differentiate(seconds**2, 9, t=dates, at=wanted)
    np.testing.assert_allclose(found, [40, 60], rtol=0, atol=1e-9)


NAT = np.array(["2024-01-01", "NaT", "2024-01-03"] + ["2024-02-01"] * 27, "datetime64[s]")


@pytest.mark.parametrize(
    ("error", "message", "options"),
    [
        (ValueError, r"^t must have one time for each of the 30 samples", {"t": np.arange(29.0)}),
        (ValueError, r"^t must have one time for each of the 30 samples", {"t": np.ones((30, 1))}),
        (
            ValueError,
            r"^t must be finite, and not too far apart, got nan at place 7",
            {"t": np.where(np.arange(30) == 7, np.nan, np.arange(30))},
        ),
        (ValueError, r"^t must be finite", {"t": np.where(np.arange(30) == 29, np.inf, np.arange(30))}),
        (ValueError, r"^t must be finite, and not too far apart, got NaT at place", {"t": NAT}),
        (ValueError, r"^t must be strictly monotone, got 7.0 followed by 7.0", {"t": np.r_[0.0:8, 7.0:29]}),
        (ValueError, r"^t must be strictly monotone, got 8.0 followed by 3.0", {"t": np.r_[0.0:9, 3.0, 10.0:30]}),
        (ValueError, r"^t must be strictly monotone, got -7.0 followed by -7.0", {"t": -np.r_[0.0:8, 7.0:29]}),
        (ValueError, r"^t must be strictly monotone", {"t": np.zeros(30)}),
        (TypeError, r"^t must hold real numbers or datetime64", {"t": np.arange(30) * 1j}),
        (TypeError, r"^t must hold real numbers or datetime64", {"t": np.arange(30).astype(str)}),
        (TypeError, r"^t must count in units of fixed length", {"t": np.arange(30).astype("timedelta64[M]")}),
        (TypeError, r"^t must have a unit", {"t": np.arange(30).astype("timedelta64")}),
        (ValueError, r"^give t, delta or fs", {"t": np.arange(30.0), "delta": 1.0}),
        (ValueError, r"^give t, delta or fs", {"t": np.arange(30.0), "fs": 1.0}),
        (ValueError, r"^at must be .*finite times", {"at": [1.0, np.nan]}),
        (ValueError, r"^at must be .*one-dimensional", {"at": [[1.0]]}),
        (ValueError, r"^at must be .*one-dimensional", {"at": 1.0}),
        (ValueError, r"^at must be .*finite", {"t": np.arange(30.0), "at": [np.inf]}),
        (TypeError, r"^at must be of the kind of t", {"t": np.arange(30).astype("datetime64[s]"), "at": [1.0]}),
        (TypeError, r"^at must be of the kind of t", {"t": np.arange(30.0), "at": np.array(["2024-01-01"], "M8[s]")}),
        (TypeError, r"^at must", {"at": np.array(["2024-01-01"], "M8[s]")}),
        (ValueError, r"^window_duration must be at most the", {"t": np.arange(30.0) ** 1.1, "window_duration": 1e3}),
        (ValueError, r"^window_(length|duration) must be at most", {"window_duration": 1e3}),
        (ValueError, r"^window_duration must be finite and positive", {"window_duration": 0.0}),
        (ValueError, r"^window_duration must be finite and positive", {"window_duration": np.nan}),
        (ValueError, r"^give window_length or window_duration", {"window_duration": 5.0, "window_length": 5}),
        (ValueError, r"^mode must be .* with at", {"at": [1.0], "mode": "valid"}),
        (ValueError, r"^rule must be 'exact' with uneven t", {"t": np.arange(30.0) ** 1.1, "rule": "midpoint"}),
        (ValueError, r"^trim must be 0 with uneven t", {"t": np.arange(30.0) ** 1.1, "trim": 0.01}),
    ],
)
def test_what_times_must_not_be(error: type[Exception], message: str, options: dict[str, Any]) -> None:
    call = options if "window_duration" in options or "window_length" in options else {"window_length": 5, **options}
    with pytest.raises(error, match=message):
        differentiate(np.arange(30.0), **call)
