"""Two databases side by side: term by term over their nodes, coefficient by coefficient along conditions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech import terms as _terms
from flightmech.names import lookup
from flightmech.units import from_si

from .evaluation import evaluate
from .schema import coefficients, terms

COLUMNS = ("found_in", "max_difference", "rms_difference", "max_in_stderr", "location", "note")


def compare(a: xr.DataTree, b: xr.DataTree, conditions: Mapping[str, Any] | None = None) -> pd.DataFrame:
    """Return the differences b - a of two databases.

    Parameters
    ----------
    a, b : DataTree
        The databases.
    conditions : mapping of str to array, optional
        Along these conditions the coefficients are compared too, one row each, after the terms; beyond a table both follow
        the rule of the leaf, as the simulation does. [SI]

    Returns
    -------
    DataFrame, index ``term``
        ``found_in`` (``both``, ``a``, ``b``; ``conditions`` for coefficients); ``max_difference``, signed, and ``rms_difference``
        of the table, regressors left out, over the union of the nodes of both (a term that is missing counts as zero);
        ``max_in_stderr``, the largest difference in standard errors of `a` (of `b` where `a` lacks the term), nodes without
        standard error left out, NaN without any; ``location``, where the largest difference stands; ``note``.

    Notes
    -----
    Both tables are multilinear, so over the union of the breakpoints of shared axes no larger difference hides between nodes.
    """
    ours, theirs = terms(a), terms(b)
    rows = {name: _term_row(ours.get(name), theirs.get(name)) for name in [*ours, *(n for n in theirs if n not in ours)]}
    if conditions is not None:
        for coefficient in coefficients(a):
            if coefficient in coefficients(b):
                rows[coefficient] = _coefficient_row(a, b, coefficient, conditions)
    return pd.DataFrame.from_dict(rows, orient="index", columns=list(COLUMNS)).rename_axis("term")


def _term_row(ours: xr.Dataset | None, theirs: xr.Dataset | None) -> tuple:
    found_in = "both" if ours is not None and theirs is not None else "a" if theirs is None else "b"
    first = ours if ours is not None else theirs
    assert first is not None
    second = theirs if ours is not None else None
    if second is not None and sorted(_terms.regressors(first)) != sorted(_terms.regressors(second)):
        here_and_there = (" ".join(_terms.regressors(leaf)) or "none" for leaf in (first, second))
        note = "regressors differ: {} in a, {} in b".format(*here_and_there)
        return found_in, np.nan, np.nan, np.nan, "", note
    points = _union(first, second)
    mesh = dict(zip(points, np.meshgrid(*points.values(), indexing="ij"))) if points else {}
    shape = tuple(len(p) for p in points.values())
    here = np.broadcast_to(_table(first, mesh), shape)
    other = np.broadcast_to(_table(second, mesh), shape) if second is not None else np.zeros(shape)
    difference = other - here if found_in != "b" else here
    stderr = np.broadcast_to(np.abs(_table(first, mesh, "stderr")), shape) if "stderr" in first else np.zeros(shape)
    worst = np.unravel_index(np.argmax(np.abs(difference)), shape) if shape else ()
    known = stderr > 0
    in_stderr = float(np.max(np.abs(difference[known]) / stderr[known])) if known.any() else np.nan
    at = ", ".join(f"{axis} {readable(axis, mesh[axis][worst])}" for axis in points)
    return found_in, float(difference[worst]), float(np.sqrt(np.mean(difference**2))), in_stderr, at, ""


def _union(*leaves: xr.Dataset | None) -> dict[str, np.ndarray]:
    """Return the breakpoints of all axes of several leaves, merged axis by axis."""
    points: dict[str, np.ndarray] = {}
    tables = [leaf[name] for leaf in leaves if leaf is not None for name in ("value", "K1", "K2") if name in leaf]
    for table in tables:
        for axis in map(str, table.dims):
            points[axis] = np.union1d(points.get(axis, []), table[axis].values)
    return points


def _table(leaf: xr.Dataset, mesh: Mapping[str, np.ndarray], variable: str = "value") -> np.ndarray:
    """Return a variable of the leaf times K1 and K2 on a mesh, the leaf's own rule beyond its nodes."""
    return _terms.evaluate(leaf.assign(value=leaf[variable]).assign_attrs(regressors=""), mesh, "clamp")


def _coefficient_row(a: xr.DataTree, b: xr.DataTree, coefficient: str, conditions: Mapping[str, Any]) -> tuple:
    given = {str(name): conditions[name] for name in conditions}
    difference = np.atleast_1d(evaluate(b, coefficient, "clamp", **given) - evaluate(a, coefficient, "clamp", **given))
    worst = int(np.argmax(np.abs(difference)))
    return "conditions", float(difference.flat[worst]), float(np.sqrt(np.mean(difference**2))), np.nan, f"sample {worst}", ""


def readable(name: str, value: float) -> str:
    """Return a value in the display unit of a quantity, ``12 deg``."""
    unit = lookup(name).display_units
    return f"{from_si(float(value), unit):.4g}{'' if unit == '1' else f' {unit}'}"
