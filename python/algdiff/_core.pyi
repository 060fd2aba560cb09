from collections.abc import Callable
from typing import Any, Self, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Bank",
    "Fits",
    "InternalError",
    "Kernel",
    "Plan",
    "Simultaneous",
    "Stream",
    "delay_tradeoff",
    "fail_inside",
    "lambdas",
    "registers",
]

class InternalError(RuntimeError): ...

@final
class Kernel:
    def __new__(cls, deriv: int, degree: int, kappa: float, mu: float, tau: float | str) -> Kernel: ...
    @property
    def tau(self) -> float: ...
    @property
    def exactness(self) -> int: ...
    @property
    def bias(self) -> tuple[int, float]: ...
    @property
    def norm2(self) -> float: ...
    @property
    def ln_asymptotes(self) -> tuple[float, float]: ...
    @property
    def roll_off(self) -> float: ...
    @property
    def cutoff(self) -> float | None: ...
    @property
    def bias_bound(self) -> float: ...
    @property
    def moment_delay(self) -> float: ...
    def half_power(self) -> float | None: ...
    def norm1(self) -> float: ...
    def optimal_duration(self, noise_level: float, derivative_bound: float, delta: float, bounded: bool) -> float: ...
    def rmse(self, duration: float, noise_level: float, derivative_bound: float, delta: float) -> float: ...
    def frequency_response(self, omega: NDArray[np.float64], reference: float, out: NDArray[np.complex128]) -> None: ...
    def step_response(self, times: NDArray[np.float64], out: NDArray[np.float64]) -> None: ...
    def roots(self) -> NDArray[np.float64]: ...
    def values(self, points: NDArray[np.float64], out: NDArray[np.float64]) -> None: ...

@final
class Plan:
    def __new__(
        cls,
        window_length: int,
        deriv: int,
        degree: int,
        kappa: float,
        mu: float,
        delta: float,
        rule: str,
        trim: float = 0.0,
        *,
        tau: float | str | None = None,
        delay: float | None = None,
        position: float | None = None,
    ) -> Plan: ...
    @property
    def tau(self) -> float: ...
    @property
    def delay_samples(self) -> float: ...
    @property
    def aligned_position(self) -> int: ...
    @property
    def exactness(self) -> int | None: ...
    @property
    def keeps_constants(self) -> bool: ...
    @property
    def span(self) -> int: ...
    @property
    def duration(self) -> float: ...
    @property
    def bias_bound(self) -> float: ...
    @property
    def moment_delay(self) -> float: ...
    def bias_constant(self) -> float: ...
    def half_power(self) -> float | None: ...
    def discretisation_error(self, frequency: float) -> float: ...
    def frequency_response(self, frequency: NDArray[np.float64], out: NDArray[np.complex128]) -> None: ...
    def taps(self, single: bool) -> tuple[NDArray[Any], float, bool, int | None]: ...
    def weights(self, out: NDArray[np.float64]) -> None: ...

@final
class Bank:
    def __new__(cls, plans: list[Plan], engine: str = "auto") -> Bank: ...
    def engine(self, single: bool) -> str: ...
    def grid(self, single: bool) -> int: ...
    def run(
        self,
        x: NDArray[np.float64] | NDArray[np.float32],
        out: NDArray[np.float64] | NDArray[np.float32],
        layout: tuple[int, int, int],
        mode: str,
        cval: float = 0.0,
        *,
        half_sample: bool = False,
        aligned: bool = False,
        part: tuple[int, int, int] | None = None,
        threads: int = 0,
        progress: Callable[[float], object] | None = None,
    ) -> None: ...

@final
class Fits:
    def __new__(cls, plans: list[Plan], beyond: int) -> Fits: ...
    def run(
        self,
        x: NDArray[np.float64] | NDArray[np.float32],
        layout: tuple[int, int, int],
        estimate: NDArray[np.float64] | NDArray[np.float32],
        std: NDArray[np.float64] | NDArray[np.float32] | None = None,
        bias: NDArray[np.float64] | NDArray[np.float32] | None = None,
        support: NDArray[np.int64] | None = None,
        *,
        mode: str = "fit",
        cval: float = 0.0,
        least: int | None = None,
        t: NDArray[np.float64] | None = None,
        duration: float | None = None,
        beyond: float = 0.0,
        at: NDArray[np.float64] | None = None,
        valid: bool = False,
        listed: NDArray[np.int64] | None = None,
        weights: NDArray[np.float64] | None = None,
        level: NDArray[np.float64] | None = None,
        autocovariance: NDArray[np.float64] | None = None,
        omit: bool = False,
        min_support: int = 0,
        max_gain: tuple[float, float] = ...,
        threads: int = 0,
        progress: Callable[[float], object] | None = None,
    ) -> None: ...
    def gains(self, positions: NDArray[np.float64], ideal: bool, out: NDArray[np.float64]) -> None: ...
    def refill(
        self,
        x: NDArray[np.float64] | NDArray[np.float32],
        layout: tuple[int, int, int],
        estimate: NDArray[np.float64] | NDArray[np.float32],
        std: NDArray[np.float64] | NDArray[np.float32] | None = None,
        support: NDArray[np.int64] | None = None,
        *,
        valid: bool = False,
        max_gain: float = ...,
        min_support: int = 0,
        threads: int = 0,
        progress: Callable[[float], object] | None = None,
    ) -> None: ...

class Stream:
    def __new__(
        cls,
        banks: list[Bank],
        points: list[tuple[float | None, float]],
        channels: int | None,
        *,
        leading: bool,
        single: bool,
        grow: bool,
        missing: str,
        support: int,
        gain: float | None,
        stamps: bool,
        threads: int,
    ) -> Self: ...
    @property
    def count(self) -> int: ...
    @property
    def ready(self) -> bool: ...
    def push(
        self, x: ArrayLike, t: ArrayLike | None = None, *, return_std: bool = False, return_support: bool = False
    ) -> Any: ...
    def reset(self) -> None: ...
    def _block(
        self,
        x: NDArray[np.float64] | NDArray[np.float32],
        t: NDArray[np.float64] | None,
        estimate: NDArray[np.float64] | NDArray[np.float32],
        std: NDArray[np.float64] | NDArray[np.float32] | None = None,
        support: NDArray[np.int64] | None = None,
        *,
        progress: Callable[[float], object] | None = None,
    ) -> None: ...
    def _last(self) -> tuple[list[float], list[float], list[int]]: ...
    def _held(self) -> tuple[list[float], list[float], int]: ...
    def _restore(self, samples: list[float], times: list[float], count: int) -> None: ...
    def _fail_inside(self) -> None: ...
    def _placed(self) -> tuple[float, float | None]: ...

def delay_tradeoff(
    delays: list[float],
    deriv: int,
    degree: int,
    kappa: float,
    mu: float,
    noise_level: float,
    amplitude: float,
    bandwidth: float,
    delta: float,
) -> list[tuple[float, float]]: ...

@final
class Simultaneous:
    def __new__(cls, degree: int, nu: int, duration: float) -> Simultaneous: ...
    def matrix(self) -> NDArray[np.float64]: ...
    def right_side(self, points: NDArray[np.float64], out: NDArray[np.float64]) -> None: ...
    def condition_number(self) -> float: ...

def lambdas(
    deriv: int, degree: int, exponents: tuple[float, float], points: NDArray[np.float64], out: NDArray[np.float64]
) -> None: ...
def fail_inside() -> None: ...
def registers() -> tuple[int, bool]: ...
