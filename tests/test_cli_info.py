"""``algdiff info``: what is said of a file is so, and the command it suggests does what it says."""

from __future__ import annotations

import json
import os
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff._cli import main
from cli import error_line


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def printed(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main(["info", *map(str, arguments)]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return str(out)


def known(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(printed(capsys, *arguments, "--json"))
    return found


KEYS = [
    "file",
    "format",
    "shape",
    "dtype",
    "bytes",
    "axis",
    "samples",
    "channels",
    "delta",
    "columns",
    "time",
    "chunks",
    "suggestion",
]


def test_npy(capsys):
    np.save("x.npy", np.zeros((3, 500), np.float32))
    found = known(capsys, "x.npy")
    assert list(found) == KEYS
    suggestion = found.pop("suggestion")
    assert found == {
        "file": "x.npy",
        "format": "npy",
        "shape": [3, 500],
        "dtype": "float32",
        "bytes": 6000,
        "axis": 1,
        "samples": 500,
        "channels": 3,
        "delta": None,
        "columns": None,
        "time": None,
        "chunks": None,
    }
    assert suggestion["command"] == "algdiff run x.npy x_d1.npy --window 101 --fs HZ"
    plan = algdiff.differentiate_file("x.npy", "y.npy", 101, dry_run=True)
    assert (suggestion["blocks"], suggestion["memory"]) == (plan.blocks, plan.memory)
    assert 0 < suggestion["seconds"] < 60
    text = printed(capsys, "x.npy").splitlines()
    assert text[:6] == [
        "x.npy",
        "format      npy",
        "shape       3 x 500 float32, 6 kB",
        "time        axis 1, 500 samples",
        "channels    3",
        "step        not in the file: give --fs or --delta",
    ]
    assert text[6] == f"to run      {suggestion['command']}"
    assert os.listdir() == ["x.npy"], "nothing is written"


def test_the_axis_may_be_another(capsys):
    np.save("x.npy", np.zeros((300, 4)))
    found = known(capsys, "x.npy", "--axis", -2)
    assert (found["axis"], found["samples"], found["channels"]) == (0, 300, 4)
    assert "--axis -2" in found["suggestion"]["command"]
    assert main(["info", "x.npy", "--axis", "2"]) == 1
    assert error_line(capsys).startswith("--axis must be from -2 to 1")


def test_raw_numbers_need_a_type(capsys):
    Path("my data.bin").write_bytes(bytes(2002))
    assert main(["info", "my data.bin"]) == 1
    assert error_line(capsys) == "--dtype must be given for the raw numbers of my data.bin, got nothing"
    found = known(capsys, "my data.bin", "--dtype", "int16", "--channels", 2, "--offset", 2)
    assert (found["shape"], found["axis"]) == ([500, 2], 0)
    command = found["suggestion"]["command"]
    assert command.startswith("algdiff run 'my data.bin' 'my data_d1.bin' --window 101 --fs HZ ")
    program, *arguments = shlex.split(command.replace("HZ", "100"))
    assert (program, main(arguments)) == ("algdiff", 0)
    assert Path("my data_d1.bin").stat().st_size == 8 * 1000


@pytest.mark.parametrize(
    ("samples", "window"), [(0, None), (4, None), (5, 5), (6, 5), (100, 99), (101, 101), (900, 101)]
)
def test_windows_that_are_suggested_fit_the_data(capsys, samples, window):
    np.save("x.npy", np.zeros(samples))
    suggestion = known(capsys, "x.npy")["suggestion"]
    if window is None:
        assert suggestion is None
    else:
        assert f" --window {window} " in suggestion["command"]
    assert ("to run" in printed(capsys, "x.npy")) == (window is not None)


def test_csv(capsys):
    rows = "".join(f"{3 + 0.01 * row:.2f},{row},{row**2}\n" for row in range(200))
    Path("x.csv").write_text("t,a,b\n" + rows, encoding="utf-8")
    found = known(capsys, "x.csv", "--time", "t", "--columns", "b")
    assert (found["columns"], found["time"], found["shape"]) == (["b"], "t", [200])
    assert found["delta"] == pytest.approx(0.01, rel=1e-12)
    _, *arguments = shlex.split(found["suggestion"]["command"])
    assert arguments == ["run", "x.csv", "x_d1.csv", "--window", "101", "--time", "t", "--columns", "b"]
    text = printed(capsys, "x.csv", "--time", "t").splitlines()
    assert "time        axis 0, 200 samples, in t" in text
    assert "channels    2 (a, b)" in text
    assert "step        0.01 s (100 Hz), from the file" in text
    assert main(["run", *arguments[1:]]) == 0


def test_npz_of_several_arrays_is_listed(capsys):
    np.savez("x.npz", a=np.zeros((2, 300), np.float32), names=np.array(["u"]), o=np.array([None]))
    found = known(capsys, "x.npz")
    assert found == {
        "file": "x.npz",
        "format": "npz",
        "count": 3,
        "arrays": [
            {"name": "a", "shape": [2, 300], "dtype": "float32"},
            {"name": "names", "shape": [1], "dtype": "<U1"},
            {"name": "o", "shape": [1], "dtype": "object"},
        ],
    }
    text = printed(capsys, "x.npz").splitlines()
    assert text[:3] == [
        "x.npz",
        "format      npz, 3 arrays: give --key NAME for one of them",
        "a      2 x 300       float32",
    ]
    assert known(capsys, "x.npz", "--key", "a")["shape"] == [2, 300]
    assert "--key a" in known(capsys, "x.npz", "--key", "a")["suggestion"]["command"]


def test_of_many_arrays_fifty_are_listed(capsys):
    np.savez("x.npz", **{f"a{index}": np.zeros(1) for index in range(60)})
    found = known(capsys, "x.npz")
    assert (found["count"], len(found["arrays"])) == (60, 50)
    text = printed(capsys, "x.npz").splitlines()
    assert (len(text), text[-1]) == (53, "and 10 more")


def test_npz_of_one_array(capsys):
    np.savez("x.npz", a=np.zeros(300))
    assert known(capsys, "x.npz")["shape"] == [300]


def test_hdf5(capsys):
    h5py = pytest.importorskip("h5py")
    with h5py.File("x.h5", "w") as file:
        file["run/angle"] = np.zeros((2, 400))
        file["run/angle"].attrs["fs"] = 50.0
        file["text"] = "a"
        file["one"] = np.zeros(3, np.int16)
    assert known(capsys, "x.h5")["arrays"] == [
        {"name": "/one", "shape": [3], "dtype": "int16"},
        {"name": "/run/angle", "shape": [2, 400], "dtype": "float64"},
        {"name": "/text", "shape": [], "dtype": "object"},
    ]
    assert "x.h5:/run/angle  2 x 400       float64" in printed(capsys, "x.h5").splitlines()
    found = known(capsys, "x.h5:/run/angle")
    assert (found["shape"], found["delta"]) == ([2, 400], 0.02)
    command = found["suggestion"]["command"]
    assert command == "algdiff run x.h5:/run/angle x_d1.h5 --window 101"
    assert main(shlex.split(command)[1:]) == 0


def test_zarr(capsys):
    zarr = pytest.importorskip("zarr")
    group = zarr.create_group("x.zarr")
    for name in ("b", "deep/a"):
        group.create_array(name, shape=(3, 500), chunks=(1, 250), dtype="f4")[...] = 1.0
    assert known(capsys, "x.zarr")["arrays"] == [
        {"name": "/b", "shape": [3, 500], "dtype": "float32"},
        {"name": "/deep/a", "shape": [3, 500], "dtype": "float32"},
    ]
    found = known(capsys, "x.zarr:/deep/a")
    assert (found["chunks"], found["channels"]) == ([1, 250], 3)


def test_bad_files(capsys):
    assert main(["info", "x.txt"]) == 2
    assert error_line(capsys).startswith("FILE: the suffix of x.txt must be .npy, ")
    assert main(["info", "none.npy"]) == 1
    assert error_line(capsys) == "none.npy: No such file or directory"
    Path("x.npy").write_bytes(b"\x93NUMPY garbage")
    for name in ("x.npy", "x.npz"):
        Path(name).write_bytes(b"\x93NUMPY garbage")
        assert main(["info", name]) == 1
        assert error_line(capsys).startswith(f"{name}: not a whole")


def test_a_single_number_holds_no_samples(capsys):
    np.save("x.npy", 1.0)
    assert main(["info", "x.npy"]) == 1
    assert error_line(capsys) == "x.npy: must hold samples, got a single number"


@pytest.mark.parametrize(("module", "name"), [("h5py", "x.h5"), ("zarr", "x.zarr"), ("pyarrow", "x.parquet")])
def test_bad_files_of_other_formats(capsys, module, name):
    pytest.importorskip(module)
    Path(name).write_bytes(b"garbage")
    assert main(["info", name]) == 1
    assert name in error_line(capsys)
