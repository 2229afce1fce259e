"""``aeromatch pom report`` and ``aeromatch pom verify``: a report written again, a report checked;
the options of a report.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    NewFolder,
    command_line,
    json_option,
    print_json,
    print_remark,
    print_table,
    show_progress,
)

if TYPE_CHECKING:
    from pom.archive.origins import ReportProvenance

cases_argument = click.argument(
    "cases", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path)
)
biases_option = click.option(
    "--biases",
    "biases_file",
    type=InputFile(),
    help="Reconstruction of another record; its instrument constants are the prior where the "
    "record of a case is raw.",
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


def read_biases(file: str | None) -> Any:
    """Return the instrument constants of `biases_option`; None without a file."""
    if file is None:
        return None
    from flighttest.reconstruction.flight_programme import open_biases

    return open_biases(file)


def case_files(places: Iterable[Path]) -> list[Path]:
    """Return the case files among files and folders of them."""
    places = list(places)
    found: list[Path] = []
    for place in places:
        found += sorted(place.glob("*.toml")) if place.is_dir() else [place]
    if not found:
        raise click.UsageError(f"no case file (*.toml) in {', '.join(map(str, places))}")
    return found


_FILE = InputFile(path_type=Path)


@click.command("init")
@click.argument("record", type=_FILE)
@click.option(
    "--test",
    help="Number of the test in the tolerance table, such as 2.c.10. On a terminal it is requested.",
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
def init_case_command(
    record: Path,
    test: str | None,
    output: str,
    standard: str | None,
    edition: str | None,
    names: Path | None,
    aircraft: Path | None,
    window: tuple[float, float] | None,
    force: bool,
    as_json: bool,
) -> None:
    """Write a commented case file for a RECORD and a row of the tolerance table.

    Window and events are filled in where the record shows them; what it does not show is reported.
    """
    from pom.cases.drafting.draft import init_case
    from pom.tolerances.editions import edition_of, titles_of_tests

    standard, edition = edition_of(standard, edition)
    if test is None:
        if not _on_terminal():
            raise click.UsageError(
                "--test is missing; give the number of a row, such as --test 2.c.10 (on a "
                "terminal it is requested)"
            )
        test = _ask(titles_of_tests(standard, edition))
    with show_progress("read the record, write the case"):
        case, remarks = init_case(
            record,
            test,
            output,
            standard=standard,
            edition=edition,
            names=names,
            aircraft=aircraft,
            window=window,
            force=force,
        )
    if as_json:
        print_json({"case": case.to_dict(), "remarks": remarks})
        return
    click.echo(f"written: {output}")
    click.echo(
        f"{case.id}  {case.title}  {case.window[0]:g} ... {case.window[1]:g} s  {case.description}"
    )
    for text in remarks:
        print_remark(f"  - {text}")


@click.command("schema")
@click.option(
    "-o",
    "--output",
    default="case.schema.json",
    show_default=True,
    type=NewFile(),
    help="File to write.",
)
def case_schema_command(output: str) -> None:
    """Write the JSON schema of case files, for an editor: the first line of a case file names it,
    ``#:schema case.schema.json``.
    """
    from flightmech.support.atomic_write import write_text
    from flightmech.support.toml_models import schema_text
    from pom.cases.case_file import case_schema

    write_text(output, schema_text(case_schema()))
    click.echo(f"written: {output}")


def _on_terminal() -> bool:
    return sys.stdin.isatty()


def _ask(titles: dict[str, str]) -> str:
    """Ask what was flown, then which of the fitting rows it is."""
    while True:
        words = click.prompt("What was flown? (words of the title, or a number)").lower().split()
        fitting = {
            test: title
            for test, title in titles.items()
            if all(word in f"{test} {title}".lower() for word in words)
        }
        if fitting:
            break
        click.echo("no row has all of these words; try fewer, such as 'roll' or '2.c'")
    for test, title in fitting.items():
        click.echo(f"  {test:8} {title}")
    return click.prompt(
        "Which row?",
        default=next(iter(fitting)),
        type=click.Choice(list(fitting)),
        show_choices=False,
    )


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


def report_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that every command that writes a report has in common."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def signatures_of(signed: tuple[tuple[str, str, str], ...]) -> dict[str, dict[str, str]]:
    """Return the signatures that ``--sign`` names, by role.

    Raises
    ------
    SchemaError
        Another role, or no day.
    """
    from flightmech.support.toml_models import validate_content
    from pom.cases.case_file import Signatures, plain_signatures

    given = {role: {"name": name, "date": date} for role, name, date in signed}
    return plain_signatures(
        validate_content(Signatures, {"signatures": given}, "--sign").signatures
    )


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
def write_report_command(
    results: tuple[Path, ...],
    output: Path,
    title: str | None,
    databases: tuple[str, ...],
    chapters: tuple[str, ...],
    revision: str,
    date: str,
    paper: str,
    no_pdf: bool,
    signed: tuple[tuple[str, str, str], ...],
) -> None:
    """Write a report from RESULTS (folders of reports, or their results.nc), without flying
    anything again.

    The results of several reports are joined in the order given. Verdicts are those stored;
    `aeromatch pom verify` judges them again.
    """
    from pom.archive.results_document import join_reports
    from pom.replaying.replay_case import files_by_name
    from pom.report.writer import write_report
    from pom.result import results_name

    signatures = signatures_of(signed)
    with show_progress("read the results"):
        found = join_reports(results)
    made_from = {
        **found.provenance,
        "command": command_line(),
        "date": date or found.provenance.get("date", ""),
    }
    if signatures:
        name = results_name(found.results)
        signatures = {role: {**one, "results": name} for role, one in signatures.items()}
        made_from["signatures"] = {**found.provenance.get("signatures", {}), **signatures}
    opened = {}
    if databases:
        import aerodb

        opened = {
            name: aerodb.open(file)
            for name, file in files_by_name("--database", databases, "final=out/final.nc").items()
        }
    with show_progress(f"write the report of {len(found.results)} cases"):
        made = write_report(
            found.results,
            output,
            title=title or found.title,
            provenance=cast("ReportProvenance", made_from),
            databases=opened,
            diagnoses=found.diagnoses,
            tunings=found.tunings,
            revision=revision or found.revision,
            paper=None if no_pdf else paper,
            chapters=chapters or None,
            kept=found.chapters,
        )
    click.echo(f"written: {made}")


@click.command("verify")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@json_option
@click.pass_context
def verify_report_command(ctx: click.Context, folder: Path, as_json: bool) -> None:
    """Check the report in FOLDER: hash all inputs and outputs again, judge all verdicts again from
    the stored samples.

    Exit code 0 when all is as it was, 1 when anything changed or is missing, with what exactly.
    """
    from dataclasses import asdict

    from pom.archive.origins import NAME, file_sha256
    from pom.archive.verification import KINDS
    from pom.archive.verification import verify as check

    with show_progress("hash all files, judge all verdicts again"):
        found = check(folder)
    bad = [item for item in found if item.state != "same"]
    if as_json:
        print_json([asdict(item) for item in found])
    else:
        counts = {kind: sum(item.kind == kind for item in found) for kind in KINDS}
        if bad:
            print_table(
                ("what", "name", "state", "detail"),
                [(item.kind, item.name, item.state, item.detail) for item in bad],
            )
        checked = ", ".join(
            f"{count} {kind}{'' if count == 1 else 's'}" for kind, count in counts.items()
        )
        click.echo(
            f"{len(bad)} of {len(found)} differ ({checked} checked)"
            if bad
            else f"all as it was: {checked} checked"
        )
        click.echo(f"SHA-256 of {NAME}, to be signed: {file_sha256(folder / NAME)}")
        click.echo("not covered: who wrote the report, and page and PDF but for their hashes")
    ctx.exit(1 if bad else 0)
