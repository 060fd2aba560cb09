"""What is chosen from the data, and what it makes of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import algdiff
from algdiff import _demo, _paper_figures
from algdiff._suggest import edges

Array = npt.NDArray[np.float64]
DELTA = 0.01


def swing(seed: int, level: float = 0.02, count: int = 600) -> Array:
    """Return a sine in white noise."""
    noise = np.random.default_rng(seed).standard_normal(count)
    return np.asarray(np.sin(2 * DELTA * np.arange(count)) + level * noise)


def chosen(suggestion: algdiff.Suggestion) -> tuple[int, int]:
    return suggestion.differentiator.window_length, suggestion.differentiator.degree


def interior(suggestion: algdiff.Suggestion, length: int) -> slice:
    """Return where the windows of the middle say all."""
    reach = edges.reach(suggestion.differentiator.window_length)
    assert length > 2 * reach
    return slice(reach, length - reach)


def test_the_papers_illustration() -> None:
    stamps = _paper_figures.TIMES
    core = (stamps >= 0.55) & (stamps <= 4.45)
    inner, everywhere = [], []
    for seed in range(10):
        y = _paper_figures.observe(seed)
        error = algdiff.differentiate(y, delta=_paper_figures.DELTA) - _paper_figures.slope(stamps)
        inner.append(np.sqrt(np.mean(error[core] ** 2)))
        everywhere.append(np.sqrt(np.mean(error**2)))
    assert np.mean(inner) <= 0.046
    assert np.mean(everywhere) <= 0.072


def test_the_encoder() -> None:
    theta, delta = _demo.recording()
    suggestion = algdiff.suggest(theta, 2, delta=delta)
    designs = [suggestion.differentiator.replace(deriv=order) for order in range(3)]
    law = _demo.fit(_demo.Estimates(*(design(theta) for design in designs), 0.0))
    assert law.r2 >= 0.995
    # The counts are multiples of one of 40,000 parts of a turn.
    assert suggestion.quantum == pytest.approx(2 * np.pi / 40_000, rel=1e-6)


@pytest.mark.parametrize("deriv", [0, 1, 2, (0, 1, 2), (2, 0)])
def test_differentiate_is_suggest_and_call(deriv: Any) -> None:
    x = swing(0)
    suggestion = algdiff.suggest(x, deriv, delta=DELTA)
    expected = suggestion(x)
    assert expected.shape == (x.shape if isinstance(deriv, int) else (len(deriv), *x.shape))
    np.testing.assert_array_equal(algdiff.differentiate(x, deriv=deriv, delta=DELTA), expected)
    np.testing.assert_array_equal(algdiff.differentiate(x, deriv=deriv, fs=1 / DELTA), expected)
    assert chosen(algdiff.suggest(x, deriv, fs=1 / DELTA)) == chosen(suggestion)
    t = 7 + DELTA * np.arange(x.size)
    step = algdiff.suggest(x, deriv, t=t).differentiator.delta
    assert step == pytest.approx(DELTA, rel=1e-12)
    by_times = algdiff.differentiate(x, deriv=deriv, t=t)
    np.testing.assert_array_equal(by_times, algdiff.suggest(x, deriv, delta=step)(x))
    backwards = algdiff.differentiate(x[::-1], deriv=deriv, t=t[::-1])
    # The step is found from the other end, and rounded apart.
    np.testing.assert_allclose(backwards[..., ::-1], by_times, rtol=1e-9, atol=1e-9)


def test_dates() -> None:
    x = swing(1)
    t = np.datetime64("2020-01-01") + 10 * np.arange(x.size) * np.timedelta64(1, "ms")
    expected = algdiff.differentiate(x, delta=DELTA)
    np.testing.assert_allclose(algdiff.differentiate(x, t=t), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("deriv", [0, 1, 2])
@pytest.mark.parametrize("kappa", [0.0, 1.0])
def test_the_interior_is_the_designs(deriv: int, kappa: float) -> None:
    x = swing(2, 0.005)
    suggestion = algdiff.suggest(x, deriv, delta=DELTA, kappa=kappa, mu=kappa, max_window=201)
    middle = interior(suggestion, x.size)
    design = suggestion.differentiator
    assert (design.kappa, design.mu, design.tau, design.delta) == (kappa, kappa, 0.5, DELTA)
    np.testing.assert_array_equal(suggestion(x)[middle], design(x)[middle])
    alone = algdiff.Differentiator(
        design.window_length, deriv, degree=design.degree, kappa=kappa, mu=kappa, delta=DELTA
    )
    np.testing.assert_array_equal(suggestion(x)[middle], alone(x)[middle])


def test_several_orders_are_of_one_design() -> None:
    x = swing(3, 0.005)
    suggestion = algdiff.suggest(x, (0, 1, 2), delta=DELTA, max_window=201)
    assert chosen(suggestion) == chosen(algdiff.suggest(x, 2, delta=DELTA, max_window=201))
    middle = interior(suggestion, x.size)
    for order, found in enumerate(suggestion(x)):
        alone = suggestion.differentiator.replace(deriv=order)(x)
        scale = float(np.abs(alone).max())
        np.testing.assert_allclose(found[middle], alone[middle], rtol=0, atol=1e-11 * scale)


@pytest.mark.parametrize("deriv", [0, 1, 2, 3])
@pytest.mark.parametrize("level", [0.0, 0.01])
def test_polynomials_of_the_order_to_the_ends(deriv: int, level: float) -> None:
    rng = np.random.default_rng(deriv)
    suggestion = algdiff.suggest(swing(4, level), deriv, delta=DELTA)
    t = DELTA * np.arange(600)
    polynomial = np.polynomial.Polynomial(rng.standard_normal(deriv + 1))
    x = polynomial(t)
    expected = polynomial.deriv(deriv)(t) if deriv else x
    # Rounding of the samples is amplified by the noise gain of an end, which is at most 1e4 times that of the middle.
    gain = float(np.sqrt(suggestion.differentiator.noise_gain))
    bound = 1e-12 * float(np.abs(x).max()) + 1e4 * 2.3e-16 * float(np.abs(x).max()) * gain
    np.testing.assert_allclose(suggestion(x), expected, rtol=1e-9, atol=bound)


@pytest.mark.parametrize("deriv", [1, 2, 3])
def test_a_cubic_without_noise(deriv: int) -> None:
    t = DELTA * np.arange(600)
    cubic = np.polynomial.Polynomial([1.0, -2.0, 3.0, -1.0])
    expected = cubic.deriv(deriv)(t)
    found = algdiff.differentiate(cubic(t), deriv=deriv, delta=DELTA)
    # A millionth of what the derivative is: the samples are known to 1e-9 of their size, as is what is chosen.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * float(np.abs(expected).max()))


@pytest.mark.parametrize("value", [3.3, -1e9, 1e-9])
@pytest.mark.parametrize("deriv", [1, 2])
def test_constants(value: float, deriv: int) -> None:
    found = algdiff.differentiate(np.full(400, value), deriv=deriv, delta=DELTA)
    np.testing.assert_allclose(found, 0, atol=1e-12 * abs(value) / DELTA**deriv)


@pytest.mark.parametrize("deriv", [0, 1, 2])
@pytest.mark.parametrize("scale", [1e-100, 1e-9, -1.0, 1e9, 1e100])
def test_the_choice_knows_no_scale(deriv: int, scale: float) -> None:
    x = swing(5)
    plain, scaled = algdiff.suggest(x, deriv), algdiff.suggest(scale * x, deriv)
    assert chosen(scaled) == chosen(plain)
    assert scaled.rmse == pytest.approx(abs(scale) * plain.rmse, rel=1e-6)
    assert scaled.noise_level == pytest.approx(abs(scale) * plain.noise_level, rel=1e-6)


@pytest.mark.parametrize("deriv", [1, 2])
@pytest.mark.parametrize("offset", [1.0, -1e5, 1e9])
def test_the_choice_knows_no_offset(deriv: int, offset: float) -> None:
    x = swing(6)
    plain, moved = algdiff.suggest(x, deriv), algdiff.suggest(x + offset, deriv)
    assert chosen(moved) == chosen(plain)
    # The samples are rounded to 1e-16 of the offset, and 1e-7 is 5e-6 of the noise.
    assert moved.noise_level == pytest.approx(plain.noise_level, rel=1e-4)


@pytest.mark.parametrize("deriv", [0, 1, 2])
def test_the_choice_knows_no_step(deriv: int) -> None:
    x = swing(7)
    plain, slow = algdiff.suggest(x, deriv), algdiff.suggest(x, deriv, delta=1e6)
    assert chosen(slow) == chosen(plain)
    assert slow.rmse == pytest.approx(plain.rmse / 1e6**deriv, rel=1e-9)
    np.testing.assert_allclose(slow(x) * 1e6**deriv, plain(x), rtol=0, atol=1e-9 * float(np.abs(plain(x)).max()))


def test_time_reversed() -> None:
    x = swing(8)
    plain, reverse = algdiff.suggest(x), algdiff.suggest(x[::-1])
    assert chosen(reverse) == chosen(plain)
    np.testing.assert_allclose(reverse(x[::-1])[::-1], -plain(x), rtol=0, atol=1e-9)


def test_the_same_again() -> None:
    x = swing(9)
    first, second = algdiff.suggest(x), algdiff.suggest(x.copy())
    assert repr(first) == repr(second)
    for one, other in zip(first.curve, second.curve, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(first(x), second(x))


@pytest.mark.parametrize(("deriv", "factor"), [(0, 1.5), (1, 1.5), (2, 2.0)])
def test_other_noise_of_the_same_level(deriv: int, factor: float) -> None:
    t = DELTA * np.arange(2000)
    truth = 2.0**deriv * np.sin(2 * t + deriv * np.pi / 2)
    errors, estimated, windows = [], [], []
    for seed in range(16):
        x = swing(seed, 0.05, 2000)
        suggestion = algdiff.suggest(x, deriv, delta=DELTA)
        errors.append(float(np.mean((suggestion(x) - truth) ** 2)))
        estimated.append(suggestion.rmse**2)
        windows.append(suggestion.differentiator.window_length)
        # The level is that of 2000 samples, 1.6 percent at one standard error; four.
        assert suggestion.noise_level == pytest.approx(0.05, rel=0.064)
    # Windows are 1.2 apart; the least risk is flat over two of them.
    assert max(windows) <= 1.2**3 * min(windows)
    # Most of the error is at the ends, where noise hides what a second derivative is made of.
    assert 1 / factor < np.sqrt(np.mean(estimated) / np.mean(errors)) < factor


def test_less_noise_less_error() -> None:
    truth = 2 * np.cos(2 * DELTA * np.arange(1000))
    errors = []
    for level in (1e-4, 1e-3, 1e-2, 1e-1):
        x = [swing(seed, level, 1000) for seed in range(4)]
        errors.append(np.sqrt(np.mean([(algdiff.differentiate(one, delta=DELTA) - truth) ** 2 for one in x])))
    assert (np.diff(errors) > 0).all()
    # Of a smooth signal the error falls nearly as fast as the noise: by a power of at least 2/3 at degree 2 or more.
    assert errors[0] < errors[-1] / 1e3 ** (2 / 3)


@pytest.mark.parametrize("period", [500.0, 4000.0])
def test_a_long_recording_is_as_its_first_part(period: float) -> None:
    x = np.sin(2 * np.pi / period * np.arange(1_000_000))
    x += 0.1 * np.random.default_rng(10).standard_normal(x.size)
    whole, part = algdiff.suggest(x), algdiff.suggest(x[:100_000])
    assert whole.noise_level == pytest.approx(0.1, rel=0.02)
    # Both look at 16 blocks, others of the same kind: the same candidate, or the next but one where the risk is flat.
    ratio = whole.differentiator.window_length / part.differentiator.window_length
    assert 1.2**-2.5 < ratio < 1.2**2.5
