"""Differentiate pandas objects: the same object comes back, and its index says when the samples were taken."""

from __future__ import annotations

from typing import Any, SupportsIndex

import numpy as np

from algdiff import _arguments as arguments
from algdiff._arguments import Samples
from algdiff._labels import Call, parts_of
from algdiff._refusals import listed
from algdiff._results import Estimates

try:
    import pandas as pd
except ImportError as _error:
    raise ImportError(f"algdiff.pandas needs pandas: pip install 'algdiff-rs[pandas]' ({_error})") from _error

__all__ = ["differentiate"]

_INTEGERS = (pd.Int8Dtype, pd.Int16Dtype, pd.Int32Dtype, pd.Int64Dtype)
_UNSIGNED = (pd.UInt8Dtype, pd.UInt16Dtype, pd.UInt32Dtype, pd.UInt64Dtype)
NULLABLE = (pd.Float32Dtype, pd.Float64Dtype, *_INTEGERS, *_UNSIGNED, pd.BooleanDtype, pd.ArrowDtype)


def differentiate(
    obj: pd.Series | pd.DataFrame,
    window_length: SupportsIndex | None = None,
    deriv: Any = 1,
    *,
    delta: float | None = None,
    fs: float | None = None,
    t: Any = None,
    at: Any = None,
    **options: Any,
) -> Any:
    """Differentiate a Series, or every column of a DataFrame, along its index.

    Parameters
    ----------
    obj : Series or DataFrame
        Samples: numbers, also nullable and Arrow's. A missing one (``pd.NA``, NaN or null) is treated by `nan_policy`.
    window_length : int, optional
        Number of samples in the window. Give this or `window_duration`.
    deriv : int or sequence of int
        Order of the derivative, or several.
    delta, fs : float, optional
        Sampling step or rate. By default the index says when the samples were taken: numbers in their own unit, so that
        the step of a default index is 1; datetimes, timedeltas and the beginnings of periods in seconds. They must
        ascend or descend; uneven ones are differentiated as such.
    t : array_like, optional
        Instead: the times of the samples, as a column holds them.
    at : array_like, optional
        Times, of the kind of the index, at which estimates are wanted; they become the index of the result. With
        `delta` or `fs`, counted from the first sample.
    **options
        Other keywords of `algdiff.differentiate`, without `axis` and `out`. ``mode="valid"`` keeps the rows whose
        window lies within the data, whatever `tau`. `window_duration` may also be a Timedelta or a string like "2s".
        `weights` and `sigma` may be pandas objects with the index (and columns) of `obj`.

    Returns
    -------
    Series or DataFrame, or Estimates of these
        Index, columns, names and attrs are those of `obj`. float32 stays, and so do complex numbers; other numbers
        become float64, of nullable dtypes Float64 or Float32, of Arrow's double or float, with missing estimates.
        Several orders become the columns "deriv" of a Series, and the outermost level of the columns of a DataFrame.

    Raises
    ------
    TypeError
        A column is not numeric, or the index holds neither numbers nor times.
    ValueError
        The index is not sorted or has duplicates; otherwise see `algdiff.Differentiator`.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from algdiff.pandas import differentiate
    >>> index = pd.date_range("2026-01-01", periods=200, freq="10ms")
    >>> x = pd.Series(np.arange(200.0) ** 2, index, name="x")
    >>> differentiate(x, 21).tail(2)
    2026-01-01 00:00:01.980    39600.0
    2026-01-01 00:00:01.990    39800.0
    Freq: 10ms, Name: x, dtype: float64
    >>> differentiate(x.to_frame(), 21, deriv=(1, 2)).columns.tolist()
    [(1, 'x'), (2, 'x')]

    Groups of rows that are all 10 ms apart:

    >>> table = pd.DataFrame({"id": np.tile(["a", "b"], 100), "x": x.to_numpy()})
    >>> slope = table.groupby("id")["x"].transform(differentiate, window_length=21, delta=0.01)
    >>> slope.iloc[[0, 1, 198, 199]].round(6).tolist()
    [0.0, 400.0, 79200.0, 79600.0]
    """
    if not isinstance(obj, (pd.Series, pd.DataFrame)):
        raise TypeError(f"obj must be a Series or DataFrame, got {type(obj).__name__}")
    words = {"delta": delta, "fs": fs, "t": _aligned("t", t, obj), "at": at, **options}
    for name in ("weights", "sigma"):
        words[name] = _numbers(name, _aligned(name, options.get(name), obj))
        if np.ndim(words[name]) == 2 and np.shape(words[name]) != (obj.to_frame() if obj.ndim == 1 else obj).shape:
            raise ValueError(f"{name} must have shape {obj.shape[:1]} or that of obj, got {np.shape(words[name])}")
    call = Call(window_length, deriv, words, "samples lie along the index")
    table = obj.to_frame() if isinstance(obj, pd.Series) else obj
    groups = _groups(table, isinstance(obj, pd.Series))
    call.place("index", obj.index, len(obj))
    index = obj.index if call.cut is None else obj.index[call.cut]
    if at is not None:
        index = pd.Index(at, name=obj.index.name)
    found = [(columns, _run(call, table, columns, dtype)) for dtype, columns in groups.items()]
    made = {}
    for name in parts_of(found[0][1]):
        parts = [(columns, getattr(group, name)) for columns, group in found]
        if call.orders is None or name == "support":
            made[name] = _built(parts, obj, table, index)
        else:
            orders = [[(columns, part[i]) for columns, part in parts] for i in range(len(call.orders))]
            single = [_built(order, obj, table, index) for order in orders]
            made[name] = pd.concat(single, axis=1, keys=call.orders, names=["deriv"])
        made[name] = made[name].__finalize__(obj)
    return call.returned(made)


def _aligned(name: str, given: Any, obj: Any) -> Any:
    """Return what is given for every sample, if it has the labels of `obj` in case it has any."""
    if not isinstance(given, (pd.Series, pd.DataFrame)):
        return given
    same = given.index.equals(obj.index)
    if isinstance(given, pd.DataFrame) and isinstance(obj, pd.DataFrame):
        same = same and given.columns.equals(obj.columns)
    if not same:
        raise ValueError(f"{name} must have the labels of obj, in the same order, got other ones: give an array")
    return given


def _numbers(name: str, given: Any) -> Any:
    if not isinstance(given, (pd.Series, pd.DataFrame)):
        return given
    for dtype in [given.dtype] if isinstance(given, pd.Series) else given.dtypes:
        if getattr(dtype, "kind", "O") not in "fiub":
            raise TypeError(f"{name} must be real numbers, got dtype {dtype}")
    return given.to_numpy(dtype=np.float64, na_value=np.nan)


def _groups(table: Any, alone: bool) -> dict[np.dtype[Any], list[int]]:
    """Return the places of the columns by the type that they are worked on in; refuse what is not numeric."""
    groups: dict[np.dtype[Any], list[int]] = {}
    wrong = []
    for place, dtype in enumerate(table.dtypes):
        known = isinstance(dtype, (np.dtype, pd.SparseDtype, *NULLABLE))
        if not known or dtype.kind not in "fiubc":
            wrong.append(f"dtype {dtype}" if alone else f"{table.columns[place]!r} ({dtype})")
            continue
        plain = dtype.subtype if isinstance(dtype, pd.SparseDtype) else getattr(dtype, "numpy_dtype", dtype)
        groups.setdefault(arguments.working_dtype(np.dtype(plain)), []).append(place)
    if wrong:
        hint = "" if alone else ": select the columns to differentiate"
        raise TypeError(f"{'obj' if alone else 'columns'} must be numeric, got {listed(wrong)}{hint}")
    if not groups:
        raise ValueError("obj must have at least one column, got none")
    return groups


def _run(call: Call, table: Any, columns: list[int], dtype: np.dtype[Any]) -> Estimates:
    """Return the estimates of columns that are worked on in the same type."""
    part = table.iloc[:, columns] if len(columns) < table.shape[1] else table
    kinds = set(part.dtypes)
    if len(kinds) == 1 and isinstance(part.dtypes.iloc[0], np.dtype):
        values: Samples = part.to_numpy()
    elif any(isinstance(kind, NULLABLE) for kind in kinds):
        values = part.to_numpy(dtype=dtype, na_value=np.nan)
    else:
        values = part.to_numpy(dtype=dtype)
    own = {name: call.words[name] for name in ("weights", "sigma") if np.ndim(call.words.get(name, 0)) == 2}
    return call.run(values, 0, **{name: np.asarray(each)[:, columns] for name, each in own.items()})


def _built(parts: list[tuple[list[int], Samples]], obj: Any, table: Any, index: Any) -> Any:
    """Return the columns of one order as an object like `obj`."""
    if len(parts) == 1 and isinstance(obj, pd.DataFrame) and not any(isinstance(one, NULLABLE) for one in obj.dtypes):
        return pd.DataFrame(parts[0][1], index, obj.columns)
    made = {
        place: _column(values[:, position], table.dtypes.iloc[place])
        for columns, values in parts
        for position, place in enumerate(columns)
    }
    if isinstance(obj, pd.Series):
        return pd.Series(made[0], index, name=obj.name)
    result = pd.DataFrame({place: made[place] for place in range(table.shape[1])}, index)
    result.columns = table.columns
    return result


def _column(values: Samples, dtype: Any) -> Any:
    """Return a column with missing estimates as a column of `dtype` has missing samples."""
    if not isinstance(dtype, NULLABLE) or values.dtype.kind != "f":
        return values
    if isinstance(dtype, pd.ArrowDtype):
        import pyarrow as pa

        return pd.arrays.ArrowExtensionArray(pa.array(values, from_pandas=True))
    return pd.arrays.FloatingArray(values.copy(), np.isnan(values))
