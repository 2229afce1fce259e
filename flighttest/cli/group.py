"""``aeromatch flight``: look at flight records, cut manoeuvres, reconstruct states."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from flightmech.support.console import (
    InputFile,
    LazyGroup,
    NewFile,
    jobs_option,
    json_option,
    performed_by,
)

_MAPS = Path(__file__).parents[1] / "records" / "readers" / "maps"


class MapFile(click.Path):
    """A name map: a TOML file that is there, or the name of a shipped one."""

    def __init__(self) -> None:
        super().__init__(exists=True, dir_okay=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name of a shipped map as it is."""
        shipped = sorted(file.stem for file in _MAPS.glob("*.toml"))
        if value in shipped and not os.path.exists(value):
            return value
        if not os.path.exists(value) and not str(value).endswith(".toml"):
            self.fail(
                f"no file {value!r} and no shipped map of that name; shipped are "
                f"{', '.join(shipped)}",
                param,
                ctx,
            )
        return super().convert(value, param, ctx)


names_option = click.option(
    "--names",
    type=MapFile(),
    help="Name map: a TOML file, or a shipped one (px4, ardupilot); not needed for canonical "
    "names.",
)
_RECORD = click.argument("record_file", metavar="RECORD", type=InputFile())
_NAMES = names_option
_ELSEWHERE = {
    "check": "records",
    "info": "records",
    "convert": "records",
    "manoeuvres": "records",
    "mark": "records",
    "plot": "records",
    "identify": "identify",
    "design": "programme",
    "plan": "programme",
    "coverage": "programme",
    "select": "identify",
    "join": "identify",
    "partition": "identify",
    "inertia": "identify",
    "tabulate": "identify",
    "report": "programme",
    "modes": "programme",
    "fit": "identify",
    "fit-linear": "identify",
    "validate": "validation",
    "follow": "follow",
    "ground-effect": "submodels",
    "stall": "submodels",
    "controls": "submodels",
    "engine": "submodels",
    "gear": "submodels",
    "actuator": "submodels",
    "balance": "special_tests",
    "markers": "special_tests",
    "multibody": "special_tests",
}  # verb: module
_SPELLINGS = {"maneuvers": "manoeuvres", "maneuver": "manoeuvres", "manoeuvre": "manoeuvres"}


@click.group(cls=LazyGroup, package=__package__, elsewhere=_ELSEWHERE, aliases=_SPELLINGS)
def flight() -> None:
    """Read flight records, reconstruct states, identify."""


@flight.command("show")
@_RECORD
@_NAMES
@json_option
@performed_by("flighttest.cli.actions.show:print_record")
def show_record_command() -> None:
    """Show channels, clocks, faults and manoeuvres of a record."""


@flight.command("cut")
@_RECORD
@click.argument("start", type=float)
@click.argument("stop", type=float)
@_NAMES
@click.option(
    "--rate",
    type=click.FloatRange(0.0, 10_000.0, min_open=True),
    default=50.0,
    show_default=True,
    help="Samples per second [Hz].",
)
@click.option("-o", "--output", required=True, type=NewFile(), help="NetCDF file to write.")
@json_option
@performed_by("flighttest.cli.actions.group:run_cut")
def cut_command() -> None:
    """Cut a manoeuvre from START to STOP [s]: every channel on one clock."""


@flight.command("reconstruct")
@click.argument("record_files", metavar="RECORD...", nargs=-1, required=True, type=InputFile())
@click.option(
    "--aircraft", "aircraft_file", required=True, type=InputFile(), help="Aircraft, TOML."
)
@_NAMES
@click.option(
    "--window",
    "windows",
    type=(float, float),
    multiple=True,
    help="Start and stop [s], of a single record. Default: all of it.",
)
@click.option(
    "--rate",
    type=click.FloatRange(0.0, 10_000.0, min_open=True),
    default=50.0,
    show_default=True,
    help="Samples per second [Hz].",
)
@click.option(
    "--biases",
    "biases_file",
    type=InputFile(),
    help="Reconstruction of another record; its instrument constants are the prior of a single "
    "record.",
)
@click.option(
    "--method",
    type=click.Choice(["smoother", "batch"]),
    default="smoother",
    show_default=True,
    help="Estimator: smoother for a noisy inertial unit; batch for output error, all records in "
    "one fit with common instruments.",
)
@click.option(
    "--free",
    multiple=True,
    metavar="NAME",
    help="Constant that a batch estimates from the readings alone; all others are held.",
)
@click.option(
    "--figure",
    type=NewFile(),
    help="Draw the data compatibility of a single record: png, svg or pdf.",
)
@jobs_option
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(),
    help="NetCDF file to write; a folder when there are several records.",
)
@json_option
@performed_by("flighttest.cli.actions.group:run_reconstruct")
def reconstruct_command() -> None:
    """Reconstruct the states of one record, or of all runs of a programme with common
    instruments.
    """
