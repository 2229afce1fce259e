"""Rules of the cards: names, types and sizes that the program's own reader knows.  A fault here
stops the whole run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from difflib import get_close_matches

from datcom_io.decks.cards import ERROR, WARNING, Card, DeckFinding, Namelist, NamelistAssignment
from datcom_io.decks.deck import Deck
from datcom_io.decks.namelists import DIMENSIONS, MOST_NAMELISTS, VARIABLES

_SURFACES = "WHVF"
_AIRFOIL_TYPES = "1456S"
_STOPS = "it stops the program"


def check_namelist_names(deck: Deck) -> Iterator[DeckFinding]:
    """Yield namelists and variables that the program does not know, and values of another type or
    beyond the array.
    """
    for item in deck.items:
        if not isinstance(item, Namelist):
            continue
        known = VARIABLES.get(item.name)
        if known is None:
            yield DeckFinding(
                item.line,
                ERROR,
                f"unknown namelist ${item.name}{_near(item.name, VARIABLES)}; the program "
                f"does not run the case",
            )
            continue
        for assignment in item.assignments:
            if assignment.variable not in known:
                near = _near(assignment.variable, known)
                yield DeckFinding(
                    assignment.line,
                    ERROR,
                    f"${item.name} has no variable {assignment.variable}{near}; {_STOPS}",
                )
            else:
                yield from _sizes(item.name, assignment, known[assignment.variable])


def _near(name: str, allowed: Iterable[str]) -> str:
    near = get_close_matches(name, allowed, n=3, cutoff=0.6)
    return f"; near it: {', '.join(near)}" if near else ""


def _sizes(name: str, found: NamelistAssignment, size: int) -> Iterator[DeckFinding]:
    where = f"${name}: {found.variable}"
    last = found.start - 1 + len(found.values)
    if last > abs(size):
        allowed = "one value" if abs(size) == 1 else f"{abs(size)} values"
        yield DeckFinding(
            found.line, ERROR, f"{where} is given up to place {last}; it holds {allowed}, {_STOPS}"
        )
    logical = size < 0
    if any(isinstance(value, bool) is not logical for value in found.values):
        wanted = ".TRUE. or .FALSE." if logical else "a number"
        yield DeckFinding(found.line, ERROR, f"{where} must be {wanted}; {_STOPS}")


def control_cards(deck: Deck) -> Iterator[DeckFinding]:
    """Yield NACA and DIM cards that the program does not take."""
    for card in deck.items:
        if not isinstance(card, Card):
            continue
        if card.name == "DIM" and card.text[:2].strip() not in DIMENSIONS:
            yield DeckFinding(
                card.line,
                ERROR,
                f"DIM {card.text}: allowed are {', '.join(DIMENSIONS)}; the program does not "
                f"run the case",
            )
        if card.name == "NACA":
            yield from _naca(card)


def _naca(card: Card) -> Iterator[DeckFinding]:
    surface, kind, designation = card.text[:1], card.text[2:3], card.text[4:].strip()
    if surface not in _SURFACES or not surface:
        surfaces = "W wing, H horizontal tail, V vertical tail, F ventral fin"
        yield DeckFinding(
            card.line,
            ERROR,
            f"NACA {card.text}: surface {surface!r} in column 6; allowed are {surfaces}",
        )
    if kind not in _AIRFOIL_TYPES or not kind:
        yield DeckFinding(
            card.line,
            ERROR,
            f"NACA {card.text}: type {kind!r} in column 8; allowed are {', '.join(_AIRFOIL_TYPES)}",
        )
    if not designation:
        yield DeckFinding(
            card.line,
            ERROR,
            f"NACA {card.text}: no designation from column 10; write one such as 2412",
        )


def length_of_chain(deck: Deck) -> Iterator[DeckFinding]:
    """Yield a series of SAVE cases that has more namelists than the program can replay."""
    chain = [
        item
        for item in (*deck.replayed, *deck.items)
        if isinstance(item, Namelist) or item.name == "NACA"
    ]
    count = sum(not item.name.startswith("EXPR") for item in chain)
    if count > MOST_NAMELISTS:
        text = (
            f"{count} namelists and NACA cards in a series of SAVE cases; the program takes "
            f"{MOST_NAMELISTS}: leave SAVE out once"
        )
        yield DeckFinding(deck.line, ERROR, text)


def devices_written(deck: Deck) -> Iterator[DeckFinding]:
    """Yield control devices that exclude each other in one case."""
    own = [
        item
        for item in deck.items
        if isinstance(item, Namelist) and item.name in ("SYMFLP", "ASYFLP")
    ]
    if {item.name for item in own} == {"SYMFLP", "ASYFLP"}:
        text = (
            f"SYMFLP and ASYFLP in one case: the program drops the first and computes "
            f"${own[-1].name}; make a case for each (datcom split)"
        )
        yield DeckFinding(own[-1].line, ERROR, text)
    elif len(own) > 1:
        text = (
            f"${own[0].name} {len(own)} times in one case: the values of the last overwrite "
            f"those before; make a case for each"
        )
        yield DeckFinding(own[1].line, WARNING, f"{text} (datcom split)")
    sharing = [name for name in ("SYMFLP", "ASYFLP", "HYPEFF", "TRNJET") if name in deck.namelists]
    if len(sharing) > 1 and ("HYPEFF" in sharing or "TRNJET" in sharing):
        text = (
            f"{' and '.join(sharing)} in one case: the program keeps them in the same memory; "
            f"make a case for each"
        )
        yield DeckFinding(deck.line_of(sharing[-1]), ERROR, text)


RULES = (check_namelist_names, control_cards, length_of_chain, devices_written)
