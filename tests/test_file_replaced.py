"""What a run of a file may replace, and what it takes for missing samples and for time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import algdiff

X = np.random.default_rng(0).standard_normal((2, 3000))


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("x.npy", X)


def test_a_folder_that_is_no_store_is_kept() -> None:
    pytest.importorskip("zarr")
    Path("y.zarr").mkdir()
    Path("y.zarr/thesis.tex").write_text("x")
    with pytest.raises(FileExistsError, match=r"^y\.zarr: exists and is no Zarr store"):
        algdiff.differentiate_file("x.npy", "y.zarr", 21, overwrite=True)
    assert Path("y.zarr/thesis.tex").read_text() == "x"
    Path("y.zarr/thesis.tex").unlink()
    for _ in range(2):
        algdiff.differentiate_file("x.npy", "y.zarr", 21, overwrite=True)


@pytest.mark.parametrize(("name", "package"), [("y.h5", "h5py"), ("y.zarr", "zarr")])
def test_a_file_with_other_arrays_is_kept(name: str, package: str) -> None:
    library = pytest.importorskip(package)
    if package == "h5py":
        with library.File(name, "w") as file:
            file["group/precious"] = np.arange(5.0)
    else:
        library.create_group(name).create_array("precious", data=np.arange(5.0))
    with pytest.raises(FileExistsError, match=r"the file holds other arrays, which would be lost \(.*precious"):
        algdiff.differentiate_file("x.npy", f"{name}:/v", 21, overwrite=True)
    with pytest.raises(FileExistsError, match="precious"):
        algdiff.differentiate_file("x.npy", name, 21, overwrite=True)
    assert not list(Path().glob("*partial*"))
    for _ in range(2):
        algdiff.differentiate_file("x.npy", f"plain-{name}", 21, overwrite=True)
    algdiff.differentiate_file("x.npy", f"new-{name}:/v", 21)
    algdiff.differentiate_file("x.npy", f"new-{name}:/v", 31, overwrite=True)


def test_raw_channels_alternate_whatever_they_come_from() -> None:
    algdiff.differentiate_file("x.npy", "v.bin", 21, (0, 1), engine="direct")
    smooth, slope = algdiff.differentiate(X, 21, (0, 1), engine="direct")
    np.testing.assert_array_equal(np.fromfile("v.bin").reshape(-1, 4).T, [*smooth, *slope])
    algdiff.differentiate_file("v.bin", "a.npy", 21, dtype="f8", channels=4, engine="direct")
    expected = algdiff.differentiate(np.stack([*smooth, *slope], axis=1), 21, axis=0, engine="direct")
    np.testing.assert_array_equal(np.load("a.npy"), expected)


@pytest.mark.parametrize("mode", ["fit", "valid", "nan", "mirror", "wrap"])
@pytest.mark.parametrize("tau", [-0.3, 0.1, 1.0, 1.4])
def test_missing_samples_are_left_out_wherever_estimates_lie(tau: float, mode: str) -> None:
    x = X.copy()
    x[0, [5, 700, 701, 2990]] = np.nan
    np.save("x.npy", x)
    words = {"tau": tau, "mode": mode, "nan_policy": "omit", "degree": 2}
    report = algdiff.differentiate_file("x.npy", "y.npy", 21, memory=1 << 20, **words)
    expected = algdiff.differentiate(x, 21, **words)
    assert report.blocks > 1
    np.testing.assert_allclose(np.load("y.npy"), expected, rtol=1e-9, atol=1e-12)


def test_missing_samples_that_are_refused_are_told_with_their_file() -> None:
    x = X.copy()
    x[1, 2000] = np.nan
    np.save("x.npy", x)
    with pytest.raises(ValueError, match=r"^x\.npy must hold no missing samples .* between samples \d+ and \d+"):
        algdiff.differentiate_file("x.npy", "y.npy", 21, nan_policy="raise", memory=1 << 20)
    assert [path.name for path in Path().iterdir()] == ["x.npy"]


def test_time_is_said_once() -> None:
    np.savetxt("x.csv", np.stack([np.arange(100) / 100, X[0, :100]], axis=1), delimiter=",", header="t,x", comments="")
    with pytest.raises(ValueError, match=r"^give time, delta or fs, one of them: got time and another"):
        algdiff.differentiate_file("x.csv", "y.csv", 21, time="t", fs=50)
    assert algdiff.differentiate_file("x.csv", "y.csv", 21, time="t").delta == pytest.approx(0.01)


def test_blocks_hold_whole_chunks_of_the_input() -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File("x.h5", "w") as file:
        file.create_dataset("x", data=np.arange(2_000_000.0), chunks=(500_000,), compression="gzip", compression_opts=1)
    assert algdiff.differentiate_file("x.h5", "y.npy", 21, dry_run=True).block_shape[0] >= 500_000
    with pytest.raises(ValueError, match=r"^memory must be at least \d+ bytes"):
        algdiff.differentiate_file("x.h5", "y.npy", 21, dry_run=True, memory=8 << 20)


def test_a_real_recording_there_and_back() -> None:
    """The encoder's recording: angle to velocity to acceleration, through files that keep the step."""
    from algdiff import _demo

    for package in ("h5py", "pyarrow", "zarr"):
        pytest.importorskip(package)
    theta, delta = _demo.recording()
    np.save("theta.npy", theta)
    words = {"window_length": 1601, "degree": 5, "kappa": 0, "mu": 0, "engine": "direct", "memory": 4 << 20}
    expected = algdiff.differentiate(theta, 1601, degree=5, kappa=0, mu=0, delta=delta, engine="direct")
    assert algdiff.differentiate_file("theta.npy", "v.h5:/pendulum/velocity", delta=delta, **words).blocks > 4
    words["memory"] = 256 << 20
    report = algdiff.differentiate_file("v.h5:/pendulum/velocity", "a.zarr", **words)
    assert report.delta == pytest.approx(delta, rel=1e-12)
    algdiff.differentiate_file("v.h5:/pendulum/velocity", "a.parquet", **words)
    twice = algdiff.differentiate(expected, 1601, degree=5, kappa=0, mu=0, delta=report.delta, engine="direct")
    import polars
    import zarr

    np.testing.assert_array_equal(zarr.load("a.zarr"), twice)
    np.testing.assert_array_equal(polars.read_parquet("a.parquet").to_numpy()[:, 0], twice)
