"""
Position, velocity and acceleration at once
===========================================

With a tuple of orders one pass over the data gives several derivatives, from the same windows and with the same delay:
what a phase portrait needs, or the identification of an equation.
"""

import matplotlib.pyplot as plt
import numpy as np

import algdiff

plt.style.use("tableau-colorblind10")

# %%
# A Van der Pol oscillator, x'' = mu (1 - x²) x' - x, integrated by Runge and Kutta's method; of its position alone
# there are samples, in noise.

mu, delta, level = 2.0, 0.01, 0.02  # 1, s, m


def rates(state):
    """Return velocity and acceleration."""
    x, v = state
    return np.array([v, mu * (1 - x**2) * v - x])


state, states = np.array([0.1, 0.0]), []
for _ in range(4000):
    states.append(state)
    k1 = rates(state)
    k2 = rates(state + delta / 2 * k1)
    k3 = rates(state + delta / 2 * k2)
    state = state + delta / 6 * (k1 + 2 * k2 + 2 * k3 + rates(state + delta * k3))
states = np.array(states).T
truth = np.array([*states, rates(states)[1]])
x = truth[0] + level * np.random.default_rng(0).standard_normal(truth.shape[1])

# %%
# Orders lie along the first axis of the result. The degree is one for all: two above the highest order, unless given.

d = algdiff.Differentiator(81, deriv=(0, 1, 2), delta=delta)
estimates = d(x)
print(f"shape {estimates.shape}, degree {d.degree}")
for order, (one, true, gain) in enumerate(zip(estimates, truth, d.noise_gain, strict=True)):
    error = np.sqrt(np.mean((one - true) ** 2))
    print(f"order {order}: RMSE {error:.4f}, of which noise {level * gain**0.5:.4f}; size {np.std(true):.2f}")

naive = np.gradient(x, delta)
figure, (left, right) = plt.subplots(1, 2, sharex=True, sharey=True, figsize=(8, 3.8), layout="constrained")
left.plot(x, naive, "C2.", markersize=1.5)
left.set(title="np.gradient", xlabel="position, m", ylabel="velocity, m/s", ylim=(-5, 5))
right.plot(estimates[0], estimates[1], "C0", linewidth=0.9, label="estimates")
right.plot(truth[0], truth[1], "k--", linewidth=0.7, label="truth")
right.set(title="one window for both", xlabel="position, m")
right.legend(loc="upper left", fontsize="small")
plt.show()

# %%
# From the three the equation comes back: a least-squares fit of the acceleration to the terms of a small library finds
# the coefficients of velocity, x² velocity and position.

position, velocity, acceleration = estimates[:, 100:-100]
terms = np.stack([velocity, position**2 * velocity, position], axis=1)
found, *_ = np.linalg.lstsq(terms, acceleration)
for name, value, true in zip(("v", "x² v", "x"), found, (mu, -mu, -1.0), strict=True):
    print(f"{name:5} {value:6.2f}, true {true:5.2f}")
