"""The share of lines that the tests reach: of Rust by the compiler's own counters, of Python by coverage.py.

The extension is built with counters, put beside a copy of the Python package, and the whole suite runs on that copy;
the core's own tests run with counters as well. What only tests compile does not count. Needs `llvm-profdata` and
`llvm-cov` of the compiler's LLVM (`rustup component add llvm-tools`, or paths in LLVM_PROFDATA and LLVM_COV) and
`coverage`. Returns 1 below `--least` percent of either. Arguments after `--` go to pytest, instead of the whole suite
without the tests of time, which compute for seconds and for an hour with counters.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WORK = ROOT / "build" / "coverage"
SITE, RAW, TARGET = WORK / "site", WORK / "raw", WORK / "target"
# What runs while it is compiled counts as well, and not where cargo runs it.
ASIDE = {"LLVM_PROFILE_FILE": str(WORK / "build-%8m.profraw")}
COUNTING = {**os.environ, **ASIDE, "RUSTFLAGS": "-C instrument-coverage", "CARGO_TARGET_DIR": str(TARGET)}
TIMED = ("tests/test_runtime.py", "tests/test_stream_runtime.py")
PROFILE = ["--release", "--config", "profile.release.strip=false"]
CORE = ["--package", "algdiff-core", "--config", "profile.release.package.algdiff-core.opt-level=0", *PROFILE]


def llvm(tool: str) -> str:
    """Return the path of a tool of the compiler's LLVM."""
    given = os.environ.get(tool.replace("-", "_").upper())
    host = re.search(
        r"host: (\S+)", subprocess.run(["rustc", "-vV"], capture_output=True, text=True, check=True).stdout
    )
    home = subprocess.run(["rustc", "--print", "sysroot"], capture_output=True, text=True, check=True).stdout.strip()
    bundled = Path(home, "lib", "rustlib", host[1] if host else "", "bin", tool)
    return given or (str(bundled) if bundled.exists() else tool)


def counted(command: list[str], name: str, **environment: str) -> None:
    """Run tests whose counters go to files of that name; what fails is said, and counts all the same."""
    raw = {"LLVM_PROFILE_FILE": str(RAW / f"{name}-%8m.profraw")}
    done = subprocess.run(command, check=False, cwd=ROOT, env={**COUNTING, **raw, **environment})
    if done.returncode:
        print(f"{name}: tests failed ({done.returncode})")


def binaries() -> list[str]:
    """Build the core's tests and return where they are."""
    command = ["cargo", "test", *CORE, "--lib", "--tests", "--no-run", "--message-format=json"]
    lines = subprocess.run(command, check=True, cwd=ROOT, env=COUNTING, stdout=subprocess.PIPE, text=True).stdout
    found = [json.loads(line).get("executable") for line in lines.splitlines() if line.startswith("{")]
    return [path for path in found if path]


def site() -> Path:
    """Build the extension and put the package together; return the extension."""
    subprocess.run(["cargo", "build", *PROFILE, "--package", "algdiff-py"], check=True, cwd=ROOT, env=COUNTING)
    shutil.rmtree(SITE, ignore_errors=True)
    shutil.copytree(ROOT / "python" / "algdiff", SITE / "algdiff", ignore=shutil.ignore_patterns("__pycache__"))
    return Path(shutil.copy(TARGET / "release" / "lib_core.so", SITE / "algdiff" / "_core.abi3.so"))


def rust(objects: list[str]) -> list[tuple[str, int, int]]:
    """Return the name, the lines and the reached lines of every file of Rust."""
    merged = WORK / "all.profdata"
    raw = [str(path) for path in RAW.glob("*.profraw")]
    subprocess.run([llvm("llvm-profdata"), "merge", "--sparse", *raw, "-o", str(merged)], check=True)
    others = [word for path in objects[1:] for word in ("--object", path)]
    command = [llvm("llvm-cov"), "export", "--format=lcov", f"--instr-profile={merged}", objects[0], *others]
    lcov = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found = []
    for record in lcov.split("end_of_record"):
        path = re.search(r"SF:(.*)", record)
        source = Path(path[1]).resolve() if path else ROOT
        if not source.is_relative_to(ROOT / "rust") or "src" not in source.parts or source.name == "tests.rs":
            continue
        text = source.read_text().splitlines()
        # By convention what is for tests alone stands last.
        end = text.index("#[cfg(test)]") if "#[cfg(test)]" in text else len(text)
        counts = [int(count) for line, count in re.findall(r"DA:(\d+),(\d+)", record) if int(line) <= end]
        found.append((str(source.relative_to(ROOT)), len(counts), sum(count > 0 for count in counts)))
    return found


def python() -> list[tuple[str, int, int]]:
    """Return the name, the lines and the reached lines of every file of Python."""
    report = WORK / "python.json"
    coverage = [sys.executable, "-m", "coverage"]
    subprocess.run([*coverage, "combine", "--quiet"], check=True, cwd=WORK)
    subprocess.run([*coverage, "json", "--quiet", "-o", str(report)], check=True, cwd=WORK)
    files = json.loads(report.read_text())["files"]
    sums = {name: file["summary"] for name, file in files.items()}
    return [(Path(name).name, each["num_statements"], each["covered_lines"]) for name, each in sums.items()]


def table(title: str, files: list[tuple[str, int, int]]) -> float:
    """Print the files that are reached least; return the percent of all lines that are."""
    lines, reached = (sum(file[column] for file in files) for column in (1, 2))
    worst = sorted(files, key=lambda file: file[2] - file[1])[:12]
    for name, count, seen in (*worst, (f"{title}, all {len(files)} files", lines, reached)):
        print(f"{name:60} {seen:6} of {count:6}  {100 * seen / max(count, 1):6.2f} %")
    return 100 * reached / max(lines, 1)


def main() -> int:
    """Measure both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--least", type=float, default=95.0, help="percent (default %(default)s)")
    parser.add_argument("pytest", nargs="*", help="arguments of pytest")
    options = parser.parse_args()
    shutil.rmtree(RAW, ignore_errors=True)
    extension, tests = site(), binaries()
    for test in tests:
        counted([test], Path(test).name)
    settings = (
        f"[run]\nsource_pkgs = algdiff\npatch = subprocess, _exit\nparallel = true\ndata_file = {WORK}/.coverage\n"
    )
    (WORK / ".coveragerc").write_text(settings)
    for old in WORK.glob(".coverage.*"):
        old.unlink()
    pytest = ["-m", "coverage", "run", f"--rcfile={WORK}/.coveragerc", "-m", "pytest", "-q", *options.pytest]
    paths = ["tests", str(SITE / "algdiff"), "README.md", "docs", "-n", "auto", "--dist", "loadfile"]
    paths += [f"--ignore={test}" for test in TIMED]
    counted([sys.executable, *pytest, *([] if options.pytest else paths)], "python", PYTHONPATH=str(SITE))
    shares = table("Rust", rust([str(extension), *tests])), table("Python", python())
    return int(min(shares) < options.least)


if __name__ == "__main__":
    sys.exit(main())
