"""Dask arrays: the same call, lazily, chunk by chunk.

Chunks along the axis of time are put together until none is shorter than what windows reach beyond it, get a halo from
their neighbours, and are differentiated as parts of their row. Other axes stay as they are. What windows do not show is
refused: it would need all chunks at once. Dask is imported only for its own arrays.
"""

from __future__ import annotations

import copy
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from algdiff import _arguments as arguments
from algdiff import _threads as threads_of
from algdiff._core import Plan
from algdiff._data import placed
from algdiff._refusals import shown
from algdiff._results import Estimates
from algdiff._row_parts import Blocks, estimated
from algdiff._run import run
from algdiff._times import Stamps
from algdiff._wish import Call, Windows, Wish, limits

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator

REFUSED = {
    "at": "estimates at other times may need any chunk; compute x first",
    "period": "turns are counted from the first sample on; compute x first",
    "out": "its result is lazy; store that, as by to_zarr",
    "progress": "its result is lazy; see dask.diagnostics.ProgressBar",
}
"""What cannot be asked of a lazy array, and why."""


def _array() -> Any:
    from dask import array

    return array


def is_dask(x: object) -> bool:
    """Return whether `x` is one of Dask's own collections; an array of xarray is not, whatever it holds."""
    return type(x).__module__.partition(".")[0] == "dask" and arguments.is_lazy(x)


def held(numbers: Any) -> Any:
    """Return numbers of one row, which memory can hold, as they are or computed."""
    return numbers.compute() if is_dask(numbers) else numbers


def depth(plan: Plan, mode: str) -> tuple[int, int]:
    """Return how many samples before and after its own an estimate reads."""
    if mode == "valid":
        return 0, plan.span - 1
    return max(plan.aligned_position, 0), max(plan.span - 1 - plan.aligned_position, 0)


def differentiate(design: Differentiator, x: Any, call: Call, wish: Wish) -> Any:
    """Return lazily what the same call returns of an array in memory; nothing of `x` is computed."""
    axis = _axis_of(x, call)
    _refuse(call, wish)
    samples = x.shape[axis]
    stamps = None if wish.t is None else Stamps(held(wish.t), samples)
    wish = wish._replace(autocovariance=held(wish.autocovariance))
    design, windows = placed(design, stamps, samples, wish)
    _check(design, windows, x, samples, call, wish)
    arrays = {"x": x, **_beside(x, axis, windows, stamps, wish)}
    if stamps is not None and stamps.descending:
        arrays = {name: _flipped(array, axis) for name, array in arrays.items()}
    halo = depth(design._plan, call.mode)
    least = max(halo) + 1
    if windows.times is not None and windows.duration is not None:
        halo, least = _reach(windows.times, design.tau, windows)
    masked = isinstance(x._meta, np.ma.MaskedArray)
    blocks = Blocks(design, samples, axis, halo, windows, call, wish, [*arrays][1:], masked, x.dtype)
    result = _mapped(blocks, arrays, least)
    if stamps is not None and stamps.descending:
        result = _flipped(result, axis + blocks.leading)
    chunks = _cut(x.chunks[axis], blocks.outputs)
    return _named(blocks, result.rechunk({axis + blocks.leading: chunks}))


def _axis_of(x: Any, call: Call) -> int:
    """Return the axis of time, if `x` is an array of numbers of known sizes."""
    if not isinstance(x, _array().Array):
        raise TypeError(f"x must be an array if it is lazy, got {type(x).__name__} of {type(x).__module__}")
    arguments.signal("x", np.empty((0,) * x.ndim, x.dtype))
    _known("x", x)
    return arguments.axis_index(call.axis, x.ndim)


def _known(name: str, array: Any) -> None:
    if any(math.isnan(size) for size in array.shape):
        raise ValueError(f"{name} must have chunks of known sizes, got shape {array.shape}; see compute_chunk_sizes")


def _refuse(call: Call, wish: Wish) -> None:
    """Refuse what needs more of a row than the windows show."""
    for name, value in {"at": wish.at, "period": wish.period, "out": call.out, "progress": call.progress}.items():
        if value is not None:
            raise ValueError(f"{name} must be left out with a Dask array, got {shown(value)}: {REFUSED[name]}")
    if wish.return_std and wish.sigma is None and wish.autocovariance is None:
        raise ValueError(
            "return_std must come with sigma or autocovariance with a Dask array, got neither: the noise level "
            "is found from whole rows; compute x first"
        )


def _check(design: Differentiator, windows: Windows, x: Any, samples: int, call: Call, wish: Wish) -> None:
    """Refuse at once what would be refused in memory, in the same words."""
    (arguments.number if x.dtype.kind == "c" else arguments.real)("cval", call.cval)
    threads_of.count(call.threads)
    if windows.duration is None:
        run(design._bank, design._plan, np.empty((0, samples)), mode=call.mode)
    limits(design, windows, samples, call, wish)


def _beside(x: Any, axis: int, windows: Windows, stamps: Stamps | None, wish: Wish) -> dict[str, Any]:
    """Return what comes with every sample, as arrays that go with `x`."""
    found: dict[str, Any] = {}
    t: Any = wish.t
    if stamps is not None and windows.times is not None:
        if is_dask(t):
            _known("t", t)
            clock = copy.copy(stamps)
            clock.values = clock.values[:0].copy()  # each block brings its own
            times = t.map_blocks(_times, clock=clock, dtype=np.float64, meta=np.empty(0))
            times = times.rechunk((x.chunks[axis],))
        else:
            values = windows.times[::-1] if stamps.descending else windows.times
            times = _array().from_array(values, chunks=(x.chunks[axis],))
        found["t"] = _along(times, axis, x.ndim)
    for name, given in (("weights", wish.weights), ("sigma", wish.sigma)):
        if given is not None and (is_dask(given) or np.ndim(given) or name == "weights"):
            found[name] = _per_sample(name, given, x, axis)
    return found


def _times(t: NDArray[Any], clock: Stamps) -> NDArray[np.float64]:
    return clock.located("t", t)


def _per_sample(name: str, given: Any, x: Any, axis: int) -> Any:
    """Return numbers for the samples of one row or of all."""
    array: Any = given if is_dask(given) else arguments.plain(name, given)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{name} must be real numbers, got dtype {array.dtype}")
    _known(name, array)
    along = (x.shape[axis],)
    if array.shape not in {along, x.shape}:
        raise ValueError(f"{name} must have shape {along} or that of x, {x.shape}, got {array.shape}")
    chunks = x.chunks if array.ndim == x.ndim else (x.chunks[axis],)
    array = array.rechunk(chunks) if is_dask(array) else _array().from_array(array, chunks=chunks)
    return array if array.ndim == x.ndim else _along(array, axis, x.ndim)


def _along(array: Any, axis: int, ndim: int) -> Any:
    """Return the numbers of one row as an array of `ndim` dimensions."""
    return array[tuple(slice(None) if index == axis else None for index in range(ndim))]


def _flipped(array: Any, axis: int) -> Any:
    return array[(*(slice(None),) * axis, slice(None, None, -1))]


def _reach(times: NDArray[np.float64], tau: float, windows: Windows) -> tuple[tuple[int, int], int]:
    """Return how many samples before and after its own a window of some duration holds, and the shortest block.

    A block that begins before its windows and ends after them does not shift them, so that there is a sample more at
    either end, and one for the rounding. Windows that the ends of the row shift are those of the first or last block.
    """
    assert windows.duration is not None  # noqa: S101
    own, length = np.arange(times.size), windows.duration

    def around(origin: NDArray[np.float64]) -> tuple[int, int]:
        before = own - np.maximum(np.searchsorted(times, origin, "left") - 2, 0)
        after = np.minimum(np.searchsorted(times, origin + length, "right") + 1, times.size - 1) - own
        return max(int(before.max()), 0), max(int(after.max()), 0)

    ideal = times - tau * length
    shifted = np.maximum(np.minimum(ideal, times[-1] + windows.pad - length), times[0] - windows.pad)
    halo = around(ideal)
    return halo, max(*halo, *around(shifted)) + 1


def _mapped(blocks: Blocks, arrays: dict[str, Any], least: int) -> Any:
    """Return what blocks of at least so many samples are mapped to."""
    x, axis = arrays["x"], blocks.axis
    chunks = _merged(x.chunks[axis], least)
    blocks.alone = len(chunks) == 1
    shares = [_with_halo(array, blocks, chunks) for array in arrays.values()]
    around = [list(sizes) for sizes in x.chunks]
    outputs = list(chunks)
    outputs[-1] -= blocks.samples - blocks.outputs
    around[axis] = outputs
    rows = [(blocks.rows,)] if blocks.leading else []
    return _array().map_blocks(
        estimated,
        *shares,
        blocks=blocks,
        dtype=blocks.dtype,
        meta=np.empty((0,) * (x.ndim + blocks.leading), blocks.dtype),
        chunks=(*rows, *map(tuple, around)),
        new_axis=[0] if blocks.leading else None,
    )


def _with_halo(array: Any, blocks: Blocks, chunks: tuple[int, ...]) -> Any:
    """Return `array` in `chunks` that overlap; those at the ends of periodic rows bring the other end along."""
    axis, (before, after) = blocks.axis, blocks.halo
    others = array.chunks
    if not blocks.alone and blocks.call.mode == "wrap":
        whole = (slice(None),) * axis
        last, first = array[(*whole, slice(blocks.samples - before, None))], array[(*whole, slice(0, after))]
        array = _array().concatenate([last, array, first], axis=axis)
        chunks = (before + chunks[0], *chunks[1:-1], chunks[-1] + after)
    array = array.rechunk((*others[:axis], chunks, *others[axis + 1 :]))
    if blocks.alone or not (before or after):
        return array
    return _array().overlap.overlap(array, depth={axis: (before, after)}, boundary={axis: "none"})


def _merged(chunks: tuple[int, ...], least: int) -> tuple[int, ...]:
    """Return `chunks` put together so that each holds at least so many samples, if all do."""
    sizes, size = [], 0
    for chunk in chunks:
        size += chunk
        if size >= least:
            sizes.append(size)
            size = 0
    if not sizes:
        return (size,)
    sizes[-1] += size
    return tuple(sizes)


def _cut(chunks: tuple[int, ...], outputs: int) -> tuple[int, ...]:
    """Return the first of `chunks`, as far as there are outputs."""
    if sum(chunks) == outputs:
        return chunks
    sizes: list[int] = []
    for chunk in chunks:
        sizes.append(min(chunk, outputs - sum(sizes)))
    return tuple(size for size in sizes if size)


def _named(blocks: Blocks, result: Any) -> Any:
    """Return the estimates, or those and more by name, of what the blocks gave as rows of one array."""
    if not blocks.more:
        return _masked(result, result) if blocks.masked else result
    wish, orders = blocks.wish, blocks.orders
    first, fields = 0, {}
    for name in ("estimate", *(name for name in ("std", "bias") if getattr(wish, f"return_{name}"))):
        part = result[first] if blocks.design._leading is None else result[first : first + orders]
        fields[name] = part.real if name == "std" else part
        first += orders
    if blocks.masked:
        fields = {name: _masked(part, fields["estimate"]) for name, part in fields.items()}
    if wish.return_support:
        fields["support"] = result[first].real.astype(np.int64)
    return Estimates(**fields)


def _masked(part: Any, estimate: Any) -> Any:
    return _array().ma.masked_array(part, _array().isnan(estimate))
