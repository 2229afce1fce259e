"""Summary of a match: verdicts, corrected model and failures as plain data, and their print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import click

from flightmech.support.console import print_remark, print_table

# Statuses other than a pass, and their words behind the number of passes.
_OTHER_STATUSES = {
    "pass_with_departures": "{} more with departures",
    "limits_exceeded": "{} more with a trim beyond its limits (LIMITS)",
    "record_error": "{} more on a record with errors (RECORD)",
    "leak": "{} on a record that identified the model (LEAK)",
    "not_driven": "{} not driven by the inputs (NOT DRIVEN)",
    "demonstration": "{} demonstrations without a tolerance",
}


def summarise_match(outcome: Any) -> dict[str, Any]:
    """Return columns and rows of the verdicts, further lines, failures and written files."""
    results = outcome.results
    runs = list(dict.fromkeys(chain.from_iterable(result.runs for result in results)))
    rows = []
    for result in results:
        verdicts = [_verdict_cell(result, run) for run in runs]
        rows.append([result.case.id, result.case.title, *verdicts])
    failures = [*outcome.record_errors, *outcome.left_out]
    failures += [f"{result.case.name}: {result.failure}" for result in results if result.failure]
    return {
        "columns": ["row", "case", *runs],
        "rows": rows,
        "lines": [*_run_lines(results, runs), *_correction_lines(outcome)],
        "failures": failures,
        "files": outcome.files,
    }


def _run_lines(results: Sequence[Any], runs: Sequence[str]) -> list[str]:
    """Return the numbers of passes of each run, and the results of the sampled models."""
    # An unchanged match loads no module that computes.
    from pom.report.case.remarks import sampled_line

    lines = []
    for run in runs:
        # A device has recorded only some of the cases.
        statuses = [result.status(run) for result in results if run in result.runs]
        parts = [f"{run:>10}: {statuses.count('pass')} of {len(statuses)} pass"]
        for status, text in _OTHER_STATUSES.items():
            if status in statuses:
                parts.append(text.format(statuses.count(status)))
        lines.append(", ".join(parts))
    for result in results:
        heading = f"{result.case.id:<8}{result.case.title:<44}"
        lines += [f"{heading} {run}: {sampled_line(result, run)}" for run in result.samples]
    return lines


def _correction_lines(outcome: Any) -> list[str]:
    """Return the terms and submodels of the corrected model, and the ranking of the terms."""
    lines = [
        f"corrected = {outcome.prior_model} with {len(outcome.corrected_terms)} of the "
        f"{outcome.differing} terms and parts of final that differ"
    ]
    for submodel, names in outcome.corrected_submodels.items():
        lines.append(f"{submodel:>15}: {', '.join(names)}")
    for name, terms in outcome.joint_terms.items():
        lines.append(
            f"added for {name}, which does not pass with only the terms that the cases need one "
            f"by one: {', '.join(terms)}"
        )
    return [*lines, *outcome.ranking]


def _verdict_cell(result: Any, run: str) -> str:
    """Return the verdict of a run with the row that decided it."""
    # An unchanged match loads no module that computes.
    from pom.status import ratio_shows_verdict, status_text

    if run not in result.runs:
        return "not run"
    row, text = result.deciding_row(run), status_text(result.status(run))
    if not row:
        return text
    # A row that is not judged, or that fails for another reason, has no ratio.
    ratio = "\N{EN DASH}"
    if ratio_shows_verdict(row):
        ratio = f"{row['worst_ratio']:.2f}"
    return f"{text}  {ratio}  {row['criterion'].replace('_', ' ')}"


def print_summary(summary: Mapping[str, Any]) -> None:
    """Print the verdicts, the lines, the failures, and the place of the report."""
    if summary["rows"]:
        title = "Verdicts: worst difference / tolerance, of the alternatives the better one"
        rows = [tuple(row) for row in summary["rows"]]
        print_table(summary["columns"], rows, title=title)
    for text in summary["lines"]:
        click.echo(text)
    for text in summary["failures"]:
        print_remark(text)
    report = summary["document"]["report"]
    if report:
        click.echo(f"report: {report}")
    else:
        click.echo("the project has no case: nothing was proven, and no report was written")
