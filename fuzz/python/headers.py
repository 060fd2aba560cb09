"""Files of any bytes are arrays, or are refused by an error that the documentation names.

The first byte says what the others are read as, and how: ``.npy``, ``.npz``, ``.csv``, raw numbers, ``.wav`` (with
soundfile), or metadata of a Zarr store of either format.
"""

from __future__ import annotations

import io
import json
import math
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import atheris
import numpy as np

with atheris.instrument_imports(include=["algdiff"]):
    from algdiff import _formats as formats
    from algdiff._formats import csv, nodes, npy, npz, raw, steps  # noqa: F401
    from algdiff._formats.base import Options, Source

    try:
        from algdiff._formats import audio
    except ImportError:
        audio = None
from common import main, only

LARGE = 1 << 20
"""Bytes of an array that is read whole."""
FOLDER = Path(tempfile.mkdtemp())
STORE = FOLDER / "x.zarr"
STORE.mkdir()
SUFFIXES = ("npy", "npz", "csv", "raw", "wav", "zarr.json", ".zarray", ".zattrs")
DTYPES = ("<f8", ">f4", "<i2", "u1", "<c16", "?", "<f2", "V8", "S3", "<M8[s]")
COLUMNS = (None, None, ("0",), ("a",), ("1", "0"), ("a", "b"), ("-1",), ())
TIMES = (None, None, "0", "t", "1")


def one(data: bytes) -> None:
    """Read a file."""
    if not data:
        return
    how, rest = divmod(data[0], len(SUFFIXES))
    suffix = SUFFIXES[rest]
    if suffix.startswith(("zarr", ".z")):
        store(suffix, data[1:])
        return
    # What libsndfile would take for something else goes to decoders that speak on stderr, and lose memory.
    if suffix == "wav" and (audio is None or data[1:5] not in (b"RIFF", b"RIFX", b"RF64", b"riff", b"fLaC")):
        return
    path = FOLDER / f"x.{suffix}"
    path.write_bytes(data[1:])
    options = Options(memory=LARGE)
    if suffix == "npz":
        options = Options(key=(None, "x")[how % 2], memory=LARGE)
    elif suffix == "csv":
        options = Options(columns=COLUMNS[how % 8], time=TIMES[how // 8 % 5], memory=LARGE)
    elif suffix == "raw":
        options = Options(dtype=np.dtype(DTYPES[how % 10]), channels=(None, 1, 2)[how // 10 % 3], offset=how % 3)
    with only(ValueError, OSError), formats.open_source(formats.located("src", path), options) as source:
        read(source)


def read(source: Source) -> None:
    """Read an array that is open, or the start of a large one."""
    shape, dtype = source.shape, source.dtype
    assert dtype.kind in "biufc"
    assert all(isinstance(extent, int) and extent >= 0 for extent in shape)
    step = source.step_along(source.axis) if shape else None
    assert step is None or (math.isfinite(step) and step > 0), step
    whole = math.prod(shape) * dtype.itemsize <= LARGE
    place = tuple(slice(0, extent if whole else min(extent, 2)) for extent in shape)
    out: Any = np.empty([one.stop for one in place], dtype, order="F" if source.fortran else "C")
    times = source.read(place, out)
    assert times is None or (source.time is not None and times.shape == shape[:1])


def store(name: str, data: bytes) -> None:
    """Read the metadata of a store; attributes stand beside an array that is whole."""
    for other in nodes.FILES:
        (STORE / other).unlink(missing_ok=True)
    if name == ".zattrs":
        (STORE / ".zarray").write_bytes(json.dumps({"dtype": "<f8"}).encode())
    (STORE / name).write_bytes(data)
    with only(ValueError, OSError):
        node = nodes.node(STORE)
        assert node is not None
        if node.array and node.numeric:
            assert node.dtype is not None
            steps.check_packed(str(STORE), node.attributes, node.dtype)
            steps.stated(str(STORE), node.attributes)
    with only(ValueError, OSError):
        nodes.only(STORE)


def seeds() -> Sequence[bytes]:
    """Return small whole files."""
    x = np.arange(12.0).reshape(4, 3)
    found: list[tuple[int, bytes]] = []
    for array in (x, np.asfortranarray(x.astype(">f4")), np.arange(5, dtype=np.int16), np.ones((2, 0, 3), complex)):
        file = io.BytesIO()
        np.save(file, array)
        found.append((0, file.getvalue()))
    for compress in (np.savez, np.savez_compressed):
        file = io.BytesIO()
        compress(file, x=x)
        found.append((1, file.getvalue()))
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_BZIP2) as archive:
        archive.writestr("x.npy", found[0][1])
    found.append((1 + len(SUFFIXES), file.getvalue()))
    for text in (
        b"t,a,b\n0,1,2\n0.1,3,4\n0.2,5,6\n",
        b"1;2\n3;4\n",
        b'"a"\t"b"\n1e3\tnan\n-inf\t.5\n',
        b"t,a\n2026-01-01T00:00:00Z,1\n2026-01-01T00:00:01+01:00,2\n",
        b"t,a\n2026-01-01 00:00:00.123456789,1\n2026-01-01 00:00:01.123456789,2\n",
        b"\xef\xbb\xbf1,2\r\n3,4\r\n",
    ):
        found += [(2 + len(SUFFIXES) * how, text) for how in (0, 3, 8 * 3, 8 * 2 + 2)]
    found += [(3 + len(SUFFIXES) * how, x.tobytes()) for how in range(10)]
    for width in (2, 4):
        head = b"WAVEfmt " + (16).to_bytes(4, "little") + (1).to_bytes(2, "little") + (1).to_bytes(2, "little")
        rate = (8000).to_bytes(4, "little") + (8000 * width).to_bytes(4, "little") + width.to_bytes(2, "little")
        body = (
            head
            + rate
            + (8 * width).to_bytes(2, "little")
            + b"data"
            + (8 * width).to_bytes(4, "little")
            + bytes(8 * width)
        )
        found.append((4, b"RIFF" + len(body).to_bytes(4, "little") + body))
    three = {
        "zarr_format": 3,
        "node_type": "array",
        "shape": [4],
        "data_type": "float64",
        "codecs": [{"name": "bytes"}],
    }
    three |= {"attributes": {"units": "s", "scale_factor": 2.0, "delta": 0.1}, "dimension_names": ["time"]}
    times = {"name": "numpy.datetime64", "configuration": {"unit": "ns", "scale_factor": 1}}
    found += [(5, json.dumps(one).encode()) for one in (three, three | {"data_type": times}, {"node_type": "group"})]
    two = {
        "zarr_format": 2,
        "shape": [4],
        "chunks": [4],
        "dtype": "<f8",
        "compressor": None,
        "filters": [{"id": "pickle"}],
    }
    found += [(6, json.dumps(two).encode()), (7, b'{"_ARRAY_DIMENSIONS": ["time"], "units": "seconds"}')]
    return [bytes([how]) + content for how, content in found]


if __name__ == "__main__":
    main(one, seeds)
