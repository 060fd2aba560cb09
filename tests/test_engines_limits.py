"""Engines where their blocks and levels begin: numbers of blocks, scales beyond a type, loud samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from algdiff._core import Bank
from engines import DTYPES, OTHERS, assert_within, bound, naive, usual
from support import ENGINES, design


@pytest.mark.parametrize("dtype", DTYPES)
def test_moments_of_many_numbers_of_blocks(dtype: Any) -> None:
    """Windows of about so many blocks of 16: groups of them begin and end anywhere in what is done at a time."""
    for blocks in range(1, 14):
        for length in (256 * blocks + 16, 256 * blocks - 16 * (blocks % 5) + 1):
            ours = design(length, degree=1 + 2 * (length % 2), kappa=0, mu=0, engine="moments")
            x = np.random.default_rng(length).standard_normal(length + 1200).astype(dtype)
            assert_within(ours(x, mode="valid"), naive(ours, x), bound("moments", ours, x), f"{length}")


@pytest.mark.parametrize("engine", ENGINES)
def test_scales_beyond_single_precision(engine: str) -> None:
    """Taps of about 2^145, and samples of about 2^-100: their sums are numbers, though the scale is none."""
    ours = design(101, 2, degree=3, kappa=0, mu=0, delta=2.0**-80, engine=engine)
    x = (np.random.default_rng(6).standard_normal(3000) * 2.0**-100).astype(np.float32)
    found = ours(x, mode="valid")
    assert np.abs(ours.weights).max() > np.finfo(np.float32).max
    assert_within(found, naive(ours, x), bound(engine, ours, x))
    assert np.isfinite(found).all()


@pytest.mark.parametrize("kappa", [1e-9, 1e-11, 1e-12, 1e-13])
def test_moments_refuse_what_is_nearly_a_polynomial_or_are_as_good_as_ever(kappa: float) -> None:
    x = np.random.default_rng(7).standard_normal(3000)
    try:
        ours = design(101, degree=3, kappa=kappa, mu=0, engine="moments")
    except ValueError:
        assert kappa > 1e-12
        return
    error = (ours(x, mode="valid") - naive(ours, x)).astype(float)
    assert np.sqrt(np.mean(error**2)) <= usual("moments", ours, x)


def test_few_taps_run_directly_and_many_do_not() -> None:
    for single in (False, True):
        assert Bank([design(20)._plan]).engine(single) == "direct"
        assert Bank([design(20_001, degree=3)._plan]).engine(single) in OTHERS


@pytest.mark.parametrize(("dtype", "quiet"), [(np.float64, 2.0**-10), (np.float32, 2.0**-5)])
@pytest.mark.parametrize("engine", ENGINES)
def test_windows_just_as_loud_as_a_level_begins(engine: str, dtype: Any, quiet: float) -> None:
    """The largest difference of most windows is the limit at which blocks with louder samples are computed again."""
    rng = np.random.default_rng(3)
    steps = np.round(rng.uniform(-16, 16, 600)) / 16 * quiet
    steps[::7], steps[150] = quiet, 1
    x = np.cumsum(steps).astype(dtype)
    assert np.array_equal(np.diff(x.astype(float)), steps[1:])
    ours = design(61, degree=3, engine=engine)
    assert_within(ours(x, mode="valid"), naive(ours, x), bound(engine, ours, x))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("engine", ENGINES)
def test_samples_up_to_a_64th_of_the_largest_number_overflow_nowhere(engine: str, dtype: Any) -> None:
    top = float(np.finfo(dtype).max) / 64
    rng = np.random.default_rng(8)
    for length in (51, 117, 1001):
        for degree, deriv in ((2, 0), (2, 1), (8, 0), (8, 1), (4, 2)):
            ours = design(length, deriv, degree=degree, kappa=1, mu=1, engine=engine)
            n = length + 1000
            waves = [np.where(np.arange(n) % (2 * half) < half, 1.0, -1.0) for half in (1, 7, length // 2, length)]
            for signs in (rng.choice([-1.0, 1.0], n), np.ones(n), *waves):
                assert np.isfinite(ours((top * signs).astype(dtype), mode="valid")).all()
