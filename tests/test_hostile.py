"""Files and names made to harm: no code runs, no other file is read or written, and what is shown is text."""

from __future__ import annotations

import html
import os
import pickle
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algdiff
from algdiff._cli import main
from algdiff._designer.answers import Answers
from algdiff._designer.page import document
from algdiff._designer.recording import Recording
from interrupted import small_blocks, stopped
from processes import printed_by

CALL: dict[str, Any] = {"window_length": 21, "engine": "direct", "threads": 1}
X = np.random.default_rng(0).standard_normal(5000)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run in a folder of one's own that holds a recording, `x.npy`."""
    monkeypatch.chdir(tmp_path)
    np.save("x.npy", X)
    return tmp_path


def refused(source: str, target: str = "y.npy", kind: type[Exception] = ValueError, **words: Any) -> str:
    """Return what a run says, in one line, that must not leave anything."""
    before = set(os.listdir())
    with pytest.raises(kind) as caught:
        algdiff.differentiate_file(source, target, **{**CALL, **words})
    assert set(os.listdir()) == before
    assert "\n" not in str(caught.value)
    return str(caught.value)


# --- code --------------------------------------------------------------------------------------------------------


class Sprung:
    """What leaves a folder behind if it is loaded."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("sprung",)


@pytest.mark.parametrize("place", ["array", "field", "bytes"])
def test_no_pickle_is_loaded(place: str, capsys: pytest.CaptureFixture[str]) -> None:
    objects = np.array([Sprung()] * 30, object)
    if place == "field":
        objects = np.array([(Sprung(), 1.0)] * 30, [("a", object), ("b", float)])
    np.save("x.npy", objects, allow_pickle=True)
    if place == "bytes":  # as NumPy itself takes files without its magic
        Path("x.npy").write_bytes(pickle.dumps(Sprung()))
    with zipfile.ZipFile("x.npz", "w") as archive:
        archive.write("x.npy")
    for name in ("x.npy", "x.npz"):
        refused(name)
        assert main(["info", name]) == main(["report", name, "--window", "21"]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 4
    assert set(os.listdir()) == {"x.npy", "x.npz"}


# --- other files -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "inner",
    ["../x", "/../../x", "..", "a/../x", "x\0y", "link", "outside", "parts", "round", "round/x", "x:y", "\ud800"],
)
def test_names_in_hdf5_lead_nowhere_else(inner: str) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File("other.h5", "w") as other:
        other["x"] = X
    Path("other.raw").write_bytes(X.tobytes())
    with h5py.File("x.h5", "w") as file:
        file["a/x"] = X
        file["link"] = h5py.ExternalLink("other.h5", "/x")
        file["round"] = h5py.SoftLink("/round")
        file.create_dataset("outside", X.shape, "f8", external=[("other.raw", 0, X.nbytes)])
        layout = h5py.VirtualLayout(X.shape, "f8")
        layout[:] = h5py.VirtualSource("other.h5", "x", X.shape)
        file.create_virtual_dataset("parts", layout)
    assert refused(f"x.h5:{inner}").startswith("x.h5")


@pytest.mark.parametrize("length", [1, 2, 200])
def test_parts_of_hdf5_that_are_made_of_themselves(length: int) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File("x.h5", "w") as file:
        for index in range(length):
            layout = h5py.VirtualLayout((100,), "f8")
            layout[:] = h5py.VirtualSource(".", f"x{(index + 1) % length}", (100,))
            file.create_virtual_dataset(f"x{index}", layout)
    # In a process of its own: the library follows the parts until its stack is full.
    printed = printed_by("""
        import algdiff

        try:
            algdiff.differentiate_file("x.h5:/x0", "y.npy", 21)
        except ValueError as error:
            print(error)
    """)
    assert printed.startswith("x.h5")
    assert len(printed.splitlines()) == 1


@pytest.mark.parametrize("inner", ["..", "../x", "/../../x.npy", "a/../../x", "x\0", "__x", "zarr.json"])
def test_names_in_zarr_lead_nowhere_else(inner: str) -> None:
    zarr = pytest.importorskip("zarr")
    for name in ("x", "a.zarr", "a.zarr/a"):
        zarr.create_array(name, data=X, overwrite=True)
    for source, target in ((f"a.zarr:{inner}", "y.npy"), ("x.npy", f"b.zarr:{inner}")):
        assert "must have a printable name that is none of Zarr's own" in refused(source, target)
    assert "the suffix of a.zarr/.. must be" in refused("a.zarr/..")


def test_names_in_npz_lead_nowhere_else(here: Path) -> None:
    around = set(os.listdir(here.parent))
    for name in ("../evil", "/evil", "a/../../evil", "..\\evil"):
        with zipfile.ZipFile("x.npz", "w") as archive:
            archive.writestr(f"{name}.npy", Path("x.npy").read_bytes())
        algdiff.differentiate_file("x.npz", "y.npy", **CALL, overwrite=True)
        assert np.load("y.npy").tobytes() == algdiff.differentiate(X, **CALL).tobytes()
        os.remove("y.npy")
        # Nor do they go on to those who unpack the result.
        said = "key must not lead out of the folder that a .npz OUT is unpacked in, got "
        assert refused("x.npz", "y.npz").startswith(said)
        assert refused("x.npy", "y.npz", key=name).startswith(said)
    assert set(os.listdir(here.parent)) == around


@pytest.mark.skipif(os.name == "nt", reason="needs links")
@pytest.mark.parametrize("suffix", [".npy", ".csv", ".npz", ".h5"])
@pytest.mark.parametrize("beside", ["partial", "partial.journal", "partial.encoded"])
def test_links_planted_beside_an_output_are_not_followed(
    suffix: str, beside: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if suffix == ".h5":
        pytest.importorskip("h5py")
    small_blocks(monkeypatch)
    target, link = f"y{suffix}", Path(f"y{suffix}.{beside}")
    for existing in (True, False):  # of an empty folder, and of an interrupted run
        Path("precious").write_bytes(b"precious")
        if not existing:
            stopped("x.npy", target, **CALL)
            link.unlink(missing_ok=True)
        link.symlink_to("precious")
        for words in ({"resume": True}, {"overwrite": True}):
            if beside == "partial.encoded" or not os.path.lexists(link):
                algdiff.differentiate_file("x.npy", target, **CALL, **{**words, "overwrite": True})
                continue
            said = refused("x.npy", target, FileExistsError, **words)
            assert said.endswith(f"{link}: must be free for the unfinished output, got a link")
        assert Path("precious").read_bytes() == b"precious"
        for path in Path().glob("y*"):
            path.unlink()


# --- what is shown -----------------------------------------------------------------------------------------------

SHOWN = (
    "<script>alert(1)</script>",
    "</title><b>",
    "\"'><img src=x onerror=alert(1)>",
    "a\u202etxt",
    "b\u2066c",
    "d\x1b[31m",
)


@pytest.mark.parametrize("name", SHOWN)
def test_names_are_shown_as_text(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    file = f"x{name.replace('/', '')}.csv"
    column = name.replace('"', '""')
    Path(file).write_text(f'"{column}","other"\n' + "".join(f"{a},{b}\n" for a, b in X[:200].reshape(-1, 2)), "utf-8")
    assert main(["info", file]) == 0
    assert main(["run", file, "y.csv", "--window", "21"]) == 0
    assert main(["run", file, "z.csv", "--window", "21", "--columns", "none"]) == 1
    assert main(["report", file, "-o", "x.html", "--window", "21"]) == 0
    printed = "".join(capsys.readouterr())
    page = Path("x.html").read_text("utf-8")
    known = [Recording(*names, X[:200].reshape(2, -1), 1.0) for names in ((file, (name, "z")), ("x", ("y", "z")))]
    live, plain = (document(one, Answers(one).start, "nonce") for one in known)
    for text in (printed, page, live):
        assert not set(text) & {"\x1b", "\u202e", "\u2066"}
    for text in (page, live):
        assert "<img" not in text
        assert "<b>" not in text
    assert live.count("<script") == plain.count("<script")
    assert "<script>alert" not in page
    assert html.escape(re.sub("[\u202e\u2066\x1b]", "\ufffd", name)).replace("&#x27;", "&#39;") in page
