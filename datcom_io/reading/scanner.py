"""Pass over the lines of a print: runs, cases, pages and messages."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import NamedTuple

from datcom_io.cells import BLANK
from datcom_io.decks.deck import Deck, parse_cards
from datcom_io.listing import Case, DamagedListing, Listing
from datcom_io.printout.content import ListingMessage, Page
from datcom_io.printout.layouts import notes
from datcom_io.printout.rows import Line
from datcom_io.printout.tables import Printed, PrintedTable, TableLayout
from datcom_io.reading.lines import ARRAY_DUMP, anchor_kind, boundary_lines, is_progress
from datcom_io.reading.pages import add_message, read_page

# Text that the program prints behind a card with a fault, from column 82 on.
_CARD_TAIL = re.compile(r"\*\* (?:ERROR|ILLEGAL|MISSING)")
_TAIL_COLUMN = 81
_DIMENSIONS = "INPUT DIMENSIONS ARE IN"
_ERROR_CARD = "ERROR IN CARD BELOW"
_FINAL_INPUTS = "THE FOLLOWING IS A LIST OF FINAL INPUTS"
_WITH_CONDITIONS = ("static", "dynamic", "high-lift", "auxiliary")
# A run of at least three letters.
_WORD = re.compile(r"[A-Za-z]{3}")
_USE_PARTIAL = "or read its complete part with partial=True (--partial)"


class _Fault(NamedTuple):
    """Damage of a page: the items to leave out, a line, the fault, what was expected."""

    items: list[Printed]
    line: int
    problem: str
    expected: str


class Scanner:
    """The state of the pass over the lines; `complete` gets each case when it ends.

    Parameters
    ----------
    listing : Listing
        Gets the messages and lines that belong to no case.
    partial : bool
        Leave out what is damaged instead of raising.
    """

    def __init__(self, listing: Listing, partial: bool):
        self.listing = listing
        self.partial = partial
        self.complete: list[Case] = []
        self.count = 0  # of complete cases
        self.region = "banner"  # banner, echo, cards, between, page, end
        self.case: Case | None = None
        self.deck: Deck | None = None  # of the case before in the same run
        self.cards: list[Line] = []
        self.page: list[Line] = []
        self.open_run = False  # a run has begun and not ended
        self.last = 0  # last line that is not blank

    # Lines.

    def read_lines(self, lines: list[str]) -> None:
        """Read the next lines of the file."""
        # Lines between two boundaries are handled as one piece.
        start = self.listing.line_count + 1
        done = 0
        for i in boundary_lines(lines):
            self._read_plain(start + done, lines[done:i])
            self._read_boundary(start + i, lines[i])
            done = i + 1
        self._read_plain(start + done, lines[done:])
        self.listing.line_count += len(lines)

    def end(self) -> None:
        """Close all parts that are open at the end of the file."""
        self._close_page()
        self._close_cards()
        self._close_run()
        if self.listing.runs or self.count:
            return
        problem = "an empty file"
        if self.listing.line_count:
            problem = "no page of Digital DATCOM"
        expected = (
            "a print file (unit 6, for006.dat) with its input cards; for an input "
            "deck run the program first"
        )
        raise DamagedListing(self.listing.file, 0, problem, expected, listing=self.listing)

    def _read_plain(self, number: int, lines: list[str]) -> None:
        """Read lines that open and close nothing."""
        if self.region == "page":
            self.page += enumerate(lines, number)
            for i in range(len(lines) - 1, -1, -1):
                if not lines[i].isspace():
                    self.last = number + i
                    break
            return
        for line_number, line in enumerate(lines, number):
            if not line.isspace():
                self._read_inside(line_number, line)
                self.last = line_number

    def _read_boundary(self, number: int, line: str) -> None:
        """Read a line that may open or close something."""
        kind = anchor_kind(line)
        if kind:
            self._open_part(kind, number, line)
        elif line[0] == "1" and self.region not in ("banner", "echo", "end"):
            self._read_new_page(number, line)
        elif not is_progress(line):
            self._read_inside(number, line)
        self.last = number

    def _open_part(self, kind: str, number: int, line: str) -> None:
        """Open a run, a case, a page or the end of a run."""
        # A page may print the words of an anchor without carriage control.
        if self.region == "page" and line[0] != "1" and kind in ("run", "case", "end"):
            self._read_inside(number, line)
            return
        self._close_page()
        if kind == "run":
            self._close_run()
            self.listing.runs += 1
            self.open_run, self.region, self.deck = True, "echo", None
        elif kind == "case":
            self._close_case()
            self.open_run = True
            self.case = self._new_case(number)
            self.region, self.cards = "cards", []
        elif kind == "end":
            self._close_case()
            self.open_run, self.region = False, "end"
        else:
            self._close_cards()
            self.open_run, self.region, self.page = True, "page", [(number, line)]

    def _read_new_page(self, number: int, line: str) -> None:
        """Read a line with carriage control 1 that is not an anchor."""
        # The namelist echo starts every group with a new page.
        if self.page and self.page[0][1].lstrip("1 ").startswith(_FINAL_INPUTS):
            self.page.append((number, line))
            return
        self._close_page()
        self._close_cards()
        if notes.sort_of(line[1:].strip()) == "message":
            self._read_remark(number, line)
        elif line.strip() != "1":
            self.region, self.page = "page", [(number, line)]

    def _read_inside(self, number: int, line: str) -> None:
        """Read a line inside the region that is open."""
        # Card DUMP A,B prints arrays without a heading.
        may_dump = self.region in ("page", "between") and ")=" in line[:20]
        in_dump = bool(self.page) and self._is_dump(self.page[0][1])
        if may_dump and not in_dump and ARRAY_DUMP.match(line):
            self._close_page()
            self.region = "page"
        if self.region == "page":
            self.page.append((number, line))
        elif self.region == "cards":
            self._read_card(number, line)
        elif self.region == "between":
            self._read_remark(number, line)
        elif self.region == "echo":
            self._read_card_tail(number, line)

    @staticmethod
    def _is_dump(first: str) -> bool:
        """Return whether a page is a dump, by its first line."""
        return anchor_kind(first) == "dump" or ARRAY_DUMP.match(first) is not None

    def _read_card_tail(self, number: int, line: str) -> None:
        """Add the fault that the program prints behind a card of the echo."""
        tail = line[_TAIL_COLUMN:]
        if _CARD_TAIL.search(tail):
            text = f"{tail.strip()}: {line[1:_TAIL_COLUMN].strip()}"
            self.listing.own_messages.append(ListingMessage(number, text))

    def _read_card(self, number: int, line: str) -> None:
        """Read a line of the card block of a case: a card, or a message about one."""
        text = line[1:]
        stripped = text.strip()
        is_message = notes.sort_of(stripped) == "message" or notes.is_continuation(stripped)
        if _DIMENSIONS in text:
            self._close_cards()
        elif self.cards and self.cards[-1][1].startswith("NEXT CASE"):
            self._close_cards()
            self._read_remark(number, line)
        elif line[0] == "0" or is_message:
            if stripped:
                self._read_remark(number, line)
        elif self._follows_error_card():
            self._read_remark(number, line)
        elif stripped:
            self.cards.append((number, text))

    def _follows_error_card(self) -> bool:
        """Return whether the line before announces a wrong card."""
        if not self.case or not self.case.messages:
            return False
        return self.case.messages[-1] == ListingMessage(self.last, _ERROR_CARD)

    def _read_remark(self, number: int, line: str) -> None:
        """Sort a line between the pages: with a word in it, it is a message."""
        text = line[1:].strip()
        # A caret stands below the wrong word of a card; asterisks are a decoration.
        if not text.strip("*^") or text.startswith(_DIMENSIONS):
            return
        if not _WORD.search(text):
            self.listing.unread.append(number)
        elif self.case is None:
            add_message(self.listing.own_messages, number, text)
        else:
            add_message(self.case.messages, number, text)

    # Ends of cards, pages, cases and runs.

    def _new_case(self, number: int) -> Case:
        return Case(
            ordinal=self.count + 1,
            run=max(self.listing.runs, 1),
            line=number,
            file=self.listing.file,
        )

    def _close_cards(self) -> None:
        """Read the deck of the case when its card block ends."""
        if self.region != "cards" or self.case is None:
            return
        self.region = "between"
        self.case.deck = self.deck = parse_cards(self.cards, self.deck)
        for line, text in self.case.deck.problems:
            self.case.messages.append(ListingMessage(line, text, "reader"))

    def _close_page(self) -> None:
        """Read the page that is open and put it into its case."""
        if not self.page:
            return
        if self.case is None:
            self.case = self._new_case(self.page[0][0])
        # Blank lines behind a page do not belong to it.
        while len(self.page) > 1 and not self.page[-1][1].strip():
            self.page.pop()
        page, messages, empty_tables = read_page(self.page, self.case.ordinal)
        self.page, self.region = [], "between"
        self.case.messages += messages
        page, empty_tables = self._accept_headings(page, empty_tables)
        self.listing.unread += page.unread
        self._add_page(page, empty_tables)

    def _accept_headings(
        self, page: Page, empty_tables: list[tuple[int, TableLayout]]
    ) -> tuple[Page, list[tuple[int, TableLayout]]]:
        """Return a page and its empty tables without those for which the cards count no value.

        The program prints the headings of a table whose angles or deflections are not given.
        """
        assert self.case is not None
        left, unread = [], list(page.unread)
        for line, layout in empty_tables:
            across = layout.across.counted if layout.across else None
            if across and not self.case.deck.count(*across):
                # Below the heading stand angles alone.
                unread = [number for number in unread if number < line]
            elif layout.rows and not self.case.deck.count(*layout.rows):
                unread.remove(line)
            else:
                left.append((line, layout))
        return replace(page, unread=tuple(unread)), left

    def _add_page(self, page: Page, empty_tables: list[tuple[int, TableLayout]]) -> None:
        """Put a page into its case, without its damaged items; raise unless they are allowed."""
        assert self.case is not None
        faults = self._find_faults(page, empty_tables)
        damaged: list[Printed] = []
        for fault in faults:
            damaged += fault.items
        if damaged:
            # Tables of equal content differ by identity only.
            damaged_ids = set(map(id, damaged))
            intact = tuple(item for item in page.printed if id(item) not in damaged_ids)
            page = replace(page, printed=intact)
        if page.printed or not faults:
            self.case.pages.append(page)
        for fault in faults:
            if not self.partial:
                hint = f"the listing is damaged: run the program again, {_USE_PARTIAL}"
                expected = f"{fault.expected}; {hint}"
                raise self._damage_error(fault.line, fault.problem, expected)
            text = f"{fault.problem} instead of {fault.expected}: left out"
            self.case.messages.append(ListingMessage(fault.line, text, "reader"))

    def _find_faults(self, page: Page, empty_tables: list[tuple[int, TableLayout]]) -> list[_Fault]:
        """Return the damage of a page, by line."""
        assert self.case is not None
        if page.printed and page.conditions is None and page.kind in _WITH_CONDITIONS:
            problem = "no flight-condition line that can be read"
            expected = "a line of numbers below the units row of the page"
            return [_Fault(list(page.printed), page.first, problem, expected)]
        faults: list[_Fault] = []
        for table in page.tables:
            if table.layout.stream:
                miscount = _miscounted_stream(table, self.case.deck)
            else:
                miscount = self._miscounted_rows(page, table.layout, len(table.rows))
            if miscount:
                faults.append(_Fault([table], table.lines[-1], *miscount))
        for line, layout in empty_tables:
            miscount = self._miscounted_rows(page, layout, 0)
            if miscount:
                faults.append(_Fault([], line, *miscount))
        return sorted(faults, key=lambda fault: fault.line)

    def _miscounted_rows(
        self, page: Page, layout: TableLayout, count: int
    ) -> tuple[str, str] | None:
        """Return how many rows a table has and how many the input cards specify.

        The result is None where they agree, or where a table may end early.
        """
        assert self.case is not None
        if layout.rows is None:
            return None
        expected = self.case.deck.count(*layout.rows)
        if expected is None or count == expected:
            return None
        if count < expected and self._ends_early(page, layout):
            return None
        return (
            f"{count} rows in the {layout.name} table",
            f"{expected} rows ({layout.rows[1]} of the input cards)",
        )

    def _ends_early(self, page: Page, layout: TableLayout) -> bool:
        """Return whether a note of the page explains that rows are missing."""
        assert self.case is not None
        if layout.stops:
            return any(layout.stops in note.text for note in page.notes)
        # A static page has the note itself; the pages after it end early without a note.
        page_notes = list(page.notes)
        if page.kind != "static":
            for earlier_page in self.case.pages:
                page_notes += earlier_page.notes
        return any("ANALYSIS TERMINATED" in note.text for note in page_notes)

    def _damage_error(self, line: int, problem: str, expected: str) -> DamagedListing:
        """Return the error for a fault, with the complete part of the open case."""
        listing = Listing(
            self.listing.file,
            self.listing.runs,
            line_count=self.listing.line_count,
            unread=self.listing.unread,
            own_messages=self.listing.own_messages,
        )
        if self.case is not None:
            listing.cases.append(self.case)
        return DamagedListing(self.listing.file, line, problem, expected, listing=listing)

    def _close_case(self) -> None:
        """Complete the open case; an empty card block is not a case."""
        self._close_cards()
        case, self.case = self.case, None
        if case is None:
            return
        if case.pages or case.messages or case.deck.cards or case.deck.namelists:
            self.count += 1
            self.complete.append(case)

    def _close_run(self) -> None:
        """Close a run; without END OF JOB it was stopped by the program, or is truncated."""
        if self.open_run and not self._is_stopped():
            text = self._drop_truncated_page()
            if not self.partial:
                expected = f"the line END OF JOB.; the listing is cut: run it again, {_USE_PARTIAL}"
                raise self._damage_error(self.last, "the end of the print", expected)
            self.listing.own_messages.append(ListingMessage(self.last, text, "reader"))
        self._close_case()
        self.open_run = False

    def _is_stopped(self) -> bool:
        """Return whether the program has stopped the run by a message of the open case."""
        if self.case is None:
            return False
        return any("EXECUTION TERMINATING" in message.text for message in self.case.messages)

    def _drop_truncated_page(self) -> str:
        """Leave out what may be truncated, and return a text about it.

        It is the last item when it reaches the last line, and the page when no item stays.
        """
        text = "the listing is cut: no END OF JOB"
        if self.case is None or not self.case.pages or self.case.pages[-1].last < self.last:
            return text
        page = self.case.pages.pop()
        printed = page.printed
        # The last line of the file may be an incomplete row.
        if printed and printed[-1].lines[-1] == self.last:
            printed = printed[:-1]
        if printed:
            self.case.pages.append(replace(page, printed=printed))
        return f"{text}; the last table of the page at lines {page.first}-{page.last} is left out"


def _miscounted_stream(table: PrintedTable, deck: Deck) -> tuple[str, str] | None:
    """Return how many values a stream has and how many the cards specify, None where they agree."""
    counts = []
    for variable in table.layout.stream:
        count = deck.count(*variable)
        if count is None:
            return None
        counts.append(count)
    printed = table.flags.ravel() != BLANK
    expected, count = math.prod(counts), int(printed.sum())
    if count == expected and printed[:count].all():
        return None
    product = " x ".join(variable for _, variable in table.layout.stream)
    return (
        f"{count} values in the {table.name} table",
        f"{expected} values ({product} of the input cards)",
    )
