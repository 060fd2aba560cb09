"""What the library has to refuse of the grid in `ladder.py`, as which error, in which words."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from covering import Cell, Grid, Rule
from ladder import FACTORS, INEXPRESSIBLE, INSIDE, KEPT, PADS, degree_of, kept, samples_of, shortest


class Reason(NamedTuple):
    """A documented refusal: when, and how it is said. One that is not `sure` may be."""

    rule: Rule
    error: type[Exception]
    says: str
    sure: bool = True


def whole(value: float) -> bool:
    return value >= 0 and value.is_integer()


NOT_EXACT = "^rule must be 'exact' with (uneven t|weights|nan_policy = 'omit'|time stamps)"
TOO_FEW = "^window_length must be at most the (.* samples of|size of x)"
NO_MOMENTS = "^engine must be 'auto', 'direct' or 'fft' for these weights"
REASONS: dict[str, Reason] = {
    "window below degree + 1": Reason(
        Rule(
            ("window", "deriv", "extra", "rule"),
            lambda window, deriv, extra, rule: window != "least" and window < shortest(deriv, extra, rule),
        ),
        ValueError,
        r"^(window_length must be at least degree \+ 1|polyorder must be less than window_length)",
    ),
    "even windows of Simpson's rule": Reason(
        Rule(("window", "rule"), lambda window, rule: rule == "simpson" and window != "least" and window % 2 == 0),
        ValueError,
        r"^window_length must be odd with rule = 'simpson'",
    ),
    "weights that are infinite at the ends": Reason(
        Rule(("kappa", "mu", "rule"), lambda kappa, mu, rule: min(kappa, mu) < 0 and rule in ("trapezoid", "simpson")),
        ValueError,
        r"^(kappa|mu) must be at least 0 with rule = '(trapezoid|simpson)'",
    ),
    "a root of several orders": Reason(
        Rule(("deriv", "tau"), lambda deriv, tau: isinstance(deriv, tuple) and tau == "root"),
        ValueError,
        r"^tau must not be 'root' for several orders",
    ),
    "a trimmed window of several orders": Reason(
        Rule(("deriv", "trim"), lambda deriv, trim: isinstance(deriv, tuple) and trim > 0),
        ValueError,
        r"^trim must be 0 for several orders",
    ),
    "trim and a delay": Reason(
        Rule(("trim", "tau"), lambda trim, tau: trim > 0 and tau == "delay"),
        ValueError,
        "^give delay or trim, not both",
    ),
    "trimmed to too few samples": Reason(
        Rule(
            KEPT,
            lambda trim, *words: trim > 0 and kept(trim, *words)[1] <= kept(trim, *words)[2],
        ),
        ValueError,
        "^trim must be so small that more than",
    ),
    "fewer samples than the window": Reason(
        Rule(
            ("samples", "mode", "entry", *KEPT),
            lambda samples, mode, entry, *words: (
                samples == "fewer"
                and mode in INSIDE
                and entry != "stream"
                and samples_of(samples, *words) < kept(*words)[1]
            ),
        ),
        ValueError,
        TOO_FEW,
    ),
    "as few samples as many windows are longer": Reason(
        Rule(
            ("samples", "mode", "entry"),
            lambda samples, mode, entry: samples == "fewer" and mode in INSIDE and entry != "stream",
        ),
        ValueError,
        TOO_FEW,
        sure=False,
    ),
    "gaps by another rule": Reason(
        Rule(("rule", "policy"), lambda rule, policy: rule != "exact" and policy == "omit"), ValueError, NOT_EXACT
    ),
    "weights by another rule": Reason(
        Rule(("rule", "weights"), lambda rule, weights: rule != "exact" and weights != "none"), ValueError, NOT_EXACT
    ),
    "uneven times by another rule": Reason(
        Rule(("rule", "times"), lambda rule, times: rule != "exact" and times == "uneven"), ValueError, NOT_EXACT
    ),
    "times of a stream by another rule": Reason(
        Rule(
            ("rule", "times", "entry"),
            lambda rule, times, entry: rule != "exact" and times != "none" and entry == "stream",
        ),
        ValueError,
        NOT_EXACT,
    ),
    "trimmed windows of uneven times": Reason(
        Rule(("trim", "times"), lambda trim, times: trim > 0 and times == "uneven"), ValueError, "^trim must be 0 with"
    ),
    "trimmed windows of a stream with times": Reason(
        Rule(
            ("trim", "times", "entry"),
            lambda trim, times, entry: trim > 0 and times != "none" and entry == "stream",
        ),
        ValueError,
        "^trim must be 0 with time stamps",
    ),
    "extensions of uneven times": Reason(
        Rule(("mode", "times"), lambda mode, times: mode in PADS and times == "uneven"),
        ValueError,
        "^mode must be 'fit', 'nan' or 'valid' with uneven t",
    ),
    "delays by uneven times": Reason(
        Rule(
            ("tau", "times", "entry"),
            lambda tau, times, entry: (tau, times) == ("delay", "uneven") and entry != "stream",
        ),
        ValueError,
        "^delay must come with even t",
    ),
    "missing samples that are refused": Reason(
        Rule(("missing", "policy"), lambda missing, policy: missing != "none" and policy == "raise"),
        ValueError,
        "must (hold no|be without) missing samples",
    ),
    "masks that would be lost": Reason(
        Rule(("missing", "entry"), lambda missing, entry: (missing, entry) == ("masked", "savgol_filter")),
        TypeError,
        "^x must have no masked values",
    ),
    "modes that SciPy does not have": Reason(
        Rule(("mode", "entry"), lambda mode, entry: mode in ("nan", "valid") and entry == "savgol_filter"),
        ValueError,
        "^mode must be 'mirror', 'constant', 'nearest', 'wrap' or 'interp'",
    ),
    "streams of complex samples": Reason(
        Rule(("entry", "dtype"), lambda entry, dtype: entry == "stream" and np.dtype(dtype).kind == "c"),
        TypeError,
        "^x must be real numbers, got complex ones",
    ),
    "streams backwards": Reason(
        Rule(("entry", "times"), lambda entry, times: (entry, times) == ("stream", "descending")),
        ValueError,
        "^t must be later than that of the sample before",
    ),
    "a place for what is lazy": Reason(
        Rule(("entry", "out"), lambda entry, out: entry == "dask" and out),
        ValueError,
        "^out must be left out with a Dask array",
    ),
    "moments of weights that are no polynomial": Reason(
        Rule(
            ("engine", "kappa", "mu", "rule"),
            lambda engine, kappa, mu, rule: (
                engine == "moments" and (rule == "simpson" or not (whole(kappa) and whole(mu)))
            ),
        ),
        ValueError,
        NO_MOMENTS,
    ),
    "moments of few samples": Reason(
        Rule(("engine", "window"), lambda engine, window: engine == "moments" and window in ("least", 5, 8)),
        ValueError,
        NO_MOMENTS,
    ),
    "moments by rules of which nothing is said": Reason(
        Rule(("engine", "rule"), lambda engine, rule: engine == "moments" and rule in ("midpoint", "cell", "hat")),
        ValueError,
        NO_MOMENTS,
        sure=False,
    ),
    "moments that the engine may refuse": Reason(
        Rule(
            ("engine", "kappa", "mu", "rule", "window", "trim", "deriv", "extra"),
            lambda engine, *words: engine == "moments" and not surely_by_moments(*words),
        ),
        ValueError,
        NO_MOMENTS,
        sure=False,
    ),
}


def surely_by_moments(kappa: float, mu: float, rule: str, window: Any, trim: float, deriv: Any, extra: int) -> bool:
    """Say whether the engine is documented to take these weights: low polynomials, on windows that are not short."""
    least = {"exact": 31, "trapezoid": 62}.get(rule, math.inf)
    length = window if isinstance(window, int) else 0
    return length * (0.5 if trim else 1.0) >= least and degree_of(deriv, extra) + kappa + mu <= 8


def reasons(cell: Cell) -> dict[str, Reason]:
    """Return why the library may refuse a cell."""
    return {
        name: reason for name, reason in REASONS.items() if reason.rule.apart(*(cell[one] for one in reason.rule.names))
    }


RUNS = Grid(FACTORS, [*INEXPRESSIBLE, *(reason.rule for reason in REASONS.values())])
"""The calls that have to run."""
SAYABLE = Grid(FACTORS, INEXPRESSIBLE)
"""All calls, those that are refused among them."""


def alone(name: str) -> Grid:
    """Return the calls that are refused for one reason at most, however often it is written down."""
    others = (reason.rule for reason in REASONS.values() if reason.sure and reason.says != REASONS[name].says)
    return Grid(FACTORS, [*INEXPRESSIBLE, *others])
