"""Properties of what is said of designs, kernels, noise, choices and units, and of mistakes."""

from __future__ import annotations

import math
import pickle
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import algdiff
from algdiff import Differentiator, _units
from engines import assert_within
from properties import RULES, Array, Made, close, designs, examples, off, samples
from reference import CELLS, NODES
from support import EPS, kernel_rule

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")


# What is known of a design.


@examples(25)
@given(designs(longest=40, rules=RULES))
def test_what_a_design_says_of_its_weights(made: Made) -> None:
    d, w = made.d, made.d.weights
    assert d.noise_gain == pytest.approx(float(w @ w), rel=len(w) * EPS)
    assert d.norm1 == pytest.approx(float(np.abs(w).sum()), rel=len(w) * EPS)
    assert d.delay == pytest.approx(d.delay_samples * d.delta, rel=4 * EPS)
    assert d.duration == pytest.approx(d.delta * (d.window_length - (d.rule in NODES)), rel=4 * EPS)
    f = np.linspace(-0.5, 0.5, 7) / d.delta
    # Not of `delay_samples`, which is whole where the estimate lies within 1e-9 of a sample.
    lag = np.arange(len(w)) - (d.tau * len(w) - 0.5 if d.rule in CELLS else d.tau * (len(w) - 1))
    response = np.exp(2j * np.pi * d.delta * f[:, None] * lag) @ w
    # Phases of up to pi times the lag, each known to some eps of itself.
    allowed = 64 * EPS * d.norm1 * (len(w) + float(np.abs(lag).max()))
    close(np.asarray(d.frequency_response(f)), response, allowed)
    assert abs(d.frequency_response(0.0) - w.sum()) <= allowed
    if d.rule == "exact":
        assert abs(d.frequency_response(0.0) - (d.deriv == 0)) <= allowed + 64 * EPS * d.norm1
    impulse = d.impulse_response(np.arange(len(w)) * d.delta)
    np.testing.assert_array_equal(impulse, w[::-1])


@examples(25)
@given(designs(longest=40, deriv=0, least=2), st.data())
def test_the_delay_is_that_of_a_ramp(made: Made, data: st.DataObject) -> None:
    d = made.d
    assume(d.degree >= 1)
    t = d.delta * (np.arange(d.window_length + 9) + data.draw(st.integers(-50, 50)))
    late = t[d.window_length - 1 :] - d(t, mode="valid")
    np.testing.assert_allclose(
        late, d.delay, rtol=0, atol=float(off(made, t).max()) + 64 * EPS * d.norm1 * np.abs(t).max()
    )


@examples(25)
@given(st.integers(0, 4), st.integers(0, 4), st.floats(-0.8, 10), st.floats(-0.8, 10), st.floats(-0.2, 1.2))
def test_the_moments_of_kernels_are_derivatives(deriv: int, extra: int, kappa: float, mu: float, tau: float) -> None:
    kernel = algdiff.Kernel(deriv, deriv + extra, kappa, mu, tau)
    points, masses = kernel_rule(kernel)
    for power in range(kernel.exactness + 1):
        wanted = math.perm(power, deriv) * kernel.tau ** (power - deriv) if power >= deriv else 0.0
        # 60 values of the kernel, known to some eps of the largest of each of its terms, and of its density.
        cost = 1 + abs(math.lgamma(kappa + mu + 2)) + kappa + mu + 1 / (1 + kappa) + 1 / (1 + mu)
        assert_within(
            np.array([masses @ points**power]), np.array([wanted]), 256 * EPS * cost * float(np.abs(masses).sum())
        )
    assert kernel.norm1 == pytest.approx(float(np.abs(masses).sum()), rel=0.2)
    assert kernel.norm1 <= math.sqrt(kernel.norm2) * (1 + 1e-12)


@examples(25)
@given(designs(rules=RULES, longest=40), st.sampled_from(["auto", "direct", "fft"]))
def test_designs_come_back_from_their_names_and_from_pickles(made: Made, engine: str) -> None:
    d = made.again(engine=engine)
    named = eval(repr(d), {"Differentiator": Differentiator})  # noqa: S307
    for other in (named, pickle.loads(pickle.dumps(d)), Made(d, d._asked).again()):  # noqa: S301
        assert other == d
        assert hash(other) == hash(d)
        np.testing.assert_array_equal(other.weights, d.weights)
    stream = d.stream()
    stream.push(np.arange(5.0))
    again = pickle.loads(pickle.dumps(stream))  # noqa: S301
    assert (again.count, again.push(7.0)) == pytest.approx((5, stream.push(7.0)), rel=0, abs=0, nan_ok=True)


@examples(25)
@given(designs(longest=60, least=20), st.floats(0.001, 0.2))
def test_what_is_trimmed_keeps_its_degree(made: Made, share: float) -> None:
    try:
        d = made.again(trim=share)
    except ValueError as error:
        assert str(error).startswith("trim must be so small")  # noqa: PT017
        return
    sizes, kept = np.abs(made.d.weights), len(d.weights)
    first = made.d.window_length - kept - round(made.d.delay_samples - d.delay_samples)
    left, right = sizes[:first].sum(), sizes[first + kept :].sum()
    assert max(left, right) <= share * sizes.sum() * (1 + 1e-12)
    assert d.exactness == made.d.exactness
    t = np.arange(kept) / kept
    late = (kept - 1 - d.delay_samples) / kept
    for power in range(d.degree + 1):
        wanted = math.perm(power, d.deriv) * late ** (power - d.deriv) if power >= d.deriv else 0.0
        got = float(d.weights @ t**power) * (kept * d.delta) ** d.deriv
        assert got == pytest.approx(wanted, rel=0, abs=1e-10 * (1 + d.norm1 * (kept * d.delta) ** d.deriv))


# Choices, noise, words.


@examples(6)
@given(st.integers(150, 400), st.integers(-20, 20), st.integers(-100, 100), st.integers(0, 2**32))
def test_choices_follow_scale_and_offset(count: int, exponent: int, offset: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.sin(np.arange(count) / rng.uniform(5, 30)) + rng.uniform(0.001, 0.1) * rng.standard_normal(count)
    x = np.round(x * 2**30) / 2**30
    one = algdiff.suggest(x)
    for other, factor in [
        (algdiff.suggest(x), 1.0),
        (algdiff.suggest(x * 2.0**exponent), 2.0**exponent),
        (algdiff.suggest(-x), 1.0),
        (algdiff.suggest(x + offset), 1.0),
    ]:
        assert other.differentiator == one.differentiator
        assert other.rmse == pytest.approx(one.rmse * factor, rel=1e-6)
        assert other.noise_level == pytest.approx(one.noise_level * factor, rel=1e-6)
    slower = algdiff.suggest(x, delta=0.25)
    assert slower.differentiator.window_length == one.differentiator.window_length
    assert slower.rmse == pytest.approx(4 * one.rmse, rel=1e-6)


@examples(25)
@given(samples(30, dtype=np.float64), st.integers(-30, 30))
def test_noise_levels_follow_the_scale(x: Array, exponent: int) -> None:
    level = algdiff.noise_level(x)
    assert algdiff.noise_level(x * 2.0**exponent) == level * 2.0**exponent
    assert algdiff.noise_level(-x) == level
    assert algdiff.noise_level(x[::-1]) == pytest.approx(level, rel=1e-6)


@examples(50)
@given(st.integers(1, 10**7), st.sampled_from([("ms", 3), ("us", 6), ("s", 0)]), st.sampled_from(["", " "]))
def test_units_are_read_as_they_are_written(number: int, unit: tuple[str, int], gap: str) -> None:
    found = _units.time(f"{number}{gap}{unit[0]}")
    assert found == number / 10 ** unit[1]  # rounded once
    assert found.unit == unit[0]
    assert _units.time(repr(float(found))) == found
    assert _units.rate(f"{number}{gap}kHz") == number * 1000
    bytes_ = _units.size(f"{number}{gap}KiB")
    assert bytes_ == number * 1024
    amount, prefix = _units.scaled(bytes_, "B").split()
    assert _units.size(amount + prefix) == pytest.approx(bytes_, rel=5.1e-3)


NUMBERS = [0, -1, 1, 3, 7, 10**30, 2**63, 1.5, -0.0, 1e300, 1e-320, math.nan, math.inf, -math.inf, True, 2 + 1j]
ODD = [
    "",
    "center",
    "wrap",
    b"x",
    [],
    [1, 1],
    (0, 1),
    {},
    {3},
    object(),
    Decimal(3),
    Fraction(1, 3),
    np.float32(2),
    int,
]
ARRAYS = [
    np.array([1.0, 2.0]),
    np.array(5),
    np.ma.masked,
    np.array(["a"]),
    np.array([None]),
    np.zeros((3, 0)),
    range(60),
]
NAMES = (
    *("window_length", "deriv", "degree", "kappa", "mu", "tau", "delay", "delta", "fs", "rule", "trim", "engine", "t"),
    *("at", "window_duration", "axis", "mode", "cval", "edge_window", "nan_policy", "min_support", "max_gain", "x"),
    *("weights", "period", "sigma", "autocovariance", "out", "threads"),
)


VALUES = NUMBERS + ODD + ARRAYS


def mistaken(given: dict[str, Any]) -> None:
    """Call with these arguments, whatever they are: they are taken, or one of them is refused in one line."""
    words: dict[str, Any] = {"x": np.sin(np.arange(60.0)), "window_length": 11, "return_std": True, **given}
    if "window_duration" in given and "window_length" not in given:
        del words["window_length"]
    if given.keys() & {"deriv", "engine", "threads", "rule", "mode", "cval", "axis", "x", "out"}:
        del words["return_std"]
    try:
        algdiff.differentiate(**words)
    except (TypeError, ValueError, MemoryError) as error:
        said = str(error)
        # An order decides about the degree, and a duration about a length.
        others = {"deriv": "degree", "window_duration": "window_length"}
        assert any(name in said or others.get(name, name) in said for name in given), said
        assert "\n" not in said
        assert not said.endswith(".")
        assert len(said) < 600


@pytest.mark.parametrize("name", NAMES)
def test_any_mistake_is_named(name: str) -> None:
    for value in VALUES:
        mistaken({name: value})


@examples(200)
@given(st.dictionaries(st.sampled_from(NAMES), st.integers(0, len(VALUES) - 1), min_size=2, max_size=4))
def test_one_of_several_mistakes_is_named(which: dict[str, int]) -> None:
    mistaken({name: VALUES[place] for name, place in which.items()})
