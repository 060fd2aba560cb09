"""What a choice refuses, by the name of the argument, what it got and what it allows."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import algdiff

X = np.sin(0.02 * np.arange(600)) + 0.02 * np.random.default_rng(0).standard_normal(600)
NAN = float("nan")
INF = float("inf")

REFUSED: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"deriv": 1.5}, TypeError, "deriv must be an integer, got 1.5"),
    ({"deriv": True}, TypeError, "deriv must be an integer, got True"),
    ({"deriv": "one"}, TypeError, "deriv must be an integer, got 'one'"),
    ({"deriv": -1}, ValueError, "deriv must be an integer of at least 0, got -1"),
    ({"deriv": ()}, ValueError, "deriv must name at least one order"),
    ({"deriv": (1, 1)}, ValueError, r"every order once, got \(1, 1\)"),
    ({"deriv": 596}, ValueError, "x must have at least 601 samples to choose a window, got 600"),
    ({"degree": 1.5}, TypeError, "degree must be an integer, got 1.5"),
    ({"degree": 1, "deriv": 2}, ValueError, "degree must be an integer of at least 2, got 1"),
    ({"degree": 100}, ValueError, "degree .*got none that holds a fit of degree 100"),
    ({"kappa": 1, "mu": 2}, ValueError, "kappa and mu must be equal and greater than -1/2 .*, got 1 and 2"),
    ({"kappa": 0}, ValueError, "kappa and mu must be equal .*, got 0 and 1.0"),
    ({"kappa": -0.5, "mu": -0.5}, ValueError, "greater than -1/2 .*, got -0.5 and -0.5"),
    ({"kappa": NAN, "mu": NAN}, ValueError, "kappa and mu must be equal"),
    ({"kappa": INF, "mu": INF}, ValueError, "kappa and mu must be equal"),
    ({"kappa": "big"}, TypeError, "kappa must be a real number, got 'big'"),
    ({"mu": None}, TypeError, "mu must be a real number, got None"),
    ({"delta": 0}, ValueError, "delta must be finite and positive, got 0"),
    ({"delta": -1}, ValueError, "delta must be finite and positive, got -1"),
    ({"delta": NAN}, ValueError, "delta must be finite and positive, got nan"),
    ({"delta": "1"}, TypeError, "delta must be a real number, got '1'"),
    ({"fs": 0}, ValueError, "fs must be finite and positive, got 0"),
    ({"fs": INF}, ValueError, "fs must be finite and positive, got inf"),
    ({"fs": True}, TypeError, "fs must be a real number, got True"),
    ({"fs": 1, "delta": 1}, ValueError, "give delta or fs, not both"),
    ({"t": np.arange(600), "delta": 1}, ValueError, "give t, delta or fs, one of them: got t and delta"),
    ({"t": np.arange(600), "fs": 1}, ValueError, "give t, delta or fs, one of them: got t and fs"),
    ({"t": np.arange(600) ** 1.1}, ValueError, "t must be evenly spaced .*window_length or window_duration"),
    ({"t": np.arange(599)}, ValueError, r"t must have one time for each of the 600 samples .*\(599,\)"),
    ({"t": np.zeros(600)}, ValueError, "t must be strictly monotone"),
    ({"t": np.full(600, NAN)}, ValueError, "t must be finite"),
    ({"axis": 1}, ValueError, "axis must be from -1 to 0 for 1 dimensions, got 1"),
    ({"axis": 0.5}, TypeError, "axis must be an integer, got 0.5"),
    ({"sigma": -1}, ValueError, "sigma must be finite and not negative, got -1"),
    ({"sigma": NAN}, ValueError, "sigma must be finite and not negative, got nan"),
    ({"sigma": "low"}, TypeError, "sigma must be a real number, got 'low'"),
    ({"sigma": [0.1]}, TypeError, r"sigma must be a real number, got \[0.1\]"),
    ({"noise": "pink"}, ValueError, "noise must be 'auto', 'white' or 'ar1', got 'pink'"),
    ({"noise": None}, TypeError, "noise must be a word, one of 'auto', 'white', 'ar1', got None"),
    ({"noise": "ar1", "sigma": 0.1}, ValueError, "give sigma or noise = 'ar1', not both: got sigma = 0.1"),
    ({"max_delay": -1}, ValueError, "max_delay must be finite and not negative, got -1"),
    ({"max_delay": INF}, ValueError, "max_delay must be finite and not negative, got inf"),
    ({"max_delay": "soon"}, TypeError, "max_delay must be a real number, got 'soon'"),
    ({"bandwidth": 0}, ValueError, "bandwidth must be finite and positive, got 0"),
    ({"bandwidth": NAN}, ValueError, "bandwidth must be finite and positive, got nan"),
    ({"bandwidth": "wide"}, TypeError, "bandwidth must be a real number, got 'wide'"),
    ({"bandwidth": 0.5}, ValueError, "bandwidth must be lower, got 0.5"),
    ({"min_window": 0}, ValueError, "min_window must be an integer of at least 1, got 0"),
    ({"min_window": 2.5}, TypeError, "min_window must be an integer, got 2.5"),
    ({"min_window": 601}, ValueError, "min_window must be at most the number of samples, 600, got 601"),
    ({"max_window": 2}, ValueError, "max_window must be an integer of at least 3, got 2"),
    ({"max_window": "all"}, TypeError, "max_window must be an integer, got 'all'"),
    ({"max_window": 49, "min_window": 51}, ValueError, "max_window must be at least min_window, got 49 and 51"),
    ({"max_window": 6, "degree": 6}, ValueError, "max_window.*got none that holds a fit of degree 6"),
    ({"local": True, "max_delay": 5}, ValueError, "give local or max_delay, not both"),
]


@pytest.mark.parametrize(("words", "error", "message"), REFUSED, ids=[str(list(one[0])) for one in REFUSED])
def test_refusals(words: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message) as caught:
        algdiff.suggest(X, **words)
    assert "\n" not in str(caught.value)
    known = {"deriv", "degree", "kappa", "mu", "delta", "fs", "t", "axis"}
    if set(words) <= known:
        with pytest.raises(error, match=message):
            algdiff.differentiate(X, **words)


@pytest.mark.parametrize(
    ("x", "error", "message"),
    [
        (X[:5], ValueError, "x must have at least 6 samples to choose a window, got 5"),
        ([], ValueError, "x must have at least 6 samples to choose a window, got 0"),
        (3.0, ValueError, "x must have at least one dimension"),
        (["a"] * 20, TypeError, "x must hold real or complex numbers"),
        ([[1.0, 2.0], [1.0]], ValueError, "x must be an array of numbers"),
        (np.full(600, NAN), ValueError, "x must hold samples that are finite, got none"),
        (np.where(np.arange(600) % 6, X, NAN), ValueError, "x must have 6 finite samples in a row .*, got 5"),
        (np.stack([np.full(600, NAN)] * 2), ValueError, "x must hold samples that are finite, got none"),
        (np.ma.MaskedArray(X, True), ValueError, "x must hold samples that are finite, got none"),
    ],
)
def test_samples_that_are_no_good(x: Any, error: type[Exception], message: str) -> None:
    for refuse in (algdiff.suggest, algdiff.differentiate):
        with pytest.raises(error, match=message):
            refuse(x)


def test_the_fewest_samples_that_do() -> None:
    for deriv in range(4):
        assert algdiff.differentiate(X[: 5 + deriv], deriv=deriv).shape == (5 + deriv,)
        with pytest.raises(ValueError, match=f"at least {5 + deriv} samples to choose a window, got {4 + deriv}"):
            algdiff.suggest(X[: 4 + deriv], deriv)


NEEDS_A_WINDOW: list[dict[str, Any]] = [
    {"tau": "newest"},
    {"tau": 0.5},
    {"delay": 3.0},
    {"rule": "midpoint"},
    {"trim": 0.1},
    {"at": [1.0, 2.0]},
]


@pytest.mark.parametrize("words", NEEDS_A_WINDOW, ids=str)
def test_what_needs_a_window(words: dict[str, Any]) -> None:
    ((name, value),) = words.items()
    with pytest.raises(ValueError, match=f"window_length must be given with {name}, got {name} = ") as caught:
        algdiff.differentiate(X, **words)
    assert repr(value) in str(caught.value)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", algdiff.DesignWarning)
        algdiff.differentiate(X, 21, **words)


def test_what_a_given_window_refuses() -> None:
    for words in ({"window_length": 21}, {"window_duration": 21}):
        with pytest.raises(ValueError, match="local must be left out with a given window, got True"):
            algdiff.differentiate(X, local=True, **words)


def test_dask_arrays() -> None:
    lazy = pytest.importorskip("dask.array").from_array(X)
    with pytest.raises(TypeError, match="x must be an array in memory"):
        algdiff.suggest(lazy)
    with pytest.raises(ValueError, match="window_length must be given for a Dask array"):
        algdiff.differentiate(lazy)


def test_words_of_the_call() -> None:
    suggestion = algdiff.suggest(X)
    with pytest.raises(ValueError, match="mode must be 'fit'"):
        suggestion(X, mode="sideways")
    with pytest.raises(TypeError, match="unexpected keyword argument 'quick'"):
        suggestion(X, quick=True)
    with pytest.raises(ValueError, match="window_length must be at most the 10 samples"):
        suggestion(X[:10])
    with pytest.raises(TypeError, match="ax must be a matplotlib Axes, got 3"):
        suggestion.plot(3)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="engine must be"):
        algdiff.differentiate(X, engine="quick")
    with pytest.raises(ValueError, match="sigma must be finite and not negative, got -1"):
        algdiff.differentiate(X, sigma=-1)
    with pytest.raises(TypeError, match="positional"):
        algdiff.suggest(X, 1, 3)  # type: ignore[misc]


def test_noise_whose_square_is_no_number() -> None:
    with pytest.raises(ValueError, match=r"sigma must be at most 1e\+100 times as large as the samples, got 1e\+300"):
        algdiff.suggest(X, sigma=1e300)
    assert np.isfinite(algdiff.suggest(X, sigma=1e90).rmse)


@pytest.mark.xfail(strict=True, raises=RuntimeWarning, reason="what is left of the shortest windows is no number")
def test_exponents_of_which_windows_keep_one_sample() -> None:
    suggestion = algdiff.suggest(X, kappa=60, mu=60)
    assert np.isfinite(suggestion(X)).all()
