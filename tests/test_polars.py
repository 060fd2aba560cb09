"""The recipe for polars of the documentation: groups apart, nulls as missing samples, lazily too."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import algdiff

pl = pytest.importorskip("polars", reason="needs polars")

RNG = np.random.default_rng(7)
N = 120
X = np.cumsum(RNG.standard_normal(N))
KEYS = RNG.permutation(np.repeat(["a", "b", "c"], N // 3))


def slope(column: str, window_length: int, **words: Any) -> Any:
    """Return the recipe."""

    def run(samples: Any) -> Any:
        return pl.Series(algdiff.differentiate(samples.to_numpy(), window_length, **words))

    return pl.col(column).map_batches(run, return_dtype=pl.Float64)


def test_groups_are_differentiated_apart() -> None:
    table = pl.DataFrame({"id": KEYS, "x": X})
    expression = slope("x", 9, delta=0.01).over("id").alias("v")
    found = table.with_columns(expression)
    for engine in ("in-memory", "streaming"):
        assert table.lazy().with_columns(expression).collect(engine=engine).equals(found)
    assert found.schema["v"] == pl.Float64
    for key in "abc":
        expected = algdiff.differentiate(X[key == KEYS], 9, delta=0.01)
        assert found.filter(pl.col("id") == key)["v"].to_numpy().tobytes() == expected.tobytes()


def test_nulls_are_missing_samples() -> None:
    gone = np.zeros(N, bool)
    gone[[30, 31, 70]] = True
    for dtype in (pl.Float64, pl.Int64):
        x = pl.Series("x", np.rint(X), dtype=pl.Float64, nan_to_null=False).cast(dtype)
        table = pl.DataFrame({"x": x.set(pl.Series(gone), None)})
        assert table["x"].null_count() == 3
        values = np.where(gone, np.nan, np.rint(X))
        for policy in ("propagate", "omit"):
            found = table.select(slope("x", 9, nan_policy=policy))["x"].to_numpy()
            assert found.tobytes() == algdiff.differentiate(values, 9, nan_policy=policy).tobytes()
        with pytest.raises(Exception, match="no missing samples"):
            table.select(slope("x", 9, nan_policy="raise"))


def test_times_of_a_column() -> None:
    seconds = np.cumsum(RNG.integers(1, 9, N))
    table = pl.DataFrame({"id": KEYS, "x": X, "t": np.datetime64("2026-01-01", "us") + seconds * 10**6})

    def run(columns: Any) -> Any:
        x, t = (column.to_numpy() for column in columns)
        return pl.Series(algdiff.differentiate(x, 9, t=t))

    expression = pl.map_batches(["x", "t"], run, return_dtype=pl.Float64)
    found = table.with_columns(v=expression.over("id"))
    for key in "abc":
        of = key == KEYS
        expected = algdiff.differentiate(X[of], 9, t=seconds[of])
        assert found.filter(pl.col("id") == key)["v"].to_numpy().tobytes() == expected.tobytes()


def test_a_series_is_an_array_like() -> None:
    found = algdiff.differentiate(pl.Series("x", X), 9)
    assert type(found) is np.ndarray
    assert found.tobytes() == algdiff.differentiate(X, 9).tobytes()
