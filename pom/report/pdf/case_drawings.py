"""Drawings of one case for paper, distributed over the pages of the case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pom.report.case.page import run_line_classes
from pom.report.case.panels import CasePanel, make_case_panels, make_cross_plots
from pom.report.pdf.cross_plots import cross_drawing
from pom.report.pdf.drawings import (
    LEAST,
    MOST_PANELS,
    arrange_panels,
    draw_case_panel,
    draw_legend,
)
from pom.report.pdf.style import save_drawing
from pom.report.pdf.waterfall import draw_waterfall
from pom.result import PomResult

# Height of the column without head and foot of the page, in units of the drawings.
_COLUMN = {"a4": 1040.0, "letter": 942.0}
_UNIT = 0.255  # mm; 720 of them across the column
HEADED = 60.0  # heading and line code of a page of panels, in units
LEAST_ROOM = 280.0  # below it the panels begin on a page of their own, in units
FURTHER = 40.0  # height of a panel that only proves the condition, in units
_TEXT = {"a4": 128, "letter": 132}  # characters that surely fit into a line of the column


def panel_room(page: Mapping[str, Any], paper: str) -> tuple[float, float]:
    """Return the estimated height for panels on the first page of a case, and that of a full
    column.

    Both are in units.  If the estimate is too large, the layout shrinks the panels.

    Parameters
    ----------
    page : mapping
        Data of the case (`pom.report.pdf.content.case_content`).
    paper : {"a4", "letter"}
    """
    width = _TEXT[paper]
    # The heading of a text shortens its line; the summary is set in smaller type.
    lines = (
        _count_lines(page["objective"], width - 12)
        + _count_lines(page["manoeuvre"], width - 12)
        + _count_lines(page["glance"], width + 20)
        + _count_lines(page["failure"], width - 20)
    )
    # A row of the verdicts is as high as its highest cell.
    table_lines = len(page["outcomes"])
    for block in page["verdicts"]:
        criterion = f"{block['joint']} {block['criterion']} {block['mark']}".strip()
        table_lines += max(
            _count_lines(block["printed"], 36),
            _count_lines(criterion, 25),
            _count_lines(block["applied"], 20),
        )
    # Headings, lines of text and lines of the tables, in mm.
    millimetres = 32.5 + 3.7 * lines + 3.15 * table_lines
    return _COLUMN[paper] - millimetres / _UNIT, _COLUMN[paper]


def _count_lines(text: str, width: int) -> int:
    # Rounded up.
    return -(-len(text) // width)


def draw_case(
    folder: Path,
    position: int,
    result: PomResult,
    diagnosis: pd.DataFrame | None,
    room: float,
    column: float,
) -> dict[str, Any]:
    """Write the drawings of a case, and return their entries in the data.

    Parameters
    ----------
    folder : Path
        Folder of the drawings.
    position : int
        Number of the case in the report, from one.
    result : PomResult
    diagnosis : DataFrame or None
        Table of `pom.diagnose`.
    room : float
        Height for panels on the first page, below its texts. [unit]
    column : float
        Height of a full page. [unit]
    """
    styles = {**run_line_classes(result.runs), "applied": "run-0"}
    pages = []
    for number, (panels, height) in enumerate(_paginate(result, room, column)):
        stem = f"c{position}-{number}"
        entries = _draw_page(
            folder, stem, panels=panels, height=height, result=result, styles=styles
        )
        pages.append(entries)
    crosses = []
    for number, cross in enumerate(make_cross_plots(result)):
        name = f"c{position}-x{number}"
        drawing = cross_drawing(name, cross, styles, result.rows)
        crosses.append(save_drawing(folder, f"{name}.svg", drawing))
    waterfall = None
    if diagnosis is not None and len(diagnosis):
        chart = draw_waterfall(diagnosis)
        if chart:
            waterfall = save_drawing(folder, f"c{position}-cause.svg", chart)
    legend = draw_legend({run: style for run, style in styles.items() if run != "applied"})
    return {
        "pages": pages,
        "crosses": crosses,
        "legend": save_drawing(folder, f"c{position}-legend.svg", legend),
        "waterfall": waterfall,
    }


def _paginate(
    result: PomResult, room: float, column: float
) -> list[tuple[Sequence[CasePanel], float]]:
    """Return panels and height of an input panel for every page."""
    judged, further = [], []
    for panel in make_case_panels(result):
        if panel.kind == "shown":
            further.append(panel)
        else:
            judged.append(panel)
    pages: list[tuple[Sequence[CasePanel], float]] = []
    if room < LEAST_ROOM:  # the tables fill the first page
        pages.append(([], 0.0))
    while judged:
        count, height = arrange_panels(judged, column - HEADED if pages else room)
        # A page has at least one panel, even if it is too high.
        count = max(count, 1)
        pages.append((judged[:count], height or LEAST))
        judged = judged[count:]
    for start in range(0, len(further), MOST_PANELS):
        pages.append((further[start : start + MOST_PANELS], FURTHER))
    return pages


def _draw_page(
    folder: Path,
    stem: str,
    panels: Sequence[CasePanel],
    height: float,
    result: PomResult,
    styles: Mapping[str, str],
) -> list[dict[str, Any]]:
    """Write the panels of one page, and return their entries in the data."""
    time: np.ndarray = result.signals["time"].values
    entries = []
    for number, panel in enumerate(panels):
        drawing = draw_case_panel(
            f"{stem}-{number}",
            time,
            panel=panel,
            styles=styles,
            events=result.case.events,
            height=height,
            first=number == 0,
            last=number == len(panels) - 1,
        )
        entries.append(save_drawing(folder, f"{stem}-{number}.svg", drawing))
    return entries
