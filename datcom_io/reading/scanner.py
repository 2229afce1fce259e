"""Which run, case, page and region of the print a line belongs to."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import islice
from typing import TextIO

from datcom_io.cells import BLANK
from datcom_io.decks.deck import Deck, parse_cards
from datcom_io.listing import Case, DamagedListing, Listing
from datcom_io.printout.content import ListingMessage, Page
from datcom_io.printout.layouts import notes
from datcom_io.printout.rows import Line
from datcom_io.printout.tables import Printed, PrintedTable, TableLayout
from datcom_io.reading.pages import add_message, read_page
from flightmech.support.input_files import demand_regular, marked_encoding

ANCHORS = {
    "CONERR - INPUT ERROR CHECKING": "run",
    "THE FOLLOWING IS A LIST OF ALL INPUT CARDS FOR THIS CASE": "case",
    "AUTOMATED STABILITY AND CONTROL METHODS": "page",
    "THE FOLLOWING IS A LIST OF FINAL INPUTS": "page",
    "EXTRAPOLATION MESSAGE SUMMARY": "page",
    "**** FOLLOWING ARE THE": "dump",
    "**** THE FOLLOWING ARE": "dump",
    "END OF JOB.": "end",
}
_STARTS = tuple(ANCHORS)
_PROGRESS = re.compile(
    r" ?(?:Return to main program from|Preparing to start the big loop|At \d+\s*$)"
)
ARRAY_DUMP = re.compile(r" +[A-Z][A-Z0-9]* *\( *\d+\)=")
_MAY_TURN = re.compile(
    r"1|[^1] *+(?=[A-Z*])(?:[A-Z][A-Z0-9]* *\( *\d+\)=|Return to|Preparing|At |"
    + "|".join(map(re.escape, _STARTS))
    + ")|Return to|Preparing|At "
)
_BLOCK_CHARACTERS = 1 << 18
_BLOCK_LINES = 4096
_LONGEST_LINE = 160  # of the program; longer ones are not worth remembering
_TRAILING = "\r\n\x1a "


def line_blocks(source: str | os.PathLike[str] | Iterable[str]) -> Iterator[list[str]]:
    """Yield the lines of a file or of an iterable in blocks, without their ends; only a line feed
    ends a line, in a file without one a CR.

    Bytes are read as ISO 8859-1, so that any byte in a CASEID survives; a byte-order mark is
    dropped, and that of UTF-16, as PowerShell writes it, or UTF-32 is obeyed.  Tabs are expanded to
    every eighth column.
    """
    if not isinstance(source, str | os.PathLike):
        rest = iter(source)
        first = True
        while lines := [str(line) for line in islice(rest, _BLOCK_LINES)]:
            if first:
                lines[0], first = lines[0].removeprefix("\ufeff"), False
            yield _clean(lines, "".join(lines))
        return
    demand_regular(source, "a print file (unit 6, for006.dat)")
    with open(source, "rb") as stream:
        head = stream.read(_BLOCK_CHARACTERS)
    encoding, skip = marked_encoding(head)
    if encoding in ("", "utf-8"):
        encoding = "latin-1"
    else:
        skip = 1
    line_end = "\n" if b"\n" in head or b"\r" not in head else None  # None: a lone CR ends a line
    with open(source, encoding=encoding, errors="replace", newline=line_end) as text:
        text.read(skip)
        yield from _blocks(text)


def _blocks(stream: TextIO) -> Iterator[list[str]]:
    begun: list[str] = []  # pieces of a line whose end has not come yet
    while block := stream.read(_BLOCK_CHARACTERS):
        begun.append(block)
        if "\n" in block:
            text = "".join(begun)
            *lines, rest = text.split("\n")
            begun = [rest]
            yield _clean(lines, text)
    if rest := "".join(begun):
        yield _clean([rest], rest)


def _clean(lines: list[str], text: str) -> list[str]:
    """Return lines without their ends; `text` is all of them."""
    if "\x1a" in text:
        lines = [line.lstrip("\x1a") for line in lines]
    if "\t" in text:
        lines = [line.expandtabs() for line in lines]
    return [line.rstrip(_TRAILING) for line in lines]


def anchor_kind(line: str) -> str:
    """Return which part of the print a line opens: ``run case page dump end``, or an empty text."""
    return _known_anchor(line) if len(line) <= _LONGEST_LINE else _anchor(line)


def _anchor(line: str) -> str:
    text = line[1:].lstrip()
    if not text.startswith(_STARTS):
        return ""
    return next(kind for words, kind in ANCHORS.items() if text.startswith(words))


_known_anchor = lru_cache(1024)(_anchor)


def boundary_lines(lines: list[str]) -> list[int]:
    """Return the indices of lines that may open or close a part of the print, or are no part of it."""
    match = _MAY_TURN.match
    return [i for i, line in enumerate(lines) if match(line)]


class ControlColumn:
    """Puts column 1 back where a printer filter took it away.

    The first line of the print proper decides, and the first line of every further program run in
    the file decides again: with control column it starts with ``1``.  A banner before it is passed
    on as it is.
    """

    def __init__(self) -> None:
        self.missing: bool | None = None

    def restore(self, lines: list[str]) -> list[str]:
        """Return the lines of a block with column 1; none of them is empty."""
        done: list[str] = []
        for i in (
            range(len(lines))
            if self.missing is None
            else [i for i, line in enumerate(lines) if "CONERR" in line]
        ):
            missing = (
                self._missing(lines[i].lstrip("\f"))
                if self.missing is None or "CONERR" in lines[i]
                else None
            )
            if missing is not None:
                done += self._restored(lines[len(done) : i])
                self.missing = missing
        return done + self._restored(lines[len(done) :])

    @staticmethod
    def _missing(line: str) -> bool | None:
        if line.startswith("1") and anchor_kind(line):
            return False
        return True if anchor_kind(" " + line) else None

    def _restored(self, lines: list[str]) -> list[str]:
        if self.missing:
            return [_with_control(line) for line in lines]
        return [line.lstrip("\f") or " " for line in lines]


def _with_control(line: str) -> str:
    text = line.lstrip("\f")
    return ("1" if text != line or anchor_kind(" " + text) else " ") + text


def is_progress(line: str) -> bool:
    """Return whether a line is one of the progress lines that some builds print between the tables."""
    return _PROGRESS.match(line) is not None


_CARD_TAIL = re.compile(r"\*\* (?:ERROR|ILLEGAL|MISSING)")
_DIMENSIONS = "INPUT DIMENSIONS ARE IN"
_ERROR_CARD = "ERROR IN CARD BELOW"
_FINAL_INPUTS = "THE FOLLOWING IS A LIST OF FINAL INPUTS"
_WITH_CONDITIONS = ("static", "dynamic", "high-lift", "auxiliary")
_TAKE_THE_REST = "or take the rest with partial=True (--partial)"


class Scanner:
    """The state of the pass over the lines; `complete` gets the cases, each when it ends.

    Parameters
    ----------
    listing : Listing
        Gets what belongs to no case.
    partial : bool
        Leave out what is damaged instead of raising.
    """

    def __init__(self, listing: Listing, partial: bool):
        self.listing, self.partial = listing, partial
        self.complete: list[Case] = []
        self.count = 0  # cases, complete ones
        self.region = "banner"  # banner, echo, cards, between, page, end
        self.case: Case | None = None
        self.deck: Deck | None = None  # of the case before in the same run
        self.cards: list[Line] = []
        self.page: list[Line] = []
        self.open_run = False  # a run that has begun and not ended
        self.last = 0  # last line that is not blank

    def take(self, lines: list[str]) -> None:
        """Take the next lines of the file."""
        start = self.listing.line_count + 1
        done = 0
        for i in boundary_lines(lines):
            self._plain(start + done, lines[done:i])
            self._turn(start + i, lines[i])
            done = i + 1
        self._plain(start + done, lines[done:])
        self.listing.line_count += len(lines)

    def end(self) -> None:
        """Close what is open at the end of the file."""
        self._close_page()
        self._close_cards()
        self._close_run()
        if not self.listing.runs and not self.count:
            found = "no page of Digital DATCOM" if self.listing.line_count else "an empty file"
            expected = (
                "a print file (unit 6, for006.dat) with its input cards; for an input "
                "deck run the program first"
            )
            raise DamagedListing(self.listing.file, 0, found, expected, self.listing)

    def _plain(self, number: int, lines: list[str]) -> None:
        """Take lines that open and close nothing."""
        if self.region == "page":
            self.page += enumerate(lines, number)
            self.last = next(
                (number + i for i in range(len(lines) - 1, -1, -1) if not lines[i].isspace()),
                self.last,
            )
            return
        for line in lines:
            if not line.isspace():
                self._inside(number, line)
                self.last = number
            number += 1

    def _turn(self, number: int, line: str) -> None:
        """Take a line that may open or close something."""
        kind = anchor_kind(line)
        if kind:
            self._open(kind, number, line)
        elif line[0] == "1" and self.region not in ("banner", "echo", "end"):
            self._control_one(number, line)
        elif not is_progress(line):
            self._inside(number, line)
        self.last = number

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
        if self.page and self.page[0][1].lstrip("1 ").startswith(_FINAL_INPUTS):
            self.page.append((number, line))  # the namelist echo starts every group with a new page
            return
        self._close_page()
        self._close_cards()
        if notes.sort_of(line[1:].strip()) == "message":
            self._remark(number, line)
        elif line.strip() != "1":
            self.region, self.page = "page", [(number, line)]

    def _inside(self, number: int, line: str) -> None:
        dumped = (
            self.region in ("page", "between")
            and ")=" in line[:20]
            and ARRAY_DUMP.match(line) is not None
        )
        if dumped and not (self.page and self._is_dump(self.page[0][1])):
            self._close_page()
            self.region = "page"
        if self.region == "page":
            self.page.append((number, line))
        elif self.region == "cards":
            self._card(number, line)
        elif self.region == "between":
            self._remark(number, line)
        elif self.region == "echo" and _CARD_TAIL.search(line[81:]):
            self.listing.own_messages.append(
                ListingMessage(number, f"{line[81:].strip()}: {line[1:81].strip()}")
            )

    @staticmethod
    def _is_dump(first: str) -> bool:
        """Return whether a page is a dump; card DUMP A,B prints arrays without a heading."""
        return anchor_kind(first) == "dump" or ARRAY_DUMP.match(first) is not None

    def _card(self, number: int, line: str) -> None:
        text = line[1:]
        if _DIMENSIONS in text:
            self._close_cards()
        elif self.cards and self.cards[-1][1].startswith("NEXT CASE"):
            self._close_cards()
            self._remark(number, line)
        elif (
            line[0] == "0"
            or notes.sort_of(text.strip()) == "message"
            or notes.is_continuation(text.strip())
        ):
            if text.strip():
                self._remark(number, line)
        elif (
            self.case
            and self.case.messages
            and self.case.messages[-1] == ListingMessage(self.last, _ERROR_CARD)
        ):
            self._remark(number, line)
        elif text.strip():
            self.cards.append((number, text))

    def _remark(self, number: int, line: str) -> None:
        """Sort a line between the pages: with a word in it, it is a message."""
        text = line[1:].strip()
        if not text.strip("*^") or text.startswith(
            _DIMENSIONS
        ):  # a caret stands below the wrong word of a card
            return
        if not any(word.isalpha() and len(word) > 2 for word in re.split(r"[^A-Za-z]+", text)):
            self.listing.unread.append(number)
        else:
            add_message(
                self.listing.own_messages if self.case is None else self.case.messages, number, text
            )

    def _new_case(self, number: int) -> Case:
        return Case(
            ordinal=self.count + 1,
            run=max(self.listing.runs, 1),
            line=number,
            file=self.listing.file,
        )

    def _close_cards(self) -> None:
        if self.region != "cards" or self.case is None:
            return
        self.region = "between"
        self.case.deck = self.deck = parse_cards(self.cards, self.deck)
        self.case.messages += [
            ListingMessage(line, text, "reader") for line, text in self.case.deck.problems
        ]

    def _close_page(self) -> None:
        if not self.page:
            return
        if self.case is None:
            self.case = self._new_case(self.page[0][0])
        while len(self.page) > 1 and not self.page[-1][1].strip():
            self.page.pop()
        page, messages, empty = read_page(self.page, self.case.ordinal)
        self.page, self.region = [], "between"
        self.case.messages += messages
        self.listing.unread += page.unread
        self._keep(page, empty)

    def _keep(self, page: Page, empty: list[tuple[int, TableLayout]]) -> None:
        """Put a page into its case, without what is damaged on it."""
        assert self.case is not None
        faults = self._faults(page, empty)
        left_out = [item for fault in faults for item in fault[0]]
        if left_out:
            printed = tuple(
                item for item in page.printed if not any(item is other for other in left_out)
            )
            page = replace(page, printed=printed)
        if page.printed or not faults:
            self.case.pages.append(page)
        for _, line, found, expected in faults:
            if not self.partial:
                raise self._damaged(
                    line,
                    found,
                    f"{expected}; the listing is damaged: run the program again, {_TAKE_THE_REST}",
                )
            self.case.messages.append(
                ListingMessage(line, f"{found} instead of {expected}: left out", "reader")
            )

    def _faults(
        self, page: Page, empty: list[tuple[int, TableLayout]]
    ) -> list[tuple[list[Printed], int, str, str]]:
        """Return what is damaged on a page: the items to leave out, a line, what was found, what
        was expected.
        """
        assert self.case is not None
        if page.printed and page.conditions is None and page.kind in _WITH_CONDITIONS:
            found = "no flight-condition line that can be read"
            return [
                (
                    list(page.printed),
                    page.first,
                    found,
                    "a line of numbers below the units row of the page",
                )
            ]
        faults: list[tuple[list[Printed], int, str, str]] = []
        for table in page.tables:
            if table.layout.stream:
                miscount = _miscounted_stream(table, self.case.deck)
            else:
                miscount = self._miscount(page, table.layout, len(table.rows))
            if miscount:
                faults.append(([table], table.lines[-1], *miscount))
        faults += [
            ([], line, *miscount)
            for line, layout in empty
            if (miscount := self._miscount(page, layout, 0))
        ]
        return sorted(faults, key=lambda fault: fault[1])

    def _miscount(self, page: Page, layout: TableLayout, count: int) -> tuple[str, str] | None:
        """Return how many rows a table has and how many the input cards specify, None where they
        agree.
        """
        assert self.case is not None
        wanted = self.case.deck.count(*layout.rows) if layout.rows else None
        if (
            layout.rows is None
            or wanted is None
            or count == wanted
            or (count < wanted and self._ends_early(page, layout))
        ):
            return None
        return (
            f"{count} rows in the {layout.name} table",
            f"{wanted} rows ({layout.rows[1]} of the input cards)",
        )

    def _ends_early(self, page: Page, layout: TableLayout) -> bool:
        assert self.case is not None
        if layout.stops:
            return any(layout.stops in note.text for note in page.notes)
        pages = [page] if page.kind == "static" else [page, *self.case.pages]
        return any("ANALYSIS TERMINATED" in note.text for other in pages for note in other.notes)

    def _damaged(self, line: int, found: str, expected: str) -> DamagedListing:
        """Return the error for a fault, with what is complete of the open case."""
        listing = Listing(
            self.listing.file,
            self.listing.runs,
            self.listing.line_count,
            self.listing.unread,
            self.listing.own_messages,
        )
        if self.case is not None:
            listing.cases.append(self.case)
        return DamagedListing(self.listing.file, line, found, expected, listing)

    def _close_case(self) -> None:
        self._close_cards()
        case, self.case = self.case, None
        if case is None or not (
            case.pages or case.messages or case.deck.cards or case.deck.namelists
        ):
            return
        self.count += 1
        self.complete.append(case)

    def _close_run(self) -> None:
        """Judge a run that ends without END OF JOB: stopped by the program, or cut."""
        stopped = self.case is not None and any(
            "EXECUTION TERMINATING" in message.text for message in self.case.messages
        )
        if self.open_run and not stopped:
            text = self._drop_cut_page()
            if not self.partial:
                expected = (
                    f"the line END OF JOB.; the listing is cut: run it again, {_TAKE_THE_REST}"
                )
                raise self._damaged(self.last, "the end of the print", expected)
            self.listing.own_messages.append(ListingMessage(self.last, text, "reader"))
        self._close_case()
        self.open_run = False

    def _drop_cut_page(self) -> str:
        """Leave out what may be cut, the last item when it reaches the last line, and the page when
        none stays; report it.
        """
        text = "the listing is cut: no END OF JOB"
        if self.case is None or not self.case.pages or self.case.pages[-1].last < self.last:
            return text
        page = self.case.pages.pop()
        printed = page.printed
        if printed and printed[-1].lines[-1] == self.last:
            printed = printed[:-1]
        if printed:
            self.case.pages.append(replace(page, printed=printed))
        return f"{text}; the last table of the page at lines {page.first}-{page.last} is left out"


def _miscounted_stream(table: PrintedTable, deck: Deck) -> tuple[str, str] | None:
    """Return found and expected of a table printed as one stream of values, None when it is whole."""
    counts = [
        count for variable in table.layout.stream if (count := deck.count(*variable)) is not None
    ]
    printed = table.flags.ravel() != BLANK
    wanted, found = math.prod(counts), int(printed.sum())
    if len(counts) < len(table.layout.stream) or (found == wanted and printed[:found].all()):
        return None
    product = " x ".join(variable for _, variable in table.layout.stream)
    return (
        f"{found} values in the {table.name} table",
        f"{wanted} values ({product} of the input cards)",
    )
