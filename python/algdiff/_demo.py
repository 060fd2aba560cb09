"""The shipped pendulum recording, differentiated by a chosen window and a given one, and held against its equation."""

from __future__ import annotations

import time
import warnings
from importlib import import_module
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

from algdiff import Differentiator, _output, suggest

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType

    from algdiff import Suggestion
    from algdiff._arguments import Samples

WINDOW_LENGTH = 1601
DEGREE = 5
RELEASE = 2047
"""Samples before the pendulum swings freely."""
NAMES = ("angle", "velocity", "acceleration")
UNITS = ("rad", "rad/s", "rad/s^2")
SOUND = 1e-9
"""A sum of weights this close to what it must be has lost no digits that matter."""
SHOWN = (0.0, 7.0)
ZOOM = (1.09, 1.17)


class Estimates(NamedTuple):
    """Angle, velocity and acceleration, and the seconds they took."""

    angle: Samples
    velocity: Samples
    acceleration: Samples
    seconds: float


class Law(NamedTuple):
    """Least-squares fit of ``acceleration = a sin(angle) - b velocity``."""

    a: float
    b: float
    r2: float

    def acceleration(self, angle: Samples, velocity: Samples) -> Samples:
        """Return what the equation gives."""
        import numpy as np

        return self.a * np.sin(angle) - self.b * velocity


def run(folder: Path, threads: int | None = None) -> None:
    """Differentiate the recording, print a report and write the arrays and a figure to `folder`.

    Parameters
    ----------
    folder : Path
        Created if it does not exist; ``pendulum.npz``, ``pendulum.png`` and ``choice.png`` in it are replaced.
    threads : int, optional
        As in `algdiff.differentiate`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    theta, delta = recording()
    print("Free swing of a pendulum, read by an encoder of 40,000 counts per revolution.")
    print(f"samples      {len(theta):,} at {delta:g} s", end="\n\n")
    suggestion, chosen, seconds = choose(theta, delta, threads)
    print(_chosen(suggestion, fit(chosen), seconds, chosen.seconds), end="\n\n")
    designs, ours = estimate(theta, delta, threads)
    law = fit(ours)
    used = "all threads of the process" if threads is None else f"threads: {threads}"
    print(_report(designs, ours, law, used))
    print(_apart(chosen, ours), end="\n\n")
    scipy = _optional("scipy.signal")
    if scipy is None:
        print("SciPy is not installed, so there is nothing to compare with (pip install scipy).")
    else:
        print(_comparison(scipy, theta, delta, ours, law))
    print()
    _save(folder / "pendulum.npz", theta, delta, ours)
    _draw(folder / "pendulum.png", theta, delta, ours, law)
    _draw_choice(folder / "choice.png", suggestion)


def recording() -> tuple[Samples, float]:
    """Return the angle in rad as the encoder saw it, and the sampling step in seconds."""
    import numpy as np

    with (files("algdiff") / "data" / "pendulum_encoder.npz").open("rb") as file, np.load(file) as data:
        return data["counts"] * (2 * np.pi / int(data["counts_per_revolution"])), float(data["dt"])


def choose(theta: Samples, delta: float, threads: int | None = None) -> tuple[Suggestion, Estimates, float]:
    """Return what is chosen for the acceleration, the estimates of that window, and the seconds that choosing took."""
    started = time.perf_counter()
    suggestion = suggest(theta, 2, delta=delta)
    found = time.perf_counter()
    designs = [suggestion.differentiator.replace(deriv=n) for n in range(3)]
    angle, velocity, acceleration = (design(theta, threads=threads) for design in designs)
    return suggestion, Estimates(angle, velocity, acceleration, time.perf_counter() - found), found - started


def estimate(theta: Samples, delta: float, threads: int | None = None) -> tuple[list[Differentiator], Estimates]:
    """Return the three designs and their estimates, all of one window and one degree."""
    started = time.perf_counter()
    designs = [Differentiator(WINDOW_LENGTH, n, degree=DEGREE, kappa=0, mu=0, delta=delta) for n in range(3)]
    angle, velocity, acceleration = (design(theta, threads=threads) for design in designs)
    return designs, Estimates(angle, velocity, acceleration, time.perf_counter() - started)


def fit(estimates: Estimates) -> Law:
    """Fit the equation of the pendulum to the free swing, one window away from the end."""
    import numpy as np

    angle, velocity, acceleration = (array[RELEASE:-WINDOW_LENGTH] for array in estimates[:3])
    a, b = np.linalg.lstsq(np.stack((np.sin(angle), -velocity), axis=1), acceleration, rcond=None)[0]
    law = Law(float(a), float(b), 0.0)
    return law._replace(r2=_r2(acceleration, law.acceleration(angle, velocity)))


def _r2(measured: Samples, explained: Samples) -> float:
    return 1.0 - float(((measured - explained) ** 2).sum() / ((measured - measured.mean()) ** 2).sum())


def _chosen(suggestion: Suggestion, law: Law, choosing: float, estimating: float) -> str:
    return "\n".join(
        (
            "The window that algdiff.suggest chooses for the acceleration, from the samples and their step alone:",
            *(f"  {line}" for line in suggestion.explain().splitlines()),
            "equation     acceleration = a sin(angle) - b velocity, by least squares, all three of that window:",
            f"  {_fitted(law)}",
            f"time         {choosing:.3f} s for the choice, {estimating:.3f} s for three estimates",
        )
    )


def _fitted(law: Law) -> str:
    return f"a = {law.a:.3f} 1/s^2, b = {law.b:.4f} 1/s, R^2 = {law.r2:.5f}"


def _report(designs: list[Differentiator], ours: Estimates, law: Law, threads: str) -> str:
    first = designs[0]
    return "\n".join(
        (
            "A window that is given, of equal weights as SciPy's:",
            f"window       {WINDOW_LENGTH} samples, {WINDOW_LENGTH * first.delta:g} s; degree {DEGREE}, kappa = mu = 0",
            f"delay        {first.delay_samples:g} samples, {first.delay:g} s",
            "noise gain   variance of the estimate per variance of white noise:",
            *(f"  {name:<13}{d.noise_gain:.4g}" for name, d in zip(NAMES, designs, strict=True)),
            "equation     acceleration = a sin(angle) - b velocity, by least squares:",
            f"  {_fitted(law)}",
            f"time         {ours.seconds:.3f} s for three designs and three estimates ({threads})",
        )
    )


def _apart(chosen: Estimates, ours: Estimates) -> str:
    import numpy as np

    apart = (chosen.acceleration - ours.acceleration)[RELEASE:-WINDOW_LENGTH]
    return (
        f"apart        {np.sqrt(np.square(apart).mean()):.3g} rad/s^2 from the acceleration by the chosen window (rms)"
    )


def _comparison(scipy: ModuleType, theta: Samples, delta: float, ours: Estimates, law: Law) -> str:
    """Say what ``savgol_filter`` makes of the same recording, from the measured numbers alone."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        theirs = _savgol(scipy, theta, delta)
        total = float(scipy.savgol_coeffs(WINDOW_LENGTH, DEGREE).sum())
    own = fit(theirs)
    free = slice(RELEASE, -WINDOW_LENGTH)
    cross = _r2(theirs.acceleration[free], law.acceleration(ours.angle[free], ours.velocity[free]))
    rows = zip(NAMES, UNITS, ours[:3], theirs[:3], strict=True)
    lines = [
        f"The same through savgol_filter of SciPy {import_module('scipy').__version__}:",
        f"time         {theirs.seconds:.3f} s on one thread, {theirs.seconds / ours.seconds:.1f} times that of algdiff",
        *(f"{n:<13}mean {b[free].mean():.4g} {u}; algdiff {a[free].mean():.4g} {u}" for n, u, a, b in rows),
        f"weights      those of the angle miss the sum of 1 by {abs(total - 1.0):.1e}",
        f"R^2          {cross:.5g} of its acceleration against the equation above",
        f"             {own.r2:.5f} against an equation refitted to its own estimates, with a = {own.a:.4g}",
    ]
    if abs(total - 1.0) < SOUND and cross > 0.9:
        return "\n".join([*lines, "SciPy's estimates are sound at this window and degree."])
    lines.append(f"SciPy's coefficients {'have lost digits' if cross > 0.9 else 'are garbage'} here: {_rank()}.")
    lines.append("No warning was given." if not caught else f"Its warning: {caught[0].message}")
    if own.r2 > 0.9 > cross:
        lines.append("The refitted R^2 is no comfort: garbage proportional to garbage, as its a shows.")
    return "\n".join(lines)


def _rank() -> str:
    import numpy as np

    offsets = np.arange(WINDOW_LENGTH, dtype=float) - WINDOW_LENGTH // 2
    rank = int(np.linalg.matrix_rank(np.vander(offsets, DEGREE + 1, increasing=True)))
    return f"in float64 its matrix of powers has rank {rank} instead of {DEGREE + 1}"


def _savgol(scipy: ModuleType, theta: Samples, delta: float) -> Estimates:
    started = time.perf_counter()
    angle, velocity, acceleration = (
        scipy.savgol_filter(theta, WINDOW_LENGTH, DEGREE, deriv=n, delta=delta) for n in range(3)
    )
    return Estimates(angle, velocity, acceleration, time.perf_counter() - started)


def _save(path: Path, theta: Samples, delta: float, ours: Estimates) -> None:
    import numpy as np

    arrays: dict[str, Any] = {"t": delta * np.arange(len(theta)), "theta": theta}
    arrays.update(zip(NAMES, ours[:3], strict=True))
    with _output.replacing(path, overwrite=True) as file:
        np.savez(file, **arrays)
    print(f"wrote {path} ({', '.join(arrays)})")


def _draw(path: Path, theta: Samples, delta: float, ours: Estimates, law: Law) -> None:
    figures = _optional("matplotlib.figure")
    if figures is None:
        print("no figure: matplotlib is not installed (pip install matplotlib)")
        return
    import numpy as np

    figure = figures.Figure(figsize=(11, 7.5), layout="constrained")
    grid = figure.subplots(3, 2, sharex="col", width_ratios=(2, 1))
    t = delta * np.arange(len(theta))
    equation = law.acceleration(ours.angle, ours.velocity)
    for column, (start, stop) in enumerate((SHOWN, ZOOM)):
        kept = slice(int(start / delta), int(stop / delta))
        grid[0, column].plot(t[kept], theta[kept], color="0.6", drawstyle="steps-post", label="encoder")
        for axes, values in zip(grid[:, column], ours[:3], strict=True):
            axes.plot(t[kept], values[kept], color="C0", label="algdiff")
            axes.grid(alpha=0.3)
        label = rf"{law.a:.2f} sin $\theta$ $-$ {law.b:.3f} $\dot\theta$"
        grid[2, column].plot(t[kept], equation[kept], color="C3", linewidth=1, linestyle="--", label=label)
        grid[2, column].set(xlabel="time, s", xlim=(start, stop))
    for row, name, unit in zip(grid, NAMES, UNITS, strict=True):
        row[0].set_ylabel(f"{name}, {unit.replace('^2', '²')}")
        row[0].axvspan(*ZOOM, color="C1", alpha=0.25, linewidth=0)
        row[0].legend(loc="upper right", fontsize="small")
    figure.suptitle(f"Pendulum, window {WINDOW_LENGTH} samples ({WINDOW_LENGTH * delta:g} s), degree {DEGREE}")
    with _output.replacing(path, overwrite=True) as file:
        figure.savefig(file, format="png", dpi=130)
    print(f"wrote {path}")


def _draw_choice(path: Path, suggestion: Suggestion) -> None:
    figures = _optional("matplotlib.figure")
    if figures is None:
        return
    figure = figures.Figure(figsize=(8, 5), layout="constrained")
    axes = suggestion.plot(figure.add_subplot())
    axes.set(title="Acceleration of the pendulum, by window and degree", ylabel="estimated error, rad/s²")
    with _output.replacing(path, overwrite=True) as file:
        figure.savefig(file, format="png", dpi=130)
    print(f"wrote {path}")


def _optional(name: str) -> ModuleType | None:
    try:
        return import_module(name)
    except ImportError:
        return None
