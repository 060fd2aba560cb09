"""What a design does, in charts and as a table, for pages."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from algdiff import _report as report
from algdiff._kernel import Kernel
from algdiff._svg.axes import RAISED
from algdiff._svg.chart import Curve, Mark, chart, text

if TYPE_CHECKING:
    from algdiff import Differentiator

Floats = NDArray[np.float64]

SMALL = (380, 290)
"""The size of charts that stand side by side."""
DOTTED = 120
"""More weights than this are drawn as a line."""
FLOOR = 1e-6
"""Amplitudes below this share of the largest are left out of the chart."""
POINTS = 97
"""Points of estimation that are compared."""

NAMES = {
    "window_length": "window",
    "weight_count": "weights",
    "deriv": "derivative order",
    "degree": "degree",
    "kappa": "kappa (oldest end)",
    "mu": "mu (newest end)",
    "tau": "tau",
    "rule": "rule",
    "trim": "trim",
    "delta": "step",
    "fs": "sampling rate",
    "duration": "duration",
    "delay": "delay",
    "delay_samples": "delay",
    "moment_delay": "delay at low frequencies",
    "exactness": "exact to degree",
    "noise_gain": "noise gain",
    "norm1": "sum of the weights' sizes",
    "bias_order": "bias order",
    "bias_constant": "bias constant",
    "bias_bound": "bias bound",
    "cutoff": "cutoff",
    "half_power": "\N{MINUS SIGN}3 dB point",
    "roll_off": "roll-off",
    "nyquist_attenuation": "attenuation at Nyquist",
    "discretisation_error": "discretisation error",
}
"""What a page calls the quantities of the summary."""
GROUPS = (
    ("Design", ("window_length", "weight_count", "deriv", "degree", "kappa", "mu", "tau", "rule", "trim")),
    ("In time", ("delta", "fs", "duration", "delay", "delay_samples", "moment_delay", "noise_gain", "norm1")),
    (
        "Error and frequency",
        (
            *("exactness", "bias_order", "bias_constant", "bias_bound"),
            *("cutoff", "half_power", "roll_off", "nyquist_attenuation", "discretisation_error"),
        ),
    ),
)
"""The tables they stand in."""


def charts(design: Differentiator, size: tuple[int, int] = SMALL) -> dict[str, str]:
    """Return the charts of a design by name: weights, step, response, delays."""
    makers = {"weights": weights, "step": step, "response": response, "delays": delays}
    return {name: make(design, size) for name, make in makers.items()}


def weights(design: Differentiator, size: tuple[int, int] = SMALL) -> str:
    """Return the weights over the kernel, scaled to the share of a sample."""
    share = design.delta / design.duration / design.duration**design.deriv
    points = np.concatenate(([0.0], (np.arange(500) + 0.5) / 500, [1.0]))
    times = (points - design.tau) * design.duration - design.delay
    count = design.weights.size
    unit = report.time_units(design)[0]
    return chart(
        [
            Curve("kernel", times, share * design.kernel(points), style=7),
            Curve(
                "weights",
                design.delta * np.arange(1 - count, 1),
                design.weights,
                kind="dots" if count <= DOTTED else "line",
                style=0,
            ),
        ],
        title="Weights",
        x_label=f"time from the newest sample, {unit}",
        y_label=with_unit("weight", design),
        marks=[Mark(f"delay {number(design.delay)} {unit}", -design.delay, style=3)],
        size=size,
    )


def step(design: Differentiator, size: tuple[int, int] = SMALL) -> str:
    """Return the response to a unit step."""
    count = design.weights.size
    index = np.unique(np.linspace(-2, count + 1, min(count + 4, 4096)).round())
    times = design.delta * index
    unit = report.time_units(design)[0]
    return chart(
        [Curve("response", times, design.step_response(times), kind="steps" if count <= 512 else "line", style=0)],
        title="Response to a unit step",
        x_label=f"time since the step, {unit}",
        y_label=with_unit("estimate", design),
        marks=[Mark(f"delay {number(design.delay)} {unit}", design.delay, style=3)],
        size=size,
    )


def response(design: Differentiator, size: tuple[int, int] = SMALL) -> str:
    """Return how strongly the design passes each frequency, up to half the sampling rate."""
    nyquist = 0.5 * design.fs
    lowest = min(0.05 / design.duration, 0.1 * nyquist)
    lobes = np.linspace(lowest, nyquist, min(16 * design.weights.size, 4096))
    frequency = np.union1d(np.geomspace(lowest, nyquist, 256), lobes)
    amplitude = np.abs(design.frequency_response(frequency))
    ideal = (2 * math.pi * frequency) ** design.deriv
    top = float(amplitude.max() or ideal.max())
    upper = design.asymptotes(frequency[-1:]).upper[-1]
    floor = min(0.3 * ideal[0], 0.3 * amplitude[0], 0.03 * np.nan_to_num(upper, posinf=top))
    unit = report.time_units(design)[1]
    found = (("cutoff", design.cutoff, 3), (NAMES["half_power"], design.half_power, 4), ("Nyquist", nyquist, 2))
    marks = [
        Mark(f"{name.removesuffix(' point')} {number(place)}", place, style)
        for name, place, style in found
        if place is not None and place <= nyquist
    ]
    return chart(
        [Curve("ideal", frequency, ideal, style=1), Curve("weights", frequency, amplitude, style=0)],
        title="Frequency response",
        x_label=f"frequency, {unit}",
        y_label=with_unit("amplitude", design),
        log_x=True,
        log_y=True,
        marks=marks,
        size=size,
        x_range=(lowest, 1.1 * nyquist),
        y_range=(max(FLOOR * top, float(floor)), 3 * top),
    )


def delays(design: Differentiator, size: tuple[int, int] = SMALL) -> str:
    """Return what each delay costs: the noise of the estimate with the same window and another point of estimation."""
    points = np.linspace(0.5, 1.0, POINTS)
    powers = -design.deriv - 0.5
    level = [
        math.sqrt(design.delta * Kernel(design.deriv, design.degree, design.kappa, design.mu, point).norm2)
        * design.duration**powers
        for point in points
    ]
    end = (1 - design.tau) * design.duration - design.delay
    unit = report.time_units(design)[0]
    own = Curve("this design", [design.delay], [math.sqrt(design.noise_gain)], kind="dots", style=3)
    return chart(
        [Curve("same window, other tau", (1 - points) * design.duration - end, level, style=0), own],
        title="What a shorter delay costs",
        x_label=f"delay, {unit}",
        y_label=with_unit("noise of the estimate over that of a sample", design),
        log_y=True,
        size=size,
        x_range=(
            -end - 0.02 * design.duration,
            max(0.5 * design.duration - end, design.delay) + 0.02 * design.duration,
        ),
    )


def tables(design: Differentiator, values: report.Summary) -> str:
    """Return the summary as tables side by side: what it is, its value to six digits, its unit."""
    twice = {"delay_samples"} if design.delta == 1 else {}
    parts = []
    for caption, names in GROUPS:
        rows = "".join(_row(name, values[name], design) for name in names if name not in twice)
        parts.append(f'<div class="card scroll"><table><caption>{caption}</caption>{rows}</table></div>')
    return "".join(parts)


def _row(name: str, value: str | float | None, design: Differentiator) -> str:
    unit = pretty(report.unit(name, design))
    shown = f'<td class="number" data-name="{name}">{report.shown(value)}</td>'
    return f'<tr><th scope="row">{NAMES[name]}</th>{shown}<td>{unit}</td></tr>'


def facts(pairs: list[tuple[str, str]]) -> str:
    """Return the figures that are looked at first: names and values."""
    # A narrow box breaks before the longest unit, and a very narrow one where that may be broken.
    unit = '<span class="unit">cycles/<wbr>sample</span>'
    boxes = "".join(
        f"<div><dt>{text(name)}</dt><dd>{text(value).replace('cycles/sample', unit)}</dd></div>"
        for name, value in pairs
    )
    return f'<dl class="facts">{boxes}</dl>'


def said(name: str, design: Differentiator, values: report.Summary) -> str:
    """Return a quantity of the summary with its unit, to four digits."""
    value = values[name]
    if value is None:
        return "none"
    return f"{number(value)} {pretty(report.unit(name, design))}".strip()


def number(value: float | str) -> str:
    """Return a number to four digits, with a power of ten instead of an exponent."""
    if isinstance(value, str):
        return value
    shown = f"{value:.4g}"
    digits, _, power = shown.partition("e")
    if power:
        shown = f"{digits}\N{MULTIPLICATION SIGN}10{str(int(power)).translate(RAISED)}"
    return ("\N{MINUS SIGN}" + shown[1:]) if shown.startswith("-") else shown


def with_unit(name: str, design: Differentiator, signal: str = "") -> str:
    """Return a label with the unit of the estimate per unit of the signal."""
    unit = pretty(report.power(design, -design.deriv))
    if signal:
        unit = f"{signal}{unit.removeprefix('1')}" if unit.startswith("1") else f"{signal} {unit}".strip()
    return f"{name}, {unit}" if unit else name


def pretty(unit: str) -> str:
    """Return a unit with its powers raised: 1/s instead of s^-1 is left."""
    return re.sub(r"\^(-?\d+)", lambda found: found[1].translate(RAISED), unit)
