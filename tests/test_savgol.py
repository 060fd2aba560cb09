"""SciPy's functions: the same results where SciPy is right, right results where it is not."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from scipy import signal

import algdiff
import reference
from support import conditioning

MODES = ["interp", "mirror", "nearest", "constant", "wrap"]


def scipys_error(window_length: int, polyorder: int, pos: float) -> float:
    """Return a bound for the relative error of SciPy's coefficients, which it solves for in powers of the index."""
    powers = np.vander(np.arange(window_length) - pos, polyorder + 1)
    return 8 * float(np.finfo(float).eps * np.linalg.cond(powers))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("parity", ["odd", "even"])
def test_random_filters_agree(mode: str, parity: str) -> None:
    """Together 600 random calls, to 1e-11 of the largest sample: SciPy's own edge fits err by 2e-12 at degree 6.

    Windows and degrees at which SciPy's coefficients are not known to 1e-11 themselves are drawn again.
    """
    rng = np.random.default_rng([MODES.index(mode), parity == "odd"])
    for _ in range(60):
        error = 1.0
        while error > 1e-11:
            polyorder = int(rng.integers(0, 7))
            window_length = polyorder + 1 + int(rng.integers(0, 60))
            window_length += (window_length % 2 == 0) == (parity == "odd")
            error = scipys_error(window_length, polyorder, (window_length - 1) / 2)
        deriv = int(rng.integers(0, min(polyorder, 3) + 2))
        delta = float(rng.choice([1.0, 2.0, -1.5])) if deriv else float(rng.choice([1.0, 0.0]))
        axis = int(rng.integers(-3, 3))
        shape = rng.integers(1, 5, 3)
        shape[axis] = rng.integers(window_length if mode == "interp" else 1, 3 * window_length + 2)
        x = rng.standard_normal(shape) * 10.0 ** rng.integers(-3, 4)
        dtype = [np.float64, np.float32, np.int32, np.float16, bool][rng.integers(5)]
        x = x.astype(dtype)
        options: dict[str, Any] = {"deriv": deriv, "delta": delta, "axis": axis, "mode": mode, "cval": 0.7}
        expected = signal.savgol_filter(x, window_length, polyorder, **options)
        got = algdiff.savgol_filter(x, window_length, polyorder, **options)
        assert got.dtype == expected.dtype
        assert got.shape == expected.shape
        largest = max(float(np.abs(x).max(initial=0.0)), 0.7)
        # In single precision both round: SciPy once at the end, we in every one of the window's sums.
        single = (window_length + 8) * float(np.finfo(np.float32).eps) if dtype is np.float32 else 0.0
        weights = signal.savgol_coeffs(window_length, polyorder, deriv, delta, pos=window_length - 1)
        atol = (1e-11 + single * max(1.0, float(np.abs(weights).sum()))) * largest
        np.testing.assert_allclose(got, expected, rtol=0, atol=atol, err_msg=f"{window_length} {polyorder} {options}")


@pytest.mark.parametrize("use", ["conv", "dot"])
def test_random_coefficients_agree(use: str) -> None:
    rng = np.random.default_rng(len(use))
    for _ in range(200):
        polyorder = int(rng.integers(0, 6))
        window_length = polyorder + 1 + int(rng.integers(0, 60))
        deriv = int(rng.integers(0, polyorder + 2))
        pos = rng.choice([None, 0, window_length - 1, int(rng.integers(0, window_length)), window_length / 2 - 0.25])
        delta = float(rng.choice([1.0, 0.1, -2.0]))
        expected = signal.savgol_coeffs(window_length, polyorder, deriv, delta, pos, use)
        got = algdiff.savgol_coeffs(window_length, polyorder, deriv, delta, pos, use)
        place = (window_length - 1) / 2 if pos is None else pos
        ours = 64 * np.finfo(float).eps * conditioning(window_length, polyorder, 0.0, 0.0)
        atol = (scipys_error(window_length, polyorder, place) + ours) * np.abs(expected).max()
        np.testing.assert_allclose(got, expected, rtol=0, atol=atol)
        assert got.flags.writeable


@pytest.mark.parametrize(("window_length", "polyorder", "deriv"), [(1601, 5, 2), (20_001, 3, 2), (101, 20, 1)])
def test_where_scipy_loses_rank_the_result_is_right(window_length: int, polyorder: int, deriv: int) -> None:
    weights = algdiff.savgol_coeffs(window_length, polyorder, deriv, delta=1 / window_length, use="dot")
    expected = reference.weights(
        window_length, deriv, polyorder, 0.0, 0.0, 0.5, delta=1 / window_length, fit_degree=polyorder
    )
    np.testing.assert_allclose(weights, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = signal.savgol_coeffs(window_length, polyorder, deriv, delta=1 / window_length, use="dot")
    # If this fails, SciPy has mended its coefficients, and the docs should say so.
    assert np.abs(theirs - expected).max() > 1e-6 * np.abs(expected).max()


def test_where_scipy_loses_rank_the_filter_reproduces_polynomials() -> None:
    t = np.linspace(-1, 1, 4000)
    step = float(t[1] - t[0])
    got = algdiff.savgol_filter(t**5, 1601, 5, deriv=2, delta=step)
    # The estimate amplifies rounding by at most L eps sum|w|.
    amplification = np.abs(algdiff.savgol_coeffs(1601, 5, 2, step, pos=0)).sum()
    np.testing.assert_allclose(got, 20 * t**3, rtol=0, atol=1601 * np.finfo(float).eps * amplification)


def test_complex_data_keep_their_imaginary_part() -> None:
    rng = np.random.default_rng(1)
    z = rng.standard_normal((4, 60)) + 1j * rng.standard_normal((4, 60))
    got = algdiff.savgol_filter(z, 11, 3, deriv=1, mode="constant", cval=2 - 1j)
    np.testing.assert_array_equal(got.real, algdiff.savgol_filter(z.real, 11, 3, deriv=1, mode="constant", cval=2))
    np.testing.assert_array_equal(got.imag, algdiff.savgol_filter(z.imag, 11, 3, deriv=1, mode="constant", cval=-1))
    assert algdiff.savgol_filter(z.astype(np.complex64), 11, 3).dtype == np.complex64


def test_a_nan_at_the_edge_touches_only_its_windows() -> None:
    # SciPy raises LinAlgError here.
    x = np.arange(40.0)
    x[2] = np.nan
    got = algdiff.savgol_filter(x, 7, 2, deriv=1)
    assert np.isnan(got[:6]).all()
    np.testing.assert_allclose(got[6:], 1, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "wrong",
    [
        {"polyorder": 5},
        {"polyorder": -1},
        {"deriv": -1},
        {"mode": "fit"},
        {"mode": None},
        {"window_length": 41},
        {"window_length": 0},
        {"deriv": 1, "delta": 0.0},
        {"deriv": 1, "delta": float("nan")},
        {"axis": 1},
    ],
    ids=str,
)
def test_scipys_own_limits(wrong: dict[str, Any]) -> None:
    options: dict[str, Any] = {"window_length": 5, "polyorder": 2, **wrong}
    name = {"deriv": "delta" if "delta" in wrong else "deriv"}.get(next(iter(wrong)), next(iter(wrong)))
    with pytest.raises(ValueError, match=name):
        algdiff.savgol_filter(np.zeros(40), **options)


@pytest.mark.parametrize(("window_length", "polyorder"), [(41, 40), (51, 50), (61, 60), (101, 100)])
def test_what_rounding_would_spoil_is_refused(window_length: int, polyorder: int) -> None:
    # Unrefused, 61 samples err by 11 at the ends, and 51 by 1e-3 in the middle.
    x = np.random.default_rng(0).standard_normal(300)
    for mode in MODES:
        with pytest.raises(ValueError, match=f"degree {polyorder} is too high for window_length {window_length}"):
            algdiff.savgol_filter(x, window_length, polyorder, mode=mode)
    # Half the degree is known everywhere: it reproduces polynomials, at the ends too.
    t = np.linspace(-1, 1, 300)
    got = algdiff.savgol_filter(t**3, window_length, polyorder // 2)
    np.testing.assert_allclose(got, t**3, rtol=0, atol=1e-9)


@pytest.mark.parametrize("window_length", [11, 501, 10_001])
def test_single_precision_smooths_data_with_a_large_mean(window_length: int) -> None:
    rng = np.random.default_rng(0)
    x = (1e4 + np.cumsum(rng.standard_normal(20_000))).astype(np.float32)
    exact = algdiff.savgol_filter(x.astype(np.float64), window_length, 2)
    got = algdiff.savgol_filter(x, window_length, 2)
    # The mean costs one rounding; the variation in a window, about 2 sqrt(window), is summed in single precision.
    spread = 2 * np.sqrt(window_length)
    ulp = float(np.spacing(np.float32(x.max())))
    atol = ulp + np.sqrt(window_length) * spread * float(np.finfo(np.float32).eps)
    np.testing.assert_allclose(got, exact, rtol=0, atol=atol)


def test_high_degrees_are_taken_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for window_length in range(1, 22):
            got = algdiff.savgol_coeffs(window_length, window_length - 1, use="dot", pos=0)
            # The polynomial through all samples: it is the sample itself, but for the conditioning of the fit.
            atol = 64 * np.finfo(float).eps * conditioning(window_length, window_length - 1, 0.0, 0.0)
            np.testing.assert_allclose(got, np.eye(window_length)[0], rtol=0, atol=atol)
    with pytest.raises(ValueError, match="pos must be"):
        algdiff.savgol_coeffs(5, 2, pos=5)
    with pytest.raises(ValueError, match="use must be"):
        algdiff.savgol_coeffs(5, 2, use="corr")
