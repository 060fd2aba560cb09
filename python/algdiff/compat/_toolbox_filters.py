"""Discrete filters by the toolbox's names of their rules."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._differentiator import Differentiator
from algdiff._refusals import shown
from algdiff.compat._toolbox_analysis import second_integral
from algdiff.compat._toolbox_parameters import Parameters

RULES = {
    "mid-point": "midpoint",
    "trapezoidal": "trapezoid",
    "analytic": "cell",
    "analytic trapezoidal": "hat",
    "exact": "exact",
    "euler": "trapezoid",  # which it equals where the kernel ends with 0, and should elsewhere
    "simpson rule": "simpson",
}
PANELS = {
    "simpson rule": 2,
    "simpson 3/8 rule": 3,
    "boole rule": 4,
    "newton-cotes order 6": 6,
    "newton-cotes order 7": 7,
}
"""Steps of one panel: the window is a whole number of them."""
WHOLE = 1e-9
"""A window is a whole number of steps if it is one to within so many steps."""
UNROUNDED = ("mid-point", "trapezoidal", "euler", "analytic", "analytic trapezoidal")
"""Rules of which the window may end between two samples."""
ON_CELLS = ("mid-point", "analytic", "exact")
METHODS = tuple(dict.fromkeys((*RULES, *PANELS)))


class Discrete(NamedTuple):
    """A discrete filter.

    Attributes
    ----------
    coefficients : ndarray
        Newest sample first.
    gain : float
        What they were divided by.
    offset : float
        Steps from the newest end of the kernel's window to the newest sample.
    delay : float
        From the estimate to the newest sample.
    tau1, tau2 : float
        The part of the window that is left, from its newest end.
    design : Differentiator or None
        What has these weights, before they were divided.
    method : str
        The name of the rule.
    share : float or None
        What was trimmed by.
    """

    coefficients: NDArray[np.float64]
    gain: float
    offset: float
    delay: float
    tau1: float
    tau2: float
    design: Differentiator | None
    method: str
    share: float | None

    def estimate(self, x: Samples) -> Samples:
        """Return the estimates of all whole windows along the last axis."""
        if self.design is not None:
            estimates: Samples = self.design(x, mode="valid")
            return estimates if self.gain == 1 else estimates / self.gain
        # All rows at once, as one: windows that reach over from one row into the next are left out.
        length, size = x.shape[-1], self.coefficients.size
        whole = np.convolve(x.reshape(-1), self.coefficients)[: x.size] if x.size else x
        return np.asarray(whole.reshape(x.shape)[..., min(size - 1, length) :])

    def response(self, omega: NDArray[np.float64], ts: float) -> NDArray[np.complex128]:
        """Return the spectrum of the coefficients relative to the newest end of the kernel's window."""
        if self.design is not None:
            late = np.exp(-1j * omega * (self.delay + self.offset * ts))
            return np.asarray(self.design.frequency_response(omega / (2 * math.pi)) * late / self.gain)
        lag = (np.arange(self.coefficients.size) + self.offset) * ts
        return np.array([np.exp(-1j * one * lag) @ self.coefficients for one in omega.flat]).reshape(omega.shape)


def discretised(of: Parameters, order: int, method: str, share: float | None, correct: bool) -> Discrete:
    """Return the filter of a derivative; `share` of its size, if any, is left out at either end."""
    if method not in RULES:
        return _newton_cotes(of, order, method, share, correct)
    if method in UNROUNDED and not is_whole(of):
        return _unrounded(of, order, method, share, correct)
    cells = method in ON_CELLS
    steps = _steps(of, order, method)
    design = Differentiator(
        steps + (not cells),
        order,
        degree=of.N + order,
        kappa=of.beta - order,
        mu=of.alpha - order,
        tau=of.kernel.tau,
        delta=of.ts,
        rule=RULES[method],
        trim=share or 0.0,
    )
    coefficients = design.weights[::-1]
    half = 0.5 * cells
    left_out = round((1 - design.tau) * steps - half - design.delay_samples)
    gain = _gain(coefficients, order, of.ts) if correct and method != "exact" else 1.0
    span = coefficients.size - (not cells)
    return Discrete(
        coefficients / gain,
        gain,
        left_out + half,
        design.delay,
        left_out * of.ts,
        (left_out + span) * of.ts,
        design,
        method,
        share,
    )


def is_whole(of: Parameters) -> bool:
    """Return whether the window is a whole number of steps."""
    steps = of.T / of.ts
    return abs(steps - math.floor(steps + 0.5)) <= WHOLE


def _unrounded(of: Parameters, order: int, method: str, share: float | None, correct: bool) -> Discrete:
    """Return a filter whose window is no whole number of steps: the kernel is that of T, and 0 beyond."""
    _refuse_infinite_ends(of, order, method)
    ts, steps = of.ts, of.T / of.ts
    kernel = of.of_order(order)
    if method == "analytic":
        edges = np.arange(math.ceil(steps) + 1) * ts
        coefficients = np.diff(kernel.step_response(edges / of.T)) / of.T**order
    elif method == "analytic trapezoidal":
        edges = np.arange(-1, math.ceil(steps) + 2) * ts
        coefficients = np.diff(second_integral(of, order, edges), 2) / ts
    else:
        half = 0.5 * (method == "mid-point")
        nodes = np.arange(math.ceil(steps - half - WHOLE)) + half
        coefficients = ts * kernel.impulse_response(nodes / steps) / of.T ** (order + 1)
        coefficients[0] *= half + 0.5
        if of.beta == order:
            # The sum is the integral to the second order in ts, though the kernel jumps to 0 between two nodes.
            end = ts * kernel.impulse_response(1.0) / of.T ** (order + 1)
            coefficients[-1] += (steps - nodes[-1] - 0.5) * end
    least = of.N + order + 1
    if coefficients.size < least:
        raise ValueError(_too_short(of, order, method, least - (method not in ON_CELLS)))
    return _cut(of, order, method, share, correct, coefficients, of.T)


def _newton_cotes(of: Parameters, order: int, method: str, share: float | None, correct: bool) -> Discrete:
    steps = _steps(of, order, method)
    panel = PANELS[method]
    rule = np.zeros(steps + 1)
    for start in range(0, steps, panel):
        rule[start : start + panel + 1] += _panel(panel)
    nodes = np.arange(steps + 1) / steps
    values = of.of_order(order).impulse_response(nodes) / (steps * of.ts) ** (order + 1)
    return _cut(of, order, method, share, correct, rule * values * of.ts, steps * of.ts)


def _cut(
    of: Parameters,
    order: int,
    method: str,
    share: float | None,
    correct: bool,
    coefficients: NDArray[np.float64],
    window: float,
) -> Discrete:
    """Return the filter of coefficients that are no Differentiator's, whole samples of `share` left out."""
    sizes = np.abs(coefficients)
    held = (np.cumsum(s) <= (share or 0.0) * sizes.sum() for s in (sizes, sizes[::-1]))
    newest, oldest = (int(np.count_nonzero(some)) if share else 0 for some in held)
    last, half = coefficients.size - oldest, 0.5 * (method in ON_CELLS)
    coefficients = coefficients[newest:last]
    gain = _gain(coefficients, order, of.ts) if correct else 1.0
    delay = (1 - of.kernel.tau) * window - (newest + half) * of.ts
    tau2 = min((last - 1 + 2 * half) * of.ts, window) if oldest else window
    return Discrete(coefficients / gain, gain, newest + half, delay, newest * of.ts, tau2, None, method, share)


def _panel(steps: int) -> NDArray[np.float64]:
    """Return the weights of the rule that integrates polynomials of degree `steps` exactly from 0 to `steps`."""
    # Half of the way from the middle, so that the powers are small.
    nodes, powers = np.arange(steps + 1) * 2 / steps - 1, np.arange(steps + 1)
    moments = np.where(powers % 2, 0.0, 2.0 / (powers + 1))
    return np.linalg.solve(np.vander(nodes, increasing=True).T, moments) * steps / 2


def _steps(of: Parameters, order: int, method: str) -> int:
    """Return the length of the window in sampling steps: the nearest that the rule can take."""
    panel = PANELS.get(method, 1)
    least = of.N + order + (method in ON_CELLS)
    steps = panel * math.floor(of.T / of.ts / panel + 0.5)
    if steps < max(least, 1):
        raise ValueError(_too_short(of, order, method, max(least, panel)))
    _refuse_infinite_ends(of, order, method)
    return steps


def _too_short(of: Parameters, order: int, method: str, least: int) -> str:
    return (
        f"T must be at least {least} steps of ts = {of.ts} for N = {of.N}, the derivative of order {order} and method "
        f"{method!r}, got {of.T}"
    )


def _refuse_infinite_ends(of: Parameters, order: int, method: str) -> None:
    if method not in (*ON_CELLS, "analytic trapezoidal") and min(of.alpha, of.beta) < order:
        raise ValueError(
            f"min(alpha, beta) must be at least {order} for the derivative of order {order} with method {method!r}, "
            f"which samples the ends of the kernel, where it is infinite; use 'exact', "
            f"got {min(of.alpha, of.beta):g}"
        )


def _gain(coefficients: NDArray[np.float64], order: int, ts: float) -> float:
    """Return what the filter makes of a power of time that it should make 1 of, time counted from the newest sample."""
    powers = (-ts * np.arange(coefficients.size)) ** order / math.factorial(order)
    gain = float(coefficients @ powers)
    if not gain > 0:
        raise ValueError(
            f"corr=True cannot mend this filter of order {order}, got a gain of {gain:.3g} in place of 1: pass "
            "corr=False, the method 'exact', or more samples in the window"
        )
    return gain


def checked_method(method: object) -> str:
    """Return the name of a rule."""
    if not isinstance(method, str) or method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(map(repr, METHODS))}, got {shown(method)}")
    return method


def checked_share(share: object) -> float:
    """Return the share that is trimmed at either end."""
    number = arguments.real("redTol", share)
    if not 0 <= number < 0.5:
        raise ValueError(f"redTol must be at least 0 and less than 0.5, got {number}")
    return number
