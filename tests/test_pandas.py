"""Series and DataFrames: what comes back is what plain arrays give, with the labels of what went in."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import algdiff

pd = pytest.importorskip("pandas", reason="needs pandas")
from algdiff.pandas import differentiate  # noqa: E402

RNG = np.random.default_rng(5)
N = 80
X = np.cumsum(RNG.standard_normal(N))
START = "2026-10-20"


def series(index: Any = None, dtype: Any = float) -> Any:
    made = pd.Series(X, index, dtype=dtype, name="x")
    made.attrs = {"sensor": [1, 2]}
    return made


INDEXES = {
    "default": (pd.RangeIndex(N), 1.0),
    "every third row": (pd.RangeIndex(7, 7 + 3 * N, 3), 3.0),
    "rows as they came": (pd.Index(np.arange(N)), 1.0),
    "numbers": (pd.Index(2.0 + 0.25 * np.arange(N), name="t"), 0.25),
    "nullable": (pd.Index(np.arange(N), dtype="Int64"), 1.0),
    "dates": (pd.date_range(START, periods=N, freq="D"), 86400.0),
    "zoned": (pd.date_range(START, periods=N, freq="3h", tz="Europe/Berlin"), 10800.0),
    "durations": (pd.timedelta_range(0, periods=N, freq="5ms", name="t"), 0.005),
    "periods": (pd.period_range(START, periods=N, freq="h"), 3600.0),
}


@pytest.mark.parametrize("kind", INDEXES)
def test_even_indexes_say_the_step(kind: str) -> None:
    index, step = INDEXES[kind]
    found = differentiate(series(index), 11, 2)
    assert found.to_numpy().tobytes() == algdiff.differentiate(X, 11, 2, delta=step).tobytes()
    pd.testing.assert_index_equal(found.index, index)
    assert (found.name, found.attrs, found.dtype) == ("x", {"sensor": [1, 2]}, np.float64)


def test_days_of_a_change_of_clocks_are_not_all_as_long() -> None:
    index = pd.date_range(START, periods=N, freq="D", tz="Europe/Berlin")
    seconds = (index - index[0]).total_seconds().to_numpy()
    assert len(set(np.diff(seconds))) == 2
    found = differentiate(series(index), 11)
    assert found.to_numpy().tobytes() == algdiff.differentiate(X, 11, t=seconds).tobytes()


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_uneven_and_descending_times_are_taken_as_they_are(unit: str) -> None:
    seconds = np.cumsum(RNG.integers(1, 9, N))
    index = (pd.Timestamp(START) + pd.to_timedelta(seconds, unit="s")).as_unit(unit)
    expected = algdiff.differentiate(X, 11, t=seconds, tau="newest")
    assert differentiate(series(index), 11, tau="newest").to_numpy().tobytes() == expected.tobytes()
    back = differentiate(series(index)[::-1], 11, tau="newest")
    assert back.to_numpy()[::-1].tobytes() == expected.tobytes()
    pd.testing.assert_index_equal(back.index, index[::-1])
    counted = differentiate(series()[::-1], 11, tau="newest")[::-1]  # of which the index is a descending range
    assert counted.to_numpy().tobytes() == algdiff.differentiate(X, 11, tau="newest").tobytes()
    months = pd.period_range("2026-01", periods=N, freq="M")
    starts = months.to_timestamp().to_numpy()
    found = differentiate(series(months), 11).to_numpy()
    assert found.tobytes() == algdiff.differentiate(X, 11, t=starts).tobytes()


def test_a_step_or_times_go_before_the_index() -> None:
    x = series(list("ab") * (N // 2))
    expected = algdiff.differentiate(X, 11, fs=50)
    assert differentiate(x, 11, fs=50).to_numpy().tobytes() == expected.tobytes()
    t = pd.Series(np.cumsum(RNG.uniform(0.5, 1.5, N)), x.index)
    expected = algdiff.differentiate(X, 11, t=t.to_numpy())
    for times in (t, t.to_numpy(), t.tolist()):
        assert differentiate(x, 11, t=times).to_numpy().tobytes() == expected.tobytes()
    with pytest.raises(ValueError, match="give t, delta or fs"):
        differentiate(x, 11, t=t, delta=1)
    with pytest.raises(ValueError, match=r"^t must have the labels of obj"):
        differentiate(x, 11, t=t.reset_index(drop=True))
    with pytest.raises(ValueError, match=r"^t must be sorted .* at place 1$"):
        differentiate(x, 11, t=pd.Series(0.0, x.index))
    with pytest.raises(ValueError, match="one time for each of the 80"):
        differentiate(x, 11, t=t.to_numpy()[:-1])


NO_TIMES = {
    "strings": (list("ab") * (N // 2), TypeError, "dtype str|dtype object"),
    "levels": (pd.MultiIndex.from_product([[1, 2], range(N // 2)]), TypeError, "several levels"),
    "intervals": (pd.interval_range(0, N), TypeError, "dtype interval"),
    "truths": (np.arange(N) > 3, TypeError, "dtype bool"),
    "duplicate": ([*range(N - 1), N - 2], ValueError, "78 followed by 78 at place 79"),
    "unsorted": ([0, 1, 2, 9, 4, *range(5, N)], ValueError, "9 followed by 4 at place 4"),
    "huge": (np.array([2**63 - 1, 2**63, *range(2**63 + 2, 2**63 + N - 1), 5], "u8"), ValueError, "followed by"),
    "gone": ([0.0, np.nan, *range(2, N)], ValueError, "got nan at place 1"),
    "not there": (pd.Index([0, pd.NA, *range(2, N)], dtype="Int64"), ValueError, "got <NA> at place 1"),
    "no time": (pd.DatetimeIndex([pd.NaT, *pd.date_range(START, periods=N - 1)]), ValueError, "got NaT at place 0"),
    "zone": (pd.DatetimeIndex([START] * N, tz="UTC"), ValueError, r"00:00\+00:00 followed by"),
}


@pytest.mark.parametrize("kind", NO_TIMES)
def test_indexes_that_hold_no_times_are_refused(kind: str) -> None:
    index, error, message = NO_TIMES[kind]
    with pytest.raises(error, match=f"^index must .*({message})"):
        differentiate(series(index), 11)
    assert differentiate(series(index), 11, delta=1).equals(series(index) * 0 + algdiff.differentiate(X, 11))


def table() -> Any:
    """Return a DataFrame of all kinds of numbers, with missing ones where these can be."""
    x, whole = pd.Series(X), pd.Series(np.rint(10 * X))
    columns = {
        "double": x,
        "single": x.astype("f4"),
        "half": x.astype("f2"),
        "whole": whole.astype("i2"),
        "truth": x > 0,
        "complex": x + 1j * x[::-1].to_numpy(),
        "Float64": x.astype("Float64"),
        "Float32": x.astype("Float32"),
        "Int64": whole.astype("Int64"),
        "boolean": (x > 0).astype("boolean"),
        "sparse": x.where(x > 0, 0.0).astype(pd.SparseDtype(float, 0.0)),
    }
    made = pd.DataFrame(columns)
    made.loc[40, ["double", "single", "Float64", "Float32", "Int64", "boolean"]] = pd.NA
    return made


RESULTS = {"single": "float32", "complex": "complex128", "Float32": "Float32"}
RESULTS |= dict.fromkeys(["Float64", "Int64", "boolean"], "Float64")


@pytest.mark.parametrize("policy", ["propagate", "omit"])
def test_columns_of_all_types_are_those_of_arrays(policy: str) -> None:
    frame = table()
    found = differentiate(frame, 9, nan_policy=policy)
    assert found.dtypes.astype(str).to_dict() == {name: RESULTS.get(name, "float64") for name in frame}
    for name, column in frame.items():
        pd.testing.assert_series_equal(differentiate(column, 9, nan_policy=policy), found[name])
        kind = {"single": "f4", "Float32": "f4", "complex": "c16"}.get(str(name), "f8")
        values = column.to_numpy(dtype=kind, na_value=np.nan) if column.hasnans else column.to_numpy(dtype=kind)
        expected = algdiff.differentiate(values, 9, nan_policy=policy)
        assert found[name].isna().to_numpy().tolist() == np.isnan(expected).tolist()
        assert found[name].isna().sum() == (9 if policy == "propagate" and column.hasnans else 0)
        np.testing.assert_array_equal(found[name].fillna(0).to_numpy(kind), np.nan_to_num(expected))
    assert differentiate(frame[["Int64"]], 9).dtypes.tolist() == [pd.Float64Dtype()]
    with pytest.raises(ValueError, match="no missing samples"):
        differentiate(frame[["Int64"]], 9, nan_policy="raise")


def test_arrow_columns_stay_with_arrow() -> None:
    pa = pytest.importorskip("pyarrow", reason="needs pyarrow")
    kinds = {"d": pa.float64(), "f": pa.float32(), "i": pa.int16(), "b": pa.bool_()}
    numbers = pd.Series(np.rint(X))
    given = {name: numbers > 0 if name == "b" else numbers for name in kinds}
    frame = pd.DataFrame({name: pd.array(given[name], pd.ArrowDtype(kind)) for name, kind in kinds.items()})
    frame.loc[40, :] = pd.NA
    found = differentiate(frame, 9)
    assert [str(dtype) for dtype in found.dtypes] == ["double[pyarrow]", "float[pyarrow]", *["double[pyarrow]"] * 2]
    assert found.isna().sum().tolist() == [9] * 4
    assert found["d"].array._pa_array.null_count == 9  # nulls, not NaN
    expected = algdiff.differentiate(np.rint(X), 9)
    np.testing.assert_array_equal(found["i"].to_numpy(float)[45:], expected[45:])
    index = pd.Index(pd.date_range(START, periods=N, freq="2s")).astype("timestamp[ns][pyarrow]")
    expected = algdiff.differentiate(X, 9, delta=2)
    assert differentiate(series(index), 9).to_numpy().tobytes() == expected.tobytes()


def test_what_is_not_numeric_is_named() -> None:
    frame = table().assign(name="q", when=pd.Timestamp(START), thing=[object()] * N)
    message = r"^columns must be numeric, got 'name' \(.*\), 'when' \(datetime64.*\), 'thing' \(object\): select"
    with pytest.raises(TypeError, match=message):
        differentiate(frame, 9)
    for wrong in (frame["name"], frame["double"].astype("category"), frame["double"].astype(object)):
        with pytest.raises(TypeError, match=r"^obj must be numeric, got dtype"):
            differentiate(wrong, 9)
    for wrong in (X, [1.0], frame.groupby("name"), algdiff):
        with pytest.raises(TypeError, match=r"^obj must be a Series or DataFrame, got"):
            differentiate(wrong, 9)


def test_empty_and_short_objects_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one column"):
        differentiate(pd.DataFrame(index=range(N)), 9)
    for short in (0, 1, 8):
        for mode in ("fit", "valid", "nan"):
            for obj in (series()[:short], table()[:short]):
                with pytest.raises(ValueError, match=f"at most the {short} samples"):
                    differentiate(obj, 9, mode=mode)
    for words in ({"axis": 0}, {"out": X}):
        with pytest.raises(TypeError, match="must be left out"):
            differentiate(series(), 9, **words)
    with pytest.raises(TypeError, match="unexpected keyword"):
        differentiate(series(), 9, windw=3)


def test_labels_of_columns_stay() -> None:
    columns = pd.MultiIndex.from_tuples([("a", 1), ("a", 1), ("b", 2)], names=["part", None])
    frame = pd.DataFrame({0: X, 1: X.astype("f4"), 2: -X}, dtype=object).astype({0: "f8", 1: "f4", 2: "f8"})
    frame.columns, frame.attrs = columns, {"run": 3}
    found = differentiate(frame, 9)
    pd.testing.assert_index_equal(found.columns, columns)
    assert found.attrs == {"run": 3}
    assert [str(dtype) for dtype in found.dtypes] == ["float64", "float32", "float64"]
    assert found.iloc[:, 2].to_numpy().tobytes() == algdiff.differentiate(-X, 9).tobytes()
    several = differentiate(frame, 9, (2, 0))
    assert several.columns.names == ["deriv", "part", None]
    assert several.attrs == {"run": 3}
    pd.testing.assert_frame_equal(several[2], differentiate(frame, 9, 2, degree=4))
    pd.testing.assert_frame_equal(several[0], differentiate(frame, 9, 0, degree=4))


def test_several_orders_of_a_series_are_columns() -> None:
    found = differentiate(series(INDEXES["dates"][0]), 15, (0, 2))
    assert found.columns.equals(pd.Index([0, 2], name="deriv"))
    expected = algdiff.differentiate(X, 15, (0, 2), delta=86400.0)
    assert found.to_numpy().T.tobytes() == expected.tobytes()
    one = differentiate(series(), 15, [1])
    assert one.columns.tolist() == [1]


def test_estimates_have_labels_too() -> None:
    frame = table()[["double", "single", "Int64"]]
    words = {"nan_policy": "omit", "return_std": True, "return_support": True, "return_bias": True}
    found = differentiate(frame, 9, sigma=0.3, **words)
    expected = algdiff.differentiate(frame["double"].to_numpy(), 9, sigma=0.3, **words)
    for name in found._fields:
        part, plain = getattr(found, name), getattr(expected, name)
        assert part.columns.equals(frame.columns)
        assert part["double"].to_numpy().tobytes() == plain.tobytes()
    assert found.support.dtypes.tolist() == [np.int64] * 3
    several = differentiate(frame, 15, (1, 2), sigma=0.3, **words)
    assert several.std.shape == (N, 6)
    assert several.support.shape == (N, 3)
    alone = differentiate(frame["double"], 9, return_support=True)
    assert alone.std is None
    assert isinstance(alone.support, pd.Series)


def test_weights_and_sigma_go_by_place_and_must_have_the_same_labels() -> None:
    frame = pd.DataFrame({"a": X, "b": X.astype("f4"), "c": -X})
    weights = pd.DataFrame(RNG.uniform(1, 2, (N, 3)), columns=list("abc"))
    found = differentiate(frame, 9, weights=weights)
    for name in "abc":
        expected = algdiff.differentiate(frame[name].to_numpy(), 9, weights=weights[name].to_numpy())
        assert found[name].to_numpy().tobytes() == expected.tobytes()
    pd.testing.assert_frame_equal(differentiate(frame, 9, weights=weights.to_numpy()), found)
    row = differentiate(frame, 9, weights=weights["a"])
    assert row["a"].equals(found["a"])
    for wrong in (weights[::-1], weights[["b", "a", "c"]], weights["a"][::-1]):
        with pytest.raises(ValueError, match=r"^weights must have the labels of obj"):
            differentiate(frame, 9, weights=wrong)


VALID = [("center", 11), ("center", 10), ("root", 11), ("newest", 11), (0.2, 12), (0.0, 11), (1.3, 11)]


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize(("tau", "length"), VALID)
def test_valid_keeps_the_rows_with_whole_windows(tau: Any, length: int, uneven: bool) -> None:
    """Of a ramp the estimate of order 0 is the time it belongs to, and labels are times."""
    t = np.cumsum(RNG.uniform(0.5, 1.5, N)) if uneven else 0.5 * np.arange(N)
    for way in (1, -1):
        x = pd.Series(t[::way], t[::way])
        found = differentiate(x, length, 0, tau=tau, mode="valid")
        np.testing.assert_allclose(found, found.index, atol=1e-9)
        everywhere = differentiate(x, length, 0, tau=tau, mode="nan").dropna()
        pd.testing.assert_series_equal(found, everywhere)
        assert len(found) == N - length + 1 or tau == 1.3
        two = differentiate(x.to_frame(), length, (0, 1), tau=0.4, mode="valid", return_support=True)
        assert two.estimate.shape == (N - length + 1, 2)
        assert two.support.index.equals(two.estimate.index)
        assert (two.support == length).all(axis=None)


def test_valid_has_the_bits_of_arrays_where_estimates_lie_on_samples() -> None:
    index = INDEXES["dates"][0]
    found = differentiate(series(index), 11, mode="valid", tau="newest", trim=0.05)
    expected = algdiff.differentiate(X, 11, delta=86400.0, mode="valid", tau="newest", trim=0.05)
    assert found.to_numpy().tobytes() == expected.tobytes()
    found = differentiate(series(index), window_duration="11D", mode="valid")
    assert found.index.equals(index[5:-5])
    assert found.index.freq == index.freq
    uneven = index + pd.to_timedelta(RNG.uniform(-0.4, 0.4, N), unit="D")
    for words in ({"window_duration": pd.Timedelta("11D")}, {"window_length": 11, "at": uneven[:3]}):
        with pytest.raises(ValueError, match=r"^mode must be 'fit' or 'nan'"):
            differentiate(series(uneven), mode="valid", **words)


def test_estimates_at_other_times_have_those_as_index() -> None:
    index = pd.date_range(START, periods=N, freq="s", tz="Asia/Tokyo", name="time")
    wanted = index[4:50:7] + pd.Timedelta("300ms")
    found = differentiate(series(index), 11, at=wanted)
    pd.testing.assert_index_equal(found.index, wanted, exact=False)
    assert found.index.name == "time"
    assert differentiate(series(index), 11, at=list(wanted)).equals(found)
    np.testing.assert_allclose(found, algdiff.differentiate(X, 11, at=np.arange(4, 50, 7) + 0.3), atol=1e-9)
    counted = differentiate(series(index), 11, delta=2.0, at=[8.6, 9])
    assert counted.index.tolist() == [8.6, 9]
    for at in (wanted.tz_localize(None), [1, 2]):
        with pytest.raises(TypeError, match=r"^at must"):
            differentiate(series(index), 11, at=at)


def test_groups_are_differentiated_apart() -> None:
    keys = np.array(list("aab"))[np.arange(N) % 3]
    frame = pd.DataFrame({"id": keys, "x": X, "y": -X})
    slope = frame.groupby("id")["x"].transform(differentiate, window_length=9, delta=0.01)
    assert slope.index.equals(frame.index)
    both = frame.groupby("id")[["x", "y"]].transform(differentiate, window_length=9, delta=0.01)
    applied = frame.groupby("id")[["x", "y"]].apply(differentiate, window_length=9, delta=0.01)
    for key in "ab":
        expected = algdiff.differentiate(X[keys == key], 9, delta=0.01)
        assert slope[keys == key].to_numpy().tobytes() == expected.tobytes()
        np.testing.assert_array_equal(both["y"][keys == key], -expected)
        np.testing.assert_array_equal(applied.loc[key, "x"], expected)
    with pytest.raises(ValueError, match="at most the 26 samples"):
        frame.groupby("id")["x"].transform(differentiate, window_length=27, delta=0.01)
    rows = frame[keys == "b"]["x"]  # every third row: without delta a step is 3
    np.testing.assert_allclose(differentiate(rows, 9), differentiate(rows, 9, delta=3.0), rtol=1e-12)


def test_what_comes_in_is_not_changed_and_not_shared() -> None:
    frame = table()
    before = frame.copy()
    found = differentiate(frame, 9, (0, 1))
    found.iloc[:, :] = 0
    pd.testing.assert_frame_equal(frame, before)
    with pytest.warns(algdiff.DesignWarning) as caught:
        differentiate(series(), 7, degree=5)
    assert caught[0].filename == __file__


def test_pandas_is_only_imported_where_it_is_asked_for() -> None:
    code = "import sys, algdiff; print([name for name in ('pandas', 'xarray') if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert result.stdout == "[]\n"
    for name in ("pandas", "xarray"):
        code = f"import sys; sys.modules[{name!r}] = None; import algdiff.{name}"
        missing = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
        assert f"ImportError: algdiff.{name} needs {name}: pip install 'algdiff-rs[{name}]'" in missing.stderr


def test_plain_differentiate_returns_an_array() -> None:
    assert type(algdiff.differentiate(series(), 9)) is np.ndarray


@pytest.mark.parametrize("name", ["weights", "sigma"])
@pytest.mark.parametrize("columns", [1, 3])
def test_numbers_for_other_columns_are_refused(name: str, columns: int) -> None:
    table = pd.DataFrame(np.random.default_rng(0).standard_normal((60, 2)))
    with pytest.raises(ValueError, match=rf"^{name} must have shape \(60,\) or that of obj, got \(60, {columns}\)"):
        differentiate(table, 11, **{name: np.ones((60, columns))})
    differentiate(table, 11, **{name: np.ones((60, 2))})
    differentiate(table[0], 11, **{name: np.ones((60, 1))})


@pytest.mark.parametrize("values", [np.ones(60, complex), np.array(["1"] * 60), np.ones(60, "M8[s]")])
def test_weights_that_are_no_real_numbers_are_refused(values: np.ndarray) -> None:
    x = pd.Series(np.arange(60.0))
    with pytest.raises(TypeError, match=r"^weights must be real numbers"):
        differentiate(x, 11, weights=pd.Series(values))
