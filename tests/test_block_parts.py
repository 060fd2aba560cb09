"""Parts of rows of any dtype and layout, block by block: the bits of the whole; of "fft" its bound."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import _blocks
from algdiff._arguments import working_dtype
from algdiff._layout import like

MODES = ("fit", "valid", "nan", "nearest", "mirror", "wrap", "constant")
DTYPES = ("f8", "f4", ">f8", "i2", "f2", "c16", "c8")


def unrolled(x: Any, axis: int, start: int, end: int, mode: str) -> Any:
    """Return the samples from `start` to `end`, beyond the row those of a periodic one."""
    if mode == "wrap":
        return np.take(x, np.arange(start, end) % x.shape[axis], axis=axis)
    where = [slice(None)] * x.ndim
    where[axis] = slice(start, end)
    return x[tuple(where)]


def in_parts(design: Any, x: Any, axis: int, mode: str, cval: complex, bounds: list[int], grid: int) -> Any:
    """Return the estimates put together from the parts between `bounds`."""
    row = _blocks.Row.of(design._plan, mode, x.shape[axis], grid)
    orders, found = len(design._plans), []
    for first, last in itertools.pairwise(bounds):
        start, end = row.reads(first, last)
        held = unrolled(x, axis, start, end, mode)
        shape = (*x.shape[:axis], last - first, *x.shape[axis + 1 :])
        result = like(held, (orders, *shape), working_dtype(x.dtype))
        _blocks.run_part(design._bank, row, held, result, axis, cval, start=start, first=first, threads=2)
        found.append(result)
    joined = np.concatenate(found, axis=1 + axis)
    return joined if design._leading is not None else joined[0]


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("engine", ["direct", "moments", "fft"])
def test_parts_have_the_bits_of_the_whole(monkeypatch: pytest.MonkeyPatch, engine: str, mode: str) -> None:
    rng = np.random.default_rng([len(engine), MODES.index(mode)])
    for trial in range(40):
        monkeypatch.setattr(_blocks, "BYTES", int(rng.choice([1 << 10, 1 << 14, 1 << 20])))
        length = int(rng.integers(*((60, 100) if engine == "moments" else (5, 40))))
        dtype = np.dtype(DTYPES[trial % len(DTYPES)])
        shape, axis = [((400,), 0), ((3, 300), 1), ((300, 5), 0), ((2, 200, 3), 1)][trial % 4]
        x = (100 * rng.standard_normal(shape)).astype(dtype)
        if trial % 3 == 0:
            x = np.asfortranarray(x)
        design = algdiff.Differentiator(
            length, [1, (0, 1)][trial % 2], degree=3, tau=float(rng.choice([0.5, 0.9])), engine=engine
        )
        cval = 2.5 + 1j if dtype.kind == "c" else 2.5
        expected = design(x, axis, mode=mode, cval=cval)
        outputs = expected.shape[axis - x.ndim]
        grid = design._bank.grid(single=working_dtype(dtype) in (np.float32, np.complex64))
        center = 0 if mode == "valid" else design._plan.aligned_position
        on_grid = np.arange(center % grid, outputs, grid)
        cuts = on_grid if len(on_grid) < 4 else rng.choice(on_grid, 3, replace=False)
        bounds = sorted({0, *map(int, cuts), outputs})
        found = in_parts(design, x, axis, mode, cval, bounds, grid)
        assert found.dtype == expected.dtype
        if engine == "fft":
            # Transforms of columns take in what lies beyond the data, as far as they are at hand.
            eps = np.finfo(expected.dtype).eps
            np.testing.assert_allclose(found, expected, rtol=0, atol=64 * eps * float(np.nanmax(np.abs(expected))))
        else:
            assert found.tobytes() == np.ascontiguousarray(expected).tobytes(), (trial, bounds)
