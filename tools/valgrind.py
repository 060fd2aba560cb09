"""Run `tools/smoke.py` under valgrind: no wrong access in the extension, by itself or by what it calls.

CPython and the loader have reports of their own, for a fast `strlen` and the like; what counts are those with the
extension among their callers. Returns 1 if there is one.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

EXTENSION = "_core.abi3.so"


def main() -> int:
    """Count the reports."""
    smoke = Path(__file__).with_name("smoke.py")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.xml"
        # glibc's own memory functions: CPython's arenas would hide what leaves a block.
        tool = ["valgrind", "--xml=yes", f"--xml-file={log}", "--leak-check=no", "--num-callers=40"]
        done = subprocess.run(
            [*tool, sys.executable, str(smoke)], check=False, env={**os.environ, "PYTHONMALLOC": "malloc"}
        )
        errors = ElementTree.parse(log).getroot().findall("error")  # noqa: S314 - our own file
    # What is kept until the process ends is reported as a leak; growth is what `tests/test_never_down.py` looks at.
    errors = [error for error in errors if not (error.findtext("kind") or "").startswith("Leak")]
    ours = [error for error in errors if any(EXTENSION in (frame.text or "") for frame in error.iter("obj"))]
    for error in ours:
        said = error.findtext("xwhat/text") or error.findtext("what") or ""
        print(said, *(frame.findtext("fn") or "?" for frame in error.iter("frame")), sep="\n  ")
    print(f"valgrind: {len(errors)} reports, {len(ours)} of them with {EXTENSION} among the callers")
    return int(bool(done.returncode or ours))


if __name__ == "__main__":
    sys.exit(main())
