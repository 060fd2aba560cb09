"""What golden files have the AlgDiff toolbox say, said again by it, in a virtual environment of its own.

Both packages are called algdiff where file names ignore case.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

import pytest

import test_compat_toolbox as methods
import test_toolbox as grid

TOOLBOX = ["algdiff==2.4", "numpy<2.4", "scipy", "mpmath"]  # it calls numpy.trapz, which numpy 2.4 no longer has


NOTEBOOK = """\
import json
from AlgDiff import *
import numpy as np

ts = 0.01
t = np.arange(0, 3, ts)
x = np.sin(4 * t) + 0.1 * np.cos(50 * t)
diff = AlgebraicDifferentiator(N=1, alpha=3.0, beta=3.5, T=None, wc=20.5, ts=ts, display=False, corr=False)
g = diff.discretize(1, method="mid-point")[1]["mid-point"]
found = {"weights": g.tolist(), "T": diff.get_T(), "delay": diff.get_delay(), "theta": diff.get_theta()}
found["slope"] = diff.estimateDer(1, x, conv="valid")[60:].tolist()
diff.set_theta(1, False)
found["now"] = diff.estimateDer(1, x, method="analytic", conv="valid")[60:].tolist()
omega = np.linspace(1, 200, 40)
found["amplitude"], found["phase"] = (part.tolist() for part in diff.get_ampAndPhaseFilter(omega))
print(json.dumps(found))
"""
"""What notebooks of the toolbox do, of which the line that imports is changed."""


@pytest.fixture(scope="module")
def toolbox_python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the Python of a new environment with the toolbox; skip if no package index can be reached.

    By the pip that is there, and not compiled: a third of the time.
    """
    folder = tmp_path_factory.mktemp("toolbox")
    venv.EnvBuilder().create(folder)
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "--disable-pip-version-check"]
    install = [*pip, "install", "--quiet", "--no-compile", "--retries", "1", *TOOLBOX]
    try:
        done = subprocess.run(install, capture_output=True, text=True, timeout=300, check=False)
    except subprocess.TimeoutExpired:
        pytest.skip("the package index is too slow to install the AlgDiff toolbox")
    if done.returncode:
        pytest.skip(f"cannot install the AlgDiff toolbox: {(done.stderr.strip().splitlines() or ['no reason'])[-1]}")
    return python


def said_by(python: Path, script: str) -> Any:
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    path = Path(__file__).parent / script
    return json.loads(subprocess.run([python, path], capture_output=True, text=True, env=clean, check=True).stdout)


def test_of_kernels_and_filters(toolbox_python: Path) -> None:
    said = said_by(toolbox_python, "toolbox.py")
    assert len(said) == len(grid.CASES)
    for ours, case in zip(said, grid.CASES, strict=True):
        grid.compare(ours, case)


def test_of_its_methods(toolbox_python: Path) -> None:
    methods.agree(said_by(toolbox_python, "toolbox_methods.py"), methods.RECORDED, rtol=1e-12)


def test_of_a_notebook_changed_by_one_line(toolbox_python: Path, tmp_path: Path) -> None:
    (tmp_path / "theirs.py").write_text(NOTEBOOK, encoding="utf-8")
    (tmp_path / "ours.py").write_text(NOTEBOOK.replace("AlgDiff", "algdiff.compat"), encoding="utf-8")
    said = said_by(toolbox_python, str(tmp_path / "theirs.py"))
    ours = said_by(Path(sys.executable), str(tmp_path / "ours.py"))
    methods.agree(ours, said, rtol=1e-10)
