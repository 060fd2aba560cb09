"""The library against 60-digit golden values, within the tolerances of golden/README.md."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest

import algdiff
import reference
from support import Array, Case, case_id, golden, kernel_rule

SIGNALS: dict[str, Callable[[Array], Array]] = {
    "exp(-t)*sin(3t)": lambda t: np.exp(-t) * np.sin(3 * t),
    "tanh(t-1)+exp(-t/1.2)*sin(6t+pi)": lambda t: np.tanh(t - 1) + np.exp(-t / 1.2) * np.sin(6 * t + np.pi),
    "7-3t+2t^2-t^3/2+t^4/8": np.polynomial.Polynomial([7, -3, 2, -1 / 2, 1 / 8]),
}


def kernel_of(case: Case) -> algdiff.Kernel:
    return algdiff.Kernel(case["n"], case["N"], case["kappa"], case["mu"], case["tau1"])


def design_of(case: Case, length: int, rule: str, duration: float) -> algdiff.Differentiator:
    return algdiff.Differentiator(
        length,
        case["n"],
        degree=case["N"],
        kappa=case["kappa"],
        mu=case["mu"],
        tau=case["tau1"],
        delta=duration / (length if rule in reference.CELLS else length - 1),
        rule=rule,
    )


@pytest.mark.parametrize("case", golden("kernels.json"), ids=case_id)
def test_kernel_values(case: Case) -> None:
    expected = np.array([np.nan if value is None else value for value in case["k"]])
    values = kernel_of(case)(case["tau"])
    regular = ~np.isnan(expected)
    np.testing.assert_allclose(values[regular], expected[regular], rtol=0, atol=1e-13 * np.abs(expected[regular]).max())
    assert np.isinf(values[~regular]).all()


@pytest.mark.parametrize("case", golden("kernels.json"), ids=case_id)
def test_kernel_analysis(case: Case) -> None:
    kernel = kernel_of(case)
    assert (kernel.exactness, kernel.bias_order) == (case["exact_degree"], case["bias_order"])
    assert kernel.bias_constant == pytest.approx(case["bias_constant"], rel=1e-12, abs=0)
    expected = np.inf if case["k_norm2"] is None else case["k_norm2"]
    assert kernel.norm2 == pytest.approx(expected, rel=1e-12, abs=0)


@pytest.mark.parametrize("case", golden("roots.json"), ids=case_id)
def test_roots(case: Case) -> None:
    kernel = algdiff.Kernel(case["n"], case["n"] + case["q"], case["kappa"], case["mu"], "root")
    np.testing.assert_allclose(kernel.roots, case["roots"], rtol=0, atol=1e-14)
    assert kernel.tau == pytest.approx(case["roots"][-1], abs=1e-14)
    minimal = algdiff.Kernel(case["n"], case["n"], case["kappa"], case["mu"], "root")
    assert minimal.tau == pytest.approx(case["tau0"], abs=1e-14)


@pytest.mark.parametrize("case", golden("frequency.json"), ids=case_id)
def test_frequency_response(case: Case) -> None:
    kernel = kernel_of(case)
    omega_t = np.array(case["omegaT"])
    expected = np.array(case["H_re"]) + 1j * np.array(case["H_im"])
    error = np.abs(kernel.frequency_response(omega_t, reference=0) - expected)
    assert (error <= 1e-11 * omega_t ** case["n"]).all(), error
    magnitude = np.abs(np.abs(kernel.frequency_response(omega_t)) - case["H_abs"])
    assert (magnitude <= 1e-11 * omega_t ** case["n"]).all(), magnitude


@pytest.mark.parametrize("case", golden("frequency.json"), ids=case_id)
def test_asymptotes(case: Case) -> None:
    kernel = kernel_of(case)
    constants = [case["A0"], case["A1"]]  # 1e-58 is a zero of the other one's size
    np.testing.assert_allclose(kernel.asymptote_constants, constants, rtol=1e-12, atol=1e-12 * max(constants))
    assert kernel.roll_off == case["slope"]
    if case["cutoff_omegaT"] is None:
        assert kernel.cutoff is None
    else:
        assert kernel.cutoff == pytest.approx(case["cutoff_omegaT"], rel=1e-12, abs=0)


@pytest.mark.parametrize("case", golden("discrete.json"), ids=case_id)
@pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")
def test_weights(case: Case) -> None:
    length, rule = case["L"], case["method"]
    design = design_of(case, length, rule, 1.0)  # T = 1 makes the golden weights ours
    expected = np.array(case["w"])
    np.testing.assert_allclose(design.weights, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert design.duration == pytest.approx(1, rel=1e-15)
    assert design.noise_gain == pytest.approx(case["sum_w2"], rel=2e-12 * length)
    if rule == "exact":
        assert design.exactness == case["exact_degree_used"]


@pytest.mark.parametrize("case", golden("signals.json"), ids=lambda case: f"{case['id']}-{case['signal']}-{case['t0']}")
def test_signals(case: Case) -> None:
    signal, start, duration = SIGNALS[case["signal"]], case["t0"], case["T"]
    points, masses = kernel_rule(kernel_of(case))
    y = signal(start + duration * points)
    atol = 1e-12 * np.abs(masses).sum() * np.abs(y).max() / duration ** case["n"]
    assert masses @ y / duration ** case["n"] == pytest.approx(case["estimate"], rel=0, abs=atol)
    assert start + duration * kernel_of(case).tau == pytest.approx(case["estimate_time"], rel=1e-15)
    for discrete in case["discrete"]:
        length, rule = discrete["L"], discrete["method"]
        places = (np.arange(length) + 0.5) / length if rule == "exact" else np.arange(length) / (length - 1)
        samples = signal(start + duration * places)
        design = design_of(case, length, rule, duration)
        atol = 1e-12 * np.abs(design.weights).sum() * np.abs(samples).max()
        (estimate,) = design(samples, mode="valid")
        assert estimate == pytest.approx(discrete["estimate"], rel=0, abs=atol)
        newest = start + duration * places[-1]
        assert newest - design.delay == pytest.approx(case["estimate_time"], rel=1e-15 * length)


@pytest.mark.parametrize("case", golden("tstar.json"), ids=case_id)
def test_optimal_duration(case: Case) -> None:
    kernel, numbers = kernel_of(case), (case["sigma"], case["Mderiv"], case["Ts"])
    assert kernel.deriv + kernel.bias_order == case["deriv_order"]
    duration = kernel.optimal_duration(*numbers)
    assert duration == pytest.approx(case["T_star"], rel=1e-12, abs=0)
    assert kernel.rmse(duration, *numbers) == pytest.approx(case["rms_at_T_star"], rel=1e-12, abs=0)


@pytest.mark.parametrize("case", golden("savgol.json"), ids=case_id)
def test_savgol(case: Case) -> None:
    expected = np.array([float(Fraction(w)) for w in case["w_exact"]])
    weights = algdiff.savgol_coeffs(case["L"], case["N"], case["n"], pos=case["pos"], use="dot")
    np.testing.assert_allclose(weights, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    design = algdiff.Differentiator(
        case["L"], case["n"], degree=case["N"], kappa=0, mu=0, delay=float(case["L"] - 1 - case["pos"])
    )
    np.testing.assert_allclose(design.weights, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    assert design.tau == pytest.approx(case["tau1_cells"], abs=1e-15)
