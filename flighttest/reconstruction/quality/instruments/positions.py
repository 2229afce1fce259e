"""Positions of an aircraft file outside of the aircraft, or on the side opposite to their name.

Inches taken as metres put an instrument outside.  Rates times a wrong arm disturb accelerometers
and vanes.  The disturbance looks like a delay of a channel, so that the position must be named
first.  A tank "left" at a positive y moves the centre of gravity and the rolling moment to the
wrong side, and no unit or size shows it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flightmech.units import FOOT, INCH
from flighttest.reconstruction.quality.finding import Finding
from flighttest.records.sensors.instruments import Instruments

# Largest distances from the c.g. along x, y and z, of the larger of span and length of the chord:
# nose booms of fighters reach 1.3 spans, booms at wing tips half a span.
_FARTHEST = np.array([1.4, 0.6, 0.5])
# Largest distance of a vane behind the c.g., of the same length: our number.  It stands in the flow
# ahead of nose or wing, and a positive x is forward.
_BEHIND = 0.5
_UNITS = {"in": ("inches", INCH), "ft": ("feet", FOOT), "cm": ("cm", 0.01), "mm": ("mm", 0.001)}
# words of a name between signs, digits and changes to a capital: MLG-R, 2L, leftMain, eng_1_lh
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_LEFT, _RIGHT = ("l", "lh", "lhs", "port"), ("r", "rh", "rhs", "stbd")
# a side within a longer word: tipleft, rightmain
_LONG_LEFT, _LONG_RIGHT = re.compile("left"), re.compile("(?<!up)right|starboard")
# a part with the letter of its side before or behind it: mlgr, lwing
_PART = re.compile(
    "(?P<before>[lr]?)"
    "(?:mlg|mg|main|gear|wheel|tank|tip|wing|eng|engine|skid|float)"
    "(?P<behind>[lr]?)"
)
_CENTRE = 0.005  # of the span, within which a part lies in the plane of symmetry
_OF = {"ax_imu": "accelerometers", "alpha_vane": "alpha vane", "beta_vane": "beta vane"}


def sensor_positions(
    specification: Instruments | None, aircraft: Aircraft | None
) -> dict[str, np.ndarray]:
    """Return the positions of accelerometers and vanes relative to the c.g.

    Parameters
    ----------
    specification : Instruments or None
    aircraft : Aircraft or None

    Returns
    -------
    dict of str to array (3,)
        By channel, body axes; empty without instruments or aircraft. [m]
    """
    if specification is None or aircraft is None:
        return {}
    cg = np.asarray(aircraft.cg, float)
    positions = {}
    for name in ("ax_imu", "alpha_vane", "beta_vane"):
        position = specification.of(name).position
        if position is not None:
            positions[name] = np.asarray(position, float) - cg
    return positions


def position_findings(positions: Mapping[str, np.ndarray], aircraft: Aircraft) -> list[Finding]:
    """Return the errors of instruments outside of the aircraft, and of vanes far behind the c.g.

    Parameters
    ----------
    positions : mapping of str to array (3,)
        By channel, from the c.g., body axes. [m]
    aircraft : Aircraft
        Its b and cbar [m] give the size.

    Returns
    -------
    list of Finding
        Of kind ``geometry``; one for instruments at the same place.
    """
    limits = _FARTHEST * max(aircraft.b, aircraft.cbar)
    channels: dict[tuple[float, ...], list[str]] = {}
    for name, position in positions.items():
        if (np.abs(position) > limits).any():
            channels.setdefault(tuple(np.round(position, 6).tolist()), []).append(name)
    findings = []
    for place, names in channels.items():
        cg = np.asarray(aircraft.cg, float)
        stated = np.array(place) + cg
        shown = ", ".join(f"{x:.4g}" for x in stated)
        text = (
            f"{' and '.join(_OF.get(name, name) for name in names)}: position = [{shown}] m is "
            f"outside of an aircraft with a span of {aircraft.b:.4g} m; usual are up to "
            f"{limits[0]:.3g}, {limits[1]:.3g} and {limits[2]:.3g} m from the c.g."
        )
        example = "in"
        inside = []
        for unit, (_, size) in _UNITS.items():
            if (np.abs(stated * size - cg) <= limits).all():
                inside.append(unit)
        if inside:
            example = inside[0]
            words = _UNITS[example][0]
            text += f"; as if the numbers were {words}: a number without a unit is in m"
        parts = ", ".join(f'"{x:.4g} {example}"' for x in stated)
        remedy = (
            f"correct it in [instruments] of the aircraft file, from the moment reference point: "
            f"position = [{parts}], if that is its unit"
        )
        evidence = {"position": list(place)}
        findings.append(Finding("error", "geometry", tuple(names), text, remedy, evidence=evidence))
    outside: set[str] = set().union(*channels.values())
    inside_places = {name: place for name, place in positions.items() if name not in outside}
    return findings + _vanes_behind(inside_places, aircraft)


def _vanes_behind(positions: Mapping[str, np.ndarray], aircraft: Aircraft) -> list[Finding]:
    """Return the errors of vanes further behind the c.g. than a vane can be."""
    least = -_BEHIND * max(aircraft.b, aircraft.cbar)
    findings = []
    for name, place in positions.items():
        if not name.endswith("_vane") or place[0] >= least:
            continue
        stated = place + np.asarray(aircraft.cg, float)
        shown = ", ".join(f"{x:.4g}" for x in stated)
        text = (
            f"{_OF[name]}: position = [{shown}] m is {-place[0]:.3g} m behind the c.g., and vanes "
            f"stand ahead of nose or wing; x is positive forward"
        )
        remedy = (
            f"correct it in [instruments] of the aircraft file, from the moment reference point; "
            f"if only the sign is wrong, x = {-stated[0]:.4g} m"
        )
        evidence = {"position": place.tolist()}
        findings.append(Finding("error", "geometry", (name,), text, remedy, evidence=evidence))
    return findings


def side_findings(aircraft: Aircraft) -> list[Finding]:
    """Return the warnings on tanks and wheels with the name of one side on the other one.

    Parameters
    ----------
    aircraft : Aircraft
        Tanks of its fuel, contacts of its landing gear and engines with the tanks that feed them;
        positions from the moment reference point, y positive to the right. [m]
    """
    findings = []
    least = _CENTRE * aircraft.b
    for what, name, y in _named_parts(aircraft):
        side = _side_of(name)
        if side * y >= -least * abs(side):
            continue
        stated, actual = ("left", "right") if side < 0 else ("right", "left")
        text = (
            f"{what} {name!r} of the aircraft file is at y = {y:+.4g} m, the {actual} side; y is "
            f"positive to the right, so a part on the {stated} has a {_sign(side)} y"
        )
        remedy = f"turn the sign of y of {name!r} in the aircraft file, or give it another name"
        findings.append(Finding("warning", "sign", (f"{what} {name}",), text, remedy))
    # a wrong tank feeds the wrong side too
    return findings or list(_crossed_feeds(aircraft, least))


def _named_parts(aircraft: Aircraft) -> Iterator[tuple[str, str, float]]:
    """Yield kind, name and y [m] of each part with a name."""
    if aircraft.fuel is not None:
        for tank in aircraft.fuel.tanks:
            yield "tank", tank.name, float(tank.position[1])
    if aircraft.gear is not None:
        for contact in aircraft.gear.contacts:
            yield "contact", contact.name, float(contact.position[1])


def _side_of(name: str) -> int:
    """Return -1 for the name of a part on the left, 1 on the right, 0 for both or none."""
    sides = {_side_of_word(word.lower()) for word in _WORD.findall(name)}
    return int(1 in sides) - int(-1 in sides)


def _side_of_word(word: str) -> int:
    """Return the side of one word in small letters, as `_side_of`."""
    if word in _LEFT or _LONG_LEFT.search(word):
        return -1
    if word in _RIGHT or _LONG_RIGHT.search(word):
        return 1
    part = _PART.fullmatch(word)
    # one letter is the side; two, as in lwingr, are not
    letters = part["before"] + part["behind"] if part else ""
    return {"l": -1, "r": 1}.get(letters, 0)


def _sign(side: int) -> str:
    return "negative" if side < 0 else "positive"


def _crossed_feeds(aircraft: Aircraft, least: float) -> Iterator[Finding]:
    """Yield the engines of one side that only tanks of the other side feed."""
    if aircraft.fuel is None:
        return
    place = {tank.name: float(tank.position[1]) for tank in aircraft.fuel.tanks}
    for number, engine in enumerate(aircraft.engines, 1):
        y = float(engine.position[1])
        sides = [place[name] for name in engine.feed if name in place]
        if not sides or abs(y) <= least or any(y * side >= -(least**2) for side in sides):
            continue
        names = ", ".join(engine.feed)
        text = (
            f"engine {number} of the aircraft file is at y = {y:+.4g} m, and its feed, {names}, "
            f"is on the other side: y = {', '.join(f'{side:+.4g}' for side in sides)} m"
        )
        remedy = (
            f"exchange the feeds of both engines, or correct y of engine {number} or of its tanks; "
            f"tanks of the other side belong to crossfeed"
        )
        yield Finding("warning", "sign", (f"engine{number}_feed",), text, remedy)
