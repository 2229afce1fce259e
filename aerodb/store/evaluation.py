"""Evaluation of coefficients, and check cases that a database file contains."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.schema import HINGE, database_coefficients, require_valid, terms
from flightmech import terms as _terms
from flightmech.axes import lift_drag
from flightmech.build_up import evaluation_levels, used_coefficients
from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.names import ATTACHED_FLOW, lookup, quantity_attributes
from flightmech.quantities import value_in_si
from flightmech.support.array_files.netcdf_trees import CHECKS

_OF_ANY_AXES = ("CL", "CD", "CX", "CY", "CZ", "Cl", "Cm", "Cn")
_HIGH = 1000.0  # height above ground without ground effect, where no table ends [m]


def contributions(
    db: xr.DataTree, coefficient: str, conditions: Mapping[str, Any], outside: str = "raise"
) -> dict[str, np.ndarray]:
    """Return the contribution of each term to a coefficient.

    Parameters
    ----------
    db : DataTree
        The database.
    coefficient : str
        One of the database's coefficients, such as ``"CL"``, or a hinge moment, such as ``"Ch_e"``.
    conditions : mapping of str to array
        Every variable the terms need, broadcast against each other; also a Dataset of a manoeuvre.
        Coefficients that the terms depend on, such as ``CL`` in a drag polar, may be omitted.  They
        are then the sums of their terms, as in the simulation. [SI]
    outside : {"raise", "clamp"}
        Beyond a table: raise, or follow the rule of the leaf as the simulation does.

    Returns
    -------
    dict of str to array
        By contribution: ``{"basic": ..., "flap": ...}``.  Each has the shape of the variables of
        its term. [1]

    Raises
    ------
    UnknownName
        An unknown coefficient, or a variable that is missing in `conditions`.
    OutOfRange
        A sample beyond a table; with the term, the axis, the range and the mask of samples.
    SchemaError
        Omitted coefficients depend on each other in a loop; with its path.
    """
    allowed = (*database_coefficients(db), *HINGE)
    if coefficient not in allowed:
        raise UnknownName(coefficient, allowed, "coefficient")
    leaves: Mapping[str, xr.Dataset] = {}
    if coefficient in db.children:
        leaves = terms(db.children[coefficient])
    conditions = _add_coefficients(db, leaves, coefficient, conditions=conditions, outside=outside)
    parts = {}
    # Positions in tables of equal axes, shared by the terms.
    positions: dict[Any, Any] = {}
    for name, leaf in leaves.items():
        group, _, contribution = name.partition("/")
        if group != coefficient:
            continue
        try:
            parts[contribution] = _terms.evaluate_term(leaf, conditions, outside, positions)
        except OutOfRange as error:
            raise OutOfRange(f"{name}: {error}", error.mask) from None
        except UnknownName as error:
            hint = f"the term {name} needs it; pass it with the conditions"
            raise UnknownName(error.name, error.allowed, "condition", hint) from None
    return parts


def _add_coefficients(
    db: xr.DataTree,
    leaves: Mapping[str, xr.Dataset],
    coefficient: str,
    *,
    conditions: Mapping[str, Any],
    outside: str,
) -> Mapping[str, Any]:
    """Return conditions with the omitted coefficients that the terms of a coefficient need."""
    needed: set[str] = set()
    for name, leaf in leaves.items():
        if name.split("/")[0] == coefficient:
            needed.update(used_coefficients(leaf))
    missing = sorted(needed - {str(name) for name in conditions})
    if not missing:
        return conditions
    _, problems = evaluation_levels(terms(db), str(db.attrs["force_axes"]))
    if problems:
        raise SchemaError(f"database {db.attrs.get('title', '')!r}", problems)
    variables = {str(name): conditions[name] for name in conditions}
    computed = {name: evaluate_any(db, name, outside, variables) for name in missing}
    return variables | computed


def evaluate_any(
    db: xr.DataTree, name: str, outside: str, conditions: Mapping[str, Any]
) -> np.ndarray:
    """Return a coefficient; lift and drag of a database in body axes come from CX and CZ."""
    if name in database_coefficients(db):
        return evaluate(db, name, outside, **conditions)
    if "alpha" not in conditions:
        hint = f"{name} is made of CX and CZ with it; pass it with the conditions"
        raise UnknownName("alpha", map(str, conditions), "condition", hint)
    CX = evaluate(db, "CX", outside, **conditions)
    CZ = evaluate(db, "CZ", outside, **conditions)
    CL, CD = lift_drag(CX, CZ, np.asarray(conditions["alpha"], float))
    if name == "CL":
        return CL
    return CD


def evaluate(
    db: xr.DataTree, coefficient: str, outside: str = "raise", **conditions: Any
) -> np.ndarray:
    """Return a coefficient, the sum of its terms.

    Parameters
    ----------
    db, coefficient, outside
        As in `contributions`.
    **conditions : array or str
        Every variable the terms need; a text has its unit, as ``alpha="4 deg"``. [SI]

    Returns
    -------
    array (broadcast shape of the conditions used)
        The coefficient in the force axes of the database, moments in body axes about the moment
        reference point. [1]

    Raises
    ------
    UnknownName, OutOfRange
        As in `contributions`.
    """
    values: dict[str, Any] = {}
    for name, value in conditions.items():
        # Only the name of a text must be in the vocabulary, for its unit.
        if isinstance(value, str):
            value = value_in_si(value, lookup(name).units, name)
        values[name] = value
    parts = contributions(db, coefficient, values, outside)
    if not parts:
        return np.zeros(())
    return np.sum(np.stack(np.broadcast_arrays(*parts.values())), axis=0)


TOLERANCE = 1e-9  # of the largest magnitude of an output over the cases
SEED = 0
_ADVICE = (
    "the terms were changed or damaged; make the cases anew with aerodb.store.with_checks "
    "if the change is meant"
)
TERMS, _TOLERANCE = "terms", "_tolerance"  # group of contributions; end of the name of a tolerance
# Half the range of the samples of variables without a table: angles, and reduced rates.
_ANGLE = 0.35  # [rad]
_RATES = {"phat": 0.1, "qhat": 0.03, "rhat": 0.1, "alphadothat": 0.03, "betadothat": 0.1}
_FLOOR_MULTIPLES = (0.5, 1.0, 3.0, 20.0)  # samples of a power factor, in units of its floor
# Shares of the samples on a breakpoint and beyond the ends, and their largest distance from the
# ends, in parts of the range.
_ON, _BEYOND, _FAR = 0.1, 0.1, 0.1


def cruise_state(db: xr.DataTree) -> dict[str, Any]:
    """Return cruise conditions: every variable of the terms at zero, or the end next to it.

    Heights above ground are at the highest breakpoint, out of the ground effect. The flow is
    attached. Coefficients on which terms depend are not set: `evaluate_any` computes them.
    """
    state: dict[str, Any] = {"mach": 0.0, "alpha": 0.0}
    for leaf in terms(db).values():
        for variable in _terms.list_model_variables(leaf):
            if variable in _OF_ANY_AXES:
                continue
            value = ATTACHED_FLOW.get(variable, 0.0)
            if variable in leaf.dims:
                points = leaf[variable].values.astype(float)
                value = float(np.clip(value, points.min(), points.max()))
                if variable == "h_agl":
                    value = max(float(points.max()), float(state.get(variable, 0.0)))
            elif variable == "h_agl":
                value = _HIGH
            state[variable] = max(value, float(state.get(variable, value)))
    return state


def evaluate_held(db: xr.DataTree, coefficient: str, state: Mapping[str, Any]) -> np.ndarray:
    """Return a coefficient over a state; tables end with their last value."""
    size = np.size(state["alpha"])
    return np.broadcast_to(evaluate_any(db, coefficient, "clamp", state), (size,))


def with_checks(db: xr.DataTree, count: int = 20, seed: int = SEED) -> xr.DataTree:
    """Return a database with check cases in its group ``/checks``, which `save` and `open` run.

    Parameters
    ----------
    db, count, seed
        As in `export_checkcases`.
    """
    require_valid(db)
    inputs = random_states(db, count, seed)
    outputs = outputs_at(db, inputs, count)
    comment = (
        f"an implementation agrees within {TOLERANCE:g} of the largest magnitude of each output"
    )
    # Contributions such as CL/basic are grouped by coefficient; coefficients have an empty group.
    groups: dict[str, dict[str, np.ndarray]] = {}
    for name, values in outputs.items():
        coefficient, _, contribution = name.rpartition("/")
        groups.setdefault(coefficient, {})[contribution] = values
    columns = {**inputs, **groups.pop("")}
    states = xr.Dataset(
        {name: ("case", x, quantity_attributes(name)) for name, x in columns.items()},
        {"case": np.arange(1, count + 1)},
        {"seed": seed, "comment": comment},
    )
    nodes = {}
    for node in db.subtree:
        if node.path.split("/")[1] != CHECKS:
            nodes[node.path] = node.to_dataset(inherit=False)
    nodes[f"/{CHECKS}"] = states
    for coefficient, group in groups.items():
        variables = {name: ("case", x) for name, x in group.items()}
        nodes[f"/{CHECKS}/{TERMS}/{coefficient}"] = xr.Dataset(variables)
    return xr.DataTree.from_dict(nodes)


def failing_checks(db: xr.DataTree) -> list[str]:
    """Return a text for each output of the check cases that a database does not reproduce.

    The list is empty without the group ``/checks``.  A case without a value of some input, as in a
    database from another source, is skipped.
    """
    if CHECKS not in db.children:
        return []
    group = db.children[CHECKS]
    # Inputs, coefficients and tolerances of the cases are variables over the axis ``case``.
    columns = {}
    for name, variable in group.data_vars.items():
        if variable.dims == ("case",):
            columns[str(name)] = variable.values.astype(float)
    needed = check_case_inputs(db)
    if not set(needed) <= set(columns):
        return []
    complete = np.ones(group.sizes["case"], bool)
    for name in needed:
        complete &= np.isfinite(columns[name])
    expected = {}
    for name in (*database_coefficients(db), *HINGE):
        if name in columns:
            expected[name] = columns[name]
    for coefficient, node in group.children.get(TERMS, xr.DataTree()).children.items():
        for name, variable in node.data_vars.items():
            expected[f"{coefficient}/{name}"] = variable.values
    cases, count = group.coords["case"].values[complete], int(complete.sum())
    outputs = outputs_at(db, {name: columns[name][complete] for name in needed}, count)
    problems = []
    for name, values in expected.items():
        allowed = columns.get(f"{name}{_TOLERANCE}")
        if allowed is not None:
            allowed = allowed[complete]
        row = compare_output(outputs.get(name, np.zeros(count)), values[complete], allowed)
        if not row["agrees"]:
            text = (
                f"{name} differs by {row['largest_difference']:.3g} in case "
                f"{cases[row['case'] - 1]}"
            )
            problems.append(f"{CHECKS}: {text} ({row['failed']} of {count} cases fail); {_ADVICE}")
    return problems


def check_case_inputs(db: xr.DataTree) -> list[str]:
    """Return the inputs of the cases: all variables of the terms except the coefficients."""
    variables: set[str] = set()
    for leaf in terms(db).values():
        variables.update(_terms.list_model_variables(leaf))
    return sorted(variables - set(database_coefficients(db)))


def compare_output(
    found: np.ndarray, expected: np.ndarray, allowed: np.ndarray | None = None
) -> dict[str, Any]:
    """Return the agreement of an output with its expected values.

    Parameters
    ----------
    found, expected : array (cases,)
        An expected value of NaN is not compared.
    allowed : array (cases,), optional
        Tolerance of each case; by default `TOLERANCE` of the largest expected magnitude.

    Returns
    -------
    dict
        ``largest_difference``, ``case`` (from 1) and ``tolerance`` of the worst case; ``failed``
        (number of cases), ``agrees``.  The worst case is one that fails, if any does.
    """
    is_stated = np.isfinite(expected)
    tolerance = allowed
    if tolerance is None:
        largest = np.abs(expected[is_stated]).max(initial=0.0)
        tolerance = np.full(len(expected), TOLERANCE * largest)
    difference = np.where(is_stated, found - expected, 0.0)
    # The negation also catches a difference of NaN.
    fails = ~(np.abs(difference) <= tolerance) & is_stated
    result = {"largest_difference": 0.0, "case": 0, "tolerance": 0.0}
    if len(expected):
        size = np.abs(difference)
        if fails.any():
            size = size * fails
        worst = int(np.argmax(size))
        result = {
            "largest_difference": float(difference[worst]),
            "case": worst + 1,
            "tolerance": float(tolerance[worst]),
        }
    return {**result, "failed": int(fails.sum()), "agrees": not fails.any()}


def outputs_at(
    db: xr.DataTree, inputs: Mapping[str, np.ndarray], count: int
) -> dict[str, np.ndarray]:
    """Return contributions by name of the term, then the coefficients, each (cases,)."""
    coefficients = dict.fromkeys(database_coefficients(db))
    coefficients.update(dict.fromkeys(name.partition("/")[0] for name in terms(db)))
    parts: dict[str, np.ndarray] = {}
    sums: dict[str, np.ndarray] = {}
    for coefficient in coefficients:
        columns = {}
        for name, x in contributions(db, coefficient, inputs, outside="clamp").items():
            columns[f"{coefficient}/{name}"] = np.broadcast_to(x, count)
        sums[coefficient] = np.zeros(count)
        if columns:
            sums[coefficient] = np.sum(np.stack([*columns.values()]), axis=0)
        parts |= columns
    return {**parts, **sums}


def random_states(db: xr.DataTree, count: int, seed: int) -> dict[str, np.ndarray]:
    """Return the model variables of a database at random cases, by name. [SI]"""
    if count < 1:
        raise SchemaError("check cases", [f"count is {count}; at least one case is needed"])
    rng = np.random.default_rng(seed)
    leaves = terms(db).values()
    points: dict[str, np.ndarray] = {}
    # Breakpoints of every variable in all tables.
    for leaf in leaves:
        for axis in map(str, leaf.dims):
            points[axis] = np.union1d(points.get(axis, []), leaf[axis].values.astype(float))
        power = _terms.power_factor(leaf)
        if power is not None:
            heights = power.floor * np.array(_FLOOR_MULTIPLES)
            points[power.variable] = np.union1d(points.get(power.variable, []), heights)
    states = {}
    for name in check_case_inputs(db):
        if name not in points:
            points[name] = _default_range(name)
        states[name] = _draw_samples(points[name], count, rng)
    return states or {"alpha": np.zeros(count)}


def _default_range(name: str) -> np.ndarray:
    """Return the ends of the samples of a variable that is not an axis of any table."""
    if name in _RATES:
        return np.array([-_RATES[name], _RATES[name]])
    if lookup(name).units == "rad":
        return np.array([-_ANGLE, _ANGLE])
    return np.array([0.0, 1.0])


def _draw_samples(points: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return samples in every cell, on the breakpoints and beyond the ends.

    Each cell has the same probability, whatever its width.
    """
    if len(points) == 1:
        return np.full(count, points[0])
    # The order of the draws must not change: the same seed gives the same cases.
    kind = rng.random(count)
    cell = rng.integers(len(points) - 1, size=count)
    part = rng.random(count)
    inside = points[cell] + part * (points[cell + 1] - points[cell])
    step = _FAR * part * (points[-1] - points[0])
    below = points[0] - step
    # A Mach number or a height is never negative.
    if points[0] >= 0:
        below = np.maximum(below, 0.0)
    outside = np.where(rng.random(count) < 0.5, below, points[-1] + step)
    return np.select([kind < _ON, kind < _ON + _BEYOND], [points[cell], outside], inside)
