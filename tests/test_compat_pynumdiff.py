"""The method for PyNumDiff: values of `differentiate`, in PyNumDiff's own tuner too."""

from __future__ import annotations

import subprocess
import sys
import warnings
from typing import Any

import numpy as np
import pytest

from algdiff import differentiate

with warnings.catch_warnings():
    # It says which of its own methods lack CVXPY.
    warnings.simplefilter("ignore", UserWarning)
    pytest.importorskip("pynumdiff", reason="needs pynumdiff")
from pynumdiff.optimize import method_params_and_bounds, optimize

from algdiff.compat.pynumdiff import algdiff

RNG = np.random.default_rng(4)
N = 150
X = np.cumsum(RNG.standard_normal((N, 3)), axis=0)
EVEN = 0.25 * np.arange(N)
UNEVEN = np.cumsum(RNG.uniform(0.1, 1.0, N))


@pytest.mark.parametrize(("t", "how"), [(0.25, "delta"), (EVEN, "t"), (UNEVEN, "t")], ids=["step", "even", "uneven"])
@pytest.mark.parametrize("words", [{}, {"degree": 4, "kappa": 2.0, "mu": 0.5}], ids=["window", "all"])
def test_values_are_those_of_differentiate(words: dict[str, Any], t: Any, how: str) -> None:
    x_hat, dxdt_hat = algdiff(X, t, 15, **words)
    expected = differentiate(X, 15, (0, 1), axis=0, **{how: t}, **words)
    assert (x_hat.tobytes(), dxdt_hat.tobytes()) == (expected[0].tobytes(), expected[1].tobytes())


def test_without_a_window_signal_and_slope_have_their_own() -> None:
    for x in (X, X[:, 0]):
        x_hat, dxdt_hat = algdiff(x, 0.25)
        assert x_hat.tobytes() == differentiate(x, deriv=0, axis=0, delta=0.25).tobytes()
        assert dxdt_hat.tobytes() == differentiate(x, axis=0, delta=0.25).tobytes()
    with pytest.raises(ValueError, match=r"^dt_or_t must be evenly spaced to choose a window by"):
        algdiff(X, UNEVEN)


def test_shapes_axes_lists_and_types() -> None:
    x_hat, dxdt_hat = algdiff(X, 0.25, 15)
    for found, expected in zip(algdiff(X.T, 0.25, 15, axis=1), (x_hat, dxdt_hat), strict=True):
        assert np.array_equal(found, expected.T)
    for found, expected in zip(algdiff(X[:, 0].tolist(), 0.25, 15), (x_hat, dxdt_hat), strict=True):
        assert np.array_equal(found, expected[:, 0])
    assert [found.dtype for found in algdiff(X.astype("f4"), 0.25, 15)] == ["f4", "f4"]
    whole = np.rint(X).astype(int)
    assert np.array_equal(algdiff(whole, 1, 15)[1], differentiate(whole, 15, axis=0))


def test_nan_and_masked_samples_are_missing_ones() -> None:
    x = X.copy()
    x[40:44, 1] = np.nan
    masked = np.ma.masked_invalid(x)
    expected = differentiate(x, 15, (0, 1), axis=0, delta=0.25, nan_policy="omit")
    assert not np.isnan(expected).any()
    for found in (algdiff(x, 0.25, 15), algdiff(masked, 0.25, 15)):
        assert np.array_equal(found, expected)
    x[60:80, 1] = np.nan
    assert np.isnan(algdiff(x, 0.25, 15)[1][70, 1])
    assert np.isfinite(algdiff(x, 0.25)[1][:, [0, 2]]).all()


@pytest.mark.parametrize(
    ("t", "words", "error", "message"),
    [
        (
            1,
            {"window_length": 15, "degree": 150},
            np.linalg.LinAlgError,
            r"x must .* degree \+ 1 = 151 samples, got 150",
        ),
        (
            1,
            {"window_length": 15, "window_duration": 9.0},
            ValueError,
            "give window_length or window_duration, not both",
        ),
        (1, {"window_duration": -1.0}, ValueError, "window_duration"),
        (float("inf"), {"window_length": 15}, ValueError, "^dt_or_t must be finite"),
        (np.zeros(150), {"window_length": 15}, ValueError, "^dt_or_t must be strictly monotone"),
        (1, {"window_length": 15, "degree": 0}, ValueError, "degree"),
        (1, {"window_length": 15.5}, TypeError, "window_length must be an integer, got 15.5"),
        (1, {"window_length": 15, "kappa": -1}, ValueError, "kappa"),
        (1, {"window_length": 15, "axis": 2}, ValueError, "axis must be from -2 to 1"),
        (-1, {"window_length": 15}, ValueError, "dt_or_t must be a positive step or the times of the samples, got -1"),
        (EVEN[::-1][:-1], {"window_length": 15}, ValueError, "^dt_or_t must have one time for each of the 150 samples"),
    ],
)
def test_bad_parameters_are_named(t: Any, words: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        algdiff(X, t, **words)


@pytest.mark.parametrize(("t", "how"), [(0.25, "delta"), (EVEN, "t"), (UNEVEN, "t")], ids=["step", "even", "uneven"])
def test_a_window_of_a_duration(t: Any, how: str) -> None:
    found = algdiff(X, t, window_duration=4.0)
    expected = differentiate(X, deriv=(0, 1), axis=0, window_duration=4.0, **{how: t})
    assert np.array_equal(found, expected)


@pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")
@pytest.mark.parametrize(("words", "taken"), [({"window_length": 9999}, 150), ({"window_length": 5, "degree": 6}, 7)])
def test_windows_that_do_not_fit_are_clipped_with_a_warning(words: dict[str, Any], taken: int) -> None:
    with pytest.warns(UserWarning, match=f"window_length must be from . to 150, got .*: {taken} is taken") as caught:
        found = algdiff(X, 0.25, **words)
    assert caught[0].filename == __file__
    assert np.array_equal(found, algdiff(X, 0.25, **{**words, "window_length": taken}))


STEP = 0.005
T = STEP * np.arange(1001)
SIGNAL = np.tanh(T - 1) + np.exp(-T / 1.2) * np.sin(6 * T + np.pi)
SLOPE = np.cosh(T - 1) ** -2.0 + np.exp(-T / 1.2) * (6 * np.cos(6 * T + np.pi) - np.sin(6 * T + np.pi) / 1.2)
NOISY = SIGNAL + 0.05 * np.random.default_rng(0).standard_normal(T.size)


def error(*words: Any, **more: Any) -> float:
    return float(np.sqrt(np.mean((algdiff(NOISY, STEP, *words, **more)[1] - SLOPE) ** 2)))


# Newer Pythons warn of forks in processes with threads, of which the test runner has some.
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_the_tuner_finds_parameters_with_one_process_or_several() -> None:
    found, cost = optimize(algdiff, NOISY, STEP, bandlimit=1, parallel=False)
    assert set(found) == {"window_length", "degree", "kappa", "mu"}
    assert found["window_length"] % 2 == 1
    # The signal turns at 6 rad/s. Windows of a tenth and of three turns are wrong, the one by noise, the other by bias.
    assert error(**found) < 0.5 * min(error(21), error(629))
    space = {"degree": 4, "window_length": [31, 131]}
    one, several = (
        optimize(algdiff, NOISY, STEP, bandlimit=1, parallel=parallel, search_space_updates=space)
        for parallel in (False, True)
    )
    assert one == several
    assert one[1] >= cost


def test_the_tuner_told_the_truth_is_no_worse_than_its_first_guesses() -> None:
    found, cost = optimize(algdiff, NOISY, STEP, dxdt_truth=SLOPE, parallel=False)
    assert np.isclose(cost, error(**found), rtol=1e-12)
    space = method_params_and_bounds[algdiff][0]
    assert cost <= min(error(window, degree) for window in space["window_length"][2:] for degree in space["degree"])


def test_the_tuner_survives_short_samples() -> None:
    found, cost = optimize(algdiff, NOISY[:60], STEP, bandlimit=1, parallel=False)
    assert cost < 1
    if found["window_length"] > 60:  # what was taken is all of them
        with pytest.warns(UserWarning, match="60 is taken"):
            algdiff(NOISY[:60], STEP, **found)


# Of medians of nothing.
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_the_tuner_with_missing_samples_needs_the_truth() -> None:
    """Without it all costs are NaN, which it says: the cost of windows that do not fit was the best of them."""
    x = NOISY.copy()
    x[300:304] = np.nan
    space = {"window_length": [5, 131]}
    found, cost = optimize(algdiff, x, STEP, dxdt_truth=SLOPE, parallel=False, search_space_updates=space)
    assert cost < 0.3
    assert found["window_length"] > 60
    with pytest.raises(ValueError, match="All-NaN"):
        optimize(algdiff, x, STEP, bandlimit=1, parallel=False, search_space_updates=space)


def test_the_tuner_by_powell_returns_a_window_that_fits() -> None:
    space = {"degree": 4, "window_length": [15, 131]}
    found, cost = optimize(
        algdiff,
        NOISY[:500],
        STEP,
        dxdt_truth=SLOPE[:500],
        opt_method="Powell",
        parallel=False,
        search_space_updates=space,
    )
    assert 60 < found["window_length"] <= 500
    assert cost < 0.2


def test_without_the_package_the_error_says_what_to_install() -> None:
    code = "import sys; sys.modules['pynumdiff'] = None; import algdiff.compat.pynumdiff"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "ImportError: algdiff.compat.pynumdiff needs pynumdiff: pip install pynumdiff" in found.stderr
