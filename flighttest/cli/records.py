"""``aeromatch flight info`` and ``convert``: what a recording holds, and recordings of any format as netCDF."""

from __future__ import annotations

import click

from flightmech.support.console import NewFile, document, json_option, table

from .options import names_option


@click.command()
@click.argument("file", metavar="FILE", type=click.Path(exists=True, dir_okay=False))
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
@click.argument("file", metavar="FILE", type=click.Path(exists=True, dir_okay=False))
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


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
