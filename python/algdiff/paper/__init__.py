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

from algdiff.paper._combination import combination, lambdas, tau1
from algdiff.paper._individual import (
    annihilator,
    annihilator_coefficients,
    annihilator_kernel,
    delay,
    lemma1,
    minimal,
    minimal_kernel,
)
from algdiff.paper._simultaneous import condition_number, simultaneous, simultaneous_kernel, simultaneous_matrices

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
