"""``algdiff run``: its summary, JSON and progress."""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import algdiff
from algdiff import _cli_run, _file_run
from cli import WINDOW, N, error_line, here, run, x


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


@pytest.mark.parametrize(
    ("flags", "line"),
    [
        (["--fs", "1kHz", "--window", "50ms"], "window      50 samples, 0.05 s (delta 0.001 s)"),
        (["--deriv", "0,1"], "delay       10 samples, 10"),
        (["--dry-run"], "blocks      1, with "),
        (["--dry-run"], "output      200 float64, 1.6 kB"),
        (["--dry-run"], "x.npy -> y.npy (nothing is written)"),
        (["--dry-run"], "time        about "),
    ],
)
def test_summary_lines(x, capsys, flags, line):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy", *flags) == 0
    assert any(said.startswith(line) for said in capsys.readouterr().err.splitlines())


SCHEMA = {
    "source": str,
    "target": str,
    "shape": list,
    "dtype": str,
    "result_shape": list,
    "result_dtype": str,
    "axis": int,
    "delta": (float, type(None)),
    "window_length": int,
    "deriv": (int, list),
    "delay": float,
    "noise_gain": (float, list),
    "engine": str,
    "blocks": int,
    "block_shape": list,
    "resumed": int,
    "memory": int,
    "bytes_read": int,
    "bytes_written": int,
    "seconds": float,
    "dry_run": bool,
}


@pytest.mark.parametrize("dry", [False, True])
@pytest.mark.parametrize("flags", [[], ["--fs", "50", "--deriv", "0,2"]])
def test_json(x, capsys, dry, flags):
    np.save("x.npy", np.stack([x, x]))
    assert run("x.npy", "y.npy", "--json", *flags, *["--dry-run"] * dry) == 0
    out, err = capsys.readouterr()
    assert err == ""
    said = json.loads(out)
    assert out.count("\n") == 1
    assert list(said) == list(SCHEMA)
    for name, kind in SCHEMA.items():
        assert isinstance(said[name], kind), name
    orders = 2 if flags else 1
    assert (said["shape"], said["result_shape"]) == ([2, N], [2, 2, N] if flags else [2, N])
    assert (said["delta"], said["deriv"]) == ((0.02, [0, 2]) if flags else (None, 1))
    assert (said["bytes_read"], said["bytes_written"]) == (16 * N, 16 * N * orders)
    assert said["dry_run"] is dry
    assert sorted(os.listdir()) == (["x.npy"] if dry else ["x.npy", "y.npy"])


def test_json_of_a_failure_is_an_error_line(capsys):
    assert run("none.npy", "y.npy", "--json") == 1
    assert error_line(capsys) == "none.npy: No such file or directory"


def drawn(err: str) -> list[str]:
    """Return the lines that were drawn over each other."""
    return [part.rstrip() for part in err.split("\r") if part.strip()]


def test_progress_only_on_a_terminal(x, capsys, monkeypatch):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy") == 0
    assert "\r" not in capsys.readouterr().err
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    for target, flag in (("q.npy", "-q"), ("j.npy", "--json"), ("d.npy", "--dry-run")):
        assert run("x.npy", target, flag) == 0
        assert "\r" not in capsys.readouterr().err
    assert run("x.npy", "z.npy") == 0
    shown, said = capsys.readouterr().err.rsplit("\r", 1)
    assert re.search(r"\[#* *\] +\d+ %", shown)
    assert said.startswith("x.npy -> z.npy\n")


def test_bar(capsys, monkeypatch):
    clock = iter([10.0, 10.05, 12.0, 12.09, 12.1])
    monkeypatch.setattr(_cli_run.time, "monotonic", lambda: next(clock))
    monkeypatch.setenv("COLUMNS", "100")
    with _cli_run.Bar(True) as bar:
        bar.start(4_000_000, 8)
        for fraction in (0.25, 0.3, 0.5, 0.7, 1.0):
            bar.draw(fraction)
    err = capsys.readouterr().err
    # A quarter in two seconds; the first was there before. What comes within a tenth of a second is not drawn.
    assert drawn(err) == [
        "[######                  ]  25 %",
        "[############            ]  50 %  4 MB/s  500 ksamples/s  4 s left",
        "[########################] 100 %  11.4 MB/s  1.43 Msamples/s  0 s left",
    ]
    assert err.endswith("\r")
    widths = [len(part) for part in err.split("\r")[1:-1]]
    assert widths == sorted(widths), "shorter lines leave the ends of longer ones"


def test_bar_stays_in_its_line(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    with _cli_run.Bar(True) as bar:
        bar.draw(0.5)
    assert max(len(part) for part in capsys.readouterr().err.split("\r")) == 19


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "0 s"), (59.4, "59 s"), (59.6, "1 min 0 s"), (3599.6, "1 h 0 min"), (90_061, "25 h 1 min")],
)
def test_time_left(seconds, text):
    assert _cli_run._clock(seconds) == text


@pytest.mark.parametrize(("terminal", "quiet"), [(False, False), (True, False), (True, True)])
def test_run_draws_progress_and_erases_it_before_an_error(x, capsys, monkeypatch, terminal, quiet):
    def fail(_, *, progress, **__):
        if progress is not None:
            progress(0.5)
        raise ValueError("half way")

    np.save("x.npy", x)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    monkeypatch.setattr(_file_run, "run", fail)
    assert run("x.npy", "y.npy", *["-q"] * quiet) == 1
    before, _, after = capsys.readouterr().err.rpartition("\r")
    assert after == "algdiff: error: half way\n"
    assert ("50 %" in before) == (terminal and not quiet)
