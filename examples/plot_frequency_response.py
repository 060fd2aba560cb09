"""
Cutoff, roll-off, notch
=======================

A differentiator is a low-pass filter too. A design may be asked for by its cutoff, damp high frequencies as steeply as
its weights say, and have a zero on the frequency of a disturbance, such as the hum of the mains.
"""

import matplotlib.pyplot as plt
import numpy as np

from algdiff import Differentiator, plot_response

plt.style.use("tableau-colorblind10")
fs = 1000.0  # Hz

# %%
# Three designs of one cutoff. Larger ``kappa`` and ``mu`` taper the window: high frequencies fall more steeply beyond
# the cutoff, for which the window is longer, and so the delay.

frequency = np.linspace(0.5, 500, 4000)
figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
for exponent, color in ((0, "C1"), (1, "C0"), (3, "C3")):
    d = Differentiator.from_cutoff(20, kappa=exponent, mu=exponent, fs=fs)
    amplitude = np.abs(d.frequency_response(frequency))
    axes.loglog(frequency, np.maximum(amplitude, 1e-3), color, linewidth=1.2, label=f"kappa = mu = {exponent}")
    facts = d.summary()
    print(f"kappa = mu = {exponent}: {d.window_length} samples, delay {1000 * d.delay:.0f} ms", end=", ")
    print(f"{facts['roll_off']:.0f} dB per decade, -3 dB at {d.half_power:.1f} Hz, noise gain {d.noise_gain:.0f} 1/s²")
axes.loglog(frequency, 2 * np.pi * frequency, "k--", linewidth=1, label="ideal derivative")
axes.axvline(d.cutoff, color="k", linewidth=0.8, linestyle=":")
axes.set(xlabel="frequency, Hz", ylabel="amplitude, 1/s", ylim=(0.05, 2000), title="Differentiators with one cutoff")
axes.legend(loc="lower left", fontsize="small")
plt.show()

# %%
# The responses of symmetric windows have zeros. ``from_notch`` puts the first of them on a frequency: here on the hum
# of the mains.

hum = 50.0  # Hz
notch = Differentiator.from_notch(hum, fs=fs)
plain = Differentiator.from_cutoff(20, fs=fs)
print(f"notch: {notch.window_length} samples, kappa = mu = {notch.kappa:.3f}")
for name, d in (("notch", notch), ("cutoff 20 Hz", plain)):
    print(f"{name}: amplitude at {hum:.0f} Hz {abs(d.frequency_response(hum)):.1g} 1/s")

# %%
# A slow signal with hum that is as large: its derivative is drowned by it, but for the notch.

t = np.arange(1000) / fs
x = np.sin(2 * np.pi * 2 * t) + np.sin(2 * np.pi * hum * t)
truth = 4 * np.pi * np.cos(2 * np.pi * 2 * t)
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
for name, d, color in (("cutoff", plain, "C1"), ("notch", notch, "C0")):
    estimate = d(x)
    axes.plot(t, estimate, color, linewidth=1.2, label=name)
    print(f"{name}: RMSE {np.std((estimate - truth)[100:-100]):.2f} 1/s")
axes.plot(t, truth, "k--", linewidth=1, label="truth")
axes.set(xlabel="time, s", ylabel="derivative, 1/s", ylim=(-120, 120))
axes.legend(ncols=3, loc="upper center")
plt.show()

# %%
# ``plot_response`` draws one design with its asymptotes; ``plot_design`` a page with weights, step response and
# numbers.

figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
plot_response(notch, axes)
plt.show()
