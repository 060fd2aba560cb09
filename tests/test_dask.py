"""Tasks of Dask: one thread each, for Dask itself runs as many as there are processors."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import _threads

X = np.cumsum(np.random.default_rng(0).standard_normal(1_000_000))


def _threads_here(_: Any = None) -> int:
    return _threads.count(None)


def test_dask_is_not_imported_by_us() -> None:
    code = "import sys, numpy, algdiff; algdiff.differentiate(numpy.zeros(10**6), 101); print('dask' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert result.stdout == "False\n"


@pytest.fixture
def dask(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.delenv("ALGDIFF_NUM_THREADS", raising=False)
    return pytest.importorskip("dask", reason="needs dask")


def test_tasks_of_the_local_schedulers_have_one_thread(dask: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def task() -> tuple[int, int, bytes]:
        return _threads.count(None), _threads.count(3), algdiff.differentiate(X, 101).tobytes()

    expected = algdiff.differentiate(X, 101).tobytes()
    tasks = [dask.delayed(task)() for _ in range(3)]
    assert _threads_here() == 0
    assert dask.compute(*tasks, scheduler="threads") == ((1, 3, expected),) * 3
    assert dask.compute(*tasks, scheduler="synchronous") == ((0, 3, expected),) * 3
    assert _threads_here() == 0
    monkeypatch.setenv("ALGDIFF_NUM_THREADS", "2")
    assert dask.compute(dask.delayed(_threads_here)(), scheduler="threads") == (2,)


def test_chunks_of_a_dask_array_have_the_bits_of_the_whole(dask: Any) -> None:
    array = pytest.importorskip("dask.array", reason="needs dask[array]")
    design = algdiff.Differentiator(101, engine="direct")
    chunks = array.from_array(X, chunks=100_000)
    halo = 50
    result = chunks.map_overlap(design, depth=halo, boundary="none", dtype=float).compute(scheduler="threads")
    assert result.tobytes() == design(X).tobytes()
    assert dask.__name__ == "dask"


SCRIPT = """
import sys
import numpy as np
import algdiff
from algdiff import _threads

def threads_here(_):
    algdiff.differentiate(np.zeros(1000), 11)
    return _threads.count(None)

def in_a_pool(x):
    import dask
    return dask.compute(dask.delayed(threads_here)(x), scheduler="threads")[0]

if __name__ == "__main__":
    import dask
    print(*dask.compute(*[dask.delayed(threads_here)(k) for k in range(2)], scheduler="processes"))
    if "distributed" in sys.argv:
        from distributed import Client, LocalCluster

        for processes in (True, False):
            with LocalCluster(1, threads_per_worker=2, processes=processes, dashboard_address="127.0.0.1:0") as cluster:
                with Client(cluster) as client:
                    for task in (threads_here, in_a_pool):
                        print(*client.gather(client.map(task, range(3))))
            print(threads_here(0))
"""


def _run_script(path: Path, *arguments: str) -> str:
    script = path / "script.py"
    script.write_text(SCRIPT)
    command = [sys.executable, str(script), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=100, cwd=path).stdout


def test_tasks_in_processes_have_one_thread(dask: Any, tmp_path: Path) -> None:
    assert dask
    assert _run_script(tmp_path) == "1 1\n"


def test_tasks_of_workers_have_one_thread(dask: Any, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="needs dask[distributed]")
    assert dask
    assert _run_script(tmp_path, "distributed") == "1 1\n" + "1 1 1\n1 1 1\n0\n" * 2
