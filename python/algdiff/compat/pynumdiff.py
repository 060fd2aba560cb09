"""A method for PyNumDiff: importing this module registers it with the tuner, ``pynumdiff.optimize.optimize``."""

from __future__ import annotations

import warnings
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._differentiate import differentiate

try:
    with warnings.catch_warnings():
        # It says which of its own methods lack CVXPY.
        warnings.simplefilter("ignore", UserWarning)
        from pynumdiff.optimize import method_params_and_bounds
except ImportError as _error:
    raise ImportError(f"algdiff.compat.pynumdiff needs pynumdiff: pip install pynumdiff ({_error})") from _error

__all__ = ["algdiff"]

SPACE = {"window_length": [5, 15, 31, 51, 91, 131, 201, 301], "degree": {2, 4, 6}, "kappa": 1.0, "mu": 1.0}
BOUNDS = {"window_length": (3, 10_000, "odd")}


def algdiff(
    x: ArrayLike,
    dt_or_t: ArrayLike,
    window_length: SupportsIndex | None = None,
    degree: SupportsIndex | None = None,
    kappa: float = 1.0,
    mu: float = 1.0,
    axis: int = 0,
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Smooth and differentiate by `algdiff.differentiate`.

    NaN are missing samples, which the fits leave out. Where too few are left there is no estimate but NaN.

    Parameters
    ----------
    x : array_like
        Samples along `axis`.
    dt_or_t : float or array_like
        The sampling step, or the times of the samples, even or not.
    window_length : int, optional
        Number of samples in the window. Without it, window and degree are chosen from the data, one for all rows, and
        by themselves for the signal and its derivative. That needs even times, and takes milliseconds.
    degree, kappa, mu
        As in `algdiff.differentiate`.
    axis : int
        The axis of time in `x`.

    Returns
    -------
    x_hat, dxdt_hat : ndarray
        The smoothed samples and their derivative.

    Raises
    ------
    numpy.linalg.LinAlgError
        The window holds more samples than there are, or too few for the degree. This is a ValueError; the tuner takes
        it for a bad guess.
    ValueError, TypeError
        As by `algdiff.differentiate`.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff.compat.pynumdiff import algdiff
    >>> t = np.linspace(0, 1, 101)
    >>> x_hat, dxdt_hat = algdiff(t**2, 0.01, window_length=11)
    >>> bool(np.allclose(x_hat, t**2)), bool(np.allclose(dxdt_hat, 2 * t))
    (True, True)
    """
    samples = arguments.unmasked("x", x)
    words: dict[str, Any] = {"degree": degree, "kappa": kappa, "mu": mu, "axis": axis}
    if np.ndim(dt_or_t) == 0 and not arguments.real("dt_or_t", dt_or_t) > 0:
        raise ValueError(f"dt_or_t must be a positive step or the times of the samples, got {dt_or_t!r}")
    words["t" if np.ndim(dt_or_t) else "delta"] = dt_or_t
    if np.isnan(samples).any():
        words["nan_policy"] = "omit"
    if window_length is None:
        return differentiate(samples, deriv=0, **words), differentiate(samples, deriv=1, **words)
    least = 4 if degree is None else arguments.integer("degree", degree, 1) + 1
    most = samples.shape[arguments.axis_index(axis, samples.ndim)]
    if not least <= arguments.integer("window_length", window_length, 1) <= most:
        raise np.linalg.LinAlgError(f"window_length must be from {least} to {most}, got {window_length}")
    x_hat, dxdt_hat = differentiate(samples, window_length, (0, 1), **words)
    return x_hat, dxdt_hat


method_params_and_bounds[algdiff] = (SPACE, BOUNDS)
