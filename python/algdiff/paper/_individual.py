"""Equations (6) to (13): one derivative at a time."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any, SupportsIndex

from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff._kernel import Kernel
from algdiff.paper._arguments import order_and_degree, sampled_exponent, step_of, trapezoid_weights, windows

_LARGEST_EXPANSION = 500  # exact coefficients of this degree take seconds


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
    return Kernel(*order_and_degree(n, N), kappa, mu, 0.0)


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
    order, degree = order_and_degree(n, N)
    x, sign = windows(y, degree, window)
    exponents = sampled_exponent("kappa", kappa), sampled_exponent("mu", mu)
    return sign**order * (x @ trapezoid_weights(x.shape[-1], order, degree, exponents, step_of(delta)))


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
    return Kernel(*order_and_degree(n, n), kappa, mu, "root")


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


def _integers(n: object, N: object, kappa: object, mu: object) -> tuple[int, int, int, int]:
    """Return the arguments of (6) as the paper has them, small enough for exact results."""
    order, degree = order_and_degree(n, N)
    left, right = arguments.integer("kappa", kappa, 0), arguments.integer("mu", mu, 0)
    if degree + left + right > _LARGEST_EXPANSION:
        raise ValueError(f"N + kappa + mu must be at most {_LARGEST_EXPANSION}, got {degree + left + right}")
    return order, degree, left, right
