"""The paper's first illustration: who errs by how much, after how long, knowing what.

The first derivative of tanh(t - 1) + exp(-t/1.2) sin(6 t + pi) from 1001 samples, 0.005 s apart, in white noise at
25 dB as the paper defines it (noisy samples over noise), for ten seeds: signal and noise are those of the paper's
figures. Times are of the processor, on one thread.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from contextlib import contextmanager
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # common.py is shared with the benches of speed

import numpy as np
from accuracy_peers import NOT_TRIED, OURS, TOLD, Peer, Problem, peers

from algdiff import _paper_figures as paper
from common import best_of, figure, machine, one_thread, table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

Row = dict[str, Any]
CORE = (0.55, 4.45)
CHECKS: tuple[tuple[str, dict[str, Any], float], ...] = (
    # Measured once with SciPy 1.17 and NumPy 2.4, before this program was written.
    ("savgol_filter, best on the core", {"window_length": 233, "polyorder": 6}, 0.0464),
    ("savgol_filter, a guess", {"window_length": 61, "polyorder": 3}, 0.1869),
    ("np.gradient", {}, 6.932),
)
TOLERANCE = 0.02
HEAD = (
    "method",
    "parameters",
    "told",
    "RMSE on the core",
    "sd over seeds",
    "RMSE over all samples",
    "tuning, s",
    "one signal, ms",
)


def posed() -> Problem:
    """Return the illustration's problem."""
    first, last = (round(end / paper.DELTA) for end in CORE)
    rows = np.stack([paper.observe(seed) for seed in paper.SEEDS])
    return Problem(rows, paper.slope(paper.TIMES), paper.DELTA, slice(first, last + 1))


def check(problem: Problem, found: Sequence[Peer]) -> None:
    """Stop unless three known errors come out."""
    calls = {peer.name: peer.call for peer in found}
    for name, parameters, expected in CHECKS:
        core = problem.errors(problem.estimates(partial(calls[name], **parameters)))[0].mean()
        if not abs(core / expected - 1) <= TOLERANCE:
            raise SystemExit(f"{name} {parameters}: expected an RMSE of {expected} on the core, got {core:.4g}")


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise TimeoutError after this time by the clock on the wall: a timer of the processor makes its clock coarse."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"not finished after {seconds:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def measure(peer: Peer, problem: Problem, limit: float) -> Row:
    """Tune a peer, differentiate every row, and time one; the limit is for the first two."""
    with limited(limit):
        started = time.process_time()
        parameters = peer.given if peer.tune is None else peer.tune(problem)
        tuning = time.process_time() - started
        core, everything = problem.errors(problem.estimates(partial(peer.call, **parameters)))
    rows = cycle(problem.rows)  # some remember the last signal
    best = best_of({peer.name: lambda: peer.call(next(rows), **parameters)}, repeat=2 * len(problem.rows), budget=3.0)
    row: Row = {"method": peer.name, "parameters": parameters, "told": peer.told, "chooses": peer.chooses}
    row |= {"core": core.tolist(), "all": everything.tolist()}
    return row | {"tuning": None if peer.tune is None else tuning, "call": best[peer.name]}


def measured(problem: Problem, options: argparse.Namespace) -> tuple[list[Row], list[str]]:
    """Return a row for every peer, by what it is told and its error, and who has none and why."""
    found, left_out = peers(problem)
    check(problem, found)
    rows = []
    for peer in found:
        if options.quick and peer.slow:
            left_out.append(f"{peer.name}: takes longer to tune than --quick allows")
            continue
        try:
            rows.append(measure(peer, problem, options.limit))
        except Exception as error:
            if peer.name.startswith(OURS):
                raise
            left_out.append(f"{peer.name}: {type(error).__name__}: {error}")
        print(f"{peer.name} done", file=sys.stderr, flush=True)
    rows.sort(key=lambda row: (TOLD.index(row["told"]), np.mean(row["core"])))
    return rows, [*left_out, NOT_TRIED]


def cells(row: Row) -> list[str]:
    """Return a row of the table."""
    shown = {name: figure(value, 3) if isinstance(value, float) else value for name, value in row["parameters"].items()}
    parameters = ", ".join(f"{name} {value}" for name, value in shown.items())
    tuning = "in the call" if row["chooses"] else figure(row["tuning"])
    errors = f"{np.mean(row['core']):.4f}", f"{np.std(row['core'], ddof=1):.4f}", f"{np.mean(row['all']):.4f}"
    return [row["method"], parameters, row["told"], *errors, tuning, figure(1e3 * row["call"])]


def notes() -> list[str]:
    """Return what the table does not say."""
    return [
        f"Means over seeds {paper.SEEDS[0]} to {paper.SEEDS[-1]}; the core is {CORE[0]} to {CORE[1]} s.",
        "What chooses in the call chooses anew for every signal: its time is that of choice and estimate.",
        "What PyNumDiff's optimize() finds on seed 0 serves all seeds. 'The truth' is the best on a grid by the true",
        "derivative, on the core and of all seeds unless it says otherwise: not a way to differentiate, but about the",
        "most that tuning can do.",
    ]


def arguments(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here as well, of every seed")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="draw the error against the time")
    parser.add_argument("--quick", action="store_true", help="a minute: without what takes long to tune")
    parser.add_argument(
        "--limit", type=float, default=120.0, metavar="SECONDS", help="for tuning one method; default: %(default)g"
    )
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    options = arguments(argv)
    header = machine("scipy", "pynumdiff", "derivative", "PyWavelets")
    print("\n".join(f"- {name}: {value}" for name, value in header.items()) + "\n", flush=True)
    rows, left_out = measured(posed(), options)
    print(table(HEAD, [cells(row) for row in rows]))
    print("\n" + "\n".join(notes()))
    print("\nNot in the table:\n" + "\n".join(f"- {line}" for line in left_out))
    if options.json is not None:
        content = {**header, "quick": options.quick, "limit": options.limit, "rows": rows, "left_out": left_out}
        options.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    if options.figure is not None:
        from scatter import draw

        draw(rows, header, options.figure)
    return 0


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
