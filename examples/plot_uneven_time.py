"""
Uneven times
============

Time stamps jitter, samples come in bursts, some never come. Give their times as ``t`` instead of a step: every
estimate is then a fit to the samples of its window at the times when they were taken.
"""

import matplotlib.pyplot as plt
import numpy as np

import algdiff

plt.style.use("tableau-colorblind10")
rng = np.random.default_rng(0)

# %%
# A clock with jitter, which in the middle skips a second, and later runs at a third of its rate.

step = 0.01  # s
t = step * (np.arange(1000) + 0.4 * rng.uniform(-1, 1, 1000))
kept = ((t < 4) | (t > 5)) & ((t < 7) | (np.arange(t.size) % 3 == 0))
t = t[kept]
x = np.sin(2 * t) + 0.01 * rng.standard_normal(t.size)  # m
truth = 2 * np.cos(2 * t)
steps = np.diff(t)
print(f"{t.size} samples, {1000 * steps.min():.1f} to {1000 * steps.max():.0f} ms apart")

# %%
# A window may be a number of samples, however long they take, or a duration, however many samples it holds. The first
# keeps the noise alike, the second the bias. ``np.gradient`` knows uneven times as well, but no noise; and whoever
# takes the times for even errs even in a wide window.

estimates = {
    "np.gradient": np.gradient(x, t),
    "taken for even": algdiff.differentiate(x, 61, delta=float(np.mean(steps))),
    "61 samples": algdiff.differentiate(x, 61, t=t),
    "0.6 s": algdiff.differentiate(x, window_duration=0.6, t=t),
}
for name, estimate in estimates.items():
    print(f"{name:15} RMSE {np.sqrt(np.mean((estimate - truth) ** 2)):.3f} m/s")

figure, (signal, slope) = plt.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")
signal.plot(t, x, ".", markersize=3)
signal.set(ylabel="position, m", title="A jittering clock with a hole")
for name, style in (("np.gradient", "C2."), ("taken for even", "C1."), ("61 samples", "C0.")):
    slope.plot(t, estimates[name], style, markersize=3, label=name)
dense = np.linspace(0, 10, 500)
slope.plot(dense, 2 * np.cos(2 * dense), "k--", linewidth=1, label="truth")
slope.set(xlabel="time, s", ylabel="velocity, m/s", ylim=(-6, 4.5))
slope.legend(ncols=4, loc="lower center", fontsize="small", markerscale=2)
plt.show()

# %%
# Estimates are at the times of the samples, or at those of ``at``: on an even grid, say, to go on with. In the hole,
# where samples are far, the standard deviation grows, and says so; ``max_gain`` limits by how much more noise than in
# an evenly filled window an estimate is still worth giving.

grid = np.arange(0.5, 9.5, 0.02)
found = algdiff.differentiate(x, window_duration=0.6, t=t, at=grid, max_gain=100, return_std=True)
print(f"std from {np.nanmin(found.std):.3f} to {np.nanmax(found.std):.2f} m/s", end="; ")
print(f"no estimate at {np.isnan(found.std).sum()} of {grid.size} times")

figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
axes.semilogy(grid, found.std, label="std reported")
axes.semilogy(grid, np.abs(found.estimate - 2 * np.cos(2 * grid)), "C1.", markersize=3, label="error")
axes.set(xlabel="time, s", ylabel="m/s", ylim=(1e-4, None), title="Estimates on an even grid")
axes.legend(loc="lower left")
plt.show()
