"""Page of the match: verdicts of all cases and models, what explains a miss, trials by edited
databases, tuning.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import aerodb
import pom
from aeromatch.workbench.opened import MATCH, OpenProject
from flightmech.errors import UnknownName
from pom.cases.case_file import plain_signatures, signature_rows
from pom.cases.resolve import LIMIT_UNITS
from pom.report.case.page import case_keys
from pom.report.models.diagnosis import cause_sentences
from pom.result import results_name, status_text

RUNS, TUNED = "runs", "tuned"
"""Folders of the working folder: reports of trials, and tuned models."""

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
_STAGES = ("sequence", "joint", "single")
_MOST = 12  # single swaps that are listed


def _archive(opened: OpenProject, folder: Path) -> Any:
    files = [folder / "results.nc", folder / "results.json"]
    return opened.kept(("archive", str(folder)), files, lambda: pom.read_archive(folder))


def _report(opened: OpenProject, report: str) -> Path:
    """Return the folder of a report: ``match``, or the name of a trial."""
    folders = {
        MATCH: opened.work / MATCH / "report",
        **{f"{RUNS}/{name}": opened.work / RUNS / name for name in _trials(opened)},
    }
    if report not in folders:
        raise UnknownName(report, folders, "report")
    return folders[report]


def _trials(opened: OpenProject) -> list[str]:
    return sorted(file.parent.name for file in (opened.work / RUNS).glob("*/results.json"))


def show_match(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the verdicts of a report (``report``: ``match`` or ``runs/NAME``), the trials, and the
    models that can be flown.
    """
    report = query.get("report", MATCH)
    there = (opened.work / MATCH / "report" / "results.json").exists()
    found: dict[str, Any] = {
        "project": opened.places.named(opened.file),
        "report": report,
        "reports": [*([MATCH] if there else []), *(f"{RUNS}/{name}" for name in _trials(opened))],
        "models": _models(opened),
        "databases": _databases(opened),
        "tuned": _tuned(opened),
        "signatures": [],
        "runs": [],
        "cases": [],
    }
    signed = results_name(_archive(opened, _report(opened, MATCH)).results) if there else ""
    found |= {
        "results": signed,
        "signatures": signature_rows(plain_signatures(opened.project.signatures), "", signed),
    }
    if report not in found["reports"]:
        return found
    archive = _archive(opened, _report(opened, report))
    files = {name: opened.places.named(case.path) for name, case in _cases(opened).items()}
    found["runs"] = list(dict.fromkeys(run for result in archive.results for run in result.runs))
    found["place"] = _report(opened, report).relative_to(opened.work).as_posix() + "/report.html"
    for key, result in zip(case_keys(archive.results), archive.results, strict=True):
        worst = {run: result.worst(run) for run in result.runs}
        found["cases"].append(
            {
                "key": key,
                "name": result.case.name,
                "row": result.case.id,
                "title": result.case.title,
                "file": files.get(result.case.name),
                "status": {run: status_text(result.status(run)) for run in result.runs},
                "passed": {run: result.status(run) == "pass" for run in result.runs},
                "worst": {
                    run: None if one is None else one["worst_ratio"] for run, one in worst.items()
                },
                "criterion": {
                    run: "" if one is None else one["criterion"].replace("_", " ")
                    for run, one in worst.items()
                },
                "failure": result.failure,
            }
        )
    return found


def show_case(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the criteria of one case (``report``, ``name``) for every model, and what explains its
    miss.
    """
    archive = _archive(opened, _report(opened, query.get("report", MATCH)))
    results = {result.case.name: result for result in archive.results}
    name = query.get("name", "")
    if name not in results:
        raise UnknownName(name, results, "case")
    result, table = results[name], archive.diagnoses.get(name)
    now = _cases(opened).get(name, result.case)  # what has been written since the report was made
    rows = [
        {"run": row["run"], **{key: row.get(key) for key in _ROWS}}
        for row in result.verdict_records()
    ]
    causes = []
    if table is not None:
        for stage in _STAGES:
            part = table[table["stage"] == stage].head(_MOST)
            causes += [
                {"stage": stage, **{key: row[key] for key in ("term", "explained", "verdict")}}
                for row in part.to_dict("records")
            ]
    return {
        "name": name,
        "rows": rows,
        "causes": causes,
        "story": "" if table is None else cause_sentences(table),
        "rationale": dict(now.rationale),
        "ticks": dict(now.ticks),
        "results": (signed := results_name([result])),
        "signatures": signature_rows(now.signatures, archive.provenance.get("date", ""), signed),
        "subjects": [
            *dict.fromkeys(criterion.name for criterion in result.case.criteria),
            *(f"trim.{name}" for name in LIMIT_UNITS),
        ],
        "window": list(now.window),
        "notes": result.case.notes,
        "trial": query.get("report", MATCH) != MATCH,
    }


def list_scalable_terms(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the terms that can be scaled within what flight found: the largest value of a node in
    its standard errors.

    A term scaled by 1 + k / `size` moves that node by k standard errors, and no other by more.
    """
    file = opened.work / MATCH / "final.nc"
    if not file.exists():
        return {"terms": []}
    terms = aerodb.terms(opened.kept(("database",), [file], lambda: aerodb.open(file)))
    rows = []
    for name, leaf in terms.items():
        if "stderr" not in leaf:
            continue
        value, stderr = np.abs(leaf["value"].values), leaf["stderr"].values
        if (stderr > 0.0).any() and not (
            value[stderr == 0.0] > 0.0
        ).any():  # else a node without an error would move as well
            size = float(
                np.max(np.divide(value, stderr, out=np.zeros_like(value), where=stderr > 0.0))
            )
            if size > 0.0:
                rows.append({"term": name, "size": size})
    return {"terms": rows}


def _cases(opened: OpenProject) -> dict[str, pom.PomCase]:
    """Return the cases of the project by name, as their files are now."""

    def read(file: Path) -> pom.PomCase:
        return opened.kept(("case",), [file], lambda: pom.read_case(file))

    return {case.name: case for case in map(read, opened.project.cases)}


def _models(opened: OpenProject) -> list[dict[str, str]]:
    """Return the FMUs that can be flown: those of the match, edited and tuned ones."""
    files = [
        *sorted((opened.work / MATCH).glob("*.fmu")),
        *sorted((opened.work / "databases").glob("*.fmu")),
        *sorted((opened.work / TUNED).glob("*.fmu")),
    ]
    return [{"name": file.stem, "file": opened.places.named(file)} for file in files]


def _databases(opened: OpenProject) -> list[dict[str, str]]:
    files = [opened.work / MATCH / "final.nc", *sorted((opened.work / "databases").glob("*.nc"))]
    return [
        {"name": file.stem, "file": opened.places.named(file)} for file in files if file.exists()
    ]


def _tuned(opened: OpenProject) -> dict[str, Any] | None:
    """Return the log of the last tuning, as `pom tune` wrote it."""
    file = opened.work / "tuning.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else None


ROUTES = {
    ("GET", "/api/match"): show_match,
    ("GET", "/api/case"): show_case,
    ("GET", "/api/moves"): list_scalable_terms,
}
"""What the page of the match requests; as `records.ROUTES`."""
