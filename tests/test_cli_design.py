"""``algdiff design``: table, JSON, picture and header say what the library says; refusals; whole files."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import subprocess
import sys
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algdiff import _cli, _output, _report, _units
from algdiff._cli import main
from algdiff._differentiator import Differentiator

FROM = {
    "--duration": Differentiator.from_duration,
    "--cutoff": Differentiator.from_cutoff,
    "--for-delay": Differentiator.from_delay,
    "--notch": Differentiator.from_notch,
}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: object) -> int:
    return main(["design", *map(str, arguments)])


def printed(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """Return what is on stdout, with nothing on stderr."""
    assert run(*arguments) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return str(out)


def error_line(capsys: pytest.CaptureFixture[str]) -> str:
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("algdiff: error: ")
    return str(line.removeprefix("algdiff: error: "))


# --- the numbers -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        (["--window", 21], Differentiator(21)),
        (["--window", 21, "--deriv", 2, "--fs", 50], Differentiator(21, 2, fs=50)),
        (["--duration", "0.1s", "--fs", 1000], Differentiator.from_duration(0.1, fs=1000)),
        (["--duration", "100ms", "--fs", "1kHz"], Differentiator.from_duration(0.1, fs=1000)),
        (["--duration", "100", "--rule", "hat"], Differentiator.from_duration(100, rule="hat")),
        (["--cutoff", "20Hz", "--fs", 1000], Differentiator.from_cutoff(20, fs=1000)),
        (["--cutoff", "0.02kHz", "--delta", "1ms"], Differentiator.from_cutoff(20, delta=0.001)),
        (["--cutoff", 0.02], Differentiator.from_cutoff(0.02)),
        (["--cutoff", "125rad/s", "--fs", 1000], Differentiator.from_cutoff(125, unit="rad/s", fs=1000)),
        (["--for-delay", "50ms", "--tau", "root", "--fs", 1000], Differentiator.from_delay(0.05, tau="root", fs=1000)),
        (["--for-delay", "50000 us", "--tau", 0.6, "--fs", 1000], Differentiator.from_delay(0.05, tau=0.6, fs=1000)),
        (["--notch", "50Hz", "--fs", 1000], Differentiator.from_notch(50, fs=1000)),
        (["--notch", "300rad/s", "--fs", 1000], Differentiator.from_notch(300, unit="rad/s", fs=1000)),
        (["--cutoff", 20, "--delay", "5ms", "--fs", 1e3], Differentiator.from_cutoff(20, delay=0.005, fs=1000)),
        (
            ["--window", 45, "--degree", 4, "--kappa", 3, "--mu", 2.5, "--tau", 0.7, "--rule", "cell", "--trim", 0.01],
            Differentiator(45, degree=4, kappa=3, mu=2.5, tau=0.7, rule="cell", trim=0.01),
        ),
        (["--window", 45, "--rule", "trapezoid", "--kappa", 0], Differentiator(45, rule="trapezoid", kappa=0)),
    ],
)
def test_json_and_table_are_the_summary_of_the_design(
    capsys: pytest.CaptureFixture[str], flags: list[object], expected: Differentiator
) -> None:
    found = json.loads(printed(capsys, *flags, "--json"))
    weights = found.pop("weights")
    assert np.array(weights).tobytes() == expected.weights.tobytes()
    assert found == expected.summary()
    assert list(found) == list(expected.summary())
    table = printed(capsys, *flags)
    rows = {line[:22].strip(): line[22:36].strip() for line in table.splitlines()}
    assert list(rows) == list(found)
    for name, value in found.items():
        shown = "none" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
        assert rows[name] == shown
    for line in table.splitlines():
        assert line[36:] == _report.unit(line[:22].strip(), expected)
    assert not os.listdir()


def test_the_documented_table_is_what_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).parents[1] / "docs" / "design.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"```sh\nalgdiff design (.*)\n```", page)
    (table,) = re.findall(r"```text\n(.*?)```", page, re.DOTALL)
    assert printed(capsys, *command.partition(" --plot")[0].split()) == table


def test_the_summary_is_what_the_attributes_say() -> None:
    design = Differentiator.from_cutoff(20, fs=1000, degree=4, mu=2, tau="root").replace(trim=0.001)
    summary = design.summary()
    assert summary.pop("weight_count") == design.weights.size < design.window_length
    assert summary.pop("roll_off") == 20 * design.kernel.roll_off
    assert summary.pop("discretisation_error") == design.discretisation_error()
    for name, value in summary.items():
        assert value == getattr(design, name), name
        assert type(value) in (int, float, str), name
    assert summary.keys() >= {"delay", "moment_delay", "exactness", "noise_gain", "norm1", "bias_bound", "cutoff"}


def test_what_is_missing_or_infinite_is_none() -> None:
    leaking = Differentiator(51, 1, rule="trapezoid", kappa=0, tau="newest").summary()
    assert leaking["bias_bound"] is None
    without = Differentiator(51, 0, degree=1, kappa=1, mu=0).summary()
    assert without["cutoff"] is without["nyquist_attenuation"] is None
    for summary in (leaking, without):
        json.dumps(summary, allow_nan=False)


@pytest.mark.parametrize(
    ("name", "deriv", "unit", "unit_of_samples"),
    [
        ("window_length", 1, "samples", "samples"),
        ("delay", 1, "s", "samples"),
        ("fs", 1, "Hz", ""),
        ("cutoff", 1, "Hz", "cycles/sample"),
        ("noise_gain", 0, "", ""),
        ("noise_gain", 2, "s^-4", "sample^-4"),
        ("norm1", 1, "1/s", "1/sample"),
        ("bias_bound", 1, "s^4", "sample^4"),
        ("kappa", 1, "", ""),
        ("roll_off", 1, "dB per decade", "dB per decade"),
    ],
)
def test_units(name: str, deriv: int, unit: str, unit_of_samples: str) -> None:
    assert _report.unit(name, Differentiator(21, deriv, fs=10)) == unit
    assert _report.unit(name, Differentiator(21, deriv)) == unit_of_samples


def test_the_roll_off_is_that_of_the_response() -> None:
    design = Differentiator(101, 2, kappa=0.5, mu=3, fs=1000)
    low, high = (1e4 / (2 * math.pi), 1e5 / (2 * math.pi))
    upper = design.asymptotes([low, high]).upper / np.array([low, high]) ** 2
    assert 20 * math.log10(upper[0] / upper[1]) == pytest.approx(design.summary()["roll_off"], rel=1e-3)


# --- numbers with units ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("read", "text", "value", "unit"),
    [
        (_units.time, "0.1", 0.1, None),
        (_units.time, "0.1s", 0.1, "s"),
        (_units.time, "7ms", 0.007, "ms"),
        (_units.time, " 3.3 us ", 3.3e-6, "us"),
        (_units.time, "1e3ms", 1.0, "ms"),
        (_units.time, "-5ms", -0.005, "ms"),
        (_units.rate, "44.1kHz", 44100.0, "kHz"),
        (_units.rate, "50Hz", 50.0, "Hz"),
        (_units.frequency, "125rad/s", 125.0, "rad/s"),
        (_units.frequency, "0.3kHz", 300.0, "kHz"),
        (_units.frequency, "1e-3", 1e-3, None),
    ],
)
def test_numbers_with_units_are_the_nearest_floats(read: Any, text: str, value: float, unit: str | None) -> None:
    quantity = read(text)
    assert (float(quantity), quantity.unit) == (value, unit)


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (_units.time, "20Hz"),
        (_units.time, "1min"),
        (_units.time, "1e"),
        (_units.time, ""),
        (_units.time, "s"),
        (_units.time, "1 m s"),
        (_units.time, "1ks"),
        (_units.rate, "5rad/s"),
        (_units.rate, "5hz"),
        (_units.frequency, "5s"),
        (_units.frequency, "5 Hz Hz"),
        (_units.frequency, "1e9999999999999999999kHz"),
    ],
)
def test_other_units_are_refused(read: Any, text: str) -> None:
    with pytest.raises(ArgumentTypeError, match=r"must be a (time|rate|frequency) like .*, got "):
        read(text)


# --- refusals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--cutoff", "20Hz"], "--fs or --delta must be given for numbers in Hz, got neither"),
        (["--for-delay", "20ms"], "--fs or --delta must be given for numbers in ms, got neither"),
        (["--window", 21, "--delay", "2s"], "--fs or --delta must be given for numbers in s, got neither"),
        (["--cutoff", "400Hz", "--fs", 1000], "cutoff must be at most"),
        (["--cutoff", -5], "cutoff must be finite and positive, got -5.0"),
        (["--cutoff", "nan"], "cutoff must be finite and positive, got nan"),
        (["--duration", "1ms", "--fs", 1000], "duration must be at least 0.004"),
        (["--duration", "inf"], "duration must be finite and positive"),
        (["--notch", "600Hz", "--fs", 1000], "frequency must be below half the sampling rate"),
        (["--notch", 0.1, "--kappa", 2], "kappa and mu must be equal for a notch"),
        (["--notch", 0.1, "--tau", "newest"], "--tau must be 'center' for a notch"),
        (["--for-delay", 10, "--tau", "newest"], "--tau must be a point before the newest sample"),
        (["--for-delay", 10, "--delay", 5], "--delay must be left out with --for-delay, got 5.0 and 10.0"),
        (["--window", 3], "--window: window_length must be at least degree + 1"),
        (["--window", 20, "--rule", "simpson"], "--window: window_length must be odd"),
        (["--window", 20, "--trim", 0.7], "--trim must be at least 0 and less than 1/2"),
        (["--window", 20, "--fs", 0], "--fs must be finite and positive"),
        (["--window", 21, "--plot", "x.jpg"], "--plot must be a .png, .pdf or .svg FILE, got x.jpg"),
        (["--window", 21, "--plot", "x"], "--plot must be a .png, .pdf or .svg FILE, got x"),
        (["--window", 21, "--name", "d"], "--name is for --c, got --name d alone"),
        (["--window", 21, "--float"], "--float is for --c, got --float alone"),
        (
            ["--window", 21, "--plot", "x.png", "--c", "./x.png"],
            "--plot and --c must be different files, got x.png twice",
        ),
        (["--window", 21, "--c", "x.h", "--name", "2d"], "--name must be a C identifier"),
        (["--window", 21, "--c", "x.h", "--name", "int", "--plot", "x.png"], "--name must be a C identifier"),
    ],
)
def test_what_cannot_be_meant(capsys: pytest.CaptureFixture[str], flags: list[object], message: str) -> None:
    assert run(*flags) == 2
    assert error_line(capsys).startswith(message)
    assert not os.listdir()


@pytest.mark.parametrize(
    "flags",
    [
        [],
        ["--window", 21, "--cutoff", 0.1],
        ["--notch", 0.1, "--for-delay", 3],
        ["--cutoff", "20s"],
        ["--duration", "20Hz"],
        ["--window", 21, "--fs", "3rad/s"],
        ["--window", 21.5],
        ["--window", 21, "--tau", 0.5, "--delay", 1],
        ["--window", 21, "--fs", 1, "--delta", 1],
        ["--window", 21, "--rule", "boole"],
        ["--win", 21],
        ["--window", 21, "--mode", "valid"],
    ],
)
def test_what_argparse_refuses(capsys: pytest.CaptureFixture[str], flags: list[object]) -> None:
    assert run(*flags) == 2
    assert ": error: " in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.filterwarnings("default")
def test_warnings_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for flags, said in (
        (["--window", 21, "--degree", 15], "algdiff: warning: degree 15 exceeds"),
        (["--cutoff", "230Hz", "--fs", 1000], "algdiff: warning: the Nyquist frequency is damped by"),
    ):
        assert run(*flags, "--json") == 0
        out, err = capsys.readouterr()
        json.loads(out)
        (line,) = err.splitlines()
        assert line.startswith(said)


# --- files -------------------------------------------------------------------------------------------------------


def test_the_header_is_that_of_the_library(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--cutoff", "20Hz", "--fs", 1000, "--c", "d.h") == 0
    assert Path("d.h").read_text(encoding="ascii") == Differentiator.from_cutoff(20, fs=1000).to_c()
    out, err = capsys.readouterr()
    assert out.startswith("window_length         47 ")
    assert err == "wrote d.h\n"
    assert run("--window", 21, "--c", "v.h", "--name", "velocity") == 0
    assert Path("v.h").read_text(encoding="ascii") == Differentiator(21).to_c("velocity")
    assert run("--window", 21, "--c", "f.h", "--float") == 0
    assert Path("f.h").read_text(encoding="ascii") == Differentiator(21).to_c(dtype="float32")


@pytest.mark.parametrize(("suffix", "start"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("SVG", b"<?xml")])
def test_pictures(suffix: str, start: bytes) -> None:
    pytest.importorskip("matplotlib")
    assert run("--window", 21, "--plot", f"d.{suffix}", "--json") == 0
    assert os.listdir() == [f"d.{suffix}"]
    assert Path(f"d.{suffix}").read_bytes().startswith(start)


def test_a_picture_needs_no_display() -> None:
    pytest.importorskip("matplotlib")
    bare = {
        name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND")
    }
    command = [sys.executable, "-m", "algdiff", "design", "--window", "21", "--plot", "d.png"]
    done = subprocess.run(command, env=bare, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert Path("d.png").read_bytes().endswith(b"IEND\xaeB`\x82")


def test_one_file_under_two_names_is_still_one(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    (here / "pictures").mkdir()
    (here / "link.svg").symlink_to("page.svg")
    for other in ("pictures/../page.svg", here / "page.svg", "link.svg"):
        assert run("--window", 21, "--plot", "page.svg", "--c", other) == 2
        assert "--plot and --c must be different files" in error_line(capsys)
    assert not (here / "page.svg").exists()


@pytest.mark.parametrize("flag", ["--plot", "--c"])
def test_existing_files_are_kept(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, flag: str
) -> None:
    pytest.importorskip("matplotlib")
    Path("taken.png").write_bytes(b"precious")
    other = "--c" if flag == "--plot" else "--plot"
    with monkeypatch.context() as patch:
        patch.setattr(_output, "replacing", lambda *_: pytest.fail("wrote although a file exists"))
        assert run("--window", 21, flag, "taken.png", other, "new.png") == 1 if flag == "--plot" else True
        assert run("--window", 21, flag, "taken.png") == 1
    assert set(capsys.readouterr().err.splitlines()) == {
        "algdiff: error: taken.png: exists; give --overwrite to replace it"
    }
    assert os.listdir() == ["taken.png"]
    assert Path("taken.png").read_bytes() == b"precious"
    assert run("--window", 21, flag, "taken.png", "--overwrite") == 0
    assert Path("taken.png").read_bytes() != b"precious"


@pytest.mark.parametrize("exists", [False, True])
def test_files_appear_whole_or_not_at_all(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, exists: bool
) -> None:
    if exists:
        Path("d.h").write_bytes(b"precious")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert run("--window", 21, "--c", "d.h", *["--overwrite"] * exists) == 1
    assert error_line(capsys) == "d.h: cannot be written (No space left on device)"
    assert os.listdir() == ["d.h"] * exists
    assert not exists or Path("d.h").read_bytes() == b"precious"


def test_nothing_is_written_when_the_picture_fails(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("matplotlib", "matplotlib.figure", "matplotlib.axes"):
        monkeypatch.setitem(sys.modules, name, None)
    assert run("--window", 21, "--plot", "d.png", "--c", "d.h") == 1
    assert error_line(capsys).startswith("pictures need matplotlib: pip install 'algdiff-rs[plot]'")
    assert not os.listdir()


def test_missing_folders(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--window", 21, "--c", "none/d.h") == 1
    assert error_line(capsys) == "none/d.h: its folder does not exist: make it first"


# --- what run shares ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "options"),
    [
        *((["--rule", rule], {"rule": rule}) for rule in _cli.RULES),
        (["--trim", 0.01, "--kappa", 3], {"trim": 0.01, "kappa": 3}),
        (["--delay", "20ms", "--fs", "0.2kHz"], {"delay": 0.02, "fs": 200.0}),
        (["--delta", "5ms", "--delay", "20000us"], {"delay": 0.02, "delta": 0.005}),
    ],
)
def test_run_takes_the_same_options(flags: list[object], options: dict[str, Any]) -> None:
    x = np.cos(0.1 * np.arange(100.0))
    np.save("x.npy", x)
    assert main(["run", "x.npy", "y.npy", "-q", "--window", "21", *map(str, flags)]) == 0
    np.testing.assert_array_equal(np.load("y.npy"), Differentiator(21, **options)(x))


def test_run_refuses_a_unit_without_a_step(capsys: pytest.CaptureFixture[str]) -> None:
    np.save("x.npy", np.zeros(50))
    assert main(["run", "x.npy", "y.npy", "--window", "21", "--delay", "20ms"]) == 2
    assert error_line(capsys).startswith("--fs or --delta must be given for numbers in ms, got neither")


def test_help_and_table_leave_matplotlib_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == 0
    assert "usage: algdiff design" in capsys.readouterr().out
    code = """
import sys, algdiff._cli as cli
assert cli.main(["design", "--window", "21", "--c", "d.h"]) == 0
print(sorted({"matplotlib", "scipy"} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.endswith("[]\n")
