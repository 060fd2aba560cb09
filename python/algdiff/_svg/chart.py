"""Line charts as SVG text, for pages; what they look like is said by `STYLE`, the style sheet of the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff._refusals import printed
from algdiff._svg import points
from algdiff._svg.axes import Axis, Ticks, given, span
from algdiff._svg.style import DASHES, STYLE

__all__ = ["STYLE", "Curve", "Mark", "chart", "text"]

Floats = NDArray[np.float64]

LINE = 18
"""Height of a line of text, which is itself 13 high, in the units of the chart."""
EDGE = 10
"""What is left free at the right."""
SAMPLE = 26
"""Width of a line in the legend, and what follows it."""


class Curve(NamedTuple):
    """One curve of a chart.

    Attributes
    ----------
    name : str
        What the legend calls it; "" leaves it out.
    x, y : array_like
        Its points, drawn in ascending order of x. NaN and infinities are gaps.
    kind : {"line", "steps", "dots", "band"}
        "steps" holds each value up to the next point; a "band" lies between `lower` and `upper`, and has no `y`.
    lower, upper : array_like
        Of a band.
    style : int, optional
        Colour and dashes, from 0 to 7, of which 7 is thin and grey; by default the place of the curve.
    """

    name: str
    x: ArrayLike
    y: ArrayLike | None = None
    kind: str = "line"
    lower: ArrayLike | None = None
    upper: ArrayLike | None = None
    style: int | None = None


class Mark(NamedTuple):
    """An upright line through a chart, and what the legend calls it; styles as of curves, counted on from these."""

    name: str
    x: float
    style: int | None = None


class _Line(NamedTuple):
    """A curve or a mark, as numbers: its name in the legend, its kind, its style, its points."""

    name: str
    kind: str
    style: int
    x: Floats
    values: tuple[Floats, ...]


def chart(
    curves: Sequence[Curve],
    *,
    title: str,
    x_label: str,
    y_label: str,
    log_x: bool = False,
    log_y: bool = False,
    marks: Sequence[Mark] = (),
    size: tuple[int, int] = (380, 290),
    x_range: tuple[float, float] | None = None,
    y_range: tuple[float, float] | None = None,
) -> str:
    """Return a chart as an SVG element that becomes as wide as what it is put into.

    Parameters
    ----------
    curves : sequence of Curve
        Drawn in this order, the last one on top. Each may have any number of points.
    title, x_label, y_label : str
        Any text; it is escaped.
    log_x, log_y : bool
        Logarithmic axes. Values of y that are not positive lie below the chart, those of x are left out.
    marks : sequence of Mark
        Upright lines.
    size : tuple of int
        Width and height. Text is 13 units high: a chart 380 wide is readable on a phone, and one as many wide as it
        has pixels shows text of 13 pixels.
    x_range, y_range : tuple of float, optional
        What the axes show; by default everything.

    Returns
    -------
    str
        The element, without any reference to something outside. The page needs `STYLE`.

    Examples
    --------
    >>> from algdiff._svg.chart import Curve, chart
    >>> text = chart([Curve("a < b", [0, 1], [2, 3])], title="Two points", x_label="t, s", y_label="x")
    >>> text[:24], "a &lt; b" in text
    ('<svg class="chart" xmlns', True)
    """
    width, height = size
    lines, uprights = _lines(curves, marks)
    keys, top = _legend([*lines, *uprights], width)
    x_low, x_high = given(x_range, log=log_x) if x_range else span([one.x for one in lines], log=log_x, margin=0.0)
    inside = [values for one in lines for values in _inside(one, x_low, x_high)]
    y_low, y_high = given(y_range, log=log_y) if y_range else span(inside, log=log_y, margin=0.06)
    bottom = height - 2 * LINE - 6
    y_axis = Axis(y_low, y_high, bottom, top, log_y)
    y_ticks = y_axis.ticks(max((bottom - top) // 32, 2))
    x_axis = Axis(x_low, x_high, 10 + max(map(_wide, y_ticks.labels), default=0), width - EDGE, log_x)
    x_ticks = x_axis.ticks(max(int(x_axis.last - x_axis.first) // 66, 2))
    box = f"{x_axis.first:.1f} {top} {x_axis.last - x_axis.first:.1f} {bottom - top}"
    x, y, across, along = box.split()
    drawn = "".join(_drawn(one, x_axis, y_axis) for one in [*uprights, *lines])
    said = f"{y_label} over {x_label}. {' '.join(map(_said, lines))} {' '.join(map(_said, uprights))}"
    return (
        f'<svg class="chart" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">'
        f"<title>{text(title)}</title><desc>{text(' '.join(said.split()))}</desc>"
        f"{_grid(x_axis, y_axis, x_ticks, y_ticks)}"
        f'<svg x="{x}" y="{y}" width="{across}" height="{along}" viewBox="{box}">{drawn}</svg>'
        f"{_labels((title, x_label, y_label), x_axis, y_axis, x_ticks, y_ticks)}{keys}</svg>"
    )


def text(words: object) -> str:
    """Return words as they can stand in XML and HTML, in text and in quoted attributes."""
    return escape(printed(str(words)), {'"': "&quot;", "'": "&#39;"})


def _lines(curves: Sequence[Curve], marks: Sequence[Mark]) -> tuple[list[_Line], list[_Line]]:
    """Return curves and marks as numbers, in style."""
    lines = []
    for place, curve in enumerate(curves):
        parts = (curve.lower, curve.upper) if curve.kind == "band" else (curve.y,)
        x, *values = (np.asarray([] if part is None else part, np.float64).reshape(-1) for part in (curve.x, *parts))
        style = place if curve.style is None else curve.style
        lines.append(_Line(str(curve.name), curve.kind, style % len(DASHES), x, tuple(values)))
    uprights = []
    for place, mark in enumerate(marks, len(lines)):
        style = place if mark.style is None else mark.style
        uprights.append(_Line(str(mark.name), "mark", style % len(DASHES), np.array([float(mark.x)]), ()))
    return lines, uprights


def _inside(line: _Line, low: float, high: float) -> list[Floats]:
    """Return the values that lie in a range of x."""
    count = min(map(len, (line.x, *line.values)))
    with np.errstate(invalid="ignore"):
        there = (line.x[:count] >= low) & (line.x[:count] <= high)
    return [values[:count][there] for values in line.values]


def _drawn(line: _Line, x_axis: Axis, y_axis: Axis) -> str:
    """Return a curve, or a mark, as a path."""
    first, last = x_axis.first, x_axis.last
    across = x_axis.at(np.where(line.x > 0, line.x, np.nan) if x_axis.log else line.x)
    if line.kind == "mark":
        if not first - 0.5 <= across[0] <= last + 0.5:
            return ""
        path = f"M{across[0]:.1f},{y_axis.first:.0f}V{y_axis.last:.0f}"
    else:
        x, *values = points.ascending(across, *map(y_axis.at, line.values))
        path = getattr(points, line.kind)(points.runs(x, tuple(values), first, last))
    return f'<path class="{_kind(line)} c{line.style}" d="{path}"/>' if path else ""


def _kind(line: _Line) -> str:
    return "curve" if line.kind in ("line", "steps") else line.kind


def _said(line: _Line) -> str:
    """Return a curve in words, for those who do not see it."""
    if line.kind == "mark":
        return f"{line.name}." if line.name else ""
    there = np.concatenate(line.values)
    there = there[np.isfinite(there)]
    if not line.name or not there.size:
        return f"{line.name}: nothing." if line.name else ""
    return f"{line.name}: from {there.min():.4g} to {there.max():.4g}."


def _grid(x_axis: Axis, y_axis: Axis, x_ticks: Ticks, y_ticks: Ticks) -> str:
    """Return the lines at the ticks, and the axes."""
    left, right, bottom, top = x_axis.first, x_axis.last, y_axis.first, y_axis.last
    across = x_axis.at(np.array((*x_ticks.places, *x_ticks.minor)))
    along = y_axis.at(np.array((*y_ticks.places, *y_ticks.minor)))
    path = "".join(f"M{x:.1f},{bottom:.0f}V{top:.0f}" for x in across)
    path += "".join(f"M{left:.1f},{y:.1f}H{right:.1f}" for y in along)
    zero = ""
    if not y_axis.log and y_axis.low < 0 < y_axis.high:
        zero = f"M{left:.1f},{float(y_axis.at(np.zeros(1))[0]):.1f}H{right:.1f}"
    frame = f"M{left:.1f},{top:.0f}V{bottom:.0f}H{right:.1f}{zero}"
    return f'<path class="grid" d="{path}"/><path class="axis" d="{frame}"/>'


def _labels(words: tuple[str, str, str], x_axis: Axis, y_axis: Axis, x_ticks: Ticks, y_ticks: Ticks) -> str:
    """Return title, numbers at the ticks, and what is on the axes: the name of y stands above, where there is room."""
    title, x_label, y_label = words
    right, bottom = x_axis.last, y_axis.first
    parts = [f'<text class="title" x="2" y="14">{text(_short(title, 0.88 * right))}</text>']
    above = f"{y_label}  {y_ticks.note}".strip()
    parts.append(f'<text x="2" y="{14 + LINE}">{text(_short(above, right))}</text>')
    for x, label in zip(x_axis.at(np.array(x_ticks.places)), x_ticks.labels, strict=True):
        anchor, x = ("end", right + 8) if x + _wide(label) / 2 > right + 8 else ("middle", x)
        parts.append(f'<text x="{x:.1f}" y="{bottom + 16:.0f}" text-anchor="{anchor}">{label}</text>')
    for y, label in zip(y_axis.at(np.array(y_ticks.places)), y_ticks.labels, strict=True):
        parts.append(f'<text x="{x_axis.first - 6:.1f}" y="{y + 4.5:.1f}" text-anchor="end">{label}</text>')
    below = f"{x_label}  {x_ticks.note}".strip()
    below = text(_short(below, right))
    parts.append(f'<text x="{right:.1f}" y="{bottom + 16 + LINE:.0f}" text-anchor="end">{below}</text>')
    return "".join(parts)


def _legend(lines: Sequence[_Line], width: int) -> tuple[str, int]:
    """Return the legend, in as many rows as it needs, and where the chart begins below."""
    named = [line for line in lines if line.name]
    parts, x, y = [], 2.0, 14 + 2 * LINE
    for line in named:
        name = _short(line.name, width - SAMPLE - 8)
        wide = SAMPLE + _wide(name) + 14
        if x + wide > width + 10 and x > 2:
            x, y = 2.0, y + LINE
        parts.append(f'{_key(line, x, y - 4.5)}<text x="{x + SAMPLE:.1f}" y="{y}">{text(name)}</text>')
        x += wide
    return "".join(parts), y + 10 if named else LINE * 2 + 6


def _key(line: _Line, x: float, y: float) -> str:
    """Return what a curve looks like, in the legend."""
    kind = f'class="{_kind(line)} c{line.style}"'
    if line.kind == "band":
        return f'<path {kind} d="M{x:.1f},{y - 5}h20v10h-20Z"/>'
    if line.kind == "dots":
        return f'<path {kind} d="M{x + 4:.1f},{y}h0m6,0h0m6,0h0"/>'
    return f'<path {kind} d="M{x:.1f},{y}h20"/>'


def _wide(words: str) -> float:
    """Return about how wide a text is, in a font that is rather wide."""
    thin = sum(one in " .,:;'|()ijlI·/" for one in words)
    thick = sum(one in "mwMW@%…" or ord(one) > 0x2E80 for one in words)
    return 8.1 * len(words) - 3.8 * thin + 4.9 * thick + 0.9 * sum(map(str.isupper, words))


def _short(words: str, width: float) -> str:
    """Return a text that fits, its middle left out if need be."""
    words = " ".join(words.split())
    if _wide(words) <= width:
        return words
    half = len(words)
    while half > 1 and _wide(words[:half] + "…" + words[-half:]) > width:
        half -= max(half // 8, 1)
    return words[:half] + "…" + words[-half:]
