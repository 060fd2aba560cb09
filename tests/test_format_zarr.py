"""Zarr: regions of arrays of both formats, what stores say of the step, outputs in whole chunks, bad stores."""

from __future__ import annotations

import json
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algdiff import _formats as formats
from algdiff._formats.base import Layout, Options

zarr = pytest.importorskip("zarr", reason="needs zarr 3", minversion="3")

TYPES = ["?", "i1", "<i2", ">i4", "<u8", "<f2", ">f4", "<f8", ">f8", "<c8", "<c16", ">c16"]


def source(path: Any) -> Any:
    return formats.open_source(formats.located("src", path), Options())


def saved(path: Path, name: str | None = None, **words: Any) -> Any:
    data = words.pop("data")
    dtype = words.pop("dtype", data.dtype)
    words.setdefault("chunks", tuple(max(extent, 1) for extent in data.shape))
    array = zarr.create_array(str(path), name=name, shape=data.shape, dtype=dtype, **words)
    array[...] = data
    return array


def regions(rng: np.random.Generator, shape: tuple[int, ...], count: int) -> list[tuple[slice, ...]]:
    ends = [[np.sort(rng.integers(0, extent + 1, 2)) for extent in shape] for _ in range(count)]
    return [tuple(slice(int(first), int(last)) for first, last in pairs) for pairs in ends]


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize(
    "how",
    [
        {"chunks": (3, 16), "zarr_format": 3},
        {"chunks": (3, 16), "zarr_format": 2},
        {"chunks": (3, 16), "zarr_format": 2, "order": "F", "compressors": None},
        {"chunks": (2, 25), "shards": (4, 50), "zarr_format": 3},
    ],
)
def test_regions_are_those_of_the_array(tmp_path: Path, dtype: str, how: dict[str, Any]) -> None:
    rng = np.random.default_rng(0)
    x = (100 * rng.standard_normal((7, 100))).astype(dtype)
    saved(tmp_path / "x.zarr", data=x, **how)
    with source(tmp_path / "x.zarr") as found:
        assert (found.shape, found.axis, found.fortran, found.chunks) == (x.shape, -1, False, how["chunks"])
        assert found.dtype.newbyteorder("=") == x.dtype.newbyteorder("=")
        for place in regions(rng, x.shape, 10):
            out = np.empty(x[place].shape, found.dtype)
            assert found.read(place, out) is None
            np.testing.assert_array_equal(out, x[place])


def test_names_of_arrays(tmp_path: Path) -> None:
    path = tmp_path / "x.zarr"
    zarr.create_group(str(path))
    saved(path, "g/x", data=np.arange(3.0), dimension_names=["time"])
    saved(path, "g/time", data=np.arange(3.0), dimension_names=["time"])
    saved(path, "g/when", data=np.arange(3).astype("M8[s]"))
    (path / "notes.txt").write_text("no part of the store")
    for name in ("", ":g/x", ":/g/x", "://g//x"):
        with source(f"{path}{name}") as found:
            assert (found.name, found.shape) == ("g/x", (3,))
    for index in range(11):
        saved(path, f"x{index:02}", data=np.arange(3.0))
    ten = "".join(f", {path}:/x{index:02}" for index in range(9))
    with pytest.raises(ValueError, match="must be given with one of its arrays") as caught:
        source(path)
    assert str(caught.value) == f"{path}: must be given with one of its arrays, as in {path}:/g/x{ten}, ..."
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: must hold an array nope, got {path}:/g/x, "):
        source(f"{path}:/nope")
    with pytest.raises(ValueError, match=r"x\.zarr: must hold an array g, got"):
        source(f"{path}:/g")
    with pytest.raises(ValueError, match=r"x\.zarr/g/when must hold real or complex numbers, got datetime64\[s\]$"):
        source(f"{path}:/g/when")
    for name in ("../x.zarr/x00", "g/../x00", "..."):
        with pytest.raises(ValueError, match=r"x\.zarr: an array must have a printable name"):
            source(f"{path}:{name}")


def test_what_is_no_store(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"nope\.zarr'$"):
        source(tmp_path / "nope.zarr")
    (tmp_path / "file.zarr").write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"file\.zarr: must be the folder of a Zarr store, got a file$"):
        source(tmp_path / "file.zarr")
    (tmp_path / "x.zarr").mkdir()
    with pytest.raises(ValueError, match=r"x\.zarr: must be a Zarr store with an array of numbers, got none$"):
        source(tmp_path / "x.zarr")
    saved(tmp_path / "single.zarr", data=np.array(1.0), chunks=())
    with pytest.raises(ValueError, match=r"single\.zarr must be an array, got a single value$"):
        source(tmp_path / "single.zarr")
    with pytest.raises(FileNotFoundError):
        source("https://example.org/x.zarr")


def test_metadata_that_are_none(tmp_path: Path) -> None:
    path = tmp_path / "x.zarr"
    saved(path, data=np.arange(10.0))
    whole = json.loads((path / "zarr.json").read_text())
    wrong: list[Any] = [
        {"data_type": "string"},
        {"data_type": {"name": "fixed_length_utf32", "configuration": {"length_bytes": 8}}},
        {"data_type": "r64"},
        {"data_type": 3},
        {"shape": "ten"},
        {"shape": [-3]},
        {"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [0]}}},
        {"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [3, 3]}}},
        {"codecs": [{"name": "nope"}]},
        {"codecs": []},
        {"attributes": 3},
        {"zarr_format": 7},
        {"node_type": None},
    ]
    texts = [json.dumps({**whole, **one}) for one in wrong] + ["", "{", "[]", "3", "null", "\xff", "[" * 100_000]
    for text in texts:
        (path / "zarr.json").write_text(text, encoding="latin-1")
        with pytest.raises(ValueError, match=r"^\S+x\.zarr(: | must hold real)") as caught:
            source(path)
        assert "\n" not in str(caught.value)


def test_absurd_shapes_take_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "x.zarr"
    saved(path, data=np.arange(10.0))
    said = json.loads((path / "zarr.json").read_text())
    said["shape"] = [1 << 50]
    said["chunk_grid"]["configuration"]["chunk_shape"] = [1 << 50]
    (path / "zarr.json").write_text(json.dumps(said))
    with source(path) as found:
        assert found.shape == (1 << 50,)
        with pytest.raises((ValueError, MemoryError)):
            found.read((slice(0, 10),), np.empty(10))
        (path / "c/0").unlink()
        out = np.empty(10)
        found.read((slice(0, 10),), out)
    np.testing.assert_array_equal(out, np.zeros(10))


def test_damaged_chunks_raise_value_errors_that_name_the_store(tmp_path: Path) -> None:
    for index, how in enumerate(
        ({"compressors": None}, {"compressors": "auto"}, {"zarr_format": 2}, {"shards": (100,)})
    ):
        path = tmp_path / f"{index}.zarr"
        saved(path, data=np.arange(100.0), chunks=(50,), **how)
        chunk = next(file for file in sorted(path.rglob("*")) if file.is_file() and file.name in ("0", "1"))
        whole = chunk.read_bytes()
        # An empty shard counts as one that was never written.
        for content in (whole[:-7], whole[: len(whole) // 2], *([] if "shards" in how else [b""])):
            chunk.write_bytes(content)
            with source(path) as found, pytest.raises(ValueError, match=rf"{index}\.zarr: not a whole Zarr store \("):
                found.read((slice(0, 100),), np.empty(100))


class Ran:
    """What leaves a folder behind if it is loaded."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("ran",)


def test_no_pickle_is_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "x.zarr"
    saved(path, data=np.arange(10.0), zarr_format=2, compressors=None)
    whole = json.loads((path / ".zarray").read_text())
    (path / "0").write_bytes(pickle.dumps(Ran()))
    for change in ({"filters": [{"id": "pickle"}]}, {"compressor": {"id": "pickle"}}):
        (path / ".zarray").write_text(json.dumps({**whole, **change}))
        with pytest.raises(
            ValueError, match=r"x\.zarr must hold numbers, got pickled objects, which could run anything"
        ):
            source(path)
        assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("form", [2, 3])
def test_steps_in_attributes(tmp_path: Path, form: int) -> None:
    path = tmp_path / "x.zarr"
    root = zarr.create_group(str(path), zarr_format=form)
    group = root.create_group("g")
    array = group.create_array("x", shape=(2, 5), dtype="f8")
    for node, attributes in ((root, {"FS": 500}), (group, {"dt": 0.25}), (array, {"sampling_rate": [2.0]})):
        assert source(path).step_along(0) == {"/": None, "/g": 2e-3, "/g/x": 0.25}[node.name]
        node.attrs.update(attributes)
    assert source(path).step_along(1) == 0.5
    for value in (0, -1.0, 10**400):
        array.attrs["sampling_rate"] = value
        with pytest.raises(ValueError, match=r"x\.zarr/g/x: its attribute sampling_rate must be positive and finite"):
            source(path).step_along(1)
    array.attrs["sampling_rate"] = "500 Hz"
    with pytest.raises(ValueError, match=r"its attribute sampling_rate must be a number, got '500 Hz'"):
        source(path).step_along(1)


def test_packed_arrays_of_xarray_are_refused(tmp_path: Path) -> None:
    xr = pytest.importorskip("xarray")
    x = xr.Dataset({"v": ("time", np.linspace(0, 1, 100)), "w": ("time", np.linspace(0, 1, 100))})
    x["u"] = x.v.copy()
    packed = {"dtype": "i2", "scale_factor": 1e-4, "_FillValue": -9999}
    x.to_zarr(tmp_path / "x.zarr", encoding={"v": packed, "w": {"_FillValue": -9999.0}}, consolidated=False)
    for name, fault in (("v", "packed ones"), ("w", "_FillValue = -9999.0")):
        with pytest.raises(ValueError, match=fault):
            source(f"{tmp_path / 'x.zarr'}:/{name}")
    source(f"{tmp_path / 'x.zarr'}:/u").close()


@pytest.mark.parametrize("form", [2, 3])
@pytest.mark.parametrize(
    ("values", "attributes", "step"),
    [
        (np.arange(2000) * 0.25 + 7, {}, 0.25),
        ((np.arange(2000) * 0.01).astype(">f4"), {"units": "s"}, 0.01),
        (2 * np.arange(2000), {"units": "milliseconds since 2000-01-01", "calendar": "standard"}, 2e-3),
        (np.arange(2000).astype("M8[ms]"), {}, 1e-3),
        (np.arange(2000).astype("m8[10us]"), {}, 1e-5),
        (np.arange(2000), {"units": "m"}, None),
        (np.zeros(2000, "?"), {}, None),
    ],
)
def test_steps_of_coordinates(tmp_path: Path, form: int, values: Any, attributes: dict[str, Any], step: Any) -> None:
    path = tmp_path / "x.zarr"
    zarr.create_group(str(path), zarr_format=form)
    names: list[dict[str, Any]] = [{"dimension_names": ["c", "time"]}, {"dimension_names": ["time"]}]
    if form == 2:
        names = [{"attributes": {"_ARRAY_DIMENSIONS": list(one["dimension_names"])}} for one in names]
    saved(path, "g/x", data=np.zeros((3, 2000)), zarr_format=form, **names[0])
    saved(path, "g/time", data=values, zarr_format=form, **names[1]).attrs.update(attributes)
    with source(f"{path}:g/x") as found:
        assert found.step_along(1) == (step if step is None else pytest.approx(step, rel=1e-6, abs=0))
        assert found.step_along(0) is None
        assert found.attributes == {"_ARRAY_DIMENSIONS": ["c", "time"]}


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (
            np.arange(2000) + (np.arange(2000) == 7),
            "the time at place 7 of 'time' must be 7.0 for even times, got 8.0; ",
        ),
        (np.full(2000, "NaT", "M8[s]"), "the times in 'time' must ascend"),
        (np.arange(1999), "time must hold a time for each of 2000 samples, got shape \\(1999,\\)"),
    ],
)
def test_uneven_coordinates_are_refused(tmp_path: Path, values: Any, said: str) -> None:
    path = tmp_path / "x.zarr"
    zarr.create_group(str(path))
    saved(path, "x", data=np.zeros(2000), dimension_names=["time"])
    saved(path, "time", data=values, dimension_names=["time"])
    with source(f"{path}:x") as found, pytest.raises(ValueError, match=rf"^{path}: {said}"):
        found.step_along(0)


def test_names_of_dimensions_lead_to_no_other_place(tmp_path: Path) -> None:
    zarr.create_group(str(tmp_path / "x.zarr"))
    saved(tmp_path / "other", data=np.arange(5.0))
    for index, name in enumerate(("../other", "..", ".", "", None)):
        saved(tmp_path / "x.zarr", f"x{index}", data=np.zeros(5), dimension_names=[name])
        with source(f"{tmp_path}/x.zarr:x{index}") as found:
            assert found.step_along(0) is None


def test_what_xarray_writes(tmp_path: Path) -> None:
    xr = pytest.importorskip("xarray", reason="needs xarray")
    pd = pytest.importorskip("pandas", reason="needs pandas")
    time = pd.date_range("2020-01-01", periods=50, freq="20ms")
    data = xr.DataArray(
        np.arange(150.0).reshape(3, 50), dims=("c", "time"), coords={"time": time}, attrs={"units": "m"}
    )
    for form in (2, 3):
        path = tmp_path / f"{form}.zarr"
        data.to_dataset(name="x").to_zarr(path, zarr_format=form, consolidated=False)
        with source(path) as found:
            assert (found.name, found.shape, found.step_along(1)) == ("x", (3, 50), pytest.approx(0.02, rel=1e-12))
            assert found.attributes["units"] == "m"
            attributes = found.attributes
    wanted = layout((3, 50), (1, 2), True, "f8", step=0.02, attributes=attributes)
    place = formats.located("dst", f"{tmp_path}/y.zarr:v")
    target = formats.create(place, place.path, wanted)
    target.write((slice(0, 3), slice(0, 50)), np.arange(300.0).reshape(2, 3, 50))
    target.close()
    with xr.open_zarr(place.path, consolidated=False, chunks=None) as result:
        assert result.v.dims == ("deriv", "c", "time")
        assert result.v.attrs == {"deriv": [1, 2], "delta": 0.02, "fs": 50.0}
        np.testing.assert_array_equal(result.v, np.arange(300.0).reshape(2, 3, 50))


def layout(shape: tuple[int, ...], orders: tuple[int, ...], leading: bool, dtype: Any, **words: Any) -> Layout:
    return Layout(
        **{"shape": shape, "axis": len(shape) - 1, "orders": orders, "leading": leading, **words}, dtype=np.dtype(dtype)
    )


def places(wanted: Layout, chunks: tuple[int, ...]) -> list[tuple[slice, ...]]:
    grids = [range(0, extent, chunk) for extent, chunk in zip(wanted.shape, chunks, strict=True)]
    corners = np.stack(np.meshgrid(*grids, indexing="ij"), -1).reshape(-1, len(chunks))
    return [
        tuple(slice(int(a), min(int(a) + c, extent)) for a, c, extent in zip(corner, chunks, wanted.shape, strict=True))
        for corner in corners
    ]


@pytest.mark.parametrize("dtype", ["f4", "f8", "c8", "c16"])
@pytest.mark.parametrize("inner", [None, "/a/b/y", "y"])
@pytest.mark.parametrize("orders", [(1,), (0, 2)])
def test_outputs_are_what_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dtype: str, inner: str | None, orders: tuple[int, ...]
) -> None:
    from algdiff._formats import chunks

    monkeypatch.setattr(chunks, "CHUNK", 1 << 7)
    rng = np.random.default_rng(2)
    wanted = layout((5, 40), orders, len(orders) > 1, dtype)
    result = np.asarray(100 * rng.standard_normal((len(orders), 5, 40)), dtype)
    if result.dtype.kind == "c":
        result.imag = rng.standard_normal(result.shape)
    place = formats.located("dst", tmp_path / "y.zarr" if inner is None else f"{tmp_path}/y.zarr:{inner}")
    formats.check(place, wanted)
    grain = formats.grain(place, wanted)
    assert grain is not None
    assert grain[1] < 40
    partial = tmp_path / "y.zarr.partial"
    target = formats.create(place, partial, wanted)
    for number, region in enumerate(places(wanted, grain)):
        target.write(region, np.asfortranarray(result[(slice(None), *region)]))
        if number % 7 == 0:
            mark = target.sync()
            target.close()
            target = formats.reopen(place, partial, wanted, mark)
    target.sync()
    target.close()
    array = zarr.open_array(str(partial), path=inner, mode="r")
    np.testing.assert_array_equal(array[...], result if wanted.leading else result[0])
    assert (array.dtype, array.metadata.zarr_format) == (np.dtype(dtype), 3)
    assert array.chunks == ((1, *grain) if wanted.leading else grain)
    assert array.attrs.asdict() == {"deriv": list(orders) if wanted.leading else orders[0]}
    assert not list(partial.rglob("*.partial"))
    if inner is not None:
        assert isinstance(zarr.open(str(partial), mode="r"), zarr.Group)
    da = pytest.importorskip("dask.array", reason="needs dask[array]")
    lazy = da.from_zarr(str(partial), component=inner)
    np.testing.assert_array_equal(lazy.compute(scheduler="threads"), result if wanted.leading else result[0])


@pytest.mark.parametrize("shape", [(0, 5), (3, 0)])
def test_outputs_without_numbers(tmp_path: Path, shape: tuple[int, ...]) -> None:
    place = formats.located("dst", tmp_path / "y.zarr")
    wanted = layout(shape, (1,), False, "f8")
    target = formats.create(place, place.path, wanted)
    target.write(tuple(slice(0, extent) for extent in shape), np.empty((1, *shape)))
    target.sync()
    target.close()
    with source(place.path) as found:
        assert found.shape == shape


def test_chunks_that_are_all_fill_value_are_written(tmp_path: Path) -> None:
    place = formats.located("dst", tmp_path / "y.zarr")
    wanted = layout((2, 5), (1,), False, "f8")
    target = formats.create(place, place.path, wanted)
    assert np.isnan(zarr.open_array(str(place.path), mode="r")[...]).all()
    target.write((slice(0, 2), slice(0, 5)), np.full((1, 2, 5), np.nan))
    target.close()
    assert (place.path / "c/0/0").stat().st_size == 80


def test_what_a_kill_leaves_vanishes_when_the_chunk_is_written_again(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import os, pathlib, signal, sys\n"
        "import numpy as np\n"
        "from algdiff import _formats as formats\n"
        "from algdiff._formats.base import Layout\n"
        "wanted = Layout((4, 6), 1, (1,), False, np.dtype('f8'), chunks=(1, 6))\n"
        "place = formats.located('dst', 'y.zarr')\n"
        "target = formats.create(place, place.path, wanted)\n"
        "block = np.arange(24.0).reshape(1, 4, 6)\n"
        "target.write((slice(0, 4), slice(0, 6)), block)\n"
        "print(target.sync(), flush=True)\n"
        "os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n"
        "target.write((slice(0, 4), slice(0, 6)), -block)\n"
    )
    run = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (-signal.SIGKILL, "0\n"), run.stderr
    wanted = Layout((4, 6), 1, (1,), False, np.dtype("f8"), chunks=(1, 6))
    place = formats.located("dst", tmp_path / "y.zarr")
    left = list(place.path.rglob("*.partial"))
    assert left
    np.testing.assert_array_equal(zarr.open_array(str(place.path), mode="r")[...], np.arange(24.0).reshape(4, 6))
    target = formats.reopen(place, place.path, wanted, 0)
    target.write((slice(0, 4), slice(0, 6)), -np.arange(24.0).reshape(1, 4, 6))
    target.sync()
    target.close()
    assert not [file for file in place.path.rglob("*") if ".partial" in file.name]
    np.testing.assert_array_equal(zarr.open_array(str(place.path), mode="r")[...], -np.arange(24.0).reshape(4, 6))


def test_everything_that_was_written_is_made_durable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    real = os.fsync

    def fsync(handle: int) -> None:
        made.append(os.path.relpath(os.readlink(f"/proc/self/fd/{handle}"), tmp_path))
        real(handle)

    if not Path("/proc/self/fd").exists():
        pytest.skip("needs /proc")
    monkeypatch.setattr(os, "fsync", fsync)
    place = formats.located("dst", f"{tmp_path}/y.zarr:g/y")
    wanted = layout((2, 400), (1,), False, "f8", chunks=(1, 400))
    target = formats.create(place, place.path, wanted)
    assert set(made) == {
        ".",
        "y.zarr",
        "y.zarr/zarr.json",
        "y.zarr/g",
        "y.zarr/g/zarr.json",
        "y.zarr/g/y",
        "y.zarr/g/y/zarr.json",
    }
    made.clear()
    from algdiff._formats import chunks

    monkeypatch.setattr(chunks, "GOOD", range(1 << 30))
    shutil.rmtree(place.path)
    target = formats.create(place, place.path, wanted)
    for row in range(2):
        target.write((slice(row, row + 1), slice(0, 400)), np.zeros((1, 1, 400)))
        made.clear()
        target.sync()
        folders = {"y.zarr/g/y/c", f"y.zarr/g/y/c/{row}"}
        assert {file for file in made if "/c" in file} == {f"y.zarr/g/y/c/{row}/0", *folders}
    made.clear()
    target.sync()
    assert made == []


def test_after_a_failed_write_nothing_is_written_any_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from algdiff._formats import zarr as module

    place = formats.located("dst", tmp_path / "y.zarr")
    wanted = layout((64, 6), (1,), False, "f8", chunks=(1, 6))
    monkeypatch.setattr("algdiff._formats.chunks.GOOD", range(1 << 30))
    target = formats.create(place, place.path, wanted)
    real, count, lock = module.os.replace, [0], threading.Lock()

    def replace(*names: Any) -> None:
        with lock:
            count[0] += 1
            full = count[0] == 3
        if full:
            raise OSError(28, "No space left on device", str(names[1]))
        real(*names)

    monkeypatch.setattr(os, "replace", replace)
    with pytest.raises(OSError, match="No space left on device"):
        target.write((slice(0, 64), slice(0, 6)), np.zeros((1, 64, 6)))
    shutil.rmtree(place.path)
    target.close()
    threading.Event().wait(0.2)
    assert not place.path.exists()
    with pytest.raises(OSError, match="canceled"):
        target.write((slice(0, 64), slice(0, 6)), np.zeros((1, 64, 6)))
    assert not place.path.exists()


def test_threads_read_and_write_at_once(tmp_path: Path) -> None:
    x = np.random.default_rng(3).standard_normal((4, 50_000))
    saved(tmp_path / "x.zarr", data=x, chunks=(1, 1000))
    place = formats.located("dst", tmp_path / "y.zarr")
    wanted = layout(x.shape, (1,), False, "f8", chunks=(2, 16384))
    target = formats.create(place, place.path, wanted)
    with source(tmp_path / "x.zarr") as found, ThreadPoolExecutor(1) as reader, ThreadPoolExecutor(1) as writer:

        def read(region: tuple[slice, ...]) -> Any:
            out = np.empty(x[region].shape)
            found.read(region, out)
            return out

        regions_ = places(wanted, formats.grain(place, wanted) or ())
        going = [writer.submit(target.write, one, reader.submit(read, one).result()[np.newaxis]) for one in regions_]
        for one in going:
            one.result()
        assert writer.submit(target.sync).result() == 0
    np.testing.assert_array_equal(zarr.open_array(str(place.path), mode="r")[...], x)


@pytest.mark.parametrize(
    ("shape", "words", "expected"),
    [
        # Nothing is known of the input: long ones, 2 to 4 MiB.
        ((10**7,), {}, (524288,)),
        ((1000,), {}, (1000,)),
        ((64, 10**7), {}, (1, 524288)),
        ((64, 1000), {}, (64, 1000)),
        ((10_000, 1000), {}, (524, 1000)),
        ((10**7, 3), {"axis": 0}, (131072, 3)),
        ((10**7, 1000), {"axis": 0}, (2048, 256)),
        ((10**7, 512, 512), {"axis": 0}, (2048, 1, 256)),
        ((100, 512, 512), {"axis": 0}, (100, 10, 512)),
        ((3, 10**7), {"axis": 1, "fortran": True}, (3, 131072)),
        ((0, 5), {}, (1, 5)),
        # Chunks of the input of a good size, or that are all there is.
        ((64, 10**7), {"chunks": (4, 65536)}, (4, 65536)),
        ((1000, 512, 512), {"axis": 0, "chunks": (1, 512, 512)}, (1, 512, 512)),
        ((5, 100), {"chunks": (64, 200)}, (5, 100)),
        # Others as far as they are good.
        ((64, 10**7), {"chunks": (4, 1000)}, (4, 131072)),
        ((64, 10**7), {"chunks": (64, 10**6)}, (64, 8192)),
        ((4096, 4096, 100), {"chunks": (4096, 4096, 1)}, (512, 1024, 1)),
    ],
)
def test_chunks(shape: tuple[int, ...], words: dict[str, Any], expected: tuple[int, ...]) -> None:
    found = formats.grain(formats.located("dst", "y.zarr"), layout(shape, (1,), False, "f8", **words))
    assert found == expected


def test_stamps_change_with_the_array(tmp_path: Path) -> None:
    path = tmp_path / "x.zarr"
    zarr.create_group(str(path))
    array = saved(path, "x", data=np.arange(100.0), chunks=(10,))
    saved(path, "y", data=np.arange(100.0))
    with source(f"{path}:x") as found:
        stamps = [found.stamp()]
        assert found.stamp() == stamps[0]
        os.utime(path / "y/c/0", ns=(1 << 61, 1 << 61))
        assert found.stamp() == stamps[0]
        array[5] = 7.0
        stamps.append(found.stamp())
        (path / "x/c/9").unlink()
        stamps.append(found.stamp())
        array.attrs["note"] = "changed"
        stamps.append(found.stamp())
    assert len(set(map(tuple, stamps))) == 4


def test_what_cannot_be_an_output_is_refused(tmp_path: Path) -> None:
    for name in ("a/../b", "..", "__a", "a\0", "zarr.json", "a/c\\d"):
        with pytest.raises(ValueError, match=r"y\.zarr: an array must have a printable name"):
            formats.check(formats.located("dst", f"{tmp_path}/y.zarr:{name}"), layout((1, 1), (1,), False, "f8"))
    place = formats.located("dst", tmp_path / "y.zarr")
    formats.create(place, place.path, layout((3, 50), (1,), False, "f8")).close()
    with pytest.raises(ValueError, match=r"y\.zarr must hold \(3, 51\) of float64, got"):
        formats.reopen(place, place.path, layout((3, 51), (1,), False, "f8"), 0)
    shutil.rmtree(place.path)
    with pytest.raises(FileNotFoundError, match=r"y\.zarr'$"):
        formats.reopen(place, place.path, layout((3, 50), (1,), False, "f8"), 0)
    assert not place.path.exists()


def test_what_outputs_say(tmp_path: Path) -> None:
    attributes = {
        "units": "m",
        "nested": {"a": [1, None]},
        "bad": float("nan"),
        "fs": 3,
        "_ARRAY_DIMENSIONS": ["c", "t"],
    }
    wanted = layout((3, 50), (1,), False, "f8", step=0.25, attributes=attributes)
    place = formats.located("dst", tmp_path / "y.zarr")
    formats.create(place, place.path, wanted).close()
    array = zarr.open_array(str(place.path), mode="r")
    expected = {"units": "m s-1", "nested": {"a": [1, None]}, "deriv": 1, "delta": 0.25, "fs": 4.0}
    assert array.attrs.asdict() == expected
    assert array.metadata.dimension_names == ("c", "t")
    with source(place.path) as found:
        assert found.step_along(1) == 0.25
