"""Long runs: streams do not grow and do not drift, and runs over files that are killed lose nothing.

Memory is compared before and after; the last estimates, to the bit, with those of a new stream that got the last
samples only; constants and polynomials, at the end, with their derivatives. Runs over files, every block of which is a
checkpoint, are killed after random times and go on until they are done: the results must be those of one run in peace,
byte by byte, with nothing beside them, and no block that was noted may be computed again. Returns 1 if anything is off.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import algdiff
from common import EPS, figure, machine, one_thread, table
from scaling import memory

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Samples = NDArray[np.float64]
    Run = Callable[[int, np.random.Generator], list[str]]

LENGTH = 111
BLOCK = 10_000
GROWTH = 2**20  # bytes: what the allocator may keep; 100 a block, 1 of every 10 single pushes
CYCLE = 400  # samples between two resets
DESIGN = algdiff.Differentiator(LENGTH, degree=3, kappa=0, mu=0, tau="newest")
GAPS = 0.05
FORMATS = (".npy", ".csv", ".h5", ".zarr", ".parquet")


def same(what: str, found: Any, expected: Any) -> list[str]:
    """Return what is wrong if these are not the same to the bit."""
    a, b = np.ascontiguousarray(found, float), np.ascontiguousarray(expected, float)
    return [] if a.tobytes() == b.tobytes() else [f"{what}: {np.sum(a != b)} of {a.size} estimates differ"]


def one_by_one(stream: algdiff.Stream, x: Samples, t: Samples | None = None) -> list[float]:
    """Push samples singly."""
    if t is None:
        return [stream.push(value) for value in x.tolist()]
    return [stream.push(value, time) for value, time in zip(x.tolist(), t.tolist(), strict=True)]


def again(x: Samples, found: Samples, t: Samples | None = None, **options: Any) -> list[str]:
    """Compare the last estimates with those of a new stream that got these samples alone, singly."""
    expected = one_by_one(DESIGN.stream(**options), x, t)[LENGTH - 1 :]
    return same("a new stream", found[LENGTH - 1 :], expected)


def mixed(stream: algdiff.Stream, x: Samples, t: Samples | None = None) -> Samples:
    """Push one half as a block and the other singly."""
    half = len(x) // 2
    block = stream.push(x[:half], None if t is None else t[:half])
    return np.concatenate([block, one_by_one(stream, x[half:], None if t is None else t[half:])])


def known(stream: algdiff.Stream, scale: float) -> list[str]:
    """Go on with what has a known derivative: a constant exactly, a cubic to the bound of the engine "direct"."""
    wrong = []
    flat = stream.push(np.full(2 * LENGTH, scale))[LENGTH:]
    if np.any(flat != 0):
        wrong.append(f"a constant has the slope {np.abs(flat).max()}")
    t = np.arange(-500.0, 500.0)
    x = t**3 / 64 - 5 * t  # without rounding
    slope = stream.push(x)[LENGTH:]
    bound = 4 * (LENGTH + 8) * EPS * np.abs(np.cumsum(DESIGN.weights)).sum() * np.abs(np.diff(x)).max()
    off = np.abs(slope - (3 * t**2 / 64 - 5)[LENGTH:]).max()
    if not off <= bound:
        wrong.append(f"a cubic is off by {off}, allowed {bound}")
    return wrong


def in_blocks(count: int, random: np.random.Generator) -> list[str]:
    """Push blocks."""
    stream = DESIGN.stream(threads=1)
    for _ in range(count // BLOCK):
        x = random.standard_normal(BLOCK)
        found = stream.push(x)
    wrong = again(x, found)
    if stream.count != count // BLOCK * BLOCK:
        wrong.append(f"the stream counts {stream.count} samples")
    return wrong + known(stream, 1e6)


def singly(count: int, random: np.random.Generator) -> list[str]:
    """Push samples one by one."""
    stream = DESIGN.stream()
    for _ in range(count // BLOCK):
        x = random.standard_normal(BLOCK)
        found = np.array(one_by_one(stream, x))
    return again(x, found) + known(stream, 1e6)


def with_gaps(count: int, random: np.random.Generator) -> list[str]:
    """Push samples of which some are missing."""
    stream = DESIGN.stream(nan_policy="omit", threads=1)
    for _ in range(count // BLOCK):
        x = random.standard_normal(BLOCK)
        x[random.random(BLOCK) < GAPS] = np.nan
        found = mixed(stream, x)
    return again(x, found, nan_policy="omit") + known(stream, 1e6)


def with_resets(count: int, random: np.random.Generator) -> list[str]:
    """Push the same samples again and again, each time into growing windows."""
    stream = DESIGN.stream(warmup="grow", threads=1)
    x = random.standard_normal(CYCLE)
    first, wrong = one_by_one(DESIGN.stream(warmup="grow"), x), list[str]()
    for i in range(count // CYCLE):
        wrong += same(f"cycle {i}", mixed(stream, x), first)
        stream.reset()
    return wrong[:3]


def with_times(count: int, random: np.random.Generator) -> list[str]:
    """Push samples with time stamps."""
    stream, now = DESIGN.stream(threads=1), 0.0
    for _ in range(count // BLOCK):
        x = random.standard_normal(BLOCK)
        t = now + np.cumsum(random.uniform(0.5, 1.5, BLOCK))
        now = float(t[-1])
        found = mixed(stream, x, t)
    return again(x, found, t)


# What runs, and on how many samples.
RUNS: dict[str, tuple[Run, int]] = {
    f"blocks of {BLOCK:,}": (in_blocks, 10**8),
    "one by one": (singly, 10**7),
    'nan_policy="omit", 5 % missing': (with_gaps, 10**7),
    f'warmup="grow", a reset every {CYCLE}': (with_resets, 10**7),
    "time stamps": (with_times, 10**6),
}


def measure(run: Run, count: int) -> tuple[float, int | None, int | None, list[str]]:
    """Return the seconds, the resident memory before and after (Linux only), and what is wrong.

    A short run goes before, which takes what memory is taken once.
    """
    run(min(count, 20 * BLOCK), np.random.default_rng(0))
    before = resident()
    started = time.perf_counter()
    wrong = run(count, np.random.default_rng(1))
    seconds, after = time.perf_counter() - started, resident()
    if before is not None and after is not None and after - before > GROWTH:
        wrong.append(f"memory grew by {after - before} bytes")
    return seconds, before, after, wrong


def resident() -> int | None:
    """Return the resident memory in bytes; Linux only."""
    try:
        return memory("VmRSS")
    except (OSError, StopIteration):
        return None


def killed(suffix: str, kills: int) -> list[str]:
    """Kill runs whose results have the format of `suffix`, and print what came of it; return what is wrong."""
    sys.path.append(str(Path(__file__).parent.parent / "tests"))
    from kills import kill

    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        hunt = kill(Path(folder), suffix, kills)
        seconds = time.perf_counter() - started
    print(
        f"- {suffix}: {hunt.kills} processes killed, {hunt.finished} results of {hunt.blocks} blocks, "
        f"{len(hunt.wrong)} faults, {figure(seconds)} s",
        flush=True,
    )
    return [f"{suffix}: {what}" for what in hunt.wrong]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if anything is off."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--share", type=float, default=1.0, help="of the samples of every stream; default: %(default)s")
    parser.add_argument("--kills", type=int, default=100, help="of runs over files; default: %(default)s")
    parser.add_argument("--formats", nargs="+", default=FORMATS, help="of their results; default: %(default)s")
    options = parser.parse_args(argv)
    print("\n".join(f"- {name}: {value}" for name, value in machine().items()))
    print(f"- window {LENGTH}, first derivative, degree 3, no delay, float64\n", flush=True)
    rows, failures = [], []
    for name, (run, most) in RUNS.items() if options.share > 0 else ():
        count = max(BLOCK, int(options.share * most))
        seconds, before, after, wrong = measure(run, count)
        sizes = ["" if size is None else f"{size / 2**20:.1f}" for size in (before, after)]
        rows.append([name, f"{count:,}", figure(seconds), *sizes, "wrong" if wrong else "yes"])
        failures += [f"{name}: {what}" for what in wrong]
    if rows:
        titles = ["run", "samples", "seconds", "MiB at the start", "MiB at the end", "as expected"]
        print(table(titles, rows), end="\n\n")
    for suffix in options.formats if options.kills > 0 else ():
        failures += killed(suffix, options.kills)
    print("".join(f"\n{failure}" for failure in failures), end="\n" if failures else "")
    return int(bool(failures))


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
