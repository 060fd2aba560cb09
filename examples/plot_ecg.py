"""
Slopes of an electrocardiogram, and its beats
=============================================

The QRS complex is the steepest part of a heartbeat. So its slope finds it, whatever the baseline does, and whether the
beat is tall or not. The record is five minutes of the MIT-BIH Arrhythmia Database, record 208 (ODC-By 1.0; Moody and
Mark 2001, Goldberger et al. 2000), which the tests of this repository read.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import find_peaks

import algdiff

plt.style.use("tableau-colorblind10")
here = Path.cwd()
record = next(path for folder in (here, *here.parents) if (path := folder / "tests/data/ecg_360hz.npy").exists())
fs = 360.0
ecg = (np.load(record).astype(float) - 1024) / 200  # mV
t = np.arange(ecg.size) / fs

# %%
# To find beats, a window about as long as a QRS complex: noise and hum are damped, T waves are too slow to matter. A
# beat is where the slope has a peak of at least a quarter of what it usually reaches within two seconds; no heart beats
# twice within a quarter of one.

d = algdiff.Differentiator.from_duration(0.07, degree=4, fs=fs)
slope = np.abs(d(ecg))
every = int(2 * fs)
usual = np.median([slope[i : i + every].max() for i in range(0, slope.size, every)])
beats, _ = find_peaks(slope, height=usual / 4, distance=int(0.25 * fs))
apart = np.diff(t[beats])
print(f"{d.window_length} samples; usual steepest slope {usual:.0f} mV/s")
print(f"{beats.size} beats in {t[-1]:.0f} s, usually {60 / np.median(apart):.0f} a minute; longest pauses, in s:")
print(np.sort(apart)[-4:].round(2))

# %%
# Here the baseline jumps by more than a beat is tall. No threshold on the signal itself would do; the slope does not
# mind, but for the moment when the amplifier is driven to its limit. That is what the longest pauses are.

shown = slice(round(39.3 * fs), round(49.3 * fs))
marks = beats[(beats >= shown.start) & (beats < shown.stop)]
figure, (signal, derivative) = plt.subplots(2, 1, sharex=True, figsize=(7, 4.5), layout="constrained")
signal.plot(t[shown], ecg[shown], linewidth=1)
signal.plot(t[marks], ecg[marks], "C1o", label="beats")
signal.set(ylabel="ECG, mV", title="Heartbeats, found by their slope")
signal.legend(loc="upper right")
derivative.plot(t[shown], slope[shown], linewidth=1)
derivative.axhline(usual / 4, color="C1", linestyle="--", linewidth=1, label="threshold")
derivative.set(xlabel="time, s", ylabel="|slope|, mV/s")
derivative.legend(loc="upper right")
plt.show()

# %%
# To measure a slope is another matter: the long window flattens the QRS complex. ``return_std`` gives the error that
# noise makes, ``return_bias`` an indicator of what the window misses. The noise is that of muscles, which changes: its
# level is measured around every sample. It takes noise for white; hum is not in it, and ripples beyond the bars beside
# the beat.

sigma = algdiff.noise_level(ecg, local=int(fs))
beat = slice(beats[20] - 36, beats[20] + 36)
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
for length, color, marker in ((d.window_length, "C1", "s"), (9, "C0", "o")):
    found = d.replace(window_length=length)(ecg, return_std=True, return_bias=True, sigma=sigma)
    missed = (np.abs(found.bias) > 2 * found.std)[slope > usual / 4].mean()
    print(f"{length:2} samples: steepest {np.abs(found.estimate[beat]).max():.0f} mV/s", end=", ")
    print(f"std {np.median(found.std):.2f} mV/s, bias indicated at {missed:.0%} of the steep samples")
    axes.errorbar(
        t[beat],
        found.estimate[beat],
        2 * found.std[beat],
        color=color,
        marker=marker,
        markersize=3,
        linewidth=1,
        capsize=2,
        label=f"{length} samples, ± 2 std",
    )
axes.set(xlabel="time, s", ylabel="slope, mV/s")
axes.legend(loc="upper left")
plt.show()
