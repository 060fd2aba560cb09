"""`differentiate` against the reference: every mode, dtype and axis over a seeded sample of the grid of designs."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import algdiff
import reference
from support import EPS, conditioning, difference_bound, sum_bound

MODES = ["fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"]
DTYPES = [np.float64, np.float32, np.complex128, np.complex64, np.int16, np.float16]
EXPONENTS = [(0.0, 0.0), (1.0, 1.0), (-0.5, -0.5), (10.0, 10.0), (2.5, 0.5), (-0.5, 3.0), (1.0, 0.0)]
SINGLE = float(np.finfo(np.float32).eps)


def signal(rng: np.random.Generator, shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    x = 100 * rng.standard_normal(shape)
    if np.dtype(dtype).kind == "c":
        x = x + 100j * rng.standard_normal(shape)
    return x.astype(dtype)


def weights_used(length: int, options: dict[str, Any]) -> np.ndarray:
    """Return the largest weights, in the sense of sum|w|, that any output of the run uses."""
    grid = (np.arange(length) + 0.5) / length if options["rule"] == "exact" else np.linspace(0, 1, length)
    names = ("deriv", "degree", "kappa", "mu")
    arguments = [options[name] for name in names]
    candidates = [
        reference.weights(length, *arguments, tau, options["rule"], options["delta"]) for tau in (*grid, options["tau"])
    ]
    return max(candidates, key=lambda w: float(np.abs(w).sum()))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("mode", MODES)
def test_equals_the_reference(mode: str, dtype: Any) -> None:
    rng = np.random.default_rng([MODES.index(mode), DTYPES.index(dtype)])
    for _ in range(25):
        deriv = int(rng.integers(0, 5))
        degree = deriv + int(rng.integers(0, 5))
        length = degree + 1 + int(rng.choice([0, 1, 2, 5, 10, 24]))
        kappa, mu = EXPONENTS[rng.integers(len(EXPONENTS))]
        rule = "exact" if min(kappa, mu) < 0 or length < 3 else str(rng.choice(["exact", "exact", "trapezoid"]))
        tau = [0.5, "center", "root", "newest", 0.3, 1.1, -0.2][rng.integers(7)]
        options: dict[str, Any] = {"deriv": deriv, "degree": degree, "kappa": kappa, "mu": mu, "tau": tau, "rule": rule}
        options["delta"] = float(rng.choice([1.0, 0.01, 3.0]))
        least = 1 if mode in reference.PAD_MODES else length
        count = int(rng.integers(least, 3 * length + 4))
        axis = int(rng.integers(-2, 2))
        shape = (count, 3) if axis in (0, -2) else (3, count)
        x = signal(rng, shape, dtype)
        extra = {"mode": mode, "cval": 7.0} if mode == "constant" else {"mode": mode}
        expected = reference.differentiate(x, length, axis=axis, **options, **extra)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", algdiff.DesignWarning)
            got = algdiff.differentiate(x, length, axis=axis, **options, **extra)
        assert got.dtype == {"f": np.float32, "c": np.complex64}.get(
            np.dtype(dtype).kind if np.dtype(dtype) in (np.float32, np.complex64) else "",
            np.result_type(np.float64, dtype),
        )
        eps = SINGLE if got.dtype in (np.float32, np.complex64) else EPS
        weights = weights_used(length, options)
        # The designs themselves differ by 64 eps times their conditioning, see test_weights.
        designs = 64 * EPS * conditioning(length, min(degree + 1, length - 1), kappa, mu)
        bound = 2 * sum_bound(weights, [*np.ravel(x), 7.0], eps)
        bound += designs * length * float(np.abs(weights).max() * np.abs(x).max())
        np.testing.assert_allclose(got, expected, rtol=eps, atol=bound, err_msg=f"{length} {options} {extra} {shape}")


@pytest.mark.parametrize("axis", range(-4, 4))
def test_every_axis_of_an_array(axis: int) -> None:
    x = np.random.default_rng(5).standard_normal((13, 14, 17, 18))
    expected = np.apply_along_axis(lambda row: algdiff.differentiate(row, 9), axis, x)
    np.testing.assert_array_equal(algdiff.differentiate(x, 9, axis=axis), expected)
    single = x.astype(np.float32)
    expected = np.apply_along_axis(lambda row: algdiff.differentiate(row, 9), axis, single)
    np.testing.assert_array_equal(algdiff.differentiate(single, 9, axis=axis), expected)


@pytest.mark.parametrize("engine", ["direct", "moments"])  # "fft" rounds extended columns in its own way
@pytest.mark.parametrize("mode", MODES)
def test_long_columns_equal_long_rows(mode: str, engine: str) -> None:
    # Longer than any block inside, so that every seam of tasks, columns and slices is crossed.
    x = np.random.default_rng(6).standard_normal((20_011, 11))
    columns = algdiff.differentiate(x, 257, axis=0, mode=mode, engine=engine)
    rows = algdiff.differentiate(np.ascontiguousarray(x.T), 257, mode=mode, engine=engine)
    np.testing.assert_array_equal(columns, rows.T)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("length", [2, 5, 61, 1001])
def test_around_every_block_edge(length: int, dtype: Any) -> None:
    rng = np.random.default_rng(length)
    design = algdiff.Differentiator(length, degree=1, tau="newest")
    x = rng.standard_normal(length + 8200).astype(dtype)
    expected = np.convolve(x.astype(float), design.weights[::-1], "valid")
    for count in [0, 1, 7, 8, 9, 31, 32, 33, 63, 64, 65, 4095, 4096, 4097, 8191, 8192, 8193]:
        got = design(x[: length + count], mode="valid")
        eps = EPS if dtype is np.float64 else SINGLE
        bound = sum_bound(design.weights, x, eps) + sum_bound(design.weights, x)
        np.testing.assert_allclose(got, expected[: count + 1], rtol=0, atol=bound)


def test_float32_is_computed_in_single_precision_with_a_double_design() -> None:
    rng = np.random.default_rng(8)
    x = rng.standard_normal(5000).astype(np.float32)
    design = algdiff.Differentiator(101, 2, delta=1e-3)
    error = np.abs(design(x) - design(x.astype(np.float64)))
    assert error.max() <= difference_bound(design.weights, x, SINGLE) + SINGLE * np.abs(design(x)).max()
    # Tiny and huge units neither overflow nor vanish on the way.
    tiny = algdiff.Differentiator(41, 4, delta=1e-11)
    np.testing.assert_allclose(tiny(x * np.float32(1e-20)), tiny(x.astype(float) * 1e-20), rtol=2e-3, atol=1e18)


def test_object_and_function_are_the_same() -> None:
    x = np.random.default_rng(9).standard_normal((3, 100))
    options: dict[str, Any] = {"degree": 3, "kappa": 0.5, "mu": 2.0, "tau": "root", "delta": 0.1}
    design = algdiff.Differentiator(21, 2, **options)
    np.testing.assert_array_equal(design(x), algdiff.differentiate(x, 21, 2, **options))
    by_rate = {**options, "fs": 10.0}
    del by_rate["delta"]
    np.testing.assert_array_equal(design(x), algdiff.differentiate(x, 21, 2, **by_rate))
    by_delay = {**options, "delay": design.delay}
    del by_delay["tau"]
    np.testing.assert_allclose(design(x), algdiff.differentiate(x, 21, 2, **by_delay), rtol=0, atol=1e-9)
