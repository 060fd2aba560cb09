"""Runs over files that are stopped in the middle, and what must be left of them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import _file_run, _places

LEFT = {"y.npy.partial", "y.npy.partial.journal"}


def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut files into blocks of a few samples, each of which is a checkpoint."""
    monkeypatch.setattr(_places, "BLOCK", 1 << 12)
    monkeypatch.setattr(_file_run, "INTERVAL", 0.0)


def stop_at(most: float) -> Any:
    """Return a progress that is interrupted, as by Ctrl-C, when so much is done."""

    def progress(fraction: float) -> None:
        if fraction >= most:
            raise KeyboardInterrupt

    return progress


def stopped(*args: Any, at: float = 0.5, **words: Any) -> None:
    """Begin what `differentiate_file` does, and stop in the middle."""
    with pytest.raises(KeyboardInterrupt, match=r"is kept in .*: go on with resume=True$"):
        algdiff.differentiate_file(*args, **words, progress=stop_at(at))


def assert_result(path: str | Path, expected: np.ndarray[Any, Any], kept: set[str]) -> None:
    """Assert that a result is right to the bit, and that beside it there are only the files in `kept`."""
    found = np.load(path)
    assert (found.shape, found.dtype) == (expected.shape, expected.dtype)
    assert found.tobytes() == expected.tobytes()
    assert set(os.listdir()) == {str(path), *kept}
