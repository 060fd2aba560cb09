"""Calls that ask for more than sliding weights: missing samples, times, weights, angles, errors.

Even samples without any of that are differentiated as always, and what their windows do not give is filled in: windows
that touch a gap are fitted on the samples that are there, the ends have standard deviations of their own. Everything
else gets a fit of its own for every estimate.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _threads as threads_of
from algdiff._arguments import Progress, Samples
from algdiff._core import Fits
from algdiff._data import Data
from algdiff._jitter import corrected
from algdiff._layout import around, in_order
from algdiff._results import Estimates
from algdiff._run import run
from algdiff._wish import INSIDE, Call, Wish

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator

MAX_GAIN = 100.0
"""By how much missing samples may raise the noise gain, unless something else is asked for."""


def estimates(design: Differentiator, x: ArrayLike, call: Call, wish: Wish) -> Any:
    """Return what `wish` asks for: the estimates, or those and more by name."""
    data = Data(x, design, call, wish)
    found = data.restored([_Job(data, constant, call, wish).run(values) for values, constant in data.parts], call)
    return found if wish.return_std or wish.return_support or wish.return_bias else found.estimate


class _Job:
    """The fits of one real array; results have a leading axis over the orders."""

    def __init__(self, data: Data, constant: float, call: Call, wish: Wish) -> None:
        design = data.design
        self.data, self.constant, self.call, self.wish, self.design = data, constant, call, wish, design
        self.orders = len(design._plans)
        self.beyond = 1 + max(one.exactness for one in design.orders) if wish.return_bias else design.degree
        self.fits = Fits(design._plans, self.beyond)
        self.layout = around(data.shape, data.axis)
        self.more = wish.return_std or wish.return_support or wish.return_bias
        gain = data.limits.gain
        self.max_gain = (math.inf, MAX_GAIN) if gain is None else (gain, gain)
        self.omit = wish.nan_policy == "omit" and (data.missing or math.isnan(constant))

    def run(self, values: Samples) -> Estimates:
        """Return the estimates, and what else is asked for."""
        data, wish = self.data, self.wish
        if data.windows.times is not None and not self.more:
            estimate = corrected(data, values, self.call, wish)
            if estimate is not None:
                return Estimates(estimate)
        # Every estimate is a fit of its own where no window is like another.
        alone = data.windows.times is not None or data.weights is not None or data.level is not None
        return self.fitted(values) if alone or wish.return_bias else self.slid(values)

    def fitted(self, values: Samples) -> Estimates:
        """Return one fit for every estimate."""
        count = self.data.outputs
        outer, _, inner = self.layout
        found = self.fit(values, self.layout, count * outer * inner, progress=self.call.progress)
        shape = self.data.output_shape

        def arranged(part: Samples | None) -> Samples | None:
            if part is None:
                return None
            apart = part.reshape(len(part), count, outer, inner).swapaxes(1, 2)
            return np.ascontiguousarray(apart).reshape(-1 if part.size else len(part), *shape)

        support = arranged(found.support)
        return Estimates(
            arranged(found.estimate),  # type: ignore[arg-type]
            self.scaled(arranged(found.std)),
            None if support is None else support[0],
            arranged(found.bias),
        )

    def slid(self, values: Samples) -> Estimates:
        """Return the estimates of sliding weights, and fits where those do not reach."""
        stage = _stages(self.call.progress, 3)
        estimate = self.slide(values, stage())
        std, support = self.profiles(estimate)
        flat = estimate.reshape(self.orders, -1)
        if self.omit and self.data.autocovariance is None:
            self.refill(values, flat, (std, support), stage())
        listed = self.listed(flat)
        if listed.size:
            found = self.fit(values, self.layout, listed.size, listed=listed, progress=stage())
            for whole, part in [(estimate, found.estimate), (std, found.std)]:
                if whole is not None and part is not None:
                    whole.reshape(self.orders, -1)[:, listed] = part
            if support is not None and found.support is not None:
                support.reshape(-1)[listed] = found.support
        if std is not None:
            std[np.isnan(estimate)] = np.nan
        return Estimates(estimate, self.scaled(std), support)

    def slide(self, values: Samples, progress: Progress | None) -> Samples:
        """Return the estimates of sliding weights, in the caller's array if that can be."""
        call, data, out = self.call, self.data, self.call.out
        plain = len(data.parts) == 1 and data.offsets is None and not (data.stamps and data.stamps.descending)
        if out is not None and (not plain or not in_order(out) or out.dtype != values.dtype):
            out = None
        if out is not None and self.design._leading is None:
            out = out[np.newaxis]
        return run(
            self.design._bank,
            self.design._plan,
            values,
            orders=self.orders,
            axis=data.axis,
            mode=call.mode,
            cval=self.constant,
            out=out,
            threads=call.threads,
            progress=progress,
        )

    def listed(self, flat: Samples) -> NDArray[np.int64]:
        """Return which estimates need a fit of their own: those that miss samples, and those of shrunken windows."""
        listed = np.empty(0, np.intp)
        if flat.size == 0:
            return listed.astype(np.int64)
        # Without "omit" there is nothing to fit, but samples to count.
        if self.omit or (self.data.missing and self.wish.return_support):
            listed = np.flatnonzero(np.isnan(flat).any(axis=0))
        if self.call.mode == "nan":
            listed = listed[self.inside(listed)]
        if self.wish.edge_window == "shrink":
            outer, _, inner = self.layout
            ends = np.flatnonzero(~self.inside(np.arange(self.data.outputs) * inner))
            every = np.arange(outer)[:, None, None] * self.data.outputs + ends[:, None]
            listed = np.union1d(listed, every * inner + np.arange(inner))
        return listed.astype(np.int64, copy=False)

    def inside(self, listed: NDArray[Any]) -> NDArray[np.bool_]:
        """Return for which estimates the whole window lies in the data."""
        plan, (_, samples, inner) = self.design._plan, self.layout
        start = listed // inner % self.data.outputs - (0 if self.data.valid else plan.aligned_position)
        return (start >= 0) & (start + plan.span <= samples)

    def refill(
        self,
        values: Samples,
        flat: Samples,
        more: tuple[Samples | None, NDArray[Any] | None],
        progress: Progress | None,
    ) -> None:
        """Fill in many estimates at once, and of `more` their standard deviations and support."""
        std, support = more
        self.fits.refill(
            values.reshape(-1),
            self.layout,
            flat.reshape(-1),
            None if std is None else std.reshape(-1),
            None if support is None else support.reshape(-1),
            valid=self.data.valid,
            max_gain=self.max_gain[1],
            min_support=self.data.limits.support,
            threads=threads_of.count(self.call.threads),
            progress=progress,
        )

    def profiles(self, estimate: Samples) -> tuple[Samples | None, NDArray[Any] | None]:
        """Return standard deviations for a level of 1, and support, where no sample is missing."""
        wish, plan = self.wish, self.design._plan
        if not (wish.return_std or wish.return_support) or estimate.size == 0:
            return (np.empty_like(estimate) if wish.return_std else None), (
                np.empty(estimate.shape[1:], np.int64) if wish.return_support else None
            )
        data, samples, span = self.data, self.layout[1], plan.span
        # A row just long enough for both ends tells of any longer one.
        short = samples
        if self.data.valid:
            short = span
        elif 0 <= plan.aligned_position < span:
            short = min(samples, 2 * span + 1)
        missing = samples - short
        count = data.outputs - missing
        plain = self.call.mode in INSIDE and self.data.autocovariance is None and data.limits.least is None
        if plain:
            found = self.profile(short, count, estimate.dtype)
        else:
            found = self.fit(np.zeros(short, estimate.dtype), (1, short, 1), count, whole=True)
        along = (slice(None), *(slice(None) if axis == data.axis else None for axis in range(estimate.ndim - 1)))

        def spread(part: Any, out: Any) -> None:
            part = part.reshape(-1, count)
            middle = min(span, count - 1)
            long = np.concatenate(
                [part[:, :middle], np.repeat(part[:, middle : middle + 1], missing, 1), part[:, middle:]], 1
            )
            out[...] = long[along]

        std = support = None
        if wish.return_std:
            std = np.empty_like(estimate)
            spread(found.std, std)
        if wish.return_support:
            support = np.empty((1, *estimate.shape[1:]), np.int64)
            spread(found.support, support)
            support = support[0]
        return std, support

    def profile(self, samples: int, count: int, dtype: np.dtype[Any]) -> Estimates:
        """Return standard deviations for a level of 1, and support, of a row of even samples that is not extended."""
        plan, call = self.design._plan, self.call
        start = np.arange(count) - (0 if self.data.valid else plan.aligned_position)
        inside = (start >= 0) & (start + plan.span <= samples)
        place = np.arange(count) - start.clip(0, samples - plan.span)
        if self.data.valid:
            gains = np.repeat([[one.noise_gain] for one in self.design.orders], count, axis=1)
        else:
            gains = np.empty((self.orders, count))
            self.fits.gains(place.astype(np.float64), False, gains.reshape(-1))
            middle = np.empty(self.orders)
            self.fits.gains(np.array([float(plan.aligned_position)]), True, middle)
            gains[:, inside] = middle[:, np.newaxis]
        support = np.full((1, count), plan.span)
        if call.mode == "nan":
            gains[:, ~inside], support[:, ~inside] = math.nan, 0
        with np.errstate(over="ignore"):
            return Estimates(gains, np.sqrt(gains).astype(dtype), support)

    def fit(
        self,
        values: Samples,
        layout: tuple[int, int, int],
        count: int,
        *,
        listed: NDArray[np.int64] | None = None,
        whole: bool = False,
        progress: Progress | None = None,
    ) -> Estimates:
        """Fit `count` estimates; of `whole` rows none is asked for samples, weights or times."""
        data, wish, call = self.data, self.wish, self.call
        size = self.orders * count
        estimate = np.empty(size, values.dtype)
        std = np.empty(size, values.dtype) if wish.return_std else None
        more = np.empty(size, values.dtype) if wish.return_bias else None
        support = np.empty(count, np.int64) if wish.return_support else None
        windows = data.windows
        own: dict[str, Any] = (
            {}
            if whole
            else {
                "t": windows.times,
                "at": windows.at,
                "duration": windows.duration,
                "beyond": windows.pad,
                "weights": data.weights,
                "level": data.level,
            }
        )
        self.fits.run(
            values.reshape(-1),
            layout,
            estimate,
            std,
            more,
            support,
            mode=call.mode,
            cval=self.constant,
            least=data.limits.least,
            valid=data.valid,
            listed=listed,
            autocovariance=data.autocovariance,
            omit=self.omit,
            min_support=0 if whole else data.limits.support,
            max_gain=(math.inf, math.inf) if whole else self.max_gain,
            threads=threads_of.count(call.threads),
            progress=progress,
            **own,
        )

        def rows(part: Samples | None) -> Any:
            return None if part is None else part.reshape(-1 if count else self.orders, count)

        return Estimates(rows(estimate), rows(std), rows(support), rows(more))

    def scaled(self, std: Samples | None) -> Samples | None:
        """Return standard deviations for the level of the noise."""
        if std is not None:
            with np.errstate(over="ignore"):
                np.multiply(std, self.data.noise, out=std, casting="unsafe")
        return std


def _stages(progress: Progress | None, stages: int) -> Any:
    """Return what makes the progress of each of several stages a part of the whole."""
    done = -1

    def next_stage() -> Progress | None:
        nonlocal done
        done += 1
        first = done
        return None if progress is None else lambda fraction: progress((first + fraction) / stages)

    return next_stage
