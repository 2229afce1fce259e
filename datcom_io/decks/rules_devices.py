"""Rules of devices, wings, bodies and sections that the program gets wrong without a word."""

from __future__ import annotations

from collections.abc import Iterator

from datcom_io.decks.cards import ERROR, WARNING, DeckFinding
from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import measure_wing

_SECTIONS = ("WGSCHR", "HTSCHR", "VTSCHR", "VFSCHR")
# Step of the mean line at the nose over the half height of the second station. Sound decks have at
# most 0.05.
_NOSE_STEP = 0.15
# Thicker than the sections of any wing, and twice 2 pi per radian at Mach 0.85.
_THICKEST, _STEEPEST = 0.4, 0.42
_DOUBLE_DELTA, _CRANKED = 2.0, 3.0  # TYPE of WGPLNF
# Aspect ratio from which these types lose lift, and Mach number up to which that was seen.
_NOT_SLENDER, _SUBSONIC = 3.0, 0.6
_NEARLY_UNSWEPT = 1.0  # deg


def check_deflections(deck: Deck) -> Iterator[DeckFinding]:
    """Yield a flap without deflections: the program computes it at numbers that are not set."""
    if "SYMFLP" not in deck.namelists:
        return
    needed = {"NDELTA": deck.value("SYMFLP", "NDELTA"), "DELTA": deck.values("SYMFLP", "DELTA")}
    missing = [name for name, value in needed.items() if not value]
    if missing:
        text = (
            f"$SYMFLP without {' and '.join(missing)}: the program has no deflection to compute; "
            f"give their number in NDELTA and the angles in DELTA(1)"
        )
        yield DeckFinding(deck.line_of("SYMFLP"), ERROR, text)


def check_nose_height(deck: Deck) -> Iterator[DeckFinding]:
    """Yield a pointed nose that lies off the mean line of the body behind it.

    The program takes the step as camber and adds a moment at every angle of attack: 0.10 in CM for
    a nose 0.3 m below the line of an own light aircraft of two engines, whose second station is 0.7
    m high. The height of the whole body does not count: the T-37 with its nose at 0.35 ft or at 0
    prints the same.
    """
    upper, lower = deck.values("BODY", "ZU"), deck.values("BODY", "ZL")
    if len(upper) < 2 or len(lower) < 2 or upper[0] != lower[0]:
        return
    line, half_height = 0.5 * (upper[1] + lower[1]), 0.5 * (upper[1] - lower[1])
    if abs(upper[0] - line) > _NOSE_STEP * abs(half_height):
        text = (
            f"$BODY: ZU(1) and ZL(1) are both {upper[0]:g}, the mean line of the next station is "
            f"at {line:g}: the program takes the step as camber and adds a moment at every angle "
            f"of attack; put the nose on the line of the body"
        )
        yield DeckFinding(deck.line_of("BODY", "ZU"), WARNING, text)


def check_section_numbers(deck: Deck) -> Iterator[DeckFinding]:
    """Yield thickness ratios and slopes of a section that are in per cent or per radian."""
    for name in _SECTIONS:
        for variable in ("TOVC", "TOVCO"):
            thickness = deck.value(name, variable) or 0.0
            if thickness > _THICKEST:
                text = (
                    f"${name}: {variable}={thickness:g} is a section as thick as {thickness:.0%} "
                    f"of its chord; give a fraction such as 0.12"
                )
                yield DeckFinding(deck.line_of(name, variable), WARNING, text)
        for variable in ("CLAMO", "CLALPA"):
            steepest = max(deck.values(name, variable), default=0.0)
            if steepest > _STEEPEST:
                text = (
                    f"${name}: {variable}={steepest:g} per degree is {steepest / 0.11:.2g} times "
                    f"the slope of a thin section; give it per degree, such as 0.105"
                )
                yield DeckFinding(deck.line_of(name, variable), WARNING, text)


def check_inlet_units(deck: Deck) -> Iterator[DeckFinding]:
    """Yield jet engines in inches, whose effect the program does not convert."""
    if "JETPWR" in deck.namelists and deck.dim == "IN":
        text = (
            "$JETPWR with DIM IN: the effect of power is not that of the same deck in feet "
            "(seen: CL less by 0.002); write decks with power in feet"
        )
        yield DeckFinding(deck.line_of("JETPWR"), WARNING, text)


def check_unswept_crank(deck: Deck) -> Iterator[DeckFinding]:
    """Yield a cranked wing without sweep whose damping stops some builds of the program.

    Its routine SUBRYW looks up a chart of one abscissa; the message about it has a wrong format.
    """
    sweep = deck.value("WGPLNF", "SAVSI")
    is_cranked = deck.value("WGPLNF", "TYPE") == _CRANKED
    is_unswept = sweep is not None and abs(sweep) < _NEARLY_UNSWEPT
    if is_cranked and is_unswept and deck.has("DAMP"):
        text = (
            f"DAMP with a cranked wing (TYPE=3) of SAVSI={sweep:g}: the chart of the yawing wing "
            f"has one abscissa, and builds of the program stop; give a sweep of 1 deg or more, or "
            f"TYPE=1"
        )
        yield DeckFinding(deck.line_of("WGPLNF", "SAVSI"), WARNING, text)


def check_lift_of_crank(deck: Deck) -> Iterator[DeckFinding]:
    """Yield a cranked wing whose subsonic lift the program loses.

    Of nine wings with aspect ratios of 4.8 to 8.6 the slope of CL with TYPE=2 or 3 is 0.34 to 0.81
    of that with TYPE=1, which takes the break as well. Slender wings (1.1 to 1.8) do not lose lift.
    """
    kind, wing = deck.value("WGPLNF", "TYPE"), measure_wing(deck)
    if kind not in (_DOUBLE_DELTA, _CRANKED) or not deck.value("WGPLNF", "SSPNOP"):
        return
    if wing is None or wing.aspect_ratio < _NOT_SLENDER:
        return
    machs = deck.schedule("FLTCON", "MACH", "NMACH")
    if machs and min(machs) > _SUBSONIC:
        return
    text = (
        f"$WGPLNF: TYPE={kind:g} with an aspect ratio of {wing.aspect_ratio:.3g}: at subsonic "
        f"speed the program prints a third to four fifths of the lift slope; TYPE=1.0 takes the "
        f"break (SSPNOP, CHRDBP) as well and keeps the lift"
    )
    yield DeckFinding(deck.line_of("WGPLNF", "TYPE"), WARNING, text)


RULES = (
    check_deflections,
    check_lift_of_crank,
    check_nose_height,
    check_section_numbers,
    check_inlet_units,
    check_unswept_crank,
)
