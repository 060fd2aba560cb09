"""Ctrl-C that is heard between steps, and not inside of them."""

from __future__ import annotations

import signal
import threading
from concurrent.futures import Future, wait
from types import FrameType
from typing import Any, TypeVar

T = TypeVar("T")

PATIENCE = 0.05
"""Seconds between looks for Ctrl-C where another thread is waited for."""


class Interrupts:
    """A context in which Ctrl-C is noted, to act where `check` is called next, or at the end.

    Inside of the standard library's waiting it would come between taking a lock and keeping in mind that it is taken:
    other threads would wait for ever, or a RuntimeError of the lock take its place. The second Ctrl-C acts at once. In
    other threads than the main one, and where signals are none of Python's, nothing changes.
    """

    def __enter__(self) -> Interrupts:
        self._noted = False
        self._pending: tuple[int, FrameType | None] | None = None
        self._before: Any = None
        before = signal.getsignal(signal.SIGINT)
        if threading.current_thread() is threading.main_thread() and callable(before):
            self._before = before
            signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
        if kind is None:
            self.check()

    def check(self) -> None:
        """Do what Ctrl-C did before, if it was pressed."""
        if self._pending is not None:
            pending, self._pending = self._pending, None
            self._before(*pending)

    def result(self, future: Future[T]) -> T:
        """Return what another thread computes, or raise what it raised."""
        while not wait((future,), PATIENCE).done:
            self.check()
        return future.result()

    def _note(self, signum: int, frame: FrameType | None) -> None:
        if self._noted:
            self._before(signum, frame)
        else:
            self._noted, self._pending = True, (signum, frame)
