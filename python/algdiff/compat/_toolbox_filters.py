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
        return np.apply_along_axis(np.convolve, -1, x, self.coefficients, "valid")

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


def _newton_cotes(of: Parameters, order: int, method: str, share: float | None, correct: bool) -> Discrete:
    steps = _steps(of, order, method)
    panel = PANELS[method]
    rule = np.zeros(steps + 1)
    for start in range(0, steps, panel):
        rule[start : start + panel + 1] += _panel(panel)
    nodes = np.arange(steps + 1) / steps
    values = of.of_order(order).impulse_response(nodes) / (steps * of.ts) ** (order + 1)
    coefficients = rule * values * of.ts
    sizes = np.abs(coefficients)
    held = (np.cumsum(s) <= (share or 0.0) * sizes.sum() for s in (sizes, sizes[::-1]))
    newest, oldest = (int(np.count_nonzero(some)) if share else 0 for some in held)
    coefficients = coefficients[newest : steps + 1 - oldest]
    gain = _gain(coefficients, order, of.ts) if correct else 1.0
    delay = ((1 - of.kernel.tau) * steps - newest) * of.ts
    tau2 = (steps - oldest) * of.ts
    return Discrete(coefficients / gain, gain, newest, delay, newest * of.ts, tau2, None, method, share)


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
        raise ValueError(
            f"T must be at least {max(least, panel)} steps of ts = {of.ts} for N = {of.N}, the derivative of order "
            f"{order} and method {method!r}, got {of.T}"
        )
    if method not in (*ON_CELLS, "analytic trapezoidal") and min(of.alpha, of.beta) < order:
        raise ValueError(
            f"min(alpha, beta) must be at least {order} for the derivative of order {order} with method {method!r}, "
            f"which samples the ends of the kernel, where it is infinite; use 'exact', "
            f"got {min(of.alpha, of.beta):g}"
        )
    return steps


def _gain(coefficients: NDArray[np.float64], order: int, ts: float) -> float:
    """Return what the filter makes of a power of time that it should make 1 of, time counted from the newest sample."""
    powers = (-ts * np.arange(coefficients.size)) ** order / math.factorial(order)
    gain = float(coefficients @ powers)
    if not gain > 0:
        raise ValueError(f"corr must be False: the window is too short for a correction, got a gain of {gain:.3g}")
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
