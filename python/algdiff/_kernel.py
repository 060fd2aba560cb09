"""The continuous kernel."""

from __future__ import annotations

from typing import Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff import _core
from algdiff._refusals import shown


class Asymptotes(NamedTuple):
    """Amplitudes that bracket a frequency response beyond its cutoff.

    Attributes
    ----------
    upper, lower : float or ndarray
        Sum and difference of the contributions of the two ends of the window: at high frequencies the amplitude lies
        between them.
    low_pass : float or ndarray
        An ideal differentiator up to the cutoff, and the steeper of the two contributions beyond it; NaN where there
        is no cutoff.

    Examples
    --------
    >>> from algdiff import Kernel
    >>> k = Kernel(1, kappa=0, mu=0)
    >>> bounds = k.asymptotes(300.0)
    >>> bool(bounds.lower <= abs(k.frequency_response(300.0)) <= bounds.upper)
    True
    """

    upper: Any
    lower: Any
    low_pass: Any


class Kernel:
    r"""Continuous kernel of an algebraic differentiator, for a window of length T = 1.

    The estimate of the derivative of order `deriv` at the point `tau` of the window `[t0, t0 + T]` is

    .. math:: T^{-n} \int_0^1 k(s)\, x(t_0 + T s)\, ds, \qquad
              k(s) = \rho(s) \sum_{m=n}^{N} p_m^{(n)}(\tau)\, p_m(s),

    with n = `deriv`, N = `degree`, the density :math:`\rho \propto s^\kappa (1 - s)^\mu` and its orthonormal
    polynomials :math:`p_m`: the derivative at `tau` of the weighted least-squares polynomial of degree N (Mboup,
    Join and Fliess 2007, section II).

    Parameters
    ----------
    deriv : int
        Order of the derivative, at least 0.
    degree : int, optional
        Degree of the local polynomial, from `deriv` to 500; default ``deriv + 2``.
    kappa, mu : float
        Exponents of the weight at the oldest (0) and the newest (1) end, greater than -1.
    tau : {"center", "root", "newest"} or float
        Point of estimation: 0 is the oldest, 1 the newest end; beyond 1 the kernel predicts. "root" is the largest
        of `roots`. A number within 1e-12 of a root counts as the root.

    Attributes
    ----------
    deriv, degree, kappa, mu, tau
        The arguments, `tau` as a number.
    exactness : int
        Polynomials up to this degree are differentiated exactly: `degree`, or one more if `tau` is a root.
    bias_constant, bias_order : float, int
        On a smooth signal the estimate errs by ``bias_constant * T**p * x^(deriv + p)`` to leading order, p =
        `bias_order`.
    bias_bound : float
        And never by more than ``bias_bound * T**p`` times the largest size of that derivative on the window.
    norm1, norm2 : float
        Integrals of the absolute value and of the square of k. A disturbance of size d and any shape moves the
        estimate by at most ``d * norm1 / T**deriv``; white noise of variance s**2, sampled every delta, gives it the
        variance ``s**2 * delta * norm2 / T**(2 * deriv + 1)``. `norm2` is infinite if an exponent is -1/2 or less.
    moment_delay : float
        Delay at low frequencies, in window lengths: ``1 - tau``, unless ``degree == deriv``, when the kernel does not
        depend on `tau`.
    cutoff : float or None
        ``omega * T`` at which the asymptote of the response meets that of an ideal differentiator (Kiltz and
        Rudolph): a low-pass model, not a -3 dB point. None if the kernel has a zero at the end that governs, or if
        the model has no number for it, next to an exponent of -1.
    half_power : float or None
        The smallest ``omega * T`` at which the amplitude, relative to an ideal differentiator, falls through
        ``1 / sqrt(2)``; None if it does not within 50,000 steps, each a fiftieth of what the density's width allows:
        exponents near -1, or a `tau` far from all weight.
    roll_off : float
        Beyond the cutoff the amplitude, relative to an ideal differentiator, falls by ``20 * roll_off`` dB a decade:
        ``min(kappa, mu) + deriv + 1``.
    asymptote_constants : tuple of two floats
        A0 and A1 of `asymptotes`, for the oldest and the newest end.
    roots : ndarray of shape (degree - deriv + 1,)
        The points at which one more degree is reproduced, ascending.

    Raises
    ------
    ValueError
        An argument is outside of what it may be.
    TypeError
        An argument is of the wrong type.

    Examples
    --------
    >>> from algdiff import Kernel
    >>> k = Kernel(1, 1, kappa=0, mu=0)
    >>> k([0.0, 0.25, 1.0])
    array([-6., -3.,  6.])
    >>> round(k.norm1, 9), round(k.norm2, 9), k.exactness
    (3.0, 12.0, 2)
    >>> round(k.cutoff, 3), round(k.half_power, 3)
    (2.449, 3.63)
    """

    __slots__ = ("_kernel", "degree", "deriv", "kappa", "mu", "tau")

    _kernel: _core.Kernel
    deriv: int
    degree: int
    kappa: float
    mu: float
    tau: float

    def __init__(
        self,
        deriv: SupportsIndex,
        degree: SupportsIndex | None = None,
        kappa: float = 1.0,
        mu: float = 1.0,
        tau: float | str = "center",
    ) -> None:
        order = arguments.integer("deriv", deriv, 0)
        size = order + 2 if degree is None else arguments.integer("degree", degree, 0)
        kappa, mu = arguments.real("kappa", kappa), arguments.real("mu", mu)
        kernel = _core.Kernel(order, size, kappa, mu, arguments.word_or_real("tau", tau))
        for name, value in zip(self.__slots__, (kernel, size, order, kappa, mu, kernel.tau), strict=True):
            object.__setattr__(self, name, value)

    def __call__(self, points: ArrayLike) -> Any:
        """Return the kernel at `points` of [0, 1], in their shape; it is zero outside.

        Parameters
        ----------
        points : array_like of float
            Points of the window.

        Returns
        -------
        float or ndarray of float64, in the shape of `points`
        """
        flat, shape = arguments.points("points", points)
        values = np.empty(flat.shape)
        self._kernel.values(flat, values)
        return values.reshape(shape)[()]

    def frequency_response(self, omega_T: ArrayLike, reference: float | None = None) -> Any:  # noqa: N803
        r"""Return the frequency response of the estimate.

        .. math:: H(\omega)\, T^n = \int_0^1 k(s)\, e^{i \omega T (s - r)}\, ds

        is the estimate on :math:`e^{i \omega t}` relative to the signal at the point r of the window, times
        :math:`T^n`; that of an ideal differentiator is :math:`(i \omega T)^n`. Accurate at every frequency: relative to
        the ideal one in the pass band, and to the contributions of the two ends of the window in the stop band, but for
        rounding errors of about 1e-16 `norm1` where that is large.

        Parameters
        ----------
        omega_T : array_like of float
            Angular frequency times the length of the window, of either sign.
        reference : float, optional
            The point r that the phase refers to: 0 the oldest, 1 the newest end; `tau` by default.

        Returns
        -------
        complex or ndarray of complex128, in the shape of `omega_T`

        Examples
        --------
        >>> from algdiff import Kernel
        >>> response = Kernel(1).frequency_response([0.01, 100.0])
        >>> bool(abs(response[0] / 0.01j - 1) < 1e-8), bool(abs(response[1]) < 1)
        (True, True)
        """
        flat, shape = arguments.points("omega_T", omega_T)
        place = self.tau if reference is None else arguments.real("reference", reference)
        values = np.empty(flat.shape, np.complex128)
        self._kernel.frequency_response(flat, place, values)
        return values.reshape(shape)[()]

    def asymptotes(self, omega_T: ArrayLike) -> Asymptotes:  # noqa: N803
        r"""Return what the amplitude of the response tends to beyond the cutoff.

        With a = `kappa` + n and b = `mu` + n the two ends of the window contribute
        :math:`w^n A_0 / w^{a+1}` and :math:`w^n A_1 / w^{b+1}` at :math:`w = |\omega T|`.

        Parameters
        ----------
        omega_T : array_like of float
            Angular frequency times the length of the window; infinite or NaN values where it is 0.

        Returns
        -------
        Asymptotes
            Amplitudes in the shape of `omega_T`, to compare with ``abs(frequency_response(omega_T))``.
        """
        flat, shape = arguments.points("omega_T", omega_T)
        size = np.abs(flat)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ln_size = np.log(size)
            oldest, newest = (
                np.exp(constant - (exponent + 1) * ln_size)
                for constant, exponent in zip(self._kernel.ln_asymptotes, (self.kappa, self.mu), strict=True)
            )
            ln_cutoff = np.nan if self.cutoff is None else np.log(self.cutoff)
            # Up to the cutoff size**deriv; beyond it lower by `roll_off` powers, and never a product of infinity and 0.
            flat_part = self.deriv * np.minimum(ln_size, ln_cutoff) if self.deriv else 0.0 * ln_cutoff
            falling = (self.deriv - self.roll_off) * np.maximum(ln_size - ln_cutoff, 0.0)
            model = np.exp(flat_part + falling)
            both = (oldest + newest, np.abs(oldest - newest), model)
        return Asymptotes(*(values.reshape(shape)[()] for values in both))

    def impulse_response(self, t: ArrayLike) -> Any:
        """Return the response of a causal window to a unit impulse: the kernel read backwards, ``k(1 - t)``.

        Parameters
        ----------
        t : array_like of float
            Time since the impulse, in window lengths.

        Returns
        -------
        float or ndarray of float64, in the shape of `t`
        """
        return self(1.0 - arguments.points("t", t)[0].reshape(np.shape(t)))

    def step_response(self, t: ArrayLike) -> Any:
        """Return the response of a causal window to a unit step: the integral of the impulse response from 0 to `t`.

        Parameters
        ----------
        t : array_like of float
            Time since the step, in window lengths.

        Returns
        -------
        float or ndarray of float64, in the shape of `t`
            0 before the step; after one window length 1 for ``deriv == 0`` and 0 otherwise.
        """
        flat, shape = arguments.points("t", t)
        values = np.empty(flat.shape)
        self._kernel.step_response(flat, values)
        return values.reshape(shape)[()]

    def optimal_duration(
        self, noise_level: float, derivative_bound: float, delta: float = 1.0, *, bounded: bool = False
    ) -> float:
        r"""Return the window length at which noise and bias together are least.

        .. math:: T^* = \left[ \frac{(2n + 1)\, V}{2p\, B} \right]^{1 / (2p + 2n + 1)}, \quad
                  V = \sigma^2\, \delta \int k^2, \quad B = (C M)^2

        Parameters
        ----------
        noise_level : float
            Standard deviation of white noise in the samples; with `bounded` the largest size of a disturbance.
        derivative_bound : float
            M, the largest size of the derivative of order ``deriv + bias_order`` of the signal.
        delta : float
            Sampling step.
        bounded : bool
            Take the noise for any disturbance within the bound, for which `delta` has no influence:
            ``T = (n d norm1 / (p |C| M))**(1 / (n + p))``.

        Returns
        -------
        float
            In the unit of `delta`.

        Raises
        ------
        ValueError
            A number is not positive; an exponent is -1/2 or less, so that the noise gain is infinite; or `bounded` with
            ``deriv == 0``.
        """
        noise_level, derivative_bound = _conditions(noise_level, derivative_bound)
        delta = arguments.real("delta", delta)
        if not isinstance(bounded, (bool, np.bool_)):
            raise TypeError(f"bounded must be True or False, got {shown(bounded)}")
        return self._kernel.optimal_duration(noise_level, derivative_bound, delta, bool(bounded))

    def rmse(self, duration: float, noise_level: float, derivative_bound: float, delta: float = 1.0) -> float:
        """Return the root of bias squared plus variance, to leading order, for a window of length `duration`.

        Parameters
        ----------
        duration : float
            Length of the window, in the unit of `delta`.
        noise_level, derivative_bound, delta
            As in `optimal_duration`.

        Returns
        -------
        float
            In the unit of the derivative.
        """
        noise_level, derivative_bound = _conditions(noise_level, derivative_bound)
        duration, delta = arguments.real("duration", duration), arguments.real("delta", delta)
        return self._kernel.rmse(duration, noise_level, derivative_bound, delta)

    @property
    def exactness(self) -> int:
        """Polynomials up to this degree are differentiated exactly."""
        return self._kernel.exactness

    @property
    def bias_order(self) -> int:
        """Power of T in the leading error."""
        return self._kernel.bias[0]

    @property
    def bias_constant(self) -> float:
        """Factor of the leading error."""
        return self._kernel.bias[1]

    @property
    def bias_bound(self) -> float:
        """Factor of the largest error."""
        return self._kernel.bias_bound

    @property
    def norm1(self) -> float:
        """Integral of the absolute kernel."""
        return self._kernel.norm1()

    @property
    def norm2(self) -> float:
        """Integral of the squared kernel."""
        return self._kernel.norm2

    @property
    def moment_delay(self) -> float:
        """Delay at low frequencies, in window lengths."""
        return self._kernel.moment_delay

    @property
    def cutoff(self) -> float | None:
        """Cutoff of Kiltz and Rudolph as omega T, or None."""
        return self._kernel.cutoff

    @property
    def half_power(self) -> float | None:
        """The -3 dB point as omega T, or None."""
        return self._kernel.half_power()

    @property
    def roll_off(self) -> float:
        """Power of 1/omega with which the amplitude falls against an ideal differentiator."""
        return self._kernel.roll_off

    @property
    def asymptote_constants(self) -> tuple[float, float]:
        """A0 and A1 of the asymptotes; infinite where they overflow."""
        with np.errstate(over="ignore"):
            oldest, newest = np.exp(self._kernel.ln_asymptotes)
        return float(oldest), float(newest)

    @property
    def roots(self) -> NDArray[np.float64]:
        """Points at which one more degree is reproduced, ascending."""
        return self._kernel.roots()

    @property
    def _key(self) -> tuple[int, int, float, float, float]:
        return self.deriv, self.degree, self.kappa, self.mu, self.tau

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a Kernel does not change: cannot set {name}, make another")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a Kernel does not change: cannot delete {name}, make another")

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if isinstance(other, Kernel) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[type, tuple[int, int, float, float, float]]:
        return Kernel, self._key

    def __repr__(self) -> str:
        return f"Kernel(deriv={self.deriv}, degree={self.degree}, kappa={self.kappa}, mu={self.mu}, tau={self.tau})"


def _conditions(noise_level: object, derivative_bound: object) -> tuple[float, float]:
    return arguments.real("noise_level", noise_level), arguments.real("derivative_bound", derivative_bound)
