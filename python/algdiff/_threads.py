"""How many threads a call may use."""

from __future__ import annotations

import os
import sys

from algdiff import _arguments as arguments


def count(threads: object) -> int:
    """Return the number of threads to use; 0 leaves it to the core.

    Whoever asks for a number gets it, by the argument or the environment. Inside a task of Dask it is one: Dask runs as
    many tasks at a time as there are processors.
    """
    if threads is not None:
        return arguments.integer("threads", threads, 1)
    wanted = os.environ.get("ALGDIFF_NUM_THREADS", "")
    if not wanted:
        return 1 if in_dask() else 0
    if not (wanted.isdecimal() and int(wanted) > 0):
        raise ValueError(f"ALGDIFF_NUM_THREADS must be a positive integer, got {wanted!r}")
    return int(wanted)


def in_dask() -> bool:
    """Return whether this is a task of a Dask worker, or of Dask's own schedulers for threads and processes."""
    return ("distributed" in sys.modules and _on_worker()) or ("dask.local" in sys.modules and _in_local_task())


def _on_worker() -> bool:
    get_worker = getattr(sys.modules["distributed"], "get_worker", None)
    if get_worker is None:  # still being imported
        return False
    try:
        get_worker()
    except ValueError:
        return False
    return True


def _in_local_task() -> bool:
    """Look for a task of `dask.local` among the callers; one that the synchronous scheduler runs has no neighbours."""
    frame, found = sys._getframe(1), False
    while frame.f_back is not None:
        frame = frame.f_back
        if frame.f_globals.get("__name__") == "dask.local":
            if frame.f_code.co_name == "get_async":
                return False
            found = found or frame.f_code.co_name == "execute_task"
    return found
