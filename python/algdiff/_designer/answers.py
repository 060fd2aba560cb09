"""What the designer page asks for: figures and charts of a design, of the data by it, and files to keep it."""

from __future__ import annotations

import json
import math
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from algdiff import _report as report
from algdiff._designer.query import LONGEST, Query, RefusedError, asked
from algdiff._designer.recording import thinned
from algdiff._differentiator import Differentiator
from algdiff._pages import of_design, of_recording

if TYPE_CHECKING:
    from algdiff._designer.recording import Recording

STEPS = ("delta", "fs")
"""Arguments that say the step."""
HEIGHT = 280
"""Of charts."""
KEPT = {"charts": 8, "column": 2}
"""Designs of which that is remembered: their charts, what they make of a column."""
WHOLE = 1e7
"""Whole numbers below this are shown with all their digits."""
FIGURES = (
    *("delay", "delay_samples", "noise_gain", "cutoff", "half_power", "exactness", "duration", "weight_count"),
    *("tau", "moment_delay", "norm1", "bias_order", "bias_constant", "bias_bound", "nyquist_attenuation"),
    *("roll_off", "delta", "fs", "engine"),
)
"""Figures of the design, in the order of the page."""
MADE: dict[str, Callable[[Differentiator], Any]] = {
    "weight_count": lambda design: design.weights.size,
    "roll_off": lambda design: 20 * design.kernel.roll_off,
}
"""Those that are no attributes."""

Size = tuple[int, int]


class Answers:
    """Computes what is asked about one recording, and remembers what the next question is likely to need again.

    Not for several threads at once.

    Parameters
    ----------
    recording : Recording
        The data.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self._held: OrderedDict[Any, Any] = OrderedDict()

    def answer(self, given: Mapping[str, str]) -> dict[str, Any]:
        """Return figures, charts and words about a design and about the data by it."""
        query = asked(given, self.recording)
        design, said = self._design(query)
        with _telling(query):
            return self._answered(query, design, said)

    def _answered(self, query: Query, design: Differentiator, said: list[str]) -> dict[str, Any]:
        charts = self._design_charts(design, (query.width, HEIGHT))
        values = figures(design)
        shown = {name: _said(value, of_design.pretty(report.unit(name, design))) for name, value in values.items()}
        data = self._data(query, design)
        values.update(data.figures)
        shown.update(data.shown)
        return {
            "figures": values,
            "shown": shown,
            "charts": {**charts, **data.charts},
            "python": python(design),
            "warnings": said,
            "words": {
                "window": shown["duration"],
                "delay": f"delay {shown['delay']}",
                "degree": f"exact to degree {design.exactness}",
            },
        }

    def suggestion(self, given: Mapping[str, str]) -> dict[str, Any]:
        """Return the design that is chosen from a column, for the order and at the step that are asked for."""
        from algdiff import suggest

        query = asked(given, self.recording)
        words: dict[str, Any] = {name: query.words[name] for name in STEPS if name in query.words}
        if self.recording.count > LONGEST:
            words["max_window"] = LONGEST
        try:
            found = suggest(self.recording.samples[query.column], query.words["deriv"], **words)
        except (ValueError, TypeError, OverflowError) as error:
            raise RefusedError(" ".join(str(error).split()), "data") from None
        design = found.differentiator
        chosen = {name: getattr(design, name) for name in ("window_length", "degree", "kappa", "mu")}
        return {"chosen": chosen, "explanation": found.explain().splitlines(), "rmse": found.rmse}

    @cached_property
    def start(self) -> dict[str, Any]:
        """What the controls say at first: the chosen design, or the library's defaults where none can be chosen."""
        words = {"delta": repr(self.recording.delta)}
        try:
            return {"deriv": 1, **self.suggestion(words)["chosen"]}
        except RefusedError:
            window = min(101, self.recording.count - 1 + self.recording.count % 2)
            return {"deriv": 1, "window_length": window, "degree": min(3, max(window - 1, 1)), "kappa": 1.0, "mu": 1.0}

    def export(self, kind: str, given: Mapping[str, str]) -> tuple[str, str, bytes]:
        """Return a file that keeps a design: its name, its type, its content."""
        query = asked(given, self.recording)
        design, _ = self._design(query)
        name, media, make = EXPORTS[kind]
        with _telling(query):
            return name, media, make(design).encode()

    def _design(self, query: Query) -> tuple[Differentiator, list[str]]:
        """Return the design and what the library warns of, or raise RefusedError."""
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                design = Differentiator(**query.words)
        except (ValueError, TypeError, OverflowError, MemoryError) as error:
            raise RefusedError.of(error) from None
        return design, list(dict.fromkeys(str(one.message) for one in caught))

    def _design_charts(self, design: Differentiator, size: Size) -> dict[str, str]:
        found: dict[str, str] = self._remembered(("charts", design, size), lambda: of_design.charts(design, size))
        return found

    def _data(self, query: Query, design: Differentiator) -> Data:
        """Return what is shown of the data."""
        column = self._column(query.column, design)
        drawn = thinned(query.start, query.stop, column.x, column.smooth, column.estimate, column.std)
        arrays = {name: getattr(column, name)[drawn] for name in ("t", "x", "smooth", "estimate", "std")}
        part, size = column._replace(**arrays), (query.width, HEIGHT)
        values = {
            "samples": column.x.size,
            "missing": self.recording.missing(query.column),
            "infinite": self.recording.infinite(query.column),
            "noise_level": report.plain(column.sigma),
            "std": report.plain(column.sigma * math.sqrt(design.noise_gain)),
        }
        unit = {"std": of_design.pretty(report.power(design, -design.deriv))}
        shown = {name: _said(value, unit.get(name, "")) for name, value in values.items()}
        charts = {
            "signal": of_recording.signal(part, design, size),
            "derivative": of_recording.derivative(part, design, size),
        }
        return Data(values, shown, charts)

    def _column(self, index: int, design: Differentiator) -> of_recording.Column:
        """Return a column as the design differentiates it."""
        recording = self.recording
        x = recording.samples[index]
        if x.size < design.weights.size:
            window = f"window_length must be at most the {x.size} samples of the data, got {design.weights.size}"
            raise RefusedError(window, "window")
        if not np.isfinite(x).any():
            raise RefusedError("x must hold samples that are finite, got none: choose another column", "data")
        key = ("column", index, design)
        found: of_recording.Column = self._remembered(key, lambda: self._differentiated(index, design))
        return found

    def _differentiated(self, index: int, design: Differentiator) -> of_recording.Column:
        recording = self.recording
        call: dict[str, Any] = {"nan_policy": "omit"} if recording.missing(index) else {}
        name, x, noise = recording.columns[index], recording.samples[index], recording.noise(index)
        try:
            return of_recording.column(name, x, recording.first, design, call, noise)
        except (ValueError, TypeError, OverflowError, MemoryError) as error:
            raise RefusedError.of(error) from None

    def _remembered(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return what was made for a key, and forget what was not asked for of late."""
        if key not in self._held:
            self._held[key] = make()
            limit = KEPT[key[0]]
            of_kind = [other for other in self._held if other[0] == key[0]]
            for other in of_kind[:-limit]:
                del self._held[other]
        self._held.move_to_end(key)
        return self._held[key]


@contextmanager
def _telling(query: Query) -> Iterator[None]:
    """Refuse a step of which the figures are out of range, though the design is not."""
    try:
        with np.errstate(all="ignore"):
            yield
    except OverflowError:
        name, order = "fs" if "fs" in query.words else "delta", query.words["deriv"]
        got = f"{query.words.get(name, 1.0):g}"
        raise RefusedError(
            f"{name} must be such that the figures of order {order} do not overflow or underflow, got {got}", "step"
        ) from None


class Data(NamedTuple):
    """Figures and charts of the data."""

    figures: dict[str, Any]
    shown: dict[str, str]
    charts: dict[str, str]


def figures(design: Differentiator) -> dict[str, str | int | float | None]:
    """Return the figures of a design as JSON can hold them: those of its summary that cost little, and its engine."""
    return {name: report.plain(MADE[name](design) if name in MADE else getattr(design, name)) for name in FIGURES}


def _said(value: str | float | None, unit: str) -> str:
    """Return a figure to four digits with its unit; counts and other whole numbers whole."""
    if value is None:
        return "none"
    whole = not isinstance(value, str) and value == round(value) and abs(value) < WHOLE
    return f"{f'{value:,.0f}' if whole else of_design.number(value)} {unit.strip()}".strip()


def python(design: Differentiator) -> str:
    """Return the expression that makes the design."""
    given = design._asked
    words = [repr(given["window_length"]), f"deriv={given['deriv']!r}"]
    words += [
        f"{name}={given[name]!r}"
        for name in ("degree", "kappa", "mu", "tau", "delay", "delta")
        if given[name] is not None
    ]
    return f"algdiff.Differentiator({', '.join(words)})"


def as_json(design: Differentiator) -> str:
    """Return what ``algdiff design --json`` prints."""
    return json.dumps({**design.summary(), "weights": design.weights.tolist()}, indent=1, allow_nan=False) + "\n"


def as_csv(design: Differentiator) -> str:
    """Return the weights as a table with the times of their samples, 0 being that of the newest."""
    count = design.weights.size
    rows = (
        f"{design.delta * (index + 1 - count)!r},{weight!r}" for index, weight in enumerate(design.weights.tolist())
    )
    return "\n".join(("time,weight", *rows, ""))


EXPORTS: dict[str, tuple[str, str, Callable[[Differentiator], str]]] = {
    "json": ("algdiff-design.json", "application/json", as_json),
    "csv": ("algdiff-weights.csv", "text/csv; charset=utf-8", as_csv),
    "c": ("differentiator.h", "text/x-c; charset=utf-8", lambda design: design.to_c()),
}
"""Files by kind: name, type, content."""
