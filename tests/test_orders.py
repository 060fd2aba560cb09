"""Several orders in one pass: the results and the analysis of the single orders, and refusals of what has no sense."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import Differentiator, differentiate

MODES = ["fit", "valid", "nan", "nearest", "mirror", "wrap", "constant"]
X = np.random.default_rng(7).standard_normal((40, 50, 3))
ORDERS = [(0, 1, 2), (2, 0), (1,), (3, 1, 0, 2)]


def singles(deriv: tuple[int, ...], window_length: int = 21, **options: Any) -> list[Differentiator]:
    degree = options.pop("degree", max(deriv) + 2)
    return [Differentiator(window_length, order, degree=degree, **options) for order in deriv]


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("deriv", ORDERS)
@pytest.mark.parametrize(
    "window", [{"window_length": 21}, {"window_length": 20}, {"window_length": 13, "tau": "newest"}]
)
def test_every_order_has_the_bits_of_its_own_pass(deriv: tuple[int, ...], mode: str, window: dict[str, Any]) -> None:
    options = {**window, "engine": "direct", "delta": 0.1}
    several = Differentiator(deriv=deriv, **options)
    for x in (X, X.astype(np.float32), (100 * X).astype(np.int16), X[::-1], X + 1j * X[::-1], np.asfortranarray(X)):
        for axis in (0, 1, -2):
            got = several(x, axis, mode=mode, cval=0.5)
            expected = np.stack([one(x, axis, mode=mode, cval=0.5) for one in singles(deriv, **options)])
            assert got.dtype == expected.dtype
            np.testing.assert_array_equal(got, expected)
    np.testing.assert_array_equal(differentiate(X, deriv=deriv, axis=1, mode=mode, **options), several(X, 1, mode=mode))


def test_polynomials_come_back_with_all_their_derivatives() -> None:
    t = np.linspace(-1, 1, 201)
    results = differentiate(t**4, 31, (0, 2, 1, 4, 3), delta=0.01)
    expected = [t**4, 12 * t**2, 4 * t**3, np.full(201, 24.0), 24 * t]
    # The rounding of samples of size 1 through weights of the order n: at most norm1 eps, and the sums' own few eps.
    norms = Differentiator(31, (0, 2, 1, 4, 3), delta=0.01).norm1
    for result, right, norm in zip(results, expected, norms, strict=True):
        # "fit" extrapolates by less than a window, by weights of at most about 100 times the size of those inside.
        np.testing.assert_allclose(result, right, rtol=0, atol=100 * norm * np.finfo(float).eps * 31)


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.complex128, np.int16])
def test_out_of_every_layout(dtype: Any) -> None:
    x = (100 * X).astype(dtype)
    d = Differentiator(11, (1, 0))
    expected = d(x, axis=1)
    for out in (np.empty_like(expected), np.empty(expected.shape[::-1], expected.dtype).T, np.stack([expected] * 2)[0]):
        out[...] = 0
        assert d(x, axis=1, out=out) is out
        np.testing.assert_array_equal(out, expected)
    with pytest.raises(ValueError, match=r"out must have shape \(2, 40, 50, 3\), got \(40, 50, 3\)"):
        d(x, axis=1, out=expected[0])


STACKED: dict[str, Callable[[Differentiator], Any]] = {
    "weights": lambda d: d.weights,
    "frequency_response": lambda d: d.frequency_response(frequency=[0.5, 1.0, 3.0]),
    "frequency_response of one": lambda d: d.frequency_response(0.5),
    "step_response": lambda d: d.step_response(np.arange(-1, 30)),
    "impulse_response": lambda d: d.impulse_response(0.3),
}
EACH = ["noise_gain", "norm1", "exactness", "bias_order", "bias_constant", "bias_bound", "cutoff", "half_power"]
EACH += ["nyquist_attenuation", "kernel", "moment_delay"]
SHARED = ["window_length", "degree", "kappa", "mu", "tau", "delay", "delay_samples", "delta", "fs", "duration", "rule"]


@pytest.mark.parametrize("options", [{}, {"tau": "newest", "degree": 2}, {"kappa": -0.6, "window_length": 30}])
def test_analysis_is_that_of_the_single_orders(options: dict[str, Any]) -> None:
    d = Differentiator(**{"window_length": 21, "delta": 0.1, "deriv": (0, 2, 1), **options})
    ones = singles((0, 2, 1), **{"delta": 0.1, "degree": d.degree, **options})
    assert d.orders == tuple(ones)
    assert [one.orders for one in ones] == [(one,) for one in ones]
    for name, of in STACKED.items():
        np.testing.assert_array_equal(of(d), np.stack([of(one) for one in ones]), err_msg=name)
    for name in EACH:
        assert getattr(d, name) == tuple(getattr(one, name) for one in ones), name
    for name in SHARED:
        assert all(getattr(d, name) == getattr(one, name) for one in ones), name
    assert d.discretisation_error() == tuple(one.discretisation_error() for one in ones)
    bounds = [one.asymptotes([1.0, 2.0]) for one in ones]
    np.testing.assert_array_equal(d.asymptotes([1.0, 2.0]).upper, [one.upper for one in bounds])
    assert not d.weights.flags.writeable
    with pytest.raises(ValueError, match="WRITEABLE"):
        d.weights.flags.writeable = True


def test_what_a_design_of_several_orders_is() -> None:
    d = Differentiator(21, [0, np.int64(2)], delta=0.1)
    assert (d.deriv, d.degree) == ((0, 2), 4)
    assert d == Differentiator(21, range(0, 4, 2), delta=0.1) == Differentiator(21, np.array([0, 2]), delta=0.1)
    assert d != Differentiator(21, (2, 0), delta=0.1)
    assert Differentiator(21, (1,)) != Differentiator(21, 1)
    assert Differentiator(21, (1,))(X[:, 0, 0]).shape == (1, 40)
    assert len({d, pickle.loads(pickle.dumps(d)), eval(repr(d), {"Differentiator": Differentiator})}) == 1  # noqa: S301, S307
    assert d.replace(deriv=2, degree=4) == d.orders[1]
    assert Differentiator.from_cutoff(2, fs=100).replace(deriv=(0, 1)).deriv == (0, 1)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(d))(X, 0), d(X, 0))  # noqa: S301


@pytest.mark.parametrize(
    ("deriv", "error", "message"),
    [
        ((1, 1), ValueError, r"deriv must name at least one order, and every order once, got \(1, 1\)"),
        ((), ValueError, r"deriv must name at least one order, and every order once, got \(\)"),
        ((0, True), TypeError, "deriv must be an integer, got True"),
        ((0, 1.0), TypeError, "deriv must be an integer, got 1.0"),
        ((0, -1), ValueError, "deriv must be an integer of at least 0, got -1"),
        (("0", "1"), TypeError, "deriv must be an integer, got '0'"),
        ("01", TypeError, "deriv must be an integer, got '01'"),
        ({0, 1}, TypeError, "deriv must be an integer, got {0, 1}"),
        (np.ones((2, 2), int), TypeError, "deriv must be an integer, got array"),
    ],
)
def test_orders_that_cannot_be_are_refused(deriv: Any, error: type[Exception], message: str) -> None:
    for function in (lambda: Differentiator(21, deriv), lambda: differentiate(X, 21, deriv)):
        with pytest.raises(error, match=message):
            function()


def test_what_depends_on_the_order_is_refused() -> None:
    with pytest.raises(ValueError, match="tau must not be 'root' for several orders, got deriv = "):
        Differentiator(21, (0, 1), tau="root")
    with pytest.raises(ValueError, match=r"trim must be 0 for several orders, got trim = 0.01 and deriv = "):
        differentiate(X, 21, (0, 1), trim=0.01)
    with pytest.raises(ValueError, match="degree must be at least deriv = 2"):
        Differentiator(21, (0, 2), degree=1)
    assert Differentiator(21, (1,), tau="root", trim=0.01).orders[0] == Differentiator(21, 1, tau="root", trim=0.01)
    makers: list[Callable[[], Any]] = [
        lambda: Differentiator.from_cutoff(0.01, (0, 1)),
        lambda: Differentiator.from_delay(30, (0, 1)),
        lambda: Differentiator.from_duration(30, (0, 1)),
        lambda: Differentiator.from_notch(0.1, (0, 1)),
        lambda: algdiff.optimal_window(0.1, (0, 1), derivative_bound=1),  # type: ignore[arg-type]
    ]
    for make in makers:
        with pytest.raises(ValueError, match="deriv must be one order to choose a window by"):
            make()
    d = Differentiator(21, (0, 1))
    uses: list[Callable[[], Any]] = [d.summary, d.to_c]
    uses += [lambda: algdiff.plot_design(d), lambda: algdiff.plot_kernel(d), lambda: algdiff.plot_response(d)]
    for use in uses:
        with pytest.raises(ValueError, match=r"of one order, got deriv = \(0, 1\): take one of its \.orders"):
            use()


def test_a_steep_noise_gain_is_said_once_for_all_orders() -> None:
    with pytest.warns(algdiff.DesignWarning, match=r"it is [\d.e+]+ and [\d.e+]+: use a lower degree") as caught:
        Differentiator(9, (0, 1), degree=6)
    assert len(caught) == 1
    assert caught[0].filename == __file__


def test_engines_are_words_of_the_design() -> None:
    d = Differentiator(21, engine="direct")
    assert (d.engine, d.engine_for(np.float32), d.engine_for("int16")) == ("direct",) * 3
    assert d.replace(window_length=31).engine == "direct"
    assert "engine='direct'" in repr(d)
    assert pickle.loads(pickle.dumps(d)) == d  # noqa: S301
    np.testing.assert_array_equal(differentiate(X, 21, axis=0, engine="direct"), d(X, 0))
    np.testing.assert_array_equal(algdiff.gradient(X, window_length=21, axis=0, engine="direct"), d(X, 0))
    smooth = algdiff.savgol_filter(X, 21, 3, axis=0, engine="direct")
    np.testing.assert_array_equal(smooth, Differentiator(21, 0, degree=3, kappa=0, mu=0, engine="direct")(X, 0))
    calls: list[Callable[[Any], Any]] = [
        lambda engine: Differentiator(21, engine=engine),
        lambda engine: differentiate(X, 21, axis=0, engine=engine),
        lambda engine: algdiff.savgol_filter(X, 21, 3, axis=0, engine=engine),
        lambda engine: algdiff.gradient(X, window_length=3, degree=1, engine=engine),
        lambda engine: Differentiator.from_cutoff(0.01, engine=engine),
    ]
    for call in calls:
        with pytest.raises(ValueError, match=r"engine must be .auto.* got .fast"):
            call("fast")
        with pytest.raises(TypeError, match="engine must be a word such as 'auto', got 3"):
            call(3)
