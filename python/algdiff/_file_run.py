"""One file differentiated into another, block by block: read, computed and written at the same time."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from algdiff import _formats as formats
from algdiff import _threads as threads_of
from algdiff._file_job import Buffers, Job
from algdiff._formats.base import Target
from algdiff._formats.stage import Stage
from algdiff._interrupts import Interrupts
from algdiff._journal import Journal
from algdiff._output import publish, remove

if TYPE_CHECKING:
    from algdiff._arguments import Progress, Samples

INTERVAL = 0.5
"""Seconds between checkpoints: what a crash may cost."""


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
    with journal_of(job, overwrite=overwrite, resume=resume) as journal:
        before = journal.done
        _Pipeline(job, journal, threads_of.count(threads), progress).run()
    return before


@contextmanager
def journal_of(job: Job, *, overwrite: bool, resume: bool) -> Iterator[Journal]:
    """Open the journal of a run; when all blocks are written, give the output its name.

    The journal is taken away when the run is finished or in vain, and left if there is something to go on with.
    """
    final = Path(os.path.realpath(job.target.path))
    partial = final.with_name(final.name + ".partial")
    with _naming(job.target.given):
        if partial.is_dir() and job.target.form.name != "zarr":
            raise FileExistsError(f"{partial}: must be free for the unfinished output, got a folder")
        for path in (partial, partial.with_name(f"{partial.name}.journal")):
            if path.is_symlink():  # which would have another file written
                raise FileExistsError(f"{path}: must be free for the unfinished output, got a link")
        journal = Journal(partial, job.header(), resume=resume, overwrite=overwrite)
    try:
        yield journal
        job.check_unchanged()
        with _naming(job.target.given):
            _finish(job, journal, final, overwrite)
    except (ValueError, TypeError):
        # Of the input or the arguments: there is nothing to go on with.
        journal.remove()
        raise
    except BaseException as error:
        if not journal.done or not journal.partial.exists():
            journal.remove()
            raise
        journal.close()
        kept = _kept(error, job, journal)
        if kept is error:
            raise
        raise kept from error
    journal.remove()


def _kept(error: BaseException, job: Job, journal: Journal) -> BaseException:
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
    kind = next((kind for kind in kinds if isinstance(error, kind)), None)
    return error if kind is None else kind(f"{error}; {hint}")


def _finish(job: Job, journal: Journal, final: Path, overwrite: bool) -> None:
    partial = journal.partial
    if not job.target.form.staged:
        publish(partial, final, overwrite)
        return
    encoded = partial.with_name(partial.name + ".encoded")
    stage = Stage(partial, job.layout, table=job.target.form.table)
    try:
        remove(encoded)  # or a link in its place, which would be followed
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
        self.places = job.cuts
        self.inputs, self.outputs = Buffers(), Buffers()
        self.interrupts = Interrupts()
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

    def _work(self, target: Target) -> None:
        reader, writer = ThreadPoolExecutor(1, "algdiff-read"), ThreadPoolExecutor(1, "algdiff-write")
        with self.interrupts:
            try:
                self._pass_on(target, reader, writer)
            finally:
                for pool in (reader, writer):
                    pool.shutdown(wait=True, cancel_futures=True)

    def _pass_on(self, target: Target, reader: ThreadPoolExecutor, writer: ThreadPoolExecutor) -> None:
        todo, result_of = range(self.journal.done, len(self.places)), self.interrupts.result
        coming: Future[Any] | None = reader.submit(self._read, todo[0]) if todo else None
        going: Future[Any] | None = None
        for index in todo:
            assert coming is not None  # noqa: S101
            x, times = result_of(coming)
            coming = reader.submit(self._read, index + 1) if index + 1 < len(self.places) else None
            result = self._compute(index, x)
            if going is not None:
                result_of(going)
            going = writer.submit(self._write, target, index, result, times)
        if going is not None:
            result_of(going)

    def _read(self, index: int) -> tuple[Samples, Samples | None]:
        with _naming(str(self.job.source.path), "read"):
            return self.job.samples(self.places[index], self.inputs, index)

    def _compute(self, index: int, x: Samples) -> Samples:
        progress = self._fraction(index)
        words: dict[str, Any] = {"threads": self.threads, "progress": progress}
        result = self.job.estimates(self.places[index], x, self.outputs, index, **words)
        progress(1.0)
        return result

    def _fraction(self, index: int) -> Progress:
        def progress(fraction: float) -> None:
            self.interrupts.check()
            if self.progress is not None:
                self.progress((index + fraction) / len(self.places))

        return progress

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
