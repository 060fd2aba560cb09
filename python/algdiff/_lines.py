"""Lines of text made into samples, and times into text, as ``algdiff stream`` needs them."""

from __future__ import annotations

import codecs
import math
import re
from contextlib import suppress
from datetime import datetime, timedelta
from decimal import Decimal
from itertools import chain
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

MISSING = ("", "NA")
"""What marks a missing sample, besides every spelling of nan."""
SHOWN = 60
"""Characters of a wrong field that are shown."""
FRACTION = re.compile(r"(:\d\d)[.,](\d+)")
"""Of a second, in as many digits as there are."""


class Lines:
    """Lines made into numbers.

    Attributes
    ----------
    columns : int
        How many numbers a line holds; 0 before the first that does.
    delimiter : str or None
        What separates them; None is any number of spaces.
    names : tuple of str
        The header, empty without one.
    clock : Clock or None
        What the times in the first column count from.
    """

    def __init__(self, *, timed: bool, strict: bool) -> None:
        self.columns = 0
        self.delimiter: str | None = None
        self.names: tuple[str, ...] = ()
        self.clock: Clock | None = None
        self.timed, self._strict = timed, strict
        self._mark: bytes | None = None
        self._header: tuple[str, str | None, tuple[str, ...]] | None = None
        self._count, self._latest = 0, -math.inf

    def read(self, text: bytes) -> tuple[list[float], str]:
        """Return the numbers of whole lines, and what is wrong with the line after them if that is why they end."""
        if self._count == 0:
            text = text.removeprefix(codecs.BOM_UTF8)
        lines = text.split(b"\n")
        values = self._plain(lines) if self.columns and not self.timed and b"_" not in text else None
        if values is not None:
            self._count += len(lines)
            return values, ""
        values = []
        for line in lines:
            self._count += 1
            try:
                values += self._row(line)
            except ValueError as error:
                return values, f"line {self._count}{error}"
        return values, ""

    def _plain(self, lines: list[bytes]) -> list[float] | None:
        """Return the numbers of lines that hold nothing else, which is most, in a hurry."""
        fields = lines
        if self.columns > 1:
            rows = [line.split(self._mark) for line in lines]
            if set(map(len, rows)) != {self.columns}:
                return None
            fields = list(chain.from_iterable(rows))
        try:
            values = list(map(float, fields))
        except ValueError:
            return None
        return None if self._strict and any(map(math.isnan, values)) else values

    def _row(self, line: bytes) -> list[float]:
        """Return the numbers of a line, none if it is passed over."""
        # Tabs alone delimit fields that are all empty.
        if not line.strip(b" \r" if self.delimiter == "\t" or not self.columns else None) or line.lstrip().startswith(
            b"#"
        ):
            return []
        if not self.columns and self._begin(line):
            return []
        fields = line.split(self._mark)
        if len(fields) != self.columns:
            raise ValueError(f" must have {self.columns} columns as the lines before it, got {len(fields)}")
        times = [self._time(fields[0])] if self.timed else []
        return times + [self._sample(position, fields[position]) for position in range(len(times), len(fields))]

    def _begin(self, line: bytes) -> bool:
        """Recognise the columns by the first line; return whether that is a header."""
        from algdiff._formats.text import first_row

        text = line.decode(errors="surrogateescape").strip(" \r")
        mark, fields = first_row(text)
        delimiter = mark if len(fields) > 1 else None
        if delimiter is None:
            fields = tuple(text.split())
        if self._header is None and self._is_header(fields):
            self._header = text, delimiter, fields
            return True
        names: tuple[str, ...] = ()
        if self._header is not None:
            text, delimiter, names = self._header
            if delimiter is None and len(fields) == 1:  # a name with spaces in it
                names = first_row(text)[1]
            fields = names
        if self.timed and len(fields) < 2:
            raise ValueError(f" must hold a time and at least one sample, got {len(fields)} column")
        self.columns, self.names, self.delimiter = len(fields), names, delimiter
        self._mark = None if delimiter is None else delimiter.encode()
        return False

    def _is_header(self, fields: Sequence[str]) -> bool:
        """Return whether fields are names: one at least is no sample, and none is a number or a time."""
        values = [_known(field) for field in fields]
        if self.timed and fields:
            with suppress(ValueError, ArithmeticError):
                Clock(fields[0])
                return False
        return None in values and not any(value is not None and value == value for value in values)

    def _sample(self, position: int, field: bytes) -> float:
        text = field.decode(errors="replace")
        try:
            value = _number(text)
        except ValueError:
            raise ValueError(f", column {position} must be a number, got {_shown(text)}") from None
        if self._strict and math.isnan(value):
            raise ValueError(f", column {position} must not be missing with --nan-policy raise, got {_shown(text)}")
        return value

    def _time(self, field: bytes) -> float:
        text = field.decode(errors="replace").strip()
        try:
            self.clock = self.clock or Clock(text)
            time = self.clock.since(text)
        except (ValueError, TypeError, ArithmeticError):
            raise ValueError(f", column 0 must be a time, of the kind of the first, got {_shown(text)}") from None
        if time <= self._latest:
            raise ValueError(f", column 0 must be later than in the line before it, got {_shown(text)}")
        self._latest = time
        return time


def _shown(text: str) -> str:
    """Return text in quotes, shortened."""
    bare = text.strip()
    return repr(bare if len(bare) <= SHOWN else bare[:SHOWN] + "...")


def _known(text: str) -> float | None:
    """Return a number, NaN for a missing one, None for anything else."""
    try:
        return _number(text)
    except ValueError:
        return None


def _number(text: str) -> float:
    bare = text.strip().strip('"')
    if bare.upper() in MISSING:
        return math.nan
    if "_" in bare or not bare.isascii():  # which Python would take
        raise ValueError
    return float(bare)


class Clock:
    """Times, numbers or ISO 8601 dates, counted from the first without loss of digits."""

    def __init__(self, first: str) -> None:
        self._first, self._fraction = _moment(first)
        self._utc = first.endswith("Z")

    def since(self, text: str) -> float:
        """Return the time from the first one to that of `text`; of dates in seconds."""
        moment, fraction = _moment(text)
        passed: Decimal | timedelta = moment - self._first  # type: ignore[operator]
        whole = Decimal(passed.days * 86400 + passed.seconds) if isinstance(passed, timedelta) else passed
        return float(whole + (fraction - self._fraction))

    def text(self, time: float) -> str:
        """Return what `since` reads as `time`; of dates to microseconds."""
        if math.isnan(time):
            return "nan"
        if isinstance(self._first, Decimal):
            return repr(float(self._first + Decimal(time)))
        text = (self._first + timedelta(seconds=float(self._fraction) + time)).isoformat()
        return text.removesuffix("+00:00") + "Z" if self._utc else text


def _moment(text: str) -> tuple[Decimal | datetime, Decimal]:
    """Return a number, or a date in whole seconds and what is left of them."""
    bare = text.strip().strip('"')
    try:
        number = Decimal(bare)
    except ArithmeticError:
        fraction = FRACTION.search(bare)
        date = datetime.fromisoformat(FRACTION.sub(r"\1", bare).replace("Z", "+00:00"))
        return date, Decimal(f"0.{fraction[2]}" if fraction else 0)
    if not number.is_finite() or "_" in bare:
        raise ValueError
    return number, Decimal(0)
