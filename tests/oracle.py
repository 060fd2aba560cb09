"""Formulas of the theory in 50 digits, for what float64 cannot judge: stop bands and high frequencies."""

from __future__ import annotations

from mpmath import mp, mpc, mpf

Design = tuple[int, int, float, float, float]
DIGITS = 50


def jacobi(degree: int, alpha: mpf, beta: mpf, x: mpf) -> mpf:
    """Return the standard Jacobi polynomial P_degree^(alpha, beta)(x) as its finite sum of products of powers."""
    low, high = (x - 1) / 2, (x + 1) / 2
    terms = (
        mp.binomial(degree + alpha, degree - s) * mp.binomial(degree + beta, s) * low**s * high ** (degree - s)
        for s in range(degree + 1)
    )
    return mp.fsum(terms)


def low_pass(omega_t: float, design: Design) -> mpc:
    """Return G(i omega T) with phase reference 0, formula (F1) of theory section 6."""
    with mp.workdps(DIGITS):
        deriv, degree, tau = design[0], design[1], mpf(design[4])
        a, b, z = mpf(design[2]) + deriv, mpf(design[3]) + deriv, mpc(0, omega_t)
        total = mpc(0)
        for i in range(degree - deriv + 1):
            factor = jacobi(i, b, a, 2 * tau - 1) * z**i / mp.rf(a + b + i + 1, i)
            total += factor * mp.hyp1f1(a + i + 1, a + b + 2 * i + 2, z)
        return total


def frequency_response(omega_t: float, design: Design, origin: float | None = None) -> complex:
    """Return H T^n with the phase reference `origin`, by default tau."""
    with mp.workdps(DIGITS):
        shift = mpf(design[4] if origin is None else origin)
        return complex(mpc(0, omega_t) ** design[0] * low_pass(omega_t, design) * mp.expj(-mpf(omega_t) * shift))


def half_power(near: float, design: Design) -> float:
    """Return the omega T next to `near` where |G| = 1/sqrt(2)."""
    with mp.workdps(DIGITS):
        return float(
            mp.findroot(lambda w: abs(low_pass(w, design)) ** 2 - mpf(1) / 2, (near, near * (1 + mpf(10) ** -6)))
        )


def log_asymptote_constants(design: Design) -> tuple[float, float]:
    """Return ln A0 and ln A1 of theory section 6, R_q by the sum of standard Jacobi polynomials over their norms."""
    with mp.workdps(DIGITS):
        deriv, degree, tau = design[0], design[1], mpf(design[4])
        a, b = mpf(design[2]) + deriv, mpf(design[3]) + deriv
        logs = []
        for end, exponent in ((0, a), (1, b)):
            total = mpf(0)
            for i in range(degree - deriv + 1):
                norm = mp.gamma(i + b + 1) * mp.gamma(i + a + 1)
                gamma = mp.gamma(i + a + b + 1) * (2 * i + a + b + 1) if i else mp.gamma(a + b + 2)
                norm /= mp.factorial(i) * gamma
                total += jacobi(i, b, a, 2 * tau - 1) * jacobi(i, b, a, mpf(2 * end - 1)) / norm
            logs.append(float(mp.log(mp.gamma(exponent + 1) * abs(total))))
        return logs[0], logs[1]
