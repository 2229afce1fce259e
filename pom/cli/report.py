"""``aeromatch pom report`` and ``aeromatch pom verify``: a report written again, a report checked;
the options of a report.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    NewFolder,
    json_option,
    performed_by,
)

_FILE = InputFile(path_type=Path)
cases_argument = click.argument(
    "cases", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path)
)
tolerances_option = click.option(
    "--tolerances",
    "tolerances_file",
    type=InputFile(),
    metavar="FILE.csv",
    help="Tolerance table with the columns of the shipped one, for the cases whose standard and "
    "edition it holds.",
)
biases_option = click.option(
    "--biases",
    "biases_file",
    type=InputFile(),
    help="Reconstruction of another record; its instrument constants are the prior where the "
    "record of a case is raw.",
)


@click.command("init")
@click.argument("record", type=_FILE)
@click.option(
    "--test",
    help="Number of the test in the tolerance table, such as 2.c.10. On a terminal it is "
    "requested.",
)
@click.option(
    "-o",
    "--output",
    default="case.toml",
    show_default=True,
    type=NewFile(),
    help="Case file to write.",
)
@click.option(
    "--standard",
    help="Standard, or a part of its name.  [default: FAA 14 CFR Part 60 App A Table A2A]",
)
@click.option(
    "--edition",
    help="Edition, or its first digits.  [default: 2014-01-01, or the oldest of the standard]",
)
@click.option(
    "--names",
    type=_FILE,
    help="Name map of the record.  [default: names.toml next to it or one folder up]",
)
@click.option(
    "--aircraft",
    type=_FILE,
    help="Aircraft.  [default: aircraft.toml next to the record or one folder up]",
)
@click.option(
    "--window",
    nargs=2,
    type=float,
    metavar="START STOP",
    help="Part of the record in which the manoeuvre lies. [s]",
)
@click.option("--force", is_flag=True, help="Overwrite an older file.")
@json_option
@performed_by("pom.cli.actions.report:run_init_case")
def init_case_command() -> None:
    """Write a commented case file for a RECORD and a row of the tolerance table.

    Window and events are filled in where the record shows them; what it does not show is reported.
    """


@click.command("schema")
@click.option(
    "-o",
    "--output",
    default="case.schema.json",
    show_default=True,
    type=NewFile(),
    help="File to write.",
)
@performed_by("pom.cli.actions.report:run_case_schema")
def case_schema_command() -> None:
    """Write the JSON schema of case files, for an editor: the first line of a case file names it,
    ``#:schema case.schema.json``.
    """


_OPTIONS = (
    click.option("--revision", default="", help="Revision of the report, printed on every page."),
    click.option(
        "--date", default="", metavar="YYYY-MM-DD", help="Date of the results; no clock is read."
    ),
    click.option(
        "--paper",
        type=click.Choice(["a4", "letter"]),
        default="a4",
        show_default=True,
        help="Paper of report.pdf.",
    ),
    click.option(
        "--units",
        type=click.Choice(["SI", "kt-ft-lb"]),
        help="Units of pages and drawings.  [default: kt, ft, lbf as the tolerance table, kg]",
    ),
    click.option("--no-pdf", is_flag=True, help="No report.pdf, which takes most of the time."),
    click.option(
        "--sign",
        "signed",
        type=(str, str, str),
        multiple=True,
        metavar="ROLE NAME DATE",
        help="Signature on the cover of the report: prepared, checked, approved or authority, "
        "name, YYYY-MM-DD; once for each role.",
    ),
)


def samples_options(command: Any) -> Any:
    """Add the options ``--samples`` and ``--seed`` to a command."""
    number = click.IntRange(0)
    command = click.option(
        "--seed",
        default=0,
        show_default=True,
        type=number,
        help="Seed of the random draws of --samples.",
    )(command)
    return click.option(
        "--samples",
        default=0,
        show_default=True,
        type=number,
        help="Draws from the posterior of database and instruments: probability of a pass, spread "
        "of the ratio, which errors make it.",
    )(command)


def report_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that every command that writes a report has in common."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


@click.command("report")
@click.argument("results", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", required=True, type=NewFolder(), help="Folder of the new report.")
@click.option(
    "--title",
    default=None,
    help="Title of the report.  [default: that of the first of the RESULTS]",
)
@click.option(
    "--database",
    "databases",
    multiple=True,
    metavar="NAME=FILE.nc",
    help="Database to compare; as often as wanted, the prior first.",
)
@click.option(
    "--chapter",
    "chapters",
    multiple=True,
    type=click.Choice(["identification", "database"]),
    help="Chapter of the PDF behind the proof of match, once for each.  [default: those of the "
    "RESULTS]",
)
@report_options
@performed_by("pom.cli.actions.report:run_write_report")
def write_report_command() -> None:
    """Write a report from RESULTS (folders of reports, or their results.nc), without flying
    anything again.

    The results of several reports are joined in the order given. Verdicts are those stored;
    `aeromatch pom verify` judges them again.
    """


@click.command("verify")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "--signers",
    type=_FILE,
    metavar="FILE",
    help="Keys that you know (allowed signers of ssh-keygen); one of them must sign the report.",
)
@click.option(
    "--against",
    "again",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    metavar="REPORT",
    help="Report of the same command that you have flown again: traces, verdicts, departures and "
    "probes must be the same.",
)
@json_option
@click.pass_context
@performed_by("pom.cli.actions.report:verify_report")
def verify_report_command() -> None:
    """Check the report in FOLDER: hash all inputs and outputs again, read all cases again from
    their files, judge all verdicts again from the stored samples.

    Whoever edits a report can write its hashes anew. A signature (--signers) or a second flight
    (--against) shows that. The first line states whether the report is signed.

    Exit code 0 when all is as it was, 1 when anything changed or is missing, with what exactly.
    """
