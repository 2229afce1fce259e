"""The linear model of a compiled aircraft about a steady flight.

Central differences of the derivative of the simulation give the matrices.  States and inputs change
one at a time, all others are constant, and the kernel returns the rates.  A step of eps^(1/3) of
the size of a variable (6e-6 rad, 6e-6 of the speed) balances the truncation error h^2 f'''/6
against the rounding error eps f / h.  Both stay near 1e-10 of the entry.  A second pass with half
the step gives ``error``.

In addition to the rigid body, any state of the submodels may be chosen: thrust and spools of the
engines, fuel, tyres.  A state that is not chosen takes its steady value at once, if the start of a
run computes it (engines).  Otherwise it is constant (fuel, landing gear).  Control circuits with
friction are not states: the surfaces are constant at their trimmed positions.

The tables are piecewise linear: the slope is that of the cell of the flight.  On a breakpoint,
where the slope jumps, the result is the mean of both sides, and attribute ``kinks`` names the
variable.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flightmech.names import quantity_attributes
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import OUTPUT
from flightmech.simulation.run import Stated, values_in_si
from flightmech.steady_flight.linear_plant import (
    BIASES,
    RIGID_STATES,
    SURFACES,
    Plant,
    parameter_value,
    submodel_states,
    trim_plant,
)
from flightmech.steady_flight.stated_speeds.odd_speeds import warn_of_odd_flight
from flightmech.steady_flight.trim_kinds import DRIVES
from flightmech.units import G0

STATES = ("V", "alpha", "q", "theta", "beta", "p", "r", "phi")
OUTPUTS = ("nz", "ay", "gamma")
LONGITUDINAL = ("V", "alpha", "q", "theta", "h")
LATERAL = ("beta", "p", "r", "phi", "psi")
_LATERAL_INPUTS = ("delta_a", "delta_r", "delta_ta", "delta_tr")
_LATERAL_OUTPUTS = (*LATERAL, "ay", "v", "p_dot", "r_dot", "beta_dot", "CY", "Cl", "Cn")
_STEP = float(np.finfo(float).eps ** (1.0 / 3.0))  # of the size of a variable
_AIR_SCALE = 1e4  # height over which the density of the air changes by its own size [m]
# sizes of states and inputs of submodels
_TYRE_SIZE = 0.1  # deflection of a tyre [m]
_TURBINE_SIZE = 1e3  # turbine temperature [K]
_CIRCUITS = ("column", "wheel", "pedal")
# Smallest difference of one-sided slopes that counts as a kink, of the largest entry of a row.
_KINK = 1e-6
# Slope that is rounding, of the size of a rate, per size of a variable.
_ROUNDING_SLOPE = 0.1
# The difference of one-sided slopes with half the step, in terms of that with the full step, is
# 0.5 for a smooth function and 1 for a kink.
_KINK_RATIO = 0.75
# Dimensions of the matrices.
_DIMENSIONS = {
    "A": ("state", "state_"),
    "B": ("state", "input"),
    "C": ("output", "state_"),
    "D": ("output", "input"),
}


class _Jacobian(NamedTuple):
    """Slopes (rate or output, column), their changes with half the step, and a flag per column."""

    slopes: np.ndarray
    errors: np.ndarray
    kinks: np.ndarray


def linearize(
    sim: SimModel,
    parameters: Mapping[str, Stated] | None = None,
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
        0.6}``. With ``mode.trim`` 0 the flight starts in the state of ``init.*``, so that
        `start_of` of a trimmed turn or climb gives the linear model about it. A text has its unit.
    states : sequence of str
        Any of ``V alpha q theta h beta p r phi psi``. Other rigid-body states are constant. Also
        any state of the submodels, by its name without ``state.``: ``engine1.thrust engine1.n1
        fuel`` ... Without states of the engines, thrust follows speed, height and throttle at
        once.
    inputs : sequence of str, optional
        Inputs of the model. Default: elevator, aileron, rudder and the inputs that drive the
        engines. The wind is a steady wind: a gust is a jump of ``alpha`` or ``beta``.
    outputs : sequence of str
        Outputs of the model.
    steps : mapping of str to float, optional
        Steps of single states or inputs in place of the computed steps [SI]. A step of the size of
        a manoeuvre averages the cells of the tables that the manoeuvre crosses.

    Returns
    -------
    Dataset
        ``A (state, state_)``, ``B (state, input)``, ``C (output, state_)``, ``D (output, input)``:
        rate of the state = A dx + B du, output = C dx + D du.  ``x``, ``u``, ``y`` is the point,
        ``x_dot`` the remaining rate after the trim.  ``A_error`` ... ``D_error`` is the change of
        each entry with half the step.  ``state_units`` ... are the units [SI].  Attributes
        ``title``, ``condition``, ``kinks``, ``left_out`` (states of the submodels that were not
        chosen), ``held`` (control circuits, which are not states).

    Raises
    ------
    UnknownName
        A state, input, output or parameter that the model does not have.
    SchemaError
        A rotating Earth, or a step that is not positive.
    SimulationError
        The condition has no meaning.
    """
    stated = dict(values_in_si(sim, parameters))
    warn_of_odd_flight(sim, stated)
    steps = dict(steps or {})
    if inputs is None:
        inputs = _default_inputs(sim, stated)
    _check_names(sim, states, inputs, outputs=outputs, steps=steps)
    plant = trim_plant(sim, stated, tuple(states))
    jacobian = _compute_jacobian(plant, inputs, outputs, steps=steps)
    return _make_dataset(plant, tuple(inputs), tuple(outputs), jacobian=jacobian)


def _compute_jacobian(
    plant: Plant, inputs: Sequence[str], outputs: Sequence[str], steps: Mapping[str, float]
) -> _Jacobian:
    """Return the slopes of rates and outputs over all states and some inputs."""
    names = (*plant.states, *inputs)
    sizes = [_state_size(plant, name) for name in plant.states]
    sizes += [_input_size(plant, name) for name in inputs]
    increments = _difference_steps(steps, names, np.array(sizes))
    # Columns of the point (x, u) that change: all states, and the chosen inputs among all inputs.
    state_count = len(plant.states)
    columns = list(range(state_count))
    columns += [state_count + plant.sim.inputs.index(name) for name in inputs]
    return _differentiate(plant, outputs, columns, steps=increments, sizes=np.array(sizes))


def _difference_steps(
    steps: Mapping[str, float], names: Sequence[str], sizes: np.ndarray
) -> np.ndarray:
    """Return the step of each variable: the requested one, or one from its size."""
    requested = np.array([steps.get(name, np.nan) for name in names])
    if (requested <= 0.0).any():
        raise SchemaError(
            "steps",
            [
                f"{name} is {step!r}; give a positive step"
                for name, step in steps.items()
                if not step > 0.0
            ],
        )
    return np.where(np.isnan(requested), _STEP * sizes, requested)


def subset(linear: xr.Dataset, which: str) -> xr.Dataset:
    """Return the longitudinal or the lateral-directional part of a linear model.

    The part does not contain the cross-coupling.

    Parameters
    ----------
    linear : Dataset
        As from `linearize`.
    which : {"longitudinal", "lateral"}
        Engines are longitudinal.

    Returns
    -------
    Dataset
        Of the same form.  Attribute ``coupling`` is the largest neglected entry of A, divided by
        the largest natural frequency, with states scaled to equal speeds.  It is zero in a
        symmetric flight of a symmetric aircraft.
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
    """Return the largest entry of A outside a set of states over the largest eigenvalue."""
    names = [str(name) for name in linear["state"].values]
    units = [str(unit) for unit in linear["state_units"].values]
    sizes = []
    for name, unit in zip(names, units, strict=True):
        if name in ("V", "h"):
            sizes.append(linear.attrs["V"])
        else:
            sizes.append(_submodel_size(unit, linear.attrs["weight"]))
    size = np.array(sizes)
    # scaled states x / size: every entry of A is then a rate in 1/s
    A = linear["A"].values / size[:, None] * size[None, :]
    inside = np.isin(names, states)
    neglected = np.abs(A[np.ix_(inside, ~inside)]).max(initial=0.0)
    fastest = np.abs(np.linalg.eigvals(A)).max(initial=0.0)
    return float(neglected / max(fastest, np.finfo(float).tiny))


def _check_names(
    sim: SimModel,
    states: Sequence[str],
    inputs: Sequence[str],
    *,
    outputs: Sequence[str],
    steps: Iterable[str],
) -> None:
    """Raise UnknownName for the first name that the model does not have."""
    _require_names(states, (*RIGID_STATES, *submodel_states(sim)), "state")
    _require_names(inputs, sim.inputs, "input")
    _require_names(outputs, sim.outputs, "output")
    _require_names(steps, (*states, *inputs), "state or input")


def _require_names(names: Iterable[str], allowed: Sequence[str], what: str) -> None:
    for name in names:
        if name not in allowed:
            raise UnknownName(name, allowed, what)


def _default_inputs(sim: SimModel, parameters: Mapping[str, float]) -> list[str]:
    """Return the surfaces and the inputs that drive the engines."""
    mode = parameter_value(sim, parameters, "mode.engine")
    drive = DRIVES.get(mode, "throttle")
    inputs = list(SURFACES)
    for name in sim.inputs:
        if name.startswith("engine") and name.endswith(f".{drive}"):
            inputs.append(name)
    return inputs


def _state_size(plant: Plant, name: str) -> float:
    """Return the size of a state: the change over which the rates change by their own size."""
    if name in plant.submodels:
        return _submodel_size(plant.submodels[name].units, plant.weight)
    return {"V": plant.trimmed["V"], "h": _AIR_SCALE}.get(name, 1.0)


def _submodel_size(units: str, weight: float) -> float:
    sizes = {"N": weight, "kg": weight / G0, "K": _TURBINE_SIZE, "m": _TYRE_SIZE}
    return sizes.get(units, 1.0)


def _input_size(plant: Plant, name: str) -> float:
    if name.startswith("wind"):
        return plant.trimmed["V"]
    if name.endswith(".thrust_drive"):
        return plant.weight
    if name.endswith((".torque_drive", ".rpm_drive", ".manifold_pressure_drive")):
        return max(abs(plant.trimmed[name.removesuffix("_drive")]), 1.0)
    return 1.0


def _differentiate(
    plant: Plant,
    outputs: Sequence[str],
    columns: Sequence[int],
    *,
    steps: np.ndarray,
    sizes: np.ndarray,
) -> _Jacobian:
    """Return the central differences of rates and outputs with respect to some columns of (x, u).

    A column has a kink if its one-sided slopes differ.
    """
    state_count = len(plant.x)
    point = np.concatenate([plant.x, plant.u])

    def rates_at(column: int, increment: float) -> np.ndarray:
        changed = point.copy()
        changed[column] += increment
        return plant.rates(changed[:state_count], changed[state_count:], outputs)

    middle = rates_at(0, 0.0)
    shape = (len(middle), len(columns))
    # index 0: the full step, index 1: half the step
    slopes = np.empty((2, *shape))
    differences = np.empty((2, *shape))
    for k, (column, step) in enumerate(zip(columns, steps, strict=True)):
        for pass_number, size in enumerate((step, step / 2.0)):
            upper = rates_at(column, size)
            lower = rates_at(column, -size)
            slopes[pass_number, :, k] = (upper - lower) / (2.0 * size)
            # slope above the point minus the slope below it
            differences[pass_number, :, k] = np.abs(upper - 2.0 * middle + lower) / size

    # The difference of a smooth function halves with the step, that of a kink does not change.
    largest = np.abs(slopes[0] * sizes).max(axis=1)
    largest = largest + _ROUNDING_SLOPE * np.maximum(np.abs(middle), 1.0)
    large = differences[1] * sizes > _KINK * largest[:, None]
    constant = differences[1] > _KINK_RATIO * differences[0]
    return _Jacobian(slopes[0], np.abs(slopes[0] - slopes[1]), (large & constant).any(axis=0))


def _make_dataset(
    plant: Plant, inputs: tuple[str, ...], outputs: tuple[str, ...], jacobian: _Jacobian
) -> xr.Dataset:
    """Return the matrices, the point and the units as a dataset."""
    # rows: rates of the states, then outputs; columns: states, then inputs
    first, last = slice(len(plant.states)), slice(len(plant.states), None)
    blocks = {"A": (first, first), "B": (first, last), "C": (last, first), "D": (last, last)}
    data: dict[str, tuple[Any, ...]] = {}
    for name, block in blocks.items():
        data[name] = _DIMENSIONS[name], jacobian.slopes[block]
    for name, block in blocks.items():
        data[f"{name}_error"] = _DIMENSIONS[name], jacobian.errors[block]

    trimmed = plant.trimmed
    data["x"] = "state", plant.x
    data["x_dot"] = "state", plant.rates(plant.x, plant.u, ())
    data["u"] = "input", np.array([_applied_input(plant, name) for name in inputs])
    data["y"] = "output", np.array([trimmed[name] for name in outputs])

    output_units = {row.name: row.units for row in plant.sim.entries(OUTPUT)}
    state_units = [_state_units(plant, name) for name in plant.states]
    data["state_units"] = "state", np.array(state_units, object)
    input_units = [quantity_attributes(_quantity(name))["units"] for name in inputs]
    data["input_units"] = "input", np.array(input_units, object)
    data["output_units"] = "output", np.array([output_units[name] for name in outputs], object)
    coords = {
        "state": list(plant.states),
        "state_": list(plant.states),
        "input": list(inputs),
        "output": list(outputs),
    }
    names = np.array([*plant.states, *inputs])
    return xr.Dataset(data, coords, attrs=_describe_model(plant, names[jacobian.kinks]))


def _describe_model(plant: Plant, kinks: Iterable[str]) -> dict[str, str | float]:
    """Return the attributes of a linear model; `kinks` are names of states and inputs."""
    trimmed = plant.trimmed
    condition = (
        f"V {trimmed['V']:.6g} m/s, h {trimmed['h']:.6g} m, "
        f"alpha {np.degrees(trimmed['alpha']):.4g} deg, "
        f"gamma {np.degrees(trimmed['gamma']):.4g} deg"
    )
    return {
        "title": plant.sim.title,
        "condition": condition,
        "kinks": " ".join(kinks),
        "left_out": " ".join(name for name in plant.submodels if name not in plant.states),
        "held": _describe_circuits(plant),
        "V": trimmed["V"],
        "weight": plant.weight,
    }


def _describe_circuits(plant: Plant) -> str:
    circuits = [name for name in _CIRCUITS if f"{name}.mass" in plant.sim.parameters]
    if not circuits:
        return ""
    return f"control circuits of {', '.join(circuits)}: surfaces held where the trim left them"


def _state_units(plant: Plant, name: str) -> str:
    if name in plant.submodels:
        return plant.submodels[name].units
    return quantity_attributes(name)["units"]


def _applied_input(plant: Plant, name: str) -> float:
    """Return an input as it acts: its value plus the bias of the trim."""
    if f"applied.{name}" in plant.sim.outputs:
        return plant.trimmed[f"applied.{name}"]
    quantity = _quantity(name).rpartition(".")[2]
    bias = 0.0
    if quantity in BIASES:
        bias = plant.run.parameter(plant.sim.parameters.index(f"bias.{quantity}"))
    return float(plant.u[plant.sim.inputs.index(name)]) + bias


def _quantity(name: str) -> str:
    return name.removesuffix("_drive")
