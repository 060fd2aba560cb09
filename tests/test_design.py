"""The design object: its arguments, what it refuses, and that it never changes."""

from __future__ import annotations

import copy
import pickle
import warnings
from typing import Any

import numpy as np
import pytest

import algdiff
from support import design

NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("error", "match", "options"),
    [
        (ValueError, "window_length must be at least degree", {"window_length": 3}),
        (ValueError, "window_length must be an integer of at least 1", {"window_length": 0}),
        (ValueError, "window_length must be an integer of at least 1", {"window_length": -5}),
        (TypeError, "window_length must be an integer", {"window_length": 5.0}),
        (TypeError, "window_length must be an integer", {"window_length": "5"}),
        (TypeError, "window_length must be an integer", {"window_length": True}),
        (ValueError, "window_length must be at most 10000000", {"window_length": 10_000_001}),
        (ValueError, "deriv must be an integer of at least 0", {"deriv": -1}),
        (TypeError, "deriv must be an integer", {"deriv": 1.5}),
        (TypeError, "deriv must be an integer", {"deriv": (0, 1.5)}),
        (ValueError, "degree must be at least deriv = 2", {"deriv": 2, "degree": 1}),
        (ValueError, "degree must be at most 500", {"degree": 501, "window_length": 1000}),
        (TypeError, "degree must be an integer", {"degree": 2.0}),
        (ValueError, "kappa must be finite and greater than -1", {"kappa": -1}),
        (ValueError, "kappa must be finite and greater than -1", {"kappa": NAN}),
        (ValueError, "mu must be finite and greater than -1", {"mu": INF}),
        (TypeError, "mu must be a real number", {"mu": "1"}),
        (TypeError, "mu must be a real number", {"mu": 1j}),
        (ValueError, "tau must be finite", {"tau": NAN}),
        (ValueError, "tau must be finite", {"tau": INF}),
        (ValueError, "tau must be 'center', 'root', 'newest' or a number, got 'middle'", {"tau": "middle"}),
        (TypeError, "tau must be a word such as 'center' or a real number", {"tau": [0.5]}),
        (ValueError, "give tau or delay, not both", {"tau": 0.5, "delay": 0.0}),
        (ValueError, "delay must be finite", {"delay": NAN}),
        (TypeError, "delay must be a real number", {"delay": "0"}),
        (ValueError, "delta must be finite and positive, got 0", {"delta": 0}),
        (ValueError, "delta must be finite and positive, got -0.1", {"delta": -0.1}),
        (ValueError, "delta must be finite and positive, got nan", {"delta": NAN}),
        (ValueError, "delta must be finite and positive, got inf", {"delta": INF}),
        (ValueError, "delta must be", {"delta": 1e-200, "deriv": 2}),
        (ValueError, "delta must be", {"delta": 1e200, "deriv": 2}),
        (TypeError, "delta must be a real number", {"delta": np.ones(3)}),
        (ValueError, "give delta or fs, not both", {"delta": 0.1, "fs": 10}),
        (ValueError, "fs must be finite and positive", {"fs": 0}),
        (ValueError, "fs must be finite and positive", {"fs": NAN}),
        (ValueError, "rule must be 'exact', 'trapezoid', 'midpoint', .* or 'hat', got 'boole'", {"rule": "boole"}),
        (
            ValueError,
            "window_length must be odd with rule = 'simpson', got 20",
            {"rule": "simpson", "window_length": 20},
        ),
        (ValueError, "kappa must be at least 0 with rule = 'simpson'", {"rule": "simpson", "kappa": -0.5}),
        (ValueError, "trim must be at least 0 and less than 1/2, got 0.5", {"trim": 0.5}),
        (ValueError, "trim must be at least 0 and less than 1/2, got -0.1", {"trim": -0.1}),
        (ValueError, "trim must be at least 0 and less than 1/2, got nan", {"trim": NAN}),
        (TypeError, "trim must be a real number", {"trim": "1"}),
        (TypeError, "rule must be a word such as 'exact', got None", {"rule": None}),
        (TypeError, "kappa must be a real number", {"kappa": np.complex128(1 + 1j)}),
        (TypeError, "mu must be a real number", {"mu": np.array("1")}),
        (TypeError, "delta must be a real number", {"delta": np.array(True)}),
        (ValueError, r"kappa must be .* at most 1e4, got 1e300", {"kappa": 1e300}),
        (ValueError, r"tau must be .* at most 1e6 in size", {"tau": 8.4e17}),
        (ValueError, r"delay must be at most 1e6 windows long, got 1e300", {"delay": 1e300}),
        (ValueError, r"fs must be finite and positive, got 1e-320", {"fs": 1e-320}),
        (ValueError, r"deriv must be small enough for values that are finite", {"deriv": 150, "window_length": 400}),
        (ValueError, "kappa must be at least 0 with rule = 'trapezoid'", {"rule": "trapezoid", "kappa": -0.5}),
    ],
)
def test_wrong_arguments_are_named(error: type[Exception], match: str, options: dict[str, Any]) -> None:
    arguments: dict[str, Any] = {"window_length": 21, **options}
    with pytest.raises(error, match=match):
        algdiff.Differentiator(**arguments)
    with pytest.raises(error, match=match):
        algdiff.differentiate(np.zeros(100), **arguments)


@pytest.mark.parametrize(
    ("error", "match", "options"),
    [
        (ValueError, "mode must be 'fit', 'valid'", {"mode": "interp"}),
        (TypeError, "mode must be a word", {"mode": None}),
        (TypeError, "cval must be a real number", {"mode": "constant", "cval": "0"}),
        (TypeError, "cval must be a real number", {"mode": "constant", "cval": 1j}),
        (ValueError, "axis must be from -2 to 1 for 2 dimensions, got 2", {"axis": 2}),
        (TypeError, "axis must be an integer", {"axis": None}),
        (TypeError, "axis must be an integer", {"axis": True}),
        (ValueError, "threads must be an integer of at least 1", {"threads": 0}),
        (TypeError, "threads must be an integer", {"threads": 1.0}),
        (TypeError, "out must be an array, got list", {"out": [0.0]}),
        (ValueError, r"out must have shape \(2, 50\), got \(50, 2\)", {"out": np.zeros((50, 2))}),
        (TypeError, "out must have dtype float64, got float32", {"out": np.zeros((2, 50), np.float32)}),
        (TypeError, "out must have dtype float64, got >f8", {"out": np.zeros((2, 50), ">f8")}),
    ],
)
def test_wrong_calls_are_named(error: type[Exception], match: str, options: dict[str, Any]) -> None:
    with pytest.raises(error, match=match):
        algdiff.Differentiator(21)(np.zeros((2, 50)), **options)


@pytest.mark.parametrize("mode", ["fit", "valid", "nan"])
def test_a_window_longer_than_the_data(mode: str) -> None:
    with pytest.raises(ValueError, match=f"window_length must be at most the 20 samples of x in mode '{mode}', got 21"):
        algdiff.differentiate(np.zeros(20), 21, mode=mode)


def test_out_is_filled_in_place_whatever_its_layout() -> None:
    x = np.random.default_rng(0).standard_normal((40, 50))
    expected = algdiff.differentiate(x, 11)
    wide = np.full((80, 100), 7.0)
    layouts = [np.empty((40, 50)), np.empty((40, 50), order="F"), wide[::2, ::2], np.empty((50, 40)).T]
    layouts.append(np.zeros(8 * 2000 + 1, np.uint8)[1:].view(np.float64).reshape(40, 50))
    for out in layouts:
        assert algdiff.differentiate(x, 11, out=out) is out
        np.testing.assert_array_equal(out, expected)
    assert (wide[1::2] == 7).all()
    z = x + 1j * x
    out = np.empty((40, 50), complex)
    assert algdiff.differentiate(z, 11, out=out) is out
    np.testing.assert_array_equal(out, expected + 1j * expected)


def test_out_must_not_be_the_input() -> None:
    x = np.random.default_rng(0).standard_normal(100)
    before = x.copy()
    for out in [x, x[:], x[::-1]]:
        with pytest.raises(ValueError, match="out must not overlap x"):
            algdiff.differentiate(x, 11, out=out)
    with pytest.raises(ValueError, match="out must not overlap x"):
        algdiff.differentiate(x[:99], 11, out=x[1:])
    with pytest.raises(ValueError, match="out must have a place for every element"):
        algdiff.differentiate(x, 11, out=np.lib.stride_tricks.as_strided(np.zeros(1), (100,), (0,)))
    read_only = np.zeros(100)
    read_only.flags.writeable = False
    with pytest.raises(ValueError, match="out must be writeable"):
        algdiff.differentiate(x, 11, out=read_only)
    np.testing.assert_array_equal(x, before)


def test_a_refused_call_leaves_out_alone() -> None:
    out = np.full(100, 7.0)
    for options in [{"mode": "interp"}, {"threads": 0}, {"cval": "x"}]:
        with pytest.raises((ValueError, TypeError)):
            algdiff.Differentiator(11)(np.zeros(100), out=out, **options)  # type: ignore[arg-type]
    assert (out == 7).all()


def test_arguments_are_attributes() -> None:
    d = algdiff.Differentiator(41, 2, degree=5, kappa=0.5, mu=2, tau=0.7, delta=0.1, rule="exact")
    values = (d.window_length, d.deriv, d.degree, d.kappa, d.mu, d.tau, d.delta, d.fs, d.rule)
    assert values == (41, 2, 5, 0.5, 2.0, 0.7, 0.1, 10.0, "exact")
    assert d.weights.shape == (41,)
    assert d.noise_gain == pytest.approx((d.weights**2).sum())
    assert d.kernel == algdiff.Kernel(2, 5, 0.5, 2, 0.7)
    assert algdiff.Differentiator(41).degree == 3
    assert algdiff.Differentiator(np.int32(41), np.uint8(1), kappa=np.float32(1)).window_length == 41


def test_a_design_never_changes() -> None:
    for thing in [algdiff.Differentiator(11), algdiff.Kernel(1)]:
        with pytest.raises(AttributeError, match="does not change"):
            thing.tau = 0.3
        with pytest.raises(AttributeError):
            thing.unheard_of = 1  # type: ignore[union-attr]
        with pytest.raises(AttributeError, match="does not change"):
            del thing.tau
    d = algdiff.Differentiator(11)
    with pytest.raises(ValueError, match="read-only"):
        d.weights[0] = 1
    with pytest.raises(ValueError, match="WRITEABLE"):
        d.weights.setflags(write=True)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"tau": "root"},
        {"tau": "newest", "kappa": -0.3},
        {"delay": 0.31, "delta": 0.01},
        {"degree": 9, "mu": 2.5},
        {"rule": "trapezoid", "tau": "root"},
    ],
)
def test_designs_survive_pickling_copying_and_repr_to_the_bit(options: dict[str, Any]) -> None:
    d = design(33, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a design that was warned of is not warned of again
        twins = [pickle.loads(pickle.dumps(d)), copy.copy(d), copy.deepcopy(d)]  # noqa: S301
    twins.append(design(**eval(repr(d).replace("Differentiator", "dict"))))  # noqa: S307
    for twin in twins:
        assert twin == d
        assert hash(twin) == hash(d)
        assert twin.weights.tobytes() == d.weights.tobytes()
        assert (twin.exactness, twin.delay) == (d.exactness, d.delay)
    assert len(pickle.dumps(design(1001))) < 500
    assert d != design(34, **options)
    assert d != "a design"
    kernel = d.kernel
    assert pickle.loads(pickle.dumps(kernel)) == kernel  # noqa: S301
    assert hash(copy.copy(kernel)) == hash(kernel)


def test_replace() -> None:
    d = algdiff.Differentiator(33, tau="root", delta=0.1)
    assert d.replace() == d
    assert d.replace(delay=0.5).delay == pytest.approx(0.5)
    assert d.replace(fs=100).delta == 0.01
    # Words and defaults are those that were given, not what they came to.
    assert d.replace(degree=5, window_length=60).exactness == 6
    assert d.replace(deriv=3).degree == 5
    assert algdiff.Differentiator(21, tau="newest").replace(window_length=41).delay_samples == 0
    assert algdiff.Differentiator(21, delay=2.0).replace(delta=0.5).delay_samples == 4
    assert algdiff.Differentiator(21, delay=2.0).replace(tau=0.5).tau == 0.5
    with pytest.raises(ValueError, match="give tau or delay"):
        d.replace(tau=0.5, delay=0.5)
    with pytest.raises(TypeError, match="windw"):
        d.replace(windw=3)


def test_kernel_refuses_what_differentiator_refuses() -> None:
    for match, arguments in [
        ("deriv must be", (-1,)),
        ("degree must be at least", (2, 1)),
        ("kappa must be finite", (1, 2, -1.0)),
        ("mu must be finite", (1, 2, 0.0, NAN)),
        ("tau must be", (1, 2, 0.0, 0.0, "middle")),
    ]:
        with pytest.raises(ValueError, match=match):
            algdiff.Kernel(*arguments)
    with pytest.raises(TypeError, match="points must be real numbers"):
        algdiff.Kernel(1)(["a"])
    with pytest.raises(TypeError, match="points must be real numbers"):
        algdiff.Kernel(1)([1j])


def test_kernel_takes_points_of_any_shape() -> None:
    kernel = algdiff.Kernel(1, 2, 0, 0, "newest")
    points = np.linspace(-0.5, 1.5, 24).reshape(2, 3, 4)
    values = kernel(points)
    assert values.shape == points.shape
    # -sum over m of p_m'(1) p_m(s) in closed form: 24 - 168 s + 180 s^2 ... checked by its moments instead.
    inside = (points >= 0) & (points <= 1)
    assert not values[~inside].any()
    assert float(kernel(0.25)) == kernel([0.25])[0]
    assert np.isnan(kernel(NAN))
    assert kernel([]).shape == (0,)
    assert kernel(np.array([0, 1], np.int8)).tolist() == kernel([0.0, 1.0]).tolist()


def test_kernel_is_infinite_only_at_a_singular_end() -> None:
    kernel = algdiff.Kernel(1, 2, -0.5, 0, "newest")
    assert np.isinf(kernel(0.0))
    assert np.isfinite(kernel([1e-9, 1.0])).all()
    assert kernel.norm2 == INF


def test_none_changes_nothing_but_the_argument_itself() -> None:
    ours = algdiff.Differentiator(21, delay=3.0, fs=100.0)
    assert ours.replace(tau=None) == ours.replace(fs=None) == ours


def test_the_degree_may_reach_its_limit_without_a_warning() -> None:
    algdiff.Differentiator(16, degree=6)
    with pytest.warns(algdiff.DesignWarning, match="exceeds 1.5 sqrt"):
        algdiff.Differentiator(16, degree=7)


def test_a_warning_is_for_the_caller_even_if_that_is_named_alike() -> None:
    code = compile("make(16, degree=7)", "theirs.py", "exec")
    with pytest.warns(algdiff.DesignWarning) as caught:
        exec(code, {"__name__": "algdiff_tools", "make": algdiff.Differentiator})  # noqa: S102
    assert [each.filename for each in caught] == ["theirs.py"]
