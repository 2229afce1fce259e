"""Actions of the workbench: allowed commands, their log, and its replay.

Every change of a file is a command of ``aeromatch``.  The log has the commands with placeholders
for folders, and the digests of the files that they changed.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aeromatch.workbench.allowed_actions import (
    PROJECT,
    WORK,
    ActionError,
    PlaceholderFolders,
    demand_allowed,
    is_inside_folders,
    named_paths,
)
from flightmech.errors import ParseError
from flightmech.support.atomic_write import write_text
from flightmech.support.input_files import file_sha256

_LOG_KEYS = {"number", "words", "code", "files"}
_EXPECTED = f"JSON with the keys {', '.join(sorted(_LOG_KEYS))}"
# Errors of a line that is not an entry.
_FAULTS = (ValueError, TypeError, AttributeError, KeyError, RecursionError)


def make_folders(words: Sequence[str], places: PlaceholderFolders) -> None:
    """Make the folders inside the working folder in which a command writes."""
    for path in named_paths(words):
        if path.text.startswith(f"{WORK}/"):
            places.real_path(path.text).parent.mkdir(parents=True, exist_ok=True)


def hash_named_files(words: Sequence[str], places: PlaceholderFolders) -> dict[str, str]:
    """Return the SHA-256 of every file and folder that a command names.

    The keys are paths with placeholders.  A missing file has an empty digest.
    """
    digests: dict[str, str] = {}
    for path in named_paths(words):
        name = path.text.rstrip("/")
        if name.startswith((PROJECT, WORK)) and name not in digests:
            digests[name] = _hash_path(places.real_path(name))
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
    """Append an action to the log and return its entry.

    The entry is on the disk when this function returns. A last line that a power failure has torn
    is cut off.
    """
    lines = _whole_lines(log) if log.exists() else []
    number = len(_parse_lines(lines, log, None)) + 1
    entry = LoggedAction(number, tuple(words), code=code, files=files)
    whole = "".join(f"{line}\n" for line in lines).encode()
    if log.exists() and log.stat().st_size != len(whole):
        write_text(log, whole.decode())
    _append_line(log, entry.line())
    return entry


# Former name, for programs that write a log.
append = append_action


def _append_line(log: Path, line: str) -> None:
    """Append a line to the log, on the disk; after an error the log is as before."""
    size = log.stat().st_size if log.exists() else 0
    # without a buffer: an error is raised here, and not when the file is closed
    with log.open("ab", buffering=0) as target:
        try:
            rest = f"{line}\n".encode()
            while rest:
                rest = rest[target.write(rest) :]
            os.fsync(target.fileno())
        except OSError as error:
            with suppress(OSError):
                target.truncate(size)
            text = f"not written: {error.strerror}; the action is done and not in the log"
            raise OSError(error.errno, text, str(log)) from error


def read_action_log(
    path: str | Path, places: PlaceholderFolders | None = None
) -> list[LoggedAction]:
    """Return the actions of a log; a torn last line is left out.

    Parameters
    ----------
    path : path
    places : PlaceholderFolders, optional
        As in `demand_allowed`.

    Raises
    ------
    ParseError
        A line is not an entry.
    ActionError
        An entry is not an action of the workbench.
    """
    return _parse_lines(_whole_lines(Path(path)), path, places)


def _whole_lines(path: Path) -> list[str]:
    """Return the lines of a log without a torn last one.

    A whole line ends with a line end, and is without a zero byte, which a power failure may leave
    in place of content that was not yet on the disk.
    """
    content = path.read_bytes()
    *lines, last = content.split(b"\n")
    if last and _is_entry(last):
        # the last line of a log that an editor has written
        lines.append(last)
    while lines and b"\0" in lines[-1]:
        del lines[-1]
    text = b"\n".join(lines)
    try:
        return text.decode().split("\n") if lines else []
    except UnicodeDecodeError as error:
        number = text[: error.start].count(b"\n") + 1
        raise ParseError(str(path), number, "bytes that are not UTF-8", _EXPECTED) from error


def _is_entry(line: bytes) -> bool:
    try:
        _parse_entry(line.decode())
    except _FAULTS:
        return False
    return True


def _parse_lines(
    lines: Sequence[str], path: str | Path, places: PlaceholderFolders | None
) -> list[LoggedAction]:
    """Return the entries of the lines of a log."""
    entries = []
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            entry = _parse_entry(line)
        except _FAULTS as error:
            raise ParseError(str(path), number, line[:60], _EXPECTED) from error
        demand_allowed(entry.words, places)
        for name in entry.files:
            if not is_inside_folders(name):
                raise ActionError(f"action {entry.number}: {name!r} leads out of the project")
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
    present = _hash_path(places.real_path(name))
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
        if entry.words[0] == "match" and "--paths" not in entry.words:
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
