"""Rules of the aircraft: namelists that need each other, body, reference quantities, control
devices, ground effect, trim.
"""

from __future__ import annotations

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
_TYPES = 4  # straight, double delta, cranked, curved


def is_special(deck: Deck) -> bool:
    """Return whether the case is one that needs no aircraft: low aspect ratio wing, hypersonic flap
    or transverse jet.
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
        planform, section = f"{prefix}PLNF", f"{prefix}SCHR"
        has_section = section in deck.namelists or letter in deck.sections
        if planform in deck.namelists and not has_section:
            # the program itself tests wing and horizontal tail only
            severity, what_next = (
                (ERROR, "the program leaves the case out")
                if letter in "WH"
                else (WARNING, "the program does not notice")
            )
            text = (
                f"${planform} without section: neither ${section} nor a NACA {letter} card "
                f"for the {what}; {what_next}"
            )
            yield DeckFinding(
                deck.line_of(planform), severity if not is_special(deck) else WARNING, text
            )
        if has_section and planform not in deck.namelists:
            severity = WARNING if letter == "F" or is_special(deck) else ERROR
            line = (
                deck.line_of(section)
                if section in deck.namelists
                else _line_of_section(deck, letter)
            )
            text = f"a section for the {what} without ${planform}"
            yield DeckFinding(
                line,
                severity,
                text + ("; the program leaves the case out" if severity == ERROR else ""),
            )


def _line_of_section(deck: Deck, letter: str) -> int:
    return next(
        card.line
        for card in reversed(deck.cards)
        if card.name == "NACA" and card.text[:1] == letter
    )


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
    given = {name for name in "RSP" if deck.value("BODY", name) is not None}
    if given not in ({"R"}, {"S"}, {"R", "S", "P"}):
        found = ", ".join(sorted(given)) or "none of them"
        text = (
            f"$BODY: of R, S and P there is {found}; give R alone, S alone, or all three: the "
            f"program does not run the case"
        )
        yield DeckFinding(deck.line_of("BODY"), ERROR, text)
    if not deck.values("BODY", "X"):
        yield DeckFinding(deck.line_of("BODY"), ERROR, "$BODY: no stations X; give NX and X(1)=...")


def check_reference_quantities(deck: Deck) -> Iterator[DeckFinding]:
    """Yield reference quantities left to the program; readers that take them from the deck fail."""
    if is_special(deck):
        return
    what = {
        "SREF": "theoretical wing area",
        "CBARR": "theoretical mean chord of the wing",
        "BLREF": "wing span",
    }
    missing = [name for name in what if deck.value("OPTINS", name) is None]
    if missing and "FLTCON" in deck.namelists:
        taken = ", ".join(f"the {what[name]} for {name}" for name in missing)
        text = (
            f"$OPTINS: {', '.join(missing)} not given; the program takes {taken}, and readers "
            f"that look in the deck fail: write them"
        )
        yield DeckFinding(deck.line_of("OPTINS"), WARNING, text)


def flap_span(deck: Deck) -> Iterator[DeckFinding]:
    """Yield a flap that begins inside the body, as the program tests it in single precision."""
    name = next((name for name in ("SYMFLP", "ASYFLP") if name in deck.namelists), "")
    if not name or round(deck.value("ASYFLP", "STYPE") or 0) == _DIFFERENTIAL_TAIL:
        return
    surface = "HTPLNF" if "HTPLNF" in deck.namelists else "WGPLNF"
    tip, exposed = deck.value(surface, "SSPN"), deck.value(surface, "SSPNE")
    if tip is None or exposed is None:
        return
    side = np.float32(tip) - np.float32(exposed)
    inner = np.float32(deck.value(name, "SPANFI") or 0.0)
    if inner < side:
        rounding = (
            " (by rounding alone: write a little more)"
            if float(side) - float(inner) < 1e-5 * tip
            else ""
        )
        text = (
            f"${name}: SPANFI={inner:g} lies inside the body, which reaches to SSPN - SSPNE = "
            f"{side:g} of ${surface}{rounding}"
        )
        yield DeckFinding(
            deck.line_of(name, "SPANFI"),
            WARNING,
            f"{text}; the program prints ERROR and computes with {side:g}: write it",
        )
    outer = deck.value(name, "SPANFO")
    if outer is not None and outer > tip * 1.0001:
        text = f"${name}: SPANFO={outer:g} lies beyond the tip, SSPN={tip:g} of ${surface}"
        hint = (
            "; with a wing and a horizontal tail the program puts the device on the tail"
            if surface == "HTPLNF"
            else ""
        )
        yield DeckFinding(deck.line_of(name, "SPANFO"), WARNING, text + hint)


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


def _ground_by_regime(deck: Deck) -> Iterator[DeckFinding]:
    """Yield Mach numbers without pages over ground."""
    machs = deck.schedule("FLTCON", "MACH", "NMACH")
    for regime, severity, effect in (
        (
            "supersonic",
            ERROR,
            "the program prints no static page at all, and no message; take out $GRNDEF or "
            "the Mach number",
        ),
        ("transonic", WARNING, "the program prints the page in free air only"),
    ):
        if found := [f"{mach:g}" for mach in machs if deck.regime(mach) == regime]:
            yield DeckFinding(
                deck.line_of("GRNDEF"),
                severity,
                f"$GRNDEF at Mach {', '.join(found)} ({regime}): {effect}",
            )


def check_ground_pages(deck: Deck) -> Iterator[DeckFinding]:
    """Yield ground pages that are wrong, or that cannot be distinguished."""
    heights = deck.values("GRNDEF", "GRDHT")
    name = next((name for name in ("SYMFLP", "ASYFLP") if name in deck.namelists), "")
    deflections = (deck.count(name, "NDELTA") if name else None) or 0
    if heights and deflections > 1:
        on_tail = name == "SYMFLP" and {"WGPLNF", "HTPLNF"} <= deck.namelists.keys()
        which = " with identical headings" if on_tail or name == "ASYFLP" else ""
        advice = (
            "make one deck per deflection (datcom split)"
            if name == "SYMFLP" and not on_tail
            else f"leave out ${name}, it has no effect there"
        )
        text = (
            f"$GRNDEF with {deflections} deflections of ${name}: the heights are printed "
            f"{deflections} times{which}, and every deflection "
            f"but the first holds the ground effect of those before; {advice}"
        )
        yield DeckFinding(deck.line_of("GRNDEF"), WARNING, text)
    if heights:
        yield from _ground_by_regime(deck)
    if heights and deck.dim in DIMENSIONS[1:]:
        yield DeckFinding(
            deck.line_of("GRNDEF"),
            WARNING,
            f"$GRNDEF with DIM {deck.dim}: the program prints ground heights in feet",
        )


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
    planform_types,
    check_body_sections,
    check_reference_quantities,
    flap_span,
    check_control_tabs,
    check_trim_card,
    check_ground_pages,
    check_weight_units,
)
