"""
From savgol_filter
==================

``algdiff.savgol_filter`` takes SciPy's arguments and gives SciPy's results, faster; also where the window is long and
the degree high, and SciPy's coefficients lose their digits. From there it is a step to what a Savitzky-Golay filter
lacks.
"""

import time

import matplotlib.pyplot as plt
import numpy as np
import scipy.signal

import algdiff

plt.style.use("tableau-colorblind10")
delta = 1e-4  # s
t = delta * np.arange(20_000)
x = np.sin(10 * t) + 1e-3 * np.random.default_rng(0).standard_normal(t.size)

# %%
# One changed import. The results agree to rounding, at the ends as well.

theirs = scipy.signal.savgol_filter(x, 101, 3, deriv=1, delta=delta)
ours = algdiff.savgol_filter(x, 101, 3, deriv=1, delta=delta)
print(f"apart by at most {np.abs(ours - theirs).max():.1e} of {np.abs(ours).max():.1f}")


def seconds(function, *arguments):
    """Return the best time of three calls."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        function(*arguments)
        times.append(time.perf_counter() - start)
    return min(times)


for window in (11, 101, 1001):
    ratio = seconds(scipy.signal.savgol_filter, x, window, 3, 1) / seconds(algdiff.savgol_filter, x, window, 3, 1)
    print(f"window {window:4}: {ratio:.0f} times as fast in this run")

# %%
# Long windows. SciPy's coefficients come from a system of powers of sample numbers, which is singular in double
# precision before long; no warning says so. Coefficients of a smoother must add up to one.

degree, lengths = 5, np.array([101, 201, 401, 801, 1601, 3201])
figure, axes = plt.subplots(figsize=(7, 3.8), layout="constrained")
for name, coefficients, style in (
    ("SciPy", scipy.signal.savgol_coeffs, "C1s-"),
    ("algdiff", algdiff.savgol_coeffs, "C0o-"),
):
    miss = [abs(coefficients(n, degree).sum() - 1) for n in lengths.tolist()]
    print(f"{name:8} misses 1 by " + ", ".join(f"{one:.0e}" for one in miss))
    axes.loglog(lengths, np.maximum(miss, 1e-17), style, label=name)
axes.set(xlabel="window, samples", ylabel="|sum of the coefficients - 1|", title=f"Smoothers of degree {degree}")
axes.legend()
plt.show()

# %%
# The same filter as a design, with what else there is: weights that fall off toward the ends of the window damp high
# frequencies (``kappa``, ``mu``, by default 1), the estimate need not be in the middle of its window (``tau``), and the
# design says what it does.

for name, words in (
    ("savgol_filter", {"kappa": 0, "mu": 0}),
    ("default weights", {}),
    ("newest sample", {"kappa": 0, "mu": 0, "tau": "newest"}),
):
    d = algdiff.Differentiator(101, degree=3, delta=delta, **words)
    noise, damped = d.noise_gain**0.5, abs(d.frequency_response(0.4 / delta))
    print(
        f"{name:16} delay {1000 * d.delay:.1f} ms, noise x {noise:5.1f}, amplitude near Nyquist {damped:6.2f}, in 1/s"
    )
same = algdiff.Differentiator(101, degree=3, kappa=0, mu=0, delta=delta)(x)
print(f"the first of them is the same filter: apart by at most {np.abs(same - ours).max():.1e}")
