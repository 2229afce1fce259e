"""Reading an input deck (unit 5), plain or with the additions of DATCOM+.

DATCOM+ decks hold comments (``*`` or ``#`` in column 1, ``!`` to the end of the line), blank lines,
tabs and long lines.  A pre-processor removes them before the program runs.  They are accepted here
and reported, because the program alone does not accept them.  The pre-processor also repeats DAMP
and PART in the cases that SAVE continues, which the program itself does not.  This reader does the
same in a deck with comments of DATCOM+ or the suffix ``.dcm``.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from datcom_io.decks.cards import ERROR, NOTE, WARNING, Card, DeckFinding, NamelistAssignment
from datcom_io.decks.deck import Deck, assignments_of, parse_cards
from datcom_io.decks.namelists import CARD_COLUMNS, CASEID_COLUMNS, VARIABLES, format_namelist_value
from flightmech.errors import ParseError, SchemaError
from flightmech.short_text import ShortText
from flightmech.support.atomic_write import write_text
from flightmech.support.file_kinds import MISSILE_FILE, file_kind
from flightmech.support.input_files import marked_encoding, read_bytes, with_line_feeds

_REPEATED_CARDS = ("DAMP", "PART")  # by DATCOM+, in cases that SAVE continues
_DECK = "an input deck (unit 5): namelists $NAME ... $ and control cards"


@dataclass(frozen=True)
class DeckFile(ShortText):
    """An input deck: its cases in the order of the run.

    Attributes
    ----------
    file : str
        Name of the file, or ``"<text>"``.
    cases : tuple of Deck
    comments : tuple of (int, str)
        Line number and text of the comments.
    findings : tuple of DeckFinding
        Text of the file that the program would not read: comments, tabs, blank and long lines.
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
        One `Deck` per case.  ``deck.items`` are the cards as written; ``deck.namelists`` and
        ``deck.cards`` include those that SAVE replays.  The last NEXT CASE may be missing.

    Raises
    ------
    ParseError
        The file has no card, or is of another kind, such as a listing.

    Notes
    -----
    The reader accepts more than the program: it reads lower case, ``$`` outside column 2 or a
    missing end of a namelist as they are meant, and `check_deck` reports them.

    Examples
    --------
    >>> deck = read_deck(["* A COMMENT", " $FLTCON NMACH=1.0,MACH(1)=0.3$", "CASEID ONE"])
    >>> deck[0].caseid, deck[0].values("FLTCON", "MACH"), deck.comments
    ('ONE', [0.3], ((1, 'A COMMENT'),))
    """
    file, kind = "<text>", "a text"
    if isinstance(source, str | os.PathLike):
        file, kind = os.path.basename(os.fspath(source)), file_kind(source)
    # The content decides: a listing echoes the whole deck too.
    is_readable = kind.startswith(("an input deck", "a text", "a file", "an empty"))
    if kind == MISSILE_FILE or not is_readable:
        raise ParseError(file, 0, kind, _DECK)
    text = _DeckText()
    cases: list[Deck] = []
    cards: list[tuple[int, str]] = []
    before: Deck | None = None
    for number, line in enumerate(_read_lines(source), 1):
        card = text.read_card(number, line)
        if not card:
            continue
        cards.append((number, card))
        if card.lstrip().upper().startswith("NEXT CASE"):
            before = parse_cards(cards, before)
            cases.append(before)
            cards = []
    if cards:
        _add_last_case(cases, cards, text)
    if not cases:
        problem = "an empty file"
        if text.line_count:
            problem = "no card"
        raise ParseError(file, 0, problem, _DECK)
    if text.comments or file.lower().endswith(".dcm"):
        cases = _repeat_cards(cases, text)
    return DeckFile(file, tuple(cases), tuple(text.comments), tuple(text.findings))


def _repeat_cards(cases: list[Deck], text: _DeckText) -> list[Deck]:
    """Return the cases with DAMP and PART in every case that SAVE continues from one with them."""
    # A case with repeated cards passes them on to the next one.
    repeated = cases[:1]
    for case in cases[1:]:
        before = repeated[-1]
        cards = []
        if before.has("SAVE"):
            for name in _REPEATED_CARDS:
                if before.has(name) and not case.has(name):
                    cards.append(Card(case.line, name, ""))
        if cards:
            names = " and ".join(card.name for card in cards)
            text.report(
                case.line,
                NOTE,
                f"{names} of the case before: DATCOM+ repeats it after SAVE, the program "
                f"does not; write_deck writes it",
            )
        items, all_cards = (*cards, *case.items), (*case.cards, *cards)
        repeated.append(replace(case, items=items, cards=all_cards))
    return repeated


def _read_lines(source: str | os.PathLike[str] | Iterable[str]) -> Iterator[str]:
    """Yield the lines without their ends.

    Bytes are read as their byte-order mark states, else as ISO 8859-1, in which any byte of a
    CASEID survives.
    """
    if isinstance(source, str | os.PathLike):
        raw = read_bytes(source, _DECK)
        encoding, skip = marked_encoding(raw)
        if encoding in ("", "utf-8"):
            encoding = "latin-1"
        text = raw[skip:].decode(encoding, "replace")
        if "\n" not in text:
            text = with_line_feeds(text)
        source = text.removesuffix("\n").split("\n")
    for line in source:
        yield str(line).rstrip("\r\n\x1a ")


def _add_last_case(cases: list[Deck], cards: list[tuple[int, str]], text: _DeckText) -> None:
    """Add the case after the last NEXT CASE; without a namelist the program does not run it."""
    before = None
    if cases:
        before = cases[-1]
    last = parse_cards(cards, before)
    if last.namelists or not cases:
        cases.append(last)
    else:
        text.report(
            cards[0][0],
            WARNING,
            "cards after the last NEXT CASE without a namelist: the program does not run them",
        )


class _DeckText:
    """The deck as text: additions of DATCOM+ are removed and reported."""

    def __init__(self) -> None:
        self.comments: list[tuple[int, str]] = []
        self.findings: list[DeckFinding] = []
        self.line_count = 0

    def report(self, line: int, severity: str, text: str) -> None:
        self.findings.append(DeckFinding(line, severity, text))

    def read_card(self, number: int, line: str) -> str:
        """Return the card of a line; empty for comments and blank lines."""
        self.line_count = number
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
            return self._add_comment(number, line[1:])
        is_caseid = line[:6].upper() == "CASEID"
        # A CASEID may hold any character.
        if not is_caseid:
            line, separator, comment = line.partition("!")
            if separator:
                self._add_comment(number, comment)
        if line[CARD_COLUMNS:].strip() and not is_caseid:
            text = (
                f"{len(line.rstrip())} columns: the program reads {CARD_COLUMNS}, the rest is "
                f"lost; break the line after a comma"
            )
            self.report(number, ERROR, text)
        return line.rstrip()

    def _add_comment(self, number: int, text: str) -> str:
        self.comments.append((number, text.strip()))
        self.report(
            number,
            ERROR,
            "comment: only the pre-processor of DATCOM+ removes it, the program does not "
            "run the case; use write_deck",
        )
        return ""


_NAME = re.compile(r"[A-Z][A-Z0-9]{0,9}")
_INDENT = "   "  # of the lines that continue a namelist


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
        Write every case complete, without SAVE.  Otherwise the cards are written as they were
        given, SAVE included.

    Raises
    ------
    SchemaError
        The deck holds a name or a text that does not fit on a card, or a number that is not
        finite.

    Notes
    -----
    Comments, illegal cards and unreadable text are left out.  Numbers have nine digits, more than
    the single precision of the program can distinguish.  `read_deck` of the file is equal in
    meaning (`Deck.meaning`).
    """
    text = deck_text(deck, resolved=resolved)
    write_text(path, text, encoding="latin-1")


def deck_text(deck: DeckFile | Deck | Iterable[Deck], *, resolved: bool = False) -> str:
    """Return the text that `write_deck` writes."""
    if isinstance(deck, Deck):
        cases = [deck]
    else:
        cases = list(deck)
    problems: list[str] = []
    lines: list[str] = []
    for number, case in enumerate(cases, 1):
        problems += [f"case {number}: {problem}" for problem in _find_problems(case)]
    if problems:
        raise SchemaError("input deck", problems)
    for case in cases:
        if resolved:
            lines += _resolved_cards(case)
        else:
            lines += _cards_as_given(case)
    return "".join(f"{line}\n" for line in lines)


def _find_problems(case: Deck) -> Iterator[str]:
    """Yield everything in a case that no card can hold."""
    # A card holds 80 columns of single-byte characters.
    for card in case.cards:
        if not card.text.isprintable() or any(ord(letter) > 255 for letter in card.text):
            yield (
                f"{card.name} holds {card.text!r}; a card holds printable characters of ISO 8859-1"
            )
        most = CARD_COLUMNS - len(card.name) - 1
        if card.name == "CASEID":
            most = CASEID_COLUMNS
        if len(card.text) > most:
            yield f"{card.name} holds {len(card.text)} characters; they do not fit on one card"
    for name, group in case.namelists.items():
        for word in (name, *group):
            if not _NAME.fullmatch(word):
                yield f"${name}: {word!r} is not a name; upper case letters and digits, at most 10"
        for variable, values in group.items():
            if any(isinstance(x, float) and not math.isfinite(x) for x in values):
                yield (
                    f"${name}: {variable} holds a number that is not finite; leave the place empty "
                    f"(None) when it is not given"
                )


def _cards_as_given(case: Deck) -> Iterator[str]:
    """Yield the cards as they were given."""
    for item in case.items:
        if isinstance(item, Card):
            yield _card_text(item)
        else:
            yield from _namelist_lines(item.name, item.assignments)
    last = case.items[-1:]
    has_end = bool(last) and isinstance(last[0], Card) and last[0].name == "NEXT"
    # Without a card behind SAVE the program ends; NEXT CASE would run the saved case once more.
    if not has_end and not case.has("SAVE"):
        yield "NEXT CASE"


# Cards that a complete case states in its own way.
_RESOLVED = ("DIM", "DERIV", "SAVE", "NEXT", "CASEID", "NACA")


def _resolved_cards(case: Deck) -> Iterator[str]:
    """Yield cards that make the case complete by itself."""
    yield f"DIM {case.dim}"
    yield f"DERIV {case.deriv}"
    for card in case.cards:
        if card.name not in _RESOLVED:
            yield _card_text(card)
    for name, group in case.namelists.items():
        yield from _namelist_lines(name, assignments_of(group))
    for surface, designation in case.sections.items():
        yield f"NACA {surface} {designation}".rstrip()
    if case.caseid:
        yield f"CASEID {case.caseid}"
    yield "NEXT CASE"


def _card_text(card: Card) -> str:
    return f"{card.name} {card.text}".rstrip()


def _assignment_parts(name: str, assignment: NamelistAssignment) -> list[str]:
    """Return the parts that must not be broken: the variable with its first value, then values."""
    # An array shows its index, even for one value.
    first, *others = map(format_namelist_value, assignment.values)
    size = abs(VARIABLES.get(name, {}).get(assignment.variable, 1))
    is_array = size > 1 or assignment.start > 1 or bool(others)
    target = assignment.variable
    if is_array:
        target = f"{assignment.variable}({assignment.start})"
    return [f"{target}={first}", *others]


def _namelist_lines(name: str, assignments: Iterable[NamelistAssignment]) -> Iterator[str]:
    """Yield the cards of a namelist, each within the columns of a card."""
    parts: list[str] = []
    for assignment in assignments:
        parts += _assignment_parts(name, assignment)
    line = f" ${name}"
    separator = " "
    for part in parts:
        # One column is left for the comma, or for the closing $.
        if len(line) + len(separator) + len(part) + 1 > CARD_COLUMNS:
            yield line
            line, separator = _INDENT, ""
        line += f"{separator}{part},"
        separator = ""
    if line.endswith(","):
        yield line.removesuffix(",") + "$"
    else:
        yield f"{line} $"
