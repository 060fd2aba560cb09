"""
A differentiator in C
=====================

``to_c`` writes a design as a C99 header that needs no library and no heap: for a microcontroller, or any program that
has samples. It gives the bits of the engine "direct", which is checked here if there is a C compiler.
"""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from algdiff import Differentiator

plt.style.use("tableau-colorblind10")
d = Differentiator.from_delay(0.02, tau="root", degree=2, fs=1000)
header = d.to_c("velocity")
print("\n".join(line for line in header.splitlines() if line.startswith(("#define VELOCITY", "static inline"))))

# %%
# A program pushes samples as they come. The stream is a plain struct; all zeros is a new one.

PROGRAM = r"""
#include "velocity.h"

void run(const double *samples, double *estimates, long count)
{
    velocity_stream stream = {{0}, 0, 0};
    for (long i = 0; i < count; i++)
        estimates[i] = velocity_push(&stream, samples[i]); /* NAN until the window is full */
}
"""

# %%
# Compile it as a library that Python can load. Every operation must be rounded by itself, or the last bits may differ:
# GCC and Clang need ``-ffp-contract=off`` for that, which ``-std=c99`` implies in GCC.

rng = np.random.default_rng(0)
t = np.arange(1500) / d.fs
x = np.sin(10 * t) + 0.01 * rng.standard_normal(t.size)
offline = np.full(t.size, np.nan)
offline[d.window_length - 1 :] = d.replace(engine="direct")(x, mode="valid")


def compiled(samples):
    """Return the estimates of the C program, or None if there is no compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "velocity.h").write_text(header)
        Path(folder, "program.c").write_text(PROGRAM)
        command = [
            compiler,
            "-std=c99",
            "-O2",
            "-ffp-contract=off",
            "-shared",
            "-fPIC",
            "program.c",
            "-o",
            "program.so",
        ]
        subprocess.run(command, cwd=folder, check=True)
        estimates = np.empty_like(samples)
        pointer = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
        run = ctypes.CDLL(str(Path(folder, "program.so"))).run
        run.argtypes = [pointer, pointer, ctypes.c_long]
        run(samples, estimates, samples.size)
    return estimates


estimates = compiled(x)
if estimates is None:
    print("There is no C compiler (cc) here: the figure shows what Python computes.")
else:
    print("The program gives the bits of Python:", np.array_equal(estimates, offline, equal_nan=True))

# %%
# An estimate belongs to a time before the newest sample, which the header states in seconds and in samples.

shown = offline if estimates is None else estimates
figure, axes = plt.subplots(figsize=(7, 3.8), layout="constrained")
axes.plot(t, 10 * np.cos(10 * t), "k--", linewidth=1, label="truth")
axes.plot(t, shown, "C1", linewidth=1, label="as it comes")
axes.plot(t - d.delay, shown, "C0", label=f"{1000 * d.delay:.1f} ms earlier")
axes.set(xlabel="time, s", ylabel="velocity, 1/s", title="Estimates of the C program", ylim=(-13, 17))
axes.legend(ncols=3, loc="upper center")
plt.show()
