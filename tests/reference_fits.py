"""The readable twin of estimates that are fits of their own: gaps, uneven times, own weights.

It is written from the definition alone. Every estimate is a derivative, at one point, of the polynomial of `degree`
fitted by weighted least squares to the samples of its window that are there: `Twin.windows` says where the windows lie,
and `Twin.output` fits one, by the pseudo-inverse of its weighted Legendre matrix, which gives its weights. Places are
`s` in [0, 1], as in `reference.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

import algdiff
import reference
from support import EPS, sum_bound

Array = npt.NDArray[np.float64]
MAX_GAIN = 100.0
resolve_tau = cache(reference.resolve_tau)


class Window(NamedTuple):
    """Samples of a row by index, the constants before and after it being -2 and -1, their places and the estimate's."""

    index: npt.NDArray[np.int64]
    s: Array
    at: float
    half: float
    duration: float
    sliding: bool = False


class Output(NamedTuple):
    """One estimate per order, the weights of the samples of the window, and what is known of them."""

    estimate: Array
    weights: Array
    support: int
    gain: Array
    bias: Array
    bias_weights: Array
    condition: float
    loss: float
    samples: Array


def density(s: npt.ArrayLike, half: float, exponent: float) -> Array:
    """Return s^e, or for a negative exponent its mean over the cell around s as far as that lies in [0, infinity)."""
    s = np.maximum(s, 0.0)
    if exponent >= 0:
        return np.asarray(s**exponent)
    low, high, e = s - half, s + half, exponent + 1
    low = np.where(low > 1e-9 * half, low, 0.0)  # a cell that begins at the end of the window but for rounding does
    return np.asarray((high**e - low**e) / (e * (high - low)))


def fit_weights(s: Array, root: Array, degree: int, order: int, at: float) -> tuple[Array, float]:
    """Return the weights of the derivative at `at` of the fit to samples at `s`, whose weights have the square `root`.

    The basis are the Legendre polynomials on the range of these samples, so that a lone cluster costs no
    digits. Several do: the condition number of the matrix comes along.
    """
    middle, half = (s.min() + s.max()) / 2, (s.max() - s.min()) / 2 or 1.0
    matrix = legendre.legvander((s - middle) / half, degree) * root[:, None]
    u, singular, vt = np.linalg.svd(matrix, full_matrices=False)
    coefficients = vt.T / singular @ u.T * root  # of the unit samples: the pseudo-inverse
    derived = legendre.legder(np.eye(degree + 1), order) if order else np.eye(degree + 1)
    weights = legendre.legval((at - middle) / half, derived) / half**order @ coefficients
    return weights, float(singular[0] / singular[-1])


@dataclass(frozen=True)
class Twin:
    """A call in the words of the library; the samples of a row come later."""

    length: int
    orders: tuple[int, ...]
    degree: int
    kappa: float
    mu: float
    tau: float | str
    delta: float = 1.0
    mode: str = "fit"
    cval: float = 0.0
    trim: float = 0.0
    t: Array | None = None
    at: Array | None = None
    duration: float | None = None
    shrink: bool = False
    min_support: int | None = None
    max_gain: float | None = None
    weights: Array | None = None

    @property
    def point(self) -> float:
        """The point of estimation as a number."""
        return self.root(self.orders[0])[0]

    def root(self, order: int) -> tuple[float, bool]:
        """Return tau as a number, and whether it is a root."""
        return resolve_tau(self.length, order, self.degree, self.kappa, self.mu, self.tau)

    @property
    def kept(self) -> slice:
        """The samples of the window that trimming leaves: at either end it takes at most its share of the sizes."""
        if self.trim == 0:
            return slice(0, self.length)
        sizes = np.abs(reference.weights(self.length, self.orders[0], self.degree, self.kappa, self.mu, self.tau))
        share = self.trim * sizes.sum()
        oldest, newest = (int(np.sum(np.cumsum(part) <= share)) for part in (sizes, sizes[::-1]))
        return slice(oldest, self.length - newest)

    @property
    def least(self) -> int:
        """Samples that a window must hold."""
        return self.degree + 1 if self.min_support is None else self.min_support

    def aligned(self, length: int) -> int:
        """Return the sample of a window on which its estimate lies, counted from its oldest one with a weight."""
        position = self.point * length - 0.5 - (self.kept.start if length == self.length else 0)
        return math.floor(position + 0.5 + 1e-9 * max(1.0, abs(position)))

    # Where windows lie.

    def windows(self, n: int) -> list[Window | None]:
        """Return the window of every output, None where there is none."""
        if self.t is not None and self.duration is not None:
            return [self.lasting(time) for time in (self.t if self.at is None else self.at)]
        if self.at is not None:
            times = self.delta * np.arange(n) if self.t is None else self.t
            return [self.around(times, time) for time in self.at]
        count = self.kept.stop - self.kept.start
        if self.mode == "valid":
            return [self.counted(n, start, count, self.length, None) for start in range(n - count + 1)]
        return [self.of_sample(n, i) for i in range(n)]

    def of_sample(self, n: int, i: int) -> Window | None:
        """Return the window of output i."""
        count, length = self.kept.stop - self.kept.start, self.length
        start = i - self.aligned(length)
        if self.mode in reference.PAD_MODES or 0 <= start <= n - count:
            return self.counted(n, start, count, length, i)
        if self.mode == "nan":
            return None
        if self.shrink:
            least = min(max(self.least, 2 * self.degree + 1), length)
            while length >= least + 2:
                length -= 2
                start = i - math.floor(self.point * length + 1e-9)
                if 0 <= start <= n - length:
                    return self.counted(n, start, length, length, i)
            start, count = i - math.floor(self.point * length + 1e-9), length
        return self.counted(n, min(max(start, 0), n - count), count, length, i, sliding=False)

    def counted(self, n: int, start: int, count: int, length: int, i: int | None, *, sliding: bool = True) -> Window:
        """Return `count` samples from `start` on, of a window of `length`, with the estimate at sample i or at tau."""
        first = self.kept.start if length == self.length else 0
        if self.t is not None:
            a, b = self.t[start], self.t[start + count - 1]
            step = (b - a) / (count - 1) if count > 1 else 1.0
            place = (np.append(self.t[start : start + count], self.t[i or 0]) - a + step / 2) / (step * count)
            at = self.point if i is None else float(place[-1])
            return Window(np.arange(start, start + count), place[:-1], at, 0.5 / count, step * count)
        s = (np.arange(count) + first + 0.5) / length
        at = self.point if i is None else (i - start + first + 0.5) / length
        # A design whose tau lies on a sample but for rounding lies on it.
        at = self.point if abs(at - self.point) * length <= 1e-9 * max(1.0, abs(at) * length) else at
        indices = np.arange(start, start + count)
        if self.mode in reference.PAD_MODES and not 0 <= start <= n - count:
            before, after = max(0, -start), max(0, start + count - n)
            options = {"constant_values": (-2, -1)} if self.mode == "constant" else {}
            padded = np.pad(np.arange(n), (before, after), reference.PAD_MODES[self.mode], **options)  # type: ignore[call-overload]
            indices = padded[start + before : start + before + count]
        whole = sliding and length == self.length and self.weights is None
        return Window(indices, s, at, 0.5 / length, self.delta * length, whole)

    def around(self, times: Array, time: float) -> Window | None:
        """Return the window of the sample nearest to a time."""
        distance = np.abs(times - time)
        nearest = int(np.flatnonzero(distance == distance.min())[-1])
        window = Twin(**{**self.__dict__, "at": None, "t": times}).of_sample(len(times), nearest)
        if window is None:
            return None
        a = times[window.index[0]]
        step = window.duration / len(window.index)
        return window._replace(at=float((time - a + step / 2) / window.duration))

    def lasting(self, time: float) -> Window | None:
        """Return the window of a duration, shifted into the data and half a usual step around them."""
        assert self.t is not None
        assert self.duration is not None
        pad, span = 0.5 * float(np.median(np.diff(self.t))), self.duration
        start = time - self.point * span
        if self.mode == "nan" and not self.t[0] - pad <= start <= self.t[-1] + pad - span:
            return None
        start = min(max(start, self.t[0] - pad), self.t[-1] + pad - span)
        index = np.flatnonzero((self.t >= start) & (self.t <= start + span))
        return Window(index, (self.t[index] - start) / span, float((time - start) / span), pad / span, span)

    # What is made of their samples.

    def output(self, x: Array, window: Window, *, beyond: int | None = None) -> Output:
        """Return the estimates of one window of a row, NaN where they are refused."""
        samples = np.append(x, [self.cval] * 2)[window.index]
        used = ~np.isnan(samples)
        missing = not used.all()
        own = np.ones(len(samples))
        if self.weights is not None:  # a constant weighs as much as the sample next to it
            own = np.append(self.weights, self.weights[[0, -1]])[window.index]
        used &= own > 0
        support, s = int(used.sum()), window.s[used]
        weight = density(s, window.half, self.kappa) * density(1 - s, window.half, self.mu) * own[used]
        weights, further = (np.full((len(self.orders), len(samples)), np.nan) for _ in range(2))
        condition = 1.0
        gain = np.full(len(self.orders), np.nan)
        limit = (MAX_GAIN if missing else math.inf) if self.max_gain is None else self.max_gain
        if window.sliding and not missing:  # that is the window which gains are compared with
            limit = math.inf
        if support >= self.least:
            for k, order in enumerate(self.orders):
                unit = window.duration**order
                degree = self.degree
                if window.sliding and not missing and self.root(order)[1]:
                    degree = min(degree + 1, max(degree, len(samples) - 1))
                for part, fit_degree in [(weights, degree), (further, beyond)]:
                    if fit_degree is not None and support > fit_degree:
                        part[k] = 0.0
                        fitted, number = fit_weights(s, np.sqrt(weight), fit_degree, order, window.at)
                        part[k, used], condition = fitted / unit, max(condition, number)
                if limit < math.inf:
                    gain[k] = np.sum(weights[k] ** 2) / np.sum((self.evenly(order, window.at) / unit) ** 2)
        allowed = np.where(np.isnan(gain) | (gain <= limit), 1.0, np.nan)
        allowed[:] = allowed if support else np.nan
        values = np.where(used, samples, 0.0)
        estimate = weights @ values * allowed
        bias = estimate - further @ values
        return Output(
            estimate, weights, support, gain / limit, bias, further, condition, self.loss(window, used), samples[used]
        )

    def loss(self, window: Window, used: npt.NDArray[np.bool_]) -> float:
        """Return by what a fit loses if it is that of the whole even window with samples taken out.

        On the polynomials that are orthonormal on the whole window its system is G = I - Q_gone^T Q_gone, which
        amplifies rounding by the norm of its inverse. The library fits anew where a pivot of G falls below 1e-3.
        """
        if self.t is not None or self.weights is not None or used.all() or used.sum() <= self.degree:
            return 1.0
        weight = density(window.s, window.half, self.kappa) * density(1 - window.s, window.half, self.mu)
        q = np.linalg.qr(legendre.legvander(2 * window.s - 1, self.degree) * np.sqrt(weight)[:, None])[0]
        return float(min(np.linalg.norm(q[used], -2) ** -2, 1e3))

    def evenly(self, order: int, at: float) -> Array:
        """Return the weights for T = 1 of the whole window, evenly filled."""
        s, half = ((np.arange(self.length) + 0.5) / self.length)[self.kept], 0.5 / self.length
        weight = density(s, half, self.kappa) * density(1 - s, half, self.mu)
        return fit_weights(s, np.sqrt(weight), self.degree, order, at)[0]


# Cases, and how they are compared.


def random_words(rng: np.random.Generator, *, several: bool = False, longest: int = 80) -> dict[str, Any]:
    """Return the keywords of a random design; `several` orders of it now and then."""
    deriv: Any = int(rng.integers(0, 4))
    if several and rng.random() < 0.3:
        deriv = [(0, 1), (0, 1, 2), (2, 1), (1, 3)][rng.integers(4)]
    highest = int(np.max(deriv))
    degree = highest + int(rng.integers(0, 4))
    words: dict[str, Any] = {"deriv": deriv, "degree": degree}
    words["window_length"] = max(5, degree + 1 + int(np.exp(rng.uniform(0, np.log(longest - degree)))))
    words["kappa"], words["mu"] = (float(rng.choice([0, 0, 1, 1, 2.5, -0.5, 3, -0.3, 0.7])) for _ in range(2))
    words["tau"] = ["center", "newest", "root", 0.5, 0.3, float(rng.uniform()), 1.2, -0.15][rng.integers(8)]
    if words["tau"] == "root" and not isinstance(deriv, int):
        words["tau"] = "newest"
    return words


def twin(words: dict[str, Any], **options: Any) -> Twin:
    """Return the twin of a call with these keywords."""
    names = {"window_length": "length", "deriv": "orders", "window_duration": "duration", "edge_window": "shrink"}
    given = {names.get(name, name): value for name, value in {**words, **options}.items()}
    given["orders"] = tuple(np.atleast_1d(given["orders"]).tolist())
    given["shrink"] = given.get("shrink") == "shrink"
    return Twin(**given)


def by_order(part: Any, one: Twin) -> Any:
    """Return a result with a leading axis over the orders."""
    return None if part is None else np.reshape(part, (len(one.orders), -1))


def assert_fits(one: Twin, x: Array, found: algdiff.Estimates, only: Any, beyond: int | None = None) -> int:
    """Compare a row of results with the twin's; return how many of the estimates were numbers.

    They must agree to 1e-9 of sum|w| max|x|, by about an eps of which rounding moves an estimate, or by as many eps of
    it as the matrix of the twin has condition: that many are lost, which is more for a few windows of clusters.
    """
    windows, numbers = one.windows(len(x)), 0
    estimate, bias = by_order(found.estimate, one), by_order(found.bias, one)
    assert estimate.shape[1] == len(windows)
    for i in only:
        window = windows[i]
        if window is None:
            assert np.isnan(estimate[:, i]).all(), i
            assert found.support is None or found.support[i] == 0, i
            continue
        wanted = one.output(x, window, beyond=beyond)
        assert found.support is None or found.support[i] == wanted.support, (i, found.support[i], wanted.support)
        size = max(1e-9, 4 * EPS * wanted.condition) * float(np.abs(wanted.samples).max(initial=0.0))
        margin = size * np.abs(wanted.weights).sum(axis=1)
        more = margin + size * np.abs(wanted.bias_weights).sum(axis=1)
        decided = np.abs(wanted.gain - 1) >= 1e-6 if np.isfinite(wanted.gain).all() else [True] * len(estimate)
        for got, value, allowed in [(estimate, wanted.estimate, margin), (bias, wanted.bias, more)]:
            if got is not None:
                error = np.abs(got[:, i] - value)
                good = (error <= allowed) | (np.isnan(got[:, i]) & np.isnan(value))
                assert good[decided].all(), (i, got[:, i], value, error / allowed, window)
        numbers += int(np.isfinite(wanted.estimate).sum())
    return numbers


class Polynomial:
    """A random polynomial on times, in long double: what comes back from its samples is known."""

    def __init__(self, rng: np.random.Generator, degree: int, t: Array) -> None:
        self.coefficients = rng.standard_normal(degree + 1)
        self.middle, self.half = np.longdouble(t[0]) / 2 + np.longdouble(t[-1]) / 2, np.longdouble(np.ptp(t)) / 2

    def __call__(self, t: npt.ArrayLike, order: int = 0) -> Any:
        """Return its derivative."""
        derived = legendre.legder(self.coefficients.astype(np.longdouble), order) if order else self.coefficients
        return legendre.legval((np.asarray(t, np.longdouble) - self.middle) / self.half, derived) / self.half**order


def assert_exact(one: Twin, x: Array, estimate: Array, p: Polynomial, t: Array, only: Any, eps: float = EPS) -> int:
    """Compare estimates from samples x = p(t) of a polynomial with its derivatives; return how many were numbers.

    The library's weights reproduce polynomials on the very places it works with, to some eps of sum|w| max|x|; their
    sum with the samples errs by `sum_bound`, as does what is left of the samples' own rounding. Those places, and the
    point of the estimate, lie off by a few eps of their distance from the first sample, that is of max|t - t_0|, which
    moves the samples by as much as the slope of p makes of it. `sum_bound` counts length + 8 eps; a design may add 64,
    see `test_weights`; and `Twin.loss` says what taking samples out of it costs.
    """
    windows, numbers, distance = one.windows(len(x)), 0, float(np.ptp(t))
    times = t if one.at is None else one.at
    assert estimate.shape[1] == len(windows)
    for i in only:
        window = windows[i]
        if window is None:
            assert np.isnan(estimate[:, i]).all(), i
            continue
        wanted, place = one.output(x, window), times[min(i, len(times) - 1)]
        if one.mode == "valid":
            place = t[window.index[0]] + (window.at - window.s[0]) * np.longdouble(window.duration)
        size, slope = np.abs(wanted.weights).sum(axis=1), float(np.abs(p(t[window.index], 1)).max(initial=0))
        there = ~np.isnan(x[window.index])
        for k, order in enumerate(one.orders):
            if abs(wanted.gain[k] - 1) < 1e-6:
                continue
            if np.isnan(wanted.estimate[k]):
                assert np.isnan(estimate[k, i]), (i, order, estimate[k, i], window)
                continue
            true, weights = p(place, order), wanted.weights[k][there]
            bound = sum_bound(weights, wanted.samples, eps)
            bound += sum_bound(weights, wanted.samples) * (64 / len(weights) + wanted.loss)
            bound += 8 * EPS * size[k] * slope * distance + eps * float(abs(true))
            error = abs(float(estimate[k, i] - true))
            assert error <= bound, (i, order, estimate[k, i], true, error / bound, window)
            numbers += 1
    return numbers
