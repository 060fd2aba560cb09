"""Estimates sample by sample, for control loops and everything else that does not wait."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, SupportsIndex, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from algdiff import _arguments as arguments
from algdiff import _core, _state
from algdiff import _threads as threads_of
from algdiff._arguments import Samples
from algdiff._core import Bank
from algdiff._differentiator import Differentiator
from algdiff._refusals import shown
from algdiff._results import Estimates
from algdiff._wish import POLICIES, check_rule, check_support, check_trim, chosen, gain_limit

if TYPE_CHECKING:
    from typing import Self

AnyStream = TypeVar("AnyStream", bound="Stream")
Held = tuple[list[float], list[float], int]
"""The samples that windows hold, their times, and how many there were."""

WARMUPS = ("nan", "grow")


class Stream(_core.Stream):
    """Estimates that come with every sample: of the window that ends with it.

    The same, to the bit, whatever blocks the samples come in; and the same as what
    ``design.replace(engine="direct")(x, mode="valid")`` gives, to the bit where weights slide over full windows, and to
    rounding where windows are fitted. Every estimate is the derivative a known time, `delay`, before the newest sample:
    choose it by ``tau=`` or ``delay=`` of the design, or here. At 0 there is no delay, and below the estimate is a
    prediction; the noise gain says what that costs.

    Parameters
    ----------
    design : Differentiator or sequence of Differentiator
        What to estimate: of one order, or of several in one window; or several designs, of which each has its own
        window, but all the same `delta` and delay.
    channels : int, optional
        Samples are vectors of so many numbers; by default they are numbers.
    dtype : {float64, float32}
        What samples are converted to, and computed in.
    delay : float, optional
        Instead of the designs' own: the time from the estimates to the newest sample, in the unit of `delta`. With time
        stamps such a delay stays, while that of a design made by `tau` changes with the length of its windows.
    warmup : {"nan", "grow"}
        What estimates are before the window is full: NaN, or those of the window that the samples so far make, as soon
        as these are ``degree + 1``. They have the design's `tau`; if it was made by a delay, if `delay` is given here,
        or of several designs, its delay, as far as the window reaches back. `std` says how large their errors are.
    nan_policy : {"propagate", "omit", "raise"}
        What NaN and masked samples do. "propagate" makes every estimate NaN whose window holds one; "omit" fits the
        other samples; "raise" refuses them.
    min_support, max_gain
        As in a call of a design: samples that a window must hold, and how much the noise gain may rise.
    sigma : float
        Standard deviation of the noise in the samples, for `std`.
    threads : int, optional
        At most this many threads for a block; by default as in a call of a design.

    Attributes
    ----------
    design, channels, dtype, warmup, nan_policy
        The arguments; designs as a tuple, `delay` applied.
    count : int
        Samples pushed since the start or the last `reset`.
    ready : bool
        Whether the longest window is full.
    delay : float
        Time from the last estimate to the newest sample. Before the first estimate, that of full windows.
    time : float
        Of the last estimate, if the first sample has time 0; with time stamps, on their clock. NaN before the first
        estimate. Of several designs, as soon as the first one gives any.
    std : float or ndarray
        Standard deviation of the last estimate, in the shape of it.
    support : int or ndarray
        Samples in the last window that are not missing: a number for every design and channel.
    state : dict
        All that is needed to go on, as JSON can hold it; may be set.

    Raises
    ------
    ValueError
        Designs do not go together, or an argument is none of what it may be.
    TypeError
        `design` is no `Differentiator` and no sequence of them, or `dtype` another one.

    Notes
    -----
    Windows are applied tap by tap, as by the engine "direct", or, where they are still growing, miss samples or have
    time stamps, fitted. Every sample of the longest window is held twice. Blocks are computed without the interpreter,
    and by the engine of a design that names one: those of "moments" and "fft" agree to rounding with what single
    samples give. Streams may be used by several threads, one push after the other. They are pickled and copied with all
    the samples that they hold. Masked samples are missing; results are never masked.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import Differentiator, Stream
    >>> d = Differentiator(5, degree=2, kappa=0, mu=0, tau="newest", delta=0.1)
    >>> stream = Stream(d)
    >>> for x in (0.1 * np.arange(6)) ** 2:
    ...     print(round(stream.push(x), 9), end=" ")
    nan nan nan nan 0.8 1.0

    The same in blocks, the position and the velocity of two channels, from windows of their own:

    >>> position = Differentiator(3, 0, degree=1, delta=0.1)
    >>> stream = Stream([position, d], channels=2, delay=0)
    >>> t = 0.1 * np.arange(6)
    >>> stream.push(np.stack([t**2, 3 * t], axis=1)).shape
    (2, 6, 2)
    >>> stream.push([0.36, 1.8]).round(9)[1]
    array([1.2, 3. ])
    >>> stream.count, stream.ready, stream.delay, round(stream.time, 9)
    (7, True, 0.0, 0.6)
    """

    __slots__ = ("_design", "_words")

    _design: Differentiator | tuple[Differentiator, ...]
    _words: dict[str, Any]

    def __new__(
        cls,
        design: Differentiator | Sequence[Differentiator],
        *,
        channels: SupportsIndex | None = None,
        dtype: DTypeLike = np.float64,
        delay: float | None = None,
        warmup: str = "nan",
        nan_policy: str = "propagate",
        min_support: SupportsIndex | None = None,
        max_gain: float | None = None,
        sigma: float = 1.0,
        threads: int | None = None,
    ) -> Self:
        designs = _designs(design, delay)
        chosen("warmup", warmup, WARMUPS)
        chosen("nan_policy", nan_policy, POLICIES)
        kind = arguments.real_dtype("dtype", dtype)
        count = None if channels is None else arguments.integer("channels", channels, 1)
        least = max(one.degree for one in designs) + 1
        support = 0 if min_support is None else arguments.integer("min_support", min_support, least)
        gain, level, most = gain_limit(max_gain), arguments.level("sigma", sigma), threads_of.count(threads)
        for one in designs:
            check_support(one, support)
            if warmup == "grow":
                _check_fits("warmup = 'grow'", one)
            if nan_policy == "omit":
                check_rule(one, "nan_policy = 'omit'")
        several = not isinstance(design, Differentiator)
        banks = [Bank(one._plans, _engine(one)) for one in designs]
        self = super().__new__(
            cls,
            banks,
            [_point(one, several) for one in designs],
            count,
            leading=several or designs[0]._leading is not None,
            single=kind == np.float32,
            grow=warmup == "grow",
            missing=nan_policy,
            support=support,
            gain=gain,
            stamps=all(one.rule == "exact" and one.trim == 0 for one in designs),
            threads=most,
        )
        self._design = designs if several else designs[0]
        words = {"channels": count, "dtype": kind.name, "warmup": warmup, "nan_policy": nan_policy}
        self._words = {**words, "min_support": support or None, "max_gain": gain, "sigma": level}
        self._words["threads"] = None if threads is None else most
        return self

    @property
    def design(self) -> Differentiator | tuple[Differentiator, ...]:
        """What is estimated."""
        return self._design

    @property
    def channels(self) -> int | None:
        """Numbers in a sample; None if a sample is a number."""
        channels: int | None = self._words["channels"]
        return channels

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type that samples are converted to."""
        kind: np.dtype[Any] = np.dtype(self._words["dtype"])
        return kind

    @property
    def warmup(self) -> str:
        """What estimates are before the window is full."""
        return str(self._words["warmup"])

    @property
    def nan_policy(self) -> str:
        """What missing samples do."""
        return str(self._words["nan_policy"])

    @property
    def _designs(self) -> tuple[Differentiator, ...]:
        return self.design if isinstance(self.design, tuple) else (self.design,)

    @property
    def _leads(self) -> bool:
        """Whether estimates have a leading axis over orders."""
        return isinstance(self.design, tuple) or self.design._leading is not None

    @property
    def _orders(self) -> int:
        """How many orders there are, of all designs together."""
        return sum(len(design._plans) for design in self._designs)

    @property
    def _shape(self) -> tuple[int, ...]:
        """The shape of a sample."""
        return () if self.channels is None else (self.channels,)

    def _push(self, x: ArrayLike, t: ArrayLike | None, return_std: bool, return_support: bool) -> Any:
        """Push what is no single sample in the simplest form."""
        samples = self._samples(x)
        one = samples.ndim == (self.channels is not None)
        block = samples[np.newaxis] if one else samples
        times = None if t is None else self._times(t, one, len(block))
        estimate = np.empty((self._orders, *block.shape), self.dtype)
        std = np.empty_like(estimate) if return_std else None
        support = np.empty((len(self._designs), *block.shape), np.int64) if return_support else None
        self._block(
            block.reshape(-1),
            times,
            estimate.reshape(-1),
            None if std is None else std.reshape(-1),
            None if support is None else support.reshape(-1),
        )
        if std is not None:
            std *= self._words["sigma"]
        found = _given(estimate, self._leads, one)
        if not (return_std or return_support):
            return found
        several = isinstance(self.design, tuple)
        return Estimates(found, _given(std, self._leads, one), _given(support, several, one))

    def _samples(self, x: ArrayLike) -> Samples:
        """Return one sample or a block of them in the stream's type."""
        given = x if isinstance(x, np.ma.MaskedArray) else arguments.plain("x", x)
        if given.dtype.kind == "c":
            raise TypeError("x must be real numbers, got complex ones: push real and imaginary parts as two channels")
        if given.dtype.kind not in "fiub":
            raise TypeError(f"x must be real numbers, got dtype {given.dtype}")
        # A number has no axes, which arrays of a signal must have.
        samples = arguments.unmasked("x", given[np.newaxis] if given.ndim == 0 else given).reshape(given.shape)
        shape = self._shape
        if shape not in (samples.shape, samples.shape[1:] if samples.ndim else None):
            sample = f"an array of shape {shape}" if shape else "a number"
            raise ValueError(f"x must be {sample}, or a block of them along a first axis, got shape {samples.shape}")
        with np.errstate(over="ignore"):
            return np.require(samples, self.dtype, ["C", "A"])

    def _times(self, t: ArrayLike, one: bool, count: int) -> Samples:
        times, shape = arguments.points("t", t)
        if shape != (() if one else (count,)):
            raise ValueError(f"t must be {'a number' if one else f'of shape ({count},)'}, got shape {shape}")
        for design in self._designs:
            _check_fits("time stamps", design)
        return times

    @property
    def delay(self) -> float:
        """Time from the last estimate to the newest sample; before the first estimate, that of full windows."""
        delay, newest = self._placed()
        first = self._designs[0]
        usual = math.isnan(delay) or (newest is None and self.count >= first.weights.shape[-1])
        return first.delay if usual else delay

    @property
    def time(self) -> float:
        """Of the last estimate, from the first sample on, or on the clock of the time stamps."""
        delay, newest = self._placed()
        if math.isnan(delay):
            return math.nan
        return (newest if newest is not None else (self.count - 1) * self._designs[0].delta) - self.delay

    @property
    def std(self) -> Any:
        """Standard deviation of the last estimate, in the shape of it."""
        _, std, _ = self._last()
        level = self._words["sigma"] * np.array(std, self.dtype)
        return _given(level.reshape(self._orders, 1, *self._shape), self._leads)

    @property
    def support(self) -> Any:
        """Samples in the last window that are not missing."""
        _, _, support = self._last()
        return _given(np.array(support).reshape(-1, 1, *self._shape), isinstance(self.design, tuple))

    @property
    def state(self) -> dict[str, Any]:
        """All that is needed to go on: what the stream was made from, its count and the samples that windows hold."""
        return _state.of(self)

    @state.setter
    def state(self, state: dict[str, Any]) -> None:
        _state.put(self, state)

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> Self:
        """Return a stream that goes on from `state`, to the bit.

        Parameters
        ----------
        state : dict
            What `state` of a stream gave, before or after JSON.

        Raises
        ------
        ValueError
            `state` is none.

        Examples
        --------
        >>> import json
        >>> from algdiff import Differentiator, Stream
        >>> stream = Differentiator(3, degree=1).stream()
        >>> stream.push([0.0, 1.0, 2.0])
        array([nan, nan,  1.])
        >>> again = Stream.from_state(json.loads(json.dumps(stream.state)))
        >>> again.push(6.0) == stream.push(6.0), round(stream.push(9.0), 9)
        (True, 3.5)
        """
        return _state.restored(cls, state)

    def copy(self) -> Self:
        """Return a stream that goes on from here on its own.

        Examples
        --------
        >>> from algdiff import Differentiator
        >>> stream = Differentiator(3, degree=1).stream()
        >>> other = stream.copy()
        >>> other.push(1.0), other.count, stream.count
        (nan, 1, 0)
        """
        return rebuild(type(self), self.design, self._words, self._held())

    def __copy__(self) -> Self:
        return self.copy()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        return rebuild, (type(self), self.design, self._words, self._held())

    def __repr__(self) -> str:
        words = [f"{name}={value!r}" for name, value in self._words.items() if value is not None]
        return f"Stream({self.design!r}, {', '.join(words)})"


def rebuild(cls: type[AnyStream], design: Any, words: dict[str, Any], held: Held) -> AnyStream:
    """Return the stream that was made from these words and has seen these samples."""
    stream = cls(design, **words)
    stream._restore(*held)
    return stream


def _designs(design: object, delay: float | None) -> tuple[Differentiator, ...]:
    """Return the designs with the delay applied, which must be one."""
    given = (design,) if isinstance(design, Differentiator) else design
    if not isinstance(given, Sequence) or not all(isinstance(one, Differentiator) for one in given):
        raise TypeError(f"design must be a Differentiator or a sequence of them, got {shown(design)}")
    if not given:
        raise ValueError("design must be a Differentiator or a sequence of them, got an empty one")
    designs: tuple[Differentiator, ...] = tuple(given)
    first = designs[0]
    if any(one.delta != first.delta for one in designs):
        raise ValueError(f"designs must have the same delta, got {[one.delta for one in designs]}")
    if delay is not None:
        wanted = arguments.real("delay", delay)
        if any(one.trim != 0 for one in designs):
            trims = [one.trim for one in designs]
            raise ValueError(
                f"give delay or trim, not both: got delay = {shown(delay)} and designs with trim = {trims}"
            )
        designs = tuple(one._changed(delay=wanted, tau=None) for one in designs)
    elif not all(math.isclose(one.delay, first.delay, rel_tol=1e-9, abs_tol=1e-9 * one.delta) for one in designs):
        raise ValueError(f"designs must have the same delay, got {[one.delay for one in designs]}: give delay")
    return designs


def _engine(design: Differentiator) -> str:
    """Return the engine of blocks: the one that gives the same bits whatever blocks, unless another was asked for."""
    asked: str = design._asked["engine"]
    return "direct" if asked == "auto" else asked


def _check_fits(what: str, design: Differentiator) -> None:
    """Refuse designs whose shorter or uneven windows are not known."""
    check_rule(design, what)
    check_trim(design, what)


def _given(part: Samples | None, leading: bool, one: bool = True) -> Any:
    """Return results without a leading axis that was not asked for; of one sample without that of the samples."""
    if part is None:
        return None
    part = part[:, 0] if one else part
    part = part if leading else part[0]
    return part.item() if part.ndim == 0 else part


def _point(design: Differentiator, several: bool) -> tuple[float | None, float]:
    """Return where windows are estimated that are not the design's own: at `tau`, or at a delay."""
    asked = design._asked
    by_delay = several or asked["delay"] is not None or asked["tau"] == "newest"
    return (None if by_delay else design.tau), design.delay
