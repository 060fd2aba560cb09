"""How far a run has come, in a file beside its unfinished output."""

from __future__ import annotations

import json
import os
import warnings
from pathlib import Path
from typing import Any

from algdiff._output import remove


class Journal:
    """The journal of one run: what was asked for, and after every checkpoint how many blocks are safe.

    The first line says what the run reads and does; another run goes on from here only if it would say the same to the
    letter. Every other line holds the blocks that are finished and durable, and what the output needs to go on
    there. A line that a crash cut off does not count. While a run has the file open, it is locked.

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
        left = os.path.lexists(partial)
        if left and not (resume or overwrite):
            raise FileExistsError(
                f"{partial}: left by a run that was stopped; give resume=True to go on, overwrite=True to begin again"
            )
        self.file = open(os.open(self.path, os.O_RDWR | os.O_CREAT, 0o666), "r+", encoding="utf-8")  # noqa: SIM115
        try:
            self._lock()
            line = json.dumps(header, sort_keys=True) + "\n"
            if left and resume:
                self._believe(line)
            if not self.done:
                remove(partial)
                self.file.seek(0)
                self.file.truncate()
                self.file.write(line)
                self._flush()
        except BaseException:
            self.file.close()
            raise

    def _lock(self) -> None:
        try:
            import fcntl
        except ImportError:  # not to be had there
            return
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise BlockingIOError(f"{self.partial}: is being written by another run") from None

    def _believe(self, line: str) -> None:
        """Take over what an earlier run wrote, if it was the same run."""
        first, *rest = self.file.read().split("\n")
        if first + "\n" != line:
            warnings.warn(f"{self.partial}: {_difference(first, line)}: beginning again", stacklevel=2)
            return
        # What follows the last line end was cut off.
        notes = rest[:-1]
        try:
            marks = [(int(done), int(mark)) for done, mark in map(str.split, notes)]
        except ValueError:
            warnings.warn(f"{self.partial}: its journal cannot be read: beginning again", stacklevel=2)
            return
        if marks:
            self.done, self.mark = marks[-1]
        self.file.seek(len((first + "\n").encode()) + sum(len(note) + 1 for note in notes))
        self.file.truncate()

    def note(self, done: int, mark: int) -> None:
        """Note that the first `done` blocks are durable."""
        self.file.write(f"{done} {mark}\n")
        self._flush()
        self.done, self.mark = done, mark

    def _flush(self) -> None:
        self.file.flush()
        os.fsync(self.file.fileno())

    def close(self) -> None:
        """Leave what there is for a later run."""
        self.file.close()

    def remove(self) -> None:
        """Remove the journal, and the unfinished output if it is still there."""
        remove(self.partial)
        self.path.unlink(missing_ok=True)
        self.file.close()


def _difference(first: str, line: str) -> str:
    """Say what differs between two headers."""
    try:
        before, now = json.loads(first), json.loads(line)
        names = [name for name in now if before.get(name) != now[name]]
    except (ValueError, AttributeError):
        return "its journal cannot be read"
    return f"made by another run ({', '.join(names)} differ)" if names else "made by another run"
