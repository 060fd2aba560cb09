"""Speed against the targets and the peers: nanoseconds per sample on one thread, timed only where the results agree.

All differentiate once with degree 3 and kappa = mu = 0, which is the Savitzky-Golay filter. `algdiff` and
``savgol_filter`` give the full length, ``convolve1d`` too, with ends that mean nothing; the others get the finished
weights and give the interior only. ``copyto`` is the floor and the unit of the targets: it only moves the data. Slow
peers are timed on fewer samples, and said to be.
"""

from __future__ import annotations

import argparse
import json
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import algdiff
import targets
from common import COPY, ENGINES, EPS, SAVGOL, best_of, chosen, estimator, figure, machine, one_thread, signal, table
from rivals import Peer, moving_mean, peers

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Samples = NDArray[np.float64]

Entry = dict[str, Any]
OURS, FLOOR = "algdiff", "bottleneck.move_mean"
PER_TAP = 0.07  # nanoseconds per sample and tap of the direct engine, roughly
LOST = 1e-6  # of the size of the result: with a larger error, digits that matter are lost


def fewer(count: int, window_length: int, per_tap: float, seconds: float) -> int:
    """Return how many samples a call may take to last about this many seconds."""
    outputs = seconds * 1e9 / max(per_tap * window_length, 1e-9)
    return min(count, window_length + max(2000, int(outputs)))


def check_ours(ours: Samples, x: Samples, window_length: int) -> None:
    """Compare some of our estimates with the plain sum in long double, on which the weights' own rounding is all."""
    weights = algdiff.Differentiator(window_length, **SAVGOL).weights.astype(np.longdouble)
    top = float(np.abs(x).max())
    bound = 4 * EPS * (window_length + 1000) * float(np.abs(weights).sum()) * top
    for place in np.random.default_rng(0).integers(0, len(ours), 50):
        off = abs(float(x[place : place + window_length] @ weights - ours[place]))
        if not off <= bound:
            raise SystemExit(f"algdiff itself is wrong: window {window_length}, output {place}, by {off}")


def entry(peer: Peer, x: Samples, ours: Samples, window_length: int) -> Entry:
    """Run a peer once and compare it with ours: its largest difference, and why not to time it if that is too large."""
    result = peer.call(x)
    outputs = len(x) - window_length + 1
    interior = result if len(result) == outputs else result[window_length // 2 :][:outputs]
    off = float(np.abs(interior - ours[:outputs]).max())
    reason = None
    if not off <= peer.bound:
        reason = "it does not agree"
    elif off > LOST * float(np.std(ours)):
        reason = "it loses digits that matter"
    return {"samples": len(x), "outputs": len(result), "difference": off, "bound": peer.bound, "not_timed": reason}


def measure(x: Samples, out: Samples, window_length: int, options: argparse.Namespace) -> dict[str, Entry]:
    """Check, then time in turn: copying, the moving mean, our engines, the peers."""
    count, seconds = len(x), options.seconds
    automatic = chosen(window_length)
    ours_on = fewer(count, window_length, PER_TAP, 5 * seconds) if automatic == "direct" else count
    valid = estimator("auto", window_length, **SAVGOL)(x[:ours_on], mode="valid", threads=1)
    check_ours(valid, x, window_length)
    top = float(np.abs(x).max())
    entries: dict[str, Entry] = {COPY: {"samples": count, "outputs": count}}
    calls: dict[str, Callable[[], object]] = {COPY: partial(np.copyto, out, x)}
    mean = moving_mean(window_length)
    if mean is not None:
        entries[FLOOR], calls[FLOOR] = floor(mean, x, window_length), partial(mean, x)
    for peer in [*own(automatic, out, window_length, count, seconds, top), *peers(window_length, count, top)]:
        piece = x[: min(ours_on, fewer(count, window_length, peer.per_tap, seconds))]
        if peer.per_tap * window_length * len(piece) > 25e9 * seconds and not peer.name.startswith(OURS):
            entries[peer.name] = {"samples": 0, "not_timed": "too slow", "difference": None, "bound": None}
            continue
        try:
            entries[peer.name] = entry(peer, piece, valid, window_length)
        except ValueError as refusal:
            entries[peer.name] = {"samples": 0, "not_timed": str(refusal), "difference": None, "bound": None}
        calls[peer.name] = partial(peer.call, piece)
    calls = {name: call for name, call in calls.items() if not entries[name].get("not_timed")}
    for name, best in best_of(calls, options.repeat, 5 * seconds, COPY).items():
        # A result of whole windows has fewer outputs than samples: what counts is the cost of one.
        entries[name]["ns"] = 1e9 * best / entries[name]["outputs"]
    for found in entries.values():
        found["copies"] = found["ns"] / entries[COPY]["ns"] if "ns" in found else None
    entries[OURS]["engine"] = automatic
    return entries


def floor(mean: Callable[[Samples], Samples], x: Samples, window_length: int) -> Entry:
    """Check the moving mean against ours on some samples: a running sum of n terms drifts by up to n eps max|x|."""
    few = x[: min(len(x), window_length + 100_000)]
    smooth = estimator("auto", window_length, 0, degree=0, kappa=0.0, mu=0.0)
    check = Peer(FLOOR, lambda x: mean(x)[window_length - 1 :], EPS * 2 * len(few) * float(np.abs(x).max()))
    return entry(check, few, smooth(few, mode="valid"), window_length) | {"samples": len(x), "outputs": len(x)}


def own(automatic: str, out: Samples, window_length: int, count: int, seconds: float, top: float) -> list[Peer]:
    """Return our own calls, as users make them, into a given result; on few samples only the windows inside them."""
    norm1 = float(np.abs(algdiff.Differentiator(window_length, **SAVGOL).weights).sum())
    bound = 8 * EPS * (window_length + 1000) * norm1 * top
    found = []
    for name, engine in {OURS: "auto", **{f"algdiff {engine}": engine for engine in ENGINES}}.items():
        direct = (automatic if engine == "auto" else engine) == "direct"
        few = direct and fewer(count, window_length, PER_TAP, seconds) < count
        try:
            run = partial(estimator(engine, window_length, **SAVGOL), threads=1, mode="valid" if few else "fit")
        except ValueError as refusal:
            found.append(Peer(name, partial(_refused, refusal), bound, 0.0))
            continue
        halo = window_length - 1 if few else 0
        call = partial(_into, run, out, halo)
        found.append(Peer(name, call, bound, PER_TAP if direct else 0.0))
    return found


def _refused(refusal: ValueError, _x: Samples) -> Samples:
    raise refusal


def _into(run: Callable[..., Samples], out: Samples, halo: int, x: Samples) -> Samples:
    return run(x, out=out[: len(x) - halo])


def against_targets(windows: dict[int, dict[str, Entry]]) -> list[list[str]]:
    """Return the rows of the table of targets."""
    rows = []
    for window_length, entries in windows.items():
        found = entries[OURS]
        at_most, moonshot = targets.COPIES.get(window_length, (None, None))
        verdict = "" if at_most is None else "yes" if found["copies"] <= at_most else "no"
        times = [figure(found["ns"]), figure(found["copies"]), figure(at_most), figure(moonshot), verdict]
        rows.append([str(window_length), found["engine"], *times])
    return rows


def against_peers(windows: dict[int, dict[str, Entry]]) -> tuple[list[str], list[list[str]]]:
    """Return the table of everybody's copies, with how many times slower than ours; and notes on it."""
    names = [name for name in next(iter(windows.values())) if name not in (COPY, OURS)]
    rows = []
    for window_length, entries in windows.items():
        cells = []
        for name in names:
            found = entries.get(name, {})
            cell = "not timed" if found.get("copies") is None else figure(found["copies"])
            if found.get("copies") is not None and name != FLOOR and not name.startswith("algdiff"):
                cell += f" ({figure(found['copies'] / entries[OURS]['copies'])} x)"
            cells.append(cell)
        rows.append([str(window_length), figure(entries[OURS]["copies"]), *cells])
    return ["window", "algdiff", *names], rows


def notes(windows: dict[int, dict[str, Entry]], count: int) -> list[str]:
    """Say who was not timed and why, and who got fewer samples."""
    lines = []
    for window_length, entries in windows.items():
        for name, found in entries.items():
            if found.get("not_timed"):
                off, allowed = found["difference"], found["bound"]
                why = "" if off is None else f" (off by {off:.1e}, bound {allowed:.1e})"
                lines.append(f"- {name}, window {window_length}: not timed, {found['not_timed']}{why}")
            elif found["samples"] < count:
                lines.append(f"- {name}, window {window_length}: timed on {found['samples']:,} samples")
    return lines


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--samples", type=int, default=10**7, metavar="N", help="default: %(default)s")
    parser.add_argument("--windows", type=int, nargs="+", default=list(targets.COPIES), metavar="N")
    parser.add_argument("--repeat", type=int, default=5, metavar="N", help="best of this many; default: %(default)s")
    parser.add_argument(
        "--seconds", type=float, default=2.0, help="about how long one call may take; default: %(default)s"
    )
    parser.add_argument("--quick", action="store_true", help="under a minute: fewer samples and repeats")
    parser.add_argument("--no-lines", action="store_true", help="leave out the targets that are not window by window")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here as well")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the cost against the window")
    parser.add_argument("--strict", action="store_true", help="return 1 if a target is missed")
    options = parser.parse_args(argv)
    if options.quick:
        options.samples, options.repeat, options.seconds = min(options.samples, 10**6), 3, 0.15
    return options


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables; return 1 if a peer disagreed, or with --strict if a target is missed."""
    options = arguments(argv)
    header = machine("scipy", "bottleneck", "torch")
    print("\n".join(f"- {name}: {value}" for name, value in header.items()))
    print(
        f"- {options.samples:,} float64 samples, one thread, best of {options.repeat} interleaved repeats\n", flush=True
    )
    x = signal(options.samples)
    out = np.zeros_like(x)
    windows = {}
    for window_length in options.windows:
        windows[window_length] = measure(x, out, window_length, options)
        print(f"window {window_length} done", file=sys.stderr, flush=True)
    print(
        table(["window", "engine", "ns per sample", "copies", "at most", "moonshot", "met"], against_targets(windows))
    )
    print("\nCost in copies, and how many times that of algdiff:\n")
    print(table(*against_peers(windows)))
    print("\n" + "\n".join(notes(windows, options.samples)) + "\n", flush=True)
    lines = [] if options.no_lines else targets.lines(x, out, options)
    if lines:
        print(table(["target", "measured", "limit", "met"], [line.cells() for line in lines]))
    if options.json is not None:
        content = {**header, "samples": options.samples, "repeat": options.repeat}
        content |= {"windows": windows, "lines": [line._asdict() for line in lines]}
        options.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    if options.plot is not None:
        from picture import draw

        draw(windows, header, options.plot)
    wrong = [found for entries in windows.values() for found in entries.values()]
    if any(found.get("not_timed") == "it does not agree" for found in wrong):
        return 1
    missed = any(row[-1] == "no" for row in against_targets(windows)) or any(line.met() is False for line in lines)
    return int(options.strict and missed)


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
