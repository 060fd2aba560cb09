"""Rows of text: how they are split, what a number and a date look like, and which row is wrong."""

from __future__ import annotations

import csv
import re
from datetime import datetime
from typing import TYPE_CHECKING

from algdiff._refusals import shown

if TYPE_CHECKING:
    from collections.abc import Sequence

DATE = re.compile(
    r"(?P<bare>\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d(?:\.(?P<fraction>\d{1,9}))?)?)?)"
    r"(?P<zone>Z|[+-]\d\d(?::?\d\d)?)?",
    re.ASCII,
)
"""A date of ISO 8601."""

NUMBER, MOMENT, ZONED, ANYTHING = (
    "a number",
    "an ISO 8601 date without time zone",
    "an ISO 8601 date with time zone",
    "",
)
"""What a column holds."""


def first_row(line: str) -> tuple[str, tuple[str, ...]]:
    """Return the delimiter, looked for outside quotes, and the fields of the first row."""
    bare = "".join(line.split('"')[::2])
    delimiter = next((mark for mark in "\t;" if mark in bare), ",")
    try:
        fields = next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:  # a field without end, or a carriage return in one: no number, as will be said
        fields = line.split(delimiter)
    return delimiter, tuple(field.strip() for field in fields)


def is_number(text: str) -> bool:
    """Return whether `float` takes a text."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def fault(lines: Sequence[str], delimiter: str, kinds: Sequence[str], before: int) -> str | None:
    """Describe the first row that is not made of what the columns hold.

    Parameters
    ----------
    lines : sequence of str
        Rows without their ends.
    delimiter : str
        What separates their fields.
    kinds : sequence of str
        What the columns hold.
    before : int
        How many lines come before these in the file.
    """
    rows = csv.reader(lines, delimiter=delimiter)
    number = 0
    try:
        for row in rows:
            number += 1
            line = f"line {before + number}"
            if rows.line_num > number:
                return f"{line} must end the quotes that it begins"
            if not row:
                continue
            if len(row) != len(kinds):
                return f"{line} must have {len(kinds)} columns as the rows before it, got {len(row)}"
            for position, (field, kind) in enumerate(zip(row, kinds, strict=True)):
                if not holds(kind, field):
                    return f"{line}, column {position} must be {kind}, got {shown(field)}"
    except csv.Error as error:
        return f"line {before + number + 1} cannot be read ({error})"
    return None


def holds(kind: str, field: str) -> bool:
    """Return whether a field is of a kind."""
    if kind == NUMBER:
        return "_" not in field and field.isascii() and is_number(field)
    if kind == ANYTHING:
        return True
    match = DATE.fullmatch(field.strip())
    if match is None or (match["zone"] is not None) != (kind == ZONED):
        return False
    try:
        datetime.fromisoformat(match["bare"][:19])
    except ValueError:
        return False
    return True
