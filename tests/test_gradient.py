"""`gradient` against numpy's, and with a window against `differentiate`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import algdiff


def arrays(rng: np.random.Generator) -> Any:
    """Return an array of random shape and dtype and random spacings for it."""
    shape = tuple(int(size) for size in rng.integers(3, 9, rng.integers(1, 4)))
    f = (10 * rng.standard_normal(shape)).astype([np.float64, np.float32, np.int64, np.complex128][rng.integers(4)])
    if f.ndim == 1 and rng.random() < 0.5:
        f = f.tolist()
    spacings: list[tuple[Any, ...]] = [
        (),
        (0.5,),
        tuple(rng.uniform(0.1, 2, len(shape))),
        tuple(np.sort(rng.uniform(0, 9, size)) + np.arange(size) for size in shape),
    ]
    return f, len(shape), spacings[rng.integers(4)]


def test_without_a_window_it_is_numpys() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        f, ndim, spacing = arrays(rng)
        axis = None
        if len(spacing) < 2 and rng.random() < 0.5:
            axis = int(rng.integers(-ndim, ndim)) if rng.random() < 0.5 else tuple(range(ndim))
            spacing = spacing if np.ndim(spacing[0] if spacing else 0) == 0 else ()
        options = {"axis": axis, "edge_order": int(rng.integers(1, 3))}
        expected, got = np.gradient(f, *spacing, **options), algdiff.gradient(f, *spacing, **options)
        assert isinstance(got, tuple) == isinstance(expected, (tuple, list))
        pairs = zip(got, expected, strict=True) if isinstance(got, tuple) else [(got, expected)]
        for ours, theirs in pairs:
            assert ours.dtype == theirs.dtype
            np.testing.assert_array_equal(ours, theirs)


def test_a_window_of_three_is_the_central_difference() -> None:
    rng = np.random.default_rng(1)
    f = rng.standard_normal((20, 30))
    options: dict[str, Any] = {"window_length": 3, "degree": 2, "kappa": 0, "mu": 0}
    for spacing in [(), (0.5,), (0.5, 3.0), (np.arange(20) * 0.5, np.linspace(7, -2, 30))]:
        ours, theirs = algdiff.gradient(f, *spacing, **options), np.gradient(f, *spacing, edge_order=2)
        assert isinstance(ours, tuple)
        for got, expected in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(got, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_a_window_is_that_of_differentiate() -> None:
    f = np.random.default_rng(2).standard_normal((40, 50))
    options: dict[str, Any] = {"degree": 3, "kappa": 0.5, "mu": 2, "tau": "root"}
    rows, columns = algdiff.gradient(f, 0.1, 0.2, window_length=11, mode="mirror", **options)
    expected = algdiff.differentiate(f, 11, delta=0.1, axis=0, mode="mirror", **options)
    np.testing.assert_array_equal(rows, expected)
    np.testing.assert_array_equal(columns, algdiff.differentiate(f, 11, delta=0.2, axis=1, mode="mirror", **options))
    one = algdiff.gradient(f, np.arange(50) * 0.2 + 1e3, axis=1, window_length=11, mode="mirror", **options)
    assert isinstance(one, np.ndarray)
    np.testing.assert_allclose(one, columns, rtol=1e-9, atol=1e-9)
    descending = algdiff.gradient(f, np.arange(50)[::-1] * 0.2, axis=-1, window_length=11, mode="mirror", **options)
    np.testing.assert_allclose(descending, -columns, rtol=1e-12, atol=1e-12)
    assert isinstance(algdiff.gradient(f, axis=(0, 1), window_length=11), tuple)
    assert isinstance(algdiff.gradient(f, axis=(1,), window_length=11), np.ndarray)
    assert algdiff.gradient(f.astype(np.float32), window_length=11, axis=0).dtype == np.float32  # type: ignore[union-attr]


@pytest.mark.parametrize("shape", [(20,), (20, 21), (16, 14, 15)])
@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.complex64, np.int16])
def test_smooth_is_partial(shape: tuple[int, ...], dtype: Any) -> None:
    f = (10 * np.random.default_rng(3).standard_normal(shape)).astype(dtype)
    ndim = len(shape)
    windows, steps = [9, 10, 11][:ndim], [0.5, -2.0, 3.0][:ndim]
    coordinates = [7 + step * np.arange(size) for step, size in zip(steps, shape, strict=True)]
    options: dict[str, Any] = {"window_length": windows, "mode": "nearest", "kappa": 0.5, "degree": [3, 2, 4][:ndim]}
    for spacing in (steps, coordinates):
        parts = algdiff.gradient(f, *spacing, smooth=True, **options)
        assert isinstance(parts, tuple) == (ndim > 1)
        for axis, part in enumerate(parts if isinstance(parts, tuple) else (parts,)):
            # The orders of one pass, or each in its own: the direct engine, which these windows take, gives one result.
            deriv = [int(axis == one) for one in range(ndim)]
            np.testing.assert_array_equal(part, algdiff.partial(f, deriv, spacing=spacing, **options))
            alone = algdiff.partial(f, deriv, spacing=spacing, smooth=False, **options)
            plain = algdiff.gradient(f, *spacing, **options)
            np.testing.assert_array_equal(plain[axis] if isinstance(plain, tuple) else plain, alone)


def test_smooth_along_the_axes_that_are_named() -> None:
    f = np.random.default_rng(4).standard_normal((20, 21, 22))
    last, first = algdiff.gradient(f, 0.5, axis=(-1, 0), window_length=(9, 7), smooth=True)
    words: dict[str, Any] = {"axes": (-1, 0), "spacing": 0.5, "degree": 3}
    np.testing.assert_array_equal(last, algdiff.partial(f, (1, 0), (9, 7), **words))
    np.testing.assert_array_equal(first, algdiff.partial(f, (0, 1), (9, 7), **words))
    alone = algdiff.gradient(f, axis=1, window_length=9)
    np.testing.assert_array_equal(algdiff.gradient(f, axis=1, window_length=9, smooth=True), alone)
    assert algdiff.gradient(f, axis=(), window_length=9, smooth=True) == ()


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("smooth", [False, True])
def test_uneven_coordinates(sign: int, smooth: bool) -> None:
    rng = np.random.default_rng(5)
    y, x = sign * np.cumsum(rng.uniform(0.1, 1, 30)), np.cumsum(rng.uniform(0.1, 1, 40))
    f = y[:, None] ** 3 - 2 * y[:, None] * x**2
    along_y, along_x = algdiff.gradient(f, y, x, window_length=9, smooth=smooth)
    scale = 2e-13 * np.abs(f).max()
    np.testing.assert_allclose(along_y, 3 * y[:, None] ** 2 - 2 * x**2, rtol=0, atol=scale)
    np.testing.assert_allclose(along_x, -4 * y[:, None] * x, rtol=0, atol=scale)


def test_gaps() -> None:
    t = np.arange(40) * 0.1
    f = np.stack([t**3, t**2])
    f[0, 11:14] = np.nan
    slope = algdiff.gradient(f, 0.1, axis=1, window_length=9, nan_policy="omit")
    np.testing.assert_allclose(slope, [3 * t**2, 2 * t], rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("error", "match", "spacing", "options"),
    [
        (ValueError, "coordinates must have shape", (np.arange(6.0),), {"window_length": 5}),
        (ValueError, "spacing must be finite and not zero", (0.0,), {"window_length": 5}),
        (ValueError, "coordinates must be strictly monotone", (np.zeros(7),), {"window_length": 5}),
        (ValueError, "spacing must be finite and not zero", (float("nan"),), {"window_length": 5}),
        (ValueError, "coordinates must be finite", (np.array([0, 1, 2, np.nan, 4, 5, 6]),), {"window_length": 5}),
        (TypeError, "spacing must be one number or one entry", (1.0, 1.0), {"window_length": 5}),
        (TypeError, "spacing must be a real number", ("1",), {"window_length": 5}),
        (
            TypeError,
            "coordinates must hold",
            (np.arange("2020-01-01", "2020-01-08", dtype="M8[D]"),),
            {"window_length": 5},
        ),
        (ValueError, "edge_order must be 1 or 2", (), {"window_length": 5, "edge_order": 3}),
        (ValueError, "axis must", (), {"window_length": 5, "axis": 1}),
        (ValueError, "axis must name every axis once", (), {"window_length": 5, "axis": (0, 0)}),
        (ValueError, "degree must come with window_length", (), {"degree": 2}),
        (ValueError, "smooth must come with window_length", (), {"smooth": True}),
        (TypeError, "smooth must be True or False, got 5", (), {"window_length": 5, "smooth": 5}),
        (ValueError, "trim must be left out", (), {"window_length": 5, "smooth": True, "trim": 0.1}),
        (ValueError, "delay must be left out", (), {"window_length": 5, "smooth": True, "delay": 1.0}),
        (ValueError, "mode must keep the shape", (), {"window_length": 5, "smooth": True, "mode": "valid"}),
        (ValueError, "window_length must be one for all or one for each of 1", (), {"window_length": (5, 5)}),
        (ValueError, "degree must be one for all or one for each of 1", (), {"window_length": 5, "degree": (2, 2)}),
        (TypeError, "unexpected keywords: window", (), {"window_length": 5, "window": 2}),
        (ValueError, "window_length must be at most the 7 samples", (), {"window_length": 9}),
    ],
)
def test_refusals(error: type[Exception], match: str, spacing: tuple[Any, ...], options: dict[str, Any]) -> None:
    with pytest.raises(error, match=match):
        algdiff.gradient(np.arange(7.0), *spacing, **options)
