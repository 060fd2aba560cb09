"""``algdiff report``: a whole page that holds what Python says, refers to nothing, and appears whole or not at all."""

from __future__ import annotations

import errno
import html
import json
import re
import shlex
import warnings
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import algdiff
from algdiff import _output
from algdiff._cli import main
from algdiff._pages import loading, of_design, of_recording
from algdiff._pages.report import Report
from algdiff._report import shown
from cli import error_line, leftovers

N = 200
VOID = {"meta", "link", "br", "wbr", "img", "input", "hr"}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def x() -> np.ndarray:
    rng = np.random.default_rng(7)
    return np.sin(0.05 * np.arange(N)) + 0.01 * rng.standard_normal(N)


class Reader(HTMLParser):
    """What is in a page: its elements, which must be closed in order, its attributes, its text."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.seen: set[str] = set()
        self.attributes: list[tuple[str, str]] = []
        self.headings: list[str] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: D102
        self.seen.add(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: D102
        self.seen.add(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:  # noqa: D102
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:  # noqa: D102
        if self.open and self.open[-1] in ("h1", "h2"):
            self.headings.append(data)


def report(*arguments: object) -> int:
    return main(["report", *map(str, arguments)])


def made(*arguments: object, output: str = "report.html") -> str:
    """Return the page, after the checks that every page must pass."""
    assert report(*arguments, "-o", output, "--overwrite") == 0
    page = Path(output).read_bytes().decode("utf-8")
    found = Reader(page)
    assert found.seen <= ALLOWED, found.seen - ALLOWED
    for name, value in found.attributes:
        assert not name.startswith("on")
        assert name not in ("src", "srcset", "action", "data", "poster")
        assert name != "href" or value == "data:,"
        assert "://" not in value or (name, value) == ("xmlns", "http://www.w3.org/2000/svg")
    assert not re.search(r"url\(|@import|@font-face", page)
    for chart in charts(page):
        ET.fromstring(chart)  # noqa: S314  (our own text)
    return page


ALLOWED = {
    *("html", "head", "meta", "title", "link", "style", "body", "main", "header", "footer", "section", "figure"),
    *("div", "p", "h1", "h2", "h3", "ul", "li", "dl", "dt", "dd", "table", "caption", "tr", "th", "td", "pre", "code"),
    *("span", "wbr", "svg", "desc", "path", "text"),
}


def charts(page: str) -> list[str]:
    return re.findall(r'<svg class="chart".*?</svg>(?:(?!<svg).)*?</svg>', page, re.DOTALL)


def value(page: str, name: str, place: int = 0) -> str:
    return re.findall(rf'data-name="{name}">([^<]*)<', page)[place]


def code(page: str) -> tuple[str, list[str]]:
    """Return the lines that give the same: in Python, and on the command line."""
    python, shell = (html.unescape(one) for one in re.findall(r"<pre><code>(.*?)</code></pre>", page, re.DOTALL))
    return python, shell.split("\n")


@pytest.fixture
def design(capsys: pytest.CaptureFixture[str]) -> algdiff.Differentiator:
    """Leave a design in ``d.json``."""
    assert main(["design", "--cutoff", "20Hz", "--fs", "1000", "--tau", "root", "--json"]) == 0
    Path("d.json").write_text(capsys.readouterr().out)
    return algdiff.Differentiator.from_cutoff(20, fs=1000, tau="root")


# --- what the page says ---------------------------------------------------------------------------------------------


def test_a_design(design):
    page = made("d.json")
    for name, expected in design.summary().items():
        assert value(page, name) == shown(expected)
    titles = ["Weights", "Response to a unit step", "Frequency response", "What a shorter delay costs"]
    assert [re.findall("<title>(.*?)</title>", one)[0] for one in charts(page)[::2]] == titles
    python, shell = code(page)
    assert eval(python.split("\n")[-1]) == design  # noqa: S307
    assert shell == ["algdiff report d.json"]


def test_a_recording(x):
    np.save("x.npy", x)
    page = made("x.npy", "--fs", "100", "--window", 21)
    found = algdiff.differentiate(x, 21, fs=100, return_std=True)
    sigma = algdiff.noise_level(x)
    rest = x - algdiff.differentiate(x, 21, 0, degree=3, fs=100)
    assert value(page, "samples") == str(x.size)
    assert value(page, "missing") == value(page, "without") == "0"
    assert value(page, "noise_level") == f"{sigma:.6g}"
    assert value(page, "rest") == f"{np.sqrt(np.mean(rest**2)):.6g}"
    assert value(page, "std") == f"{np.median(found.std):.6g}"
    assert value(page, "least") == f"{found.estimate.min():.6g}"
    assert value(page, "largest") == f"{found.estimate.max():.6g}"
    assert value(page, "window_length") == "21"
    assert "200 samples, 0.01 s apart." in page
    assert "Expected error" not in page


def test_what_is_drawn_are_the_estimates(x):
    np.save("x.npy", x)
    page = made("x.npy", "--fs", "100", "--window", 21)
    chart = next(one for one in charts(page) if "<title>Derivative of order 1</title>" in one)
    path = re.findall(r'<path class="curve c0" d="M([^"]*)"', chart)[0]
    drawn = np.array([list(map(float, pair.split(","))) for pair in path.split()])
    estimate = algdiff.differentiate(x, 21, fs=100)
    assert len(drawn) == x.size
    # One linear map takes values to pixels, which are rounded to a tenth.
    slope, offset = np.polyfit(estimate, drawn[:, 1], 1)
    assert slope < 0
    assert np.abs(slope * estimate + offset - drawn[:, 1]).max() < 0.1


def test_a_chosen_window_is_the_one_that_suggest_chooses(x):
    np.save("x.npy", x)
    page, same = made("x.npy", "--delta", "10ms"), made("x.npy", "--delta", "10ms", "--auto")
    suggestion = algdiff.suggest(x, delta=0.01)
    assert page == same
    assert value(page, "window_length") == str(suggestion.differentiator.window_length)
    assert value(page, "degree") == str(suggestion.differentiator.degree)
    for line in suggestion.explain().splitlines():
        assert f"<p>{html.escape(line)}</p>" in page
    assert "Expected error of every candidate" in page
    assert "chosen from the data" in page


@pytest.mark.parametrize(
    "flags",
    [
        ["--fs", "100"],
        ["--window", "21"],
        ["--window", "24", "--deriv", "2", "--degree", "3", "--tau", "0.8", "--delta", "1ms"],
        ["--window", "0.2s", "--fs", "100", "--delay", "50ms", "--kappa", "0", "--mu", "-0.25"],
        ["--window", "21", "--tau", "newest", "--nan-policy", "omit", "--engine", "direct"],
        ["--window", "21", "--rule", "trapezoid", "--trim", "0.01"],
        ["--max-delay", "0", "--fs", "100", "--max-window", "0.5s"],
    ],
    ids=" ".join,
)
def test_its_lines_give_the_same_again(x, flags):
    if "omit" in flags:
        x[50:53] = np.nan
    np.save("a 'file'.npy", x)
    page = made("a 'file'.npy", *flags)
    python, (again, run) = code(page)
    names: dict[str, object] = {}
    exec(python, names)  # noqa: S102
    estimate = np.asarray(names["estimate"])
    assert value(page, "least") == f"{np.nanmin(estimate):.6g}"
    assert value(page, "largest") == f"{np.nanmax(estimate):.6g}"
    command = shlex.split(again)
    assert command[0] == "algdiff"
    assert main([*command[1:], "--overwrite"]) == 0
    assert Path("report.html").read_text() == page
    assert main([*shlex.split(run)[1:], "--overwrite"]) == 0
    assert np.allclose(np.load("OUT.npy"), estimate, rtol=1e-9, atol=1e-9 * np.abs(estimate).max(), equal_nan=True)


def samples_of(page: str) -> tuple[np.ndarray, np.ndarray]:
    """Run the lines that are printed; return samples and estimates, after a look at the least and largest of them."""
    names: dict[str, object] = {}
    exec(code(page)[0], names)  # noqa: S102
    estimate = np.asarray(names["estimate"])
    rows = np.moveaxis(estimate, 0, -1).reshape(-1, len(estimate)) if estimate.ndim > 1 else estimate[None]
    if "axis=0" not in code(page)[0]:
        rows = estimate.reshape(-1, estimate.shape[-1])
    for place, row in enumerate(rows):
        assert value(page, "least", place) == f"{row.min():.6g}"
        assert value(page, "largest", place) == f"{row.max():.6g}"
    return np.asarray(names["x"]), rows


@pytest.fixture
def two(x):
    return np.stack([x, x[::-1] ** 2], 1)


def test_the_lines_read_numpy_files(x, two):
    np.savez("one.npz", inner=x)  # without --key
    np.save("single.npy", x.astype(np.float32))
    np.save("two.npy", two)
    assert np.array_equal(samples_of(made("one.npz", "--window", 21))[0], x)
    assert np.array_equal(samples_of(made("single.npy", "--window", 21))[0], x.astype(np.float32).astype(float))
    found, rows = samples_of(made("two.npy", "--axis", 0, "--window", 21))
    assert np.array_equal(found, two)
    assert len(rows) == 2


@pytest.mark.parametrize("flags", [[], ["--columns", "b"], ["--columns", "b,a"], ["--columns", "2,a", "--time", "t"]])
def test_the_lines_read_tables(x, two, flags):
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    table = np.column_stack([np.arange(x.size) * 0.02, two])
    chosen = {"": [0, 1, 2], "b": [2], "b,a": [2, 1], "2,a": [2, 1]}[flags[1] if flags else ""]
    expected = table[:, chosen[0]] if len(chosen) == 1 else table[:, chosen]
    Path("x.csv").write_text(
        '\ufeff"t";"a#";b\n' + "\n".join(";".join(map(repr, row)) for row in table.tolist()), encoding="utf-8"
    )
    named = [one.replace("a", "a#") for one in flags]
    assert np.array_equal(samples_of(made("x.csv", "--window", 21, *named))[0], expected)
    np.savetxt("bare.csv", table, "%.17g", "\t")
    if not any(letter in "".join(flags) for letter in "abt"):
        assert np.array_equal(samples_of(made("bare.csv", "--window", 21))[0], expected)
    pq.write_table(pa.table(dict(zip("tab", table.T, strict=True))), "x.parquet")
    assert np.array_equal(samples_of(made("x.parquet", "--window", 21, *flags))[0], expected)


def test_the_lines_read_dates_and_whole_numbers(x):
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    days = np.datetime64("2024-01-01") + np.arange(x.size)
    Path("x.csv").write_text("day,a\n" + "\n".join(f"{day},{one!r}" for day, one in zip(days, x.tolist(), strict=True)))
    assert np.array_equal(samples_of(made("x.csv", "--window", 21, "--time", "day"))[0], x)
    counts = pa.array([int(100 * one) for one in x.tolist()])
    pq.write_table(pa.table({"a.b": counts, "c": counts.cast(pa.decimal128(24, 2))}), "x.parquet")
    expected = np.repeat(np.array(counts, float)[:, None], 2, 1)
    assert np.array_equal(samples_of(made("x.parquet", "--window", 21))[0], expected)


def test_the_lines_read_stores(x, two):
    h5py, zarr = pytest.importorskip("h5py"), pytest.importorskip("zarr")
    with h5py.File("x.h5", "w") as file:
        file["a/it's"] = two.T.astype(np.float32)
        file["b"] = x
    zarr.create_array("x.zarr", data=x, chunks=50)
    zarr.open_group("g.zarr", mode="w").create_array("a/b", data=two.T, chunks=(1, 50))
    assert np.array_equal(samples_of(made("x.h5:/a/it's", "--window", 21))[0], two.T.astype(np.float32))
    assert np.array_equal(samples_of(made("x.h5:b", "--window", 21))[0], x)
    assert np.array_equal(samples_of(made("x.zarr", "--window", 21))[0], x)
    assert np.array_equal(samples_of(made("g.zarr", "--window", 21))[0], two.T)
    assert np.array_equal(samples_of(made("g.zarr:a/b", "--window", 21))[0], two.T)


def test_the_lines_read_sound_and_raw_numbers(two):
    sound = pytest.importorskip("soundfile")
    sound.write("x.wav", 0.5 * two, 8000, subtype="PCM_16")
    held = sound.read("x.wav")[0]
    assert np.array_equal(samples_of(made("x.wav", "--window", 21))[0], held)
    assert np.array_equal(samples_of(made("x.wav", "--window", 21, "--columns", "1"))[0], held[:, 1])
    Path("x.bin").write_bytes(b"head" + (100 * two).astype(">i2").tobytes())
    how = ("--dtype", ">i2", "--offset", 4)
    assert np.array_equal(samples_of(made("x.bin", "--window", 21, "--channels", 2, *how))[0], np.trunc(100 * two))
    assert np.array_equal(samples_of(made("x.bin", "--window", 21, *how))[0], np.trunc(100 * two).ravel())


def test_the_lines_read_what_is_shown_of_a_long_recording(x, two, monkeypatch):
    monkeypatch.setattr(loading, "NUMBERS", 100)
    np.save("x.npy", x.astype(np.float32))
    np.savetxt("x.csv", two, "%.17g", ",")
    pytest.importorskip("h5py").File("x.h5", "w").create_dataset("x", data=x).file.close()
    shown = slice(50, 150)
    assert np.array_equal(samples_of(made("x.npy", "--window", 21))[0], x[shown].astype(np.float32))
    assert np.array_equal(samples_of(made("x.h5", "--window", 21))[0], x[shown])
    assert np.array_equal(samples_of(made("x.csv", "--window", 21))[0], two[75:125])
    monkeypatch.setattr(loading, "NUMBERS", 1 << 21)
    many = np.random.default_rng(0).normal(size=(300, 11)).cumsum(axis=0)
    np.save("many.npy", many)
    assert np.array_equal(samples_of(made("many.npy", "--axis", 0, "--window", 21))[0], many[:, :8])


def test_a_window_longer_than_what_is_shown(x, monkeypatch, capsys):
    monkeypatch.setattr(loading, "NUMBERS", 100)
    np.save("x.npy", x)
    assert report("x.npy", "--window", 101) == 1
    said = "x.npy: the page shows 100 samples, fewer than the window, 101: give a shorter one"
    assert error_line(capsys) == said
    np.save("two.npy", np.stack([x, x]))
    assert report("two.npy", "--window", 51) == 1
    assert error_line(capsys).endswith("fewer than the window, 51: give a shorter one, or fewer --columns")


def test_the_summary_of_a_design_is_computed_once(design, monkeypatch):
    calls = []
    right = of_design.report.summary
    monkeypatch.setattr(of_design.report, "summary", lambda one: calls.append(one) or right(one))
    made("d.json")
    assert calls == [design]


def test_infinite_samples_are_not_missing(x):
    x[50], x[90:92] = np.inf, np.nan
    np.save("x.npy", x)
    for flags, missing in (([], True), (["--nan-policy", "omit"], False)):
        page = made("x.npy", "--window", 21, *flags)
        assert (value(page, "missing"), value(page, "infinite")) == ("2", "1")
        assert "1 sample is infinite; no policy omits them" in page
        assert ("2 samples are missing" in page) == missing
    np.save("x.npy", np.where(np.isinf(x), 0, x))
    assert "infinite; no policy" not in made("x.npy", "--window", 21)


def test_a_column_without_a_finite_sample(x):
    table = np.column_stack([0.02 * np.arange(x.size), x, np.full(x.size, np.nan)])
    np.savetxt("x.csv", table, delimiter=",", header="t,x,allnan", comments="")
    for flags in ([], ["--window", "21"], ["--window", "21", "--nan-policy", "omit"]):
        page = made("x.csv", "--time", "t", *flags)
        assert Reader(page).headings[1:3] == ["x", "allnan"]
        assert "allnan: no sample is finite" in page
        assert "omit fits" not in page
        assert value(page, "without", 1) == "200"
    assert report("x.csv", "--time", "t", "--window", "21", "--nan-policy", "raise", "--overwrite") == 1


def test_a_constant_is_called_one():
    np.save("x.npy", np.full(300, 3.0))
    for flags in ([], ["--window", 21]):
        page = made("x.npy", *flags)
        assert "Constant: every finite sample is 3." in page
        assert "Signal: constant" in page
        titles = [re.findall("<title>(.*?)</title>", one)[0] for one in charts(page)]
        assert not {"Spectrum", "What is left", "Expected error of every candidate"} & {*titles}
        for word in ("coloured", "Why this window", "expected error"):
            assert word not in page
    np.save("x.npy", np.stack([np.full(300, 3.0), np.random.default_rng(0).normal(size=300).cumsum()]))
    page = made("x.npy")
    assert "channel 0: constant" in page
    assert "Expected error of every candidate" in page
    assert "<title>Spectrum</title>" in page


def test_a_level_that_is_given_is_that_of_the_band(x):
    np.save("x.npy", x)
    page = made("x.npy", "--sigma", "0.5")
    assert value(page, "noise_level") == "0.5"
    assert "noise level, given" in page
    python = code(page)[0]
    names: dict[str, object] = {}
    exec(python, names)  # noqa: S102
    assert "sigma=0.5" in python
    assert value(page, "std") == f"{np.median(names['std']):.6g}"
    assert "noise level, found" in made("x.npy", "--window", 21)


def test_commands_of_names_that_look_like_options(x):
    np.save("-dash.npy", x)
    assert report("--window", "21", "--", "-dash.npy") == 0
    for line in code(Path("report.html").read_text("utf-8"))[1]:
        assert main([*shlex.split(line)[1:], "--overwrite"]) == 0
    np.savetxt("x.csv", x, header="-a", comments="")
    for line in code(made("x.csv", "--window", "21", "--columns=-a"))[1]:
        assert main([*shlex.split(line)[1:], "--overwrite"]) == 0


def test_one_unit_in_charts_and_tables(x):
    np.savetxt("x.csv", x, header="a name " * 30, comments="")
    page = made("x.csv", "--window", 21)
    derivative = next(one for one in charts(page) if "<title>Derivative of order 1</title>" in one)
    assert "signal per sample" in derivative
    assert "a name" not in derivative
    assert "<td>signal per sample</td>" in page
    signal = next(one for one in charts(page) if "<title>Signal</title>" in one)
    assert "a name " * 7 not in signal
    assert len(Reader(page).headings[1]) == of_recording.HEADING - 1
    assert "\N{HORIZONTAL ELLIPSIS}" in signal


def test_without_a_step_nothing_is_said_twice(x):
    np.save("x.npy", x)
    page = made("x.npy", "--window", 21)
    assert "in a window of 21 samples. " in page
    assert 'data-name="delay_samples"' not in page
    assert "in a window of 21 samples (0.21 s). " in made("x.npy", "--window", 21, "--fs", 100)


def test_missing_samples_are_counted_and_said(x):
    x[50:55] = np.nan
    np.save("x.npy", x)
    page = made("x.npy", "--window", 21)
    assert value(page, "missing") == "5"
    assert value(page, "without") == "25"
    assert "5 samples are missing" in page
    page = made("x.npy", "--window", 21, "--nan-policy", "omit")
    assert value(page, "without") == "0"
    assert "samples are missing" not in page


def test_warnings_are_on_the_page_and_on_stderr(x, capsys):
    np.save("x.npy", x)
    with pytest.warns(algdiff.DesignWarning) as caught:
        algdiff.Differentiator(21, degree=9, fs=100)
    said = str(caught[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        page = made("x.npy", "--window", 21, "--degree", 9, "--fs", 100)
    assert f"<li>{html.escape(said)}</li>" in page
    assert f"algdiff: warning: {said}" in capsys.readouterr().err


def test_a_band_that_is_too_narrow_is_said(x):
    np.save("x.npy", x)
    np.save("rounded.npy", np.round(x, 1))
    assert "may be too narrow" in made("rounded.npy", "--fs", 100)
    assert "may be too narrow" not in made("x.npy", "--fs", 100)


def test_a_step_that_nobody_says_is_said(x):
    np.save("x.npy", x)
    assert "times are in samples" in made("x.npy", "--window", 21)
    assert "times are in samples" not in made("x.npy", "--window", 21, "--fs", 1)


def test_eight_columns_and_no_more_have_a_section():
    y = np.random.default_rng(0).normal(size=(300, 11)).cumsum(axis=0)
    np.savetxt("y.csv", y, delimiter=",", header=",".join(f"column {n}" for n in range(11)), comments="")
    page = made("y.csv", "--window", 21)
    sections = [*(f"column {n}" for n in range(8)), "The design", "The same again"]
    assert Reader(page).headings == ["y.csv", *sections]
    assert "Shown are the first 8 columns of 11; the rest is left out." in page
    for place in range(8):
        assert value(page, "least", place) == f"{algdiff.differentiate(y[:, place], 21).min():.6g}"
    page = made("y.csv", "--window", 21, "--columns", "column 9,0")
    assert Reader(page).headings == ["y.csv", "column 9", "column 0", *sections[-2:]]


def test_of_a_long_recording_a_stretch_in_the_middle_is_read(monkeypatch):
    y = np.random.default_rng(0).normal(size=10_000).cumsum()
    np.save("y.npy", y)
    monkeypatch.setattr(loading, "NUMBERS", 1000)
    page = made("y.npy", "--window", 21, "--fs", 10)
    assert "Shown are samples 4500 to 5499 of 10000, a stretch in the middle." in page
    assert value(page, "samples") == "1000"
    assert value(page, "least") == f"{algdiff.differentiate(y[4500:5500], 21, fs=10).min():.6g}"
    signal = next(one for one in charts(page) if "<title>Signal</title>" in one)
    assert ">460</text>" in signal


def test_complex_samples_are_two_rows():
    z = np.exp(0.05j * np.arange(300))
    np.save("z.npy", np.stack([z, 2 * z]))
    page = made("z.npy", "--window", 21)
    parts = [f"{part} part of channel {row}" for row in (0, 1) for part in ("real", "imaginary")]
    assert Reader(page).headings[1:5] == parts
    assert value(page, "largest", 3) == f"{algdiff.differentiate(2 * z.imag, 21).max():.6g}"
    np.save("z.npy", np.stack([z, 2 * z], 1).astype(np.complex64))
    page = made("z.npy", "--axis", 0, "--window", 21)
    names: dict[str, object] = {}
    exec(code(page)[0], names)  # noqa: S102
    std = np.asarray(names["std"])
    assert std.shape == (2, 300, 2)
    for place, (row, part) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1)]):
        assert value(page, "std", place) == f"{np.median(std[part, :, row]):.6g}"


def test_formats_and_the_step_that_they_state(x):
    pytest.importorskip("soundfile").write("x.wav", 0.5 * x, 8000, subtype="DOUBLE")
    pytest.importorskip("h5py").File("x.h5", "w").create_dataset("a/b", data=np.stack([x, x])).file.close()
    np.savez("x.npz", first=x, second=2 * x)
    np.savetxt("x.csv", np.stack([np.arange(x.size) * 0.02, x], 1), delimiter=",", header="t,angle", comments="")
    assert value(made("x.wav"), "fs") == "8000"
    assert Reader(made("x.h5:/a/b", "--window", 21)).headings[:3] == ["x.h5:/a/b", "channel 0", "channel 1"]
    page = made("x.npz", "--key", "second", "--window", 21)
    assert Reader(page).headings[:2] == ["x.npz", "second"]
    assert value(page, "largest") == f"{algdiff.differentiate(2 * x, 21).max():.6g}"
    page = made("x.csv", "--time", "t")
    assert value(page, "delta") == "0.02"
    assert Reader(page).headings[1] == "angle"


@pytest.mark.parametrize(
    ("name", "samples"),
    [
        ("nothing there", np.full(300, np.nan)),
        ("constant", np.full(300, 3.0)),
        ("infinite", np.where(np.arange(300) % 100 == 7, np.inf, np.arange(300))),
        ("huge", 1e305 * np.sin(np.arange(300) / 20)),
        ("tiny", 1e-310 * np.sin(np.arange(300) / 20)),
        ("far away", 1e9 + np.sin(np.arange(300) / 20)),
        ("short", np.arange(21.0)),
        ("cut", (3 * np.sin(np.arange(300) / 20)).astype(np.int8)),
        ("bits", np.arange(300) % 7 > 3),
    ],
)
def test_odd_samples_make_a_page(name, samples, recwarn):
    np.save(f"{name}.npy", samples)
    page = made(f"{name}.npy", "--window", 21)
    assert not re.search(r' (?:d|x|y)="[^"]*(?:nan|inf)', page)
    assert not recwarn.list


def test_equal_input_equal_bytes(x):
    np.save("x.npy", x)
    assert made("x.npy", output="a.html") == made("x.npy", output="b.html")


# --- names that are markup -------------------------------------------------------------------------------------------

HOSTILE = ("<script>alert(1)<", '"><img src=x onerror=alert(1)>', "]]>", "a&lt;b", "</title></style><b>", "--><!--")


@pytest.mark.parametrize("name", HOSTILE)
def test_names_are_text(name, x):
    file = "a " + name.replace("/", "\N{DIVISION SLASH}")
    columns = f'"{name.replace(chr(34), chr(34) * 2)}"'
    Path(f"{file}.csv").write_text("\n".join([columns, *map(str, x.tolist())]), encoding="utf-8")
    page = made(f"{file}.csv", "--window", 21)
    assert Reader(page).headings[:2] == [f"{file}.csv", name]
    assert file in code(page)[0]
    assert "<script" not in page
    assert "<img" not in page


def test_names_that_are_no_text(x):
    name = b"bad\xff\x1b[31m\nname.npy".decode("utf-8", "surrogateescape")
    try:
        np.save(name, x)
    except (OSError, ValueError):
        pytest.skip("no such names here")
    page = made(name, "--window", 21)
    assert Reader(page).headings[0] == "bad\ufffd\ufffd[31m\nname.npy"
    python, shell = code(page)
    assert all("report NAME --" in line or "run NAME OUT" in line for line in shell)
    assert all(line.endswith("  # NAME: what cannot be printed here") for line in shell)
    names: dict[str, object] = {}
    exec(python, names)  # noqa: S102
    assert np.array_equal(np.asarray(names["x"]), x)
    assert "\x1b" not in page


# --- files ----------------------------------------------------------------------------------------------------------


def test_what_exists_is_kept(x, capsys):
    np.save("x.npy", x)
    Path("report.html").write_text("mine")
    assert report("x.npy", "--window", 21) == 1
    assert error_line(capsys) == "report.html: exists; give --overwrite to replace it"
    assert Path("report.html").read_text() == "mine"
    assert report("x.npy", "--window", 21, "--overwrite") == 0
    assert Path("report.html").read_text().startswith("<!DOCTYPE html>")
    assert capsys.readouterr() == ("", "wrote report.html\n")


@pytest.mark.parametrize(
    "fault", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt(), MemoryError()]
)
@pytest.mark.parametrize("place", [(_output.os, "fsync"), (Report, "html"), (_output, "publish")])
def test_nothing_is_left_of_a_failure(x, capsys, monkeypatch, place, fault):
    def fail(*_: object) -> None:
        raise fault

    np.save("x.npy", x)
    monkeypatch.setattr(*place, fail)
    assert report("x.npy", "--window", 21) == (130 if isinstance(fault, KeyboardInterrupt) else 1)
    assert not Path("report.html").exists()
    assert leftovers(Path()) == []
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["x.npy", "-o", "x.txt"], 2, "--output must be a .html file, got x.txt"),
        (["x.npy", "-o", "no/x.html"], 1, "no/x.html: its folder does not exist"),
        (["none.npy"], 1, "none.npy: No such file or directory"),
        (["none.json"], 1, "none.json: No such file or directory"),
        (["x.foo"], 2, "IN: the suffix of x.foo must be .npy, .npz, "),
        (["x.npy", "--tau", "root"], 2, "--tau is for a --window, got --auto"),
        (["x.npy", "--window", "21", "--sigma", "1"], 2, "--sigma is for --auto, got --window"),
        (["x.npy", "--window", "21", "--auto"], 2, ""),
        (["x.npy", "--window", "50ms"], 2, "--fs or --delta must be given for numbers in ms"),
        (["x.npy", "--window", "201"], 1, "x.npy: must hold as many samples as the window, 201, got 200"),
        (["x.npy", "--window", "3", "--degree", "5"], 2, "--window: window_length must be at least degree + 1 = 6"),
        (["x.npy", "--columns", "a"], 2, "--columns is for a .csv, .parquet or audio file, got x.npy"),
        (["x.npy", "--key", "a"], 2, "--key is for a .npz file, got x.npy"),
        (["x.npy", "--time", "t"], 2, "--time is for a .csv or .parquet file, got x.npy"),
        (["x.npy", "--axis", "1"], 1, "--axis must be "),
        (["x.csv", "--time", "t", "--fs", "3"], 2, "give --time, --delta or --fs: got --time and another"),
        (["gap.npy", "--window", "21", "--nan-policy", "raise"], 1, "gap.npy must hold no missing samples"),
        (["scalar.npy"], 1, "scalar.npy: must hold samples, got a single number"),
        (["empty.npy", "--window", "21"], 1, "empty.npy: must hold samples, got shape (0, 100)"),
        (["emptyc.npy", "--window", "21"], 1, "emptyc.npy: must hold samples, got shape (100, 0)"),
        (
            ["tall.npy"],
            1,
            "tall.npy must have at least 6 samples to choose a window, got 2: along --axis 0 there are 200",
        ),
        (
            ["tall.npy", "--window", "5"],
            1,
            "tall.npy: must hold as many samples as the window, 5, got 2: along --axis 0",
        ),
        (["d.json", "--window", "21"], 2, "--window is for a recording, got the design d.json"),
        (["d.json", "--auto"], 2, "--auto is for a recording, got the design d.json"),
        (["cut.json"], 1, "cut.json: must hold JSON, as algdiff design --json prints it"),
        (["deep.json"], 1, "deep.json: must hold JSON, as algdiff design --json prints it"),
        (["list.json"], 1, "list.json: must hold a design, as algdiff design --json prints it; lacks window_length"),
        (["some.json"], 1, "some.json: must hold a design, as algdiff design --json prints it; lacks deriv"),
        (["wrong.json"], 1, "wrong.json: holds no design: degree must be "),
        (["changed.json"], 1, "changed.json: its weights are not those of its arguments"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
@pytest.mark.usefixtures("design")
def test_refusals(x, capsys, arguments, code, said):
    np.save("x.npy", x)
    np.save("gap.npy", np.where(np.arange(x.size) == 50, np.nan, x))
    np.save("scalar.npy", np.float64(3))
    np.save("empty.npy", np.empty((0, 100)))
    np.save("emptyc.npy", np.empty((100, 0)))
    np.save("tall.npy", np.stack([x, x], 1))
    np.savetxt("x.csv", np.stack([np.arange(x.size), x], 1), delimiter=",", header="t,x", comments="")
    found = json.loads(Path("d.json").read_text())
    Path("cut.json").write_text("[1")
    Path("deep.json").write_text("[" * 100_000)
    Path("list.json").write_text("[]")
    Path("some.json").write_text('{"window_length": 5}')
    Path("wrong.json").write_text(json.dumps({**found, "degree": -1}))
    Path("changed.json").write_text(json.dumps({**found, "kappa": 2.5}))
    assert report(*arguments) == code
    err = capsys.readouterr().err
    assert f"algdiff: error: {said}" in err if said else "not allowed with" in err
    assert not Path("report.html").exists()
    assert leftovers(Path()) == []


def test_a_design_is_among_what_can_be_given(capsys):
    assert report("x.foo") == 2
    assert ".wav, .flac or .json, got '.foo'" in error_line(capsys)


def test_designs_come_back_whatever_they_are(capsys):
    for flags in (["--window", "45", "--degree", "4", "--kappa", "3", "--mu", "-0.5", "--tau", "0.7", "--trim", "0.01"],
                  ["--window", "20", "--deriv", "3", "--rule", "cell"], ["--window", "31", "--deriv", "0"],
                  ["--for-delay", "50ms", "--tau", "root", "--fs", "1kHz", "--rule", "trapezoid"]):  # fmt: skip
        assert main(["design", *flags, "--json"]) == 0
        Path("d.json").write_text(capsys.readouterr().out)
        summary = json.loads(Path("d.json").read_text())
        page = made("d.json")
        assert eval(code(page)[0].split("\n")[-1]).weights.tolist() == summary["weights"]  # noqa: S307
        assert value(page, "noise_gain") == shown(summary["noise_gain"])
