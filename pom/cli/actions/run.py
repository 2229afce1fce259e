"""Function that performs the command ``run`` of `pom.cli.group`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from flightmech.errors import SimulationError
from flightmech.support.console import (
    collect_options,
    command_line,
    print_json,
    show_progress,
)
from pom.archive.origins import ReportProvenance, provenance
from pom.checking.case_check import RecordCheck, checks_text, with_record_checks
from pom.checking.report_checks import with_report_checks
from pom.cli.actions.batch_files import BatchFiles, check_files, read_batch
from pom.cli.actions.evidence import open_evidence
from pom.cli.actions.report import read_biases, signatures_of
from pom.cli.actions.result_lines import ProgressPrinter, counts_text, result_summary
from pom.cli.actions.run_options import RunOptions
from pom.diagnosis.sampling.sampled_replay import replay_sampled
from pom.replaying.batch import replay_all
from pom.report.exports import write_junit
from pom.report.writer import write_report
from pom.result import PomResult
from pom.result_notices import NO_EVIDENCE, is_beyond_master, lacks_evidence


@collect_options(options=RunOptions)
def run_cases(ctx: click.Context, options: RunOptions) -> None:
    """Perform the command ``run``."""
    options.demand_pairs()
    signatures = signatures_of(options.signed)
    batch = read_batch(options)
    checks = check_files(
        batch, jobs=options.jobs, scheduler=options.scheduler, resume=options.resume
    )
    # the printer gets every result as soon as it is complete
    printer = ProgressPrinter(checks, batch.models, verbose=options.verbose, silent=options.as_json)
    results = with_report_checks(_replay_batch(batch, printer, options))
    printer.print_rest(results)
    results = with_record_checks(results, checks)
    # a file that changed during the batch does not belong to the results
    batch.custody.check()
    report = None
    if options.output is not None:
        origin = _origin(batch, checks, options, signatures)
        with show_progress("write the report"):
            report = write_report(
                results,
                options.output,
                title=options.title,
                revision=options.revision,
                provenance=origin,
                paper=None if options.no_pdf else options.paper,
                tunings=batch.logs,
                jobs=options.jobs,
            )
    if options.junit is not None:
        write_junit(options.junit, results, options.title)
    _print_results(batch, results, report=report, as_json=options.as_json)
    # a departure is stated, not a failure: every row passes; a demonstration cannot fail
    passed = {"pass", "pass_with_departures", "demonstration"}
    is_recurring = not any(map(is_beyond_master, results))
    ctx.exit(int(not (is_recurring and set(_statuses(batch, results)) <= passed)))


def _print_results(
    batch: BatchFiles, results: Sequence[PomResult], *, report: Path | None, as_json: bool
) -> None:
    if as_json:
        print_json([result_summary(result) for result in results])
        return
    models, cases = batch.size_texts
    click.echo(f"{models} x {cases}: {counts_text(_statuses(batch, results))}")
    if any(map(lacks_evidence, results)):
        click.echo(f"notice {NO_EVIDENCE} (--evidence DATABASE.nc)")
    if report is not None:
        click.echo(f"written: {report}")


def _replay_batch(
    batch: BatchFiles, printer: ProgressPrinter, options: RunOptions
) -> list[PomResult]:
    """Replay the cases of a batch, with draws if samples are requested.

    Raises
    ------
    SimulationError
        No model was replayed in any case.
    """
    models, cases = batch.size_texts
    given: dict[str, Any] = {
        "names": batch.names,
        "biases": read_biases(options.biases_file),
        "timeout": options.timeout,
        "jobs": options.jobs,
        "scheduler": options.scheduler,
        "resume": options.resume,
        "evidence": open_evidence(options.evidence) if options.evidence else None,
        "recorded": batch.recorded,
        "progress": printer.print_result,
    }
    with show_progress(f"replay {cases} by {models}", lines=not printer.silent):
        if options.samples:
            draws: dict[str, Any] = {"count": options.samples, "seed": options.seed}
            results = replay_sampled(batch.cases, batch.runs, batch.databases, **draws, **given)
        else:
            results = replay_all(batch.cases, batch.runs, **given)
    if not printer.is_replayed:
        raise SimulationError("no model could be replayed: " + results[0].failure)
    return results


def _origin(
    batch: BatchFiles,
    checks: Mapping[str, RecordCheck],
    options: RunOptions,
    signatures: Mapping[str, Mapping[str, str]],
) -> ReportProvenance:
    """Return the provenance of the report of a batch."""
    origin = provenance(
        batch.files,
        batch.single_files,
        command=command_line(),
        date=options.date,
        digest=batch.custody.sha256,
    )
    if signatures:
        origin["signatures"] = signatures
    record_errors = checks_text(checks.values())
    if record_errors:
        origin["record_errors"] = record_errors
    if options.units:
        origin["units"] = options.units
    return origin


def _statuses(batch: BatchFiles, results: Sequence[PomResult]) -> list[str]:
    """Return the status of every result and model."""
    statuses: list[str] = []
    for result in results:
        statuses += [result.status(run) for run in batch.models]
    return statuses
