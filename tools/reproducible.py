"""Build the wheel and the source distribution twice, in two folders at two times, and compare them bit by bit.

The sources are copied to folders of different names and depths, are given other times, and are compiled apart. Prints
the digests; if they differ, which files of the archives do, and where they do first. Needs `tools/requirements.txt`;
returns 1 if a byte differs. Takes as long as two installs.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

import sdist
import supply
import wheel

PLACES = {"one": 1_000_000_000, "another/folder-farther-away": 1_500_000_000}  # and when their files were last changed


def built(folder: Path, changed: int) -> dict[str, Path]:
    """Build both distributions from a copy of the tree in a new folder."""
    source = supply.copy_tree(folder / "source")
    for path in source.rglob("*"):
        os.utime(path, (changed, changed))
    env = supply.environment(source, CARGO_TARGET_DIR=str(folder / "target"))
    out = folder / "dist"
    return {"sdist": sdist.build(source, out, env), "wheel": wheel.build(source, out, env)}


def files(path: Path) -> dict[str, tuple[object, bytes]]:
    """Return what an archive holds, with what it says about each file."""
    if path.suffix == ".whl":
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            return {m.filename: ((m.date_time, m.external_attr), archive.read(m)) for m in members}
    with tarfile.open(path) as tar:
        opened = [(member, tar.extractfile(member)) for member in tar.getmembers()]
        return {m.name: ((m.mtime, m.mode, m.uid), file.read() if file else b"") for m, file in opened}


def difference(one: Path, other: Path) -> str:
    """Say in what two archives differ."""
    first, second = files(one), files(other)
    said = [f"only in one: {name}" for name in sorted(first.keys() ^ second.keys())]
    for name in sorted(first.keys() & second.keys()):
        (about, data), (about_other, data_other) = first[name], second[name]
        if about != about_other:
            said.append(f"{name}: {about} and {about_other}")
        if data != data_other:
            pairs = zip(data, data_other, strict=False)
            place = next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(data), len(data_other)))
            begin = max(place - 20, 0)
            said.append(f"{name}: at byte {place}, {data[begin : place + 40]!r} and {data_other[begin : place + 40]!r}")
    return "\n".join(said or ["the same files, in another order or compressed otherwise"])


def main() -> int:
    """Build twice and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, help="keep what was built below this folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="algdiff-reproducible-") as temporary:
        begin = options.keep or Path(temporary)
        one, other = (built(begin / place, changed) for place, changed in PLACES.items())
        different = 0
        for kind, path in one.items():
            digests = [hashlib.sha256(each.read_bytes()).hexdigest() for each in (path, other[kind])]
            same = digests[0] == digests[1]
            different += not same
            print(f"{'ok  ' if same else 'FAIL'} {kind}: {path.name}, sha256 {' and '.join(dict.fromkeys(digests))}")
            if not same:
                print(difference(path, other[kind]))
    return int(bool(different))


if __name__ == "__main__":
    sys.exit(main())
