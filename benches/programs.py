"""Programs that take one sample at a time, without Python: the bench of the core, and one in C around a header.

Each makes the same samples as `pushes.noise`, times its pushes itself and prints a line of JSON, with a hash of its
first estimates.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from pushes import Case

HASHED = 20_000  # samples of which the estimates are hashed
PUSHES = 200_000
FLAGS = ("-std=c99", "-O2")

PROGRAM = Template("""
#define _POSIX_C_SOURCE 199309L
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "d.h"

#define PUSHES $pushes

static d_stream stream;
static $real x[PUSHES];
static int64_t spent[PUSHES];
static volatile $real sink;

static int64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

static int compare(const void *a, const void *b)
{
    const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

static int64_t quantile(long of_1000)
{
    qsort(spent, PUSHES, sizeof spent[0], compare);
    return spent[(PUSHES * of_1000 + 999) / 1000 - 1];
}

int main(void)
{
    uint64_t state = 12345, hash = 14695981039346656037u;
    for (long i = 0; i < PUSHES; i++) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        x[i] = ($real)((double)(state >> 11) / 4503599627370496.0 - 1.0);
    }
    for (long i = 0; i < $hashed; i++) {
        const double estimate = d_push(&stream, x[i]);
        uint64_t bits;
        memcpy(&bits, &estimate, sizeof bits);
        if (i + 1 >= D_LENGTH) {
            hash = (hash ^ bits) * 1099511628211u;
        }
    }
    for (long i = 0; i < PUSHES; i++) {
        const int64_t started = now();
        spent[i] = now() - started;
    }
    const int64_t clock = quantile(500);
    for (long i = 0; i < PUSHES; i++) {
        const int64_t started = now();
        sink = d_push(&stream, x[i]);
        spent[i] = now() - started;
    }
    printf("{\\"clock\\": %" PRId64 ", \\"median\\": %" PRId64 ", ", clock, quantile(500));
    printf("\\"p99\\": %" PRId64 ", \\"p999\\": %" PRId64 ", ", quantile(990), quantile(999));
    int64_t best = INT64_MAX;
    for (int round = 0; round < 5; round++) {
        const int64_t started = now();
        for (long i = 0; i < PUSHES; i++) {
            sink = d_push(&stream, x[i]);
        }
        const int64_t elapsed = now() - started;
        best = elapsed < best ? elapsed : best;
    }
    printf("\\"back_to_back\\": %.2f, \\"hash\\": %" PRIu64 "}\\n", (double)best / PUSHES, hash);
    return 0;
}
""")


def run(command: Sequence[str]) -> dict[str, Any]:
    """Run a program and return the line of JSON that it prints."""
    done = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def compiled(case: Case, folder: Path) -> list[str] | None:
    """Return the command of a C program around the header, if there is a compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    own = folder / f"{case.windows[0]}-{case.dtype}"
    own.mkdir()
    (own / "d.h").write_text(case.designs()[0].to_c(name="d", dtype=case.dtype), encoding="utf-8")
    real = "double" if case.dtype == "float64" else "float"
    text = PROGRAM.substitute(real=real, pushes=PUSHES, hashed=HASHED)
    (own / "main.c").write_text(text, encoding="utf-8")
    command = [compiler, *FLAGS, "-o", str(own / "main"), str(own / "main.c"), "-lm"]
    subprocess.run(command, check=True)  # noqa: S603
    return [str(own / "main")]


def bench_of_rust() -> list[str] | None:
    """Return the command of the bench of the core, built if need be, if there is a cargo."""
    cargo = shutil.which("cargo")
    if cargo is None:
        return None
    command = [cargo, "bench", "-p", "algdiff-core", "--bench", "stream", "--no-run", "--message-format=json"]
    root = Path(__file__).resolve().parent.parent
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=root)  # noqa: S603
    built = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    found = [one["executable"] for one in built if one.get("target", {}).get("name") == "stream" and one["executable"]]
    return [found[0], "--json"]


def hashed(estimates: NDArray[Any]) -> int:
    """Return the hash of the bits that the programs make."""
    found = 14695981039346656037
    for bits in estimates.swapaxes(0, 1).astype(float).view(np.uint64).ravel().tolist():
        found = (found ^ bits) * 1099511628211 & (2**64 - 1)
    return found
