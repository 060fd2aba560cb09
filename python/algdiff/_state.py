"""Streams as JSON can hold them, to the bit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from algdiff._designs import asked as checked
from algdiff._differentiator import rebuild

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator
    from algdiff._stream import Stream

VERSION = 1


def of(stream: Stream) -> dict[str, Any]:
    """Return the state of a stream; numbers that JSON does not have are words."""
    samples, times, count = stream._held()
    design = stream.design
    return {
        "version": VERSION,
        "design": [_asked(one) for one in design] if isinstance(design, tuple) else _asked(design),
        "options": dict(stream._words),
        "count": count,
        "samples": [value if math.isfinite(value) else str(value) for value in samples],
        "times": times,
    }


def _asked(design: Differentiator) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in design._asked.items()}


def made_from(state: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Return the design and the options of the stream whose state this is."""
    _check(state)
    design = state["design"]
    try:
        made = tuple(_design(one) for one in design) if isinstance(design, list) else _design(design)
        return made, dict(state["options"])
    except (TypeError, KeyError) as error:
        raise ValueError(f"state must hold a design and the options of a stream: {error}") from None


def put(stream: Stream, state: dict[str, Any]) -> None:
    """Make `stream` go on from a state of its own, or of one that was made alike."""
    _check(state)
    own = of(stream)
    for name in ("design", "options"):
        if state[name] != own[name]:
            raise ValueError(f"state must be of a stream with the same {name}, {own[name]}, got {state[name]}")
    try:
        samples, times, count = [float(value) for value in state["samples"]], list(state["times"]), state["count"]
        stream._restore(samples, times, count)
    except (TypeError, OverflowError) as error:
        raise ValueError(f"state must hold numbers as samples, times and count: {error}") from None


def _check(state: object) -> None:
    names = ("version", "design", "options", "count", "samples", "times")
    if not isinstance(state, dict) or not all(name in state for name in names):
        raise ValueError(f"state must be a dict with {', '.join(names)}, got {state!r:.200}")
    if state["version"] != VERSION:
        raise ValueError(f"state must be of version {VERSION}, got {state['version']!r}")


def _design(asked: dict[str, Any]) -> Differentiator:
    deriv = asked["deriv"]
    words = {**asked, "deriv": tuple(deriv) if isinstance(deriv, list) else deriv}
    return rebuild(checked(**words, fs=None))
