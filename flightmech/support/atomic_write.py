"""Files and folders that are written atomically: completely or not at all.

What is written first stands next to its destination under a name that begins with a dot and ends in ``.part``; a process that is killed
leaves it behind, where it does no harm and may be deleted.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex


@contextmanager
def written_atomically(path: str | os.PathLike) -> Iterator[Path]:
    """Yield a place next to `path` to write to; it takes the name of `path` once the block has ended well.

    Parameters
    ----------
    path : path
        The file; an older one stays as it was until the new one is complete on disk.

    Raises
    ------
    FileNotFoundError
        Its folder is not there.
    """
    path = Path(path)
    part = _temporary(path)
    try:
        yield part
        _on_disk(part)
        os.replace(part, path)
        _on_disk(path.parent)
    finally:
        part.unlink(missing_ok=True)


def write_text(path: str | os.PathLike, text: str, encoding: str = "utf-8") -> None:
    """Write a text file atomically, with the line ends that the text has; errors as in `written_atomically`."""
    with written_atomically(path) as part:
        part.write_text(text, encoding=encoding, newline="")


@contextmanager
def folder_written_atomically(path: str | os.PathLike) -> Iterator[Path]:
    """Yield a new folder next to `path` to fill; it takes the name of `path` once the block has ended well.

    Parameters
    ----------
    path : path
        The folder; an older one, with all that is in it, stays as it was until the new one is complete on disk, and is then deleted.

    Raises
    ------
    FileNotFoundError
        The folder above it is not there.

    Notes
    -----
    Linux exchanges the two in one step. Elsewhere the older one is first set aside under a name that ends in ``.old.part``.
    """
    path = Path(path)
    part = _temporary(path)
    part.mkdir()
    try:
        yield part
        for item in [*part.rglob("*"), part]:
            _on_disk(item)
        if not path.exists():
            os.replace(part, path)
        elif not _exchanged(part, path):
            aside = part.with_suffix(".old.part")
            os.replace(path, aside)
            try:
                os.replace(part, path)
            except OSError:
                os.replace(aside, path)
                raise
            shutil.rmtree(aside)
        _on_disk(path.parent)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _temporary(path: Path) -> Path:
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder; make it first", str(path.parent))
    return path.with_name(f".{path.name}.{token_hex(4)}.part")


def _on_disk(path: Path) -> None:
    """Have the system write a file, or the names in a folder, to the disk; Windows has no such call for folders."""
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two names in one step; False where the system or the file system cannot."""
    import ctypes
    import sys

    if sys.platform != "linux":
        return False
    rename = getattr(ctypes.CDLL(None), "renameat2", None)
    here, exchange = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of linux/fcntl.h and linux/fs.h
    return rename is not None and rename(here, os.fsencode(one), here, os.fsencode(other), exchange) == 0
