"""The parameters of a differentiator in the words of the AlgDiff toolbox, and the kernels that they mean."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._kernel import Kernel
from algdiff._refusals import shown

LARGEST_N = 500
"""The largest degree of a kernel."""


@dataclass(frozen=True)
class Parameters:
    """What a differentiator of the toolbox is made of, checked; never changed.

    Attributes
    ----------
    ts, alpha, beta, N
        As the toolbox names them.
    theta : float or None
        None for the toolbox's own choice, the largest root.
    window, wc : float or None
        The length of the window or the cutoff in rad/s that it is to have; the other one is None.
    """

    ts: float
    alpha: float
    beta: float
    N: int
    theta: float | None = None
    window: float | None = None
    wc: float | None = None

    def __post_init__(self) -> None:
        for name in ("ts", "window", "wc"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _positive("T" if name == "window" else name, value))
        for name in ("alpha", "beta"):
            value = arguments.real(name, getattr(self, name))
            if not -1 < value < math.inf:
                raise ValueError(f"{name} must be finite and greater than -1, got {value}")
            object.__setattr__(self, name, value)
        size = arguments.integer("N", self.N, 0)
        if size > LARGEST_N:
            raise ValueError(f"N must be at most {LARGEST_N}, got {shown(size)}")
        object.__setattr__(self, "N", size)
        if self.theta is not None:
            theta = arguments.real("theta", self.theta)
            if not math.isfinite(theta):
                raise ValueError(f"theta must be finite, got {theta}")
            object.__setattr__(self, "theta", theta)
        if self.window is not None and self.window < self.ts * (1 - 1e-9):
            raise ValueError(f"T must be at least ts = {self.ts}, got {self.window}")
        _ = self.kernel, self.T  # which refuse what they cannot be made of

    @cached_property
    def kernel(self) -> Kernel:
        """The kernel g, for a window of length 1; with N = 0 theta is not used."""
        tau = "root" if self.N == 0 or self.theta is None else (1 + self.theta) / 2
        return Kernel(0, self.N, self.beta, self.alpha, tau)

    @cached_property
    def T(self) -> float:  # noqa: N802
        """The length of the window: as given, or the longest whole number of steps with a cutoff of at least `wc`."""
        if self.window is not None:
            return self.window
        cutoff = self.kernel.cutoff
        wanted = self.wc
        if cutoff is None or wanted is None:
            raise ValueError(
                f"alpha, beta, N and theta must give a kernel with a cutoff for wc, got alpha = {self.alpha}, "
                f"beta = {self.beta}, N = {self.N}, theta = {self.shown_theta}"
            )
        # A cutoff that a whole number of steps has, but for rounding, is that one's.
        steps = math.floor(cutoff / (wanted * self.ts) * (1 + 1e-12))
        if steps < 1:
            raise ValueError(f"wc must be at most {cutoff / self.ts:.6g}, that of one step, got {self.wc}")
        return self.ts * steps

    @property
    def shown_theta(self) -> float:
        """The theta that is in use, or was set; 0 for N = 0, where none is used."""
        if self.theta is not None:
            return self.theta
        return 0.0 if self.N == 0 else 2 * self.kernel.tau - 1

    @property
    def cutoff(self) -> float:
        """The cutoff in rad/s; NaN if there is none."""
        cutoff = self.kernel.cutoff
        return math.nan if cutoff is None else cutoff / self.T

    def order(self, name: str, value: object) -> int:
        """Return an order of which the differentiator can estimate the derivative."""
        order = arguments.integer(name, value, 0)
        if not min(self.alpha, self.beta) > order - 1:
            raise ValueError(
                f"{name} must be less than min(alpha, beta) + 1 = {min(self.alpha, self.beta) + 1:g}, got {order}"
            )
        return order

    def of_order(self, order: int) -> Kernel:
        """Return the kernel of a derivative."""
        return Kernel(order, self.N + order, self.beta - order, self.alpha - order, self.kernel.tau)


def points(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return real numbers as a new array, a single one as an array of one."""
    flat, shape = arguments.points(name, values)
    return np.array(flat.reshape(shape or (1,)))


def _positive(name: str, value: Any) -> float:
    number = arguments.real(name, value)
    if not 0 < number < math.inf:
        raise ValueError(f"{name} must be finite and positive, got {number}")
    return number
