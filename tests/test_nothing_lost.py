"""Runs over files whatever the folder and the clock do; what they write, read by others."""

from __future__ import annotations

import ast
import csv
import io
import json
import os
import shutil
import struct
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff._cli import main
from algdiff._formats import chunks
from interrupted import LEFT, assert_result, small_blocks, stopped

CALL: dict[str, Any] = {"window_length": 21, "engine": "direct", "threads": 1}
X = np.random.default_rng(0).standard_normal((2, 20_000))


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run in a folder of one's own that holds `x.npy`, in blocks that are checkpoints."""
    monkeypatch.chdir(tmp_path)
    small_blocks(monkeypatch)
    monkeypatch.setattr(chunks, "CHUNK", 1 << 13)
    np.save("x.npy", X)
    return tmp_path


# --- folders that cannot be written ------------------------------------------------------------------------------


@pytest.fixture
def sealed() -> Iterator[Path]:
    """Return a folder with a recording that cannot be written: for root a mount, which its rights do not open."""
    folder = Path("sealed").resolve()
    folder.mkdir()
    if os.geteuid() != 0:
        shutil.copy("x.npy", folder)
        folder.chmod(0o500)
        yield folder
        folder.chmod(0o700)
        return
    mount, unmount = shutil.which("mount"), shutil.which("umount")
    if sys.platform != "linux" or mount is None or unmount is None:
        pytest.skip("cannot mount here")

    def mounted(*words: str) -> bool:
        return subprocess.run([mount, *words, str(folder)], capture_output=True, check=False).returncode == 0

    if not mounted("-t", "tmpfs", "-o", "size=1m", "tmpfs"):
        pytest.skip("may not mount here")
    shutil.copy("x.npy", folder)
    mounted("-o", "remount,ro")
    yield folder
    subprocess.run([unmount, "-l", str(folder)], check=True)


def test_a_folder_that_cannot_be_written(sealed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("y.npy", "y.csv", "y.npz"):
        with pytest.raises(PermissionError, match=rf"sealed/{name}: its folder cannot be written: use another$"):
            algdiff.differentiate_file("x.npy", sealed / name, **CALL)
    assert main(["run", "x.npy", f"{sealed}/y.npy", "--window", "21"]) == 1
    assert main(["report", "x.npy", "-o", f"{sealed}/y.html", "--window", "21"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all(line.startswith(f"algdiff: error: {sealed}/y.") for line in lines)
    assert os.listdir(sealed) == ["x.npy"]
    # What it holds can be read, and nothing is written beside it.
    algdiff.differentiate_file(sealed / "x.npy", "y.npy", **CALL)
    assert_result("y.npy", algdiff.differentiate(X, **CALL), {"x.npy", "sealed"})
    assert os.listdir(sealed) == ["x.npy"]


# --- clocks ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [-1e9, -3600.0, 3600.0, 1e9])
def test_the_clock_of_the_wall_may_be_set_during_a_run(step: float, monkeypatch: pytest.MonkeyPatch) -> None:
    told = iter(np.arange(10_000) * step + time.time())
    for name, unit in (("time", 1), ("time_ns", 10**9)):
        monkeypatch.setattr(time, name, lambda unit=unit: type(unit)(next(told) * unit))
    stopped("x.npy", "y.npy", **CALL)
    report = algdiff.differentiate_file("x.npy", "y.npy", **CALL, resume=True)
    assert 0 <= report.seconds < 60
    assert report.resumed > 0
    assert_result("y.npy", algdiff.differentiate(X, **CALL), {"x.npy"})


@pytest.mark.parametrize("written", [-1e9, 0.0, 4e9])
@pytest.mark.parametrize("left", [-1e9, 4e9])
def test_the_clock_may_be_set_between_a_run_and_the_next(written: float, left: float) -> None:
    # The input and what the first run left are of another century than the second run.
    try:
        os.utime("x.npy", (written, written))
        assert os.stat("x.npy").st_mtime == written
    except (OSError, AssertionError):
        pytest.skip("no such times in this file system")
    stopped("x.npy", "y.npy", **CALL)
    for name in LEFT:
        os.utime(name, (left, left))
    assert algdiff.differentiate_file("x.npy", "y.npy", **CALL, resume=True).resumed > 0
    assert_result("y.npy", algdiff.differentiate(X, **CALL), {"x.npy"})


# --- outputs, read by others -------------------------------------------------------------------------------------

Read = Callable[[str], Any]
ORDERS = (0, 1)


def _npy_by_hand(content: bytes) -> Any:
    assert content[:8] == b"\x93NUMPY\x01\x00"
    (length,) = struct.unpack("<H", content[8:10])
    said = ast.literal_eval(content[10 : 10 + length].decode("latin-1"))
    assert (said["descr"], said["fortran_order"]) == ("<f8", False)
    count = int(np.prod(said["shape"]))
    assert len(content) == 10 + length + 8 * count
    return np.reshape(struct.unpack(f"<{count}d", content[10 + length :]), said["shape"])


def _npz(path: str) -> Any:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        (name,) = archive.namelist()
        return _npy_by_hand(archive.read(name))


def _zarr_by_hand(path: str) -> Any:
    said = json.loads(Path(path, "zarr.json").read_text())
    assert [codec["name"] for codec in said["codecs"]] == ["bytes"]
    assert said["codecs"][0]["configuration"] == {"endian": "little"}
    whole, chunk = np.full(said["shape"], np.nan), said["chunk_grid"]["configuration"]["chunk_shape"]
    for file in Path(path, "c").rglob("*"):
        if file.is_file():
            place = map(int, file.relative_to(Path(path, "c")).parts)
            begin = [index * extent for index, extent in zip(place, chunk, strict=True)]
            numbers = np.frombuffer(file.read_bytes(), "<f8").reshape(chunk)
            parts = [slice(at, at + extent) for at, extent in zip(begin, chunk, strict=True)]
            inside = whole[tuple(parts)]
            inside[...] = numbers[tuple(slice(0, extent) for extent in inside.shape)]
    return whole


def _hdf5(path: str) -> Any:
    with pytest.importorskip("h5py").File(path) as file:
        return file["x"][...]


def _hdf5_by_hand(path: str) -> Any:
    with pytest.importorskip("h5py").File(path) as file:
        shape, offset = file["x"].shape, file["x"].id.get_offset()
    return np.frombuffer(Path(path).read_bytes(), "<f8", int(np.prod(shape)), offset).reshape(shape)


def _wav_by_hand(path: str) -> Any:
    content = Path(path).read_bytes()
    assert (content[:4], content[8:12]) == (b"RIFF", b"WAVE")
    assert struct.unpack("<I", content[4:8]) == (len(content) - 8,)
    found, place = {}, 12
    while place < len(content):
        name, size = struct.unpack("<4sI", content[place : place + 8])
        found[name], place = content[place + 8 : place + 8 + size], place + 8 + size + size % 2
    kind, channels, rate, _, _, bits = struct.unpack("<HHIIHH", found[b"fmt "][:16])
    assert (kind, rate, bits) == (3, 50, 64)
    return np.frombuffer(found[b"data"], "<f8").reshape(-1, channels)


def _csv(path: str) -> Any:
    with open(path, newline="", encoding="utf-8") as file:
        names, *rows = csv.reader(file)
    assert names == ["x0_d0", "x1_d0", "x0_d1", "x1_d1"]
    return np.array([[float(field) for field in row] for row in rows])


def _frame(name: str, *words: Any, **options: Any) -> Read:
    def read(path: str) -> Any:
        package, function = name.split(".")
        return getattr(pytest.importorskip(package), function)(path, *words, **options).to_numpy()

    return read


def _table(path: str) -> Any:
    return np.stack(pytest.importorskip("pyarrow.parquet").ParquetFile(path).read().columns, axis=1)


READERS: dict[str, tuple[Read, ...]] = {
    ".npy": (np.load, lambda path: _npy_by_hand(Path(path).read_bytes())),
    ".npz": (_npz, lambda path: np.load(io.BytesIO(Path(path).read_bytes()), allow_pickle=False)["arr_0"]),
    ".h5": (_hdf5, _hdf5_by_hand),
    ".zarr": (lambda path: pytest.importorskip("zarr").open_array(path, mode="r")[...], _zarr_by_hand),
    ".parquet": (_frame("polars.read_parquet"), _frame("pandas.read_parquet"), _table),
    ".wav": (lambda path: pytest.importorskip("scipy.io.wavfile").read(path)[1], _wav_by_hand),
    ".csv": (_csv, _frame("pandas.read_csv", dtype=str)),
    ".bin": (np.fromfile, lambda path: np.array(struct.unpack("<80000d", Path(path).read_bytes())).reshape(-1, 4)),
}
PACKAGES = {".h5": "h5py", ".zarr": "zarr", ".parquet": "pyarrow", ".wav": "soundfile"}
TABLES = (".parquet", ".wav", ".csv", ".bin")


@pytest.mark.parametrize("suffix", READERS)
def test_what_was_interrupted_and_finished_is_read_by_others(suffix: str) -> None:
    if suffix in PACKAGES:
        pytest.importorskip(PACKAGES[suffix])
    target, words = f"y{suffix}", {**CALL, "deriv": ORDERS, "fs": 50.0}
    stopped("x.npy", target, **words)
    assert algdiff.differentiate_file("x.npy", target, **words, resume=True).resumed > 0
    expected = algdiff.differentiate(X, **words)
    if suffix in TABLES:  # orders and channels side by side
        expected = expected.reshape(4, -1).T
    for read in READERS[suffix]:
        found = np.asarray(read(target), np.float64)
        np.testing.assert_array_equal(found.reshape(expected.shape), expected)
