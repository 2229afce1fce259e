"""What every command-line verb shares: a table for people, ``--json`` for programs, progress on stderr."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import click

json_option = click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout, nothing else.")


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

    sheet = Table(title=title or None, title_justify="left", box=None, pad_edge=False, header_style="bold")
    for column in columns:
        sheet.add_column(column, justify="right" if column in right else "left", no_wrap=column == columns[0])
    for row in rows:
        sheet.add_row(*(Text("" if cell is None else str(cell)) for cell in row))
    wide = Console().width if sys.stdout.isatty() else 160
    Console(width=wide).print(sheet)


def remark(text: str) -> None:
    """Say something on stderr, so that stdout stays clean."""
    click.echo(text, err=True)
