"""Outputs that appear under their names whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
import stat
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from collections.abc import Iterator


def check_output(path: Path, overwrite: bool, *, store: bool = False) -> None:
    """Raise if `path` cannot become an output: a file, or a `store`, which is a folder."""
    if store:
        if path.exists() and not path.is_dir():
            raise FileExistsError(f"{path}: exists and is not a folder: use another name")
        inside = {entry.name for entry in path.iterdir()} if path.is_dir() else set()
        if inside and not inside & {"zarr.json", ".zgroup", ".zarray"}:
            raise FileExistsError(f"{path}: exists and is no Zarr store: use another name")
    elif path.is_dir() or (path.exists() and not stat.S_ISREG(path.stat().st_mode)):
        raise FileExistsError(f"{path}: exists and is not a regular file: use another name")
    if os.path.lexists(path) and not overwrite:
        raise FileExistsError(f"{path}: exists; give overwrite=True to replace it")
    folder = Path(os.path.realpath(path)).parent
    if not folder.is_dir():
        raise FileNotFoundError(f"{path}: its folder does not exist: make it first")
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{path}: its folder cannot be written: use another")


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
        publish(temporary, final, overwrite)
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()


def publish(temporary: Path, final: Path, overwrite: bool) -> None:
    """Give a finished file, or store, its final name; what has that name is replaced only if it may be."""
    if temporary.is_dir():
        _publish_store(temporary, final, overwrite)
    elif overwrite:
        with suppress(FileNotFoundError):
            shutil.copymode(final, temporary)
        os.replace(temporary, final)
    else:
        _rename_to_new(temporary, final)
    sync_folder(final.parent)


def _rename_to_new(temporary: Path, final: Path) -> None:
    """Rename without replacing: a file that appeared under the final name meanwhile stays as it is."""
    try:
        if os.name == "nt":
            os.rename(temporary, final)
            return
        try:
            os.link(temporary, final)
            temporary.unlink()
        except FileNotFoundError:
            raise
        except OSError:  # taken, or no hard links here: claim the name, then replace the claim
            os.close(os.open(final, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
            os.replace(temporary, final)
    except FileExistsError:
        raise FileExistsError(f"{final}: appeared during the run; give overwrite=True to replace it") from None


def _publish_store(temporary: Path, final: Path, overwrite: bool) -> None:
    """Rename a folder; one that is replaced is moved away first, and back if that fails."""
    old = final.parent / f".algdiff-{secrets.token_hex(6)}.old"
    if os.path.lexists(final):
        if not overwrite:
            raise FileExistsError(f"{final}: appeared during the run; give overwrite=True to replace it")
        os.rename(final, old)
    try:
        os.rename(temporary, final)
    except OSError:
        if old.exists():
            os.rename(old, final)
        raise
    remove(old)


def remove(path: Path) -> None:
    """Remove a file or a store, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable, where that can be asked for."""
    if os.name != "nt":
        with suppress(OSError):
            handle = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
