"""What is read, computed and written when a file is differentiated, decided before the first sample."""

from __future__ import annotations

import math
from dataclasses import astuple, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from algdiff import _arguments as arguments
from algdiff import _formats as formats
from algdiff._blocks import Row, run_part
from algdiff._formats.base import Layout, Options, Place, Source, Target
from algdiff._places import Cuts, TooLargeError
from algdiff._row_parts import Blocks
from algdiff._times import resolution
from algdiff._wish import Call, Windows, Wish, limits

if TYPE_CHECKING:
    from algdiff import Differentiator
    from algdiff._arguments import Progress, Samples

RESERVE = 192 << 20
"""Bytes of memory that are not for buffers: the interpreter, libraries, what readers keep."""


class Missing(NamedTuple):
    """What missing samples do; see `Differentiator`."""

    nan_policy: str = "propagate"
    min_support: int | None = None
    max_gain: float | None = None


PLAIN = Missing()
"""They make NaN of every window that holds one."""


class Spec(NamedTuple):
    """What is asked for; whoever opens the input can make the same job of it.

    Attributes
    ----------
    origin, target : Located
        Input and output.
    options : Options
        How the input is to be read, and the name of an output that has one.
    design : Differentiator
        What is computed.
    axis : int
        The axis of time, counted from the front.
    mode : str
        What happens at the ends.
    cval : complex
        The value beyond the data in mode "constant".
    stated : bool
        Whether the step of the design is known, from the caller or the file.
    memory : int
        Bytes that the run may use.
    missing : Missing
        What missing samples do.
    """

    origin: formats.Located
    target: formats.Located
    options: Options
    design: Differentiator
    axis: int
    mode: str
    cval: complex
    stated: bool
    memory: int
    missing: Missing = PLAIN


class Job:
    """What is read, computed and written, decided before the first sample.

    Parameters
    ----------
    source : Source
        The input, open.
    spec : Spec
        What is asked for.

    Attributes
    ----------
    layout : Layout
        What is written.
    row : Row
        What outputs read.
    cuts : Cuts
        The blocks.
    """

    def __init__(self, source: Source, spec: Spec) -> None:
        self.source, self.spec, self.target, self.design = source, spec, spec.target, spec.design
        axis, mode, design = spec.axis, spec.mode, spec.design
        self.axis, self.mode = axis, mode
        dtype = arguments.working_dtype(source.dtype)
        self.cval = (arguments.number if dtype.kind == "c" else arguments.real)("cval", spec.cval)
        samples, span = source.shape[axis], design._plan.span
        if span > samples and mode in ("fit", "valid", "nan"):
            raise ValueError(
                f"window_length must be at most the {samples} samples of {source.path} in mode {mode!r}, got {span}"
            )
        grid = design._bank.grid(single=dtype in (np.float32, np.complex64))
        self.row = Row.of(design._plan, mode, samples, grid)
        shape = (*source.shape[:axis], self.row.outputs, *source.shape[axis + 1 :])
        leading = design._leading is not None
        self.layout = Layout(
            shape=shape,
            axis=axis,
            orders=design.deriv if leading else (design.deriv,),
            leading=leading,
            dtype=dtype,
            fortran=source.fortran,
            chunks=source.chunks,
            step=design.delta if spec.stated else None,
            names=source.names,
            delimiter=source.delimiter,
            time=source.time,
            time_dtype=source.time_dtype,
            key=spec.options.key or source.key or "arr_0",
            attributes=source.attributes,
        )
        formats.check(spec.target, self.layout)
        self.fits = self._fits(samples)
        self.cuts = self._cut(spec.memory)

    def _fits(self, samples: int) -> Blocks | None:
        """Return what fits windows with missing samples, if anything but NaN is asked of them."""
        missing = self.spec.missing
        if missing == PLAIN:
            return None
        wish = Wish(**missing._asdict())
        call = Call(self.axis, self.mode, self.cval, None, None, None)
        limits(self.design, Windows(), samples, call, wish)
        halo = (0, 0)  # which samples come with a block is said of each
        return Blocks(self.design, samples, self.axis, halo, Windows(), call, wish, [], False, self.source.dtype)

    def _cut(self, memory: int) -> Cuts:
        orders, layout = len(self.layout.orders), self.layout
        copies = 2 if self.fits is None else 5
        grain = formats.grain(self.target, layout)
        chunk = 0 if self.source.chunks is None else math.prod(self.source.chunks) * self.source.dtype.itemsize
        if grain is not None and chunk > memory:  # else blocks hold whole chunks
            raise ValueError(
                f"memory must be at least {chunk} bytes for a chunk of {self.source.chunks} samples of "
                f"{self.source.path}, got {memory}"
            )
        try:
            return Cuts(
                layout.shape,
                self.axis,
                self.row,
                # Two of each: one is filled while the other is used. Fits take copies.
                cost=copies * self.source.dtype.itemsize + copies * orders * layout.dtype.itemsize,
                budget=max(memory - RESERVE, memory // 4),
                fortran=layout.fortran,
                units=grain or self.source.chunks,
                chunked=grain is not None,
                rows=self.target.form.table,
            )
        except TooLargeError as error:
            need = error.args[0]
            least = min(need + RESERVE, 4 * need)
            raise ValueError(
                f"memory must be at least {least} bytes for blocks of {self.row.span} samples of {self.source.path}, "
                f"got {memory}"
            ) from None

    def header(self) -> dict[str, Any]:
        """Return what the journal says of this run: whatever decides about a bit of the output."""
        from importlib.metadata import version

        design, source = self.design, self.source
        return {
            "version": version("algdiff-rs"),
            "input": [str(Path(source.path).resolve()), *self.stamp],
            "reading": [self.spec.origin.inner, *map(str, astuple(replace(self.spec.options, memory=None)))],
            "array": [list(source.shape), source.dtype.str, source.fortran, list(source.names or ()), source.time],
            "design": design._asked,
            "call": [self.axis, self.mode, str(self.cval), self.spec.stated, *self.spec.missing],
            "output": [list(self.layout.full_shape), self.layout.dtype.str, self.target.inner, self.layout.key],
            "blocks": [list(self.cuts.extents), len(self.cuts)],
        }

    @cached_property
    def stamp(self) -> list[int]:
        """Size and time of the input when the run began."""
        return self.source.stamp()

    def check_unchanged(self) -> None:
        """Raise ValueError if the input is not what it was when the run began."""
        if self.source.stamp() != self.stamp:
            raise ValueError(
                f"{self.source.path}: was changed while it was read; nothing was written: run again when it rests"
            )

    def reads(self, place: Place) -> tuple[int, int]:
        """Return the samples that the outputs at a place need."""
        first, last = place[self.axis].start, place[self.axis].stop
        start, end = self.row.reads(first, last)
        if self.fits is None or self.mode == "valid":
            return start, end
        # Fits give the estimates at the samples at hand, which windows of predictions do not reach.
        return min(start, first), max(end, last)

    def read(self, place: Place, out: Samples) -> Samples | None:
        """Fill `out` with the samples that the outputs at a place need; return their times if the file holds times."""
        start, end = self.reads(place)
        region = list(place)
        if start >= 0 and end <= self.row.samples:
            region[self.axis] = slice(start, end)
            return self.source.read(tuple(region), out)
        # Around the ends of a periodic row, piece by piece.
        done, times = 0, []
        while start + done < end:
            first = (start + done) % self.row.samples
            last = min(first + end - start - done, self.row.samples)
            region[self.axis] = slice(first, last)
            where: list[Any] = [slice(None)] * out.ndim
            where[self.axis] = slice(done, done + last - first)
            part = np.empty_like(out[tuple(where)])
            times.append(self.source.read(tuple(region), part))
            out[tuple(where)] = part
            done += last - first
        return None if times[0] is None else np.concatenate(times)  # type: ignore[arg-type]

    def compute(self, place: Place, x: Samples, result: Samples, threads: int, progress: Progress | None) -> None:
        """Differentiate the samples that `read` gave into `result`, which has a leading axis over the orders."""
        start, _ = self.reads(place)
        first, last = place[self.axis].start, place[self.axis].stop
        if self.fits is not None:
            self.fits.call = self.fits.call._replace(threads=threads or None, progress=progress)
            found = self._fitted(x, first, last, start)
            result[...] = found if self.layout.leading else found[np.newaxis]
            return
        options: dict[str, Any] = {"start": start, "first": first}
        bank = self.design._bank
        run_part(bank, self.row, x, result, self.axis, self.cval, threads=threads, progress=progress, **options)

    def _fitted(self, x: Samples, first: int, last: int, start: int) -> Samples:
        assert self.fits is not None  # noqa: S101
        try:
            return self.fits.fitted(x, {}, first, last, start)
        except ValueError as error:
            if not str(error).startswith("x must hold no missing samples"):
                raise
            end = start + x.shape[self.axis]
            raise ValueError(
                f"{self.spec.origin.given} must hold no missing samples with nan_policy = 'raise', got some between "
                f"samples {start} and {end}"
            ) from None

    def samples(self, place: Place, room: Buffers, turn: int = 0) -> tuple[Samples, Samples | None]:
        """Read what the outputs at a place need; return it, and times."""
        start, end = self.reads(place)
        shape = [one.stop - one.start for one in place]
        shape[self.axis] = end - start
        x = room.take(turn, tuple(shape), self.source.dtype, fortran=self.source.fortran)
        return x, self.read(place, x)

    def estimates(
        self, place: Place, x: Samples, room: Buffers, turn: int = 0, *, threads: int, progress: Progress | None = None
    ) -> Samples:
        """Compute the outputs at a place of what `samples` returned; they have a leading axis over the orders."""
        shape = (len(self.layout.orders), *(one.stop - one.start for one in place))
        result = room.take(turn, shape, self.layout.dtype, fortran=self.source.fortran, leading=1)
        self.compute(place, x, result, threads, progress)
        return result

    def block(self, place: Place, threads: int) -> tuple[Samples, Samples | None]:
        """Read and compute the outputs at a place, in memory of their own; return them and times."""
        x, times = self.samples(place, Buffers())
        return self.estimates(place, x, Buffers(), threads=threads), times

    def write(self, target: Target, place: Place, result: Samples, times: Samples | None) -> None:
        """Write the outputs at a place."""
        if not self.target.form.table:
            target.write(place, result)
            return
        first, last = place[self.axis].start, place[self.axis].stop
        rows = np.moveaxis(result, 1 + self.axis, 0).reshape(last - first, -1)
        if times is not None:
            start, _ = self.reads(place)
            times = times[first - start : last - start]
            if self.mode == "valid":
                times = _later(times, (self.row.span - 1 - self.design.delay_samples) * self.design.delta)
        target.write((slice(first, last),), rows, times)


def _later(times: Samples, seconds: float) -> Samples:
    """Return times that lie later by some seconds; numbers are in the unit of the step."""
    if times.dtype.kind != "M":
        return times + seconds
    later: Samples = times + round(seconds / resolution(times.dtype))
    return later


class Buffers:
    """Room for two blocks, which take turns."""

    def __init__(self) -> None:
        self.held = [np.empty(0, np.uint8), np.empty(0, np.uint8)]

    def take(
        self, turn: int, shape: tuple[int, ...], dtype: np.dtype[Any], *, fortran: bool, leading: int = 0
    ) -> Samples:
        """Return an array of `shape` in the room of a turn; its axes after the `leading` ones lie as in the file."""
        size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
        if self.held[turn % 2].size < size:
            self.held[turn % 2] = np.empty(size, np.uint8)
        flat = self.held[turn % 2][:size].view(dtype)
        if not fortran:
            return flat.reshape(shape)
        order = [*range(leading), *reversed(range(leading, len(shape)))]
        return flat.reshape([shape[axis] for axis in order]).transpose(order)
