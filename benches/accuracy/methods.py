"""Ways to choose a window from data, compared on the cases of `choice.py`.

All are given the same candidates, how far the estimates of these lie apart, and the level of white noise that the
library finds. No samples are averaged: the longest window is the whole recording, for all. What a way chooses is judged
twice. In the middle 70 % of the samples its design is run in mode "fit", and its error is over that of the best
candidate there; windows of more than 30 % of the samples are shifted, not central, in parts of that middle. Over all
samples the library's ends are put to it, and its error is over that of the best member of the family, as in
`choice.py`. Errors are root mean squares over samples and seeds, those of the best expected ones.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
import warnings
from collections import defaultdict
from dataclasses import replace
from functools import cache, partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import algdiff
from accuracy.choice import Case, cases, oracle
from accuracy.signals import SIGNALS
from algdiff._suggest.candidates import Family, design, even_degrees, family, windows
from algdiff._suggest.distances import distances
from algdiff._suggest.level import Limits, Search
from algdiff._suggest.selection import QUANTILE, quantile, select
from common import figure, machine, one_thread, table

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Samples = NDArray[np.float64]

COUNTS = (500, 2000)
SEEDS = 4
MIDDLE = 0.7
"""Share of the samples, in their middle, over which candidates are compared without the library's ends."""

CLOSE = 1.15
"""A choice that errs by no more than this times the best is counted as close."""

PIECES = (1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64)
"""Polynomials along the samples that the pilot of the plug-in may be made of."""

WORST = 3
"""Signals that are named with their worst ratios."""

SHARE = 20
"""Samples over those of the one reference that is not the finest: of 10, 20 and 40 that of the least median."""

OWN, SUGGEST = "the library's", "algdiff.suggest"
"""The library's choice among the same candidates, and as users call it.

It then averages samples for long windows, and takes noise for coloured if it seems so.
"""


class Seen(NamedTuple):
    """What a choice is made from.

    Rows of samples, 1 apart; mean squares of the differences of two candidates, and how many independent ones there
    are; the candidates; the level of the noise for each of them; the library's choice; the order of the derivative.
    """

    rows: Samples
    distance: Samples
    freedom: Samples
    family: Family
    sigma: Samples
    own: int
    deriv: int

    @property
    def noise(self) -> Samples:
        """The share of the distances that is expected of noise."""
        return np.square(np.maximum(self.sigma, self.sigma[:, None])) * self.family.difference

    @property
    def variance(self) -> Samples:
        """The variance of the estimates."""
        return np.square(self.sigma) * self.family.gain


class Whole(Search):
    """The library's search among windows up to the whole recording, without averaging."""

    def _members(self, rows: Samples, *_: float) -> Family:
        return candidates(rows.shape[1], self.deriv)

    def seen(self, rows: Samples) -> Seen:
        """Return what a choice is made from, with the library's own level of noise and choice."""
        found = self._first(rows, 1)
        apart = distances(rows, found.family)
        return Seen(rows, *apart, found.family, found.sigma, found.risk.best, self.deriv)


@cache
def candidates(count: int, deriv: int) -> Family:
    """Return the candidates for so many samples."""
    lengths = tuple(windows(3, count))
    return family(deriv, tuple((degree, lengths) for degree in even_degrees(deriv)), 1.0, 1.0)


def two_degrees(seen: Seen, least: float = -math.inf) -> int:
    """Take the bias from the fit of two degrees more in the same window (after Fan and Gijbels 1995)."""
    window, degree = seen.family.window, seen.family.degree
    other = (window == window[:, None]) & (degree == degree[:, None] + 2)
    bias2 = np.maximum(np.where(other, seen.distance - seen.noise, 0.0).sum(axis=1), least)
    return int(np.argmin(np.where(other.any(axis=1), bias2 + seen.variance, math.inf)))


def _compared(seen: Seen, reference: int) -> int:
    """Return the least unbiased estimate of the risk (Mallows 1973) if the reference had no bias."""
    risk = seen.distance[reference] - seen.noise[reference] + seen.variance
    return int(np.argmin(np.where(seen.family.gain <= seen.family.gain[reference], risk, math.inf)))


def finest_reference(seen: Seen) -> int:
    """Compare with the candidate of most variance (Lacour, Massart and Rivoirard 2017, of penalty 1)."""
    return _compared(seen, int(np.argmax(seen.family.gain)))


def fine_reference(seen: Seen) -> int:
    """Compare with a window of the highest degree and a small share of the samples."""
    chain = seen.family.degree == seen.family.degree.max()
    return _compared(seen, int(np.argmax(chain & (seen.family.window >= seen.rows.size / SHARE))))


def lepski(seen: Seen) -> int:
    """Take the longest window that is consistent with all shorter ones, then the degree of least variance (1990)."""
    bound = seen.noise * quantile(seen.freedom, QUANTILE)
    ends = []
    for degree in np.unique(seen.family.degree):
        chain = np.flatnonzero(seen.family.degree == degree)
        apart = np.tril(seen.distance[np.ix_(chain, chain)] > bound[np.ix_(chain, chain)], -1).any(axis=1)
        ends.append(chain[int(np.argmax(apart)) - 1 if apart.any() else -1])
    return int(min(ends, key=lambda one: seen.variance[one]))


def goldenshluger_lepski(seen: Seen) -> int:
    """Take the least sum of variance and significant bias (2011): the library without its last comparison."""
    risk = select(seen.distance, seen.freedom, seen.family, seen.sigma)
    return int(np.argmin(risk.bias2 + risk.variance))


@cache
def _smoother(count: int, window: int, degree: int) -> tuple[algdiff.Differentiator, float]:
    """Return the smoother and by how much each sample counts in its own estimate, in the mean."""
    one = design(0, window, degree, 1.0, 1.0)
    half, short = window // 2, min(count, 2 * window + 1)
    ends = one(np.eye(half, short)).diagonal() if half else np.zeros(0)
    return one, (2 * float(ends.sum()) + (count - 2 * half) * float(one.weights[half])) / count


def cross_validation(seen: Seen) -> int:
    """Take what smooths best by generalised cross-validation (Craven and Wahba 1979)."""
    row = seen.rows[0]
    scores = []
    for window, degree in zip(seen.family.window, seen.family.degree, strict=True):
        one, own = _smoother(row.size, int(window), int(degree))
        scores.append(float(np.square(row - one(row)).mean()) / (1 - own) ** 2 if own < 1 - 1e-6 else math.inf)
    return int(np.argmin(scores))


def _mean_square(row: Samples, order: int, sigma: float) -> float:
    """Return the mean square of a derivative of the signal, by a pilot.

    Polynomials of degree `order` + 2 on equal pieces of the samples; how many pieces, Mallows' Cp says (Ruppert,
    Sheather and Wand 1995, who take fourth degrees for second derivatives). What noise adds to it is not taken off.
    """
    legendre, best = np.polynomial.legendre, (math.inf, 0.0)
    for pieces in PIECES:
        size = row.size // pieces
        if size < 2 * (order + 3):
            break
        points = np.linspace(-1.0, 1.0, size)
        basis, triangle = np.linalg.qr(legendre.legvander(points, order + 2))
        part = row[: pieces * size].reshape(pieces, size)
        coefficients = part @ basis
        left = float(np.square(part).sum() - np.square(coefficients).sum()) / part.size
        cp = left + 2 * sigma**2 * (order + 3) / size
        if cp < best[0]:
            slopes = legendre.legval(points, legendre.legder(np.linalg.solve(triangle, coefficients.T), order))
            best = cp, float(np.square(slopes).mean()) * (2 / (size - 1)) ** (2 * order)
    return best[1]


def plug_in(seen: Seen) -> int:
    """Take the window from theory with the derivative from a pilot, then the degree of least predicted error."""
    sigma, best = float(seen.sigma.min()), (math.inf, 0)
    for degree in np.unique(seen.family.degree):
        kernel = algdiff.Kernel(seen.deriv, degree)
        size = math.sqrt(_mean_square(seen.rows[0], seen.deriv + kernel.bias_order, sigma)) or sys.float_info.min
        chain = np.flatnonzero(seen.family.degree == degree)
        lengths = seen.family.window[chain]
        nearest = int(np.argmin(np.abs(np.log(lengths / kernel.optimal_duration(sigma, size)))))
        best = min(best, (kernel.rmse(float(lengths[nearest]), sigma, size), int(chain[nearest])))
    return best[1]


METHODS: dict[str, Callable[[Seen], int]] = {
    "two degrees more": two_degrees,
    "same, bias at least 0": partial(two_degrees, least=0.0),
    "finest reference": finest_reference,
    "1/20 as reference": fine_reference,
    "Lepski": lepski,
    "Goldenshluger-Lepski": goldenshluger_lepski,
    "cross-validation": cross_validation,
    "plug-in": plug_in,
    OWN: attrgetter("own"),
}


class Errors(NamedTuple):
    """Mean squares of the errors of a choice in the middle and over all samples, or their roots over the best."""

    middle: float
    everything: float


@cache
def _middle_gains(count: int, deriv: int) -> Samples:
    """Return the mean variances of the candidates in mode "fit" in the middle, for unit noise."""
    zeros, place = np.zeros(count), _middle(count)
    members = candidates(count, deriv).designs
    return np.array([np.square(one(zeros, return_std=True, sigma=1.0).std[place]).mean() for one in members])


def _middle(count: int) -> slice:
    margin = round((1 - MIDDLE) / 2 * count)
    return slice(margin, count - margin)


def best_middle(case: Case) -> float:
    """Return the expected mean square of the best candidate in the middle."""
    x, truth, delta = case.sampled()
    place, unit = _middle(case.count), delta**case.deriv
    sigma = case.level * (float(x.std()) or 1.0)
    bias2 = [
        float(np.square(one(x)[place] - unit * truth[place]).mean())
        for one in candidates(case.count, case.deriv).designs
    ]
    return float(np.min(np.array(bias2) + sigma**2 * _middle_gains(case.count, case.deriv))) / unit**2


def measured(case: Case, seeds: int, spent: dict[str, float]) -> dict[str, Errors]:
    """Return the ratios of the methods, and add up the seconds that they take."""
    x, truth, delta = case.sampled()
    found = defaultdict(list)
    for seed in range(seeds):
        y = x + case.noise(x, seed)
        started = time.process_time()
        suggestion = algdiff.suggest(y, case.deriv, delta=delta)
        spent[SUGGEST] += time.process_time() - started

        @cache
        def judged(one: algdiff.Differentiator, y: Samples = y, suggestion: algdiff.Suggestion = suggestion) -> Errors:
            errors = (one(y) - truth)[_middle(case.count)], replace(suggestion, differentiator=one)(y) - truth
            return Errors(*(float(np.square(part).mean()) for part in errors))

        found[SUGGEST].append(judged(suggestion.differentiator))
        for name, best in _choices(y, case.deriv, spent, again=seed == 0).items():
            found[name].append(judged(best.replace(delta=delta)))
    least = best_middle(case), oracle(case)[1] ** 2
    return {name: Errors(*np.sqrt(np.mean(errors, axis=0) / least)) for name, errors in found.items()}


def _choices(y: Samples, deriv: int, spent: dict[str, float], again: bool) -> dict[str, algdiff.Differentiator]:
    """Return what the methods choose, whose tables are made before their time counts if it is to be taken `again`."""
    seen = Whole(deriv, Limits({}, 3), 1.0, None, "white").seen(y[np.newaxis])
    found = {}
    for name, method in METHODS.items():
        if again:
            method(seen)
        started = time.process_time()
        found[name] = seen.family.designs[method(seen)]
        spent[name] += time.process_time() - started
    return found


def columns(ratios: list[float]) -> list[str]:
    """Return the columns of some ratios."""
    spread = np.quantile(ratios, (0.5, 0.9, 1.0))
    return [*(figure(float(value), 3) for value in spread), f"{100 * np.mean(np.array(ratios) <= CLOSE):.0f} %"]


def rows(found: list[dict[str, Errors]], spent: dict[str, float], choices: int) -> list[list[str]]:
    """Return the rows of the table."""
    return [
        [
            name,
            *columns([one[name].middle for one in found]),
            *columns([one[name].everything for one in found]),
            "" if name == OWN else figure(1e3 * spent[name] / choices),
        ]
        for name in (*METHODS, SUGGEST)
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="one realisation of the noise in 500 samples")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="realisations of the noise; default: %(default)d")
    options = parser.parse_args()
    warnings.simplefilter("ignore", algdiff.DesignWarning)
    seeds, counts = (1, COUNTS[:1]) if options.quick else (options.seeds, COUNTS)
    spent = dict.fromkeys((*METHODS, SUGGEST), 0.0)
    posed = cases(SIGNALS, counts)
    found = [measured(case, seeds, spent) for case in posed]
    print("\n".join(f"- {name}: {value}" for name, value in machine("scipy").items()) + "\n")
    names = ("median", "90th", "worst", f"<= {CLOSE}")
    head = ["choice by", *(f"{where}: {name}" for where in ("middle", "all") for name in names), "ms"]
    print(table(head, rows(found, spent, seeds * len(found))))
    print(f"\n{len(found)} cases, {seeds} seeds. Times are those of one choice after the distances are known, but of")
    print(f"{SUGGEST} all of it. The worst ratios in the middle, of the signals where they are worst:")
    for name in (*METHODS, SUGGEST):
        worst: dict[str, float] = {}
        for case, one in sorted(zip(posed, found, strict=True), key=lambda pair: -pair[1][name].middle):
            worst.setdefault(case.signal.name, one[name].middle)
        print(f"- {name}: {', '.join(f'{signal} {figure(worst[signal], 3)}' for signal in list(worst)[:WORST])}")


if __name__ == "__main__":
    one_thread()
    main()
