"""Functions that perform the commands of `pom.cli.report`."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

import click

import aerodb
from flightmech.quantities import time_text
from flightmech.support.atomic_write import write_text
from flightmech.support.console import (
    collect_options,
    command_line,
    count_text,
    print_json,
    print_remark,
    print_table,
    show_progress,
)
from flightmech.support.input_files import file_sha256
from flightmech.support.toml_models import schema_text, validate_content
from flighttest.reconstruction.flight_programme import open_biases
from pom.archive.flown_again import compare_flown_again
from pom.archive.origins import NAME, ReportProvenance, read_report_manifest
from pom.archive.report_signature import read_signature
from pom.archive.results_document import join_reports
from pom.archive.verification import KINDS, VerificationResult, verify
from pom.cases.case_file import case_schema
from pom.cases.drafting.draft import init_case
from pom.cases.signatures import Signatures, plain_signatures
from pom.checking.case_check import RecordCheck
from pom.checking.report_checks import with_joined_checks
from pom.replaying.replay_case import files_by_name
from pom.report.writer import SAMPLES, write_report
from pom.result import results_name
from pom.tolerances.editions import edition_of, titles_of_tests


def read_biases(file: str | None) -> Any:
    """Return the instrument constants of `biases_option`; None without a file."""
    if file is None:
        return None
    return open_biases(file)


def case_files(paths: Iterable[Path]) -> list[Path]:
    """Return the case files among files and folders."""
    paths = list(paths)
    files: list[Path] = []
    for path in paths:
        # sorted: the order of a folder depends on the file system
        if path.is_dir():
            files += sorted(path.glob("*.toml"))
        else:
            files.append(path)
    if not files:
        raise click.UsageError(f"no case file (*.toml) in {', '.join(map(str, paths))}")
    return files


def print_record_errors(checks: Mapping[str, RecordCheck]) -> None:
    """Print the errors of flight records as remarks."""
    for check in checks.values():
        for line in check.lines():
            print_remark(f"  {line}")


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
    # a script cannot answer the question for the test
    if test is None:
        if not _on_terminal():
            raise click.UsageError(
                "--test is missing; give the number of a row, such as --test 2.c.10 (on a "
                "terminal it is requested)"
            )
        test = _prompt_test(titles_of_tests(standard, edition))
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
        f"{case.id}  {case.title}  {time_text(case.window[0])} ... {time_text(case.window[1])} s  "
        f"{case.description}"
    )
    for text in remarks:
        print_remark(f"  - {text}")


def run_case_schema(output: str) -> None:
    """Perform the command ``schema``."""
    write_text(output, schema_text(case_schema()))
    click.echo(f"written: {output}")


def _on_terminal() -> bool:
    return sys.stdin.isatty()


def _prompt_test(titles: dict[str, str]) -> str:
    """Prompt for words of the title, then for one of the rows that fit; return the test."""
    fitting: dict[str, str] = {}
    while not fitting:
        text = click.prompt("What was flown? (words of the title, or a number)").lower()
        # all words must be in the number or the title
        for test, title in titles.items():
            row = f"{test} {title}".lower()
            if all(term in row for term in text.split()):
                fitting[test] = title
        if not fitting:
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
    """Return the signatures of ``--sign`` by role.

    Raises
    ------
    SchemaError
        A role or a date is not valid.
    """
    entries = {role: {"name": name, "date": date} for role, name, date in signed}
    content = validate_content(Signatures, {"signatures": entries}, "--sign")
    return plain_signatures(content.signatures)


@dataclass(frozen=True)
class ReportOptions:
    """Options of `pom.cli.report.report_options`.

    Attributes
    ----------
    revision : str
    date : str
        Date of the results as YYYY-MM-DD; empty if it is not stated.
    paper : {"a4", "letter"}
    units : {"SI", "kt-ft-lb"} or None
    no_pdf : bool
        Whether the report has no PDF.
    signed : tuple of (str, str, str)
        Role, name and date of each signature.
    """

    revision: str
    date: str
    paper: str
    units: str | None
    no_pdf: bool
    signed: tuple[tuple[str, str, str], ...]


@collect_options(options=ReportOptions)
def run_write_report(
    results: tuple[Path, ...],
    output: Path,
    title: str | None,
    databases: tuple[str, ...],
    chapters: tuple[str, ...],
    options: ReportOptions,
) -> None:
    """Perform the command ``report``."""
    signatures = signatures_of(options.signed)
    with show_progress("read the results"):
        archive = join_reports(results)
    if len(results) > 1:
        archive = replace(archive, results=with_joined_checks(archive.results))
    # The numbers keep their origin; command and date are those of this report.
    origin = {
        **archive.provenance,
        "command": command_line(),
        "date": options.date or archive.provenance.get("date", ""),
    }
    places = archive.provenance.get("places", {})
    if not any(Path(place).is_file() for place in places.values()):
        # the inputs are on another machine, so the results are the newest file that is here
        origin["places"] = {**places, **{str(path): str(_samples_file(path)) for path in results}}
    if options.units:
        origin["units"] = options.units
    if signatures:
        # a new signature states the results that were signed
        name = results_name(archive.results)
        for entry in signatures.values():
            entry["results"] = name
        origin["signatures"] = {**archive.provenance.get("signatures", {}), **signatures}
    opened = {}
    for run, file in files_by_name("--database", databases, "final=out/final.nc").items():
        opened[run] = aerodb.open(file)
    with show_progress(f"write the report of {len(archive.results)} cases"):
        report = write_report(
            archive.results,
            output,
            title=title or archive.title,
            provenance=cast("ReportProvenance", origin),
            databases=opened,
            diagnoses=archive.diagnoses,
            tunings=archive.tunings,
            revision=options.revision or archive.revision,
            paper=None if options.no_pdf else options.paper,
            chapters=chapters or None,
            kept=archive.chapters,
        )
    click.echo(f"written: {report}")


def _samples_file(path: Path) -> Path:
    """Return the file of the samples of a report, which is given by its folder or by the file."""
    return path / SAMPLES if path.is_dir() else path


def verify_report(
    ctx: click.Context, folder: Path, signers: Path | None, again: Path | None, as_json: bool
) -> None:
    """Perform the command ``verify``."""
    signature = read_signature(folder, signers)
    with show_progress("hash all files, judge all verdicts again"):
        items = verify(folder)
        if again is not None:
            items += compare_flown_again(folder, again)
    different = [item for item in items if item.state not in ("same", "unknown")]
    if as_json:
        state = "same" if signature.is_known else "unknown"
        if signature.is_refused:
            state = "changed"
        line = VerificationResult("signature", NAME, state, signature.text)
        print_json([asdict(item) for item in (line, *items)])
    else:
        click.echo(signature.text)
        _print_verification(items, different)
        click.echo(f"SHA-256 of {NAME}, to be signed: {file_sha256(folder / NAME)}")
        for item in items:
            if item.state == "unknown":
                click.echo(f"not checked: {item.kind} {item.name}: {item.detail}")
        if again is None:
            command = _command_of(folder)
            click.echo(
                f"not covered: whether flights, departures and probes are those of the inputs; fly "
                f"again ({command} with another -o) and compare: --against REPORT"
            )
        click.echo("not covered: page and PDF but for their hashes")
    ctx.exit(1 if different or signature.is_refused else 0)


def _command_of(folder: Path) -> str:
    """Return the command that wrote a report."""
    definition = read_report_manifest(folder)["predicate"]["buildDefinition"]
    return definition.get("externalParameters", {}).get("command", "") or "its command"


def _print_verification(
    items: Sequence[VerificationResult], different: Sequence[VerificationResult]
) -> None:
    """Print the items that differ, and how many of each kind were checked."""
    counts = Counter(item.kind for item in items)
    # without a second flight there is none to count
    shown = [kind for kind in KINDS if counts[kind] or kind != "flight"]
    checked = ", ".join(count_text(counts[kind], kind) for kind in shown)
    if not different:
        click.echo(f"all as it was: {checked} checked")
        return
    rows = [(item.kind, item.name, item.state, item.detail) for item in different]
    print_table(("what", "name", "state", "detail"), rows)
    click.echo(f"{len(different)} of {len(items)} differ ({checked} checked)")
