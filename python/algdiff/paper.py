r"""The source paper's own estimators, equation by equation.

M. Mboup, C. Join, M. Fliess, *A revised look at numerical differentiation with an application to nonlinear feedback
control*, 2007, section II. Use this module to reproduce or check the paper, and `algdiff.Differentiator` for work:
every estimator here is one of its kernels (``docs/theory.md`` 1), which it evaluates without the systems and sums that
cost digits.

Arguments have the paper's names: n is the order of the derivative, N the degree of the truncated Taylor expansion,
:math:`\kappa` and :math:`\mu` the exponents of the annihilator, :math:`\nu` the number of integrations, T the
estimation time and tau the point of the window in units of T.

=============  =====================================================================================================
(3) to (5)     `simultaneous`, `simultaneous_matrices`, `condition_number`, `simultaneous_kernel`
(6), (8)       `annihilator`, `annihilator_coefficients`, `annihilator_kernel`; N = 2 without delay: (14), (15)
(7), Lemma 1   `lemma1`
(9) to (11)    `minimal`, `minimal_kernel`
(13)           `delay`
(16), (17)     `combination`, `lambdas`, `tau1`; for every n and N, with the paper's N = 3
=============  =====================================================================================================

Functions of samples take whole windows, oldest sample first, and integrate by the trapezoidal rule as the paper does:
a window of L samples has T = (L - 1) delta. With ``window="forward"`` it is [t, t + T], with ``window="causal"``
[t - T, t], and what is estimated "at the origin" is estimated at t. For the second the paper replaces y(t + tau) by
-y(t - tau), which has the right sign for odd orders only; here it is y(t - tau), and the estimate of order i is
multiplied by (-1)^i. Then kappa belongs to the newest sample: it is the estimator with mu and kappa exchanged, at
1 - tau instead of tau.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from fractions import Fraction
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff import _core
from algdiff._kernel import Kernel
from algdiff._warnings import DesignWarning

__all__ = [
    "annihilator",
    "annihilator_coefficients",
    "annihilator_kernel",
    "combination",
    "condition_number",
    "delay",
    "lambdas",
    "lemma1",
    "minimal",
    "minimal_kernel",
    "simultaneous",
    "simultaneous_kernel",
    "simultaneous_matrices",
    "tau1",
]

_EPS = float(np.finfo(np.float64).eps)
_LARGEST_DEGREE = 500  # of a kernel
_LARGEST_EXPANSION = 500  # exact coefficients of this degree take seconds


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
        ``Q(tau)`` for `tau` of any shape S, in units of time from 0 to T, is an array of shape (N + 1, *S). It is zero
        outside of the window.

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
    order, degree = _order_and_degree(n, N)
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
    x, sign = _windows(y, degree, window)
    duration = (x.shape[-1] - 1) * _step(delta)
    with np.errstate(all="ignore"):
        units = duration ** -np.arange(degree + 1.0)
    if not (np.isfinite(units).all() and units.min() > 0):
        raise ValueError(f"delta must be such that T**{degree} neither overflows nor underflows, got {delta}")
    condition = system.condition_number()
    if condition > _EPS**-0.5:
        message = (
            f"P_nu has the condition number {condition:.1e}: solving (5) may cost {_digits(condition)} of 16 digits; "
            f"Kernel(n, {degree}, kappa=0, mu={_integrations(nu, degree) - degree - 2}, tau=0) is the same estimator "
            "without it"
        )
        warnings.warn(message, DesignWarning, stacklevel=2)
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


def annihilator_coefficients(
    n: SupportsIndex, N: SupportsIndex, kappa: SupportsIndex, mu: SupportsIndex
) -> list[Fraction]:
    r"""Return the kernel of (6) for T = 1 as an exact polynomial, from the operator itself.

    .. math::
        \frac{x^{(n)}(0)}{s^{\nu+n+\kappa+1}} = \frac{(-1)^{n+\kappa}}{(n+\kappa)!\,(N-n)!}\,\frac{1}{s^\nu}\,
        \frac{d^{n+\kappa}}{ds^{n+\kappa}}\,\frac{1}{s}\,\frac{d^{N-n}}{ds^{N-n}}\,(s^{N+1} \hat y),
        \qquad \nu = N+1+\mu,

    carried out in integers, term by term, with :math:`s^{-k} \hat y^{(m)}` in time being the integral of
    :math:`(1-\tau)^{k-1}/(k-1)!\,(-\tau)^m\,y(\tau)`. (6) is correct as printed. It equals `annihilator_kernel`, and is
    no way to evaluate it in floating point: use it to check.

    Parameters
    ----------
    n, N : int
        Order of the derivative and degree of the Taylor expansion, 0 <= n <= N.
    kappa, mu : int
        Exponents at the origin and at the other end of the window, at least 0. N + kappa + mu is at most 500.

    Returns
    -------
    list of Fraction, length N + kappa + mu + 1
        Coefficients of 1, tau, tau**2, ...

    Raises
    ------
    ValueError
        An argument is outside of what it may be.
    TypeError
        An argument is not an integer.

    Examples
    --------
    >>> from algdiff import paper
    >>> [int(c) for c in paper.annihilator_coefficients(1, 2, 0, 0)]
    [-36, 192, -180]
    """
    order, degree, kappa, mu = _integers(n, N, kappa, mu)
    terms = {0: (degree + 1, 1)}  # m: (power of s, factor) of y^(m); a derivative keeps every power with its m
    terms = _derivative(terms, degree - order)
    terms = {m: (power - 1, factor) for m, (power, factor) in terms.items()}
    terms = _derivative(terms, order + kappa)
    nu = degree + 1 + mu
    coefficients = [0] * (degree + kappa + mu + 1)
    for m, (power, factor) in terms.items():
        k = nu - power
        factor *= (-1) ** (order + kappa + m) * math.perm(nu + order + kappa, nu + order + kappa - k + 1)
        for i in range(k):
            coefficients[m + i] += (-1) ** i * math.comb(k - 1, i) * factor
    return [Fraction(c, math.factorial(order + kappa) * math.factorial(degree - order)) for c in coefficients]


def annihilator_kernel(n: SupportsIndex, N: SupportsIndex, kappa: float, mu: float) -> Kernel:
    r"""Return the kernel of the individual estimator (6) of :math:`x^{(n)}(0)`, for T = 1.

    The paper has integer exponents at least 0; the kernel takes any real ones above -1.

    Parameters
    ----------
    n, N : int
        Order of the derivative and degree of the Taylor expansion, 0 <= n <= N <= 500.
    kappa, mu : float
        Exponents at the origin and at the other end of the window.

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
    >>> paper.annihilator_kernel(1, 2, 0, 0)([0.0, 0.5, 1.0])
    array([-36.,  15., -24.])
    """
    return Kernel(*_order_and_degree(n, N), kappa, mu, 0.0)


def annihilator(
    y: ArrayLike,
    n: SupportsIndex,
    N: SupportsIndex,
    kappa: float,
    mu: float,
    delta: float = 1.0,
    window: str = "forward",
) -> Any:
    r"""Estimate :math:`x^{(n)}` at the origin by (6) to (8), independently of the other derivatives.

    With n = 1 and N = 2 it is the estimator without delay (14), (15). In the second line of (8) j runs to min(p + i,
    q), not to min(p, q - i), and in Lemma 1 l runs to N - n; see `lemma1`.

    Parameters
    ----------
    y : array_like, shape (..., L)
        The samples of one window each, oldest first, at least N + 1 and two of them. Computed in double precision.
    n, N : int
        Order of the derivative and degree of the Taylor expansion, 0 <= n <= N <= 500.
    kappa, mu : float
        Exponents at the origin and at the other end of the window, at least 0, integer or not.
    delta : float
        Sampling step, positive.
    window : {"forward", "causal"}
        [t, t + T], estimate at the oldest sample, or [t - T, t], at the newest, with the right sign for every n.

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

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import paper
    >>> t = np.linspace(0, 1, 2001)
    >>> round(float(paper.annihilator(t + t**2, 1, 2, 1, 1, delta=t[1], window="causal")), 3)
    3.0
    """
    order, degree = _order_and_degree(n, N)
    x, sign = _windows(y, degree, window)
    exponents = _sampled_exponent("kappa", kappa), _sampled_exponent("mu", mu)
    return sign**order * (x @ _weights(x.shape[-1], order, degree, exponents, _step(delta)))


def lemma1(
    n: SupportsIndex, N: SupportsIndex, kappa: SupportsIndex, mu: SupportsIndex
) -> list[tuple[int, int, Fraction]]:
    r"""Return the minimal estimators of (7) that make up (6), and their rational factors.

    .. math:: x_0^{(n)}(\kappa, \mu; N) = \sum_{l=0}^{N-n} \lambda_l\, x_0^{(n)}(\kappa + N - n - l, \mu + l)

    with the factors that follow from (8), whose :math:`a_{ij}` are correct. Corrected are two ranges: l runs to N - n,
    not to min(n + kappa, N - n), and j in (8) to min(p + i, q), not to min(p, q - i), where p = n + kappa and q = N -
    n. That a truncation at n is "appropriate", as the paper adds, does not follow.

    Parameters
    ----------
    n, N, kappa, mu : int
        As for `annihilator_coefficients`.

    Returns
    -------
    list of (kappa_l, mu_l, lambda_l), length N - n + 1
        Exponents and factor, a Fraction, of the estimators in order of l. `lambdas` at tau = 0 is the same.

    Raises
    ------
    ValueError
        An argument is outside of what it may be.
    TypeError
        An argument is not an integer.

    Examples
    --------
    >>> from algdiff import paper
    >>> for kappa_l, mu_l, factor in paper.lemma1(1, 3, 0, 0):
    ...     print(kappa_l, mu_l, factor)
    2 0 3
    1 1 -8
    0 2 6
    """
    order, degree, kappa, mu = _integers(n, N, kappa, mu)
    p, q = order + kappa, degree - order
    factors = [Fraction(0)] * (q + 1)
    for i in range(q + 1):
        for j in range(i, min(p + i, q) + 1):
            a = math.comb(q, i) * math.comb(p, j - i) * math.factorial(q + 1)
            factors[j] += Fraction(a, (q + 1 - i) * math.factorial(q - j))
    # Term j is s^(q-j) times the operator of the minimal estimator (kappa + q - j, mu + j); (6) scales each by its own.
    for j in range(q + 1):
        factors[j] *= Fraction((-1) ** (q - j) * math.factorial(p + q - j), math.factorial(p) * math.factorial(q))
    return [(kappa + q - j, mu + j, factor) for j, factor in enumerate(factors)]


def minimal_kernel(n: SupportsIndex, kappa: float, mu: float) -> Kernel:
    r"""Return the kernel of the minimal estimator, N = n, for T = 1: (9) to (11) for n = 1.

    Its `tau` is the point (13) at which it estimates best, see `delay`.

    Parameters
    ----------
    n : int
        Order of the derivative, from 0 to 500.
    kappa, mu : float
        Exponents at the origin and at the other end of the window, greater than -1.

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
    >>> k = paper.minimal_kernel(1, 0, 0)
    >>> k([0.0, 0.5, 1.0]), k.tau
    (array([-6.,  0.,  6.]), 0.5)
    """
    return Kernel(*_order_and_degree(n, n), kappa, mu, "root")


def minimal(
    y: ArrayLike, n: SupportsIndex, kappa: float, mu: float, delta: float = 1.0, window: str = "forward"
) -> Any:
    r"""Estimate :math:`x^{(n)}` by the minimal estimator, N = n: (9) to (11) for n = 1.

    The paper writes :math:`\tilde x_0` for an estimate of :math:`\dot x` in (9), (10) and (14) to (17): a dot is
    missing. It is the estimate at the origin only for polynomials of degree n; for others it belongs to the point of
    `delay`.

    Parameters
    ----------
    y : array_like, shape (..., L)
        The samples of one window each, oldest first, at least n + 1 and two of them. Computed in double precision.
    n : int
        Order of the derivative, from 0 to 500.
    kappa, mu, delta, window
        As for `annihilator`.

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

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import paper
    >>> t = np.linspace(0, 1, 2001)
    >>> round(float(paper.minimal(t**2, 1, 2, 2, delta=t[1])), 3), 2 * paper.delay(2, 2)
    (1.0, 1.0)
    """
    return annihilator(y, n, n, kappa, mu, delta, window)


def delay(kappa: float, mu: float, n: SupportsIndex = 1) -> float:
    r"""Return the delay (13) of the minimal estimator, as a part of T, for any n.

    .. math:: \tau_0 = \frac{\kappa + n + 1}{\kappa + \mu + 2n + 2},

    the root of :math:`P_1^{\kappa,\mu}`. The estimate belongs to t + tau_0 T of a forward and to t - tau_0 T of a
    causal window: there it is exact for polynomials of degree n + 1.

    Parameters
    ----------
    kappa, mu : float
        Exponents at the origin and at the other end of the window, greater than -1.
    n : int
        Order of the derivative, from 0 to 500.

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
    >>> paper.delay(0, 2)
    0.3333333333333333
    """
    kernel = minimal_kernel(n, kappa, mu)
    return (kernel.kappa + kernel.deriv + 1) / (kernel.kappa + kernel.mu + 2 * kernel.deriv + 2)


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
    order, degree = _order_and_degree(n, N)
    exponents = arguments.real("kappa", kappa), arguments.real("mu", mu)
    points = _points("tau", tau)
    count = degree - order + 1
    values = np.empty(points.size * count)
    _core.lambdas(order, degree, exponents, arguments.contiguous(points), values)
    return values.reshape(*points.shape, count)


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
    order, degree = _order_and_degree(n, N)
    x, _ = _windows(y, degree, "forward")
    kappa, mu = _sampled_exponent("kappa", kappa), _sampled_exponent("mu", mu)
    point, step = arguments.real("tau", tau), _step(delta)
    factors = lambdas(order, degree, kappa, mu, point)
    growth = float(np.abs(factors).sum())
    if growth > _EPS**-0.5:
        message = (
            f"the absolute values of lambdas add up to {growth:.1e}: {_digits(growth)} of 16 digits may cancel; "
            f"Kernel({order}, degree={degree}, kappa={kappa}, mu={mu}, tau={point}) is the same estimator without it"
        )
        warnings.warn(message, DesignWarning, stacklevel=2)
    weights = np.zeros(x.shape[-1])
    for j, factor in enumerate(factors):
        weights += factor * _weights(x.shape[-1], order, order, (kappa + degree - order - j, mu + j), step)
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
    backwards = _backwards(window)
    return float(Kernel(*_order_and_degree(n, N), kappa, mu).roots[-1 if backwards else 0])


def _derivative(terms: dict[int, tuple[int, int]], times: int) -> dict[int, tuple[int, int]]:
    """Return the derivative by s of the sum of ``factor * s**power * y^(m)``, given as ``{m: (power, factor)}``.

    From one term on, every m keeps one power: that of m + 1 is larger by one.
    """
    for _ in range(times):
        result: dict[int, tuple[int, int]] = {}
        for m, (power, factor) in terms.items():
            for place, exponent, share in ((m, power - 1, power * factor), (m + 1, power, factor)):
                result[place] = exponent, result.get(place, (exponent, 0))[1] + share
        terms = result
    return terms


def _order_and_degree(n: object, N: object) -> tuple[int, int]:
    order, degree = arguments.integer("n", n, 0), arguments.integer("N", N, 0)
    if degree > _LARGEST_DEGREE:
        raise ValueError(f"N must be at most {_LARGEST_DEGREE}, got {degree}")
    if degree < order:
        raise ValueError(f"N must be at least n = {order}, got {degree}")
    return order, degree


def _integers(n: object, N: object, kappa: object, mu: object) -> tuple[int, int, int, int]:
    """Return the arguments of (6) as the paper has them, small enough for exact results."""
    order, degree = _order_and_degree(n, N)
    left, right = arguments.integer("kappa", kappa, 0), arguments.integer("mu", mu, 0)
    if degree + left + right > _LARGEST_EXPANSION:
        raise ValueError(f"N + kappa + mu must be at most {_LARGEST_EXPANSION}, got {degree + left + right}")
    return order, degree, left, right


def _integrations(nu: object, degree: int) -> int:
    number = arguments.integer("nu", nu, 0)
    if number < degree + 2:
        raise ValueError(f"nu must be at least N + 2 = {degree + 2}, got {number}")
    return number


def _system(N: object, nu: object, T: object) -> tuple[int, _core.Simultaneous]:
    degree = arguments.integer("N", N, 0)
    return degree, _core.Simultaneous(degree, _integrations(nu, degree), arguments.real("T", T))


def _right_side(system: _core.Simultaneous, degree: int, tau: ArrayLike) -> NDArray[np.float64]:
    points = _points("tau", tau)
    values = np.empty((degree + 1) * points.size)
    system.right_side(arguments.contiguous(points), values)
    return values.reshape(degree + 1, *points.shape)


def _points(name: str, values: ArrayLike) -> NDArray[np.float64]:
    points = np.asarray(values)
    if points.dtype.kind not in "fiu":
        raise TypeError(f"{name} must be real numbers, got dtype {points.dtype}")
    return points.astype(np.float64, copy=False)


def _backwards(window: object) -> bool:
    if not isinstance(window, str):
        raise TypeError(f"window must be 'forward' or 'causal', got {window!r}")
    if window not in ("forward", "causal"):
        raise ValueError(f"window must be 'forward' or 'causal', got {window!r}")
    return window == "causal"


def _windows(y: ArrayLike, degree: int, window: str) -> tuple[NDArray[Any], int]:
    """Return the samples from the origin on, in double precision, and the sign of odd derivatives there."""
    backwards = _backwards(window)
    x = arguments.samples("y", y)
    least = max(degree + 1, 2)
    if x.shape[-1] < least:
        raise ValueError(f"y must have at least {least} samples along its last axis, got {x.shape[-1]}")
    x = x.astype(np.complex128 if x.dtype.kind == "c" else np.float64, copy=False)
    return (x[..., ::-1], -1) if backwards else (x, 1)


def _step(delta: object) -> float:
    step = arguments.real("delta", delta)
    if not 0 < step < math.inf:
        raise ValueError(f"delta must be finite and positive, got {step}")
    return step


def _sampled_exponent(name: str, value: object) -> float:
    exponent = arguments.real(name, value)
    if not exponent >= 0:
        raise ValueError(
            f"{name} must be at least 0 for the trapezoidal rule, which samples the ends of the window "
            f"(algdiff.Differentiator with rule='exact' takes exponents above -1), got {exponent}"
        )
    return exponent


def _weights(length: int, n: int, N: int, exponents: tuple[float, float], delta: float) -> NDArray[np.float64]:
    """Return the weights of the individual estimator at the origin by the trapezoidal rule."""
    plan = _core.Plan(length, n, N, *exponents, delta, "trapezoid", tau=0.0)
    weights = np.empty(length)
    plan.weights(weights)
    return weights


def _digits(growth: float) -> str:
    return f"{min(math.log10(growth), 16):.0f}"
