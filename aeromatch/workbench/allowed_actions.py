"""Commands that the page and a log may call, and the folders of their files.

A command is read by the parser of the command line itself. So every spelling of an option is known
as that option, and each path is checked that the command would get.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import click
import tomlkit
from tomlkit.exceptions import TOMLKitError

from aeromatch.drafting.previous import DRAFT_FOLDER
from aeromatch.drafting.sources import FILES
from flightmech.errors import AeromatchError
from flightmech.support.console import InputFile

PROJECT, WORK = "{project}", "{work}"
# Files and folders in the working folder that only the server writes.
_OWN_FILES = {"token", "actions.jsonl", "jobs"}
"""Placeholders of the folder of the project file and of the working folder, in commands and log."""

VERBS: tuple[tuple[str, ...], ...] = (
    ("init",),
    ("set",),
    ("flight", "mark"),
    ("flight", "manoeuvres"),
    ("flight", "reconstruct"),
    ("flight", "identify"),
    ("flight", "select"),
    ("flight", "fit-linear"),
    ("flight", "validate"),
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

# What `aeromatch init` writes into its folder.
_DRAFTED = (*FILES, "cases", DRAFT_FOLDER)
# Options that let other programs work: processes of a cluster, the commands of another log.
_REFUSED = {"scheduler": "--scheduler", "actions": "--actions"}
# An option of texts with a file behind the sign: --model NAME=FILE.fmu.
_NAMED_FILE = re.compile(r"NAME=FILE")
# Texts that `aeromatch set` writes into a file of the project, where they may be paths.
_VALUES_OF_SET = ("value", "also")
# Beginning of a path: ~/ ~user/ C:\\
_HOME_OR_DRIVE = re.compile(r"(?:~\w*|[A-Za-z]:)[\\/]")


class ActionError(AeromatchError):
    """A command that the workbench does not carry out, or a log that does not fit the project."""


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

    def real_path(self, name: str) -> Path:
        """Return the path of a name with a placeholder, or of one relative to the project."""
        return self.project / self.real([name])[0]

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

    def holds(self, path: Path) -> bool:
        """Return whether a path, after following links, is in one of the folders."""
        real = Path(os.path.realpath(path))
        folders = (self.project, self.work)
        return any(real.is_relative_to(os.path.realpath(folder)) for folder in folders)

    def is_own(self, path: Path) -> bool:
        """Return whether a path, after following links, is token, log or jobs of the workbench.

        A command of the log of others would choose the token, or the actions of the next replay.
        """
        real, work = Path(os.path.realpath(path)), Path(os.path.realpath(self.work))
        inner = real.relative_to(work).parts if real.is_relative_to(work) else ()
        return bool(inner) and inner[0].casefold() in _OWN_FILES


@dataclass(frozen=True)
class ActionPath:
    """A file or folder that a command names.

    Attributes
    ----------
    text : str
        Path with a placeholder, or relative to the folder of the project.
    written : bool
        Whether the command may write there.
    """

    text: str
    written: bool


def demand_allowed(words: Sequence[str], places: PlaceholderFolders | None = None) -> None:
    """Raise if a command is not one of `VERBS`, or names a path outside of the folders.

    Parameters
    ----------
    words : sequence of str
        Words of the command, with placeholders.
    places : PlaceholderFolders, optional
        With them a file to write is refused too if a link leads out of the folders.

    Raises
    ------
    ActionError
    """
    for path in named_paths(words):
        if _leaves_folders(path.text):
            raise ActionError(
                f"{path.text!r} leads out of the project; begin it with {PROJECT}/ or {WORK}/"
            )
        if places is None or not path.written:
            continue
        files = _written_files(words, places.real_path(path.text))
        if not all(map(places.holds, files)):
            raise ActionError(
                f"{path.text!r} leads out of the project by a link; give a file in its folders"
            )
        if any(map(places.is_own, files)):
            raise ActionError(f"{path.text!r} is a file of the workbench itself; give another name")


def _written_files(words: Sequence[str], path: Path) -> list[Path]:
    """Return a path and, for a folder of `aeromatch init`, its files, which it may replace."""
    if words[0] == "init" and path.is_dir():
        return [path, *path.iterdir()]
    return [path]


def named_paths(words: Sequence[str]) -> list[ActionPath]:
    """Return the files and folders that a command names.

    Raises
    ------
    ActionError
        The words are not a command of `VERBS`, or have an option that is refused.
    """
    _demand_words(words)
    if not any(tuple(words[: len(verb)]) == verb for verb in VERBS):
        allowed = ", ".join(map(" ".join, VERBS))
        raise ActionError(f"no action {' '.join(words[:2])!r}; there are: {allowed}")
    paths: list[ActionPath] = []
    for parameter, texts in _parse_command(words):
        name = str(parameter.name)
        if name in _REFUSED and texts:
            raise ActionError(
                f"{_REFUSED[name]} is not an option of an action: it lets other programs work; "
                f"leave it out"
            )
        if words[0] == "init" and name == "folder":
            for text in texts:
                paths += [ActionPath(f"{text.rstrip('/')}/{item}", True) for item in _DRAFTED]
        elif isinstance(parameter.type, click.Path):
            # `aeromatch set` writes the file that it reads
            reads = isinstance(parameter.type, InputFile) or parameter.type.exists
            written = not reads or words[0] == "set"
            paths += [ActionPath(text, written) for text in texts]
        elif _NAMED_FILE.match(str(parameter.metavar or "")):
            # the name ends at the first sign, as in the command
            files = [text.partition("=")[2] or text for text in texts]
            paths += [ActionPath(file, False) for file in files]
        elif words[0] == "set" and name in _VALUES_OF_SET:
            _demand_inner_values(texts)
    return paths


def _demand_words(words: Sequence[str]) -> None:
    """Raise if an action is not a list of words that a command line can have."""
    if not words or not all(isinstance(word, str) for word in words):
        raise ActionError("an action is a list of words, such as ['flight', 'mark', ...]")
    for word in words:
        if not is_writable_text(word):
            raise ActionError(
                f"{word!r} has a zero byte or half a surrogate pair; a command line has neither"
            )


def is_writable_text(text: str) -> bool:
    """Return whether a text has no zero byte and no half of a surrogate pair."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return "\0" not in text


def _parse_command(words: Sequence[str]) -> Iterator[tuple[click.Parameter, list[str]]]:
    """Yield the parameters of a command with the texts that they get, none of them converted.

    Conversion would demand the files that an earlier action of a log makes.
    """
    # The command line stands behind this folder in the chain, so it is found by its name.
    command: click.Command = import_module("aeromatch.cli.command").cli
    context: click.Context | None = None
    rest = list(words)
    try:
        while True:
            context = click.Context(
                command, parent=context, info_name=command.name, **command.context_settings
            )
            given, rest, _ = command.make_parser(context).parse_args(rest)
            for parameter in command.get_params(context):
                yield parameter, list(_texts(given.get(str(parameter.name))))
            if not isinstance(command, click.Group):
                break
            if not rest:
                raise ActionError(f"{shlex.join(words)!r} has no verb; name one")
            _, found, rest = command.resolve_command(context, rest)
            assert found is not None
            command = found
    except click.ClickException as error:
        raise ActionError(f"{shlex.join(words)}: {error.format_message()}") from error
    if rest:
        raise ActionError(f"{shlex.join(words)}: {rest[0]!r} is one word too many; leave it out")


def _texts(given: Any) -> Iterator[str]:
    """Yield the texts in the value of a parameter, which may be a list of lists."""
    if isinstance(given, str):
        yield given
    elif isinstance(given, list | tuple):
        for item in given:
            yield from _texts(item)


def _demand_inner_values(texts: Iterable[str]) -> None:
    """Raise if a value for a file of the project is a path out of it.

    A path of a file is relative to the folder of the file.
    """
    for text in texts:
        for value in (text, *_strings_of(text)):
            if _leaves_upward(value):
                raise ActionError(
                    f"{value!r} leads out of the project; change such a key with aeromatch set"
                )


def demand_inner_content(content: Any, depth: int = 0) -> None:
    """Raise if a text in the content of a TOML file is a path out of the folder of the project.

    Parameters
    ----------
    content : object
        Plain content of the file.
    depth : int
        Number of folders between the project and the file, each of which a path may leave.

    Raises
    ------
    ActionError
    """
    for text in _strings_in(content):
        inner = text
        for _ in range(depth):
            inner = inner.removeprefix("../")
        if _leaves_upward(inner):
            raise ActionError(
                f"{text!r} leads out of the project; put the file that it names into the folder "
                f"of the project"
            )


def _strings_of(text: str) -> Iterator[str]:
    """Yield the texts in a value of TOML; none of a value that is only a text."""
    try:
        value = tomlkit.value(text).unwrap()
    except (TOMLKitError, ValueError, AttributeError):
        return
    yield from _strings_in(value)


def _strings_in(value: Any) -> Iterator[str]:
    """Yield the texts in the plain content of a TOML file."""
    pending = [value]
    while pending:
        item = pending.pop()
        if isinstance(item, str):
            yield item
        elif isinstance(item, dict):
            pending += item.values()
        elif isinstance(item, list):
            pending += item


def is_inside_folders(name: str) -> bool:
    """Return whether a name begins with a placeholder and stays in its folder."""
    return name.partition("/")[0] in (PROJECT, WORK) and not _leaves_folders(name)


def _leaves_folders(path: str) -> bool:
    """Return whether a path of a command may be outside of the folders.

    A placeholder is followed by a slash: {project}2 is another folder.
    """
    if path in (PROJECT, WORK):
        return False
    start, slash, inner = path.partition("/")
    if slash and start in (PROJECT, WORK):
        path = inner
    return PROJECT in path or WORK in path or _leaves_upward(path)


def _leaves_upward(path: str) -> bool:
    """Return whether a path is absolute, begins with a home folder, or goes upward."""
    if path.startswith(("/", "\\")) or _HOME_OR_DRIVE.match(path):
        return True
    return ".." in re.split(r"[\\/]", path)
