"""Whether the errors that a choice states are the true ones: biases that finer windows share or that noise hides."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

import algdiff
from algdiff._suggest import bias, unseen
from algdiff._suggest.candidates import design, even_degrees, family, windows

Array = npt.NDArray[np.float64]


def pieces(order: int, length: int) -> Array:
    """Return samples whose derivative of an order jumps by 1 in their middle."""
    since = np.maximum(np.arange(length) - length // 2 + 0.5, 0.0)
    return np.asarray(since**order / math.factorial(order))


@pytest.mark.parametrize(("deriv", "degree"), [(1, 2), (1, 4), (2, 4), (2, 8), (3, 6)])
@pytest.mark.parametrize("after", [0, 1])
def test_shares_of_a_jump(deriv: int, degree: int, after: int) -> None:
    # Where the derivative of the order jumps, the mean square of the bias rises with the window; where its slope does,
    # with the third power of it. Either is scaled from window to window, but for the samples, of which there are many.
    x = pieces(deriv + after, 4001)
    truth = pieces(after, 4001) if after else (np.arange(4001) > 1999.5).astype(float)
    chosen = design(deriv, 601, degree, 1.0, 1.0)
    middle = slice(1000, 3001)
    own = chosen(x)[middle]
    whole = float(np.square(own - truth[middle]).sum())
    finer = np.array([501, 401, 301])
    seen = [float(np.square(own - design(deriv, int(one), degree, 1.0, 1.0)(x)[middle]).sum()) / whole for one in finer]
    shares = bias.shares(deriv, degree, 1.0, 1.0 + 2.0 * after, 601 / finer)
    np.testing.assert_allclose(shares, seen, rtol=0.06)


def test_shares_rise_to_the_whole() -> None:
    for power in (0.5, 1.0, 3.0, 7.0):
        shares = bias.shares(2, 8, 1.0, power, np.array([1.1, 1.2, 1.5, 2.0, 4.0, 50.0]))
        assert (np.diff(shares) > 0).all()
        # A window of a fiftieth has a fiftieth of the bias, to half the power, and may add to the difference.
        assert abs(shares[-1] - 1) < 3 * 50 ** (-power / 2)
        assert shares[0] < 0.5
    # The slower a bias falls, the less of it is seen.
    ratio = np.array([1.2])
    assert np.all(np.diff([bias.shares(2, 8, 1.0, power, ratio)[0] for power in (0.5, 1.0, 2.0, 4.0, 8.0)]) > 0)


@pytest.mark.parametrize(("deriv", "after"), [(1, 0), (1, 1), (2, 0), (2, 1)])
def test_the_bias_of_a_jump(deriv: int, after: int) -> None:
    x = pieces(deriv + after, 2000)
    truth = pieces(after, 2000) if after else (np.arange(2000) > 999.5).astype(float)
    members = family(deriv, tuple((d, tuple(windows(21, 301))) for d in even_degrees(deriv)[:3]), 1.0, 1.0)
    inner = slice(200, 1800)
    estimates = np.array([one(x)[inner] for one in members.designs])
    apart = np.square(estimates[:, None] - estimates).mean(axis=-1)
    errors = np.square(estimates - truth[inner]).mean(axis=-1)
    freedom = np.full(apart.shape, 500.0)
    # So little noise that all of it is seen.
    level = 1e-3 * np.sqrt(errors.min() / members.gain.max()) * np.ones(members.gain.size)
    for best in np.flatnonzero((members.window > 60) & (members.window < 150)):
        found = bias.squared_bias(apart, freedom, members, level, int(best), 2000)
        assert found is not None
        # The power is found from windows 1.44 apart, and odd.
        assert found == pytest.approx(errors[best], rel=0.35)


def test_noise_has_no_bias() -> None:
    members = family(1, tuple((d, tuple(windows(21, 301))) for d in (2, 4)), 1.0, 1.0)
    freedom = np.full(members.difference.shape, 100.0)
    level = np.ones(members.gain.size)
    best = int(np.flatnonzero(members.window < 120)[-1])
    assert bias.squared_bias(members.difference, freedom, members, level, best, 2000) is None
    # A standard deviation more is noise, too; ten are not.
    for deviations, seen in ((1.0, False), (10.0, True)):
        apart = members.difference * (1 + deviations * math.sqrt(2 / 100))
        assert (bias.squared_bias(apart, freedom, members, level, best, 2000) is not None) is seen
    # Nothing is said of the shortest window, which nothing is finer than, nor of windows as long as the rows.
    assert bias.squared_bias(10 * members.difference, freedom, members, level, 0, 2000) is None
    assert bias.squared_bias(10 * members.difference, freedom, members, level, best, 100) is None


@pytest.mark.parametrize("ratio", [0.3, 2.0, 5.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_decline_of_coefficients(ratio: float, sign: float) -> None:
    degrees = np.arange(14)
    factorials = np.array([math.factorial(k) for k in degrees], float)
    scores = 1e3 * (sign * ratio) ** degrees / factorials
    spread = unseen.prior(scores)
    clear = np.abs(scores) > unseen.CLEAR
    last = int(np.flatnonzero(clear[1:])[-1]) + 1
    assert np.isinf(spread[: last + 1]).all()
    if ratio < unseen.SLOWEST * (last + 1):
        np.testing.assert_allclose(spread[last + 1 :], np.abs(scores[last + 1 :]), rtol=1e-9)
    else:
        # What hardly declines is taken to do so all the same.
        assert (spread[last + 1 :] < np.abs(scores[last + 1 :])).all()


def test_nothing_clear_goes_on_nowhere() -> None:
    for scores in ([50.0, 1.0, -2.0, 3.9], [0.0, 0.0, 0.0, 0.0]):
        np.testing.assert_array_equal(unseen.prior(np.array(scores)), 0)
        derivatives = np.ones((1, 3, 4))
        found = unseen.squared_bias(np.array([scores]), np.array([[1.0, 1.0, 0.0, 0.0]]), derivatives)
        np.testing.assert_array_equal(found, 0)


@pytest.mark.parametrize("top", [5.5, 8.0, 30.0])
def test_expected_squares_are_right_on_average(top: float) -> None:
    # Signals as the prior has them: half of them end, half go on. Whatever of them counts in the estimate, the mean
    # of the squares that are expected is that of the true ones.
    rng = np.random.default_rng(round(top))
    seen = top * np.array([40.0, 16.0, 4.0, 1.0])
    spread = unseen.prior(np.r_[seen, np.zeros(4)])[4:]
    shares = np.array([1.0, 1.0, 0.99, 0.8, 0.4, 0.0, 0.0, 0.0])
    derivatives = rng.standard_normal((1, 5, 8)) * np.arange(8) ** 2
    runs = 4000
    hidden = spread * rng.standard_normal((runs, 4)) * (np.arange(runs) % 2)[:, None]
    scores = np.concatenate([np.tile(seen, (runs, 1)), hidden + rng.standard_normal((runs, 4))], axis=1)
    # Where chance makes a hidden one clear, the prior is another.
    kept = (np.abs(scores[:, 4:]) < unseen.CLEAR).all(axis=1)
    truth = np.square(((1 - shares) * np.concatenate([scores[:, :4], hidden], axis=1)) @ derivatives[0].T)
    found = unseen.squared_bias(scores, np.tile(shares, (runs, 1)), derivatives)[0]
    difference = (found - truth)[kept]
    bound = 5 * difference.std(axis=0) / math.sqrt(kept.sum())
    # Leaving those out shifts the mean by no more than their share of it.
    bound += (~kept).mean() * truth.mean(axis=0)
    assert kept.mean() > 0.5
    assert (np.abs(difference.mean(axis=0)) < bound).all()


def test_rows_are_judged_alone() -> None:
    rng = np.random.default_rng(3)
    scores = np.stack([100 * 0.3 ** np.arange(7), np.zeros(7), [9.0, 0, 8, 0, 7, 0, 6]]) + rng.standard_normal((3, 7))
    shares = np.tile([1.0, 1, 1, 0.5, 0.5, 0, 0], (3, 1))
    derivatives = rng.standard_normal((2, 4, 7))
    together = unseen.squared_bias(scores, shares, derivatives)
    assert together.shape == (2, 3, 4)
    assert (together >= 0).all()
    for row in range(3):
        alone = unseen.squared_bias(scores[row : row + 1], shares[:1], derivatives)
        np.testing.assert_allclose(together[:, row], alone[:, 0], rtol=1e-12)


def said_over_true(x: Array, truth: Array, deriv: int, delta: float, level: float) -> float:
    """Return the root mean square of the error that is said over that of the true one, over realisations of noise."""
    said, true = [], []
    for seed in range(12):
        y = x + level * x.std() * np.random.default_rng(seed).standard_normal(x.size)
        suggestion = algdiff.suggest(y, deriv, delta=delta)
        said.append(suggestion.rmse**2)
        true.append(float(np.square(suggestion(y) - truth).mean()))
    return math.sqrt(np.mean(said) / np.mean(true))


@pytest.mark.parametrize(("count", "level"), [(500, 0.01), (2000, 0.001), (2000, 0.01)])
def test_honest_where_the_acceleration_jumps(count: int, level: float) -> None:
    t = np.linspace(0, 4, count)
    x, truth = np.zeros(count), np.zeros(count)
    for at, size in [(0.5, 2.0), (1.1, -2.0), (1.7, -1.0), (2.6, 1.5), (3.3, -0.5)]:
        x += size * np.maximum(t - at, 0) ** 2 / 2
        truth += size * (t >= at)
    assert 1 / 1.5 < said_over_true(x, truth, 2, float(t[1]), level) < 1.5


@pytest.mark.parametrize(("deriv", "count", "factor"), [(1, 500, 1.5), (1, 2000, 1.5), (2, 2000, 2.0)])
def test_honest_where_the_start_is_fast(deriv: int, count: int, factor: float) -> None:
    t = np.linspace(0, 5, count)
    x = np.exp(-t) + 0.5 * np.exp(-5 * t)
    truth = (-1) ** deriv * (np.exp(-t) + 0.5 * 5**deriv * np.exp(-5 * t))
    # Nearly all of the error is there; that which noise hides of a second derivative is not known well.
    assert 1 / factor < said_over_true(x, truth, deriv, float(t[1]), 0.01) < factor
