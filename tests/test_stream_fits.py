"""What streams fit: windows that are still growing or miss samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from algdiff import Differentiator, Estimates, Stream
from streams import (
    CLOSE,
    SENT,
    Array,
    Lone,
    by_order,
    gaps,
    given,
    pushed,
    random_design,
    random_samples,
    same_bits,
    stamps,
    windows,
)
from support import design

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")


def limited(
    rng: np.random.Generator, x: Array, designs: list[Differentiator], *, gain: bool
) -> tuple[Array, dict[str, Any]]:
    """Return samples some of which are missing, and what may refuse a fit: the noise gain if it may."""
    limits: dict[str, Any] = {"nan_policy": "omit"}
    least, most = max(one.degree for one in designs) + 1, min(one.window_length for one in designs)
    if rng.random() < 0.3 and least <= most:
        limits["min_support"] = int(rng.integers(least, most + 1))
    limits["max_gain"] = float(rng.choice([1.5, 10, 1e6, np.inf])) if gain else np.inf
    if gain and rng.random() < 0.7:
        del limits["max_gain"]
    return gaps(rng, x, 20), limits


@pytest.mark.parametrize("block", range(6))
def test_equal_to_the_definition(block: int) -> None:
    numbers = 0
    for seed in range(50):
        rng = np.random.default_rng([1, block, seed])
        of, designs, delay, options = given(rng, 40)
        dtype, eps = [(np.float64, 0.0), (np.float64, 0.0), (np.float32, 1e-5)][rng.integers(3)]
        channels, n = [None, 1, 3][rng.integers(3)], int(rng.integers(1, 100))
        x = rng.standard_normal(n if channels is None else (n, channels)).astype(dtype)
        t = stamps(rng, n) if rng.random() < 0.5 else None
        times = designs[0].delta * np.arange(n) if t is None else t
        grow = bool(rng.random() < 0.7)
        limits: dict[str, Any] = {}
        if rng.random() < 0.5:
            x, limits = limited(rng, x, designs, gain=not grow and (t is None or delay is None))
        elif rng.random() < 0.3:
            x[rng.integers(n)] = np.nan
        stream = Stream(of, channels=channels, dtype=dtype, warmup="grow" if grow else "nan", **options, **limits)
        stream, found = pushed(stream, x, rng, t=t, longest=30, ways=list(SENT), return_std=True, return_support=True)
        orders = sum(len(one.orders) for one in designs)
        estimate, std = by_order(found.estimate, orders, x), by_order(found.std, orders, x)
        support, rows = by_order(found.support, len(designs), x), x.reshape(n, -1)
        omitted, first = limits.pop("nan_policy", None), 0
        for k, one in enumerate(designs):
            own = slice(first, first := first + len(one.orders))
            for i in {n - 1, *rng.integers(0, n, 8).tolist()}:
                start, channel = max(0, i + 1 - one.window_length), int(rng.integers(rows.shape[1]))
                seen, part = rows[start : i + 1, channel], (own, i, channel)
                lone = Lone(one, times[start : i + 1], delay, even=t is None)
                there = int((~np.isnan(seen)).sum())
                assert support[k, i, channel] == (there if grow or lone.full else 0)
                if not (grow or lone.full) or (not omitted and there < len(seen)):
                    assert np.isnan([estimate[part], std[part]]).all()
                else:
                    numbers += lone.assert_same(estimate[part], std[part], seen, eps, **limits)
        first_of = Lone(designs[0], times[-designs[0].window_length :], delay, even=t is None)
        least = max(2, designs[0].degree + 1) if grow else designs[0].window_length
        if min(n, designs[0].window_length) >= least:
            close = {"rel": 1e-9, "abs": 1e-9 * float(np.ptp(times) + abs(first_of.time))}
            assert stream.time == pytest.approx(first_of.time, **close)
            assert stream.delay == pytest.approx(times[-1] - first_of.time, **close)
    assert numbers > 400


# Growing windows.


@pytest.mark.parametrize("tau", ["center", "newest", "root", 0.3, 0.9, 1.1])
def test_growing_windows_are_those_of_shorter_designs(tau: Any) -> None:
    numbers = 0
    for seed in range(12):
        rng = np.random.default_rng([2, seed])
        one = random_design(rng, longest=60, exact=True, tau=tau, delay=None, **({"degree": 3} if seed < 2 else {}))
        channels = [None, 1, 3][rng.integers(3)]
        x = rng.standard_normal((one.window_length + 5, *([] if channels is None else [channels])))
        stream = one.stream(channels=channels, warmup="grow", sigma=2.0)
        _, found = pushed(stream, x, rng, longest=20, return_std=True, return_support=True)
        estimate, std = (by_order(part, len(one.orders), x) for part in found[:2])
        assert np.isnan(estimate[:, : one.degree]).all()
        for n in range(one.degree + 1, one.window_length):
            shorter = one.replace(window_length=n)
            weights = np.reshape(shorter.weights, (len(one.orders), n, 1))
            errors = np.abs(estimate[:, n - 1] - windows(shorter, x[:n])[:, -1].reshape(len(one.orders), -1))
            assert (errors <= CLOSE * np.abs(weights).sum(axis=1) * np.ptp(x)).all(), (one, n)
            norms = 2 * np.linalg.norm(weights, axis=1)
            np.testing.assert_allclose(std[:, n - 1], np.broadcast_to(norms, std[:, n - 1].shape), rtol=1e-9)
            numbers += 1
        same_bits(
            estimate[:, one.window_length - 1 :],
            by_order(windows(one, x), *estimate.shape[:1], x)[:, one.window_length - 1 :],
        )
        counts = np.minimum(np.arange(len(x)) + 1, one.window_length)
        np.testing.assert_array_equal(by_order(found.support, 1, x)[0].T, [counts] * estimate.shape[2])
    assert numbers > 100


@pytest.mark.parametrize("degree", [1, 3])
@pytest.mark.parametrize("times", [None, np.arange(13.0)])
def test_a_delay_at_a_root_is_none_of_growing_windows(times: Array | None, degree: int) -> None:
    # In the middle of the whole window one more degree is reproduced, and its weights are those of that degree.
    one = design(13, 1, degree=degree, delay=6.0)
    x = np.random.default_rng(9).standard_normal(13)
    found = one.stream(warmup="grow").push(x, times, return_std=True)
    for n in range(one.degree + 1, 13):
        Lone(one, np.arange(float(n)), 6.0, even=times is None).assert_same(
            found.estimate[None, n - 1], found.std[None, n - 1], x[:n], 0.0
        )


@pytest.mark.parametrize("words", [{"tau": "newest"}, {"tau": 0.5}, {"delay": 2.0}, {"delay": -1.0}])
def test_std_is_the_norm_of_what_impulses_give(words: dict[str, Any]) -> None:
    t = np.cumsum(np.random.default_rng(3).uniform(0.5, 2, 16))
    for times in (None, t):
        one = design(12, (0, 1, 2), degree=3, kappa=0.5, **words)
        stream = one.stream(channels=16, warmup="grow", sigma=3.0)  # an impulse at another time in every channel
        found, std, _, _ = stream.push(np.eye(16), t=times, return_std=True)
        np.testing.assert_array_equal(np.isnan(std), np.isnan(found))
        norms = 3 * np.linalg.norm(found, axis=2)
        np.testing.assert_allclose(std, np.broadcast_to(norms[..., None], std.shape), rtol=1e-9)
        np.testing.assert_array_equal(stream.std, std[:, -1])
        assert (stream.support == 12).all()


# Missing samples.


@pytest.mark.parametrize("block", range(4))
def test_gaps_as_in_whole_arrays(block: int) -> None:
    numbers = 0
    for seed in range(25):
        rng = np.random.default_rng([4, block, seed])
        one = random_design(rng, rule="exact")
        span = one.weights.shape[-1]
        channels, n = [None, 1, 4][rng.integers(3)], span + int(rng.integers(1, 150))
        x = random_samples(rng, n, channels, dtype := [np.float64, np.float32][rng.integers(2)])
        x = gaps(rng, x, 1 + span // 2)
        call: dict[str, Any] = {"nan_policy": "omit"}
        if rng.random() < 0.4:
            call["min_support"] = int(rng.integers(one.degree + 1, span + 1))
        if rng.random() < 0.4:
            call["max_gain"] = float(rng.choice([1.5, 10, 1e6, np.inf]))
        more: dict[str, Any] = {"return_std": True, "return_support": True}
        stream, found = pushed(
            one.stream(channels=channels, dtype=dtype, sigma=0.5, **call), x, rng, ways=list(SENT), **more
        )
        plain = pushed(one.stream(channels=channels, dtype=dtype, **call), x, rng)[1]
        same_bits(plain, found.estimate)
        wanted = one.replace(engine="direct")(x, axis=0, mode="valid", sigma=0.5, **call, **more)
        k = len(one.orders)
        valid = [by_order(part, c, x)[:, span - 1 :] for part, c in zip(found[:3], (k, k, 1), strict=True)]
        estimate, std = (np.reshape(part, valid[0].shape) for part in wanted[:2])
        there = sliding_window_view(~np.isnan(x.reshape(n, -1)), span, axis=0).sum(axis=-1)
        np.testing.assert_array_equal(valid[2][0], there)
        whole = np.broadcast_to(valid[2] == span, estimate.shape)
        same_bits(valid[0][whole], by_order(windows(one, x), k, x)[:, span - 1 :][whole])
        np.testing.assert_array_equal(np.isnan(valid[0])[~whole], np.isnan(estimate)[~whole])
        eps = CLOSE if dtype is np.float64 else 1e-6
        fitted = np.isfinite(estimate) & ~whole
        # The norm of the weights is the std; their sizes sum to at most sqrt(span) times that.
        size = 2 * std[fitted] * np.sqrt(span) * float(np.ptp(x[np.isfinite(x)]) if np.isfinite(x).any() else 0)
        errors = np.abs(valid[0][fitted] - estimate[fitted])
        assert (errors <= CLOSE * size + eps * np.abs(estimate[fitted])).all(), (one, seed)
        there = np.isfinite(estimate)
        # Whole arrays take samples out of the fit of the whole window, which costs digits.
        np.testing.assert_allclose(valid[1][there], std[there], rtol=max(eps, 1e-7))
        assert np.isnan(by_order(found.estimate, k, x)[:, : span - 1]).all()
        same_bits(np.ravel(np.asarray(stream.std, dtype)), valid[1][:, -1].ravel())
        np.testing.assert_array_equal(np.ravel(stream.support), valid[2][:, -1].ravel())
        numbers += int(fitted.sum())
    assert numbers > 1000


def test_raise_refuses_missing_samples_and_nothing_else() -> None:
    x = np.random.default_rng(5).standard_normal((40, 2))
    x[20, 0], x[30, 1] = np.inf, -np.inf
    one = design(7, (0, 1))
    for warmup in ("nan", "grow"):
        stream, plain = one.stream(channels=2, nan_policy="raise", warmup=warmup), one.stream(channels=2, warmup=warmup)
        bad = x.copy()
        bad[[15, 17], 0] = np.nan
        for start in (0, 3, 12):
            same_bits(stream.push(x[stream.count : start]), plain.push(x[plain.count : start]))
            before = stream.state
            for wrong in (bad[15], bad, np.ma.masked_array(x, np.isnan(bad)), bad[15].tolist()):
                gone = int(np.isnan(np.ma.filled(wrong, np.nan)).sum())
                for t in (None, *([] if start else [np.arange(len(wrong)) if np.ndim(wrong) == 2 else 0.5])):
                    with pytest.raises(ValueError, match=rf"^x must .*missing.*got '?{gone} of {np.size(wrong)}"):
                        stream.push(wrong, t)
            assert stream.state == before
        same_bits(np.stack([stream.push(sample) for sample in x[12:]], axis=1), plain.push(x[12:]))


def test_masked_samples_are_missing_ones() -> None:
    x = np.arange(20.0) ** 2
    mask = np.isin(np.arange(20), [3, 9, 10])
    for policy in ("omit", "propagate"):
        one = design(5, degree=2)
        wanted = one.stream(nan_policy=policy).push(np.where(mask, np.nan, x))
        same_bits(one.stream(nan_policy=policy).push(np.ma.masked_array(x, mask)), wanted)
        stream = one.stream(nan_policy=policy)
        found = [stream.push(np.ma.masked if gone else sample) for sample, gone in zip(x, mask, strict=True)]
        same_bits(np.array(found), wanted)
        whole = np.ma.masked_array(np.arange(20) ** 2, mask)
        same_bits(one.stream(nan_policy=policy).push(whole), wanted)


# Whatever the pieces.


@pytest.mark.parametrize("channels", [None, 1, 3, 17])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_any_pieces_give_the_bits_of_single_samples(dtype: Any, channels: int | None) -> None:
    for seed in range(12):
        rng = np.random.default_rng([8, seed])
        of, _, _, options = given(rng, 30)
        n = 150
        x = gaps(rng, random_samples(rng, n, channels, dtype), 10)
        t = stamps(rng, n) if rng.random() < 0.5 else None
        options |= {"warmup": str(rng.choice(["nan", "grow"])), "nan_policy": str(rng.choice(["omit", "propagate"]))}
        for more in ({}, {"return_std": True, "return_support": True}):
            stream = Stream(of, channels=channels, dtype=dtype, **options)
            singles = stream.copy()
            found = pushed(stream, x, rng, t=t, longest=80, ways=list(SENT), **more)[1]
            parts: list[Any] = [singles.push(x[i], **({} if t is None else {"t": t[i]}), **more) for i in range(n)]
            for k, part in enumerate(found[:3] if more else [found]):
                alone = [one[k] if more else one for one in parts]
                same_bits(part, np.stack(alone, axis=-1 if channels is None else -2).astype(part.dtype))
            block = Stream(of, channels=channels, dtype=dtype, **options).push(x, t, **more)
            same_bits(found.estimate if more else found, block.estimate if isinstance(block, Estimates) else block)
