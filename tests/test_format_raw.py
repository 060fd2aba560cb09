"""Raw binary files region by region against NumPy, sizes that do not fit, and results in place."""

from __future__ import annotations

import itertools
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algdiff import _formats as formats
from algdiff._formats.base import Layout, Options

DTYPES = ["?", "i1", "u1", "<i2", ">i2", "<u4", ">i4", "i8", ">u8", "f2", "<f4", ">f4", "<f8", ">f8", "c8", ">c16"]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def source_of(dtype: Any = "f8", name: str = "x.bin", **options: Any) -> Any:
    kind = None if dtype is None else np.dtype(dtype)
    return formats.open_source(formats.located("src", name), Options(dtype=kind, **options))


def error_of(dtype: Any = "f8", **options: Any) -> str:
    with pytest.raises(ValueError, match=r".") as info:
        source_of(dtype, **options)
    assert "\n" not in str(info.value)
    return str(info.value)


# --- reading -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [0, 5, 512])
@pytest.mark.parametrize("dtype", DTYPES)
def test_regions_of_every_type(dtype, offset):
    rng = np.random.default_rng(DTYPES.index(dtype))
    for channels in (None, 1, 2, 7):
        shape = (300,) if channels is None else (300, channels)
        data = (100 * rng.random(shape)).astype(dtype)
        Path("x.bin").write_bytes(rng.bytes(offset) + data.tobytes())
        with source_of(dtype, channels=channels, offset=offset) as source:
            assert (source.shape, source.dtype.str, source.axis) == (shape, data.dtype.str, 0)
            assert (source.fortran, source.step, source.names) == (False, None, None)
            for _ in range(15):
                place = tuple(
                    slice(*(sorted(rng.integers(0, extent + 1, 2).tolist()) if rng.random() < 0.7 else (0, extent)))
                    for extent in shape
                )
                out = np.empty([one.stop - one.start for one in place], dtype)
                assert source.read(place, out) is None
                np.testing.assert_array_equal(out, data[place])


@pytest.mark.parametrize("name", ["x.bin", "x.raw", "x.dat", "X.BIN"])
def test_suffixes(name):
    np.arange(6, dtype="i2").tofile(name)
    with source_of("i2", name) as source:
        assert source.shape == (6,)


@pytest.mark.parametrize("channels", [None, 3])
@pytest.mark.parametrize("offset", [0, 8])
def test_nothing_in_it(channels, offset):
    Path("x.bin").write_bytes(bytes(offset))
    with source_of(channels=channels, offset=offset) as source:
        assert source.shape == ((0,) if channels is None else (0, 3))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"dtype": None}, "dtype must be given for the raw numbers of x.bin, got nothing"),
        ({"dtype": "f8"}, "x.bin: must hold whole samples of 8 bytes (1 x float64), got 100 bytes"),
        ({"dtype": ">i2", "channels": 3}, "x.bin: must hold whole samples of 6 bytes (3 x >i2), got 100 bytes"),
        ({"dtype": "f4", "offset": 1}, "x.bin: must hold whole samples of 4 bytes (1 x float32), got 99 bytes"),
        ({"dtype": "u1", "offset": 101}, "offset must be at most the 100 bytes of x.bin, got 101"),
        ({"dtype": "f4", "channels": 2**70}, "must hold whole samples of"),
        ({"dtype": "u1", "offset": 10**30}, "offset must be at most the 100 bytes of x.bin"),
        ({"dtype": "U5"}, "x.bin must hold real or complex numbers, got dtype <U5"),
        ({"dtype": "M8[s]", "offset": 4}, "x.bin must hold real or complex numbers, got dtype datetime64[s]"),
        ({"dtype": "i2,i2"}, "x.bin must hold real or complex numbers, got dtype"),
        ({"dtype": "O", "offset": 4}, "x.bin must hold real or complex numbers, got dtype object"),
        ({"dtype": "V0"}, "x.bin must hold real or complex numbers, got dtype |V0"),
        ({"dtype": "S"}, "x.bin must hold real or complex numbers, got dtype |S0"),
    ],
)
def test_what_does_not_fit(options, said):
    Path("x.bin").write_bytes(bytes(100))
    assert said in error_of(**options)


def test_files_that_are_not_there():
    with pytest.raises(FileNotFoundError) as info:
        source_of()
    assert info.value.filename == "x.bin"
    Path("x.bin").mkdir()
    with pytest.raises(IsADirectoryError):
        source_of()


def test_a_file_that_shrinks_while_it_is_read():
    np.arange(1000.0).tofile("x.bin")
    with source_of() as source:
        os.truncate("x.bin", 4000)
        out = np.empty(20)
        source.read((slice(480, 500),), out)
        np.testing.assert_array_equal(out, np.arange(480.0, 500.0))
        with pytest.raises(ValueError, match=r"^x\.bin: ends before the array does"):
            source.read((slice(481, 501),), out)


def test_a_file_beyond_4_gib():
    count = 2**30 + 77  # divided by 3
    with open("x.bin", "wb") as file:
        file.truncate(4 * count - 4)  # takes no room
        file.seek(0, os.SEEK_END)
        file.write(np.float32(3).tobytes())
    with source_of("f4", channels=3) as source:
        out = np.empty((5, source.shape[1]), "f4")
        source.read((slice(source.shape[0] - 5, source.shape[0]), slice(0, source.shape[1])), out)
        np.testing.assert_array_equal(out.ravel(), [0] * (out.size - 1) + [3])


# --- writing -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fortran", [False, True])
@pytest.mark.parametrize("orders", [0, 1, 3])
@pytest.mark.parametrize("dtype", ["f4", "f8", "c8", "c16"])
def test_results_in_place(dtype, orders, fortran):
    rng = np.random.default_rng(orders)
    where = formats.located("dst", "y.bin")
    for shape in ((100,), (30, 7), (5, 0)):
        given = {"axis": 0, "orders": tuple(range(max(orders, 1))), "leading": orders > 0, "fortran": fortran}
        plan = Layout(shape=shape, dtype=np.dtype(dtype), **given)
        data = rng.standard_normal((max(orders, 1), *shape)).astype(dtype)
        formats.check(where, plan)
        target = formats.create(where, Path("y.partial"), plan)
        rows = np.moveaxis(data, 1, 0).reshape(shape[0], -1) if data.size else np.empty((shape[0], 0), dtype)
        for first, last in itertools.pairwise(sorted({0, shape[0], *rng.integers(0, shape[0] + 1, 2).tolist()})):
            target.write((slice(first, last),), np.array(rows[first:last], order=rng.choice(["C", "F"])))
            mark = target.sync()
            target.close()
            target = formats.reopen(where, Path("y.partial"), plan, mark)
        target.close()
        # Channels alternate, whatever the order of the input.
        np.testing.assert_array_equal(np.fromfile("y.partial", dtype), rows.ravel())
        assert os.path.getsize("y.partial") == data.nbytes


def test_an_older_file_is_replaced():
    Path("y.partial").write_bytes(b"x" * 1000)
    plan = Layout(shape=(10,), axis=0, orders=(1,), leading=False, dtype=np.dtype("f8"))
    target = formats.create(formats.located("dst", "y.bin"), Path("y.partial"), plan)
    target.close()
    assert Path("y.partial").read_bytes() == bytes(80)
