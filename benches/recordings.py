"""Files larger than a block: rate against copying the file and against the engine in memory, and peak memory.

Every run and every copy is a process of its own. Inputs are sparse `.npy` files: reading them costs what a file in the
page cache costs, writing the results what the disk takes. A copy reads the file in blocks of 16 MiB, writes them and
waits until they are on the disk, as a run does. Returns 1 if a run is more than 1.5 times slower than the slower of
both, or if peak memory differs by more than 10 % between the sizes. `--formats` compares formats instead.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import algdiff
from common import figure, machine, one_thread, signal, table
from scaling import memory

if TYPE_CHECKING:
    from collections.abc import Sequence

PIECE = 16 << 20
SLOWER = 1.5
GROWTH = 1.1
IN_MEMORY = 1 << 26  # samples
Row = dict[str, Any]


def sparse(path: Path, size: int) -> None:
    """Write an .npy file of float64 zeros that takes no room on the disk."""
    header = {"descr": "<f8", "fortran_order": False, "shape": (size // 8,)}
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        file.truncate(file.tell() + size)


def copy(source: Path, target: Path) -> None:
    """Copy a file, and wait until it is on the disk."""
    with source.open("rb", buffering=0) as read, target.open("wb", buffering=0) as write:
        buffer = memoryview(bytearray(PIECE))
        while count := read.readinto(buffer):
            write.write(buffer[:count])
        os.fsync(write.fileno())


def child(task: str, source: str, target: str, window_length: str) -> None:
    """Do one task in this process, and print its seconds and peak memory."""
    started = time.perf_counter()
    if task == "copy":
        copy(Path(source), Path(target))
    else:
        algdiff.differentiate_file(source, target, int(window_length), 1)
    seconds = time.perf_counter() - started
    print(json.dumps({"seconds": seconds, "peak": memory("VmHWM")}))


def best(task: str, source: Path, target: Path, window_length: int, repeat: int) -> Row:
    """Return the fastest of some processes, with the largest peak."""
    rows = []
    for _ in range(repeat):
        target.unlink(missing_ok=True)
        os.sync()
        command = [sys.executable, __file__, "--child", task, str(source), str(target), str(window_length)]
        rows.append(json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout))  # noqa: S603
    target.unlink(missing_ok=True)
    return {"seconds": min(row["seconds"] for row in rows), "peak": max(row["peak"] for row in rows)}


def engine(window_length: int, repeat: int) -> float:
    """Return the seconds per sample of a warm call in memory."""
    x = np.zeros(IN_MEMORY)
    out = np.ones(IN_MEMORY)
    design = algdiff.Differentiator(window_length)
    seconds = []
    for _ in range(1 + repeat):
        started = time.perf_counter()
        design(x, out=out)
        seconds.append(time.perf_counter() - started)
    return min(seconds[1:]) / IN_MEMORY


def sizes(options: argparse.Namespace) -> tuple[list[Row], list[str]]:
    """Measure every size, and say what is missed."""
    rows, missed = [], []
    for window_length in options.windows:
        in_memory = engine(window_length, options.repeat)
        for gibibytes in options.sizes:
            size = int(gibibytes * 2**30) // 8 * 8
            with tempfile.TemporaryDirectory(dir=options.folder) as folder:
                source, target = Path(folder, "x.npy"), Path(folder, "y.npy")
                sparse(source, size)
                copied = best("copy", source, target, window_length, options.repeat)["seconds"]
                run = best("run", source, target, window_length, options.repeat)
            computed = in_memory * size / 8
            ratio = run["seconds"] / max(copied, computed)
            rows.append(
                {"size": gibibytes, "window": window_length, "copy": copied, "engine": computed, **run, "ratio": ratio}
            )
            print(rows[-1], file=sys.stderr, flush=True)
            if ratio > SLOWER:
                missed.append(f"{gibibytes:g} GiB, window {window_length}: {ratio:.2f} times slower")
    peaks = [row["peak"] for row in rows]
    if max(peaks) > GROWTH * min(peaks):
        missed.append(f"peak memory from {min(peaks) >> 20} to {max(peaks) >> 20} MiB")
    return rows, missed


def by_format(options: argparse.Namespace) -> list[Row]:
    """Measure every format from and to itself, with a million samples for text and ten for the others."""
    rows = []
    x = signal(10**7)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        np.save(folder / "x.npy", x)
        np.save(folder / "short.npy", x[: 10**6])
        for suffix in (".npy", ".bin", ".h5", ".zarr", ".parquet", ".wav", ".npz", ".csv"):
            samples = 10**6 if suffix == ".csv" else 10**7
            first = folder / ("short.npy" if suffix == ".csv" else "x.npy")
            source, target = folder / f"x{suffix}", folder / f"y{suffix}"
            words: dict[str, Any] = {"fs": 1000, **({"dtype": "f8"} if suffix == ".bin" else {})}
            if source != first:
                # The signal itself, smoothed: what is in the file does not matter.
                algdiff.differentiate_file(first, source, 5, 0, fs=1000)
            if suffix == ".wav":
                del words["fs"]
            seconds = []
            for _ in range(options.repeat):
                report = algdiff.differentiate_file(source, target, 101, overwrite=True, **words)
                seconds.append(report.seconds)
            rows.append({"format": suffix, "samples": samples, "ns": min(seconds) / samples * 1e9})
            print(rows[-1], file=sys.stderr, flush=True)
    return rows


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--sizes", type=float, nargs="+", default=[4, 12], metavar="GIB", help="default: 4 12")
    parser.add_argument("--windows", type=int, nargs="+", default=[101], metavar="N", help="default: 101")
    parser.add_argument("--repeat", type=int, default=2, metavar="N", help="best of this many; default: %(default)s")
    parser.add_argument("--folder", type=Path, help="where the files go; default: for temporary files")
    parser.add_argument("--formats", action="store_true", help="compare formats, not sizes")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here as well")
    parser.add_argument("--child", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.child:
        child(*options.child)
        return 0
    header, missed = machine(), []
    print("\n".join(f"- {name}: {value}" for name, value in header.items()), "\n", flush=True)
    if options.formats:
        rows = by_format(options)
        npy = rows[0]["ns"]
        cells = [[row["format"], f"{row['samples']:,}", figure(row["ns"]), figure(row["ns"] / npy)] for row in rows]
        print(table(["format", "samples", "ns per sample", "times .npy"], cells))
    else:
        rows, missed = sizes(options)
        head = ["size", "window", "copy", "engine in memory", "run", "times the slower", "rate", "peak memory"]
        cells = [
            [
                f"{row['size']:g} GiB",
                str(row["window"]),
                *(f"{row[name]:.2f} s" for name in ("copy", "engine", "seconds")),
                f"{row['ratio']:.2f}",
                f"{row['size'] * 2**30 / row['seconds'] / 1e6:,.0f} MB/s",
                f"{row['peak'] / 2**20:.0f} MiB",
            ]
            for row in rows
        ]
        print(table(head, cells))
    for line in missed:
        print("missed:", line)
    if options.json is not None:
        options.json.write_text(json.dumps({**header, "rows": rows}, indent=2) + "\n", encoding="utf-8")
    return int(bool(missed))


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
