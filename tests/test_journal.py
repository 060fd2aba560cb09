"""Interrupted runs: what they leave is gone on with if it is of the same run, and only then."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import threading
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff import _places
from algdiff._journal import Journal
from interrupted import LEFT, assert_result, small_blocks, stop_at, stopped

CALL: dict[str, Any] = {"window_length": 21, "engine": "direct", "threads": 1}
JOURNAL, PARTIAL = Path("y.npy.partial.journal"), Path("y.npy.partial")


@pytest.fixture(autouse=True)
def x(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> np.ndarray[Any, Any]:
    """Return what `x.npy` holds in a folder of one's own."""
    monkeypatch.chdir(tmp_path)
    small_blocks(monkeypatch)
    x = np.random.default_rng(0).standard_normal((2, 2000))
    np.save("x.npy", x)
    return x


def again(**words: Any) -> algdiff.FileReport:
    """Go on with what is left."""
    return algdiff.differentiate_file("x.npy", "y.npy", **{**CALL, "resume": True, **words})


def begins_again(said: str, **words: Any) -> None:
    """Assert that what is left is not believed, and that the result is right nevertheless."""
    with pytest.warns(UserWarning, match=f"^{re.escape(os.path.realpath(PARTIAL))}: .*{said}.*: beginning again$"):
        report = again(**words)
    assert report.resumed == 0
    wish = {**CALL, **{name: value for name, value in words.items() if name != "memory"}}
    assert_result("y.npy", algdiff.differentiate(np.load("x.npy"), **wish), {"x.npy"})


@pytest.mark.parametrize("at", [0.1, 0.5, 0.9])
def test_a_run_goes_on_where_it_was_stopped(x: np.ndarray[Any, Any], at: float) -> None:
    stopped("x.npy", "y.npy", **CALL, at=at)
    assert set(os.listdir()) == {"x.npy", *LEFT}
    done = int(JOURNAL.read_text().splitlines()[-1].split()[0])
    seen: list[float] = []
    report = again(progress=seen.append, threads=2)
    assert report.resumed == done > 0
    # The last blocks may have been computed, but not written.
    assert at - 3 / report.blocks <= done / report.blocks <= at
    assert min(seen) >= done / report.blocks
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})


def test_a_run_can_be_stopped_again_and_again(x: np.ndarray[Any, Any]) -> None:
    stopped("x.npy", "y.npy", **CALL, at=0.2)
    before = 0
    for at in [0.3, 0.6, 0.8, 0.95]:
        stopped("x.npy", "y.npy", **CALL, at=at, resume=True)
        done = int(JOURNAL.read_text().splitlines()[-1].split()[0])
        assert done > before
        before = done
    assert again().resumed == before
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})


def test_what_was_stopped_before_the_first_block_leaves_nothing() -> None:
    with pytest.raises(KeyboardInterrupt):
        algdiff.differentiate_file("x.npy", "y.npy", **CALL, progress=stop_at(0))
    assert os.listdir() == ["x.npy"]


def test_nothing_left_is_no_reason_to_complain(x: np.ndarray[Any, Any]) -> None:
    assert again().resumed == 0
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})
    with pytest.raises(FileExistsError, match=r"^y\.npy: exists; give overwrite=True to replace it$"):
        again()
    assert again(overwrite=True).resumed == 0


@pytest.mark.parametrize(
    "words",
    [
        {"window_length": 23},
        {"deriv": 0},
        {"deriv": (1,)},
        {"degree": 4},
        {"kappa": 0.0},
        {"mu": 2.0},
        {"tau": 0.75},
        {"delta": 0.5},
        {"delta": 1.0},
        {"rule": "trapezoid"},
        {"trim": 0.01},
        {"engine": "fft"},
        {"mode": "mirror"},
        {"nan_policy": "omit"},
        {"mode": "constant", "cval": 1.0},
    ],
    ids=str,
)
def test_another_design_or_call_begins_again(words: dict[str, Any]) -> None:
    stopped("x.npy", "y.npy", **CALL)
    if words.get("engine") == "fft":  # which has another grid, and agrees to rounding only
        with pytest.warns(UserWarning, match="blocks, design differ"):
            assert again(**words).resumed == 0
        return
    begins_again("(design|call).* differ", **words)


def test_another_axis_begins_again() -> None:
    square = np.random.default_rng(1).standard_normal((60, 60))
    np.save("x.npy", square)
    stopped("x.npy", "y.npy", **CALL, axis=0)
    begins_again("call.* differ", axis=1)


def test_other_constants_beyond_the_data_begin_again() -> None:
    stopped("x.npy", "y.npy", **CALL, mode="constant", cval=1.0)
    begins_again("call differ", mode="constant", cval=2.0)


def test_other_blocks_begin_again(monkeypatch: pytest.MonkeyPatch) -> None:
    stopped("x.npy", "y.npy", **CALL)
    monkeypatch.setattr(_places, "BLOCK", 1 << 15)
    begins_again("blocks differ")


def test_another_version_begins_again(monkeypatch: pytest.MonkeyPatch) -> None:
    stopped("x.npy", "y.npy", **CALL)
    monkeypatch.setattr(metadata, "version", lambda _: "0.0.0")
    begins_again("version differ")


def test_another_input_begins_again(x: np.ndarray[Any, Any]) -> None:
    stopped("x.npy", "y.npy", **CALL)
    status = os.stat("x.npy")
    os.utime("x.npy", ns=(status.st_atime_ns, status.st_mtime_ns + 1))
    begins_again("input differ")
    os.remove("y.npy")

    stopped("x.npy", "y.npy", **CALL)
    status = os.stat("x.npy")
    with open("x.npy", "ab") as file:  # beyond what the array needs
        file.write(b"\0")
    os.utime("x.npy", ns=(status.st_atime_ns, status.st_mtime_ns))
    begins_again("input differ")
    os.remove("y.npy")

    stopped("x.npy", "y.npy", **CALL)
    np.save("x.npy", x[::-1])
    begins_again("input differ")
    os.remove("y.npy")

    stopped("x.npy", "y.npy", **CALL)
    os.rename("x.npy", "z.npy")  # with its size and its time
    with pytest.warns(UserWarning, match="input differ"):
        assert algdiff.differentiate_file("z.npy", "y.npy", **CALL, resume=True).resumed == 0
    assert_result("y.npy", algdiff.differentiate(x[::-1], **CALL), {"z.npy"})


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"dtype": "<f4"}, {"dtype": ">f4"}),
        ({"dtype": "<i4"}, {"dtype": "<f4"}),
        ({"dtype": "<i2", "channels": 2}, {"dtype": "<i2", "channels": 4}),
        ({"dtype": "<i2", "channels": 2}, {"dtype": "<i2", "channels": 2, "offset": 4}),
    ],
)
def test_raw_numbers_read_otherwise_begin_again(one: dict[str, Any], other: dict[str, Any]) -> None:
    np.arange(8000, dtype="<i4").tofile("x.bin")
    stopped("x.bin", "y.npy", **CALL, **one)
    with pytest.warns(UserWarning, match=r"reading.* differ"):
        assert algdiff.differentiate_file("x.bin", "y.npy", **CALL, **other, resume=True).resumed == 0
    found = np.load("y.npy")
    os.remove("y.npy")
    algdiff.differentiate_file("x.bin", "y.npy", **CALL, **other)
    assert found.tobytes() == np.load("y.npy").tobytes()


def test_other_columns_begin_again(x: np.ndarray[Any, Any]) -> None:
    np.savetxt("x.csv", x.T, delimiter=",")
    stopped("x.csv", "y.npy", **CALL, columns=[0])
    with pytest.warns(UserWarning, match="reading differ"):
        assert algdiff.differentiate_file("x.csv", "y.npy", **CALL, columns=[1], resume=True).resumed == 0
    assert np.load("y.npy").tobytes() == algdiff.differentiate(x[1], **CALL).tobytes()


def test_another_array_in_the_file_begins_again(x: np.ndarray[Any, Any]) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File("x.h5", "w") as file:
        file["a"], file["b"] = x, x[::-1]
    stopped("x.h5:/a", "y.npy", **CALL)
    with pytest.warns(UserWarning, match="reading differ"):
        assert algdiff.differentiate_file("x.h5:/b", "y.npy", **CALL, resume=True).resumed == 0
    assert np.load("y.npy").tobytes() == algdiff.differentiate(x[::-1], **CALL).tobytes()


def test_what_makes_no_difference_is_believed(x: np.ndarray[Any, Any], tmp_path: Path) -> None:
    stopped("x.npy", "y.npy", **CALL)
    words = {**CALL, "window_length": np.int8(21), "kappa": np.float32(1), "threads": 3, "memory": 1 << 28, "mu": 1}
    os.symlink("x.npy", "link.npy")
    report = algdiff.differentiate_file(tmp_path / "link.npy", tmp_path / "y.npy", **words, resume=True, axis=-1)
    assert report.resumed > 0
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy", "link.npy"})


def test_lines_that_were_cut_off_do_not_count(x: np.ndarray[Any, Any]) -> None:
    stopped("x.npy", "y.npy", **CALL)
    journal, partial = JOURNAL.read_bytes(), PARTIAL.read_bytes()
    header = journal.index(b"\n") + 1
    # Within the last two lines, and around the first.
    torn = [*range(len(journal) - 20, len(journal)), header - 1, header, header + 1, 0]
    for end in torn:
        JOURNAL.write_bytes(journal[:end])
        # What a crash may have left of blocks that were not noted.
        lines = journal[:end].count(b"\n") - 1
        PARTIAL.write_bytes(partial)
        if end >= header - 1:  # the line is whole, but for its end
            report = again()
            assert report.resumed == max(lines, 0)
            assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})
        else:
            begins_again("its journal cannot be read")
        os.remove("y.npy")


def _swapped(journal: bytes) -> bytes:
    *lines, one, other, end = journal.split(b"\n")
    return b"\n".join([*lines, other, one, end])


@pytest.mark.parametrize(
    "spoil",
    [
        lambda _: b"",
        lambda _: b"\n",
        lambda _: bytes(5000),
        lambda _: np.random.default_rng(0).bytes(5000),
        lambda journal: b"\xff" + journal,
        lambda journal: journal.split(b"\n")[0] + b"\nword\n",
        lambda journal: journal + b"\xff\xfe\n",
        lambda journal: journal + b"\n",
        lambda journal: journal + b"17\n",
        lambda journal: journal + b"999999 0 0\n",
        lambda journal: journal + b"1 0 0\n",
        lambda journal: journal + b"-1 0 0\n",
        _swapped,
    ],
)
def test_garbage_is_not_believed(spoil: Any) -> None:
    stopped("x.npy", "y.npy", **CALL)
    JOURNAL.write_bytes(spoil(JOURNAL.read_bytes()))
    begins_again("its journal cannot be read")


def test_another_header_is_not_believed() -> None:
    stopped("x.npy", "y.npy", **CALL)
    first, rest = JOURNAL.read_text().split("\n", 1)
    header = json.loads(first)
    del header["version"]
    for said, line in [("version differ", json.dumps(header)), ("made by another run", first + " "), ("read", "[]")]:
        JOURNAL.write_text(f"{line}\n{rest}")
        PARTIAL.write_bytes(bytes(40_000))
        begins_again(said)
        os.remove("y.npy")


def test_bytes_after_the_last_line_are_written_over(x: np.ndarray[Any, Any]) -> None:
    stopped("x.npy", "y.npy", **CALL, at=0.3)
    with JOURNAL.open("ab") as file:
        file.write(bytes(300))
    stopped("x.npy", "y.npy", **CALL, resume=True, at=0.8)
    assert again().resumed > 0
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})


def test_an_output_shorter_than_was_noted_is_not_believed() -> None:
    stopped("x.npy", "y.npy", **CALL)
    os.truncate(PARTIAL, os.stat(PARTIAL).st_size - 1)
    begins_again("is shorter than its journal says")


@pytest.mark.parametrize("resume", [False, True])
def test_a_journal_alone_says_nothing(x: np.ndarray[Any, Any], resume: bool) -> None:
    stopped("x.npy", "y.npy", **CALL)
    PARTIAL.unlink()
    assert again(resume=resume).resumed == 0
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})


def test_an_output_without_a_journal_is_not_believed() -> None:
    stopped("x.npy", "y.npy", **CALL)
    JOURNAL.unlink()
    begins_again("its journal cannot be read")


@pytest.mark.parametrize("journal", [False, True])
def test_leftovers_are_not_touched_unasked(journal: bool) -> None:
    stopped("x.npy", "y.npy", **CALL)
    if not journal:
        JOURNAL.unlink()
    before = {name: Path(name).read_bytes() for name in os.listdir()}
    said = "y.npy.partial: left by a run that was stopped; give resume=True to go on, overwrite=True to begin again"
    with pytest.raises(FileExistsError, match=f"{re.escape(said)}$"):
        again(resume=False)
    assert {name: Path(name).read_bytes() for name in os.listdir()} == before


def test_overwriting_begins_again_and_replaces(x: np.ndarray[Any, Any]) -> None:
    np.save("y.npy", np.zeros(3))
    os.chmod("y.npy", 0o640)
    stopped("x.npy", "y.npy", **CALL, overwrite=True)
    assert np.load("y.npy").tobytes() == bytes(24)
    assert again(resume=False, overwrite=True).resumed == 0
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})
    assert os.stat("y.npy").st_mode & 0o777 == 0o640

    stopped("x.npy", "y.npy", **CALL, overwrite=True)
    assert again(overwrite=True).resumed > 0
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})


def test_of_two_runs_at_once_the_second_is_refused(x: np.ndarray[Any, Any]) -> None:
    begun, go_on = threading.Event(), threading.Event()

    def progress(fraction: float) -> None:
        if fraction > 0.5:
            begun.set()
            assert go_on.wait(60)

    first = threading.Thread(target=again, kwargs={"resume": False, "progress": progress})
    first.start()
    try:
        assert begun.wait(60)
        for words in [{"resume": True}, {"resume": False}, {"resume": False, "overwrite": True}]:
            with pytest.raises(BlockingIOError, match=r"y\.npy\.partial: is being written by another run: wait"):
                again(**words)
            assert set(os.listdir()) == {"x.npy", *LEFT}
    finally:
        go_on.set()
        first.join()
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})


def test_a_run_that_ends_while_another_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    # The journal that was opened is locked when its run has taken it away: it is not the one that others will find.
    stopped("x.npy", "y.npy", **CALL)
    lock, left = Journal._lock, [True]

    def late(self: Journal) -> None:
        if left.pop() if left else False:
            PARTIAL.unlink()
            JOURNAL.unlink()
        lock(self)

    monkeypatch.setattr(Journal, "_lock", late)
    journal = Journal(Path("y.npy.partial"), {"blocks": [[1], 9]}, resume=True, overwrite=False)
    assert os.path.samestat(os.fstat(journal.file.fileno()), JOURNAL.stat())
    assert journal.done == 0
    journal.remove()
    assert os.listdir() == ["x.npy"]


def test_without_locks_a_run_goes_ahead(x: np.ndarray[Any, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    fcntl = pytest.importorskip("fcntl")

    def flock(*_: Any) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", flock)
    assert again().resumed == 0
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})


def test_a_link_is_followed(x: np.ndarray[Any, Any]) -> None:
    os.mkdir("far")
    np.save("far/real.npy", np.zeros(3))
    os.symlink("far/real.npy", "y.npy")
    with pytest.raises(KeyboardInterrupt, match=r"y\.npy is kept in .*far/real\.npy\.partial: go on"):
        again(overwrite=True, progress=stop_at(0.5))
    assert set(os.listdir("far")) == {"real.npy", "real.npy.partial", "real.npy.partial.journal"}
    assert set(os.listdir()) == {"x.npy", "y.npy", "far"}
    assert again(overwrite=True).resumed > 0
    assert os.readlink("y.npy") == "far/real.npy"
    assert os.listdir("far") == ["real.npy"]
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy", "far"})


def test_a_link_to_nothing_is_followed_if_it_may_be(x: np.ndarray[Any, Any]) -> None:
    os.symlink("real.npy", "y.npy")
    with pytest.raises(FileExistsError, match=r"^y\.npy: exists"):
        again()
    again(overwrite=True)
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy", "real.npy"})


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_folders_that_cannot_be_written() -> None:
    os.mkdir("far", 0o500)
    with pytest.raises(PermissionError, match=r"^far/y\.npy: its folder cannot be written: use another$"):
        algdiff.differentiate_file("x.npy", "far/y.npy", **CALL)


def test_outputs_of_impossible_names() -> None:
    os.mkdir("y.npy")
    with pytest.raises(FileExistsError, match=r"^y\.npy: exists and is not a regular file: use another name$"):
        again(overwrite=True)
    with pytest.raises(FileNotFoundError, match=r"^far/y\.npy: its folder does not exist: make it first$"):
        algdiff.differentiate_file("x.npy", "far/y.npy", **CALL)
    with pytest.raises(FileNotFoundError, match=r"^x\.npy/y\.npy: its folder does not exist: make it first$"):
        algdiff.differentiate_file("x.npy", "x.npy/y.npy", **CALL)
    name = "y" * 240 + ".npy"  # which leaves no room for more
    with pytest.raises(OSError, match=rf"{name}: cannot be written \(File name too long\)$"):
        algdiff.differentiate_file("x.npy", name, **CALL)
    os.rmdir("y.npy")
    assert os.listdir() == ["x.npy"]


def test_an_output_that_appears_meanwhile_is_not_replaced(x: np.ndarray[Any, Any]) -> None:
    said = r"y\.npy: appeared during the run; give overwrite=True to replace it; what is finished is kept in y\.npy\."
    with pytest.raises(FileExistsError, match=said):
        again(progress=lambda _: Path("y.npy").write_bytes(b"mine"))
    assert Path("y.npy").read_bytes() == b"mine"
    assert set(os.listdir()) == {"x.npy", "y.npy", *LEFT}
    report = again(overwrite=True)
    assert report.resumed == report.blocks
    assert_result("y.npy", algdiff.differentiate(x, **CALL), {"x.npy"})


class Full:
    """A file on a disk that is full when so many bytes are written."""

    def __init__(self, file: Any, room: int) -> None:
        self.file, self.room = file, room

    def write(self, data: bytes) -> int:
        """Write a part, as the system does, or fail."""
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count = self.file.write(data[: self.room])
        self.room -= count
        return int(count)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)


@pytest.mark.parametrize("room", range(7))
def test_notes_that_find_no_room(room: int) -> None:
    header = {"blocks": [[1], 2000]}
    PARTIAL.touch()
    journal = Journal(PARTIAL, header, resume=False, overwrite=True)
    PARTIAL.touch()
    journal.note(9, 0)
    file = journal.file
    journal.file = Full(file, room)  # type: ignore[assignment]
    if room < 6:
        with pytest.raises(OSError, match="No space left"):
            journal.note(10, 0)
        assert journal.done == 9
    journal.file = file
    journal.note(11, 0)
    journal.close()
    back = Journal(PARTIAL, header, resume=True, overwrite=False)
    assert (back.done, back.mark) == (11, 0)
    back.close()


def test_a_disk_full_at_the_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Journal, "_append", full)
    with pytest.raises(OSError, match=r"y\.npy: cannot be written \(No space left on device\)$"):
        again()
    assert os.listdir() == ["x.npy"]


def test_copies_of_a_stopped_run_are_of_another_input(tmp_path: Path) -> None:
    stopped("x.npy", "y.npy", **CALL)
    shutil.copytree(tmp_path, tmp_path / "copy")
    with pytest.warns(UserWarning, match="input differ"):
        algdiff.differentiate_file("copy/x.npy", "copy/y.npy", **CALL, resume=True)
    assert again().resumed > 0
