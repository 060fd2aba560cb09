"""
The figures of the 2007 paper
=============================

Figures 1 to 4 of M. Mboup, C. Join and M. Fliess, *A revised look at numerical differentiation with an application to
nonlinear feedback control* (2007): a noisy signal, and four estimators of its derivative, each as late as the paper
predicts. Signal, noise and estimators are those of ``algdiff demo --paper``; ``examples/paper_figures.py`` builds the
same figure from public functions alone.
"""

import matplotlib.pyplot as plt

from algdiff import _paper_figures as paper

plt.style.use("tableau-colorblind10")

# %%
# The paper gives the signal and its noise as a ratio of powers, but not the sampling step. At this one its remarks on
# the figures hold.

t, y = paper.TIMES, paper.observe(seed=0)
print(f"{t.size} samples at {paper.DELTA:g} s, {paper.DECIBELS:g} dB")

# %%
# Of the four estimators, those with "root" and "center" know that they are late, and by how much. Every estimate is
# compared with the true derivative at the time for which it stands. The paper integrates by the trapezoidal rule; the
# rule "exact", the default, fits the samples themselves.

for curve in paper.CURVES:
    errors = {rule: curve.estimate(y, rule).rmse() for rule in paper.RULES}
    print(f"{curve.label:35}{curve.design('exact').delay:6.3f} s late, RMSE", end="")
    print("".join(f"  {error:.3f} ({rule})" for rule, error in errors.items()))

# %%
# No delay (Fig. 3) is dear, although its model is richer than that of Fig. 2: nearly all of its error is bias, where
# the signal is fast. The delay that a root brings (Fig. 4, solid) takes most of it away, and a longer one still more.

figure, axes = plt.subplots(2, 2, sharex=True, figsize=(9, 6), layout="constrained")
axes[0, 0].plot(t, y, linewidth=0.8)
axes[0, 0].set(title="Fig. 1: noisy observation", ylabel="x")
panels = (axes[0, 1], axes[1, 0], axes[1, 1], axes[1, 1])
titles = (
    "Fig. 2: N = 1, windows [t, t + T]",
    "Fig. 3: N = 2, no delay",
    "Fig. 4: N = 2 at a root, N = 3 at the center",
)
for curve, panel, title, color in zip(
    paper.CURVES, panels, (*titles, titles[-1]), ("C0", "C0", "C0", "C1"), strict=True
):
    found = curve.estimate(y, "trapezoid")
    panel.plot(found.stamps, found.truth, "k:", linewidth=1.2, label="truth, shifted by the delay")
    panel.plot(found.stamps, found.values, color, label=f"estimate, N = {curve.degree}")
    panel.set(title=title, ylabel="dx/dt, 1/s")
for panel in axes[1]:
    panel.set_xlabel("time, s")
for panel in axes.flat[1:]:
    handles = {label: handle for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    panel.legend(handles.values(), handles.keys(), fontsize="small")

plt.show()

# %%
# What the paper does not show: an offset leaks through the trapezoidal rule wherever the weights are not antisymmetric.
# The rule "exact" does not see it.

offset = paper.OFFSET
print(f"RMSE with an offset of {offset:g}:")
for curve in paper.CURVES:
    print(f"{curve.label:35}" + "".join(f"  {curve.estimate(y + offset, r).rmse():.3f} ({r})" for r in paper.RULES))
