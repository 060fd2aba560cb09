"""Windows chosen by what they are to do: a cutoff, a duration, a delay, a notch, the least error."""

from __future__ import annotations

import math
import warnings
from bisect import bisect_left
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff import _core
from algdiff import _orders as orders
from algdiff._kernel import Kernel
from algdiff._refusals import named, shown
from algdiff._warnings import DesignWarning, outside

if TYPE_CHECKING:
    from collections.abc import Callable

    from algdiff._differentiator import Differentiator

NODES = ("trapezoid", "simpson", "hat")
LEAST_ATTENUATION = 10.0
"""In dB: a kernel that damps the Nyquist frequency by less is too fast for its sampling."""


class _Wish:
    """The arguments of a design whose window length is yet to be found."""

    def __init__(self, deriv: SupportsIndex, design: dict[str, Any]) -> None:
        if "window_length" in design:
            given = shown(design["window_length"])
            raise TypeError(f"window_length must be left out, got {given}: it follows from what is asked for")
        values = dict(design)
        order = orders.checked(deriv)
        if isinstance(order, tuple):
            raise ValueError(
                f"deriv must be one order to choose a window by, got {shown(deriv)}: then replace(deriv=...)"
            )
        self.deriv = order
        self.delta = arguments.sampling_step(values.pop("delta", None), values.pop("fs", None))
        if not (math.isfinite(self.delta) and self.delta > 0):
            raise ValueError(f"delta must be finite and positive, got {self.delta}")
        self.rest = values
        if values.get("rule") is not None:
            arguments.word("rule", values["rule"], "a word such as 'exact'")
        if values.get("tau") is not None:
            values["tau"] = arguments.word_or_real("tau", values["tau"])
        degree = values.get("degree")
        self.degree = self.deriv + 2 if degree is None else arguments.integer("degree", degree, 0)
        self.kappa, self.mu = (arguments.real(name, values.get(name, 1.0)) for name in ("kappa", "mu"))
        self.on_nodes = values.get("rule") in NODES
        self.spacing = 2 if values.get("rule") == "simpson" else 1
        # On cells the newest end of the window lies half a sample after the newest sample.
        self.cell = 0.0 if self.on_nodes else 0.5
        # Nodes lie at both ends: one sample spans no time.
        self.least = self.length(max(self.degree, 1) if self.on_nodes else self.degree + 1)

    @property
    def delay(self) -> float:
        """The delay that is asked for, in samples; 0 if none is."""
        delay = self.rest.get("delay")
        samples = 0.0 if delay is None else arguments.real("delay", delay) / self.delta
        if not samples < arguments.MAX_WINDOW:
            raise ValueError(f"delay must be less than {arguments.MAX_WINDOW} samples, got {delay}")
        return samples

    def untrimmed(self) -> _Wish:
        """Return this wish if it is for a whole window."""
        trim = arguments.real("trim", self.rest.get("trim", 0.0))
        if trim != 0:
            raise ValueError(
                f"trim must be 0 here, got {trim}: it changes what the window is chosen by; "
                "use replace(trim=...) on the result"
            )
        return self

    def length(self, steps: float) -> int:
        """Return the window length whose duration is nearest to `steps` sampling steps."""
        return self.spacing * math.floor(steps / self.spacing + 0.5) + self.on_nodes

    def steps(self, window_length: int) -> int:
        """Return the duration of a window in sampling steps."""
        return window_length - self.on_nodes

    def kernel(self, window_length: int) -> Kernel:
        """Return the continuous kernel of a window."""
        tau = self.rest.get("tau")
        if self.rest.get("delay") is not None or tau == "newest":
            tau = 1 - (self.delay + self.cell) / self.steps(window_length)
        return Kernel(self.deriv, self.degree, self.kappa, self.mu, "center" if tau is None else tau)

    def nearest(self, start: int, miss: Callable[[int], float]) -> int:
        """Return the window length, `start` or near it, that misses least."""
        near = (start + self.spacing * k for k in (0, -1, 1, -2, 2, -3, 3))
        return min((n for n in near if n >= self.least), key=miss)

    def design(self, cls: type[Differentiator], window_length: int, **changes: Any) -> Differentiator:
        return cls(window_length, self.deriv, delta=self.delta, **{**self.rest, **changes})


def _positive(name: str, value: object) -> float:
    number = arguments.real(name, value)
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{name} must be finite and positive, got {number}")
    return number


def _angular(name: str, value: object, unit: str) -> float:
    frequency = _positive(name, value)
    if arguments.word("unit", unit, "'Hz' or 'rad/s'") not in ("Hz", "rad/s"):
        raise ValueError(f"unit must be 'Hz' or 'rad/s', got {shown(unit)}")
    return 2 * math.pi * frequency if unit == "Hz" else frequency


def from_cutoff(
    cls: type[Differentiator], cutoff: float, deriv: SupportsIndex, unit: str, design: dict[str, Any]
) -> Differentiator:
    """Return the design of `Differentiator.from_cutoff`."""
    wish = _Wish(deriv, design).untrimmed()
    wanted = _angular("cutoff", cutoff, unit) * wish.delta

    length = _longest(wish, wanted, f"{cutoff} {unit}")
    found = wish.design(cls, length)
    damped = found.nyquist_attenuation
    if damped is not None and damped < LEAST_ATTENUATION:
        warnings.warn(
            f"the Nyquist frequency is damped by {damped:.3g} dB against the cutoff, less than {LEAST_ATTENUATION:g}: "
            "sample faster, or choose a lower cutoff or larger kappa and mu",
            DesignWarning,
            stacklevel=outside(),
        )
    return found


def _longest(wish: _Wish, wanted: float, got: str) -> int:
    """Return the length of the longest window whose cutoff, in radians per sample, is nearest to `wanted`."""

    def reached(window_length: int) -> float:
        cutoff = wish.kernel(window_length).cutoff
        return math.nan if cutoff is None else cutoff / wish.steps(window_length)

    def miss(window_length: int) -> float:
        distance = abs(reached(window_length) - wanted)
        return math.inf if math.isnan(distance) else distance

    # With a delay, or at the newest sample, `tau` and so the cutoff depend on the window in no simple way, except that
    # long windows have low cutoffs: the longest that still reaches this one, and no shorter than the delay.
    first = max(wish.steps(wish.least), math.ceil(wish.delay))
    ladder = np.unique(np.geomspace(first, arguments.MAX_WINDOW - 2, 500).astype(int)).tolist()
    cutoffs = np.array([reached(wish.length(steps)) for steps in ladder])
    if np.isnan(cutoffs).all():
        kernel = wish.kernel(wish.least)
        raise ValueError(
            f"kappa, mu and tau must give a kernel with a cutoff, got kappa = {kernel.kappa}, mu = {kernel.mu} and "
            f"tau = {kernel.tau}, which vanishes at the end that governs"
        )
    if cutoffs[-1] >= wanted:
        raise ValueError(f"cutoff must be higher: {arguments.MAX_WINDOW} samples are not enough for it, got {got}")
    high_enough = np.flatnonzero(cutoffs >= wanted)
    if high_enough.size:
        steps = bisect_left(
            range(ladder[high_enough[-1]], ladder[high_enough[-1] + 1]),
            True,
            key=lambda n: reached(wish.length(n)) < wanted,
        )
        length = wish.nearest(wish.length(ladder[high_enough[-1]] + steps), miss)
    else:
        length = wish.length(ladder[int(np.nanargmax(cutoffs))])
        if reached(length) < wanted * (1 - 0.5 / wish.steps(length)):
            raise ValueError(
                f"cutoff must be at most {reached(length) / wish.delta / (2 * math.pi):.6g} Hz, that of a window of "
                f"{length} samples, got {got}"
            )
    return length


def from_duration(
    cls: type[Differentiator], duration: float, deriv: SupportsIndex, design: dict[str, Any]
) -> Differentiator:
    """Return the design of `Differentiator.from_duration`."""
    wish = _Wish(deriv, design)
    steps = _positive("duration", duration) / wish.delta
    length = wish.length(min(steps, arguments.MAX_WINDOW + 1))
    if not wish.least <= length <= arguments.MAX_WINDOW:
        limit, word = (wish.least, "least") if length < wish.least else (arguments.MAX_WINDOW, "most")
        allowed = f"at {word} {wish.steps(limit) * wish.delta:.6g}, that of {limit} samples"
        raise ValueError(f"duration must be {allowed}, got {duration}")
    return wish.design(cls, length)


def from_delay(
    cls: type[Differentiator], delay: float, deriv: SupportsIndex, tau: float | str, design: dict[str, Any]
) -> Differentiator:
    """Return the design of `Differentiator.from_delay`."""
    if isinstance(tau, str) and tau == "newest":
        raise ValueError("tau must be a point before the newest sample, got 'newest', whose delay is always 0")
    wish = _Wish(deriv, {**design, "tau": tau}).untrimmed()
    samples = _positive("delay", delay) / wish.delta
    rest = 1 - wish.kernel(wish.least).tau
    if rest <= 0:
        raise ValueError(f"tau must be less than 1 for a delay, got {shown(tau)}")
    steps = (samples + wish.cell) / rest
    if steps > arguments.MAX_WINDOW:
        raise ValueError(f"delay must be shorter: a window of {steps:.3g} samples is needed, got {delay}")

    def miss(window_length: int) -> float:
        return abs(wish.steps(window_length) * rest - wish.cell - samples)

    length = wish.nearest(max(wish.length(steps), wish.least), miss)
    if length == wish.least and wish.steps(length) * rest - wish.cell > samples + max(rest, 0.5):
        least = (wish.steps(length) * rest - wish.cell) * wish.delta
        raise ValueError(f"delay must be at least {least:.6g}, that of {wish.least} samples at this tau, got {delay}")
    return wish.design(cls, length)


def from_notch(
    cls: type[Differentiator],
    frequency: float,
    deriv: SupportsIndex,
    order: SupportsIndex,
    unit: str,
    design: dict[str, Any],
) -> Differentiator:
    """Return the design of `Differentiator.from_notch`."""
    wish = _Wish(deriv, design)
    number = arguments.integer("order", order, 1)
    if wish.kappa != wish.mu:
        raise ValueError(f"kappa and mu must be equal for a notch, got kappa = {wish.kappa} and mu = {wish.mu}")
    tau, delay = wish.rest.get("tau"), design.get("delay")
    if delay is not None or tau not in (None, "center", 0.5):
        given = named(tau=tau) if delay is None else named(delay=delay)
        raise ValueError(f"tau must be 'center' for a notch, got {given}: only symmetric windows have zeros")
    turns = _angular("frequency", frequency, unit) * wish.delta
    if turns >= math.pi:
        raise ValueError(f"frequency must be below half the sampling rate, got {frequency} {unit}")
    zero = _zero(wish.kernel(wish.least), number)
    if zero > arguments.MAX_WINDOW * turns:
        raise ValueError(
            f"frequency must be higher: {arguments.MAX_WINDOW} samples are not enough for it, got {frequency}"
        )
    length = wish.length(zero / turns)
    if length < wish.least:
        raise ValueError(
            f"frequency must be lower, or order higher: a window of {length} samples is needed "
            f"and degree + 1 = {wish.least} is the least, got {frequency} {unit}"
        )

    def left(exponent: float) -> float:
        found = wish.design(cls, length, kappa=exponent, mu=exponent)
        response = found.frequency_response(turns / (2 * math.pi * wish.delta))
        return float((response / 1j**wish.deriv).real)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DesignWarning)
        exponent = _root(left, wish.kappa)
        # A trimmed window may jump over 0 as it loses a sample.
        missed = exponent is None or abs(left(exponent)) > 1e-9 * (turns / wish.delta) ** wish.deriv
    if exponent is None or missed:
        raise ValueError(
            f"frequency must be lower, or order or kappa another: no exponents near {wish.kappa} put a zero of "
            f"{length} samples there, got {frequency} {unit}"
        )
    return wish.design(cls, length, kappa=exponent, mu=exponent)


def _zero(kernel: Kernel, number: int) -> float:
    """Return the zero of the response of a symmetric kernel, as omega T, by its number."""

    def real(omega: Any) -> Any:
        return (kernel.frequency_response(omega) / 1j**kernel.deriv).real

    found, start, step = 0, 0.0, 0.25
    while True:
        omega = start + step * np.arange(1, 257)
        positive = real(omega) > 0
        changes = np.flatnonzero(positive[1:] != positive[:-1])
        if found + changes.size >= number:
            low = float(omega[changes[number - found - 1]])
            return _bisect(real, low, low + step)
        found, start = found + changes.size, float(omega[-2])


def _root(left: Callable[[float], float], start: float) -> float | None:
    """Return the exponent nearest to `start` that leaves nothing, to rounding; None if there is none near."""
    middle = left(start)
    for step in (0.05 * (1 + start) * 1.3**k for k in range(24)):
        for end in (start + step, max(start - step, -0.95)):
            if (left(end) > 0) != (middle > 0):
                return _bisect(left, min(start, end), max(start, end))
    return None


def _bisect(left: Callable[[float], float], low: float, high: float) -> float:
    """Return the point between `low` and `high` where `left` changes sign, or the nearer to 0 of its two neighbours."""
    below, above = left(low), left(high)
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return low if abs(below) < abs(above) else high
        value = left(middle)
        if (value > 0) == (below > 0):
            low, below = middle, value
        else:
            high, above = middle, value


def optimal_window(
    noise_level: float,
    deriv: SupportsIndex = 1,
    *,
    derivative_bound: float | None = None,
    bandwidth: float | None = None,
    amplitude: float | None = None,
    **design: Any,
) -> Differentiator:
    r"""Return the design whose window balances white noise against bias.

    The window length is that of `Kernel.optimal_duration`, rounded as in `Differentiator.from_duration` and at least
    ``degree + 1`` samples: the best for signals of which no more is known than the size of one derivative.

    Parameters
    ----------
    noise_level : float
        Standard deviation of the noise in the samples.
    deriv : int
        Order of the derivative.
    derivative_bound : float, optional
        The largest size of the derivative of order ``deriv + p`` of the signal, where p is the kernel's `bias_order`.
    bandwidth, amplitude : float, optional
        Instead of `derivative_bound`: the highest frequency in the signal, in cycles per unit of `delta` (Hz), and its
        largest size, which bound that derivative by ``amplitude * (2 pi bandwidth)**(deriv + p)`` (Bernstein).
    **design
        The other arguments of `Differentiator`, without `window_length` and `delay`.

    Returns
    -------
    Differentiator

    Raises
    ------
    ValueError
        A number is not positive, neither or both ways of bounding the derivative are given, or the noise gain is
        infinite (an exponent of -1/2 or less).

    Examples
    --------
    >>> import algdiff
    >>> d = algdiff.optimal_window(0.01, bandwidth=1, amplitude=1, fs=1000)
    >>> d.window_length
    335
    """
    from algdiff._differentiator import Differentiator

    wish = _Wish(deriv, design).untrimmed()
    if design.get("delay") is not None:
        given = shown(design["delay"])
        raise ValueError(
            f"delay must be left out, got {given}: at one delay, tau depends on the window; see delay_tradeoff"
        )
    kernel = wish.kernel(arguments.MAX_WINDOW)
    if derivative_bound is None:
        if bandwidth is None or amplitude is None:
            given = named(bandwidth=bandwidth, amplitude=amplitude)
            raise ValueError(f"give derivative_bound, or bandwidth and amplitude: got {given}")
        rate = 2 * math.pi * _positive("bandwidth", bandwidth)
        derivative_bound = _positive("amplitude", amplitude) * rate ** (kernel.deriv + kernel.bias_order)
    elif bandwidth is not None or amplitude is not None:
        given = named(derivative_bound=derivative_bound, bandwidth=bandwidth, amplitude=amplitude)
        raise ValueError(f"give derivative_bound, or bandwidth and amplitude, not both: got {given}")
    duration = kernel.optimal_duration(noise_level, derivative_bound, wish.delta)
    length = wish.length(min(duration / wish.delta, arguments.MAX_WINDOW - 2))
    return wish.design(Differentiator, max(length, wish.least))


class DelayTradeoff(NamedTuple):
    """The least error that each delay allows.

    Attributes
    ----------
    delay : ndarray
        The delays, in the unit of `delta`.
    rmse : ndarray
        Root-mean-square error of the estimate.
    window_length : ndarray of int
        The window that reaches it: ``Differentiator(window_length, delay=delay, ...)``.

    Examples
    --------
    >>> import algdiff
    >>> curve = algdiff.delay_tradeoff([0.1], 0.01, bandwidth=1, amplitude=1, degree=2, fs=1000)
    >>> d = algdiff.Differentiator(curve.window_length[0], degree=2, delay=curve.delay[0], fs=1000)
    >>> round(d.delay, 12)
    0.1
    """

    delay: NDArray[np.float64]
    rmse: NDArray[np.float64]
    window_length: NDArray[np.intp]


def delay_tradeoff(
    delays: ArrayLike,
    noise_level: float,
    deriv: SupportsIndex = 1,
    *,
    bandwidth: float,
    amplitude: float,
    degree: SupportsIndex | None = None,
    kappa: float = 1.0,
    mu: float = 1.0,
    delta: float | None = None,
    fs: float | None = None,
) -> DelayTradeoff:
    """Return the least error that any window reaches at each delay.

    The error is that on a sinusoid in white noise, by the frequency response and the norm of the continuous kernel: no
    expansion in the window length is involved. The curve falls steeply at first; then it goes up and down a little, as
    the best `tau` passes the roots, and up where the delay is longer than the best window.

    Parameters
    ----------
    delays : array_like of float, one-dimensional
        Time from the estimate to the newest sample, in the unit of `delta`; negative delays predict.
    noise_level : float
        Standard deviation of the noise in the samples.
    deriv : int
        Order of the derivative.
    bandwidth, amplitude : float
        Frequency of the sinusoid in cycles per unit of `delta` (Hz): the highest of interest; and its amplitude.
    degree, kappa, mu, delta, fs
        As in `Differentiator`.

    Returns
    -------
    DelayTradeoff

    Raises
    ------
    ValueError
        A number is not positive or not finite, or an argument of the design is outside of what it may be.

    Examples
    --------
    >>> import algdiff
    >>> curve = algdiff.delay_tradeoff([0, 0.05, 0.1], 0.01, bandwidth=1, amplitude=1, degree=2, fs=1000)
    >>> [round(error, 3) for error in curve.rmse.tolist()]
    [0.247, 0.037, 0.041]
    """
    wish = _Wish(deriv, {"degree": degree, "kappa": kappa, "mu": mu, "delta": delta, "fs": fs})
    flat, shape = arguments.points("delays", delays)
    if len(shape) != 1:
        raise ValueError(f"delays must be a one-dimensional array, got shape {shape}")
    if not np.isfinite(flat).all():
        raise ValueError(f"delays must be finite, got {flat[~np.isfinite(flat)][0]}")
    noise_level, amplitude = _positive("noise_level", noise_level), _positive("amplitude", amplitude)
    signal = (noise_level, amplitude, _positive("bandwidth", bandwidth), wish.delta)
    ends = (flat + wish.cell * wish.delta).tolist()
    best = _core.delay_tradeoff(ends, wish.deriv, wish.degree, wish.kappa, wish.mu, *signal)
    rmse, durations = np.array(best, np.float64).reshape(-1, 2).T.copy()
    lengths = np.maximum(np.floor(durations / wish.delta + 0.5), wish.degree + 1).astype(np.intp)
    return DelayTradeoff(flat.copy(), rmse, lengths)
