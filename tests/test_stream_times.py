"""Streams of samples at times of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from algdiff import Stream
from streams import CLOSE, SENT, by_order, gaps, pushed, random_design, same_bits, stamps
from support import design

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")


@pytest.mark.parametrize("block", range(3))
def test_times_as_with_whole_arrays(block: int) -> None:
    numbers = 0
    for seed in range(25):
        rng = np.random.default_rng([6, block, seed])
        tau = ["center", "newest", "root", 0.3, 0.9, 1.1][rng.integers(6)]
        one = random_design(rng, longest=60, exact=True, tau=tau, delay=None)
        length, k = one.window_length, len(one.orders)
        channels, n = [None, 2][rng.integers(2)], max(length, 2) + int(rng.integers(1, 100))
        x, t = rng.standard_normal(n if channels is None else (n, channels)), stamps(rng, n)
        call: dict[str, Any] = {"nan_policy": str(rng.choice(["omit", "propagate"]))}
        if call["nan_policy"] == "omit":
            x = gaps(rng, x, 1 + length // 2)
            call["max_gain"] = [None, 2.0, np.inf][rng.integers(3)]
        more = {"return_std": True, "return_support": True}
        stream = one.stream(channels=channels, **call, sigma=2.0)
        found = pushed(stream, x, rng, t=t, longest=50, ways=list(SENT), **more)[1]
        wanted = one(x, axis=0, t=t, mode="valid", sigma=2.0, **call, **more)
        estimate, std = (by_order(part, k, x)[:, length - 1 :] for part in found[:2])
        value, error = (np.reshape(part, estimate.shape) for part in wanted[:2])
        np.testing.assert_array_equal(np.isnan(estimate), np.isnan(value))
        there = ~np.isnan(value)
        np.testing.assert_allclose(std[there], error[there], rtol=1e-9)
        allowed = CLOSE * (error * np.sqrt(length) * np.nanmax(np.abs(x)))
        assert (np.abs(estimate - value) <= allowed)[there].all(), one
        np.testing.assert_array_equal(found.support[length - 1 :], wanted.support)
        numbers += int(there.sum())
    assert numbers > 1000


def test_all_samples_have_times_or_none() -> None:
    x, t = np.random.default_rng(7).standard_normal(30), 5 + np.arange(30.0) ** 1.1
    one = design(5, (0, 1), delay=1.0)
    even, uneven = one.stream(), one.stream(warmup="grow")
    even.push(x[:9])
    uneven.push(x[:9], t[:9])
    assert uneven.time == t[8] - 1.0
    calls: list[tuple[Stream, Any, Any]] = [(even, 1.0, 9.0), (even, [1.0], [9.0]), (even, 1, 9), (uneven, 1.0, None)]
    calls += [(uneven, [1.0], None), (uneven, 1, None)]
    for late in (t[8], t[7], -np.inf, np.nan, np.inf):
        calls += [(uneven, 1.0, late), (uneven, [1.0], [late]), (uneven, [1.0, 2.0], [t[9], late])]
    calls += [(uneven, [1.0, 2.0], [t[10], t[9]]), (uneven, [1.0, 2.0], [t[9]]), (uneven, 1.0, [t[9]])]
    calls += [(uneven, [1.0, 2.0], t[9]), (uneven, [1.0, 2.0], [[t[9], t[10]]])]
    for stream, sample, time in calls:
        before = stream.state, stream.time
        with pytest.raises(ValueError, match=r"^t must"):
            stream.push(sample, time)
        assert (stream.state, stream.time) == before
    for wrong in ("noon", 1j, np.datetime64("2024-01-01"), None):
        with pytest.raises((TypeError, ValueError), match=r"^t must"):
            uneven.push(1.0, t=wrong)
    for stream, times in [(even, {}), (uneven, {"t": t[9:]})]:
        fresh = one.stream(warmup=stream.warmup)
        whole = fresh.push(x, **({"t": t} if times else {}))
        same_bits(stream.push(x[9:], **times), whole[:, 9:])


@pytest.mark.parametrize("words", [{"rule": "midpoint"}, {"rule": "hat"}, {"trim": 0.01}])
def test_times_need_a_fit(words: dict[str, Any]) -> None:
    stream = design(25, **words).stream()
    name = next(iter(words))
    for sample, time in [(1.0, 0.5), (1, 0.5), ([1.0], [0.5])]:
        with pytest.raises(ValueError, match=rf"^{name} must be .* with time stamps, got"):
            stream.push(sample, t=time)
    assert stream.count == 0
    with pytest.raises(ValueError, match=rf"^{name} must be .* with warmup = 'grow', got"):
        design(25, **words).stream(warmup="grow")
