"""A method for PyNumDiff: importing this module registers it with the tuner, ``pynumdiff.optimize.optimize``."""

from __future__ import annotations

import warnings
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._differentiate import differentiate
from algdiff._warnings import outside
from algdiff.compat._names import renamed

try:
    with warnings.catch_warnings():
        # It says which of its own methods lack CVXPY.
        warnings.simplefilter("ignore", UserWarning)
        from pynumdiff.optimize import method_params_and_bounds
except ImportError as _error:
    raise ImportError(f"algdiff.compat.pynumdiff needs pynumdiff: pip install pynumdiff ({_error})") from _error

__all__ = ["algdiff"]

SPACE = {"window_length": [5, 15, 31, 51, 91, 131, 201, 301], "degree": {2, 4, 6}, "kappa": 1.0, "mu": 1.0}
BOUNDS = {"window_length": (3, 1000, "odd")}  # of its own methods: of wider ones Powell samples what fits no data


def algdiff(
    x: ArrayLike,
    dt_or_t: ArrayLike,
    window_length: SupportsIndex | None = None,
    degree: SupportsIndex | None = None,
    kappa: float = 1.0,
    mu: float = 1.0,
    axis: int = 0,
    window_duration: float | None = None,
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
        Number of samples in the window. Without it and `window_duration`, window and degree are chosen from the data,
        one for all rows, and by themselves for the signal and its derivative. That needs even times, and takes
        milliseconds.
    degree, kappa, mu
        As in `algdiff.differentiate`.
    axis : int
        The axis of time in `x`.
    window_duration : float, optional
        Instead of `window_length`: the duration of the window, in the unit of `dt_or_t`.

    Returns
    -------
    x_hat, dxdt_hat : ndarray
        The smoothed samples and their derivative.

    Raises
    ------
    numpy.linalg.LinAlgError
        There are fewer samples than the degree needs. This is a ValueError; the tuner takes it for a bad guess.
    ValueError, TypeError
        As by `algdiff.differentiate`.

    Warns
    -----
    UserWarning
        `window_length` is more than the samples, or too few for the degree: the nearest that fits is taken, as by
        PyNumDiff, whose tuner guesses such windows.

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
    if window_length is not None and window_duration is None:
        window_length = _fitting(window_length, degree, samples.shape[arguments.axis_index(axis, samples.ndim)])
    with renamed({"t": "dt_or_t", "delta": "dt_or_t"}):
        if window_length is None and window_duration is None:
            return differentiate(samples, deriv=0, **words), differentiate(samples, deriv=1, **words)
        x_hat, dxdt_hat = differentiate(samples, window_length, (0, 1), window_duration=window_duration, **words)
    return x_hat, dxdt_hat


def _fitting(window_length: SupportsIndex, degree: SupportsIndex | None, most: int) -> int:
    """Return the window, or the nearest that the samples and the degree allow."""
    least = 4 if degree is None else arguments.integer("degree", degree, 1) + 1
    if least > most:
        raise np.linalg.LinAlgError(f"x must have at least degree + 1 = {least} samples, got {most}")
    given = arguments.integer("window_length", window_length, 1)
    taken = min(max(given, least), most)
    if taken != given:
        message = f"window_length must be from {least} to {most}, got {given}: {taken} is taken"
        warnings.warn(message, UserWarning, stacklevel=outside())
    return taken


method_params_and_bounds[algdiff] = (SPACE, BOUNDS)
