"""What was done to a recording, in charts and numbers, for pages."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff import _report as report
from algdiff._pages.of_design import number, pretty
from algdiff._svg.chart import Curve, Mark, chart

if TYPE_CHECKING:
    from algdiff import Differentiator, Suggestion

Floats = NDArray[np.float64]

SEGMENT = 4096
"""Samples of one spectrum, at most; a longer recording gives several, whose mean is drawn."""
LEAST = 64
"""Samples of a spectrum, and of a close-up, at least."""
DOTTED = 400
"""Samples that are drawn as dots, at most."""
NAME, HEADING = 40, 120
"""Characters of a name at an axis, and in a heading, at most."""
BINS = 40
"""Bars of a histogram, from -4 to 4 standard deviations."""


class Column(NamedTuple):
    """One row of samples, and what a design makes of it.

    Attributes
    ----------
    name : str
        What it is called.
    t, x : ndarray
        Times and samples.
    sigma : float
        Level of the noise in the samples; NaN if it is not known.
    smooth, estimate, std : ndarray
        The signal by the same window, the estimates, their standard deviations.
    given : bool
        Whether the level was given, not found.
    """

    name: str
    t: Floats
    x: Floats
    sigma: float
    smooth: Floats
    estimate: Floats
    std: Floats
    given: bool = False

    @property
    def label(self) -> str:
        """The name as it stands at an axis."""
        return "signal" if self.name == "Signal" else shortened(self.name)

    @property
    def missing(self) -> int:
        """How many samples are missing."""
        return int(np.isnan(self.x).sum())

    @property
    def infinite(self) -> int:
        """How many are infinite."""
        return int(np.isinf(self.x).sum())

    @property
    def dead(self) -> bool:
        """Whether no sample is finite."""
        return not np.isfinite(self.x).any()

    @property
    def constant(self) -> float | None:
        """What all finite samples are equal to, if they are; None of fewer than two."""
        there = self.x[np.isfinite(self.x)]
        return float(there[0]) if there.size > 1 and bool((there == there[0]).all()) else None

    @property
    def rest(self) -> Floats:
        """What the smoothing takes away."""
        with np.errstate(invalid="ignore", over="ignore"):
            return self.x - self.smooth


def shortened(name: str, most: int = NAME) -> str:
    """Return a name of at most so many characters: the middle of a longer one is left out."""
    half = (most - 1) // 2
    return name if len(name) <= most else f"{name[:half]}\N{HORIZONTAL ELLIPSIS}{name[-half:]}"


def column(
    name: str, x: Floats, first: int, design: Differentiator, call: dict[str, Any], sigma: float | None = None
) -> Column:
    """Differentiate samples, the first of which is the `first` of its recording; find the noise if it is not given."""
    from algdiff import noise_level

    t = design.delta * np.arange(first, first + x.size, dtype=np.float64)
    given = sigma is not None
    sigma = float(noise_level(x)) if sigma is None else sigma
    if not np.isfinite(x).any() and call.get("nan_policy") != "raise":
        nothing = np.full(x.size, np.nan)
        return Column(name, t, x, sigma, nothing, nothing, nothing, given)
    known = sigma if math.isfinite(sigma) else 0.0
    with np.errstate(all="ignore"):
        estimate, std = _estimated(x, known, design, call)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the design itself has warned
            smoother = design.replace(deriv=0, degree=design.degree, tau=design.tau, rule="exact", trim=0.0)
        smooth = estimate if smoother == design else smoother(x, **call)
        return Column(name, t, x, sigma, smooth, estimate, std, given)


def _estimated(x: Floats, sigma: float, design: Differentiator, call: dict[str, Any]) -> tuple[Floats, Floats]:
    """Return estimates and their standard deviations; those at the ends are known for the rule "exact" only."""
    if design.rule == "exact":
        found = design(x, return_std=True, sigma=sigma, **call)
        return found.estimate, found.std
    estimate = design(x, **call)
    plan = design._plan
    start = np.arange(x.size) - plan.aligned_position
    inside = (start >= 0) & (start + plan.span <= x.size) & np.isfinite(estimate)
    return estimate, np.where(inside, sigma * math.sqrt(design.noise_gain), np.nan)


def signal(one: Column, design: Differentiator, size: tuple[int, int], part: slice = slice(None)) -> str:
    """Return samples and smoothed signal, all of them or a part."""
    count = one.x[part].size
    kind = "dots" if count <= DOTTED else "line"
    return chart(
        [
            Curve("samples", one.t[part], one.x[part], kind=kind, style=7),
            Curve("smoothed by the same window", one.t[part], one.smooth[part], style=0),
        ],
        title="Signal" if part == slice(None) else "Close-up: where the two differ most",
        x_label=f"time, {report.time_units(design)[0]}",
        y_label=one.label,
        size=size,
    )


def derivative(one: Column, design: Differentiator, size: tuple[int, int], part: slice = slice(None)) -> str:
    """Return the estimates in their error band, all of them or a part."""
    order = f"Derivative of order {design.deriv}" if design.deriv else "Smoothed signal"
    y, width = one.estimate[part], 2 * one.std[part]
    return chart(
        [
            Curve("\N{PLUS-MINUS SIGN}2 standard deviations", one.t[part], None, "band", y - width, y + width, style=0),
            Curve("estimate", one.t[part], y, style=0),
        ],
        title=order if part == slice(None) else f"The same stretch: {order[0].lower()}{order[1:]}",
        x_label=f"time, {report.time_units(design)[0]}",
        y_label=f"signal{per(design)}",
        size=size,
    )


def closeup(one: Column, design: Differentiator) -> slice | None:
    """Return the stretch, some windows long, where the samples lie farthest from the smoothed signal."""
    length = max(min(4 * design.window_length, DOTTED), LEAST)
    rest = np.nan_to_num(one.rest, posinf=0.0, neginf=0.0)
    if one.constant is not None:
        return None
    squares = (rest / max(float(np.abs(rest).max(initial=0.0)), 1e-300)) ** 2
    if squares.size < 3 * length or not squares.any():
        return None
    sums = np.concatenate(([0.0], np.cumsum(squares)))
    first = int(np.argmax(sums[length:] - sums[:-length]))
    # Many stretches hold a lone outlier: take the one that has it in its middle.
    middle = first + int(np.argmax(squares[first : first + length]))
    first = min(max(middle - length // 2, 0), squares.size - length)
    return slice(first, first + length)


def histogram(one: Column, size: tuple[int, int]) -> str | None:
    """Return the distribution of what is left of the samples, beside that of normal noise of the level found."""
    rest = one.rest[np.isfinite(one.rest)]
    if not rest.size or not one.sigma > 0 or one.constant is not None:
        return None
    edges = np.linspace(-4, 4, BINS + 1)
    shares = np.histogram(np.clip(rest / one.sigma, -4, 4), edges)[0] / (rest.size * (edges[1] - edges[0]))
    points = np.linspace(-4, 4, 161)
    return chart(
        [
            Curve("samples less smoothed", edges, [*shares, shares[-1]], kind="steps", style=2),
            Curve("normal noise", points, np.exp(-(points**2) / 2) / math.sqrt(2 * math.pi), style=1),
        ],
        title="What is left",
        x_label="in standard deviations of the noise",
        y_label="density",
        size=size,
    )


def spectrum(one: Column, design: Differentiator, size: tuple[int, int]) -> str | None:
    """Return the spectrum of the samples, the noise that was found, and where the design cuts."""
    length = 1 << int(math.log2(min(SEGMENT, max(one.x.size, 1))))
    while length >= LEAST and not (found := _segments(one.x, length)).size:
        length //= 2
    if length < LEAST or one.constant is not None:
        return None
    taper = 0.5 - 0.5 * np.cos(2 * math.pi * (np.arange(length) + 0.5) / length)
    power = np.zeros(length // 2)
    scale = max(float(np.abs(found).max()), 1e-300)
    for part in found:
        bare = part / scale - (part / scale).mean()
        power += np.abs(np.fft.rfft(bare * taper)[1 : length // 2 + 1]) ** 2 / len(found)
    density = scale * np.sqrt(2 * design.delta * power / (taper @ taper))
    frequency = np.arange(1, length // 2 + 1) / (length * design.delta)
    curves = [Curve("samples", frequency, density, style=0)]
    if one.sigma > 0:
        level = one.sigma * math.sqrt(2 * design.delta)
        curves.append(
            Curve(f"noise {'given' if one.given else 'found'}", [frequency[0], frequency[-1]], [level, level], style=1)
        )
    places = (("cutoff", design.cutoff, 3), ("\N{MINUS SIGN}3 dB", design.half_power, 4))
    unit = report.time_units(design)[1]
    return chart(
        curves,
        title="Spectrum",
        x_label=f"frequency, {unit}",
        y_label="amplitude density, signal/\N{SQUARE ROOT}" + (f"({unit})" if "/" in unit else unit),
        log_x=True,
        log_y=True,
        marks=[Mark(f"{name} {number(place)}", place, style) for name, place, style in places if place is not None],
        size=size,
        x_range=(frequency[0], frequency[-1]),
    )


def _segments(x: Floats, length: int) -> Floats:
    """Return stretches of samples of which none is missing, side by side or half over one another."""
    starts = np.arange(0, x.size - length + 1, max(length // 2, 1))
    missing = np.concatenate(([0], np.cumsum(~np.isfinite(x))))
    whole = starts[missing[starts + length] == missing[starts]]
    segments: Floats = np.lib.stride_tricks.sliding_window_view(x, length)[whole]
    return segments


def risks(suggestion: Suggestion, size: tuple[int, int]) -> str:
    """Return the estimated errors of the candidates over their windows."""
    curve, design = suggestion.curve, suggestion.differentiator
    curves = []
    for place, degree in enumerate(np.unique(curve.degree)):
        mine = curve.degree == degree
        own = degree == design.degree
        style = 0 if own else (1, 2, 3, 4, 5, 6)[place % 6]
        curves.append(Curve(f"degree {degree}", curve.window_length[mine], curve.rmse[mine], style=style))
        if own:
            curves.append(Curve("its noise", curve.window_length[mine], curve.noise[mine], style=7))
    curves.append(Curve("chosen, ends included", [design.window_length], [suggestion.rmse], "dots", style=3))
    low = 0.5 * min(float(curve.rmse.min()), suggestion.rmse)
    return chart(
        curves,
        title="Expected error of every candidate",
        x_label="window, samples",
        y_label=f"root-mean-square error, signal{per(design)}",
        log_x=True,
        log_y=True,
        size=size,
        y_range=(low, max(min(float(curve.rmse.max()), 1e3 * low), 4 * low)),
    )


def numbers(one: Column, design: Differentiator) -> list[tuple[str, str, float | int | None, str]]:
    """Return what there is to say of a column: a key, what it is called, its value, its unit."""
    unit = f"signal{per(design)}"
    rest, estimate, std = (part[np.isfinite(part)] for part in (one.rest, one.estimate, one.std))
    least, largest = (float(estimate.min()), float(estimate.max())) if estimate.size else (math.nan, math.nan)
    found = [
        ("samples", "samples", one.x.size, ""),
        ("missing", "missing samples", one.missing, ""),
        ("infinite", "infinite samples", one.infinite, ""),
        ("noise_level", f"noise level, {'given' if one.given else 'found'}", one.sigma, "signal"),
        ("rest", "root mean square of what is left", _rms(rest), "signal"),
        ("std", "standard deviation of the estimate", float(np.median(std)) if std.size else math.nan, unit),
        ("least", "least estimate", least, unit),
        ("largest", "largest estimate", largest, unit),
        ("without", "samples without an estimate", int(one.estimate.size - estimate.size), ""),
    ]
    return [(key, name, value if math.isfinite(value) else None, of) for key, name, value, of in found]


def _rms(values: Floats) -> float:
    scale = float(np.abs(values).max(initial=0.0))
    return scale * math.sqrt(float(np.mean((values / scale) ** 2))) if scale else 0.0 if values.size else math.nan


def per(design: Differentiator) -> str:
    """Return what follows the unit of the signal in that of the derivative: " per s²"."""
    if not design.deriv:
        return ""
    time = "sample" if design.delta == 1 else "s"
    return f" per {time}" + pretty(f"^{design.deriv}" if design.deriv > 1 else "")
