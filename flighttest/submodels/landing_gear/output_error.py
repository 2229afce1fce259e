"""Output error on the gear of the kernel: what is identified is what flies (type 1 of LR-743, Table
1).

The aircraft rolls through stretches of the records under their controls, brakes, thrust and wind,
from their first state, and the constants are solved for under which velocity, yaw and pitch rate,
and compressions are those recorded.  Slip is a state of the model here, so that its measurement
error biases nothing; the regression gives the start, the aerodynamics near the ground, and what the
inputs are wrong by.
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
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import Likelihood, maximise_likelihood
from flighttest.maximum_likelihood.time_domain import Runs
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out
from flighttest.submodels.landing_gear.explicit import FRICTION, LOAD, MOVING
from flighttest.submodels.landing_gear.reconstructed_loads import (
    TOUCHING,
    WheelGroup,
    state_column,
    states_of,
    wheel_groups,
    wheel_places,
    wheels_of,
)
from flighttest.submodels.landing_gear.regression import LoadFit

LENGTH = 6.0  # of a stretch [s]
SETTLE = 0.5  # of a stretch, in which tyres and legs take up what the first state left out [s]
TURNING = 0.1  # side force over load, at its largest in a stretch that is flown
RATE = 25.0  # samples of the outputs per second
STEP = 0.02  # internal step of the simulation, the lag of the tyres [s]
STEERING = ("trail", "inertia", "damping", "arm_stiffness", "arm_damping", "arm_inertia")
_OUTPUTS = ("vn", "ve", "r", "q")
_CONTROLS = ("delta_e", "delta_a", "delta_r", "delta_f", "gear", "speedbrake", "delta_nw")
_BOUNDS = {"cornering": (0.1, 100.0), "bend": (1e-4, 10.0), "side_stiffness": (1e4, 1e6)}
_FASTEST = {
    "inertia": 1.1e-4,
    "arm_inertia": 2.2e-4,
}  # least inertia over the stiffness of the spring that the kernel integrates [s2]
_STRAIGHT = 1e-4  # bend that no load shows
_ITERATIONS = 15
_R_AIR = 287.05287  # [J kg-1 K-1]


def kernel_parameters(at: Mapping[str, float], groups: Sequence[WheelGroup]) -> dict[str, float]:
    """Return the parameters of the kernel that constants of tyres and steering under the names of
    `explicit` stand for.
    """
    found = {name: value for name, value in at.items() if name.startswith(("steering.", "runway."))}
    for group in groups:
        if group.parameter("cornering") not in at:
            continue
        most = LOAD / np.sqrt(max(at[group.parameter("bend")], _STRAIGHT))
        own = {
            "cornering_load": most,
            "cornering_stiffness": 0.5 * at[group.parameter("cornering")] * most,
        }
        own["side_stiffness"] = at[group.parameter("side_stiffness")]
        found |= {
            target: float(value) for name, value in own.items() for target in group.targets(name)
        }
    return found


class RollingStretch:
    """A stretch of a record as the aircraft rolls through it."""

    def __init__(
        self,
        sim: flightmech.SimModel,
        states: xr.Dataset,
        aircraft: Aircraft,
        errors: Mapping[str, float],
        known: dict,
    ):
        self.sim, self.groups, self.known = sim, wheel_groups(aircraft), known
        self.names: tuple[str, ...] = ()
        step = float(np.median(np.diff(states["time"].values)))
        stride = max(1, round(1.0 / (RATE * step)))
        states = states.isel(
            time=slice(0, (states.sizes["time"] - 1) // stride * stride + 1, stride)
        )
        self.interval = stride * step
        self.time = states["time"].values - float(states["time"].values[0])
        wheels = [f"gear.{wheel.name}.compression" for wheel in wheels_of(aircraft)]
        self.outputs = [
            *_OUTPUTS,
            *wheels,
            *(["gear.steering"] if "gear.steering" in states else []),
        ]
        self.measured = np.column_stack([state_column(states, name) for name in self.outputs])
        self.measured[self.time < SETTLE] = np.nan
        wind = [
            state_column(states, f"wind_{axis}", 0.0) + errors.get(f"wind_{axis}", 0.0)
            for axis in "ne"
        ]
        self.held = {"mode.step": STEP, **_start(states, aircraft, wind)}
        self.held |= {
            f"bias.{name}": errors.get(key, 0.0)
            for name, key in (("CL", "lift"), ("CD", "drag"), ("Cm", "pitching"))
        }
        inputs = _inputs(sim, states, wind, 1.0 + errors.get("thrust", 0.0), self.time)
        self.u = read_inputs(sim, inputs, self.held, len(self.time))
        self.runs = Runs(self._fly)

    def _fly(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (run, time, output), and which runs went through."""
        settings = [
            kernel_parameters({**self.known, **dict(zip(self.names, row))}, self.groups)
            for row in rows
        ]
        table = np.array([list(one.values()) for one in settings])
        y, done, _ = fly_batch(
            self.sim, self.time, self.u, list(settings[0]), table, self.held, self.outputs
        )
        return y, done == len(self.time)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output)."""
        return self.runs.outputs(values)

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Fly slopes with the next prediction."""
        self.runs.expect(steps, central)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return their slopes (time, output, unknown); beyond a bound of the kernel there is no
        run, and the other side stands alone.
        """
        return np.moveaxis(self.runs.slopes(values, steps, central), 0, 2)


def _inputs(
    sim: flightmech.SimModel,
    states: xr.Dataset,
    wind: Sequence[np.ndarray],
    thrust: float,
    time: np.ndarray,
) -> xr.Dataset:
    found = {
        name: state_column(states, name)
        for name in _CONTROLS
        if name in states and name in sim.inputs
    }
    found |= {"gear": np.ones(len(time)), "wind_n": wind[0], "wind_e": wind[1]}
    found |= {
        name: np.clip(state_column(states, name, 0.0), 0.0, 1.0)
        for name in ("brake_left", "brake_right")
    }
    drives = [name for name in sim.inputs if name.endswith(".thrust_drive")]
    found |= {name: thrust * state_column(states, name.removesuffix("_drive")) for name in drives}
    return xr.Dataset({name: ("time", values) for name, values in found.items()}, {"time": time})


def _start(states: xr.Dataset, aircraft: Aircraft, wind: Sequence[np.ndarray]) -> dict[str, float]:
    """First state, mass, and the air; the runway where the wheels stand at the height of the
    record.
    """
    first = states.isel(time=slice(0, 1))
    at = {
        name: float(state_column(first, name)[0])
        for name in ("phi", "theta", "psi", "p", "q", "r", "vn", "ve", "vd")
    }
    C = matrix_from_euler(at["phi"], at["theta"], at["psi"])
    u, v, w = C @ (
        np.array([at["vn"], at["ve"], at["vd"]]) - (float(wind[0][0]), float(wind[1][0]), 0.0)
    )
    V = float(np.sqrt(u**2 + v**2 + w**2))
    motion = {"V": V, "alpha": float(np.arctan2(w, u)), "beta": float(np.arcsin(v / V))}
    motion |= {name: at[name] for name in ("phi", "theta", "psi", "p", "q", "r")}
    height = wheel_places(states, aircraft, np.zeros(states.sizes["time"])).height
    h = state_column(states, "h", 0.0)
    runway = float(np.mean(h - height))
    air = atmosphere(runway)
    T = float(air.p_static) / (_R_AIR * float(state_column(states, "rho", float(air.rho)).mean()))
    found = {f"init.{name}": value for name, value in motion.items()} | {
        "init.h": runway + float(height[0])
    }
    found |= {
        "env.runway_elevation": runway,
        "env.delta_T": T - float(air.temperature),
        "mode.earth": 0.0,
        "mode.engine": 2.0,
    }
    cg = {
        f"mass.{axis}_cg_b": float(state_column(states, f"{axis}_cg_b", value).mean())
        for axis, value in zip("xyz", aircraft.cg)
    }
    return found | cg | {"mass.mass": float(state_column(states, "mass", aircraft.mass).mean())}


def turning_stretches(
    states: xr.Dataset, loads: xr.Dataset, length: float = LENGTH
) -> list[xr.Dataset]:
    """Return the stretches of a record in which all wheels roll and the tyres turn the aircraft,
    each at most `length` long. [s]

    Straight on, the path follows errors of the nose-wheel angle that no instrument resolves: 0.05
    deg is 0.5 m/s2 at 30 m/s.
    """
    known = np.isfinite(loads["force"].values).all(axis=1)
    rolls = (
        (loads["speed"].values > MOVING)
        & (loads["compression"].values.min(axis=1) > TOUCHING)
        & known
    )
    turns = np.abs(loads["force"].sel(output="Fy").values) / np.maximum(
        loads["force"].values[:, : loads.sizes["wheel"]].sum(axis=1), 1.0
    )
    step = float(np.median(np.diff(states["time"].values)))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rolls.astype(int), [0]])))
    found = []
    for begin, end in zip(edges[::2], edges[1::2]):
        count = max(1, round((end - begin) * step / length))
        parts = np.linspace(begin, end, count + 1).astype(int)
        found += [
            states.isel(time=slice(a, b))
            for a, b in pairwise(parts)
            if (b - a) * step > 4.0 * SETTLE and turns[a:b].max() > TURNING
        ]
    return found


def fly_gear(
    records: Sequence, aircraft: Aircraft, database: xr.DataTree, loads: LoadFit
) -> OutputError | None:
    """Return the constants of tyres and steering by output error on the kernel.

    Parameters
    ----------
    records : sequence of Path or Dataset
        As for `wheel_loads`.
    aircraft, database
        Flown: an aircraft with the constants that the regression found.
    loads : LoadFit
        The regression: errors of the inputs, and which constants of the tyres are determined.

    Returns
    -------
    OutputError or None
        None where no side force and no steering is determined, or nothing rolls on all wheels.
    """
    pieces, groups = [], []
    known, unknown = (
        _constants(aircraft, loads),
        _unknown(aircraft, loads, all(has_angle(record) for record in records)),
    )
    sim = flightmech.compile(aircraft, database)
    for k, record in enumerate(records):
        parts = turning_stretches(states_of(record), loads.loads[k])
        pieces += [RollingStretch(sim, part, aircraft, loads.inputs_of(k), known) for part in parts]
        groups += [k] * len(parts)
    if not pieces or not unknown:
        return None
    layout = lay_out(unknown, [{} for _ in pieces])
    for piece in pieces:
        piece.names = layout.names
    found = maximise_likelihood(Likelihood(pieces, layout, np.array(groups)), _ITERATIONS)
    covariance, colours = coloured_likelihood_covariance(
        found, layout.columns, [piece.interval for piece in pieces]
    )
    estimates = estimates_dataset(
        found, layout, covariance, {"method": "output error on the gear of the kernel"}
    )
    rest = tuple(
        xr.Dataset(
            {name: ("time", v[:, k]) for k, name in enumerate(piece.outputs)}, {"time": piece.time}
        )
        for piece, v in zip(pieces, found.residuals)
    )
    return OutputError(
        estimates,
        rest,
        noise_dataset(found, pieces[0].outputs, colours, [piece.measured for piece in pieces]),
    )


def has_angle(record) -> bool:
    """Return whether command and angle of the nose wheel are both recorded."""
    return {"gear.steering", "delta_nw"} <= set(map(str, states_of(record).data_vars))


def _constants(aircraft: Aircraft, loads: LoadFit) -> dict[str, float]:
    """Constants of tyres and steering at the start."""
    assert aircraft.gear is not None
    wheels = {wheel.name: wheel for wheel in wheels_of(aircraft)}
    at = {**loads.held, **loads.fit.parameters}
    found = {
        FRICTION: at[FRICTION],
        "steering.trail": 0.0,
    }  # one recorded angle is that of the wheel
    for group in wheel_groups(aircraft):
        found |= {
            group.parameter(name): at[group.parameter(name)] for name in ("cornering", "bend")
        }
        found[group.parameter("side_stiffness")] = wheels[group.names[0]].side_stiffness
    return found


def _unknown(aircraft: Aircraft, loads: LoadFit, angle: bool) -> dict[str, Unknown]:
    """What is estimated: the side force the regression determined, friction, the steering where
    command and angle are recorded.
    """
    assert aircraft.gear is not None
    start, determined = _constants(aircraft, loads), loads.fit.parameters
    ranges = {FRICTION: (0.02, 3.0)} if FRICTION in determined else {}
    for group in wheel_groups(aircraft):
        own = {group.parameter(name): bounds for name, bounds in _BOUNDS.items()}
        if group.parameter("cornering") in determined:
            ranges |= {
                name: bounds
                for name, bounds in own.items()
                if name in determined or name.endswith("side_stiffness")
            }
    found = {
        name: Unknown(float(np.clip(start[name], *bounds)), low=bounds[0], high=bounds[1])
        for name, bounds in ranges.items()
    }
    for name in (
        name for name in found if name.endswith("side_stiffness")
    ):  # known to its size: above some speed nothing shows it
        found[name] = found[name]._replace(sigma=start[name])
    if angle:
        steering = aircraft.gear.steering
        for name in STEERING[: {0: 1, 2: 3, 4: 6}[steering.order]]:
            low = _FASTEST.get(name, 0.0) * steering.stiffness if name != "trail" else -1.0
            found[f"steering.{name}"] = Unknown(max(float(getattr(steering, name)), low), low=low)
    return found
