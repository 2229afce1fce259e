"""Writing an input deck as the program reads it: upper case, 80 columns, ``$`` in column 2, breaks between values only."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator

from flightmech.errors import SchemaError
from flightmech.support.atomic_write import write_text

from .cards import Assignment, Card, Item
from .deck import Deck, pieces
from .file import DeckFile
from .names import CARD_COLUMNS, CASEID_COLUMNS, VARIABLES
from .values import value_text

_NAME = re.compile(r"[A-Z][A-Z0-9]{0,9}")
_CONTINUED = "   "


def write_deck(deck: DeckFile | Deck | Iterable[Deck], path: str | os.PathLike[str], *, resolved: bool = False) -> None:
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
        The deck holds what no card can hold: a name or a text that does not fit, a number that is not finite.

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
    problems = [f"case {number}: {problem}" for number, case in enumerate(cases, 1) for problem in _problems(case)]
    if problems:
        raise SchemaError("input deck", problems)
    lines = [line for case in cases for line in (_resolved_case(case) if resolved else _case(case))]
    return "".join(f"{line}\n" for line in lines)


def _problems(case: Deck) -> Iterator[str]:
    for card in case.cards:
        if not card.text.isprintable() or any(ord(letter) > 255 for letter in card.text):
            yield f"{card.name} holds {card.text!r}; a card holds printable characters of ISO 8859-1"
        if len(card.text) > (CASEID_COLUMNS if card.name == "CASEID" else CARD_COLUMNS - len(card.name) - 1):
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
    # without a card behind SAVE the program ends; with NEXT CASE it would run the saved case once more
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
        yield from _namelist(name, (word for piece in pieces(group) for word in _words(name, piece)))
    for surface, designation in case.sections.items():
        yield f"NACA {surface} {designation}".rstrip()
    if case.caseid:
        yield f"CASEID {case.caseid}"
    yield "NEXT CASE"


def _item(item: Item) -> Iterator[str]:
    if isinstance(item, Card):
        yield _card(item)
    else:
        yield from _namelist(item.name, (word for assignment in item.assignments for word in _words(item.name, assignment)))


def _card(card: Card) -> str:
    return f"{card.name} {card.text}".rstrip()


def _words(name: str, assignment: Assignment) -> Iterator[str]:
    """Yield what may stand on one card: the variable with its first value, then value by value."""
    first, *more = map(value_text, assignment.values)
    is_array = abs(VARIABLES.get(name, {}).get(assignment.variable, 1)) > 1 or assignment.start > 1 or bool(more)
    yield f"{assignment.variable}({assignment.start})={first}" if is_array else f"{assignment.variable}={first}"
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
