"""What goes into a release: crates and licences, one version, and workflows and documents that name what there is.

The rest takes a build or a network: ``make audit``, ``make wheel`` and the other commands in RELEASE.md.
"""

from __future__ import annotations

import importlib.metadata
import itertools
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))

import audit  # noqa: E402
import supply  # noqa: E402

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
DOCUMENTS = [ROOT / name for name in ("RELEASE.md", "SECURITY.md", "CONTRIBUTING.md", "README.md")]


def text(path: Path | str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def cargo(*words: str) -> str:
    """Return what Cargo prints, without a network if that will do. Skip if it lacks one; fail if it objects."""
    if shutil.which("cargo") is None:
        pytest.skip("there is no cargo")
    for offline in (["--offline"], []):
        command = ["cargo", words[0], "--locked", *offline, *words[1:]]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode == 0:
            return done.stdout
        assert re.search("download|network|offline", done.stderr), done.stderr
        assert "lock file" not in done.stderr, done.stderr  # it would have to be updated
    pytest.skip(f"cargo lacks crates: {done.stderr}")


@pytest.fixture(scope="module")
def packages() -> dict[str, dict[str, Any]]:
    """Return every package that Cargo.lock names, as "name version"."""
    found = json.loads(cargo("metadata", "--format-version=1"))["packages"]
    return {f"{package['name']} {package['version']}": package for package in found}


def test_the_lock_file_is_committed_and_current(packages: dict[str, dict[str, Any]]) -> None:
    tracked = subprocess.run(["git", "ls-files", "Cargo.lock"], cwd=ROOT, capture_output=True, text=True, check=False)  # noqa: S607
    assert tracked.returncode or tracked.stdout.strip() == "Cargo.lock"  # or no checkout
    assert packages.keys() == supply.locked()


def test_few_crates_go_into_a_wheel(packages: dict[str, dict[str, Any]]) -> None:
    compiled = supply.crates()
    print(f"{len(compiled)} crates in a wheel of any platform, {len(packages)} in Cargo.lock")
    assert {f"{name} {supply.version()}" for name in ("algdiff-core", "algdiff-fft", "algdiff-py")} < compiled
    assert compiled < packages.keys()
    assert len(compiled) <= audit.MOST


def test_what_only_tests_take_is_not_counted() -> None:
    cargo("metadata", "--format-version=1")
    assert not {"assert_no_alloc", "no-panic", "proptest"} & {crate.split()[0] for crate in supply.crates()}


# A licence expression without parentheses: terms that must all hold, each a choice.
def choices(expression: str) -> list[set[str]]:
    plain = expression.replace("/", " OR ").replace("(", "").replace(")", "")
    return [set(part.split(" OR ")) for part in plain.split(" AND ")]


def denied() -> tuple[set[str], set[str], set[str]]:
    """Return the licences that deny.toml allows, the crates it excepts and those of which it bears two versions."""
    words = {name: re.search(rf"^{name} = \[(.*?)\n?\]", text("deny.toml"), re.M | re.S) for name in ("allow", "skip")}
    exceptions = re.search(r"^exceptions = \[(.*)\]", text("deny.toml"), re.M)
    assert words["allow"]
    assert words["skip"]
    assert exceptions
    allowed = set(re.findall(r'^ +"([^"]+)",', words["allow"][1], re.M))
    skipped = {crate.replace("@", " ") for crate in re.findall(r'crate = "([^"]+)"', words["skip"][1])}
    return allowed, set(re.findall(r'crate = "([^"]+)"', exceptions[1])), skipped


def test_exactly_the_licences_needed_are_allowed(packages: dict[str, dict[str, Any]]) -> None:
    allowed, excepted, _ = denied()
    terms = [term for p in packages.values() if p["name"] not in excepted for term in choices(p["license"])]
    assert [term for term in terms if not term & allowed] == []
    needed = {name for name in allowed if any(not term & (allowed - {name}) for term in terms)}
    assert needed == allowed
    assert not excepted & {crate.split()[0] for crate in supply.crates()}  # what is shipped needs none


def test_two_versions_are_borne_only_where_there_are_two() -> None:
    cargo("metadata", "--format-version=1")
    _, _, skipped = denied()
    by_name = itertools.groupby(sorted(supply.crates()), lambda crate: crate.split()[0])
    several = {name: set(versions) for name, versions in by_name}
    for name, versions in several.items():
        assert len(versions - skipped) == 1, name
        assert versions & skipped == set() or len(versions) > 1, name
    assert skipped <= set().union(*several.values())


def test_one_file_states_the_version() -> None:
    version = supply.version()
    assert importlib.metadata.version("algdiff-rs") == version
    assert re.search(r"^dynamic = \[.*\"version\"", text("pyproject.toml"), re.M)
    assert not re.search(r"^version *=", text("pyproject.toml"), re.M)
    for manifest in sorted(ROOT.glob("rust/*/Cargo.toml")):
        assert "version.workspace = true" in manifest.read_text(encoding="utf-8"), manifest
    for lock in ("Cargo.lock", "fuzz/Cargo.lock"):
        assert f"algdiff-core {version}" in supply.locked(ROOT / lock), lock
    states = re.compile(rf"(version|algdiff)[^\n]*(?<![\d.]){re.escape(version)}(?![\d.])", re.IGNORECASE)
    folders = ("python", "rust", "docs", "benches", "tools", "examples", "fuzz/src", "fuzz/fuzz_targets", ".github")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]
    files += [path for path in ROOT.iterdir() if path.is_file() and path.name not in ("Cargo.toml", "CHANGELOG.md")]
    kinds = {".py", ".pyi", ".rs", ".toml", ".md", ".rst", ".html", ".js", ".yml", ".cff", ""}
    built = ("auto_examples", "auto_benchmarks", "generated", "__pycache__")
    ours = [path for path in files if path.suffix in kinds and not set(built) & set(path.parts)]
    assert [str(path) for path in ours if states.search(path.read_text(encoding="utf-8", errors="replace"))] == []


def targets() -> set[str]:
    return set(re.findall(r"^([a-z][a-z-]*):", text("Makefile"), re.M))


@pytest.mark.parametrize("path", [*WORKFLOWS, *DOCUMENTS], ids=lambda path: path.name)
def test_targets_that_are_named_exist(path: Path) -> None:
    named = set(re.findall(r"(?:`|run: |&& |^ *)make ([a-z][a-z-]*)", text(path), re.M))
    assert named or path.name == "README.md"
    assert named <= targets()


@pytest.mark.parametrize("path", DOCUMENTS[:2], ids=lambda path: path.name)
def test_files_that_are_named_exist(path: Path) -> None:
    named = re.findall(r"`([\w./-]+\.(?:toml|yml|md|txt|lock)|[\w.]+/)`", text(path))
    assert named
    assert [name for name in named if not (ROOT / name).exists() and name != "dist/"] == []


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_only_call_make_and_pinned_actions(path: Path) -> None:
    installs = r"python -m pip install -r tools/requirements.txt|cargo install --locked cargo-deny --version [\d.]+"
    others = rf"{installs}|sudo apt-get install --yes valgrind|rustc --version --verbose|python -VV"
    allowed = rf"make [a-z-]+( [A-Z]+=\"[^\"]+\")*|{others}"
    assert [line for line in re.findall(r"run: (.*)", text(path)) if not re.fullmatch(allowed, line)] == []
    uses = re.findall(r"uses: (.*)", text(path))
    assert uses
    assert [line for line in uses if not re.fullmatch(r"actions/[a-z-]+@[0-9a-f]{40} # v[\d.]+", line)] == []
    assert re.search(r"^permissions:\n  contents: read$", text(path), re.M)


def test_numbers_agree() -> None:
    assert f"at most {audit.MOST} crates" in text("SECURITY.md")
    assert f"cargo-deny --version {audit.DENY}" in text(".github/workflows/ci.yml")
    compiler = re.search(r"rustc ([\d.]+) ", text("benches/instructions.json"))
    assert compiler
    assert f'RUSTUP_TOOLCHAIN: "{compiler[1]}"' in text(".github/workflows/ci.yml")
    requirements = [line for line in text("tools/requirements.txt").splitlines() if line and line[0] != "#"]
    assert [line for line in requirements if not re.match(r"[a-z0-9]+==[\d.]+(;|$)", line)] == []
