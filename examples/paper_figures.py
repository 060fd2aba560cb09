"""Figures 1 to 4 of Mboup, Join and Fliess (2007), drawn by the public functions of algdiff.

``python examples/paper_figures.py [FILE]`` writes the figure to FILE (paper_figures.png) and prints what the curves err
by, under the paper's trapezoidal rule and under the default rule. It needs matplotlib.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

from algdiff import Differentiator

DELTA = 0.005  # the paper does not state its sampling step
t = np.arange(0, 1001) * DELTA
x = np.tanh(t - 1) + np.exp(-t / 1.2) * np.sin(6 * t + np.pi)


def derivative(t):
    """Return the derivative of x."""
    return 1 / np.cosh(t - 1) ** 2 + np.exp(-t / 1.2) * (6 * np.cos(6 * t + np.pi) - np.sin(6 * t + np.pi) / 1.2)


# White noise, scaled so that 10 log10(sum y^2 / sum n^2) is exactly 25 dB: a quadratic equation for the scale.
noise = np.random.default_rng(0).standard_normal(t.size)
roots = np.roots([(1 - 10**2.5) * (noise @ noise), 2 * (x @ noise), x @ x])
y = x + roots.max() * noise

# T = 60 or 110 sampling steps: one sample more. Under both rules the same samples make the estimates.
curves = {
    "Fig. 2: N = 1": {"window_length": 61, "degree": 1, "kappa": 2, "mu": 2, "tau": "root"},
    "Fig. 3: N = 2, no delay": {"window_length": 111, "degree": 2, "kappa": 0, "mu": 0, "tau": "newest"},
    "Fig. 4 solid: N = 2, tau_1": {"window_length": 111, "degree": 2, "kappa": 0, "mu": 0, "tau": "root"},
    "Fig. 4 dashed: N = 3, tau_2 = 1/2": {"window_length": 111, "degree": 3, "kappa": 0, "mu": 0, "tau": "center"},
}

figure, axes = plt.subplots(2, 2, sharex=True, figsize=(11, 7.5), layout="constrained")
axes[0, 0].plot(t, y, linewidth=0.8)
axes[0, 0].set_title("Fig. 1: noisy observation, 25 dB")
panels = [axes[0, 1], axes[1, 0], axes[1, 1], axes[1, 1]]
for (name, options), panel in zip(curves.items(), panels, strict=True):
    rmse = {}
    for rule in ("exact", "trapezoid"):
        d = Differentiator(**options, delta=DELTA, rule=rule)
        estimate = d(y, mode="valid")  # exactly at tau, for every full window
        newest = t[d.window_length - 1 :]
        truth = derivative(newest - d.delay)
        rmse[rule] = np.sqrt(np.mean((estimate - truth) ** 2))
    print(f"{name:34} delay {d.delay:.3f} s  RMSE {rmse['trapezoid']:.4f} (trapezoid) {rmse['exact']:.4f} (exact)")
    # The paper dates the windows of Figure 2 by their first sample, the others by their last.
    stamps = t[: len(estimate)] if "Fig. 2" in name else newest
    panel.plot(stamps, estimate, label=name)
    panel.plot(stamps, truth, "--", label="true derivative, shifted by the delay")

for panel in axes.flat[1:]:
    panel.legend(loc="upper right", fontsize="small")
plt.savefig(sys.argv[1] if len(sys.argv) > 1 else "paper_figures.png")
