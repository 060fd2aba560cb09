"""What tables have in common: columns that are chosen, and rows read in pieces, some of which are kept."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from algdiff._formats.base import Options, Place, Samples, Source
from algdiff._formats.even import Even
from algdiff._refusals import listed


class Piece(NamedTuple):
    """Rows that were read together.

    Attributes
    ----------
    first : int
        The first of them.
    numbers : ndarray, shape (rows, columns)
        The chosen columns.
    times : ndarray or None
        Their times.
    """

    first: int
    numbers: Samples
    times: Samples | None

    @property
    def end(self) -> int:
        """The row after the last."""
        return self.first + len(self.numbers)


class TableSource(Source):
    """A table, read piece by piece.

    Blocks are not shorter than the window, so that regions overlap by half of one, or little more: pieces of the last
    half are kept for the next region. What is missing is read again.
    """

    axis = 0

    def __init__(self, path: Path, file: Any = None) -> None:
        super().__init__(path, file)
        self._held: list[Piece] = []
        self._coming: Iterator[Piece] = iter(())
        self._even: Even | None = None

    @abstractmethod
    def _pieces(self, row: int) -> Iterator[Piece]:
        """Yield the pieces from the one that holds a row on; earlier ones may come before it."""

    @abstractmethod
    def _where(self, row: int) -> str:
        """Return where the time of a row stands in the file."""

    def read(self, place: Place, out: Samples) -> Samples | None:
        """Fill `out`; return the times of its rows if there are some, which must be even."""
        start, stop = place[0].start, place[0].stop
        columns = place[1] if len(place) > 1 else 0
        times = None if self.time is None else np.empty(stop - start, self.time_dtype)
        done, kept = start, []
        if start == stop:
            return times
        held = iter(self._from(start))
        for piece in chain(held, self._coming):
            if piece.end <= done:
                continue
            last = min(stop, piece.end)
            rows, to = slice(done - piece.first, last - piece.first), slice(done - start, last - start)
            out[to] = piece.numbers[rows, columns]
            if times is not None and piece.times is not None:
                times[to] = piece.times[rows]
            if piece.end > (start + stop) // 2:
                kept.append(piece)
            done = last
            if done == stop:
                break
        if done < stop:
            raise ValueError(f"{self.path}: must hold {self.shape[0]} rows as when it was opened, got {done}")
        self._held = [*kept, *held]
        if times is not None and self._even is not None:
            self._check_times(start, times)
        return times

    def _from(self, row: int) -> list[Piece]:
        """Return the pieces that are kept from a row on, and let the coming ones follow them."""
        held, self._held = self._held, []  # after an error nothing is
        if not held or not held[0].first <= row <= held[-1].end:
            held, self._coming = [], self._pieces(row)
        return held

    def _check_times(self, row: int, times: Samples) -> None:
        found = None if self._even is None else self._even.fault(row, times)
        if found is not None:
            raise ValueError(f"{self.path}: {self._where(row + found[0])} {found[1]}")


def choose(
    path: Path, options: Options, names: Sequence[str] | None, count: int, default: Sequence[int]
) -> tuple[list[int], int | None]:
    """Return the positions of the chosen columns, and that of the times.

    Parameters
    ----------
    path : Path
        The file, for errors.
    options : Options
        What the caller says.
    names : sequence of str or None
        Names of all columns.
    count : int
        How many there are.
    default : sequence of int
        Those that are taken if the caller chooses none, except the times.
    """
    found = None if options.time is None else _position(path, "time must name a column", names, count, options.time)
    if options.columns is None:
        chosen = [position for position in default if position != found]
    else:
        what = "columns must name columns"
        chosen = [_position(path, what, names, count, column) for column in options.columns]
    if not chosen:
        beside = "" if found is None else f" beside the times in {options.time!r}"
        held = f"must hold a column of numbers{beside}" if options.columns is None else "columns must name one at least"
        raise ValueError(f"{path}: {held}, got none")
    return chosen, found


def _position(path: Path, what: str, names: Sequence[str] | None, count: int, column: str) -> int:
    names = names or ()
    if names.count(column) == 1:
        return names.index(column)
    if column.isdecimal() and int(column) < count:
        return int(column)
    held = f"{listed(names)}; or " if names else ""
    raise ValueError(f"{what} of {path} ({held}0 to {count - 1}), got {column!r}")
