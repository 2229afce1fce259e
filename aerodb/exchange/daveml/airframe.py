"""Import of mass properties and static thrust from the DAVE-ML files of an aerodynamic model."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from aerodb.exchange.daveml import polynomials
from aerodb.exchange.daveml.document.elements import DaveVariable
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.document.reading import read
from aerodb.exchange.daveml.expansion import expand_variables
from aerodb.exchange.daveml.vocabulary import file_unit_conversion, quantity_of
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import THRUST_AXES, Engine
from flightmech.errors import SchemaError
from flightmech.terms import evaluate_term, make_term

# Names of S-119 that the vocabulary does not list.
_NAMES = {
    "bodyProductOfInertia_ZX": "Ixz",
    "bodyPositionOfCmWrtMrc_X": "x_cg_b",
    "bodyPositionOfCmWrtMrc_Y": "y_cg_b",
    "bodyPositionOfCmWrtMrc_Z": "z_cg_b",
    "powerLeverAngle": "throttle",
}
_NEEDED = ("mass", "Ixx", "Iyy", "Izz")
_MASS = (*_NEEDED, "Ixy", "Ixz", "Iyz", "x_cg_b", "y_cg_b", "z_cg_b")
# Components of the thrust that must be zero: the engine acts along body x.
_OTHER_COMPONENTS = (
    "thrustBodyForce_Y",
    "thrustBodyForce_Z",
    "thrustBodyMoment_Roll",
    "thrustBodyMoment_Pitch",
    "thrustBodyMoment_Yaw",
)
_STATES = 500  # states at which the table is compared with the model
_ROUNDING = 1e-9  # allowed difference, relative to the largest thrust


def import_daveml_aircraft(
    db: xr.DataTree,
    inertia: str | os.PathLike[str],
    propulsion: str | os.PathLike[str] | None = None,
    inputs: Mapping[str, float] | None = None,
    *,
    name: str = "",
    x_ref_mac: float = 0.25,
) -> Aircraft:
    """Read the aircraft of a database from DAVE-ML files of inertia and propulsion.

    Parameters
    ----------
    db : DataTree
        From `import_daveml`: reference area and lengths.
    inertia : path
        File of mass, moments of inertia and the centre of gravity from the moment reference point
        under names of S-119 (``totalMass``, ``bodyMomentOfInertia_Roll``,
        ``bodyPositionOfCmWrtMrc_X``).
    propulsion : path, optional
        File of ``thrustBodyForce_X``, static, over ``powerLeverAngle`` in parts or per cent of its
        range, Mach number and height.  It becomes the table of one engine at the moment reference
        point.  Without it the aircraft has no engine.
    inputs : mapping of str to float, optional
        Inputs of the inertia file by varID or name, in its units: ``{"CG_PCT_MAC": 25.0}``.  The
        default of an input is its initial value.
    name : str
        Name of the aircraft.  The default is the title of the database.
    x_ref_mac : float
        Distance of the moment reference point behind the leading edge of the mean chord, which
        DAVE-ML does not state. [chords]

    Returns
    -------
    Aircraft

    Raises
    ------
    ParseError, SchemaError
        As `read`.  SchemaError also for a missing mass property, and for a thrust that is not along
        body x or not a table over lever, Mach number and height.
    UnknownName
        An input that the inertia file does not have.

    Notes
    -----
    The thrust table is compared with the model at 500 states before it is returned.
    """
    mass_properties = _read_mass_properties(read(inertia), inputs or {})
    root = db.attrs
    x, y, z = (float(root.get(key, 0.0)) for key in ("x_ref", "y_ref", "z_ref"))
    engines: tuple[Engine, ...] = ()
    if propulsion is not None:
        engines = (Engine((0.0, 0.0, 0.0), thrust=_tabulate_thrust(read(propulsion))),)
    return Aircraft(
        name=name or str(root.get("title", "")),
        S=float(root["S"]),
        cbar=float(root["cbar"]),
        b=float(root["b"]),
        mass=mass_properties["mass"],
        Ixx=mass_properties["Ixx"],
        Iyy=mass_properties["Iyy"],
        Izz=mass_properties["Izz"],
        Ixy=mass_properties["Ixy"],
        Ixz=mass_properties["Ixz"],
        Iyz=mass_properties["Iyz"],
        reference=(x, y, z),
        x_ref_mac=x_ref_mac,
        cg=(mass_properties["x_cg_b"], mass_properties["y_cg_b"], mass_properties["z_cg_b"]),
        engines=engines,
    )


def _quantity_name(variable: DaveVariable) -> str:
    return _NAMES.get(variable.name) or quantity_of(variable)


def _read_mass_properties(model: DaveModel, inputs: Mapping[str, float]) -> dict[str, float]:
    """Return the quantities of `_MASS` in SI; optional ones that the file lacks are zero."""
    initial = {varID: model.variables[varID].initial for varID in model.inputs}
    values = {varID: value for varID, value in initial.items() if value is not None}
    for key, value in inputs.items():
        values[model.find(key).varID] = float(value)
    problems = []
    for varID in model.inputs:
        if varID not in values:
            problems.append(
                f"the input {varID} ({model.variables[varID].name}) has no initial value; pass "
                f"inputs={{'{varID}': ...}}"
            )
    # All missing properties are listed in one error.
    varID_of = {}
    for varID in model.outputs:
        quantity = _quantity_name(model.variables[varID])
        if quantity in _MASS:
            varID_of[quantity] = varID
    problems += [f"no output is {quantity}" for quantity in _NEEDED if quantity not in varID_of]
    if problems:
        raise SchemaError(model.file, problems)
    outputs = model.evaluate(values)
    mass_properties = dict.fromkeys(_MASS, 0.0)
    for quantity, varID in varID_of.items():
        factor, offset = file_unit_conversion(model.variables[varID], quantity)
        mass_properties[quantity] = (float(outputs[varID]) - offset) / factor
    return mass_properties


@dataclass(frozen=True)
class _ThrustModel:
    """A propulsion file: thrust output, and (input, factor, offset) by quantity."""

    model: DaveModel
    output: str
    inputs: Mapping[str, tuple[str, float, float]]


def _tabulate_thrust(model: DaveModel) -> xr.Dataset:
    """Return the static thrust as a term leaf over lever, Mach number and height. [N]"""
    source = _identify_thrust(model)
    # The expansion proves that the thrust is a table, and gives its breakpoints.
    input_sums = {}
    for quantity, (varID, factor, offset) in source.inputs.items():
        input_sums[varID] = polynomials.make_variable_sum(quantity, factor, offset)
    sums, reasons = expand_variables(model, input_sums, {})
    if source.output not in sums:
        raise SchemaError(model.file, [f"{source.output} is not a table: {reasons[source.output]}"])
    axes = {}
    for quantity in THRUST_AXES:
        points = _breakpoints_along(sums[source.output], quantity)
        if len(points):
            axes[quantity] = points
    mesh = np.meshgrid(*axes.values(), indexing="ij")
    states = dict(zip(axes, mesh, strict=True))
    leaf = make_term(_evaluate_thrust(source, states), axes, references=Path(model.file).name)
    _compare_with_model(source, leaf, axes)
    return leaf


def _identify_thrust(model: DaveModel) -> _ThrustModel:
    """Return inputs and output of a propulsion file, or raise with every unsuitable variable."""
    problems = []
    varID_of: dict[str, str] = {}
    for varID in model.inputs:
        quantity = _quantity_name(model.variables[varID])
        varID_of[quantity] = varID
        if quantity not in THRUST_AXES:
            problems.append(
                f"the input {varID} ({model.variables[varID].name}) is none of "
                f"{', '.join(THRUST_AXES)}"
            )
    outputs = []
    for varID in model.outputs:
        if _quantity_name(model.variables[varID]) == "thrust":
            outputs.append(varID)
    if len(outputs) != 1:
        problems.append(f"{len(outputs)} outputs are thrustBodyForce_X; one is needed")
    if problems:
        raise SchemaError(model.file, problems)
    inputs = {}
    for quantity, varID in varID_of.items():
        factor, offset = file_unit_conversion(model.variables[varID], quantity)
        inputs[quantity] = (varID, factor, offset)
    return _ThrustModel(model, outputs[0], inputs)


def _breakpoints_along(expression: polynomials.Sum, name: str) -> np.ndarray:
    """Return the breakpoints of all tables of a sum along a variable."""
    tables = []
    for grids, _ in expression.products:
        for grid in grids:
            tables += [axis.points for axis in grid.axes if axis.variable == name]
    if name != "throttle":
        return np.unique(np.concatenate([*tables, []]))
    # The lever goes from 0 to 1, whatever the range of the tables.
    points = np.unique(np.concatenate([*tables, [0.0, 1.0]]))
    return points[(points >= 0.0) & (points <= 1.0)]


def _evaluate_thrust(source: _ThrustModel, states: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the thrust of the file along body x at states in SI. [N]"""
    model = source.model
    first = next(iter(states.values()))
    # Value in the file = factor * value in SI + offset. A quantity without axis is zero.
    inputs = {}
    for quantity, (varID, factor, offset) in source.inputs.items():
        inputs[varID] = factor * states.get(quantity, 0.0 * first) + offset
    values = model.evaluate(inputs)
    nonzero = []
    for varID in model.outputs:
        is_other = model.variables[varID].name in _OTHER_COMPONENTS
        if is_other and np.abs(values[varID]).max() > 0.0:
            nonzero.append(varID)
    if nonzero:
        raise SchemaError(
            model.file,
            [
                f"{' '.join(nonzero)} are not zero; give position and direction of the engines "
                f"in the aircraft file"
            ],
        )
    factor, offset = file_unit_conversion(model.variables[source.output], "thrust")
    return (np.broadcast_to(values[source.output], first.shape) - offset) / factor


def _compare_with_model(
    source: _ThrustModel, leaf: xr.Dataset, axes: Mapping[str, np.ndarray]
) -> None:
    """Raise if the table differs from the model at random states inside its breakpoints."""
    # The seed is fixed, so that an import always gives the same result.
    random = np.random.default_rng(0)
    states = {}
    for name, points in axes.items():
        states[name] = random.uniform(points[0], points[-1], _STATES)
    expected = _evaluate_thrust(source, states)
    difference = np.abs(evaluate_term(leaf, states) - expected).max()
    if difference > _ROUNDING * np.abs(expected).max():
        raise SchemaError(
            source.model.file,
            [
                f"{source.output} is not linear in {', '.join(axes)} between breakpoints: a table "
                f"is up to {difference:.3g} N off"
            ],
        )
