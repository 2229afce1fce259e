"""Unit of a channel of a recorder, by the text of the file or by the size of its values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flightmech.errors import UnitError
from flightmech.names import lookup
from flightmech.units import fitted_unit, parse_unit
from flighttest.reconstruction.quality.checks.mistake_search import plausible_range
from flighttest.records.readers.channel_correction import is_shaft_speed, recorder_units

# Median size of a channel in flight by its unit: lowest and highest value.
_LEVELS = {
    "az_imu": {"m/s2": (5.0, 20.0), "g": (0.5, 2.0), "ft/s2": (22.0, 50.0)},
    "p_static": {
        "Pa": (20e3, 110e3),
        "hPa": (200.0, 1100.0),
        "kPa": (20.0, 110.0),
        "psf": (400.0, 2300.0),
        "psi": (2.9, 16.0),
    },
    "temperature": {"K": (200.0, 330.0), "degC": (-70.0, 50.0)},
}
# The heading is the one angle that covers a full circle. [rad]
_TURNED, _LARGEST_HEADING = "psi", 2.0 * np.pi + 0.1
_FRACTIONS = ("throttle", "prop_command", "mixture", "n1", "n2", "gear", "speedbrake", "brake")
# A channel with a larger angle [rad] or rate [rad/s] is in degrees.
_LARGEST_ANGLE, _LARGEST_RATE = 1.6, 3.0
# A rate that is larger than this is in degrees if the angles are. [rad/s]
_DOUBTFUL_RATE = 0.5
# A propeller or its engine does not turn faster. [rad/s]
_LARGEST_SHAFT_SPEED = 700.0
# A channel of a fraction with a larger value is in percent.
_LARGEST_FRACTION = 2.0
# Share of the samples below the largest size, so that single wrong samples do not decide. [%]
_PERCENTILE = 99.5


def stated_unit(unit: str | None, name: str) -> str | None:
    """Return a unit in the spelling of the package, or None if the quantity cannot have it."""
    if not unit:
        return None
    unit = fitted_unit(unit, lookup(name).units)
    try:
        dimension = parse_unit(unit)[0]
    except UnitError:
        return None
    if dimension != parse_unit(lookup(name).units)[0]:
        return None
    # Angles and fractions are both pure numbers, so their units need a comparison by name.
    is_pure = dimension == parse_unit("1")[0]
    if is_pure and unit not in recorder_units(name):
        return None
    return unit


def unit_from_size(columns: Mapping[str, np.ndarray]) -> dict[str, tuple[str, str]]:
    """Return the unit of every channel by the size of its values, and the reason.

    Parameters
    ----------
    columns : mapping of str to array
        Canonical name to values as recorded, of channels without a stated unit.

    Notes
    -----
    All angles without a unit have the same unit, and so do all rates of angles.  A channel that is
    small in the whole record may be in degrees.  If no unit is certain, the SI unit is returned
    with a reason that states it.
    """
    largest = {name: _largest_size(values) for name, values in columns.items()}
    has_degrees = has_degree_rates = False
    for name, size in largest.items():
        si_unit = lookup(name).units
        if si_unit == "rad":
            limit = _LARGEST_HEADING if name == _TURNED else _LARGEST_ANGLE
            has_degrees = has_degrees or size > limit
        elif si_unit == "rad s-1" and not is_shaft_speed(name):
            has_degree_rates = has_degree_rates or size > _LARGEST_RATE
    units = {}
    for name, values in columns.items():
        si_unit = lookup(name).units
        if name.endswith(".pla"):
            units[name] = (
                "deg",
                f"CONFIRM: degrees or percent is not stated, {_reach(largest[name])}",
            )
        elif si_unit == "rad":
            units[name] = _angle_unit(has_degrees)
        elif is_shaft_speed(name):
            units[name] = _shaft_unit(largest[name])
        elif si_unit == "rad s-1":
            units[name] = _rate_unit(largest[name], has_degrees, has_degree_rates)
        elif si_unit == "1" and name.rpartition(".")[2] in _FRACTIONS:
            units[name] = _fraction_unit(largest[name])
        else:
            units[name] = _unit_of_level(name, values)
    # Accelerometers have the same unit; gravity shows it on the vertical one only.
    if "az_imu" in units:
        for name in ("ax_imu", "ay_imu"):
            if name in units:
                units[name] = (units["az_imu"][0], "as az_imu")
    return units


def _angle_unit(has_degrees: bool) -> tuple[str, str]:
    if has_degrees:
        return "deg", "angles exceed 1.6 rad"
    return "rad", "no angle exceeds 1.6 rad"


def _rate_unit(size: float, has_degrees: bool, has_degree_rates: bool) -> tuple[str, str]:
    if has_degree_rates:
        return "deg/s", "rates exceed 3 rad/s"
    if has_degrees and size > _DOUBTFUL_RATE:
        return "deg/s", "as the angles"
    return "rad/s", "by size"


def _shaft_unit(size: float) -> tuple[str, str]:
    # a smaller value may be rad/s as well
    is_clear = size > _LARGEST_SHAFT_SPEED
    return "rpm", _reach(size) if is_clear else "CONFIRM: taken as turns per minute"


def _fraction_unit(size: float) -> tuple[str, str]:
    if size > _LARGEST_FRACTION:
        return "%", _reach(size)
    return "1", "by size"


def _reach(size: float) -> str:
    return f"reaches {size:.3g}"


def _unit_of_level(name: str, values: np.ndarray) -> tuple[str, str]:
    """Return the unit in which the level of a channel is possible, and the reason."""
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    median = float(np.median(finite)) if len(finite) else 0.0
    # A temperature may be negative; the sign of an acceleration depends on the recorder.
    size = median if name == "temperature" else abs(median)
    for unit, (low, high) in _LEVELS.get(name, {}).items():
        if low <= size <= high:
            return unit, f"median {median:.4g}"
    candidates = recorder_units(name) or (lookup(name).units,)
    limits = plausible_range(name)
    if limits is not None and len(finite):
        low, high = limits
        possible = []
        for unit in candidates:
            if low <= _to_si(finite.min(), unit) and _to_si(finite.max(), unit) <= high:
                possible.append(unit)
        if len(possible) == 1:
            return possible[0], "the only unit in which it is possible"
    return candidates[0], "CONFIRM: taken as SI" if len(candidates) > 1 else "SI"


def _to_si(value: float, unit: str) -> float:
    _, factor, zero = parse_unit(unit)
    return float(value) * factor + zero


def _largest_size(values: np.ndarray) -> float:
    """Return the largest size of a channel, without single wrong samples; 0 without samples."""
    sizes = np.abs(np.asarray(values, float))
    sizes = sizes[np.isfinite(sizes)]
    return float(np.percentile(sizes, _PERCENTILE)) if len(sizes) else 0.0
