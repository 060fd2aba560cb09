"""Covering arrays: few cells of a grid that hold every pair of levels which can go together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

Cell = dict[str, Any]
Pair = tuple[tuple[str, int], tuple[str, int]]
"""Two factors, and which of their levels."""


TRIES = 20
"""Cells that are drawn around the same levels, at most, before others are."""
Preference = Callable[[dict[str, int], str, list[int]], list[int]]
"""Sorts levels of a factor by the levels that are chosen so far."""


class Rule(NamedTuple):
    """Levels that do not go together: those of the factors `names` for which `apart` is true."""

    names: tuple[str, ...]
    apart: Callable[..., bool]


class Grid:
    """Factors with their levels, and rules; a cell has one level of each.

    Parameters
    ----------
    factors : mapping of str to sequence
        The levels of each factor. A level is known by its place.
    rules : sequence of Rule
        What a cell must not hold.
    """

    def __init__(self, factors: Mapping[str, Sequence[Any]], rules: Sequence[Rule]) -> None:
        self.factors, self.rules = factors, rules
        self.names = tuple(factors)
        self.touching = {name: [rule for rule in rules if name in rule.names] for name in factors}
        self.closing = {
            name: [rule for rule in rules if max(rule.names, key=self.names.index) == name] for name in factors
        }
        self._known: dict[tuple[int, ...], bool] = {}

    def levels(self, chosen: Mapping[str, int]) -> Cell:
        """Return the levels at these places."""
        return {name: self.factors[name][place] for name, place in chosen.items()}

    def apart(self, rule: Rule, chosen: Mapping[str, int]) -> bool:
        """Return whether a rule speaks against these levels, which are of all its factors and maybe more."""
        key = (id(rule), *(chosen[name] for name in rule.names))
        if key not in self._known:
            self._known[key] = bool(rule.apart(*(self.factors[name][chosen[name]] for name in rule.names)))
        return self._known[key]

    def complete(self, chosen: Mapping[str, int], prefer: Preference) -> dict[str, int] | None:
        """Return a cell that holds the levels chosen so far, by backtracking; none if there is none.

        `prefer` sorts the places of the levels of a factor, in the order in which they are tried.
        """
        levels = {name: [*range(len(self.factors[name]))] for name in self.names if name not in chosen}
        rules = [rule for rule in self.rules if all(name in chosen for name in rule.names)]
        if any(self.apart(rule, chosen) for rule in rules):
            return None
        left = dict(levels)
        for name in chosen:
            if not self._narrow(name, chosen, left):
                return None
        return self._complete(dict(chosen), left, prefer)

    def _complete(
        self, chosen: dict[str, int], left: dict[str, list[int]], prefer: Preference
    ) -> dict[str, int] | None:
        if not left:
            return chosen
        name = min(left, key=lambda one: (len(left[one]) > 1, len(left[one]) if self.touching[one] else 99))
        for place in prefer(chosen, name, left[name]):
            more, fewer = {**chosen, name: place}, {one: places for one, places in left.items() if one != name}
            if self._narrow(name, more, fewer):
                found = self._complete(more, fewer, prefer)
                if found is not None:
                    return found
        return None

    def _narrow(self, name: str, chosen: Mapping[str, int], left: dict[str, list[int]]) -> bool:
        """Take what no longer goes with `name` from the levels that are left; return whether each factor has one."""
        for rule in self.touching[name]:
            last = [one for one in rule.names if one not in chosen]
            if len(last) == 1:
                (one,) = last
                left[one] = [place for place in left[one] if not self.apart(rule, {**chosen, one: place})]
                if not left[one]:
                    return False
        return True

    def any_order(self, rng: np.random.Generator) -> Preference:
        """Return the preference for no level over another."""
        return lambda _chosen, _name, places: rng.permutation(places).tolist()

    def pairs(self) -> list[Pair]:
        """Return all pairs of levels, whether they go together or not."""
        places = [[(name, place) for place in range(len(self.factors[name]))] for name in self.names]
        return [(a, b) for one, other in combinations(places, 2) for a in one for b in other]

    def allowed(self, pair: Pair, rng: np.random.Generator) -> bool:
        """Return whether a cell holds both levels."""
        return self.complete(dict(pair), self.any_order(rng)) is not None

    def covering(self, rng: np.random.Generator) -> list[Cell]:
        """Return cells that hold every pair which any cell can hold, greedily.

        Each starts from a pair that none holds yet, and takes for each further factor, in random order of ties, the
        level with most such pairs among the factors so far. Pairs for which there is no cell are left.
        """
        cells: list[Cell] = []
        left = dict.fromkeys(self.pairs())
        while left:
            pair = next(iter(left))

            def prefer(chosen: dict[str, int], name: str, places: list[int]) -> list[int]:
                count = {
                    level: sum(self._ordered(one, place, name, level) in left for one, place in chosen.items())
                    for level in places
                }
                return sorted(rng.permutation(places).tolist(), key=lambda level: -count[level])

            found = self.complete(dict(pair), prefer)
            if found is None:
                del left[pair]
                continue
            for held in self.held(found):
                left.pop(held, None)
            cells.append(self.levels({name: found[name] for name in self.names}))
        return cells

    def draw(self, rng: np.random.Generator, shares: Mapping[str, Sequence[int]]) -> Cell:
        """Return a random cell: level by level, from the start again where none goes with those so far.

        `shares` say how often the levels of a factor are drawn, relative to each other; by default all alike.
        """
        found = None
        while found is None:
            found = self._drawn(rng, shares, {})
        return found

    def breaking(self, rule: Rule, rng: np.random.Generator) -> Cell:
        """Return a random cell that breaks a rule which is none of the grid's."""
        while True:
            start = {name: int(rng.integers(len(self.factors[name]))) for name in rule.names}
            for _ in range(TRIES if self.apart(rule, start) else 0):
                found = self._drawn(rng, {}, start)
                if found is not None:
                    return found

    def _drawn(
        self, rng: np.random.Generator, shares: Mapping[str, Sequence[int]], start: Mapping[str, int]
    ) -> Cell | None:
        chosen: dict[str, int] = {}
        for name in self.names:
            count = len(self.factors[name])
            levels = [
                place
                for place in ([start[name]] if name in start else range(count))
                if not any(self.apart(rule, {**chosen, name: place}) for rule in self.closing[name])
            ]
            places = [place for place in levels for _ in range(shares.get(name, [1] * count)[place])]
            if not places:
                return None
            chosen[name] = places[rng.integers(len(places))]
        return self.levels(chosen)

    def _ordered(self, one: str, place: int, other: str, level: int) -> Pair:
        a, b = (one, place), (other, level)
        return (a, b) if self.names.index(one) < self.names.index(other) else (b, a)

    def held(self, chosen: Mapping[str, int]) -> list[Pair]:
        """Return the pairs of a cell."""
        return list(combinations([(name, chosen[name]) for name in self.names], 2))

    def places(self, cell: Cell) -> dict[str, int]:
        """Return the places of the levels of a cell."""
        return {name: list(self.factors[name]).index(cell[name]) for name in self.names}
