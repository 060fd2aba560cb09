"""The arguments of a design, checked; and finished designs, remembered for the next call."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from algdiff import _arguments as arguments
from algdiff import _orders as orders
from algdiff._refusals import named

Made = TypeVar("Made")

ENTRIES = 64
"""Designs that are remembered, at most."""

NUMBERS = 1 << 16
"""Numbers of double precision in one of them, at most: long windows are designed anew, and take as long to run."""

CONSTANT = (int, float, str, type(None), tuple)
"""Types of arguments that cannot change while they are remembered; so do not NumPy's numbers."""


def asked(
    window_length: object,
    deriv: object,
    degree: object,
    kappa: object,
    mu: object,
    tau: object,
    delay: object,
    delta: object,
    fs: object,
    rule: object,
    trim: object,
    engine: object,
) -> dict[str, Any]:
    """Return the arguments of a `Differentiator`, checked as far as they can be one by one."""
    if tau is not None and delay is not None:
        raise ValueError(f"give tau or delay, not both: got {named(tau=tau, delay=delay)}")
    share = arguments.real("trim", trim)
    if delay is not None and share != 0:
        raise ValueError(
            f"give delay or trim, not both: got {named(delay=delay, trim=trim)}; what is left out at the newest "
            "end shortens the delay, so say tau"
        )
    values = {
        "window_length": arguments.integer("window_length", window_length, 1),
        "deriv": orders.checked(deriv),
        "degree": None if degree is None else arguments.integer("degree", degree, 0),
        "kappa": arguments.real("kappa", kappa),
        "mu": arguments.real("mu", mu),
        "tau": None if tau is None else arguments.word_or_real("tau", tau),
        "delay": None if delay is None else arguments.real("delay", delay),
        "delta": arguments.sampling_step(delta, fs),
        "rule": arguments.word("rule", rule, "a word such as 'exact'"),
        "trim": share,
        "engine": arguments.word("engine", engine, "a word such as 'auto'"),
    }
    if isinstance(values["deriv"], tuple) and len(values["deriv"]) > 1:
        several = f"deriv = {values['deriv']}, as every order has a window of its own: give one order"
        if values["tau"] == "root":
            raise ValueError(f"tau must not be 'root' for several orders, got {several}, or a number for tau")
        if share != 0:
            raise ValueError(f"trim must be 0 for several orders, got {named(trim=trim)} and {several}")
    return values


class _TooLargeError(Exception):
    """Carries what was made but is not to be remembered."""


def remembered(make: Callable[..., tuple[Made, int]]) -> Callable[..., Made]:
    """Remember what `make` makes of positional arguments: that and how many numbers it holds, which must be few.

    Arguments count as the same if they are equal and of one type, so that True, 1 and 1.0 are not. Those that may
    change, or have no hash, are always passed on to `make`; and so are those that it refuses.
    """

    @lru_cache(maxsize=ENTRIES, typed=True)
    def keep(*words: object) -> Made:
        made, numbers = make(*words)
        if numbers > NUMBERS or not all(type(word) in CONSTANT or isinstance(word, np.number) for word in words):
            raise _TooLargeError(made)
        return made

    def find(*words: object) -> Made:
        try:
            return keep(*words)
        except _TooLargeError as passed:
            made: Made = passed.args[0]
            return made
        except TypeError:  # of the hash, or of `make`, which then says it again
            pass
        return make(*words)[0]

    find.kept, find.forget = keep.cache_info, keep.cache_clear  # type: ignore[attr-defined]
    return find
