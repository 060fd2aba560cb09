"""``algdiff run``: an output is whole or absent, and what an interrupted run left is gone on with."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import time
import warnings
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import algdiff
from algdiff import _file_job, _file_run, _places
from cli import WINDOW, N, error_line, here, leftovers, process, run, x


@pytest.mark.parametrize(
    ("failure", "code", "message"),
    [
        (
            OSError(errno.ENOSPC, "No space left on device"),
            1,
            "error: y.npy: cannot be written (No space left on device)",
        ),
        (MemoryError("no room"), 1, "error: not enough memory: no room"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
@pytest.mark.parametrize("exists", [False, True])
def test_failure_while_writing(here, x, capsys, monkeypatch, failure, code, message, exists):
    np.save("x.npy", x)
    if exists:
        Path("y.npy").write_bytes(b"precious")

    def fail(_, target, *__):
        target.write((slice(0, 10),), np.zeros((1, 10)))
        assert leftovers(here) == ["y.npy.partial", "y.npy.partial.journal"]
        raise failure

    monkeypatch.setattr(_file_job.Job, "write", fail)
    assert run("x.npy", "y.npy", *["--overwrite"] * exists) == code
    assert capsys.readouterr().err == f"algdiff: {message}\n"
    assert leftovers(here) == []
    assert (Path("y.npy").read_bytes() == b"precious") if exists else not Path("y.npy").exists()


def test_bugs_are_not_hidden(x, monkeypatch):
    np.save("x.npy", x)
    monkeypatch.setattr(_file_job.Job, "write", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run("x.npy", "y.npy")
    assert os.listdir() == ["x.npy"]


@pytest.fixture
def blocks(monkeypatch):
    """Return data of many blocks, each of which is noted in the journal."""
    monkeypatch.setattr(_places, "BLOCK", 1 << 12)
    monkeypatch.setattr(_file_run, "INTERVAL", 0)
    data = np.random.default_rng(5).standard_normal((40, 300)).cumsum(axis=1)
    np.save("x.npy", data)
    return data


@contextmanager
def failing(monkeypatch, error, after=4):
    """Let writing fail after some blocks."""
    genuine, count = _file_job.Job.write, iter(range(after))

    def write(*words):
        if next(count, None) is None:
            raise error
        genuine(*words)

    with monkeypatch.context() as patch:
        patch.setattr(_file_job.Job, "write", write)
        yield


@pytest.mark.parametrize("target", ["y.npy", "deep/y.npy"])
def test_an_interrupted_run_says_what_is_kept_and_goes_on(here, blocks, capsys, monkeypatch, target):
    Path("deep").mkdir()
    with failing(monkeypatch, KeyboardInterrupt()):
        assert run("x.npy", target) == 130
    total = algdiff.differentiate_file("x.npy", "other.npy", WINDOW, dry_run=True).blocks
    said = f"algdiff: interrupted; {400 // total} % of {target} is kept in {target}.partial: go on with --resume\n"
    assert capsys.readouterr().err == said
    assert not Path(target).exists()
    assert run("x.npy", target) == 1
    assert error_line(capsys).endswith(
        "y.npy.partial: left by a run that was stopped; give --resume to go on, --overwrite to begin again"
    )
    assert run("x.npy", target, "--resume") == 0
    assert f"blocks      {total}, of which 4 were finished before\n" in capsys.readouterr().err
    np.testing.assert_array_equal(np.load(target), algdiff.differentiate(blocks, WINDOW))
    assert leftovers(here) == leftovers(here / "deep") == []


@pytest.mark.skipif(os.name == "nt", reason="needs links")
def test_what_is_kept_lies_beside_the_end_of_a_link(here, blocks, capsys, monkeypatch):
    Path("deep").mkdir()
    Path("deep/end.npy").write_bytes(b"old")
    Path("y.npy").symlink_to("deep/end.npy")
    with failing(monkeypatch, KeyboardInterrupt()):
        assert run("x.npy", "y.npy", "--overwrite") == 130
    assert f" of y.npy is kept in {here.resolve()}/deep/end.npy.partial: go on with" in capsys.readouterr().err
    assert run("x.npy", "y.npy", "--resume", "--overwrite") == 0
    assert ", of which 4 were finished before" in capsys.readouterr().err
    np.testing.assert_array_equal(np.load("deep/end.npy"), algdiff.differentiate(blocks, WINDOW))


@pytest.mark.parametrize("flags", [["--resume", "--window", 31], ["--overwrite"]])
def test_what_another_run_left_is_not_believed(here, blocks, capsys, monkeypatch, flags):
    with failing(monkeypatch, KeyboardInterrupt()):
        assert run("x.npy", "y.npy") == 130
    capsys.readouterr()
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert run("x.npy", "y.npy", "-q", *flags) == 0
    err = capsys.readouterr().err
    if "--resume" in flags:
        assert re.fullmatch(r"algdiff: warning: .*y\.npy\.partial: .*design.*: beginning again\n", err)
    else:
        assert err == ""
    np.testing.assert_array_equal(
        np.load("y.npy"), algdiff.differentiate(blocks, 31 if "--resume" in flags else WINDOW)
    )
    assert leftovers(here) == []


def test_a_full_disk_says_what_is_kept(blocks, capsys, monkeypatch):
    with failing(monkeypatch, OSError(errno.ENOSPC, "No space left on device")):
        assert run("x.npy", "y.npy") == 1
    assert error_line(capsys) == (
        "y.npy: cannot be written (No space left on device); what is finished is kept in y.npy.partial: make room and "
        "go on with --resume"
    )
    assert run("x.npy", "y.npy", "--resume", "-q") == 0
    np.testing.assert_array_equal(np.load("y.npy"), algdiff.differentiate(blocks, WINDOW))


@pytest.mark.skipif(os.name == "nt", reason="sends SIGINT")
def test_ctrl_c_in_a_process(here, capsys):
    # Blocks of 1 MiB that take 20 ms at least, so that there is time to send a signal.
    code = """
import sys, time
from algdiff import _cli, _file_job, _file_run, _places
_places.BLOCK, _file_run.INTERVAL = 1 << 20, 0
genuine = _file_job.Job.compute
_file_job.Job.compute = lambda *words: (time.sleep(0.02), genuine(*words))
sys.exit(_cli.main())
"""
    data = np.random.default_rng(6).standard_normal(4_000_000)
    np.save("x.npy", data)
    child = process("run", "x.npy", "y.npy", "--window", WINDOW, code=code)
    deadline, journal = time.monotonic() + 60, Path("y.npy.partial.journal")
    while not (journal.exists() and journal.read_text(encoding="utf-8").count("\n") > 3):
        assert child.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.005)
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=60)
    assert (child.returncode, out) == (130, "")
    assert re.fullmatch(r"algdiff: interrupted; \d+ % of y.npy is kept in y.npy.partial: go on with --resume\n", err)
    assert leftovers(here) == ["y.npy.partial", "y.npy.partial.journal"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_places, "BLOCK", 1 << 20)
        assert run("x.npy", "y.npy", "--resume", "--json") == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert json.loads(out)["resumed"] >= 3
    np.testing.assert_array_equal(np.load("y.npy"), algdiff.differentiate(data, WINDOW))
