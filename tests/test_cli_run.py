"""``algdiff run``: what options do, and what is refused."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import _file, _file_job, _file_run
from algdiff import _formats as formats
from algdiff._formats.base import Options, Source
from cli import WINDOW, N, error_line, here, leftovers, run, x

# --- options ----------------------------------------------------------------------------------------------------------


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
        (["--deriv", "0,1,2"], {"deriv": (0, 1, 2)}),
        (["--engine", "fft"], {"engine": "fft"}),
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


# What is given, and what `differentiate_with` gets of it: the word, or "options." and the field of `Options`.
GIVEN = [
    ([], {"step": None, "axis": None, "mode": "fit", "cval": 0.0, "overwrite": False, "resume": False}),
    (
        [],
        {
            "dry_run": False,
            "memory": 512 << 20,
            "threads": None,
            "progress": None,
            "options": Options(),
        },
    ),
    (["--fs", "1kHz"], {"step": 1e-3}),
    (["--delta", "2ms"], {"step": 2e-3}),
    (["--overwrite"], {"overwrite": True}),
    (["--resume"], {"resume": True}),
    (["--dry-run"], {"dry_run": True}),
    (["--threads", "3"], {"threads": 3}),
    (["--nan-policy", "omit", "--min-support", "9", "--max-gain", "3"], {"missing": _file_job.Missing("omit", 9, 3.0)}),
    (["--memory", "2MiB"], {"memory": 2 << 20}),
    (["--memory", "3MB"], {"memory": 3_000_000}),
    (["--memory", "1.5GiB"], {"memory": 3 << 29}),
    (["--memory", "2000000"], {"memory": 2_000_000}),
    (["--axis", "-1"], {"axis": -1}),
    (["--mode", "constant", "--cval", "-2"], {"mode": "constant", "cval": -2.0}),
]
READ = [
    (["x.csv"], ["--columns", "a, 1"], Options(columns=("a", "1"))),
    (["x.csv"], ["--time", "t"], Options(time="t")),
    (["x.npz"], ["--key", "a"], Options(key="a")),
    (["x.bin"], ["--dtype", ">i2"], Options(dtype=np.dtype(">i2"))),
    (["x.bin"], ["--channels", "2", "--offset", "44"], Options(channels=2, offset=44)),
]


@pytest.fixture
def asked(monkeypatch):
    """Return what the library is asked for."""
    got: dict[str, Any] = {}
    genuine = _file.differentiate_with

    def differentiate_with(make, options, src, dst, **words):
        got.update(words, options=options, src=src, dst=dst)
        return genuine(make, options, src, dst, **words)

    monkeypatch.setattr(_file, "differentiate_with", differentiate_with)
    return got


@pytest.mark.parametrize(("flags", "words"), GIVEN)
def test_the_library_gets_what_is_given(x, asked, flags, words):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy", "-q", *flags) == 0
    assert (asked["src"], asked["dst"]) == ("x.npy", "y.npy")
    assert {name: asked[name] for name in words} == words


@pytest.mark.parametrize(("names", "flags", "options"), READ)
def test_the_library_gets_how_to_read(asked, names, flags, options):
    assert run(*names, "y.npy", *flags) == 1, "there is no such file"
    assert asked["options"] == options


@pytest.mark.parametrize("deriv", ["1", "0,1,2"])
@pytest.mark.parametrize(("window", "seconds"), [("50ms", 0.05), ("0.0504 s", 0.0504), ("40000us", 0.04)])
def test_windows_by_their_duration(x, window, seconds, deriv):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy", "--window", window, "--fs", "1kHz", "--deriv", deriv) == 0
    orders = tuple(map(int, deriv.split(",")))
    design = algdiff.Differentiator.from_duration(seconds, orders[-1], fs=1000)
    design = algdiff.Differentiator(design.window_length, orders if len(orders) > 1 else orders[0], fs=1000)
    np.testing.assert_array_equal(np.load("y.npy"), design(x))


@pytest.mark.parametrize("flags", [["--window", "5ms"], ["--delay", "5ms"]])
def test_units_need_a_step_once_the_file_states_none(x, capsys, flags):
    np.save("x.npy", x)
    assert run("none.npy", "y.npy", *flags) == 1
    assert error_line(capsys) == "none.npy: No such file or directory"
    assert run("x.npy", "y.npy", *flags) == 2
    assert error_line(capsys).startswith("--fs or --delta must be given for numbers in ms, got neither")
    assert os.listdir() == ["x.npy"]


@pytest.mark.parametrize("flags", [["--window", "0.4 s"], ["--delay", "100ms"]])
def test_the_step_of_the_file_counts_unless_one_is_given(x, capsys, monkeypatch, flags):
    np.save("x.npy", x)
    monkeypatch.setattr(Source, "step_along", lambda *_: 0.02)
    assert run("x.npy", "y.npy", *flags) == 0
    assert " (delta 0.02 s from the file)\n" in capsys.readouterr().err
    window = 20 if "--window" in flags else WINDOW
    delay = 0.1 if "--delay" in flags else None
    np.testing.assert_array_equal(np.load("y.npy"), algdiff.differentiate(x, window, delta=0.02, delay=delay))
    assert run("x.npy", "z.npy", *flags, "--delta", "40ms") == 0
    assert " (delta 0.04 s)\n" in capsys.readouterr().err


def test_deriv_lists_lie_along_a_leading_axis(x):
    np.save("x.npy", np.stack([x, x**2]))
    assert run("x.npy", "y.npy", "--deriv", "2,0") == 0
    written = np.load("y.npy")
    assert written.shape == (2, 2, N)
    np.testing.assert_array_equal(written, algdiff.differentiate(np.stack([x, x**2]), WINDOW, (2, 0)))


def test_a_dry_run_writes_nothing_and_refuses_as_a_run_does(x, capsys):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy", "--dry-run") == 0
    assert os.listdir() == ["x.npy"]
    Path("y.npy").write_bytes(b"precious")
    capsys.readouterr()
    assert run("x.npy", "y.npy", "--dry-run") == 1
    assert error_line(capsys) == "y.npy: exists; give --overwrite to replace it"
    assert run("x.npy", "y.npy", "--dry-run", "--overwrite") == 0
    assert Path("y.npy").read_bytes() == b"precious"


# --- refusals ---------------------------------------------------------------------------------------------------------


def test_existing_output_is_refused_before_the_work(here, x, capsys, monkeypatch):
    np.save("x.npy", x)
    Path("y.npy").write_bytes(b"precious")
    with monkeypatch.context() as patch:
        patch.setattr(formats, "open_source", lambda *_: pytest.fail("read although OUT exists"))
        assert run("x.npy", "y.npy") == 1
    assert "y.npy: exists; give --overwrite" in error_line(capsys)
    assert Path("y.npy").read_bytes() == b"precious"
    assert run("x.npy", "y.npy", "--overwrite") == 0
    np.testing.assert_array_equal(np.load("y.npy"), algdiff.differentiate(x, WINDOW))
    assert leftovers(here) == []


def test_output_that_appears_during_the_run_is_kept(here, x, capsys, monkeypatch):
    np.save("x.npy", x)
    genuine = _file_run._finish

    def late(*words):
        Path("y.npy").write_bytes(b"precious")
        genuine(*words)

    with monkeypatch.context() as patch:
        patch.setattr(_file_run, "_finish", late)
        assert run("x.npy", "y.npy") == 1
    line = error_line(capsys)
    assert "y.npy: appeared during the run; give --overwrite to replace it" in line
    assert line.endswith("; what is finished is kept in y.npy.partial: go on with --resume")
    assert Path("y.npy").read_bytes() == b"precious"
    assert leftovers(here) == ["y.npy.partial", "y.npy.partial.journal"]
    assert run("x.npy", "y.npy", "--resume", "--overwrite") == 0
    assert "blocks      1, of which 1 were finished before\n" in capsys.readouterr().err
    np.testing.assert_array_equal(np.load("y.npy"), algdiff.differentiate(x, WINDOW))
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
    assert len(leftovers(here)) == 2 * taken


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


def test_window_longer_than_the_data(capsys):
    np.save("x.npy", np.zeros(WINDOW - 1))
    assert run("x.npy", "y.npy") == 1
    line = error_line(capsys)
    assert str(WINDOW) in line
    assert str(WINDOW - 1) in line
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
