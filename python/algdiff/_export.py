"""A design as source text for other languages."""

from __future__ import annotations

import math
import re
from importlib.metadata import version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator

KEYWORDS = (
    "auto|break|case|char|const|continue|default|do|double|else|enum|extern|float|for|goto|if|inline|"
    "int|long|register|restrict|return|short|signed|sizeof|static|struct|switch|typedef|union|unsigned|void|volatile|while"
)
"""Of C99, but for those that start with an underscore."""

HEADER = """\
/* The derivative of order {deriv} of a sampled signal, by algdiff {version} from
 *
 *   {design}
 *
 * An estimate takes {length} samples and belongs to the time {delay}, in the
 * unit of delta, before the newest of them. This is C99; -ffast-math would give
 * up what is said below about offsets.
 */
#ifndef ALGDIFF_{name}_H
#define ALGDIFF_{name}_H

/* Samples in a window. */
#define {macro}_LENGTH {length}
/* From the estimate to the newest sample, in time and in samples. */
#define {macro}_DELAY {delay}
#define {macro}_DELAY_SAMPLES {delay_samples}
/* Variance of the estimate over variance of white noise in the samples. */
#define {macro}_NOISE_GAIN {noise_gain}

/* Oldest sample first. */
static const double {name}_weights[{macro}_LENGTH] = {{
{weights}
}};

{apply}
#endif
"""

PLAIN = """\
/* The estimate from one window of {macro}_LENGTH samples, oldest first.
 * The weights of this rule let offsets through, and so does this function.
 */
static inline double {name}_apply(const double *window)
{{
    double sum = 0.0;
    for (long k = 0; k < {macro}_LENGTH; k++) {{
        sum += {name}_weights[k] * window[k];
    }}
    return sum;
}}
"""

ON_DIFFERENCES = """\
/* The estimate from one window of {macro}_LENGTH samples, oldest first. The sum
 * runs over differences from one sample: an offset costs no digits, and a
 * constant gives exactly {constant}.
 */
static inline double {name}_apply(const double *window)
{{
    const double origin = window[{macro}_LENGTH / 2];
    double sum = 0.0;
    for (long k = 0; k < {macro}_LENGTH; k++) {{
        sum += {name}_weights[k] * (window[k] - origin);
    }}
    return {result};
}}
"""


def to_c(design: Differentiator, name: str) -> str:
    """Return the text of `Differentiator.to_c`."""
    _check_identifier(name)
    smooths = design.deriv == 0
    words = {
        "name": name,
        "macro": name.upper(),
        "version": version("algdiff-rs"),
        "design": repr(design),
        "deriv": design.deriv,
        "length": design.weights.size,
        "delay": _literal(design.delay),
        "delay_samples": _literal(design.delay_samples),
        "noise_gain": _literal(design.noise_gain),
        "weights": ",\n".join(f"    {weight!r}" for weight in design.weights.tolist()),
        "constant": "itself" if smooths else "0",
        "result": "origin + sum" if smooths else "sum",
    }
    apply = ON_DIFFERENCES if design._plan.keeps_constants else PLAIN
    return HEADER.format(apply=apply.format(**words), **words)


def _literal(value: float) -> str:
    """Return the shortest decimal that reads back the same, fit for a macro."""
    if math.isinf(value):
        return "HUGE_VAL /* of math.h */"
    return f"({value!r})" if value < 0 else repr(value)


def _check_identifier(name: object) -> None:
    if not isinstance(name, str):
        raise TypeError(f"name must be a string, got {name!r}")
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or re.fullmatch(KEYWORDS, name):
        allowed = "letters, digits and underscores, a letter first, and no keyword"
        raise ValueError(f"name must be a C identifier ({allowed}), got {name!r}")
