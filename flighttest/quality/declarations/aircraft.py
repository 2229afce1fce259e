"""Geometry and inertia of an aircraft file against what wings and bodies can be.

An aeroplane has a mean chord near S/b, an aspect ratio within a decade, and moments of inertia that a body of its mass and span can
have.  A chord and span exchanged, an area in square feet read as square metres, and inertias in another unit lie far outside.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from math import atan2, degrees, log, radians, sqrt
from typing import TYPE_CHECKING

import numpy as np

from flightmech.aircraft.aircraft import inertia
from flightmech.units import FOOT, POUND

from ..finding import Finding

if TYPE_CHECKING:
    from flightmech.aircraft.aircraft import Aircraft

# S/(b cbar) is 0.96 to 1.0 for straight wings, 0.75 for a delta; chords of other definitions reach 0.5 (Concorde), biplanes 2
_RATIO, _RATIO_CERTAIN = (0.65, 1.45), (0.42, 2.3)
_ASPECT, _ASPECT_CERTAIN = (0.9, 45.0), (0.45, 70.0)
_USUAL_RATIO, _RATIO_SPREAD = 0.92, 0.15  # and its spread, of the natural log
_USUAL_ASPECT, _ASPECT_SPREAD = 7.0, 0.7
_USUAL_LOADING, _LOADING_SPREAD = 90.0, 0.8  # kg/m2 at 1000 kg, growing with the cube root of the mass; decides between S and lengths
_PER_MISTAKE = 8.0  # of the squared deviations: what a further mistake must explain
_TIE = 6.0
_AREA = (("ft2", "m2", FOOT**2), ("m2", "ft2", FOOT**-2))
_LENGTH = (("ft", "m", FOOT), ("m", "ft", 1.0 / FOOT))
_ROLL, _OTHERS = (0.08, 0.6), (0.09, 2.2)  # radii of gyration over half the span
_INCLINED = radians(25.0)  # of the principal axis from the body axis; aeroplanes have 0 to 6 deg, small ones up to 16
_MAIN = ("Ixx", "Iyy", "Izz")
_INERTIA = (("lb ft2", "kg m2", POUND * FOOT**2), ("kg m2", "lb ft2", 1.0 / (POUND * FOOT**2)))
_TRIANGLE, _TRIANGLE_CERTAIN = 0.01, 0.1  # by which Izz may exceed Ixx + Iyy: moments of inertia are estimates
_YAW = 0.85  # of the largest other moment that Izz must reach; long fuselages have Izz near Iyy


@dataclass(frozen=True)
class _Cure:
    """Numbers of the geometry corrected, and in words what was wrong with them."""

    names: tuple[str, ...]
    text: str
    misfit: float


def geometry_findings(aircraft: Aircraft) -> list[Finding]:
    """Return what is wrong with area, chord and span of an aircraft, with the mistake that explains it.

    Parameters
    ----------
    aircraft : Aircraft
        Its S [m2], cbar [m] and b [m] are read.
    """
    S, cbar, b = aircraft.S, aircraft.cbar, aircraft.b
    ratio, aspect = S / (b * cbar), b**2 / S
    usual = _RATIO[0] <= ratio <= _RATIO[1] and _ASPECT[0] <= aspect <= _ASPECT[1]
    if usual and cbar <= b:
        return []
    faults = [f"S/(b cbar) is {ratio:.3g} (wings have {_RATIO[0]:g} to {_RATIO[1]:g})"] if not _RATIO[0] <= ratio <= _RATIO[1] else []
    if not _ASPECT[0] <= aspect <= _ASPECT[1]:
        faults.append(f"the aspect ratio b2/S is {aspect:.3g}")
    if cbar > b:
        faults.append(f"the chord cbar ({cbar:.4g} m) is longer than the span b ({b:.4g} m)")
    certain = not (_RATIO_CERTAIN[0] <= ratio <= _RATIO_CERTAIN[1] and _ASPECT_CERTAIN[0] <= aspect <= _ASPECT_CERTAIN[1])
    cures = _cures(S, cbar, b, aircraft.mass)
    names = cures[0].names if cures else ("S", "cbar", "b")
    explained = f"; {' or '.join(cure.text for cure in cures)}" if cures else ""
    text = f"S = {S:.4g} m2, cbar = {cbar:.4g} m, b = {b:.4g} m: {', '.join(faults)}{explained}"
    remedy = "correct S, cbar and b in the aircraft file; a number without a unit is SI"
    evidence = {"ratio": ratio, "aspect": aspect}
    return [Finding("error" if certain else "warning", "geometry", names, text, remedy, evidence=evidence)]


def inertia_findings(aircraft: Aircraft) -> list[Finding]:
    """Return moments of inertia that no body of this mass and span has."""
    found: list[Finding] = []
    moments = {name: float(getattr(aircraft, name)) for name in _MAIN}
    principal = np.sort(np.linalg.eigvalsh(inertia(aircraft)))
    excess = float(principal[2] / (principal[0] + principal[1]) - 1.0)
    shown = ", ".join(f"{name} = {moment:.4g}" for name, moment in moments.items())
    remedy = "correct the moments of inertia in the aircraft file; a number without a unit is kg m2"
    odd = list(_odd_radii(aircraft, moments))
    if odd:
        names = tuple(name for name, _ in odd)
        text = f"{shown} kg m2 for {aircraft.mass:.4g} kg and a span of {aircraft.b:.4g} m: {'; '.join(text for _, text in odd)}"
        found.append(Finding("warning", "inertia", names, text, remedy))
    if excess > _TRIANGLE:
        likely = [(name, *unit) for name in _MAIN for unit in _INERTIA if _is_body(aircraft, moments | {name: unit[2] * moments[name]})]
        largest, smallest = max(_MAIN, key=moments.__getitem__), min(_MAIN, key=moments.__getitem__)
        names = (likely[0][0],) if likely else (largest, smallest)
        text = f"{shown} kg m2: {largest} exceeds the sum of the two others by {excess:.1%}, which no body has"
        text += "".join(f"; as if {name} were in {wrong} and taken as {right}" for name, wrong, right, _ in likely)
        found.append(Finding("error" if excess > _TRIANGLE_CERTAIN else "note", "inertia", names, text, remedy))
    elif moments["Izz"] < _YAW * max(moments["Ixx"], moments["Iyy"]):
        text = f"{shown} kg m2: Izz is the largest moment of inertia of an aeroplane; two of them may stand in each other's place"
        found.append(Finding("warning", "inertia", ("Izz",), text, remedy))
    inclined = 0.5 * atan2(2.0 * aircraft.Ixz, moments["Izz"] - moments["Ixx"])
    if moments["Izz"] > moments["Ixx"] and abs(inclined) > _INCLINED:
        text = f"Ixz = {aircraft.Ixz:.4g} kg m2 inclines the principal axis of inertia by {degrees(inclined):.0f} deg from the body axis"
        found.append(Finding("warning", "inertia", ("Ixz",), text, remedy))
    return found


def _is_body(aircraft: Aircraft, moments: dict[str, float]) -> bool:
    """Whether moments of inertia are those of an aeroplane."""
    Ixx, Iyy, Izz = (moments[name] for name in _MAIN)
    return _YAW * max(Ixx, Iyy) <= Izz <= (1.0 + _TRIANGLE) * (Ixx + Iyy) and not list(_odd_radii(aircraft, moments))


def _odd_radii(aircraft: Aircraft, moments: dict[str, float]) -> Iterator[tuple[str, str]]:
    half = 0.5 * aircraft.b
    for name, moment in moments.items():
        low, high = _ROLL if name == "Ixx" else _OTHERS
        radius = sqrt(moment / aircraft.mass) / half
        if low <= radius <= high:
            continue
        text = f"the radius of gyration of {name} is {radius:.2g} of half the span (aeroplanes have {low:g} to {high:g})"
        for wrong, right, factor in _INERTIA:
            if low <= radius * sqrt(factor) <= high:
                text += f", as if {name} were in {wrong} and taken as {right}"
        yield name, text


def _cures(S: float, cbar: float, b: float, mass: float) -> list[_Cure]:
    """Return the mistakes that explain a geometry, the likeliest first, and those that explain it as well."""
    misfit = _misfit(S, cbar, b, mass)
    tried = [_Cure(("cbar", "b"), "cbar and b stand in each other's place", _misfit(S, b, cbar, mass) + _PER_MISTAKE)]
    single = {"S": _AREA, "cbar": _LENGTH, "b": _LENGTH}
    changes = [(name, *unit) for name, units in single.items() for unit in units]
    for count in (1, 2):
        for chosen in combinations(changes, count):
            names = tuple(change[0] for change in chosen)
            if len(set(names)) < count:
                continue
            numbers = {"S": S, "cbar": cbar, "b": b} | {name: _corrected(name, factor, S, cbar, b) for name, _, _, factor in chosen}
            text = " and ".join(f"{name} is in {wrong} and was taken as {right}" for name, wrong, right, _ in chosen)
            tried.append(_Cure(names, text, _misfit(**numbers, mass=mass) + count * _PER_MISTAKE))
    tried.sort(key=lambda cure: cure.misfit)
    likely = [cure for cure in tried if cure.misfit < min(misfit, tried[0].misfit + _TIE)]
    return likely[:3]


def _corrected(name: str, factor: float, S: float, cbar: float, b: float) -> float:
    return factor * {"S": S, "cbar": cbar, "b": b}[name]


def _misfit(S: float, cbar: float, b: float, mass: float) -> float:
    """Return how far a geometry is from that of usual wings: squares of deviations over spreads, of the logarithms."""
    loading = log(mass / S / (_USUAL_LOADING * (mass / 1000.0) ** (1.0 / 3.0))) / _LOADING_SPREAD
    ratio = log(S / (b * cbar) / _USUAL_RATIO) / _RATIO_SPREAD
    aspect = log(b**2 / S / _USUAL_ASPECT) / _ASPECT_SPREAD
    return ratio**2 + aspect**2 + loading**2
