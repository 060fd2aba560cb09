"""
Velocity and acceleration from an encoder
=========================================

A pendulum swings freely, and an encoder rounds its angle to whole counts. Differences of counts are mostly zero; a
window makes velocity and acceleration of them, and the equation of motion, which nothing here was told, says whether
they are right. The recording comes with the package ((c) 2022 dynamicslab, MIT licence).
"""

from importlib.resources import files

import matplotlib.pyplot as plt
import numpy as np

import algdiff

plt.style.use("tableau-colorblind10")
with (files("algdiff") / "data" / "pendulum_encoder.npz").open("rb") as file, np.load(file) as recording:
    theta = recording["counts"] * (2 * np.pi / recording["counts_per_revolution"])  # rad
    delta = float(recording["dt"])  # s
t = delta * np.arange(theta.size)

# %%
# No window is known in advance. ``suggest`` takes the one whose estimates of the highest order are expected to err
# least, and says why.

suggestion = algdiff.suggest(theta, deriv=2, delta=delta)
print(suggestion.explain())

# %%
# Angle, velocity and acceleration come from that window in one pass.

d = suggestion.differentiator.replace(deriv=(0, 1, 2))
angle, velocity, acceleration = d(theta)

# %%
# The equation of a damped pendulum: the acceleration is a sin(angle) less b times the velocity (the angle counts from
# upright). Fit a and b by least squares to the free swing, away from release and end. What is left is more than the
# estimates are expected to err by: real friction is not proportional to the velocity, which shows as the swing dies.

free = slice(round(0.3 / delta), -d.window_length)
terms = np.stack([np.sin(angle), -velocity], axis=1)
(a, b), *_ = np.linalg.lstsq(terms[free], acceleration[free])
equation = terms @ (a, b)
left = acceleration[free] - equation[free]
print(f"a = {a:.2f} 1/s^2, b = {b:.3f} 1/s, R^2 = {1 - left.var() / acceleration[free].var():.4f}")
print(f"left: {left.std():.4f} rad/s^2 rms; expected error of the estimates: {suggestion.rmse:.4f} rad/s^2")
print(f"the same as a mass on a rod of {9.81 / a:.3f} m; small swings take {2 * np.pi / np.sqrt(a):.3f} s")

shown = t < 6
figure, axes = plt.subplots(3, 1, sharex=True, figsize=(7, 6), layout="constrained")
for ax, values, label in zip(
    axes, (angle, velocity, acceleration), ("angle, rad", "velocity, rad/s", "acceleration, rad/s²"), strict=True
):
    ax.plot(t[shown], values[shown], label="estimate")
    ax.set_ylabel(label)
axes[2].plot(t[shown], equation[shown], "k--", linewidth=1, label="equation of motion")
axes[2].legend(loc="upper right")
axes[2].set_xlabel("time, s")
axes[0].set_title("A pendulum's encoder, differentiated twice")
plt.show()

# %%
# What the window is up against: the counts near a turning point, where the encoder hardly moves, and what differences
# of neighbours make of them.

zoom = slice(round(1.105 / delta), round(1.15 / delta))
naive = np.gradient(theta, delta)
print(f"np.gradient against this velocity: {np.std((naive - velocity)[free]):.3f} rad/s rms")
twice = np.gradient(naive, delta)
print(f"np.gradient twice against this acceleration: {np.std((twice - acceleration)[free]):.0f} rad/s^2 rms")

figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(7, 4.5), layout="constrained")
above.plot(t[zoom], theta[zoom], "C2", drawstyle="steps-mid", label="encoder")
above.plot(t[zoom], angle[zoom], "C0", label="estimate")
above.set_ylabel("angle, rad")
above.legend()
below.plot(t[zoom], naive[zoom], "C2", linewidth=0.7, label="np.gradient")
below.plot(t[zoom], velocity[zoom], "C0", label="estimate")
below.set(xlabel="time, s", ylabel="velocity, rad/s")
below.legend()
plt.show()
