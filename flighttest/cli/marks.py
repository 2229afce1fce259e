"""``aeromatch flight mark``: the table of manoeuvres, row by row."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, table

from .options import names_option

if TYPE_CHECKING:
    import pandas as pd

_SPAN = click.option("--span", nargs=2, type=float, help="Start and end. [s]")


@click.command()
@click.argument("table_file", metavar="TABLE", type=NewFile())
@click.argument("record", metavar="RECORD")
@click.option("--row", type=click.IntRange(1), help="Row of the record in order of time, from 1, that is changed; without it one is added.")
@click.option("--kind", help="What is flown, such as doublet, 3-2-1-1, sweep.")
@click.option("--control", help="Control that is moved, such as elevator.")
@_SPAN
@click.option("--note", help="Remark.")
@click.option("--remove", is_flag=True, help="Take the row out.")
@click.option("--start-from", type=InputFile(), help="Record, whose own marks are taken first where the table has none of it.")
@names_option
@json_option
def mark(
    table_file: str,
    record: str,
    row: int | None,
    remove: bool,
    start_from: str | None,
    names: str | None,
    as_json: bool,
    span: tuple[float, float] | None,
    **given: str | None,
) -> None:
    """Add, change or remove one manoeuvre of RECORD in a TABLE (CSV), which is made when it is not there.

    A project that names the table as manoeuvres takes its rows in place of the marks that a record carries; a record without a row
    has its own.
    """
    from ..records.manoeuvre_table import edit_manoeuvres
    from ..records.record import manoeuvres, read

    own = manoeuvres(read(start_from, names)) if start_from else None
    change: dict[str, Any] = {name: item for name, item in given.items() if item is not None}
    if span is not None:
        change |= {"start": span[0], "end": span[1]}
    rows = edit_manoeuvres(table_file, record, row, None if remove else change, own)
    if as_json:
        document({"table": table_file, "record": record, "manoeuvres": rows})
        return
    table(["", "manoeuvre", "control", "start [s]", "end [s]", "note"], _lines(rows), f"{record}: {len(rows)} manoeuvres in {table_file}")


def _lines(rows: pd.DataFrame) -> list[tuple[Any, ...]]:
    return [
        (number, m["manoeuvre"], m["control"], f"{m['start']:g}", f"{m['end']:g}", m["note"])
        for number, m in enumerate(rows.to_dict("records"), start=1)
    ]
