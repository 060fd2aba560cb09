"""The questions of the designer page: what they may ask, and beside which control they are refused."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from algdiff._designer.recording import Recording

LONGEST = 100_001
"""The longest window of the page, which is to answer within some seconds."""
HIGHEST = 50
"""And the highest degree."""
STEEPEST = 100
"""The largest exponent of the weight: designs of larger ones take long, and are of no use."""
WORK = 2_500_000
"""Window times degree and order together, at most: what takes some three seconds."""
WIDTHS = (280, 1600)
"""Charts are as wide as the page asks for, within these."""
TAUS = ("center", "root", "newest")
DATA = ("column", "from", "to")
OWN = ("window", "deriv", "degree", "kappa", "mu", "tau", "delay", "fs", "delta")
"""What makes a design."""
NAMES = {"window_length": "window", "fs": "step", "delta": "step", "tau": "delay", "x": "data"}
"""What the page calls the arguments of the library."""


class RefusedError(ValueError):
    """What cannot be answered.

    Parameters
    ----------
    message : str
        What the page shows.
    control : str
        The control beside which it does.
    """

    def __init__(self, message: str, control: str) -> None:
        super().__init__(message)
        self.control = control

    @classmethod
    def of(cls, error: Exception) -> RefusedError:
        """Return what the library says, beside the control of the argument that it names first."""
        said = " ".join(str(error).split()) or type(error).__name__
        found = re.match(r"(?:give )?(window_length|deriv|degree|kappa|mu|tau|delay|fs|delta|x)\b", said)
        name = found[1] if found else "window"
        return cls(said, NAMES.get(name, name))


class Query(NamedTuple):
    """A question, read.

    Attributes
    ----------
    words : dict
        Arguments of `Differentiator`.
    column, start, stop : int
        The column that is shown, and which of its samples.
    width : int
        Of the charts.
    """

    words: dict[str, Any]
    column: int
    start: int
    stop: int
    width: int


def asked(given: Mapping[str, str], recording: Recording) -> Query:
    """Read a question, or raise RefusedError; what is left out has the library's default."""
    known = (*OWN, *DATA, "width")
    for name in given:
        if name not in known:
            raise RefusedError(f"{name!r:.40} is no parameter: must be one of {', '.join(known)}", "window")
    words: dict[str, Any] = {"window_length": _integer(given, "window", 1, LONGEST, 101)}
    words["deriv"] = _integer(given, "deriv", 0, HIGHEST, 1)
    if "degree" in given:
        words["degree"] = _integer(given, "degree", 0, HIGHEST, 0)
    for name in ("kappa", "mu", "delay", "fs", "delta"):
        if name in given:
            words[name] = _real(given, name)
    _check_work(given, words)
    if "tau" in given:
        words["tau"] = given["tau"] if given["tau"] in TAUS else _real(given, "tau")
    column = _integer(given, "column", 0, len(recording.columns) - 1, 0)
    start = _integer(given, "from", 0, recording.count - 1, 0)
    stop = _integer(given, "to", start + 1, recording.count, recording.count)
    return Query(words, column, start, stop, _integer(given, "width", *WIDTHS, 560))


def _check_work(given: Mapping[str, str], words: Mapping[str, Any]) -> None:
    """Raise RefusedError for what would take long."""
    for name in ("kappa", "mu"):
        if words.get(name, 0.0) > STEEPEST:
            raise RefusedError(f"{name} must be at most {STEEPEST} on this page, got {_short(given[name])}", name)
    deriv, degree, window = words["deriv"], words.get("degree", 0), words["window_length"]
    most = WORK // max(deriv + degree, 1)
    if window > most:
        what = f"at order {deriv} and degree {degree} on this page"
        raise RefusedError(f"window must be at most {most} {what}, got {window}", "window")


def _integer(given: Mapping[str, str], name: str, least: int, most: int, default: int) -> int:
    text = given.get(name)
    if text is None:
        return default
    if not re.fullmatch(r"-?[0-9]{1,12}", text) or not least <= int(text) <= most:
        raise RefusedError(f"{name} must be a whole number from {least} to {most}, got {_short(text)}", _control(name))
    return int(text)


def _real(given: Mapping[str, str], name: str) -> float:
    try:
        return float(given[name])
    except ValueError:
        raise RefusedError(f"{name} must be a number, got {_short(given[name])}", _control(name)) from None


def _control(name: str) -> str:
    return NAMES.get(name, {"to": "from", "column": "data"}.get(name, name))


def _short(text: str) -> str:
    return f"{text!r:.60}" if text else "nothing"
