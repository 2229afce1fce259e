"""The linear model of a compiled aircraft about a steady flight, by central differences of the
derivative that flies.

States and inputs are moved one at a time, everything else is held, and the kernel gives the rates.
A step of eps^(1/3) of the size of a variable (6e-6 rad, 6e-6 of the speed) balances what is cut
off, h^2 f'''/6, against what is rounded off, eps f / h: both stay near 1e-10 of the entry.  A
second pass with half the step gives ``error``, so that the reader sees it.

In addition to the rigid body any state of the submodels can be chosen: thrust and spools of the
engines, fuel, tyres.  What is not chosen follows at once where the start of a run settles it
(engines) and stands still otherwise (fuel, landing gear).  Control circuits with friction are no
states: the surfaces are held where the trim left them.

The tables are piecewise linear: the slope is that of the cell the flight is in.  On a breakpoint,
where it jumps, the mean of both sides comes out and attribute ``kinks`` states for which variable.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flightmech.names import quantity_attributes
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import OUTPUT, PARAMETER, STATE, Simulation
from flightmech.simulation.run import constant_inputs, initialise_run
from flightmech.steady_flight.trim_request import DRIVES, RIGID
from flightmech.steady_flight.trim_search import default_trim_mode
from flightmech.units import G0

LONGITUDINAL = ("V", "alpha", "q", "theta", "h")
LATERAL = ("beta", "p", "r", "phi", "psi")
STATES = ("V", "alpha", "q", "theta", "beta", "p", "r", "phi")
OUTPUTS = ("nz", "ay", "gamma")
_ALLOWED = (*LONGITUDINAL, *LATERAL)
_LATERAL_INPUTS = ("delta_a", "delta_r", "delta_ta", "delta_tr")
_LATERAL_OUTPUTS = (*LATERAL, "ay", "v", "p_dot", "r_dot", "beta_dot", "CY", "Cl", "Cn")
_FOUND = ("delta_e", "delta_a", "delta_r", "thrust", "throttle")  # biases that a trim finds
_STEP = float(np.finfo(float).eps ** (1.0 / 3.0))
_HEIGHT = 1e4  # over which the air changes by its own size [m]
_TYRE = 0.1  # deflection of a tyre [m]
_HOT = 1e3  # turbine temperature [K]
_CIRCUITS = ("column", "wheel", "pedal")
_SURFACES = ("delta_e", "delta_a", "delta_r")
# of the largest entry of a row: smallest difference of one-sided slopes that counts as a kink
_JUMP = 1e-6
_NOISE = 0.1  # of the size of a rate, per size of a variable: slopes below it are rounding


class _Plant(NamedTuple):
    """A trimmed simulation and the point about which it is moved."""

    sim: SimModel
    run: Simulation
    states: tuple[str, ...]
    x: np.ndarray
    u: np.ndarray
    trimmed: dict[str, float]
    places: dict[str, tuple[int, str]]
    state: np.ndarray


def linearize(
    sim: SimModel,
    parameters: Mapping[str, float] | None = None,
    states: Sequence[str] = STATES,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] = OUTPUTS,
    steps: Mapping[str, float] | None = None,
) -> xr.Dataset:
    """Return the linear model about a trimmed flight over a flat Earth.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    parameters : mapping of str to float, optional
        Condition, as in `trim` without a kind: ``{"init.V": 90.0, "init.h": 1500.0, "delta_f":
        0.6}``; ``mode.trim`` 0 takes the state of ``init.*`` as it is, so that `start_of` of a
        trimmed turn or climb gives the linear model about it. [SI]
    states : sequence of str
        Any of ``V alpha q theta h beta p r phi psi``; a state left out is held.  Also any state of
        the submodels, by its name without ``state.``: ``engine1.thrust engine1.n1 fuel`` ...;
        without those of the engines thrust follows speed, height and throttle at once.
    inputs : sequence of str, optional
        Inputs of the model; elevator, aileron, rudder and what drives the engines unless given.
        The wind is a steady one: a gust is a jump of ``alpha`` or ``beta``.
    outputs : sequence of str
        Outputs of the model.
    steps : mapping of str to float, optional
        Steps of single states or inputs instead of the derived ones [SI]: a step of the size of a
        manoeuvre averages the cells of the tables that the manoeuvre crosses.

    Returns
    -------
    Dataset
        ``A (state, state_)``, ``B (state, input)``, ``C (output, state_)``, ``D (output, input)``:
        rate of the state = A dx + B du, output = C dx + D du.  ``x``, ``u``, ``y`` is the point,
        ``x_dot`` what remains after the trim; ``A_error`` ... ``D_error`` the change of each entry
        with half the step; ``state_units`` ... the units [SI].  Attributes ``title``,
        ``condition``, ``kinks``, ``left_out`` (states of the submodels that were not chosen),
        ``held`` (what is no state: control circuits).

    Raises
    ------
    UnknownName
        A state, input, output or parameter that the model does not have.
    SchemaError
        A rotating Earth is requested, or a step that is not positive.
    SimulationError
        The condition has no meaning.
    """
    chosen = tuple(_default_inputs(sim, parameters or {}) if inputs is None else inputs)
    _demand(states, (*_ALLOWED, *_submodel_states(sim)), "state")
    _demand(chosen, sim.inputs, "input")
    _demand(outputs, sim.outputs, "output")
    _demand(steps or {}, (*states, *chosen), "state or input")
    plant = _plant(sim, dict(parameters or {}), tuple(states))
    sizes = np.array(
        [*(_size(plant, name) for name in states), *(_input_size(plant, name) for name in chosen)]
    )
    given = np.array([(steps or {}).get(name, np.nan) for name in (*states, *chosen)])
    if (given <= 0.0).any():
        raise SchemaError(
            "steps",
            [
                f"{name} is {step!r}; give a positive step"
                for name, step in (steps or {}).items()
                if not step > 0.0
            ],
        )
    h = np.where(np.isnan(given), _STEP * sizes, given)
    columns = [*range(len(states)), *(len(states) + sim.inputs.index(name) for name in chosen)]
    jacobian, error, kinks = _differences(plant, outputs, columns, h, sizes)
    names = np.array([*states, *chosen])
    return _dataset(plant, chosen, tuple(outputs), jacobian, error, " ".join(names[kinks]))


def subset(linear: xr.Dataset, which: str) -> xr.Dataset:
    """Return the longitudinal or the lateral-directional part of a linear model; the cross-coupling
    is left out.

    Parameters
    ----------
    linear : Dataset
        As from `linearize`.
    which : {"longitudinal", "lateral"}
        Engines are longitudinal.

    Returns
    -------
    Dataset
        Of the same form.  Attribute ``coupling`` is the largest entry of A that was cut away, as a
        part of the largest natural frequency, states scaled to equal speeds; zero in a symmetric
        flight of a symmetric aircraft.
    """
    if which not in ("longitudinal", "lateral"):
        raise ValueError(f"which is {which!r}; allowed: longitudinal, lateral")
    lateral = which == "lateral"
    states = [str(name) for name in linear["state"].values if (name in LATERAL) == lateral]
    inputs = [str(name) for name in linear["input"].values if (name in _LATERAL_INPUTS) == lateral]
    outputs = [
        str(name) for name in linear["output"].values if (name in _LATERAL_OUTPUTS) == lateral
    ]
    part = linear.sel(state=states, state_=states, input=inputs, output=outputs)
    return part.assign_attrs(coupling=_coupling(linear, states))


def _coupling(linear: xr.Dataset, states: Sequence[str]) -> float:
    names, units = (
        [str(item) for item in linear[column].values] for column in ("state", "state_units")
    )
    V, weight = linear.attrs["V"], linear.attrs["weight"]
    size = np.array(
        [
            V if name in ("V", "h") else _submodel_size(unit, weight)
            for name, unit in zip(names, units, strict=True)
        ]
    )
    A = linear["A"].values / size[:, None] * size[None, :]
    inside = np.isin(names, states)
    cut = np.abs(A[np.ix_(inside, ~inside)]).max(initial=0.0)
    return float(cut / max(np.abs(np.linalg.eigvals(A)).max(initial=0.0), np.finfo(float).tiny))


def _demand(names: Iterable[str], allowed: Sequence[str], what: str) -> None:
    for name in names:
        if name not in allowed:
            raise UnknownName(name, allowed, what)


def _submodel_states(sim: SimModel) -> dict[str, tuple[int, str]]:
    """Return place and units of the states other than those of the rigid body, by their names
    without ``state.``.
    """
    rows = enumerate(sim.entries(STATE))
    return {row.name.removeprefix("state."): (i, row.units) for i, row in rows if i >= RIGID}


def _mode(sim: SimModel, parameters: Mapping[str, float], name: str) -> float:
    return float(
        parameters.get(name, next(row.value for row in sim.entries(PARAMETER) if row.name == name))
    )


def _default_inputs(sim: SimModel, parameters: Mapping[str, float]) -> list[str]:
    drive = DRIVES.get(_mode(sim, parameters, "mode.engine"), "throttle")
    return [
        *_SURFACES,
        *(name for name in sim.inputs if name.startswith("engine") and name.endswith(f".{drive}")),
    ]


def _plant(sim: SimModel, parameters: dict[str, float], states: tuple[str, ...]) -> _Plant:
    """Trim, and freeze what was found as biases, so that every later start of the kernel is at a
    state we choose.
    """
    if parameters.setdefault("mode.earth", 0.0) != 0.0:
        earth = f"mode.earth is {parameters['mode.earth']:g}"
        raise SchemaError(
            "linear model",
            [
                f"{earth}; a linear model is about a steady flight over a flat Earth, leave "
                f"it out or give 0"
            ],
        )
    places = _submodel_states(sim)
    if not any(name in states for name in places if name.endswith(".thrust")):
        parameters |= {name: 0.0 for name in sim.parameters if name.endswith(".time_constant")}
    start = {"mode.trim": default_trim_mode(sim, parameters), **parameters}
    run = initialise_run(sim, start, constant_inputs(sim, start))
    trimmed, state = dict(zip(sim.outputs, map(float, run.outputs()), strict=True)), run.state
    values = {**parameters, "mode.trim": 0.0, "mode.controls": 0.0}
    values |= {f"init.{name}": trimmed[name] for name in _ALLOWED}
    for name in _FOUND:
        values[f"bias.{name}"] = _mode(sim, parameters, f"bias.{name}") + trimmed[f"trim.{name}"]
    values |= {name: trimmed[f"applied.{name}"] - values[f"bias.{name}"] for name in _SURFACES}
    u = constant_inputs(sim, values)
    x = np.array([state[places[name][0]] if name in places else trimmed[name] for name in states])
    return _Plant(sim, initialise_run(sim, values, u), states, x, u, trimmed, places, state)


def _rates(plant: _Plant, x: np.ndarray, u: np.ndarray, outputs: Sequence[str]) -> np.ndarray:
    """Return the rates of the states and the outputs at a state and an input."""
    sim, run, places = plant.sim, plant.run, plant.places
    point = dict(zip(plant.states, map(float, x), strict=True))
    for name in point.keys() - places.keys():
        run.set_parameter(sim.parameters.index(f"init.{name}"), point[name])
    run.set_inputs(u)
    run.initialize()
    state = run.state
    for name, (at, _) in places.items():
        state[at] = (
            point[name]
            if name in point
            else plant.state[at]
            if name.startswith("gear.")
            else state[at]
        )
    run.state = state
    y = dict(zip(sim.outputs, run.outputs(), strict=True))
    slopes = run.derivative(state, u)
    return np.array(
        [
            *(slopes[places[name][0]] if name in places else _rate(y, name) for name in point),
            *(y[name] for name in outputs),
        ]
    )


def _rate(y: Mapping[str, float], state: str) -> float:
    sf, cf, st, ct = np.sin(y["phi"]), np.cos(y["phi"]), np.sin(y["theta"]), np.cos(y["theta"])
    if state == "V":
        force = y["u"] * y["ax"] + y["v"] * y["ay"] + y["w"] * y["az"]
        return (force + G0 * (-y["u"] * st + y["v"] * ct * sf + y["w"] * ct * cf)) / y["V"]
    if state == "h":
        return y["hdot"]
    if state == "theta":
        return y["q"] * cf - y["r"] * sf
    turn = (y["q"] * sf + y["r"] * cf) / ct
    return (
        {"psi": turn, "phi": y["p"] + turn * st}[state]
        if state in ("phi", "psi")
        else y[f"{state}_dot"]
    )


def _size(plant: _Plant, name: str) -> float:
    """Return the size of a state: over which the rates change by their own size."""
    if name in plant.places:
        return _submodel_size(plant.places[name][1], _weight(plant))
    return plant.trimmed["V"] if name == "V" else _HEIGHT if name == "h" else 1.0


def _submodel_size(units: str, weight: float) -> float:
    return {"N": weight, "kg": weight / G0, "K": _HOT, "m": _TYRE}.get(units, 1.0)


def _input_size(plant: _Plant, name: str) -> float:
    return (
        plant.trimmed["V"]
        if name.startswith("wind")
        else _weight(plant)
        if name.endswith(".thrust_drive")
        else 1.0
    )


def _weight(plant: _Plant) -> float:
    return plant.run.parameter(plant.sim.parameters.index("mass.mass")) * G0


def _differences(
    plant: _Plant, outputs: Sequence[str], columns: Sequence[int], h: np.ndarray, sizes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the Jacobian, its change with half the step, and which columns have one-sided slopes
    that differ.
    """
    nx, z = len(plant.x), np.concatenate([plant.x, plant.u])

    def at(column: int, step: float) -> np.ndarray:
        moved = z.copy()
        moved[column] += step
        return _rates(plant, moved[:nx], moved[nx:], outputs)

    middle = at(0, 0.0)
    whole, half, jump, half_jump = (np.empty((len(middle), len(columns))) for _ in range(4))
    for k, (column, step) in enumerate(zip(columns, h, strict=True)):
        for slope, bend, size in ((whole, jump, step), (half, half_jump, step / 2.0)):
            up, down = at(column, size), at(column, -size)
            slope[:, k] = (up - down) / (2.0 * size)
            bend[:, k] = np.abs(up - 2.0 * middle + down) / size
    # the jump of a smooth function halves with the step, that of a kink stays
    largest = np.abs(whole * sizes).max(axis=1) + _NOISE * np.maximum(np.abs(middle), 1.0)
    large = half_jump * sizes > _JUMP * largest[:, None]
    return whole, np.abs(whole - half), (large & (half_jump > 0.75 * jump)).any(axis=0)


def _dataset(
    plant: _Plant,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    J: np.ndarray,
    error: np.ndarray,
    kinks: str,
) -> xr.Dataset:
    nx = len(plant.states)
    blocks = {
        "A": (slice(nx), slice(nx)),
        "B": (slice(nx), slice(nx, None)),
        "C": (slice(nx, None), slice(nx)),
    }
    blocks["D"] = (slice(nx, None), slice(nx, None))
    dims = {
        "A": ("state", "state_"),
        "B": ("state", "input"),
        "C": ("output", "state_"),
        "D": ("output", "input"),
    }
    data: dict[str, tuple] = {name: (dims[name], J[block]) for name, block in blocks.items()}
    data |= {f"{name}_error": (dims[name], error[block]) for name, block in blocks.items()}
    y = plant.trimmed
    units = {row.name: row.units for row in plant.sim.entries(OUTPUT)}
    data["x"] = "state", plant.x
    data["x_dot"] = "state", _rates(plant, plant.x, plant.u, ())
    data["u"] = "input", np.array([_applied(plant, name) for name in inputs])
    data["y"] = "output", np.array([y[name] for name in outputs])
    data["state_units"] = (
        "state",
        np.array(
            [
                plant.places[name][1]
                if name in plant.places
                else quantity_attributes(name)["units"]
                for name in plant.states
            ],
            object,
        ),
    )
    data["input_units"] = (
        "input",
        np.array([quantity_attributes(_quantity(name))["units"] for name in inputs], object),
    )
    data["output_units"] = "output", np.array([units[name] for name in outputs], object)
    coords = {
        "state": list(plant.states),
        "state_": list(plant.states),
        "input": list(inputs),
        "output": list(outputs),
    }
    condition = (
        f"V {y['V']:.6g} m/s, h {y['h']:.6g} m, alpha {np.degrees(y['alpha']):.4g} deg, "
        f"gamma {np.degrees(y['gamma']):.4g} deg"
    )
    numbers = {"V": y["V"], "weight": _weight(plant)}
    left_out = " ".join(name for name in plant.places if name not in plant.states)
    texts = {
        "title": plant.sim.title,
        "condition": condition,
        "kinks": kinks,
        "left_out": left_out,
        "held": _held(plant),
    }
    return xr.Dataset(data, coords, attrs={**texts, **numbers})


def _held(plant: _Plant) -> str:
    circuits = [name for name in _CIRCUITS if f"{name}.mass" in plant.sim.parameters]
    return (
        f"control circuits of {', '.join(circuits)}: surfaces held where the trim left them"
        if circuits
        else ""
    )


def _applied(plant: _Plant, name: str) -> float:
    """Return an input as it acts: what was given, and what the trim found."""
    if f"applied.{name}" in plant.sim.outputs:
        return plant.trimmed[f"applied.{name}"]
    kind = _quantity(name).rpartition(".")[2]
    bias = (
        plant.run.parameter(plant.sim.parameters.index(f"bias.{kind}")) if kind in _FOUND else 0.0
    )
    return float(plant.u[plant.sim.inputs.index(name)]) + bias


def _quantity(name: str) -> str:
    return name.removesuffix("_drive")
