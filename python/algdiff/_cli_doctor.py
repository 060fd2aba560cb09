"""``algdiff doctor``: what the installation is made of, and whether it works."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse

DOCTOR = """Say what this installation is made of and whether it works: versions, registers, threads, optional parts, a
self-test, conflicts. Exit code 0 if all is well, 1 if something is broken; parts that are absent are not."""


def add(verb: argparse.ArgumentParser) -> None:
    """Add the options of ``algdiff doctor``."""
    verb.description = DOCTOR
    verb.set_defaults(verb=run)
    imports = "import the optional parts, too, each in a process of its own: finds broken ones, and takes seconds"
    verb.add_argument("--import", action="store_true", dest="importing", help=imports)
    verb.add_argument("--json", action="store_true", help="print JSON instead of the table")


def run(options: argparse.Namespace) -> None:
    """Print the findings; end with code 1 if something is broken."""
    from algdiff._doctor import examine

    found = examine(options.importing)
    print(json.dumps(found, indent=1) if options.json else _table(found))
    if not found["ok"]:
        raise SystemExit(1)


def _table(found: dict[str, Any]) -> str:
    """Return the findings as lines."""
    versions, compiler = found["versions"], found["compiler"]
    parts = [part for part in found["parts"] if part["found"]]
    absent = [part for part in found["parts"] if not part["found"]]
    rows = [
        ("algdiff", f"{_known(versions['algdiff'])}, {versions['path']}"),
        ("Python", f"{versions['python']}, {versions['executable']}"),
        ("NumPy", _known(versions["numpy"])),
        ("platform", versions["platform"]),
        ("registers", _registers(found["cpu"])),
        ("threads", _threads(found["threads"])),
        ("C compiler", "absent, for Differentiator.to_c" if compiler is None else _compiler(compiler)),
        ("self-test", found["self_test"]["said"]),
        *((part["name"], f"{_known(part['version'])}, for {part['for']}") for part in parts),
        *((part["name"], f"absent, for {part['for']}: {part['install']}") for part in absent),
        *(("note", note) for note in found["notes"]),
        *(("problem", problem) for problem in found["problems"]),
    ]
    width = max(len(name) for name, _ in rows)
    end = "all is well" if found["ok"] else f"problems: {len(found['problems'])}"
    return "\n".join([*(f"{name:{width}}  {said}" for name, said in rows), end])


def _known(value: str | None) -> str:
    return "unknown" if value is None else value


def _registers(cpu: dict[str, Any]) -> str:
    if cpu["registers"] is None:
        return f"unknown, {cpu['machine']}"
    how = "" if cpu["whole"] else ", in halves"
    return f"{cpu['registers']} bytes ({cpu['name']}){how}, {cpu['machine']}"


def _compiler(compiler: dict[str, str]) -> str:
    return ", ".join(filter(None, (compiler["version"], compiler["path"])))


def _threads(threads: dict[str, Any]) -> str:
    """Return processors and settings in one line."""
    of = "" if threads["affinity"] is None else f", {threads['affinity']} of them for this process"
    wanted = threads["ALGDIFF_NUM_THREADS"]
    return f"{threads['processors']} processors{of}; ALGDIFF_NUM_THREADS is {wanted or 'not set'}"
