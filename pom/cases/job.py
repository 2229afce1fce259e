"""What drives a model in a case: recorded inputs, the initial state, mass, air, and how it is
trimmed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from flightmech.air import P_SEA, atmosphere
from flightmech.aircraft.controls import DEVICE
from flightmech.errors import OutOfRange, UnknownName
from flightmech.units import DEGREE
from pom.cases.case import PRIMARY, PomCase
from pom.cases.case_file import BRAKES, FORCES, INITIAL, INPUTS, MASS, TRAVEL, WIND
from pom.cases.pilot import PilotLoop

NEAR = 100.0  # [m] height under which the radio altitude shows the runway
STANDING = 0.3  # [m s-1] ground speed that is the noise of the reconstruction
SETTLED = 0.8  # [s] from which the initial rates, accelerations and inputs are read


def initial_state(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    """Return the parameters ``init.*``: the first sample, with rates and accelerations from the
    first part of the window. [SI]
    """
    found = {name: _first(states, name) for name in INITIAL if name in states}
    if "gamma" not in found and {"vn", "ve", "vd"} <= set(states):
        found["gamma"] = float(
            np.arctan2(-_first(states, "vd"), np.hypot(_first(states, "vn"), _first(states, "ve")))
        )
    found.update(_rolling(states) if case.drive.trim == "ground" else starting_rates(states))
    found.update({name: value for name, value in case.conditions.items() if name in INITIAL})
    return {f"init.{name}": value for name, value in found.items()}


def _first(states: xr.Dataset, name: str) -> float:
    """Return the first sample of a state, or its constant; ``isel`` takes a millisecond for all
    states. [SI]
    """
    return float(states.variables[name].values.flat[0])


def _rolling(states: xr.Dataset) -> dict[str, float]:
    """Return the start of an aircraft on its wheels: its speed over the ground, zero when it
    stands; nothing else moves.
    """
    speed = float(np.hypot(_first(states, "vn"), _first(states, "ve")))
    return {"V": speed if speed > STANDING else 0.0, "gamma": 0.0, "p": 0.0, "q": 0.0, "r": 0.0}


def starting_rates(states: xr.Dataset) -> dict[str, float]:
    """Return p, q, r at the start and the accelerations u', v', w', p', q', r', from the first part
    of the window.

    The model is trimmed to the accelerations: a steady flight gives zeros, a turn or a decelerating
    approach does not. [rad s-1, m s-2, rad s-2]
    """
    time = states["time"].values.astype(float)
    found = {}
    for name in (
        name for name in ("u", "v", "w", "p", "q", "r") if name in states and time.size > 2
    ):
        start, slope = line_at_start(time, states[name].values.astype(float))
        found[f"{name}_dot"] = slope
        if name in "pqr":
            found[name] = start
    return found


def line_at_start(time: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return value and slope of `y` at the start, from `SETTLED` seconds; a slope within its noise
    is zero.

    Single samples carry the noise of gyros and pick-ups; a trim made on one would carry it through
    the whole replay.
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
    """Return the elevation of the runway from heights over it; None when the flight never came near
    one. [m]
    """
    if not {"h", "h_agl", "phi", "theta"} <= set(states):
        return None
    near = np.isfinite(states["h_agl"].values) & (states["h_agl"].values < NEAR)
    if not near.any():
        return None
    phi, theta = states["phi"].values, states["theta"].values
    x, y, z = (
        states[name].values if name in states else 0.0 for name in ("x_cg_b", "y_cg_b", "z_cg_b")
    )
    # h_agl is that of the moment reference point, which lies above the c.g. by the c.g.'s vector
    # along down
    down = -np.sin(theta) * x + np.cos(theta) * (np.sin(phi) * y + np.cos(phi) * z)
    return float(np.median((states["h"].values + down - states["h_agl"].values)[near]))


def _air(states: xr.Dataset) -> dict[str, float]:
    """Return the offsets of the standard atmosphere that give the recorded temperature and pressure
    at the height.
    """
    if not {"h", "p_static", "temperature"} <= set(states):
        return {}
    h, p, T = (_first(states, name) for name in ("h", "p_static", "temperature"))
    delta_T = T - float(atmosphere(h).temperature)
    return {
        "env.delta_T": delta_T,
        "env.qnh": P_SEA * p / float(atmosphere(h, delta_T).p_static),
    }  # pressure scales with that at sea level


# what drives the engines: the recorded quantity, the input it becomes, mode.engine
ENGINE_DRIVES = {
    "throttle": ("throttle", "throttle", 0.0),
    "n1": ("n1", "n1_drive", 1.0),
    "thrust": ("thrust", "thrust_drive", 2.0),
}
TRIM_THRUST, TRIM_THROTTLE, TRIM_GROUND = 1.0, 2.0, 3.0  # mode.trim
BANK_RANGE = 1.0 * DEGREE
"""Bank angle by which the trim may leave the recorded one: half the 2 deg of the lateral rows of Table A2A. [rad]

In a straight sideslip the side forces of fin and rudder can nearly cancel: a side acceleration within the accuracy of the record
then takes degrees of rudder, or a tenth of a degree of bank.
"""
RUNWAYS = {"dry": 0.0, "wet": 1.0, "icy": 2.0}  # runway.condition
LEVELS = {"recorded": 0.0, "cockpit": 1.0, "force": 2.0}  # mode.controls
DRIVEN_BY = {
    "recorded": "the surfaces as recorded",
    "cockpit": "column, wheel and pedals as recorded",
    "force": "the pilot forces as recorded",
}
RELEASED = 0.02  # [1] brake pedal under which it counts as up
NEEDED = ("init.V", "init.phi", "init.theta", "init.psi", "init.p", "init.q", "init.r", "init.h")
_LEVER = re.compile(r"^engine\d+\.(throttle|pla)$")
_ENGINE = re.compile(r"^engine(\d+)\.(thrust|n1|throttle)$")


@dataclass(frozen=True)
class ReplayJob:
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
        Without these a model cannot be flown (inputs that are zero throughout are not among them);
        the others are given where it takes them.
    pilot : tuple of Loop
        Loops of the math pilot, closed sample by sample (`pom.cases.pilot.Pilot`); their controls
        are among the inputs.
    targets : dict of str to array (time,)
        The recorded channel of every loop. [SI]
    """

    time: np.ndarray
    inputs: dict[str, np.ndarray]
    parameters: dict[str, float]
    needed_inputs: tuple[str, ...]
    needed_parameters: tuple[str, ...]
    pilot: tuple[PilotLoop, ...] = ()
    targets: dict[str, np.ndarray] = field(default_factory=dict)
    law: LawInputs | None = None


@dataclass(frozen=True)
class LawInputs:
    """What the record holds for a control law.

    Attributes
    ----------
    moves : tuple of str
        Controls that it moves; they are among the inputs of the job, zero.
    recorded : dict of str to array (time,)
        Controls of the cockpit and positions that no law moves, by canonical name. [SI]
    start : dict of str to float
        All that was recorded, at the first sample: what the law is initialised with before the
        model has outputs. [SI]
    """

    moves: tuple[str, ...]
    recorded: dict[str, np.ndarray]
    start: dict[str, float]


def job_of(case: PomCase, states: xr.Dataset) -> ReplayJob:
    """Return what drives the models.

    Raises
    ------
    OutOfRange
        A NaN in an input, in a channel that the math pilot holds, or in the initial state.
    UnknownName
        The record has no such control, thrust, channel or state.
    """
    time = states["time"].values.astype(float)
    inputs = _inputs(case, states)
    loops, targets = _loops(case, states, inputs)
    for name, values in {**inputs, **targets}.items():
        _demand_numbers(case, name, time, values)
    parameters = {
        **initial_state(case, states),
        **mass_and_air(case, states),
        **_modes(case, states),
    }
    missing = [name.removeprefix("init.") for name in NEEDED if name not in parameters]
    if missing:
        raise UnknownName(
            missing[0],
            map(str, states.data_vars),
            "state",
            f"case {case.name} starts from the state of the flight",
        )
    for name, value in parameters.items():
        if not np.isfinite(value):
            raise OutOfRange(
                f"case {case.name}: {name} has no value at the start of the window, t = "
                f"{time[0]:g} s; move the window"
            )
    moved = {loop.control for loop in loops}.union(case.law_moves)
    moving = tuple(
        name
        for name, values in inputs.items()
        if name in moved or (values.any() and name not in _held(case))
    )
    for values in inputs.values():
        values[0] = line_at_start(time, values)[0]  # the sample on which the model is trimmed
    modes = (
        name for name in parameters if name in ("mode.engine", "mode.trim", "runway.condition")
    )
    return ReplayJob(
        time,
        inputs,
        parameters,
        moving,
        (*NEEDED, *modes),
        loops,
        targets,
        _law_inputs(case, states),
    )


def _demand_numbers(case: PomCase, name: str, time: np.ndarray, values: np.ndarray) -> None:
    bad = ~np.isfinite(values)
    if bad.any():
        raise OutOfRange(
            f"case {case.name}: input {name} has no value in {int(bad.sum())} of {bad.size} "
            f"samples, first at "
            f"t = {time[bad][0]:g} s; repair the record or move the window",
            bad,
        )


def _inputs(case: PomCase, states: xr.Dataset) -> dict[str, np.ndarray]:
    count, level = states.sizes["time"], case.drive.level
    moved = {loop.control for loop in case.drive.pilot}
    found = {name: np.zeros(count) for name in case.law_moves}
    devices = sorted(str(name) for name in states.data_vars if str(name).startswith(DEVICE))
    wind = WIND if case.wind != "none" else ()
    for name in (
        *PRIMARY[level],
        *(name for name in INPUTS if name not in PRIMARY[level]),
        *wind,
        *devices,
    ):
        if name in case.law_moves:
            continue
        if name in case.conditions:
            found[name] = np.full(count, case.conditions[name])
        elif name in states:
            found[name] = np.broadcast_to(states[name].values.astype(float), count).copy()
        elif name in BRAKES and "brake" in states:
            pedal = np.clip(np.broadcast_to(states["brake"].values.astype(float), count), 0.0, 1.0)
            found[name] = np.where(pedal > RELEASED, pedal, 0.0)
        elif name in moved:
            found[name] = np.zeros(count)
        elif name in PRIMARY[level]:
            hint = (
                f"case {case.name} drives {DRIVEN_BY[level]}; map the channel, or hold it by "
                f"[conditions]"
            )
            raise UnknownName(name, map(str, states.data_vars), "recorded control", hint)
    for name in _held(case).intersection(found):
        found[name][:] = line_at_start(states["time"].values.astype(float), found[name])[0]
    return {**found, **_engine_inputs(case, states)}


def _law_inputs(case: PomCase, states: xr.Dataset) -> LawInputs | None:
    if not case.law:
        return None
    count, time = states.sizes["time"], states["time"].values.astype(float)
    names = [str(name) for name, item in states.data_vars.items() if item.ndim < 2]
    values = {name: np.broadcast_to(states[name].values.astype(float), count) for name in names}
    values |= {name: np.full(count, value) for name, value in case.conditions.items()}
    recorded = {
        name: column
        for name, column in values.items()
        if is_recorded(name) and name not in case.law_moves
    }
    return LawInputs(
        case.law_moves,
        recorded,
        {name: float(line_at_start(time, column)[0]) for name, column in values.items()},
    )


def is_recorded(name: str) -> bool:
    """Whether an input of a control law comes from the record: what a pilot sets.  All else is an
    output of the model.
    """
    return (
        name in (*INPUTS, *TRAVEL, *FORCES, *BRAKES)
        or _LEVER.match(name) is not None
        or name.startswith(DEVICE)
    )


def _held(case: PomCase) -> set[str]:
    """Return the surfaces that something else moves: their recorded position only shows where the
    circuits start.
    """
    return set(PRIMARY["recorded"]) - set(PRIMARY[case.drive.level])


def _engine_inputs(case: PomCase, states: xr.Dataset) -> dict[str, np.ndarray]:
    control, drive, _ = ENGINE_DRIVES[case.drive.engine]
    engines = [
        match.group(1)
        for name in states.data_vars
        if (match := _ENGINE.match(str(name))) and match.group(2) == control
    ]
    if not engines:
        raise UnknownName(
            f"engine1.{control}",
            map(str, states.data_vars),
            "recorded quantity",
            f'drive.engine is "{case.drive.engine}"',
        )
    count = states.sizes["time"]
    return {
        f"engine{n}.{drive}": np.broadcast_to(
            states[f"engine{n}.{control}"].values.astype(float), count
        ).copy()
        for n in sorted(engines)
    }


def _loops(
    case: PomCase, states: xr.Dataset, inputs: Mapping[str, np.ndarray]
) -> tuple[tuple[PilotLoop, ...], dict[str, np.ndarray]]:
    """Return the loops of the math pilot on inputs of the job, and the recorded channels they hold."""
    levers = [name for name in inputs if name.endswith(".throttle")]
    found = [
        replace(loop, control=name)
        for loop in case.drive.pilot
        for name in (levers if loop.control == "throttle" else [loop.control])
    ]
    targets = {}
    for loop in found:
        if loop.channel not in states:
            raise UnknownName(
                loop.channel,
                map(str, states.data_vars),
                "recorded channel",
                f"case {case.name}: the math pilot holds it",
            )
        targets[loop.channel] = states[loop.channel].values.astype(float)
    return tuple(found), targets


def _modes(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    found = {"mode.engine": ENGINE_DRIVES[case.drive.engine][2]}
    if case.drive.trim == "ground":
        found["mode.trim"] = TRIM_GROUND
    elif case.drive.trim:
        found["init.phi_range"] = BANK_RANGE
        found["mode.trim"] = TRIM_THROTTLE if case.drive.engine == "throttle" else TRIM_THRUST
    if case.drive.level != "recorded":
        found["mode.controls"] = LEVELS[case.drive.level]
    if case.drive.runway:
        found["runway.condition"] = RUNWAYS[case.drive.runway]
    if case.drive.held_by == "friction":
        found |= {f"{item}.trim_friction": 1.0 for item in ("column", "wheel", "pedal")}
    if "lat" in states or "lat" in case.conditions:
        found["mode.earth"] = 1.0
    return found


def initial_configuration(case: PomCase, job: ReplayJob) -> Mapping[str, float]:
    """Return initial conditions and configuration by canonical name, for the report. [SI]"""
    found = {
        name.removeprefix("init.").removeprefix("mass.").removeprefix("env."): value
        for name, value in job.parameters.items()
    }
    for name in ("delta_f", "gear", "speedbrake", *WIND):
        if name in job.inputs:
            found[name] = float(job.inputs[name][0])
    kept = {
        name: value for name, value in found.items() if not name.startswith(("mode.", "runway."))
    }
    return {name: value for name, value in kept.items() if not name.endswith(("_dot", "_range"))}
