"""Properties of calls that ask for more, and of the other ways in: gaps, times, streams, files, what peers call."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import algdiff
from algdiff import Estimates, Stream
from properties import INSIDE, RULES, Array, Made, close, designs, examples, off, same, samples
from reference_fits import assert_fits, twin
from support import EPS, conditioning

pytestmark = pytest.mark.filterwarnings("ignore::algdiff.DesignWarning")


def twin_of(made: Made, **more: Any) -> Any:
    """Return the readable twin of fits of their own."""
    return twin({name: value for name, value in made.words.items() if name not in ("rule", "engine")}, **more)


def fits(made: Made, x: Array) -> float:
    """Return how far fits of their own may take an estimate in the whole windows; see `reference_fits`."""
    lost = conditioning(made.d.window_length, made.d.degree, made.d.kappa, made.d.mu)
    eps = float(np.finfo(x.dtype).eps) * (made.d.window_length + 64)
    return (eps + 64 * EPS * lost) * float(np.abs(x).max()) * made.d.norm1


# Gaps, weights and times.


@examples(25)
@given(designs(longest=40), st.sampled_from(INSIDE), st.data())
def test_gaps_are_the_fits_of_what_is_left(made: Made, mode: str, data: st.DataObject) -> None:
    x = data.draw(samples(made.d.window_length, dtype=np.float64))
    rng = np.random.default_rng(len(x))
    x[rng.random(len(x)) < data.draw(st.floats(0, 0.5))] = np.nan
    found = made.d(x, mode=mode, nan_policy="omit", return_support=True)
    assert_fits(twin_of(made, mode=mode), x, found, rng.integers(0, found.estimate.size, 4))
    held = np.convolve(~np.isnan(x), np.ones(made.d.window_length), "valid").round().astype(int)
    if mode == "valid":
        np.testing.assert_array_equal(found.support, held)
        assert np.isnan(found.estimate[held <= made.d.degree]).all()


@examples(25)
@given(designs(longest=40), st.data())
def test_a_mask_is_a_nan(made: Made, data: st.DataObject) -> None:
    x = data.draw(samples(made.d.window_length))
    mask = np.random.default_rng(len(x)).random(len(x)) < 0.1
    policy = data.draw(st.sampled_from(["propagate", "omit"]))
    found = made.d(np.ma.MaskedArray(x, mask), nan_policy=policy)
    same(found.data, made.d(np.where(mask, np.nan, x).astype(x.dtype), nan_policy=policy))
    np.testing.assert_array_equal(np.ma.getmaskarray(found), np.isnan(found.data))


@examples(25)
@given(designs(longest=40), st.integers(-30, 30), st.data())
def test_weights_are_relative_and_ones_are_none(made: Made, exponent: int, data: st.DataObject) -> None:
    assume(made.d.exactness == made.d.degree)  # a root gains its degree only where weights slide
    x = data.draw(samples(made.d.window_length))
    weights = np.random.default_rng(len(x)).uniform(0.1, 10, len(x))
    ones = made.d(x, mode="valid", weights=np.ones(len(x)))
    close(ones, made.d(x, mode="valid"), off(made, x) + fits(made, x))
    same(made.d(x, weights=weights * 4.0**exponent), made.d(x, weights=weights))


@examples(25)
@given(designs(longest=40, rules=RULES), st.integers(-10, 10), st.integers(-1000, 1000), st.data())
def test_even_times_are_a_step(made: Made, exponent: int, start: int, data: st.DataObject) -> None:
    x, step = data.draw(samples(max(made.d.window_length, 2))), 2.0**exponent
    t = (start + np.arange(len(x))) * step
    wanted = made.again(delta=step)(x)
    same(made.d(x, t=t), wanted)
    same(made.d(x[::-1], t=t[::-1]), wanted[::-1])


@examples(25)
@given(designs(longest=40), st.sampled_from(INSIDE), st.data())
def test_uneven_times_are_fits_wherever_they_are_asked_for(made: Made, mode: str, data: st.DataObject) -> None:
    assume(made.d.window_length > 2)
    x = data.draw(samples(made.d.window_length + 1, dtype=np.float64))
    rng = np.random.default_rng(len(x))
    t = 1e3 * made.d.delta + np.cumsum(rng.uniform(0.5, 1.5, len(x))) * made.d.delta
    found = [made.d(x, t=t, mode=mode), made.d(x[::-1], t=t[::-1], mode=mode)[::-1]]
    if mode != "valid":
        found.append(made.d(x, t=t, mode=mode, at=t))
    only = rng.integers(0, found[0].size, 3)
    for one in found:
        assert_fits(twin_of(made, mode=mode, t=t - t[0]), x, Estimates(one), only)
        np.testing.assert_array_equal(np.isnan(one), np.isnan(found[0]))


@examples(25)
@given(designs(longest=40), st.floats(0.1, 1000), st.data())
def test_turns_do_not_matter(made: Made, period: float, data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    x = np.cumsum(rng.uniform(-0.45, 0.45, made.d.window_length + 20)) * period
    found = made.d(np.mod(x, period), period=period, mode="valid")
    wanted = made.d(x, mode="valid")
    # Turns are added and taken away in the rounding of the largest angle.
    rounded = 8 * EPS * (float(np.abs(x).max()) + period)
    error = (found - wanted) / period
    turns = np.rint(error) if made.d.deriv == 0 else 0.0
    close(found, wanted + turns * period, 2 * off(made, x) + 8 * made.d.norm1 * rounded + rounded)


@examples(25)
@given(designs(longest=40), st.integers(-20, 20), st.data())
def test_standard_deviations_are_norms(made: Made, exponent: int, data: st.DataObject) -> None:
    x, d = data.draw(samples(made.d.window_length, dtype=np.float64)), made.d
    std = d(x, mode="valid", return_std=True, sigma=1.5).std
    np.testing.assert_allclose(std, 1.5 * np.linalg.norm(d.weights), rtol=1e-12)
    fit = d(x, return_std=True, sigma=1.5).std
    same(d(x, return_std=True, sigma=1.5 * 2.0**exponent).std, fit * 2.0**exponent)
    apart = d(x, mode="valid", return_std=True, autocovariance=[2.25]).std
    np.testing.assert_allclose(apart, std, rtol=1e-12)
    levels = d(x, mode="valid", return_std=True, sigma=np.full(len(x), 1.5)).std
    assume(d.exactness == d.degree)
    np.testing.assert_allclose(levels, std, rtol=1e-9)


# Other ways in.


@examples(25)
@given(designs(longest=40, rules=RULES), st.data())
def test_streams_are_the_whole_windows_through_json(made: Made, data: st.DataObject) -> None:
    x = data.draw(samples(made.d.window_length))
    stream, parts, start = made.d.stream(dtype=x.dtype), [], 0
    while start < len(x):
        stop = data.draw(st.integers(start + 1, len(x)))
        parts.append(np.atleast_1d(stream.push(x[start:stop] if stop > start + 1 else x[start])))
        if data.draw(st.booleans()):
            stream = Stream.from_state(json.loads(json.dumps(stream.state, allow_nan=False)))
        start = stop
    found, span = np.concatenate(parts).astype(x.dtype), made.d.window_length
    assert np.isnan(found[: span - 1]).all()
    same(found[span - 1 :], made.d(x, mode="valid"))
    assert stream.count == len(x)
    assert stream.time == pytest.approx((len(x) - 1) * made.d.delta - made.d.delay, rel=1e-12, abs=1e-12 * made.d.delta)


@examples(12)
@given(
    designs(longest=20, rules=RULES), st.sampled_from(["fit", "valid", "nan", "nearest", "mirror", "wrap"]), st.data()
)
def test_dask_chunks_are_the_whole(made: Made, mode: str, data: st.DataObject) -> None:
    array = pytest.importorskip("dask.array", reason="needs dask[array]")
    x = data.draw(samples(made.d.window_length, shape=(3,)))
    axis = data.draw(st.integers(0, 1))
    turned = np.moveaxis(x, -1, axis)
    chunks = tuple(data.draw(st.integers(1, size)) for size in turned.shape)
    lazy = made.d(array.from_array(turned, chunks=chunks), axis, mode=mode)
    wanted = made.d(turned, axis, mode=mode)
    assert lazy.shape == wanted.shape
    same(lazy.compute(scheduler="synchronous"), wanted)


@examples(8)
@given(made=designs(longest=20, rules=RULES), data=st.data())
def test_a_file_is_what_memory_gives(tmp_path_factory: pytest.TempPathFactory, made: Made, data: st.DataObject) -> None:
    folder = tmp_path_factory.mktemp("file")
    x = np.moveaxis(data.draw(samples(made.d.window_length, shape=(2,))), -1, data.draw(st.integers(0, 1)))
    axis = int(np.argmax(x.shape)) if max(x.shape) > 2 else data.draw(st.integers(0, 1))
    assume(x.shape[axis] >= made.d.window_length)
    np.save(folder / "x.npy", x)
    algdiff.differentiate_file(folder / "x.npy", folder / "y.npy", axis=axis, **made.words)
    same(np.load(folder / "y.npy"), made.d(x, axis))


@examples(60)
@given(st.data())
def test_savgol_filter_is_scipys(data: st.DataObject) -> None:
    from scipy import signal

    length = data.draw(st.integers(1, 40))
    degree = data.draw(st.integers(0, min(5, length - 1)))
    deriv, mode = (
        data.draw(st.integers(0, degree + 1)),
        data.draw(st.sampled_from(["interp", "mirror", "nearest", "wrap"])),
    )
    delta = data.draw(st.sampled_from([1.0, 0.5, -2.0]))
    x = data.draw(samples(length, dtype=np.float64))
    wanted = signal.savgol_filter(x, length, degree, deriv, delta, mode=mode)
    found = algdiff.savgol_filter(x, length, degree, deriv, delta, mode=mode)
    # SciPy solves for its coefficients in powers of the index, in the middle and at the ends.
    powers = np.vander(np.arange(length, dtype=float), degree + 1)
    lost = 64 * EPS * float(np.linalg.cond(powers)) + (length + 8) * EPS
    ends = [signal.savgol_coeffs(length, degree, deriv, delta, pos=pos) for pos in (0, length - 1, None)]
    close(found, wanted, lost * float(np.abs(x).max()) * max(np.abs(w).sum() for w in ends))


@examples(25)
@given(st.lists(st.integers(5, 9), min_size=1, max_size=3), st.data())
def test_gradient_has_numpys_shapes_and_quadratics_come_back(sizes: list[int], data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    uneven = data.draw(st.booleans())
    axes = [np.cumsum(rng.uniform(0.5, 1.5, size)) if uneven else 0.5 * np.arange(size) for size in sizes]
    grid = np.meshgrid(*axes, indexing="ij")
    linear, square = rng.standard_normal((2, len(sizes)))
    f = sum(a * x + b * x**2 for a, b, x in zip(linear, square, grid, strict=True))
    axis: Any = data.draw(st.sampled_from([None, len(sizes) - 1, -1, (0,), tuple(range(len(sizes)))]))
    chosen = range(len(sizes)) if axis is None else np.atleast_1d(axis).tolist()
    spacing = [axes[k] for k in chosen]
    wanted = np.gradient(f, *spacing, axis=axis, edge_order=2)
    found = algdiff.gradient(f, *spacing, axis=axis, window_length=5, degree=data.draw(st.integers(2, 4)))
    assert isinstance(found, tuple) == isinstance(wanted, (tuple, list))
    pairs = zip(found, wanted, chosen, strict=True) if isinstance(found, tuple) else [(found, wanted, chosen[0])]
    for ours, numpys, k in pairs:
        assert ours.shape == numpys.shape
        # Five samples 0.5 to 1.5 apart: weights of at most some hundred, and f of at most some hundred.
        np.testing.assert_allclose(
            ours, linear[k] + 2 * square[k] * grid[k], rtol=0, atol=1e-10 * (1 + np.abs(f).max())
        )
        if len(axes[k]) > 2:
            np.testing.assert_allclose(ours, numpys, rtol=0, atol=1e-10 * (1 + np.abs(f).max()))
