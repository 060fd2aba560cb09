"""What the toolbox does with discrete filters, by this library's."""

# ruff: noqa: N802, N803

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._differentiator import Differentiator
from algdiff._refusals import shown
from algdiff.compat._toolbox_analysis import Continuous, Floats
from algdiff.compat._toolbox_filters import UNROUNDED, Discrete, checked_method, checked_share, discretised, is_whole
from algdiff.compat._toolbox_parameters import points


class Discretised(Continuous):
    """The methods of the toolbox that make, use and describe discrete filters."""

    _filters: dict[tuple[int, str], Discrete]
    _correction: bool

    def checkParameters(self, der: SupportsIndex | None = None) -> None:
        """Warn of aliasing; `AlgebraicDifferentiator` does."""
        raise NotImplementedError

    def discretize(
        self,
        der: SupportsIndex,
        method: str = "mid-point",
        redFilLength: bool = False,
        redTol: float = 0.01,
        discreteSpectrum: bool = False,
    ) -> Any:
        """Return the coefficients of a filter, and of all others that were made.

        Parameters
        ----------
        der : int
            Order of the derivative.
        method : str
            "mid-point", "trapezoidal", "analytic" and "analytic trapezoidal" are the toolbox's. "exact" is not in it,
            see above. "euler" is the trapezoidal rule: the toolbox counts both ends of the kernel fully and states
            half a step too little delay. "simpson rule", "simpson 3/8 rule", "boole rule", "newton-cotes order 6" and
            "newton-cotes order 7" have their nodes one step apart and a window of whole panels of 2, 3, 4, 6 and 7
            steps; the toolbox's have neither. These and "exact" need whole windows and take the nearest. The others
            keep the kernel where `T` ends between two samples: "mid-point" and "trapezoidal" sample it up to `T`, the
            "analytic" ones integrate all of it, which the toolbox cuts at the last whole step. Rules that sample the
            ends of the kernel refuse orders above ``min(alpha, beta)``, where it is infinite there.
        redFilLength : bool
            Leave out samples at both ends of the window.
        redTol : float
            They hold at most this share, per end, of the sum of the coefficients' sizes: whole samples, with "exact"
            fitted anew. The toolbox moves the samples off their grid.
        discreteSpectrum : bool
            Return theta as well.

        Returns
        -------
        coeff : dict
            ``coeff[der][method]`` holds the coefficients, newest sample first; of trimmed filters it is
            ``coeff[der][method + "-red"]``. A new dictionary.
        tau1, tau2 : float
            With `redFilLength`: where the window that is left begins and ends.
        theta : float
            With `discreteSpectrum`: steps from the newest end of the window to the newest sample.
        """
        order, word, share = self._asked("der", der, method, redFilLength, redTol)
        self.checkParameters(order)
        found = self._keep(order, word, share)
        coefficients: dict[int, dict[str, Floats]] = {}
        for (one, key), kept in self._filters.items():
            coefficients.setdefault(one, {})[key] = kept.coefficients.copy()
        more = (*((found.tau1, found.tau2) if redFilLength else ()), *((found.offset,) if discreteSpectrum else ()))
        return (coefficients, *more) if more else coefficients

    def estimateDer(
        self,
        k: SupportsIndex,
        x: ArrayLike,
        method: str = "mid-point",
        conv: str = "same",
        redFilLength: bool = False,
        redTol: float = 0.01,
    ) -> Samples:
        """Return estimates of a derivative as they come: of the window that ends with each sample.

        Parameters
        ----------
        k : int
            Order of the derivative.
        x : array_like
            Samples, `ts` apart along the last axis, of which the toolbox takes one only.
        method, redFilLength, redTol
            As in `discretize`.
        conv : {"same", "valid", "full"}
            Without influence. With "same", its default, the toolbox is one sample late when the number of
            coefficients is even; here all are what "valid" is there.

        Returns
        -------
        ndarray of float64 or complex128, in the shape of `x`
            Output i is the estimate at the time of sample i less ``get_delayDiscrete()[method]``. NaN before the first
            window is full, where the toolbox says 0, or takes samples before the first for 0; ``np.nan_to_num`` makes
            zeros of NaN. `algdiff.differentiate` returns estimates at the times of the samples, to both ends.

        Raises
        ------
        ValueError
            `x` is shorter than the window, where the toolbox returns more samples than it was given.
        TypeError
            `x` does not hold numbers, has masked values, or carries units.
        """
        if conv not in ("same", "valid", "full"):
            raise ValueError(f"conv must be 'same', 'valid' or 'full', got {shown(conv)}")
        order, word, share = self._asked("k", k, method, redFilLength, redTol)
        known = len(self._filters)
        kept = self._keep(order, word, share)
        if len(self._filters) > known:
            self.checkParameters(order)
        samples = arguments.signal("x", x)
        samples = samples.astype(np.complex128 if samples.dtype.kind == "c" else np.float64, copy=False)
        length = kept.coefficients.size
        if samples.shape[-1] < length:
            raise ValueError(f"x must have at least the {length} samples of the window, got {samples.shape[-1]}")
        estimates = np.full(samples.shape, np.nan, samples.dtype)
        estimates[..., length - 1 :] = kept.estimate(samples)
        return estimates

    def differentiator(self, der: SupportsIndex = 1, method: str = "exact") -> Differentiator:
        """Return the `algdiff.Differentiator` that estimates a derivative: the way on, which the toolbox has not.

        Parameters
        ----------
        der : int
            Order of the derivative.
        method : str
            As in `discretize`, but for the Newton-Cotes rules above Simpson's. Its weights are not corrected. With
            "exact" and "simpson rule" it is of the nearest window that they can take.

        Raises
        ------
        ValueError
            `T` ends between two samples, and `method` keeps the kernel there: no Differentiator has such a window.

        Examples
        --------
        >>> from algdiff.compat import AlgebraicDifferentiator
        >>> AlgebraicDifferentiator(alpha=2, beta=2, N=1, T=0.2, display=False).differentiator().exactness
        3
        """
        order, word, share = self._asked("der", der, method, False, 0.0)
        of = self._parameters
        if word in UNROUNDED and not is_whole(of):
            raise ValueError(
                f"T must be a whole number of steps of ts = {of.ts} for a Differentiator with method {word!r}, "
                f"got {of.T}: use 'exact', which takes the nearest window"
            )
        design = discretised(of, order, word, share, correct=False).design
        if design is None:
            raise ValueError(f"method must be one of a Differentiator's rules, such as 'exact', got {method!r}")
        return design

    def get_delayDiscrete(self) -> dict[str, float]:
        """Return the delay of every filter that was made, by its method; of several orders, the newest's.

        The toolbox's "euler", "analytic trapezoidal" and Newton-Cotes filters state half a step too little or too much.
        """
        return {key: kept.delay for (_, key), kept in self._filters.items()}

    def get_ampSpectrumDiscreteFilter(
        self, omega: ArrayLike, n: SupportsIndex, method: str = "mid-point"
    ) -> tuple[Floats, Floats]:
        """Return amplitude and unwrapped phase of the spectrum of a filter.

        Parameters
        ----------
        omega : array_like of float
            In rad per unit of `ts`.
        n : int
            Order of the derivative, which the spectrum includes.
        method : str
            As in `discretize`.

        Returns
        -------
        amplitude, phase : ndarray of float64
            Each in the shape of `omega`; the phase relative to the newest end of the window.
        """
        response = self._response(points("omega", omega), "n", n, method)
        return np.abs(response), np.unwrap(np.angle(response))

    def get_discretizationError(
        self, k: SupportsIndex, Omega: float, n: SupportsIndex = 1000, method: str = "mid-point"
    ) -> float:
        """Return the energy of the difference between the spectra of filter and kernel, over that of the kernel's.

        Parameters
        ----------
        k : int
            Order of the derivative.
        Omega : float
            Compare up to this frequency, in rad per unit of `ts`.
        n : int
            At this many frequencies. `Differentiator.discretisation_error` needs no such number.
        method : str
            As in `discretize`.

        Returns
        -------
        float
            The toolbox raises an AttributeError on NumPy 2.4.
        """
        of = self._parameters
        omega = np.linspace(0, arguments.real("Omega", Omega), arguments.integer("n", n, 2))
        response = self._response(omega, "k", k, method)
        ideal = of.kernel.frequency_response(omega * of.T, reference=1) * (1j * omega) ** arguments.integer("k", k, 0)
        trapezoid = np.ones(omega.size)
        trapezoid[[0, -1]] = 0.5
        return float(trapezoid @ np.abs(response - ideal) ** 2 / (trapezoid @ np.abs(ideal) ** 2))

    def exportFilterCoefficients2Ccode(
        self, n: SupportsIndex, method: str = "mid-point", filename: str = "g", header: str = "G"
    ) -> None:
        """Write the coefficients of a filter to a C header, named as the toolbox names them.

        `Differentiator.to_c` returns a header that also applies them to samples as they come.

        Parameters
        ----------
        n : int
            Order of the derivative.
        method : str
            As in `discretize`.
        filename : str
            The file is ``filename + str(n) + ".h"``; it is replaced.
        header : str
            What the name of the include guard starts with.
        """
        order, word, _ = self._asked("n", n, method, False, 0.0)
        coefficients = self.discretize(order, word)[order][word]
        guard, values = f"{header}{order}_H", ",\n".join(f"    {value!r}" for value in coefficients.tolist())
        text = f"""\
/* Newest sample first. Written by algdiff: change the design, not this file. */
#ifndef {guard}
#define {guard}

#define WINDOW_LENGTH_G{order} {coefficients.size}
#define TS_AlgDiff {self._parameters.ts!r}

static const double AlgDiff_g{order}[] = {{
{values}
}};

#endif /* {guard} */
"""
        Path(f"{filename}{order}.h").write_text(text, encoding="utf-8")

    def _asked(
        self, name: str, der: object, method: object, reduced: object, tolerance: object
    ) -> tuple[int, str, float | None]:
        """Return order, rule and share to trim, or None, of the filter that is asked for."""
        order = self._parameters.order(name, der)
        return order, checked_method(method), checked_share(tolerance) if reduced else None

    def _keep(self, order: int, method: str, share: float | None) -> Discrete:
        """Return a filter, and remember it as the newest."""
        key = order, method if share is None else f"{method}-red"
        kept = self._filters.pop(key, None)
        if kept is None or kept.share != share:
            kept = discretised(self._parameters, order, method, share, self._correction)
        self._filters[key] = kept
        return kept

    def _anew(self) -> None:
        """Make all filters anew, except those of orders that have become too high or windows that are too short."""
        kept, self._filters = self._filters, {}
        for (order, _), one in kept.items():
            with suppress(ValueError):
                self._keep(order, one.method, one.share)

    def _response(self, omega: Floats, name: str, order: object, method: object) -> Any:
        number, word, share = self._asked(name, order, method, False, 0.0)
        return self._keep(number, word, share).response(omega, self._parameters.ts)
