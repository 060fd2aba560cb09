"""The parts of a choice, against plain NumPy: candidates, distances, selection, rows."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

import algdiff
from algdiff._suggest import rows as rows_of
from algdiff._suggest.candidates import CROWDED, LARGEST, RATIO, Family, even_degrees, family, windows
from algdiff._suggest.distances import PLACES, distances
from algdiff._suggest.selection import NEIGHBOURS, quantile, select

Array = npt.NDArray[np.float64]


def few(deriv: int = 1, most: int = 61, correlation: float = 0.0) -> Family:
    lengths = tuple((degree, tuple(windows(3, most))) for degree in even_degrees(deriv)[:3])
    return family(deriv, lengths, 1.0, 1.0, correlation)


def padded(members: Family) -> Array:
    """Return the weights of all members about a common center."""
    half = int(members.half.max())
    return np.array([np.pad(one.weights, half - one.window_length // 2) for one in members.designs])


@pytest.mark.parametrize("bounds", [(3, 740), (1, 50), (20, 333), (100, 100), (7, 8), (9, 3)])
def test_windows(bounds: tuple[int, int]) -> None:
    least, most = bounds
    found = windows(least, most)
    everything = windows(3, LARGEST)
    assert all(least <= window <= most and window % 2 for window in found)
    assert found == sorted(set(found))
    assert all(window in everything for window in found[:-1])
    if len(found) > 1:
        assert found[-1] in (most, most - 1)
    for before, after in pairwise(found):
        # Rounding to an odd number moves either by at most 1.
        assert after <= max(before + 2, RATIO * (before + 1) + 1)


@pytest.mark.parametrize("deriv", [0, 1, 2, 3])
def test_degrees(deriv: int) -> None:
    degrees = even_degrees(deriv)
    assert degrees[0] in (deriv, deriv + 1)
    assert all(degree % 2 == 0 for degree in degrees)
    assert list(np.diff(degrees)) == [2, 2, 2]


@pytest.mark.parametrize("deriv", [0, 1, 2, 3])
def test_a_family_is_sorted_and_not_crowded(deriv: int) -> None:
    members = few(deriv)
    order = list(zip(members.window.tolist(), members.degree.tolist(), strict=True))
    assert order == sorted(order)
    assert order == [(one.window_length, one.degree) for one in members.designs]
    assert np.array_equal(members.half, (members.window - 1) // 2)
    assert (members.degree < members.window).all()
    assert (members.degree <= CROWDED * np.sqrt(members.window)).all()
    assert all(one.delta == 1.0 and one.delay_samples == one.window_length // 2 for one in members.designs)


@pytest.mark.parametrize("deriv", [0, 1, 2])
@pytest.mark.parametrize("correlation", [0.0, 0.6, -0.3])
def test_what_noise_does_to_a_family(deriv: int, correlation: float) -> None:
    members = few(deriv, correlation=correlation)
    weights = padded(members)
    lags = np.arange(weights.shape[1])
    covariance = np.array([[correlation ** abs(int(j - k)) for k in lags] for j in lags])
    for k, one in enumerate(weights):
        gain = one @ covariance @ one
        assert abs(members.gain[k] - gain) <= 1e-12 * gain
        for j, other in enumerate(weights[:k]):
            apart = (one - other) @ covariance @ (one - other)
            # Products of both gains cancel, each with the rounding of its own size.
            bound = 1e-12 * (members.gain[k] + members.gain[j])
            assert abs(members.difference[k, j] - apart) <= bound
            assert members.difference[j, k] == pytest.approx(members.difference[k, j], abs=bound)


@pytest.mark.parametrize("deriv", [0, 1, 2])
def test_memory_is_the_sum_of_squared_correlations(deriv: int) -> None:
    members = few(deriv, 41)
    weights = padded(members)
    for k, one in enumerate(weights):
        for j in np.flatnonzero(members.difference[k, :k] > 1e-20):
            other = weights[j]
            covariance = np.correlate(one - other, one - other, "full")
            correlation = covariance / covariance.max()
            assert members.memory[k, j] == pytest.approx(float(np.square(correlation).sum()), rel=1e-9)
            assert members.memory[j, k] == members.memory[k, j]
    assert (members.memory >= 1 - 1e-12).all()


def test_nothing_fits() -> None:
    with pytest.raises(ValueError, match="none that holds a fit of degree 8"):
        family(1, ((8, (3, 5, 7)),), 1.0, 1.0)


@pytest.mark.parametrize("shape", [(1, 90), (3, 70), (2, 1500)])
def test_distances_by_loops(shape: tuple[int, int]) -> None:
    rows = np.random.default_rng(0).standard_normal(shape)
    members = few(1, 31)
    found, freedom = distances(rows, members)
    stride = max(1, rows.size // PLACES)
    places = range((shape[1] - 1) // 2 % stride, shape[1], stride)
    for c in range(len(members.designs)):
        for b in range(c):
            squares = []
            half = int(max(members.half[c], members.half[b]))
            for row in rows:
                for place in places:
                    if half <= place < shape[1] - half:
                        one, other = (
                            members.designs[k].weights @ row[place - members.half[k] : place + members.half[k] + 1]
                            for k in (c, b)
                        )
                        squares.append((one - other) ** 2)
            # The difference of squares of estimates of this size, which cancel.
            bound = 1e-12 * (members.gain[c] + members.gain[b]) * 30
            assert abs(found[c, b] - np.mean(squares)) <= bound
            assert abs(found[b, c] - found[c, b]) <= bound
            assert 1 <= freedom[c, b] <= len(squares)


def test_freedom_says_how_distances_scatter() -> None:
    rng = np.random.default_rng(1)
    members = few(1, 31)
    found, freedom = [], np.ones(0)
    for _ in range(200):
        one, freedom = distances(rng.standard_normal((1, 800)), members)
        found.append(one)
    upper = np.triu_indices(len(members.designs), 1)
    mean, spread = np.mean(found, axis=0)[upper], np.var(found, axis=0)[upper]
    # Of chi-squared over its mean the variance is 2 / freedom, found here with an error of sqrt(2 / 200), 10 percent:
    # more where neighbours correlate, so 5 standard errors. Its own is lower yet, as it allows for the level too.
    seen = 2 * mean**2 / spread
    # Every second place is compared: a count of its own.
    full = 800 - 2 * np.maximum(members.half, members.half[:, None])
    independent = 1.0 / (2.0 / full + members.memory / full)
    np.testing.assert_allclose(independent[upper], seen, rtol=0.6)
    assert (freedom[upper] <= 1.5 * seen).all()
    assert (freedom[upper] >= seen / 1.5 / (1 + 6 / members.memory[upper])).all()
    # And the mean is what unit noise makes of differences.
    error = 4 * np.sqrt(2 / (200 * seen))
    assert (np.abs(mean / members.difference[upper] - 1) < error).all()


@pytest.mark.parametrize("deviations", [1.0, 2.0, 3.0, 4.0, 4.5])
def test_quantile_is_that_of_chi_squared(deviations: float) -> None:
    freedom = np.array([1.0, 2.0, 3.0, 5.0, 12.0, 30.0, 100.0, 1e4, 1e6])
    exact = stats.chi2.isf(stats.norm.sf(deviations), freedom) / freedom
    found = quantile(freedom, deviations)
    many = freedom > 10
    np.testing.assert_allclose(found[many], exact[many], rtol=0.02)
    # Of few the far tail comes out too long, which is the safe side.
    assert (found > 0.98 * exact).all()
    assert (found < 1.14 * exact).all()


@pytest.mark.parametrize("sigma", [1e-3, 1e-2, 0.1])
@pytest.mark.parametrize("period", [40.0, 100.0, 250.0])
def test_selection_of_known_biases(sigma: float, period: float) -> None:
    members = few(1, 201)
    rate = 2 * np.pi / period
    # What the designs make of a sine is a cosine of another size, and its mean square is half that of the size.
    sizes = np.array(
        [
            one.weights @ np.sin(rate * np.arange(-h, h + 1))
            for one, h in zip(members.designs, members.half, strict=True)
        ]
    )
    bias = (sizes - rate) / math.sqrt(2)
    apart = sigma**2 * members.difference + (bias[:, None] - bias) ** 2
    risk = select(apart, np.full(apart.shape, 1e12), members, np.full(bias.size, sigma))
    true = bias**2 + sigma**2 * members.gain
    # Differences of biases stand for biases: finer references have some of their own.
    assert true[risk.best] <= 1.1 * true.min()
    np.testing.assert_allclose(risk.variance, sigma**2 * members.gain)
    for degree in np.unique(members.degree):
        assert (np.diff(risk.bias2[members.degree == degree]) >= 0).all()


def test_selection_without_bias_takes_the_least_noise() -> None:
    members = few(1, 201)
    risk = select(members.difference, np.full(members.difference.shape, 50.0), members, np.ones(members.gain.size))
    assert not risk.bias2.any()
    assert risk.best == int(np.argmin(members.gain))
    # Distances that chance explains do not count, but for the neighbours, of which the finest is this much worse.
    lucky = select(1.5 * members.difference, np.full(members.difference.shape, 20.0), members, np.ones(risk.bias2.size))
    assert not lucky.bias2.any()
    assert members.gain[lucky.best] <= NEIGHBOURS * members.gain.min()


def test_selection_among_some() -> None:
    members = few(1, 201)
    allowed = members.window < 50
    risk = select(
        members.difference, np.full(members.difference.shape, 50.0), members, np.ones(members.gain.size), allowed
    )
    assert allowed[risk.best]
    none = np.zeros(members.gain.size, bool)
    risk = select(members.difference, np.full(members.difference.shape, 50.0), members, np.ones(none.size), none)
    assert risk.best == int(np.argmin(members.gain))


def test_rows_of_arrays() -> None:
    x = np.arange(24.0).reshape(2, 3, 4)
    for axis in range(3):
        expected = np.moveaxis(x, axis, -1).reshape(-1, x.shape[axis])
        np.testing.assert_array_equal(rows_of.finite_rows(x, axis), expected)
    many = np.arange(100.0)[:, None] + np.zeros(9)
    picked = rows_of.finite_rows(many, 1)
    assert picked.shape == (rows_of.CHANNELS, 9)
    assert picked[0, 0] == 0
    assert picked[-1, 0] == 99
    z = np.exp(1j * np.arange(9.0))
    np.testing.assert_array_equal(rows_of.finite_rows(z, 0), [z.real, z.imag])
    assert rows_of.finite_rows(np.arange(9, dtype=np.int16), 0).dtype == np.float64


def test_rows_without_gaps() -> None:
    x: Any = np.arange(20.0)
    x[[3, 12]] = np.nan, np.inf
    np.testing.assert_array_equal(rows_of.finite_rows(x, 0), [np.arange(4.0, 12)])
    two = np.stack([x, np.arange(20.0)])
    two[1, 8] = np.nan
    np.testing.assert_array_equal(rows_of.finite_rows(two, 1), [np.arange(13.0, 20)] * 2)
    with pytest.raises(ValueError, match="x must hold samples that are finite, got none"):
        rows_of.finite_rows(np.full(5, np.nan), 0)


def test_rows_without_a_sample_have_no_say() -> None:
    x = np.sin(np.arange(200) / 10) + 0.1 * np.random.default_rng(3).standard_normal((2, 200))
    some = np.stack([x[0], np.full(200, np.nan), x[1], np.full(200, np.inf)])
    assert algdiff.suggest(some).differentiator == algdiff.suggest(x).differentiator
    estimates = algdiff.differentiate(some)
    # The ends of all rows are fitted together: rows may round otherwise.
    np.testing.assert_allclose(estimates[[0, 2]], algdiff.differentiate(x), rtol=0, atol=1e-13)
    assert np.isnan(estimates[1]).all()


@pytest.mark.parametrize("shape", [(1, 100), (1, 1_000_000), (3, 40_000), (16, 2048), (16, 2049), (32, 5000)])
def test_blocks(shape: tuple[int, int]) -> None:
    rows = np.arange(math.prod(shape), dtype=float).reshape(shape)
    found = rows_of.blocks(rows)
    most = rows_of.BLOCKS * rows_of.BLOCK
    if rows.size <= most:
        assert found is rows
        return
    # Every row is looked at, from its first block on, and the last block ends with it if there are two.
    assert found.size <= max(most, shape[0] * rows_of.BLOCK)
    assert found.shape[1] == min(shape[1], max(rows_of.BLOCK, most // shape[0]))
    assert set((found[:, 0] // shape[1]).astype(int)) == set(range(shape[0]))
    assert (np.diff(found, axis=1) == 1).all()
    assert found[0, 0] == 0
    if len(found) > shape[0]:
        assert found[-1, -1] == rows[-1, -1]


def test_averages() -> None:
    rows = np.random.default_rng(2).standard_normal((2, 14))
    found = rows_of.averaged(rows, 3)
    assert found.shape == (2, 4)
    for k in range(4):
        np.testing.assert_allclose(found[:, k], (rows[:, 3 * k] + rows[:, 3 * k + 1] + rows[:, 3 * k + 2]) / 3)
