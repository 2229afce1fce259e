"""The verbs ``aeromatch flight design``, ``plan`` and ``coverage``: a test input, a flight-test
programme, and how much of it is done.
"""

from __future__ import annotations

from typing import Any

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    NewFolder,
    jobs_option,
    json_option,
    performed_by,
)
from flighttest.cli.group import names_option

_FILE = InputFile()


def prior_options(verb: Any) -> Any:
    """Return a verb with the aircraft and the a-priori database of a programme."""
    aircraft = click.option(
        "--aircraft",
        "aircraft_file",
        required=True,
        type=_FILE,
        help="Aircraft with its instruments, TOML.",
    )
    database = click.option(
        "--database",
        "database_file",
        required=True,
        type=_FILE,
        help="A-priori database with standard errors, netCDF.",
    )
    return aircraft(database(verb))


@click.command("design")
@click.argument("design_file", metavar="DESIGN", type=_FILE)
@click.option(
    "--aircraft",
    "aircraft_file",
    type=_FILE,
    help="Aircraft, TOML; needed when DESIGN has a condition.",
)
@click.option(
    "--database",
    "database_file",
    type=_FILE,
    help="A-priori database, netCDF; needed when DESIGN has a condition.",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(file_okay=False),
    help="Folder for the CSV files and the time table.",
)
@json_option
@performed_by("flighttest.cli.actions.programme:run_design")
def design_command() -> None:
    """Design a test input from DESIGN (TOML): amplitude inside limits, expected standard errors,
    files to play.
    """


@click.command("plan")
@click.argument("catalogue_file", metavar="CATALOGUE", type=_FILE)
@prior_options
@click.option(
    "--rows",
    "rows_file",
    type=_FILE,
    help="Gradients of the wanted rows, of `aeromatch pom spread`; needed when CATALOGUE has a "
    "[[wanted_row]].",
)
@click.option(
    "--draws",
    type=click.IntRange(0),
    default=40,
    show_default=True,
    help="Draws for the range of the standard errors; 0 without it.",
)
@jobs_option
@click.option(
    "-o",
    "--output",
    required=True,
    type=NewFolder(),
    help="Folder for order, expected errors, inputs and test cards.",
)
@json_option
@performed_by("flighttest.cli.actions.programme:run_plan")
def plan_command() -> None:
    """Plan a flight-test programme from CATALOGUE (TOML): which manoeuvres bring every wanted node
    and row below its bound in the least time.
    """


@click.command("coverage")
@click.argument("catalogue_file", metavar="CATALOGUE", type=_FILE)
@click.argument("record_files", metavar="RECORD...", nargs=-1, required=True, type=_FILE)
@click.option(
    "--plan",
    "plan_folder",
    required=True,
    type=click.Path(exists=True, file_okay=False),
    help="Folder that `flight plan` wrote.",
)
@prior_options
@names_option
@click.option(
    "--rows",
    "rows_file",
    type=_FILE,
    help="Gradients of the wanted rows, of `aeromatch pom spread`; needed when CATALOGUE has a "
    "[[wanted_row]].",
)
@jobs_option
@json_option
@performed_by("flighttest.cli.actions.programme:run_coverage")
def coverage_command() -> None:
    """State what the RECORDs flown so far have achieved of a plan from CATALOGUE, and which of its
    cards are still needed.
    """


@click.command("report")
@click.argument("plan_file", metavar="PLAN", type=InputFile())
@click.option("-o", "--output", type=NewFile(), help="Write one self-contained HTML page.")
@click.option(
    "--save",
    "folder",
    type=click.Path(file_okay=False),
    help="Folder for record, paths and fits as netCDF.",
)
@json_option
@click.pass_context
@performed_by("flighttest.cli.actions.programme:report_flight")
def report_flight_command() -> None:
    """Evaluate a flight as specified in PLAN (TOML); exit code 1 when a figure is outside its
    bounds or not determined.
    """


@click.command("modes")
@click.argument("record_file", metavar="RECORD", type=InputFile())
@click.argument("start", type=float)
@click.argument("stop", type=float)
@names_option
@click.option(
    "--channel",
    "channels",
    multiple=True,
    required=True,
    help="Channel that shows the motion; once for each.",
)
@click.option(
    "--input", "inputs", multiple=True, help="Control that moves in the window; once for each."
)
@click.option(
    "--aperiodic", is_flag=True, help="A real root, as roll and spiral, and not an oscillation."
)
@click.option("--level", is_flag=True, help="A constant under each channel and no straight line.")
@json_option
@click.pass_context
@performed_by("flighttest.cli.actions.programme:run_modes")
def modes_command() -> None:
    """Fit one eigenmotion to a record from START to STOP [s]; exit code 1 when its figures must not
    be used.
    """
