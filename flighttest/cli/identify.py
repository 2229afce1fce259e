"""The verbs ``aeromatch flight fit | fit-linear | identify | select | join | partition | inertia |
tabulate``: reconstructed paths to estimates and tables.
"""

from __future__ import annotations

from collections.abc import Callable

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    json_option,
    performed_by,
)


def constraint_option(what: str) -> Callable[[Callable], Callable]:
    """Return the option of constraints among parameters."""
    return click.option(
        "--constraint",
        "constraints",
        multiple=True,
        metavar="TEXT",
        help=f"Relation that {what} obeys, as 'NAME = 1.2*OTHER', 'NAME = 0.4' or 'NAME < 0'; SI.",
    )


@click.command("fit")
@click.argument("fit_file", metavar="FIT", type=InputFile())
@click.option(
    "-o",
    "--output",
    type=NewFile(),
    help="Write estimates, noise and residuals to this netCDF file.",
)
@click.option(
    "--page",
    type=NewFile(),
    help="Write one self-contained HTML page: estimates, and measured and predicted outputs.",
)
@click.option("--database", type=NewFile(), help="Write the database with the estimates in it.")
@click.option(
    "--process-noise",
    type=click.Choice(["none", "process", "gusts", "both"]),
    help="Disturbance of the motion: none (output error), or white process noise, Dryden gusts or "
    "both (filter error). Default: that of FIT.",
)
@click.option(
    "--angle",
    type=click.Choice(["vane", "inertial"]),
    help="Source of V, alpha and beta in the records; gusts need it. A reconstructed path has "
    "inertial ones.",
)
@click.option("--scale", type=float, help="Scale of the gusts [m]. Default: it is estimated.")
@json_option
@click.pass_context
@performed_by("flighttest.cli.actions.identify:run_fit")
def fit_command() -> None:
    """Estimate parameters of the simulation by output error, or by filter error in turbulence, as
    specified in FIT (TOML); exit code 1 when a figure must not be used.
    """


@click.command("fit-linear")
@click.argument("paths", nargs=-1, required=True, type=InputFile())
@click.option(
    "--motion",
    required=True,
    type=click.Choice(["short-period", "lateral"]),
    help="Motion whose derivatives are estimated.",
)
@click.option(
    "--window",
    "windows",
    type=(float, float),
    multiple=True,
    help="Start and stop [s]; several make one fit. Default: all.",
)
@click.option(
    "--window-of",
    "own_windows",
    type=(str, float, float),
    multiple=True,
    metavar="PATH START STOP",
    help="Window of one path alone, named by its file without extension; for paths with different "
    "windows.",
)
@click.option(
    "--disturbance",
    type=click.Choice(["none", "process", "gusts", "both"]),
    default="none",
    show_default=True,
    help="Disturbance of the motion: none (output error), or white process noise, Dryden gusts or "
    "both (filter error).",
)
@click.option(
    "--angle",
    type=click.Choice(["vane", "inertial"]),
    help="Source of alpha or beta in PATHS; gusts need it. A reconstructed path has inertial ones.",
)
@click.option(
    "--scale", type=float, help="Scale of the gusts [m]. Default: it is estimated, from 150 m."
)
@click.option(
    "--span",
    type=click.FloatRange(0.0),
    default=0.0,
    help="Span of the wing [m], by which the air of the gusts also rotates. Default: it does not.",
)
@constraint_option("a derivative")
@click.option(
    "-o",
    "--output",
    type=NewFile(),
    help="Write estimates, noise and residuals to this netCDF file.",
)
@json_option
@click.pass_context
@performed_by("flighttest.cli.actions.identify:run_fit_linear")
def fit_linear_command() -> None:
    """Estimate the derivatives of a linear motion by output error or filter error, without a
    database, from PATHS (reconstructed, or readings at the c.g. as netCDF); exit code 1 when a
    figure must not be used.
    """


_PATHS = click.argument("paths", nargs=-1, required=True, type=InputFile())
_AIRCRAFT = click.option(
    "--aircraft", "aircraft_file", required=True, type=InputFile(), help="Aircraft, TOML."
)
_MODEL = click.option(
    "--model",
    "model_text",
    required=True,
    help="Model to fit, such as 'CL = 1 + alpha + qhat + delta_e'.",
)
_WINDOW = click.option(
    "--window",
    "windows",
    type=(float, float),
    multiple=True,
    help="Start and stop [s]; several make one fit. Default: all.",
)
_WINDOW_OF = click.option(
    "--window-of",
    "own_windows",
    type=(str, float, float),
    multiple=True,
    metavar="PATH START STOP",
    help="Window of one path alone, named by its file without extension; for paths with different "
    "windows.",
)
_ERRORS = click.option(
    "--error",
    "errors",
    type=(str, click.FloatRange(0.0)),
    multiple=True,
    metavar="SOURCE SIZE",
    help="Standard error of qbar, mass, inertia or thrust (relative) or of timing [s], in place "
    "of the default.",
)
_CUTOFF = click.option(
    "--cutoff",
    type=click.FloatRange(0.0, min_open=True),
    help="Low-pass all states alike first [Hz].",
)
_BAND = click.option(
    "--band",
    type=(float, float),
    help="Work in frequency, inside this band [Hz]. Default: in time.",
)
_CORRELATION = click.option(
    "--correlation", is_flag=True, help="Print the correlation matrix of the estimates."
)
_CONSTRAINTS = constraint_option("a term")
_OUTPUT = click.option("-o", "--output", type=NewFile(), help="Write the fit to this netCDF file.")


@click.command("identify")
@_PATHS
@_AIRCRAFT
@_MODEL
@_WINDOW
@_WINDOW_OF
@_ERRORS
@_CUTOFF
@_BAND
@click.option(
    "--intercepts",
    type=click.Choice(["common", "separate"]),
    default="common",
    help="One constant, or one per manoeuvre.",
)
@click.option(
    "--weights",
    default="equal",
    show_default=True,
    help="Weights of the samples: equal, manoeuvre, robust, or a variable with standard errors.",
)
@click.option(
    "--ridge",
    default="0",
    show_default=True,
    help="Ridge parameter on standardised regressors, or auto.",
)
@click.option(
    "--prior", type=InputFile(), help="Database whose terms are the prior, with standard errors."
)
@click.option(
    "--method",
    type=click.Choice(["least-squares", "iv", "tls"]),
    default="least-squares",
    show_default=True,
    help="Estimator: least squares, or for noisy regressors instrumental variables (iv) or total "
    "least squares (tls).",
)
@click.option(
    "--noise",
    "noises",
    type=(str, str),
    multiple=True,
    metavar="NAME SIZE",
    help="Standard deviation of the noise of a variable, as alpha '0.3 deg'; tls needs it.",
)
@click.option(
    "--instruments",
    "instrument_files",
    type=InputFile(may_repeat=True),
    multiple=True,
    help="Path with independent errors, or simulated response, whose variables are the instruments "
    "of iv; one per path. Default: a response to the controls, simulated from the records.",
)
@_CONSTRAINTS
@_OUTPUT
@_CORRELATION
@json_option
@click.pass_context
@performed_by("flighttest.cli.actions.identify:run_identify")
def identify_command() -> None:
    """Estimate the terms of one coefficient from reconstructed paths; exit code 1 when a figure
    must not be used.
    """


@click.command("select")
@_PATHS
@_AIRCRAFT
@click.option("--coefficient", required=True, help="CL, CD, CY, Cl, Cm, Cn, CX or CZ.")
@click.option("--variables", help="Candidates are all their products, as 'alpha qhat delta_e'.")
@click.option(
    "--order",
    type=click.IntRange(1, 9),
    default=2,
    show_default=True,
    help="Highest order of the products.",
)
@click.option(
    "--term", "terms", multiple=True, help="A further candidate, as 'ramp(alpha,12 deg)'."
)
@click.option(
    "--method",
    type=click.Choice(["prediction", "orthogonal", "stepwise"]),
    default="prediction",
    show_default=True,
    help="Method of the selection; prediction returns the set of models that the data allow.",
)
@click.option("--keep", multiple=True, help="A candidate that is in from the start.")
@click.option(
    "--free",
    is_flag=True,
    help="Selection without hierarchy, in which a product may lack its factors and a moment its "
    "damping.",
)
@_CONSTRAINTS
@_WINDOW
@_WINDOW_OF
@_ERRORS
@_CUTOFF
@_BAND
@_OUTPUT
@_CORRELATION
@json_option
@click.pass_context
@performed_by("flighttest.cli.actions.identify:run_select")
def select_command() -> None:
    """Choose the terms of one coefficient, and estimate them; exit code 1 when a figure must not be
    used.
    """


@click.command("join")
@click.argument("fits", nargs=-1, required=True, type=InputFile())
@click.option(
    "--method",
    type=click.Choice(["inverse_variance", "median", "inverse_sigma"]),
    default="inverse_variance",
    show_default=True,
    help="Way to join: median with the scaled median absolute deviation, or inverse_sigma to "
    "reproduce papers.",
)
@json_option
@performed_by("flighttest.cli.actions.identify:run_join")
def join_command() -> None:
    """Join fits of one coefficient from several manoeuvres; FITS are files that identify or select
    wrote.
    """


@click.command("partition")
@_PATHS
@_AIRCRAFT
@_MODEL
@click.option(
    "--over",
    "conditions",
    type=(str, str),
    multiple=True,
    required=True,
    help="Condition and edges, as alpha '0 5 10 15 deg'.",
)
@_WINDOW
@_CUTOFF
@json_option
@performed_by("flighttest.cli.actions.identify:run_partition")
def partition_command() -> None:
    """Fit a model bin by bin over conditions such as alpha or mach."""


@click.command("inertia")
@_PATHS
@_AIRCRAFT
@click.option(
    "--model",
    "models",
    multiple=True,
    required=True,
    help="One for each of Cl, Cm and Cn, as 'Cl = 1 + beta + phat + delta_a'.",
)
@click.option(
    "--scale",
    type=click.Choice(["Ixx", "Iyy", "Izz"]),
    default="Iyy",
    show_default=True,
    help="The moment that is known.",
)
@_WINDOW
@_CUTOFF
@json_option
@click.pass_context
@performed_by("flighttest.cli.actions.identify:run_inertia")
def inertia_command() -> None:
    """Estimate moments of inertia from coupled manoeuvres; exit code 1 when no body can have
    them.
    """


@click.command("tabulate")
@click.argument("fits", nargs=-1, required=True, type=InputFile())
@click.option(
    "--database", "database_file", required=True, type=InputFile(), help="A-priori tables."
)
@click.option(
    "--hold", "held", multiple=True, help="A term that keeps its values, such as CL/altitude."
)
@click.option(
    "--way",
    type=click.Choice(["tabulate", "join"]),
    default="tabulate",
    show_default=True,
    help="Local models projected on the nodes, or joined by regression, clean configuration first.",
)
@click.option(
    "--unplaced",
    type=click.Choice(["raise", "warn"]),
    default="raise",
    show_default=True,
    help="Stop, or go on with a warning, if no table of the database carries a significant term "
    "of a fit.",
)
@click.option(
    "-o", "--output", required=True, type=NewFile(), help="Write the database with the new tables."
)
@json_option
@performed_by("flighttest.cli.actions.tabulate:run_tabulate")
def tabulate_command() -> None:
    """Join FITS of any coefficients (files of identify, select or join; CSV files of published
    models) with the tables of a database.
    """
