"""Weights in 60 digits, by the moments that they must have: what `reference.py` and the library are measured with.

The kernel is rho times the polynomial of degree N whose integrals with tau^m are the derivatives of tau^m at tau_1
(theory section 1), and the weights of the exact rule are those of such a polynomial on the samples (8.1): systems of
Hankel matrices, which cost half of the digits.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from mpmath import mp, mpf

import oracle
import reference

DIGITS = 60


def root(deriv: int, degree: int, kappa: float, mu: float, near: float) -> Any:
    """Return the root of p_{q+1}^[a,b] next to a point."""
    a, b = mpf(kappa) + deriv, mpf(mu) + deriv
    return mp.findroot(lambda tau: oracle.jacobi(degree - deriv + 1, b, a, 2 * tau - 1), mpf(near))


def powers(deriv: int, degree: int, tau: Any) -> Any:
    """Return the derivatives of tau^m, m = 0..degree."""
    return mp.matrix([mp.ff(m, deriv) * tau ** (m - deriv) if m >= deriv else mpf(0) for m in range(degree + 1)])


def value(coefficients: list[Any], at: Any) -> Any:
    """Return a polynomial's value."""
    return mp.fsum(c * at**m for m, c in enumerate(coefficients))


def base_weight(length: int, j: int, exponent: Any) -> Any:
    """Return u_e(j) of theory section 8.1."""
    if exponent >= 0:
        return ((j + mpf(1) / 2) / length) ** exponent
    e = exponent + 1
    return (mpf(j + 1) ** e - mpf(j) ** e) / e / mpf(length) ** exponent


def fitted(length: int, deriv: int, degree: int, kappa: Any, mu: Any, tau: Any) -> list[Any]:
    """Return the weights of the discrete weighted fit for T = 1."""
    s = [(j + mpf(1) / 2) / length for j in range(length)]
    w = [base_weight(length, j, kappa) * base_weight(length, length - 1 - j, mu) for j in range(length)]
    moments = [mp.fsum(a * b**m for a, b in zip(w, s, strict=True)) for m in range(2 * degree + 1)]
    gram = mp.matrix([[moments[i + k] for k in range(degree + 1)] for i in range(degree + 1)])
    c = mp.lu_solve(gram, powers(deriv, degree, tau))
    return [a * value(list(c), b) for a, b in zip(w, s, strict=True)]


def polynomial(deriv: int, degree: int, kappa: Any, mu: Any, tau: Any) -> list[Any]:
    """Return the coefficients of the polynomial by which tau^kappa (1 - tau)^mu is multiplied in the kernel."""
    moments = [mp.beta(kappa + 1 + m, mu + 1) for m in range(2 * degree + 1)]
    gram = mp.matrix([[moments[i + k] for k in range(degree + 1)] for i in range(degree + 1)])
    return list(mp.lu_solve(gram, powers(deriv, degree, tau)))


def integral(low: Any, high: Any, coefficients: list[Any], kappa: Any, mu: Any) -> Any:
    """Return the integral of tau^kappa (1 - tau)^mu times a polynomial."""
    return mp.fsum(c * mp.betainc(kappa + 1 + m, mu + 1, low, high) for m, c in enumerate(coefficients))


def weights(
    length: int, deriv: int, degree: int, kappa: float, mu: float, tau: float | str, rule: str = "exact"
) -> npt.NDArray[Any]:
    """Return the weights of a rule for T = 1, of which tau is a word or a number, as numbers of 60 digits."""
    with mp.workdps(DIGITS):
        near, is_root = reference.resolve_tau(length, deriv, degree, kappa, mu, tau, rule)
        cells = rule in reference.CELLS
        exact = {"center": mpf(1) / 2, "newest": 1 - mpf(cells) / (2 * length), "root": None}
        at = mpf(near) if not isinstance(tau, str) else exact[tau]
        at = root(deriv, degree, kappa, mu, near) if at is None else at
        k, m = mpf(kappa), mpf(mu)
        if rule == "exact":
            used = min(degree + int(is_root), max(degree, length - 1))
            return np.array(fitted(length, deriv, used, k, m, at), object)
        c, count = polynomial(deriv, degree, k, m, at), length - (not cells)
        if rule in ("cell", "hat"):
            edges = [mpf(j) / count for j in range(count + 1)]
            pieces = list(pairwise(edges))
            whole = [integral(a, b, c, k, m) for a, b in pieces]
            if rule == "cell":
                return np.array(whole, object)
            first = [integral(a, b, [mpf(0), *c], k, m) for a, b in pieces]
            rising = [count * f - j * w for j, (f, w) in enumerate(zip(first, whole, strict=True))]
            falling = [w - r for w, r in zip(whole, rising, strict=True)]
            return np.array([a + b for a, b in zip([*falling, mpf(0)], [mpf(0), *rising], strict=True)], object)
        factors = {"trapezoid": [mpf(1) / 2, mpf(1), mpf(1)], "simpson": [mpf(1) / 3, mpf(4) / 3, mpf(2) / 3]}
        found = []
        for j in range(length):
            s = (j + mpf(1) / 2) / length if cells else mpf(j) / (length - 1)
            share = factors.get(rule, [mpf(1)] * 3)[0 if j in (0, length - 1) else 1 if j % 2 else 2]
            found.append(share / count * s**k * (1 - s) ** m * value(c, s))
        return np.array(found, object)
