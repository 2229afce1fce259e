"""The verb ``aeromatch flight check``: the data quality of a record."""

from __future__ import annotations

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, progress

from .options import names_option


@click.command()
@click.argument("record_file", metavar="RECORD", type=InputFile())
@names_option
@click.option(
    "--aircraft",
    "aircraft_file",
    type=InputFile(),
    help="Aircraft, TOML: places, noise and latency of its instruments to judge by; its geometry, mass and inertia are checked too.",
)
@click.option(
    "--database",
    "database_file",
    type=InputFile(),
    help="A-priori database, netCDF, of the aircraft given with --aircraft: the weight is compared with its lift.",
)
@click.option("-o", "--output", type=NewFile(), help="Write one self-contained HTML page.")
@json_option
@click.pass_context
def check(
    ctx: click.Context,
    record_file: str,
    names: str | None,
    aircraft_file: str | None,
    database_file: str | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Check signs, units, axes, clocks, sensors, delays and excitation of a record; exit code 1 when errors are found."""
    from aerodb import open as open_database
    from flightmech import read_aircraft

    from ..quality.assessment import assess
    from ..quality.page import write_page
    from ..records.record import read

    with progress("read and check the record"):
        aircraft = read_aircraft(aircraft_file) if aircraft_file else None
        quality = assess(read(record_file, names), aircraft, open_database(database_file) if database_file else None)
    if output:
        write_page(quality, output)
    if as_json:
        document(quality.as_dict())
    else:
        click.echo(quality.report())
        if output:
            click.echo(f"\nwritten: {output}")
    ctx.exit(0 if quality.usable else 1)
