"""A window that adapts along the signal: a mean over some windows whose shares change smoothly.

Four windows about the chosen one, of its degree, are slid over the samples. Around every place their estimates are
compared as in `selection`, over one length of the longer window: what lies between two of them and is more than noise
explains is bias of the longer one. The estimates are weighted by high powers of one over the risk that results, and
the shares are smoothed over half a window, so that nothing jumps where another window takes over.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff._arguments import Samples
from algdiff._differentiator import Differentiator
from algdiff._orders import highest
from algdiff._suggest.candidates import design, family, holds, odd
from algdiff._suggest.rows import LOUDEST
from algdiff._suggest.selection import quantile

Floats = NDArray[np.float64]

RATIO = 1.6
"""From one window to the next."""

STEPS = (-2, -1, 0, 1)
"""The windows, as powers of that over the chosen one."""

LONGEST = 500
"""The longest window for which it is worked out what noise does; it is the same for others, but for its scale."""

FINE = 8
"""Places at which windows are compared, per chosen window."""

CHUNK = 1 << 15
"""Samples that are mixed at a time, which a cache holds."""

REACH = 0.6
"""Over the longer of two windows: how far around a place they are compared."""

DEVIATIONS = 4.0
"""Standard deviations of what noise puts between two estimates."""

POWER = 2
"""Of one over the mean square risk, by which windows are weighted."""


class Windows(NamedTuple):
    """The windows, the place of the chosen one among them, and what unit noise does to them and their differences.

    `gain` is relative to the first window's, so that only ratios and `sigma` times its gain matter.
    """

    designs: list[Differentiator]
    chosen: int
    gain: Floats
    difference: Floats
    memory: Floats


def windows(central: Differentiator, length: int) -> Windows:
    """Return the windows about a chosen one for rows of some length, and what unit noise does at a step of 1."""
    chosen, degree = central.window_length, central.degree
    lengths = {chosen}
    for step in STEPS:
        window = odd(chosen * RATIO**step)
        if window <= length // 3 and holds(window, degree):
            lengths.add(window)
    ordered = sorted(lengths)
    designs = [design(central.deriv, one, degree, central.kappa, central.mu, central.delta) for one in ordered]
    order = highest(central.deriv)
    # Long windows do what shorter ones of the same proportions do.
    shrunk = min(1.0, LONGEST / ordered[-1])
    short = tuple((degree, (max(odd(one * shrunk), degree + 1 + degree % 2),)) for one in ordered)
    few = family(order, short, central.kappa, central.mu)
    scale = shrunk ** (2 * order + 1)
    return Windows(designs, ordered.index(chosen), scale * few.gain, scale * few.difference, few.memory / shrunk)


def shares(estimates: Floats, found: Windows, places: NDArray[np.intp], length: int, sigma: float) -> Floats:
    """Return the shares of the windows at some places.

    Parameters
    ----------
    estimates : ndarray of shape (K, P)
        Of every window at the places.
    found : Windows
        The windows.
    places : ndarray of shape (P,)
        Evenly spaced samples.
    length : int
        Samples of the row.
    sigma : float
        Level of the noise.
    """
    total, spacing = len(found.designs), int(places[1] - places[0])
    half = np.array([one.window_length // 2 for one in found.designs])
    inside = (places >= half[:, None]) & (places < length - half[:, None])
    bias2 = np.zeros_like(estimates)
    for c in range(1, total):
        bias2[c] = bias2[c - 1]
        for b in range(c):
            reach = max(1, round(REACH * found.designs[c].window_length / spacing))
            apart, count = _around(np.square(estimates[c] - estimates[b]), inside[c], reach)
            freedom = np.maximum(count * spacing / np.maximum(found.memory[c, b], spacing), 1.0)
            noise = sigma**2 * found.difference[c, b]
            seen = np.where(apart > noise * quantile(freedom, DEVIATIONS), apart - noise, 0.0)
            bias2[c] = np.maximum(bias2[c], seen)
    risk = bias2 + sigma**2 * found.gain[:, None]
    weight = np.where(inside, (risk.min(axis=0) / np.maximum(risk, 1e-300)) ** POWER, 0.0)
    weight[0] = np.where(weight.sum(axis=0) > 0, weight[0], 1.0)
    weight /= weight.sum(axis=0)
    reach = FINE // 4
    for _ in range(2):
        weight = np.array([_around(row, np.ones(row.size, bool), reach)[0] for row in weight])
    smooth = np.where(inside | (np.arange(total) == 0)[:, None], weight, 0.0)
    share: Floats = smooth / smooth.sum(axis=0)
    return share


def _around(values: Floats, there: NDArray[np.bool_], reach: int) -> tuple[Floats, Floats]:
    """Return the means of the values that are there, up to `reach` places away, and of how many."""
    sums = np.concatenate(([0.0], np.cumsum(np.where(there, values, 0.0))))
    counts = np.concatenate(([0], np.cumsum(there)))
    first = np.maximum(np.arange(values.size) - reach, 0)
    last = np.minimum(np.arange(values.size) + reach + 1, values.size)
    count = np.maximum(counts[last] - counts[first], 1).astype(np.float64)
    return np.maximum(sums[last] - sums[first], 0.0) / count, count


def adapt(central: Differentiator, x: Samples, result: Samples, sigma: Floats, threads: int | None) -> None:
    """Put the estimates by windows that adapt into `result`, wherever the central one lies in the data.

    Parameters
    ----------
    central : Differentiator
        The chosen design.
    x : ndarray of shape (R, L)
        Real samples.
    result : ndarray of shape (D, R, L)
        What the design made of them.
    sigma : ndarray of shape (R,)
        Level of the noise.
    threads : int, optional
        At most this many threads.
    """
    length, half = x.shape[1], central.window_length // 2
    found = windows(central, length)
    spacing = max(1, central.window_length // FINE)
    places = np.arange(half, length - half, spacing)
    if places.size < FINE or len(found.designs) == 1:
        return
    inner = slice(half, int(places[-1]))
    along = np.arange(spacing) / spacing
    unit = central.delta ** highest(central.deriv)
    for row, samples in enumerate(x):
        own = result[:, row] if central._leading is not None else result[0, row]
        estimates = [own if k == found.chosen else one(samples, threads=threads) for k, one in enumerate(found.designs)]
        single = [each if central._leading is None else each[-1] for each in estimates]
        at = np.array([each[places] for each in single], np.float64) * unit
        finite = np.isfinite(at)
        top = float(np.abs(at[finite]).max(initial=0.0)) or 1.0
        # What overflows is compared as the largest, and stays infinite or becomes NaN.
        loud = min(float(sigma[row]) / top, LOUDEST)
        share = shares(np.where(finite, at / top, 1.0), found, places, length, loud)
        mixed = result[:, row, inner].reshape(len(result), -1, spacing)
        whole = [each[..., inner].reshape(*each.shape[:-1], -1, spacing) for each in estimates]
        each_time = max(1, CHUNK // spacing)
        with np.errstate(invalid="ignore", over="ignore"):
            for first in range(0, places.size - 1, each_time):
                _mix(mixed, whole, found.chosen, share, slice(first, min(first + each_time, places.size - 1)), along)


def _mix(mixed: Samples, estimates: list[Samples], chosen: int, share: Floats, some: slice, along: Floats) -> None:
    """Make the estimates of one window, in `mixed`, the weighted mean of all; shares change linearly between places."""
    steps = np.diff(share[:, some.start : some.stop + 1], axis=1)
    total = mixed[..., some, :]
    ramp, product = np.empty(total.shape[-2:]), np.empty_like(total)

    def shared(k: int) -> Floats:
        np.multiply(steps[k, :, np.newaxis], along, out=ramp)
        return np.add(ramp, share[k, some, np.newaxis], out=ramp)

    total *= shared(chosen)
    for k, estimate in enumerate(estimates):
        if k != chosen:
            total += np.multiply(estimate[..., some, :], shared(k), out=product)
