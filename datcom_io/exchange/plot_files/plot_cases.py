"""The cases of a plot file (unit 13), and which records stand for which flight condition.

Nothing in the file names a record.  The program writes

* FLC once for every case whose cards it accepts, also for one that it aborts for a missing
  namelist;
* a static page in every flight condition, but not with a hypersonic flap at Mach 5 and more, a
  transverse jet, a supersonic Mach number with ground heights or engines, a low-aspect-ratio wing
  above the subsonic Mach numbers;
* a control device behind the page with SYMFLP or ASYFLP, in subsonic conditions also with TRIM and
  a horizontal tail, whether there is a page or not;
* in subsonic conditions a page for each deflection and height over ground;
* SYNA, OPT and the logicals before each page of the first Mach number at the first altitude.

The switches of the case thus state the records of each condition.  A case whose first condition has
no page has no logicals; then all sets of switches are tried that its records allow.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from datcom_io.exchange.plot_files.plot_records import PlotLines, PlotRecord
from datcom_io.exchange.plot_files.plot_schedule import (
    MOST_ANGLES,
    ScheduledCondition,
    ground_heights,
    is_number_missing,
    run_schedule,
)
from flightmech.errors import ParseError

PlotPage = dict[str, PlotRecord]
"""Records of a static page or of a control device by name."""

_LINES_OF_CASE = 16
_MOST_DELTAS = 10
_HYPERSONIC = 5.0  # from this Mach number on the hypersonic flap replaces the page
# Letters of the parts of a condition.
_LETTERS = {"heading": "H", "page": "P", "control": "C"}
_WORDS = {"H": "heading", "P": "static page", "C": "control device"}


@dataclass(eq=False)
class PlotCondition:
    """A flight condition with what the file holds of it.

    Attributes
    ----------
    scheduled : ScheduledCondition
    page, control : dict of str to PlotRecord
        Static page in free air and control device, empty without one.
    ground : list of dict of str to PlotRecord
        Pages over ground, deflection by deflection.  Page by page the program overwrites the
        blocks, so these hold the coefficients over ground.
    """

    scheduled: ScheduledCondition
    page: PlotPage = field(default_factory=dict)
    control: PlotPage = field(default_factory=dict)
    ground: list[PlotPage] = field(default_factory=list)

    @property
    def line(self) -> int:
        """First line of the condition, 0 where nothing is written."""
        records = [*self.page.values(), *self.control.values()]
        return records[0].line if records else 0


@dataclass(eq=False)
class PlotCase:
    """One case: records of the case, logicals and flight conditions.

    A case without a heading has no logicals.  `is_cut` states that the file ends before its last
    condition.
    """

    line: int
    records: dict[str, PlotRecord]
    logicals: dict[str, bool] = field(default_factory=dict)
    conditions: list[PlotCondition] = field(default_factory=list)
    is_cut: bool = False

    @property
    def flight(self) -> PlotRecord:
        """Record FLC, the flight conditions of the cards."""
        return self.records["FLC"]

    @property
    def has_pages(self) -> bool:
        """Whether a static page is written."""
        return any(condition.page for condition in self.conditions)


class _Part(NamedTuple):
    """A part of a case: heading, page or control device, at a line."""

    kind: str
    line: int
    records: PlotPage
    logicals: dict[str, bool]


def read_cases(path: str | os.PathLike[str]) -> list[PlotCase]:
    """Return the cases of a plot file.

    Raises
    ------
    ParseError
        The file is not a plot file, ends within a record, or does not have the records that its
        switches state.
    """
    lines = PlotLines(path)
    cases: list[PlotCase] = []
    index = 0
    while index < len(lines):
        line = index + 1
        records, index = lines.read_records(index, "case")
        case = PlotCase(line, records)
        parts: list[_Part] = []
        while index < len(lines) and not _begins_case(lines, index):
            part, index = _read_part(lines, index, parts)
            parts.append(part)
        _place_parts(case, parts, lines.file, is_last=index >= len(lines))
        cases.append(case)
    return cases


def _begins_case(lines: PlotLines, index: int) -> bool:
    """Return whether the record FLC begins at a line.

    Its first number and its last two count Mach numbers, altitudes and kinds of LOOP.  The
    coefficients of a page are not such numbers.
    """
    last = index + _LINES_OF_CASE - 1
    # A heading has a shorter second line, a control device a shorter fourteenth one.
    if {lines.count_fields(index + 1), lines.count_fields(index + 13)} != {10}:
        return False
    if lines.number(last, 10) not in (1.0, 2.0, 3.0):
        return False
    counts = range(MOST_ANGLES + 1)
    return lines.number(index, 1) in counts and lines.number(last, 9) in counts


def _read_part(lines: PlotLines, index: int, parts: Sequence[_Part]) -> tuple[_Part, int]:
    """Return the part of a case at a line, and the index of the line after it."""
    after_heading = bool(parts) and parts[-1].kind == "heading"
    kind, logicals = "page", {}
    if not after_heading and lines.count_fields(index + 1) == 9:
        kind = "heading"
    elif not after_heading and lines.count_fields(index + 13) == 8:
        kind = "control"
    records, after = lines.read_records(index, kind)
    if kind == "heading":
        logicals = lines.read_logicals(after)
        after += 1
    return _Part(kind, index + 1, records, logicals), after


# Parts of a case by its switches.

# Letters of each condition, one text for each regime it may be in.
_Texts = list[list[str]]


class _Switches(NamedTuple):
    """Switches of a case that decide what is written in a condition.

    `no_pages` stands for a transverse jet, `device` for SYMFLP or ASYFLP, `trim` for TRIM with a
    horizontal tail, `deflections` for the pages over ground of each height.
    """

    hypersonic_flap: bool
    no_pages: bool
    low_aspect_ratio: bool
    power: bool
    device: bool
    trim: bool
    deflections: int


def _known_switches(logicals: Mapping[str, bool]) -> dict[str, bool]:
    """Return the switches that the logicals of a case state."""
    if not logicals:
        return {}
    return {
        "hypersonic_flap": logicals["HYPEF"] and logicals["HYPERS"],
        "no_pages": logicals["TRAJET"],
        "low_aspect_ratio": logicals["LOASRT"],
        "power": logicals["PRPOWR"] or logicals["JETPOW"],
        "device": logicals["SYMFP"] or logicals["ASYFP"],
        "trim": logicals["TRIMC"] and logicals["HTPL"],
    }


def _possible_switches(case: PlotCase, parts: Sequence[_Part]) -> Iterator[_Switches]:
    """Yield the sets of switches that the case may have, the likely ones first."""
    known = _known_switches(case.logicals)
    choices: list[tuple[bool, ...]] = []
    for name in _Switches._fields[:-1]:
        choices.append((known[name],) if name in known else (False, True))
    # F: 16 NDELTA.  That of a hypersonic flap counts too, and is not in the file.
    controls = [part.records["F"] for part in parts if part.kind == "control"]
    counts: Sequence[int] = [1]
    if controls:
        counts = [max(1, controls[0].count(16, _MOST_DELTAS))]
    elif not case.logicals or case.logicals["HYPEF"]:
        counts = range(1, _MOST_DELTAS + 1)
    for deflections in counts:
        for switches in itertools.product(*choices):
            yield _Switches._make((*switches, deflections))


def _written_parts(case: PlotCase, condition: ScheduledCondition, switches: _Switches) -> list[str]:
    """Return the parts of a condition as letters, one text for each regime it may be in."""
    has_ground, heights = not is_number_missing(case.flight, 63), len(ground_heights(case.flight))
    page = "P"
    if condition.is_first:
        page = "HP"
    texts = []
    for regime in condition.regimes:
        is_subsonic = regime == "subsonic"
        if switches.no_pages or (switches.hypersonic_flap and condition.mach >= _HYPERSONIC):
            texts.append("")
            continue
        if switches.low_aspect_ratio:
            texts.append(page if is_subsonic else "")
            continue
        text = page
        if regime == "supersonic" and (has_ground or switches.power):
            text = ""
        if switches.device or (switches.trim and is_subsonic):
            text += "C"
        if is_subsonic and has_ground:
            text += page * (heights * switches.deflections)
        texts.append(text)
    return list(dict.fromkeys(texts))


def _place_parts(case: PlotCase, parts: list[_Part], file: str, *, is_last: bool) -> None:
    """Set headings and conditions of a case from its parts.

    Raises
    ------
    ParseError
        The parts are not those of the switches of the case.
    """
    headings = [part for part in parts if part.kind == "heading"]
    if headings:
        case.records.update(headings[0].records)
        case.logicals = headings[0].logicals
    schedule = run_schedule(case.flight)
    case.conditions = [PlotCondition(condition) for condition in schedule]
    # The program writes FLC of a case that it aborts for a missing namelist.
    if not parts:
        return
    kinds = "".join(_LETTERS[part.kind] for part in parts)
    possible = []
    for switches in _possible_switches(case, parts):
        possible.append([_written_parts(case, item, switches) for item in schedule])
    # Without logicals the end of a cut file could be taken for the end of another case.
    allow_cut = is_last and bool(case.logicals)
    for is_cut in (False, True)[: 1 + allow_cut]:
        found = {ends for texts in possible if (ends := _match(kinds, texts, is_cut)[0])}
        if len(found) == 1:
            _fill_conditions(case, parts, found.pop())
            case.is_cut = is_cut
            return
        if found:
            raise ParseError(
                file,
                case.line,
                f"{len(parts)} parts that fit the flight conditions of the case in {len(found)} "
                "ways",
                "parts that fit in one way; run the program with a subsonic Mach number first",
            )
    raise _misplaced(case, parts, file, possible)


def _misplaced(
    case: PlotCase, parts: Sequence[_Part], file: str, possible: Sequence[_Texts]
) -> ParseError:
    """Return the error of parts that are not those of the switches of the case."""
    kinds = "".join(_LETTERS[part.kind] for part in parts)
    reached = [(_match(kinds, texts, False)[1], texts) for texts in possible]
    farthest, texts = max(reached, key=lambda pair: pair[0])
    found, line = "the end of the case", case.line
    if farthest < len(parts):
        found, line = f"a {_WORDS[kinds[farthest]]}", parts[farthest].line
    allowed = _describe(kinds[:farthest], texts)
    return ParseError(
        file,
        line,
        f"{found} as part {farthest + 1} of the case at line {case.line}",
        f"{allowed}, as MACH, LOOP, NGH, NDELTA and the logicals of the case state; run the "
        f"program again",
    )


def _match(kinds: str, texts: _Texts, allow_cut: bool) -> tuple[tuple[int, ...] | None, int]:
    """Return the end of each condition in a text of letters, None for no match, and how far it
    fits.

    With `allow_cut` the text may end within a condition.
    """
    farthest = 0
    # Conditions that may be in two regimes have two texts; a stack holds the open choices.
    stack: list[tuple[tuple[int, ...], int]] = [((), 0)]
    while stack:
        ends, start = stack.pop()
        if len(ends) == len(texts):
            if start == len(kinds):
                return ends, start
            continue
        for text in reversed(texts[len(ends)]):
            common = _count_common(text, kinds[start:])
            farthest = max(farthest, start + common)
            if common == len(text):
                stack.append(((*ends, start + common), start + common))
            elif allow_cut and start + common == len(kinds):
                return (*ends, len(kinds)), len(kinds)
    return None, farthest


def _count_common(text: str, other: str) -> int:
    """Return the number of letters in which two texts agree from their beginning on."""
    for place, (a, b) in enumerate(zip(text, other)):
        if a != b:
            return place
    return min(len(text), len(other))


def _describe(fitting: str, texts: _Texts) -> str:
    """Return in words what may follow the parts that fit."""
    whole = "".join(text[0] for text in texts)
    if whole.startswith(fitting) and len(whole) > len(fitting):
        return f"a {_WORDS[whole[len(fitting)]]}"
    return "the end of the case"


def _fill_conditions(case: PlotCase, parts: list[_Part], ends: Sequence[int]) -> None:
    """Set the records of the conditions; each ends at a part."""
    start = 0
    for condition, end in zip(case.conditions, ends):
        own = [part for part in parts[start:end] if part.kind != "heading"]
        pages = [part.records for part in own if part.kind == "page"]
        # The page in free air stands before the control device, those over ground behind it.
        has_page = bool(own) and own[0].kind == "page"
        if has_page:
            condition.page = pages[0]
        condition.ground = pages[has_page:]
        for part in own:
            if part.kind == "control":
                condition.control = part.records
        start = end
