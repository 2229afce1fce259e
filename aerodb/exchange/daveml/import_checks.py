"""Comparison of an imported database with its DAVE-ML model, and the check cases of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from aerodb.exchange.daveml import export_checks as sample_states
from aerodb.exchange.daveml.document.elements import Shot
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.imported_model import ImportedModel, is_own_file
from aerodb.exchange.daveml.vocabulary import STORED, file_unit_conversion
from aerodb.exchange.spelling import spell
from aerodb.store.evaluation import contributions
from aerodb.store.schema import terms
from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import ITEM, VOCABULARY, quantity_attributes

EXACT_STATES = 500  # states of the comparison if all tables are exact
SAMPLED_STATES = 5000  # states of the comparison if functions were sampled
# Allowed difference, relative to the sum of the absolute contributions: some hundred roundings.
_ROUNDING = 1e-11
# Lower limit of that sum, so that a sum near zero still has a tolerance. [1]
_LEAST_SIZE = 1e-3


def compare_with_model(
    db: xr.DataTree, source: ImportedModel, box: Mapping[str, tuple[float, float]], sample: float
) -> dict[str, float]:
    """Compare the database with the model at states inside and beyond its tables.

    Parameters
    ----------
    db : DataTree
        The imported database.
    source : ImportedModel
        The model of the file.
    box : mapping of str to (low, high)
        Range of the sampled quantities [SI]; empty if no function was sampled. The states stay
        inside it.
    sample : float
        Allowed difference of a coefficient that has sampled tables. [1]

    Returns
    -------
    dict of str to float
        Largest difference of each coefficient that has sampled tables. [1]

    Raises
    ------
    SchemaError
        A coefficient differs by more than rounding, or by more than `sample` if it has sampled
        tables.
    """
    model = source.model
    count = SAMPLED_STATES if box else EXACT_STATES
    beyond = 0.0 if box else sample_states.BEYOND
    drawn_states = sample_states.draw_check_states(terms(db).values(), count, beyond, box)
    states = sample_states.with_rates(drawn_states, source.geometry)
    for quantity in source.quantities.values():
        states.setdefault(quantity, np.zeros(count))

    outputs = model.evaluate(_states_in_file_units(source, states))
    sampled = {name.split("/")[0] for name, leaf in terms(db).items() if "sampled" in leaf.attrs}
    problems = []
    differences: dict[str, float] = {}
    for coefficient, varID in source.outputs.items():
        factor, offset = file_unit_conversion(model.variables[varID], coefficient)
        parts = contributions(db, coefficient, states, outside="clamp")
        total = sum(parts.values(), np.zeros(count))
        size = sum(map(np.abs, parts.values()), np.zeros(count))
        difference = np.abs(total - (outputs[varID] - offset) / factor)
        allowed = _ROUNDING * np.maximum(size, _LEAST_SIZE)
        if coefficient in sampled:
            differences[coefficient] = float(difference.max())
            allowed = np.maximum(allowed, sample)
        # The comparison is negated so that a NaN counts as a difference.
        if not (difference <= allowed).all():
            worst = int(np.nanargmax(difference - allowed))
            state = ", ".join(f"{name} {states[name][worst]:.6g}" for name in sorted(drawn_states))
            problems.append(
                f"{coefficient} differs from {varID} by {difference[worst]:.3g} at {state}"
            )
    if problems and sampled:
        raise SchemaError(
            f"{model.file}: {spell('sample=', '--sample ')}{sample:g} is not kept; give more "
            f"breakpoints with {spell('grid=', '--grid')}, or a larger difference",
            problems,
        )
    if problems:
        raise SchemaError(f"{model.file}: the terms do not give the model back", problems)
    return differences


def _states_in_file_units(
    source: ImportedModel, states: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return states in SI as inputs of the model, by varID in the units of the file."""
    model = source.model
    inputs = {}
    for varID, quantity in source.quantities.items():
        if quantity in states:
            factor, offset = file_unit_conversion(model.variables[varID], quantity)
            inputs[varID] = factor * states[quantity] + offset
    # Inputs without a quantity do not enter the terms. They are zero in the model.
    for varID in model.inputs:
        if varID not in source.quantities:
            inputs[varID] = np.zeros(())
    return inputs


def convert_check_cases(source: ImportedModel) -> xr.Dataset | None:
    """Return the check cases of the file over ``case`` in SI, or None if it has none.

    The Dataset holds the inputs, the expected coefficients and their tolerances.  The lines of the
    attribute ``names`` are the names of the cases.
    """
    model = source.model
    shots = [shot for shot in model.shots if _is_convertible(model, shot)]
    if is_own_file(model):
        # `export_daveml` draws its other cases anew, so only the stored cases are read.
        stored = [shot for shot in shots if shot.name.startswith(STORED)]
        shots = [replace(shot, name=shot.name.removeprefix(STORED)) for shot in stored]
    if not shots:
        return None
    rows = [_case_row(source, shot) for shot in shots]
    keys: dict[str, None] = {}
    for row in rows:
        keys |= dict.fromkeys(row)
    # A value that a case does not state is NaN.
    columns = {}
    for key in keys:
        columns[key] = np.array([row.get(key, np.nan) for row in rows])
    columns = sample_states.with_reduced(columns, source.geometry)
    cases = xr.Dataset(
        {key: ("case", column) for key, column in columns.items()},
        {"case": np.arange(1, len(shots) + 1)},
    )
    for key in columns:
        if ITEM.sub("", key) in VOCABULARY:
            cases[key].attrs.update(quantity_attributes(key))
    # The names are an attribute because the arrays of a database file hold numbers only.
    names = "\n".join(" ".join(shot.name.split()) for shot in shots)
    cases.attrs = {"source": f"check data of {Path(model.file).name}", "names": names}
    return cases


def _is_convertible(model: DaveModel, shot: Shot) -> bool:
    """Return whether the file defines all variables of a check case, in convertible units."""
    try:
        return all(model.converted(signal) for signal in (*shot.inputs, *shot.outputs))
    except (UnknownName, UnitError):
        # With checks="ignore" the reader accepts such a case.
        return False


def _case_row(source: ImportedModel, shot: Shot) -> dict[str, float]:
    """Return inputs, coefficients and tolerances of a check case in SI."""
    model, quantities = source.model, source.quantities
    inputs: dict[str, float] = {}
    for varID in quantities:
        initial = model.variables[varID].initial
        if initial is not None:
            inputs[varID] = initial
    for signal in shot.inputs:
        inputs[model.signal(signal).varID] = model.converted(signal).value

    row: dict[str, float] = {}
    for varID, value in inputs.items():
        if varID in quantities:
            factor, offset = file_unit_conversion(model.variables[varID], quantities[varID])
            row[quantities[varID]] = (value - offset) / factor

    coefficient_of = {varID: quantity for quantity, varID in source.outputs.items()}
    for signal in shot.outputs:
        variable = model.signal(signal)
        coefficient = coefficient_of.get(variable.varID)
        if coefficient is None:
            continue
        expected = model.converted(signal)
        factor, offset = file_unit_conversion(variable, coefficient)
        row[coefficient] = (expected.value - offset) / factor
        row[f"{coefficient}_tolerance"] = abs(expected.tolerance / factor)
    return row
