"""Job of a replay: the inputs and parameters that drive every model of a case."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from flightmech.aircraft.controls import DEVICE, ICE
from flightmech.errors import OutOfRange, UnknownName
from flightmech.quantities import time_text
from flightmech.units import DEGREE
from pom.cases.case import PomCase
from pom.cases.case_facts import file_facts
from pom.cases.case_file import BRAKES, FORCES, FUEL_SWITCH, INPUTS, LEVERS, TRAVEL, WIND
from pom.cases.case_inputs import PRIMARY
from pom.cases.pilot import PilotLoop
from pom.cases.start_conditions import initial_state, line_at_start, mass_and_air, quiet_time

STATED = "stated_conditions"
"""Attribute of the signals of a result: names of `stated_only`, separated by spaces."""
# By drive of the engines: the recorded quantity, the input of the model, and mode.engine.
ENGINE_DRIVES = {
    "throttle": ("throttle", "throttle", 0.0),
    "n1": ("n1", "n1_drive", 1.0),
    "thrust": ("thrust", "thrust_drive", 2.0),
    "torque": ("torque", "torque_drive", 3.0),
    "rpm": ("rpm", "rpm_drive", 4.0),
    "map": ("manifold_pressure", "manifold_pressure_drive", 5.0),
}
TRIM_THRUST, TRIM_THROTTLE, TRIM_GROUND = 1.0, 2.0, 3.0  # mode.trim
BANK_RANGE = 1.0 * DEGREE
"""Largest change of the recorded bank angle by the trim. [rad]

It is half the 2 deg of the lateral rows of Table A2A.  In a straight sideslip the side forces of
fin and rudder can nearly cancel.  A side acceleration within the accuracy of the record then
requires degrees of rudder, or a tenth of a degree of bank.
"""
RUNWAYS = {"dry": 0.0, "wet": 1.0, "icy": 2.0}  # runway.condition
LEVELS = {"recorded": 0.0, "cockpit": 1.0, "force": 2.0}  # mode.controls
DRIVEN_BY = {
    "recorded": "the surfaces as recorded",
    "cockpit": "column, wheel and pedals as recorded",
    "force": "the pilot forces as recorded",
}
RELEASED = 0.02  # [1] brake pedal below which it counts as released
NEEDED = ("init.V", "init.phi", "init.theta", "init.psi", "init.p", "init.q", "init.r", "init.h")
_REQUIRED_MODES = ("mode.engine", "mode.trim", "runway.condition")
_LEVER = re.compile(r"^engine\d+\.(throttle|pla)$")
_ENGINE = re.compile(r"^engine(\d+)\.(\w+)$")


@dataclass(frozen=True)
class ReplayJob:
    """Inputs and parameters of one replay, the same for every model.

    Attributes
    ----------
    time : array (time,)
        Communication points, the samples of the record. [s]
    inputs : dict of str to array (time,)
        Inputs of the model by canonical name. [SI]
    parameters : dict of str to float
        ``init.*``, ``mass.*``, ``env.*``, ``mode.*``. [SI]
    needed_inputs, needed_parameters : tuple of str
        Names without which a model cannot be replayed.  Inputs that are zero throughout are not
        among them.  A model gets the other names only if it has them.
    pilot : tuple of PilotLoop
        Loops of the math pilot, closed sample by sample (`pom.cases.pilot.Pilot`).  Their controls
        are among the inputs.
    targets : dict of str to array (time,)
        The recorded channel of every loop. [SI]
    law : LawInputs or None
        Inputs of the control law, if the case has one.
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
    """Recorded inputs of a control law.

    Attributes
    ----------
    moves : tuple of str
        Controls that the law moves.  They are zero in the inputs of the job.
    recorded : dict of str to array (time,)
        Controls of the cockpit and positions that no law moves, by canonical name. [SI]
    start : dict of str to float
        Every recorded channel at the first sample.  They initialise the law before the model has
        outputs. [SI]
    """

    moves: tuple[str, ...]
    recorded: dict[str, np.ndarray]
    start: dict[str, float]


def job_of(case: PomCase, states: xr.Dataset) -> ReplayJob:
    """Return the inputs and parameters that drive the models.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time)
        Flight states over the window of the case. [SI]

    Raises
    ------
    OutOfRange
        An input, a channel of the math pilot or the initial state is NaN.
    UnknownName
        The record has no such control, thrust, channel or state.
    """
    time = states["time"].values.astype(float)
    inputs = _recorded_inputs(case, states)
    loops, targets = _pilot_loops(case, states, inputs)
    for name, values in {**inputs, **targets}.items():
        _require_numbers(case, name, time=time, values=values)
    parameters = {
        **initial_state(case, states),
        **mass_and_air(case, states),
        **_model_modes(case, states),
    }
    _check_start(case, states, parameters)
    # before the next step, which changes the first sample
    needed_inputs = _needed_inputs(case, inputs, loops)
    span = quiet_time(states)
    for values in inputs.values():
        # The trim uses the first sample: a line through the first part removes its noise.
        values[0] = line_at_start(time, values, span)[0]
    return ReplayJob(
        time=time,
        inputs=inputs,
        parameters=parameters,
        needed_inputs=needed_inputs,
        needed_parameters=(*NEEDED, *(name for name in parameters if name in _REQUIRED_MODES)),
        pilot=loops,
        targets=targets,
        law=_law_inputs(case, states),
    )


def _require_numbers(case: PomCase, name: str, *, time: np.ndarray, values: np.ndarray) -> None:
    bad = ~np.isfinite(values)
    if bad.any():
        raise OutOfRange(
            f"case {case.name}: input {name} has no value in {int(bad.sum())} of {bad.size} "
            f"samples, first at t = {time_text(time[bad][0])} s; repair the record or move the "
            "window",
            bad,
        )


def _check_start(case: PomCase, states: xr.Dataset, parameters: Mapping[str, float]) -> None:
    """Raise if a parameter of the start is missing or not finite."""
    for name in NEEDED:
        if name not in parameters:
            raise UnknownName(
                name.removeprefix("init."),
                map(str, states.data_vars),
                what="state",
                hint=f"case {case.name} starts from the state of the flight",
            )
    start = float(states["time"].values[0])
    for name, value in parameters.items():
        if not np.isfinite(value):
            raise OutOfRange(
                f"case {case.name}: {name} has no value at the start of the window, t = "
                f"{time_text(start)} s; move the window"
            )


def _needed_inputs(
    case: PomCase, inputs: Mapping[str, np.ndarray], loops: tuple[PilotLoop, ...]
) -> tuple[str, ...]:
    """Return the inputs that a model must have: moved by pilot or law, or not zero throughout."""
    changed = {loop.control for loop in loops}.union(case.law_moves)
    start_only = _start_only_surfaces(case)
    needed = []
    for name, values in inputs.items():
        if name in changed or (values.any() and name not in start_only):
            needed.append(name)
    return tuple(needed)


def _recorded_inputs(case: PomCase, states: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the inputs of the models: controls, wind, devices and engines. [SI]"""
    count, primary = states.sizes["time"], PRIMARY[case.drive.level]
    piloted = {loop.control for loop in case.drive.pilot}
    # A device is recorded, or held by the case.
    known = {str(name) for name in (*states.data_vars, *case.conditions)}
    devices = sorted(name for name in known if name.startswith(DEVICE))
    names = [*primary, *(name for name in INPUTS if name not in primary)]
    if case.wind != "none":
        names += WIND
    names += devices

    inputs = {name: np.zeros(count) for name in case.law_moves}
    for name in names:
        if name in case.law_moves:
            continue
        values = _control_history(case, states, name)
        if values is not None:
            inputs[name] = values
        elif name in piloted:
            # the corrections of the math pilot are added to zero
            inputs[name] = np.zeros(count)
        elif name in primary:
            hint = (
                f"case {case.name} drives {DRIVEN_BY[case.drive.level]}; map the channel, or "
                f"hold it by [conditions]"
            )
            raise UnknownName(name, map(str, states.data_vars), what="recorded control", hint=hint)
    for name in _start_only_surfaces(case).intersection(inputs):
        time = states["time"].values.astype(float)
        inputs[name][:] = line_at_start(time, inputs[name], quiet_time(states))[0]
    return {**inputs, **_engine_inputs(case, states), **_fuel_inputs(case, states)}


def _fuel_inputs(case: PomCase, states: xr.Dataset) -> dict[str, np.ndarray]:
    """Return valves and pumps of the fuel system that are recorded, or held by the case. [1]"""
    inputs = {}
    for name in sorted(map(str, {*states.data_vars, *case.conditions})):
        values = _control_history(case, states, name) if FUEL_SWITCH.match(name) else None
        if values is not None:
            inputs[name] = values
    return inputs


def _control_history(case: PomCase, states: xr.Dataset, name: str) -> np.ndarray | None:
    """Return a control from case file or record (time,), or None if neither has it. [SI]"""
    count = states.sizes["time"]
    if name in case.conditions:
        return np.full(count, case.conditions[name])
    if name in states:
        return np.broadcast_to(states[name].values.astype(float), count).copy()
    if name in BRAKES and "brake" in states:
        # one recorded brake drives both sides
        pedal = np.clip(np.broadcast_to(states["brake"].values.astype(float), count), 0.0, 1.0)
        return np.where(pedal > RELEASED, pedal, 0.0)
    return None


def _law_inputs(case: PomCase, states: xr.Dataset) -> LawInputs | None:
    if not case.law:
        return None
    count, time = states.sizes["time"], states["time"].values.astype(float)
    # two-dimensional variables are the errors of the instruments, (error, time)
    names = [str(name) for name, item in states.data_vars.items() if item.ndim < 2]
    values = {name: np.broadcast_to(states[name].values.astype(float), count) for name in names}
    values |= {name: np.full(count, value) for name, value in case.conditions.items()}
    recorded, start = {}, {}
    span = quiet_time(states)
    for name, column in values.items():
        start[name] = float(line_at_start(time, column, span)[0])
        if is_recorded(name) and name not in case.law_moves:
            recorded[name] = column
    return LawInputs(moves=case.law_moves, recorded=recorded, start=start)


def is_recorded(name: str) -> bool:
    """Return whether the record gives this input of a control law: a control of the pilot.

    All other inputs are outputs of the model.
    """
    if name in (*INPUTS, *TRAVEL, *FORCES, *BRAKES) or name.startswith(DEVICE):
        return True
    return _LEVER.match(name) is not None


def _start_only_surfaces(case: PomCase) -> set[str]:
    """Return the surfaces that travel or forces move; their record only gives the start."""
    return set(PRIMARY["recorded"]) - set(PRIMARY[case.drive.level])


def _engine_inputs(case: PomCase, states: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the recorded quantity that drives each engine, and its other levers. [SI]"""
    # a glider
    if case.drive.engine == "none":
        return {}
    control, drive, _ = ENGINE_DRIVES[case.drive.engine]
    inputs = _drive_inputs(case, states, control, drive)
    if case.drive.propeller == "rpm":
        inputs |= _drive_inputs(case, states, "rpm", "rpm_drive")
    # The recorded thrust depends on no lever.
    if case.drive.engine == "thrust":
        return inputs
    levers = ("throttle", *LEVERS) if case.drive.engine == "rpm" else LEVERS
    numbers = {name.partition(".")[0] for name in inputs}
    for engine in sorted(numbers):
        for lever in levers:
            values = _control_history(case, states, f"{engine}.{lever}")
            if values is not None:
                inputs[f"{engine}.{lever}"] = values
    return inputs


def _drive_inputs(
    case: PomCase, states: xr.Dataset, control: str, drive: str
) -> dict[str, np.ndarray]:
    """Return the recorded `control` of all engines as the inputs `drive`. [SI]"""
    count = states.sizes["time"]
    inputs = {}
    for name in sorted(map(str, states.data_vars)):
        match = _ENGINE.match(name)
        if match and match.group(2) == control:
            values = states[name].values.astype(float)
            inputs[f"engine{match.group(1)}.{drive}"] = np.broadcast_to(values, count).copy()
    if not inputs:
        key = "propeller" if drive == "rpm_drive" and case.drive.engine != "rpm" else "engine"
        raise UnknownName(
            f"engine1.{control}",
            map(str, states.data_vars),
            what="recorded quantity",
            hint=f'drive.{key} is "{getattr(case.drive, key)}"',
        )
    return inputs


def _pilot_loops(
    case: PomCase, states: xr.Dataset, inputs: Mapping[str, np.ndarray]
) -> tuple[tuple[PilotLoop, ...], dict[str, np.ndarray]]:
    """Return the loops of the math pilot on inputs of the job, and their recorded channels."""
    levers = [name for name in inputs if name.endswith(".throttle")]
    loops: list[PilotLoop] = []
    targets = {}
    for loop in case.drive.pilot:
        if loop.control == "throttle":
            # one loop moves the levers of all engines
            loops += [replace(loop, control=name) for name in levers]
        else:
            loops.append(loop)
    for loop in loops:
        if loop.channel not in states:
            raise UnknownName(
                loop.channel,
                map(str, states.data_vars),
                what="recorded channel",
                hint=f"case {case.name}: the math pilot holds it",
            )
        targets[loop.channel] = states[loop.channel].values.astype(float)
    return tuple(loops), targets


def _model_modes(case: PomCase, states: xr.Dataset) -> dict[str, float]:
    """Return the parameters that select the drive, the trim and the runway of a model."""
    drive = case.drive
    modes = {}
    if drive.engine != "none":
        modes["mode.engine"] = ENGINE_DRIVES[drive.engine][2]
    if drive.trim == "ground":
        modes["mode.trim"] = TRIM_GROUND
    elif drive.trim:
        modes["init.phi_range"] = BANK_RANGE
        modes["mode.trim"] = TRIM_THROTTLE if drive.engine == "throttle" else TRIM_THRUST
    if drive.level != "recorded":
        modes["mode.controls"] = LEVELS[drive.level]
    if drive.runway:
        modes["runway.condition"] = RUNWAYS[drive.runway]
    if drive.held_by == "friction":
        modes |= {f"{control}.trim_friction": 1.0 for control in ("column", "wheel", "pedal")}
    if "lat" in states or "lat" in case.conditions:
        # WGS-84 and rotating: the record gives a position on it
        modes["mode.earth"] = 1.0
    return modes


def stated_only(case: PomCase, states: xr.Dataset) -> list[str]:
    """Return the inputs that the conditions of a case state and its record does not have."""
    return [name for name in case.conditions if name in INPUTS and name not in states]


def with_stated_inputs(case: PomCase, states: xr.Dataset) -> xr.Dataset:
    """Return states with the controls and devices that only the conditions of a case state.

    They are constant.  A recorded channel stays as it is. [SI]
    """
    stated = {}
    for name, value in case.conditions.items():
        if (name in INPUTS or name.startswith(DEVICE)) and name not in states:
            stated[name] = ("time", np.full(states.sizes["time"], value))
    return states.assign(stated)


def initial_configuration(case: PomCase, job: ReplayJob) -> Mapping[str, float]:
    """Return initial conditions and configuration by canonical name, for the report. [SI]"""
    conditions = {}
    for parameter, value in job.parameters.items():
        name = parameter.removeprefix("init.").removeprefix("mass.").removeprefix("env.")
        conditions[name] = value
    for name in ("delta_f", "gear", "speedbrake", ICE, *WIND):
        if name in job.inputs:
            conditions[name] = float(job.inputs[name][0])
    # switches and the data of the trim are not conditions of the flight
    internal_prefixes, internal_suffixes = ("mode.", "runway."), ("_dot", "_range")
    flight_conditions = {}
    for name, value in conditions.items():
        if not name.startswith(internal_prefixes) and not name.endswith(internal_suffixes):
            flight_conditions[name] = value
    stated = file_facts(case.aircraft)
    if stated is not None and "x_cg_b" in flight_conditions:
        position = stated.chord_position(flight_conditions["x_cg_b"])
        if position is not None:
            flight_conditions["x_cg"] = position
    return flight_conditions
