"""Figures 1 to 4 of the source, what it claims of them, and the demo and example that draw them."""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import _demo
from algdiff import _paper_figures as figures
from algdiff._cli import main
from support import EPS, difference_bound, sum_bound

T, X, SLOPE = figures.TIMES, figures.signal(figures.TIMES), figures.slope(figures.TIMES)
DELTA = figures.DELTA
ROOT = Path(__file__).parents[1]
FIG2, FIG3, SOLID, DASHED = figures.CURVES
TAU_1 = (5 + math.sqrt(5)) / 10  # largest root of P_2 for kappa = mu = 0, theory section 5
POLYNOMIALS = [np.polynomial.Polynomial.basis(m) for m in range(6)]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def errors() -> np.ndarray:
    return figures.errors()


def windows(y: np.ndarray, steps: int) -> np.ndarray:
    return np.lib.stride_tricks.sliding_window_view(y, steps + 1)


def signal_derivative(n: int, t: np.ndarray) -> np.ndarray:
    """Return the derivative of order n of the paper's signal; sin(6t + pi) = -sin(6t)."""
    tanh, exponent = POLYNOMIALS[1], complex(-1 / 1.2, 6)
    for _ in range(n):
        tanh = tanh.deriv() * np.polynomial.Polynomial([1, 0, -1])
    return tanh(np.tanh(t - 1)) - (exponent**n * np.exp(exponent * t)).imag


# --- the signal, its noise and the curves ------------------------------------------------------------------------


def test_the_signal_and_its_derivative():
    for n, values in enumerate([X, SLOPE]):
        np.testing.assert_allclose(signal_derivative(n, T), values, rtol=0, atol=64 * EPS * np.abs(values).max())
    assert (len(T), T[-1]) == (1001, 5.0)


def test_the_noise_is_at_exactly_25_decibels_as_the_paper_defines_them():
    for seed in figures.SEEDS:
        y = figures.observe(seed)
        decibels = 10 * math.log10((y @ y) / ((y - X) @ (y - X)))
        # y - x has the rounding of y, at most 2 EPS in noise of some 0.05: 1e-14 of it, and 10 times that in decibels.
        assert decibels == pytest.approx(25, rel=0, abs=1e-12)
        noise = np.random.default_rng(seed).standard_normal(len(T))
        np.testing.assert_allclose((y - X) / noise, (y - X)[0] / noise[0], rtol=1e-9)
        assert (y - X)[0] / noise[0] > 0


def annihilator(y: np.ndarray, kappa: int, mu: int, duration: float) -> np.ndarray:
    """Return the estimates of equation (10) in all windows along the last axis, by the trapezoidal rule."""
    tau = np.linspace(0, 1, y.shape[-1])
    p = (mu + kappa + 2) * tau - (kappa + 1)
    values = p * tau**kappa * (1 - tau) ** mu * y
    integral = (values[..., 1:] + values[..., :-1]).sum(axis=-1) / (2 * (y.shape[-1] - 1))
    return (mu + 2) / duration * math.comb(mu + kappa + 3, kappa + 1) * integral


def combination(y: np.ndarray, tau_1: float, duration: float) -> np.ndarray:
    """Return the estimates of equations (16) and (17) with kappa = mu = 0."""
    lambda_0 = 3 - 5 * tau_1
    return lambda_0 * annihilator(y, 0, 1, duration) + (1 - lambda_0) * annihilator(y, 1, 0, duration)


@pytest.mark.parametrize("y", [X, figures.observe(0)], ids=["noise-free", "noisy"])
def test_the_curves_are_the_papers_own_formulas(y):
    seen = windows(y, 110)
    weighted = [(-3 / 4, 2, 0), (5 / 2, 1, 1), (-3 / 4, 0, 2)]  # lambda_i at 1/2, theory section 4
    expected = {
        FIG2: annihilator(windows(y, 60), 2, 2, 60 * DELTA),
        FIG3: -combination(seen[:, ::-1], 0.0, 110 * DELTA),  # the paper's causal form: y(t - tau) and a minus
        SOLID: combination(seen, TAU_1, 110 * DELTA),
        DASHED: sum(factor * annihilator(seen, kappa, mu, 110 * DELTA) for factor, kappa, mu in weighted),
    }
    for curve, values in expected.items():
        got = curve.estimate(y, "trapezoid")
        # Both ways add the same samples; the combination multiplies rounding by sum|lambda| = 5 at most, the kernels of
        # (10) have sum|w| at most twice that of ours.
        bound = 10 * sum_bound(curve.design("trapezoid").weights, y)
        np.testing.assert_allclose(got.values, values, rtol=0, atol=bound, err_msg=curve.key)
        assert bound < 1e-8


def test_stamps_and_truth_are_the_papers():
    for curve, tau, count in [(FIG2, 1 / 2, 941), (FIG3, 1.0, 891), (SOLID, TAU_1, 891), (DASHED, 1 / 2, 891)]:
        got = curve.estimate(X, "trapezoid")
        first = T[: len(T) - curve.steps]
        assert len(got.values) == len(got.truth) == count
        np.testing.assert_array_equal(got.stamps, first if curve is FIG2 else T[curve.steps :])
        expected = figures.slope(first + tau * curve.steps * DELTA)
        np.testing.assert_allclose(got.truth, expected, rtol=0, atol=1e3 * EPS)  # a few eps of t <= 5, |x''| <= 42


# --- root mean square errors -------------------------------------------------------------------------------------

NOISY = [0.124, 1.175, 0.101, 0.077]
NOISE_FREE = [0.058, 1.165, 0.080, 0.018]


@pytest.mark.parametrize("rule", figures.RULES)
def test_errors_with_noise(errors, rule):
    got = errors[:, 0, figures.RULES.index(rule)]
    np.testing.assert_allclose(got, NOISY, rtol=0.06)
    fig2, fig3, solid, dashed = got
    assert fig3 > 5 * fig2 > 5 * solid > 5 * dashed, "the paper's remarks on its figures"


def test_errors_without_noise(errors):
    continuous = [rms(continuous_error(curve)) for curve in figures.CURVES]
    np.testing.assert_allclose(continuous, NOISE_FREE, rtol=0.06)
    np.testing.assert_allclose(errors[:3, 1, 0], continuous[:3], rtol=0.01)
    # The last is so small that the error of the trapezoidal rule shows: 6 % more than its integral computed exactly.
    assert errors[3, 1, 0] == pytest.approx(0.0199, rel=0.003)
    for curve, got in zip(figures.CURVES, errors[:, 1, 0], strict=True):
        assert got == pytest.approx(rms(continuous_error(curve) + trapezoid_error(curve)), rel=1e-3), curve.key


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def kernel_of(curve: figures.Curve) -> algdiff.Kernel:
    return algdiff.Kernel(1, curve.degree, curve.exponent, curve.exponent, curve.tau)


def continuous_error(curve: figures.Curve) -> np.ndarray:
    """Return what the curve errs by without noise when its integral is computed exactly, by Gauss-Legendre."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    duration, k, tau = curve.steps * DELTA, kernel_of(curve), (nodes + 1) / 2
    start = T[: len(T) - curve.steps, None]
    estimate = figures.signal(start + duration * tau) @ (weights / 2 * k(tau)) / duration
    return estimate - figures.slope(start[:, 0] + duration * k.tau)


def trapezoid_error(curve: figures.Curve) -> np.ndarray:
    """Return the leading term of Euler and Maclaurin: what the rule of M steps adds to the integral of k x over T."""
    duration, k = curve.steps * DELTA, kernel_of(curve)
    points = np.linspace(0, 1, 11)
    polynomial = np.polynomial.Polynomial.fit(points, k(points), curve.degree + 2 * int(curve.exponent), domain=[0, 1])
    oldest, newest = (
        polynomial.deriv()(end) * x + polynomial(end) * duration * slope
        for end, x, slope in [
            (0, X[: -curve.steps], SLOPE[: -curve.steps]),
            (1, X[curve.steps :], SLOPE[curve.steps :]),
        ]
    )
    return (newest - oldest) / (12 * curve.steps**2 * duration)


def test_exact_rule_has_the_continuous_error_when_its_window_is_as_long():
    got = []
    for curve in figures.CURVES:
        exponents = {"kappa": curve.exponent, "mu": curve.exponent}
        d = algdiff.Differentiator(curve.steps, degree=curve.degree, tau=curve.tau, delta=DELTA, **exponents)
        got.append(rms(d(X, mode="valid") - figures.slope(T[curve.steps - 1 :] - d.delay)))
        if curve is not FIG3:  # whose "newest" is not tau = 1 here
            assert got[-1] == pytest.approx(rms(continuous_error(curve)), rel=0.002), curve.key
    np.testing.assert_allclose(got, [0.0581, 1.1411, 0.0806, 0.0188], rtol=0, atol=0.5001e-4)
    np.testing.assert_allclose(got, NOISE_FREE, rtol=0.06)


def test_at_other_sampling_steps(monkeypatch):
    def measured(step: float) -> np.ndarray:
        monkeypatch.setattr(figures, "DELTA", step)
        monkeypatch.setattr(figures, "TIMES", step * np.arange(round(5 / step) + 1))
        return figures.errors()[:, :2, 0]

    fig2, fig3, solid, _ = measured(0.002)[:, 0]
    assert fig3 > 1.2 * fig2 > 1.2 * solid
    noisy, noise_free = measured(0.01).T
    assert (noise_free > 0.98 * noisy).all()
    np.testing.assert_allclose(measured(0.001)[:2, 0], [0.55, 0.59], rtol=0, atol=0.00501)


# --- an offset of 100 --------------------------------------------------------------------------------------------


def storage(weights: np.ndarray, y: np.ndarray) -> float:
    """Return what storing y with the offset may change: half a unit in the last place of each sample."""
    return float(np.abs(weights).sum()) * float(np.spacing(np.abs(y + figures.OFFSET).max())) / 2


@pytest.mark.parametrize("curve", figures.CURVES, ids=lambda curve: curve.key)
@pytest.mark.parametrize("y", [X, figures.observe(0)], ids=["noise-free", "noisy"])
def test_an_offset_changes_the_exact_rule_by_rounding_only(curve, y):
    d = curve.design("exact")
    shifted = y + figures.OFFSET
    with_offset, without = d(shifted, mode="valid"), d(y, mode="valid")
    # What is left of y after its storage gives the same bits, for the differences of both are exact.
    np.testing.assert_array_equal(with_offset, d(shifted - figures.OFFSET, mode="valid"))
    bound = storage(d.weights, y) + 2 * difference_bound(d.weights, y)
    np.testing.assert_allclose(with_offset, without, rtol=0, atol=bound)
    assert bound < 1e-9


@pytest.mark.parametrize("curve", figures.CURVES, ids=lambda curve: curve.key)
@pytest.mark.parametrize("y", [X, figures.observe(0)], ids=["noise-free", "noisy"])
def test_an_offset_changes_the_trapezoid_by_its_leak(curve, y):
    d = curve.design("trapezoid")
    shifted = y + figures.OFFSET
    change = d(shifted, mode="valid") - d(y, mode="valid")
    bound = storage(d.weights, y) + sum_bound(d.weights, y) + sum_bound(d.weights, shifted)
    np.testing.assert_allclose(change, figures.OFFSET * math.fsum(d.weights), rtol=0, atol=bound)
    leak = {FIG3: 30, SOLID: 30 * (2 * TAU_1 - 1)}.get(curve, 0) / 110**2 / (110 * DELTA)
    np.testing.assert_allclose(change, figures.OFFSET * leak, rtol=0, atol=2 * bound)
    assert bound < 1e-6
    if leak:
        assert figures.OFFSET * leak > 0.2


@pytest.mark.parametrize("steps", [2, 5, 30, 110, 1000])
@pytest.mark.parametrize("tau", [0.0, 0.25, 0.5, "root", 0.9, 1.0, 1.3])
def test_the_leak_of_the_trapezoid(steps, tau):
    d = algdiff.Differentiator(steps + 1, degree=2, kappa=0, mu=0, tau=tau, delta=DELTA, rule="trapezoid")
    # k is a polynomial of degree 2, k'' = 360 (2 tau - 1); the rule errs by (k'(1) - k'(0)) / (12 M^2), and T divides.
    expected = 30 * (2 * d.tau - 1) / steps**2 / (steps * DELTA)
    assert math.fsum(d.weights) == pytest.approx(expected, rel=0, abs=64 * EPS * np.abs(d.weights).sum())


def test_the_offset_in_the_table(errors):
    np.testing.assert_allclose(errors[:, 2, 1], errors[:, 0, 1], rtol=1e-9)
    np.testing.assert_allclose(errors[[0, 3], 2, 0], errors[[0, 3], 0, 0], rtol=1e-9)
    np.testing.assert_allclose(errors[[1, 2], 2, 0], [1.30, 0.233], rtol=0.06)


# --- what the paper claims ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("steps", [30, 60])
@pytest.mark.parametrize(
    ("kappa", "mu", "rule"),
    [(kappa, mu, "exact") for kappa, mu in [(2, 2), (2, 5), (5, 2), (0, 0), (0, 2), (3, 1), (1, 4), (0, 6), (0.5, 2.5)]]
    + [(kappa, mu, "trapezoid") for kappa, mu in [(2, 2), (2, 5), (5, 2)]],
)
def test_delay_13_fits_the_shifted_truth(steps, kappa, mu, rule):
    d = algdiff.Differentiator(steps + 1, degree=1, kappa=kappa, mu=mu, tau="root", delta=DELTA, rule=rule)
    tau_0 = (kappa + 2) / (mu + kappa + 4)
    assert d.tau == pytest.approx(tau_0, rel=0, abs=4 * EPS)
    duration = (steps + (rule == "exact")) * DELTA
    start = T[:-steps] - (DELTA / 2 if rule == "exact" else 0)
    estimate = d(X, mode="valid")
    shifts = np.linspace(0, duration, 3001)
    misfit = ((estimate[:, None] - figures.slope(start[:, None] + shifts)) ** 2).sum(axis=0)
    best = shifts[misfit.argmin()]
    # The estimate errs by e = Var T^2 x'''/2 at tau_0 (theory section 6). The best truth lies no farther from it than
    # the truth at tau_0, so the two truths differ by at most 2 |e|, and per unit of shift they differ by |x''|.
    variance = (kappa + 2) * (mu + 2) / ((kappa + mu + 4) ** 2 * (kappa + mu + 5))
    third, second = (np.linalg.norm(signal_derivative(n, start + tau_0 * duration)) for n in (3, 2))
    tolerance = variance * duration**2 * third / second + shifts[1]
    assert abs(best - tau_0 * duration) <= tolerance
    assert tolerance < 0.09 * duration * steps / 60
    if kappa != mu and steps == 30:  # the fit tells (13) from its neighbours
        for other in (1 / 2, (kappa + 1) / (kappa + mu + 2), 1 - tau_0):
            assert abs(best - other * duration) > tolerance


def moments(deriv: int, degree: int, kappa: float, mu: float, tau: float | str, count: int) -> tuple[float, np.ndarray]:
    """Return tau and by how much a kernel misses the derivatives of 1, s, s^2, ... there."""
    nodes, weights = np.polynomial.legendre.leggauss(40)  # exact: the exponents here are integers
    s, k = (nodes + 1) / 2, algdiff.Kernel(deriv, degree, kappa, mu, tau)
    got = [float(weights / 2 @ (k(s) * s**m)) for m in range(count)]
    return k.tau, np.array([value - POLYNOMIALS[m].deriv(deriv)(k.tau) for m, value in enumerate(got)])


EXPONENTS = [(0, 0), (1, 0), (2, 2), (1, 3)]


@pytest.mark.parametrize(("kappa", "mu"), EXPONENTS)
def test_the_delay_free_estimate_is_unbiased_on_quadratics(kappa, mu):
    tau, missed = moments(1, 2, kappa, mu, "newest", 4)
    assert tau == 1
    assert np.abs(missed[:3]).max() < 1e-11  # 40 products of kernels up to 2e3, times EPS
    assert abs(missed[3]) > 0.05
    d = algdiff.Differentiator(111, degree=2, kappa=kappa, mu=mu, tau="newest", delta=DELTA)
    assert d.delay == 0
    for coefficients in [(3, 0, 0), (0, 2, 0), (0, 0, 4), (-1, 2.5, 3)]:
        quadratic = np.polynomial.Polynomial(coefficients)
        got, expected = d(quadratic(T), mode="valid"), quadratic.deriv()(T[110:])
        np.testing.assert_allclose(got, expected, rtol=0, atol=8 * sum_bound(d.weights, quadratic(T)))


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize(("kappa", "mu"), EXPONENTS)
def test_a_root_gains_one_degree(kappa, mu, degree):
    tau, missed = moments(1, degree, kappa, mu, "root", degree + 3)
    assert np.abs(missed[:-1]).max() < 1e-11
    assert abs(missed[-1]) > 1e-3
    _, beside = moments(1, degree, kappa, mu, tau - 0.05, degree + 2)
    assert np.abs(beside[:-1]).max() < 1e-11
    assert abs(beside[-1]) > 1e-3
    d = algdiff.Differentiator(111, degree=degree, kappa=kappa, mu=mu, tau="root", delta=DELTA)
    assert (d.exactness, d.replace(tau=tau - 0.05).exactness) == (degree + 1, degree)
    for design, exact in [(d, True), (d.replace(tau=tau - 0.05), False)]:
        power = POLYNOMIALS[degree + 1]
        missed = design(power(T), mode="valid") - power.deriv()(T[110:] - design.delay)
        bound = 8 * sum_bound(design.weights, power(T))
        assert bool((np.abs(missed) <= bound).all()) is exact
        assert bound < 1e-6


def test_tau_1_is_the_largest_root_of_p_2_with_less_delay_than_tau_0():
    for kappa, mu in EXPONENTS:
        roots = algdiff.Kernel(1, 2, kappa, mu).roots
        tau_0 = (kappa + 2) / (kappa + mu + 4)
        assert roots[0] < tau_0 < roots[1]
        assert algdiff.Differentiator(111, degree=2, kappa=kappa, mu=mu, tau="root").tau == roots[1]
    assert SOLID.design("trapezoid").tau == pytest.approx(TAU_1, rel=0, abs=4 * EPS)
    assert SOLID.design("trapezoid").exactness == -1, "the trapezoid leaks"
    assert DASHED.design("exact").exactness == 4


# --- the demo, the example and the page --------------------------------------------------------------------------

NUMBERS = re.compile(r"^(Fig\. .{29})((?: +\d+\.\d+){8})$", re.MULTILINE)


def table(text: str) -> dict[str, list[float]]:
    return {name.strip(): [float(number) for number in numbers.split()] for name, numbers in NUMBERS.findall(text)}


def test_demo_prints_the_table(capsys, errors):
    assert main(["demo", "--paper", "--threads", "1", "--output", "out"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    printed = table(out)
    assert list(printed) == [curve.label for curve in figures.CURVES]
    np.testing.assert_allclose([row[2:] for row in printed.values()], errors.reshape(4, 6), rtol=0, atol=0.5001e-4)
    delays = [[1000 * curve.design(rule).delay for rule in figures.RULES] for curve in figures.CURVES]
    np.testing.assert_allclose([row[:2] for row in printed.values()], delays, rtol=0, atol=0.05001)
    assert main(["demo", "--paper", "--output", "out"]) == 0, "an earlier result is replaced"
    assert capsys.readouterr().out == out
    assert sorted(os.listdir("out")) == ["figures.npz", "figures.png"]


def test_demo_writes_what_it_draws(here):
    pytest.importorskip("matplotlib")
    assert main(["demo", "--paper"]) == 0
    content = (here / "algdiff-demo" / "figures.png").read_bytes()
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    assert content.endswith(b"IEND\xaeB`\x82")
    y = figures.observe(0)
    with np.load(here / "algdiff-demo" / "figures.npz") as data:
        assert len(data.files) == 3 + 4 * 2 * 3
        for name, array in (("t", T), ("x", X), ("y", y)):
            np.testing.assert_array_equal(data[name], array)
        for curve in figures.CURVES:
            for rule in figures.RULES:
                got = [data[f"{curve.key}_{rule}_{name}"] for name in ("t", "estimate", "truth")]
                for array, expected in zip(got, curve.estimate(y, rule), strict=True):
                    np.testing.assert_array_equal(array, expected)


def test_demo_without_matplotlib(capsys, monkeypatch):
    monkeypatch.setattr(_demo, "_optional", lambda _: None)
    assert main(["demo", "--paper", "--output", "plain"]) == 0
    assert "pip install matplotlib" in capsys.readouterr().out
    assert os.listdir("plain") == ["figures.npz"]


def test_demo_threads_reach_the_library(monkeypatch):
    got: set[Any] = set()
    genuine = algdiff.Differentiator.__call__

    def listening(self, x, axis=-1, **words):
        got.add(words["threads"])
        return genuine(self, x, axis, **words)

    monkeypatch.setattr(algdiff.Differentiator, "__call__", listening)
    for flags in ([], ["--threads", "3"]):
        assert main(["demo", "--paper", *flags]) == 0
    assert got == {None, 3}


def test_the_example_gives_the_same(here):
    pytest.importorskip("matplotlib")
    example = ROOT / "examples" / "paper_figures.py"
    done = subprocess.run(
        [sys.executable, str(example), "drawn.png"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
        env={**os.environ, "MPLBACKEND": "Agg"},
    )
    y = figures.observe(0)
    said = re.findall(r"delay (\S+) s  RMSE (\S+) \(trapezoid\) (\S+) \(exact\)", done.stdout)
    assert len(said) == 4
    for (delay, *rmse), curve in zip(said, figures.CURVES, strict=True):
        assert float(delay) == pytest.approx(curve.design("trapezoid").delay, abs=0.0005001)
        expected = [curve.estimate(y, rule).rmse() for rule in figures.RULES]
        np.testing.assert_allclose([float(number) for number in rmse], expected, rtol=0, atol=0.5001e-4)
    assert (here / "drawn.png").read_bytes().endswith(b"IEND\xaeB`\x82")
    assert os.listdir(here) == ["drawn.png"]


def test_the_page_shows_the_table_as_printed(capsys):
    page = (ROOT / "docs" / "paper-figures.md").read_text(encoding="utf-8")
    assert main(["demo", "--paper"]) == 0
    printed = capsys.readouterr().out
    shown, now = table(page), table(printed)
    assert shown.keys() == now.keys()
    # The last digit may differ between machines and versions of NumPy.
    np.testing.assert_allclose(list(shown.values()), list(now.values()), rtol=0, atol=1.001e-4)
    assert printed.split("\n\n")[0] in page
    assert (ROOT / "docs" / "figures.png").stat().st_size < 150_000
