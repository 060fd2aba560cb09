"""Feedback from on-line estimates: the motor, spring and pendulum of Mboup, Join and Fliess (2007), Section IV.

The source leaves out the spring, the reference, the gains, the windows and the sampling step; those here are ours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from algdiff import Differentiator

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from algdiff._arguments import Samples

DELTA = 0.002
TIMES = DELTA * np.arange(7001)
CLOSED = 0.5
"""Before it, while the windows fill, the control is that of the reference."""
SETTLED = 3.0
"""Errors are taken from here on."""
START = 0.3
"""Where the pendulum is held at first; the reference begins at 0."""
LOST = np.pi / 2
"""A loop whose output is this far from the reference has failed, and its control is switched off."""
GAINS = (800.0, 400.0, 92.0, 12.0)
"""Of the errors of y, y', y'' and y'''; the poles are -2 +- 6i and -4 +- 2i."""
REFERENCES = {"S1": np.pi / 2, "S2": np.pi}
"""How far each goes; S2 stands the pendulum upright."""

ON_LINE = ((0.2, 1), (0.2, 2), (0.3, 3), (0.5, 4))
"""Window in seconds and degree of the estimators of y, y', y'' and y'''."""
ROOT = ((0.3, 1), (0.5, 2), (0.7, 3))
CENTRE = ((0.6, 2), (0.8, 3), (0.8, 4))


class Bench(NamedTuple):
    """The parameters, in SI units: the source's, and spring and gravity."""

    j_m: float = 3.7e-3
    j_l: float = 9.3e-3
    h: float = 0.15
    m: float = 0.21
    b: float = 4.6e-2
    k_tau: float = 8e-2
    k: float = 0.18
    g: float = 9.81

    def rates(self, state: Samples, u: Samples) -> Samples:
        """Return the time derivative of the state: angle and velocity of the motor, angle and velocity of the load."""
        motor, motor_speed, load, load_speed = state
        spring = self.k * (load - motor)
        return np.stack(
            (
                motor_speed,
                (spring - self.b * motor_speed + self.k_tau * u) / self.j_m,
                load_speed,
                (-spring - self.m * self.g * self.h * np.sin(load)) / self.j_l,
            )
        )

    def advance(self, state: Samples, u: Samples, step: float = DELTA) -> Samples:
        """Return the state a step later, the control being held, by one step of Runge and Kutta."""
        first = self.rates(state, u)
        second = self.rates(state + step / 2 * first, u)
        third = self.rates(state + step / 2 * second, u)
        fourth = self.rates(state + step * third, u)
        after: Samples = state + step / 6 * (first + 2 * (second + third) + fourth)
        return after

    def output(self, state: Samples) -> Samples:
        """Return y, y', y'' and y''': the state in the coordinates of the flat output."""
        motor, motor_speed, load, load_speed = state
        weight = self.m * self.g * self.h
        second = (self.k * (motor - load) - weight * np.sin(load)) / self.j_l
        third = (self.k * (motor_speed - load_speed) - weight * load_speed * np.cos(load)) / self.j_l
        return np.stack((load, load_speed, second, third))

    def motor(self, y: Samples) -> Samples:
        """Return the angle of the motor, from y and y'' in rows 0 and 2."""
        angle: Samples = (self.j_l * y[2] + self.m * self.g * self.h * np.sin(y[0])) / self.k + y[0]
        return angle

    def control(self, y: Samples, reference: Samples) -> Samples:
        """Return u, from y to y''' and from the reference with its four derivatives.

        The source prints y' for y'' in two places, a product for the sum before B, and exchanges the gains of y' and
        y''.
        """
        position, velocity, acceleration, jerk = y
        weight, sine, cosine = self.m * self.g * self.h, np.sin(position), np.cos(position)
        v = reference[4] - np.tensordot(GAINS, y - reference[:4], 1)
        fourth = self.j_l * v + self.k * acceleration + weight * (acceleration * cosine - velocity**2 * sine)
        third = self.j_l * jerk + self.k * velocity + weight * velocity * cosine
        torque = self.j_m / self.k * fourth + self.j_l * acceleration + weight * sine + self.b / self.k * third
        u: Samples = torque / self.k_tau
        return u


BENCH = Bench()


class Estimator(Protocol):
    """What closes the loop: a `Stream` of several orders, or anything else that is fed as one is."""

    def push(self, x: Samples, /) -> Samples:
        """Take one sample of every channel and return y, y', y'' and y''' of each; NaN while there are none."""


class Run(NamedTuple):
    """What happened: rows of time, columns of channels; y and its estimates have an axis of orders in front."""

    reference: Samples
    noise: Samples
    u: Samples
    y: Samples
    estimates: Samples
    motor: Samples
    failed: Samples

    @property
    def measured(self) -> Samples:
        """The output with its noise."""
        seen: Samples = self.y[0] + self.noise
        return seen

    @property
    def motor_estimate(self) -> Samples:
        """The angle of the motor, from the estimates."""
        return BENCH.motor(self.estimates)


def reference(height: float) -> Samples:
    """Return y* and its four derivatives at `TIMES`: from rest to rest, up from 3 to 6 s and back from 9 to 12 s."""
    step = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])
    rows = np.zeros((5, TIMES.size))
    for start, sign in ((3.0, 1.0), (9.0, -1.0)):
        s = np.clip((TIMES - start) / 3.0, 0.0, 1.0)
        for order, row in enumerate(rows):
            row += sign * height * step.deriv(order)(s) / 3.0**order
    return rows


def noises(seeds: Iterable[int], deviation: float) -> Samples:
    """Return white noise, one column a seed."""
    columns = [np.random.default_rng(seed).standard_normal(TIMES.size) for seed in seeds]
    return deviation * np.stack(columns, axis=1)


def designs(
    windows: Sequence[tuple[float, int]] = ON_LINE, tau: str = "newest", rule: str = "exact"
) -> list[Differentiator]:
    """Return the estimators of y, y', ... from the window and the degree of each, with kappa = mu = 0."""
    words: dict[str, Any] = {"kappa": 0, "mu": 0, "tau": tau, "delta": DELTA, "rule": rule}
    return [
        Differentiator(round(duration / DELTA), order, degree=degree, **words)
        for order, (duration, degree) in enumerate(windows)
    ]


def simulate(
    estimator: Estimator | None,
    reference: Samples,
    noise: Samples,
    *,
    plant: Bench = BENCH,
    control: Callable[[Samples, Samples], Samples] = BENCH.control,
    progress: Callable[[float], object] | None = None,
) -> Run:
    """Close the loop: sample, estimate, and hold the control to the next sample; the loops of all channels together.

    Parameters
    ----------
    estimator : Estimator or None
        Sees the noisy samples and nothing else. None leaves the loop open.
    reference : ndarray of shape (5, samples) or (5, samples, channels)
        The reference with its four derivatives.
    noise : ndarray of shape (samples, channels)
        Added to the output before it is seen.
    plant : Bench, optional
        The true parameters; those of the control stay.
    control : callable, optional
        From estimates and reference to u.
    progress : callable, optional
        Called with the time, every second of it.
    """
    goal = reference[..., None] if reference.ndim == 2 else reference
    nominal = control(goal[:4], goal)
    state = np.zeros((4, noise.shape[1]))
    state[2] = START
    state[0] = BENCH.motor(np.stack((state[2], state[3], state[3])))
    y, estimates = np.empty((2, 4, *noise.shape))
    u, motor = np.empty((2, *noise.shape))
    closed, failed = np.zeros((2, noise.shape[1]), dtype=bool)
    for i, disturbance in enumerate(noise):
        y[:, i], motor[i] = plant.output(state), state[0]
        estimates[:, i] = np.nan if estimator is None else estimator.push(state[2] + disturbance)
        failed |= np.abs(state[2] - goal[0, i]) > LOST
        u[i] = nominal[i]
        if i * DELTA >= CLOSED:
            closed |= np.isfinite(estimates[:, i]).all(axis=0)
            u[i] = np.where(closed, control(estimates[:, i], goal[:, i]), u[i])
        u[i, failed] = 0.0
        state = plant.advance(state, u[i])
        if progress is not None and i % round(1 / DELTA) == 0:
            progress(i * DELTA)
    return Run(goal, noise, u, y, estimates, motor, failed)


def off_line(run: Run, windows: Sequence[tuple[float, int]], tau: str, threads: int | None = None) -> Samples:
    """Return estimates of y, y', y'' from the samples of a run, at the times of the samples.

    A root between two samples is moved to the nearest. Where the window is not full they are NaN.
    """
    measured = run.measured
    return np.stack([design(measured, axis=0, mode="nan", threads=threads) for design in designs(windows, tau)])


class Errors(NamedTuple):
    """Root mean squares from `SETTLED` on, one number a channel; the largest deviation, and whether the loop failed."""

    tracking: Samples
    largest: Samples
    u: Samples
    velocity: Samples
    acceleration: Samples
    motor: Samples
    failed: Samples


def errors(run: Run) -> Errors:
    """Return what the loops and their on-line estimates err by."""
    kept = slice(round(SETTLED / DELTA), None)
    deviation = (run.y[0] - run.reference[0])[kept]
    missed = (run.estimates - run.y)[:, kept]
    return Errors(
        rms(deviation),
        np.abs(deviation).max(axis=0),
        rms(run.u[kept]),
        rms(missed[1]),
        rms(missed[2]),
        rms((run.motor_estimate - run.motor)[kept]),
        run.failed,
    )


def off_line_errors(run: Run, estimates: Samples) -> tuple[Samples, Samples]:
    """Return what off-line estimates of y' and of the motor's angle err by, up to the last window."""
    kept = slice(round(SETTLED / DELTA), -round(max(CENTRE)[0] / DELTA))
    return rms((estimates[1] - run.y[1])[kept]), rms((BENCH.motor(estimates) - run.motor)[kept])


def rms(values: Samples) -> Samples:
    """Return the root mean square of every column."""
    root: Samples = np.sqrt((values**2).mean(axis=0))
    return root
