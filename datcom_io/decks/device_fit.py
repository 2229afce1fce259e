"""Devices that do not fit their surface, and flaps of a wing that are computed on the tail.

With a wing and a horizontal tail the program puts every SYMFLP on the tail, and the deck does not
state what is meant.  A flap that fits inside the tail is known by its stations: it begins where the
wing leaves the body, which is wider than the body at the tail, and it need not reach the tip of the
tail.  Of 16 public and own elevators all begin inside the side of the body at the wing, or within
6 % of the semispan from that at the tail; all but one end beyond 80 % of the semispan; their chords
are 13 to 49 % of those of the tail.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from datcom_io.decks.aircraft_rules import (
    describe_chord_beyond_surface,
    describe_span_beyond_tip,
    surface_of_device,
)
from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import sample_chords

_SPOILERS, _DIFFERENTIAL_TAIL = (1, 2, 3), 5  # STYPE of ASYFLP
# Part of the semispan by which the device of a careless deck may pass the tip of its own surface.
# The elevator of a public deck passes it by 0.05 %, an aileron by 1.8 %; a flap of the wing that
# the program computes on the tail passes it by half the span and more.
_CARELESS_SPAN = 0.05
_FLAP_ON_TAIL = (
    "with a wing and a horizontal tail the program computes a SYMFLP on the tail, so run the flap "
    "of a wing without HTPLNF"
)
_WRONG_CARDS = "correct the stations and chords of the device"
_NO_HEIGHT = "give DELTAS, XSOC and HSOC, or STYPE=4.0 for an aileron with DELTAL and DELTAR"
_NO_TAIL = "give HTPLNF, or STYPE=4.0 for an aileron"
# A device of the wing does not begin inside the body; rounding of the cards, part of the semispan.
_ROUNDED = 0.005
# From the side of the body to the device: of the wing's semispan, and of the tail's.
_AT_WING, _FROM_TAIL, _FAR_FROM_TAIL = 0.15, 0.08, 0.15
_LARGEST_FLAP = 0.45  # of the chord of the wing
_LEAST_END = 0.75  # of the semispan of the tail
_LEAST_CHORD = 0.12  # of the chord of the tail
# A device of constant chord ratio on one surface, and the change of it on the other.
_CONSTANT, _CHANGED = 0.05, 0.2
MAY_BE_FLAP, IS_FLAP = 1, 2
"""Weights from which a device may be, and counts as, the flap of the wing."""


@dataclass(frozen=True)
class DeviceDoubt:
    """Evidence that a device on the tail is the flap of the wing.

    Attributes
    ----------
    weight : int
        0 for an elevator, `MAY_BE_FLAP`, or `IS_FLAP` and more.
    clauses : tuple of str
        The evidence, each with its numbers.
    """

    weight: int = 0
    clauses: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Place:
    """A device on a surface; parts of its semispan and of its chords."""

    start: float  # from the side of the body
    end: float
    chords: tuple[float, float]

    @property
    def change(self) -> float:
        """Relative change of the chord ratio along the device."""
        return abs(self.chords[1] / self.chords[0] - 1.0)


def describe_misfit(deck: Deck, tolerance: float = _CARELESS_SPAN) -> str:
    """Return a clause on the device of a deck that does not fit its surface, empty if it fits.

    With a wing and a horizontal tail the program computes every SYMFLP on the tail.  A flap of the
    wing then gives increments that belong to no surface of the aircraft.

    Parameters
    ----------
    deck : Deck
    tolerance : float
        Part of the semispan that the device may reach beyond the tip, and of the chord of the
        surface by which its chord may be larger.
    """
    name = "ASYFLP"
    style = round(deck.value("ASYFLP", "STYPE") or 0.0)
    if style in _SPOILERS and not any(deck.values("ASYFLP", "DELTAS")):
        return f"$ASYFLP: STYPE={style} is a spoiler, and no height DELTAS is given"
    if "SYMFLP" in deck.namelists:
        name = "SYMFLP"
    elif style == _DIFFERENTIAL_TAIL:
        if "HTPLNF" in deck.namelists:
            return ""
        return (
            f"$ASYFLP: STYPE={style} is a horizontal tail whose halves move, and HTPLNF is absent"
        )
    surface = surface_of_device(deck, name)
    return describe_span_beyond_tip(
        deck, name, surface, tolerance
    ) or describe_chord_beyond_surface(deck, name, surface, tolerance)


def advise_on_misfit(deck: Deck) -> str:
    """Return what to do about a device that does not fit its surface."""
    if "SYMFLP" in deck.namelists and surface_of_device(deck, "SYMFLP") == "HTPLNF":
        return _FLAP_ON_TAIL
    style = round(deck.value("ASYFLP", "STYPE") or 0.0)
    if style in _SPOILERS:
        return _NO_HEIGHT
    if style == _DIFFERENTIAL_TAIL:
        return _NO_TAIL
    return _WRONG_CARDS


def weigh_device_on_tail(deck: Deck) -> DeviceDoubt:
    """Return the evidence that the SYMFLP of a deck with wing and tail is the flap of the wing.

    Without complete cards of the device and both planforms there is none.
    """
    spans = [deck.value(name, "SSPN") or 0.0 for name in ("WGPLNF", "HTPLNF")]
    if (
        0.0 < spans[0] < spans[1]
        and "SYMFLP" in deck.namelists
        and not states_elevator(deck, deck.caseid)
    ):
        clause = f"HTPLNF has a span of {spans[1] / spans[0]:.2g} times WGPLNF: it is the main wing"
        return DeviceDoubt(MAY_BE_FLAP, (clause,))
    tail, wing = _place_device(deck, "HTPLNF"), _place_device(deck, "WGPLNF")
    if tail is None or wing is None or wing.start < -_ROUNDED or wing.end > 1.0 + _ROUNDED:
        return DeviceDoubt()
    weight, clauses = 0, []
    inner = deck.value("SYMFLP", "SPANFI")
    if wing.start < _AT_WING and tail.start > _FROM_TAIL:
        weight += 1 + (tail.start > _FAR_FROM_TAIL)
        clauses.append(
            f"SPANFI={inner:g} is {wing.start:z.0%} of the semispan from the body at the wing, and "
            f"{tail.start:z.0%} of that of the tail from the body there"
        )
    if tail.end < _LEAST_END:
        weight += 1
        outer = deck.value("SYMFLP", "SPANFO")
        clauses.append(f"SPANFO={outer:g} is {tail.end:.0%} of the semispan of the tail")
    if max(tail.chords) < _LEAST_CHORD:
        weight += 1
        clauses.append(f"its chord is {max(tail.chords):.0%} of that of the tail")
    if wing.change < _CONSTANT and tail.change > _CHANGED:
        weight += 1
        clauses.append(
            f"its chord is {wing.chords[0]:.0%} of that of the wing at both ends, and "
            f"{tail.chords[0]:.0%} and {tail.chords[1]:.0%} of that of the tail"
        )
    fits_wing = wing.start < _AT_WING and max(wing.chords) < _LARGEST_FLAP
    if not clauses and fits_wing and not states_elevator(deck, deck.caseid):
        # A body as wide at the tail as at the wing: the cards do not separate both.
        weight = MAY_BE_FLAP
        clauses.append(
            f"it fits the wing as well: from {wing.start:z.0%} of the semispan outside the body, "
            f"with {wing.chords[0]:.0%} and {wing.chords[1]:.0%} of the chord"
        )
    return DeviceDoubt(weight, tuple(clauses))


def states_elevator(deck: Deck, name: str) -> bool:
    """Return whether the name of a case, TRIM or CONTAB states that its SYMFLP is an elevator."""
    return "ELEV" in name.upper() or deck.has("TRIM") or "CONTAB" in deck.namelists


def _place_device(deck: Deck, surface: str) -> _Place | None:
    """Return the place of the SYMFLP on a surface, None if a card is missing."""
    names = ("SPANFI", "SPANFO", "CHRDFI", "CHRDFO")
    inner, outer, chord_in, chord_out = (deck.value("SYMFLP", name) for name in names)
    sampled = sample_chords(deck, surface)
    if sampled is None or inner is None or outer is None or not chord_in or chord_out is None:
        return None
    stations, chord, _ = sampled
    half = float(stations[-1])
    side = half - (deck.value(surface, "SSPNE") or half)
    local = np.interp([inner, outer], stations, chord)
    if not (local > 0.0).all():
        return None
    ratios = (chord_in / float(local[0]), chord_out / float(local[1]))
    return _Place((inner - side) / half, outer / half, ratios)
