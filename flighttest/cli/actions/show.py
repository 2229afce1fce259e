"""Function that performs the command ``flight show``."""

from __future__ import annotations

from typing import Any

import click

from flightmech.support.console import print_json, print_table, print_text
from flighttest.cli.actions.contents import by_reason
from flighttest.records.listing import record_listing
from flighttest.records.reading import read_arrays


def print_record(record_file: str, names: str | None, as_json: bool) -> None:
    """Perform the command ``show``."""
    found = record_listing(read_arrays(record_file, names))
    facts, channels, flown = found["facts"], found["channels"], found["manoeuvres"]
    if as_json:
        rest = {key: found[key] for key in ("faults", "unmapped", "left_out")}
        print_json(
            {**facts, "channels": _numbered(channels), "manoeuvres": _numbered(flown), **rest}
        )
        return
    rows = [
        (
            *(f"{c['leaf']}/{c['channel']}", f"{c['rate']:g}", f"{c['start']:g} ... {c['stop']:g}"),
            *(f"{c['min']:.5g}", f"{c['max']:.5g}", c["units"], c["calibration"]),
        )
        for c in channels
    ]
    title = str(facts.get("title", record_file))
    print_table(
        ["channel", "Hz", "time [s]", "min", "max", "unit", "from"],
        rows,
        title,
        right=["Hz", "min", "max"],
    )
    if flown:
        click.echo()
        print_table(
            ["manoeuvre", "control", "start [s]", "end [s]", "note"],
            [
                (m["manoeuvre"], m["control"], f"{m['start']:g}", f"{m['end']:g}", m["note"])
                for m in flown
            ],
            right=["start [s]", "end [s]"],
        )
    for text in found["faults"]:
        click.echo(f"! {text}")
    if found["unmapped"]:
        click.echo(f"columns the name map leaves out: {', '.join(found['unmapped'])}")
    for text in by_reason(found["left_out"]):
        print_text(f"left out: {text}")


def _numbered(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows as `print_json` prints a table: with their number."""
    return [{"index": number, **row} for number, row in enumerate(rows)]
