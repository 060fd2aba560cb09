"""The report: one page that says what a design does, or what was done to a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from algdiff import _report as report
from algdiff._pages import of_design, of_recording
from algdiff._pages.document import page
from algdiff._pages.of_design import number
from algdiff._svg.chart import text

if TYPE_CHECKING:
    from algdiff import Differentiator, Suggestion
    from algdiff._pages.of_recording import Column

WIDE = (960, 330)
HALF = (560, 340)
NARROW = (380, 290)
"""Sizes of charts: over the whole page, over half of it, on a phone."""

Size = tuple[int, int]
Part = Callable[[Size], "str | None"]


@dataclass(frozen=True)
class Report:
    """What a page says.

    Attributes
    ----------
    name : str
        Of the file.
    version : str
        Of the package.
    design : Differentiator
        What it is about.
    python, shell : str
        What gives the same in Python, and on the command line.
    warnings : sequence of str
        What the user should know.
    columns : sequence of Column
        Of a recording: its rows of samples; none for a design.
    suggestion : Suggestion or None
        How the design was chosen, if it was.
    lead : str
        Of a recording: what was read.
    """

    name: str
    version: str
    design: Differentiator
    python: str
    shell: str
    warnings: Sequence[str] = ()
    columns: Sequence[Column] = ()
    suggestion: Suggestion | None = None
    lead: str = ""

    @cached_property
    def values(self) -> report.Summary:
        """The summary of the design, which takes long for a long window."""
        return report.summary(self.design)

    def html(self) -> str:
        """Return the page."""
        parts = [self.head(), *(self.section(one) for one in self.columns), self.about(), self.again()]
        kind = "recording" if self.columns else "design"
        foot = f"algdiff {self.version}; report of a {kind}. Nothing on this page was loaded from anywhere."
        body = "\n".join(parts)
        return page(
            f"{self.name} - algdiff report",
            f'<main class="page">\n{body}\n<footer class="muted small more"><p>{text(foot)}</p></footer>\n</main>',
        )

    def head(self) -> str:
        """Return the title, what it is about, the figures that are looked at first, and the warnings."""
        design = self.design
        window = f"{design.window_length} samples"
        window += "" if design.delta == 1 else f" ({self.said('duration')})"
        what = f"Derivative of order {design.deriv}" if design.deriv else "Smoothing"
        chosen = ", chosen from the data" if self.suggestion else ""
        lead = f"{what} by a polynomial of degree {design.degree} in a window of {window}{chosen}. {self.lead}"
        pairs = [
            ("delay", self.said("delay")),
            ("noise gain", self.said("noise_gain")),
            *((of_design.NAMES[name], self.said(name)) for name in ("cutoff", "half_power", "exactness")),
        ]
        if self.choice:
            error = f"{number(self.choice.rmse)} signal{of_recording.per(design)}"
            pairs.insert(0, ("expected error", error))
        listed = "".join(f"<li>{text(warning)}</li>" for warning in self.warnings)
        return (
            f'<header><p class="muted small">algdiff report</p><h1>{text(self.name)}</h1><p>{text(lead)}</p></header>\n'
            f"{of_design.facts(pairs)}"
            + (f'\n<section class="warnings" aria-label="Warnings"><ul>{listed}</ul></section>' if listed else "")
        )

    @property
    def choice(self) -> Suggestion | None:
        """How the design was chosen, unless every window would have done for constant samples."""
        alive = [one for one in self.columns if not one.dead]
        return None if alive and all(one.constant is not None for one in alive) else self.suggestion

    def said(self, name: str) -> str:
        """Return a quantity of the design with its unit."""
        return of_design.said(name, self.design, self.values)

    def section(self, one: Column) -> str:
        """Return what was done to one row of samples."""
        heading = f"<h2>{text(of_recording.shortened(one.name, of_recording.HEADING))}</h2>"
        if one.dead:
            return f"<section>{heading}\n<p>No sample is finite: nothing is drawn.</p>\n{self.numbers(one)}</section>"
        if one.constant is not None:
            heading += f"\n<p>Constant: every finite sample is {one.constant:.6g}.</p>"
        whole, parts = self.drawn(one)
        halves = "".join(figure(part, HALF) for part in parts)
        return (
            f'<section>{heading}\n<div class="grid">{"".join(figure(part, WIDE) for part in whole)}</div>\n'
            + (f'<div class="grid pair more">{halves}</div>\n' if halves else "")
            + f"{self.numbers(one)}</section>"
        )

    def drawn(self, one: Column) -> tuple[list[Part], list[Part]]:
        """Return the charts of a row over the whole page, and those over half of it."""
        design = self.design
        whole: list[Part] = [
            lambda size: of_recording.signal(one, design, size),
            lambda size: of_recording.derivative(one, design, size),
        ]
        parts: list[Part] = [
            lambda size: of_recording.histogram(one, size),
            lambda size: of_recording.spectrum(one, design, size),
        ]
        stretch = of_recording.closeup(one, design)
        if stretch is not None:
            near = stretch
            parts[:0] = [
                lambda size: of_recording.signal(one, design, size, near),
                lambda size: of_recording.derivative(one, design, size, near),
            ]
        return whole, parts

    def numbers(self, one: Column) -> str:
        """Return the numbers of a row of samples."""
        rows = [
            f'<tr><th scope="row">{text(name)}</th><td class="number" data-name="{key}">{report.shown(value)}</td>'
            f"<td>{text(unit)}</td></tr>"
            for key, name, value, unit in of_recording.numbers(one, self.design)
        ]
        half = -(-len(rows) // 2)
        tables = "".join(
            f'<div class="card scroll"><table>{"".join(some)}</table></div>' for some in (rows[:half], rows[half:])
        )
        return f'<div class="grid pair more">{tables}</div>'

    def about(self) -> str:
        """Return what the design does, and why it was chosen."""
        design, suggestion = self.design, self.choice
        makers = (of_design.weights, of_design.step, of_design.response, of_design.delays)
        halves = [figure(lambda size, make=make: make(design, size), HALF) for make in makers]  # type: ignore[misc]
        if suggestion is not None:
            halves.append(figure(lambda size: of_recording.risks(suggestion, size), HALF))
            why = "".join(f"<p>{text(line)}</p>" for line in suggestion.explain().splitlines())
            halves.append(f'<div class="card"><h3>Why this window</h3>{why}</div>')
        return (
            f'<section><h2>The design</h2>\n<div class="grid pair">{"".join(halves)}</div>\n'
            f'<div class="grid more">{of_design.tables(design, self.values)}</div></section>'
        )

    def again(self) -> str:
        """Return how to have the same again."""
        return (
            f'<section><h2>The same again</h2>\n<div class="card"><h3>In Python</h3><pre><code>{text(self.python)}'
            f"</code></pre><h3>On the command line</h3><pre><code>{text(self.shell)}</code></pre></div></section>"
        )


def figure(make: Part, size: Size) -> str:
    """Return a chart in two sizes, of which a page shows the one that fits it; nothing if there is none."""
    wide, narrow = make(size), make(NARROW)
    if wide is None or narrow is None:
        return ""
    kind = "half" if size == HALF else "whole"
    return (
        f'<figure class="card{" wide" if kind == "whole" else ""}"><div class="{kind} wide-only">{wide}</div>'
        f'<div class="{kind} narrow-only">{narrow}</div></figure>'
    )
