from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray

__all__ = ["InternalError", "Kernel", "Plan", "Simultaneous", "lambdas"]

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
    def exactness(self) -> int | None: ...
    def weights(self, out: NDArray[np.float64]) -> None: ...
    def run(
        self,
        x: NDArray[np.float64] | NDArray[np.float32],
        out: NDArray[np.float64] | NDArray[np.float32],
        layout: tuple[int, int, int],
        mode: str,
        cval: float = 0.0,
        *,
        half_sample: bool = False,
        threads: int = 0,
        progress: Callable[[float], object] | None = None,
    ) -> None: ...

@final
class Simultaneous:
    def __new__(cls, degree: int, nu: int, duration: float) -> Simultaneous: ...
    def matrix(self) -> NDArray[np.float64]: ...
    def right_side(self, points: NDArray[np.float64], out: NDArray[np.float64]) -> None: ...
    def condition_number(self) -> float: ...

def lambdas(
    deriv: int, degree: int, exponents: tuple[float, float], points: NDArray[np.float64], out: NDArray[np.float64]
) -> None: ...
