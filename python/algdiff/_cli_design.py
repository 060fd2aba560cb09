"""``algdiff design``: a window by what it is to do, as a table, JSON, a picture and a C header."""

from __future__ import annotations

import json
import os
import sys
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from algdiff import _units as units
from algdiff._cli import UsageError, add_design, design_by

if TYPE_CHECKING:
    import argparse

    from algdiff import Differentiator

PICTURES = (".png", ".pdf", ".svg")
DESIGN = """Choose a window by its length or by what it is to do, and print what it does to signal and noise. Numbers
may carry a unit: s, ms, us; Hz, kHz, rad/s. Without --fs or --delta the step is 1 and numbers have no unit."""


def add(verb: argparse.ArgumentParser) -> None:
    """Add the options of ``algdiff design``."""
    verb.description = DESIGN
    verb.set_defaults(verb=run)
    window = verb.add_mutually_exclusive_group(required=True)
    choose = window.add_argument
    choose("--window", type=int, metavar="N", help="the window in samples")
    choose("--duration", type=units.time, metavar="S", help="the window nearest to this long: 0.1s")
    choose("--cutoff", type=units.frequency, metavar="HZ", help="the window whose cutoff is nearest: 20Hz, 125rad/s")
    choose("--for-delay", type=units.time, metavar="S", help="the window whose delay, at its tau, is nearest: 50ms")
    choose("--notch", type=units.frequency, metavar="HZ", help="a window that annihilates this frequency: 50Hz")
    add_design(verb)
    option = verb.add_argument
    option("--json", action="store_true", help="print JSON, weights included, instead of the table")
    option("--plot", type=Path, metavar="FILE", help=f"draw the design on one page: {', '.join(PICTURES)}")
    option("--c", type=Path, metavar="FILE", help="write a C header that differentiates samples as they come")
    option("--name", metavar="NAME", help="what the names in the C header start with; default: differentiator")
    option("--float", action="store_true", help="let the C header compute in float, not in double")
    option("--overwrite", action="store_true", help="replace files that exist")


def run(options: argparse.Namespace) -> None:
    """Design, write the files, and print the table or JSON."""
    from algdiff import _output, _report

    form = _check_arguments(options)
    wanted = [path for path in (options.plot, options.c) if path is not None]
    for path in wanted:
        _output.check_output(path, options.overwrite)
    design = _design(options)
    contents = {}
    if options.c is not None:
        contents[options.c] = _header(design, options.name, "float32" if options.float else "float64")
    if options.plot is not None:
        contents[options.plot] = _picture(design, form)
    for path in wanted:
        with _output.replacing(path, options.overwrite) as file:
            file.write(contents[path])
        print(f"wrote {path}", file=sys.stderr)
    if options.json:
        print(json.dumps({**design.summary(), "weights": design.weights.tolist()}, indent=1, allow_nan=False))
    else:
        print(_report.table(design))


def _check_arguments(options: argparse.Namespace) -> str:
    """Return the format of the picture; raise UsageError for arguments that cannot be meant."""
    form = "" if options.plot is None else options.plot.suffix.lower()
    if options.plot is not None and form not in PICTURES:
        raise UsageError(f"--plot must be a .png, .pdf or .svg FILE, got {options.plot}")
    if None not in (options.for_delay, options.delay):
        raise UsageError(f"--delay must be left out with --for-delay, got {options.delay} and {options.for_delay}")
    if options.name is not None and options.c is None:
        raise UsageError(f"--name is for --c, got --name {options.name} alone")
    if options.float and options.c is None:
        raise UsageError("--float is for --c, got --float alone")
    if None not in (options.plot, options.c) and os.path.realpath(options.plot) == os.path.realpath(options.c):
        raise UsageError(f"--plot and --c must be different files, got {options.c} twice")
    return form.removeprefix(".")


def _design(options: argparse.Namespace) -> Differentiator:
    from algdiff import Differentiator

    makers: dict[str, Any] = {
        "window": Differentiator,
        "duration": Differentiator.from_duration,
        "cutoff": Differentiator.from_cutoff,
        "for_delay": Differentiator.from_delay,
        "notch": Differentiator.from_notch,
    }
    word = next(word for word in makers if getattr(options, word) is not None)
    target = getattr(options, word)
    make = partial(makers[word], unit="rad/s") if getattr(target, "unit", None) == "rad/s" else makers[word]
    return design_by(make, target, options)


def _header(design: Differentiator, name: str | None, dtype: str) -> bytes:
    try:
        return (design.to_c(dtype=dtype) if name is None else design.to_c(name, dtype)).encode()
    except ValueError as error:
        raise UsageError(f"--{error}") from None


def _picture(design: Differentiator, form: str) -> bytes:
    """Return the page as a file, drawn without a display."""
    from algdiff import _plot

    figure = _plot._matplotlib("matplotlib.figure").Figure(figsize=_plot.A4, layout="constrained")
    _plot.plot_design(design, figure)
    page = BytesIO()
    figure.savefig(page, format=form, dpi=110)
    return page.getvalue()
