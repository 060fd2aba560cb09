"""Figures 1 to 4 of Mboup, Join and Fliess (2007), and a table of what the curves in them err by."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from algdiff import Differentiator, _demo, _output

if TYPE_CHECKING:
    from pathlib import Path

    from algdiff._arguments import Samples

DELTA = 0.005
"""The paper does not state its sampling step; at this one its remarks on the figures hold."""
TIMES = DELTA * np.arange(1001)
DECIBELS = 25.0
SEEDS = range(10)
OFFSET = 100.0
RULES = ("trapezoid", "exact")
"""The paper's rule and ours."""


class Estimates(NamedTuple):
    """What one curve shows: at the paper's time stamps, the estimates and the true derivative shifted by the delay."""

    stamps: Samples
    values: Samples
    truth: Samples

    def rmse(self) -> float:
        """Return the root mean square error of every row, averaged over the rows."""
        return float(np.sqrt(((self.values - self.truth) ** 2).mean(axis=-1)).mean())


class Curve(NamedTuple):
    """One estimator of the paper's Section III.

    The window covers T = `steps` sampling steps. The paper gives its time as that of the first sample if it looks
    `ahead`, of the last if not.
    """

    key: str
    label: str
    steps: int
    degree: int
    exponent: float
    tau: str
    ahead: bool = False

    def design(self, rule: str) -> Differentiator:
        """Return the estimator by a rule: under both on the same ``steps + 1`` samples."""
        exponents: dict[str, Any] = {"kappa": self.exponent, "mu": self.exponent}
        return Differentiator(self.steps + 1, 1, degree=self.degree, tau=self.tau, delta=DELTA, rule=rule, **exponents)

    def estimate(self, y: Samples, rule: str, threads: int | None = None) -> Estimates:
        """Differentiate `y`, sampled at `TIMES` along its last axis, wherever the window is full."""
        design = self.design(rule)
        newest = TIMES[self.steps :]
        stamps = TIMES[: -self.steps] if self.ahead else newest
        return Estimates(stamps, design(y, mode="valid", threads=threads), slope(newest - design.delay))


CURVES = (
    Curve("fig2", "Fig. 2         N = 1", 60, 1, 2.0, "root", ahead=True),
    Curve("fig3", "Fig. 3         N = 2, no delay", 110, 2, 0.0, "newest"),
    Curve("fig4_solid", "Fig. 4 solid   N = 2, tau_1", 110, 2, 0.0, "root"),
    Curve("fig4_dashed", "Fig. 4 dashed  N = 3, tau_2 = 1/2", 110, 3, 0.0, "center"),
)


def signal(t: Samples) -> Samples:
    """Return x(t) of the paper's Section III."""
    x: Samples = np.tanh(t - 1) + np.exp(-t / 1.2) * np.sin(6 * t + np.pi)
    return x


def slope(t: Samples) -> Samples:
    """Return the true derivative of `signal`."""
    swing = 6 * np.cos(6 * t + np.pi) - np.sin(6 * t + np.pi) / 1.2
    derivative: Samples = np.cosh(t - 1) ** -2.0 + np.exp(-t / 1.2) * swing
    return derivative


def observe(seed: int) -> Samples:
    """Return the signal in white noise, at a signal-to-noise ratio of exactly 25 dB as the paper defines it.

    Its definition has the noisy signal in the numerator: ``sum(y**2) = ratio * sum(noise**2)``, a quadratic equation
    for the scale of the noise.
    """
    x, noise = signal(TIMES), np.random.default_rng(seed).standard_normal(TIMES.size)
    a, b, c = (10 ** (DECIBELS / 10) - 1) * (noise @ noise), x @ noise, x @ x
    y: Samples = x + (b + np.sqrt(b * b + a * c)) / a * noise
    return y


def run(folder: Path, threads: int | None = None) -> None:
    """Print the table and write the arrays and the figure to `folder`.

    Parameters
    ----------
    folder : Path
        Created if it does not exist; ``figures.npz`` and ``figures.png`` in it are replaced.
    threads : int, optional
        As in `algdiff.differentiate`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    print(_report(threads), end="\n\n")
    y = observe(SEEDS[0])
    shown = {(curve.key, rule): curve.estimate(y, rule, threads) for curve in CURVES for rule in RULES}
    _save(folder / "figures.npz", y, shown)
    _draw(folder / "figures.png", y, [shown[curve.key, "trapezoid"] for curve in CURVES])


def errors(threads: int | None = None) -> Samples:
    """Return what the curves err by: axes of curves, of signals (noisy, noise-free, with offset) and of rules."""
    noisy = np.stack([observe(seed) for seed in SEEDS])
    signals = (noisy, signal(TIMES), noisy + OFFSET)
    return np.array(
        [[[curve.estimate(y, rule, threads).rmse() for rule in RULES] for y in signals] for curve in CURVES]
    )


def _report(threads: int | None) -> str:
    groups = ("delay, ms", "RMSE, 25 dB", "RMSE, no noise", f"RMSE, y + {OFFSET:g}")
    lines = [
        "Derivative of x(t) = tanh(t-1) + exp(-t/1.2) sin(6t+pi) by the estimators of Mboup, Join and Fliess (2007).",
        f"{TIMES.size} samples at {DELTA:g} s. Errors of the estimates of all full windows against the true derivative",
        f"at the predicted delay; with noise at {DECIBELS:g} dB, the mean over seeds {SEEDS[0]} to {SEEDS[-1]}.",
        "",
        f"{'':36}" + "".join(f"{group:>20}" for group in groups),
        f"{'curve':36}" + "".join(f"{rule:>10}" for rule in RULES) * len(groups),
    ]
    for curve, row in zip(CURVES, errors(threads), strict=True):
        delays = "".join(f"{1000 * curve.design(rule).delay:10.1f}" for rule in RULES)
        lines.append(f"{curve.label:36}{delays}" + "".join(f"{error:10.4f}" for error in row.flat))
    return "\n".join(lines)


def _save(path: Path, y: Samples, shown: dict[tuple[str, str], Estimates]) -> None:
    arrays: dict[str, Any] = {"t": TIMES, "x": signal(TIMES), "y": y}
    for (key, rule), estimates in shown.items():
        for name, array in zip(("t", "estimate", "truth"), estimates, strict=True):
            arrays[f"{key}_{rule}_{name}"] = array
    with _output.replacing(path, overwrite=True) as file:
        np.savez(file, **arrays)
    print(f"wrote {path} (t, x, y; t, estimate and truth of every curve by both rules)")


def _draw(path: Path, y: Samples, curves: list[Estimates]) -> None:
    figures = _demo._optional("matplotlib.figure")
    if figures is None:
        print("no figure: matplotlib is not installed (pip install matplotlib)")
        return
    figure = figures.Figure(figsize=(11, 7.5), layout="constrained")
    (first, second), (third, fourth) = figure.subplots(2, 2, sharex=True)
    first.plot(TIMES, y, color="C0", linewidth=0.8)
    first.set_title("Fig. 1: noisy observation, 25 dB")
    fig2, fig3, solid, dashed = curves
    for axes, curve, shift, title in (
        (second, fig2, ", shifted", r"Fig. 2: $N = 1$, $\kappa = \mu = 2$, $T = 60\,T_s$, windows $[t, t+T]$"),
        (third, fig3, "", r"Fig. 3: $N = 2$, no delay, $\kappa = \mu = 0$, $T = 110\,T_s$"),
    ):
        axes.plot(curve.stamps, curve.values, color="C0", label="estimate")
        axes.plot(curve.stamps, curve.truth, color="C3", linestyle="--", label=f"true derivative{shift}")
        axes.set_title(title)
    for curve, name, style in ((solid, r"$N = 2$, $\tau_1$", "C0-"), (dashed, r"$N = 3$, $\tau_2 = 1/2$", "C2--")):
        fourth.plot(curve.stamps, curve.values, style, label=name)
        fourth.plot(curve.stamps, curve.truth, "C3:", label=f"true derivative, shifted for {name}")
    fourth.set_title(r"Fig. 4: with delay, $\kappa = \mu = 0$, $T = 110\,T_s$")
    for axes in (second, third, fourth):
        axes.legend(loc="upper right", fontsize="small")
    for axes in (first, second, third, fourth):
        axes.grid(alpha=0.3)
        axes.set_xlim(0, TIMES[-1])
    for axes in (third, fourth):
        axes.set_xlabel("time, s")
    with _output.replacing(path, overwrite=True) as file:
        figure.savefig(file, format="png", dpi=90)
    print(f"wrote {path}")
