"""HDF5: regions of datasets of every type and layout, what files say of the step, outputs in place, bad files."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algdiff import _formats as formats
from algdiff._formats.base import Layout, Options

h5py = pytest.importorskip("h5py", reason="needs h5py")

TYPES = ["?", "i1", "<i2", ">i4", "<u8", "<f2", ">f4", "<f8", ">f8", "g", "<c8", "<c16", ">c16"]


def source(path: Any) -> Any:
    return formats.open_source(formats.located("src", path), Options())


def saved(path: Path, **datasets: Any) -> Path:
    with h5py.File(path, "w") as file:
        for name, numbers in datasets.items():
            file[name] = numbers
    return path


def regions(rng: np.random.Generator, shape: tuple[int, ...], count: int) -> list[tuple[slice, ...]]:
    ends = [[np.sort(rng.integers(0, extent + 1, 2)) for extent in shape] for _ in range(count)]
    return [tuple(slice(int(first), int(last)) for first, last in pairs) for pairs in ends]


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("how", [{}, {"chunks": (3, 16)}, {"chunks": (4, 100), "compression": "gzip", "shuffle": True}])
def test_regions_are_those_of_the_array(tmp_path: Path, dtype: str, how: dict[str, Any]) -> None:
    rng = np.random.default_rng(0)
    x = (100 * rng.standard_normal((7, 100))).astype(dtype)
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("a/x", data=x, **how)
    with source(f"{tmp_path}/x.h5:/a/x") as found:
        assert (found.shape, found.dtype, found.axis, found.fortran) == (x.shape, x.dtype, -1, False)
        assert found.chunks == how.get("chunks")
        for place in regions(rng, x.shape, 30):
            out = np.empty(x[place].shape, found.dtype)
            assert found.read(place, out) is None
            np.testing.assert_array_equal(out, x[place])


def test_a_compressed_chunk_that_regions_share_is_unpacked_once(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("x", (6 << 20,), "f8", chunks=(6 << 20,), compression="lzf")
        file.create_dataset("y", (6 << 20,), "f8", chunks=(1 << 10,))
    for name, size in (("x", 48 << 20), ("y", 32 << 20)):
        with source(f"{tmp_path}/x.h5:{name}") as found:
            assert found.dataset.id.get_access_plist().get_chunk_cache()[1] == size


def test_names_of_datasets(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["g/x"] = np.arange(3.0)
        file["text"] = "none of numbers"
        file["single"] = 1.0
        file["g/time"] = np.arange(3.0)
        file["g/time"].make_scale("time")
        file["alias"] = h5py.SoftLink("/g/./y")
        file["g/y"] = h5py.SoftLink("x")
        file["g/z"] = h5py.SoftLink("/g/x")
    for name in ("", ":g/x", ":/g/x", "://g//./x", ":alias", ":g/y", ":g/z"):
        with source(f"{tmp_path}/x.h5{name}") as found:
            assert (found.name, found.shape) == ("/g/x", (3,))
    with h5py.File(tmp_path / "x.h5", "a") as file:
        for index in range(11):
            file[f"x{index:02}"] = np.arange(3.0)
    path = f"{tmp_path}/x.h5"
    ten = "".join(f", {path}:/x{index:02}" for index in range(9))
    with pytest.raises(ValueError, match="must be given with one of its datasets") as caught:
        source(path)
    assert str(caught.value) == f"{path}: must be given with one of its datasets, as in {path}:/g/x{ten}, ..."
    with pytest.raises(ValueError, match=f"^{re.escape(path)}: must hold /nope, got {re.escape(path)}:/g/x, "):
        source(f"{path}:/nope")
    with pytest.raises(ValueError, match=r"x\.h5: must hold /g/x/deeper, got"):
        source(f"{path}:/g/x/deeper")
    with pytest.raises(ValueError, match=f"x.h5:/g must be a dataset, got a group that holds {re.escape(path)}:/g/x$"):
        source(f"{path}:/g")


def odd(path: Path) -> None:
    """Write datasets that are no arrays of numbers in this file."""
    kinds = {
        "text": (h5py.string_dtype(), (2,)),
        "compound": (np.dtype([("a", "f8"), ("b", "i4")]), (2,)),
        "arrays": (np.dtype(("f8", (3,))), (2,)),
        "enum": (h5py.enum_dtype({"A": 1, "B": 2}), (2,)),
        "ragged": (h5py.vlen_dtype("f8"), (2,)),
        "opaque": (np.dtype("V2"), (2,)),
        "references": (h5py.ref_dtype, (2,)),
        "scalar": (np.dtype("f8"), ()),
    }
    with h5py.File(path, "w") as file:
        for name, (dtype, shape) in kinds.items():
            file.create_dataset(name, shape, dtype)
        file["null"] = h5py.Empty("f8")
        file["type"] = np.dtype("f4")
        file["dates"] = np.array(["2020"], "M8[s]").astype(h5py.opaque_dtype("M8[s]"))
        h5py.h5d.create(file.id, b"time", h5py.h5t.UNIX_D32LE, h5py.h5s.create_simple((3,)))
        file["loop"] = h5py.SoftLink("/loop")
        file["dangling"] = h5py.SoftLink("/nope")
        file["link"] = h5py.ExternalLink(str(path.with_name("other.h5")), "/x")
        file["through"] = h5py.SoftLink("/link/x")
        file.create_dataset("outside", (5,), "f8", external=[(str(path.with_name("other.raw")), 0, 40)])
        layout = h5py.VirtualLayout((5,), "f8")
        layout[:] = h5py.VirtualSource(str(path.with_name("other.h5")), "x", (5,))
        file.create_virtual_dataset("virtual", layout)
        layout = h5py.VirtualLayout((5,), "f8")
        layout[:] = h5py.VirtualSource(".", "outside", (5,))
        file.create_virtual_dataset("indirect", layout)


ODD = {
    **dict.fromkeys(("text", "compound", "arrays", "ragged", "opaque", "references", "dates"), "got dtype"),
    "enum": "got names of an enumeration",
    "scalar": "got a single value",
    "null": "got no dataspace",
    "type": "must be a dataset, got a type",
    "time": "must be an array of real or complex numbers, got ",
    "loop": "must be in the file itself, got links at 'loop'",
    "dangling": "must hold dangling, got no dataset of numbers",
    "link": "must be in the file itself, got a link to another file at 'link'",
    "through": "must be in the file itself, got a link to another file at 'link'",
    "outside": "must be in the file itself, got numbers in ",
    "virtual": "must be in the file itself, got parts in ",
    "indirect": "/outside must be in the file itself, got numbers in ",
}


@pytest.mark.parametrize("name", ODD)
def test_what_is_no_array_of_numbers_in_the_file_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "x.h5"
    # What links point at is there: it must not be read.
    saved(tmp_path / "other.h5", x=np.arange(5.0))
    (tmp_path / "other.raw").write_bytes(bytes(40))
    odd(path)
    if name == "dangling":
        with h5py.File(path, "a") as file:
            for other in ("outside", "virtual", "indirect"):
                del file[other]
    with pytest.raises(ValueError, match=re.escape(ODD[name])) as caught:
        source(f"{path}:{name}")
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_parts_of_the_same_file_are_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["x"] = np.arange(4.0)
        layout = h5py.VirtualLayout((2, 4), "f8")
        layout[0] = layout[1] = h5py.VirtualSource(file["x"])
        file.create_virtual_dataset("v", layout)
    with source(f"{tmp_path}/x.h5:v") as found:
        out = np.empty((2, 3))
        found.read((slice(0, 2), slice(1, 4)), out)
    np.testing.assert_array_equal(out, [[1, 2, 3], [1, 2, 3]])


def test_bad_files(tmp_path: Path) -> None:
    path = saved(tmp_path / "x.h5", x=np.arange(1000.0))
    whole = path.read_bytes()
    for said, content in {
        "file signature not found": b"numbers" * 100,
        "truncated file": whole[: len(whole) // 2],
    }.items():
        path.write_bytes(content)
        with pytest.raises(ValueError, match=rf"^{path}: not a whole HDF5 file \({said}"):
            source(path)
    path.write_bytes(b"")
    with pytest.raises(ValueError, match=r"x\.h5: not a whole HDF5 file"):
        source(path)
    with pytest.raises(FileNotFoundError, match=r"nope\.h5'$"):
        source(tmp_path / "nope.h5")
    (tmp_path / "folder.h5").mkdir()
    with pytest.raises(IsADirectoryError, match=r"folder\.h5'$"):
        source(tmp_path / "folder.h5")
    saved(path)
    with pytest.raises(ValueError, match=r"x\.h5: must hold a dataset of numbers, got none$"):
        source(path)


def test_damaged_files_raise_value_errors_that_name_them(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("x", data=np.arange(2000.0), chunks=(500,), compression="gzip").attrs["fs"] = 100.0
    whole = bytearray(path.read_bytes())
    refused = 0
    for _ in range(150):
        damaged = whole.copy()
        for place in rng.integers(0, len(whole), 8):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(damaged)
        try:
            with source(path) as found:
                found.step_along(0)
                if found.shape == (2000,):
                    found.read((slice(0, 2000),), np.empty(2000, found.dtype))
        except ValueError as error:
            assert str(error).startswith(str(path))  # noqa: PT017
            assert "\n" not in str(error)  # noqa: PT017
            refused += 1
    assert refused > 20


def test_a_file_that_is_open_for_writing_elsewhere_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path / "x.h5", x=np.arange(3.0))
    code = "import h5py, sys; file = h5py.File(sys.argv[1], 'a'); print(); sys.stdout.flush(); input()"
    command = [sys.executable, "-c", code, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        other.stdout.readline()
        try:
            with pytest.raises(ValueError, match=r"x\.h5: not a whole HDF5 file .*lock"):
                source(path)
        finally:
            other.communicate("\n")


@pytest.mark.parametrize(
    ("attributes", "step"),
    [
        ({"fs": 500}, 2e-3),
        ({"Sampling_Rate": np.float32(500)}, 2e-3),
        ({"samplingFrequency": np.array([500])}, 2e-3),
        ({"dt": 2e-3}, 2e-3),
        ({"delta": 0.1, "fs": 10.0}, 0.1),
        ({"time_step": np.int8(2)}, 2.0),
        ({"fs": "500"}, 2e-3),
        ({"other": 3.0}, None),
    ],
)
def test_steps_in_attributes(tmp_path: Path, attributes: dict[str, Any], step: float | None) -> None:
    path = saved(tmp_path / "x.h5", **{"a/b/x": np.zeros((2, 5))})
    for name in ("/a/b/x", "/a/b", "/"):
        with h5py.File(path, "a") as file:
            file[name].attrs.update(attributes)
        with source(path) as found:
            assert found.step_along(1) == step
        with h5py.File(path, "a") as file:
            for attribute in attributes:
                del file[name].attrs[attribute]


@pytest.mark.parametrize("value", [True, np.array([1.0, 2.0]), "500 Hz", b"fast"])
def test_steps_that_are_no_numbers_are_refused(tmp_path: Path, value: Any) -> None:
    path = saved(tmp_path / "x.h5", x=np.zeros(5))
    with h5py.File(path, "a") as file:
        file["x"].attrs["fs"] = value
    with source(path) as found, pytest.raises(ValueError, match=r"its attribute fs must be a number, got .*give delta"):
        found.step_along(0)


@pytest.mark.parametrize(
    ("attributes", "fault"),
    [
        ({"scale_factor": 0.5}, "scale_factor"),
        ({"add_offset": 3}, "add_offset"),
        ({"_FillValue": -999.0}, "_FillValue = -999"),
        ({"missing_value": np.array([1e20])}, "missing_value = 1e"),
        ({"scale_factor": 1.0, "add_offset": 0, "_FillValue": np.nan}, None),
    ],
)
def test_packed_numbers_are_refused(tmp_path: Path, attributes: dict[str, Any], fault: str | None) -> None:
    path = saved(tmp_path / "x.h5", x=np.zeros(5))
    with h5py.File(path, "a") as file:
        file["x"].attrs.update(attributes)
    if fault is None:
        source(path).close()
        return
    with pytest.raises(ValueError, match=rf"{fault}.*as with xarray"):
        source(path)


def test_the_nearest_attribute_counts(tmp_path: Path) -> None:
    path = saved(tmp_path / "x.h5", **{"a/x": np.zeros(5)})
    with h5py.File(path, "a") as file:
        file.attrs["fs"], file["a"].attrs["fs"] = 1.0, 2.0
    with source(path) as found:
        assert found.step_along(0) == 0.5


@pytest.mark.parametrize("value", [0.0, -1, np.nan, np.inf, 5e-324])
def test_nonsense_in_attributes_is_refused(tmp_path: Path, value: float) -> None:
    path = saved(tmp_path / "x.h5", x=np.zeros(5))
    with h5py.File(path, "a") as file:
        file.attrs["FS"] = value
    with (
        source(path) as found,
        pytest.raises(ValueError, match=r"x.h5:/: its attribute FS must be positive and finite"),
    ):
        found.step_along(0)


def test_attributes_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    path = saved(tmp_path / "x.h5", x=np.zeros(5))
    with h5py.File(path, "a") as file:
        file["x"].attrs.update({"fs": 100.0, "dt": 0.02})
    with source(path) as found, pytest.raises(ValueError, match=r"x.h5:/x: its attributes dt and fs must agree, got"):
        found.step_along(0)


def scaled(path: Path, values: Any, samples: int | None = None, **attributes: Any) -> Path:
    values = np.asarray(values)
    with h5py.File(path, "w") as file:
        file["x"] = np.zeros((3, len(values) if samples is None else samples))
        file["time"] = values
        file["time"].make_scale("time")
        file["time"].attrs.update(attributes)
        file["x"].dims[1].attach_scale(file["time"])
    return path


@pytest.mark.parametrize(
    ("values", "attributes", "step"),
    [
        (np.arange(2000) * 0.25 + 7, {}, 0.25),
        # Rounded to 2**-11, half of which is 2 % of a step.
        ((np.arange(2000) * 0.01 + 5000).astype(">f4"), {"units": "s"}, 0.01),
        (np.arange(2000), {"units": "milliseconds since 2000-01-01"}, 1e-3),
        (np.arange(2000), {"units": "ms"}, 1e-3),
        (2**60 + 3 * np.arange(2000), {"units": "ns"}, 3e-9),
        (2**63 + 3 * np.arange(2000, dtype=np.uint64), {"units": "us"}, 3e-6),
        (np.arange(2000), {"units": "Days"}, 86400.0),
        (np.arange(2000), {"units": "m"}, None),
        (np.arange(2000), {"units": 3}, None),
        (np.zeros(2000), {"NAME": "This is a netCDF dimension but not a netCDF variable.      2000"}, None),
        (np.zeros(1), {}, None),
    ],
)
def test_steps_of_scales(tmp_path: Path, values: Any, attributes: dict[str, Any], step: float | None) -> None:
    with source(f"{scaled(tmp_path / 'x.h5', values, **attributes)}:x") as found:
        assert found.step_along(1) == (step if step is None else pytest.approx(step, rel=1e-4, abs=0))
        assert found.step_along(0) is None


def uneven(count: int) -> Any:
    times = np.arange(count) * 0.5
    times[count // 2] += 0.2
    return times


@pytest.mark.parametrize(
    ("values", "samples", "said"),
    [
        (uneven(2000), None, r"the time at place 1000 of '/time' must be 500.0 for even times, got 500.2; .* t=times"),
        (np.arange(2000)[::-1], None, "the times in '/time' must ascend"),
        (np.zeros(2000), None, "the times in '/time' must ascend"),
        (np.full(2000, np.nan), None, "the times in '/time' must ascend"),
        (np.arange(2000), 1999, r"/time must hold a time for each of 1999 samples, got shape \(2000,\)"),
    ],
)
def test_uneven_scales_are_refused(tmp_path: Path, values: Any, samples: int | None, said: str) -> None:
    path = scaled(tmp_path / "x.h5", values, samples)
    with source(f"{path}:x") as found, pytest.raises(ValueError, match=f"^{path}: {said}"):
        found.step_along(1)


def test_scales_are_looked_at_piece_by_piece(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from algdiff._formats import steps

    monkeypatch.setattr(steps, "PIECE", 7)
    for place in (0, 6, 7, 50, 99):
        times = np.arange(100) * 0.5
        times[place] += 0.25 if place < 99 else 0.0
        path = scaled(tmp_path / "x.h5", times)
        with source(f"{path}:x") as found:
            if place == 99:
                assert found.step_along(1) == 0.5
            else:
                with pytest.raises(ValueError, match=f"the time at place {max(place, 1)} of"):
                    found.step_along(1)


def layout(shape: tuple[int, ...], orders: tuple[int, ...], leading: bool, dtype: Any, **words: Any) -> Layout:
    return Layout(shape=shape, axis=1, orders=orders, leading=leading, dtype=np.dtype(dtype), **words)


@pytest.mark.parametrize("dtype", ["f4", "f8", "c8", "c16"])
@pytest.mark.parametrize(("inner", "name"), [(None, "/x"), ("/a/b/y", "/a/b/y"), ("y", "/y")])
@pytest.mark.parametrize("orders", [(1,), (0, 2)])
def test_outputs_are_what_was_written(
    tmp_path: Path, dtype: str, inner: str | None, name: str, orders: tuple[int, ...]
) -> None:
    rng = np.random.default_rng(2)
    wanted = layout((5, 40), orders, len(orders) > 1, dtype)
    result = (100 * (rng.standard_normal((len(orders), 5, 40)) * (1 + 2j))).real.astype(dtype)
    if result.dtype.kind == "c":
        result += 1j * rng.standard_normal(result.shape).astype(result.real.dtype)
    place = formats.located("dst", tmp_path / "y.h5" if inner is None else f"{tmp_path}/y.h5:{inner}")
    formats.check(place, wanted)
    partial = tmp_path / "y.h5.partial"
    target = formats.create(place, partial, wanted)
    for rows in (slice(0, 2), slice(2, 5)):
        for columns in (slice(0, 17), slice(17, 40)):
            target.write((rows, columns), result[:, rows, columns])
            # A kill here: the library does not know of it, and finds its file whole.
            mark = target.sync()
            target.close()
            h5py.File(partial, "r").close()
            target = formats.reopen(place, partial, wanted, mark)
    target.close()
    with h5py.File(partial, "r") as file:
        np.testing.assert_array_equal(file[name][()], result if wanted.leading else result[0])
        assert file[name].dtype == np.dtype(dtype)
        assert file[name].attrs["deriv"].tolist() == (list(orders) if wanted.leading else orders[0])
        assert "delta" not in file[name].attrs
    with source(partial.rename(tmp_path / "z.h5")) as found:
        assert found.shape == wanted.full_shape


@pytest.mark.parametrize("shape", [(0, 5), (3, 0)])
def test_outputs_without_numbers(tmp_path: Path, shape: tuple[int, ...]) -> None:
    place = formats.located("dst", tmp_path / "y.h5")
    wanted = layout(shape, (1,), False, "f8")
    formats.create(place, place.path, wanted).close()
    target = formats.reopen(place, place.path, wanted, 0)
    target.write(tuple(slice(0, extent) for extent in shape), np.empty((1, *shape)))
    target.close()
    with source(place.path) as found:
        assert found.shape == shape


def test_outputs_beyond_four_gibibytes(tmp_path: Path) -> None:
    place = formats.located("dst", tmp_path / "y.h5")
    wanted = layout((2, 1 << 29), (1, 2), True, "f8")
    target = formats.create(place, place.path, wanted)
    target.write((slice(1, 2), slice((1 << 29) - 3, 1 << 29)), np.arange(6.0).reshape(2, 1, 3))
    target.close()
    status = place.path.stat()
    assert status.st_size > wanted.nbytes == 1 << 34
    with h5py.File(place.path, "r") as file:
        np.testing.assert_array_equal(file["x"][:, 1, -3:], [[0, 1, 2], [3, 4, 5]])


def test_what_outputs_say(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "x.h5", "w", libver="latest") as file:
        file["x"] = np.zeros((3, 50))
        file["x"].attrs.update(
            {
                "units": "m",
                "sensor": "left",
                "labels": ["a", "b", "c"],
                "gain": np.array([1.0, 2.0], "f4"),
                "SamplingRate": 5.0,
                "_FillValue": np.nan,
                "add_offset": 0.0,
                "reference": file.ref,
                "huge": np.zeros(9000),
                "raw": np.bytes_(b"text"),
                "odd": np.bytes_(b"\xff"),
            }
        )
        for axis, name in enumerate(("channel", "time")):
            file["x"].dims[axis].label = name
    with source(tmp_path / "x.h5") as found:
        attributes = found.attributes
    assert "huge" not in attributes
    wanted = layout((3, 50), (1, 2), True, "f8", step=0.25, attributes=attributes)
    place = formats.located("dst", tmp_path / "y.h5")
    formats.create(place, place.path, wanted).close()
    with h5py.File(place.path, "r") as file:
        said = dict(file["x"].attrs)
        assert [dim.label for dim in file["x"].dims] == ["deriv", "channel", "time"]
    assert list(said.pop("labels")) == ["a", "b", "c"]
    assert said.pop("gain").tolist() == [1.0, 2.0]
    assert said.pop("deriv").tolist() == [1, 2]
    assert said.pop("DIMENSION_LABELS").size == 3
    assert said == {"sensor": "left", "raw": "text", "delta": 0.25, "fs": 4.0}
    with source(place.path) as found:
        assert found.step_along(2) == 0.25


@pytest.mark.parametrize(
    ("orders", "units", "step", "said"),
    [
        ((1,), "m", 0.5, "m s-1"),
        ((2,), "1", 0.5, "s-2"),
        ((1,), "m", None, None),
        ((1, 2), "m", 0.5, None),
        ((0,), "m", 0.5, "m"),
    ],
)
def test_units_of_outputs(
    tmp_path: Path, orders: tuple[int, ...], units: str, step: float | None, said: str | None
) -> None:
    wanted = layout((3, 50), orders, len(orders) > 1, "f8", step=step, attributes={"units": units})
    place = formats.located("dst", tmp_path / "y.h5")
    formats.create(place, place.path, wanted).close()
    with h5py.File(place.path, "r") as file:
        assert file["x"].attrs.get("units") == said


def test_what_hdf5_cannot_hold_is_refused(tmp_path: Path) -> None:
    place = formats.located("dst", tmp_path / "y.h5")
    with pytest.raises(ValueError, match=r"y\.h5: an HDF5 file holds at most 32 dimensions, got 33"):
        formats.check(place, layout((1,) * 32, (1, 2), True, "f8"))
    for name in ("./.", "a\0b"):
        with pytest.raises(ValueError, match=r"y\.h5: the name of a dataset must be printable and not empty"):
            formats.check(formats.located("dst", f"{place.path}:{name}"), layout((1, 1), (1,), False, "f8"))


def test_another_output_is_not_gone_on_with(tmp_path: Path) -> None:
    place = formats.located("dst", tmp_path / "y.h5")
    formats.create(place, place.path, layout((3, 50), (1,), False, "f8")).close()
    with pytest.raises(ValueError, match=r"y\.h5:/x must hold \(3, 51\) of float64 in one piece, got"):
        formats.reopen(place, place.path, layout((3, 51), (1,), False, "f8"), 0)
