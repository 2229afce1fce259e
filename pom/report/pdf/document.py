"""The document: drawings and data laid out in a folder, typeset by typst to a tagged PDF/A-3b with the data attached.

Fonts come with this package and system fonts are off; the date comes from the results: equal input gives equal bytes.
"""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.support.console import plain
from pom.report.case.case import keys, line_styles
from pom.report.case.cross_plots import crosses
from pom.report.case.panels import Panel, panels
from pom.report.models.tuning import NOTE
from pom.report.submodels.page import needed
from pom.report.submodels.section import Section
from pom.result import PomResult

from . import content
from .cross_plots import cross_drawing
from .panels import LEAST, MOST_PANELS, Drawing, arranged, drawing, legend, svg
from .waterfall import waterfall

STANDARDS: Any = ["a-3b", "ua-1"]
UNDATED = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
"""PDF/A demands a date and no clock is read: a report without a date carries this one in its metadata, and states so on its cover."""

_GLYPHLESS = re.compile(r'the text `"(.+?)"` could not be displayed')
_ESCAPED = re.compile(r"\\u\{([0-9a-f]+)\}")
_CONTROL = re.compile(r"\\u00[01][0-9a-f]|[\ud800-\udfff]")  # in JSON
_HERE = Path(__file__).parent
_FONTS = _HERE.parent / "static" / "fonts"
# height of the column in units of the drawings, less head and foot of the page
_COLUMN = {"a4": 1040.0, "letter": 942.0}
_UNIT = 0.255  # mm; 720 of them across the column
HEADED = 60.0  # heading and line code of a page of panels, in units
LEAST_ROOM = 280.0  # below it the panels begin on a page of their own, in units
FURTHER = 40.0  # height of a panel that only proves the condition, in units
_TEXT = {"a4": 128, "letter": 132}  # characters that surely fit into a line of the column
_MIME = {".json": "application/json", ".csv": "text/csv", ".nc": "application/x-netcdf"}


def pdf_pages(
    results: Sequence[PomResult],
    title: str,
    revision: str,
    provenance: Mapping[str, Any],
    databases: Mapping[str, xr.DataTree],
    diagnoses: Mapping[str, pd.DataFrame],
    modes: Sequence[pd.DataFrame],
    paper: str,
    attached: Mapping[str, bytes],
    submodels: Sequence[Section] = (),
    tunings: Sequence[Mapping[str, Any]] = (),
) -> bytes:
    """Return ``report.pdf``; the arguments are those of `pom.write_report`, `modes` a table per result, `attached` files by name.

    Raises
    ------
    SchemaError
        Typst cannot set the document, with its words.
    """
    names = keys(results)
    with TemporaryDirectory() as place:
        folder = Path(place)
        front = content.front(results, names, title, revision, provenance, databases)
        cases = []
        for i, (key, result, table) in enumerate(zip(names, results, modes, strict=True), 1):
            diagnosis = diagnoses.get(result.case.name)
            page = content.case(i, key, result, provenance, diagnosis, table)
            cases.append(page | _drawings(folder, i, result, diagnosis, _room(page, paper), _COLUMN[paper]))
        front["attached"] = _attach(folder, attached)
        chapter = [content.submodel(one) | {"pictures": _pictures(folder, i, one)} for i, one in enumerate(submodels)]
        data = {
            **front,
            "cases": cases,
            "submodels": chapter,
            "tunings": [content.tuning(one) for one in tunings],
            "tuning_note": NOTE,
            "needed": content.table_of(needed(diagnoses, databases)),
            "paper": {"a4": "a4", "letter": "us-letter"}[paper],
        }
        text = _CONTROL.sub("?", json.dumps(plain(data), ensure_ascii=False))
        (folder / "data.json").write_text(text, encoding="utf-8", errors="replace")
        (folder / "report.typ").write_bytes((_HERE / "report.typ").read_bytes())
        return _set(folder, _date(provenance.get("date", "")))


def _set(folder: Path, date: datetime.datetime) -> bytes:
    """Typeset the folder; texts in scripts that our fonts lack take those of the system, and what no font has becomes ``?``."""
    try:
        import typst
    except ImportError as error:
        raise SchemaError("report.pdf", ["typst is not installed; pip install it, or leave the PDF out (--no-pdf, paper=None)"]) from error
    for ours_only in (True, False, False):
        try:
            return typst.compile(
                str(folder / "report.typ"),
                root=str(folder),
                format="pdf",
                font_paths=[str(_FONTS)],
                ignore_system_fonts=ours_only,
                pdf_standards=STANDARDS,
                timestamp=date,
            )
        except typst.TypstError as error:
            problem, missing = error, _missing(error.diagnostic)
            if not missing:
                break
            if not ours_only:
                _replace(folder, missing)
    raise SchemaError("report.pdf", [f"typst: {problem.message}"]) from problem


def _missing(words: str) -> set[str]:
    """Return the characters that typst found in no font; it writes marks and controls as ``\\u{301}``."""
    found = "".join(_GLYPHLESS.findall(words))
    escaped = {chr(int(code, 16)) for code in _ESCAPED.findall(found)}
    return {character for character in escaped | set(_ESCAPED.sub("", found)) if not " " <= character <= "~"}


def _replace(folder: Path, missing: set[str]) -> None:
    for path in [folder / "data.json", *folder.glob("*.svg")]:
        text = path.read_text(encoding="utf-8")
        path.write_text(text.translate(dict.fromkeys(map(ord, missing), "?")), encoding="utf-8")


def _date(text: str) -> datetime.datetime:
    """Return the date of the results, or `UNDATED` where none is given or it is not ISO 8601."""
    try:
        date = datetime.datetime.fromisoformat(text)
    except ValueError:
        return UNDATED
    return date if date.tzinfo else date.replace(tzinfo=datetime.UTC)


def _attach(folder: Path, attached: Mapping[str, bytes]) -> list[dict[str, str]]:
    from hashlib import sha256

    rows = []
    for name, body in attached.items():
        (folder / name).write_bytes(body)
        rows.append({"name": name, "mime": _MIME.get(Path(name).suffix, "application/octet-stream"), "sha256": sha256(body).hexdigest()})
    return rows


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
        pages.append([_save(folder, f"{place}-{i}.svg", item) for i, item in enumerate(drawn)])

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
        "crosses": [_save(folder, f"c{position}-x{i}.svg", item) for i, item in enumerate(curves)],
        "legend": _save(folder, f"c{position}-legend.svg", code),
        "waterfall": _save(folder, f"c{position}-cause.svg", fall) if fall else None,
    }


def _pictures(folder: Path, position: int, section: Section) -> list[dict[str, Any]]:
    """Return the figures of a submodel, drawn for paper."""
    drawn = [Drawing(svg(picture.height, picture.body), picture.height, picture.words) for picture in section.pictures]
    return [_save(folder, f"s{position}-{i}.svg", one) for i, one in enumerate(drawn)]


def _save(folder: Path, name: str, drawn: Drawing) -> dict[str, Any]:
    (folder / name).write_text(drawn.svg, encoding="utf-8")
    return {"file": name, "height": drawn.height, "alt": drawn.words}
