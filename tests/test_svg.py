"""Charts: what is drawn where, what stays of many points, ticks, odd values, text that is none of markup."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from algdiff._pages.document import page
from algdiff._svg.axes import MINUS, TIMES, Axis, given, span
from algdiff._svg.chart import STYLE, Curve, Mark, chart, text
from algdiff._svg.points import COLUMNS

SVG = "{http://www.w3.org/2000/svg}"
WORDS = {"title": "A title", "x_label": "time, s", "y_label": "signal"}
HOSTILE = ("<script>alert(1)</script>", '"><img src=x onerror=alert(1)>', "]]>", "&amp;", "\udcff\x00\x1b", "\u202etxt")


def drawn(*curves: Curve, **words: object) -> ET.Element:
    return ET.fromstring(chart(curves, **{**WORDS, **words}))  # noqa: S314  (our own text)


def points(root: ET.Element, kind: str = "curve", place: int = 0) -> np.ndarray:
    """Return the pixels of a curve inside the frame, all its pieces one after another."""
    inner = root.find(f"{SVG}svg")
    assert inner is not None
    path = [one for one in inner if one.get("class", "").startswith(kind)][place].get("d", "")
    return np.array([list(map(float, pair)) for pair in re.findall(r"([-\d.]+),([-\d.]+)", path)])


def box(root: ET.Element) -> np.ndarray:
    inner = root.find(f"{SVG}svg")
    assert inner is not None
    left, top, width, height = map(float, inner.get("viewBox", "").split())
    return np.array([left, top, left + width, top + height])


def labels(root: ET.Element) -> list[str]:
    return ["".join(one.itertext()) for one in root.findall(f"{SVG}text")]


# --- where points lie -----------------------------------------------------------------------------------------------


def test_points_lie_where_their_values_say():
    x, y = [0, 1, 4, 5], [10, 30, 20, 10]
    root = drawn(Curve("", x, y), x_range=(0, 5), y_range=(10, 30))
    left, top, right, bottom = box(root)
    expected = np.stack([left + (right - left) * np.array(x) / 5, bottom - (bottom - top) * (np.array(y) - 10) / 20], 1)
    assert np.abs(points(root) - expected).max() <= 0.051  # a decimal of a pixel


def test_logarithmic_axes():
    root = drawn(Curve("", [1, 10, 100], [1e-3, 1e-1, 1e1]), log_x=True, log_y=True, y_range=(1e-3, 1e1))
    left, top, right, bottom = box(root)
    middle = [[left, bottom], [(left + right) / 2, (top + bottom) / 2], [right, top]]
    assert np.abs(points(root) - middle).max() <= 0.051


def test_points_are_drawn_in_order_and_those_that_have_no_place_are_left_out():
    shuffled = drawn(Curve("", [2, 0, np.nan, 1], [5, 1, 7, 3]))
    assert points(shuffled).tolist() == points(drawn(Curve("", [0, 1, 2], [1, 3, 5]))).tolist()
    assert len(points(drawn(Curve("", [-1, 0, 1, 10], [1, 1, 2, 3]), log_x=True))) == 2


@pytest.mark.parametrize("gap", [np.nan, np.inf, -np.inf])
def test_gaps_break_lines(gap):
    text = chart([Curve("", np.arange(6), [0, 1, gap, 2, 3, gap])], **WORDS)
    (path,) = re.findall(r'class="curve c0" d="([^"]*)"', text)
    assert path.count("M") == 2
    assert "nan" not in text
    assert "inf" not in text


def test_a_peak_of_one_sample_among_a_million_stays_and_points_are_few():
    y = np.random.default_rng(0).uniform(-1, 1, 1_000_000)
    y[612_345], y[123_456] = 50, -70
    root = drawn(Curve("", np.arange(y.size), y), y_range=(-70, 50), size=(960, 300))
    drawn_points, (left, top, right, bottom) = points(root), box(root)
    assert 800 <= len(drawn_points) <= 2 * COLUMNS + 4
    for index, edge in ((612_345, top), (123_456, bottom)):
        nearest = drawn_points[np.abs(drawn_points[:, 1] - edge) < 0.06]
        assert np.abs(nearest[:, 0] - (left + (right - left) * index / (y.size - 1))).min() <= 0.06


def test_a_gap_in_many_points_is_a_gap_and_a_lone_missing_sample_is_not():
    y = np.zeros(100_000)
    y[50_000] = np.nan
    assert chart([Curve("", np.arange(y.size), y)], **WORDS).count('curve c0" d="M') == 1
    (path,) = re.findall(r'curve c0" d="([^"]*)"', chart([Curve("", np.arange(y.size), y)], **WORDS))
    assert path.count("M") == 1
    y[50_000:60_000] = np.nan
    (path,) = re.findall(r'curve c0" d="([^"]*)"', chart([Curve("", np.arange(y.size), y)], **WORDS))
    assert path.count("M") == 2


def test_a_part_is_as_fine_as_the_whole():
    x = np.arange(1_000_000)
    root = drawn(Curve("", x, np.sin(x / 10)), x_range=(500_000, 500_100))
    inside = points(root)
    assert 101 <= len(inside) <= 104
    assert abs(inside[:, 0].min() - box(root)[0]) < 10


def test_bands_steps_dots_and_marks():
    x = np.arange(4.0)
    root = drawn(
        Curve("band", x, kind="band", lower=x - 1, upper=x + 1),
        Curve("steps", x, x, kind="steps"),
        Curve("dots", x, x, kind="dots"),
        x_range=(0, 3),
        marks=[Mark("at 1", 1), Mark("outside", 9)],
    )
    assert len(points(root, "band")) == 8
    inner = root.find(f"{SVG}svg")
    assert inner is not None
    assert [one.get("class") for one in inner] == ["mark c3", "band c0", "curve c1", "dots c2"]
    steps = next(one.get("d", "") for one in inner if one.get("class") == "curve c1")
    assert re.sub(r"[\d.,]+", "", steps) == "MHVHVHV"
    assert {"band", "steps", "dots", "at 1", "outside"} <= set(labels(root))


def test_a_band_breaks_where_either_edge_is_missing():
    x = np.arange(100_000.0)
    lower, upper = x - 1, x + 1
    lower[20_000:30_000], upper[60_000:70_000] = np.nan, np.nan
    (path,) = re.findall(r'band c0" d="([^"]*)"', chart([Curve("", x, kind="band", lower=lower, upper=upper)], **WORDS))
    assert path.count("M") == path.count("Z") == 3


# --- ticks ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_ticks_are_round_evenly_spaced_and_inside(seed):
    rng = np.random.default_rng(seed)
    for _ in range(200):
        center = rng.normal() * 10 ** rng.uniform(-5, 5)
        low, high = sorted((center, center + 10 ** rng.uniform(-3, 3) * max(abs(center), 1e-3)))
        axis = Axis(low, high, 0, 100)
        ticks = axis.ticks(6)
        steps = np.diff(ticks.places)
        assert 2 <= len(ticks.places) <= 7
        step = steps.mean()
        assert np.allclose(steps, step, rtol=1e-6)
        assert np.isclose(step / 10 ** np.floor(np.log10(step) + 1e-9), [1, 2, 5]).any()
        assert min(ticks.places) >= low - 1e-5 * step
        assert max(ticks.places) <= high + 1e-5 * step
        assert len(set(ticks.labels)) == len(ticks.labels)
        assert max(map(len, ticks.labels)) <= 9


@pytest.mark.parametrize(
    ("low", "high", "labels", "note"),
    [
        (0, 1, ("0.0", "0.5", "1.0"), ""),
        (0, 1e-7, ("0", "50", "100"), f"{TIMES}10⁻⁹"),
        (0, 250_000, ("0", "100", "200"), f"{TIMES}10³"),
        (-3, 3, (f"{MINUS}2", "0", "2"), ""),
        (1e9, 1e9 + 1, ("0.0", "0.5", "1.0"), "+ 1000000000"),
        (-1e9 - 1, -1e9, (f"{MINUS}1.0", f"{MINUS}0.5", "0.0"), f"{MINUS} 1000000000"),
    ],
)
def test_numbers_at_ticks_are_short(low, high, labels, note):
    ticks = Axis(low, high, 0, 100).ticks(3)
    assert (ticks.labels, ticks.note) == (labels, note)


def test_decades():
    ticks = Axis(1e-3, 1e3, 0, 100, log=True).ticks(10)
    assert ticks.labels == ("0.001", "0.01", "0.1", "1", "10", "100", "1000")
    assert Axis(1e-9, 1e9, 0, 100, log=True).ticks(5).labels == ("10⁻⁸", "10⁻⁴", "10⁰", "10⁴", "10⁸")
    assert Axis(1, 9, 0, 100, log=True).ticks(5).labels == ("1", "2", "5")
    assert Axis(3, 3.4, 0, 100, log=True).ticks(5).labels[0] in ("3.0", "3")


# --- odd values -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize(
    "values",
    [
        [],
        [np.nan, np.nan],
        [np.inf, -np.inf],
        [0],
        [3, 3, 3],
        [0, 5e-324],
        [1e-310, 3e-310],
        [-1.7e308, 1.7e308],
        [1e308, 1.1e308],
        [-1, -2],
        [1, np.inf, 2],
        [1e9, 1e9 + 1e-6],
        [1e-300, 1e300],
    ],
    ids=str,
)
def test_any_values_make_a_chart_of_finite_numbers(values, log):
    for kind in ("line", "steps", "dots"):
        for curve in (Curve("a", values, values, kind), Curve("a", np.arange(len(values)), values, kind)):
            said = chart([curve], **WORDS, log_x=log, log_y=log, marks=[Mark("m", np.nan), Mark("n", np.inf)])
            ET.fromstring(said)  # noqa: S314
            numbers = re.findall(r'(?:d|x|y|viewBox|width|height)="([^"]*)"', said)
            assert not re.search("nan|inf|e[-+]", " ".join(numbers))


def test_ranges_that_are_asked_for_are_taken_if_they_can_be():
    assert given((1, 5), log=False) == (1, 5)
    assert given((5, 1), log=False) == (1, 5)
    low, high = given((-1, 10), log=True)
    assert 0 < low < high == 10
    low, high = given((2, 2), log=False)
    assert low < 2 < high
    assert span([np.array([1.0, 2.0, np.nan])], log=False, margin=0.0) == (1, 2)


# --- text -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", HOSTILE)
def test_hostile_words_are_text(words):
    said = chart([Curve(words, [0, 1], [0, 1])], title=words, x_label=words, y_label=words, marks=[Mark(words, 0.5)])
    root = ET.fromstring(said)  # noqa: S314
    assert {one.tag.removeprefix(SVG) for one in root.iter()} == {"svg", "title", "desc", "path", "text"}
    assert not any(name.startswith("on") or name in ("href", "src") for one in root.iter() for name in one.attrib)
    said.encode("utf-8")
    title = root.find(f"{SVG}title")
    assert title is not None
    assert title.text == re.sub("[\x00\x1b\udcff\u202e]", "\ufffd", words)


def test_names_stay_whole_for_those_who_do_not_see_the_chart():
    root = drawn(Curve("velocity", [0, 1], [2, 7]), marks=[Mark("cutoff 20 Hz", 0.5)])
    said = [one.text for one in root if one.tag in (f"{SVG}title", f"{SVG}desc")]
    assert root.get("role") == "img"
    assert said == ["A title", "signal over time, s. velocity: from 2 to 7. cutoff 20 Hz."]


def test_long_names_are_shortened_in_their_middle():
    root = drawn(Curve("x" * 500 + "end", [0, 1], [0, 1]), title="start" + "y" * 500)
    legend = next(one for one in labels(root) if one.endswith("end"))
    assert len(legend) < 60
    assert "…" in legend
    assert next(one for one in labels(root) if one.startswith("start")).endswith("y")


def test_nothing_outside_is_referred_to():
    said = chart([Curve("a", [0, 1], [0, 1])], **WORDS) + STYLE
    assert not re.search(r"url\(|href|src=|@import|<script|<style", said)
    assert set(re.findall(r"https?://[^\"' )]+", said)) == {"http://www.w3.org/2000/svg"}


def test_equal_input_equal_text():
    x = np.random.default_rng(1).normal(size=5000)
    assert chart([Curve("a", np.arange(5000), x)], **WORDS) == chart([Curve("a", np.arange(5000), x)], **WORDS)


def test_styles_differ_in_dashes_and_in_both_colours():
    light, dark = (re.findall(rf"{block}[^}}]*", STYLE)[0] for block in (r"^\s*:root", r"dark\) \{ :root"))
    for block in (light, dark):
        colours = re.findall(r"--c\d: (#\w+);", block)
        assert len(set(colours)) == 8
    dashes = re.findall(r"stroke-dasharray: ([\d. ]+);", STYLE)
    assert len(dashes) == len(set(dashes)) == 6


# --- the page -------------------------------------------------------------------------------------------------------


def test_a_page_without_a_script_allows_none():
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page("t", "<p>b</p>"))
    assert policy
    assert policy[1].startswith("default-src 'none'; style-src 'unsafe-inline'; img-src data:;")
    assert "script-src" not in policy[1]
    assert "connect-src" not in policy[1]


def test_a_script_is_allowed_by_its_digest_or_its_nonce():
    import base64
    import hashlib

    said = page("t", "b", script="f(1 < 2);")
    digest = base64.b64encode(hashlib.sha256(b"f(1 < 2);").digest()).decode()
    assert f"script-src 'sha256-{digest}'; connect-src 'self'" in said
    assert "<script>f(1 < 2);</script>" in said
    said = page("t", "b", script="f();", nonce="abc")
    assert "script-src 'nonce-abc'" in said
    assert '<script nonce="abc">f();</script>' in said


@pytest.mark.parametrize("words", [{"script": "'</SCRIPT>'"}, {"style": "</style><b>"}])
def test_a_script_or_style_that_would_end_early_is_refused(words):
    with pytest.raises(ValueError, match="must not hold the end of its own element, got </"):
        page("t", "b", **words)


@pytest.mark.parametrize("words", HOSTILE)
def test_hostile_titles_are_text(words):
    said = page(words, "")
    assert said.count("<title>") == said.count("</title>") == 1
    assert text(words) in said
    assert "<script" not in said
    assert "<img" not in said
