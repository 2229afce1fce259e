"""Parts of an aircraft file whose name states a side, and that lie on the other one.

y is positive to the right.  A tank "left" at a positive y moves the centre of gravity and the
rolling moment to the wrong side, and no unit or size shows it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from flightmech.aircraft.aircraft import Aircraft
from flighttest.reconstruction.quality.finding import Finding

_LEFT = re.compile(r"(?:^|[_\W])(?:left|lh|port|l)(?:$|[_\W\d])", re.IGNORECASE)
_RIGHT = re.compile(r"(?:^|[_\W])(?:right|rh|starboard|r)(?:$|[_\W\d])", re.IGNORECASE)
_CENTRE = 0.005  # of the span, within which a part lies in the plane of symmetry


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
    return int(bool(_RIGHT.search(name))) - int(bool(_LEFT.search(name)))


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
