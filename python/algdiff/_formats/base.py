"""What a format offers: an array in a file, read and written region by region."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[Any]
Place = tuple[slice, ...]
"""A region of an array: one slice of step 1 for every axis."""


@dataclass(frozen=True)
class Options:
    """How an input is to be read, as far as its file does not say.

    Attributes
    ----------
    key : str or None
        Name of the array in an ``.npz`` file.
    columns : tuple of str or None
        Columns of a table, by name or by position counted from 0.
    time : str or None
        The column of a table that holds the times of its rows.
    dtype : numpy.dtype or None
        Type of the numbers of a raw binary file.
    channels : int or None
        Channels of a raw binary file, which alternate sample by sample; None makes it one-dimensional.
    offset : int
        Bytes before the first number of a raw binary file.
    memory : int or None
        Bytes that an array may take which can only be read whole; None sets no limit.
    """

    key: str | None = None
    columns: tuple[str, ...] | None = None
    time: str | None = None
    dtype: np.dtype[Any] | None = None
    channels: int | None = None
    offset: int = 0
    memory: int | None = None


class Source(ABC):
    """An array in a file, open for reading.

    Attributes
    ----------
    path : Path
        The file, or the folder of a store.
    shape : tuple of int
        Shape of the array.
    dtype : numpy.dtype
        Its type, as it is in the file; for text float64.
    axis : int
        The axis of time, unless the caller says another.
    fortran : bool
        Whether the first axis lies closest in the file, not the last.
    chunks : tuple of int or None
        What the file is read in, if it is not laid out as one array.
    step : float or None
        The sampling step that the file states, in seconds.
    names : tuple of str or None
        Names of the columns of a table, or of its only one.
    delimiter : str
        What separates the columns of a text.
    key : str or None
        Name of the array in an ``.npz`` file.
    time : str or None
        Name of the column of times, which `read` returns and which is none of `names`.
    time_dtype : numpy.dtype or None
        Type of the times: float64, or datetime64 of any unit.
    attributes : dict
        What else the file says of the array, for outputs that can hold it.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    axis: int = -1
    fortran: bool = False
    chunks: tuple[int, ...] | None = None
    step: float | None = None
    names: tuple[str, ...] | None = None
    delimiter: str = ","
    key: str | None = None
    time: str | None = None
    time_dtype: np.dtype[Any] | None = None

    def __init__(self, path: Path, file: Any = None) -> None:
        self.path, self.file = path, file
        self.attributes: dict[str, Any] = {}

    @abstractmethod
    def read(self, place: Place, out: Samples) -> Samples | None:
        """Fill `out`, of `dtype` and the shape of `place`; return the times of its rows, if the table holds times.

        Called by one thread at a time, with places in ascending order of time that may overlap.

        Raises
        ------
        ValueError
            The file holds less than it said, or something else.
        OSError
            It cannot be read.
        """

    def step_along(self, axis: int) -> float | None:
        """Return the sampling step that the file states for an axis, in seconds; None if it states none."""
        return self.step

    def stamp(self) -> list[int]:
        """Return numbers that change when the file does: its size and the time of its last change."""
        status = os.stat(self.path)
        return [status.st_size, status.st_mtime_ns]

    def close(self) -> None:
        """Close the file."""
        if self.file is not None:
            self.file.close()

    def __enter__(self) -> Source:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@dataclass(frozen=True)
class Layout:
    """What is written.

    Attributes
    ----------
    shape : tuple of int
        Shape of the result of one order.
    axis : int
        The axis of time in it, counted from the front.
    orders : tuple of int
        The derivative orders.
    leading : bool
        Whether the result has a leading axis over the orders. One without holds one order.
    dtype : numpy.dtype
        float32, float64, complex64 or complex128.
    fortran : bool
        Whether the first axis lies closest in the input, so that it should in the output.
    chunks : tuple of int or None
        Chunks of the input, if it has some.
    step : float or None
        The sampling step, in seconds; None if none was given and the input states none.
    names : tuple of str or None
        Names of the columns of the input.
    delimiter : str
        What separates the columns of a text.
    time : str or None
        Name of the column of times.
    time_dtype : numpy.dtype or None
        Type of the times.
    key : str
        Name of the array in an ``.npz`` file.
    attributes : dict
        What else the input says of its array.
    """

    shape: tuple[int, ...]
    axis: int
    orders: tuple[int, ...]
    leading: bool
    dtype: np.dtype[Any]
    fortran: bool = False
    chunks: tuple[int, ...] | None = None
    step: float | None = None
    names: tuple[str, ...] | None = None
    delimiter: str = ","
    time: str | None = None
    time_dtype: np.dtype[Any] | None = None
    key: str = "arr_0"
    attributes: dict[str, Any] = field(default_factory=dict)

    @property
    def full_shape(self) -> tuple[int, ...]:
        """Shape of the result with its leading axis."""
        return (len(self.orders), *self.shape) if self.leading else self.shape

    @property
    def nbytes(self) -> int:
        """Bytes of all numbers of the result."""
        count = self.dtype.itemsize
        for extent in self.full_shape:
            count *= extent
        return count

    @property
    def rows(self) -> tuple[int, int]:
        """Rows and columns of the result as a table: time along the rows, every order with all its channels."""
        if len(self.shape) not in (1, 2):
            raise ValueError(f"a table must have one or two dimensions, got shape {self.shape}")
        channels = self.shape[1 - self.axis] if len(self.shape) == 2 else 1
        return self.shape[self.axis], len(self.orders) * channels

    @property
    def columns(self) -> tuple[str, ...] | None:
        """Names of the columns of the result as a table; None where the input names none and there is one order."""
        names = self.names
        if not self.leading:
            return names
        if names is None:
            channels = self.rows[1] // len(self.orders)
            names = tuple(f"x{channel}" for channel in range(channels))
        return tuple(f"{name}_d{order}" for order in self.orders for name in names)


class Target(ABC):
    """A result under its temporary name, open for writing.

    Formats make one with their functions ``create`` and ``reopen``.
    """

    @abstractmethod
    def write(self, place: Place, block: Samples, times: Samples | None = None) -> None:
        """Write a region.

        Arrays: `place` in the shape of one order, `block` with a leading axis over the orders, even if the result has
        none. Tables: `place` one slice of the rows, in ascending order without gaps; `block` the rows; `times` what
        the input's column of times holds there, if it has one.
        """

    @abstractmethod
    def sync(self) -> int:
        """Make durable what was written, and return what ``reopen`` needs to go on there."""

    @abstractmethod
    def close(self) -> None:
        """Close the file; what was written stays."""
