"""
Cancelling a hum
================

A slow signal carries the hum of the mains, whose derivative is larger than the one that is wanted. The response of a
symmetric window has zeros: a window of the right length puts one of them on the hum.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq
from scipy.special import jv

from algdiff import Differentiator

plt.style.use("tableau-colorblind10")
fs, hum = 1000.0, 50.0  # Hz
t = np.arange(0, 4, 1 / fs)
signal = np.sin(2 * np.pi * 0.5 * t) + 0.3 * np.cos(2 * np.pi * 1.3 * t)
velocity = np.pi * np.cos(2 * np.pi * 0.5 * t) - 0.78 * np.pi * np.sin(2 * np.pi * 1.3 * t)
noise = 1e-3 * np.random.default_rng(0).standard_normal(t.size)
measured = signal + 0.05 * np.sin(2 * np.pi * hum * t + 0.4) + noise

# %%
# For ``N = 0`` and ``alpha = beta`` the AlgDiff toolbox's tutorial gives the window in closed form: the response is a
# Bessel function of order ``alpha + 1/2``, and the window ``T = 2 j / omega`` has the k-th zero j of it at omega. In
# words of this library the exponents of a first derivative are ``kappa = mu = alpha - 1``, and its degree is 1.

alpha, k = 2.0, 1
places = np.arange(0.5, 40, 0.1)
changes = np.flatnonzero(np.diff(np.sign(jv(alpha + 0.5, places))))
zero = brentq(lambda z: jv(alpha + 0.5, z), places[changes[k - 1]], places[changes[k - 1] + 1])
T = 2 * zero / (2 * np.pi * hum)
print(f"T = {T:.6f} s: {T * fs:.3f} samples")

# %%
# That is not a whole number of samples, and a rounded window has its zero next to the hum. ``from_notch`` rounds as
# well, and then moves the exponents until the zero of the weights themselves is back on the frequency, to rounding.

design = {"degree": 1, "kappa": alpha - 1, "mu": alpha - 1, "fs": fs}
designs = {
    "a third shorter": Differentiator.from_duration(2 * T / 3, **design),
    "closed form, rounded": Differentiator.from_duration(T, **design),
    "from_notch": Differentiator.from_notch(hum, order=k, **design),
}
estimates = {}
for name, d in designs.items():
    passed = abs(d.frequency_response(hum)) / (2 * np.pi * hum)
    estimates[name] = d(measured)
    rmse = np.sqrt(np.mean((estimates[name] - velocity) ** 2))
    print(f"{name:21} {d.window_length} samples  kappa {d.kappa:.4f}  passes {passed:.1e} of the hum  RMSE {rmse:.4f}")

# %%
# What was gained: of the hum the rounded window leaves more than the noise; after ``from_notch`` the noise is all there
# is, to both ends of the data, for a line has one slope wherever in the window it is asked for. The price is that the
# exponents move: a little here, more if the window has only a few samples.

amplitude = 2 * np.pi * hum * 0.05
print(f"amplitude of the hum's derivative: {amplitude:.2f}, of the wanted one: {np.abs(velocity).max():.2f}")
for name, d in designs.items():
    print(
        f"{name:21} left of the hum {np.std(estimates[name] - d(signal + noise)):.1e}, noise {np.std(d(noise)):.1e} rms"
    )

figure, (above, middle, below) = plt.subplots(3, 1, figsize=(7, 7.5), layout="constrained")
f = np.linspace(30, 90, 800)
colours = dict(zip(designs, ("C2", "C1", "C0"), strict=True))
for name, d in designs.items():
    gain = np.abs(d.frequency_response(f)) / (2 * np.pi * f)
    above.semilogy(f, np.maximum(gain, 1e-5), color=colours[name], label=f"{name}: {d.window_length} samples")
above.axvline(hum, color="0.6", linestyle=":", zorder=0)
above.set(xlabel="frequency, Hz", ylabel="gain against the\nideal derivative", ylim=(1e-4, 2))
above.set_title("A zero on the hum")
above.legend(loc="upper right", ncols=2, fontsize="small")
shown = (t > 1) & (t < 1.6)
for name in ("a third shorter", "from_notch"):
    middle.plot(t[shown], estimates[name][shown], color=colours[name], label=name)
middle.plot(t[shown], velocity[shown], "k--", linewidth=1, label="true")
middle.set_ylabel("velocity, 1/s")
for name in ("closed form, rounded", "from_notch"):
    below.plot(t[shown], (estimates[name] - velocity)[shown], color=colours[name], label=name)
below.set(xlabel="time, s", ylabel="error, 1/s")
for ax in (middle, below):
    ax.legend(loc="upper right", ncols=3, fontsize="small")

# %%
# A zero is narrow. When the mains are off their frequency, what passes grows in proportion: it is then a longer window
# or larger exponents that help, and the notch only starts from a better place.

for off in (0.0, 0.05, 0.2, 1.0):
    passed = [abs(d.frequency_response(hum + off)) / (2 * np.pi * (hum + off)) for d in designs.values()]
    print(
        f"{hum + off:6.2f} Hz:", "  ".join(f"{name} {value:.1e}" for name, value in zip(designs, passed, strict=True))
    )

plt.show()
