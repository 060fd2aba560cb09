"""The grid of everything that a caller may say.

A cell is one call: an entry, an array, a design, what is said of its samples. `INEXPRESSIBLE` is what an entry has no
argument for; what is refused of the rest is in `ladder_refusals.py`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

import reference
from covering import Cell, Rule

PADS = ("nearest", "mirror", "wrap", "constant")
INSIDE = ("fit", "nan", "valid")
FACTORS: dict[str, tuple[Any, ...]] = {
    "entry": ("differentiate", "design", "savgol_filter", "gradient", "stream", "chunks", "file", "dask"),
    "mode": (*INSIDE, *PADS),
    "rule": ("exact", *reference.CELLS[1:], *reference.NODES),
    "trim": (0.0, 0.03),
    "times": ("none", "even", "uneven", "descending"),
    "policy": ("propagate", "omit", "raise"),
    "weights": ("none", "row", "all"),
    "engine": ("auto", "direct", "moments", "fft"),
    "deriv": (0, 1, 2, 3, 4, (0, 1), (2, 0)),
    "tau": ("center", "root", "newest", 0.3, 1.2, -0.15, "delay"),
    "kappa": (0.0, 1.0, 2.0, 0.5, -0.5),
    "mu": (0.0, 1.0, 2.0, 0.5, -0.5),
    "window": ("least", 5, 8, 33, 64, 150),
    "extra": (0, 1, 2, 3),
    "dtype": ("f8", "f4", "c16", "c8", ">f8", ">f4", ">c16", "f2", "g", "i1", "u2", "i8", "?"),
    "missing": ("none", "nan", "masked"),
    "samples": ("window", "more", "many", "fewer"),
    "shape": ("row", "first of 2", "last of 2", "first of 3", "middle of 3", "last of 3"),
    "layout": ("C", "F", "strided", "reversed", "field", "misaligned", "readonly"),
    "signal": ("noise", "offset", "walk"),
    "delta": (1.0, 0.01),
    "threads": (1, 2),
    "out": (False, True),
}
SHARES = {
    "entry": (6, 6, 3, 4, 4, 4, 1, 1),
    "rule": (8, 1, 1, 1, 1, 1),
    "trim": (3, 1),
    "times": (4, 1, 4, 2),
    "policy": (2, 4, 1),
    "engine": (1, 1, 2, 1),
}
"""How often random cells hold the levels of some factors: rare ones more often, slow entries less."""
SLIDING = ("differentiate", "design", "dask")
"""Entries that take whatever a call of a design takes."""

KEPT = ("trim", "window", "deriv", "extra", "rule", "kappa", "mu", "tau")
"""What decides which samples of a window are kept."""

INEXPRESSIBLE = (
    # One sample has no step, and two are never uneven.
    Rule(
        ("times", "samples", "window"),
        lambda times, samples, window: times != "none" and samples in ("window", "fewer") and window == "least",
    ),
    # Dask fills masked arrays with 1e20, which is too large for them.
    Rule(("entry", "dtype", "missing"), lambda *words: words == ("dask", "f2", "masked")),
    Rule(("dtype", "missing"), lambda dtype, missing: missing == "nan" and np.dtype(dtype).kind in "iub"),
    Rule(("entry", "weights"), lambda entry, weights: weights != "none" and entry not in SLIDING),
    Rule(("entry", "out"), lambda entry, out: out and entry not in SLIDING),
    Rule(("entry", "times"), lambda entry, times: times != "none" and entry in ("savgol_filter", "chunks", "file")),
    Rule(("entry", "mode"), lambda entry, mode: mode != "valid" and entry in ("stream", "chunks")),
    Rule(("entry", "missing"), lambda entry, missing: missing == "masked" and entry == "file"),
    Rule(("entry", "shape"), lambda entry, shape: entry == "stream" and shape not in ("row", "first of 2")),
    Rule(("entry", "deriv"), lambda entry, deriv: entry == "gradient" and deriv != 1),
    Rule(("entry", "deriv"), lambda entry, deriv: entry == "savgol_filter" and isinstance(deriv, tuple)),
    *(
        Rule(("entry", name), lambda entry, value, plain=plain: entry == "savgol_filter" and value != plain)
        for name, plain in {
            "kappa": 0.0,
            "mu": 0.0,
            "tau": "center",
            "rule": "exact",
            "trim": 0.0,
            "policy": "propagate",
        }.items()
    ),
)


def degree_of(deriv: Any, extra: int) -> int:
    return int(np.max(deriv)) + extra


def shortest(deriv: Any, extra: int, rule: str) -> int:
    """Return the shortest window that the rule and the degree allow."""
    length = max(degree_of(deriv, extra) + 1, 2 if rule in reference.NODES else 1)
    return length | 1 if rule == "simpson" else length


def length_of(window: Any, deriv: Any, extra: int, rule: str) -> int:
    return shortest(deriv, extra, rule) if window == "least" else int(window)


def point(tau: float | str, length: int, rule: str) -> float | str:
    """Return tau as the reference takes it; a delay is one and a half samples."""
    if tau != "delay":
        return tau
    return (length - 2.0) / length if rule in reference.CELLS else (length - 2.5) / (length - 1)


@lru_cache(1 << 14)
def kept(
    trim: float, window: Any, deriv: Any, extra: int, rule: str, kappa: float, mu: float, tau: Any
) -> tuple[int, int, int]:
    """Return the first sample that trimming leaves, how many it leaves, and the degree of their fit."""
    length, degree = length_of(window, deriv, extra, rule), degree_of(deriv, extra)
    if trim == 0 or isinstance(deriv, tuple) or tau == "delay" or length < shortest(deriv, extra, rule):
        return 0, length, degree
    if (rule == "simpson" and length % 2 == 0) or (rule in ("trapezoid", "simpson") and min(kappa, mu) < 0):
        return 0, length, degree
    fitted = degree
    if rule == "exact" and reference.resolve_tau(length, deriv, degree, kappa, mu, tau)[1]:
        fitted = min(degree + 1, length - 1)
    sizes = np.abs(reference.weights(length, deriv, degree, kappa, mu, tau, rule))
    share = trim * sizes.sum()
    oldest, newest = (int(np.sum(np.cumsum(part) <= share)) for part in (sizes, sizes[::-1]))
    return oldest, length - oldest - newest, fitted


def samples_of(samples: str, *words: Any) -> int:
    """Return the number of samples of a row; `words` are those of `kept`."""
    _, window, deriv, extra, rule, *_ = words
    span, length = max(kept(*words)[1], 1), length_of(window, deriv, extra, rule)
    return {"window": span, "more": span + 23, "many": 3 * span + 10, "fewer": (length + 1) // 2}[samples]


def span_of(cell: Cell) -> int:
    """Return the number of weights."""
    return kept(*(cell[name] for name in KEPT))[1]
