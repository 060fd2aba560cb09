"""Programs for SciPy, NumPy and the AlgDiff toolbox, of which one line is changed: the one that imports."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from support import EPS

SAVGOL = """\
import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

x = np.random.default_rng(5).standard_normal((4, 300)).cumsum(axis=1)
modes = ("interp", "mirror", "nearest", "wrap")
found = {mode: savgol_filter(x, 31, 4, deriv=1, delta=0.01, mode=mode) for mode in modes}
found["constant"] = savgol_filter(x, 31, 4, 2, 0.01, 1, "constant", 1.5)
found["columns"] = savgol_filter(x.T, window_length=25, polyorder=3, axis=0)
found["integers"] = savgol_filter(np.arange(60) ** 2, 7, 2, deriv=1)
found["float32"] = savgol_filter(x.astype(np.float32), 31, 4, deriv=1)
found["taps"] = savgol_coeffs(21, 3, deriv=1, delta=0.5)
found["newest"] = savgol_coeffs(21, 3, deriv=1, pos=20, use="dot")
"""

GRADIENT = """\
import numpy as np
from numpy import gradient

x = np.random.default_rng(5).standard_normal((6, 40)).cumsum(axis=1)
found = {"plain": gradient(x[0]), "step": gradient(x[0], 0.1), "edges": gradient(x[0], 0.1, edge_order=2)}
found["rows"], found["columns"] = gradient(x)
found["uneven"] = gradient(x, np.arange(40) ** 1.5, axis=1)
found["both"], found["steps"] = gradient(x, 2.0, np.linspace(0, 1, 40))
found["axes"] = gradient(x, 0.5, axis=-1)
"""


def results(program: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exec(program, names)  # noqa: S102 - of this file
    found: dict[str, Any] = names["found"]
    return found


@pytest.mark.parametrize(
    ("program", "old", "new"),
    [
        (SAVGOL, "from scipy.signal import", "from algdiff import"),
        (GRADIENT, "from numpy import", "from algdiff import"),
    ],
    ids=["savgol_filter", "gradient"],
)
def test_a_program_changed_by_one_line_says_the_same(program: str, old: str, new: str) -> None:
    expected, found = results(program), results(program.replace(old, new))
    assert program.replace(old, new) != program
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        ours = found[name]
        assert type(ours) is type(value), name
        assert (ours.shape, ours.dtype) == (value.shape, value.dtype), name
        # SciPy fits powers of positions up to 15^4, whose condition number is near 1e5, by a general solver.
        eps = max(EPS, float(np.finfo(value.dtype).eps))
        assert np.abs(ours - value).max() <= max(1e5 * EPS, 1e2 * eps) * max(1.0, float(np.abs(value).max())), name
