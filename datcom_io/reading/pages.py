"""One printed page: heading, flight conditions, tables, notes."""

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
_KINDS = (*TITLES, (")=", "dump"))
_WITH_CONFIGURATION = ("static", "dynamic", "high-lift", "auxiliary")
_GROUND = re.compile(r"GROUND HEIGHT= *(FREE AIR|[\d.]+)")
_FLAP = re.compile(r"FLAP DEFLECTION= *(-?[\d.]+)")
_POWER = re.compile(r"(JET|PROPELLER) POWER EFFECTS INCLUDED")
_LONGEST = 1000  # characters of a heading of the program; longer ones are not worth remembering


class PageHeading(NamedTuple):
    """The content of a heading; the height over ground in feet, the deflection in degrees, as in
    `Page`.
    """

    kind: str
    configuration: str
    ground_height: float
    flap: float
    power: str


def read_heading(first: str, words: tuple[str, ...]) -> PageHeading:
    """Return what the first line of a page and the words of the heading lines below it state; the
    same headings come again and again.
    """
    known = len(first) + sum(map(len, words)) <= _LONGEST
    return _known(first, words) if known else _read(first, words)


def _read(first: str, words: tuple[str, ...]) -> PageHeading:
    kind = _kind(first, words)
    lines = "\n".join(words[1:])
    power = _POWER.search(lines)
    configuration = (
        words[1].removesuffix(" CONFIGURATION") if kind in _WITH_CONFIGURATION and words[1:] else ""
    )
    return PageHeading(
        kind,
        configuration,
        _ground_height(lines),
        _number(_FLAP, lines),
        power[1].lower() if power else "off",
    )


_known = lru_cache(1024)(_read)


def _kind(first: str, heading: tuple[str, ...]) -> str:
    """Return the kind of a page by its first line or the line below the program's name."""
    for words, kind in _KINDS:
        if words in first or (heading and words in heading[0]):
            return kind
    return "other"


def _ground_height(words: str) -> float:
    found = _GROUND.search(words)
    return float("inf") if found is None or found[1] == "FREE AIR" else _number(_GROUND, words)


def _number(pattern: re.Pattern[str], words: str) -> float:
    found = pattern.search(words)
    cell = read_cell(found[1]) if found else None
    return cell[0] if cell else float("nan")


_LAST_HEADING_LINE = 12
_LONGEST_LINE = 160  # of the program; longer ones are not worth remembering
_CONDITION_WINDOWS = cached_column_windows(CONDITIONS.columns, CONDITIONS.keys)
_UNITS = re.compile(r"(FT|IN|M|CM) +\1/SEC ")
_SECOND_TITLE = "APRIL 1976 VERSION OF DATCOM"  # one build breaks the title of a hypersonic page
# first line of the numbers on a page whose heading ends in a CASEID
_NUMBERS_BEGIN = re.compile(r".? *MACH NUMBER ?=|.? TIME \(SEC\)")
# headings around tables that carry nothing of their own
_DECORATION = re.compile(
    r"DERIVATIVE \(PER (DEGREE|RADIAN)\)$|DYNAMIC DERIVATIVES \(PER "
    r"(DEGREE|RADIAN)\)$|PITCHING +ACCELERATION +ROLLING +YAWING$"
    r"|INCREMENTS DUE TO DEFLECTION +DERIVATIVES \(PER DEGREE\)$"
    r"|(?<!\*)\*{100,}$"  # a frame of asterisks around a message
)
_PER = re.compile(r"DERIVATIVE[S]? ?\(PER (DEGREE|RADIAN)\)")


@dataclass
class PageBody:
    """What is printed on a page below its heading."""

    printed: list[Printed] = field(default_factory=list)
    notes: list[ListingMessage] = field(default_factory=list)
    messages: list[ListingMessage] = field(default_factory=list)
    unread: list[int] = field(default_factory=list)
    empty: list[tuple[int, TableLayout]] = field(default_factory=list)  # headings without a row
    per: str = ""
    target: list[ListingMessage] = field(
        default_factory=list
    )  # notes or messages, where the last one went


def read_page(
    lines: list[Line], case: int
) -> tuple[Page, list[ListingMessage], list[tuple[int, TableLayout]]]:
    """Return a page, the messages that stand on it, and line and kind of the headings that no row
    follows.
    """
    anchor = next(
        (
            i
            for i, (_, text) in enumerate(lines[:_LAST_HEADING_LINE])
            if "FLIGHT CONDITIONS" in text
        ),
        None,
    )
    start = _body_start(lines) if anchor is None else 0
    top = lines[1:start] if anchor is None else lines[1:anchor]
    heading = tuple(
        words for _, text in top if (words := text[1:].strip()) and words != _SECOND_TITLE
    )
    found = read_heading(lines[0][1], heading)
    conditions, dim, after = (None, "", start) if anchor is None else _conditions(lines, anchor)
    body = _read_body(lines, after, found.kind)
    page = Page(
        kind=found.kind,
        case=case,
        first=lines[0][0],
        last=lines[-1][0],
        heading=heading[:6],
        configuration=found.configuration,
        ground_height=found.ground_height,
        flap=found.flap,
        power=found.power,
        dim=dim,
        per=body.per,
        conditions=conditions,
        printed=tuple(body.printed),
        notes=tuple(body.notes),
        unread=tuple(body.unread),
    )
    return page, body.messages, body.empty


def _body_start(lines: list[Line]) -> int:
    """Return where the body of a page without flight conditions starts: behind the line that names
    its kind, and the CASEID.
    """
    top = lines[:_LAST_HEADING_LINE]
    start = next(
        (i + 1 for i, (_, text) in enumerate(top) if any(words in text for words, _ in TITLES)), 0
    )
    return next((i for i in range(start, len(top)) if _NUMBERS_BEGIN.match(top[i][1])), start)


def add_message(messages: list[ListingMessage], number: int, text: str) -> None:
    """Append a message of the program, or continue the one before."""
    if messages and footnotes.is_continuation(text):
        messages[-1] = messages[-1]._replace(text=f"{messages[-1].text} {text}")
    else:
        messages.append(ListingMessage(number, text))


def _conditions(lines: list[Line], anchor: int) -> tuple[PrintedTable | None, str, int]:
    """Return the flight-condition line, the unit of length and the index of the line after it."""
    for i in range(anchor + 1, min(anchor + 9, len(lines))):
        units = _UNITS.match(lines[i][1].strip() + " ")
        if units is None:
            continue
        for j in range(i + 1, min(i + 4, len(lines))):
            number, text = lines[j]
            if not text[1:].strip():
                continue
            if _CONDITION_WINDOWS.hold(text):
                return (
                    PrintedTable(CONDITIONS, CONDITIONS.columns, (number,), (text,)),
                    units[1],
                    j + 1,
                )
            break
        return None, units[1], i + 1
    return None, "", anchor + 1


def _read_body(lines: list[Line], at: int, kind: str) -> PageBody:
    body = PageBody()
    while at < len(lines):
        number, text = lines[at]
        at += 1
        if len(text) < 2:
            continue
        meaning = (_meaning if len(text) <= _LONGEST_LINE else _meaning.__wrapped__)(kind, text)
        if meaning.blocks and (found := _read_block(meaning.blocks, lines, at - 1)):
            body.printed += [item for item in found[0] if item.lines]
            at = max(at, found[1])
        elif meaning.layout is not None:
            table, after = read_printed_table(meaning.layout, lines, at)
            if table is not None:
                body.printed.append(table)
                at = after
            elif not _states_no_output(lines, at):
                body.unread.append(number)
                body.empty.append((number, meaning.layout))
        else:
            _sort(number, meaning, body)
    return body


def _read_block(
    blocks: tuple[PrintedBlock, ...], lines: list[Line], at: int
) -> tuple[list[Printed], int] | None:
    return next((found for block in blocks if (found := block.read(lines, at))), None)


def _states_no_output(lines: list[Line], at: int) -> bool:
    words = next((text[1:].strip() for _, text in lines[at : at + 3] if text[1:].strip()), "")
    return words.startswith("*NOTE* NO OUTPUT AVAILABLE")


class Meaning(NamedTuple):
    """What a line of a page may be: it opens one of the blocks, or a table, or it is a text of its
    own sort.
    """

    blocks: tuple[PrintedBlock, ...]
    layout: TableLayout | None
    sort: str
    words: str
    per: str


@lru_cache(4096)
def _meaning(kind: str, text: str) -> Meaning:
    """Return what a line may be on a page of a kind; the same headings and notes stand on every
    page.
    """
    words = normalise_heading(text)
    blocks = tuple(block for block in BLOCKS if kind in block.pages and block.opens.search(words))
    plain = footnotes.strip_control_column(text)
    per = _PER.search(plain)
    if per or _DECORATION.match(words):
        sort = "decoration" if _DECORATION.search(words) else "unread"
    elif not plain:
        sort = "decoration"
    else:
        sort = (
            "continued"
            if footnotes.is_continuation(plain)
            else footnotes.sort_of(plain) or "unread"
        )
    return Meaning(
        blocks,
        BY_HEADING.get(words),
        sort,
        plain,
        {"DEGREE": "deg", "RADIAN": "rad"}[per[1]] if per else "",
    )


def _sort(number: int, meaning: Meaning, body: PageBody) -> None:
    body.per = body.per or meaning.per
    if meaning.sort == "unread":
        body.unread.append(number)
    elif meaning.sort != "decoration":
        if meaning.sort != "continued":
            body.target = body.messages if meaning.sort == "message" else body.notes
        add_message(body.target, number, meaning.words)
        if found := footnotes.read_footnote_number(number, meaning.words):
            body.printed.append(found)
