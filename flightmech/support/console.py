"""Parts that all command-line verbs share: options, tables, JSON output and progress on stderr."""

from __future__ import annotations

import functools
import importlib
import json
import math
import os
import re
import shlex
import shutil
import sys
import time
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any

import click

from flightmech.errors import near_names
from flightmech.support.atomic_write import resolve_file, resolve_folder
from flightmech.support.command_line.parameter_checks import check_parameters
from flightmech.support.command_line.table_layout import table_lines
from flightmech.support.input_files import is_regular

json_option = click.option(
    "--json", "as_json", is_flag=True, help="One JSON document on stdout, nothing else."
)
jobs_option = click.option(
    "-j",
    "--jobs",
    type=click.IntRange(1),
    default=lambda: os.cpu_count() or 1,
    show_default="one per core",
    help="Processes.",
)


class LazyGroup(click.Group):
    """A command group that imports the module of a verb when the verb is called.

    The help of the group imports the modules of all verbs.

    Parameters
    ----------
    package : str
        Package of the modules; empty: their names are complete.
    elsewhere : mapping of str to str
        Module of each verb.
    aliases : mapping of str to str, optional
        Verb of each alternative spelling. The help does not list alternative spellings.
    """

    def __init__(
        self,
        *args: Any,
        package: str,
        elsewhere: Mapping[str, str],
        aliases: Mapping[str, str] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(*args, **options)
        self._package, self._elsewhere, self._aliases = package, elsewhere, aliases or {}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the verbs of the group itself, then the verbs of other modules in order."""
        return [*super().list_commands(ctx), *self._elsewhere]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a verb."""
        cmd_name = self._aliases.get(cmd_name, cmd_name)
        if cmd_name not in self._elsewhere:
            return super().get_command(ctx, cmd_name)
        module = f"{self._package}.{self._elsewhere[cmd_name]}".lstrip(".")
        return find_command(importlib.import_module(module), cmd_name)


class InputFile(click.Path):
    """A file to read. If it does not exist, the error lists files of similar name.

    An option that takes several files takes one of them twice only with `may_repeat`.
    """

    def __init__(self, path_type: type[Path] | None = None, may_repeat: bool = False) -> None:
        super().__init__(exists=True, dir_okay=False, path_type=path_type)
        self.may_repeat = may_repeat

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path if it is an existing regular file."""
        path = Path(os.fsdecode(value))
        if path.is_dir():
            message = f"{str(value)!r} is a folder; give a file"
            if files := _file_names(path):
                message += f", such as {path / files[0]}"
            self.fail(message, param, ctx)
        # click would open a pipe and wait for its writer
        if path.exists() and not is_regular(path):
            message = f"{str(value)!r} is a named pipe or a device; give a regular file"
            self.fail(message, param, ctx)
        if not path.exists():
            self.fail(f"no file {str(value)!r}; {_suggest_files(path)}", param, ctx)
        return super().convert(value, param, ctx)


class FileOrFolder(InputFile):
    """A file to read, or a folder of files. If it does not exist, the error lists similar names."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path of an existing file or folder."""
        path = Path(os.fsdecode(value))
        if path.is_dir():
            return path
        if not path.exists():
            suggested = _suggest_files(path, with_folders=True)
            self.fail(f"no file or folder {str(value)!r}; {suggested}", param, ctx)
        return super().convert(value, param, ctx)


def _file_names(folder: Path, with_folders: bool = False) -> list[str]:
    return sorted(item.name for item in folder.iterdir() if with_folders or item.is_file())


def _suggest_files(path: Path, with_folders: bool = False) -> str:
    """Return the part of an error message that suggests files in place of a missing one."""
    folder = path.parent
    if not folder.is_dir():
        return (
            f"there is no folder {str(folder)!r} either; give its path from here, "
            f"{str(Path.cwd())!r}"
        )
    # stricter than the default of near_names, because file names are longer than keys
    near = near_names(path.name, _file_names(folder, with_folders), 3, cutoff=0.7)
    if near:
        return f"near it: {', '.join(str(folder / name) for name in near)}"
    return f"{str(folder.resolve())!r} holds no name like it; give its path from here"


class NewFile(click.Path):
    """A file to write. The check that it can be written comes before the work.

    With `may_replace` it may be the only input of the command, of which it is the edited form.
    """

    def __init__(self, may_replace: bool = False) -> None:
        super().__init__(dir_okay=False)
        self.may_replace = may_replace

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path if its folder exists and it is not a read-only file."""
        path = super().convert(value, param, ctx)
        folder = Path(os.fsdecode(path)).parent
        if not folder.is_dir():
            self.fail(f"no folder {str(folder)!r} for the file; make it first", param, ctx)
        try:
            resolve_file(os.fsdecode(path))
        except OSError as error:
            self.fail(f"{str(path)!r}: {error.strerror}", param, ctx)
        return path


class NewFolder(click.Path):
    """A folder to write as a whole.

    The check that an older folder of this name can be replaced comes before the work.
    """

    def __init__(self) -> None:
        super().__init__(file_okay=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path if the folder can be written."""
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        try:
            # a missing parent folder is created together with the folder
            if path.parent.is_dir():
                resolve_folder(path)
        except OSError as error:
            self.fail(f"{str(path)!r}: {error.strerror}", param, ctx)
        return path


def command_line(without: Collection[str] = ()) -> str:
    """Return the command line of this process, for the header of a report.

    Parameters
    ----------
    without : collection of str
        Flags to omit, because they do not change the report.
    """
    arguments = [argument for argument in sys.argv[1:] if argument not in without]
    return shlex.join(["aeromatch", *arguments])


# C0 and C1 control characters except tab and line feed
_ESCAPES = {
    code: f"\\x{code:02x}" for code in (*range(32), *range(127, 160)) if chr(code) not in "\t\n"
}
# Unicode characters that change the direction of writing (Bidi_Control)
_ESCAPES |= {
    code: f"\\u{code:04x}"
    for code in (0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))
}


def escape_control_characters(text: str) -> str:
    """Replace control characters of a text by their codes.

    Names from files then cannot move the cursor or change the direction of writing.

    Examples
    --------
    >>> print(escape_control_characters("q\\x1b[31m"))
    q\\x1b[31m
    """
    return text.translate(_ESCAPES)


# a line of a message that a reader, or a program, would take for a message of its own
_IMITATION = re.compile(r"\n(?=(?:error|warning|internal fault):)", re.IGNORECASE)


def escape_message(text: str) -> str:
    """Replace control characters of a message, and a line feed that would begin another message.

    A name from a file with such a line feed cannot imitate a line of the program.

    Examples
    --------
    >>> print(escape_message("unknown column 'q\\nerror: none'"))
    unknown column 'q\\nerror: none'
    """
    return _IMITATION.sub(r"\\n", escape_control_characters(text))


_JSON_TYPES = (str, int, bool, type(None))


def to_json_types(item: Any) -> Any:
    """Convert an object to types of JSON. NaN and infinities become null."""
    if type(item) in _JSON_TYPES:
        return item
    if isinstance(item, dict):
        return {str(key): to_json_types(value) for key, value in item.items()}
    if isinstance(item, list | tuple | set):
        return [to_json_types(value) for value in item]
    # a pandas DataFrame becomes a list of rows, recognised without an import of pandas
    if hasattr(item, "to_dict") and hasattr(item, "columns"):
        return [to_json_types(row) for row in item.reset_index().to_dict("records")]
    if hasattr(item, "tolist"):
        return to_json_types(item.tolist())
    if isinstance(item, float):
        return item if math.isfinite(item) else None
    # subclasses of str and int, for example members of an enumeration
    if isinstance(item, str | int):
        return item
    return str(item)


def print_json(item: Any) -> None:
    """Print one JSON document."""
    click.echo(json.dumps(to_json_types(item), indent=2, ensure_ascii=False))


def print_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    title: str = "",
    right: Sequence[str] = (),
) -> None:
    """Print a table on stdout.

    Parameters
    ----------
    columns : sequence of str
    rows : iterable of sequences
        One cell for each column. None gives an empty cell.
    title : str
        Line above the table.
    right : sequence of str
        Columns that are aligned to the right.
    """
    cells = [list(map(_cell_text, row)) for row in rows]
    # only a terminal has a width, a file or a pipe gets whole lines
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    lines = table_lines([list(columns), *cells], [name in right for name in columns], width)
    if title:
        click.echo(escape_control_characters(title))
    click.echo("\n".join(lines))


def _cell_text(cell: Any) -> str:
    return "" if cell is None else escape_message(str(cell)).expandtabs()


def count_text(count: int, noun: str) -> str:
    """Return a number and its noun, ``1 case`` or ``2 cases``."""
    if count == 1:
        return f"1 {noun}"
    return f"{count} {noun}s"


def print_text(text: str) -> None:
    """Print a text with names from files on stdout, see `escape_message`."""
    click.echo(escape_message(text))


def print_remark(text: str) -> None:
    """Print a message on stderr. Stdout holds only the result."""
    click.echo(escape_message(text), err=True)


@contextmanager
def timed_step(text: str) -> Iterator[None]:
    """Print the name of a step on stderr, and its duration at the end."""
    start = time.perf_counter()
    click.echo(f"  {text} ...", err=True, nl=False)
    duration = ""
    caught: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as caught:
            yield
        duration = f"  {time.perf_counter() - start:.1f} s"
    finally:
        click.echo(duration, err=True)
        # warnings of the step appear below its line, not in the middle of it
        for warning in caught:
            warnings.showwarning(
                warning.message, warning.category, warning.filename, warning.lineno
            )


def show_progress(text: str, lines: bool = False) -> AbstractContextManager[None]:
    """Return a context that prints the progress of a step if stderr is a terminal.

    Parameters
    ----------
    text : str
        Name of the step.
    lines : bool
        The step prints lines itself. The name then has its own line, and no duration follows.
    """
    if not sys.stderr.isatty():
        return nullcontext()
    if lines:
        print_remark(f"  {text} ...")
        return nullcontext()
    return timed_step(text)


def find_command(module: ModuleType, name: str) -> click.Command:
    """Return the command or group of a module with this name on the command line.

    Raises
    ------
    LookupError
        The module does not define a command of this name.
    """
    for value in vars(module).values():
        if isinstance(value, click.Command) and value.name == name:
            return value
    raise LookupError(f"{module.__name__} does not define the command {name!r}")


def performed_by(target: str) -> Callable[[Callable[[], None]], Callable[..., Any]]:
    """Return a decorator for a command that a function of another module performs.

    Parameters
    ----------
    target : str
        ``package.module:function``. The arguments of the function are the parameters of the command
        by name. If the command passes the context of click, it is the first argument.

    Notes
    -----
    The decorated function has the name and the help of the command. Its body is not called.
    """
    module, _, function = target.partition(":")

    def decorate(declaration: Callable[[], None]) -> Callable[..., Any]:
        @functools.wraps(declaration)
        def perform(*context: click.Context, **options: Any) -> Any:
            check_parameters(click.get_current_context(), options)
            # the module is imported when the command runs, not for the help
            return getattr(importlib.import_module(module), function)(*context, **options)

        vars(perform)["performed_by"] = target
        return perform

    return decorate


def collect_options(**classes: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that passes the options of a command as objects.

    Parameters
    ----------
    **classes : dataclass by name of an argument
        The fields of a dataclass have the names of options. The function receives one object in
        place of these options.

    Notes
    -----
    The attribute ``collected_options`` of the decorated function holds the dataclasses.
    """

    def decorate(perform: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(perform)
        def collect(*context: click.Context, **options: Any) -> Any:
            objects = {}
            for name, option_class in classes.items():
                values = {item.name: options.pop(item.name) for item in fields(option_class)}
                objects[name] = option_class(**values)
            return perform(*context, **objects, **options)

        vars(collect)["collected_options"] = classes
        return collect

    return decorate
