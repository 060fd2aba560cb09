"""``algdiff run``: a file differentiated into another."""

from __future__ import annotations

import json
import math
import os
import sys
import time
import warnings
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from algdiff import _cli_auto
from algdiff import _formats as formats
from algdiff import _units as units
from algdiff._cli import MODES, UsageError, add_design, add_nan_policy, count, design_by, orders
from algdiff._places import MEMORY
from algdiff._refusals import printed

if TYPE_CHECKING:
    import argparse

    from algdiff import Differentiator, FileReport
    from algdiff._file_job import Job
    from algdiff._formats.base import Options

BAR = 24
PERIOD = 0.1
"""Seconds between two drawings of the progress, at least."""
RUN = """Differentiate a recording of any size, block by block. The suffixes say the formats; a file that holds several
arrays takes the name of one after a colon: file.h5:/group/x, store.zarr:/x. Tables have time along the rows; a .csv
file may have a header row, and its delimiter (comma, semicolon or tab) is kept. Several orders lie along a leading axis
of OUT, or in columns of their own. OUT grows as OUT.partial, and gets its name when it is whole; what an interrupted
run leaves is finished with --resume."""


def add(verb: argparse.ArgumentParser) -> None:
    """Add the options of ``algdiff run`` but for the threads."""
    verb.description = RUN
    verb.set_defaults(verb=run)
    option = verb.add_argument
    suffixes = ", ".join(form.suffixes[0] for form in formats.FORMATS)
    option("source", metavar="IN", help=f"{suffixes} or .flac")
    option("target", metavar="OUT", help=f"{suffixes}; appears whole or not at all")
    window = verb.add_mutually_exclusive_group(required=True)
    window.add_argument("--window", type=units.window, metavar="N", help="window in samples, or as a time: 101, 50ms")
    _cli_auto.add(window, verb)
    add_reading(verb)
    option("--mode", choices=MODES, default="fit", help="what happens at the ends of the data; default: %(default)s")
    option("--cval", type=float, metavar="X", help="value beyond the ends for --mode constant; default: 0")
    add_nan_policy(verb)
    option("--min-support", type=int, metavar="N", help="samples that a fit needs; default: degree + 1")
    option("--max-gain", type=float, metavar="X", help="how much gaps may add to the noise gain; default: 100")
    add_design(verb, orders, "N[,N]", "what IN states, or 1, with no unit")
    option("--overwrite", action="store_true", help="replace OUT if it exists, and what an interrupted run left of it")
    option("--resume", action="store_true", help="go on with what an interrupted run left")
    option("--memory", type=units.size, default=MEMORY, metavar="SIZE", help="memory to use, about; default: 512MiB")
    option("--dry-run", action="store_true", help="check everything, say what would be done, and write nothing")
    option("--json", action="store_true", help="print what was done as JSON, and nothing else")
    option("-q", "--quiet", action="store_true", help="no progress and no summary on stderr")


def add_reading(verb: argparse.ArgumentParser) -> None:
    """Add the options that say how an input is to be read."""
    option = verb.add_argument
    option("--axis", type=int, help="axis of time; default: rows of tables, samples of raw and audio files, else -1")
    option(
        "--key", metavar="NAME", help="array in a .npz IN (needed when it holds several), and its name in a .npz OUT"
    )
    option("--columns", type=names, metavar="A,B", help="columns of a table: names, or positions from 0")
    option("--time", metavar="COLUMN", help="column of a table that holds the times of its rows: even ones")
    option("--dtype", metavar="TYPE", help="type of the numbers of a raw IN: float32, int16, >f8")
    option("--channels", type=count, metavar="N", help="channels of a raw IN, which alternate sample by sample")
    option("--offset", type=_offset, default=0, metavar="BYTES", help="bytes before the first number of a raw IN")


def names(text: str) -> tuple[str, ...]:
    """Read names with commas between them."""
    return tuple(name.strip() for name in text.split(","))


def _offset(text: str) -> int:
    from argparse import ArgumentTypeError

    if not text.isdecimal():
        raise ArgumentTypeError(f"must be a number of bytes, got {text!r}")
    return int(text)


def run(options: argparse.Namespace) -> None:
    """Check the arguments, differentiate, and say what was done."""
    from algdiff import _file
    from algdiff._file_job import Missing

    step = _check_arguments(options)
    words = {name: getattr(options, name) for name in ("axis", "mode", "overwrite", "resume", "memory", "threads")}
    silent = options.quiet or options.json
    with Bar(not silent and not options.dry_run and sys.stderr.isatty()) as bar:
        task = _Task(options, bar)
        report = _file.differentiate_with(
            task.design_for,
            reading(options),
            options.source,
            options.target,
            step=step,
            cval=0.0 if options.cval is None else options.cval,
            missing=Missing(options.nan_policy, options.min_support, options.max_gain),
            dry_run=options.dry_run,
            progress=bar.draw if bar.wanted else None,
            runner=task.run,
            **words,
        )
    if options.json:
        print(json.dumps(report.to_dict(), allow_nan=False))
    elif not options.quiet:
        print(printed(task.summary(report)), file=sys.stderr)


def reading(options: argparse.Namespace) -> Options:
    """Return how the input is to be read."""
    import numpy as np

    from algdiff._formats.base import Options

    dtype = None
    if options.dtype is not None:
        with suppress(TypeError, ValueError, SyntaxError):
            dtype = np.dtype(options.dtype)
        if dtype is None or dtype.kind not in "biufc":
            raise UsageError(f"--dtype must be a type of numbers like float32, int16 or >f8, got {options.dtype!r}")
    given = {name: getattr(options, name) for name in ("key", "columns", "time", "channels", "offset")}
    return Options(dtype=dtype, **given)


def _check_arguments(options: argparse.Namespace) -> float | None:
    """Return the step that is given; raise UsageError for arguments that cannot be meant, whatever the files hold."""
    from algdiff import _arguments as arguments
    from algdiff import _file

    _cli_auto.check(options)
    try:
        origin, target = formats.located("src", options.source), formats.located("dst", options.target)
        _file.check(origin, target, reading(options))
        arguments.integer("memory", options.memory, _file.LEAST_MEMORY)
        given = (options.delta, options.fs) != (None, None)
        step = arguments.sampling_step(options.delta, options.fs) if given else None
    except (ValueError, TypeError) as error:
        raise UsageError(error) from None
    if options.axis not in (None, 0) and origin.form.table:
        suffix = origin.path.suffix
        raise UsageError(f"--axis must be 0 for a {suffix} IN, which has time along the rows, got {options.axis}")
    if options.cval is not None and options.mode != "constant":
        raise UsageError(f"--cval is for --mode constant, got --mode {options.mode}")
    return step


def lasting(duration: float, deriv: int | tuple[int, ...], **given: Any) -> Differentiator:
    """Return the design whose window is nearest to a duration."""
    from algdiff import Differentiator
    from algdiff._orders import highest

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the design itself will warn
            length = Differentiator.from_duration(duration, highest(deriv), **given).window_length
    except ValueError as error:
        raise ValueError(str(error).replace("duration must", "--window must")) from None
    return Differentiator(length, deriv, **given)


def _check_gaps(design: Differentiator, options: argparse.Namespace) -> None:
    """Raise UsageError for limits that no window of the design can meet."""
    from algdiff._arguments import integer
    from algdiff._wish import check_support, gain_limit

    try:
        if options.min_support is not None:
            check_support(design, integer("min_support", options.min_support, design.degree + 1))
        gain_limit(options.max_gain)
    except ValueError as error:
        raise UsageError(f"--{str(error).replace('_', '-', 1)}") from None


class _Task:
    """What the run finds out on its way: where its step comes from, its design, the names of the channels."""

    def __init__(self, options: argparse.Namespace, bar: Bar) -> None:
        self.options, self.bar = options, bar
        self.design: Differentiator | None = None
        self.stated = False
        self.names: tuple[str, ...] | None = None

    def design_for(self, step: float | None) -> Differentiator:
        """Return the design for a step, None if it is not known."""
        from algdiff import Differentiator

        options, window = self.options, self.options.window
        self.stated = step is not None
        if options.auto:
            self.design = _cli_auto.design_for(options, reading(options), step)
            return self.design
        make = Differentiator if isinstance(window, int) else lasting
        self.design = design_by(make, window, options, step)
        _check_gaps(self.design, options)
        return self.design

    def run(self, job: Job, **words: Any) -> int:
        """Run the job; return how many blocks were finished before."""
        from algdiff import _file_run

        self.names = job.source.names
        self.bar.start(math.prod(job.source.shape), job.source.dtype.itemsize)
        return _file_run.run(job, **words)

    def summary(self, report: FileReport) -> str:
        """Return what was done, or would be, in some lines."""
        assert self.design is not None  # noqa: S101
        design, options = self.design, self.options
        unit = " s" if self.stated else ""
        step = f"delta {design.delta:g} s" if self.stated else "delta 1, no unit"
        if self.stated and options.delta is None and options.fs is None:
            step += " from the file"
        gains = report.noise_gain if isinstance(report.noise_gain, tuple) else (report.noise_gain,)
        labels = "" if self.names is None else f" ({', '.join(self.names)})"
        lines = [
            f"{report.source} -> {report.target}" + (" (nothing is written)" if report.dry_run else ""),
            f"window      {report.window_length} samples, {report.window_length * design.delta:g}{unit} ({step})",
            f"delay       {design.delay_samples:g} samples, {report.delay:g}{unit}",
            f"noise gain  {', '.join(f'{gain:.4g}' for gain in gains)}",
            f"samples     {' x '.join(map(str, report.shape))}{labels}",
        ]
        if report.dry_run:
            lines += [
                f"output      {' x '.join(map(str, report.result_shape))} {report.result_dtype}, "
                f"{units.scaled(report.bytes_written, 'B')}",
                f"blocks      {report.blocks}, with {units.scaled(report.memory, 'B')} of buffers",
            ]
        elif report.resumed:
            lines.append(f"blocks      {report.blocks}, of which {report.resumed} were finished before")
        about = "about " if report.dry_run else ""
        return "\n".join([*lines, f"time        {about}{report.seconds:.3g} s"])


class Bar:
    """The progress in one line on stderr, drawn again and again, and erased in the end.

    Parameters
    ----------
    wanted : bool
        Whether there is one to see it.
    """

    def __init__(self, wanted: bool) -> None:
        self.wanted = wanted
        self.samples = self.itemsize = self.shown = 0
        self.first: tuple[float, float] | None = None
        self.drawn = -float("inf")

    def start(self, samples: int, itemsize: int) -> None:
        """Say how much there is to do."""
        self.samples, self.itemsize = samples, itemsize

    def draw(self, fraction: float) -> None:
        """Draw the fraction that is done, unless that was just drawn."""
        now = time.monotonic()
        if self.first is None:
            # Rates count from here: what an earlier run finished took none of this time.
            self.first = fraction, now
        if now < self.drawn + PERIOD:
            return
        self.drawn = now
        line = self.line(fraction, fraction - self.first[0], now - self.first[1])
        line = line[: _columns() - 1]
        print(f"\r{line:<{self.shown}}", end="", file=sys.stderr, flush=True)
        self.shown = len(line)

    def line(self, fraction: float, done: float, seconds: float) -> str:
        """Return what is drawn when a fraction is done, part of it in some seconds."""
        line = f"[{'#' * int(BAR * fraction):<{BAR}}] {int(100 * fraction):3d} %"
        if done <= 0 or seconds <= 0:
            return line
        rate = self.samples * done / seconds
        rates = units.scaled(rate * self.itemsize, "B/s"), units.scaled(rate, "samples/s")
        return "  ".join((line, *rates, f"{_clock(seconds * (1 - fraction) / done)} left"))

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        if self.shown:
            print("\r" + " " * self.shown + "\r", end="", file=sys.stderr, flush=True)


def _columns() -> int:
    """Return how wide the terminal is."""
    try:
        return int(os.environ.get("COLUMNS") or os.get_terminal_size(sys.stderr.fileno()).columns) or 80
    except (OSError, ValueError):
        return 80


def _clock(seconds: float) -> str:
    minutes, rest = divmod(int(seconds + 0.5), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"
