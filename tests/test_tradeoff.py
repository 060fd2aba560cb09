"""The least error that each delay allows, against every window and against simulation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import algdiff
from support import design

SIGNAL: dict[str, float] = {"bandwidth": 1.0, "amplitude": 2.0}
NOISE = 0.02
FS = 500.0


def error(ours: algdiff.Differentiator) -> float:
    """Return the root-mean-square error on the sinusoid in white noise, by the weights' own response and gain."""
    distance = ours.frequency_response(SIGNAL["bandwidth"]) - (2j * np.pi * SIGNAL["bandwidth"]) ** ours.deriv
    return float(np.sqrt(0.5 * (SIGNAL["amplitude"] * abs(distance)) ** 2 + NOISE**2 * ours.noise_gain))


@pytest.mark.parametrize(
    "options", [{"degree": 2}, {"degree": 3, "kappa": 0.0, "mu": 0.0}, {"deriv": 2, "degree": 3, "mu": 0.0}]
)
@pytest.mark.parametrize("delay", [-0.02, 0.0, 0.04, 0.1])
def test_no_window_errs_less_at_the_same_delay(delay: float, options: dict[str, Any]) -> None:
    curve = algdiff.delay_tradeoff([delay], NOISE, **SIGNAL, **options, fs=FS)
    best = design(int(curve.window_length[0]), delay=delay, fs=FS, **options)
    # Weights differ from the kernel by terms of 1 / L^2, and the whole number of samples from the best length by 1 / L.
    assert error(best) == pytest.approx(curve.rmse[0], rel=4 / best.window_length)
    least = max(options["degree"] + 1, int(delay * FS) + 1)
    others = [error(design(length, delay=delay, fs=FS, **options)) for length in range(max(least, 20), 1200, 7)]
    assert curve.rmse[0] <= min(others) * (1 + 4 / best.window_length)


def test_the_error_is_what_a_simulation_finds() -> None:
    curve = algdiff.delay_tradeoff([0.05], NOISE, **SIGNAL, degree=2, fs=FS)
    best = design(int(curve.window_length[0]), delay=0.05, fs=FS, degree=2)
    rng = np.random.default_rng(3)
    t = np.arange(400 * int(FS)) / FS  # whole periods
    x = SIGNAL["amplitude"] * np.sin(2 * np.pi * t) + NOISE * rng.standard_normal(t.size)
    estimate = best(x, mode="valid")
    times = t[best.window_length - 1 :] - best.delay
    found = float(np.sqrt(np.mean((estimate - 2 * np.pi * SIGNAL["amplitude"] * np.cos(2 * np.pi * times)) ** 2)))
    # 2e5 estimates from windows of some 100 samples: 2000 independent ones give the mean square to 3 %, its root to
    # half of that.
    assert found == pytest.approx(curve.rmse[0], rel=0.05)


def test_the_delays_come_back_in_their_order() -> None:
    delays = np.array([0.1, 0.0, 0.05])
    curve = algdiff.delay_tradeoff(delays, NOISE, **SIGNAL, fs=FS)
    np.testing.assert_array_equal(curve.delay, delays)
    single = [algdiff.delay_tradeoff([delay], NOISE, **SIGNAL, fs=FS) for delay in delays]
    np.testing.assert_array_equal(curve.rmse, [part.rmse[0] for part in single])
    np.testing.assert_array_equal(curve.window_length, [part.window_length[0] for part in single])
    assert curve.window_length.dtype.kind == "i"
    assert algdiff.delay_tradeoff([], NOISE, **SIGNAL).rmse.shape == (0,)


@pytest.mark.parametrize(
    ("match", "options"),
    [
        ("delays must be finite, got nan", {"delays": [0.0, np.nan]}),
        ("delays must be a one-dimensional array", {"delays": 0.1}),
        ("delays must be at most 10000000 sampling steps", {"delays": [1e9]}),
        ("noise_level must be finite and positive, got 0", {"noise_level": 0.0}),
        ("bandwidth must be finite and positive, got -1", {"bandwidth": -1.0}),
        ("amplitude must be finite and positive, got inf", {"amplitude": np.inf}),
        ("kappa must be greater than -1/2", {"kappa": -0.6}),
        ("degree must be at least deriv = 1, got 0", {"degree": 0}),
        ("delta must be finite and positive, got 0", {"delta": 0.0}),
    ],
)
def test_refusals_name_the_argument(match: str, options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=match):
        algdiff.delay_tradeoff(**{"delays": [0.1], "noise_level": NOISE, **SIGNAL, **options})
