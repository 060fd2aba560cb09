"""Streams as JSON can hold them, to the bit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from algdiff._designs import asked as checked
from algdiff._differentiator import rebuild
from algdiff._refusals import shown, told

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator
    from algdiff._stream import AnyStream, Stream

VERSION = 1
OF_THE_SAMPLES = ("channels", "dtype", "warmup", "nan_policy", "min_support", "max_gain")
"""Options that a state must share with a stream that goes on from it."""


def of(stream: Stream) -> dict[str, Any]:
    """Return the state of a stream; numbers that JSON does not have are words."""
    samples, times, count = stream._held()
    design = stream.design
    return {
        "version": VERSION,
        "design": [_asked(one) for one in design] if isinstance(design, tuple) else _asked(design),
        "options": {name: _plain(value) for name, value in stream._words.items()},
        "count": count,
        "samples": [_plain(value) for value in samples],
        "times": times,
    }


def _plain(value: Any) -> Any:
    """Return numbers that JSON does not have as words."""
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _numbers(options: dict[str, Any]) -> dict[str, Any]:
    """Return options with such a word as a number: infinite gains may be allowed."""
    return {name: math.inf if value == "inf" else value for name, value in options.items()}


def _asked(design: Differentiator) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in design._asked.items()}


def restored(cls: type[AnyStream], state: dict[str, Any]) -> AnyStream:
    """Return the stream whose state this is."""
    _check(state)
    try:
        stream = cls(_designs(state), **_numbers(state["options"]))
    except (TypeError, KeyError, AttributeError) as error:
        raise _no_state(error) from None
    put(stream, state)
    return stream


def put(stream: Stream, state: dict[str, Any]) -> None:
    """Make `stream` go on from a state of its own, or of one that was made alike."""
    _check(state)
    try:
        design, options = _designs(state), _numbers(state["options"])
        if unknown := options.keys() - stream._words.keys():
            raise KeyError(*unknown)
        options = {name: options[name] for name in OF_THE_SAMPLES}
    except (TypeError, KeyError, AttributeError) as error:
        raise _no_state(error) from None
    own = {name: stream._words[name] for name in OF_THE_SAMPLES}
    if design != stream.design:
        raise ValueError(f"state must be of a stream with the same design, {stream.design!r}, got {design!r}")
    if options != own:
        wrong = {name: value for name, value in options.items() if value != own[name]}
        allowed = {name: own[name] for name in wrong}
        raise ValueError(f"state must be of a stream with the same options, {allowed}, got {shown(wrong)}")
    try:
        held = [float(value) for value in state["samples"]], [float(value) for value in state["times"]], state["count"]
        stream._restore(*held)
    except (TypeError, ValueError, OverflowError) as error:
        got = f"others ({told(error)})"
        raise ValueError(f"state must hold the samples, times and count of a stream, got {got}") from None


def _check(state: object) -> None:
    names = ("version", "design", "options", "count", "samples", "times")
    if not isinstance(state, dict) or not all(name in state for name in names):
        raise ValueError(f"state must be a dict with {', '.join(names)}, got {shown(state)}")
    if state["version"] != VERSION:
        raise ValueError(f"state must be of version {VERSION}, got {shown(state['version'])}")


def _no_state(error: Exception) -> ValueError:
    return ValueError(f"state must hold the design and the options of a stream, got others ({told(error)})")


def _designs(state: dict[str, Any]) -> Differentiator | tuple[Differentiator, ...]:
    design = state["design"]
    return tuple(_design(one) for one in design) if isinstance(design, list) else _design(design)


def _design(asked: dict[str, Any]) -> Differentiator:
    deriv = asked["deriv"]
    words = {**asked, "deriv": tuple(deriv) if isinstance(deriv, list) else deriv}
    return rebuild(checked(**words, fs=None))
