"""What choosing a window costs, and windows that adapt, in passes of the chosen design over the same samples."""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import algdiff
from common import best_of, figure, machine, one_thread, table

if TYPE_CHECKING:
    from collections.abc import Callable

COUNTS = (1000, 100_000, 1_000_000)
RATES = (1e-3, 5e-3, 5e-2)
"""Of the sine, in radians per sample: the faster, the shorter the window."""

AT_MOST, AT_MOST_LOCAL = 40.0, 12.0
"""Passes over 10^6 samples: for the choice, and for windows that adapt."""


def measured(count: int, rate: float, repeat: int) -> dict[str, Any]:
    """Return the window and the costs."""
    x = np.sin(rate * np.arange(count)) + 0.1 * np.random.default_rng(20).standard_normal(count)
    plain, adapting = algdiff.suggest(x), algdiff.suggest(x, local=True)
    design = plain.differentiator
    middle = slice(design.window_length, count - design.window_length)
    if not np.array_equal(plain(x)[middle], design(x)[middle]):
        raise SystemExit("a suggestion is not its design in the middle")
    calls: dict[str, Callable[[], object]] = {
        "pass": partial(design, x, threads=1),
        "choice": partial(algdiff.suggest, x),
        "adapting": partial(adapting, x, threads=1),
    }
    best = best_of(calls, repeat, unit="pass")
    return {"count": count, "window": design.window_length, "degree": design.degree, **best}


def main() -> None:
    """Print the costs."""
    one_thread()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=9, help="rounds, of which the best counts")
    parser.add_argument("--json", type=Path, help="where all figures go")
    options = parser.parse_args()
    found = [measured(count, rate, options.repeat) for count in COUNTS for rate in RATES]
    rows = [
        [
            f"{one['count']:,}",
            one["window"],
            figure(1e3 * one["pass"]),
            figure(1e3 * one["choice"]),
            figure(one["choice"] / one["pass"]),
            figure(one["adapting"] / one["pass"]),
        ]
        for one in found
    ]
    print(table(["samples", "window", "a pass, ms", "choice, ms", "choice, passes", "`local=True`, passes"], rows))
    print(f"\nAt 10^6 samples at most {AT_MOST:g} passes for the choice, {AT_MOST_LOCAL:g} for windows that adapt.")
    if options.json:
        options.json.write_text(json.dumps({"machine": machine(), "costs": found}, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
