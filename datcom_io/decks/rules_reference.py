"""Reference quantities of a deck against its planform, and devices of another kind than meant.

The program divides by SREF, CBARR and BLREF as they are given. A root chord in CBARR, a semispan in
BLREF or half an area in SREF make every moment wrong, and nothing in the print shows it.
"""

from __future__ import annotations

from collections.abc import Iterator

from datcom_io.decks.cards import WARNING, DeckFinding
from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import measure_main_wing, measure_surface

# Ratio of a reference quantity to that of the planform cards. Of 25 public and own aeroplanes the
# sound ones have 0.86 to 1.2 of the area, 0.86 to 1.08 of the chord and 0.94 to 1.06 of the span.
_RANGES = {"SREF": (0.7, 1.4), "CBARR": (0.75, 1.3), "BLREF": (0.85, 1.2)}
_WHAT = {
    "SREF": "the area of the planform",
    "CBARR": "the mean aerodynamic chord of the planform",
    "BLREF": "the span of the planform",
}
# When both others are those of the planform, the third one is narrower: an area and a span are then
# rounded only, and a chord is at least the mean geometric one of a cranked wing, 0.88.
_AGREEING = 0.015
_NARROW_RANGES = {"SREF": (0.97, 1.03), "CBARR": (0.86, 1.05), "BLREF": (0.97, 1.03)}
# A reference quantity this near to another number of the planform is that number.
_EQUAL = 0.02
SLENDER = 5.0  # aspect ratio of a wing of an aeroplane other than a fighter
LEAST_VOLUME, LEAST_VOLUME_FIGHTER = 0.3, 0.2
"""Tail volumes, arm x area over area x mean chord of the wing, below which they are stated.

Of 161 public and own cases the least of a tail behind the wing is 0.24, of two fighters.
"""
_FEET_IN_METRE = 1.0 / 0.3048
_SPOILERS, _DIFFERENTIAL_TAIL = (1, 2, 3), 5  # STYPE of ASYFLP


def describe_reference_quantities(deck: Deck) -> dict[str, str]:
    """Return a clause for each reference quantity that is not that of the planform, by variable."""
    wing = measure_main_wing(deck)
    if wing is None:
        return {}
    planform = {"SREF": wing.area, "CBARR": wing.mean_chord, "BLREF": wing.span}
    # Usual mistakes, which the clause names.
    others = {
        "SREF": {"half of it": 0.5 * wing.area, "twice that": 2.0 * wing.area},
        "CBARR": {"the root chord": wing.root_chord},
        "BLREF": {"the semispan": 0.5 * wing.span, "the mean chord": wing.mean_chord},
    }
    for name, power in (("SREF", 2), ("CBARR", 1), ("BLREF", 1)):
        factor, square = _FEET_IN_METRE**power, "2" if power == 2 else ""
        others[name][f"that in ft{square}, with a planform in m"] = planform[name] * factor
        others[name][f"that in m{square}, with a planform in ft"] = planform[name] / factor
    half = 0.5 * wing.span
    ratios = {}
    for name, measured in planform.items():
        given = deck.value("OPTINS", name)
        if given is not None:
            ratios[name] = given / measured
    # With a whole span in SSPN the planform has twice the area too.
    if abs(ratios.get("SREF", 1.0) - 0.5) <= _EQUAL:
        others["BLREF"] = {f"SSPN={half:g}, which is the semispan: write half the span": half}
    clauses = {}
    for name, measured in planform.items():
        given = deck.value("OPTINS", name)
        low, high = _RANGES[name]
        agreeing = [abs(ratio - 1.0) <= _AGREEING for key, ratio in ratios.items() if key != name]
        if len(agreeing) == 2 and all(agreeing):
            low, high = _NARROW_RANGES[name]
        if given is None or low * measured <= given <= high * measured:
            continue
        text = f"$OPTINS: {name}={given:g} is {given / measured:.3g} times {_WHAT[name]}"
        text += f", {measured:.4g}"
        for what, value in others[name].items():
            if abs(given / value - 1.0) <= _EQUAL:
                text += f" (it is {what})"
        clauses[name] = f"{text}; all coefficients are divided by it, so check it"
    return clauses


def check_reference_planform(deck: Deck) -> Iterator[DeckFinding]:
    """Yield reference quantities that are not those of the planform."""
    for name, text in describe_reference_quantities(deck).items():
        yield DeckFinding(deck.line_of("OPTINS", name), WARNING, text)


def check_device_style(deck: Deck) -> Iterator[DeckFinding]:
    """Yield an ASYFLP whose STYPE needs numbers or a surface that the deck does not have."""
    if "ASYFLP" not in deck.namelists:
        return
    style = round(deck.value("ASYFLP", "STYPE") or 0.0)
    line = deck.line_of("ASYFLP", "STYPE")
    if style in _SPOILERS and not any(deck.values("ASYFLP", "DELTAS")):
        text = f"$ASYFLP: STYPE={style} is a spoiler, and no height DELTAS is given: the program "
        text += "prints one moment for no spoiler at all; give DELTAS, XSOC and HSOC, or STYPE=4.0 "
        yield DeckFinding(line, WARNING, f"{text}for an aileron with DELTAL and DELTAR")
    if style == _DIFFERENTIAL_TAIL and "HTPLNF" not in deck.namelists:
        text = (
            "$ASYFLP: STYPE=5 deflects the halves of a horizontal tail, and there is no $HTPLNF: "
        )
        text += "the program prints moments of zero"
        yield DeckFinding(line, WARNING, f"{text}; give it, or STYPE=4.0 for an aileron")


def check_positions(deck: Deck) -> Iterator[DeckFinding]:
    """Yield a tail, a fin or a centre of gravity in an unusual place: a lost digit of an X card."""
    for name, text in _position_texts(deck):
        yield DeckFinding(deck.line_of("SYNTHS", name), WARNING, f"$SYNTHS: {text}")


def _position_texts(deck: Deck) -> Iterator[tuple[str, str]]:
    """Yield a variable of SYNTHS and what is unusual of it."""
    cg, stations = deck.value("SYNTHS", "XCG"), deck.values("BODY", "X")
    if cg is not None and len(stations) > 1 and not min(stations) <= cg <= max(stations):
        yield (
            "XCG",
            f"XCG={cg:g} is outside of the body, whose X is {min(stations):g} ... "
            f"{max(stations):g}; all moments are about it, so check the decimal point and the unit",
        )
    apex, root = deck.value("SYNTHS", "XV"), deck.value("VTPLNF", "CHRDR")
    if cg is None or apex is None or root is None:
        is_in_front = False
    else:
        is_in_front = apex + root < cg <= max(stations, default=cg)
    if is_in_front:
        yield (
            "XV",
            f"XV={apex:g} with CHRDR={root:g} puts the fin in front of XCG={cg:g}; a fin is "
            f"behind it, so check both",
        )
    wing, tail = measure_surface(deck, "WGPLNF"), measure_surface(deck, "HTPLNF")
    # a canard configuration has its main wing in HTPLNF
    if wing is None or tail is None or tail.area >= wing.area:
        return
    quarters = [one.leading_edge + 0.25 * one.mean_chord for one in (wing, tail)]
    arm = quarters[1] - quarters[0]
    volume = arm * tail.area / (wing.area * wing.mean_chord)
    place = f"XH={deck.value('SYNTHS', 'XH') or 0.0:g} puts the quarter chord of the tail"
    if arm <= 0.0:
        yield (
            "XH",
            f"{place} {-arm:.4g} in front of that of the wing, and the wing is the larger surface; "
            f"check XH and XW, unless it is a canard",
        )
    elif volume < (LEAST_VOLUME if wing.aspect_ratio > SLENDER else LEAST_VOLUME_FIGHTER):
        yield (
            "XH",
            f"{place} {arm:.4g} behind that of the wing: a tail volume of {volume:.2g}, usual is "
            f"0.4 to 1.2; check XH and XW",
        )


RULES = (check_reference_planform, check_device_style, check_positions)
