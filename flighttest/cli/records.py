"""``aeromatch flight info | convert | manoeuvres | mark | plot``: what a recording holds, as
netCDF, what was flown when, as a figure.
"""

from __future__ import annotations

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    json_option,
    performed_by,
)
from flighttest.cli.group import names_option


@click.command("check")
@click.argument("record_file", metavar="RECORD", type=InputFile())
@names_option
@click.option(
    "--aircraft",
    "aircraft_file",
    type=InputFile(),
    help="Aircraft, TOML: places, noise and latency of its instruments to judge by; its geometry, "
    "mass and inertia are checked too.",
)
@click.option(
    "--database",
    "database_file",
    type=InputFile(),
    help="A-priori database, netCDF, of the aircraft given with --aircraft: its lift is compared "
    "with the weight, its reference quantities and control effects with aircraft and record.",
)
@click.option("-o", "--output", type=NewFile(), help="Write one self-contained HTML page.")
@json_option
@click.pass_context
@performed_by("flighttest.cli.actions.records:check_record")
def check_record_command() -> None:
    """Check signs, units, axes, clocks, sensors, delays and excitation of a record; exit code 1
    when errors are found.
    """


@click.command("info")
@click.argument("file", metavar="FILE", type=InputFile())
@names_option
@json_option
@performed_by("flighttest.cli.actions.contents:record_info")
def record_info_command() -> None:
    """Show what a recording of any format holds, before it is mapped: tables, clocks, columns and
    units.
    """


@click.command("convert")
@click.argument("file", metavar="FILE", type=InputFile())
@names_option
@click.option(
    "-o",
    "--output",
    required=True,
    type=NewFile(),
    help="NetCDF file to write; a record with canonical names.",
)
@json_option
@performed_by("flighttest.cli.actions.records:convert_record")
def convert_record_command() -> None:
    """Write a recording of any format as a netCDF record: one group per clock, canonical names, SI,
    faults flagged.
    """


@click.command("manoeuvres")
@click.argument("file", metavar="RECORD", type=InputFile())
@names_option
@click.option(
    "--table",
    "table_file",
    type=InputFile(),
    help="CSV or TOML with the columns record, kind, control, start, end; its rows of this record "
    "are shown.",
)
@click.option(
    "--find",
    is_flag=True,
    help="Search the movements of the controls even when the record carries marks.",
)
@click.option(
    "--modes", "of_modes", is_flag=True, help="The flight modes of the log of an autopilot."
)
@click.option(
    "-o",
    "--output",
    type=NewFile(),
    help="CSV to write; correct it and name it as manoeuvres in a project file.",
)
@click.option(
    "--figure",
    type=NewFile(),
    help="Draw the manoeuvres over controls and motion: png, svg or pdf.",
)
@json_option
@performed_by("flighttest.cli.actions.records:run_manoeuvres")
def manoeuvres_command() -> None:
    """Show the manoeuvres of a record: of a table, as it marks them, as found in the movements of
    its controls, or its flight modes.
    """


@click.command("mark")
@click.argument("table_file", metavar="TABLE", type=NewFile())
@click.argument("record", metavar="RECORD")
@click.option(
    "--row",
    type=click.IntRange(1),
    help="Row of the record in order of time, from 1, that is changed; without it one is added.",
)
@click.option("--kind", help="Kind of the manoeuvre, such as doublet, 3-2-1-1 or sweep.")
@click.option("--control", help="Control that is moved, such as elevator.")
@click.option("--span", nargs=2, type=float, help="Start and end. [s]")
@click.option("--note", help="Remark.")
@click.option("--remove", is_flag=True, help="Take the row out.")
@click.option(
    "--start-from",
    type=InputFile(),
    help="Record, whose own marks are taken first where the table has none of it.",
)
@names_option
@json_option
@performed_by("flighttest.cli.actions.records:run_mark")
def mark_command() -> None:
    """Add, change or remove one manoeuvre of RECORD in a TABLE (CSV), which is made when it is not
    there.

    A project that names the table as manoeuvres takes its rows in place of the marks that a record
    carries; a record without a row has its own.
    """


@click.command("plot")
@click.argument("file", metavar="FILE", type=InputFile())
@names_option
@click.option(
    "--channel",
    "channels",
    multiple=True,
    metavar="NAME",
    help="Channel to draw, may be repeated.  [default: a page of them]",
)
@click.option("--window", type=(float, float), help="Start and end of what is drawn [s].")
@click.option(
    "--table",
    "table_file",
    type=InputFile(),
    help="CSV or TOML with manoeuvres, in place of those that FILE carries.",
)
@click.option(
    "--record",
    metavar="NAME",
    help="Record whose rows of --table are drawn.  [default: FILE without its extension]",
)
@click.option(
    "-o", "--output", required=True, type=NewFile(), help="Figure to write: png, svg or pdf."
)
@json_option
@performed_by("flighttest.cli.actions.records:plot_record")
def plot_record_command() -> None:
    """Draw FILE over time: a record of any format, a path of flight reconstruct, or a fit of
    identify, select or fit.

    Manoeuvres are shaded and named. Without --channel the page shows motion, controls and engines.
    """
