"""
Derivatives in a control loop
=============================

The second illustration of Mboup, Join and Fliess (2007): a motor turns a pendulum through a spring, and only the angle
of the pendulum is measured, in noise. The feedback needs the angle and three derivatives, now; they come from a
``Stream``, one sample at a time. Plant, control and reference are those of ``algdiff demo --pendulum``; the paper
leaves out some of their numbers.
"""

import matplotlib.pyplot as plt
import numpy as np

from algdiff import Differentiator, Stream
from algdiff import _pendulum as loop

plt.style.use("tableau-colorblind10")
reference = loop.reference(loop.REFERENCES["S2"])  # stands the pendulum upright, and lets it down again
noise = loop.noises(seeds=range(3), deviation=0.01)  # rad; the loops of three seeds run side by side
t = loop.TIMES

# %%
# One estimator for each order, all without delay (``tau="newest"``). The noise of an estimate grows with its order and
# falls with its window: so the higher orders get the longer windows. One stream holds all four, for all channels.

windows = {0: 0.2, 1: 0.2, 2: 0.3, 3: 0.5}  # s
designs = [
    Differentiator.from_duration(duration, order, degree=order + 1, kappa=0, mu=0, tau="newest", delta=loop.DELTA)
    for order, duration in windows.items()
]
stream = Stream(designs, channels=noise.shape[1])
for order, design in enumerate(designs):
    print(
        f"order {order}: {design.window_length} samples, noise gain {design.noise_gain:.3g}, delay {design.delay:g} s"
    )

# %%
# The loop: sample, estimate, and hold the control until the next sample. Estimates come from the noisy angle and
# nothing else.

run = loop.simulate(stream, reference, noise)
errors = loop.errors(run)
print(f"angle off its reference: {errors.tracking.mean():.4f} rad rms, {errors.largest.max():.3f} rad at most")
print(f"velocity estimates err by {errors.velocity.mean():.3f} rad/s rms; loops that failed: {errors.failed.sum()}")

figure, (angle, control, motor) = plt.subplots(3, 1, sharex=True, figsize=(7, 5.5), layout="constrained")
angle.plot(t, run.y[0, :, 0], label="pendulum")
angle.plot(t, reference[0], "k--", linewidth=1, label="reference")
angle.set(ylabel="angle, rad", title="A pendulum stood upright by derivatives of its noisy angle")
angle.legend(loc="upper left")
control.plot(t, run.u[:, 0], linewidth=0.8)
control.set_ylabel("control, V")
motor.plot(t, run.motor_estimate[:, 0], "C1", linewidth=0.8, label="from the estimates")
motor.plot(t, run.motor[:, 0], "k--", linewidth=1, label="true")
motor.set(xlabel="time, s", ylabel="motor angle, rad")
motor.legend(loc="upper left")
plt.show()

# %%
# Whatever has a method ``push`` closes the loop. Backward differences are without delay too, but it is their noise that
# drives the motor then: the loop fails, and is switched off. And estimates that are late, quieter though they are, let
# the pendulum stray.


class Differences:
    """The last sample and its backward differences."""

    def __init__(self):
        self.samples = np.zeros((4, noise.shape[1]))

    def push(self, x):
        """Return y, y', y'' and y'''."""
        self.samples = np.vstack((x, self.samples[:-1]))
        return np.stack([np.diff(self.samples, n, axis=0)[0] * (-1 / loop.DELTA) ** n for n in range(4)])


late = loop.simulate(Stream(designs, channels=noise.shape[1], delay=0.04), reference, noise)
start = slice(round(3.0 / loop.DELTA))  # the first seconds are enough for the differences
naive = loop.simulate(Differences(), reference[:, start], noise[start])
lost = (np.abs(naive.y[0] - naive.reference[0]) > loop.LOST).any(axis=1)
print(f"differences: {naive.failed.sum()} of {naive.failed.size} loops fail, the first at {t[lost.argmax()]:.2f} s")
for name, one in (("no delay", run), ("40 ms late", late)):
    print(f"{name:10} {loop.errors(one).tracking.mean():.4f} rad rms off the reference")

figure, (angle, away) = plt.subplots(2, 1, sharex=True, figsize=(7, 4.5), layout="constrained")
angle.plot(t, run.y[0, :, 0], label="no delay")
angle.plot(t, late.y[0, :, 0], "C1", label="40 ms late")
angle.plot(t[start], naive.y[0, :, 0], "C3", label="differences")
angle.plot(t, reference[0], "k--", linewidth=1, label="reference")
angle.set(ylabel="angle, rad", ylim=(-4, 11))
angle.legend(ncols=4, loc="upper center", fontsize="small")
away.plot(t, run.y[0, :, 0] - reference[0])
away.plot(t, late.y[0, :, 0] - reference[0], "C1")
away.set(xlabel="time, s", ylabel="off the reference, rad")
plt.show()
