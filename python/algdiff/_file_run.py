"""One file differentiated into another, block by block: read, computed and written at the same time."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import astuple, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from algdiff import _arguments as arguments
from algdiff import _formats as formats
from algdiff import _threads as threads_of
from algdiff._blocks import Row, run_part
from algdiff._formats.base import Layout, Options, Place, Source, Target
from algdiff._formats.stage import Stage
from algdiff._journal import Journal
from algdiff._output import publish, remove
from algdiff._places import Cuts, TooLargeError
from algdiff._row_parts import Blocks
from algdiff._wish import Call, Windows, Wish, limits

if TYPE_CHECKING:
    from algdiff import Differentiator
    from algdiff._arguments import Progress, Samples

INTERVAL = 0.5
"""Seconds between checkpoints: what a crash may cost."""

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
        wish = Wish(
            None,
            None,
            None,
            missing.min_support,
            missing.max_gain,
            *(None,) * 4,
            "full",
            missing.nan_policy,
            *(False,) * 3,
        )
        call = Call(self.axis, self.mode, self.cval, None, None, None)
        limits(self.design, Windows(), samples, call, wish)
        halo = (0, 0)  # which samples come with a block is said of each
        return Blocks(self.design, samples, self.axis, halo, Windows(), call, wish, [], False, self.source.dtype)

    def _cut(self, memory: int) -> Cuts:
        orders, layout = len(self.layout.orders), self.layout
        copies = 2 if self.fits is None else 5
        grain = formats.grain(self.target, layout)
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
            "input": [str(Path(source.path).resolve()), *source.stamp()],
            "reading": [self.spec.origin.inner, *map(str, astuple(replace(self.spec.options, memory=None)))],
            "array": [list(source.shape), source.dtype.str, source.fortran, list(source.names or ()), source.time],
            "design": design._asked,
            "call": [self.axis, self.mode, str(self.cval), self.spec.stated, *self.spec.missing],
            "output": [list(self.layout.full_shape), self.layout.dtype.str, self.target.inner, self.layout.key],
            "blocks": [list(self.cuts.extents), len(self.cuts)],
        }

    def reads(self, place: Place) -> tuple[int, int]:
        """Return the samples that the outputs at a place need."""
        return self.row.reads(place[self.axis].start, place[self.axis].stop)

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
            part = self.empty(region)
            found = self.source.read(tuple(region), part)
            times.append(found)
            where: list[Any] = [slice(None)] * out.ndim
            where[self.axis] = slice(done, done + last - first)
            out[tuple(where)] = part
            done += last - first
        return None if times[0] is None else np.concatenate(times)  # type: ignore[arg-type]

    def empty(self, region: list[slice] | Place) -> Samples:
        """Return a new array for a region of the input, laid out as the file is."""
        shape = [one.stop - one.start for one in region]
        return np.empty(shape, self.source.dtype, order="F" if self.source.fortran else "C")

    def compute(self, place: Place, x: Samples, result: Samples, threads: int, progress: Progress | None) -> None:
        """Differentiate the samples that `read` gave into `result`, which has a leading axis over the orders."""
        start, _ = self.reads(place)
        first, last = place[self.axis].start, place[self.axis].stop
        if self.fits is not None:
            self.fits.call = self.fits.call._replace(threads=threads or None, progress=progress)
            found = self.fits.fitted(x, {}, first, last, start)
            result[...] = found if self.layout.leading else found[np.newaxis]
            return
        options: dict[str, Any] = {"start": start, "first": first}
        bank = self.design._bank
        run_part(bank, self.row, x, result, self.axis, self.cval, threads=threads, progress=progress, **options)

    def block(self, place: Place, threads: int) -> tuple[Samples, Samples | None]:
        """Read and compute the outputs at a place; return them, with a leading axis over the orders, and times."""
        start, end = self.reads(place)
        region = list(place)
        region[self.axis] = slice(start, end)
        x = self.empty(region)
        times = self.read(place, x)
        shape = (len(self.layout.orders), *(one.stop - one.start for one in place))
        result = Buffers().take(0, shape, self.layout.dtype, fortran=self.source.fortran, leading=1)
        self.compute(place, x, result, threads, None)
        return result, times

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
    unit: Any = np.ones(1, times.dtype) - np.zeros(1, times.dtype)
    later: Samples = times + round(seconds / float((unit / np.timedelta64(1, "s"))[0])) * unit
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


def run(
    job: Job,
    *,
    overwrite: bool,
    resume: bool,
    threads: int | None,
    progress: Progress | None,
) -> int:
    """Run a job from where an earlier one left off; return how many blocks that had finished.

    The output grows under a temporary name, with its journal beside it. What is finished stays there if the run is
    interrupted or the disk is full.
    """
    final = Path(os.path.realpath(job.target.path))
    with _naming(job.target.given):
        journal = Journal(final.with_name(final.name + ".partial"), job.header(), resume=resume, overwrite=overwrite)
    before = journal.done
    with ending(job, journal):
        _Pipeline(job, journal, threads_of.count(threads), progress).run()
        with _naming(job.target.given):
            _finish(job, journal, final, overwrite)
    return before


@contextmanager
def ending(job: Job, journal: Journal) -> Iterator[None]:
    """Take away the journal of a run that is finished or in vain; leave it if there is something to go on with."""
    try:
        yield
    except (KeyboardInterrupt, OSError, MemoryError) as error:
        if not journal.done or not journal.partial.exists():
            journal.remove()
            raise
        journal.close()
        raise _kept(error, job, journal) from error
    except BaseException:
        journal.remove()
        raise
    journal.remove()


def _kept(error: KeyboardInterrupt | OSError | MemoryError, job: Job, journal: Journal) -> BaseException:
    """Return the error with what is kept of its run, and how to go on."""
    beside = Path(f"{job.target.path}.partial")
    # A link is followed, and what is kept lies beside what it points at.
    path = beside if os.path.realpath(beside) == str(journal.partial) else journal.partial
    if isinstance(error, KeyboardInterrupt):
        done, total = journal.done, len(job.cuts)
        said = f"{100 * done // total} % of {job.target.given} is kept in {path}: go on with resume=True"
        # None of a kind of its own: Python ends by SIGINT, as shells expect, for this very class only.
        return KeyboardInterrupt(said)
    room = "make room and " if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT) else ""
    hint = f"what is finished is kept in {path}: {room}go on with resume=True"
    if isinstance(error, OSError) and error.errno is not None:
        said = f"{error.strerror}" if error.filename is None else f"{error.filename}: {error.strerror}"
        return OSError(error.errno, f"{said}; {hint}")
    kinds = (MemoryError, FileExistsError, OSError)
    return next(kind for kind in kinds if isinstance(error, kind))(f"{error}; {hint}")


def _finish(job: Job, journal: Journal, final: Path, overwrite: bool) -> None:
    partial = journal.partial
    if not job.target.form.staged:
        publish(partial, final, overwrite)
        return
    encoded = partial.with_name(partial.name + ".encoded")
    stage = Stage(partial, job.layout, table=job.target.form.table)
    try:
        formats.encode(job.target, stage, encoded, job.layout)
        with open(encoded, "rb+") as file:
            os.fsync(file.fileno())
        publish(encoded, final, overwrite)
    finally:
        stage.close()
        remove(encoded)


@contextmanager
def _naming(path: str, verb: str = "written") -> Iterator[None]:
    """Let errors of the system name the file and what could not be done."""
    try:
        yield
    except (FileExistsError, BlockingIOError):
        raise
    except OSError as error:
        said = f"{path}: cannot be {verb} ({error.strerror or error})"
        raise (OSError(said) if error.errno is None else OSError(error.errno, said)) from None


class _Pipeline:
    """One thread reads ahead, this one computes, another writes what is done."""

    def __init__(self, job: Job, journal: Journal, threads: int, progress: Progress | None) -> None:
        self.job, self.journal, self.threads, self.progress = job, journal, threads, progress
        self.places = list(job.cuts)
        self.inputs, self.outputs = Buffers(), Buffers()
        self.stamp = job.source.stamp()
        self.saved = time.monotonic()
        self.written = journal.done

    def run(self) -> None:
        job, journal = self.job, self.journal
        with _naming(job.target.given):
            if journal.done:
                target = formats.reopen(job.target, journal.partial, job.layout, journal.mark)
            else:
                target = formats.create(job.target, journal.partial, job.layout)
        try:
            try:
                self._work(target)
            except BaseException:
                # What was written before is kept, unless that fails too.
                with suppress(OSError):
                    self._save(target)
                raise
            with _naming(job.target.given):
                self._save(target)
        finally:
            target.close()
        if job.source.stamp() != self.stamp:
            raise ValueError(f"{job.source.path}: was changed while it was read; nothing was written")

    def _work(self, target: Target) -> None:
        todo = range(self.journal.done, len(self.places))
        reader, writer = ThreadPoolExecutor(1, "algdiff-read"), ThreadPoolExecutor(1, "algdiff-write")
        try:
            coming: Future[Any] | None = reader.submit(self._read, todo[0]) if todo else None
            going: Future[Any] | None = None
            for index in todo:
                assert coming is not None  # noqa: S101
                x, times = coming.result()
                coming = reader.submit(self._read, index + 1) if index + 1 < len(self.places) else None
                result = self._compute(index, x)
                if going is not None:
                    going.result()
                going = writer.submit(self._write, target, index, result, times)
            if going is not None:
                going.result()
        finally:
            for pool in (reader, writer):
                pool.shutdown(wait=True, cancel_futures=True)

    def _read(self, index: int) -> tuple[Samples, Samples | None]:
        job, place = self.job, self.places[index]
        start, end = job.reads(place)
        shape = [one.stop - one.start for one in place]
        shape[job.axis] = end - start
        x = self.inputs.take(index, tuple(shape), job.source.dtype, fortran=job.source.fortran)
        with _naming(str(job.source.path), "read"):
            return x, job.read(place, x)

    def _compute(self, index: int, x: Samples) -> Samples:
        job, place = self.job, self.places[index]
        shape = (len(job.layout.orders), *(one.stop - one.start for one in place))
        result = self.outputs.take(index, shape, job.layout.dtype, fortran=job.source.fortran, leading=1)
        job.compute(place, x, result, self.threads, self._fraction(index))
        if self.progress is not None:
            self.progress((index + 1) / len(self.places))
        return result

    def _fraction(self, index: int) -> Progress | None:
        progress, count = self.progress, len(self.places)
        return None if progress is None else lambda fraction: progress((index + fraction) / count)

    def _write(self, target: Target, index: int, result: Samples, times: Samples | None) -> None:
        with _naming(self.job.target.given):
            self.job.write(target, self.places[index], result, times)
            self.written = index + 1
            if time.monotonic() >= self.saved + INTERVAL:
                self._save(target)

    def _save(self, target: Target) -> None:
        """Make durable what is written, and note it."""
        mark = target.sync()
        if self.written > self.journal.done:
            self.journal.note(self.written, mark)
        self.saved = time.monotonic()
