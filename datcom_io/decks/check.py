"""Checking an input deck before the run: what the program would reject, and what would make its
print misleading.

The rules follow the program's own tests (source of January 1996: routines CONERR, INPUT, NAMER,
CHECK, MAJERR) and the faults seen in its prints.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator

from datcom_io.decks import aircraft_rules as aircraft
from datcom_io.decks import rules_cards as cards
from datcom_io.decks import rules_flight as flight
from datcom_io.decks.cards import WARNING, DeckFinding
from datcom_io.decks.deck import Deck
from datcom_io.decks.deck_file import DeckFile, read_deck

_DEVICES = {"SYMFLP", "ASYFLP", "GRNDEF", "JETPWR", "PROPWR", "CONTAB"}
_RULES = (*cards.RULES, *flight.RULES, *aircraft.RULES)


def check_deck(
    deck: DeckFile | Deck | str | os.PathLike[str] | Iterable[Deck],
) -> list[DeckFinding]:
    """Return what the program would reject or misread.

    Parameters
    ----------
    deck : DeckFile, Deck, iterable of Deck, or path
        As `read_deck` returns it, or a file.

    Returns
    -------
    list of DeckFinding
        By line: ``line``, ``severity`` and ``text``.  An ``error`` stops the program, makes it leave out the case, or makes it
        print ERROR and drop what was requested; with a ``warning`` it runs, if need be with a value that it corrects itself, and the
        result needs care.

    Examples
    --------
    >>> for finding in check_deck(read_deck([" $FLTCON NMACH=1.0,MACH(1)=0.3,NALPHA=1.0,ALSCHD(1)=0.0,ALT(1)=0.0$"])):
    ...     print(finding.line, finding.severity, finding.text)
    1 error no $SYNTHS (synthesis data); the program leaves the case out: add it
    1 warning $OPTINS: SREF, CBARR, BLREF not given; the program takes the theoretical wing area for SREF, the theoretical mean \
chord of the wing for CBARR, the wing span for BLREF, and readers that look in the deck fail: write them
    """
    if isinstance(deck, str | os.PathLike):
        deck = read_deck(deck)
    found = list(deck.findings) if isinstance(deck, DeckFile) else []
    cases = [deck] if isinstance(deck, Deck) else list(deck)
    for case in cases:
        found += check_case(case)
    found += _run(cases)
    return sorted(found, key=lambda finding: finding.line)


def check_case(case: Deck) -> list[DeckFinding]:
    """Return the findings of one case by itself."""
    return [*case.findings, *(finding for rule in _RULES for finding in rule(case))]


def _run(cases: list[Deck]) -> Iterator[DeckFinding]:
    """Yield what concerns the run as a whole."""
    yield from _drift(cases)
    yield from _undamped(cases)
    if cases and cases[-1].has("SAVE") and cases[-1].has("NEXT"):
        line = next(card.line for card in reversed(cases[-1].cards) if card.name == "SAVE")
        yield DeckFinding(
            line,
            WARNING,
            "SAVE in the last case, before NEXT CASE: the program runs the saved case once "
            "more; take SAVE out",
        )


def _undamped(cases: list[Deck]) -> Iterator[DeckFinding]:
    """Without DAMP the program computes no derivatives with rates, of which a database needs those
    of the whole aeroplane.
    """
    whole = [
        case
        for case in cases
        if {"WGPLNF", "HTPLNF", "FLTCON"} <= case.namelists.keys()
        and not _DEVICES & case.namelists.keys()
    ]
    if whole and not any(case.has("DAMP") for case in whole):
        yield DeckFinding(
            whole[0].line,
            WARNING,
            "no DAMP card: the program prints no derivatives with q, alpha dot, p and r, and "
            "a database made of the listing has no "
            "damping; add a line DAMP",
        )


def _drift(cases: list[Deck]) -> Iterator[DeckFinding]:
    """The program keeps a part of D(CM) from one condition of a run to the next."""
    flapped = [case for case in cases if "SYMFLP" in case.namelists]
    conditions = sum(max(1, len(case.conditions())) for case in flapped)
    if conditions > 1:
        text = (
            f"$SYMFLP at {conditions} flight conditions of one run: the program carries a "
            f"part of D(CM) from one to the next"
        )
        yield DeckFinding(
            flapped[0].line_of("SYMFLP"),
            WARNING,
            f"{text}; where D(CM) counts, make one run per condition (datcom split)",
        )
