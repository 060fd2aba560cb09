"""The middle of the ladder: what every output should be by the weights of `reference.py`, and how far off it may be.

Weights of any place in a window come from one set of functionals, of which `reference.weights` gives one at a time, so
that they are cheap enough for ends and for many calls; a test compares the two. Sums are in long double, those for
samples of single precision in double.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

import reference
from support import EPS

Array = npt.NDArray[Any]
BOUND = {"direct": ("direct",), "moments": ("moments",), "fft": ("fft",), "": ("direct", "moments", "fft")}


class Basis(NamedTuple):
    """Functionals by which every estimate of a window is a sum, and what becomes of a derivative's values of p_m there.

    `lost` is by how many eps functionals and values may be off, relative to their largest.
    """

    functionals: Array
    triangle: Array | None
    lost: float

    def estimators(self, deriv: int, kappa: float, mu: float, taus: Array) -> Array:
        """Return what multiplies the functionals for derivatives at `taus`, a row for each."""
        degree = len(self.functionals) - 1
        shifted = reference.orthonormal(kappa + deriv, mu + deriv, degree - deriv, taus)
        values = np.zeros((degree + 1, len(taus)))
        for m in range(deriv, degree + 1):
            values[m] = reference.derivative_factor(deriv, kappa, mu, m) * shifted[m - deriv]
        return (values if self.triangle is None else np.linalg.solve(self.triangle.T, values)).T


@lru_cache(1 << 12)
def basis(rule: str, length: int, degree: int, kappa: float, mu: float, first: int, span: int) -> Basis:
    """Return the basis of a window of which `span` samples from `first` on are kept."""
    j = np.arange(length)[first : first + span]
    # Logarithms of the density and of its norm, and integrals near an end, of powers 1 + kappa and 1 + mu.
    cost = 2 * (1 + abs(math.lgamma(kappa + mu + 2)) + kappa + mu + 1 / (1 + kappa) + 1 / (1 + mu))
    if rule == "exact":
        log_w = (reference.log_base_weight(length, kappa) + reference.log_base_weight(length, mu)[::-1])[j]
        root = np.exp((log_w - log_w.max()) / 2)
        q, r = np.linalg.qr((root * reference.orthonormal(kappa, mu, degree, (j + 0.5) / length)).T)
        return Basis((root[:, None] * q).T, r, float(np.linalg.cond(r)))
    if rule in ("cell", "hat"):
        return Basis(integrals(rule, length, degree, kappa, mu)[:, j], None, cost)
    places = (j + 0.5) / length if rule == "midpoint" else j / (length - 1)
    factors = {"trapezoid": reference.trapezoid_factors, "simpson": reference.simpson_factors}.get(rule, np.ones)
    density = places**kappa * (1 - places) ** mu * math.exp(-reference.log_beta(kappa + 1, mu + 1))
    share = factors(length)[j] / (length if rule == "midpoint" else length - 1)
    return Basis(density * share * reference.orthonormal(kappa, mu, degree, places), None, cost)


@lru_cache(1 << 10)
def integrals(rule: str, length: int, degree: int, kappa: float, mu: float) -> Array:
    """Return the integrals of rho p_m over every cell, or times every hat."""
    pieces, count = length - (rule == "hat"), reference.quadrature_count(degree, kappa, mu)
    found = np.zeros((degree + 1, length))
    for j in range(pieces):
        points, mass = reference.piece_rule(j / pieces, (j + 1) / pieces, count, kappa, mu)
        values = reference.orthonormal(kappa, mu, degree, points) * mass
        if rule == "cell":
            found[:, j] = values.sum(axis=1)
        else:
            rising = points * pieces - j
            found[:, j] += values @ (1 - rising)
            found[:, j + 1] += values @ rising
    return found


@dataclass(frozen=True)
class Window(reference.Window):
    """One order of a design, with the samples that trimming leaves of its window."""

    first: int
    span: int
    trim: float
    halves: bool = False
    """Whether even windows are estimated in their middle, as SciPy does, and no root gains a degree."""

    @property
    def unit(self) -> float:
        """From derivatives on [0, 1] to derivatives in time."""
        return float((self.delta * (self.length - (self.rule in reference.NODES))) ** -self.deriv)

    @property
    def keeps_constants(self) -> bool:
        """Whether the library runs on differences."""
        return self.rule == "exact" or (self.rule in ("cell", "hat") and not self.trim)

    def basis(self, degree: int) -> Basis:
        """Return the basis for a fit, or a kernel, of a degree."""
        return basis(self.rule, self.length, degree, self.kappa, self.mu, self.first, self.span)

    def place(self, sample: float) -> float:
        """Return tau of a sample, counted from the first that is kept."""
        j = sample + self.first
        return (j + 0.5) / self.length if self.rule in reference.CELLS else j / (self.length - 1)

    def point(self, mode: str) -> tuple[int, float, int]:
        """Return the sample on which an estimate lies, from the first that is kept, its tau, and the fit's degree."""
        words = (self.length, self.deriv, self.degree, self.kappa, self.mu, self.tau, self.rule)
        tau, root = reference.resolve_tau(*words)
        degree = self.degree
        if root and self.rule == "exact" and not self.halves:
            degree = min(degree + 1, max(degree, self.length - 1))
        p = (tau * self.length - 0.5 if self.rule in reference.CELLS else tau * (self.length - 1)) - self.first
        tolerance = reference.SAMPLE_TOLERANCE * max(1.0, abs(p))
        if self.halves and self.length % 2 == 0:
            return self.length // 2 - 1, tau, degree
        nearest = math.floor(p + 0.5 + tolerance)
        own = mode == "valid" or abs(p - nearest) <= tolerance
        return (0 if mode == "valid" else nearest), (tau if own else self.place(nearest)), degree

    def weights(self, mode: str) -> tuple[int, Array, Array]:
        """Return where the estimates of a mode lie, their weights, and by how much each weight may be off."""
        sample, tau, degree = self.point(mode)
        b = self.basis(degree)
        (e,) = b.estimators(self.deriv, self.kappa, self.mu, np.array([tau]))
        off = 64 * EPS * b.lost * float(np.abs(e) @ np.abs(b.functionals).max(axis=1))
        return sample, e @ b.functionals * self.unit, off * self.unit


def window_maximum(values: Array, length: int) -> Array:
    """Return the largest value of every window along the last axis."""
    if length == 0:
        return np.zeros((*values.shape[:-1], values.shape[-1] + 1))
    return sliding_window_view(values, length, axis=-1).max(axis=-1)


def slid(window: Window, rows: Array, mode: str, engine: str, single: bool) -> tuple[Array, Array]:
    """Return the estimates of all whole windows of rows and how far those of an engine may be off; see `engines.bound`.

    What is not finite counts as 0. In weights that may be off by themselves, every sample counts by its distance from
    that in the middle, or where constants leak by its size.
    """
    sample, w, off = window.weights(mode)
    kind, length = (np.float64 if single else np.longdouble), len(w)
    views = sliding_window_view(np.where(np.isfinite(rows), rows, 0), length, axis=-1)
    middle = (
        int(np.clip(sample if mode != "valid" else (length - 1) / 2, 0, length - 1))
        if window.deriv == 0
        else length // 2
    )
    constants = window.keeps_constants and not (window.deriv == 0 and length == 1)
    center = views[..., middle].astype(kind) if constants else np.zeros(views.shape[:-1], kind)
    apart = views.astype(kind) - center[..., None]
    values = apart @ w.astype(kind) + (center if window.deriv == 0 and constants else 0)
    allowed = length * off * np.abs(apart).max(axis=-1).astype(float) + 64 * EPS * np.abs(values).astype(float)
    rounding = [_rounding(window, w, rows, constants, one, single) for one in BOUND[engine]]
    return values, allowed + np.max(rounding, axis=0)


def _rounding(window: Window, w: Array, rows: Array, constants: bool, engine: str, single: bool) -> Array:
    """Return the bounds of `engines.bound`, which says where they come from, for several rows."""
    info, length = np.finfo(np.float32 if single else np.float64), len(w)
    eps, tiny = float(info.eps), float(info.smallest_subnormal)
    filled = np.where(np.isfinite(rows), rows, 0)
    taps, s = np.abs(w), np.abs(filled)
    if constants:
        m = length - 1 if engine == "moments" and window.deriv == 0 else length // 2
        taps = np.abs(np.concatenate([np.cumsum(w[:m]), np.cumsum(w[:m:-1])[::-1]]))
        s = np.abs(np.diff(filled))
    top, largest = window_maximum(s, len(taps)), float(taps.max(initial=0.0))
    result = (length + 8) * eps * taps.sum() * top
    lost = (length + 8) * tiny * max(1.0, 2 * largest)
    if engine == "moments":
        terms = 3 * 64 + 16 * (window.degree + window.kappa + window.mu + 2) ** 2
        result = (eps * terms * taps.sum() + 1e-14 * len(taps) * largest) * top
        lost *= 64
    elif engine == "fft":
        points = max(2**14, 2 ** math.ceil(math.log2(16 * length)))
        near = np.minimum((2**5 if single else 2**10) * top, s.max(axis=-1, initial=0.0)[..., None])
        result = result + 8 * eps * math.log2(points) * math.sqrt(points) * float(np.linalg.norm(taps)) * near
        lost *= points
    if window.deriv == 0:
        result = result + 4 * eps * window_maximum(np.abs(filled), length)
    return result + lost


def fitted_ends(window: Window, rows: Array, places: Array, single: bool) -> tuple[Array, Array]:
    """Return estimates from one window per row, at samples of it or beyond, and how far off they may be.

    The library sums the functionals first, and then what multiplies them: both sums err by as many eps of their terms'
    sizes as they have terms, and the factors by `lost` more.
    """
    b = window.basis(window.degree)
    e = b.estimators(window.deriv, window.kappa, window.mu, np.array([window.place(k) for k in places])) * window.unit
    kind = np.float64 if single else np.longdouble
    filled = np.where(np.isfinite(rows), rows, 0).astype(kind)
    origin = filled[..., :1] if window.keeps_constants else np.zeros((len(rows), 1), kind)
    apart = filled - origin
    values = apart @ (e @ b.functionals).T.astype(kind) + (origin if window.deriv == 0 else 0)
    sizes = (np.abs(apart) @ np.abs(b.functionals).T).astype(float) @ np.abs(e).T
    largest = np.abs(apart).sum(axis=-1).astype(float)[:, None] * (np.abs(e) @ np.abs(b.functionals).max(axis=1))
    allowed = EPS * (64 * b.lost * largest + (len(b.functionals) + window.span + 8) * sizes)
    rounding = float(np.finfo(np.float32 if single else np.float64).eps)
    return values, allowed + 4 * rounding * np.abs(values).astype(float) + 4 * EPS * np.abs(origin).astype(float)


def expected(window: Window, rows: Array, mode: str, cval: float, engine: str, single: bool) -> tuple[Array, Array]:
    """Return the estimates of real rows in a mode, NaN where there is none, and how far off they may be."""
    n, span = rows.shape[-1], window.span
    gone = ~np.isfinite(rows)
    if mode == "valid":
        values, allowed = slid(window, rows, mode, engine, single)
        return np.where(touched(gone, span), np.nan, values), allowed
    c = window.point(mode)[0]
    if mode in reference.PAD_MODES:
        options = {"constant_values": cval} if mode == "constant" else {}
        around = ((0, 0), (max(0, c), max(0, span - 1 - c)))
        padded = np.pad(rows, around, reference.PAD_MODES[mode], **options)  # type: ignore[call-overload]
        values, allowed = slid(window, padded, mode, engine, single)
        values = np.where(touched(~np.isfinite(padded), span), np.nan, values)
        return values[:, max(0, -c) :][:, :n], allowed[:, max(0, -c) :][:, :n]
    out, allowed = np.full((len(rows), n), np.nan, np.longdouble), np.zeros((len(rows), n))
    values, off = slid(window, rows, mode, engine, single)
    values = np.where(touched(gone, span), np.nan, values)
    # Outputs before the first are of the first whole window, those from the last on of the last one.
    first, last = (int(np.clip(place, 0, n)) for place in (c, n - span + c + 1))
    if window.halves and mode == "fit":
        first, last = span // 2, n - span // 2
    out[:, first:last], allowed[:, first:last] = values[:, first - c : last - c], off[:, first - c : last - c]
    if mode == "fit":
        for whole, outputs in [(0, np.arange(first)), (n - span, np.arange(last, n))]:
            part = rows[:, whole : whole + span]
            found, off = fitted_ends(window, part, outputs - whole, single)
            out[:, outputs] = np.where(np.isfinite(part).all(axis=-1)[:, None], found, np.nan)
            allowed[:, outputs] = off
    return out, allowed


def touched(gone: Array, length: int) -> Array:
    """Return which windows hold a sample that is not finite."""
    return window_maximum(gone, length).astype(bool)
