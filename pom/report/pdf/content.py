"""Content of the PDF document, as plain data for the templates of typst.

Words and numbers are those of the HTML page.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from pom.cases.case import PomCase
from pom.cases.signatures import signature_rows
from pom.report.case import remarks
from pom.report.case.driving import describe_driving
from pom.report.case.page import digest_rows, outcome_rows, run_line_classes
from pom.report.case.start import (
    calibration_rows,
    condition_rows,
    drift_rows,
    glance_text,
    stated_conditions,
    trim_tables,
)
from pom.report.guide_texts import missing_texts
from pom.report.models.diagnosis import cause_sentences
from pom.report.overview import (
    departure_table,
    list_runs,
    own_tables_text,
    provenance_page,
    shown_statuses,
    table_coverage,
)
from pom.report.pdf.case_drawings import draw_case, panel_room
from pom.report.presentation.quantities import QuantityLabel
from pom.report.presentation.verdict_text import Verdict, verdict_blocks
from pom.report.submodels.section import Section, SectionTable
from pom.result import PomResult, results_name
from pom.tolerances.channels import plain_words
from pom.tolerances.rows import tolerance_rows

_REFERENCES = {
    "flight": "model against flight",
    "engineering": "model against an engineering simulator",
    "footprint": "footprint: no reference, no band, no verdict",
}


def front_content(
    results: Sequence[PomResult],
    keys: Sequence[str],
    title: str,
    revision: str,
    provenance: Mapping[str, Any],
    databases: Mapping[str, xr.DataTree],
) -> dict[str, Any]:
    """Return the data of cover, index, coverage, references and glossary.

    Parameters
    ----------
    results : sequence of PomResult
    keys : sequence of str
        Keys of the cases.
    title, revision : str
    provenance : mapping
        Provenance without paths.
    databases : mapping of str to DataTree
        Roots of the databases by name.
    """
    outcomes = [outcome_rows(result, run_line_classes(result.runs)) for result in results]
    # The pages of HTML and PDF print the same origin of the numbers.
    origin = provenance_page(provenance, results, databases)
    date = provenance.get("date", "")
    # Dictionaries keep the first of equal texts, in the order of the cases.
    standards: dict[str, None] = {}
    kinds: dict[str, None] = {}
    for result in results:
        standards[f"{result.case.standard}, edition {result.case.edition_words}"] = None
        kinds[_REFERENCES.get(result.case.reference, result.case.reference)] = None
    airplanes: dict[str, None] = {}
    for db in databases.values():
        if "aircraft" in db.attrs:
            airplanes[str(db.attrs["aircraft"])] = None
    return {
        "title": title,
        "revision": revision,
        "date": date,
        "command": provenance.get("command", ""),
        "tool": provenance.get("versions", {}).get("aeromatch", ""),
        "results": origin["results"],
        "signatures": signature_rows(provenance.get("signatures", {}), date, origin["results"]),
        "standards": list(standards),
        "kinds": list(kinds),
        "airplanes": list(airplanes),
        "index": _matrix_content(keys, results, outcomes),
        "no_evidence": origin["no_evidence"],
        "departures": departure_table(keys, results),
        "record_errors": origin["record_errors"],
        "tables": own_tables_text(results),
        "missing_texts": [asdict(item) for item in missing_texts(results)],
        "coverage": table_coverage(results, tolerance_rows()),
        "references": _references_content(results, origin, databases),
        "glossary": [_glossary_entry(label) for label in origin["glossary"]],
    }


def _references_content(
    results: Sequence[PomResult],
    origin: Mapping[str, Any],
    databases: Mapping[str, xr.DataTree],
) -> dict[str, Any]:
    """Return the files and documents that the results rest on."""
    # Models of other origin may have neither a file nor a digest.
    models = []
    for run, model in origin["models"]:
        models.append((run, model.get("file", ""), model.get("sha256", "")))
    sources = []
    for name, db in databases.items():
        sources.append((name, str(db.attrs.get("title", "")), str(db.attrs.get("source", ""))))
    absent = [(name, ", ".join(terms) or "none") for name, terms in origin["absent"]]
    documents: dict[str, None] = {}
    for result in results:
        if "document" in result.case.source:
            documents[result.case.source["document"]] = None
    return {
        "versions": origin["versions"],
        "inputs": origin["inputs"],
        "models": models,
        "records": _join_names(origin["records"]),
        "databases": sources,
        "absent": _join_names(absent),
        "documents": list(documents),
        "notices": origin["notices"],
    }


def _glossary_entry(label: QuantityLabel) -> dict[str, Any]:
    return {
        **quantity_content(label),
        "name": label.name,
        "meaning": label.meaning,
        "sign": label.sign,
    }


def case_content(
    position: int,
    key: str,
    result: PomResult,
    provenance: Mapping[str, Any],
    diagnosis: pd.DataFrame | None,
    modes: pd.DataFrame,
) -> dict[str, Any]:
    """Return the data of the pages of one case, without its drawings.

    Parameters
    ----------
    position : int
        Number of the case in the report, from one.
    key : str
    result : PomResult
    provenance : mapping
        Provenance without paths.
    diagnosis : DataFrame or None
        Table of `pom.diagnose`.
    modes : DataFrame
        Table of `pom.judging.mode_table`.
    """
    case, styles = result.case, run_line_classes(result.runs)
    verdicts = verdict_blocks(result)
    story = ""
    if diagnosis is not None and len(diagnosis):
        story = cause_sentences(diagnosis)
    left_out = []
    for block in verdicts["left_out"]:
        left_out.append((block["criterion"], block["printed"], block["left_out"]))
    name = results_name([result])
    return {
        "position": position,
        "key": key,
        **_case_texts(case),
        **_condition_content(result),
        "outcomes": [_outcome_content(item) for item in outcome_rows(result, styles)],
        "failure": result.failure,
        "digests": [list(row) for row in digest_rows(result, provenance)],
        "source": remarks.data_source(result),
        "calibration": calibration_rows(result),
        "drive": _driving_content(result),
        "trim": _trim_content(result),
        "drift": _drift_content(result),
        "verdicts": [_block_content(block) for block in verdicts["blocks"]],
        "left_out": left_out,
        "values": verdicts["values"],
        "modes": [_replace_label(block) for block in remarks.mode_blocks(result, modes, styles)],
        "probability": remarks.probability_table(result),
        "story": story,
        "notes": [note.as_dict() for note in remarks.reader_notes(result)],
        "rationales": remarks.rationale_rows(result),
        "ticks": remarks.tick_rows(result),
        "results": name,
        "signatures": signature_rows(case.signatures, provenance.get("date", ""), name),
        "runs": result.runs,
        "styles": styles,
    }


def _case_texts(case: PomCase) -> dict[str, Any]:
    """Return the texts of the case file."""
    kind = _REFERENCES.get(case.reference, case.reference)
    if case.is_demonstration:
        kind = "demonstration: curves without a tolerance, for people to judge"
    texts = [
        ("Procedure, automatic", case.procedure),
        ("Procedure, manual", case.manual),
        ("Statement of compliance", "; ".join(case.compliance.values())),
        ("Method of evaluation", case.evaluation),
    ]
    events = []
    for name, instant in sorted(case.events.items(), key=lambda item: item[1]):
        events.append((plain_words(name), f"{instant:.2f} s"))
    return {
        "id": case.id,
        "title": case.title,
        "name": case.name,
        "standard": f"{case.standard}, edition {case.edition_words}",
        "kind": f"{kind}, tolerances applied to {remarks.fraction_text(case.fraction)}",
        "objective": remarks.case_objective(case),
        "manoeuvre": case.description,
        "texts": [(head, text) for head, text in texts if text],
        "window": [case.window[0], case.window[1]],
        "events": events,
    }


def _condition_content(result: PomResult) -> dict[str, Any]:
    """Return the initial conditions: all of them, and those of the summary in one line."""
    conditions = []
    stated = stated_conditions(result)
    for part, rows in condition_rows(result.conditions, result.trim.index, stated):
        conditions.append((part, [(quantity_content(label), value) for label, value in rows]))
    return {"conditions": conditions, "glance": glance_text(result)}


def quantity_content(label: QuantityLabel) -> dict[str, Any]:
    """Return a quantity as the templates write it: symbol with subscript, words, unit."""
    return {
        "base": label.base,
        "sub": label.sub,
        "word": label.is_word,
        "words": label.words,
        "unit": label.unit,
    }


def _replace_label(row: Mapping[str, Any], key: str = "label") -> dict[str, Any]:
    """Return a row whose quantity is as the templates write it."""
    return {**row, key: quantity_content(row[key])}


def _outcome_content(item: Mapping[str, Any]) -> dict[str, Any]:
    """Return the outcome of one model: verdict, ratio and the criterion that decides."""
    decides = []
    if item["criterion"]:
        text = item["criterion"]
        if not math.isnan(item["at"]):
            text += f" at {item['at_text']} s"
        decides.append(text)
    count = len(item["notices"])
    if count:
        decides.append(f"{count} notice{'s' if count > 1 else ''}")
    if item["unchecked"]:
        decides.append(item["unchecked"])
    return {
        "run": item["run"],
        "style": item["style"],
        "ratio": item["ratio_text"],
        "decides": ", ".join(decides),
        **_verdict_content(item["verdict"]),
    }


def _verdict_content(verdict: Verdict) -> dict[str, str]:
    return {
        "word": verdict.word,
        "symbol": verdict.symbol,
        "state": verdict.css.removeprefix("is-"),
    }


def submodel_content(section: Section) -> dict[str, Any]:
    """Return the data of one section of the chapter on submodels, without its figures."""
    return {
        "name": section.name,
        "techniques": section.techniques,
        "grids": [table_of(grid) for grid in section.grids],
        "remarks": section.remarks,
    }


def tuning_content(tuning: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of one model in the chapter on tuning."""
    grids = []
    for grid in tuning["grids"]:
        # Columns of numbers are aligned to the right.
        align = []
        for head in grid.head:
            align.append("right" if head in tuning["numbers"] else "left")
        grids.append({**(table_of(grid) or {}), "align": align})
    return {
        "run": tuning["run"],
        "headline": tuning["headline"],
        "grids": grids,
        "remarks": tuning["remarks"],
    }


def table_of(grid: SectionTable | None) -> dict[str, Any] | None:
    """Return the data of a table of a section; None without a table."""
    if not grid:
        return None
    return {"caption": grid.caption, "head": grid.head, "rows": grid.rows}


def _matrix_content(
    keys: Sequence[str],
    results: Sequence[PomResult],
    outcomes: Sequence[Sequence[Mapping[str, Any]]],
) -> dict[str, Any]:
    """Return the index: a row per case, a column per model, and the counts of every verdict."""
    runs, rows = list_runs(results), []
    for key, result, case_outcomes in zip(keys, results, outcomes, strict=True):
        by_run = {item["run"]: _outcome_content(item) for item in case_outcomes}
        rows.append(
            {
                "key": key,
                "id": result.case.id,
                "title": result.case.title,
                "cells": [by_run.get(run) for run in runs],
            }
        )
    statuses = shown_statuses(results)
    counts = []
    for run in runs:
        of_run = [result.status(run) for result in results if run in result.runs]
        counts.append([run, *(of_run.count(status) for status in statuses)])
    return {
        "runs": runs,
        "rows": rows,
        "counts": counts,
        "heads": [Verdict.of(status).word for status in statuses],
        "styles": run_line_classes(runs),
    }


def _join_names(pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return pairs of name and text, with the names of equal texts joined."""
    names: dict[str, list[str]] = {}
    for name, text in pairs:
        names.setdefault(text, []).append(name)
    return [(", ".join(joined), text) for text, joined in names.items()]


def _drift_content(result: PomResult) -> list[dict[str, Any]]:
    """Return the drift of every channel, a cell per model."""
    rows: dict[str, dict[str, Any]] = {}
    for label, run, rate, spread in drift_rows(result):
        # A model without this channel has an empty cell.
        empty = {"label": quantity_content(label), "cells": dict.fromkeys(result.runs, "")}
        rows.setdefault(label.name, empty)["cells"][run] = f"{rate} ± {spread}"
    return [{"label": row["label"], "cells": list(row["cells"].values())} for row in rows.values()]


def _driving_content(result: PomResult) -> dict[str, Any]:
    """Return how the models were driven: inputs, control loops and their activity."""
    driving = describe_driving(result)
    loops = []
    for loop in driving["loops"]:
        loops.append(_replace_label(_replace_label(loop, "control"), "channel"))
    return {
        "how": driving["how"],
        "inputs": [(quantity_content(label), *cells) for label, *cells in driving["inputs"]],
        "loops": loops,
        "activity": [_replace_label(row, "control") for row in driving["activity"]],
    }


def _trim_content(result: PomResult) -> dict[str, Any]:
    tables = trim_tables(result)
    parts = []
    for title, rows in tables["parts"]:
        parts.append((title, [_replace_label(row) for row in rows]))
    return {"columns": tables["columns"], "parts": parts}


def _block_content(block: Mapping[str, Any]) -> dict[str, Any]:
    """Return the verdicts on one criterion."""
    rows = []
    for row in block["rows"]:
        # The templates print texts; these three are numbers or objects.
        cells = {key: item for key, item in row.items() if key not in ("at", "exit", "verdict")}
        rows.append(cells | _verdict_content(row["verdict"]))
    label = block["label"]
    return {
        **block,
        "label": quantity_content(label) if label else None,
        "rows": rows,
        # The printed tolerance is in the column before, so only its number is repeated.
        "applied": block["applied"].removeprefix(f"{block['printed']}: "),
    }


def case_on_paper(
    folder: Path,
    position: int,
    key: str,
    result: PomResult,
    provenance: Mapping[str, Any],
    diagnosis: pd.DataFrame | None,
    modes: pd.DataFrame,
    paper: str,
) -> dict[str, Any]:
    """Return the data of a case, and write its drawings into a folder.

    Parameters
    ----------
    folder : Path
        Folder of the drawings.
    position, key, result, provenance, diagnosis, modes
        As in `case_content`.
    paper : {"a4", "letter"}
    """
    page = case_content(
        position,
        key,
        result=result,
        provenance=provenance,
        diagnosis=diagnosis,
        modes=modes,
    )
    room, column = panel_room(page, paper)
    return page | draw_case(
        folder, position, result=result, diagnosis=diagnosis, room=room, column=column
    )
