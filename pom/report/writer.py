"""Proof-of-Match report: HTML page, PDF document and files of all numbers, written together.

Equal input gives equal bytes.  Dates are part of the input, keys are sorted, and neither the host
name nor the clock is read.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Unpack

from flightmech.errors import SchemaError, UnknownName
from flightmech.support.atomic_write import folder_written_atomically
from flightmech.support.kept_stages.stages import Stages
from pom.archive.archive import Archive, write_archive
from pom.archive.origins import (
    NAME,
    ReportProvenance,
    check_provenance,
    file_sha256,
    report_manifest_text,
    without_places,
)
from pom.archive.results_document import results_json
from pom.report.case.page import CommonHeading, case_keys
from pom.report.case_parts import (
    CSV,
    CaseParts,
    CasePaths,
    kept_parts,
    parts_of_cases,
    read_contents,
)
from pom.report.chapters import (
    CHAPTERS,
    Chapters,
    ReportEvidence,
    draw_chapters,
    restore_chapters,
    with_kept,
)
from pom.report.exports import junit_xml
from pom.report.models.tuning import tuning_context
from pom.report.page import PAGE, PAGES, html_files
from pom.report.pdf.document import DocumentContent, document_date, pdf_pages
from pom.report.presentation.unit_sets import SETS, shown_in
from pom.report.submodels.envelope import envelope_section
from pom.report.submodels.sections import make_sections
from pom.result import PomResult
from pom.tolerances.editions import test_order

PAPERS = ("a4", "letter")
PDF, JSON, SAMPLES, JUNIT = "report.pdf", "results.json", "results.nc", "results.xml"
PARTS = (PAGE, PAGES, PDF, JSON, SAMPLES, JUNIT, CSV, NAME)
"""Files and folders that belong to a report; other files in its folder stay."""


@dataclass(frozen=True)
class _Report:
    """Content of one report, checked.

    Attributes
    ----------
    archive : Archive
        Results, title, revision, diagnoses, and the provenance that the report prints.
    names : list of str
        Keys of the cases.
    provenance : dict
        Provenance with the paths of the inputs, for the manifest.
    chapters : Chapters
    tunings : list of dict
        Tunings as page and PDF show them (`tuning_context`).
    paper : str or None
        Paper of the PDF; None for no PDF.
    """

    archive: Archive
    names: list[str]
    provenance: dict[str, Any]
    chapters: Chapters
    tunings: list[dict[str, Any]]
    paper: str | None


def write_report(
    results: Sequence[PomResult],
    folder: str | os.PathLike,
    *,
    title: str,
    provenance: ReportProvenance | None = None,
    revision: str = "",
    paper: str | None = "a4",
    chapters: Sequence[str] | None = None,
    jobs: int = -1,
    stages: Stages | None = None,
    **evidence: Unpack[ReportEvidence],
) -> Path:
    """Write a report into a folder: ``report.html``, ``report.pdf`` and the numbers behind them.

    Further files are ``results.json`` (every printed number), ``results.nc`` (samples as exact
    doubles), ``results.xml`` (JUnit), ``csv/`` (one file per case) and ``manifest.json`` (SHA-256
    of every input and output).  A long report also has ``pages/``.  ``report.html`` loads a case
    from there when the reader opens it.

    Parameters
    ----------
    results : sequence of PomResult
        Results; the report has the tests in the order of their numbers.
    folder : path
        Folder of the report; created if missing.  It is replaced as a whole: a reader sees the
        earlier report or the new one, never files of both.  Files that do not belong to a report
        stay in it.
    title : str
        Title of the report, e.g. the airplane and the model standard.
    provenance : Provenance, optional
        Result of `pom.provenance`: ``date`` of the results, ``command``, ``versions``, ``inputs``
        (file to SHA-256) and their ``places``, ``models`` (run to ``file``, ``sha256`` and
        ``path``).
    revision : str
        Revision of the report, as the user counts them.
    paper : {"a4", "letter"}, optional
        Paper of ``report.pdf``.  None writes no PDF, and removes the PDF of an earlier report.
    chapters : sequence of {"identification", "database"}, optional
        Chapters that the PDF prints after the proof of match: `fits`, and the comparison of
        `databases`.  The page always has both.  The default is none; with `kept`, the default is
        the selection of the earlier report.
    jobs : int
        Number of processes that share the cases of a long report; -1 for one per core.  The bytes
        do not depend on the number.
    stages : Stages, optional
        Store of the pages of cases and of the PDF.  Only changed parts are made again.
    databases, fits, submodels, diagnoses, tunings ... : optional
        Data behind the results, see `pom.report.chapters.ReportEvidence`.

    Returns
    -------
    Path
        Path of ``report.html``.

    Raises
    ------
    SchemaError
        No results, an unknown paper, a submodel of an unknown kind, or a chapter that was not
        kept.
    UnknownName
        A diagnosis of an unknown case, a tuning of an unknown model, an unknown key of
        `provenance`, or an unknown keyword.
    OSError
        The folder is read-only, a mount point, or the working directory of this process.
    """
    for name in evidence:
        if name not in ReportEvidence.__annotations__:
            raise UnknownName(name, ReportEvidence.__annotations__, "keyword of write_report")
    # tests in the order of the table; cases of one test in the order given
    results = sorted(results, key=lambda result: test_order(result.case.id))
    diagnoses = dict(evidence.get("diagnoses") or {})
    # The provenance with the paths of this machine is for the manifest only.
    located: dict[str, Any] = {**(provenance or {})}
    logs = {run: dict(log) for run, log in (evidence.get("tunings") or {}).items()}
    _check_request(
        results,
        located,
        diagnoses=diagnoses,
        tunings=logs,
        paper=paper,
        chapters=chapters or (),
    )
    sections = make_sections(
        evidence.get("submodels") or {},
        evidence.get("free_motion") or {},
        evidence.get("driven_motion"),
    )
    tuned = tuning_context(logs, results)
    with shown_in(located.get("units", "")):
        new_chapters = draw_chapters(
            evidence.get("databases") or {},
            evidence.get("support") or {},
            fits=evidence.get("fits", ()),
            level_lines=evidence.get("level_lines") or {},
            submodels=sections,
            diagnoses=diagnoses,
            on_paper=chapters or (),
        )
    all_chapters = _merge_chapters(new_chapters, evidence.get("kept", b""), chapters)
    archive = Archive(
        results,
        title,
        revision=revision,
        provenance=without_places(located),
        diagnoses=diagnoses,
        paper=paper or "",
        tunings=logs,
        chapters=all_chapters.kept(),
    )
    if all_chapters.maps:
        # the archive has the maps alone; the flights in them are those of this report
        section = envelope_section(all_chapters.maps, results)
        submodels_shown = (*all_chapters.submodels, section)
        all_chapters = replace(all_chapters, submodels=submodels_shown)
    report = _Report(
        archive, case_keys(results), located, chapters=all_chapters, tunings=tuned, paper=paper
    )

    folder = Path(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    # A reader sees the earlier report until all files of the new one are complete.
    with (
        shown_in(located.get("units", "")),
        folder_written_atomically(folder, PARTS.__contains__) as new,
        TemporaryDirectory() as drawings,
    ):
        _write_files(report, new, Path(drawings), jobs, stages)
    return folder / PAGE


def _merge_chapters(
    new: Chapters, kept: bytes | Chapters, on_paper: Sequence[str] | None
) -> Chapters:
    """Return the chapters of this report, completed by those of an earlier one."""
    if isinstance(kept, Chapters):
        return kept
    if kept:
        return with_kept(new, restore_chapters(kept), on_paper)
    return new


def _write_files(
    report: _Report, folder: Path, drawings: Path, jobs: int, stages: Stages | None
) -> None:
    """Write all files of a report into a new folder."""
    archive = report.archive
    # The parts of the cases have their CSV files written into this folder.
    (folder / CSV).mkdir()
    begun = _begin_cases(
        report, CasePaths(folder.resolve(), report.paper, drawings), jobs=jobs, stages=stages
    )
    # These two files are written while other processes make the parts of the cases.
    write_archive(folder / SAMPLES, archive, report.names)
    _write_text(folder / JUNIT, junit_xml(archive.results, archive.title))

    parts = list(begun)
    page_files = html_files(
        archive.results,
        [part.page for part in parts],
        title=archive.title,
        revision=archive.revision,
        provenance=archive.provenance,
        chapters=report.chapters,
        tunings=report.tunings,
    )
    for name, text in page_files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        _write_text(folder / name, text)
    _write_text(folder / JSON, results_json(archive, [part.text for part in parts]))
    # The PDF has the numbers and the manifest of the other files attached, so it comes after them.
    # The manifest of the folder also lists the PDF, so it comes last.
    if report.paper is not None:
        (folder / PDF).write_bytes(_make_pdf(report, parts, folder, drawings, stages=stages))
    _write_text(folder / NAME, _manifest_text(report, folder))


def _begin_cases(
    report: _Report, paths: CasePaths, jobs: int, stages: Stages | None
) -> Iterable[CaseParts]:
    """Start to make the parts of all cases; return them in order."""
    archive = report.archive
    heading = CommonHeading(
        len(archive.results),
        archive.provenance,
        bool(report.chapters.databases),
    )
    common: dict[str, Any] = {
        "names": report.names,
        "heading": heading,
        "diagnoses": archive.diagnoses,
        "paths": paths,
        "jobs": jobs,
    }
    if stages is None:
        return parts_of_cases(archive.results, **common)
    return kept_parts(archive.results, **common, stages=stages)


def _make_pdf(
    report: _Report,
    parts: Sequence[CaseParts],
    folder: Path,
    drawings: Path,
    stages: Stages | None,
) -> bytes:
    """Return ``report.pdf``, with the numbers and the manifest of the other files attached."""
    archive = report.archive
    cases = [part.on_paper for part in parts]
    attached = {
        JSON: (folder / JSON).read_bytes(),
        NAME: _manifest_text(report, folder).encode("utf-8"),
    }
    content = DocumentContent(
        title=archive.title,
        revision=archive.revision,
        provenance=archive.provenance,
        paper=report.paper or "",
        attached=attached,
        chapters=report.chapters,
        tunings=report.tunings,
        created=document_date(report.provenance),
    )

    def make_pages() -> bytes:
        return pdf_pages(drawings, archive.results, report.names, cases, content=content)

    if stages is None:
        return make_pages()
    # The chapters are compared by their stored bytes, which are made once per report.
    inputs = {
        "cases": cases,
        "names": report.names,
        "common": [
            content.title,
            content.revision,
            content.provenance,
            content.paper,
            content.created.isoformat(),
            attached,
            archive.chapters,
            report.tunings,
        ],
        "drawings": read_contents(drawings),
        "results": archive.results,
    }
    return stages.one("report pdf", inputs, make_pages).value


def _manifest_text(report: _Report, folder: Path) -> str:
    """Return the manifest of the files that the folder holds now."""
    outputs = {}
    for file in folder.rglob("*"):
        if file.is_file():
            outputs[file.relative_to(folder).as_posix()] = file_sha256(file)
    return report_manifest_text(
        report.archive.results,
        outputs,
        folder,
        title=report.archive.title,
        revision=report.archive.revision,
        paper=report.paper,
        provenance=report.provenance,
    )


def _check_request(
    results: Sequence[PomResult],
    provenance: Mapping[str, Any],
    diagnoses: Mapping[str, Any],
    tunings: Mapping[str, Any],
    paper: str | None,
    chapters: Sequence[str],
) -> None:
    """Raise if an argument of `write_report` is not allowed."""
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
    if provenance.get("units", "") not in SETS:
        raise UnknownName(provenance["units"], SETS, "set of units")
    names = {result.case.name for result in results}
    for name in diagnoses:
        if name not in names:
            raise UnknownName(name, names, "case", "diagnoses are named after cases")
    runs: set[str] = set()
    for result in results:
        runs.update(result.runs)
    for run in tunings:
        if run not in runs:
            raise UnknownName(run, runs, "model", "a tuning is that of a model")


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
