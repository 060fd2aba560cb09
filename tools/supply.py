"""What the tools for releases share: commands, what the manifests say, copies of the tree, steps that pass or fail."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

ROOT = Path(__file__).resolve().parents[1]
WHEEL_CRATE = "algdiff-py"


class FailureError(Exception):
    """What a check has to say, without a traceback."""


def run(*command: str | Path, cwd: Path = ROOT, env: Mapping[str, str] | None = None) -> str:
    """Return what a command prints; if it fails, what it said."""
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, encoding="utf-8", check=False)
    if done.returncode:
        said = (done.stdout + done.stderr).strip()
        raise FailureError(f"{' '.join(words)} failed\n{said[-4000:]}")
    return done.stdout


def version() -> str:
    """Return the version, which only the workspace's manifest states."""
    manifest = (ROOT / "Cargo.toml").read_text(encoding="utf-8")
    found = re.search(r'^\[workspace\.package\]\nversion = "([^"]+)"$', manifest, re.MULTILINE)
    if found is None:
        raise FailureError("Cargo.toml: no version in [workspace.package]")
    return found[1]


def crates(*, everywhere: bool = True, edges: str = "normal,build") -> set[str]:
    """Return "name version" of what is compiled for the package, itself included: for all targets or for this machine.

    What only tests and benchmarks of the core take is not in it.
    """
    options = ["--locked", "--package", WHEEL_CRATE, "--edges", edges, "--prefix", "none", "--format", "{p}"]
    lines = run("cargo", "tree", *options, *(["--target", "all"] if everywhere else [])).splitlines()
    return {" ".join(line.split()[:2]).replace(" v", " ") for line in lines if line.strip()}


def locked(path: Path = ROOT / "Cargo.lock") -> set[str]:
    """Return "name version" of every crate in a lock file."""
    found = re.findall(r'^name = "(.+)"\nversion = "(.+)"$', path.read_text(encoding="utf-8"), re.MULTILINE)
    return {f"{name} {number}" for name, number in found}


def copy_tree(to: Path) -> Path:
    """Copy what Git knows, or would add, to a new folder."""
    names = run("git", "ls-files", "--cached", "--others", "--exclude-standard", "-z").split("\0")
    for name in names:
        source, target = ROOT / name, to / name
        if name and source.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    return to


def environment(source: Path = ROOT, **more: str) -> dict[str, str]:
    """Return the environment for builds whose bytes depend on the sources and the compiler alone.

    Times are those of the last commit. Paths that end up in messages and symbols lose where they lie, which
    also keeps the builder's folders out of the library.
    """
    env = dict(os.environ)
    cargo = Path(env.get("CARGO_HOME", Path.home() / ".cargo"))
    remapped = {cargo / "registry" / "src": "/crates", source: "/algdiff"}
    flags = [env.get("RUSTFLAGS", ""), *(f"--remap-path-prefix={path}={name}" for path, name in remapped.items())]
    env["RUSTFLAGS"] = " ".join(filter(None, flags))
    env.setdefault("SOURCE_DATE_EPOCH", run("git", "log", "-1", "--format=%ct").strip())
    # Of this Python, whose tools are found beside it.
    env["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), env["PATH"]])
    return {**env, **more}


def steps(checks: Mapping[str, Callable[[], str]]) -> int:
    """Run checks, print a line for each, and return 1 if one has failed."""
    failed = 0
    for name, check in checks.items():
        try:
            verdict, said = "ok  ", check()
        except FailureError as problem:
            verdict, said = "FAIL", str(problem)
        except Exception:
            verdict, said = "FAIL", traceback.format_exc()
        failed += verdict == "FAIL"
        print(f"{verdict} {name}: {said}", flush=True)
    return int(bool(failed))
