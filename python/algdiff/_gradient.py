"""`numpy.gradient` with a window; and the passes along axes that all derivatives of arrays are made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, SupportsIndex, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._differentiator import Differentiator
from algdiff._layout import memory_order

PerAxis: TypeAlias = SupportsIndex | Sequence[SupportsIndex]


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
        Samples of a function of as many variables as `f` has dimensions.
    *varargs : float or array_like, optional
        Spacing: one number for all axes, or for each axis a number or the coordinates of the samples. With a window
        the coordinates must be even to 1e-9 of their range and their own rounding; they may descend.
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
        `rule`, `trim`, `engine`, `mode`, `cval`, `threads`; with `smooth` those that `partial` knows.

    Returns
    -------
    ndarray or tuple of ndarray
        The derivative along every axis, each in the shape of `f` (in mode "valid" shorter along its axis); a tuple for
        several axes.

    Raises
    ------
    ValueError, TypeError
        As `numpy.gradient`, as `differentiate` or `partial`, or coordinates that are uneven and a window at once.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff import gradient
    >>> y, x = np.mgrid[0:2:0.1, 0:3:0.1]
    >>> along_y, along_x = gradient(x * y**2, 0.1, window_length=7)
    >>> bool(np.allclose(along_y, 2 * x * y) and np.allclose(along_x, y**2))
    True
    """
    unknown = window.keys() - {"degree", "delay", "trim"} - _DESIGN - _CALL
    if unknown:
        raise TypeError(f"gradient got unexpected keywords: {', '.join(sorted(unknown))}")
    if window_length is None:
        if window or smooth:
            named = [*window, *(["smooth"] if smooth else [])]
            raise ValueError(f"{', '.join(named)} must come with window_length, got none")
        numpy_gradient: Any = np.gradient  # whose overloads do not know an ArrayLike
        plain = numpy_gradient(f, *varargs, axis=axis, edge_order=edge_order)
        return tuple(plain) if isinstance(plain, (list, tuple)) else cast("Samples", plain)
    if edge_order not in (1, 2):
        raise ValueError(f"edge_order must be 1 or 2, got {edge_order!r}")
    values = arguments.signal("f", f)
    axes = _axes("axis", axis, values.ndim)
    spacing = varargs or (1.0,)
    if len(spacing) == 1 and np.ndim(spacing[0]) == 0:
        spacing = spacing * len(axes)
    if len(spacing) != len(axes):
        raise TypeError(f"spacing must be one number or one entry for each of the {len(axes)} axes, got {len(varargs)}")
    result = (_smoothed if flag("smooth", smooth) and axes else _alone)(values, axes, spacing, window_length, window)
    return result[0] if len(result) == 1 else tuple(result)


_DESIGN = {"kappa", "mu", "tau", "rule", "engine"}
_CALL = {"mode", "cval", "threads"}


def _alone(
    values: Samples, axes: list[int], spacing: Sequence[ArrayLike], window_length: PerAxis, window: dict[str, Any]
) -> list[Samples]:
    """Return the derivative along each axis."""
    design = {name: value for name, value in window.items() if name not in _CALL}
    call = {name: value for name, value in window.items() if name in _CALL}
    lengths = each("window_length", window_length, len(axes))
    degrees = each("degree", design.pop("degree", None), len(axes))
    result = []
    for axis, step, length, degree in zip(axes, _steps(spacing, axes, values.shape), lengths, degrees, strict=True):
        derivative = Differentiator(length, 1, degree=degree, delta=abs(step), **design)(values, axis, **call)
        result.append(derivative if step > 0 else np.negative(derivative, out=derivative))
    return result


def _smoothed(
    values: Samples, axes: list[int], spacing: Sequence[ArrayLike], window_length: PerAxis, window: dict[str, Any]
) -> list[Samples]:
    """Return the derivative along each axis, smoothed along the others."""
    refused = window.keys() & {"delay", "trim"}
    if refused:
        raise ValueError(f"{' and '.join(sorted(refused))} must be left out with smooth = True, got {window}")
    words = {**window, "spacing": spacing, "axes": tuple(axes)}
    field = Field.of("gradient", values, window_length, 1, smooth=True, **words)
    wanted = {tuple(int(axis == one) for axis in axes): field.empty() for one in axes}
    field.write(wanted)
    return [field.restored(out) for out in wanted.values()]


def flag(name: str, value: object) -> bool:
    """Return a truth value as it is."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} must be True or False, got {value!r}")
    return bool(value)


def each(name: str, value: Any, count: int) -> list[Any]:
    """Return one entry for each of `count` axes, of that many or of one for all."""
    if not several(value):
        return [value] * count
    if len(value) != count:
        raise ValueError(f"{name} must be one for all or one for each of {count} axes, got {len(value)} entries")
    return list(value)


def several(value: object) -> bool:
    """Return whether there may be an entry for each axis."""
    word = isinstance(value, (str, bytes))
    return (isinstance(value, Sequence) and not word) or (isinstance(value, np.ndarray) and value.ndim > 0)


class Part(NamedTuple):
    """Samples, and the value that they go on with beyond their ends in mode "constant"."""

    samples: Samples
    beyond: complex


class Pass(NamedTuple):
    """A window along one axis: what is said of it, and what is said of all."""

    axis: int
    window_length: int
    degree: int
    step: float
    design: dict[str, Any]
    call: dict[str, Any]

    def __call__(self, part: Part, orders: tuple[int, ...], out: Samples | None = None) -> list[Part]:
        """Return derivatives of `part`, of several orders in one pass."""
        design = Differentiator(self.window_length, orders, degree=self.degree, delta=abs(self.step), **self.design)
        results = design(part.samples, self.axis, cval=part.beyond, out=out, **self.call)
        # Beyond the ends of the other axes there are lines of one value, and this is what the window makes of them.
        constants = design(np.full(self.window_length, part.beyond), mode="valid")[:, 0]
        return [Part(result, constant.item()) for result, constant in zip(results, constants, strict=True)]


class Field(NamedTuple):
    """An array whose axes are in the order of its memory, and passes along them: the one of the closest steps first.

    Most orders at once are made by the first passes, and several orders are made fastest along the closest steps.
    """

    part: Part
    passes: tuple[Pass, ...]
    places: tuple[int, ...]  # of the passes among the axes that were asked for
    order: list[int]
    smooth: bool

    @classmethod
    def of(
        cls,
        caller: str,
        f: ArrayLike,
        window_length: PerAxis,
        highest: int,
        *,
        spacing: Any,
        axes: int | tuple[int, ...] | None,
        degree: Any = None,
        smooth: bool,
        **window: Any,
    ) -> Field:
        """Check the arguments of `caller`, whose orders along any axis are at most `highest`."""
        unknown = window.keys() - _DESIGN - _CALL
        if unknown:
            raise TypeError(f"{caller} got unexpected keywords: {', '.join(sorted(unknown))}")
        design = {name: value for name, value in window.items() if name in _DESIGN}
        call = {name: value for name, value in window.items() if name in _CALL}
        if isinstance(call.get("mode"), str) and call["mode"] == "valid":
            raise ValueError("mode must keep the shape, as 'fit', 'nan', 'nearest' and so on do, got 'valid'")
        values = arguments.signal("f", f)
        kind = arguments.number if values.dtype.kind == "c" else arguments.real
        cval = kind("cval", call.pop("cval", 0.0))
        found = _axes("axes", axes, values.ndim)
        if not found:
            raise ValueError(f"axes must name at least one axis, got {axes}")
        lengths = each("window_length", window_length, len(found))
        degrees = [highest + 2 if one is None else one for one in each("degree", degree, len(found))]
        sizes = _steps(each("spacing", spacing, len(found)), found, values.shape)
        order = memory_order(values)
        places = sorted(range(len(found)), key=lambda place: -order.index(found[place]))
        passes = (
            Pass(order.index(found[place]), lengths[place], degrees[place], sizes[place], design, call)
            for place in places
        )
        return cls(Part(values.transpose(order), cval), tuple(passes), tuple(places), order, flag("smooth", smooth))

    def empty(self, *leading: int) -> Samples:
        """Return an array for results, maybe with leading axes."""
        samples = self.part.samples
        return np.empty((*leading, *samples.shape), arguments.working_dtype(samples.dtype))

    def restored(self, result: Samples) -> Samples:
        """Return a result with its axes in the order in which they were given."""
        leading = result.ndim - len(self.order)
        return result.transpose(*range(leading), *(leading + np.argsort(self.order)))

    def write(self, wanted: Mapping[tuple[int, ...], Samples]) -> None:
        """Write derivatives, by their orders along the axes that were asked for; the orders have one sum."""
        kept = [k for k, place in enumerate(self.places) if self.smooth or any(orders[place] for orders in wanted)]
        passes = [self.passes[k] for k in kept]
        by_pass = {tuple(orders[self.places[k]] for k in kept): out for orders, out in wanted.items()}
        _write(self.part, passes, by_pass, self.smooth)
        for orders, out in by_pass.items():
            if sum(order for order, one in zip(orders, passes, strict=True) if one.step < 0) % 2:
                np.negative(out, out=out)


def _write(part: Part, passes: Sequence[Pass], wanted: Mapping[tuple[int, ...], Samples], smooth: bool) -> None:
    """Write derivatives of `part`; those that begin with the same orders share the passes that make them."""
    if not passes or (len(passes) == 1 and not smooth and wanted.keys() == {(0,)}):
        for out in wanted.values():
            np.copyto(out, part.samples)
    elif len(passes) == 1:
        for orders, out in wanted.items():
            passes[0](part, orders, out[np.newaxis])
    else:
        first = sorted({orders[0] for orders in wanted})
        made = tuple(order for order in first if smooth or order > 0)
        parts = dict(zip(made, passes[0](part, made), strict=True)) if made else {}
        for order in first:
            rest = {orders[1:]: out for orders, out in wanted.items() if orders[0] == order}
            _write(parts.get(order, part), passes[1:], rest, smooth)


def _axes(name: str, axis: int | tuple[int, ...] | None, ndim: int) -> list[int]:
    if axis is None:
        return list(range(ndim))
    axes = [arguments.axis_index(one, ndim) for one in (axis if isinstance(axis, (tuple, list)) else (axis,))]
    if len(set(axes)) < len(axes):
        raise ValueError(f"{name} must name every axis once, got {axis}")
    return axes


def _steps(spacing: Sequence[ArrayLike], axes: list[int], shape: tuple[int, ...]) -> list[float]:
    return [_step(entry, shape[axis]) for entry, axis in zip(spacing, axes, strict=True)]


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
