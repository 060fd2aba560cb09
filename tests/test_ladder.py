"""One ladder: weights in 60 digits, readable references, and the library, over a grid of everything that may be said.

The usual run holds a covering array of the grid, all pairs of levels that go together, and every refusal a few times.
With ALGDIFF_SOAK=1 in the environment it holds 100,000 random cells besides.
"""

from __future__ import annotations

from collections import Counter
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oracle_weights
import reference
from covering import Cell, Grid, Rule
from ladder import FACTORS, SHARES
from ladder_cells import held
from ladder_naive import Window, expected, window_maximum
from ladder_refusals import REASONS, RUNS, SAYABLE, alone, reasons
from support import EPS, design, soak

RULES = FACTORS["rule"]
EXPONENTS = (0.0, 1.0, 2.0, 7.0, 0.5, -0.5, -0.9)
NOTHING = 1e-30
"""What is left in 60 digits of weights that are 0, all of them: kernels have zeros."""
EACH = 10
"""Cells for every refusal."""
BLOCKS = 20


@pytest.fixture(scope="module")
def cells() -> list[Cell]:
    return RUNS.covering(np.random.default_rng(0))


# Covering arrays.


def test_a_covering_array_holds_the_pairs_of_all_cells() -> None:
    factors = {"a": (0, 1, 2), "b": (0, 1, 2), "c": ("x", "y"), "d": (False, True)}
    rules = [
        Rule(("a", "b"), lambda a, b: a == b == 0),
        Rule(("a", "c", "d"), lambda a, c, d: a == 1 and c == "x" and d),
        Rule(("b", "d"), lambda b, d: b == 2 and not d),
        Rule(("b", "a"), lambda b, a: b == 2 and a == 1),
    ]
    grid = Grid(factors, rules)
    every = [dict(zip(factors, levels, strict=True)) for levels in product(*factors.values())]
    allowed = [cell for cell in every if not any(rule.apart(*(cell[name] for name in rule.names)) for rule in rules)]
    few = grid.covering(np.random.default_rng(0))
    assert all(cell in allowed for cell in few)
    pairs = {pair for cell in allowed for pair in combinations(cell.items(), 2)}
    assert {pair for cell in few for pair in combinations(cell.items(), 2)} == pairs
    assert len(few) < len(allowed) / 1.5


def test_windows_of_the_maximum() -> None:
    x = np.random.default_rng(0).standard_normal((2, 9))
    for length in range(1, 10):
        wanted = [[x[row, i : i + length].max() for i in range(10 - length)] for row in range(2)]
        np.testing.assert_array_equal(window_maximum(x, length), wanted)


def test_the_cells_hold_every_pair_that_is_allowed(cells: list[Cell]) -> None:
    grid, rng = RUNS, np.random.default_rng(1)
    covered = {pair for cell in cells for pair in grid.held(grid.places(cell))}
    left = [pair for pair in grid.pairs() if pair not in covered]
    assert not [pair for pair in left if grid.allowed(pair, rng)]
    assert not any(reasons(cell) for cell in cells)
    assert len(covered) > 5500
    assert len(left) < 300


# Weights.


def random_window(rule: str, rng: np.random.Generator, longest: int) -> Window:
    deriv = int(rng.integers(0, 5))
    degree = deriv + int(rng.integers(0, 4))
    kappa, mu = (float(rng.choice(EXPONENTS)) for _ in range(2))
    if rule in ("trapezoid", "simpson"):
        kappa, mu = abs(kappa), abs(mu)
    length = int(rng.integers(degree + 2, longest))
    length = length | 1 if rule == "simpson" else length
    tau = ["center", "root", "newest", 0.3, 1.2, -0.15][rng.integers(6)]
    return Window(length, deriv, degree, kappa, mu, tau, rule, 1.0, 0, length, 0.0)


@pytest.mark.parametrize("rule", RULES)
def test_weights_against_sixty_digits(rule: str) -> None:
    """The bound: some eps of the largest functional, times the condition of the fit or what logarithms cost."""
    rng = np.random.default_rng(RULES.index(rule))
    for _ in range(soak(6 if rule in ("cell", "hat") else 16, 400)):
        window = random_window(rule, rng, 36)
        words = (window.length, window.deriv, window.degree, window.kappa, window.mu, window.tau, rule)
        exact = oracle_weights.weights(*words)
        _, naive, off = window.weights("valid")
        # For T = 1.
        step = 1 / (window.length - (rule in reference.NODES))
        options: dict[str, Any] = {"degree": window.degree, "kappa": window.kappa, "mu": window.mu, "tau": window.tau}
        ours = design(window.length, window.deriv, rule=rule, delta=step, **options).weights
        for found in (naive / window.unit, reference.weights(*words, step), ours):
            error = max(abs(float(a - b)) for a, b in zip(exact, found, strict=True))
            assert error <= off / window.unit + NOTHING, (window, error, off / window.unit)
        size = max(abs(float(w)) for w in exact)
        assert off / window.unit <= 1e-11 * size * 10 ** max(0, window.degree - 4) + NOTHING, window


@pytest.mark.parametrize("mode", FACTORS["mode"])
@pytest.mark.parametrize("rule", RULES)
def test_the_naive_sums_are_those_of_the_readable_reference(rule: str, mode: str) -> None:
    rng = np.random.default_rng([RULES.index(rule), FACTORS["mode"].index(mode)])
    for _ in range(soak(2, 40)):
        window = random_window(rule, rng, 14)
        x = rng.standard_normal((1, window.length + int(rng.integers(0, 9))))
        words: dict[str, Any] = {"degree": window.degree, "kappa": window.kappa, "mu": window.mu, "tau": window.tau}
        wanted = reference.differentiate(x[0], window.length, window.deriv, rule=rule, mode=mode, cval=2.0, **words)
        found, allowed = expected(window, x, mode, 2.0, "direct", single=False)
        np.testing.assert_array_equal(np.isnan(found[0]), np.isnan(wanted))
        _, w, off = window.weights(mode)
        # Two such sums, either by weights of its own; that of the reference loses the digits of an offset, which the
        # constants beyond the data are.
        whole = np.append(np.abs(x), 2.0).max() * (window.length * off + (window.length + 8) * EPS * np.abs(w).sum())
        assert (np.abs(np.nan_to_num(found[0] - wanted).astype(float)) <= 2 * allowed[0] + whole).all(), window


# Calls.


def test_all_pairs_of_what_may_be_said(cells: list[Cell], tmp_path: Path) -> None:
    found = Counter(held(cell, np.random.default_rng(seed), tmp_path) for seed, cell in enumerate(cells))
    print(f"{found.total()} cells: {dict(found)}")
    assert found == {"ran": len(cells)}


@pytest.mark.parametrize("name", REASONS)
def test_what_is_refused_in_the_documented_words(name: str, tmp_path: Path) -> None:
    reason, rng = REASONS[name], np.random.default_rng([*name.encode()])
    grids = (alone(name), SAYABLE)
    found = Counter(held(grids[k % 5 == 4].breaking(reason.rule, rng), rng, tmp_path) for k in range(soak(EACH, 400)))
    print(f"{found.total()} cells: {dict(found)}")
    same = sum(found[other] for other, one in REASONS.items() if one.says == reason.says)
    assert not reason.sure or ("ran" not in found and same >= 0.6 * found.total())


@pytest.mark.skipif(not soak(0, 1), reason="takes a quarter of an hour: ALGDIFF_SOAK=1")
@pytest.mark.parametrize("block", range(BLOCKS))
def test_random_cells(block: int, tmp_path: Path) -> None:
    found: Counter[str] = Counter()
    ran: Counter[tuple[str, Any]] = Counter()
    wrong: list[str] = []
    count = soak(0, 100_000 // BLOCKS)
    for number in range(count):
        rng = np.random.default_rng([block, number])
        cell = (SAYABLE if number % 5 == 0 else RUNS).draw(rng, SHARES)
        try:
            what = held(cell, rng, tmp_path)
        except AssertionError as error:
            wrong.append(f"{[block, number]}: {error}")
            continue
        found[what] += 1
        ran.update(cell.items() if what == "ran" else ())
    print(f"{found.total()} cells: {found['ran']} ran, {found.total() - found['ran']} refused: {dict(found)}")
    assert not wrong, "\n\n".join(wrong[:10])
    assert found["ran"] > 0.8 * count
    assert count - found["ran"] > 0.1 * count
    assert all(ran[name, level] for name, levels in FACTORS.items() for level in levels)
