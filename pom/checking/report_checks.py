"""Checks of a report as a whole: what no case shows alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pom.checking.model_identity import MODEL, identity_remarks
from pom.checking.record_agreement import OTHERS, disagreement_remarks
from pom.judging.conditions.condition_coverage import SHARED, SHARED_TESTS
from pom.judging.conditions.report_conditions import REPORT_CHECKS, with_report_conditions
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
        that several cases show, on records that disagree with the others on mass or
        temperature, and on a model that is not one file.
    """
    results = with_report_conditions(results)
    shared = shared_flight_remarks(results)
    results = [_with_remarks(*pair) for pair in zip(results, shared, strict=True)]
    for find in (disagreement_remarks, identity_remarks):
        remarks = find(results)
        results = [with_run_remarks(*pair) for pair in zip(results, remarks, strict=True)]
    return results


def with_joined_checks(results: Sequence[PomResult]) -> list[PomResult]:
    """Return results of several reports that state what their cases show together.

    Parameters
    ----------
    results : sequence of PomResult
        With the remarks of `with_report_checks` on each report alone, which are replaced.
    """
    return with_report_checks([_without_report_remarks(result) for result in results])


_OF_REPORT = {*REPORT_CHECKS, SHARED, SHARED_TESTS, MODEL}
"""Quantities of the remarks that only a report as a whole shows."""


def _without_report_remarks(result: PomResult) -> PomResult:
    rows = []
    for row in result.rows:
        kept = []
        for item in row["remarks"]:
            if item.quantity not in _OF_REPORT and OTHERS not in item.text:
                kept.append(item)
        rows.append({**row, "remarks": tuple(kept)})
    return replace(result, verdict=make_verdict_table(rows))  # type: ignore[arg-type]


def _with_remarks(result: PomResult, more: tuple[RowRemark, ...]) -> PomResult:
    if not more:
        return result
    rows = [{**row, "remarks": (*row["remarks"], *more)} for row in result.rows]
    return replace(result, verdict=make_verdict_table(rows))  # type: ignore[arg-type]
