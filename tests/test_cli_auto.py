"""``algdiff run --auto``: the window is that of `suggest`, from no more of the file than is said."""

from __future__ import annotations

import json
import math
import os
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import algdiff
from algdiff import _cli_auto, _file_job, _file_run, _places
from algdiff._cli import main
from algdiff._cli_auto import Stretch
from algdiff._formats.base import Options
from algdiff._formats.npy import NpySource
from cli import error_line, here, leftovers

N = 3000
STEP = 1e-3


@pytest.fixture
def x() -> np.ndarray:
    """Return a sine of 2 Hz over 3 s, in noise."""
    return np.sin(4 * np.pi * STEP * np.arange(N)) + 0.02 * np.random.default_rng(11).standard_normal(N)


def auto(source: object, target: object, *more: object) -> int:
    return main(["run", str(source), str(target), "--auto", *map(str, more)])


# --- the choice -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "deriv", "options"),
    [
        ([], 1, {}),
        (["--deriv", "2"], 2, {}),
        (["--deriv", "0,1"], (0, 1), {}),
        (["--degree", "4"], 1, {"degree": 4}),
        (["--kappa", "0", "--mu", "0"], 1, {"kappa": 0.0, "mu": 0.0}),
        (["--max-delay", "20ms"], 1, {"max_delay": 0.02}),
        (["--max-delay", "0.02"], 1, {"max_delay": 0.02}),
        (["--bandwidth", "15Hz"], 1, {"bandwidth": 15.0}),
        (["--bandwidth", "0.015kHz"], 1, {"bandwidth": 15.0}),
        (["--bandwidth", "100rad/s"], 1, {"bandwidth": 100 / (2 * math.pi)}),
        (["--min-window", "651"], 1, {"min_window": 651}),
        (["--min-window", "0.6505s"], 1, {"min_window": 651}),
        (["--max-window", "50.9ms"], 1, {"max_window": 50}),
        (["--max-window", "51"], 1, {"max_window": 51}),
        (["--sigma", "0.2"], 1, {"sigma": 0.2}),
        (["--noise", "ar1"], 1, {"noise": "ar1"}),
    ],
)
def test_the_run_is_that_of_the_design_suggested(x, capsys, flags, deriv, options):
    np.save("x.npy", x)
    suggestion = algdiff.suggest(x, deriv, fs=1000, **options)
    assert auto("x.npy", "y.npy", "--fs", "1kHz", *flags) == 0
    np.testing.assert_array_equal(np.load("y.npy"), suggestion.differentiator(x))
    first, second, *rest = capsys.readouterr().err.splitlines()
    assert [first, second] == suggestion.explain().splitlines()[:2]
    assert rest[0] == "x.npy -> y.npy"
    if options.keys() - {"noise"}:
        assert suggestion.differentiator != algdiff.suggest(x, deriv, fs=1000).differentiator


def test_words_that_are_not_of_the_choice_reach_the_run(x, capsys):
    np.save("x.npy", x)
    design = algdiff.suggest(x).differentiator
    assert auto("x.npy", "y.npy", "--mode", "mirror", "--engine", "direct", "--json") == 0
    out, err = capsys.readouterr()
    assert (err, json.loads(out)["window_length"], json.loads(out)["engine"]) == ("", design.window_length, "direct")
    np.testing.assert_array_equal(np.load("y.npy"), design.replace(engine="direct")(x, mode="mirror"))
    assert auto("x.npy", "z.npy", "-q") == 0
    assert capsys.readouterr() == ("", "")
    np.testing.assert_array_equal(np.load("z.npy"), design(x))


def test_the_step_of_a_table(x, capsys):
    table = np.stack([STEP * np.arange(N), x, x[::-1]], axis=1)
    np.savetxt("x.csv", table, delimiter=",", header="t,a,b", comments="", fmt="%.17g")
    design = algdiff.suggest(table[:, 1:], axis=0, max_delay=0.03, fs=1000).differentiator
    assert auto("x.csv", "y.npy", "--time", "t", "--max-delay", "30ms") == 0
    assert f"A window of {design.window_length} samples" in capsys.readouterr().err
    np.testing.assert_allclose(np.load("y.npy"), design(table[:, 1:], axis=0), rtol=0, atol=1e-9)


def test_a_dry_run_chooses_too(x, capsys):
    np.save("x.npy", x)
    assert auto("x.npy", "y.npy", "--dry-run") == 0
    assert f"A window of {algdiff.suggest(x).differentiator.window_length} samples" in capsys.readouterr().err
    assert os.listdir() == ["x.npy"]


def test_a_resumed_run_chooses_the_same_window(here, x, capsys, monkeypatch):
    monkeypatch.setattr(_places, "BLOCK", 1 << 12)
    monkeypatch.setattr(_file_run, "INTERVAL", 0)
    monkeypatch.setattr(_cli_auto, "NUMBERS", 1 << 14)
    data = np.outer(1 + np.arange(20.0), x)
    np.save("x.npy", data)
    genuine, count = _file_job.Job.write, iter(range(4))

    def write(*words):
        if next(count, None) is None:
            raise KeyboardInterrupt
        genuine(*words)

    with monkeypatch.context() as patch:
        patch.setattr(_file_job.Job, "write", write)
        assert auto("x.npy", "y.npy") == 130
    capsys.readouterr()
    assert auto("x.npy", "y.npy", "--resume") == 0
    err = capsys.readouterr().err
    assert ", of which 4 were finished before" in err
    assert "warning" not in err
    window, degree = map(int, re.search(r"A window of (\d+) samples .* degree (\d)", err).groups())
    np.testing.assert_allclose(np.load("y.npy"), algdiff.differentiate(data, window, degree=degree), rtol=0, atol=1e-9)
    assert leftovers(here) == []


# --- what is read -----------------------------------------------------------------------------------------------------


@pytest.fixture
def small(monkeypatch):
    """Let little be read, in pieces."""
    monkeypatch.setattr(_cli_auto, "NUMBERS", 16 * 1000)
    monkeypatch.setattr(_cli_auto, "PIECE", 7001)


def test_a_long_file_is_looked_at_in_its_middle(x, capsys, monkeypatch):
    monkeypatch.setattr(_cli_auto, "NUMBERS", 2000)
    x[:500] = x[-500:] = 1e6 * np.random.default_rng(0).standard_normal(500)
    np.save("x.npy", x)
    suggestion = algdiff.suggest(x[500:2500])
    assert auto("x.npy", "y.npy") == 0
    np.testing.assert_array_equal(np.load("y.npy"), suggestion.differentiator(x))
    lines = capsys.readouterr().err.splitlines()
    assert lines[:3] == [*suggestion.explain().splitlines()[:2], "It was chosen from samples 500 to 2499 of 3000."]


def kept(data: np.ndarray, axis: int, length: int) -> np.ndarray:
    """Return the rows and samples that are to be looked at, from the array itself."""
    rows = np.moveaxis(data, axis, -1).reshape(-1, data.shape[axis])
    start = (data.shape[axis] - length) // 2
    return rows[np.linspace(0, len(rows) - 1, min(len(rows), 16)).astype(int), start : start + length]


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize(("shape", "axis"), [((40, 1500), 1), ((1500, 40), 0), ((5, 1500, 9), 1), ((5, 1500, 9), -2)])
@pytest.mark.parametrize("seek", [1, 256])
def test_rows_are_spread_and_read_as_they_lie(monkeypatch, order, shape, axis, seek):
    monkeypatch.setattr(_cli_auto, "SEEK", seek)
    data = np.asarray(np.random.default_rng(3).standard_normal(shape), order=order)
    np.save("x.npy", data)
    with NpySource(Path("x.npy")) as source:
        stretch = Stretch.of(source, axis)
        nearest = axis % data.ndim == (0 if order == "F" else data.ndim - 1)
        assert stretch.together == (not nearest and seek == 256)
        assert stretch.told() == [
            f"It was chosen from samples 250 to 1249 of 1500 and 16 channels of {data.size // 1500}."
        ]
        np.testing.assert_array_equal(stretch.read(source), kept(data, axis % data.ndim, 1000))


class Chunked:
    """An array in chunks, which notes how much is unpacked."""

    fortran, dtype, axis, path = False, np.dtype(float), -1, "store"

    def __init__(self, data: np.ndarray, chunks: tuple[int, ...]) -> None:
        self.data, self.shape, self.chunks, self.unpacked = data, data.shape, chunks, 0

    def read(self, place: tuple[slice, ...], out: np.ndarray) -> None:
        """Fill `out`."""
        out[...] = self.data[place]
        spans = [-(-one.stop // c) - one.start // c for one, c in zip(place, self.chunks, strict=True)]
        self.unpacked += math.prod(spans) * math.prod(self.chunks)


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    ("chunks", "together"), [((100, 50), True), ((100, 1), False), ((1, 50), True), ((1500, 2), False)]
)
def test_chunks_are_unpacked_about_once(chunks, together):
    data = np.random.default_rng(4).standard_normal((1500, 50))
    source = Chunked(data, chunks)
    stretch = Stretch.of(source, 0)
    assert stretch.together == together
    np.testing.assert_array_equal(stretch.read(source), kept(data, 0, 1000))
    # All rows of the stretch once, at most, and a chunk more at either end.
    assert source.unpacked <= 50 * (1000 + 2 * min(chunks[0], 500))


def test_many_channels_shorten_what_is_read(monkeypatch):
    monkeypatch.setattr(_cli_auto, "LOOKED", 50 * 700)
    monkeypatch.setattr(_cli_auto, "LEAST", 600)
    wide = np.empty((1500, 50))
    for chunks, length in (((100, 50), 700), ((100, 60), 700), ((100, 1), 1500)):
        stretch = Stretch.of(Chunked(wide, chunks), 0)
        assert stretch.stop - stretch.start == length
    monkeypatch.setattr(_cli_auto, "LEAST", 800)
    assert Stretch.of(Chunked(wide, (100, 50)), 0).stop == 350 + 800


@pytest.mark.usefixtures("small")
def test_tables_are_read_in_order(x):
    table = np.stack([x * (1 + k) for k in range(20)], axis=1)
    np.savetxt("x.csv", table, delimiter=",", fmt="%.17g")
    from algdiff._formats.csv import CsvSource

    with CsvSource(Path("x.csv"), Options()) as source:
        np.testing.assert_array_equal(Stretch.of(source, None).read(source), kept(table, 0, 1000))


def test_complex_samples_count_twice(monkeypatch, x):
    monkeypatch.setattr(_cli_auto, "NUMBERS", 1000)
    np.save("x.npy", x + 1j)
    with NpySource(Path("x.npy")) as source:
        stretch = Stretch.of(source, None)
        np.testing.assert_array_equal(stretch.read(source), (x + 1j)[np.newaxis, 1250:1750])


# --- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "line"),
    [
        (["--tau", "newest"], "--tau is for a --window, got --auto"),
        (["--delay", "0"], "--delay is for a --window, got --auto"),
        (["--rule", "cell"], "--rule is for a --window, got --auto"),
        (["--trim", "0"], "--trim is for a --window, got --auto"),
        (["--kappa", "0"], "--kappa and --mu must be equal and greater than -1/2 to choose a window, got 0.0 and 1.0"),
        (["--degree", "0"], "--degree must be "),
        (["--deriv", "-1"], "--deriv must be "),
        (["--engine", "slow"], "--engine must be "),
        (["--max-delay", "-2ms", "--fs", "9"], "--max-delay must be finite and not negative, got -0.002"),
        (["--max-delay", "2ms"], "--fs or --delta must be given for numbers in ms, got neither"),
        (["--bandwidth", "0"], "--bandwidth must be finite and positive, got 0.0"),
        (["--bandwidth", "5Hz"], "--fs or --delta must be given for numbers in Hz, got neither"),
        (["--min-window", "9", "--max-window", "5"], "--max-window must be at least --min-window, got 5 and 9"),
        (["--min-window", "9999"], "--min-window must be at most the number of samples, 3000, got 9999"),
        (["--max-window", "1e300s", "--fs", "1"], "--max-window must be at most "),
        (["--max-window", "3", "--degree", "4"], "--min-window, --max-window, --bandwidth and --degree must leave"),
        (["--sigma", "-1"], "--sigma must be "),
        (["--sigma", "1", "--noise", "ar1"], "give --sigma or --noise = 'ar1', not both: got --sigma = 1.0"),
    ],
)
def test_what_cannot_be_chosen_by(x, capsys, flags, line):
    np.save("x.npy", x)
    assert auto("x.npy", "y.npy", *flags) == 2
    assert error_line(capsys).startswith(line)
    assert os.listdir() == ["x.npy"]


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (np.zeros(5), "x.npy must have at least 6 samples to choose a window, got 5"),
        (np.zeros(0), "x.npy must have at least 6 samples to choose a window, got 0"),
        (np.full(9, np.nan), "x.npy must hold samples that are finite, got none"),
        (np.zeros((0, 9)), "x.npy: must hold a channel to choose a window from, got shape (0, 9)"),
        (np.zeros(()), "x.npy must hold an array of at least one dimension, got a scalar"),
    ],
)
def test_data_that_no_window_can_be_chosen_from(capsys, data, line):
    np.save("x.npy", data)
    assert auto("x.npy", "y.npy") == 1
    assert error_line(capsys) == line


@pytest.mark.parametrize("word", _cli_auto.OWN)
def test_options_of_the_choice_need_it(x, capsys, word):
    np.save("x.npy", x)
    flag = f"--{word.replace('_', '-')}"
    assert main(["run", "x.npy", "y.npy", "--window", "21", flag, "white" if word == "noise" else "9"]) == 2
    assert error_line(capsys) == f"{flag} is for --auto, got --window"


def test_a_window_or_a_choice(x, capsys):
    np.save("x.npy", x)
    assert auto("x.npy", "y.npy", "--window", "21") == 2
    assert capsys.readouterr().err.endswith("error: argument --window: not allowed with argument --auto\n")
    assert main(["run", "x.npy", "y.npy"]) == 2
    assert capsys.readouterr().err.endswith("error: one of the arguments --window --auto is required\n")


def test_outputs_are_refused_before_anything_is_read(x, capsys, monkeypatch):
    np.save("x.npy", x)
    Path("y.npy").write_bytes(b"precious")
    monkeypatch.setattr(_cli_auto, "formats", SimpleNamespace())
    assert auto("x.npy", "y.npy") == 1
    assert "y.npy: exists; give --overwrite" in error_line(capsys)
