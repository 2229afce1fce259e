"""Files and folders that are written atomically: completely or not at all.

What is written first stands next to its destination under a name that begins with a dot and ends in
``.part``; what a killed process left there does no harm, and the next writing to the same
destination removes it.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import os
import re
import shutil
import socket
import stat
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path


def temporary_name(prefix: str, ending: str = "part") -> str:
    """Return a name that no other process and no other call has.

    Examples
    --------
    >>> temporary_name("a.nc") == temporary_name("a.nc")
    False
    """
    return f"{prefix}.{_machine()}-{os.getpid()}-{os.urandom(4).hex()}.{ending}"


_NUMBERS = re.compile(r"(\d+)-[0-9a-f]{8}")


def find_leftovers(folder: Path, prefix: str, ending: str = "part") -> Iterator[Path]:
    """Yield what processes that have ended left in a folder under names of `temporary_name`."""
    start, end = f"{prefix}.{_machine()}-", f".{ending}"
    for item in _names(folder):
        if item.startswith(start) and item.endswith(end):
            match = _NUMBERS.fullmatch(item, len(start), len(item) - len(end))
            if match and not _runs(int(match[1])):
                yield folder / item


def remove_leftovers(folder: Path, prefix: str, ending: str = "part") -> None:
    """Remove files and folders that processes that have ended left; what cannot be removed stays."""

    for path in find_leftovers(folder, prefix, ending):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink()


def _names(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _runs(process: int) -> bool:
    """Whether a process may still be at work; on Windows, where asking would end it, always."""
    if os.name == "nt":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


@cache
def _machine() -> str:

    space = ""
    with suppress(OSError):
        space = os.readlink("/proc/self/ns/pid")
    return hashlib.sha256(f"{socket.gethostname()} {space}".encode()).hexdigest()[:8]


_FULL = tuple(
    number
    for name in ("ENOSPC", "EDQUOT", "EFBIG", "EIO")
    if (number := getattr(errno, name, None)) is not None
)
_one_at_a_time = threading.RLock()
_AT_ONCE = 8  # files of a folder that wait for the disk together


@contextmanager
def written_atomically(
    path: str | os.PathLike, before: Callable[[Path], None] | None = None, durable: bool = True
) -> Iterator[Path]:
    """Yield a place next to `path` to write to; it takes the name of `path` once the block has
    ended well.

    Parameters
    ----------
    path : path
        The file; an older one stays as it was until the new one is complete on disk, and gives it
        its permissions.  Of a symbolic link the target is written; the link stays.
    before : callable, optional
        Called with the file just before it is replaced, while no other process of this package
        replaces a file of the folder (on Windows and on file systems without locks: no other
        thread); what it raises leaves the older file as it is.
    durable : bool
        Wait until the file is on the disk.  Without it a machine that loses power may leave a
        damaged file: for what carries a checksum and can be made again.

    Raises
    ------
    FileNotFoundError
        Its folder is not there.
    PermissionError
        The older file or its folder is read-only.
    OSError
        What stands there is no regular file.
    """
    path = resolve_file(path)
    part = _temporary(path)
    try:
        with _named(path):
            yield part
            if durable:
                _on_disk(part)
        with _locked(path.parent):
            if before is not None:
                before(path)
            _keep_mode(path, part)
            os.replace(part, path)
        if durable:
            _on_disk(path.parent)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Have an error of the disk name the file or folder that is written: that of a write names
    none, that of HDF5 has no number.
    """
    try:
        yield
    except OSError as error:
        number = (
            error.errno
            if error.errno in _FULL
            else next((n for n in _FULL if os.strerror(n) in str(error)), None)
        )
        if number is None:
            raise
        raise OSError(
            number,
            f"not written: {os.strerror(number)}; make room or name another place",
            str(path),
        ) from error


def write_text(path: str | os.PathLike, text: str, encoding: str = "utf-8") -> None:
    """Write a text file atomically, with the line ends that the text has; errors as in
    `written_atomically`.
    """
    with written_atomically(path) as part:
        part.write_text(text, encoding=encoding, newline="")


def resolve_file(path: str | os.PathLike) -> Path:
    """Return the file that is written for a name, links followed.

    Raises
    ------
    FileNotFoundError, PermissionError, OSError
        See `written_atomically`.
    """
    found = Path(os.path.realpath(path))
    _demand_folder(found.parent)
    if found.exists():
        _demand_writable(found)
        if not found.is_file():
            raise OSError(
                errno.EINVAL, "no regular file, cannot be replaced; give another name", str(path)
            )
    return found


def _demand_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder; make it first", str(folder))
    if not os.access(folder, os.W_OK):
        raise PermissionError(
            errno.EACCES, "nothing can be written into this folder; give another one", str(folder)
        )


def _demand_writable(path: Path) -> None:
    """Refuse what is read-only by its permissions, for the superuser too."""
    if not path.stat().st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH) or not os.access(
        path, os.W_OK
    ):
        raise PermissionError(
            errno.EACCES,
            "read-only, not replaced; make it writable or give another name",
            str(path),
        )


@contextmanager
def folder_written_atomically(
    path: str | os.PathLike, own: Callable[[str], bool] | None = None
) -> Iterator[Path]:
    """Yield a new folder next to `path` to fill; it takes the name of `path` once the block has
    ended well.

    Parameters
    ----------
    path : path
        The folder; an older one stays as it was until the new one is complete on disk, and is then
        deleted.  Of a symbolic link the target is written; the link stays.
    own : callable, optional
        By the name of a file or folder in the older one: whether it goes with it.  What does not go
        is taken over into the new folder, unless that has something of this name.  Without it all
        goes.

    Raises
    ------
    FileNotFoundError
        The folder above it is not there.
    PermissionError
        The older folder, or the one above it, is read-only.
    OSError
        It cannot be exchanged: no folder, a mount point, or the folder that this process, and so
        perhaps a shell, works in.

    Notes
    -----
    Linux exchanges the two in one step.  Elsewhere the older one is first set aside under a name that ends in ``.old.part``; a process
    that is killed between the two steps leaves no folder at all, and the next writing puts the complete new one in its place first.
    """

    path = resolve_folder(path)
    part = _temporary(path)
    part.mkdir()
    try:
        with _named(path):
            yield part
            with ThreadPoolExecutor(
                _AT_ONCE
            ) as pool:  # a disk writes many files at once in the time of a few
                list(pool.map(_on_disk, part.rglob("*")))
        if own is not None and path.is_dir():
            _take_over(path, part, own)
        _on_disk(part)
        if path.exists():
            part.chmod(stat.S_IMODE(path.stat().st_mode))
            _exchange(part, path)
        else:
            os.replace(part, path)
        if own is not None and part.is_dir():
            _take_over(part, path, own)  # what came meanwhile
        _on_disk(path.parent)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def resolve_folder(path: str | os.PathLike) -> Path:
    """Return the folder that is written for a name, links followed, after what an interrupted
    exchange left is put in order.

    Raises
    ------
    FileNotFoundError, PermissionError, OSError
        See `folder_written_atomically`.
    """
    found = Path(os.path.realpath(path))
    _demand_folder(found.parent)
    _complete_exchange(found)
    if not found.exists():
        return found
    if not found.is_dir():
        raise OSError(errno.ENOTDIR, "a file; give the name of a folder", str(path))
    _demand_writable(found)
    if _works_in(found):
        text = (
            "is replaced as a whole, and this command works in it; give the name of a folder "
            "inside it"
        )
        raise OSError(errno.EBUSY, text, str(path))
    if os.path.ismount(found):
        raise OSError(
            errno.EBUSY,
            "a mount point cannot be replaced as a whole; give the name of a folder inside it",
            str(path),
        )
    return found


def _works_in(folder: Path) -> bool:
    try:
        here = Path.cwd()
    except OSError:  # it is deleted
        return False
    return folder in (here, *here.parents)


def _exchange(part: Path, path: Path) -> None:
    """Give a new folder the name of an older one, which then has the name of the new one, or is
    gone.
    """
    if _exchanged(part, path):
        return
    aside = part.with_suffix(_ASIDE)
    os.replace(path, aside)
    try:
        os.replace(part, path)
    except OSError:
        os.replace(aside, path)
        raise
    os.replace(aside, part)


_ASIDE = ".old.part"


def _complete_exchange(path: Path) -> None:
    """Put in order what a process left that was killed between the two steps of an exchange."""
    for aside in find_leftovers(path.parent, f".{path.name}", _ASIDE[1:]):
        new = aside.with_suffix("").with_suffix(".part")
        if not path.exists():
            os.replace(new if new.is_dir() else aside, path)
        shutil.rmtree(aside, ignore_errors=True)


def _take_over(source: Path, target: Path, own: Callable[[str], bool]) -> None:
    """Bring what is not ours from one folder into another as further links to the same files; as
    copies where there are no links.
    """
    for item in source.iterdir():
        there = target / item.name
        if own(item.name) or os.path.lexists(there):
            continue
        if item.is_dir() and not item.is_symlink():
            shutil.copytree(item, there, symlinks=True, copy_function=_linked)
        else:
            _linked(item, there)


def _linked(source: str | Path, target: str | Path) -> None:
    try:
        os.link(source, target, follow_symlinks=False)
    except (OSError, NotImplementedError):
        shutil.copy2(source, target, follow_symlinks=False)


def _temporary(path: Path) -> Path:
    remove_leftovers(path.parent, f".{path.name}")
    return path.with_name(temporary_name(f".{path.name}"))


def _keep_mode(path: Path, part: Path) -> None:
    with suppress(OSError):  # there is no older one, or the file system has no permissions
        part.chmod(stat.S_IMODE(path.stat().st_mode))


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep other processes, where the file system has locks, and other threads from replacing files
    of a folder.
    """
    with _one_at_a_time:
        handle = _lock(folder)
        try:
            yield
        finally:
            if handle is not None:
                os.close(handle)


def _lock(folder: Path) -> int | None:
    try:
        import fcntl
    except ImportError:
        return None
    handle = os.open(folder, os.O_RDONLY)
    with suppress(OSError):
        fcntl.flock(handle, fcntl.LOCK_EX)
    return handle


def _on_disk(path: Path) -> None:
    """Have the system write a file, or the names in a folder, to the disk; Windows has no such call
    for folders.
    """
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two names in one step; False where the system or the file system cannot."""

    if sys.platform != "linux":
        return False
    rename = getattr(ctypes.CDLL(None), "renameat2", None)
    here, exchange = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of linux/fcntl.h and linux/fs.h
    return (
        rename is not None
        and rename(here, os.fsencode(one), here, os.fsencode(other), exchange) == 0
    )
