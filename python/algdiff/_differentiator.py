"""A design to use again and again."""

from __future__ import annotations

import math
import sys
import warnings
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._core import Plan
from algdiff._kernel import Kernel
from algdiff._run import Progress, run


class DesignWarning(UserWarning):
    """A design that works, but not as its user may expect."""


class Differentiator:
    r"""A frozen design: one window, its weights and what they do to signal and noise.

    Every output is the derivative of order `deriv`, at the point `tau` of its window, of the polynomial of degree
    `degree` fitted to the window by least squares with the weight :math:`\tau^\kappa (1 - \tau)^\mu` (Mboup, Join
    and Fliess 2007). ``kappa = mu = 0`` is the Savitzky-Golay filter. Use `differentiate` to do it once.

    Parameters
    ----------
    window_length : int
        Number of samples in the window, from ``degree + 1`` to 10,000,000; even or odd.
    deriv : int
        Order of the derivative; 0 smooths.
    degree : int, optional
        Degree of the local polynomial, from `deriv` to 500; default ``deriv + 2``.
    kappa, mu : float
        Exponents of the weight at the oldest and the newest end of the window, greater than -1.
    tau : {"center", "root", "newest"} or float, optional
        Point of estimation in the window: 0 is its oldest, 1 its newest end. "center" (the default) is 1/2, "root"
        the point nearest to the newest sample at which one more degree is reproduced, "newest" the newest sample
        itself. Numbers above 1 predict.
    delay : float, optional
        Instead of `tau`: the time from the estimate to the newest sample, in the unit of `delta`.
    delta : float, optional
        Sampling step, positive; default 1.
    fs : float, optional
        Instead of `delta`: the sampling rate, ``1 / delta``.
    rule : {"exact", "trapezoid"}
        How the continuous kernel becomes weights. "exact": the fit on the samples themselves, which lie at
        ``tau_j = (j + 1/2) / window_length``, with T = ``window_length * delta``. "trapezoid": the rule of the 2007
        paper, with samples at ``tau_j = j / (window_length - 1)``; it leaks offsets and is kept for reproduction.

    Attributes
    ----------
    window_length, deriv, degree, kappa, mu, tau, delay, delta, fs, rule
        The arguments; `tau` as a number, `delay` in the unit of `delta`.
    delay_samples : float
        Samples from the estimate to the newest sample of the window.
    weights : ndarray of shape (window_length,)
        Oldest sample first, in units of ``1 / delta**deriv``: ``weights @ x[i : i + window_length]`` is the
        estimate. Read-only.
    noise_gain : float
        Sum of the squared weights: variance of the estimate over variance of white noise in the samples.
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
    """

    __slots__ = (
        "_asked",
        "_plan",
        "_weights",
        "degree",
        "delta",
        "deriv",
        "kappa",
        "mu",
        "rule",
        "tau",
        "window_length",
    )

    _asked: dict[str, Any]
    _plan: Plan
    _weights: NDArray[np.float64]
    window_length: int
    deriv: int
    degree: int
    kappa: float
    mu: float
    tau: float
    delta: float
    rule: str

    def __init__(
        self,
        window_length: SupportsIndex,
        deriv: SupportsIndex = 1,
        *,
        degree: SupportsIndex | None = None,
        kappa: float = 1.0,
        mu: float = 1.0,
        tau: float | str | None = None,
        delay: float | None = None,
        delta: float | None = None,
        fs: float | None = None,
        rule: str = "exact",
    ) -> None:
        if tau is not None and delay is not None:
            raise ValueError(f"give tau or delay, not both: got tau = {tau!r} and delay = {delay!r}")
        if not isinstance(rule, str):
            raise TypeError(f"rule must be 'exact' or 'trapezoid', got {rule!r}")
        self._set(
            {
                "window_length": arguments.integer("window_length", window_length, 1),
                "deriv": arguments.integer("deriv", deriv, 0),
                "degree": None if degree is None else arguments.integer("degree", degree, 0),
                "kappa": arguments.real("kappa", kappa),
                "mu": arguments.real("mu", mu),
                "tau": None if tau is None else arguments.word_or_real("tau", tau),
                "delay": None if delay is None else arguments.real("delay", delay),
                "delta": arguments.sampling_step(delta, fs),
                "rule": rule,
            }
        )
        limit = 1.5 * math.sqrt(self.window_length)
        if self.degree > limit:
            message = (
                f"degree {self.degree} exceeds 1.5 sqrt(window_length) = {limit:.3g}: "
                f"from there on the noise gain grows steeply; it is {self.noise_gain:.3g}"
            )
            warnings.warn(message, DesignWarning, stacklevel=_outside())

    def _set(self, asked: dict[str, Any]) -> None:
        """Design from checked arguments; what was left out is None."""
        values = dict(asked)
        if values["degree"] is None:
            values["degree"] = values["deriv"] + 2
        if values["tau"] is None and values["delay"] is None:
            values["tau"] = "center"
        plan = Plan(**values)
        weights = np.empty(values["window_length"])
        plan.weights(weights)
        weights.flags.writeable = False
        del values["delay"]
        for name, value in {**values, "tau": plan.tau}.items():
            object.__setattr__(self, name, value)
        # A view of a read-only array cannot be made writeable again.
        for name, value in {"_plan": plan, "_weights": weights.view(), "_asked": asked}.items():
            object.__setattr__(self, name, value)

    def __call__(
        self,
        x: ArrayLike,
        axis: int = -1,
        *,
        mode: str = "fit",
        cval: complex = 0.0,
        out: Samples | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Samples:
        """Differentiate `x` along `axis`.

        Parameters
        ----------
        x : array_like
            Samples, `delta` apart along `axis`. float32 and complex64 are computed in single, everything else in
            double precision; complex data as two real passes. Not changed, and not to be changed by others during
            the call.
        axis : int
            The axis of time.
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
        out : ndarray, optional
            Where the result goes: of its shape and dtype, not overlapping `x`.
        threads : int, optional
            At most this many threads; by default ``ALGDIFF_NUM_THREADS`` or the processors of the process. The
            result is the same to the bit.
        progress : callable, optional
            Called now and then with the fraction that is done.

        Returns
        -------
        ndarray
            The estimates, in the unit of `x` over that of ``delta**deriv``. A NaN in `x` makes every estimate NaN
            whose window contains it, and no other; so does an infinity.

        Raises
        ------
        ValueError
            `x` has fewer samples than the window (modes "fit", "valid" and "nan"), `axis` or `mode` does not exist,
            or `out` has the wrong shape, is read-only or overlaps `x`.
        TypeError
            `x` does not hold numbers, has masked values or carries units, or `out` has another dtype.
        MemoryError
            The result does not fit into memory.
        """
        options: dict[str, Any] = {"mode": mode, "cval": cval, "out": out, "threads": threads, "progress": progress}
        return run(self._plan, self.window_length, x, axis=axis, **options)

    @property
    def delay(self) -> float:
        """Time from the estimate to the newest sample of the window, in the unit of `delta`."""
        return self.delay_samples * self.delta

    @property
    def delay_samples(self) -> float:
        """Samples from the estimate to the newest sample of the window."""
        return self._plan.delay_samples

    @property
    def fs(self) -> float:
        """Sampling rate."""
        return 1.0 / self.delta

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weights, oldest sample first."""
        return self._weights

    @property
    def noise_gain(self) -> float:
        """Sum of the squared weights."""
        return float(self._weights @ self._weights)

    @property
    def exactness(self) -> int:
        """Polynomials up to this degree are differentiated exactly at `tau`; -1 if none."""
        exactness = self._plan.exactness
        return -1 if exactness is None else exactness

    @property
    def kernel(self) -> Kernel:
        """The continuous kernel that the weights discretise."""
        return Kernel(self.deriv, self.degree, self.kappa, self.mu, self.tau)

    def replace(self, **changes: Any) -> Differentiator:
        """Return a design with some arguments changed, the others as they were given.

        Words and defaults are resolved anew: "newest" stays the newest sample under another window length. `delay` and
        `tau` replace each other, and so do `fs` and `delta`.

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

    _names = ("window_length", "deriv", "degree", "kappa", "mu", "tau", "delta", "rule")

    @property
    def _key(self) -> tuple[Any, ...]:
        return tuple(getattr(self, name) for name in self._names)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a Differentiator does not change: cannot set {name}, see replace()")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a Differentiator does not change: cannot delete {name}")

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if isinstance(other, Differentiator) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return _rebuild, (self._asked,)

    def __repr__(self) -> str:
        words = ", ".join(f"{name}={value!r}" for name, value in zip(self._names, self._key, strict=True))
        return f"Differentiator({words})"


def _rebuild(asked: dict[str, Any]) -> Differentiator:
    """Undo `Differentiator.__reduce__`; whoever made the design has had its warning."""
    design = object.__new__(Differentiator)
    design._set(asked)
    return design


def _outside() -> int:
    """Return the stack level, seen from the caller, of the first frame outside of this package."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("algdiff."):
        level, frame = level + 1, frame.f_back
    return level
