"""How a replay starts: state, rates and accelerations of the flight, mass, and the air of the day."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.air import P_SEA, atmosphere

from .case import PomCase
from .case_file import INITIAL, MASS

NEAR = 100.0  # [m] height under which the radio altitude shows the runway
STANDING = 0.3  # [m s-1] ground speed that is the noise of the reconstruction
SETTLED = 0.8  # [s] from which the initial rates, accelerations and inputs are read


def initial_state(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    """Return the parameters ``init.*``: the first sample, with rates and accelerations from the first part of the window. [SI]"""
    found = {name: _first(states, name) for name in INITIAL if name in states}
    if "gamma" not in found and {"vn", "ve", "vd"} <= set(states):
        found["gamma"] = float(np.arctan2(-_first(states, "vd"), np.hypot(_first(states, "vn"), _first(states, "ve"))))
    found.update(_rolling(states) if case.drive.trim == "ground" else starting_rates(states))
    found.update({name: value for name, value in case.conditions.items() if name in INITIAL})
    return {f"init.{name}": value for name, value in found.items()}


def _first(states: xr.Dataset, name: str) -> float:
    """Return the first sample of a state, or its constant; ``isel`` takes a millisecond for all states. [SI]"""
    return float(states.variables[name].values.flat[0])


def _rolling(states: xr.Dataset) -> dict[str, float]:
    """Return the start of an aircraft on its wheels: its speed over the ground, zero when it stands; nothing else moves."""
    speed = float(np.hypot(_first(states, "vn"), _first(states, "ve")))
    return {"V": speed if speed > STANDING else 0.0, "gamma": 0.0, "p": 0.0, "q": 0.0, "r": 0.0}


def starting_rates(states: xr.Dataset) -> dict[str, float]:
    """Return p, q, r at the start and the accelerations u', v', w', p', q', r', from the first part of the window.

    The model is trimmed to the accelerations: a steady flight gives zeros, a turn or a decelerating approach does not.
    [rad s-1, m s-2, rad s-2]
    """
    time = states["time"].values.astype(float)
    found = {}
    for name in (name for name in ("u", "v", "w", "p", "q", "r") if name in states and time.size > 2):
        start, slope = line_at_start(time, states[name].values.astype(float))
        found[f"{name}_dot"] = slope
        if name in "pqr":
            found[name] = start
    return found


def line_at_start(time: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return value and slope of `y` at the start, from `SETTLED` seconds; a slope within its noise is zero.

    Single samples carry the noise of gyros and pick-ups; a trim made on one would carry it through the whole replay.
    """
    early = time <= time[0] + SETTLED + 1e-9
    t, y = time[early] - time[0], y[early]
    if t.size < 4:
        return float(y[0]), 0.0
    (slope, start), residual, *_ = np.polyfit(t, y, 1, full=True)
    spread = np.sqrt(float(residual[0]) / (t.size - 2)) if residual.size else 0.0
    if abs(slope) < 3.0 * spread / np.sqrt(np.sum((t - t.mean()) ** 2)):
        return float(y.mean()), 0.0
    return float(start), float(slope)


def mass_and_air(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    """Return the parameters ``mass.*`` and ``env.*``. [SI]"""
    found = {}
    for name in MASS:
        if name in case.conditions:
            found[f"mass.{name}"] = case.conditions[name]
        elif name in states:
            found[f"mass.{name}"] = _first(states, name)
    found.update(_air(states))
    if "delta_T" in case.conditions:
        found["env.delta_T"] = case.conditions["delta_T"]
    runway = case.conditions.get("runway_elevation", _runway(states))
    return found if runway is None else {**found, "env.runway_elevation": runway}


def _runway(states: xr.Dataset) -> float | None:
    """Return the elevation of the runway from heights over it; None when the flight never came near one. [m]"""
    if not {"h", "h_agl", "phi", "theta"} <= set(states):
        return None
    near = np.isfinite(states["h_agl"].values) & (states["h_agl"].values < NEAR)
    if not near.any():
        return None
    phi, theta = states["phi"].values, states["theta"].values
    x, y, z = (states[name].values if name in states else 0.0 for name in ("x_cg_b", "y_cg_b", "z_cg_b"))
    # h_agl is that of the moment reference point, which lies above the c.g. by the c.g.'s vector along down
    down = -np.sin(theta) * x + np.cos(theta) * (np.sin(phi) * y + np.cos(phi) * z)
    return float(np.median((states["h"].values + down - states["h_agl"].values)[near]))


def _air(states: xr.Dataset) -> dict[str, float]:
    """Return the offsets of the standard atmosphere that give the recorded temperature and pressure at the height."""
    if not {"h", "p_static", "temperature"} <= set(states):
        return {}
    h, p, T = (_first(states, name) for name in ("h", "p_static", "temperature"))
    delta_T = T - float(atmosphere(h).temperature)
    return {"env.delta_T": delta_T, "env.qnh": P_SEA * p / float(atmosphere(h, delta_T).p_static)}  # pressure scales with that at sea level
