"""Reading an input deck (unit 5), plain or with the additions of DATCOM+.

DATCOM+ decks hold comments (``*`` or ``#`` in column 1, ``!`` to the end of the line), blank lines, tabs and long lines, which a
pre-processor of theirs takes away before the program runs.  They are accepted here and reported: the program alone stumbles over them.
The pre-processor also repeats DAMP and PART in the cases that SAVE continues, which the program itself does not: so does this reader in
a deck with comments of DATCOM+ or the suffix ``.dcm``.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from flightmech.errors import ParseError
from flightmech.support.file_kinds import file_kind
from flightmech.support.input_files.text import marked_encoding, read_bytes, with_line_feeds

from .cards import ERROR, NOTE, WARNING, Card, DeckFinding
from .deck import Deck, parse_cards
from .names import CARD_COLUMNS

_KEPT = ("DAMP", "PART")  # control cards that DATCOM+ repeats
_DECK = "an input deck (unit 5): namelists $NAME ... $ and control cards"


@dataclass(frozen=True)
class DeckFile:
    """An input deck: its cases in the order of the run.

    Attributes
    ----------
    file : str
        Name of the file, or ``"<text>"``.
    cases : tuple of Deck
    comments : tuple of (int, str)
        Line number and text of the comments.
    findings : tuple of DeckFinding
        What the program would not read in the file as text: comments, tabs, blank and long lines.
    """

    file: str
    cases: tuple[Deck, ...]
    comments: tuple[tuple[int, str], ...] = ()
    findings: tuple[DeckFinding, ...] = ()

    def __len__(self) -> int:
        return len(self.cases)

    def __iter__(self) -> Iterator[Deck]:
        return iter(self.cases)

    def __getitem__(self, number: int) -> Deck:
        return self.cases[number]


def read_deck(source: str | os.PathLike[str] | Iterable[str]) -> DeckFile:
    """Read an input deck of Digital DATCOM or DATCOM+.

    Parameters
    ----------
    source : path, or iterable of str
        File, or its lines.  Line ends LF, CRLF or CR; of UTF-16 with a byte-order mark.

    Returns
    -------
    DeckFile
        One `Deck` per case: ``deck.items`` are the cards as written, ``deck.namelists`` and ``deck.cards`` what the program sees
        with those that SAVE replays.  The last NEXT CASE may be missing.

    Raises
    ------
    ParseError
        There is no card in it, or it is a file of another kind, such as a listing.

    Notes
    -----
    The reader is more patient than the program: lower case, ``$`` outside column 2 or a missing end of a namelist are taken as
    they are meant, and reported by `check_deck`.

    Examples
    --------
    >>> deck = read_deck(["* A COMMENT", " $FLTCON NMACH=1.0,MACH(1)=0.3$", "CASEID ONE"])
    >>> deck[0].caseid, deck[0].values("FLTCON", "MACH"), deck.comments
    ('ONE', [0.3], ((1, 'A COMMENT'),))
    """
    file = os.path.basename(os.fspath(source)) if isinstance(source, str | os.PathLike) else "<text>"
    kind = file_kind(source) if isinstance(source, str | os.PathLike) else "a text"
    if not kind.startswith(("an input deck", "a text", "a file", "an empty")):
        raise ParseError(file, 0, kind, _DECK)
    text = _Text()
    cases: list[Deck] = []
    cards: list[tuple[int, str]] = []
    for number, line in enumerate(_lines(source), 1):
        card = text.card(number, line)
        if not card:
            continue
        cards.append((number, card))
        if card.lstrip().upper().startswith("NEXT CASE"):
            cases.append(parse_cards(cards, cases[-1] if cases else None))
            cards = []
    if cards:
        _add_last(cases, cards, text)
    if not cases:
        raise ParseError(file, 0, "no card" if text.lines else "an empty file", _DECK)
    if text.comments or file.lower().endswith(".dcm"):
        cases = _with_cards_kept(cases, text)
    return DeckFile(file, tuple(cases), tuple(text.comments), tuple(text.findings))


def _with_cards_kept(cases: list[Deck], text: _Text) -> list[Deck]:
    """Return the cases with DAMP and PART in every case that SAVE continues from one that has them."""
    kept = cases[:1]
    for case in cases[1:]:
        cards = [Card(case.line, word, "") for word in _KEPT if kept[-1].has("SAVE") and kept[-1].has(word) and not case.has(word)]
        if cards:
            words = " and ".join(card.name for card in cards)
            text.report(
                case.line, NOTE, f"{words} of the case before: DATCOM+ repeats it after SAVE, the program does not; write_deck writes it"
            )
        kept.append(replace(case, items=(*cards, *case.items), cards=(*case.cards, *cards)))
    return kept


def _lines(source: str | os.PathLike[str] | Iterable[str]) -> Iterator[str]:
    """Yield the lines without their ends; bytes are read as ISO 8859-1, so that any byte in a CASEID survives, or as their mark states."""
    if isinstance(source, str | os.PathLike):
        raw = read_bytes(source, _DECK)
        encoding, skip = marked_encoding(raw)
        text = raw[skip:].decode("latin-1" if encoding in ("", "utf-8") else encoding, "replace")
        source = (text if "\n" in text else with_line_feeds(text)).removesuffix("\n").split("\n")
    for line in source:
        yield str(line).rstrip("\r\n\x1a ")


def _add_last(cases: list[Deck], cards: list[tuple[int, str]], text: _Text) -> None:
    """Add the case after the last NEXT CASE; without a namelist the program does not run it."""
    last = parse_cards(cards, cases[-1] if cases else None)
    if last.namelists or not cases:
        cases.append(last)
    else:
        text.report(cards[0][0], WARNING, "cards after the last NEXT CASE without a namelist: the program does not run them")


class _Text:
    """The deck as text: what DATCOM+ adds to it is taken away and reported."""

    def __init__(self) -> None:
        self.comments: list[tuple[int, str]] = []
        self.findings: list[DeckFinding] = []
        self.lines = 0

    def report(self, line: int, severity: str, text: str) -> None:
        self.findings.append(DeckFinding(line, severity, text))

    def card(self, number: int, line: str) -> str:
        """Return the card of a line; empty for comments and blank lines."""
        self.lines = number
        if "\t" in line:
            self.report(number, ERROR, "tab: the program reads columns; write blanks")
            line = line.replace("\t", " ")
        if not line.strip():
            self.report(number, WARNING, "blank line: the program flags it, and stops at two of them inside a namelist; take it out")
            return ""
        if line[0] in "*#":
            return self._comment(number, line[1:])
        is_caseid = line[:6].upper() == "CASEID"
        if not is_caseid:  # a CASEID may hold any character
            line, separator, comment = line.partition("!")
            if separator:
                self._comment(number, comment)
        if line[CARD_COLUMNS:].strip():
            self._too_long(number, line, is_caseid)
        return line.rstrip()

    def _comment(self, number: int, text: str) -> str:
        self.comments.append((number, text.strip()))
        self.report(
            number, ERROR, "comment: only the pre-processor of DATCOM+ takes it away, the program does not run the case; use write_deck"
        )
        return ""

    def _too_long(self, number: int, line: str, is_caseid: bool) -> None:
        if not is_caseid:
            text = f"{len(line.rstrip())} columns: the program reads {CARD_COLUMNS}, the rest is lost; break the line after a comma"
            self.report(number, ERROR, text)
