"""The choice of a window from samples, with what users ask of it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff import _dask as dask
from algdiff._arguments import Samples
from algdiff._differentiator import Differentiator
from algdiff._noise import noise_level
from algdiff._suggest import delayed, edges, noise
from algdiff._suggest.candidates import design, reproduced
from algdiff._suggest.level import Level, Search
from algdiff._suggest.rows import LOUDEST, blocks, finite_rows, scaled
from algdiff._suggest.suggestion import RiskCurve, Suggestion
from algdiff._suggest.wanted import FEWEST, Wanted, sampled, wanted

Floats = NDArray[np.float64]


class Chosen(NamedTuple):
    """A choice: the design, the rows and the level that it was made from."""

    design: Differentiator
    rows: Floats
    scale: Floats
    level: Level
    sigma: float
    bias2: float
    variance: float

    @property
    def noise_level(self) -> float:
        """The level of the noise in one row, or the root of its mean square in several."""
        return self.sigma * self.typical

    @property
    def typical(self) -> float:
        """The root mean square of the scales."""
        top = float(self.scale.max())
        return top * math.sqrt(float(np.square(self.scale / top).mean()))


def chosen(x: Samples, axis: int, want: Wanted) -> Chosen:
    """Return what is chosen for `x` along `axis`."""
    rows = finite_rows(x, axis)
    if rows.shape[1] < FEWEST + want.deriv:
        raise ValueError(
            f"x must have {FEWEST + want.deriv} finite samples in a row to choose a window, got {rows.shape[1]}"
        )
    rows, scale = scaled(rows, of_noise=want.sigma is None)
    known = None if want.sigma is None else want.sigma / float(scale[0])
    if known is not None and known > LOUDEST:
        raise ValueError(f"sigma must be at most {LOUDEST:g} times as large as the samples, got {want.sigma:g}")
    level = Search(want.deriv, want.limits, want.exponent, known, want.noise).run(rows)
    best, step = level.risk.best, level.step
    degree = int(level.family.degree[best])
    length = max(int(level.family.window[best]) * step, want.limits.least + 1 - want.limits.least % 2)
    length = _odd(min(length, x.shape[axis]))
    white = float(level.sigma[best])
    sigma = white * math.sqrt(step)
    if 2 * length > x.shape[axis]:
        # One polynomial, whose ends the design is to reproduce, too.
        degree = reproduced(degree, want.deriv)
    made = design(want.orders, length, degree, want.exponent, want.exponent, want.delta)
    per = float(step) ** (-2 * want.deriv)
    found = Chosen(
        made, rows, scale, level, sigma, level.risk.found * per, white**2 * float(level.family.gain[best]) * per
    )
    if want.delay is None or made.delay_samples <= want.delay:
        return found
    return delayed.choose(found, want, want.delay)


def _odd(length: int) -> int:
    return length if length % 2 else length - 1


def suggest(
    x: ArrayLike,
    deriv: Any = 1,
    *,
    degree: SupportsIndex | None = None,
    kappa: float = 1.0,
    mu: float = 1.0,
    delta: float | None = None,
    fs: float | None = None,
    t: ArrayLike | None = None,
    axis: SupportsIndex = -1,
    sigma: float | None = None,
    noise: str = "auto",
    max_delay: float | None = None,
    bandwidth: float | None = None,
    min_window: SupportsIndex | None = None,
    max_window: SupportsIndex | None = None,
    local: bool = False,
) -> Suggestion:
    """Choose a window and a degree from the samples themselves.

    Nothing needs to be known: neither the derivative nor the noise. Of windows of all lengths and of four degrees the
    one is taken whose estimates are expected to err least, in the mean square over the samples; where that is depends
    on the noise and on how fast the signal changes, and both are found from how far the estimates of different windows
    lie apart. ``differentiate(x, delta=...)`` does the same and differentiates.

    Parameters
    ----------
    x : array_like
        Samples along `axis`. One window is chosen for all rows; of more than 16 rows, 16 are looked at, of more than
        4 million samples those in the middle, and of these 16 blocks of 2048 at every scale. Where samples are missing,
        the longest run without gaps is; rows without a finite sample have no say.
    deriv : int or sequence of int
        Order of the derivative; of several, the highest is chosen for.
    degree : int, optional
        Degree of the local polynomial, if it is not to be chosen.
    kappa, mu : float
        Exponents of the weight at the ends of the window, equal and greater than -1/2.
    delta, fs : float, optional
        Sampling step (default 1), or sampling rate.
    t : array_like, optional
        Instead: the times of the samples, evenly spaced.
    axis : int
        The axis of time in `x`.
    sigma : float, optional
        The level of the noise, if it is known.
    noise : {"auto", "white", "ar1"}
        What kind of noise there is: "white", independent from sample to sample; "ar1", first-order autoregressive,
        whose correlation is found and allowed for; "auto": white, but stronger at low frequencies where windows show
        so.
    max_delay : float, optional
        For causal use: the design may lag the newest sample by no more than this, in the unit of `delta`.
    bandwidth : float, optional
        Frequencies up to this one, in cycles per unit of `delta` (Hz), are to pass: the -3 dB point of the design is no
        lower.
    min_window, max_window : int, optional
        Bounds for the window, in samples.
    local : bool
        Let the window adapt along the signal: shorter where it changes fast, longer where it does not.

    Returns
    -------
    Suggestion

    Raises
    ------
    ValueError
        `x` has too few samples, times are uneven, or what is asked for cannot be met.
    TypeError
        An argument is of the wrong type.

    See Also
    --------
    optimal_window : From the level of the noise and the bandwidth of the signal, without samples.

    Notes
    -----
    The square of the bias counts only where two estimates lie farther apart than noise explains (Lepski 1990), at four
    standard deviations; the neighbours of the window found so are then compared by unbiased estimates of their risk.
    The level of the noise is that of the residuals of the smoother of the same window. `docs/choice.md` says how well
    that does, and where it fails.

    Examples
    --------
    >>> import numpy as np
    >>> import algdiff
    >>> t = np.linspace(0, 10, 1001)
    >>> x = np.sin(t) + 0.01 * np.random.default_rng(0).standard_normal(t.size)
    >>> suggestion = algdiff.suggest(x, delta=0.01)
    >>> f"{suggestion.noise_level:.2f}"
    '0.01'
    >>> causal = algdiff.suggest(x, delta=0.01, max_delay=0.2).differentiator
    >>> round(causal.delay, 6)
    0.2
    """
    if dask.is_dask(x):
        raise TypeError(
            "x must be an array in memory, got a lazy one: choose from a part of it, "
            "as suggest(x[:100000].compute(), ...)"
        )
    samples = arguments.unmasked("x", x)
    along = arguments.axis_index(axis, samples.ndim)
    want = wanted(
        deriv,
        samples.shape[along],
        sampled(samples.shape[along], delta, fs, t),
        degree=degree,
        kappa=kappa,
        mu=mu,
        sigma=sigma,
        noise=noise,
        max_delay=max_delay,
        bandwidth=bandwidth,
        min_window=min_window,
        max_window=max_window,
        local=local,
    )
    return described(chosen(samples, along, want), want)


def described(found: Chosen, want: Wanted) -> Suggestion:
    """Return the suggestion with all that is known of it."""
    level = found.level
    unit = want.delta**-want.deriv
    typical = found.typical
    noise2, bias2 = _parts(found, want)
    steps = float(level.step) ** -want.deriv * unit
    family, risk = level.family, level.risk
    with np.errstate(over="ignore"):  # errors of candidates may be beyond the largest number
        # In this order, for infinity times 0 is no number.
        total, random, smooth = (
            np.sqrt(part) * typical * steps for part in (risk.variance + risk.bias2, risk.variance, risk.bias2)
        )
    curve = RiskCurve(family.window * level.step, family.degree, total, random, smooth)
    parts = blocks(found.rows)
    pieces = parts[:, : parts.shape[1] // 16 * 16].reshape(-1, parts.shape[1] // 16) if parts.shape[1] >= 800 else parts
    levels = np.atleast_1d(noise_level(pieces))
    return Suggestion(
        differentiator=found.design,
        rmse=math.sqrt(noise2 + bias2) * typical * unit,
        noise=math.sqrt(noise2) * typical * unit,
        bias=math.sqrt(bias2) * typical * unit,
        noise_level=found.noise_level,
        noise_range=(float(levels.min()) * typical, float(levels.max()) * typical),
        correlation=level.correlation,
        colour=float(level.sigma[level.risk.best]) / level.white,
        quantum=noise.quantum(found.rows[:1]) * float(found.scale[0]),
        curve=curve,
        limits=want.said,
        local=want.local,
    )


def _parts(found: Chosen, want: Wanted) -> tuple[float, float]:
    """Return variance and square of the bias, ends included, for a sampling step of 1."""
    length, half = found.rows.shape[1], found.design.window_length // 2
    if half == 0 or not math.isclose(found.design.tau, 0.5):
        return found.variance, found.bias2
    order = (want.deriv,)
    sigma = np.full(len(found.rows), found.sigma)
    middle = max(length - 2 * half, 0) / length
    noise2, bias2 = middle * found.variance, middle * found.bias2
    for rows in (found.rows, found.rows[:, ::-1]):
        window, degree = found.design.window_length, found.design.degree
        edge = edges.start(rows, length, window, degree, want.exponent, order, sigma, risk=True)
        share = min(half, length) / length
        noise2 += share * float(np.square(edge.std[..., :half]).mean())
        bias2 += share * float(edge.bias2[..., :half].mean())
    return noise2, bias2
