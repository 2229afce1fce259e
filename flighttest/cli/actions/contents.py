"""Function that performs the command ``flight info``: what a recording of any format holds."""

from __future__ import annotations

import click

from flightmech.quantities import time_text
from flightmech.short_text import without_middle
from flightmech.support.console import (
    print_json,
    print_table,
    print_text,
)
from flighttest.records.files import contents

# on the terminal; --json has all: names of one reason, columns of a table, letters of a name
_NAMED, _MOST_ROWS, _LONGEST_NAME = 12, 1000, 100


def record_info(file: str, names: str | None, as_json: bool) -> None:
    """Perform the command ``info``."""
    found = contents(file, names)
    if as_json:
        print_json(found)
        return
    print_text(f"{found['file']}: {found['format']}")
    for key, text in found["facts"].items():
        print_text(f"  {key}: {text}")
    if "channels" in found:
        rows = [
            (c["channel"], c["content"], c["packets"], c.get("labels", ""))
            for c in found["channels"]
        ]
        print_table(
            ["channel", "content", "packets", "ARINC 429 labels as stored"],
            rows,
            right=["channel", "packets"],
        )
    for part in found["tables"]:
        span = (
            part["clock_fault"]
            or f"{part['samples']} samples, {part['rate']:.6g} Hz, {time_text(part['start'])} ... "
            f"{time_text(part['stop'])} s"
        )
        click.echo()
        rows = [
            (
                without_middle(c["column"], _LONGEST_NAME),
                without_middle(c["unit"], _LONGEST_NAME),
                _number(c["min"]),
                _number(c["max"]),
            )
            for c in part["columns"][:_MOST_ROWS]
        ]
        print_table(
            ["column", "unit", "min", "max"], rows, f"{part['table']}: {span}", right=["min", "max"]
        )
        left = len(part["columns"]) - _MOST_ROWS
        if left > 0:
            print_text(f"... {left} more columns; --json shows all")
        for slow in part["slower"]:
            text = (
                f"{slow['samples']} samples, {slow['rate']:.6g} Hz, in the rows of {part['table']}"
            )
            print_text(
                f"a slower clock, with blank cells between its samples: "
                f"{_some_of(slow['columns'])}: {text}"
            )
    for text in found["notes"]:
        print_text(f"! {text}")
    if found["left_out"]:
        print_text(f"\nleft out: {len(found['left_out'])}")
        for text in by_reason(found["left_out"]):
            print_text(f"  {text}")


def by_reason(left_out: list[dict[str, str]]) -> list[str]:
    """Return a line for each reason, with the names of the tables and columns that are left out."""
    names: dict[str, list[str]] = {}
    for one in left_out:
        names.setdefault(one["reason"], []).append(one["name"])
    return [f"{_some_of(places)}: {reason}" for reason, places in names.items()]


def _some_of(names: list[str]) -> str:
    """Return the first names, and the number of the others."""
    shown = ", ".join(without_middle(name, _LONGEST_NAME) for name in names[:_NAMED])
    return shown + f" and {len(names) - _NAMED} more" * (len(names) > _NAMED)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
