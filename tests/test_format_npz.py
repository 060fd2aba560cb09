"""Arrays in ``.npz`` files: what NumPy writes and reads, files that are broken or promise too much."""

from __future__ import annotations

import io
import os
import struct
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algdiff import _formats as formats
from algdiff._formats import npz
from algdiff._formats.base import Layout, Options
from algdiff._formats.stage import Stage

DTYPES = ["?", "i1", "u2", ">i4", "i8", "u8", "f2", "f4", ">f4", "f8", ">f8", "c8", "c16", ">c16"]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(npz, "PIECE", 1000)


def source_of(**options: Any) -> Any:
    return formats.open_source(formats.located("src", "x.npz"), Options(**options))


def read(source: Any, place: tuple[slice, ...]) -> np.ndarray:
    shape = [one.stop - one.start for one in place]
    out = np.empty(shape, source.dtype, order="F" if source.fortran else "C")
    assert source.read(place, out) is None
    return out


def error_of(**options: Any) -> str:
    with pytest.raises(ValueError, match=r".") as info:
        source_of(**options)
    assert "\n" not in str(info.value)
    return str(info.value)


def member(content: bytes, name: str = "x.npy", **more: Any) -> None:
    with zipfile.ZipFile("x.npz", "w", **more) as archive:
        archive.writestr(name, content)


def saved(data: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, data)
    return file.getvalue()


def header(shape: Any, descr: Any = "<f8", fortran: bool = False) -> bytes:
    text = repr({"descr": descr, "fortran_order": fortran, "shape": shape}).encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


# --- reading -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", DTYPES)
def test_every_type_and_order(dtype, order):
    rng = np.random.default_rng(DTYPES.index(dtype))
    for shape in ((1,), (900,), (0, 3), (40, 30), (7, 8, 9), (3, 4, 5, 6)):
        data = np.array(100 * rng.random(shape), order=order).astype(dtype)
        for save in (np.savez, np.savez_compressed):
            save("x.npz", data)
            with source_of() as source:
                assert (source.shape, source.dtype.str) == (shape, data.dtype.str)
                assert source.fortran == (order == "F" and len(shape) > 1 and data.size > 0)
                assert (source.step, source.axis, source.chunks) == (None, -1, None)
                for _ in range(10):
                    place = tuple(slice(*sorted(rng.integers(0, extent + 1, 2).tolist())) for extent in shape)
                    np.testing.assert_array_equal(read(source, place), data[place])


def test_names():
    np.savez("x.npz", counts=np.arange(3), speed=np.arange(4.0))
    assert error_of() == "key must name one array of x.npz (counts, speed), got nothing"
    assert error_of(key="dt") == "key must name one array of x.npz (counts, speed), got 'dt'"
    with source_of(key="speed") as source:
        assert source.shape == (4,)
    np.savez("x.npz", **{"a/b é": np.arange(5)})
    for key in (None, "a/b é"):
        with source_of(key=key) as source:
            assert source.shape == (5,)
    np.savez("x.npz")
    assert error_of() == "key must name one array of x.npz (it has none), got nothing"
    member(b"1,2,3", "x.csv")
    assert "(it has none)" in error_of(key="x")


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_every_cut_is_seen(method):
    data = np.random.default_rng(1).standard_normal(50)
    member(saved(data), compression=method)
    with source_of() as source:
        np.testing.assert_array_equal(read(source, (slice(0, 50),)), data)
    whole = Path("x.npz").read_bytes()
    for cut in range(0, len(whole), 11):
        Path("x.npz").write_bytes(whole[:cut])
        assert error_of().startswith("x.npz: not a whole .npz file (")


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_damage_is_seen_or_does_no_harm(method):
    data = np.random.default_rng(1).standard_normal(50)
    member(saved(data), compression=method)
    whole = Path("x.npz").read_bytes()
    rng = np.random.default_rng(2)
    seen = 0
    for _ in range(200):
        content = bytearray(whole)
        content[rng.integers(len(whole))] ^= 1 << int(rng.integers(8))
        Path("x.npz").write_bytes(content)
        try:
            with source_of() as source:
                np.testing.assert_array_equal(read(source, (slice(0, 50),)), data)
        except ValueError as error:
            assert str(error).startswith(("x.npz: ", "key must name"))  # noqa: PT017
            seen += 1
    assert seen > 100


def test_files_that_are_not_there():
    with pytest.raises(FileNotFoundError) as info:
        source_of()
    assert info.value.filename == "x.npz"
    Path("x.npz").mkdir()
    with pytest.raises(IsADirectoryError):
        source_of()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "array 'x': not a whole .npy array"),
        (b"1,2,3", "array 'x': not a whole .npy array"),
        (saved(np.arange(9.0))[:-1], "shape (9,) of float64 takes 72 bytes, got 71"),
        (saved(np.arange(9.0)) + b"x", "shape (9,) of float64 takes 72 bytes, got 73"),
        (saved(np.array(["a"])), "array 'x' must hold real or complex numbers, got dtype <U1"),
        (saved(np.zeros(3, "M8[s]")), "must hold real or complex numbers, got dtype datetime64[s]"),
        (saved(np.zeros(3, [("a", float)])), "must hold real or complex numbers, got dtype [('a', '<f8')]"),
        (header((3,), "|O") + bytes(24), "must hold real or complex numbers, got Python objects"),
        (header((-3,)), "array 'x': not a whole array"),
        (header((2**62,)), "array 'x': not a whole array"),
        (header((10**40, 0)), "array 'x': not a whole array"),
        (header((1,) * 99) + bytes(8), "array 'x': not a whole array"),
        (header((2**50,)), f"takes {2**53} bytes, got 0"),
    ],
)
def test_what_is_no_array_of_numbers(content, said):
    member(content)
    message = error_of(memory=1 << 30)
    assert message.startswith("x.npz: array 'x'")
    assert said in message


def test_nothing_is_unpacked_beyond_what_the_header_promises():
    # 100 MB of zeros in 100 kB: as numbers that no header promises, and as a header.
    for start in (saved(np.arange(9.0)), b"\x93NUMPY\x02\x00" + struct.pack("<I", 100_000_000)):
        with (
            zipfile.ZipFile("x.npz", "w", zipfile.ZIP_DEFLATED) as archive,
            archive.open("x.npy", "w") as file,
        ):
            file.write(start)
            for _ in range(100):
                file.write(bytes(1_000_000))
        tracemalloc.start()
        try:
            assert "not a whole .npy array" in error_of()
            assert tracemalloc.get_traced_memory()[1] < 5e6
        finally:
            tracemalloc.stop()


def test_a_directory_that_promises_too_much():
    # The directory of the zip file and the header agree on 2 GiB, of which nothing is there.
    member(header((2**28,)))
    content = Path("x.npz").read_bytes()
    start = content.index(b"PK\x01\x02")
    size = struct.unpack("<I", content[start + 24 : start + 28])[0]
    Path("x.npz").write_bytes(content[: start + 24] + struct.pack("<I", size + 2**31) + content[start + 28 :])
    assert error_of(memory=2**31 - 1).endswith("more than the 2147483647 of memory: save it as .npy")


def test_memory():
    data = np.arange(1000.0)
    np.savez_compressed("x.npz", speed=data)
    expected = "x.npz: array 'speed' takes 8000 bytes, more than the 7999 of memory: save it as .npy"
    assert error_of(memory=7999) == expected
    for memory in (8000, None):
        with source_of(memory=memory) as source:
            np.testing.assert_array_equal(read(source, (slice(0, 1000),)), data)


def test_encrypted_and_unknown_compression():
    member(saved(np.arange(9.0)))
    whole = Path("x.npz").read_bytes()
    start = whole.index(b"PK\x01\x02")
    for offset, said in ((8, "encrypted"), (10, "compression")):
        content = bytearray(whole)
        place = offset - 2  # in the local header
        content[place] = content[start + offset] = 1 if offset == 8 else 77
        Path("x.npz").write_bytes(content)
        message = error_of()
        assert message.startswith("x.npz: not a whole .npz file (")
        assert said in message


# --- writing -----------------------------------------------------------------------------------------------------


def written(result: np.ndarray, *, leading: bool = False, **more: Any) -> bytes:
    """Write a result, with a leading axis over the orders, in pieces of its second axis."""
    given = {"axis": 0, "orders": tuple(range(len(result))), "leading": leading, "dtype": result.dtype}
    plan = Layout(shape=result.shape[1:], **{**given, **more})
    place = formats.located("dst", "y.npz")
    formats.check(place, plan)
    target = formats.create(place, Path("y.partial"), plan)
    rest = tuple(slice(0, extent) for extent in plan.shape[1:])
    half = plan.shape[0] // 2
    target.write((slice(0, half), *rest), result[:, :half])
    mark = target.sync()
    target.close()
    target = formats.reopen(place, Path("y.partial"), plan, mark)
    target.write((slice(half, plan.shape[0]), *rest), result[:, half:])
    target.sync()
    formats.encode(place, target, Path("y.encoded"), plan)
    target.close()
    Path("y.partial").unlink()
    return Path("y.encoded").read_bytes()


@pytest.mark.parametrize("fortran", [False, True])
@pytest.mark.parametrize("leading", [False, True])
@pytest.mark.parametrize("dtype", ["f4", "f8", "c8", "c16"])
def test_every_result_is_read_by_numpy(dtype, leading, fortran):
    rng = np.random.default_rng(4)
    for shape in ((100,), (30, 7), (6, 5, 4), (1, 0)):
        result = rng.standard_normal((2 if leading else 1, *shape)).astype(dtype)
        written(result, leading=leading, fortran=fortran, key="a b/é")
        with np.load("y.encoded") as data:
            assert data.files == ["a b/é"]
            array = data["a b/é"]
        expected = result if leading else result[0]
        assert (array.dtype, array.shape, array.tobytes()) == (expected.dtype, expected.shape, expected.tobytes())
        os.replace("y.encoded", "x.npz")
        with source_of() as source:
            place = tuple(slice(0, extent) for extent in expected.shape)
            np.testing.assert_array_equal(read(source, place), expected)


def test_equal_numbers_make_equal_files(monkeypatch):
    data = np.random.default_rng(5).standard_normal((1, 300))
    first = written(data)
    monkeypatch.setattr("time.time", lambda: 2e9)
    monkeypatch.setattr("algdiff._formats.stage.BYTES", 100)
    assert written(data) == first
    with zipfile.ZipFile("y.encoded") as archive:
        (info,) = archive.infolist()
    assert (info.filename, info.compress_type) == ("arr_0.npy", zipfile.ZIP_STORED)
    assert info.date_time == (1980, 1, 1, 0, 0, 0)


@pytest.mark.parametrize("key", ["a\0b", "\ud800", "x" * 65532])
def test_names_that_cannot_be_written(key):
    with pytest.raises(ValueError, match=r"^key must be "):
        written(np.zeros((1, 5)), key=key)


def test_the_longest_name():
    written(np.zeros((1, 5)), key="x" * 65531)
    with np.load("y.encoded") as data:
        assert data.files == ["x" * 65531]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_full_disk_is_an_error_of_the_system():
    plan = Layout(shape=(20_000,), axis=0, orders=(1,), leading=False, dtype=np.dtype(float))
    stage = Stage(Path("y.partial"), plan, table=False)
    with pytest.raises(OSError, match="No space left") as info:
        npz.encode(stage, Path("/dev/full"), None, plan)
    stage.close()
    assert info.value.errno is not None
