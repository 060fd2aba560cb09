"""The kind "algebraic" of the package derivative: its values are those of `differentiate`, row by row."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import algdiff

derivative = pytest.importorskip("derivative", reason="needs derivative")
from algdiff.compat.derivative import Algebraic  # noqa: E402

RNG = np.random.default_rng(1)
N = 120
X = np.cumsum(RNG.standard_normal((3, N)), axis=1)
EVEN = 0.25 * np.arange(N)
UNEVEN = np.cumsum(RNG.uniform(0.1, 1.0, N))
WORDS: dict[str, dict[str, Any]] = {
    "window": {"window_length": 11},
    "all": {"window_length": 15, "degree": 4, "kappa": 2.0, "mu": 0.5, "edge_window": "shrink"},
    "duration": {"window_duration": 4.0},
}


@pytest.mark.parametrize("t", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("words", WORDS.values(), ids=WORDS)
def test_values_are_those_of_differentiate(words: dict[str, Any], t: Any) -> None:
    slope = derivative.dxdt(X, t, kind="algebraic", **words)
    assert slope.tobytes() == algdiff.differentiate(X, t=t, **words).tobytes()
    smooth = derivative.smooth_x(X, t, kind="algebraic", **words)
    assert smooth.tobytes() == algdiff.differentiate(X, deriv=0, t=t, **words).tobytes()


@pytest.mark.parametrize("local", [False, True])
def test_without_a_window_one_is_chosen_for_every_row(local: bool) -> None:
    slope = derivative.dxdt(X, EVEN, kind="algebraic", local=local)
    smooth = derivative.smooth_x(X, EVEN, kind="algebraic", local=local)
    for row, x in enumerate(X):
        assert slope[row].tobytes() == algdiff.differentiate(x, t=EVEN, local=local).tobytes()
        assert smooth[row].tobytes() == algdiff.differentiate(x, deriv=0, t=EVEN, local=local).tobytes()


def test_axes_shapes_and_types_are_those_of_their_interface() -> None:
    expected = algdiff.differentiate(X, 11, t=EVEN)
    assert np.array_equal(derivative.dxdt(X.T, EVEN, kind="algebraic", axis=0, window_length=11), expected.T)
    assert np.array_equal(derivative.dxdt(X[0], EVEN, kind="algebraic", window_length=11), expected[0])
    whole = np.rint(X).astype(int)
    found = derivative.dxdt(whole, EVEN, kind="algebraic", window_length=11)
    assert np.array_equal(found, algdiff.differentiate(whole, 11, t=EVEN))
    twisted = derivative.dxdt(X + 1j * X[::-1], EVEN, kind="algebraic", window_length=11)
    assert np.array_equal(twisted, algdiff.differentiate(X + 1j * X[::-1], 11, t=EVEN))
    assert derivative.dxdt(np.empty(0), np.empty(0), kind="algebraic").size == 0


def test_single_samples_are_those_of_the_row() -> None:
    method = Algebraic(11)
    assert method.compute(UNEVEN, X[0], 7) == algdiff.differentiate(X[0], 11, t=UNEVEN)[7]
    assert method.compute_x(UNEVEN, X[0], -1) == algdiff.differentiate(X[0], 11, 0, t=UNEVEN)[-1]


def test_uneven_times_are_not_taken_for_even_ones() -> None:
    # A parabola over uneven times: steps of t[1] - t[0] everywhere would be off by the ratio of the steps.
    slope = derivative.dxdt(UNEVEN**2, UNEVEN, kind="algebraic", window_length=11)
    assert np.allclose(slope, 2 * UNEVEN, rtol=1e-9)
    with pytest.raises(ValueError, match="t must be evenly spaced to choose a window by"):
        derivative.dxdt(X, UNEVEN, kind="algebraic")


def test_missing_samples_are_left_out_if_asked_for() -> None:
    x = X.copy()
    x[:, 40] = np.nan
    assert np.isnan(derivative.dxdt(x, EVEN, kind="algebraic", window_length=11)).sum() == 3 * 11
    found = derivative.dxdt(x, EVEN, kind="algebraic", window_length=11, nan_policy="omit")
    assert found.tobytes() == algdiff.differentiate(x, 11, t=EVEN, nan_policy="omit").tobytes()
    assert not np.isnan(found).any()


@pytest.mark.parametrize(
    ("words", "error", "message"),
    [
        ({"window_length": 121}, ValueError, "window_length must be at most the 120 samples"),
        ({"window_length": 5, "degree": 5}, ValueError, "degree"),
        ({"window_length": 11, "window_duration": 2.0}, ValueError, "window_length or window_duration"),
        ({"window_length": 11, "kappa": -1.0}, ValueError, "kappa"),
        ({"window_length": 11, "nan_policy": "drop"}, ValueError, "nan_policy"),
        ({"window_length": 11, "deriv": 2}, TypeError, "deriv"),
    ],
)
def test_bad_parameters_are_named(words: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        derivative.dxdt(X, EVEN, kind="algebraic", **words)


def test_without_the_package_the_error_says_what_to_install() -> None:
    code = "import sys; sys.modules['derivative'] = None; import algdiff.compat.derivative"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "ImportError: algdiff.compat.derivative needs derivative: pip install derivative" in found.stderr


def test_its_repr_is_a_call() -> None:
    assert repr(Algebraic()) == "Algebraic()"
    call = "Algebraic(window_length=11, degree=4, nan_policy='omit')"
    assert repr(Algebraic(11, degree=4, nan_policy="omit")) == call
    assert repr(Algebraic(window_duration=0.5)) == "Algebraic(window_duration=0.5)"
