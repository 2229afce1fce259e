"""The aircraft around a DAVE-ML aerodynamic model: mass properties and static thrust from the files
in the same folder.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from aerodb.exchange.daveml import polynomials
from aerodb.exchange.daveml.document.model import DaveModel, DaveVariable
from aerodb.exchange.daveml.document.reading import read
from aerodb.exchange.daveml.expansion import expand_variables
from aerodb.exchange.daveml.vocabulary import file_unit_conversion, quantity_of
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import THRUST_AXES, Engine
from flightmech.errors import SchemaError
from flightmech.terms import evaluate_term, make_term

_NAMES = {  # of S-119, in addition to those of the vocabulary
    "bodyProductOfInertia_ZX": "Ixz",
    "bodyPositionOfCmWrtMrc_X": "x_cg_b",
    "bodyPositionOfCmWrtMrc_Y": "y_cg_b",
    "bodyPositionOfCmWrtMrc_Z": "z_cg_b",
    "powerLeverAngle": "throttle",
}
_NEEDED = ("mass", "Ixx", "Iyy", "Izz")
_MASS = (*_NEEDED, "Ixy", "Ixz", "Iyz", "x_cg_b", "y_cg_b", "z_cg_b")
_ASIDE = (
    "thrustBodyForce_Y",
    "thrustBodyForce_Z",
    "thrustBodyMoment_Roll",
    "thrustBodyMoment_Pitch",
    "thrustBodyMoment_Yaw",
)
_PROOFS = 500  # states at which the table is compared with the model
_ROUNDING = 1e-9  # of the largest thrust


def import_daveml_aircraft(
    db: xr.DataTree,
    inertia: str | os.PathLike,
    propulsion: str | os.PathLike | None = None,
    inputs: Mapping[str, float] | None = None,
    *,
    name: str = "",
    x_ref_mac: float = 0.25,
) -> Aircraft:
    """Read the aircraft that belongs to a database from DAVE-ML files of inertia and propulsion.

    Parameters
    ----------
    db : DataTree
        From `import_daveml`: reference area and lengths.
    inertia : path
        Gives mass, moments of inertia and the centre of gravity from the moment reference point
        under names of S-119 (``totalMass``, ``bodyMomentOfInertia_Roll``,
        ``bodyPositionOfCmWrtMrc_X``).
    propulsion : path, optional
        Gives ``thrustBodyForce_X``, static, over ``powerLeverAngle`` in parts or per cent of its
        travel, Mach number and height: it becomes a table, one engine at the moment reference
        point.  Without it the aircraft has no engine.
    inputs : mapping of str to float, optional
        Inputs of the inertia file by varID or name, in its units: ``{"CG_PCT_MAC": 25.0}``; else
        their initial values.
    name : str
        Of the aircraft; the title of the database unless given.
    x_ref_mac : float
        Moment reference point behind the leading edge of the mean chord, which DAVE-ML does not
        state. [chords]

    Returns
    -------
    Aircraft

    Raises
    ------
    ParseError, SchemaError
        As `read`; SchemaError also for a mass property that is not there, and for thrust not along
        body x or not a table over lever, Mach number and height.
    UnknownName
        An input that the inertia file does not have.

    Notes
    -----
    The thrust table is compared with the model at 500 states before it is returned.
    """
    found = _mass_properties(read(inertia), inputs or {})
    root = db.attrs
    S, cbar, b = (float(root[key]) for key in ("S", "cbar", "b"))
    x, y, z = (float(root.get(key, 0.0)) for key in ("x_ref", "y_ref", "z_ref"))
    return Aircraft(
        name or str(root.get("title", "")),
        S,
        cbar,
        b,
        found["mass"],
        found["Ixx"],
        found["Iyy"],
        found["Izz"],
        found["Ixy"],
        found["Ixz"],
        found["Iyz"],
        reference=(x, y, z),
        x_ref_mac=x_ref_mac,
        cg=(found["x_cg_b"], found["y_cg_b"], found["z_cg_b"]),
        engines=()
        if propulsion is None
        else (Engine((0.0, 0.0, 0.0), thrust=_thrust(read(propulsion))),),
    )


def _quantity(variable: DaveVariable) -> str:
    return _NAMES.get(variable.name) or quantity_of(variable)


def _mass_properties(model: DaveModel, inputs: Mapping[str, float]) -> dict[str, float]:
    """Return what `_MASS` names, SI; zero for products of inertia and offsets that the file does
    not give.
    """
    given = {varID: model.variables[varID].initial for varID in model.inputs}
    given |= {model.find(key).varID: float(value) for key, value in inputs.items()}
    problems = [f"the input {varID} ({model.variables[varID].name}) has no initial value; pass "
        f"inputs={{'{varID}': ...}}"
                for varID, value in given.items() if value is None]  # fmt: skip
    places = {
        quantity: varID
        for varID in model.outputs
        if (quantity := _quantity(model.variables[varID])) in _MASS
    }
    problems += [f"no output is {quantity}" for quantity in _NEEDED if quantity not in places]
    if problems:
        raise SchemaError(model.file, problems)
    values = model.evaluate({varID: value for varID, value in given.items() if value is not None})
    found = dict.fromkeys(_MASS, 0.0)
    for quantity, varID in places.items():
        factor, offset = file_unit_conversion(model.variables[varID], quantity)
        found[quantity] = (float(values[varID]) - offset) / factor
    return found


def _thrust(model: DaveModel) -> xr.Dataset:
    """Return the static thrust as a term leaf over lever, Mach number and height. [N]"""
    problems = []
    mine = {varID: _quantity(model.variables[varID]) for varID in model.inputs}
    problems += [
        f"the input {varID} ({model.variables[varID].name}) is none of {', '.join(THRUST_AXES)}"
        for varID, quantity in mine.items()
        if quantity not in THRUST_AXES
    ]
    outputs = [varID for varID in model.outputs if _quantity(model.variables[varID]) == "thrust"]
    if len(outputs) != 1:
        problems.append(f"{len(outputs)} outputs are thrustBodyForce_X; one is needed")
    if problems:
        raise SchemaError(model.file, problems)
    scales = {
        quantity: (varID, *file_unit_conversion(model.variables[varID], quantity))
        for varID, quantity in mine.items()
    }
    sums, reasons = expand_variables(
        model,
        {
            varID: polynomials.make_variable_sum(name, f, o)
            for name, (varID, f, o) in scales.items()
        },
        {},
    )
    if outputs[0] not in sums:
        raise SchemaError(model.file, [f"{outputs[0]} is no table: {reasons[outputs[0]]}"])
    axes = {name: points for name in THRUST_AXES if len(points := _points(sums[outputs[0]], name))}
    leaf = make_term(
        _forces(model, scales, outputs[0], _meshed(axes)), axes, references=Path(model.file).name
    )
    _prove(model, scales, outputs[0], leaf, axes)
    return leaf


def _points(one: polynomials.Sum, name: str) -> np.ndarray:
    """Return the breakpoints of all tables of a sum along a variable; of the lever also its ends."""
    tables = [
        axis.points
        for grids, _ in one.products
        for grid in grids
        for axis in grid.axes
        if axis.variable == name
    ]
    points = np.unique(np.concatenate([*tables, [0.0, 1.0] if name == "throttle" else []]))
    return points[(points >= 0.0) & (points <= 1.0)] if name == "throttle" else points


def _meshed(axes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return dict(zip(axes, np.meshgrid(*axes.values(), indexing="ij"), strict=True))


def _forces(
    model: DaveModel,
    scales: Mapping[str, tuple[str, float, float]],
    varID: str,
    at: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Return the thrust of the file at states [SI]; all of it along body x. [N]"""
    first = next(iter(at.values()))
    values = model.evaluate(
        {item: f * at.get(name, 0.0 * first) + o for name, (item, f, o) in scales.items()}
    )
    aside = [key for key in _aside(model) if np.abs(values[key]).max() > 0.0]
    if aside:
        raise SchemaError(
            model.file,
            [
                f"{' '.join(aside)} are not zero; give position and direction of the engines "
                f"in the aircraft file"
            ],
        )
    factor, offset = file_unit_conversion(model.variables[varID], "thrust")
    return (np.broadcast_to(values[varID], first.shape) - offset) / factor


def _aside(model: DaveModel) -> Iterator[str]:
    return (varID for varID in model.outputs if model.variables[varID].name in _ASIDE)


def _prove(
    model: DaveModel, scales: Mapping, varID: str, leaf: xr.Dataset, axes: Mapping[str, np.ndarray]
) -> None:
    """Compare the table with the model inside its breakpoints."""
    draw = np.random.default_rng(0)
    at = {name: draw.uniform(points[0], points[-1], _PROOFS) for name, points in axes.items()}
    expected = _forces(model, scales, varID, at)
    apart = np.abs(evaluate_term(leaf, at) - expected).max()
    if apart > _ROUNDING * np.abs(expected).max():
        raise SchemaError(
            model.file,
            [
                f"{varID} is not linear in {', '.join(axes)} between breakpoints: a table is "
                f"up to {apart:.3g} N off"
            ],
        )
