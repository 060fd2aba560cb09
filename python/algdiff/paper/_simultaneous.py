"""Equations (3) to (5): all derivatives from one system."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff import _core
from algdiff._kernel import Kernel
from algdiff._warnings import DesignWarning, outside
from algdiff.paper._arguments import EPS, digits, order_and_degree, step_of, windows


def simultaneous_matrices(
    N: SupportsIndex, nu: SupportsIndex, T: float = 1.0
) -> tuple[NDArray[np.float64], Callable[[ArrayLike], NDArray[np.float64]]]:
    r"""Return both sides of equation (5), :math:`P_\nu(T)\,x = \int_0^T Q_\nu(\tau)\,y(\tau)\,d\tau`.

    .. math::
        P_{ij} = \frac{(N-j)!}{(N-i-j)!}\,\frac{T^{\nu-N+i+j-1}}{(\nu-N+i+j-1)!}, \qquad
        Q_i(\tau) = \sum_{l=0}^{i} \binom{i}{l} \frac{(N+1)!}{(N+1-l)!}\,(-1)^{i-l}\,
                    \frac{(T-\tau)^{\nu-N-2+l}\,\tau^{i-l}}{(\nu-N-2+l)!}

    The paper has :math:`\nu-N-2-l` twice in Q, which holds for no polynomial from row 1 on. It calls P triangular; it
    is zero below its other diagonal, i + j = N.

    Parameters
    ----------
    N : int
        Degree of the Taylor expansion, from 0 to 500.
    nu : int
        Number of integrations, at least N + 2.
    T : float
        Estimation time, positive.

    Returns
    -------
    P : ndarray of float64, shape (N + 1, N + 1)
        Column j belongs to the derivative of order j at the origin.
    Q : callable
        ``Q(tau)`` for `tau` of any shape S, in units of time from 0 to T, is an array of shape ``(N + 1, *S)``. It is
        zero outside of the window.

    Raises
    ------
    ValueError
        An argument is outside of what it may be, or entries of P or Q would overflow or underflow.
    TypeError
        An argument is of the wrong type.

    Examples
    --------
    >>> from algdiff import paper
    >>> P, Q = paper.simultaneous_matrices(1, 3)
    >>> P
    array([[1. , 0.5],
           [0.5, 0. ]])
    >>> Q([0.0, 0.5, 1.0])
    array([[ 1. ,  1. ,  1. ],
           [ 2. ,  0.5, -1. ]])
    """
    degree, system = _system(N, nu, T)

    def right_side(tau: ArrayLike) -> NDArray[np.float64]:
        """Return Q at `tau`."""
        return _right_side(system, degree, tau)

    return system.matrix().reshape(degree + 1, degree + 1), right_side


def condition_number(N: SupportsIndex, nu: SupportsIndex, T: float = 1.0) -> float:
    r"""Return the condition number of :math:`P_\nu(T)` in (5): the ill-conditioning of section II.B.

    It is the ratio of the largest to the smallest singular value. The relative error of the solution of (5) may be this
    many times that of its right side. Much of it is the unit of time, because derivatives of different orders are
    unknowns of one system: it grows as T falls, and falls to N! as T grows. T = 1 is the window itself as unit.

    The paper concludes that the estimators are sensitive to noise. They are not more so than individual ones of the
    same N, which are the same estimators (see `simultaneous_kernel`): what is lost is digits, not signal.

    Parameters
    ----------
    N, nu, T
        As for `simultaneous_matrices`.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        An argument is outside of what it may be, or the result would not be finite.
    TypeError
        An argument is of the wrong type.

    Examples
    --------
    >>> from algdiff import paper
    >>> [f"{paper.condition_number(N, N + 2):.1e}" for N in (1, 2, 4, 8)]
    ['5.8e+00', '6.9e+01', '3.5e+04', '1.5e+11']
    >>> f"{paper.condition_number(4, 6, 0.1):.1e}"
    '8.6e+11'
    """
    return _system(N, nu, T)[1].condition_number()


def simultaneous_kernel(n: SupportsIndex, N: SupportsIndex, nu: SupportsIndex) -> Kernel:
    r"""Return the kernel of the derivative of order n in (5): row n of :math:`P_\nu^{-1} Q_\nu`, for T = 1.

    It is the individual estimator (6) with :math:`\kappa = 0` and :math:`\mu = \nu - N - 2`, evaluated without a
    system.

    Parameters
    ----------
    n : int
        Order of the derivative, from 0 to N.
    N, nu : int
        As for `simultaneous_matrices`.

    Returns
    -------
    Kernel

    Raises
    ------
    ValueError
        An argument is outside of what it may be.
    TypeError
        An argument is of the wrong type.

    Examples
    --------
    >>> from algdiff import paper
    >>> paper.simultaneous_kernel(1, 2, 4)
    Kernel(deriv=1, degree=2, kappa=0.0, mu=0.0, tau=0.0)
    """
    order, degree = order_and_degree(n, N)
    return Kernel(order, degree, 0.0, float(_integrations(nu, degree) - degree - 2), 0.0)


def simultaneous(
    y: ArrayLike, N: SupportsIndex, nu: SupportsIndex, delta: float = 1.0, window: str = "forward"
) -> NDArray[Any]:
    r"""Estimate x, x', ..., :math:`x^{(N)}` at the origin by solving (5), the linear system of (3) and (4).

    Use `simultaneous_kernel` or `algdiff.Differentiator` for results; this is the system as the paper poses it. It is
    solved with the window as unit of time (T = 1), so that no digit depends on the unit of `delta`.

    Parameters
    ----------
    y : array_like, shape (..., L)
        The samples of one window each, oldest first, at least N + 1 and two of them. Computed in double precision.
    N, nu : int
        As for `simultaneous_matrices`.
    delta : float
        Sampling step, positive.
    window : {"forward", "causal"}
        [t, t + T], estimates at the oldest sample, or [t - T, t], at the newest. The paper's rule for the second,
        -y(t - tau) for y(t + tau), gives the wrong sign for even orders; here it is right for all of them.

    Returns
    -------
    ndarray of float64 or complex128, shape (..., N + 1)
        Element i estimates the derivative of order i, in the unit of `y` over that of ``delta**i``. They are off by the
        error of the trapezoidal rule even for polynomials, the less the more samples.

    Raises
    ------
    ValueError
        `y` has too few samples, or another argument is outside of what it may be.
    TypeError
        `y` does not hold numbers, or another argument is of the wrong type.

    Warns
    -----
    DesignWarning
        The condition number for T = 1 exceeds 6.7e7 (``eps**-0.5``): more than half of the digits may be lost.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import paper
    >>> t = np.linspace(0, 1, 2001)
    >>> paper.simultaneous(1 + 2 * t + 3 * t**2, 2, 4, delta=t[1]).round(3)
    array([1., 2., 6.])
    >>> paper.simultaneous(1 + 2 * t + 3 * t**2, 2, 4, delta=t[1], window="causal").round(3)
    array([6., 8., 6.])
    """
    degree, system = _system(N, nu, 1.0)
    x, sign = windows(y, degree, window)
    duration = (x.shape[-1] - 1) * step_of(delta)
    with np.errstate(all="ignore"):
        units = duration ** -np.arange(degree + 1.0)
    if not (np.isfinite(units).all() and units.min() > 0):
        raise ValueError(f"delta must be such that T**{degree} neither overflows nor underflows, got {delta}")
    condition = system.condition_number()
    if condition > EPS**-0.5:
        message = (
            f"P_nu has the condition number {condition:.1e}: solving (5) may cost {digits(condition)} of 16 digits; "
            f"Kernel(n, {degree}, kappa=0, mu={_integrations(nu, degree) - degree - 2}, tau=0) is the same estimator "
            "without it"
        )
        warnings.warn(message, DesignWarning, stacklevel=outside())
    shares = np.full(x.shape[-1], 1 / (x.shape[-1] - 1))
    shares[[0, -1]] /= 2
    integrals = x @ (shares * _right_side(system, degree, np.linspace(0, 1, x.shape[-1]))).T
    matrix = system.matrix().reshape(degree + 1, degree + 1)
    estimates = np.empty_like(integrals)
    for j in range(degree + 1):  # row N - j holds the unknowns 0 to j
        row = degree - j
        estimates[..., j] = (integrals[..., row] - estimates[..., :j] @ matrix[row, :j]) / matrix[row, j]
    estimates *= sign ** np.arange(degree + 1) * units
    return estimates


def _system(N: object, nu: object, T: object) -> tuple[int, _core.Simultaneous]:
    degree = arguments.integer("N", N, 0)
    return degree, _core.Simultaneous(degree, _integrations(nu, degree), arguments.real("T", T))


def _right_side(system: _core.Simultaneous, degree: int, tau: ArrayLike) -> NDArray[np.float64]:
    points, shape = arguments.points("tau", tau)
    values = np.empty((degree + 1) * points.size)
    system.right_side(points, values)
    return values.reshape(degree + 1, *shape)


def _integrations(nu: object, degree: int) -> int:
    number = arguments.integer("nu", nu, 0)
    if number < degree + 2:
        raise ValueError(f"nu must be at least N + 2 = {degree + 2}, got {number}")
    return number
