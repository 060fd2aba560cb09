"""Windows for causal use: the best under a bound on the delay, compared with the best one without."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from algdiff._differentiator import Differentiator
from algdiff._suggest.candidates import LARGEST, design, holds, windows
from algdiff._suggest.selection import QUANTILE, quantile

if TYPE_CHECKING:
    from algdiff._suggest.choice import Chosen
    from algdiff._suggest.wanted import Wanted

Floats = NDArray[np.float64]

DEGREES = 4
"""Degrees that are compared, from that of the derivative on."""

PLACES = 4000
"""Where estimates are compared."""


def choose(found: Chosen, want: Wanted, delay: float) -> Chosen:
    """Return the choice whose estimates lag by no more than `delay` samples.

    What the best central window estimates stands for the truth: its error is small against that of any causal one.
    """
    level = found.level
    lag = max(delay - (level.step - 1) / 2, 0.0) / level.step
    family, risk = level.family, level.risk
    total = np.where(3 * family.window <= level.rows.shape[1], risk.bias2 + risk.variance, math.inf)
    core = family.designs[int(np.argmin(total)) if np.isfinite(total).any() else risk.best]
    half = core.window_length // 2
    reference = core(level.rows, mode="valid")
    best: tuple[float, float, int, int] | None = None
    for window, degree in _pairs(want, level.step, level.rows.shape[1]):
        nearer = min(lag, (window - 1) / 2)
        one = design(want.deriv, window, degree, want.exponent, want.exponent, delay=nearer)
        if not _passes(one, want.bandwidth * level.step):
            continue
        bias2, variance = _risk(one, core, reference, half, level.rows, float(level.sigma[level.risk.best]))
        if best is None or bias2 + variance < best[0] + best[1]:
            best = bias2, variance, window, degree
    if best is None:
        raise ValueError(
            f"max_delay must be longer, bandwidth lower or x longer: no window fits, got {delay * want.delta:g}"
        )
    bias2, variance, window, degree = best
    long = window * level.step
    nearer = min(delay, (long - 1) / 2) * want.delta
    made = design(want.orders, long, degree, want.exponent, want.exponent, want.delta, nearer)
    per = float(level.step) ** (-2 * want.deriv)
    return found._replace(design=made, bias2=bias2 * per, variance=variance * per)


def _pairs(want: Wanted, step: int, length: int) -> list[tuple[int, int]]:
    """Return windows and degrees; those that are shorter than twice the lag are central and lag less."""
    degrees = range(want.deriv, want.deriv + DEGREES)
    if len(want.limits.longest) == 1:
        degrees = range(next(iter(want.limits.longest)), next(iter(want.limits.longest)) + 1)
    most = min(LARGEST, length // 2, max(want.limits.longest.values()) // step)
    lengths = windows(math.ceil(want.limits.least / step), most)
    return [(w, d) for w in lengths for d in degrees if holds(w, d)]


def _passes(one: Differentiator, bandwidth: float) -> bool:
    """Return whether a design passes frequencies up to `bandwidth`, in cycles per sample, if any are asked for."""
    half_power = one.half_power if bandwidth else None
    return bandwidth == 0.0 or (half_power is not None and half_power >= bandwidth)


def _risk(
    one: Differentiator, core: Differentiator, reference: Floats, half: int, rows: Floats, sigma: float
) -> tuple[float, float]:
    """Return the square of the bias and the variance of a causal design."""
    lag = one.delay_samples
    estimates = one(rows, mode="valid")
    # Output j belongs to sample j + window_length - 1 - lag, a fraction of a sample apart from the core's.
    first = one.window_length - 1 - lag
    places = np.arange(math.ceil(max(first, half)), rows.shape[1] - 1 - max(half, math.ceil(lag)))
    variance = sigma**2 * one.noise_gain
    if places.size < 8:
        return math.inf, variance
    places = places[:: max(1, places.size * len(rows) // PLACES)]
    at = places - first
    before, share = np.floor(at).astype(int), at - np.floor(at)
    seen = (1 - share) * estimates[:, before] + share * estimates[:, np.minimum(before + 1, estimates.shape[1] - 1)]
    apart = seen - reference[:, places - half]
    noise = sigma**2 * max(one.noise_gain - core.noise_gain, 0.0)
    freedom = np.array(max(1.0, apart.size / 2, rows.size / one.window_length))
    distance = float(np.square(apart).mean())
    bias2 = max(0.0, distance - noise) if distance > noise * float(quantile(freedom, QUANTILE / 2)) else 0.0
    return bias2, variance
