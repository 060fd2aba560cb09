"""What an installation is made of, and whether it works: the findings of ``algdiff doctor``.

Nothing here may fail because something else is broken: NumPy, the core and every optional part are asked for inside
functions, and whatever they raise becomes a finding. Optional parts are looked up by their specs and metadata, which
takes milliseconds. That they are broken shows only when they are imported, which takes seconds for all of them, and may
end the process or never come back; so it is done only if asked for, each in a process of its own.
"""

from __future__ import annotations

import importlib.util
import math
import os
import platform
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from algdiff._refusals import LONGEST, listed

FORM = 1
"""Version of the form of the findings."""
PATIENCE = 20.0
"""Seconds that the import of a part, or the word of a compiler, may take."""
TOLERANCE = 1e-10
"""Error of the self-test that is none: some hundred times its rounding, and far below any defect."""
ANEW = "install it anew, by pip install --force-reinstall . in a checkout"
REGISTERS = {8: "no vectors", 16: "NEON", 32: "AVX2", 64: "AVX-512"}
COMPILERS = ("cc", "gcc", "clang", "cl")


class Part(NamedTuple):
    """An optional part: the module, its distribution, what it is for, and what to install."""

    module: str
    distribution: str
    purpose: str
    install: str


def _extra(name: str) -> str:
    return f"pip install 'algdiff-rs[{name}]'"


PARTS = (
    Part("h5py", "h5py", "HDF5 files", _extra("hdf5")),
    Part("zarr", "zarr", "Zarr stores", _extra("zarr")),
    Part("pyarrow", "pyarrow", "Parquet files", _extra("parquet")),
    Part("soundfile", "soundfile", "WAV and FLAC files", _extra("audio")),
    Part("dask", "dask", "lazy arrays", _extra("dask")),
    Part("distributed", "distributed", "files by a cluster", _extra("dask")),
    Part("pandas", "pandas", "Series and DataFrames", _extra("pandas")),
    Part("xarray", "xarray", "DataArrays and Datasets", _extra("xarray")),
    Part("polars", "polars", "columns of polars", "pip install polars"),
    Part("matplotlib", "matplotlib", "pictures", _extra("plot")),
    Part("scipy", "scipy", "the demo's comparison", _extra("demo")),
    Part("derivative", "derivative", "algdiff.compat.derivative", "pip install derivative"),
    Part("pysindy", "pysindy", "algdiff.compat.pysindy", "pip install pysindy"),
    Part("pynumdiff", "pynumdiff", "algdiff.compat.pynumdiff", "pip install pynumdiff"),
    Part("sklearn", "scikit-learn", "algdiff.compat.sklearn", "pip install scikit-learn"),
)


def examine(importing: bool = False) -> dict[str, Any]:
    """Return the findings as JSON can hold them; `importing` imports every optional part that there is."""
    problems: list[str] = []
    notes: list[str] = []
    late: list[str] | None = [] if importing else None
    findings: dict[str, Any] = {
        "form": FORM,
        "versions": _versions(problems),
        "cpu": _cpu(problems),
        "threads": _threads(problems),
        "parts": [_part(part, late, problems) for part in PARTS],
        "compiler": _compiler(),
        "self_test": _self_test(problems),
    }
    _conflicts(Path(__file__).parent, problems, notes)
    return {**findings, "notes": notes, "problems": problems, "ok": not problems}


def _said(error: BaseException) -> str:
    """Return an error of any kind in one short line."""
    line = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(".: ")
    return line if len(line) <= 2 * LONGEST else f"{line[: 2 * LONGEST - 3]}..."


def _version(distribution: str) -> str | None:
    """Return the version of a distribution, None if it is not known."""
    try:
        return metadata.version(distribution)
    except Exception:  # of metadata that are damaged, anything
        return None


def _versions(problems: list[str]) -> dict[str, str | None]:
    own = _version("algdiff-rs")
    if own is None:
        problems.append(f"algdiff-rs has no metadata, or damaged ones: {ANEW}")
    array: str | None = None
    try:
        import numpy as np

        array = np.__version__
    except Exception as error:
        problems.append(f"numpy cannot be imported ({_said(error)}): pip install --force-reinstall numpy")
    else:
        if _older(array, _least("numpy")):
            problems.append(f"numpy must be at least {_least('numpy')}, got {array}: pip install --upgrade numpy")
    return {
        "algdiff": own,
        "path": str(Path(__file__).parent),
        "python": platform.python_version(),
        "executable": sys.executable,
        "numpy": array,
        "platform": platform.platform(),
    }


def _least(distribution: str) -> str | None:
    """Return the least version of a distribution that algdiff works with, None if it names none."""
    with suppress(Exception):
        for requirement in metadata.requires("algdiff-rs") or ():
            if found := re.match(rf"{re.escape(distribution)}(?:\[[^]]*\])?\s*>=\s*([\d.]+)", requirement):
                return found[1]
    return None


def _older(version: str | None, least: str | None) -> bool:
    if version is None or least is None:
        return False
    found, wanted = (list(map(int, re.findall(r"\d+", each))) for each in (version, least))
    return found[: len(wanted)] + [0] * (len(wanted) - len(found)) < wanted


def _cpu(problems: list[str]) -> dict[str, str | int | bool | None]:
    """Return the registers that engines use, in bytes, and whether the CPU works on them whole."""
    registers: int | None = None
    whole: bool | None = None
    try:
        from algdiff import _core

        registers, whole = _core.registers()
    except AttributeError:
        problems.append(f"algdiff._core is of another version than algdiff: {ANEW}")
    except Exception as error:
        problems.append(f"algdiff._core cannot be imported ({_said(error)}): {ANEW}")
    name = None if registers is None else REGISTERS.get(registers, "unknown")
    return {"machine": platform.machine(), "registers": registers, "whole": whole, "name": name}


def _threads(problems: list[str]) -> dict[str, int | str | None]:
    affinity: Any = getattr(os, "sched_getaffinity", None)
    try:
        from algdiff._threads import count

        count(None)
    except ValueError as error:
        problems.append(f"{error}: set it so, or unset it")
    except Exception:  # noqa: S110 - of NumPy, as was said already
        pass
    return {
        "processors": os.cpu_count(),
        "affinity": None if affinity is None else len(affinity(0)),
        "ALGDIFF_NUM_THREADS": os.environ.get("ALGDIFF_NUM_THREADS"),
    }


def _part(part: Part, late: list[str] | None, problems: list[str]) -> dict[str, str | bool | None]:
    """Look for an optional part, and import it unless `late` is None; that it is absent is no problem."""
    found, version, error = False, None, None
    try:
        found = importlib.util.find_spec(part.module) is not None
    except Exception as raised:
        found, error = True, _said(raised)
    if found:
        version, least = _version(part.distribution), _least(part.distribution)
        if _older(version, least):
            error = f"must be at least {least}, got {version}"
        elif late is not None and error is None:
            error = _imported(part.module, late)
    if error is not None:
        problems.append(f"{part.module}: {error}: pip install --upgrade --force-reinstall {part.distribution}")
    return {
        "name": part.module,
        "found": found,
        "version": version,
        "for": part.purpose,
        "install": part.install,
        "error": error,
    }


IMPORT = """import sys
late, sys.path[:] = sys.argv[2].split(), sys.argv[3:]
sys.modules.update(dict.fromkeys(late))
try:
    __import__(sys.argv[1])
except BaseException as error:
    print(" ".join(f"{type(error).__name__}: {error}".split()), file=sys.stderr)
    sys.exit(1)
"""


def _imported(module: str, late: list[str]) -> str | None:
    """Return why a module cannot be imported, None if it can: in a process of its own, which it may take along.

    The modules in `late` did not come back: what needs them is told so, and does not wait for them again.
    """
    print(f"importing {module}", file=sys.stderr, flush=True)
    run = [sys.executable, "-c", IMPORT, module, " ".join(late), *sys.path]
    try:
        done = subprocess.run(run, capture_output=True, text=True, timeout=PATIENCE, check=False)  # noqa: S603
    except subprocess.TimeoutExpired:
        late.append(module)
        return f"cannot be imported (not within {PATIENCE:g} s)"
    if done.returncode == 0:
        return None
    lines = done.stderr.strip().splitlines() if done.returncode == 1 else []
    said = lines[-1] if lines else f"which ends the interpreter with code {done.returncode}"
    return f"cannot be imported ({said[: 2 * LONGEST].rstrip('.: ')})"


def _compiler() -> dict[str, str] | None:
    """Return the C compiler, which compiles what `Differentiator.to_c` returns."""
    for name in COMPILERS:
        path = shutil.which(name)
        if path is None:
            continue
        version = ""
        with suppress(OSError, subprocess.SubprocessError):
            run = [path, *([] if name == "cl" else ["--version"])]
            done = subprocess.run(run, capture_output=True, text=True, timeout=PATIENCE, check=False)  # noqa: S603
            version = ((done.stdout or done.stderr).splitlines() or [""])[0]
        return {"path": path, "version": version}
    return None


def _self_test(problems: list[str]) -> dict[str, str | bool]:
    try:
        said, error = _tested()
    except Exception as raised:
        said, error = f"stopped ({_said(raised)})", math.inf
    if not error <= TOLERANCE:
        problems.append(f"the self-test {said}: {ANEW}, and report it if that does not help")
    return {"ok": error <= TOLERANCE, "said": said}


def _tested() -> tuple[str, float]:
    """Return how far weights are from their closed form, and every engine from the derivative of a cubic, at most."""
    import numpy as np

    from algdiff import Differentiator

    weights = Differentiator(5, degree=2, kappa=0, mu=0).weights
    errors = {"closed form": float(np.abs(weights - np.arange(-2, 3) / 10).max())}
    t = np.linspace(-1, 1, 2001)
    for engine in ("direct", "moments", "fft"):
        found = Differentiator(101, degree=3, delta=1e-3, engine=engine)(t**3)
        errors[engine] = float(np.abs(found - 3 * t**2).max())
    # NaN, too, is no agreement.
    wrong = [f"{name} errs by {error:.1e}" for name, error in errors.items() if not error <= TOLERANCE]
    if wrong:
        return f"failed: {listed(wrong)}, more than {TOLERANCE:.0e}", math.inf
    worst = max(errors.values())
    return f"passed: the closed form and the engines {listed([*errors][1:])} agree to {worst:.0e}", worst


def _conflicts(here: Path, problems: list[str], notes: list[str]) -> None:
    """Find the AlgDiff toolbox, whose distribution has the name of this package, and maybe its folder `here`, too."""
    other = _version("algdiff")
    if other is None:
        return
    notes.append(f"the distribution algdiff {other} is another project, the AlgDiff toolbox; this one is algdiff-rs")
    with suppress(Exception):  # of paths that are none
        theirs = Path(str(metadata.distribution("algdiff").locate_file("AlgDiff")))
        if theirs.exists() and theirs.samefile(here):
            why = "must be of one package, got two in one folder, as this file system ignores case"
            how = "pip uninstall algdiff algdiff-rs, and give each an environment of its own"
            problems.append(f"{here}: {why}: {how}")
