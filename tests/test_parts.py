"""Parts of rows, several orders and every layout: the same bits as one order of whole rows, one at a time."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from algdiff._core import Bank
from support import design

MODES = ("fit", "valid", "nan", "nearest", "mirror", "wrap", "constant")
Array = npt.NDArray[Any]
SHAPES = [(1, 1), (3, 1), (21, 1), (1, 2), (1, 19), (2, 8), (1, 75)]


def bank_of(orders: tuple[int, ...], length: int, engine: str = "auto", **options: Any) -> Bank:
    return Bank([design(length, order, degree=4, **options)._plan for order in orders], engine)


def bits(values: Array) -> bytes:
    return np.ascontiguousarray(values).tobytes()


def output_count(length: int, mode: str, samples: int) -> int:
    return max(samples + 1 - length, 0) if mode == "valid" else samples


def whole(bank: Bank, orders: int, length: int, x: Array, mode: str, **options: Any) -> Array:
    """Return (orders, outer, outputs, inner) of x with the axes (outer, samples, inner)."""
    outer, samples, inner = x.shape
    out = np.full((orders, outer, output_count(length, mode, samples), inner), 7.0, x.dtype)
    bank.run(x.reshape(-1), out.reshape(-1), x.shape, mode, 0.5, **options)
    return out


def needed(mode: str, length: int, center: int, samples: int, first: int, count: int) -> tuple[int, int] | None:
    """Return the samples that some outputs need, output by output."""
    places: set[int] = set()
    for output in range(first, first + count):
        window = range(output - center, output - center + length)
        inside = window.start >= 0 and window.stop <= samples
        if mode == "fit" and not inside:
            window = range(length) if window.start < 0 else range(samples - length, samples)
        elif mode == "nan" and not inside:
            continue
        for place in window:
            if mode == "wrap":
                places.add(place % samples)
            elif mode == "nearest":
                places.add(min(max(place, 0), samples - 1))
            elif mode == "mirror" and samples > 1:
                folded = place % (2 * samples - 2)
                places.add(min(folded, 2 * samples - 2 - folded))
            elif 0 <= place < samples or mode == "mirror":
                places.add(min(max(place, 0), samples - 1))
    return (min(places), max(places) + 1) if places else None


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("tau", [0.5, 0.9])
def test_random_parts_have_the_bits_of_the_whole(mode: str, tau: float, dtype: type) -> None:
    rng = np.random.default_rng([MODES.index(mode), int(10 * tau)])
    for trial in range(60):
        length = int(rng.integers(5, 20))
        orders = [(0,), (1,), (0, 1, 2), (2, 1)][trial % 4]
        outer, inner = SHAPES[trial % len(SHAPES)]
        samples = int(rng.integers(length, 90))
        bank = bank_of(orders, length, tau=tau)
        x = rng.standard_normal((outer, samples, inner)).astype(dtype)
        expected = whole(bank, len(orders), length, x, mode)
        outputs = expected.shape[2]
        first = int(rng.integers(0, outputs))
        count = int(rng.integers(1, outputs - first + 1))
        center = 0 if mode == "valid" else int(np.floor(tau * length - 0.5 + 0.5 + 1e-9))
        need = needed(mode, length, center, samples, first, count)
        least = need or (0, 0)
        more = int(rng.integers(0, least[0] + 1)), int(rng.integers(least[1], samples + 1))
        for low, high in [least, more]:
            held = np.ascontiguousarray(x[:, low:high])
            out = np.full((len(orders), outer, count, inner), 7.0, dtype)
            part = (low, samples, first)
            bank.run(held.reshape(-1), out.reshape(-1), held.shape, mode, 0.5, part=part)
            assert bits(out) == bits(expected[:, :, first : first + count]), (trial, part)
        if need is not None:
            for low, high in [(need[0] + 1, need[1]), (need[0], need[1] - 1)]:
                held = np.ascontiguousarray(x[:, low:high])
                with pytest.raises(ValueError, match="part must be such that"):
                    bank.run(held.reshape(-1), out.reshape(-1), held.shape, mode, 0.5, part=(low, samples, first))


@pytest.mark.parametrize("part", [(1, 50, 0), (0, 49, 0), (0, 50, 41), (50, 50, 0)])
def test_parts_outside_of_their_rows_are_refused(part: tuple[int, int, int]) -> None:
    bank = bank_of((1,), 5)
    with pytest.raises(ValueError, match="part must be samples and outputs of one row"):
        bank.run(np.zeros(50), np.zeros(10), (1, 50, 1), "nearest", part=part)


@pytest.mark.parametrize("mode", MODES)
def test_several_orders_are_each_alone(mode: str) -> None:
    rng = np.random.default_rng(3)
    for outer, inner in SHAPES:
        x = rng.standard_normal((outer, 400, inner))
        together = whole(bank_of((0, 1, 2), 31), 3, 31, x, mode)
        for order, result in enumerate(together):
            assert bits(result) == bits(whole(bank_of((order,), 31), 1, 31, x, mode)[0])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("length", [11, 40])
@pytest.mark.parametrize("samples", [40, 300, 2500])
def test_rows_columns_and_threads_have_the_same_bits(mode: str, length: int, samples: int) -> None:
    rng = np.random.default_rng(samples)
    bank = bank_of((1, 2), length)
    x = rng.standard_normal((45, samples))
    x[3, 17], x[7, 0], x[40, -1] = np.nan, np.inf, 1e300
    alone = np.stack([whole(bank, 2, length, row[None, :, None], mode)[:, 0] for row in x], axis=1)
    for threads, half_sample in itertools.product([1, 2, 3], [False]):
        rows = whole(bank, 2, length, x[:, :, None], mode, threads=threads, half_sample=half_sample)
        columns = whole(bank, 2, length, np.ascontiguousarray(x.T)[None], mode, threads=threads)
        assert bits(rows) == bits(alone)
        assert bits(columns[:, 0].swapaxes(1, 2)) == bits(alone[..., 0])


def test_many_tasks_have_the_same_bits() -> None:
    """Long rows, wide and narrow matrices, each cut into many tasks for several threads."""
    rng = np.random.default_rng(5)
    bank = bank_of((1,), 61)
    for shape in [(1, 400_000, 1), (2000, 200, 1), (1, 200, 2001), (1, 20_000, 13), (3, 300, 300)]:
        x = rng.standard_normal(shape)
        for mode in ("fit", "wrap"):
            expected = whole(bank, 1, 61, x, mode, threads=1)
            assert bits(whole(bank, 1, 61, x, mode, threads=4)) == bits(expected)
            some = rng.integers(shape[0]), rng.integers(shape[2])
            alone = whole(bank, 1, 61, np.ascontiguousarray(x[some[0], :, some[1]])[None, :, None], mode)
            assert bits(alone[0, 0, :, 0]) == bits(expected[0, some[0], :, some[1]])


def test_long_windows_on_columns_have_the_bits_of_rows() -> None:
    x = np.random.default_rng(6).standard_normal((1, 9000, 11))
    for length, engine in ((3001, "moments"), (4501, "moments"), (3001, "direct")):
        bank = bank_of((1,), length, engine)
        for mode in ("fit", "mirror", "valid"):
            columns = whole(bank, 1, length, x, mode)
            for column in (0, 7, 8, 10):
                row = whole(bank, 1, length, np.ascontiguousarray(x[:, :, column : column + 1]), mode)
                assert bits(columns[..., column]) == bits(row[..., 0])


def test_half_sample_parts() -> None:
    rng = np.random.default_rng(7)
    bank = bank_of((1, 2), 12)
    x = rng.standard_normal((1, 80, 3))
    for mode in MODES:
        expected = whole(bank, 2, 12, x, mode, half_sample=True)
        for first in range(0, expected.shape[2] - 10, 3):
            out = np.empty((2, 1, 10, 3))
            bank.run(x.reshape(-1), out.reshape(-1), x.shape, mode, 0.5, half_sample=True, part=(0, 80, first))
            assert bits(out) == bits(expected[:, :, first : first + 10])


@pytest.mark.parametrize("length", [10, 11])
def test_aligned_valid_outputs_are_those_of_full_length(length: int) -> None:
    x = np.random.default_rng(8).standard_normal((2, 60, 1))
    bank = bank_of((1,), length, tau=0.73)
    full = whole(bank, 1, length, x, "nan")
    inside = full[:, :, ~np.isnan(full[0, 0, :, 0])]
    assert bits(whole(bank, 1, length, x, "valid", aligned=True)) == bits(inside)
    assert bits(whole(bank, 1, length, x, "valid")) != bits(inside)
