"""Designs by what they are to do: the other constructors of a `Differentiator`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, SupportsIndex

from algdiff import _choice as choice

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator


class Wishes:
    """Windows chosen for one order; ``replace(deriv=...)`` gives the others of the same window."""

    __slots__ = ()

    @classmethod
    def from_cutoff(
        cls: Any, cutoff: float, deriv: SupportsIndex = 1, *, unit: str = "Hz", **design: Any
    ) -> Differentiator:
        """Return the design whose cutoff is nearest to `cutoff`.

        Parameters
        ----------
        cutoff : float
            Where the amplitude leaves that of an ideal differentiator (Kiltz and Rudolph; `half_power` is the -3 dB
            point).
        deriv : int
            Order of the derivative.
        unit : {"Hz", "rad/s"}
            Of `cutoff`: cycles or radians per unit of `delta`.
        **design
            The other arguments of `Differentiator`, without `window_length`.

        Returns
        -------
        Differentiator
            Its `cutoff` says, in Hz, what a whole number of samples came to.

        Raises
        ------
        ValueError
            `cutoff` is not positive, or so high that no window of ``degree + 1`` samples reaches it; or the kernel has
            no cutoff.

        Warns
        -----
        DesignWarning
            The kernel damps the Nyquist frequency by less than 10 dB against the cutoff: the weights cannot follow it.

        Examples
        --------
        >>> from algdiff import Differentiator
        >>> d = Differentiator.from_cutoff(20, fs=1000)
        >>> d.window_length, round(d.cutoff, 2)
        (47, 20.13)
        """
        return choice.from_cutoff(cls, cutoff, deriv, unit, design)

    @classmethod
    def from_duration(cls: Any, duration: float, deriv: SupportsIndex = 1, **design: Any) -> Differentiator:
        """Return the design whose window is nearest to `duration` long.

        Parameters
        ----------
        duration : float
            Length T of the window, in the unit of `delta`: rounded to the nearest whole number of steps (up at one
            half; for "simpson" to the nearest even number), which are `window_length` with rules on cells and one less
            on nodes.
        deriv : int
            Order of the derivative.
        **design
            The other arguments of `Differentiator`, without `window_length`.

        Returns
        -------
        Differentiator
            Its `duration` says what it came to.

        Examples
        --------
        >>> from algdiff import Differentiator
        >>> d = Differentiator.from_duration(0.3, delta=0.007)
        >>> d.window_length, round(d.duration, 3)
        (43, 0.301)
        """
        return choice.from_duration(cls, duration, deriv, design)

    @classmethod
    def from_delay(
        cls: Any, delay: float, deriv: SupportsIndex = 1, *, tau: float | str = "center", **design: Any
    ) -> Differentiator:
        """Return the design with the point of estimation `tau` whose delay is nearest to `delay`.

        A longer window damps more noise, so that this is the longest window that a delay allows at this `tau`. For a
        given window and delay use ``Differentiator(window_length, delay=...)``, for the best of all `delay_tradeoff`.

        Parameters
        ----------
        delay : float
            Time from the estimate to the newest sample, in the unit of `delta`, positive.
        deriv : int
            Order of the derivative.
        tau : {"center", "root"} or float
            Point of estimation, below 1.
        **design
            The other arguments of `Differentiator`, without `window_length` and `delay`.

        Returns
        -------
        Differentiator
            Its `delay` says what it came to.

        Examples
        --------
        >>> from algdiff import Differentiator
        >>> d = Differentiator.from_delay(0.05, tau="root", fs=1000)
        >>> d.window_length, round(d.delay, 4)
        (239, 0.05)
        """
        return choice.from_delay(cls, delay, deriv, tau, design)

    @classmethod
    def from_notch(
        cls: Any,
        frequency: float,
        deriv: SupportsIndex = 1,
        *,
        order: SupportsIndex = 1,
        unit: str = "Hz",
        **design: Any,
    ) -> Differentiator:
        """Return a design that annihilates a frequency.

        The response of a symmetric window has zeros. The window is made as long as puts the `order`-th of them next to
        `frequency`, and the exponents, equal at both ends, are then moved until it is there: to rounding, at the whole
        number of samples. They move little for windows of many samples, and by 1 or more for those of a few.

        Parameters
        ----------
        frequency : float
            The frequency to annihilate, above 0 and below half the sampling rate.
        deriv : int
            Order of the derivative.
        order : int
            Which zero of the response, counted from 1: higher ones give longer windows.
        unit : {"Hz", "rad/s"}
            Of `frequency`: cycles or radians per unit of `delta`.
        **design
            The other arguments of `Differentiator`, without `window_length`; `tau` must be "center" and `kappa` equal
            to `mu`, the exponent to start from.

        Returns
        -------
        Differentiator
            Its `kappa` and `mu` say what the exponents came to.

        Examples
        --------
        >>> from algdiff import Differentiator
        >>> d = Differentiator.from_notch(50, fs=1000)
        >>> d.window_length, round(d.kappa, 3), bool(abs(d.frequency_response(50)) < 1e-9)
        (51, 1.045, True)
        """
        return choice.from_notch(cls, frequency, deriv, order, unit, design)
