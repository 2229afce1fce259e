"""Points of steady power out of records of a propeller aircraft.

A point is the mean over a few seconds with lever and propeller at rest: climb, descent, level
acceleration or deceleration.  The force along the path per mass is the specific force of a
reconstructed path, or follows from the energy height::

    f = ax cos(alpha) + az sin(alpha)          f = d/dt (V^2 / 2 + g h) / V
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError, UnknownName
from flightmech.units import G0
from flighttest.reconstruction.dynamics.shaft_condition import (
    air_of,
    has_shaft_speed,
    shaft_speed,
)

# Duration of a point. [s]
DURATION = 6.0
# Largest range of the lever, and relative range of the speed of the propeller, within a point.
_LEVER_RANGE, _SPEED_RANGE = 0.03, 0.04
# Largest bank angle. [rad]
_BANK = np.radians(20.0)
# Flaps [rad], undercarriage and speed brake [1] that count as the same.
_CONFIGURATION = {"delta_f": np.radians(2.0), "gear": 0.1, "speedbrake": 0.05}
# Temperature ratio of the air to the standard air over a change of pressure altitude.
_HEIGHTS = ("h", "h_gps", "h_baro")
# Channels of an engine; those that exist in the record are used.
ENGINE_CHANNELS = (
    "rpm",
    "engine_rpm",
    "torque",
    "manifold_pressure",
    "fuel_flow",
    "throttle",
    "prop_command",
    "mixture",
    "feather",
    "blade_angle",
    "n1",
    "n2",
)

_LEAST_SPEED = 1.0  # [m/s]
# Reasons to leave out a window, as in the message.
_POWER_CHANGES, _BANKED, _ON_GROUND = "power changes", "banked", "on the ground"
_NO_AIRSPEED, _MISSING = "without airspeed", "with missing numbers"
_CUT_OFF = "with an engine cut off"
_REASONS = (_POWER_CHANGES, _BANKED, _ON_GROUND, _NO_AIRSPEED, _MISSING, _CUT_OFF)


def propeller_points(
    records: Sequence[Any], aircraft: Aircraft, duration: float = DURATION
) -> xr.Dataset:
    """Return points of steady power from records.

    Parameters
    ----------
    records : sequence of Path or Dataset (time,)
        Reconstructions or their states, or cut records, on a uniform clock: ``V`` [m/s]; ``h``,
        ``h_gps`` or ``h_baro`` [m]; ``temperature`` [K] and ``p_static`` [Pa] where they exist;
        ``mass`` [kg], by default that of the aircraft; for each engine ``engineN.rpm`` [rad/s] and
        what exists of ``torque`` [N m], ``manifold_pressure`` [Pa], ``fuel_flow`` [kg/s],
        ``throttle``, ``feather`` ... [1].  With ``alpha`` [rad] and the specific forces ``ax``,
        ``az`` at the c.g. [m/s2] the force along the path is that of the accelerometers.
    aircraft : Aircraft
        Engines with propellers.
    duration : float
        Time over which a point is a mean. [s]

    Returns
    -------
    Dataset (point,)
        Means of the channels, ``f`` and ``lift_force`` (specific forces along and across the path)
        [m/s2], ``engineN.rpm_dot`` of the propeller [rad/s2], ``run``, the number of the record,
        and ``time``. The attribute ``force`` is ``accelerometer`` or ``energy``; ``left_out``
        states what was omitted.

    Raises
    ------
    UnknownName
        A channel is missing.
    IdentificationError
        No window has steady power.
    """
    parts: list[dict[str, np.ndarray]] = []
    left_out = dict.fromkeys(_REASONS, 0)
    states = [getattr(record, "states", record) for record in records]
    kinds = {_has_specific_force(one) for one in states}
    # One equation of the force for all points, because its errors are common.
    accelerometer = kinds == {True}
    for number, one in enumerate(states):
        for part in _windows(one, duration):
            reason = _reason_to_omit(part, aircraft)
            if reason:
                left_out[reason] += 1
                continue
            point = _point(part, aircraft, accelerometer) | {"run": np.asarray(number)}
            if np.isfinite(list(point.values())).all():
                parts.append(point)
            else:
                left_out[_MISSING] += 1
    if not parts:
        reasons = ", ".join(f"{count} {name}" for name, count in left_out.items() if count)
        raise IdentificationError(
            f"no window of {duration:g} s has steady power ({reasons or 'records too short'}); add "
            f"climbs, glides, level accelerations or decelerations with the levers at rest"
        )
    names = set(parts[0]).intersection(*parts)
    columns = {}
    for name in names:
        values = [part[name] for part in parts]
        columns[name] = ("point", np.array(values, float))
    points = xr.Dataset(columns)
    points, others = _of_one_configuration(points)
    left_out["of another configuration"] = others
    dropped = set().union(*parts) - names
    words = [f"{count} windows {name}" for name, count in left_out.items() if count]
    if dropped:
        words.append(f"channels that not all records have: {' '.join(sorted(dropped))}")
    force = "accelerometer" if accelerometer else "energy"
    return points.assign_attrs(force=force, left_out="; ".join(words))


def _has_specific_force(states: xr.Dataset) -> bool:
    return all(name in states for name in ("alpha", "ax", "az"))


def _windows(states: xr.Dataset, duration: float):
    """Yield successive windows of a record."""
    time = states["time"].values
    if len(time) < 2:
        return
    step = float(np.median(np.diff(time)))
    width = max(round(duration / step), 4)
    for begin in range(0, len(time) - width + 1, width):
        part = states.isel(time=slice(begin, begin + width))
        # a window does not contain a gap
        if part["time"].values[-1] - part["time"].values[0] < 1.5 * width * step:
            yield part


def _reason_to_omit(part: xr.Dataset, aircraft: Aircraft) -> str:
    """Return why a window is not a point; empty if it is one."""
    for name in part.data_vars:
        if str(name).startswith("wow_") and float(part[name].max()) > 0.5:
            return _ON_GROUND
    if "V" in part and float(part["V"].values.mean()) < _LEAST_SPEED:
        return _NO_AIRSPEED
    if "phi" in part and float(np.abs(part["phi"].values).mean()) > _BANK:
        return _BANKED
    if cut_off_samples(part, len(aircraft.engines)).any():
        return _CUT_OFF
    for number in range(1, len(aircraft.engines) + 1):
        for lever in ("throttle", "prop_command", "feather"):
            name = f"engine{number}.{lever}"
            if name in part and _smooth_range(part[name].values) > _LEVER_RANGE:
                return _POWER_CHANGES
        speed = _speed_of(part, aircraft, number)
        mean = max(float(speed.mean()), 1.0)
        if float(speed.mean()) > 10.0 and _smooth_range(speed) > _SPEED_RANGE * mean:
            return _POWER_CHANGES
    return ""


def cut_off_samples(states: xr.Dataset, engines: int) -> np.ndarray:
    """Return the samples at which an engine is cut off and its propeller not feathered (time,).

    The lever of such an engine does not show its power. A feathered propeller has none.
    """
    cut = np.zeros(states.sizes["time"], bool)
    for number in range(1, engines + 1):
        name, feather = f"engine{number}.cutoff", f"engine{number}.feather"
        if name not in states:
            continue
        off = states[name].values > 0.5
        if feather in states:
            off &= states[feather].values < 0.5
        cut |= off
    return cut


def _speed_of(part: xr.Dataset, aircraft: Aircraft, number: int) -> np.ndarray:
    """Return the speed of a propeller (time,). [rad/s]"""
    if not has_shaft_speed(part, number):
        raise UnknownName(
            f"engine{number}.rpm",
            map(str, part.data_vars),
            "channel",
            "thrust and power of a propeller need its speed",
        )
    names = (f"engine{number}.{name}" for name in ("rpm", "engine_rpm"))
    columns = {name: part[name].values for name in names if name in part}
    return shaft_speed(columns, aircraft.engines[number - 1], number)


def _mean(part: xr.Dataset, name: str) -> float:
    """Return the mean of the known samples of a channel; NaN without one."""
    values = part[name].values
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan


def _smooth_range(x: np.ndarray) -> float:
    """Return the range of the means over quarters of a window, which noise hardly changes."""
    means = [float(np.mean(quarter)) for quarter in np.array_split(x, 4)]
    return max(means) - min(means)


def _slope(time: np.ndarray, x: np.ndarray) -> float:
    """Return the slope of the least-squares line."""
    t = time - time.mean()
    return float(t @ (x - x.mean()) / (t @ t))


def _point(part: xr.Dataset, aircraft: Aircraft, accelerometer: bool) -> dict[str, np.ndarray]:
    """Return the means of a window, and the force along the path."""
    time = part["time"].values.astype(float)
    names = ["V", "h", "p_static", "temperature", "mass", "alpha", "phi", *_CONFIGURATION]
    for number in range(1, len(aircraft.engines) + 1):
        names += [f"engine{number}.{name}" for name in ENGINE_CHANNELS]
    means = {}
    for name in names:
        if name in part:
            means[name] = np.asarray(_mean(part, name))
    if "V" not in means:
        raise UnknownName("V", map(str, part.data_vars), "channel", "true airspeed")
    means.setdefault("mass", np.asarray(aircraft.mass))
    height, climb = _height_and_climb(part, time)
    means.setdefault("h", np.asarray(height))
    V, V_dot = part["V"].values, _slope(time, part["V"].values)
    gamma = np.arcsin(np.clip(climb / V.mean(), -1.0, 1.0))
    if accelerometer:
        al, ax, az = (part[name].values for name in ("alpha", "ax", "az"))
        f = float(np.mean(ax * np.cos(al) + az * np.sin(al)))
        across = float(np.mean(ax * np.sin(al) - az * np.cos(al)))
    else:
        f = V_dot + G0 * climb / V.mean()
        bank = _mean(part, "phi") if "phi" in part else 0.0
        across = G0 * np.cos(gamma) / np.cos(bank)
    for number in range(1, len(aircraft.engines) + 1):
        rate = _slope(time, _speed_of(part, aircraft, number))
        means[f"engine{number}.rpm_dot"] = np.asarray(rate)
    if "alpha" not in means and "theta" in part:
        # wings level in air at rest: attitude less path angle
        means["alpha"] = np.asarray(_mean(part, "theta") - gamma)
    added = {"f": f, "lift_force": across, "V_dot": V_dot, "hdot": climb, "time": time.mean()}
    return means | {name: np.asarray(x) for name, x in added.items()}


def _height_and_climb(part: xr.Dataset, time: np.ndarray) -> tuple[float, float]:
    """Return mean height [m] and rate of climb [m/s] of a window.

    A change of pressure altitude is that of the standard air; the geometric one is larger by the
    ratio of the temperatures.
    """
    for name in _HEIGHTS:
        if name not in part:
            continue
        h = part[name].values
        climb = _slope(time, h)
        if name == "h_baro" and "temperature" in part:
            mean = {"h": np.array([h.mean()])}
            standard = float(air_of(mean)["temperature"][0])
            climb *= _mean(part, "temperature") / standard
        return float(h.mean()), climb
    raise UnknownName("h", map(str, part.data_vars), "channel", "energy needs a height")


def _of_one_configuration(points: xr.Dataset) -> tuple[xr.Dataset, int]:
    """Return the points of the most frequent configuration, and the number of the others."""
    same = np.ones(points.sizes["point"], bool)
    for name, distance in _CONFIGURATION.items():
        if name in points:
            values = points[name].values
            counts = [np.count_nonzero(np.abs(values - x) < distance) for x in values]
            same &= np.abs(values - values[int(np.argmax(counts))]) < distance
    return points.isel(point=np.flatnonzero(same)), int(np.count_nonzero(~same))
