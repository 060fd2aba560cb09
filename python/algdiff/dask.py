"""Arrays of Dask: `differentiate` and designs take them as they are, and return Dask arrays.

The call computes nothing but a `t` of Dask, the times of one row. The result has the chunks of `x`, in mode "valid" as
far as there are outputs; with the engine "direct" it has the bits of the call in memory, while other engines and fits
agree with that to rounding. Chunks along the axis that are shorter than the window's reach are computed together.

All keywords work but `at`, `period`, `out` and `progress`, and `return_std` needs `sigma` or `autocovariance`: these
would need whole rows. Uneven times are always fitted, even if they jitter so lightly that the call in memory corrects
its estimates instead, to less than a tenth of their standard deviation. What is wrong with samples, weights or `sigma`
is found when they are computed.

Here is what else Dask takes: `overlap_depth` says how far windows reach, for an overlap of one's own, and
`differentiate_paths` lets the workers of a cluster differentiate a file. Dask itself is not imported.

>>> from algdiff import Differentiator
>>> from algdiff.dask import overlap_depth
>>> overlap_depth(Differentiator(101))
(50, 50)
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, SupportsIndex

from algdiff import _dask_paths
from algdiff._dask import depth
from algdiff._differentiator import Differentiator
from algdiff._file import FileReport, asked, differentiate_file
from algdiff._refusals import shown
from algdiff._run import MODES
from algdiff._wish import chosen

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["differentiate_paths", "overlap_depth"]


def overlap_depth(design: Differentiator, mode: str = "fit") -> tuple[int, int]:
    """Return how many samples before and after its own an estimate reads.

    Parameters
    ----------
    design : Differentiator
        The design.
    mode : {"fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"}
        As in a call of the design. In mode "valid" the window of an output starts with its own sample. At the ends of a
        row "fit" takes whole windows, so that each end needs a chunk of at least ``max(depth) + 1`` samples.

    Returns
    -------
    before, after : int
        A depth of `dask.array.overlap.overlap`, whose `boundary` must be "none".

    Raises
    ------
    ValueError
        `mode` does not exist.
    TypeError
        `design` is no `Differentiator`.

    Examples
    --------
    >>> from algdiff import Differentiator
    >>> from algdiff.dask import overlap_depth
    >>> overlap_depth(Differentiator(101, tau="newest")), overlap_depth(Differentiator(101), "valid")
    ((100, 0), (0, 100))
    """
    chosen("mode", mode, MODES)
    if not isinstance(design, Differentiator):
        raise TypeError(f"design must be a Differentiator, got {shown(design)}")
    return depth(design._plan, mode)


def differentiate_paths(
    client: Client,
    src: str | os.PathLike[str],
    dst: str | os.PathLike[str],
    window_length: SupportsIndex,
    deriv: SupportsIndex | Sequence[SupportsIndex] = 1,
    **options: Any,
) -> FileReport:
    """Let the workers of a cluster differentiate a file into another.

    Every task reads a region of the input with what its windows need around it, and writes its own region of the
    output: nothing goes from worker to worker, and a task whose worker is lost just runs again elsewhere. All workers
    must see both paths. The output grows under the name ``dst.partial``, as with `differentiate_file`.

    Parameters
    ----------
    client : distributed.Client
        The cluster.
    src, dst : path
        Input and output, of formats with regions: ``.npy``, raw binary, HDF5, Zarr.
    window_length : int
        Number of samples in the window.
    deriv : int or sequence of int
        Order of the derivative, or several.
    **options
        Of `differentiate_file`; ``memory`` is for each task, and ``threads`` is 1 unless it is given.

    Returns
    -------
    FileReport
        What was done.

    Raises
    ------
    ValueError, TypeError, OSError
        As `differentiate_file` does; and for other formats.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> import algdiff
    >>> from algdiff.dask import differentiate_paths
    >>> from distributed import Client
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> np.save(folder / "x.npy", np.arange(10_000.0))
    >>> with Client(processes=False, n_workers=1, threads_per_worker=2, dashboard_address="127.0.0.1:0") as client:
    ...     report = differentiate_paths(client, folder / "x.npy", folder / "v.npy", 101, fs=100)
    >>> bool(np.allclose(np.load(folder / "v.npy"), 100))
    True
    """
    if not (hasattr(client, "nthreads") and hasattr(client, "compute")):
        raise TypeError(f"client must be a distributed.Client, got {shown(client)}")
    bound = inspect.signature(differentiate_file).bind(src, dst, window_length, deriv, **options)
    bound.apply_defaults()
    return asked(partial(_dask_paths.run, client), **bound.arguments)
