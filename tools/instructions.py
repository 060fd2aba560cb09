"""Instructions that small fixed workloads take: a slower core shows on the busiest machine.

Seconds depend on the machine and on what else it does; the instructions of one binary are the same every time. Each
workload of `rust/core/examples/workloads.rs` runs under callgrind, which knows AVX2 and nothing above, so that all
x86-64 machines of the last ten years run the same code. The counts, less those of an empty run, are compared with the
recorded ones; returns 1 if one has grown by more than `--most` percent. Another compiler makes other code: where it is
not the recorded one this is said, and the counts are not judged unless `--strict` is given.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RECORD = ROOT / "benches" / "instructions.json"
BUILD = ["cargo", "build", "--quiet", "--release", "--workspace", "--example", "workloads"]


def output(*command: str) -> str:
    """Return what a command prints."""
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout


def counted(program: str, workload: str) -> int:
    """Run a workload under callgrind."""
    with tempfile.TemporaryDirectory() as folder:
        tool = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/out"]
        done = subprocess.run([*tool, program, workload], check=False, capture_output=True, text=True)
    found = re.search(r"Collected\s*:\s*(\d+)", done.stderr)
    if done.returncode or not found:
        raise SystemExit(f"{workload}: callgrind failed\n{done.stderr}")
    return int(found[1])


def measure() -> dict[str, int]:
    """Return the instructions of every workload beyond those of an empty one."""
    metadata = json.loads(output("cargo", "metadata", "--format-version=1", "--no-deps"))
    program = str(Path(metadata["target_directory"], "release", "examples", "workloads"))
    output(*BUILD)
    names = output(program).splitlines()
    counts = {name: counted(program, name) for name in names}
    nothing = counts.pop("nothing")
    return {name: count - nothing for name, count in counts.items()}


def main() -> int:
    """Compare, or record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="write the counts instead of comparing them")
    parser.add_argument(
        "--most", type=float, default=5.0, help="percent that a count may grow by (default %(default)s)"
    )
    parser.add_argument("--strict", action="store_true", help="judge the counts of another compiler, too")
    options = parser.parse_args()
    if shutil.which("valgrind") is None:
        print("instructions: not counted, there is no valgrind")
        return int(options.strict)
    compiler, counts = output("rustc", "--version").strip(), measure()
    if options.record:
        RECORD.write_text(json.dumps({"compiler": compiler, "instructions": counts}, indent=2) + "\n")
    recorded = json.loads(RECORD.read_text())
    judged = options.strict or compiler == recorded["compiler"]
    worse = 0
    for name, count in counts.items():
        before = recorded["instructions"].get(name)
        change = 100 * (count / before - 1) if before else float("nan")
        # A workload that is not recorded is as bad as one that has grown.
        bad = not change <= options.most
        worse += bad
        print(f"{name:32} {count:12,} {change:+6.1f} %{'  more than allowed' if bad else ''}")
    missing = sorted(recorded["instructions"].keys() - counts.keys())
    if missing:
        print(f"recorded, but no longer there: {', '.join(missing)}")
    if not judged:
        print(f"not judged: compiled by {compiler}, recorded with {recorded['compiler']}")
        return 0
    return int(bool(worse or missing))


if __name__ == "__main__":
    sys.exit(main())
