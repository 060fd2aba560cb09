"""The class of the AlgDiff toolbox, on this library's core: a notebook changes by its import line."""

# ruff: noqa: N802, N803

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any, SupportsIndex

import numpy as np

from algdiff import _arguments as arguments
from algdiff._refusals import shown
from algdiff._warnings import DesignWarning, outside
from algdiff.compat._toolbox_discrete import Discretised
from algdiff.compat._toolbox_parameters import Parameters

__all__ = ["AlgebraicDifferentiator"]


class AlgebraicDifferentiator(Discretised):
    """An algebraic differentiator by the AlgDiff toolbox's names, methods and arguments (version 2.4).

    It says what the toolbox says where the toolbox is right, and the right thing where it is not; the methods name the
    differences, and the page "From the AlgDiff toolbox" lists them. Every method of the toolbox takes the name
    "exact" as well: the fit on the samples themselves, which differentiates polynomials exactly and lets no
    offset through. Use it unless the toolbox's numbers are to be reproduced.

    Parameters
    ----------
    ts : float
        Sampling step.
    alpha, beta : float
        Exponents of the kernel at the newest and the oldest end of the window, greater than -1, and than ``n - 1``
        for the derivative of order n.
    N : int
        Degree of the polynomial that the derivative is approximated by.
    T : float or None
        Length of the window. Between two whole numbers of steps "exact" and the Newton-Cotes rules take the nearest;
        the others leave the kernel as it is, and end at its end. The toolbox drops the samples and the part of the
        kernel beyond the last whole step, and counts 28 steps of 0.005 in ``29 * 0.005``.
    wc : float or None
        With ``T=None``: the lowest cutoff in rad per unit of `ts`. It is kept when other parameters change.
    display : bool
        Print the parameters, on one line.
    corr : bool
        Divide filters by what they make of ``t**n / n!`` instead of 1, time counted from the newest sample. It mends
        the gain and no offset; "exact" needs none and is left alone.

    Attributes
    ----------
    correction : bool
        `corr`; may be set.
    warningRelativeAttenuation : float
        `checkParameters` warns above this attenuation at half the sampling rate, in dB; -10.

    Raises
    ------
    ValueError
        A parameter is outside of what it may be, or neither `T` nor `wc` is given. The toolbox raises a plain
        Exception.

    Warns
    -----
    DesignWarning
        `wc` is given and not used, because `T`, which is 1 by default, is not None.

    Notes
    -----
    The methods ``set_...`` change the object as they do in the toolbox. All that follows from the parameters is
    designed anew: theta, unless it was set; the cutoff or the window; and the filters that were discretised, except
    those of orders that have become too high. A parameter that is refused changes nothing.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff.compat import AlgebraicDifferentiator
    >>> diff = AlgebraicDifferentiator(ts=0.01, alpha=2, beta=2, N=1, T=0.2)
    AlgebraicDifferentiator: alpha 2, beta 2, N 1, theta 0.377964, ts 0.01, T 0.2 (20 steps), delay 0.0622036,
    cutoff 30.1266 rad/s (4.79479 Hz)
    >>> t = np.arange(0, 1, 0.01)
    >>> slope = diff.estimateDer(1, t**2, method="exact")
    >>> late = t - diff.get_delayDiscrete()["exact"]
    >>> bool(np.allclose(slope[19:], 2 * late[19:])), bool(np.isnan(slope[:19]).all())
    (True, True)
    """

    def __init__(
        self,
        ts: float = 0.01,
        alpha: float = 1.0,
        beta: float = 1.0,
        N: SupportsIndex = 0,
        T: float | None = 1.0,
        wc: float | None = None,
        display: bool = True,
        corr: bool = True,
    ) -> None:
        if T is None and wc is None:
            raise ValueError("either T or wc must be given, got None for both")
        self._parameters = Parameters(ts, alpha, beta, N, None, T, None if T is not None else wc)  # type: ignore[arg-type]
        if T is not None and wc is not None:
            message = f"wc is not used where T is given: pass T=None for it, got T = {T} and wc = {shown(wc)}"
            warnings.warn(message, DesignWarning, stacklevel=outside())
        self._correction = bool(corr)
        self._filters = {}
        self.warningRelativeAttenuation = -10.0
        if display:
            self.printParam()

    def __repr__(self) -> str:
        of = self._parameters
        words = {name: getattr(of, name) for name in ("ts", "alpha", "beta", "N")}
        words |= {"T": of.window} if of.wc is None else {"T": None, "wc": of.wc}
        call = ", ".join(f"{name}={value!r}" for name, value in words.items())
        made = f"{type(self).__name__}({call}, corr={self._correction})"
        return made if of.theta is None else f"<{made} with theta set to {of.theta!r}>"

    @property
    def correction(self) -> bool:
        """Whether filters are divided by their gain."""
        return self._correction

    @correction.setter
    def correction(self, corr: bool) -> None:
        self._correction = bool(corr)
        self._anew()

    def checkParameters(self, der: SupportsIndex | None = None) -> None:
        """Refuse an order that is too high, and warn of aliasing.

        Parameters
        ----------
        der : int, optional
            Order of the derivative; without one there is nothing to check, as impossible parameters are refused when
            they are given.

        Raises
        ------
        ValueError
            ``min(alpha, beta)`` is not greater than ``der - 1``.

        Warns
        -----
        DesignWarning
            By the low-pass model half the sampling rate is attenuated by less than 10 dB against the cutoff.
        """
        if der is None:
            return
        of = self._parameters
        order = of.order("der", der)
        slope = min(of.alpha, of.beta) + 1 - order
        passed = 20 * slope * math.log10(of.cutoff * of.ts / math.pi)
        if passed > self.warningRelativeAttenuation:
            message = (
                f"half the sampling rate is attenuated by {-passed:.3g} dB against the cutoff, less than "
                f"{-self.warningRelativeAttenuation:g}: sample faster, or choose a longer window, a lower cutoff or "
                "larger alpha and beta"
            )
            warnings.warn(message, DesignWarning, stacklevel=outside())

    def printParam(self) -> None:
        """Print the parameters and what follows from them, on one line."""
        of = self._parameters
        names = ", ".join(f"{name} {getattr(of, name):g}" for name in ("alpha", "beta", "N"))
        print(
            f"{type(self).__name__}: {names}, theta {of.shown_theta:g}, ts {of.ts:g}, "
            f"T {of.T:g} ({of.T / of.ts:.6g} steps), delay {self.get_delay():g}, "
            f"cutoff {of.cutoff:g} rad/s ({of.cutoff / (2 * math.pi):g} Hz)"
        )

    def computeTfromWc(self, wc: float) -> None:
        """Choose the window by a cutoff, which other parameters then keep, until `set_T`.

        Parameters
        ----------
        wc : float
            The lowest cutoff in rad per unit of `ts`: the window is the longest whole number of steps whose cutoff is
            not below it. ``wc=20`` comes out at up to 20.6, as in the toolbox; `get_cutoffFreq` says at what.
        """
        self._change(window=None, wc=arguments.real("wc", wc))

    def set_T(self, T: float) -> None:
        """Set the length of the window; a cutoff that was given no longer holds."""
        self._change(window=arguments.real("T", T), wc=None)

    def set_samplingPeriod(self, ts: float) -> None:
        """Set the sampling step; filters are made anew, which the toolbox's are not."""
        self._change(ts=ts)

    def set_alpha(self, alpha: float) -> None:
        """Set the exponent of the kernel at the newest end; theta follows, unless it was set."""
        self._change(alpha=alpha)

    def set_beta(self, beta: float) -> None:
        """Set the exponent of the kernel at the oldest end; theta follows, unless it was set."""
        self._change(beta=beta)

    def set_N(self, N: SupportsIndex) -> None:
        """Set the degree of the approximating polynomial; theta follows, unless it was set."""
        self._change(N=N)

    def set_theta(self, theta: float, rootJacobiPol: bool) -> None:
        """Set the point of estimation, for good.

        Parameters
        ----------
        theta : float
            From -1, the oldest, to 1, the newest end of the window; above 1 it predicts. With the rules on cells
            ("exact", "mid-point", "analytic") the newest sample lies half a step before that end.
        rootJacobiPol : bool
            Whether theta is a root, which the degree of exactness depends on. It is looked up, not believed.

        Warns
        -----
        DesignWarning
            It is said to be a root and is none to 1e-12.
        """
        self._change(theta=theta)
        of = self._parameters
        if rootJacobiPol and of.N > 0 and of.kernel.exactness == of.N:
            roots = 2 * of.kernel.roots - 1
            message = f"theta is no root of the Jacobi polynomial, got {theta}: the nearest is "
            nearest = roots[np.argmin(np.abs(roots - of.shown_theta))]
            warnings.warn(f"{message}{nearest:.15g}", DesignWarning, stacklevel=outside())

    def _change(self, **changes: Any) -> None:
        """Take other parameters, if they are allowed, and make the filters anew."""
        self._parameters = replace(self._parameters, **changes)
        self._anew()
