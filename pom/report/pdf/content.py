"""What stands in the document, as plain data for the templates of typst: the same words and numbers
as on the HTML page.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from pom.cases.case_file import signature_rows
from pom.report import page as origin
from pom.report import page as overview
from pom.report.case import remarks
from pom.report.case import remarks as modal
from pom.report.case import remarks as probability
from pom.report.case import start_and_inputs as initial_conditions
from pom.report.case.page import digest_rows, outcome_rows, run_line_classes
from pom.report.case.panels import CasePanel, make_case_panels, make_cross_plots
from pom.report.case.start_and_inputs import describe_driving
from pom.report.models.diagnosis import cause_sentences
from pom.report.pdf.drawings import (
    LEAST,
    MOST_PANELS,
    Drawing,
    arrange_panels,
    cross_drawing,
    draw_case_panel,
    draw_legend,
    draw_waterfall,
)
from pom.report.presentation.quantities import QuantityLabel
from pom.report.presentation.verdict_text import Verdict, criterion_words, verdict_blocks
from pom.report.submodels.section import Section, SectionTable
from pom.result import PomResult, results_name
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
    """Return what cover, index, coverage, references and glossary show."""
    cells = [outcome_rows(result, run_line_classes(result.runs)) for result in results]
    matrix = _matrix(keys, results, cells)
    source = origin.provenance_page(provenance, results, databases)
    return {
        "title": title,
        "revision": revision,
        "date": provenance.get("date", ""),
        "command": provenance.get("command", ""),
        "tool": provenance.get("versions", {}).get("aeromatch", ""),
        "results": source["results"],
        "signatures": signature_rows(
            provenance.get("signatures", {}), provenance.get("date", ""), source["results"]
        ),
        "standards": list(
            dict.fromkeys(f"{r.case.standard}, edition {r.case.edition}" for r in results)
        ),
        "kinds": list(
            dict.fromkeys(_REFERENCES.get(r.case.reference, r.case.reference) for r in results)
        ),
        "airplanes": list(
            dict.fromkeys(
                str(db.attrs["aircraft"]) for db in databases.values() if "aircraft" in db.attrs
            )
        ),
        "index": matrix,
        "record_errors": source["record_errors"],
        "coverage": overview.table_coverage(results, tolerance_rows()),
        "references": {
            "versions": source["versions"],
            "inputs": source["inputs"],
            "models": [
                (run, model.get("file", ""), model.get("sha256", ""))
                for run, model in source["models"]
            ],
            "records": _joined(source["records"]),
            "databases": [
                (name, str(db.attrs.get("title", "")), str(db.attrs.get("source", "")))
                for name, db in databases.items()
            ],
            "absent": _joined(
                (name, ", ".join(terms) or "none") for name, terms in source["absent"]
            ),
            "documents": _documents(results),
            "notices": source["notices"],
        },
        "glossary": [
            {**quantity_content(q), "name": q.name, "meaning": q.meaning, "sign": q.sign}
            for q in source["glossary"]
        ],
    }


def case_content(
    position: int,
    key: str,
    result: PomResult,
    provenance: Mapping[str, Any],
    diagnosis: pd.DataFrame | None,
    modes: pd.DataFrame,
) -> dict[str, Any]:
    """Return what the pages of one case show in addition to the drawings."""
    case, styles = result.case, run_line_classes(result.runs)
    shown_rows, table = (
        initial_conditions.condition_rows(result.conditions, result.trim.index),
        verdict_blocks(result),
    )
    return {
        "position": position,
        "key": key,
        "id": case.id,
        "title": case.title,
        "name": case.name,
        "standard": f"{case.standard}, edition {case.edition}",
        "kind": f"{_REFERENCES.get(case.reference, case.reference)}, tolerances applied to "
        f"{remarks.fraction_text(case.fraction)}",
        "objective": remarks.case_objective(case),
        "manoeuvre": case.description,
        "texts": [(head, text) for head, text in _texts(case) if text],
        "outcomes": [_outcome(item) for item in outcome_rows(result, styles)],
        "failure": result.failure,
        "digests": [list(row) for row in digest_rows(result, provenance)],
        "source": remarks.data_source(result),
        "calibration": initial_conditions.calibration_rows(result),
        "window": [case.window[0], case.window[1]],
        "events": [
            (criterion_words(name), f"{at:.2f} s")
            for name, at in sorted(case.events.items(), key=lambda item: item[1])
        ],
        "conditions": [
            (part, [(quantity_content(shown), value) for shown, value in rows])
            for part, rows in shown_rows
        ],
        "glance": ";  ".join(
            f"{_name(shown)} {value}"
            for _, rows in shown_rows
            for shown, value in rows
            if shown.name in _GLANCE
        ),
        "drive": _drive(result),
        "trim": _trim(result),
        "drift": _drift(result),
        "verdicts": [_block(block) for block in table["blocks"]],
        "left_out": [
            (block["criterion"], block["printed"], block["left_out"]) for block in table["left_out"]
        ],
        "values": table["values"],
        "modes": [_mode(block) for block in modal.mode_blocks(result, modes, styles)],
        "probability": probability.probability_table(result),
        "story": cause_sentences(diagnosis) if diagnosis is not None and len(diagnosis) else "",
        "notes": remarks.reader_notes(result),
        "rationales": remarks.rationale_rows(result),
        "ticks": remarks.tick_rows(result),
        "results": (name := results_name([result])),
        "signatures": signature_rows(case.signatures, provenance.get("date", ""), name),
        "runs": result.runs,
        "styles": styles,
    }


_GLANCE = (
    "mass",
    "x_cg",
    "x_cg_b",
    "delta_f",
    "gear",
    "speedbrake",
    "h",
    "h_agl",
    "delta_T",
    "wind",
    "V",
    "V_cas",
    "mach",
)


def quantity_content(shown: QuantityLabel) -> dict[str, Any]:
    """Return a quantity as the templates write it: symbol with subscript, words, unit."""
    word = shown.is_word
    return {
        "base": shown.base,
        "sub": shown.sub,
        "word": word,
        "words": shown.words,
        "unit": shown.unit,
    }


def _name(shown: QuantityLabel) -> str:
    return shown.words or shown.name


def _texts(case: Any) -> list[tuple[str, str]]:
    return [
        ("Procedure, automatic", case.procedure),
        ("Procedure, manual", case.manual),
        ("Method of evaluation", case.evaluation),
    ]


def _outcome(item: Mapping[str, Any]) -> dict[str, Any]:
    at = f" at {item['at_text']} s" if item["at"] == item["at"] else ""
    verdict: Verdict = item["verdict"]
    count = len(item["notices"])
    parts = (
        f"{item['criterion']}{at}" if item["criterion"] else "",
        f"{count} notice{'s' if count > 1 else ''}" if count else "",
    )
    decides = ", ".join(filter(None, parts))
    return {
        "run": item["run"],
        "style": item["style"],
        "ratio": item["ratio_text"],
        "decides": decides,
        **_verdict(verdict),
    }


def _verdict(verdict: Verdict) -> dict[str, str]:
    return {
        "word": verdict.word,
        "symbol": verdict.symbol,
        "state": verdict.css.removeprefix("is-"),
    }


def submodel_content(section: Section) -> dict[str, Any]:
    """Return what the chapter on submodels shows of one next to its figures."""
    grids = [table_of(grid) for grid in section.grids]
    return {
        "name": section.name,
        "techniques": section.techniques,
        "grids": grids,
        "remarks": section.remarks,
    }


def tuning_content(one: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the chapter on tuning shows of one model."""
    grids = [
        {
            **(table_of(grid) or {}),
            "align": ["right" if cell in one["numbers"] else "left" for cell in grid.head],
        }
        for grid in one["grids"]
    ]
    return {
        "run": one["run"],
        "headline": one["headline"],
        "grids": grids,
        "remarks": one["remarks"],
    }


def table_of(grid: SectionTable | None) -> dict[str, Any] | None:
    """Return a table of the chapter on submodels."""
    return {"caption": grid.caption, "head": grid.head, "rows": grid.rows} if grid else None


def _matrix(
    keys: Sequence[str], results: Sequence[PomResult], cells: Sequence[Sequence[Mapping[str, Any]]]
) -> dict[str, Any]:
    runs = list(dict.fromkeys(run for result in results for run in result.runs))
    rows = []
    for key, result, found in zip(keys, results, cells, strict=True):
        by = {cell["run"]: _outcome(cell) for cell in found}
        rows.append(
            {
                "key": key,
                "id": result.case.id,
                "title": result.case.title,
                "cells": [by.get(run) for run in runs],
            }
        )
    shown = overview.shown_statuses(results)
    counts = [
        [run, *(sum(r.status(run) == word for r in results if run in r.runs) for word in shown)]
        for run in runs
    ]
    heads = [Verdict.of(word).word for word in shown]
    return {
        "runs": runs,
        "rows": rows,
        "counts": counts,
        "heads": heads,
        "styles": run_line_classes(runs),
    }


def _joined(pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return pairs with the names of equal texts joined."""
    found: dict[str, list[str]] = {}
    for name, text in pairs:
        found.setdefault(text, []).append(name)
    return [(", ".join(names), text) for text, names in found.items()]


def _drift(result: PomResult) -> list[dict[str, Any]]:
    """Return the drift of every channel, a cell per model."""
    rows: dict[str, dict[str, Any]] = {}
    for shown, run, rate, spread in initial_conditions.drift_rows(result):
        row = rows.setdefault(
            shown.name, {"label": quantity_content(shown), "cells": dict.fromkeys(result.runs, "")}
        )
        row["cells"][run] = f"{rate} ± {spread}"
    return [{"label": row["label"], "cells": list(row["cells"].values())} for row in rows.values()]


def _documents(results: Sequence[PomResult]) -> list[str]:
    """Return the documents that the case files name as the source of their flight data, each once."""
    return list(
        dict.fromkeys(
            result.case.source["document"] for result in results if "document" in result.case.source
        )
    )


def _drive(result: PomResult) -> dict[str, Any]:
    found = describe_driving(result)
    return {
        "how": found["how"],
        "inputs": [(quantity_content(shown), *rest) for shown, *rest in found["inputs"]],
        "loops": [
            {
                **loop,
                "control": quantity_content(loop["control"]),
                "channel": quantity_content(loop["channel"]),
            }
            for loop in found["loops"]
        ],
        "activity": [
            {**row, "control": quantity_content(row["control"])} for row in found["activity"]
        ],
    }


def _trim(result: PomResult) -> dict[str, Any]:
    found = initial_conditions.trim_tables(result)
    parts = [
        (title, [{**row, "label": quantity_content(row["label"])} for row in rows])
        for title, rows in found["parts"]
    ]
    return {"columns": found["columns"], "parts": parts}


def _block(block: Mapping[str, Any]) -> dict[str, Any]:
    rows = [
        {key: item for key, item in row.items() if key not in ("at", "exit", "verdict")}
        | _verdict(row["verdict"])
        for row in block["rows"]
    ]
    applied = block["applied"].removeprefix(
        f"{block['printed']}: "
    )  # the number alone where the printed tolerance stands next to it
    return {
        **block,
        "label": quantity_content(block["label"]) if block["label"] else None,
        "rows": rows,
        "applied": applied,
    }


def _mode(block: Mapping[str, Any]) -> dict[str, Any]:
    return {**block, "label": quantity_content(block["label"])}


# height of the column in units of the drawings, less head and foot of the page
_COLUMN = {"a4": 1040.0, "letter": 942.0}
_UNIT = 0.255  # mm; 720 of them across the column
HEADED = 60.0  # heading and line code of a page of panels, in units
LEAST_ROOM = 280.0  # below it the panels begin on a page of their own, in units
FURTHER = 40.0  # height of a panel that only proves the condition, in units
_TEXT = {"a4": 128, "letter": 132}  # characters that surely fit into a line of the column


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
    """Return the data of the case at `position`, counted from one, and write its drawings into
    `folder`.
    """
    page = case_content(position, key, result, provenance, diagnosis, modes)
    return page | _drawings(folder, position, result, diagnosis, _room(page, paper), _COLUMN[paper])


def save_drawing(folder: Path, name: str, drawn: Drawing) -> dict[str, Any]:
    """Write a drawing and return its entry in the data."""
    (folder / name).write_text(drawn.svg, encoding="utf-8")
    return {"file": name, "height": drawn.height, "alt": drawn.words}


def _room(page: Mapping[str, Any], paper: str) -> float:
    """Return the height that the head of a case leaves for its panels, in units; the layout shrinks
    them by what this is short.
    """
    wide = _TEXT[paper]
    lines = (
        _lines(page["objective"], wide - 12)
        + _lines(page["manoeuvre"], wide - 12)
        + _lines(page["glance"], wide + 20)
        + _lines(page["failure"], wide - 20)
    )
    cells = sum(
        max(_lines(block["printed"], 36), _lines(_first(block), 25), _lines(block["applied"], 20))
        for block in page["verdicts"]
    )
    millimetres = 29.0 + 3.7 * lines + 3.15 * (len(page["outcomes"]) + cells)
    return _COLUMN[paper] - millimetres / _UNIT


def _first(block: Mapping[str, Any]) -> str:
    return f"{block['joint']} {block['criterion']} {block['mark']}".strip()


def _lines(text: str, wide: int) -> int:
    return -(-len(text) // wide)


def _drawings(
    folder: Path,
    position: int,
    result: PomResult,
    diagnosis: pd.DataFrame | None,
    room: float,
    column: float,
) -> dict[str, Any]:
    """Write the drawings of a case: those of the first page, below its head, then those of further
    pages.
    """
    shown, time = make_case_panels(result), result.signals["time"].values
    styles = {**run_line_classes(result.runs), "applied": "run-0"}
    pages: list[list[Any]] = []

    def draw(part: Sequence[CasePanel], height: float) -> None:
        place = f"c{position}-{len(pages)}"
        drawn = [
            draw_case_panel(
                f"{place}-{i}",
                time,
                panel,
                styles,
                result.case.events,
                height,
                i == 0,
                i == len(part) - 1,
            )
            for i, panel in enumerate(part)
        ]
        pages.append(
            [save_drawing(folder, f"{place}-{i}.svg", item) for i, item in enumerate(drawn)]
        )

    first = [panel for panel in shown if panel.kind != "shown"]
    rest = [panel for panel in shown if panel.kind == "shown"]
    if room < LEAST_ROOM:  # the tables fill the page
        pages.append([])
    while first:
        count, height = arrange_panels(first, room if not pages else column - HEADED)
        draw(first[: max(count, 1)], height or LEAST)
        first = first[max(count, 1) :]
    for start in range(0, len(rest), MOST_PANELS):
        draw(rest[start : start + MOST_PANELS], FURTHER)
    rows = result.rows
    curves = [
        cross_drawing(f"c{position}-x{i}", cross, styles, rows)
        for i, cross in enumerate(make_cross_plots(result))
    ]
    fall = draw_waterfall(diagnosis) if diagnosis is not None and len(diagnosis) else None
    code = draw_legend({run: style for run, style in styles.items() if run != "applied"})
    return {
        "pages": pages,
        "crosses": [
            save_drawing(folder, f"c{position}-x{i}.svg", item) for i, item in enumerate(curves)
        ],
        "legend": save_drawing(folder, f"c{position}-legend.svg", code),
        "waterfall": save_drawing(folder, f"c{position}-cause.svg", fall) if fall else None,
    }
