"""The latency of one sample against the window, as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pushes import C_FLOAT, EMPTY, FILTER, OURS, QUEUE, RECURSIVE, RING, RUST, C

if TYPE_CHECKING:
    from pathlib import Path

TICK = 10.0  # ns: what a clock can tell apart, roughly


def draw(lengths: dict[int, Any], limits: dict[int, float], header: dict[str, str], file: Path) -> None:
    """Draw the medians against the window, with bands up to the quantile that 1 in 1000 exceeds."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    styles: dict[str, dict[str, Any]] = {
        FILTER: {"color": "tab:brown", "linestyle": "--", "marker": "v"},
        QUEUE: {"color": "tab:purple", "linestyle": "--", "marker": "s"},
        RING: {"color": "tab:red", "linestyle": "--", "marker": "D"},
        OURS: {"color": "tab:blue", "linewidth": 3, "marker": "o", "label": "algdiff, Python"},
        RUST: {"color": "tab:orange", "linewidth": 2, "marker": "o"},
        C: {"color": "tab:green", "linewidth": 2, "marker": "o"},
        C_FLOAT: {"color": "gold", "linestyle": "--", "linewidth": 1.2, "marker": "."},
        RECURSIVE: {"color": "dimgray", "linestyle": ":", "marker": "x", "label": "recursive, order 1, in Python"},
        EMPTY: {"color": "black", "linestyle": ":", "marker": "+", "label": "abs(x), an empty call"},
    }
    picture, axes = plt.subplots(figsize=(9, 6), layout="constrained")
    for name, style in styles.items():
        points = [(length, *cuts(found[name])) for length, found in lengths.items() if name in found]
        if points:
            at, median, rare = np.maximum(np.array(points).T, TICK)
            axes.plot(at, median, **{"label": name, "markersize": 5, "linewidth": 1.2, **style})
            axes.fill_between(at, median, rare, color=style["color"], alpha=0.08, linewidth=0)
    dashes: dict[str, Any] = {"linestyle": "", "marker": "_", "markersize": 16, "color": "red"}
    axes.plot(list(limits), list(limits.values()), **dashes, label="target for Python")
    axes.set(xscale="log", yscale="log", xlabel="window in samples", ylabel="ns, median and band up to 99.9 %")
    axes.set_xticks(list(lengths), [str(length) for length in lengths])
    axes.xaxis.minorticks_off()
    title = "One sample at a time: first derivative, degree 3, no delay"
    axes.set_title(f"{title}\n{header['processor']}, {header['date']}", fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    picture.savefig(file, dpi=150)


def cuts(found: dict[str, float]) -> tuple[float, float]:
    """Return the line and the end of the band."""
    return found["median"], found["p999"]
