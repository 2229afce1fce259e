"""A trimmed simulation whose rates are computed at any state and input near the trim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from flightmech.errors import SchemaError
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import PARAMETER, STATE, Simulation
from flightmech.simulation.run import constant_inputs, initialise_run
from flightmech.steady_flight.trim_request import RIGID
from flightmech.steady_flight.trim_search import default_trim_mode
from flightmech.units import G0

RIGID_STATES = ("V", "alpha", "q", "theta", "h", "beta", "p", "r", "phi", "psi")
SURFACES = ("delta_e", "delta_a", "delta_r")
BIASES = (*SURFACES, "thrust", "throttle")  # biases on the inputs that a trim computes


class SubmodelState(NamedTuple):
    """Position of a state in the state vector of the kernel, and its units."""

    position: int
    units: str


class Plant(NamedTuple):
    """A trimmed simulation and its point.

    `x` (state,) and `u` (input,) are the point, `trimmed` all outputs there. `submodels` holds the
    states that are not of the rigid body. `state` is the full state vector of the kernel. [SI]
    """

    sim: SimModel
    run: Simulation
    states: tuple[str, ...]
    x: np.ndarray
    u: np.ndarray
    trimmed: dict[str, float]
    submodels: dict[str, SubmodelState]
    state: np.ndarray

    @property
    def weight(self) -> float:
        """Weight. [N]"""
        return self.run.parameter(self.sim.parameters.index("mass.mass")) * G0

    def rates(self, x: np.ndarray, u: np.ndarray, outputs: Sequence[str]) -> np.ndarray:
        """Return the rates of the states, then the outputs, at a state and an input."""
        state_values = dict(zip(self.states, map(float, x), strict=True))
        for name in state_values.keys() - self.submodels.keys():
            self.run.set_parameter(self.sim.parameters.index(f"init.{name}"), state_values[name])
        self.run.set_inputs(u)
        self.run.initialize()

        # The start of a run computes steady engines. Chosen states replace their steady values,
        # and the landing gear stays as it was in the trim.
        state = self.run.state
        for name, entry in self.submodels.items():
            if name in state_values:
                state[entry.position] = state_values[name]
            elif name.startswith("gear."):
                state[entry.position] = self.state[entry.position]
        self.run.state = state

        y = dict(zip(self.sim.outputs, self.run.outputs(), strict=True))
        derivative = self.run.derivative(state, u)
        values = []
        for name in state_values:
            if name in self.submodels:
                values.append(derivative[self.submodels[name].position])
            else:
                values.append(_rigid_body_rate(y, name))
        values += [y[name] for name in outputs]
        return np.array(values)


def submodel_states(sim: SimModel) -> dict[str, SubmodelState]:
    """Return the states that are not of the rigid body, by their names without ``state.``."""
    states = {}
    for index, row in enumerate(sim.entries(STATE)):
        if index >= RIGID:
            states[row.name.removeprefix("state.")] = SubmodelState(index, row.units)
    return states


def parameter_value(sim: SimModel, parameters: Mapping[str, float], name: str) -> float:
    """Return the value of a parameter, or its default in the compiled model."""
    if name in parameters:
        return float(parameters[name])
    return float(next(row.value for row in sim.entries(PARAMETER) if row.name == name))


def trim_plant(sim: SimModel, parameters: dict[str, float], states: tuple[str, ...]) -> Plant:
    """Trim, and store the result as biases, so that the kernel can start at any state near it.

    Raises
    ------
    SchemaError
        The parameters select a rotating Earth.
    """
    if parameters.setdefault("mode.earth", 0.0) != 0.0:
        raise SchemaError(
            "linear model",
            [
                f"mode.earth is {parameters['mode.earth']:g}; a linear model is about a steady "
                f"flight over a flat Earth, leave it out or give 0"
            ],
        )
    submodels = submodel_states(sim)
    # Without a thrust state the thrust follows the throttle at once: no lag.
    if not any(name.endswith(".thrust") and name in states for name in submodels):
        for name in sim.parameters:
            if name.endswith(".time_constant"):
                parameters[name] = 0.0

    start = {"mode.trim": default_trim_mode(sim, parameters), **parameters}
    run = initialise_run(sim, start, constant_inputs(sim, start))
    trimmed = dict(zip(sim.outputs, map(float, run.outputs()), strict=True))
    state = run.state

    # The second start does not trim: state, biases and surfaces come from the first one.
    values = {**parameters, "mode.trim": 0.0, "mode.controls": 0.0}
    for name in RIGID_STATES:
        values[f"init.{name}"] = trimmed[name]
    for name in BIASES:
        bias = f"bias.{name}"
        values[bias] = parameter_value(sim, parameters, bias) + trimmed[f"trim.{name}"]
    for name in SURFACES:
        values[name] = trimmed[f"applied.{name}"] - values[f"bias.{name}"]
    u = constant_inputs(sim, values)
    x = []
    for name in states:
        if name in submodels:
            x.append(state[submodels[name].position])
        else:
            x.append(trimmed[name])
    run = initialise_run(sim, values, u)
    return Plant(
        sim, run, states, x=np.array(x), u=u, trimmed=trimmed, submodels=submodels, state=state
    )


def _rigid_body_rate(y: Mapping[str, float], state: str) -> float:
    """Return the rate of one rigid-body state from the outputs of the kernel."""
    sf, cf = np.sin(y["phi"]), np.cos(y["phi"])
    st, ct = np.sin(y["theta"]), np.cos(y["theta"])
    if state == "V":
        # V V_dot = velocity . (specific force + gravity), body axes
        force = y["u"] * y["ax"] + y["v"] * y["ay"] + y["w"] * y["az"]
        return (force + G0 * (-y["u"] * st + y["v"] * ct * sf + y["w"] * ct * cf)) / y["V"]
    if state == "h":
        return y["hdot"]
    # Euler angles: theta_dot = q cos(phi) - r sin(phi), psi_dot = (q sin(phi) + r cos(phi)) /
    # cos(theta), phi_dot = p + psi_dot sin(theta)
    if state == "theta":
        return y["q"] * cf - y["r"] * sf
    turn = (y["q"] * sf + y["r"] * cf) / ct
    if state == "psi":
        return turn
    if state == "phi":
        return y["p"] + turn * st
    return y[f"{state}_dot"]
