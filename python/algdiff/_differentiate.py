"""Differentiation for once: two lines over the object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import SupportsIndex

from numpy.typing import ArrayLike

from algdiff import _orders as orders
from algdiff._arguments import Samples
from algdiff._differentiator import remembered


def differentiate(
    x: ArrayLike,
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
    axis: int = -1,
    mode: str = "fit",
    cval: complex = 0.0,
    rule: str = "exact",
    trim: float = 0.0,
    engine: str = "auto",
    out: Samples | None = None,
    threads: int | None = None,
) -> Samples:
    """Differentiate noisy samples by a sliding window.

    The same as ``Differentiator(window_length, deriv, ...)(x, ...)``, which says what the arguments mean. Make the
    object yourself to use one design again, or to know its delay, noise gain and weights.

    Parameters
    ----------
    x : array_like
        Samples, `delta` apart along `axis`.
    window_length : int
        Number of samples in the window.
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
    axis : int
        The axis of time in `x`.
    mode : {"fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"}
        What happens at the ends; "fit" goes on to the last sample, "valid" gives the whole windows only.
    cval : float
        The value beyond the data in mode "constant".
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
    ndarray
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
    design = remembered(window_length, deriv, degree, kappa, mu, tau, delay, delta, fs, rule, trim, engine)
    if design._crowded:
        design._warn()
    return design(x, axis, mode=mode, cval=cval, out=out, threads=threads)
