"""``aeromatch match PROJECT`` and ``aeromatch demo``: the whole job from listings and flights to
the report.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from flightmech.support.console import (
    InputFile,
    NewFolder,
    jobs_option,
    json_option,
    performed_by,
)
from pom.cli.report import samples_options

EXAMPLES = {
    "c182": "light aircraft with a propeller, the one of the tutorial: CSV recordings in kt, ft, "
    "deg and lbf",
    "t37": "jet trainer: complete programme with flaps, engine, landing gear and control forces, "
    "the one of aeromatch demo",
    "commuter": "generic aeroplane with two turboprops: engine failure, one engine, torque and "
    "levers recorded, no thrust",
}


@click.command("example", epilog="  ".join(f"{name}: {text}." for name, text in EXAMPLES.items()))
@click.argument("name", type=click.Choice(list(EXAMPLES)))
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--inputs-only", is_flag=True, help="Listings and recordings alone, what a project starts from."
)
@json_option
@performed_by("aeromatch.cli.actions.examples:run_example")
def example_command() -> None:
    """Copy an example that comes with the product into FOLDER, which is new or empty."""


fresh_option = click.option(
    "--fresh",
    is_flag=True,
    help="Compute every stage, whatever the store keeps of it, and keep it anew.",
)
explain_option = click.option(
    "--explain",
    is_flag=True,
    help="State for every stage that is computed why, and how many are reused.",
)


@click.command("demo")
@click.option(
    "-o",
    "--output",
    type=NewFolder(),
    default=Path("out/t37"),
    show_default=True,
    help="Folder to write.",
)
@jobs_option
@fresh_option
@explain_option
@json_option
@performed_by("aeromatch.cli.actions.verbs:run_demo")
def demo_command() -> None:
    """Perform the whole job on the shipped T-37 example."""


class ProjectToMatch(InputFile):
    """A project file. One that the actions of a log draft does not exist yet."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path of an existing file, or of one in an existing folder with --actions."""
        path = Path(value)
        # without the option, click holds a sign of its own in its place
        is_drafted = ctx is not None and isinstance(ctx.params.get("actions"), Path)
        if is_drafted and not path.exists() and path.suffix == ".toml" and path.parent.is_dir():
            return path
        return super().convert(value, param, ctx)


def _demand_output(ctx: click.Context, param: click.Parameter, value: Path | None) -> Path:
    """Return the folder of a match; a plan writes nothing, and checks the default folder."""
    if value is not None:
        return value
    if not ctx.params.get("plan_only"):
        raise click.MissingParameter("only --plan does without it", ctx, param)
    return Path("out")


@click.command("match")
@click.argument("project", type=ProjectToMatch(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=NewFolder(),
    callback=_demand_output,
    help="Folder to write; only --plan does without it.",
)
@jobs_option
@click.option(
    "--scheduler",
    metavar="tcp://HOST:PORT",
    help="Work on the workers of a dask.distributed cluster that see the same files.",
)
@click.option(
    "--resume",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder that keeps flights; what is there is not flown again.",
)
@click.option(
    "--compare-tables",
    is_flag=True,
    help="Make the tables in all ways and write tables_compared.csv, node by node.",
)
@click.option(
    "--actions",
    type=InputFile(path_type=Path),
    # before PROJECT, which its actions may draft
    is_eager=True,
    help="Log of aeromatch view: its actions are carried out first; OUTPUT is then its working "
    "folder, with the match in OUTPUT/match.",
)
@click.option(
    "--unplaced",
    type=click.Choice(["raise", "warn"]),
    help="Stop, or go on with a warning, if no table of the database carries a significant term "
    "of a fit; as in PROJECT unless given.",
)
@click.option(
    "--paths",
    "paths_only",
    is_flag=True,
    help="Only reconstruct the records as the match does, and write them into OUTPUT as flight "
    "reconstruct does; after a match they come from the store.",
)
@samples_options
@click.option(
    "--plan",
    "plan_only",
    is_flag=True,
    is_eager=True,  # read before -o, which only a plan may lack
    help="Print steps, records, fits, cases, products and all problems; compute nothing.",
)
@fresh_option
@explain_option
@json_option
@performed_by("aeromatch.cli.actions.verbs:run_match")
def match_command() -> None:
    """Perform the whole job of a PROJECT file: databases, FMUs and the Proof-of-Match report.

    Everything is checked before the first computation: windows, channels, drives, manoeuvres,
    terms, models and folders. Exit code 0 when the job was done: failed rows are its result.
    """
