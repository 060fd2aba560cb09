"""Differentiate xarray objects along a dimension, whose coordinate says when the samples were taken.

Importing this module adds the accessor ``algdiff`` to `xarray.DataArray` and `xarray.Dataset`.
"""

from __future__ import annotations

import re
from collections.abc import Hashable
from typing import Any, SupportsIndex

import numpy as np

from algdiff._labels import Call, kept, parts_of
from algdiff._refusals import listed, shown

try:
    import xarray as xr
except ImportError as _error:
    raise ImportError(f"algdiff.xarray needs xarray: pip install 'algdiff-rs[xarray]' ({_error})") from _error

__all__ = ["differentiate"]

LEADING = "deriv"
"""The dimension of several orders."""


def differentiate(
    obj: xr.DataArray | xr.Dataset,
    dim: Hashable,
    window_length: SupportsIndex | None = None,
    deriv: Any = 1,
    *,
    delta: float | None = None,
    fs: float | None = None,
    t: Any = None,
    at: Any = None,
    **options: Any,
) -> Any:
    """Differentiate a DataArray, or the variables of a Dataset, along a dimension.

    Parameters
    ----------
    obj : DataArray or Dataset
        Samples, also in chunks of Dask, which stay lazy.
    dim : hashable
        The dimension of time. Variables of a Dataset that lack it are left as they are.
    window_length : int, optional
        Number of samples in the window. Give this or `window_duration`.
    deriv : int or sequence of int
        Order of the derivative, or several.
    delta, fs : float, optional
        Sampling step or rate. By default the coordinate of `dim` says when the samples were taken: numbers in their
        own unit, datetimes and timedeltas in seconds. They must ascend or descend; uneven ones are differentiated as
        such. Without a coordinate the step is 1.
    t : array_like, optional
        Instead: the times of the samples, as another coordinate along `dim` holds them.
    at : array_like, optional
        Times, of the kind of the coordinate, at which estimates are wanted; they become the coordinate of the result,
        the only one along `dim`. With `delta`, `fs` or no coordinate, counted from the first sample.
    **options
        Other keywords of `algdiff.differentiate`, without `axis` and `out`. ``mode="valid"`` keeps the samples whose
        window lies within the data, whatever `tau`. `window_duration` may also be a Timedelta or a string like "2s".
        `weights` and `sigma` may be DataArrays with the coordinates of `obj`.

    Returns
    -------
    DataArray or Dataset, or Estimates of these
        Dimensions, coordinates, names and attrs are those of `obj`; the encoding of what was differentiated is not.
        The units of the attrs are divided by those of the coordinate ("m" becomes "m s-1"), and left out if these are
        not known. Several orders lie along a leading dimension "deriv", without units. Of a Dataset, the parts of
        `Estimates` other than `estimate` hold only what was differentiated.

    Raises
    ------
    TypeError
        A variable along `dim` is not numeric, or the coordinate holds neither numbers nor times, as those of cftime.
    ValueError
        `dim` does not exist, the coordinate is not sorted or has duplicates; otherwise see `algdiff.Differentiator`.

    Examples
    --------
    >>> import numpy as np
    >>> import xarray as xr
    >>> from algdiff.xarray import differentiate
    >>> time = np.datetime64("2026-01-01", "ms") + 10 * np.arange(200)
    >>> x = xr.DataArray(np.arange(200.0) ** 2, {"time": time}, ["time"], "x", {"units": "m"})
    >>> speed = differentiate(x, "time", 21)
    >>> speed.values[-2:].round(6), speed.attrs
    (array([39600., 39800.]), {'units': 'm s-1'})

    With the accessor, on a Dataset:

    >>> both = x.to_dataset().algdiff.differentiate("time", 21, deriv=(1, 2))
    >>> both.x.dims, both.x.sel(deriv=2).values[:2].round(6)
    (('deriv', 'time'), array([20000., 20000.]))
    """
    if not isinstance(obj, (xr.DataArray, xr.Dataset)):
        raise TypeError(f"obj must be a DataArray or Dataset, got {type(obj).__name__}")
    if dim not in obj.dims:
        raise ValueError(f"dim must be one of {tuple(obj.dims)}, got {shown(dim)}")
    if isinstance(t, xr.DataArray):
        _check_times(t, obj, dim)
    words = {"delta": delta, "fs": fs, "t": _values(t), "at": _values(at), **options}
    call = Call(window_length, deriv, words, f"samples lie along {dim!r}")
    if call.orders and any(LEADING in names for names in (obj.dims, obj.coords, getattr(obj, "data_vars", ()))):
        raise ValueError(f"obj must have no {LEADING!r} for several orders, got one: rename it")
    variables = {"": obj} if isinstance(obj, xr.DataArray) else {name: obj[name] for name in obj.data_vars}
    along = {name: one for name, one in variables.items() if dim in one.dims}
    _check_numeric(along)
    call.place(f"the coordinate {dim!r}", _labels(obj, dim), obj.sizes[dim])
    unit = _unit(obj.coords[dim] if t is None and dim in obj.coords else t)
    found = {name: _run(call, one, dim, unit) for name, one in along.items()}
    if isinstance(obj, xr.DataArray):
        return call.returned({part: _array(call, obj, dim, *data) for part, data in found[""].items()})
    parts = dict.fromkeys(part for made in found.values() for part in made) or ["estimate"]
    return call.returned({part: _dataset(call, obj, dim, part, found) for part in parts})


def _values(given: Any) -> Any:
    """Return the values of a coordinate, or what is given instead."""
    return given.to_index() if isinstance(given, xr.DataArray) and given.ndim == 1 else given


def _check_times(t: Any, obj: Any, dim: Hashable) -> None:
    """Refuse times that are those of other samples."""
    if t.dims != (dim,):
        raise ValueError(f"t must lie along {dim!r}, got dimensions {t.dims}")
    if dim in t.indexes and dim in obj.indexes and not t.indexes[dim].equals(obj.indexes[dim]):
        raise ValueError(f"t must have the coordinate {dim!r} of obj, got another")


def _labels(obj: Any, dim: Hashable) -> Any:
    if dim in obj.indexes:
        return obj.indexes[dim]
    return obj.coords[dim].to_index() if dim in obj.coords else None


def _check_numeric(variables: dict[Any, Any]) -> None:
    wrong = {
        name: one.dtype
        for name, one in variables.items()
        if not isinstance(one.dtype, np.dtype) or one.dtype.kind not in "fiubc"
    }
    if "" in wrong and len(variables) == 1:
        raise TypeError(f"obj must be numeric, got dtype {wrong['']}")
    if wrong:
        names = listed([f"{name!r} ({dtype})" for name, dtype in wrong.items()])
        raise TypeError(f"variables along dim must be numeric, got {names}: select those to differentiate")


def _unit(times: Any) -> str | None:
    """Return the unit of times, if it is known."""
    kind = getattr(getattr(times, "dtype", None), "kind", "")
    if kind and kind in "mM":
        return "s"
    unit = getattr(times, "attrs", {}).get("units")
    return unit.split(" since ")[0].strip() or "1" if isinstance(unit, str) else None


def _divided(attrs: dict[Any, Any], unit: str | None, deriv: Any) -> dict[Any, Any]:
    """Return attrs with their units over those of time, or without if these are not known."""
    attrs, units = dict(attrs), attrs.get("units")
    if units is None or deriv == 0 or (unit == "1" and not isinstance(deriv, tuple)):
        return attrs
    del attrs["units"]
    if unit is not None and isinstance(units, str) and not isinstance(deriv, tuple):
        base = unit if re.fullmatch(r"[^\W\d]+", unit) else f"({unit})"
        start = units.split(" since ")[0].strip()
        attrs["units"] = f"{base}-{deriv}" if start in ("1", "") else f"{start} {base}-{deriv}"
    return attrs


def _run(call: Call, array: Any, dim: Hashable, unit: str | None) -> dict[str, tuple[Any, Any, dict[Any, Any]]]:
    """Return the dimensions, data and attrs of what there is to know of one variable."""
    own = {
        name: _per_sample(name, call.words[name], array, dim)
        for name in ("weights", "sigma")
        if isinstance(call.words.get(name), xr.DataArray)
    }
    found = parts_of(call.run(array.data, array.get_axis_num(dim), **own))
    attrs = _divided(array.attrs, unit, call.deriv)
    dims = (LEADING, *array.dims) if call.orders else array.dims
    made = {part: (dims, data, attrs) for part, data in found.items()}
    if "support" in made:
        plain = {name: value for name, value in array.attrs.items() if name != "units"}
        made["support"] = (array.dims, found["support"], plain)
    return made


def _per_sample(name: str, given: Any, array: Any, dim: Hashable) -> Any:
    """Return numbers for the samples of a row or of all, in the order of the dimensions of `array`."""
    if not set(given.dims) <= set(array.dims):
        raise ValueError(f"{name} must have dimensions of obj, {array.dims}, got {given.dims}")
    try:
        xr.align(array, given, join="exact", copy=False)
    except ValueError as error:
        raise ValueError(f"{name} must have the coordinates of obj, got others ({error})") from None
    if given.dims in {(), (dim,)}:
        return given.data if given.ndim else given.item()
    return given.broadcast_like(array).transpose(*array.dims).data


def _coords(call: Call, obj: Any, dim: Hashable) -> Any:
    """Return the coordinates of the estimates, as a Dataset."""
    coords = obj.coords.to_dataset()
    if "at" in call.words:
        given = coords[dim].attrs if dim in coords.coords else {}
        coords = coords.drop_vars([name for name, one in coords.coords.items() if dim in one.dims])
        coords = coords.assign_coords({dim: (dim, np.asarray(call.words["at"]), given)})
    elif call.cut is not None:
        coords = coords.isel({dim: call.cut}, missing_dims="ignore")
        lazy = {name: one for name, one in obj.coords.items() if dim in one.dims and one.chunks is not None}
        for name, one in lazy.items():
            coords[name] = coords[name].copy(data=kept(one.data, one.get_axis_num(dim), call.cut))
    return coords


def _array(call: Call, obj: Any, dim: Hashable, dims: Any, data: Any, attrs: dict[Any, Any]) -> Any:
    made = xr.DataArray(data, _coords(call, obj, dim).coords, dims, obj.name, attrs)
    return made if call.orders is None or dims == obj.dims else made.assign_coords({LEADING: list(call.orders)})


def _dataset(call: Call, obj: Any, dim: Hashable, part: str, found: dict[Any, Any]) -> Any:
    """Return a Dataset of one part of the estimates; next to the estimates themselves with the other variables."""
    made = _coords(call, obj, dim)
    if call.orders is not None and part != "support":
        made = made.assign_coords({LEADING: list(call.orders)})
    for name in obj.data_vars:
        if name in found:
            made[name] = found[name][part]
        elif part == "estimate":
            made[name] = obj.variables[name]
    made.attrs, made.encoding = dict(obj.attrs), dict(obj.encoding)
    return made


class Accessor:
    """The accessor ``algdiff`` of DataArrays and Datasets."""

    def __init__(self, obj: Any) -> None:
        self._obj = obj

    def differentiate(
        self, dim: Hashable, window_length: SupportsIndex | None = None, deriv: Any = 1, **options: Any
    ) -> Any:
        """Differentiate along a dimension.

        Parameters
        ----------
        dim, window_length, deriv, **options
            As of `algdiff.xarray.differentiate`.

        Returns
        -------
        DataArray or Dataset, or Estimates of these

        Raises
        ------
        TypeError, ValueError
            As `algdiff.xarray.differentiate`.

        Examples
        --------
        >>> import numpy as np
        >>> import xarray as xr
        >>> import algdiff.xarray
        >>> xr.DataArray(np.arange(9.0) ** 2, dims="x").algdiff.differentiate("x", 5).values[-2:].round(9)
        array([14., 16.])
        """
        return differentiate(self._obj, dim, window_length, deriv, **options)


_REGISTER: dict[Any, Any] = {
    xr.DataArray: xr.register_dataarray_accessor,
    xr.Dataset: xr.register_dataset_accessor,
}
for _kind, _register in _REGISTER.items():
    if not hasattr(_kind, "algdiff"):  # already there if the module is loaded again
        _register("algdiff")(Accessor)
