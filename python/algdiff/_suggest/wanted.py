"""What is wanted of a choice, checked."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff import _dask as dask
from algdiff._kernel import Kernel
from algdiff._orders import checked, highest
from algdiff._refusals import named, shown
from algdiff._suggest.candidates import even_degrees
from algdiff._suggest.level import Limits
from algdiff._times import Stamps

FEWEST = 5
"""Samples that a choice needs, and one more for each order."""

KINDS = ("auto", "white", "ar1")


class Wanted(NamedTuple):
    """What is wanted.

    Attributes
    ----------
    orders : int or tuple of int
        The orders of the derivative.
    delta : float
        Sampling step.
    exponent : float
        kappa and mu.
    limits : Limits
        What windows may be.
    said : tuple of str
        What of it was asked for.
    sigma : float or None
        The level of the noise, if it is known.
    noise : str
        What kind of noise it is.
    delay : float or None
        The longest delay, in samples.
    bandwidth : float
        What is to pass, in cycles per sample; 0 if nothing was asked for.
    local : bool
        Whether the window adapts.
    """

    orders: int | tuple[int, ...]
    delta: float
    exponent: float
    limits: Limits
    said: tuple[str, ...]
    sigma: float | None
    noise: str
    delay: float | None
    bandwidth: float
    local: bool

    @property
    def deriv(self) -> int:
        """The order that is chosen for: the highest."""
        return highest(self.orders)


def wanted(
    deriv: Any,
    length: int,
    delta: float,
    *,
    degree: object = None,
    kappa: object = 1.0,
    mu: object = 1.0,
    sigma: object = None,
    noise: object = "auto",
    max_delay: object = None,
    bandwidth: object = None,
    min_window: object = None,
    max_window: object = None,
    local: bool = False,
) -> Wanted:
    """Return what is wanted of a choice for `length` samples."""
    orders = checked(deriv)
    top = highest(orders)
    if not (math.isfinite(delta) and delta > 0):
        raise ValueError(f"delta must be finite and positive, got {delta}")
    if length < FEWEST + top:
        raise ValueError(f"x must have at least {FEWEST + top} samples to choose a window, got {length}")
    exponent, level = _exponent(kappa, mu), _level(sigma, noise)
    degrees = even_degrees(top) if degree is None else [arguments.integer("degree", degree, top)]
    least, most, said = _bounds(min_window, max_window, length)
    longest, band = dict.fromkeys(degrees, most), 0.0
    if bandwidth is not None:
        band = arguments.real("bandwidth", bandwidth)
        longest = _passing(degrees, top, exponent, band, delta, most)
        said.append(f"bandwidth = {bandwidth}")
    delay = None
    if max_delay is not None:
        delay = arguments.level("max_delay", max_delay) / delta
        said.append(f"max_delay = {max_delay}")
        if local:
            given = named(local=local, max_delay=max_delay)
            raise ValueError(f"give local or max_delay, not both: got {given}, and windows that adapt are centered")
    limits = Limits(longest, least)
    return Wanted(orders, delta, exponent, limits, tuple(said), level, str(noise), delay, band * delta, bool(local))


def _exponent(kappa: object, mu: object) -> float:
    exponent, other = arguments.real("kappa", kappa), arguments.real("mu", mu)
    if exponent != other or not -0.5 < exponent < math.inf:
        raise ValueError(f"kappa and mu must be equal and greater than -1/2 to choose a window, got {kappa} and {mu}")
    return exponent


def _level(sigma: object, noise: object) -> float | None:
    if arguments.word("noise", noise, "a word, one of 'auto', 'white', 'ar1'") not in KINDS:
        raise ValueError(f"noise must be 'auto', 'white' or 'ar1', got {shown(noise)}")
    if sigma is None:
        return None
    if noise == "ar1":
        raise ValueError(f"give sigma or noise = 'ar1', not both: got {named(sigma=sigma, noise=noise)}")
    return arguments.level("sigma", sigma)


def _bounds(min_window: object, max_window: object, length: int) -> tuple[int, int, list[str]]:
    least = 3 if min_window is None else arguments.integer("min_window", min_window, 1)
    most = arguments.MAX_WINDOW if max_window is None else arguments.integer("max_window", max_window, 3)
    if most < least:
        raise ValueError(f"max_window must be at least min_window, got {most} and {least}")
    if least > length:
        raise ValueError(f"min_window must be at most the number of samples, {length}, got {least}")
    said = [f"min_window = {least}"] if min_window is not None else []
    return least, most, said + ([f"max_window = {most}"] if max_window is not None else [])


def _passing(
    degrees: list[int], deriv: int, exponent: float, bandwidth: float, delta: float, most: int
) -> dict[int, int]:
    """Return the longest windows, by degree, whose -3 dB point is at least `bandwidth`."""
    if not (math.isfinite(bandwidth) and bandwidth > 0):
        raise ValueError(f"bandwidth must be finite and positive, got {bandwidth}")
    longest = {}
    for degree in degrees:
        half_power = Kernel(deriv, degree, exponent, exponent, "center").half_power
        if half_power is not None:
            longest[degree] = int(min(most, half_power / (2 * math.pi * bandwidth * delta)))
    if not any(window > degree for degree, window in longest.items()):
        raise ValueError(f"bandwidth must be lower, got {bandwidth}: no window passes that at a step of {delta:g}")
    return longest


def sampled(length: int, delta: float | None, fs: float | None, t: ArrayLike | None) -> float:
    """Return the step of even samples."""
    if t is None:
        return arguments.sampling_step(delta, fs)
    if delta is not None or fs is not None:
        raise ValueError(f"give t, delta or fs, one of them: got t and {'fs' if delta is None else 'delta'}")
    stamps = Stamps(dask.held(t), length)
    if stamps.step is None and length > 1:
        raise ValueError(
            "t must be evenly spaced to choose a window by, got uneven times: give window_length or window_duration"
        )
    return 1.0 if stamps.step is None else stamps.step  # a single sample is refused for being too few


def descending(t: ArrayLike) -> bool:
    """Return whether even times run backwards."""
    times = np.asarray(dask.held(t))
    return bool(times.size > 1 and times[-1] < times[0])
