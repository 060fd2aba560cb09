"""``algdiff report``: a page that says what a design does, or what was done to a recording."""

from __future__ import annotations

import json
import os
import re
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from algdiff import _cli_auto
from algdiff import _formats as formats
from algdiff import _units as units
from algdiff._cli import UsageError, add_design, add_nan_policy, design_by
from algdiff._cli_run import add_reading, lasting, reading
from algdiff._pages import again
from algdiff._places import MEMORY

if TYPE_CHECKING:
    import argparse

    from algdiff import Differentiator, Suggestion
    from algdiff._arguments import Samples
    from algdiff._formats.base import Options, Source
    from algdiff._pages.loading import Loading
    from algdiff._pages.report import Report

COLUMNS = 8
"""Columns that get a section."""
LARGEST = 1 << 28
"""Bytes of a design, at most."""
DESIGN = ("window_length", "deriv", "degree", "kappa", "mu", "tau", "rule", "trim", "delta")
"""What of a design's JSON makes it again."""
REPORT = """Write one HTML page, which needs nothing else, about IN. A recording is differentiated, by a window that is
chosen from it if none is given, and shown with its derivative, error band, noise and spectrum. A design that algdiff
design --json has printed into a .json file is shown by what it does to signal and noise."""


def add(verb: argparse.ArgumentParser) -> None:
    """Add the options of ``algdiff report``."""
    verb.description = REPORT
    verb.set_defaults(verb=run, memory=MEMORY)
    option = verb.add_argument
    option("source", metavar="IN", help="a recording that algdiff run reads, or a .json file that holds a design")
    option("-o", "--output", type=Path, default=Path("report.html"), metavar="OUT", help="default: %(default)s")
    option("--overwrite", action="store_true", help="replace OUT if it exists")
    window = verb.add_mutually_exclusive_group()
    window.add_argument("--window", type=units.window, metavar="N", help="window in samples, or as a time: 101, 50ms")
    _cli_auto.add(window, verb)
    add_reading(verb)
    add_nan_policy(verb)
    add_design(verb, unstated="what IN states, or 1, with no unit")


def run(options: argparse.Namespace) -> None:
    """Read, compute, and write the page."""
    from algdiff import _output

    output = options.output
    if output.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--output must be a .html file, got {output}")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        _output.check_output(output, options.overwrite)
        made = _of_design(options) if options.source.lower().endswith(".json") else _of_recording(options)
    said = {str(one.message): one.message for one in caught}
    for message in said.values():
        warnings.warn(message, stacklevel=2)
    content = replace(made, warnings=(*made.warnings, *said)).html().encode()
    with _output.replacing(output, options.overwrite) as file:
        file.write(content)
    print(f"wrote {output}", file=sys.stderr)


def _of_design(options: argparse.Namespace) -> Report:
    """Return the report of a design in a file."""
    from algdiff import __version__
    from algdiff._pages.report import Report

    given = again.given(options)
    if given or options.auto:
        raise UsageError(f"{given[0] if given else '--auto'} is for a recording, got the design {options.source}")
    design = _design_of(options.source)
    python = f"import algdiff\n\nalgdiff.{design!r}"
    return Report(Path(options.source).name, __version__, design, python, again.command(options))


def _design_of(path: str) -> Differentiator:
    """Read a design that ``algdiff design --json`` has printed."""
    import numpy as np

    from algdiff import Differentiator

    if os.path.getsize(path) > LARGEST:
        raise ValueError(f"{path}: must be a design of at most {LARGEST} bytes, got {os.path.getsize(path)}")
    try:
        found = json.loads(Path(path).read_bytes())
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: must hold JSON, as algdiff design --json prints it ({error})") from None
    missing = [name for name in DESIGN if name not in found] if isinstance(found, dict) else list(DESIGN)
    if missing:
        raise ValueError(f"{path}: must hold a design, as algdiff design --json prints it; lacks {', '.join(missing)}")
    try:
        design = Differentiator(**{name: found[name] for name in DESIGN})
        weights = np.asarray(found.get("weights", design.weights), np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"{path}: holds no design: {error}") from None
    scale = float(np.abs(design.weights).max(initial=0.0))
    if weights.shape != design.weights.shape or not np.allclose(weights, design.weights, rtol=0, atol=1e-9 * scale):
        raise ValueError(f"{path}: its weights are not those of its arguments; was it changed by hand?")
    return design


class _Read(NamedTuple):
    """What of a recording is shown.

    Attributes
    ----------
    names : tuple of str
        What its rows are called.
    x : ndarray
        The rows, in double precision.
    first : int
        The number of their first sample.
    step : float or None
        The sampling step, if it is known.
    lead, left : str
        What was read; what was not, or "".
    python : Loading
        How they are had in Python.
    hint : str
        What to do if they are too few, or "".
    whole : int
        How many samples there are, shown or not.
    """

    names: tuple[str, ...]
    x: Samples
    first: int
    step: float | None
    lead: str
    left: str
    python: Loading
    hint: str
    whole: int


def _of_recording(options: argparse.Namespace) -> Report:
    """Return the report of a recording."""
    from algdiff import __version__
    from algdiff._pages.advice import advice
    from algdiff._pages.loading import check_samples
    from algdiff._pages.of_recording import column
    from algdiff._pages.report import Report

    options.auto = options.window is None
    how, step, place = _checked(options)
    with formats.open_source(place, replace(how, memory=options.memory)) as source:
        check_samples(source, options.source)
        read, chosen_from = _read(source, options, step)
    try:
        design, suggestion = _designed(options, read.step, chosen_from)
    except ValueError as error:
        said = str(error)
        if "samples to choose" not in said:
            raise
        raise ValueError(said + read.hint) from None
    _check_length(read, design, options)
    call = {"nan_policy": options.nan_policy}
    try:
        columns = [
            column(name, row, read.first, design, call, options.sigma)
            for name, row in zip(read.names, read.x, strict=True)
        ]
    except ValueError as error:
        raise ValueError(re.sub(r"^x\b", lambda _: options.source, str(error))) from None
    name = place.path.name + (f":{place.inner}" if place.inner else "")
    shell = f"{again.command(options)}\n{again.run_command(options, design)}"
    python = again.python_line(read.python, design, options)
    warned = [read.left] if read.left else []
    warned += advice(options, columns, suggestion, known=read.step is not None)
    return Report(name, __version__, design, python, shell, warned, columns, suggestion, read.lead)


def _check_length(read: _Read, design: Differentiator, options: argparse.Namespace) -> None:
    """Raise ValueError if a window holds more samples than are shown."""
    shown, window = read.x.shape[-1], design.window_length
    if read.whole < window:
        raise ValueError(f"{options.source}: must hold as many samples as the window, {window}, got {shown}{read.hint}")
    if shown < window:
        raise ValueError(
            f"{options.source}: the page shows {shown} samples, fewer than the window, {window}: "
            f"give a shorter one{'' if len(read.names) == 1 else ', or fewer --columns'}"
        )


def _designed(
    options: argparse.Namespace, step: float | None, chosen_from: Samples
) -> tuple[Differentiator, Suggestion | None]:
    """Return the design, and how it was chosen if it was."""
    from algdiff import Differentiator

    if not options.auto:
        make = Differentiator if isinstance(options.window, int) else lasting
        return design_by(make, options.window, options, step), None
    return _cli_auto.chosen(chosen_from, options, _cli_auto.wanted(options, step))


def _checked(options: argparse.Namespace) -> tuple[Options, float | None, formats.Located]:
    """Return how to read, the step that is given, and what; raise UsageError for what cannot be meant."""
    from algdiff import _arguments as arguments
    from algdiff import _file

    _cli_auto.check(options)
    how = reading(options)
    try:
        place = formats.located("src", options.source)
        if how.key is not None and place.form.name != "npz":
            raise ValueError(f"key is for a .npz file, got {place.given}")
        # Nothing is written: any other file will do.
        _file.check(place, formats.located("dst", f"{place.path}.npy"), how)
        given = (options.delta, options.fs) != (None, None)
        step = arguments.sampling_step(options.delta, options.fs) if given else None
    except (ValueError, TypeError) as error:
        # A design has a page, too.
        raise UsageError(
            re.sub(r"^(src: the suffix of .*) or (\.\w+), got", r"\1, \2 or .json, got", str(error))
        ) from None
    if given and how.time is not None:
        raise UsageError("give --time, --delta or --fs: got --time and another")
    return how, step, place


def _read(source: Source, options: argparse.Namespace, step: float | None) -> tuple[_Read, Samples]:
    """Return what is shown, and what a window is chosen from."""
    from algdiff._pages.loading import hint, loading, parted, shown

    part = shown(source, options.axis, COLUMNS)
    samples, channels, count = part.shape[part.axis], part.channels, len(part.rows)
    # What holds one signal may have a name for it.
    place = formats.located("src", options.source)
    alone = options.key or place.inner or "Signal"
    found = source.names or [f"channel {', '.join(map(str, row))}" if row else alone for row in part.rows]
    x, names = parted(part.read(source), [name.strip("/") or "Signal" for name in found[:count]])
    known = source.step_along(part.axis) if step is None else step
    lead = f"{samples} samples{f' in {channels} columns' if channels > 1 else ''}"
    lead += "." if known is None else f", {known:.6g} s apart."
    left = []
    if part.stop - part.start < samples:
        left.append(f"Shown are samples {part.start} to {part.stop - 1} of {samples}, a stretch in the middle.")
    if count < channels:
        left.append(f"Shown are the first {count} columns of {channels}; the rest is left out.")
    python = loading(place, source, part)
    read = _Read(names, x, part.start, known, lead, " ".join(left), python, hint(part), samples)
    return read, _cli_auto.Stretch.of(source, options.axis).read(source) if options.auto else x
