"""Atomic writing of files and folders: completely or not at all.

The new content is first written next to its destination, under a name that begins with a dot and
ends with ``.part``. If a process is killed, such a file remains. The next writing to the same
destination removes it.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import stat
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from flightmech.errors import SchemaError
from flightmech.support.temporary_names import find_leftovers, remove_leftovers, temporary_name

if sys.platform != "win32":
    import fcntl


# errors of a full or defective disk; Windows does not have all of them
_DISK_ERRORS = tuple(
    getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG", "EIO") if hasattr(errno, name)
)
_lock_of_threads = threading.RLock()
# files of a folder that are flushed to the disk in parallel
_PARALLEL_FLUSHES = 8


@contextmanager
def written_atomically(
    path: str | os.PathLike[str], before: Callable[[Path], None] | None = None, durable: bool = True
) -> Iterator[Path]:
    """Yield a temporary path, which replaces `path` after the block has ended without an error.

    Parameters
    ----------
    path : path
        The file. An older file remains until the new one is complete on disk, and the new file has
        its permissions. If `path` is a symbolic link, its target is written and the link remains.
    before : callable, optional
        Called with the file just before the replacement. No other process of this product replaces
        a file of the folder at this time (on Windows and on file systems without locks: no other
        thread). If it raises, the older file remains.
    durable : bool
        Wait until the file is on the disk. Otherwise a power failure may leave a damaged file. Use
        False for files that have a checksum and can be computed again.

    Raises
    ------
    FileNotFoundError
        The folder of the file does not exist.
    PermissionError
        The older file or its folder is read-only.
    OSError
        `path` exists, but is not a regular file.
    """
    path = resolve_file(path)
    part = _make_temporary_path(path)
    try:
        with _name_disk_errors(path):
            yield part
            if durable:
                _flush_to_disk(part)
            with _locked(path.parent):
                if before is not None:
                    before(path)
                _copy_mode(path, part)
                os.replace(part, path)
        # the new name of the file is a change of the folder
        if durable:
            with _name_disk_errors(path, _AFTER_RENAMING):
                _flush_to_disk(path.parent)
    finally:
        # an error of the removal would hide that of the block; the next writing removes the rest
        with suppress(OSError):
            part.unlink(missing_ok=True)


_BEFORE_RENAMING = "not written: {}; make room or name another place"
_AFTER_RENAMING = "written, but a power failure may lose it: {}; write it again"


@contextmanager
def _name_disk_errors(path: Path, text: str = _BEFORE_RENAMING) -> Iterator[None]:
    """Add the path to an error of the disk, with a text about the state of the file.

    Errors of `write` have no file name, and errors of HDF5 have no errno.
    """
    try:
        yield
    except OSError as error:
        number = _disk_error_number(error)
        if number is None:
            raise
        raise OSError(number, text.format(os.strerror(number)), str(path)) from error


def _disk_error_number(error: OSError) -> int | None:
    """Return the errno of an error of the disk, None for other errors."""
    if error.errno in _DISK_ERRORS:
        return error.errno
    for number in _DISK_ERRORS:
        if os.strerror(number) in str(error):
            return number
    return None


def write_text(
    path: str | os.PathLike[str],
    text: str,
    encoding: str = "utf-8",
    before: Callable[[Path], None] | None = None,
) -> None:
    """Write a text file atomically, without a change of its line ends.

    The parameter `before` and the errors are those of `written_atomically`.
    """
    with written_atomically(path, before) as part:
        part.write_text(text, encoding=encoding, newline="")


class ContentAsRead:
    """Content of a file that a command reads, changes and writes again.

    Its method `demand_unchanged` is the parameter `before` of `written_atomically`. Of two commands
    that change a file at the same time, the second one to write it is refused: it would write the
    file without the change of the first one.

    Parameters
    ----------
    path : path
        The file; it need not exist.

    Attributes
    ----------
    content : bytes or None
        None without a file.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.content = _content_of(Path(path))

    def demand_unchanged(self, path: Path) -> None:
        """Raise `SchemaError` if the file is not what was read."""
        if _content_of(path) != self.content:
            text = "was changed by another program after it was read here; repeat the command"
            raise SchemaError(str(path), [text])


def _content_of(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None


def resolve_file(path: str | os.PathLike[str]) -> Path:
    """Return the file to write for a path, after following links.

    Raises
    ------
    FileNotFoundError, PermissionError, OSError
        See `written_atomically`.
    """
    target = Path(os.path.realpath(path))
    _demand_folder(target.parent)
    if target.exists():
        _demand_writable(target)
        if not target.is_file():
            text = "not a regular file, cannot be replaced; give another name"
            raise OSError(errno.EINVAL, text, str(path))
    return target


def _demand_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder; make it first", str(folder))
    if not os.access(folder, os.W_OK):
        raise PermissionError(
            errno.EACCES, "nothing can be written into this folder; give another one", str(folder)
        )


def _demand_writable(path: Path) -> None:
    """Raise for a file or folder that is read-only by its permissions."""
    # os.access allows the superuser all files, so the permissions are checked too
    can_write = path.stat().st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH)
    if not can_write or not os.access(path, os.W_OK):
        raise PermissionError(
            errno.EACCES,
            "read-only, not replaced; make it writable or give another name",
            str(path),
        )


@contextmanager
def folder_written_atomically(
    path: str | os.PathLike[str], own: Callable[[str], bool] | None = None
) -> Iterator[Path]:
    """Yield a new folder, which replaces `path` after the block has ended without an error.

    Parameters
    ----------
    path : path
        The folder. An older folder remains until the new one is complete on disk, and is then
        deleted. If `path` is a symbolic link, its target is written and the link remains.
    own : callable, optional
        Returns by the name of a file or folder whether it is deleted with the older folder. Other
        files and folders are kept in the new folder, unless it has an item of the same name. By
        default all are deleted.

    Raises
    ------
    FileNotFoundError
        The parent folder does not exist.
    PermissionError
        The older folder or its parent is read-only.
    OSError
        The folder cannot be replaced: it is a file, a mount point, or the working folder of this
        process, and so perhaps of a shell.

    Notes
    -----
    Linux exchanges the two folders in one step. On other systems the older folder is first renamed
    to a name that ends with ``.old.part``. If the process is killed between the two steps, there is
    no folder of the name. The next writing then first gives the complete new folder its name.
    """
    path = resolve_folder(path)
    part = _make_temporary_path(path)
    try:
        with _name_disk_errors(path):
            part.mkdir()
            yield part
            # a disk flushes many files in parallel in the time of a few
            with ThreadPoolExecutor(_PARALLEL_FLUSHES) as pool:
                list(pool.map(_flush_to_disk, part.rglob("*")))
            if own is not None and path.is_dir():
                _link_foreign_items(path, part, own)
            _flush_to_disk(part)
            if path.exists():
                part.chmod(stat.S_IMODE(path.stat().st_mode))
                _exchange(part, path)
            else:
                os.replace(part, path)
        with _name_disk_errors(path, _AFTER_RENAMING):
            # items that were added to the older folder in the meantime
            if own is not None and part.is_dir():
                _link_foreign_items(part, path, own)
            _flush_to_disk(path.parent)
    finally:
        shutil.rmtree(part, ignore_errors=True)


@contextmanager
def folder_for_files(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield the folder in which a command writes its files; a new folder appears with all of them.

    Parameters
    ----------
    path : path
        The folder. If it exists, it is yielded itself, and each of its files is to be written with
        `written_atomically`. Otherwise its parents are made, and a temporary folder is yielded,
        which gets the name after the block has ended without an error.

    Raises
    ------
    PermissionError, OSError
        See `folder_written_atomically`.
    """
    path = Path(path)
    if path.is_dir():
        yield path
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    # another process may make the folder in the meantime, and its files stay
    with folder_written_atomically(path, lambda name: False) as new:
        yield new


def resolve_folder(path: str | os.PathLike[str]) -> Path:
    """Return the folder to write for a path, after following links.

    An interrupted exchange is completed first.

    Raises
    ------
    FileNotFoundError, PermissionError, OSError
        See `folder_written_atomically`.
    """
    target = Path(os.path.realpath(path))
    _demand_folder(target.parent)
    _complete_exchange(target)
    if not target.exists():
        return target
    if not target.is_dir():
        raise OSError(errno.ENOTDIR, "a file; give the name of a folder", str(path))
    _demand_writable(target)
    if _is_working_folder(target):
        text = (
            "is replaced as a whole, and this command works in it; give the name of a folder "
            "inside it"
        )
        raise OSError(errno.EBUSY, text, str(path))
    if os.path.ismount(target):
        text = "a mount point cannot be replaced as a whole; give the name of a folder inside it"
        raise OSError(errno.EBUSY, text, str(path))
    return target


def _is_working_folder(folder: Path) -> bool:
    """Return whether the working folder is this folder or inside it."""
    try:
        working = Path.cwd()
    except OSError:
        # it was deleted
        return False
    return folder in (working, *working.parents)


def _exchange(part: Path, path: Path) -> None:
    """Exchange the names of the new and the older folder."""
    if _exchange_in_one_step(part, path):
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
    """Complete the exchange of a process that was killed between its two steps."""
    for aside in find_leftovers(path.parent, f".{path.name}", _ASIDE[1:]):
        new = aside.with_suffix("").with_suffix(".part")
        if not path.exists():
            os.replace(new if new.is_dir() else aside, path)
        shutil.rmtree(aside, ignore_errors=True)


def _link_foreign_items(source: Path, target: Path, own: Callable[[str], bool]) -> None:
    """Add the items of `source` that are not `own` to `target`, as links to the same files."""
    for item in source.iterdir():
        destination = target / item.name
        if own(item.name) or os.path.lexists(destination):
            continue
        if item.is_dir() and not item.is_symlink():
            shutil.copytree(item, destination, symlinks=True, copy_function=_link_or_copy)
        else:
            _link_or_copy(item, destination)


def _link_or_copy(source: str | Path, target: str | Path) -> None:
    try:
        os.link(source, target, follow_symlinks=False)
    except (OSError, NotImplementedError):
        shutil.copy2(source, target, follow_symlinks=False)


def _make_temporary_path(path: Path) -> Path:
    remove_leftovers(path.parent, f".{path.name}")
    return path.with_name(temporary_name(f".{path.name}"))


def _copy_mode(path: Path, part: Path) -> None:
    # there may be no older file, or a file system without permissions
    with suppress(OSError):
        part.chmod(stat.S_IMODE(path.stat().st_mode))


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Prevent other threads and processes from replacing files of a folder.

    Without locks of the file system only other threads are prevented.
    """
    with _lock_of_threads:
        handle = _lock_folder(folder)
        try:
            yield
        finally:
            if handle is not None:
                os.close(handle)


def _lock_folder(folder: Path) -> int | None:
    if sys.platform == "win32":
        return None
    handle = os.open(folder, os.O_RDONLY)
    with suppress(OSError):
        fcntl.flock(handle, fcntl.LOCK_EX)
    return handle


def _flush_to_disk(path: Path) -> None:
    """Write the cached content of a file, or the names in a folder, to the disk."""
    # Windows has no such call for folders
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _exchange_in_one_step(a: Path, b: Path) -> bool:
    """Exchange two names in one step. Return False if the system does not support it."""
    if sys.platform != "linux":
        return False
    rename = getattr(ctypes.CDLL(None), "renameat2", None)
    if rename is None:
        return False
    # AT_FDCWD of linux/fcntl.h and RENAME_EXCHANGE of linux/fs.h
    folder, exchange = -100, 2
    return rename(folder, os.fsencode(a), folder, os.fsencode(b), exchange) == 0
