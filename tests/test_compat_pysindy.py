"""The differentiation method for PySINDy: values of `differentiate`, in SINDy itself too."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import algdiff

pysindy = pytest.importorskip("pysindy", reason="needs pysindy")
from sklearn.base import clone  # noqa: E402

import algdiff.compat.derivative  # noqa: E402
from algdiff.compat.pysindy import AlgebraicDifferentiation  # noqa: E402

RNG = np.random.default_rng(2)
N = 150
X = np.cumsum(RNG.standard_normal((N, 3)), axis=0)
EVEN = 0.25 * np.arange(N)
UNEVEN = np.cumsum(RNG.uniform(0.1, 1.0, N))
WORDS: dict[str, dict[str, Any]] = {
    "window": {"window_length": 11},
    "all": {"window_length": 15, "degree": 4, "kappa": 2.0, "mu": 0.5},
    "duration": {"window_duration": 4.0},
    "nan": {"window_length": 11, "mode": "nan"},
}


@pytest.mark.parametrize(("t", "how"), [(0.25, "delta"), (EVEN, "t"), (UNEVEN, "t")], ids=["step", "even", "uneven"])
@pytest.mark.parametrize("words", WORDS.values(), ids=WORDS)
def test_values_are_those_of_differentiate(words: dict[str, Any], t: Any, how: str) -> None:
    method = AlgebraicDifferentiation(**words)
    smooth, slope = algdiff.differentiate(X, deriv=(0, 1), axis=0, **{how: t}, **words)
    assert np.array_equal(method(X, t), slope, equal_nan=True)
    assert np.array_equal(method.smoothed_x_, smooth, equal_nan=True)
    assert np.isnan(slope).any() == (words.get("mode") == "nan")


def test_without_a_window_signal_and_slope_have_their_own() -> None:
    method = AlgebraicDifferentiation()
    assert method(X, 0.25).tobytes() == algdiff.differentiate(X, axis=0, delta=0.25).tobytes()
    assert method.smoothed_x_.tobytes() == algdiff.differentiate(X, deriv=0, axis=0, delta=0.25).tobytes()
    with pytest.raises(ValueError, match="t must be evenly spaced to choose a window by"):
        method(X, UNEVEN)


def test_a_window_for_each_coordinate() -> None:
    method = AlgebraicDifferentiation(per_coordinate=True)
    x = X + np.array([0, 0, 100]) * np.sin(EVEN)[:, None]
    columns = [algdiff.differentiate(column, delta=0.25) for column in x.T]
    assert np.array_equal(method(x, 0.25), np.stack(columns, 1))
    assert not np.array_equal(AlgebraicDifferentiation()(x, 0.25), np.stack(columns, 1))
    given = AlgebraicDifferentiation(11, per_coordinate=True)(X.reshape(2, 75, 3), 0.25)
    assert np.array_equal(given, AlgebraicDifferentiation(11)(X.reshape(2, 75, 3), 0.25))


def test_shapes_axes_orders_and_smoothing() -> None:
    stack = X.reshape(2, 75, 3)
    expected = algdiff.differentiate(stack, 11, 2, axis=1, degree=4, delta=0.25)
    method = AlgebraicDifferentiation(11, d=2, degree=4, save_smooth=False)
    assert np.array_equal(method(stack, 0.25), expected)
    assert method.smoothed_x_ is stack
    assert np.array_equal(AlgebraicDifferentiation(11, axis=0)(X, 0.25), AlgebraicDifferentiation(11)(X, 0.25))
    assert np.array_equal(AlgebraicDifferentiation(11)(X[:, 0], 0.25), algdiff.differentiate(X[:, 0], 11, delta=0.25))
    whole = np.rint(X).astype(int)
    assert np.array_equal(AlgebraicDifferentiation(11)(whole, 1), algdiff.differentiate(whole, 11, axis=0))


@pytest.mark.parametrize(
    ("words", "t", "message"),
    [
        ({"window_length": 151}, 1, "window_length must be at most the 150 samples"),
        ({"window_length": 5, "degree": 5}, 1, "degree"),
        ({"window_length": 11, "window_duration": 2.0}, 1, "window_length or window_duration"),
        ({"window_length": 11, "mode": "valid"}, 1, "mode must be 'fit' or 'nan', got 'valid'"),
        ({"window_length": 11, "d": -1}, 1, "deriv"),
        ({"window_length": 11}, -0.1, "t must be a positive step or the times of the samples, got -0.1"),
        ({"window_length": 11}, EVEN[:-1], "t must have one time for each of the 150 samples"),
    ],
)
def test_bad_parameters_are_named(words: dict[str, Any], t: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        AlgebraicDifferentiation(**words)(X, t)


def test_it_is_an_estimator_of_scikit_learn() -> None:
    method = AlgebraicDifferentiation(21, kappa=2.0)
    assert clone(method).get_params() == method.get_params()
    assert method.set_params(window_length=11, kappa=1.0)(X).tobytes() == AlgebraicDifferentiation(11)(X).tobytes()
    model = pysindy.SINDy(differentiation_method=method)
    assert model.get_params()["differentiation_method__window_length"] == 11


def oscillation(t: Any, sigma: float, seed: int) -> Any:
    """Return noisy samples of ``x0' = -0.1 x0 + 2 x1, x1' = -2 x0 - 0.1 x1``."""
    clean = 2 * np.exp(-0.1 * t)[:, None] * np.stack([np.cos(2 * t), -np.sin(2 * t)], 1)
    return clean + sigma * np.random.default_rng(seed).standard_normal(clean.shape)


TRUE = np.array([[0, -0.1, 2.0, 0, 0, 0], [0, -2.0, -0.1, 0, 0, 0]])


def fitted(method: Any, x: Any, t: Any) -> Any:
    model = pysindy.SINDy(
        pysindy.STLSQ(threshold=0.05), pysindy.PolynomialLibrary(degree=2), differentiation_method=method
    )
    return model.fit(x, t=t)


@pytest.mark.parametrize("method", [AlgebraicDifferentiation(), AlgebraicDifferentiation(201, mode="nan")])
def test_sindy_finds_a_noisy_oscillator_and_its_default_does_not(method: Any) -> None:
    t = np.arange(0, 25, 0.01)
    x = oscillation(t, 0.2, 1)
    found = fitted(method, x, t).coefficients()
    assert np.array_equal(found != 0, TRUE != 0)
    default = fitted(None, x, t).coefficients()
    assert np.linalg.norm(found - TRUE) < 0.2 * np.linalg.norm(default - TRUE)


def test_sindy_takes_several_trajectories_with_steps_or_uneven_times() -> None:
    t = [np.arange(0, 12, 0.01), np.sort(np.random.default_rng(3).uniform(0, 9, 900))]
    x = [oscillation(one, 0.02, seed) for seed, one in enumerate(t)]
    model = fitted(AlgebraicDifferentiation(window_duration=0.8, degree=4), x, t)
    assert np.allclose(model.coefficients(), TRUE, atol=0.02)
    assert model.score(x, t) > 0.99
    steps = fitted(AlgebraicDifferentiation(), [x[0], x[0][:900]], [0.01, 0.01])
    assert np.allclose(steps.coefficients(), TRUE, atol=0.02)


def test_it_takes_derivatives_in_space_too() -> None:
    space, t = np.linspace(0, 2 * np.pi, 64), np.linspace(0, 1, 40)
    waves = [(1, 0.3, 0.2), (2, 0.1, 0.5), (3, 0.2, 0.9)]
    heat = sum(a * np.exp(-0.2 * k**2 * t) * np.sin(k * space + p)[:, None] for k, a, p in waves)[..., None]
    library = pysindy.PDELibrary(
        function_library=pysindy.PolynomialLibrary(degree=1, include_bias=False),
        derivative_order=2,
        spatial_grid=space,
        include_interaction=False,
        differentiation_method=AlgebraicDifferentiation,
        diff_kwargs={"window_length": 11, "degree": 4},
    )
    method = AlgebraicDifferentiation(11, degree=4)
    model = pysindy.SINDy(pysindy.STLSQ(threshold=0.05), library, differentiation_method=method).fit(heat, t=t)
    assert model.get_feature_names() == ["x0", "x0_1", "x0_11"]
    assert np.allclose(model.coefficients(), [[0, 0, 0.2]], atol=0.005)


def test_through_the_package_derivative() -> None:
    method = pysindy.SINDyDerivative(kind="algebraic", window_length=11)
    assert np.array_equal(method(X, EVEN), algdiff.differentiate(X, 11, axis=0, t=EVEN))
    assert np.array_equal(method.smoothed_x_, algdiff.differentiate(X, 11, 0, axis=0, t=EVEN))


def test_without_the_package_the_error_says_what_to_install() -> None:
    code = "import sys; sys.modules['pysindy.differentiation'] = None; import algdiff.compat.pysindy"
    code = code.replace("pysindy.differentiation'", "pysindy'")
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "ImportError: algdiff.compat.pysindy needs pysindy: pip install pysindy" in found.stderr
