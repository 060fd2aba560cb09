"""Files that promise more than any machine holds: they are refused, or planned, before memory is taken."""

from __future__ import annotations

import io
import json
import os
import struct
import sys
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from processes import printed_by

X = np.random.default_rng(0).standard_normal(5000)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run in a folder of one's own that holds a recording, `x.npy`."""
    monkeypatch.chdir(tmp_path)
    np.save("x.npy", X)


def _header(shape: tuple[int, ...]) -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return file.getvalue()


def _bomb(path: str, shape: tuple[int, ...]) -> None:
    """Write an archive of 10 GiB of zeros, whose only member is an array that a header says to have a shape."""
    start, packed = _header(shape), zlib.compressobj(9, wbits=-15)
    numbers = packed.compress(start) + packed.flush(zlib.Z_FULL_FLUSH) + _zeros(10 * GIGABYTE) + b"\x03\x00"
    sizes = len(numbers), len(start) + 10 * GIGABYTE
    large = struct.pack("<HHQQ", 1, 16, sizes[1], sizes[0])  # in the extra field, for they exceed 32 bits
    about = struct.pack("<HHHHHIIIHH", 45, 0, 8, 0, 33, 0, 2**32 - 1, 2**32 - 1, 5, len(large))
    entry = b"PK\x01\x02" + struct.pack("<H", 45) + about + struct.pack("<HHHII", 0, 0, 0, 0, 0) + b"x.npy" + large
    with open(path, "wb") as file:
        file.write(b"PK\x03\x04" + about + b"x.npy" + large + numbers)
        at = file.tell()
        file.write(entry + struct.pack("<4sHHHHIIH", b"PK\x05\x06", 0, 0, 1, 1, len(entry), at, 0))


def _wav(path: str, frames: int) -> None:
    about = struct.pack("<4sIHHIIHH", b"fmt ", 16, 3, 1, 50, 400, 8, 64)
    large = struct.pack("<4sIQQQI", b"ds64", 28, 8 * frames + 72, 8 * frames, frames, 0)
    start = struct.pack("<4sI4s", b"RF64", 2**32 - 1, b"WAVE")
    Path(path).write_bytes(start + large + about + struct.pack("<4sI", b"data", 2**32 - 1) + bytes(800))


def _zarr(path: str, shape: int, chunk: int, **array: Any) -> None:
    zarr = pytest.importorskip("zarr")
    zarr.create_array(path, data=X, chunks=(len(X),), **array)
    said = json.loads(Path(path, "zarr.json").read_text())
    said["shape"], said["chunk_grid"]["configuration"]["chunk_shape"] = [shape], [chunk]
    Path(path, "zarr.json").write_text(json.dumps(said))


def _zarr_bomb(path: str) -> None:
    _zarr(path, len(X), len(X), compressors=pytest.importorskip("zarr").codecs.GzipCodec())
    Path(path, "c", "0").write_bytes(zlib.compress(b"", 9, 31)[:10] + _zeros(GIGABYTE))


def _zeros(count: int) -> bytes:
    """Return zeros, packed, to be followed by the end of the stream."""
    packed = zlib.compressobj(9, wbits=-15)
    packed.compress(bytes(1))
    packed.flush(zlib.Z_FULL_FLUSH)
    return (packed.compress(bytes(1 << 20)) + packed.flush(zlib.Z_FULL_FLUSH)) * (count >> 20)


def _hdf5(path: str, shape: int, chunk: int, content: bytes | None = None) -> None:
    with pytest.importorskip("h5py").File(path, "w") as file:
        dataset = file.create_dataset("x", (shape,), "f8", chunks=(chunk,), compression="gzip")
        if content is not None:
            dataset.id.write_direct_chunk((0,), b"\x78\x9c" + content)


def _parquet(path: str) -> None:
    pa = pytest.importorskip("pyarrow")
    file = io.BytesIO()
    pytest.importorskip("pyarrow.parquet").write_table(pa.table({"x": X}), file)
    content = file.getvalue()
    (length,) = struct.unpack("<I", content[-8:-4])
    # Every number of rows and values, twice as varints, becomes another.
    footer = content[-8 - length : -8].replace(_varint(2 * len(X)), _varint(2 * HUGE))
    Path(path).write_bytes(content[: -8 - length] + footer + struct.pack("<I", len(footer)) + b"PAR1")


def _varint(number: int) -> bytes:
    digits = [number >> shift & 127 for shift in range(0, number.bit_length(), 7)]
    return bytes([*(digit | 128 for digit in digits[:-1]), digits[-1]])


HUGE, GIGABYTE, MEMORY = 2**45, 1 << 30, 64 << 20
ABSURD: dict[str, tuple[Callable[[str], Any], str]] = {
    "a.npy": (lambda path: Path(path).write_bytes(_header((HUGE,)) + bytes(99)), "takes 281474976710656 bytes"),
    "b.npy": (lambda path: Path(path).write_bytes(_header((HUGE, HUGE))), "not a whole array"),
    "c.npy": (lambda path: Path(path).write_bytes(_header((-5, -5)) + bytes(999)), "not a whole array"),
    "a.npz": (lambda path: _bomb(path, (10 << 27,)), "more than the 67108864 of memory: save it as .npy"),
    "b.npz": (lambda path: _bomb(path, (3,)), "takes 24 bytes, got 10737418240"),
    "c.npz": (lambda path: _bomb(path, (2**62,)), "not a whole array"),
    "a.wav": (lambda path: _wav(path, HUGE), "ends before its samples do"),
    "a.csv": (lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_RDWR), GIGABYTE), "longer than 64 MiB"),
    "a.h5": (lambda path: _hdf5(path, HUGE, 1 << 28), "memory must be at least 2147483648 bytes for a chunk"),
    "b.h5": (lambda path: _hdf5(path, 5000, 5000, _zeros(GIGABYTE)), "not a whole HDF5 file (filter returned failure"),
    "a.zarr": (lambda path: _zarr(path, HUGE, HUGE), "memory must be at least "),
    "b.zarr": (lambda path: _zarr(path, -3, 5), "not a whole Zarr store ("),
    "c.zarr": (_zarr_bomb, "Unable to allocate output buffer."),
    "a.parquet": (_parquet, f"must hold {HUGE} rows as when it was opened, got 5000"),
}
"""How files are made whose numbers take a gigabyte or more, and what is said of them."""
PACKAGES = {".h5": "h5py", ".zarr": "zarr", ".parquet": "pyarrow", ".wav": "soundfile"}


@pytest.mark.skipif(sys.platform != "linux", reason="limits its memory")
@pytest.mark.parametrize("suffix", [".npy", ".npz", ".csv", *PACKAGES])
def test_absurd_sizes_are_refused_before_memory_is_taken(suffix: str) -> None:
    if suffix in PACKAGES:
        pytest.importorskip(PACKAGES[suffix])
    names = [name for name in ABSURD if name.endswith(suffix)]
    for name in names:
        ABSURD[name][0](name)
    # Chunks of their own hide from stores those of their input.
    target = "y.zarr" if suffix in (".h5", ".zarr") else "y.csv"
    if target == "y.zarr":
        pytest.importorskip("zarr")
    # Arenas, of which every thread may reserve one of 64 MB, would take of the limit what they do not use.
    printed = printed_by(
        f"""
        import json, os, resource
        import algdiff

        def run(source, target):
            algdiff.differentiate_file(source, target, 21, fs=50, threads=1, memory={MEMORY}, overwrite=True)

        def taken(name):
            line = next(line for line in open("/proc/self/status") if line.startswith(name))
            return int(line.split()[1]) << 10

        run("x.npy", "z{suffix}")  # loads what the format needs
        run("z{suffix}", {target!r})
        resource.setrlimit(resource.RLIMIT_AS, (taken("VmSize") + {8 * MEMORY},) * 2)
        start, left, said = taken("VmRSS"), set(os.listdir()), {{}}
        for name in {names}:
            try:
                run(name, {target!r})
            except (ValueError, MemoryError) as error:
                said[name] = str(error)
            assert taken("VmHWM") < start + {9 * MEMORY}
        assert set(os.listdir()) == left
        run("z{suffix}", {target!r})
        print(json.dumps(said))
        """,
        MALLOC_ARENA_MAX="1",
    )
    said = json.loads(printed)
    assert set(said) == set(names)
    for name in names:
        assert ABSURD[name][1] in said[name]
        assert "\n" not in said[name]


@pytest.mark.parametrize("name", ["x.h5", "x.zarr", "x.bin"])
def test_plans_of_absurd_sizes_take_no_memory(name: str) -> None:
    words: dict[str, Any] = {}
    if name == "x.h5":
        _hdf5(name, HUGE, 5000)
    elif name == "x.zarr":
        _zarr(name, HUGE, 5000)
    else:
        words = {"dtype": "i1"}
        try:
            os.truncate(os.open(name, os.O_CREAT | os.O_RDWR), HUGE // 16)
        except OSError:
            pytest.skip("no such files here")
    tracemalloc.start()
    try:
        plan = algdiff.differentiate_file(name, "y.csv", 21, **words, memory=4 << 20, dry_run=True)
        assert plan.blocks > 10**6
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()
