"""Dask arrays through the same call: the bits of the call in memory, lazily, and what cannot be asked of them."""

from __future__ import annotations

import math
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
import support
from algdiff.dask import overlap_depth

dask = pytest.importorskip("dask", reason="needs dask")
da = pytest.importorskip("dask.array", reason="needs dask[array]")
cloudpickle = pytest.importorskip("cloudpickle")

MODES = ("fit", "valid", "nan", "nearest", "mirror", "wrap", "constant")
DTYPES = ("f8", "f4", ">f8", "i2", "f2", "c16", "c8", "?", "u8")
TAUS = ("center", "newest", 0.0, 1.4, -0.3, 0.3)


@pytest.fixture(autouse=True)
def _in_this_thread() -> Any:
    with dask.config.set(scheduler="synchronous"):
        yield


def cut(rng: np.random.Generator, size: int) -> Any:
    """Return chunks of one axis: one, even, of one or three samples, or any, some of them empty."""
    bounds = np.sort([0, size, *rng.integers(0, size + 1, 6)])
    even = int(rng.integers(1, size + 1))
    return [size, even, 1, 3, tuple(np.diff(bounds).tolist()), "auto"][int(rng.integers(6))]


def drawn(rng: np.random.Generator, dtype: str, least: int) -> tuple[Any, Any, int]:
    """Return samples, the same in chunks, and the axis of time, along which there are at least so many."""
    ndim = int(rng.integers(1, 4))
    axis, shape = int(rng.integers(ndim)), [int(size) for size in rng.integers(1, 5, ndim)]
    shape[axis] = int(rng.integers(least, least + 100))
    x = (100 * rng.standard_normal(shape)).astype(dtype)
    return x, da.from_array(x, chunks=tuple(cut(rng, size) for size in shape)), axis


def bits(array: Any) -> bytes:
    return bytes(np.ascontiguousarray(array).tobytes())


@pytest.mark.parametrize("mode", MODES)
def test_the_bits_of_the_call_in_memory(mode: str) -> None:
    for trial in range(12):
        rng = np.random.default_rng([trial, MODES.index(mode)])
        dtype, length = DTYPES[(trial + MODES.index(mode)) % len(DTYPES)], int(rng.integers(4, 25))
        x, lazy, axis = drawn(rng, dtype, length)
        tau, deriv = TAUS[trial % len(TAUS)], [1, (0, 1), 2, (2,)][trial % 4]
        design = algdiff.Differentiator(length, deriv, degree=3, tau=tau, engine="direct")
        options: dict[str, Any] = {"mode": mode, "cval": 2.5 + 1j if "c" in dtype else 2.5}
        if trial % 3 == 0:
            options["t"] = 0.25 * np.arange(x.shape[axis])[:: 1 if trial % 2 else -1]
        expected = design(x, axis, **options)
        result = design(lazy, axis - x.ndim if trial % 2 else axis, **options)
        assert isinstance(result, da.Array)
        found = result.compute()
        assert result.dtype == found.dtype == expected.dtype
        assert result.shape == found.shape == expected.shape
        assert type(result._meta) is np.ndarray
        assert bits(found) == bits(expected), (trial, lazy.chunks)
        if mode != "valid":
            assert result.chunks[result.ndim - x.ndim :] == lazy.chunks


@pytest.mark.parametrize("engine", ["moments", "fft"])
def test_other_engines_agree_to_rounding(engine: str) -> None:
    for trial, mode in enumerate(MODES * 2):
        rng = np.random.default_rng([trial, len(engine)])
        length = int(rng.integers(60, 100))
        x, lazy, axis = drawn(rng, ["f8", "f4"][trial % 2], 3 * length)
        design = algdiff.Differentiator(length, degree=3, engine=engine)
        expected = design(x, axis, mode=mode)
        # The bound of parts of a row, see test_block_parts.
        bound = 64 * np.finfo(expected.dtype).eps * float(np.nanmax(np.abs(expected)))
        np.testing.assert_allclose(design(lazy, axis, mode=mode).compute(), expected, rtol=0, atol=bound)


def test_one_call_for_once_is_lazy_too() -> None:
    x = np.cumsum(np.random.default_rng(0).standard_normal((3, 1000)), axis=1)
    found = algdiff.differentiate(da.from_array(x, chunks=(2, 100)), 31, (0, 1), fs=100, engine="direct")
    assert found.chunks == ((2,), (2, 1), (100,) * 10)
    assert bits(found.compute(scheduler="threads")) == bits(
        algdiff.differentiate(x, 31, (0, 1), fs=100, engine="direct")
    )


def test_chunks_are_restored_as_far_as_there_are_outputs(tmp_path: Path) -> None:
    x = np.cumsum(np.random.default_rng(0).standard_normal(1003))
    lazy = da.from_array(x, chunks=100)
    assert algdiff.differentiate(lazy, 151, mode="valid").chunks == ((100,) * 8 + (53,),)
    result = algdiff.differentiate(lazy, 151, engine="direct")
    assert result.chunks == lazy.chunks == ((100,) * 10 + (3,),)
    pytest.importorskip("zarr", reason="needs zarr")
    result.to_zarr(str(tmp_path / "store"))
    again = da.from_zarr(str(tmp_path / "store"))
    assert bits(again.compute()) == bits(algdiff.differentiate(x, 151, engine="direct"))


def refusing(*shape: tuple[int, ...]) -> Any:
    """Return an array whose blocks cannot be computed."""

    def fail(block_id: Any = None) -> Any:
        raise RuntimeError(f"block {block_id} was computed")

    ndim = len(shape)
    return da.map_blocks(fail, chunks=shape, dtype=float, meta=np.empty((0,) * ndim))


LAZY: list[dict[str, Any]] = [
    {},
    {"mode": "wrap"},
    {"mode": "valid"},
    {"t": np.arange(400.0)[::-1]},
    {"t": np.arange(400.0) ** 1.1},
    {"t": da.from_array(np.arange(400.0) ** 1.1, chunks=90)},
    {"t": np.arange(400.0) ** 1.1, "window_duration": 30.0},
    {"nan_policy": "omit", "max_gain": 20.0, "min_support": 6},
    {"edge_window": "shrink"},
    {"weights": refusing((400,)), "sigma": refusing((2,), (200, 200)), "return_std": True, "return_bias": True},
]


@pytest.mark.parametrize("options", LAZY, ids=lambda options: "-".join(options) or "plain")
def test_a_call_computes_nothing_of_the_samples(options: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> Any:
        raise AssertionError("loaded whole")

    monkeypatch.setattr(da.Array, "__array__", refuse)
    result = algdiff.Differentiator(11, (0, 1))(refusing((2,), (100,) * 4), **options)
    with pytest.raises(RuntimeError, match="was computed"):
        dask.compute(result)


KINDS: dict[str, dict[str, Any]] = {
    "gaps": {"nan_policy": "omit"},
    "limited gaps": {"nan_policy": "omit", "min_support": 6, "max_gain": 30.0, "return_support": True},
    "std": {"return_std": True, "sigma": 2.0, "return_support": True},
    "covariance": {"return_std": True, "autocovariance": [1.0, 0.5, 0.1]},
    "shrink": {"edge_window": "shrink", "return_support": True},
    "bias": {"return_bias": True},
    "weights": {},
    "levels": {"return_std": True},
    "uneven": {"return_support": True},
    "uneven gaps": {"nan_policy": "omit"},
    "duration": {"nan_policy": "omit", "return_support": True},
    "even duration": {"return_support": True},
}


def asked(kind: str, rng: np.random.Generator, x: Any, axis: int, trial: int) -> tuple[Any, dict[str, Any]]:
    """Return the samples and the options of a call of some kind."""
    options, samples = dict(KINDS[kind]), x.shape[axis]
    shape = x.shape if trial % 2 else samples
    every = MODES if kind in ("gaps", "std", "bias", "weights", "levels") else ("fit", "nan", "valid")
    counted = "duration" not in kind and kind != "shrink"
    options["mode"] = str(rng.choice(every)) if counted else "fit"
    if options.get("nan_policy") == "omit" and x.dtype.kind != "i":
        x[rng.random(x.shape) < 0.08] = np.nan
    if kind in ("weights", "levels"):
        options["sigma" if kind == "levels" else "weights"] = rng.random(shape) + 0.1
    if kind.startswith("uneven") or kind == "duration":
        options["t"] = (5 + np.cumsum(rng.random(samples) + 0.2)) * (-1 if trial % 2 else 1)
    if kind == "duration":
        options["window_duration"] = 8.0
    if kind == "even duration":
        options |= {"t": 0.2 * np.arange(samples), "window_duration": 3.0}
    return x, options


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_fitted_agrees_to_rounding(kind: str) -> None:
    for trial in range(6):
        rng = np.random.default_rng([trial, *kind.encode()])
        dtype, length = ["f8", "f4", "c16", "i4"][trial % 4], int(rng.integers(7, 20))
        x, _, axis = drawn(rng, dtype, length + 20)
        x, options = asked(kind, rng, x, axis, trial)
        lazy = da.from_array(x, chunks=tuple(cut(rng, size) for size in x.shape))
        beside = dict(options)
        for name in ("t", "weights", "sigma"):
            if trial % 3 and np.ndim(options.get(name, 0.0)):
                beside[name] = da.from_array(
                    options[name], chunks=tuple(cut(rng, size) for size in options[name].shape)
                )
        design = support.design(length, [1, (0, 2)][trial % 2], degree=3, tau=[0.5, "newest", 1.2][trial % 3])
        expected, (found,) = design(x, axis, **options), dask.compute(design(lazy, axis, **beside))
        assert type(found) is type(expected)
        if not isinstance(found, algdiff.Estimates):
            expected, found = algdiff.Estimates(expected), algdiff.Estimates(found)
        assert_alike(found, expected, design, x, axis, options)


def assert_alike(found: Any, expected: Any, design: Any, x: Any, axis: int, options: dict[str, Any]) -> None:
    """Compare two ways to make the same fits, in windows of the same samples.

    Either errs by at most (L + 8) eps cond sum|w| max|x|, where sum|w| is at most sqrt(L) times the standard deviation
    for noise of level 1, which the call in memory tells; cond is that of the whole window, and gaps are in that level.
    """
    told = {name: value for name, value in options.items() if name not in ("sigma", "autocovariance", "return_bias")}
    length = max(design.window_length, 60 if "window_duration" in options else 0)
    cond = support.conditioning(design.window_length, 4, design.kappa, design.mu)
    eps = float(np.finfo(expected.estimate.dtype).eps)
    relative = 2 * (length + 8) * eps * cond

    def bound(one: Any) -> Any:
        level = one(x, axis, **{**told, "return_std": True, "sigma": 1.0}).std
        return relative * math.sqrt(length) * level * float(np.nanmax(np.abs(x)))

    for name, one, other in zip(algdiff.Estimates._fields, found, expected, strict=True):
        assert (one is None) == (other is None), name
        if one is None:
            continue
        assert one.dtype == other.dtype
        assert one.shape == other.shape
        assert np.array_equal(np.isnan(one), np.isnan(other)), name
        if name == "support":
            assert np.array_equal(one, other)
            continue
        allowed = relative * np.abs(other) if name == "std" else bound(design)
        if name == "bias":
            orders = design.orders
            higher = [
                support.design(order.window_length, order.deriv, degree=order.exactness + 1, tau=order.tau)
                for order in orders
            ]
            more = np.stack([bound(one) for one in higher])
            allowed = allowed + (more if design._leading is not None else more[0])
        assert np.all((np.abs(one - other) <= allowed) | np.isnan(other)), name


def test_times_that_jitter_are_fitted() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(2000) + 0.005 * rng.uniform(-1, 1, 2000)
    x = np.sin(0.01 * t) + 0.1 * rng.standard_normal(2000)
    design = algdiff.Differentiator(41)
    corrected, fitted = design(x, t=t), design(x, t=t, min_support=design.degree + 1)
    lazy = design(da.from_array(x, chunks=300), t=t).compute()
    assert bits(corrected) != bits(fitted)
    bound = 2 * support.conditioning(41, 3, 1, 1) * support.sum_bound(design.weights, x)
    assert np.abs(lazy - fitted)[20:-20].max() <= bound
    # The correction in memory is within a tenth of a standard deviation.
    assert np.abs(lazy - corrected)[20:-20].max() <= 0.1 * 0.1 * math.sqrt(design.noise_gain)


def test_uneven_times_of_which_a_block_is_even() -> None:
    """At the root sliding weights are those of a higher degree than the fits, which a block must not take."""
    t = np.concatenate([np.arange(500.0), 500 + 2 * np.arange(500)])
    x = np.random.default_rng(0).standard_normal(1000)
    design = algdiff.Differentiator(21, tau="root")
    found = design(da.from_array(x, chunks=100), t=t).compute()
    expected = design(x, t=t)
    assert np.abs(found - expected).max() <= 1e-12
    assert np.abs(found - design(x))[100:400].max() > 1e-3


@pytest.mark.parametrize("tau", [0.0, 0.5, "newest", 1.2, -0.3])
def test_windows_of_some_duration_hold_the_same_samples(tau: float | str) -> None:
    for trial in range(8):
        rng = np.random.default_rng(trial)
        t = np.cumsum(rng.exponential(size=300) ** 2 + 0.05)
        x, options = rng.standard_normal(300), {"window_duration": 20.0 + 5 * trial, "mode": ["fit", "nan"][trial % 2]}
        design = support.design(20, degree=2, tau=tau)
        chunks = da.from_array(x, chunks=[1, 7, 100, 299][trial % 4])
        expected = design(x, t=t, **options, return_support=True, return_std=True, sigma=1.0)
        (found,) = dask.compute(design(chunks, t=t, **options, return_support=True, return_std=True, sigma=1.0))
        assert np.array_equal(found.support, expected.support)
        assert np.array_equal(np.isnan(found.estimate), np.isnan(expected.estimate))
        # The same fits of the same samples at the same times; the worse their gain, the worse their condition.
        bound = 1e-13 * float(np.abs(x).max()) * np.maximum(expected.std, 1) ** 2
        assert np.all((np.abs(found.estimate - expected.estimate) <= bound) | np.isnan(bound))


def test_masked_blocks_return_masked() -> None:
    rng = np.random.default_rng(0)
    x = np.ma.MaskedArray(rng.standard_normal(300), rng.random(300) < 0.05)
    design = algdiff.Differentiator(11, engine="direct")
    options: dict[str, Any]
    for options in ({}, {"nan_policy": "omit"}, {"nan_policy": "omit", "return_std": True, "sigma": 1.0}):
        expected, (found,) = design(x, **options), dask.compute(design(da.from_array(x, chunks=70), **options))
        pairs = [(found, expected)] if not options.get("return_std") else zip(found[:2], expected[:2], strict=True)
        for one, other in pairs:
            assert isinstance(one, np.ma.MaskedArray)
            assert np.array_equal(np.ma.getmaskarray(one), np.ma.getmaskarray(other))
            np.testing.assert_allclose(one.compressed(), other.compressed(), rtol=0, atol=1e-13)
    unannounced = da.ones(300, chunks=70).map_blocks(lambda block: np.ma.masked_equal(block, 1), meta=np.empty(0))
    with pytest.raises(TypeError, match="masked values"):
        design(unannounced).compute()


def test_samples_and_what_comes_with_them_are_checked_when_they_are_seen() -> None:
    x = np.zeros(300)
    x[150] = np.nan
    result = algdiff.differentiate(da.from_array(x, chunks=100), 11, nan_policy="raise")
    assert not np.isnan(result[:100].compute()).any()
    with pytest.raises(ValueError, match="x must hold no missing samples with nan_policy = 'raise', got 1"):
        result.compute()
    for options in ({"sigma": -1.0}, {"weights": da.full(300, -1.0)}, {"autocovariance": [-1.0]}):
        with pytest.raises(ValueError, match="negative"):
            algdiff.differentiate(da.ones(300, chunks=100), 11, **options).compute()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"at": [1.0, 2.0]}, "at must be left out with a Dask array, got .*: .* compute x first"),
        ({"period": 360.0}, "period must be left out with a Dask array, got .*: .* compute x first"),
        ({"out": np.empty(100)}, "out must be left out with a Dask array, got .*: .* to_zarr"),
        ({"progress": print}, "progress must be left out with a Dask array, got .*: .*ProgressBar"),
        ({"return_std": True}, "return_std must come with sigma or autocovariance with a Dask array"),
        ({"weights": np.ones(99)}, r"weights must have shape \(100,\) or that of x, \(100,\), got \(99,\)"),
        ({"weights": 1.0}, r"weights must have shape .* got \(\)"),
        ({"sigma": da.ones(()), "return_std": True}, r"sigma must have shape .* got \(\)"),
        ({"weights": da.ones(100, chunks=9)[da.ones(100, chunks=9) > 0]}, "weights must have chunks of known sizes"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_what_a_lazy_array_cannot_do(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        algdiff.Differentiator(11)(refusing((50, 50)), **options)
    with pytest.raises(TypeError, match="weights must be real numbers, got dtype complex128"):
        algdiff.Differentiator(11)(refusing((50, 50)), weights=np.ones(100, complex))


@pytest.mark.parametrize(
    "options",
    [
        {"mode": "fit"},
        {"mode": "valid"},
        {"mode": "interp", "window_length": 11},
        {"mode": 3, "window_length": 11},
        {"axis": 1, "window_length": 11},
        {"cval": 1j, "window_length": 11},
        {"threads": 0, "window_length": 11},
        {"t": np.arange(49.0), "window_length": 11},
        {"t": np.zeros(50), "window_length": 11},
        {"nan_policy": "omit"},
        {"t": np.arange(50.0) ** 2, "mode": "wrap", "window_length": 11},
        {"t": np.arange(50.0) ** 2, "window_duration": 1e9},
        {"edge_window": "shrink", "mode": "nan", "window_length": 11},
    ],
    ids=str,
)
def test_what_is_refused_in_memory_is_refused_at_once(options: dict[str, Any]) -> None:
    if "window_duration" not in options:
        options = {"window_length": 51} | options
    with pytest.raises((ValueError, TypeError)) as expected:
        algdiff.differentiate(np.zeros(50), **options)
    with pytest.raises(expected.type) as found:
        algdiff.differentiate(refusing((25, 25)), **options)
    # Two checks say how long a window may be.
    assert str(found.value) == str(expected.value) or "window_length must be at most the 50" in str(found.value)


def test_what_is_no_array_of_numbers_of_known_size() -> None:
    design, x = algdiff.Differentiator(11), da.ones(100, chunks=20)
    with pytest.raises(ValueError, match=r"x must have chunks of known sizes, got shape \(nan,\)"):
        design(x[x > 0])
    with pytest.raises(ValueError, match="x must have at least one dimension"):
        design(x.sum())
    with pytest.raises(TypeError, match="x must hold real or complex numbers, got dtype datetime64"):
        design(x.astype("M8[s]"))
    with pytest.raises(TypeError, match="x must be an array if it is lazy, got Delayed of"):
        design(dask.delayed(np.ones)(100))


@pytest.mark.parametrize(("shape", "axis"), [((0, 50), 1), ((50, 0), 0), ((0,), 0), ((1,), 0), ((3,), 0)])
@pytest.mark.parametrize("mode", MODES)
def test_empty_and_short_arrays_as_in_memory(shape: tuple[int, ...], axis: int, mode: str) -> None:
    x = np.ones(shape)
    lazy = da.from_array(x, chunks=tuple(max(size // 2, 1) for size in shape))
    for options in ({}, {"nan_policy": "omit", "return_support": True}):
        design = algdiff.Differentiator(11, engine="direct")
        try:
            expected = design(x, axis, mode=mode, **options)
        except ValueError:
            with pytest.raises(ValueError, match="window_length must be at most"):
                design(lazy, axis, mode=mode, **options)
            continue
        (found,) = dask.compute(design(lazy, axis, mode=mode, **options))
        for one, other in zip(found, expected, strict=True) if options else [(found, expected)]:
            assert (one is None) == (other is None)
            if one is not None:
                np.testing.assert_allclose(one, other, rtol=0, atol=1e-14)


def test_graphs_are_small_and_named_by_what_they_compute() -> None:
    x = refusing((100_000,) * 50)
    design = algdiff.Differentiator(1001)
    result = design(x)
    assert result.name == algdiff.Differentiator(1001)(x).name
    assert result.name != design(x, mode="nearest").name != algdiff.Differentiator(1003)(x, mode="nearest").name
    # Source, halo and result of a chunk: two slices, one concatenation.
    assert len(result.__dask_graph__()) <= 6 * 50
    assert len(cloudpickle.dumps(result)) - len(cloudpickle.dumps(x)) <= 400 * 50
    t = da.arange(50 * 100_000, chunks=100_000).astype(float)
    even = design(x, t=t)
    assert len(cloudpickle.dumps(even)) <= len(cloudpickle.dumps(result)) + 1000


def test_uneven_times_travel_by_chunks() -> None:
    t = (da.arange(1_000_000, chunks=10_000) * 0.001) ** 1.1
    result = algdiff.differentiate(da.ones(1_000_000, chunks=10_000), 101, t=t)
    assert len(cloudpickle.dumps(result)) <= 100_000


def test_chunks_without_samples() -> None:
    t, x = np.arange(100.0) ** 1.1, np.random.default_rng(0).standard_normal(100)
    chunks = da.from_array(x, chunks=((0, 30, 0, 0, 70, 0),))
    for times in (None, t, da.from_array(t, chunks=40)):
        found = algdiff.differentiate(chunks, 11, t=times)
        assert found.chunks == chunks.chunks
        expected = algdiff.differentiate(x, 11, t=None if times is None else t)
        np.testing.assert_allclose(found.compute(), expected, rtol=0, atol=1e-13)


def test_arrays_of_xarray_that_are_not_lazy_go_on_as_ever() -> None:
    xarray = pytest.importorskip("xarray", reason="needs xarray")
    x = np.random.default_rng(0).standard_normal(100)
    found = algdiff.differentiate(xarray.DataArray(x, dims="time"), 11)
    assert type(found) is np.ndarray
    assert bits(found) == bits(algdiff.differentiate(x, 11))


def test_functions_that_would_load_everything_refuse() -> None:
    x = refusing((50, 50))
    with pytest.raises(TypeError, match="f is lazy and would be computed whole"):
        algdiff.gradient(x, window_length=11)
    with pytest.raises(TypeError, match="x is lazy and would be computed whole"):
        algdiff.savgol_filter(x, 11, 2)
    for call in (algdiff.noise_level, lambda f: algdiff.laplacian(f, 11), lambda f: algdiff.hessian(f, 11)):
        with pytest.raises(TypeError, match=r"is lazy .* give it to algdiff.differentiate, or pass [fx]\.compute"):
            call(x)
    assert isinstance(algdiff.gradient(da.ones((20, 20), chunks=10), axis=0), (da.Array, tuple))


@pytest.mark.parametrize("tau", TAUS)
def test_overlap_depth_is_what_windows_read(tau: float | str) -> None:
    design = algdiff.Differentiator(21, degree=2, tau=tau, engine="direct")
    before, after = overlap_depth(design)
    x = np.random.default_rng(0).standard_normal(400)
    chunks = da.from_array(x, chunks=80)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = chunks.map_overlap(design, depth={0: (before, after)}, boundary="none", dtype=float)
    assert bits(result.compute()) == bits(design(x))
    changed, middle = x.copy(), 200
    changed[: middle - before] = changed[middle + after + 1 :] = 0
    assert design(changed)[middle] == design(x)[middle]
    if before and after:
        assert before + after == 20
    assert overlap_depth(design, "valid") == (0, 20)
    with pytest.raises(ValueError, match="mode must be 'fit', 'valid'"):
        overlap_depth(design, "interp")


def test_the_public_module_does_not_import_dask() -> None:
    code = "import sys, algdiff.dask; print('dask' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert result.stdout == "False\n"
