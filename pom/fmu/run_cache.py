"""Folder of stored flights, with which an interrupted batch continues.

Flights whose inputs did not change are not flown again.
"""

from __future__ import annotations

import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from flightmech.support.kept_stages.checked_files import read_checked, write_checked


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


@dataclass(frozen=True)
class RunCache:
    """Arrays by key, one checked file each.

    Several processes and threads may share the folder, because they write the same arrays.

    Attributes
    ----------
    folder : Path
        Created if it is missing.
    """

    folder: Path

    def read(self, key: str, shape: tuple[int, int]) -> np.ndarray | None:
        """Return the array of a key; None without an array, or for another shape."""
        content = read_checked(self._file(key))
        if content is None:
            return None
        try:
            values = np.load(io.BytesIO(content), allow_pickle=False)
        except (ValueError, EOFError):
            return None
        if values.shape != shape or values.dtype != np.float64:
            return None
        return values

    def write(self, key: str, values: np.ndarray) -> None:
        """Store an array under a key."""
        file = self._file(key)
        file.parent.mkdir(parents=True, exist_ok=True)
        stream = io.BytesIO()
        np.save(stream, np.ascontiguousarray(values, np.float64), allow_pickle=False)
        write_checked(file, stream.getbuffer())

    def _file(self, key: str) -> Path:
        # Folders by the first two digits: a batch has thousands of flights.
        return self.folder / key[:2] / f"{key}.flight"
