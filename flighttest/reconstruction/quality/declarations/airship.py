"""Aircraft that float: what is known of wings does not hold for their reference quantities.

An airship has no chord and span.  Its coefficients refer to the two-thirds power of the volume, to
the plan or to the cross-section of the hull, and to one length for all moments, or to length and
diameter of the hull.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

from flightmech.air import RHO_SEA
from flighttest.reconstruction.quality.finding import Finding

if TYPE_CHECKING:
    from flightmech.aircraft.aircraft import Aircraft

_HULL = 0.6  # volume over length times diameter squared; 0.52 of an ellipsoid
_AFLOAT = (0.12, 1.4)  # mass over that of the air in the hull; with or without gas and load
CARRIED = "buoyancy carries an airship, and its lift shows no weight"


def afloat(aircraft: Aircraft) -> float:
    """Return the mass of an aircraft over that of the air which a hull of its reference lengths
    displaces.

    Parameters
    ----------
    aircraft : Aircraft
        Its S [m2], cbar [m], b [m] and mass [kg] are read.
    """
    length, diameter = (
        max(aircraft.b, aircraft.cbar),
        min(aircraft.b, aircraft.cbar),
    )
    volume = _HULL * length * diameter**2
    if length == diameter:  # one length for all moments: the area shows the hull
        volume = max(aircraft.S**1.5, _HULL * length * aircraft.S * 4.0 / pi)
    return aircraft.mass / (RHO_SEA * volume)


def floats(aircraft: Aircraft) -> bool:
    """Whether an aircraft is about as light as the air that its hull displaces; aeroplanes are
    three times as heavy and more.
    """
    return _AFLOAT[0] <= afloat(aircraft) <= _AFLOAT[1]


def airship_findings(aircraft: Aircraft) -> list[Finding]:
    """Return a note that an airship is not judged as a wing."""
    share = afloat(aircraft)
    text = (
        f"S = {aircraft.S:.4g} m2, cbar = {aircraft.cbar:.4g} m, b = {aircraft.b:.4g} m, "
        f"mass = {aircraft.mass:.5g} kg: an airship, of "
        f"{share:.2f} times the mass of the air that a hull of this size displaces; geometry "
        f"and weight were not compared with those of wings"
    )
    remedy = (
        "if it is an aeroplane, correct S, cbar, b and mass in the aircraft file; a number "
        "without a unit is SI"
    )
    evidence = {"afloat": share}
    return [Finding("note", "geometry", ("S", "cbar", "b"), text, remedy, evidence=evidence)]
