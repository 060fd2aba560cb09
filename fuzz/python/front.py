"""Functions with arguments of any type: a result of the right shape and type, or an error that is documented.

Bytes choose a function, arguments that make sense, and up to three that are replaced by anything. Sizes that would be
allowed but take long are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import anything
import atheris
import numpy as np
from anything import EVEN, GAPS, ROW, SAMPLES, TABLE, UNEVEN, Usual

with atheris.instrument_imports(include=["algdiff"]):
    import algdiff
    from algdiff import Differentiator, Estimates, Kernel, Suggestion, _blocks, _choice, _fields, _times  # noqa: F401
from common import main, only


class Draw:
    """Choices made of bytes, and how many arguments they have still to spoil."""

    def __init__(self, data: bytes) -> None:
        self.given = atheris.FuzzedDataProvider(data)
        self.spoilt = self.below(4)

    def below(self, count: int) -> int:
        """Return a number below `count`."""
        return int(self.given.ConsumeIntInRange(0, count - 1))

    def of(self, values: Sequence[Any]) -> Any:
        """Return one of some values."""
        return values[self.below(len(values))]

    def anything(self, name: str) -> Any:
        """Return a value of any type."""
        kind = self.below(len(anything.KINDS) + 1)
        found = self.given.ConsumeFloat() if kind == len(anything.KINDS) else self.of(anything.KINDS[kind])
        # Sizes between those that are quick and those that are refused.
        slow = name in anything.SLOW and isinstance(found, (int, float))
        return 9 if slow and anything.LONG < abs(found) <= anything.LARGE.get(name, 1e7) else found

    def words(self, usual: Usual, most: int = 5) -> dict[str, Any]:
        """Return some keywords."""
        names = list(usual)
        return {
            name: self.argument(name, usual[name]) for name in (self.of(names) for _ in range(self.below(most + 1)))
        }

    def argument(self, name: str, usual: Sequence[Any]) -> Any:
        """Return an argument, of the usual ones or any."""
        if self.spoilt and self.below(3) == 0:
            self.spoilt -= 1
            return self.anything(name)
        return self.of(usual)

    def samples(self) -> Any:
        """Return samples."""
        return self.argument("x", SAMPLES)

    def window(self) -> Any:
        """Return a window."""
        return self.argument("window_length", (5, 7, 8, 11, 21, 9, 40))

    def order(self) -> Any:
        """Return one order or several."""
        return self.argument("deriv", (1, 1, 0, 2, (0, 1)))


def differentiate(draw: Draw) -> None:
    """Differentiate at once, or by a design."""
    x, window, deriv, design, call = (
        draw.samples(),
        draw.window(),
        draw.order(),
        draw.words(anything.DESIGN, 3),
        draw.words(anything.CALL),
    )
    if draw.below(2):
        result = algdiff.differentiate(x, window, deriv, **design, **call)
    else:
        found = Differentiator(window, deriv, **design)
        assert repr(found)
        assert np.isfinite(found.weights).all()
        result = found(x, **call)
    check(result, x, deriv, call)


def check(result: Any, x: Any, deriv: Any, call: dict[str, Any]) -> None:
    """Hold a result to the shape and type of what was differentiated."""
    if isinstance(result, Estimates):
        result = result.estimate
    assert isinstance(result, np.ndarray), type(result)
    kind = np.asarray(x).dtype
    wanted = (
        kind.newbyteorder("=") if kind in ("f4", "f8", "c8", "c16") else np.dtype("c16" if kind.kind == "c" else "f8")
    )
    assert result.dtype == wanted or kind.kind in "Ofg", (result.dtype, kind)
    if call.get("mode") == "valid" or call.get("at") is not None:
        return
    leading = np.shape(deriv)
    assert result.shape == (*leading, *np.shape(x)), (result.shape, np.shape(x), leading)


def choose(draw: Draw) -> None:
    """Choose a window from samples, and differentiate by it."""
    x = draw.samples()
    found = algdiff.suggest(x, draw.argument("deriv", (1, 2)), **draw.words(anything.CHOICE))
    assert isinstance(found, Suggestion)
    assert repr(found)
    if not draw.below(8):
        found(x)


def savgol(draw: Draw) -> None:
    """Do as SciPy."""
    if draw.below(3) == 0:
        assert (
            algdiff.savgol_coeffs(draw.window(), draw.argument("polyorder", (2, 3)), **draw.words(anything.COEFFS)).ndim
            == 1
        )
        return
    x = draw.samples()
    result = algdiff.savgol_filter(x, draw.window(), draw.argument("polyorder", (2, 3)), **draw.words(anything.SAVGOL))
    assert result.shape == np.shape(x)
    assert result.dtype.kind in "fc"


def field(draw: Draw) -> None:
    """Differentiate along several axes."""
    f, words = draw.argument("f", (TABLE, TABLE[:, :, 0], ROW)), draw.words(anything.FIELD, 4)
    spacing = [draw.argument("spacing", (0.1, 1, EVEN[:12])) for _ in range(draw.below(3))]
    if draw.below(2):
        window = draw.argument("window_length", (5, 3, (5, 5)))
        if window is not None:  # else it is NumPy's own
            algdiff.gradient(f, *spacing, window_length=window, **words)
        return
    words.pop("smooth", None)
    words.pop("edge_order", None)
    call = draw.of((algdiff.laplacian, algdiff.hessian, lambda f, n, **words: algdiff.partial(f, n, (1, 1), **words)))
    call(f, draw.argument("window_length", (5, 3, (5, 5))), **words)


def kernel(draw: Draw) -> None:
    """Ask a kernel everything."""
    deriv, degree = draw.argument("deriv", (0, 1, 2)), draw.argument("degree", (None, 2, 3))
    found = Kernel(
        deriv,
        degree,
        *(draw.argument("kappa", (0, 1, 0.5)) for _ in range(2)),
        draw.argument("tau", anything.DESIGN["tau"][1:]),
    )
    numbers = (found.norm1, found.norm2, found.exactness, found.cutoff, found.roots, repr(found), hash(found))
    assert all(one is not NotImplemented for one in numbers)
    points = draw.argument("points", (0.5, EVEN, [0.1, 0.2]))
    call: Callable[[Any], Any] = draw.of(
        (found, found.frequency_response, found.asymptotes, found.impulse_response, found.step_response)
    )
    result = call(points)
    assert isinstance(result, (float, complex, np.ndarray, np.generic, tuple)), type(result)
    found.optimal_duration(*(draw.argument("noise_level", (0.1, 1)) for _ in range(2)))


def noise(draw: Draw) -> None:
    """Estimate the noise."""
    x = draw.samples()
    result = algdiff.noise_level(x, **draw.words(anything.NOISE))
    assert isinstance(result, (float, np.ndarray)), type(result)


def stream(draw: Draw) -> None:
    """Push samples of any kind."""
    words = draw.words(anything.STREAM)
    found = Differentiator(draw.window(), draw.order(), **draw.words(anything.DESIGN, 2)).stream(**words)
    for _ in range(3):
        x = draw.argument("x", (1.0, ROW[:7], np.ones((5, 2)), GAPS[:9]))
        found.push(x, **draw.words({"t": (None, None, UNEVEN[:7]), "return_std": (False, True)}, 2))
    assert repr(found)
    assert found.count >= 0


CALLS = (differentiate, differentiate, choose, savgol, field, kernel, noise, stream)


def one(data: bytes) -> None:
    """Call one of the functions."""
    draw = Draw(data)
    call = draw.of(CALLS)
    with only(ValueError, TypeError, MemoryError):
        call(draw)


def seeds() -> Sequence[bytes]:
    """Return bytes that make calls."""
    return [anything.RNG.bytes(60) for _ in range(60)]


if __name__ == "__main__":
    main(one, seeds)
