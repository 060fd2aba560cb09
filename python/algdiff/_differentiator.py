"""A design to use again and again."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from algdiff import _arguments as arguments
from algdiff import _dask as dask
from algdiff import _designs as designs
from algdiff import _export as export
from algdiff import _report as report
from algdiff._arguments import Progress, Samples
from algdiff._core import Bank, Plan
from algdiff._estimates import estimates
from algdiff._filter import Filter
from algdiff._orders import single
from algdiff._run import run
from algdiff._warnings import DesignWarning, outside
from algdiff._wish import Call, Wish
from algdiff._wishes import Wishes

if TYPE_CHECKING:
    from algdiff._stream import Stream


class Differentiator(Wishes, Filter):
    r"""A frozen design: one window, its weights and what they do to signal and noise.

    Every output is the derivative of order `deriv`, at the point `tau` of its window, of the polynomial of degree
    `degree` fitted to the window by least squares with the weight :math:`\tau^\kappa (1 - \tau)^\mu` (Mboup, Join
    and Fliess 2007). ``kappa = mu = 0`` is the Savitzky-Golay filter. Use `differentiate` to do it once.

    Parameters
    ----------
    window_length : int
        Number of samples in the window, from ``degree + 1`` to 10,000,000; even or odd.
    deriv : int or sequence of int
        Order of the derivative; 0 smooths. Several different orders are computed in one pass, from one window and with
        one delay, and results get a leading axis over them.
    degree : int, optional
        Degree of the local polynomial, from `deriv` to 500; default ``deriv + 2``, of several orders the highest.
    kappa, mu : float
        Exponents of the weight at the oldest and the newest end of the window, greater than -1.
    tau : {"center", "root", "newest"} or float, optional
        Point of estimation in the window: 0 is its oldest, 1 its newest end. "center" (the default) is 1/2, "root"
        the point nearest to the newest sample at which one more degree is reproduced, "newest" the newest sample
        itself. Numbers above 1 predict. Several orders have no "root" in common.
    delay : float, optional
        Instead of `tau`: the time from the estimate to the newest sample, in the unit of `delta`.
    delta : float, optional
        Sampling step, positive; default 1.
    fs : float, optional
        Instead of `delta`: the sampling rate, ``1 / delta``.
    rule : {"exact", "trapezoid", "midpoint", "simpson", "cell", "hat"}
        How the continuous kernel becomes weights. "exact": the fit on the samples themselves, which lie at
        ``tau_j = (j + 1/2) / window_length``, with T = ``window_length * delta``. "trapezoid": the rule of the 2007
        paper, with samples at ``tau_j = j / (window_length - 1)``; it leaks offsets and is kept for reproduction. So
        are "midpoint", the kernel at the middles of the cells, and "simpson" (odd windows). "cell" and "hat" integrate
        the kernel exactly against a signal that is constant on every cell, or linear between samples on nodes: no
        offset leaks, but higher degrees do. Rules that sample the ends refuse negative exponents, which are infinite
        there; the others give them finite weights.
    trim : float
        Leave out, at either end of the window, the samples that together hold at most this share of the sum of the
        weights' sizes. `window_length` and `tau` go on describing the nominal window, and so do `cutoff` and `kernel`;
        `weights` is shorter and `delay` less by what is left out at the newest end: below 0, a prediction, for
        "newest". With the rule "exact" the rest is fitted anew and as exact as before; with the others it is just
        what is left. What is left out depends on the order, so that there must be one.
    engine : {"auto", "direct", "moments", "fft"}
        How the weights are applied. "direct" adds every tap of every output, and gives the same bits however the data
        are cut; the others cost less for long windows, and agree with it to rounding. "auto" takes the one that is
        likely to be the fastest for the window, the orders and the dtype.

    Attributes
    ----------
    window_length, deriv, degree, kappa, mu, tau, delay, delta, fs, rule, trim
        The arguments; `tau` as a number, `delay` in the unit of `delta`, several orders as a tuple.
    engine : str
        The engine that runs float64 and complex128; see `engine_for`.
    orders : tuple of Differentiator
        The designs of the single orders; of one order, the design itself.
    duration : float
        Length T of the window, in the unit of `delta`.
    delay_samples : float
        Samples from the estimate to the newest sample of the window.
    weights : ndarray of shape (window_length,), or shorter if trimmed
        Oldest sample first, in units of ``1 / delta**deriv``: ``weights @ x[i : i + window_length]`` is the
        estimate. Read-only.
    noise_gain : float
        Sum of the squared weights: variance of the estimate over variance of white noise in the samples.
    norm1 : float
        Sum of the weights' sizes: a disturbance of size d and any shape moves the estimate by at most ``d * norm1``.
    bias_constant, bias_order : float, int
        On a smooth signal the estimate errs by ``bias_constant * x^(deriv + bias_order)`` to leading order. With rules
        that leak, `bias_order` may be 0 or negative.
    bias_bound : float
        And never by more than `bias_bound` times the largest size of that derivative on the window (and up to the
        estimate, should it lie outside). Infinite where a derivative below `deriv` leaks.
    moment_delay : float
        Delay at low frequencies, from the first moment of the weights, in the unit of `delta`: `delay`, unless
        ``degree == deriv``, when `tau` has no influence.
    cutoff, half_power : float or None
        Cutoff (Kiltz and Rudolph) of the kernel, and the -3 dB point of the weights, in cycles per unit of `delta`
        (Hz). None where there is none (up to the Nyquist frequency for `half_power`). With rules that leak,
        `half_power` may lie where the leak and the derivative cancel.
    nyquist_attenuation : float or None
        How far the amplitude of the kernel at the Nyquist frequency lies below that at the cutoff, in dB.
    exactness : int
        Polynomials up to this degree are differentiated exactly at `tau`, and in the interior of every mode; the ends
        are fitted with `degree`. -1 if not even a constant is ("trapezoid").
    kernel : Kernel
        The continuous kernel that the weights discretise.

    Raises
    ------
    ValueError
        An argument is outside of what it may be, two exclude each other, or the degree is so high for the window
        that the weights miss their moments by more than 1e-10.
    TypeError
        An argument is of the wrong type.
    MemoryError
        The weights do not fit into memory.

    Warns
    -----
    DesignWarning
        The degree exceeds ``1.5 * sqrt(window_length)``: from there on the noise gain grows steeply.

    Notes
    -----
    With several orders, `weights` and what the methods return for points in time or frequency have a leading axis over
    them, and attributes that depend on the order (`noise_gain` to `kernel` above) are tuples. Summaries, C headers and
    pictures are of one order: take it from `orders`.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import Differentiator
    >>> d = Differentiator(5, degree=2, kappa=0, mu=0, delta=0.1)
    >>> d.weights.round(9)
    array([-2., -1.,  0.,  1.,  2.])
    >>> d.delay_samples, d.exactness
    (2.0, 2)
    >>> t = np.arange(0, 1, 0.1)
    >>> bool(np.allclose(d(t**2), 2 * t))
    True

    Signal, slope and curvature in one pass:

    >>> signal, slope, curvature = Differentiator(7, (0, 1, 2), degree=2, delta=0.1)(t**2)
    >>> bool(np.allclose(signal, t**2) and np.allclose(slope, 2 * t) and np.allclose(curvature, 2))
    True
    """

    __slots__ = ()

    def __init__(
        self,
        window_length: SupportsIndex,
        deriv: SupportsIndex | Sequence[SupportsIndex] = 1,
        *,
        degree: SupportsIndex | None = None,
        kappa: float = 1.0,
        mu: float = 1.0,
        tau: float | str | None = None,
        delay: float | None = None,
        delta: float | None = None,
        fs: float | None = None,
        rule: str = "exact",
        trim: float = 0.0,
        engine: str = "auto",
    ) -> None:
        self._set(designs.asked(window_length, deriv, degree, kappa, mu, tau, delay, delta, fs, rule, trim, engine))
        self._warn()

    def _set(self, asked: dict[str, Any]) -> None:
        """Design from checked arguments; what was left out is None."""
        values = {name: value for name, value in asked.items() if name != "engine"}
        deriv = values.pop("deriv")
        orders = deriv if isinstance(deriv, tuple) else (deriv,)
        if values["degree"] is None:
            values["degree"] = max(orders) + 2
        if values["tau"] is None and values["delay"] is None:
            values["tau"] = "center"
        plans = [Plan(deriv=order, **values) for order in orders]
        weights = np.empty((len(plans), plans[0].span))
        for plan, row in zip(plans, weights, strict=True):
            plan.weights(row)
        weights.flags.writeable = False
        del values["delay"]
        values["tau"] = plans[0].tau
        self._keep({**values, "deriv": deriv}, asked, plans, weights)

    def _keep(
        self, values: dict[str, Any], asked: dict[str, Any], plans: list[Plan], weights: NDArray[np.float64]
    ) -> None:
        # A view of a read-only array cannot be made writeable again.
        kept = {
            "_asked": asked,
            "_plans": plans,
            "_plan": plans[0],
            "_bank": Bank(plans, asked["engine"]),
            "_leading": len(plans) if isinstance(asked["deriv"], tuple) else None,
            "_weights": weights[:] if isinstance(asked["deriv"], tuple) else weights[0],
            "_crowded": values["degree"] > 1.5 * math.sqrt(values["window_length"]),
        }
        for name, value in {**values, **kept}.items():
            object.__setattr__(self, name, value)

    def _warn(self) -> None:
        if self._crowded:
            gains = " and ".join(f"{one.noise_gain:.3g}" for one in self.orders)
            message = (
                f"degree {self.degree} exceeds 1.5 sqrt(window_length) = {1.5 * math.sqrt(self.window_length):.3g}: "
                f"from there on the noise gain grows steeply; it is {gains}: use a lower degree or a longer window"
            )
            warnings.warn(message, DesignWarning, stacklevel=outside())

    @property
    def orders(self) -> tuple[Differentiator, ...]:
        """The designs of the single orders, in the order of `deriv`; of one order, the design itself."""
        if self._leading is None:
            return (self,)
        return tuple(self._order(index) for index in range(self._leading))

    def _order(self, index: int) -> Differentiator:
        changes = {"deriv": self.deriv[index], "degree": self.degree}
        values = {name: getattr(self, name) for name in self._names} | changes
        design = object.__new__(Differentiator)
        design._keep(
            values, {**self._asked, **changes}, self._plans[index : index + 1], self._weights[index : index + 1]
        )
        return design

    @property
    def engine(self) -> str:
        """The engine that runs float64 and complex128: of "auto", the one that was chosen."""
        return self._bank.engine(single=False)

    def engine_for(self, dtype: DTypeLike) -> str:
        """Return the engine that runs samples of `dtype`.

        Parameters
        ----------
        dtype : dtype
            float32 and complex64 are run in single, everything else in double precision.

        Examples
        --------
        >>> from algdiff import Differentiator
        >>> Differentiator(61, engine="direct").engine_for("float32")
        'direct'
        """
        kind = arguments.any_dtype("dtype", dtype)
        return self._bank.engine(single=arguments.working_dtype(kind) in (np.float32, np.complex64))

    def __call__(
        self,
        x: ArrayLike,
        axis: int = -1,
        *,
        mode: str = "fit",
        cval: complex = 0.0,
        t: ArrayLike | None = None,
        at: ArrayLike | None = None,
        window_duration: float | np.timedelta64 | None = None,
        edge_window: str = "full",
        nan_policy: str = "propagate",
        min_support: SupportsIndex | None = None,
        max_gain: float | None = None,
        weights: ArrayLike | None = None,
        period: float | None = None,
        return_std: bool = False,
        return_support: bool = False,
        return_bias: bool = False,
        sigma: ArrayLike | None = None,
        autocovariance: ArrayLike | None = None,
        out: Samples | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Any:
        """Differentiate `x` along `axis`.

        Parameters
        ----------
        x : array_like
            Samples, `delta` apart along `axis`. float32 and complex64 are computed in single, everything else in
            double precision; complex data as two real passes. What is not a contiguous array of native floats, in
            whatever order of its axes, is converted block by block: a memory map of a file may be longer than the
            memory. With any of the keywords from `t` to `autocovariance` it is copied whole if it is none. Not changed,
            and not to be changed by others during the call. A Dask array is not computed: what is returned is
            lazy too, see `algdiff.dask`.
        axis : int
            The axis of time in `x`.
        mode : {"fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"}
            "valid" gives the estimates of all whole windows, ``window_length - 1`` fewer than samples: output `j`
            belongs to the samples from `j` on and to the point `tau` of their window. In all other modes output `i`
            is the estimate at the time of sample `i`; should `tau` lie between two samples (an even window at its
            center, most roots), it is moved to the nearest. Near the ends, where a window around the sample would
            reach beyond the data, "fit" takes the first or last whole window and moves `tau` in it to the sample,
            so that polynomials of the degree are reproduced to both ends; "nan" gives NaN; and the others extend
            the data, with their last value, mirrored at the last sample, periodically, or with `cval`.
        cval : float
            The value beyond the data in mode "constant".
        t : array_like, optional
            Times of the samples along `axis`, instead of `delta`: strictly ascending or descending, any spacing,
            numbers or datetime64 (then in seconds). Each estimate is a fit on the samples of its window at their own
            times, the window being `window_length` samples that lie around it as they would if they were even, with T
            their range and one mean step more. Even times, to 1e-9 of a step and their rounding, are recognised and
            cost nothing.
        at : array_like, optional
            Times at which estimates are wanted, instead of those of the samples; with `delta`, counted from the first
            sample. The window is that of the nearest sample.
        window_duration : float or timedelta64, optional
            Instead of `window_length`: T, in the unit of `t` or `delta`. Windows hold the samples within it, however
            many, and are shifted at the ends; even samples make it a number of samples.
        edge_window : {"full", "shrink"}
            In mode "fit", "shrink" takes windows that are shorter by 2, 4, ... samples toward the ends, so that `tau`
            stays in its place, down to ``2 * degree + 1`` (or `min_support`) samples or one more: less bias, more
            noise.
        nan_policy : {"propagate", "omit", "raise"}
            What NaN and masked samples do. "propagate" makes every estimate NaN whose window holds one; "omit" fits
            `degree` to the other samples of such windows, at the same `tau`; "raise" refuses them.
        min_support : int, optional
            Samples that a window must hold for an estimate, or it is NaN; at least, and by default, ``degree + 1``.
        max_gain : float, optional
            By what factor the noise gain may exceed that of the whole evenly filled window at the same `tau`, or the
            estimate is NaN; by default 100 where samples are missing, and unlimited elsewhere.
        weights : array_like, optional
            Inverse variances of the samples, of shape ``(x.shape[axis],)`` or of that of `x`, by which the weight of
            the fit is multiplied. A sample of weight 0 is left out.
        period : float, optional
            `x` is an angle that is the same after `period`: no step between samples is more than half of it. Smoothed
            angles stay on the turn of the sample next to them.
        return_std, return_support, return_bias : bool
            Return `Estimates`, with the standard deviation, the number of samples used, or an indicator of the bias of
            every estimate: how far it is from the fit of degree ``exactness + 1``.
        sigma : float or array_like, optional
            Standard deviation of the noise in the samples, of one or of each (shapes as for `weights`); by default
            `noise_level` along every row, over the root of `weights` if these are given.
        autocovariance : array_like, optional
            Instead of `sigma`: the covariance of the noise of samples 0, 1, 2, ... apart.
        out : ndarray, optional
            Where the result goes: of its shape and dtype, not overlapping `x`.
        threads : int, optional
            At most this many threads, and four for every processor; by default ``ALGDIFF_NUM_THREADS`` or the
            processors of the process, but one in a task of Dask, which runs as many tasks. The result is the same to
            the bit.
        progress : callable, optional
            Called now and then with the fraction that is done.

        Returns
        -------
        ndarray or Estimates
            The estimates, in the unit of `x` over that of ``delta**deriv``. A NaN in `x` makes every estimate NaN
            whose window contains it, and no other; so does an infinity. Masked arrays return masked. Of several
            orders, along a leading axis. The axes lie in memory in the order of those of `x`, unless more is asked
            for.

        Raises
        ------
        ValueError
            `x` has fewer samples than the window (modes "fit", "valid" and "nan"), `axis` or `mode` does not exist,
            `out` has the wrong shape, is read-only or overlaps `x`, times are not strictly monotone, or what is asked
            for does not go together.
        TypeError
            `x` does not hold numbers or carries units, or `out` has another dtype.
        MemoryError
            The result does not fit into memory.
        """
        more = return_std or return_support or return_bias
        words = type(nan_policy) is not str or nan_policy != "propagate"
        words = words or type(edge_window) is not str or edge_window != "full"
        given = (t, at, window_duration, min_support, max_gain, weights, period, sigma, autocovariance)
        lazy = type(x) is not np.ndarray and dask.is_dask(x)
        if lazy or more or words or any(value is not None for value in given) or isinstance(x, np.ma.MaskedArray):
            flags = (edge_window, nan_policy, return_std, return_support, return_bias)
            call, wish = Call(axis, mode, cval, out, threads, progress), Wish(*given, *flags)
            return dask.differentiate(self, x, call, wish) if lazy else estimates(self, x, call, wish)
        return run(
            self._bank,
            self._plan,
            x,
            orders=self._leading,
            axis=axis,
            mode=mode,
            cval=cval,
            out=out,
            threads=threads,
            progress=progress,
        )

    def stream(self, **options: Any) -> Stream:
        """Return a `Stream` of this design: the same estimates, sample by sample.

        Parameters
        ----------
        **options
            Of `Stream`, as ``channels=`` or ``warmup=``.

        Examples
        --------
        >>> from algdiff import Differentiator
        >>> stream = Differentiator.from_delay(0.02, fs=1000).stream(warmup="grow")
        >>> [round(stream.push(0.001 * sample), 6) for sample in range(6)]
        [nan, nan, nan, 1.0, 1.0, 1.0]
        """
        from algdiff._stream import Stream

        return Stream(self, **options)

    def summary(self) -> report.Summary:
        """Return the design in plain numbers and words, as JSON can hold them.

        Returns
        -------
        dict
            In this order, with `delta` in seconds: `window_length` and `weight_count` (the weights that `trim` left),
            in samples; `deriv`, `degree`, `kappa`, `mu`, `tau`, `rule`, `trim`; `delta` and `duration` in s and `fs` in
            Hz; `delay` in s, `delay_samples`, and `moment_delay` in s; `exactness`; `noise_gain` in
            ``1 / s**(2 * deriv)`` and `norm1` in ``1 / s**deriv``; `bias_order`, `bias_constant` and `bias_bound` in
            ``s**bias_order``; `cutoff` and `half_power` in Hz; `roll_off`, by which the amplitude of the kernel falls
            against an ideal differentiator, in dB per decade; `nyquist_attenuation` in dB; and
            `discretisation_error`. What does not exist or is infinite is None.

        Examples
        --------
        >>> from algdiff import Differentiator
        >>> summary = Differentiator(51, fs=1000).summary()
        >>> summary["delay"], summary["delay_samples"], summary["exactness"], summary["roll_off"]
        (0.025, 25.0, 4, 60.0)
        """
        single("a summary", self)
        return report.summary(self)

    def to_c(self, name: str = "differentiator", dtype: DTypeLike = np.float64) -> str:
        r"""Return a C99 header that makes the estimates of ``mode="valid"``, a sample or a window at a time.

        Parameters
        ----------
        name : str
            What its names start with, a C identifier. For samples that come one at a time, ``name_stream`` holds the
            newest of them, ``name_push(&stream, sample)`` returns the estimate from the newest window, NaN until there
            is one, and ``name_reset(&stream)`` forgets them. ``name_apply(window)`` takes one window, oldest sample
            first. Macros, in capitals: ``NAME_LENGTH``, ``NAME_DELAY``, ``NAME_DELAY_SAMPLES`` and ``NAME_NOISE_GAIN``.
        dtype : dtype
            Of samples and estimates: float64 (the default), in C ``double``, or float32, in C ``float``.

        Returns
        -------
        str
            It needs no memory but the struct and the stack, and of libraries only ``math.h`` for NAN. Its estimates
            are those of ``replace(engine="direct")`` to the bit, on samples of `dtype`, if the compiler rounds every
            operation by itself; the header says what GCC needs for that. So an offset costs nothing, and a constant
            gives exactly 0 (or itself, if ``deriv == 0``), unless the rule leaks constants.

        Raises
        ------
        ValueError
            `name` is not a C identifier, or the design has several orders.
        TypeError
            `name` is not a string, or `dtype` another one.

        Examples
        --------
        >>> from algdiff import Differentiator
        >>> d = Differentiator(5, degree=2, kappa=0, mu=0, delta=0.1)
        >>> print("\n".join(line for line in d.to_c("velocity").splitlines() if "#define VELOCITY_DELAY" in line))
        #define VELOCITY_DELAY 0.2
        #define VELOCITY_DELAY_SAMPLES 2.0
        >>> print("\n".join(line for line in d.to_c("velocity", "float32").splitlines() if "inline" in line))
        static inline float velocity_apply(const float *window)
        static inline void velocity_reset(velocity_stream *stream)
        static inline float velocity_push(velocity_stream *stream, float sample)
        """
        single("a C header", self)
        return export.to_c(self, name, dtype)

    def replace(self, **changes: Any) -> Differentiator:
        """Return a design with some arguments changed, the others as they were given.

        Words and defaults are resolved anew: "newest" stays the newest sample under another window length. `delay` and
        `tau` replace each other, and so do `fs` and `delta`. ``replace(deriv=(0, 1, 2))`` gives more orders of the same
        window, of the degree that was given or that these orders have by default.

        Parameters
        ----------
        **changes
            Arguments of `Differentiator` by name.

        Examples
        --------
        >>> from algdiff import Differentiator
        >>> Differentiator(21, tau="newest").replace(window_length=41).delay_samples
        0.0
        """
        values = dict(self._asked)
        for change, replaced in (("tau", "delay"), ("delay", "tau"), ("fs", "delta")):
            if changes.get(change) is not None:
                values[replaced] = None
        return Differentiator(**{**values, **changes})

    def _changed(self, **changes: Any) -> Differentiator:
        """Return a design with other arguments, of which was warned already."""
        changed = object.__new__(Differentiator)
        changed._set({**self._asked, **changes})
        return changed

    _names = ("window_length", "deriv", "degree", "kappa", "mu", "tau", "delta", "rule", "trim")

    @property
    def _key(self) -> tuple[Any, ...]:
        """What the design does, whatever words it was asked for by."""
        engines = self._bank.engine(single=False), self._bank.engine(single=True)
        return (*(getattr(self, name) for name in self._names), engines)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a Differentiator does not change: cannot set {name}, see replace()")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a Differentiator does not change: cannot delete {name}, see replace()")

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if isinstance(other, Differentiator) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return rebuild, (self._asked,)

    def __repr__(self) -> str:
        words = [f"{name}={getattr(self, name)!r}" for name in self._names]
        return f"Differentiator({', '.join(words)}, engine={self._asked['engine']!r})"


def rebuild(asked: dict[str, Any]) -> Differentiator:
    """Return the design without a warning: whoever made it has had it, or will be given it."""
    design = object.__new__(Differentiator)
    design._set(asked)
    return design


@designs.remembered
def remembered(*words: Any) -> tuple[Differentiator, int]:
    """Return the design of the arguments of `_designs.asked`, one for all who ask; the warning is left to them."""
    design = rebuild(designs.asked(*words))
    # Weights, taps of both precisions at two points, and the fit at the ends.
    return design, len(design._plans) * design.window_length * (design.degree + 10)
