"""Record of a finished match. An unchanged match ends before the numerical modules are imported.

The record has the hashes of all input files, of all output files, of the program and of the
settings. The match is skipped only if all of them are unchanged.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from glob import has_magic
from pathlib import Path
from typing import IO, Any

from flightmech.errors import ParseError
from flightmech.support.input_files import file_sha256, match_files
from flightmech.support.kept_stages.checked_files import read_checked, write_checked
from flightmech.support.kept_stages.program import hash_arithmetic, hash_installation

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

# Letters of the longest text that is tried as the name of a file.
_LONGEST_NAME = 1000
# Windows has no call that waits for a lock without end. [s]
_BETWEEN_TRIES = 0.5


class Watched:
    """Hashes of a project file, and of all files that it names directly or through other files.

    Attributes
    ----------
    files : dict of str to str
        Hash by path.
    patterns : dict of str to list of str
        Files by the pattern that names them.
    """

    def __init__(self, project: Path) -> None:
        self.files: dict[str, str] = {}
        self.patterns: dict[str, list[str]] = {}
        self._states: dict[str, tuple[int, ...]] = {}
        self._add_file(project.resolve())

    def unchanged(self) -> bool:
        """Return whether all files are those that were hashed."""
        try:
            for file, state in self._states.items():
                if _file_state(file) != state:
                    return False
        except OSError:
            return False
        return all(_matching(pattern) == files for pattern, files in self.patterns.items())

    def as_dict(self) -> dict[str, Any]:
        """Return files and patterns as plain data."""
        return {"files": self.files, "patterns": self.patterns}

    def _add_file(self, file: Path) -> None:
        """Add a file, and the files that it names if it is TOML."""
        if str(file) in self.files:
            return
        # The state is read before the hash, so that a change during the hashing is detected.
        self._states[str(file)] = _file_state(str(file))
        self.files[str(file)] = file_sha256(file)
        if file.suffix.lower() != ".toml":
            return
        try:
            content = tomllib.loads(file.read_text(encoding="utf-8-sig"))
        except (ValueError, OSError):
            # The reader of the project reports a faulty file.
            return
        for text in _texts(content):
            self._add_named_files(text, file.parent)

    def _add_named_files(self, text: str, folder: Path) -> None:
        """Add the files that a text of a TOML file may name."""
        # A text with a line break or a NUL, or a very long one, is not the name of a file.
        if not text or "\n" in text or "\0" in text or len(text) > _LONGEST_NAME:
            return
        path = str(folder / text)
        if has_magic(text):
            self.patterns[path] = _matching(path)
            names = self.patterns[path]
        elif os.path.isfile(path):
            names = [path]
        else:
            # FILE:CASE names one case of a listing.
            listing = path.rpartition(":")[0]
            names = [listing] if os.path.isfile(listing) else []
        for name in names:
            self._add_file(Path(name).resolve())


class Finished:
    """The record of the last match of an output folder.

    Parameters
    ----------
    store : Path
        Folder of the store.
    output : Path
    """

    def __init__(self, store: Path, output: Path) -> None:
        self._output = output.resolve()
        digest = hashlib.sha256(str(self._output).encode()).hexdigest()
        self._file = store / "finished" / f"{digest[:32]}.json"

    @contextmanager
    def alone(self, announce: Callable[[], None]) -> Iterator[None]:
        """Let one match at a time write into the output folder; another one waits for it.

        Two matches with different settings would otherwise record the files of each other. After
        the same match the waiting one finds nothing changed. File systems without locks let both
        run.

        Parameters
        ----------
        announce : callable
            Called once if this match has to wait.
        """
        lock = None
        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            lock = self._file.with_suffix(".lock").open("a")
        try:
            if lock is not None:
                _wait_for(lock, announce)
            yield
        finally:
            # closing the file releases the lock, and so does the end of the process
            if lock is not None:
                lock.close()

    def read(self, watched: Watched, settings: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return the output of the command that `write` stored, or None after a change.

        A change of an input, a setting, the program or an output file counts.
        """
        try:
            content = read_checked(self._file)
            if content is None:
                return None
            record = json.loads(bytes(content))
            if record["inputs"] != watched.as_dict():
                return None
            if record["settings"] != _with_program(settings):
                return None
            for name, digest in record["outputs"].items():
                if file_sha256(self._output / name) != digest:
                    return None
            return record["shown"]
        except (OSError, ValueError, KeyError, TypeError):
            # A record that cannot be read is not a proof, so the match is done again.
            return None

    def write(
        self,
        watched: Watched,
        settings: Mapping[str, Any],
        outputs: Iterable[Path],
        shown: Mapping[str, Any],
    ) -> None:
        """Store the record of a match.

        Parameters
        ----------
        watched : Watched
            Files of the project, hashed before the project was read.
        settings : mapping
            All other inputs that determine the bytes of the output.
        outputs : iterable of path
            The files that the match wrote.
        shown : mapping
            The output of the command.
        """
        digests: dict[str, str] = {}
        for file in sorted(outputs):
            digests[file.relative_to(self._output).as_posix()] = file_sha256(file)
        record = {
            "settings": _with_program(settings),
            "inputs": watched.as_dict(),
            "outputs": digests,
            "shown": dict(shown),
        }
        body = json.dumps(record, ensure_ascii=False).encode()
        # Without the record the match is done again, so an error of the disk does not matter.
        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            write_checked(self._file, body)

    def forget(self) -> None:
        """Remove the record, before its output is replaced."""
        with suppress(OSError):
            self._file.unlink(missing_ok=True)


def _wait_for(lock: IO[str], announce: Callable[[], None]) -> None:
    """Lock a file for this process alone. Processes that it starts do not inherit the lock."""
    with suppress(OSError):
        if _lock_at_once(lock):
            return
        announce()
        if sys.platform == "win32":
            while not _lock_at_once(lock):
                time.sleep(_BETWEEN_TRIES)
        else:
            fcntl.lockf(lock, fcntl.LOCK_EX)


def _lock_at_once(lock: IO[str]) -> bool:
    """Lock a file, and return False if another process holds the lock."""
    try:
        if sys.platform == "win32":
            # one byte from the position of the file, which is empty; the byte need not exist
            msvcrt.locking(lock.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    return True


def _with_program(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings with the hashes of the program, in the types of JSON."""
    hashes = {"program": hash_installation(), "arithmetic": hash_arithmetic()}
    return json.loads(json.dumps({**settings, **hashes}))


def _file_state(file: str) -> tuple[int, ...]:
    """Return device, inode, size and times of a file; a change of the content changes them."""
    status = os.stat(file)
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns


def _matching(pattern: str) -> list[str]:
    """Return the files of a pattern, or none if a project would not match the text."""
    with suppress(OSError, ParseError):
        return match_files(pattern)
    return []


def _texts(content: Any) -> Iterable[str]:
    """Yield every text of a TOML file."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for value in content.values():
            yield from _texts(value)
    elif isinstance(content, list):
        for value in content:
            yield from _texts(value)
