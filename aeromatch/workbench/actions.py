"""What changes files is a verb of the command line: which may be called, the log of what was done,
and its replay.
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

PROJECT, WORK = "{project}", "{work}"
"""Placeholders of the folder of the project file and of the workbench's own folder, in commands and log."""

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

_PLACE = re.compile(r"(?:^|=)(\{project\}|\{work\})(/[^=]*)?$")
_LOG_KEYS = {"number", "words", "code", "files"}


class ActionError(AeromatchError):
    """A command that the workbench does not carry out, or a log that does not fit the project."""


def demand_allowed(words: Sequence[str]) -> None:
    """Refuse a command that is not one of `VERBS`, or that names a place outside of project and
    working folder.

    Raises
    ------
    ActionError
    """
    if not words or not all(isinstance(word, str) for word in words):
        raise ActionError("an action is a list of words, such as ['flight', 'mark', ...]")
    if not any(tuple(words[: len(verb)]) == verb for verb in VERBS):
        allowed = ", ".join(" ".join(verb) for verb in VERBS)
        raise ActionError(f"no action {' '.join(words[:2])!r}; there are: {allowed}")
    for word in words:
        value = word.rpartition("=")[2]
        if (
            value.startswith(("/", "\\", "~"))
            or re.match(r"[A-Za-z]:[\\/]", value)
            or ".." in re.split(r"[\\/]", value)
        ):
            raise ActionError(
                f"{word!r} leads out of the project; begin it with {PROJECT}/ or {WORK}/"
            )


@dataclass(frozen=True)
class PlaceholderFolders:
    """The folders behind the placeholders.

    Attributes
    ----------
    project, work : Path
    """

    project: Path
    work: Path

    def real(self, words: Sequence[str]) -> list[str]:
        """Return the words of a command with the folders in place of the placeholders."""
        return [
            word.replace(PROJECT, str(self.project)).replace(WORK, str(self.work)) for word in words
        ]

    def named(self, path: str | Path) -> str:
        """Return a path with the placeholder in place of its folder."""
        path = Path(path)
        for mark, folder in (
            (WORK, self.work),
            (PROJECT, self.project),
        ):  # the working folder may lie in that of the project
            if path.is_relative_to(folder):
                return f"{mark}/{path.relative_to(folder).as_posix()}"
        return str(path)

    def command(self, words: Sequence[str]) -> str:
        """Return a command as it can be typed in the folder of the project."""
        shown = [word.replace(f"{PROJECT}/", "").replace(PROJECT, ".") for word in words]
        return shlex.join(["aeromatch", *(word.replace(WORK, str(self.work)) for word in shown)])


def make_folders(words: Sequence[str], places: PlaceholderFolders) -> None:
    """Make the folders inside the working folder in which a command writes."""
    for word in words:
        if word.startswith(f"{WORK}/"):
            Path(places.real([word])[0]).parent.mkdir(parents=True, exist_ok=True)


def hash_named_files(words: Sequence[str], places: PlaceholderFolders) -> dict[str, str]:
    """Return the SHA-256 of every file and folder that a command names, by its place; empty for
    what is not there.
    """
    named = [match[1] + (match[2] or "") for word in words if (match := _PLACE.search(word))]
    return {name: _digest(Path(places.real([name])[0])) for name in dict.fromkeys(named)}


def _digest(path: Path) -> str:
    if path.is_file():
        return hashlib.sha256(path.read_bytes()).hexdigest()
    if not path.is_dir():
        return ""
    total = hashlib.sha256()
    for file in sorted(item for item in path.rglob("*") if item.is_file()):
        total.update(
            f"{file.relative_to(path).as_posix()}\0{hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode()
        )
    return total.hexdigest()


@dataclass(frozen=True)
class LoggedAction:
    """One line of the log.

    Attributes
    ----------
    number : int
        From 1.
    words : tuple of str
        The command, with placeholders.
    code : int
        Exit code: 0, or 1 where the command was done and its result is a failure.
    files : dict of str to (str, str)
        SHA-256 before and after of the files that it changed; empty where there was none.
    """

    number: int
    words: tuple[str, ...]
    code: int
    files: dict[str, tuple[str, str]]

    def line(self) -> str:
        """Return the entry as a line of JSON."""
        return json.dumps(
            {"number": self.number, "words": self.words, "code": self.code, "files": self.files},
            ensure_ascii=False,
        )


def changed_files(before: dict[str, str], after: dict[str, str]) -> dict[str, tuple[str, str]]:
    """Return what a command changed, from `hash_named_files` before and after it."""
    return {
        name: (before.get(name, ""), found)
        for name, found in after.items()
        if before.get(name, "") != found
    }


def append_action(
    log: Path, words: Sequence[str], code: int, files: dict[str, tuple[str, str]]
) -> LoggedAction:
    """Append an action to the log and return its entry."""
    entry = LoggedAction(
        len(read_action_log(log)) + 1 if log.exists() else 1, tuple(words), code, files
    )
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
    found = []
    for number, line in enumerate(Path(path).read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip():
            continue
        try:
            item: dict[str, Any] = json.loads(line)
            if set(item) != _LOG_KEYS:
                raise ValueError
            files = {
                str(name): (str(before), str(after))
                for name, (before, after) in item["files"].items()
            }
            entry = LoggedAction(
                int(item["number"]), tuple(item["words"]), int(item["code"]), files
            )
        except (ValueError, TypeError, AttributeError) as error:
            raise ParseError(
                str(path), number, line[:60], f"JSON with the keys {', '.join(sorted(_LOG_KEYS))}"
            ) from error
        demand_allowed(entry.words)
        found.append(entry)
    return found


def to_do(entries: Sequence[LoggedAction], places: PlaceholderFolders) -> list[LoggedAction]:
    """Return the actions that are still to be carried out: those from the first whose files are not
    yet in the state that it left.

    Parameters
    ----------
    entries : sequence of Entry
    places : Places

    Raises
    ------
    ActionError
        A file of the project is in none of the states that the log knows.
    """
    position: dict[str, int] = {}
    for name in dict.fromkeys(name for entry in entries for name in entry.files):
        states = [(entry.number, *entry.files[name]) for entry in entries if name in entry.files]
        present = _digest(Path(places.real([name])[0]))
        after = [number for number, _, left in states if left == present]
        if after:
            position[name] = after[-1]
        elif present == states[0][1] or name.startswith(WORK):  # results are made again
            position[name] = 0
        else:
            raise ActionError(
                f"{name}: its content is none that the log knows; take the project as it was "
                f"before action {states[0][0]}"
            )
    return [
        entry for entry in entries if any(position[name] < entry.number for name in entry.files)
    ]


def carry_out(
    entries: Iterable[LoggedAction],
    places: PlaceholderFolders,
    step: Callable[[str], AbstractContextManager[None]],
) -> list[str]:
    """Carry out actions, and return the remarks: results that differ from those of the log.

    Raises
    ------
    ActionError
        A command fails, or leaves a file of the project in another state than the log has.
    """
    remarks = []
    for entry in entries:
        make_folders(entry.words, places)
        with step(f"action {entry.number}: {places.command(entry.words)}"):
            done = subprocess.run(
                [sys.executable, "-m", "aeromatch", *places.real(entry.words)],
                cwd=places.project,
                capture_output=True,
                text=True,
                check=False,
            )
        if done.returncode != entry.code:
            last = (done.stderr.strip().splitlines() or [""])[-1]
            raise ActionError(
                f"action {entry.number} ends with code {done.returncode}, in the log with "
                f"{entry.code}: {last}"
            )
        for name, found in hash_named_files(entry.words, places).items():
            if name in entry.files and found != entry.files[name][1]:
                if name.startswith(PROJECT):
                    raise ActionError(
                        f"action {entry.number}: {name} is not what the log has; was another "
                        f"version at work?"
                    )
                remarks.append(f"action {entry.number}: {name} differs from that of the log")
    return remarks


def last_match(entries: Sequence[LoggedAction]) -> LoggedAction | None:
    """Return the last match of a log, when no action after it changes a file of the project."""
    for entry in reversed(entries):
        if entry.words[0] == "match":
            return entry
        if any(name.startswith(PROJECT) for name in entry.files):
            return None
    return None


def read_command_output(file: Path) -> str:
    """Return what a command printed; empty when it has not begun."""
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return ""
