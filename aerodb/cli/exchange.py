"""The verbs ``aeromatch db export`` and ``aeromatch db import``."""

from __future__ import annotations

from typing import Any

import click

from aerodb.cli.edit import AxisOption
from flightmech.plugins import DATABASE_EXPORTERS, find_plugins
from flightmech.support.console import InputFile, NewFile, json_option, performed_by

_FORMATS = ("netcdf", "jsbsim", "daveml", "matlab", "csv", "checkcases")


class ExportFormat(click.Choice[str]):
    """A format of the product, or the name of an exporter that another package adds."""

    def __init__(self) -> None:
        super().__init__(_FORMATS)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name; the entry points are read only for a name that the product lacks."""
        if value not in _FORMATS and value in find_plugins(DATABASE_EXPORTERS, _FORMATS):
            return value
        return super().convert(value, param, ctx)


sample_option = click.option(
    "--sample",
    type=click.FloatRange(0.0, min_open=True),
    help="Largest difference with which functions that no table gives are sampled.",
)
grid_option = click.option(
    "--grid",
    multiple=True,
    type=AxisOption(),
    help="Samples of an axis: a range such as alpha='-10 30 deg'; for daveml also the breakpoints "
    "themselves.",
)
names_option = click.option(
    "--names",
    multiple=True,
    help="Quantity of a variable of a daveml file or of a property of a jsbsim file, such as "
    "'ALPHA_TOT_D=alpha [deg]' or 'fcs/posElev_rad=delta_e [rad]'.",
)
at_option = click.option(
    "--at",
    multiple=True,
    help="Input of a daveml file that is fixed, in its units, such as CG_PCT_MAC=25.",
)


def reading_options(verb: Any) -> Any:
    """Return a verb with the options of `reader_options`."""
    without = click.option(
        "--without",
        multiple=True,
        help="Function of a jsbsim file, or coefficient of a daveml file, to leave out.",
    )
    travel = click.option(
        "--travel",
        multiple=True,
        help="Full deflection of a jsbsim control that moves as a fraction, such as 'delta_f=40 "
        "deg'.",
    )
    # Each option is below those that the help lists before it.
    for name, text in (("b", "span"), ("cbar", "mean chord"), ("S", "reference area")):
        example = "17 m2" if name == "S" else "5.6 ft"
        verb = click.option(
            f"--{name}",
            name,
            help=f"The {text} of a daveml file that does not state it, such as '{example}'.",
        )(verb)
    return names_option(without(travel(sample_option(grid_option(verb)))))


@click.command("export")
@click.argument("file", type=InputFile())
@click.option(
    "--to",
    "fmt",
    required=True,
    type=ExportFormat(),
    help="Format, or the name of an exporter that another package adds.",
)
@click.option(
    "-o", "--output", required=True, type=click.Path(), help="File to write, for csv a folder."
)
@click.option(
    "--aircraft", type=InputFile(), help="Aircraft file; jsbsim needs it, daveml takes its limits."
)
@click.option(
    "--height",
    help="Height to which tables replace formulas of the ground effect, for jsbsim and daveml.  "
    "[default: 1000 m]",
)
@click.option("--count", type=click.IntRange(1), help="Number of check cases.")
@click.option("--seed", type=int, help="Seed of the check cases.")
@json_option
@performed_by("aerodb.cli.actions.exchange:export_database")
def export_database_command() -> None:
    """Write the database FILE for another program.

    JSBSim and DAVE-ML take tables: a ground effect k h^s is written as one, which leaves the
    formula by 0.1 % at most.
    """


@click.command("import")
@click.argument("file", type=click.Path(exists=True))
@click.option("-o", "--output", required=True, type=NewFile(), help="The database, netCDF-4.")
@reading_options
@at_option
@json_option
@performed_by("aerodb.cli.actions.exchange:import_database")
def import_database_command() -> None:
    """Read a database from FILE, a folder of CSV files or a file of another program; the format is
    recognised by content.
    """


@click.command("import-aircraft")
@click.argument("file", type=InputFile())
@click.option(
    "-o",
    "--output",
    required=True,
    type=NewFile(),
    help="The database, NAME.nc; the aircraft file is NAME.toml next to it.",
)
@click.option(
    "--inertia", type=InputFile(), help="File of mass properties, which a daveml file needs."
)
@click.option("--propulsion", type=InputFile(), help="File of the thrust of a daveml aircraft.")
@at_option
@reading_options
@click.option(
    "--x-ref-mac",
    type=float,
    default=0.25,
    show_default=True,
    help="Moment reference behind the leading edge, in chords.",
)
@click.option("--name", default="", help="Name of the aircraft; that of the file unless given.")
@click.option("--force", is_flag=True, help="Overwrite older files.")
@json_option
@performed_by("aerodb.cli.actions.exchange:import_aircraft")
def import_aircraft_command() -> None:
    """Read database and aircraft from FILE, a JSBSim aircraft or a DAVE-ML aerodynamic model; the
    two are compiled before they are written.

    Of JSBSim come geometry, mass, inertia and c.g. with point masses and fuel; of DAVE-ML those of
    the inertia file, and static thrust.
    """
