"""What a report holds of one case: its page, its samples as CSV, its numbers, its pages on paper.

Cases know nothing of each other, so those of a long report are shared out to processes.  The parts come back in the order of the
cases and are the same bytes for any number of processes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from flightmech.support.kept_stages.stages import Stages

from ..archive.origins import case_seen_from, with_full_places
from ..archive.results_document import CaseText, case_text
from ..judging.modal import mode_table
from ..result import PomResult
from .case.case import provenance_of
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


def case_parts(
    position: int,
    key: str,
    result: PomResult,
    heading: Heading,
    diagnosis: pd.DataFrame | None,
    place: Place,
    report: Path | None = None,
) -> CaseParts:
    """Return the parts of the case at `position`, counted from one, and write its CSV file and its drawings.

    Files are named as seen from the folder `report`, that of `place` unless given.
    """
    modes = mode_table(result)
    with (place.folder / CSV / f"{key}.csv").open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(case_csv(result))
    page = packed_page(position, key, result, heading, diagnosis, modes)
    on_paper = {}
    if place.paper is not None:
        from .pdf.case_pages import case_on_paper

        on_paper = case_on_paper(place.drawings, position, key, result, heading.provenance, diagnosis, modes, place.paper)
    return CaseParts(page, case_text(result, modes, report or place.folder), on_paper)


@dataclass(frozen=True)
class PartFiles:
    """Parts of one case with the files that go with them, for another process or another time.

    Attributes
    ----------
    parts : CaseParts
    csv : str
    drawings : dict of str to bytes
        By name.
    """

    parts: CaseParts
    csv: bytes
    drawings: dict[str, bytes]

    def write(self, key: str, place: Place) -> CaseParts:
        """Write the files where `case_parts` writes them."""
        (place.folder / CSV / f"{key}.csv").write_bytes(self.csv)
        for name, content in self.drawings.items():
            (place.drawings / name).write_bytes(content)
        return self.parts


def part_files(
    position: int, key: str, result: PomResult, heading: Heading, diagnosis: pd.DataFrame | None, paper: str | None, report: Path
) -> PartFiles:
    """Return the parts of a case with their files; arguments as `case_parts`."""
    with TemporaryDirectory() as name:
        place = Place(Path(name) / "report", paper, Path(name) / "drawings")
        (place.folder / CSV).mkdir(parents=True)
        place.drawings.mkdir()
        parts = case_parts(position, key, result, heading, diagnosis, place, report)
        drawings = {file.name: file.read_bytes() for file in sorted(place.drawings.iterdir())}
        return PartFiles(parts, (place.folder / CSV / f"{key}.csv").read_bytes(), drawings)


def kept_parts(
    results: Sequence[PomResult],
    names: Sequence[str],
    heading: Heading,
    diagnoses: Mapping[str, pd.DataFrame],
    place: Place,
    jobs: int,
    stages: Stages,
) -> list[CaseParts]:
    """Return the same as `parts_of_cases`, each case a stage: only cases that changed are made again."""
    inputs: dict[str, dict[str, Any]] = {}
    calls: dict[str, tuple[Any, ...]] = {}
    for position, (name, result) in enumerate(zip(names, results, strict=True), 1):
        own = replace(heading, provenance=provenance_of(result, heading.provenance))
        diagnosis = diagnoses.get(result.case.name)
        calls[name] = (position, name, with_full_places(result), own, diagnosis, place.paper, place.folder)
        seen = case_seen_from(result.case, place.folder)
        inputs[name] = {"position": position, "result": result, "heading": own, "diagnosis": diagnosis, "paper": place.paper, "place": seen}
    from joblib import effective_n_jobs

    processes = max(1, min(effective_n_jobs(jobs), len(results) // LEAST_SHARE))
    made = stages.each("report page", inputs, part_files, calls.__getitem__, processes)
    return [made[name].value.write(name, place) for name in names]


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
        delayed(case_parts)(i, name, with_full_places(result), heading, diagnoses.get(result.case.name), place)
        for i, (name, result) in enumerate(zip(names, results, strict=True), 1)
    )
    return Parallel(n_jobs=processes, return_as="generator")(calls)
