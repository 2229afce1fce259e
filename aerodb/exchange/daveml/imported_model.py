"""Identification of inputs, reference quantities and coefficients of a DAVE-ML model."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypedDict

import numpy as np

from aerodb.exchange.daveml.document.elements import DaveVariable, Shot
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.polynomials import Sum, make_variable_sum
from aerodb.exchange.daveml.vocabulary import (
    COEFFICIENTS,
    WRITER,
    device_of,
    file_unit_conversion,
    quantity_of,
)
from aerodb.exchange.spelling import spell
from aerodb.store.schema import FORCE_AXES
from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup

REFERENCE_LENGTHS = ("S", "cbar", "b")


class StatedLengths(TypedDict, total=False):
    """Reference area [m2], chord and span [m] of a file that does not state them."""

    S: float | None
    cbar: float | None
    b: float | None


REFERENCE_POINT = ("x_ref", "y_ref", "z_ref")


@dataclass(frozen=True)
class ImportedModel:
    """A DAVE-ML model with the identification of its variables.

    Parameters
    ----------
    model : DaveModel
        The content of the file.
    quantities : mapping of str to str
        Quantity of the vocabulary of each input, by varID.
    outputs : mapping of str to str
        varID of the output that gives each coefficient, by coefficient.
    geometry : mapping of str to float
        Reference area [m2], reference lengths and reference point [m].
    sums : mapping of str to Sum
        Exact sum of each variable that has one, by varID.
    reasons : mapping of str to str
        Why a variable has no exact sum, by varID.
    """

    model: DaveModel
    quantities: Mapping[str, str]
    outputs: Mapping[str, str]
    geometry: Mapping[str, float]
    sums: Mapping[str, Sum]
    reasons: Mapping[str, str]


def apply_user_names(
    model: DaveModel, names: Mapping[str, str]
) -> tuple[DaveModel, dict[str, str]]:
    """Return the model with the units of `names`, and the quantities by varID."""
    quantities: dict[str, str] = {}
    variables = dict(model.variables)
    for key, text in names.items():
        # "alpha [deg]" is a quantity and the unit that replaces the unit of the file.
        name, _, unit = text.partition("[")
        variable = model.find(key)
        # The look-up raises UnknownName for a quantity that is not in the vocabulary.
        lookup(name.strip())
        quantities[variable.varID] = name.strip()
        if unit:
            variables[variable.varID] = replace(variable, units=unit.strip(" ]"))
    return replace(model, variables=variables), quantities


def fix_inputs(model: DaveModel, values: Mapping[str, float]) -> tuple[DaveModel, str]:
    """Return the model with inputs as constants, and a text that lists them.

    Check cases at another value of such an input are left out.
    """
    variables = dict(model.variables)
    fixed: dict[str, float] = {}
    for key, value in values.items():
        variable = model.find(key)
        if variable.varID not in model.inputs:
            raise UnknownName(key, model.inputs, "input")
        variables[variable.varID] = replace(variable, initial=value, is_input=False)
        fixed[variable.varID] = value
    shots = tuple(shot for shot in model.shots if _has_values(model, shot, fixed))
    parts = [
        f"{varID} = {value:g} {model.variables[varID].units}" for varID, value in fixed.items()
    ]
    return replace(model, variables=variables, shots=shots), ", ".join(parts)


def _has_values(model: DaveModel, shot: Shot, fixed: Mapping[str, float]) -> bool:
    """Return whether a check case has these values of inputs, by varID."""
    # An input that the case does not state has the initial value of the file.
    values = {varID: model.variables[varID].initial for varID in fixed}
    for signal in shot.inputs:
        try:
            values[model.signal(signal).varID] = model.converted(signal).value
        except (UnknownName, UnitError):
            # With checks="ignore" the reader accepts such a case; it is left out later.
            continue
    return all(values[varID] == value for varID, value in fixed.items())


def identify_inputs(model: DaveModel, names: Mapping[str, str]) -> dict[str, str]:
    """Return the quantity of each input, by varID."""
    varID_of: dict[str, str] = {}
    for varID in model.inputs:
        variable = model.variables[varID]
        # The caller's name comes first, then the vocabulary, then the name of a device.
        quantity = names.get(varID) or quantity_of(variable) or device_of(variable)
        if not quantity:
            continue
        if quantity in varID_of:
            raise SchemaError(
                model.file,
                [
                    f"the inputs {varID_of[quantity]} and {varID} are both {quantity}; state which "
                    f"with {spell('names=', '--names')}"
                ],
            )
        varID_of[quantity] = varID
    return {varID: quantity for quantity, varID in varID_of.items()}


def input_sums(model: DaveModel, quantities: Mapping[str, str]) -> dict[str, Sum]:
    """Return each input in its unit of the file as a sum over the quantity in SI."""
    sums = {}
    for varID, quantity in quantities.items():
        factor, offset = file_unit_conversion(model.variables[varID], quantity)
        sums[varID] = make_variable_sum(quantity, factor, offset)
    return sums


def read_reference_quantities(model: DaveModel, arguments: Mapping[str, Any]) -> dict[str, float]:
    """Return S, cbar, b and the reference point in SI, from the file or the arguments."""
    values = _constants_of_file(model)
    problems = []
    for quantity, value in arguments.items():
        if value is None:
            continue
        if quantity in values and not np.isclose(value, values[quantity], rtol=1e-6):
            problems.append(
                f"{quantity} is {values[quantity]:.9g} in the file and {value:.9g} in the "
                f"{spell('call', 'command')}; leave it out"
            )
        values.setdefault(quantity, value)
    for quantity in REFERENCE_LENGTHS:
        if quantity not in values:
            option = spell(f"pass {quantity}=", f"give --{quantity}")
            problems.append(f"the file does not state {quantity}; {option}")
    if problems:
        raise SchemaError(f"reference quantities of {model.file}", problems)
    return values


def _constants_of_file(model: DaveModel) -> dict[str, float]:
    """Return the reference quantities that are constants of the file, in SI."""
    values: dict[str, float] = {}
    for variable in model.variables.values():
        quantity = _reference_quantity(variable)
        is_constant = variable.initial is not None and variable.varID not in model.functions
        if not quantity or not is_constant:
            continue
        # A coordinate of the reference point is a length, so the unit of the chord applies.
        unit_quantity = "cbar" if quantity in REFERENCE_POINT else quantity
        factor, offset = file_unit_conversion(variable, unit_quantity)
        assert variable.initial is not None
        values[quantity] = (variable.initial - offset) / factor
    return values


def _reference_quantity(variable: DaveVariable) -> str:
    """Return the reference quantity that a variable is, or ``""``."""
    if variable.name in REFERENCE_POINT:
        return variable.name
    quantity = quantity_of(variable)
    return quantity if quantity in (*REFERENCE_LENGTHS, *REFERENCE_POINT) else ""


def identify_coefficients(
    model: DaveModel, names: Mapping[str, str], axes: str | None, without: Collection[str]
) -> tuple[dict[str, str], str]:
    """Return the varID of each coefficient of the file, and the axes of its forces."""
    outputs = _coefficient_outputs(model, names)
    if axes is None:
        axes = _detect_force_axes(model, outputs)
    if axes not in FORCE_AXES:
        raise ValueError(f"force_axes is {axes!r}; allowed: {', '.join(FORCE_AXES)}")
    for name in without:
        if name not in COEFFICIENTS:
            raise UnknownName(name, COEFFICIENTS, "coefficient")
    selected: dict[str, str] = {}
    for name, varID in outputs.items():
        if name in without or not (name in FORCE_AXES[axes] or name.startswith("Ch_")):
            continue
        # A file of `export_daveml` has an output for every coefficient of its force axes. The
        # output has no calculation if the database has no term of this coefficient.
        if is_own_file(model) and model.variables[varID].calculation is None:
            continue
        selected[name] = varID
    if not selected:
        listed = ", ".join(f"{varID} ({model.variables[varID].name})" for varID in model.outputs)
        raise SchemaError(
            model.file,
            [
                f"no output is a coefficient: {listed}; state which with "
                + spell(f"names={{'{model.outputs[0]}': 'CL'}}", f"--names {model.outputs[0]}=CL")
                + ", say"
            ],
        )
    return selected, axes


def is_own_file(model: DaveModel) -> bool:
    """Return whether `export_daveml` wrote the file."""
    return model.header.version.startswith(WRITER)


def _coefficient_outputs(model: DaveModel, names: Mapping[str, str]) -> dict[str, str]:
    outputs: dict[str, str] = {}
    for varID in model.outputs:
        quantity = names.get(varID) or quantity_of(model.variables[varID])
        if quantity not in COEFFICIENTS:
            continue
        if quantity in outputs:
            raise SchemaError(
                model.file,
                [
                    f"the outputs {outputs[quantity]} and {varID} are both {quantity}; state "
                    f"which with {spell('names=', '--names')}"
                ],
            )
        outputs[quantity] = varID
    return outputs


def _detect_force_axes(model: DaveModel, outputs: Mapping[str, str]) -> str:
    """Return the force axes that the coefficients of the file belong to."""
    body = [name for name in ("CX", "CZ") if name in outputs]
    lift_drag = [name for name in ("CL", "CD") if name in outputs]
    if body and lift_drag:
        raise SchemaError(
            model.file,
            [f"gives both {' '.join(body)} and {' '.join(lift_drag)}; choose with force_axes="],
        )
    if body:
        return "body"
    # Lift and drag are in stability axes unless the file states wind axes.
    axis_systems = " ".join(
        model.variables[outputs[name]].axis_system.lower() for name in lift_drag
    )
    return "wind" if "wind" in axis_systems else "stability"
