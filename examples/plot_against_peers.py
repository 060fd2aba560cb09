"""
Against NumPy and SciPy: accuracy and time
==========================================

The derivative of the 2007 paper's illustration by what NumPy and SciPy offer, and by this library; with windows set by
hand, by those who know the truth, and with nothing known. No method wins everywhere, and it depends on the noise which
does.
"""

import time
import warnings

import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import CubicSpline, make_smoothing_spline, make_splrep
from scipy.ndimage import gaussian_filter1d
from scipy.signal import savgol_filter

import algdiff

plt.style.use("tableau-colorblind10")
delta = 0.005  # s
t = delta * np.arange(1001)
smooth = np.tanh(t - 1) + np.exp(-t / 1.2) * np.sin(6 * t + np.pi)
slope = np.cosh(t - 1) ** -2 + np.exp(-t / 1.2) * (6 * np.cos(6 * t + np.pi) - np.sin(6 * t + np.pi) / 1.2)
zigzag_slope = np.where((t + 0.0025) % 1.25 < 0.625, 2.0, -2.0)
zigzag = delta * np.cumsum(zigzag_slope) - delta * zigzag_slope / 2
noise = np.random.default_rng(0).standard_normal(t.size)
level = 0.05
cases = {
    "smooth": (smooth, slope, 0.0),
    "smooth, noisy": (smooth, slope, level),
    "zigzag": (zigzag, zigzag_slope, 0.0),
    "zigzag, noisy": (zigzag, zigzag_slope, level),
}
inner = slice(100, -100)  # the ends are another matter: both errors are printed

# %%
# The contestants. Windows of ``savgol_filter`` and of the Gaussian are set by hand; ``make_splrep`` is told the level
# of the noise; ``make_smoothing_spline`` finds its parameter by cross-validation, and ``differentiate`` its window.


def peers(level):
    """Return what differentiates, by name; `level` is that of the noise."""
    s = t.size * level**2
    found = {
        "np.gradient": lambda x: np.gradient(x, delta),
        "CubicSpline": lambda x: CubicSpline(t, x)(t, 1),
        "gaussian_filter1d, sigma 20": lambda x: gaussian_filter1d(x, 20, order=1) / delta,
        "savgol_filter, 61, degree 3": lambda x: savgol_filter(x, 61, 3, deriv=1, delta=delta),
        "savgol_filter, 201, degree 5": lambda x: savgol_filter(x, 201, 5, deriv=1, delta=delta),
        "make_splrep, noise known": lambda x: make_splrep(t, x, s=s).derivative()(t),
        "algdiff, 61, degree 3": lambda x: algdiff.differentiate(x, 61, degree=3, delta=delta),
        "algdiff, 201, degree 5": lambda x: algdiff.differentiate(x, 201, degree=5, delta=delta),
        "algdiff, window chosen": lambda x: algdiff.differentiate(x, delta=delta),
    }
    if level:  # it takes long, and without noise there is nothing to smooth
        found["make_smoothing_spline"] = lambda x: make_smoothing_spline(t, x).derivative()(t)
    return found


def measure(differentiate, x, truth):
    """Return the errors in the middle and over all samples, and the best time of some runs."""
    times = []
    while len(times) < 3 and sum(times) < 0.1:
        start = time.perf_counter()
        estimate = differentiate(x)
        times.append(time.perf_counter() - start)
    errors = estimate - truth
    return np.sqrt(np.mean(errors[inner] ** 2)), np.sqrt(np.mean(errors**2)), min(times)


# %%
# Without noise, interpolation is hard to beat. With it, what counts is the window: set right, ``savgol_filter`` errs as
# little as the same window here (which damps high frequencies more by its weights, ``kappa = mu = 1``) and differs in
# time. A window that is right for one signal is wrong for another; a chosen one is right for both, as far as one window
# can be, and costs the time for the choice. Corners in noise are beyond all of these.

results = {}
for case, (signal, truth, sigma) in cases.items():
    for name, differentiate in peers(sigma).items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of splines, about noise that is not there
            results[name, case] = measure(differentiate, signal + sigma * noise, truth)
names = list(peers(level))
unit = results["np.gradient", "smooth, noisy"][2]
print(f"{'RMSE in the middle (over all samples)':40}" + "".join(f"{case:>20}" for case in cases) + "      time")
for name in names:
    found = [results.get((name, case)) for case in cases]
    cells = "".join(f"{'{:.2g} ({:.2g})'.format(*one) if one else '-':>20}" for one in found)
    print(f"{name:40}{cells}{results[name, 'smooth, noisy'][2] / unit:10.1f}")

for case in cases:
    ranked = sorted((name for name in names if (name, case) in results), key=lambda name: results[name, case][0])
    print(f"least error in the middle, {case}: {'; '.join(ranked[:3])}")

figure, axes = plt.subplots(figsize=(7.5, 4.5), layout="constrained")
places = {  # of labels that would cover each other
    "gaussian_filter1d, sigma 20": {"xytext": (-6, -14)},
    "make_splrep, noise known": {"xytext": (-6, -14)},
    "make_smoothing_spline": {"xytext": (6, 6), "ha": "right"},
}
for name in names:
    middle, _, seconds = results[name, "smooth, noisy"]
    axes.loglog(1e3 * seconds, middle, "C0o" if name.startswith("algdiff") else "C1s")
    axes.annotate(
        name,
        (1e3 * seconds, middle),
        textcoords="offset points",
        fontsize="small",
        **places.get(name, {"xytext": (6, 3)}),
    )
axes.set(
    xlabel="time for one signal, ms", ylabel="RMSE in the middle, 1/s", title="Error against time, smooth and noisy"
)
plt.show()
