"""DataArrays and Datasets: what comes back is what plain arrays give, with the labels of what went in."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff

xr = pytest.importorskip("xarray", reason="needs xarray")
import algdiff.xarray  # noqa: E402
from algdiff.xarray import differentiate  # noqa: E402

RNG = np.random.default_rng(6)
N = 80
X = np.cumsum(RNG.standard_normal((3, N, 2)), axis=1)
DATES = np.datetime64("2026-10-20", "ms") + 10 * np.arange(N)
UNEVEN = np.cumsum(RNG.uniform(0.5, 1.5, N))


def array(time: Any = DATES, x: Any = X, **attrs: Any) -> Any:
    """Return samples along the middle of three dimensions, with coordinates of all sorts."""
    coords = {
        "site": ["a", "b", "c"],
        "phase": ("time", np.arange(N) % 7, {"units": "degree"}),
        "height": (("site", "time"), X[..., 0]),
        "run": 4,
    }
    if time is not None:
        coords["time"] = ("time", time, {"long_name": "clock"})
    made = xr.DataArray(x, coords, ["site", "time", "part"], "x", {"units": "m", "sensor": "s1", **attrs})
    made.encoding = {"scale_factor": 0.1, "dtype": "int16", "_FillValue": -9999}
    return made


def assert_labels(found: Any, given: Any, units: str | None) -> None:
    """Assert that everything but the values is what it was, and the units what they should be."""
    assert found.dims == given.dims
    assert found.name == given.name
    xr.testing.assert_identical(found.coords.to_dataset(), given.coords.to_dataset())
    expected = {**given.attrs, "units": units}
    assert found.attrs == {name: value for name, value in expected.items() if value is not None}
    assert found.encoding == {}


TIMES = {
    "dates": (DATES, {"delta": 0.01}, "m s-1"),
    "durations": (DATES - DATES[0], {"delta": 0.01}, "m s-1"),
    "numbers": (0.25 * np.arange(N), {"delta": 0.25}, None),
    "uneven": (UNEVEN, {"t": UNEVEN}, None),
    "descending": (UNEVEN[::-1], {"t": UNEVEN[::-1]}, None),
    "even and descending": (0.25 * np.arange(N)[::-1], {"t": 0.25 * np.arange(N)[::-1]}, None),
    "none": (None, {}, None),
}


@pytest.mark.parametrize("kind", TIMES)
def test_the_coordinate_says_when(kind: str) -> None:
    time, words, units = TIMES[kind]
    x = array(time)
    found = differentiate(x, "time", 11, tau="newest")
    assert found.values.tobytes() == algdiff.differentiate(X, 11, axis=1, tau="newest", **words).tobytes()
    assert_labels(found, x, units)
    turned = differentiate(x.transpose("time", ...), "time", 11, tau="newest")
    assert turned.dims == ("time", "site", "part")
    np.testing.assert_array_equal(turned.transpose(*x.dims), found)
    given = differentiate(x, "time", 11, delta=0.5)
    assert given.values.tobytes() == algdiff.differentiate(X, 11, axis=1, delta=0.5).tobytes()
    assert_labels(given, x, units)


UNITS = [
    ("m", "s", 1, "m s-1"),
    ("m", "mm", 2, "m mm-2"),
    ("m/s", "s", 1, "m/s s-1"),
    ("1", "s", 2, "s-2"),
    ("m", "1", 1, "m"),
    ("m", "km h-1", 2, "m (km h-1)-2"),
    ("m", "m2", 1, "m (m2)-1"),
    ("m", "seconds since 2026-01-01", 1, "m seconds-1"),
    ("days since 2026-01-01", "s", 1, "days s-1"),
    ("days since 2026-01-01", "s", 0, "days since 2026-01-01"),
    ("m", "s", 0, "m"),
    ("m", None, 0, "m"),
    ("m", None, 1, None),
    (None, "s", 1, None),
    ("m", "s", (1, 2), None),
    (3, "s", 1, None),
]


@pytest.mark.parametrize(("units", "of_time", "deriv", "expected"), UNITS)
def test_units_are_divided(units: Any, of_time: Any, deriv: Any, expected: Any) -> None:
    x = array(0.25 * np.arange(N), units=units)
    if units is None:
        del x.attrs["units"]
    if of_time is not None:
        x.time.attrs["units"] = of_time
    found = differentiate(x, "time", 15, deriv, return_std=True, return_support=True, sigma=1)
    assert found.estimate.attrs.get("units") == found.std.attrs.get("units") == expected
    assert "units" not in found.support.attrs
    assert x.attrs.get("units") == units


def test_types_are_those_of_arrays() -> None:
    for kind in ("f4", "i2", "?", "c8", ">f8"):
        x = array(x=X.astype(kind))
        found = differentiate(x, "time", 11)
        expected = algdiff.differentiate(X.astype(kind), 11, axis=1, delta=0.01)
        assert found.dtype == expected.dtype
        assert found.values.tobytes() == expected.tobytes()
    for wrong in (X.astype(str), X.astype(object), X.astype("M8[s]")):
        with pytest.raises(TypeError, match=r"^obj must be numeric, got dtype"):
            differentiate(array(x=wrong), "time", 11)
    for wrong in (X, array().groupby("phase"), None):
        with pytest.raises(TypeError, match=r"^obj must be a DataArray or Dataset, got"):
            differentiate(wrong, "time", 11)


def test_faults_are_named() -> None:
    x = array()
    with pytest.raises(ValueError, match=r"^dim must be one of \('site', 'time', 'part'\), got 'phase'"):
        differentiate(x, "phase", 11)
    twice = DATES.copy()
    twice[5] = twice[4]
    with pytest.raises(ValueError, match=r"^the coordinate 'time' must be sorted .* at place 5$"):
        differentiate(array(twice), "time", 11)
    with pytest.raises(ValueError, match="got NaT at place 3"):
        differentiate(array(np.where(np.arange(N) == 3, np.datetime64("NaT"), DATES)), "time", 11)
    with pytest.raises(TypeError, match=r"^the coordinate 'site' must hold numbers or times"):
        differentiate(x, "site", 3)
    stacked = x.stack(both=("site", "time"))
    with pytest.raises(TypeError, match="got several levels: give delta, fs or t"):
        differentiate(stacked, "both", 11)
    assert differentiate(stacked, "both", 11, delta=1).indexes["both"].equals(stacked.indexes["both"])
    for words in ({"axis": 0}, {"out": X}):
        with pytest.raises(TypeError, match="must be left out"):
            differentiate(x, "time", 11, **words)
    with pytest.raises(ValueError, match="at most the 80 samples"):
        differentiate(x, "time", 81)
    with pytest.raises(ValueError, match="no 'deriv' for several orders"):
        differentiate(x.assign_coords(deriv=1), "time", 15, (1, 2))
    assert "deriv" in differentiate(x.assign_coords(deriv=1), "time", 15).coords


def test_another_coordinate_may_say_when() -> None:
    x = array().assign_coords(clock=("time", UNEVEN, {"units": "h"}))
    found = differentiate(x, "time", 11, t=x.clock)
    assert found.values.tobytes() == algdiff.differentiate(X, 11, axis=1, t=UNEVEN).tobytes()
    assert_labels(found, x, "m h-1")
    assert_labels(differentiate(x, "time", 11, t=UNEVEN), x, None)
    loose = array(UNEVEN).drop_indexes("time")
    found = differentiate(loose, "time", 11)
    assert found.values.tobytes() == algdiff.differentiate(X, 11, axis=1, t=UNEVEN).tobytes()
    assert "time" not in found.indexes


def test_several_orders_lead() -> None:
    x = array()
    found = differentiate(x, "time", 15, (0, 2))
    assert found.dims == ("deriv", *x.dims)
    assert found.deriv.values.tolist() == [0, 2]
    assert found.values.tobytes() == algdiff.differentiate(X, 15, (0, 2), axis=1, delta=0.01).tobytes()
    xr.testing.assert_identical(found.coords.to_dataset().drop_vars("deriv"), x.coords.to_dataset())


VALID = [("center", 11), ("center", 10), ("newest", 11), ("root", 10), (0.0, 11), (1.3, 11)]


@pytest.mark.parametrize("time", ["numbers", "uneven", "descending", "even and descending"])
@pytest.mark.parametrize(("tau", "length"), VALID)
def test_valid_keeps_the_samples_with_whole_windows(tau: Any, length: int, time: str) -> None:
    """Of a ramp the estimate of order 0 is the time it belongs to, and coordinates are times."""
    x = array(TIMES[time][0])
    x = x.copy(data=np.broadcast_to(x.time.values[:, np.newaxis], X.shape))
    found = differentiate(x, "time", length, 0, tau=tau, mode="valid", return_support=True)
    np.testing.assert_allclose(found.estimate, found.estimate.time.broadcast_like(found.estimate), atol=1e-9)
    assert (found.support == length).all()
    kept = x.sel(time=found.estimate.time)
    xr.testing.assert_identical(found.support.coords.to_dataset(), kept.coords.to_dataset())
    assert_labels(found.estimate, kept, "m")
    everywhere = differentiate(x, "time", length, 0, tau=tau, mode="nan").dropna("time")
    xr.testing.assert_identical(found.estimate, everywhere)
    assert found.estimate.sizes["time"] == N - length + 1 or tau == 1.3


def test_valid_without_a_coordinate() -> None:
    found = differentiate(array(None), "time", 11, (0, 1), mode="valid")
    assert found.values.tobytes() == algdiff.differentiate(X, 11, (0, 1), axis=1, mode="valid").tobytes()
    assert found.phase.values.tolist() == (np.arange(N) % 7)[5:-5].tolist()


def test_estimates_at_other_times_have_those_as_coordinate() -> None:
    wanted = DATES[4:50:7] + 3
    for at in (wanted, xr.DataArray(wanted, dims="when")):
        found = differentiate(array(), "time", 11, at=at)
        assert set(found.coords) == {"time", "site", "run"}
        np.testing.assert_array_equal(found.time, wanted)
        assert found.time.attrs == {"long_name": "clock"}
        expected = algdiff.differentiate(X, 11, axis=1, delta=0.01, at=np.arange(4, 50, 7) * 0.01 + 0.003)
        np.testing.assert_allclose(found, expected, atol=1e-6)  # of which 1e-9 of a step is made
    counted = differentiate(array(None), "time", 11, at=[8.6])
    assert counted.time.values.tolist() == [8.6]


def dataset() -> Any:
    other = xr.DataArray(X[0, :, 0].astype("f4"), {"time": DATES}, ["time"], attrs={"units": "V"})
    names = xr.DataArray(list("abc"), dims="site")
    made = xr.Dataset({"names": names, "x": array(), "v": other, "flat": ("part", [1, 2], {"units": "m"})})
    made.attrs, made.encoding = {"title": "T"}, {"unlimited_dims": {"time"}}
    made.flat.encoding = {"dtype": "int8"}
    return made


def test_variables_of_a_dataset_without_the_dimension_are_left_alone() -> None:
    ds = dataset()
    found = differentiate(ds, "time", 11)
    assert list(found.data_vars) == ["names", "x", "v", "flat"]
    assert (found.attrs, found.encoding) == (ds.attrs, ds.encoding)
    assert found.flat.encoding == {"dtype": "int8"}
    for name in ("names", "flat"):
        xr.testing.assert_identical(found[name], ds[name])
    for name in ("x", "v"):
        xr.testing.assert_identical(found[name], differentiate(ds[name], "time", 11))
    assert found.v.dtype == np.float32
    xr.testing.assert_identical(found.coords.to_dataset(), ds.coords.to_dataset())
    for words in ({"mode": "valid"}, {"at": DATES[3:9]}, {"deriv": (0, 1)}):
        found = differentiate(ds, "time", 15, **words)
        for name in ("x", "v"):
            xr.testing.assert_identical(found[name], differentiate(ds[name], "time", 15, **words))
        xr.testing.assert_identical(found["flat"], ds["flat"])


def test_parts_of_estimates_of_a_dataset() -> None:
    ds = dataset()
    sigma = xr.DataArray(RNG.uniform(1, 2, N), {"time": DATES}, ["time"])
    found = differentiate(ds, "time", 15, (1, 2), sigma=sigma, return_std=True, return_support=True)
    assert list(found.estimate.data_vars) == list(ds.data_vars)
    assert list(found.std.data_vars) == list(found.support.data_vars) == ["x", "v"]
    assert found.support.x.dims == ds.x.dims
    assert "deriv" not in found.support.coords
    plain = algdiff.differentiate(X, 15, (1, 2), axis=1, delta=0.01, sigma=sigma.values, return_std=True)
    assert found.std.x.values.tobytes() == plain.std.tobytes()
    assert found.bias is None
    nothing = differentiate(ds[["flat"]].assign_coords(time=DATES), "time", 11, return_std=True)
    xr.testing.assert_identical(nothing.flat, ds.flat)


def test_variables_that_are_not_numeric_are_named() -> None:
    ds = dataset().assign(flag=("time", ["q"] * N), when=("time", DATES))
    with pytest.raises(TypeError, match=r"^variables along dim must be numeric, got 'flag' \(<U1\), 'when' \(datetime"):
        differentiate(ds, "time", 11)
    assert "flag" in differentiate(ds.set_coords(["flag", "when"]), "time", 11).coords


def test_weights_go_by_label() -> None:
    x = array()
    weights = xr.DataArray(RNG.uniform(1, 2, X.shape[1::-1]), {"time": DATES, "site": x.site}, ["time", "site"])
    found = differentiate(x, "time", 11, weights=weights)
    full = np.broadcast_to(weights.values.T[..., np.newaxis], X.shape)
    assert found.values.tobytes() == algdiff.differentiate(X, 11, axis=1, delta=0.01, weights=full).tobytes()
    with pytest.raises(ValueError, match=r"^weights must have the coordinates of obj"):
        differentiate(x, "time", 11, weights=weights.isel(time=slice(None, None, -1)))
    with pytest.raises(ValueError, match=r"^weights must have dimensions of obj"):
        differentiate(x, "time", 11, weights=weights.rename(site="place"))


def test_the_accessor_is_the_function() -> None:
    for obj in (array(), dataset()):
        xr.testing.assert_identical(
            obj.algdiff.differentiate("time", 11, mode="valid"), differentiate(obj, "time", 11, mode="valid")
        )
    importlib.reload(algdiff.xarray)  # without a warning of xarray's
    with pytest.warns(algdiff.DesignWarning) as caught:
        array().algdiff.differentiate("time", 7, degree=5)
    assert caught[0].filename == __file__


def test_groups_are_mapped() -> None:
    x = array(None)
    found = x.groupby("site").map(differentiate, dim="time", window_length=11)
    np.testing.assert_array_equal(found.transpose(*x.dims), differentiate(x, "time", 11))


def test_what_comes_in_is_not_changed() -> None:
    x = array()
    before = x.copy(deep=True)
    found = differentiate(x, "time", 11, 0)
    found[...] = 0
    found.attrs["sensor"] = found.time.attrs["long_name"] = "other"
    xr.testing.assert_identical(x, before)
    assert type(algdiff.differentiate(x, 11, axis=1)) is np.ndarray


CALLS: list[dict[str, Any]] = [
    {},
    {"deriv": (0, 2), "tau": "newest"},
    {"mode": "valid"},
    {"mode": "valid", "deriv": (0, 2)},
    {"nan_policy": "omit", "return_std": True, "return_support": True, "sigma": 0.2},
]


@pytest.mark.parametrize("time", ["dates", "uneven", "descending", "none"])
@pytest.mark.parametrize("words", CALLS)
def test_chunks_stay_lazy_and_change_nothing(words: dict[str, Any], time: str) -> None:
    pytest.importorskip("dask.array", reason="needs dask")
    values = X.copy()
    values[0, 33, 0] = np.nan
    whole = dataset() if time == "dates" else array(TIMES[time][0]).to_dataset()
    whole["x"] = whole.x.copy(data=values)
    expected = differentiate(whole, "time", 15, engine="direct", **words)
    found = differentiate(whole.chunk(time=17, site=2), "time", 15, engine="direct", **words)
    pairs = zip(found, expected, strict=True) if isinstance(found, algdiff.Estimates) else [(found, expected)]
    fitted = "nan_policy" in words or time in ("uneven", "descending")
    for lazy, plain in pairs:
        if plain is None:
            continue
        assert lazy.x.chunks is not None
        computed = lazy.compute(scheduler="synchronous")
        if fitted:  # in each chunk anew: sums of 15 products each, where no more than two digits cancel
            bound = 1e-13 * float(abs(plain.x).max())
            np.testing.assert_allclose(computed.x.values, plain.x.values, rtol=0, atol=bound)
            computed["x"] = computed.x.copy(data=plain.x.values)
        xr.testing.assert_identical(computed, plain)


def test_chunks_go_to_zarr_and_back(tmp_path: Path) -> None:
    pytest.importorskip("zarr", reason="needs zarr")
    pytest.importorskip("dask.array", reason="needs dask")
    dataset()[["x", "v"]].drop_vars("height").chunk(time=16).to_zarr(tmp_path / "in", zarr_format=2)
    with xr.open_zarr(tmp_path / "in") as opened:
        for words in ({}, {"mode": "valid"}):
            found = differentiate(opened, "time", 11, **words)
            assert found.x.chunks is not None
            found.to_zarr(tmp_path / f"out{len(words)}", zarr_format=2)
            with xr.open_zarr(tmp_path / f"out{len(words)}") as back:
                expected = differentiate(opened.compute(), "time", 11, **words)
                xr.testing.assert_identical(back.load(), expected)


def test_lazy_arrays_are_not_computed_unasked() -> None:
    pytest.importorskip("dask.array")
    lazy = xr.DataArray(np.arange(100.0), dims="time").chunk(time=20)
    for call in (lambda: algdiff.differentiate(lazy, 11), lambda: algdiff.noise_level(lazy)):
        with pytest.raises(
            TypeError, match=r"^x is lazy .*: give it to algdiff.xarray.differentiate, or pass x.compute"
        ):
            call()
    np.testing.assert_allclose(algdiff.differentiate(lazy.compute(), 11), 1.0)


def test_a_variable_with_the_name_of_the_orders_is_kept() -> None:
    both = xr.Dataset({"x": ("time", np.arange(60.0)), "deriv": ("time", np.arange(60.0))})
    with pytest.raises(ValueError, match="must have no 'deriv'"):
        differentiate(both, "time", 11, deriv=(0, 1))
    assert set(differentiate(both, "time", 11).data_vars) == {"x", "deriv"}


def test_times_of_other_samples_are_refused() -> None:
    x = xr.DataArray(np.arange(60.0), {"time": np.arange(60.0)}, ["time"])
    with pytest.raises(ValueError, match=r"^t must have the coordinate 'time' of obj"):
        differentiate(x, "time", 11, t=xr.DataArray(np.arange(60.0), {"time": x.time.values[::-1]}, ["time"]))
    with pytest.raises(ValueError, match=r"^t must lie along 'time'"):
        differentiate(x, "time", 11, t=xr.DataArray(np.arange(60.0), dims=["other"]))
    found = differentiate(x, "time", 11, t=xr.DataArray(np.arange(60.0) / 2, {"time": x.time}, ["time"]))
    np.testing.assert_allclose(found, 2.0)
