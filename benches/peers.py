"""Speed against the peers: nanoseconds per sample on one thread, timed only where the results agree.

All differentiate once with degree 3 and kappa = mu = 0, which is the Savitzky-Golay filter. Run
``python benches/peers.py --help`` for the options. `algdiff` and ``savgol_filter`` give the full length; ``convolve``
and ``oaconvolve`` get the finished weights and give the interior only. ``copyto`` is the floor: it only moves the data.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy import signal

import algdiff

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

DERIV, DEGREE = 1, 3
EPS = float(np.finfo(float).eps)
DESIGN: dict[str, Any] = {"degree": DEGREE, "kappa": 0.0, "mu": 0.0}
COPY, OURS = "np.copyto", "algdiff.differentiate"


class Peer(NamedTuple):
    """One way to the same estimates; `bound` is what its largest difference to algdiff may be, None for no check."""

    name: str
    call: Callable[[], NDArray[np.float64] | None]
    bound: float | None


def peers(x: NDArray[np.float64], out: NDArray[np.float64], window_length: int) -> list[Peer]:
    """Return what is timed for one window, with bounds for rounding alone.

    A sum of L products is off by at most L eps sum|w| max|x|. A transform of length N, here at most 16 L, adds
    eps log2(N) sqrt(N) times the 2-norm of w and max|x|. SciPy solves for its coefficients with a matrix of powers,
    whose condition number multiplies eps; at the ends it fits the first and the last window, where the weights are
    those of the newest sample.
    """
    weights = algdiff.Differentiator(window_length, DERIV, **DESIGN).weights
    newest = algdiff.Differentiator(window_length, DERIV, tau="newest", **DESIGN).weights
    top = float(np.abs(x).max())
    direct = 4 * EPS * window_length * float(np.abs(weights).sum()) * top
    transform = 16 * window_length
    fft = 4 * EPS * np.log2(transform) * np.sqrt(transform) * float(np.linalg.norm(weights)) * top + direct
    powers = np.vander(np.arange(window_length) - window_length // 2, DEGREE + 1).astype(float)
    solve = 4 * EPS * (window_length + float(np.linalg.cond(powers))) * float(np.abs(newest).sum()) * top
    kernel = weights[::-1].copy()
    ours = partial(algdiff.differentiate, x, window_length, DERIV, threads=1, mode="fit", **DESIGN)
    return [
        Peer(COPY, partial(np.copyto, out, x), None),
        Peer("np.convolve", partial(np.convolve, x, kernel, "valid"), direct),
        Peer("savgol_filter", partial(signal.savgol_filter, x, window_length, DEGREE, DERIV, mode="interp"), solve),
        Peer("oaconvolve", partial(signal.oaconvolve, x, kernel, "valid"), float(fft)),
        Peer(OURS, partial(ours, out=out), 0.0),
        Peer("the same, no out", ours, 0.0),
    ]


def disagreement(result: NDArray[np.float64], ours: NDArray[np.float64]) -> float:
    """Return the largest difference; a shorter result is compared with the interior."""
    cut = (len(ours) - len(result)) // 2
    return float(np.abs(result - ours[cut : len(ours) - cut]).max())


def measure(x: NDArray[np.float64], window_length: int, repeat: int) -> dict[str, dict[str, float | None]]:
    """Check, then time the peers in turn, `repeat` times; keep the best of each."""
    out = np.empty_like(x)
    lined_up = peers(x, out, window_length)
    ours = algdiff.differentiate(x, window_length, DERIV, threads=1, **DESIGN)
    figures: dict[str, dict[str, float | None]] = {}
    for peer in lined_up:
        result = peer.call()
        off = None if result is None or peer.bound is None else disagreement(result, ours)
        figures[peer.name] = {"difference": off, "bound": peer.bound, "ns_per_sample": None}
    agreeing = [peer for peer in lined_up if _agrees(figures[peer.name])]
    best = dict.fromkeys((peer.name for peer in agreeing), float("inf"))
    for _ in range(repeat):
        for peer in agreeing:
            started = time.perf_counter()
            peer.call()
            best[peer.name] = min(best[peer.name], time.perf_counter() - started)
    for name, seconds in best.items():
        figures[name]["ns_per_sample"] = 1e9 * seconds / len(x)
    return figures


def _agrees(figure: dict[str, float | None]) -> bool:
    off, bound = figure["difference"], figure["bound"]
    return bound is None or (off is not None and off <= bound)


def table(window_length: int, figures: dict[str, dict[str, float | None]]) -> str:
    """Return the figures of one window as text."""
    ours, copy = (figures[name]["ns_per_sample"] for name in (OURS, COPY))
    lines = [f"window {window_length}", f"  {'':<22}{'ns/sample':>10}{'copies':>9}{'algdiff':>16}   difference (bound)"]
    for name, figure in figures.items():
        speed, off, bound = figure["ns_per_sample"], figure["difference"], figure["bound"]
        check = "" if off is None else f"{off:.1e} ({bound:.1e})"
        if speed is None:
            lines.append(f"  {name:<22}not timed: it does not agree, {check}")
            continue
        copies = f"{speed / copy:.1f}" if copy else ""
        faster = f"{speed / ours:.2f} x faster" if ours and name not in (OURS, COPY) else ""
        lines.append(f"  {name:<22}{speed:>10.3f}{copies:>9}{faster:>16}   {check}")
    return "\n".join(lines)


def machine() -> dict[str, str]:
    """Return the versions and the model of the processor."""
    names = {"numpy": "numpy", "scipy": "scipy", "algdiff": "algdiff-rs"}
    found = {name: version(distribution) for name, distribution in names.items()}
    return {"python": platform.python_version(), **found, "processor": _processor()}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if a peer disagreed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--samples", type=int, default=10**7, metavar="N", help="default: %(default)s")
    parser.add_argument("--windows", type=int, nargs="+", default=[11, 61, 111, 501, 1001], metavar="N")
    parser.add_argument("--repeat", type=int, default=5, metavar="N", help="best of this many; default: %(default)s")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here as well")
    options = parser.parse_args(argv)
    rng = np.random.default_rng(20)
    x = np.sin(1e-3 * np.arange(options.samples)) + 0.1 * rng.standard_normal(options.samples)
    header = machine()
    print(", ".join(f"{name} {value}" for name, value in header.items()))
    print(f"{options.samples:,} float64 samples, one thread, best of {options.repeat} interleaved repeats")
    windows = {}
    for window_length in options.windows:
        windows[window_length] = measure(x, window_length, options.repeat)
        print(table(window_length, windows[window_length]), flush=True)
    if options.json is not None:
        content = {**header, "samples": options.samples, "repeat": options.repeat, "windows": windows}
        options.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return int(not all(_agrees(figure) for figures in windows.values() for figure in figures.values()))


if __name__ == "__main__":
    sys.exit(main())
