"""A chosen design applied to samples: sliding windows in the middle, `edges` at the ends."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algdiff._arguments import Samples
from algdiff._differentiator import Differentiator
from algdiff._noise import noise_level
from algdiff._suggest import edges
from algdiff._suggest.local import adapt

Floats = NDArray[np.float64]

LOOKED_AT = 4096
"""Samples of a row at either end that its level of noise is taken from."""


def with_edges(
    design: Differentiator, x: Any, result: Samples, axis: int, sigma: float | None, local: bool, threads: int | None
) -> None:
    """Put the estimates at the ends of `x` into `result`, which may have a leading axis over orders.

    Parameters
    ----------
    design : Differentiator
        Estimates at the centers of its windows.
    x : ndarray
        Numbers.
    result : ndarray
        What the design made of `x` along `axis`.
    sigma : float, optional
        The level of the noise; by default that of every row.
    local : bool
        Whether the window adapts along the rows.
    threads : int, optional
        At most this many threads.
    """
    length, half = x.shape[axis], design.window_length // 2
    if half == 0 or result.size == 0:
        return
    turned = np.moveaxis(x, axis, -1)
    out = np.moveaxis(result if design._leading is not None else result[np.newaxis], axis - x.ndim, -1)
    if local:
        _adapted(design, turned, out, sigma, threads)
    orders = design.deriv if isinstance(design.deriv, tuple) else (design.deriv,)
    scale = np.array([design.delta**-order for order in orders]).reshape(-1, *(1 for _ in x.shape))
    signs = np.array([(-1.0) ** order for order in orders]).reshape(-1, *(1 for _ in x.shape))
    reach = min(
        length, max(window for window, _ in edges.sizes(design.window_length, design.degree, max(orders), length))
    )
    for backwards in (False, True):
        part = turned[..., ::-1] if backwards else turned
        values = np.array(part[..., : max(reach, LOOKED_AT)])
        found = _complex(values, reach, length, design, orders, sigma)
        count = found.shape[-1]
        # Beyond the first center they give way to the windows of the middle, so that there is no jump.
        share = np.clip((count - np.arange(count)) / (count - half + 1.0), 0.0, 1.0)
        place = slice(length - count, None) if backwards else slice(0, count)
        with np.errstate(invalid="ignore", over="ignore"):
            found = scale * found
            if backwards:
                found, share = (signs * found)[..., ::-1], share[::-1]
            out[..., place] = share * found + (1.0 - share) * out[..., place]


def _complex(
    values: Samples, reach: int, length: int, design: Differentiator, orders: tuple[int, ...], sigma: float | None
) -> NDArray[Any]:
    if values.dtype.kind == "c":
        real, imaginary = (_complex(part, reach, length, design, orders, sigma) for part in (values.real, values.imag))
        both: NDArray[Any] = real + 1j * imaginary
        return both
    rows = values.reshape(math.prod(values.shape[:-1]), values.shape[-1]).astype(np.float64)
    levels = np.full(len(rows), sigma) if sigma is not None else np.asarray(noise_level(rows))
    levels = np.where(np.isfinite(levels), levels, 0.0)
    # By powers of two, so that squares neither overflow nor vanish.
    size = np.frexp(np.abs(np.where(np.isfinite(rows), rows, 0.0)).max(axis=1, initial=0.0))[1]
    rows, levels = np.ldexp(rows, -size[:, np.newaxis]), np.ldexp(levels, -size)
    with np.errstate(invalid="ignore", over="ignore"):
        found = edges.start(rows[:, :reach], length, design.window_length, design.degree, design.kappa, orders, levels)
        estimate: NDArray[Any] = np.ldexp(found.estimate, size[:, np.newaxis])
    return estimate.reshape((len(orders), *values.shape[:-1], -1))


def _adapted(design: Differentiator, turned: Samples, out: Samples, sigma: float | None, threads: int | None) -> None:
    """Let the window adapt along the last axis."""
    parts = [(turned.real, out.real), (turned.imag, out.imag)] if turned.dtype.kind == "c" else [(turned, out)]
    for samples, estimates in parts:
        rows = np.ascontiguousarray(samples).reshape(-1, samples.shape[-1])
        found = np.ascontiguousarray(estimates).reshape(len(estimates), *rows.shape)
        levels = np.full(len(rows), sigma) if sigma is not None else np.atleast_1d(noise_level(rows))
        adapt(design, rows, found, np.nan_to_num(levels), threads)
        estimates[...] = found.reshape(estimates.shape)
