"""Build the source distribution, and install it where there is nothing but Python, pip and Cargo.

What is in it is compared with what a build needs; then pip builds and installs it in a fresh environment in which no
variable is set but PATH, HOME and those of pip and Cargo, and a design is computed there. Needs
`tools/requirements.txt`; returns 1 if a step fails. Takes as long as an install.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tarfile
import tempfile
from functools import partial
from pathlib import Path

import supply
from supply import FailureError

NEEDED = {
    "Cargo.lock",
    "Cargo.toml",
    "LICENSE",
    "LICENSE-APACHE",
    "LICENSE-MIT",
    "PKG-INFO",
    "README.md",
    "pyproject.toml",
    "python/algdiff/data/LICENSE-pendulum_encoder",
    "python/algdiff/py.typed",
    "rust/core/Cargo.toml",
    "rust/fft/Cargo.toml",
    "rust/py/Cargo.toml",
}
# The core's own tests, examples and benchmarks belong to its crate, whose manifest names them.
FOLDERS = ("python/algdiff/", "rust/core/", "rust/fft/", "rust/py/")
MOST = 1_000_000  # bytes
SMOKE = """
import algdiff, numpy as np
assert np.abs(algdiff.differentiate(np.arange(100.0) ** 2, 11, delta=1.0) - 2 * np.arange(100.0)).max() < 1e-9
print(algdiff.__version__, algdiff.__file__)
"""


def build(source: Path, out: Path, env: dict[str, str]) -> Path:
    """Build the source distribution of a tree into a folder."""
    supply.run(sys.executable, "-m", "maturin", "sdist", "--out", out, cwd=source, env=env)
    return out / f"algdiff_rs-{supply.version()}.tar.gz"


def contents(archive: Path) -> str:
    """Check that what is needed is in it, and what is not, is not."""
    with tarfile.open(archive) as tar:
        sizes = {member.name.split("/", 1)[1]: member.size for member in tar.getmembers() if member.isfile()}
    missing = sorted(NEEDED - sizes.keys())
    surplus = sorted(name for name in sizes.keys() - NEEDED if not name.startswith(FOLDERS))
    if missing or surplus:
        raise FailureError(f"missing: {missing}, not expected: {surplus}")
    size = archive.stat().st_size
    if size > MOST:
        raise FailureError(f"{size:,} bytes, allowed are {MOST:,}")
    return f"{archive.name}, {size:,} bytes, {len(sizes)} files of {sum(sizes.values()):,} bytes"


def install(archive: Path) -> str:
    """Install it with pip, isolated, and compute something."""
    cargo = shutil.which("cargo")
    if cargo is None:
        raise FailureError("there is no cargo on PATH")
    kept = {name: value for name, value in os.environ.items() if name.startswith(("PIP_", "CARGO_", "RUSTUP_"))}
    with tempfile.TemporaryDirectory(prefix="algdiff-sdist-") as folder:
        # No compiled crate of another build, no tool of this environment.
        env = {**kept, "HOME": str(Path.home()), "PATH": os.pathsep.join([str(Path(cargo).parent), os.defpath])}
        env["CARGO_TARGET_DIR"] = str(Path(folder, "target"))
        python = Path(folder, "venv", "Scripts" if os.name == "nt" else "bin", "python")
        supply.run(sys.executable, "-m", "venv", Path(folder, "venv"))
        before = supply.run(python, "-m", "pip", "list", "--format=freeze", cwd=Path(folder), env=env).split()
        supply.run(python, "-m", "pip", "install", archive.resolve(), cwd=Path(folder), env=env)
        said = supply.run(python, "-I", "-c", SMOKE, cwd=Path(folder), env=env)
        after = supply.run(python, "-m", "pip", "list", "--format=freeze", cwd=Path(folder), env=env).split()
        if Path(folder).name not in said:
            raise FailureError(f"another algdiff was imported: {said}")
    return f"installed into an environment of {', '.join(before)}; it has {', '.join(sorted({*after} - {*before}))} now"


def main() -> int:
    """Build, look, install."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=supply.ROOT / "dist", help="folder for it (default dist/)")
    archive = build(supply.ROOT, parser.parse_args().out, supply.environment())
    return supply.steps({"contents": partial(contents, archive), "install": partial(install, archive)})


if __name__ == "__main__":
    sys.exit(main())
