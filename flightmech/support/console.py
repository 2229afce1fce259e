"""What every command-line verb shares: a table for people, ``--json`` for programs, progress on
stderr.
"""

from __future__ import annotations

import functools
import gc
import importlib
import json
import math
import os
import shlex
import shutil
import sys
import time
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from types import ModuleType
from typing import Any

import click

from flightmech.errors import near_names
from flightmech.support.atomic_write import resolve_file, resolve_folder

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
    """A command group that imports the modules of its verbs when these are called, or all of them
    for its help.

    Parameters
    ----------
    package : str
        Where the modules are.
    elsewhere : mapping of str to str
        Verb, and the module that declares it.
    aliases : mapping of str to str, optional
        Other spellings of verbs, which the help does not list.
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
        """Return the verbs of the module of the group, then those of others in their order."""
        return [*super().list_commands(ctx), *self._elsewhere]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a verb, imported now."""
        cmd_name = self._aliases.get(cmd_name, cmd_name)
        if cmd_name not in self._elsewhere:
            return super().get_command(ctx, cmd_name)
        module = importlib.import_module(f"{self._package}.{self._elsewhere[cmd_name]}")
        return find_command(module, cmd_name)


class InputFile(click.Path):
    """A file to read; where there is none, the error names those of the folder that are spelt
    alike.
    """

    def __init__(self, path_type: type[Path] | None = None) -> None:
        super().__init__(exists=True, dir_okay=False, path_type=path_type)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name when the file is there."""
        path = Path(os.fsdecode(value))
        if path.is_dir():
            inside = sorted(item.name for item in path.iterdir() if item.is_file())
            self.fail(
                f"{str(value)!r} is a folder; give a file"
                + (f", such as {path / inside[0]}" if inside else ""),
                param,
                ctx,
            )
        if path.exists() and not path.is_file():
            self.fail(
                f"{str(value)!r} is a named pipe or a device; give a regular file", param, ctx
            )
        if not path.exists():
            self.fail(f"no file {str(value)!r}; {_neighbours(path)}", param, ctx)
        return super().convert(value, param, ctx)


def _neighbours(path: Path) -> str:
    """Return what there is in place of a file that is missing."""
    if not path.parent.is_dir():
        return (
            f"there is no folder {str(path.parent)!r} either; give its path from here, "
            f"{str(Path.cwd())!r}"
        )
    names = sorted(item.name for item in path.parent.iterdir() if item.is_file())
    near = near_names(path.name, names, 3, cutoff=0.7)
    if near:
        return f"near it: {', '.join(str(path.parent / name) for name in near)}"
    return f"{str(path.parent.resolve())!r} holds no name like it; give its path from here"


class NewFile(click.Path):
    """A file to write: that it can be is checked before the work begins."""

    def __init__(self) -> None:
        super().__init__(dir_okay=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name when its folder is there, and no file that is read-only."""

        found = super().convert(value, param, ctx)
        folder = Path(os.fsdecode(found)).parent
        if not folder.is_dir():
            self.fail(f"no folder {str(folder)!r} for the file; make it first", param, ctx)
        try:
            resolve_file(os.fsdecode(found))
        except OSError as error:
            self.fail(f"{str(found)!r}: {error.strerror}", param, ctx)
        return found


class NewFolder(click.Path):
    """A folder to write as a whole: that an older one can be exchanged is checked before the work
    begins.
    """

    def __init__(self) -> None:
        super().__init__(file_okay=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name when nothing stands in the way."""

        found = Path(os.fsdecode(super().convert(value, param, ctx)))
        try:
            if found.parent.is_dir():  # it is made with the folder
                resolve_folder(found)
        except OSError as error:
            self.fail(f"{str(found)!r}: {error.strerror}", param, ctx)
        return found


def command_line(without: Collection[str] = ()) -> str:
    """Return the command as it was given, for a report to state how it was made; `without` flags
    that change nothing in it.
    """

    return shlex.join(["aeromatch", *(word for word in sys.argv[1:] if word not in without)])


_UNSEEN = {
    code: f"\\x{code:02x}" for code in (*range(32), *range(127, 160)) if chr(code) not in "\t\n"
}
_UNSEEN |= {
    code: f"\\u{code:04x}"
    for code in (0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))
}


def escape_control_characters(text: str) -> str:
    """Return a text with control characters, also those that turn the direction of writing, as
    their codes: no name moves a cursor.

    Examples
    --------
    >>> print(printable("q\\x1b[31m"))
    q\\x1b[31m
    """
    return text.translate(_UNSEEN)


_ENDLESS = 100_000  # columns: a line that goes to a file or another program is not broken


_AS_THEY_ARE = (str, int, bool, type(None))


def to_json_types(item: Any) -> Any:
    """Return `item` made of types that JSON knows; NaN and infinities become null."""
    if type(item) in _AS_THEY_ARE:
        return item
    if isinstance(item, dict):
        return {str(key): to_json_types(value) for key, value in item.items()}
    if isinstance(item, list | tuple | set):
        return [to_json_types(value) for value in item]
    if hasattr(item, "to_dict") and hasattr(item, "columns"):
        return [to_json_types(row) for row in item.reset_index().to_dict("records")]
    if hasattr(item, "tolist"):
        return to_json_types(item.tolist())
    if isinstance(item, float):
        return item if math.isfinite(item) else None
    return item if isinstance(item, str | int | bool) or item is None else str(item)


def print_json(item: Any) -> None:
    """Print one JSON document."""

    click.echo(json.dumps(to_json_types(item), indent=2, ensure_ascii=False))


def print_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    title: str = "",
    right: Sequence[str] = (),
) -> None:
    """Print a table; columns named in `right` are set flush right."""
    cells = [
        ["" if cell is None else escape_control_characters(str(cell)) for cell in row]
        for row in rows
    ]
    broken_at = _width() if sys.stdout.isatty() else None
    lines = _plain_lines(columns, cells, right, broken_at)
    if title:
        click.echo(escape_control_characters(title))
    click.echo("\n".join(_rich_lines(columns, cells, right, broken_at) if lines is None else lines))


_GAP = "  "


def _plain_lines(
    columns: Sequence[str], cells: list[list[str]], right: Sequence[str], width: int | None
) -> list[str] | None:
    """Return the lines of a table of ASCII text that fits into `width` columns; None for any other,
    which takes the package rich.

    That package, whose import takes as long as half of a verb that only shows, would print the
    same.
    """
    lines = [list(columns), *cells]
    if any(
        len(line) != len(columns)
        or not all(text.isascii() and (text.isprintable() or not text) for text in line)
        for line in lines
    ):
        return None
    widths = [max(map(len, column)) for column in zip(*lines)]
    if not widths or (width is not None and sum(widths) + len(_GAP) * (len(widths) - 1) > width):
        return None
    flush_right = [column in right for column in columns]
    head, *below = [
        _GAP.join(
            text.rstrip().rjust(room) if is_right else text.ljust(room)
            for text, room, is_right in zip(line, widths, flush_right)
        ).rstrip()
        for line in lines
    ]
    return [click.style(head, bold=True) if width is not None else head, *below]


def _width() -> int:
    """Return how many columns the terminal has."""

    return shutil.get_terminal_size().columns


def _rich_lines(
    columns: Sequence[str], cells: list[list[str]], right: Sequence[str], width: int | None
) -> list[str]:
    """Return the lines of any table: letters of two columns each, and lines broken at `width`."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    sheet = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        sheet.add_column(
            Text(column),
            justify="right" if column in right else "left",
            no_wrap=column == columns[0],
        )
    for row in cells:
        sheet.add_row(*map(Text, row))
    console = Console(width=None if width is not None else _ENDLESS)
    with console.capture() as capture:
        console.print(sheet)
    return [line.rstrip() for line in capture.get().splitlines()]


@contextmanager
def without_gc() -> Iterator[None]:
    """Leave out Python's search for circles of objects, a twentieth of the time of a verb that
    reads one file, prints it and ends.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def print_remark(text: str) -> None:
    """Print a message on stderr, so that stdout stays clean."""
    click.echo(escape_control_characters(text), err=True)


@contextmanager
def timed_step(text: str) -> Iterator[None]:
    """Report on stderr what is being done, and how long it took."""
    start = time.perf_counter()
    click.echo(f"  {text} ...", err=True, nl=False)
    taken = ""
    caught: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as caught:
            yield
        taken = f"  {time.perf_counter() - start:.1f} s"
    finally:
        click.echo(taken, err=True)
        for warning in caught:  # after the line, not in the middle of it
            warnings.showwarning(
                warning.message, warning.category, warning.filename, warning.lineno
            )


def show_progress(text: str, lines: bool = False) -> AbstractContextManager[None]:
    """Return `timed_step` on a terminal; where nobody watches, nothing is printed and warnings are left
    alone.

    With `lines` the work prints lines of its own: the text has a line to itself, and no time
    follows.
    """
    if not sys.stderr.isatty():
        return nullcontext()
    if lines:
        print_remark(f"  {text} ...")
        return nullcontext()
    return timed_step(text)


def find_command(module: ModuleType, name: str) -> click.Command:
    """Return the command or group of a module that has a given name on the command line.

    Raises
    ------
    LookupError
        The module does not define a command of that name.
    """
    for value in vars(module).values():
        if isinstance(value, click.Command) and value.name == name:
            return value
    raise LookupError(f"{module.__name__} does not define the command {name!r}")


def performed_by(target: str) -> Callable[[Callable[[], None]], Callable[..., Any]]:
    """Return a decorator that has a command performed by a function of another module.

    Parameters
    ----------
    target : str
        ``package.module:function``.  The function takes the parameters of the command by name, and
        the context of click first if the command passes it.

    Notes
    -----
    The decorated function has the name and the help of the command; its body is not called.
    """
    module, _, function = target.partition(":")

    def decorate(declaration: Callable[[], None]) -> Callable[..., Any]:
        @functools.wraps(declaration)
        def perform(*context: click.Context, **options: Any) -> Any:
            return getattr(importlib.import_module(module), function)(*context, **options)

        vars(perform)["performed_by"] = target
        return perform

    return decorate
