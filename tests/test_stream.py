"""Estimates sample by sample: to the bit what whole arrays give, whatever pieces they come in and wherever they go."""

from __future__ import annotations

import json
import pickle
from typing import Any

import numpy as np
import pytest

import algdiff
import reference
from algdiff import Differentiator, Stream
from streams import SENT, pushed, random_design, random_samples, same_bits, windows
from support import EPS, Case, case_id, design, golden

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")

CHANNELS = (None, None, None, 1, 2, 3, 5, 17, 40)


def case(rng: np.random.Generator) -> tuple[Any, list[Differentiator], dict[str, Any]]:
    """Return what a stream is of, the designs that say what it must give, and its delay if it is given."""
    first = random_design(rng)
    if rng.random() < 0.7:
        given: Any = first
    else:
        words: dict[str, Any] = {"delta": first.delta, "delay": first.delay, "tau": None}
        given = [first, *(random_design(rng, **words) for _ in range(rng.integers(0, 3)))]
        given = tuple(given) if rng.random() < 0.5 else given
    designs = list(given) if isinstance(given, (list, tuple)) else [first]
    if rng.random() < 0.3 and all(one.trim == 0 for one in designs):  # designs take a delay or a trim, not both
        delay = float(rng.choice([0.0, -1.0, 2.5]) * first.delta)
        return given, [one.replace(delay=delay) for one in designs], {"delay": delay}
    return given, designs, {}


@pytest.mark.parametrize("block", range(10))
def test_equal_to_whole_arrays_to_the_bit(block: int) -> None:
    numbers = 0
    for seed in range(100):
        rng = np.random.default_rng([1, block, seed])
        given, designs, options = case(rng)
        channels, dtype = CHANNELS[rng.integers(len(CHANNELS))], [np.float64, np.float32][rng.integers(2)]
        n = int(np.exp(rng.uniform(0, np.log(5000 if (channels or 1) < 17 else 1000))))
        x = random_samples(rng, n, channels, dtype)
        stream = Stream(given, channels=channels, dtype=dtype, **options)
        stream, found = pushed(stream, x, rng, ways=list(SENT))
        wanted = np.concatenate([windows(one, x) for one in designs])
        leading = isinstance(given, (list, tuple)) or isinstance(given.deriv, tuple)
        same_bits(found, wanted if leading else wanted[0])
        numbers += int(np.isfinite(found).sum())
        longest = max(one.weights.shape[-1] for one in designs)
        assert (stream.count, stream.ready) == (n, n >= longest)
        assert stream.delay == pytest.approx(designs[0].delay, rel=1e-9, abs=1e-9 * designs[0].delta)
        time = (n - 1) * designs[0].delta - stream.delay if n >= designs[0].weights.shape[-1] else np.nan
        assert stream.time == pytest.approx(time, rel=1e-12, nan_ok=True)
    assert numbers > 50_000


def test_what_comes_back() -> None:
    one, several = design(3, 1, degree=1), design(3, (0, 1), degree=1)
    for given, lead in [(one, ()), (several, (2,)), ([one], (1,)), ([several, one, one], (4,))]:
        for dtype in (np.float64, np.float32):
            for channels in (None, 1, 2):
                sample = () if channels is None else (channels,)
                stream = Stream(given, channels=channels, dtype=dtype)
                for many in [(), (), (), (4,), (0,)]:
                    found = stream.push(np.ones((*many, *sample)))
                    assert np.shape(found) == (*lead, *many, *sample)
                    shape = (*lead, *many, *sample)
                    assert type(found) is (np.ndarray if shape else float)
                    assert not shape or found.dtype == dtype
                    more = stream.push(np.ones((*many, *sample)), return_std=True, return_support=True)
                    counted = (*([len(given)] if isinstance(given, list) else []), *many, *sample)
                    assert [np.shape(part) for part in more[:3]] == [shape, shape, counted]
                    assert type(more.estimate) is type(more.std) is type(found)
                    assert type(more.support) is (np.ndarray if counted else int)
                    assert more.bias is None
                    assert stream.push(np.ones((*many, *sample)), return_std=True).support is None
                    assert stream.push(np.ones((*many, *sample)), return_support=True).std is None
                assert np.shape(stream.std) == (*lead, *sample)
                assert np.shape(stream.support) == (*([len(given)] if isinstance(given, list) else []), *sample)


@pytest.mark.parametrize("case", golden("streaming.json"), ids=case_id)
def test_golden_values(case: Case) -> None:
    length, first = case["L"], case["first_output_index"]
    delta = case["T"] / (length if case["method"] in reference.CELLS else length - 1)
    words: dict[str, Any] = {"kappa": case["kappa"], "mu": case["mu"], "tau": case["tau1"], "rule": case["method"]}
    stream = Differentiator(length, case["n"], degree=case["N"], delta=delta, **words).stream()
    found = [stream.push(sample) for sample in case["y"]]
    assert np.isnan(found[:first]).all()
    atol = 1e-12 * np.abs(case["out"]).max()
    np.testing.assert_allclose(found[first:], case["out"], rtol=0, atol=atol)
    assert stream.delay == pytest.approx(case["delay_samples"] * case["Ts"], rel=1e-12, abs=1e-15)
    assert stream.time == pytest.approx((len(case["y"]) - 1 - case["delay_samples"]) * case["Ts"], rel=1e-12)
    block = Differentiator(length, case["n"], degree=case["N"], delta=delta, **words).stream().push(case["y"])
    np.testing.assert_array_equal(block, found)


@pytest.mark.parametrize("engine", ["moments", "fft"])
def test_blocks_by_another_engine_agree_to_rounding(engine: str) -> None:
    rng = np.random.default_rng(2)
    one = design(101, (0, 1, 2), degree=3, tau="newest", engine=engine)
    x = rng.standard_normal((5000, 2))
    stream, found = pushed(one.stream(channels=2), x, rng, ways=["pickle", "JSON"], longest=3000)
    wanted = windows(one, x)
    scale = np.abs(one.weights).sum(axis=1)[:, None, None] * np.abs(x).max()
    np.testing.assert_array_equal(np.isnan(found), np.isnan(wanted))
    assert np.nanmax(np.abs(found - wanted) / scale) < 101 * EPS
    assert (found != wanted)[~np.isnan(wanted)].any()  # it was that engine
    same_bits(stream.push(x[0]), windows(one, np.concatenate([x, x[:1]]))[:, -1])


# What a stream tells, forgets and keeps.


def test_attributes() -> None:
    one, other = design(7, (0, 1), degree=2, delta=0.5), design(11, 2, degree=2, delta=0.5, delay=1.5)
    stream = Stream([one, other], channels=3, dtype="f4", warmup="grow", nan_policy="omit", min_support=5, sigma=2.0)
    assert (stream.design, stream.channels, stream.dtype) == ((one, other), 3, np.dtype(np.float32))
    assert (stream.warmup, stream.nan_policy) == ("grow", "omit")
    assert one.stream().design is one
    assert one.stream(delay=0.0).design == one.replace(delay=0.0)
    for stream in (one.stream(), one.stream(delay=0.25), Stream([one, other])):
        first = stream.design if isinstance(stream.design, Differentiator) else stream.design[0]
        assert (stream.count, stream.ready, stream.delay) == (0, False, first.delay)
        assert np.isnan(stream.time)
        for count in range(1, 13):
            stream.push(1.0)
            assert (stream.count, stream.delay) == (count, first.delay)
            time = 0.5 * (count - 1) - first.delay if count >= 7 else np.nan
            assert stream.time == pytest.approx(time, abs=1e-12, nan_ok=True)
            assert stream.ready == (count >= (11 if isinstance(stream.design, tuple) else 7))
    for name in ("count", "design", "channels", "dtype", "warmup", "nan_policy", "delay", "time"):
        with pytest.raises(AttributeError):
            setattr(stream, name, getattr(stream, name))


def test_reset_forgets_all() -> None:
    x = np.random.default_rng(3).standard_normal(30)
    for words in ({}, {"warmup": "grow"}, {"nan_policy": "omit"}):
        stream = design(5, (0, 1)).stream(**words)
        fresh = stream.push(x)
        stream.push(np.nan)
        stream.reset()
        assert (stream.count, stream.ready) == (0, False)
        assert np.isnan(stream.time)
        same_bits(stream.push(x), fresh)
        stream.reset()
        stream.push(x, t=np.arange(30) ** 1.1)  # a clock of its own now
        stream.reset()
        same_bits(np.stack([stream.push(sample) for sample in x], axis=1), fresh)


@pytest.mark.parametrize("way", SENT)
def test_streams_go_on_elsewhere_on_their_own(way: str) -> None:
    x = np.random.default_rng(4).standard_normal(60)
    for words in (
        {},
        {"dtype": np.float32, "threads": 1, "sigma": 0.1},
        {"delay": -1.0, "warmup": "grow", "nan_policy": "omit", "max_gain": 5.0, "min_support": 4},
        {"warmup": "grow", "nan_policy": "omit", "max_gain": np.inf},
    ):
        for given in (design(9, (1, 0), tau=0.7), [design(5, tau="newest"), design(9, tau="newest")]):
            for n in (0, 3, 30):
                stream = Stream(given, **words)
                stream.push(x[:n])
                before = repr(stream), stream.count, stream.delay
                other = SENT[way](stream)
                assert type(other) is Stream
                assert (repr(other), other.count, other.delay, other.design) == (*before, stream.design)
                same_bits(np.asarray(other.std), np.asarray(stream.std))
                np.testing.assert_array_equal(other.time, stream.time)
                found = other.push(x[n:])
                assert (stream.count, other.count) == (n, 60)
                same_bits(found, stream.push(x[n:]))


def test_a_state_may_be_put_back() -> None:
    x = np.random.default_rng(5).standard_normal((40, 2)).astype(np.float32)
    x[3], x[5, 1] = np.nan, -np.inf
    stream = design(9, (0, 1)).stream(channels=2, dtype=np.float32)
    stream.push(x[:12])
    state = stream.state
    text = json.dumps(state, allow_nan=False)
    after = stream.push(x[12:])
    assert json.dumps(state, allow_nan=False) == text  # a state does not follow its stream
    for put in (state, json.loads(text)):
        stream.state = put
        assert (stream.count, json.dumps(stream.state)) == (12, text)
        same_bits(stream.push(x[12:]), after)
    for wrong in (design(9, 1), design(9, (0, 1), tau=0.4)):
        with pytest.raises(ValueError, match=r"^state must be of a stream with the same (design|options)"):
            wrong.stream(channels=2, dtype=np.float32).state = state
    with pytest.raises(ValueError, match=r"^state must be of a stream with the same options"):
        design(9, (0, 1)).stream(channels=2).state = state
    assert (stream.count, stream.ready) == (40, True)


def test_a_stream_with_times_goes_on_from_its_state() -> None:
    rng = np.random.default_rng(6)
    x, t = rng.standard_normal(40), 1e6 + np.cumsum(rng.uniform(0.1, 2, 40))
    for n in (2, 30):
        stream = design(9, 2, delay=0.5).stream(warmup="grow")
        stream.push(x[:n], t=t[:n])
        others = [way(stream) for way in SENT.values()]
        after = stream.push(x[n:], t=t[n:])
        for other in others:
            with pytest.raises(ValueError, match=r"^t must be"):
                other.push(1.0)
            with pytest.raises(ValueError, match=r"^t must be"):
                other.push(1.0, t=t[n - 1])
            same_bits(other.push(x[n:], t=t[n:]), after)
            assert other.time == stream.time == pytest.approx(t[-1] - 0.5)


def test_a_subclass_stays_one() -> None:
    class Mine(Stream):
        __slots__ = ()

    stream = Mine(Differentiator(5))
    stream.push([1.0, 2.0])
    assert type(stream.copy()) is type(Mine.from_state(stream.state)) is Mine
    assert isinstance(algdiff.Differentiator(5).stream(), Stream)
    assert pickle.loads(pickle.dumps(Differentiator(5).stream())).count == 0  # noqa: S301


def test_packets_need_not_be_aligned() -> None:
    packet = b"\x01" + np.arange(8.0).tobytes()
    x = np.frombuffer(packet, np.float64, offset=1)
    for channels, block, sample in ((None, x, x[:1]), (2, x.reshape(4, 2), x[:2])):
        one, other = (Differentiator(2, degree=1).stream(channels=channels) for _ in range(2))
        same_bits(one.push(block), other.push(block.copy()))
        same_bits(one.push(sample), other.push(sample.copy()))


def test_a_state_may_name_the_same_design_in_other_words() -> None:
    one = Differentiator(5, degree=2, delta=0.1, tau="newest").stream(threads=1)
    other = Differentiator(5, degree=2, fs=10, delay=0).stream(sigma=2.0)
    one.push([1.0, 2.0, 4.0, 7.0])
    other.state = one.state
    assert other.push(9.0) == one.push(9.0)
