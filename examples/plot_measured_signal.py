"""
A notebook of the AlgDiff toolbox, on this library
==================================================

``algdiff.compat.AlgebraicDifferentiator`` has the methods and arguments of the toolbox's class, so that a notebook
changes by its import line. Here it differentiates a measured signal, a pendulum's encoder, next to the plain interface,
and shows where "exact", the rule that the toolbox has not, makes a difference. The recording comes with the package
((c) 2022 dynamicslab, MIT licence).
"""

from importlib.resources import files

import matplotlib.pyplot as plt
import numpy as np

import algdiff
from algdiff.compat import AlgebraicDifferentiator  # instead of: from AlgDiff import AlgebraicDifferentiator

plt.style.use("tableau-colorblind10")
with (files("algdiff") / "data" / "pendulum_encoder.npz").open("rb") as file, np.load(file) as recording:
    theta = recording["counts"] * (2 * np.pi / recording["counts_per_revolution"])  # rad
    ts = float(recording["dt"])  # s
t = ts * np.arange(theta.size)

# %%
# As in the toolbox: exponents for both derivatives, the polynomial's degree N, the window T. It says the cutoff and
# the delay that follow. Estimates are causal, so that they belong to the time one delay ago; the first window is NaN,
# where the toolbox says 0.

diff = AlgebraicDifferentiator(ts=ts, alpha=4.0, beta=4.0, N=1, T=0.12)
method = "exact"
angle, velocity, acceleration = (diff.estimateDer(k, theta, method) for k in (0, 1, 2))
late = diff.get_delayDiscrete()[method]
print(f"delay {late:.5f} s, exact to degree {[diff.get_degreeExactness(k) for k in (0, 1, 2)]} for the three orders")
print(f"no estimate: the first {np.count_nonzero(np.isnan(velocity))} of {theta.size} samples")

# %%
# The same by the plain interface: one window for the three orders in one pass, chosen by the data, aligned with
# the samples, to both ends. ``differentiator`` gives the design behind the class, for a step by step change.

suggestion = algdiff.suggest(theta, deriv=2, delta=ts)
plain = suggestion.differentiator.replace(deriv=(0, 1, 2))(theta)
print(diff.differentiator(1))
print(suggestion.differentiator)

# %%
# Which estimates are good, an equation says that none of them was told: the acceleration of a pendulum is a sin(angle)
# less b times the velocity, with a and b fitted by least squares to the free swing.


def equation(angle, velocity, acceleration):
    """Return what is left of the acceleration, and the share that the equation explains."""
    free = slice(round(0.4 / ts), -round(0.2 / ts))
    terms = np.stack([np.sin(angle), -velocity], axis=1)[free]
    left = acceleration[free] - terms @ np.linalg.lstsq(terms, acceleration[free])[0]
    return left.std(), 1 - left.var() / acceleration[free].var()


for name, estimates in (("AlgebraicDifferentiator", (angle, velocity, acceleration)), ("suggest", plain)):
    rest, share = equation(*estimates)
    print(f"{name:24} R^2 {share:.5f}, left {rest:.4f} rad/s^2 rms")

figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")
shown = t < 3
for ax, ours, causal, label in zip(
    axes, plain[1:], (velocity, acceleration), ("velocity, rad/s", "acceleration, rad/s²"), strict=True
):
    ax.plot(t[shown], causal[shown], label="estimateDer, as it comes")
    ax.plot(t[shown] - late, causal[shown], "C1", label="the same, less its delay")
    ax.plot(t[shown], ours[shown], "k--", linewidth=1, label="suggest, aligned")
    ax.set_ylabel(label)
axes[0].set_title("A pendulum's encoder, by the toolbox's class")
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
axes[1].set_xlabel("time, s")

# %%
# The rules of the toolbox sample the kernel, and what they sample does not quite add up to 0. With smooth ends and many
# samples that is nothing. Without delay, over few samples, an encoder that has turned ten times shows a speed that is
# not there. ``corr`` mends the gain, not this.

turned = theta[: round(2.0 / ts) : 20] + 10 * 2 * np.pi  # as if read every 2 ms
live = AlgebraicDifferentiator(ts=20 * ts, alpha=2.0, beta=2.0, N=1, T=0.12, display=False)
live.set_theta(1.0, False)
speeds = {rule: live.estimateDer(1, turned, rule) for rule in ("mid-point", "exact")}
for rule, speed in speeds.items():
    added = speed - live.estimateDer(1, turned - 10 * 2 * np.pi, rule)
    print(f"{rule:9}: ten turns add {np.nanmean(added):+.2e} rad/s")

figure, ax = plt.subplots(figsize=(7, 3), layout="constrained")
for (rule, speed), colour in zip(speeds.items(), ("C1", "C0"), strict=True):
    ax.plot(20 * ts * np.arange(turned.size), speed, colour, label=rule)
ax.plot(t[t < 2], plain[1][t < 2], "k--", linewidth=1, label="suggest, from the whole recording")
ax.set(xlabel="time, s", ylabel="velocity, rad/s", title="Without delay, after ten turns")
ax.legend(loc="center right")

# %%
# What was gained: the notebook runs on a current NumPy, with delays that are what they say, and offsets do no harm.
# What was not: over many samples of a smooth kernel the rules agree, and causal estimates come as late as ever.
# Estimates at the times of the samples need samples from both sides, which the plain interface takes.

gap = np.nanmax(np.abs(diff.estimateDer(1, theta, "mid-point") - velocity))
print(f"largest difference between mid-point and exact for alpha = 4: {gap:.1e} rad/s")

plt.show()
