"""A picture of a suggestion. Matplotlib is imported on use."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from algdiff._orders import highest
from algdiff._plot import _axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from algdiff._suggest.suggestion import Suggestion


def plot(suggestion: Suggestion, ax: Axes | None = None) -> Axes:
    """Draw the estimated errors of the candidates over their windows."""
    ax = _axes(ax)
    curve, design = suggestion.curve, suggestion.differentiator
    for place, degree in enumerate(np.unique(curve.degree)):
        mine = curve.degree == degree
        ax.loglog(curve.window_length[mine], curve.rmse[mine], color=f"C{place}", marker=".", label=f"degree {degree}")
    mine = curve.degree == design.degree
    if mine.any():
        length = curve.window_length[mine]
        ax.loglog(length, curve.noise[mine], color="0.4", linestyle="--", linewidth=1, label="its noise")
        biased = curve.bias[mine] > 0
        ax.loglog(length[biased], curve.bias[mine][biased], color="0.4", linestyle=":", linewidth=1, label="its bias")
    ax.plot(design.window_length, suggestion.rmse, "k*", markersize=14, label="chosen, ends included", zorder=5)
    low = 0.5 * min(float(curve.rmse.min()), suggestion.rmse)
    ax.set_ylim(low, max(float(curve.rmse.max()), 4 * low))
    ax.set(
        xlabel="window length, samples", ylabel=f"estimated error of the derivative of order {highest(design.deriv)}"
    )
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small")
    return ax
