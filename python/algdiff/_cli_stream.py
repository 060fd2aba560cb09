"""``algdiff stream``: samples in, estimates out, line by line and as soon as a line is there."""

from __future__ import annotations

import csv
import os
import sys
from io import StringIO
from itertools import islice
from typing import TYPE_CHECKING, Any

from algdiff._cli import UsageError, add_design, add_nan_policy, design_by, orders

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from algdiff import Differentiator, Stream
    from algdiff._lines import Lines

READ = 1 << 18
"""Bytes read at once, at most."""
WRITE = 1 << 12
"""Bytes written at once, at most: as many as a pipe takes whole or not at all, so that Ctrl-C cuts no line."""
FIELD = 32
"""Bytes of a number or a date and what follows it, at most."""
STREAM = """Differentiate lines as they come. Every line of stdin is a sample; for each there is one on stdout, before
the next is awaited, with the estimate of the window whose newest sample it is, or nan while the window is not full. A
line holds one number, or one for each of several channels, separated by tabs, semicolons, commas or spaces: the first
line says by which, and the output keeps them. Columns of the output: the time, if there is one; the estimates, one
order after the other, each of all channels; the standard deviations likewise. An empty field, nan and NA are missing
samples; blank lines, and lines that start with #, are passed over. A header is kept; it names the orders if there are
several."""


def add(verb: argparse.ArgumentParser) -> None:
    """Add the options of ``algdiff stream``."""
    verb.description = STREAM
    verb.set_defaults(verb=run)
    option = verb.add_argument
    option("--window", type=int, required=True, dest="window_length", metavar="N", help="window in samples")
    option("--time", action="store_true", help="the first column is the time, a number or an ISO 8601 date")
    option("--stamp", action="store_true", help="print the time of each estimate first; the first sample is at 0")
    option("--warmup", choices=("nan", "grow"), default="nan", help="before the window is full; default: %(default)s")
    add_nan_policy(verb)
    option("--std", action="store_true", help="print the standard deviation of each estimate, too")
    option("--sigma", type=float, metavar="X", help="level of the noise, for --std; default: 1")
    add_design(verb, orders, "N[,N]")


def run(options: argparse.Namespace) -> None:
    """Read, differentiate and write until there is no more to read."""
    from algdiff._lines import Lines

    design = _design(options)
    lines = Lines(timed=options.time, strict=options.nan_policy == "raise")
    output: Output | None = None
    for text in _texts():
        values, fault = lines.read(text)
        if values:
            if output is None:
                output = Output(design, lines, options)
            output.write(values)
        if fault:
            raise ValueError(f"stdin: {fault}")


def _check_arguments(options: argparse.Namespace) -> None:
    """Raise UsageError for arguments that exclude each other."""
    if options.time:
        for word in ("fs", "delta"):
            if getattr(options, word) is not None:
                raise UsageError(f"--{word} must be left out with --time, got --{word} {getattr(options, word)}")
        if options.stamp:
            raise UsageError("--stamp is for samples without times, got --time, which prints those of the estimates")
    if options.engine not in (None, "auto", "direct"):
        raise UsageError(
            f"--engine must be direct, whose estimates do not depend on when lines come, got --engine {options.engine}"
        )
    if options.sigma is not None and not options.std:
        raise UsageError(f"--sigma is for --std, got --sigma {options.sigma} alone")


def _design(options: argparse.Namespace) -> Differentiator:
    """Return the design, or raise UsageError."""
    from algdiff import Differentiator

    _check_arguments(options)
    if options.time:
        options.delta = 1.0  # of no influence, but a delay may have a unit
    design = design_by(Differentiator, options.window_length, options)
    try:
        # What does not go with times is refused by the first of them.
        _stream(design, options).push([0.0], 0.0 if options.time else None)
    except (ValueError, TypeError) as error:
        raise UsageError(str(error)) from None
    return design


def _stream(design: Differentiator, options: argparse.Namespace, channels: int = 1) -> Stream:
    sigma = 1.0 if options.sigma is None else options.sigma
    return design.stream(channels=channels, warmup=options.warmup, nan_policy=options.nan_policy, sigma=sigma)


def _texts() -> Iterator[bytes]:
    """Yield whole lines as soon as they are there, as many as there are."""
    for name, file in (("stdin", sys.stdin), ("stdout", sys.stdout)):
        if file is None:
            raise ValueError(f"{name}: must be open, got a closed one")
    rest = b""
    while chunk := os.read(sys.stdin.fileno(), READ):
        whole, newline, last = chunk.rpartition(b"\n")
        if newline:
            yield rest + whole
            rest = last
        else:
            rest += chunk
    if rest:
        yield rest


def _write(text: str) -> None:
    rest = text.encode(errors="surrogateescape")
    while rest:
        rest = rest[os.write(sys.stdout.fileno(), rest) :]


class Output:
    """The lines of estimates, on stdout."""

    def __init__(self, design: Differentiator, lines: Lines, options: argparse.Namespace) -> None:
        self._design, self._lines = design, lines
        self._stream = _stream(design, options, lines.columns - lines.timed)
        self._stamp, self._std = options.stamp, options.std
        self._delimiter = lines.delimiter or (" " if lines.columns > 1 else ",")
        if lines.names:
            self._write_names()

    def _write_names(self) -> None:
        lines, deriv = self._lines, self._design.deriv
        names = list(lines.names[lines.timed :])
        if isinstance(deriv, tuple):
            names = [f"{name}_d{order}" for order in deriv for name in names]
        if self._std:
            names += [f"{name}_std" for name in names]
        first = ("time",) if self._stamp else lines.names[: lines.timed]
        row = StringIO()
        csv.writer(row, delimiter=self._delimiter, lineterminator="\n").writerow([*first, *names])
        _write(row.getvalue())

    def write(self, values: list[float]) -> None:
        """Push the numbers of lines, and write what comes of them."""
        import numpy as np

        table = np.array(values).reshape(-1, self._lines.columns)
        times, rows = self._push(table)
        columns: list[Iterator[str]] = [map(repr, rows.reshape(-1).tolist())] * rows.shape[1]
        if times is not None:
            columns.insert(0, map(repr if self._lines.clock is None else self._lines.clock.text, times))
        texts = map(self._delimiter.join, zip(*columns, strict=False))
        step = max(WRITE // (FIELD * len(columns)), 1)
        while some := list(islice(texts, step)):
            _write("\n".join(some) + "\n")

    def _push(self, table: NDArray[Any]) -> tuple[list[float] | None, NDArray[Any]]:
        """Return the times of the estimates, if they are wanted, and a row of estimates for each of `table`."""
        import numpy as np

        stream, timed = self._stream, self._lines.timed
        if not (timed or self._stamp):
            return None, self._block(table)
        times, rows = [], []
        for row in table:
            if stream.ready and not timed:
                break
            rows.append(self._flat(stream.push(row[timed:], row[0] if timed else None, return_std=self._std), 1))
            times.append(stream.time)
        rest = table[len(rows) :]
        if len(rest):
            count = np.arange(stream.count, stream.count + len(rest))
            times += (count * self._design.delta - stream.delay).tolist()
            rows.append(self._block(rest))
        return times, np.concatenate(rows)

    def _block(self, samples: NDArray[Any]) -> NDArray[Any]:
        return self._flat(self._stream.push(samples, return_std=self._std), len(samples))

    def _flat(self, found: Any, count: int) -> NDArray[Any]:
        """Return a row of estimates and standard deviations for each of so many samples."""
        import numpy as np

        channels = self._lines.columns - self._lines.timed
        parts = [part.reshape(-1, count, channels) for part in (found[:2] if self._std else (found,))]
        return np.concatenate(parts).swapaxes(0, 1).reshape(count, -1)
