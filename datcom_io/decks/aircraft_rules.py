"""Rules of the aircraft: namelists that need each other, and the content of namelists.

They concern body, reference quantities, control devices, ground effect and trim.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from datcom_io.decks.cards import ERROR, WARNING, DeckFinding
from datcom_io.decks.deck import Deck
from datcom_io.decks.namelists import DIMENSIONS

_SURFACES = {
    "W": ("WG", "wing"),
    "H": ("HT", "horizontal tail"),
    "V": ("VT", "vertical tail"),
    "F": ("VF", "ventral fin"),
}
_DIFFERENTIAL_TAIL = 5
# A rounding of the last digit of SPANFO is not a fault.
ROUNDED_SPAN = 1e-4
_DIGITS = ("4", "5")  # types of NACA aerofoils that are their number of digits
_TYPES = 4  # straight, double delta, cranked, curved


def is_special(deck: Deck) -> bool:
    """Return whether the case needs no aircraft.

    Such a case is a low aspect ratio wing, a hypersonic flap or a transverse jet.
    """
    return bool({"LARWB", "HYPEFF", "TRNJET"} & deck.namelists.keys())


def check_required_namelists(deck: Deck) -> Iterator[DeckFinding]:
    """Yield namelists without which the program leaves the case out."""
    if not deck.namelists:
        yield DeckFinding(
            deck.line, ERROR, "a case without any namelist; the program has nothing to run"
        )
    elif not is_special(deck):
        for name, what in (("FLTCON", "flight conditions"), ("SYNTHS", "synthesis data")):
            if name not in deck.namelists:
                yield DeckFinding(
                    deck.line,
                    ERROR,
                    f"no ${name} ({what}); the program leaves the case out: add it",
                )
    elif "FLTCON" not in deck.namelists:
        yield DeckFinding(deck.line, ERROR, "no $FLTCON (flight conditions): add it")


def check_planform_sections(deck: Deck) -> Iterator[DeckFinding]:
    """Yield planforms without sections and sections without planforms."""
    for letter, (prefix, what) in _SURFACES.items():
        # A NACA card replaces the namelist of the section.
        planform, section = f"{prefix}PLNF", f"{prefix}SCHR"
        has_section = section in deck.namelists or letter in deck.sections
        if planform in deck.namelists and not has_section:
            # The program itself tests wing and horizontal tail only.
            severity, consequence = WARNING, "the program does not notice"
            if letter in "WH":
                severity, consequence = ERROR, "the program leaves the case out"
            if is_special(deck):
                severity = WARNING
            text = (
                f"${planform} without section: neither ${section} nor a NACA {letter} card "
                f"for the {what}; {consequence}"
            )
            yield DeckFinding(deck.line_of(planform), severity, text)
        if has_section and planform not in deck.namelists:
            line = deck.line_of(section)
            if section not in deck.namelists:
                line = _line_of_section(deck, letter)
            text = f"a section for the {what} without ${planform}"
            if letter == "F" or is_special(deck):
                yield DeckFinding(line, WARNING, text)
            else:
                yield DeckFinding(line, ERROR, f"{text}; the program leaves the case out")


def check_section_digits(deck: Deck) -> Iterator[DeckFinding]:
    """Yield NACA cards whose designation has not as many digits as their type.

    The program reads the designation by its columns, as its type counts them.
    """
    for letter, section in deck.sections.items():
        kind, _, designation = section.partition(" ")
        digits = len(re.match(r"\d*", designation)[0])  # type: ignore[index]
        if kind in _DIGITS and digits != int(kind):
            # no other number of digits is a type of its own
            remedy = f"write {kind} digits"
            if str(digits) in _DIGITS:
                remedy = f"write type {digits}, or {kind} digits"
            text = (
                f"NACA {letter}: type {kind} with the designation {designation}, which has "
                f"{digits} digits; the program reads another aerofoil: {remedy}"
            )
            yield DeckFinding(_line_of_section(deck, letter), WARNING, text)


def _line_of_section(deck: Deck, letter: str) -> int:
    """Return the line of the last NACA card of a surface."""
    cards = [card for card in deck.cards if card.name == "NACA" and card.text[:1] == letter]
    return cards[-1].line


def planform_types(deck: Deck) -> Iterator[DeckFinding]:
    """Yield planform types that the program does not know."""
    kind = deck.value("WGPLNF", "TYPE")
    if kind is not None and kind >= _TYPES + 1:
        text = (
            f"$WGPLNF: TYPE={kind:g}; allowed is 1 ... {_TYPES}, the program takes 1 and "
            f"prints ERROR"
        )
        yield DeckFinding(deck.line_of("WGPLNF", "TYPE"), ERROR, text)


def check_body_sections(deck: Deck) -> Iterator[DeckFinding]:
    """Yield a body whose cross sections are not given in one of the three ways of the program."""
    if "BODY" not in deck.namelists:
        return
    # Radius alone, area alone, or all three with the perimeter.
    arrays = {name for name in "RSP" if deck.value("BODY", name) is not None}
    if arrays not in ({"R"}, {"S"}, {"R", "S", "P"}):
        names = ", ".join(sorted(arrays)) or "none of them"
        text = (
            f"$BODY: of R, S and P there is {names}; give R alone, S alone, or all three: the "
            f"program does not run the case"
        )
        yield DeckFinding(deck.line_of("BODY"), ERROR, text)
    if not deck.values("BODY", "X"):
        yield DeckFinding(deck.line_of("BODY"), ERROR, "$BODY: no stations X; give NX and X(1)=...")


def check_reference_quantities(deck: Deck) -> Iterator[DeckFinding]:
    """Yield reference quantities left to the program; readers that take them from the deck fail."""
    if is_special(deck):
        return
    # Values that the program computes when OPTINS lacks them.
    what = {
        "SREF": "theoretical wing area",
        "CBARR": "theoretical mean chord of the wing",
        "BLREF": "wing span",
    }
    missing = [name for name in what if deck.value("OPTINS", name) is None]
    if missing and "FLTCON" in deck.namelists:
        defaults = ", ".join(f"the {what[name]} for {name}" for name in missing)
        text = (
            f"$OPTINS: {', '.join(missing)} not given; the program takes {defaults}, and readers "
            f"that look in the deck fail: write them"
        )
        yield DeckFinding(deck.line_of("OPTINS"), WARNING, text)


def surface_of_device(deck: Deck, name: str) -> str:
    """Return the namelist of the planform on which the program computes a device.

    With a wing and a horizontal tail a ``SYMFLP`` is on the tail. An ``ASYFLP``, except the halves
    of a tail, is on the wing, with or without a tail.
    """
    if name == "SYMFLP" and {"WGPLNF", "HTPLNF"} <= deck.namelists.keys():
        return "HTPLNF"
    return "WGPLNF"


def flap_span(deck: Deck) -> Iterator[DeckFinding]:
    """Yield a flap that begins inside the body, or does not fit its surface."""
    name = _device_namelist(deck)
    if not name or round(deck.value("ASYFLP", "STYPE") or 0) == _DIFFERENTIAL_TAIL:
        return
    surface = surface_of_device(deck, name)
    # The program looks at the tail if there is one, for ailerons too.
    tested = surface
    if "HTPLNF" in deck.namelists:
        tested = "HTPLNF"
    for body_at in dict.fromkeys((tested, surface)):
        begins_inside = _begin_inside_body(deck, name, body_at, noticed=body_at == tested)
        if begins_inside is not None:
            yield begins_inside
            break
    text, variable = describe_span_beyond_tip(deck, name, surface), "SPANFO"
    if not text:
        text, variable = describe_chord_beyond_surface(deck, name, surface), "CHRDFI"
    if text:
        if surface == "HTPLNF":
            text += "; with a wing and a horizontal tail the program puts the device on the tail"
        yield DeckFinding(deck.line_of(name, variable), WARNING, text)


def _begin_inside_body(deck: Deck, name: str, surface: str, *, noticed: bool) -> DeckFinding | None:
    """Return the finding on a device that begins inside the body at a surface, None if none does.

    Parameters
    ----------
    deck : Deck
    name, surface : str
        Namelists of the device and of the planform.
    noticed : bool
        Whether the program tests the device against the body at this surface.
    """
    # The side of the body is where the exposed span begins.
    tip, exposed = deck.value(surface, "SSPN"), deck.value(surface, "SSPNE")
    if tip is None or exposed is None:
        return None
    # The program subtracts in single precision, so a flap at the side may seem to lie inside.
    side = np.float32(tip) - np.float32(exposed)
    inner = np.float32(deck.value(name, "SPANFI") or 0.0)
    if inner >= side:
        return None
    is_rounding = float(side) - float(inner) < 1e-5 * tip
    if is_rounding and not noticed:
        return None
    rounding = ""
    if is_rounding:
        rounding = " (by rounding alone: write a little more)"
    consequence = f"the program prints ERROR and computes with {side:g}: write it"
    if not noticed:
        consequence = f"the program does not notice it, and computes with it: write {side:g}"
    text = (
        f"${name}: SPANFI={inner:g} lies inside the body, which reaches to SSPN - SSPNE = "
        f"{side:g} of ${surface}{rounding}"
    )
    return DeckFinding(deck.line_of(name, "SPANFI"), WARNING, f"{text}; {consequence}")


def describe_span_beyond_tip(
    deck: Deck, name: str, surface: str, tolerance: float = ROUNDED_SPAN
) -> str:
    """Return a clause on a device that reaches beyond the tip of its surface, empty if none does.

    Parameters
    ----------
    deck : Deck
    name : str
        Namelist of the device, ``SYMFLP`` or ``ASYFLP``.
    surface : str
        Namelist of the planform, ``WGPLNF`` or ``HTPLNF``.
    tolerance : float
        Part of the semispan that a device may reach beyond the tip. By default the rounding of the
        last printed digit.
    """
    outer, tip = deck.value(name, "SPANFO"), deck.value(surface, "SSPN")
    if outer is None or tip is None or outer <= tip * (1.0 + tolerance):
        return ""
    return f"${name}: SPANFO={outer:g} lies beyond the tip, SSPN={tip:g} of ${surface}"


def describe_chord_beyond_surface(
    deck: Deck, name: str, surface: str, tolerance: float = ROUNDED_SPAN
) -> str:
    """Return a clause on a device with a larger chord than its surface, empty if none has.

    The flap of a wing may end inside the tip of the tail, and is yet no device of the tail.

    Parameters
    ----------
    deck : Deck
    name : str
        Namelist of the device, ``SYMFLP`` or ``ASYFLP``.
    surface : str
        Namelist of the planform, ``WGPLNF`` or ``HTPLNF``.
    tolerance : float
        Part of the chord of the surface by which the device may be larger.
    """
    for end in "IO":
        chord, station = deck.value(name, f"CHRDF{end}"), deck.value(name, f"SPANF{end}")
        if chord is None or station is None:
            continue
        local = _local_chord(deck, surface, station)
        if local is not None and chord > local * (1.0 + tolerance):
            return (
                f"${name}: CHRDF{end}={chord:g} is larger than the chord {local:.4g} of "
                f"${surface} at SPANF{end}={station:g}"
            )
    return ""


def _local_chord(deck: Deck, surface: str, station: float) -> float | None:
    """Return the chord of a planform at a span station, None if the deck does not give it."""
    tip = deck.value(surface, "SSPN")
    chords = [deck.value(surface, "CHRDR"), deck.value(surface, "CHRDTP")]
    if not tip or None in chords:
        return None
    stations = [0.0, tip]
    outboard, crank = deck.value(surface, "SSPNOP"), deck.value(surface, "CHRDBP")
    # A straight planform ignores a break.
    is_broken = round(deck.value(surface, "TYPE") or 1.0) != 1
    if is_broken and outboard and crank is not None:
        stations.insert(1, tip - outboard)
        chords.insert(1, crank)
    return float(np.interp(station, stations, np.array(chords, float)))


def has_thrust(deck: Deck) -> bool:
    """Return whether a deck has engines with a thrust coefficient other than zero.

    The program takes a coefficient or a number of engines that the deck does not give as zero.
    """
    for name, letter in (("JETPWR", "J"), ("PROPWR", "P")):
        count, coefficient = deck.value(name, f"NENGS{letter}"), deck.value(name, f"THSTC{letter}")
        if count and coefficient:
            return True
    return False


def _device_namelist(deck: Deck) -> str:
    """Return the namelist of the control device of a case, empty without one."""
    for name in ("SYMFLP", "ASYFLP"):
        if name in deck.namelists:
            return name
    return ""


def check_control_tabs(deck: Deck) -> Iterator[DeckFinding]:
    """Yield control tabs without the plain flap they need."""
    if "CONTAB" in deck.namelists and deck.value("SYMFLP", "FTYPE") != 1.0:
        text = (
            "$CONTAB needs $SYMFLP with FTYPE=1.0 (plain flap); the program leaves the tabs "
            "out and prints ERROR"
        )
        yield DeckFinding(deck.line_of("CONTAB"), ERROR, text)


def check_trim_card(deck: Deck) -> Iterator[DeckFinding]:
    """Yield TRIM without anything to trim with."""
    if not deck.has("TRIM") or "SYMFLP" in deck.namelists:
        return
    # An elevator or a movable stabilizer trims; ailerons do not.
    line = next(card.line for card in deck.cards if card.name == "TRIM")
    if "ASYFLP" in deck.namelists:
        yield DeckFinding(
            line,
            WARNING,
            "TRIM with $ASYFLP: the program does not trim; it needs $SYMFLP, or HINAX of $SYNTHS",
        )
    elif "HTPLNF" not in deck.namelists or deck.value("SYNTHS", "HINAX") is None:
        yield DeckFinding(
            line,
            WARNING,
            "TRIM without device: it needs $SYMFLP, or $HTPLNF with HINAX of $SYNTHS for an "
            "all-movable stabilizer",
        )


# Regimes of Mach number in which the program prints no pages over ground.
_NO_GROUND_PAGES = (
    (
        "supersonic",
        ERROR,
        "the program prints no static page at all, and no message; take out $GRNDEF or "
        "the Mach number",
    ),
    ("transonic", WARNING, "the program prints the page in free air only"),
)


def _check_ground_regimes(deck: Deck) -> Iterator[DeckFinding]:
    """Yield Mach numbers without pages over ground."""
    machs = deck.schedule("FLTCON", "MACH", "NMACH")
    for regime, severity, effect in _NO_GROUND_PAGES:
        texts = [f"{mach:g}" for mach in machs if deck.regime(mach) == regime]
        if texts:
            yield DeckFinding(
                deck.line_of("GRNDEF"),
                severity,
                f"$GRNDEF at Mach {', '.join(texts)} ({regime}): {effect}",
            )


def check_ground_pages(deck: Deck) -> Iterator[DeckFinding]:
    """Yield ground pages that are wrong, or that cannot be distinguished."""
    if not deck.values("GRNDEF", "GRDHT"):
        return
    line = deck.line_of("GRNDEF")
    name = _device_namelist(deck)
    deflections = 0
    if name:
        deflections = deck.count(name, "NDELTA") or 0
    if deflections > 1:
        has_tail = deck.namelists.keys() >= {"WGPLNF", "HTPLNF"}
        on_wing = name == "SYMFLP" and not has_tail
        # The heading shows the deflection of a wing flap only.
        which = " with identical headings"
        advice = f"leave out ${name}, it has no effect there"
        if on_wing:
            which = ""
            advice = "make one deck per deflection (datcom split)"
        text = (
            f"$GRNDEF with {deflections} deflections of ${name}: the heights are printed "
            f"{deflections} times{which}, and every deflection "
            f"but the first holds the ground effect of those before; {advice}"
        )
        yield DeckFinding(line, WARNING, text)
    yield from _check_ground_regimes(deck)
    if deck.dim in DIMENSIONS[1:]:
        text = f"$GRNDEF with DIM {deck.dim}: the program prints ground heights in feet"
        yield DeckFinding(line, WARNING, text)


def check_weight_units(deck: Deck) -> Iterator[DeckFinding]:
    """Yield a weight that the program converts again and again."""
    if deck.value("FLTCON", "WT") is not None and deck.dim in ("M", "CM"):
        text = (
            f"$FLTCON: WT with DIM {deck.dim}: the program converts it again at every "
            f"condition; do not use the printed weights"
        )
        yield DeckFinding(deck.line_of("FLTCON", "WT"), WARNING, text)


RULES = (
    check_required_namelists,
    check_planform_sections,
    check_section_digits,
    planform_types,
    check_body_sections,
    check_reference_quantities,
    flap_span,
    check_control_tabs,
    check_trim_card,
    check_ground_pages,
    check_weight_units,
)
