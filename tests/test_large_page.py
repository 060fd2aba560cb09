"""The commands of docs/large.md, in its order; what they write is read back with other libraries."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import algdiff

PAGE = Path(__file__).parent.parent / "docs" / "large.md"
COMMANDS = re.findall(r"^```sh\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run all commands in an empty folder."""
    for package in ("h5py", "pyarrow", "zarr"):
        pytest.importorskip(package)
    here = tmp_path_factory.mktemp("page")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for command in COMMANDS:
        shell = [shutil.which("bash") or "sh", "-euc", command]
        done = subprocess.run(
            shell, cwd=here, capture_output=True, text=True, env={**os.environ, "PATH": path}, check=False
        )
        assert done.returncode == 0, (command, done.stderr)
    return here


def test_the_page_has_commands() -> None:
    assert sum(command.count("algdiff run") for command in COMMANDS) >= 8


def test_outputs_are_the_estimates(folder: Path) -> None:
    import h5py
    import polars as pl
    import zarr

    x = np.load(folder / "recording.npy")
    velocity = algdiff.differentiate(x, 301, fs=1000)
    assert np.load(folder / "velocity.npy").tobytes() == velocity.tobytes()
    assert np.load(folder / "both.npy").tobytes() == algdiff.differentiate(x, 301, (1, 2), fs=1000).tobytes()
    assert np.load(folder / "smooth.npy").tobytes() == algdiff.differentiate(x, 301, 0, fs=1000).tobytes()
    with h5py.File(folder / "velocity.h5") as file:
        np.testing.assert_array_equal(file["run1/v"], velocity)
    expected = algdiff.differentiate(velocity, 301, fs=1000)
    np.testing.assert_allclose(
        zarr.load(folder / "acceleration.zarr"), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
    )
    np.testing.assert_array_equal(np.loadtxt(folder / "velocity.csv", delimiter=","), velocity.T)
    np.testing.assert_array_equal(pl.read_parquet(folder / "velocity.parquet").to_numpy(), velocity.T)
    assert not [path for path in folder.iterdir() if "partial" in path.name]
