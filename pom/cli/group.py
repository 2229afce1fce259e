"""``aeromatch pom``: check cases, run them against models, name the terms behind a mismatch."""

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
from pom.cli.diagnose import diagnose_command
from pom.cli.report import (
    biases_option,
    case_schema_command,
    cases_argument,
    init_case_command,
    report_options,
    samples_options,
    tolerances_option,
    verify_report_command,
    write_report_command,
)
from pom.cli.spread import spread_command
from pom.cli.tolerances import list_tolerances_command
from pom.cli.tune import tune_command


@click.group()
def pom() -> None:
    """Replay recorded inputs and judge the match."""


pom.add_command(init_case_command)
pom.add_command(case_schema_command)
pom.add_command(diagnose_command)
pom.add_command(write_report_command)
pom.add_command(verify_report_command)
pom.add_command(tune_command)
pom.add_command(spread_command)
pom.add_command(list_tolerances_command)


@pom.command("check")
@cases_argument
@tolerances_option
@json_option
@performed_by("pom.cli.actions.check:check_cases")
def check_cases_command() -> None:
    """Read CASES (files, or folders of them) and print their criteria as they will be judged.

    All that is wrong with any of them is reported at once, windows beyond their records too.
    """


@pom.command("run")
@cases_argument
@click.option(
    "--model",
    "models",
    multiple=True,
    required=True,
    metavar="NAME=FILE",
    help="A model, as often as wanted: an FMU, or the recording of a device (a folder of them: one "
    "for each case, named after it).",
)
@click.option(
    "--start",
    "starts",
    multiple=True,
    metavar="NAME=SECONDS",
    help="Instant of the recordings of a device at the start of the window.  [default: the clock "
    "of "
    "the flight record]",
)
@click.option(
    "--master",
    "masters",
    multiple=True,
    metavar="NAME=REPORT",
    help="Earlier report (folder or results.nc) with which the run NAME is compared: a recurrent "
    "test.",
)
@click.option(
    "--recurrent-share",
    type=click.FloatRange(0.0, 1.0, min_open=True),
    help="Criterion of --master: share of each tolerance.  [default: 0.2 before 2016, then 0.4]",
)
@click.option(
    "-o", "--output", type=NewFolder(), help="Folder for the report: pages, numbers, manifest."
)
@click.option("--title", default="Proof of Match", show_default=True, help="Title of the report.")
@report_options
@click.option(
    "--junit", type=NewFile(), help="JUnit XML for a build server, with or without a report."
)
@click.option(
    "--names",
    "tables",
    multiple=True,
    metavar="NAME=FILE.toml",
    help="Table of names, units and signs of a model; for a recording its name map.",
)
@click.option(
    "--timeout", default=60.0, show_default=True, help="Wall time per model and case. [s]"
)
@jobs_option
@click.option(
    "--scheduler",
    metavar="tcp://HOST:PORT",
    help="Fly on the workers of a dask.distributed cluster that see the same files.",
)
@click.option(
    "--resume",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder that keeps flights; what is there is not flown again.",
)
@biases_option
@tolerances_option
@click.option(
    "--evidence",
    type=InputFile(),
    help="Identified database with standard errors, with which the terms of each model are "
    "compared.",
)
@samples_options
@click.option(
    "--database",
    "databases",
    multiple=True,
    metavar="NAME=FILE.nc",
    help="Database that a model was made from, with standard errors; needs --samples.",
)
@click.option(
    "--tuning",
    "tunings",
    multiple=True,
    metavar="NAME=FILE.json",
    help="Log by which a model was tuned, of aeromatch pom tune; needs -o.",
)
@click.option(
    "-v", "--verbose", is_flag=True, help="Print trim, math pilot and drift of every model as well."
)
@json_option
@click.pass_context
@performed_by("pom.cli.actions.run:run_cases")
def run_cases_command() -> None:
    """Replay CASES (files, or folders of them) by models and print one line per case and model.

    All cases and records are checked before the first flight. Exit code 0 when all pass, 1 when one
    does not; a pass with a trim beyond its limits (LIMITS) is not enough, unless [rationale] of the
    case file states who allows the bias, when and why, and neither is a pass against a flight
    record with an error (RECORD), against a record that identified the model (LEAK), or of a model
    whose answer its inputs do not drive (NOT DRIVEN). Departures of a case from the printed row are
    named and leave the exit code.
    """
