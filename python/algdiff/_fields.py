"""Derivatives of arrays of several dimensions, by windows along one axis after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._refusals import shown
from algdiff._separable import Field, Part, PerAxis, each, several


def partial(
    f: ArrayLike,
    deriv: Sequence[SupportsIndex],
    window_length: PerAxis,
    *,
    spacing: ArrayLike | Sequence[ArrayLike] = 1.0,
    axes: int | tuple[int, ...] | None = None,
    degree: PerAxis | None = None,
    smooth: bool = True,
    **window: Any,
) -> Samples:
    """Differentiate an array along several of its axes.

    `differentiate` along one axis after the other, in whatever order: every estimate is the derivative of a polynomial
    in all variables, fitted to a box of samples. Its noise gain is the product of those along the axes.

    Parameters
    ----------
    f : array_like
        Samples of a function of as many variables as `f` has dimensions. Masked samples count as NaN, and make the
        result a masked array.
    deriv : sequence of int
        Order of the derivative along each of `axes`: of two, ``(1, 1)`` is the mixed derivative and ``(0, 2)`` the
        second along the last axis, smoothed along the first.
    window_length : int or sequence of int
        Number of samples in the window, or one for each axis.
    spacing : float, or sequence of float or array_like
        One number for all axes, or for each axis a number or the coordinates of its samples, which may be uneven.
        Negative along a descending axis.
    axes : int or tuple of int, optional
        The axes that `deriv` speaks of; default all. Along the others nothing is done.
    degree : int or sequence of int, optional
        Degree of the local polynomial, or one for each axis; default the highest order along any axis plus 2, for all
        axes.
    smooth : bool
        Smooth, by the same windows, along axes of order 0; otherwise they are left alone.
    **window
        Keywords of `differentiate`, the same along all axes: `kappa`, `mu`, `tau`, `rule`, `engine`, `mode` (other than
        "valid"), `cval`, `nan_policy`, `min_support`, `max_gain`, `threads`. Where an axis descends, its oldest sample
        is still its first. In mode "constant" all of `f` is surrounded by `cval`.

    Returns
    -------
    ndarray
        The derivative in the shape of `f`, in its unit over that of the spacings to the powers of `deriv`; float32 and
        complex64 stay, everything else becomes float64 or complex128. The axes lie in memory as those of `f`.

    Raises
    ------
    ValueError, TypeError, MemoryError
        As `differentiate`; or the arguments do not fit the axes.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import partial
    >>> y, x = np.mgrid[0:2:0.1, 0:3:0.1]
    >>> bool(np.allclose(partial(x * y**2, (1, 1), 9, spacing=0.1), 2 * y))
    True
    >>> bool(np.allclose(partial(x * y**2, (2, 0), (9, 5), spacing=0.1, degree=(4, 2)), 2 * x))
    True
    """
    if not several(deriv):
        raise TypeError(f"deriv must be a sequence of one order for each axis, got {shown(deriv)}")
    orders = tuple(arguments.integer("deriv", order, 0) for order in deriv)
    words = {**window, "spacing": spacing, "axes": axes, "degree": degree, "smooth": smooth}
    field = Field.of("partial", f, window_length, max(orders, default=0), **words)
    result = field.empty()
    field.write({tuple(each("deriv", orders, len(field.passes))): result})
    return arguments.remasked(f, field.restored(result))


def laplacian(
    f: ArrayLike,
    window_length: PerAxis,
    *,
    spacing: ArrayLike | Sequence[ArrayLike] = 1.0,
    axes: int | tuple[int, ...] | None = None,
    degree: PerAxis | None = None,
    smooth: bool = True,
    **window: Any,
) -> Samples:
    """Return the sum of the second derivatives of an array along its axes.

    With `smooth` each of them is smoothed along the other axes: the sum of those of `partial` to rounding, but cheaper.

    Parameters
    ----------
    f, window_length, spacing, smooth, **window
        As in `partial`; but a `tau` of "root" is not the same for all orders, and refused with `smooth`.
    axes : int or tuple of int, optional
        The axes along which to differentiate; default all.
    degree : int or sequence of int, optional
        Degree of the local polynomial, or one for each axis; default 4.

    Returns
    -------
    ndarray
        In the shape of `f`; dtype and memory as in `partial`.

    Raises
    ------
    ValueError, TypeError, MemoryError
        As `partial`.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import laplacian
    >>> y, x = np.mgrid[0:2:0.1, 0:3:0.1]
    >>> bool(np.allclose(laplacian(x**2 * y, 9, spacing=0.1), 2 * y))
    True
    """
    words = {**window, "spacing": spacing, "axes": axes, "degree": degree, "smooth": smooth}
    field = Field.of("laplacian", f, window_length, 2, **words)
    total = _smooth_sum(field) if field.smooth and len(field.passes) > 1 else _sum(field)
    return arguments.remasked(f, field.restored(total))


def hessian(
    f: ArrayLike,
    window_length: PerAxis,
    *,
    spacing: ArrayLike | Sequence[ArrayLike] = 1.0,
    axes: int | tuple[int, ...] | None = None,
    degree: PerAxis | None = None,
    smooth: bool = True,
    **window: Any,
) -> Samples:
    """Return all second derivatives of an array.

    They are those of `partial` with one `degree`, but share their passes over the data.

    Parameters
    ----------
    f, window_length, spacing, smooth, **window
        As in `partial`; but a `tau` of "root" is not the same for all orders, and refused.
    axes : int or tuple of int, optional
        The axes along which to differentiate; default all.
    degree : int or sequence of int, optional
        Degree of the local polynomial, or one for each axis; default 4, also of the mixed derivatives.

    Returns
    -------
    ndarray of shape ``(k, k, *f.shape)``
        Of k axes, in the order of `axes`, entry ``[i, j]`` is the derivative along the i-th and the j-th, and the same
        to the bit as ``[j, i]``. dtype and memory as in `partial`.

    Raises
    ------
    ValueError, TypeError, MemoryError
        As `partial`.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import hessian
    >>> y, x = np.mgrid[0:2:0.1, 0:3:0.1]
    >>> (yy, yx), (xy, xx) = hessian(x * y**2, 9, spacing=0.1)
    >>> bool(np.allclose(yy, 2 * x) and np.allclose(yx, 2 * y) and np.allclose(xx, 0))
    True
    """
    words = {**window, "spacing": spacing, "axes": axes, "degree": degree, "smooth": smooth}
    field = Field.of("hessian", f, window_length, 2, **words)
    count = len(field.passes)
    result = field.empty(count, count)
    unit = np.eye(count, dtype=int)
    pairs = [(i, j) for i in range(count) for j in range(i, count)]
    field.write({tuple((unit[i] + unit[j]).tolist()): result[i, j] for i, j in pairs})
    for i, j in pairs:
        if i != j:
            np.copyto(result[j, i], result[i, j])
    return arguments.remasked(f, field.restored(result))


def _sum(field: Field) -> Samples:
    """Return the sum of the second derivatives as they are."""
    total = field.empty()
    field.passes[0](field.part, (2,), total[np.newaxis])
    scratch = field.empty() if len(field.passes) > 1 else total
    for along in field.passes[1:]:
        along(field.part, (2,), scratch[np.newaxis])
        total += scratch
    return total


def _smooth_sum(field: Field) -> Samples:
    """Return the sum of the second derivatives, each smoothed along the other axes.

    With S and D for smoothing and for the second derivative along an axis, and after k axes P = S_k ... S_1 f and
    L = the sum so far, the next axis makes L' = S L + D P and P' = S P: never more than three passes for an axis,
    whatever their number.
    """
    plain, total = field.passes[0](field.part, (0, 2))
    for along in field.passes[1:-1]:
        (smoothed,) = along(total, (0,))
        plain, second = along(plain, (0, 2))
        np.add(second.samples, smoothed.samples, out=second.samples)
        total = Part(second.samples, second.beyond + smoothed.beyond)
    last = field.passes[-1]
    (result,) = last(total, (0,))
    (second,) = last(plain, (2,), total.samples[np.newaxis])
    return np.add(result.samples, second.samples, out=result.samples)
