"""Functions that perform the commands of `pom.cli.report`."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import click

import aerodb
from flightmech.support.atomic_write import write_text
from flightmech.support.console import (
    command_line,
    print_json,
    print_remark,
    print_table,
    show_progress,
)
from flightmech.support.input_files import file_sha256
from flightmech.support.toml_models import schema_text, validate_content
from flighttest.reconstruction.flight_programme import open_biases
from pom.archive.origins import NAME, ReportProvenance
from pom.archive.results_document import join_reports
from pom.archive.verification import KINDS
from pom.archive.verification import verify as check
from pom.cases.case_file import Signatures, case_schema, plain_signatures
from pom.cases.drafting.draft import init_case
from pom.replaying.replay_case import files_by_name
from pom.report.writer import write_report
from pom.result import results_name
from pom.tolerances.editions import edition_of, titles_of_tests


def read_biases(file: str | None) -> Any:
    """Return the instrument constants of `biases_option`; None without a file."""
    if file is None:
        return None

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


def run_init_case(
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
    """Perform the command ``init``."""
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


def run_case_schema(output: str) -> None:
    """Perform the command ``schema``."""
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


def signatures_of(signed: tuple[tuple[str, str, str], ...]) -> dict[str, dict[str, str]]:
    """Return the signatures that ``--sign`` names, by role.

    Raises
    ------
    SchemaError
        Another role, or no day.
    """

    given = {role: {"name": name, "date": date} for role, name, date in signed}
    return plain_signatures(
        validate_content(Signatures, {"signatures": given}, "--sign").signatures
    )


def run_write_report(
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
    """Perform the command ``report``."""
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


def verify_report(ctx: click.Context, folder: Path, as_json: bool) -> None:
    """Perform the command ``verify``."""
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
