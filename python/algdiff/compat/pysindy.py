"""A differentiation method for PySINDy."""

from __future__ import annotations

from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._differentiate import differentiate

try:
    from pysindy.differentiation import BaseDifferentiation
except ImportError as _error:
    raise ImportError(f"algdiff.compat.pysindy needs pysindy: pip install pysindy ({_error})") from _error

__all__ = ["AlgebraicDifferentiation"]


class AlgebraicDifferentiation(BaseDifferentiation):  # type: ignore[misc]
    """Differentiate by `algdiff.differentiate` in ``pysindy.SINDy(differentiation_method=...)``.

    SINDy evaluates its library on `smoothed_x_`, not on the samples. With a window both come from it; without, one is
    chosen for the derivative and one for the signal, which bears a shorter one.

    Parameters
    ----------
    window_length : int, optional
        Number of samples in the window. Without it and `window_duration`, window and degree are chosen from every
        trajectory. That needs even times.
    d : int
        Order of the derivative, by the name it has in PySINDy.
    axis : int
        The axis of time; of a single row its only one.
    window_duration : float, optional
        Instead of `window_length`: the duration of the window, in the unit of `t`.
    per_coordinate : bool
        Choose a window for each coordinate, on the last axis, instead of one for all.
    save_smooth : bool
        Whether `smoothed_x_` is smoothed, or `x` as it is.
    degree, kappa, mu
        As in `algdiff.differentiate`.
    mode : {"fit", "nan"}
        At the ends: go on to the last sample, or give NaN where the window would reach beyond the data. SINDy drops
        these samples.

    Attributes
    ----------
    smoothed_x_ : ndarray
        The smoothed samples of the last call, in the shape of `x`.

    Raises
    ------
    ValueError, TypeError
        When it differentiates, as `algdiff.differentiate`.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff.compat.pysindy import AlgebraicDifferentiation
    >>> t = np.linspace(0, 1, 101)
    >>> method = AlgebraicDifferentiation(window_length=11)
    >>> bool(np.allclose(method(np.stack([t, t**2], axis=1), t), np.stack([t**0, 2 * t], axis=1)))
    True
    """

    def __init__(
        self,
        window_length: SupportsIndex | None = None,
        *,
        d: int = 1,
        axis: int = -2,
        window_duration: float | None = None,
        per_coordinate: bool = False,
        save_smooth: bool = True,
        degree: SupportsIndex | None = None,
        kappa: float = 1.0,
        mu: float = 1.0,
        mode: str = "fit",
    ) -> None:
        self.window_length = window_length
        self.d = d
        self.axis = axis
        self.window_duration = window_duration
        self.per_coordinate = per_coordinate
        self.save_smooth = save_smooth
        self.degree = degree
        self.kappa = kappa
        self.mu = mu
        self.mode = mode

    def _differentiate(self, x: ArrayLike, t: ArrayLike = 1) -> NDArray[Any]:
        if self.mode not in ("fit", "nan"):
            raise ValueError(f"mode must be 'fit' or 'nan', got {self.mode!r}")
        samples = np.asarray(x)
        parts = [samples]
        if self.per_coordinate and samples.ndim > 1:
            parts = [samples[..., i : i + 1] for i in range(samples.shape[-1])]
        smoothed, slopes = zip(*(self._both(part, t) for part in parts), strict=True)
        self.smoothed_x_ = np.concatenate(smoothed, -1) if self.save_smooth else samples
        return np.concatenate(slopes, -1)

    def _both(self, x: NDArray[Any], t: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
        if not self.save_smooth:
            return x, self._estimates(x, t, self.d)
        if self.window_length is None and self.window_duration is None:
            return self._estimates(x, t, 0), self._estimates(x, t, self.d)
        smoothed, slope = self._estimates(x, t, (0, self.d))
        return smoothed, slope

    def _estimates(self, x: NDArray[Any], t: ArrayLike, deriv: Any) -> NDArray[Any]:
        if np.ndim(t) == 0 and not arguments.real("t", t) > 0:
            raise ValueError(f"t must be a positive step or the times of the samples, got {t!r}")
        estimates = differentiate(
            x,
            self.window_length,
            deriv,
            axis=self.axis if x.ndim > 1 else 0,
            window_duration=self.window_duration,
            degree=self.degree,
            kappa=self.kappa,
            mu=self.mu,
            mode=self.mode,
            **({"t": t} if np.ndim(t) else {"delta": t}),  # type: ignore[arg-type]
        )
        return np.asarray(estimates)
