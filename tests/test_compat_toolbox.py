"""The class of `algdiff.compat` against the AlgDiff toolbox (PyPI `algdiff` 2.4), method by method.

toolbox_methods.py asks both the same; what the toolbox said is recorded in golden/toolbox_methods.json, and
test_toolbox_again.py has it said again. Where the toolbox is wrong its row asserts how.
"""

from __future__ import annotations

import copy
import json
import pickle
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import algdiff
import toolbox_methods as toolbox
from algdiff.compat import AlgebraicDifferentiator
from support import GOLDEN

RECORDED = json.loads((GOLDEN / "toolbox_methods.json").read_text(encoding="utf-8"))
NAMES = sorted(toolbox.CALLS)
quiet = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")


def made(**options: Any) -> AlgebraicDifferentiator:
    return AlgebraicDifferentiator(**{"display": False, **options})


def agree(ours: Any, said: Any, rtol: float = 1e-10, scale: float = 0.0) -> None:
    """Check that both say the same, numbers to `rtol` of the largest of their list: the toolbox's terms cancel."""
    if isinstance(said, dict):
        assert ours.keys() == said.keys()
        for key, value in said.items():
            agree(ours[key], value, rtol)
    elif isinstance(said, list):
        assert len(ours) == len(said)
        largest = max((abs(one) for one in said if isinstance(one, (int, float))), default=0.0)
        for one, other in zip(ours, said, strict=True):
            agree(one, other, rtol, largest)
    elif isinstance(said, (int, float)):
        assert ours == pytest.approx(said, rel=rtol, abs=rtol * scale)
    else:
        assert ours == said


def filters(case: str, ours: Any, said: Any) -> None:
    for part in ("weights", "theta", "keys"):
        agree(ours[part], said[part])
    ts, corr = toolbox.GRID[case][0], toolbox.GRID[case][-1]
    assert ours["others"]["euler"] == ours["weights"]["trapezoidal"]["1"]  # it counts both ends fully
    for method, weights in ours["others"].items():  # its nodes are not one step apart
        gain = gain_of(weights, ts)
        assert gain == pytest.approx(1, abs=1e-12 if corr else 0.1)
        if not corr and method != "euler":
            assert abs(gain - 1) < abs(gain_of(said["others"][method], ts) - 1)
    for one, other in zip(ours["trimmed"][:2], said["trimmed"][:2], strict=True):
        assert one / ts == pytest.approx(round(one / ts), abs=1e-12)  # whole samples
        assert abs(one - other) < 2 * ts
    assert len(ours["trimmed"][2]) == pytest.approx((ours["trimmed"][1] - ours["trimmed"][0]) / ts, abs=1e-9)


def gain_of(weights: list[float], ts: float) -> float:
    """Return the slope that the filter makes of the time since the newest sample."""
    return float(np.array(weights) @ (-ts * np.arange(len(weights))))


def estimates(case: str, ours: Any, said: Any) -> None:
    """Check estimates: it fills the warm-up with 0, and is a sample late with "same" and an even number of weights."""
    ts, window = toolbox.GRID[case][0], toolbox.GRID[case][4]
    assert ours["same"] == ours["valid"]
    for index, length in enumerate((round(window / ts), round(window / ts) + 1)):
        estimate, valid, same = ours["valid"][index], said["valid"][index], said["same"][index]
        assert len(estimate) == len(valid) == 27
        assert estimate[: length - 1] == [None] * (length - 1)
        assert valid[: length - 1] == [0.0] * (length - 1)
        agree(estimate[length - 1 :], valid[length - 1 :])
        late = 1 - length % 2
        agree(estimate[length - 1 : 27 - late], same[length - 1 + late :])


def stated_delays(case: str, ours: Any, said: Any) -> None:
    half = toolbox.GRID[case][0] / 2
    for method in ("mid-point", "trapezoidal", "analytic"):
        agree(ours[method], said[method], scale=half)
    for method in ("analytic trapezoidal", "euler"):  # half a sample less than it is: on nodes, as "trapezoidal"
        agree(ours[method], ours["trapezoidal"])
        agree(ours[method] - half, said[method], scale=half)
    assert ours.keys() == said.keys()


def step_response(case: str, ours: Any, said: Any) -> None:
    integral = RECORDED["said"]["get_integralKernel"][case][0]
    agree(ours, [0, *integral, 1])
    miss = np.abs(np.array(said[1:-1]) - integral).max()
    assert miss < 1e-10 if toolbox.GRID[case][3] == 0 else miss > 1e-3


def same_numbers(_: str, ours: Any, said: Any) -> None:
    """Check what is printed: on one line, in another order, with six digits."""
    for number in said:
        assert min(abs(number - one) for one in ours) <= 1e-5 * abs(number)


def shares(case: str, ours: Any, said: Any) -> None:
    """Check shares: of exact integrals, where it has the trapezoidal rule at ten points per step."""
    step = toolbox.GRID[case][0] / 10
    for one, other in zip([*ours[:2], *ours[-1]], [*said[:2], *said[-1]], strict=True):
        assert abs(one - other) <= 1.001 * step
    np.testing.assert_allclose(ours[2], said[2], rtol=0, atol=1e-3)
    agree(ours[3:6], said[3:6])


def afresh(**changes: Any) -> Callable[[str, Any, Any], None]:
    """Return a check that a changed object is as one that was made so, which the toolbox's is not if theta changes."""

    def check(case: str, ours: Any, said: Any) -> None:
        ts, alpha, beta, size, window, theta, is_root, corr = toolbox.GRID[case]
        options = {"ts": ts, "alpha": alpha, "beta": beta, "N": size, "T": window, "corr": corr, **changes}
        new = made(**options)
        if theta is not None:
            new.set_theta(theta, is_root)
        agree(ours, toolbox.plain(toolbox.state(new)), rtol=1e-14)
        if "ts" in changes:
            agree(
                [ours[key] for key in ("theta", "delay", "kernel")], [said[key] for key in ("theta", "delay", "kernel")]
            )
            assert max(abs(one - other) for one, other in zip(ours["filter"], said["filter"], strict=True)) > 1
        elif ours["theta"] == pytest.approx(said["theta"], rel=1e-12, abs=1e-15):
            agree(ours, said)
        else:  # the root of other parameters
            assert said["theta"] == pytest.approx(made(alpha=alpha, beta=beta, N=size).get_theta(), rel=1e-12)

    return check


CHECKS: dict[str, Callable[[str, Any, Any], None]] = {
    "discretize": filters,
    "estimateDer": estimates,
    "get_delayDiscrete": stated_delays,
    "get_stepResponse": step_response,
    "printParam": same_numbers,
    "reduceFilterLength": shares,
    "set_N": afresh(N=2),
    "set_T": afresh(T=0.625),
    "set_alpha": afresh(alpha=3.5),
    "set_beta": afresh(beta=3.5),
    "set_samplingPeriod": afresh(ts=1 / 128),
}
"""Of the methods that are not just to agree."""


@quiet
@pytest.mark.parametrize("name", NAMES)
def test_method(name: str) -> None:
    check = CHECKS.get(name, lambda _, ours, said: agree(ours, said))
    for case in toolbox.GRID:
        ours = toolbox.plain(toolbox.CALLS[name](toolbox.make(AlgebraicDifferentiator, case)))
        check(case, ours, RECORDED["said"][name][case])


def test_signatures() -> None:
    ours = toolbox.signatures(AlgebraicDifferentiator)
    extra = ours.pop("differentiator")
    assert ours == RECORDED["signatures"]
    assert extra == [["der", 1], ["method", "exact"]]
    assert sorted(name for name in ours if name != "__init__") == NAMES
    assert len(NAMES) == 34


@pytest.mark.parametrize("method", [*toolbox.METHODS, *toolbox.OTHERS, "exact"])
def test_delays_are_those_of_the_filters(method: str) -> None:
    """A parabola tells: half a sample would be 0.01."""
    d = made(ts=0.01, alpha=6, beta=6, N=1, T=0.84, corr=False)  # smooth ends: little leaks, and 84 is 2, 3, 4, 6, 7
    t = np.arange(200) * 0.01
    estimate = d.estimateDer(1, t**2, method)
    expected = 2 * (t - d.get_delayDiscrete()[method])
    full = ~np.isnan(estimate)
    assert full.sum() in (116, 117)
    np.testing.assert_allclose(estimate[full], expected[full], rtol=0, atol=1e-3)


@quiet
def test_exact_keeps_offsets_out_and_polynomials_right() -> None:
    d = made(ts=0.01, alpha=1, beta=1, N=1, T=0.6)
    d.set_theta(1, False)
    leak = d.estimateDer(1, np.ones(80))[59:]
    assert abs(leak).min() > 1e-3
    assert (d.estimateDer(1, np.ones(80), "exact")[59:] == 0).all()
    t = np.arange(100) * 0.01
    assert d.get_degreeExactness(1) == 2
    np.testing.assert_allclose(d.estimateDer(1, t**2, "exact")[59:], 2 * (t[59:] + 0.005), rtol=0, atol=1e-11)
    assert d.get_delayDiscrete()["exact"] == pytest.approx(-0.005)  # the end of the window is half a step ahead
    ours = d.differentiator()
    assert ours == algdiff.Differentiator(60, 1, degree=2, kappa=0, mu=0, tau=1.0, delta=0.01)
    assert (d.discretize(1, "exact")[1]["exact"] == ours.weights[::-1]).all()


def test_trimmed_filters_of_the_exact_rule_stay_exact() -> None:
    d = made(ts=0.01, alpha=5, beta=5, N=1, T=0.6)
    whole, (reduced, tau1, tau2) = d.discretize(1, "exact"), d.discretize(1, "exact", redFilLength=True)
    length = reduced[1]["exact-red"].size
    assert length < whole[1]["exact"].size == 60
    assert length == round((tau2 - tau1) / 0.01)
    assert d.get_delayDiscrete()["exact-red"] == pytest.approx(d.get_delayDiscrete()["exact"] - tau1)
    t = np.arange(100) * 0.01
    for share in (0.01, 0.1):  # the second is not the first, remembered
        estimate = d.estimateDer(1, t**2, "exact", redFilLength=True, redTol=share)
        first = np.isnan(estimate).sum()
        assert first == length - 1 if share == 0.01 else first < length - 1
        expected = 2 * (t - d.get_delayDiscrete()["exact-red"])
        np.testing.assert_allclose(estimate[first:], expected[first:], rtol=0, atol=1e-11)


@pytest.mark.parametrize("method", ["mid-point", "boole rule"])
def test_trimmed_filters_of_other_rules_are_what_is_left(method: str) -> None:
    d = made(ts=0.01, alpha=5, beta=4, N=1, T=0.6, corr=False)
    whole = d.discretize(1, method)[1][method]
    found, tau1, tau2, theta = d.discretize(1, method, True, 0.05, True)
    reduced, first = found[1][f"{method}-red"], round(tau1 / 0.01)
    np.testing.assert_array_equal(reduced, whole[first : first + reduced.size])
    assert np.abs(whole[:first]).sum() <= 0.05 * np.abs(whole).sum() < np.abs(whole[: first + 1]).sum()
    assert round((tau2 - tau1) / 0.01) == reduced.size - (method != "mid-point")
    assert theta == pytest.approx(first + 0.5 * (method == "mid-point"))
    late = d.get_delayDiscrete()
    assert late[f"{method}-red"] == pytest.approx(late[method] - tau1, abs=1e-14)


def test_windows_of_a_product_are_the_whole_steps_that_were_meant() -> None:
    assert made(ts=0.005, alpha=2, beta=2, T=29 * 0.005).discretize(1)[1]["mid-point"].size == 29  # 28 there


def test_a_cutoff_is_a_lower_bound_until_there_is_a_window() -> None:
    for wc in np.linspace(12, 20, 9):  # windows of 50 to 30 steps
        d = made(ts=0.01, alpha=2, beta=2, N=1, T=None, wc=wc)
        assert d.get_T() / 0.01 == pytest.approx(round(d.get_T() / 0.01), abs=1e-12)
        longer = made(alpha=2, beta=2, N=1, T=d.get_T() + 0.01).get_cutoffFreq()
        assert longer < wc <= d.get_cutoffFreq()
        again = made(ts=0.01, alpha=2, beta=2, N=1, T=None, wc=d.get_cutoffFreq())  # but for rounding
        assert again.get_T() == d.get_T()
    d.set_theta(0.1, False)
    assert 20 <= d.get_cutoffFreq() < 20 * 1.04
    d.set_T(1.0)
    d.set_alpha(3)
    assert d.get_T() == 1


def test_a_second_integral() -> None:
    for alpha, beta, size in ((-0.5, 1.5, 2), (0.0, 0.0, 1), (40.0, 25.5, 3)):
        d = made(alpha=alpha, beta=beta, N=size, T=0.5)
        t, h = np.linspace(-0.1, 0.7, 81), 1e-6
        slope = (d.get_integralKernel(t + h, 2) - d.get_integralKernel(t - h, 2)) / (2 * h)
        np.testing.assert_allclose(slope[1:-1], d.get_integralKernel(t)[1:-1], rtol=0, atol=2e-3 if alpha < 0 else 1e-5)
        assert d.get_integralKernel(0.0, 2) == 0
        assert d.get_integralKernel(0.5, 2) == pytest.approx(0.5 - d.get_delay(), abs=1e-13)
        assert d.get_integralKernel(2.0, 2) == pytest.approx(2 - d.get_delay(), abs=1e-13)


ROOT = 6.987932000500519
"""The first zero of the Bessel function of order 3.5: of the spectrum of the kernel with alpha = beta = 3, at T / 2."""
KEPT = ["mid-point", "trapezoidal", "euler", "analytic", "analytic trapezoidal"]


@pytest.mark.parametrize("steps", [34.45, 44.93])
def test_a_window_between_two_samples_annihilates_what_it_was_chosen_for(steps: float) -> None:
    """The toolbox leaves 7e-4 to 1.3e-2 of a slope of 100; a kernel of the nearest whole steps would leave 0.4."""
    window = 2 * ROOT / 100
    ts = window / steps
    d = made(alpha=3, beta=3, T=window, ts=ts)
    x = np.sin(100 * ts * np.arange(300))
    for method in KEPT:
        assert np.nanmax(np.abs(d.estimateDer(1, x, method))) < 1e-3
    assert np.nanmax(np.abs(d.estimateDer(1, x, "exact"))) > 1e-2  # which the page says


@pytest.mark.parametrize("order", [0, 1, 2])
def test_filters_of_a_window_between_two_samples_are_those_of_its_kernel(order: int) -> None:
    for steps, nodes in ((20.3, 20), (20.5, 20), (20.8, 21)):
        d = made(alpha=2.5, beta=3.5, N=1, T=steps / 100, corr=False)
        said = {method: d.discretize(order, method)[order][method] for method in KEPT}
        middles = (np.arange(nodes) + 0.5) * 0.01
        at = 0.01 * d.evalKernelDer(middles, order)
        np.testing.assert_allclose(said["mid-point"], at, rtol=1e-12, atol=1e-12 * np.abs(at).max())
        at = 0.01 * d.evalKernelDer(np.arange(21) * 0.01, order)
        at[0] /= 2
        np.testing.assert_allclose(said["trapezoidal"], at, rtol=1e-12, atol=1e-12 * np.abs(at).max())
        np.testing.assert_array_equal(said["euler"], said["trapezoidal"])
        # All of the kernel is integrated: against 1 by both, and by hats against time as well.
        cells, hats = said["analytic"], said["analytic trapezoidal"]
        assert (cells.size, hats.size) == (21, 22)
        scale = 0.01**order
        assert cells.sum() * scale == pytest.approx(float(order == 0), abs=1e-12)
        assert hats.sum() * scale == pytest.approx(float(order == 0), abs=1e-12)
        moment = hats @ np.arange(22.0) * 0.01
        assert moment * scale == pytest.approx({0: d.get_delay(), 1: -1, 2: 0}[order] * scale, abs=1e-12)
        if order == 0:
            edges = np.arange(22) * 0.01
            np.testing.assert_allclose(cells, np.diff(d.get_integralKernel(edges)), rtol=0, atol=1e-15)
        for method in KEPT:
            half = 0.5 * (method in ("mid-point", "analytic"))
            assert d.get_delayDiscrete()[method] == pytest.approx(d.get_delay() - half * 0.01, abs=1e-14)


@pytest.mark.parametrize("method", ["mid-point", "trapezoidal"])
def test_a_kernel_that_jumps_at_the_end_of_the_window_is_summed_to_second_order(method: str) -> None:
    """The miss of the gain falls by four from step to half the step; of a plain sum up to T it would by two."""
    misses = []
    for ts in (0.01, 0.005):
        of = [made(alpha=2, beta=0, T=steps * 0.01, ts=ts, corr=False) for steps in (30.1, 30.2, 30.4)]
        misses.append([abs(d.discretize(0, method)[0][method].sum() - 1) for d in of])
    assert 0 < np.max(misses[0]) < 2e-3
    assert np.max(misses[1]) < 0.4 * np.max(misses[0])


@pytest.mark.parametrize("method", KEPT)
def test_a_window_that_is_whole_but_for_rounding_is_whole(method: str) -> None:
    weights = {}
    for excess in (0, 1e-11, -1e-11, 1e-7, -1e-7):
        d = made(alpha=4, beta=4, N=1, T=0.3 * (1 + excess))
        weights[excess] = d.discretize(1, method)[1][method][:30]
    for excess in (1e-11, -1e-11):
        np.testing.assert_array_equal(weights[excess], weights[0])
    for excess in (1e-7, -1e-7):  # and those beside it are nearly the same
        assert 0 < np.abs(weights[excess][:29] - weights[0][:29]).max() < 1e-5 * np.abs(weights[0]).max()


@pytest.mark.parametrize("method", KEPT)
def test_estimates_of_a_window_between_two_samples(method: str) -> None:
    d = made(alpha=5, beta=5, N=1, T=0.6037)
    t = np.arange(200) * 0.01
    rows = np.stack([t**2, np.sin(t), 1j * t]).reshape(3, 1, 200)
    rows[1, 0, 150] = np.nan
    for trim in (False, True):
        found = d.estimateDer(1, rows, method, redFilLength=trim, redTol=0.02)
        for row, one in zip(rows[:, 0], found[:, 0], strict=True):
            np.testing.assert_allclose(one, d.estimateDer(1, row, method, redFilLength=trim, redTol=0.02), rtol=1e-12)
        coefficients, tau1, tau2 = (
            d.discretize(1, method, redFilLength=trim, redTol=0.02)
            if trim
            else (
                d.discretize(1, method),
                0.0,
                0.6037,
            )
        )
        key = f"{method}-red" if trim else method
        weights = coefficients[1][key]
        assert np.isnan(found[0, 0]).sum() == weights.size - 1
        assert np.isnan(found[1, 0, 100:]).sum() == min(weights.size, 50)
        full = slice(weights.size - 1, None)
        late = d.get_delayDiscrete()[key]
        if not trim:  # else offsets leak
            np.testing.assert_allclose(found[0, 0, full], 2 * (t - late)[full], rtol=0, atol=2e-3)
        else:
            whole = d.discretize(1, method)[1][method]
            assert weights.size < whole.size - 8
            first = round(tau1 / 0.01)
            np.testing.assert_allclose(weights / whole[first : first + weights.size], weights[0] / whole[first])
            on_cells = method in ("mid-point", "analytic")
            assert tau2 - tau1 == pytest.approx((weights.size - (not on_cells)) * 0.01)
            assert late == pytest.approx(d.get_delayDiscrete()[method] - tau1)


@quiet
def test_what_no_window_between_two_samples_has() -> None:
    d = made(alpha=2, beta=2, N=1, T=0.2037)
    for method in KEPT:
        with pytest.raises(ValueError, match=r"T must be a whole number of steps of ts = 0.01 .*got 0.2037: use 'exac"):
            d.differentiator(1, method)
    assert d.differentiator(1).window_length == d.discretize(1, "exact")[1]["exact"].size == 20
    short = made(alpha=2, beta=2, N=3, T=0.0345)
    with pytest.raises(
        ValueError, match=r"T must be at least 5 steps of ts = 0.01 for N = 3, the derivative of order 1"
    ):
        short.discretize(1)
    with pytest.raises(ValueError, match="T must be at least 4 steps"):
        short.discretize(1, "trapezoidal")
    with pytest.raises(ValueError, match=r"min\(alpha, beta\) must be at least 1"):
        made(alpha=0.5, beta=2, T=0.2037).discretize(1, "euler")


@quiet
def test_a_correction_that_cannot_mend_says_what_can() -> None:
    d = made(alpha=3, beta=3, N=0, T=0.02)
    with pytest.raises(ValueError, match=r"corr=True cannot mend this filter of order 1, got a gain of 0 .*corr=False"):
        d.discretize(1, "trapezoidal")
    d.correction = False
    assert d.discretize(1, "trapezoidal")[1]["trapezoidal"].size == 3


def test_numbers_that_are_none() -> None:
    d = made(T=0.5)
    with pytest.raises(TypeError, match="T must be a real number, got None"):
        d.set_T(None)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="wc must be a real number, got None"):
        d.computeTfromWc(None)  # type: ignore[arg-type]
    assert d.get_T() == 0.5


def test_its_repr_is_a_call_or_says_what_was_set() -> None:
    for d in (made(ts=0.02, alpha=2, beta=3.5, N=1, T=0.4, corr=False), made(T=None, wc=20.0)):
        again = eval(repr(d))  # noqa: S307 - its own text
        assert repr(again) == repr(d)
        assert toolbox.plain(toolbox.state(again)) == toolbox.plain(toolbox.state(d))
    d.set_theta(0.25, False)
    assert repr(d).startswith("<AlgebraicDifferentiator(ts=0.01, alpha=1.0,")
    assert repr(d).endswith("wc=20.0, corr=True) with theta set to 0.25>")


def test_exponents_that_overflow_there() -> None:
    d = made(alpha=200, beta=200, N=2, T=1)
    kernel = d.evalKernel(np.linspace(0, 1, 2001))  # 0 with many derivatives at both ends: the sum is the integral
    assert kernel.sum() / 2000 == pytest.approx(1, abs=1e-9)
    assert np.isfinite(d.get_cutoffFreq())


def test_a_cutoff_that_is_not_a_number_there() -> None:
    d = made(alpha=1, beta=1, N=2, T=2)
    d.set_theta(0, True)
    assert d.get_cutoffFreq() == pytest.approx(3.873 / 2, abs=1e-3)


def test_it_warns() -> None:
    with pytest.warns(algdiff.DesignWarning, match="wc is not used where T is given: pass T=None"):
        made(wc=20)
    with pytest.warns(algdiff.DesignWarning, match="no root of the Jacobi polynomial, got 0.4: the nearest is 0.37796"):
        made(alpha=2, beta=2, N=1).set_theta(0.4, True)
    d = made(ts=0.1, alpha=1, beta=1, N=1, T=0.4)
    with pytest.warns(algdiff.DesignWarning, match="half the sampling rate is attenuated by"):
        d.checkParameters(1)
    d.warningRelativeAttenuation = 100
    d.checkParameters(1)


@quiet
def test_what_is_refused_changes_nothing() -> None:
    d = made(alpha=2, beta=2, N=1, T=0.5)
    before = toolbox.plain(toolbox.state(d))
    for change, message in (
        (lambda: d.set_alpha(-1), "alpha must be finite and greater than -1, got -1"),
        (lambda: d.set_N(-1), "N must be an integer of at least 0"),
        (lambda: d.set_N(501), "N must be at most 500"),
        (lambda: d.set_T(0.001), "T must be at least ts = 0.01, got 0.001"),
        (lambda: d.set_samplingPeriod(0), "ts must be finite and positive"),
        (lambda: d.set_theta(float("nan"), False), "theta must be finite"),
        (lambda: d.computeTfromWc(1e5), r"wc must be at most [0-9.e+]+, that of one step, got 100000"),
        (lambda: d.checkParameters(3), r"der must be less than min\(alpha, beta\) \+ 1 = 3, got 3"),
        (lambda: d.evalKernelDer(0.1, 3), "k must be less than"),
        (lambda: d.estimateDer(1, np.ones(10)), "x must have at least the 50 samples of the window, got 10"),
        (lambda: d.estimateDer(1, np.ones(60), conv="circular"), "conv must be 'same', 'valid' or 'full'"),
        (lambda: d.estimateDer(1, 1.0), "x must have at least one dimension"),
        (lambda: d.discretize(1, "gauss"), "method must be one of 'mid-point', .*'exact'.*, got 'gauss'"),
        (lambda: d.discretize(1, redFilLength=True, redTol=0.5), "redTol must be at least 0 and less than 0.5"),
        (lambda: d.reduceFilterLength(1, 0.5), "tol must be at least 0"),
        (lambda: d.get_integralKernel(0.1, 3), "nested must be 1 or 2, got 3"),
        (lambda: d.differentiator(1, "boole rule"), "method must be one of a Differentiator's rules"),
        (lambda: made(alpha=0.5, beta=2).discretize(1, "trapezoidal"), r"min\(alpha, beta\) must be at least 1"),
        (lambda: made(alpha=2, beta=2, N=3, T=0.04).discretize(1), "T must be at least 5 steps of ts = 0.01"),
        (lambda: made(T=None), "either T or wc must be given"),
    ):
        with pytest.raises(ValueError, match=message):
            change()
    with pytest.raises(TypeError, match="alpha must be a real number"):
        d.set_alpha("2")
    assert toolbox.plain(toolbox.state(d)) == before


def test_filters_of_orders_that_became_too_high_are_forgotten() -> None:
    d = made(alpha=2, beta=2, N=1, T=0.5)
    assert sorted(d.discretize(2)) == [2]
    d.set_alpha(0.5)
    assert d.get_delayDiscrete() == {}
    assert sorted(d.discretize(0)) == [0]


def test_correction_can_be_switched() -> None:
    d = made(alpha=3, beta=2, N=1, T=0.2)
    gains = []
    for corr in (True, False, True):
        d.correction = corr
        gains.append(gain_of(d.discretize(1)[1]["mid-point"], 0.01))
    assert gains[0] == gains[2] == pytest.approx(1, abs=1e-13)
    assert abs(gains[1] - 1) > 1e-4


def test_shapes_and_types_of_samples() -> None:
    d = made(alpha=2, beta=2, N=1, T=0.2)
    x = np.random.default_rng(0).standard_normal((3, 40))
    rows = d.estimateDer(1, x)
    assert rows.shape == x.shape
    np.testing.assert_array_equal(rows[1], d.estimateDer(1, x[1]))
    assert d.estimateDer(1, x[1].tolist(), "boole rule").dtype == np.float64
    assert d.estimateDer(1, x[1].astype(np.float32)).dtype == np.float64
    assert d.estimateDer(1, x[1] + 1j).dtype == np.complex128
    with pytest.raises(TypeError, match="masked"):
        d.estimateDer(1, np.ma.masked_less(x[0], 0))


def test_one_line_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    AlgebraicDifferentiator()
    printed = capsys.readouterr().out
    assert printed.count("\n") == 1
    assert printed.startswith("AlgebraicDifferentiator: alpha 1, beta 1, N 0,")
    made()
    assert capsys.readouterr().out == ""


def test_copies_are_independent() -> None:
    d = made(alpha=2, beta=2, N=1, T=0.5)
    d.discretize(1)
    for other in (copy.deepcopy(d), pickle.loads(pickle.dumps(d))):  # noqa: S301 - its own bytes
        other.set_T(0.25)
        assert other.discretize(1)[1]["mid-point"].size == 25
    assert d.discretize(1)[1]["mid-point"].size == 50
    d.discretize(1)[1]["mid-point"][:] = 0
    assert np.abs(d.discretize(1)[1]["mid-point"]).max() > 0


def test_the_package_imports_no_adapter_before_it_is_asked() -> None:
    code = (
        "import sys, algdiff.compat as c; "
        "assert not [m for m in sys.modules if m.startswith('algdiff.compat.')]; "
        "c.AlgebraicDifferentiator; assert 'mpmath' not in sys.modules and 'scipy' not in sys.modules; "
        "assert 'AlgebraicDifferentiator' in dir(c)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
