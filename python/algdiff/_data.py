"""The samples of a call that asks for more, and what comes with them: times, weights, noise."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._noise import noise_level
from algdiff._refusals import shown
from algdiff._results import Estimates
from algdiff._times import Stamps, check_times, duration, even_length, nearest, usual_step
from algdiff._wish import Call, Windows, Wish, limits, uneven

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator


COUNTED = 2.0**53
"""Turns between two samples, at most: beyond, numbers of double precision skip some."""

BLOCKS, BLOCK = 16, 4096
"""How many blocks of how many samples the noise level of a long row is found from."""


class Data:
    """What a call works on, checked and in order: contiguous arrays along ascending times, NaN where one is missing.

    Attributes
    ----------
    design : Differentiator
        The design, for the step of even times.
    windows : Windows
        Where the windows lie.
    limits : Limits
        Which windows give an estimate.
    parts : list of (ndarray, float)
        The samples, or their real and imaginary parts, and what stands beyond them in mode "constant".
    missing : bool
        Whether a sample is.
    weights, level : ndarray or None
        Numbers per sample, of a row or of all.
    noise : float or ndarray
        The level of the noise; that of a sample is `level` times as large, if there are levels.
    """

    def __init__(self, x: ArrayLike, design: Differentiator, call: Call, wish: Wish) -> None:
        self.masked = isinstance(x, np.ma.MaskedArray)
        given = arguments.unmasked("x", x)
        if wish.period is not None and given.dtype.kind == "c":
            raise TypeError("period must come with real samples, got complex ones")
        self.shape, self.axis = given.shape, arguments.axis_index(call.axis, given.ndim)
        self.dtype = arguments.working_dtype(given.dtype)
        self.samples = self.shape[self.axis]
        self.stamps = None if wish.t is None else Stamps(wish.t, self.samples)
        self.design, self.windows = placed(design, self.stamps, self.samples, wish)
        self.valid = call.mode == "valid"
        self.limits = limits(self.design, self.windows, self.samples, call, wish)
        if call.out is not None:
            held = np.ma.getdata(x) if isinstance(x, np.ma.MaskedArray) else given
            leading = () if self.design._leading is None else (self.design._leading,)
            arguments.check_output(call.out, (*leading, *self.output_shape), self.dtype, held)
        else:
            np.empty(self.output_shape, self.dtype)  # what cannot be had is refused before every sample is looked at
        values = self._floats(given, wish)
        self.offsets = None if wish.period is None else _unwrap(values, wish.period)
        cval = (arguments.number if given.dtype.kind == "c" else arguments.real)("cval", call.cval)
        parts = (
            [(values, cval.real)] if values.dtype.kind == "f" else [(values.real, cval.real), (values.imag, cval.imag)]
        )
        self.parts = [
            (np.require(np.moveaxis(part, 0, self.axis), requirements=["C", "A"]), constant) for part, constant in parts
        ]
        self._weigh(wish, len(parts))
        if self.missing and wish.nan_policy == "raise":
            self._refuse_missing(values)
        if wish.return_std:
            self._measure(values, wish, len(parts))

    def _ascending(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return `array` with the axis of time first and times ascending."""
        first = np.moveaxis(array, self.axis, 0)
        return first[::-1] if self.stamps is not None and self.stamps.descending else first

    def _floats(self, given: Samples, wish: Wish) -> Samples:
        """Return the samples with the axis of time first, NaN where one is missing; a copy if anything is changed."""
        # Turns are counted in double precision.
        dtype = np.dtype(np.float64) if wish.period is not None else self.dtype
        values = self._ascending(given)
        if wish.period is not None or dtype.kind == "c":
            values = values.astype(dtype, order="C")
        else:
            values = values.astype(dtype, copy=False)
        # Faster than asking every sample.
        with np.errstate(invalid="ignore"):
            self.missing = values.size > 0 and bool(np.isnan(values.min() if dtype.kind == "f" else values.sum()))
        if self.missing and dtype.kind == "c":
            values[np.isnan(values)] = complex(math.nan, math.nan)
        return values

    def _refuse_missing(self, values: Samples) -> None:
        """Refuse missing samples, but for those of weight 0, which are left out anyway."""
        gone = np.moveaxis(np.isnan(values), 0, self.axis)
        if self.weights is not None:
            gone &= self._over_rows(self.weights) > 0
        if gone.any():
            raise ValueError(
                f"x must hold no missing samples with nan_policy = 'raise', got {gone.sum()} of {gone.size}"
            )

    def _weigh(self, wish: Wish, parts: int) -> None:
        self.weights = self.level = self.autocovariance = None
        self.noise: Any = 1.0
        if wish.weights is not None:
            self.weights = self._per_sample("weights", wish.weights)
        if wish.sigma is not None and np.ndim(wish.sigma) == 0:
            self.noise = arguments.level("sigma", wish.sigma) / math.sqrt(parts)
        elif wish.sigma is not None:
            self.noise, self.level = _normal(self._per_sample("sigma", wish.sigma))
            self.noise /= math.sqrt(parts)
        if wish.autocovariance is not None:
            covariance, shape = arguments.points("autocovariance", wish.autocovariance)
            if len(shape) != 1 or not shape[0] or not np.isfinite(covariance).all() or covariance[0] < 0:
                raise ValueError(
                    "autocovariance must hold finite covariances of samples 0, 1, ... apart, the first not negative, "
                    f"got {shown(wish.autocovariance)}"
                )
            # Of variance 1: nothing overflows when squares are summed.
            largest = float(np.abs(covariance).max()) or 1.0
            self.autocovariance, self.noise = covariance / largest, math.sqrt(largest / parts)

    def _measure(self, values: Samples, wish: Wish, parts: int) -> None:
        """Find the level of the noise if it was not given."""
        if wish.sigma is not None or wish.autocovariance is not None:
            return
        weights = None
        if self.weights is not None:
            weights = np.broadcast_to(np.moveaxis(self._over_rows(self.weights), self.axis, 0), values.shape)
        level = _typical_level(values, self.windows.times, weights) / math.sqrt(parts)
        if self.weights is not None:
            # The level is that of a sample of weight 1.
            factor, self.level = _normal(1 / np.sqrt(np.where(self.weights > 0, self.weights, np.inf)))
            level *= factor
        self.noise = np.expand_dims(level, self.axis) if self.shape[1:] else float(level)

    def _per_sample(self, name: str, given: ArrayLike) -> NDArray[np.float64]:
        """Return numbers for the samples of one row or of all, in the order of ascending times."""
        array = arguments.plain(name, given)
        if array.dtype.kind not in "fiub":
            raise TypeError(f"{name} must be real numbers, got dtype {array.dtype}")
        if array.shape not in {(self.samples,), self.shape}:
            raise ValueError(f"{name} must have shape {(self.samples,)} or that of x, {self.shape}, got {array.shape}")
        numbers = array.astype(np.float64)
        if not (np.isfinite(numbers).all() and (numbers >= 0).all()):
            wrong = numbers[~(np.isfinite(numbers) & (numbers >= 0))]
            raise ValueError(f"{name} must be finite and not negative, got {wrong[0]}")
        if array.shape == (self.samples,):
            reverse = self.stamps is not None and self.stamps.descending
            return np.ascontiguousarray(numbers[::-1] if reverse else numbers)
        return np.ascontiguousarray(np.moveaxis(self._ascending(numbers), 0, self.axis)).reshape(-1)

    def _over_rows(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return numbers per sample in the shape of x, or in one that goes with it."""
        along = [self.samples if axis == self.axis else 1 for axis in range(len(self.shape))]
        return numbers.reshape(along if numbers.size == self.samples else self.shape)

    @property
    def outputs(self) -> int:
        """Estimates of a row."""
        if self.windows.at is not None:
            return int(self.windows.at.size)
        return int(max(self.samples + 1 - self.design._plan.span, 0) if self.valid else self.samples)

    @property
    def output_shape(self) -> tuple[int, ...]:
        """Shape of the estimates of one order."""
        return (*self.shape[: self.axis], self.outputs, *self.shape[self.axis + 1 :])

    def restored(self, found: list[Estimates], call: Call) -> Estimates:
        """Return the results of the parts in the caller's order, type and shape."""
        one = found[0]
        if len(found) == 2:
            two = found[1]
            one = Estimates(
                one.estimate + 1j * two.estimate,
                None if one.std is None or two.std is None else np.hypot(one.std, two.std),
                one.support,
                None if one.bias is None or two.bias is None else one.bias + 1j * two.bias,
            )
        for estimate, design in zip(one.estimate, self.design.orders, strict=True):
            self._turn_back(estimate, design.deriv)
        single = self.dtype in (np.float32, np.complex64)
        real, full = (np.dtype(np.float32), self.dtype) if single else (np.dtype(np.float64), self.dtype)
        parts = {"estimate": (one.estimate, full), "std": (one.std, real), "bias": (one.bias, full)}
        fields: dict[str, Any] = {
            name: None if part is None else self._given_order(part, dtype, leading=True)
            for name, (part, dtype) in parts.items()
        }
        if one.support is not None:
            fields["support"] = self._given_order(one.support, one.support.dtype, leading=False)
        if call.out is not None:
            if not np.may_share_memory(call.out, fields["estimate"]):
                call.out[...] = fields["estimate"]
            fields["estimate"] = call.out
        if self.masked:
            gone = np.isnan(fields["estimate"])
            for name in parts:
                if fields[name] is not None:
                    fields[name] = np.ma.MaskedArray(fields[name], gone)
        return Estimates(**fields)

    def _given_order(self, part: NDArray[Any], dtype: np.dtype[Any], *, leading: bool) -> NDArray[Any]:
        if leading and self.design._leading is None:
            part, leading = part[0], False
        if self.stamps is not None and self.stamps.descending and self.windows.at is None:
            part = np.flip(part, self.axis + leading)
        return np.ascontiguousarray(part, dtype)

    def _turn_back(self, estimate: Samples, order: int) -> None:
        """Bring an estimate of the signal itself, unwrapped, back to the turn of the sample next to it."""
        if self.offsets is None or order != 0:
            return
        if self.windows.at is not None and self.windows.times is not None:
            index: Any = nearest(self.windows.times, self.windows.at)
        else:
            first = self.design._plan.aligned_position if self.valid else 0
            index = np.arange(first, first + self.outputs).clip(0, self.samples - 1)
        estimate -= np.moveaxis(self.offsets[index], 0, self.axis)


def _normal(levels: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return the largest level, and all in units of it: nothing overflows when squares are summed."""
    largest = float(levels.max(initial=0.0)) or 1.0
    return largest, levels / largest


def _typical_level(values: Samples, times: Samples | None, weights: Samples | None) -> NDArray[np.float64]:
    """Return the noise level of every row; of long ones from blocks of samples spread over them."""
    samples, parts = values.shape[0], [slice(None)]
    if samples > 2 * BLOCKS * BLOCK:
        parts = [slice(start, start + BLOCK) for start in np.linspace(0, samples - BLOCK, BLOCKS).astype(int)]
    found = [
        noise_level(
            values[part],
            t=None if times is None else times[part],
            axis=0,
            weights=None if weights is None else weights[part],
        )
        for part in parts
    ]
    if len(found) == 1:
        return np.asarray(found[0], np.float64)
    levels = np.asarray(found, np.float64)
    largest = np.nanmax(levels, axis=0, initial=0.0)
    scale = np.where(largest > 0, largest, 1.0)
    there = np.maximum(np.isfinite(levels).sum(axis=0), 1)
    return np.asarray(scale * np.sqrt(np.nansum(np.square(levels / scale), axis=0) / there), np.float64)


def placed(design: Differentiator, stamps: Stamps | None, samples: int, wish: Wish) -> tuple[Differentiator, Windows]:
    """Return the design for the step of even times, and where windows lie that are not its own."""
    step = design.delta if stamps is None else stamps.step
    delayed = design._asked["delay"] is not None
    if step is None:
        assert stamps is not None  # noqa: S101
        windows = _uneven(stamps, wish)
        if not delayed:
            return design, windows
        if windows.duration is None:
            raise ValueError(
                f"delay must come with even t or with window_duration, got {uneven(windows.times)}: say tau"
            )
        return design._changed(delay=None, tau=1 - design._asked["delay"] / windows.duration), windows
    changes: dict[str, Any] = {}
    if step != design.delta:
        changes["delta"] = step
    if wish.window_duration is not None:
        held = even_length(duration("window_duration", wish.window_duration), step)
        changes["window_length"] = max(held, design.degree + 1)
    if changes:
        design = design._changed(**changes)
    if wish.at is None:
        return design, Windows()
    if stamps is not None:
        return design, Windows(stamps.values, stamps.located("at", wish.at))
    at, shape = arguments.points("at", wish.at)
    check_times("at", at.reshape(shape), wish.at)
    return design, Windows(design.delta * np.arange(samples, dtype=np.float64), at)


def _uneven(stamps: Stamps, wish: Wish) -> Windows:
    at = None if wish.at is None else stamps.located("at", wish.at)
    if wish.window_duration is None:
        return Windows(stamps.values, at)
    length, pad = duration("window_duration", wish.window_duration), 0.5 * usual_step(stamps.values)
    if stamps.values.size < 2:
        raise ValueError(f"t must hold two times or more with window_duration, got {stamps.values.size}")
    whole = float(stamps.values[-1]) + 2 * pad
    if length > whole * (1 + 1e-9):
        raise ValueError(f"window_duration must be at most the {whole:.6g} that the data last, got {length:.6g}")
    return Windows(stamps.values, at, min(length, whole), pad)


def _unwrap(values: Samples, period: object) -> Samples:
    """Add turns to `values`, along their first axis, so that no step is longer than half a turn; return what was added.

    A step over missing samples is counted from the last sample that there is; a missing one has the turns of that.
    """
    turn = arguments.real("period", period)
    if not (math.isfinite(turn) and turn > 0):
        raise ValueError(f"period must be finite and positive, got {turn}")
    filled, gone = values, np.isnan(values)
    if gone.any():
        places = np.where(gone, 0, np.arange(values.shape[0]).reshape(-1, *(1 for _ in values.shape[1:])))
        np.maximum.accumulate(places, axis=0, out=places)
        filled = np.take_along_axis(values, places, axis=0)
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.diff(filled, axis=0)
        turns = np.rint(steps / turn)
    if (np.isfinite(steps) & ~(np.abs(turns) <= COUNTED)).any():
        raise ValueError(f"period must be at least 2**-53 of every step between samples, or turns are lost, got {turn}")
    turns[~np.isfinite(turns)] = 0
    added = np.zeros(values.shape)
    np.cumsum(turns, axis=0, out=added[1:])
    added *= -turn
    values += added
    return added
