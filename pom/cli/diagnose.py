"""``aeromatch pom diagnose``: which terms and parts explain the mismatch of the a-priori model, and
the corrected model.
"""

from __future__ import annotations

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    jobs_option,
    json_option,
    performed_by,
)
from pom.cli.report import biases_option, cases_argument

_FILE = InputFile()


@click.command("diagnose")
@cases_argument
@click.option("--prior", required=True, type=_FILE, help="A-priori database.")
@click.option("--final", required=True, type=_FILE, help="Database with flight-identified terms.")
@click.option(
    "--apriori",
    type=_FILE,
    help="Aircraft file of the a-priori model, when engines, gear or circuits are others.",
)
@click.option(
    "--evidence",
    type=_FILE,
    help="Identified database with standard errors, from which distances are counted; --final "
    "without it.",
)
@click.option(
    "--group",
    "groups",
    multiple=True,
    metavar="NAME=TERM,...",
    help="Terms, parts or patterns to swap together; may be repeated.",
)
@click.option(
    "--players",
    default=5,
    show_default=True,
    type=click.IntRange(1),
    help="Terms with a share of their own, at least.",
)
@click.option(
    "--replays",
    default=256,
    show_default=True,
    type=click.IntRange(1),
    help="Replays for the shares; more terms than they allow are sampled.",
)
@click.option("--seed", default=0, show_default=True, help="Seed of the random sample.")
@click.option(
    "-o",
    "--output",
    type=NewFile(),
    help="Corrected database: the a-priori one with only the terms that the cases need.",
)
@click.option(
    "--aircraft-output",
    type=NewFile(),
    help="Corrected aircraft: that of --apriori with only the parts that the cases need.",
)
@biases_option
@jobs_option
@json_option
@performed_by("pom.cli.actions.diagnose:run_diagnose")
def diagnose_command() -> None:
    """Swap terms between two databases and rank how much of the mismatch of CASES each explains
    (files, or folders of them).

    A last table ranks the wrong terms over all cases together, by their effect and their distance
    from the evidence.
    """
