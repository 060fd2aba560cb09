"""Laws that hold for every design, on seeded data."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import algdiff
from support import EPS, design, difference_bound, sum_bound

DESIGNS: list[tuple[int, int, dict[str, Any]]] = [
    (5, 1, {}),
    (20, 1, {"kappa": 0, "mu": 0}),
    (21, 2, {"degree": 5, "tau": "root"}),
    (33, 0, {"degree": 3, "kappa": 2.5, "mu": 0.5, "tau": 0.3}),
    (40, 3, {"kappa": -0.5, "mu": 1, "tau": "newest"}),
    (64, 4, {"kappa": 10, "mu": 10}),
]
IDS = [f"L{length}-n{deriv}" for length, deriv, _ in DESIGNS]


def signal(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize(("length", "deriv", "options"), DESIGNS, ids=IDS)
def test_linearity(length: int, deriv: int, options: dict[str, Any]) -> None:
    d = algdiff.Differentiator(length, deriv, **options)
    x, y = signal(300), signal(300, 1)
    bound = 8 * (sum_bound(ends(d), x) + sum_bound(ends(d), y))
    np.testing.assert_allclose(d(2 * x - 3 * y), 2 * d(x) - 3 * d(y), rtol=0, atol=bound)
    np.testing.assert_array_equal(d(4 * x), 4 * d(x))
    np.testing.assert_array_equal(d(-x), -d(x))


@pytest.mark.parametrize(("length", "deriv", "options"), DESIGNS, ids=IDS)
def test_reflection_exchanges_kappa_and_mu(length: int, deriv: int, options: dict[str, Any]) -> None:
    d = algdiff.Differentiator(length, deriv, **options)
    mirrored = algdiff.Differentiator(length, deriv, degree=d.degree, kappa=d.mu, mu=d.kappa, tau=1 - d.tau)
    atol = 1e-12 * np.abs(d.weights).max()
    np.testing.assert_allclose(mirrored.weights, (-1) ** deriv * d.weights[::-1], rtol=0, atol=atol)
    x = signal(300)
    expected = (-1) ** deriv * d(x[::-1], mode="valid")[::-1]
    np.testing.assert_allclose(mirrored(x, mode="valid"), expected, rtol=0, atol=1e-12 * np.abs(d.weights).sum() * 10)


@pytest.mark.parametrize(("length", "deriv", "options"), DESIGNS, ids=IDS)
def test_shift(length: int, deriv: int, options: dict[str, Any]) -> None:
    d = algdiff.Differentiator(length, deriv, **options)
    x = signal(400)
    np.testing.assert_array_equal(d(x, mode="valid")[17:], d(x[17:], mode="valid"))


@pytest.mark.parametrize(("length", "deriv", "options"), DESIGNS, ids=IDS)
def test_scale(length: int, deriv: int, options: dict[str, Any]) -> None:
    d = algdiff.Differentiator(length, deriv, **options)
    x = signal(200)
    # Powers of two scale without rounding.
    np.testing.assert_array_equal(d.replace(delta=0.25)(x), d(x) * 4**deriv)
    atol = 10**deriv * difference_bound(ends(d), x) if deriv else sum_bound(ends(d), x)
    np.testing.assert_allclose(d.replace(delta=0.1)(x), d(x) * 10**deriv, rtol=0, atol=atol)
    assert d.replace(delta=0.25).delay == d.delay / 4


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize(("length", "deriv", "options"), DESIGNS, ids=IDS)
def test_any_chunking_with_halo_gives_the_same_bits(
    length: int, deriv: int, options: dict[str, Any], dtype: Any
) -> None:
    rng = np.random.default_rng(length)
    d = algdiff.Differentiator(length, deriv, **options)
    x = rng.standard_normal(9000).astype(dtype) + dtype(100)
    whole = d(x, mode="valid")
    interior = d(x)
    for _ in range(40):
        cuts = np.unique(rng.integers(0, len(whole) + 1, rng.integers(1, 30)))
        edges = [0, *cuts, len(whole)]
        pieces = [
            d(x[start : stop + length - 1], mode="valid", threads=int(rng.integers(1, 4)))
            for start, stop in pairwise(edges)
            if stop > start
        ]
        assert np.concatenate(pieces).tobytes() == whole.tobytes()
        # Full-length chunks agree with the whole wherever their window lies inside the chunk.
        start = int(rng.integers(0, 4000))
        chunk = d(x[start : start + 3 * length])
        assert chunk[length:-length].tobytes() == interior[start + length : start + 2 * length].tobytes()


@pytest.mark.parametrize("tau", ["center", "root", "newest", 0.0, 0.3, 1.2])
@pytest.mark.parametrize("length", [4, 5, 6, 9, 20, 31])
def test_polynomials_come_back_at_every_sample(length: int, tau: float | str) -> None:
    t = np.arange(64) - 20.0
    for deriv in range(3):
        for degree in range(deriv, min(5, length - 1)):
            for kappa, mu in [(0.0, 0.0), (1.0, 1.0), (2.0, 0.0)]:
                d = design(length, deriv, degree=degree, kappa=kappa, mu=mu, tau=tau)
                for m in range(degree + 1):
                    polynomial = np.polynomial.Polynomial.basis(m)
                    x = polynomial(t)
                    bound = 64 * sum_bound(ends(d), x)
                    expected = polynomial.deriv(deriv)(t) if deriv else x
                    np.testing.assert_allclose(d(x), expected, rtol=0, atol=bound, err_msg=f"{d} {m}")
                # One degree more does not come back, unless its coefficient happens to lie on a root everywhere.
                over = np.polynomial.Polynomial.basis(degree + 1)
                assert np.abs(d(over(t)) - over.deriv(deriv)(t)).max() > 1e-3


@pytest.mark.parametrize("length", [20, 21])
def test_valid_estimates_at_tau_itself(length: int) -> None:
    t = np.arange(60.0)
    for tau in ["center", "root", "newest", 0.3]:
        d = algdiff.Differentiator(length, degree=3, tau=tau)
        times = t[length - 1 :] - d.delay_samples
        np.testing.assert_allclose(d(t**3, mode="valid"), 3 * times**2, rtol=0, atol=1e-8)
        np.testing.assert_allclose(
            d(t**3, mode="valid"), [d.weights @ t[i : i + length] ** 3 for i in range(61 - length)], rtol=0, atol=1e-8
        )


def test_interior_of_full_length_modes_is_the_valid_result_where_tau_is_a_sample() -> None:
    x = signal(200)
    for length, tau in [(21, "center"), (20, "newest"), (20, 4.5 / 20)]:
        d = algdiff.Differentiator(length, tau=tau)
        first = length - 1 - int(d.delay_samples)
        valid = d(x, mode="valid")
        for mode in ["fit", "nan", "nearest", "mirror", "wrap", "constant"]:
            assert d(x, mode=mode)[first : first + len(valid)].tobytes() == valid.tobytes()


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.complex128])
@pytest.mark.parametrize("value", [0.0, 1.0, -1e9, 0.1, 3e37])
def test_a_constant_differentiates_to_exactly_zero(value: float, dtype: Any) -> None:
    x = np.full(500, value, dtype)
    for length, deriv, options in DESIGNS:
        if deriv:
            d = algdiff.Differentiator(length, deriv, **options)
            for mode in ["fit", "valid", "nearest", "mirror", "wrap"]:
                assert not d(x, mode=mode).any()


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.complex64])
@pytest.mark.parametrize("length", [1, 2, 11, 100, 5001])
def test_a_constant_stays_itself_when_smoothed(length: int, dtype: Any) -> None:
    x = np.full(6000, 1.1, dtype)
    d = algdiff.Differentiator(length, 0, degree=min(2, length - 1))
    for mode in ["valid", "nearest", "mirror", "wrap"]:
        np.testing.assert_array_equal(d(x, mode=mode), x[: len(d(x, mode=mode))])
    np.testing.assert_allclose(d(x), x, rtol=2 * float(np.finfo(dtype).eps), atol=0)


@pytest.mark.parametrize("length", [6, 20, 21, 60])
def test_a_root_keeps_its_degree_in_the_interior_of_every_mode(length: int) -> None:
    t = np.arange(200.0) - 100
    for tau in ["root", "center"]:
        d = algdiff.Differentiator(length, degree=3, tau=tau)
        polynomial = np.polynomial.Polynomial.basis(d.exactness)
        x = polynomial(t)
        bound = 64 * sum_bound(d.weights, x[100 - length : 100 + length])
        for mode in ["fit", "nan", "wrap"]:
            got = d(x, mode=mode)[100 - length // 2 : 100 + length // 2]
            expected = polynomial.deriv()(t)[100 - length // 2 : 100 + length // 2]
            np.testing.assert_allclose(got, expected, rtol=0, atol=bound)


@pytest.mark.parametrize(("length", "deriv", "options"), DESIGNS, ids=IDS)
def test_an_offset_costs_no_more_than_the_rounding_of_the_data(
    length: int, deriv: int, options: dict[str, Any]
) -> None:
    d = algdiff.Differentiator(length, deriv, **options)
    x = signal(400)
    shifted = x + 1e9
    rounded = shifted - 1e9  # exact: what is left of x after it was stored with its offset
    expected = d(rounded) + (1e9 if deriv == 0 else 0.0)
    atol = difference_bound(ends(d), x) if deriv else 1e9 * 8 * EPS * length
    np.testing.assert_allclose(d(shifted), expected, rtol=0, atol=atol)
    whole = np.round(x * 1000) + 2.0**40
    if deriv:
        # Integers lose nothing to the offset, and neither does their derivative.
        np.testing.assert_array_equal(d(whole), d(np.round(x * 1000)))


def test_threads_change_no_bit() -> None:
    rng = np.random.default_rng(3)
    for shape, axis in [((300_000,), 0), ((40, 9001), 1), ((9001, 40), 0), ((3000, 20), -1), ((7, 3000, 9), 1)]:
        x = rng.standard_normal(shape)
        d = algdiff.Differentiator(101, tau="root")
        for mode in ["fit", "valid", "wrap"]:
            if mode == "valid" and x.shape[axis] < 101:
                continue
            one = algdiff.differentiate(x, 19, axis=axis, mode=mode, threads=1)
            for threads in [2, 3, 8]:
                many = algdiff.differentiate(x, 19, axis=axis, mode=mode, threads=threads)
                assert many.tobytes() == one.tobytes()
        if x.shape[axis] > 101:
            assert d(x, axis, threads=5).tobytes() == d(x, axis, threads=1).tobytes()


def ends(d: algdiff.Differentiator) -> np.ndarray:
    """Return the weights of the sample, up to where `tau` lies, at which they amplify rounding most."""
    reach = [0.5, d.window_length - 0.5, d.tau * d.window_length]
    options: dict[str, Any] = {"degree": d.degree, "kappa": d.kappa, "mu": d.mu}
    candidates = [design(d.window_length, d.deriv, tau=place / d.window_length, **options) for place in reach]
    return max((c.weights for c in candidates), key=lambda w: float(np.abs(w).sum()))
