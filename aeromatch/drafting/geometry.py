"""Reference quantities, positions and roles of an aircraft from listings and decks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import aerodb
from aerodb.prior.roles import CaseRole, assign_roles
from datcom_io.arrays.conditions import control_surface
from datcom_io.decks.aircraft_rules import has_thrust
from datcom_io.decks.deck import Deck
from datcom_io.decks.deck_file import read_deck
from datcom_io.decks.device_fit import IS_FLAP, describe_misfit, weigh_device_on_tail
from datcom_io.decks.planforms import measure_main_wing
from datcom_io.listing import Case
from datcom_io.reading.reader import read
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError
from flightmech.support.kept_stages.captured_warnings import capture_warnings
from flightmech.units import to_si

_LENGTHS = {"FT": "ft", "IN": "in", "M": "m", "CM": "cm"}
_AILERON = 4  # STYPE of ASYFLP
# By namelist: number of engines; longitudinal, lateral and vertical position.
_ENGINE_VARIABLES = {
    "JETPWR": ("NENGSJ", "JEALOC", "JELLOC", "JEVLOC"),
    "PROPWR": ("NENGSP", "PHALOC", "YP", "PHVLOC"),
}


@dataclass(frozen=True)
class Geometry:
    """Reference quantities and positions from cards.

    Attributes
    ----------
    S, cbar, b : float or None
        Reference area, chord, span. [m2, m, m]
    reference : tuple of float (3,) or None
        Moment reference point from the drawing datum, body directions. [m]
    x_ref_mac : float or None
        Its position behind the leading edge of the mean chord of the wing, in chords. [1]
    engines : tuple of (3,)
        Points where the thrust acts by JETPWR or PROPWR, from the moment reference point. [m]
    surfaces : dict of str to (S_hinge, c_hinge)
        Area behind the hinge and its mean chord, of the elevator and the aileron. [m2, m]
    flap : float or None
        Largest deflection of the flaps in the listings. [rad]
    title : str
        Title of the first case.
    roles : tuple of CaseRole
        Role of every case of the listings; empty without listings.
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
    roles: tuple[CaseRole, ...] = ()
    places: dict[str, list[str]] = field(default_factory=dict)
    powered: bool = False


def geometry_of(listings: Sequence[Path], decks: Sequence[Path]) -> Geometry:
    """Return the geometry from listings, or from decks if there are no listings.

    Raises
    ------
    ParseError
        A file is damaged, or is not a listing or deck.
    SchemaError
        The listings belong to several aircraft.
    """
    contents = {path: read(path) for path in listings}
    roles: tuple[CaseRole, ...] = ()
    if contents:
        roles = tuple(assign_roles(contents.values()))
    cards = [item.case.deck for item in roles]
    for path in decks:
        cards += read_deck(path)
    clean = next((item.case for item in roles if "clean" in item.roles), None)
    if clean is not None:
        main = clean.deck
    elif cards:
        # Without a listing the deck with most namelists is the whole aircraft.
        main = max(cards, key=lambda deck: len(deck.namelists))
    else:
        return Geometry()
    printed: dict[str, Any] = {}
    if clean is not None:
        printed = {str(key): value for key, value in clean.to_datatree().attrs.items()}
    flap_roles = {"flaps", "ground_flap"}
    return Geometry(
        **_reference_quantities(main, printed),
        engines=_engine_positions(cards, main),
        surfaces=_hinged_surfaces(cards),
        flap=_largest_flap([item.case.deck for item in roles if flap_roles & set(item.roles)]),
        title=main.caseid if clean is None else clean.name,
        roles=roles,
        places=_places_by_role(contents, roles),
        powered=clean is not None and _has_power(clean),
    )


def given_terms(geometry: Geometry) -> frozenset[str] | None:
    """Return the names of the terms that the listings give, or None if they make no database.

    A listing may print NDM for a term, and one without the card DAMP has no damping.
    """
    lengths = (geometry.S, geometry.cbar, geometry.b)
    if "clean" not in geometry.places or None in lengths:
        return None
    cases: dict[str, Any] = {}
    for item in geometry.roles:
        for role in item.roles:
            # the clean pages have the power effects already
            if role != "power" or not geometry.powered:
                cases.setdefault(role, []).append(item.case)
    S, cbar, b = (float(length or 0.0) for length in lengths)
    # mass and inertia have no effect on the tables
    craft = Aircraft(name="draft", S=S, cbar=cbar, b=b, mass=1.0, Ixx=1.0, Iyy=1.0, Izz=1.0)
    build = partial(aerodb.from_datcom, craft, powered=geometry.powered, **cases)
    try:
        database, _ = capture_warnings(build)
    except AeromatchError:
        # the check of the project names the fault
        return None
    return frozenset(aerodb.terms(database))


def _has_power(case: Case) -> bool:
    is_powered = any(page.power != "off" for page in case.pages if page.kind == "static")
    return is_powered and has_thrust(case.deck)


def _places_by_role(contents: dict[Path, Any], roles: Sequence[CaseRole]) -> dict[str, list[str]]:
    """Return ``FILE`` for a listing of one case, else ``FILE:NUMBER``, by role."""
    labels: dict[int, str] = {}
    for path, listing in contents.items():
        for case in listing.cases:
            is_single = len(listing.cases) == 1
            labels[id(case)] = str(path) if is_single else f"{path}:{case.ordinal}"
    places: dict[str, list[str]] = {}
    for item in roles:
        for role in item.roles:
            places.setdefault(role, []).append(labels[id(item.case)])
    return places


def _reference_quantities(deck: Deck, printed: dict[str, Any]) -> dict[str, Any]:
    """Return areas, lengths and the moment reference point.

    The printed values come first, then the values of the cards, then the values of the wing, which
    the program uses by default.
    """
    length = _length_unit(deck)
    wing = _wing_planform(deck)
    quantities: dict[str, Any] = {}
    for name, variable, unit in (
        ("S", "SREF", length**2),
        ("cbar", "CBARR", length),
        ("b", "BLREF", length),
    ):
        card = deck.value("OPTINS", variable)
        value = card * unit if card else wing.get(name)
        found = printed.get(name)
        quantities[name] = found if found and np.isfinite(found) else value
    x, z = deck.value("SYNTHS", "XCG"), deck.value("SYNTHS", "ZCG")
    if x is None:
        return quantities
    x_reference = x * length
    # The axes of the cards point aft and up, body axes point forward and down. The sum with 0.0
    # makes 0.0 of -0.0.
    quantities["reference"] = (-x_reference, 0.0, -(z or 0.0) * length + 0.0)
    quantities["x_ref_mac"] = None
    cbar = quantities["cbar"]
    if wing and cbar:
        quantities["x_ref_mac"] = (x_reference - wing["leading_edge"]) / cbar
    return quantities


def _length_unit(deck: Deck) -> float:
    """Return the unit of length of a deck. [m]"""
    return float(to_si(1.0, _LENGTHS[deck.dim]))


def _wing_planform(deck: Deck) -> dict[str, float]:
    """Return area, mean chord, span and leading edge of the mean chord of the wing. [m2, m]

    The leading edge is measured from the drawing datum. Of a wing behind a canard it is that of
    HTPLNF.
    """
    wing = measure_main_wing(deck)
    if wing is None or deck.value("SYNTHS", "XW") is None:
        return {}
    unit = _length_unit(deck)
    return {
        "S": wing.area * unit**2,
        "cbar": wing.mean_chord * unit,
        "b": wing.span * unit,
        "leading_edge": wing.leading_edge * unit,
    }


def _engine_positions(cards: Sequence[Deck], main: Deck) -> tuple[tuple[float, float, float], ...]:
    """Return the points where jets or propellers act, from the moment reference point. [m]"""
    # the decks of one aircraft may have different units of length
    length = _length_unit(main)
    x0 = (main.value("SYNTHS", "XCG") or 0.0) * length
    z0 = (main.value("SYNTHS", "ZCG") or 0.0) * length
    for deck in cards:
        for namelist, (count, *variables) in _ENGINE_VARIABLES.items():
            x, y, z = (deck.value(namelist, name) for name in variables)
            if x is None:
                continue
            unit = _length_unit(deck)
            # Cards count aft and up, body axes forward and down.
            forward, right, down = x0 - x * unit, (y or 0.0) * unit, z0 - (z or 0.0) * unit
            if round(deck.value(namelist, count) or 1.0) < 2:
                return ((forward, right, down),)
            return ((forward, -abs(right), down), (forward, abs(right), down))
    return ()


def _hinged_surfaces(cards: Sequence[Deck]) -> dict[str, tuple[float, float]]:
    """Return area and mean chord behind the hinge, both sides together. [m2, m]

    The elevator is a SYMFLP on the tail, the aileron is an ASYFLP. The first deck with all values
    is used.
    """
    surfaces: dict[str, tuple[float, float]] = {}
    for deck in cards:
        for namelist, name in (("SYMFLP", "delta_e"), ("ASYFLP", "delta_a")):
            keys = ("CHRDFI", "CHRDFO", "SPANFI", "SPANFO")
            values = [deck.value(namelist, key) for key in keys]
            if name in surfaces or None in values:
                continue
            if name == "delta_e" and not _is_on_tail(deck):
                continue
            if name == "delta_a" and round(deck.value("ASYFLP", "STYPE") or 0.0) != _AILERON:
                continue
            # The flap of a wing that the program computes on the tail is not an elevator.
            if describe_misfit(deck) or weigh_device_on_tail(deck).weight >= IS_FLAP:
                continue
            inner, outer, start, end = (float(value) for value in values if value is not None)
            unit = _length_unit(deck)
            area = (inner + outer) * (end - start) * unit**2
            surfaces[name] = area, 0.5 * (inner + outer) * unit
    return surfaces


def _is_on_tail(deck: Deck) -> bool:
    return "SYMFLP" in deck.namelists and control_surface(deck) == "tail"


def _largest_flap(decks: Sequence[Deck]) -> float | None:
    """Return the largest deflection of the flaps, or None without a deflection. [rad]"""
    angles: list[float] = []
    for deck in decks:
        for angle in deck.schedule("SYMFLP", "DELTA", "NDELTA"):
            if np.isfinite(angle):
                angles.append(angle)
    if not angles:
        return None
    return float(np.radians(max(angles)))
