"""One collection of nasty arrays for all tests: each a good signal in an awkward shape, or something to be refused."""

from __future__ import annotations

import datetime
import decimal
import fractions
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

SIGNAL = np.cumsum(np.random.default_rng(42).standard_normal(64))


class Table:
    """Has columns that happen to be named as the attributes of a quantity with units, as a data frame may."""

    def __init__(self) -> None:
        self.magnitude, self.unit, self.value = SIGNAL, SIGNAL, SIGNAL

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return SIGNAL.astype(dtype or float)


def awkward() -> Iterator[tuple[str, Any]]:
    """Yield arrays, and other sequences, that hold `SIGNAL` in every layout and dtype that a caller may bring."""
    x = SIGNAL
    yield "list", x.tolist()
    yield "tuple", tuple(x.tolist())
    yield "big endian", x.astype(">f8")
    yield "little endian", x.astype("<f8")
    yield "big endian single", x.astype(">f4")
    yield "single", x.astype(np.float32)
    yield "half", x.astype(np.float16)
    yield "long double", x.astype(np.longdouble)
    yield "complex", x + 1j * x[::-1]
    yield "complex single", (x + 1j * x[::-1]).astype(np.complex64)
    yield "big endian complex", (x + 1j * x[::-1]).astype(">c16")
    for kind in [np.int8, np.uint8, np.int16, ">i4", np.int64, np.uint64, bool]:
        yield f"{np.dtype(kind).str} integers", np.abs(x).astype(kind)
    yield "strided", np.repeat(x, 3)[::3]
    yield "reversed", x[::-1].copy()[::-1]
    packed = np.zeros(len(x), dtype=[("flag", "i1"), ("x", "f8"), ("y", "f4")])
    packed["x"], packed["y"] = x, x
    yield "packed record field", packed["x"]
    yield "packed single record field", packed["y"]
    raw = np.zeros(len(x) * 8 + 1, np.uint8)
    misaligned = raw[1:].view(np.float64)
    misaligned[:] = x
    yield "misaligned", misaligned
    read_only = x.copy()
    read_only.flags.writeable = False
    yield "read-only", read_only
    yield "broadcast", np.broadcast_to(np.float64(3.5), 64)
    yield "masked without a mask", np.ma.masked_array(x)
    yield "masked with an empty mask", np.ma.masked_array(x, mask=np.zeros(64, bool))
    yield "subclass", x.view(np.recarray)
    yield "memoryview", memoryview(x.copy())
    yield "array protocol", type("Holder", (), {"__array__": lambda *_, **__: SIGNAL.copy()})()
    yield "table with a column named magnitude", Table()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.npy"
        np.save(path, x)
        mapped = np.load(path, mmap_mode="r")
        yield "memory map", mapped
        del mapped
    yield "offset 1e9", x + 1e9
    yield "tiny", x * 1e-300
    yield "huge", x * 1e290
    yield "subnormal", x * 5e-324
    yield "denormal zero", np.full(64, -0.0)


def awkward_matrices() -> Iterator[tuple[str, Any]]:
    """Yield two-dimensional arrays of every layout, 64 samples along each axis."""
    x = np.random.default_rng(43).standard_normal((64, 64))
    yield "C order", x
    yield "Fortran order", np.asfortranarray(x)
    yield "transposed", x.T
    yield "strided", np.repeat(np.repeat(x, 2, 0), 2, 1)[::2, ::2]
    yield "negative strides", x[::-1, ::-1]
    yield "zero stride along time", np.broadcast_to(x[:, :1], (64, 64))
    yield "zero stride across", np.broadcast_to(x[:1], (64, 64))
    yield "matrix subclass", x.view(np.matrix)
    yield "big endian", x.astype(">f8")
    yield "nested lists", x.tolist()
    field = np.zeros((64, 64), dtype=[("a", "i1"), ("x", "f8")])
    field["x"] = x
    yield "packed record field", field["x"]


def refused() -> Iterator[tuple[str, Any, type[Exception]]]:
    """Yield what no function can differentiate, with the error that it must raise."""
    x = SIGNAL
    yield "object", x.astype(object), TypeError
    yield "decimals", [decimal.Decimal(1)] * 64, TypeError
    yield "fractions", [fractions.Fraction(1, 3)] * 64, TypeError
    yield "None", None, TypeError
    yield "None inside", [None] * 64, TypeError
    yield "strings", ["1.0"] * 64, TypeError
    yield "a string", "123", TypeError
    yield "bytes", b"0123456789" * 7, TypeError
    yield "dates", np.arange("2020-01-01", "2020-03-05", dtype="M8[D]"), TypeError
    yield "durations", np.arange(64).astype("m8[s]"), TypeError
    yield "python dates", [datetime.date(2020, 1, 1)] * 64, TypeError
    yield "records", np.zeros(64, dtype=[("x", "f8")]), TypeError
    yield "void", np.zeros(64, "V8"), TypeError
    yield "masked", np.ma.masked_array(x, mask=x > 0), TypeError
    yield "dictionary", {"x": 1}, TypeError
    yield "set", {1.0, 2.0}, TypeError
    yield "generator", (value for value in x), TypeError
    yield "ragged", [[1.0, 2.0], [3.0]], ValueError
    yield "scalar", 3.0, ValueError
    yield "zero dimensions", np.array(3.0), ValueError
    yield "empty", np.array([]), ValueError
    yield "empty list", [], ValueError
    yield "one sample", [1.0], ValueError
    yield "shorter than the window", x[:4], ValueError
    yield "units", type("Quantity", (), {"magnitude": x, "units": "m", "__array__": lambda *_, **__: x})(), TypeError
    yield "other units", type("Quantity", (), {"value": x, "unit": "m", "__array__": lambda *_, **__: x})(), TypeError
