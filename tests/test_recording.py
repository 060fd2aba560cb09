"""The real pendulum: its second derivative must obey its equation of motion."""

from __future__ import annotations

from importlib.resources import files

import numpy as np
import pytest

import algdiff

DELTA, WINDOW, DEGREE = 1e-4, 1601, 5
RELEASE = 2047


@pytest.fixture(scope="module")
def angle() -> np.ndarray:
    with (files("algdiff") / "data" / "pendulum_encoder.npz").open("rb") as file, np.load(file) as recording:
        counts: np.ndarray = recording["counts"]
    assert counts.shape == (231_757,)
    return counts * (2 * np.pi / 40_000)


def equation_of_motion(angle: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> tuple[float, float, float]:
    """Return a, b and R^2 of acceleration = a sin(angle) - b velocity, away from the release and the ends."""
    inner = slice(RELEASE + WINDOW, -WINDOW)
    terms = np.stack([np.sin(angle[inner]), -velocity[inner]], axis=1)
    (a, b), *_ = np.linalg.lstsq(terms, acceleration[inner], rcond=None)
    residual = acceleration[inner] - terms @ [a, b]
    return float(a), float(b), float(1 - residual.var() / acceleration[inner].var())


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_acceleration_obeys_the_pendulum(angle: np.ndarray, dtype: type) -> None:
    x = angle.astype(dtype)
    options = {"degree": DEGREE, "kappa": 0, "mu": 0, "delta": DELTA}
    smooth, velocity, acceleration = (algdiff.differentiate(x, WINDOW, deriv, **options) for deriv in range(3))
    a, b, r2 = equation_of_motion(*(y.astype(np.float64) for y in (smooth, velocity, acceleration)))
    assert r2 >= 0.9965
    assert abs(a - 65.0) <= 0.3
    assert 0.5 <= b <= 0.75


def test_savgol_filter_on_the_recording_too(angle: np.ndarray) -> None:
    y = [algdiff.savgol_filter(angle, WINDOW, DEGREE, deriv, DELTA) for deriv in range(3)]
    a, _, r2 = equation_of_motion(*y)
    assert r2 >= 0.9965
    assert abs(a - 65.0) <= 0.3


def test_velocity_integrates_back_to_the_angle(angle: np.ndarray) -> None:
    options = {"degree": DEGREE, "kappa": 0, "mu": 0, "delta": DELTA}
    velocity = algdiff.differentiate(angle, WINDOW, 1, **options)
    smooth = algdiff.differentiate(angle, WINDOW, 0, **options)
    inner = slice(RELEASE + WINDOW, -WINDOW)
    travelled = np.cumsum(velocity[inner])[:-1] * DELTA
    # One encoder step is 1.6e-4 rad; the rectangle rule errs by half a step of time at most: 5e-5 s times 12 rad/s.
    np.testing.assert_allclose(smooth[inner][1:] - smooth[inner][0], travelled, rtol=0, atol=1.6e-4 + 6e-4)
