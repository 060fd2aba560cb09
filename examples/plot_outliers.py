"""
Outliers that a prediction does not expect
==========================================

A sensor now and then reports nonsense. A design with ``tau`` above 1, a negative delay, predicts the next sample from
those before it; a sample too far from what was predicted is left out, and the derivative is fitted to the others.
"""

import matplotlib.pyplot as plt
import numpy as np

import algdiff

plt.style.use("tableau-colorblind10")
rng = np.random.default_rng(3)
delta, sigma = 0.01, 0.02
t = np.arange(0, 20, delta)
clean = np.sin(t) + 0.5 * np.sin(2.3 * t)
velocity = np.cos(t) + 1.15 * np.cos(2.3 * t)
x = clean + sigma * rng.standard_normal(t.size)
wrong = rng.choice(np.arange(40, t.size), 30, replace=False)
x[wrong] += rng.choice([-1, 1], wrong.size) * rng.uniform(0.06, 1.0, wrong.size)

# %%
# The predictor smooths (``deriv=0``) at one step after its newest sample. If the noise is white, what it misses the
# next sample by has the variance of that sample and of its own estimate: ``sigma**2 * (1 + noise_gain)``. The level of
# the noise comes from the data, outliers and all, and four standard deviations are the limit.

predictor = algdiff.Differentiator(31, 0, degree=2, delay=-delta, delta=delta)
level = algdiff.noise_level(x)
limit = 4 * level * np.sqrt(1 + predictor.noise_gain)
print(f"tau {predictor.tau:.4f}, noise gain {predictor.noise_gain:.3f}, exact to degree {predictor.exactness}")
print(f"noise level {level:.4f} (made with {sigma}), limit {limit:.4f}")

# %%
# Sample by sample, because an outlier must not spoil the predictions that follow: what is refused is replaced by its
# prediction, for the predictor only.

window = predictor.window_length
accepted, residual = x.copy(), np.zeros_like(x)
for i in range(window, x.size):
    predicted = predictor.weights @ accepted[i - window : i]
    residual[i] = x[i] - predicted
    if abs(residual[i]) > limit:
        accepted[i] = predicted
found = np.abs(residual) > limit

# %%
# What was gained: the derivative with the samples that were refused marked as missing, against one that takes all
# samples as they are, and against one of the same recording without outliers.

hits, truth = np.count_nonzero(found[wrong]), np.zeros(x.size, bool)
truth[wrong] = True
print(f"of {wrong.size} outliers found: {hits}; good samples refused: {np.count_nonzero(found & ~truth)}")

d = algdiff.Differentiator(61, degree=3, delta=delta)
taken = d(x)
left_out = d(np.where(found, np.nan, x), nan_policy="omit")
best = d(np.where(truth, np.nan, x), nan_policy="omit")
for name, estimate in (("all samples", taken), ("without what was found", left_out), ("without all outliers", best)):
    print(f"RMSE of the velocity, {name:23} {np.sqrt(np.mean((estimate - velocity) ** 2)):.4f}")

figure, (above, middle, below) = plt.subplots(3, 1, sharex=True, figsize=(7, 7), layout="constrained")
shown = t < 8
above.plot(t[shown], x[shown], linewidth=0.8, label="samples")
above.plot(t[shown & found], x[shown & found], "C1o", markerfacecolor="none", label="refused")
above.set_ylabel("signal")
above.set_title("Samples that a prediction does not expect")
middle.plot(t[shown], np.abs(residual[shown]), linewidth=0.8, label="prediction error")
middle.axhline(limit, color="C1", linestyle="--", label="4 standard deviations")
middle.set(ylabel="|residual|", yscale="log", ylim=(1e-4, 2))
below.plot(t[shown], taken[shown], "0.6", linewidth=0.9, label="all samples")
below.plot(t[shown], left_out[shown], label="refused left out")
below.plot(t[shown], velocity[shown], "k--", linewidth=1, label="true")
below.set(xlabel="time, s", ylabel="velocity, 1/s")
for ax in (above, middle, below):
    ax.legend(loc="upper right", fontsize="small", ncols=3)

# %%
# Outliers near the limit are missed now and then, and do little harm. The limit trusts the model: a real jump of the
# signal is refused as well, and with it all that follows, until the replaced samples have led the predictor astray or
# somebody resets it. A shorter window follows faster and predicts less well.

for length in (11, 31, 61):
    gain = predictor.replace(window_length=length).noise_gain
    print(f"{length:3} samples: the limit is {4 * level * np.sqrt(1 + gain):.4f}")

plt.show()
