"""``algdiff run --auto``: the window that is chosen from a part of the input."""

from __future__ import annotations

import itertools
import math
import re
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from algdiff import _formats as formats
from algdiff import _units as units
from algdiff._cli import UsageError

if TYPE_CHECKING:
    import argparse

    from algdiff import Differentiator, Suggestion
    from algdiff._arguments import Samples
    from algdiff._formats.base import Options, Source

NUMBERS = 1 << 22
"""Real numbers that a window is chosen from, at most."""
LOOKED = 1 << 28
"""Numbers that are read for them, at most, from files that hold more channels than are looked at."""
LEAST = 2048
"""Samples that are read, however many channels there are: no more than a run would read of them."""
PIECE = 1 << 20
"""Numbers of all channels that are read at once."""
SEEK = 256
"""A number that lies apart from others takes as long to read as so many that lie together."""
SHOWN = 2
"""Lines of the explanation that are printed."""
OWN = ("max_delay", "bandwidth", "min_window", "max_window", "sigma", "noise")
"""Options that only a choice has."""
SHARED = ("degree", "kappa", "mu")
"""Those of a design that the choice keeps to."""
OTHER = ("tau", "delay", "rule", "trim")
"""And those that need a window."""
NAMES = re.compile(rf"(?<!-)(?<!fit of )\b({'|'.join((*OWN, *SHARED))})\b")
AUTO = """choose window and degree from the samples, and say what was chosen: of a long file, from a stretch in its
middle. The error that is said counts the ends as algdiff.suggest finds them; those of OUT are by --mode"""


def add(window: argparse._MutuallyExclusiveGroup, verb: argparse.ArgumentParser) -> None:
    """Add ``--auto`` to the ways to say a window, and the options that go with it to a group of their own."""
    window.add_argument("--auto", action="store_true", help=AUTO)
    what = "of several orders, the highest is chosen for; --degree, --kappa and --mu hold if they are given"
    option = verb.add_argument_group("with --auto", what).add_argument
    option("--max-delay", type=units.time, metavar="S", help="lag of the estimate, at most: 0.02, 20ms; default: any")
    option("--bandwidth", type=units.frequency, metavar="HZ", help="pass frequencies up to this one: 20, 20Hz")
    option("--min-window", type=units.window, metavar="N", help="shortest window, in samples or as a time")
    option("--max-window", type=units.window, metavar="N", help="longest window, in samples or as a time")
    option("--sigma", type=float, metavar="X", help="level of the noise; default: found from the samples")
    option("--noise", choices=("auto", "white", "ar1"), help="kind of the noise; default: auto")


def check(options: argparse.Namespace) -> None:
    """Raise UsageError for options that do not go with a choice, or only with one."""
    wrong, why = (OTHER, "a --window, got --auto") if options.auto else (OWN, "--auto, got --window")
    for word in wrong:
        if getattr(options, word) is not None:
            raise UsageError(f"--{word.replace('_', '-')} is for {why}")


def design_for(options: argparse.Namespace, reading: Options, step: float | None) -> Differentiator:
    """Return what is chosen for the input at a step, None if it is not known, and say so unless that is not wanted."""
    asked = wanted(options, step)
    place = formats.located("src", options.source)
    with formats.open_source(place, replace(reading, memory=options.memory)) as source:
        stretch = Stretch.of(source, options.axis)
        x = stretch.read(source)
    design, suggestion = chosen(x, options, asked)
    if not (options.quiet or options.json):
        print("\n".join([*suggestion.explain().splitlines()[:SHOWN], *stretch.told()]), file=sys.stderr)
    return design


def wanted(options: argparse.Namespace, step: float | None) -> dict[str, Any]:
    """Return the arguments of `suggest` that are given, with numbers that have units in those of the step."""
    given = {word: getattr(options, word) for word in (*SHARED, *OWN) if getattr(options, word) is not None}
    delta = 1.0 if step is None else step
    for name, value in given.items():
        unit = getattr(value, "unit", None)
        if unit is not None and step is None:
            raise UsageError(
                f"--fs or --delta must be given for numbers in {unit}, got neither: the step is 1, with no unit"
            )
        if unit == "rad/s":
            given[name] = value / (2 * math.pi)
        elif unit is not None and name in ("min_window", "max_window"):
            given[name] = _samples(value / delta, longest=name == "max_window")
    return {**given, "delta": delta}


def _samples(count: float, *, longest: bool) -> int:
    """Return a number of samples as a bound; one that is whole but for its rounding counts as whole."""
    if abs(count) > 2**53:
        raise UsageError(f"--{'max' if longest else 'min'}-window must be at most {2**53} samples, got {count:g}")
    whole = round(count)
    if math.isclose(count, whole, rel_tol=1e-9):
        return whole
    return math.floor(count) if longest else math.ceil(count)


def chosen(x: Samples, options: argparse.Namespace, asked: dict[str, Any]) -> tuple[Differentiator, Suggestion]:
    """Return the design that is chosen from samples, with the engine of the options, and how it was chosen."""
    from algdiff import suggest

    try:
        suggestion = suggest(x, options.deriv, **asked)
    except (ValueError, TypeError, OverflowError) as error:
        said = re.sub(r"\bx\b", lambda _: str(options.source), str(error))
        if str(error).startswith("x must "):
            raise ValueError(said) from None
        raise UsageError(NAMES.sub(lambda found: "--" + found[0].replace("_", "-"), said)) from None
    design = suggestion.differentiator
    if options.engine is None:
        return design, suggestion
    try:
        return design.replace(engine=options.engine), suggestion
    except (ValueError, TypeError) as error:
        raise UsageError(error) from None


class Stretch(NamedTuple):
    """What of an array is looked at: some samples in its middle, of some rows spread evenly over its other axes.

    Attributes
    ----------
    shape : tuple of int
        Shape of the array.
    axis : int
        The axis of time, counted from the front.
    start, stop : int
        The samples.
    rows : tuple of tuple of int
        Where the rows lie along the other axes.
    together : bool
        Whether to read these samples of all rows, because that is faster.
    unit : int
        How many samples are read together, for the file's sake.
    """

    shape: tuple[int, ...]
    axis: int
    start: int
    stop: int
    rows: tuple[tuple[int, ...], ...]
    together: bool
    unit: int

    @property
    def channels(self) -> int:
        """How many rows the array has."""
        return math.prod((*self.shape[: self.axis], *self.shape[self.axis + 1 :]))

    @classmethod
    def of(cls, source: Source, axis: int | None) -> Stretch:
        """Return the stretch of an array that is open."""
        import numpy as np

        from algdiff import _arguments as arguments
        from algdiff._formats.tables import TableSource
        from algdiff._suggest.rows import spread

        shape = source.shape
        along = arguments.axis_index(source.axis if axis is None else axis, len(shape))
        others = (*shape[:along], *shape[along + 1 :])
        count = math.prod(others)
        if not count:
            raise ValueError(f"{source.path}: must hold a channel to choose a window from, got shape {shape}")
        # The rows that a choice from the whole array would take.
        rows = tuple(tuple(map(int, np.unravel_index(one, others))) for one in spread(count)) if others else ((),)
        apart = len(rows) * _cost(source, along)
        together = isinstance(source, TableSource) or count <= apart
        length = NUMBERS // (len(rows) * (2 if source.dtype.kind == "c" else 1))
        length = min(shape[along], length, max(LOOKED // (count if together else apart), LEAST))
        unit = 1 if source.chunks is None else source.chunks[along]
        start = (shape[along] - length) // 2
        return cls(shape, along, start, start + length, rows, together, unit)

    def read(self, source: Source) -> Samples:
        """Return the samples, of shape (rows, samples)."""
        import numpy as np

        x = np.empty((len(self.rows), self.stop - self.start), source.dtype)
        if not self.together:
            for row, out in zip(self.rows, x, strict=True):
                place = [slice(index, index + 1) for index in row]
                place.insert(self.axis, slice(self.start, self.stop))
                out[:] = self._block(source, place).reshape(-1)
            return x
        others = [*range(self.axis), *range(self.axis + 1, len(self.shape))]
        where = tuple(np.array(index) for index in zip(*self.rows, strict=True))
        for first, last in self._pieces():
            place = [slice(0, extent) for extent in self.shape]
            place[self.axis] = slice(first, last)
            block = self._block(source, place).transpose(*others, self.axis)
            x[:, first - self.start : last - self.start] = block[where]
        return x

    def _block(self, source: Source, place: list[slice]) -> Samples:
        import numpy as np

        shape = [one.stop - one.start for one in place]
        block = np.empty(shape, source.dtype, order="F" if source.fortran else "C")
        source.read(tuple(place), block)
        return block

    def _pieces(self) -> list[tuple[int, int]]:
        """Return first and last samples of pieces of all rows, which end where chunks of the file do."""
        most = max(PIECE // self.channels, 1)
        length = max(most // self.unit, 1) * self.unit if most >= self.unit else most
        cuts = [self.start, *range((self.start // length + 1) * length, self.stop, length), self.stop]
        return [(first, last) for first, last in itertools.pairwise(cuts) if first < last]

    def told(self) -> list[str]:
        """Return what is to be said of it: nothing if it is all."""
        samples, said = self.shape[self.axis], []
        if self.stop - self.start < samples:
            said.append(f"samples {self.start} to {self.stop - 1} of {samples}")
        if len(self.rows) < self.channels:
            said.append(f"{len(self.rows)} channels of {self.channels}")
        return [f"It was chosen from {' and '.join(said)}."] if said else []


def _cost(source: Source, axis: int) -> int:
    """Return how many numbers a file reads for one sample of one row, or could in the same time."""
    if source.chunks is not None:
        return math.prod(source.chunks) // max(source.chunks[axis], 1)
    nearest = 0 if source.fortran else len(source.shape) - 1
    return 1 if axis == nearest else SEEK
