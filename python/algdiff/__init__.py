"""Derivatives of noisy sampled signals by algebraic (Jacobi) differentiators.

The estimator of order ``deriv`` is the derivative, at the point ``tau`` of a sliding window, of the polynomial of
degree ``degree`` fitted with the weight ``tau**kappa * (1 - tau)**mu``. With ``kappa = mu = 0`` it is the
Savitzky-Golay filter.

>>> import numpy as np
>>> import algdiff
>>> t = np.arange(0, 2, 0.01)
>>> velocity = algdiff.differentiate(np.sin(t), 21, delta=0.01)
>>> float(np.abs(velocity - np.cos(t)).max()) < 1e-4
True
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from algdiff import paper
    from algdiff._choice import DelayTradeoff, delay_tradeoff, optimal_window
    from algdiff._core import InternalError
    from algdiff._differentiate import differentiate
    from algdiff._differentiator import Differentiator
    from algdiff._fields import hessian, laplacian, partial
    from algdiff._file import FileReport, differentiate_file
    from algdiff._gradient import gradient
    from algdiff._kernel import Asymptotes, Kernel
    from algdiff._noise import noise_level
    from algdiff._plot import plot_design, plot_kernel, plot_response
    from algdiff._results import Estimates
    from algdiff._savgol import savgol_coeffs, savgol_filter
    from algdiff._stream import Stream
    from algdiff._suggest.choice import suggest
    from algdiff._suggest.suggestion import RiskCurve, Suggestion
    from algdiff._warnings import DesignWarning

    __version__: str

__all__ = [
    "Asymptotes",
    "DelayTradeoff",
    "DesignWarning",
    "Differentiator",
    "Estimates",
    "FileReport",
    "InternalError",
    "Kernel",
    "RiskCurve",
    "Stream",
    "Suggestion",
    "__version__",
    "delay_tradeoff",
    "differentiate",
    "differentiate_file",
    "gradient",
    "hessian",
    "laplacian",
    "noise_level",
    "optimal_window",
    "paper",
    "partial",
    "plot_design",
    "plot_kernel",
    "plot_response",
    "savgol_coeffs",
    "savgol_filter",
    "suggest",
]

_HOMES = {
    "Asymptotes": "_kernel",
    "DelayTradeoff": "_choice",
    "DesignWarning": "_warnings",
    "Differentiator": "_differentiator",
    "Estimates": "_results",
    "FileReport": "_file",
    "InternalError": "_core",
    "Kernel": "_kernel",
    "RiskCurve": "_suggest.suggestion",
    "Stream": "_stream",
    "Suggestion": "_suggest.suggestion",
    "delay_tradeoff": "_choice",
    "differentiate": "_differentiate",
    "differentiate_file": "_file",
    "gradient": "_gradient",
    "hessian": "_fields",
    "laplacian": "_fields",
    "noise_level": "_noise",
    "optimal_window": "_choice",
    "partial": "_fields",
    "plot_design": "_plot",
    "plot_kernel": "_plot",
    "plot_response": "_plot",
    "savgol_coeffs": "_savgol",
    "savgol_filter": "_savgol",
    "suggest": "_suggest.choice",
}
"""Where names come from; they are imported when they are asked for. ``algdiff --help`` needs none, nor NumPy."""


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        from importlib import import_module

        if name in _HOMES:
            value = getattr(import_module(f"algdiff.{_HOMES[name]}"), name)
        elif name == "paper":
            value = import_module("algdiff.paper")
        elif name == "__version__":
            from importlib.metadata import version

            value = version("algdiff-rs")
        else:
            raise AttributeError(f"module 'algdiff' has no attribute {name!r}")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
