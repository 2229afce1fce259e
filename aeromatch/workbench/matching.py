"""Data of the page of the match: verdicts, causes of a mismatch, trials and tuning."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import aerodb
import pom
from aeromatch.workbench.opened import MATCH, OpenProject, pack_traces
from flightmech.errors import UnknownName
from flightmech.support.figures import to_display_quantity
from pom.cases.resolve import LIMIT_UNITS
from pom.cases.signatures import plain_signatures, signature_rows
from pom.report.case.page import case_keys
from pom.report.models.diagnosis import cause_sentences
from pom.result import results_name
from pom.status import status_text

RUNS, TUNED = "runs", "tuned"
"""Folders of the working folder: reports of trials, and tuned models."""

# Columns of the table of verdicts that the page shows.
_ROWS = (
    "criterion",
    "channel",
    "tolerance_text",
    "applied_text",
    "worst_ratio",
    "worst",
    "unit",
    "at",
    "verdict",
)
# Stages of a diagnosis that the page shows, and the greatest number of rows of a stage.
_STAGES = ("sequence", "joint", "single")
_MOST_ROWS = 12


def _open_archive(opened: OpenProject, folder: Path) -> Any:
    files = [folder / "results.nc", folder / "results.json"]
    return opened.kept(("archive", str(folder)), files, lambda: pom.read_archive(folder))


def _report_folder(opened: OpenProject, report: str) -> Path:
    """Return the folder of a report: ``match``, or ``runs/NAME`` of a trial."""
    folders = {MATCH: opened.work / MATCH / "report"}
    for name in _trial_names(opened):
        folders[f"{RUNS}/{name}"] = opened.work / RUNS / name
    if report not in folders:
        raise UnknownName(report, folders, "report")
    return folders[report]


def _trial_names(opened: OpenProject) -> list[str]:
    files = (opened.work / RUNS).glob("*/results.json")
    return sorted([file.parent.name for file in files])


def show_match(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the verdicts of a report, the trials, and the models for further flights.

    The query may have ``report``: ``match`` or ``runs/NAME``.
    """
    report = query.get("report", MATCH)
    match_folder = _report_folder(opened, MATCH)
    reports = [f"{RUNS}/{name}" for name in _trial_names(opened)]
    results = ""
    if (match_folder / "results.json").exists():
        reports.insert(0, MATCH)
        results = results_name(_open_archive(opened, match_folder).results)
    signatures = plain_signatures(opened.project.signatures)
    content: dict[str, Any] = {
        "project": opened.places.named(opened.file),
        "report": report,
        "reports": reports,
        "models": _model_files(opened),
        "databases": _database_files(opened),
        "tuned": _read_tuning(opened),
        "results": results,
        "signatures": signature_rows(signatures, "", results),
        "runs": [],
        "cases": [],
    }
    if report not in reports:
        return content
    folder = _report_folder(opened, report)
    archive = _open_archive(opened, folder)
    runs: dict[str, None] = {}
    for result in archive.results:
        runs |= dict.fromkeys(result.runs)
    content["runs"] = list(runs)
    content["place"] = folder.relative_to(opened.work).as_posix() + "/report.html"
    # The page edits the case files of the project, not the cases of the report.
    files = {name: opened.places.named(case.path) for name, case in _read_cases(opened).items()}
    for key, result in zip(case_keys(archive.results), archive.results, strict=True):
        row = _case_verdicts(key, result)
        row["file"] = files.get(result.case.name)
        content["cases"].append(row)
    return content


def _case_verdicts(key: str, result: pom.PomResult) -> dict[str, Any]:
    """Return status, worst ratio and its criterion of every model in a case."""
    statuses, passed, ratios, criteria = {}, {}, {}, {}
    for run in result.runs:
        status, row = result.status(run), result.deciding_row(run)
        statuses[run] = status_text(status)
        passed[run] = status == "pass"
        # None where the row that decides has no ratio
        ratio = float(row.get("worst_ratio", math.nan))
        ratios[run] = ratio if math.isfinite(ratio) else None
        criteria[run] = row.get("criterion", "").replace("_", " ")
    return {
        "key": key,
        "name": result.case.name,
        "row": result.case.id,
        "title": result.case.title,
        "status": statuses,
        "passed": passed,
        "worst": ratios,
        "criterion": criteria,
        "failure": result.failure,
    }


def show_case(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the criteria of one case for every model, and the cause of its mismatch.

    The query has the ``name`` of the case and may have ``report``.
    """
    report = query.get("report", MATCH)
    archive = _open_archive(opened, _report_folder(opened, report))
    results = {result.case.name: result for result in archive.results}
    name = query.get("name", "")
    if name not in results:
        raise UnknownName(name, results, "case")
    result, diagnosis = results[name], archive.diagnoses.get(name)
    # The case file may have changed since the report was made.
    case = _read_cases(opened).get(name, result.case)
    rows = []
    for row in result.verdict_records():
        rows.append({"run": row["run"], **{key: row.get(key) for key in _ROWS}})
    signed, date = results_name([result]), archive.provenance.get("date", "")
    criteria = dict.fromkeys([criterion.name for criterion in result.case.criteria])
    return {
        "name": name,
        "rows": rows,
        "causes": _cause_rows(diagnosis),
        "story": "" if diagnosis is None else cause_sentences(diagnosis),
        "rationale": dict(case.rationale),
        "ticks": dict(case.ticks),
        "results": signed,
        "signatures": signature_rows(case.signatures, date, signed),
        "subjects": [*criteria, *[f"trim.{quantity}" for quantity in LIMIT_UNITS]],
        "window": list(case.window),
        "notes": result.case.notes,
        "trial": report != MATCH,
    }


def pack_case_signals(opened: OpenProject, query: Mapping[str, str], body: Any) -> bytes:
    """Return the signals of the criteria of a case, in the form of `pack_traces`, in display units.

    The query has the ``name`` of the case and may have ``report``. A group is a channel with its
    ``unit``: the flight, every model, and ``low`` and ``high``, the band about the flight.
    """
    archive = _open_archive(opened, _report_folder(opened, query.get("report", MATCH)))
    results = {result.case.name: result for result in archive.results}
    name = query.get("name", "")
    if name not in results:
        raise UnknownName(name, results, "case")
    result = results[name]
    groups: list[tuple[dict[str, object], np.ndarray, dict[str, np.ndarray]]] = []
    for channel in dict.fromkeys([criterion.channel for criterion in result.case.criteria]):
        if channel not in result.signals:
            continue
        values, unit = _display_signals(result, channel)
        head: dict[str, object] = {"source": "case", "leaf": channel, "unit": unit}
        groups.append((head, result.signals["time"].values, values))
    return pack_traces(groups)


def _display_signals(result: pom.PomResult, channel: str) -> tuple[dict[str, np.ndarray], str]:
    """Return a channel of all runs with the band of the tolerance, and its unit for a display."""
    signals = result.signals[channel]
    values = {str(run): signals.sel(run=run).values for run in signals["run"].values}
    if channel in result.tolerance:
        half = result.tolerance[channel].values
        values |= {"low": values["flight"] - half, "high": values["flight"] + half}
    displayed, unit = {}, ""
    for run, samples in values.items():
        displayed[run], unit = to_display_quantity(channel, np.asarray(samples, float))
    return displayed, unit


def _cause_rows(diagnosis: pd.DataFrame | None) -> list[dict[str, Any]]:
    """Return the first rows of the stages of a diagnosis."""
    rows: list[dict[str, Any]] = []
    if diagnosis is None:
        return rows
    for stage in _STAGES:
        stage_rows = diagnosis[diagnosis["stage"] == stage].head(_MOST_ROWS)
        for row in stage_rows.to_dict("records"):
            facts = {key: row[key] for key in ("term", "explained", "verdict")}
            rows.append({"stage": stage, **facts})
    return rows


def list_scalable_terms(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the terms that can be scaled within their standard errors from flight.

    ``size`` is the largest value of a node in its standard errors.  A term scaled by 1 + k / size
    moves that node by k standard errors, and no other node by more.
    """
    file = opened.work / MATCH / "final.nc"
    if not file.exists():
        return {"terms": []}
    database = opened.kept(("database",), [file], lambda: aerodb.open(file))
    rows = []
    for name, leaf in aerodb.terms(database).items():
        if "stderr" in leaf:
            size = _largest_in_stderr(leaf["value"].values, leaf["stderr"].values)
            if size > 0.0:
                rows.append({"term": name, "size": size})
    return {"terms": rows}


def _largest_in_stderr(value: np.ndarray, stderr: np.ndarray) -> float:
    """Return the largest value in its standard errors; 0 if a term cannot be scaled.

    A scale would also move the nodes without a standard error, unless they are zero.
    """
    value, has_error = np.abs(value), stderr > 0.0
    if not has_error.any() or (value[stderr == 0.0] > 0.0).any():
        return 0.0
    ratio = np.divide(value, stderr, out=np.zeros_like(value), where=has_error)
    return float(np.max(ratio))


def _read_cases(opened: OpenProject) -> dict[str, pom.PomCase]:
    """Return the cases of the project by name, from their files as they are now."""
    cases = {}
    for file in opened.project.cases:
        case = _read_case(opened, file)
        cases[case.name] = case
    return cases


def _read_case(opened: OpenProject, file: Path) -> pom.PomCase:
    return opened.kept(("case",), [file], lambda: pom.read_case(file))


def _model_files(opened: OpenProject) -> list[dict[str, str]]:
    """Return the FMUs of the match, of edited databases, and of the tuning."""
    rows = []
    for folder in (MATCH, "databases", TUNED):
        for file in sorted((opened.work / folder).glob("*.fmu")):
            rows.append({"name": file.stem, "file": opened.places.named(file)})
    return rows


def _database_files(opened: OpenProject) -> list[dict[str, str]]:
    """Return the database of the match and the edited databases."""
    files = [opened.work / MATCH / "final.nc", *sorted((opened.work / "databases").glob("*.nc"))]
    rows = []
    for file in files:
        if file.exists():
            rows.append({"name": file.stem, "file": opened.places.named(file)})
    return rows


def _read_tuning(opened: OpenProject) -> dict[str, Any] | None:
    """Return the log of the last tuning, as ``pom tune`` wrote it."""
    file = opened.work / "tuning.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else None


ROUTES = {
    ("GET", "/api/match"): show_match,
    ("GET", "/api/case"): show_case,
    ("GET", "/api/case/signals"): pack_case_signals,
    ("GET", "/api/moves"): list_scalable_terms,
}
"""Requests of the page of the match, in the form of `records.ROUTES`."""
