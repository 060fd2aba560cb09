"""
Missing samples
===============

A sensor drops samples, one by one and for a while. By default an estimate is missing wherever its window misses a
sample; ``nan_policy="omit"`` fits the samples that are there, says how many there were, and how much larger the error
is for it.
"""

import matplotlib.pyplot as plt
import numpy as np

import algdiff

plt.style.use("tableau-colorblind10")
rng = np.random.default_rng(0)
delta, level = 0.01, 0.05  # s, V
t = np.arange(0, 8, delta)
x = np.sin(3 * t) + 0.5 * np.sin(7 * t) + level * rng.standard_normal(t.size)
truth = 3 * np.cos(3 * t) + 3.5 * np.cos(7 * t)

# %%
# A tenth of the samples is gone, and all of two stretches: one shorter than the window, one longer. NaN marks them; the
# mask of a masked array would, too.

gone = rng.random(t.size) < 0.1
gone[(t > 2.0) & (t < 2.25)] = True
gone[(t > 5.0) & (t < 5.8)] = True
x[gone] = np.nan

d = algdiff.Differentiator(51, degree=4, delta=delta)
plain = d(x)
found = d(x, nan_policy="omit", return_std=True, return_support=True)
print(f"samples missing: {np.isnan(x).mean():.0%}")
print(f"estimates missing: {np.isnan(plain).mean():.0%} by default, {np.isnan(found.estimate).mean():.0%} with 'omit'")

# %%
# The error bars grow where samples are missing, and at the ends, where the window lies to one side. Inside the long
# hole there is no estimate: a fit needs more samples than its degree (``min_support``), and its noise must not be blown
# up too far (``max_gain``). Nothing is filled in.

there = ~np.isnan(found.estimate)
off = np.abs(found.estimate - truth)[there] / found.std[there]
print(f"noise level found: {algdiff.noise_level(x):.4f} V")
print(f"error bars from {np.nanmin(found.std):.3f} to {np.nanmax(found.std):.3f} V/s")
print(f"within 2 standard deviations: {(off < 2).mean():.1%} of the estimates")

figure, (signal, slope, support) = plt.subplots(
    3, 1, sharex=True, figsize=(7, 6), height_ratios=(2, 3, 1.3), layout="constrained"
)
signal.plot(t, x, ".", markersize=3)
signal.set(ylabel="signal, V", title="Estimates across gaps, with their error bars")
slope.fill_between(
    t,
    found.estimate - 2 * found.std,
    found.estimate + 2 * found.std,
    color="C1",
    alpha=0.6,
    linewidth=0,
    label="± 2 std",
)
slope.plot(t, found.estimate, "C0", linewidth=1.2, label="estimate")
slope.plot(t, truth, "k--", linewidth=0.8, label="truth")
slope.set(ylabel="derivative, V/s", ylim=(-10, 10))
slope.legend(ncols=3, loc="lower left", fontsize="small")
support.plot(t, found.support, "C0", drawstyle="steps-mid")
support.set(xlabel="time, s", ylabel="samples used", ylim=(0, d.window_length + 2))
plt.show()

# %%
# What is often done instead: fill the gaps by straight lines and go on. Where single samples are missing, little is
# lost by it. Beside the holes the lines trade noise for bias, and which is the larger depends on the noise; but only
# the error of the fits is known.

lines = d(np.interp(t, t[~gone], x[~gone]))
hole = there & (found.support < 0.8 * d.window_length)
for name, group in (("single samples missing", there & ~hole), ("beside holes", hole)):
    omit, interpolated = (np.sqrt(np.mean((one - truth)[group] ** 2)) for one in (found.estimate, lines))
    known = np.sqrt(np.mean(found.std[group] ** 2))
    print(f"{name:23} RMSE of fits {omit:.2f} V/s (std says {known:.2f}), over straight lines {interpolated:.2f} V/s")
