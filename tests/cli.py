"""The command line, run in this process or in one of its own, and what it prints and leaves."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from algdiff._cli import main

WINDOW = 21
N = 200


@pytest.fixture
def x() -> np.ndarray:
    rng = np.random.default_rng(7)
    return np.sin(0.05 * np.arange(N)) + 0.01 * rng.standard_normal(N)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(source: object, target: object, *more: object) -> int:
    return main(["run", str(source), str(target), "--window", str(WINDOW), *map(str, more)])


def leftovers(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name.startswith(".") or "partial" in path.name)


def error_line(capsys: pytest.CaptureFixture[str]) -> str:
    """Return the only line on stderr, without its prefix."""
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("algdiff: error: ")
    return line.removeprefix("algdiff: error: ")


def process(*arguments: object, code: str | None = None, **options: object) -> subprocess.Popen[str]:
    """Start ``python -m algdiff``, or `code`, with Ctrl-C enabled, which a background shell may have switched off."""
    reset = None if os.name == "nt" else (lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    command = [sys.executable, *(["-m", "algdiff"] if code is None else ["-c", code]), *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "preexec_fn": reset, **options}
    return subprocess.Popen(command, **pipes)  # type: ignore[call-overload, no-any-return]


class Csv(NamedTuple):
    """A table as Python's own reader reads it."""

    header: list[str] | None
    array: np.ndarray


def read_csv(path: str, delimiter: str = ",") -> Csv:
    with open(path, encoding="utf-8", newline="") as file:
        first, *rest = csv.reader(file, delimiter=delimiter)
    try:
        return Csv(None, np.array([first, *rest], dtype=float))
    except ValueError:
        return Csv(first, np.array(rest, dtype=float))
