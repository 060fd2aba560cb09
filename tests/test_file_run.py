"""Files differentiated into files, against the same arrays in memory."""

from __future__ import annotations

import itertools
import json
import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import _file_job
from algdiff import _places as places
from support import sum_bound

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")

MODES = ["fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"]
REAL = ["?", "i1", "u1", "<i2", ">i2", "u2", "i4", ">u4", "i8", ">u8", "f2", ">f2", "f4", ">f4", "f8", ">f8", "g"]
COMPLEX = ["c8", ">c8", "c16", ">c16", "G"]
SHAPES = [(5000,), (4, 900), (900, 5), (3, 400, 4), (2, 3, 5, 120)]
LEAST, MEMORY = 1 << 20, 1 << 23


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run in a folder of one's own, with blocks of a few samples."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(places, "BLOCK", 1 << 12)
    return tmp_path


def samples(rng: np.random.Generator, shape: tuple[int, ...], dtype: str) -> np.ndarray[Any, Any]:
    """Return numbers of all sizes that the type can hold, in C or Fortran order."""
    kind = np.dtype(dtype).kind
    if kind in "iu":
        limits = np.iinfo(dtype)
        x = rng.integers(limits.min, limits.max, shape, np.dtype(dtype).newbyteorder("="), endpoint=True).astype(dtype)
    elif kind == "b":
        x = rng.random(shape) < 0.5
    else:
        x = 100 * rng.standard_normal(shape)
        x = (x + 1j * rng.permutation(x, axis=-1) if kind == "c" else x).astype(dtype)
        if rng.random() < 0.2 and x.size:
            x.flat[rng.integers(x.size)] = rng.choice([np.nan, np.inf, -np.inf])
    return np.asfortranarray(x) if rng.random() < 0.4 else x


def random_call(rng: np.random.Generator, count: int) -> dict[str, Any]:
    """Return a window that fits into rows of some samples, and everything else."""
    degree = int(rng.integers(1, 5))
    most = int(rng.choice([min(count, 40), count]))
    length = int(rng.integers(degree + 1, most + 1))
    engines = ["auto", "direct", "fft"] + ["moments"] * (31 <= length <= 2000 and degree <= 3)
    orders = list(range(degree + 1))
    return {
        "window_length": length,
        "deriv": int(rng.integers(degree + 1)) if rng.random() < 0.6 else tuple(orders[:: rng.choice([-1, 1, 2])]),
        "degree": degree,
        "kappa": float(rng.integers(2)),
        "mu": float(rng.integers(2)),
        "tau": [0.5, 1.0, 0.8, 1.1, "center", "newest"][rng.integers(6)],
        "delta": float(rng.choice([1.0, 0.01])),
        "engine": str(rng.choice(engines)),
        "mode": MODES[rng.integers(7)],
        "cval": float(rng.choice([0.0, 2.5])),
        "threads": int(rng.integers(1, 4)),
    }


def stored(rng: np.random.Generator, x: np.ndarray[Any, Any]) -> tuple[str, dict[str, Any]]:
    """Write the array into a file; return its name and how it is to be read."""
    if x.ndim > 2 or rng.random() < 0.6:
        np.save("x.npy", x)
        return "x.npy", {}
    offset = int(rng.choice([0, 3, 4096]))
    with open("x.raw", "wb") as file:
        file.write(b"\xff" * offset)
        file.write(x.tobytes())  # in C order
    channels = {} if x.ndim == 1 else {"channels": x.shape[1]}
    return "x.raw", {"dtype": x.dtype, "offset": offset, **channels}


def read(report: algdiff.FileReport, axis: int) -> np.ndarray[Any, Any]:
    """Read back the result."""
    if report.target.endswith(".npy"):
        return np.load(report.target)
    # Rows of all channels, for one order after the other.
    several = isinstance(report.deriv, tuple)
    shape = report.result_shape[several:]
    channels = shape[:axis] + shape[axis + 1 :]
    orders = report.result_shape[:1] if several else (1,)
    rows = np.fromfile(report.target, report.result_dtype).reshape(shape[axis], *orders, *channels)
    result = np.moveaxis(rows, 0, 1 + axis)
    return np.ascontiguousarray(result if several else result[0])


def assert_same(found: np.ndarray[Any, Any], x: np.ndarray[Any, Any], call: dict[str, Any], axis: int) -> None:
    """Compare with the array in memory: to the bit, or by the engine "fft" to rounding."""
    expected = algdiff.differentiate(x, axis=axis, **call)
    assert (found.shape, found.dtype) == (expected.shape, expected.dtype)
    design = {name: value for name, value in call.items() if name not in ("mode", "cval", "threads")}
    if algdiff.Differentiator(**design).engine_for(x.dtype) != "fft":
        assert found.tobytes() == expected.tobytes()
        return
    orders = call["deriv"] if isinstance(call["deriv"], tuple) else (call["deriv"],)
    pairs = zip(found, expected, strict=True) if isinstance(call["deriv"], tuple) else [(found, expected)]
    inside = x[np.isfinite(x)] if x.dtype.kind in "fc" else x
    for order, (one, other) in zip(orders, pairs, strict=True):
        weights = algdiff.Differentiator(**{**design, "deriv": order, "engine": "direct"}).weights
        # The bound for a sum of any order, of both.
        working = np.finfo(expected.dtype).eps
        bound = 2 * sum_bound(weights, [0, np.abs(inside).max(), call["cval"]], working)
        np.testing.assert_array_equal(np.isnan(one), np.isnan(other))
        assert np.nanmax(np.abs(one - other), initial=0) <= bound


@pytest.mark.parametrize("dtype", REAL + COMPLEX)
def test_files_are_differentiated_as_arrays_are(dtype: str) -> None:
    blocks = 0
    for seed, shape in itertools.product(range(4), SHAPES):
        rng = np.random.default_rng([71, (REAL + COMPLEX).index(dtype), seed, *shape])
        axis = int(np.argmax(shape)) if rng.random() < 0.7 else int(rng.integers(len(shape)))
        while shape[axis] < 6:
            axis = (axis + 1) % len(shape)
        x = samples(rng, shape, dtype)
        call = random_call(rng, shape[axis])
        name, reading = stored(rng, x)
        target = str(rng.choice(["y.npy", "y.bin"])) if len(shape) < 3 else "y.npy"
        seen: list[float] = []
        report = algdiff.differentiate_file(
            name,
            target,
            **call,
            **reading,
            axis=axis - rng.choice([0, len(shape)]),
            memory=MEMORY,
            progress=seen.append,
        )
        found = read(report, axis)
        assert_same(found, x, call, axis)
        if target == "y.npy" and name == "x.npy" and x.ndim > 1 and x.flags.fnc:
            assert found.flags.f_contiguous
        assert seen == sorted(seen)
        assert 0 <= seen[0] <= seen[-1] == 1
        assert report.memory <= MEMORY // 4
        assert sorted(os.listdir()) == [name, target]
        os.remove(name), os.remove(target)
        blocks += report.blocks
    assert blocks > 60


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("shape", [(0,), (0, 40), (40, 0), (3, 0, 40), (1, 40)])
def test_rows_that_are_empty_or_as_long_as_the_window(shape: tuple[int, ...], mode: str) -> None:
    x = np.random.default_rng(3).standard_normal(shape)
    np.save("x.npy", x)
    for axis, length in itertools.product(range(len(shape)), [2, 39, 40]):
        call: dict[str, Any] = {"window_length": length, "deriv": (1, 0), "degree": 1, "mode": mode, "engine": "direct"}
        if length > shape[axis] and mode in ("fit", "valid", "nan"):
            said = f"^window_length must be at most the {shape[axis]} samples of x.npy in mode '{mode}', got {length}$"
            with pytest.raises(ValueError, match=said):
                algdiff.differentiate_file("x.npy", "y.npy", axis=axis, **call)
            assert os.listdir() == ["x.npy"]
            continue
        expected = algdiff.differentiate(x, axis=axis, **call)
        report = algdiff.differentiate_file("x.npy", "y.npy", axis=axis, **call)
        assert report.result_shape == expected.shape
        assert np.load("y.npy").tobytes() == expected.tobytes()
        os.remove("y.npy")


def test_raw_files_without_a_sample() -> None:
    Path("x.bin").touch()
    report = algdiff.differentiate_file("x.bin", "y.npy", 5, dtype="f4", channels=3, mode="nearest")
    assert (report.shape, report.blocks, report.bytes_read) == ((0, 3), 0, 0)
    assert np.load("y.npy").shape == (0, 3)


def test_too_little_memory_names_what_is_enough() -> None:
    np.save("x.npy", np.random.default_rng(0).standard_normal((2, 300_000)))
    for length, deriv, mode in [(200_001, 1, "fit"), (90_001, (0, 1), "wrap"), (150_000, 1, "valid")]:
        call: dict[str, Any] = {"window_length": length, "deriv": deriv, "mode": mode, "overwrite": True}
        with pytest.raises(ValueError, match=r"memory must be at least \d+ bytes .* of x.npy, got 1048576$") as caught:
            algdiff.differentiate_file("x.npy", "y.npy", **call, memory=LEAST)
        enough = int(re.findall("[0-9]+", str(caught.value))[0])
        with pytest.raises(ValueError, match=f"memory must be at least {enough} bytes"):
            algdiff.differentiate_file("x.npy", "y.npy", **call, memory=enough - 1)
        assert os.listdir() == ["x.npy"]
        plan = algdiff.differentiate_file("x.npy", "y.npy", **call, memory=enough, dry_run=True)
        assert plan.blocks >= 2
    with pytest.raises(ValueError, match=f"^memory must be an integer of at least {LEAST}, got {LEAST - 1}$"):
        algdiff.differentiate_file("x.npy", "y.npy", 5, memory=LEAST - 1)


def test_reports_are_right() -> None:
    x = np.random.default_rng(0).integers(-9, 9, (3, 5000, 2)).astype(">i2")
    np.save("x.npy", x)
    words: dict[str, Any] = {"window_length": np.int64(101), "deriv": (0, 2), "degree": 3, "tau": np.float32(0.75)}
    report = algdiff.differentiate_file("x.npy", Path("y.npy"), **words, fs=np.float64(50), axis=-2, threads=1)
    design = algdiff.Differentiator(**words, delta=0.02)
    assert (report.source, report.target, report.shape, report.dtype) == ("x.npy", "y.npy", x.shape, "int16")
    assert (report.result_shape, report.result_dtype, report.axis) == ((2, *x.shape), "float64", 1)
    assert (report.window_length, report.deriv, report.delta) == (101, (0, 2), 0.02)
    assert (report.delay, report.noise_gain, report.engine) == (design.delay, design.noise_gain, design.engine)
    assert (report.bytes_read, report.bytes_written) == (x.nbytes, np.load("y.npy").nbytes)
    assert (report.resumed, report.dry_run) == (0, False)
    assert report.blocks == math.prod(
        math.ceil(size / part) for size, part in zip(x.shape, report.block_shape, strict=True)
    )
    assert report.blocks > 1
    assert 0 < report.seconds < 60
    copy = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert {name: tuple(value) if isinstance(value, list) else value for name, value in copy.items()} == vars(report)


def test_a_dry_run_writes_nothing_and_tells_the_same() -> None:
    np.save("x.npy", np.random.default_rng(0).standard_normal((3, 5000)))
    before = os.stat("x.npy")
    plan = algdiff.differentiate_file("x.npy", "y.npy", 51, (0, 1), dry_run=True, progress=pytest.fail)
    assert os.listdir() == ["x.npy"]
    assert os.stat("x.npy").st_mtime_ns == before.st_mtime_ns
    assert plan.seconds > 0
    done = algdiff.differentiate_file("x.npy", "y.npy", 51, (0, 1))
    differ = {name for name, value in vars(done).items() if value != getattr(plan, name)}
    assert differ == {"dry_run", "seconds"}
    with pytest.raises(FileExistsError, match=r"^y\.npy: exists; give overwrite=True to replace it$"):
        algdiff.differentiate_file("x.npy", "y.npy", 51, dry_run=True)


def test_the_step_is_stated_or_counts_as_one() -> None:
    np.save("x.npy", np.arange(100.0))
    report = algdiff.differentiate_file("x.npy", "y.npy", 5)
    assert report.delta is None
    assert np.allclose(np.load("y.npy"), 1)
    assert algdiff.differentiate_file("x.npy", "y.npy", 5, delta=0.5, overwrite=True).delta == 0.5
    assert np.allclose(np.load("y.npy"), 2)
    with pytest.raises(ValueError, match="delta"):
        algdiff.differentiate_file("x.npy", "y.npy", 5, delta=0.5, fs=2, overwrite=True)


@pytest.mark.parametrize("fortran", [False, True])
def test_no_block_holds_more_than_it_may(fortran: bool, monkeypatch: pytest.MonkeyPatch) -> None:

    held: list[int] = []
    take = _file_job.Buffers.take

    def counted(self: Any, *args: Any, **words: Any) -> Any:
        taken = take(self, *args, **words)
        held.append(sum(room.size for room in self.held))
        return taken

    monkeypatch.setattr(_file_job.Buffers, "take", counted)
    x = np.random.default_rng(0).standard_normal((40, 3000))
    np.save("x.npy", np.asfortranarray(x) if fortran else x)
    for axis, length in [(0, 21), (1, 21), (1, 500)]:
        held.clear()
        report = algdiff.differentiate_file("x.npy", "y.npy", length, axis=axis, overwrite=True, memory=LEAST)
        assert report.blocks > 3
        # Inputs and outputs have buffers of their own.
        assert max(held) <= report.memory <= LEAST // 4
