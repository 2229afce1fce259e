"""Move of the moment reference point of a database.

A force term contributes c e to the force in body axes, with e the direction of its coefficient.  If
the old point lies at d from the new one, the moment coefficients increase by d x e c /
length.  This holds for every force term by itself, for increments, controls and derivatives with
respect to rates, whatever multiplies them.  In stability axes e turns with alpha, in wind axes with
alpha and beta.  A table cannot follow this between its breakpoints exactly.  Breakpoints are added
until the error bound holds:

    |f - multilinear| <= h^2/8 max|f''|
    |f''| <= (2 |T'| + |T|) R,   R = |d| / length, T the table of the force.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from aerodb.edit.levers import MOMENTS, Lever
from aerodb.store.effects import Effect, rate_shift
from aerodb.store.grids import (
    add_leaves,
    factor_axes,
    fold_factors,
    merge_breakpoints,
    regrid_leaf,
    same_factors,
    union_axes,
    value_breakpoints,
    with_table,
    without_formula,
)
from aerodb.store.schema import FORCE_AXES, terms
from aerodb.store.undo_history import (
    add_history_line,
    last_edit,
    note_suffix,
    record_edit,
    undo_edits,
    update_absent,
)
from flightmech import terms as _terms
from flightmech.errors import SchemaError

_LENGTHS = {"Cl": "b", "Cm": "cbar", "Cn": "b"}
_KEYS = ("x_ref", "y_ref", "z_ref")
# Range of an angle that no table of the database has. [rad]
_FULL_RANGE = np.array([-0.5 * np.pi, 0.5 * np.pi])
_VERB = "move_reference"


def move_reference(
    db: xr.DataTree,
    point: Sequence[float],
    *,
    tolerance: float = 1e-3,
    flow: str = "kept",
    note: str = "",
) -> xr.DataTree:
    """Return a database with its moments about another point.

    Parameters
    ----------
    db : DataTree
        The database; it does not change.
    point : (3,)
        The new moment reference point from the drawing datum: x forward, y right, z down, as
        ``x_ref y_ref z_ref``. [m]
    tolerance : float
        Largest error between breakpoints of the moment of a force term.  It is a share of the
        moment about the new point of the largest force of the same coefficient and regressors.  The
        moment is exact at breakpoints.
    flow : {"kept", "moved"}
        Point of V, alpha and beta.  ``kept``: they refer to the c.g. as before; a simulation of the
        same aeroplane does not change.  ``moved``: they refer to the new point, as in
        `from_datcom`.  Then the derivatives with respect to ``qhat``, ``phat`` and ``rhat`` also
        change by `aerodb.store.effects.rate_shift` of the terms ``basic`` and ``beta``.
    note : str, optional
        Reason for the change; stored in the history.

    Returns
    -------
    DataTree
        The moments of a force term are added to the terms of the same name of Cl, Cm, Cn.  A
        missing term is made.  If its regressors or its rule ``outside`` differ, a term with
        ``_moved`` behind its name is made.  Standard errors of force and moment count as
        independent.  The breakpoints of ``h_agl`` move by the change in height of the point on a
        level aeroplane.  Hinge moments do not change.

    Raises
    ------
    SchemaError
        A point that is not three finite numbers, a table that would have too many axes, a power of
        the height over the runway when the point changes its height, an unknown `flow`, or
        ``"moved"`` with other than stability axes, or out of the plane of symmetry.

    Notes
    -----
    Repeated moves start from the tables before the first of them while these are in the undo
    history.  They therefore do not accumulate breakpoints and standard errors, and a move back
    restores the tables to the last bit.  The aircraft file must state the same point, from which
    all its positions count.
    """
    new, old = _check_arguments(db, point, tolerance, flow), _reference_point(db)
    base = _before_moves(db, flow)
    # Vector from the new point to the old one, as in the module docstring.
    d, leaves = _reference_point(base) - new, terms(base)
    summary = f"from ({_format_point(old)}) to ({_format_point(new)}) m"
    if flow == "moved":
        summary = f"{summary}, flow angles with it"
    _demand_movable_heights(leaves, float(d[2]))
    if d.any():
        line = f"{_VERB}: {summary}{note_suffix(note)}"
        leaves = _move_terms(leaves, base.attrs, d, tolerance=tolerance, flow=flow, line=line)
    # Terms absent from the database before all moves, less those that this move makes.
    attributes = {}
    if "absent" in base.attrs:
        attributes["absent"] = base.attrs["absent"]
    attributes |= update_absent(base, without=leaves)
    attributes |= dict(zip(_KEYS, map(float, new)))
    return record_edit(
        db, leaves, _VERB, summary=summary, note=note, attributes=attributes, flow=flow
    )


def _move_terms(
    leaves: Mapping[str, xr.Dataset],
    root: Mapping[Any, Any],
    d: np.ndarray,
    *,
    tolerance: float,
    flow: str,
    line: str,
) -> dict[str, xr.Dataset]:
    """Return all terms about the new point, the changed ones with a line of history."""
    new = _transfer_forces(leaves, root, d, tolerance)
    if flow == "moved":
        new = _add_rate_changes(new, root, d)
    for name, leaf in new.items():
        leaf = _shift_heights(leaf, float(d[2]))
        if leaf is not leaves.get(name):
            leaf = add_history_line(leaf, line)
        new[name] = leaf
    return new


def _before_moves(db: xr.DataTree, flow: str) -> xr.DataTree:
    """Return a database before the moves of the same kind that were its last edits."""
    # Undo as long as the last edit is such a move.
    while last_edit(db).get("verb") == _VERB and last_edit(db)["flow"] == flow:
        db = undo_edits(db)
    return db


def _check_arguments(
    db: xr.DataTree, point: Sequence[float], tolerance: float, flow: str
) -> np.ndarray:
    """Return the new point as an array; raise with all faults of the arguments."""
    new = np.asarray(point, float)
    problems = []
    if new.shape != (3,) or not np.isfinite(new).all():
        problems.append(
            f"point is {point!r}; give x, y, z from the drawing datum, three finite numbers in m"
        )
    if not 0.0 < tolerance < 1.0:
        problems.append(
            f"tolerance is {tolerance!r}; give a share of the moment between 0 and 1, such as 1e-3"
        )
    if flow not in ("kept", "moved"):
        problems.append(f"flow is {flow!r}; allowed: kept, moved")
    if flow == "moved" and db.attrs["force_axes"] != "stability":
        problems.append(
            f"flow='moved' is for force axes 'stability', the database has "
            f"{db.attrs['force_axes']!r}"
        )
    if flow == "moved" and not problems and new[1] != _reference_point(db)[1]:
        problems.append(
            "flow='moved' is for points in one plane parallel to that of symmetry; keep y"
        )
    if problems:
        raise SchemaError(_VERB, problems)
    return new


def _transfer_forces(
    leaves: Mapping[str, xr.Dataset], root: Mapping[str, Any], d: np.ndarray, tolerance: float
) -> dict[str, xr.Dataset]:
    """Return all terms with the moments of the forces about the new point."""
    axes = str(root["force_axes"])
    ranges = {angle: _angle_range(leaves, angle) for angle in ("alpha", "beta")}
    # Largest force with the same coefficient and the same regressors: the scale of the tolerance.
    largest: dict[tuple[Any, ...], float] = {}
    for name, leaf in leaves.items():
        kind = _force_kind(name, leaf)
        largest[kind] = max(largest.get(kind, 0.0), _largest_value(leaf))
    new, problems = dict(leaves), []
    for name, leaf in leaves.items():
        force, contribution = name.split("/")
        if force not in FORCE_AXES[axes][:3]:
            continue
        allowed = tolerance * largest[_force_kind(name, leaf)]
        comment = f"moment of {name} about the moment reference point"
        for moment in MOMENTS:
            lever = Lever(axes, force, moment, d / float(root[_LENGTHS[moment]]))
            try:
                added = _moment_of_force(leaf, lever, ranges, allowed)
                if added is not None:
                    _add_to_terms(new, moment, contribution, added.assign_attrs(comment=comment))
            except SchemaError as error:
                problems += [f"{moment} of {name}: {fault}" for fault in error.problems]
    if problems:
        raise SchemaError(_VERB, problems)
    return new


def _moment_of_force(
    leaf: xr.Dataset,
    lever: Lever,
    ranges: Mapping[str, np.ndarray],
    allowed: float,
) -> xr.Dataset | None:
    """Return the contribution of a force term to a moment coefficient, None without a lever.

    Times the length of the arm, `allowed` is its largest error between breakpoints.
    """
    angles = lever.angles()
    if angles is None:
        return None
    if factor_axes(leaf) & set(angles):
        leaf = fold_factors(leaf)
    points = value_breakpoints(leaf)
    # The lever varies along its angles: the table needs at least two breakpoints there.
    for angle in angles:
        if angle not in points:
            points[angle] = ranges[angle]
        elif len(points[angle]) < 2:
            points[angle] = merge_breakpoints(points[angle], ranges[angle])
    if len(points) > _terms.MAX_AXES:
        raise SchemaError(
            "table",
            [f"would have the axes {' '.join(points)}; at most {_terms.MAX_AXES} are allowed"],
        )
    # Refined until the error bound holds; the allowed error is divided between the angles.
    coarse = regrid_leaf(leaf, points)
    for angle in angles:
        points[angle] = _refine_breakpoints(coarse, angle, allowed / len(angles))
    force = regrid_leaf(leaf, points)
    # The angles at the nodes; zero for a table without them.
    mesh = {}
    if points:
        mesh = dict(zip(points, np.meshgrid(*points.values(), indexing="ij")))
    # The standard error of the lever is zero: it is geometry.
    factor = lever.at(mesh.get("alpha", 0.0), mesh.get("beta", 0.0))
    tables = {"value": force["value"].values * factor}
    if "stderr" in leaf:
        tables["stderr"] = force["stderr"].values * np.abs(factor)
    if "source" in leaf:
        tables["source"] = force["source"].values
    return with_table(force, points, **tables)


def _refine_breakpoints(leaf: xr.Dataset, angle: str, allowed: float) -> np.ndarray:
    """Return the breakpoints of an angle, refined for the product of the table with its sines."""
    points = leaf[angle].values
    dimension = leaf["value"].dims.index(angle)
    T = np.moveaxis(leaf["value"].values, dimension, -1).reshape(-1, len(points))
    factors = _largest_value(leaf) / max(float(np.abs(T).max()), np.finfo(float).tiny)
    # Bound of the second derivative in each cell: 2 |T'| + |T|.
    width = np.diff(points)
    slope = (np.abs(np.diff(T)) / width).max(axis=0)
    largest = np.maximum(np.abs(T[:, 1:]), np.abs(T[:, :-1])).max(axis=0)
    curvature = factors * (2.0 * slope + largest)
    # (width / n)^2 / 8 curvature <= allowed gives the number n of parts of a cell.
    inverse_square = np.zeros_like(width)
    np.divide(curvature, 8.0 * allowed, out=inverse_square, where=curvature > 0)
    parts = np.ceil(width * np.sqrt(inverse_square)).astype(int)
    cells = []
    for first, last, count in zip(points, points[1:], parts):
        cells.append(np.linspace(first, last, max(count, 1), endpoint=False))
    return np.concatenate([*cells, points[-1:]])


def _force_kind(name: str, leaf: xr.Dataset) -> tuple[str, ...]:
    """Return the key of comparable terms: the coefficient and the multipliers of the table."""
    return (name.split("/")[0], *_terms.list_multipliers(leaf))


def _largest_value(leaf: xr.Dataset) -> float:
    """Return the largest value of table and factors together."""
    largest = [np.abs(leaf[key].values).max() for key in ("value", "K1", "K2") if key in leaf]
    return float(np.prod(largest))


def _add_to_terms(
    leaves: dict[str, xr.Dataset], moment: str, contribution: str, added: xr.Dataset
) -> None:
    """Add a leaf to the term of its name, or as a further term if the two do not fit one table."""
    name = f"{moment}/{contribution}"
    while name in leaves and not _can_add(leaves[name], added):
        name += "_moved"
    if name in leaves:
        added = add_leaves(leaves[name], added)
    leaves[name] = added


def _can_add(leaf: xr.Dataset, added: xr.Dataset) -> bool:
    """Return whether two leaves can be added in one table."""
    if _terms.list_multipliers(leaf) != _terms.list_multipliers(added):
        return False
    # One table has one rule beyond its ends.
    if leaf.attrs.get("outside", "hold") != added.attrs.get("outside", "hold"):
        return False
    # Different factors become axes of the table.
    axes = set(union_axes(leaf, added))
    if not same_factors(leaf, added):
        axes |= factor_axes(leaf) | factor_axes(added)
    return len(axes) <= _terms.MAX_AXES


def _add_rate_changes(
    leaves: dict[str, xr.Dataset], root: Mapping[str, Any], d: np.ndarray
) -> dict[str, xr.Dataset]:
    """Return all terms with the change of the rate derivatives by the flow angles."""
    basic = _effect_of_terms(leaves, "basic", ("CL", "CD", "Cm"), "")
    beta = _effect_of_terms(leaves, "beta", ("CY", "Cl", "Cn"), "beta")
    if "alpha" not in getattr(basic.tables.get("CL"), "dims", ()):
        raise SchemaError(
            _VERB,
            ["flow='moved' needs the terms basic over alpha; without them keep the flow angles"],
        )
    new = dict(leaves)
    changes = rate_shift(basic, beta, tuple(d), cbar=float(root["cbar"]), b=float(root["b"]))
    for rate, tables in changes.items():
        # A database without derivatives with respect to a rate does not get them.
        if not any(f"{name}/{rate}" in leaves for name in FORCE_AXES["stability"]):
            continue
        origin = "beta"
        if rate == "qhat":
            origin = "basic"
        for coefficient, table in tables.items():
            leaf = _make_rate_leaf(table, leaves[f"{coefficient}/{origin}"], rate)
            _add_to_terms(new, coefficient, rate, leaf)
    return new


def _effect_of_terms(
    leaves: Mapping[str, xr.Dataset], name: str, coefficients: Sequence[str], regressor: str
) -> Effect:
    """Return terms of one name as an effect, over their common breakpoints."""
    # Factors are multiplied in, so that all tables have the same multipliers.
    selected = {}
    for coefficient in coefficients:
        if f"{coefficient}/{name}" in leaves:
            leaf = fold_factors(leaves[f"{coefficient}/{name}"])
            if " ".join(_terms.list_multipliers(leaf)) == regressor:
                selected[coefficient] = leaf
    points = union_axes(*selected.values())
    tables = {}
    for coefficient, leaf in selected.items():
        tables[coefficient] = regrid_leaf(leaf, points)["value"]
    return Effect(name, tables, regressor)


def _make_rate_leaf(table: xr.DataArray, origin: xr.Dataset, rate: str) -> xr.Dataset:
    """Return a table as a leaf with the source and the relative error of its origin."""
    # Source and errors of the origin, at the breakpoints of the table.
    points = {str(axis): table[axis].values for axis in table.dims}
    on_points = regrid_leaf(fold_factors(origin), points)
    tables = {"value": table.values}
    if "stderr" in on_points:
        # Relative error as the ratio of root mean squares: single values may be zero.
        mean_square = max((on_points["value"].values ** 2).mean(), np.finfo(float).tiny)
        share = np.sqrt((on_points["stderr"].values ** 2).mean() / mean_square)
        tables["stderr"] = share * np.abs(table.values)
    if "source" in on_points:
        tables["source"] = on_points["source"].values
    leaf = with_table(on_points.drop_vars(["K1", "K2"], errors="ignore"), points, **tables)
    comment = "what the flow angles at the moment reference point add"
    return leaf.assign_attrs(regressors=rate, comment=comment)


def _demand_movable_heights(leaves: Mapping[str, xr.Dataset], change: float) -> None:
    """Raise if a term contains a power of height: (h + c)^s is not a multiple of h^s."""
    if change == 0.0:
        return
    where = f"{abs(change):.4g} m {'higher' if change > 0.0 else 'lower'}"
    problems = []
    for name, leaf in leaves.items():
        power = _terms.power_factor(leaf)
        if power is not None and power.variable == "h_agl":
            problems.append(
                f"{name}: the factor {power} cannot be counted from a point {where}; "
                "make it a table first (aerodb.transform.with_height_table)"
            )
    if problems:
        raise SchemaError(_VERB, problems)


def _shift_heights(leaf: xr.Dataset, change: float) -> xr.Dataset:
    """Return a leaf with its heights over the runway shifted."""
    if "h_agl" not in leaf.coords or change == 0.0:
        return leaf
    attributes = leaf["h_agl"].attrs
    new = leaf.assign_coords(h_agl=leaf["h_agl"].values + change)
    new["h_agl"].attrs = attributes
    return without_formula(new)


def _angle_range(leaves: Mapping[str, xr.Dataset], angle: str) -> np.ndarray:
    """Return the range of an angle in the tables of a database. [rad]"""
    # First and last breakpoint of the angle in all tables.
    ends = [leaf[angle].values[[0, -1]] for leaf in leaves.values() if angle in leaf.coords]
    if not ends:
        return _FULL_RANGE
    low, high = np.min(ends), np.max(ends)
    if not high > low:
        return _FULL_RANGE
    return np.array([low, high])


def _reference_point(db: xr.DataTree) -> np.ndarray:
    """Return the moment reference point of a database from the drawing datum. [m]"""
    return np.array([float(db.attrs[key]) for key in _KEYS])


def _format_point(point: np.ndarray) -> str:
    return ", ".join(f"{x:.4f}" for x in point)
