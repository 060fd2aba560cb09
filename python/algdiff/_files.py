"""Arrays in ``.npy``, ``.npz`` and ``.csv`` files, and outputs that appear whole or not at all."""

from __future__ import annotations

import csv
import os
import secrets
import shutil
import stat
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, BinaryIO, TextIO

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

SUFFIXES = (".npy", ".npz", ".csv")
BLOCK = 1 << 14


@dataclass(frozen=True)
class Table:
    """An array with the labels its file gave it.

    Attributes
    ----------
    array : ndarray
        The samples.
    key : str
        Name inside an ``.npz`` file.
    header : tuple of str or None
        Column names of a ``.csv`` file, None without a header row.
    delimiter : str
        What separates the columns of a ``.csv`` file.
    """

    array: NDArray[Any]
    key: str = "arr_0"
    header: tuple[str, ...] | None = None
    delimiter: str = ","


def suffix(path: Path) -> str:
    """Return the lower-case suffix of `path`, one of `SUFFIXES`."""
    found = path.suffix.lower()
    if found not in SUFFIXES:
        raise ValueError(f"{path}: the suffix must be {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}, got {found!r}")
    return found


def check_output(path: Path, overwrite: bool) -> None:
    """Raise if `path` cannot become an output file."""
    if path.is_dir() or (path.exists() and not stat.S_ISREG(path.stat().st_mode)):
        raise FileExistsError(f"{path}: exists and is not a regular file")
    if os.path.lexists(path) and not overwrite:
        raise FileExistsError(f"{path}: exists; give --overwrite to replace it")
    folder = Path(os.path.realpath(path)).parent
    if not folder.is_dir():
        raise FileNotFoundError(f"{path}: its folder does not exist")
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{path}: its folder cannot be written")


@contextmanager
def replacing(path: Path, overwrite: bool) -> Iterator[BinaryIO]:
    """Open a temporary file that becomes `path` when the block ends, and vanishes when it fails.

    The temporary file lies in the folder of `path`, so that the last step is one rename. A symbolic link is followed.

    Parameters
    ----------
    path : Path
        The final name.
    overwrite : bool
        Whether a file of that name may be replaced.

    Yields
    ------
    file : binary file
        Open for writing.
    """
    final = Path(os.path.realpath(path))
    temporary = final.parent / f".algdiff-{secrets.token_hex(6)}.partial"
    try:
        try:
            with open(temporary, "xb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise OSError(f"{path}: cannot be written ({error.strerror or error})") from None
        if overwrite:
            with suppress(FileNotFoundError):
                shutil.copymode(final, temporary)
            os.replace(temporary, final)
        else:
            _rename_to_new(temporary, final)
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()


def _rename_to_new(temporary: Path, final: Path) -> None:
    """Rename without replacing: a file that appeared under the final name meanwhile stays as it is."""
    try:
        if os.name == "nt":
            os.rename(temporary, final)
            return
        try:
            os.link(temporary, final)
        except OSError:  # taken, or no hard links here: claim the name, then replace the claim
            os.close(os.open(final, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
            os.replace(temporary, final)
    except FileExistsError:
        raise FileExistsError(f"{final}: appeared during the run; give --overwrite to replace it") from None


def read(path: Path, key: str | None = None, columns: Sequence[str] | None = None) -> Table:
    """Read one array of numbers.

    Parameters
    ----------
    path : Path
        A ``.npy``, ``.npz`` or ``.csv`` file.
    key : str, optional
        Name of the array in an ``.npz`` file; needed when the file holds several.
    columns : sequence of str, optional
        Columns of a ``.csv`` file, by header name or by position counted from 0. All by default.

    Returns
    -------
    table : Table
        A ``.csv`` file has time along axis 0; one column gives a one-dimensional array.
    """
    form = suffix(path)
    try:
        if form == ".npy":
            with open(path, "rb") as file:
                table = Table(_read_npy(file, path))
        else:
            table = _read_npz(path, key) if form == ".npz" else _read_csv(path, columns)
    except OSError as error:
        if error.filename is not None:
            raise
        raise OSError(f"{path}: cannot be read ({error.strerror or error})") from None
    if table.array.dtype.kind not in "biufc":
        raise ValueError(f"{path} must hold real or complex numbers, got dtype {table.array.dtype}")
    return table


def _read_npy(file: IO[bytes], where: Path | str) -> NDArray[Any]:
    from tokenize import TokenError

    from numpy.lib import format as npy

    try:
        return npy.read_array(file, allow_pickle=False)  # type: ignore[no-any-return, unused-ignore]
    except (ValueError, EOFError, SyntaxError, TokenError) as error:
        if "Object arrays" in str(error):
            raise ValueError(f"{where} must hold real or complex numbers, got Python objects") from None
        raise ValueError(f"{where}: not a whole .npy array ({error})") from None


def _read_npz(path: Path, key: str | None) -> Table:
    import zipfile
    import zlib

    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
            name = _pick(path, names, key)
            with archive.open(f"{name}.npy") as member:
                return Table(_read_npy(member, f"{path}: array {name!r}"), key=name)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"{path}: not a whole .npz file ({error})") from None


def _pick(path: Path, names: Sequence[str], key: str | None) -> str:
    if key is None and len(names) == 1:
        return names[0]
    if key is None or key not in names:
        got = "nothing" if key is None else repr(key)
        raise ValueError(f"--key must name one array of {path} ({', '.join(names) or 'it has none'}), got {got}")
    return key


def _read_csv(path: Path, columns: Sequence[str] | None) -> Table:
    import warnings

    import numpy as np

    try:
        with open(path, encoding="utf-8-sig", newline="") as file, warnings.catch_warnings():
            delimiter, names = _first_row(file.readline())
            header = None if all(map(_is_number, names)) else names
            warnings.filterwarnings("ignore", message=".*input contained no data")
            try:
                array = np.loadtxt(
                    file if header else _rewound(file), delimiter=delimiter, ndmin=2, comments=None, quotechar='"'
                )
            except ValueError as error:
                raise ValueError(f"{path}: {_fault(_rewound(file), delimiter, header) or error}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not UTF-8 text ({error})") from None
    if array.size == 0:
        raise ValueError(f"{path}: holds no numbers")
    blank = _blank_line(path, array.shape[0] + bool(header))
    if blank is not None:
        raise ValueError(f"{path}: line {blank} must hold numbers, got nothing: a sample is missing there")
    if array.shape[1] != len(names):
        raise ValueError(f"{path}: the rows must have {len(names)} columns as the first, got {array.shape[1]}")
    chosen = _positions(path, header, len(names), columns)
    kept = header and tuple(header[position] for position in chosen)
    return Table(array[:, chosen[0]] if len(chosen) == 1 else array[:, chosen], header=kept, delimiter=delimiter)


def _first_row(line: str) -> tuple[str, tuple[str, ...]]:
    """Return the delimiter, looked for outside quotes, and the fields of the first row."""
    bare = "".join(line.split('"')[::2])
    delimiter = next((mark for mark in "\t;" if mark in bare), ",")
    try:
        fields = next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:  # a field without end, or a carriage return in one: no number, as will be said
        fields = line.split(delimiter)
    return delimiter, tuple(field.strip() for field in fields)


def _rewound(file: TextIO) -> TextIO:
    file.seek(0)
    return file


def _fault(file: TextIO, delimiter: str, header: Sequence[str] | None) -> str | None:
    """Describe the first row that is not made of as many numbers as the rows before it."""
    rows = csv.reader(file, delimiter=delimiter)
    count = len(header) if header else None
    for row in rows:
        if not row or (header and rows.line_num == 1):
            continue
        count = len(row) if count is None else count
        if len(row) != count:
            return f"line {rows.line_num} must have {count} columns as the rows before it, got {len(row)}"
        for position, field in enumerate(row):
            if not _is_number(field):
                return f"line {rows.line_num}, column {position} must be a number, got {field!r}"
    return None


def _blank_line(path: Path, rows: int) -> int | None:
    """Return the number of the first blank line among the first `rows` lines; blank lines at the end do not count."""
    with open(path, encoding="utf-8-sig", newline="") as file:
        for index, line in zip(range(rows), file, strict=False):
            if not line.strip():
                return index + 1
    return None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _positions(path: Path, header: tuple[str, ...] | None, count: int, columns: Sequence[str] | None) -> list[int]:
    if columns is None:
        return list(range(count))
    names = header or ()
    chosen = []
    for column in columns:
        if names.count(column) == 1:
            chosen.append(names.index(column))
        elif column.isdecimal() and int(column) < count:
            chosen.append(int(column))
        else:
            held = f"{', '.join(names)}; or " if names else ""
            raise ValueError(f"--columns must name columns of {path} ({held}0 to {count - 1}), got {column!r}")
    return chosen


def for_csv(array: NDArray[Any], axis: int) -> NDArray[Any]:
    """Return a view of `array` with time along the rows, or raise if a ``.csv`` file cannot hold it."""
    if array.ndim not in (1, 2):
        raise ValueError(f"a .csv OUT must have one or two dimensions, got shape {array.shape}; write .npy or .npz")
    if array.dtype.kind == "c":
        raise ValueError(f"a .csv OUT must hold real numbers, got dtype {array.dtype}; write .npy or .npz")
    if array.ndim == 1:
        return array.reshape(-1, 1)
    return array.T if axis in (1, -1) else array


def write(file: BinaryIO, form: str, table: Table) -> None:
    """Write `table` to an open file.

    Parameters
    ----------
    file : binary file
        Where to write.
    form : str
        One of `SUFFIXES`.
    table : Table
        The samples; for ``.csv`` with time along the rows (`for_csv`).
    """
    import zipfile

    from numpy.lib import format as npy

    if form == ".npy":
        npy.write_array(file, table.array, allow_pickle=False)
    elif form == ".npz":
        with zipfile.ZipFile(file, "w") as archive, archive.open(f"{table.key}.npy", "w", force_zip64=True) as member:
            npy.write_array(member, table.array, allow_pickle=False)
    else:
        _write_csv(file, table)


def _write_csv(file: BinaryIO, table: Table) -> None:
    """Write the shortest decimals that read back as the same numbers."""
    if table.header is not None:
        row = StringIO()
        csv.writer(row, delimiter=table.delimiter, lineterminator="\n").writerow(table.header)
        file.write(row.getvalue().encode())
    number = "{:.9g}".format if table.array.dtype.itemsize < 8 else repr
    for start in range(0, len(table.array), BLOCK):
        rows = table.array[start : start + BLOCK].tolist()
        file.write("".join(table.delimiter.join(map(number, row)) + "\n" for row in rows).encode())
