"""The error of differentiators against the time they take, as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from accuracy_peers import BANDWIDTH, NOTHING, OURS, TRUTH, TRUTH_0

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

COLORS = {NOTHING: "tab:blue", BANDWIDTH: "tab:orange", TRUTH_0: "tab:gray", TRUTH: "tab:gray"}
NAMES = {
    NOTHING: "told nothing",
    BANDWIDTH: f"told the {BANDWIDTH}",
    TRUTH_0: "told the truth",
    TRUTH: "told the truth",
}
PANELS = (("core", "RMSE on the core"), ("all", "RMSE over all samples"))
TOP = 0.6  # larger errors lie at the upper edge, with their number
TICKS = (0.03, 0.04, 0.05, 0.07, 0.1, 0.2, 0.3, 0.5)
REACHES = (8, 13, 19, 26, 34, 44, 56)  # points from a mark to its name
Box = tuple[float, float, float, float]
Point = tuple[dict[str, Any], float, float]


def draw(rows: Sequence[dict[str, Any]], header: dict[str, str], file: Path) -> None:
    """Draw the mean error against tuning and one signal, on the core above, over all samples below."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    picture, panels = plt.subplots(2, figsize=(10, 12), layout="constrained", sharex=True)
    shown: list[list[Point]] = [
        [(row, (row["tuning"] or 0.0) + row["call"], float(np.mean(row[key]))) for row in rows] for key, _ in PANELS
    ]
    for axes, points, (_, label) in zip(panels, shown, PANELS, strict=True):
        for row, elapsed, error in points:
            axes.plot(elapsed, min(error, TOP), **_style(row, error))
        times = [elapsed for _, elapsed, _ in points]
        lowest = min(error for _, _, error in points)
        axes.set(xscale="log", yscale="log", ylabel=label, ylim=(0.8 * lowest, 1.1 * TOP))
        axes.set_xlim(min(times) / 4, max(times) * 40)  # room for names on the right
        axes.set_yticks(TICKS, [str(tick) for tick in TICKS])
        axes.yaxis.minorticks_off()
        axes.grid(alpha=0.3)
    panels[1].set_xlabel("s, tuning and one signal of 1001 samples")
    title = "First derivative of the paper's first illustration, 25 dB, one thread"
    panels[0].set_title(f"{title}\n{header['processor']}, {header['date']}", fontsize=10)
    for name, style in {_legend(row): _style(row) for row in rows}.items():
        panels[0].plot([], [], label=name, **style)
    panels[0].legend(fontsize=9, loc="upper right")
    picture.canvas.draw()
    picture.set_layout_engine("none")  # names are placed in what has settled
    for axes, points in zip(panels, shown, strict=True):
        _label(axes, points)
    picture.savefig(file, dpi=150)


def _ours(row: dict[str, Any]) -> bool:
    return str(row["method"]).startswith(OURS)


def _legend(row: dict[str, Any]) -> str:
    return f"algdiff, {NAMES[row['told']]}" if _ours(row) else NAMES[row["told"]]


def _style(row: dict[str, Any], error: float = 0.0) -> dict[str, Any]:
    style: dict[str, Any] = {"color": COLORS[row["told"]], "marker": "o", "markersize": 6, "linestyle": ""}
    if _ours(row):
        style |= {"color": "tab:red", "marker": "*", "markersize": 15, "zorder": 3}
    if error > TOP:
        style |= {"marker": "^", "markersize": 8}
    return style | ({"fillstyle": "none"} if row["told"] in (TRUTH, TRUTH_0) else {})


def _label(axes: Any, points: list[Point]) -> None:
    """Write each name where it covers neither a mark nor another name, as near to its mark as there is room."""
    renderer = axes.figure.canvas.get_renderer()
    marks = [tuple(axes.transData.transform((elapsed, min(error, TOP)))) for _, elapsed, error in points]
    taken: list[Box] = [(x - 9, y - 9, x + 9, y + 9) for x, y in marks]
    if axes.get_legend() is not None:
        taken.append(_corners(axes.get_legend().get_window_extent(renderer)))
    inside = _corners(axes.get_window_extent(renderer))
    order = sorted(range(len(points)), key=lambda i: (not _ours(points[i][0]), _crowd(marks[i], marks)))
    for i in order:
        row, elapsed, error = points[i]
        name = row["method"] + (f" {error:.3g}" if error > TOP else "")
        text = axes.annotate(name, (elapsed, min(error, TOP)), xytext=(0, 0), **_lettering(row))
        choices = list(_choices(text, renderer, marks[i], taken, inside))
        _, _, offset, align, boxes = min(choices, key=lambda choice: choice[:2])
        text.set(position=offset, **align)
        taken += boxes


def _lettering(row: dict[str, Any]) -> dict[str, Any]:
    line = {"arrowstyle": "-", "linewidth": 0.5, "color": "gray", "shrinkA": 0, "shrinkB": 3}
    ours = {"fontsize": 11, "fontweight": "bold", "color": "tab:red"} if _ours(row) else {"fontsize": 8}
    return {"textcoords": "offset points", "arrowprops": line, **ours}


def _crowd(mark: Sequence[float], marks: Sequence[Sequence[float]]) -> int:
    """Return minus the number of marks that are near."""
    return -sum(abs(mark[0] - x) < 150 and abs(mark[1] - y) < 60 for x, y in marks)


def _choices(text: Any, renderer: Any, mark: Sequence[float], taken: list[Box], inside: Box) -> Iterator[Any]:
    """Yield places for a name: what they cost, and what the name and the line to its mark cover."""
    from matplotlib.text import Text

    for number, (offset, align) in enumerate(_offsets()):
        text.set(position=offset, **align)
        text.update_positions(renderer)
        box = _corners(Text.get_window_extent(text, renderer))  # that of an annotation has its line in it
        middle = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2  # where the line leads, from the edge of the mark
        along = [tuple(np.add(mark, share * np.subtract(middle, mark))) for share in np.linspace(0.2, 1, 20)]
        line: list[Box] = [(x - 1, y - 1, x + 1, y + 1) for x, y in along if not _within(x, y, box)]
        covered = sum(_overlap(box, other) for other in taken) + 20 * sum(_overlap(i, j) for i in line for j in taken)
        yield covered + 10 * _outside(box, inside) + number, number, offset, align, [box, *line]


def _offsets() -> Iterator[tuple[tuple[float, float], dict[str, str]]]:
    for reach in REACHES:
        yield (reach, 0.0), {"ha": "left", "va": "center"}
        yield (-reach, 0.0), {"ha": "right", "va": "center"}
        for up, va in ((reach, "bottom"), (-reach, "top")):
            for aside in (1.0, 0.5):
                yield (aside * reach, aside * up), {"ha": "left", "va": va}
                yield (-aside * reach, aside * up), {"ha": "right", "va": va}
            yield (0.0, up), {"ha": "center", "va": va}


def _corners(found: Any) -> Box:
    left, low, right, high = found.extents
    return left, low, right, high


def _within(x: float, y: float, box: Box) -> bool:
    return box[0] <= x <= box[2] and box[1] <= y <= box[3]


def _overlap(box: Box, other: Box) -> float:
    wide, high = min(box[2], other[2]) - max(box[0], other[0]), min(box[3], other[3]) - max(box[1], other[1])
    return max(wide, 0.0) * max(high, 0.0)


def _outside(box: Box, inside: Box) -> float:
    return (box[2] - box[0]) * (box[3] - box[1]) - _overlap(box, inside)
