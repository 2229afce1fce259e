"""Check cases that travel with a database: made, and tried when it is opened."""

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
from flightmech.names import lookup, quantity_attributes
from flightmech.support.netcdf_trees import CHECKS


def contributions(
    db: xr.DataTree, coefficient: str, conditions: Mapping[str, Any], outside: str = "raise"
) -> dict[str, np.ndarray]:
    """Return what each term adds to a coefficient.

    Parameters
    ----------
    db : DataTree
        The database.
    coefficient : str
        One of the database's coefficients, such as ``"CL"``, or a hinge moment, such as ``"Ch_e"``.
    conditions : mapping of str to array
        Every variable the terms need, broadcast against each other; a Dataset of a manoeuvre will
        do.  Coefficients that the terms depend on, such as ``CL`` in a drag polar, may be left out:
        they are the sums of their own terms then, as in the simulation. [SI]
    outside : {"raise", "clamp"}
        Beyond a table: raise, or follow the rule of the leaf as the simulation does.

    Returns
    -------
    dict of str to array
        By contribution: ``{"basic": ..., "flap": ...}``; each has the shape of the variables that
        term uses. [1]

    Raises
    ------
    UnknownName
        The coefficient, or a variable that is missing in `conditions`.
    OutOfRange
        With the name of the term, the axis, the range and the mask of samples.
    SchemaError
        Coefficients that are not given depend on each other in a loop, with its path.
    """
    allowed = (*database_coefficients(db), *HINGE)
    if coefficient not in allowed:
        raise UnknownName(coefficient, allowed, "coefficient")
    leaves = terms(db.children[coefficient]) if coefficient in db.children else {}
    conditions = _with_coefficients(db, leaves, coefficient, conditions, outside)
    found = {}
    places: dict[Any, Any] = {}
    for name, leaf in leaves.items():
        group, _, contribution = name.partition("/")
        if group != coefficient:
            continue
        try:
            found[contribution] = _terms.evaluate_term(leaf, conditions, outside, places)
        except OutOfRange as error:
            raise OutOfRange(f"{name}: {error}", error.mask) from None
        except UnknownName as error:
            raise UnknownName(
                error.name,
                error.allowed,
                "condition",
                f"the term {name} needs it; pass it with the conditions",
            ) from None
    return found


def _with_coefficients(
    db: xr.DataTree,
    leaves: Mapping[str, xr.Dataset],
    coefficient: str,
    conditions: Mapping[str, Any],
    outside: str,
) -> Mapping[str, Any]:
    """Return conditions with the coefficients that the terms `leaves` of a coefficient depend on
    and that are not given.
    """
    wanted = {
        word
        for name, leaf in leaves.items()
        if name.split("/")[0] == coefficient
        for word in used_coefficients(leaf)
    }
    missing = sorted(wanted - {str(name) for name in conditions})
    if not missing:
        return conditions
    _, problems = evaluation_levels(terms(db), str(db.attrs["force_axes"]))
    if problems:
        raise SchemaError(f"database {db.attrs.get('title', '')!r}", problems)
    found = {str(name): conditions[name] for name in conditions}
    return found | {name: _coefficient(db, name, outside, found) for name in missing}


def _coefficient(
    db: xr.DataTree, name: str, outside: str, conditions: Mapping[str, Any]
) -> np.ndarray:
    """Return a coefficient, lift and drag of a database in body axes from its axial and normal
    force.
    """
    if name in database_coefficients(db):
        return evaluate(db, name, outside, **conditions)
    if "alpha" not in conditions:
        raise UnknownName(
            "alpha",
            map(str, conditions),
            "condition",
            f"{name} is made of CX and CZ with it; pass it with the conditions",
        )
    CX, CZ = (evaluate(db, part, outside, **conditions) for part in ("CX", "CZ"))
    CL, CD = lift_drag(CX, CZ, np.asarray(conditions["alpha"], float))
    return CL if name == "CL" else CD


def evaluate(
    db: xr.DataTree, coefficient: str, outside: str = "raise", **conditions: Any
) -> np.ndarray:
    """Return a coefficient, the sum of its terms.

    Parameters
    ----------
    db, coefficient, outside
        As in `contributions`.
    **conditions : array
        Every variable the terms need. [SI]

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
    parts = contributions(db, coefficient, conditions, outside)
    return np.sum(np.stack(np.broadcast_arrays(*parts.values())), axis=0) if parts else np.zeros(())


TOLERANCE = 1e-9  # of the largest magnitude of an output over the cases
SEED = 0
_ADVICE = (
    "the terms were changed or damaged; make the cases anew with aerodb.store.with_checks "
    "if the change is meant"
)
TERMS, _TOLERANCE = "terms", "_tolerance"  # group of contributions; end of the name of a tolerance
_ANGLE = 0.35  # [rad] of regressors without a table
_RATES = {
    "phat": 0.1,
    "qhat": 0.03,
    "rhat": 0.1,
    "alphadothat": 0.03,
    "betadothat": 0.1,
}  # of regressors without a table
_OF_FLOOR = (0.5, 1.0, 3.0, 20.0)  # where a power factor is asked, in parts of its floor
_ON, _BEYOND, _FAR = (
    0.1,
    0.1,
    0.1,
)  # shares of the samples on a breakpoint and beyond the ends; how far beyond, in parts of the range


def with_checks(db: xr.DataTree, count: int = 20, seed: int = SEED) -> xr.DataTree:
    """Return a database that carries check cases in its group ``/checks``; `save` and `open` run
    them.

    Parameters
    ----------
    db, count, seed
        As in `export_checkcases`.
    """
    require_valid(db)
    inputs = random_states(db, count, seed)
    outputs = outputs_at(db, inputs, count)
    about = {
        "seed": seed,
        "comment": f"an implementation agrees within {TOLERANCE:g} of the largest magnitude of "
        f"each output",
    }
    groups: dict[str, dict[str, np.ndarray]] = {}
    for name, values in outputs.items():
        coefficient, _, last = name.rpartition("/")
        groups.setdefault(coefficient, {})[last] = values
    sums = groups.pop("")
    states = xr.Dataset(
        {name: ("case", x, quantity_attributes(name)) for name, x in {**inputs, **sums}.items()},
        {"case": np.arange(1, count + 1)},
        about,
    )
    parts = {
        f"/{CHECKS}/{TERMS}/{key}": xr.Dataset({name: ("case", x) for name, x in group.items()})
        for key, group in groups.items()
    }
    kept = {
        node.path: node.to_dataset(inherit=False)
        for node in db.subtree
        if node.path.split("/")[1] != CHECKS
    }
    return xr.DataTree.from_dict({**kept, f"/{CHECKS}": states, **parts})


def failing_checks(db: xr.DataTree) -> list[str]:
    """Return which of the check cases in a database it does not meet; none without the group
    ``/checks``.

    A case that lacks an input, as one of another source may, is left out.
    """
    if CHECKS not in db.children:
        return []
    group = db.children[CHECKS]
    columns = {
        str(name): x.values.astype(float)
        for name, x in group.data_vars.items()
        if x.dims == ("case",)
    }
    needed = check_case_inputs(db)
    if not set(needed) <= set(columns):
        return []
    run = (
        np.all([np.isfinite(columns[name]) for name in needed], axis=0)
        if needed
        else np.ones(group.sizes["case"], bool)
    )
    expected = {
        name: columns[name] for name in (*database_coefficients(db), *HINGE) if name in columns
    }
    for coefficient, node in group.children.get(TERMS, xr.DataTree()).children.items():
        expected |= {f"{coefficient}/{name}": x.values for name, x in node.data_vars.items()}
    cases, count = group.coords["case"].values[run], int(run.sum())
    found = outputs_at(db, {name: columns[name][run] for name in needed}, count)
    problems = []
    for name, values in expected.items():
        allowed = columns.get(f"{name}{_TOLERANCE}")
        row = compare_output(
            found.get(name, np.zeros(count)), values[run], None if allowed is None else allowed[run]
        )
        if not row["agrees"]:
            text = (
                f"{name} differs by {row['largest_difference']:.3g} in case "
                f"{cases[row['case'] - 1]}"
            )
            problems.append(f"{CHECKS}: {text} ({row['failed']} of {count} cases fail); {_ADVICE}")
    return problems


def check_case_inputs(db: xr.DataTree) -> list[str]:
    """Return the inputs of the cases: all variables of the terms but the coefficients, which the
    terms themselves give.
    """
    found = {name for leaf in terms(db).values() for name in _terms.list_model_variables(leaf)}
    return sorted(found - set(database_coefficients(db)))


def compare_output(
    found: np.ndarray, expected: np.ndarray, allowed: np.ndarray | None = None
) -> dict[str, Any]:
    """Return how an output agrees with what is expected, NaN where nothing is; the worst case is
    one that fails, if any does.
    """
    stated = np.isfinite(expected)
    tolerance = (
        np.full(len(expected), TOLERANCE * np.abs(expected[stated]).max(initial=0.0))
        if allowed is None
        else allowed
    )
    difference = np.where(stated, found - expected, 0.0)
    beyond = ~(np.abs(difference) <= tolerance) & stated
    at = (
        int(np.argmax(np.abs(difference) * (beyond if beyond.any() else 1.0)))
        if len(expected)
        else None
    )
    worst = {"largest_difference": 0.0, "case": 0, "tolerance": 0.0}
    if at is not None:
        worst = {
            "largest_difference": float(difference[at]),
            "case": at + 1,
            "tolerance": float(tolerance[at]),
        }
    return {**worst, "failed": int(beyond.sum()), "agrees": not beyond.any()}


def outputs_at(
    db: xr.DataTree, inputs: Mapping[str, np.ndarray], count: int
) -> dict[str, np.ndarray]:
    """Return contributions by name of the term, then the coefficients, each (cases,)."""
    parts: dict[str, np.ndarray] = {}
    sums: dict[str, np.ndarray] = {}
    for coefficient in dict.fromkeys(
        [*database_coefficients(db), *(name.partition("/")[0] for name in terms(db))]
    ):
        found = contributions(db, coefficient, inputs, outside="clamp")
        columns = {f"{coefficient}/{name}": np.broadcast_to(x, count) for name, x in found.items()}
        sums[coefficient] = (
            np.sum(np.stack([*columns.values()]), axis=0) if columns else np.zeros(count)
        )
        parts |= columns
    return {**parts, **sums}


def random_states(db: xr.DataTree, count: int, seed: int) -> dict[str, np.ndarray]:
    """Return the model variables of a database at random cases, by name. [SI]"""
    if count < 1:
        raise SchemaError("check cases", [f"count is {count}; at least one case is needed"])
    rng = np.random.default_rng(seed)
    leaves = terms(db).values()
    points: dict[str, np.ndarray] = {}
    for leaf in leaves:
        for axis in map(str, leaf.dims):
            points[axis] = np.union1d(points.get(axis, []), leaf[axis].values.astype(float))
        power = _terms.power_factor(leaf)
        if power is not None:
            points[power.variable] = np.union1d(
                points.get(power.variable, []), power.floor * np.array(_OF_FLOOR)
            )
    return {
        name: _samples(points[name] if name in points else _span(name), count, rng)
        for name in check_case_inputs(db)
    } or {"alpha": np.zeros(count)}


def _span(name: str) -> np.ndarray:
    half = _RATES.get(name, _ANGLE if lookup(name).units == "rad" else 0.0)
    return np.array([-half, half]) if half else np.array([0.0, 1.0])


def _samples(points: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return samples that see every cell, whatever its width, the breakpoints, and what lies beyond
    the ends.
    """
    if len(points) == 1:
        return np.full(count, points[0])
    kind, cell, part = (
        rng.random(count),
        rng.integers(len(points) - 1, size=count),
        rng.random(count),
    )
    inside = points[cell] + part * (points[cell + 1] - points[cell])
    step = _FAR * part * (points[-1] - points[0])
    below = (
        points[0] - step if points[0] < 0 else np.maximum(points[0] - step, 0.0)
    )  # a Mach number or a height is never negative
    beyond = np.where(rng.random(count) < 0.5, below, points[-1] + step)
    return np.select([kind < _ON, kind < _ON + _BEYOND], [points[cell], beyond], inside)
