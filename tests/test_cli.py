"""The command line: arguments, exit codes, messages, as a process, and the demo."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import algdiff
from algdiff import _cli, _demo
from algdiff._cli import main
from cli import WINDOW, N, error_line, here, leftovers, process, run, x

# --- arguments --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("names", [("x.txt", "y.npy"), ("x.npy", "y"), ("x.npy", "y.npy.gz")])
def test_unknown_suffix(capsys, names):
    assert run(*names) == 2
    assert "must be .npy, .npz, .csv, " in error_line(capsys)


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
        ["--deriv", "0,one"],
        ["--window", "1.5"],
        ["--window", "5 minutes"],
        ["--memory", "much"],
        ["--memory", "-1MiB"],
        ["--memory", "nan"],
        ["--channels", "0"],
        ["--offset", "-1"],
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
        (["--window", "0"], "--window: window_length must"),
        (["--window", "-0.5s", "--fs", "100"], "--window must"),
        (["--window", "1us", "--fs", "100"], "--window must be at least 0.04, that of 4 samples, got 1e-06"),
        (["--deriv", "1,1"], "--deriv must"),
        (["--deriv", "0,1", "--tau", "root"], "tau"),
        (["--memory", "1kB"], "--memory must be an integer of at least 1048576, got 1000"),
        (["--time", "t"], "--time is for a .csv or .parquet file, got x.npy"),
        (["--dtype", "f8"], "--dtype is for raw numbers, got x.npy"),
        (["--channels", "2"], "--channels is for raw numbers, got x.npy"),
        (["--offset", "8"], "--offset is for raw numbers, got x.npy"),
    ],
)
def test_arguments_that_cannot_be_meant(x, capsys, flags, word):
    np.save("x.npy", x)
    assert run("x.npy", "y.npy", *flags) == 2
    assert word in error_line(capsys)
    assert os.listdir() == ["x.npy"]


# --- what is said -----------------------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("default")
def test_design_warning_is_one_line(x, capsys):
    np.save("x.npy", x)
    with pytest.warns(algdiff.DesignWarning):
        algdiff.Differentiator(WINDOW, degree=WINDOW - 1)
    assert run("x.npy", "y.npy", "--degree", WINDOW - 1, "-q") == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("algdiff: warning: ")


def test_no_verb_prints_the_help(capsys):
    assert main([]) == 2
    assert "usage: algdiff" in capsys.readouterr().err
    for arguments in (["--help"], *([verb, "--help"] for verb in ("run", "info", "design", "stream", "demo"))):
        assert main(arguments) == 0
        assert "usage: algdiff" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("said", "line"),
    [
        ("y.npy: exists; give overwrite=True to replace it", "y.npy: exists; give --overwrite to replace it"),
        ("give resume=True to go on, overwrite=True to begin", "give --resume to go on, --overwrite to begin"),
        ("dst must be another file than src, got src.npy", "OUT must be another file than IN, got src.npy"),
        ("src: the suffix of x.txt must be .npy", "IN: the suffix of x.txt must be .npy"),
        ("columns must name columns of x.csv", "--columns must name columns of x.csv"),
        ("key is for a .npz file, got key must be.csv", "--key is for a .npz file, got key must be.csv"),
        ("memory must be at least 7 bytes", "--memory must be at least 7 bytes"),
        ("time.csv must hold numbers", "time.csv must hold numbers"),
        ("dst.csv: cannot be\nread", "dst.csv: cannot be read"),
        ("timeless must be", "timeless must be"),
    ],
)
def test_the_library_speaks_of_arguments_and_the_command_line_of_options(said, line):
    assert _cli._said(ValueError(said)) == _cli._said(said) == line


def test_help_and_glossary_name_the_same_choices(x):
    for mode in _cli.MODES:
        algdiff.differentiate(x, WINDOW, mode=mode)
    for rule in _cli.RULES:
        algdiff.Differentiator(WINDOW, rule=rule)
    for tau in _cli.TAUS:
        algdiff.Differentiator(WINDOW, tau=tau)


# --- as a process -----------------------------------------------------------------------------------------------------


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


def test_help_takes_no_numpy():
    # The package itself imports NumPy: its modules for the command line are found without it.
    code = """
import importlib.util, sys, types
package = types.ModuleType("algdiff")
package.__path__ = importlib.util.find_spec("algdiff").submodule_search_locations
sys.modules["algdiff"] = package
from algdiff._cli import main
for verb in ([], ["run"], ["info"], ["design"], ["stream"], ["demo"]):
    assert main([*verb, "--help"]) == 0
print([name for name in ("numpy", "matplotlib", "scipy") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.endswith("\n[]\n")


# --- demo -------------------------------------------------------------------------------------------------------------


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
    for name in ("pendulum.png", "choice.png"):
        content = (demo / name).read_bytes()
        assert content.startswith(b"\x89PNG\r\n\x1a\n")
        assert content.endswith(b"IEND\xaeB`\x82")


def test_demo_report(here, capsys):
    assert main(["demo"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "1601 samples, 0.1601 s; degree 5" in out
    assert "delay        800 samples, 0.08 s" in out
    chosen, given = (float(found) for found in re.findall(r" 1/s, R\^2 = (\S+)", out))
    assert chosen >= given >= 0.9965, "what is chosen explains no less than what was set by hand"
    assert all(abs(float(found) - 65.0) <= 0.3 for found in re.findall(r"a = (\S+) 1/s", out))
    assert main(["demo"]) == 0, "an earlier result is replaced"
    assert leftovers(here / "algdiff-demo") == []


def test_demo_explains_what_is_chosen(capsys):
    theta, delta = _demo.recording()
    suggestion, chosen, _ = _demo.choose(theta, delta, 1)
    design = suggestion.differentiator
    assert design == algdiff.suggest(theta, 2, delta=delta).differentiator
    words = {"degree": design.degree, "delta": delta, "threads": 1}
    for deriv, values in enumerate(chosen[:3]):
        np.testing.assert_array_equal(values, algdiff.differentiate(theta, design.window_length, deriv, **words))
    assert main(["demo"]) == 0
    out = capsys.readouterr().out
    assert "\n".join(f"  {line}" for line in suggestion.explain().splitlines()) in out
    given = np.load("algdiff-demo/pendulum.npz")["acceleration"]
    apart = np.sqrt(np.mean((chosen.acceleration - given)[2047:-1601] ** 2))
    assert float(re.search(r"\napart +(\S+) rad/s", out)[1]) == pytest.approx(apart, rel=5e-3)


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
