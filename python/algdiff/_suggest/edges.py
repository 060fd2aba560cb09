"""The ends of a recording, where no window is centered on the sample.

A polynomial that is fitted well in the middle is a poor guess at its own ends: its highest coefficients, of which the
derivative there makes most, are the noisiest. So at either end one window is fitted by orthonormal polynomials of
rising degree, and each coefficient counts by the share of it that noise does not explain (James and Stein 1961). As
shares fall with the degree, this is a mean over the estimates of several degrees of one window, so that polynomials of
degree `deriv` and whatever the samples show clearly are reproduced. The mean of three windows, each with as high a
degree as it may need, errs less than any of them.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff._suggest import unseen
from algdiff._suggest.candidates import design, odd
from algdiff._suggest.selection import quantile

Floats = NDArray[np.float64]

WINDOWS = ((0.75, 1), (0.9, 1), (1.05, 1))
"""The windows at the ends over that in the middle, and by how much their highest degrees are above that there."""

FACTORS = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Of the windows that are tried at the ends, over that in the middle."""

BLEND = 0.15
"""By which share an end goes on beyond the first center of a window."""

BEYOND, DEVIATIONS = 3, 4.0
"""Coefficients of yet higher degree, and standard deviations of their sum of squares beyond which they are no noise."""

MORE = 6
"""Coefficients beyond the degree of a row by which it is told whether the row is one polynomial."""

CAUTION = 5.0
"""A coefficient counts by ``1 - CAUTION sigma^2 / c^2``."""


class Edge(NamedTuple):
    """The estimates of the first samples of rows.

    Attributes
    ----------
    estimate : ndarray of shape (D, R, H)
        Of D orders at the first H samples of R rows.
    std : ndarray of shape (D, R, H)
        Their standard deviations from noise, given the shares.
    bias2 : ndarray of shape (D, R, H)
        The square of what the shares leave out, as it is expected to be; zero unless asked for.
    """

    estimate: Floats
    std: Floats
    bias2: Floats


class Basis(NamedTuple):
    """Orthonormal polynomials on the samples of a window, and their derivatives at the first ones."""

    values: Floats
    derivatives: Floats


def basis(size: int, degree: int, orders: tuple[int, ...], count: int) -> Basis:
    """Return polynomials up to `degree` on `size` samples and their derivatives at the first `count`."""
    return _bases(size, degree, orders, count)


def _basis(size: int, degree: int, orders: tuple[int, ...], count: int) -> Basis:
    legendre = np.polynomial.legendre
    points = np.linspace(-1.0, 1.0, size)
    values, triangle = np.linalg.qr(legendre.legvander(points, degree))
    derivatives = np.empty((len(orders), count, degree + 1))
    for row, order in zip(derivatives, orders, strict=True):
        matrix = np.eye(degree + 1)
        for _ in range(order):
            matrix = np.vstack([legendre.legder(matrix), np.zeros((1, degree + 1))])[: degree + 1]
        at = legendre.legvander(points[:count], degree) @ matrix * (2.0 / (size - 1)) ** order
        row[:] = np.linalg.solve(triangle.T, at.T).T
    return Basis(values, derivatives)


_bases = lru_cache(maxsize=32)(_basis)


def sizes(window_length: int, degree: int, deriv: int, length: int) -> list[tuple[int, int]]:
    """Return the windows at the ends, and the highest degrees there."""
    found = []
    # Only what is one polynomial gets windows of more than half of it, and then all of it tells of the ends.
    whole = 2 * window_length > length
    for factor, more in ((length / window_length, 0),) if whole else WINDOWS:
        highest = degree + more
        window = min(max(round(factor * window_length), highest + 3, deriv + 2), length)
        found.append((window, max(min(highest, window - 1), deriv)))
    return found


def reach(window_length: int) -> int:
    """Return how many samples are an end: those without a window in their middle, and some to blend with others."""
    return window_length // 2 + round(BLEND * (window_length // 2))


def start(
    rows: Floats,
    length: int,
    window_length: int,
    degree: int,
    exponent: float,
    orders: tuple[int, ...],
    sigma: Floats,
    risk: bool = False,
) -> Edge:
    """Return the estimates of the samples up to the first center of a window and some more, for a sampling step of 1.

    `length` is that of whole rows, of which what is far from the end may be left out. Where the polynomials of these
    windows leave more of a row than noise explains, shorter windows take their place, in the middle of their own too.
    `risk` asks for the bias.
    """
    count = min(reach(window_length), rows.shape[1])
    parts = (len(orders), len(rows), count)
    edge = Edge(np.empty(parts), np.empty(parts), np.empty(parts))
    left = np.arange(len(rows))
    for factor in FACTORS:
        shorter = max(odd(factor * window_length), degree + 1 + degree % 2, max(orders) + 3)
        shorter = min(shorter, window_length)
        tried = _mean(rows[left], length, shorter, degree, orders, sigma[left], risk)
        good = tried.explained if factor != FACTORS[-1] else np.ones(left.size, bool)
        rows_now = left[good]
        inner = min(tried.edge.estimate.shape[-1], count)
        for whole, part in zip(edge, tried.edge, strict=True):
            whole[:, rows_now, :inner] = part[:, good, :inner]
        if inner < count and rows_now.size:
            one = design(orders, shorter, degree, exponent, exponent)
            whole = one(rows[rows_now, inner - shorter // 2 : count + shorter // 2], mode="valid")
            edge.estimate[:, rows_now, inner:] = whole[..., : count - inner]
            edge.std[:, rows_now, inner:] = (
                np.sqrt(np.array(one.noise_gain))[:, None, None] * sigma[rows_now][None, :, None]
            )
            edge.bias2[:, rows_now, inner:] = 0.0
        left = left[~good]
        if left.size == 0:
            break
    return edge


def is_polynomial(rows: Floats, degree: int, sigma: float) -> bool:
    """Return whether noise explains the next coefficients beyond a polynomial of some degree in each whole row."""
    more = min(MORE, rows.shape[1] - degree - 1)
    if more < 1:
        return True
    values = basis(rows.shape[1], degree + more, (), 0).values[:, degree + 1 :]
    squares = float(np.square((rows - rows[:, :1]) @ values).sum())
    freedom = more * len(rows)
    explained: bool = squares <= freedom * sigma**2 * float(quantile(np.array(float(freedom)), DEVIATIONS))
    return explained


class _Tried(NamedTuple):
    edge: Edge
    explained: NDArray[np.bool_]


def _mean(
    rows: Floats, length: int, window_length: int, degree: int, orders: tuple[int, ...], sigma: Floats, risk: bool
) -> _Tried:
    """Return the mean over windows, and for which rows noise explains what the longest of them leaves."""
    count = min(reach(window_length), rows.shape[1])
    found = [
        _one(rows, window, highest, orders, sigma, count, risk)
        for window, highest in sizes(window_length, degree, max(orders), length)
    ]
    estimate, std, bias2 = (np.array(parts) for parts in zip(*(one.edge for one in found), strict=True))
    edge = Edge(estimate.mean(axis=0), std.mean(axis=0), np.median(bias2, axis=0))
    return _Tried(edge, found[-1].explained)


def _one(
    rows: Floats, window: int, highest: int, orders: tuple[int, ...], sigma: Floats, count: int, risk: bool
) -> _Tried:
    beyond = min(BEYOND, window - highest - 1)
    found = basis(window, highest + beyond, orders, count)
    offset = rows[:, :1]
    coefficients = (rows[:, :window] - offset) @ found.values
    explained = np.ones(len(rows), bool)
    if beyond > 0:
        left = np.square(coefficients[:, highest + 1 :]).sum(axis=1)
        explained = left <= beyond * np.square(sigma) * float(quantile(np.array(float(beyond)), DEVIATIONS))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scores = coefficients / sigma[:, None]
        shares = 1.0 - CAUTION / np.square(scores)
    shares = np.where(np.isfinite(shares), np.maximum(shares, 0.0), 0.0)
    shares[:, : max(orders) + 1] = 1.0
    shares[:, highest + 1 :] = 0.0
    shares = np.maximum.accumulate(shares[:, ::-1], axis=1)[:, ::-1]
    kept = shares * coefficients
    turned = found.derivatives.swapaxes(1, 2)
    estimate = np.matmul(kept, turned)
    std = np.sqrt(np.matmul(np.square(shares * sigma[:, None]), np.square(turned)))
    bias2 = np.zeros_like(std)
    if risk:
        bias2 = unseen.squared_bias(scores, shares, found.derivatives) * np.square(sigma[:, None])
    for k, order in enumerate(orders):
        if order == 0:
            estimate[k] += offset
    return _Tried(Edge(estimate, std, bias2), explained)
