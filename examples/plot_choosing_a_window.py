"""
Choosing a window from the data
===============================

A short window lets noise through, a long one misses what the signal does. ``suggest`` compares windows and degrees by
their estimates alone, and says what it expects them to err by. Here the truth is known, so that its expectations can
be checked.
"""

import matplotlib.pyplot as plt
import numpy as np

import algdiff

plt.style.use("tableau-colorblind10")
delta = 0.005  # s
t = delta * np.arange(1001)
x = np.tanh(t - 1) + np.exp(-t / 1.2) * np.sin(6 * t + np.pi) + 0.05 * np.random.default_rng(0).standard_normal(t.size)
truth = np.cosh(t - 1) ** -2 + np.exp(-t / 1.2) * (6 * np.cos(6 * t + np.pi) - np.sin(6 * t + np.pi) / 1.2)


def rmse(estimate, kept=slice(None)):
    """Return the root-mean-square error."""
    return np.sqrt(np.mean((estimate - truth)[kept] ** 2))


# %%
# It is told the samples and their step, nothing else. ``differentiate(x, delta=delta)``, without a window, does the
# same and differentiates.

suggestion = algdiff.suggest(x, delta=delta)
print(suggestion.explain())
print(f"error expected {suggestion.rmse:.3f}, true {rmse(suggestion(x)):.3f}")

# %%
# The curve of what it compared: for every degree the expected error over the window, and what each candidate truly errs
# by, over the samples that have a whole window around them. At short windows errors are noise, at long ones bias. A
# bias that the noise may explain counts as none in the curve, which is too low then; so the choice is not its lowest
# point, but made among its neighbours by other estimates of their errors.

curve = suggestion.curve
chosen = suggestion.differentiator
figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
for degree, color in zip(np.unique(curve.degree), ("C0", "C1", "C2", "C3"), strict=True):
    of = (curve.degree == degree) & (curve.window_length > 30) & (curve.window_length < t.size // 2)
    lengths = curve.window_length[of]
    true = [
        rmse(chosen.replace(window_length=int(n), degree=int(degree))(x), slice(n // 2, -(n // 2))) for n in lengths
    ]
    axes.loglog(delta * lengths, curve.rmse[of], color, label=f"degree {degree}")
    axes.loglog(delta * lengths, true, color, linestyle=":")
axes.plot([], [], "k-", label="expected")
axes.plot([], [], "k:", label="true")
best = (curve.window_length == chosen.window_length) & (curve.degree == chosen.degree)
axes.plot(delta * curve.window_length[best], curve.rmse[best], "k*", markersize=14, label="chosen")
axes.set(xlabel="window, s", ylabel="RMSE of the derivative, 1/s", title="Expected and true errors of windows")
axes.legend(ncols=2, fontsize="small")
plt.show()

# %%
# What a choice is worth: windows a quarter as long and twice as long, of the same degree, and the chosen one. Called, a
# suggestion also treats the ends with care; the design alone extends its last window to them.

figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
length = chosen.window_length
for name, estimate, style in (
    ("a quarter", chosen.replace(window_length=length // 4)(x), "C2"),
    ("twice", chosen.replace(window_length=2 * length)(x), "C1"),
    ("chosen", suggestion(x), "C0"),
):
    print(f"{name:10} RMSE {rmse(estimate):.3f}")
    axes.plot(t, estimate, style, linewidth=1.2, label=name)
print(f"chosen, design alone at the ends: RMSE {rmse(chosen(x)):.3f}")
axes.plot(t, truth, "k--", linewidth=1, label="truth")
axes.set(xlabel="time, s", ylabel="derivative, 1/s", ylim=(-8, 8))
axes.legend(ncols=4, loc="lower right")
plt.show()
