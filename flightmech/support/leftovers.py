"""Temporary files and folders with the process that owns them in their name, so that what a killed process left is found and removed.

A name is ``PREFIX.MACHINE-PROCESS-TOKEN.ENDING``.  MACHINE stands for the host and its space of process numbers: what a process of
another machine, or of another container, left in a shared folder is nobody else's to judge and stays.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
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


def leftovers(folder: Path, prefix: str, ending: str = "part") -> Iterator[Path]:
    """Yield what processes that have ended left in a folder under names of `temporary_name`."""
    start, end = f"{prefix}.{_machine()}-", f".{ending}"
    for item in _names(folder):
        if item.startswith(start) and item.endswith(end):
            match = _NUMBERS.fullmatch(item, len(start), len(item) - len(end))
            if match and not _runs(int(match[1])):
                yield folder / item


def remove_leftovers(folder: Path, prefix: str, ending: str = "part") -> None:
    """Remove files and folders that processes that have ended left; what cannot be removed stays."""
    import shutil

    for path in leftovers(folder, prefix, ending):
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
    import hashlib
    import socket

    space = ""
    with suppress(OSError):
        space = os.readlink("/proc/self/ns/pid")
    return hashlib.sha256(f"{socket.gethostname()} {space}".encode()).hexdigest()[:8]
