"""What a call asks for beside the plain estimates, checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._arguments import Progress, Samples
from algdiff._refusals import named, shown

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator


class Wish(NamedTuple):
    """What a call asks for beside the plain estimates."""

    t: ArrayLike | None = None
    at: ArrayLike | None = None
    window_duration: Any = None
    min_support: Any = None
    max_gain: Any = None
    weights: ArrayLike | None = None
    period: Any = None
    sigma: ArrayLike | None = None
    autocovariance: ArrayLike | None = None
    edge_window: str = "full"
    nan_policy: str = "propagate"
    return_std: bool = False
    return_support: bool = False
    return_bias: bool = False


class Call(NamedTuple):
    """The other arguments of a call."""

    axis: int
    mode: str
    cval: complex
    out: Samples | None
    threads: int | None
    progress: Progress | None


class Windows(NamedTuple):
    """Where windows lie that are not those of the design on even samples.

    Attributes
    ----------
    times : ndarray or None
        The times of the samples, unless they are even and estimates are wanted at the samples.
    at : ndarray or None
        The times of the estimates, if they are not those of the samples.
    duration, pad : float
        The duration of a window, and by how much it may reach beyond the data.
    """

    times: NDArray[np.float64] | None = None
    at: NDArray[np.float64] | None = None
    duration: float | None = None
    pad: float = 0.0


class Limits(NamedTuple):
    """Which windows give an estimate.

    Attributes
    ----------
    support : int
        The least number of samples.
    gain : float or None
        The largest noise gain, relative to that of the whole window, if one was given.
    least : int or None
        The shortest window at the ends, if windows shrink there.
    """

    support: int
    gain: float | None
    least: int | None


def uneven(times: NDArray[np.float64] | None) -> str:
    """Return what messages call times without a step: those of a single sample have none, either."""
    return "uneven t" if times is None or times.size > 1 else "a single sample at a t, which has no step"


POLICIES = ("propagate", "omit", "raise")
"""What missing samples do."""
INSIDE = ("fit", "nan", "valid")
"""Modes that do not extend the data."""


def limits(design: Differentiator, windows: Windows, samples: int, call: Call, wish: Wish) -> Limits:
    """Refuse what does not go together, and return what a window must hold."""
    arguments.word("mode", call.mode, "a word such as 'fit'")
    chosen("nan_policy", wish.nan_policy, POLICIES)
    chosen("edge_window", wish.edge_window, ("full", "shrink"))
    shrinks = wish.edge_window == "shrink"
    _fits_only(design, windows, wish)
    if windows.times is not None:
        counted = windows.at is None and windows.duration is None
        what = uneven(windows.times) if windows.at is None else "at"
        chosen("mode", call.mode, INSIDE if counted else INSIDE[:2], f" with {what}")
    if shrinks and (call.mode != "fit" or windows.duration is not None):
        raise ValueError(f"edge_window = 'shrink' must come with mode 'fit' and windows of samples, got {call.mode!r}")
    if wish.autocovariance is not None:
        chosen("mode", call.mode, INSIDE, " with autocovariance")
        if wish.sigma is not None:
            given = named(sigma=wish.sigma, autocovariance=wish.autocovariance)
            raise ValueError(f"give sigma or autocovariance, not both: got {given}")
    span = design._plan.span
    if span > samples and windows.duration is None and call.mode in INSIDE:
        raise ValueError(f"window_length must be at most the {samples} samples of x in mode {call.mode!r}, got {span}")
    least = design.degree + 1
    support = least if wish.min_support is None else arguments.integer("min_support", wish.min_support, least)
    if windows.duration is None:
        check_support(design, support)
    return Limits(
        support, gain_limit(wish.max_gain), min(max(support, 2 * design.degree + 1), span) if shrinks else None
    )


def check_support(design: Differentiator, support: int) -> None:
    """Refuse to ask for more samples than windows have."""
    span = design._plan.span
    if support > span:
        raise ValueError(f"min_support must be at most the {span} samples of a window, got {support}")


def gain_limit(max_gain: object) -> float | None:
    """Return by what factor the noise gain may rise, if that was said."""
    gain = None if max_gain is None else arguments.real("max_gain", max_gain)
    if gain is not None and not gain >= 1:
        raise ValueError(f"max_gain must be at least 1, got {gain}")
    return gain


def check_rule(design: Differentiator, what: str) -> None:
    """Refuse weights that are no fit's."""
    if design.rule != "exact":
        raise ValueError(f"rule must be 'exact' with {what}, got {design.rule!r}")


def check_trim(design: Differentiator, what: str) -> None:
    """Refuse windows of which a part is left out."""
    if design.trim != 0:
        raise ValueError(f"trim must be 0 with {what}, got {design.trim}")


def chosen(name: str, value: object, allowed: tuple[str, ...], where: str = "") -> None:
    """Refuse words that are not allowed."""
    if not isinstance(value, str) or value not in allowed:
        raise ValueError(
            f"{name} must be {', '.join(map(repr, allowed[:-1]))} or {allowed[-1]!r}{where}, got {shown(value)}"
        )


def _fits_only(design: Differentiator, windows: Windows, wish: Wish) -> None:
    """Refuse weights that are no fit's where fits are needed."""
    fitted = {
        uneven(windows.times): windows.times is not None and windows.at is None,
        "at": windows.at is not None,
        "edge_window = 'shrink'": wish.edge_window == "shrink",
        "weights": wish.weights is not None,
        "nan_policy = 'omit'": wish.nan_policy == "omit",
        "return_std": wish.return_std,
        "return_bias": wish.return_bias,
    }
    needed = [name for name, wanted in fitted.items() if wanted]
    if needed:
        check_rule(design, needed[0])
    if windows.times is not None or wish.edge_window == "shrink":
        check_trim(design, needed[0])
