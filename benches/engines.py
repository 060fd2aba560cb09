"""The choice of the engine, held to the clock: every engine that accepts a design against the one that runs by itself.

Prints, for every point of a grid, the engines' nanoseconds per output, the choice and how many times the best it costs.
The worst may be 1.2.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import algdiff
from common import ENGINES, best_of, chosen, estimator, figure, machine, one_thread, signal, table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

ALLOWED = 1.2
WINDOWS = (5, 11, 21, 33, 61, 111, 201, 501, 1001, 2001, 4001, 10_001, 100_001)
DESIGNS: tuple[dict[str, Any], ...] = (
    {"degree": 3, "kappa": 0.0, "mu": 0.0},
    {"degree": 3, "kappa": 1.0, "mu": 1.0},
    {"degree": 7, "kappa": 0.0, "mu": 2.0},
    {"degree": 3, "kappa": 0.5, "mu": 0.5},
)
THREE = (0, 1, 2)


class Point(NamedTuple):
    """One design and the type of its samples."""

    window_length: int
    deriv: Any
    design: dict[str, Any]
    dtype: str

    def cells(self) -> list[str]:
        """Return a row of the table, without what is measured."""
        d = self.design
        exponents = f"{d['kappa']:g}, {d['mu']:g}"
        return [str(self.window_length), str(self.deriv), str(d["degree"]), exponents, self.dtype]


def grid() -> Iterator[Point]:
    """Yield the points: all designs in double precision, the first ones in single precision and with three orders."""
    for window_length in WINDOWS:
        for design in DESIGNS:
            if design["degree"] < window_length:
                yield Point(window_length, 1, design, "float64")
        for design in (DESIGNS[1], DESIGNS[3]):
            yield Point(window_length, 1, design, "float32")
        for design in (DESIGNS[0], DESIGNS[3]):
            yield Point(window_length, THREE, design, "float64")


def measure(point: Point, x: NDArray[Any], repeat: int, seconds: float) -> dict[str, Any]:
    """Time all engines in turn, each on its own number of outputs."""
    window_length, results = point.window_length, np.size(point.deriv)
    calls: dict[str, Callable[[], object]] = {}
    outputs: dict[str, int] = {}
    for engine in (*ENGINES, "auto"):
        try:
            run = estimator(engine, window_length, point.deriv, **point.design)
            outputs[engine] = affordable(run, x, seconds)
        except ValueError:
            continue
        piece = x[: outputs[engine] + window_length - 1]
        out = np.zeros((results, outputs[engine]) if results > 1 else outputs[engine], x.dtype)
        calls[engine] = partial(run, piece, mode="valid", threads=1, out=out)
    times = {name: 1e9 * best / outputs[name] for name, best in best_of(calls, repeat, 4 * seconds).items()}
    automatic = times.pop("auto")
    choice = chosen(window_length, point.dtype, point.deriv, **point.design)
    best = min(times, key=lambda name: times[name])
    # The automatic run is that of the chosen engine on as many outputs, timed twice.
    ratio = min(automatic, times[choice]) / times[best]
    return {"ns": times, "auto_ns": automatic, "choice": choice, "best": best, "ratio": ratio}


def affordable(run: algdiff.Differentiator, x: NDArray[Any], seconds: float) -> int:
    """Return how many outputs an engine is timed on: all, in whole blocks, but for direct as many as it has time for.

    The last block of a row costs as much as any other, however little of it is wanted.
    """
    window_length = run.weights.shape[-1]
    most = len(x) - window_length + 1
    few = min(most, 2000)
    short = partial(run, x[: few + window_length - 1], mode="valid", threads=1)
    short()  # prepares the engine, or it refuses
    if run.engine_for(x.dtype) != "direct":
        grid = run._bank.grid(single=x.dtype == np.float32)
        return most // grid * grid or most
    started = time.perf_counter()
    short()
    return min(most, max(few, int(few * seconds / (time.perf_counter() - started))))


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return 1 with --strict if the choice costs more than 1.2 times the best."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--samples", type=int, default=2**20, metavar="N", help="default: %(default)s")
    parser.add_argument("--repeat", type=int, default=5, metavar="N", help="best of this many; default: %(default)s")
    parser.add_argument("--seconds", type=float, default=0.2, help="about how long a call of direct may take")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here as well")
    parser.add_argument(
        "--strict", action="store_true", help=f"return 1 if a choice costs more than {ALLOWED} times the best"
    )
    options = parser.parse_args(argv)
    header = machine()
    print("\n".join(f"- {name}: {value}" for name, value in header.items()))
    print(
        f"- {options.samples:,} outputs or more, of direct fewer where it is slow; best of {options.repeat} repeats\n"
    )
    samples = signal(2 * options.samples + max(WINDOWS))
    data = {dtype: samples.astype(dtype) for dtype in ("float64", "float32")}
    rows, found = [], []
    for point in grid():
        outputs = max(options.samples, min(4 * point.window_length, 2 * options.samples))
        x = data[point.dtype][: outputs + point.window_length - 1]
        result = measure(point, x, options.repeat, options.seconds)
        found.append({**point._asdict(), **result})
        times = [figure(result["ns"].get(name)) for name in ENGINES]
        rows.append([*point.cells(), *times, result["choice"], result["best"], figure(result["ratio"], 3)])
    print(table(["window", "deriv", "degree", "kappa, mu", "dtype", *ENGINES, "choice", "best", "ratio"], rows))
    worst = max(result["ratio"] for result in found)
    print(f"\n{len(found)} points, worst choice {worst:.2f} times the best; allowed {ALLOWED}")
    if options.json is not None:
        content = {**header, "points": found, "worst": worst}
        options.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return int(options.strict and worst > ALLOWED)


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
