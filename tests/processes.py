"""Code run in a process of its own, and how soon Ctrl-C is heard there."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from typing import Any

PREPARED = """
import os, signal, threading, time
import numpy as np
import algdiff

signal.signal(signal.SIGINT, signal.default_int_handler)  # which a background shell may have switched off

def direct(window_length):
    return algdiff.Differentiator(window_length, engine="direct")

def interrupt():
    global sent
    time.sleep(0.05)
    sent = time.perf_counter()
    os.kill(os.getpid(), signal.SIGINT)

"""
"""What code finds that is to be interrupted: it starts a thread with `interrupt`, and prints the time since `sent`."""


def run_python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run `code`, whatever comes of it."""
    command = [sys.executable, "-c", textwrap.dedent(code)]
    options: dict[str, Any] = {"capture_output": True, "text": True, "timeout": 120}
    return subprocess.run(command, env={**os.environ, **environment}, check=False, **options)


def printed_by(code: str, **environment: str) -> str:
    """Return what `code` prints, which must not fail."""
    result = run_python(code, **environment)
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


def assert_ctrl_c_is_heard(code: str) -> None:
    """Let `code`, prepared, be interrupted: it is heard within a quarter of a second."""
    # The machine may be busy: the best of three tries counts.
    latencies = []
    for _ in range(3):
        printed = printed_by(PREPARED + textwrap.dedent(code))
        assert printed != "finished", "the call was too short to be interrupted"
        latencies.append(float(printed))
        if latencies[-1] <= 0.25:
            break
    assert min(latencies) <= 0.25, latencies
