"""A file differentiated into another by the workers of a cluster: tasks that read, compute and write regions alone."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from algdiff import _formats as formats
from algdiff import _threads as threads_of
from algdiff._file_job import Job, Spec
from algdiff._file_run import journal_of
from algdiff._journal import Journal

if TYPE_CHECKING:
    from algdiff._arguments import Progress

SHARES = 8
"""Tasks for every thread of the cluster: enough for fast workers to take over from slow ones."""


class Common(NamedTuple):
    """What every task needs to know.

    Attributes
    ----------
    spec : Spec
        What is asked for, with absolute paths.
    partial : str
        The unfinished output.
    stamp : list of int
        Size and time of the input.
    threads : int or None
        Threads for each task; None for one.
    """

    spec: Spec
    partial: str
    stamp: list[int]
    threads: int | None


def region(common: Common, first: int, last: int) -> int:
    """Read, compute and write the blocks from `first` to `last`, durably; return their number.

    A task whose worker is lost runs again, and writes the same bytes.
    """
    spec = common.spec
    with formats.open_source(spec.origin, spec.options) as source:
        job = Job(source, spec)
        if job.stamp != common.stamp:
            raise ValueError(
                f"{source.path}: must be the file of the run for every worker, got another or a changed one"
            )
        with closing(formats.reopen(job.target, Path(common.partial), job.layout, 0)) as target:
            for place in itertools.islice(job.cuts, first, last):
                job.write(target, place, *job.block(place, threads_of.count(common.threads)))
            target.sync()
    return last - first


def run(
    client: Any,
    job: Job,
    *,
    overwrite: bool,
    resume: bool,
    threads: int | None,
    progress: Progress | None,
) -> int:
    """Let the workers of `client` do a job; see `_file_run.run`."""
    for name, place in (("src", job.spec.origin), ("dst", job.target)):
        if place.form.staged or place.form.name == "csv":
            raise ValueError(f"{name} must be of a format with regions (npy, raw, hdf5, zarr), got {place.given}")
    with journal_of(job, overwrite=overwrite, resume=resume) as journal:
        before = journal.done
        if not before:
            formats.create(job.target, journal.partial, job.layout).close()
        common = Common(_everywhere(job.spec), str(journal.partial), job.stamp, threads)
        _work(client, common, journal, len(job.cuts), progress)
    return before


def _everywhere(spec: Spec) -> Spec:
    """Return `spec` with paths that do not depend on the folder of a process."""
    origin, target = (place._replace(path=place.path.absolute()) for place in (spec.origin, spec.target))
    return spec._replace(origin=origin, target=target)


def tasks(common: Common, bounds: Sequence[tuple[int, int]]) -> list[Any]:
    """Return one lazy task for every pair of bounds; what they have in common is in their graph once."""
    from dask.delayed import delayed

    shared = delayed(common, pure=False, traverse=False)
    return [delayed(region, pure=False)(shared, first, last) for first, last in bounds]


def _work(client: Any, common: Common, journal: Journal, blocks: int, progress: Progress | None) -> None:
    from distributed import KilledWorker, as_completed

    todo = blocks - journal.done
    if not todo:
        return
    count = min(todo, SHARES * max(sum(client.nthreads().values()), 1))
    bounds = list(itertools.pairwise(journal.done + todo * share // count for share in range(count + 1)))
    futures = client.compute(tasks(common, bounds))
    ends = {future.key: pair for future, pair in zip(futures, bounds, strict=True)}
    try:
        waiting = list(bounds)
        completed = as_completed(futures, with_results=True)  # type: ignore[no-untyped-call, unused-ignore]
        for finished, (future, _) in enumerate(completed, 1):
            waiting.remove(ends[future.key])
            # A later run goes on before the first region that is missing.
            safe = waiting[0][0] if waiting else blocks
            if safe > journal.done:
                journal.note(safe, 0)
            if progress is not None:
                progress(finished / count)
    except KilledWorker as error:
        raise OSError(
            f"{common.spec.target.given}: its workers were lost again and again ({error}): use less memory, "
            "and resume=True to go on"
        ) from None
    except BaseException:
        _settle(client, futures)
        raise
    finally:
        client.cancel(futures)


def _settle(client: Any, futures: list[Any]) -> None:
    """Cancel what has not begun, and wait for what has: it writes into an output that the next run may begin again."""
    from distributed import wait

    running = {key for keys in client.processing().values() for key in keys}
    client.cancel([future for future in futures if future.key not in running])
    wait([future for future in futures if future.key in running])  # type: ignore[no-untyped-call, unused-ignore]
