"""Dask on two worker processes: the bits of the call in memory, also if a worker is killed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("dask.array", reason="needs dask[array]")
pytest.importorskip("distributed", reason="needs dask[distributed]")

SCRIPT = """
import os
import pickle
import signal
import sys
import time
from pathlib import Path

import cloudpickle
import dask.array as da
import numpy as np
from dask.distributed import Client, LocalCluster

import algdiff
from algdiff import _dask_paths
from algdiff._file_job import Spec
from algdiff._formats import located
from algdiff._formats.base import Options
from algdiff.dask import differentiate_paths

HERE = Path(sys.argv[1])


def source(samples, chunk, wait=0.0):
    # Samples that a task makes, and a note that it did.
    def make(block_info=None):
        ((first, last),) = block_info[None]["array-location"]
        time.sleep(wait)
        if wait:
            (HERE / str(first)).touch()
        return np.sin(1e-3 * np.arange(first, last) ** 1.5)

    chunks = (chunk,) * (samples // chunk) + ((samples % chunk,) if samples % chunk else ())
    return da.map_blocks(make, chunks=(chunks,), dtype=float, meta=np.empty(0))


def design(tau="center", window_length=101, **options):
    return algdiff.Differentiator(window_length, tau=tau, engine="direct", **options)


def same(client, samples, chunk, one, **options):
    x = source(samples, chunk)
    whole = x.compute(scheduler="synchronous")
    found = client.compute(one(x, **options)).result(timeout=60)
    return found.tobytes() == one(whole, **options).tobytes()


def causal(client):
    return same(client, 20_000, 3000, design("newest"))


def anticausal(client):
    return same(client, 20_000, 3000, design(0.0))


def centred(client):
    return same(client, 20_000, 2500, design())


def skewed(client):
    return same(client, 20_000, 3000, design(0.37, deriv=(0, 1)), mode="wrap")


def chunks_shorter_than_the_window(client):
    return same(client, 5000, 40, design(window_length=301), mode="mirror")


def short_last_chunk(client):
    return same(client, 20_003, 4000, design(), mode="valid")


def gaps(client):
    x = source(20_000, 3000)
    x = da.where(x > 0.99, np.nan, x)
    whole = x.compute(scheduler="synchronous")
    one, options = design(), {"nan_policy": "omit", "return_std": True, "sigma": 0.1}
    found, expected = client.compute(one(x, **options), sync=True), one(whole, **options)
    pairs = zip(found[:2], expected[:2])
    return all(np.allclose(a, b, rtol=1e-9, atol=1e-12, equal_nan=True) for a, b in pairs)


def a_small_graph(client):
    x = source(200 * 100_000, 100_000)
    return len(cloudpickle.dumps(design()(x))) < 50_000


def a_small_task(client):
    return len(pickle.dumps(design(window_length=10_001))) < 500


def one_thread_in_a_task(client):
    from algdiff import _threads

    return client.submit(_threads.count, None).result(timeout=60) == 1


def saved(name, x):
    np.save(HERE / name, x)
    return HERE / name


def regions(client):
    # Far from the grid, several channels, columns, orders, a Fortran order, around the ends.
    rng = np.random.default_rng(1)
    for shape, axis, order, one, mode in [
        ((3, 90_000), 1, "C", design("newest"), "fit"),
        ((90_000, 3), 0, "C", design(0.0, deriv=(1, 2)), "valid"),
        ((3, 90_000), 1, "F", design(0.37), "wrap"),
    ]:
        x = np.asarray(rng.standard_normal(shape), order=order)
        words = {name: getattr(one, name) for name in ("deriv", "tau", "engine")}
        words |= {"axis": axis, "mode": mode, "memory": 1 << 21, "overwrite": True}
        report = differentiate_paths(client, saved("x.npy", x), HERE / "y.npy", 101, **words)
        found = np.load(HERE / "y.npy")
        if report.blocks < 4 or found.tobytes() != np.ascontiguousarray(one(x, axis, mode=mode)).tobytes():
            return (shape, mode, report)
    return os.listdir(HERE).count("y.npy.partial") == 0


def regions_of_a_store(client):
    zarr = __import__("zarr")
    x = np.random.default_rng(2).standard_normal((4, 600_000))
    zarr.save_array(HERE / "x.zarr", x)
    report = differentiate_paths(client, HERE / "x.zarr", HERE / "y.zarr", 101, engine="direct", memory=1 << 26)
    return report.blocks > 1 and zarr.load(HERE / "y.zarr").tobytes() == design()(x).tobytes()


def few_words_for_regions(client):
    options, cuts = Options(), [(k, k + 1) for k in range(256)]
    places = [located("src", "/a/folder/x.npy"), located("dst", "/a/folder/y.npy")]
    spec = Spec(*places, options, design(window_length=10_001), 0, "fit", 0.0, True, 1 << 29)
    tasks = _dask_paths.tasks(_dask_paths.Common(spec, "/a/folder/y.npy.partial", [1, 2], None), cuts)
    graph = {key: value for task in tasks for key, value in dict(task.__dask_graph__()).items()}
    return len(graph) == 257 and len(cloudpickle.dumps(graph)) < 50_000


def flat_memory(client):
    peaks = []
    for samples in (4_000_000, 12_000_000):
        path = HERE / "long.npy"
        with path.open("wb") as file:
            np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (samples,)})
            file.truncate(file.tell() + 8 * samples)
        differentiate_paths(client, path, HERE / "y.npy", 101, memory=1 << 26, overwrite=True)
        peaks.append(max(client.run(peak).values()))
    return peaks[1] < 1.1 * peaks[0] or peaks


def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def an_input_that_changes(client):
    path, other = saved("x.npy", np.zeros(200_000)), saved("other.npy", np.ones(200_000))
    try:
        differentiate_paths(
            client, path, HERE / "z.npy", 101, memory=1 << 21, progress=lambda _: other.exists() and other.replace(path)
        )
    except ValueError as error:
        left = list(HERE.glob("z.npy*"))
        return ("got another or a changed one" in str(error) and not left) or (str(error), left)


def tasks_of_a_run_that_failed_are_over(client):
    class Failed(Exception):
        pass

    def fail(fraction):
        raise Failed

    def executing(dask_worker):
        return len(dask_worker.state.executing)

    path = saved("x.npy", np.random.default_rng(4).standard_normal(3_000_000))
    try:
        differentiate_paths(client, path, HERE / "z.npy", 20_001, engine="direct", memory=1 << 24, progress=fail)
    except Failed:
        return not any(client.run(executing).values())


def a_worker_killed_between_regions(client):
    x = np.random.default_rng(3).standard_normal(600_000)
    victims = sorted(client.run(os.getpid).values())
    killed = []

    def kill(fraction):
        if not killed:
            killed.append(fraction)
            os.kill(victims[0], signal.SIGKILL)

    words = {"engine": "direct", "memory": 1 << 23, "overwrite": True}
    report = differentiate_paths(client, saved("x.npy", x), HERE / "y.npy", 20_001, progress=kill, **words)
    same = np.load(HERE / "y.npy").tobytes() == algdiff.differentiate(x, 20_001, engine="direct").tobytes()
    return same and report.blocks > 4 and killed[0] < 0.5


def a_killed_worker(client):
    samples, chunk, one = 40_000, 1000, design()
    expected = one(source(samples, chunk).compute(scheduler="synchronous"))
    victim, *_ = client.run(os.getpid).values()
    future = client.compute(one(source(samples, chunk, wait=0.1)))
    deadline = time.monotonic() + 30
    while len(list(HERE.iterdir())) < 6 and time.monotonic() < deadline:
        time.sleep(0.01)
    os.kill(victim, signal.SIGKILL)
    unfinished = not future.done()
    return unfinished and future.result(timeout=60).tobytes() == expected.tobytes()


CHECKS = [
    causal,
    anticausal,
    centred,
    skewed,
    chunks_shorter_than_the_window,
    short_last_chunk,
    gaps,
    a_small_graph,
    a_small_task,
    one_thread_in_a_task,
    regions,
    regions_of_a_store,
    few_words_for_regions,
    flat_memory,
    an_input_that_changes,
    tasks_of_a_run_that_failed_are_over,
    a_worker_killed_between_regions,  # the last, for they cost workers
    a_killed_worker,
]

if __name__ == "__main__":
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0", memory_limit="2GiB"
    ) as cluster:
        with Client(cluster) as client:
            for check in CHECKS:
                print(check.__name__, check(client), flush=True)
"""

CHECKS = (
    "causal",
    "anticausal",
    "centred",
    "skewed",
    "chunks_shorter_than_the_window",
    "short_last_chunk",
    "gaps",
    "a_small_graph",
    "a_small_task",
    "one_thread_in_a_task",
    "regions",
    "regions_of_a_store",
    "few_words_for_regions",
    "flat_memory",
    "an_input_that_changes",
    "tasks_of_a_run_that_failed_are_over",
    "a_worker_killed_between_regions",
    "a_killed_worker",
)


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return what the checks found, each on a line of its own; one cluster for all of them."""
    path: Path = tmp_path_factory.mktemp("cluster")
    (path / "notes").mkdir()
    script = path / "script.py"
    script.write_text(SCRIPT)
    command = [sys.executable, str(script), str(path / "notes")]
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, cwd=path)
    assert result.returncode == 0, result.stderr
    found = dict(line.split(maxsplit=1) for line in result.stdout.splitlines())
    assert tuple(found) == CHECKS
    return found


@pytest.mark.parametrize("check", CHECKS)
def test_on_a_cluster(printed: dict[str, str], check: str) -> None:
    assert printed[check] == "True"
