"""The cost against the window, as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import targets
from common import COPY

if TYPE_CHECKING:
    from pathlib import Path

OURS = "algdiff"


def draw(windows: dict[int, dict[str, dict[str, Any]]], header: dict[str, str], file: Path) -> None:
    """Draw nanoseconds per sample, and copies on the right, for every engine and every peer."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    names = [name for name in next(iter(windows.values())) if name != COPY]
    copy = sum(entries[COPY]["ns"] for entries in windows.values()) / len(windows)
    picture, axes = plt.subplots(figsize=(9, 6), layout="constrained")
    for name in names:
        points = [(length, found[name]["ns"]) for length, found in windows.items() if found.get(name, {}).get("ns")]
        if not points:
            continue
        ours, engine = name == OURS, name.startswith("algdiff ")
        style: dict[str, Any] = (
            {"linewidth": 3.5, "color": "black", "alpha": 0.35} if ours else {"linewidth": 1.8 if engine else 1.0}
        )
        style |= {"linestyle": "-" if ours or engine else "--", "marker": "" if ours else "o" if engine else "."}
        axes.plot(*zip(*points, strict=True), label="algdiff, automatic" if ours else name, **style)
    axes.plot(list(windows), [entries[COPY]["ns"] for entries in windows.values()], color="gray", label=COPY)
    reached = sorted(set(windows) & set(targets.COPIES))
    marks = [targets.COPIES[length][0] * copy for length in reached]
    axes.plot(reached, marks, linestyle="", marker="_", markersize=14, color="red", label="target")
    axes.set(xscale="log", yscale="log", xlabel="window in samples", ylabel="ns per sample")
    right = axes.secondary_yaxis("right", functions=(lambda ns: ns / copy, lambda copies: copies * copy))
    right.set_ylabel("copies")
    axes.set_title(
        f"First derivative, degree 3, float64, one thread\n{header['processor']}, {header['date']}", fontsize=10
    )
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, ncols=2)
    picture.savefig(file, dpi=150)
