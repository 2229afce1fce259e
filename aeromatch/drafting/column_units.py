"""In which unit a column stands: as the file or its name states, else by the size of its values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flightmech.errors import UnitError
from flightmech.names import lookup
from flightmech.units import fitted_unit, parse
from flighttest.quality.checks.mistake_search import plausible
from flighttest.readers.map_entries import units_of

_LEVELS = {  # median size of a channel in flight by its unit [lowest, highest]
    "az_imu": {"m/s2": (5.0, 20.0), "g": (0.5, 2.0), "ft/s2": (22.0, 50.0)},
    "p_static": {"Pa": (20e3, 110e3), "hPa": (200.0, 1100.0), "kPa": (20.0, 110.0), "psf": (400.0, 2300.0), "psi": (2.9, 16.0)},
    "temperature": {"K": (200.0, 330.0), "degC": (-70.0, 50.0)},
}
_TURNED = "psi"
_FRACTIONS = ("throttle", "n1", "n2", "gear", "speedbrake", "brake")
_LARGEST_ANGLE, _LARGEST_RATE = 1.6, 3.0  # rad, rad/s; beyond them a channel is in degrees


def stated(unit: str | None, name: str) -> str | None:
    """Return a unit as the package spells it when it is one of the quantity, else None."""
    if not unit:
        return None
    unit = fitted_unit(unit, lookup(name).units)
    try:
        same = parse(unit)[0] == parse(lookup(name).units)[0]
    except UnitError:
        return None
    plain = parse(unit)[0] == (0, 0, 0, 0)  # an angle and a fraction are both pure numbers
    return unit if same and (not plain or unit in units_of(name)) else None


def by_size(columns: Mapping[str, np.ndarray]) -> dict[str, tuple[str, str]]:
    """Return the unit of every channel by the size of its values, and why.

    Parameters
    ----------
    columns : mapping of str to array
        Canonical name to values as recorded, of channels without a stated unit.

    Notes
    -----
    Angles without a unit share one, rates of angles too: what is small in all of a record may be in degrees.  Where no unit is
    certain the SI unit is returned with a reason that states it.
    """
    largest = {name: _largest(values) for name, values in columns.items()}
    turning = any(
        size > (2.0 * np.pi + 0.1 if name == _TURNED else _LARGEST_ANGLE) for name, size in largest.items() if lookup(name).units == "rad"
    )
    rotating = any(size > _LARGEST_RATE for name, size in largest.items() if lookup(name).units == "rad s-1")
    found = {}
    for name, values in columns.items():
        units = lookup(name).units
        if units == "rad":
            found[name] = ("deg", "angles exceed 1.6 rad") if turning else ("rad", "no angle exceeds 1.6 rad")
        elif units == "rad s-1":
            in_degrees = rotating or (turning and largest[name] > 0.5)
            found[name] = ("deg/s", "as the angles" if not rotating else "rates exceed 3 rad/s") if in_degrees else ("rad/s", "by size")
        elif name.rpartition(".")[2] in _FRACTIONS and units == "1":
            found[name] = ("%", f"reaches {largest[name]:.3g}") if largest[name] > 2.0 else ("1", "by size")
        else:
            found[name] = _level(name, values)
    if "az_imu" in found:  # accelerations of one unit stand in one unit
        found.update({name: (found["az_imu"][0], "as az_imu") for name in ("ax_imu", "ay_imu") if name in found})
    return found


def _level(name: str, values: np.ndarray) -> tuple[str, str]:
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    middle = float(np.median(finite)) if len(finite) else 0.0
    size = middle if name == "temperature" else abs(middle)
    for unit, (low, high) in _LEVELS.get(name, {}).items():
        if low <= size <= high:
            return unit, f"median {middle:.4g}"
    candidates = units_of(name) or (lookup(name).units,)
    limits = plausible(name)
    if limits is not None and len(finite):
        fitting = [unit for unit in candidates if limits[0] <= _si(finite.min(), unit) and _si(finite.max(), unit) <= limits[1]]
        if len(fitting) == 1:
            return fitting[0], "the only unit in which it is possible"
    return candidates[0], "CONFIRM: taken as SI" if len(candidates) > 1 else "SI"


def _si(value: float, unit: str) -> float:
    _, factor, zero = parse(unit)
    return float(value) * factor + zero


def _largest(values: np.ndarray) -> float:
    finite = np.abs(np.asarray(values, float))
    finite = finite[np.isfinite(finite)]
    return float(np.percentile(finite, 99.5)) if len(finite) else 0.0
