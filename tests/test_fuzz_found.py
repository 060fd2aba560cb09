"""What the fuzz targets have found in what is read: messages that quoted whatever a file holds, of any length."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from algdiff import _formats as formats
from algdiff._formats.base import Options

LONGEST = 500
"""Characters of a message, at most: a path, and what is quoted."""
LINES = "a\x0bb\u2028c\x1dd"
"""A name in four lines."""


def refused(path: Path, options: Options | None = None) -> str:
    """Return why a file is refused, which has to be one short line."""
    with (
        pytest.raises(ValueError, match=r"\S") as caught,
        formats.open_source(formats.located("src", path), options or Options()) as source,
    ):
        source.step_along(source.axis)
    said = str(caught.value)
    assert len(said.splitlines()) == 1, said
    assert len(said) < LONGEST + len(str(path)), said
    return said


@pytest.mark.parametrize("name", [LINES, "x" * 5000])
def test_names_of_columns_are_quoted_in_one_line(tmp_path: Path, name: str) -> None:
    path = tmp_path / "x.csv"
    path.write_text(f'"{name}",b\n1,2\n', encoding="utf-8")
    assert "must name a column" in refused(path, Options(time="t"))
    path.write_text(f'"{name}",b\n2,2\n1,2\n', encoding="utf-8")
    assert "must ascend" in refused(path, Options(time="0"))


def test_fields_of_rows_are_quoted_in_short(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text("1\n" + "y" * 5000 + "\n", encoding="utf-8")
    assert "line 2, column 0 must be a number, got 'yyy" in refused(path)


def test_what_a_broken_zip_file_holds_is_quoted_in_short(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    np.savez(path, x=np.zeros(1000))
    # Another name in the header of the array than in the directory, and one of any length.
    content = bytearray(path.read_bytes())
    content[26:28] = (5000).to_bytes(2, "little")
    path.write_bytes(content)
    assert "not a whole .npz file (File name in directory" in refused(path)


def test_attributes_of_stores_are_quoted_in_short(tmp_path: Path) -> None:
    path = tmp_path / "x.zarr"
    zarr = pytest.importorskip("zarr")
    array = zarr.create_array(path, shape=(4,), dtype="f8", zarr_format=2)
    array[:] = 0.0
    (path / ".zattrs").write_text(json.dumps({"delta": list(range(5000))}), encoding="utf-8")
    assert "its attribute delta must be a number" in refused(path)
