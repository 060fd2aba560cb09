"""Clocks that jitter lightly: even samples after all, with a correction of first order.

A sample taken late by d is worth ``x + d x'`` of an even clock. With the slope of a first pass the samples are brought
onto the even grid, differentiated as always, and the estimates brought back to the times of the samples. What is left
out is of second order: at most ``max(d)**2 / 2`` times the largest second derivative in a sample. The correction is
used where that makes at most `SHARE` of the standard deviation of any estimate, by a noise level and a second
derivative found in the data themselves, where the window follows the signal, so that its slope is right, and where d is
at most `LARGEST` of a step. The estimates then differ from those of a fit on the samples at their times by less than a
tenth, and usually a hundredth, of their standard deviation. Data without noise are always fitted.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from algdiff._arguments import Samples
from algdiff._data import Data
from algdiff._noise import noise_level
from algdiff._run import run
from algdiff._wish import Call, Wish

if TYPE_CHECKING:
    pass

LARGEST = 0.02
"""The largest deviation from an even clock, in steps."""

SHARE = 1e-3
"""The largest error of the correction, in standard deviations of the estimates."""

FOLLOWS = 1.5
"""The largest residual of the smoothed samples, in levels of the noise, of a window that follows the signal."""

LOOK = 1 << 14
"""Samples of each of the places at which the noise is looked at."""


def corrected(data: Data, values: Samples, call: Call, wish: Wish) -> Samples | None:
    """Return the estimates at the samples, with a leading axis over the orders; none if the correction is too rough."""
    stamps, design = data.stamps, data.design
    if stamps is None or values.size == 0 or not _plain(data, call, wish):
        return None
    step, late = _clock(stamps.values)
    if float(np.abs(late).max()) > LARGEST * step:
        return None
    along = late.reshape(-1, *(1 for _ in data.shape[data.axis + 1 :])).astype(values.dtype)
    orders = tuple(one.deriv for one in design.orders)

    def differentiate(x: Samples, several: tuple[int, ...]) -> dict[int, Samples]:
        even = design._changed(delta=step, tau=design.tau, delay=None, deriv=several, degree=design.degree)
        found = run(even._bank, even._plan, x, orders=len(several), axis=data.axis, threads=call.threads)
        return dict(zip(several, found, strict=True))

    first = differentiate(values, (0, 1, 2))
    level = _least_level(values, stamps.values, data.axis)
    left = np.subtract(values, first[0], out=first[0])
    if not float(np.sqrt(np.mean(np.square(left, out=left)))) <= FOLLOWS * level:
        return None
    curvature = float(np.abs(first[2]).max())
    error = 0.5 * float(np.square(late).max()) * curvature
    for one in design._changed(delta=step, tau=design.tau, delay=None).orders:
        if not error * one.norm1 <= SHARE * level * math.sqrt(one.noise_gain):
            return None
    even = np.multiply(first[1], along, out=first[1])
    np.subtract(values, even, out=even)
    wanted = sorted({*orders, *(order + 1 for order in orders if order < design.degree)})
    found = differentiate(even, tuple(wanted))
    result = [found[order] + along * found[order + 1] if order < design.degree else found[order] for order in orders]
    return np.stack(result)


def _plain(data: Data, call: Call, wish: Wish) -> bool:
    """Return whether a call asks for nothing but what sliding weights of the same degree give."""
    windows, design = data.windows, data.design
    own = windows.at is not None or windows.duration is not None or data.weights is not None or data.missing
    limited = wish.max_gain is not None or wish.min_support is not None
    # At a root the sliding weights are those of a higher degree, which only in the very middle makes no difference.
    middle = design.kappa == design.mu and design.tau == 0.5 and design._plan.span % 2 == 1
    higher = not middle and any(one.exactness > design.degree for one in design.orders)
    simple = call.mode == "fit" and wish.edge_window == "full" and design.degree >= 2
    return simple and not (own or limited or higher)


def _clock(times: Samples) -> tuple[float, Samples]:
    """Return the step of the even clock that fits the times best, and by how much they are later."""
    middle = 0.5 * (times.size - 1)
    index = np.arange(times.size) - middle
    step = float(index @ times) / (middle * (middle + 1) * times.size / 3)
    late = times - step * index
    late -= 0.5 * (late.max() + late.min())
    return step, late


def _least_level(values: Samples, times: Samples, axis: int) -> float:
    """Return the least noise level at several places of the rows."""
    samples = np.moveaxis(values, axis, 0)
    parts = [slice(0, len(times))]
    if len(times) > 4 * LOOK:
        parts = [slice(start, start + LOOK) for start in np.linspace(0, len(times) - LOOK, 4).astype(int)]
    return min(float(np.min(noise_level(samples[part], t=times[part], axis=0))) for part in parts)
