"""Where the lines of a text begin."""

from __future__ import annotations

import codecs
import re
from array import array
from pathlib import Path
from typing import IO

import numpy as np

PIECE = 1 << 18
"""Bytes after which the beginning of a line is remembered."""

LONGEST = 64 << 20
"""Bytes of a line, at most."""

END = re.compile(rb"\r\n|\r|\n")


class Lines:
    """Some lines of a text and where they begin, from which any is found soon: flat memory for texts of any size.

    Parameters
    ----------
    file : binary file
        The text.
    path : Path
        Its name, for errors.

    Attributes
    ----------
    numbers, offsets : array of int
        The lines, counted from 0, and where they begin.
    count, end : int
        How many lines there are up to the last that is not blank, and where that ends.
    """

    def __init__(self, file: IO[bytes], path: Path) -> None:
        self.path, self.count = path, 0
        file.seek(0)
        self.end = start = 3 if file.read(3) == codecs.BOM_UTF8 else 0
        self.numbers, self.offsets = array("q", [0]), array("q", [start])
        file.seek(start)
        self._scan(file)
        while len(self.offsets) > 1 and self.offsets[-1] >= self.end:  # blank lines
            self.numbers.pop()
            self.offsets.pop()

    def _scan(self, file: IO[bytes]) -> None:
        start = position = self.end
        done, following = 0, file.read(PIECE)
        while following:
            piece, following = following, file.read(PIECE)
            if piece.endswith(b"\r") and following.startswith(b"\n"):
                piece, following = piece + b"\n", following[1:]
            ends = _ends(piece)
            match = END.search(piece) if position > start else None
            if match is not None:
                self.numbers.append(done + 1)
                self.offsets.append(position + match.end())
            if position + len(piece) - self.offsets[-1] > LONGEST:
                raise ValueError(f"{self.path}: line {done + 1} is longer than {LONGEST >> 20} MiB")
            bare = piece.rstrip(b"\r\n")
            if bare:
                self.count, self.end = done + 1 + _ends(bare), position + len(bare)
            done += ends
            position += len(piece)

    def __len__(self) -> int:
        """How many lines are remembered."""
        return len(self.numbers)

    def read(self, file: IO[bytes], index: int) -> list[str]:
        """Return the lines from a remembered one to the next, without their ends."""
        start, stop = self.offsets[index], self.end
        if index + 1 < len(self):
            stop = self.offsets[index + 1]
        file.seek(start)
        held = file.read(stop - start)
        if len(held) < stop - start:
            raise ValueError(f"{self.path}: ends before the table does: it was cut off, or is being written")
        if b"\r" in held:
            held = held.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        try:
            return held.decode().removesuffix("\n").split("\n")
        except UnicodeDecodeError as error:
            raise ValueError(f"{self.path}: not UTF-8 text ({error})") from None


def _ends(piece: bytes) -> int:
    """Return how many lines end."""
    count = int(np.count_nonzero(np.frombuffer(piece, np.uint8) == ord("\n")))  # in half the time of bytes.count
    return count + (piece.count(b"\r") - piece.count(b"\r\n") if b"\r" in piece else 0)
