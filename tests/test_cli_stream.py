"""``algdiff stream``: estimates as offline, at once, whatever the lines look like and wherever they are cut."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from algdiff import Differentiator, _cli_stream
from algdiff._cli import main

N = 120
WINDOW = 11


@pytest.fixture
def x() -> np.ndarray:
    return np.random.default_rng(11).standard_normal((N, 3)).cumsum(axis=0)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@contextlib.contextmanager
def process(*arguments: object, window: int = WINDOW, **options: object) -> Iterator[subprocess.Popen[bytes]]:
    """Start the command with Ctrl-C enabled, which a background shell may have switched off; end it after a minute."""
    reset = None if os.name == "nt" else (lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    command = [sys.executable, "-m", "algdiff", "stream", "--window", str(window), *map(str, arguments)]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, **{**pipes, "preexec_fn": reset, **options}) as child:
        watchdog = threading.Timer(60, child.kill)
        watchdog.start()
        try:
            yield child
        finally:
            watchdog.cancel()
            child.kill()


def piped(text: str, *arguments: object, window: int = WINDOW) -> str:
    """Return what the command makes of `text`, without a complaint."""
    with process(*arguments, window=window) as child:
        out, err = child.communicate(text.encode())
        assert (child.returncode, err) == (0, b"")
    return out.decode()


@pytest.fixture
def run(monkeypatch, capfdbinary):
    """Return a function that runs the command in this process and returns its exit code, stdout and stderr."""

    def call(text: str | bytes, *arguments: object, window: int = WINDOW) -> tuple[int, str, str]:
        Path("in").write_bytes(text if isinstance(text, bytes) else text.encode())
        with open("in", encoding="utf-8") as stdin:
            monkeypatch.setattr(sys, "stdin", stdin)
            code = main(["stream", "--window", str(window), *map(str, arguments)])
        out, err = capfdbinary.readouterr()
        return code, out.decode(), err.decode()

    return call


def lines(array: np.ndarray, delimiter: str = ",") -> str:
    return "".join(delimiter.join(map(repr, row)) + "\n" for row in array.reshape(len(array), -1).tolist())


def table(text: str, delimiter: str = ",") -> np.ndarray:
    return np.array([[float(field) for field in line.split(delimiter)] for line in text.splitlines()])


def offline(design: Differentiator, x: np.ndarray, **words: object) -> np.ndarray:
    """Return the estimates of whole windows: one row for each window, one order after the other in it."""
    found = design.replace(engine="direct")(x, axis=0, mode="valid", **words)
    return found.reshape(len(design.orders), found.shape[-2], -1).swapaxes(0, 1).reshape(found.shape[-2], -1)


# --- values ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "options"),
    [
        (["--fs", "1kHz"], {"fs": 1000.0}),
        (["--deriv", "0,1,2", "--tau", "newest", "--delta", "20ms"], {"deriv": (0, 1, 2), "tau": "newest", "fs": 50}),
        (
            ["--deriv=2", "--degree=3", "--kappa=0", "--mu=0.5", "--delay=2", "--engine=direct"],
            {"deriv": 2, "degree": 3, "kappa": 0, "mu": 0.5, "delay": 2},
        ),
        (["--rule", "trapezoid", "--trim", "0.01", "--tau", "0.75"], {"rule": "trapezoid", "trim": 0.01, "tau": 0.75}),
    ],
)
def test_values_are_those_of_direct_to_the_bit(x, flags, options):
    design = Differentiator(WINDOW, options.pop("deriv", 1), **options)
    found = table(piped(lines(x), *flags))
    span = design.weights.shape[-1]
    assert found.shape == (N, 3 * len(design.orders))
    assert np.isnan(found[: span - 1]).all()
    np.testing.assert_array_equal(found[span - 1 :], offline(design, x))


def test_one_column_of_several_orders(run, x):
    code, out, err = run(lines(x[:, 0]), "--deriv", "2,0")
    assert (code, err) == (0, "")
    np.testing.assert_array_equal(table(out)[WINDOW - 1 :], offline(Differentiator(WINDOW, (2, 0)), x[:, :1]))


@pytest.mark.skipif(os.name == "nt", reason="a pipe of another kind")
@pytest.mark.parametrize("ending", [b"\n", b"\r\n"])
def test_answer_comes_before_the_next_line(x, ending):
    design = Differentiator(WINDOW)
    with process() as child:
        found = []
        for line in lines(x[: WINDOW + 3]).encode().splitlines():
            for part in (line[:5], line[5:] + ending):
                child.stdin.write(part)
                child.stdin.flush()
            found.append(child.stdout.readline().decode())
        child.stdin.close()
        assert child.stdout.read() == b""
        assert child.wait() == 0
    np.testing.assert_array_equal(table("".join(found))[WINDOW - 1 :], offline(design, x[: WINDOW + 3]))


MESSY = "\ufeff# logged\n\n angle; speed \r\n{}\n# end\n9;9"


@pytest.mark.parametrize(
    "flags",
    [
        ["--deriv", "0,1", "--std", "--sigma", "0.1", "--nan-policy", "omit"],
        ["--warmup", "grow", "--stamp", "--fs", "100"],
        ["--time", "--warmup", "grow", "--std"],
    ],
)
def test_cuts_do_not_matter(run, monkeypatch, x, flags):
    x[:, 0] = np.cumsum(np.abs(x[:, 0]) + 0.1)
    rows = lines(x[:, :2], ";").splitlines()
    rows[30], rows[40] = rows[30].split(";")[0] + ";NA", "\n#\n" + rows[40]
    text = MESSY.format("\n".join(rows[:-1])).replace("9;9", "999;9")
    whole = run(text, *flags)
    assert whole[::2] == (0, "")
    assert len(whole[1].splitlines()) == N + 1
    for size in (1, 7, 500):
        monkeypatch.setattr(_cli_stream, "READ", size)
        assert run(text, *flags) == whole


# --- lines -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "kept"), [(",", ","), (";", ";"), ("\t", "\t"), (" ", " "), ("   ", " "), (", ", ","), (" \t ", "\t")]
)
def test_delimiters(run, x, given, kept):
    code, out, err = run(lines(x, given))
    assert (code, err) == (0, "")
    np.testing.assert_array_equal(table(out, kept)[WINDOW - 1 :], offline(Differentiator(WINDOW), x))


@pytest.mark.parametrize(
    ("flags", "header", "expected"),
    [
        ([], "angle,wheel speed", "angle,wheel speed"),
        ([], '"a, b";c', "a, b;c"),
        ([], "a   b", "a b"),
        (["--deriv", "0,2"], "a\tb", "a_d0\tb_d0\ta_d2\tb_d2"),
        (["--std"], "a,b", "a,b,a_std,b_std"),
        (["--deriv", "1,0", "--std"], "a,b", "a_d1,b_d1,a_d0,b_d0,a_d1_std,b_d1_std,a_d0_std,b_d0_std"),
        (["--stamp"], "a,b", "time,a,b"),
        (["--time", "--deriv", "0,1"], "when,b", "when,b_d0,b_d1"),
        ([], "1st,2nd", "1st,2nd"),
        ([], "größe,b", "größe,b"),
    ],
)
def test_header(run, flags, header, expected):
    mark = next((mark for mark in "\t;," if mark in header.replace('"a, b"', "")), " ")
    text = "".join(f"{row}{mark}{row * row}\n" for row in range(20))
    code, plain, _ = run(text, *flags)
    assert code == 0
    code, out, err = run(f"\n# first\n{header}\n{text}", *flags)
    assert (code, err) == (0, "")
    assert out == f"{expected}\n{plain}"


@pytest.mark.parametrize(
    ("flags", "first", "fault"),
    [
        ([], "1,foo", "column 1 must be a number, got 'foo'"),
        ([], "1.5 V", "column 1 must be a number, got 'V'"),
        ([], "\r1\rx\r", "column 1 must be a number, got 'x'"),
        ([], "x" * 200_000 + ",1", "column 0 must be a number, got 'xxx"),
        (["--time"], "NA,5", "column 0 must be a time"),
        (["--time"], "inf,5", "column 0 must be a time"),
        (["--time"], "1,volts", "column 1 must be a number, got 'volts'"),
    ],
)
def test_a_broken_first_line_is_no_header(run, flags, first, fault):
    code, out, err = run(f"{first}\n1,2\n", *flags)
    assert (code, out) == (1, "")
    assert "line 1" in err
    assert fault in err
    assert len(err) < 200


def test_header_of_one_column_may_hold_spaces(run):
    for header in ("wheel speed", '"wheel speed"'):
        assert run(f"{header}\n1\n2\n3\n", "--degree=1", window=2)[1] == "wheel speed\nnan\n1.0\n1.0\n"


def test_header_keeps_bytes_that_are_not_text(run, capfdbinary):
    del run
    Path("in").write_bytes(b"gr\xf6\xdfe\n1\n")
    with open("in", encoding="latin-1") as stdin, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stdin", stdin)
        assert main(["stream", "--window", "5"]) == 0
    assert capfdbinary.readouterr().out == b"gr\xf6\xdfe\nnan\n"


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing\n", "name\n"])
def test_nothing(run, text):
    assert run(text) == (0, "", "")


@pytest.mark.parametrize("missing", ["", "nan", "NaN", "NA", "na", ' "" '])
def test_missing_samples(run, monkeypatch, x, missing):
    gone = x.copy()
    gone[50, 1] = np.nan
    rows = lines(x).splitlines()
    first, _, last = rows[50].split(",")
    rows[50] = f"{first},{missing},{last}"
    for policy in ("propagate", "omit"):
        code, out, _ = run("\n".join(rows), "--nan-policy", policy)
        expected = offline(Differentiator(WINDOW), gone, nan_policy=policy)
        assert code == 0
        found = table(out)[WINDOW - 1 :]
        assert np.isnan(found).sum() == (WINDOW if policy == "propagate" else 0)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    for size in (1 << 18, 100):
        monkeypatch.setattr(_cli_stream, "READ", size)
        code, out, err = run("\n".join(rows), "--nan-policy", "raise")
        assert code == 1
        assert err.startswith(
            "algdiff: error: stdin: line 51, column 1 must not be missing with --nan-policy raise, got '"
        )
        assert len(out.splitlines()) == 50


def test_first_and_last_fields_may_be_empty(run):
    text = "\t\n1\t2\n\t3\n4\t\n\n5\t6\n"
    code, out, _ = run(text, "--deriv=0", "--degree=0", window=1)
    assert (code, out) == (0, "nan\tnan\n1.0\t2.0\nnan\t3.0\n4.0\tnan\n5.0\t6.0\n")


def test_numbers_read_back_as_the_same(run):
    values = np.array([0.1, 1e-320, -1.7976931348623157e308, 5e22, 123456789.12345679, -0.0])
    code, out, _ = run(lines(values), "--deriv=0", "--degree=0", window=1)
    assert code == 0
    np.testing.assert_array_equal(table(out)[:, 0], values)


# --- times -------------------------------------------------------------------------------------------------------


@pytest.fixture
def t() -> np.ndarray:
    return np.cumsum(np.random.default_rng(5).uniform(0.05, 0.5, N)).round(6)


@pytest.mark.parametrize("tau", ["center", "newest", "0.3"])
def test_times_as_offline(run, x, t, tau):
    code, out, err = run(lines(np.column_stack([t, x])), "--time", "--tau", tau, "--deriv", "0,1", "--std")
    assert (code, err) == (0, "")
    found = table(out)[WINDOW - 1 :]
    design = Differentiator(WINDOW, (0, 1), tau=float(tau) if tau[0] == "0" else tau)
    expected = design(x, axis=0, t=t, mode="valid", return_std=True, sigma=1.0)
    for part, values in ((found[:, 1:7], expected.estimate), (found[:, 7:], expected.std)):
        wanted = values.swapaxes(0, 1).reshape(len(part), -1)
        np.testing.assert_allclose(part, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
    whole = (t[WINDOW - 1 :] - t[: -WINDOW + 1]) * WINDOW / (WINDOW - 1)
    times = t[WINDOW - 1 :] + whole / (2 * WINDOW) - (1 - design.tau) * whole
    np.testing.assert_allclose(found[:, 0], times, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("flags", [[], ["--warmup", "grow"]])
def test_time_of_the_estimate(run, t, flags):
    """The slope of a parabola says what time it is."""
    even = np.arange(N) * 0.25
    for times, more in ((t, ["--time"]), (even, ["--stamp", "--delta", "0.25"])):
        rows = np.column_stack([times, times**2]) if more == ["--time"] else times**2
        code, out, _ = run(lines(rows), "--tau", "0.8", *more, *flags)
        assert code == 0
        when, slope = table(out).T
        first = 3 if flags else WINDOW - 1
        assert np.flatnonzero(~np.isnan(slope))[0] == first
        np.testing.assert_allclose(slope[first:], 2 * when[first:], rtol=1e-8, atol=1e-8)


def test_delay_on_the_clock_of_the_times(run, t):
    start = datetime(2026, 11, 27, 23, 59, 58)
    dates = [(start + timedelta(seconds=seconds)).isoformat(timespec="microseconds") for seconds in t]
    for stamps, delay in ((map(repr, t.tolist()), "0.4"), (dates, "400ms")):
        rows = [f"{stamp},{seconds**2!r}" for stamp, seconds in zip(stamps, t.tolist(), strict=True)]
        code, out, err = run("\n".join(rows), "--time", "--delay", delay)
        assert (code, err) == (0, "")
        found = [line.split(",") for line in out.splitlines()][WINDOW - 1 :]
        np.testing.assert_allclose([float(slope) for _, slope in found], 2 * (t[WINDOW - 1 :] - 0.4), rtol=1e-8)
    assert datetime.fromisoformat(found[0][0]) == start + timedelta(seconds=round(t[WINDOW - 1] - 0.4, 6))


def test_times_of_an_even_clock(run, x):
    design = Differentiator(WINDOW, fs=1000, delay=0.0025)
    code, out, _ = run(lines(x[:, 0]), "--stamp", "--fs", "1kHz", "--delay", "2.5ms")
    assert code == 0
    found = table(out)
    times = np.arange(N) / 1000 - 0.0025
    times[: WINDOW - 1] = np.nan
    np.testing.assert_allclose(found[:, 0], times, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(found[WINDOW - 1 :, 1], offline(design, x[:, :1])[:, 0])


def test_dates_are_seconds(run, t, x):
    """So are digits that a float cannot hold, as in nanoseconds since 1970."""
    start = datetime(2026, 11, 27, 23, 59, 58, tzinfo=timezone.utc)
    stamps = [start + timedelta(seconds=seconds) for seconds in t]
    numbers = table(run(lines(np.column_stack([t - t[0], x])), "--time")[1])
    spellings = {
        "Z": [stamp.isoformat(timespec="microseconds").replace("+00:00", "Z") for stamp in stamps],
        "+02:00": [
            stamp.astimezone(timezone(timedelta(hours=2))).isoformat(timespec="microseconds") for stamp in stamps
        ],
        "": [stamp.replace(tzinfo=None).isoformat(timespec="microseconds") for stamp in stamps],
    }
    for zone, texts in spellings.items():
        rows = [f"{text},{row}" for text, row in zip(texts, lines(x).splitlines(), strict=True)]
        code, out, err = run("\n".join(rows), "--time")
        assert (code, err) == (0, "")
        dated = [line.split(",") for line in out.splitlines()][WINDOW - 1 :]
        found = np.array([list(map(float, fields[1:])) for fields in dated])
        np.testing.assert_allclose(found, numbers[WINDOW - 1 :, 1:], rtol=1e-6, atol=1e-6)
        for fields, seconds in zip(dated, numbers[WINDOW - 1 :, 0], strict=True):
            assert fields[0].endswith(zone)
            when = datetime.fromisoformat(fields[0].replace("Z", "+00:00"))
            passed = when - stamps[0].replace(tzinfo=when.tzinfo and timezone.utc)
            assert passed.total_seconds() == pytest.approx(seconds, abs=1e-6)


def test_dates_may_have_nanoseconds(run):
    rows = [f"2026-11-27T00:00:00.{1000 * i + i * i:09d},{i * i}" for i in range(10)]
    code, out, err = run("\n".join(rows), "--time", "--tau", "newest", "--degree", "2", window=3)
    assert (code, err) == (0, "")
    found = [float(line.split(",")[1]) for line in out.splitlines()][2:]
    t = 1e-9 * np.array([1000 * i + i * i for i in range(10)])
    wanted = Differentiator(3, degree=2, tau="newest")(np.arange(10.0) ** 2, t=t, mode="valid")
    np.testing.assert_allclose(found, wanted, rtol=1e-6)


def test_a_prediction_may_have_a_unit(run, x):
    for words in (["--delay", "-2ms"], ["--delay=-2ms"]):
        code, out, _ = run(lines(x[:, :1]), *words, "--fs", "1kHz", "--kappa", "-1e-1")
        assert code == 0
        design = Differentiator(WINDOW, fs=1000, delay=-0.002, kappa=-0.1)
        np.testing.assert_array_equal(table(out)[WINDOW - 1 :, 0], offline(design, x[:, :1])[:, 0])


def test_closed_outputs_are_said():
    command = f"printf '1\\n2\\n' | {sys.executable} -m algdiff stream --window 2 --degree 1 >&-"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False, timeout=60)  # noqa: S602
    assert (done.returncode, done.stderr) == (1, "algdiff: error: stdout: must be open, got a closed one\n")


def test_no_digit_of_a_time_is_lost(run, t, x):
    """Nanoseconds since 1970 have more digits than a float."""
    steps = [round(1e9 * (time - t[0])) for time in t]
    counted, small = (
        run(
            "".join(f"{start + step},{row}\n" for step, row in zip(steps, lines(x).splitlines(), strict=True)), "--time"
        )
        for start in (1_700_000_000_000_000_001, 0)
    )
    assert counted[0] == small[0] == 0
    np.testing.assert_array_equal(table(counted[1])[:, 1:], table(small[1])[:, 1:])


# --- errors of the estimates -------------------------------------------------------------------------------------


def test_standard_deviations(run, x):
    x[60] = np.nan
    design = Differentiator(WINDOW, (0, 1), fs=10)
    code, out, _ = run(lines(x), "--deriv=0,1", "--fs=10", "--std", "--sigma=0.25", "--nan-policy=omit")
    assert code == 0
    expected = design(x, axis=0, mode="valid", nan_policy="omit", return_std=True, sigma=0.25).std
    found = table(out)[WINDOW - 1 :, 6:].reshape(-1, 2, 3)
    np.testing.assert_allclose(found, expected.swapaxes(0, 1), rtol=1e-9)
    np.testing.assert_allclose(found[0, :, 0], 0.25 * np.sqrt(design.noise_gain), rtol=1e-12)


# --- refusals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message", "written"),
    [
        ("1\n2\n\noops\n4\n", "line 4, column 0 must be a number, got 'oops'", 2),
        ("a,b\n1,2\n3,1_0\n", "line 3, column 1 must be a number, got '1_0'", 2),
        ("1,2\n# c\n3,4,5\n", "line 3 must have 2 columns as the lines before it, got 3", 1),
        ("a,b\n1,2,3\n", "line 2 must have 2 columns as the lines before it, got 3", 0),
        ("a b\n1 2\n3\n", "line 3 must have 2 columns as the lines before it, got 1", 2),
        ("1,5;2\n1,5;2\n", "line 1, column 0 must be a number, got '1,5'", 0),
        (b"1\n\xff\n2\n", "line 2, column 0 must be a number, got '\ufffd'", 1),
        ("name\nname\n1\n", "line 2, column 0 must be a number, got 'name'", 0),
    ],
)
@pytest.mark.parametrize("size", [1, 1 << 18])
def test_malformed_lines(run, monkeypatch, text, message, written, size):
    monkeypatch.setattr(_cli_stream, "READ", size)
    code, out, err = run(text)
    assert (code, err) == (1, f"algdiff: error: stdin: {message}\n")
    assert len(out.splitlines()) == written


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n1,2\n", "line 2, column 0 must be later than in the line before it, got '1'"),
        ("1,2\n0.5,2\n", "line 2, column 0 must be later than in the line before it, got '0.5'"),
        ("1,2\nNA,2\n", "line 2, column 0 must be a time, of the kind of the first, got 'NA'"),
        ("1,2\ninf,2\n", "line 2, column 0 must be a time, of the kind of the first, got 'inf'"),
        ("1,2\n2026-11-27,2\n", "line 2, column 0 must be a time, of the kind of the first, got '2026-11-27'"),
        (
            "2026-11-27T10:00:00,2\n2026-11-27T10:00:01Z,3\n",
            "line 2, column 0 must be a time, of the kind of the first, got '2026-11-27T10:00:01Z'",
        ),
    ],
)
def test_malformed_times(run, text, message):
    code, out, err = run(text, "--time")
    assert (code, err) == (1, f"algdiff: error: stdin: {message}\n")
    assert len(out.splitlines()) == 1


def test_time_without_a_sample(run):
    assert run("1\n2\n", "--time")[::2] == (
        1,
        "algdiff: error: stdin: line 1 must hold a time and at least one sample, got 1 column\n",
    )


@pytest.mark.parametrize(
    ("flags", "word"),
    [
        (["--time", "--fs", "10"], "--fs"),
        (["--time", "--delta", "10ms"], "--delta"),
        (["--time", "--stamp"], "--stamp"),
        (["--time", "--rule", "cell"], "rule"),
        (["--time", "--trim", "0.1"], "trim"),
        (["--sigma", "1"], "--sigma"),
        (["--std", "--sigma", "-1"], "sigma"),
        (["--std", "--sigma", "nan"], "sigma"),
        (["--delay", "20ms"], "--fs"),
        (["--degree", "11"], "degree"),
        (["--deriv", "1,1"], "deriv"),
        (["--deriv", "0,1", "--tau", "root"], "tau"),
        (["--engine", "fft"], "--engine"),
        (["--window", "0"], "window_length"),
    ],
)
def test_arguments_that_cannot_be_meant(run, flags, word):
    code, out, err = run("1,2\n" * 20, *flags)
    assert (code, out) == (2, "")
    (line,) = err.splitlines()
    assert line.startswith("algdiff: error: ")
    assert word in line


@pytest.mark.parametrize(
    "flags", [["--deriv", "x"], ["--deriv", "1,"], ["--warmup", "cold"], ["--nan-policy", "keep"], ["--mode", "fit"]]
)
def test_arguments_argparse_refuses(run, flags):
    code, out, err = run("1\n", *flags)
    assert (code, out) == (2, "")
    assert ": error: " in err.splitlines()[-1]
    assert flags[0] in err.splitlines()[-1]


def test_window_is_required(capsys):
    assert main(["stream"]) == 2
    assert "--window" in capsys.readouterr().err


def test_help(capsys):
    assert main(["stream", "--help"]) == 0
    assert "usage: algdiff stream" in capsys.readouterr().out
    assert main(["--help"]) == 0
    assert "stream" in capsys.readouterr().out


# --- as a process ------------------------------------------------------------------------------------------------


@pytest.mark.skipif(os.name == "nt", reason="sends SIGINT")
def test_ctrl_c_while_waiting():
    with process(window=5) as child:
        child.stdin.write(b"1\n2")
        child.stdin.flush()
        assert child.stdout.readline() == b"nan\n"
        child.send_signal(signal.SIGINT)
        assert child.stdout.read() == b""
        assert child.stderr.read() == b"algdiff: interrupted\n"
        assert child.wait() == 130


@pytest.mark.skipif(os.name == "nt", reason="sends SIGINT")
def test_ctrl_c_while_nobody_reads(x):
    """The pipe takes some 64 KB, and the command waits; then no line is cut off."""
    Path("in").write_text(lines(np.tile(x, (300, 1))), encoding="utf-8")
    with open("in", "rb") as stdin, process(stdin=stdin) as child:
        first = child.stdout.read(1)
        with pytest.raises(subprocess.TimeoutExpired):
            child.wait(0.5)
        child.send_signal(signal.SIGINT)
        assert child.wait() == 130
        out = first + child.stdout.read()
        assert child.stderr.read() == b"algdiff: interrupted\n"
    rows = out.decode().split("\n")
    assert rows[-1] == ""
    assert {len(row.split(",")) for row in rows[:-1]} == {3}
    assert WINDOW < len(rows) < 300 * N
    expected = offline(Differentiator(WINDOW), np.tile(x, (300, 1)))[: len(rows) - WINDOW]
    np.testing.assert_array_equal(table(out.decode())[WINDOW - 1 :], expected)


@pytest.mark.skipif(os.name == "nt", reason="closes a pipe early")
def test_broken_pipe_is_quiet():
    with process(window=5) as child:
        child.stdout.close()
        child.stdin.write(b"1\n")
        child.stdin.flush()
        assert child.stderr.read() == b""
        assert child.wait() == 1


@pytest.mark.skipif(os.name == "nt", reason="closes a descriptor")
def test_closed_stdin():
    with process(stdin=None, preexec_fn=lambda: os.close(0)) as child:
        assert child.stderr.read() == b"algdiff: error: stdin: must be open, got a closed one\n"
        assert child.wait() == 1


def test_warning_of_the_design_is_one_line():
    with process("--degree", WINDOW - 1) as child:
        out, err = child.communicate(b"1\n")
    assert out == b"nan\n"
    (line,) = err.decode().splitlines()
    assert line.startswith("algdiff: warning: degree ")
