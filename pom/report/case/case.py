"""What the page of one case shows: header, facts, tables, and the data of its plots."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

import pandas as pd

from pom.cases.signatures import signature_rows
from pom.result import PASSED, PomResult, notices, results_name

from ..models.diagnosis import cause
from ..presentation.quantities import fixed
from ..presentation.verdict_text import MODAL, Verdict, reason, verdict_table, words
from . import case_data, initial_conditions, probability, remarks
from . import modes as modal
from .case_figure import figures
from .cross_plots import crosses
from .inputs import driving
from .panels import panels

# the line code of LR-743 Figs. 18 to 21; any further model takes the next free style
_STYLES = {"datcom": "run-1", "corrected": "run-2", "final": "run-3"}
_SPARE = ("run-4", "run-5", "run-1", "run-2", "run-3")


_OF_ALL = ("document", "chapters")  # what ``results.nc`` holds next to the groups of the cases


def line_styles(runs: Iterable[str]) -> dict[str, str]:
    """Return the line class of every run, flight first."""
    runs = [run for run in runs if run != "flight"]
    taken = [_STYLES[run] for run in runs if run in _STYLES]
    spare = [style for style in _SPARE if style not in taken] + list(_SPARE) * len(runs)
    return {"flight": "run-0", **{run: _STYLES.get(run) or spare.pop(0) for run in runs}}


def keys(results: Sequence[PomResult]) -> list[str]:
    """Return a name per case, fit for an address and a file: unique without regard to case, as Windows and macOS compare them."""
    found: dict[str, str] = {}
    for result in results:
        stem = re.sub(r"[^A-Za-z0-9._-]+", "-", result.case.name).strip("-") or "case"
        key, n = stem, 1
        while key.lower() in found or key.lower() in _OF_ALL:
            n += 1
            key = f"{stem}-{n}"
        found[key.lower()] = key
    return list(found.values())


def case_page(
    key: str,
    result: PomResult,
    outcome: Sequence[Mapping[str, Any]],
    provenance: Mapping[str, Any],
    diagnosis: pd.DataFrame | None,
    modes: pd.DataFrame,
    with_figures: bool,
) -> dict[str, Any]:
    """Return everything the templates need for one case; `with_figures` draws those for readers without a script."""
    styles = line_styles(result.runs)
    shown, time = panels(result), result.signals["time"].values
    lines = {**styles, "applied": "run-0"}
    judged = [panel for panel in shown if panel.kind == "judged"]
    head, body = case_data.data(result, shown, crosses(result), styles)
    return {
        "key": key,
        "case": result.case,
        "objective": remarks.objective(result.case),
        "share": remarks.share(result.case.fraction),
        "outcomes": outcome,
        "failure": result.failure,
        "hashes": digests(result, provenance),
        "source": remarks.data_source(result),
        "calibration": initial_conditions.calibration(result),
        "conditions": initial_conditions.conditions(result.conditions, result.trim.index),
        "drive": driving(result),
        "trim": initial_conditions.trim(result),
        "drift": initial_conditions.drift(result),
        "verdicts": verdict_table(result),
        "modes": modal.mode_table(result, modes, styles),
        "probability": probability.probability_table(result),
        "cause": cause(result, diagnosis),
        "notes": remarks.notes(result),
        "rationales": remarks.rationales(result),
        "ticks": remarks.ticks(result),
        "results": (name := results_name([result])),
        "signatures": signature_rows(result.case.signatures, provenance.get("date", ""), name),
        "styles": styles,
        "plain": figures(f"{key}-plain", time, judged, lines, result.case.events) if with_figures else [],
        "head": head,
        "body": body,
    }


def outcomes(result: PomResult, styles: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return status, deciding criterion and worst ratio of every model."""
    rows = []
    applying = {c.name for c in result.case.criteria if c.applies}
    for run in result.runs:
        mine = [row for row in result.rows if row["run"] == run]
        status = result.status(run)
        found = result.worst(run)
        worst = {} if found is None else found
        if (
            status not in PASSED and not worst.get("worst_ratio", 0.0) > 1.0
        ):  # decided without a number, such as by a mode that is not there
            worst = next((row for row in mine if row["verdict"] == status and row["criterion"] in applying), worst)
        ratio = worst.get("worst_ratio", math.nan)
        at = math.nan if worst.get("measure") in MODAL else worst.get("at", math.nan)
        rows.append(
            {
                "run": run,
                "style": styles[run],
                "status": status,
                "verdict": Verdict.of(status),
                "ratio": ratio,
                "ratio_text": fixed(ratio, 2),
                "criterion": words(worst.get("criterion", "")),
                "why": "" if math.isfinite(ratio) else reason(worst.get("remarks", ())),
                "notices": notices(result, run),
                "at": at,
                "at_text": fixed(at, 2),
            }
        )
    return rows


def provenance_of(result: PomResult, provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page of one case shows of the provenance of a report: a change elsewhere leaves it as it is."""
    record = PurePath(result.case.record).name
    return {
        "date": provenance.get("date", ""),
        "versions": provenance.get("versions", {}),
        "inputs": {file: digest for file, digest in provenance.get("inputs", {}).items() if PurePath(file).name == record},
        "models": {run: model for run, model in provenance.get("models", {}).items() if run in result.runs},
    }


def digests(result: PomResult, provenance: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return (what, file, SHA-256) of the record and of every model."""
    inputs = provenance.get("inputs", {})
    record = PurePath(result.case.record).name
    known = [digest for file, digest in inputs.items() if PurePath(file).name == record]
    rows = [("flight record", record, known[0] if len(known) == 1 else "")]
    for run in result.runs:
        model = provenance.get("models", {}).get(run) or _flown(str(result.signals.attrs.get(f"model.{run}", "")))
        rows.append((f"model {run}", model.get("file", ""), model.get("sha256", "")))
    return rows


def _flown(text: str) -> dict[str, str]:
    """Return file and hash of what `pom.replay` states of a model: ``final.fmu, FMI 2.0, sha256 ...``."""
    file, _, rest = text.partition(", ")
    return {"file": file, "sha256": rest.partition("sha256 ")[2]}
