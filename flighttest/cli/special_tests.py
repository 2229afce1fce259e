"""The verb ``aeromatch flight multibody``: air loads of a vehicle of several bodies from camera
markers, and models of the wings.
"""

from __future__ import annotations

from collections.abc import Callable

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    NewFolder,
    json_option,
    performed_by,
)


def fit_options(over: str, order: int, weights: str) -> Callable:
    """Return a decorator with the options that say what is fitted."""

    def add(verb: Callable) -> Callable:
        for option in (
            click.option(
                "--weights",
                type=click.Choice(["equal", "spectrum"]),
                default=weights,
                show_default=True,
                help="Weights of the frequencies of --band: spectrum, for noise that grows with "
                "frequency.",
            ),
            click.option(
                "--select-in",
                "domain",
                type=click.Choice(["time", "frequency"]),
                default="time",
                show_default=True,
                help="Domain in which --select works; in frequency inside --band.",
            ),
            click.option(
                "--band",
                type=(float, float),
                help="Fit in frequency as well [Hz], and average both with weights 1/s.",
            ),
            click.option(
                "--gain",
                type=float,
                default=0.0,
                show_default=True,
                help="Rise of R2 that a further term of --select must bring.",
            ),
            click.option(
                "--enter",
                type=float,
                default=20.0,
                show_default=True,
                help="Partial F above which --select takes a term.",
            ),
            click.option(
                "--order",
                type=int,
                default=order,
                show_default=True,
                help="Highest order of a product of --select.",
            ),
            click.option(
                "--over",
                default=over,
                show_default=True,
                help="Variables of --select, whose products are candidates.",
            ),
            click.option(
                "--candidates",
                default="",
                help="Terms that --select chooses from, in place of products of --over.",
            ),
            click.option(
                "--select",
                "selected",
                multiple=True,
                help="Coefficient whose terms are chosen by stepwise regression.",
            ),
            click.option(
                "--model",
                "models",
                multiple=True,
                help="Terms of a coefficient, such as 'CL = 1 + alpha + alpha*beta'.",
            ),
        ):
            verb = option(verb)
        return verb

    return add


@click.command("markers")
@click.argument("recording", type=InputFile())
@click.option(
    "--setup",
    "setup_file",
    required=True,
    type=InputFile(),
    help="TOML file: markers of each body, axes, flapping frequency.",
)
@click.option(
    "--multiples",
    type=float,
    help="Cut-off over the flapping frequency. Default: that of the setup.",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=NewFile(),
    help="Flight record, netCDF, one leaf for each body.",
)
@json_option
@performed_by("flighttest.cli.actions.special_tests:run_markers")
def markers_command() -> None:
    """Find pose, rates and accelerations of bodies from the marker positions in RECORDING."""


@click.command("balance")
@click.argument("points", nargs=-1, required=True, type=InputFile())
@click.option(
    "--setup",
    "setup_file",
    required=True,
    type=InputFile(),
    help="TOML file: reference, balance, columns, errors, nuisance.",
)
@fit_options(over="alpha beta", order=4, weights="equal")
@click.option(
    "--figure",
    type=NewFile(),
    help="Draw the fits over alpha and beta with the points: png, svg or pdf.",
)
@click.option(
    "-o",
    "--output",
    type=NewFolder(),
    help="Folder for the fits, one file per coefficient, for flight tabulate.",
)
@click.option(
    "--table",
    type=NewFolder(),
    help="Folder for the points at set points and their column map, for db from-estimate.",
)
@click.option("--step", help="Distance of the set points of all angles, such as '2 deg'.")
@click.option(
    "--x-ref", help="Moment reference point of the setup, aft of the origin of the drawing."
)
@json_option
@performed_by("flighttest.cli.actions.special_tests:run_balance")
def balance_command() -> None:
    """Reduce POINTS of a wind-tunnel balance to coefficients, take tare and interference off, and
    fit models.
    """


@click.command("multibody")
@click.argument("recordings", nargs=-1, required=True, type=InputFile())
@click.option(
    "--vehicle",
    "vehicle_file",
    required=True,
    type=InputFile(),
    help="TOML file: bodies, joints, actuators, known surfaces.",
)
@fit_options(over="u w q", order=2, weights="spectrum")
@click.option("--predict", type=InputFile(), help="Recording that is not fitted, to be predicted.")
@click.option(
    "--figure",
    type=NewFile(),
    help="Draw data, models and residuals of the last recording: png, svg or pdf.",
)
@click.option(
    "-o", "--output", type=NewFolder(), help="Folder for the records and the fits, one file each."
)
@json_option
@performed_by("flighttest.cli.actions.special_tests:run_multibody")
def multibody_command() -> None:
    """Find the motion of all bodies from the markers in RECORDINGS, take air loads from it, and fit
    what the wings contribute.
    """
