"""What a report says to have the same again: in Python, and on the command line."""

from __future__ import annotations

import html
import shlex
from typing import TYPE_CHECKING

from algdiff import _cli_auto
from algdiff._cli import POLICIES

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from algdiff import Differentiator
    from algdiff._pages.loading import Loading

WHERE = ("axis", "key", "columns", "time", "dtype", "channels", "offset", "nan_policy")
SAID = (
    *("window", "deriv", "degree", "kappa", "mu", "rule", "trim", "engine", "tau", "delay", "delta", "fs"),
    *_cli_auto.OWN,
    *WHERE,
)
"""Options that decide what is on the page."""
PLAIN = {"deriv": 1, "kappa": 1.0, "mu": 1.0, "tau": 0.5, "rule": "exact", "trim": 0.0, "delta": 1.0}
"""Arguments that need not be said."""
UNPRINTABLE = "NAME"
"""What stands for a name that a page cannot hold."""
DEFAULTS = {"deriv": 1, "offset": 0, "nan_policy": POLICIES[0]}


def given(options: argparse.Namespace, names: Sequence[str] = SAID) -> list[str]:
    """Return the options that were given, of those that decide what is on the page, as words."""
    words = []
    for name in names:
        value = getattr(options, name)
        if value is not None and value != DEFAULTS.get(name):
            unit = getattr(value, "unit", None) or ""
            unit = {"ms": "s", "us": "s", "kHz": "Hz"}.get(unit, unit)
            plain = ",".join(value) if isinstance(value, tuple) else f"{float(value)!r}{unit}" if unit else str(value)
            option = f"--{name.replace('_', '-')}"
            # What begins with a dash would be taken for another option.
            words += [f"{option}={plain}"] if plain.startswith("-") else [option, plain]
    return words


def command(options: argparse.Namespace) -> str:
    """Return the command that wrote the page."""
    return _line(["algdiff", "report", _source(options), *given(options)])


def run_command(options: argparse.Namespace, design: Differentiator) -> str:
    """Return the command that writes the estimates into a file."""
    words = ["algdiff", "run", _source(options), "OUT.npy", "--window", str(design.window_length)]
    for name in ("deriv", "degree", "kappa", "mu", "tau", "rule", "trim"):
        value = getattr(design, name)
        words += [f"--{name}", str(value)] if PLAIN.get(name) != value else []
    if options.engine is not None:
        words += ["--engine", options.engine]
    return _line([*words, *given(options, ("delta", "fs", *WHERE))])


def _source(options: argparse.Namespace) -> str:
    """Return the input such that it is not taken for an option."""
    return f"./{options.source}" if options.source.startswith("-") else str(options.source)


def _line(words: Sequence[str]) -> str:
    """Return words as a shell takes them; what a page cannot hold is named instead."""
    held = [word if _printable(word) else UNPRINTABLE for word in words]
    note = f"  # {UNPRINTABLE}: what cannot be printed here" if held != list(words) else ""
    return shlex.join(held) + note


def _printable(word: str) -> bool:
    """Return whether a word can be copied from a page: no undecodable bytes, no control characters, one line."""
    from algdiff._svg.chart import text

    return html.unescape(text(word)) == word and len(word.splitlines()) <= 1


def python_line(loaded: Loading, design: Differentiator, options: argparse.Namespace) -> str:
    """Return what computes the same in Python."""
    words = ["x", str(design.window_length)]
    for name in ("deriv", "degree", "kappa", "mu", "tau", "rule", "trim", "delta"):
        value = getattr(design, name)
        words += [f"{name}={value!r}"] if PLAIN.get(name) != value else []
    if options.nan_policy != POLICIES[0]:
        words.append(f"nan_policy={options.nan_policy!r}")
    words += [] if loaded.axis is None else [f"axis={loaded.axis}"]
    words += [] if options.engine is None else [f"engine={options.engine!r}"]
    # Error bars are those of fits, which only this rule has.
    exact = design.rule == "exact"
    if exact:
        words += [*([] if options.sigma is None else [f"sigma={options.sigma!r}"]), "return_std=True"]
    call = f"algdiff.differentiate({', '.join(words)})"
    result = "estimate, std, *_" if exact else "estimate"
    imports = "\n".join(filter(None, ("import numpy as np", loaded.imports, "import algdiff")))
    return f"{imports}\n\nx = {loaded.expression}\n{result} = {call}"
