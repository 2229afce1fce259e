"""Folder of stored flights, with which an interrupted batch continues.

Flights whose inputs did not change are not flown again.
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
    """Identity of a file at one time.

    A program can set the time of modification of a file, but not the time of its last change.
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
            The file does not exist, or cannot be accessed.
        """
        status = os.stat(path)
        return cls(
            device=status.st_dev,
            inode=status.st_ino,
            size=status.st_size,
            modified=status.st_mtime_ns,
            changed=status.st_ctime_ns,
        )


class KeptFlights(Protocol):
    """A store of flights by key, such as `RunCache`."""

    def read(self, key: str, shape: tuple[int, int]) -> np.ndarray | None:
        """Return the array of a key; None without an array, or for another shape."""

    def write(self, key: str, values: np.ndarray) -> None:
        """Store an array under a key."""


_DIGEST = hashlib.sha256().digest_size


@dataclass(frozen=True)
class RunCache:
    """Arrays by key, one file each, written atomically.

    A file ends with the SHA-256 of its content. Several processes and threads may share the folder,
    because they write the same arrays. A write does not wait for the disk: a file that a power
    failure damaged counts as missing.

    Attributes
    ----------
    folder : Path
        Created if it is missing.
    """

    folder: Path

    def read(self, key: str, shape: tuple[int, int]) -> np.ndarray | None:
        """Return the array of a key; None without an array, or for another shape."""
        try:
            content = self._file(key).read_bytes()
            # The checksum is compared before NumPy parses the content.
            if hashlib.sha256(content[:-_DIGEST]).digest() != content[-_DIGEST:]:
                return None
            values = np.load(io.BytesIO(content), allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        if values.shape != shape or values.dtype != np.float64:
            return None
        return values

    def write(self, key: str, values: np.ndarray) -> None:
        """Store an array under a key."""
        file = self._file(key)
        file.parent.mkdir(parents=True, exist_ok=True)
        # In memory first, because the checksum follows the array.
        stream = io.BytesIO()
        np.save(stream, np.ascontiguousarray(values, np.float64), allow_pickle=False)
        with written_atomically(file, durable=False) as part:
            part.write_bytes(stream.getvalue() + hashlib.sha256(stream.getbuffer()).digest())

    def _file(self, key: str) -> Path:
        # Folders by the first two digits: a batch has thousands of flights.
        return self.folder / key[:2] / f"{key}.npy"
