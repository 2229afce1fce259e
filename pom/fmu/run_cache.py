"""A folder of flights, so that an interrupted batch goes on where it stopped and what did not
change is not flown again.
"""

from __future__ import annotations

import hashlib
import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from flightmech.support.atomic_write import written_atomically


class FileState(NamedTuple):
    """Identity of a file at one time; a program can set the time of modification of a file, not
    that of its last change.
    """

    device: int
    inode: int
    size: int
    modified: int
    changed: int

    @classmethod
    def of(cls, path: str | Path) -> FileState:
        """Return the state of a file.

        Raises
        ------
        OSError
            There is none.
        """
        found = os.stat(path)
        return cls(found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)


class KeptFlights(Protocol):
    """Where flights are kept by key, such as `RunCache`."""

    def read(self, key: str, shape: tuple[int, int]) -> np.ndarray | None:
        """Return what is kept under a key; None when nothing is, or nothing of that shape."""

    def write(self, key: str, values: np.ndarray) -> None:
        """Keep an array under a key."""


_DIGEST = hashlib.sha256().digest_size


@dataclass(frozen=True)
class RunCache:
    """Arrays by key, one file each, written atomically, with the SHA-256 of what comes before at
    its end.

    Several processes may share the folder: who comes second writes the same.  Nobody waits for the
    disk; a file that a loss of power damaged is as good as none.

    Attributes
    ----------
    folder : Path
        Made when it is missing.
    """

    folder: Path

    def read(self, key: str, shape: tuple[int, int]) -> np.ndarray | None:
        """Return what is kept under a key; None when nothing is, or nothing of that shape."""
        try:
            content = self._file(key).read_bytes()
            if hashlib.sha256(content[:-_DIGEST]).digest() != content[-_DIGEST:]:
                return None
            found = np.load(io.BytesIO(content), allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        return found if found.shape == shape and found.dtype == np.float64 else None

    def write(self, key: str, values: np.ndarray) -> None:
        """Keep an array under a key."""
        file = self._file(key)
        file.parent.mkdir(parents=True, exist_ok=True)
        stream = io.BytesIO()
        np.save(stream, np.ascontiguousarray(values, np.float64), allow_pickle=False)
        with written_atomically(file, durable=False) as part:
            part.write_bytes(stream.getvalue() + hashlib.sha256(stream.getbuffer()).digest())

    def _file(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.npy"
