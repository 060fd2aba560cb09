"""Cuts of files into blocks: what they cover, where they begin, and that they stay small."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

from algdiff import _places as places
from algdiff._blocks import Row
from algdiff._places import Cuts, TooLargeError

MODES = ["fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"]


def random_row(rng: np.random.Generator, samples: int) -> Row:
    """Return a row of a window that fits into it; windows that predict have centers beyond their ends."""
    mode = MODES[rng.integers(7)]
    span = int(rng.integers(1, max(samples, 1) + 1))
    center = 0 if mode == "valid" else int(rng.integers(-3, span + 3))
    outputs = samples + 1 - span if mode == "valid" and samples else samples
    return Row(samples, outputs, span, center, mode, int(rng.choice([1, 1, 8, 24, 64])), True)


def random_cuts(rng: np.random.Generator) -> dict[str, Any]:
    """Return the arguments of cuts."""
    dimensions = int(rng.integers(1, 5))
    shape = rng.integers(1, [400, 60, 16, 8][dimensions - 1], dimensions).tolist()
    axis = int(rng.integers(dimensions))
    shape[axis] = int(rng.integers(1, 300))
    if rng.random() < 0.1:
        shape[rng.integers(dimensions)] = 0
    row = random_row(rng, shape[axis])
    shape[axis] = row.outputs
    words: dict[str, Any] = {"shape": tuple(shape), "axis": axis, "row": row, "cost": int(rng.choice([3, 16, 100]))}
    words["fortran"] = bool(rng.random() < 0.3)
    words["rows"] = bool(rng.random() < 0.2)
    if rng.random() < 0.4:
        words["units"] = tuple(int(rng.integers(1, max(extent, 1) + 1)) for extent in shape)
        words["chunked"] = bool(rng.random() < 0.5)
    return words


def cut(rng: np.random.Generator, words: dict[str, Any]) -> tuple[Cuts, int]:
    """Return cuts with a budget that is just enough, a little more, or much more; and the budget."""
    try:
        Cuts(**words, budget=0)
        least = 0
    except TooLargeError as error:
        least = error.args[0]
        with pytest.raises(TooLargeError):
            Cuts(**words, budget=least - 1)
    budget = int(least * rng.choice([1.0, 1.0, 1.3, 3.0, 40.0])) + int(rng.integers(5))
    return Cuts(**words, budget=budget), budget


@pytest.fixture(params=range(6))
def cases(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Yield seeded cuts with their arguments."""

    def every() -> Any:
        for seed in range(60):
            rng = np.random.default_rng([17, request.param, seed])
            monkeypatch.setattr(places, "BLOCK", int(rng.choice([1, 1 << 10, 1 << 13, 1 << 16, 16 << 20])))
            words = random_cuts(rng)
            yield words, *cut(rng, words)

    return every()


def test_every_output_is_in_one_block(cases: Any) -> None:
    many = 0
    for words, cuts, _ in cases:
        covered = np.zeros(words["shape"], int)
        blocks = list(cuts)
        for place in blocks:
            assert covered[place].size > 0, words
            covered[place] += 1
        assert (covered == 1).all(), words
        assert len(cuts) == len(blocks)
        many += len(blocks) > 1
    assert many > 15


def test_no_block_is_above_the_budget(cases: Any) -> None:
    for words, cuts, budget in cases:
        row, axis = words["row"], words["axis"]
        assert cuts.bytes <= budget, words
        for place in cuts:
            sizes = [one.stop - one.start for one in place]
            start, end = row.reads(place[axis].start, place[axis].stop)
            samples = math.prod(sizes) // sizes[axis] * (end - start)
            assert words["cost"] * max(math.prod(sizes), samples) <= cuts.bytes, words


def test_blocks_are_whole_units(cases: Any) -> None:
    for words, cuts, _ in cases:
        shape, axis, row = words["shape"], words["axis"], words["row"]
        units = list(words.get("units", [1] * len(shape)))
        offsets = [0] * len(shape)
        if not words.get("chunked"):
            # Windows, which start `center` before their outputs, start on the grid of the engine.
            units[axis], offsets[axis] = row.grid, row.center % row.grid
        for place in cuts:
            for one, extent, unit, offset in zip(place, shape, units, offsets, strict=True):
                assert one.start == 0 or (one.start - offset) % unit == 0, words
                assert one.stop == extent or (one.stop - offset) % unit == 0, words


def test_blocks_are_as_long_as_their_windows(cases: Any) -> None:
    for words, cuts, _ in cases:
        axis = words["axis"]
        for place in cuts:
            length = place[axis].stop - place[axis].start
            last = place[axis].stop == words["shape"][axis]
            assert length >= words["row"].span or last, words


def test_tables_are_cut_between_rows_only(cases: Any) -> None:
    tables = 0
    for words, cuts, _ in cases:
        if not words["rows"]:
            continue
        for place in cuts:
            for axis, extent in enumerate(words["shape"]):
                assert axis == words["axis"] or place[axis] == slice(0, extent), words
        tables += len(cuts) > 1
    assert tables > 0


def test_neighbours_in_the_file_stay_together(cases: Any) -> None:
    for words, cuts, _ in cases:
        blocks = list(cuts)
        order = range(len(words["shape"])) if words["fortran"] else range(len(words["shape"]))[::-1]
        keys = [tuple(place[axis].start for axis in reversed(order)) for place in blocks]
        assert keys == sorted(keys), words  # from the first byte of the file to the last
        units = words.get("units", (1,) * len(words["shape"]))
        whole = True
        for axis in order:
            if axis != words["axis"] and not words["rows"] and blocks:
                assert whole or cuts.extents[axis] <= units[axis], words
            whole &= cuts.extents[axis] == words["shape"][axis]


def test_both_orders_of_axes_are_cut_alike(cases: Any) -> None:
    for words, cuts, budget in cases:
        mirrored = dict(words, shape=words["shape"][::-1], axis=len(words["shape"]) - 1 - words["axis"])
        mirrored["fortran"] = not words["fortran"]
        if "units" in words:
            mirrored["units"] = words["units"][::-1]
        others = Cuts(**mirrored, budget=budget)
        assert [place[::-1] for place in cuts] == list(others), words


@pytest.mark.parametrize("fortran", [False, True])
def test_what_is_small_is_one_block(fortran: bool) -> None:
    for shape, axis in itertools.chain(*([(s, a) for a in range(len(s))] for s in [(900,), (30, 40), (8, 9, 10)])):
        row = Row(shape[axis], shape[axis], 5, 2, "fit", 8, True)
        assert len(Cuts(shape, axis, row, cost=32, budget=1 << 28, fortran=fortran)) == 1


def test_the_halo_is_a_small_part_of_what_is_read() -> None:
    row = Row(10**9, 10**9, 10**6, 5 * 10**5, "fit", 64, True)
    cuts = Cuts((10**9,), 0, row, cost=32, budget=1 << 30)
    # Eight windows' worth with their halos is what a block grows to, if memory allows.
    assert 10**6 / cuts.extents[0] < 0.2
    short = Cuts((10**9,), 0, row._replace(span=101, center=50), cost=32, budget=1 << 30)
    assert places.BLOCK // 2 < short.bytes <= places.BLOCK + 32 * 64
