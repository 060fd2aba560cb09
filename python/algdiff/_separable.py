"""Windows along one axis after another, of which derivatives of arrays are made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, SupportsIndex, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._differentiator import Differentiator
from algdiff._layout import memory_order
from algdiff._refusals import shown
from algdiff._times import Stamps

PerAxis: TypeAlias = SupportsIndex | Sequence[SupportsIndex]

DESIGN = {"kappa", "mu", "tau", "rule", "engine"}
CALL = {"mode", "cval", "nan_policy", "min_support", "max_gain", "threads"}
"""Keywords of a design and of a call that are the same along all axes."""


def flag(name: str, value: object) -> bool:
    """Return a truth value as it is."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} must be True or False, got {shown(value)}")
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
    spacing: Spacing
    design: dict[str, Any]
    call: dict[str, Any]

    def __call__(self, part: Part, orders: tuple[int, ...], out: Samples | None = None) -> list[Part]:
        """Return derivatives of `part`, of several orders in one pass."""
        along = self.spacing
        design = Differentiator(self.window_length, orders, degree=self.degree, delta=along.step, **self.design)
        results = design(part.samples, self.axis, cval=part.beyond, t=along.t, out=out, **self.call)
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
        unknown = window.keys() - DESIGN - CALL
        if unknown:
            known = ", ".join(sorted(DESIGN | CALL))
            raise TypeError(f"{caller} got unexpected keywords: {', '.join(sorted(unknown))}: use {known}")
        design = {name: value for name, value in window.items() if name in DESIGN}
        call = {name: value for name, value in window.items() if name in CALL}
        if isinstance(call.get("mode"), str) and call["mode"] == "valid":
            raise ValueError("mode must keep the shape, as 'fit', 'nan', 'nearest' and so on do, got 'valid'")
        values = arguments.unmasked("f", f)
        kind = arguments.number if values.dtype.kind == "c" else arguments.real
        cval = kind("cval", call.pop("cval", 0.0))
        found = axes_of("axes", axes, values.ndim)
        if not found:
            raise ValueError(f"axes must name at least one axis, got {axes}")
        lengths = each("window_length", window_length, len(found))
        degrees = [highest + 2 if one is None else one for one in each("degree", degree, len(found))]
        sizes = spacings(each("spacing", spacing, len(found)), found, values.shape)
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
            if sum(order for order, one in zip(orders, passes, strict=True) if one.spacing.descends) % 2:
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


def axes_of(name: str, axis: int | tuple[int, ...] | None, ndim: int) -> list[int]:
    if axis is None:
        return list(range(ndim))
    axes = [arguments.axis_index(one, ndim) for one in (axis if isinstance(axis, (tuple, list)) else (axis,))]
    if len(set(axes)) < len(axes):
        raise ValueError(f"{name} must name every axis once, got {axis}")
    return axes


class Spacing(NamedTuple):
    """How the samples lie along an axis.

    Attributes
    ----------
    step : float
        The step, without its sign; 1 for uneven samples.
    t : ndarray or None
        The places of uneven samples, ascending.
    descends : bool
        Whether the coordinates descend, so that derivatives of odd order change their sign.
    """

    step: float
    t: Samples | None
    descends: bool


def spacings(spacing: Sequence[ArrayLike], axes: list[int], shape: tuple[int, ...]) -> list[Spacing]:
    """Return how the samples lie along each of `axes`."""
    return [_spacing(entry, shape[axis]) for entry, axis in zip(spacing, axes, strict=True)]


def _spacing(spacing: ArrayLike, size: int) -> Spacing:
    """Understand a number, or the coordinates of `size` samples."""
    if np.ndim(spacing) > 0:
        coordinates = arguments.samples("coordinates", spacing)
        if coordinates.shape != (size,):
            raise ValueError(f"coordinates must have shape ({size},), got {coordinates.shape}")
        try:
            stamps = Stamps(spacing, size)
        except ValueError as error:
            raise ValueError(str(error).replace("t must", "coordinates must", 1)) from None
        if stamps.step is None and size > 1:
            given = np.asarray(spacing, np.float64)
            return Spacing(1.0, -given if stamps.descending else given, stamps.descending)
        return Spacing(1.0 if stamps.step is None else stamps.step, None, stamps.descending)
    step = arguments.real("spacing", spacing)
    if not (np.isfinite(step) and step != 0):
        raise ValueError(f"spacing must be finite and not zero, got {step:g}")
    return Spacing(abs(step), None, step < 0)
