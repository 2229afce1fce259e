"""What every command-line verb shares: a table for people, ``--json`` for programs, progress on stderr."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import click

json_option = click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout, nothing else.")
jobs_option = click.option(
    "-j", "--jobs", type=click.IntRange(1), default=lambda: os.cpu_count() or 1, show_default="one per core", help="Processes."
)


class NewFile(click.Path):
    """A file to write: its folder must exist, which is checked before the work begins."""

    def __init__(self) -> None:
        super().__init__(dir_okay=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name when its folder is there."""
        found = super().convert(value, param, ctx)
        folder = Path(os.fsdecode(found)).parent
        if not folder.is_dir():
            self.fail(f"no folder {str(folder)!r} for the file; make it first", param, ctx)
        return found


def command_line() -> str:
    """Return the command as it was given, for a report to state how it was made."""
    return shlex.join(["aeromatch", *sys.argv[1:]])


_ENDLESS = 100_000  # columns: a line that goes to a file or another program is not broken


def plain(item: Any) -> Any:
    """Return `item` made of types that JSON knows; NaN and infinities become null."""
    if isinstance(item, dict):
        return {str(key): plain(value) for key, value in item.items()}
    if isinstance(item, list | tuple | set):
        return [plain(value) for value in item]
    if hasattr(item, "to_dict") and hasattr(item, "columns"):
        return [plain(row) for row in item.reset_index().to_dict("records")]
    if hasattr(item, "tolist"):
        return plain(item.tolist())
    if isinstance(item, float):
        return item if math.isfinite(item) else None
    return item if isinstance(item, str | int | bool) or item is None else str(item)


def document(item: Any) -> None:
    """Print one JSON document."""
    click.echo(json.dumps(plain(item), indent=2, ensure_ascii=False))


def table(columns: Sequence[str], rows: Iterable[Sequence[Any]], title: str = "", right: Sequence[str] = ()) -> None:
    """Print a table; columns named in `right` are set flush right."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    sheet = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        sheet.add_column(Text(column), justify="right" if column in right else "left", no_wrap=column == columns[0])
    for row in rows:
        sheet.add_row(*(Text("" if cell is None else str(cell)) for cell in row))
    console = Console(width=None if sys.stdout.isatty() else _ENDLESS)
    with console.capture() as capture:
        console.print(sheet)
    if title:
        click.echo(title)
    click.echo("\n".join(line.rstrip() for line in capture.get().splitlines()))


def remark(text: str) -> None:
    """Print a message on stderr, so that stdout stays clean."""
    click.echo(text, err=True)
