"""Rules of the cards: names, types and sizes that the reader of the program accepts.

A fault here stops the whole run.
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
    """Yield unknown namelists and variables, and values of another type or beyond the array."""
    for item in deck.items:
        if not isinstance(item, Namelist):
            continue
        sizes = VARIABLES.get(item.name)
        if sizes is None:
            yield DeckFinding(
                item.line,
                ERROR,
                f"unknown namelist ${item.name}{_near_names(item.name, VARIABLES)}; the program "
                f"does not run the case",
            )
            continue
        # A wrong name or size stops the reader of the program.
        for assignment in item.assignments:
            if assignment.variable not in sizes:
                near = _near_names(assignment.variable, sizes)
                yield DeckFinding(
                    assignment.line,
                    ERROR,
                    f"${item.name} has no variable {assignment.variable}{near}; {_STOPS}",
                )
            else:
                yield from _check_values(item.name, assignment, sizes[assignment.variable])


def _near_names(name: str, allowed: Iterable[str]) -> str:
    """Return a text with the allowed names that look like a wrong one, empty without any."""
    near = get_close_matches(name, allowed, n=3, cutoff=0.6)
    if not near:
        return ""
    return f"; near it: {', '.join(near)}"


def _check_values(name: str, assignment: NamelistAssignment, size: int) -> Iterator[DeckFinding]:
    """Yield values beyond an array, or of another type than the variable."""
    where = f"${name}: {assignment.variable}"
    last = assignment.start - 1 + len(assignment.values)
    if last > abs(size):
        allowed = f"{abs(size)} values"
        if abs(size) == 1:
            allowed = "one value"
        text = f"{where} is given up to place {last}; it holds {allowed}, {_STOPS}"
        yield DeckFinding(assignment.line, ERROR, text)
    # A size below zero denotes a logical variable.
    is_logical = size < 0
    if any(isinstance(value, bool) is not is_logical for value in assignment.values):
        expected = "a number"
        if is_logical:
            expected = ".TRUE. or .FALSE."
        yield DeckFinding(assignment.line, ERROR, f"{where} must be {expected}; {_STOPS}")


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
            yield from _check_naca_card(card)


def _check_naca_card(card: Card) -> Iterator[DeckFinding]:
    """Yield a wrong surface, type or designation of a NACA card."""
    # Columns 6 and 8 of the card, and the text from column 10 on.
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
    count = 0
    for item in (*deck.replayed, *deck.items):
        is_replayed = isinstance(item, Namelist) or item.name == "NACA"
        if is_replayed and not item.name.startswith("EXPR"):
            count += 1
    if count > MOST_NAMELISTS:
        text = (
            f"{count} namelists and NACA cards in a series of SAVE cases; the program takes "
            f"{MOST_NAMELISTS}: leave SAVE out once"
        )
        yield DeckFinding(deck.line, ERROR, text)


def devices_written(deck: Deck) -> Iterator[DeckFinding]:
    """Yield control devices that exclude each other in one case."""
    devices = []
    for item in deck.items:
        if isinstance(item, Namelist) and item.name in ("SYMFLP", "ASYFLP"):
            devices.append(item)
    # A case computes one device only.
    if {item.name for item in devices} == {"SYMFLP", "ASYFLP"}:
        text = (
            f"SYMFLP and ASYFLP in one case: the program drops the first and computes "
            f"${devices[-1].name}; make a case for each (datcom split)"
        )
        yield DeckFinding(devices[-1].line, ERROR, text)
    elif len(devices) > 1:
        text = (
            f"${devices[0].name} {len(devices)} times in one case: the values of the last "
            f"overwrite those before; make a case for each"
        )
        yield DeckFinding(devices[1].line, WARNING, f"{text} (datcom split)")
    # The hypersonic flap and the jet use the memory of the flaps.
    sharing = [name for name in ("SYMFLP", "ASYFLP", "HYPEFF", "TRNJET") if name in deck.namelists]
    if len(sharing) > 1 and ("HYPEFF" in sharing or "TRNJET" in sharing):
        text = (
            f"{' and '.join(sharing)} in one case: the program keeps them in the same memory; "
            f"make a case for each"
        )
        yield DeckFinding(deck.line_of(sharing[-1]), ERROR, text)


RULES = (check_namelist_names, control_cards, length_of_chain, devices_written)
