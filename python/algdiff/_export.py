"""A design as source text for other languages."""

from __future__ import annotations

import math
import re
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike

from algdiff import _arguments as arguments
from algdiff._refusals import shown

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator

KEYWORDS = (
    "auto|break|case|char|const|continue|default|do|double|else|enum|extern|float|for|goto|if|inline|"
    "int|long|register|restrict|return|short|signed|sizeof|static|struct|switch|typedef|union|unsigned|void|volatile|while"
)
"""Of C99, but for those that start with an underscore."""

STRIDE, FEW, DEPTH = 64, 16, 4
"""The order of the engine "direct": bytes of a stride, taps up to which it is half of that, strides of a group."""

HEADER = """\
/* The derivative of order {deriv} of a sampled signal, by algdiff {version} from
 *
 *   {design}
 *
 * An estimate takes {length} samples and belongs to the time {delay}, in the
 * unit of delta, before the newest of them.
 *
 * This is C99, and C++. On {dtype} data it gives the bits of the engine "direct"
 * if every operation is rounded by itself, as C99 has it where FLT_EVAL_METHOD
 * is 0. GCC needs -ffp-contract=off for that, which -std=c99 implies, lest it
 * fuse multiplications with additions. Under -ffast-math nothing here holds.
 */
#ifndef ALGDIFF_{name}_H
#define ALGDIFF_{name}_H

#include <math.h>

/* Samples in a window. */
#define {macro}_LENGTH {length}
/* From the estimate to the newest sample, in time and in samples. */
#define {macro}_DELAY {delay}
#define {macro}_DELAY_SAMPLES {delay_samples}
/* Variance of the estimate over variance of white noise in the samples. */
#define {macro}_NOISE_GAIN {noise_gain}
/* What the taps are in units of. */
#define {macro}_SCALE {scale} /* 2^{exponent} */

/* Of {terms}, oldest first. */
static const {real} {name}_taps[{count}] = {{
{taps}
}};

/* The estimate from one window of {macro}_LENGTH samples, oldest first.
 * {offsets}
 */
static inline {real} {name}_apply(const {real} *window)
{{
    {real} sum = 0;
    for (long group = 0; group < {count}; group += {group}) {{
        const long end = group + {group} < {count} ? group + {group} : {count};
        for (long place = group; place < end && place < group + {width}; place++) {{
            for (long k = place; k < end; k += {width}) {{
                const {real} product = {name}_taps[k] * {factor};
                sum += product;
            }}
        }}
    }}
    const {real} scaled = {scaled};
    return {result};
}}

/* A signal of which samples come one at a time. All zeros is a new one. */
typedef struct {{
    /* The newest samples, each twice, so that every window is in one piece. */
    {real} samples[2 * {macro}_LENGTH];
    /* Where the next sample goes, and how many came, up to a window. */
    long next;
    long count;
}} {name}_stream;

/* Forgets all samples. */
static inline void {name}_reset({name}_stream *stream)
{{
    stream->next = 0;
    stream->count = 0;
}}

/* Takes the next sample and returns the estimate from the newest {macro}_LENGTH
 * of them, which belongs {macro}_DELAY before it; NAN until there are so many.
 * A sample that is NAN spoils the estimates from windows that hold it, no others.
 */
static inline {real} {name}_push({name}_stream *stream, {real} sample)
{{
    stream->samples[stream->next] = sample;
    stream->samples[stream->next + {macro}_LENGTH] = sample;
    stream->next = stream->next + 1 < {macro}_LENGTH ? stream->next + 1 : 0;
    if (stream->count < {macro}_LENGTH) {{
        stream->count++;
    }}
    if (stream->count < {macro}_LENGTH) {{
        return ({real})NAN;
    }}
    return {name}_apply(stream->samples + stream->next);
}}

#endif
"""

LEAKS = "The weights of this rule let offsets through, and so does this function."
KEEPS = "An offset costs no digits, and a constant gives exactly {constant}."


def to_c(design: Differentiator, name: str, dtype: DTypeLike) -> str:
    """Return the text of `Differentiator.to_c`."""
    _check_identifier(name)
    real = arguments.real_dtype("dtype", dtype)
    single = real == np.float32
    taps, scale, on_differences, anchor = design._plan.taps(single)
    width = STRIDE // real.itemsize // (2 if taps.size <= FEW else 1)
    macro, suffix = name.upper(), "f" if single else ""
    with np.errstate(over="ignore", under="ignore"):
        own = real.type(scale)
    # A scale that float does not hold is applied in double, and the estimate rounded once.
    wide = float(own) != scale
    offsets = KEEPS.format(constant=0 if design.deriv else "itself") if design._plan.keeps_constants else LEAKS
    return HEADER.format(
        name=name,
        macro=macro,
        version=version("algdiff-rs"),
        design=repr(design),
        deriv=design.deriv,
        dtype=real,
        real="float" if single else "double",
        length=design.weights.size,
        delay=_literal(design.delay),
        delay_samples=_literal(design.delay_samples),
        noise_gain=_literal(design.noise_gain),
        scale=repr(scale) if wide else f"{own!s}{suffix}",
        exponent=math.frexp(scale)[1] - 1,
        terms="the differences from one sample to the next" if on_differences else "the samples",
        count=taps.size,
        taps=",\n".join(f"    {tap!s}{suffix}" for tap in taps),
        group=DEPTH * width,
        width=width,
        factor="(window[k + 1] - window[k])" if on_differences else "window[k]",
        offsets=offsets,
        scaled=f"(float)((double)sum * {macro}_SCALE)" if wide else f"sum * {macro}_SCALE",
        result="scaled" if anchor is None else f"scaled + window[{anchor}]",
    )


def _literal(value: float) -> str:
    """Return the shortest decimal that reads back the same, fit for a macro."""
    if math.isinf(value):
        return "HUGE_VAL"
    return f"({value!r})" if value < 0 else repr(value)


def _check_identifier(name: object) -> None:
    if not isinstance(name, str):
        raise TypeError(f"name must be a string, got {shown(name)}")
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or re.fullmatch(KEYWORDS, name):
        allowed = "letters, digits and underscores, a letter first, and no keyword"
        raise ValueError(f"name must be a C identifier ({allowed}), got {shown(name)}")
