"""What tuning moved and what it did to every case, as page and paper show it: the log of ``aeromatch pom tune``, next to what was flown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pom.result import PomResult, status_text
from pom.tuning.tuning_log import BASES, MOVES, NUMBERS, ROWS, headline, moves_of, rows_of

from ..presentation.quantities import MISSING, fixed
from ..submodels.section import Grid

FLOWN = "in this report"
NOTE = (
    "Standard errors are those of the evidence. The tuned model is the one at the least Mahalanobis distance from it with which the wanted "
    "cases pass and no other ceases to; a term goes beyond the bound only where a rationale is written. moved: largest change of a node "
    "against the model before; share: of the squared distance from that model; nodes: those that moved by more than 0.01; ratio: of the "
    "criterion that decides, to its tolerance."
)


def context(tunings: Mapping[str, Mapping[str, Any]], results: Sequence[PomResult]) -> list[dict[str, Any]]:
    """Return per tuned model its outcome in a sentence, what moved, the rows, and further words."""
    return [_of(run, log, results) for run, log in tunings.items()]


def _of(run: str, log: Mapping[str, Any], results: Sequence[PomResult]) -> dict[str, Any]:
    moves, rest = moves_of(log)
    flown = {result.case.name: _flown(result, run) for result in results if run in result.runs}
    rows = tuple((*cells, flown.get(cells[1], MISSING)) for cells in rows_of(log))
    grids = [Grid("What moved", MOVES, tuple(moves))] if moves else []
    grids.append(Grid("What it did to every case", (*ROWS, FLOWN), rows))
    files = ", ".join(f"{role} {file['name']} ({file['sha256'][:16]})" for role, file in log["files"].items() if role in BASES)
    remarks = [*([rest] if rest else []), f"files, SHA-256: {files}"]
    return {"run": run, "headline": headline(log), "grids": grids, "remarks": remarks, "numbers": {*NUMBERS, FLOWN}}


def _flown(result: PomResult, run: str) -> str:
    worst = result.worst(run)
    return f"{fixed(worst['worst_ratio'], 2)} {status_text(result.status(run))}" if worst is not None else status_text(result.status(run))
