"""Every public function and every nasty array: the right result, or one clear error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import algdiff
from zoo import SIGNAL, awkward, awkward_matrices, refused

Function = Callable[..., Any]

FUNCTIONS: dict[str, Function] = {
    "differentiate": lambda x, **options: algdiff.differentiate(x, 7, **options),
    "Differentiator": lambda x, **options: algdiff.Differentiator(7)(x, **options),
    "savgol_filter": lambda x, **options: algdiff.savgol_filter(x, 7, 3, deriv=1, **options),
    "gradient": lambda x, **options: algdiff.gradient(x, window_length=7, **options),
}


def masks(function: Function) -> bool:
    """Return whether a function knows of missing samples."""
    return function is not FUNCTIONS["savgol_filter"]


@pytest.fixture(params=FUNCTIONS)
def function(request: pytest.FixtureRequest) -> Function:
    return FUNCTIONS[request.param]


def plain(x: Any) -> np.ndarray:
    """Return the same numbers as a fresh native array of the dtype that the library works in."""
    array = np.array(x if not hasattr(x, "__array__") else np.asarray(x))
    if array.dtype.kind == "c":
        return array.astype(np.complex64 if array.dtype.itemsize == 8 else np.complex128)
    return array.astype(np.float32 if array.dtype.kind == "f" and array.dtype.itemsize == 4 else np.float64)


@pytest.mark.parametrize("kind", [name for name, _ in awkward()])
def test_awkward_arrays_give_the_plain_result(function: Function, kind: str) -> None:
    for name, x in awkward():
        if name == kind:
            before = np.array(x, copy=True) if isinstance(x, np.ndarray) else None
            got, expected = function(x), function(plain(x))
            assert type(got) is (
                np.ma.MaskedArray if isinstance(x, np.ma.MaskedArray) and masks(function) else np.ndarray
            )
            assert got.dtype == expected.dtype
            assert got.dtype.isnative
            np.testing.assert_array_equal(got, expected)
            assert np.isfinite(got).all()
            if before is not None:
                np.testing.assert_array_equal(x, before)
    # Not only equal to itself: the plain result is the right one.
    t = np.arange(64.0)
    np.testing.assert_allclose(function(t**2), 2 * t, rtol=0, atol=1e-10)


@pytest.mark.parametrize("axis", [0, 1, -1])
def test_awkward_matrices_give_the_plain_result(function: Function, axis: int) -> None:
    for kind, x in awkward_matrices():
        expected = np.stack([function(row) for row in np.moveaxis(plain(x), axis, -1)])
        got = function(x, axis=axis)
        assert type(got) is np.ndarray
        np.testing.assert_array_equal(got, np.moveaxis(expected, -1, axis), err_msg=kind)


@pytest.mark.parametrize("kind", [name for name, _, _ in refused()])
def test_what_cannot_be_differentiated_is_refused(function: Function, kind: str) -> None:
    for name, x, error in refused():
        if name == kind:
            if name == "masked" and masks(function):
                assert np.ma.is_masked(function(x))
                continue
            with pytest.raises(error) as caught:
                function(x)
            assert str(caught.value)
            assert "\n" not in str(caught.value)
            assert not isinstance(caught.value, algdiff.InternalError)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.complex128])
@pytest.mark.parametrize("place", [0, 5, 30, 62, 63])
def test_what_is_not_finite_touches_only_the_windows_that_contain_it(
    function: Function, value: float, dtype: Any, place: int
) -> None:
    x = SIGNAL.astype(dtype)
    clean = function(x)
    x[place] = value
    got = function(x)
    # The window of output i is i - 3 to i + 3, moved into the data.
    starts = np.clip(np.arange(64) - 3, 0, 57)
    touched = (starts <= place) & (place < starts + 7)
    np.testing.assert_array_equal(got[~touched], clean[~touched])
    assert not np.isfinite(got[touched]).any()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_nan_is_local_in_every_mode_and_order(value: float) -> None:
    x = SIGNAL.copy()
    x[40] = value
    for deriv in range(3):
        d = algdiff.Differentiator(9, deriv)
        for mode in ["fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"]:
            got = d(x, mode=mode)
            offset = 0 if mode == "valid" else 4
            touched = np.zeros(len(got), bool)
            touched[40 - 8 + offset : 41 + offset] = True
            if mode == "nan":
                touched[:4] = touched[-4:] = True
            np.testing.assert_array_equal(~np.isfinite(got), touched, err_msg=f"{deriv} {mode}")


def test_empty_other_axes_give_empty_results(function: Function) -> None:
    for shape, axis in [((0, 20), 1), ((20, 0), 0), ((3, 0, 20), -1)]:
        got = function(np.zeros(shape), axis=axis)
        assert got.shape == shape


def test_virtual_arrays_beyond_memory_are_refused(function: Function) -> None:
    virtual = np.broadcast_to(np.float64(1), 2**45)
    with pytest.raises(MemoryError):
        function(virtual)


@pytest.mark.parametrize("window_length", [2**17, 2**31, 2**45, 2**63 - 1, 2**63, 2**64, 10**30])
def test_huge_windows_are_refused(window_length: int) -> None:
    calls = [
        lambda: algdiff.differentiate(SIGNAL, window_length),
        lambda: algdiff.savgol_filter(SIGNAL, window_length, 3),
        lambda: algdiff.gradient(SIGNAL, window_length=window_length),
    ]
    if window_length > 2**30:  # shorter ones are legal where the data are extended
        calls.append(lambda: algdiff.differentiate(SIGNAL, window_length, mode="nearest"))
        calls.append(lambda: algdiff.savgol_coeffs(window_length, 3))
        calls.append(lambda: algdiff.Differentiator(window_length))
    for call in calls:
        with pytest.raises((ValueError, MemoryError), match="window_length must be"):
            call()
