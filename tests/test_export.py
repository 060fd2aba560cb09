"""The C header: compiled without a warning, and the bits of the engine "direct" in double and in float."""

from __future__ import annotations

import re
import shutil
import subprocess
from functools import partial
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

import algdiff
from support import Array, design, difference_bound

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
PLUS_COMPILER = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
WARNINGS = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow"]
BUILDS = {
    "O0": (COMPILER, "-std=c99 -O0"),
    "O3": (COMPILER, "-std=c99 -O3"),
    # On CPUs that can fuse a multiplication with an addition.
    "native": (COMPILER, "-std=c99 -O3 -march=native"),
    "gnu": (COMPILER, "-std=gnu99 -O2 -march=native -ffp-contract=off"),
    "sanitized": (COMPILER, "-std=c99 -O1 -fsanitize=address,undefined -fno-sanitize-recover=all"),
    "c++": (PLUS_COMPILER, "-x c++ -std=c++11 -O2 -ffp-contract=off"),
}
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc, gcc, clang)")

make = partial(design, engine="direct")
RULES = ("exact", "trapezoid", "midpoint", "simpson", "cell", "hat")
LEAKING = ("trapezoid", "midpoint", "simpson")
DESIGNS = [
    *(make(31, n, rule=r, delta=0.01, kappa=0.5, mu=2, tau="root") for r in RULES for n in range(4)),
    *(make(61, n, rule=r, delta=0.01, kappa=3, mu=2, trim=0.01) for r in RULES for n in range(2)),
    *(make(length, n) for length in (5, 16, 17, 18, 20, 33, 65, 501, 1001) for n in range(3)),
    make(40, 1, tau="newest", fs=1e6),
    make(40, 0, tau=1.3, delta=1e3),
    make(25, 2, kappa=-0.7, mu=-0.3, delta=1e-5),
    make(13, 1, degree=12, delay=-0.5),
    make(1, 0, degree=0),
    make(2, 1, degree=1),
    TINY := make(37, 1, delta=1e50),
    HUGE := make(37, 1, delta=1e-44),
    SUBNORMAL := make(37, 1, delta=1e40),
]
TYPES = {"d": np.dtype(np.float64), "f": np.dtype(np.float32)}
SIZE = 1300
FEWER = 7
"""Of how many designs one is in a program that takes long to compile."""

START = """
#include <stdio.h>
#include <string.h>

static double d[SIZE];
static float f[SIZE];
"""

RUN = Template("""
static void run_${name}(FILE *file)
{
    static ${name}_stream here;
    ${name}_stream there;
    static $real out[4][SIZE];
    const double facts[] = {${capitals}_LENGTH, ${capitals}_DELAY, ${capitals}_DELAY_SAMPLES, ${capitals}_NOISE_GAIN};
    memset(&there, 0xff, sizeof there);
    ${name}_reset(&there);
    for (long i = 0; i + ${capitals}_LENGTH <= SIZE; i++) {
        out[0][i] = ${name}_apply($x + i);
    }
    for (long i = 0; i < SIZE; i++) {
        out[1][i] = ${name}_push(&here, $x[i]);
        out[2][i] = ${name}_push(&there, $x[SIZE - 1 - i]);
    }
    ${name}_reset(&here);
    for (long i = 0; i < SIZE; i++) {
        out[3][i] = ${name}_push(&here, $x[i]);
    }
    fwrite(facts, sizeof facts, 1, file);
    fwrite(out, sizeof out, 1, file);
}
""")

MAIN = """
int main(void)
{
FILE *file = fopen("in", "rb");
if (file == NULL || fread(d, sizeof d, 1, file) != 1 || fread(f, sizeof f, 1, file) != 1 || fclose(file) != 0) return 1;
file = fopen("out", "wb");
if (file == NULL) return 1;
"""


class Output(NamedTuple):
    """What the program says of one design in one type."""

    design: algdiff.Differentiator
    samples: npt.NDArray[Any]
    facts: Array
    windows: npt.NDArray[Any]
    here: npt.NDArray[Any]
    there: npt.NDArray[Any]
    again: npt.NDArray[Any]


def source(step: int) -> str:
    """Return a program that runs every `step`-th header: windows, two streams at a time, and one of them anew."""
    names = [f"{letter}{i}" for i in range(0, len(DESIGNS), step) for letter in TYPES]
    # Twice, so that the guards are needed.
    lines = [f"#define SIZE {SIZE}", START, *[f'#include "{name}.h"' for name in names] * 2]
    for name in names:
        real = "double" if name[0] == "d" else "float"
        lines.append(RUN.substitute(name=name, capitals=name.upper(), real=real, x=name[0]))
    lines += [MAIN, *(f"run_{name}(file);" for name in names), "return fclose(file);", "}", ""]
    return "\n".join(lines)


@pytest.fixture(scope="module")
def headers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("c")
    for i, each in enumerate(DESIGNS):
        for letter, dtype in TYPES.items():
            (folder / f"{letter}{i}.h").write_text(each.to_c(f"{letter}{i}", dtype), encoding="ascii")
    for step in (1, FEWER):
        (folder / f"main-{step}.c").write_text(source(step), encoding="ascii")
    (folder / "probe.c").write_text("int main(void) { return 0; }\n", encoding="ascii")
    return folder


def run(headers: Path, x: Array, name: str = "O0") -> list[Output]:
    """Return what the program says of `x`, built as `name` says; skip if the compiler cannot, whatever the program."""
    compiler, flags = BUILDS[name]
    if compiler is None:
        pytest.skip("no compiler")
    step = 1 if name == "O0" else FEWER
    probe, program = headers / f"probe-{name}.exe", headers / f"main-{name}.exe"
    if not program.exists():
        command = [compiler, *flags.split()]
        possible = subprocess.run([*command, "probe.c", "-o", probe], cwd=headers, capture_output=True, check=False)
        if possible.returncode or subprocess.run([probe], capture_output=True, check=False).returncode:
            pytest.skip(f"no {flags}")
        command += [*WARNINGS, f"main-{step}.c", "-o", str(program)]
        done = subprocess.run(command, cwd=headers, capture_output=True, text=True, timeout=300, check=False)
        assert (done.returncode, done.stderr) == (0, "")
    with np.errstate(over="ignore"):
        samples = {letter: x.astype(dtype) for letter, dtype in TYPES.items()}
    (headers / "in").write_bytes(b"".join(values.tobytes() for values in samples.values()))
    subprocess.run([program], cwd=headers, timeout=60, check=True)
    said = (headers / "out").read_bytes()
    found, at = [], 0
    for each in DESIGNS[::step]:
        for letter, dtype in TYPES.items():
            facts = np.frombuffer(said, count=4, offset=at)
            values = np.frombuffer(said, dtype, 4 * SIZE, at + facts.nbytes).reshape(4, SIZE)
            at += facts.nbytes + values.nbytes
            windows = values[0, : SIZE - each.weights.size + 1]
            found.append(Output(each, samples[letter], facts, windows, *values[1:]))
    assert at == len(said)
    return found


def noisy() -> Array:
    rng = np.random.default_rng(3)
    signal: Array = np.sin(0.02 * np.arange(SIZE)) + rng.standard_normal(SIZE)
    return signal


def keeps_constants(each: algdiff.Differentiator) -> bool:
    return each.rule == "exact" or (each.rule not in LEAKING and each.trim == 0)


def bits(values: npt.NDArray[Any]) -> bytes:
    """Return the bits, those of all NaN the same: CPUs differ in them."""
    return np.where(np.isnan(values), values.dtype.type(np.nan), values).tobytes()


def check(found: list[Output]) -> None:
    """Assert that windows and streams give what the engine gives, after NaN until the window is full."""
    for each, samples, _, windows, here, there, again in found:
        size = each.weights.size
        for x, streams in ((samples, (here, again)), (samples[::-1], (there,))):
            expected = each(x, mode="valid")
            assert expected.dtype == samples.dtype
            for pushed in streams:
                assert np.isnan(pushed[: size - 1]).all(), repr(each)
                assert bits(pushed[size - 1 :]) == bits(expected), (repr(each), samples.dtype)
        assert bits(windows) == bits(here[size - 1 :]), (repr(each), samples.dtype)


@needs_compiler
@pytest.mark.parametrize("name", BUILDS)
def test_windows_and_streams_give_the_bits_of_the_engine(headers: Path, name: str) -> None:
    check(run(headers, noisy(), name))


@needs_compiler
@pytest.mark.parametrize(("factor", "offset"), [(1.0, 1e9), (1.0, -3e5), (1e-30, 0.0), (1e30, 0.0)])
def test_so_they_do_whatever_the_size_of_the_samples(headers: Path, factor: float, offset: float) -> None:
    found = run(headers, factor * noisy() + offset)
    check(found)


@needs_compiler
@pytest.mark.parametrize(("factor", "each"), [(1e30, TINY), (1e-30, HUGE), (1e30, SUBNORMAL)])
def test_a_scale_beyond_float_rounds_the_estimate_once(
    headers: Path, factor: float, each: algdiff.Differentiator
) -> None:
    (found,) = (o for o in run(headers, factor * noisy()) if o.design is each and o.samples.dtype == np.float32)
    check([found])
    assert np.isfinite(found.windows).all()
    exact = each(found.samples.astype(np.float64), mode="valid")
    bound = difference_bound(each.weights, found.samples, float(np.finfo(np.float32).eps))
    assert bound < np.abs(exact).max()
    np.testing.assert_allclose(found.windows, exact, rtol=0, atol=bound)


@needs_compiler
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nan_and_infinities_spoil_the_windows_that_hold_them_and_no_others(headers: Path, bad: float) -> None:
    x, at = noisy(), SIZE // 2
    x[at] = bad
    found = run(headers, x)
    check(found)
    for output in found:
        size = output.design.weights.size
        if output.design is HUGE and output.samples.dtype == np.float32:
            continue
        held = np.arange(SIZE)[size - 1 :]
        held = (held >= at) & (held < at + size)
        assert held.any()
        np.testing.assert_array_equal(np.isfinite(output.here[size - 1 :]), ~held, err_msg=repr(output.design))


@needs_compiler
@pytest.mark.parametrize("constant", [1.0, 0.1, 1e9 + 0.1, -1e30, 1e-30])
def test_a_constant_gives_exactly_what_it_must(headers: Path, constant: float) -> None:
    found = run(headers, np.full(SIZE, constant))
    check(found)
    for output in found:
        if keeps_constants(output.design):
            expected = {0.0 if output.design.deriv else output.samples[0]}
            assert set(output.windows) == expected, repr(output.design)


@needs_compiler
def test_facts_read_back_to_the_bit(headers: Path) -> None:
    for output in run(headers, noisy()):
        each = output.design
        assert output.facts.tolist() == [each.weights.size, each.delay, each.delay_samples, each.noise_gain]


def test_the_header_says_which_rules_leak() -> None:
    for each in DESIGNS:
        text = each.to_c()
        assert ("An offset costs no digits" in text) == keeps_constants(each)
        assert ("let offsets through" in text) == (not keeps_constants(each))


def test_the_header_says_what_it_is() -> None:
    each = design(21, fs=1000)
    text = each.to_c("velocity")
    assert repr(each) in text
    assert f"algdiff {algdiff.__version__}" in text
    assert text.isascii()
    assert text.endswith("#endif\n")
    assert set(re.findall(r"#define (\w+)", text)) == {
        "ALGDIFF_velocity_H",
        "VELOCITY_LENGTH",
        "VELOCITY_DELAY",
        "VELOCITY_DELAY_SAMPLES",
        "VELOCITY_NOISE_GAIN",
        "VELOCITY_SCALE",
    }
    assert "velocity_apply(const double *window)" in text
    assert "velocity_push(velocity_stream *stream, double sample)" in text
    assert "On float64 data" in text
    assert each.to_c() == each.to_c("differentiator") == each.to_c(dtype="float64") == each.to_c(dtype=float)


def test_a_header_in_float_has_no_double_but_in_its_macros_and_where_the_scale_demands_it() -> None:
    text = design(21).to_c("d", np.float32)
    assert "On float32 data" in text
    assert "double" not in text
    for each in (TINY, HUGE):
        assert "(float)((double)sum * D_SCALE)" in each.to_c("d", "float32")
    assert "(double)sum" not in SUBNORMAL.to_c("d", "float32")


@pytest.mark.parametrize("dtype", ["float16", np.int64, ">f8", complex, "nonsense", 5, object()])
def test_dtypes_that_are_not_float_or_double(dtype: Any) -> None:
    with pytest.raises(TypeError, match="dtype must be float64 or float32, got "):
        design(5).to_c(dtype=dtype)


def test_a_negative_delay_is_safe_in_an_expression() -> None:
    assert "#define D_DELAY (-0.5)\n" in design(13, delay=-0.5).to_c("d")


@pytest.mark.parametrize("delta", [1e-160, 1e-170])
def test_a_noise_gain_that_overflows_is_a_number_of_c(delta: float) -> None:
    each = design(51, delta=delta)
    with np.errstate(over="ignore"):
        assert "#define D_NOISE_GAIN HUGE_VAL\n" in each.to_c("d")
        assert each.summary()["noise_gain"] is None


KEYWORDS = (
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while"
)


@pytest.mark.parametrize("name", ["", "2d", "_d", "a-b", "a b", "a\n", "a*/", "é", "d\u00aa", *KEYWORDS.split()])
def test_names_that_c_would_refuse(name: str) -> None:
    with pytest.raises(ValueError, match=r"name must be a C identifier \(.*, and no keyword\), got "):
        design(5).to_c(name)


@pytest.mark.parametrize("name", [None, 5, b"d"])
def test_names_that_are_no_strings(name: object) -> None:
    with pytest.raises(TypeError, match="name must be a string, got"):
        design(5).to_c(name)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["d", "Velocity_2", "INT", "integer", "interrupt", "x_"])
def test_names_that_c_takes(name: str) -> None:
    assert f"static inline double {name}_push({name}_stream *stream" in design(5).to_c(name)
