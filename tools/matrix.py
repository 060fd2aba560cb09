"""Install a wheel into fresh environments, of every CPython there is with NumPy old and new, and run quick tests.

Pythons are looked for on PATH, in pyenv, and where hosted runners keep them; `--python` names others. `--chroot`
names a folder with a Debian of its own, which `debootstrap --include=python3,python3-venv,ca-certificates SUITE
FOLDER` makes: its Pythons are asked as well (by root). The tests come from a copy of `tests/`, away from the sources,
with SciPy, pytest, Hypothesis and mpmath beside NumPy. Returns 1 if a run fails, if there is no Python, or if
`--want` names one that is not found.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import supply

LATEST = "latest"
# What each Python is tried with beside NumPy of the day. 1.23.5 is of the oldest that is promised.
NUMPY: dict[tuple[int, ...], list[str]] = {
    (3, 10): ["1.23.5", "1.26.4"],
    (3, 11): ["1.23.5", "1.26.4", "2.0.2"],
    (3, 12): ["1.26.4", "2.0.2"],
}
INSTALL = ["install", "-q", "--no-compile", "--only-binary=:all:"]
TOOLS = ["scipy", "pytest", "hypothesis", "mpmath"]
TESTS = ["package", "golden", "reference", "laws", "zoo", "savgol", "gradient", "design"]
# What SciPy loses differs from version to version; NumPy before 1.24 makes objects of ragged rows, and warns.
LEFT_OUT = {"": "scipy_loses_rank", "1.23.5": "ragged"}
FOUND = [
    (Path.home() / ".pyenv" / "versions", "*/bin/python3"),
    (Path(os.environ.get("RUNNER_TOOL_CACHE", os.devnull)), "Python/3.*/*/bin/python3"),
    (Path(os.environ.get("RUNNER_TOOL_CACHE", os.devnull)), "Python/3.*/*/python.exe"),
]
ASK = (
    "import sys; print(*sys.version_info[:3], sys.implementation.name, getattr(sys, '_is_gil_enabled', lambda: True)())"
)


@dataclass(frozen=True)
class Python:
    """An interpreter, with the folder that is its file system's root."""

    path: str
    root: Path = Path("/")
    version: tuple[int, ...] = ()

    def run(self, *words: str, cwd: str = "/") -> subprocess.CompletedProcess[str]:
        """Run a program where this interpreter lives."""
        elsewhere = self.root != Path("/")
        # Neither the sources nor anything that is installed for the user may be seen.
        env = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
        inside = ["chroot", str(self.root), "env", "-C", cwd] if elsewhere else []
        return subprocess.run(
            [*inside, *words], cwd="/" if elsewhere else cwd, env=env, capture_output=True, text=True, check=False
        )

    def asked(self) -> Python | None:
        """Return it with its version, if it is a CPython that the wheel is for."""
        try:
            done = self.run(self.path, "-I", "-c", ASK)
        except OSError:
            return None
        said = done.stdout.split()
        if done.returncode or said[3:] != ["cpython", "True"] or (version := tuple(map(int, said[:3]))) < (3, 10):
            return None
        return Python(self.path, self.root, version)


def pythons(more: list[str], roots: list[Path]) -> list[Python]:
    """Find one interpreter for each version, without release candidates' duplicates."""
    names = [shutil.which(f"python3.{minor}") for minor in range(10, 20)]
    paths = [*more, sys.executable, *filter(None, names)]
    paths += [str(path) for folder, pattern in FOUND if folder.is_dir() for path in sorted(folder.glob(pattern))]
    asked = [Python(path).asked() for path in paths]
    asked += [
        Python(f"/usr/bin/{path.name}", root).asked() for root in roots for path in root.glob("usr/bin/python3.??")
    ]
    # The first of each minor version; a version in a root of its own is another case.
    unique = {(python.version[:2], python.root): python for python in reversed(asked) if python}
    return sorted(unique.values(), key=lambda python: python.version)


def case(python: Python, numpy: str, wheel: Path) -> tuple[bool, str, str]:
    """Install and test; return whether all passed, which NumPy it was, and what pytest said last."""
    below = python.root / "tmp" if python.root != Path("/") else None
    with tempfile.TemporaryDirectory(dir=below, prefix="algdiff-matrix-") as folder:
        there = Path(folder)
        shutil.copytree(supply.ROOT / "tests", there / "tests", ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(supply.ROOT / "pyproject.toml", there)
        shutil.copy(wheel, there)
        inside = f"/tmp/{there.name}" if below else folder  # noqa: S108 (of the other system)
        wanted = "numpy" if numpy == LATEST else f"numpy=={numpy}"
        venv_python = f"{inside}/venv/{'Scripts/python.exe' if os.name == 'nt' else 'bin/python'}"
        tests = [f"tests/test_{name}.py" for name in TESTS]
        options = ["-q", "-p", "no:cacheprovider", "--no-header", "-r", "f"]
        options += ["-k", " and ".join(f"not {name}" for of, name in LEFT_OUT.items() if of in ("", numpy))]
        for words in (
            [python.path, "-m", "venv", f"{inside}/venv"],
            [venv_python, "-m", "pip", *INSTALL, wanted, f"{inside}/{wheel.name}", *TOOLS],
            [venv_python, "-c", "import numpy; print(numpy.__version__)"],
            [venv_python, "-m", "pytest", *options, *tests],
        ):
            done = python.run(*words, cwd=inside)
            if done.returncode:
                said = (done.stdout + done.stderr).strip()
                return False, numpy, said[-3000:]
            if words[1] == "-c":
                numpy = done.stdout.strip()
        return True, numpy, done.stdout.strip().splitlines()[-1]


def main() -> int:
    """Run the cases and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=Path, nargs="?", help="default: the only one in dist/")
    parser.add_argument("--python", action="append", default=[], help="another interpreter")
    parser.add_argument("--chroot", action="append", default=[], type=Path, help="a system with one")
    parser.add_argument("--want", nargs="*", default=[], metavar="3.X", help="versions that must be there")
    options = parser.parse_args()
    wheels = [options.wheel] if options.wheel else sorted((supply.ROOT / "dist").glob("*.whl"))
    if len(wheels) != 1:
        parser.error(f"dist/ holds {len(wheels)} wheels; name one")
    found = pythons(options.python, options.chroot)
    absent = set(options.want) - {"{}.{}".format(*python.version) for python in found}
    print(f"{wheels[0].name}\n| CPython | NumPy | tests | seconds |\n|---|---|---|---|")
    failures = []
    for python in found:
        for numpy in [*NUMPY.get(python.version[:2], []), LATEST]:
            begin = time.monotonic()
            passed, numpy, said = case(python, numpy, wheels[0].resolve())
            name = ".".join(map(str, python.version))
            verdict = said.split(" in ")[0] if passed else "FAILED"
            print(f"| {name} | {numpy} | {verdict} | {time.monotonic() - begin:.0f} |", flush=True)
            if not passed:
                failures.append(f"CPython {name}, NumPy {numpy}:\n{said}\n")
    print(*failures, *(f"there is no CPython {name}" for name in sorted(absent)), sep="\n")
    return int(bool(failures or absent or not found))


if __name__ == "__main__":
    sys.exit(main())
