"""What drives a model in a case: recorded inputs, the initial state, mass, air, and how it is trimmed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from flightmech.air import P_SEA, atmosphere
from flightmech.errors import OutOfRange, UnknownName

from .case import BRAKES, INITIAL, INPUTS, MASS, WIND, PomCase
from .pilot import Loop

# what drives the engines: the recorded quantity, the input it becomes, mode.engine
ENGINE_DRIVES = {"throttle": ("throttle", "throttle", 0.0), "n1": ("n1", "n1_drive", 1.0), "thrust": ("thrust", "thrust_drive", 2.0)}
SEEK_THRUST, SEEK_THROTTLE, SEEK_GROUND = 1.0, 2.0, 3.0  # mode.trim
NEAR = 100.0  # [m] height under which the radio altitude tells of the runway
RELEASED = 0.02  # [1] brake pedal under which it counts as up
STANDING = 0.3  # [m s-1] ground speed that is the noise of the reconstruction
SETTLED = 0.8  # [s] from which the initial rates, accelerations and inputs are read
NEEDED = ("init.V", "init.phi", "init.theta", "init.psi", "init.p", "init.q", "init.r", "init.h")
_ENGINE = re.compile(r"^engine(\d+)\.(thrust|n1|throttle)$")


@dataclass(frozen=True)
class Job:
    """Inputs and parameters of one replay, the same for every model.

    Attributes
    ----------
    time : array (time,)
        Communication points, the samples of the record. [s]
    inputs : dict of str to array (time,)
        [SI]
    parameters : dict of str to float
        ``init.*``, ``mass.*``, ``env.*``, ``mode.*``. [SI]
    needed_inputs, needed_parameters : tuple of str
        Without these a model cannot be flown (inputs that are zero throughout are not among them); the others are given
        where it takes them.
    pilot : tuple of Loop
        Loops of the math pilot, closed sample by sample (`pom.pilot.Pilot`); their controls are among the inputs.
    targets : dict of str to array (time,)
        The recorded channel of every loop. [SI]
    """

    time: np.ndarray
    inputs: dict[str, np.ndarray]
    parameters: dict[str, float]
    needed_inputs: tuple[str, ...]
    needed_parameters: tuple[str, ...]
    pilot: tuple[Loop, ...] = ()
    targets: dict[str, np.ndarray] = field(default_factory=dict)


def job_of(case: PomCase, states: xr.Dataset) -> Job:
    """Return what drives the models.

    Raises
    ------
    OutOfRange
        A NaN in an input or in the initial state.
    UnknownName
        The record has no such control, thrust or state.
    """
    time = states["time"].values.astype(float)
    inputs = _inputs(case, states)
    for name, values in inputs.items():
        bad = ~np.isfinite(values)
        if bad.any():
            raise OutOfRange(
                f"case {case.name}: input {name} has no value in {int(bad.sum())} of {bad.size} samples, first at "
                f"t = {time[bad][0]:g} s; repair the record or move the window",
                bad,
            )
    parameters = {**_initial(case, states), **_mass_and_air(case, states), **_modes(case, states)}
    missing = [name.removeprefix("init.") for name in NEEDED if name not in parameters]
    if missing:
        raise UnknownName(missing[0], map(str, states.data_vars), "state", f"case {case.name} starts from the state of the flight")
    for name, value in parameters.items():
        if not np.isfinite(value):
            raise OutOfRange(f"case {case.name}: {name} has no value at the start of the window, t = {time[0]:g} s; move the window")
    moving = tuple(name for name, values in inputs.items() if values.any())
    for values in inputs.values():
        values[0] = _start(time, values)[0]  # the sample on which the model is trimmed
    return Job(time, inputs, parameters, moving, (*NEEDED, *(name for name in parameters if name in ("mode.engine", "mode.trim"))))


def _inputs(case: PomCase, states: xr.Dataset) -> dict[str, np.ndarray]:
    count = states.sizes["time"]
    found = {}
    for name in (*INPUTS, *WIND):
        if name in case.conditions:
            found[name] = np.full(count, case.conditions[name])
        elif name in states:
            found[name] = np.broadcast_to(states[name].values.astype(float), count).copy()
        elif name in BRAKES and "brake" in states:
            pedal = np.clip(np.broadcast_to(states["brake"].values.astype(float), count), 0.0, 1.0)
            found[name] = np.where(pedal > RELEASED, pedal, 0.0)
        elif name in ("delta_e", "delta_a", "delta_r"):
            raise UnknownName(name, map(str, states.data_vars), "recorded control", f"case {case.name} drives the surfaces as recorded")
    control, drive, _ = ENGINE_DRIVES[case.drive.engine]
    engines = [match.group(1) for name in states.data_vars if (match := _ENGINE.match(str(name))) and match.group(2) == control]
    if not engines:
        raise UnknownName(f"engine1.{control}", map(str, states.data_vars), "recorded quantity", f'drive.engine is "{case.drive.engine}"')
    for number in sorted(engines):
        found[f"engine{number}.{drive}"] = np.broadcast_to(states[f"engine{number}.{control}"].values.astype(float), count).copy()
    return found


def _initial(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    first = states.isel(time=0)
    found = {name: float(first[name]) for name in INITIAL if name in states}
    found.update(_rolling(first) if case.drive.trim == "ground" else starting_rates(states))
    found.update({name: value for name, value in case.conditions.items() if name in INITIAL})
    return {f"init.{name}": value for name, value in found.items()}


def _rolling(first: xr.Dataset) -> dict[str, float]:
    """Return the start of an aircraft on its wheels: its speed over the ground, zero when it stands; nothing else moves."""
    speed = float(np.hypot(first["vn"], first["ve"]))
    return {"V": speed if speed > STANDING else 0.0, "gamma": 0.0, "p": 0.0, "q": 0.0, "r": 0.0}


def starting_rates(states: xr.Dataset) -> dict[str, float]:
    """Return p, q, r at the start and the accelerations u', v', w', p', q', r', from the first part of the window.

    The model is trimmed to the accelerations: a steady flight gives zeros, a turn or a decelerating approach does not.
    [rad s-1, m s-2, rad s-2]
    """
    time = states["time"].values.astype(float)
    found = {}
    for name in (name for name in ("u", "v", "w", "p", "q", "r") if name in states and time.size > 2):
        start, slope = _start(time, states[name].values.astype(float))
        found[f"{name}_dot"] = slope
        if name in "pqr":
            found[name] = start
    return found


def _start(time: np.ndarray, y: np.ndarray) -> tuple[float, float]:
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


def _mass_and_air(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    found = {}
    for name in MASS:
        if name in case.conditions:
            found[f"mass.{name}"] = case.conditions[name]
        elif name in states:
            item = states[name]
            found[f"mass.{name}"] = float(item.isel(time=0) if "time" in item.dims else item)
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
    h, p, T = (float(states[name].isel(time=0)) for name in ("h", "p_static", "temperature"))
    delta_T = T - float(atmosphere(h).temperature)
    return {"env.delta_T": delta_T, "env.qnh": P_SEA * p / float(atmosphere(h, delta_T).p_static)}  # pressure scales with that at sea level


def _modes(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    found = {"mode.engine": ENGINE_DRIVES[case.drive.engine][2]}
    if case.drive.trim == "ground":
        found["mode.trim"] = SEEK_GROUND
    elif case.drive.trim:
        found["mode.trim"] = SEEK_THROTTLE if case.drive.engine == "throttle" else SEEK_THRUST
    if "lat" in states or "lat" in case.conditions:
        found["mode.earth"] = 1.0
    return found


def configuration(case: PomCase, job: Job) -> Mapping[str, float]:
    """Return initial conditions and configuration by house name, for the report. [SI]"""
    found = {name.removeprefix("init.").removeprefix("mass.").removeprefix("env."): value for name, value in job.parameters.items()}
    for name in ("delta_f", "gear", "speedbrake", *WIND):
        if name in job.inputs:
            found[name] = float(job.inputs[name][0])
    return {name: value for name, value in found.items() if not name.startswith("mode.") and not name.endswith("_dot")}
