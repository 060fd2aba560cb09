"""
Equations from noisy data, with PySINDy
=======================================

SINDy finds the equations of a system by regression of measured derivatives on candidate terms, so that they are as good
as the derivatives. This example gives it three kinds: PySINDy's default, finite differences; its
``SmoothedFiniteDifference``; and this library's, whose windows ``algdiff.compat.pysindy`` chooses from the data.
"""

import matplotlib.pyplot as plt
import numpy as np
import pysindy
from pysindy.differentiation import FiniteDifference, SmoothedFiniteDifference
from scipy.integrate import solve_ivp

from algdiff.compat.pysindy import AlgebraicDifferentiation

plt.style.use("tableau-colorblind10")

# %%
# Two systems whose coefficients are known: a damped oscillator and that of Lorenz.

oscillator = {"x0": {"x0": -0.1, "x1": 2.0}, "x1": {"x0": -2.0, "x1": -0.1}}
lorenz = {
    "x0": {"x0": -10.0, "x1": 10.0},
    "x1": {"x0": 28.0, "x1": -1.0, "x0 x2": -1.0},
    "x2": {"x2": -8 / 3, "x0 x1": 1.0},
}


def slopes(_, x, system):
    """Return the right side of the equations."""
    terms = {f"x{i}": value for i, value in enumerate(x)}
    products = {f"{a} {b}": terms[a] * terms[b] for a in terms for b in terms}
    return [sum(c * (terms | products)[name] for name, c in row.items()) for row in system.values()]


def solved(system, start, t):
    """Return the samples without noise."""
    return solve_ivp(slopes, t[[0, -1]], start, "LSODA", t, args=(system,), rtol=1e-10, atol=1e-10).y.T


t_oscillator, t_lorenz = np.arange(0, 25, 0.01), np.arange(0, 10, 0.005)  # s
systems = {  # the system, times, samples without noise, threshold for coefficients, levels of noise
    "oscillator": (oscillator, t_oscillator, solved(oscillator, (2, 0), t_oscillator), 0.05, (0.005, 0.03, 0.2)),
    "Lorenz": (lorenz, t_lorenz, solved(lorenz, (-8, 8, 27), t_lorenz), 0.2, (0.1, 0.6, 3.0)),
}
methods = {
    "FiniteDifference": lambda: FiniteDifference(axis=-2),
    "SmoothedFiniteDifference": SmoothedFiniteDifference,
    "AlgebraicDifferentiation": AlgebraicDifferentiation,
}

# %%
# The methods go to ``SINDy``, and nothing else changes. SINDy evaluates its candidates on the smoothed samples of the
# method, if it has any: ``FiniteDifference`` has none. The error is that of all coefficients together, relative to
# theirs.


def fitted(method, t, x, threshold):
    """Return the model that SINDy finds."""
    library, optimizer = pysindy.PolynomialLibrary(degree=2), pysindy.STLSQ(threshold=threshold)
    return pysindy.SINDy(optimizer=optimizer, feature_library=library, differentiation_method=method).fit(x, t=t)


def judged(model, system):
    """Return the error of the coefficients, and whether the terms are the right ones."""
    names, found = model.get_feature_names(), model.coefficients()
    true = np.array([[row.get(name, 0.0) for name in names] for row in system.values()])
    return np.linalg.norm(found - true) / np.linalg.norm(true), np.array_equal(found != 0, true != 0)


seeds = range(3)
errors = {}
for name, (system, t, clean, threshold, levels) in systems.items():
    for level in levels:
        print(f"{name}, noise of {level / clean.std():.1%} of the samples' standard deviation")
        noisy = [clean + level * np.random.default_rng(seed).standard_normal(clean.shape) for seed in seeds]
        for kind, method in methods.items():
            found = [judged(fitted(method(), t, x, threshold), system) for x in noisy]
            errors[name, level, kind] = np.median([one[0] for one in found])
            right = sum(one[1] for one in found)
            print(
                f"    {kind:25} error {errors[name, level, kind]:7.2%}, the right terms {right} times of {len(seeds)}"
            )

# %%
# What the methods make of the Lorenz system at the middle level of noise, and what becomes of it.

system, t, clean, threshold, levels = systems["Lorenz"]
x = clean + levels[1] * np.random.default_rng(0).standard_normal(clean.shape)
true = np.transpose(slopes(t, clean.T, system))
shown = t < 2
figure, axes = plt.subplots(1, 3, figsize=(11, 3.8), layout="constrained", width_ratios=(1.6, 1, 1))
for color, (kind, method) in zip(("0.7", "C1", "C0"), methods.items(), strict=True):
    found = method()(x, t)
    print(f"{kind:25} error of the derivatives (RMS) {np.sqrt(np.mean((found - true) ** 2)):5.1f}")
    axes[0].plot(t[shown], found[shown, 0], color=color, linewidth=3 if color == "C0" else 1, label=kind)
    for axis, (name, (*_, signal, _, noise)) in zip(axes[1:], systems.items(), strict=True):
        relative = [errors[name, level, kind] for level in noise]
        axis.loglog(noise / signal.std(), relative, "o-", color=color, label=kind)
        axis.set(xlabel="noise, of the samples' std", ylabel="relative error of coefficients", title=name)
axes[0].plot(t[shown], true[shown, 0], "k--", linewidth=1, label="truth")
axes[0].set(xlabel="time, s", ylabel="derivative of x0, 1/s", ylim=(-250, 200), title="Lorenz")
axes[0].legend(fontsize="small", ncols=2, loc="lower center")
axes[1].legend(fontsize="x-small")

# %%
# While the noise is low, all three find the equations, and for the oscillator eleven samples, the window of
# ``SmoothedFiniteDifference`` by default, are as good as chosen ones. As the noise grows, chosen windows grow with it.
# From some noise on the equations of Lorenz come with wrong terms, whatever the method: better derivatives make these
# smaller, but do not remove them.

plt.show()
