"""``aeromatch pom report`` and ``aeromatch pom verify``: a report written again, a report checked; the options of a report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from flightmech.support.console import NewFolder, command_line, document, json_option, progress, table

if TYPE_CHECKING:
    from ..archive.provenance_record import Provenance

_OPTIONS = (
    click.option("--revision", default="", help="Revision of the report, printed on every page."),
    click.option("--date", default="", metavar="YYYY-MM-DD", help="Date of the results; no clock is read."),
    click.option("--paper", type=click.Choice(["a4", "letter"]), default="a4", show_default=True, help="Paper of report.pdf."),
    click.option("--no-pdf", is_flag=True, help="No report.pdf, which takes most of the time."),
    click.option(
        "--sign",
        "signed",
        type=(str, str, str),
        multiple=True,
        metavar="ROLE NAME DATE",
        help="Signature on the cover of the report: prepared, checked, approved or authority, name, YYYY-MM-DD; once for each role.",
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
    from flightmech.support.configuration import validate

    from ..cases.signatures import Signatures, plain_signatures

    given = {role: {"name": name, "date": date} for role, name, date in signed}
    return plain_signatures(validate(Signatures, {"signatures": given}, "--sign").signatures)


@click.command()
@click.argument("results", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", required=True, type=NewFolder(), help="Folder of the new report.")
@click.option("--title", default=None, help="Title of the report.  [default: that of the first of the RESULTS]")
@click.option(
    "--database", "databases", multiple=True, metavar="NAME=FILE.nc", help="Database to compare; as often as wanted, the prior first."
)
@click.option(
    "--chapter",
    "chapters",
    multiple=True,
    type=click.Choice(["identification", "database"]),
    help="Chapter of the PDF behind the proof of match, once for each.  [default: those of the RESULTS]",
)
@report_options
def report(
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
    """Write a report from RESULTS (folders of reports, or their results.nc), without flying anything again.

    The results of several reports are joined in the order given. Verdicts are those stored; `aeromatch pom verify` judges them again.
    """
    from ..archive.merge_reports import joined
    from ..replaying.replay_case import files_by_name
    from ..report.writer import write_report
    from ..result import results_name

    signatures = signatures_of(signed)
    with progress("read the results"):
        found = joined(results)
    made_from = {**found.provenance, "command": command_line(), "date": date or found.provenance.get("date", "")}
    if signatures:
        name = results_name(found.results)
        signatures = {role: {**one, "results": name} for role, one in signatures.items()}
        made_from["signatures"] = {**found.provenance.get("signatures", {}), **signatures}
    opened = {}
    if databases:
        import aerodb

        opened = {name: aerodb.open(file) for name, file in files_by_name("--database", databases, "final=out/final.nc").items()}
    with progress(f"write the report of {len(found.results)} cases"):
        made = write_report(
            found.results,
            output,
            title=title or found.title,
            provenance=cast("Provenance", made_from),
            databases=opened,
            diagnoses=found.diagnoses,
            tunings=found.tunings,
            revision=revision or found.revision,
            paper=None if no_pdf else paper,
            chapters=chapters or None,
            kept=found.chapters,
        )
    click.echo(f"written: {made}")


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@json_option
@click.pass_context
def verify(ctx: click.Context, folder: Path, as_json: bool) -> None:
    """Check the report in FOLDER: hash all inputs and outputs again, judge all verdicts again from the stored samples.

    Exit code 0 when all is as it was, 1 when anything changed or is missing, with what exactly.
    """
    from dataclasses import asdict

    from ..archive.manifest import NAME
    from ..archive.origins import sha256
    from ..archive.verification import KINDS
    from ..archive.verification import verify as check

    with progress("hash all files, judge all verdicts again"):
        found = check(folder)
    bad = [item for item in found if item.state != "same"]
    if as_json:
        document([asdict(item) for item in found])
    else:
        counts = {kind: sum(item.kind == kind for item in found) for kind in KINDS}
        if bad:
            table(("what", "name", "state", "detail"), [(item.kind, item.name, item.state, item.detail) for item in bad])
        checked = ", ".join(f"{count} {kind}{'' if count == 1 else 's'}" for kind, count in counts.items())
        click.echo(f"{len(bad)} of {len(found)} differ ({checked} checked)" if bad else f"all as it was: {checked} checked")
        click.echo(f"SHA-256 of {NAME}, to be signed: {sha256(folder / NAME)}")
        click.echo("not covered: who wrote the report, and page and PDF but for their hashes")
    ctx.exit(1 if bad else 0)
