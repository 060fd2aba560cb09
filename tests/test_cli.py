"""The command line: formats, refusals, exit codes, and that an output file is whole or absent."""

from __future__ import annotations

import errno
import io
import os
import re
import signal
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import algdiff
from algdiff import _cli, _demo, _files
from algdiff._cli import main

WINDOW = 21
N = 200


@pytest.fixture
def x() -> np.ndarray:
    rng = np.random.default_rng(7)
    return np.sin(0.05 * np.arange(N)) + 0.01 * rng.standard_normal(N)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(source: object, target: object, *more: object) -> int:
    return main(["run", str(source), str(target), "--window", str(WINDOW), *map(str, more)])


def leftovers(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name.startswith(".") or "partial" in path.name)


def error_line(capsys: pytest.CaptureFixture[str]) -> str:
    """Return the only line on stderr, without its prefix."""
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("algdiff: error: ")
    return line.removeprefix("algdiff: error: ")


def process(*arguments: object, **options: object) -> subprocess.Popen[str]:
    """Start ``python -m algdiff`` with Ctrl-C enabled, which a background shell may have switched off."""
    reset = None if os.name == "nt" else (lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    command = [sys.executable, "-m", "algdiff", *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "preexec_fn": reset, **options}
    return subprocess.Popen(command, **pipes)  # type: ignore[call-overload, no-any-return]


# --- formats -----------------------------------------------------------------------------------------------------


def test_npy_equals_differentiate_with_every_option(x):
    np.save("x.npy", np.stack([x, x**2]))
    options = {"degree": 4, "kappa": 0.5, "mu": 2.0, "tau": 0.75, "delta": 0.01, "rule": "trapezoid"}
    flags = [item for name, value in options.items() for item in (f"--{name}", value)]
    assert run("x.npy", "y.npy", "--deriv", 2, *flags, "--mode", "valid", "--threads", 2) == 0
    expected = algdiff.differentiate(np.load("x.npy"), WINDOW, 2, mode="valid", **options)
    np.testing.assert_array_equal(np.load("y.npy"), expected)


@pytest.mark.parametrize(
    ("flags", "options"),
    [
        ([], {}),
        (["--tau", "newest"], {"tau": "newest"}),
        (["--tau", "root"], {"tau": "root"}),
        (["--delay", "0.02", "--fs", "200"], {"delay": 0.02, "fs": 200.0}),
        (["--mode", "constant", "--cval", "3"], {"mode": "constant", "cval": 3.0}),
        (["--mode", "nan"], {"mode": "nan"}),
        (["--axis", "0"], {"axis": 0}),
        (["--axis", "-2"], {"axis": -2}),
    ],
)
def test_options_reach_the_library(x, flags, options):
    data = np.outer(x, 1 + np.arange(30.0))
    np.save("x.npy", data)
    assert run("x.npy", "y.npy", *flags) == 0
    expected = algdiff.differentiate(data, WINDOW, **options)
    np.testing.assert_array_equal(np.load("y.npy"), expected)
    if options:
        assert not np.array_equal(expected, algdiff.differentiate(data, WINDOW), equal_nan=True)


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
    source, written = (_files.read(Path(name)) for name in ("x.csv", "y.csv"))
    np.testing.assert_array_equal(source.array, data)
    assert (written.header, written.delimiter) == (header, delimiter)
    np.testing.assert_array_equal(written.array, algdiff.differentiate(data, WINDOW, fs=50, axis=0))


def test_csv_columns_by_name_and_position(x):
    data = np.stack([x, x**2, x**3], axis=1)
    np.savetxt("x.csv", data, delimiter=",", header="a,b,c", comments="", fmt="%.17g")
    expected = algdiff.differentiate(data, WINDOW, axis=0)
    assert run("x.csv", "two.csv", "--columns", "c,0") == 0
    two = _files.read(Path("two.csv"))
    assert two.header == ("c", "a")
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
    np.testing.assert_array_equal(_files.read(Path("y.csv")).array, algdiff.differentiate(data, WINDOW).T)
    np.save("t.npy", data.T)
    assert run("t.npy", "t.csv", "--axis", 0) == 0
    assert Path("t.csv").read_bytes() == Path("y.csv").read_bytes()


def test_csv_float32_reads_back_the_same(x):
    data = (1e-3 * x).astype(np.float32)
    np.save("x.npy", data)
    assert run("x.npy", "y.csv") == 0
    back = _files.read(Path("y.csv")).array.astype(np.float32)
    np.testing.assert_array_equal(back, algdiff.differentiate(data, WINDOW))


def test_csv_keeps_nan(x):
    x[100] = np.nan
    np.savetxt("x.csv", x)
    assert run("x.csv", "y.csv") == 0
    written = _files.read(Path("y.csv")).array
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
        ("a,b\n", "no numbers"),
        ("", "no numbers"),
        ("\n\n", "no numbers"),
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
    table = _files.read(Path("x.csv"))
    np.testing.assert_array_equal(table.array, [[1, 2], [3, 4]])
    assert table.header == (("a", "b") if "a" in text else None)


def test_csv_must_be_utf8(capsys):
    Path("x.csv").write_bytes(b"\xff\xfe1\n2\n")
    assert run("x.csv", "y.csv") == 1
    assert "UTF-8" in error_line(capsys)


# --- refusals ----------------------------------------------------------------------------------------------------


def test_existing_output_is_refused_before_the_work(here, x, capsys, monkeypatch):
    np.save("x.npy", x)
    Path("y.npy").write_bytes(b"precious")
    with monkeypatch.context() as patch:
        patch.setattr(_files, "read", lambda *_: pytest.fail("read although OUT exists"))
        assert run("x.npy", "y.npy") == 1
    assert "y.npy: exists; give --overwrite" in error_line(capsys)
    assert Path("y.npy").read_bytes() == b"precious"
    assert run("x.npy", "y.npy", "--overwrite") == 0
    np.testing.assert_array_equal(np.load("y.npy"), algdiff.differentiate(x, WINDOW))
    assert leftovers(here) == []


def test_output_that_appears_during_the_run_is_kept(here, x, capsys, monkeypatch):
    np.save("x.npy", x)
    genuine = _files.write

    def late(file, form, table):
        genuine(file, form, table)
        Path("y.npy").write_bytes(b"precious")

    monkeypatch.setattr(_files, "write", late)
    assert run("x.npy", "y.npy") == 1
    assert "appeared during the run" in error_line(capsys)
    assert Path("y.npy").read_bytes() == b"precious"
    assert leftovers(here) == []


@pytest.mark.skipif(os.name == "nt", reason="os.link is not used there")
@pytest.mark.parametrize("taken", [False, True])
def test_folder_without_hard_links(here, x, capsys, monkeypatch, taken):
    np.save("x.npy", x)

    def refuse(*_):
        if taken:
            Path("y.npy").write_bytes(b"precious")
        raise OSError(errno.EPERM, "no links here")

    monkeypatch.setattr(os, "link", refuse)
    assert run("x.npy", "y.npy", "-q") == int(taken)
    if taken:
        assert "appeared during the run" in error_line(capsys)
        assert Path("y.npy").read_bytes() == b"precious"
    else:
        np.testing.assert_array_equal(np.load("y.npy"), algdiff.differentiate(x, WINDOW))
    assert leftovers(here) == []


@pytest.mark.skipif(os.name == "nt", reason="needs links and modes")
def test_overwrite_follows_a_link_and_keeps_the_mode(x):
    np.save("x.npy", x)
    Path("deep").mkdir()
    Path("deep/y.npy").write_bytes(b"old")
    Path("deep/y.npy").chmod(0o600)
    Path("y.npy").symlink_to("deep/y.npy")
    assert run("x.npy", "y.npy", "--overwrite") == 0
    assert Path("y.npy").is_symlink()
    assert Path("deep/y.npy").stat().st_mode & 0o777 == 0o600
    np.testing.assert_array_equal(np.load("deep/y.npy"), algdiff.differentiate(x, WINDOW))


def test_new_output_has_the_usual_mode(x):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy") == 0
    assert Path("y.npy").stat().st_mode == Path("x.npy").stat().st_mode


@pytest.mark.parametrize("target", ["x.npy", "./x.npy", "hard.npy", "soft.npy"])
def test_output_equal_to_input_is_refused(x, capsys, target):
    np.save("x.npy", x)
    before = Path("x.npy").read_bytes()
    os.link("x.npy", "hard.npy")
    Path("soft.npy").symlink_to("x.npy")
    assert run("x.npy", target, "--overwrite") == 2
    assert "OUT must be another file than IN" in error_line(capsys)
    assert Path("x.npy").read_bytes() == before


def test_missing_files_and_folders(x, capsys):
    assert run("none.npy", "y.npy") == 1
    assert error_line(capsys) == "none.npy: No such file or directory"
    np.save("x.npy", x)
    assert run("x.npy", "none/y.npy") == 1
    assert "folder does not exist" in error_line(capsys)
    Path("d.npy").mkdir()
    assert run("x.npy", "d.npy", "--overwrite") == 1
    assert "not a regular file" in error_line(capsys)
    assert run("d.npy", "y.npy") == 1
    assert error_line(capsys).startswith("d.npy: ")


@pytest.mark.parametrize("names", [("x.txt", "y.npy"), ("x.npy", "y"), ("x.npy", "y.npy.gz")])
def test_unknown_suffix(capsys, names):
    assert run(*names) == 2
    assert "must be .npy, .npz or .csv" in error_line(capsys)


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


def test_window_longer_than_the_data(capsys):
    np.save("x.npy", np.zeros(WINDOW - 1))
    assert run("x.npy", "y.npy") == 1
    line = error_line(capsys)
    assert str(WINDOW) in line
    assert str(WINDOW - 1) in line
    assert os.listdir() == ["x.npy"]


@pytest.mark.parametrize("shape", [(), (4, 5, N)])
def test_csv_holds_at_most_two_dimensions(capsys, shape):
    np.save("x.npy", np.zeros(shape))
    assert run("x.npy", "y.csv") == 1
    assert "one or two dimensions" in error_line(capsys)


def test_csv_holds_real_numbers(x, capsys):
    np.save("x.npy", x + 1j)
    assert run("x.npy", "y.csv") == 1
    assert "real numbers" in error_line(capsys)


@pytest.mark.parametrize(
    "flags",
    [
        ["--delta", "1", "--fs", "2"],
        ["--tau", "0.5", "--delay", "1"],
        ["--tau", "middle"],
        ["--mode", "zero"],
        ["--rule", "best"],
        ["--threads", "0"],
        ["--threads", "two"],
        ["--deriv", "1.5"],
        ["--win", "5"],
    ],
)
def test_arguments_argparse_refuses(x, capsys, flags):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy", *flags) == 2
    assert ": error: " in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize(
    ("flags", "word"),
    [
        (["--columns", "a"], "--columns"),
        (["--key", "a"], "--key"),
        (["--cval", "1"], "--cval"),
        (["--degree", "0"], "degree"),
        (["--degree", str(WINDOW)], "degree"),
        (["--kappa", "-1"], "kappa"),
        (["--mu", "nan"], "mu"),
        (["--delta", "0"], "delta"),
        (["--fs", "inf"], "fs"),
        (["--deriv", "-1"], "deriv"),
        (["--window", "0"], "window_length"),
    ],
)
def test_arguments_that_cannot_be_meant(x, capsys, flags, word):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy", *flags) == 2
    assert word in error_line(capsys)
    assert os.listdir() == ["x.npy"]


def test_csv_has_only_one_axis_of_time(x, capsys):
    np.savetxt("x.csv", np.stack([x, x], axis=1), delimiter=",")
    assert run("x.csv", "y.csv", "--axis", 1) == 2
    assert "--axis" in error_line(capsys)
    assert run("x.csv", "y.csv", "--axis", 0) == 0


def test_axis_out_of_bounds(x, capsys):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy", "--axis", 1) == 1
    assert "axis" in error_line(capsys)


# --- whole or absent ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("failure", "code", "message"),
    [
        (
            OSError(errno.ENOSPC, "No space left on device"),
            1,
            "error: y.npy: cannot be written (No space left on device)",
        ),
        (MemoryError("no room"), 1, "error: not enough memory: no room"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
@pytest.mark.parametrize("exists", [False, True])
def test_failure_while_writing(here, x, capsys, monkeypatch, failure, code, message, exists):
    np.save("x.npy", x)
    if exists:
        Path("y.npy").write_bytes(b"precious")

    def fail(file, *_):
        file.write(b"half")
        assert len(leftovers(here)) == 1
        raise failure

    monkeypatch.setattr(_files, "write", fail)
    assert run("x.npy", "y.npy", *["--overwrite"] * exists) == code
    assert capsys.readouterr().err == f"algdiff: {message}\n"
    assert leftovers(here) == []
    assert (Path("y.npy").read_bytes() == b"precious") if exists else not Path("y.npy").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("form", _files.SUFFIXES)
def test_full_disk(x, form):
    table = _files.Table(np.tile(x, 100).reshape(-1, 1))
    with open("/dev/full", "wb", buffering=0) as file, pytest.raises(OSError, match=r"space|requested"):
        _files.write(file, form, table)


def test_bugs_are_not_hidden(x, monkeypatch):
    np.save("x.npy", x)
    monkeypatch.setattr(_files, "write", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run("x.npy", "y.npy")
    assert os.listdir() == ["x.npy"]


@pytest.mark.skipif(os.name == "nt", reason="sends SIGINT")
@pytest.mark.parametrize("exists", [False, True])
def test_ctrl_c_while_writing(here, exists):
    np.save("x.npy", np.zeros((1_000_000, 8)))
    if exists:
        Path("y.csv").write_bytes(b"precious")
    child = process("run", "x.npy", "y.csv", "--window", WINDOW, "--axis", 0, *["--overwrite"] * exists)
    deadline = time.monotonic() + 60
    while not leftovers(here):
        assert child.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.005)
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=60)
    assert (child.returncode, err) == (130, "algdiff: interrupted\n")
    assert leftovers(here) == []
    assert (Path("y.csv").read_bytes() == b"precious") if exists else not Path("y.csv").exists()


# --- what is said ------------------------------------------------------------------------------------------------


def test_summary(x, capsys):
    np.savetxt("x.csv", np.stack([x, x], axis=1), delimiter=",", header="a,b", comments="")
    assert run("x.csv", "y.csv", "--fs", 100) == 0
    out, err = capsys.readouterr()
    design = algdiff.Differentiator(WINDOW, fs=100)
    said = {line[:12].strip(): line[12:] for line in err.splitlines()[1:]}
    assert out == ""
    assert said["window"] == "21 samples, 0.21 s (delta 0.01 s)"
    assert said["delay"] == f"10 samples, {design.delay:g} s"
    assert said["noise gain"] == f"{design.noise_gain:.4g}"
    assert said["samples"] == "200 x 2 (a, b)"
    assert re.fullmatch(r"\S+ s", said["time"])


def test_summary_without_a_step_says_so(x, capsys):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy") == 0
    assert "window      21 samples, 21 (delta 1, no unit)\n" in capsys.readouterr().err
    assert run("x.npy", "z.npy", "-q") == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.filterwarnings("default")
def test_design_warning_is_one_line(x, capsys):
    np.save("x.npy", x)
    with pytest.warns(algdiff.DesignWarning):
        algdiff.Differentiator(WINDOW, degree=WINDOW - 1)
    assert run("x.npy", "y.npy", "--degree", WINDOW - 1, "-q") == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("algdiff: warning: ")


def test_progress_only_on_a_terminal(x, capsys, monkeypatch):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy") == 0
    assert "\r" not in capsys.readouterr().err
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert run("x.npy", "z.npy", "-q") == 0
    assert capsys.readouterr().err == ""
    with _cli._bar(True) as draw:
        for fraction in (0.0, 0.501, 0.502, 1.0):
            draw(fraction)
    drawn = capsys.readouterr().err.split("\r")
    assert [part[-5:] for part in drawn[1:4]] == ["  0 %", " 50 %", "100 %"]
    assert drawn[4].strip() == ""
    assert len(drawn[4]) >= len(drawn[3])
    assert drawn[5:] == [""]


@pytest.mark.parametrize(("terminal", "quiet"), [(False, False), (True, False), (True, True)])
def test_run_draws_progress_and_erases_it_before_an_error(x, capsys, monkeypatch, terminal, quiet):
    def fail(_, *, progress, **__):
        if progress is not None:
            progress(0.5)
        raise ValueError("half way")

    np.save("x.npy", x)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    monkeypatch.setattr(_cli, "_design", lambda _: fail)
    assert run("x.npy", "y.npy", *["-q"] * quiet) == 1
    before, _, after = capsys.readouterr().err.rpartition("\r")
    assert after == "algdiff: error: half way\n"
    assert ("50 %" in before) == (terminal and not quiet)


@pytest.mark.parametrize(("flags", "threads"), [([], None), (["--threads", "3"], 3)])
def test_threads_reach_the_library(x, monkeypatch, flags, threads):
    got = []
    np.save("x.npy", x)
    monkeypatch.setattr(_cli, "_design", lambda _: lambda array, **words: got.append(words) or array)
    assert run("x.npy", "y.npy", "-q", *flags) == 0
    assert got == [{"axis": -1, "mode": "fit", "threads": threads, "progress": None}]


def test_no_verb_prints_the_help(capsys):
    assert main([]) == 2
    assert "usage: algdiff" in capsys.readouterr().err
    for arguments in (["--help"], ["run", "--help"], ["stream", "--help"], ["demo", "--help"]):
        assert main(arguments) == 0
        assert "usage: algdiff" in capsys.readouterr().out


def test_help_and_glossary_name_the_same_choices(x):
    for mode in _cli.MODES:
        algdiff.differentiate(x, WINDOW, mode=mode)
    for rule in _cli.RULES:
        algdiff.Differentiator(WINDOW, rule=rule)
    for tau in _cli.TAUS:
        algdiff.Differentiator(WINDOW, tau=tau)


# --- as a process ------------------------------------------------------------------------------------------------


def test_module_and_exit_codes(x):
    np.save("x.npy", x)
    for arguments, code in (
        (["--version"], 0),
        ([], 2),
        (["run", "x.npy", "y.npy"], 2),
        (["run", "none.npy", "y.npy", "--window", 5], 1),
        (["run", "x.npy", "y.npy", "--window", 5], 0),
    ):
        child = process(*arguments)
        out, err = child.communicate(timeout=60)
        assert child.returncode == code, err
        assert "Traceback" not in err
        if arguments == ["--version"]:
            assert out == f"algdiff {version('algdiff-rs')}\n"
    np.testing.assert_array_equal(np.load("y.npy"), algdiff.differentiate(x, 5))


@pytest.mark.skipif(os.name == "nt", reason="closes a pipe early")
def test_broken_pipe_is_quiet():
    reader, writer = os.pipe()
    os.close(reader)
    child = process("--version", stdout=writer)
    os.close(writer)
    _, err = child.communicate(timeout=60)
    assert (child.returncode, err) == (1, "")


def test_import_stays_light():
    code = (
        "import sys, algdiff._cli as c; c.main(['--help']); print(sorted({'matplotlib', 'scipy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.endswith("[]\n")


# --- demo --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def demo(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("demo") / "out"
    assert main(["demo", "--output", str(folder), "--threads", "1"]) == 0
    return folder


def test_demo_obeys_the_pendulum(demo):
    with np.load(demo / "pendulum.npz") as data:
        assert set(data.files) == {"t", "theta", "angle", "velocity", "acceleration"}
        assert {data[name].shape for name in data.files} == {(231_757,)}
        angle, velocity, acceleration = (data[name][2047:-1601] for name in ("angle", "velocity", "acceleration"))
        assert np.abs(data["angle"] - data["theta"])[2047:-1601].max() < 5 * 2 * np.pi / 40_000
        assert data["t"][-1] == pytest.approx(23.1756)
        for deriv, name in enumerate(("angle", "velocity", "acceleration")):
            expected = algdiff.differentiate(data["theta"], 1601, deriv, degree=5, kappa=0, mu=0, delta=1e-4)
            np.testing.assert_array_equal(data[name], expected)
    regressors = np.stack([np.sin(angle), -velocity], axis=1)
    (a, b), residual, *_ = np.linalg.lstsq(regressors, acceleration, rcond=None)
    r2 = 1 - residual[0] / ((acceleration - acceleration.mean()) ** 2).sum()
    assert r2 >= 0.9965
    assert abs(a - 65.0) <= 0.3
    assert 0.5 < b < 0.75
    law = _demo.fit(_demo.Estimates(*(_padded(values) for values in (angle, velocity, acceleration)), seconds=0.0))
    assert law == pytest.approx((a, b, r2), rel=1e-9)


def _padded(values: np.ndarray) -> np.ndarray:
    return np.pad(values, (2047, 1601))


def test_demo_draws_when_it_can(demo):
    pytest.importorskip("matplotlib")
    content = (demo / "pendulum.png").read_bytes()
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    assert content.endswith(b"IEND\xaeB`\x82")


def test_demo_report(here, capsys):
    assert main(["demo"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "1601 samples, 0.1601 s; degree 5" in out
    assert "delay        800 samples, 0.08 s" in out
    assert float(re.search(r"R\^2 = (\S+)", out)[1]) >= 0.9965
    assert abs(float(re.search(r"a = (\S+) 1/s", out)[1]) - 65.0) <= 0.3
    assert main(["demo"]) == 0, "an earlier result is replaced"
    assert leftovers(here / "algdiff-demo") == []


@pytest.mark.parametrize(
    ("total", "offset", "verdict"), [(1.0, 0.0, "sound"), (1.0 + 1e-6, 0.0, "lost digits"), (1e-10, 4000.0, "garbage")]
)
def test_demo_judges_scipy_by_what_it_measures(monkeypatch, total, offset, verdict):
    scipy = pytest.importorskip("scipy.signal")
    theta, delta = _demo.recording()
    _, ours = _demo.estimate(theta, delta, 1)
    monkeypatch.setattr(_demo, "_savgol", lambda *_: ours._replace(acceleration=ours.acceleration + offset))
    monkeypatch.setattr(scipy, "savgol_coeffs", lambda *_: np.full(1601, total / 1601))
    said = _demo._comparison(scipy, theta, delta, ours, _demo.fit(ours))
    assert [word for word in ("sound", "lost digits", "garbage") if word in said] == [verdict]


def test_demo_without_matplotlib_and_scipy(capsys, monkeypatch):
    monkeypatch.setattr(_demo, "_optional", lambda _: None)
    assert main(["demo", "--output", "plain"]) == 0
    out = capsys.readouterr().out
    assert "pip install matplotlib" in out
    assert "pip install scipy" in out
    assert os.listdir("plain") == ["pendulum.npz"]


def test_demo_output_must_be_a_folder(capsys):
    Path("taken").write_bytes(b"precious")
    assert main(["demo", "--output", "taken"]) == 1
    assert error_line(capsys).startswith("taken: ")
    assert Path("taken").read_bytes() == b"precious"


def test_recording_is_the_published_one():
    theta, delta = _demo.recording()
    assert (len(theta), delta) == (231_757, 1e-4)
    counts = theta * 40_000 / (2 * np.pi)
    assert np.abs(counts - np.round(counts)).max() < 1e-6
    assert theta[0] == pytest.approx(3.0755, abs=1e-4)
    licence = (Path(_demo.__file__).parent / "data" / "LICENSE-pendulum_encoder").read_text(encoding="utf-8")
    assert "Copyright (c) 2022 dynamicslab" in licence
    assert "Permission is hereby granted" in licence
