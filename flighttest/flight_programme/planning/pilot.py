"""A pilot for predictions: trims, flies a manoeuvre, recovers; on the a-priori model.

Attitudes follow second-order laws whose gains are divided by the control powers of the model in the
trimmed flight, so that one set of frequencies serves every aircraft.  Between manoeuvres height,
speed and heading are held.  During a test input the other controls stay where they are, but for a
share of the attitude gains where the manoeuvre keeps one (`PlannedManoeuvre.feedback`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

import flightmech
from flightmech.air import impact_pressure
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError
from flightmech.names import quantity_attributes
from flightmech.simulation.compiler import SimModel
from flightmech.units import DEGREE
from flighttest.flight_programme.input_design.input_signals import axes_of
from flighttest.flight_programme.input_design.predicted_response import STEP, model_inputs
from flighttest.flight_programme.planning.catalogue import RATE, PlannedManoeuvre
from flighttest.records.sensors.instruments import IMU, Instrument, Instruments, parse_instruments
from flighttest.records.signals.delays import remove_lag

PERIOD = 0.02  # of the law, and of the prediction [s]
BEFORE, BEHIND = 3.0, 12.0  # steady flight before the first manoeuvre, recovery behind each [s]
_PITCH, _ROLL, _DAMPING = (
    2.0,
    1.5,
    0.8,
)  # natural frequencies of the attitude loops [rad/s] and their damping ratio
_POWERS = {"delta_e": "q_dot", "delta_a": "p_dot"}
_NUDGE = 0.5 * DEGREE
_IDLE, _FULL = 0.12, 0.90  # levers of a level deceleration and acceleration
_RAMP = 2.5  # of the rudder into and out of a sideslip [s]


@dataclass(frozen=True)
class PredictedFlight:
    """A condition as predicted: the motion, and where its manoeuvres are.

    Attributes
    ----------
    motion : Dataset (time,)
        Outputs and inputs of the model. [SI]
    marks : list of dict
        ``manoeuvre control start end``, as in a flight record. [s]
    """

    motion: xr.Dataset
    marks: list[dict[str, Any]]


def fly_manoeuvres(
    sim: SimModel,
    start: Mapping[str, float],
    manoeuvres: Sequence[tuple[PlannedManoeuvre, xr.Dataset | None]],
) -> PredictedFlight:
    """Return the predicted flight of some manoeuvres, one after the other, from a trimmed start.

    Parameters
    ----------
    sim : SimModel
        The a-priori model.
    start : mapping of str to float
        From `input_design.trimmed_start`.
    manoeuvres : sequence of (Manoeuvre, Dataset or None)
        A test input comes with its signal, scaled to what the limits allow.

    Raises
    ------
    IdentificationError
        A control that a pilot needs moves nothing.
    SimulationError
        The motion diverges.
    """

    phases: list[tuple[float, PlannedManoeuvre | None, xr.Dataset | None]] = [(BEFORE, None, None)]
    marks: list[dict[str, Any]] = []
    clock = BEFORE
    for manoeuvre, signal in manoeuvres:
        length = manoeuvre_duration(manoeuvre, signal)
        control = " ".join(axes_of(signal)) if signal is not None else manoeuvre.device
        marks.append(
            {"manoeuvre": manoeuvre.name, "control": control, "start": clock, "end": clock + length}
        )
        phases += [(length, manoeuvre, signal), (BEHIND, None, None)]
        clock += length + BEHIND
    time = np.arange(round(clock / PERIOD) + 1) * PERIOD
    held = {name: ("time", np.full(len(time), start.get(name, 0.0))) for name in sim.inputs}
    law = _Law(sim, start, phases, _control_powers(sim, start))
    motion = flightmech.simulate_closed_loop(
        sim, xr.Dataset(held, {"time": time}), law, PERIOD, {**start, "mode.trim": 0.0}, step=STEP
    )
    inputs = {
        name: item for name, item in held.items() if name not in motion and name not in sim.outputs
    }
    return PredictedFlight(motion.assign(inputs), marks)


def manoeuvre_duration(manoeuvre: PlannedManoeuvre, signal: xr.Dataset | None = None) -> float:
    """Return the length of a manoeuvre without recovery. [s]"""
    if signal is not None:
        return float(signal["time"][-1])
    return {"sideslip": 2.0, "device": 2.0, "level_speed": 2.5}.get(
        manoeuvre.kind, 1.0
    ) * manoeuvre.duration


def _control_powers(sim: SimModel, start: Mapping[str, float]) -> dict[str, float]:
    """Return angular accelerations per deflection at the start. [s-2]"""

    found = {}
    for name, output in _POWERS.items():
        ends = []
        for sign in (1.0, -1.0):
            u = xr.Dataset(
                {name: ("time", np.full(2, start.get(name, 0.0) + sign * _NUDGE))},
                {"time": [0.0, STEP]},
            )
            ends.append(
                float(
                    flightmech.simulate(
                        sim, u, {**start, "mode.trim": 0.0}, step=STEP, outputs=[output]
                    )[output][0]
                )
            )
        found[name] = (ends[0] - ends[1]) / (2.0 * _NUDGE)
        if abs(found[name]) < 1e-3:
            raise IdentificationError(
                f"{name} moves nothing in the a-priori model ({output} by {found[name]:.2g} "
                f"per rad); no manoeuvre can be predicted"
            )
    return found


@dataclass
class _Law:
    """The control law of all phases of a flight; a phase without manoeuvre holds height, speed and
    heading.
    """

    sim: SimModel
    start: Mapping[str, float]
    phases: Sequence[tuple[float, PlannedManoeuvre | None, xr.Dataset | None]]
    power: Mapping[str, float]
    state: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.trim = {name: float(self.start.get(name, 0.0)) for name in self.sim.inputs}
        self.levers = [
            name
            for name in self.sim.inputs
            if name.startswith("engine") and name.endswith(".throttle")
        ]
        self.ends = np.cumsum([length for length, *_ in self.phases])
        self.moving = [
            model_inputs(self.sim, signal, dict.fromkeys(self.sim.inputs, 0.0))
            if signal is not None
            else None
            for *_, signal in self.phases
        ]
        self.phase, self.reached = -1, set[str]()

    def __call__(
        self, t: float, y: Mapping[str, float], _: Mapping[str, float]
    ) -> dict[str, float]:
        number = min(int(np.searchsorted(self.ends, t + 1e-9, side="right")), len(self.phases) - 1)
        if not self.state:
            self.first = dict(y)
            self.state = {"delta_e": self.trim["delta_e"], "lever": 0.0, "alpha": y["alpha"]}
        if number != self.phase:
            self.phase, self.base, self.reached = number, dict(y), set()
            self.kept = {"delta_e": self.state["delta_e"], "lever": self.state["lever"]}
        length, manoeuvre, _signal = self.phases[number]
        since = t - (self.ends[number] - length)
        self.state["alpha"] += 0.3 * PERIOD * (y["alpha"] - self.state["alpha"])
        if manoeuvre is None:
            return self._steady(t, y)
        moved = self.moving[number]
        if moved is not None:
            return self._test_input(since, y, moved, manoeuvre.feedback)
        return getattr(self, f"_{manoeuvre.kind}")(t, since, y, manoeuvre)

    def _steady(self, t: float, y: Mapping[str, float]) -> dict[str, float]:
        return {
            **self._pitch(y, self._level(t, y)),
            **self._roll(y, self._heading(y)),
            "delta_r": self.trim["delta_r"],
            **self._speed(y, self.first["V"]),
        }

    def _test_input(
        self, since: float, y: Mapping[str, float], moved: xr.Dataset, share: float
    ) -> dict[str, float]:
        base = {
            "delta_e": self.kept["delta_e"],
            "delta_a": self.trim["delta_a"],
            "delta_r": self.trim["delta_r"],
        }
        base["delta_e"] += (
            share
            * self._angular(y["theta"] - self.base["theta"], y["q"], _PITCH)
            / self.power["delta_e"]
        )
        base["delta_a"] += (
            share
            * self._angular(y["phi"] - self.first["phi"], y["p"], _ROLL)
            / self.power["delta_a"]
        )
        base |= {name: self.trim[name] + self.kept["lever"] for name in self.levers}
        time = moved["time"].values
        return base | {
            str(name): base.get(str(name), self.trim[str(name)])
            + float(np.interp(since, time, item.values))
            for name, item in moved.data_vars.items()
        }

    def _sideslip(
        self, t: float, since: float, y: Mapping[str, float], m: PlannedManoeuvre
    ) -> dict[str, float]:
        half = since % m.duration
        sign = 1.0 if since < m.duration else -1.0
        rudder = (
            sign
            * m.amplitude
            * min(1.0, half / _RAMP, max(0.0, (m.duration - half) / (0.5 * _RAMP)))
        )
        return {**self._steady(t, y), "delta_r": self.trim["delta_r"] + rudder}

    def _pull_up_push_down(
        self, t: float, since: float, y: Mapping[str, float], m: PlannedManoeuvre
    ) -> dict[str, float]:
        theta = self.base["theta"] + m.amplitude * np.sin(2.0 * np.pi * since / m.duration)
        return {**self._steady(t, y), **self._pitch(y, theta), **self._levers(self.kept["lever"])}

    def _level_speed(
        self, t: float, since: float, y: Mapping[str, float], m: PlannedManoeuvre
    ) -> dict[str, float]:
        slowly, fast = self.first["V"] - m.amplitude, self.first["V"] + m.amplitude
        slow_part = since < m.duration
        if (y["V"] <= slowly) if slow_part else (y["V"] >= fast):
            self.reached.add("slow" if slow_part else "fast")
        if slow_part:
            power = self._speed(y, slowly) if "slow" in self.reached else self._all(_IDLE)
        elif "fast" in self.reached:
            power = self._speed(y, fast)
        else:
            power = self._all(_FULL)
        return {**self._steady(t, y), **power}

    def _device(
        self, t: float, since: float, y: Mapping[str, float], m: PlannedManoeuvre
    ) -> dict[str, float]:
        travel = 0.5 * m.duration
        part = np.interp(
            since, [0.5, 0.5 + travel, m.duration, m.duration + travel], [0.0, 1.0, 1.0, 0.0]
        )
        return {
            **self._steady(t, y),
            m.device: self.trim[m.device] + part * (m.amplitude - self.trim[m.device]),
        }

    @staticmethod
    def _angular(error: float, rate: float, w: float) -> float:
        return -(w**2) * error - 2.0 * _DAMPING * w * rate

    def _level(self, t: float, y: Mapping[str, float]) -> float:
        """Return the pitch attitude that brings the aircraft back to its path."""
        speed = max(y["V"], 1.0)
        climb = self.first["hdot"] + float(
            np.clip(0.15 * (self.first["h"] + self.first["hdot"] * t - y["h"]), -3.0, 3.0)
        )
        gamma = climb / speed + 0.5 * (climb - y["hdot"]) / speed
        return self.state["alpha"] * np.cos(y["phi"]) + float(np.clip(gamma, -0.15, 0.15))

    def _pitch(self, y: Mapping[str, float], theta: float) -> dict[str, float]:
        turn = 9.81 * np.tan(y["phi"]) * np.sin(y["phi"]) / max(y["V"], 1.0)
        error = y["theta"] - theta
        self.state["delta_e"] -= PERIOD * 0.3 * _PITCH**3 * error / self.power["delta_e"]
        return {
            "delta_e": self.state["delta_e"]
            + self._angular(error, y["q"] - turn, _PITCH) / self.power["delta_e"]
        }

    def _heading(self, y: Mapping[str, float]) -> float:
        error = (self.first["psi"] - y["psi"] + np.pi) % (2.0 * np.pi) - np.pi
        return self.first["phi"] + float(np.clip(1.2 * error, -0.4, 0.4))

    def _roll(self, y: Mapping[str, float], phi: float) -> dict[str, float]:
        return {
            "delta_a": self.trim["delta_a"]
            + self._angular(y["phi"] - phi, y["p"], _ROLL) / self.power["delta_a"]
        }

    def _speed(self, y: Mapping[str, float], speed: float) -> dict[str, float]:
        error = speed - y["V"]
        self.state["lever"] = float(
            np.clip(self.state["lever"] + PERIOD * 0.012 * error, -1.0, 1.0)
        )
        return self._levers(self.state["lever"] + 0.055 * error)

    def _levers(self, change: float) -> dict[str, float]:
        return {name: float(np.clip(self.trim[name] + change, 0.0, 1.0)) for name in self.levers}

    def _all(self, lever: float) -> dict[str, float]:
        return dict.fromkeys(self.levers, lever)


_ATTITUDE = ("phi", "theta", "psi")
_CONTROLS = ("delta_e", "delta_a", "delta_r", "delta_f", "gear", "speedbrake")
_MASS = ("mass", "x_cg_b", "y_cg_b", "z_cg_b")


def predicted_record(
    flown: PredictedFlight,
    aircraft: Aircraft,
    title: str,
    rates: Mapping[str, float] | None = None,
    seed: int = 0,
) -> xr.DataTree:
    """Return the flight record of a predicted flight.

    Parameters
    ----------
    flown : Flown
    aircraft : Aircraft
        Its instruments: noise, positions, mean factors, lags, delays and static error.
    title : str
        Of the record.
    rates : mapping of str to float, optional
        Samples per second of an instrument by its name; 50 Hz without. [Hz]
    seed : int
        Of the noise.

    Returns
    -------
    DataTree
        As `flighttest.read` returns it, with manoeuvres.

    Raises
    ------
    SchemaError
        Instruments that a reconstruction cannot work with.
    """
    rng = np.random.default_rng(seed)
    specification = parse_instruments(aircraft.instruments, f"instruments of {aircraft.name}")
    time = flown.motion["time"].values
    sensed = _sensed(flown.motion, aircraft, specification)
    leaves: dict[str, xr.Dataset] = {}
    for name, item in specification.table.items():
        channels = [
            channel for channel in item.noise if channel in sensed and channel not in _CONTROLS
        ]
        if channels:
            leaves[name] = _leaf(
                time, {c: sensed[c] for c in channels}, item, (rates or {}).get(name, RATE), rng
            )
    known = {
        c: sensed[c]
        for c in (*_CONTROLS, *_MASS, *(n for n in sensed if n.endswith(".thrust")))
        if c in sensed
    }
    surfaces = next(
        (item for item in specification.table.values() if set(item.noise) & set(_CONTROLS)),
        Instrument(),
    )
    leaves["controls_and_mass"] = _leaf(time, known, surfaces, RATE, rng)
    about = {
        "title": title,
        "manoeuvres": json.dumps(flown.marks),
        "unmapped": "",
        "absent": "",
        "notes": "[]",
        "purpose": "prediction",
    }
    return xr.DataTree.from_dict(
        {"/": xr.Dataset(attrs=about), **{f"/{name}": data for name, data in leaves.items()}}
    )


def _sensed(
    motion: xr.Dataset, aircraft: Aircraft, specification: Instruments
) -> dict[str, np.ndarray]:
    """Return what perfect sensors at their places would show, by channel."""
    y = {str(name): item.values for name, item in motion.data_vars.items()}
    time = motion["time"].values
    cg = np.stack(
        [
            y.get(name, np.full(len(time), at))
            for name, at in zip(_MASS[1:], aircraft.cg, strict=True)
        ],
        axis=1,
    )
    omega = np.stack([y[name] for name in "pqr"], axis=1)
    omega_dot = np.stack([y[f"{name}_dot"] for name in "pqr"], axis=1)

    def arm(channel: str) -> np.ndarray:
        position = specification.of(channel).position
        return (np.asarray(position) - cg) if position is not None else np.zeros_like(cg)

    r = arm("ax_imu")
    force = (
        np.stack([y[name] for name in ("ax", "ay", "az")], axis=1)
        + np.cross(omega_dot, r)
        + np.cross(omega, np.cross(omega, r))
    )
    found = {
        **dict(zip(IMU[:3], omega.T, strict=True)),
        **dict(zip(IMU[3:], force.T, strict=True)),
        **{n: y[n] for n in _ATTITUDE},
    }
    u, v, w = (np.stack([y[name] for name in "uvw"], axis=1) + np.cross(omega, arm("alpha_vane"))).T
    for name, flow in (("alpha_vane", np.arctan2(w, u)), ("beta_vane", np.arctan2(v, u))):
        item = specification.of(name)
        shown = remove_lag(time, flow, -item.lag[0], name) if item.lag else flow
        found[name] = item.factor.get(name, (1.0, 0.0))[0] * shown
    q_c = impact_pressure(y["mach"], y["p_static"])
    error = (specification.of("q_c").static_error or (0.0, 0.0))[0]
    found |= {
        "q_c": q_c * (1.0 - error),
        "p_static": y["p_static"] + error * q_c,
        "temperature": y["temperature"],
    }
    found |= {
        name: y[name] * specification.of(name).factor.get(name, (1.0, 0.0))[0]
        for name in ("V", "V_cas", "mach")
    }
    found |= {"vn": y["vn"], "ve": y["ve"], "vd": y["vd"], "h_gps": y["h"]}
    found |= {
        name: y.get(f"applied.{name}", y.get(name))
        for name in _CONTROLS
        if f"applied.{name}" in y or name in y
    }
    return found | {
        name: x
        for name, x in y.items()
        if name in _MASS or (name.startswith("engine") and name.endswith(".thrust"))
    }


def _leaf(
    time: np.ndarray,
    channels: Mapping[str, np.ndarray],
    item: Instrument,
    rate: float,
    rng: np.random.Generator,
) -> xr.Dataset:
    clock = np.arange(time[0], time[-1] + 1e-9, 1.0 / rate)
    delay = item.delay[0] if item.delay else 0.0
    shown = {}
    for name, x in channels.items():
        level = item.noise.get(name, 0.0)
        x = np.interp(clock - delay, time, np.unwrap(x) if name == "psi" else x)
        shown[name] = (
            "time",
            x + rng.normal(0.0, level, len(clock)) if level else x,
            quantity_attributes(name),
        )
    about = {"rate": rate, "gaps": "", "duplicates": 0, "missing": "", "flags": "[]"}
    return xr.Dataset(shown, {"time": ("time", clock, quantity_attributes("time"))}, about)
