"""What properties are tried on: any design, any samples, any call; and how often."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

import algdiff
import ladder
import reference
from ladder_naive import Window, expected
from support import design, soak

Array = npt.NDArray[Any]
INSIDE, PADS = ladder.INSIDE, ladder.PADS
RULES = ("exact", "exact", "exact", "midpoint", "cell", "trapezoid", "simpson", "hat")
LONG = 2000


def examples(count: int) -> settings:
    """Return how often a property is tried: on the same `count` cases, or with ALGDIFF_SOAK=1 on 2000 new ones."""
    return settings(
        max_examples=soak(count, max(LONG, count)),
        deadline=None,
        derandomize=soak(1, 0) == 1,
        database=None,
        print_blob=True,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
    )


class Made(NamedTuple):
    """A design, and its arguments."""

    d: algdiff.Differentiator
    words: dict[str, Any]

    def again(self, **changes: Any) -> algdiff.Differentiator:
        """Return a design of the same arguments but for some."""
        return design(**{**self.words, **changes})


exponents = st.one_of(st.sampled_from([0.0, 0.0, 1.0, 2.0]), st.floats(-0.8, 4.0))
places = st.one_of(st.sampled_from(["center", "newest", "root"]), st.floats(-0.2, 1.2))
steps = st.one_of(st.just(1.0), st.floats(1e-3, 1e3))


@st.composite
def designs(
    draw: st.DrawFn,
    *,
    rules: tuple[str, ...] = ("exact",),
    engine: str = "direct",
    least: int = 1,
    longest: int = 60,
    **fixed: Any,
) -> Made:
    """Return any design of one order; `fixed` are arguments that are said."""
    rule = draw(st.sampled_from(rules), "rule")
    nodes = rule in reference.NODES
    least = max(least, int(np.max(fixed.get("deriv", 0))) + 1)
    length = fixed.get("window_length", draw(st.integers(max(least, 1 + nodes), longest), "window_length"))
    length = length | 1 if rule == "simpson" else length
    deriv = fixed.get("deriv", draw(st.integers(0, min(4, length - 1)), "deriv"))
    highest = int(np.max(deriv))
    degree = draw(st.integers(highest, max(highest, min(highest + 3, length - 1))), "degree")
    kappa, mu = (fixed.get(name, draw(exponents, name)) for name in ("kappa", "mu"))
    if rule in ("trapezoid", "simpson"):
        kappa, mu = abs(kappa), abs(mu)
    words = {"window_length": length, "deriv": deriv, "degree": degree, "kappa": kappa, "mu": mu, "rule": rule}
    words |= {"tau": draw(places, "tau"), "delta": draw(steps, "delta"), "engine": engine}
    words |= fixed
    if isinstance(deriv, tuple):  # which have no root in common, nor a point so close to one that it counts as one
        tau = words["tau"]
        words["tau"] = round(tau, 6) if isinstance(tau, float) else tau.replace("root", "center")
    return Made(design(**words), words)


@st.composite
def samples(draw: st.DrawFn, least: int, *, more: int = 40, dtype: Any = None, shape: tuple[int, ...] = ()) -> Array:
    """Return noise of any scale and on any offset, a few samples more than the least, along the last axis."""
    kind = dtype or draw(st.sampled_from([np.float64, np.float32]), "dtype")
    rng = np.random.default_rng(draw(st.integers(0, 2**32), "seed"))
    count = least + draw(st.integers(0, more), "more")
    x = rng.standard_normal((*shape, count)) * 2.0 ** draw(st.integers(-20, 20), "scale")
    return (x + draw(st.sampled_from([0.0, 0.0, 1.0, -1e5]), "offset")).astype(kind)


def window(made: Made, order: int | None = None) -> Window:
    """Return the naive twin of one order of a design that is not trimmed."""
    words = made.words
    deriv = words["deriv"] if order is None else order
    rest = (words["degree"], words["kappa"], words["mu"], words["tau"], words["rule"], words["delta"])
    return Window(words["window_length"], deriv, *rest, 0, words["window_length"], 0.0)


def off(made: Made, x: Array, mode: str = "valid", order: int | None = None, cval: float = 0.0) -> Array:
    """Return how far rounding may take each estimate of a row, or of rows; see `ladder_naive`."""
    rows = np.asarray(x, float).reshape(-1, x.shape[-1])
    engine = made.d.engine_for(x.dtype)
    _, allowed = expected(window(made, order), rows, mode, cval, engine, x.dtype in (np.float32, np.complex64))
    return allowed.reshape(*x.shape[:-1], -1)


def close(a: Array, b: Array, allowed: Array | float) -> None:
    """Assert that two arrays are NaN at the same places and elsewhere as near as is allowed."""
    assert a.shape == b.shape
    np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
    error = np.abs(np.nan_to_num(a.astype(complex) - b.astype(complex)))
    assert (error <= allowed).all(), f"{np.max(error / np.maximum(allowed, 5e-324)):.3g} bounds"


def same(a: Array, b: Array) -> None:
    """Assert that two arrays have the same bits; one NaN is as good as another, and one zero as the other."""
    assert (a.shape, a.dtype) == (b.shape, b.dtype)
    np.testing.assert_array_equal(a, b)
