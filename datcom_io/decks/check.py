"""Check of an input deck before the run.

It finds cards that the program rejects, and cards that make its print misleading.  The rules follow
the tests of the program itself (source of January 1996: routines CONERR, INPUT, NAMER, CHECK,
MAJERR) and the faults seen in its prints.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from itertools import pairwise

from datcom_io.decks import aircraft_rules as aircraft
from datcom_io.decks import rules_cards as cards
from datcom_io.decks import rules_devices as devices
from datcom_io.decks import rules_flight as flight
from datcom_io.decks import rules_reference as reference
from datcom_io.decks import rules_sizes as sizes
from datcom_io.decks.cards import WARNING, DeckFinding
from datcom_io.decks.deck import Deck
from datcom_io.decks.deck_file import DeckFile, read_deck

# Cases with such a namelist are not the clean aeroplane.
_DEVICES = {"SYMFLP", "ASYFLP", "GRNDEF", "JETPWR", "PROPWR", "CONTAB"}
_RULES = (
    *cards.RULES,
    *flight.RULES,
    *aircraft.RULES,
    *devices.RULES,
    *reference.RULES,
    *sizes.RULES,
)


def check_deck(
    deck: DeckFile | Deck | str | os.PathLike[str] | Iterable[Deck],
) -> list[DeckFinding]:
    """Return the cards of a deck that the program would reject or misread.

    Parameters
    ----------
    deck : DeckFile, Deck, iterable of Deck, or path
        As `read_deck` returns it, or a file.

    Returns
    -------
    list of DeckFinding
        By line: ``line``, ``severity`` and ``text``.  An ``error`` stops the program, makes it
        leave out the case, or makes it print ERROR and drop a requested result.  With a ``warning``
        it runs, if need be with a value that it corrects itself, and the result needs care.

    Examples
    --------
    >>> deck = read_deck([" $FLTCON NMACH=1.0,MACH(1)=0.3,NALPHA=1.0,ALSCHD(1)=0.0,ALT(1)=0.0$"])
    >>> for finding in check_deck(deck):
    ...     print(finding.line, finding.severity, finding.text[:37])
    1 error no $SYNTHS (synthesis data); the prog
    1 warning $OPTINS: SREF, CBARR, BLREF not given
    """
    if isinstance(deck, str | os.PathLike):
        deck = read_deck(deck)
    # Text of the file, then each case, then the run as a whole.
    findings: list[DeckFinding] = []
    if isinstance(deck, DeckFile):
        findings += deck.findings
    if isinstance(deck, Deck):
        cases = [deck]
    else:
        cases = list(deck)
    for case in cases:
        findings += check_case(case)
    findings += _check_run(cases)
    return sorted(findings, key=lambda finding: finding.line)


def check_case(case: Deck) -> list[DeckFinding]:
    """Return the findings of one case by itself."""
    findings = list(case.findings)
    for rule in _RULES:
        findings += rule(case)
    return findings


def describe_doubts(case: Deck) -> list[str]:
    """Return the texts about sizes, places, angles and conditions that no aeroplane has.

    They are those of `check_deck` that the program computes with and that its print does not show,
    so that whoever takes a listing with its cards states them.
    """
    doubts: dict[str, None] = {}
    for rule in (*sizes.RULES, *reference.RULES, devices.check_section_numbers):
        doubts.update(dict.fromkeys(finding.text for finding in rule(case)))
    return list(doubts)


def _check_run(cases: list[Deck]) -> Iterator[DeckFinding]:
    """Yield findings about the run as a whole."""
    yield from _check_drift(cases)
    yield from _check_damping(cases)
    yield from _check_units_of_saved(cases)
    if cases and cases[-1].has("SAVE") and cases[-1].has("NEXT"):
        lines = [card.line for card in cases[-1].cards if card.name == "SAVE"]
        yield DeckFinding(
            lines[-1],
            WARNING,
            "SAVE in the last case, before NEXT CASE: the program runs the saved case once "
            "more; take SAVE out",
        )


def _check_units_of_saved(cases: list[Deck]) -> Iterator[DeckFinding]:
    """Yield a DIM card that changes the unit of lengths that SAVE carried on."""
    for before, case in pairwise(cases):
        if not before.has("SAVE") or case.dim == before.dim:
            continue
        lines = [card.line for card in case.cards if card.name == "DIM"]
        text = (
            f"DIM {case.dim} behind SAVE of a case in {before.dim}: every length that is carried "
            f"on counts in {case.dim} from here on, without a change of its number; write the case "
            f"without SAVE"
        )
        yield DeckFinding(max(lines, default=case.line), WARNING, text)


def _check_damping(cases: list[Deck]) -> Iterator[DeckFinding]:
    """Yield a finding if no case of the whole aeroplane has the card DAMP.

    Without DAMP the program computes no derivatives with rates, of which a database needs those of
    the whole aeroplane.
    """
    whole_cases = []
    for case in cases:
        names = case.namelists.keys()
        if names >= {"WGPLNF", "HTPLNF", "FLTCON"} and not _DEVICES & names:
            whole_cases.append(case)
    if whole_cases and not any(case.has("DAMP") for case in whole_cases):
        yield DeckFinding(
            whole_cases[0].line,
            WARNING,
            "no DAMP card: the program prints no derivatives with q, alpha dot, p and r, and "
            "a database made of the listing has no "
            "damping; add a line DAMP",
        )


def _check_drift(cases: list[Deck]) -> Iterator[DeckFinding]:
    """The program keeps a part of D(CM) from one condition of a run to the next."""
    flapped = [case for case in cases if "SYMFLP" in case.namelists]
    # A case without Mach number still has one condition.
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
