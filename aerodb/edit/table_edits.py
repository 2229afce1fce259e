"""Single tables changed by hand: scaled, shifted, put on other breakpoints, extended.

Between its nodes every table stays multilinear: a factor table multiplies the nodes, after its own
breakpoints were put in, so with axes in common a product in between is the straight line, not the
parabola.  Numbers, and tables over other axes, act exactly.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.grids import (
    JUDGEMENT,
    demand_axis,
    factor_axes,
    fold_factors,
    is_within,
    known_source,
    make_table_leaf,
    merge_breakpoints,
    node_text,
    regrid_leaf,
    rising_breakpoints,
    union_axes,
    value_breakpoints,
    with_table,
)
from aerodb.store.overview import display_text
from aerodb.store.schema import find_leaf, terms
from aerodb.store.undo_history import add_history_line, note_suffix, record_edit, update_absent
from aerodb.update.cautions.notices import with_notices
from aerodb.update.posterior import carry_covariance, without_posterior
from flightmech import terms as _terms
from flightmech.errors import AeromatchWarning, OutOfRange, SchemaError, UnknownName


def replace_terms(db: xr.DataTree, new: Mapping[str, xr.Dataset], note: str = "") -> xr.DataTree:
    """Return a database in which terms are replaced or added.

    Parameters
    ----------
    db : DataTree
        The database; it is left as it is.
    new : mapping of str to Dataset
        Terms by name, ``"CL/gear"``; a name the database does not have is added and leaves its list
        `update_absent`.  The ``notices`` of a `Tabulation` become lines of the history and the root
        attribute ``notices``.
    note : str, optional
        Why, for the history.

    Raises
    ------
    SchemaError
        A term is faulty or its name is not ``<coefficient>/<contribution>``; all faults.
    """
    leaves = terms(db)
    added = [name for name in new if name not in leaves]
    taken = [name for name in new if name in leaves]
    lines = {
        name: f"replace_terms: {'replaced' if name in leaves else 'added'}{note_suffix(note)}"
        for name in new
    }
    summary = [
        f"{verb} {' '.join(names)}"
        for verb, names in (("replaced", taken), ("added", added))
        if names
    ]
    leaves |= {name: add_history_line(leaf, lines[name]) for name, leaf in new.items()}
    notices = list(getattr(new, "notices", ()))
    attributes = {**update_absent(db, without=new), **with_notices(db.attrs, notices)}
    return record_edit(
        db,
        leaves,
        "replace_terms",
        ", ".join(summary) or "nothing",
        note,
        attributes,
        lines=notices,
    )


def delete_terms(db: xr.DataTree, names: str | Iterable[str], note: str = "") -> xr.DataTree:
    """Return a database without some terms; their names go to its list `update_absent`.

    Parameters
    ----------
    db : DataTree
        The database; it is left as it is.
    names : str or iterable of str
        Terms, or patterns such as ``"*/speedbrake"``.
    note : str, optional
        Why, such as "could not be identified".

    Raises
    ------
    UnknownName
        A term that the database does not have.
    SchemaError
        No term would be left.
    """
    gone = match_names(db, names)
    leaves = {name: leaf for name, leaf in terms(db).items() if name not in gone}
    return record_edit(
        db, leaves, "delete_terms", " ".join(gone), note, update_absent(db, more=gone)
    )


def match_names(db: xr.DataTree, names: str | Iterable[str]) -> list[str]:
    """Return the names of the terms that a name, a pattern such as ``"Cm/*"``, or several of them
    mean.

    Raises
    ------
    UnknownName
        One of them means no term.
    """
    leaves = list(terms(db))
    found: dict[str, None] = {}
    for name in [names] if isinstance(names, str) else names:
        meant = [leaf for leaf in leaves if fnmatchcase(leaf, name)]
        if not meant:
            raise UnknownName(name, leaves, "term")
        found |= dict.fromkeys(meant)
    return list(found)


# leaf and table on one grid to value, stderr, and the factor on the nodes that were there
_Work = Callable[[xr.Dataset, xr.Dataset], tuple[np.ndarray, np.ndarray | None, np.ndarray | float]]


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
        The database; it is left as it is.
    names : str or iterable of str
        Terms, or patterns such as ``"*/gear"``.
    factor : float or array
        A number, or a table over `axes`. [1]
    axes : mapping of str to array, optional
        Axis to the breakpoints of the factor, which is held beyond them; axes a term does not have
        are added to it. [SI]
    stderr : float or array
        Standard error of the factor itself. [1]
    source : {"judgement", "flight", "datcom"}
        Where the factor comes from; nodes that it does not change keep their source.
    note : str, optional
        Why, for the history.

    Returns
    -------
    DataTree
        value = factor x value, stderr = hypot(factor x stderr, value x standard error of the
        factor).

    Raises
    ------
    UnknownName
        A term or an axis.
    SchemaError
        Breakpoints do not rise, shapes do not fit, or a table would have too many axes.
    """
    by = make_table_leaf(factor, axes, stderr, "factor")

    def scaled(
        leaf: xr.Dataset, times: xr.Dataset
    ) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
        value, f, sd = leaf["value"].values, times["value"].values, times["stderr"].values
        own = leaf["stderr"].values if "stderr" in leaf else 0.0
        return f * value, np.hypot(f * own, sd * value) if "stderr" in leaf or sd.any() else None, f

    return _worked(db, names, by, scaled, "scale", f"by {_described(by)}", source, note)


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
        A number, or a table over `axes`, in the unit of the table: per unit of its regressors,
        before its factors K1 and K2.
    stderr : float or array
        Standard error of the amount, in its unit; combined with that of the nodes as independent.
    source : {"judgement", "flight", "datcom"}
        Where the amount comes from; nodes that it does not change keep their source.

    Raises
    ------
    UnknownName, SchemaError
        As in `scale`.

    Warns
    -----
    AeromatchWarning
        Nodes that are zero by definition (value and standard error zero: an increment without its
        cause) would no longer be.
    """
    by = make_table_leaf(amount, axes, stderr, "amount")
    for name in match_names(db, names):
        _warn_of_zeros(name, find_leaf(db, name), by)

    def shifted(leaf: xr.Dataset, more: xr.Dataset) -> tuple[np.ndarray, np.ndarray | None, float]:
        sd = more["stderr"].values
        own = leaf["stderr"].values if "stderr" in leaf else 0.0
        return (
            leaf["value"].values + more["value"].values,
            np.hypot(own, sd) if "stderr" in leaf or sd.any() else None,
            1.0,
        )

    return _worked(db, names, by, shifted, "shift", f"by {_described(by)}", source, note)


def regrid(
    db: xr.DataTree,
    name: str,
    breakpoints: Mapping[str, Any],
    *,
    tolerance: float | None = None,
    note: str = "",
) -> xr.DataTree:
    """Return a database with a table on new breakpoints, its nodes read off the old one.

    Parameters
    ----------
    db : DataTree
        The database; it is left as it is.
    name : str
        The term.
    breakpoints : mapping of str to array
        Axis to all its new breakpoints, within the old range; other axes keep theirs. [SI]
    tolerance : float, optional
        Largest difference from the old table that is allowed; in the unit of the table.
    note : str, optional
        Why, for the history.

    Returns
    -------
    DataTree
        The largest difference, as `regrid_error` finds it, stands in the history.

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
    new, error, at = _regridded(name, leaf, breakpoints)
    if tolerance is not None and not error <= tolerance:
        raise OutOfRange(
            f"regrid {name}: the new table differs from the old one by up to {error:.4g} at "
            f"{at}, allowed {tolerance:g}; "
            "put breakpoints there or allow more"
        )
    counts = ", ".join(
        f"{axis} {np.size(points)} for {leaf.sizes[axis]} breakpoints"
        for axis, points in breakpoints.items()
    )
    summary = f"{counts}, differs by up to {error:.4g}{f' at {at}' if error else ''}"
    leaves = terms(db) | {name: add_history_line(new, f"regrid: {summary}{note_suffix(note)}")}
    return record_edit(db, leaves, "regrid", f"{name} on {summary}", note)


def regrid_error(db: xr.DataTree, name: str, breakpoints: Mapping[str, Any]) -> float:
    """Return by how much `regrid` would change a term at most, anywhere in the old table; in the
    unit of the table.

    Notes
    -----
    Both tables are multilinear between the breakpoints of the two together, so the largest difference stands at one of these nodes: the
    number is exact, not an estimate.  Factors K1 and K2 count with their largest values; regressors do not count.
    """
    return _regridded(name, find_leaf(db, name), breakpoints)[1]


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
    """Return a database with a table that reaches further along one axis.

    Parameters
    ----------
    db : DataTree
        The database; it is left as it is.
    name, axis : str
        The term, and an axis of its table.
    points : array
        New breakpoints outside the old ones, on one side or both, rising. [SI]
    how : {"hold", "linear"} or array
        The end value, the straight line through the last two nodes, or the values: numbers along
        `points`, or an array of the shape of the table with ``len(points)`` along the axis. Unit of
        the table.
    stderr : float or array, optional
        Standard error of the new nodes, shaped as values; needed with values where the term has
        standard errors.
    note : str, optional
        Why, for the history.

    Returns
    -------
    DataTree
        New nodes have the source ``judgement``.  Their standard error, unless given, at t times the
        last interval beyond the end, with v_1, s_1 of the last node and v_2, s_2 of the one before:
        hypot(s_1, t (v_1 - v_2)) of a value held, for the straight line may be true; hypot((1 + t)
        s_1, t s_2) of the straight line.

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
    if is_within(old, new).any():
        raise SchemaError(
            f"extend {name}",
            [
                f"breakpoints of {axis} must lie outside {old[0]:.6g} ... {old[-1]:.6g}; "
                f"regrid puts some inside"
            ],
        )
    words = how if isinstance(how, str) else "given values"
    value, sd = _beyond(name, leaf, axis, new, how)
    if stderr is not None:
        sd = _along(name, leaf, axis, new, stderr, "stderr")
        if not (sd >= 0.0).all():
            raise SchemaError(
                f"extend {name}", ["stderr holds negative numbers or NaN; give zero or more"]
            )
    if "stderr" in leaf and sd is None:
        raise SchemaError(
            f"extend {name}", ["the term has standard errors; give stderr= with the values"]
        )
    if "stderr" not in leaf and stderr is not None:
        raise SchemaError(f"extend {name}", ["the term has no standard errors; leave stderr= out"])
    whole = _joined(leaf, axis, new, value, sd if "stderr" in leaf else None)
    summary = f"{axis} to {', '.join(display_text(axis, x) for x in new)}, {words}"
    leaves = terms(db) | {name: add_history_line(whole, f"extend: {summary}{note_suffix(note)}")}
    return record_edit(db, leaves, "extend", f"{name} in {summary}", note)


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
    """Return a database with one node of a table, or the nodes along the axes that `at` leaves out,
    set to a number.

    Parameters
    ----------
    db : DataTree
        The database; it is left as it is.
    name : str
        The term.
    at : mapping of str to float
        Axis to one of its breakpoints; an axis left out means all of its breakpoints. [SI]
    value : float
        The number, in the unit of the table: per unit of its regressors, before its factors K1 and
        K2.
    stderr : float, optional
        Its standard error; left out, the nodes keep theirs.
    source : {"judgement", "flight", "datcom"}
        Where the number comes from; a node that had it keeps its source.
    note : str, optional
        Why, for the history.

    Raises
    ------
    UnknownName
        The term or an axis.
    OutOfRange
        A place where the table has no breakpoint.
    SchemaError
        Numbers that are not finite, a negative standard error, or one for a term that states none.
    """
    leaf = find_leaf(db, name)
    _demand_source("set_nodes", source)
    faults = [] if np.isfinite(value) else [f"value is {value!r}; give a finite number"]
    if stderr is not None and not (np.isfinite(stderr) and stderr >= 0.0):
        faults.append(f"stderr is {stderr!r}; give zero or more")
    if stderr is not None and "stderr" not in leaf:
        faults.append("the term has no standard errors; leave stderr= out")
    if faults:
        raise SchemaError(f"set {name}", faults)
    for axis in at:
        demand_axis(name, leaf, axis)
    node = tuple(
        _breakpoint(name, leaf, axis, at[axis]) if axis in at else slice(None)
        for axis in value_breakpoints(leaf)
    )
    before = leaf["value"].values
    values, codes = before.copy(), known_source(leaf).copy()
    values[node] = value
    errors = leaf["stderr"].values.copy() if "stderr" in leaf else None
    if errors is not None and stderr is not None:
        errors[node] = stderr
    codes[values != before] = _terms.SOURCES.index(source)
    whole = with_table(leaf, value_breakpoints(leaf), values, errors, codes)
    where = (
        ", ".join(
            f"{axis} {display_text(axis, at[axis])}"
            for axis in value_breakpoints(leaf)
            if axis in at
        )
        or "all nodes"
    )
    doubt = "" if stderr is None else f" +- {stderr:g}"
    summary = f"at {where} to {value:g}{doubt}, was {_span_of(before[node])}"
    leaves = terms(db) | {
        name: add_history_line(
            _still_joint(leaf, whole), f"set_nodes: {summary}{note_suffix(note)}"
        )
    }
    return record_edit(db, leaves, "set_nodes", f"{name} {summary}", note)


def _still_joint(leaf: xr.Dataset, whole: xr.Dataset) -> xr.Dataset:
    """Return an edited leaf with the joint covariance of the one before; without it where a
    standard error shrank below the stored one.
    """
    smaller = "stderr" in whole and bool((whole["stderr"].values < leaf["stderr"].values).any())
    return without_posterior(whole) if smaller else carry_covariance(leaf, whole)


def _breakpoint(name: str, leaf: xr.Dataset, axis: str, at: float) -> int:
    points = leaf[axis].values.astype(float)
    i = int(np.abs(points - at).argmin())
    if not abs(points[i] - at) <= 1e-6 * max(
        np.ptp(points), abs(at)
    ):  # what a person writes in degrees or feet, not what a program does
        known = ", ".join(display_text(axis, x) for x in points)
        raise OutOfRange(
            f"set {name}: no breakpoint at {axis} {display_text(axis, at)}; there are "
            f"{known}; regrid puts one there"
        )
    return i


def _worked(
    db: xr.DataTree,
    names,
    by: xr.Dataset,
    work: _Work,
    verb: str,
    summary: str,
    source: str,
    note: str,
) -> xr.DataTree:
    """Return a database with terms worked on node by node over their breakpoints and those of `by`."""
    _demand_source(verb, source)
    chosen, leaves = match_names(db, names), terms(db)
    for name in chosen:
        try:
            leaf, other = _common(leaves[name], by)
        except SchemaError as error:
            raise SchemaError(f"{verb} {name}", error.problems) from None
        value, stderr, times = work(leaf, other)
        codes = np.where(
            value == leaf["value"].values, known_source(leaf), _terms.SOURCES.index(source)
        )
        edited = carry_covariance(
            leaves[name], with_table(leaf, value_breakpoints(leaf), value, stderr, codes), times
        )
        leaves[name] = add_history_line(edited, f"{verb}: {summary}{note_suffix(note)}")
    return record_edit(db, leaves, verb, f"{' '.join(chosen)} {summary}", note)


def _demand_source(verb: str, source: str) -> None:
    if source not in _terms.SOURCES:
        raise SchemaError(verb, [f"source is {source!r}; allowed: {', '.join(_terms.SOURCES)}"])


def _common(leaf: xr.Dataset, by: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Return leaf and table over one grid: the breakpoints of the leaf and those of the table
    between them.
    """
    if factor_axes(leaf) & set(map(str, by["value"].dims)):
        leaf = fold_factors(leaf)
    points = value_breakpoints(leaf)
    for axis, more in value_breakpoints(by).items():
        points[axis] = (
            merge_breakpoints(points[axis], more[is_within(points[axis], more)])
            if axis in points
            else more
        )
    if len(points) > _terms.MAX_AXES:
        raise SchemaError(
            "table",
            [f"would have the axes {' '.join(points)}; at most {_terms.MAX_AXES} are allowed"],
        )
    return regrid_leaf(leaf, points), regrid_leaf(by, points)


def _described(by: xr.Dataset) -> str:
    value, sd = by["value"], by["stderr"].values
    numbers = _span_of(value.values)
    doubt = f" +- {sd.max():g}" if sd.any() else ""
    over = f" over {' '.join(map(str, value.dims))}" if value.ndim else ""
    return f"{numbers}{doubt}{over}"


def _span_of(value: np.ndarray) -> str:
    low, high = float(np.min(value)), float(np.max(value))
    return f"{low:g}" if low == high else f"{low:g} ... {high:g}"


def _warn_of_zeros(name: str, leaf: xr.Dataset, by: xr.Dataset) -> None:
    if "stderr" not in leaf:
        return
    leaf, by = _common(leaf, by)
    count = int(
        (
            (leaf["value"].values == 0.0)
            & (leaf["stderr"].values == 0.0)
            & (by["value"].values != 0.0)
        ).sum()
    )
    if count:
        text = (
            f"shift: {count} nodes of {name} were zero by definition and no longer are; shift "
            f"by a table that is zero there"
        )
        warnings.warn(text, AeromatchWarning, stacklevel=3)


def _regridded(
    name: str, leaf: xr.Dataset, breakpoints: Mapping[str, Any]
) -> tuple[xr.Dataset, float, str]:
    """Return the leaf on new breakpoints, the largest difference and where it stands."""
    points = value_breakpoints(leaf)
    for axis, wanted in breakpoints.items():
        demand_axis(name, leaf, axis)
        new = rising_breakpoints(axis, wanted)
        off = new[~is_within(points[axis], new)]
        if off.size:
            reach = f"{points[axis][0]:.6g} ... {points[axis][-1]:.6g}"
            raise OutOfRange(
                f"regrid {name}: {axis} = {off[0]:.6g} lies outside {reach}; extend the table first"
            )
        points[axis] = new
    new_leaf = regrid_leaf(leaf, points)
    both = union_axes(leaf, new_leaf)
    difference = np.abs(
        regrid_leaf(new_leaf, both)["value"].values - regrid_leaf(leaf, both)["value"].values
    )
    node = np.unravel_index(int(np.argmax(difference)), difference.shape)
    factors = np.prod([float(np.abs(leaf[key]).max()) for key in ("K1", "K2") if key in leaf])
    return new_leaf, float(difference[node] * factors), node_text(both, [int(i) for i in node])


def _beyond(
    name: str, leaf: xr.Dataset, axis: str, new: np.ndarray, how: Any
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return values of nodes beyond the ends, and their standard errors where the rule gives them."""
    if not isinstance(how, str):
        return _along(name, leaf, axis, new, how, "values"), None
    if how not in ("hold", "linear"):
        raise SchemaError(
            f"extend {name}", [f"how is {how!r}; allowed: hold, linear, or the values"]
        )
    at, old = leaf["value"].dims.index(axis), leaf[axis].values.astype(float)
    if how == "linear" and len(old) == 1:
        raise SchemaError(
            f"extend {name}",
            [f"{axis} has one breakpoint and no slope; hold the value or give numbers"],
        )
    value = np.moveaxis(leaf["value"].values, at, -1)
    sd = np.moveaxis(leaf["stderr"].values, at, -1) if "stderr" in leaf else np.zeros_like(value)
    end = np.where(new > old[-1], len(old) - 1, 0)
    inner = np.clip(np.where(new > old[-1], len(old) - 2, 1), 0, len(old) - 1)
    width = old[end] - old[inner]
    t = np.divide(new - old[end], width, out=np.zeros(len(new)), where=width != 0)
    rise = t * (value[..., end] - value[..., inner])
    if how == "hold":
        found, doubt = value[..., end], np.hypot(sd[..., end], rise)
    else:
        found, doubt = (
            value[..., end] + rise,
            np.hypot((1.0 + t) * sd[..., end], t * sd[..., inner]),
        )
    return np.moveaxis(found, -1, at), np.moveaxis(doubt, -1, at)


def _along(
    name: str, leaf: xr.Dataset, axis: str, new: np.ndarray, given: Any, what: str
) -> np.ndarray:
    """Return numbers given for new nodes in the shape of the table."""
    at, array = leaf["value"].dims.index(axis), np.asarray(given, float)
    shape = tuple(len(new) if i == at else size for i, size in enumerate(leaf["value"].shape))
    if array.ndim == 1 and len(array) == len(new):
        array = array.reshape([-1 if i == at else 1 for i in range(len(shape))])
    if array.ndim not in (0, len(shape)) or any(
        n not in (1, m) for n, m in zip(array.shape, shape)
    ):
        raise SchemaError(
            f"extend {name}",
            [
                f"{what} have the shape {np.shape(given)}; give {len(new)} numbers along "
                f"{axis}, or the shape {shape}"
            ],
        )
    return np.broadcast_to(array, shape)


def _joined(
    leaf: xr.Dataset, axis: str, new: np.ndarray, value: np.ndarray, sd: np.ndarray | None
) -> xr.Dataset:
    at, old = leaf["value"].dims.index(axis), leaf[axis].values.astype(float)
    order = np.argsort(np.concatenate([old, new]))

    def whole(inside: np.ndarray, outside: np.ndarray) -> np.ndarray:
        return np.concatenate([inside, outside], axis=at).take(order, axis=at)

    points = value_breakpoints(leaf) | {axis: np.concatenate([old, new])[order]}
    stderr = None if sd is None else whole(leaf["stderr"].values, sd)
    source = whole(known_source(leaf), np.full(value.shape, JUDGEMENT, np.uint8))
    return with_table(leaf, points, whole(leaf["value"].values, value), stderr, source)
