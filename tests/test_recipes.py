"""The recipes of docs/recipes.md, run as they stand there against the real packages."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import algdiff
from algdiff.compat.scipy import firdiff

PAGE = Path(__file__).parents[1] / "docs" / "recipes.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
IMPORTED = [set(re.findall(r"^(?:import|from) (\w+)", block, re.MULTILINE)) - {"numpy", "algdiff"} for block in BLOCKS]
SYSTEM = "/usr/bin/python3"
"""A second Python to look for packages in: that of the distribution, for which PyTorch comes without 4 GB of CUDA."""


def python_with(packages: set[str]) -> str:
    """Return an interpreter that has the packages, or skip."""
    if all(importlib.util.find_spec(name) for name in packages):
        return sys.executable
    look = f"import importlib.util, sys; sys.exit(not all(map(importlib.util.find_spec, {sorted(packages)})))"
    if Path(SYSTEM).exists() and not subprocess.run([SYSTEM, "-c", look], check=False).returncode:
        return SYSTEM
    pytest.skip(f"needs {', '.join(sorted(packages))}")


RECIPES = [pytest.param(*both, id="-".join(sorted(both[1]))) for both in zip(BLOCKS, IMPORTED, strict=True)]


@pytest.mark.parametrize(("block", "packages"), RECIPES)
def test_a_recipe_holds(block: str, packages: set[str], tmp_path: Path) -> None:
    python = python_with(packages)
    (tmp_path / "algdiff").symlink_to(Path(algdiff.__file__).parent)
    (tmp_path / "recipe.py").write_text(block, encoding="utf-8")
    done = subprocess.run([python, tmp_path / "recipe.py"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_page_has_what_it_promises() -> None:
    assert set.union(*IMPORTED) == {"scipy", "torch", "jax", "numba", "pint", "astropy"}
    assert all("assert" in block for block in BLOCKS)


def test_taps_are_weights_turned_round() -> None:
    options = {"degree": 4, "kappa": 0.5, "mu": 2.0, "tau": "newest", "fs": 50.0, "rule": "cell"}
    design = algdiff.Differentiator(21, 2, **options)
    taps = firdiff(21, deriv=2, **options)
    assert np.array_equal(taps[::-1], design.weights)
    assert taps.flags.writeable
    assert taps.flags.c_contiguous
    assert np.array_equal(firdiff(cutoff=4.0, fs=50.0)[::-1], algdiff.Differentiator.from_cutoff(4.0, fs=50.0).weights)
    delayed = firdiff(21, delay=0.1, fs=50.0)
    assert np.array_equal(delayed[::-1], algdiff.Differentiator(21, delay=0.1, fs=50.0).weights)


@pytest.mark.parametrize("both", [(None, None), (21, 4.0)])
def test_taps_need_a_number_or_a_cutoff(both: tuple[int | None, float | None]) -> None:
    with pytest.raises(ValueError, match="either numtaps or cutoff must be given"):
        firdiff(*both)


def test_taps_are_of_one_order() -> None:
    with pytest.raises(ValueError, match="taps of a filter must be of one order"):
        firdiff(21, deriv=(0, 1))  # type: ignore[arg-type]
