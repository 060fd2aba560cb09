"""What the weights of a design do to signals, to noise and to frequencies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._core import Bank, Plan
from algdiff._kernel import Asymptotes, Kernel
from algdiff._orders import each, stacked


class Filter:
    """The analysis of a `Differentiator`, which documents the attributes."""

    __slots__ = (
        "_asked",
        "_bank",
        "_crowded",
        "_leading",
        "_plan",
        "_plans",
        "_weights",
        "degree",
        "delta",
        "deriv",
        "kappa",
        "mu",
        "rule",
        "tau",
        "trim",
        "window_length",
    )

    _asked: dict[str, Any]
    _bank: Bank
    _crowded: bool
    _leading: int | None
    _plan: Plan
    _plans: list[Plan]
    _weights: NDArray[np.float64]
    window_length: int
    deriv: Any
    degree: int
    kappa: float
    mu: float
    tau: float
    delta: float
    rule: str
    trim: float

    @stacked
    def frequency_response(self, frequency: ArrayLike) -> Any:
        r"""Return the frequency response of the weights.

        .. math:: H(f) = \sum_j w_j\, e^{2 \pi i f (t_j - t)}

        is the estimate on :math:`e^{2 \pi i f t}` relative to the signal at the time t of the estimate; that of an
        ideal differentiator is :math:`(2 \pi i f)^n`.

        Parameters
        ----------
        frequency : array_like of float
            In cycles per unit of `delta`: Hz for seconds.

        Returns
        -------
        complex or ndarray of complex128, in the shape of `frequency`

        Examples
        --------
        >>> import numpy as np
        >>> from algdiff import Differentiator
        >>> d = Differentiator(51, fs=1000)
        >>> f = np.array([1.0, 20.0, 60.0])
        >>> np.abs(d.frequency_response(f) / (2j * np.pi * f)).round(3)
        array([1.   , 0.897, 0.068])
        """
        flat, shape = arguments.points("frequency", frequency)
        values = np.empty(flat.shape, np.complex128)
        self._plan.frequency_response(flat, values)
        return values.reshape(shape)[()]

    @stacked
    def asymptotes(self, frequency: ArrayLike) -> Asymptotes:
        """Return what the amplitude of the continuous kernel tends to beyond the cutoff.

        Parameters
        ----------
        frequency : array_like of float
            In cycles per unit of `delta`.

        Returns
        -------
        Asymptotes
            Amplitudes in the shape of `frequency`, to compare with ``abs(frequency_response(frequency))`` well below
            the Nyquist frequency.
        """
        flat, shape = arguments.points("frequency", frequency)
        scale = self.duration**self.deriv
        with np.errstate(over="ignore"):
            omega = 2 * math.pi * self.duration * flat
        return Asymptotes(*((values / scale).reshape(shape)[()] for values in self.kernel.asymptotes(omega)))

    @stacked
    def impulse_response(self, t: ArrayLike) -> Any:
        """Return the output at time `t` if the sample at time 0 is 1 and all others are 0: the weights, newest first.

        Parameters
        ----------
        t : array_like of float
            Time since the impulse, in the unit of `delta`; the output is held between samples.

        Returns
        -------
        float or ndarray of float64, in the shape of `t`
        """
        return self._held(self._weights[::-1], 0.0, t)

    @stacked
    def step_response(self, t: ArrayLike) -> Any:
        """Return the output at time `t` if all samples from time 0 on are 1 and all before are 0.

        Parameters
        ----------
        t : array_like of float
            Time since the step, in the unit of `delta`; the output is held between samples.

        Returns
        -------
        float or ndarray of float64, in the shape of `t`
        """
        sums = np.cumsum(self._weights[::-1])
        return self._held(sums, float(sums[-1]), t)

    def _held(self, outputs: NDArray[np.float64], last: float, t: ArrayLike) -> Any:
        flat, shape = arguments.points("t", t)
        # A time that is a sample's but for rounding is that sample's.
        with np.errstate(invalid="ignore", over="ignore"):
            steps = flat / self.delta
            nearest = np.round(steps)
            index = np.where(np.abs(steps - nearest) <= 1e-9 * np.maximum(1.0, np.abs(steps)), nearest, np.floor(steps))
            inside = (index >= 0) & (index < outputs.size)
            values = np.where(index >= outputs.size, last, 0.0)
        values[inside] = outputs[index[inside].astype(np.intp)]
        values[np.isnan(flat)] = np.nan
        return values.reshape(shape)[()]

    @each
    def discretisation_error(self, frequency: float | None = None) -> float:
        """Return how far the response lies from that of the continuous kernel.

        Parameters
        ----------
        frequency : float, optional
            Compare up to this frequency, in cycles per unit of `delta`; by default half the sampling rate.

        Returns
        -------
        float
            Root-mean-square difference over frequencies, relative to the kernel's response. Beyond 128 lobes of the
            response the frequencies lie ever wider apart, so that the last digits are those of a sample of them.
        """
        largest = 0.5 / self.delta if frequency is None else arguments.real("frequency", frequency)
        return self._plan.discretisation_error(largest)

    @property
    def duration(self) -> float:
        """Length T of the window, in the unit of `delta`."""
        return self._plan.duration

    @property
    def delay(self) -> float:
        """Time from the estimate to the newest sample of the window, in the unit of `delta`."""
        return self.delay_samples * self.delta

    @property
    def delay_samples(self) -> float:
        """Samples from the estimate to the newest sample of the window."""
        return self._plan.delay_samples

    @property
    @each
    def moment_delay(self) -> float:
        """Delay at low frequencies, in the unit of `delta`."""
        return self._plan.moment_delay * self.delta

    @property
    def fs(self) -> float:
        """Sampling rate."""
        return 1.0 / self.delta

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weights, oldest sample first."""
        return self._weights

    @property
    @each
    def noise_gain(self) -> float:
        """Sum of the squared weights."""
        with np.errstate(over="ignore"):
            return float(self._weights @ self._weights)

    @property
    @each
    def norm1(self) -> float:
        """Sum of the weights' sizes."""
        return float(np.abs(self._weights).sum())

    @property
    @each
    def exactness(self) -> int:
        """Polynomials up to this degree are differentiated exactly at `tau`; -1 if none."""
        exactness = self._plan.exactness
        return -1 if exactness is None else exactness

    @property
    @each
    def bias_order(self) -> int:
        """How many orders beyond `deriv` the derivative lies that the leading error follows."""
        return int(self.exactness) + 1 - int(self.deriv)

    @property
    @each
    def bias_constant(self) -> float:
        """Factor of the leading error."""
        return self._plan.bias_constant()

    @property
    @each
    def bias_bound(self) -> float:
        """Factor of the largest error."""
        return self._plan.bias_bound

    @property
    @each
    def cutoff(self) -> float | None:
        """Cutoff of the kernel in Hz, or None."""
        cutoff = self.kernel.cutoff
        return None if cutoff is None else cutoff / (2 * math.pi * self.duration)

    @property
    @each
    def half_power(self) -> float | None:
        """The -3 dB point of the weights in Hz, or None."""
        return self._plan.half_power()

    @property
    @each
    def nyquist_attenuation(self) -> float | None:
        """Attenuation of the kernel at the Nyquist frequency against the cutoff in dB, or None."""
        kernel = self.kernel
        if kernel.cutoff is None:
            return None
        passed, damped = np.abs(kernel.frequency_response([kernel.cutoff, math.pi * self.duration / self.delta]))
        with np.errstate(divide="ignore"):
            return float(20 * np.log10(passed / damped))

    @property
    @each
    def kernel(self) -> Kernel:
        """The continuous kernel that the weights discretise."""
        return Kernel(self.deriv, self.degree, self.kappa, self.mu, self.tau)
