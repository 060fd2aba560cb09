"""Clocks that jitter lightly: a correction of first order, how far it is from fits, and where it is not used."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import algdiff
from algdiff import _jitter as jitter
from algdiff import differentiate
from support import EPS

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")

Array = npt.NDArray[np.float64]
TENTH = 0.1
"""By how much of a standard deviation estimates may differ from those of fits: docs/real-data.md."""


class Count:
    """Counts the passes of the correction."""

    def __init__(self, run: Callable[..., Any]) -> None:
        self.run, self.passes = run, 0

    def __call__(self, *args: Any, **words: Any) -> Any:
        """Run it."""
        self.passes += 1
        return self.run(*args, **words)


@pytest.fixture
def count(monkeypatch: pytest.MonkeyPatch) -> Count:
    counter = Count(jitter.run)
    monkeypatch.setattr(jitter, "run", counter)
    return counter


def clock(rng: np.random.Generator, n: int, late: float) -> Array:
    """Return n times that are late or early by up to `late`."""
    return np.asarray(np.arange(n) + rng.uniform(-late, late, n))


def shares(t: Array, x: npt.NDArray[Any], **call: Any) -> tuple[Array, algdiff.Estimates, Any]:
    """Return how far the estimates are from those of fits, in standard deviations, the fits, and the estimates."""
    found = differentiate(x, t=t, **call)
    fit = differentiate(x, t=t, return_std=True, **call)
    return np.abs(found - fit.estimate) / fit.std, fit, found


def random_call(rng: np.random.Generator) -> dict[str, Any]:
    """Return a design."""
    deriv = int(rng.integers(0, 4))
    degree = max(2, deriv + int(rng.integers(0, 4)))
    longest = 200 if rng.random() < 0.5 else 30
    tau = [0.0, "newest", 0.5, "center", float(rng.random())][rng.integers(5)]
    exponents = rng.choice([-0.3, 0, 0.5, 1, 2], 2)
    kappa, mu = exponents if rng.random() < 0.5 else exponents[[0, 0]]
    length = int(rng.integers(max(5, degree + 2), longest + 1))
    words = {"window_length": length, "deriv": deriv, "degree": degree}
    return {**words, "kappa": float(kappa), "mu": float(mu), "tau": tau}


@pytest.mark.parametrize(("shortest", "longest"), [(4, 12), (1, 4)])
@pytest.mark.parametrize("block", range(4))
def test_corrected_estimates_are_next_to_those_of_fits(
    block: int, shortest: float, longest: float, count: Count
) -> None:
    """Of signals whose period is 4 to 12 windows, which fits follow, and of faster ones, which they smooth away."""
    used, worst = 0, []
    for seed in range(100):
        rng = np.random.default_rng([81, block, seed, int(shortest)])
        call = random_call(rng)
        n = int(rng.integers(call["window_length"], 3 * call["window_length"] + 60))
        t = clock(rng, n, 0.02 * rng.random())
        period = rng.uniform(shortest, longest) * max(call["window_length"], 30)
        signal = np.sin(2 * np.pi * t / period + rng.uniform(0, 6))
        x = signal + 10 ** rng.uniform(-2.5, 0) * rng.standard_normal(n)
        count.passes = 0
        share, fit, found = shares(t, x, **call)
        if count.passes == 2:  # after the first it may be given up
            used += 1
            worst.append((float(share.max()), seed, call))
            assert not np.array_equal(found, fit.estimate)
        else:
            np.testing.assert_array_equal(found, fit.estimate)
    assert used > 60
    far = [one for one in worst if one[0] > TENTH]
    assert not far, far


WINDOW: dict[str, Any] = {"window_length": 21, "deriv": 1, "degree": 3}


def noisy(seed: int, n: int = 300, *shape: int, late: float = 0.01) -> tuple[Array, Array]:
    """Return times, and samples with the axis of time last."""
    rng = np.random.default_rng([82, seed])
    t = clock(rng, n, late)
    phase = rng.uniform(0, 6, (*shape, 1))
    return t, np.sin(t / 40 + phase) + 0.1 * rng.standard_normal((*shape, n))


@pytest.mark.parametrize("tau", ["center", "newest", 0.3])
def test_several_orders_are_each_their_own(tau: Any, count: Count) -> None:
    t, x = noisy(1)
    call = {**WINDOW, "tau": tau, "deriv": (3, 0, 1)}
    share, _, found = shares(t, x, **call)
    assert count.passes == 2
    assert share.max() <= TENTH
    for place, order in enumerate(call["deriv"]):
        alone, fit, one = shares(t, x, **{**call, "deriv": order})
        assert alone.max() <= TENTH
        # One and the same but for the engine that is chosen for several.
        assert (np.abs(one - found[place]) <= 1e-9 * fit.std).all()


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.complex128])
@pytest.mark.parametrize("axis", [0, 1])
def test_rows_are_each_their_own(axis: int, dtype: Any, count: Count) -> None:
    t, x = noisy(2, 300, 4)
    x = x.astype(dtype) * (0.6 + 0.8j if dtype == np.complex128 else 1)
    for deriv in (1, (0, 2)):
        call = {**WINDOW, "deriv": deriv}
        turned = np.ascontiguousarray(x if axis else x.T)
        share, fit, found = shares(t, turned, axis=axis, **call)
        assert found.dtype == dtype
        assert share.max() <= TENTH
        assert count.passes
        assert not np.array_equal(found, fit.estimate)
        rows = np.moveaxis(found, axis - 2, -1)
        std = np.moveaxis(fit.std, axis - 2, -1)
        assert rows.shape[-2:] == (4, 300)
        eps = 1e-3 if dtype == np.float32 else 1e-9
        for row in range(4):
            alone = differentiate(x[row], t=t, **call)
            assert (np.abs(rows[..., row, :] - alone) <= eps * std[..., row, :]).all()


@pytest.mark.parametrize("tau", ["center", "newest", 0.3])
def test_time_may_start_anywhere_run_backwards_and_have_any_unit(tau: Any, count: Count) -> None:
    t, x = noisy(3)
    call = {**WINDOW, "tau": tau}
    found, std = differentiate(x, t=t, **call), differentiate(x, t=t, return_std=True, **call).std
    assert (np.abs(differentiate(x[::-1], t=t[::-1], **call)[::-1] - found) <= 1e-9 * std).all()
    for offset, unit in [(1e6, 1.0), (-1e4, 1.0), (0.0, 1e-6), (0.0, 1e9)]:
        count.passes = 0
        stamps = (t + offset) * unit
        share, _, moved = shares(stamps, x, **call)
        assert count.passes == 2
        assert share.max() <= TENTH
        # Stamps far from 0 are rounded: by 2 eps of it, on samples that are worth the slope of the signal and noise.
        assert (np.abs(moved * unit - found) <= (1e-9 + 1e3 * EPS * abs(offset)) * std).all()


def test_errors_against_the_truth_are_those_of_fits(count: Count) -> None:
    for tau in ("center", "newest", 0.3):
        for deriv in range(3):
            wrong = []
            for seed in range(20):
                rng = np.random.default_rng([83, seed])
                t = clock(rng, 400, 0.015)
                truth = np.sin(t / 40 + deriv * np.pi / 2) / 40.0**deriv
                x = np.sin(t / 40) + 0.1 * rng.standard_normal(400)
                _, fit, found = shares(t, x, window_length=21, deriv=deriv, degree=3, tau=tau)
                wrong.append([np.square(found - truth).mean(), np.square(fit.estimate - truth).mean()])
            corrected, fitted = np.sqrt(np.mean(wrong, axis=0))
            assert corrected <= 1.01 * fitted
    assert count.passes == 2 * 3 * 3 * 20


UNUSED: dict[str, dict[str, Any]] = {
    "weights": {"weights": np.linspace(1, 2, 300)},
    "equal weights": {"weights": np.ones(300)},
    "at": {"at": np.linspace(3, 280, 50)},
    "duration": {"window_duration": 21.0, "window_length": None},
    "nan": {"mode": "nan"},
    "valid": {"mode": "valid"},
    "shrink": {"edge_window": "shrink"},
    "max_gain": {"max_gain": 1e6},
    "min_support": {"min_support": 5},
    "degree 1": {"degree": 1},
    "degree 0": {"degree": 0, "deriv": 0},
    "root": {"tau": "root"},
    "center of an even window": {"window_length": 20},
    "center of orders of an even window": {"window_length": 20, "deriv": (0, 1, 2)},
}


@pytest.mark.parametrize("name", UNUSED)
def test_calls_for_which_there_are_only_fits(name: str, count: Count) -> None:
    t, x = noisy(4)
    call = {key: value for key, value in {**WINDOW, **UNUSED[name]}.items() if value is not None}
    if call.get("tau") == "root":
        assert algdiff.Differentiator(21, 1, degree=3, tau="root").exactness > 3
    if "center" in name:
        assert max(one.exactness for one in algdiff.Differentiator(20, (0, 1, 2), degree=3).orders) > 3
    found, fit = differentiate(x, t=t, **call), differentiate(x, t=t, return_std=True, **call)
    np.testing.assert_array_equal(found, fit.estimate)
    assert count.passes == 0


@pytest.mark.parametrize("more", ["return_std", "return_support", "return_bias"])
def test_what_asks_for_more_is_fitted(more: str, count: Count) -> None:
    t, x = noisy(5)
    words: dict[str, Any] = {more: True}
    differentiate(x, t=t, **WINDOW, **words)
    assert count.passes == 0
    differentiate(x, t=t, **WINDOW)
    assert count.passes == 2


@pytest.mark.parametrize("policy", ["omit", "propagate"])
def test_missing_samples_are_fitted_around(policy: str, count: Count) -> None:
    t, x = noisy(6)
    x[100] = np.nan
    found = differentiate(x, t=t, nan_policy=policy, **WINDOW)
    fit = differentiate(x, t=t, nan_policy=policy, return_std=True, **WINDOW)
    np.testing.assert_array_equal(found, fit.estimate)
    assert np.isnan(found).sum() == (21 if policy == "propagate" else 0)
    assert count.passes == 0
    # None is missing: "omit" changes nothing.
    t, x = noisy(6)
    np.testing.assert_array_equal(differentiate(x, t=t, nan_policy=policy, **WINDOW), differentiate(x, t=t, **WINDOW))


def test_the_largest_jitter(count: Count) -> None:
    for late in (0.9 * jitter.LARGEST, 1.1 * jitter.LARGEST, 0.3):
        t, x = noisy(7, late=0)
        t[100], t[200] = t[100] + late, t[200] - late
        count.passes = 0
        _, fit, found = shares(t, x, **WINDOW)
        assert (count.passes > 0) == (late < jitter.LARGEST)
        assert np.array_equal(found, fit.estimate) == (late > jitter.LARGEST)


@pytest.mark.parametrize("tau", ["center", "newest", 0.3])
def test_without_noise_polynomials_come_back(tau: Any) -> None:
    rng = np.random.default_rng(84)
    t = clock(rng, 300, 0.01)
    x = 3 - 2 * (t / 100) + (t / 100) ** 3
    exact = [x, -0.02 + 3 * t**2 / 1e6, 6 * t / 1e6]
    fit = differentiate(x, 21, (0, 1, 2), degree=3, t=t, tau=tau, return_std=True, sigma=1.0)
    found = differentiate(x, 21, (0, 1, 2), degree=3, t=t, tau=tau)
    np.testing.assert_array_equal(found, fit.estimate)
    # Rounding is noise of level eps |x|, at worst of one sign: sqrt(21) of its standard deviations.
    assert (np.abs(found - exact) <= 100 * EPS * np.abs(x).max() * fit.std).all()


def test_signals_too_curved_for_the_noise_are_fitted(count: Count) -> None:
    rng = np.random.default_rng(85)
    t = clock(rng, 300, 0.02)
    noise = rng.standard_normal(300)
    curved = []
    for level in (0.3, 1e-3, 1e-5, 0.0):
        count.passes = 0
        _, fit, found = shares(t, np.sin(t / 10) + level * noise, **WINDOW)
        curved.append(np.array_equal(found, fit.estimate))
    assert curved == [False, True, True, True]
    # One row without noise is enough.
    rows = np.stack([np.sin(t / 10) + 0.3 * noise, np.sin(t / 10)])
    _, fit, found = shares(t, rows, **WINDOW)
    np.testing.assert_array_equal(found, fit.estimate)


@pytest.mark.parametrize("shape", [(0, 300), (3, 0, 300)])
def test_no_rows_at_all(shape: tuple[int, ...]) -> None:
    t, _ = noisy(8)
    assert differentiate(np.ones(shape), t=t, **WINDOW).shape == shape
