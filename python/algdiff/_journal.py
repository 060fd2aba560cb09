"""How far a run has come, in a file beside its unfinished output."""

from __future__ import annotations

import itertools
import json
import os
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

from algdiff._output import remove

HOW = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
"""How a journal is opened: it is no link, which somebody else may have put there to have another file written."""


class Journal:
    """The journal of one run: what was asked for, and after every checkpoint how many blocks are safe.

    The first line says what the run reads and does; another run goes on from here only if it would say the same to the
    letter. Every other line holds the blocks that are finished and durable, what the output needs to go on there,
    and how long it was. A line that a crash cut off does not count. While a run has the file open, it is locked.

    Parameters
    ----------
    partial : Path
        The unfinished output.
    header : dict
        What is read and done, as JSON.
    resume, overwrite : bool
        Whether to go on with what an earlier run left, and whether to throw it away.

    Attributes
    ----------
    partial, path : Path
        The unfinished output, and the journal.
    done, mark : int
        Finished blocks, and what the output said after the last.

    Raises
    ------
    FileExistsError
        An earlier run left something and it was not said what to do with it.
    BlockingIOError
        Another run is at work.
    """

    def __init__(self, partial: Path, header: dict[str, Any], *, resume: bool, overwrite: bool) -> None:
        self.partial, self.path = partial, partial.with_name(partial.name + ".journal")
        self.done = self.mark = 0
        self._open()
        try:
            left = os.path.lexists(partial)
            if left and not (resume or overwrite):
                raise FileExistsError(
                    f"{partial}: left by a run that was stopped; give resume=True to go on, overwrite=True to begin "
                    "again"
                )
            line = (json.dumps(header, sort_keys=True) + "\n").encode()
            if left and resume:
                self._believe(line, header["blocks"][-1])
            if not self.done:
                remove(partial)
                self.file.truncate(0)
                self.end = 0
                self._append(line)
        except BaseException:
            if os.fstat(self.file.fileno()).st_size == self.end == 0:
                self.path.unlink(missing_ok=True)
            self.file.close()
            raise

    def _open(self) -> None:
        """Open the journal and lock it."""
        while True:
            # Without a buffer, which would be written once more when a full disk let it fail.
            self.file = open(os.open(self.path, HOW, 0o666), "r+b", buffering=0)  # noqa: SIM115
            self.end = 0
            try:
                self._lock()
                with suppress(FileNotFoundError):
                    if os.path.samestat(os.fstat(self.file.fileno()), os.stat(self.path)):
                        return
            except BaseException:
                self.file.close()
                raise
            # A run that ended meanwhile took its journal away.
            self.file.close()

    def _lock(self) -> None:
        try:
            import fcntl
        except ImportError:  # not to be had there
            return
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BlockingIOError(f"{self.partial}: is being written by another run: wait for its end") from None
        except OSError:  # nor on that file system
            return

    def _believe(self, line: bytes, blocks: int) -> None:
        """Take over what an earlier run wrote, if it was the same run."""
        first, *rest = self.file.read().split(b"\n")
        if first + b"\n" != line:
            warnings.warn(f"{self.partial}: {_difference(first, line)}: beginning again", stacklevel=2)
            return
        # What follows the last line end was cut off.
        notes = rest[:-1]
        try:
            marks = [(int(done), int(mark), int(size)) for done, mark, size in map(bytes.split, notes)]
        except ValueError:
            marks = [(-1, 0, 0)]
        finished = [0, *(done for done, _, _ in marks), blocks + 1]
        if any(before >= after for before, after in itertools.pairwise(finished)):
            warnings.warn(f"{self.partial}: its journal cannot be read: beginning again", stacklevel=2)
            return
        if not marks:
            return
        done, mark, size = marks[-1]
        if self._size() < size:
            warnings.warn(f"{self.partial}: is shorter than its journal says: beginning again", stacklevel=2)
            return
        self.done, self.mark = done, mark
        self.end = len(line) + sum(len(note) + 1 for note in notes)

    def _size(self) -> int:
        """Return the bytes of the unfinished output; those of a store are not counted."""
        return self.partial.stat().st_size if self.partial.is_file() else 0

    def note(self, done: int, mark: int) -> None:
        """Note that the first `done` blocks are durable."""
        self._append(f"{done} {mark} {self._size()}\n".encode())
        self.done, self.mark = done, mark

    def _append(self, line: bytes) -> None:
        """Write a line durably, over what is left of one that failed."""
        self.file.seek(self.end)
        rest = line
        while rest:
            rest = rest[self.file.write(rest) :]
        os.fsync(self.file.fileno())
        self.end += len(line)

    def close(self) -> None:
        """Leave what there is for a later run."""
        self.file.close()

    def remove(self) -> None:
        """Remove the journal, and the unfinished output if it is still there."""
        remove(self.partial)
        self.path.unlink(missing_ok=True)
        self.file.close()


def _difference(first: bytes, line: bytes) -> str:
    """Say what differs between two headers."""
    try:
        before, now = json.loads(first), json.loads(line)
        names = [name for name in now if before.get(name) != now[name]]
    except (ValueError, AttributeError):
        return "its journal cannot be read"
    return f"made by another run ({', '.join(names)} differ)" if names else "made by another run"
