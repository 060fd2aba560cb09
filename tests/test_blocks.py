"""Data that are not contiguous floats: the bits of the contiguous ones, without a copy of the whole."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algdiff import Differentiator, savgol_filter
from algdiff import _blocks as blocks
from engines import bound

MODES = ["fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"]

WINDOWS: list[dict[str, Any]] = [
    {"window_length": 9},
    {"window_length": 8, "deriv": 2},
    {"window_length": 9, "tau": "newest"},
    {"window_length": 9, "tau": 0.0},
    {"window_length": 9, "tau": 1.6},
    {"window_length": 9, "tau": -0.7},
    {"window_length": 1, "deriv": 0, "degree": 0},
    {"window_length": 21, "deriv": (2, 0, 1)},
]

SHAPES = [((150,), 0), ((12, 50), 1), ((50, 12), 0), ((5, 30, 7), 1), ((30, 3, 4), 0), ((3, 1, 30), 2), ((9,), 0)]

LAYOUTS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "int16": lambda x: x.astype(np.int16),
    "bool": lambda x: x > 0,
    "half": lambda x: x.astype(np.float16),
    "big endian": lambda x: x.astype(">f8"),
    "big endian single": lambda x: x.astype(">f4"),
    "long double": lambda x: x.astype(np.longdouble),
    "strided": lambda x: np.repeat(x, 2, axis=0)[::2],
    "reversed": lambda x: x[..., ::-1].copy()[..., ::-1],
    "strided single": lambda x: np.repeat(x, 2, axis=-1).astype(np.float32)[..., ::2],
    "Fortran": np.asfortranarray,
    "Fortran int16": lambda x: np.asfortranarray(x.astype(np.int16)),
    "swapped": lambda x: np.swapaxes(np.swapaxes(x, 0, -1).copy(), 0, -1),
    "complex": lambda x: x + 1j * x[::-1],
    "complex single": lambda x: np.asfortranarray((x + 1j * x[::-1]).astype(np.complex64)),
    "repeated": lambda x: np.broadcast_to(x[:1], x.shape),
}


def plain(x: np.ndarray) -> np.ndarray:
    kind = np.float32 if x.dtype.kind == "f" and x.dtype.itemsize == 4 else np.float64
    return np.ascontiguousarray(x).astype(kind)


def whole(call: Callable[..., np.ndarray], x: np.ndarray, **options: Any) -> np.ndarray:
    """Return the result of one run over contiguous floats, for complex data of two."""
    if x.dtype.kind != "c":
        return call(plain(x), **options)
    real, imag = (plain(part) for part in (x.real, x.imag))
    single = x.dtype == np.complex64
    if single:
        real, imag = real.astype(np.float32), imag.astype(np.float32)
    result = call(real, **options).astype(np.complex64 if single else np.complex128)
    result.imag = call(imag, **{**options, "cval": 0.0} if "cval" in options else options)
    return result


@pytest.fixture(params=[320, 4000])
def small_blocks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "BYTES", request.param)
    monkeypatch.setattr(blocks, "COLUMNS", 3)


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("kind", LAYOUTS)
@pytest.mark.parametrize("mode", MODES)
def test_blocks_have_the_bits_of_the_whole(mode: str, kind: str) -> None:
    rng = np.random.default_rng(3)
    for number, window in enumerate(WINDOWS):
        design = Differentiator(**window, engine="direct")
        for shape, axis in SHAPES[number % 3 :: 3]:
            if shape[axis] < design.window_length and mode in ("fit", "valid", "nan"):
                continue
            x = LAYOUTS[kind](100 * rng.standard_normal(shape))
            options = {"axis": axis, "mode": mode, "cval": 2.5}
            expected = whole(design, x, **options)
            got = design(x, **options)
            assert (got.shape, got.dtype) == (expected.shape, expected.dtype)
            np.testing.assert_array_equal(got, expected, err_msg=f"{window} {shape} {axis}")
            out = np.zeros(expected.shape[::-1], expected.dtype).T
            assert design(x, **options, out=out) is out
            np.testing.assert_array_equal(out, expected)
            wide = np.zeros((*expected.shape, 2), expected.dtype)[..., 1]
            design(plain(x) if x.dtype.kind != "c" else x, **options, out=wide)
            np.testing.assert_array_equal(wide, expected)


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("mode", ["interp", "mirror", "nearest", "constant", "wrap"])
def test_filters_between_samples(mode: str) -> None:
    x = (100 * np.random.default_rng(3).standard_normal((70, 4))).astype(np.int16)
    for length in (10, 11):
        got = savgol_filter(x, length, 3, deriv=1, axis=0, mode=mode, cval=1.0, engine="direct")
        expected = savgol_filter(plain(x), length, 3, deriv=1, axis=0, mode=mode, cval=1.0, engine="direct")
        np.testing.assert_array_equal(got, expected)


def test_a_window_longer_than_extended_data() -> None:
    x = np.arange(12, dtype=np.int8) ** 2 % 11
    design = Differentiator(101, engine="direct")
    for mode in ("nearest", "mirror", "wrap", "constant"):
        np.testing.assert_array_equal(design(x, mode=mode), design(x.astype(float), mode=mode))
    for mode in ("fit", "valid", "nan"):
        with pytest.raises(ValueError, match="window_length must be at most the 12 samples of x"):
            design(x, mode=mode)
    with pytest.raises(ValueError, match="mode must be"):
        design(x, mode="zero")


@pytest.mark.parametrize("engine", ["auto", "direct"])
@pytest.mark.parametrize("window_length", [61, 1001, 7001])
def test_blocks_of_the_usual_size(window_length: int, engine: str) -> None:
    design = Differentiator(window_length, engine=engine)
    x = np.random.default_rng(1).integers(-1000, 1000, 350_000).astype(np.int16)
    # Only direct gives the same bits whatever the cuts; the bound holds on either side.
    allowed = 0.0 if design.engine == "direct" else 2 * bound(design.engine, design, x.astype(float)).max()
    for mode in ("fit", "wrap"):
        np.testing.assert_allclose(design(x, mode=mode), design(x.astype(float), mode=mode), rtol=0, atol=allowed)
    columns = x.reshape(17_500, 20)
    np.testing.assert_allclose(design(columns, 0), design(columns.astype(float), 0), rtol=0, atol=allowed)


def test_axes_in_any_order_are_seen_through(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a block")

    monkeypatch.setattr(blocks._Blocks, "run", refuse)
    x = np.random.default_rng(0).standard_normal((20, 30, 40))
    design = Differentiator(11, (0, 1))
    for axes in [(0, 1, 2), (2, 1, 0), (1, 0, 2), (2, 0, 1)]:
        for axis in range(3):
            got = design(x.transpose(axes), axis)
            np.testing.assert_array_equal(got, np.ascontiguousarray(got))
            expected = design(x, axes[axis]).transpose(0, *(1 + index for index in axes))
            np.testing.assert_array_equal(got, expected)
            assert got[0].strides == x.transpose(axes).strides


def test_progress_rises_over_all_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "INTERVAL", 0.0)
    for x in (np.zeros(1_000_000, np.int16), np.zeros((1000, 800), np.complex64)):
        seen: list[float] = []
        Differentiator(301)(x, 0, progress=seen.append, threads=1)
        assert len(seen) >= 4
        assert seen == sorted(seen)
        assert seen[0] > 0
        assert seen[-1] == 1


def test_an_exception_in_progress_stops_between_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    class StopError(Exception):
        pass

    def progress(fraction: float) -> None:
        if fraction > 0.5:
            raise StopError

    monkeypatch.setattr(blocks, "INTERVAL", 0.0)
    out = np.full(2_000_000, 7.0)
    with pytest.raises(StopError):
        Differentiator(11)(np.zeros(2_000_000, np.int16), progress=progress, out=out)
    assert out[0] == 0
    assert out[-1] == 7


MEMORY = """
    import sys, threading
    import numpy as np
    from algdiff import Differentiator

    def anonymous():
        with open("/proc/self/status") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("RssAnon"))

    def watch():
        while not done.wait(0.002):
            seen.append(anonymous())

    rows, columns = 5_000_000, 2
    x = np.memmap("x", np.int16, "w+", shape=(rows, columns))
    x[:] = np.arange(columns)
    out = np.memmap("out", np.float64, "w+", shape=(rows, columns))
    design = Differentiator(301)
    calls = {
        "axis 0": lambda: design(x, 0, out=out),
        "one row": lambda: design(x.reshape(-1), out=out.reshape(-1)),
        "wrapped": lambda: design(x, 0, out=out, mode="wrap"),
        "strided out": lambda: design(x[:, 0], out=out[:, 0]),
        "complex": lambda: design(x.view(np.float32).reshape(-1, 2).view(np.complex64)[:, 0],
            out=out.reshape(-1)[: rows // 2].view(np.complex64)),
        "many short rows": lambda: design(x.reshape(10_000, 1000), out=out.reshape(10_000, 1000)),
        "other order": lambda: design(x.T, out=out.T),
    }
    design(x[:1000], 0), design(np.zeros((1000, 2), np.float32), 0)
    for name, call in calls.items():
        before, seen, done = anonymous(), [], threading.Event()
        watcher = threading.Thread(target=watch)
        watcher.start()
        call()
        done.set()
        watcher.join()
        print(name, max(seen) - before, sep=",")
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_memory_beyond_input_and_output(tmp_path: Path) -> None:
    command = [sys.executable, "-c", textwrap.dedent(MEMORY)]
    environment = {**os.environ, "ALGDIFF_NUM_THREADS": "2"}
    result = subprocess.run(
        command, capture_output=True, text=True, timeout=100, cwd=tmp_path, env=environment, check=False
    )
    assert result.returncode == 0, result.stderr
    used = {name: int(kilobytes) for name, kilobytes in (line.split(",") for line in result.stdout.splitlines())}
    assert len(used) == 7
    # A copy of the whole would be 40,000 or more.
    assert max(used.values()) <= 8192, used
