"""A folder of flights, so that an interrupted batch goes on where it stopped and what did not change is not flown again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flightmech.support.atomic_write import written_atomically


@dataclass(frozen=True)
class Store:
    """Arrays by key, one file each, written atomically.

    Several processes may share the folder: who comes second writes the same.

    Attributes
    ----------
    folder : Path
        Made when it is missing.
    """

    folder: Path

    def read(self, key: str, shape: tuple[int, int]) -> np.ndarray | None:
        """Return what is kept under a key; None when nothing is, or nothing of that shape."""
        try:
            found = np.load(self._file(key), allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        return found if found.shape == shape and found.dtype == np.float64 else None

    def write(self, key: str, values: np.ndarray) -> None:
        """Keep an array under a key."""
        file = self._file(key)
        file.parent.mkdir(parents=True, exist_ok=True)
        with written_atomically(file) as part, part.open("wb") as stream:
            np.save(stream, np.ascontiguousarray(values, np.float64), allow_pickle=False)

    def _file(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.npy"
