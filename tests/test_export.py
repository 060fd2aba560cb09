"""The C header: compiled without a warning, the same weights to the bit, the same estimates to rounding."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import algdiff
from support import EPS, Array, design, difference_bound, sum_bound

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc, gcc, clang)")

RULES = ("exact", "trapezoid", "midpoint", "simpson", "cell", "hat")
LEAKING = ("trapezoid", "midpoint", "simpson")
DESIGNS = [
    *(design(31, n, rule=r, delta=0.01, kappa=0.5, mu=2, tau="root") for r in RULES for n in range(4)),
    *(design(61, n, rule=r, delta=0.01, kappa=3, mu=2, trim=0.01) for r in RULES for n in range(2)),
    *(design(length, n) for length in (5, 20, 501) for n in range(3)),
    design(40, 1, tau="newest", fs=1e6),
    design(40, 0, tau=1.3, delta=1e3),
    design(25, 2, kappa=-0.7, mu=-0.3, delta=1e-5),
    design(13, 1, degree=12, delay=-0.5),
    design(1, 0, degree=0),
    design(2, 1, degree=1),
]
SIZE = 700

MAIN = """
static void slide(double (*apply)(const double *), long length, const double *x)
{{
    for (long i = 0; i + length <= {size}; i++) {{
        const double y = apply(x + i);
        fwrite(&y, sizeof y, 1, stdout);
    }}
}}

int main(void)
{{
    static double x[{size}];
    if (fread(x, sizeof x[0], {size}, stdin) != {size}) {{
        return 1;
    }}
{body}
    return 0;
}}
"""

BODY = """    {{
        const double facts[] = {{D{i}_LENGTH, D{i}_DELAY, D{i}_DELAY_SAMPLES, D{i}_NOISE_GAIN}};
        fwrite(facts, sizeof facts, 1, stdout);
        fwrite(d{i}_weights, sizeof d{i}_weights, 1, stdout);
        slide(d{i}_apply, D{i}_LENGTH, x);
    }}"""


class Output(NamedTuple):
    """What the program says of one design."""

    facts: Array
    weights: Array
    estimates: Array


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a program that includes the headers of all designs and applies them."""
    folder: Path = tmp_path_factory.mktemp("c")
    for i, each in enumerate(DESIGNS):
        (folder / f"d{i}.h").write_text(each.to_c(f"d{i}"), encoding="ascii")
    # Twice, so that the guards are needed.
    includes = [f'#include "d{i}.h"' for i in range(len(DESIGNS))] * 2
    body = "\n".join(BODY.format(i=i) for i in range(len(DESIGNS)))
    lines = [*includes, "#include <stdio.h>", MAIN.format(size=SIZE, body=body)]
    (folder / "main.c").write_text("\n".join(lines), encoding="ascii")
    assert COMPILER is not None
    command = [COMPILER, *FLAGS, "main.c", "-o", "main"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "main"


def outputs(program: Path, x: Array) -> list[Output]:
    done = subprocess.run([program], input=x.tobytes(), capture_output=True, timeout=60, check=True)
    numbers = np.frombuffer(done.stdout)
    found = []
    for each in DESIGNS:
        size = each.weights.size
        facts, weights, estimates, numbers = np.split(numbers, np.cumsum([4, size, SIZE - size + 1]))
        found.append(Output(facts, weights, estimates))
    assert numbers.size == 0
    return found


def noisy() -> Array:
    rng = np.random.default_rng(3)
    signal: Array = np.sin(0.02 * np.arange(SIZE)) + rng.standard_normal(SIZE)
    return signal


def keeps_constants(each: algdiff.Differentiator) -> bool:
    return each.rule == "exact" or (each.rule not in LEAKING and each.trim == 0)


def bound(each: algdiff.Differentiator, x: Array) -> float:
    """Bound the distance of two sums: over differences from one sample here, over first differences there.

    The differences from one sample are at most the range of x. What the weights' sum misses by rounding, at most L eps
    times the sum of their sizes, meets such a difference as well. A smoother adds its sample at the end: one rounding.
    """
    if not keeps_constants(each):
        return 2 * sum_bound(each.weights, x)
    size, total = each.weights.size, float(np.abs(each.weights).sum())
    here = 2 * (size + 8) * EPS * total * float(np.ptp(x))
    last = 2 * EPS * float(np.abs(x).max()) if each.deriv == 0 else 0.0
    return here + difference_bound(each.weights, x) + last


@needs_compiler
def test_weights_and_facts_read_back_to_the_bit(program: Path) -> None:
    for each, output in zip(DESIGNS, outputs(program, noisy()), strict=True):
        assert output.weights.tobytes() == each.weights.tobytes(), repr(each)
        facts = [each.weights.size, each.delay, each.delay_samples, each.noise_gain]
        assert output.facts.tolist() == facts, repr(each)


@needs_compiler
@pytest.mark.parametrize("offset", [0.0, 1e9, -3e5])
def test_estimates_equal_those_of_whole_windows(program: Path, offset: float) -> None:
    x = noisy() + offset
    for each, output in zip(DESIGNS, outputs(program, x), strict=True):
        expected = each(x, mode="valid")
        np.testing.assert_allclose(output.estimates, expected, rtol=0, atol=bound(each, x), err_msg=repr(each))


@needs_compiler
@pytest.mark.parametrize("constant", [1.0, 0.1, 1e9 + 0.1, -1e300, 1e-290])
def test_a_constant_gives_exactly_what_it_must_or_leaks_as_before(program: Path, constant: float) -> None:
    leaks = 0
    x = np.full(SIZE, constant)
    for each, output in zip(DESIGNS, outputs(program, x), strict=True):
        if keeps_constants(each):
            assert set(output.estimates) == {0.0 if each.deriv else constant}, repr(each)
        else:
            expected = each(x, mode="valid")
            np.testing.assert_allclose(output.estimates, expected, rtol=0, atol=bound(each, x), err_msg=repr(each))
            leaks += int(each.deriv > 0 and abs(expected[0]) > 2 * bound(each, x))
    assert leaks > 5


def test_the_library_itself_keeps_and_leaks_the_same_constants() -> None:
    x = np.full(SIZE, 1e9 + 0.1)
    for each in DESIGNS:
        source = each.to_c()
        assert ("origin" in source) == keeps_constants(each)
        assert ("let offsets through" in source) == (not keeps_constants(each))
        if keeps_constants(each):
            assert set(each(x, mode="valid")) == {0.0 if each.deriv else x[0]}, repr(each)


@needs_compiler
def test_infinities_and_nan_do_not_hide(program: Path) -> None:
    for bad in (np.nan, np.inf):
        x = noisy()
        x[SIZE // 2] = bad
        for each, output in zip(DESIGNS, outputs(program, x), strict=True):
            touched = [i for i in range(output.estimates.size) if i <= SIZE // 2 < i + each.weights.size]
            assert not np.isfinite(output.estimates[touched]).any()
            assert np.isfinite(np.delete(output.estimates, touched)).all()


def test_the_header_says_what_it_is() -> None:
    each = design(21, fs=1000)
    source = each.to_c("velocity")
    assert repr(each) in source
    assert f"algdiff {algdiff.__version__}" in source
    assert source.isascii()
    assert source.endswith("#endif\n")
    assert set(re.findall(r"#define (\w+)", source)) == {
        "ALGDIFF_velocity_H",
        "VELOCITY_LENGTH",
        "VELOCITY_DELAY",
        "VELOCITY_DELAY_SAMPLES",
        "VELOCITY_NOISE_GAIN",
    }
    assert "velocity_apply(const double *window)" in source
    assert each.to_c() == each.to_c("differentiator")


def test_a_negative_delay_is_safe_in_an_expression() -> None:
    assert "#define D_DELAY (-0.5)\n" in design(13, delay=-0.5).to_c("d")


def test_a_noise_gain_that_overflows_is_a_number_of_c() -> None:
    each = design(51, delta=1e-170)
    with np.errstate(over="ignore"):
        assert "#define D_NOISE_GAIN HUGE_VAL /* of math.h */\n" in each.to_c("d")
        assert each.summary()["noise_gain"] is None


@pytest.mark.parametrize(
    "name", ["", "2d", "_d", "a-b", "a b", "a\n", "a*/", "é", "int", "restrict", "while", "d\u00aa"]
)
def test_names_that_c_would_refuse(name: str) -> None:
    with pytest.raises(ValueError, match=r"name must be a C identifier .*, got "):
        design(5).to_c(name)


@pytest.mark.parametrize("name", [None, 5, b"d"])
def test_names_that_are_no_strings(name: object) -> None:
    with pytest.raises(TypeError, match="name must be a string, got"):
        design(5).to_c(name)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["d", "Velocity_2", "INT", "integer", "interrupt", "x_"])
def test_names_that_c_takes(name: str) -> None:
    assert f"static const double {name}_weights[{name.upper()}_LENGTH]" in design(5).to_c(name)


def test_an_infinite_noise_gain_is_a_macro_of_c() -> None:
    ours = design(5, delta=1e-160)
    with np.errstate(over="ignore"):
        assert ours.noise_gain == np.inf
        assert "#define D_NOISE_GAIN HUGE_VAL" in ours.to_c("d")


KEYWORDS = (
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while"
)


@pytest.mark.parametrize("word", KEYWORDS.split())
def test_keywords_are_no_names(word: str) -> None:
    with pytest.raises(ValueError, match="no keyword"):
        design(5).to_c(word)
