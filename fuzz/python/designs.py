"""What others hand over as text: a design in JSON, a journal, the state of a stream, a question of the designer page.

The first byte says which of them the others make. Sizes that would be allowed but take long are left out.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import atheris
import numpy as np

with atheris.instrument_imports(include=["algdiff"]):
    from algdiff import Differentiator, Stream
    from algdiff._cli_report import DESIGN, _design_of
    from algdiff._designer.query import DATA, OWN, RefusedError, asked
    from algdiff._designer.recording import Recording
    from algdiff._journal import Journal
from common import main, only

FOLDER = Path(tempfile.mkdtemp())
PATH, PARTIAL = FOLDER / "design.json", FOLDER / "x.npy.part"
HEADER = {"blocks": [3, 4], "src": ["x.npy", 1, 2], "words": {"deriv": 1}}
LINE = (json.dumps(HEADER, sort_keys=True) + "\n").encode()
RECORDING = Recording("x", ("a", "b"), np.zeros((2, 50)), 0.1)
LONG, LARGE = 400, 12
"""Windows, and degrees and channels, that are computed, unless they are so large that they have to be refused."""
NUMBERS = (0, 1, -1, 2, 3, 5, 0.5, -0.5, 1e-300, 1e300, math.nan, math.inf, -math.inf, 2**31, 2**63, 2**64, 10**40, 1e6)
WORDS = ("center", "root", "newest", "exact", "hat", "trapezoid", "auto", "omit", "nan", "inf", "", "f4", "\ud800", "é")
CASES = (
    Differentiator(5, degree=2),
    Differentiator(9, (0, 1), degree=3, kappa=0.5, delta=0.1),
    Differentiator(21, trim=0.01),
    Differentiator(27, 2, tau="newest", rule="trapezoid", fs=100),
)


def one(data: bytes) -> None:
    """Read one of them."""
    given = atheris.FuzzedDataProvider(data[1:])
    if not data:
        return
    match data[0] % 6:
        case 0:
            design(data[1:])
        case 1:
            design(json.dumps(changed(given, stated(CASES[given.ConsumeIntInRange(0, len(CASES) - 1)]))).encode())
        case 2:
            journal(given)
        case 3:
            state(changed(given, json.loads(json.dumps(STATES[given.ConsumeIntInRange(0, len(STATES) - 1)]))))
        case 4:
            question({text(given): text(given) for _ in range(given.ConsumeIntInRange(0, 5))})
        case _:
            question(words(given))


def stated(design: Differentiator) -> dict[str, Any]:
    """Return a design as ``algdiff design --json`` says it."""
    words = {name: getattr(design, name) for name in DESIGN}
    return {**words, "weights": np.asarray(design.weights).tolist()}


def states() -> list[dict[str, Any]]:
    """Return the states of streams."""
    found = []
    for number, one in enumerate(CASES):
        plain = one.stream(channels=2)
        plain.push(np.arange(2.0 * (4 * number + 2)).reshape(-1, 2))
        found.append(plain.state)
    for one in CASES[:2]:
        fitted = one.stream(nan_policy="omit", warmup="grow")
        fitted.push([1.0, math.nan, 3.0, 4.0, 5.0])
        found.append(fitted.state)
    timed = CASES[0].stream(warmup="grow")
    timed.push([1.0, 2.0, 3.0], t=[0.0, 0.4, 1.0])
    return [*found, timed.state]


STATES = states()


def value(given: Any, depth: int = 2) -> Any:
    """Return any value that JSON has."""
    match given.ConsumeIntInRange(0, 9 if depth else 6):
        case 0 | 1:
            return NUMBERS[given.ConsumeIntInRange(0, len(NUMBERS) - 1)]
        case 2:
            return given.ConsumeIntInRange(-3, 40)
        case 3:
            return given.ConsumeFloat()
        case 4:
            return WORDS[given.ConsumeIntInRange(0, len(WORDS) - 1)]
        case 5:
            return (None, True, False)[given.ConsumeIntInRange(0, 2)]
        case 6:
            return text(given)
        case 7 | 8:
            return [value(given, depth - 1) for _ in range(given.ConsumeIntInRange(0, 3))]
        case _:
            return {text(given): value(given, depth - 1) for _ in range(given.ConsumeIntInRange(0, 2))}


def text(given: Any) -> str:
    """Return any text."""
    return str(given.ConsumeUnicode(given.ConsumeIntInRange(0, 12)))


def changed(given: Any, whole: Any) -> Any:
    """Return `whole` with some values changed, left out, or put beside."""
    for _ in range(given.ConsumeIntInRange(0, 4)):
        here = whole
        while isinstance(here, (dict, list)) and here:
            keys = list(here) if isinstance(here, dict) else range(len(here))
            key = keys[given.ConsumeIntInRange(0, len(keys) - 1)]
            inside = here[key]
            if isinstance(inside, (dict, list)) and inside and given.ConsumeIntInRange(0, 4):
                here = inside
                continue
            match given.ConsumeIntInRange(0, 7):
                case 0:
                    del here[key]
                case 1 if isinstance(here, dict):
                    here[text(given)] = value(given)
                case 1:
                    here.append(value(given))
                case _:
                    here[key] = value(given)
            break
    return whole


def takes_long(found: Any) -> bool:
    """Say whether something of this design, or of a part of it, is allowed and takes long."""
    if isinstance(found, list):
        return any(map(takes_long, found))
    if not isinstance(found, dict):
        return False
    for name, inside in found.items():
        most = {"window_length": LONG, "degree": LARGE, "channels": LARGE, "deriv": LARGE}.get(name)
        numbers = inside if isinstance(inside, list) else [inside]
        if most and any(isinstance(one, (int, float)) and most < one <= 2**40 for one in numbers):
            return True
    return any(map(takes_long, found.values()))


def design(content: bytes) -> None:
    """Read a design from JSON."""
    try:
        if takes_long(json.loads(content)):
            return
    except (ValueError, RecursionError):
        pass
    PATH.write_bytes(content)
    with only(ValueError, OSError):
        read = _design_of(str(PATH))
        assert np.isfinite(read.weights).all()
        assert repr(read)


def journal(given: Any) -> None:
    """Go on with a run whose journal holds any lines."""
    size = given.ConsumeIntInRange(0, 99)
    notes = [
        b"%d %d %d" % tuple(given.ConsumeIntInRange(-1, 13) for _ in range(3))
        if given.ConsumeBool()
        else given.ConsumeBytes(given.ConsumeIntInRange(0, 9))
        for _ in range(given.ConsumeIntInRange(0, 5))
    ]
    first = LINE if given.ConsumeIntInRange(0, 3) else given.ConsumeBytes(20) + b"\n"
    PARTIAL.write_bytes(bytes(size))
    PARTIAL.with_name(PARTIAL.name + ".journal").write_bytes(first + b"\n".join(notes) + given.ConsumeBytes(1))
    found = []
    for _ in range(2):
        with only(FileExistsError, BlockingIOError):
            run = Journal(PARTIAL, HEADER, resume=True, overwrite=False)
            assert 0 <= run.done <= HEADER["blocks"][-1]  # type: ignore[operator]
            found.append((run.done, run.mark))
            run.close()
            if not run.done:
                PARTIAL.write_bytes(b"")
    assert found[0] == found[1], found


def state(found: Any) -> None:
    """Go on with a stream, which then has the same state and takes samples."""
    if takes_long(found):
        return
    with only(ValueError, MemoryError):
        stream = Stream.from_state(found)
        again = Stream.from_state(json.loads(json.dumps(stream.state)))
        assert json.dumps(again.state) == json.dumps(stream.state)
        x = np.ones((2, *((stream.channels,) if stream.channels is not None else ())))
        timed = {"t": 1e9 + np.arange(2.0)} if stream.state["times"] else {}
        stream.push(x, **timed)


def words(given: Any) -> dict[str, str]:
    """Return a question with names that are known."""
    names, found = (*OWN, *DATA, "width"), {}
    for _ in range(given.ConsumeIntInRange(0, 6)):
        name = names[given.ConsumeIntInRange(0, len(names) - 1)]
        found[name] = str(value(given, 0)) if given.ConsumeBool() else str(given.ConsumeIntInRange(-1, 60))
    return found


def question(found: dict[str, str]) -> None:
    """Read a question, and make the design that it asks for."""
    with only(RefusedError):
        words = asked(found, RECORDING).words
        if not takes_long(words):
            try:
                Differentiator(**words)
            except (ValueError, TypeError, OverflowError) as error:
                raise RefusedError.of(error) from None


def seeds() -> Sequence[bytes]:
    """Return designs as they are printed, and bytes that make the others."""
    found = [b"\0" + json.dumps(stated(case)).encode() for case in CASES]
    rng = np.random.default_rng(0)
    return [*found, *(bytes([kind]) + rng.bytes(60) for kind in range(6) for _ in range(8))]


if __name__ == "__main__":
    main(one, seeds)
