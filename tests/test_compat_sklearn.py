"""The transformer for scikit-learn: values of `differentiate`, names of columns, and scikit-learn's own checks."""

from __future__ import annotations

import pickle
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import algdiff

pytest.importorskip("sklearn", reason="needs scikit-learn")
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.pipeline import make_pipeline
from sklearn.utils.estimator_checks import check_estimator

from algdiff.compat.sklearn import DerivativeTransformer

RNG = np.random.default_rng(6)
N = 150
X = np.cumsum(RNG.standard_normal((N, 3)), axis=0)
ORDER = "rows are samples in the order of time, and estimates are made of neighbours"
EXPECTED = {"check_methods_sample_order_invariance": ORDER, "check_methods_subset_invariance": ORDER}
"""No filter along the rows can pass these."""
ESTIMATORS = [
    DerivativeTransformer(),
    DerivativeTransformer(5),
    DerivativeTransformer(5, deriv=(0, 1)),
    DerivativeTransformer(5, nan_policy="omit"),
]


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=str)
def test_of_the_checks_of_scikit_learn_only_the_expected_two_fail(estimator: Any) -> None:
    found = check_estimator(estimator, expected_failed_checks=EXPECTED, on_fail=None, on_skip=None)
    assert len(found) > 40
    amiss = {one["check_name"]: one["exception"] for one in found if one["status"] in ("failed", "xfail")}
    assert set(amiss) == set(EXPECTED), amiss


@pytest.mark.parametrize("dtype", ["f8", "f4", int])
@pytest.mark.parametrize(
    "words",
    [{}, {"deriv": 2, "degree": 4}, {"kappa": 2.0, "mu": 0.5, "mode": "mirror"}],
    ids=["window", "second", "all"],
)
def test_values_are_those_of_differentiate(words: dict[str, Any], dtype: Any) -> None:
    x = np.rint(10 * X).astype(dtype)
    found = DerivativeTransformer(15, delta=0.25, **words).fit_transform(x)
    expected = algdiff.differentiate(x, 15, axis=0, delta=0.25, **words)
    assert found.dtype == expected.dtype
    assert np.array_equal(found, expected)


def test_without_a_window_fit_chooses_one_and_transform_keeps_it() -> None:
    made = DerivativeTransformer(delta=0.25).fit(X)
    expected = algdiff.suggest(X, axis=0, delta=0.25)
    assert made.differentiator_ == expected.differentiator == made.suggestion_.differentiator
    assert made.transform(X).tobytes() == algdiff.differentiate(X, axis=0, delta=0.25).tobytes()
    other = 100 * np.sin(np.arange(N))[:, None] * np.ones(3)
    assert made.transform(other).tobytes() == expected(other, axis=0).tobytes()
    assert not np.array_equal(made.transform(other), algdiff.differentiate(other, axis=0, delta=0.25))


def test_fewer_rows_than_the_chosen_window_have_one_of_their_own() -> None:
    smooth = np.sin(0.01 * np.arange(400))[:, None] + 0.1 * RNG.standard_normal((400, 1))
    made = DerivativeTransformer().fit(smooth)
    assert made.differentiator_.window_length > 60
    assert made.transform(smooth[:60]).tobytes() == algdiff.differentiate(smooth[:60], axis=0).tobytes()
    with pytest.raises(ValueError, match="window_length must be at most the 60 samples"):
        DerivativeTransformer(61).fit(smooth).transform(smooth[:60])


def test_several_orders_are_columns_with_names() -> None:
    pd = pytest.importorskip("pandas", reason="needs pandas")
    table = pd.DataFrame(X, pd.date_range("2026-01-01", periods=N, freq="s"), ["a", "b", "c"])
    made = DerivativeTransformer(15, deriv=(2, 0)).set_output(transform="pandas")
    found = made.fit_transform(table)
    assert found.columns.tolist() == ["a_deriv2", "b_deriv2", "c_deriv2", "a_deriv0", "b_deriv0", "c_deriv0"]
    assert found.index.equals(table.index)
    assert np.array_equal(found.to_numpy(), np.hstack(algdiff.differentiate(X, 15, (2, 0), axis=0)))
    one = DerivativeTransformer(15).set_output(transform="pandas").fit(table)
    assert one.transform(table).columns.tolist() == one.get_feature_names_out().tolist() == ["a", "b", "c"]
    with pytest.raises(ValueError, match="feature names"):
        one.transform(table[["b", "a", "c"]])


def test_missing_samples_are_refused_or_left_out() -> None:
    x = X.copy()
    x[70, 1] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        DerivativeTransformer(15).fit(x)
    found = DerivativeTransformer(15, nan_policy="omit").fit_transform(x)
    assert np.array_equal(found, algdiff.differentiate(x, 15, axis=0, nan_policy="omit"))
    assert not np.isnan(found).any()


def test_columns_without_samples_do_not_hinder_the_choice() -> None:
    x = X.copy()
    x[:, 1] = np.nan
    made = DerivativeTransformer(nan_policy="omit").fit(x)
    assert made.differentiator_ == algdiff.suggest(X[:, [0, 2]], axis=0).differentiator
    for rows in (x, x[: made.differentiator_.window_length - 1]):
        found = made.transform(rows)
        assert np.isnan(found[:, 1]).all()
        assert np.isfinite(found[:, [0, 2]]).all()
    pd = pytest.importorskip("pandas", reason="needs pandas")
    table = pd.DataFrame({"a": x[:, 1], "b": x[:, 1]})
    with pytest.raises(ValueError, match="x must hold samples that are finite, got none"):
        made.fit(table)


def test_tags_say_what_is_kept() -> None:
    for policy in ("propagate", "omit"):
        tags = DerivativeTransformer(15, nan_policy=policy).__sklearn_tags__()
        assert tags.input_tags.allow_nan == (policy == "omit")
        assert set(tags.transformer_tags.preserves_dtype) == {"float64", "float32"}


def test_copies_and_pipelines() -> None:
    made = DerivativeTransformer(deriv=(0, 1), degree=4)
    assert clone(made).get_params() == made.get_params()
    made.fit(X)
    assert pickle.loads(pickle.dumps(made)).transform(X).tobytes() == made.transform(X).tobytes()  # noqa: S301
    walk = np.cumsum(RNG.standard_normal((900, 3)), axis=0)
    velocity = algdiff.differentiate(walk, 15, axis=0) @ [1.0, -2.0, 3.0]
    grid = GridSearchCV(
        make_pipeline(DerivativeTransformer(5), LinearRegression()),
        {"derivativetransformer__window_length": [5, 15]},
        cv=TimeSeriesSplit(3),
    ).fit(walk, velocity)
    assert grid.best_params_ == {"derivativetransformer__window_length": 15}


@pytest.mark.parametrize(
    ("words", "error", "message"),
    [
        ({"window_length": 3}, ValueError, "degree"),
        ({"window_length": 15.5}, TypeError, "window_length must be an integer"),
        ({"window_length": 15, "deriv": -1}, ValueError, "deriv"),
        ({"window_length": 15, "kappa": -1}, ValueError, "kappa"),
        ({"window_length": 15, "delta": 0}, ValueError, "delta"),
        ({"window_length": 15, "mode": "valid"}, ValueError, "mode must be one that keeps the number of rows"),
        ({"window_length": 15, "mode": "odd"}, ValueError, "mode"),
        ({"window_length": 15, "nan_policy": "drop"}, ValueError, "nan_policy"),
    ],
)
def test_bad_parameters_are_named(words: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        DerivativeTransformer(**words).fit_transform(X)


def test_before_fit_there_is_no_design() -> None:
    for method in ("transform", "get_feature_names_out"):
        with pytest.raises(NotFittedError):
            getattr(DerivativeTransformer(15, deriv=(0, 1)), method)(X)


def test_without_the_package_the_error_says_what_to_install() -> None:
    code = "import sys; sys.modules['sklearn'] = None; import algdiff.compat.sklearn"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "ImportError: algdiff.compat.sklearn needs scikit-learn: pip install scikit-learn" in found.stderr
