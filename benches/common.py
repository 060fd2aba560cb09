"""What the benches share: the machine, engines by name, interleaved timing and tables."""

from __future__ import annotations

import datetime
import os
import platform
import sys
import time
import warnings
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import algdiff

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    Samples = NDArray[Any]

EPS = float(np.finfo(float).eps)
ENGINES = ("direct", "moments", "fft")
SAVGOL: dict[str, Any] = {"degree": 3, "kappa": 0.0, "mu": 0.0}
COPY = "np.copyto"


def one_thread() -> None:
    """Start the program anew with libraries that use one thread, as they decide when they are imported."""
    wanted = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "MKL", "OMP")}
    if any(os.environ.get(name) != value for name, value in wanted.items()):
        os.execve(sys.executable, sys.orig_argv, {**os.environ, **wanted})  # noqa: S606


def estimator(engine: str, window_length: int, deriv: Any = 1, **design: Any) -> algdiff.Differentiator:
    """Return the design run by `engine`.

    Where the engine refuses the design, that or the first call is a ValueError.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return algdiff.Differentiator(window_length, deriv, engine=engine, **design)


def chosen(window_length: int, dtype: Any = np.float64, deriv: Any = 1, **design: Any) -> str:
    """Return the engine that runs by itself."""
    return estimator("auto", window_length, deriv, **{**SAVGOL, **design}).engine_for(dtype)


def signal(count: int, dtype: Any = np.float64) -> Samples:
    """Return a slow sine with noise."""
    noise = np.random.default_rng(20).standard_normal(count, dtype=np.float32)
    noise *= np.float32(0.1)
    x = noise.astype(dtype, copy=False)
    for start in range(0, count, 2**20):
        stop = min(count, start + 2**20)
        x[start:stop] += np.sin(1e-3 * np.arange(start, stop)).astype(dtype)
    return x


def best_of(
    calls: Mapping[str, Callable[[], object]],
    repeat: int,
    budget: float = 20.0,
    unit: str | None = None,
    clock: Callable[[], float] = time.process_time,
) -> dict[str, float]:
    """Time the calls in turn, `repeat` times; return the shortest of each in seconds.

    Neighbours in time share the state of the machine, so that ratios hold where the machine is shared; what all are
    measured in, `unit`, runs before each of them. A call that has used up its `budget` of seconds is not repeated. The
    processor time of all threads of the process is what counts, so that waiting for others does not; where threads are
    to gain something, `clock` must be that of the wall.
    """
    best, spent = dict.fromkeys(calls, float("inf")), dict.fromkeys(calls, 0.0)

    def measure(name: str) -> None:
        started = clock()
        calls[name]()
        elapsed = clock() - started
        best[name], spent[name] = min(best[name], elapsed), spent[name] + elapsed

    for _ in range(repeat):
        for name in calls:
            if unit is not None and name != unit:
                measure(unit)
            if spent[name] < budget:
                measure(name)
    return best


def shortest(call: Callable[[], object], seconds: float = 0.3) -> float:
    """Return the shortest of many batches of a call that takes microseconds."""
    started = time.perf_counter()
    call()
    batch = max(1, int(1e-3 / max(time.perf_counter() - started, 1e-7)))
    best, until = float("inf"), time.perf_counter() + seconds
    while time.perf_counter() < until:
        started = time.process_time()
        for _ in range(batch):
            call()
        best = min(best, (time.process_time() - started) / batch)
    return best


def machine(*distributions: str) -> dict[str, str]:
    """Return processor, date, command and versions."""
    found = {"processor": f"{_processor()}, {os.cpu_count()} threads", "date": datetime.date.today().isoformat()}
    found["command"] = " ".join(["python", *sys.argv])
    found["python"] = platform.python_version()
    for distribution in ("algdiff-rs", "numpy", *distributions):
        try:
            found[distribution] = version(distribution)
        except PackageNotFoundError:
            found[distribution] = "not installed"
    return found


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a table that is Markdown and reads as text."""
    cells = [[str(cell) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in cells
    ]
    return "\n".join([lines[0], "|" + "|".join("-" * (width + 2) for width in widths) + "|", *lines[1:]])


def figure(value: float | None, digits: int = 2) -> str:
    """Return a number with this many digits, none as nothing."""
    return "" if value is None else f"{float(f'{value:.{digits}g}'):.10g}"
