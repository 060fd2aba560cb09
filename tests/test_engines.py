"""Every engine against the naive sum, over windows, designs, dtypes and signals."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import algdiff
from engines import (
    DTYPES,
    LEAST,
    MOST,
    OTHERS,
    Case,
    accepts,
    assert_within,
    bound,
    by_engine,
    designed,
    naive,
    signals,
    usual,
)
from support import ENGINES, design

WINDOWS = (5, 6, 11, 31, 32, 33, 61, 64, 100, 127, 500, 1001, 4001, 100_000)
EXPONENTS = ((0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (0.0, 2.0), (0.5, 0.5), (1.5, 0.0), (-0.5, 0.5))
TAUS = ("center", "newest", 0.3, 1.1)
RULES = ("exact", "exact", "trapezoid", "midpoint", "simpson", "cell", "hat")
EDGES = (8, 16, 32, 64, 128, 512, 1024, 2048, 4096, 8192, 16384)


def draw(rng: np.random.Generator, length: int, engine: str) -> Case:
    """Return a random design that `engine` has to run."""
    while True:
        deriv = int(rng.integers(0, 5))
        degree = deriv + int(rng.integers(0, 4))
        kappa, mu = EXPONENTS[rng.integers(len(EXPONENTS))]
        rule = RULES[rng.integers(len(RULES))]
        negative, even = min(kappa, mu) < 0, length % 2 == 0
        case = Case(length, deriv, degree, kappa, mu, TAUS[rng.integers(len(TAUS))], rule)
        impossible = degree >= length or (negative and rule != "exact") or (even and rule == "simpson")
        if not impossible and (engine != "moments" or (case.polynomial() and case.size() <= MOST)):
            return case


def check(engine: str, case: Case, x: np.ndarray, places: np.ndarray | None = None) -> None:
    """Compare all outputs with the direct engine's, and those at `places` with the naive sum."""
    d, message = designed(case), f"{engine} {case} {x.dtype} {len(x)}"
    try:
        got = by_engine(engine, case)(x, mode="valid")
    except ValueError as refusal:
        assert not accepts(engine, case), message
        assert "engine must be" in str(refusal)  # noqa: PT017
        return
    assert got.dtype == x.dtype
    allowed = bound(engine, d, x)
    if engine != "direct":
        direct = by_engine("direct", case)(x, mode="valid")
        assert_within(got, direct, allowed + bound("direct", d, x), message + " against direct")
    places = np.arange(len(got)) if places is None else places
    assert_within(got[places], naive(d, x, places), allowed[places], message)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("length", WINDOWS)
@pytest.mark.parametrize("engine", ENGINES)
def test_equals_the_naive_sum(engine: str, length: int, dtype: Any) -> None:
    rng = np.random.default_rng([ENGINES.index(engine), length, DTYPES.index(dtype)])
    designs, each, most = (16, 3, 300) if length < 1000 else (6, 3, 24) if length < 10_000 else (2, 2, 3)
    for _ in range(designs):
        case = draw(rng, length, engine)
        count = length - 1 + int(rng.choice([1, 2, 70, 600, 3000]))
        zoo = signals(rng, count, dtype)
        for name in rng.choice(list(zoo), each, replace=False):
            outputs = count - length + 1
            check(engine, case, zoo[name], rng.integers(0, outputs, min(outputs, most)))


@pytest.mark.parametrize("name", signals(np.random.default_rng(0), 2, np.float64))
@pytest.mark.parametrize("engine", ENGINES)
def test_every_signal(engine: str, name: str) -> None:
    rng = np.random.default_rng(1)
    for dtype, length, deriv, tau in product(DTYPES, (11, 61, 64, 301), range(4), ("center", "newest")):
        x = signals(rng, 2000, dtype)[name]
        check(engine, Case(length, deriv, deriv + 2, 1.0, 1.0, tau), x, rng.integers(0, 2001 - length, 200))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("length", [5, 33, 61, 100, 501])
@pytest.mark.parametrize("engine", ENGINES)
def test_every_number_of_outputs(engine: str, length: int, dtype: Any) -> None:
    case = Case(max(length, LEAST) if engine == "moments" else length, 1, 2, tau="newest")
    length = case.window_length
    d, run = designed(case), by_engine(engine, case)
    x = np.random.default_rng(length).standard_normal(length + max(EDGES) + 1).astype(dtype)
    places = np.unique([*range(72), *(edge + off for edge in EDGES for off in range(-8, 2))])
    exact = np.full(len(x) - length + 1, np.nan, np.longdouble)
    exact[places] = naive(d, x, places)
    for outputs in [*range(1, 72), *(edge + off for edge in EDGES for off in (-1, 0, 1))]:
        got = run(x[: length - 1 + outputs], mode="valid")
        assert len(got) == outputs
        known = places[places < outputs]
        # The last outputs stand where engines finish with smaller blocks.
        assert {0, outputs - 1} <= set(known)
        allowed = bound(engine, d, x[: length - 1 + outputs])
        assert_within(got[known], exact[known], allowed[known], f"{engine} {length} {outputs}")


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("engine", ENGINES)
def test_the_response_to_an_impulse_is_the_weights(engine: str, dtype: Any) -> None:
    rng = np.random.default_rng(2)
    for length in (5, 32, 61, 64, 200, 1001):
        for deriv, rule in [(0, "exact"), (1, "exact"), (2, "exact"), (1, "trapezoid")]:
            case = Case(length, deriv, deriv + 2, 1.0, 1.0, "newest", rule)
            if not accepts(engine, case):
                continue
            d, count = designed(case), 3 * length + 100
            for place in [0, 1, count - 1, *rng.integers(0, count, 5)]:
                x = np.zeros(count, dtype)
                x[place] = 1
                padded = np.pad(d.weights, count)[::-1].astype(np.longdouble)
                expected = padded[count + length - 1 - place :][: count - length + 1]
                got = by_engine(engine, case)(x, mode="valid")
                assert_within(got, expected, bound(engine, d, x), f"{engine} {case} {place}")
                if engine != "fft":
                    assert not got[expected == 0].any()


@settings(max_examples=200, deadline=None, derandomize=True, database=None)
@given(st.data())
@pytest.mark.parametrize("engine", ENGINES)
def test_any_design_on_any_data(engine: str, data: st.DataObject) -> None:
    length = data.draw(st.integers(LEAST if engine == "moments" else 2, 300), "window_length")
    deriv = data.draw(st.integers(0, min(4, length - 1)), "deriv")
    degree = data.draw(st.integers(deriv, min(deriv + 4, length - 1)), "degree")
    exponent = st.sampled_from([0.0, 1.0, 2.0, 3.0]) if engine == "moments" else st.floats(-0.9, 8.0)
    kappa, mu = data.draw(exponent, "kappa"), data.draw(exponent, "mu")
    case = Case(length, deriv, degree, kappa, mu, data.draw(st.floats(-0.2, 1.2), "tau"))
    dtype = data.draw(st.sampled_from(DTYPES), "dtype")
    count = length - 1 + data.draw(st.integers(1, 700), "outputs")
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32), "seed"))
    x = rng.standard_normal(count) * 10 ** data.draw(st.floats(-30, 30), "scale")
    x[rng.integers(count, size=data.draw(st.integers(0, 5), "jumps"))] *= 1e6
    check(engine, case, x.astype(dtype), rng.integers(0, count - length + 1, 60))


def test_moments_refuse_what_is_no_polynomial() -> None:
    for kappa, mu in [(0.5, 0.5), (1.0, 0.5), (-0.5, 0.0), (1e-3, 0.0)]:
        with pytest.raises(ValueError, match="engine must be") as refusal:
            design(61, 1, degree=3, kappa=kappa, mu=mu, engine="moments")(np.zeros(100))
        for word in ("moments", "direct", "fft", "polynomial"):
            assert word in str(refusal.value)


@pytest.mark.parametrize("rule", ["midpoint", "simpson", "cell", "hat"])
def test_moments_refuse_or_run_the_other_rules_and_sizes(rule: str) -> None:
    x = np.random.default_rng(3).standard_normal(1000)
    for exponent in (0.0, 1.0, 2.0):
        for length in (11, 101):
            check("moments", Case(length, 1, 3, exponent, exponent, "center", rule), x)
    for degree in (9, 12, 20):
        check("moments", Case(101, 1, degree, 0.0, 0.0, "newest"), x)


@pytest.mark.parametrize("length", [4001, 20_000, 100_001])
@pytest.mark.parametrize(("deriv", "exponent"), [(1, 0.0), (1, 1.0), (2, 0.0), (2, 1.0), (0, 0.0)])
@pytest.mark.parametrize("engine", OTHERS)
def test_long_windows_run(engine: str, deriv: int, exponent: float, length: int) -> None:
    """What the engines other than direct are there for, with the default degree."""
    case = Case(length, deriv, deriv + 2, exponent, exponent)
    x = np.random.default_rng(14).standard_normal(length + 3000)
    by_engine(engine, case)(x, mode="valid")
    check(engine, case, x, np.array([0, 1500, 3000]))


def test_engines_are_words() -> None:
    for wrong in ("Direct", "", "fastest"):
        with pytest.raises(ValueError, match="engine must be") as refusal:
            design(61, engine=wrong)
        assert "'auto', 'direct', 'moments' or 'fft'" in str(refusal.value)


@pytest.mark.parametrize("dtype", DTYPES)
def test_the_automatic_choice_is_one_of_them_and_gives_its_bits(dtype: Any) -> None:
    x = np.random.default_rng(4).standard_normal(30_000).astype(dtype)
    for length, exponent in product((11, 61, 501, 4001), (0.0, 0.5)):
        automatic = design(length, 1, degree=3, kappa=exponent, mu=exponent)
        chosen = automatic.engine_for(dtype)
        assert chosen in ENGINES
        named = design(length, 1, degree=3, kappa=exponent, mu=exponent, engine=chosen)
        assert automatic(x).tobytes() == named(x).tobytes()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("engine", ENGINES)
def test_the_usual_error_is_that_of_independent_roundings(engine: str, dtype: Any) -> None:
    x = np.random.default_rng(13).standard_normal(40_000).astype(dtype)
    for length, (deriv, exponent) in product((11, 61, 64, 200, 1001, 4001), ((0, 0.0), (1, 0.0), (1, 1.0), (3, 2.0))):
        case = Case(length, deriv, deriv + 2, exponent, exponent, "newest")
        if not accepts(engine, case):
            continue
        places = np.arange(0, len(x) - length + 1, 61 if length < 1000 else 701)
        error = by_engine(engine, case)(x, mode="valid")[places] - naive(designed(case), x, places)
        typical = float(np.sqrt(np.mean(error**2)))
        assert typical <= usual(engine, designed(case), x), f"{engine} {case}"


def test_bounds_tell_engines_apart_from_wrong_ones() -> None:
    """The bounds are small: a weight that is off by a millionth breaks them all."""
    x = np.random.default_rng(5).standard_normal(20_000)
    for engine, length in product(ENGINES, (11, 61, 1001)):
        d = algdiff.Differentiator(length, 1, degree=3, kappa=0, mu=0)
        wrong = d.weights.copy()
        wrong[length // 3] *= 1 + 1e-6
        off = np.convolve(x, (wrong - d.weights)[::-1], "valid")
        assert np.median(np.abs(off) / bound(engine, d, x)) > 1
