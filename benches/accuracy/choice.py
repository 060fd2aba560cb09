"""How well windows are chosen: errors against those of the best member of the family, which knows the truth.

Sixteen signals, three levels of noise, three sampling rates, first and second derivatives. The oracle is the design of
the family (any window, any degree up to ``deriv + 7``, kappa = mu = 0 or 1) whose expected error over the whole length
is least: its bias is that on the signal without noise, its variance that of its weights. The error of a choice is the
root mean square over samples and seeds, ends included, over that of the oracle. A choice may be below 1, as its ends
are no member's.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import algdiff
from accuracy.signals import SIGNALS, Signal
from common import machine

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Samples = NDArray[np.float64]

COUNTS = (500, 2000, 8000)
LEVELS = (0.001, 0.01, 0.1)
DERIVS = (1, 2)
SEEDS = 30
RATIO = 1.15
"""From one window of the oracle to the next."""

TARGETS = {"median": 1.15, "90th percentile": 1.5, "worst": 2.5}
HONEST = 1.5
"""An estimated error is honest if it is within this factor of the true one."""


class Case(NamedTuple):
    """A signal, sampled, and the level of its noise."""

    signal: Signal
    count: int
    level: float
    deriv: int

    def sampled(self) -> tuple[Samples, Samples, float]:
        """Return samples, the true derivative and the sampling step."""
        t = np.linspace(0, self.signal.duration, self.count)
        values = self.signal.values(t)
        return values[0], values[self.deriv], float(t[1])

    def noise(self, x: Samples, seed: int) -> Samples:
        """Return noise of the level, relative to the signal's standard deviation if it has one."""
        words = [seed, self.count, self.deriv, int(1e4 * self.level), *map(ord, self.signal.name)]
        return self.level * (float(x.std()) or 1.0) * np.random.default_rng(words).standard_normal(self.count)

    @property
    def label(self) -> str:
        """What the case is called."""
        return f"{self.signal.name}, {self.count} samples, noise {self.level:g}, order {self.deriv}"


def cases(signals: list[Signal], counts: tuple[int, ...]) -> list[Case]:
    """Return all cases."""
    return [Case(s, n, level, deriv) for s in signals for n in counts for level in LEVELS for deriv in DERIVS]


@cache
def members(count: int, deriv: int) -> list[tuple[algdiff.Differentiator, float]]:
    """Return the members of the family for a sampling step of 1, and the mean variance of their estimates."""
    lengths, wanted = [], 3.0
    while wanted < count:
        lengths.append(2 * round((wanted - 1) / 2) + 1)
        wanted = max(wanted * RATIO, wanted + 2)
    lengths.append(count - 1 + count % 2)
    found = []
    for degree in range(deriv, deriv + 8):
        for length in lengths:
            for exponent in (0.0, 1.0) if degree < length and degree <= 2 * length**0.5 else ():
                one = algdiff.Differentiator(length, deriv, degree=degree, kappa=exponent, mu=exponent)
                # A row of two windows has all the ends there are; what is between them is the same.
                short = min(count, 2 * length + 1)
                gains = one(np.zeros(short), return_std=True, sigma=1.0).std ** 2
                total = gains.sum() + (count - short) * gains[short // 2]
                found.append((one, float(total) / count))
    return found


def oracle(case: Case) -> tuple[algdiff.Differentiator, float]:
    """Return the best member and its expected error."""
    x, truth, delta = case.sampled()
    scaled = truth * delta**case.deriv
    sigma = case.level * (float(x.std()) or 1.0)
    risks = [
        float(np.square(one(x) - scaled).mean()) + sigma**2 * gain for one, gain in members(case.count, case.deriv)
    ]
    best = int(np.argmin(risks))
    return members(case.count, case.deriv)[best][0], float(np.sqrt(risks[best])) / delta**case.deriv


def measured(case: Case, seeds: int, local: bool, exponent: float) -> dict[str, Any]:
    """Return the errors of the choice and of the oracle, and those that were estimated."""
    x, truth, delta = case.sampled()
    errors, estimated, windows = [], [], []
    for seed in range(seeds):
        y = x + case.noise(x, seed)
        suggestion = algdiff.suggest(y, case.deriv, delta=delta, local=local, kappa=exponent, mu=exponent)
        errors.append(float(np.square(suggestion(y) - truth).mean()))
        estimated.append(suggestion.rmse)
        windows.append((suggestion.differentiator.window_length, suggestion.differentiator.degree))
    best, least = oracle(case)
    return {
        "case": case.label,
        "oracle": (best.window_length, best.degree, best.kappa),
        "oracle_rmse": least,
        "rmse": float(np.sqrt(np.mean(errors))),
        "ratio": float(np.sqrt(np.mean(errors))) / least,
        "honesty": float(np.sqrt(np.mean(np.square(estimated)) / np.mean(errors))),
        "chosen": windows,
    }


def summary(found: list[dict[str, Any]]) -> dict[str, float]:
    """Return what the targets are about."""
    ratios = np.array([one["ratio"] for one in found])
    honesty = np.array([one["honesty"] for one in found])
    return {
        "median": float(np.median(ratios)),
        "90th percentile": float(np.quantile(ratios, 0.9)),
        "worst": float(ratios.max()),
        "honest": float(((honesty < HONEST) & (honesty > 1 / HONEST)).mean()),
    }


def main() -> None:
    """Print the ratios, the worst cases and whether the targets are met."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--signals", nargs="+", metavar="NAME", help="some of the signals")
    parser.add_argument("--counts", nargs="+", type=int, default=COUNTS, help="numbers of samples")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="realisations of the noise")
    parser.add_argument("--exponent", type=float, default=1.0, help="kappa and mu of the windows that are compared")
    parser.add_argument("--local", action="store_true", help="let the window adapt along the signal")
    parser.add_argument("--worst", type=int, default=12, help="how many of the worst cases to print")
    parser.add_argument("--json", type=Path, help="where all figures go")
    options = parser.parse_args()
    warnings.simplefilter("ignore", algdiff.DesignWarning)
    chosen = [one for one in SIGNALS if options.signals is None or one.name in options.signals]
    found = [
        measured(case, options.seeds, options.local, options.exponent) for case in cases(chosen, tuple(options.counts))
    ]
    figures = summary(found)
    print(f"{len(found)} cases, {options.seeds} seeds: error of the choice over that of the best member")
    for name, target in TARGETS.items():
        print(f"  {name:<16}{figures[name]:.3f}   (target {target})")
    print(f"  estimated error within a factor of {HONEST} of the true one: {100 * figures['honest']:.0f} %")
    print("worst:")
    for one in sorted(found, key=lambda one: -one["ratio"])[: options.worst]:
        honest = f"{one['honesty']:.2f}"
        print(
            f"  {one['ratio']:.2f}  {one['case']}: {one['chosen'][0]}, best {one['oracle']}; estimated / true {honest}"
        )
    if options.json:
        options.json.write_text(json.dumps({"machine": machine("scipy"), "summary": figures, "cases": found}, indent=1))


if __name__ == "__main__":
    main()
