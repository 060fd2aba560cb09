"""Text tables: ``.csv``, with or without names, quotes and dates; commas, semicolons or tabs between columns."""

from __future__ import annotations

import codecs
import csv
import os
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from io import StringIO
from pathlib import Path
from typing import Any, Literal

import numpy as np

from algdiff._formats.base import Layout, Options, Place, Samples, Source, Target
from algdiff._formats.even import Even
from algdiff._formats.lines import END, LONGEST, Lines
from algdiff._formats.tables import Piece, TableSource, choose
from algdiff._formats.text import ANYTHING, DATE, MOMENT, NUMBER, ZONED, fault, first_row, is_number

TYPES = {NUMBER: "f8", MOMENT: "U48", ZONED: "U48", ANYTHING: "U1"}
"""Types of columns; a date has at most 35 characters."""

NUMBERS = 1 << 16
"""How many are formatted at once."""


def open_source(path: Path, inner: str | None, options: Options) -> Source:
    """Open the table for reading."""
    return CsvSource(path, options)


class CsvSource(TableSource):
    """Columns of a text table. Opening it counts its lines, and reads the first ones."""

    dtype = np.dtype(np.float64)

    def __init__(self, path: Path, options: Options) -> None:
        super().__init__(path, open(path, "rb"))
        try:
            self.lines = Lines(self.file, path)  # before a line is read that has no end
            self.delimiter, fields = first_row(self._first_line())
            self.header = None if _are_samples(fields, options.time) else fields
            self.before = int(self.header is not None)
            rows = self.lines.count - self.before
            if rows < 1:
                raise ValueError(f"{path}: must hold numbers, got none")
            self._choose(options, len(fields))
            self.shape = (rows,) if len(self.chosen) == 1 else (rows, len(self.chosen))
            if self.timed is not None:
                self._open_times(self.timed)
            self._coming = self._pieces(0)
            self._held = [next(self._coming)]
        except BaseException:
            self.file.close()
            raise

    def _first_line(self) -> str:
        self.file.seek(0)
        line = END.split(self.file.readline(LONGEST).removeprefix(codecs.BOM_UTF8), maxsplit=1)[0]
        try:
            return line.decode()
        except UnicodeDecodeError as error:
            raise ValueError(f"{self.path}: not UTF-8 text ({error})") from None

    def _choose(self, options: Options, count: int) -> None:
        """Decide which columns are read, and as what."""
        header, index = self.header or (), self._index(0)
        first = _fields(self._texts(index)[0], self.delimiter)
        if not first:
            raise ValueError(f"{self.path}: {_blank(self.before + 1)}")
        if len(first) != count:
            raise ValueError(f"{self.path}: the rows must have {count} columns as the first, got {len(first)}")
        self.chosen, self.timed = choose(self.path, options, self.header, count, range(count))
        self.names = None if self.header is None else tuple(header[position] for position in self.chosen)
        kinds = [NUMBER] * count
        named = any(header.count(name) == 1 for name in options.columns or ())
        if named or (options.columns is not None and header and not any(map(is_number, header))):
            # That there is a header is certain; else it might be a row of numbers, one of them misspelt.
            kinds = [NUMBER if position in (*self.chosen, self.timed) else ANYTHING for position in range(count)]
        if self.timed is not None and self.timed not in self.chosen:
            match = DATE.fullmatch(first[self.timed].strip())
            if match is not None:
                kinds[self.timed] = MOMENT if match["zone"] is None else ZONED
        self.kinds = tuple(kinds)
        self.fields: list[Any] | None = None
        if set(kinds) != {NUMBER}:
            self.fields = [(f"f{position}", TYPES[kind]) for position, kind in enumerate(kinds)]

    def _open_times(self, position: int) -> None:
        self.time = "time" if self.header is None else self.header[position]
        self.time_dtype = np.dtype(np.float64)
        ends = (self._index(0), len(self.lines) - 1)
        tables = [self._table(index) for index in ends]
        if self.kinds[position] != NUMBER:
            matches = [DATE.fullmatch(text.strip()) for table in tables for text in _column(table, position).tolist()]
            fine = any(len(match["fraction"] or "") > 6 for match in matches if match is not None)
            self.time_dtype = np.dtype("M8[ns]" if fine else "M8[us]")
        if self.kinds[position] == ZONED:
            self.attributes["time_zone"] = "UTC"
        times = [self._times(index, table, position) for index, table in zip(ends, tables, strict=True)]
        both = np.array([times[0][0], times[1][-1]], self.time_dtype)
        self._even = Even(self.path, self.time, both, self.shape[0], np.concatenate(times))
        self.step = self._even.step

    def _index(self, row: int) -> int:
        """Return from which remembered line on a row is found."""
        return bisect_right(self.lines.numbers, row + self.before) - 1

    def _first(self, index: int) -> int:
        """Return the first row after a remembered line."""
        return max(self.lines.numbers[index] - self.before, 0)

    def _where(self, row: int) -> str:
        return f"line {row + self.before + 1}, column {self.timed}"

    def _pieces(self, row: int) -> Iterator[Piece]:
        for index in range(self._index(row), len(self.lines)):
            table = self._table(index)
            numbers = table[:, self.chosen] if table.ndim == 2 else np.empty((len(table), len(self.chosen)))
            if table.ndim == 1:
                for place, position in enumerate(self.chosen):
                    numbers[:, place] = _column(table, position)
            times = None if self.timed is None else self._times(index, table, self.timed)
            yield Piece(self._first(index), numbers, times)

    def _texts(self, index: int) -> list[str]:
        """Return the rows from a remembered line to the next."""
        lines = self.lines.read(self.file, index)
        return lines[self.before :] if index == 0 else lines

    def _table(self, index: int) -> Samples:
        """Return the rows from a remembered line to the next, as numbers or in fields."""
        lines, before = self._texts(index), self._first(index) + self.before
        blank = lines.index("") + 1 + before if "" in lines else None
        table: Samples | None = None
        why: object = None
        try:
            if any(lines):
                dtype: np.dtype[Any] = np.dtype(self.fields or np.float64)
                dimensions: Literal[1, 2] = 1 if self.fields else 2
                table = np.loadtxt(lines, dtype, None, self.delimiter, ndmin=dimensions, quotechar='"')
        except ValueError as error:
            why = error
        if blank is not None and why is None:
            raise ValueError(f"{self.path}: {_blank(blank)}")
        # Quotes that do not end go on in the next line.
        if table is None or len(table) != len(lines) or (table.ndim == 2 and table.shape[1] != len(self.kinds)):
            raise ValueError(f"{self.path}: {fault(lines, self.delimiter, self.kinds, before) or why}")
        return table

    def _times(self, index: int, table: Samples, position: int) -> Samples:
        column = _column(table, position)
        kind = self.kinds[position]
        if kind == NUMBER:
            return column
        matches = [DATE.fullmatch(text.strip()) for text in column.tolist()]
        zones = {match["zone"] if match is not None else "" for match in matches}
        try:
            if "" in zones or (None in zones) != (kind == MOMENT) or (None in zones and len(zones) > 1):
                raise ValueError("mixed")
            times = np.array([match["bare"] for match in matches if match is not None], self.time_dtype)
        except ValueError as error:
            before = self._first(index) + self.before
            what = fault(self._texts(index), self.delimiter, self.kinds, before) or error
            raise ValueError(f"{self.path}: {what}") from None
        if zones - {None, "Z"}:
            shifts = {zone: _shift(zone) for zone in zones}
            times -= np.array([shifts[match["zone"]] for match in matches if match is not None], "m8[m]")
        return times


def _are_samples(fields: Sequence[str], time: str | None) -> bool:
    """Return whether the first row is one of samples: numbers, and perhaps a date in the column of times."""
    return all(
        is_number(field) or (time == str(position) and DATE.fullmatch(field) is not None)
        for position, field in enumerate(fields)
    )


def _blank(line: int) -> str:
    return f"line {line} must hold numbers, got nothing: a sample is missing there"


def _fields(line: str, delimiter: str) -> Sequence[str]:
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return line.split(delimiter)


def _column(table: Samples, position: int) -> Samples:
    return np.asarray(table[:, position] if table.ndim == 2 else table[f"f{position}"])


def _shift(zone: str | None) -> int:
    """Return the minutes by which a time zone is ahead."""
    if zone in (None, "Z"):
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    minutes = 60 * int(digits[:2]) + int(digits[2:])
    return -minutes if zone[0] == "-" else minutes


def check(path: Path, inner: str | None, layout: Layout) -> None:
    """Every table can be held."""


def create(path: Path, inner: str | None, layout: Layout) -> Target:
    """Start the table under a temporary name, with the names of its columns if they have some."""
    with open(path, "wb") as file:
        names = layout.columns
        if names is not None:
            row = StringIO()
            timed = () if layout.time is None else (layout.time,)
            csv.writer(row, delimiter=layout.delimiter, lineterminator="\n").writerow((*timed, *names))
            file.write(row.getvalue().encode())
    return CsvTarget(path, layout, os.path.getsize(path))


def reopen(path: Path, inner: str | None, layout: Layout, mark: int) -> Target:
    """Go on with a table that was started: what came after `mark` bytes is thrown away."""
    if os.path.getsize(path) < mark:
        raise ValueError(f"{path}: must hold at least {mark} bytes to go on, got {os.path.getsize(path)}")
    return CsvTarget(path, layout, mark)


class CsvTarget(Target):
    """A text table that grows: the shortest decimals that read back as the same numbers; dates of ISO 8601."""

    def __init__(self, path: Path, layout: Layout, size: int) -> None:
        self.layout, self.size = layout, size
        self.file = open(path, "r+b", buffering=0)
        self.file.truncate(size)
        self.file.seek(size)
        columns = layout.rows[1]
        timed = [] if layout.time is None else ["%s" if self._dates else "%r"]
        number = "%.9g" if layout.dtype.itemsize < 8 else "%r"
        self.line = layout.delimiter.join(timed + [number] * columns) + "\n"
        self.length = max(NUMBERS // columns, 1)
        self.zone = "Z" if "time_zone" in layout.attributes else ""

    @property
    def _dates(self) -> bool:
        dtype = self.layout.time_dtype
        return dtype is not None and dtype.kind == "M"

    def write(self, place: Place, block: Samples, times: Samples | None = None) -> None:
        """Append rows."""
        size = self.size
        for start in range(0, len(block), self.length):
            rows = slice(start, start + self.length)
            text = memoryview(self._text(block[rows], None if times is None else times[rows]).encode())
            done = 0
            while done < len(text):
                done += self.file.write(text[done:])
            size += done
        self.size = size  # what a full disk cuts off does not count

    def _text(self, block: Samples, times: Samples | None) -> str:
        values = block.ravel().tolist()
        if times is not None:
            texts = (
                [text + self.zone for text in np.datetime_as_string(times).tolist()] if self._dates else times.tolist()
            )
            columns, values = block.shape[1], [None] * (block.size + len(block))
            values[:: columns + 1] = texts
            for column in range(columns):
                values[column + 1 :: columns + 1] = block[:, column].tolist()
        return self.line * len(block) % tuple(values)

    def sync(self) -> int:
        """Make durable what was written; return its bytes."""
        os.fsync(self.file.fileno())
        return self.size

    def close(self) -> None:
        """Close the file."""
        self.file.close()
