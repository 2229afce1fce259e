"""Check cases that travel with a database: made, and tried when it is opened."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.errors import SchemaError
from flightmech.names import attrs, lookup
from flightmech.support.input_files.tree_files import CHECKS

from .evaluation import contributions
from .schema import HINGE, coefficients, require, terms

TOLERANCE = 1e-9  # of the largest magnitude of an output over the cases
SEED = 0
_ADVICE = "the terms were changed or damaged; make the cases anew with aerodb.store.with_checks if the change is meant"
TERMS, _TOLERANCE = "terms", "_tolerance"  # group of contributions; end of the name of a tolerance
_ANGLE = 0.35  # [rad] of regressors without a table
_RATES = {"phat": 0.1, "qhat": 0.03, "rhat": 0.1, "alphadothat": 0.03, "betadothat": 0.1}  # of regressors without a table
_OF_FLOOR = (0.5, 1.0, 3.0, 20.0)  # where a power factor is asked, in parts of its floor
_ON, _BEYOND, _FAR = 0.1, 0.1, 0.1  # shares of the samples on a breakpoint and beyond the ends; how far beyond, in parts of the range


def with_checks(db: xr.DataTree, count: int = 20, seed: int = SEED) -> xr.DataTree:
    """Return a database that carries check cases in its group ``/checks``; `save` and `open` run them.

    Parameters
    ----------
    db, count, seed
        As in `export_checkcases`.
    """
    require(db)
    inputs = random_states(db, count, seed)
    outputs = outputs_at(db, inputs, count)
    about = {"seed": seed, "comment": f"an implementation agrees within {TOLERANCE:g} of the largest magnitude of each output"}
    groups: dict[str, dict[str, np.ndarray]] = {}
    for name, values in outputs.items():
        coefficient, _, last = name.rpartition("/")
        groups.setdefault(coefficient, {})[last] = values
    sums = groups.pop("")
    states = xr.Dataset(
        {name: ("case", x, attrs(name)) for name, x in {**inputs, **sums}.items()}, {"case": np.arange(1, count + 1)}, about
    )
    parts = {f"/{CHECKS}/{TERMS}/{key}": xr.Dataset({name: ("case", x) for name, x in group.items()}) for key, group in groups.items()}
    kept = {node.path: node.to_dataset(inherit=False) for node in db.subtree if node.path.split("/")[1] != CHECKS}
    return xr.DataTree.from_dict({**kept, f"/{CHECKS}": states, **parts})


def failing_checks(db: xr.DataTree) -> list[str]:
    """Return which of the check cases in a database it does not meet; none without the group ``/checks``.

    A case that lacks an input, as one of another source may, is left out.
    """
    if CHECKS not in db.children:
        return []
    group = db.children[CHECKS]
    columns = {str(name): x.values.astype(float) for name, x in group.data_vars.items() if x.dims == ("case",)}
    needed = needed_inputs(db)
    if not set(needed) <= set(columns):
        return []
    run = np.all([np.isfinite(columns[name]) for name in needed], axis=0) if needed else np.ones(group.sizes["case"], bool)
    expected = {name: columns[name] for name in (*coefficients(db), *HINGE) if name in columns}
    for coefficient, node in group.children.get(TERMS, xr.DataTree()).children.items():
        expected |= {f"{coefficient}/{name}": x.values for name, x in node.data_vars.items()}
    cases, count = group.coords["case"].values[run], int(run.sum())
    found = outputs_at(db, {name: columns[name][run] for name in needed}, count)
    problems = []
    for name, values in expected.items():
        allowed = columns.get(f"{name}{_TOLERANCE}")
        row = agreement(found.get(name, np.zeros(count)), values[run], None if allowed is None else allowed[run])
        if not row["agrees"]:
            text = f"{name} differs by {row['largest_difference']:.3g} in case {cases[row['case'] - 1]}"
            problems.append(f"{CHECKS}: {text} ({row['failed']} of {count} cases fail); {_ADVICE}")
    return problems


def needed_inputs(db: xr.DataTree) -> list[str]:
    """Return the inputs of the cases: all variables of the terms but the coefficients, which the terms themselves give."""
    found = {name for leaf in terms(db).values() for name in _terms.variables(leaf)}
    return sorted(found - set(coefficients(db)))


def agreement(found: np.ndarray, expected: np.ndarray, allowed: np.ndarray | None = None) -> dict[str, Any]:
    """Return how an output agrees with what is expected, NaN where nothing is; the worst case is one that fails, if any does."""
    stated = np.isfinite(expected)
    tolerance = np.full(len(expected), TOLERANCE * np.abs(expected[stated]).max(initial=0.0)) if allowed is None else allowed
    difference = np.where(stated, found - expected, 0.0)
    beyond = ~(np.abs(difference) <= tolerance) & stated
    at = int(np.argmax(np.abs(difference) * (beyond if beyond.any() else 1.0))) if len(expected) else None
    worst = {"largest_difference": 0.0, "case": 0, "tolerance": 0.0}
    if at is not None:
        worst = {"largest_difference": float(difference[at]), "case": at + 1, "tolerance": float(tolerance[at])}
    return {**worst, "failed": int(beyond.sum()), "agrees": not beyond.any()}


def outputs_at(db: xr.DataTree, inputs: Mapping[str, np.ndarray], count: int) -> dict[str, np.ndarray]:
    """Return contributions by name of the term, then the coefficients, each (cases,)."""
    parts: dict[str, np.ndarray] = {}
    sums: dict[str, np.ndarray] = {}
    for coefficient in dict.fromkeys([*coefficients(db), *(name.partition("/")[0] for name in terms(db))]):
        found = contributions(db, coefficient, inputs, outside="clamp")
        columns = {f"{coefficient}/{name}": np.broadcast_to(x, count) for name, x in found.items()}
        sums[coefficient] = np.sum(np.stack([*columns.values()]), axis=0) if columns else np.zeros(count)
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
        power = _terms.power(leaf)
        if power is not None:
            points[power.variable] = np.union1d(points.get(power.variable, []), power.floor * np.array(_OF_FLOOR))
    return {name: _samples(points[name] if name in points else _span(name), count, rng) for name in needed_inputs(db)} or {
        "alpha": np.zeros(count)
    }


def _span(name: str) -> np.ndarray:
    half = _RATES.get(name, _ANGLE if lookup(name).units == "rad" else 0.0)
    return np.array([-half, half]) if half else np.array([0.0, 1.0])


def _samples(points: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return samples that see every cell, whatever its width, the breakpoints, and what lies beyond the ends."""
    if len(points) == 1:
        return np.full(count, points[0])
    kind, cell, part = rng.random(count), rng.integers(len(points) - 1, size=count), rng.random(count)
    inside = points[cell] + part * (points[cell + 1] - points[cell])
    step = _FAR * part * (points[-1] - points[0])
    below = points[0] - step if points[0] < 0 else np.maximum(points[0] - step, 0.0)  # a Mach number or a height is never negative
    beyond = np.where(rng.random(count) < 0.5, below, points[-1] + step)
    return np.select([kind < _ON, kind < _ON + _BEYOND], [points[cell], beyond], inside)
