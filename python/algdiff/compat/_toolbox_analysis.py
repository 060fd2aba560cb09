"""What the toolbox says of a continuous kernel, by this library's."""

# ruff: noqa: N802

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._kernel import Kernel
from algdiff._refusals import shown
from algdiff.compat._toolbox_parameters import Parameters, points

Floats = NDArray[np.float64]
FINE = 10
"""Points per sampling step at which `reduceFilterLength` sums."""


class Continuous:
    """The methods of the toolbox that need no discrete filter. Times are lags from the newest end of the window."""

    _parameters: Parameters

    def get_alpha(self) -> float:
        """Return the exponent of the kernel at the newest end of the window."""
        return self._parameters.alpha

    def get_beta(self) -> float:
        """Return the exponent of the kernel at the oldest end of the window."""
        return self._parameters.beta

    def get_N(self) -> int:
        """Return the degree of the polynomial that the derivative is approximated by."""
        return self._parameters.N

    def get_theta(self) -> float:
        """Return the point of estimation, from -1, the oldest, to 1, the newest end of the window.

        The one that was set, or the largest root for the present alpha, beta and N; 0 for ``N = 0``, where it is not
        used. The toolbox's goes stale when alpha, beta or N change.
        """
        return self._parameters.shown_theta

    def get_ts(self) -> float:
        """Return the sampling step."""
        return self._parameters.ts

    def get_T(self) -> float:
        """Return the length of the window.

        The length that was given. With a cutoff instead, the longest whole number of steps whose cutoff is not lower,
        as in the toolbox.
        """
        return self._parameters.T

    def get_cutoffFreq(self) -> float:
        """Return the cutoff in rad/s; NaN if the kernel has none.

        For ``alpha = beta`` and two negative constants the toolbox says NaN where there is one.
        """
        return self._parameters.cutoff

    def get_delay(self) -> float:
        """Return the delay of the continuous kernel, the unit of `ts`; below 0 for a prediction."""
        return self._parameters.kernel.moment_delay * self._parameters.T

    def get_degreeExactness(self, n: int) -> int:
        """Return the degree up to which the derivative of polynomials is exact.

        Parameters
        ----------
        n : int
            Order of the derivative.

        Returns
        -------
        int
            ``n + N``, or one more if theta is a root or not used. Whether it is one is looked up: the toolbox believes
            the flag that `set_theta` was given.
        """
        return arguments.integer("n", n, 0) + self._parameters.kernel.exactness

    def evalKernel(self, t: ArrayLike) -> Floats:
        """Return the kernel, the impulse response of the filter that smooths.

        Parameters
        ----------
        t : array_like of float
            Time since the impulse.

        Returns
        -------
        ndarray of float64
            In the shape of `t`, or of shape (1,) for a number. Infinite at an end whose exponent is negative, where the
            toolbox says 0.
        """
        return self.evalKernelDer(t, 0)

    def evalKernelDer(self, t: ArrayLike, k: int) -> Floats:
        """Return the derivative of the kernel, the impulse response of the filter that differentiates.

        Parameters
        ----------
        t : array_like of float
            Time since the impulse.
        k : int
            Order of the derivative, less than ``min(alpha, beta) + 1``.

        Returns
        -------
        ndarray of float64
            As from `evalKernel`.

        Raises
        ------
        ValueError
            The order is too high, so that no filter has this impulse response; the toolbox returns what is left of it
            between the ends.
        """
        of = self._parameters
        order = of.order("k", k)
        values: Floats = of.of_order(order).impulse_response(points("t", t) / of.T) / of.T ** (order + 1)
        return values

    def get_integralKernel(self, t: ArrayLike, nested: int = 1) -> Any:
        """Return the integral of the kernel from 0 to `t`, or the integral of that.

        Parameters
        ----------
        t : array_like of float
            Upper limits; at and beyond both ends of the window, where the toolbox says NaN, too.
        nested : {1, 2}
            How many times to integrate.

        Returns
        -------
        float or ndarray of float64, in the shape of `t`
        """
        number = arguments.integer("nested", nested, 1)
        if number > 2:
            raise ValueError(f"nested must be 1 or 2, got {shown(number)}")
        of = self._parameters
        times = points("t", t).reshape(np.shape(t))
        return of.kernel.step_response(times / of.T) if number == 1 else second_integral(of, 0, times)

    def get_stepResponse(self, t: ArrayLike) -> Any:
        """Return the response to a unit step.

        Parameters
        ----------
        t : array_like of float
            Time since the step.

        Returns
        -------
        float or ndarray of float64, in the shape of `t`
            For ``N >= 1`` the toolbox has it wrong, and differs from its own `get_integralKernel`.
        """
        return self.get_integralKernel(t)

    def get_ampAndPhaseFilter(self, omega: ArrayLike) -> tuple[Floats, Floats]:
        """Return amplitude and unwrapped phase of the spectrum of the kernel.

        Parameters
        ----------
        omega : array_like of float
            In rad per unit of `ts`.

        Returns
        -------
        amp, phase : ndarray of float64
            Each in the shape of `omega`. In float64, where the toolbox computes with 150 digits and leaves mpmath set
            to them.
        """
        frequency = points("omega", omega)
        response = self._parameters.kernel.frequency_response(frequency * self._parameters.T, reference=1)
        return np.abs(response), np.unwrap(np.angle(response))

    def get_asymptotesAmpFilter(self, omega: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return bounds of the amplitude beyond the cutoff, and the low-pass model.

        Parameters
        ----------
        omega : array_like of float
            In rad per unit of `ts`.

        Returns
        -------
        ub, lb, mb : ndarray of float64
            Upper and lower bound and model, each in the shape of `omega`. The model is NaN if there is no cutoff.
        """
        bounds = self._parameters.kernel.asymptotes(points("omega", omega) * self._parameters.T)
        return bounds.upper, bounds.lower, bounds.low_pass

    def get_ratioNyquistCutoff(self, k: int | Sequence[int]) -> Any:
        """Return the amplitude at half the sampling rate over that at the cutoff, in dB.

        Parameters
        ----------
        k : int or sequence of int
            Orders of derivatives.

        Returns
        -------
        float or ndarray of float64, in the shape of `k`
            NaN if there is no cutoff.
        """
        of = self._parameters
        edges = np.array([of.cutoff, np.pi / of.ts])
        low, high = np.abs(of.kernel.frequency_response(edges * of.T))
        return 20 * (np.log10(high / low) + np.asarray(k, np.float64) * np.log10(edges[1] / edges[0]))[()]

    def reduceFilterLength(self, der: int, tol: float = 0.01) -> tuple[float, float, Floats, Floats, int]:
        """Return between which times the window holds most of the kernel.

        Parameters
        ----------
        der : int
            Order of the derivative.
        tol : float
            Share of the integral of the absolute kernel that lies before the first of them, and after the second.

        Returns
        -------
        tau1, tau2 : float
            The times, of those in `t`.
        d : ndarray of float64
            The share that lies before every time in `t`: the sum of exact integrals over the pieces between,
            where the toolbox takes the trapezoidal rule, so that a value may lie at a neighbouring time.
        t : ndarray of float64
            Ten times per sampling step.
        n : int
            10.
        """
        of = self._parameters
        share = arguments.real("tol", tol)
        if not 0 <= share < 0.5:
            raise ValueError(f"tol must be at least 0 and less than 0.5, got {share}")
        order = of.order("der", der)
        t: Floats = (of.ts / FINE) * np.arange(float(math.ceil(of.T / of.ts * FINE - 1e-6)))
        d = np.cumsum(np.abs(np.diff(of.of_order(order).step_response(t / of.T), prepend=0.0)))
        d /= d[-1]
        first = int(np.searchsorted(d, share))
        last = int(np.searchsorted(d, 1 - d[first]))
        return float(t[first]), float(t[last]), d, t, FINE

    def timeShift(self, t: ArrayLike) -> Any:
        """Return times as places in the window from 1, the newest end, to -1, the oldest: ``1 - 2 / T * t``."""
        return 1 - 2 / self._parameters.T * points("t", t).reshape(np.shape(t))[()]

    def weightFcn(self, a: float, b: float, t: ArrayLike) -> Floats:
        """Return the weight of the Jacobi polynomials, ``(1 - t)**a * (1 + t)**b`` from -1 to 1 and 0 elsewhere.

        Parameters
        ----------
        a, b : float
            Exponents.
        t : array_like of float
            Places as from `timeShift`. Not changed: the toolbox writes into them.

        Returns
        -------
        ndarray of float64
            In the shape of `t`, or of shape (1,) for a number. Infinite at an end whose exponent is negative, where the
            toolbox says 0.
        """
        places = points("t", t)
        newest, oldest = arguments.real("a", a), arguments.real("b", b)
        inside = np.abs(places) <= 1
        weight = np.zeros_like(places)
        with np.errstate(divide="ignore"):
            weight[inside] = (1 - places[inside]) ** newest * (1 + places[inside]) ** oldest
        return weight


def second_integral(of: Parameters, order: int, times: Any) -> Any:
    """Return the integral from 0 to `times` of the integral of the kernel of a derivative."""
    lag = times / of.T
    if order > 0:
        return of.of_order(order - 1).step_response(lag) / of.T ** (order - 1)
    return (np.maximum(lag, 0) * of.kernel.step_response(lag) - _first_moment(of, lag)) * of.T


def _first_moment(of: Parameters, lag: Any) -> Any:
    """Return the integral of s g(s) from 0 to `lag`, for a window of length 1.

    As s g(s) is a polynomial of degree N with the exponent alpha + 1 at the newest end, it is a sum of the kernels of
    that exponent whose points of estimation are the N + 1 roots.
    """
    moment = np.zeros(np.shape(lag))
    for root in Kernel(0, of.N, of.beta, of.alpha + 1).roots:
        kernel = Kernel(0, of.N, of.beta, of.alpha + 1, root)
        share = (1 - root) * of.kernel(root) / kernel(root)
        moment += share * kernel.step_response(lag)
    return moment[()]
