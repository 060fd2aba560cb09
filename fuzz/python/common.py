"""What the targets share: how errors are judged, and the loop of atheris around a function of bytes."""

from __future__ import annotations

import hashlib
import resource
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import atheris

MEMORY = 4 << 30
"""Bytes of addresses that a target may use: what is computed wrongly from a header ends there."""
LONGEST = 1000
"""Characters of a message, at most."""

Error = type[BaseException]


@contextmanager
def only(*allowed: Error) -> Iterator[None]:
    """Let errors of these types pass whose message is one line."""
    try:
        yield
    except allowed as error:
        # What is a kind of an allowed error may be none that was meant.
        if isinstance(error, UnicodeError):
            raise
        said = str(error)
        if not said.strip() or len(said.splitlines()) != 1 or len(said) > LONGEST:
            raise AssertionError(f"the message of {type(error).__name__} is {said!r}") from error


def main(target: Callable[[bytes], None], seeds: Callable[[], Sequence[bytes]]) -> None:
    """Fuzz `target`; with ``--seeds FOLDER``, write what it starts from instead."""
    if len(sys.argv) == 3 and sys.argv[1] == "--seeds":
        folder = Path(sys.argv[2])
        folder.mkdir(parents=True, exist_ok=True)
        for number, seed in enumerate(seeds()):
            (folder / f"seed-{number:03}").write_bytes(seed)
        return
    # Those of algdiff are meant; those of NumPy show that something was not thought of.
    warnings.simplefilter("ignore")
    warnings.simplefilter("error", RuntimeWarning)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    prefix = next((word.partition("=")[2] for word in sys.argv if word.startswith("-artifact_prefix=")), "")

    def kept(data: bytes) -> None:
        try:
            target(data)
        except BaseException:
            # As libFuzzer does it, unless the process ends too soon.
            Path(f"{prefix}crash-{hashlib.sha1(data).hexdigest()}").write_bytes(data)  # noqa: S324 - a name
            raise

    atheris.Setup(sys.argv, kept)
    atheris.Fuzz()
