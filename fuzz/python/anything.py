"""Values of any type for arguments, and those that make sense."""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np

RNG = np.random.default_rng(0)
ROW = RNG.standard_normal(60)
GAPS = np.where(RNG.random(60) < 0.2, np.nan, ROW)
UNEVEN = np.cumsum(RNG.uniform(0.5, 1.5, 60))
EVEN = 0.1 * np.arange(60)
TABLE = RNG.standard_normal((12, 9, 2))
MASKED = np.ma.masked_invalid(GAPS)


class Odd:
    """An object that is no number, array or sequence."""

    def __repr__(self) -> str:
        return "Odd\n()"


def words(text: str) -> tuple[str, ...]:
    """Return the words of a text."""
    return tuple(text.split())


KINDS_OF_NUMBERS = words("f4 f2 >f8 >f4 g c8 c16 i1 u8 ? O U5 S5 M8[s] m8[ms]")
NUMBERS: tuple[Any, ...] = (
    *range(-2, 12),
    *(21, 59, 60, 61, 10**7 + 1, 2**31, 2**63, 2**64, 10**400, True, False),
    *map(float, words("0 -0 1 1.5 0.5 -0.5 -0.999 -1 1e-3 1e-300 1e300 5e-324 1e4 1e6 nan inf -inf")),
    *(np.int8(5), np.uint64(7), np.float32(0.1), np.float64("nan"), np.float16(2), np.longdouble(3), np.bool_(True)),
    *(1j, np.complex64(1), Decimal("0.1"), Fraction(1, 3), np.timedelta64(2, "s"), np.datetime64("2026-01-01")),
)
WORDS: tuple[Any, ...] = (
    *words(
        "center root newest exact trapezoid midpoint simpson cell hat auto direct moments fft white conv dot float32"
    ),
    *words("fit valid nan nearest mirror wrap constant interp full shrink propagate omit raise f4,( 5"),
    *("", "a\nb", "\0", "\ud800", "x" * 5000, b"fit", bytearray(b"5")),
)
ARRAYS: tuple[Any, ...] = (
    *(ROW, GAPS, UNEVEN, EVEN, TABLE, ROW[::-1], ROW[::2], TABLE.T, np.asfortranarray(TABLE), TABLE[:, ::2]),
    *(np.empty(0), np.empty((0, 60)), np.empty((60, 0)), np.array(1.0), np.ones(1), np.abs(ROW) + 0.1, 1e9 + ROW),
    *(np.full(60, float(value)) for value in words("0 nan inf 1e308 5e-324")),
    *(np.where(EVEN > 3, 1e300, -1e300), np.where(EVEN > 3, 1e308, -1e308)),
    *(ROW.astype(kind) for kind in KINDS_OF_NUMBERS),
    *(np.zeros(60, [("a", "f8")]), MASKED, np.ma.masked_all(60), np.matrix(ROW), np.broadcast_to(1.0, (60, 3))),
    *(np.array([None] * 60), np.array([1, "a"], object), np.array([Odd()] * 3), np.arange(60, dtype="u1")),
    *(np.array(5), np.array([5]), np.array([1, 2]), np.array("center"), EVEN.astype("M8[s]")),
    *(np.arange(60), (1000 * EVEN).astype("m8[ms]")),
)
OTHERS: tuple[Any, ...] = (
    *(None, (), [], {}, set(), [1.0, 2.0, 4.0], [1, [2, 3]], [[1.0] * 9] * 9, (0, 1), (1, 2, 3), [1, 1], (2, 0)),
    *((1.5,), (None,), ("a",), [None] * 60, [True, False], {"a": 1}, range(60), memoryview(ROW), Odd(), Odd, len, ...),
    *(list(ROW), [math.nan] * 60, [[]], [[], []], [[[[1.0]]]], np.dtype("f8"), NotImplemented, np.ma.masked, slice(3)),
)
KINDS = (NUMBERS, NUMBERS, WORDS, ARRAYS, OTHERS)
SLOW = words("window_length degree deriv polyorder min_window max_window local order channels")
"""Arguments of which large integers take long."""
LONG = 100
LARGE = {"channels": 1e12}
"""From here to there, or to 1e7, they do: larger ones are refused."""

Usual = dict[str, Sequence[Any]]
DESIGN: Usual = {
    "degree": (None, 2, 3, 4),
    "kappa": (0, 1.0, 2, 0.5, -0.4),
    "mu": (0, 1, 2.0, 0.5),
    "tau": (None, "center", "root", "newest", 0.3, 1.2),
    "delay": (None, None, None, 0.2),
    "delta": (None, 0.1, 1),
    "fs": (None, None, 10),
    "rule": words("exact exact exact trapezoid midpoint cell hat simpson"),
    "trim": (0.0, 0.0, 0.01),
    "engine": words("auto direct moments fft"),
}
CALL: Usual = {
    "axis": (-1, 0, 1),
    "mode": words("fit valid nan nearest mirror wrap constant"),
    "cval": (0.0, 1.5, 1j),
    "t": (None, None, UNEVEN, EVEN),
    "at": (None, None, UNEVEN[5:9]),
    "window_duration": (None, None, None, 7.0),
    "edge_window": words("full full shrink"),
    "nan_policy": words("propagate omit raise"),
    "min_support": (None, None, 5),
    "max_gain": (None, None, 10.0),
    "weights": (None, None, np.abs(ROW) + 0.1),
    "period": (None, None, 6.28),
    "return_std": (False, True),
    "return_support": (False, True),
    "return_bias": (False, False, True),
    "sigma": (None, None, 0.1),
    "autocovariance": (None, None, [1.0, 0.5]),
    "threads": (None, 1, 2),
}
SAVGOL: Usual = {
    "deriv": (0, 1, 2),
    "delta": (1.0, 0.1, -1),
    "axis": (-1, 0),
    "mode": words("interp nearest mirror wrap constant"),
    "cval": (0.0, 2.0),
    "engine": words("auto direct moments fft"),
    "threads": (None, 1),
}
COEFFS: Usual = {"deriv": (0, 1), "delta": (1.0, 0.1), "pos": (None, 2), "use": ("conv", "dot")}
CHOICE: Usual = {
    **{name: DESIGN[name] for name in words("degree kappa mu delta fs")},
    "t": (None, EVEN),
    "axis": (-1, 0),
    "sigma": (None, 0.1),
    "noise": ("auto", "white"),
    "max_delay": (None, None, 1.0),
    "bandwidth": (None, None, 1.0),
    "min_window": (None, 7),
    "max_window": (None, 31),
    "local": (False, False, True),
}
NOISE: Usual = {
    "axis": (-1, 0),
    "order": (3, 2),
    "t": (None, UNEVEN),
    "weights": (None, ROW**2),
    "local": (None, 15),
}
FIELD: Usual = {
    **{name: DESIGN[name] for name in words("degree kappa mu")},
    "axis": (None, 0, (0, 1)),
    "smooth": (False, True),
    "edge_order": (1, 2),
    "mode": words("fit nearest wrap"),
}
STREAM: Usual = {
    "channels": (None, 2),
    "dtype": ("f8", "f4"),
    "warmup": ("nan", "grow"),
    "nan_policy": words("propagate omit raise"),
    "delay": (None, 0.0),
    "min_support": (None, 4),
    "max_gain": (None, 5.0),
}
SAMPLES = (ROW, ROW, GAPS, ROW.astype("f4"), TABLE, ROW + 1j, MASKED, np.arange(60), np.zeros((2, 60)))
