"""Reading a listing: one pass over its lines, one page in memory at a time."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from flightmech.errors import ParseError

from . import faults
from .deck import Deck, parse_cards
from .layouts.form import Line
from .lines import anchor, is_progress, open_lines, with_control_column
from .listing import Case, Listing, Message, Page
from .pages import add_message, read_page
from .tables import Table

_CARD_TAIL = re.compile(r"\*\* (?:ERROR|ILLEGAL|MISSING)")
_DIMENSIONS = "INPUT DIMENSIONS ARE IN"
_ERROR_CARD = "ERROR IN CARD BELOW"
_WITH_CONDITIONS = ("static", "dynamic", "high-lift", "auxiliary")
_ARRAY_DUMP = re.compile(r" +[A-Z][A-Z0-9]* *\( *\d+\)=")


def read(source: str | os.PathLike[str] | Iterable[str], *, partial: bool = False) -> Listing:
    """Read the print file (unit 6) of Digital DATCOM.

    Parameters
    ----------
    source : path, or iterable of str
        File, or its lines.  Line ends LF or CRLF; several program runs may follow each other; column 1 may be missing.
    partial : bool
        Take what is complete in a file that is cut, and say so in a message, instead of raising.

    Returns
    -------
    Listing

    Raises
    ------
    ParseError
        The file is no listing, is cut (no END OF JOB), or a table has another number of rows than the deck asks for.

    Notes
    -----
    The program's own faults are reported as messages, never repaired: see `datcom_io.faults`.
    """
    file = os.path.basename(os.fspath(source)) if isinstance(source, str | os.PathLike) else "<text>"
    scanner = _Scanner(Listing(file), partial)
    for number, line in with_control_column(open_lines(source)):
        scanner.take(number, line)
    return scanner.finish()


class _Scanner:
    """The state of the pass: which run, case, page and region the next line belongs to."""

    def __init__(self, listing: Listing, partial: bool):
        self.listing, self.partial = listing, partial
        self.region = "banner"  # banner, echo, cards, between, page, end
        self.case: Case | None = None
        self.deck: Deck | None = None  # of the case before in the same run
        self.cards: list[Line] = []
        self.page: list[Line] = []
        self.open_run = False  # a run that has begun and not ended
        self.last = 0  # last line that is not blank

    def take(self, number: int, line: str) -> None:
        self.listing.line_count = number
        if line.isspace():
            return self._blank(number, line)
        kind = anchor(line)
        if kind:
            self._open(kind, number, line)
        elif line[0] == "1" and self.region not in ("banner", "echo", "end"):
            self._control_one(number, line)
        elif not is_progress(line):
            self._inside(number, line)
        self.last = number
        return None

    def _blank(self, number: int, line: str) -> None:
        if self.region == "page":
            self.page.append((number, line))

    def _open(self, kind: str, number: int, line: str) -> None:
        if self.region == "page" and line[0] != "1" and kind in ("run", "case", "end"):
            return self._inside(number, line)
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
        return None

    def _control_one(self, number: int, line: str) -> None:
        if self.page and self.page[0][1].lstrip("1 ").startswith("THE FOLLOWING IS A LIST OF FINAL INPUTS"):
            self.page.append((number, line))  # the namelist echo starts every group with a new page
            return
        self._close_page()
        self._close_cards()
        if line.strip() != "1":
            self.region, self.page = "page", [(number, line)]

    def _inside(self, number: int, line: str) -> None:
        if self.region == "page":
            if ")=" in line[:20] and _ARRAY_DUMP.match(line) and not self._is_dump(self.page[0][1]):
                self._close_page()
                self.region = "page"
            self.page.append((number, line))
        elif self.region == "cards":
            self._card(number, line)
        elif self.region == "between":
            self._remark(number, line)
        elif self.region == "echo" and _CARD_TAIL.search(line[81:]):
            self.listing.own_messages.append(Message(number, f"{line[81:].strip()}: {line[1:81].strip()}"))

    @staticmethod
    def _is_dump(first: str) -> bool:
        """Tell whether a page is a dump; card DUMP A,B prints arrays without a heading."""
        return anchor(first) == "dump" or _ARRAY_DUMP.match(first) is not None

    def _card(self, number: int, line: str) -> None:
        text = line[1:]
        if _DIMENSIONS in text:
            self._close_cards()
        elif self.cards and self.cards[-1][1].startswith("NEXT CASE"):
            self._close_cards()
            self._remark(number, line)
        elif line[0] == "0" or text.startswith(_ERROR_CARD):
            if text.strip():
                self._remark(number, line)
        elif self.case and self.case.messages and self.case.messages[-1] == Message(self.last, _ERROR_CARD):
            self._remark(number, line)
        elif text.strip():
            self.cards.append((number, text))

    def _remark(self, number: int, line: str) -> None:
        """Sort a line between the pages: with a word in it, it is a message."""
        text = line[1:].strip()
        if not text.strip("*") or text.startswith(_DIMENSIONS):
            return
        if not any(word.isalpha() and len(word) > 2 for word in re.split(r"[^A-Za-z]+", text)):
            self.listing.unread.append(number)
        else:
            add_message(self.listing.own_messages if self.case is None else self.case.messages, number, text)

    def _new_case(self, number: int) -> Case:
        return Case(ordinal=len(self.listing.in_order) + 1, run=max(self.listing.runs, 1), line=number, file=self.listing.file)

    def _close_cards(self) -> None:
        if self.region != "cards" or self.case is None:
            return
        self.region = "between"
        self.case.deck = self.deck = parse_cards(self.cards, self.deck)
        self.case.messages += [Message(line, text, "reader") for line, text in self.case.deck.problems]

    def _close_page(self) -> None:
        if not self.page:
            return
        if self.case is None:
            self.case = self._new_case(self.page[0][0])
        while len(self.page) > 1 and not self.page[-1][1].strip():
            self.page.pop()
        page, messages, unread = read_page(self.page, self.case.ordinal)
        self.page, self.region = [], "between"
        self.case.messages += messages
        self.listing.unread += unread
        self.case.pages.append(self._checked(page))

    def _checked(self, page: Page) -> Page:
        """Demand the number of rows that the deck asks for."""
        assert self.case is not None
        if page.tables and page.conditions is None and page.kind in _WITH_CONDITIONS:
            found, expected = "no flight-condition line that can be read", "a line of numbers below the units row"
            if not self.partial:
                raise ParseError(
                    self.listing.file, page.first, found, f"{expected}; the page is damaged: take the rest with partial=True (--partial)"
                )
            self.case.messages.append(Message(page.first, f"{found} on the page: its tables are left out", "reader"))
            return replace(page, printed=(), parsed=False)
        for table in page.tables:
            wanted = self.case.deck.count(*table.layout.rows) if table.layout.rows else None
            if wanted is None or len(table.rows) == wanted or (len(table.rows) < wanted and self._ends_early(page)):
                continue
            assert table.layout.rows is not None
            count, variable = len(table.rows), table.layout.rows[1]
            found, expected = f"{count} rows in the {table.name} table", f"{wanted} rows ({variable} of the input cards)"
            if not self.partial:
                line = table.lines[-1]
                raise ParseError(
                    self.listing.file,
                    line,
                    found,
                    f"{expected}; the listing is damaged: run the program again, or take the rest with partial=True (--partial)",
                )
            self.case.messages.append(Message(table.lines[0], f"{found} instead of {expected}: left out", "reader"))
            page = _without(page, table)
        return page

    def _ends_early(self, page: Page) -> bool:
        assert self.case is not None
        pages = [page] if page.kind == "static" else [page, *self.case.pages]
        return any("ANALYSIS TERMINATED" in note.text for other in pages for note in other.notes)

    def _close_case(self) -> None:
        self._close_cards()
        case, self.case = self.case, None
        if case is None or not (case.pages or case.messages or case.deck.cards or case.deck.namelists):
            return
        self.listing.in_order.append(case)

    def _close_run(self) -> None:
        """Judge a run that ends without END OF JOB: stopped by the program, or cut."""
        stopped = self.case is not None and any("EXECUTION TERMINATING" in message.text for message in self.case.messages)
        if self.open_run and not stopped:
            if not self.partial:
                raise ParseError(
                    self.listing.file,
                    self.last,
                    "the end of the print",
                    "the line END OF JOB.; the listing is cut: run it again, or take what is complete with partial=True (--partial)",
                )
            self._drop_cut_page()
        self._close_case()
        self.open_run = False

    def _drop_cut_page(self) -> None:
        """Leave out what may be cut: the last table when it reaches the last line, and the page when no table stays."""
        text = "the listing is cut: no END OF JOB"
        if self.case is not None and self.case.pages and self.case.pages[-1].last >= self.last:
            page = self.case.pages[-1]
            if page.tables and page.tables[-1].lines[-1] == self.last:
                page = _without(page, page.tables[-1])
            if page.tables:
                self.case.pages[-1] = page
            else:
                self.case.pages.pop()
            text += f"; the last table of the page at lines {page.first}-{page.last} is left out"
        self.listing.own_messages.append(Message(self.last, text, "reader"))

    def finish(self) -> Listing:
        self._close_page()
        self._close_cards()
        self._close_run()
        if not self.listing.runs and not self.listing.in_order:
            raise ParseError(
                self.listing.file,
                0,
                "no page of Digital DATCOM" if self.listing.line_count else "an empty file",
                "a print file (unit 6, for006.dat) with its input cards; for an input deck run the program first",
            )
        _name_cases(self.listing.in_order)
        faults.report(self.listing)
        return self.listing


def _without(page: Page, table: Table) -> Page:
    return replace(page, printed=tuple(other for other in page.printed if other is not table))


def _name_cases(cases: list[Case]) -> None:
    """Name cases by their CASEID; a second one of the same name gets `` (2)``."""
    used: set[str] = set()
    seen: Counter[str] = Counter()
    for case in cases:
        base = case.deck.caseid or f"case {case.ordinal}"
        case.name = base
        while case.name in used or seen[base] == 0:
            seen[base] += 1
            case.name = base if seen[base] == 1 else f"{base} ({seen[base]})"
        used.add(case.name)
