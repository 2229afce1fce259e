"""What a report holds of one case: its page, its samples as CSV, its numbers, its pages on paper.

Cases know nothing of each other, so those of a long report are shared out to processes.  The parts come back in the order of the
cases and are the same bytes for any number of processes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from ..archive.results_document import CaseText, case_text
from ..judging.modal import mode_table
from ..result import PomResult
from .case.packed_page import Heading, PackedPage, packed_page
from .exports import case_csv

CSV = "csv"
LEAST_SHARE = 20
"""Cases that keep a process busy for as long as its start takes, about a second."""


@dataclass(frozen=True)
class Place:
    """Where the parts of a case go.

    Attributes
    ----------
    folder : Path
        Of the report while it is written; the CSV file of the case goes there.
    paper : str or None
        Of ``report.pdf``; None: there is none.
    drawings : Path
        Where the drawings for paper go.
    """

    folder: Path
    paper: str | None
    drawings: Path


@dataclass(frozen=True)
class CaseParts:
    """Parts of one case.

    Attributes
    ----------
    page : PackedPage
    text : CaseText
        For ``results.json``.
    on_paper : dict
        For ``report.pdf``, of `pdf.case_pages.case_on_paper`; empty without one.
    """

    page: PackedPage
    text: CaseText
    on_paper: dict[str, Any]


def case_parts(position: int, key: str, result: PomResult, heading: Heading, diagnosis: pd.DataFrame | None, place: Place) -> CaseParts:
    """Return the parts of the case at `position`, counted from one, and write its CSV file and its drawings."""
    modes = mode_table(result)
    with (place.folder / CSV / f"{key}.csv").open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(case_csv(result))
    page = packed_page(position, key, result, heading, diagnosis, modes)
    on_paper = {}
    if place.paper is not None:
        from .pdf.case_pages import case_on_paper

        on_paper = case_on_paper(place.drawings, position, key, result, heading.provenance, diagnosis, modes, place.paper)
    return CaseParts(page, case_text(result, modes, place.folder), on_paper)


def parts_of_cases(
    results: Sequence[PomResult], names: Sequence[str], heading: Heading, diagnoses: Mapping[str, pd.DataFrame], place: Place, jobs: int
) -> Iterable[CaseParts]:
    """Return the parts of every case in their order; the work begins at once where it is shared out to processes.

    Parameters
    ----------
    names : sequence of str
        `case.keys` of the results.
    jobs : int
        Processes at the same time; -1 for one per core.  A process has `LEAST_SHARE` cases at least.
    """
    from joblib import Parallel, delayed, effective_n_jobs

    processes = max(1, min(effective_n_jobs(jobs), len(results) // LEAST_SHARE))
    calls = (
        delayed(case_parts)(i, name, result, heading, diagnoses.get(result.case.name), place)
        for i, (name, result) in enumerate(zip(names, results, strict=True), 1)
    )
    return Parallel(n_jobs=processes, return_as="generator")(calls)
