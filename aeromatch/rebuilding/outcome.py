"""What a match made."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flightmech.support.kept_stages.stages import Kept


@dataclass(frozen=True)
class Outcome:
    """What `aeromatch.workflow.perform` made.

    Attributes
    ----------
    results : list of PomResult
        One per case.
    corrected_terms : list of str
        Terms, and parts of the aircraft, that the corrected model takes from the final one.
    corrected_submodels : dict of str to list of str
        The same by submodel: ``aerodynamics``, ``ground effect``, ``control loading``, ``engine``, ``landing gear``.
    joint_terms : dict of str to list of str
        Those of them that no case needs alone: added since the terms of one case change another, by the case for which.
    differing : int
        Terms and parts that differ between the a-priori and the final model.
    tables : Kept
        Final database without its submodels, and the tabulation behind it.
    report : Path
        Of ``report.html``.
    files : list of str
        All that was written, from the output folder.
    record_errors : list of str
        Errors that the checks of the flight records found, a line each.
    """

    results: list[Any]
    corrected_terms: list[str]
    corrected_submodels: dict[str, list[str]]
    joint_terms: dict[str, list[str]]
    differing: int
    tables: Kept[tuple[Any, Any]]
    report: Path
    files: list[str]
    record_errors: list[str] = field(default_factory=list)

    @property
    def tabulation(self) -> Any:
        """How the terms came about, a `Tabulation`."""
        return self.tables.value[1]

    def to_dict(self) -> dict[str, Any]:
        """Return the verdicts as plain data."""
        return {
            "report": str(self.report),
            "corrected_terms": self.corrected_terms,
            "corrected_submodels": self.corrected_submodels,
            "joint_terms": self.joint_terms,
            "record_errors": self.record_errors,
            "differing": self.differing,
            "warnings": list(self.tabulation.notices),
            "cases": [
                {
                    "name": result.case.name,
                    "id": result.case.id,
                    "status": {run: result.status(run) for run in result.runs},
                    "verdict": result.verdict_records(),
                    "failure": result.failure,
                    "samples": {run: found.numbers() for run, found in result.samples.items()},
                }
                for result in self.results
            ],
        }
