"""Build the wheel that is published, and audit it.

On Linux the wheel is linked by Zig against the glibc of 2014 (manylinux_2_17), elsewhere by the machine's own linker.
One wheel serves CPython 3.10 and all later ones (cp310-abi3). Looked at are its name and tags; that it uses the
stable ABI alone; which systems it runs on; what is in it, licences included; and that its bill of materials names
every crate. Needs `tools/requirements.txt`; returns 1 if a step fails.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import json
import re
import sys
import zipfile
from functools import partial
from pathlib import Path

import supply
from supply import FailureError

GLIBC = "2_17"
PLATFORM = f"manylinux_{GLIBC}" if sys.platform == "linux" else ""
LICENCES = {"LICENSE", "LICENSE-APACHE", "LICENSE-MIT", "python/algdiff/data/LICENSE-pendulum_encoder"}
# What is in the package beside its Python modules.
OTHERS = {
    "algdiff/_core.pyi",
    "algdiff/py.typed",
    "algdiff/_designer/designer.css",
    "algdiff/_designer/designer.js",
    "algdiff/data/LICENSE-pendulum_encoder",
    "algdiff/data/README.md",
    "algdiff/data/pendulum_encoder.npz",
}
METADATA = {"METADATA", "RECORD", "WHEEL", "entry_points.txt"}
SBOM = f"sboms/{supply.WHEEL_CRATE}.cyclonedx.json"
MOST = 6_000_000  # bytes


def build(source: Path, out: Path, env: dict[str, str]) -> Path:
    """Build the wheel of a tree into an empty or new folder below `out`, then move it there."""
    there = out / "new"
    options = ["--zig", "--compatibility", f"manylinux_{GLIBC}"] if PLATFORM else []
    maturin = [sys.executable, "-m", "maturin", "build", "--release", *options]
    supply.run(*maturin, "--out", there, cwd=source, env=env)
    (raw,) = there.glob("*.whl")
    wheel = neutral(raw, out / raw.name, source)
    raw.unlink()
    there.rmdir()
    return wheel


def neutral(raw: Path, wheel: Path, source: Path) -> Path:
    """Copy a wheel without the builder's folder in its bill of materials, where references are made of it."""
    with zipfile.ZipFile(raw) as archive:
        members = {member.filename: (member, archive.read(member)) for member in archive.infolist()}
    info = f"algdiff_rs-{supply.version()}.dist-info"
    name, record = f"{info}/{SBOM}", f"{info}/RECORD"
    bill = members[name][1].replace(source.resolve().as_uri().encode(), b"file:///algdiff")
    digest = base64.urlsafe_b64encode(hashlib.sha256(bill).digest()).rstrip(b"=").decode()
    line = f"{name},sha256={digest},{len(bill)}"
    lines = [line if old.startswith(f"{name},") else old for old in members[record][1].decode().splitlines()]
    changed = {name: bill, record: "".join(f"{line}\n" for line in lines).encode()}
    with zipfile.ZipFile(wheel, "w") as archive:
        for member, data in members.values():
            archive.writestr(member, changed.get(member.filename, data), member.compress_type, 9)
    return wheel


def tags(wheel: Path) -> str:
    """Check the name: version, Pythons, platform."""
    begin = f"algdiff_rs-{supply.version()}-cp310-abi3-"
    if not wheel.name.startswith(begin) or PLATFORM not in wheel.name:
        raise FailureError(f"{wheel.name} is not {begin}{PLATFORM or '...'}")
    size = wheel.stat().st_size
    if size > MOST:
        raise FailureError(f"{size:,} bytes, allowed are {MOST:,}")
    return f"{wheel.name}, {size:,} bytes"


def abi(wheel: Path) -> str:
    """Check that only the stable ABI of Python 3.10 is used."""
    said = json.loads(supply.run(sys.executable, "-m", "abi3audit", "--strict", "--report", str(wheel)))
    (result,) = said["specs"].values()
    libraries = [entry["result"] for entry in result["wheel"]]
    if not libraries or any(library["non_abi3_symbols"] or not library["is_abi3"] for library in libraries):
        raise FailureError(json.dumps(libraries, indent=1))
    baselines = {(library["baseline"], library["computed"]) for library in libraries}
    uses = ", ".join(f"promised {promised}, used {used}" for promised, used in sorted(baselines))
    return f"{len(libraries)} library, no symbol beyond the stable ABI ({uses})"


def systems(wheel: Path) -> str:
    """Check the glibc that is needed, and that no other library is."""
    if not PLATFORM:
        return "not Linux, not asked"
    said = " ".join(supply.run(sys.executable, "-m", "auditwheel", "show", str(wheel)).split())
    found = re.search(r'platform tag: "(\w+)"', said)
    if found is None or not found[1].startswith(f"{PLATFORM}_"):
        raise FailureError(said)
    symbols = re.findall(r"GLIBC_([\d.]+)", said)
    newest = max(symbols, key=lambda symbol: [int(part) for part in symbol.split(".")])
    return f"{found[1]}, takes glibc's symbols up to {newest} and no other library's"


def contents(wheel: Path) -> str:
    """Check what is in it: the package as in the sources, the library, its metadata, and nothing else."""
    sources = {path.relative_to(supply.ROOT / "python").as_posix() for path in supply.ROOT.glob("python/**/*.py")}
    info = f"algdiff_rs-{supply.version()}.dist-info"
    metadata = METADATA | {SBOM} | {f"licenses/{name}" for name in LICENCES}
    wanted = sources | OTHERS | {f"{info}/{name}" for name in metadata}
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if not name.endswith("/")}
    library = {name for name in names if re.fullmatch(r"algdiff/_core(\.abi3\.so|\.pyd)", name)}
    surplus, missing = sorted(names - wanted - library), sorted(wanted - names)
    if surplus or missing or len(library) != 1:
        raise FailureError(f"not expected: {surplus}, missing: {missing}, libraries: {sorted(library)}")
    return f"{len(names)} files: {len(sources)} modules, {len(LICENCES)} licences, no tests"


def materials(wheel: Path) -> str:
    """Check that the bill of materials names every crate of the package with its version, and no other."""
    with zipfile.ZipFile(wheel) as archive:
        bill = json.loads(archive.read(f"algdiff_rs-{supply.version()}.dist-info/{SBOM}"))
    parts = [bill["metadata"]["component"], *bill["components"]]
    named = {f"{part['name']} {part['version']}" for part in parts}
    missing = supply.crates(everywhere=False, edges="normal") - named
    unknown = named - supply.locked()
    if missing or unknown:
        raise FailureError(f"missing: {sorted(missing)}, not in Cargo.lock: {sorted(unknown)}")
    return f"{bill['bomFormat']} {bill['specVersion']}, {len(named)} crates, all of those compiled among them"


def paths(wheel: Path) -> str:
    """Check that nothing in it tells where it was built."""
    places = [str(place).encode() for place in (Path.home(), supply.ROOT) if len(str(place)) > 1]
    with zipfile.ZipFile(wheel) as archive:
        told = [name for name in archive.namelist() if any(place in archive.read(name) for place in places)]
    if told:
        raise FailureError(f"the builder's folders are named in {', '.join(told)}")
    return "none of the builder's"


def tag(name: str, _: Path) -> str:
    """Check that a tag is the version's, and that the changelog has a dated section for it."""
    version = supply.version()
    if name != f"v{version}":
        raise FailureError(f"{name} is not v{version}, the version in Cargo.toml")
    changelog = (supply.ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    if not re.search(rf"^## {re.escape(version)} \(\d{{4}}-\d\d-\d\d\)$", changelog, re.MULTILINE):
        raise FailureError(f"CHANGELOG.md has no section ## {version} with a date")
    return f"{name}, with its section in the changelog"


CHECKS = {"wheel": tags, "ABI": abi, "systems": systems, "contents": contents, "materials": materials, "paths": paths}


def main() -> int:
    """Build and audit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=supply.ROOT / "dist", help="folder for it (default dist/)")
    parser.add_argument("--audit", type=Path, metavar="WHEEL", help="do not build, audit this one")
    parser.add_argument("--tag", help="the tag that is released, which must be the version's")
    options = parser.parse_args()
    wheel = options.audit or build(supply.ROOT, options.out, supply.environment())
    checks = CHECKS | ({"tag": partial(tag, options.tag)} if options.tag else {})
    return supply.steps({name: partial(check, wheel) for name, check in checks.items()})


if __name__ == "__main__":
    sys.exit(main())
