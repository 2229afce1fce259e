"""``aeromatch init FOLDER``: a first project folder from listings, decks and recordings."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import (
    FileOrFolder,
    json_option,
    performed_by,
)
from flighttest.cli.group import MapFile

_FILES = FileOrFolder(path_type=Path)


@click.command("init")
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option(
    "--datcom",
    multiple=True,
    type=_FILES,
    help="Listing or deck of Digital DATCOM, or a folder of them; may be repeated.",
)
@click.option(
    "--records",
    multiple=True,
    type=_FILES,
    help="Recording of any format, or a folder of them; may be repeated.",
)
@click.option(
    "--names",
    "own_map",
    type=MapFile(),
    help="Name map outside of FOLDER, or a shipped one; used as it stands.",
)
@click.option("--name", default="", help="Name of the aircraft.")
@click.option("--mass", help="Gross mass, with its unit: '2400 kg'.")
@click.option("--Ixx", "Ixx", help="Moment of inertia in roll: '10826 kg m2'.")
@click.option("--Iyy", "Iyy", help="Moment of inertia in pitch.")
@click.option("--Izz", "Izz", help="Moment of inertia in yaw.")
@click.option("--Ixz", "Ixz", help="Product of inertia, integral of xz dm.")
@click.option(
    "--cg",
    nargs=3,
    metavar="X Y Z",
    help="Centre of gravity from the moment reference point, body axes: '0 m' '0 m' '0.2 m'.",
)
@click.option(
    "--imu",
    nargs=3,
    metavar="X Y Z",
    help="Place of the inertial unit from the moment reference point, body axes.",
)
@click.option(
    "--temperature",
    help="Temperature of the outside air, where the recordings have none, such as '12 degC'.",
)
@click.option("--latitude", help="Latitude of the flights, such as '45 deg'.")
@click.option("--runway-elevation", help="Over mean sea level: '120 m'.")
@click.option(
    "--prove",
    multiple=True,
    metavar="RECORD",
    help="Recording that proves the model and identifies nothing; may be repeated.",
)
@click.option("--force", is_flag=True, help="Draft all files anew; copies keep what you edited.")
@json_option
@performed_by("aeromatch.cli.actions.init:init_project")
def init_project_command() -> None:
    """Draft a project in FOLDER: aircraft.toml, names.toml, manoeuvres.csv, cases and
    aeromatch.toml, each commented.

    Without --datcom and --records the listings, decks and recordings in FOLDER and the folders
    inside it are taken. A table shows what each column of the recordings is taken for, and why.
    Correct the files and run init again: what you changed stays, the rest is drafted anew, and
    answers are not requested again. A file of yours is copied before it changes. What nobody knows
    is written as "?". The project is checked at the end as match --plan does.
    """
