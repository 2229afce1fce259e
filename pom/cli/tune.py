"""``aeromatch pom tune``: terms moved inside their standard errors, as little as flight contradicts
least, until rows pass.
"""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    NewFolder,
    jobs_option,
    json_option,
    performed_by,
)
from pom.cli.report import biases_option, cases_argument

_FILE = InputFile()


@click.command("tune")
@cases_argument
@click.option(
    "--database",
    required=True,
    type=_FILE,
    help="Database of the model, such as final.nc of aeromatch match.",
)
@click.option(
    "--aircraft",
    type=_FILE,
    help="Aircraft of the model.  [default: the .toml next to the database, else that of the "
    "cases]",
)
@click.option(
    "--evidence",
    type=_FILE,
    help="Database identified from flight, with standard errors.  [default: the database of the "
    "model]",
)
@click.option(
    "--row",
    "wanted",
    multiple=True,
    metavar="CASE",
    help="Case that must pass; may be repeated.  [default: all that fail]",
)
@click.option(
    "--rationale",
    multiple=True,
    metavar="FILE.toml|TERM=TEXT",
    help="Terms that may leave the bound: 'NAME, YYYY-MM-DD, why', in the table [rationale] of a "
    "file, or for one term; may be repeated.",
)
@click.option(
    "--bound",
    default=2.0,
    show_default=True,
    type=click.FloatRange(0.0, min_open=True),
    help="Largest move of a node from the evidence; beyond 3 it is a departure. [standard errors]",
)
@click.option(
    "-o",
    "--output",
    type=NewFolder(),
    help="Folder for the tuned database, its aircraft and the log; nothing on a refusal.",
)
@click.option("--fmu", is_flag=True, help="FMU of the tuned model to write; needs -o.")
@click.option("--log", "log_file", type=NewFile(), help="Log as JSON, also of a refusal.")
@click.option(
    "--resume",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder that keeps reconstructed flights, as that of pom run.",
)
@jobs_option
@biases_option
@json_option
@click.pass_context
@performed_by("pom.cli.actions.tune:run_tune")
def tune_command() -> None:
    """Move terms of a database as little as the flight evidence contradicts, until rows of CASES
    (files, or folders of them) pass.

    No node moves by more than the bound from the evidence unless a rationale for its term is given.
    Cases that pass must go on passing.

    Exit code 0 when the rows pass, 1 when they cannot within the bound: the price is printed, and
    no model is written.
    """
