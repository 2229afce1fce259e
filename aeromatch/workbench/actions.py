"""Actions of the workbench: allowed commands, their log, and its replay.

Every change of a file is a command of ``aeromatch``.  The log has the commands with placeholders
for folders, and the digests of the files that they changed.
"""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flightmech.errors import AeromatchError, ParseError
from flightmech.support.input_files import file_sha256

PROJECT, WORK = "{project}", "{work}"
"""Placeholders of the folder of the project file and of the working folder, in commands and log."""

VERBS: tuple[tuple[str, ...], ...] = (
    ("set",),
    ("flight", "mark"),
    ("flight", "manoeuvres"),
    ("flight", "reconstruct"),
    ("flight", "identify"),
    ("flight", "select"),
    ("flight", "report"),
    ("db", "edit"),
    ("db", "previous"),
    ("db", "compare"),
    ("pom", "init"),
    ("pom", "run"),
    ("pom", "diagnose"),
    ("pom", "tune"),
    ("fmu", "write"),
    ("match",),
)
"""Verbs that the page may call."""

# A word, or the value of NAME=VALUE, that begins with a placeholder.
_PLACEHOLDER = re.compile(r"(?:^|=)(\{project\}|\{work\})(/[^=]*)?$")
_DRIVE = re.compile(r"[A-Za-z]:[\\/]")
_LOG_KEYS = {"number", "words", "code", "files"}


class ActionError(AeromatchError):
    """A command that the workbench does not carry out, or a log that does not fit the project."""


def demand_allowed(words: Sequence[str]) -> None:
    """Raise if a command is not one of `VERBS`, or names a path outside of the folders.

    Raises
    ------
    ActionError
    """
    if not words or not all(isinstance(word, str) for word in words):
        raise ActionError("an action is a list of words, such as ['flight', 'mark', ...]")
    if not any(tuple(words[: len(verb)]) == verb for verb in VERBS):
        allowed = ", ".join(map(" ".join, VERBS))
        raise ActionError(f"no action {' '.join(words[:2])!r}; there are: {allowed}")
    for word in words:
        if _leaves_folders(word.rpartition("=")[2]):
            raise ActionError(
                f"{word!r} leads out of the project; begin it with {PROJECT}/ or {WORK}/"
            )


def _leaves_folders(path: str) -> bool:
    """Return whether a path is absolute, begins with a home folder, or goes upward."""
    if path.startswith(("/", "\\", "~")) or _DRIVE.match(path):
        return True
    return ".." in re.split(r"[\\/]", path)


@dataclass(frozen=True)
class PlaceholderFolders:
    """Folders of the placeholders.

    Attributes
    ----------
    project, work : Path
    """

    project: Path
    work: Path

    def real(self, words: Sequence[str]) -> list[str]:
        """Return the words of a command with the folders in place of the placeholders."""
        project, work = str(self.project), str(self.work)
        return [word.replace(PROJECT, project).replace(WORK, work) for word in words]

    def named(self, path: str | Path) -> str:
        """Return a path with the placeholder in place of its folder."""
        path = Path(path)
        # The working folder may be inside the folder of the project, so it is tried first.
        for placeholder, folder in ((WORK, self.work), (PROJECT, self.project)):
            if path.is_relative_to(folder):
                return f"{placeholder}/{path.relative_to(folder).as_posix()}"
        return str(path)

    def command(self, words: Sequence[str]) -> str:
        """Return a command as a user can type it in the folder of the project."""
        typed = ["aeromatch"]
        for word in words:
            # Paths of the project are relative to its folder.
            relative = word.replace(f"{PROJECT}/", "").replace(PROJECT, ".")
            typed.append(relative.replace(WORK, str(self.work)))
        return shlex.join(typed)


def make_folders(words: Sequence[str], places: PlaceholderFolders) -> None:
    """Make the folders inside the working folder in which a command writes."""
    for word in words:
        if word.startswith(f"{WORK}/"):
            _real_path(word, places).parent.mkdir(parents=True, exist_ok=True)


def _real_path(name: str, places: PlaceholderFolders) -> Path:
    return Path(places.real([name])[0])


def hash_named_files(words: Sequence[str], places: PlaceholderFolders) -> dict[str, str]:
    """Return the SHA-256 of every file and folder that a command names.

    The keys are paths with placeholders.  A missing file has an empty digest.
    """
    digests: dict[str, str] = {}
    for word in words:
        match = _PLACEHOLDER.search(word)
        if match is None:
            continue
        name = match[1] + (match[2] or "")
        if name not in digests:
            digests[name] = _hash_path(_real_path(name, places))
    return digests


def _hash_path(path: Path) -> str:
    """Return the SHA-256 of a file, or of the names and digests of the files of a folder."""
    if path.is_file():
        return file_sha256(path)
    if not path.is_dir():
        return ""
    total = hashlib.sha256()
    for file in sorted([item for item in path.rglob("*") if item.is_file()]):
        name = file.relative_to(path).as_posix()
        total.update(f"{name}\0{file_sha256(file)}\n".encode())
    return total.hexdigest()


@dataclass(frozen=True)
class LoggedAction:
    """One line of the log.

    Attributes
    ----------
    number : int
        Position in the log, from 1.
    words : tuple of str
        Command, with placeholders.
    code : int
        Exit code: 0, or 1 if the result of the command is a failure.
    files : dict of str to (str, str)
        SHA-256 of the changed files before and after; empty for a missing file.
    """

    number: int
    words: tuple[str, ...]
    code: int
    files: dict[str, tuple[str, str]]

    def line(self) -> str:
        """Return the entry as a line of JSON."""
        content = {
            "number": self.number,
            "words": self.words,
            "code": self.code,
            "files": self.files,
        }
        return json.dumps(content, ensure_ascii=False)


def changed_files(before: dict[str, str], after: dict[str, str]) -> dict[str, tuple[str, str]]:
    """Return the digests before and after of the files that a command changed.

    Parameters
    ----------
    before, after : dict of str to str
        Results of `hash_named_files` before and after the command.
    """
    changes = {}
    for name, digest in after.items():
        earlier = before.get(name, "")
        if digest != earlier:
            changes[name] = (earlier, digest)
    return changes


def append_action(
    log: Path, words: Sequence[str], code: int, files: dict[str, tuple[str, str]]
) -> LoggedAction:
    """Append an action to the log and return its entry."""
    number = len(read_action_log(log)) + 1 if log.exists() else 1
    entry = LoggedAction(number, tuple(words), code=code, files=files)
    with log.open("a", encoding="utf-8", newline="\n") as target:
        target.write(entry.line() + "\n")
    return entry


def read_action_log(path: str | Path) -> list[LoggedAction]:
    """Return the actions of a log.

    Raises
    ------
    ParseError
        A line is not an entry.
    ActionError
        An entry is not an action of the workbench.
    """
    entries = []
    for number, line in enumerate(Path(path).read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip():
            continue
        try:
            entry = _parse_entry(line)
        except (ValueError, TypeError, AttributeError) as error:
            expected = f"JSON with the keys {', '.join(sorted(_LOG_KEYS))}"
            raise ParseError(str(path), number, line[:60], expected) from error
        demand_allowed(entry.words)
        entries.append(entry)
    return entries


def _parse_entry(line: str) -> LoggedAction:
    item: dict[str, Any] = json.loads(line)
    if set(item) != _LOG_KEYS:
        raise ValueError("the keys are not those of an entry")
    files = {}
    for name, (before, after) in item["files"].items():
        files[str(name)] = (str(before), str(after))
    return LoggedAction(
        int(item["number"]), tuple(item["words"]), code=int(item["code"]), files=files
    )


def to_do(entries: Sequence[LoggedAction], places: PlaceholderFolders) -> list[LoggedAction]:
    """Return the actions of a log that are not yet done on the files in the folders.

    An action is to be done if one of its files is in a state before it.

    Parameters
    ----------
    entries : sequence of LoggedAction
    places : PlaceholderFolders

    Raises
    ------
    ActionError
        A file of the project is in none of the states of the log.
    """
    # Every state of a file in the log: number of the action, digests before and after it.
    states: dict[str, list[tuple[int, str, str]]] = {}
    for entry in entries:
        for name, (before, after) in entry.files.items():
            states.setdefault(name, []).append((entry.number, before, after))
    # Number of the last action that left each file as it is now.
    last_done = {}
    for name, file_states in states.items():
        last_done[name] = _last_done_action(name, file_states, places)
    pending = []
    for entry in entries:
        if any(last_done[name] < entry.number for name in entry.files):
            pending.append(entry)
    return pending


def _last_done_action(
    name: str, states: Sequence[tuple[int, str, str]], places: PlaceholderFolders
) -> int:
    """Return the last action that left a file as it is now; 0 if all actions are to be done."""
    present = _hash_path(_real_path(name, places))
    done = [number for number, _, after in states if after == present]
    if done:
        return done[-1]
    # Results in the working folder are made again from any state.
    first_number, before_first, _ = states[0]
    if present == before_first or name.startswith(WORK):
        return 0
    raise ActionError(
        f"{name}: its content is none that the log knows; take the project as it was "
        f"before action {first_number}"
    )


def carry_out(
    entries: Iterable[LoggedAction],
    places: PlaceholderFolders,
    step: Callable[[str], AbstractContextManager[None]],
) -> list[str]:
    """Perform actions, and return remarks on results that differ from the log.

    Parameters
    ----------
    entries : iterable of LoggedAction
    places : PlaceholderFolders
    step : callable
        Returns the context of an action for a title, for example to print its progress.

    Raises
    ------
    ActionError
        A command fails, or leaves a file of the project in another state than the log has.
    """
    remarks = []
    for entry in entries:
        make_folders(entry.words, places)
        with step(f"action {entry.number}: {places.command(entry.words)}"):
            process = subprocess.run(
                [sys.executable, "-m", "aeromatch", *places.real(entry.words)],
                cwd=places.project,
                capture_output=True,
                text=True,
                check=False,
            )
        if process.returncode != entry.code:
            last_line = (process.stderr.strip().splitlines() or [""])[-1]
            raise ActionError(
                f"action {entry.number} ends with code {process.returncode}, in the log with "
                f"{entry.code}: {last_line}"
            )
        remarks += _compare_with_log(entry, places)
    return remarks


def _compare_with_log(entry: LoggedAction, places: PlaceholderFolders) -> list[str]:
    """Return remarks on results that differ; raise if a file of the project differs."""
    remarks = []
    for name, digest in hash_named_files(entry.words, places).items():
        if name not in entry.files or digest == entry.files[name][1]:
            continue
        if name.startswith(PROJECT):
            raise ActionError(
                f"action {entry.number}: {name} is not what the log has; was another "
                f"version at work?"
            )
        remarks.append(f"action {entry.number}: {name} differs from that of the log")
    return remarks


def last_match(entries: Sequence[LoggedAction]) -> LoggedAction | None:
    """Return the last match of a log; None if a later action changes a file of the project."""
    for entry in reversed(entries):
        if entry.words[0] == "match":
            return entry
        if any(name.startswith(PROJECT) for name in entry.files):
            return None
    return None


def read_command_output(file: Path) -> str:
    """Return the output of a command; empty if it has not begun."""
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return ""
