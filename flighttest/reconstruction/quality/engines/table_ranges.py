"""Records of an engine that lie beyond the axes of its tables: mostly an axis in another unit.

Beyond its last node a table is held or continued, so that the engine of the simulation does not
answer to what the record holds there.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from math import pi

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine, list_leaves
from flighttest.reconstruction.quality.finding import Finding

_MARGIN = 0.05  # of the range of an axis, beyond which a sample is outside
_SHARE = 0.2  # of the samples, from which they are named
_TURNING = 0.5  # of the rated speed, below which an advance ratio does not belong to tables
_OFTEN = 5.0  # percentile that is not a spike
_OF_ENGINE = ("manifold_pressure", "throttle", "pla", "n1", "n2", "rpm", "blade_angle")
# channels of the aircraft that stand for an axis, the best one first
_OF_AIRCRAFT = {"mach": ("mach",), "h": ("h", "h_baro", "h_gps"), "V": ("V",)}
# unit in which an axis is shown, and its size
_UNITS = {
    "manifold_pressure": ("kPa", 1e3),
    "rpm": ("rad/s", 1.0),
    "engine_rpm": ("rad/s", 1.0),
    "blade_angle": ("rad", 1.0),
    "pla": ("rad", 1.0),
    "h": ("m", 1.0),
    "V": ("m/s", 1.0),
}


def range_findings(
    values: Mapping[str, np.ndarray], aircraft: Aircraft, explained: Collection[str] = ()
) -> list[Finding]:
    """Return the warnings on recorded conditions beyond the axes of the tables of an engine.

    Parameters
    ----------
    values : mapping of str to array (time,)
        Channels in flight: ``engine1.rpm``, ``engine1.manifold_pressure`` and so on, ``V``,
        ``mach``, ``h_baro``. [SI]
    aircraft : Aircraft
    explained : collection of str
        Axes whose unit is known to be wrong. They are left out.

    Returns
    -------
    list of Finding
        One for each engine and axis with a fifth of the samples outside, by more than 5 % of its
        range.
    """
    findings = []
    for number, engine in enumerate(aircraft.engines, 1):
        for axis, (tables, nodes) in _axes_of(engine).items():
            found = _condition(axis, values, engine, number)
            if axis in explained or found is None:
                continue
            channel, x = found
            first, last = float(nodes.min()), float(nodes.max())
            margin = _MARGIN * (last - first)
            outside = float(np.mean((x < first - margin) | (x > last + margin))) if x.size else 0.0
            if outside < _SHARE:
                continue
            low, high = np.percentile(x, [_OFTEN, 100.0 - _OFTEN])
            text = (
                f"engine {number}: {outside:.0%} of the flight is outside of the axis {axis} of "
                f"{', '.join(tables)}: recorded {_span(axis, low, high)}, table "
                f"{_span(axis, first, last)}"
            )
            remedy = (
                f"check the unit of the axis {axis} in the aircraft file and that of {channel} in "
                f"the name map; else extend the table to the flight"
            )
            evidence = {"share": outside, "first": first, "last": last}
            finding = Finding("warning", "range", (channel,), text, remedy, evidence=evidence)
            findings.append(finding)
    return findings


def _axes_of(engine: Engine) -> dict[str, tuple[list[str], np.ndarray]]:
    """Return for each axis the names of its tables and the nodes of the widest of them."""
    axes: dict[str, tuple[list[str], np.ndarray]] = {}
    for target, leaf in list_leaves(engine).items():
        for axis in map(str, leaf.variables["value"].dims):
            if axis not in leaf.variables or leaf.variables[axis].size < 2:
                continue
            nodes = leaf.variables[axis].values
            tables, known = axes.get(axis, ([], nodes))
            widest = nodes if np.ptp(nodes) > np.ptp(known) else known
            axes[axis] = ([*tables, target], widest)
    return axes


def _condition(
    axis: str, values: Mapping[str, np.ndarray], engine: Engine, number: int
) -> tuple[str, np.ndarray] | None:
    """Return the channel of an axis and its finite samples; None if it is not recorded."""
    name = f"engine{number}.{axis}"
    if axis in _OF_ENGINE and name in values:
        return name, _finite(values[name])
    for name in _OF_AIRCRAFT.get(axis, ()):
        if name in values:
            return name, _finite(values[name])
    speed, propeller = f"engine{number}.rpm", engine.propeller
    if propeller is None or speed not in values:
        return None
    turning = values[speed] > _TURNING * propeller.rpm_high
    if axis == "engine_rpm":
        return speed, _finite(values[speed][turning] * propeller.gear_ratio)
    if axis == "J" and "V" in values:
        revolutions = values[speed][turning] / (2.0 * pi)
        return speed, _finite(values["V"][turning] / (revolutions * propeller.diameter))
    return None


def _finite(x: np.ndarray) -> np.ndarray:
    return x[np.isfinite(x)]


def _span(axis: str, low: float, high: float) -> str:
    """Return a range of an axis with its unit."""
    unit, size = _UNITS.get(axis, ("", 1.0))
    return f"{low / size:.4g} to {high / size:.4g} {unit}".rstrip()
