"""The folder that keeps the results of stages: of its user alone, checked when it is read, bounded
in size.

Entries lie as those of `joblib.Memory` do, so that joblib clears them and removes what was not used
for the longest time.  They are pickles, and whoever can write a pickle can run a program: a folder
that another user owns or may write to is refused, and the place is the cache of the user, never a
folder of a project, which may come from elsewhere.
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

from joblib import Memory

from flightmech.errors import SchemaError
from flightmech.support.atomic_write import written_atomically
from flightmech.support.kept_stages.pickles import to_pickle

PLACE, LIMIT = "AEROMATCH_STORE", "AEROMATCH_STORE_LIMIT"
"""Environment variables: the folder of the store (``off``: none), and its size."""
USUAL_LIMIT = "10 GB"

_DIGEST = hashlib.sha256().digest_size
_UNITS = {"": 1, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12}
_SIZE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*([kmgt]?)i?b?\s*", re.IGNORECASE)


@dataclass(frozen=True)
class StageStore:
    """Results by stage and key, one file each, written atomically, after the SHA-256 of its bytes.

    Two jobs may share it: who comes second writes the same.  What cannot be kept, since the disk is
    full or another job clears the store, is computed again next time.

    Attributes
    ----------
    folder : Path
        Made when it is missing, for its user alone.

    Raises
    ------
    SchemaError
        The folder is another user's, or others may write to it.
    """

    folder: Path

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        _demand_own(self.folder)

    def head(self, stage: str, key: str) -> tuple[str, list[str]] | None:
        """Return the hash of what is kept under a key, and the remarks kept with it; None when
        nothing is.
        """
        try:
            with self._file(stage, key).open("rb") as file:
                digest, remarks = file.read(_DIGEST), json.loads(file.readline())
        except (OSError, ValueError):
            return None
        return digest.hex(), [str(text) for text in remarks]

    def read(self, stage: str, key: str) -> tuple[Any, ...]:
        """Return what is kept under a key as a tuple of one; empty when nothing is, or a damaged
        file.
        """
        file = self._file(stage, key)
        try:
            content = memoryview(file.read_bytes())
        except OSError:
            return ()
        if hashlib.sha256(content[_DIGEST:]).digest() != content[:_DIGEST]:
            return ()
        with suppress(OSError):
            os.utime(file)  # it was used: what was not for the longest time goes first
        stream = io.BytesIO(content[_DIGEST:])
        stream.readline()
        return (pickle.load(stream),)

    def write(self, stage: str, key: str, value: Any, remarks: Sequence[str] = ()) -> str:
        """Keep a value and remarks on it under a key, and return the hash of what is kept."""
        head = json.dumps(list(remarks)).encode() + b"\n"

        try:
            body = to_pickle(value)
        except (
            pickle.PicklingError,
            TypeError,
            AttributeError,
        ):  # it cannot be kept: known by what it was made of
            return f"of {key}"
        digest = hashlib.sha256(head)
        digest.update(body)
        file = self._file(stage, key)
        with suppress(OSError):
            file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with written_atomically(file, durable=False) as part, part.open("wb") as stream:
                stream.writelines((digest.digest(), head, body))
        return digest.hexdigest()

    def usage(self) -> dict[str, tuple[int, int]]:
        """Return number and size of the entries by stage. [bytes]"""
        found: dict[str, tuple[int, int]] = {}
        for item in self._memory().store_backend.get_items():
            stage = Path(item.path).parent.name
            count, size = found.get(stage, (0, 0))
            found[stage] = count + 1, size + item.size
        return dict(sorted(found.items()))

    def shorten(self, limit: float) -> None:
        """Remove what was not used for the longest time, until the rest is within a limit. [bytes]"""
        if self._size() > limit:
            self._memory().reduce_size(bytes_limit=int(limit))

    def clear(self) -> None:
        """Remove everything that is kept."""
        self._memory().clear(warn=False)
        for name in ("traces", "finished"):
            for file in (self.folder / name).glob("*"):
                file.unlink(missing_ok=True)

    def _size(self) -> int:
        """Return the size of all entries. [bytes]"""
        found = 0
        for place, _, names in os.walk(self.folder / "joblib"):
            for name in names:
                with suppress(OSError):  # another job clears it
                    found += os.stat(os.path.join(place, name)).st_size
        return found

    def _memory(self) -> Any:

        return Memory(self.folder, verbose=0)

    def _file(self, stage: str, key: str) -> Path:
        return self.folder / "joblib" / stage.replace(" ", "_") / key[:32] / "output.pkl"


def store_folder() -> Path | None:
    """Return the folder of the store: as `PLACE` states, else in the cache of the user; None where
    it is switched off.
    """
    given = os.environ.get(PLACE, "")
    if given.lower() == "off":
        return None
    return Path(given).absolute() if given else _user_cache() / "aeromatch" / "stages"


def _user_cache() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def size_limit() -> float:
    """Return the size that the store may have, as `LIMIT` states. [bytes]

    Raises
    ------
    SchemaError
        No size.
    """
    return bytes_of(os.environ.get(LIMIT) or USUAL_LIMIT)


def bytes_of(text: str) -> float:
    """Return the size that a text states. [bytes]

    Examples
    --------
    >>> bytes_of("1.5 GB")
    1500000000.0
    """
    found = _SIZE.fullmatch(text)
    if found is None:
        raise SchemaError(
            LIMIT,
            [
                f"{text!r} is not a size; write a number with kB, MB, GB or TB, such as "
                f"{USUAL_LIMIT!r}"
            ],
        )
    return float(found[1]) * _UNITS[found[2].lower()]


def _demand_own(folder: Path) -> None:
    """Refuse a folder into which somebody else can lay what would be run here."""
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
