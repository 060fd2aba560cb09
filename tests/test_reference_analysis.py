"""The twin's analysis against 60-digit golden values, 50-digit formulas and the numbers of theory section 6."""

from __future__ import annotations

import math

import numpy as np
import pytest

import oracle
import reference
import reference_analysis as analysis
from reference_analysis import Design
from support import EPS, Case, case_id, golden

DESIGNS: list[Design] = [
    (1, 1, 0.0, 0.0, 0.5),
    (0, 2, -0.5, 2.5, 1.2),
    (1, 2, -0.9, 0.3, 0.0),
    (2, 5, 1.0, 0.0, 1.0),
    (3, 3, 2.0, 1.0, 0.4),
    (1, 3, 50.0, 50.0, 0.5),
    (2, 4, 50.0, 3.0, 0.9),
    (0, 1, 300.0, 300.0, 0.5),
]


def design_of(case: Case) -> Design:
    return case["n"], case["N"], case["kappa"], case["mu"], case["tau1"]


@pytest.mark.parametrize("case", golden("frequency.json"), ids=case_id)
def test_response_and_asymptotes_match_golden(case: Case) -> None:
    design, omega_t = design_of(case), np.array(case["omegaT"])
    expected = np.array(case["H_re"]) + 1j * np.array(case["H_im"])
    ours = analysis.frequency_response(omega_t, design, 0.0)
    assert (np.abs(ours - expected) <= 1e-12 * omega_t ** case["n"]).all()
    exact = np.array([oracle.frequency_response(w, design, 0.0) for w in omega_t])
    assert (np.abs(exact - expected) <= 4 * EPS * np.abs(expected)).all()
    for logs in (analysis.log_asymptote_constants(design), oracle.log_asymptote_constants(design)):
        largest = max(case["A0"], case["A1"])
        np.testing.assert_allclose(np.exp(logs), [case["A0"], case["A1"]], rtol=1e-12, atol=1e-12 * largest)
    corner = analysis.cutoff(design)
    if case["cutoff_omegaT"] is None:
        assert corner is None
    else:
        assert corner == pytest.approx(case["cutoff_omegaT"], rel=1e-13, abs=0)


@pytest.mark.parametrize("design", DESIGNS)
def test_response_in_the_pass_band_and_shortly_above(design: Design) -> None:
    omega_t = np.array([1e-6, 1e-3, 0.1, 1.0, 10.0, 30.0, 100.0])
    expected = np.array([oracle.frequency_response(w, design) for w in omega_t])
    nodes, gauss = reference.gauss_rule(200, design[2] + design[0], design[3] + design[0])
    terms = gauss @ np.abs(analysis.christoffel(design, nodes))  # what the sum of G adds up
    error = np.abs(analysis.frequency_response(omega_t, design) - expected)
    assert (error <= 64 * EPS * (terms + 1) * (1 + omega_t) * omega_t ** design[0]).all()  # exp(i omega T s) turns s


# (deriv, degree, kappa = mu, tau), the cutoff of the low-pass model and the true half power, theory section 6
HALF_POWER = [
    ((1, 1, 0.0, 0.0, 0.5), 2.449, 3.630),
    ((1, 1, 2.0, 2.0, 0.5), 5.384, 4.915),
    ((1, 1, 5.0, 5.0, 0.5), 9.795, 6.382),
    ((1, 2, 0.0, 0.0, (5 + math.sqrt(5)) / 10), 4.406, 6.358),
    ((1, 2, 0.0, 0.0, 1.0), 6.000, 9.043),
    ((1, 3, 0.0, 0.0, 0.5), 3.873, 7.842),
    ((2, 3, 1.0, 1.0, 1.0), 9.573, 12.58),
]


@pytest.mark.parametrize(("design", "corner", "half"), HALF_POWER)
def test_cutoff_and_half_power_of_the_theory(design: Design, corner: float, half: float) -> None:
    assert analysis.cutoff(design) == pytest.approx(corner, rel=2e-4)
    ours = analysis.half_power(design)
    assert ours == pytest.approx(half, rel=4e-4)
    assert ours == pytest.approx(oracle.half_power(ours, design), rel=1e-14)


NORM1 = [
    ((1, 1, 0.0, 0.0, 0.5), 3.0),
    ((1, 1, 2.0, 2.0, 0.5), 4.375),
    ((1, 2, 0.0, 0.0, 1.0), 11.78),
    ((1, 2, 0.0, 0.0, (5 + math.sqrt(5)) / 10), 5.69),
    ((1, 3, 0.0, 0.0, 0.5), 7.77),
    ((2, 3, 1.0, 1.0, 2 / 3), 65.6),
    ((2, 3, 1.0, 1.0, 1.0), 183.0),
    ((3, 4, 1.0, 1.0, 1.0), 2941.0),
]


@pytest.mark.parametrize(("design", "expected"), NORM1)
def test_norm1_of_the_theory(design: Design, expected: float) -> None:
    assert analysis.norm1(design) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("design", DESIGNS)
def test_the_step_response_is_the_impulse_response_of_one_order_less(design: Design) -> None:
    deriv, degree, kappa, mu, tau = design
    gain = analysis.norm1(design)
    atol = 1e-13 * gain + 4 * EPS * math.lgamma(kappa + mu + 2)  # what ln B cancels
    assert analysis.step_response(1.0, design) == pytest.approx(float(deriv == 0), abs=atol)
    if deriv:  # k = (-1)^n d^n {rho R_q} is minus the derivative of the kernel of order n - 1 with the same a and b
        smoother = (deriv - 1, degree - 1, kappa + 1, mu + 1, tau)
        for t in (0.05, 0.3, 0.5, 0.81, 1.0):
            expected = analysis.impulse_response(t, smoother)[0]
            assert analysis.step_response(t, design) == pytest.approx(expected, abs=1e-12 * gain)


@pytest.mark.parametrize("design", DESIGNS)
def test_moment_delay_of_the_twin(design: Design) -> None:
    deriv, degree, kappa, mu, tau = design
    a, b = kappa + deriv, mu + deriv
    expected = 1 - tau if degree > deriv else (b + 1) / (a + b + 2)
    assert analysis.moment_delay(design) == pytest.approx(expected, abs=1e-12 * (1 + analysis.norm1(design)))


@pytest.mark.parametrize("case", golden("tstar.json"), ids=case_id)
def test_optimal_duration_matches_golden(case: Case) -> None:
    numbers = (case["sigma"], case["Mderiv"], case["Ts"])
    duration = analysis.optimal_duration(*numbers, design_of(case))
    assert duration == pytest.approx(case["T_star"], rel=1e-12)
    assert analysis.rmse(duration, *numbers, design_of(case)) == pytest.approx(case["rms_at_T_star"], rel=1e-12)
