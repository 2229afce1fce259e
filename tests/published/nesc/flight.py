"""Flying the F-16 scenarios: trim over the rotating Earth, the control law in the loop of
`flightmech.simulate_closed_loop`.

The tools take the damping of the F-16 from the body rates relative to the rotating Earth, with
which the air turns (mode.rates 1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache

import numpy as np
import xarray as xr

import flightmech
from aerodb.exchange import daveml
from flightmech.simulation.kernel import OUTPUT, Simulation
from flightmech.simulation.run import output_attributes

from .f16 import DEG, FT, KT, MODELS, compiled
from .law import function_of
from .records import EARTH_RADIUS, EARTH_RATE, ECCENTRICITY_2
from .scenarios import SCENARIOS, Commands, Scenario

RHO_0 = 1.225  # [kg/m3] of equivalent airspeed
NUDGE = 1e-6


def axes(phi: float, theta: float, psi: float) -> np.ndarray:
    """Return the rotation (3, 3) from north, east, down to body axes."""
    (sf, cf), (st, ct), (sp, cp) = ((math.sin(x), math.cos(x)) for x in (phi, theta, psi))
    return np.array(
        [
            [ct * cp, ct * sp, -st],
            [sf * st * cp - cf * sp, sf * st * sp + cf * cp, sf * ct],
            [cf * st * cp + sf * sp, cf * st * sp - sf * cp, cf * ct],
        ]
    )


def earth_turn(lat: float) -> np.ndarray:
    """Return the angular velocity (3,) of the Earth along north, east, down. [rad/s]"""
    return EARTH_RATE * np.array([math.cos(lat), 0.0, -math.sin(lat)])


def level_turn(lat: float, h: float, vn: float, ve: float) -> np.ndarray:
    """Return the angular velocity (3,) of north, east, down relative to the Earth in level flight.
    [rad/s]
    """
    w2 = 1.0 - ECCENTRICITY_2 * math.sin(lat) ** 2
    east, north = EARTH_RADIUS / math.sqrt(w2), EARTH_RADIUS * (1.0 - ECCENTRICITY_2) / w2**1.5
    return np.array([ve / (east + h), -vn / (north + h), -ve * math.tan(lat) / (east + h)])


class Flight:
    """One simulation of the kernel, step by step: the trim, and integration as tool 5 does it."""

    def __init__(self, start: Mapping[str, float], step: float):
        self.model = compiled()
        self.run = Simulation(self.model.model)
        self.u = np.zeros(len(self.model.inputs))
        self.names = {name: i for i, name in enumerate(self.model.outputs)}
        self.parameter = {name: i for i, name in enumerate(self.model.parameters)}
        self.last_rate: np.ndarray | None = None
        for name, value in {
            **start,
            "mode.earth": 1.0,
            "mode.rates": 1.0,
            "mode.step": step,
        }.items():
            self.run.set_parameter(self.parameter[name], value)

    def put(self, **controls: float) -> None:
        """Set controls by name; ``lever`` is the throttle."""
        for name, value in controls.items():
            self.u[self.model.inputs.index("engine1.throttle" if name == "lever" else name)] = value

    def begin(self, alpha: float) -> None:
        """Put the state to the start with this angle of attack as pitch attitude: level flight."""
        for name in ("init.alpha", "init.theta"):
            self.run.set_parameter(self.parameter[name], alpha)
        self.run.set_inputs(self.u)
        self.run.initialize()

    def outputs(self) -> dict[str, float]:
        """Return the outputs by name."""
        return dict(zip(self.names, self.run.outputs().tolist(), strict=True))

    def adams_step(self, t: float, dt: float) -> None:
        """Advance from t to t + dt by the second-order Adams-Bashforth formula; the first step is
        Euler's.
        """
        x = self.run.state
        rate = self.run.derivative(x, self.u)
        self.run.state = x + dt * (
            rate if self.last_rate is None else 1.5 * rate - 0.5 * self.last_rate
        )
        self.last_rate = rate
        self.run.complete_step(t + dt)


def start_of(case: str) -> dict[str, float]:
    """Return initial parameters: steady level flight over the turning Earth as the scenario states,
    Euler angles steady.
    """
    s = SCENARIOS[case].start
    lat, psi, V, h = s["lat"] * DEG, s["psi"] * DEG, s["V"] * FT, s["h"] * FT
    start = {"init.V": V, "init.h": h, "init.lat": lat, "init.lon": s["lon"] * DEG, "init.psi": psi}
    turn = earth_turn(lat) + level_turn(lat, h, V * math.cos(psi), V * math.sin(psi))
    theta = trim({**start, **_rates(axes(0.0, 0.0, psi) @ turn)})["alpha"]
    return {**start, **_rates(axes(0.0, theta, psi) @ turn)}


def _rates(rates: np.ndarray) -> dict[str, float]:
    return dict(zip(("init.p", "init.q", "init.r"), map(float, rates), strict=True))


def trim(start: Mapping[str, float]) -> dict[str, float]:
    """Return alpha (the pitch attitude), elevator [rad] and lever [1] so that speed, angle of
    attack and pitch rate are steady.

    The lateral controls stay at zero: what asymmetry the turning Earth makes is left, as tools 4
    and 5 leave it.
    """
    flight = Flight(start, 0.01)
    z = np.array([0.045, -0.055, 0.14])
    for _ in range(30):
        r = _unsteady(flight, z)
        J = np.column_stack(
            [
                (_unsteady(flight, z + d) - _unsteady(flight, z - d)) / (2.0 * NUDGE)
                for d in NUDGE * np.eye(3)
            ]
        )
        step = np.linalg.solve(J, r)
        z = z - step
        if np.abs(step).max() < 1e-13:
            break
    return dict(zip(("alpha", "delta_e", "lever"), map(float, z), strict=True))


def _unsteady(flight: Flight, z: np.ndarray) -> np.ndarray:
    flight.put(delta_e=z[1], lever=z[2])
    flight.begin(z[0])
    flight.outputs()
    y = flight.outputs()
    x = flight.run.state
    dx = flight.run.derivative(x, flight.u)
    return np.array([x[3:6] @ dx[3:6] / y["V"], y["alpha_dot"] * y["V"], y["q_dot"]])


@cache
def fly(case: str, hold: float = 0.0, adams: bool = False) -> xr.Dataset:
    """Return a scenario at 10 Hz: all outputs of the kernel, and ``delta_e delta_a delta_r`` [rad]
    and ``lever`` [1] as commanded.

    Parameters
    ----------
    case : str
        Of `SCENARIOS`.
    hold : float
        Step of the kernel, over which the controls are held; zero takes that of the scenario. [s]
    adams : bool
        Integrate the kernel's derivative by the second-order Adams-Bashforth formula, as tool 5
        does, instead of the kernel's steps.
    """
    scenario = SCENARIOS[case]
    hold, start = hold or scenario.hold, start_of(case)
    steady = trim(start)
    law = Autopilot(scenario, steady, hold) if scenario.commands else None
    if adams:
        return _adams(scenario, start, steady, law, hold)
    level = {
        **start,
        "init.alpha": steady["alpha"],
        "init.theta": steady["alpha"],
        "mode.earth": 1.0,
        "mode.rates": 1.0,
        "mode.step": hold,
    }
    controls = {"delta_e": steady["delta_e"], "engine1.throttle": steady["lever"]}
    at = xr.Dataset(
        {name: ((), value) for name, value in controls.items()},
        {"time": 0.1 * np.arange(round(scenario.duration / 0.1) + 1)},
    )
    fixed = {**dict.fromkeys(("delta_e", "delta_a", "delta_r"), 0.0), **controls}
    return flightmech.simulate_closed_loop(
        compiled(), at, law or (lambda t, y, u: fixed), hold, level
    ).rename({"engine1.throttle": "lever"})


def _adams(
    scenario: Scenario,
    start: Mapping[str, float],
    steady: Mapping[str, float],
    law: Autopilot | None,
    hold: float,
) -> xr.Dataset:
    """Return a scenario with the derivative of the kernel integrated as tool 5 does; the law at
    every step, as in the closed loop.
    """
    flight = Flight(start, hold)
    flight.put(delta_e=steady["delta_e"], lever=steady["lever"])
    flight.begin(steady["alpha"])
    every, rows = round(0.1 / hold), []
    for i in range(round(scenario.duration / hold) + 1):
        if law is not None:
            flight.put(**law(i * hold, flight.outputs(), {}))
            flight.run.set_inputs(flight.u)
        if i % every == 0:
            rows.append([i * hold, *flight.run.outputs(), *flight.u])
        flight.adams_step(i * hold, hold)
    return _dataset(flight, np.array(rows))


class Autopilot:
    """The control law of a scenario, with the deviation to the right of the course of the start,
    which it sums up. [ft]
    """

    def __init__(self, scenario: Scenario, steady: Mapping[str, float], hold: float):
        assert scenario.commands is not None
        self.scenario, self.hold, self.deviation = scenario, hold, 0.0
        self.controls = _law(scenario, scenario.commands, steady)

    def __call__(
        self, t: float, y: Mapping[str, float], u: Mapping[str, float]
    ) -> dict[str, float]:
        """Return the controls from the outputs of the kernel."""
        found = self.controls(t, y, self.deviation)
        self.deviation += self.hold * _drift(y, self.scenario)
        return found


def _drift(y: Mapping[str, float], scenario: Scenario) -> float:
    """Return the speed to the right of the course of the start. [ft/s]"""
    course = scenario.start["psi"] * DEG
    return (y["ve"] * math.cos(course) - y["vn"] * math.sin(course)) / FT


def _law(scenario: Scenario, commands: Commands, steady: Mapping[str, float]) -> Commands:
    """Return the control law as a function of time, outputs and deviation to controls in SI; rates
    relative to the Earth.
    """
    design = (
        dict.fromkeys(("trimmedAlpha", "trimmedTheta"), steady["alpha"] / DEG)
        if scenario.at_trim
        else {}
    )
    law, fixed = function_of(daveml.read(MODELS / scenario.law), design), _pilot(steady)

    def controls(t: float, y: Mapping[str, float], deviation: float) -> dict[str, float]:
        rates = np.array([y["p"], y["q"], y["r"]]) - axes(
            y["phi"], y["theta"], y["psi"]
        ) @ earth_turn(y["lat"])
        found = law(
            {
                **fixed,
                **_sensed(y),
                **dict(zip(("pb", "qb", "rb"), rates, strict=True)),
                **commands(t, y, deviation),
            }
        )
        return {
            "delta_e": found["el"] * DEG,
            "delta_a": found["ail"] * DEG,
            "delta_r": found["rdr"] * DEG,
            "engine1.throttle": found["PWR"] / 100.0,
        }

    return controls


def _pilot(steady: Mapping[str, float]) -> dict[str, float]:
    """Return the inputs of the law that stay: hands off, autopilot on, trimmed stick (-25 deg of
    elevator full aft) and lever.
    """
    hands_off = dict.fromkeys(("throttle", "longStk", "latStk", "pedal"), 0.0)
    return {
        **hands_off,
        "sasOn": 1.0,
        "apOn": 1.0,
        "throttleTrim": steady["lever"],
        "longStkTrim": steady["delta_e"] / (-25.0 * DEG),
    }


def _sensed(y: Mapping[str, float]) -> dict[str, float]:
    angles = {name: y[name] / DEG for name in ("alpha", "beta", "phi", "theta", "psi")}
    return {**angles, "altMsl": y["h"] / FT, "Vequiv": y["V"] * math.sqrt(y["rho"] / RHO_0) / KT}


def _dataset(flight: Flight, rows: np.ndarray) -> xr.Dataset:
    outputs = flight.model.entries(OUTPUT)
    columns: dict[str, tuple] = {
        row.name: ("time", rows[:, 1 + i], output_attributes(row)) for i, row in enumerate(outputs)
    }
    controls = rows[:, 1 + len(outputs) :]
    for name in ("delta_e", "delta_a", "delta_r", "engine1.throttle"):
        columns["lever" if "." in name else name] = (
            "time",
            controls[:, flight.model.inputs.index(name)],
        )
    return xr.Dataset(columns, {"time": rows[:, 0]})
