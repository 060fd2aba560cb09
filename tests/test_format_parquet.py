"""Parquet tables: read from anywhere as others write them, written as others read them."""

from __future__ import annotations

import decimal
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algdiff import _formats as formats
from algdiff._formats.base import Layout, Options
from algdiff._formats.stage import Stage

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
pytest.importorskip("algdiff._formats.parquet")

DATE = np.datetime64("2024-02-28T23:59:58.5", "ns")
NUMBERS = {
    "f2": pa.float16(),
    "f4": pa.float32(),
    "f8": pa.float64(),
    "i1": pa.int8(),
    "i2": pa.int16(),
    "i4": pa.int32(),
    "i8": pa.int64(),
    "u1": pa.uint8(),
    "u2": pa.uint16(),
    "u4": pa.uint32(),
    "u8": pa.uint64(),
    "?": pa.bool_(),
}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from algdiff._formats import parquet

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(parquet, "NUMBERS", 64)


def opened(data: Any, group: int = 100, more: dict[str, Any] | None = None, **options: Any) -> Any:
    table = data if isinstance(data, pa.Table) else pa.table(data)
    pq.write_table(table, "x.parquet", row_group_size=group, **(more or {}))
    return formats.open_source(formats.located("src", "x.parquet"), Options(**options))


def read(source: Any, start: int, stop: int) -> tuple[np.ndarray, np.ndarray | None]:
    place = (slice(start, stop), *(slice(0, extent) for extent in source.shape[1:]))
    out = np.empty((stop - start, *source.shape[1:]), source.dtype)
    return out, source.read(place, out)


def written(data: np.ndarray, times: np.ndarray | None = None, **more: Any) -> Layout:
    if times is not None:
        more = {"time": "t", "time_dtype": times.dtype, **more}
    given = {"axis": 0, "orders": (1,), "leading": False, "dtype": data.dtype}
    plan = Layout(shape=data.shape, **{**given, **more})
    place = formats.located("dst", "y.parquet")
    formats.check(place, plan)
    stage = Stage(Path("y.partial"), plan, table=True)
    for start in range(0, len(data), 70):
        rows = slice(start, min(start + 70, len(data)))
        stage.write((rows,), data[rows], None if times is None else times[rows])
    formats.encode(place, stage, Path("y.encoded"), plan)
    stage.close()
    return plan


# --- reading -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NUMBERS)
def test_every_type_from_anywhere(name):
    rng = np.random.default_rng(list(NUMBERS).index(name))
    data = (100 * rng.random((730, 3))).astype(name)
    columns = {label: pa.array(data[:, place], NUMBERS[name]) for place, label in enumerate("abc")}
    for chosen in (("a", "b", "c"), ("2", "a"), ("b",)):
        expected = data[:, ["abc".find(one) if one in "abc" else int(one) for one in chosen]]
        with opened(columns, columns=chosen) as source:
            assert source.dtype == np.dtype(name)
            assert source.names == tuple("abc"[int(one)] if one.isdecimal() else one for one in chosen)
            expected = expected if len(chosen) > 1 else expected[:, 0]
            assert source.shape == expected.shape
            for _ in range(25):
                start, stop = sorted(rng.integers(0, 731, 2).tolist())
                np.testing.assert_array_equal(read(source, start, stop)[0], expected[start:stop])
            length, halo = int(rng.integers(20, 90)), int(rng.integers(0, 10))
            for start in range(0, 730, length - halo):
                np.testing.assert_array_equal(
                    read(source, start, min(start + length, 730))[0], expected[start : start + length]
                )


@pytest.mark.parametrize(
    ("names", "dtype"),
    [
        (("f4", "f4"), "f4"),
        (("f2", "f2"), "f2"),
        (("f4", "f8"), "f8"),
        (("f4", "f2"), "f8"),
        (("f4", "i2"), "f8"),
        (("i2", "u1"), "i2"),
        (("i4", "u4"), "i8"),
        (("i8", "u8"), "f8"),
        (("?", "u1"), "u1"),
        (("?", "f4"), "f8"),
    ],
)
def test_types_that_hold_all_columns(names, dtype):
    data = [np.arange(50).astype(name) for name in names]
    columns = {
        f"x{place}": pa.array(one, NUMBERS[name]) for place, (one, name) in enumerate(zip(data, names, strict=True))
    }
    with opened(columns, columns=("x0", "x1")) as source:
        assert source.dtype == np.dtype(dtype)
        np.testing.assert_array_equal(read(source, 0, 50)[0], np.stack(data, axis=1).astype(dtype))


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("statistics", [True, False])
def test_nulls_are_nan(name, statistics):
    values = [None if row % 7 == 3 else row % 2 for row in range(200)]
    column = pa.array(values, pa.int8()).cast(NUMBERS[name])
    expected = np.array([np.nan if one is None else one for one in values])
    with opened({"x": column}, columns=("x",), more={"write_statistics": statistics}) as source:
        assert source.dtype == (name if name in ("f2", "f4") else "f8")
        np.testing.assert_array_equal(read(source, 0, 200)[0], expected)
    full = {"x": pa.array([1, 2]).cast(pa.int8()).cast(NUMBERS[name])}
    with opened(full, columns=("x",), more={"write_statistics": statistics}) as source:
        assert source.dtype == (name if statistics or name[0] == "f" else "f8")
    schema = pa.schema([pa.field("x", NUMBERS[name], nullable=False)])
    with opened(pa.table(full, schema), columns=("x",), more={"write_statistics": statistics}) as source:
        assert source.dtype == name


def test_decimals_are_float64():
    values = [decimal.Decimal(k).scaleb(-3) for k in range(-500, 500)]
    with opened({"x": pa.array(values, pa.decimal128(20, 3))}) as source:
        assert source.dtype == np.float64
        np.testing.assert_allclose(read(source, 0, 1000)[0], np.arange(-500, 500) / 1000, rtol=2.0**-52, atol=0)


def test_only_numbers_by_default():
    table = pa.table(
        {
            "name": ["a", "b"],
            "x": [1.0, 2.0],
            "on": [True, False],
            "when": pa.array([1, 2], pa.timestamp("ms")),
            "pair": [{"x": 1}, {"x": 2}],
            "kind": pa.array(["a", "b"]).dictionary_encode(),
            "parts": [[1.0], [2.0]],
            "n": pa.array([3, 4], pa.int16()),
        }
    )
    with opened(table) as source:
        assert source.names == ("x", "n")
        np.testing.assert_array_equal(read(source, 0, 2)[0], [[1, 3], [2, 4]])
    for name in ("name", "when", "pair", "kind", "parts", "0"):
        with pytest.raises(ValueError, match=r"x\.parquet: column '\w+' must hold numbers, got "):
            opened(table, columns=(name,))
    for name in ("name", "on", "pair", "kind"):
        with pytest.raises(ValueError, match=f"x.parquet: the times in '{name}' must be numbers or timestamps, got"):
            opened(table, time=name)
    with pytest.raises(ValueError, match=r"x\.parquet: must hold a column of numbers, got none$"):
        opened(table.select(["name", "on"]))
    with pytest.raises(ValueError, match=r"^columns must name columns of x\.parquet \(name, x; or 0 to 1\), got 'y'"):
        opened(table.select(["name", "x"]), columns=("y",))


def test_an_index_of_pandas_is_no_channel():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"x": [1.0, 2.0]}, index=pandas.Index([0.5, 1.0], name="t"))
    frame.to_parquet("x.parquet")
    place = formats.located("src", "x.parquet")
    with formats.open_source(place, Options()) as source:
        assert (source.names, source.step) == (("x",), None)
    with formats.open_source(place, Options(time="t")) as source:
        assert (source.names, source.time, source.step) == (("x",), "t", 0.5)
    with formats.open_source(place, Options(columns=("t",))) as source:
        assert source.names == ("t",)


def test_a_region_far_inside_decodes_only_its_row_group(monkeypatch):
    with opened({"x": np.arange(10_000.0)}, group=1000) as source:
        asked, decoded, batches = [], [], source.table.iter_batches

        def noted(length: int, groups: Any, names: Any, **options: Any) -> Any:
            asked.append(groups[0])
            for batch in batches(length, groups, names, **options):
                decoded.append(batch.num_rows)
                yield batch

        monkeypatch.setattr(source.table, "iter_batches", noted)
        np.testing.assert_array_equal(read(source, 7300, 7400)[0], np.arange(7300, 7400))
        assert asked == [7]
        assert 400 <= sum(decoded) < 400 + 64
        for start in range(7360, 9800, 60):
            np.testing.assert_array_equal(read(source, start, start + 100)[0], np.arange(start, start + 100))
        assert asked == [7]
        assert 2860 <= sum(decoded) < 2860 + 64


def test_memory_is_that_of_a_batch(monkeypatch):
    from algdiff._formats import parquet

    monkeypatch.setattr(parquet, "NUMBERS", 1 << 14)
    rows = 1 << 20
    data = np.random.default_rng(3).standard_normal(rows)
    with opened({"x": data}, group=rows, more={"compression": "none", "use_dictionary": False}) as source:
        before = pa.total_allocated_bytes()
        most = 0
        for start in range(0, rows, 1 << 16):
            np.testing.assert_array_equal(read(source, start, start + 1000)[0], data[start : start + 1000])
            most = max(most, pa.total_allocated_bytes() - before)
    # The row group takes 8 MiB: its pages of 1 MiB and a buffer are read one after the other.
    assert most < 4 << 20


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda _: b"", "not a whole Parquet file"),
        (lambda held: held[:-9], "not a whole Parquet file"),
        (lambda _: b"1,2\n" * 10, "not a whole Parquet file"),
        (lambda _: b"PAR1" + b"\xff" * 100 + b"PAR1", "not a whole Parquet file"),
        (lambda held: held[:600] + bytes(100) + held[700:], "not a whole Parquet file"),
    ],
)
def test_bad_files(harm, message):
    opened({"x": np.random.default_rng(4).standard_normal(300)}, 300, {"write_page_checksum": True}).close()
    Path("x.parquet").write_bytes(harm(Path("x.parquet").read_bytes()))
    with (
        pytest.raises(ValueError, match=message) as error,
        formats.open_source(formats.located("src", "x.parquet"), Options()) as source,
    ):
        read(source, 0, 300)
    assert str(error.value).startswith("x.parquet: ")
    assert "\n" not in str(error.value)


def test_files_that_are_none():
    for name, kind in (("none.parquet", FileNotFoundError), ("folder.parquet", IsADirectoryError)):
        os.makedirs("folder.parquet", exist_ok=True)
        with pytest.raises(kind) as error:
            formats.open_source(formats.located("src", name), Options())
        assert str(error.value.filename) == name
    with pytest.raises(ValueError, match=r"x\.parquet: must hold numbers, got none"):
        opened({"x": np.empty(0)})
    twice = pa.Table.from_arrays([pa.array([1.0]), pa.array([2.0])], ["x", "x"])
    with pytest.raises(ValueError, match=r"x\.parquet: columns must have names of their own, got 'x' twice"):
        opened(twice)


# --- times -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
def test_timestamps(unit, zone):
    dates = DATE.astype(f"M8[{unit}]") + np.arange(500) * np.timedelta64(20, "ms").astype(f"m8[{unit}]")
    columns = {"x": np.arange(500.0), "when": pa.array(dates, pa.timestamp(unit, zone))}
    with opened(columns, time="when") as source:
        assert (source.time, source.time_dtype, source.step) == ("when", dates.dtype, 0.02)
        assert source.names == ("x",)
        assert source.attributes == ({} if zone is None else {"time_zone": zone})
        x, t = read(source, 130, 400)
        np.testing.assert_array_equal(x, np.arange(130, 400))
        np.testing.assert_array_equal(t, dates[130:400])
        assert t.dtype == dates.dtype


@pytest.mark.parametrize("name", ["f2", "f4", "f8", "i2", "i8", "u4"])
def test_times_that_are_numbers(name):
    # Of float32 times beyond 100 rounding moves each by up to 0.4 % of a step of a millisecond.
    times = np.arange(500).astype(name) if name != "f4" else (100 + np.arange(500) / 1000).astype(name)
    span = float(times[-1]) - float(times[0])
    with opened({"t": pa.array(times, NUMBERS[name]), "x": np.arange(500.0)}, time="t") as source:
        assert source.time_dtype == np.float64
        assert source.step == pytest.approx(span / 499, rel=1e-15)
        np.testing.assert_array_equal(read(source, 100, 400)[1], times[100:400])
    with opened({"t": pa.array(times, NUMBERS[name])}, columns=("t",), time="t") as source:
        x, t = read(source, 0, 500)
        assert x.dtype == name
        np.testing.assert_array_equal(x, t)


def test_times_that_are_not_even():
    times = np.arange(500.0)
    times[300] = 300.25
    with opened({"t": times, "x": times}, time="t") as source:
        read(source, 0, 300)
        with pytest.raises(
            ValueError, match=r"x\.parquet: row 300, column 't' must be 300.0 for even times, got 300.25"
        ):
            read(source, 290, 310)
        read(source, 301, 500)
    nulls = pa.array([None if row == 5 else row for row in range(500)], pa.timestamp("us"))
    with opened({"t": nulls, "x": times}, time="t") as source, pytest.raises(ValueError, match=r"row 5, .*, got NaT"):
        read(source, 0, 500)
    big = 2**62 + np.arange(500)
    with pytest.raises(ValueError, match=r"x\.parquet: the times in 't' must be seconds, got .* not in range"):
        opened({"t": big, "x": times}, time="t")


# --- writing -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["f4", "f8"])
@pytest.mark.parametrize("times", [None, "f8", "M8[ms]", "M8[us]", "M8[ns]"])
def test_others_read_what_is_written(dtype, times):
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    data = np.random.default_rng(5).standard_normal((730, 2)).astype(dtype)
    data[7] = [np.nan, -np.inf]
    stamps = None
    if times is not None:
        stamps = 0.1 * np.arange(730) if times == "f8" else DATE.astype(times) + np.arange(730)
    written(data, stamps, names=("a", "b.c"))
    frame, other = pandas.read_parquet("y.encoded"), polars.read_parquet("y.encoded")
    labels = [*(["t"] if times else []), "a", "b.c"]
    assert list(frame.columns) == other.columns == labels
    for found in (frame[["a", "b.c"]].to_numpy(), other.select("a", "b.c").to_numpy()):
        assert found.dtype == dtype
        np.testing.assert_array_equal(found, data)
    if stamps is not None:
        for held in (frame["t"].to_numpy(), other["t"].to_numpy()):
            assert held.dtype == stamps.dtype
            np.testing.assert_array_equal(held, stamps)
    os.rename("y.encoded", "y.parquet")
    options = Options(time=None if times is None else "t")
    with formats.open_source(formats.located("src", "y.parquet"), options) as source:
        assert source.names == ("a", "b.c")
        back, found = read(source, 0, 730)
    assert back.dtype == dtype
    np.testing.assert_array_equal(back, data)
    assert stamps is None or np.array_equal(found, stamps)


@pytest.mark.parametrize("zone", ["UTC", "Europe/Berlin"])
def test_time_zones_are_kept(zone):
    dates = DATE.astype("M8[us]") + np.arange(100)
    written(np.ones((100, 1)), dates, attributes={"time_zone": zone})
    found = pq.read_table("y.encoded")
    assert found.schema.field("t").type == pa.timestamp("us", zone)
    np.testing.assert_array_equal(found["t"].to_numpy(), dates)


@pytest.mark.parametrize(
    ("more", "names"),
    [
        ({}, ["x0", "x1"]),
        ({"names": ("a", "b")}, ["a", "b"]),
        ({"names": ("a",), "orders": (0, 2), "leading": True, "shape": (90,)}, ["a_d0", "a_d2"]),
        ({"orders": (0, 2), "leading": True, "shape": (90,)}, ["x0_d0", "x0_d2"]),
    ],
)
def test_names(more, names):
    data = np.arange(180.0).reshape(90, 2)
    shape = more.pop("shape", data.shape)
    plan = Layout(**{"shape": shape, "axis": 0, "orders": (1,), "leading": False, "dtype": data.dtype, **more})
    place = formats.located("dst", "y.parquet")
    stage = formats.create(place, Path("y.partial"), plan)
    stage.write((slice(0, 90),), data)
    formats.encode(place, stage, Path("y.encoded"), plan)
    stage.close()
    table = pq.read_table("y.encoded")
    assert table.column_names == names
    np.testing.assert_array_equal(np.stack([column.to_numpy() for column in table.columns], axis=1), data)


def test_row_groups(monkeypatch):
    from algdiff._formats import parquet, stage

    monkeypatch.setattr(stage, "BYTES", 1600)
    data = np.random.default_rng(6).standard_normal((1050, 2))
    for rows, size, groups in ((200, 1 << 20, [200] * 5 + [50]), (1 << 20, 4000, [300] * 3 + [150])):
        monkeypatch.setattr(parquet, "GROUP_ROWS", rows)
        monkeypatch.setattr(parquet, "GROUP_BYTES", size)
        written(data)
        metadata = pq.read_metadata("y.encoded")
        assert [metadata.row_group(index).num_rows for index in range(metadata.num_row_groups)] == groups


def test_tables_that_cannot_be_held():
    place = formats.located("dst", "y.parquet")
    given = {"axis": 0, "orders": (1,), "leading": False, "dtype": np.dtype("f8")}
    for names, twice in ((("a", "a"), "a"), (("a", "t"), "t")):
        plan = Layout((3, 2), names=names, time="t", time_dtype=np.dtype("f8"), **given)
        with pytest.raises(
            ValueError, match=f"columns of a .parquet OUT must have names of their own, got '{twice}' twice"
        ):
            formats.check(place, plan)
    with pytest.raises(ValueError, match=r"a \.parquet OUT must hold real numbers, got dtype complex64"):
        formats.check(place, Layout((3, 2), **{**given, "dtype": np.dtype("c8")}))
    with pytest.raises(ValueError, match=r"a \.parquet OUT must have one or two dimensions, got shape \(3, 2, 1\)"):
        formats.check(place, Layout((3, 2, 1), **given))
