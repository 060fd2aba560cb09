"""The AlgDiff toolbox (PyPI `algdiff` 2.4) and this library say the same of the same differentiators.

The toolbox numbers the exponents by the end of the kernel that they shape and not by the weight: alpha = mu + deriv,
beta = kappa + deriv, its N = degree - deriv, its theta = 2 tau - 1, and its time t is the lag T (1 - tau) from the
newest end (theory section 0). What it said is recorded in golden/toolbox.json, by toolbox.py; test_toolbox_again.py
has it said again.

Left out: the cutoff and the low-pass model for alpha = beta where both of its signed asymptote constants are negative,
for it takes the larger without the absolute value (one case of the grid, tested to be so); get_stepResponse for N >= 1,
which evaluates the polynomials with the exponents of their derivatives and differs from its own integral of the kernel
(tested to be so); and the Newton-Cotes rules, "euler" and reported delays of discrete filters, which are wrong (see
docs/algdiff-toolbox.md).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import algdiff
import reference_analysis as analysis
from support import EPS, Case, design, golden

CASES = golden("toolbox.json")
RULES = {"mid-point": "midpoint", "trapezoidal": "trapezoid", "analytic": "cell", "analytic trapezoidal": "hat"}


def toolbox_id(case: Case) -> str:
    return "-".join(f"{case[key]:.3g}" for key in ("alpha", "beta", "N", "theta"))


on_all_cases = pytest.mark.parametrize("case", CASES, ids=toolbox_id)


def options(case: Case, order: int) -> dict[str, Any]:
    """Return our words for the toolbox's differentiator of that order."""
    tau = "root" if case["N"] == 0 else (1 + case["theta"]) / 2  # N = 0: theta is not used, the delay is that of a root
    return {"degree": case["N"] + order, "kappa": case["beta"] - order, "mu": case["alpha"] - order, "tau": tau}


def kernel_of(case: Case, order: int) -> algdiff.Kernel:
    return algdiff.Kernel(order, **options(case, order))


def orders(case: Case) -> list[int]:
    return [int(order) for order in case["kernel"]]


def recorded(values: Any) -> Any:
    return np.array(values, dtype=np.float64)


@on_all_cases
def test_kernels_and_their_derivatives(case: Case) -> None:
    lag = recorded(case["t"])
    for order in orders(case):
        expected = recorded(case["kernel"][str(order)])
        ours = kernel_of(case, order).impulse_response(lag / case["T"]) / case["T"] ** (order + 1)
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@on_all_cases
def test_step_responses(case: Case) -> None:
    expected, lag = recorded(case["integral"]), recorded(case["t"]) / case["T"]
    np.testing.assert_allclose(kernel_of(case, 0).step_response(lag), expected, rtol=0, atol=1e-10)
    miss = np.abs(recorded(case["step"]) - expected).max()  # get_stepResponse has it wrong by this from N = 1 on
    assert miss < 1e-10 if case["N"] == 0 else miss > 1e-3
    for order in orders(case)[1:]:  # the step response of order n is the impulse response of order n - 1
        expected = recorded(case["kernel"][str(order - 1)])
        ours = kernel_of(case, order).step_response(lag) / case["T"] ** order
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@on_all_cases
def test_amplitudes_and_phases(case: Case) -> None:
    omega = recorded(case["omega"])
    expected = recorded(case["amplitude"]) * np.exp(1j * recorded(case["phase"]))
    for order in orders(case):
        response = kernel_of(case, order).frequency_response(omega * case["T"], reference=1)
        ours = response / (1j * omega * case["T"]) ** order  # phase against the newest end: t is the lag
        np.testing.assert_allclose(ours, expected, rtol=1e-9, atol=1e-12)


@on_all_cases
def test_asymptotes_and_cutoff(case: Case) -> None:
    omega_t = recorded(case["omega"]) * case["T"]
    for order in orders(case):
        kernel = kernel_of(case, order)
        ours = kernel.asymptotes(omega_t)
        upper = recorded(case["upper"]) * omega_t**order
        np.testing.assert_allclose(ours.upper, upper, rtol=1e-10)
        assert (np.abs(ours.lower - recorded(case["lower"]) * omega_t**order) <= 1e-10 * upper).all()
        assert kernel.roll_off == min(case["alpha"], case["beta"]) + 1
        if case["cutoff"] is None:  # no absolute value: the root of a negative number
            assert case["alpha"] == case["beta"]
            assert case["low_pass"][0] < 0
            assert kernel.cutoff == pytest.approx(analysis.cutoff((order, *options(case, order).values())), rel=1e-12)
            continue
        assert kernel.cutoff == pytest.approx(case["cutoff"] * case["T"], rel=1e-10)
        np.testing.assert_allclose(ours.low_pass, recorded(case["low_pass"]) * omega_t**order, rtol=1e-9)


@on_all_cases
def test_delays_and_degrees_of_exactness(case: Case) -> None:
    for order in orders(case):
        kernel = kernel_of(case, order)
        assert (1 - kernel.tau) * case["T"] == pytest.approx(case["delay"], rel=0, abs=1e-10)
        assert kernel.moment_delay * case["T"] == pytest.approx(case["delay"], rel=0, abs=1e-10)
        assert kernel.exactness == case["exactness"][str(order)]


@on_all_cases
def test_attenuation_at_the_nyquist_frequency(case: Case) -> None:
    if case["cutoff"] is None:
        return
    for order, ratio in zip(orders(case), case["attenuation"], strict=True):
        ours = algdiff.Differentiator.from_duration(case["T"], order, delta=case["ts"], **options(case, order))
        assert ours.duration == case["T"]
        assert ours.nyquist_attenuation == pytest.approx(-ratio, abs=1e-8)


@on_all_cases
def test_discrete_filters(case: Case) -> None:
    steps = round(case["T"] / case["ts"])
    for method, by_order in case["weights"].items():
        for order, values in by_order.items():
            length = steps + (RULES[method] in ("trapezoid", "hat"))
            ours = design(length, int(order), delta=case["ts"], rule=RULES[method], **options(case, int(order)))
            expected = recorded(values)[::-1]  # its first weight is that of the newest sample
            # Its differences and nested integrals cancel against terms that are 1/ts times as large.
            atol = 1e-10 * np.abs(expected).max() + 64 * EPS * steps**2 * ours.norm1
            np.testing.assert_allclose(ours.weights, expected, rtol=0, atol=atol, err_msg=method)


def test_it_leaks_a_constant_and_the_exact_rule_does_not() -> None:
    case = next(case for case in CASES if case["theta"] == 1 and case["alpha"] == case["beta"])
    leak = abs(sum(case["weights"]["mid-point"]["1"]))
    ours = algdiff.Differentiator.from_duration(case["T"], 1, delta=case["ts"], **options(case, 1))
    assert leak > 1e-3
    assert abs(ours.weights.sum()) <= 64 * EPS * ours.norm1


def compare(said: Any, expected: Any, scale: float = 0.0) -> None:
    """Check that both hold the same, numbers to 1e-12 of the largest of their list."""
    if isinstance(expected, dict):
        assert said.keys() == expected.keys()
        for key in expected:
            compare(said[key], expected[key])
    elif isinstance(expected, list):
        assert len(said) == len(expected)
        largest = max((abs(value) for value in expected if value is not None), default=0.0)
        for one, other in zip(said, expected, strict=True):
            compare(one, other, largest)
    elif expected is None:
        assert said is None
    else:
        assert said == pytest.approx(expected, rel=1e-12, abs=1e-12 * scale)
