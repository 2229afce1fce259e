"""Names of temporary files, and removal of those that ended processes left."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import socket
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

if sys.platform != "win32":
    pass


def temporary_name(prefix: str, ending: str = "part") -> str:
    """Return a name that is unique to this process and call.

    Examples
    --------
    >>> temporary_name("a.nc") == temporary_name("a.nc")
    False
    """
    return f"{prefix}.{_machine()}-{os.getpid()}-{os.urandom(4).hex()}.{ending}"


# number of the process, and random digits, in a name of temporary_name
_NUMBERS = re.compile(r"(\d+)-[0-9a-f]{8}")


def find_leftovers(folder: Path, prefix: str, ending: str = "part") -> Iterator[Path]:
    """Yield the temporary files and folders of ended processes in a folder.

    Only names of `temporary_name` from this machine are yielded.
    """
    start, end = f"{prefix}.{_machine()}-", f".{ending}"
    for name in _list_names(folder):
        if name.startswith(start) and name.endswith(end):
            match = _NUMBERS.fullmatch(name, len(start), len(name) - len(end))
            if match and not _is_running(int(match[1])):
                yield folder / name


def remove_leftovers(folder: Path, prefix: str, ending: str = "part") -> None:
    """Remove the temporary files and folders of ended processes, if possible."""
    for path in find_leftovers(folder, prefix, ending):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink()


def _list_names(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _is_running(process: int) -> bool:
    """Return whether a process may be running."""
    # on Windows os.kill would end the process
    if os.name == "nt":
        return True
    try:
        # signal 0 only checks
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        # for example a process of another user
        return True
    return True


@cache
def _machine() -> str:
    """Return a short hash of the machine and of the container, whose process numbers are unique."""
    namespace = ""
    with suppress(OSError):
        namespace = os.readlink("/proc/self/ns/pid")
    return hashlib.sha256(f"{socket.gethostname()} {namespace}".encode()).hexdigest()[:8]
