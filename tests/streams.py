"""Samples pushed in random pieces and forms, streams sent through what must not change them, and designs for both."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from algdiff import Differentiator, Estimates, Stream
from reference_fits import Twin, Window
from support import design

Array = npt.NDArray[Any]
Generator = np.random.Generator

ON_NODES = ("trapezoid", "simpson", "hat")
CLOSE = 1e-9
POINTS: tuple[float | str, ...] = ("center", "newest", "root", 0.5, 0.3, 1.2, -0.1)

SENT: dict[str, Callable[[Stream], Stream]] = {
    "pickle": lambda stream: pickle.loads(pickle.dumps(stream)),  # noqa: S301
    "JSON": lambda stream: Stream.from_state(json.loads(json.dumps(stream.state, allow_nan=False))),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "method": Stream.copy,
}


def random_design(rng: Generator, *, longest: int = 300, exact: bool = False, **words: Any) -> Differentiator:
    """Return any design, or if `exact` one whose shorter and uneven windows are known; but for what `words` say."""
    while True:
        length = int(np.exp(rng.uniform(0, np.log(longest + 0.999))))
        several = rng.random() < 0.4
        deriv = [(0, 1), (0, 1, 2), (2, 1), (3,)][rng.integers(4)] if several else int(rng.integers(0, 4))
        degree = int(np.max(deriv)) + int(rng.integers(0, 4))
        made: dict[str, Any] = {"degree": degree, "delta": float(rng.choice([1.0, 0.01, 3.0]))}
        made["kappa"], made["mu"] = (float(rng.choice([0, 0, 1, 1, 2, 0.7, -0.3])) for _ in range(2))
        made["tau"] = POINTS[rng.integers(len(POINTS) if not several else 2)]
        if not exact and rng.random() < 0.3:
            made["rule"] = rng.choice(["trapezoid", "midpoint", "simpson", "cell", "hat"])
        if not exact and not several and rng.random() < 0.2:
            made["trim"] = float(rng.choice([0.003, 0.03]))
        if rng.random() < 0.3:
            del made["tau"]
            made["delay"] = float(rng.choice([0.0, 1.5, -0.8, 0.4 * length]) * made["delta"])
        try:
            return design(length, deriv, **{**made, **words})
        except ValueError:  # the window is too short for the degree or the rule, or a rule refuses the exponents
            continue


def random_samples(rng: Generator, n: int, channels: int | None, dtype: npt.DTypeLike = np.float64) -> Array:
    """Return n samples; now and then whole ones, far from 0, or with NaN and infinities."""
    x = rng.standard_normal(n if channels is None else (n, channels))
    kind = rng.integers(5)
    if kind == 0:
        x = np.rint(50 * x)
    elif kind == 1:
        x += 1e6
    elif kind == 2:
        x[rng.random(x.shape) < 2 / max(n, 1)] = np.nan
        x[rng.random(x.shape) < 1 / max(n, 1)] = rng.choice([np.inf, -np.inf])
    return x.astype(dtype)


def one_of(rng: Generator, forms: Sequence[Any]) -> Any:
    return forms[rng.integers(len(forms))]


def in_any_form(rng: Generator, x: Array) -> Any:
    """Return the same numbers in a form in which a caller may hold them."""
    forms = [x, x, x.astype(">f8"), np.repeat(x[..., None], 2, -1)[..., 0], np.asfortranarray(x)]
    forms += [x.tolist()] if x.size else []  # an empty list has no channels
    if x.ndim == 0:
        forms = [float(x), float(x), x[()], x]
    if np.isfinite(x).all() and (x == np.rint(x)).all():
        forms += [x.astype(np.int32)[()]] + ([x.astype(np.int32).tolist()] if x.size else [])
    return one_of(rng, forms)


def pushed(
    stream: Stream,
    x: Array,
    rng: Generator,
    *,
    t: Array | None = None,
    ways: Sequence[str] = (),
    longest: int = 1000,
    **more: bool,
) -> tuple[Stream, Any]:
    """Push samples one by one and in blocks; return the stream at the end, and all results as of one block.

    On the way the stream goes through some of `ways`.
    """
    parts: list[Any] = []
    start = 0
    while start < len(x) or not parts:
        if ways and rng.random() < 0.3:
            stream = SENT[one_of(rng, ways)](stream)
        if start < len(x) and rng.random() < 0.5:
            time = {} if t is None else {"t": in_any_form(rng, t[start])}
            found, start = stream.push(in_any_form(rng, x[start]), **time, **more), start + 1
            axis = -1 if stream.channels is None else -2
            found = found if isinstance(found, Estimates) else Estimates(found)
            parts.append([None if part is None else np.expand_dims(part, axis) for part in found])
        else:
            stop = min(len(x), start + int(rng.random() < 0.9) * int(np.exp(rng.uniform(0, np.log(longest)))))
            time = {} if t is None else {"t": in_any_form(rng, t[start:stop])}
            found, start = stream.push(in_any_form(rng, x[start:stop]), **time, **more), stop
            parts.append(list(found if isinstance(found, Estimates) else Estimates(found)))
    axis = -1 if stream.channels is None else -2
    # A single number comes back as a Python float.
    joined = [None if part[0] is None else np.concatenate(part, axis=axis) for part in zip(*parts, strict=True)]
    joined[:2] = [None if part is None else part.astype(stream.dtype) for part in joined[:2]]
    return stream, Estimates(*joined) if more else joined[0]


def same_bits(a: Array, b: Array) -> None:
    """Assert that two arrays are equal to the bit; one NaN is as good as another."""
    assert (a.shape, a.dtype) == (b.shape, b.dtype)
    np.testing.assert_array_equal(a, b)
    numbers = ~np.isnan(a)
    assert a[numbers].tobytes() == b[numbers].tobytes()


def windows(one: Differentiator, x: Array, **call: Any) -> Array:
    """Return the estimates of whole windows as a stream gives them: for every order, NaN before the first window."""
    span = one.weights.shape[-1]
    out = np.full((len(one.orders), *x.shape), np.nan, x.dtype)
    if len(x) >= span:
        valid = one.replace(engine="direct")(x, axis=0, mode="valid", **call)
        out[:, span - 1 :] = valid if isinstance(one.deriv, tuple) else valid[None]
    return out


# Fits.


def stamps(rng: Generator, n: int) -> Array:
    """Return n times that are clearly uneven."""
    steps = rng.uniform(0.3, 2.0, n) if rng.random() < 0.5 else 10 ** rng.uniform(-1, 1, n)
    return np.asarray(rng.choice([0.0, -5.0, 1e3]) + np.cumsum(steps * 10.0 ** rng.integers(-2, 2)))


def gaps(rng: Generator, x: Array, longest: int) -> Array:
    """Return x without some samples here and there, and without a run of them."""
    x = np.where(rng.random(x.shape) < rng.choice([0, 0.1, 0.4]), np.nan, x).astype(x.dtype)
    start = int(rng.integers(len(x)))
    x[start : start + int(rng.integers(0, longest))] = np.nan
    return x


def by_order(part: Any, orders: int, x: Array) -> Array:
    """Return a result with axes over the orders, the samples and the channels."""
    return np.reshape(part, (orders, len(x), -1))


class Lone:
    """One window by the definition: its estimate at the design's tau, or `delay` before its newest sample.

    While it grows the estimate does not lie before the oldest sample. At a root of the design, even windows are fitted
    with one more degree, as those of the shorter design are.
    """

    def __init__(self, one: Differentiator, times: Array, delay: float | None, *, even: bool) -> None:
        n = len(times)
        step = (times[-1] - times[0]) / (n - 1) if n > 1 else one.delta
        start, self.at = times[0] - step / 2, one.tau
        if delay is not None:
            newest = times[-1] - delay
            self.at = ((newest if n == one.window_length else max(newest, times[0])) - start) / (step * n)
        self.time = start + self.at * step * n
        self.one, self.full = one, n == one.window_length
        own = even and (self.full or delay is None)
        self.at = one.tau if own else self.at
        self.window = Window(np.arange(n), (times - start) / (step * n), self.at, 0.5 / n, step * n, own)

    def assert_same(self, found: Array, std: Array, x: Array, eps: float, **limits: Any) -> int:
        """Compare the estimates from one channel; return how many were numbers.

        The twin loses as many eps as its matrix has condition.
        """
        one, words = self.one, {"degree": self.one.degree, "kappa": self.one.kappa, "mu": self.one.mu, "tau": self.at}
        if not self.full:  # of what would the noise gain be a multiple?
            limits["max_gain"] = np.inf
        twin = Twin(one.window_length, tuple(single.deriv for single in one.orders), **words, **limits)
        wanted = twin.output(x.astype(float), self.window)
        lost = max(CLOSE, 1e-15 * wanted.condition)
        sizes, norms = np.abs(wanted.weights).sum(axis=1), np.linalg.norm(wanted.weights, axis=1)
        allowed = (lost + eps) * sizes * np.ptp(wanted.samples) if wanted.support else sizes
        undecided = np.abs(wanted.gain - 1) < 1e-6
        good = np.abs(found - wanted.estimate) <= allowed + (lost + eps) * np.abs(wanted.estimate)
        assert (good | undecided | (np.isnan(found) & np.isnan(wanted.estimate))).all(), (one, found, wanted.estimate)
        np.testing.assert_array_equal(np.isnan(std), np.isnan(found))
        numbers = ~np.isnan(found)
        np.testing.assert_allclose(std[numbers], norms[numbers], rtol=lost + eps)
        return int(numbers.sum())


def given(rng: Generator, longest: int) -> tuple[Any, list[Differentiator], float | None, dict[str, Any]]:
    """Return what a stream is of, its designs, the delay of growing and uneven windows, and it as an option."""
    if rng.random() < 0.4:
        tau = ["center", "newest", "root", 0.3, 0.9, 1.1][rng.integers(6)]
        one = random_design(rng, longest=longest, exact=True, tau=tau, delay=None)
        return one, [one], 0.0 if tau == "newest" else None, {}
    words: dict[str, Any] = {"tau": None, "delta": float(rng.choice([1.0, 0.5]))}
    words["delay"] = delay = float(rng.choice([0.0, 2.0, 3.25, -0.8]) * words["delta"])
    designs = [random_design(rng, longest=longest, exact=True, **words) for _ in range(rng.integers(1, 4))]
    if rng.random() < 0.3:
        return designs[0].replace(tau=0.5), [designs[0]], delay, {"delay": delay}
    if len(designs) > 1 and rng.random() < 0.5:
        designs[0] = designs[0].replace(tau=designs[0].tau)  # several designs go by their delay, however they were made
    return (designs if len(designs) > 1 else designs[0]), designs, delay, {}
