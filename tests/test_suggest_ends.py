"""The ends of a recording and the level of its noise, the parts of a choice that are estimates themselves."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from algdiff._suggest import edges, noise
from algdiff._suggest.candidates import even_degrees, family, windows
from algdiff._suggest.distances import distances

Array = npt.NDArray[np.float64]
LENGTH, WINDOW = 300, 101


def start(rows: Array, degree: int, orders: tuple[int, ...], sigma: float, length: int = LENGTH) -> edges.Edge:
    return edges.start(rows, length, WINDOW, degree, 1.0, orders, np.full(len(rows), sigma))


def ar1(seed: int, correlation: float, count: int = 4000) -> Array:
    """Return autoregressive noise of level 1 in a row."""
    steps = np.random.default_rng(seed).standard_normal(count)
    found = np.empty(count)
    found[0] = steps[0]
    for k in range(1, count):
        found[k] = correlation * found[k - 1] + math.sqrt(1 - correlation**2) * steps[k]
    return found[None]


@pytest.mark.parametrize("size", [9, 51, 400])
@pytest.mark.parametrize("degree", [0, 3, 7])
def test_the_basis(size: int, degree: int) -> None:
    found = edges.basis(size, degree, (0, 1, 2), size // 2)
    np.testing.assert_allclose(found.values.T @ found.values, np.eye(degree + 1), atol=1e-12)
    np.testing.assert_allclose(found.derivatives[0], found.values[: size // 2], atol=1e-12)
    # Each is a polynomial of its degree: fitted by one of that degree, it leaves nothing.
    points = np.arange(size)
    for k in range(degree + 1):
        one = np.polynomial.Polynomial.fit(points, found.values[:, k], k)
        np.testing.assert_allclose(one(points), found.values[:, k], atol=1e-10)
        for order in (1, 2):
            slope = one.deriv(order)(points[: size // 2])
            scale = max(float(np.abs(slope).max()), 1e-6)
            np.testing.assert_allclose(found.derivatives[order, :, k], slope, rtol=0, atol=1e-8 * scale)


@pytest.mark.parametrize("deriv", [0, 1, 2, 3])
@pytest.mark.parametrize("sigma", [0.0, 1e-3, 0.1, 10.0])
def test_polynomials_of_the_order(deriv: int, sigma: float) -> None:
    rng = np.random.default_rng(deriv)
    places = np.arange(LENGTH)
    polynomials = [np.polynomial.Polynomial(rng.standard_normal(deriv + 1), domain=[0, LENGTH - 1]) for _ in range(4)]
    rows = np.array([one(places) for one in polynomials])
    for degree in even_degrees(deriv):
        found = start(rows, degree, (deriv,), sigma)
        assert found.estimate.shape == found.std.shape == found.bias2.shape == (1, 4, edges.reach(WINDOW))
        truth = np.array([one.deriv(deriv)(places) if deriv else one(places) for one in polynomials])
        scale = float(np.abs(truth).max())
        np.testing.assert_allclose(found.estimate[0], truth[:, : edges.reach(WINDOW)], rtol=0, atol=1e-6 * scale)


@pytest.mark.parametrize("degree", [4, 6])
def test_what_the_samples_show_clearly_is_kept(degree: int) -> None:
    # Coefficients are 1e5 times the noise: shares are one but for 1e-9.
    rng = np.random.default_rng(degree)
    polynomial = np.polynomial.Legendre(1e4 * rng.uniform(1, 2, degree + 1), domain=[0, WINDOW])
    rows = polynomial(np.arange(LENGTH))[None]
    for orders in ((0,), (1,), (2,), (0, 1, 2)):
        found = start(rows, degree, orders, 0.1)
        for order, one in zip(orders, found.estimate, strict=True):
            truth = (polynomial.deriv(order) if order else polynomial)(np.arange(one.shape[1]))
            np.testing.assert_allclose(one[0], truth, rtol=0, atol=1e-6 * float(np.abs(truth).max()))


@pytest.mark.parametrize("deriv", [0, 1, 2])
@pytest.mark.parametrize("degree", [4, 6])
def test_the_standard_deviation(deriv: int, degree: int) -> None:
    # All coefficients up to the highest are so strong that their shares are one, whatever the noise is.
    rng = np.random.default_rng(10 + degree)
    polynomial = np.polynomial.Legendre(1e4 * rng.uniform(1, 2, degree + 2), domain=[0, WINDOW])
    places = np.arange(LENGTH)
    rows = polynomial(places) + 0.1 * rng.standard_normal((1500, LENGTH))
    found = start(rows, degree, (deriv,), 0.1)
    inner = slice(0, WINDOW // 2)
    truth = (polynomial.deriv(deriv) if deriv else polynomial)(places)[inner]
    error = found.estimate[0, :, inner] - truth
    seen, said = error.std(axis=0), found.std[0, :, inner].mean(axis=0)
    # The mean of three estimates that are alike, of which it is the mean of the deviations, and so never less; that
    # they are alike brings it within a third. The deviation of 1500 is known to 1.8 percent; four of them.
    assert (seen <= 1.075 * said).all()
    assert (seen >= 0.67 * said).all()
    # And no estimate is biased.
    assert (np.abs(error.mean(axis=0)) <= 5 * seen / math.sqrt(1500)).all()
    assert found.bias2[0, :, inner].max() <= 0.01 * float(np.square(said).max())


def test_noise_alone_is_shrunk() -> None:
    rows = np.random.default_rng(20).standard_normal((400, LENGTH))
    found = start(rows, 6, (1,), 1.0)
    full = edges.basis(WINDOW, 7, (1,), 1)
    # By a fit of all degrees the noise at the end would be this; what is kept are the first two, and some by chance.
    assert found.estimate[0, :, 0].std() < 0.5 * float(np.sqrt(np.square(full.derivatives[0, 0]).sum()))


def test_what_windows_do_not_explain_gets_shorter_ones() -> None:
    k = np.arange(LENGTH)
    rows = np.sin(k / 3.0)[None] + 1e-3 * np.random.default_rng(21).standard_normal((1, LENGTH))
    found = start(rows, 4, (1,), 1e-3)
    truth = np.cos(k / 3.0) / 3
    # 101 samples are five periods, of which no polynomial of degree 5 has any: zero would err by a quarter.
    error = found.estimate[0, 0] - truth[: found.estimate.shape[2]]
    assert np.sqrt(np.mean(error**2)) < 0.8 * np.sqrt(np.mean(truth**2))


@pytest.mark.parametrize("degree", [0, 2, 5])
def test_rows_that_are_one_polynomial(degree: int) -> None:
    rng = np.random.default_rng(degree)
    rows = np.polynomial.Polynomial(rng.standard_normal(degree + 1), domain=[0, 200])(np.arange(200))[None]
    noisy = [rows + 0.1 * rng.standard_normal(rows.shape) for _ in range(100)]
    assert edges.is_polynomial(rows, degree, 1e-6)
    # Beyond four standard deviations is three in 100,000.
    assert all(edges.is_polynomial(one, degree, 0.1) for one in noisy)
    more = rows + np.polynomial.Legendre.basis(degree + 1, domain=[0, 199])(np.arange(200))
    assert not edges.is_polynomial(more, degree, 0.1)
    assert not edges.is_polynomial(more, degree, 1e-6)


@pytest.mark.parametrize("count", [60, 1000, 30_000])
def test_the_first_guess(count: int) -> None:
    rng = np.random.default_rng(count)
    error = math.sqrt(2.1 / count)
    for _ in range(20):
        rows = 0.3 * rng.standard_normal((1, count)) + np.linspace(-3, 7, count)
        # It is as much higher as it may be too low: three standard errors, give or take four of the least certain.
        assert -error < noise.first_guess(rows) / 0.3 - 1 < 7 * error
    assert noise.first_guess(np.zeros((1, count))) == 0
    few = rng.standard_normal((1, 10))
    assert noise.first_guess(few) == pytest.approx(float(np.std(np.diff(few))) / math.sqrt(2))


@pytest.mark.parametrize(("window", "degree"), [(11, 2), (31, 4), (101, 6)])
@pytest.mark.parametrize("count", [400, 10_000])
def test_residuals(window: int, degree: int, count: int) -> None:
    rng = np.random.default_rng(window)
    error = math.sqrt(0.5 / (count - window + 1))
    for _ in range(10):
        rows = 0.3 * rng.standard_normal((1, count)) + np.linspace(-3, 7, count)
        left = noise.residuals(rows, window, degree, 1.0, 1.0)
        assert left is not None
        # Residuals are nearly independent: their correlation makes the error larger, by a half if they are short.
        assert abs(left.level(0.0) / 0.3 - 1) < 4 * 1.5 * error
        assert left.correlation() == 0
        assert left.values.shape == (1, count - window + 1)
        assert left.weights.sum() == pytest.approx(0, abs=1e-12)
    assert noise.residuals(rows[:, : window + 5], window, degree, 1.0, 1.0) is None


@pytest.mark.parametrize("correlation", [-0.5, 0.3, 0.8])
def test_the_correlation_of_residuals(correlation: float) -> None:
    for seed in range(5):
        left = noise.residuals(ar1(seed, correlation), 101, 2, 1.0, 1.0)
        assert left is not None
        # One standard error is sqrt((1 - rho^2) / n), 1.6 percent or less; the smoother of 101 takes part of it.
        assert left.correlation() == pytest.approx(correlation, abs=0.1)


def test_the_level_of_windows() -> None:
    lengths = tuple((degree, tuple(windows(3, 151))) for degree in (2, 4))
    members = family(1, lengths, 1.0, 1.0)
    rng = np.random.default_rng(30)
    for _ in range(5):
        apart = distances(rng.standard_normal((1, 3000)), members)
        # Chance does not make white noise coloured.
        np.testing.assert_array_equal(noise.coloured(*apart, members, 1.05, 1.0), 1.05)
    walk = np.cumsum(rng.standard_normal((1, 3000)), axis=1)
    levels = noise.coloured(*distances(walk, members), members, 0.5, 1.0)
    assert (levels >= 0.5).all()
    for degree in (2, 4):
        chain = members.degree == degree
        rise = levels[chain][1:] / levels[chain][:-1]
        assert (rise**2 <= (members.window[chain][1:] / members.window[chain][:-1]) * (1 + 1e-12)).all()
        assert levels[chain][-1] > 1.5 * 0.5


def test_quantum() -> None:
    rng = np.random.default_rng(40)
    steps = rng.integers(-3, 4, 500)
    for unit in (1.0, 0.25, 2 * np.pi / 40_000, 1e-9, 1e9):
        assert noise.quantum(unit * np.cumsum(steps)[None]) == pytest.approx(unit, rel=1e-6)
    assert noise.quantum(rng.standard_normal((1, 500))) == 0
    assert noise.quantum(np.zeros((1, 500))) == 0
    assert noise.quantum(np.arange(10.0)[None]) == 0
    # Integers that are far apart show no step: any numbers rounded to so many digits would.
    assert noise.quantum(rng.integers(-100, 100, (1, 5000)).astype(float)) == 0
    assert noise.quantum(np.where(rng.random(500) < 0.05, 0.5, 0.0)[None] + np.arange(500) % 2) == pytest.approx(0.5)
