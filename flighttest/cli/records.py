"""``aeromatch flight info``, ``convert`` and ``manoeuvres``: what a recording holds, recordings as netCDF, what was flown when."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, progress, table

from .options import names_option

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@click.command()
@click.argument("file", metavar="FILE", type=InputFile())
@names_option
@json_option
def info(file: str, names: str | None, as_json: bool) -> None:
    """Show what a recording of any format holds, before it is mapped: tables, clocks, columns and units."""
    from ..records.file_contents import contents

    found = contents(file, names)
    if as_json:
        document(found)
        return
    click.echo(f"{found['file']}: {found['format']}")
    for key, text in found["facts"].items():
        click.echo(f"  {key}: {text}")
    if "channels" in found:
        rows = [(c["channel"], c["content"], c["packets"], c.get("labels", "")) for c in found["channels"]]
        table(["channel", "content", "packets", "ARINC 429 labels as stored"], rows, right=["channel", "packets"])
    for part in found["tables"]:
        span = part["clock_fault"] or f"{part['samples']} samples, {part['rate']:.6g} Hz, {part['start']:.6g} ... {part['stop']:.6g} s"
        click.echo()
        rows = [(c["column"], c["unit"], _number(c["min"]), _number(c["max"])) for c in part["columns"]]
        table(["column", "unit", "min", "max"], rows, f"{part['table']}: {span}", right=["min", "max"])
    for text in found["notes"]:
        click.echo(f"! {text}")


@click.command()
@click.argument("file", metavar="FILE", type=InputFile())
@names_option
@click.option("-o", "--output", required=True, type=NewFile(), help="netCDF file to write; a record with canonical names.")
@json_option
def convert(file: str, names: str | None, output: str, as_json: bool) -> None:
    """Write a recording of any format as a netCDF record: one group per clock, canonical names, SI, faults flagged."""
    from ..records.files import save_record
    from ..records.record import faults, read

    record = read(file, names)
    save_record(record, output)
    about = {
        "file": output,
        "leaves": {leaf: len(node.data_vars) for leaf, node in record.children.items()},
        "faults": faults(record),
        "absent": record.attrs["absent"].split(),
    }
    if as_json:
        document(about)
        return
    channels = sum(len(node.data_vars) for node in record.children.values())
    for text in faults(record):
        click.echo(f"! {text}")
    if record.attrs["absent"]:
        click.echo(f"not in the file: {record.attrs['absent']}")
    click.echo(f"written: {output}, {channels} channels in {len(record.children)} leaves")


@click.command()
@click.argument("file", metavar="RECORD", type=InputFile())
@names_option
@click.option(
    "--table",
    "table_file",
    type=InputFile(),
    help="CSV or TOML with the columns record, kind, control, start, end; its rows of this record are shown.",
)
@click.option("--find", is_flag=True, help="Search the movements of the controls even when the record carries marks.")
@click.option("-o", "--output", type=NewFile(), help="CSV to write; correct it and name it as manoeuvres in a project file.")
@click.option("--figure", type=NewFile(), help="Draw the manoeuvres over controls and motion: png, svg or pdf.")
@json_option
def manoeuvres(
    file: str, names: str | None, table_file: str | None, find: bool, output: str | None, figure: str | None, as_json: bool
) -> None:
    """Show the manoeuvres of a record: of a table, as the record marks them, or as found in the movements of its controls."""
    from ..manoeuvre_finding.figure import draw_manoeuvres
    from ..records.manoeuvre_table import write_manoeuvres
    from ..records.record import read

    with progress("read the record, find manoeuvres"):
        record, name = read(file, names), Path(file).stem
        source, found = _manoeuvres(record, name, table_file, find)
    if output:
        write_manoeuvres({name: found}, output)
    if figure:
        with progress("draw the figure"):
            draw_manoeuvres(record, found, figure)
    if as_json:
        document({"record": name, "source": source, "manoeuvres": found})
        return
    rows = [
        (number, m["manoeuvre"], m["control"], f"{m['start']:g}", f"{m['end']:g}", _number(m.get("confidence")), m["note"])
        for number, m in enumerate(found.to_dict("records"), start=1)
    ]
    columns = ["", "manoeuvre", "control", "start [s]", "end [s]", "confidence", "note"]
    table(columns, rows, f"{name}: {len(rows)} manoeuvres, {source}", right=["", "start [s]", "end [s]", "confidence"])
    for target in filter(None, (output, figure)):
        click.echo(f"written: {target}")


def _manoeuvres(record: xr.DataTree, name: str, table_file: str | None, find: bool) -> tuple[str, pd.DataFrame]:
    """Return where the manoeuvres of a record come from, and the manoeuvres."""
    from flightmech.errors import SchemaError, UnknownName

    from ..manoeuvre_finding.finding import find_manoeuvres
    from ..records import record as records
    from ..records.manoeuvre_table import read_manoeuvres

    if table_file and find:
        raise SchemaError("flight manoeuvres", ["--table and --find exclude each other; give one of them"])
    if table_file:
        given = read_manoeuvres(table_file)
        if name not in given:
            raise UnknownName(name, given, "record", f"{table_file} has no row for it")
        return f"from {table_file}", given[name]
    marks = records.manoeuvres(record)
    if len(marks) and not find:
        return "as the record marks them", marks
    return "found in the movements of the controls; to be confirmed", find_manoeuvres(record)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
