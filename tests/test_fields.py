"""Derivatives of arrays of several dimensions against one axis after the other, boxes of weights, and mathematics."""

from __future__ import annotations

import itertools
import tracemalloc
from typing import Any

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial import polynomial

import algdiff
from algdiff import _separable as separable
from algdiff import gradient, hessian, laplacian, partial

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")

Array = np.ndarray[Any, Any]
MODES = ("fit", "nearest", "mirror", "wrap", "constant")
DTYPES = (np.float64, np.float32, np.complex128, np.int64)


class Case:
    """An array, and what is said of the axes along which it is differentiated."""

    def __init__(self, rng: np.random.Generator, ndim: int | None = None, dtype: Any = None) -> None:
        ndim = int(rng.integers(1, 4)) if ndim is None else ndim
        sizes = [int(size) for size in rng.integers(11, 16, ndim)]
        self.f = layout(rng, rng.standard_normal(sizes), DTYPES[rng.integers(4)] if dtype is None else dtype)
        count = int(rng.integers(1, ndim + 1))
        self.axes = [int(axis) for axis in rng.permutation(ndim)[:count]]
        self.windows = [int(length) for length in rng.integers(7, 11, count)]
        self.steps = [float(step) for step in rng.uniform(0.5, 2, count) * rng.choice([-1, 1], count)]
        self.degrees = [int(degree) for degree in rng.integers(2, 5, count)]
        self.window: dict[str, Any] = {"kappa": 0.5, "tau": [0.5, 0.7][rng.integers(2)], "mode": MODES[rng.integers(5)]}
        if self.window["mode"] == "constant":
            self.window["cval"] = 1.5

    def words(self) -> dict[str, Any]:
        """Return keywords for all of it; every other axis by coordinates."""
        spacing: list[Any] = list(self.steps)
        for place in range(0, len(spacing), 2):
            spacing[place] = 7 + self.steps[place] * np.arange(self.f.shape[self.axes[place]])
        axes = tuple(axis - self.f.ndim if axis % 2 else axis for axis in self.axes)
        return {"axes": axes, "window_length": self.windows, "spacing": spacing, "degree": self.degrees, **self.window}

    def reference(self, deriv: tuple[int, ...], smooth: bool) -> Array:
        """Return the derivative, line by line of a copy with wide margins where it goes on with a constant."""
        constant = self.window["mode"] == "constant"
        margin = [(12, 12) if constant and axis in self.axes else (0, 0) for axis in range(self.f.ndim)]
        result = self.f.astype(np.float64) if self.f.dtype.kind == "i" else self.f
        result = np.pad(result, margin, constant_values=1.5) if constant else result
        call = {"mode": "fit" if constant else self.window["mode"]}
        for place, axis in enumerate(self.axes):
            if smooth or deriv[place]:
                one = self.design(place, deriv[place])
                result = np.apply_along_axis(one, axis, result, **call) * np.sign(self.steps[place]) ** deriv[place]
        return result[tuple(slice(12, -12) if wide[0] else slice(None) for wide in margin)]

    def design(self, place: int, order: int) -> algdiff.Differentiator:
        """Return the design along one of the axes."""
        design = {name: value for name, value in self.window.items() if name in ("kappa", "tau")}
        step, degree = abs(self.steps[place]), self.degrees[place]
        return algdiff.Differentiator(self.windows[place], order, degree=degree, delta=step, **design)

    def bound(self, deriv: tuple[int, ...], smooth: bool) -> float:
        """Return a bound for the rounding of a derivative.

        One pass errs by at most (L + 8) (1 + 2 L) eps |w| max|x|, with the largest sum |w| of the sizes of its weights:
        see `support.sum_bound`, where steps are at most 2 max|x|. The next passes multiply this by theirs.
        """
        made = [place for place in range(len(self.axes)) if smooth or deriv[place]]
        top = max(float(np.abs(self.f).max()), 1.5)
        eps = float(np.finfo(np.float32 if self.f.dtype.newbyteorder("=") == np.float32 else np.float64).eps)
        gains = [largest(self.design(place, deriv[place]), self.f.shape[self.axes[place]]) for place in made]
        return rounding([self.windows[place] for place in made]) * eps * float(np.prod(gains)) * top


def rounding(windows: list[int]) -> float:
    """Return how many eps of the largest sum a chain of passes may err by; see `Case.bound`."""
    return float(sum((length + 8) * (1 + 2 * length) for length in windows))


def largest(design: algdiff.Differentiator, size: int) -> float:
    """Return the largest sum of the sizes of the weights, of windows inside and at the ends."""
    return max(float(np.abs(design(np.eye(size), axis=0)).sum(axis=1).max()), design.norm1)


def layout(rng: np.random.Generator, values: Array, dtype: Any) -> Array:
    """Return the values in one of several orders in memory: C, Fortran, strided, reversed or byte-swapped."""
    values = (10 * values * (1 + 1j if np.dtype(dtype).kind == "c" else 1)).astype(dtype)
    which = rng.integers(5)
    if which == 1:
        return np.asfortranarray(values)
    if which == 2:
        return np.repeat(values, 2, axis=-1)[..., ::2]
    if which == 3:
        return np.ascontiguousarray(values[::-1])[::-1]
    return values.astype(values.dtype.newbyteorder()) if which == 4 else values


def test_partial_is_one_axis_after_the_other() -> None:
    rng = np.random.default_rng(0)
    for _ in range(150):
        case, smooth = Case(rng), bool(rng.integers(2))
        deriv = tuple(int(order) for order in rng.integers(0, 3, len(case.axes)))
        before = case.f.copy()
        got, expected = partial(case.f, deriv, smooth=smooth, **case.words()), case.reference(deriv, smooth)
        assert got.shape == case.f.shape
        assert got.dtype == (np.float64 if case.f.dtype.kind == "i" else case.f.dtype.newbyteorder("="))
        np.testing.assert_allclose(got, expected, rtol=0, atol=2 * case.bound(deriv, smooth))
        np.testing.assert_array_equal(case.f, before)


@pytest.mark.parametrize("axes", [axes for n in (1, 2, 3) for axes in itertools.permutations(range(3), n)])
def test_every_subset_of_axes(axes: tuple[int, ...]) -> None:
    case = Case(np.random.default_rng(sum(axes)), ndim=3)
    count = len(axes)
    case.axes, case.windows, case.steps, case.degrees = list(axes), [7, 8, 9][:count], [0.5, -2.0, 1.5][:count], [3] * 3
    case.degrees = case.degrees[:count]
    for deriv, smooth in itertools.product(itertools.product((0, 1, 2), repeat=count), (True, False)):
        got = partial(case.f, deriv, smooth=smooth, **case.words())
        bound = 2 * case.bound(deriv, smooth)
        np.testing.assert_allclose(got, case.reference(deriv, smooth), rtol=0, atol=bound)


def unit(count: int, *places: int) -> tuple[int, ...]:
    """Return the orders of a derivative along each of `places` once."""
    return tuple(places.count(place) for place in range(count))


def test_hessian_and_laplacian_are_partials() -> None:
    rng = np.random.default_rng(1)
    for _ in range(60):
        case, smooth = Case(rng), bool(rng.integers(2))
        words, count = case.words(), len(case.axes)
        every, trace = hessian(case.f, smooth=smooth, **words), laplacian(case.f, smooth=smooth, **words)
        assert every.shape == (count, count, *case.f.shape)
        expected, bound = np.zeros(case.f.shape, trace.dtype), 0.0
        for i, j in itertools.product(range(count), repeat=2):
            deriv = unit(count, i, j)
            part, allowed = case.reference(deriv, smooth), 2 * case.bound(deriv, smooth)
            np.testing.assert_allclose(every[i, j], part, rtol=0, atol=allowed)
            np.testing.assert_array_equal(every[i, j], every[j, i])
            if i == j:
                expected, bound = expected + part, bound + (1 + count) * allowed
        np.testing.assert_allclose(trace, expected, rtol=0, atol=bound)
        assert trace.dtype == every.dtype == partial(case.f, unit(count, 0), **words).dtype


@pytest.mark.parametrize("shape", [(20, 23), (13, 14, 15)])
def test_inside_it_is_a_box_of_weights(shape: tuple[int, ...]) -> None:
    f = np.random.default_rng(3).standard_normal(shape)
    windows, steps, ndim = [7, 9, 11][: len(shape)], [0.5, -2.0, 1.5][: len(shape)], len(shape)
    inside = tuple(slice(length // 2, -(length // 2)) for length in windows)

    def box(deriv: tuple[int, ...]) -> tuple[Array, float]:
        product = np.ones(())
        for order, length, step in zip(deriv, windows, steps, strict=True):
            weights = algdiff.Differentiator(length, order, degree=4).weights
            product = np.multiply.outer(product, weights / step**order)
        result = (sliding_window_view(f, windows) * product).sum(axis=tuple(range(ndim, 2 * ndim)))
        return result, rounding(windows) * 2**-52 * float(np.abs(product).sum() * np.abs(f).max())

    words: dict[str, Any] = {"window_length": windows, "spacing": steps}
    every = hessian(f, **words)
    for i, j in itertools.product(range(ndim), repeat=2):
        expected, bound = box(unit(ndim, i, j))
        np.testing.assert_allclose(every[i, j][inside], expected, rtol=0, atol=2 * bound)
    parts, bounds = zip(*(box(unit(ndim, i, i)) for i in range(ndim)), strict=True)
    np.testing.assert_allclose(laplacian(f, **words)[inside], sum(parts), rtol=0, atol=2 * ndim * sum(bounds))


@pytest.mark.parametrize("shape", [(15, 18), (12, 13, 14)])
def test_polynomials_are_exact_to_the_borders(shape: tuple[int, ...]) -> None:
    rng, ndim, degree, length = np.random.default_rng(4), len(shape), 4, 9
    coordinates = [np.linspace(*ends, size) for ends, size in zip([(-1, 1), (2, 0.5), (0, 1)], shape, strict=False)]
    coefficients = rng.standard_normal((degree + 1,) * ndim)

    def exact(deriv: tuple[int, ...]) -> Array:
        values = coefficients
        for axis, (order, points) in enumerate(zip(deriv, coordinates, strict=True)):
            lines = polynomial.polyder(values, order, axis=axis)
            values = np.moveaxis(polynomial.polyval(points, np.moveaxis(lines, axis, 0)), -1, axis)
        return values

    f = exact((0,) * ndim)
    words: dict[str, Any] = {"window_length": length, "spacing": coordinates, "degree": degree}

    def bound(deriv: tuple[int, ...]) -> float:
        gains = [
            largest(algdiff.Differentiator(length, order, degree=degree, delta=abs(points[1] - points[0])), len(points))
            for order, points in zip(deriv, coordinates, strict=True)
        ]
        return 2 * rounding([length] * ndim) * 2**-52 * float(np.prod(gains) * np.abs(f).max())

    seconds = {(i, j): unit(ndim, i, j) for i, j in itertools.product(range(ndim), repeat=2)}
    every, trace = hessian(f, **words), laplacian(f, **words)
    for place, deriv in seconds.items():
        np.testing.assert_allclose(every[place], exact(deriv), rtol=0, atol=bound(deriv))
    expected = np.sum([exact(seconds[i, i]) for i in range(ndim)], axis=0)
    allowed = ndim * sum(bound(seconds[i, i]) for i in range(ndim))
    assert allowed < 1e-6 * float(np.abs(expected).max())
    np.testing.assert_allclose(trace, expected, rtol=0, atol=allowed)
    parts = gradient(f, *coordinates, window_length=length, degree=degree, smooth=True)
    for axis in range(ndim):
        deriv = unit(ndim, axis)
        np.testing.assert_allclose(parts[axis], exact(deriv), rtol=0, atol=bound(deriv))


def test_smooth_fields_converge() -> None:
    # Degree 4 errs by h**5 in values and by h**(5 - n) in the n-th derivative; at the center of a symmetric window
    # an even derivative gains one power. Halving h must divide the error by 2**3 at the borders, by 2**4 inside.
    errors: dict[str, list[float]] = {"border": [], "inside": [], "mixed": []}
    for count in (33, 65):
        x = np.linspace(0, 1, count)
        f = np.sin(2 * x)[:, None, None] * np.cos(3 * x)[:, None] * np.exp(x)
        off = np.abs(laplacian(f, 9, spacing=1 / (count - 1)) - (1 - 4 - 9) * f)
        mixed = 2 * np.cos(2 * x)[:, None, None] * -3 * np.sin(3 * x)[:, None] * np.exp(x)
        errors["border"].append(float(off.max()))
        errors["inside"].append(float(off[4:-4, 4:-4, 4:-4].max()))
        found = partial(f, (1, 1, 0), 9, spacing=1 / (count - 1), degree=4)
        errors["mixed"].append(float(np.abs(found - mixed).max()))
    for name, power in (("border", 3), ("inside", 4), ("mixed", 4)):
        coarse, fine = errors[name]
        assert coarse / fine > 2 ** (power - 0.3), name


@pytest.mark.parametrize("deriv", [(1, 0), (0, 2), (1, 1), (0, 0)])
def test_noise_gains_multiply(deriv: tuple[int, int]) -> None:
    lengths, steps = (7, 11), (0.5, 2.0)
    noise = np.random.default_rng(5).standard_normal((7 * 90, 11 * 80))
    result = partial(noise, deriv, lengths, spacing=steps, degree=3)
    # Estimates of disjoint boxes are independent, and the mean of N squares of variance v has variance 2 v**2 / N.
    apart = result[3::7, 5::11]
    gains = [
        algdiff.Differentiator(length, order, degree=3, delta=step).noise_gain
        for length, order, step in zip(lengths, deriv, steps, strict=True)
    ]
    measured, expected = float(np.mean(apart**2)), gains[0] * gains[1]
    assert abs(measured - expected) < 4 * expected * np.sqrt(2 / apart.size)
    alone = partial(noise, deriv, lengths, spacing=steps, degree=3, smooth=False)[3::7, 5::11]
    if 0 in deriv:
        raw = float(np.prod([gain if order else 1.0 for gain, order in zip(gains, deriv, strict=True)]))
        assert abs(float(np.mean(alone**2)) - raw) < 4 * raw * np.sqrt(2 / apart.size)
        assert expected < 0.6 * raw


@pytest.mark.parametrize("rule", ["exact", "trapezoid"])
@pytest.mark.parametrize("mode", [*MODES, "nan"])
def test_the_order_of_the_axes_in_memory_does_not_matter(mode: str, rule: str) -> None:
    # Rules that leak constants change what lies beyond the other axes, and so does every derivative.
    f = np.random.default_rng(6).standard_normal((14, 15, 16))
    words: dict[str, Any] = {"mode": mode, "rule": rule, "degree": 4, "cval": 3.0}
    turned = np.ascontiguousarray(f.transpose(2, 0, 1))
    gain = float(np.prod([largest(algdiff.Differentiator(9, order, degree=4), 14) for order in (2, 0, 0)]))
    bound = 8 * rounding([9] * 3) * 2**-52 * gain * 5
    for call in (laplacian, hessian):
        straight, other = call(f, 9, **words), call(turned, 9, axes=(1, 2, 0), **words)
        np.testing.assert_allclose(np.moveaxis(other, -3, -1), straight, rtol=0, atol=bound)
    assert np.isnan(laplacian(f, 9, **words)).sum() == (f.size - 6 * 7 * 8 if mode == "nan" else 0)


def test_memory_keeps_its_order() -> None:
    f = np.random.default_rng(7).standard_normal((12, 13, 14)).transpose(1, 2, 0)
    for result in (
        laplacian(f, 7),
        partial(f, (1, 0, 1), 7),
        partial(f, (0, 1, 0), 7, smooth=False),
        hessian(f, 7)[0, 1],
    ):
        assert result.strides == f.strides
    for part in gradient(f, window_length=7, smooth=True):
        assert part.strides == f.strides


def test_no_pass_is_made_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[int, tuple[int, ...]]] = []
    plain = separable.Pass.__call__

    def counted(self: Any, part: Any, orders: tuple[int, ...], out: Any = None) -> Any:
        made.append((self.axis, orders))
        return plain(self, part, orders, out)

    monkeypatch.setattr(separable.Pass, "__call__", counted)
    for ndim, expected in ((2, (3, 4, 3)), (3, (5, 10, 6))):
        f, found = np.zeros((9,) * ndim), []
        for call in (laplacian, hessian, lambda f, length: gradient(f, window_length=length, smooth=True)):
            made.clear()
            call(f, 7)
            found.append(len(made))
        assert tuple(found) == expected
    made.clear()
    partial(np.zeros((9, 9, 9)), (0, 2, 0), 7, smooth=False)
    assert made == [(1, (2,))]


@pytest.mark.parametrize(("shape", "arrays"), [((500, 600), 3), ((60, 70, 80), 5)])
def test_a_laplacian_takes_few_arrays(shape: tuple[int, ...], arrays: int) -> None:
    f = np.zeros(shape)
    laplacian(f, 9, threads=1)
    tracemalloc.start()
    laplacian(f, 9, threads=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < (arrays + 0.1) * f.nbytes


def test_threads_give_the_same_bits() -> None:
    f = np.random.default_rng(8).standard_normal((300, 400))
    for call in (laplacian, hessian):
        np.testing.assert_array_equal(call(f, 15, threads=1), call(f, 15, threads=2))


def test_defaults_and_lists() -> None:
    f = np.random.default_rng(9).standard_normal((20, 21))
    np.testing.assert_array_equal(partial(f, [0, 2], 9), partial(f, np.array([0, 2]), (9, 9), degree=(4, None)))
    np.testing.assert_array_equal(partial(f, (1, 1), 9), partial(f, (1, 1), 9, degree=3, spacing=(1, 1), axes=(0, 1)))
    np.testing.assert_array_equal(hessian(f.tolist(), 9), hessian(f, 9, degree=4, smooth=True))
    np.testing.assert_array_equal(laplacian(f, 9, axes=-1), partial(f, (2,), 9, axes=1))
    np.testing.assert_array_equal(partial(f, (0, 0), 9, smooth=False), f)
    root = partial(f, (1, 0), 9, tau="root", kappa=0)
    expected = algdiff.differentiate(
        algdiff.differentiate(f, 9, 1, axis=0, tau="root", kappa=0), 9, 0, degree=3, tau="root", kappa=0
    )
    np.testing.assert_allclose(root, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("error", "match", "words"),
    [
        (TypeError, "laplacian got unexpected keywords: delay, window", {"window": 2, "delay": 1.0}),
        (TypeError, "unexpected keywords: trim", {"trim": 0.1}),
        (ValueError, "mode must keep the shape.* got 'valid'", {"mode": "valid"}),
        (ValueError, "mode must be", {"mode": "reflect"}),
        (TypeError, "mode must be", {"mode": 3}),
        (TypeError, "smooth must be True or False, got 5", {"smooth": 5}),
        (TypeError, "cval must be a real number, got 1j", {"cval": 1j}),
        (
            ValueError,
            "window_length must be one for all or one for each of 2 axes, got 3",
            {"window_length": (7, 7, 7)},
        ),
        (TypeError, "window_length must be an integer, got 7.5", {"window_length": (7, 7.5)}),
        (TypeError, "window_length must be an integer, got '7'", {"window_length": "7"}),
        (ValueError, "window_length must be at most the 10 samples", {"window_length": 12, "axes": 0}),
        (ValueError, "degree must be one for all or one for each of 2 axes, got 1", {"degree": [4]}),
        (ValueError, "degree", {"degree": 1}),
        (ValueError, "spacing must be one for all or one for each of 2 axes, got 10", {"spacing": np.arange(10.0)}),
        (ValueError, "spacing must be one for all or one for each of 2 axes, got 1", {"spacing": (0.5,)}),
        (ValueError, "spacing must be finite and not zero, got 0", {"spacing": (1, 0)}),
        (TypeError, "spacing must be a real number, got None", {"spacing": None}),
        (ValueError, "coordinates must be strictly monotone", {"spacing": (np.zeros(10), 1)}),
        (ValueError, r"coordinates must have shape \(11,\), got \(10,\)", {"spacing": (1, np.arange(10.0))}),
        (ValueError, "axis must be from -2 to 1", {"axes": 2}),
        (ValueError, r"axes must name every axis once, got \(0, -2\)", {"axes": (0, -2)}),
        (ValueError, r"axes must name at least one axis, got \(\)", {"axes": ()}),
        (ValueError, "tau must not be 'root'", {"tau": "root"}),
        (ValueError, "rule must be", {"rule": "best"}),
        (ValueError, "threads must be", {"threads": 0}),
    ],
)
def test_refusals(error: type[Exception], match: str, words: dict[str, Any]) -> None:
    with pytest.raises(error, match=match):
        laplacian(np.zeros((10, 11)), **{"window_length": 7, **words})


@pytest.mark.parametrize(
    ("error", "match", "deriv"),
    [
        (TypeError, "deriv must be a sequence of one order for each axis, got 1", 1),
        (TypeError, "deriv must be a sequence of one order for each axis, got '11'", "11"),
        (ValueError, "deriv must be one for all or one for each of 2 axes, got 3", (0, 1, 0)),
        (ValueError, "deriv must be an integer of at least 0, got -1", (1, -1)),
        (TypeError, "deriv must be an integer, got 1.0", (1.0, 0)),
    ],
)
def test_refused_orders(error: type[Exception], match: str, deriv: Any) -> None:
    with pytest.raises(error, match=match):
        partial(np.zeros((10, 11)), deriv, 7)


def test_a_scalar_and_words_are_refused() -> None:
    with pytest.raises(ValueError, match="f must have at least one dimension"):
        hessian(3.0, 7)
    with pytest.raises(TypeError, match="f must hold real or complex numbers"):
        hessian(np.array(["a"]), 7)


def test_masked_samples_are_missing_and_the_result_is_masked() -> None:
    y, x = np.mgrid[0:3:0.1, 0:4:0.1]
    f = y**2 * x
    gone = np.zeros(f.shape, bool)
    gone[7:9, 11] = gone[20, 30] = True
    masked = np.ma.MaskedArray(np.where(gone, 1e20, f), gone)
    call: dict[str, Any] = {"window_length": 9, "nan_policy": "omit"}
    for found, expected in [
        (laplacian(masked, spacing=0.1, **call), 2 * x),
        (partial(masked, (1, 1), spacing=0.1, **call), 2 * y),
        (hessian(masked, spacing=0.1, **call)[0, 0], 2 * x),
        (gradient(masked, 0.1, smooth=True, **call)[0], 2 * y * x),
        (gradient(masked, 0.1, **call)[1], y**2),
    ]:
        assert isinstance(found, np.ma.MaskedArray)
        assert not np.ma.is_masked(found)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    # Without "omit" whatever holds a masked sample is masked.
    spread = laplacian(masked, 9, spacing=0.1)
    assert np.ma.getmaskarray(spread)[gone].all()
    assert not np.ma.getmaskarray(spread)[:3, :7].any()
