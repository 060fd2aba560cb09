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

from importlib.metadata import version as _version

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
from algdiff._warnings import DesignWarning

__version__ = _version("algdiff-rs")

__all__ = [
    "Asymptotes",
    "DelayTradeoff",
    "DesignWarning",
    "Differentiator",
    "Estimates",
    "FileReport",
    "InternalError",
    "Kernel",
    "Stream",
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
]
