"""The naive twin `reference.py` against 60-digit golden values, exact polynomials and SciPy.

Golden tolerances are those of golden/README.md. Every other bound is derived where it stands, in units of
EPS = 2^-52, from two facts (Higham, Accuracy and Stability of Numerical Algorithms, sections 3.1 and 19.3):
a dot product of L terms errs by at most L EPS sum|w| max|x|, and Householder QR of an L by E+1 matrix is exact for a
matrix L (E+1) EPS away, which spoils the polynomials that the weights reproduce by as much times sum|w| max|x|.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy.signal import savgol_filter

import reference
from support import EPS, Array, Case, case_id, golden

KERNELS = golden("kernels.json")
ROOTS = golden("roots.json")
DISCRETE = golden("discrete.json")
SAVGOL = golden("savgol.json")


def kernel_parameters(case: Case) -> tuple[int, int, float, float, float]:
    """Return (deriv, degree, kappa, mu, tau) of a golden case."""
    return case["n"], case["N"], case["kappa"], case["mu"], case["tau1"]


def error_bound(window_length: int, fit_degree: int, w: Array, x: Array) -> float:
    """Return L (E+2) EPS sum|w| max|x|: QR and dot product together, see the top of this file."""
    return float(window_length * (fit_degree + 2) * EPS * np.abs(w).sum() * np.abs(x).max())


def polynomial(degree: int, deriv: int, t: Array) -> Array:
    """Return the deriv-th derivative of a full polynomial with integer coefficients; exact for small dyadic t."""
    return np.asarray(np.polynomial.Polynomial([7, -3, 2, -1, 1, 1][: degree + 1]).deriv(deriv)(t), dtype=np.float64)


# golden values


def test_golden_files_are_complete() -> None:
    assert (len(KERNELS), len(ROOTS), len(DISCRETE), len(SAVGOL)) == (65, 80, 86, 6)


@pytest.mark.parametrize("case", KERNELS, ids=case_id)
def test_kernel_matches_golden(case: Case) -> None:
    k = reference.kernel(case["tau"], *kernel_parameters(case))
    expected = np.array(case["k"], dtype=np.float64)  # null becomes NaN
    singular = np.isnan(expected)
    assert np.max(np.abs(k - expected)[~singular]) <= 1e-13 * np.max(np.abs(expected[~singular]))
    # Within 2^-40 of the end the polynomial factor has the sign it has at the end itself.
    beside = reference.kernel(np.clip(case["tau"], 2.0**-40, 1 - 2.0**-40), *kernel_parameters(case))
    np.testing.assert_array_equal(k[singular], np.copysign(np.inf, beside[singular]))


@pytest.mark.parametrize("case", KERNELS, ids=case_id)
def test_kernel_gains_match_golden(case: Case) -> None:
    constant, order = reference.bias(*kernel_parameters(case))
    assert reference.kernel_exactness(*kernel_parameters(case)) == case["exact_degree"]
    assert order == case["bias_order"]
    assert constant == pytest.approx(case["bias_constant"], rel=1e-12, abs=0)
    expected = np.inf if case["k_norm2"] is None else case["k_norm2"]
    assert reference.norm2(*kernel_parameters(case)) == pytest.approx(expected, rel=1e-12, abs=0)


def test_kernel_is_zero_outside_the_window() -> None:
    assert not reference.kernel([-1.0, -1e-9, 1 + 1e-9, 2.0], 1, 2, -0.5, 0.5, "root").any()


@pytest.mark.parametrize("case", ROOTS, ids=case_id)
def test_roots_match_golden(case: Case) -> None:
    n, q, kappa, mu = case["n"], case["q"], case["kappa"], case["mu"]
    diagonal, off = reference.jacobi_coefficients(kappa + n, mu + n, q + 1)
    np.testing.assert_allclose(reference.roots(n, n + q, kappa, mu), case["roots"], rtol=0, atol=1e-14)
    np.testing.assert_allclose(reference.roots(n, n, kappa, mu), [case["tau0"]], rtol=0, atol=1e-14)
    np.testing.assert_allclose(diagonal, case["jacobi_diag"], rtol=0, atol=1e-14)
    np.testing.assert_allclose(off[:-1], case["jacobi_offdiag"], rtol=0, atol=1e-14)
    tau, is_root = reference.resolve_tau(None, n, n + q, kappa, mu, "root")
    assert is_root
    assert tau == pytest.approx(case["roots"][-1], rel=0, abs=1e-14)


@pytest.mark.parametrize("case", DISCRETE, ids=case_id)
def test_weights_match_golden(case: Case) -> None:
    rule, length = case["method"], case["L"]
    step = 1 / length if rule in reference.CELLS else 1 / (length - 1)  # a window of duration 1
    w = reference.weights(length, *kernel_parameters(case), rule, step)
    expected = np.array(case["w"])
    assert np.max(np.abs(w - expected)) <= 1e-12 * np.max(np.abs(expected))
    assert w @ w == pytest.approx(case["sum_w2"], rel=2e-12 * length, abs=0)  # 1e-12 of max|w| in each of L squares


@pytest.mark.parametrize("case", SAVGOL, ids=case_id)
def test_weights_match_exact_savitzky_golay(case: Case) -> None:
    w = reference.weights(case["L"], case["n"], case["N"], 0.0, 0.0, case["tau1_cells"])
    expected = np.array([float(Fraction(text)) for text in case["w_exact"]])
    assert np.max(np.abs(w - expected)) <= 1e-13 * np.max(np.abs(expected))


# the bookkeeping of tau and delay


def test_resolve_tau_words_numbers_and_roots() -> None:
    root = reference.roots(1, 2, 1.0, 1.0)[-1]
    resolve = reference.resolve_tau
    assert resolve(10, 1, 2, 1.0, 1.0, "root") == (root, True)
    assert resolve(10, 1, 2, 1.0, 1.0, root + 0.9e-12) == (root, True)
    assert resolve(10, 1, 2, 1.0, 1.0, root + 1.1e-12) == (root + 1.1e-12, False)
    assert resolve(10, 1, 2, 1.0, 1.0, "center") == (0.5, False)  # q odd
    assert resolve(10, 1, 3, 1.0, 1.0, "center") == (0.5, True)  # q even
    assert resolve(10, 1, 2, 1.0, 1.0, "newest") == (0.95, False)
    assert resolve(10, 1, 2, 1.0, 1.0, "newest", "trapezoid") == (1.0, False)
    assert resolve(None, 1, 2, 1.0, 1.0, "newest") == (1.0, False)


@pytest.mark.parametrize("rule", ["exact", "trapezoid"])
def test_delay_is_zero_at_newest_and_half_the_span_at_center(rule: str) -> None:
    newest, _ = reference.resolve_tau(16, 1, 2, 0.0, 0.0, "newest", rule)
    assert reference.delay_samples(16, newest, rule) == 0
    assert reference.delay_samples(16, 0.5, rule) == 7.5


# polynomials


@pytest.mark.parametrize("tau", ["center", "root", "newest", 0.3, 1.2, -0.1])
@pytest.mark.parametrize("window_length", [8, 11])
@pytest.mark.parametrize(("deriv", "degree"), [(0, 2), (1, 2), (1, 3), (2, 4)])
@pytest.mark.parametrize(("kappa", "mu"), [(0.0, 0.0), (1.0, 1.0), (-0.5, 2.5)])
def test_fit_reproduces_polynomials_at_every_sample(
    tau: float | str, window_length: int, deriv: int, degree: int, kappa: float, mu: float
) -> None:
    delta = 0.25
    t = delta * np.arange(-10.0, 14.0)  # dyadic, so x and its derivatives carry no rounding of their own
    x = polynomial(degree, deriv=0, t=t)
    out = reference.differentiate(x, window_length, deriv, degree=degree, kappa=kappa, mu=mu, tau=tau, delta=delta)
    value, _ = reference.resolve_tau(window_length, deriv, degree, kappa, mu, tau)
    c = int(np.floor(value * window_length + 1e-9))  # the sample that tau lies in, or moves to
    places = [tau, *((j + 0.5) / window_length for j in range(min(0, c), max(window_length - 1, c) + 1))]
    all_weights = [reference.weights(window_length, deriv, degree, kappa, mu, p, "exact", delta) for p in places]
    loudest = max(all_weights, key=lambda w: float(np.abs(w).sum()))
    assert np.max(np.abs(out - polynomial(degree, deriv, t))) <= error_bound(window_length, degree + 1, loudest, x)


@pytest.mark.parametrize("tau", ["center", "root", "newest", 0.3, 1.2])
@pytest.mark.parametrize("window_length", [8, 11])
@pytest.mark.parametrize("degree", [2, 3])
def test_valid_reproduces_polynomials_at_the_stated_delay(tau: float | str, window_length: int, degree: int) -> None:
    kappa, mu, delta = 1.0, 0.5, 0.5
    t = delta * np.arange(-10.0, 14.0)
    value, is_root = reference.resolve_tau(window_length, 1, degree, kappa, mu, tau)
    exactness = degree + int(is_root)  # a root is worth one degree
    x = polynomial(exactness, deriv=0, t=t)
    out = reference.differentiate(
        x, window_length, degree=degree, kappa=kappa, mu=mu, tau=tau, delta=delta, mode="valid"
    )
    at = t[window_length - 1 :] - reference.delay_samples(window_length, value) * delta
    w = reference.weights(window_length, 1, degree, kappa, mu, tau, "exact", delta)
    slope = polynomial(exactness, 1, at)
    # `at` and the slope there are rounded: Horner in at most 5 steps on terms below their sum at the largest |t|.
    size = float(np.abs(np.polynomial.Polynomial([7, -3, 2, -1, 1][: exactness + 1]).deriv().coef).sum())
    rounding = 10 * EPS * size * float(np.abs(t).max()) ** (exactness - 1)
    assert np.max(np.abs(out - slope)) <= error_bound(window_length, exactness, w, x) + rounding


def test_trapezoid_reproduces_the_slope_error_of_the_theory() -> None:
    # Theory section 8.2: kappa = mu = 0, n = q = 1: sum(w) = 30 (2 tau - 1)/M^2 for T = 1, M = L - 1.
    for length in (5, 11, 61):
        w = reference.weights(length, 1, 2, 0.0, 0.0, 1.0, "trapezoid", 1 / (length - 1))
        assert abs(w.sum() - 30 / (length - 1) ** 2) <= error_bound(length, 2, w, np.ones(1))


# samples, ends, offsets, shapes


@pytest.mark.parametrize("rule", ["exact", "trapezoid"])
@pytest.mark.parametrize("tau", ["center", "root", "newest", 0.3, 1.4, -0.4])
@pytest.mark.parametrize("window_length", [9, 10])  # 10: the centre lies at 4.5 and goes up to 5, not to even
def test_every_mode_agrees_where_the_window_lies_inside(rule: str, tau: float | str, window_length: int) -> None:
    x = np.random.default_rng(1).standard_normal(40)
    fit = reference.differentiate(x, window_length, 1, degree=2, tau=tau, rule=rule, mode="fit")
    nan = reference.differentiate(x, window_length, 1, degree=2, tau=tau, rule=rule, mode="nan")
    inside = np.isfinite(nan)
    assert np.isfinite(fit).all()
    value, _ = reference.resolve_tau(window_length, 1, 2, 1.0, 1.0, tau, rule)
    c = window_length - 1 - reference.delay_samples(window_length, value, rule)
    start, stop = (round(c + 1e-9), round(c + 1e-9) + 40 - window_length + 1)  # 1e-9: a half goes up, not to even
    expected = np.arange(40)[max(start, 0) : min(stop, 40)]
    np.testing.assert_array_equal(np.flatnonzero(inside), expected)
    for mode in ("nearest", "mirror", "wrap", "constant"):
        padded = reference.differentiate(x, window_length, 1, degree=2, tau=tau, rule=rule, mode=mode, cval=3.0)
        np.testing.assert_array_equal(padded[inside], nan[inside])
    np.testing.assert_array_equal(fit[inside], nan[inside])


@pytest.mark.parametrize("tau", ["center", "newest", 0.3, 1.1])
def test_valid_equals_the_interior_when_tau_is_a_sample(tau: float | str) -> None:
    window_length = 5  # 0.3 is sample 1, 1.1 is sample 5, one after the newest
    x = np.random.default_rng(2).standard_normal(20)
    nan = reference.differentiate(x, window_length, 1, degree=2, tau=tau, mode="nan")
    valid = reference.differentiate(x, window_length, 1, degree=2, tau=tau, mode="valid")
    inside = np.isfinite(nan)
    np.testing.assert_array_equal(nan[inside], valid[: np.count_nonzero(inside)])


def test_only_the_interior_takes_the_degree_of_a_root() -> None:
    # kappa = 1, mu = 3, n = N = 1: the root is (kappa+2)/(kappa+mu+4) = 3/8, sample 4 of 12, and in the interior there.
    # For tau "newest" sample 4 is at the old end of the data: the first window is evaluated at 3/8 with degree N.
    x = np.random.default_rng(6).standard_normal(20)
    design = (12, 1, 1, 1.0, 3.0)
    interior, edge = reference.weights(*design, "root"), reference.weights(*design, "root", fit_degree=1)
    bound = error_bound(12, 2, interior, x)
    assert abs((interior - edge) @ x[:12]) > 1e9 * bound  # else this test could not fail
    for tau, w in (("root", interior), ("newest", edge)):
        out = reference.differentiate(x, 12, degree=1, kappa=1.0, mu=3.0, tau=tau)
        assert abs(out[4] - w @ x[:12]) <= bound


@pytest.mark.parametrize("mode", ["fit", "valid", "nan", "nearest", "mirror", "wrap"])
def test_an_offset_changes_no_bit(mode: str) -> None:
    x = np.random.default_rng(3).integers(-100, 100, 30).astype(np.float64)  # x + 2^40 is exact
    plain = reference.differentiate(x, 8, 1, tau="root", mode=mode)
    np.testing.assert_array_equal(reference.differentiate(x + 2.0**40, 8, 1, tau="root", mode=mode), plain)
    assert not np.nan_to_num(reference.differentiate(np.full(30, 1e300), 8, 2, mode=mode)).any()


def test_axis_and_complex_are_real_rows() -> None:
    rng = np.random.default_rng(4)
    z = rng.standard_normal((3, 12, 2)) + 1j * rng.standard_normal((3, 12, 2))
    out = reference.differentiate(z, 5, axis=1, mode="constant", cval=2 - 1j)
    assert out.shape == z.shape
    for i, j in np.ndindex(3, 2):
        for part, cval in (("real", 2.0), ("imag", -1.0)):
            row = reference.differentiate(getattr(z[i, :, j], part), 5, mode="constant", cval=cval)
            np.testing.assert_array_equal(getattr(out[i, :, j], part), row)


@pytest.mark.parametrize("mode", ["fit", "valid", "nan"])
def test_too_few_samples_are_refused(mode: str) -> None:
    with pytest.raises(ValueError, match="too few samples"):
        reference.differentiate(np.zeros(6), 7, mode=mode)


def test_impossible_designs_are_refused() -> None:
    with pytest.raises(ValueError, match="too short for a fit of degree 3"):
        reference.weights(3, 1, 3, 1.0, 1.0, "center")
    with pytest.raises(ValueError, match="kappa, mu >= 0"):
        reference.weights(9, 1, 3, -0.5, 1.0, "center", "trapezoid")
    with pytest.raises(ValueError, match="rule='boxcar'"):
        reference.weights(9, 1, 3, 1.0, 1.0, "center", "boxcar")
    with pytest.raises(ValueError, match="mode='interp'"):
        reference.differentiate(np.zeros(9), 5, mode="interp")


# SciPy


@pytest.mark.parametrize(("mode", "scipy_mode"), [("fit", "interp"), *((m, m) for m in reference.PAD_MODES)])
@pytest.mark.parametrize("n", [4, 11, 30])
@pytest.mark.parametrize(("window_length", "deriv", "degree"), [(5, 0, 2), (7, 1, 2), (9, 1, 3), (11, 2, 4)])
def test_savgol_filter_is_the_case_kappa_mu_zero(
    mode: str, scipy_mode: str, n: int, window_length: int, deriv: int, degree: int
) -> None:
    if mode == "fit":
        n = max(n, window_length)
    delta, cval = 0.1, 3.0
    x = np.random.default_rng(5).standard_normal(n)
    mine = reference.differentiate(
        x, window_length, deriv, degree=degree, kappa=0.0, mu=0.0, delta=delta, mode=mode, cval=cval
    )
    theirs = savgol_filter(x, window_length, degree, deriv, delta, mode=scipy_mode, cval=cval)
    # SciPy fits in monomials of the sample number, so its weights err by the condition of that basis (columns scaled
    # to norm 1, as polyfit does at the ends) times what an orthonormal basis would: the twin needs no such factor.
    basis = np.vander(np.arange(window_length, dtype=np.float64), degree + 1)
    condition = float(np.linalg.cond(basis / np.linalg.norm(basis, axis=0)))
    places = [(j + 0.5) / window_length for j in ([window_length // 2] if mode != "fit" else range(window_length))]
    all_weights = [reference.weights(window_length, deriv, degree, 0.0, 0.0, p, "exact", delta) for p in places]
    loudest = max(all_weights, key=lambda w: float(np.abs(w).sum()))
    bound = (1 + condition) * error_bound(window_length, degree, loudest, np.append(x, cval))
    assert np.max(np.abs(mine - theirs)) <= bound
