"""Run the fuzz targets, each for so many executions, and print what they did; exit with 1 if one found a fault.

    python fuzz/run.py --runs 100_000                # all of them
    python fuzz/run.py headers front --seconds 600   # some, for ten minutes each

Targets of the core are built by cargo-fuzz, those of the Python package need atheris beside an installed algdiff. What
a target has learned stays in fuzz/corpus, so that another run goes on from there; what broke it is kept in
fuzz/artifacts.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
RUST = ("design", "engines", "streams")
PYTHON = ("headers", "designs", "front")
ROUND = 1_000_000
"""Executions of one process: atheris keeps some memory of every one."""
SHARED = "/dev/shm"  # noqa: S108 - a new folder is made in it
"""Where files lie in memory, on systems that have it."""
SECONDS = 30
"""What one execution may take; the usual one takes below a millisecond."""
SEEN = re.compile(r"#(\d+)\t\S+\s+cov: (\d+) ft: (\d+)")


class Result(NamedTuple):
    """What a target did.

    Attributes
    ----------
    target : str
        Which one.
    executions, seconds : float
        How many, and how long they took.
    coverage, features : int
        What libFuzzer says of the code that they reached.
    faults : list of Path
        What broke it.
    said : str
        The end of what it said, if it failed.
    """

    target: str
    executions: int
    seconds: float
    coverage: int
    features: int
    faults: list[Path]
    said: str


def main() -> int:
    """Build, run, print."""
    options = arguments()
    targets = options.targets or [*RUST, *PYTHON]
    for target in (one for one in targets if one in RUST):
        subprocess.run(cargo_fuzz("build", target, options), env=environment(), cwd=HERE.parent, check=True)
    print("target     executions    a second  coverage  features  crashes", flush=True)
    with ThreadPoolExecutor(options.jobs) as pool:
        results = list(pool.map(partial(run, options=options), targets))
    for result in results:
        for fault in result.faults:
            print(f"\n{result.target}: {fault}\n{result.said}")
        if result.said and not result.faults:
            print(f"\n{result.target} did not run:\n{result.said}")
    return int(any(result.said for result in results))


def arguments() -> argparse.Namespace:
    """Return the arguments of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    option = parser.add_argument
    option("targets", nargs="*", metavar="TARGET", help=f"some of {', '.join((*RUST, *PYTHON))}; default: all")
    option("--runs", type=int, default=10_000_000, help="executions of each target; default: %(default)s")
    option("--seconds", type=int, help="end a target after this time, however many executions are left")
    option("--jobs", type=int, default=1, help="targets that run at once; default: %(default)s")
    option("--sanitizer", default="none", help="of the core's targets: none, the default, or address")
    option("--python", default=sys.executable, help="the interpreter that has atheris and algdiff; default: this one")
    option("--cargo-fuzz", default="cargo-fuzz", metavar="PATH", help="the program; default: %(default)s")
    options = parser.parse_args()
    if unknown := set(options.targets) - {*RUST, *PYTHON}:
        parser.error(f"TARGET must be one of {', '.join((*RUST, *PYTHON))}, got {', '.join(sorted(unknown))}")
    return options


def environment() -> dict[str, str]:
    """Return the environment, in which a stable compiler takes the flags of cargo-fuzz too."""
    return {"RUSTC_BOOTSTRAP": "1", **os.environ}


def cargo_fuzz(verb: str, target: str, options: argparse.Namespace) -> list[str]:
    """Return a command of cargo-fuzz.

    One unit of code per crate, its own choice, takes twice the time to compile. Noting what is compared with what takes
    a third of a run, and says little of structures that are made of bytes.
    """
    flags = ["--sanitizer", options.sanitizer, "--codegen-units", "16", "--no-trace-compares"]
    return [options.cargo_fuzz, "fuzz", verb, *flags, target]


def command(target: str, corpus: Path, options: argparse.Namespace) -> list[str]:
    """Return what runs a target, but for flags of libFuzzer."""
    if target in PYTHON:
        return [options.python, str(HERE / "python" / f"{target}.py"), str(corpus)]
    # Structures are made of many bytes: short inputs are a waste.
    return [*cargo_fuzz("run", target, options), str(corpus), "--", "-len_control=0"]


def plant(target: str, corpus: Path, options: argparse.Namespace) -> None:
    """Write what a target starts from."""
    if target in PYTHON:
        words = [options.python, str(HERE / "python" / f"{target}.py"), "--seeds", str(corpus)]
        subprocess.run(words, stderr=subprocess.DEVNULL, check=False)
        return
    rng = random.Random(0)  # noqa: S311 - bytes to begin with
    for number in range(64):
        (corpus / f"seed-{number:03}").write_bytes(rng.randbytes(256))


def run(target: str, options: argparse.Namespace) -> Result:
    """Run one target, round by round, until it is done, too slow or broken."""
    corpus, artifacts = HERE / "corpus" / target, HERE / "artifacts" / target
    corpus.mkdir(parents=True, exist_ok=True)
    artifacts.mkdir(parents=True, exist_ok=True)
    started, before = time.monotonic(), set(artifacts.iterdir())
    plant(target, corpus, options)
    done = coverage = features = 0
    said, faults = "", []
    while done < options.runs and not said:
        left = sys.maxsize if options.seconds is None else int(options.seconds - (time.monotonic() - started))
        if left <= 0:
            break
        flags = [f"-runs={min(ROUND, options.runs - done)}", f"-timeout={SECONDS}", "-max_len=512", "-reload=0"]
        # Weighing every input by how rare what it reaches is takes longer than most executions.
        flags += ["-entropic=0", f"-artifact_prefix={artifacts}/"]
        flags += [] if options.seconds is None else [f"-max_total_time={left}"]
        with tempfile.TemporaryDirectory(dir=SHARED if os.path.isdir(SHARED) else None) as folder:
            output, broke = follow([*command(target, corpus, options), *flags], folder)
        found = SEEN.findall(output)
        executions, coverage, features = map(int, found[-1]) if found else (0, coverage, features)
        done += executions
        print(f"{target}: {done} executions", file=sys.stderr)
        faults = sorted(set(artifacts.iterdir()) - before)
        said = output[-3000:] if broke or not executions else ""
    result = Result(target, done, time.monotonic() - started, coverage, features, faults, said)
    show(result)
    return result


def follow(words: Sequence[str], folder: str) -> tuple[str, bool]:
    """Return the end of what a process says that has a folder for its files, and whether it broke."""
    process = subprocess.Popen(
        words,
        env={**environment(), "TMPDIR": folder},
        cwd=HERE.parent,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        errors="replace",
        text=True,
    )
    assert process.stdout is not None
    kept: list[str] = []
    for line in process.stdout:
        kept.append(line[:2000])
        del kept[:-400]
    return "".join(kept), process.wait() != 0


def show(result: Result) -> None:
    """Print a line of the table."""
    pace = result.executions / max(result.seconds, 1e-9)
    columns = (f"{result.executions:>10}", f"{pace:>10.0f}", f"{result.coverage:>8}", f"{result.features:>8}")
    print(f"{result.target:<9}  {'  '.join(columns)}  {len(result.faults):>7}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
