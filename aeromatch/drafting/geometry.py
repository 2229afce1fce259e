"""What the cards of DATCOM decks, and the headings of listings, say about an aircraft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aerodb.prior import Assignment, assign_roles
from datcom_io import Deck, read, read_deck
from flightmech.units import to_si

_LENGTHS = {"FT": "ft", "IN": "in", "M": "m", "CM": "cm"}
_ENOUGH_WORDS = 3  # of a CASEID card that make the name of an aircraft


@dataclass(frozen=True)
class Geometry:
    """Reference quantities and places from cards.

    Attributes
    ----------
    S, cbar, b : float or None
        Reference area, chord, span. [m2, m, m]
    reference : tuple of float (3,) or None
        Moment reference point from the drawing datum, body directions. [m]
    x_ref_mac : float or None
        Its place behind the leading edge of the mean chord of the wing, in chords. [1]
    engines : tuple of (3,)
        Where the thrust acts by JETPWR or PROPWR, from the moment reference point. [m]
    surfaces : dict of str to (S_hinge, c_hinge)
        Area behind the hinge and its mean chord, of the elevator and the aileron. [m2, m]
    flap : float or None
        Largest deflection of the flaps in the listings. [rad]
    title : str
        Of the first case.
    roles : tuple of Assignment
        What every case of the listings was taken for; empty without listings.
    places : dict of str to list of str
        By role, ``FILE`` or ``FILE:NUMBER`` with the path of the file.
    powered : bool
        Whether the clean pages are computed with power.
    """

    S: float | None = None
    cbar: float | None = None
    b: float | None = None
    reference: tuple[float, float, float] | None = None
    x_ref_mac: float | None = None
    engines: tuple[tuple[float, float, float], ...] = ()
    surfaces: dict[str, tuple[float, float]] = field(default_factory=dict)
    flap: float | None = None
    title: str = ""
    roles: tuple[Assignment, ...] = ()
    places: dict[str, list[str]] = field(default_factory=dict)
    powered: bool = False


def geometry_of(listings: Sequence[Path], decks: Sequence[Path]) -> Geometry:
    """Return what listings, and decks where there are no listings, say.

    Raises
    ------
    ParseError
        A file is damaged, or none.
    SchemaError
        The listings belong to several aircraft.
    """
    read_in = {path: read(path) for path in listings}
    roles = tuple(assign_roles(read_in.values())) if read_in else ()
    owner = {id(case): path for path, listing in read_in.items() for case in listing.cases}
    lone = {path for path, listing in read_in.items() if len(listing.cases) == 1}
    places: dict[str, list[str]] = {}
    for item in roles:
        path = owner[id(item.case)]
        for role in item.roles:
            places.setdefault(role, []).append(str(path) if path in lone else f"{path}:{item.case.ordinal}")
    clean = next((item.case for item in roles if "clean" in item.roles), None)
    cards = [case.deck for item in roles for case in [item.case]] + [deck for path in decks for deck in read_deck(path)]
    main = clean.deck if clean is not None else max(cards, key=lambda deck: len(deck.namelists), default=None)
    if main is None:
        return Geometry()
    printed: dict[str, Any] = {str(key): item for key, item in clean.to_datatree().attrs.items()} if clean is not None else {}
    found = _references(main, printed)
    return Geometry(
        **found,
        engines=_engine_places(cards, main),
        surfaces=_surfaces(cards),
        flap=_flap([item.case.deck for item in roles if {"flaps", "ground_flap"} & set(item.roles)]),
        title=clean.name if clean is not None else main.caseid,
        roles=roles,
        places=places,
        powered=clean is not None and any(page.power != "off" for page in clean.pages if page.kind == "static"),
    )


def _references(deck: Deck, printed: dict[str, Any]) -> dict[str, Any]:
    """Return areas, lengths and the reference point; as printed, else as on the cards, else of the wing, as the program takes them."""
    length = _length(deck)
    wing = _planform(deck)
    S, cbar, b = (printed.get(name) for name in ("S", "cbar", "b"))
    card = {name: deck.value("OPTINS", variable) for name, variable in (("S", "SREF"), ("cbar", "CBARR"), ("b", "BLREF"))}
    S = S or (card["S"] * length**2 if card["S"] else wing.get("S"))
    cbar = cbar or (card["cbar"] * length if card["cbar"] else wing.get("cbar"))
    b = b or (card["b"] * length if card["b"] else wing.get("b"))
    x, z = deck.value("SYNTHS", "XCG"), deck.value("SYNTHS", "ZCG")
    if x is None:
        return {"S": S, "cbar": cbar, "b": b}
    at = x * length
    mac = (at - wing["leading_edge"]) / cbar if wing and cbar else None
    return {"S": S, "cbar": cbar, "b": b, "reference": (-at, 0.0, -(z or 0.0) * length + 0.0), "x_ref_mac": mac}


def _length(deck: Deck) -> float:
    """Return the metres in one unit of length of a deck."""
    return float(to_si(1.0, _LENGTHS[deck.dim]))


def _planform(deck: Deck) -> dict[str, float]:
    """Return area, mean chord, span and leading edge of the mean chord of the wing from the drawing datum. [m]

    Notes
    -----
    Straight or cranked: chords are linear between root, break and tip; the mean chord is that of the integral of c^2.
    """
    names = ("CHRDR", "CHRDTP", "SSPN", "SAVSI", "CHSTAT")
    root, tip, half, sweep, station = (deck.value("WGPLNF", name) for name in names)
    apex = deck.value("SYNTHS", "XW")
    if root is None or tip is None or half is None or sweep is None or apex is None:
        return {}
    outer = deck.value("WGPLNF", "SSPNOP") or 0.0
    middle = deck.value("WGPLNF", "CHRDBP")
    y, c, sweeps = [0.0, half], [root, tip], [sweep]
    if outer > 0.0 and middle is not None:
        y, c, sweeps = [0.0, half - outer, half], [root, middle, tip], [sweep, deck.value("WGPLNF", "SAVSO") or sweep]
    edge = [apex]
    for k, angle in enumerate(sweeps):  # the sweep is that of the line at CHSTAT of the chord
        span = y[k + 1] - y[k]
        edge.append(edge[-1] + span * np.tan(np.radians(angle)) - (station or 0.0) * (c[k + 1] - c[k]))
    fine = np.linspace(0.0, half, 2001)
    chord, lead = np.interp(fine, y, c), np.interp(fine, y, edge)
    area = np.trapezoid(chord, fine)
    mean = float(np.trapezoid(chord**2, fine) / area)
    at = float(np.trapezoid(chord * lead, fine) / area)
    unit = _length(deck)
    return {"S": 2.0 * float(area) * unit**2, "cbar": mean * unit, "b": 2.0 * half * unit, "leading_edge": at * unit}


def _engine_places(cards: Sequence[Deck], main: Deck) -> tuple[tuple[float, float, float], ...]:
    """Return where jets or propellers push, from the moment reference point."""
    names = {"JETPWR": ("NENGSJ", "JEALOC", "JELLOC", "JEVLOC"), "PROPWR": ("NENGSP", "PHALOC", "YP", "PHVLOC")}
    for deck in cards:
        for namelist, (count, along, aside, up) in names.items():
            x, y, z = (deck.value(namelist, name) for name in (along, aside, up))
            if x is None:
                continue
            unit = _length(deck)
            x0, z0 = main.value("SYNTHS", "XCG") or 0.0, main.value("SYNTHS", "ZCG") or 0.0
            place = ((x0 - x) * unit, (y or 0.0) * unit, (z0 - (z or 0.0)) * unit)
            lone = round(deck.value(namelist, count) or 1.0) < 2
            return (place,) if lone else ((place[0], -abs(place[1]), place[2]), (place[0], abs(place[1]), place[2]))
    return ()


def _surfaces(cards: Sequence[Deck]) -> dict[str, tuple[float, float]]:
    """Return area and mean chord behind the hinge of elevator (SYMFLP on the tail) and ailerons (ASYFLP), both sides together."""
    found = {}
    for deck in cards:
        for namelist, name in (("SYMFLP", "delta_e"), ("ASYFLP", "delta_a")):
            values = [deck.value(namelist, key) for key in ("CHRDFI", "CHRDFO", "SPANFI", "SPANFO")]
            if name in found or any(value is None for value in values) or (name == "delta_e" and not _on_tail(deck)):
                continue
            inner, outer, start, end = (float(value) for value in values if value is not None)
            unit = _length(deck)
            found[name] = (inner + outer) * (end - start) * unit**2, 0.5 * (inner + outer) * unit
    return found


def _flap(decks: Sequence[Deck]) -> float | None:
    """Return the largest deflection of the flaps. [rad]"""
    angles = [angle for deck in decks for angle in deck.schedule("SYMFLP", "DELTA", "NDELTA") if np.isfinite(angle)]
    return float(np.radians(max(angles))) if angles else None


def _on_tail(deck: Deck) -> bool:
    from datcom_io.arrays.conditions import control_surface

    return "SYMFLP" in deck.namelists and control_surface(deck) == "tail"
