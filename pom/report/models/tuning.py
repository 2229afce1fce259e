"""Chapter on the tuning of models, for page and PDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pom.diagnosis.tuning.tuning_log import (
    BASES,
    MOVES,
    NUMBERS,
    ROWS,
    log_rows,
    moves_of,
    outcome_sentence,
)
from pom.report.presentation.quantities import MISSING, fixed_decimals
from pom.report.submodels.section import SectionTable
from pom.result import PomResult
from pom.status import status_text

FLOWN = "in this report"
NOTE = (
    "Standard errors are those of the evidence. With the tuned model the wanted cases pass, and no "
    "other case ceases to pass. Of all such models it has the least Mahalanobis distance from the "
    "evidence. A term goes beyond the bound only where a rationale is written. moved: largest "
    "change of a node against the model before. share: of the squared distance from that model. "
    "nodes: those that moved by more than 0.01. ratio: of the criterion that decides, to its "
    "tolerance."
)


def tuning_context(
    tunings: Mapping[str, Mapping[str, Any]], results: Sequence[PomResult]
) -> list[dict[str, Any]]:
    """Return outcome, tables and remarks of every tuned model.

    Parameters
    ----------
    tunings : mapping of str to mapping
        Log of the tuning, by the run of the model.
    results : sequence of PomResult
        Results of the report.
    """
    return [_model_context(run, log, results) for run, log in tunings.items()]


def _model_context(
    run: str, log: Mapping[str, Any], results: Sequence[PomResult]
) -> dict[str, Any]:
    moves, omitted = moves_of(log)
    outcomes = {}
    for result in results:
        if run in result.runs:
            outcomes[result.case.name] = _describe_outcome(result, run)
    # The second cell of a row of the log is the case.
    rows = [(*cells, outcomes.get(cells[1], MISSING)) for cells in log_rows(log)]
    grids = []
    if moves:
        grids.append(SectionTable("What moved", MOVES, tuple(moves)))
    grids.append(SectionTable("What it did to every case", (*ROWS, FLOWN), tuple(rows)))
    files = []
    for role, file in log["files"].items():
        if role in BASES:
            files.append(f"{role} {file['name']} ({file['sha256'][:16]})")
    remarks = [f"files, SHA-256: {', '.join(files)}"]
    if omitted:
        remarks.insert(0, omitted)
    return {
        "run": run,
        "headline": outcome_sentence(log),
        "grids": grids,
        "remarks": remarks,
        "numbers": {*NUMBERS, FLOWN},
    }


def _describe_outcome(result: PomResult, run: str) -> str:
    """Return the worst ratio of a run in this report, if it has one, and its status."""
    row, status = result.deciding_row(run), status_text(result.status(run))
    return f"{fixed_decimals(row['worst_ratio'], 2)} {status}" if row else status
