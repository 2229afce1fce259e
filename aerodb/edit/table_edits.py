"""Edits of the nodes of terms: scaled, shifted, and single nodes set.

Every table stays multilinear between its nodes.  A factor table multiplies the nodes, after its
breakpoints were added.  With common axes a product between the nodes is therefore a straight line
and not a parabola.  Numbers, and tables over other axes, act exactly.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from aerodb.edit.term_edits import match_names
from aerodb.store.grids import (
    demand_axis,
    factor_axes,
    fold_factors,
    is_within,
    known_source,
    make_table_leaf,
    merge_breakpoints,
    regrid_leaf,
    value_breakpoints,
    with_table,
)
from aerodb.store.overview import display_text
from aerodb.store.schema import find_leaf, terms
from aerodb.store.undo_history import add_history_line, note_suffix, record_edit
from aerodb.update.posterior import carry_covariance, without_posterior
from flightmech import terms as _terms
from flightmech.errors import AeromatchWarning, OutOfRange, SchemaError

# Difference from a breakpoint, relative to the axis, that is rounding of degrees or feet.
_POINT_ROUNDING = 1e-6
# From a leaf and a table on one grid: new value and stderr, and the factor on the old nodes.
_EditedNodes = tuple[np.ndarray, np.ndarray | None, np.ndarray | float]
_NodeEdit = Callable[[xr.Dataset, xr.Dataset], _EditedNodes]


def scale(
    db: xr.DataTree,
    names: str | Iterable[str],
    factor: Any,
    axes: Mapping[str, Any] | None = None,
    *,
    stderr: Any = 0.0,
    source: str = "judgement",
    note: str = "",
) -> xr.DataTree:
    """Return a database with terms multiplied by a factor.

    Parameters
    ----------
    db : DataTree
        The database; it does not change.
    names : str or iterable of str
        Terms, or patterns such as ``"*/gear"``.
    factor : float or array
        A number, or a table over `axes`. [1]
    axes : mapping of str to array, optional
        Breakpoints of the factor by axis.  The factor is constant beyond them.  Axes that a term
        does not have are added to it. [SI]
    stderr : float or array
        Standard error of the factor. [1]
    source : {"judgement", "flight", "datcom", "estimate"}
        Source of the factor; nodes that it does not change keep their source.
    note : str, optional
        Reason for the change; stored in the history.

    Returns
    -------
    DataTree
        value = factor x value, stderr = hypot(factor x stderr, value x standard error of the
        factor).

    Raises
    ------
    UnknownName
        An unknown term or axis.
    SchemaError
        Breakpoints do not rise, shapes do not fit, or a table would have too many axes.
    """
    table = make_table_leaf(factor, axes, stderr, "factor")
    return _edit_nodes(db, names, table, _scale_nodes, verb="scale", source=source, note=note)


def _scale_nodes(leaf: xr.Dataset, table: xr.Dataset) -> _EditedNodes:
    """Return value and standard error of a leaf times a table on the same nodes."""
    value, factor, sd = leaf["value"].values, table["value"].values, table["stderr"].values
    if "stderr" in leaf:
        return factor * value, np.hypot(factor * leaf["stderr"].values, sd * value), factor
    # An exact factor does not give standard errors to a term without them.
    if not sd.any():
        return factor * value, None, factor
    return factor * value, np.abs(sd * value), factor


def shift(
    db: xr.DataTree,
    names: str | Iterable[str],
    amount: Any,
    axes: Mapping[str, Any] | None = None,
    *,
    stderr: Any = 0.0,
    source: str = "judgement",
    note: str = "",
) -> xr.DataTree:
    """Return a database with an amount added to the tables of terms.

    Parameters
    ----------
    db, names, axes, note
        As in `scale`.
    amount : float or array
        A number, or a table over `axes`, in the unit of the table: per unit of its regressors and
        before its factors K1 and K2.
    stderr : float or array
        Standard error of the amount, in its unit; combined with that of the nodes as independent.
    source : {"judgement", "flight", "datcom", "estimate"}
        Source of the amount; nodes that it does not change keep their source.

    Raises
    ------
    UnknownName, SchemaError
        As in `scale`.

    Warns
    -----
    AeromatchWarning
        Nodes that are zero by definition become different from zero.  Their value and standard
        error were zero, as for an increment without its cause.
    """
    table = make_table_leaf(amount, axes, stderr, "amount")
    for name in match_names(db, names):
        _warn_of_zeros(name, find_leaf(db, name), table)
    return _edit_nodes(db, names, table, _shift_nodes, verb="shift", source=source, note=note)


def _shift_nodes(leaf: xr.Dataset, table: xr.Dataset) -> _EditedNodes:
    """Return value and standard error of a leaf plus a table on the same nodes."""
    value, sd = leaf["value"].values + table["value"].values, table["stderr"].values
    if "stderr" in leaf:
        return value, np.hypot(leaf["stderr"].values, sd), 1.0
    if not sd.any():
        return value, None, 1.0
    return value, np.abs(sd), 1.0


def set_nodes(
    db: xr.DataTree,
    name: str,
    at: Mapping[str, float],
    value: float,
    *,
    stderr: float | None = None,
    source: str = "judgement",
    note: str = "",
) -> xr.DataTree:
    """Return a database with one or several nodes of a table set to a number.

    Parameters
    ----------
    db : DataTree
        The database; it does not change.
    name : str
        The term.
    at : mapping of str to float
        One breakpoint by axis.  All breakpoints of an axis without an entry are meant. [SI]
    value : float
        The number, in the unit of the table: per unit of its regressors and before its factors K1
        and K2.
    stderr : float, optional
        Its standard error.  By default the nodes keep theirs.
    source : {"judgement", "flight", "datcom", "estimate"}
        Source of the number; a node that has the number already keeps its source.
    note : str, optional
        Reason for the change; stored in the history.

    Raises
    ------
    UnknownName
        An unknown term or axis.
    OutOfRange
        The table has no breakpoint at a value of `at`.
    SchemaError
        Numbers that are not finite, a negative standard error, or one for a term that states none.
    """
    leaf = find_leaf(db, name)
    _demand_source("set_nodes", source)
    _demand_valid_number(name, leaf, value, stderr)
    for axis in at:
        demand_axis(name, leaf, axis)
    selected, location = _select_nodes(name, leaf, at)
    # Values, standard errors and sources of the selected nodes.
    before = leaf["value"].values
    values, codes = before.copy(), known_source(leaf).copy()
    values[selected] = value
    errors, error_text = None, ""
    if "stderr" in leaf:
        errors = leaf["stderr"].values.copy()
        if stderr is not None:
            errors[selected] = stderr
            error_text = f" +- {stderr:g}"
    codes[values != before] = _terms.SOURCES.index(source)
    edited = with_table(leaf, value_breakpoints(leaf), value=values, stderr=errors, source=codes)
    summary = f"at {location} to {value:g}{error_text}, was {_format_range(before[selected])}"
    line = f"set_nodes: {summary}{note_suffix(note)}"
    leaves = terms(db) | {name: add_history_line(_carry_if_valid(leaf, edited), line)}
    return record_edit(db, leaves, "set_nodes", summary=f"{name} {summary}", note=note)


def _select_nodes(
    name: str, leaf: xr.Dataset, at: Mapping[str, float]
) -> tuple[tuple[int | slice, ...], str]:
    """Return the index of nodes and their place in words."""
    node, location = list[int | slice](), list[str]()
    for axis in value_breakpoints(leaf):
        # An axis without an entry selects all of its breakpoints.
        node.append(slice(None))
        if axis in at:
            node[-1] = _find_breakpoint(name, leaf, axis, at[axis])
            location.append(f"{axis} {display_text(axis, at[axis])}")
    return tuple(node), ", ".join(location) or "all nodes"


def _demand_valid_number(name: str, leaf: xr.Dataset, value: float, stderr: float | None) -> None:
    """Raise for a value that is not finite or a standard error that does not fit; all faults."""
    faults = []
    if not np.isfinite(value):
        faults.append(f"value is {value!r}; give a finite number")
    if stderr is not None and not (np.isfinite(stderr) and stderr >= 0.0):
        faults.append(f"stderr is {stderr!r}; give zero or more")
    if stderr is not None and "stderr" not in leaf:
        faults.append("the term has no standard errors; leave stderr= out")
    if faults:
        raise SchemaError(f"set {name}", faults)


def _carry_if_valid(leaf: xr.Dataset, edited: xr.Dataset) -> xr.Dataset:
    """Return an edited leaf with the joint covariance, unless a standard error became smaller."""
    # A smaller standard error contradicts the stored covariance, a larger one adds to it.
    if "stderr" in edited and bool((edited["stderr"].values < leaf["stderr"].values).any()):
        return without_posterior(edited)
    return carry_covariance(leaf, edited)


def _find_breakpoint(name: str, leaf: xr.Dataset, axis: str, point: float) -> int:
    """Return the index of a breakpoint, within the rounding of a number that a person writes."""
    points = leaf[axis].values.astype(float)
    # The negated comparison also refuses NaN.
    index = int(np.abs(points - point).argmin())
    if not abs(points[index] - point) <= _POINT_ROUNDING * max(np.ptp(points), abs(point)):
        existing = ", ".join(display_text(axis, x) for x in points)
        raise OutOfRange(
            f"set {name}: no breakpoint at {axis} {display_text(axis, point)}; there are "
            f"{existing}; regrid puts one there"
        )
    return index


def _edit_nodes(
    db: xr.DataTree,
    names: str | Iterable[str],
    table: xr.Dataset,
    edit: _NodeEdit,
    *,
    verb: str,
    source: str,
    note: str,
) -> xr.DataTree:
    """Return a database with terms edited node by node, on the grid of term and table."""
    _demand_source(verb, source)
    selected, leaves = match_names(db, names), terms(db)
    summary = f"by {_describe_table(table)}"
    for name in selected:
        try:
            leaf, on_nodes = _on_common_grid(leaves[name], table)
        except SchemaError as error:
            raise SchemaError(f"{verb} {name}", error.problems) from None
        # Unchanged nodes keep their source.
        value, stderr, factor = edit(leaf, on_nodes)
        is_unchanged = value == leaf["value"].values
        codes = np.where(is_unchanged, known_source(leaf), _terms.SOURCES.index(source))
        points = value_breakpoints(leaf)
        edited = with_table(leaf, points, value=value, stderr=stderr, source=codes)
        edited = carry_covariance(leaves[name], edited, factor)
        leaves[name] = add_history_line(edited, f"{verb}: {summary}{note_suffix(note)}")
    return record_edit(db, leaves, verb, summary=f"{' '.join(selected)} {summary}", note=note)


def _demand_source(verb: str, source: str) -> None:
    """Raise `SchemaError` for an unknown source."""
    if source not in _terms.SOURCES:
        raise SchemaError(verb, [f"source is {source!r}; allowed: {', '.join(_terms.SOURCES)}"])


def _on_common_grid(leaf: xr.Dataset, table: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Return leaf and table on the breakpoints of the leaf and those of the table between them."""
    # A table over the axis of a factor cannot act on the nodes alone.
    if factor_axes(leaf) & set(map(str, table["value"].dims)):
        leaf = fold_factors(leaf)
    # Breakpoints of the table beyond those of the leaf would extend the leaf.
    points = value_breakpoints(leaf)
    for axis, additional in value_breakpoints(table).items():
        if axis in points:
            inside = additional[is_within(points[axis], additional)]
            additional = merge_breakpoints(points[axis], inside)
        points[axis] = additional
    if len(points) > _terms.MAX_AXES:
        raise SchemaError(
            "table",
            [f"would have the axes {' '.join(points)}; at most {_terms.MAX_AXES} are allowed"],
        )
    return regrid_leaf(leaf, points), regrid_leaf(table, points)


def _describe_table(table: xr.Dataset) -> str:
    """Return range, standard error and axes of a table as text."""
    value, sd = table["value"], table["stderr"].values
    text = _format_range(value.values)
    if sd.any():
        text = f"{text} +- {sd.max():g}"
    if value.ndim:
        text = f"{text} over {' '.join(map(str, value.dims))}"
    return text


def _format_range(value: np.ndarray) -> str:
    """Return the range of values as text, a single number if all are equal."""
    low, high = float(np.min(value)), float(np.max(value))
    if low == high:
        return f"{low:g}"
    return f"{low:g} ... {high:g}"


def _warn_of_zeros(name: str, leaf: xr.Dataset, table: xr.Dataset) -> None:
    """Warn if nodes that are zero by definition become different from zero."""
    if "stderr" not in leaf:
        return
    leaf, on_nodes = _on_common_grid(leaf, table)
    # Value and standard error of zero: zero by definition.
    is_zero = (leaf["value"].values == 0.0) & (leaf["stderr"].values == 0.0)
    count = int((is_zero & (on_nodes["value"].values != 0.0)).sum())
    if count:
        text = f"shift: {count} nodes of {name} were zero by definition and no longer are"
        advice = "shift by a table that is zero there"
        warnings.warn(f"{text}; {advice}", AeromatchWarning, stacklevel=3)
