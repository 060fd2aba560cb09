"""`numpy.gradient` with a window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._differentiator import Differentiator
from algdiff._refusals import shown
from algdiff._separable import CALL, DESIGN, Field, PerAxis, axes_of, each, flag, spacings


def gradient(
    f: ArrayLike,
    *varargs: ArrayLike,
    axis: int | tuple[int, ...] | None = None,
    edge_order: int = 1,
    window_length: PerAxis | None = None,
    smooth: bool = False,
    **window: Any,
) -> Samples | tuple[Samples, ...]:
    """Return the gradient of an array: the arguments and the result of `numpy.gradient`, or by a window where noise is.

    Without `window_length` this is `numpy.gradient` itself. With it, every first derivative is that of
    `differentiate`; with `smooth` as well, that of `partial`.

    Parameters
    ----------
    f : array_like
        Samples of a function of as many variables as `f` has dimensions. With a window masked samples count as NaN,
        and the result is masked.
    *varargs : float or array_like, optional
        Spacing: one number for all axes, or for each axis a number or the coordinates of the samples, which may be
        uneven and may descend.
    axis : int or tuple of int, optional
        The axes along which to differentiate; default all.
    edge_order : {1, 2}
        Order of the differences at the ends. With a window the ends are treated by `mode` and this has no effect.
    window_length : int or sequence of int, optional
        Number of samples in the window, or one for each axis.
    smooth : bool
        With a window, smooth every derivative along the other axes of `axis` by their windows, as `partial` does.
    **window
        With a window, keywords of `differentiate`: `degree` (or one for each axis), `kappa`, `mu`, `tau`, `delay`,
        `rule`, `trim`, `engine`, `mode`, `cval`, `nan_policy`, `min_support`, `max_gain`, `threads`; with `smooth`
        those that `partial` knows.

    Returns
    -------
    ndarray or tuple of ndarray
        The derivative along every axis, each in the shape of `f` (in mode "valid" shorter along its axis); a tuple for
        several axes.

    Raises
    ------
    ValueError, TypeError
        As `numpy.gradient`, as `differentiate` or `partial`.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import gradient
    >>> y, x = np.mgrid[0:2:0.1, 0:3:0.1]
    >>> along_y, along_x = gradient(x * y**2, 0.1, window_length=7)
    >>> bool(np.allclose(along_y, 2 * x * y) and np.allclose(along_x, y**2))
    True
    """
    known = {"degree", "delay", "trim"} | DESIGN | CALL
    unknown = window.keys() - known
    if unknown:
        raise TypeError(
            f"gradient got unexpected keywords: {', '.join(sorted(unknown))}: use {', '.join(sorted(known))}"
        )
    if window_length is None:
        if window or smooth:
            named = [*window, *(["smooth"] if smooth else [])]
            raise ValueError(f"{', '.join(named)} must come with window_length, got none")
        numpy_gradient: Any = np.gradient  # whose overloads do not know an ArrayLike
        plain = numpy_gradient(f, *varargs, axis=axis, edge_order=edge_order)
        return tuple(plain) if isinstance(plain, (list, tuple)) else cast("Samples", plain)
    if edge_order not in (1, 2):
        raise ValueError(f"edge_order must be 1 or 2, got {shown(edge_order)}")
    values = arguments.unmasked("f", f)
    axes = axes_of("axis", axis, values.ndim)
    spacing = varargs or (1.0,)
    if len(spacing) == 1 and np.ndim(spacing[0]) == 0:
        spacing = spacing * len(axes)
    if len(spacing) != len(axes):
        raise TypeError(f"spacing must be one number or one entry for each of the {len(axes)} axes, got {len(varargs)}")
    result = (_smoothed if flag("smooth", smooth) and axes else _alone)(values, axes, spacing, window_length, window)
    result = [arguments.remasked(f, part) for part in result]
    return result[0] if len(result) == 1 else tuple(result)


def _alone(
    values: Samples, axes: list[int], spacing: Sequence[ArrayLike], window_length: PerAxis, window: dict[str, Any]
) -> list[Samples]:
    """Return the derivative along each axis."""
    design = {name: value for name, value in window.items() if name not in CALL}
    call = {name: value for name, value in window.items() if name in CALL}
    lengths = each("window_length", window_length, len(axes))
    degrees = each("degree", design.pop("degree", None), len(axes))
    result = []
    for axis, along, length, degree in zip(axes, spacings(spacing, axes, values.shape), lengths, degrees, strict=True):
        differentiator = Differentiator(length, 1, degree=degree, delta=along.step, **design)
        derivative = differentiator(values, axis, t=along.t, **call)
        result.append(np.negative(derivative, out=derivative) if along.descends else derivative)
    return result


def _smoothed(
    values: Samples, axes: list[int], spacing: Sequence[ArrayLike], window_length: PerAxis, window: dict[str, Any]
) -> list[Samples]:
    """Return the derivative along each axis, smoothed along the others."""
    refused = window.keys() & {"delay", "trim"}
    if refused:
        raise ValueError(f"{' and '.join(sorted(refused))} must be left out with smooth = True, got {shown(window)}")
    words = {**window, "spacing": spacing, "axes": tuple(axes)}
    field = Field.of("gradient", values, window_length, 1, smooth=True, **words)
    wanted = {tuple(int(axis == one) for axis in axes): field.empty() for one in axes}
    field.write(wanted)
    return [field.restored(out) for out in wanted.values()]
