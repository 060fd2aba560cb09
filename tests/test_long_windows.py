"""Windows of many samples: the ends of rows and columns, offsets that leak there, and cuts through extended ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from algdiff._core import Bank
from support import EPS, design, sum_bound

# So long, for their degrees, that the fits at the ends are not tables; and just as long as the data, so that the first
# window of a row is its last one too, and the next row begins with a window that starts where the one before it did.
LONG = [(30_001, 3), (6001, 12)]


@pytest.mark.parametrize(("length", "degree"), LONG)
def test_every_row_and_column_has_ends_of_its_own(length: int, degree: int) -> None:
    ours = design(length, degree=degree)
    x = np.random.default_rng(length).standard_normal((3, length)).cumsum(axis=1)
    alone = np.stack([ours(row) for row in x])
    assert ours(x).tobytes() == alone.tobytes()
    assert np.ascontiguousarray(ours(np.ascontiguousarray(x.T), axis=0).T).tobytes() == alone.tobytes()
    # The last output is the fit at the newest sample: a design for that point, of the same degree.
    newest = design(length, degree=degree, tau="newest").weights
    for row, result in zip(x, alone, strict=True):
        assert abs(result[-1] - row @ newest) <= 2 * sum_bound(newest, row)  # the fit is well conditioned


@pytest.mark.parametrize("length", [301, 30_001])
def test_rules_leak_offsets_at_the_ends_as_well(length: int) -> None:
    ours, newest = (design(length, degree=3, rule="trapezoid", tau=tau) for tau in ("center", "newest"))
    leak = newest.weights.sum()
    rounding = 2 * length * EPS * np.abs(newest.weights).sum()  # of two sums of so many products
    assert abs(leak) > 10 * rounding
    assert abs(ours(np.ones(length))[-1] - leak) <= rounding


@pytest.mark.parametrize("engine", ["direct", "moments", "fft"])
def test_cuts_through_extended_ends_change_no_bit(engine: str) -> None:
    """Tasks end where blocks do, so that an end is made of the same blocks, whatever part is asked for."""
    length = 600
    bank = Bank([design(length, degree=3)._plan], engine)
    grid = bank.grid(False)
    start = grid * -(-5000 // grid)  # as parts must
    rng = np.random.default_rng(length)
    for samples in range(start + 1500, start + 7000, 211):
        x = rng.standard_normal(samples)
        whole, part = np.empty(samples), np.empty(samples - start - length)
        bank.run(x, whole, (1, samples, 1), "mirror")
        bank.run(x[start:].copy(), part, (1, samples - start, 1), "mirror", part=(start, samples, start + length))
        assert part.tobytes() == whole[start + length :].tobytes(), samples


def test_ends_of_trimmed_windows_reproduce_polynomials() -> None:
    ours = design(40_001, degree=3, kappa=2, mu=2, trim=0.01)
    span = len(ours.weights)
    assert 30_000 < span < 40_001
    t = np.linspace(-1, 1, span + 2)  # in steps that are the unit of the estimates
    found = ours(t**3) * (span + 1) / 2
    # Sums of `span` products; the weights at the ends are larger, by less than the factor.
    steepest = np.abs(ours.weights).sum() * (span + 1) / 2
    assert np.abs(found - 3 * t**2).max() <= 64 * span * EPS * steepest


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_columns_side_by_side_in_windows_of_many_coefficients_are_rows(dtype: Any) -> None:
    """A fit of 18 coefficients to 4001 samples keeps no tables for the ends."""
    ours = design(4001, degree=17, kappa=0, mu=0, engine="direct")
    x = np.random.default_rng(31).standard_normal((4100, 24)).astype(dtype)
    x[:, 3] = 7.0
    found = ours(x, axis=0)
    for column in (0, 3, 16, 23):
        np.testing.assert_array_equal(found[:, column], ours(np.ascontiguousarray(x[:, column])))
    assert not found[:, 3].any()
