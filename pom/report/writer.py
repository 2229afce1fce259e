"""The Proof-of-Match report: one page for a browser, one document for paper, and all numbers for
programs, written together.

Equal input gives equal bytes: dates come from the input, keys are sorted, no host name or clock is
read.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
import xarray as xr
from joblib import Parallel, delayed, effective_n_jobs

from flightmech.errors import SchemaError, UnknownName
from flightmech.support.atomic_write import folder_written_atomically
from flightmech.support.kept_stages.stages import Stages
from flighttest.regression.equation_error.fit import Fit
from pom.archive.archive import Archive, write_archive
from pom.archive.origins import (
    NAME,
    ReportProvenance,
    case_seen_from,
    check_provenance,
    file_sha256,
    report_manifest_text,
    with_full_places,
    without_places,
)
from pom.archive.results_document import CaseText, case_results_text, results_json
from pom.judging.measures.modal import mode_table
from pom.report.case.page import CommonHeading, PackedPage, case_keys, packed_page, provenance_of
from pom.report.chapters import CHAPTERS, Chapters, draw_chapters, restore_chapters, with_kept
from pom.report.exports import case_csv, junit_xml
from pom.report.models import diagnosis as tuning
from pom.report.page import PAGE, PAGES, html_files
from pom.report.pdf.content import case_on_paper
from pom.report.pdf.document import pdf_pages
from pom.report.submodels.sections import make_sections
from pom.result import PomResult

CSV = "csv"
LEAST_SHARE = 20
"""Cases that keep a process busy for as long as its start takes, about a second."""


@dataclass(frozen=True)
class CasePaths:
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
    heading: CommonHeading,
    diagnosis: pd.DataFrame | None,
    place: CasePaths,
    report: Path | None = None,
) -> CaseParts:
    """Return the parts of the case at `position`, counted from one, and write its CSV file and its
    drawings.

    Files are named as seen from the folder `report`, that of `place` unless given.
    """
    modes = mode_table(result)
    with (place.folder / CSV / f"{key}.csv").open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(case_csv(result))
    page = packed_page(position, key, result, heading, diagnosis, modes)
    on_paper = {}
    if place.paper is not None:
        on_paper = case_on_paper(
            place.drawings, position, key, result, heading.provenance, diagnosis, modes, place.paper
        )
    return CaseParts(page, case_results_text(result, modes, report or place.folder), on_paper)


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

    def write(self, key: str, place: CasePaths) -> CaseParts:
        """Write the files where `case_parts` writes them."""
        (place.folder / CSV / f"{key}.csv").write_bytes(self.csv)
        for name, content in self.drawings.items():
            (place.drawings / name).write_bytes(content)
        return self.parts


def part_files(
    position: int,
    key: str,
    result: PomResult,
    heading: CommonHeading,
    diagnosis: pd.DataFrame | None,
    paper: str | None,
    report: Path,
) -> PartFiles:
    """Return the parts of a case with their files; arguments as `case_parts`."""
    with TemporaryDirectory() as name:
        place = CasePaths(Path(name) / "report", paper, Path(name) / "drawings")
        (place.folder / CSV).mkdir(parents=True)
        place.drawings.mkdir()
        parts = case_parts(position, key, result, heading, diagnosis, place, report)
        drawings = {file.name: file.read_bytes() for file in sorted(place.drawings.iterdir())}
        return PartFiles(parts, (place.folder / CSV / f"{key}.csv").read_bytes(), drawings)


def kept_parts(
    results: Sequence[PomResult],
    names: Sequence[str],
    heading: CommonHeading,
    diagnoses: Mapping[str, pd.DataFrame],
    place: CasePaths,
    jobs: int,
    stages: Stages,
) -> list[CaseParts]:
    """Return the same as `parts_of_cases`, each case a stage: only cases that changed are made
    again.
    """
    inputs: dict[str, dict[str, Any]] = {}
    calls: dict[str, tuple[Any, ...]] = {}
    for position, (name, result) in enumerate(zip(names, results, strict=True), 1):
        own = replace(heading, provenance=provenance_of(result, heading.provenance))
        diagnosis = diagnoses.get(result.case.name)
        calls[name] = (
            position,
            name,
            with_full_places(result),
            own,
            diagnosis,
            place.paper,
            place.folder,
        )
        seen = case_seen_from(result.case, place.folder)
        inputs[name] = {
            "position": position,
            "result": result,
            "heading": own,
            "diagnosis": diagnosis,
            "paper": place.paper,
            "place": seen,
        }

    processes = max(1, min(effective_n_jobs(jobs), len(results) // LEAST_SHARE))
    made = stages.each("report page", inputs, part_files, calls.__getitem__, processes)
    return [made[name].value.write(name, place) for name in names]


def parts_of_cases(
    results: Sequence[PomResult],
    names: Sequence[str],
    heading: CommonHeading,
    diagnoses: Mapping[str, pd.DataFrame],
    place: CasePaths,
    jobs: int,
) -> Iterable[CaseParts]:
    """Return the parts of every case in their order; the work begins at once where it is shared out
    to processes.

    Parameters
    ----------
    names : sequence of str
        `case.case_keys` of the results.
    jobs : int
        Processes at the same time; -1 for one per core.  A process has `LEAST_SHARE` cases at
        least.
    """

    processes = max(1, min(effective_n_jobs(jobs), len(results) // LEAST_SHARE))
    calls = (
        delayed(case_parts)(
            i, name, with_full_places(result), heading, diagnoses.get(result.case.name), place
        )
        for i, (name, result) in enumerate(zip(names, results, strict=True), 1)
    )
    return Parallel(n_jobs=processes, return_as="generator")(calls)


PAPERS = ("a4", "letter")
PDF, JSON, SAMPLES, JUNIT = "report.pdf", "results.json", "results.nc", "results.xml"
PARTS = (PAGE, PAGES, PDF, JSON, SAMPLES, JUNIT, CSV, NAME)


def write_report(
    results: Sequence[PomResult],
    folder: str | os.PathLike,
    *,
    title: str,
    provenance: ReportProvenance | None = None,
    databases: Mapping[str, xr.DataTree] | None = None,
    diagnoses: Mapping[str, pd.DataFrame] | None = None,
    support: Mapping[str, pd.DataFrame] | None = None,
    fits: Sequence[Fit] = (),
    submodels: Mapping[str, Any] | None = None,
    free_motion: Mapping[str, Sequence[Any]] | None = None,
    driven_motion: Mapping[str, Sequence[xr.Dataset]] | None = None,
    tunings: Mapping[str, Mapping[str, Any]] | None = None,
    revision: str = "",
    paper: str | None = "a4",
    chapters: Sequence[str] | None = None,
    level_lines: Mapping[str, xr.Dataset] | None = None,
    kept: bytes | Chapters = b"",
    jobs: int = -1,
    stages: Stages | None = None,
) -> Path:
    """Write a report into a folder: ``report.html``, ``report.pdf`` and the numbers behind them.

    Next to the two: ``results.json`` (every printed number), ``results.nc`` (samples as exact
    doubles), ``results.xml`` (JUnit), ``csv/`` (one file per case) and ``manifest.json`` (SHA-256
    of every input and output).  A long report has ``pages/`` too, the cases that ``report.html``
    loads when they are opened.

    Parameters
    ----------
    results : sequence of PomResult
        In the order of the report.
    folder : path
        Made when missing.  It is exchanged as a whole: whoever looks finds the earlier report or
        this one, never files of both.  What is no part of a report stays in it.
    title : str
        Title of the report, e.g. the airplane and the model standard.
    provenance : Provenance, optional
        From `pom.provenance`: ``date`` of the results, ``command``, ``versions``, ``inputs`` (file
        to SHA-256) and their ``places``, ``models`` (run to ``file``, ``sha256`` and ``path``).
    databases : mapping of str to DataTree, optional
        Aero databases to set against each other, the prior first; names of runs take the line code
        of the runs.
    diagnoses : mapping of str to DataFrame, optional
        Case name to the table of `pom.diagnose`.
    support : mapping of str to DataFrame, optional
        Term (``CL/basic``) to the flight samples that support it, columns named after the axes of
        the term. [SI]
    fits : sequence of flighttest.Fit
        Local models of the identification; the page shows their estimates, residuals and
        collinearity.
    submodels : mapping of str to EngineFit, IdentifiedLoading, GroundEffect or IdentifiedGear, optional
        Submodels identified from flight, by name: a chapter of page and PDF.
    free_motion : mapping of str to sequence of Flown, optional
        By submodel: the free motion of a control, of `IdentifiedLoading.fly`.
    driven_motion : mapping of str to sequence of Dataset (time,), optional
        By submodel: records of the slow motion of a control, whose force is drawn over the travel.
    tunings : mapping of str to mapping, optional
        Name of a model to the log of its tuning (`pom.tuning_content.read_log`): a chapter of page and PDF.
    revision : str
        Revision of the report, as the user counts them.
    paper : {"a4", "letter"}, optional
        Paper of ``report.pdf``; None leaves it out, and removes one of an earlier report.
    chapters : sequence of {"identification", "database"}, optional
        Chapters of the PDF behind the proof of match, which the page always has: `fits`, and
        `databases` against each other.  Unless given none, of `kept` those that the earlier report
        had.
    level_lines : mapping of str to Dataset (mach,), optional
        1 g lines of the map of the flights, of `aerodb.figures.one_g_lines`.
    kept : bytes or Chapters
        Chapters of an earlier report (`Archive.chapters`), or of `pom.report.drawn_chapters`, where
        no `databases`, `fits` or `submodels` are given.
    jobs : int
        Processes that share the cases of a long report; -1 for one per core.  The bytes are the
        same for any number.
    stages : Stages, optional
        Where the pages of cases and the PDF are kept; only what changed is made again.

    Returns
    -------
    Path
        Of ``report.html``.

    Raises
    ------
    SchemaError
        No results, another paper, a submodel of another kind, or a chapter that was not kept.
    UnknownName
        A diagnosis for a case or a tuning of a model that is not there, or a misspelt key of
        `provenance`.
    OSError
        The folder is read-only, a mount point, or the one that this process works in.
    """

    results, diagnoses = list(results), dict(diagnoses or {})
    located: dict[str, Any] = {**(provenance or {})}
    logs: dict[str, dict[str, Any]] = {run: dict(log) for run, log in (tunings or {}).items()}
    _check(results, located, diagnoses, logs, paper, chapters or ())
    made_from = without_places(located)
    found, tuned = (
        make_sections(submodels or {}, free_motion or {}, driven_motion),
        tuning.tuning_context(logs, results),
    )
    shown = draw_chapters(
        databases or {}, support or {}, fits, level_lines or {}, found, diagnoses, chapters or ()
    )
    if isinstance(kept, Chapters):
        shown = kept
    elif kept:
        shown = with_kept(shown, restore_chapters(kept), chapters)
    as_kept = shown.kept()  # once: that of a programme has megabytes
    archive, names = (
        Archive(results, title, revision, made_from, diagnoses, paper or "", logs, as_kept),
        case_keys(results),
    )
    heading = CommonHeading(title, revision, len(results), made_from, bool(shown.databases))
    folder = Path(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with (
        folder_written_atomically(folder, PARTS.__contains__) as new,
        TemporaryDirectory() as drawings,
    ):

        def manifested() -> str:
            outputs = {
                file.relative_to(new).as_posix(): file_sha256(file)
                for file in new.rglob("*")
                if file.is_file()
            }
            return report_manifest_text(
                results,
                outputs,
                new,
                title=title,
                revision=revision,
                paper=paper,
                provenance=located,
            )

        (new / CSV).mkdir()
        place = CasePaths(new.resolve(), paper, Path(drawings))
        if stages is None:
            begun = parts_of_cases(results, names, heading, diagnoses, place, jobs)
        else:
            begun = kept_parts(results, names, heading, diagnoses, place, jobs, stages)
        write_archive(new / SAMPLES, archive, names)  # while other processes make the parts
        _write(new / JUNIT, junit_xml(results, title))
        parts = list(begun)
        pages = [part.page for part in parts]
        page = html_files(results, pages, title, revision, made_from, shown, tuned)
        for name, text in page.items():
            (new / name).parent.mkdir(exist_ok=True)
            _write(new / name, text)
        _write(new / JSON, results_json(archive, [part.text for part in parts]))
        if paper is not None:
            attached = {JSON: (new / JSON).read_bytes(), NAME: manifested().encode("utf-8")}
            on_paper = [part.on_paper for part in parts]
            common = (title, revision, made_from, paper, attached, shown, tuned)

            def printed() -> bytes:
                return pdf_pages(Path(drawings), results, names, on_paper, *common)

            if stages is None:
                paged = printed()
            else:
                inputs = {
                    "cases": on_paper,
                    "names": names,
                    "common": [*common[:-2], as_kept, tuned],
                }
                inputs |= {"drawings": _contents(drawings), "results": results}
                paged = stages.one("report pdf", inputs, printed).value
            (new / PDF).write_bytes(paged)
        _write(new / NAME, manifested())
    return folder / PAGE


def _check(
    results: Sequence[PomResult],
    provenance: Mapping[str, Any],
    diagnoses: Mapping[str, Any],
    tunings: Mapping[str, Any],
    paper: str | None,
    chapters: Sequence[str],
) -> None:
    if not results:
        raise SchemaError("report", ["no results came; give the outcome of at least one case"])
    if paper is not None and paper not in PAPERS:
        raise SchemaError(
            "report",
            [f"paper is {paper!r}; give {' or '.join(map(repr, PAPERS))}, or None for no PDF"],
        )
    for chapter in chapters:
        if chapter not in CHAPTERS:
            raise UnknownName(chapter, CHAPTERS, "chapter")
    check_provenance(provenance)
    names = {result.case.name for result in results}
    for name in diagnoses:
        if name not in names:
            raise UnknownName(name, names, "case", "diagnoses are named after cases")
    runs = {run for result in results for run in result.runs}
    for run in tunings:
        if run not in runs:
            raise UnknownName(run, runs, "model", "a tuning is that of a model")


def _contents(folder: str) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted(Path(folder).iterdir())}


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
