"""Latency of one sample at a time: from Python, Rust and C, beside what else one would write; results are checked.

Every push is timed by itself. Contenders take turns; of the medians and of the other quantiles the smallest of all
turns counts, so that other work on the machine counts as little as it can, and from it the smallest median time
between two readings of the clock is taken off. The garbage collector is off meanwhile, as in `timeit`. What a call
costs at least is that of the builtin ``abs``, which takes a number and returns one as a push does; the cheapest method
of a stream, which has to lock it as well, is ``Stream.reset``.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import signal

import algdiff
from common import EPS, SAVGOL, best_of, figure, machine, one_thread, table
from programs import FLAGS, HASHED, PUSHES, bench_of_rust, compiled, hashed, run
from pushes import (
    C_FLOAT,
    EMPTY,
    FILTER,
    OURS,
    QUEUE,
    RECURSIVE,
    RESET,
    RING,
    RUST,
    C,
    Case,
    check,
    filtered,
    latencies,
    noise,
    queue,
    recursive,
    ring,
    rounding,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from pushes import Push

    Samples = NDArray[Any]

Found = dict[str, dict[str, float]]
Throughput = dict[str, float | None]
WINDOWS = (21, 61, 111, 501, 1001)
SLOW = {QUEUE: 5, FILTER: 10}  # times fewer pushes
OVER_EMPTY, LONGEST = 300.0, 2000.0  # ns: window 111 over an empty call, and window 1001
QUANTILES = {"median": 0.5, "p99": 0.99, "p999": 0.999}
BLOCK, BLOCKS = 4096, 16
OTHERS = {
    "one order, float64": Case("111", (111,)),
    "float32": Case("float32", (111,), dtype="float32"),
    "three orders": Case("orders", (111,), (0, 1, 2)),
    "windows 21, 61, 111": Case("windows", (21, 61, 111)),
    "16 channels": Case("channels16", (111,), channels=16),
    "64 channels": Case("channels64", (111,), channels=64),
    "omit, nothing missing": Case("omit", (111,), nan_policy="omit"),
    "omit, 5 % missing": Case("gaps", (111,), nan_policy="omit", missing=0.05),
}


def contenders(case: Case, peers: bool) -> dict[str, Push]:
    """Return what runs in Python, checked and with full windows."""
    found: dict[str, Push] = {OURS: case.stream().push}
    # What is missing from a window makes it a fit, which agrees to rounding.
    check(OURS, found[OURS], case, HASHED, 1e-9 if case.missing else 0.0)
    makers = {RING: ring, QUEUE: queue, FILTER: filtered} if peers else {RING: ring}
    for name, make in makers.items() if case.nan_policy == "propagate" else ():
        found[name] = make(case)
        check(name, found[name], case, HASHED, rounding(case))
    if peers:
        found |= {RECURSIVE: recursive(case), EMPTY: abs}
    return found


def measure(case: Case, programs: dict[str, tuple[list[str], Case]], peers: bool, options: argparse.Namespace) -> Found:
    """Return the quantiles of everybody's latencies in nanoseconds, and for programs what one of many pushes costs."""
    samples, best = case.samples(options.pushes), dict[str, dict[str, float]]()
    calls = contenders(case, peers)
    expected = {name: hashed(own.expected(HASHED)) for name, (_, own) in programs.items()}

    def better(name: str, found: dict[str, float]) -> None:
        old = best.setdefault(name, found)
        best[name] = {key: min(old[key], value) for key, value in found.items()}

    for _ in range(options.repeat):
        clock = float(np.median(latencies(None, samples)))
        for name, push in calls.items():
            own = samples[: max(2000, len(samples) // SLOW.get(name, 1))]
            better(name, {"pushes": len(own), "clock": clock, **quantiles(latencies(push, own))})
        if peers:
            streams = [case.stream()] * len(samples)
            spent = latencies(algdiff.Stream.reset, streams)
            better(RESET, {"pushes": len(streams), "clock": clock, **quantiles(spent)})
        for name, (command, _) in programs.items():
            found = run(command)
            if found.pop("hash") != expected[name]:
                raise SystemExit(f"{name}, {case.name} has not the bits of Python")
            better(name, {"pushes": PUSHES, **found})
    for found in best.values():
        found |= {key: max(found[key] - found["clock"], 0.0) for key in QUANTILES}
    return best


def quantiles(spent: Samples) -> dict[str, float]:
    """Return the median and what 1 in 100 and 1 in 1000 exceed."""
    cuts = np.quantile(spent, list(QUANTILES.values()), method="inverted_cdf")
    return dict(zip(QUANTILES, cuts.tolist(), strict=True))


def windows(rust: list[str] | None, folder: Path, options: argparse.Namespace) -> dict[int, Found]:
    """Measure all contenders at every window."""
    found = {}
    for length in WINDOWS:
        case = Case(str(length), (length,))
        programs = {} if rust is None else {RUST: ([*rust, case.name], case)}
        for name, own in {C: case, C_FLOAT: case._replace(dtype="float32")}.items():
            command = compiled(own, folder)
            if command is not None:
                programs[name] = (command, own)
        found[length] = measure(case, programs, True, options)
        print(f"window {length} done", file=sys.stderr, flush=True)
    return found


def others(rust: list[str] | None, options: argparse.Namespace) -> dict[str, Found]:
    """Measure ours and NumPy's ring where more is estimated, or less is known."""
    found = {}
    for name, case in OTHERS.items():
        known = rust is not None and case.nan_policy == "propagate"
        programs = {RUST: ([*rust, case.name], case)} if rust is not None and known else {}
        found[name] = measure(case, programs, False, options)
        print(f"{name} done", file=sys.stderr, flush=True)
    return found


def blocks(length: int, repeat: int) -> Throughput:
    """Return what a sample costs in nanoseconds if they come in blocks, checked before."""
    x = noise(BLOCK * BLOCKS)
    parts = np.split(x, BLOCKS)
    case = Case(str(length), (length,))
    weights = case.designs()[0].weights
    expected = case.expected(len(x)).ravel()
    streams = {"algdiff": case.stream(threads=1)}
    times: Throughput = {"algdiff": None, "algdiff, moments": None, FILTER: None}
    try:
        moments = algdiff.Differentiator(length, tau="newest", engine="moments", **SAVGOL)
        streams["algdiff, moments"] = moments.stream(threads=1)
    except ValueError:
        pass  # it takes no windows as short as that
    taps, one, state = weights[::-1].copy(), np.ones(1), np.zeros(length - 1)

    def filtered() -> list[Samples]:
        nonlocal state
        found = []
        for part in parts:
            result, state = signal.lfilter(taps, one, part, zi=state)
            found.append(result)
        return found

    calls: dict[str, Callable[[], Any]] = {
        name: partial(lambda push: [push(part) for part in parts], stream.push) for name, stream in streams.items()
    }
    calls[FILTER] = filtered
    for name, call in calls.items():
        off = float(np.abs(np.concatenate(call())[length - 1 :] - expected).max())
        bound = 0.0 if name == "algdiff" else 8 * EPS * (length + 1000) * float(np.abs(weights).sum())
        if not off <= bound:
            raise SystemExit(f"blocks, {name}, window {length} are off by {off}, allowed {bound}")
    return times | {name: 1e9 * best / len(x) for name, best in best_of(calls, 20 * repeat, budget=2.0).items()}


def cell(found: dict[str, float] | None) -> str:
    """Return the quantiles of one contender."""
    if found is None:
        return ""
    return f"{figure(found['median'], 3)} ({figure(found['p99'], 3)}, {figure(found['p999'], 3)})"


def times(found: float | None, ours: float) -> str:
    """Return a cost, and how many times ours that is."""
    return "" if found is None else f"{figure(found)} ({figure(found / ours)} x)"


def targets(lengths: dict[int, Found]) -> list[tuple[str, float, float]]:
    """Return what is to be held, what was measured, and the limit."""
    over = lengths[111][OURS]["median"] - lengths[111][EMPTY]["median"]
    return [
        ("window 111, over abs(x)", over, OVER_EMPTY),
        ("window 1001", lengths[1001][OURS]["median"], LONGEST),
    ]


def report(lengths: dict[int, Found], special: dict[str, Found], throughput: dict[int, Throughput]) -> None:
    """Print the tables."""
    names = list(next(iter(lengths.values())))
    print("One sample, ns: median (99 %, 99.9 %):\n")
    rows = [[name, *(cell(found.get(name)) for found in lengths.values())] for name in names]
    print(table(["window", *map(str, lengths)], rows))
    native = [name for name in names if "back_to_back" in lengths[WINDOWS[0]][name]]
    if native:
        print("\nBack to back, ns:\n")
        rows = [[name, *(figure(found[name]["back_to_back"]) for found in lengths.values())] for name in native]
        print(table(["window", *map(str, lengths)], rows))
    print("\nMore of it at window 111, one sample, ns: median (99 %, 99.9 %):\n")
    rows = [[name, *(cell(found.get(who)) for who in (OURS, RUST, RING))] for name, found in special.items()]
    print(table(["", OURS, RUST, RING], rows))
    print(f"\nBlocks of {BLOCK}, one thread, ns a sample:\n")
    rows = []
    for length, found in throughput.items():
        ours = found[OURS] or 0.0
        rest = [times(value, ours) for name, value in found.items() if name != OURS]
        rows.append([str(length), figure(ours), *rest])
    print(table(["window", *next(iter(throughput.values()))], rows))
    rows = [
        [name, figure(median, 3), f"at most {limit:g}", "yes" if median <= limit else "no"]
        for name, median, limit in targets(lengths)
    ]
    print("\n" + table(["target, one push from Python", "median, ns", "limit", "met"], rows))


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables; return 1 with --strict if a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--pushes", type=int, default=PUSHES, metavar="N", help="of each turn; default: %(default)s")
    parser.add_argument("--repeat", type=int, default=5, metavar="N", help="best of this many; default: %(default)s")
    parser.add_argument("--no-rust", action="store_true", help="leave out the bench of the core, which is compiled")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here as well")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the latency against the window")
    parser.add_argument("--strict", action="store_true", help="return 1 if a target is missed")
    options = parser.parse_args(argv)
    header = machine("scipy")
    print("\n".join(f"- {name}: {value}" for name, value in header.items()))
    print(f"- best of {options.repeat} turns of {options.pushes:,} pushes, in which {QUEUE} has 1 in {SLOW[QUEUE]}")
    print(f"  of the samples and {FILTER} 1 in {SLOW[FILTER]}")
    rust = None
    if not options.no_rust:
        try:
            rust = bench_of_rust()
        except subprocess.CalledProcessError as failure:
            print(f"- Rust is left out: {failure}")
        else:
            print("- Rust is left out: there is no cargo" if rust is None else f"- Rust: {Path(rust[0]).name}")
    with tempfile.TemporaryDirectory() as folder:
        if shutil.which("cc") is None:
            print("- C is left out: there is no cc")
        else:
            print(f"- C: cc {' '.join(FLAGS)}")
        print(flush=True)
        lengths = windows(rust, Path(folder), options)
    special = others(rust, options)
    throughput = {length: blocks(length, options.repeat) for length in WINDOWS}
    report(lengths, special, throughput)
    if options.json is not None:
        content = {**header, "repeat": options.repeat, "windows": lengths, "others": special, "blocks": throughput}
        options.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    if options.plot is not None:
        from streaming_picture import draw

        limits = {111: OVER_EMPTY + lengths[111][EMPTY]["median"], 1001: LONGEST}
        draw(lengths, limits, header, options.plot)
    return int(options.strict and any(median > limit for _, median, limit in targets(lengths)))


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
