"""Lines of the command ``run``: a result per case and model, as it comes and as a whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import click

from pom.checking.case_check import RecordCheck, with_record_checks
from pom.judging.conditions.report_conditions import has_report_conditions
from pom.replaying.run_remarks import calibration, drift, pilot_activity
from pom.report.case.remarks import run_notes, sampled_line
from pom.report.presentation.verdict_text import reason_text
from pom.result import PomResult
from pom.result_notices import (
    departure_remarks,
    input_notices,
    run_notices,
    spread_notice,
    trim_remarks,
    unprobed_text,
)
from pom.status import ratio_shows_verdict, status_text

NOTICE_INDENT = " " * 8


class ProgressPrinter:
    """Printer of the results of a batch as they come.

    Lines wait until the first model is replayed.  If none is, the error alone is printed.

    Attributes
    ----------
    is_replayed : bool
        A model was replayed in at least one case.

    Notes
    -----
    What only all cases together show follows at the end, for cases that were printed before.
    """

    def __init__(
        self, checks: Mapping[str, RecordCheck], runs: list[str], *, verbose: bool, silent: bool
    ):
        self.checks, self.runs = checks, runs
        self.verbose, self.silent = verbose, silent
        self.is_replayed = False
        self._waiting: list[str] = []
        self._shown: dict[tuple[str, str], list[str]] = {}

    def print_result(self, result: PomResult) -> None:
        """Print the lines of one result."""
        # cases of one test may have to show a condition together: they wait for the others
        if has_report_conditions(result.case):
            self.is_replayed = self.is_replayed or not result.failure
            return
        self._add(result)

    def print_rest(self, results: Sequence[PomResult]) -> None:
        """Print the lines of the results that waited for the others."""
        for result in results:
            if has_report_conditions(result.case):
                self._add(result)
            else:
                self._add_late_notices(result)

    def _add_late_notices(self, result: PomResult) -> None:
        """Print the notices of a result that came with the other cases."""
        (result,) = with_record_checks([result], self.checks)
        case, lines = result.case, []
        for run in result.runs:
            shown = self._shown.get((case.path, run), [])
            late = [text for text in run_notices(result, run) if text not in shown]
            if late and (result.status(run) != "fail" or self.verbose):
                lines.append(f"{case.id:<8}{case.title:<44} {run:<12} with all cases:")
                lines += [f"{NOTICE_INDENT}notice {text}" for text in late]
        if lines and self.is_replayed and not self.silent:
            click.echo("\n".join(lines))

    def _add(self, result: PomResult) -> None:
        (result,) = with_record_checks([result], self.checks)
        # a model that fails to run has an invalid case
        if not result.failure or any(result.status(run) != "invalid" for run in self.runs):
            self.is_replayed = True
        for run in result.runs:
            self._shown[result.case.path, run] = run_notices(result, run)
        self._waiting += result_lines(result, self.verbose)
        if self.is_replayed and not self.silent:
            click.echo("\n".join(self._waiting))
            self._waiting.clear()


def counts_text(statuses: Sequence[str]) -> str:
    """Return the number of cases by status, in the order of their first case."""
    counts = []
    for status in dict.fromkeys(statuses):
        counts.append(f"{statuses.count(status)} {status_text(status)}")
    return ", ".join(counts)


def result_lines(result: PomResult, verbose: bool = False) -> list[str]:
    """Return one line per model, and its notices.

    For example ``2.c.10  Short period  datcom  FAIL  1.6 x tolerance  theta +2.41 deg at 4.3 s
    (1.5 deg)``.
    """
    case, lines = result.case, []
    indent = NOTICE_INDENT
    for run in result.runs:
        lines.append(f"{case.id:<8}{case.title:<44} {run:<12} {_verdict_text(result, run)}")
        # a failed case needs no notices to be looked at
        if result.status(run) != "fail" or verbose:
            lines += [f"{indent}notice {text}" for text in run_notices(result, run)]
            if text := unprobed_text(result, run):
                lines.append(f"{indent}{text}")
        else:
            # but a wrong window, or the recording of another run, may be why it fails
            lines += [f"{indent}notice {text}" for text in input_notices(result, run)]
        if run in result.samples:
            lines.append(f"{indent}{sampled_line(result, run)}")
            unexplained = spread_notice(result, run)
            # A failed case needs it too: its probability may be that of a pass.
            if unexplained:
                lines.append(f"{indent}notice {unexplained}")
        if verbose:
            lines += [f"{indent}{text}" for text in run_notes(result, run)]
    return lines


def _verdict_text(result: PomResult, run: str) -> str:
    """Return the status of a model and the row that decides, which the report shows too."""
    status, row = result.status(run), result.deciding_row(run)
    text = status_text(status)
    if not row:
        return text
    if not ratio_shows_verdict(row):
        # a row without a number that decides has a reason; a failed model fails in all rows
        is_failure = any(remark.kind == "failure" for remark in row["remarks"])
        subject = "" if is_failure else f"{row['criterion']}: "
        return f"{text}  {subject}{reason_text(row['remarks'])}"
    # only a time history has an instant
    instant = f" at {row['at']:.1f} s" if row["measure"] == "trace" else ""
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    text += (
        f"  {row['worst_ratio']:.2f} x tolerance  {row['criterion']} "
        f"{row['worst']:+.3g}{unit}{instant} ({row['tolerance_text']})"
    )
    if status in ("limits_exceeded", "record_error", "leak", "not_driven"):
        text += "".join(f"; {remark}" for remark in trim_remarks(result, run))
    return text


def result_summary(result: PomResult) -> dict[str, Any]:
    """Return the numbers of a result for ``--json``."""
    return {
        "case": result.case.name,
        "id": result.case.id,
        "standard": result.case.standard,
        "edition": result.case.edition,
        "status": {run: result.status(run) for run in result.runs},
        "departures": {run: departure_remarks(result, run) for run in result.runs},
        "failure": result.failure,
        "verdict": result.verdict_records(),
        "trim": result.trim,
        "pilot": pilot_activity(result),
        "drift": drift(result),
        "calibration": calibration(result),
        "samples": {
            run: {**replay.numbers(), "unexplained": spread_notice(result, run)}
            for run, replay in result.samples.items()
        },
    }
