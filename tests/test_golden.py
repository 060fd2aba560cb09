"""The library against 60-digit golden values, within the tolerances of golden/README.md."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import algdiff
from support import Case, case_id, golden

DISCRETE = [case for case in golden("discrete.json") if case["method"] in ("exact", "trapezoid")]


def kernel_of(case: Case) -> algdiff.Kernel:
    return algdiff.Kernel(case["n"], case["N"], case["kappa"], case["mu"], case["tau1"])


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


@pytest.mark.parametrize("case", DISCRETE, ids=case_id)
@pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")
def test_weights(case: Case) -> None:
    length, rule = case["L"], case["method"]
    # T = 1 makes the golden weights ours.
    delta = 1 / length if rule == "exact" else 1 / (length - 1)
    design = algdiff.Differentiator(
        length,
        case["n"],
        degree=case["N"],
        kappa=case["kappa"],
        mu=case["mu"],
        tau=case["tau1"],
        delta=delta,
        rule=rule,
    )
    expected = np.array(case["w"])
    np.testing.assert_allclose(design.weights, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert design.noise_gain == pytest.approx(case["sum_w2"], rel=2e-12 * length)
    if rule == "exact":
        assert design.exactness == case["exact_degree_used"]


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
