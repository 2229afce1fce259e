"""What the readers promise about any input: they end and raise nothing but `ParseError`.

That of listings loses no page before the fault; a deck read and written again is equal in meaning.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NamedTuple

import pandas as pd

import datcom_io
from datcom_io.decks.deck_file import deck_text
from flightmech.errors import AeromatchError, ParseError, SchemaError

Lines = list[str]

# Far above the time of any honest reading (40 us a line and 0.3 us a character, seen), far below
# that of a quadratic one.
_SECONDS, _PER_LINE, _PER_CHARACTER = 10.0, 5e-3, 5e-5


@contextmanager
def bounded(lines: Lines) -> Iterator[None]:
    """Raise TimeoutError when the work takes longer than a time linear in the input."""

    def stop(*_):
        raise TimeoutError(f"{len(lines)} lines, {size} characters: not read within {limit:.0f} s")

    size = sum(map(len, lines))
    limit = _SECONDS + _PER_LINE * len(lines) + _PER_CHARACTER * size
    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


class Sound(NamedTuple):
    """A listing before it is harmed: its lines, its cells, and the lines that end a page."""

    lines: Lines
    cells: pd.DataFrame
    ends: list[int]

    def whole_before(self, harmed: Lines) -> int:
        """Return the number of the line up to which all pages are the same and ended before the
        first harmed line.
        """
        same = next(
            (k for k, (a, b) in enumerate(zip(self.lines, harmed)) if a != b),
            min(len(self.lines), len(harmed)),
        )
        return max((end for end in self.ends if end <= same), default=0)


def sound(lines: Lines) -> Sound:
    """Read a listing that is as the program printed it."""
    listing = datcom_io.read(lines)
    ends = [page.first for page in listing.pages] + [case.line for case in listing]
    ends += [number for number, line in enumerate(lines, 1) if "END OF JOB" in line]
    return Sound(lines, listing.cells(), sorted(ends))


def use(listing: datcom_io.Listing) -> pd.DataFrame:
    """Make everything of a listing that can be made; return its cells."""
    cells = listing.cells()
    for case in listing:
        for name in sorted({item.name for page in case.pages for item in page.printed}):
            case.block(name)
        allow(case.to_datatree)
    str(listing.messages)
    return cells


def allow(call, *arguments, **options):
    """Return what a call returns, None when it raises ParseError; every other exception comes
    out.
    """
    try:
        return call(*arguments, **options)
    except ParseError:
        return None


class Found(NamedTuple):
    """Cells of one way of reading, and whether it ended without an error."""

    cells: pd.DataFrame
    whole: bool


def read(lines: Lines, partial: bool) -> Found | None:
    """Return what `read` returns or what its error holds; None when it holds nothing."""
    try:
        listing, whole = datcom_io.read(lines, partial=partial), True
    except ParseError as error:
        listing, whole = getattr(error, "listing", None), False
    return None if listing is None else Found(use(listing), whole)


def iterate(lines: Lines) -> Found | None:
    """Return the cells of the cases one by one, with those that the error holds."""
    found, whole = [], True
    try:
        for case in datcom_io.iterate(lines):
            found.append(case.cells())
    except ParseError as error:
        whole = False
        if listing := getattr(error, "listing", None):
            found.append(listing.cells())
    return Found(pd.concat(found, ignore_index=True), whole) if found else None


def read_in_every_way(lines: Lines) -> dict[str, Found | None]:
    """Read and use everything; a whole listing is the same in every way."""
    found = {
        "read": read(lines, False),
        "read with partial=True": read(lines, True),
        "iterate": iterate(lines),
    }
    strict, part, cases = found.values()
    if strict and strict.whole:
        assert part
        assert part.whole
        same_cells(part.cells, strict.cells, "read with partial=True")
        assert not len(strict.cells) or (cases and cases.whole)
        if cases:
            same_cells(cases.cells, strict.cells, "iterate")
    else:
        assert cases is None or not cases.whole
    return found


def keeps_promises(lines: Lines, before: Sound | None = None) -> None:
    """Read lines in every way; `before` is the listing that was harmed."""
    with bounded(lines):
        found = read_in_every_way(lines)
    end = before.whole_before(lines) if before else 0
    wanted = before.cells[before.cells["line"] < end] if before else ()
    if not len(wanted):
        return
    for how, part in found.items():
        assert part is not None, f"{how} loses all {len(wanted)} cells before line {end}"
        same_cells(part.cells[part.cells["line"] < end], wanted, how)


def same_cells(cells: pd.DataFrame, wanted: pd.DataFrame, how: str) -> None:
    for column in wanted.columns:
        # an axis that only a lost page has is not a column
        a, b = (
            frame.reindex(columns=[column])[column].astype(object).fillna("").tolist()
            for frame in (cells, wanted)
        )
        assert a == b, f"{how}: other cells than before in column {column!r}"


def keeps_deck_promises(lines: Lines) -> None:
    """Read lines as an input deck, check and split it, write it and read it again: equal in
    meaning, or one clear error.
    """
    with bounded(lines):
        read_and_write_deck(lines)


def read_and_write_deck(lines: Lines) -> None:
    deck = allow(datcom_io.read_deck, lines)
    if deck is None:
        return
    datcom_io.check_deck(deck)
    with suppress(AeromatchError):
        datcom_io.split_deck(deck)
    for resolved in (False, True):
        with suppress(SchemaError):
            text = deck_text(deck, resolved=resolved)
            again = datcom_io.read_deck(text.split("\n"))
            assert [case.meaning() for case in again] == [case.meaning() for case in deck]
            assert deck_text(again, resolved=resolved) == text
