"""What the designer page differentiates: a stretch of a file, or the shipped pendulum; thinned for drawing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from algdiff._noise import noise_level

if TYPE_CHECKING:
    from algdiff._formats.base import Source

Floats = NDArray[np.float64]

COLUMNS = 64
"""Columns that are offered, at most."""
SECONDS = 7.0
"""What is shown of the pendulum at first: how it is released, and some swings."""
PARTS = 600
"""Of so many parts of what is shown the least and the largest values are drawn."""


@dataclass
class Recording:
    """Samples by column, all at the same times.

    Attributes
    ----------
    name : str
        What it is called: any text.
    columns : tuple of str
        Names of the columns: any text.
    samples : ndarray, shape (columns, samples)
        The samples, of a step that the page may change.
    delta : float
        The step that is known, or 1.
    first : int
        The number of the first sample, in the file.
    note : str
        What else is to be said of it.
    shown : int
        Samples that the page shows at first; 0 for all.
    """

    name: str
    columns: tuple[str, ...]
    samples: Floats
    delta: float
    first: int = 0
    note: str = ""
    shown: int = 0
    _known: dict[int, tuple[float, int, int]] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """How many samples a column has."""
        return int(self.samples.shape[1])

    def noise(self, column: int) -> float:
        """Return the level of the noise in a column; NaN if it cannot be told."""
        return self._of(column)[0]

    def missing(self, column: int) -> int:
        """Return how many samples of a column are missing."""
        return self._of(column)[1]

    def infinite(self, column: int) -> int:
        """Return how many are infinite."""
        return self._of(column)[2]

    def _of(self, column: int) -> tuple[float, int, int]:
        if column not in self._known:
            x = self.samples[column]
            self._known[column] = float(noise_level(x)), int(np.isnan(x).sum()), int(np.isinf(x).sum())
        return self._known[column]


def pendulum() -> Recording:
    """Return the recording that ships with the package."""
    from algdiff import _demo

    angle, delta = _demo.recording()
    note = f"angle in rad, from an encoder of 40,000 counts per revolution: {angle.size:,} samples"
    return Recording("pendulum", ("angle",), angle[np.newaxis], delta, 0, note, round(SECONDS / delta))


def read(source: Source, name: str, axis: int | None = None, step: float | None = None) -> Recording:
    """Return what is shown of an array that is open: of a long one, a stretch in the middle.

    Raises
    ------
    ValueError
        The array holds no samples.
    """
    from algdiff._pages.loading import check_samples, hint, parted, shown

    check_samples(source, name)
    part = shown(source, axis, COLUMNS)
    samples, count, kept = part.shape[part.axis], part.stop - part.start, len(part.rows)
    if samples < 2:
        raise ValueError(f"{name}: must hold two samples or more, got {samples}{hint(part)}")
    found = source.names or [", ".join(map(str, row)) for row in part.rows]
    x, names = parted(part.read(source), [one or "Signal" for one in found[:kept]])
    stated = source.step_along(part.axis) if step is None else step
    said = [f"{count:,} samples" if count == samples else f"samples {part.start} to {part.stop - 1} of {samples:,}"]
    if kept < part.channels:
        said.append(f"the first {kept} of {part.channels:,} columns")
    return Recording(name, names, x, 1.0 if stated is None else stated, part.start, ", ".join(said))


def thinned(start: int, stop: int, *values: Floats) -> NDArray[np.intp]:
    """Return which samples of a stretch are drawn: where each of `values` is least and largest, part by part.

    Parameters
    ----------
    start, stop : int
        The stretch.
    *values : ndarray
        Of all samples; NaN where there is none.
    """
    length = (stop - start) // PARTS
    if length < 4:
        return np.arange(start, stop)
    whole = start + length * ((stop - start) // length)
    begins = np.arange(start, whole, length)
    kept = [begins, np.arange(whole, stop), np.array([stop - 1])]
    for one in values:
        parts = one[start:whole].reshape(-1, length)
        gaps = np.isnan(parts)
        holes = bool(gaps.any())
        for find, filler in ((np.argmin, np.inf), (np.argmax, -np.inf)):
            kept.append(begins + find(np.where(gaps, filler, parts) if holes else parts, axis=1))
    return np.unique(np.concatenate(kept))
