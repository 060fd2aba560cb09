"""A suggestion in plain words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from algdiff._orders import highest

if TYPE_CHECKING:
    from algdiff._suggest.suggestion import Suggestion

UNEVEN = 2.0
"""Levels of noise that differ by more than this are said to change."""

FLAT = 1.1
"""Candidates that err by no more than this times the least are said to be as good."""


def explain(suggestion: Suggestion) -> str:
    """Return what was chosen and why."""
    design, curve = suggestion.differentiator, suggestion.curve
    lines = [
        f"A window of {design.window_length} samples ({design.duration:.4g}) and degree {design.degree}, for the "
        f"derivative of order {highest(design.deriv)}, {_where(suggestion)}.",
        f"It is expected to err by {suggestion.rmse:.3g} (root mean square): noise {suggestion.noise:.3g}, "
        f"bias {suggestion.bias:.3g}.",
        f"The noise in the samples is {suggestion.noise_level:.3g}{_colour(suggestion)}.",
    ]
    low, high = suggestion.noise_range
    if low > 0 and high > UNEVEN * low:
        lines.append(
            f"Its level changes from {low:.3g} to {high:.3g} along the samples; one window is a compromise, "
            "so consider local=True, or weights of 1 / level**2."
        )
    if suggestion.quantum:
        lines.append(
            f"The samples are multiples of {suggestion.quantum:.3g}: rounding alone is a noise of "
            f"{suggestion.quantum / 12**0.5:.3g}, and not a random one where the signal rests."
        )
    good = curve.rmse <= FLAT * curve.rmse.min()
    windows = curve.window_length[good & (curve.degree == design.degree)]
    if windows.size > 1:
        lines.append(
            f"At this degree, windows from {windows.min()} to {windows.max()} samples would do within "
            f"{100 * (FLAT - 1):.0f} percent as well in the middle."
        )
    finest = curve.window_length == curve.window_length.min()
    if design.window_length == curve.window_length.min() and bool(finest.any()):
        lines.append("It is the shortest one that was compared: the samples may be too far apart for the signal.")
    if suggestion.limits:
        lines.append(f"What was asked for: {', '.join(suggestion.limits)}.")
    return "\n".join(lines)


def _where(suggestion: Suggestion) -> str:
    design = suggestion.differentiator
    if suggestion.local:
        return "and windows about that one, shorter and longer, where the signal asks for them"
    if np.isclose(design.tau, 0.5):
        return "centered on the sample"
    return f"{design.delay:.4g} behind the newest sample"


def _colour(suggestion: Suggestion) -> str:
    if suggestion.correlation:
        return f", and coloured: neighbours correlate by {suggestion.correlation:.2f}"
    if suggestion.colour > 1:
        return f", at the scale of the window {suggestion.colour:.2g} times what it is from sample to sample"
    return ""
