"""The verb ``aeromatch flight follow``: estimates during flight, from a stream of samples."""

from __future__ import annotations

import click

from flightmech.support.console import InputFile, performed_by
from flighttest.cli.group import names_option
from flighttest.cli.identify import constraint_option


@click.command("follow")
@click.argument("stream", type=click.Path(exists=True, dir_okay=False, allow_dash=True))
@click.option("--aircraft", "aircraft_file", type=InputFile(), help="Aircraft, TOML.")
@click.option(
    "--model",
    "model_text",
    required=True,
    help="Model to estimate, such as 'Cm = 1 + alpha + qhat + delta_e'.",
)
@click.option(
    "--candidate",
    "candidates",
    multiple=True,
    metavar="TERM",
    help="A further term, which enters where the evidence for it is strong, as 'alpha**2'.",
)
@constraint_option("a term")
@names_option
@click.option(
    "--band",
    type=(float, float),
    default=(0.1, 2.0),
    show_default=True,
    help="Band of the excitation [Hz].",
)
@click.option(
    "--spacing",
    type=click.FloatRange(0.0, min_open=True),
    default=0.01,
    show_default=True,
    help="Spacing of the frequencies [Hz]; one over it is the longest stretch.",
)
@click.option(
    "--rate",
    type=click.FloatRange(0.0, 10_000.0, min_open=True),
    help="Samples per second of the stream [Hz]; stamps that show another rate within 5 % have "
    "precedence. Default: that of its first stamps.",
)
@click.option(
    "--until",
    "goals",
    type=(str, str),
    multiple=True,
    metavar="TERM LIMIT",
    help="Stop when the standard error of a term is below a limit, as alpha 5% or qhat 0.4; of "
    "several, when all are.",
)
@click.option(
    "--wait",
    type=click.FloatRange(0.0),
    default=0.0,
    show_default=True,
    help="Time to wait for more samples at the end of a file that grows [s].",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON document a line, nothing else.")
@click.pass_context
@performed_by("flighttest.cli.actions.follow:run_follow")
def follow_command() -> None:
    """Estimate the terms of one coefficient every second of STREAM (CSV of readings at the c.g.; -
    is stdin); exit code 1 without an estimate, or if --until was not reached.
    """
