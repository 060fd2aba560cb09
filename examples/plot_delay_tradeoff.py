"""
What a delay is worth
=====================

In a loop an estimate should come at once, but estimates without delay are noisy. ``delay_tradeoff`` says, for a
sinusoid of the highest frequency that matters, what the least error is at each delay, and which window reaches it.
"""

import matplotlib.pyplot as plt
import numpy as np

import algdiff

plt.style.use("tableau-colorblind10")

# %%
# What is known: the sampling rate, the noise, and how fast and how large the signal gets. That is all; the curve needs
# no samples.

fs, level, bandwidth, amplitude = 1000.0, 0.01, 2.0, 1.0  # Hz, rad, Hz, rad
delays = np.linspace(0, 0.12, 49)
known = {"bandwidth": bandwidth, "amplitude": amplitude, "fs": fs}
curves = {degree: algdiff.delay_tradeoff(delays, level, degree=degree, **known) for degree in (2, 3, 4)}
for degree, curve in curves.items():
    best = int(np.argmin(curve.rmse))
    least, at = curve.rmse[best], 1000 * delays[best]
    print(f"degree {degree}: {curve.rmse[0]:.2f} rad/s without delay, {least:.2f} rad/s at {at:.0f} ms")

# %%
# Check it: make some of these designs, and let them differentiate such a sinusoid in noise. Each estimate is compared
# with the truth at the time it stands for, ``delay`` before the newest sample.

t = np.arange(20_000) / fs
omega = 2 * np.pi * bandwidth
x = amplitude * np.sin(omega * t) + level * np.random.default_rng(0).standard_normal(t.size)

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for (degree, curve), color in zip(curves.items(), ("C0", "C1", "C3"), strict=True):
    axes.semilogy(1000 * curve.delay, curve.rmse, color, label=f"degree {degree}")
    for i in range(0, delays.size, 8):
        d = algdiff.Differentiator(curve.window_length[i], degree=degree, delay=curve.delay[i], fs=fs)
        estimate = d(x, mode="valid")
        truth = amplitude * omega * np.cos(omega * (t[d.window_length - 1 :] - d.delay))
        axes.plot(1000 * d.delay, np.sqrt(np.mean((estimate - truth) ** 2)), color, marker="o", markersize=5)
axes.plot([], [], "ko", label="simulated")
axes.set(xlabel="delay, ms", ylabel="least RMSE, rad/s", title="The error that each delay allows")
axes.legend()
plt.show()

# %%
# The windows behind the curve grow with the delay, which damps the noise, and jump where another point of the window
# becomes the best one to estimate at. There the curve has humps: a delay somewhat longer need not be better.

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for (degree, curve), color in zip(curves.items(), ("C0", "C1", "C3"), strict=True):
    axes.plot(1000 * curve.delay, curve.window_length / fs * 1000, color, label=f"degree {degree}")
axes.set(xlabel="delay, ms", ylabel="window, ms")
axes.legend()
plt.show()
