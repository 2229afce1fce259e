"""Parts of a report that belong to one case: its page, its numbers, its CSV file, its drawings.

The cases of a long report are shared out to processes.  With kept stages, only the parts of changed
cases are made again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
from joblib import delayed, effective_n_jobs

from flightmech.support.kept_stages.sharing import process_pool
from flightmech.support.kept_stages.stages import Stages
from pom.archive.origins import case_seen_from, with_full_places
from pom.archive.results_document import CaseText, case_results_text
from pom.judging.measures.modal import mode_table
from pom.report.case.page import CommonHeading, PackedPage, packed_page, provenance_of
from pom.report.exports import case_csv
from pom.report.pdf.content import case_on_paper
from pom.report.presentation.unit_sets import shown_in
from pom.result import PomResult

CSV = "csv"
LEAST_SHARE = 20
"""Cases that keep a process busy for as long as its start takes, about a second."""


@dataclass(frozen=True)
class CasePaths:
    """Folders to which the parts of a case are written.

    Attributes
    ----------
    folder : Path
        Folder of the report while it is written.  The CSV file of the case is written there.
    paper : str or None
        Paper of ``report.pdf``.  None if the report has no PDF.
    drawings : Path
        Folder of the drawings for paper.
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
        Page of the case in ``report.html``.
    text : CaseText
        Texts for ``results.json``.
    on_paper : dict
        Data for ``report.pdf`` (`pom.report.pdf.content.case_on_paper`).  Empty without a PDF.
    """

    page: PackedPage
    text: CaseText
    on_paper: dict[str, Any]


@dataclass(frozen=True)
class PartFiles:
    """Parts of one case with the contents of their files, for another process or a later run.

    Attributes
    ----------
    parts : CaseParts
    csv : bytes
        Content of the CSV file.
    drawings : dict of str to bytes
        Contents of the drawings, by file name.
    """

    parts: CaseParts
    csv: bytes
    drawings: dict[str, bytes]

    def write(self, key: str, paths: CasePaths) -> CaseParts:
        """Write the files where `case_parts` writes them, and return the parts."""
        _csv_path(paths, key).write_bytes(self.csv)
        for name, content in self.drawings.items():
            (paths.drawings / name).write_bytes(content)
        return self.parts


def case_parts(
    position: int,
    key: str,
    result: PomResult,
    heading: CommonHeading,
    diagnosis: pd.DataFrame | None,
    paths: CasePaths,
    report: Path | None = None,
) -> CaseParts:
    """Return the parts of one case, and write its CSV file and its drawings.

    Parameters
    ----------
    position : int
        Number of the case in the report, from one.
    key : str
        Key of the case (`pom.report.case.page.case_keys`).
    result : PomResult
    heading : CommonHeading
    diagnosis : DataFrame or None
        Table of `pom.diagnose` of the case.
    paths : CasePaths
        Folders of the files.
    report : Path, optional
        Files are named relative to this folder.  The default is ``paths.folder``.
    """
    with shown_in(heading.provenance.get("units", "")):
        return _make_case_parts(
            position, key, result, heading=heading, diagnosis=diagnosis, paths=paths, report=report
        )


def _make_case_parts(
    position: int,
    key: str,
    result: PomResult,
    *,
    heading: CommonHeading,
    diagnosis: pd.DataFrame | None,
    paths: CasePaths,
    report: Path | None,
) -> CaseParts:
    """Return the parts of one case in the units of the report."""
    # Page, PDF and JSON print the same fitted modes, so the fit is made once.
    modes = mode_table(result)
    with _csv_path(paths, key).open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(case_csv(result))

    page = packed_page(
        position, key, result=result, heading=heading, diagnosis=diagnosis, modes=modes
    )
    on_paper = {}
    if paths.paper is not None:
        on_paper = case_on_paper(
            paths.drawings,
            position,
            key=key,
            result=result,
            provenance=heading.provenance,
            diagnosis=diagnosis,
            modes=modes,
            paper=paths.paper,
        )
    return CaseParts(page, case_results_text(result, modes, report or paths.folder), on_paper)


def part_files(
    position: int,
    key: str,
    result: PomResult,
    heading: CommonHeading,
    diagnosis: pd.DataFrame | None,
    paper: str | None,
    report: Path,
) -> PartFiles:
    """Return the parts of a case with the contents of its files; arguments as in `case_parts`."""
    # Another process may run on another machine, so the result has the contents of the files.
    with TemporaryDirectory() as name:
        paths = CasePaths(Path(name) / "report", paper, Path(name) / "drawings")
        _csv_path(paths, key).parent.mkdir(parents=True)
        paths.drawings.mkdir()
        parts = case_parts(
            position,
            key,
            result=result,
            heading=heading,
            diagnosis=diagnosis,
            paths=paths,
            report=report,
        )
        csv_content = _csv_path(paths, key).read_bytes()
        return PartFiles(parts, csv_content, read_contents(paths.drawings))


def kept_parts(
    results: Sequence[PomResult],
    names: Sequence[str],
    heading: CommonHeading,
    diagnoses: Mapping[str, pd.DataFrame],
    paths: CasePaths,
    jobs: int,
    stages: Stages,
) -> list[CaseParts]:
    """Return the parts of every case, each case a kept stage.

    Only the parts of changed cases are made again.  The result is that of `parts_of_cases`.
    """
    inputs: dict[str, dict[str, Any]] = {}
    calls: dict[str, tuple[Any, ...]] = {}
    for position, (name, result) in enumerate(zip(names, results, strict=True), 1):
        # A case depends only on its part of the provenance: a change elsewhere keeps its pages.
        case_heading = replace(heading, provenance=provenance_of(result, heading.provenance))
        diagnosis = diagnoses.get(result.case.name)
        # Another process may have another working directory, so the call has full paths.
        calls[name] = (
            position,
            name,
            with_full_places(result),
            case_heading,
            diagnosis,
            paths.paper,
            paths.folder,
        )
        inputs[name] = {
            "position": position,
            "result": result,
            "heading": case_heading,
            "diagnosis": diagnosis,
            "paper": paths.paper,
            "place": case_seen_from(result.case, paths.folder),
        }

    processes = _process_count(jobs, len(results))
    stored = stages.each("report page", inputs, part_files, calls.__getitem__, processes)
    return [stored[name].value.write(name, paths) for name in names]


def parts_of_cases(
    results: Sequence[PomResult],
    names: Sequence[str],
    heading: CommonHeading,
    diagnoses: Mapping[str, pd.DataFrame],
    paths: CasePaths,
    jobs: int,
) -> Iterable[CaseParts]:
    """Return the parts of every case in order.

    If several processes share the cases, they start at once, before the first part is read.

    Parameters
    ----------
    results : sequence of PomResult
    names : sequence of str
        Keys of the results (`pom.report.case.page.case_keys`).
    heading : CommonHeading
    diagnoses : mapping of str to DataFrame
        Table of `pom.diagnose` by case name.
    paths : CasePaths
    jobs : int
        Number of simultaneous processes; -1 for one per core.  Each process has at least
        `LEAST_SHARE` cases.
    """
    # A generator: a result is prepared when a process is free for it.
    calls = (
        delayed(case_parts)(
            position,
            name,
            result=with_full_places(result),
            heading=heading,
            diagnosis=diagnoses.get(result.case.name),
            paths=paths,
        )
        for position, (name, result) in enumerate(zip(names, results, strict=True), 1)
    )
    return process_pool(_process_count(jobs, len(results)), return_as="generator")(calls)


def read_contents(folder: Path) -> dict[str, bytes]:
    """Return the contents of the files of a folder, by name."""
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}


def _csv_path(paths: CasePaths, key: str) -> Path:
    return paths.folder / CSV / f"{key}.csv"


def _process_count(jobs: int, cases: int) -> int:
    return max(1, min(effective_n_jobs(jobs), cases // LEAST_SHARE))
