"""Breakpoints of a table changed: tables on other breakpoints, and extended tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.grids import (
    JUDGEMENT,
    demand_axis,
    is_within,
    known_source,
    node_text,
    regrid_leaf,
    rising_breakpoints,
    union_axes,
    value_breakpoints,
    with_table,
)
from aerodb.store.overview import display_text
from aerodb.store.schema import find_leaf, terms
from aerodb.store.undo_history import add_history_line, note_suffix, record_edit
from flightmech.errors import OutOfRange, SchemaError


def regrid(
    db: xr.DataTree,
    name: str,
    breakpoints: Mapping[str, Any],
    *,
    tolerance: float | None = None,
    note: str = "",
) -> xr.DataTree:
    """Return a database with a table on new breakpoints, interpolated in the old table.

    Parameters
    ----------
    db : DataTree
        The database; it does not change.
    name : str
        The term.
    breakpoints : mapping of str to array
        All new breakpoints by axis, within the old range; other axes do not change. [SI]
    tolerance : float, optional
        Largest permitted difference from the old table, in the unit of the table.
    note : str, optional
        Reason for the change; stored in the history.

    Returns
    -------
    DataTree
        Its history states the largest difference, as from `regrid_error`.

    Raises
    ------
    UnknownName
        The term or an axis.
    SchemaError
        Breakpoints do not rise.
    OutOfRange
        Breakpoints beyond the table, or a difference above `tolerance`.
    """
    leaf = find_leaf(db, name)
    new, error, location = _regrid_table(name, leaf, breakpoints)
    if tolerance is not None and not error <= tolerance:
        raise OutOfRange(
            f"regrid {name}: the new table differs from the old one by up to {error:.4g} at "
            f"{location}, allowed {tolerance:g}; "
            "put breakpoints there or allow more"
        )
    counts = []
    for axis, points in breakpoints.items():
        counts.append(f"{axis} {np.size(points)} for {leaf.sizes[axis]} breakpoints")
    summary = f"{', '.join(counts)}, differs by up to {error:.4g}"
    if error:
        summary = f"{summary} at {location}"
    leaves = terms(db) | {name: add_history_line(new, f"regrid: {summary}{note_suffix(note)}")}
    return record_edit(db, leaves, "regrid", summary=f"{name} on {summary}", note=note)


def regrid_error(db: xr.DataTree, name: str, breakpoints: Mapping[str, Any]) -> float:
    """Return the largest change of a term by `regrid`, anywhere in the old table.

    It is in the unit of the table.

    Notes
    -----
    Both tables are multilinear between the union of their breakpoints.  The largest difference is
    therefore at one of these nodes, and the number is exact.  Factors K1 and K2 count with their
    largest values; regressors do not count.
    """
    return _regrid_table(name, find_leaf(db, name), breakpoints)[1]


def extend(
    db: xr.DataTree,
    name: str,
    axis: str,
    points: Any,
    how: Any = "hold",
    *,
    stderr: Any = None,
    note: str = "",
) -> xr.DataTree:
    """Return a database with a table extended along one axis.

    Parameters
    ----------
    db : DataTree
        The database; it does not change.
    name, axis : str
        The term, and an axis of its table.
    points : array
        New breakpoints outside the old ones, on one side or both, rising. [SI]
    how : {"hold", "linear"} or array
        The end value, the straight line through the last two nodes, or the values.  Values are
        numbers along `points`, or an array of the shape of the table with ``len(points)`` along the
        axis, in the unit of the table.
    stderr : float or array, optional
        Standard error of the new nodes, in the shape of the values.  It is required with values if
        the term has standard errors.
    note : str, optional
        Reason for the change; stored in the history.

    Returns
    -------
    DataTree
        New nodes have the source ``judgement``.  Their default standard error depends on the
        distance t beyond the end, in units of the last interval.  With v_1, s_1 of the last node
        and v_2, s_2 of the node before it, it is hypot(s_1, t (v_1 - v_2)) for ``hold``, because
        the straight line may be true, and hypot((1 + t) s_1, t s_2) for ``linear``.

    Raises
    ------
    UnknownName
        The term or the axis.
    SchemaError
        Points that do not rise or lie inside the table, values that do not fit, a line through a
        single breakpoint, or no standard errors.
    """
    leaf = find_leaf(db, name)
    demand_axis(name, leaf, axis)
    old, new = leaf[axis].values.astype(float), rising_breakpoints(axis, points)
    # Breakpoints inside the table would change it: that is regridding.
    if is_within(old, new).any():
        raise SchemaError(
            f"extend {name}",
            [
                f"breakpoints of {axis} must lie outside {old[0]:.6g} ... {old[-1]:.6g}; "
                f"regrid puts some inside"
            ],
        )
    if isinstance(how, str):
        method = how
        value, sd = _extrapolate(name, leaf, axis, new=new, how=how)
    else:
        method = "given values"
        value, sd = _spread_numbers(name, leaf, axis, new=new, numbers=how, what="values"), None
    if stderr is not None:
        sd = _spread_numbers(name, leaf, axis, new=new, numbers=stderr, what="stderr")
        _demand_valid_stderr(name, leaf, sd)
    if "stderr" not in leaf:
        sd = None
    elif sd is None:
        raise SchemaError(
            f"extend {name}", ["the term has standard errors; give stderr= with the values"]
        )
    extended = _join_tables(leaf, axis, new, value=value, sd=sd)
    summary = f"{axis} to {', '.join(display_text(axis, x) for x in new)}, {method}"
    line = f"extend: {summary}{note_suffix(note)}"
    leaves = terms(db) | {name: add_history_line(extended, line)}
    return record_edit(db, leaves, "extend", summary=f"{name} in {summary}", note=note)


def _demand_valid_stderr(name: str, leaf: xr.Dataset, sd: np.ndarray) -> None:
    """Raise for negative standard errors, and for those of a term without them."""
    if not (sd >= 0.0).all():
        raise SchemaError(
            f"extend {name}", ["stderr holds negative numbers or NaN; give zero or more"]
        )
    if "stderr" not in leaf:
        raise SchemaError(f"extend {name}", ["the term has no standard errors; leave stderr= out"])


def _regrid_table(
    name: str, leaf: xr.Dataset, breakpoints: Mapping[str, Any]
) -> tuple[xr.Dataset, float, str]:
    """Return the leaf on new breakpoints, the largest difference and its location."""
    # Axes without new breakpoints keep theirs.
    points = value_breakpoints(leaf)
    for axis, axis_points in breakpoints.items():
        demand_axis(name, leaf, axis)
        new = rising_breakpoints(axis, axis_points)
        outside = new[~is_within(points[axis], new)]
        if outside.size:
            limits = f"{points[axis][0]:.6g} ... {points[axis][-1]:.6g}"
            raise OutOfRange(
                f"regrid {name}: {axis} = {outside[0]:.6g} lies outside {limits}; "
                f"extend the table first"
            )
        points[axis] = new
    new_leaf = regrid_leaf(leaf, points)
    # Both tables are multilinear on the union of their breakpoints: the largest difference is
    # there.
    union = union_axes(leaf, new_leaf)
    new_values = regrid_leaf(new_leaf, union)["value"].values
    difference = np.abs(new_values - regrid_leaf(leaf, union)["value"].values)
    node = np.unravel_index(int(np.argmax(difference)), difference.shape)
    # Largest factors K1 and K2 that multiply the difference.
    factors = np.prod([float(np.abs(leaf[key]).max()) for key in ("K1", "K2") if key in leaf])
    return new_leaf, float(difference[node] * factors), node_text(union, list(map(int, node)))


def _extrapolate(
    name: str, leaf: xr.Dataset, axis: str, *, new: np.ndarray, how: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return values and standard errors of nodes beyond the ends."""
    if how not in ("hold", "linear"):
        raise SchemaError(
            f"extend {name}", [f"how is {how!r}; allowed: hold, linear, or the values"]
        )
    dimension, old = leaf["value"].dims.index(axis), leaf[axis].values.astype(float)
    if how == "linear" and len(old) == 1:
        raise SchemaError(
            f"extend {name}",
            [f"{axis} has one breakpoint and no slope; hold the value or give numbers"],
        )
    value = np.moveaxis(leaf["value"].values, dimension, -1)
    sd = np.zeros_like(value)
    if "stderr" in leaf:
        sd = np.moveaxis(leaf["stderr"].values, dimension, -1)
    # Index of the end node of each new breakpoint, and of the node next to it inside the table.
    is_above = new > old[-1]
    end = np.where(is_above, len(old) - 1, 0)
    inner = np.clip(np.where(is_above, len(old) - 2, 1), 0, len(old) - 1)
    # t is the distance beyond the end in units of the last interval, 0 for a single breakpoint.
    width = old[end] - old[inner]
    t = np.divide(new - old[end], width, out=np.zeros(len(new)), where=width != 0)
    rise = t * (value[..., end] - value[..., inner])
    if how == "hold":
        extended, stderr = value[..., end], np.hypot(sd[..., end], rise)
    else:
        extended = value[..., end] + rise
        stderr = np.hypot((1.0 + t) * sd[..., end], t * sd[..., inner])
    return np.moveaxis(extended, -1, dimension), np.moveaxis(stderr, -1, dimension)


def _spread_numbers(
    name: str, leaf: xr.Dataset, axis: str, *, new: np.ndarray, numbers: Any, what: str
) -> np.ndarray:
    """Return numbers of new nodes in the shape of the table."""
    dimension, array = leaf["value"].dims.index(axis), np.asarray(numbers, float)
    sizes = list(leaf["value"].shape)
    sizes[dimension] = len(new)
    shape = tuple(sizes)
    if array.ndim == 1 and len(array) == len(new):
        # Numbers along the axis: length 1 along all others.
        along_axis = [1] * len(shape)
        along_axis[dimension] = -1
        array = array.reshape(along_axis)
    fits = array.ndim in (0, len(shape))
    for size, required in zip(array.shape, shape):
        fits = fits and size in (1, required)
    if not fits:
        raise SchemaError(
            f"extend {name}",
            [
                f"{what} have the shape {np.shape(numbers)}; give {len(new)} numbers along "
                f"{axis}, or the shape {shape}"
            ],
        )
    return np.broadcast_to(array, shape)


def _join_tables(
    leaf: xr.Dataset,
    axis: str,
    new: np.ndarray,
    *,
    value: np.ndarray,
    sd: np.ndarray | None,
) -> xr.Dataset:
    """Return a leaf with its old and its new nodes, in the order of the breakpoints."""
    dimension = leaf["value"].dims.index(axis)
    # New breakpoints may be on both sides, so that all are sorted.
    points = np.concatenate([leaf[axis].values.astype(float), new])
    order = np.argsort(points)
    sources = np.full(value.shape, JUDGEMENT, np.uint8)
    tables = {
        "value": (leaf["value"].values, value),
        "source": (known_source(leaf), sources),
    }
    if sd is not None:
        tables["stderr"] = leaf["stderr"].values, sd
    joined = {}
    for key, pair in tables.items():
        joined[key] = np.concatenate(pair, axis=dimension).take(order, axis=dimension)
    return with_table(leaf, value_breakpoints(leaf) | {axis: points[order]}, **joined)
