"""The mutants of `tools/mutants/`, and a copy of the tree with all of them in it."""

from __future__ import annotations

import json
import subprocess
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import tomllib

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

ROOT = Path(__file__).resolve().parents[1]
MUTANTS = Path(__file__).with_name("mutants")
TREE = ("rust", "python", "tests", "Cargo.toml", "Cargo.lock", "pyproject.toml")
SOURCES = "rust/core/src"
VARIABLE = "ALGDIFF_MUTANT"

MODULE = """//! Which mutant is alive.

use std::sync::atomic::{{AtomicUsize, Ordering}};

const NAMES: [&str; {count}] = {names};

static ALIVE: AtomicUsize = AtomicUsize::new(usize::MAX);

/// Whether it is the one with this number.
#[inline(always)]
pub fn is(number: usize) -> bool {{
    let alive = ALIVE.load(Ordering::Relaxed);
    number == if alive == usize::MAX {{ read() }} else {{ alive }}
}}

#[cold]
#[inline(never)]
fn read() -> usize {{
    let wanted = std::env::var("{variable}").unwrap_or_default();
    let alive = NAMES.iter().position(|name| *name == wanted).unwrap_or(NAMES.len());
    assert!(wanted.is_empty() || alive < NAMES.len(), "no mutant {{wanted}}");
    ALIVE.store(alive, Ordering::Relaxed);
    alive
}}
"""


@dataclass
class Mutant:
    """One way to break the core, and what became of it."""

    name: str
    area: str
    file: str
    text: str
    becomes: str
    breaks: str
    line: str = ""
    kind: str = ""  # by default an expression, or a statement if the text ends with a semicolon
    seen: str = ""  # the Python test that saw it last: its file and its name
    survives: str = ""
    first: Sequence[str] = field(default=(), repr=False)  # Python tests that are asked first
    killed: str = ""  # "Rust" or "Python"
    by: str = ""
    seconds: float = 0.0

    @property
    def modules(self) -> str:
        """What the names of the unit tests of its module begin with."""
        path = Path(self.file).with_suffix("").parts
        return "".join(f"{part}::" for part in path[: 2 if path[0] == "engine" else 1])

    def place(self, source: str) -> int:
        """Return where the text starts in its file."""
        line = self.line or self.text
        for what, where in ((line, source), (self.text, line)):
            if where.count(what) != 1:
                raise LookupError(f"{self.name} no longer applies: {where.count(what)} times in {self.file}: {what}")
        return source.index(line) + line.index(self.text)


def read() -> list[Mutant]:
    """Return all mutants."""
    found = []
    for path in sorted(MUTANTS.glob("*.toml")):
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
        first = tables.pop("tests", ())
        found += [Mutant(name, path.stem, first=first, **table) for name, table in tables.items()]
    twice = [name for name, count in Counter(mutant.name for mutant in found).items() if count > 1]
    if twice:
        raise SystemExit(f"mutants of the same name: {', '.join(twice)}")
    return found


def branches(mutants: Sequence[tuple[int, Mutant]]) -> str:
    """Return the text that holds the original and its mutants, each with its number."""
    original = mutants[0][1].text
    statement = original.endswith(";") or mutants[0][1].kind == "statement"
    arms = "".join(f"if crate::mutant::is({number}) {{ {mutant.becomes} }} else " for number, mutant in mutants)
    return f"{arms}{{ {original} }}" if statement else f"({arms}{{ {original} }})"


def mutated(source: str, mutants: Iterable[tuple[int, Mutant]]) -> str:
    """Return a source file with all its mutants beside what they replace."""
    alike: dict[tuple[int, str], list[tuple[int, Mutant]]] = {}
    for number, mutant in mutants:
        alike.setdefault((mutant.place(source), mutant.text), []).append((number, mutant))
    parts, end = [], 0
    for (start, text), those in sorted(alike.items(), key=lambda item: item[0]):
        if start < end:
            raise LookupError(f"{those[0][1].name} overlaps the mutant before it in {those[0][1].file}")
        parts += [source[end:start], branches(those)]
        end = start + len(text)
    return "".join([*parts, source[end:]])


def write(path: Path, content: bytes) -> None:
    """Write a file unless it is so already: what does not change is not compiled again."""
    if not path.exists() or path.read_bytes() != content:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def copy(work: Path, mutants: Sequence[Mutant], alone: Mutant | None = None) -> None:
    """Copy what git knows of the tree, with all mutants in it, or with one alone and no other."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", *TREE]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines()
    names = [name for name in names if (ROOT / name).is_file()]
    sources = {name: (ROOT / name).read_bytes() for name in names}
    numbered = [(number, mutant) for number, mutant in enumerate(mutants) if mutant.kind != "rebuild"]
    for file in {mutant.file for _, mutant in numbered}:
        path = f"{SOURCES}/{file}"
        sources[path] = mutated(sources[path].decode(), [own for own in numbered if own[1].file == file]).encode()
    if alone:
        path = f"{SOURCES}/{alone.file}"
        source = (ROOT / path).read_text(encoding="utf-8")
        start = alone.place(source)
        sources[path] = f"{source[:start]}{alone.becomes}{source[start + len(alone.text) :]}".encode()
    names = json.dumps([mutant.name for mutant in mutants])
    sources[f"{SOURCES}/mutant.rs"] = MODULE.format(names=names, count=len(mutants), variable=VARIABLE).encode()
    library = f"{SOURCES}/lib.rs"
    sources[library] = b"#![allow(warnings)]\n" + sources[library] + b"pub mod mutant;\n"
    for old in [path for name in ("rust", "python", "tests") for path in (work / name).rglob("*") if path.is_file()]:
        if old.relative_to(work).as_posix() not in sources and old.suffix not in {".so", ".pyc"}:
            old.unlink()
    for name, content in sources.items():
        write(work / name, content)
