"""What a page shows of the samples in a file, how they are had in Python, and that they are too few."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from algdiff._cli_auto import Stretch

if TYPE_CHECKING:
    from algdiff import _formats as formats
    from algdiff._arguments import Samples
    from algdiff._formats.base import Source

NUMBERS = 1 << 21
"""Real numbers that a page shows, at most, of all columns together."""


def shown(source: Source, axis: int | None, columns: int) -> Stretch:
    """Return what a page shows of an array that is open: its first columns, of long ones a stretch in their middle."""
    whole = Stretch.of(source, axis)
    parts = 2 if source.dtype.kind == "c" else 1
    count = min(whole.channels, columns // parts)
    others = (*whole.shape[: whole.axis], *whole.shape[whole.axis + 1 :])
    rows = tuple(tuple(map(int, np.unravel_index(row, others))) for row in range(count)) if others else ((),)
    samples = whole.shape[whole.axis]
    length = min(samples, NUMBERS // (parts * count), whole.stop - whole.start)
    start = (samples - length) // 2
    return whole._replace(start=start, stop=start + length, rows=rows)


def parted(x: Samples, names: Sequence[str]) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Return rows in double precision, and what they are called: of complex ones real and imaginary parts."""
    if x.dtype.kind == "c":
        x = np.stack([x.real, x.imag], axis=1).reshape(-1, x.shape[-1])
        names = [f"{part} of {name}" for name in names for part in ("real part", "imaginary part")]
    return x.astype(np.float64), tuple(names)


class Loading(NamedTuple):
    """How the samples are had in Python.

    Attributes
    ----------
    imports : str
        The line that it takes, or "".
    expression : str
        What gives the samples, in double precision; of complex ones real and imaginary parts along a leading axis.
    axis : int or None
        The axis of time in them, if it is not the last.
    """

    imports: str
    expression: str
    axis: int | None


def loading(place: formats.Located, source: Any, stretch: Stretch) -> Loading:
    """Return how the samples of a stretch are read from the file that is open."""
    imports, expression, typed = READERS[place.form.name](str(place.path), source)
    cut = _index(stretch)
    if place.form.inner:
        cut = cut or "[...]"
    elif cut and place.form.name == "npy":
        expression = f"{expression.removesuffix(')')}, mmap_mode='r')"
    expression += cut
    wanted = "complex" if source.dtype.kind == "c" else "float"
    if not typed and source.dtype != np.dtype(wanted):
        expression += f".astype({wanted})"
    dimensions, axis = len(stretch.shape), stretch.axis
    if source.dtype.kind == "c":
        # As on the page, each part has noise of its own.
        expression += "\nx = np.stack([x.real, x.imag])"
        dimensions, axis = dimensions + 1, axis + 1
    return Loading(imports, expression, axis if axis < dimensions - 1 else None)


def _index(stretch: Stretch) -> str:
    """Return the index of what is shown, "" if it is all; rows of more than two dimensions are taken whole."""
    parts = [":"] * len(stretch.shape)
    if stretch.stop - stretch.start < stretch.shape[stretch.axis]:
        parts[stretch.axis] = f"{stretch.start}:{stretch.stop}"
    if len(parts) == 2 and len(stretch.rows) < stretch.channels:
        parts[1 - stretch.axis] = f":{len(stretch.rows)}"
    while parts and parts[-1] == ":":
        parts.pop()
    return f"[{', '.join(parts)}]" if parts else ""


Read = tuple[str, str, bool]
"""The import, the expression, whether that is in double precision whatever the file holds."""


def _numpy(path: str, source: Any) -> Read:
    key = "" if source.key is None else f"[{source.key!r}]"
    return "", f"np.load({path!r}){key}", False


def _csv(path: str, source: Any) -> Read:
    words = [repr(path), f"delimiter={source.delimiter!r}", f"skiprows={source.before}"]
    if source.chosen != [*range(len(source.kinds))]:
        words.append(f"usecols={source.chosen[0] if len(source.chosen) == 1 else tuple(source.chosen)}")
    words += ["comments=None", "quotechar='\"'", "encoding='utf-8-sig'"]
    return "", f"np.loadtxt({', '.join(words)})", True


def _raw(path: str, source: Any) -> Read:
    offset = f", offset={source.region.offset}" if source.region.offset else ""
    shape = f".reshape(-1, {source.shape[1]})" if len(source.shape) > 1 else ""
    return "", f"np.fromfile({path!r}, {source.dtype.str!r}{offset}){shape}", False


def _hdf5(path: str, source: Any) -> Read:
    return "import h5py", f"h5py.File({path!r}, 'r')[{source.name!r}]", False


def _zarr(path: str, source: Any) -> Read:
    inner = f", path={source.name!r}" if source.name else ""
    return "import zarr", f"zarr.open_array({path!r}{inner}, mode='r')", False


def _parquet(path: str, source: Any) -> Read:
    names = list(source.names)
    table = f"pq.ParquetFile({path!r}).read({sorted(set(names))!r})"
    columns = (
        f"{table}[{names[0]!r}].to_numpy()"
        if len(names) == 1
        else f"np.column_stack({table}.select({names!r}).columns)"
    )
    return "import pyarrow.parquet as pq", f"{columns}.astype(float)", True


def _audio(path: str, source: Any) -> Read:
    chosen = source.chosen.tolist()
    part = "" if source.all else f"[:, {chosen[0] if len(chosen) == 1 else chosen}]"
    return "import soundfile", f"soundfile.read({path!r})[0]{part}", True


READERS: dict[str, Callable[[str, Any], Read]] = {
    "npy": _numpy,
    "npz": _numpy,
    "csv": _csv,
    "raw": _raw,
    "hdf5": _hdf5,
    "zarr": _zarr,
    "parquet": _parquet,
    "audio": _audio,
}
"""What reads a format."""


def check_samples(source: Source, name: str) -> None:
    """Raise ValueError if an array that is open holds no samples."""
    if not source.shape:
        raise ValueError(f"{name}: must hold samples, got a single number")
    if not math.prod(source.shape):
        raise ValueError(f"{name}: must hold samples, got shape {source.shape}")


def hint(chosen: Stretch) -> str:
    """Return along which axis there are more samples, "" if there is none."""
    longest = max(range(len(chosen.shape)), key=chosen.shape.__getitem__)
    most = chosen.shape[longest]
    return f": along --axis {longest} there are {most}" if most > chosen.shape[chosen.axis] else ""
