"""Chain of custody of a batch: what is certified is what was read."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from flightmech.errors import SchemaError

from ..fmu.file_state import FileState
from .origins import sha256


class Custody:
    """Files with their hashes, taken before they are read.

    A file that is replaced or edited while a batch runs, even for a moment, would lend its hash to results of another content;
    `check` finds it before anything is written.

    Examples
    --------
    >>> custody = Custody()
    >>> custody.take([__file__])
    >>> custody.check()
    """

    def __init__(self) -> None:
        self._taken: dict[Path, tuple[FileState, str]] = {}

    def take(self, files: Iterable[str | Path]) -> None:
        """Hash files that are about to be read; those taken before keep their first hash.

        Raises
        ------
        FileNotFoundError
        """
        for path in (Path(file).resolve() for file in files):
            if path not in self._taken:
                state = FileState.of(path)  # first: what changes while it is hashed is found by `check`
                self._taken[path] = state, sha256(path)

    def sha256(self, file: str | Path) -> str:
        """Return the hash that a file had when it was taken; one that was not is taken now."""
        self.take([file])
        return self._taken[Path(file).resolve()][1]

    def check(self, files: Iterable[str | Path] | None = None) -> None:
        """Compare files, all that were taken unless given, with what they were.

        Raises
        ------
        SchemaError
            With every file that changed or is gone.
        """
        problems = []
        for path in self._taken if files is None else [Path(file).resolve() for file in files]:
            state, _ = self._taken[path]
            try:
                same = FileState.of(path) == state
            except OSError:
                same = False
            if not same:
                problems.append(f"{path} changed while the batch ran; nothing was written, run it again")
        if problems:
            raise SchemaError("inputs", problems)
