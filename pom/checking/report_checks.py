"""Checks of a report as a whole: what no case shows alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pom.checking.record_agreement import disagreement_remarks
from pom.judging.report_conditions import with_report_conditions
from pom.probing.model_probes import with_run_remarks
from pom.probing.shared_flights import shared_flight_remarks
from pom.result import PomResult, make_verdict_table
from pom.tolerances.bands import RowRemark


def with_report_checks(results: Sequence[PomResult]) -> list[PomResult]:
    """Return results that state what the cases of a report show together.

    Parameters
    ----------
    results : sequence of PomResult
        All cases of a report.

    Returns
    -------
    list of PomResult
        With the remarks on conditions over several cases (`with_report_conditions`), on flights
        that several cases show, and on records that disagree with the others on mass or
        temperature.
    """
    results = with_report_conditions(results)
    shared = shared_flight_remarks(results)
    results = [_with_remarks(*pair) for pair in zip(results, shared, strict=True)]
    disagreements = disagreement_remarks(results)
    return [with_run_remarks(*pair) for pair in zip(results, disagreements, strict=True)]


def _with_remarks(result: PomResult, more: tuple[RowRemark, ...]) -> PomResult:
    if not more:
        return result
    rows = [{**row, "remarks": (*row["remarks"], *more)} for row in result.rows]
    return replace(result, verdict=make_verdict_table(rows))  # type: ignore[arg-type]
