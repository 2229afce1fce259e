"""Sizes, places, angles and conditions of a deck that no aeroplane has.

The program computes with any number. A lost digit, a wrong sign, a whole span for a half one, a
number in per cent or in radians, or a card of another unit changes every table, and nothing in the
print shows it. The limits are wider than the extremes of 103 public and own cases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from datcom_io.decks.cards import WARNING, DeckFinding
from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import WingPlanform, measure_main_wing, measure_surface

Doubt = tuple[str, str, str]
"""Namelist, variable and what is unusual of it."""

_NAMES = {
    "WGPLNF": "wing",
    "HTPLNF": "horizontal tail",
    "VTPLNF": "vertical tail",
    "VFPLNF": "ventral fin",
}
_HEIGHT_MARGINS = {"ZW": 0.08, "ZH": 0.03, "ZV": 0.08, "ZCG": 0.03}
"""Parts of the span by which a surface may lie above or below body and fin."""
_STEEP_SWEEP, _FORWARD_SWEEP, _UNSWEPT = 80.0, 12.0, 15.0  # deg
_MOST_DIHEDRAL, _MOST_INCIDENCE, _MOST_TWIST = 15.0, 12.0, 12.0  # deg
_LEAST_INCIDENCE = 0.09  # deg
_TAIL_V_DIHEDRAL = 55.0  # deg, of a V tail
_TAIL_AREA, _TAIL_ASPECT = 0.4, 0.8
"""Area and aspect ratio over those of the wing: no tail behind a wing is beyond both."""
_LARGEST_FIN = 0.4  # semispan of a fin over the span of the wing
_END, _BOOMS = 0.1, 0.8
"""Parts of the length of the body by which an apex may lie beyond it: of a wing, and of a tail that
booms carry."""
_RADIANS = 0.8
"""Schedules of angles that stay below it are in radians: in degrees they would need no schedule."""
_METRE = {"FT": 0.3048, "IN": 0.0254, "M": 1.0, "CM": 0.01}
_LEAST_REYNOLDS, _MOST_REYNOLDS = 1e4, 1e9  # per metre
_MOST_MACH = 25.0
_HEIGHTS = (-600.0, 120e3)  # m
_LOADINGS = (120.0, 12000.0)
"""Wing loadings of ultralight and of heavy aeroplanes, 2.5 and 250 lbf/ft2. [N/m2]"""
_SMALL_SPAN = 8.0
"""Span below which the loading of a model aeroplane falls with its size. [m]"""
_TEMPERATURES = (150.0, 400.0)  # K


def list_sizes(deck: Deck) -> Iterator[Doubt]:
    """Yield all doubts about the sizes of a case: namelist, variable and text."""
    for look in (_of_heights, _of_stations, _of_planforms, _of_angles, _of_devices, _of_flight):
        yield from look(deck)


def describe_size(deck: Deck) -> str:
    """Return the span of the wing in metres and in the unit of the deck, empty without a wing.

    A deck in feet with ``DIM M`` is sound in itself. Only its size shows the mistake.
    """
    wing = measure_main_wing(deck)
    if wing is None:
        return ""
    text = f"span {wing.span * _METRE[deck.dim]:.4g} m"
    if not any(card.name == "DIM" for card in deck.cards):
        return f"{text} ({wing.span:.4g} {deck.dim.lower()}, without a card DIM)"
    return f"{text} ({wing.span:.4g} with DIM {deck.dim})"


def check_sizes(deck: Deck) -> Iterator[DeckFinding]:
    """Yield sizes, places, angles and conditions that no aeroplane has."""
    for namelist, variable, text in list_sizes(deck):
        line = deck.line_of(namelist, variable)
        yield DeckFinding(line, WARNING, f"${namelist}: {text}")


def _of_heights(deck: Deck) -> Iterator[Doubt]:
    """Yield a surface or a centre of gravity far above or below body and fin."""
    wing = measure_main_wing(deck)
    upper, lower = deck.values("BODY", "ZU"), deck.values("BODY", "ZL")
    radii = deck.values("BODY", "R")
    if wing is None or not ((upper and lower) or radii):
        return
    # a body of radii alone lies about the datum
    top = max(upper) if upper else np.nanmax(radii)
    bottom = min(lower) if lower else -np.nanmax(radii)
    fin_root, fin = deck.value("SYNTHS", "ZV"), deck.value("VTPLNF", "SSPN")
    fin_top = top
    if fin is not None:
        fin_top = max(top, (fin_root or 0.0) + fin)
    limits = {"ZW": top, "ZH": fin_top, "ZV": top, "ZCG": top}
    what = {"ZW": "wing", "ZH": "horizontal tail", "ZV": "root of the fin", "ZCG": "c.g."}
    for name, highest in limits.items():
        height, margin = deck.value("SYNTHS", name), _HEIGHT_MARGINS[name] * wing.span
        if height is None or bottom - margin <= height <= highest + margin:
            continue
        limit = "body and fin" if name == "ZH" and fin is not None else "body"
        yield (
            "SYNTHS",
            name,
            f"{name}={height:g} puts the {what[name]} outside of the {limit}, which has heights "
            f"of {bottom:.4g} to {highest:.4g}; check the decimal point and the sign (up is "
            f"positive)",
        )


def _of_stations(deck: Deck) -> Iterator[Doubt]:
    """Yield an apex outside of the body, and a c.g. far from the mean chord of the wing."""
    stations = [x for x in deck.values("BODY", "X") if math.isfinite(x)]
    if len(stations) > 1:
        first, last = min(stations), max(stations)
        margin = _END * (last - first)
        for name, what in (("XW", "WGPLNF"), ("XH", "HTPLNF"), ("XV", "VTPLNF")):
            apex = deck.value("SYNTHS", name)
            if apex is None or what not in deck.namelists:
                continue
            # the body of an aeroplane with tail booms ends in front of its tail
            behind = margin if name == "XW" else _BOOMS * (last - first)
            if not first - margin <= apex <= last + behind:
                yield (
                    "SYNTHS",
                    name,
                    f"{name}={apex:g} puts the apex of the {_NAMES[what]} outside of the body, "
                    f"whose X is {first:g} ... {last:g}; check the decimal point and the unit",
                )
    wing, tail = measure_surface(deck, "WGPLNF"), measure_surface(deck, "HTPLNF")
    cg = deck.value("SYNTHS", "XCG")
    # a canard configuration, and a wing alone, has its c.g. elsewhere
    if wing is None or tail is None or cg is None or tail.leading_edge < wing.leading_edge:
        return
    # the rule of positions names a c.g. outside of the body
    if stations and not min(stations) <= cg <= max(stations):
        return
    part = (cg - wing.leading_edge) / wing.mean_chord
    if tail.area < wing.area and not -0.5 <= part <= 1.0:
        where = f"{part:.2g} mean chords behind"
        if part < 0.0:
            where = f"{-part:.2g} mean chords in front of"
        yield (
            "SYNTHS",
            "XCG",
            f"XCG={cg:g} is {where} the leading edge of the mean chord of the wing, at "
            f"{wing.leading_edge:.4g}; usual is 0.1 to 0.5 behind it: check XCG and XW",
        )


def _of_planforms(deck: Deck) -> Iterator[Doubt]:
    """Yield a planform with exchanged chords, or with a whole span for a half one."""
    for name, what in _NAMES.items():
        root, tip = deck.value(name, "CHRDR"), deck.value(name, "CHRDTP")
        if root and tip is not None and tip > 1.05 * root:
            yield (
                name,
                "CHRDTP",
                f"CHRDTP={tip:g} is larger than CHRDR={root:g}; the chord of the tip is usually "
                f"the smaller one: check both",
            )
        half, exposed = deck.value(name, "SSPN"), deck.value(name, "SSPNE")
        if half and exposed is not None and exposed > half * (1.0 + 1e-4):
            yield (
                name,
                "SSPNE",
                f"SSPNE={exposed:g} is larger than SSPN={half:g}; the exposed semispan of the "
                f"{what} is that outside of the body: check both",
            )
        station = deck.value(name, "CHSTAT")
        if station is not None and not 0.0 <= station <= 1.0:
            yield (
                name,
                "CHSTAT",
                f"CHSTAT={station:g} is a station of the chord; give a fraction from 0 to 1, "
                f"such as 0.25",
            )
    wing, tail = measure_surface(deck, "WGPLNF"), measure_surface(deck, "HTPLNF")
    if wing is not None and tail is not None:
        yield from _of_tail(wing, tail)
    main, fin = measure_main_wing(deck), deck.value("VTPLNF", "SSPN")
    if main is not None and fin is not None and fin > _LARGEST_FIN * main.span:
        yield (
            "VTPLNF",
            "SSPN",
            f"SSPN={fin:g} is a fin as high as {fin / main.span:.2g} of the span of the wing, "
            f"{main.span:.4g}; usual is 0.14 to 0.3",
        )


def _of_tail(wing: WingPlanform, tail: WingPlanform) -> Iterator[Doubt]:
    """Yield a horizontal tail behind the wing with a whole span for a half one."""
    # the second wing of a tandem, and a canard, lies in front and has any size
    if tail.leading_edge <= wing.leading_edge or tail.area >= wing.area:
        return
    area, aspect = tail.area / wing.area, tail.aspect_ratio / wing.aspect_ratio
    if area > _TAIL_AREA and aspect > _TAIL_ASPECT:
        yield (
            "HTPLNF",
            "SSPN",
            f"SSPN={0.5 * tail.span:g} makes a tail with {area:.2g} of the area of the wing, "
            f"usual is 0.15 to 0.36, and an aspect ratio of {tail.aspect_ratio:.3g}: SSPN is the "
            f"semispan",
        )


def _of_angles(deck: Deck) -> Iterator[Doubt]:
    """Yield sweep, dihedral, twist and incidence of a doubtful size or sign."""
    for name, what in _NAMES.items():
        for variable in ("SAVSI", "SAVSO"):
            sweep = deck.value(name, variable) or 0.0
            if abs(sweep) > _STEEP_SWEEP or sweep < -_FORWARD_SWEEP:
                yield (
                    name,
                    variable,
                    f"{variable}={sweep:g} sweeps the {what} by that angle; usual is 0 to 60 deg, "
                    f"aft positive: check the sign and the unit",
                )
        twist = deck.value(name, "TWISTA") or 0.0
        if abs(twist) > _MOST_TWIST:
            yield (
                name,
                "TWISTA",
                f"TWISTA={twist:g} twists the {what}; usual is -5 to 0 deg, with the nose of the "
                f"tip down negative",
            )
    yield from _of_dihedral(deck)
    for variable in ("ALIW", "ALIH"):
        angle = deck.value("SYNTHS", variable) or 0.0
        if abs(angle) > _MOST_INCIDENCE:
            yield (
                "SYNTHS",
                variable,
                f"{variable}={angle:g} is the incidence; usual is -5 to 5 deg: check the decimal "
                f"point",
            )
        elif 0.0 < abs(angle) < _LEAST_INCIDENCE:
            yield (
                "SYNTHS",
                variable,
                f"{variable}={angle:g} is an incidence that no jig holds; the program takes "
                f"degrees: {angle:g} rad is {math.degrees(angle):.3g} deg",
            )


def _of_dihedral(deck: Deck) -> Iterator[Doubt]:
    """Yield a steep dihedral, and a wing without sweep whose tips point down."""
    for name, most in (("WGPLNF", _MOST_DIHEDRAL), ("HTPLNF", _TAIL_V_DIHEDRAL)):
        for variable in ("DHDADI", "DHDADO"):
            dihedral = deck.value(name, variable) or 0.0
            if abs(dihedral) > most:
                yield (
                    name,
                    variable,
                    f"{variable}={dihedral:g} is a dihedral of the {_NAMES[name]}; usual is 0 to "
                    f"10 deg: check the decimal point",
                )
    inner, wing = deck.value("WGPLNF", "DHDADI") or 0.0, measure_surface(deck, "WGPLNF")
    # an inverted gull wing: its outer panels point up
    outer, panel = (deck.value("WGPLNF", name) or 0.0 for name in ("DHDADO", "SSPNOP"))
    is_gull = outer > 0.0 and panel > 0.0
    if wing is None or is_gull or not -_MOST_DIHEDRAL <= inner < 0.0:
        return
    # Swept wings on top of the body have anhedral, unswept ones of aeroplanes have none.
    if abs(math.degrees(wing.sweep)) < _UNSWEPT:
        yield (
            "WGPLNF",
            "DHDADI",
            f"DHDADI={inner:g} points the tips of a wing without sweep down; usual is 0 to 8 deg, "
            f"positive with the tips up: check the sign",
        )


def _of_devices(deck: Deck) -> Iterator[Doubt]:
    """Yield deflections in radians, and a thickness or a balance larger than its chord allows."""
    for name in ("SYMFLP", "ASYFLP"):
        for variable in ("DELTA", "DELTAL", "DELTAR"):
            yield from _of_schedule(deck, name, variable, "deflections")
        chord = deck.value(name, "CHRDFI")
        for variable, most, what in (
            ("TC", 0.5, "the thickness of the device at its hinge"),
            ("CB", 1.0, "the chord of its balance"),
        ):
            size = deck.value(name, variable)
            if size is not None and chord and size > most * chord:
                yield (
                    name,
                    variable,
                    f"{variable}={size:g} is {what} in the length of the deck, and the chord "
                    f"CHRDFI is {chord:g}: check the decimal point and the unit",
                )
        for variable in ("PHETE", "PHETEP"):
            tangent = deck.value(name, variable) or 0.0
            if abs(tangent) > 1.0:
                yield (
                    name,
                    variable,
                    f"{variable}={tangent:g} is the tangent of half the angle at the trailing "
                    f"edge; usual is 0.03 to 0.25: give the tangent",
                )


def _of_schedule(deck: Deck, name: str, variable: str, what: str) -> Iterator[Doubt]:
    """Yield angles whose schedule is in radians."""
    angles = [abs(x) for x in deck.values(name, variable) if math.isfinite(x)]
    if len(angles) >= 3 and 0.0 < max(angles) < _RADIANS:
        yield (
            name,
            variable,
            f"{variable} has {len(angles)} {what} up to {max(angles):g}; the program takes "
            f"degrees: {max(angles):g} rad is {math.degrees(max(angles)):.3g} deg",
        )


def _of_flight(deck: Deck) -> Iterator[Doubt]:
    """Yield Mach and Reynolds numbers, speeds, altitudes and weights that no aeroplane has."""
    yield from _of_schedule(deck, "FLTCON", "ALSCHD", "angles of attack")
    metre = _METRE[deck.dim]
    low, high = _LEAST_REYNOLDS * metre, _MOST_REYNOLDS * metre
    reynolds = _outside(deck, "RNNUB", low, high)
    if reynolds is not None:
        text = (
            f"RNNUB={reynolds:g} is a Reynolds number per length of the deck; usual is 1E5 to 1E8"
        )
        advice = "check the exponent"
        if reynolds < _MOST_MACH:
            advice = "write a Mach number as MACH"
        yield "FLTCON", "RNNUB", f"{text}: {advice}"
    mach = _outside(deck, "MACH", 0.0, _MOST_MACH)
    if mach is not None:
        yield (
            "FLTCON",
            "MACH",
            f"MACH={mach:g} is beyond the Mach numbers of aeroplanes; usual is 0.1 to 5: write a "
            f"speed as VINF",
        )
    speed = _outside(deck, "VINF", 5.0 / metre, math.inf)
    if speed is not None:
        yield (
            "FLTCON",
            "VINF",
            f"VINF={speed:g} is {speed * metre:.3g} m/s with DIM {deck.dim}; write a Mach number "
            f"as MACH",
        )
    height = _outside(deck, "ALT", _HEIGHTS[0] / metre, _HEIGHTS[1] / metre)
    if height is not None:
        yield (
            "FLTCON",
            "ALT",
            f"ALT={height:g} is {height * metre / 1e3:.4g} km with DIM {deck.dim}; usual is 0 to "
            f"20 km, here up to {20e3 / metre:.3g}: check the unit",
        )
    yield from _of_temperature(deck)
    yield from _of_weight(deck)


def _of_temperature(deck: Deck) -> Iterator[Doubt]:
    """Yield an air temperature that is not an absolute one."""
    # kelvin with metres, degrees Rankine with feet
    kelvin, unit, usual = (1.8, "deg R", "519") if deck.dim == "FT" else (1.0, "K", "288")
    low, high = (limit * kelvin for limit in _TEMPERATURES)
    temperature = _outside(deck, "TINF", low, high)
    if temperature is not None and deck.dim in ("FT", "M"):
        yield (
            "FLTCON",
            "TINF",
            f"TINF={temperature:g} is an absolute temperature in {unit} with DIM {deck.dim}; at "
            f"sea level it is {usual}",
        )


def _of_weight(deck: Deck) -> Iterator[Doubt]:
    """Yield a weight that makes no wing loading of an aeroplane."""
    weight, wing = deck.value("FLTCON", "WT"), measure_main_wing(deck)
    if not weight or wing is None:
        return
    # pounds with feet and inches, newtons with metres and centimetres
    newton, unit = (4.44822, "lb") if deck.dim in ("FT", "IN") else (1.0, "N")
    metre = _METRE[deck.dim]
    loading = weight * newton / (wing.area * metre**2)
    low, high = _LOADINGS
    low *= min(1.0, wing.span * metre / _SMALL_SPAN)
    if not low <= loading <= high:
        yield (
            "FLTCON",
            "WT",
            f"WT={weight:g} {unit} is a wing loading of {loading:.3g} N/m2 ({loading / 47.88:.3g} "
            f"lb/ft2); usual is {low:.3g} to {high:g} N/m2: the weight is in lb with DIM FT, in N "
            f"with DIM M",
        )


def _outside(deck: Deck, variable: str, low: float, high: float) -> float | None:
    """Return the first value of FLTCON outside of a range, None without one."""
    values = [x for x in deck.values("FLTCON", variable) if math.isfinite(x)]
    return next((x for x in values if not low <= x <= high), None)


RULES: tuple[Callable[[Deck], Iterator[DeckFinding]], ...] = (check_sizes,)
