"""Wing area, chord and span of an aircraft file against those of usual aeroplanes.

A number in the wrong unit, or chord and span exchanged, changes S/(b cbar) or the aspect ratio by
more than wings differ.  Of all such mistakes, the likeliest ones are named.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import log

from flightmech.aircraft.aircraft import Aircraft
from flightmech.units import FOOT
from flighttest.reconstruction.quality.declarations.airship import airship_findings, floats
from flighttest.reconstruction.quality.finding import Finding

# S/(b cbar) is 0.96 to 1.0 for straight wings, 0.75 for a delta; chords of other definitions reach
# 0.5 (Concorde), biplanes 2
_RATIO, _RATIO_CERTAIN = (0.65, 1.45), (0.42, 2.3)
_ASPECT, _ASPECT_CERTAIN = (0.9, 45.0), (0.45, 70.0)
# usual value, and standard deviation of its natural logarithm
_USUAL_RATIO, _RATIO_SPREAD = 0.92, 0.15
_USUAL_ASPECT, _ASPECT_SPREAD = 7.0, 0.7
# kg/m2 at 1000 kg, proportional to the cube root of the mass; decides between S and lengths
_USUAL_LOADING, _LOADING_SPREAD = 90.0, 0.8
_PER_MISTAKE = 8.0  # of the squared deviations that a further mistake must explain
_TIE = 6.0  # of the squared deviations, within which corrections explain a geometry equally well
_MOST_SHOWN = 3  # corrections in one finding
_AREA = (("ft2", "m2", FOOT**2), ("m2", "ft2", FOOT**-2))
_LENGTH = (("ft", "m", FOOT), ("m", "ft", 1.0 / FOOT))


@dataclass(frozen=True)
class _Correction:
    """Numbers of the geometry that are wrong, the mistake in words, and its misfit."""

    names: tuple[str, ...]
    text: str
    misfit: float


def geometry_findings(aircraft: Aircraft) -> list[Finding]:
    """Return the finding on area, chord and span, with the mistakes that explain it.

    Parameters
    ----------
    aircraft : Aircraft
        Its S [m2], cbar [m] and b [m] are read.
    """
    if is_airship(aircraft):
        return airship_findings(aircraft)
    S, cbar, b = aircraft.S, aircraft.cbar, aircraft.b
    # S / (b cbar) is 1 for a rectangular wing; a wrong unit of one of them shows in both ratios.
    ratio, aspect = S / (b * cbar), b**2 / S
    faults = []
    if not _RATIO[0] <= ratio <= _RATIO[1]:
        faults.append(f"S/(b cbar) is {ratio:.3g} (wings have {_RATIO[0]:g} to {_RATIO[1]:g})")
    if not _ASPECT[0] <= aspect <= _ASPECT[1]:
        faults.append(f"the aspect ratio b2/S is {aspect:.3g}")
    if cbar > b:
        faults.append(f"the chord cbar ({cbar:.4g} m) is longer than the span b ({b:.4g} m)")
    if not faults:
        return []
    corrections = _likely_corrections(S, cbar, b, mass=aircraft.mass)
    names: tuple[str, ...] = ("S", "cbar", "b")
    explanation = ""
    if corrections:
        names = corrections[0].names
        explanation = f"; {' or '.join(correction.text for correction in corrections)}"
    text = f"S = {S:.4g} m2, cbar = {cbar:.4g} m, b = {b:.4g} m: {', '.join(faults)}{explanation}"
    remedy = "correct S, cbar and b in the aircraft file; a number without a unit is SI"
    # Beyond the wider limits no wing is possible.
    possible_ratio = _RATIO_CERTAIN[0] <= ratio <= _RATIO_CERTAIN[1]
    possible_aspect = _ASPECT_CERTAIN[0] <= aspect <= _ASPECT_CERTAIN[1]
    severity = "warning" if possible_ratio and possible_aspect else "error"
    evidence = {"ratio": ratio, "aspect": aspect}
    return [Finding(severity, "geometry", names, text, remedy=remedy, evidence=evidence)]


def is_airship(aircraft: Aircraft) -> bool:
    """Return whether an aircraft floats and its lengths are not those of a wing."""
    S, cbar, b = aircraft.S, aircraft.cbar, aircraft.b
    usual = _RATIO[0] <= S / (b * cbar) <= _RATIO[1] and _ASPECT[0] <= b**2 / S <= _ASPECT[1]
    return not (usual and cbar < b) and floats(aircraft)


def _likely_corrections(S: float, cbar: float, b: float, mass: float) -> list[_Correction]:
    """Return the likeliest corrections of a geometry, the best first."""
    exchanged = _Correction(
        ("cbar", "b"),
        "cbar and b are exchanged",
        misfit=_misfit(S, b, cbar, mass=mass) + _PER_MISTAKE,
    )
    tried = [exchanged]
    changes = [("S", *unit) for unit in _AREA]
    for name in ("cbar", "b"):
        changes += [(name, *unit) for unit in _LENGTH]
    for count in (1, 2):
        for chosen in combinations(changes, count):
            names = tuple(change[0] for change in chosen)
            # a number has one unit only
            if len(set(names)) < count:
                continue
            numbers = {"S": S, "cbar": cbar, "b": b}
            mistakes = []
            for name, wrong, right, factor in chosen:
                numbers[name] = factor * numbers[name]
                mistakes.append(f"{name} is in {wrong} and was taken as {right}")
            misfit = _misfit(**numbers, mass=mass) + count * _PER_MISTAKE
            tried.append(_Correction(names, " and ".join(mistakes), misfit))
    tried.sort(key=lambda correction: correction.misfit)
    limit = min(_misfit(S, cbar, b, mass=mass), tried[0].misfit + _TIE)
    likely = [correction for correction in tried if correction.misfit < limit]
    return likely[:_MOST_SHOWN]


def _misfit(S: float, cbar: float, b: float, mass: float) -> float:
    """Return the distance of a geometry from usual wings.

    It is the sum of the squared deviations of the logarithms, each over its standard deviation.
    """
    loading = log(mass / S / (_USUAL_LOADING * (mass / 1000.0) ** (1.0 / 3.0))) / _LOADING_SPREAD
    ratio = log(S / (b * cbar) / _USUAL_RATIO) / _RATIO_SPREAD
    aspect = log(b**2 / S / _USUAL_ASPECT) / _ASPECT_SPREAD
    return ratio**2 + aspect**2 + loading**2
