"""The method "algebraic" of the package `derivative`: importing this module registers it there, for PySINDy as well."""

from __future__ import annotations

from abc import ABCMeta
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff._differentiate import differentiate

try:
    from derivative.differentiation import Derivative, register
except ImportError as _error:
    raise ImportError(f"algdiff.compat.derivative needs derivative: pip install derivative ({_error})") from _error

__all__ = ["Algebraic"]


@register("algebraic")
class Algebraic(Derivative, metaclass=ABCMeta):  # type: ignore[misc]
    """Differentiate by `algdiff.differentiate` in ``derivative.dxdt(x, t, kind="algebraic", ...)``.

    Its keywords are these parameters. `t` holds the times of the samples, even or not.

    Parameters
    ----------
    window_length : int, optional
        Number of samples in the window. Without it and `window_duration`, window and degree are chosen from the data,
        for every row by itself, and once more for ``smooth_x``. That needs even times.
    window_duration : float, optional
        Instead: the duration of the window, in the unit of `t`.
    degree, kappa, mu, nan_policy, edge_window, local
        As in `algdiff.differentiate`.

    Raises
    ------
    ValueError, TypeError
        When it differentiates, as `algdiff.differentiate`.

    Examples
    --------
    >>> import numpy as np
    >>> import derivative
    >>> import algdiff.compat.derivative
    >>> t = np.sqrt(np.linspace(1, 4, 101))
    >>> slope = derivative.dxdt(t**2, t, kind="algebraic", window_length=11)
    >>> bool(np.allclose(slope, 2 * t))
    True
    """

    def __init__(
        self,
        window_length: SupportsIndex | None = None,
        *,
        window_duration: float | None = None,
        degree: SupportsIndex | None = None,
        kappa: float = 1.0,
        mu: float = 1.0,
        nan_policy: str = "propagate",
        edge_window: str = "full",
        local: bool = False,
    ) -> None:
        self._window_length = window_length
        self._options: dict[str, Any] = {
            "window_duration": window_duration,
            "degree": degree,
            "kappa": kappa,
            "mu": mu,
            "nan_policy": nan_policy,
            "edge_window": edge_window,
            "local": local,
        }

    def __repr__(self) -> str:
        defaults = Algebraic.__init__.__kwdefaults__ or {}
        given = {name: value for name, value in self._options.items() if value != defaults[name]}
        if self._window_length is not None:
            given = {"window_length": self._window_length, **given}
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in given.items())})"

    def compute(self, t: ArrayLike, x: ArrayLike, i: int) -> Any:
        """Return the derivative at sample `i`; all of them cost as much."""
        return self.compute_for(t, x, i)

    def compute_for(self, t: ArrayLike, x: ArrayLike, indices: Any) -> Any:
        """Return the derivatives at samples `indices`."""
        return self._estimates(t, x, 1)[indices]

    def compute_x(self, t: ArrayLike, x: ArrayLike, i: int) -> Any:
        """Return the smoothed sample `i`; all of them cost as much."""
        return self.compute_x_for(t, x, i)

    def compute_x_for(self, t: ArrayLike, x: ArrayLike, indices: Any) -> Any:
        """Return the smoothed samples `indices`."""
        return self._estimates(t, x, 0)[indices]

    def _estimates(self, t: ArrayLike, x: ArrayLike, deriv: int) -> NDArray[Any]:
        # An empty row has an empty derivative, says their interface.
        if np.size(x) == 0:
            return np.empty(0)
        return np.asarray(differentiate(x, self._window_length, deriv, t=t, **self._options))
