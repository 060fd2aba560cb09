"""Text tables: read from anywhere as they were written, written as they are read, and refused line by line."""

from __future__ import annotations

import csv
import io
import os
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algdiff import _formats as formats
from algdiff._formats import csv as module
from algdiff._formats import lines
from algdiff._formats.base import Layout, Options

DATE = np.datetime64("2024-02-28T23:59:58.5", "us")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remember lines so often that a small file has many pieces."""
    monkeypatch.setattr(lines, "PIECE", 64)


def opened(text: str | bytes, **options: Any) -> Any:
    Path("x.csv").write_bytes(text.encode() if isinstance(text, str) else text)
    return module.open_source(Path("x.csv"), None, Options(**options))


def read(source: Any, start: int, stop: int) -> tuple[np.ndarray, np.ndarray | None]:
    place = (slice(start, stop), *(slice(0, extent) for extent in source.shape[1:]))
    out = np.empty((stop - start, *source.shape[1:]))
    return out, source.read(place, out)


def whole(text: str | bytes, **options: Any) -> np.ndarray:
    with opened(text, **options) as source:
        return read(source, 0, source.shape[0])[0]


def layout(rows: int, columns: int, **more: Any) -> Layout:
    given = {"axis": 0, "orders": (1,), "leading": False, "dtype": np.dtype("f8")}
    return Layout(shape=(rows, columns), **{**given, **more})


def timed(texts: list[str]) -> str:
    return "t,x\n" + "".join(f"{text},{index}\n" for index, text in enumerate(texts))


# --- reading -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        '"1","2"\n"3","4"\n',
        "1,2\n3,4\n\n",
        "1 , 2\n3, 4",
        "a,b\n1,2\n3,4\n",
        '"a","b"\r\n1,2\r\n3,4',
        "1;2\r3;4\r\r\r",
        "a\tb\r1\t2\r\n3\t4\n\r\n",
        b"\xef\xbb\xbf1,2\n3e0,0.4e+1",
        "a,b\n\n".replace("\n\n", "\n") + "1,2\n3,4\n" + "\n" * 700_000,
    ],
)
def test_spellings(text):
    np.testing.assert_array_equal(whole(text), [[1, 2], [3, 4]])


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("header", [False, True])
@pytest.mark.usefixtures("small")
def test_regions_in_any_order(end, header):
    rng = np.random.default_rng([len(end), ord(end[0]), header])
    for trial in range(6):
        rows, columns = int(rng.integers(1, 120)), int(rng.integers(1, 4))
        data = rng.standard_normal((rows, columns)) * 10.0 ** rng.integers(-200, 200, (rows, columns))
        data[rng.random(data.shape) < 0.1] = np.nan
        delimiter = ",;\t"[trial % 3]
        names = tuple(f"channel{delimiter} {column}" for column in range(columns))
        text = delimiter.join(f'"{name}"' for name in names) + end if header else ""
        text += end.join(delimiter.join(map(repr, row)) for row in data.tolist()) + end * (trial % 4)
        with opened(text.encode("utf-8-sig" if trial % 2 else "utf-8")) as source:
            assert source.shape == ((rows, columns) if columns > 1 else (rows,))
            assert source.names == (names if header else None)
            assert columns == 1 or source.delimiter == delimiter
            expected = data if columns > 1 else data[:, 0]
            for _ in range(30):
                start, stop = sorted(rng.integers(0, rows + 1, 2).tolist())
                np.testing.assert_array_equal(read(source, start, stop)[0], expected[start:stop])
            length, halo = int(rng.integers(2, 20)), int(rng.integers(0, 2))
            for start in range(0, rows, length - halo):
                stop = min(start + length, rows)
                np.testing.assert_array_equal(read(source, start, stop)[0], expected[start:stop])


@pytest.mark.usefixtures("small")
def test_some_columns_of_a_region():
    data = np.arange(300.0).reshape(100, 3)
    with opened("\n".join(",".join(map(repr, row)) for row in data.tolist())) as source:
        out = np.empty((40, 2))
        source.read((slice(30, 70), slice(1, 3)), out)
        np.testing.assert_array_equal(out, data[30:70, 1:])


@pytest.mark.usefixtures("small")
def test_overlapping_regions_are_not_parsed_twice(monkeypatch):
    rows, length, halo = 2000, 100, 30
    with opened("\n".join(map(str, range(rows)))) as source:
        pieces, parse = [], source._table
        monkeypatch.setattr(source, "_table", lambda index: pieces.append(index) or parse(index))
        for start in range(0, rows - length, length - halo):
            read(source, start, start + length)
        assert len(pieces) == len(set(pieces)) > 50
        pieces.clear()
        read(source, 1000, 1001)
        assert len(pieces) == 1


def test_columns_by_name_and_position():
    text = "a,b,c\n1,2,3\n4,5,6\n"
    for columns, names, expected in (
        (("c", "0"), ("c", "a"), [[3, 1], [6, 4]]),
        (("b",), ("b",), [2, 5]),
        (None, ("a", "b", "c"), [[1, 2, 3], [4, 5, 6]]),
    ):
        with opened(text, columns=columns) as source:
            assert source.names == names
        np.testing.assert_array_equal(whole(text, columns=columns), expected)


@pytest.mark.parametrize("option", ["columns", "time"])
@pytest.mark.parametrize("wrong", ["b", "1", "-1", ""])
def test_unknown_column(option, wrong):
    with pytest.raises(ValueError, match=" ") as error:
        opened("a\n1\n", **{option: (wrong,) if option == "columns" else wrong})
    noun = "columns" if option == "columns" else "a column"
    assert str(error.value) == f"{option} must name {noun} of x.csv (a; or 0 to 0), got {wrong!r}"


def test_what_is_not_chosen_by_name_may_be_text():
    text = 'note,x\n"one, two",1\n,2\n'
    np.testing.assert_array_equal(whole(text, columns=("x",)), [1, 2])
    np.testing.assert_array_equal(whole(text, columns=("1",)), [1, 2])
    # Without a header the first row might be one, of which a number is misspelt.
    with pytest.raises(ValueError, match=r"x\.csv: line 2, column 0 must be a number, got 'foo'"):
        whole("one,5\nfoo,2\n", columns=("1",))
    with pytest.raises(ValueError, match=r"x\.csv: line 3 must have 2 columns as the rows before it, got 3"):
        whole(text.replace("\n,", "\n,,"), columns=("x",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n3,oops\n", "line 3, column 1 must be a number, got 'oops'"),
        ("1,2\n3,4,5\n", "line 2 must have 2 columns as the rows before it, got 3"),
        ("a,b\n1,2\n\n3\n", "line 4 must have 2 columns as the rows before it, got 1"),
        ("a\n1\n2\n\n4\n", "line 4 must hold numbers, got nothing: a sample is missing there"),
        ("1,2\n\n3,4\n", "line 2 must hold numbers, got nothing: a sample is missing there"),
        ("\n1\n2\n", "line 1 must hold numbers, got nothing: a sample is missing there"),
        ("a\n\n1\n", "line 2 must hold numbers, got nothing: a sample is missing there"),
        ("a,b\n1,2,3\n4,5,6\n", "the rows must have 2 columns as the first, got 3"),
        ("a,b,c\n1,2\n4,5\n", "the rows must have 3 columns as the first, got 2"),
        ("a\n1\n \n", "line 3, column 0 must be a number, got ' '"),
        ("1,5;2,5\n1,5;2,5\n", "line 2, column 0 must be a number, got '1,5'"),
        ("1\n1_0\n", "line 2, column 0 must be a number, got '1_0'"),
        ('1\n"2\n3\n', "line 2 must end the quotes that it begins"),
        ("a\n1,2\n", "the rows must have 1 columns as the first, got 2"),
        ("a,b\n", "must hold numbers, got none"),
        ("", "must hold numbers, got none"),
        ("\n\n", "must hold numbers, got none"),
        (b"\xff\xfe1\n2\n", "not UTF-8 text"),
        (b"1\n2\xff\n", "not UTF-8 text"),
        (b"1\n\0\n", "line 2, column 0 must be a number"),
    ],
)
def test_malformed(text, message):
    with pytest.raises(ValueError, match=" ") as error:
        whole(text)
    assert str(error.value).startswith("x.csv: ")
    assert "\n" not in str(error.value)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("oops,2", ", column 0 must be a number, got 'oops'"),
        ("1", " must have 2 columns as the rows before it, got 1"),
        ("1,2,3", " must have 2 columns as the rows before it, got 3"),
        ("", " must hold numbers, got nothing"),
    ],
)
@pytest.mark.parametrize("header", ["", "a,b\n"])
@pytest.mark.usefixtures("small")
def test_malformed_lines_far_inside(line, message, header):
    rows = ["1.5,2.5"] * 500
    rows[432] = line
    with opened(header + "\n".join(rows)) as source:
        read(source, 0, 400)
        for _ in range(2):
            with pytest.raises(ValueError, match=f"line {433 + bool(header)}{message}"):
                read(source, 350, 500)
        np.testing.assert_array_equal(read(source, 470, 500)[0], [[1.5, 2.5]] * 30)


@pytest.mark.usefixtures("small")
def test_files_that_shrink_or_have_no_lines(monkeypatch):
    with opened("1\n" * 100_000) as source:
        os.truncate("x.csv", 100_000)
        with pytest.raises(ValueError, match=r"x\.csv: ends before the table does"):
            read(source, 0, 100_000)
    monkeypatch.setattr(lines, "LONGEST", 256)
    with pytest.raises(ValueError, match=r"x\.csv: line 2 is longer than"):
        opened(b"1\n" + b"2" * 1000)
    with pytest.raises(FileNotFoundError) as error:
        module.open_source(Path("none.csv"), None, Options())
    assert str(error.value.filename) == "none.csv"


def test_opening_and_reading_take_flat_memory():
    size = 16 << 20
    text = b"".join(b"%d.25,%d.125\n" % (index, index) for index in range(40_000))
    with open("x.csv", "wb") as file:
        for _ in range(size // len(text) + 1):
            file.write(text)
    tracemalloc.start()
    try:
        with module.open_source(Path("x.csv"), None, Options()) as source:
            out = np.empty((1000, 2))
            for start in range(0, source.shape[0] - 1000, source.shape[0] // 8):
                source.read((slice(start, start + 1000), slice(0, 2)), out)
        # A piece as bytes, as text, as 16 thousand lines and as numbers, and the one before it: some 10 to a byte.
        assert tracemalloc.get_traced_memory()[1] < 20 * lines.PIECE < size / 2
    finally:
        tracemalloc.stop()
    assert source.shape == (40_000 * (size // len(text) + 1), 2)


# --- times -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("columns", [None, ("x",), ("t", "x"), ("1",)])
@pytest.mark.parametrize("time", ["t", "0"])
@pytest.mark.usefixtures("small")
def test_times_are_no_channel_unless_chosen(columns, time):
    with opened(timed([f"{0.25 * index}" for index in range(100)]), columns=columns, time=time) as source:
        assert (source.time, source.time_dtype, source.step) == ("t", np.float64, 0.25)
        assert source.names == (("t", "x") if columns and "t" in columns else ("x",))
        x, t = read(source, 37, 80)
        np.testing.assert_array_equal(t, 0.25 * np.arange(37, 80))
        np.testing.assert_array_equal(x if x.ndim == 1 else x[:, 1], np.arange(37, 80))


@pytest.mark.parametrize("step", [1e-3, 1 / 44100, 0.1, 60.0, 1 / 3])
@pytest.mark.parametrize("origin", [0.0, -7.5, 1.7e9])
@pytest.mark.parametrize("decimals", [None, 9, 6])
@pytest.mark.usefixtures("small")
def test_even_times_are_even_however_they_are_printed(step, origin, decimals):
    rows = 2000
    times = origin + step * np.arange(rows)
    texts = [repr(one) if decimals is None else f"{one:.{decimals}f}" for one in times.tolist()]
    spacing = float(np.spacing(abs(origin) + step * rows))
    if spacing + 10.0 ** -(decimals or 9) > 0.1 * step:
        pytest.skip("too few digits for this step")
    with opened(timed(texts), time="t") as source:
        assert source.step == pytest.approx(step, abs=(spacing + (0 if decimals is None else 10.0**-decimals)) / 1000)
        np.testing.assert_array_equal(read(source, 0, rows)[1], [float(text) for text in texts])


@pytest.mark.parametrize(
    "texts", [[f"{k / 3:.2f}" for k in range(400)], [f"{int(100 * k / 3) / 100}" for k in range(400)]]
)
@pytest.mark.usefixtures("small")
def test_times_rounded_or_cut_to_few_decimals(texts):
    with opened(timed(texts), time="t") as source:
        assert source.step == pytest.approx(1 / 3, abs=0.01 / 399)
        read(source, 0, 400)


@pytest.mark.parametrize("missing", [1, 2, 250, 498, 499])
@pytest.mark.parametrize("unit", [1.0, 0.004, 1e-6])
@pytest.mark.usefixtures("small")
def test_one_missing_sample_is_refused(missing, unit):
    texts = [repr(k * unit) for k in range(501) if k != missing]
    with opened(timed(texts), time="t") as source, pytest.raises(ValueError, match=r"for even times, got"):
        read(source, 0, 500)


@pytest.mark.parametrize(
    ("row", "text", "message"),
    [
        (40, "0.4011", "line 42, column 0 must be 0.4 for even times, got 0.4011; load uneven ones"),
        (40, "0.39", "line 42, column 0 must be 0.4 for even times, got 0.39"),
        (40, "nan", "line 42, column 0 must be 0.4 for even times, got nan"),
        (99, "nan", "the times in 't' must ascend, got 0.0 first and nan last"),
        (99, "0", "the times in 't' must ascend, got 0.0 first and 0.0 last"),
        (99, "-1", "the times in 't' must ascend, got 0.0 first and -1.0 last"),
        (99, "inf", "the times in 't' must ascend, got 0.0 first and inf last"),
        (40, "soon", "line 42, column 0 must be a number, got 'soon'"),
    ],
)
@pytest.mark.usefixtures("small")
def test_times_that_are_not_even(row, text, message):
    texts = [f"{k / 100}" for k in range(100)]
    texts[row] = text
    with pytest.raises(ValueError, match=" ") as error, opened(timed(texts), time="t") as source:
        read(source, 30, 100)
    assert message in str(error.value)
    assert str(error.value).startswith("x.csv: ")


def test_times_may_lie_a_thousandth_of_a_step_apart():
    times = np.arange(100) * 1e-2 + np.where(np.arange(100) % 7 == 3, 0.99e-5, 0.0)
    with opened(timed(list(map(repr, times.tolist()))), time="t") as source:
        np.testing.assert_array_equal(read(source, 0, 100)[1], times)
    times[50] += 1.02e-5
    with opened(timed(list(map(repr, times.tolist()))), time="t") as source, pytest.raises(ValueError, match="line 52"):
        read(source, 0, 100)


@pytest.mark.parametrize("zone", ["", "Z", "+01:00", "-0530"])
@pytest.mark.parametrize(("unit", "decimals"), [("us", 0), ("us", 3), ("us", 6), ("ns", 9)])
@pytest.mark.parametrize("header", [False, True])
@pytest.mark.usefixtures("small")
def test_dates(zone, unit, decimals, header):
    step = np.timedelta64(10 ** (9 - decimals), "ns")
    dates = DATE.astype("M8[s]").astype("M8[ns]") + np.arange(90) * step
    shown = np.datetime_as_string(dates, unit={0: "s", 3: "ms", 6: "us", 9: "ns"}[decimals])
    text = timed([one.replace("T", " " if header else "T") + zone for one in shown])
    with opened(text if header else text.partition("\n")[2], time="0") as source:
        assert source.names == (("x",) if header else None)
        assert (source.time, source.time_dtype) == ("t" if header else "time", np.dtype(f"M8[{unit}]"))
        assert source.step == pytest.approx(10.0**-decimals, rel=1e-15)
        assert source.attributes == ({"time_zone": "UTC"} if zone else {})
        ahead = {"": 0, "Z": 0, "+01:00": 60, "-0530": -330}[zone]
        x, t = read(source, 20, 71)
        np.testing.assert_array_equal(x, np.arange(20, 71))
        np.testing.assert_array_equal(t, dates[20:71] - np.timedelta64(ahead, "m"))
        assert t.dtype == source.time_dtype


def test_dates_across_a_change_of_their_zone():
    texts = ["2024-03-31T01:59:58+01:00", "2024-03-31T01:59:59+01:00", "2024-03-31T03:00:00+02:00"]
    with opened(timed(texts), time="t") as source:
        assert source.step == 1.0
        np.testing.assert_array_equal(read(source, 0, 3)[1][-1], np.datetime64("2024-03-31T01:00:00"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2024-02-28T00:00:05Z", "line 7, column 0 must be an ISO 8601 date without time zone, got"),
        ("2024-02-30", "line 7, column 0 must be an ISO 8601 date without time zone, got '2024-02-30'"),
        ("now", "line 7, column 0 must be an ISO 8601 date without time zone, got 'now'"),
        ("5", "line 7, column 0 must be an ISO 8601 date without time zone, got '5'"),
        ("2024-02-28T00:00:06", "must be 2024-02-28T00:00:05.000000 for even times, got 2024-02-28T00:00:06.000000"),
    ],
)
def test_dates_that_are_none(text, message):
    texts = [f"2024-02-28T00:00:{second:02}" for second in range(60)]
    texts[5] = text
    with pytest.raises(ValueError, match=" ") as error, opened(timed(texts), time="t") as source:
        read(source, 0, 60)
    assert message in str(error.value)
    with pytest.raises(ValueError, match="column 0 must be a number, got '2024"):
        whole(timed(texts), time="t", columns=("t", "x"))


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("zones", [("", "Z"), ("+02:00", "")])
@pytest.mark.parametrize("first", [30, 31, 32, 33])
def test_dates_that_get_or_lose_a_zone(zones, first):
    """Some of them where a piece begins."""
    texts = [f"2024-02-28T00:00:{second:02}{zones[first <= second < first + 10]}" for second in range(60)]
    with (
        pytest.raises(ValueError, match=rf"line {first + 2}, column 0 must be an ISO 8601 date with"),
        opened(timed(texts), time="t") as source,
    ):
        read(source, 0, 60)


def test_a_single_time_says_no_step():
    with opened("t,x\n3,1\n", time="t") as source:
        assert source.step is None
        assert read(source, 0, 1)[1] == [3.0]
    with pytest.raises(ValueError, match="must hold a column of numbers beside the times in 't', got none"):
        opened("t\n1\n2\n", time="t")


# --- writing -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["f4", "f8"])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("names", [None, ("a,;\t", 'b"c'), ("x", "y")])
@pytest.mark.parametrize("times", [None, "f8", "M8[us]"])
def test_written_as_it_is_read(monkeypatch, dtype, delimiter, names, times):
    monkeypatch.setattr(module, "NUMBERS", 32)
    rng = np.random.default_rng([len(dtype), ord(delimiter)])
    data = (rng.standard_normal((100, 2)) * 10.0 ** rng.integers(-30, 30, (100, 2))).astype(dtype)
    data[5] = [np.nan, np.inf]
    stamps = None
    if times is not None:
        stamps = 0.1 * np.arange(100) if times == "f8" else DATE + np.arange(100) * np.timedelta64(1500, "us")
    given = {"names": names, "delimiter": delimiter, "dtype": data.dtype}
    given |= {"time": None if times is None else "t", "time_dtype": times and np.dtype(times)}
    plan = layout(100, 2, **given)
    module.check(Path("y.csv"), None, plan)
    target = module.create(Path("y.csv"), None, plan)
    for start, stop in ((0, 41), (41, 41), (41, 100)):
        target.write((slice(start, stop),), data[start:stop], None if stamps is None else stamps[start:stop])
    assert target.sync() == os.path.getsize("y.csv")
    target.close()
    with open("y.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file, delimiter=delimiter))
    if names is not None:
        assert tuple(rows.pop(0)) == (*(("t",) if times else ()), *names)
    kept = [row[1:] if times else row for row in rows]
    assert kept == [[repr(v) if dtype == "f8" else f"{v:.9g}" for v in row] for row in data.tolist()]
    options = Options(time="0" if times else None)
    with module.open_source(Path("y.csv"), None, options) as source:
        back, found = read(source, 0, 100)
    np.testing.assert_array_equal(back.astype(dtype), data)
    if stamps is not None:
        np.testing.assert_array_equal(found, stamps)


def test_other_readers_agree():
    pandas = pytest.importorskip("pandas")
    data = np.random.default_rng(1).standard_normal((50, 2))
    dates = DATE + np.arange(50) * np.timedelta64(1, "s")
    plan = layout(50, 2, names=("a", "b"), time="t", time_dtype=dates.dtype, attributes={"time_zone": "UTC"})
    target = module.create(Path("y.csv"), None, plan)
    target.write((slice(0, 50),), data, dates)
    target.close()
    frame = pandas.read_csv("y.csv", parse_dates=["t"])
    np.testing.assert_array_equal(frame[["a", "b"]].to_numpy(), data)
    np.testing.assert_array_equal(frame["t"].dt.tz_localize(None).to_numpy(), dates)
    assert str(frame["t"].dt.tz) == "UTC"


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ({"leading": True, "orders": (0, 2)}, b"x0_d0,x1_d0,x0_d2,x1_d2\n"),
        ({"leading": True, "orders": (1,), "names": ("a", "b")}, b"a_d1,b_d1\n"),
        ({"leading": True, "orders": (1,), "time": "time", "time_dtype": np.dtype("f8")}, b"time,x0_d1,x1_d1\n"),
        ({"time": "time", "time_dtype": np.dtype("f8")}, b""),
        ({}, b""),
    ],
)
def test_header(more, line):
    module.create(Path("y.csv"), None, layout(3, 2, **more)).close()
    assert Path("y.csv").read_bytes() == line


def test_going_on_after_a_kill():
    data = np.random.default_rng(2).standard_normal((30, 2))
    plan = layout(30, 2, names=("a", "b"))
    target = module.create(Path("y.csv"), None, plan)
    target.write((slice(0, 30),), data)
    target.close()
    expected = Path("y.csv").read_bytes()
    target = module.create(Path("z.csv"), None, plan)
    target.write((slice(0, 10),), data[:10])
    mark = target.sync()
    target.write((slice(10, 25),), data[10:25])
    target.close()
    os.truncate("z.csv", mark + 7)
    target = module.reopen(Path("z.csv"), None, plan, mark)
    assert os.path.getsize("z.csv") == mark
    target.write((slice(10, 30),), data[10:])
    target.close()
    assert Path("z.csv").read_bytes() == expected
    with pytest.raises(ValueError, match=r"y\.csv: must hold at least 99999 bytes to go on, got"):
        module.reopen(Path("y.csv"), None, plan, 99999)


def test_what_a_full_disk_cuts_off_does_not_count(monkeypatch):
    class Full(io.FileIO):
        """Takes one piece and a half."""

        room = 1

        def write(self, data: Any) -> int:
            self.room -= 1
            if self.room < -1:
                raise OSError(28, "No space left on device")
            return super().write(data if self.room >= 0 else data[: len(data) // 2])

    monkeypatch.setattr(module, "NUMBERS", 8)
    target = module.create(Path("y.csv"), None, layout(12, 2))
    target.write((slice(0, 4),), np.ones((4, 2)))
    before = target.sync()
    target.close()
    target.file = Full("y.csv", "r+")
    target.file.seek(before)
    with pytest.raises(OSError, match="No space"):
        target.write((slice(4, 12),), np.ones((8, 2)))
    assert os.path.getsize("y.csv") > before
    assert target.sync() == before
    target.close()


def test_writes_in_small_pieces():
    class Slow(io.FileIO):
        def write(self, data: Any) -> int:
            return super().write(data[:7])

    target = module.create(Path("y.csv"), None, layout(12, 2))
    target.close()
    target.file = Slow("y.csv", "r+")
    target.write((slice(0, 12),), np.arange(24.0).reshape(12, 2))
    target.close()
    np.testing.assert_array_equal(whole(Path("y.csv").read_bytes()), np.arange(24.0).reshape(12, 2))


def test_tables_that_cannot_be_held():
    place = formats.located("dst", "y.CSV")
    with pytest.raises(ValueError, match=" ") as error:
        formats.check(place, Layout((2, 3, 4), 2, (1,), False, np.dtype("f8")))
    assert str(error.value) == ("a .csv OUT must have one or two dimensions, got shape (2, 3, 4); write .npy or .npz")
    with pytest.raises(ValueError, match=" ") as error:
        formats.check(place, layout(3, 2, dtype=np.dtype("c16")))
    assert str(error.value) == "a .csv OUT must hold real numbers, got dtype complex128; write .npy or .npz"
    formats.check(place, layout(3, 2))
