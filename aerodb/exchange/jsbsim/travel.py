"""Travel of the controls as an aircraft file states it: the scaling of a position to its fraction of -1 ... 1.

``<aerosurface_scale>`` maps its domain to its range, each side of zero by itself; where both sides have the same scale, a fraction
of 1 is one angle.  A file without such a scaling, or with one that differs by side, leaves the angle to the user.
"""

from __future__ import annotations

from flightmech.errors import ParseError

from ..xml_reader import Element
from .properties import NORMALISED, PROPERTY

_ENDS = (-1.0, 1.0)  # domain and range that JSBSim takes where a file states none
_SAME = 1e-6  # relative: limits written with seven digits


def stated_travel(control: Element) -> dict[str, float]:
    """Return the angle at which a position counts 1, by variable, from the elements of a ``<flight_control>``. [rad]"""
    found: dict[str, float] = {}
    for element in control.walk():
        if element.tag == "aerosurface_scale" and (angle := _angle(element)) is not None:
            variable, value = angle
            found.setdefault(variable, value)
    return found


def _angle(scale: Element) -> tuple[str, float] | None:
    """Return the variable that a scaling turns into a fraction, and its angle at 1; None for any other scaling."""
    output, given, centred = (scale.first(tag) for tag in ("output", "input", "zero_centered"))
    if output is None or given is None or output.text not in NORMALISED or given.text not in PROPERTY:
        return None
    variable, _ = NORMALISED[output.text]
    symbols = PROPERTY[given.text].symbols
    if symbols != {variable: 1} or (centred is not None and centred.text not in ("true", "1") and not _through_zero(scale)):
        return None
    gain = scale.first("gain")
    domain, reach = _ends(scale, "domain"), _ends(scale, "range")
    sides = [x / (y * (1.0 if gain is None else gain.number)) for x, y in zip(domain, reach) if x != 0.0 and y != 0.0]
    if not sides or max(sides) - min(sides) > _SAME * abs(sides[0]) or sides[0] <= 0.0:
        return None
    return variable, sides[0] / abs(PROPERTY[given.text].factor)


def _through_zero(scale: Element) -> bool:
    """Return whether a linear scaling maps zero to zero."""
    (low, high), (bottom, top) = _ends(scale, "domain"), _ends(scale, "range")
    return bottom * high == top * low


def _ends(scale: Element, tag: str) -> tuple[float, float]:
    pair = scale.first(tag)
    if pair is None:
        return _ENDS
    low, high = pair.first("min"), pair.first("max")
    try:
        return (0.0 if low is None else low.number, 0.0 if high is None else high.number)
    except ParseError:  # an end that is a property: no number that the file states
        return 0.0, 0.0
