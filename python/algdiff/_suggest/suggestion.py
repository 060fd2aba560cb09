"""What is suggested for some samples, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff._differentiator import Differentiator
from algdiff._suggest.applied import with_edges

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]


class RiskCurve(NamedTuple):
    """What every candidate is estimated to err by, in the middle of the samples.

    Attributes
    ----------
    window_length, degree : ndarray of int
        The candidates.
    rmse : ndarray
        Root-mean-square error, in the unit of the derivative.
    noise, bias : ndarray
        Its two parts: ``rmse**2 == noise**2 + bias**2``. A bias that the noise may explain counts as none.

    Examples
    --------
    >>> import numpy as np
    >>> import algdiff
    >>> x = np.sin(np.linspace(0, 10, 1001)) + 0.01 * np.random.default_rng(0).standard_normal(1001)
    >>> curve = algdiff.suggest(x, delta=0.01).curve
    >>> bool(np.allclose(curve.rmse**2, curve.noise**2 + curve.bias**2))
    True
    """

    window_length: NDArray[np.intp]
    degree: NDArray[np.intp]
    rmse: Floats
    noise: Floats
    bias: Floats


@dataclass(frozen=True, eq=False, repr=False)
class Suggestion:
    """A design chosen from samples, and what it is expected to do to them.

    Call it to differentiate: ``suggestion(x)`` is the design, but that in mode "fit" the ends, where no window has the
    sample in its middle, are means over several degrees and three windows.

    Attributes
    ----------
    differentiator : Differentiator
        The design.
    rmse : float
        Estimated root-mean-square error of ``suggestion(x)``, in the unit of the derivative; of several orders that of
        the highest.
    noise, bias : float
        Its two parts: ``rmse**2 == noise**2 + bias**2``.
    noise_level : float
        Standard deviation of the noise in the samples, or, of rows that differ, its root mean square.
    noise_range : tuple of float
        The least and the largest level in parts of the samples.
    correlation, colour : float
        Of noise that is coloured: the correlation of neighbours in AR(1) noise (``noise="ar1"``), or 0; and by which
        factor its level at the scale of the window exceeds that from sample to sample, or 1.
    quantum : float
        The step that all samples are multiples of, if there is one and they show it; else 0.
    curve : RiskCurve
        The candidates and their errors.
    limits : tuple of str
        What was asked for that kept the choice from going farther.
    local : bool
        Whether the window adapts along the signal.

    Examples
    --------
    >>> import numpy as np
    >>> import algdiff
    >>> t = np.linspace(0, 10, 1001)
    >>> x = np.sin(t) + 0.01 * np.random.default_rng(0).standard_normal(t.size)
    >>> suggestion = algdiff.suggest(x, delta=0.01)
    >>> error = np.sqrt(np.mean((suggestion(x) - np.cos(t)) ** 2))
    >>> bool(error < 0.05), bool(0.5 < suggestion.rmse / error < 2)
    (True, True)
    """

    differentiator: Differentiator
    rmse: float
    noise: float
    bias: float
    noise_level: float
    noise_range: tuple[float, float]
    correlation: float
    colour: float
    quantum: float
    curve: RiskCurve
    limits: tuple[str, ...]
    local: bool

    def __call__(self, x: ArrayLike, axis: SupportsIndex = -1, *, mode: str = "fit", **call: Any) -> Any:
        """Differentiate `x` along `axis`.

        Parameters
        ----------
        x : array_like
            Samples, of the kind and with the step of those that the choice was made from.
        axis : int
            The axis of time in `x`.
        mode : str
            As in `Differentiator.__call__`. In mode "fit", and if nothing is asked for that needs a fit for every
            estimate (missing samples, weights, error bars), the ends are found as said above.
        **call
            The other arguments of `Differentiator.__call__`.

        Returns
        -------
        ndarray or Estimates
            As of `Differentiator.__call__`.

        Raises
        ------
        ValueError, TypeError, MemoryError
            See `Differentiator`.
        """
        return apply(self.differentiator, x, axis, mode, self.noise_level, self.local, call)

    def __repr__(self) -> str:
        return f"Suggestion({self.differentiator!r}, rmse={self.rmse:.4g}, noise_level={self.noise_level:.4g})"

    def explain(self) -> str:
        """Return what was chosen and why, in plain words.

        Examples
        --------
        >>> import numpy as np
        >>> import algdiff
        >>> x = np.sin(np.linspace(0, 10, 1001)) + 0.01 * np.random.default_rng(0).standard_normal(1001)
        >>> print(algdiff.suggest(x, delta=0.01).explain().splitlines()[0][:40])
        A window of 421 samples (4.21) and degre
        """
        from algdiff._suggest.words import explain

        return explain(self)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the estimated error of every candidate over its window.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; by default a new figure of pyplot.

        Returns
        -------
        Axes
            Logarithmic in both directions: a line for each degree, those of noise and bias of the chosen one, and a
            mark on the choice.

        Raises
        ------
        ImportError
            Matplotlib is not installed.
        TypeError
            An argument is of the wrong type.
        """
        from algdiff._suggest.picture import plot

        return plot(self, ax)


HARMLESS = ("cval", "out", "threads", "progress")
"""Arguments of a call that leave the ends to `edges`, whatever they are."""

DEFAULTS = {
    "return_std": False,
    "return_support": False,
    "return_bias": False,
    "edge_window": "full",
    "nan_policy": "propagate",
}
"""And others that do so at their defaults."""


def apply(
    design: Differentiator,
    x: ArrayLike,
    axis: SupportsIndex,
    mode: str,
    sigma: float,
    local: bool,
    call: dict[str, Any],
) -> Any:
    """Differentiate by a chosen design; `sigma` is the level of the noise in one row."""
    plain = all(
        value is None or name in HARMLESS or (name in DEFAULTS and value == DEFAULTS[name])
        for name, value in call.items()
    )
    centered = math.isclose(design.tau, 0.5)
    result = design(x, axis, mode=mode, **call)  # type: ignore[arg-type]
    if not plain or mode != "fit" or not centered or not isinstance(result, np.ndarray):
        return result
    if np.ma.is_masked(x):
        return result
    samples = arguments.signal("x", np.ma.getdata(x) if isinstance(x, np.ma.MaskedArray) else x)
    axis = arguments.axis_index(axis, samples.ndim)
    # The level of one row is known; of several, each has its own.
    level = sigma if samples.size == samples.shape[axis] else None
    with_edges(design, samples, np.ma.getdata(result), axis, level, local, call.get("threads"))
    return result
