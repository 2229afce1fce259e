"""Pilot model for predicted flights: trim, manoeuvre and recovery on the a-priori model.

Attitudes follow second-order laws. Their gains are divided by the control powers of the model in
the trimmed flight, so that one set of frequencies applies to every aircraft.  Between manoeuvres
the pilot holds height, speed and heading.  During a test input the other controls are fixed, except
for a share of the attitude gains that a manoeuvre may request (`PlannedManoeuvre.feedback`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

import flightmech
from flightmech.errors import IdentificationError
from flightmech.simulation.compiler import SimModel
from flightmech.units import DEGREE
from flighttest.flight_programme.input_design.input_signals import axes_of
from flighttest.flight_programme.input_design.predicted_response import STEP, model_inputs
from flighttest.flight_programme.planning.catalogue import NEAR_GROUND, PlannedManoeuvre

# Period of the control law and of the prediction [s].
PERIOD = 0.02
# Steady flight before the first manoeuvre, and recovery after each manoeuvre [s].
BEFORE, BEHIND = 3.0, 12.0
# Natural frequencies of the attitude loops [rad/s], and their damping ratio.
_PITCH, _ROLL, _DAMPING = 2.0, 1.5, 0.8
# Angular acceleration that each control has to produce.
_POWERS = {"delta_e": "q_dot", "delta_a": "p_dot"}
# Deflection for the control power [rad], and the least power [s-2].
_NUDGE = 0.5 * DEGREE
_LEAST_POWER = 1e-3
# Levers of a level deceleration and of a level acceleration.
_IDLE, _FULL = 0.12, 0.90
# Duration of the rudder ramp into a sideslip [s]; the ramp out of it takes half of this.
_RAMP = 2.5
# Vertical speed of the ways to and from a low pass [m/s], time to settle there [s], and period of
# the sine of pitch attitude [s], which the short period of a light aeroplane follows.
_WAY_SPEED, _SETTLE, _PASS_PERIOD = 2.0, 4.0, 5.0
# Sink rate at the end of a flare [m/s], and the lowest height of a condition without ground [m].
_TOUCH, _FREE_AIR = 0.5, 1000.0
RUNWAY = "env.runway_elevation"
# Duration of a manoeuvre over its `duration`; 1 for the kinds that are not listed.
_REPEATS = {"sideslip": 2.0, "device": 2.0, "level_speed": 2.5}

_Phase = tuple[float, PlannedManoeuvre | None, xr.Dataset | None]
"""Length of a part of the flight [s], its manoeuvre and its test input."""


@dataclass(frozen=True)
class PredictedFlight:
    """Predicted flight of a condition: the motion, and the times of its manoeuvres.

    Attributes
    ----------
    motion : Dataset (time,)
        Outputs and inputs of the model. [SI]
    marks : list of dict
        ``manoeuvre control start end``, as in a flight record. [s]
    runway : float or None
        Height of the runway over mean sea level; None far from a runway. [m]
    """

    motion: xr.Dataset
    marks: list[dict[str, Any]]
    runway: float | None = None


def fly_manoeuvres(
    sim: SimModel,
    start: Mapping[str, float],
    manoeuvres: Sequence[tuple[PlannedManoeuvre, xr.Dataset | None]],
    span: float = 0.0,
) -> PredictedFlight:
    """Return the predicted flight of several manoeuvres, one after the other, from a trim.

    Parameters
    ----------
    sim : SimModel
        The a-priori model.
    start : mapping of str to float
        From `input_design.trimmed_start`.
    manoeuvres : sequence of (PlannedManoeuvre, Dataset or None)
        A test input has its signal, scaled to the limits.  A landing is the last one.
    span : float
        Unit of the heights of low passes and landings; needed with these. [m]

    Raises
    ------
    IdentificationError
        A control that the pilot needs has no effect; a low pass touches the runway, a landing does
        not, or the condition is far from a runway.
    SimulationError
        The motion diverges.
    """
    phases: list[_Phase] = [(BEFORE, None, None)]
    marks: list[dict[str, Any]] = []
    clock = BEFORE
    for manoeuvre, signal in manoeuvres:
        length = manoeuvre_duration(manoeuvre, signal)
        way = way_to_height(manoeuvre, start, span=span)
        control = manoeuvre.device
        if signal is not None:
            control = " ".join(axes_of(signal))
        marks.append(
            {
                "manoeuvre": manoeuvre.name,
                "control": control,
                "start": clock + way,
                "end": clock + way + length,
            }
        )
        phases.append((2.0 * way + length, manoeuvre, signal))
        clock += 2.0 * way + length
        if manoeuvre.kind != "landing":
            phases.append((BEHIND, None, None))
            clock += BEHIND
    time = np.arange(round(clock / PERIOD) + 1) * PERIOD
    trim = {name: ("time", np.full(len(time), start.get(name, 0.0))) for name in sim.inputs}
    law = _Law(sim, start, phases=phases, power=_control_powers(sim, start), span=span)
    motion = flightmech.simulate_closed_loop(
        sim,
        xr.Dataset(trim, {"time": time}),
        law,
        period=PERIOD,
        parameters={**start, "mode.trim": 0.0},
        step=STEP,
    )
    # inputs that the law does not move are a part of the record too
    constant = {}
    for name, item in trim.items():
        if name not in motion and name not in sim.outputs:
            constant[name] = item
    runway = start.get(RUNWAY)
    if runway is not None and start["init.h"] - runway > _FREE_AIR:
        runway = None
    for mark, (manoeuvre, _) in zip(marks, manoeuvres, strict=True):
        if manoeuvre.kind in NEAR_GROUND:
            _check_wheels(motion, mark, is_landing=manoeuvre.kind == "landing")
        if manoeuvre.kind == "landing":
            # the flight ends on the runway
            motion = motion.sel(time=slice(None, mark["end"]))
            constant = {
                name: (item[0], item[1][: motion.sizes["time"]]) for name, item in constant.items()
            }
    return PredictedFlight(motion.assign(constant), marks, runway)


def way_to_height(manoeuvre: PlannedManoeuvre, start: Mapping[str, float], *, span: float) -> float:
    """Return the time from the trim to the height of a low pass; zero for others. [s]

    Raises
    ------
    IdentificationError
        The condition of a low pass or of a landing is far from a runway.
    """
    if manoeuvre.kind not in NEAR_GROUND:
        return 0.0
    above = start["init.h"] - start.get(RUNWAY, -np.inf)
    if not (span > 0.0 and above < _FREE_AIR):
        raise IdentificationError(
            f"a {manoeuvre.kind} starts near a runway; give the condition fixed h_agl, such as "
            f'"20 m", and parameters {{ "{RUNWAY}" = 0.0 }}'
        )
    if manoeuvre.kind == "landing":
        return 0.0
    return abs(above - manoeuvre.height * span) / _WAY_SPEED + _SETTLE


def _check_wheels(motion: xr.Dataset, mark: dict[str, Any], *, is_landing: bool) -> None:
    """End a landing at the first contact of a wheel; raise if a low pass has one."""
    touched = np.zeros(motion.sizes["time"], bool)
    for name, values in motion.data_vars.items():
        if str(name).startswith("wow_"):
            touched |= values.values > 0.5
    time = motion["time"].values
    contacts = time[touched & (time >= mark["start"]) & (time <= mark["end"])]
    name = mark["manoeuvre"]
    if not is_landing and len(contacts):
        raise IdentificationError(
            f"{name}: a wheel touches the runway {contacts[0] - mark['start']:.1f} s after the "
            "start; give a larger height or a smaller amplitude"
        )
    if is_landing:
        if not len(contacts):
            raise IdentificationError(
                f"{name}: no wheel touches the runway in {mark['end'] - mark['start']:.0f} s; give "
                "a longer duration, a condition on a glide path (kind, gamma), or a gear"
            )
        mark["end"] = float(contacts[0])


def manoeuvre_duration(manoeuvre: PlannedManoeuvre, signal: xr.Dataset | None = None) -> float:
    """Return the length of a manoeuvre without recovery. [s]"""
    if signal is not None:
        return float(signal["time"][-1])
    return _REPEATS.get(manoeuvre.kind, 1.0) * manoeuvre.duration


def _control_powers(sim: SimModel, start: Mapping[str, float]) -> dict[str, float]:
    """Return angular accelerations per deflection at the start. [s-2]"""
    powers = {}
    for name, output in _POWERS.items():
        # central difference of the acceleration at the first sample
        trim = start.get(name, 0.0)
        up = _first_output(sim, start, name, value=trim + _NUDGE, output=output)
        down = _first_output(sim, start, name, value=trim - _NUDGE, output=output)
        powers[name] = (up - down) / (2.0 * _NUDGE)
        if abs(powers[name]) < _LEAST_POWER:
            raise IdentificationError(
                f"{name} moves nothing in the a-priori model ({output} by {powers[name]:.2g} "
                f"per rad); no manoeuvre can be predicted"
            )
    return powers


def _first_output(
    sim: SimModel, start: Mapping[str, float], name: str, *, value: float, output: str
) -> float:
    """Return an output at the start with one input changed."""
    u = xr.Dataset({name: ("time", np.full(2, value))}, {"time": [0.0, STEP]})
    motion = flightmech.simulate(sim, u, {**start, "mode.trim": 0.0}, step=STEP, outputs=[output])
    return float(motion[output][0])


@dataclass
class _Law:
    """Control law of all phases of a flight.

    A phase without a manoeuvre holds height, speed and heading.
    """

    sim: SimModel
    start: Mapping[str, float]
    phases: Sequence[_Phase]
    power: Mapping[str, float]
    span: float = 0.0
    state: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.trim = {name: float(self.start.get(name, 0.0)) for name in self.sim.inputs}
        self.levers = []
        for name in self.sim.inputs:
            if name.startswith("engine") and name.endswith(".throttle"):
                self.levers.append(name)
        self.ends = np.cumsum([length for length, *_ in self.phases])
        # deflections of each test input on the inputs of the model
        zero = dict.fromkeys(self.sim.inputs, 0.0)
        self.deflections: list[xr.Dataset | None] = []
        for *_, signal in self.phases:
            if signal is None:
                self.deflections.append(None)
            else:
                self.deflections.append(model_inputs(self.sim, signal, zero))
        self.phase, self.reached = -1, set[str]()

    def __call__(
        self, t: float, y: Mapping[str, float], _: Mapping[str, float]
    ) -> dict[str, float]:
        number = min(int(np.searchsorted(self.ends, t + 1e-9, side="right")), len(self.phases) - 1)
        if not self.state:
            self.first = dict(y)
            self.state = {"delta_e": self.trim["delta_e"], "lever": 0.0, "alpha": y["alpha"]}
        if number != self.phase:
            # motion and controls at the start of the phase
            self.phase, self.base, self.reached = number, dict(y), set()
            self.fixed = {"delta_e": self.state["delta_e"], "lever": self.state["lever"]}
        length, manoeuvre, _signal = self.phases[number]
        since = t - (self.ends[number] - length)
        # slow mean of the angle of attack, for the path
        self.state["alpha"] += 0.3 * PERIOD * (y["alpha"] - self.state["alpha"])
        if manoeuvre is None:
            return self._steady(t, y)
        deflections = self.deflections[number]
        if deflections is not None:
            return self._test_input(since, y, deflections, share=manoeuvre.feedback)
        # one method per kind of manoeuvre
        return getattr(self, f"_{manoeuvre.kind}")(t, since, y, manoeuvre)

    def _steady(self, t: float, y: Mapping[str, float]) -> dict[str, float]:
        """Return the controls that hold height, speed and heading."""
        return {**self._pitch(y, self._level(t, y)), **self._wings_and_speed(y)}

    def _wings_and_speed(self, y: Mapping[str, float]) -> dict[str, float]:
        """Return the controls that hold speed and heading."""
        return {
            **self._roll(y, self._heading(y)),
            "delta_r": self.trim["delta_r"],
            **self._speed(y, self.first["V"]),
        }

    def _test_input(
        self, since: float, y: Mapping[str, float], deflections: xr.Dataset, *, share: float
    ) -> dict[str, float]:
        """Return fixed controls with a share of the attitude gains, plus the test input."""
        # A share of the gains of the attitude keeps the aeroplane near the trim without hiding the
        # input.
        pitch = self._angular(y["theta"] - self.base["theta"], y["q"], _PITCH)
        roll = self._angular(y["phi"] - self.first["phi"], y["p"], _ROLL)
        controls = {
            "delta_e": self.fixed["delta_e"] + share * pitch / self.power["delta_e"],
            "delta_a": self.trim["delta_a"] + share * roll / self.power["delta_a"],
            "delta_r": self.trim["delta_r"],
        }
        for name in self.levers:
            controls[name] = self.trim[name] + self.fixed["lever"]
        time = deflections["time"].values
        for key, item in deflections.data_vars.items():
            name = str(key)
            base = controls.get(name, self.trim[name])
            controls[name] = base + float(np.interp(since, time, item.values))
        return controls

    def _sideslip(
        self, t: float, since: float, y: Mapping[str, float], m: PlannedManoeuvre
    ) -> dict[str, float]:
        # two halves of opposite sign; each has a ramp at both ends
        half = since % m.duration
        sign = 1.0 if since < m.duration else -1.0
        leaving = max(0.0, (m.duration - half) / (0.5 * _RAMP))
        rudder = sign * m.amplitude * min(1.0, half / _RAMP, leaving)
        return {**self._steady(t, y), "delta_r": self.trim["delta_r"] + rudder}

    def _pull_up_push_down(
        self, t: float, since: float, y: Mapping[str, float], m: PlannedManoeuvre
    ) -> dict[str, float]:
        theta = self.base["theta"] + m.amplitude * np.sin(2.0 * np.pi * since / m.duration)
        return {**self._steady(t, y), **self._pitch(y, theta), **self._levers(self.fixed["lever"])}

    def _level_speed(
        self, t: float, since: float, y: Mapping[str, float], m: PlannedManoeuvre
    ) -> dict[str, float]:
        """Return idle until the airspeed is low, then full power until it is high."""
        if since < m.duration:
            stage, lever, speed = "slow", _IDLE, self.first["V"] - m.amplitude
            arrived = y["V"] <= speed
        else:
            stage, lever, speed = "fast", _FULL, self.first["V"] + m.amplitude
            arrived = y["V"] >= speed
        if arrived:
            self.reached.add(stage)
        if stage in self.reached:
            power = self._speed(y, speed)
        else:
            power = dict.fromkeys(self.levers, lever)
        return {**self._steady(t, y), **power}

    def _device(
        self, t: float, since: float, y: Mapping[str, float], m: PlannedManoeuvre
    ) -> dict[str, float]:
        # 0.5 s at rest, travel out, pause, travel back
        travel = 0.5 * m.duration
        corners = [0.5, 0.5 + travel, m.duration, m.duration + travel]
        part = np.interp(since, corners, [0.0, 1.0, 1.0, 0.0])
        trim = self.trim[m.device]
        return {**self._steady(t, y), m.device: trim + part * (m.amplitude - trim)}

    def _low_pass(
        self, t: float, since: float, y: Mapping[str, float], m: PlannedManoeuvre
    ) -> dict[str, float]:
        """Return the controls of a descent, a level pass with a sine of pitch, and a climb back."""
        way = way_to_height(m, self.start, span=self.span)
        change = m.height * self.span - self.first["h_agl"]
        moving = way - _SETTLE
        # Descent, level pass, and climb back, as a polygon over time; each way ends with time to
        # settle.
        corners = [0.0, moving, way + m.duration, way + m.duration + moving]
        height = self.first["h"] + float(np.interp(since, corners, [0.0, change, change, 0.0]))
        climb = 0.0
        if since < corners[1]:
            climb = np.sign(change) * _WAY_SPEED
        elif corners[2] < since < corners[3]:
            climb = -np.sign(change) * _WAY_SPEED
        theta = self._path(y, height, climb=climb)
        in_pass = since - way
        # The sine of pitch excites lift and moment at the low height.
        if 0.0 < in_pass < m.duration:
            theta += m.amplitude * np.sin(2.0 * np.pi * in_pass / _PASS_PERIOD)
        return {**self._wings_and_speed(y), **self._pitch(y, theta)}

    def _landing(
        self, t: float, since: float, y: Mapping[str, float], m: PlannedManoeuvre
    ) -> dict[str, float]:
        """Return the controls of a glide path and a flare."""
        flare = m.height * self.span
        if y["h_agl"] >= flare:
            return self._steady(t, y)
        # The sink rate falls with the height, which is an exponential flare.
        sink = abs(self.first["hdot"]) * y["h_agl"] / flare
        theta = self._path(y, y["h"], climb=-max(_TOUCH, sink))
        levers = self._levers(self.fixed["lever"])
        return {**self._wings_and_speed(y), **self._pitch(y, theta), **levers}

    @staticmethod
    def _angular(error: float, rate: float, w: float) -> float:
        """Return the angular acceleration of a second-order law."""
        return -(w**2) * error - 2.0 * _DAMPING * w * rate

    def _level(self, t: float, y: Mapping[str, float]) -> float:
        """Return the pitch attitude that brings the aircraft back to its path."""
        height = self.first["h"] + self.first["hdot"] * t
        return self._path(y, height, climb=self.first["hdot"])

    def _path(self, y: Mapping[str, float], height: float, *, climb: float) -> float:
        """Return the pitch attitude for a height that changes with a climb rate."""
        speed = max(y["V"], 1.0)
        # climb of the path, with a correction of the height of at most 3 m/s
        climb += float(np.clip(0.15 * (height - y["h"]), -3.0, 3.0))
        gamma = climb / speed + 0.5 * (climb - y["hdot"]) / speed
        return self.state["alpha"] * np.cos(y["phi"]) + float(np.clip(gamma, -0.15, 0.15))

    def _pitch(self, y: Mapping[str, float], theta: float) -> dict[str, float]:
        """Return the elevator for a pitch attitude; its integral is the trim."""
        # pitch rate of a level turn
        turn = 9.81 * np.tan(y["phi"]) * np.sin(y["phi"]) / max(y["V"], 1.0)
        error = y["theta"] - theta
        self.state["delta_e"] -= PERIOD * 0.3 * _PITCH**3 * error / self.power["delta_e"]
        acceleration = self._angular(error, y["q"] - turn, _PITCH)
        return {"delta_e": self.state["delta_e"] + acceleration / self.power["delta_e"]}

    def _heading(self, y: Mapping[str, float]) -> float:
        """Return the bank that brings the aircraft back to its heading."""
        error = (self.first["psi"] - y["psi"] + np.pi) % (2.0 * np.pi) - np.pi
        return self.first["phi"] + float(np.clip(1.2 * error, -0.4, 0.4))

    def _roll(self, y: Mapping[str, float], phi: float) -> dict[str, float]:
        acceleration = self._angular(y["phi"] - phi, y["p"], _ROLL)
        return {"delta_a": self.trim["delta_a"] + acceleration / self.power["delta_a"]}

    def _speed(self, y: Mapping[str, float], speed: float) -> dict[str, float]:
        """Return the levers for a speed, by a proportional and integral law."""
        error = speed - y["V"]
        integral = self.state["lever"] + PERIOD * 0.012 * error
        self.state["lever"] = float(np.clip(integral, -1.0, 1.0))
        return self._levers(self.state["lever"] + 0.055 * error)

    def _levers(self, change: float) -> dict[str, float]:
        return {name: float(np.clip(self.trim[name] + change, 0.0, 1.0)) for name in self.levers}
