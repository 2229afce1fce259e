"""Reading an input deck (unit 5), plain or with the additions of DATCOM+.

DATCOM+ decks hold comments (``*`` or ``#`` in column 1, ``!`` to the end of the line), blank lines,
tabs and long lines, which a pre-processor of theirs takes away before the program runs.  They are
accepted here and reported: the program alone stumbles over them. The pre-processor also repeats
DAMP and PART in the cases that SAVE continues, which the program itself does not: so does this
reader in a deck with comments of DATCOM+ or the suffix ``.dcm``.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from datcom_io.decks.cards import ERROR, NOTE, WARNING, Card, DeckFinding, Item, NamelistAssignment
from datcom_io.decks.deck import Deck, assignments_of, parse_cards
from datcom_io.decks.namelists import CARD_COLUMNS, CASEID_COLUMNS, VARIABLES, format_namelist_value
from flightmech.errors import ParseError, SchemaError
from flightmech.support.atomic_write import write_text
from flightmech.support.input_files import file_kind, marked_encoding, read_bytes, with_line_feeds

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
        One `Deck` per case: ``deck.items`` are the cards as written, ``deck.namelists`` and
        ``deck.cards`` what the program sees with those that SAVE replays.  The last NEXT CASE may
        be missing.

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
    file = (
        os.path.basename(os.fspath(source)) if isinstance(source, str | os.PathLike) else "<text>"
    )
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
        cards = [
            Card(case.line, word, "")
            for word in _KEPT
            if kept[-1].has("SAVE") and kept[-1].has(word) and not case.has(word)
        ]
        if cards:
            words = " and ".join(card.name for card in cards)
            text.report(
                case.line,
                NOTE,
                f"{words} of the case before: DATCOM+ repeats it after SAVE, the program "
                f"does not; write_deck writes it",
            )
        kept.append(replace(case, items=(*cards, *case.items), cards=(*case.cards, *cards)))
    return kept


def _lines(source: str | os.PathLike[str] | Iterable[str]) -> Iterator[str]:
    """Yield the lines without their ends; bytes are read as ISO 8859-1, so that any byte in a
    CASEID survives, or as their mark states.
    """
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
        text.report(
            cards[0][0],
            WARNING,
            "cards after the last NEXT CASE without a namelist: the program does not run them",
        )


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
            self.report(
                number,
                WARNING,
                "blank line: the program flags it, and stops at two of them inside a "
                "namelist; take it out",
            )
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
            number,
            ERROR,
            "comment: only the pre-processor of DATCOM+ takes it away, the program does not "
            "run the case; use write_deck",
        )
        return ""

    def _too_long(self, number: int, line: str, is_caseid: bool) -> None:
        if not is_caseid:
            text = (
                f"{len(line.rstrip())} columns: the program reads {CARD_COLUMNS}, the rest is "
                f"lost; break the line after a comma"
            )
            self.report(number, ERROR, text)


_NAME = re.compile(r"[A-Z][A-Z0-9]{0,9}")
_CONTINUED = "   "


def write_deck(
    deck: DeckFile | Deck | Iterable[Deck], path: str | os.PathLike[str], *, resolved: bool = False
) -> None:
    """Write an input deck atomically (completely or not at all).

    Parameters
    ----------
    deck : DeckFile, Deck, or iterable of Deck
        One case or several, in the order of the run.
    path : path
        File to write; its folder must exist.
    resolved : bool
        Write every case complete, without SAVE; else the cards as they were given, SAVE included.

    Raises
    ------
    SchemaError
        The deck holds what no card can hold: a name or a text that does not fit, a number that is
        not finite.

    Notes
    -----
    Comments, illegal cards and what could not be read are left out.  Numbers have nine digits, more than the program's single
    precision can distinguish.  `read_deck` of the file is equal in meaning (`Deck.meaning`).
    """
    text = deck_text(deck, resolved=resolved)
    write_text(path, text, encoding="latin-1")


def deck_text(deck: DeckFile | Deck | Iterable[Deck], *, resolved: bool = False) -> str:
    """Return the text that `write_deck` writes."""
    cases = [deck] if isinstance(deck, Deck) else list(deck)
    problems = [
        f"case {number}: {problem}"
        for number, case in enumerate(cases, 1)
        for problem in _problems(case)
    ]
    if problems:
        raise SchemaError("input deck", problems)
    lines = [line for case in cases for line in (_resolved_case(case) if resolved else _case(case))]
    return "".join(f"{line}\n" for line in lines)


def _problems(case: Deck) -> Iterator[str]:
    for card in case.cards:
        if not card.text.isprintable() or any(ord(letter) > 255 for letter in card.text):
            yield f"{card.name} holds {card.text!r}; a card holds printable characters of ISO 8859-1"
        if len(card.text) > (
            CASEID_COLUMNS if card.name == "CASEID" else CARD_COLUMNS - len(card.name) - 1
        ):
            yield f"{card.name} holds {len(card.text)} characters; they do not fit on one card"
    for name, group in case.namelists.items():
        for word in (name, *group):
            if not _NAME.fullmatch(word):
                yield f"${name}: {word!r} is no name; upper case letters and digits, at most 10"
        for variable, values in group.items():
            if any(isinstance(x, float) and not math.isfinite(x) for x in values):
                yield f"${name}: {variable} holds a number that is not finite; leave the place empty (None) when it is not given"


def _case(case: Deck) -> Iterator[str]:
    """Yield the cards as they were given."""
    for item in case.items:
        yield from _item(item)
    ends = case.items and isinstance(case.items[-1], Card) and case.items[-1].name == "NEXT"
    # without a card behind SAVE the program ends; with NEXT CASE it would run the saved case once
    # more
    if not ends and not case.has("SAVE"):
        yield "NEXT CASE"


def _resolved_case(case: Deck) -> Iterator[str]:
    """Yield cards that make the case complete by itself."""
    yield f"DIM {case.dim}"
    yield f"DERIV {case.deriv}"
    left_out = ("DIM", "DERIV", "SAVE", "NEXT", "CASEID", "NACA")
    for card in case.cards:
        if card.name not in left_out:
            yield _card(card)
    for name, group in case.namelists.items():
        yield from _namelist(
            name, (word for piece in assignments_of(group) for word in _words(name, piece))
        )
    for surface, designation in case.sections.items():
        yield f"NACA {surface} {designation}".rstrip()
    if case.caseid:
        yield f"CASEID {case.caseid}"
    yield "NEXT CASE"


def _item(item: Item) -> Iterator[str]:
    if isinstance(item, Card):
        yield _card(item)
    else:
        yield from _namelist(
            item.name,
            (word for assignment in item.assignments for word in _words(item.name, assignment)),
        )


def _card(card: Card) -> str:
    return f"{card.name} {card.text}".rstrip()


def _words(name: str, assignment: NamelistAssignment) -> Iterator[str]:
    """Yield what may stand on one card: the variable with its first value, then value by value."""
    first, *more = map(format_namelist_value, assignment.values)
    is_array = (
        abs(VARIABLES.get(name, {}).get(assignment.variable, 1)) > 1
        or assignment.start > 1
        or bool(more)
    )
    yield (
        f"{assignment.variable}({assignment.start})={first}"
        if is_array
        else f"{assignment.variable}={first}"
    )
    yield from more


def _namelist(name: str, words: Iterable[str]) -> Iterator[str]:
    line = f" ${name}"
    blank = " "
    for word in words:
        if len(line) + len(blank) + len(word) + 1 > CARD_COLUMNS:
            yield line
            line, blank = _CONTINUED, ""
        line += f"{blank}{word},"
        blank = ""
    yield (line.removesuffix(",") if line.endswith(",") else f"{line} ") + "$"
