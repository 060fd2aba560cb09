"""The nonlinear loop of Mboup, Join and Fliess (2007), closed by several estimators of derivatives.

``python examples/pendulum.py`` prints how well the pendulum follows its reference when y, y', y'' and y''' come from
this library and from others' formulas, all in the same loop with the same gains: plant, control and reference are those
of ``algdiff demo --pendulum``. ``--seeds 5`` is faster; ``--tune`` searches the settings below anew, which takes
minutes; ``--choices`` shows instead what delay, windows, degree and rule do.
"""

import argparse
import math

import numpy as np

from algdiff import Differentiator, Stream
from algdiff import _pendulum as loop

CASES = (("S2", 0.01), ("S2", 0.1), ("S1", 0.01), ("S1", 0.1))  # reference; standard deviation of the noise, rad
TUNING = range(100, 106)  # seeds for the search, others than those of the table
DEAR = 4.0  # where the search finds more than this rms of u, in V, it counts the error so much larger


class Family:
    """Estimators of this library with a window for every order (`degree` is `deriv + extra`), at one delay."""

    def __init__(self, channels, extra, *windows, rule="exact", delay=0.0):
        designs = loop.designs([(window, order + extra) for order, window in enumerate(windows)], rule=rule)
        self.push = Stream(designs, channels=channels, delay=delay).push


class SavitzkyGolay:
    """The newest end of one least-squares fit for all orders; this library's as well, but for its single window."""

    def __init__(self, channels, degree, window):
        count, orders = round(window / loop.DELTA), (0, 1, 2, 3)
        design = Differentiator(count, orders, degree=degree, kappa=0, mu=0, tau="newest", delta=loop.DELTA)
        self.push = Stream(design, channels=channels).push


class Differences:
    """Backward differences of y', y'' and y''' over a stride each, in seconds."""

    def __init__(self, channels, *strides):
        self.strides = [max(1, round(stride / loop.DELTA)) for stride in strides]
        self.past = np.full((1 + max(order * stride for order, stride in enumerate(self.strides, 1)), channels), np.nan)

    def push(self, x):
        """Return y, y', y'' and y''' after a sample of every channel."""
        self.past[1:] = self.past[:-1]
        self.past[0] = x
        rows = [x]
        for order, stride in enumerate(self.strides, 1):
            signs = [(-1) ** j * math.comb(order, j) for j in range(order + 1)]
            rows.append(signs @ self.past[: order * stride + 1 : stride] / (stride * loop.DELTA) ** order)
        return np.stack(rows)


class HighGainObserver:
    """z_i' = z_{i+1} + alpha_i / epsilon^i (y - z_1) with all poles at -1 / epsilon, discretised exactly."""

    def __init__(self, channels, order, epsilon):
        injection = np.array([math.comb(order, i) / epsilon**i for i in range(1, order + 1)])
        system = np.eye(order, k=1)
        system[:, 0] -= injection
        # All eigenvalues being the same, what is left without them is nilpotent and its exponential a finite sum.
        rest, term = (system + np.eye(order) / epsilon) * loop.DELTA, np.eye(order)
        self.step = np.zeros((order, order))
        for power in range(order):
            self.step += term * math.exp(-loop.DELTA / epsilon)
            term = term @ rest / (power + 1)
        self.input = np.linalg.solve(system, (self.step - np.eye(order)) @ injection)[:, None]
        self.state = np.zeros((order, channels))

    def push(self, x):
        """Return y, y', y'' and y''' after a sample of every channel."""
        self.state = self.step @ self.state + self.input * x
        return self.state[:4]


class Levant:
    """Levant's differentiator of order 3 (2003), with the Taylor terms of Livne and Levant (2014)."""

    def __init__(self, channels, bound):
        self.factors = (3 * bound ** (1 / 4), 2 * bound ** (1 / 3), 1.5 * bound ** (1 / 2), 1.1 * bound)
        self.state = np.zeros((4, channels))

    def push(self, x):
        """Return y, y', y'' and y''' after a sample of every channel."""
        z, rates, target = self.state, [], x
        for i, factor in enumerate(self.factors):
            error = z[i] - target
            target = (z[i + 1] if i < 3 else 0.0) - factor * np.abs(error) ** ((3 - i) / (4 - i)) * np.sign(error)
            rates.append(target)
        h = loop.DELTA
        taylor = np.stack((h**2 / 2 * z[2] + h**3 / 6 * z[3], h**2 / 2 * z[3], 0 * x, 0 * x))
        self.state = z + h * np.stack(rates) + taylor
        return self.state


class Late:
    """An estimator whose samples are some milliseconds old."""

    def __init__(self, channels, estimator, milliseconds):
        self.estimator = estimator(channels)
        self.waiting = [np.zeros(channels)] * round(milliseconds / 1000 / loop.DELTA)

    def push(self, x):
        """Return y, y', y'' and y''' after a sample of every channel."""
        self.waiting.append(x)
        return self.estimator.push(self.waiting.pop(0))


class Open:
    """No estimates: the control of the reference alone."""

    def __init__(self, channels):
        self.nothing = np.full((4, channels), np.nan)

    def push(self, _):
        """Return NaN."""
        return self.nothing


class Beside:
    """Several estimators, every one for as many channels as there are seeds."""

    def __init__(self, estimators, count):
        self.estimators, self.count = estimators, count

    def push(self, x):
        """Return y, y', y'' and y''' after a sample of every channel."""
        shares = x.reshape(-1, self.count)
        return np.concatenate([one.push(share) for one, share in zip(self.estimators, shares, strict=True)], axis=-1)


# Where the search of --tune begins; it moves the seconds (and Levant's bound), not the degrees and orders.
STARTS = {
    "one window an order": (Family, [(1, 0.2, 0.2, 0.3, 0.5), (2, 0.3, 0.3, 0.4, 0.5)]),
    "Savitzky-Golay, one window": (SavitzkyGolay, [(3, 0.3), (4, 0.4), (5, 0.5)]),
    "differences, long strides": (Differences, [(0.05, 0.05, 0.05), (0.1, 0.2, 0.3)]),
    "high-gain observer, order 4": (HighGainObserver, [(4, 0.03)]),
    "high-gain observer, order 5": (HighGainObserver, [(5, 0.03)]),
    "Levant, order 3": (Levant, [(1000.0,), (20000.0,)]),
}
# What it found, in the order of CASES, with the mean tracking error over its seeds.
TUNED = {
    "one window an order": (
        (2, 0.18, 0.18, 0.154, 0.24),  # 0.0020
        (2, 0.375, 0.375, 0.4, 0.976),  # 0.0195
        (2, 0.24, 0.3, 0.256, 0.4),  # 0.0010
        (2, 0.637, 0.51, 0.435, 0.544),  # 0.0101
    ),
    "Savitzky-Golay, one window": (
        (4, 0.32),  # 0.0022
        (3, 0.3),  # 0.0285
        (5, 0.65),  # 0.0013
        (3, 0.51),  # 0.0193
    ),
    "differences, long strides": (
        (0.024, 0.0375, 0.024),  # 0.0145
        (0.0938, 0.096, 0.351),  # 0.1144
        (0.05, 0.0781, 0.37),  # 0.0067
        (0.325, 0.208, 0.508),  # 0.0474
    ),
    "high-gain observer, order 4": (
        (4, 0.03),  # 0.0040
        (4, 0.0408),  # 0.0432
        (4, 0.039),  # 0.0016
        (4, 0.0797),  # 0.0197
    ),
    "high-gain observer, order 5": (
        (5, 0.0408),  # 0.0030
        (5, 0.0638),  # 0.0360
        (5, 0.051),  # 0.0015
        (5, 0.0996),  # 0.0240
    ),
    "Levant, order 3": (
        (1360.0,),  # 0.0311
        (16000.0,),  # 0.3173
        (280.0,),  # 0.0096
        (2120.0,),  # 0.0787
    ),
}


def simulate(makers, case, seeds):
    """Return the errors of all estimators in one case: one row a number, axes of estimators and seeds."""
    (name, deviation), count = case, len(seeds)
    noise = np.tile(loop.noises(seeds, deviation), len(makers))
    estimator = Beside([make(count) for make in makers], count)
    errors = loop.errors(loop.simulate(estimator, loop.reference(loop.REFERENCES[name]), noise))
    return [values.reshape(-1, count) for values in errors]


def rows(table, case, seeds):
    """Print a line an estimator: the mean over the seeds, and the standard deviation of the tracking error."""
    found = simulate(list(table.values()), case, seeds)
    print(
        f"\n{case[0]}, noise of {case[1]:g} rad".ljust(42)
        + "tracking rms         max     rms u     y'       y''   theta_m"
    )
    for name, *numbers, failed in zip(table, *found, strict=True):
        tracking, largest, u, *estimates = numbers
        if failed.any():
            print(f"{name:40}diverges ({failed.sum()} of {failed.size})")
            continue
        columns = "".join(f"{values.mean():9.{digits}f}" for values, digits in zip(estimates, (3, 2, 3), strict=True))
        text = f"{tracking.mean():.4f} +- {tracking.std():.4f}{largest.mean():9.3f}{u.mean():10.2f}{columns}"
        print(f"{name:40}{text.replace('nan', '  -')}")


def fixed(kind, settings, **options):
    """Return what makes an estimator for a number of channels."""
    return lambda channels: kind(channels, *settings, **options)


def compare(seeds):
    """Print the table of all estimators."""
    for index, case in enumerate(CASES):
        plain = [window for window, _ in loop.ON_LINE]
        table = {"one window an order, as in the demo": fixed(Family, (1, *plain))}
        table |= {f"{name}, tuned": fixed(STARTS[name][0], found[index]) for name, found in TUNED.items()}
        table["differences, one step"] = fixed(Differences, 3 * (loop.DELTA,))
        table["no feedback"] = Open
        rows(table, case, seeds)


def choose(seeds):
    """Print what the choices do, one changed at a time from the windows of the demo."""
    plain = [window for window, _ in loop.ON_LINE]

    def family(extra=1, windows=plain, **options):
        return fixed(Family, (extra, *windows), **options)

    table = {"as in the demo": family()}
    table |= {f"delay {ms} ms": family(delay=ms / 1000) for ms in (-10, -5, 5, 10, 20, 40)}
    table["samples 20 ms old"] = fixed(Late, (family(), 20))
    table["samples 20 ms old, delay -20 ms"] = fixed(Late, (family(delay=-0.02), 20))
    table |= {f"windows {f:g} as long": family(windows=[f * w for w in plain]) for f in (0.6, 0.8, 1.25, 1.6)}
    table |= {f"windows all {w:g} s": family(windows=4 * [w]) for w in (0.2, 0.3, 0.5)}
    table |= {f"degree deriv + {n}": family(n) for n in (0, 2)}
    table["degree deriv + 2, windows 1.6"] = family(2, [1.6 * w for w in plain])
    table["trapezoid"] = family(rule="trapezoid")
    for case in CASES[:2]:
        rows(table, case, seeds)


def tune():
    """Search the settings with the least tracking error: of those around the best so far, as long as one is better."""
    for name, (kind, starts) in STARTS.items():
        print(f"    {name!r}: (", flush=True)
        for case in CASES:
            best = min((search(kind, start, case) for start in starts), key=lambda pair: pair[0])
            print(f"        {best[1]},  # {best[0]:.4f}", flush=True)
        print("    ),", flush=True)


def search(kind, start, case):
    """Return the least error found from a start, and its settings."""
    best, place = math.inf, start
    moved = [index for index, value in enumerate(start) if isinstance(value, float)]
    candidates = [scaled(start, moved, factor) for factor in (0.4, 0.6, 0.8, 1.0, 1.3, 1.7)]
    for factor in (1.25, 1.25, 1.1):
        while True:
            tracking, _, u, *_, failed = simulate([fixed(kind, one) for one in candidates], case, TUNING)
            dear = np.maximum(1.0, u.mean(axis=1) / DEAR)
            errors = np.where(failed.any(axis=1), math.inf, dear * tracking.mean(axis=1))
            better = bool(errors.min() < best)
            if better:
                best, place = float(errors.min()), candidates[int(errors.argmin())]
            groups = [moved, *([index] for index in moved if len(moved) > 1)]
            candidates = [scaled(place, group, ratio) for group in groups for ratio in (factor, 1 / factor)]
            if not better:
                break
    return best, place


def scaled(settings, indices, factor):
    """Return settings of which some are multiplied by a factor."""
    return tuple(float(f"{v * factor:.3g}") if i in indices else v for i, v in enumerate(settings))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="how many, from 0 on; default %(default)s")
    parser.add_argument("--tune", action="store_true", help="search the settings of the estimators anew")
    parser.add_argument("--choices", action="store_true", help="vary delay, windows, degree and rule instead")
    options = parser.parse_args()
    if options.seeds < 1:
        parser.error(f"--seeds must be at least 1, got {options.seeds}")
    if options.tune:
        tune()
    elif options.choices:
        choose(range(options.seeds))
    else:
        compare(range(options.seeds))
