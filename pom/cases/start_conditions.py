"""Start of a replay: initial state, accelerations, mass and air of the first sample."""

from __future__ import annotations

import math
import re

import numpy as np
import xarray as xr

from flightmech.air import P_SEA, atmosphere
from flightmech.aircraft.aircraft import tanks_of, with_contents
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.names import lookup
from flightmech.units import DEGREE, POUND_FORCE
from pom.cases.case import PomCase
from pom.cases.case_file import BRAKES, FORCES, INITIAL, INPUTS, MASS, TRAVEL

RUNWAY_HEIGHT = 100.0  # [m] below it the radio altitude shows the elevation of the runway
STANDSTILL_SPEED = 0.3  # [m s-1] ground speed within the noise of the reconstruction
FIT_TIME = 0.8  # [s] part of the window that gives initial rates, accelerations and inputs
LEAST_FIT_TIME = 0.2  # [s] shortest such part, which also gives the level of a control
MOVEMENTS = {"rad": 1.0 * DEGREE, "m": 0.005, "N": 5.0 * POUND_FORCE, "N m": 3.0, "1": 0.05}
"""Change of a control by unit from which on it has left its start. [SI]

Thrust, torque and the like: `MOVED_SHARE` of the largest value.  Our numbers; those of surfaces and
forces are the tolerances of the trim rows of Table A2A.
"""
MOVED_SHARE = 0.05
MOVED_NOISE = (
    6.0  # standard deviations of the noise from sample to sample: less does not count as movement
)
NEAR_LEVEL = 0.25  # of a change: the movement begins after the last sample so near its start
_TIME_ROUNDING = 1e-9  # [s] the last sample of a range may be later by a rounding error
_TO_SIGMA = 1.4826  # standard deviation of normal noise over its median absolute deviation
_ENGINE_DRIVE = re.compile(r"^engine\d+\.(throttle|pla|n1|thrust|torque|rpm|manifold_pressure)$")


def initial_state(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    """Return the parameters ``init.*``. [SI]

    They are those of the first sample; rates and accelerations come from a line through the first
    part of the window.  ``[conditions]`` of the case file replaces them.
    """
    start = {name: _first_sample(states, name) for name in INITIAL if name in states}
    if "gamma" not in start and {"vn", "ve", "vd"} <= set(states):
        # Flight-path angle over the ground: tan gamma = -vd / sqrt(vn^2 + ve^2)
        speed = np.hypot(_first_sample(states, "vn"), _first_sample(states, "ve"))
        start["gamma"] = float(np.arctan2(-_first_sample(states, "vd"), speed))
    if case.drive.trim == "ground":
        start.update(_rolling_start(states))
    else:
        start.update(starting_rates(states, quiet_time(states)))
    for name, value in case.conditions.items():
        if name in INITIAL:
            start[name] = value
    return {f"init.{name}": value for name, value in start.items()}


def _first_sample(states: xr.Dataset, name: str) -> float:
    """Return the first sample of a state, or its constant. [SI]"""
    # `isel` on the data set would copy every state
    return float(states.variables[name].values.flat[0])


def _rolling_start(states: xr.Dataset) -> dict[str, float]:
    """Return the start on the wheels: the ground speed, zero at standstill, and no rates. [SI]"""
    speed = float(np.hypot(_first_sample(states, "vn"), _first_sample(states, "ve")))
    if not speed > STANDSTILL_SPEED:
        speed = 0.0
    return {"V": speed, "gamma": 0.0, "p": 0.0, "q": 0.0, "r": 0.0}


def quiet_time(states: xr.Dataset) -> float:
    """Return the first part of the window in which no control moves, at most `FIT_TIME`. [s]

    A line through samples after the movement gives neither the trim nor the accelerations of the
    start: a step of 5 deg after 0.5 s moves its start by 1.6 deg.
    """
    time = states["time"].values.astype(float)
    since = time - time[0]
    early = since <= FIT_TIME + _TIME_ROUNDING
    first = since[early] <= LEAST_FIT_TIME + _TIME_ROUNDING
    quiet = FIT_TIME
    for name, item in states.data_vars.items():
        if item.dims != ("time",) or not _is_control(str(name)):
            continue
        values = item.values.astype(float)
        least = _least_movement(str(name), values)
        values = values[early]
        if not np.isfinite(values[first]).any() or not least > 0.0:
            continue
        away = np.abs(values - np.nanmedian(values[first]))
        moved = np.flatnonzero(away > least)
        if moved.size:
            near = np.flatnonzero(away[: moved[0]] <= NEAR_LEVEL * least)
            onset = float(since[near[-1]]) if near.size else 0.0
            quiet = min(quiet, onset)
    return max(quiet, LEAST_FIT_TIME)


def _is_control(name: str) -> bool:
    """Return whether a channel is a control of the pilot, or a quantity that drives an engine."""
    if _ENGINE_DRIVE.match(name):
        return True
    return name in (*INPUTS, *TRAVEL, *FORCES, *BRAKES)


def _least_movement(name: str, values: np.ndarray) -> float:
    """Return the change (time,) from which on a control has left its start. [SI]"""
    known = values[np.isfinite(values)]
    if known.size < 2:
        return 0.0
    unit = lookup(name).units
    least = MOVEMENTS.get(unit)
    # thrust and torque have the units of pilot forces
    if least is None or (_ENGINE_DRIVE.match(name) and unit != "1"):
        least = MOVED_SHARE * float(np.abs(known).max())
    # differences of white noise have the root of two times its standard deviation
    noise = _TO_SIGMA * float(np.median(np.abs(np.diff(known)))) / math.sqrt(2.0)
    return max(least, MOVED_NOISE * noise)


def starting_rates(states: xr.Dataset, span: float = FIT_TIME) -> dict[str, float]:
    """Return p, q, r and the accelerations u', v', w', p', q', r' at the start.

    They come from the first `span` seconds of the window.  The model is trimmed to the
    accelerations.  A steady flight gives zeros, a turn or a decelerating approach does not.
    [rad s-1, m s-2, rad s-2]
    """
    time = states["time"].values.astype(float)
    rates: dict[str, float] = {}
    if time.size <= 2:
        return rates
    for name in ("u", "v", "w", "p", "q", "r"):
        if name not in states:
            continue
        start, slope = line_at_start(time, states[name].values.astype(float), span)
        rates[f"{name}_dot"] = slope
        # The speeds u, v, w are set by V, alpha and beta, not by the line.
        if name in "pqr":
            rates[name] = start
    return rates


def line_at_start(time: np.ndarray, y: np.ndarray, span: float = FIT_TIME) -> tuple[float, float]:
    """Return value and slope of `y` at the start, from a line through `span` seconds.

    A slope within its noise is zero.  Single samples have the noise of gyros and pick-ups, which
    would bias the trim and thereby the whole replay.
    """
    early = time <= time[0] + span + _TIME_ROUNDING
    t, y = time[early] - time[0], y[early]
    if t.size < 4:
        return float(y[0]), 0.0
    (slope, start), residual, *_ = np.polyfit(t, y, 1, full=True)
    # Standard error of the slope of a line: s / sqrt(sum (t - t_mean)^2), with s^2 the sum of
    # squared residuals over n - 2. polyfit returns no sum if its matrix has a lower rank.
    spread = 0.0
    if residual.size:
        spread = np.sqrt(float(residual[0]) / (t.size - 2))
    # a slope below three standard errors is noise
    if abs(slope) < 3.0 * spread / np.sqrt(np.sum((t - t.mean()) ** 2)):
        return float(y.mean()), 0.0
    return float(start), float(slope)


def mass_and_air(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    """Return the parameters ``mass.*`` and ``env.*``. [SI]"""
    parameters = {}
    for name in MASS:
        if name in case.conditions:
            parameters[f"mass.{name}"] = case.conditions[name]
        elif name in states:
            parameters[f"mass.{name}"] = _first_sample(states, name)
    # what the case states or the record has comes before the aircraft file
    parameters = _tank_contents(case, states) | parameters
    parameters.update(_atmosphere_offsets(states))
    if "delta_T" in case.conditions:
        parameters["env.delta_T"] = case.conditions["delta_T"]
    runway = case.conditions.get("runway_elevation", _runway_elevation(states))
    if runway is not None:
        parameters["env.runway_elevation"] = runway
    return parameters


def _tank_contents(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    """Return the recorded contents of the tanks at the start, and the inertia with them. [SI]

    Mass and c.g. of the states hold with the recorded contents; the inertia of the aircraft file
    holds with the contents of the file.
    """
    if not case.aircraft or not any(str(name).startswith("tank.") for name in states.data_vars):
        return {}
    aircraft = read_aircraft(case.aircraft)
    contents = {}
    for tank in tanks_of(aircraft):
        name = f"tank.{tank.name}.fuel"
        if name in states:
            # a gauge may show a little more than full
            contents[tank.name] = min(max(_first_sample(states, name), 0.0), tank.capacity)
    parameters = {}
    for tank_name, content in contents.items():
        parameters[f"init.tank.{tank_name}.fuel"] = content
        parameters[f"mass.tank.{tank_name}.fuel"] = content
    if contents:
        loaded = with_contents(aircraft, contents)
        inertia = [name for name in MASS if name.startswith("I")]
        parameters |= {f"mass.{name}": float(getattr(loaded, name)) for name in inertia}
    return parameters


def _runway_elevation(states: xr.Dataset) -> float | None:
    """Return the elevation of the runway from radio heights, or None without low flight. [m]"""
    if not {"h", "h_agl", "phi", "theta"} <= set(states):
        return None
    is_low = np.isfinite(states["h_agl"].values) & (states["h_agl"].values < RUNWAY_HEIGHT)
    if not is_low.any():
        return None
    phi, theta = states["phi"].values, states["theta"].values
    x, y, z = (_values_or_zero(states, name) for name in ("x_cg_b", "y_cg_b", "z_cg_b"))
    # h is the height of the c.g., and h_agl the height of the moment reference point. The reference
    # point lies above the c.g. by the down component of the vector from it to the c.g. (third row
    # of the rotation from body to earth axes).
    down = -np.sin(theta) * x + np.cos(theta) * (np.sin(phi) * y + np.cos(phi) * z)
    return float(np.median((states["h"].values + down - states["h_agl"].values)[is_low]))


def _values_or_zero(states: xr.Dataset, name: str) -> np.ndarray | float:
    if name in states:
        return states[name].values
    return 0.0


def _atmosphere_offsets(states: xr.Dataset) -> dict[str, float]:
    """Return the offsets of the standard atmosphere that reproduce the recorded air."""
    if not {"h", "p_static", "temperature"} <= set(states):
        return {}
    h, p, T = (_first_sample(states, name) for name in ("h", "p_static", "temperature"))
    delta_T = T - float(atmosphere(h).temperature)
    # the pressure at a height is proportional to the pressure at sea level
    qnh = P_SEA * p / float(atmosphere(h, delta_T).p_static)
    return {"env.delta_T": delta_T, "env.qnh": qnh}
