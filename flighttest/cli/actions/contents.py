"""Function that performs the command ``flight info``: what a recording of any format holds."""

from __future__ import annotations

import click

from flightmech.support.console import (
    print_json,
    print_table,
    print_text,
)
from flighttest.records.files import contents

_NAMED = 12  # names of one reason on the terminal; --json has all


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
            or f"{part['samples']} samples, {part['rate']:.6g} Hz, {part['start']:.6g} ... "
            f"{part['stop']:.6g} s"
        )
        click.echo()
        rows = [
            (c["column"], c["unit"], _number(c["min"]), _number(c["max"])) for c in part["columns"]
        ]
        print_table(
            ["column", "unit", "min", "max"], rows, f"{part['table']}: {span}", right=["min", "max"]
        )
        for slow in part["slower"]:
            text = (
                f"{slow['samples']} samples, {slow['rate']:.6g} Hz, in the rows of {part['table']}"
            )
            print_text(
                f"a slower clock, with blank cells between its samples: "
                f"{', '.join(slow['columns'])}: {text}"
            )
    for text in found["notes"]:
        print_text(f"! {text}")
    if found["left_out"]:
        print_text(f"\nleft out: {len(found['left_out'])}")
        for text in _by_reason(found["left_out"]):
            print_text(f"  {text}")


def _by_reason(left_out: list[dict[str, str]]) -> list[str]:
    """Return a line for each reason, with the names of the tables and columns that are left out."""
    names: dict[str, list[str]] = {}
    for one in left_out:
        names.setdefault(one["reason"], []).append(one["name"])
    return [
        f"{', '.join(places[:_NAMED])}"
        f"{f' and {len(places) - _NAMED} more' * (len(places) > _NAMED)}: {reason}"
        for reason, places in names.items()
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
