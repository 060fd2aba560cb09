"""
Sample by sample
================

A ``Stream`` gives an estimate with every sample, and the same bits as the whole recording at once. What a loop or a
display has to choose is the delay: the later an estimate, the less noise is in it.
"""

import matplotlib.pyplot as plt
import numpy as np

from algdiff import Differentiator, Stream

plt.style.use("tableau-colorblind10")
fs, level = 500.0, 0.01  # Hz, rad
t = np.arange(2000) / fs
noise = level * np.random.default_rng(0).standard_normal(t.size)
x = np.sin(np.pi * t) + noise
truth = np.pi * np.cos(np.pi * t)

# %%
# A stream is made from a design. ``push`` takes a sample, or a block of them, and returns the estimate of the window
# that ends with it; NaN until there is one.

d = Differentiator(101, degree=2, delay=0.02, fs=fs)
stream = d.stream()
live = np.array([stream.push(sample) for sample in x])
print(f"{stream.count} samples; the last estimate is of {stream.time:.3f} s, {stream.delay:.3f} s before the last")

offline = d.replace(engine="direct")(x, mode="valid")
print("bits of the stream and of the whole at once are the same:", np.array_equal(live[d.window_length - 1 :], offline))
blocks = d.stream().push(x[:777]), d.stream().push(x)
print("and so they are in blocks:", np.array_equal(blocks[1], live, equal_nan=True))

# %%
# A stream can be stopped, written down as JSON, and go on elsewhere.

half = d.stream()
half.push(x[:1000])
again = Stream.from_state(half.state)
print("restored, it goes on with the same bits:", np.array_equal(again.push(x[1000:]), live[1000:]))

# %%
# Now the delay, with the window left as it is. None at all is noisy; a little takes most of the noise away. Estimates
# are drawn when they come, so that those with a delay lie to the right of the truth.

figure, (early, late) = plt.subplots(2, 1, sharex=True, sharey=True, figsize=(7, 4.5), layout="constrained")
for axes, delay in ((early, 0.0), (late, 0.05)):
    estimates = Stream(d, delay=delay).push(x)
    axes.plot(t, estimates, linewidth=1, label=f"as it comes, {1000 * delay:.0f} ms late")
    axes.plot(t, truth, "k--", linewidth=1, label="truth")
    axes.set(ylabel="velocity, rad/s", ylim=(-4, 6))
    axes.legend(loc="upper center", ncols=2, fontsize="small")
early.set_title("Velocity, sample by sample")
late.set_xlabel("time, s")
plt.show()

# %%
# The noise gain says beforehand what the noise will be, for any delay, and below zero for predictions. A higher degree
# has less bias, and more noise near the newest sample. A line, degree 1, has the same slope everywhere: whatever delay
# it is asked for, its true one is half a window (``moment_delay``).

delays = np.linspace(-0.02, 0.1, 61)
figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
for degree, color in ((1, "C1"), (2, "C0"), (3, "C3")):
    designs = [d.replace(delay=delay, degree=degree) for delay in delays]
    axes.semilogy(1000 * delays, [level * one.noise_gain**0.5 for one in designs], color, label=f"degree {degree}")
for delay in (0.0, 0.05):
    seen = np.std(Stream(d, delay=delay).push(noise)[d.window_length :])  # of the noise alone
    expected = level * d.replace(delay=delay).noise_gain ** 0.5
    print(f"delay {1000 * delay:2.0f} ms: noise {expected:.3f} rad/s by the noise gain, {seen:.3f} rad/s seen")
    axes.plot(1000 * delay, seen, "ko", label="seen, degree 2" if delay else None)
line = d.replace(delay=0.0, degree=1)
print(f"degree 1, asked for {line.delay:g} ms: late by {1000 * line.moment_delay:.0f} ms")
axes.axvline(0, color="k", linewidth=0.8, linestyle=":")
axes.set(xlabel="delay, ms (below zero: prediction)", ylabel="noise of the estimate, rad/s")
axes.legend(fontsize="small")
plt.show()
