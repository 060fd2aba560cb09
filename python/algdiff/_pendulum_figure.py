"""Figure 5 of Mboup, Join and Fliess (2007), and a table of what the loops in it err by."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from algdiff import Stream, _demo, _output
from algdiff import _pendulum as loop

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from algdiff._arguments import Samples

SEEDS = range(20)
DEVIATIONS = (0.01, 0.1)
"""The source's N(0; 0.01), read as the standard deviation and as the variance, in rad."""
CASES = tuple(product(loop.REFERENCES, DEVIATIONS))
SHOWN = ("S2", 0.01)
OFF_LINE = (("root", loop.ROOT), ("center", loop.CENTRE))
ROWS = (
    "tracking, rms, rad",
    "tracking, largest, rad",
    "u, rms, V",
    "on-line y', rad/s",
    "on-line theta_m, rad",
    "off-line y', root",
    "off-line theta_m, root",
    "off-line y', centre",
    "off-line theta_m, centre",
    "loops that failed",
)
NUMBERS = (4, 3, 2, 3, 3, 4, 4, 4, 4)
"""Decimals of the rows."""


def run(folder: Path, threads: int | None = None) -> None:
    """Simulate, print the table and write the curves and the figure to `folder`.

    Parameters
    ----------
    folder : Path
        Created if it does not exist; ``pendulum-loop.npz`` and ``pendulum-loop.png`` in it are replaced.
    threads : int, optional
        As in `algdiff.differentiate`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    print(f"{len(CASES) * len(SEEDS)} loops for {loop.TIMES[-1]:g} s, now at", end="", flush=True)
    done = simulate(threads, lambda seconds: print(f" {seconds:g}", end="", flush=True))
    print(" s", end="\n\n")
    past = {tau: loop.off_line(done, windows, tau, threads) for tau, windows in OFF_LINE}
    print(_report(done, past), end="\n\n")
    shown = _shown(done, past["root"])
    _save(folder / "pendulum-loop.npz", shown)
    _draw(folder / "pendulum-loop.png", shown)


def simulate(threads: int | None = None, progress: Any = None) -> loop.Run:
    """Return the loops of all cases, one stream for all, a case's seeds side by side."""
    count = len(SEEDS)
    heights = np.repeat([loop.REFERENCES[name] for name, _ in CASES], count)
    noise = np.concatenate([loop.noises(SEEDS, deviation) for _, deviation in CASES], axis=1)
    stream = Stream(loop.designs(), channels=count * len(CASES), threads=threads)
    return loop.simulate(stream, loop.reference(1.0)[..., None] * heights, noise, progress=progress)


def _windows(windows: Sequence[tuple[float, int]]) -> str:
    return ", ".join(f"{window:g}" for window, _ in windows)


def _of(case: tuple[str, float]) -> slice:
    first = CASES.index(case) * len(SEEDS)
    return slice(first, first + len(SEEDS))


def _report(done: loop.Run, past: dict[str, Samples]) -> str:
    found = loop.errors(done)
    rows = [found.tracking, found.largest, found.u, found.velocity, found.motor]
    for estimates in past.values():
        rows.extend(loop.off_line_errors(done, estimates))
    late = [", ".join(f"{d.delay:.3f}" for d in loop.designs(windows, tau)) for tau, windows in OFF_LINE]
    lines = [
        "Motor, spring and inverted pendulum of Mboup, Join and Fliess (2007), Section IV: feedback from on-line",
        f"estimates of y, y', y'' and y''' without delay, windows {_windows(loop.ON_LINE)} s, at {loop.DELTA:g} s.",
        f"Off-line windows of y, y', y'': root {_windows(loop.ROOT)} s, {late[0]} s late;",
        f"centre {_windows(loop.CENTRE)} s, {late[1]} s late.",
        f"Root mean squares from {loop.SETTLED:g} s on, mean +- standard deviation of seeds {SEEDS[0]} to {SEEDS[-1]}.",
        "",
        f"{'reference, noise in rad':26}" + "".join(f"{f'{name}, {deviation:g}':>22}" for name, deviation in CASES),
    ]
    for name, digits, values in zip(ROWS, NUMBERS, rows, strict=False):
        cells = [values[_of(case)] for case in CASES]
        texts = [f"{cell.mean():.{digits}f} +- {cell.std():.{digits}f}" for cell in cells]
        lines.append(f"{name:26}" + "".join(f"{text:>22}" for text in texts))
    lines.append(f"{ROWS[-1]:26}" + "".join(f"{found.failed[_of(case)].sum():22d}" for case in CASES))
    return "\n".join(lines)


def _shown(done: loop.Run, past: Samples) -> dict[str, Samples]:
    """Return the curves of the figure: the first seed of one case."""
    index = _of(SHOWN).start
    y, estimates = done.y[..., index], done.estimates[..., index]
    return {
        "t": loop.TIMES,
        "reference": done.reference[0, :, index],
        "u": done.u[:, index],
        "noise": done.noise[:, index],
        "y": y[0],
        "velocity": y[1],
        "motor": done.motor[:, index],
        "on_line_y": estimates[0],
        "on_line_velocity": estimates[1],
        "on_line_motor": done.motor_estimate[:, index],
        "off_line_velocity": past[1, :, index],
        "off_line_motor": loop.BENCH.motor(past[..., index]),
    }


def _save(path: Path, shown: dict[str, Samples]) -> None:
    arrays: dict[str, Any] = dict(shown)
    with _output.replacing(path, overwrite=True) as file:
        np.savez(file, **arrays)
    print(f"wrote {path} ({', '.join(shown)})")


def _draw(path: Path, shown: dict[str, Samples]) -> None:
    figures = _demo._optional("matplotlib.figure")
    if figures is None:
        print("no figure: matplotlib is not installed (pip install matplotlib)")
        return
    name, deviation = SHOWN
    _, velocity, acceleration = loop.designs(loop.ROOT, "root")
    panels = (
        ("(a) Output and reference trajectory (dashed)", "rad", "y", "reference"),
        ("(b) Control", "V", "u", None),
        ("(c) Output noise", "rad", "noise", None),
        (r"(d) On-line estimation of $y$, and $y$ (dashed)", "rad", "on_line_y", "y"),
        (r"(e) On-line estimation of $y'$, and $y'$ (dashed)", "rad/s", "on_line_velocity", "velocity"),
        (r"(f) On-line estimation of $\theta_m$, and $\theta_m$ (dashed)", "rad", "on_line_motor", "motor"),
        (
            rf"(g) Off-line, {velocity.delay:.2f} s late: $y'$ estimated and true (dashed)",
            "rad/s",
            "off_line_velocity",
            "velocity",
        ),
        (
            rf"(h) Off-line, {acceleration.delay:.2f} s late: $\theta_m$ estimated and true (dashed)",
            "rad",
            "off_line_motor",
            "motor",
        ),
    )
    figure = figures.Figure(figsize=(11, 10), layout="constrained")
    grid = figure.subplots(4, 2, sharex=True)
    for axes, (title, unit, solid, dashed) in zip(grid.flat, panels, strict=True):
        axes.plot(loop.TIMES, shown[solid], "C0", linewidth=0.8)
        if dashed:
            axes.plot(loop.TIMES, shown[dashed], "C3--", linewidth=1.2)
        axes.set_title(title)
        axes.set_ylabel(unit)
        axes.grid(alpha=0.3)
        axes.set_xlim(0, loop.TIMES[-1])
    for axes, other in zip(grid[3], grid[2], strict=True):
        axes.set_ylim(other.get_ylim())
    for axes in grid[-1]:
        axes.set_xlabel("time, s")
    figure.suptitle(f"Reference {name}: upright and back; white noise of {deviation:g} rad on the output")
    with _output.replacing(path, overwrite=True) as file:
        figure.savefig(file, format="png", dpi=80)
    print(f"wrote {path}")
