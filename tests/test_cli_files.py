"""The command line: every format in and out, and files that are broken or hold something else."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import pytest

import algdiff
from algdiff import _formats as formats
from algdiff._formats.base import Options
from cli import WINDOW, N, error_line, here, read_csv, run, x

# --- formats ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int16, np.bool_, np.complex128, ">f8"])
def test_npy_data_types(x, dtype):
    data = (100 * x).astype(dtype)
    np.save("x.npy", data)
    assert run("x.npy", "y.npy") == 0
    expected = algdiff.differentiate(data, WINDOW)
    written = np.load("y.npy")
    assert written.dtype == expected.dtype
    np.testing.assert_array_equal(written, expected)


def test_npz_keeps_the_name(x):
    np.savez("x.npz", velocity=x)
    assert run("x.npz", "y.npz") == 0
    with np.load("y.npz") as written:
        assert written.files == ["velocity"]
        np.testing.assert_array_equal(written["velocity"], algdiff.differentiate(x, WINDOW))


def test_npz_of_several_arrays_needs_a_key(x, capsys):
    np.savez("x.npz", counts=x, dt=1e-3)
    assert run("x.npz", "y.npz") == 1
    line = error_line(capsys)
    assert line == "--key must name one array of x.npz (counts, dt), got nothing"
    assert run("x.npz", "y.npz", "--key", "speed") == 1
    assert error_line(capsys).endswith("(counts, dt), got 'speed'")
    assert not Path("y.npz").exists()
    assert run("x.npz", "y.npz", "--key", "counts", "-q") == 0
    with np.load("y.npz") as written:
        np.testing.assert_array_equal(written["counts"], algdiff.differentiate(x, WINDOW))


@pytest.mark.parametrize("key", ["a b", "file", "allow_pickle"])
def test_key_names_the_output(x, key):
    np.save("x.npy", x)
    assert run("x.npy", "y.npz", "--key", key) == 0
    with np.load("y.npz") as written:
        assert written.files == [key]


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("header", [None, ("time, s; t", 'the "angle"', "x")])
def test_csv_round_trip(x, delimiter, header):
    data = np.stack([np.arange(N) / 7, x, -(x**3)], axis=1)
    with open("x.csv", "w", encoding="utf-8-sig", newline="") as file:
        if header:
            file.write(delimiter.join('"' + name.replace('"', '""') + '"' for name in header) + "\r\n")
        file.writelines(delimiter.join(map(repr, row)) + "\r\n" for row in data.tolist())
    assert run("x.csv", "y.csv", "--fs", 50) == 0
    written = read_csv("y.csv", delimiter)
    assert written.header == (None if header is None else list(header))
    np.testing.assert_array_equal(written.array, algdiff.differentiate(data, WINDOW, fs=50, axis=0))


def test_csv_columns_by_name_and_position(x):
    data = np.stack([x, x**2, x**3], axis=1)
    np.savetxt("x.csv", data, delimiter=",", header="a,b,c", comments="", fmt="%.17g")
    expected = algdiff.differentiate(data, WINDOW, axis=0)
    assert run("x.csv", "two.csv", "--columns", "c,0") == 0
    two = read_csv("two.csv")
    assert two.header == ["c", "a"]
    np.testing.assert_array_equal(two.array, expected[:, [2, 0]])
    assert run("x.csv", "one.npy", "--columns", "b") == 0
    np.testing.assert_array_equal(np.load("one.npy"), algdiff.differentiate(data[:, 1], WINDOW))
    assert run("x.csv", "all.npz") == 0
    with np.load("all.npz") as written:
        np.testing.assert_array_equal(written["arr_0"], expected)


def test_csv_unknown_column(x, capsys):
    np.savetxt("x.csv", x[:, None], header="a", comments="")
    for wrong in ("b", "1", "-1", ""):
        assert run("x.csv", "y.csv", f"--columns={wrong}") == 1
        line = error_line(capsys)
        assert line == f"--columns must name columns of x.csv (a; or 0 to 0), got {wrong!r}"


def test_csv_has_time_along_rows_whatever_the_axis_was(x):
    data = np.stack([x, x**2])
    np.save("x.npy", data)
    assert run("x.npy", "y.csv") == 0
    np.testing.assert_array_equal(read_csv("y.csv").array, algdiff.differentiate(data, WINDOW).T)
    np.save("t.npy", data.T)
    assert run("t.npy", "t.csv", "--axis", 0) == 0
    assert Path("t.csv").read_bytes() == Path("y.csv").read_bytes()


def test_csv_float32_reads_back_the_same(x):
    data = (1e-3 * x).astype(np.float32)
    np.save("x.npy", data)
    assert run("x.npy", "y.csv") == 0
    back = read_csv("y.csv").array[:, 0].astype(np.float32)
    np.testing.assert_array_equal(back, algdiff.differentiate(data, WINDOW))


def test_csv_keeps_nan(x):
    x[100] = np.nan
    np.savetxt("x.csv", x)
    assert run("x.csv", "y.csv") == 0
    written = read_csv("y.csv").array[:, 0]
    np.testing.assert_array_equal(written, algdiff.differentiate(x, WINDOW))
    assert np.isnan(written).any()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n3,oops\n", "line 3, column 1 must be a number, got 'oops'"),
        ("1,2\n3,4,5\n", "line 2 must have 2 columns as the rows before it, got 3"),
        ("a,b\n1,2\n\n3\n", "line 4 must have 2 columns as the rows before it, got 1"),
        ("a\n1\n2\n\n4\n", "line 4 must hold numbers, got nothing"),
        ("1,2\n\n3,4\n", "line 2 must hold numbers, got nothing"),
        ("a,b\n1,2,3\n4,5,6\n", "the rows must have 2 columns as the first, got 3"),
        ("a,b,c\n1,2\n4,5\n", "the rows must have 3 columns as the first, got 2"),
        ("a\n1\n \n", "line 3, column 0 must be a number, got ' '"),
        ("1,5;2,5\n1,5;2,5\n", "column 0 must be a number, got '1,5'"),
        ("a,b\n", "must hold numbers, got none"),
        ("", "must hold numbers, got none"),
        ("\n\n", "must hold numbers, got none"),
    ],
)
def test_malformed_csv(capsys, text, message):
    Path("x.csv").write_text(text, encoding="utf-8")
    assert run("x.csv", "y.csv") == 1
    line = error_line(capsys)
    assert line.startswith("x.csv: ")
    assert message in line
    assert os.listdir() == ["x.csv"]


@pytest.mark.parametrize(
    "text", ['"1","2"\n"3","4"\n', "1,2\n3,4\n\n", "1 , 2\n3, 4", "a,b\n1,2\n3,4\n", '"a","b"\r\n1,2\r\n3,4']
)
def test_csv_spellings(text):
    Path("x.csv").write_text(text, encoding="utf-8", newline="")
    with formats.open_source(formats.located("src", "x.csv"), Options()) as source:
        table = np.empty(source.shape)
        source.read((slice(0, 2), slice(0, 2)), table)
    np.testing.assert_array_equal(table, [[1, 2], [3, 4]])
    assert source.names == (("a", "b") if "a" in text else None)


def test_csv_must_be_utf8(capsys):
    Path("x.csv").write_bytes(b"\xff\xfe1\n2\n")
    assert run("x.csv", "y.csv") == 1
    assert "UTF-8" in error_line(capsys)


def test_csv_of_several_orders_names_their_columns(x):
    data = np.stack([x, x**2], axis=1)
    np.savetxt("x.csv", data, delimiter=";", header="a;b", comments="", fmt="%.17g")
    assert run("x.csv", "y.csv", "--deriv", "0,2") == 0
    written = read_csv("y.csv", ";")
    assert written.header == ["a_d0", "b_d0", "a_d2", "b_d2"]
    smooth, curvature = algdiff.differentiate(data, WINDOW, (0, 2), axis=0)
    np.testing.assert_array_equal(written.array, np.concatenate([smooth, curvature], axis=1))


def test_csv_with_times(x, capsys):
    t = 3 + 0.01 * np.arange(N)
    np.savetxt("x.csv", np.stack([t, x], axis=1), delimiter=",", header="t,angle", comments="", fmt="%.17g")
    assert run("x.csv", "y.csv", "--time", "t") == 0
    assert "(delta 0.01 s from the file)" in capsys.readouterr().err
    written = read_csv("y.csv")
    assert written.header == ["t", "angle"]
    np.testing.assert_allclose(written.array[:, 0], t, rtol=1e-15)
    # The step is the mean of the printed ones: its rounding, a few 1e-16 of 3 s over 2 s, is that of the estimates.
    np.testing.assert_allclose(
        written.array[:, 1], algdiff.differentiate(x, WINDOW, delta=0.01), rtol=1e-13, atol=1e-13
    )


def test_raw_with_channels_and_an_offset(x):
    data = (1000 * np.stack([x, x**2, x**3], axis=1)).astype(">i2")
    Path("x.bin").write_bytes(b"header" + data.tobytes())
    flags = ["--dtype", ">i2", "--channels", 3, "--offset", 6]
    assert run("x.bin", "y.raw", *flags, "--fs", 100) == 0
    written = np.fromfile("y.raw").reshape(N, 3)
    np.testing.assert_array_equal(written, algdiff.differentiate(data, WINDOW, fs=100, axis=0))


@pytest.mark.parametrize("dtype", ["text", "O", "M8[s]", "f8,f4", "S0", ""])
def test_types_of_raw_numbers(capsys, dtype):
    Path("x.bin").write_bytes(bytes(800))
    assert run("x.bin", "y.npy", f"--dtype={dtype}") == 2
    assert error_line(capsys) == f"--dtype must be a type of numbers like float32, int16 or >f8, got {dtype!r}"


def test_hdf5(x, capsys):
    h5py = pytest.importorskip("h5py")
    with h5py.File("x.h5", "w") as file:
        file["run/angle"] = np.stack([x, x**2])
        file["run/angle"].attrs["fs"] = 50.0
        file["other"] = x
    assert run("x.h5:/run/angle", "y.h5:/velocity", "--delay", "20ms", "--deriv", "0,1") == 0
    assert "(delta 0.02 s from the file)" in capsys.readouterr().err
    with h5py.File("y.h5") as file:
        written = file["velocity"][...]
    expected = algdiff.differentiate(np.stack([x, x**2]), WINDOW, (0, 1), delta=0.02, delay=0.02)
    np.testing.assert_array_equal(written, expected)
    assert run("x.h5", "z.h5") == 1
    line = error_line(capsys)
    assert "/run/angle" in line
    assert "/other" in line


def test_zarr(x):
    zarr = pytest.importorskip("zarr")
    store = zarr.create_array("x.zarr", shape=(3, N), chunks=(2, 60), dtype="f4")
    data = np.stack([x, x**2, x**3]).astype(np.float32)
    store[...] = data
    assert run("x.zarr", "y.zarr") == 0
    np.testing.assert_array_equal(zarr.open_array("y.zarr", mode="r")[...], algdiff.differentiate(data, WINDOW))
    assert run("x.zarr", "y.zarr") == 1
    assert run("x.zarr", "y.zarr", "--deriv", 2, "--overwrite") == 0
    np.testing.assert_array_equal(zarr.open_array("y.zarr", mode="r")[...], algdiff.differentiate(data, WINDOW, 2))


def test_parquet(x):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    parquet.write_table(pyarrow.table({"name": ["a"] * N, "u": x, "v": x**2}), "x.parquet")
    assert run("x.parquet", "y.parquet", "--columns", "v,u") == 0
    written = parquet.read_table("y.parquet")
    assert written.column_names == ["v", "u"]
    np.testing.assert_array_equal(written["v"].to_numpy(), algdiff.differentiate(x**2, WINDOW))
    np.testing.assert_array_equal(written["u"].to_numpy(), algdiff.differentiate(x, WINDOW))


def test_wav(x, capsys):
    soundfile = pytest.importorskip("soundfile")
    data = np.stack([x, -x], axis=1)
    soundfile.write("x.wav", data, 8000, subtype="DOUBLE")
    assert run("x.wav", "y.wav", "--window", "3ms") == 0
    assert "window      24 samples, 0.003 s (delta 0.000125 s from the file)" in capsys.readouterr().err
    written, rate = soundfile.read("y.wav")
    assert rate == 8000
    np.testing.assert_array_equal(written, algdiff.differentiate(data, 24, delta=1 / 8000, axis=0))


# --- bad files --------------------------------------------------------------------------------------------------------


def test_objects_are_never_unpickled(capsys, tmp_path):
    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "sprung"),)

    objects = np.array([Trap(), 1.0], dtype=object)
    np.save("x.npy", objects, allow_pickle=True)
    np.savez("x.npz", a=objects)
    Path("p.npy").write_bytes(objects.dumps())
    for name in ("x.npy", "x.npz", "p.npy"):
        assert run(name, "y.npy") == 1
        assert error_line(capsys).startswith(name)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize(
    "data", [np.array(["a", "b"]), np.zeros(50, "M8[s]"), np.zeros(50, [("a", float)])], ids=["str", "time", "record"]
)
def test_data_types_without_arithmetic(capsys, data):
    np.save("x.npy", data)
    assert run("x.npy", "y.npy") == 1
    assert "must hold real or complex numbers, got dtype" in error_line(capsys)


@pytest.mark.parametrize("cut", [0, 5, 60, 200])
@pytest.mark.parametrize("suffix", ["npy", "npz"])
def test_truncated_files(x, capsys, suffix, cut):
    whole = io.BytesIO()
    np.save(whole, x) if suffix == "npy" else np.savez_compressed(whole, x=x)
    Path(f"x.{suffix}").write_bytes(whole.getvalue()[:cut])
    assert run(f"x.{suffix}", "y.npy") == 1
    assert "not a whole" in error_line(capsys)


def test_damaged_npz(x, capsys):
    np.savez_compressed("x.npz", x=x)
    content = bytearray(Path("x.npz").read_bytes())
    content[300:400] = bytes(100)
    Path("x.npz").write_bytes(content)
    assert run("x.npz", "y.npy") == 1
    assert "not a whole" in error_line(capsys)


@pytest.mark.parametrize("bracket", [b"(", b"{", b"'"])
def test_damaged_npy_header(x, capsys, bracket):
    np.save("x.npy", x)
    content = bytearray(Path("x.npy").read_bytes())
    content[70:71] = bracket
    Path("x.npy").write_bytes(content)
    assert run("x.npy", "y.npy") == 1
    assert "not a whole" in error_line(capsys)


def test_header_that_promises_too_much(capsys):
    with open("x.npy", "wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (1 << 50,)})
    assert run("x.npy", "y.npy") == 1
    error_line(capsys)


def test_a_number_is_no_recording(capsys):
    np.save("x.npy", 1.0)
    assert run("x.npy", "y.csv") == 1
    assert error_line(capsys) == "x.npy must hold an array of at least one dimension, got a scalar"


def test_csv_holds_at_most_two_dimensions(capsys):
    np.save("x.npy", np.zeros((4, 5, N)))
    assert run("x.npy", "y.csv") == 1
    assert "one or two dimensions" in error_line(capsys)


def test_csv_holds_real_numbers(x, capsys):
    np.save("x.npy", x + 1j)
    assert run("x.npy", "y.csv") == 1
    assert "real numbers" in error_line(capsys)


def test_missing_samples_are_left_out(x: np.ndarray) -> None:
    x = x.copy()
    x[[50, 51, 120]] = np.nan
    np.save("x.npy", x)
    assert run("x.npy", "y.npy", "--nan-policy", "omit", "--min-support", 20) == 0
    expected = algdiff.differentiate(x, WINDOW, nan_policy="omit", min_support=20)
    assert np.isnan(expected).any()
    assert not np.isnan(expected).all()
    np.testing.assert_allclose(np.load("y.npy"), expected, rtol=1e-12)
    assert run("x.npy", "z.npy", "--nan-policy", "omit", "--max-gain", 1.01) == 0
    np.testing.assert_allclose(np.load("z.npy"), algdiff.differentiate(x, WINDOW, nan_policy="omit", max_gain=1.01))
    assert run("x.npy", "w.npy", "--nan-policy", "raise") == 1
