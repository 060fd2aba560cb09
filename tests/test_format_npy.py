"""``.npy`` files region by region against NumPy, hostile headers, results in place, and stages."""

from __future__ import annotations

import io
import itertools
import os
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algdiff import _formats as formats
from algdiff._formats.base import Layout, Options
from algdiff._formats.regions import Region
from algdiff._formats.stage import Stage

DTYPES = [
    "?",
    "i1",
    "u1",
    "i2",
    ">u2",
    "i4",
    "u4",
    "i8",
    ">u8",
    "f2",
    "f4",
    ">f4",
    "f8",
    ">f8",
    "g",
    "c8",
    "c16",
    ">c16",
]
SHAPES = [(1,), (900,), (1, 1), (40, 30), (900, 1), (7, 8, 9), (5, 1, 9), (3, 4, 5, 6)]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def source_of() -> Any:
    return formats.open_source(formats.located("src", "x.npy"), Options())


def error_of(content: bytes) -> str:
    Path("x.npy").write_bytes(content)
    with pytest.raises(ValueError, match=r"^x\.npy") as info:
        source_of()
    assert "\n" not in str(info.value)
    return str(info.value)


def regions(rng: np.random.Generator, shape: tuple[int, ...], count: int) -> list[tuple[slice, ...]]:
    """Return the whole, nothing, and random regions, of which some axes are whole."""
    whole = tuple(slice(0, extent) for extent in shape)
    found = [whole, tuple(slice(0, 0) for _ in shape)]
    for _ in range(count):
        cut = (slice(*sorted(rng.integers(0, extent + 1, 2).tolist())) for extent in shape)
        found.append(tuple(one if rng.random() < 0.6 else all_ for one, all_ in zip(cut, whole, strict=True)))
    return found


def empty(place: tuple[slice, ...], source: Any) -> np.ndarray:
    shape = [one.stop - one.start for one in place]
    return np.empty(shape, source.dtype, order="F" if source.fortran else "C")


def header(text: str | dict[str, Any], version: tuple[int, int] = (1, 0)) -> bytes:
    content = (text if isinstance(text, str) else repr(text)).encode()
    return b"\x93NUMPY" + bytes(version) + struct.pack("<H" if version == (1, 0) else "<I", len(content)) + content


def described(shape: Any = (3,), descr: Any = "<f8", order: Any = False) -> dict[str, Any]:
    return {"descr": descr, "fortran_order": order, "shape": shape}


# --- reading -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", DTYPES)
def test_regions_of_every_type_and_order(dtype, order):
    rng = np.random.default_rng(DTYPES.index(dtype))
    for shape in SHAPES:
        data = np.array(100 * rng.random(shape), order=order).astype(dtype)
        np.save("x.npy", data)
        with source_of() as source:
            assert (source.shape, source.dtype.str, source.axis, source.step) == (shape, data.dtype.str, -1, None)
            assert source.fortran == (data.flags.f_contiguous and not data.flags.c_contiguous)
            for place in regions(rng, shape, 12):
                out = empty(place, source)
                assert source.read(place, out) is None
                np.testing.assert_array_equal(out, data[place])


@pytest.mark.parametrize("order", ["C", "F"])
def test_only_the_region_is_read(order):
    data = np.array(np.random.default_rng(1).random((30, 40, 50)), order=order)
    np.save("x.npy", data)

    class Counting(io.FileIO):
        count = 0

        def readinto(self, buffer: Any) -> int:
            got = super().readinto(buffer)
            Counting.count += got
            return got

    with source_of() as source:
        source.file.close()
        source.file = Counting("x.npy")
        for place in regions(np.random.default_rng(2), data.shape, 20):
            out = empty(place, source)
            Counting.count = 0
            source.read(place, out)
            assert Counting.count == out.nbytes


@pytest.mark.parametrize(("fortran", "rows", "plane"), [(False, [4] * 4, 6), (True, [8] * 2, 12)])
def test_pieces_are_as_long_as_they_can_be(fortran, rows, plane):
    region = Region((4, 3, 2), np.dtype("u1"), 10, fortran=fortran)
    all_4, all_3, all_2 = slice(0, 4), slice(0, 3), slice(0, 2)
    assert list(region.pieces((all_4, all_3, all_2))) == [(10, 24)]
    assert [length for _, length in region.pieces((all_4, slice(1, 3), all_2))] == rows
    far = (all_4, all_3, slice(1, 2)) if fortran else (slice(1, 2), all_3, all_2)
    assert list(region.pieces(far)) == [(10 + plane, plane)]


def test_nothing_in_it():
    for shape in ((0,), (0, 5), (5, 0), (2, 0, 3)):
        for order in ("C", "F"):
            np.save("x.npy", np.empty(shape, order=order))
            with source_of() as source:
                assert source.shape == shape
                place = tuple(slice(0, extent) for extent in shape)
                source.read(place, empty(place, source))


def test_a_single_value_has_no_axis():
    np.save("x.npy", np.float32(3))
    with source_of() as source:
        assert source.shape == ()


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
def test_versions(version):
    data = np.arange(12.0).reshape(3, 4)
    with open("x.npy", "wb") as file:
        np.lib.format.write_array(file, data, version)
    with source_of() as source:
        place = (slice(1, 3), slice(0, 4))
        out = empty(place, source)
        source.read(place, out)
        np.testing.assert_array_equal(out, data[1:])


def test_more_after_the_array_is_left_alone():
    np.save("x.npy", np.arange(4.0))
    with open("x.npy", "ab") as file:
        np.save(file, np.arange(9))
    with source_of() as source:
        out = np.empty(4)
        source.read((slice(0, 4),), out)
        np.testing.assert_array_equal(out, np.arange(4.0))


@pytest.mark.parametrize("place", [slice(990, 1000), slice(0, 1000)])
def test_a_file_that_shrinks_while_it_is_read(place):
    np.save("x.npy", np.arange(1000.0))
    with source_of() as source:
        os.truncate("x.npy", os.path.getsize("x.npy") - 3)
        with pytest.raises(ValueError, match=r"^x\.npy: ends before the array does"):
            source.read((place,), np.empty(place.stop - place.start))


# --- files that are not what they say ----------------------------------------------------------------------------


def test_every_cut_is_seen():
    np.save("x.npy", np.arange(5.0))
    whole = Path("x.npy").read_bytes()
    for cut in range(len(whole)):
        assert "not a whole .npy array" in error_of(whole[:cut])


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ((4,), "(shape (4,) of float64 takes 32 bytes, got 24)"),
        ((2**50,), f"takes {2**53} bytes, got 24"),
        ((2**62,), "not a whole array"),
        ((2**40, 2**40), "not a whole array"),
        ((10**40,), "not a whole array"),
        ((0, 10**40), "not a whole array"),
        ((10**4000, 10**4000), "not a whole array"),
        ((-3,), "not a whole array"),
        ((-1, -3), "not a whole array"),
        ((0, -1), "not a whole array"),
        ((True, 3), "not a whole array"),
        ((1,) * 99, "not a whole array"),
        ((3.0,), "not a whole .npy array"),
        (["3"], "not a whole .npy array"),
        (3, "not a whole .npy array"),
        (None, "not a whole .npy array"),
    ],
)
def test_shapes_that_cannot_be(shape, said):
    tracemalloc.start()
    try:
        assert said in error_of(header(described(shape)) + bytes(24))
        assert tracemalloc.get_traced_memory()[1] < 3e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "descr", ["<U3", "|S8", "<M8[s]", "<m8[ns]", "|V8", [("a", "<f8")], ("<f8", (3,)), [("a", "<f8", (2,))]]
)
def test_types_without_arithmetic(descr):
    said = error_of(header(described(descr=descr)) + bytes(100))
    assert "must hold real or complex numbers, got dtype " in said


@pytest.mark.parametrize("descr", ["|O", "O", [("a", "O")], ("|O", (3,))])
def test_objects_are_never_unpickled(descr):
    assert error_of(header(described(descr=descr)) + bytes(100)).endswith("got Python objects")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "3",
        "{}",
        "[]",
        "__import__('os').mkdir('sprung')",
        "{'descr': '<f8', 'fortran_order': False}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (3,), 'more': 1}",
        "{'descr': '<f8', 'fortran_order': 7, 'shape': (3,)}",
        "{'descr': (), 'fortran_order': False, 'shape': (3,)}",
        "{'descr': [()], 'fortran_order': False, 'shape': (3,)}",
        "{'descr': 'nothing', 'fortran_order': False, 'shape': (3,)}",
        "{'descr': '(((', 'fortran_order': False, 'shape': (3,)}",
        "{'descr': None, 'fortran_order': False, 'shape': (9,)}",
        "(" * 4000,
        "-" * 9000 + "1",
        "[" * 150 + "]" * 150,
        "\0" * 100,
        "9" * 9000,
    ],
)
@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
@pytest.mark.filterwarnings("ignore:Reading `.npy`")  # NumPy takes a header that it cannot read for one of Python 2
def test_hostile_headers(text, version):
    assert "not a whole .npy array" in error_of(header(text, version) + bytes(24))
    assert os.listdir() == ["x.npy"]


def test_headers_that_do_not_end():
    for content in (b"", b"\x93NUMPY", b"\x93NUMPY\x01\x00", b"\x93NUMPX\x01\x00", b"PK\x03\x04" + bytes(99)):
        assert "not a whole .npy array" in error_of(content)
    said = error_of(b"\x93NUMPY\x02\x00\xff\xff\xff\xff" + bytes(99))
    assert "a header of 4294967295 bytes" in said


@pytest.mark.parametrize("version", [(0, 0), (1, 1), (3, 0), (4, 0), (255, 255)])
def test_other_versions(version):
    assert f"format {version[0]}.{version[1]}" in error_of(header(described(), version) + bytes(24))


@pytest.mark.filterwarnings("ignore:Reading `.npy`")
@pytest.mark.filterwarnings("ignore::SyntaxWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_damaged_headers_are_refused_or_read():
    np.save("x.npy", np.arange(24.0).reshape(4, 6))
    whole = Path("x.npy").read_bytes()
    rng = np.random.default_rng(9)
    refused = 0
    for _ in range(400):
        content = bytearray(whole)
        for place in rng.integers(0, 80, rng.integers(1, 4)):
            content[place] = (
                rng.integers(256) if rng.random() < 0.5 else rng.choice(list(b"0123456789-'(){}[],:<>|OfFiTrue"))
            )
        Path("x.npy").write_bytes(content)
        try:
            with source_of() as source:
                assert source.region.offset + source.region.nbytes <= len(whole)
        except ValueError as error:
            assert str(error).startswith("x.npy")  # noqa: PT017
            refused += 1
    assert refused > 300


def test_files_that_are_not_there():
    with pytest.raises(FileNotFoundError) as info:
        source_of()
    assert info.value.filename == "x.npy"
    Path("x.npy").mkdir()
    with pytest.raises(IsADirectoryError):
        source_of()


# --- writing -----------------------------------------------------------------------------------------------------


def layout(shape: tuple[int, ...], orders: int = 0, **more: Any) -> Layout:
    """Return that of a result with a leading axis over some orders, or without."""
    given = {"axis": 0, "orders": tuple(range(max(orders, 1))), "leading": orders > 0, "dtype": np.dtype(float)}
    return Layout(shape=shape, **{**given, **more})


def blocks(rng: np.random.Generator, shape: tuple[int, ...]) -> list[tuple[slice, ...]]:
    """Return regions that make up the whole, in random order."""
    axes = []
    for extent in shape:
        cuts = sorted({0, extent, *rng.integers(0, extent + 1, 2).tolist()})
        axes.append([slice(*pair) for pair in itertools.pairwise(cuts)])
    found = list(itertools.product(*axes))
    return [found[index] for index in rng.permutation(len(found))]


@pytest.mark.parametrize("fortran", [False, True])
@pytest.mark.parametrize("orders", [0, 1, 3])
@pytest.mark.parametrize("dtype", ["f4", "f8", "c8", "c16"])
def test_results_in_place(dtype, orders, fortran):
    rng = np.random.default_rng(orders)
    where = formats.located("dst", "y.npy")
    for shape in ((100,), (30, 7), (6, 5, 4), (3, 4, 5, 2)):
        plan = layout(shape, orders, dtype=np.dtype(dtype), fortran=fortran)
        full = (max(orders, 1), *shape)
        data = rng.standard_normal(full).astype(dtype)
        formats.check(where, plan)
        target = formats.create(where, Path("y.partial"), plan)
        for index, place in enumerate(blocks(rng, shape)):
            block = data[(slice(None), *place)]
            target.write(place, np.array(block, order=rng.choice(["C", "F"])) if rng.random() < 0.7 else block)
            if index % 3 == 0:
                mark = target.sync()
                target.close()
                target = formats.reopen(where, Path("y.partial"), plan, mark)
        target.close()
        with open("y.partial", "rb") as file:
            result = np.load(file)
        expected = data if orders else data[0]
        assert (result.dtype, result.shape) == (expected.dtype, expected.shape)
        np.testing.assert_array_equal(result, expected)
        if min(result.shape) > 1 and result.ndim > 1:
            assert result.flags.f_contiguous == fortran
        assert os.path.getsize("y.partial") % 64 == data.nbytes % 64


def test_nothing_to_write():
    for shape in ((0,), (5, 0)):
        plan = layout(shape)
        target = formats.create(formats.located("dst", "y.npy"), Path("y.partial"), plan)
        target.write(tuple(slice(0, extent) for extent in shape), np.empty((1, *shape)))
        target.close()
        with open("y.partial", "rb") as file:
            assert np.load(file).shape == shape


def test_a_header_that_was_not_finished():
    plan = layout((100,))
    where = formats.located("dst", "y.npy")
    formats.create(where, Path("y.partial"), plan).close()
    os.truncate("y.partial", 60)
    with pytest.raises(ValueError, match=r"^y\.partial: not a whole"):
        formats.reopen(where, Path("y.partial"), plan, 0)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_full_disk_is_an_error_of_the_system():
    region = Region((100,), np.dtype(float), 0, fortran=False)
    with open("/dev/full", "r+b", buffering=0) as file, pytest.raises(OSError, match="No space left"):
        region.write(file, (slice(0, 100),), np.zeros(100))


# --- stages ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("orders", [0, 2])
@pytest.mark.parametrize("fortran", [False, True])
def test_stage_of_an_array(orders, fortran, monkeypatch):
    monkeypatch.setattr("algdiff._formats.stage.BYTES", 1000)
    rng = np.random.default_rng(6)
    plan = layout((30, 7), orders, fortran=fortran)
    data = rng.standard_normal((max(orders, 1), 30, 7))
    stage = Stage(Path("stage"), plan, table=False)
    for place in blocks(rng, plan.shape):
        stage.write(place, np.asfortranarray(data[(slice(None), *place)]))
        assert stage.sync() == 0
        stage.close()
        stage = Stage(Path("stage"), plan, table=False)
    assert b"".join(stage.bytes()) == data.tobytes()
    stage.close()


@pytest.mark.parametrize("size", [1, 1000, 8 << 20])
@pytest.mark.parametrize("time_dtype", [None, "f8", "M8[ns]", "M8[s]"])
@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_stage_of_rows_and_their_times(dtype, time_dtype, size, monkeypatch):
    monkeypatch.setattr("algdiff._formats.stage.BYTES", size)
    rng = np.random.default_rng(7)
    for shape, orders in (((200,), 0), ((200, 3), 0), ((200, 3), 2), ((200, 1), 1)):
        timed = {} if time_dtype is None else {"time": "t", "time_dtype": np.dtype(time_dtype)}
        plan = layout(shape, orders, dtype=np.dtype(dtype), **timed)
        rows, columns = plan.rows
        data = rng.standard_normal((rows, columns)).astype(dtype)
        times = None if time_dtype is None else rng.integers(0, 10**9, rows).astype(time_dtype)
        Path("stage").unlink(missing_ok=True)
        stage = Stage(Path("stage"), plan, table=True)
        for start in range(0, rows, 33):
            part = slice(start, min(start + 33, rows))
            block = data[part] if start % 2 else np.asfortranarray(data[part])
            stage.write((part,), block, None if times is None else times[part])
            mark = stage.sync()
            stage.close()
            assert mark == 0
            stage = Stage(Path("stage"), plan, table=True)
        read = list(stage.rows())
        stage.close()
        np.testing.assert_array_equal(np.concatenate([numbers for numbers, _ in read]), data)
        assert all(
            numbers.dtype == dtype and numbers.nbytes <= max(size, columns * data.itemsize) for numbers, _ in read
        )
        if times is None:
            assert all(one is None for _, one in read)
        else:
            found = np.concatenate([one for _, one in read])
            assert found.dtype == times.dtype
            np.testing.assert_array_equal(found, times)
