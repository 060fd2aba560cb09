"""Equations (14) to (17): other points of the window, as combinations of minimal estimators."""

from __future__ import annotations

import warnings
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff import _core
from algdiff._kernel import Kernel
from algdiff._warnings import DesignWarning, outside
from algdiff.paper._arguments import (
    EPS,
    digits,
    is_causal,
    order_and_degree,
    sampled_exponent,
    step_of,
    trapezoid_weights,
    windows,
)


def lambdas(n: SupportsIndex, N: SupportsIndex, kappa: float, mu: float, tau: ArrayLike = 0.0) -> NDArray[np.float64]:
    r"""Return the coefficients of (16), (17) and of N = 3, for any n, N, real exponents and tau.

    .. math:: x_\tau^{(n)}(\kappa, \mu; N) = \sum_{l=0}^{N-n} \lambda_l\, x_0^{(n)}(\kappa + N - n - l, \mu + l)

    The order is that of (7) and of the paper's N = 3. (16) counts the other way: its :math:`\lambda_0`, which
    multiplies :math:`(\kappa, \mu + 1)`, is :math:`\lambda_1` here.

    Parameters
    ----------
    n, N : int
        Order of the derivative and degree of the Taylor expansion, 0 <= n <= N <= 500.
    kappa, mu : float
        Exponents at 0 and at 1, greater than -1.
    tau : array_like of float
        Points of the window, 0 the oldest and 1 the newest sample; beyond them is prediction.

    Returns
    -------
    ndarray of float64, shape (..., N - n + 1)
        For each element of `tau`. The sum over l is 1. Errors are some 1e-15 of the sum of absolute values.

    Raises
    ------
    ValueError
        An argument is outside of what it may be, or the coefficients would overflow.
    TypeError
        An argument is of the wrong type.

    Examples
    --------
    >>> from algdiff import paper
    >>> paper.lambdas(1, 2, 0, 0, 0.0)
    array([-2.,  3.])
    >>> paper.lambdas(1, 3, 0, 0, 0.5)
    array([-0.75,  2.5 , -0.75])
    """
    order, degree = order_and_degree(n, N)
    exponents = arguments.real("kappa", kappa), arguments.real("mu", mu)
    points, shape = arguments.points("tau", tau)
    count = degree - order + 1
    values = np.empty(points.size * count)
    _core.lambdas(order, degree, exponents, points, values)
    return values.reshape(*shape, count)


def combination(
    y: ArrayLike, n: SupportsIndex, N: SupportsIndex, kappa: float, mu: float, tau: float, delta: float = 1.0
) -> Any:
    r"""Estimate :math:`x^{(n)}` at the point `tau` of the window as a sum of minimal estimators: (16), (17), N = 3.

    `tau` is counted from the oldest sample, for windows on either side of t alike, as the paper does with
    :math:`\tau_1`: the estimate belongs to t + tau T of the window [t, t + T], and to t - (1 - tau) T of [t - T, t]. So
    nothing is reversed, no sign changes and there is no argument `window`. See `tau1` for the points of least delay.

    Parameters
    ----------
    y : array_like, shape (..., L)
        The samples of one window each, oldest first, at least N + 1 and two of them. Computed in double precision.
    n, N : int
        Order of the derivative and degree of the Taylor expansion, 0 <= n <= N <= 500.
    kappa, mu : float
        Exponents at the oldest and at the newest sample, at least 0, integer or not.
    tau : float
        Point of the window, 0 the oldest and 1 the newest sample; beyond them is prediction.
    delta : float
        Sampling step, positive.

    Returns
    -------
    float, complex or ndarray of float64 or complex128, shape (...)
        In the unit of `y` over that of ``delta**n``.

    Raises
    ------
    ValueError
        `y` has too few samples, or another argument is outside of what it may be.
    TypeError
        `y` does not hold numbers, or another argument is of the wrong type.

    Warns
    -----
    DesignWarning
        The absolute values of `lambdas` add up to more than 6.7e7 (``eps**-0.5``): half of the digits may cancel.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import paper
    >>> t = np.linspace(0, 1, 2001)
    >>> tau = paper.tau1(1, 2, 0, 0, window="causal")
    >>> round(float(paper.combination(t**3, 1, 2, 0, 0, tau, delta=t[1])), 3), round(3 * tau**2, 3)
    (1.571, 1.571)
    """
    order, degree = order_and_degree(n, N)
    x, _ = windows(y, degree, "forward")
    kappa, mu = sampled_exponent("kappa", kappa), sampled_exponent("mu", mu)
    point, step = arguments.real("tau", tau), step_of(delta)
    factors = lambdas(order, degree, kappa, mu, point)
    growth = float(np.abs(factors).sum())
    if growth > EPS**-0.5:
        message = (
            f"the absolute values of lambdas add up to {growth:.1e}: {digits(growth)} of 16 digits may cancel; "
            f"Kernel({order}, degree={degree}, kappa={kappa}, mu={mu}, tau={point}) is the same estimator without it"
        )
        warnings.warn(message, DesignWarning, stacklevel=outside())
    weights = np.zeros(x.shape[-1])
    for j, factor in enumerate(factors):
        weights += factor * trapezoid_weights(x.shape[-1], order, order, (kappa + degree - order - j, mu + j), step)
    return x @ weights


def tau1(n: SupportsIndex, N: SupportsIndex, kappa: float, mu: float, window: str = "forward") -> float:
    r"""Return the point of least delay at which one more degree is exact: :math:`\tau_1` of (17), for any n and N.

    It is a root of the orthogonal polynomial of degree N - n + 1 with the weight
    :math:`\tau^{\kappa+n} (1-\tau)^{\mu+n}`, which the paper calls :math:`P_{N-n+1}^{\kappa,\mu}` for n = 1; all of its
    roots are ``Kernel(n, N, kappa, mu).roots``. For N = n it is :math:`\tau_0` of (13).

    Parameters
    ----------
    n, N, kappa, mu
        As for `lambdas`.
    window : {"forward", "causal"}
        The smallest root, with the delay tau_1 T to the oldest sample, or the largest, with the delay (1 - tau_1) T to
        the newest.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        An argument is outside of what it may be.
    TypeError
        An argument is of the wrong type.

    Examples
    --------
    >>> from algdiff import paper
    >>> [round(paper.tau1(1, 2, 0, 0, window), 4) for window in ("forward", "causal")]
    [0.2764, 0.7236]
    """
    backwards = is_causal(window)
    return float(Kernel(*order_and_degree(n, N), kappa, mu).roots[-1 if backwards else 0])
