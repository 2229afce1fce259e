"""The record of a finished match: by it a match of which nothing changed is over before anything is
imported that computes.

It holds the hashes of every file that went in, of every file that came out, of program and
settings.  Only when all of them are as they were is the match left out; whatever else is looked at,
its result is the one that is there.
"""

from __future__ import annotations

import hashlib
import json
import os
import tomllib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from glob import glob, has_magic
from pathlib import Path
from typing import Any

from flightmech.support.atomic_write import written_atomically
from flightmech.support.kept_stages.program import hash_arithmetic, hash_installation


class Watched:
    """Every file that a project file names, directly or in files that these name, with its hash.

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
        self._take(project.resolve())

    def unchanged(self) -> bool:
        """Return whether all files are those that were hashed."""
        try:
            same = all(_state(file) == state for file, state in self._states.items())
        except OSError:
            return False
        return same and all(_matching(pattern) == files for pattern, files in self.patterns.items())

    def as_dict(self) -> dict[str, Any]:
        """Return files and patterns as plain data."""
        return {"files": self.files, "patterns": self.patterns}

    def _take(self, file: Path) -> None:
        if str(file) in self.files:
            return
        self._states[str(file)] = _state(
            str(file)
        )  # first: what changes while it is hashed is noticed
        self.files[str(file)] = file_sha256(file)
        if file.suffix.lower() != ".toml":
            return
        try:
            content = tomllib.loads(file.read_text(encoding="utf-8-sig"))
        except (ValueError, OSError):  # the reader of the project states what is wrong
            return
        for text in _texts(content):
            self._named(text, file.parent)

    def _named(self, text: str, folder: Path) -> None:
        """Take the files that a text of a TOML file may name."""
        if not text or "\n" in text or "\0" in text or len(text) > 1000:
            return
        place = str(folder / text)
        if has_magic(text):
            self.patterns[place] = _matching(place)
            found = self.patterns[place]
        else:
            found = [
                name for name in (place, place.rpartition(":")[0]) if name and os.path.isfile(name)
            ][:1]
        for name in found:
            self._take(Path(name).resolve())


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
        self._file = (
            store
            / "finished"
            / f"{hashlib.sha256(str(self._output).encode()).hexdigest()[:32]}.json"
        )

    def read(self, watched: Watched, settings: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return what `write` kept when inputs, settings, program and every file of the output are
        the same; else None.
        """
        try:
            head, _, body = self._file.read_bytes().partition(b"\n")
            if hashlib.sha256(body).hexdigest().encode() != head:
                return None
            record = json.loads(body)
            if record["inputs"] != watched.as_dict() or record["settings"] != _with_program(
                settings
            ):
                return None
            intact = all(
                file_sha256(self._output / name) == digest
                for name, digest in record["outputs"].items()
            )
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return record["shown"] if intact else None

    def write(
        self,
        watched: Watched,
        settings: Mapping[str, Any],
        outputs: Iterable[Path],
        shown: Mapping[str, Any],
    ) -> None:
        """Keep the record of a match.

        Parameters
        ----------
        watched : Watched
            Of the project, from before it was read.
        settings : mapping
            All that decides the bytes of the output besides.
        outputs : iterable of path
            The files that the match wrote.
        shown : mapping
            What the command prints.
        """
        record = {
            "settings": _with_program(settings),
            "inputs": watched.as_dict(),
            "outputs": {
                file.relative_to(self._output).as_posix(): file_sha256(file)
                for file in sorted(outputs)
            },
            "shown": dict(shown),
        }
        body = json.dumps(record, ensure_ascii=False).encode()
        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with written_atomically(self._file, durable=False) as part:
                part.write_bytes(hashlib.sha256(body).hexdigest().encode() + b"\n" + body)

    def forget(self) -> None:
        """Remove the record: its output is about to be replaced."""
        with suppress(OSError):
            self._file.unlink(missing_ok=True)


def file_sha256(file: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def _with_program(settings: Mapping[str, Any]) -> dict[str, Any]:
    return json.loads(
        json.dumps({**settings, "program": hash_installation(), "arithmetic": hash_arithmetic()})
    )


def _state(file: str) -> tuple[int, ...]:
    found = os.stat(file)
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns


def _matching(pattern: str) -> list[str]:
    return sorted(name for name in glob(pattern, recursive=True) if os.path.isfile(name))


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
