"""Output error on the gear of the kernel (type 1 of LR-743, Table 1).

The identified model is the simulated model.  The aircraft rolls through stretches of the records
from their first state, with the recorded controls, brakes, thrust and wind.  The outputs are
velocity, yaw and pitch rate, and compressions.  Slip is a state of the model here, so that its
measurement error causes no bias.  The regression gives the start, the aerodynamics near the ground,
and the errors of the inputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import xarray as xr

import flightmech
from flightmech.air import atmosphere
from flightmech.aircraft.aircraft import Aircraft
from flightmech.axes import matrix_from_euler
from flightmech.simulation.batch import fly_batch
from flightmech.simulation.run import read_inputs
from flightmech.support.arrays import true_runs
from flighttest.maximum_likelihood.flown_runs import Runs
from flighttest.maximum_likelihood.likelihood import Likelihood
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import maximise_likelihood
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out
from flighttest.submodels.landing_gear.explicit import FRICTION, LOAD, MOVING
from flighttest.submodels.landing_gear.reconstructed_loads import (
    TOUCHING,
    brake_pedals,
    states_of,
)
from flighttest.submodels.landing_gear.regression import LoadFit
from flighttest.submodels.landing_gear.wheel_positions import (
    WheelGroup,
    state_column,
    wheel_groups,
    wheel_places,
    wheels_of,
)

# Length of a stretch. [s]
LENGTH = 6.0
# Begin of a stretch in which tyres and legs settle after the incomplete first state. [s]
SETTLE = 0.5
# Largest side force over load of a stretch that is simulated.
TURNING = 0.1
# Samples of the outputs per second.
RATE = 25.0
# Internal step of the simulation, equal to the lag of the tyres. [s]
STEP = 0.02
STEERING = ("trail", "inertia", "damping", "arm_stiffness", "arm_damping", "arm_inertia")
_OUTPUTS = ("vn", "ve", "r", "q")
_CONTROLS = ("delta_e", "delta_a", "delta_r", "delta_f", "gear", "speedbrake", "delta_nw")
_BOUNDS = {"cornering": (0.1, 100.0), "bend": (1e-4, 10.0), "side_stiffness": (1e4, 1e6)}
# Least inertia over stiffness of the spring that the kernel integrates. [s2]
_FASTEST = {"inertia": 1.1e-4, "arm_inertia": 2.2e-4}
# A bend so small that it has no effect at any load.
_STRAIGHT = 1e-4
# Largest number of iterations of the search; 15 did not suffice for two turns.
_ITERATIONS = 60
_R_AIR = 287.05287  # [J kg-1 K-1]


def kernel_parameters(at: Mapping[str, float], groups: Sequence[WheelGroup]) -> dict[str, float]:
    """Return the parameters of the kernel for constants of tyres and steering.

    `at` has the names of `explicit`.
    """
    parameters = {}
    for name, value in at.items():
        if name.startswith(("steering.", "runway.")):
            parameters[name] = value
    for group in groups:
        if group.parameter("cornering") not in at:
            continue
        # C_max = g N_max / 2 at N_max = 10 kN / sqrt(b), see `explicit`.
        largest_load = LOAD / np.sqrt(max(at[group.parameter("bend")], _STRAIGHT))
        tyre = {
            "cornering_load": largest_load,
            "cornering_stiffness": 0.5 * at[group.parameter("cornering")] * largest_load,
            "side_stiffness": at[group.parameter("side_stiffness")],
        }
        for name, value in tyre.items():
            for target in group.targets(name):
                parameters[target] = float(value)
    return parameters


class RollingStretch:
    """A stretch of a record and its simulation on the runway."""

    def __init__(
        self,
        sim: flightmech.SimModel,
        states: xr.Dataset,
        aircraft: Aircraft,
        errors: Mapping[str, float],
        fixed: dict,
    ):
        self.sim, self.groups, self.fixed = sim, wheel_groups(aircraft), fixed
        self.names: tuple[str, ...] = ()
        step = float(np.median(np.diff(states["time"].values)))
        stride = max(1, round(1.0 / (RATE * step)))
        last = (states.sizes["time"] - 1) // stride * stride
        states = states.isel(time=slice(0, last + 1, stride))
        self.interval = stride * step
        self.time = states["time"].values - float(states["time"].values[0])
        wheels = [f"gear.{wheel.name}.compression" for wheel in wheels_of(aircraft)]
        self.outputs = [*_OUTPUTS, *wheels]
        if "gear.steering" in states:
            self.outputs.append("gear.steering")
        self.measured = np.column_stack([state_column(states, name) for name in self.outputs])
        self.measured[self.time < SETTLE] = np.nan
        wind = [
            state_column(states, f"wind_{axis}", 0.0) + errors.get(f"wind_{axis}", 0.0)
            for axis in "ne"
        ]
        self.settings = {
            "mode.step": STEP,
            **_start(states, aircraft, wind),
            "bias.CL": errors.get("lift", 0.0),
            "bias.CD": errors.get("drag", 0.0),
            "bias.Cm": errors.get("pitching", 0.0),
        }
        thrust = 1.0 + errors.get("thrust", 0.0)
        inputs = _inputs(sim, states, wind=wind, thrust=thrust, time=self.time)
        self.u = read_inputs(sim, inputs, self.settings, len(self.time))
        self.runs = Runs(self._fly)

    def _fly(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return outputs (run, time, output), and whether each run reached the end."""
        runs = []
        for row in rows:
            constants = {**self.fixed, **dict(zip(self.names, row))}
            runs.append(kernel_parameters(constants, self.groups))
        table = np.array([list(parameters.values()) for parameters in runs])
        y, done, _ = fly_batch(
            self.sim,
            self.time,
            self.u,
            varied=list(runs[0]),
            values=table,
            constant=self.settings,
            outputs=self.outputs,
        )
        return y, done == len(self.time)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output)."""
        return self.runs.outputs(values)

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Simulate the slopes together with the next prediction."""
        self.runs.expect(steps, central)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the slopes of the outputs (time, output, unknown).

        Beyond a bound of the kernel there is no run; the difference is then one-sided.
        """
        return np.moveaxis(self.runs.slopes(values, steps, central), 0, 2)


def _inputs(
    sim: flightmech.SimModel,
    states: xr.Dataset,
    wind: Sequence[np.ndarray],
    thrust: float,
    time: np.ndarray,
) -> xr.Dataset:
    """Return the inputs of the simulation, with gear down and the thrust times a factor."""
    inputs = {}
    for name in _CONTROLS:
        if name in states and name in sim.inputs:
            inputs[name] = state_column(states, name)
    inputs |= {"gear": np.ones(len(time)), "wind_n": wind[0], "wind_e": wind[1]}
    inputs["brake_left"], inputs["brake_right"] = brake_pedals(states)
    for name in sim.inputs:
        if name.endswith(".thrust_drive"):
            inputs[name] = thrust * state_column(states, name.removesuffix("_drive"))
    return xr.Dataset({name: ("time", values) for name, values in inputs.items()}, {"time": time})


def _start(states: xr.Dataset, aircraft: Aircraft, wind: Sequence[np.ndarray]) -> dict[str, float]:
    """Return first state, mass, air and runway as parameters of the simulation.

    The wheels stand on the runway at the recorded height.
    """
    first = states.isel(time=slice(0, 1))
    attitude = ("phi", "theta", "psi")
    state = {
        name: float(state_column(first, name)[0])
        for name in (*attitude, "p", "q", "r", "vn", "ve", "vd")
    }
    C = matrix_from_euler(*(state[name] for name in attitude))
    velocity = np.array([state["vn"], state["ve"], state["vd"]])
    u, v, w = C @ (velocity - (float(wind[0][0]), float(wind[1][0]), 0.0))
    V = float(np.sqrt(u**2 + v**2 + w**2))
    height = wheel_places(states, aircraft, np.zeros(states.sizes["time"])).height
    h = state_column(states, "h", 0.0)
    runway = float(np.mean(h - height))
    air = atmosphere(runway)
    # The recorded density at standard pressure gives the temperature.
    T = float(air.p_static) / (_R_AIR * float(state_column(states, "rho", float(air.rho)).mean()))
    parameters = {
        "init.V": V,
        "init.alpha": float(np.arctan2(w, u)),
        "init.beta": float(np.arcsin(v / V)),
    }
    for name in (*attitude, "p", "q", "r"):
        parameters[f"init.{name}"] = state[name]
    parameters |= {
        "init.h": runway + float(height[0]),
        "env.runway_elevation": runway,
        "env.delta_T": T - float(air.temperature),
        "mode.earth": 0.0,
        "mode.engine": 2.0,
    }
    for axis, value in zip("xyz", aircraft.cg):
        cg = state_column(states, f"{axis}_cg_b", value)
        parameters[f"mass.{axis}_cg_b"] = float(cg.mean())
    parameters["mass.mass"] = float(state_column(states, "mass", aircraft.mass).mean())
    return parameters


def turning_stretches(
    states: xr.Dataset, loads: xr.Dataset, length: float = LENGTH
) -> list[xr.Dataset]:
    """Return stretches of a record in which all wheels roll and the tyres turn the aircraft.

    Each is at most `length` [s] long.  On a straight path, the motion follows errors of the
    nose-wheel angle that no instrument resolves: 0.05 deg is 0.5 m/s2 at 30 m/s.
    """
    has_force = np.isfinite(loads["force"].values).all(axis=1)
    rolls = (
        (loads["speed"].values > MOVING)
        & (loads["compression"].values.min(axis=1) > TOUCHING)
        & has_force
    )
    # Side force of the tyres over their load: the side acceleration in g.
    turns = np.abs(loads["force"].sel(output="Fy").values) / np.maximum(
        loads["force"].values[:, : loads.sizes["wheel"]].sum(axis=1), 1.0
    )
    step = float(np.median(np.diff(states["time"].values)))
    stretches = []
    for begin, end in true_runs(rolls):
        # Parts of equal length, as close to `length` as their number allows.
        count = max(1, round((end - begin) * step / length))
        parts = np.linspace(begin, end, count + 1).astype(int)
        for a, b in pairwise(parts):
            if (b - a) * step > 4.0 * SETTLE and turns[a:b].max() > TURNING:
                stretches.append(states.isel(time=slice(a, b)))
    return stretches


def fly_gear(
    records: Sequence, aircraft: Aircraft, database: xr.DataTree, loads: LoadFit
) -> OutputError | None:
    """Return the constants of tyres and steering by output error on the kernel.

    Parameters
    ----------
    records : sequence of Path or Dataset
        As for `wheel_loads`.
    aircraft, database
        The simulated model: an aircraft with the constants of the regression.
    loads : LoadFit
        The regression: errors of the inputs, and which constants of the tyres are determined.

    Returns
    -------
    OutputError or None
        None if no side force and no steering is determined, or no stretch has all wheels rolling.
    """
    pieces, groups = [], []
    fixed = _constants(aircraft, loads)
    unknowns = _unknowns(aircraft, loads, all(has_angle(record) for record in records))
    sim = flightmech.compile(aircraft, database)
    for k, record in enumerate(records):
        parts = turning_stretches(states_of(record), loads.loads[k])
        errors = loads.inputs_of(k)
        for part in parts:
            pieces.append(RollingStretch(sim, part, aircraft=aircraft, errors=errors, fixed=fixed))
        groups += [k] * len(parts)
    if not pieces or not unknowns:
        return None
    layout = lay_out(unknowns, [{} for _ in pieces])
    for piece in pieces:
        piece.names = layout.names
    maximum = maximise_likelihood(Likelihood(pieces, layout, np.array(groups)), _ITERATIONS)
    covariance, colours = coloured_likelihood_covariance(
        maximum, layout.columns, [piece.interval for piece in pieces]
    )
    estimates = estimates_dataset(
        maximum, layout, covariance, {"method": "output error on the gear of the kernel"}
    )
    residuals = []
    for piece, v in zip(pieces, maximum.residuals):
        columns = {name: ("time", v[:, k]) for k, name in enumerate(piece.outputs)}
        residuals.append(xr.Dataset(columns, {"time": piece.time}))
    measured = [piece.measured for piece in pieces]
    noise = noise_dataset(maximum, pieces[0].outputs, colours, measured)
    return OutputError(estimates, tuple(residuals), noise)


def has_angle(record) -> bool:
    """Return whether command and angle of the nose wheel are both recorded."""
    return {"gear.steering", "delta_nw"} <= set(map(str, states_of(record).data_vars))


def _constants(aircraft: Aircraft, loads: LoadFit) -> dict[str, float]:
    """Return the first values of the constants of tyres and steering."""
    assert aircraft.gear is not None
    wheels = {wheel.name: wheel for wheel in wheels_of(aircraft)}
    regression = {**loads.held, **loads.fit.parameters}
    # A trail of zero: a single recorded angle is that of the wheel.
    constants = {FRICTION: regression[FRICTION], "steering.trail": 0.0}
    for group in wheel_groups(aircraft):
        for name in ("cornering", "bend"):
            constants[group.parameter(name)] = regression[group.parameter(name)]
        constants[group.parameter("side_stiffness")] = wheels[group.names[0]].side_stiffness
    return constants


def _unknowns(aircraft: Aircraft, loads: LoadFit, angle: bool) -> dict[str, Unknown]:
    """Return the unknowns: friction, side force, and steering.

    Friction and side force are unknowns if the regression determined them.  The steering is unknown
    if command and angle are recorded.
    """
    assert aircraft.gear is not None
    start, determined = _constants(aircraft, loads), loads.fit.parameters
    unknowns = {}
    if FRICTION in determined:
        unknowns[FRICTION] = _bounded(start[FRICTION], (0.02, 3.0))
    for group in wheel_groups(aircraft):
        if group.parameter("cornering") not in determined:
            continue
        for constant, bounds in _BOUNDS.items():
            name = group.parameter(constant)
            if constant == "side_stiffness":
                # Above some speed it has no effect, so its a-priori standard error is its size.
                unknowns[name] = _bounded(start[name], bounds)._replace(sigma=start[name])
            elif name in determined:
                unknowns[name] = _bounded(start[name], bounds)
    if angle:
        steering = aircraft.gear.steering
        # The order of the steering decides which constants it has.
        for name in STEERING[: {0: 1, 2: 3, 4: 6}[steering.order]]:
            low = -1.0
            if name != "trail":
                low = _FASTEST.get(name, 0.0) * steering.stiffness
            unknowns[f"steering.{name}"] = Unknown(
                max(float(getattr(steering, name)), low), low=low
            )
    return unknowns


def _bounded(start: float, bounds: tuple[float, float]) -> Unknown:
    """Return an unknown that starts inside its bounds."""
    return Unknown(float(np.clip(start, *bounds)), low=bounds[0], high=bounds[1])
