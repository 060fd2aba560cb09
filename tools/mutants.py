"""Break the core in one small way after another, and see whether a test notices.

The mutants stand in `tools/mutants/*.toml`, a file for every area, a table for each: a file below `rust/core/src`, a
text that occurs in it once (or once in `line`, which does), what it becomes, and what that breaks. The tree is
copied, all mutants are written into the copy at once, each as a branch beside the original, and the copy is compiled
once for every kind of tests; an environment variable says which mutant is alive. What the Rust tests let live meets
the Python tests. A run that takes much longer than without a mutant counts as killed. A mutant that breaks nothing
that may be relied on says why in `survives`. Where a branch cannot stand, as in a constant, `kind = "rebuild"`
compiles the mutant alone.

Returns 1 if less than 95 % of the others are killed, if a mutant no longer applies, or if a test fails without one.
Needs Python 3.11 with all that the tests of the package need (`make dev`), and Cargo.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from schemata import ROOT, SOURCES, VARIABLE, Mutant, copy, read

if TYPE_CHECKING:
    from collections.abc import Sequence

WANTED = 0.95  # share of the mutants that tests must kill
SLOWER = 10  # so many times the plain time, a run counts as hanging,
LEAST = 20.0  # but not before so many seconds
QUICK = 2.0  # seconds of tests that every mutant meets before others
ROOM = 12 << 30  # bytes of address space: a mutated size must not take the machine down
# Branches that are never taken are slow unoptimised, and take long to optimise.
PROFILE = "profile.release.package.algdiff-core.opt-level=1"
# The Python tests that look at the core, the quickest to notice something first.
PYTHON = [
    "weights",
    "rules",
    "golden",
    "reference",
    "ends",
    "engines",
    "engines_values",
    "engines_cuts",
    "parts",
    "laws",
    "corners",
    "gaps",
    "uneven",
    "uncertainty",
    "jitter",
    "stream",
    "stream_fits",
    "stream_times",
    "stream_errors",
    "fitted_corners",
    "design",
    "designs",
    "orders",
    "analysis",
    "analysis_corners",
    "reference_analysis",
    "tradeoff",
    "paper",
    "suggest_local",
    "differentiate",
    "savgol",
    "gradient",
    "messages",
    "units",
]


def cargo(work: Path) -> dict[str, str]:
    """Compile the tests of the core and the extension, and return their files by the names of their targets."""
    # Together, so that the core is compiled twice at most.
    command = ["cargo", "build", "--release", "--workspace", "--lib", "--tests", "--config", PROFILE]
    environment = {**os.environ, "CARGO_TARGET_DIR": str(work / "target")}
    command.append("--message-format=json-render-diagnostics")
    done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    files = {}
    for made in map(json.loads, done.stdout.splitlines()):
        if made["reason"] == "compiler-artifact" and Path(made["manifest_path"]).is_relative_to(work):
            library = next((name for name in made["filenames"] if name.endswith((".so", ".dylib"))), None)
            file = made["executable"] or library
            if file:
                target = made["target"]
                files["tests/" * ("test" in target["kind"]) + target["name"]] = file
    return files


class Runner:
    """Runs tests in the copy, with a mutant alive or none."""

    def __init__(self, work: Path, jobs: int, python: str) -> None:
        self.work, self.jobs, self.python = work, jobs, python
        self.unit = ""
        self.integration: list[str] = []
        self.seconds: dict[str, float] = {}

    def build(self) -> None:
        """Compile the tests and the extension, and put that into the package that is copied."""
        files = cargo(self.work)
        self.unit = files["algdiff_core"]
        self.integration = [file for name, file in sorted(files.items()) if name.startswith("tests/")]
        package = self.work / "python/algdiff"
        shutil.copyfile(files["_core"], package / "_core.abi3.so.new")
        (package / "_core.abi3.so.new").replace(package / "_core.abi3.so")
        command = [self.python, "-c", "import algdiff._core as core; print(core.__file__, end='')"]
        environment = {**os.environ, "PYTHONPATH": str(self.work / "python")}
        done = subprocess.run(command, env=environment, cwd=self.work, check=True, capture_output=True, text=True)
        if Path(done.stdout).parent != package:
            raise SystemExit(f"the tests would meet {done.stdout} instead of the copy")

    def run(self, command: Sequence[str], mutant: Mutant | None = None) -> str:
        """Return which test fails first, or nothing."""
        alive = mutant.name if mutant and mutant.kind != "rebuild" else ""
        environment = {**os.environ, VARIABLE: alive, "PYTHONPATH": str(self.work / "python"), "NO_COLOR": "1"}
        environment["RUST_TEST_THREADS"] = str(max(1, (os.cpu_count() or 1) // self.jobs))
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "start_new_session": True}
        failed = last = ""
        with subprocess.Popen(command, cwd=self.work, env=environment, preexec_fn=child, **pipes) as process:
            late = threading.Event()
            limit = max(LEAST, SLOWER * self.seconds.get(command[0], 360.0))
            watch = threading.Timer(limit, lambda: (late.set(), end(process)))
            watch.start()
            for line in process.stdout or ():
                last = line.strip() or last
                named = re.match(r"test (\S+) \.\.\. FAILED|(?:FAILED|ERROR) (.+?)(?: - |$)", line)
                if named and not failed:
                    failed = named[1] or named[2].strip()
                    if named[1]:
                        end(process)
            code = process.wait()
            watch.cancel()
        if late.is_set():
            return failed or "time"
        return failed or (f"{last[:80]} ({code})" if code else "")

    def pytest(self, names: Sequence[str]) -> list[str]:
        """Return the command that runs Python tests, as far as there are any of these names."""
        found = []
        for name in dict.fromkeys(names):
            file, _, function = name.partition("::")
            path = self.work / f"tests/test_{file}.py"
            if path.exists() and f"def {function}" in path.read_text(encoding="utf-8"):
                found.append(f"tests/test_{file}.py::{function}".removesuffix("::"))
        options = ["-x", "-q", "-p", "no:cacheprovider", "-o", "addopts=--import-mode=importlib --tb=no -rfE"]
        return [self.python, "-m", "pytest", *options, *found] if found else []

    def plain(self, mutants: Sequence[Mutant]) -> None:
        """See that nothing fails without a mutant, and how long that takes."""
        names = [name for own in mutants for name in (own.seen.partition("::")[0], *own.first)]
        for command in [*([program] for program in (*self.integration, self.unit)), self.pytest([*names, *PYTHON])]:
            start = time.monotonic()
            failed = self.run(command)
            if failed:
                raise SystemExit(f"without a mutant {failed} fails")
            self.seconds[command[0]] = time.monotonic() - start
            name = Path(command[0]).name.partition("-")[0]
            print(f"without a mutant the tests of {name} pass in {self.seconds[command[0]]:.0f} s", flush=True)

    def commands(self, mutant: Mutant) -> list[list[str]]:
        """Return what to run: first what is quick, and what saw the mutant last."""
        quick = [[program] for program in self.integration if self.seconds[program] <= QUICK]
        slow = [[program] for program in self.integration if self.seconds[program] > QUICK]
        # Others see what is not of an engine sooner than the long tests of the engines.
        unit = [self.unit, *([] if mutant.file.startswith("engine/") else ["--skip=engine::"])]
        # What is argued to break nothing meets all that is quick, and of the long rest the tests of its area.
        python = self.pytest([*mutant.first, *([] if mutant.survives else PYTHON)])
        return [[self.unit, mutant.modules], *quick, self.pytest([mutant.seen]), *slow, unit, python]

    def meet(self, mutant: Mutant) -> None:
        """Let a mutant meet the tests."""
        start = time.monotonic()
        for command in filter(None, self.commands(mutant)):
            mutant.by = self.run(command, mutant)
            if mutant.by:
                mutant.killed = "Python" if command[0] == self.python else "Rust"
                break
        mutant.seconds = round(time.monotonic() - start, 1)
        print(f"{mutant.name:28}{mutant.killed or 'lives':8}{mutant.seconds:7}  {mutant.by}", flush=True)


def child() -> None:
    """Prepare a process for its program: with so much memory, and not deaf to Ctrl-C as programs in the background."""
    resource.setrlimit(resource.RLIMIT_AS, (ROOM, resource.getrlimit(resource.RLIMIT_AS)[1]))
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def end(process: subprocess.Popen[str]) -> None:
    """Kill a process and what it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def report(mutants: Sequence[Mutant]) -> float:
    """Print a line for every area, and the survivors; return the share that was killed."""
    head = ("area", "mutants", "Rust", "Python", "equivalent", "survived")
    print("".join(f"{word:>12}" for word in head))
    living = [own for own in mutants if not own.killed and not own.survives]
    for area in [*dict.fromkeys(own.area for own in mutants), "all"]:
        those = [own for own in mutants if area in (own.area, "all")]
        count = Counter(own.killed or ("equivalent" if own.survives else "survived") for own in those)
        words = [area, len(those), *(count[key] for key in head[2:])]
        print("".join(f"{word:>12}" for word in words))
    for own in living:
        print(f"survived: {own.name} ({own.file}): {own.breaks}")
    for own in mutants:
        if own.survives:
            print(f"{'killed all the same' if own.killed else 'equivalent'}: {own.name}: {own.by or own.survives}")
    judged = sum(1 for own in mutants if own.killed or not own.survives)
    return 1.0 - len(living) / max(1, judged)


def main() -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these mutants")
    parser.add_argument("--area", nargs="+", metavar="AREA", help="the mutants of these files")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write what became of every mutant")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="mutants at a time (default: processors)")
    work = Path(tempfile.gettempdir()) / "algdiff-mutants"
    parser.add_argument("--work", type=Path, default=work, help="where to copy and compile (default: %(default)s)")
    parser.add_argument("--python", default=sys.executable, help="the Python of the tests (default: this one)")
    wanted = parser.parse_args()
    start = time.monotonic()
    mutants, stale = [], 0
    for own in read():
        try:
            own.place((ROOT / SOURCES / own.file).read_text(encoding="utf-8"))
        except (LookupError, OSError) as error:
            print(error, file=sys.stderr)
            stale += 1
        else:
            mutants.append(own)
    copy(wanted.work, mutants)
    unknown = set(wanted.only or ()) - {own.name for own in mutants}
    unknown |= set(wanted.area or ()) - {own.area for own in mutants}
    if unknown:
        parser.error(f"no mutant or area {', '.join(sorted(unknown))}")
    chosen = [own for own in mutants if not wanted.only or own.name in wanted.only]
    chosen = [own for own in chosen if not wanted.area or own.area in wanted.area]
    runner = Runner(wanted.work.resolve(), wanted.jobs, wanted.python)
    runner.build()
    runner.plain(mutants)
    with ThreadPoolExecutor(wanted.jobs) as pool:
        list(pool.map(runner.meet, [own for own in chosen if own.kind != "rebuild"]))
    for own in [own for own in chosen if own.kind == "rebuild"]:
        copy(wanted.work, [], own)
        runner.build()
        runner.meet(own)
    share = report(chosen)
    print(f"{share:.1%} killed in {(time.monotonic() - start) / 60:.0f} min; {stale} mutants no longer apply")
    if wanted.json:
        rows = [{key: value for key, value in asdict(own).items() if key != "first"} for own in chosen]
        wanted.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return int(share < WANTED or stale > 0)


if __name__ == "__main__":
    sys.exit(main())
