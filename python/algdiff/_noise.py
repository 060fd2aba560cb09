"""The level of the noise in samples of a smooth signal, from differences of neighbours on a robust scale."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments

Floats = NDArray[np.float64]
Counts = NDArray[np.intp]

MAX_ORDER = 20
"""The highest order of the differences."""

_QUARTILE = 0.6744897501960817
"""The median of the modulus of a standard normal variable."""

_CLIP = 3.0
"""Differences beyond this many scales are left out."""

_CONSISTENCY = 1.027393469477902
"""One over the variance of a standard normal variable given that its modulus is at most 3."""

_STEPS = 50
"""At most so many steps to the scale: a bound for data made to delay it."""

_GROUP = 1 << 18
"""About this many numbers are worked on at a time."""

_CHUNK = 1 << 15
"""About this many differences get their coefficients at a time."""


def noise_level(
    x: ArrayLike,
    *,
    t: ArrayLike | None = None,
    axis: SupportsIndex = -1,
    order: SupportsIndex = 3,
    weights: ArrayLike | None = None,
    local: SupportsIndex | None = None,
) -> float | Floats:
    """Estimate the standard deviation of white noise in samples of a smooth signal.

    The samples are differenced `order` times, which removes every polynomial of degree below `order` and nearly all of
    a signal that is smooth from sample to sample; what is left is noise. Its scale is a root mean square over the
    differences of at most three scales, so that a few outliers do little harm.

    Parameters
    ----------
    x : array_like
        Samples, real or complex. NaN, infinite and masked samples are left out: differences are taken over consecutive
        samples that are there, at their own places.
    t : array_like, optional
        Time stamps of shape ``(x.shape[axis],)``, strictly ascending or descending; default evenly spaced samples.
    axis : int
        The axis of time in `x`.
    order : int
        Order of the differences, from 1 to 20.
    weights : array_like, optional
        Inverse variances of shape ``(x.shape[axis],)`` or that of `x`: a sample of weight w has the level over
        ``sqrt(w)``. A sample of weight 0 is left out.
    local : int, optional
        Estimate the level at every sample from about this many samples around it; at least ``5 * (order + 1)``, of
        whose differences one outlier spoils a fifth.

    Returns
    -------
    float or ndarray of float64
        The level in the unit of `x`: a float for one dimension, otherwise an array in the shape of `x` without
        `axis`; with `local`, an array in the shape of `x`. NaN where there are fewer than ``order + 1`` samples. Of
        complex samples it is ``sqrt(E|e|**2)``, from the levels of the two parts.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    See Also
    --------
    Differentiator.noise_gain : The variance of a derivative over that of the samples.

    Notes
    -----
    For normal noise on n evenly spaced samples the relative standard error is ``sqrt(1.27 / n)`` at order 3, and
    ``sqrt(0.83 / n)``, ``sqrt(1.07 / n)``, ``sqrt(1.44 / n)``, ``sqrt(1.59 / n)`` at orders 1, 2, 4, 5; with `local`,
    take it for n. Uneven time stamps change it little: ``sqrt(1.44 / n)`` for stamps at random, order 3. The mean of
    the estimate is low by about half the squared standard error.

    A higher order removes more of the signal. What the differences leave of a signal counts as noise; of filtered or
    interpolated noise, whose neighbours are alike, they show a part only, and the level comes out too small.

    One outlier spoils ``order + 1`` differences. Up to a fifth of spoiled differences, that is outliers in 5 percent of
    the samples at order 3, change the result of a long signal by less than a tenth; towards a half the estimate breaks
    down.

    Where more than half of the differences vanish up to the rounding of `x`, as for a coarsely quantised signal at
    rest, a clipped scale would be zero. The result is then the root mean square of the differences, vanishing or not,
    of at most three scales of those that do not vanish. Lone outliers in samples without noise therefore count as
    noise; samples without noise or outliers give zero up to rounding.

    With `local`, the level is found in blocks of `local` differences that overlap by half, and interpolated linearly
    from center to center; beyond the outer centers it is constant. A sample that is missing has the level between
    those of its neighbours.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import noise_level
    >>> t = np.linspace(0, 1, 1001)
    >>> noise = 0.1 * np.random.default_rng(0).standard_normal(t.size)
    >>> x = np.sin(2 * np.pi * t) + noise
    >>> print(f"{noise_level(x):.2f}")
    0.10
    >>> x[::100] = 50
    >>> print(f"{noise_level(x):.2f}")
    0.10

    A level that doubles halfway:

    >>> level = noise_level(np.sin(2 * np.pi * t) + np.where(t < 0.5, 1, 2) * noise, local=200)
    >>> print(level[[200, 800]].round(1))
    [0.1 0.2]
    """
    with np.errstate(over="ignore"):
        samples = arguments.samples("x", np.ma.getdata(x) if isinstance(x, np.ma.MaskedArray) else x)
    axis = arguments.axis_index(axis, samples.ndim)
    order = _order(order)
    block = None if local is None else arguments.integer("local", local, 5 * (order + 1))
    length = samples.shape[axis]
    stamps = None if t is None else _stamps(t, length)
    shares = None if weights is None else _shares(weights, samples.shape, axis)
    there = np.isfinite(samples)
    if isinstance(x, np.ma.MaskedArray):
        there &= ~np.ma.getmaskarray(x)
    if shares is not None:
        there &= np.moveaxis(np.broadcast_to(shares > 0, np.moveaxis(samples, axis, -1).shape), -1, axis)
    levels = _by_groups(_rows(samples, axis), _rows(there, axis), stamps, shares, order, block)
    outer = samples.shape[:axis] + samples.shape[axis + 1 :]
    if block is not None:
        return np.ascontiguousarray(np.moveaxis(levels.reshape(*outer, length), -1, axis))
    return levels.reshape(outer) if outer else float(levels[0])


def _order(value: SupportsIndex) -> int:
    """Return the order of the differences."""
    order = arguments.integer("order", value, 1)
    if order > MAX_ORDER:
        raise ValueError(f"order must be an integer from 1 to {MAX_ORDER}, got {order}")
    return order


def _stamps(t: ArrayLike, length: int) -> Floats:
    """Return the time stamps in one row."""
    stamps, shape = arguments.points("t", t)
    if shape != (length,):
        raise ValueError(f"t must have shape {(length,)}, one time stamp per sample along axis, got {shape}")
    if not np.isfinite(stamps).all():
        raise ValueError(f"t must be finite, got {stamps[~np.isfinite(stamps)][0]}")
    with np.errstate(over="ignore"):
        steps = np.diff(stamps)
        if length and not np.isfinite(stamps[-1] - stamps[0]):
            raise ValueError(f"t must span a finite range, got {stamps[0]} to {stamps[-1]}")
    wrong = ~(steps * np.sign(steps[:1]) > 0)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ValueError(
            f"t must be strictly ascending or descending, got {stamps[at]} and {stamps[at + 1]} at {at} and {at + 1}"
        )
    return stamps[None]


def _shares(weights: ArrayLike, shape: tuple[int, ...], axis: int) -> Floats:
    """Return the weights, their last axis along time."""
    shares, given = arguments.points("weights", weights)
    if given not in ((shape[axis],), shape):
        raise ValueError(f"weights must have shape {(shape[axis],)} or that of x, {shape}, got {given}")
    wrong = ~(np.isfinite(shares) & (shares >= 0))
    if wrong.any():
        raise ValueError(f"weights must be finite and not negative, got {shares[wrong][0]}")
    return np.moveaxis(shares.reshape(shape), axis, -1) if len(given) > 1 else shares


def _rows(array: NDArray[Any], axis: int) -> NDArray[Any]:
    """Return `array` as rows along `axis`."""
    turned = np.moveaxis(array, axis, -1)
    return turned.reshape(math.prod(turned.shape[:-1]), turned.shape[-1])


def _by_groups(
    x: NDArray[Any], there: NDArray[np.bool_], t: Floats | None, w: Floats | None, order: int, block: int | None
) -> Floats:
    """Return the level of every row, or of every sample, a group of rows at a time."""
    rows, length = x.shape
    levels = np.full(rows if block is None else x.shape, np.nan)
    shares = None if w is None else w.reshape(-1, length) if length else w.reshape(0, 0)
    if length <= order:
        return levels
    size = max(1, _GROUP // length)
    with np.errstate(over="ignore", under="ignore"):
        for start in range(0, rows, size):
            part = slice(start, start + size)
            weights = shares if shares is None or len(shares) < rows else shares[part]
            levels[part] = _group(x[part], there[part], t, weights, order, block)
    return levels


def _group(
    x: NDArray[Any], there: NDArray[np.bool_], t: Floats | None, w: Floats | None, order: int, block: int | None
) -> Floats:
    """Return the levels of some rows: the parts of complex samples lie along a leading axis."""
    unit = float(np.finfo(x.dtype).eps)
    parts = np.stack([x.real, x.imag]).astype(np.float64) if x.dtype.kind == "c" else x[None].astype(np.float64)
    parts[:, ~there] = 0.0
    # By a power of two, so that nothing overflows and nothing is rounded.
    scale = np.frexp(np.abs(parts).max(axis=-1, keepdims=True))[1]
    np.ldexp(parts, -scale, out=parts)
    packed = _packed(_Rows(parts, t, w), there)
    counts = np.maximum(there.sum(axis=-1) - order, 0)
    sizes = _differences(packed, order)
    np.abs(sizes, out=sizes)
    if not there.all():
        sizes[:, np.arange(sizes.shape[-1]) >= counts[:, None]] = np.inf
    floor = _Floor(packed, counts + order, math.sqrt(order + 1) * unit)
    if block is None:
        level = _scale(sizes[..., None, :], counts[:, None], floor)
        return _joined(np.ldexp(level, scale))[..., 0]
    cuts = _Cuts.of(counts, block, sizes.shape[-1])
    return cuts.interpolated(_joined(np.ldexp(cuts.levels(sizes, floor), scale)), there, order)


def _joined(levels: Floats) -> Floats:
    """Return the level of the samples from those of their parts."""
    joined: Floats = levels[0] if len(levels) == 1 else np.hypot(levels[0], levels[1])
    return joined


class _Rows(NamedTuple):
    """Samples, and their time stamps and weights for one or for all rows."""

    x: Floats
    t: Floats | None
    w: Floats | None


def _packed(rows: _Rows, there: NDArray[np.bool_]) -> _Rows:
    """Return the samples that are there at the front of their rows, in their order, with their places as `t`."""
    if there.all():
        return rows
    places = np.argsort(~there, axis=-1, kind="stable")
    x = np.take_along_axis(rows.x, places[None], axis=-1)
    t = places.astype(np.float64) if rows.t is None else rows.t[0][places]
    if rows.w is None:
        return _Rows(x, t, None)
    w = np.take_along_axis(np.broadcast_to(rows.w, there.shape), places, axis=-1)
    return _Rows(x, t, np.where(np.take_along_axis(there, places, axis=-1), w, 1.0))


def _differences(rows: _Rows, order: int) -> Floats:
    """Return the differences, scaled such that noise of level 1 at weight 1 gives them the variance 1."""
    x, t, w = rows
    if t is None and w is None:
        # The squares of the binomial coefficients of `order` add up to the middle one of 2 `order`.
        differences: Floats = np.diff(x, order, axis=-1)
        differences /= math.sqrt(math.comb(2 * order, order))
        return differences
    if t is None:
        t = np.arange(x.shape[-1], dtype=np.float64)[None]
    size = x.shape[-1] - order
    differences = np.zeros((*x.shape[:-1], size))
    step = max(1, _CHUNK // math.prod(x.shape[:-1]))
    for start in range(0, size, step):
        some = slice(start, min(size, start + step))
        wide = slice(start, some.stop + order)
        coefficients = _coefficients(t[:, wide], None if w is None else w[:, wide], order)
        # The coefficients add up to zero: summed by parts, a constant gives exactly zero.
        summed = np.cumsum(coefficients[:-1], axis=0)
        steps = -np.diff(x[..., wide], axis=-1)
        for j in range(order):
            differences[..., some] += summed[j] * steps[..., j : j + some.stop - start]
    return differences


def _coefficients(t: Floats, w: Floats | None, order: int) -> Floats:
    """Return the coefficients of the divided differences of unit noise, the first axis along a difference.

    They are one over the products of the gaps to the other stamps. Mantissas are multiplied and exponents added, so
    that clustered stamps neither overflow nor underflow.
    """
    count = t.shape[-1] - order
    mantissas = np.ones((order + 1, len(t) if w is None else max(len(t), len(w)), count))
    exponents = np.zeros(mantissas.shape, dtype=np.int32)
    for j in range(order + 1):
        for k in range(j):
            mantissa, exponent = np.frexp(t[:, j : j + count] - t[:, k : k + count])
            mantissas[j] *= mantissa
            mantissas[k] *= -mantissa
            exponents[j] += exponent
            exponents[k] += exponent
    # Over the root of its weight, a coefficient is the noise that its sample adds.
    roots = [] if w is None else [np.sqrt(w[:, j : j + count]) for j in range(order + 1)]
    for j, root in enumerate(roots):
        mantissa, exponent = np.frexp(root)
        mantissas[j] *= mantissa
        exponents[j] += exponent
    coefficients: Floats = np.ldexp(1.0 / mantissas, exponents.min(axis=0) - exponents)
    coefficients /= np.sqrt(np.square(coefficients).sum(axis=0))
    for j, root in enumerate(roots):
        coefficients[j] *= root
    return coefficients


class _Sorted:
    """Numbers put into ascending order along the last axis, in place, of which so many count."""

    def __init__(self, values: Floats, counts: Counts) -> None:
        values.sort(axis=-1)
        self.values = values
        self.counts = np.broadcast_to(counts, values.shape[:-1])

    def at(self, index: Counts, values: Floats | None = None) -> Floats:
        """Return the numbers at one index each, the nearest where there is none."""
        array = self.values if values is None else values
        index = np.clip(index, 0, array.shape[-1] - 1)
        return np.take_along_axis(array, index[..., None], axis=-1)[..., 0]

    def median(self, first: Counts | int = 0) -> Floats:
        """Return the medians of the numbers from `first` on."""
        total = first + self.counts
        return 0.5 * (self.at((total - 1) // 2) + self.at(total // 2))

    def up_to(self, bound: Floats) -> Counts:
        """Return how many numbers are at most `bound`, by bisection."""
        low, high = np.zeros(self.counts.shape, dtype=np.intp), np.array(self.counts, dtype=np.intp)
        for _ in range(self.values.shape[-1].bit_length()):
            middle = (low + high) // 2
            more = (self.at(middle) <= bound) & (low < high)
            low, high = np.where(more, middle + 1, low), np.where(more, high, middle)
        return low


class _Floor:
    """The differences that the rounding of the samples can make, found for the rows where it matters."""

    def __init__(self, rows: _Rows, counts: Counts, factor: float) -> None:
        # |sum a_j e_j| <= sqrt(order + 1) max sqrt(w_j) |e_j| for coefficients of unit noise.
        self._rows, self._counts, self._factor = rows, counts, factor
        most = 1.0 if rows.w is None else np.sqrt(rows.w.max(axis=-1))
        self.bound: Floats = factor * most * np.abs(rows.x).max(axis=-1)

    def typical(self) -> Floats:
        """Return the rounding of the median sample, which an outlier does not raise."""
        x, _, w = self._rows
        return self._factor * _Sorted(np.abs(x) if w is None else np.abs(x) * np.sqrt(w), self._counts).median()


def _scale(sizes: Floats, counts: Counts, floor: _Floor) -> Floats:
    """Return the robust scale of numbers of these sizes along the last axis; the second last is that of blocks."""
    ordered = _Sorted(sizes, counts)
    level = ordered.median() / _QUARTILE
    unit = np.where((level > 0) & (counts > 0), level, 1.0)
    squares = ordered.values / unit[..., None]
    sums = np.cumsum(np.square(squares, out=squares), axis=-1, out=squares)
    # A larger scale clips less and yields a larger scale, so from any start the steps go one way and end. For normal
    # noise a step leaves a tenth of the error.
    kept = ordered.up_to(_CLIP * level)
    for _ in range(_STEPS):
        mean = ordered.at(kept - 1, sums) / np.maximum(kept, 1)
        level = unit * np.sqrt(_CONSISTENCY * mean)
        kept, last = ordered.up_to(_CLIP * level), kept
        if np.array_equal(kept, last):
            break
    if np.any(level <= floor.bound[..., None]):
        typical = floor.typical()[..., None]
        zeros = ordered.up_to(np.broadcast_to(typical, level.shape))
        kept = ordered.up_to(_CLIP / _QUARTILE * ordered.median(zeros))
        at_rest = unit * np.sqrt(ordered.at(kept - 1, sums) / np.maximum(kept, 1))
        level = np.where((level <= typical) & (zeros < ordered.counts), at_rest, level)
    return np.where(ordered.counts > 0, level, np.nan)


class _Cuts(NamedTuple):
    """Blocks of differences that overlap by half, evenly spread over the counting ones of every row."""

    counts: Counts
    lengths: Counts
    blocks: Counts
    spacing: Floats

    @classmethod
    def of(cls, counts: Counts, block: int, most: int) -> _Cuts:
        """Return the blocks of rows with so many counting differences, of `most`."""
        lengths = np.minimum(counts, min(block, most))
        blocks = 1 + -(-(counts - lengths) // (block // 2))
        return cls(counts, lengths, blocks, (counts - lengths) / np.maximum(blocks - 1, 1))

    def levels(self, sizes: Floats, floor: _Floor) -> Floats:
        """Return the levels of the blocks along the last axis; a row of fewer blocks repeats its last one."""
        total, width = int(self.blocks.max()), int(self.lengths.max())
        levels = np.full((*sizes.shape[:-1], total), np.nan)
        step = max(1, _GROUP // max(1, sizes[..., 0].size * width))
        for start in range(0, total if width else 0, step):
            numbers = np.minimum(np.arange(start, min(total, start + step)), self.blocks[:, None] - 1)
            starts = np.rint(numbers * self.spacing[:, None]).astype(np.intp)
            index = (starts[..., None] + np.arange(width)).reshape(1, len(starts), -1)
            cut = np.take_along_axis(sizes, index, axis=-1).reshape(*sizes.shape[:-1], -1, width)
            levels[..., start : start + step] = _scale(cut, self.lengths[:, None], floor)
        return levels

    def interpolated(self, levels: Floats, there: NDArray[np.bool_], order: int) -> Floats:
        """Return the levels at the samples, linear between the centers of the blocks."""
        first = 0.5 * (self.lengths - 1 + order)
        places = np.cumsum(there, axis=-1, dtype=np.float64)
        places -= np.where(there, 1.0, 0.5)
        places -= first[:, None]
        places /= np.where(self.spacing > 0, self.spacing, 1.0)[:, None]
        np.clip(places, 0, self.blocks[:, None] - 1, out=places)
        left = places.astype(np.intp)
        places -= left
        places *= np.take_along_axis(np.diff(levels, axis=-1, append=levels[:, -1:]), left, axis=-1)
        places += np.take_along_axis(levels, left, axis=-1)
        return places
