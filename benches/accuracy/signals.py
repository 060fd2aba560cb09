"""Sixteen signals with their first two derivatives: smooth and not, steady and changing, and three without any."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Samples = NDArray[np.float64]
    Triple = tuple[Samples, Samples, Samples]


class Signal(NamedTuple):
    """A signal over `duration` seconds; `values` returns it and its derivatives at some times."""

    name: str
    duration: float
    values: Callable[[Samples], Triple]


SIGNALS: list[Signal] = []


def _signal(duration: float) -> Callable[[Callable[[Samples], Triple]], Callable[[Samples], Triple]]:
    def keep(values: Callable[[Samples], Triple]) -> Callable[[Samples], Triple]:
        SIGNALS.append(Signal(values.__name__, duration, values))
        return values

    return keep


@_signal(5.0)
def paper(t: Samples) -> Triple:
    """Return the first illustration of Mboup, Join and Fliess (2007)."""
    decay, sine, cosine, step = np.exp(-t / 1.2), np.sin(6 * t + np.pi), np.cos(6 * t + np.pi), np.tanh(t - 1)
    slope = 1 - step**2
    first = slope + decay * (6 * cosine - sine / 1.2)
    return step + decay * sine, first, -2 * step * slope + decay * ((1 / 1.44 - 36) * sine - 10 * cosine)


@_signal(4.0)
def chirp(t: Samples) -> Triple:
    """Return a sine whose frequency rises from 0.5 to 5 Hz."""
    phase, rate, change = 2 * np.pi * (0.5 * t + 0.5625 * t**2), 2 * np.pi * (0.5 + 1.125 * t), 2.25 * np.pi
    return np.sin(phase), rate * np.cos(phase), change * np.cos(phase) - rate**2 * np.sin(phase)


def _sines(t: Samples, *parts: tuple[float, float]) -> Triple:
    waves = [(size, 2 * np.pi * frequency) for size, frequency in parts]
    return (
        sum(size * np.sin(rate * t) for size, rate in waves),
        sum(size * rate * np.cos(rate * t) for size, rate in waves),
        sum(-size * rate**2 * np.sin(rate * t) for size, rate in waves),
    )


@_signal(10.0)
def sine(t: Samples) -> Triple:
    """Return eight periods of a sine."""
    return _sines(t, (1.0, 0.8))


@_signal(10.0)
def two_tones(t: Samples) -> Triple:
    """Return a sine with a weak one of four times its frequency."""
    return _sines(t, (1.0, 0.7), (0.2, 2.9))


@cache
def _solution(name: str) -> Callable[[Samples], Samples]:
    rate, start, duration = {
        "lorenz": (_lorenz, solve_ivp(_lorenz, (0, 5), [1.0, 1.0, 1.0], "DOP853", rtol=1e-11).y[:, -1], 8.0),
        "double_pendulum": (_double_pendulum, [1.5, 1.0, 0.0, 0.0], 8.0),
        "van_der_pol": (_van_der_pol, [2.0, 0.0], 20.0),
    }[name]
    return solve_ivp(rate, (0, duration), start, "DOP853", rtol=1e-11, atol=1e-12, dense_output=True).sol


def _lorenz(_: float, state: Samples) -> list[Samples]:
    x, y, z = state
    return [10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z]


@_signal(8.0)
def lorenz(t: Samples) -> Triple:
    """Return the first coordinate of the Lorenz system."""
    x, y, z = _solution("lorenz")(t)
    first = 10 * (y - x)
    return x, first, 10 * (x * (28 - z) - y - first)


def _double_pendulum(_: float, state: Samples) -> list[Samples]:
    """Return the equations of two equal masses on equal rods of a metre."""
    a, b, p, q = state
    g, apart = 9.81, a - b
    shared = 3 - np.cos(2 * apart)
    upper = -3 * g * np.sin(a) - g * np.sin(a - 2 * b) - 2 * np.sin(apart) * (q**2 + p**2 * np.cos(apart))
    lower = 2 * np.sin(apart) * (2 * p**2 + 2 * g * np.cos(a) + q**2 * np.cos(apart))
    return [p, q, upper / shared, lower / shared]


@_signal(8.0)
def double_pendulum(t: Samples) -> Triple:
    """Return the angle of the lower rod."""
    state = _solution("double_pendulum")(t)
    return state[1], state[3], _double_pendulum(0.0, state)[3]


def _van_der_pol(_: float, state: Samples) -> list[Samples]:
    return [state[1], 3.0 * (1 - state[0] ** 2) * state[1] - state[0]]


@_signal(20.0)
def van_der_pol(t: Samples) -> Triple:
    """Return an oscillation that relaxes slowly and jumps."""
    state = _solution("van_der_pol")(t)
    return state[0], state[1], _van_der_pol(0.0, state)[1]


@_signal(4.0)
def step_response(t: Samples) -> Triple:
    """Return the response of a weakly damped system to a step after a second; its acceleration jumps there."""
    damping, rate = 0.3, 8.0
    damped, since, on = rate * np.sqrt(1 - damping**2), np.maximum(t - 1, 0), t >= 1
    decay, sine, cosine = np.exp(-damping * rate * since), np.sin(damped * since), np.cos(damped * since)
    ratio = damping * rate / damped
    first = decay * rate**2 / damped * sine
    second = decay * rate**2 * (cosine - ratio * sine)
    return on * (1 - decay * (cosine + ratio * sine)), on * first, on * second


def _bells(t: Samples, bells: list[tuple[float, float, float]]) -> Triple:
    parts = np.zeros((3, t.size))
    for size, middle, width in bells:
        place = (t - middle) / width
        bell = size * np.exp(-(place**2) / 2)
        parts += bell, -place / width * bell, (place**2 - 1) / width**2 * bell
    return parts[0], parts[1], parts[2]


@_signal(4.0)
def heartbeats(t: Samples) -> Triple:
    """Return five beats of an electrocardiogram, as sums of bells."""
    waves = [(0.12, 0.18, 0.025), (-0.1, 0.315, 0.016), (1.0, 0.35, 0.018), (-0.25, 0.39, 0.016), (0.3, 0.6, 0.045)]
    return _bells(t, [(size, 0.8 * beat + at, width) for beat in range(-1, 6) for size, at, width in waves])


@_signal(6.0)
def bump(t: Samples) -> Triple:
    """Return one bell in the middle of nothing."""
    return _bells(t, [(1.0, 2.0, 0.15)])


@_signal(5.0)
def decay(t: Samples) -> Triple:
    """Return two exponentials, of 1 s and 0.2 s."""
    slow, fast = np.exp(-t), 0.5 * np.exp(-5 * t)
    return slow + fast, -slow - 5 * fast, slow + 25 * fast


@_signal(6.0)
def robot_moves(t: Samples) -> Triple:
    """Return moves of least jerk from point to point, with rests."""
    parts = np.zeros((3, t.size))
    for start, lasts, far in [(0.5, 1.0, 1.0), (2.0, 0.5, -0.6), (3.2, 1.5, 0.9), (5.0, 0.4, -0.5)]:
        s = np.clip((t - start) / lasts, 0, 1)
        parts[0] += far * s**3 * (10 - 15 * s + 6 * s**2)
        parts[1] += far / lasts * 30 * s**2 * (1 - s) ** 2
        parts[2] += far / lasts**2 * 60 * s * (1 - 3 * s + 2 * s**2)
    return parts[0], parts[1], parts[2]


@_signal(6.0)
def ramps(t: Samples) -> Triple:
    """Return moves of constant acceleration, speed and deceleration: the acceleration jumps."""
    parts, before = np.zeros((3, t.size)), 0.0
    for at, size in [(0.5, 2), (1.0, 0), (2.0, -2), (2.5, 0), (3.5, -3), (3.9, 0), (4.3, 3), (4.7, 0)]:
        since, jump = np.maximum(t - at, 0), size - before
        parts += jump * since**2 / 2, jump * since, jump * (t >= at)
        before = size
    return parts[0], parts[1], parts[2]


@_signal(2.0)
def polynomial(t: Samples) -> Triple:
    """Return a cubic."""
    return 1 - 2 * t + 3 * t**2 - t**3, -2 + 6 * t - 3 * t**2, 6 - 6 * t


@_signal(1.0)
def constant(t: Samples) -> Triple:
    """Return a constant."""
    return np.full(t.size, 3.0), np.zeros(t.size), np.zeros(t.size)


@_signal(1.0)
def nothing(t: Samples) -> Triple:
    """Return zeros: what is sampled is noise only."""
    return np.zeros(t.size), np.zeros(t.size), np.zeros(t.size)
