"""Positions of instruments that lie outside of the aircraft: mostly inches taken as metres.

Rates times a wrong arm disturb accelerometers and vanes.  The disturbance looks like a delay of a
channel, so that the position must be named first.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flightmech.units import FOOT, INCH
from flighttest.reconstruction.quality.finding import Finding
from flighttest.records.sensors.instruments import Instruments

# Largest distances from the c.g. along x, y and z, of the larger of span and length of the chord:
# nose booms of fighters reach 1.3 spans, booms at wing tips half a span.
_FARTHEST = np.array([1.4, 0.6, 0.5])
_UNITS = {"in": ("inches", INCH), "ft": ("feet", FOOT), "cm": ("cm", 0.01), "mm": ("mm", 0.001)}
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
    """Return the errors of instruments outside of the aircraft.

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
    return findings
