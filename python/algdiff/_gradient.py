"""`numpy.gradient` with a window."""

from __future__ import annotations

from typing import Any, SupportsIndex, cast

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._differentiator import Differentiator


def gradient(
    f: ArrayLike,
    *varargs: ArrayLike,
    axis: int | tuple[int, ...] | None = None,
    edge_order: int = 1,
    window_length: SupportsIndex | None = None,
    **window: Any,
) -> Samples | tuple[Samples, ...]:
    """Return the gradient of an array: the arguments and the result of `numpy.gradient`, or by a window where noise is.

    Without `window_length` this is `numpy.gradient` itself. With it, every first derivative is that of
    `differentiate`.

    Parameters
    ----------
    f : array_like
        Samples of a function of as many variables as `f` has dimensions.
    *varargs : float or array_like, optional
        Spacing: one number for all axes, or for each axis a number or the coordinates of the samples. With a window
        the coordinates must be even to 1e-9 of their range and their own rounding; they may descend.
    axis : int or tuple of int, optional
        The axes along which to differentiate; default all.
    edge_order : {1, 2}
        Order of the differences at the ends. With a window the ends are treated by `mode` and this has no effect.
    window_length : int, optional
        Number of samples in the window.
    **window
        With a window, keywords of `differentiate`: `degree`, `kappa`, `mu`, `tau`, `delay`, `rule`, `trim`, `engine`,
        `mode`, `cval`, `threads`.

    Returns
    -------
    ndarray or tuple of ndarray
        The derivative along every axis, each in the shape of `f` (in mode "valid" shorter along its axis); a tuple for
        several axes.

    Raises
    ------
    ValueError, TypeError
        As `numpy.gradient`, as `differentiate`, or coordinates that are uneven and a window at once.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import gradient
    >>> y, x = np.mgrid[0:2:0.1, 0:3:0.1]
    >>> along_y, along_x = gradient(x * y**2, 0.1, window_length=7)
    >>> bool(np.allclose(along_y, 2 * x * y) and np.allclose(along_x, y**2))
    True
    """
    unknown = window.keys() - _DESIGN - _CALL
    if unknown:
        raise TypeError(f"gradient got unexpected keywords: {', '.join(sorted(unknown))}")
    if window_length is None:
        if window:
            raise ValueError(f"{', '.join(window)} must come with window_length, got none")
        numpy_gradient: Any = np.gradient  # whose overloads do not know an ArrayLike
        plain = numpy_gradient(f, *varargs, axis=axis, edge_order=edge_order)
        return tuple(plain) if isinstance(plain, (list, tuple)) else cast("Samples", plain)
    if edge_order not in (1, 2):
        raise ValueError(f"edge_order must be 1 or 2, got {edge_order!r}")
    values = arguments.signal("f", f)
    axes = _axes(axis, values.ndim)
    design = {name: value for name, value in window.items() if name in _DESIGN}
    call = {name: value for name, value in window.items() if name in _CALL}
    result = []
    for index, step in zip(axes, _steps(varargs, axes, values.shape), strict=True):
        derivative = Differentiator(window_length, 1, delta=abs(step), **design)(values, index, **call)
        result.append(derivative if step > 0 else np.negative(derivative, out=derivative))
    return result[0] if len(result) == 1 else tuple(result)


_DESIGN = {"degree", "kappa", "mu", "tau", "delay", "rule", "trim", "engine"}
_CALL = {"mode", "cval", "threads"}


def _axes(axis: int | tuple[int, ...] | None, ndim: int) -> list[int]:
    if axis is None:
        return list(range(ndim))
    axes = [arguments.axis_index(one, ndim) for one in (axis if isinstance(axis, (tuple, list)) else (axis,))]
    if len(set(axes)) < len(axes):
        raise ValueError(f"axis must name every axis once, got {axis}")
    return axes


def _steps(varargs: tuple[ArrayLike, ...], axes: list[int], shape: tuple[int, ...]) -> list[float]:
    if len(varargs) == 0:
        return [1.0] * len(axes)
    if len(varargs) == 1 and np.ndim(varargs[0]) == 0:
        varargs = varargs * len(axes)
    if len(varargs) != len(axes):
        raise TypeError(f"spacing must be one number or one entry for each of the {len(axes)} axes, got {len(varargs)}")
    return [_step(spacing, shape[axis]) for spacing, axis in zip(varargs, axes, strict=True)]


def _step(spacing: ArrayLike, size: int) -> float:
    """Return the signed step of a number or of even coordinates."""
    if np.ndim(spacing) == 0:
        step = arguments.real("spacing", spacing)
    else:
        coordinates = arguments.samples("coordinates", spacing).astype(np.float64, copy=False)
        if coordinates.shape != (size,):
            raise ValueError(f"coordinates must have shape ({size},), got {coordinates.shape}")
        step = float(coordinates[-1] - coordinates[0]) / max(size - 1, 1)
        uneven = np.abs(coordinates - (coordinates[0] + step * np.arange(size))).max()
        given = np.asarray(spacing).dtype
        rounding = 4 * float(np.finfo(given if given.kind == "f" else np.float64).eps) * np.abs(coordinates).max()
        if not uneven <= 1e-9 * abs(step) * size + rounding:
            steps = np.diff(coordinates)
            raise ValueError(
                "coordinates must be evenly spaced to use a window, "
                f"got steps from {steps.min():g} to {steps.max():g}; leave out window_length for numpy.gradient"
            )
    if not (np.isfinite(step) and step != 0):
        raise ValueError(f"spacing must be finite and not zero, got {step:g}")
    return step
