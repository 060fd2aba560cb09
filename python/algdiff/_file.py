"""Files differentiated into files, whatever their size."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np
from numpy.typing import DTypeLike

from algdiff import _arguments as arguments
from algdiff import _formats as formats
from algdiff import _threads as threads_of
from algdiff._differentiator import Differentiator
from algdiff._file_job import PLAIN, Job, Missing, Spec
from algdiff._file_run import run
from algdiff._formats.base import Options
from algdiff._output import check_output
from algdiff._places import MEMORY
from algdiff._refusals import shown
from algdiff._run import MODES

if TYPE_CHECKING:
    from algdiff._arguments import Progress

LEAST_MEMORY = 1 << 20

DESIGN = ("deriv", "degree", "kappa", "mu", "tau", "delay", "rule", "trim", "engine")
"""Arguments of a design, but for its window and its step."""

Runner = Callable[..., int]


@dataclass(frozen=True)
class FileReport:
    """What `differentiate_file` did, or with ``dry_run=True`` would do.

    Attributes
    ----------
    source, target : str
        Input and output, as they were given.
    shape, dtype : tuple of int, str
        Shape and type of the input.
    result_shape, result_dtype : tuple of int, str
        Shape and type of the output; several orders along a leading axis.
    axis : int
        The axis of time in the input, counted from the front.
    delta : float or None
        The sampling step in seconds; None if neither the caller nor the file says it, and it counts as 1.
    window_length, deriv, delay, noise_gain, engine
        Of the design; see `Differentiator`.
    blocks, block_shape : int, tuple of int
        How many blocks the output is made of, and the shape of the usual one.
    resumed : int
        How many of them an earlier run had finished.
    memory : int
        Bytes of the buffers.
    bytes_read, bytes_written : int
        Bytes of the numbers in input and output, without what formats add or compress.
    seconds : float
        Time taken; of a dry run an estimate, from reading and computing one block.
    dry_run : bool
        Whether nothing was written.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> import algdiff
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> np.save(folder / "x.npy", np.zeros((2, 1000)))
    >>> plan = algdiff.differentiate_file(folder / "x.npy", folder / "y.npy", 21, dry_run=True)
    >>> plan.result_shape, plan.blocks, plan.bytes_written
    ((2, 1000), 1, 16000)
    """

    source: str
    target: str
    shape: tuple[int, ...]
    dtype: str
    result_shape: tuple[int, ...]
    result_dtype: str
    axis: int
    delta: float | None
    window_length: int
    deriv: int | tuple[int, ...]
    delay: float
    noise_gain: float | tuple[float, ...]
    engine: str
    blocks: int
    block_shape: tuple[int, ...]
    resumed: int
    memory: int
    bytes_read: int
    bytes_written: int
    seconds: float
    dry_run: bool

    def to_dict(self) -> dict[str, Any]:
        """Return the attributes as JSON can hold them."""
        return asdict(self)


def differentiate_file(
    src: str | os.PathLike[str],
    dst: str | os.PathLike[str],
    window_length: SupportsIndex,
    deriv: SupportsIndex | Sequence[SupportsIndex] = 1,
    *,
    degree: SupportsIndex | None = None,
    kappa: float = 1.0,
    mu: float = 1.0,
    tau: float | str | None = None,
    delay: float | None = None,
    delta: float | None = None,
    fs: float | None = None,
    rule: str = "exact",
    trim: float = 0.0,
    engine: str = "auto",
    axis: int | None = None,
    mode: str = "fit",
    cval: complex = 0.0,
    nan_policy: str = "propagate",
    min_support: SupportsIndex | None = None,
    max_gain: float | None = None,
    columns: Sequence[str | int] | None = None,
    time: str | int | None = None,
    key: str | None = None,
    dtype: DTypeLike | None = None,
    channels: int | None = None,
    offset: int = 0,
    overwrite: bool = False,
    resume: bool = False,
    dry_run: bool = False,
    memory: int = MEMORY,
    threads: int | None = None,
    progress: Progress | None = None,
) -> FileReport:
    """Differentiate a file of any size into another, with flat memory.

    Blocks are read, computed and written at the same time. The output grows under the name ``dst.partial``, with a
    journal beside it, and gets its own name when it is whole and on the disk. The estimates are those of
    `differentiate` on the whole array: with the engine "direct" to the bit; "moments" and "fft", which "auto" may take,
    agree with it to rounding.

    Parameters
    ----------
    src, dst : path
        Input and output; the suffix says the format: ``.npy``, ``.npz``, ``.csv``, raw binary ``.bin``, ``.raw`` or
        ``.dat``, HDF5 ``.h5`` or ``.hdf5`` and Zarr ``.zarr`` (both with the array after a colon, as in
        ``file.h5:/group/x``, if there are several), ``.parquet``, ``.wav``, and as an input ``.flac``.
    window_length : int
        Number of samples in the window.
    deriv : int or sequence of int
        Order of the derivative; several are computed in one pass, and lie along a leading axis of the output, or in
        columns of their own with names as ``x_d1``.
    degree, kappa, mu, tau, delay, rule, trim, engine
        See `Differentiator`.
    delta, fs : float, optional
        Sampling step in seconds, or rate in Hz. By default what the file states, or 1.
    axis : int, optional
        The axis of time; by default the rows of tables and the samples of raw and audio files, and else the last.
    mode, cval
        What happens at the ends; see `differentiate`.
    nan_policy, min_support, max_gain
        What missing samples do; see `differentiate`. Windows that are fitted agree with those in memory to rounding.
    columns : sequence of str or int, optional
        Columns of a table, by name or by position from 0; by default all, of a Parquet file all that hold numbers.
    time : str or int, optional
        The column of a ``.csv`` or ``.parquet`` file that holds the times of its rows: ascending and even, to a
        thousandth of a step and the digits that are printed; in seconds, or as dates with a time of day. They say the
        step, instead of `delta` or `fs`, and stand in front of the estimates in an output that is a table.
    key : str, optional
        Name of the array in an ``.npz`` file.
    dtype : dtype, optional
        Type of the numbers in a raw file.
    channels : int, optional
        Channels of a raw file, which alternate sample by sample; without, it is one-dimensional.
    offset : int
        Bytes before the first number of a raw file.
    overwrite : bool
        Whether `dst`, or what an interrupted run left of it, may be replaced. Files are replaced whole; one that holds
        other arrays as well is not.
    resume : bool
        Whether to go on with what an interrupted run left. It is believed only if the size and the time of the input,
        the design and the blocks are the same; if not, that is a warning, and the run begins again.
    dry_run : bool
        Whether to check everything and write nothing.
    memory : int
        Bytes that the run may use, about; at least 1 MiB. Buffers take what interpreter and readers leave.
    threads : int, optional
        At most this many threads compute; see `differentiate`. One more reads, one more writes.
    progress : callable, optional
        Called now and then with the fraction that is done.

    Returns
    -------
    FileReport
        What was done.

    Raises
    ------
    ValueError, TypeError
        The input holds no numbers or not all that it promises, was changed during the run, does not state what was not
        given, or `dst` cannot hold the result; or an argument is none that `differentiate` takes.
    FileExistsError
        `dst` exists, or what is left of an interrupted run, and nothing was said of it.
    OSError
        A file cannot be read or written. What is finished stays for `resume`.
    ImportError
        A package that the format needs is not installed; the message says which.
    MemoryError
        The buffers do not fit into memory.

    Warns
    -----
    UserWarning
        What an interrupted run left is not of this run.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> import algdiff
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> t = np.arange(10_000) * 1e-3
    >>> np.save(folder / "x.npy", np.sin(t))
    >>> report = algdiff.differentiate_file(folder / "x.npy", folder / "v.npy", 101, fs=1000)
    >>> report.blocks, report.delay
    (1, 0.05)
    >>> bool(np.allclose(np.load(folder / "v.npy"), np.cos(t), atol=1e-5))
    True
    """
    return asked(**{**locals(), "runner": run})


def asked(
    runner: Runner,
    src: Any,
    dst: Any,
    window_length: Any,
    delta: Any,
    fs: Any,
    columns: Any,
    time: Any,
    key: str | None,
    dtype: Any,
    channels: Any,
    offset: Any,
    nan_policy: Any,
    min_support: Any,
    max_gain: Any,
    **words: Any,
) -> FileReport:
    """Do what `differentiate_file` does, all of whose arguments are given, by a `runner` (see `differentiate_with`)."""
    given = arguments.sampling_step(delta, fs) if (delta, fs) != (None, None) else None
    design = {name: words.pop(name) for name in DESIGN}
    return differentiate_with(
        lambda step: Differentiator(window_length, delta=1.0 if step is None else step, **design),
        Options(
            key=key,
            columns=None if columns is None else tuple(map(str, columns)),
            time=None if time is None else str(time),
            dtype=None if dtype is None else arguments.any_dtype("dtype", dtype),
            channels=None if channels is None else arguments.integer("channels", channels, 1),
            offset=arguments.integer("offset", offset, 0),
        ),
        src,
        dst,
        step=given,
        missing=Missing(nan_policy, min_support, max_gain),
        runner=runner,
        **words,
    )


def differentiate_with(
    make: Callable[[float | None], Differentiator],
    options: Options,
    src: Any,
    dst: Any,
    *,
    step: float | None,
    axis: int | None = None,
    mode: str = "fit",
    cval: complex = 0.0,
    overwrite: bool = False,
    resume: bool = False,
    dry_run: bool = False,
    missing: Missing = PLAIN,
    memory: int = MEMORY,
    threads: int | None = None,
    progress: Progress | None = None,
    runner: Runner = run,
) -> FileReport:
    """Do what `differentiate_file` does with the design that `make` returns for a sampling step, None if unknown.

    `runner` does the work and returns how many blocks were finished before: `_file_run.run`, or the same elsewhere.
    """
    origin, target = formats.located("src", src), formats.located("dst", dst)
    check(origin, target, options)
    memory = arguments.integer("memory", memory, LEAST_MEMORY)
    if mode not in MODES:
        raise ValueError(f"mode must be one of {', '.join(map(repr, MODES))}, got {shown(mode)}")
    if step is not None and options.time is not None:
        raise ValueError("give time, delta or fs, one of them: got time and another")
    check_output(target.path, overwrite, store=target.form.name == "zarr")
    if overwrite and target.path.exists():
        formats.check_others(target)
    if origin.path.exists() and not (origin.path.is_file() or origin.path.is_dir()):
        raise ValueError(f"{origin.given}: must be a file, got a pipe or a device")
    started = time.perf_counter()
    options = replace(options, memory=memory)
    with formats.open_source(origin, options) as source:
        if not source.shape:
            raise ValueError(f"{origin.given} must hold an array of at least one dimension, got a scalar")
        along = arguments.axis_index(source.axis if axis is None else axis, len(source.shape))
        known = source.step_along(along) if step is None else step
        design = make(known)
        job = Job(source, Spec(origin, target, options, design, along, mode, cval, known is not None, memory, missing))
        resumed = 0
        if dry_run:
            seconds = _estimate(job, threads)
        else:
            resumed = runner(job, overwrite=overwrite, resume=resume, threads=threads, progress=progress)
            seconds = time.perf_counter() - started
        return _report(job, seconds, resumed, dry_run=dry_run)


def check(origin: formats.Located, target: formats.Located, options: Options) -> None:
    """Raise ValueError for arguments that exclude each other, whatever the files hold."""
    if os.path.realpath(origin.path) == os.path.realpath(target.path) or (
        origin.path.exists() and target.path.exists() and origin.path.samefile(target.path)
    ):
        raise ValueError(f"dst must be another file than src, got {target.given}")
    if not target.form.writes:
        raise ValueError(f"dst must be of a format that can be written, got {target.given}")
    if options.columns is not None and origin.form.name not in ("csv", "parquet", "audio"):
        raise ValueError(f"columns is for a .csv, .parquet or audio file, got {origin.given}")
    if options.time is not None and origin.form.name not in ("csv", "parquet"):
        raise ValueError(f"time is for a .csv or .parquet file, got {origin.given}")
    for name in ("dtype", "channels"):
        if getattr(options, name) is not None and origin.form.name != "raw":
            raise ValueError(f"{name} is for raw numbers, got {origin.given}")
    if options.offset and origin.form.name != "raw":
        raise ValueError(f"offset is for raw numbers, got {origin.given}")
    if options.key is not None and "npz" not in (origin.form.name, target.form.name):
        raise ValueError(f"key is for a .npz file, got {origin.given} and {target.given}")


def _estimate(job: Job, threads: int | None) -> float:
    """Return how long the run will take, from reading and computing one block."""
    places = iter(job.cuts)
    place = next(places, None)
    if place is None:
        return 0.0
    place = next(places, place)
    started = time.perf_counter()
    job.block(place, threads_of.count(threads))
    return (time.perf_counter() - started) * len(job.cuts)


def _report(job: Job, seconds: float, resumed: int, *, dry_run: bool) -> FileReport:
    source, layout, design = job.source, job.layout, job.design
    return FileReport(
        source=job.spec.origin.given,
        target=job.target.given,
        shape=source.shape,
        dtype=source.dtype.name,
        result_shape=layout.full_shape,
        result_dtype=layout.dtype.name,
        axis=job.axis,
        delta=layout.step,
        window_length=design.window_length,
        deriv=design.deriv,
        delay=design.delay,
        noise_gain=design.noise_gain,
        engine=design.engine_for(source.dtype),
        blocks=len(job.cuts),
        block_shape=job.cuts.extents,
        resumed=resumed,
        memory=job.cuts.bytes,
        bytes_read=int(np.prod(source.shape, dtype=object)) * source.dtype.itemsize,
        bytes_written=layout.nbytes,
        seconds=seconds,
        dry_run=dry_run,
    )
