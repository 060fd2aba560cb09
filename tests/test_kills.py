"""Runs over files that are killed, interrupted, out of room, or robbed of their files: nothing is lost."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff._formats.csv import CsvTarget
from algdiff._formats.regions import InPlace
from interrupted import LEFT, assert_result, small_blocks
from kills import begin, content, kill, noted
from support import soak

KILLS = soak(12, 100)
CALL: dict[str, Any] = {"window_length": 21, "engine": "direct", "threads": 1}
MODULES = {".h5": "h5py", ".zarr": "zarr", ".parquet": "pyarrow"}

pytestmark = pytest.mark.skipif(os.name == "nt", reason="kills and interrupts by signals")


@pytest.fixture(autouse=True)
def x(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> np.ndarray[Any, Any]:
    """Return what `x.npy` holds in a folder of one's own."""
    monkeypatch.chdir(tmp_path)
    small_blocks(monkeypatch)
    x = np.random.default_rng(0).standard_normal(20_000)
    np.save("x.npy", x)
    return x


@pytest.mark.parametrize(("suffix", "kills"), [(".npy", KILLS), *((one, KILLS // 12) for one in (".csv", *MODULES))])
def test_killed_runs_go_on_and_lose_nothing(tmp_path: Path, suffix: str, kills: int) -> None:
    if suffix in MODULES:
        pytest.importorskip(MODULES[suffix])
    hunt = kill(tmp_path, suffix, kills)
    assert hunt.wrong == []
    assert hunt.kills == kills
    assert hunt.resumed > 0


def at(least: float, act: Callable[[], object]) -> Callable[[float], None]:
    """Return a progress that does something once, when so much is done."""
    acts = [act]

    def progress(fraction: float) -> None:
        if fraction >= least and acts:
            acts.pop()()

    return progress


def failing(*args: Any, error: type[BaseException], match: str, **words: Any) -> BaseException:
    """Assert that a run fails with an error of one line."""
    with pytest.raises(error, match=match) as caught:
        algdiff.differentiate_file(*args, **{**CALL, **words})
    assert "\n" not in str(caught.value)
    return caught.value


# Full disks


@pytest.mark.parametrize("suffix", [".npy", ".csv"])
@pytest.mark.parametrize("call", [0, 1, 7, 40])
def test_writes_that_find_no_room(suffix: str, call: int, monkeypatch: pytest.MonkeyPatch) -> None:
    kind: Any = {".npy": InPlace, ".csv": CsvTarget}[suffix]
    algdiff.differentiate_file("x.npy", f"z{suffix}", **CALL)
    write, calls = kind.write, iter(range(call + 1))

    def full(self: Any, *args: Any) -> None:
        if next(calls) == call:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(self, *args)

    target, named = f"y{suffix}", rf"y\{suffix}"
    with monkeypatch.context() as patch:
        patch.setattr(kind, "write", full)
        kept = "$" if call == 0 else f"; what is finished is kept in {named}"
        match = rf"{named}: cannot be written \(No space left on device\){kept}"
        error = failing("x.npy", target, error=OSError, match=match)
    assert isinstance(error, OSError)
    assert error.errno == errno.ENOSPC
    left = {f"{target}.partial", f"{target}.partial.journal"} if call else set()
    assert set(os.listdir()) == {"x.npy", f"z{suffix}", *left}
    assert noted(Path(target)) == call
    assert algdiff.differentiate_file("x.npy", target, **CALL, resume=True).resumed == call
    assert content(Path(target)) == content(Path(f"z{suffix}"))
    assert set(os.listdir()) == {"x.npy", target, f"z{suffix}"}


@pytest.fixture
def small_disk() -> Iterator[Path]:
    """Mount a file system of 4 MiB, which needs root."""
    disk, mount, unmount = Path("disk").resolve(), shutil.which("mount"), shutil.which("umount")
    if sys.platform != "linux" or mount is None or unmount is None:
        pytest.skip("cannot mount here")
    disk.mkdir()
    mounted = subprocess.run(
        [mount, "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(disk)], capture_output=True, check=False
    )
    if mounted.returncode != 0:
        pytest.skip("may not mount here")
    yield disk
    subprocess.run([unmount, "-l", str(disk)], check=True)


def fill(disk: Path) -> None:
    """Take all the room."""
    with suppress(OSError):  # the run may take a part meanwhile
        (disk / "filler").write_bytes(bytes(4 << 20))


FULL = (
    r"{0}: cannot be written \(No space left on device\); what is finished is kept in .*{0}\.partial: "
    r"make room and go on with resume=True$"
)


@pytest.mark.parametrize("suffix", [".npy", ".csv", ".npz", ".parquet"])
def test_a_disk_that_fills_up(small_disk: Path, suffix: str) -> None:
    if suffix in MODULES:
        pytest.importorskip(MODULES[suffix])
    np.save("x.npy", np.random.default_rng(0).standard_normal(70_000))
    algdiff.differentiate_file("x.npy", f"z{suffix}", **CALL)
    target = small_disk / f"y{suffix}"
    progress = at(0.3, lambda: fill(small_disk))
    failing("x.npy", target, progress=progress, error=OSError, match=FULL.format(rf"y\{suffix}"))
    assert set(os.listdir(small_disk)) == {"filler", f"{target.name}.partial", f"{target.name}.partial.journal"}
    # Once more, as long as there is no room: nothing is lost.
    before = noted(target)
    failing("x.npy", target, resume=True, error=OSError, match=FULL.format(rf"y\{suffix}"))
    assert noted(target) >= before > 0
    (small_disk / "filler").unlink()
    assert algdiff.differentiate_file("x.npy", target, **CALL, resume=True).resumed >= before
    assert os.listdir(small_disk) == [target.name]
    assert content(target) == content(Path(f"z{suffix}"))


def command(*arguments: object, code: str | None = None) -> subprocess.Popen[str]:
    """Start the command line in a process that hears Ctrl-C, with blocks that are checkpoints."""
    prepared = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from algdiff import _file_run, _places
from algdiff._cli import main
_places.BLOCK, _file_run.INTERVAL = 1 << 12, 0.0
print("begun", flush=True)
sys.exit(main())
"""
    words = [sys.executable, "-c", prepared if code is None else code, *map(str, arguments)]
    child = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert child.stdout.readline() == "begun\n"
    return child


def test_a_full_disk_on_the_command_line(small_disk: Path) -> None:
    np.save("x.npy", np.random.default_rng(0).standard_normal(100_000))
    algdiff.differentiate_file("x.npy", "z.csv", 21)
    target = small_disk / "y.csv"
    (small_disk / "filler").write_bytes(bytes(3 << 20))  # the size of a text is not known before
    child = command("run", "x.npy", target, "--window", 21)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 1
    (line,) = err.splitlines()
    assert line.startswith(f"algdiff: error: {target}: cannot be written (No space left on device); ")
    assert not target.exists()
    assert noted(target) > 0
    (small_disk / "filler").unlink()
    child = command("run", "x.npy", target, "--window", 21, "--resume")
    assert (child.communicate(timeout=60)[0], child.returncode) == ("", 0)
    assert os.listdir(small_disk) == ["y.csv"]
    assert content(target) == content(Path("z.csv"))


# Files that change or go away


def test_a_folder_that_goes_away(x: np.ndarray[Any, Any]) -> None:
    os.mkdir("far")
    failing(
        "x.npy",
        "far/y.npy",
        progress=at(0.5, lambda: shutil.rmtree("far")),
        error=FileNotFoundError,
        match=r"far/y\.npy: cannot be written \(No such file or directory\)$",  # and nothing is kept
    )
    assert os.listdir() == ["x.npy"]
    os.mkdir("far")
    failing(
        "x.npy",
        "far/y.npy",
        progress=at(0.5, lambda: os.rename("far", "further")),
        error=FileNotFoundError,
        match=r"far/y\.npy: cannot be written \(No such file or directory\)$",
    )
    assert set(os.listdir()) == {"x.npy", "further"}
    os.rename("further", "far")
    assert algdiff.differentiate_file("x.npy", "far/y.npy", **CALL, resume=True).resumed > 0
    assert np.load("far/y.npy").tobytes() == algdiff.differentiate(x, **CALL).tobytes()
    assert os.listdir("far") == ["y.npy"]


def _truncated() -> None:
    os.truncate("x.npy", 40_000)


def _grown() -> None:
    with open("x.npy", "ab") as file:
        file.write(bytes(8))


def _touched() -> None:
    status = os.stat("x.npy")
    os.utime("x.npy", ns=(status.st_atime_ns, status.st_mtime_ns + 1))


def _written() -> None:
    with open("x.npy", "r+b") as file:
        file.seek(-8, os.SEEK_END)
        file.write(b"\xff" * 8)
    _touched()  # even if the clock of the file system is slow


def _replaced() -> None:
    np.save("other.npy", np.zeros(19_000))
    os.replace("other.npy", "x.npy")


@pytest.mark.parametrize("change", [_truncated, _grown, _touched, _written, _replaced])
@pytest.mark.parametrize("when", [0.0, 0.5, 1.0])
def test_an_input_that_changes(change: Callable[[], None], when: float) -> None:
    cut = change is _truncated and when < 1
    said = "ends before the array does: it was cut off, or is being written"
    match = (
        rf"^x\.npy: {said if cut else 'was changed while it was read; nothing was written: run again when it rests'}$"
    )
    failing("x.npy", "y.npy", progress=at(when, change), error=ValueError, match=match)
    assert os.listdir() == ["x.npy"]


def test_an_input_that_goes_away(x: np.ndarray[Any, Any]) -> None:
    failing(
        "x.npy",
        "y.npy",
        progress=at(0.5, lambda: os.rename("x.npy", "z.npy")),
        error=FileNotFoundError,
        match=r"x\.npy",
    )
    os.rename("z.npy", "x.npy")
    assert algdiff.differentiate_file("x.npy", "y.npy", **CALL, resume=True).resumed > 0
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})


def test_an_input_that_changes_before_the_next_run(x: np.ndarray[Any, Any]) -> None:
    def progress(fraction: float) -> None:
        if fraction > 0.5:
            np.save("x.npy", -x)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        algdiff.differentiate_file("x.npy", "y.npy", **CALL, progress=progress)
    with pytest.warns(UserWarning, match="input differ"):
        algdiff.differentiate_file("x.npy", "y.npy", **CALL, resume=True)
    assert_result("y.npy", algdiff.differentiate(-x, **CALL), {"x.npy"})


KINDS: dict[str, Callable[[str], None]] = {
    "a folder": os.mkdir,
    "a device": lambda name: os.symlink("/dev/zero", name),
    "nothing": lambda _: None,
    "a loop": lambda name: os.symlink(name, name),
    "a pipe": os.mkfifo,
}


@pytest.mark.parametrize(
    ("kind", "suffix"), [*((kind, ".npy") for kind in KINDS), ("a device", ".bin"), ("a pipe", ".csv")]
)
def test_inputs_that_are_no_files(kind: str, suffix: str) -> None:
    name = f"input{suffix}"
    KINDS[kind](name)
    code = """
import signal, sys
import algdiff
signal.alarm(20)
print("begun", flush=True)
words = {"dtype": "f8"} if sys.argv[1].endswith("bin") else {}
algdiff.differentiate_file(sys.argv[1], "y.npy", 5, **words)
"""
    child = command(name, code=code)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 1
    last = err.splitlines()[-1]
    assert last.split(":")[0] in ("ValueError", "IsADirectoryError", "FileNotFoundError", "OSError")
    assert name in last
    assert "y.npy" not in os.listdir()


# Ctrl-C


@pytest.mark.parametrize("by_command", [False, True])
def test_ctrl_c_keeps_what_is_finished(tmp_path: Path, by_command: bool) -> None:
    source, target = Path("x.npy").resolve(), Path("y.npy").resolve()
    np.save(source, np.random.default_rng(0).standard_normal(800_000))
    code = ["--window", 4001, "--engine", "direct", "--threads", 1, "--memory", "1MiB"]
    words = [*code, "--resume", "-q"]
    child = command("run", source, target, *words) if by_command else begin(source, target)
    while noted(target) < 3:
        assert child.poll() is None, child.communicate()
        time.sleep(0.01)
    started = time.perf_counter()
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=60)
    # Threads have ended, what was written is noted. The machine may be busy: it is heard within 0.1 s on a quiet one.
    assert time.perf_counter() - started < 1
    assert child.returncode == (130 if by_command else -signal.SIGINT), err
    last = err.splitlines()[-1]
    done = noted(target)
    assert done >= 3
    assert "% of" in last
    if by_command:
        assert last.startswith("algdiff: interrupted; ")
        assert len(err.splitlines()) == 1
    assert set(os.listdir(tmp_path)) == {"x.npy", *LEFT}
    child = begin(source, target)
    out, err = child.communicate(timeout=120)
    assert child.returncode == 0, err
    assert json.loads(out)["resumed"] == done < json.loads(out)["blocks"]
    expected = algdiff.differentiate(np.load(source), window_length=4001, engine="direct")
    assert np.load(target).tobytes() == expected.tobytes()
    assert set(os.listdir(tmp_path)) == {"x.npy", "y.npy"}


@pytest.fixture
def hears_ctrl_c() -> Iterator[None]:
    """Let Ctrl-C be heard, which a background shell may have switched off."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class Pressed(threading.Condition):
    """What threads wait for; once Ctrl-C is pressed where it has just been locked."""

    armed = False

    def __enter__(self) -> bool:
        locked = super().__enter__()
        if Pressed.armed and threading.current_thread() is threading.main_thread():
            Pressed.armed = False
            signal.raise_signal(signal.SIGINT)
        return locked


@pytest.mark.usefixtures("hears_ctrl_c")
@pytest.mark.parametrize("count", [1, 2, 5, 6, 40])
def test_ctrl_c_leaves_nothing_locked(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is heard after the step in which it came: else a thread may wait for ever for what the main one has locked."""
    Pressed.armed, steps = False, iter(range(count, -1, -1))

    def progress(_: float) -> None:
        if next(steps, None) == 0:
            Pressed.armed = True

    before, threads = signal.getsignal(signal.SIGINT), threading.active_count()
    monkeypatch.setattr(threading, "Condition", Pressed)
    with pytest.raises(KeyboardInterrupt, match=r"% of y\.npy is kept in "):
        algdiff.differentiate_file("x.npy", "y.npy", **CALL, progress=progress)
    assert not Pressed.armed
    assert threading.active_count() == threads
    assert signal.getsignal(signal.SIGINT) is before
    done = noted(Path("y.npy"))
    report = algdiff.differentiate_file("x.npy", "y.npy", **CALL, resume=True)
    assert 0 < report.resumed == done < report.blocks


def test_what_ctrl_c_did_before_is_done() -> None:
    """A handler of the caller's own is called after the step, and what it does not raise ends nothing."""
    heard: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    try:
        press = at(0.5, lambda: signal.raise_signal(signal.SIGINT))
        report = algdiff.differentiate_file("x.npy", "y.npy", **CALL, progress=press)
        other = threading.Thread(target=algdiff.differentiate_file, args=("x.npy", "z.npy"), kwargs=CALL)
        other.start()
        other.join()
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [signal.SIGINT]
    assert report.blocks > 1
    assert content(Path("y.npy")) == content(Path("z.npy"))


@pytest.mark.usefixtures("hears_ctrl_c")
def test_the_second_ctrl_c_acts_at_once() -> None:
    def progress(_: float) -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        pytest.fail("the second was not heard")

    with pytest.raises(KeyboardInterrupt):
        algdiff.differentiate_file("x.npy", "y.npy", **CALL, progress=progress)


def test_no_thread_outlives_a_run() -> None:
    before = threading.active_count()
    for when, act in [(2.0, None), (0.5, KeyboardInterrupt), (0.5, ZeroDivisionError)]:

        def progress(fraction: float, when: float = when, act: Any = act) -> None:
            if fraction > when:
                raise act

        try:
            algdiff.differentiate_file("x.npy", "y.npy", **CALL, overwrite=True, progress=progress)
        except (KeyboardInterrupt, ZeroDivisionError) as error:
            assert isinstance(error, act)  # noqa: PT017
        assert threading.active_count() == before
    # What failed for reasons of its own is kept as well.
    assert set(os.listdir()) == {"x.npy", "y.npy", *LEFT}


# Processes and threads


def _one(name: str) -> bytes:
    algdiff.differentiate_file("x.npy", name, **CALL)
    return Path(name).read_bytes()


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_child_can_run_after_its_parent() -> None:
    expected = _one("y.npy")
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map_async(_one, ["a.npy", "b.npy", "c.npy"]).get(timeout=60) == [expected] * 3
    assert _one("d.npy") == expected
    assert set(os.listdir()) == {f"{name}.npy" for name in "xyabcd"}


def test_threads_run_at_once_on_files_of_their_own() -> None:
    expected = _one("y.npy")
    found: dict[str, bytes] = {}
    names = [f"y{index}.npy" for index in range(4)]
    threads = [threading.Thread(target=lambda name=name: found.update({name: _one(name)})) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert found == dict.fromkeys(names, expected)
    assert set(os.listdir()) == {"x.npy", "y.npy", *names}
