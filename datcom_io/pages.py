"""One printed page: heading, flight conditions, tables, notes."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np

from .blocks import BY_HEADING, CONDITIONS, Column, Layout, heading_words
from .cells import OK, read_cell
from .listing import Message, Page, Table
from .rows import Cells, cuts, read_row

Line = tuple[int, str]
_KINDS = (
    ("CHARACTERISTICS AT ANGLE OF ATTACK", "static"),
    ("DYNAMIC DERIVATIVES", "dynamic"),
    ("CHARACTERISTICS OF HIGH LIFT", "high-lift"),
    ("CONFIGURATION AUXILIARY", "auxiliary"),
    ("SECTION DEFINITION", "section"),
    ("AERODYNAMIC CONTROL EFFECTIVENESS", "hypersonic"),
    ("SPECIAL CONTROL METHODS", "special"),
    ("TRANSVERSE-JET CONTROL", "special"),
    ("LIST OF FINAL INPUTS", "final inputs"),
    ("EXTRAPOLATION MESSAGE SUMMARY", "extrapolation"),
    ("FOLLOWING ARE", "dump"),
    (")=", "dump"),
)
_LAST_HEADING_LINE = 12
_CONDITION_CUTS = cuts(CONDITIONS.columns)
_GROUND = re.compile(r"GROUND HEIGHT= *(FREE AIR|[\d.]+)")
_FLAP = re.compile(r"FLAP DEFLECTION= *(-?[\d.]+)")
_POWER = re.compile(r"(JET|PROPELLER) POWER EFFECTS INCLUDED")
_UNITS = re.compile(r"(FT|IN|M|CM) +\1/SEC ")
_WARNING = re.compile(r"WARNING\*\*\*|TAIL EFFECTS IGNORED")
_SECOND_TITLE = "APRIL 1976 VERSION OF DATCOM"  # one build breaks the title of a hypersonic page
# second lines of a message or note
_CONTINUED = ("TAIL EFFECTS IGNORED]", "APPLICABLE TO THE LINEAR LIFT REGION.", "ALL NAMES REFER TO NAMELIST", "FUSELAGE. FOR THIS CASE")
_NOTES = (*_CONTINUED, "*** ", "***N", "**NOTE*", "*NOTE*", "**  CD0=", "ANALYSIS TERMINATED", "NOTE - ")
# headings around tables that carry nothing of their own
_DECORATION = re.compile(
    r"DERIVATIVE \(PER (DEGREE|RADIAN)\)$|DYNAMIC DERIVATIVES \(PER (DEGREE|RADIAN)\)$|PITCHING +ACCELERATION +ROLLING +YAWING$"
    r"|INCREMENTS DUE TO DEFLECTION +DERIVATIVES \(PER DEGREE\)$"
)
_PER = re.compile(r"DERIVATIVE[S]? ?\(PER (DEGREE|RADIAN)\)")


@dataclass
class Body:
    """What stands on a page besides its heading."""

    tables: list[Table] = field(default_factory=list)
    notes: list[Message] = field(default_factory=list)
    messages: list[Message] = field(default_factory=list)
    unread: list[int] = field(default_factory=list)
    per: str = ""


def read_page(lines: list[Line], case: int) -> tuple[Page, list[Message], list[int]]:
    """Return a page, the messages that stand on it and the numbers of its lines that were not understood."""
    anchor = next((i for i, (_, text) in enumerate(lines[:_LAST_HEADING_LINE]) if "FLIGHT CONDITIONS" in text), None)
    top = lines[1:_LAST_HEADING_LINE] if anchor is None else lines[1:anchor]
    heading = tuple(words for _, text in top if (words := text[1:].strip()) and words != _SECOND_TITLE)
    page = Page(_kind(lines[0][1], heading), case, lines[0][0], lines[-1][0], heading[:6])
    if page.kind in ("static", "dynamic", "high-lift") and heading[1:]:
        page = replace(page, configuration=_configuration(heading[1]))
    if anchor is None:
        blank = all(not text[1:].strip() for _, text in lines[1:])
        return replace(page, parsed=blank), [], []
    conditions, dim, after = _conditions(lines, anchor)
    body = _read_body(lines[after:])
    parsed = bool(body.tables) or not body.unread
    words = "\n".join(heading[1:])
    page = replace(
        page,
        ground_height=_ground_height(words),
        flap=_number(_FLAP, words),
        power=power[1].lower() if (power := _POWER.search(words)) else "off",
        dim=dim,
        per=body.per,
        conditions=conditions,
        tables=tuple(body.tables),
        notes=tuple(body.notes),
        parsed=parsed,
    )
    return page, body.messages, body.unread if parsed else []


def add_message(messages: list[Message], number: int, text: str) -> None:
    """Append a message of the program, or continue the one before."""
    if messages and text.startswith(_CONTINUED):
        messages[-1] = messages[-1]._replace(text=f"{messages[-1].text} {text}")
    else:
        messages.append(Message(number, text))


def _kind(first: str, heading: tuple[str, ...]) -> str:
    """Return the kind of a page by its first line or the line below the program's name."""
    for words, kind in _KINDS:
        if words in first or (heading and words in heading[0]):
            return kind
    return "other"


def _configuration(line: str) -> str:
    return line.removesuffix(" CONFIGURATION")


def _ground_height(words: str) -> float:
    found = _GROUND.search(words)
    return float("inf") if found is None or found[1] == "FREE AIR" else _number(_GROUND, words)


def _number(pattern: re.Pattern[str], words: str) -> float:
    found = pattern.search(words)
    cell = read_cell(found[1]) if found else None
    return cell[0] if cell else float("nan")


def _conditions(lines: list[Line], anchor: int) -> tuple[Table | None, str, int]:
    """Return the flight-condition line, the unit of length and the index of the line after it."""
    for i in range(anchor + 1, min(anchor + 9, len(lines))):
        units = _UNITS.match(lines[i][1].strip() + " ")
        if units is None:
            continue
        for j in range(i + 1, min(i + 4, len(lines))):
            number, text = lines[j]
            if not text[1:].strip():
                continue
            row = read_row(text, _CONDITION_CUTS, 0)
            if row is not None:
                return _table(CONDITIONS, CONDITIONS.columns, [(number, text, row)]), units[1], j + 1
            break
        return None, units[1], i + 1
    return None, "", anchor + 1


def _table(
    layout: Layout,
    columns: tuple[Column, ...],
    rows: list[tuple[int, str, Cells]],
    across: np.ndarray | None = None,
    across_line: int = 0,
    across_row: str = "",
) -> Table:
    return Table(
        layout,
        columns,
        tuple(number for number, _, _ in rows),
        tuple(text for _, text, _ in rows),
        np.array([values for _, _, (values, _) in rows]),
        np.array([flags for _, _, (_, flags) in rows], dtype=np.uint8),
        across,
        across_line,
        across_row,
    )


def _read_body(lines: list[Line]) -> Body:
    body = Body()
    at = 0
    while at < len(lines):
        number, text = lines[at]
        at += 1
        if not text[1:].strip():
            continue
        if layout := BY_HEADING.get(heading_words(text)):
            table, after = _read_table(layout, lines, at)
            if table is None and not _says_no_output(lines, at):
                body.unread.append(number)
            elif table is not None:
                body.tables.append(table)
                at = after
            continue
        _sort_line(number, text, body)
    return body


def _says_no_output(lines: list[Line], at: int) -> bool:
    words = next((text[1:].strip() for _, text in lines[at : at + 3] if text[1:].strip()), "")
    return words.startswith("*NOTE* NO OUTPUT AVAILABLE")


def _sort_line(number: int, text: str, body: Body) -> None:
    words = text[1:].strip()
    if _WARNING.search(words):
        add_message(body.messages, number, words)
    elif per := _PER.search(words):
        body.per = body.per or {"DEGREE": "deg", "RADIAN": "rad"}[per[1]]
        if not _DECORATION.search(heading_words(text)):
            body.unread.append(number)
    elif _DECORATION.match(heading_words(text)):
        return
    elif _is_note(words):
        add_message(body.notes, number, words)
    else:
        body.unread.append(number)


def _is_note(words: str) -> bool:
    return words.startswith(_NOTES) and bool(words.strip("*"))


def _read_table(layout: Layout, lines: list[Line], at: int) -> tuple[Table | None, int]:
    """Return the table whose heading stands before index `at`, and the index after it; None when no row follows."""
    columns, across, across_line, across_row = layout.columns, None, 0, ""
    if layout.across:
        found = _read_across(layout, lines, at)
        if found is None:
            return None, at
        columns, across, across_line, across_row, at = found
    windows = cuts(columns)
    rows: list[tuple[int, str, Cells]] = []
    after = at
    while at < len(lines):
        number, text = lines[at]
        at += 1
        if not text[1:].strip() or (not rows and heading_words(text) == "ALPHA"):
            continue
        row = read_row(text, windows, layout.keys) if text[0] == " " else None
        if row is None:
            break
        rows.append((number, text, row))
        after = at
    if not rows:
        return None, after
    return _table(layout, columns, rows, across, across_line, across_row), after


def _read_across(layout: Layout, lines: list[Line], at: int) -> tuple[tuple[Column, ...], np.ndarray, int, str, int] | None:
    """Return columns, heading values, their line and text, and the index of the line after them."""
    across = layout.across
    assert across is not None
    while at < len(lines) and not lines[at][1][1:].strip():
        at += 1
    if at == len(lines):
        return None
    number, text = lines[at]
    start = text.find("=")
    if not text[1:].lstrip().startswith(across.name) or not 0 <= start < across.first:
        return None
    columns, values = list(layout.columns), []
    for k in range((len(text.rstrip()) - across.first) // across.step + 1):
        shift = k * across.step
        cell = read_cell(text[max(across.first - 1 + shift, start + 1) : across.last + shift])
        if cell is None or cell[1] != OK:
            return None
        values.append(cell[0])
        columns.append(across.cell._replace(first=across.cell.first + shift, last=across.cell.last + shift))
    return (tuple(columns), np.array(values), number, text, at + 1) if values else None
