"""The pages of one case in the document: what they show as plain data, and their drawings in a folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from pom.report.case.case import line_styles
from pom.report.case.cross_plots import crosses
from pom.report.case.panels import Panel, panels
from pom.result import PomResult

from . import content
from .cross_plots import cross_drawing
from .panels import LEAST, MOST_PANELS, Drawing, arranged, drawing, legend
from .waterfall import waterfall

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
    """Return the data of the case at `position`, counted from one, and write its drawings into `folder`."""
    page = content.case(position, key, result, provenance, diagnosis, modes)
    return page | _drawings(folder, position, result, diagnosis, _room(page, paper), _COLUMN[paper])


def saved(folder: Path, name: str, drawn: Drawing) -> dict[str, Any]:
    """Write a drawing and return its entry in the data."""
    (folder / name).write_text(drawn.svg, encoding="utf-8")
    return {"file": name, "height": drawn.height, "alt": drawn.words}


def _room(page: Mapping[str, Any], paper: str) -> float:
    """Return the height that the head of a case leaves for its panels, in units; the layout shrinks them by what this is short."""
    wide = _TEXT[paper]
    lines = (
        _lines(page["objective"], wide - 12)
        + _lines(page["manoeuvre"], wide - 12)
        + _lines(page["glance"], wide + 20)
        + _lines(page["failure"], wide - 20)
    )
    cells = sum(max(_lines(block["printed"], 36), _lines(_first(block), 25), _lines(block["applied"], 20)) for block in page["verdicts"])
    millimetres = 29.0 + 3.7 * lines + 3.15 * (len(page["outcomes"]) + cells)
    return _COLUMN[paper] - millimetres / _UNIT


def _first(block: Mapping[str, Any]) -> str:
    return f"{block['joint']} {block['criterion']} {block['mark']}".strip()


def _lines(text: str, wide: int) -> int:
    return -(-len(text) // wide)


def _drawings(folder: Path, position: int, result: PomResult, diagnosis: pd.DataFrame | None, room: float, column: float) -> dict[str, Any]:
    """Write the drawings of a case: those of the first page, below its head, then those of further pages."""
    shown, time = panels(result), result.signals["time"].values
    styles = {**line_styles(result.runs), "applied": "run-0"}
    pages: list[list[Any]] = []

    def draw(part: Sequence[Panel], height: float) -> None:
        place = f"c{position}-{len(pages)}"
        drawn = [
            drawing(f"{place}-{i}", time, panel, styles, result.case.events, height, i == 0, i == len(part) - 1)
            for i, panel in enumerate(part)
        ]
        pages.append([saved(folder, f"{place}-{i}.svg", item) for i, item in enumerate(drawn)])

    first = [panel for panel in shown if panel.kind != "shown"]
    rest = [panel for panel in shown if panel.kind == "shown"]
    if room < LEAST_ROOM:  # the tables fill the page
        pages.append([])
    while first:
        count, height = arranged(first, room if not pages else column - HEADED)
        draw(first[: max(count, 1)], height or LEAST)
        first = first[max(count, 1) :]
    for start in range(0, len(rest), MOST_PANELS):
        draw(rest[start : start + MOST_PANELS], FURTHER)
    rows = result.rows
    curves = [cross_drawing(f"c{position}-x{i}", cross, styles, rows) for i, cross in enumerate(crosses(result))]
    fall = waterfall(diagnosis) if diagnosis is not None and len(diagnosis) else None
    code = legend({run: style for run, style in styles.items() if run != "applied"})
    return {
        "pages": pages,
        "crosses": [saved(folder, f"c{position}-x{i}.svg", item) for i, item in enumerate(curves)],
        "legend": saved(folder, f"c{position}-legend.svg", code),
        "waterfall": saved(folder, f"c{position}-cause.svg", fall) if fall else None,
    }
