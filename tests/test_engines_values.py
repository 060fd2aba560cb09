"""What no engine may do to values: spread NaN, leak constants, lose quiet signals beside loud ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engines import DTYPES, Case, accepts, assert_within, bound, by_engine, designed, naive
from support import ENGINES

CASES = [
    Case(5, 1, 2),
    Case(32, 1, 3, 1.0, 1.0, "newest"),
    Case(61, 1, 3),
    Case(61, 0, 2, 1.0, 1.0),
    Case(64, 2, 4, 2.0, 0.0, 0.3),
    Case(101, 1, 3, 1.0, 1.0, "center", "trapezoid"),
    Case(101, 1, 3, 0.5, 0.5),
    Case(501, 1, 3, 0.0, 0.0, "newest"),
    Case(1001, 3, 4, 1.0, 1.0),
]
PAIRS = [(engine, case) for engine in ENGINES for case in CASES if accepts(engine, case)]


def name(value: object) -> str:
    return "-".join(map(str, value)) if isinstance(value, Case) else str(value)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("engine", "case"), PAIRS, ids=name)
def test_what_is_not_finite_touches_its_windows_only(engine: str, case: Case, dtype: Any) -> None:
    rng = np.random.default_rng([len(engine), case.window_length])
    d = designed(case)
    for outputs, bad in [(1, 1), (100, 1), (700, 2), (5000, 1), (9000, 3), (20_000, 7)]:
        count = case.window_length - 1 + outputs
        clean = rng.standard_normal(count).astype(dtype)
        places = rng.integers(0, count, bad)
        if outputs == 5000:
            places = np.array([[0], [count - 1], [4096]][bad - 1])
        damaged = np.zeros(count)
        damaged[places] = 1
        touched = np.convolve(damaged, np.ones(case.window_length), "valid") > 0.5
        x = clean.copy()
        for values in ([np.nan] * bad, rng.choice([np.nan, np.inf, -np.inf], bad), [np.inf] * bad):
            x[places] = values
            got = by_engine(engine, case)(x, mode="valid")
            np.testing.assert_array_equal(~np.isfinite(got), touched, err_msg=f"{engine} {case} {outputs} {values}")
            if np.isnan(values).all():
                np.testing.assert_array_equal(np.isnan(got), touched)
        whole = np.flatnonzero(~touched)
        whole = rng.choice(whole, min(len(whole), 100), replace=False) if len(whole) else whole
        x[places] = 0
        assert_within(got[whole], naive(d, x, whole), bound(engine, d, x)[whole], f"{engine} {case} {outputs}")


@pytest.mark.parametrize("engine", ENGINES)
def test_nothing_but_bad_values(engine: str) -> None:
    for value in (np.nan, np.inf):
        got = by_engine(engine, Case(61))(np.full(9000, value))
        assert np.isnan(got).all()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("value", [0.0, -0.0, 1.0, -1e9, 0.1, 3e37])
@pytest.mark.parametrize("engine", ENGINES)
def test_a_constant_gives_exactly_zero_or_itself(engine: str, value: float, dtype: Any) -> None:
    x = np.full(6000, value, dtype)
    for case in CASES:
        if case.rule == "exact" and accepts(engine, case):
            for mode in ("valid", "nearest", "wrap", "mirror"):
                got = by_engine(engine, case)(x, mode=mode)
                np.testing.assert_array_equal(got, x[: len(got)] if case.deriv == 0 else np.zeros_like(got))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("engine", ENGINES)
def test_an_offset_costs_nothing(engine: str, dtype: Any) -> None:
    rng = np.random.default_rng(6)
    offset = dtype(2.0**30 if dtype is np.float64 else 2.0**20)
    for case in CASES:
        if case.deriv and case.rule == "exact" and accepts(engine, case):
            # What both store without rounding has the same differences, and so the same bits.
            x = np.round(rng.standard_normal(9000) * 4).astype(dtype)
            run = by_engine(engine, case)
            assert run(x + offset, mode="valid").tobytes() == run(x, mode="valid").tobytes()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("engine", "case"), PAIRS, ids=name)
def test_a_power_of_two_scales_every_bit(engine: str, case: Case, dtype: Any) -> None:
    x = np.random.default_rng(7).standard_normal(9000).astype(dtype)
    run = by_engine(engine, case)
    expected = run(x, mode="valid")
    for exponent in (-40, 1, 50):
        factor = dtype(2.0**exponent)
        assert run(x * factor, mode="valid").tobytes() == (expected * factor).tobytes()
    assert run(-x, mode="valid").tobytes() == (-expected).tobytes()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("engine", "case"), PAIRS, ids=name)
def test_polynomials_come_back(engine: str, case: Case, dtype: Any) -> None:
    d, count = designed(case), 3000
    t = (np.arange(count) - count / 2) / 256
    for power in range(1, d.exactness + 1):
        x = (t**power).astype(dtype)
        got = by_engine(engine, case)(x, mode="valid")
        places = np.arange(0, len(got), 37)
        assert_within(got[places], naive(d, x, places), bound(engine, d, x)[places], f"{engine} {case} {power}")


@pytest.mark.parametrize("engine", ENGINES)
def test_a_quiet_half_keeps_its_digits_beside_a_loud_one(engine: str) -> None:
    """Direct and moments see their window only; the transform sees its block, and no further."""
    rng = np.random.default_rng(8)
    count, reach = 200_000, 40_000
    quiet = rng.standard_normal(count)
    x = np.where(np.arange(count) < count // 2, 1e12 * quiet, quiet)
    for case in CASES:
        if accepts(engine, case):
            d = designed(case)
            got = by_engine(engine, case)(x, mode="valid")
            start = count // 2 + (reach if engine == "fft" else 0)
            places = np.arange(start, len(got), 997)
            assert_within(got[places], naive(d, x, places), bound(engine, d, quiet)[places], f"{engine} {case}")
