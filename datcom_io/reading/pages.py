"""Reading of one printed page: heading, flight conditions, tables, notes."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

from datcom_io.cells import read_cell
from datcom_io.printout.content import ListingMessage, Page
from datcom_io.printout.layouts import BLOCKS, BY_HEADING, CONDITIONS
from datcom_io.printout.layouts import notes as footnotes
from datcom_io.printout.rows import Line, cached_column_windows
from datcom_io.printout.tables import (
    Printed,
    PrintedBlock,
    PrintedTable,
    TableLayout,
    normalise_heading,
    read_printed_table,
)

TITLES = (
    ("CHARACTERISTICS AT ANGLE OF ATTACK", "static"),
    ("DYNAMIC DERIVATIVES", "dynamic"),
    ("CHARACTERISTICS OF HIGH LIFT", "high-lift"),
    ("CONFIGURATION AUXILIARY", "auxiliary"),
    ("SECTION DEFINITION", "section"),
    ("USER DEFINED", "section"),
    ("AERODYNAMIC CONTROL EFFECTIVENESS", "hypersonic"),
    ("SPECIAL CONTROL METHODS", "special"),
    ("TRANSVERSE-JET CONTROL", "special"),
    ("LIST OF FINAL INPUTS", "final inputs"),
    ("EXTRAPOLATION MESSAGE SUMMARY", "extrapolation"),
    ("FOLLOWING ARE", "dump"),
)
"""Words of the line that names a page, and the kind of the page."""
_KINDS = (*TITLES, (")=", "dump"))
_WITH_CONFIGURATION = ("static", "dynamic", "high-lift", "auxiliary")
_GROUND = re.compile(r"GROUND HEIGHT= *(FREE AIR|[\d.]+)")
_FLAP = re.compile(r"FLAP DEFLECTION= *(-?[\d.]+)")
_POWER = re.compile(r"(JET|PROPELLER) POWER EFFECTS INCLUDED")
_LONGEST_HEADING = 1000  # characters of the program; longer ones are not worth remembering


class PageHeading(NamedTuple):
    """Content of a heading: height over ground in feet, deflection in degrees, as in `Page`."""

    kind: str
    configuration: str
    ground_height: float
    flap: float
    power: str


def read_heading(first: str, heading: tuple[str, ...]) -> PageHeading:
    """Return the content of a heading.

    `first` is the first line of the page, `heading` the lines below it.  A listing repeats the same
    headings many times, so the result is cached.
    """
    if len(first) + sum(map(len, heading)) <= _LONGEST_HEADING:
        return _read_cached_heading(first, heading)
    return _read_heading(first, heading)


def _read_heading(first: str, heading: tuple[str, ...]) -> PageHeading:
    kind = _page_kind(first, heading)
    # The first line of the heading is the kind, the second one the configuration, with a CASEID and
    # lines of ground effect, flap and power behind it.
    lines = "\n".join(heading[1:])
    configuration = ""
    if kind in _WITH_CONFIGURATION and len(heading) > 1:
        configuration = heading[1].removesuffix(" CONFIGURATION")
    power = _POWER.search(lines)
    return PageHeading(
        kind=kind,
        configuration=configuration,
        ground_height=_ground_height(lines),
        flap=_find_number(_FLAP, lines),
        power=power[1].lower() if power else "off",
    )


_read_cached_heading = lru_cache(1024)(_read_heading)


def _page_kind(first: str, heading: tuple[str, ...]) -> str:
    """Return the kind of a page by its first line or the line below the name of the program."""
    for title, kind in _KINDS:
        if title in first or (heading and title in heading[0]):
            return kind
    return "other"


def _ground_height(lines: str) -> float:
    """Return the height over ground of a heading, infinite in free air. [ft]"""
    match = _GROUND.search(lines)
    if match is None or match[1] == "FREE AIR":
        return float("inf")
    return _find_number(_GROUND, lines)


def _find_number(pattern: re.Pattern[str], lines: str) -> float:
    """Return the first number that a pattern matches, NaN without one."""
    match = pattern.search(lines)
    cell = None
    if match:
        cell = read_cell(match[1])
    if cell is None:
        return float("nan")
    return cell[0]


_LAST_HEADING_LINE = 12
_LONGEST_LINE = 160  # of the program; longer ones are not worth remembering
_CONDITION_WINDOWS = cached_column_windows(CONDITIONS.columns, CONDITIONS.keys)
_UNITS = re.compile(r"(FT|IN|M|CM) +\1/SEC ")
# One build breaks the title of a hypersonic page into two lines.
_SECOND_TITLE = "APRIL 1976 VERSION OF DATCOM"
# First line of the numbers on a page whose heading ends in a CASEID.
_NUMBERS_BEGIN = re.compile(r".? *MACH NUMBER ?=|.? TIME \(SEC\)")
# Headings around tables that have no content of their own, and a frame of asterisks around a
# message.
_DECORATION = re.compile(
    r"DERIVATIVE \(PER (DEGREE|RADIAN)\)$|DYNAMIC DERIVATIVES \(PER "
    r"(DEGREE|RADIAN)\)$|PITCHING +ACCELERATION +ROLLING +YAWING$"
    r"|INCREMENTS DUE TO DEFLECTION +DERIVATIVES \(PER DEGREE\)$"
    r"|(?<!\*)\*{100,}$"
)
_PER = re.compile(r"DERIVATIVE[S]? ?\(PER (DEGREE|RADIAN)\)")
_PER_UNITS = {"DEGREE": "deg", "RADIAN": "rad"}


@dataclass
class PageBody:
    """Print of a page below its heading.

    ``empty`` holds line and kind of the headings without a row; ``target`` is the list of the last
    note or message, which the next line may continue.
    """

    printed: list[Printed] = field(default_factory=list)
    notes: list[ListingMessage] = field(default_factory=list)
    messages: list[ListingMessage] = field(default_factory=list)
    unread: list[int] = field(default_factory=list)
    empty: list[tuple[int, TableLayout]] = field(default_factory=list)
    per: str = ""
    target: list[ListingMessage] = field(default_factory=list)


class _ConditionLine(NamedTuple):
    """Flight-condition line of a page, its unit of length, and the index of the line after it."""

    table: PrintedTable | None
    dim: str
    after: int


def read_page(
    lines: list[Line], case: int
) -> tuple[Page, list[ListingMessage], list[tuple[int, TableLayout]]]:
    """Return a page, the messages on it, and line and kind of the headings without a row."""
    anchor = _find_conditions_heading(lines)
    if anchor is None:
        start = _body_start(lines)
        top = lines[1:start]
        conditions = _ConditionLine(None, "", start)
    else:
        top = lines[1:anchor]
        conditions = _read_conditions(lines, anchor)
    heading = []
    for _, text in top:
        stripped = text[1:].strip()
        if stripped and stripped != _SECOND_TITLE:
            heading.append(stripped)
    # The kind of the page selects the blocks of its body.
    content = read_heading(lines[0][1], tuple(heading))
    body = _read_body(lines, conditions.after, content.kind)
    page = Page(
        kind=content.kind,
        case=case,
        first=lines[0][0],
        last=lines[-1][0],
        heading=tuple(heading[:6]),
        configuration=content.configuration,
        ground_height=content.ground_height,
        flap=content.flap,
        power=content.power,
        dim=conditions.dim,
        per=body.per,
        conditions=conditions.table,
        printed=tuple(body.printed),
        notes=tuple(body.notes),
        unread=tuple(body.unread),
    )
    return page, body.messages, body.empty


def _find_conditions_heading(lines: list[Line]) -> int | None:
    """Return the index of the line FLIGHT CONDITIONS, None on a page without one.

    The number of heading lines above it varies: a page without CASEID has no empty line instead.
    """
    for i, (_, text) in enumerate(lines[:_LAST_HEADING_LINE]):
        if "FLIGHT CONDITIONS" in text:
            return i
    return None


def _body_start(lines: list[Line]) -> int:
    """Return where the body of a page without flight conditions starts.

    It starts behind the line that names its kind, and the CASEID.
    """
    top = lines[:_LAST_HEADING_LINE]
    start = 0
    for i, (_, text) in enumerate(top):
        if any(title in text for title, _ in TITLES):
            start = i + 1
            break
    for i in range(start, len(top)):
        if _NUMBERS_BEGIN.match(top[i][1]):
            return i
    return start


def add_message(messages: list[ListingMessage], number: int, text: str) -> None:
    """Append a message of the program, or continue the one before."""
    if messages and footnotes.is_continuation(text):
        messages[-1] = messages[-1]._replace(text=f"{messages[-1].text} {text}")
    else:
        messages.append(ListingMessage(number, text))


def _read_conditions(lines: list[Line], anchor: int) -> _ConditionLine:
    """Read the flight-condition line below the heading FLIGHT CONDITIONS at index `anchor`."""
    for i in range(anchor + 1, min(anchor + 9, len(lines))):
        # The units row stands above the numbers.
        units = _UNITS.match(lines[i][1].strip() + " ")
        if units is None:
            continue
        for j in range(i + 1, min(i + 4, len(lines))):
            number, text = lines[j]
            if not text[1:].strip():
                continue
            if _CONDITION_WINDOWS.hold(text):
                table = PrintedTable(CONDITIONS, CONDITIONS.columns, (number,), (text,))
                return _ConditionLine(table, units[1], j + 1)
            break
        return _ConditionLine(None, units[1], i + 1)
    return _ConditionLine(None, "", anchor + 1)


def _read_body(lines: list[Line], start: int, kind: str) -> PageBody:
    """Read the lines below the heading of a page of a kind."""
    body = PageBody()
    index = start
    while index < len(lines):
        number, text = lines[index]
        if len(text) < 2:
            index += 1
            continue
        meaning = _line_meaning(kind, text)
        block = _read_block(meaning.blocks, lines, index)
        index += 1
        if block:
            printed, after = block
            body.printed += [item for item in printed if item.lines]
            index = max(index, after)
        elif meaning.layout is not None:
            table, after = read_printed_table(meaning.layout, lines, index)
            if table is not None:
                body.printed.append(table)
                index = after
            elif not _states_no_output(lines, index):
                body.unread.append(number)
                body.empty.append((number, meaning.layout))
        else:
            _add_text(number, meaning, body)
    return body


def _read_block(
    blocks: tuple[PrintedBlock, ...], lines: list[Line], index: int
) -> tuple[list[Printed], int] | None:
    """Return the content of the first block whose lines have the right form, None without one."""
    for block in blocks:
        content = block.read(lines, index)
        if content:
            return content
    return None


def _states_no_output(lines: list[Line], index: int) -> bool:
    """Return whether a note below a heading explains that it has no row."""
    for _, text in lines[index : index + 3]:
        stripped = text[1:].strip()
        if stripped:
            return stripped.startswith("*NOTE* NO OUTPUT AVAILABLE")
    return False


class LineMeaning(NamedTuple):
    """The ways to read a line of a page.

    It may open one of the ``blocks`` or the table ``layout``.  Otherwise it is a text: ``sort`` is
    ``note``, ``message``, ``continued``, ``decoration`` or ``unread``, ``text`` its words.  ``per``
    is the unit of angle that it states.
    """

    blocks: tuple[PrintedBlock, ...]
    layout: TableLayout | None
    sort: str
    text: str
    per: str


def _line_meaning(kind: str, text: str) -> LineMeaning:
    """Return the meaning of a line on a page of a kind."""
    if len(text) <= _LONGEST_LINE:
        return _cached_meaning(kind, text)
    return _find_meaning(kind, text)


def _find_meaning(kind: str, text: str) -> LineMeaning:
    heading = normalise_heading(text)
    blocks = [block for block in BLOCKS if kind in block.pages and block.opens.search(heading)]
    plain = footnotes.strip_control_column(text)
    per = _PER.search(plain)
    return LineMeaning(
        blocks=tuple(blocks),
        layout=BY_HEADING.get(heading),
        sort=_sort_text(heading, plain),
        text=plain,
        per=_PER_UNITS[per[1]] if per else "",
    )


# The same headings and notes stand on every page.
_cached_meaning = lru_cache(4096)(_find_meaning)


def _sort_text(heading: str, plain: str) -> str:
    """Return the sort of a text line, see `LineMeaning`.

    `heading` is the line as a heading, `plain` the line without its carriage control.
    """
    if not plain or _DECORATION.match(heading):
        return "decoration"
    if _PER.search(plain):
        return "decoration" if _DECORATION.search(heading) else "unread"
    if footnotes.is_continuation(plain):
        return "continued"
    return footnotes.sort_of(plain) or "unread"


def _add_text(number: int, meaning: LineMeaning, body: PageBody) -> None:
    """Add a text line to the notes, messages or unread lines of a page."""
    body.per = body.per or meaning.per
    if meaning.sort == "unread":
        body.unread.append(number)
        return
    if meaning.sort == "decoration":
        return
    if meaning.sort == "message":
        body.target = body.messages
    elif meaning.sort == "note":
        body.target = body.notes
    add_message(body.target, number, meaning.text)
    group = footnotes.read_footnote_number(number, meaning.text)
    if group:
        body.printed.append(group)
