"""Errors in the words of another package."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


@contextmanager
def renamed(names: Mapping[str, str]) -> Iterator[None]:
    """Let errors about an argument name the caller's own, which was passed on as that one."""
    try:
        yield
    except (TypeError, ValueError) as error:
        text = str(error)
        first = re.match(r"\w+", text)
        if first is None or first[0] not in names:
            raise
        # Of units they also say what to take: "pass t.magnitude".
        raise type(error)(re.sub(rf"^{first[0]}\b|\b{first[0]}(?=\.[a-z])", names[first[0]], text)) from None
