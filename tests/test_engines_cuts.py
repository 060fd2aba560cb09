"""Cuts, threads, axes, modes and orders: what must not change the result of any engine, or by rounding only."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from engines import DTYPES, OTHERS, Case, accepts, assert_within, bound, by_engine, designed
from support import ENGINES, design

CASES = [
    Case(5, 1, 2),
    Case(6, 1, 2, 0.0, 0.0, "newest"),
    Case(33, 2, 4, 1.0, 1.0),
    Case(61, 1, 3),
    Case(64, 0, 3, 2.0, 0.0, "newest"),
    Case(127, 1, 3, 1.0, 1.0, "center", "trapezoid"),
    Case(200, 1, 3, 0.5, 0.5, "newest"),
]
MODES = ["fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"]
THREADS = (2, 3, 8)


def same(engine: str, case: Case, got: np.ndarray, expected: np.ndarray, x: np.ndarray, what: str) -> None:
    """Ask direct for the same bits, and the others for the same but for rounding, once on either side."""
    if engine == "direct":
        assert got.tobytes() == expected.tobytes(), f"{case} {what}"
    else:
        assert_within(got, expected, 2 * bound(engine, designed(case), x), f"{engine} {case} {what}")


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("engine", ENGINES)
def test_five_thousand_cuts_with_a_halo(engine: str, dtype: Any) -> None:
    rng = np.random.default_rng([len(engine), DTYPES.index(dtype)])
    cases = [case for case in CASES if accepts(engine, case)]
    made = 0
    while made < 5000:
        case = cases[rng.integers(len(cases))]
        run, halo = by_engine(engine, case), case.window_length - 1
        outputs = int(rng.choice([40, 300, 1000, 5000, 20_000], p=[0.2, 0.4, 0.3, 0.08, 0.02]))
        x = (rng.standard_normal(halo + outputs) + 100).astype(dtype)
        cuts = np.unique(rng.integers(1, outputs, rng.integers(1, 40)))
        made += len(cuts)
        pieces = [run(x[start : stop + halo], mode="valid", threads=1) for start, stop in pairwise([0, *cuts, outputs])]
        same(engine, case, np.concatenate(pieces), run(x, mode="valid", threads=1), x, f"cut at {cuts}")


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("engine", ENGINES)
def test_threads_change_no_bit(engine: str, dtype: Any) -> None:
    rng = np.random.default_rng(9)
    shapes = [((100_001,), 0), ((20, 9001), 1), ((4001, 41), 0), ((3000, 120), -1), ((3, 3000, 9), 1)]
    for case in (Case(61), Case(96, 2, 4, 1.0, 1.0, "newest"), Case(1001, 1, 3)):
        run = by_engine(engine, case)
        for shape, axis in shapes:
            if shape[axis] < case.window_length:
                continue
            x = rng.standard_normal(shape).astype(dtype)
            for mode in ("fit", "valid", "wrap"):
                one = run(x, axis, mode=mode, threads=1)
                for threads in THREADS:
                    assert run(x, axis, mode=mode, threads=threads).tobytes() == one.tobytes(), f"{case} {shape} {mode}"


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("engine", ENGINES)
def test_axes_equal_the_moved_axis(engine: str, dtype: Any) -> None:
    rng = np.random.default_rng(10)
    for case in CASES:
        if not accepts(engine, case):
            continue
        run, length, first = by_engine(engine, case), case.window_length, before(case)
        shapes = [((length + 900, 11), 0), ((3, length + 130, 17), 1), ((5, 4, length + 70), 2), ((length, 3), 0)]
        for shape, axis in shapes:
            x = rng.standard_normal(shape).astype(dtype)
            for mode in ("valid", "wrap"):
                got = np.moveaxis(run(x, axis, mode=mode), axis, -1)
                rows = np.moveaxis(x, axis, -1)
                for index in np.ndindex(rows.shape[:-1]):
                    row = np.ascontiguousarray(rows[index])
                    extended = row if mode == "valid" else np.pad(row, (first, length - 1 - first), "wrap")
                    same(engine, case, got[index], run(row, mode=mode), extended, f"{shape} {axis} {mode}")


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("engine", OTHERS)
def test_modes_equal_the_direct_engine(engine: str, mode: str) -> None:
    rng = np.random.default_rng(11)
    pads = {"nearest": "edge", "mirror": "reflect", "wrap": "wrap", "constant": "constant"}
    for case in CASES:
        if not accepts(engine, case):
            continue
        length, d = case.window_length, designed(case)
        for count in (1, 2, length - 1, length, length + 1, 3 * length, 9000):
            if count < (1 if mode in pads else length):
                continue
            x = rng.standard_normal(count)
            got, expected = (by_engine(word, case)(x, mode=mode, cval=2.0) for word in (engine, "direct"))
            if mode == "valid":
                assert_within(got, expected, bound(engine, d, x) + bound("direct", d, x), f"{case} {count}")
                continue
            first, beyond = before(case), length - 1 - before(case)
            if mode in pads:
                options: dict[str, Any] = {"constant_values": 2.0} if mode == "constant" else {}
                extended = np.pad(x, (first, beyond), pads[mode], **options)  # type: ignore[call-overload]
                assert_within(
                    got, expected, bound(engine, d, extended) + bound("direct", d, extended), f"{case} {count}"
                )
                continue
            interior = slice(first, count - beyond)
            allowed = bound(engine, d, x) + bound("direct", d, x)
            assert_within(got[interior], expected[interior], allowed, f"{case} {count}")
            # No engine has a part in the ends.
            for end in (slice(0, first), slice(count - beyond, count)):
                np.testing.assert_array_equal(got[end], expected[end])


def before(case: Case) -> int:
    """Return the samples of the window before the one that the output belongs to."""
    return case.window_length - 1 - int(designed(case).delay_samples)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("engine", ENGINES)
def test_several_orders_equal_each_alone(engine: str, dtype: Any) -> None:
    rng = np.random.default_rng(12)
    for case in CASES:
        if not accepts(engine, case) or case.rule != "exact":
            continue
        together = design(case.window_length, (0, 1, 2), engine=engine, **{**case.words(), "degree": 4})
        for shape in [(case.window_length + 700,), (3, case.window_length + 50), (30_000,)]:
            x = rng.standard_normal(shape).astype(dtype)
            got = together(x, mode="valid")
            assert got.shape == (3, *shape[:-1], shape[-1] - case.window_length + 1)
            for deriv in range(3):
                alone = case._replace(deriv=deriv, degree=4)
                expected = by_engine(engine, alone)(x, mode="valid")
                for index in np.ndindex(shape[:-1]):
                    same(engine, alone, got[deriv][index], expected[index], x[index], f"order {deriv}")
