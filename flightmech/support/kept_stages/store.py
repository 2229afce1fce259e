"""Folder for results of stages, private to its user, with checksums and a limit of its size.

The entries have the layout of `joblib.Memory`, so that joblib can clear them and remove the least
recently used ones. The entries are pickles, and a pickle can run any program when it is read.
Therefore a folder that another user owns or can write to is an error. The default folder is the
cache of the user, not a folder of a project, which can come from another person.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import pickle
import re
import stat
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flightmech.errors import SchemaError
from flightmech.support.kept_stages.checked_files import DIGEST, read_checked, write_checked

PLACE, LIMIT = "AEROMATCH_STORE", "AEROMATCH_STORE_LIMIT"
"""Environment variables for the folder of the store (``off``: no store), and for its size."""
USUAL_LIMIT = "10 GB"

# factors of the units of a size
_UNITS = {"": 1, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12}
_SIZE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*([kmgt]?)i?b?\s*", re.IGNORECASE)


@dataclass(frozen=True)
class StageStore:
    """Results by stage and key, in one file each.

    The files are those of `checked_files`. Two jobs can share a store, because they write the same
    results. A result that cannot be stored, for example
    on a full disk, is computed again next time.

    Attributes
    ----------
    folder : Path
        A missing folder is created with access for its user only.

    Raises
    ------
    SchemaError
        The folder belongs to another user, or others can write to it.
    """

    folder: Path

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        _demand_private(self.folder)

    def head(self, stage: str, key: str) -> tuple[str, list[str]] | None:
        """Return the hash and the remarks of a result; None without a result.

        The remarks are checked, the result itself only when it is read.
        """
        try:
            with self._file(stage, key).open("rb") as file:
                digest, remarks = file.read(DIGEST), _read_remarks(file.readline())
        except OSError:
            return None
        return None if remarks is None else (digest.hex(), remarks)

    def read(self, stage: str, key: str) -> tuple[Any, ...]:
        """Return a result as a tuple of one, an empty tuple if it is missing or cannot be read."""
        file = self._file(stage, key)
        # checked before the pickle is loaded
        content = read_checked(file)
        if content is None:
            return ()
        # joblib removes the entries with the oldest time
        with suppress(OSError):
            os.utime(file)
        stream = io.BytesIO(content)
        # the line of remarks
        stream.readline()
        # a pickle of another version of a library can fail with any exception
        with suppress(Exception):
            return (pickle.load(stream),)
        return ()

    def write(self, stage: str, key: str, value: Any, remarks: Sequence[str] = ()) -> str:
        """Store a result with its remarks, and return the hash of the stored bytes."""
        # a match without a change reads no stage
        from flightmech.support.kept_stages.pickles import to_pickle

        head = _remarks_line(remarks)
        try:
            body = to_pickle(value)
        except (pickle.PicklingError, TypeError, AttributeError):
            # It cannot be stored. The key of its inputs takes the place of its hash.
            return f"of {key}"
        file = self._file(stage, key)
        try:
            file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            return write_checked(file, head, body)
        except OSError:
            return hashlib.sha256(head + body).hexdigest()

    def usage(self) -> dict[str, tuple[int, int]]:
        """Return number and size of the entries by stage. [bytes]"""
        usage: dict[str, tuple[int, int]] = {}
        for item in self._memory().store_backend.get_items():
            stage = Path(item.path).parent.name
            count, size = usage.get(stage, (0, 0))
            usage[stage] = count + 1, size + item.size
        return dict(sorted(usage.items()))

    def shorten(self, limit: float) -> None:
        """Remove the least recently used entries until the size is within a limit. [bytes]"""
        if self._total_size() > limit:
            self._memory().reduce_size(bytes_limit=int(limit))

    def clear(self) -> None:
        """Remove all entries and traces."""
        self._memory().clear(warn=False)
        for name in ("traces", "finished"):
            for file in (self.folder / name).glob("*"):
                file.unlink(missing_ok=True)

    def _total_size(self) -> int:
        """Return the size of all entries. [bytes]"""
        size = 0
        for folder, _, names in os.walk(self.folder / "joblib"):
            for name in names:
                # another job can remove the file at this moment
                with suppress(OSError):
                    size += os.stat(os.path.join(folder, name)).st_size
        return size

    def _memory(self) -> Any:
        # a match without a change reads no stage
        from joblib import Memory

        return Memory(self.folder, verbose=0)

    def _file(self, stage: str, key: str) -> Path:
        return self.folder / "joblib" / stage.replace(" ", "_") / key[:32] / "output.pkl"


def _remarks_line(remarks: Sequence[str]) -> bytes:
    """Return the line of remarks in front of a result, with its own hash.

    The remarks of a result are printed although the result is not read and checked.
    """
    text = json.dumps(list(remarks)).encode()
    return hashlib.sha256(text).hexdigest().encode() + b" " + text + b"\n"


def _read_remarks(line: bytes) -> list[str] | None:
    """Return the remarks of a line, None if it is damaged."""
    digest, _, text = line.rstrip(b"\n").partition(b" ")
    if hashlib.sha256(text).hexdigest().encode() != digest:
        return None
    return list(json.loads(text))


def store_folder() -> Path | None:
    """Return the folder of the store, None if the store is switched off.

    The environment variable `PLACE` names the folder. The default is in the cache of the user.
    """
    folder = os.environ.get(PLACE, "")
    if folder.lower() == "off":
        return None
    if folder:
        return Path(folder).absolute()
    return _user_cache() / "aeromatch" / "stages"


def _user_cache() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def size_limit() -> float:
    """Return the greatest size of the store, from the environment variable `LIMIT`. [bytes]

    Raises
    ------
    SchemaError
        The text of the variable is not a size.
    """
    return bytes_of(os.environ.get(LIMIT) or USUAL_LIMIT)


def bytes_of(text: str) -> float:
    """Return the size in a text. [bytes]

    Examples
    --------
    >>> bytes_of("1.5 GB")
    1500000000.0
    """
    match = _SIZE.fullmatch(text)
    if match is None:
        raise SchemaError(
            LIMIT,
            [
                f"{text!r} is not a size; write a number with kB, MB, GB or TB, such as "
                f"{USUAL_LIMIT!r}"
            ],
        )
    return float(match[1]) * _UNITS[match[2].lower()]


def _demand_private(folder: Path) -> None:
    """Raise if another user can write pickles into a folder. Windows has other permissions."""
    if os.name == "nt":
        return
    state = folder.stat()
    if state.st_uid != os.geteuid():
        raise SchemaError(
            str(folder),
            [
                f"the store belongs to another user ({state.st_uid}); name one of your own "
                f"in {PLACE}, or 'off'"
            ],
        )
    if state.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise SchemaError(
            str(folder),
            [f"others may write to the store; chmod 700 it, or name another folder in {PLACE}"],
        )
