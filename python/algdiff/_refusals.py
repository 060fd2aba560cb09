"""What refusals say: values in short, and how to keep the units that an array or a number carries."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence

LONGEST = 100
"""Characters of a value that a message shows, about."""

FEW = 6
"""Elements of an array that a message shows, at most."""

MANY = 10
"""Names that a message shows, at most."""


CONTROL = (*range(9), *range(11, 32), *range(127, 160), *range(0xD800, 0xE000), 0xFFFE, 0xFFFF)
DIRECTION = (*range(0x202A, 0x202F), *range(0x2066, 0x206A))
UNPRINTED = dict.fromkeys((*CONTROL, *DIRECTION), "\N{REPLACEMENT CHARACTER}")
"""Characters that XML does not allow, that command a terminal or show nothing, or that turn what follows around."""


class _Short(reprlib.Repr):
    """Shows a few elements of lists, and as much of everything else as a message can hold."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = LONGEST
        self.maxtuple = self.maxlist = FEW

    def repr_int(self, x: int, level: int) -> str:
        """Name the size of an integer that Python refuses to write."""
        return super().repr_int(x, level) if x.bit_length() < 4 * LONGEST else f"an integer of {x.bit_length()} bits"


_short = _Short()


def shown(value: object) -> str:
    """Return `value` as messages show it: in one line and short, whatever it is; nothing lazy is computed."""
    kind = type(value)
    shape = () if kind is type else getattr(value, "shape", ())
    small = kind.__module__ == "numpy" and getattr(value, "size", 0) <= FEW
    if small or not (isinstance(shape, tuple) and shape):
        return _line(_short.repr(value), 2 * LONGEST)
    dtype = getattr(value, "dtype", None) if hasattr(kind, "dtype") else None
    return _line(f"{kind.__name__} of shape {shape}" + ("" if dtype is None else f" and dtype {dtype}"), 2 * LONGEST)


def named(**values: object) -> str:
    """Return arguments that exclude each other as messages show them."""
    return " and ".join(f"{name} = {shown(value)}" for name, value in values.items())


def listed(names: Sequence[object]) -> str:
    """Return names as messages show them: at most ten."""
    few = ", ".join(told(name) for name in names[:MANY])
    return few + (f", and {len(names) - MANY} more" if len(names) > MANY else "")


def told(what: object) -> str:
    """Return a name, or what an error says, as messages quote it: in one line and short; or its kind."""
    return _line(printed(str(what)), 2 * LONGEST) or type(what).__name__


def printed(text: str) -> str:
    """Return `text` as it can be shown on a terminal or a page, whatever names from files it holds."""
    return text.translate(UNPRINTED)


def _line(text: str, most: int) -> str:
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 3]}..."


def has_units(value: object) -> bool:
    """Return whether `value` is a quantity of pint or astropy, or of a package that names its parts as they do."""
    kind = type(value)  # not the object: a table may have columns of these names
    return hasattr(kind, "magnitude") or (hasattr(kind, "unit") and hasattr(kind, "value"))


SAMPLES = ("x", "f", "y")
STEPS = ("delta", "t", "spacing", "coordinates")
"""Arguments whose units divide those of the derivative."""
OTHERS = {
    **dict.fromkeys(("sigma", "period", "cval", "amplitude"), "x.units"),
    "autocovariance": "x.units**2",
    "weights": "x.units**-2",
    **dict.fromkeys(("window_duration", "duration", "delay", "max_delay", "delays", "at"), "dt.units"),
    **dict.fromkeys(("bandwidth", "cutoff", "frequency"), "dt.units**-1"),
}
"""Arguments that are counted in units of the samples x, or of their step dt."""


def units_of(name: str, value: object) -> str:
    """Return why a quantity is refused, and what to write instead, in the words of its own package."""
    if name in SAMPLES:
        how = (
            f"{name}.magnitude, with delta=dt.magnitude, and multiply the derivative by {name}.units / dt.units**deriv"
        )
    elif name in STEPS:
        how = f"{name}.magnitude, and divide the derivative by {name}.units**deriv"
    elif name == "fs":
        how = "fs.magnitude, and multiply the derivative by fs.units**deriv"
    elif name in OTHERS:
        how = f"{name}.to({OTHERS[name]}).magnitude, {'x the samples' if 'x.' in OTHERS[name] else 'dt the step'}"
    else:
        how = "a plain number"
    if not hasattr(type(value), "magnitude"):
        how = how.replace(".units", ".unit").replace(".magnitude", ".value")
    return f"{name} carries units, which would be lost: pass {how}"
