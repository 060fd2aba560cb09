"""Angles, whose turns are counted, and complex samples, which are two real signals with gaps in common."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import Differentiator, differentiate
from support import EPS

SINGLE = float(np.finfo(np.float32).eps)
TURN = 2 * np.pi
Array = np.ndarray[Any, Any]


def angles(rng: np.random.Generator, n: int, fastest: float, period: float = TURN) -> tuple[Array, Array]:
    """Return a signal of many turns, no step of which is longer than `fastest` turns, and what is left in one turn."""
    whole = period * np.cumsum(fastest * np.sin(np.cumsum(rng.uniform(-0.3, 0.4, n))))
    return whole, (whole + period / 2) % period - period / 2


def close(d: Differentiator, whole: Array, single: bool = False) -> float:
    """Return how far estimates may lie apart for rounding: weights of ends are at most ten times those of the design.

    Taking turns away, and adding them again, rounds samples to an eps of their size; a sum of weights does no worse.
    """
    size = 10 * max(float(np.abs(one.weights).sum()) for one in d.orders) * np.nanmax(np.abs(whole))
    return float((SINGLE if single else EPS) * (d.window_length + 8) * size)


@pytest.mark.parametrize("mode", ["fit", "nan", "valid"])
@pytest.mark.parametrize("deriv", [0, 1, 2, (0, 1, 2)])
@pytest.mark.parametrize("tau", ["center", "newest", 0.3])
def test_angles_are_differentiated_as_if_they_had_never_been_cut(deriv: Any, mode: str, tau: Any) -> None:
    rng = np.random.default_rng([41, int(np.max(deriv))])
    for period, fastest in [(TURN, 0.49), (360.0, 0.3), (1.0, 0.1)]:
        whole, x = angles(rng, 200, fastest, period)
        assert np.ptp(whole) > period
        d = Differentiator(11, deriv, degree=3, tau=tau, delta=0.1)
        found, wanted = d(x, period=period, mode=mode), d(whole, mode=mode)
        turns = np.rint((whole - x) / period) * period
        if mode == "valid":
            first = int(np.floor(d.tau * 11))
            turns = turns[first : first + 190]
        wanted = np.where(np.reshape(d.deriv, (-1, 1)) == 0, wanted - turns, wanted).reshape(found.shape)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=close(d, whole))


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_turns_are_counted_across_gaps(dtype: Any, uneven: bool, down: bool) -> None:
    rng = np.random.default_rng(42)
    whole, _ = angles(rng, 300, 0.08)
    x = np.stack([whole, -whole, whole[::-1]], axis=1)
    x = ((x + np.pi) % TURN - np.pi).astype(dtype)
    whole = np.stack([whole, -whole, whole[::-1]], axis=1)
    x[[0, 1, 2, 299], 0] = x[100:105, 1] = x[200, 2] = np.nan  # five steps of 0.08 turns: still less than half a turn
    gone = np.isnan(x)
    t = np.cumsum(rng.uniform(0.5, 1.5, 300)) if uneven else 0.1 * np.arange(300)
    way = slice(None, None, -1) if down else slice(None)
    for deriv in (0, 1, 2):
        d = Differentiator(21, deriv, degree=3)
        given = np.where(gone, np.nan, whole)
        found = d(x[way], 0, t=t[way], period=TURN, nan_policy="omit")[way]
        wanted = d(given, 0, t=t, nan_policy="omit")
        assert found.dtype == dtype
        np.testing.assert_array_equal(np.isnan(found), np.isnan(wanted))
        # Another turn is another angle but no other slope.
        off = found - wanted
        if deriv == 0:
            off -= TURN * np.rint(off / TURN)
            there = ~gone
            assert np.abs(found - x)[there].max() < 0.5  # on the turn of the sample itself
        unit = min(1.0, float(np.diff(t).min())) ** -deriv
        np.testing.assert_allclose(off, 0, rtol=0, atol=unit * close(d, whole, dtype is np.float32), equal_nan=True)


def test_where_a_sample_is_missing_the_turn_is_that_of_the_last_one() -> None:
    whole = np.linspace(0, 30, 120)
    x = (whole + np.pi) % TURN - np.pi
    x[[40, 41]] = np.nan
    found = differentiate(x, 11, 0, period=TURN, nan_policy="omit")
    turns = TURN * np.rint((whole - x) / TURN)
    turns[[40, 41]] = turns[39]
    np.testing.assert_allclose(found, whole - turns, rtol=0, atol=1e-12)
    at = np.array([10.2, 40.4, 77.9])
    found = differentiate(x, 11, 0, period=TURN, nan_policy="omit", at=at)
    wanted = np.interp(at, np.arange(120), whole) - turns[[10, 40, 78]]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)
    cut = np.flatnonzero(np.diff(turns))  # half way between two samples the newer one says which turn
    found = differentiate(x, 11, 0, period=TURN, nan_policy="omit", at=cut + 0.5)
    wanted = np.interp(cut + 0.5, np.arange(120), whole) - turns[cut + 1]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)


def test_missing_angles_spread_as_other_samples_do() -> None:
    whole, x = angles(np.random.default_rng(43), 200, 0.1)
    x[[50, 51, 120]] = np.nan
    for deriv in (0, 1):
        found = differentiate(x, 11, deriv, period=TURN)
        np.testing.assert_array_equal(np.isnan(found), np.isnan(differentiate(x, 11, deriv)))
        if deriv == 1:
            wanted = differentiate(np.where(np.isnan(x), np.nan, whole), 11)
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * 30)
    assert np.isnan(differentiate(np.full(20, np.nan), 5, period=1.0, nan_policy="omit")).all()


def test_angles_of_every_dtype() -> None:
    whole = np.cumsum(np.random.default_rng(44).integers(-150, 170, 200))
    degrees = whole % 360
    wanted = differentiate(whole, 11)
    for x in (degrees, degrees.astype(np.uint16), degrees.astype(">f8"), degrees.tolist(), np.ma.masked_array(degrees)):
        np.testing.assert_allclose(differentiate(x, 11, period=360), wanted, rtol=0, atol=1e-10)
    read_only = degrees.astype(float)
    read_only.flags.writeable = False
    np.testing.assert_allclose(differentiate(read_only, 11, period=360), wanted, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(read_only, degrees)
    single = differentiate(degrees.astype(np.float32), 11, period=360)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, wanted, rtol=0, atol=2 * SINGLE * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("error", "message", "x", "period"),
    [
        (TypeError, r"^period must come with real samples, got complex", np.zeros(20, complex), 1.0),
        (ValueError, r"^period must be finite and positive, got 0.0", np.zeros(20), 0.0),
        (ValueError, r"^period must be finite and positive, got -1.0", np.zeros(20), -1.0),
        (ValueError, r"^period must be finite and positive, got nan", np.zeros(20), np.nan),
        (ValueError, r"^period must be finite and positive, got inf", np.zeros(20), np.inf),
        (TypeError, r"^period must be a real number", np.zeros(20), "360"),
        (TypeError, r"^period must be a real number", np.zeros(20), 1j),
    ],
)
def test_what_a_period_must_not_be(error: type[Exception], message: str, x: Array, period: Any) -> None:
    with pytest.raises(error, match=message):
        differentiate(x, 5, period=period)


# Complex samples.


@pytest.mark.parametrize("dtype", [np.complex128, np.complex64])
@pytest.mark.parametrize("deriv", [1, (0, 2)])
@pytest.mark.parametrize("uneven", [False, True])
def test_complex_samples_are_two_real_signals(uneven: bool, deriv: Any, dtype: Any) -> None:
    rng = np.random.default_rng(45)
    x = (rng.standard_normal((90, 2)) + 1j * rng.standard_normal((90, 2))).astype(dtype)
    x.real[20, 0] = x.imag[[50, 51], 0] = x.real[70, 1] = x.imag[70, 1] = np.nan
    before = x.copy()
    call: dict[str, Any] = {
        "axis": 0,
        "nan_policy": "omit",
        "t": np.cumsum(rng.uniform(0.5, 2, 90)) if uneven else None,
    }
    d = Differentiator(15, deriv, degree=3)
    found = d(x, **call)
    assert found.dtype == dtype
    gone = np.isnan(x)  # either part
    parts = [np.where(gone, np.nan, part).astype(part.dtype) for part in (x.real, x.imag)]
    np.testing.assert_array_equal(found.real, d(parts[0], **call))
    np.testing.assert_array_equal(found.imag, d(parts[1], **call))
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(x, before)
    # Of the noise half is in either part.
    more = d(x, return_std=True, return_support=True, return_bias=True, sigma=3.0, **call)
    real = d(parts[0], return_std=True, return_support=True, return_bias=True, sigma=3.0, **call)
    imag = d(parts[1], return_bias=True, **call)
    np.testing.assert_array_equal(more.support, real.support)
    assert more.std.dtype == parts[0].dtype
    np.testing.assert_allclose(more.std, real.std, rtol=4 * (SINGLE if dtype is np.complex64 else EPS))
    assert more.bias.dtype == dtype
    np.testing.assert_array_equal(more.bias.real, real.bias)
    np.testing.assert_array_equal(more.bias.imag, imag.bias)


def test_complex_samples_that_are_masked_or_missing_in_one_part() -> None:
    rng = np.random.default_rng(46)
    x = rng.standard_normal(60) + 1j * rng.standard_normal(60)
    x[30] = complex(np.nan, 1.0)
    spread = differentiate(x, 9)
    touched = np.abs(np.arange(60) - 30) <= 4
    np.testing.assert_array_equal(np.isnan(spread), touched)
    masked = np.ma.masked_array(np.where(np.isnan(x), 7.0, x), np.isnan(x))
    found = differentiate(masked, 9)
    assert isinstance(found, np.ma.MaskedArray)
    np.testing.assert_array_equal(found.mask, touched)
    np.testing.assert_array_equal(found[~touched].data, spread[~touched])
    np.testing.assert_array_equal(
        differentiate(masked, 9, nan_policy="omit").data, differentiate(x, 9, nan_policy="omit")
    )
    constant = differentiate(x, 9, nan_policy="omit", mode="constant", cval=1 + 2j)
    for part, value in [("real", 1.0), ("imag", 2.0)]:
        one = np.where(np.isnan(x), np.nan, getattr(x, part))
        wanted = differentiate(one, 9, nan_policy="omit", mode="constant", cval=value)
        np.testing.assert_array_equal(getattr(constant, part), wanted)
    with pytest.raises(ValueError, match=r"^x must hold no missing samples with nan_policy = 'raise', got 1 of 60"):
        differentiate(x, 9, nan_policy="raise")
    out = np.empty(60, complex)
    assert differentiate(x, 9, nan_policy="omit", out=out) is out
    assert isinstance(differentiate(x, 9, nan_policy="omit", return_support=True), algdiff.Estimates)


def test_more_turns_than_can_be_counted_are_refused() -> None:
    x = np.where(np.arange(40) < 20, 0.0, 1e10)
    with pytest.raises(ValueError, match=r"period must be at least 2\*\*-53 of every step between samples"):
        algdiff.differentiate(x, 5, period=1e-10)
    assert np.isfinite(algdiff.differentiate(x, 5, period=1e-5)).all()
