"""Call every public method of the AlgDiff toolbox's class, or of one that stands in for it, and list what it says.

Run it by a Python that has the toolbox (PyPI `algdiff` 2.4), never by one that has this library, and it prints as JSON
what the toolbox says. It uses nothing of this project.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import json
import math
import re
import tempfile
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

# ts, alpha, beta, N, T, theta (None: the toolbox's choice) and whether it is a root, corr. Steps and windows are exact
# in binary, for the toolbox truncates T / ts, and windows even and odd, for it shifts one of them.
GRID: dict[str, tuple[float, float, float, int, float, float | None, bool, bool]] = {
    "even": (1 / 32, 2.0, 2.0, 0, 0.5, None, True, True),
    "odd": (1 / 32, 3.0, 2.0, 1, 17 / 32, None, True, False),
    "no delay": (1 / 32, 2.5, 2.5, 1, 0.5625, 1.0, False, True),
    "prediction": (1 / 32, 2.0, 4.25, 2, 0.625, 1.1, False, True),
    "fine": (1 / 64, 4.0, 5.0, 2, 0.375, None, True, True),
}
METHODS = ["mid-point", "trapezoidal", "analytic", "analytic trapezoidal"]
OTHERS = ["euler", "simpson rule", "simpson 3/8 rule", "boole rule", "newton-cotes order 6", "newton-cotes order 7"]
ORDERS = [0, 1, 2]
OMEGA = np.array([0.5, 4.0, 20.0, 60.0])


def make(kind: Any, case: str) -> Any:
    """Return the differentiator of a case."""
    ts, alpha, beta, size, window, theta, is_root, corr = GRID[case]
    made = kind(ts=ts, alpha=alpha, beta=beta, N=size, T=window, display=False, corr=corr)
    if theta is not None:
        made.set_theta(theta, is_root)
    return made


def times(d: Any) -> Any:
    """Return times within the window."""
    return d.get_T() * np.array([0.03, 0.2, 0.45, 0.7, 0.96])


def samples(size: int) -> Any:
    """Return a signal."""
    return np.cos(0.3 * np.arange(size)) + 0.02 * np.arange(size)


def plain(value: Any) -> Any:
    """Return what JSON can hold: None for what is not finite, and text for keys."""
    if isinstance(value, dict):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(one) for one in value]
    if isinstance(value, np.ndarray):
        return [plain(one) for one in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return int(value) if isinstance(value, (int, np.integer)) and not isinstance(value, bool) else value


def outcome(call: Callable[[], Any]) -> str:
    """Return whether a call refuses or warns."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                call()
        except Exception:  # the toolbox raises nothing narrower
            return "refuses"
    return "warns" if caught else "passes"


def state(d: Any) -> dict[str, Any]:
    """Return what follows from the parameters."""
    return {
        "theta": d.get_theta(),
        "cutoff": d.get_cutoffFreq(),
        "delay": d.get_delay(),
        "kernel": d.evalKernel(times(d)),
        "filter": d.estimateDer(1, samples(90), conv="valid")[-3:],
    }


def after(change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return what follows from the parameters after a change, of an object whose filters are made before."""

    def call(d: Any) -> Any:
        d.discretize(1)
        change(d)
        return state(d)

    return call


def said_in_print(d: Any) -> list[float]:
    """Return the numbers that are printed."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        d.printParam()
    return [float(number) for number in re.findall(r"-?\d+\.?\d*(?:e[-+]\d+)?", text.getvalue())]


def exported(d: Any) -> dict[str, Any]:
    """Return what is in the C header."""
    with tempfile.TemporaryDirectory() as folder:
        d.exportFilterCoefficients2Ccode(1, "mid-point", filename=f"{folder}/g", header="HEADER")
        text = (Path(folder) / "g1.h").read_text(encoding="utf-8")
    values = text[text.index("{") + 1 : text.index("}")].split(",")
    names = re.findall(r"#(?:ifndef|define) \w+|static const double \w+\[\]", text)
    step = re.search(r"TS_AlgDiff (\S+)", text)
    length = re.search(r"WINDOW_LENGTH_G1 (\d+)", text)
    assert step is not None
    assert length is not None
    return {
        "names": names,
        "ts": float(step[1]),
        "length": int(length[1]),
        "values": [float(value) for value in values if value.strip()],
    }


def discretised(d: Any) -> dict[str, Any]:
    """Return filters, trimmed ones, and the forms of the result."""
    trimmed, tau1, tau2 = d.discretize(1, "mid-point", redFilLength=True, redTol=0.02)
    keys = [sorted(trimmed[1])]  # before the toolbox adds to its dictionary
    whole, theta = d.discretize(1, "analytic", discreteSpectrum=True)
    keys.append(sorted(whole[1]))
    both = d.discretize(1, "mid-point", redFilLength=True, redTol=0.02, discreteSpectrum=True)
    return {
        "weights": {m: {n: np.array(d.discretize(n, m)[n][m]) for n in ORDERS} for m in METHODS},
        "others": {m: np.array(d.discretize(1, m)[1][m]) for m in OTHERS},
        "trimmed": [tau1, tau2, np.array(trimmed[1]["mid-point-red"])],
        "theta": theta,
        "keys": [*keys, len(both)],
    }


def delays(d: Any) -> Any:
    """Return the delays of all filters."""
    for method in METHODS + OTHERS:
        d.discretize(1, method)
    return d.get_delayDiscrete()


def reduced(d: Any) -> list[Any]:
    """Return where windows are cut, and some of the shares by which they are."""
    tau1, tau2, shares, t, fine = d.reduceFilterLength(1)
    return [tau1, tau2, shares[::20], t[::20], len(shares), fine, d.reduceFilterLength(0, tol=0.1)[:2]]


CALLS: dict[str, Callable[[Any], Any]] = {
    "checkParameters": lambda d: [outcome(partial(d.checkParameters, n)) for n in (None, 1, 9)],
    "computeTfromWc": lambda d: [d.computeTfromWc(9.0), d.get_T(), d.get_cutoffFreq()],
    "discretize": discretised,
    "estimateDer": lambda d: {
        conv: [d.estimateDer(1, samples(27), method=m, conv=conv) for m in METHODS[:2]] for conv in ("valid", "same")
    },
    "evalKernel": lambda d: [d.evalKernel(times(d)), d.evalKernel(0.1), d.evalKernel(np.array([-0.1, 2.0]))],
    "evalKernelDer": lambda d: [d.evalKernelDer(times(d), n) for n in ORDERS],
    "exportFilterCoefficients2Ccode": exported,
    "get_N": lambda d: d.get_N(),
    "get_T": lambda d: d.get_T(),
    "get_alpha": lambda d: d.get_alpha(),
    "get_ampAndPhaseFilter": lambda d: d.get_ampAndPhaseFilter(OMEGA.copy()),
    "get_ampSpectrumDiscreteFilter": lambda d: [
        d.get_ampSpectrumDiscreteFilter(OMEGA.copy(), n, m) for m in METHODS for n in ORDERS
    ],
    "get_asymptotesAmpFilter": lambda d: d.get_asymptotesAmpFilter(OMEGA.copy()),
    "get_beta": lambda d: d.get_beta(),
    "get_cutoffFreq": lambda d: d.get_cutoffFreq(),
    "get_degreeExactness": lambda d: [d.get_degreeExactness(n) for n in ORDERS],
    "get_delay": lambda d: d.get_delay(),
    "get_delayDiscrete": delays,
    "get_discretizationError": lambda d: [d.get_discretizationError(1, 80.0, 25, m) for m in METHODS],
    "get_integralKernel": lambda d: [
        d.get_integralKernel(times(d)),
        d.get_integralKernel(0.1),
        d.get_integralKernel(times(d), nested=2),
    ],
    "get_ratioNyquistCutoff": lambda d: [d.get_ratioNyquistCutoff(1), d.get_ratioNyquistCutoff([0, 1, 2])],
    "get_stepResponse": lambda d: d.get_stepResponse(np.array([-0.1, *times(d), 2.0])),
    "get_theta": lambda d: d.get_theta(),
    "get_ts": lambda d: d.get_ts(),
    "printParam": said_in_print,
    "reduceFilterLength": reduced,
    "set_N": after(lambda d: d.set_N(2)),
    "set_T": after(lambda d: d.set_T(0.625)),
    "set_alpha": after(lambda d: d.set_alpha(3.5)),
    "set_beta": after(lambda d: d.set_beta(3.5)),
    "set_samplingPeriod": after(lambda d: d.set_samplingPeriod(1 / 128)),
    "set_theta": after(lambda d: d.set_theta(0.25, False)),
    "timeShift": lambda d: [d.timeShift(times(d)), d.timeShift(0.25)],
    "weightFcn": lambda d: [d.weightFcn(1.5, 2.0, np.array([-1.5, -0.5, 0.75, 2.0])), d.weightFcn(1.0, 1.0, 0.5)],
}
"""What is asked of each public method."""


def signatures(kind: Any) -> dict[str, list[list[Any]]]:
    """Return names and defaults of the arguments of every public method and of the constructor."""
    found = {}
    for name, method in inspect.getmembers(kind, inspect.isfunction):
        if name == "__init__" or not name.startswith("_"):
            arguments = list(inspect.signature(method).parameters.values())[1:]
            found[name] = [[a.name, "required" if a.default is a.empty else a.default] for a in arguments]
    return found


def everything(kind: Any) -> dict[str, Any]:
    """Return the signatures, and what every method says of every case, each on an object of its own."""
    said = {name: {case: plain(call(make(kind, case))) for case in GRID} for name, call in CALLS.items()}
    return {"signatures": signatures(kind), "said": said}


if __name__ == "__main__":
    from AlgDiff import AlgebraicDifferentiator

    warnings.simplefilter("ignore")
    print(json.dumps(everything(AlgebraicDifferentiator), indent=None, separators=(",", ":")))
