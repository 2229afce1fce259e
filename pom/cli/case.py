"""``aeromatch pom init`` and ``aeromatch pom schema``: a first case file, and the schema for editors."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, progress, remark

_FILE = InputFile(path_type=Path)


@click.command()
@click.argument("record", type=_FILE)
@click.option("--test", help="Number of the test in the tolerance table, such as 2.c.10. On a terminal it is requested.")
@click.option("-o", "--output", default="case.toml", show_default=True, type=NewFile(), help="Case file to write.")
@click.option("--standard", help="Standard, or a part of its name.  [default: FAA 14 CFR Part 60 App A Table A2A]")
@click.option("--edition", help="Edition, or its first digits.  [default: 2014-01-01, or the oldest of the standard]")
@click.option("--names", type=_FILE, help="Name map of the record.  [default: names.toml next to it or one folder up]")
@click.option("--aircraft", type=_FILE, help="Aircraft.  [default: aircraft.toml next to the record or one folder up]")
@click.option("--window", nargs=2, type=float, metavar="START STOP", help="Part of the record in which the manoeuvre lies. [s]")
@click.option("--force", is_flag=True, help="Overwrite an older file.")
@json_option
def init(
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
    from ..drafting.draft import init_case
    from ..tolerances.editions import edition_of, titles

    standard, edition = edition_of(standard, edition)
    if test is None:
        if not _on_terminal():
            raise click.UsageError("--test is missing; give the number of a row, such as --test 2.c.10 (on a terminal it is requested)")
        test = _ask(titles(standard, edition))
    with progress("read the record, write the case"):
        case, remarks = init_case(
            record, test, output, standard=standard, edition=edition, names=names, aircraft=aircraft, window=window, force=force
        )
    if as_json:
        document({"case": case.to_dict(), "remarks": remarks})
        return
    click.echo(f"written: {output}")
    click.echo(f"{case.id}  {case.title}  {case.window[0]:g} ... {case.window[1]:g} s  {case.description}")
    for text in remarks:
        remark(f"  - {text}")


@click.command()
@click.option("-o", "--output", default="case.schema.json", show_default=True, type=NewFile(), help="File to write.")
def schema(output: str) -> None:
    """Write the JSON schema of case files, for an editor: the first line of a case file names it, ``#:schema case.schema.json``."""
    from flightmech.support.atomic_write import write_text
    from flightmech.support.configuration import schema_text

    from ..cases.file_schema import case_schema

    write_text(output, schema_text(case_schema()))
    click.echo(f"written: {output}")


def _on_terminal() -> bool:
    return sys.stdin.isatty()


def _ask(titles: dict[str, str]) -> str:
    """Ask what was flown, then which of the fitting rows it is."""
    while True:
        words = click.prompt("What was flown? (words of the title, or a number)").lower().split()
        fitting = {test: title for test, title in titles.items() if all(word in f"{test} {title}".lower() for word in words)}
        if fitting:
            break
        click.echo("no row has all of these words; try fewer, such as 'roll' or '2.c'")
    for test, title in fitting.items():
        click.echo(f"  {test:8} {title}")
    return click.prompt("Which row?", default=next(iter(fitting)), type=click.Choice(list(fitting)), show_choices=False)
