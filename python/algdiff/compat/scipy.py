"""Taps for SciPy's filters, by a function in the manner of `scipy.signal.firwin`. Needs NumPy only."""

from __future__ import annotations

from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from algdiff._differentiator import Differentiator
from algdiff._orders import single
from algdiff.compat._names import renamed

__all__ = ["firdiff"]


def firdiff(
    numtaps: SupportsIndex | None = None,
    cutoff: float | None = None,
    *,
    deriv: SupportsIndex = 1,
    degree: SupportsIndex | None = None,
    kappa: float = 1.0,
    mu: float = 1.0,
    tau: float | str | None = None,
    delay: float | None = None,
    fs: float = 1.0,
    rule: str = "exact",
) -> NDArray[np.float64]:
    """Design a differentiator as the taps of an FIR filter, the newest sample's first.

    The taps are `Differentiator.weights` turned round: from sample ``n - 1`` on, ``lfilter(firdiff(n, fs=fs), 1, x)``
    is the derivative at the time `Differentiator.delay` before every sample.

    Parameters
    ----------
    numtaps : int, optional
        Number of taps, the `window_length` of `Differentiator`.
    cutoff : float, optional
        Instead of `numtaps`: the cutoff of `Differentiator.from_cutoff`, in the unit of `fs`.
    deriv, degree, kappa, mu, tau, delay, rule
        As in `Differentiator`, of a single order.
    fs : float
        Sampling rate; 1 by default, where `firwin` has 2.

    Returns
    -------
    taps : ndarray of shape (numtaps,)
        In units of ``fs**deriv``.

    Raises
    ------
    ValueError, TypeError
        As by `Differentiator`; or `numtaps` and `cutoff` are both given, or neither is.

    Examples
    --------
    >>> from algdiff.compat.scipy import firdiff
    >>> firdiff(5, degree=2, kappa=0, mu=0, fs=10).round(9)
    array([ 2.,  1.,  0., -1., -2.])
    >>> firdiff(cutoff=20, fs=1000).size
    47
    """
    if (numtaps is None) == (cutoff is None):
        raise ValueError(f"either numtaps or cutoff must be given, got numtaps={numtaps!r} and cutoff={cutoff!r}")
    words: dict[str, Any] = {"degree": degree, "kappa": kappa, "mu": mu, "tau": tau, "delay": delay, "fs": fs}
    if cutoff is None:
        with renamed({"window_length": "numtaps"}):
            design = Differentiator(numtaps, deriv, rule=rule, **words)  # type: ignore[arg-type]
    else:
        design = Differentiator.from_cutoff(cutoff, deriv, rule=rule, **words)
    single("the taps of a filter", design)
    return design.weights[::-1].copy()
