"""What a report says to have the same again: in Python, and on the command line."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

from algdiff import _cli_auto
from algdiff._cli import POLICIES

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from algdiff import Differentiator
    from algdiff import _formats as formats

WHERE = ("axis", "key", "columns", "time", "dtype", "channels", "offset", "nan_policy")
SAID = (
    *("window", "deriv", "degree", "kappa", "mu", "rule", "trim", "engine", "tau", "delay", "delta", "fs"),
    *_cli_auto.OWN,
    *WHERE,
)
"""Options that decide what is on the page."""
PLAIN = {"deriv": 1, "kappa": 1.0, "mu": 1.0, "tau": 0.5, "rule": "exact", "trim": 0.0, "delta": 1.0}
"""Arguments that need not be said."""
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
            words += [f"--{name.replace('_', '-')}", plain]
    return words


def command(options: argparse.Namespace) -> str:
    """Return the command that wrote the page."""
    return shlex.join(["algdiff", "report", options.source, *given(options)])


def run_command(options: argparse.Namespace, design: Differentiator) -> str:
    """Return the command that writes the estimates into a file."""
    words = ["algdiff", "run", options.source, "OUT.npy", "--window", str(design.window_length)]
    for name in ("deriv", "degree", "kappa", "mu", "tau", "rule", "trim"):
        value = getattr(design, name)
        words += [f"--{name}", str(value)] if PLAIN.get(name) != value else []
    if options.engine is not None:
        words += ["--engine", options.engine]
    return shlex.join([*words, *given(options, ("delta", "fs", *WHERE))])


def python_line(place: formats.Located, design: Differentiator, options: argparse.Namespace) -> str:
    """Return what computes the same in Python."""
    words = ["x", str(design.window_length)]
    for name in ("deriv", "degree", "kappa", "mu", "tau", "rule", "trim", "delta"):
        value = getattr(design, name)
        words += [f"{name}={value!r}"] if PLAIN.get(name) != value else []
    if options.nan_policy != POLICIES[0]:
        words.append(f"nan_policy={options.nan_policy!r}")
    loaded = {
        "npy": f"np.load({place.given!r})",
        "npz": f"np.load({place.given!r})" + (f"[{options.key!r}]" if options.key else "[...]"),
    }.get(place.form.name, f"...  # samples of {place.given!r}")
    words += [f"{name}={getattr(options, name)!r}" for name in ("axis", "engine") if getattr(options, name) is not None]
    # Error bars are those of fits, which only this rule has.
    exact = design.rule == "exact"
    call = f"algdiff.differentiate({', '.join([*words, 'return_std=True'] if exact else words)})"
    result = "estimate, std, *_" if exact else "estimate"
    return f"import numpy as np\nimport algdiff\n\nx = {loaded}\n{result} = {call}"
