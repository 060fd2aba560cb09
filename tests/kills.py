"""Runs over files in processes that are killed at random, again and again, until their results are whole."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

SAMPLES = 250_000
CALL = {"window_length": 4001, "engine": "direct", "threads": 1, "memory": 1 << 20}
"""Heavy for its bytes, and in blocks as short as a window allows: with the samples above about a hundred."""

CHILD = """
import json, signal, sys
import algdiff
signal.signal(signal.SIGINT, signal.default_int_handler)
from algdiff import _file_run, _places
from algdiff._formats import chunks
source, target, words = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
_places.BLOCK, _file_run.INTERVAL, chunks.CHUNK = 1 << 12, 0.0, 1 << 15
algdiff.differentiate_file(source, target, **words, dry_run=True)  # loads what the formats need
print("begun", flush=True)
report = algdiff.differentiate_file(source, target, **words, resume=True)
print(json.dumps(report.to_dict()))
"""
"""What is killed: every block is a checkpoint, and a warning is an error."""


class Hunt:
    """Runs that make the same result in a folder, one process after the other.

    Parameters
    ----------
    folder : Path
        Where everything lies.
    suffix : str
        The format of the result.

    Attributes
    ----------
    kills : int
        Processes that were killed before the result was whole.
    blocks : int
        Of which a result is made.
    finished : int
        Results that got whole.
    resumed : int
        Blocks that the processes which finished them found finished.
    wrong : list of str
        What was not as it should be.
    """

    def __init__(self, folder: Path, suffix: str) -> None:
        self.folder, self.source, self.target = folder, folder / "x.npy", folder / f"y{suffix}"
        self.kills = self.finished = self.resumed = self.before = 0
        self.wrong: list[str] = []
        np.save(self.source, np.random.default_rng(1).standard_normal(SAMPLES))
        reference = folder / f"z{suffix}"
        child = begin(self.source, reference)
        out, err = child.communicate()
        if child.returncode != 0:
            raise RuntimeError(err)
        self.blocks = int(json.loads(out)["blocks"])
        self.expected, self.names = content(reference), {path.name for path in folder.iterdir()}

    def life_of_one(self, blocks: int | None, seconds: float = 0.0) -> bool:
        """Let a process live until it has finished so many blocks more, and for so long, or to its end.

        Returns whether the result is whole.
        """
        child = begin(self.source, self.target)
        if blocks is not None:
            while noted(self.target) < self.before + blocks and child.poll() is None:
                time.sleep(0.0005)
            time.sleep(seconds)
            child.kill()
        out, err = child.communicate()
        if child.returncode > 0:
            raise RuntimeError(f"after {self.kills} kills: {err}")
        if child.returncode == 0:
            self.resumed += json.loads(out)["resumed"]
        if self.target.exists():
            self._finish(killed=child.returncode < 0)
            return True
        now = noted(self.target)
        if now < self.before:
            self._complain(f"{self.before - now} finished blocks are lost")
        self.kills, self.before = self.kills + 1, now
        return False

    def _finish(self, *, killed: bool) -> None:
        self.finished, self.before = self.finished + 1, 0
        if killed:
            # Between the last steps the journal may be left, and the first of the two names that a file then has.
            partial = Path(f"{self.target}.partial")
            for rest in (partial, partial.with_name(f"{partial.name}.journal")):
                if rest.is_file():
                    rest.unlink()
        left = {path.name for path in self.folder.iterdir()} - self.names - {self.target.name}
        if left:
            self._complain(f"there is {', '.join(sorted(left))}")
        if content(self.target) != self.expected:
            self._complain("the result is another one")

    def _complain(self, what: str) -> None:
        self.wrong.append(f"after {self.kills} kills: {what}")


def kill(folder: Path, suffix: str, kills: int, seed: int = 0) -> Hunt:
    """Kill processes that make a result in `folder`, after random times, until so many have been killed.

    A result that gets whole before is compared and made anew; the last one is finished in peace.
    """
    hunt, rng = Hunt(folder, suffix), np.random.default_rng(seed)
    while hunt.kills < kills:
        # Some die at once, some in the last steps, and a few are too late; the last one leaves something.
        last = hunt.kills == kills - 1
        blocks = rng.integers(int(last), max(3 * hunt.blocks // kills, 2))
        if hunt.life_of_one(min(blocks, hunt.blocks - hunt.before), rng.uniform(0, 0.02)):
            remove(hunt.target)
    hunt.life_of_one(None)
    return hunt


def begin(source: Path, target: Path, **words: Any) -> subprocess.Popen[str]:
    """Start a process that goes on with a run; return when it has loaded everything."""
    command = [sys.executable, "-W", "error", "-c", CHILD, str(source), str(target), json.dumps({**CALL, **words})]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert child.stdout is not None
    if child.stdout.readline() != "begun\n":
        raise RuntimeError(child.communicate()[1])
    return child


def content(path: Path) -> dict[str, bytes]:
    """Return the bytes of a file, or of all files of a store; of HDF5 the numbers, for it keeps what was deleted."""
    if path.suffix == ".h5":
        import h5py

        with h5py.File(path) as file:
            return {name: file[name][...].tobytes() for name in file}
    if path.is_dir():
        return {str(one.relative_to(path)): one.read_bytes() for one in path.rglob("*") if one.is_file()}
    return {"": path.read_bytes()}


def remove(path: Path) -> None:
    """Remove a file or a store."""
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def noted(target: Path) -> int:
    """Return how many blocks a journal says are finished."""
    journal = Path(f"{target}.partial.journal")
    lines = journal.read_bytes().split(b"\n")[1:-1] if journal.exists() else []
    return int(lines[-1].split()[0]) if lines else 0
