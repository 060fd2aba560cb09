"""Differentiation for once: two lines over the object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff import _dask as dask
from algdiff import _orders as orders
from algdiff._arguments import Samples
from algdiff._differentiator import remembered
from algdiff._refusals import shown
from algdiff._times import lasting


def differentiate(
    x: ArrayLike,
    window_length: SupportsIndex | None = None,
    deriv: SupportsIndex | Sequence[SupportsIndex] = 1,
    *,
    degree: SupportsIndex | None = None,
    kappa: float = 1.0,
    mu: float = 1.0,
    tau: float | str | None = None,
    delay: float | None = None,
    delta: float | None = None,
    fs: float | None = None,
    t: ArrayLike | None = None,
    at: ArrayLike | None = None,
    window_duration: float | np.timedelta64 | None = None,
    local: bool = False,
    axis: int = -1,
    mode: str = "fit",
    cval: complex = 0.0,
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
    rule: str = "exact",
    trim: float = 0.0,
    engine: str = "auto",
    out: Samples | None = None,
    threads: int | None = None,
) -> Any:
    """Differentiate noisy samples by a sliding window.

    The same as ``Differentiator(window_length, deriv, ...)(x, ...)``, which says what the arguments mean. Make the
    object yourself to use one design again, or to know its delay, noise gain and weights. Without a window it is
    ``suggest(x, deriv, ...)(x, ...)``, which chooses one from the samples; ask `suggest` what it chose, and why.

    Parameters
    ----------
    x : array_like
        Samples, `delta` apart along `axis`.
    window_length : int, optional
        Number of samples in the window. By default, and without `window_duration`, it is chosen from `x`, and so is
        `degree`.
    deriv : int or sequence of int
        Order of the derivative; 0 smooths. Several are computed in one pass.
    degree : int, optional
        Degree of the local polynomial; default ``deriv + 2``, of several orders the highest.
    kappa, mu : float
        Exponents of the weight at the oldest and the newest end of the window, greater than -1.
    tau : {"center", "root", "newest"} or float, optional
        Point of estimation in the window; default "center".
    delay : float, optional
        Instead of `tau`: the time from the estimate to the newest sample.
    delta, fs : float, optional
        Sampling step (default 1), or sampling rate.
    t : array_like, optional
        Instead: the times of the samples, strictly monotone, evenly spaced or not; numbers or datetime64.
    at : array_like, optional
        Times at which estimates are wanted, instead of those of the samples.
    window_duration : float or timedelta64, optional
        Duration of the window.
    local : bool
        Of a chosen window: let it adapt along the signal.
    axis : int
        The axis of time in `x`.
    mode : {"fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"}
        What happens at the ends; "fit" goes on to the last sample, "valid" gives the whole windows only.
    cval : float
        The value beyond the data in mode "constant".
    edge_window : {"full", "shrink"}
        Whether windows stay as long as they are at the ends, or shrink.
    nan_policy : {"propagate", "omit", "raise"}
        What NaN and masked samples do: spread over their windows, be left out of the fits, or be refused.
    min_support, max_gain : int, float, optional
        Samples that a fit needs, and how much noise gaps may add, or the estimate is NaN.
    weights : array_like, optional
        Inverse variances of the samples.
    period : float, optional
        The period of samples that are angles.
    return_std, return_support, return_bias : bool
        Return `Estimates`: the standard deviation of each, the number of samples it uses, an indicator of its bias.
    sigma, autocovariance : array_like, optional
        The standard deviation of the noise, or its covariance; by default `noise_level`.
    rule : {"exact", "trapezoid", "midpoint", "simpson", "cell", "hat"}
        How the continuous kernel becomes weights.
    trim : float
        Leave out at either end of the window what holds at most this share of the weights.
    engine : {"auto", "direct", "moments", "fft"}
        How the weights are applied; "auto" takes the one that is likely to be the fastest.
    out : ndarray, optional
        Where the result goes.
    threads : int, optional
        At most this many threads, and four for every processor.

    Returns
    -------
    ndarray or Estimates
        The estimates, in the shape of `x` (shorter along `axis` in mode "valid"), in the unit of `x` over that of
        ``delta**deriv``; float32 and complex64 stay, everything else becomes float64 or complex128. Several orders
        lie along a leading axis, in the order of `deriv`.

    Raises
    ------
    ValueError, TypeError, MemoryError
        See `Differentiator`.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import differentiate
    >>> t = np.linspace(0, 1, 101)
    >>> acceleration = differentiate(t**3, 21, deriv=2, delta=0.01)
    >>> bool(np.allclose(acceleration, 6 * t))
    True
    >>> velocity, acceleration = differentiate(t**3, 21, deriv=(1, 2), delta=0.01)
    >>> bool(np.allclose(velocity, 3 * t**2))
    True
    """
    if type(deriv) is not int:
        deriv = orders.checked(deriv)
    if t is not None and (delta is not None or fs is not None):
        raise ValueError(f"give t, delta or fs, one of them: got t and {'fs' if delta is None else 'delta'}")
    call: dict[str, Any] = {
        "mode": mode,
        "cval": cval,
        "edge_window": edge_window,
        "nan_policy": nan_policy,
        "min_support": min_support,
        "max_gain": max_gain,
        "weights": weights,
        "period": period,
        "return_std": return_std,
        "return_support": return_support,
        "return_bias": return_bias,
        "sigma": sigma,
        "autocovariance": autocovariance,
        "out": out,
        "threads": threads,
    }
    if window_length is None and window_duration is None:
        from algdiff._suggest.once import differentiated

        asked = {"degree": degree, "kappa": kappa, "mu": mu, "delta": delta, "fs": fs, "t": t, "local": local}
        refused = {"tau": tau, "delay": delay, "rule": None if rule == "exact" else rule, "trim": trim or None}
        return differentiated(x, deriv, axis, asked, {**refused, "at": at}, engine, call)
    if local:
        raise ValueError(f"local must be left out with a given window, got {shown(local)}: it is for chosen ones")
    if window_length is None or window_duration is not None:
        step = arguments.sampling_step(delta, fs)
        window_length = lasting(window_duration, window_length, dask.held(t), step, degree, deriv)
    design = remembered(window_length, deriv, degree, kappa, mu, tau, delay, delta, fs, rule, trim, engine)
    if design._crowded:
        design._warn()
    return design(x, axis, t=t, at=at, window_duration=window_duration, **call)
