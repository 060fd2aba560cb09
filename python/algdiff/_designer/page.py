"""The page of ``algdiff designer``: its controls, and the places where figures and charts go."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from algdiff._designer.answers import FIGURES
from algdiff._designer.query import LONGEST, STEEPEST
from algdiff._pages import of_design
from algdiff._pages.document import page
from algdiff._pages.of_recording import HEADING, shortened
from algdiff._svg.chart import text

if TYPE_CHECKING:
    from algdiff._designer.recording import Recording

NAMES = {
    **of_design.NAMES,
    "delay_samples": "delay in samples",
    "exactness": "exact degree",
    "weight_count": "taps",
    "engine": "engine",
    "samples": "samples",
    "missing": "missing samples",
    "infinite": "infinite samples",
    "noise_level": "noise in the samples",
    "std": "output noise",
}
"""What the page calls the figures."""
FIRST = ("delay", "noise_gain", "cutoff", "half_power", "exactness", "std")
"""Figures that are looked at first."""
TABLES = (
    ("In time", ("duration", "delay_samples", "moment_delay", "tau", "delta", "fs")),
    ("Error and frequency", ("bias_order", "bias_constant", "bias_bound", "norm1", "nyquist_attenuation", "roll_off")),
    ("Weights and data", ("weight_count", "engine", "samples", "missing", "infinite", "noise_level")),
)
CHARTS = {
    "signal": "Signal",
    "derivative": "Derivative",
    "weights": "Weights",
    "response": "Frequency response",
    "step": "Response to a unit step",
    "delays": "What a shorter delay costs",
}
POINTS = {
    "center": "in the middle of the window",
    "root": "at a root: one more exact degree",
    "newest": "at the newest sample: no delay",
    "samples": "by its delay in samples",
    "time": "by its delay as a time",
}
"""Where in the window the estimate may lie."""
EXPORTS = {"json": "Design, JSON", "csv": "Weights, CSV", "c": "C header"}
ORDER, DEGREE = 4, 12
"""Ends of the sliders of order and degree."""
SLIDER = 20_001
"""The longest window on the slider."""


def document(recording: Recording, start: dict[str, Any], nonce: str) -> str:
    """Return the page about a recording, with the controls at a first design."""
    known = {
        "count": recording.count,
        "first": recording.first,
        "shown": recording.shown or recording.count,
        "delta": recording.delta,
        "longest": min(LONGEST, recording.count),
        "slider": min(SLIDER, recording.count),
        "start": start,
    }
    body = f"""<main class="page designer" id="designer" data-known="{text(json.dumps(known))}">
<header><p class="muted small">algdiff designer</p><h1>{text(recording.name)}</h1>
<p class="muted">{text(recording.note)}</p></header>
<div class="desk">
<form class="card controls" id="controls" autocomplete="off" aria-label="Controls">{_controls(recording, start)}</form>
<div class="shown" id="shown" aria-busy="true">
<div class="problem" id="problem" role="alert" hidden></div>
{_facts()}
<section class="warnings" id="warnings" role="status" aria-label="Warnings" hidden></section>
<div class="grid pair">{_figure("signal")}{_figure("derivative")}</div>
{_zoom(recording)}
<div class="grid pair">{"".join(map(_figure, ("weights", "response", "step", "delays")))}</div>
{_tables()}
{_keep()}
<p class="unseen" id="spoken" role="status" aria-live="polite"></p>
</div></div>
</main>"""
    script, style = ((files("algdiff._designer") / f"designer.{kind}").read_text("utf-8") for kind in ("js", "css"))
    return page(f"{recording.name} - algdiff designer", body, script, nonce, style)


def _controls(recording: Recording, start: dict[str, Any]) -> str:
    columns = "".join(
        f'<option value="{index}">{text(shortened(name, HEADING))}</option>'
        for index, name in enumerate(recording.columns)
    )
    points = "".join(f'<option value="{word}">{text(said)}</option>' for word, said in POINTS.items())
    lone = " hidden" if len(recording.columns) == 1 else ""
    delay = (
        f'<div class="control"><div class="head"><label for="point">point of the estimate</label>'
        f'<output id="delay-said" for="point delay"></output></div><select id="point">{points}</select>'
        '<div class="row"><input type="number" id="delay" step="any" aria-label="delay" aria-describedby="delay-error">'
        '<input type="range" id="delay-slider" min="0" max="100" aria-label="delay, in samples"></div>'
        f"{_error('delay')}</div>"
    )
    parts = [
        _control("deriv", "derivative order", start["deriv"], (0, ORDER, 1)),
        _control("window", "window in samples", start["window_length"], (0, 1, 1), said=True),
        _control("degree", "degree", start["degree"], (0, DEGREE, 1), said=True),
        delay,
        _control("kappa", "kappa: taper at the oldest end", start["kappa"], (-0.9, 6, 0.1), "any", most=STEEPEST),
        _control("mu", "mu: taper at the newest end", start["mu"], (-0.9, 6, 0.1), "any", most=STEEPEST),
    ]
    units = '<option value="fs">rate, Hz</option><option value="delta">step, s</option>'
    return "".join(
        (
            f'<div class="control"{lone}><div class="head"><label for="column">column</label></div>'
            f'<select id="column">{columns}</select></div>',
            f'<div class="control"><button type="button" id="choose">Choose from the data</button>{_error("data")}'
            '<div class="small muted" role="status"><p id="explanation"></p></div>'
            '<details class="small muted" id="more" hidden><summary>More about the choice</summary><p id="rest"></p>'
            "</details></div>",
            *parts,
            '<div class="control"><div class="head"><label for="step">sampling</label></div><div class="row">'
            '<input type="number" id="step" step="any" aria-describedby="step-error">'
            f'<select id="step-unit" aria-label="unit of the sampling">{units}</select></div>{_error("step")}</div>',
        )
    )


def _control(
    name: str,
    label: str,
    value: float,
    ends: tuple[float, float, float],
    step: str = "1",
    *,
    said: bool = False,
    most: float | None = None,
) -> str:
    """Return a number and its slider; what the number means stands at the right, if there is something to say."""
    low, high, stride = ends
    top = "" if most is None else f' max="{most:g}"'
    output = f'<output id="{name}-said" for="{name}"></output>' if said else ""
    return (
        f'<div class="control"><div class="head"><label for="{name}">{text(label)}</label>{output}</div>'
        f'<div class="row"><input type="number" id="{name}" value="{value:g}" step="{step}"{top} '
        f'aria-describedby="{name}-error"><input type="range" id="{name}-slider" min="{low}" max="{high}" '
        f'step="{stride}" value="{value:g}" aria-label="{text(label)}"></div>{_error(name)}</div>'
    )


def _error(name: str) -> str:
    return f'<p class="error" id="{name}-error" role="alert"></p>'


def _facts() -> str:
    boxes = (f"<div><dt>{text(NAMES[name])}</dt><dd>{_output(name)}</dd></div>" for name in FIRST)
    return f'<dl class="facts">{"".join(boxes)}</dl>'


def _output(name: str) -> str:
    return f'<output id="figure-{name}" data-figure="{name}">\N{HORIZONTAL ELLIPSIS}</output>'


def _figure(name: str) -> str:
    return f'<figure class="card chart-of" id="chart-{name}" aria-label="{text(CHARTS[name])}"></figure>'


def _zoom(recording: Recording) -> str:
    ends = (("from", "shown from", 0), ("to", "to", 1000))
    parts = (
        f'<div class="row"><label for="{name}">{label}</label><input type="number" id="{name}" step="any">'
        f'<input type="range" id="{name}-slider" min="0" max="1000" value="{value}" '
        f'aria-label="{label}, in thousandths of the recording"></div>'
        for name, label, value in ends
    )
    button = '<button type="button" class="plain" id="whole">Show all</button>'
    what = f"Stretch of {recording.name} that is shown"
    return (
        f'<div class="card zoom" role="group" aria-label="{text(what)}">{"".join(parts)}{button}{_error("from")}</div>'
    )


def _tables() -> str:
    parts = []
    for caption, names in TABLES:
        rows = "".join(
            f'<tr><th scope="row">{text(NAMES[name])}</th><td class="number">{_output(name)}</td></tr>'
            for name in names
        )
        parts.append(f'<div class="card scroll"><table><caption>{caption}</caption>{rows}</table></div>')
    return f'<div class="grid numbers">{"".join(parts)}</div>'


def _keep() -> str:
    links = "".join(
        f'<a class="button" id="export-{kind}" href="#" download>{text(label)}</a>' for kind, label in EXPORTS.items()
    )
    return (
        '<section class="card keep"><h2>Keep it</h2><pre><code id="python"></code></pre>'
        f'<p class="row"><button type="button" id="copy">Copy the Python line</button>{links}'
        '<span class="muted small" id="copied" role="status"></span></p></section>'
    )


_LEFT = {*FIGURES} - {*FIRST, *(name for _, names in TABLES for name in names)}
assert not _LEFT, f"figures without a place on the page: {_LEFT}"  # noqa: S101
