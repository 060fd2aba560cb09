"""SciPy's Savitzky-Golay functions: the members of the family with kappa = mu = 0."""

from __future__ import annotations

from typing import NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._core import Bank, Plan
from algdiff._designs import remembered
from algdiff._refusals import shown
from algdiff._run import run

_MODES = {mode: mode for mode in ("mirror", "nearest", "constant", "wrap")} | {"interp": "fit"}


def savgol_filter(
    x: ArrayLike,
    window_length: SupportsIndex,
    polyorder: SupportsIndex,
    deriv: SupportsIndex = 0,
    delta: float = 1.0,
    axis: int = -1,
    mode: str = "interp",
    cval: float = 0.0,
    *,
    threads: int | None = None,
    engine: str = "auto",
) -> Samples:
    """Apply a Savitzky-Golay filter: the arguments and the result of `scipy.signal.savgol_filter`.

    It differs where SciPy's coefficients lose their digits (long windows, high degrees: 1601 samples and degree 5),
    and for complex data, whose imaginary part SciPy drops. Use `differentiate` for the ends, delays and weights
    that SciPy lacks.

    Parameters
    ----------
    x : array_like
        The data; float32 and complex64 stay, everything else becomes float64 or complex128.
    window_length : int
        Number of coefficients; at most the size of `x` along `axis` in mode "interp". The result of an even window
        belongs to the middle of its window, half a sample after the sample of its index, as in SciPy.
    polyorder : int
        Degree of the polynomial, less than `window_length`.
    deriv : int
        Order of the derivative.
    delta : float
        Sampling step, not zero; used if ``deriv > 0``.
    axis : int
        The axis along which to filter.
    mode : {"interp", "mirror", "nearest", "constant", "wrap"}
        How the ends are treated: by a polynomial fitted to the last window, or by extending the data.
    cval : float
        The value beyond the data in mode "constant".
    threads : int, optional
        At most this many threads.
    engine : {"auto", "direct", "moments", "fft"}
        How the coefficients are applied, as in `Differentiator`.

    Returns
    -------
    ndarray
        The filtered data, in the shape of `x`.

    Raises
    ------
    ValueError, TypeError
        An argument is outside of what it may be, or of the wrong type.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import savgol_filter
    >>> bool(np.allclose(savgol_filter(np.arange(7.0) ** 2, 5, 2, deriv=1), [0, 2, 4, 6, 8, 10, 12]))
    True
    """
    if not isinstance(mode, str) or mode not in _MODES:
        raise ValueError(f"mode must be 'mirror', 'constant', 'nearest', 'wrap' or 'interp', got {shown(mode)}")
    if type(x) is not np.ndarray:
        x = arguments.signal("x", x)
    filtering = _filtering(window_length, polyorder, deriv, delta, engine)
    length = filtering.window_length
    if mode == "interp" and x.ndim and length > x.shape[arguments.axis_index(axis, x.ndim)]:
        raise ValueError(
            f"window_length must be at most the size of x along axis {axis} in mode 'interp', got {length}"
        )
    bank, plan, even = filtering.bank, filtering.plan, length % 2 == 0
    result = run(bank, plan, x, axis=axis, mode=_MODES[mode], cval=cval, half_sample=even, threads=threads)
    if filtering.sign != 1:
        np.multiply(result, filtering.sign, out=result)
    return result


class _Filtering(NamedTuple):
    """What `savgol_filter` does to any data: a bank, and a factor of 1, -1, or 0 beyond `polyorder`."""

    window_length: int
    plan: Plan
    bank: Bank
    sign: int


@remembered
def _filtering(
    window_length: object, polyorder: object, deriv: object, delta: object, engine: object
) -> tuple[_Filtering, int]:
    length, degree, order, step = _check(window_length, polyorder, deriv, delta)
    plan = _plan(length, degree, min(order, degree), step, (length - 1) / 2)
    bank = Bank([plan], arguments.word("engine", engine, "a word such as 'auto'"))
    sign = 0 if order > degree else -1 if step < 0 and order % 2 else 1
    return _Filtering(length, plan, bank, sign), length * (degree + 10)


def savgol_coeffs(
    window_length: SupportsIndex,
    polyorder: SupportsIndex,
    deriv: SupportsIndex = 0,
    delta: float = 1.0,
    pos: float | None = None,
    use: str = "conv",
) -> NDArray[np.float64]:
    """Compute Savitzky-Golay coefficients: the arguments and the result of `scipy.signal.savgol_coeffs`.

    Parameters
    ----------
    window_length : int
        Number of coefficients.
    polyorder : int
        Degree of the polynomial, less than `window_length`.
    deriv : int
        Order of the derivative; beyond `polyorder` the coefficients are zero.
    delta : float
        Sampling step, not zero; used if ``deriv > 0``.
    pos : float, optional
        Position of the estimate in the window, from 0 to less than `window_length`; by default its middle.
    use : {"conv", "dot"}
        Order of the coefficients: for a convolution, or for a dot product with the window.

    Returns
    -------
    ndarray of shape (window_length,)

    Raises
    ------
    ValueError, TypeError
        An argument is outside of what it may be, or of the wrong type.

    Examples
    --------
    >>> from algdiff import savgol_coeffs
    >>> savgol_coeffs(5, 2, deriv=1).round(9)
    array([ 0.2,  0.1,  0. , -0.1, -0.2])
    """
    if not isinstance(use, str) or use not in ("conv", "dot"):
        raise ValueError(f"use must be 'conv' or 'dot', got {shown(use)}")
    length, degree, order, step = _check(window_length, polyorder, deriv, delta)
    position = (length - 1) / 2 if pos is None else arguments.real("pos", pos)
    if not 0 <= position < length:
        raise ValueError(f"pos must be at least 0 and less than window_length = {length}, got {position}")
    plan = _plan(length, degree, min(order, degree), step, position)
    coefficients = np.zeros(length)
    if order <= degree:
        plan.weights(coefficients)
    if step < 0 and order % 2:
        np.negative(coefficients, out=coefficients)
    return coefficients[::-1].copy() if use == "conv" else coefficients


def _check(window_length: object, polyorder: object, deriv: object, delta: object) -> tuple[int, int, int, float]:
    window_length = arguments.integer("window_length", window_length, 1)
    polyorder = arguments.integer("polyorder", polyorder, 0)
    deriv = arguments.integer("deriv", deriv, 0)
    if polyorder >= window_length:
        raise ValueError(f"polyorder must be less than window_length = {window_length}, got {polyorder}")
    step = arguments.real("delta", delta)
    if deriv and not (np.isfinite(step) and step != 0):
        raise ValueError(f"delta must be finite and not zero, got {step}")
    return window_length, polyorder, deriv, step if deriv else 1.0


def _plan(window_length: int, polyorder: int, deriv: int, step: float, position: float) -> Plan:
    return Plan(window_length, deriv, polyorder, 0.0, 0.0, abs(step), "exact", position=position)
