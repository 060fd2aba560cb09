"""The cost of long arrays: per sample from 10^5 to 10^9, with two threads, and the memory beyond input and output.

The longest arrays are float32 in files: the input sparse, the output in pieces that overlap by a window.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from common import COPY, SAVGOL, best_of, chosen, estimator, figure, machine, one_thread, signal, table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

IN_MEMORY = 10**8  # samples that are held in memory, input and output
PIECE = 10**7  # outputs of a piece beyond that
WINDOWS = (61, 1001)
Row = dict[str, Any]


def memory(field: str) -> int:
    """Return a field of the process's status in bytes."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(field + ":"))


def beyond(call: Callable[[], object]) -> int | None:
    """Return by how much the resident memory rose above where it was before the call, at its highest; Linux only."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the highest so far is now
        before = memory("VmRSS")
    except (OSError, StopIteration):
        return None
    call()
    return max(memory("VmHWM") - before, 0)


def in_memory(count: int, window_length: int, dtype: Any, repeat: int) -> Row:
    """Time one call on an array in memory."""
    # The result is touched before, and the memory of the first call counts: later ones find it in the process.
    x, out = signal(count, dtype), np.full(count, 1.0, dtype)
    run = estimator("auto", window_length, **SAVGOL)
    one, two = (partial(run, x, out=out, threads=threads) for threads in (1, 2))
    extra = beyond(two)
    calls: dict[str, Callable[[], object]] = {COPY: partial(np.copyto, out, x), "one": one, "two": two}
    best = best_of(calls, repeat * max(1, 10**6 // count), unit=COPY, clock=time.perf_counter)
    return {"ns": best["one"] / count * 1e9, "copies": best["one"] / best[COPY], "beyond": extra} | {
        "two_threads": best["one"] / best["two"]
    }


def mapped(count: int, window_length: int, folder: Path) -> Row:
    """Time a pass over a sparse file, piece by piece with a halo, into one reused result."""
    file = folder / "samples"
    with file.open("wb") as opened:
        opened.truncate(4 * count)
    x = np.memmap(file, np.float32, "r", shape=(count,))
    run = estimator("auto", window_length, **SAVGOL)
    halo, out = window_length - 1, np.zeros(PIECE, np.float32)

    def passes(threads: int) -> Callable[[], None]:
        def call() -> None:
            for start in range(0, count - halo, PIECE):
                stop = min(start + PIECE, count - halo)
                run(x[start : stop + halo], mode="valid", threads=threads, out=out[: stop - start])

        return call

    def copy() -> None:
        for start in range(0, count, PIECE):
            stop = min(start + PIECE, count)
            np.copyto(out[: stop - start], x[start:stop])

    calls: dict[str, Callable[[], object]] = {COPY: copy, "one": passes(1), "two": passes(2)}
    best = best_of(calls, 2, budget=60.0, unit=COPY, clock=time.perf_counter)
    row = {"ns": best["one"] / count * 1e9, "copies": best["one"] / best[COPY], "beyond": None}
    return row | {"two_threads": best["one"] / best["two"]}


def measure(count: int, window_length: int, options: argparse.Namespace) -> Row:
    """Return the figures of one length and window."""
    started = time.perf_counter()
    if count <= IN_MEMORY:
        dtype = np.float64 if count < IN_MEMORY else np.float32
        row = in_memory(count, window_length, dtype, options.repeat)
        where = "memory"
    else:
        with tempfile.TemporaryDirectory(dir=options.folder) as folder:
            row = mapped(count, window_length, Path(folder))
        dtype, where = np.float32, "a sparse file"
    named = {"samples": count, "window": window_length, "dtype": np.dtype(dtype).name, "where": where}
    engine = chosen(window_length, dtype)
    return {**named, "engine": engine, **row, "seconds": time.perf_counter() - started}


def cells(row: Row) -> list[str]:
    """Return a row of the table."""
    extra = "" if row["beyond"] is None else f"{row['beyond'] / 2**20:.1f} MiB"
    named = [f"{row['samples']:,}", str(row["window"]), row["dtype"], row["where"], row["engine"]]
    return [*named, figure(row["ns"]), figure(row["copies"]), figure(row["two_threads"], 3), extra]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--largest", type=int, default=10**9, metavar="N", help="samples; default: %(default)s")
    parser.add_argument("--windows", type=int, nargs="+", default=list(WINDOWS), metavar="N")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="best of this many; default: %(default)s")
    parser.add_argument("--folder", type=Path, help="where the sparse file goes; default: for temporary files")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here as well")
    options = parser.parse_args(argv)
    header = machine()
    print("\n".join(f"- {name}: {value}" for name, value in header.items()), "\n", flush=True)
    rows = []
    for window_length in options.windows:
        for power in range(5, 10):
            if 10**power <= options.largest:
                rows.append(measure(10**power, window_length, options))
                print(" ".join(cells(rows[-1])), file=sys.stderr, flush=True)
    head = [
        "samples",
        "window",
        "dtype",
        "in",
        "engine",
        "ns per sample",
        "copies",
        "two threads, times one",
        "memory beyond",
    ]
    print(table(head, [cells(row) for row in rows]))
    if options.json is not None:
        options.json.write_text(json.dumps({**header, "rows": rows}, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
