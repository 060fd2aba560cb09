"""
How sure is an estimate?
========================

An estimate is a weighted sum of samples, so that its standard deviation follows from theirs. ``return_std`` reports
it, ``return_bias`` an indicator of what the window misses. Here the truth is known: are the error bars right?
"""

import math

import matplotlib.pyplot as plt
import numpy as np

import algdiff

plt.style.use("tableau-colorblind10")
rng = np.random.default_rng(0)
delta = 0.01  # s
t = delta * np.arange(2000)
clean, truth = np.sin(t), np.cos(t)  # m, m/s

# %%
# The noise need not be known: ``noise_level`` finds it, from differences of neighbouring samples. Error bars are wider
# at the ends, where the window lies to one side of the sample.

x = clean + 0.02 * rng.standard_normal(t.size)
d = algdiff.Differentiator(61, delta=delta)
found = d(x, return_std=True)
print(f"noise level found: {algdiff.noise_level(x):.4f} m")
print(f"std at the first sample {found.std[0]:.3f} m/s, in the middle {found.std[1000]:.3f} m/s")

# %%
# Errors in units of their standard deviations, of many recordings: they are to follow the normal law.

recordings = clean + 0.02 * rng.standard_normal((100, t.size))
many = d(recordings, return_std=True)
scores = (many.estimate - truth) / many.std
for bound in (1, 2, 3):
    print(f"within {bound} std: {np.mean(np.abs(scores) < bound):.4f}, normal {math.erf(bound / 2**0.5):.4f}")

shown = slice(0, 400)
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), width_ratios=(2, 1), layout="constrained")
left.fill_between(
    t[shown],
    (found.estimate - 2 * found.std)[shown],
    (found.estimate + 2 * found.std)[shown],
    color="C1",
    alpha=0.5,
    linewidth=0,
    label="± 2 std",
)
left.plot(t[shown], found.estimate[shown], "C0", linewidth=1, label="estimate")
left.plot(t[shown], truth[shown], "k--", linewidth=1, label="truth")
left.set(xlabel="time, s", ylabel="velocity, m/s", title="Error bars of a derivative")
left.legend()
z = np.linspace(-4, 4, 201)
right.hist(scores.ravel(), bins=80, range=(-4, 4), density=True, color="C4", label="errors")
right.plot(z, np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi), "k", linewidth=1.2, label="normal law")
right.set(xlabel="error / std", ylabel="density", ylim=(0, 0.55))
right.legend(fontsize="small")
plt.show()

# %%
# Two ways to fool them. Noise that is correlated from sample to sample needs its ``autocovariance``: taken for white,
# it is averaged less than it seems.

rho, count = 0.8, 2000
coloured = np.zeros(count)
white = rng.standard_normal(count) * np.sqrt(1 - rho**2)
for i in range(1, count):
    coloured[i] = rho * coloured[i - 1] + white[i]
y = clean + 0.02 * coloured
covariance = 0.02**2 * rho ** np.arange(d.window_length)
for name, words in (("taken for white", {}), ("autocovariance given", {"autocovariance": covariance})):
    one = d(y, return_std=True, **words)
    print(f"correlated noise, {name:21} within 2 std: {np.mean(np.abs(one.estimate - truth) < 2 * one.std):.3f}")

# %%
# And a window that is too long errs by more than noise. The bias indicator then exceeds the standard deviation.

for window in (61, 301, 601):
    one = d.replace(window_length=window)(x, return_std=True, return_bias=True)
    within, indicated = np.abs(one.estimate - truth) < 2 * one.std, np.abs(one.bias) > 2 * one.std
    print(
        f"window {window:3}: within 2 std {within.mean():.2f}, bias indicated at {indicated.mean():.2f} of the samples"
    )
