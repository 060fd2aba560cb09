"""The peers in accuracy: who else differentiates noisy samples, how each is tuned, and what the tuning is told."""

from __future__ import annotations

import warnings
from functools import partial
from importlib import import_module
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy import interpolate, signal

import algdiff

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    Samples = NDArray[np.float64]

HERTZ = 1.0
NOTHING, BANDWIDTH, TRUTH_0, TRUTH = "nothing", f"bandwidth {HERTZ:g} Hz", "the truth of seed 0", "the truth"
TOLD = (NOTHING, BANDWIDTH, TRUTH_0, TRUTH)
OURS, LOCAL = "algdiff", "algdiff, local=True"
SLOW = ("waveletdiff", "rtsdiff", "polydiff")
TUNED = ("savgoldiff", "butterdiff", "splinediff", "spectraldiff", "kerneldiff", "finitediff", *SLOW)
NOT_TRIED = (
    # Measured once, with PyNumDiff 0.3 and CVXPY.
    "PyNumDiff tvrdiff, robustdiff, lineardiff, smooth_acceleration (these need CVXPY) and rbfdiff: not tried here, as "
    "their tuning did not end in 150 s when it was; told the truth of seed 0, robustdiff then had 0.040 on the core "
    "and 0.176 over all samples"
)


class Problem(NamedTuple):
    """Noisy samples, a row for every seed, and what the estimates are compared with."""

    rows: Samples
    truth: Samples
    delta: float
    core: slice

    def errors(self, estimates: Samples) -> tuple[Samples, Samples]:
        """Return the root mean square errors of each row, on the core and over all samples."""
        squares = (estimates - self.truth) ** 2
        return np.sqrt(squares[:, self.core].mean(axis=1)), np.sqrt(squares.mean(axis=1))

    def estimates(self, call: Callable[[Samples], Samples]) -> Samples:
        """Differentiate every row by itself."""
        found = np.stack([np.asarray(call(row), dtype=float) for row in self.rows])
        if found.shape != self.rows.shape or not np.isfinite(found).all():
            raise ValueError(f"expected {self.rows.shape} finite estimates, got {found.shape}")
        return found

    def first(self) -> Problem:
        """Return the problem of the first seed."""
        return self._replace(rows=self.rows[:1])


class Peer(NamedTuple):
    """A differentiator: `call` takes the samples of one signal and what `tune` found.

    `chooses` says that the call itself sets its parameters; `slow`, that tuning takes more than some 7 s.
    """

    name: str
    told: str
    call: Callable[..., Samples]
    given: dict[str, Any] = {}  # noqa: RUF012
    tune: Callable[[Problem], dict[str, Any]] | None = None
    chooses: bool = False
    slow: bool = False


def peers(problem: Problem) -> tuple[list[Peer], list[str]]:
    """Return the peers, and what is not installed."""
    found, absent = [*_ours(problem), *_scipy(problem)], []
    for library, make in (("pynumdiff", _pynumdiff), ("derivative", _derivative)):
        try:
            found += make(problem)
        except ImportError as error:
            absent.append(f"{library}: not installed ({error})")
    return found, absent


def grid(
    call: Callable[..., Samples], criterion: str = "core", **choices: Iterable[Any]
) -> Callable[[Problem], dict[str, Any]]:
    """Return a tuner that tries all combinations of the choices and knows the truth."""

    def tune(problem: Problem) -> dict[str, Any]:
        def error(parameters: dict[str, Any]) -> float:
            core, everything = problem.errors(problem.estimates(partial(call, **parameters)))
            return float((core if criterion == "core" else everything).mean())

        return min((dict(zip(choices, values, strict=True)) for values in product(*choices.values())), key=error)

    return tune


def _ours(problem: Problem) -> list[Peer]:
    call = partial(algdiff.differentiate, delta=problem.delta)
    return [
        Peer(OURS, NOTHING, call, chooses=True),
        Peer(LOCAL, NOTHING, partial(call, local=True), chooses=True),
    ]


def _scipy(problem: Problem) -> list[Peer]:
    times = problem.delta * np.arange(len(problem.truth))

    def savgol(x: Samples, window_length: int, polyorder: int) -> Samples:
        result: Samples = signal.savgol_filter(x, window_length, polyorder, deriv=1, delta=problem.delta)
        return result

    def spline(x: Samples) -> Samples:
        result: Samples = interpolate.make_smoothing_spline(times, x)(times, nu=1)
        return result

    choices: dict[str, Any] = {"window_length": range(11, 402, 2), "polyorder": range(2, 9)}
    best = [
        Peer(f"savgol_filter, best {where}", TRUTH, savgol, tune=grid(savgol, criterion, **choices))
        for criterion, where in (("core", "on the core"), ("all", "over all"))
    ]
    return [
        *best,
        Peer("savgol_filter, a guess", NOTHING, savgol, {"window_length": 61, "polyorder": 3}),
        Peer("make_smoothing_spline (GCV)", NOTHING, spline, chooses=True),
        Peer("np.gradient", NOTHING, lambda x: np.gradient(x, problem.delta)),
    ]


def _pynumdiff(problem: Problem) -> list[Peer]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # CVXPY is not installed, and not needed
        library: Any = import_module("pynumdiff")
        optimize: Any = import_module("pynumdiff.optimize").optimize

    def call(name: str, x: Samples, **parameters: Any) -> Samples:
        result: Samples = getattr(library, name)(x, problem.delta, **parameters)[1]
        return result

    def tune(name: str, tuned: Problem, truth: bool = False) -> dict[str, Any]:
        told = {"dxdt_truth": tuned.truth} if truth else {"bandlimit": HERTZ}
        found: dict[str, Any] = optimize(getattr(library, name), tuned.rows[0], tuned.delta, parallel=False, **told)[0]
        return found

    truth = Peer("PyNumDiff savgoldiff (truth)", TRUTH_0, partial(call, "savgoldiff"))
    return [
        truth._replace(tune=partial(tune, "savgoldiff", truth=True)),
        *(
            Peer(f"PyNumDiff {name}", BANDWIDTH, partial(call, name), tune=partial(tune, name), slow=name in SLOW)
            for name in TUNED
        ),
    ]


def _derivative(problem: Problem) -> list[Peer]:
    library: Any = import_module("derivative")
    times = problem.delta * np.arange(len(problem.truth))

    def savgol(x: Samples, half: float, order: int) -> Samples:
        return made("savitzky_golay", x, left=half, right=half, order=order)

    def made(kind: str, x: Samples, **parameters: Any) -> Samples:
        result: Samples = library.dxdt(x, times, kind=kind, axis=0, **parameters)
        return result

    spline, kalman, kernel = (partial(made, kind) for kind in ("spline", "kalman", "kernel"))
    kernels = grid(kernel, sigma=(0.3, 0.4, 0.5, 0.6, 0.8), lmbd=(3e-4, 1e-3, 3e-3, 1e-2, 3e-2))
    levels = [float(f"{level:.2g}") for level in np.geomspace(1.5, 4.0, 12)]
    halves = (0.25, 0.3, 0.4, 0.5, 0.6, 0.7)
    name = "derivative {}".format
    return [
        Peer(name("spline"), TRUTH, spline, tune=grid(spline, s=levels, order=(3, 4, 5))),
        Peer(name("savitzky_golay"), TRUTH, savgol, tune=grid(savgol, half=halves, order=(3, 4, 5, 6)), slow=True),
        Peer(name("kalman"), TRUTH, kalman, tune=grid(kalman, alpha=(1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1)), slow=True),
        Peer(name("kernel"), TRUTH_0, kernel, tune=lambda tuned: kernels(tuned.first()), slow=True),
    ]
