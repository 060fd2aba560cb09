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
    a_killed_worker,  # the last, for it costs a worker
]

if __name__ == "__main__":
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit="2GiB"
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
