"""The warning of the package, and whom it is for."""

import sys


class DesignWarning(UserWarning):
    """A design that works, but not as its user may expect."""


def outside() -> int:
    """Return the stack level, seen from the caller, of the first frame outside of this package."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("algdiff."):
        level, frame = level + 1, frame.f_back
    return level
