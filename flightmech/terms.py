"""The term: one leaf of a model tree, and the one place that says what it computes.

A term's contribution to its coefficient is

    K1(...) * K2(...) * value(axes) * v1 * v2                       [LR743] eq. (1)-(11)

with `value` a table (of 0 to 4 axes), `K1` and `K2` optional tables over axes that `value` does not have, and `v1`,
`v2` the optional regressors, model variables such as ``qhat`` or ``delta_e``.  Tables are multilinear between
breakpoints, so a contribution is *linear in the node values*: `basis` returns that linear map, and simulation,
regression and comparison all rest on it.

A leaf is a plain ``xarray.Dataset``:

==============  ====================================================================================
``value``       the table; its dimensions are axes, their coordinates the breakpoints (rising)
``K1``, ``K2``  optional factor tables, over other axes
``stderr``      optional, shape of ``value``: standard error of each node
``source``      optional, shape of ``value``: 0 datcom, 1 flight, 2 judgement
==============  ====================================================================================

Attributes (text only): ``regressors`` (words), ``outside`` (``hold`` or ``linear``: what the simulation does beyond the
last breakpoint), ``references``, ``history``, ``comment``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from .errors import OutOfRange, SchemaError, UnitError, UnknownName
from .names import attrs, lookup
from .units import parse

if TYPE_CHECKING:
    from scipy.sparse import csr_array

SOURCES = ("datcom", "flight", "judgement")
SOURCE_ATTRS = {"flag_values": " ".join(str(code) for code, _ in enumerate(SOURCES)), "flag_meanings": " ".join(SOURCES)}
MAX_AXES = 4
MAX_REGRESSORS = 2
_TABLES = ("value", "K1", "K2")
Place = tuple[np.ndarray, np.ndarray]
_BLOCK = 8192  # samples interpolated at a time: what they need stays in the cache of the processor


def make(
    value,
    axes: Mapping[str, Any] | None = None,
    regressors: Sequence[str] = (),
    *,
    stderr=None,
    source: str | None = None,
    K1: xr.DataArray | None = None,
    K2: xr.DataArray | None = None,
    outside: str = "hold",
    **text: str,
) -> xr.Dataset:
    """Return a term leaf.

    Parameters
    ----------
    value : array
        Node values; dimension order as `axes`. [1, or per unit of the regressors]
    axes : mapping of str to array, optional
        Axis name (a quantity of the vocabulary) to breakpoints, rising. [SI]
    regressors : sequence of str
        Up to two model variables that multiply the table; ``("alpha", "alpha")`` is a square.
    stderr : array or float, optional
        Standard error of the nodes, broadcast to the shape of `value`.
    source : {"datcom", "flight", "judgement"}, optional
        Where the nodes come from.
    K1, K2 : DataArray, optional
        Factor tables over axes that `value` does not have.
    outside : {"hold", "linear"}
        Value beyond the last breakpoint in simulation.
    **text : str
        Further attributes: ``references``, ``history``, ``comment``.

    Raises
    ------
    SchemaError
        With all faults of the leaf.
    """
    coords = {name: np.asarray(points, float) for name, points in (axes or {}).items()}
    array = np.asarray(value, float)
    leaf = xr.Dataset({"value": (tuple(coords), array)}, coords=coords)
    for name in coords:
        leaf[name].attrs.update(attrs(name))
    for name, table in (("K1", K1), ("K2", K2)):
        if table is not None:
            leaf[name] = table
    if stderr is not None:
        leaf["stderr"] = leaf["value"].dims, np.broadcast_to(np.asarray(stderr, float), array.shape).copy()
    if source is not None:
        leaf["source"] = leaf["value"].dims, np.full(array.shape, SOURCES.index(source), np.uint8)
        leaf["source"].attrs = dict(SOURCE_ATTRS)
    leaf.attrs = {"regressors": " ".join(regressors), "outside": outside, **text}
    problems = check(leaf)
    if problems:
        raise SchemaError("term", problems)
    return leaf


def regressors(leaf: xr.Dataset) -> tuple[str, ...]:
    """Return the regressors of a leaf, in order."""
    return tuple(str(leaf.attrs.get("regressors", "")).split())


def check(leaf: xr.Dataset) -> list[str]:
    """Return every fault of a leaf as a text; an empty list means it is sound."""
    if "value" not in leaf:
        return [f"has no variable 'value' (found: {', '.join(map(str, leaf.data_vars)) or 'nothing'})"]
    problems = []
    seen: dict[str, str] = {}
    for name in _TABLES:
        if name not in leaf:
            continue
        table = leaf[name]
        if table.ndim > MAX_AXES:
            problems.append(f"{name} has {table.ndim} axes; at most {MAX_AXES} are allowed")
        for axis in map(str, table.dims):
            if axis in seen:
                problems.append(f"{name} and {seen[axis]} share the axis {axis}; merge them into one table")
            seen[axis] = name
            problems += _check_axis(table, axis)
        if not _numeric(table):
            problems.append(f"{name} holds {table.dtype}; numbers are needed")
        elif bad := int((~np.isfinite(table.values.astype(float))).sum()):
            problems.append(f"{name} holds {bad} NaN or infinite nodes of {table.size}; trim or fill the table first")
    for name in ("stderr", "source"):
        if name in leaf:
            problems += _check_beside(leaf, name)
    words = regressors(leaf)
    if len(words) > MAX_REGRESSORS:
        problems.append(f"has {len(words)} regressors ({' '.join(words)}); at most {MAX_REGRESSORS} are allowed")
    for word in words:
        problems += _unknown(word, "regressor")
    if leaf.attrs.get("outside", "hold") not in ("hold", "linear"):
        problems.append(f"attribute outside is {leaf.attrs['outside']!r}; allowed: hold, linear")
    for key, item in leaf.attrs.items():
        if isinstance(item, bool) or not isinstance(item, str | int | float | np.integer | np.floating):
            problems.append(f"attribute {key} is a {type(item).__name__}; only text and numbers survive in a file")
    return problems


def _numeric(table: xr.DataArray) -> bool:
    return table.dtype.kind in "iuf"


def _check_beside(leaf: xr.Dataset, name: str) -> list[str]:
    """Return the faults of the standard errors or sources that stand beside the value."""
    table = leaf[name]
    problems = []
    if table.dims != leaf["value"].dims:
        problems.append(f"{name} has dimensions {table.dims}, value has {leaf['value'].dims}")
    if not _numeric(table):
        problems.append(f"{name} holds {table.dtype}; numbers are needed")
    elif name == "stderr" and not (table.values >= 0).all():
        problems.append("stderr holds negative or NaN values")
    elif name == "source" and not np.isin(table.values, range(len(SOURCES))).all():
        codes = ", ".join(f"{code} {word}" for code, word in enumerate(SOURCES))
        problems.append(f"source holds codes beside {codes}")
    return problems


def _check_axis(table: xr.DataArray, axis: str) -> list[str]:
    problems = _unknown(axis, "axis")
    if axis not in table.coords:
        return [*problems, f"axis {axis} has no breakpoints"]
    if not problems:
        problems = _check_units(axis, table[axis].attrs.get("units"))
    if not _numeric(table[axis]):
        return [*problems, f"axis {axis} holds {table[axis].dtype}; numbers are needed"]
    points = table[axis].values.astype(float)
    if not np.isfinite(points).all():
        problems.append(f"axis {axis} holds NaN or infinite breakpoints")
    elif not points.size:
        problems.append(f"axis {axis} has no breakpoints")
    elif (np.diff(points) <= 0).any():
        at = int(np.flatnonzero(np.diff(points) <= 0)[0])
        problems.append(f"axis {axis} does not rise: {points[at]:g} is followed by {points[at + 1]:g}")
    return problems


def _check_units(axis: str, given: Any) -> list[str]:
    """Return the fault of a units attribute that contradicts the vocabulary; without one the breakpoints count as SI."""
    needed = lookup(axis).units
    try:
        if given is None or parse(str(given)) == parse(needed):
            return []
    except UnitError:
        pass
    return [f"axis {axis} is given in {str(given)!r}, a term holds {needed!r}: convert the breakpoints and set their attribute units"]


def _unknown(name: str, what: str) -> list[str]:
    try:
        lookup(name)
    except UnknownName as error:
        return [f"{what}: {error}"]
    return []


def variables(leaf: xr.Dataset) -> set[str]:
    """Return the names of all model variables a leaf needs: axes of all its tables and regressors."""
    axes = {str(d) for name in _TABLES if name in leaf for d in leaf[name].dims}
    return axes | set(regressors(leaf))


def evaluate(leaf: xr.Dataset, conditions: Mapping[str, Any], outside: str = "raise", places: dict[Any, Place] | None = None) -> np.ndarray:
    """Return the contribution of a term at given conditions.

    Parameters
    ----------
    leaf : Dataset
        The term.
    conditions : mapping of str to array
        Model variables by name, broadcast against each other; a Dataset of a manoeuvre will do. [SI]
    outside : {"raise", "clamp"}
        What to do beyond the table: raise, or follow the leaf's own rule as the simulation does.
    places : dict, optional
        Empty at first and passed with every term evaluated at the same conditions: where these lie between breakpoints is then
        found once for all tables that share them.

    Returns
    -------
    array (broadcast shape of the variables used)

    Raises
    ------
    OutOfRange
        A value lies outside the table and `outside` is ``"raise"``; ``mask`` marks the samples.
    UnknownName
        A variable of the term is missing in `conditions`.

    Notes
    -----
    The same number as ``basis @ value``, but for rounding, without the matrix.
    """
    found = np.ones(())
    for name in _TABLES:
        if name in leaf:
            found = found * _interpolated(leaf, name, conditions, outside, {} if places is None else places)
    for name in regressors(leaf):
        found = found * np.asarray(_get(name, conditions), float)
    return np.asarray(found)


def basis(leaf: xr.Dataset, conditions: Mapping[str, Any], outside: str = "raise") -> csr_array:
    """Return the linear map from the nodes of ``value`` to the contribution of the term.

    Parameters
    ----------
    leaf, conditions, outside
        As in `evaluate`.

    Returns
    -------
    sparse array (samples, nodes)
        ``basis @ value.ravel()`` is the contribution; factors ``K1``, ``K2`` and regressors are inside.
    """
    from scipy.sparse import csr_array

    shape = _shape(leaf, conditions)
    columns, weights = _corners(leaf["value"], conditions, shape, outside, leaf.attrs.get("outside", "hold"))
    for name in ("K1", "K2"):
        if name in leaf:
            at, share = _corners(leaf[name], conditions, shape, outside, leaf.attrs.get("outside", "hold"))
            weights = weights * (share * leaf[name].values.ravel()[at]).sum(axis=1)[:, None]
    for name in regressors(leaf):
        weights = weights * _values(name, conditions, shape)[:, None]
    rows = np.repeat(np.arange(len(columns)), columns.shape[1])
    return csr_array((weights.ravel(), (rows, columns.ravel())), shape=(len(columns), leaf["value"].size))


def _shape(leaf: xr.Dataset, conditions: Mapping[str, Any]) -> tuple[int, ...]:
    return np.broadcast_shapes(*(np.shape(_get(name, conditions)) for name in sorted(variables(leaf))), ())


def _get(name: str, conditions: Mapping[str, Any]):
    if name not in conditions:
        raise UnknownName(name, map(str, conditions), "condition", "the term needs it; pass it with the conditions")
    item = conditions[name]
    return item.values if isinstance(item, xr.DataArray) else item


def _values(name: str, conditions: Mapping[str, Any], shape: tuple[int, ...]) -> np.ndarray:
    return np.broadcast_to(np.asarray(_get(name, conditions), float), shape).ravel()


def _corners(table: xr.DataArray, conditions, shape: tuple[int, ...], outside: str, rule: str) -> tuple[np.ndarray, np.ndarray]:
    """Return flat node indices and weights (samples, 2**axes) of multilinear interpolation."""
    _demand_choice(outside)
    count = int(np.prod(shape))
    columns, weights = np.zeros((count, 1), np.intp), np.ones((count, 1))
    for axis in map(str, table.dims):
        points = table[axis].values.astype(float)
        x = _values(axis, conditions, shape)
        if outside == "raise":
            _demand_inside(axis, points, x)
        low, fraction = _place(points, x, rule)
        step = int(len(points) > 1)
        columns = (columns * len(points))[:, :, None] + np.stack([low, low + step], axis=1)[:, None, :]
        weights = weights[:, :, None] * np.stack([1.0 - fraction, fraction], axis=1)[:, None, :]
        columns, weights = columns.reshape(count, -1), weights.reshape(count, -1)
    return columns, weights


def _place(points: np.ndarray, x: np.ndarray, rule: str) -> Place:
    """Return the breakpoint below each sample and how far on the way to the next one it lies."""
    if len(points) == 1:
        return np.zeros(x.shape, np.intp), np.zeros(x.shape)
    low = (points.searchsorted(x, side="right") - 1).clip(0, len(points) - 2)
    fraction = (x - points.take(low)) / np.diff(points).take(low)
    return low, fraction.clip(0.0, 1.0) if rule == "hold" else fraction


def _interpolated(leaf: xr.Dataset, name: str, conditions, outside: str, places: dict[Any, Place]) -> np.ndarray:
    """Return one table at conditions, in the broadcast shape of its own axes."""
    _demand_choice(outside)
    table = leaf.variables[name]
    nodes, shape = table.values.astype(float), ()
    varying: list[Place] = []
    rule = leaf.attrs.get("outside", "hold")
    for axis in map(str, table.dims):
        points = leaf.variables[axis].values.astype(float)
        x = np.asarray(_get(axis, conditions), float)
        shape = np.broadcast_shapes(shape, x.shape)
        key = (axis, points.tobytes(), outside, rule)
        if key not in places:
            if outside == "raise" and not _inside(points, x).all():
                _demand_inside(axis, points, _values(axis, conditions, _shape(leaf, conditions)))
            places[key] = _place(points, x, rule)
        low, fraction = places[key]
        if len(points) == 1:
            nodes = nodes.take(0, axis=len(varying))
        elif x.size == 1:  # the same for all samples: a table with one axis less
            first = int(low.item())
            below, above = (nodes.take(first + step, axis=len(varying)) for step in (0, 1))
            nodes = below + fraction.item() * (above - below)
        else:
            varying.append((low, fraction))
    if not varying:
        return np.full(shape, nodes)
    spread = [(np.broadcast_to(low, shape).ravel(), np.broadcast_to(fraction, shape).ravel()) for low, fraction in varying]
    return _multilinear(nodes, spread).reshape(shape)


def _multilinear(nodes: np.ndarray, places: Sequence[Place]) -> np.ndarray:
    """Return a table (axes...) at places along each axis, (samples,)."""
    starts, rises = nodes[..., :-1].ravel(), np.diff(nodes).ravel()
    sizes = (*nodes.shape[:-1], nodes.shape[-1] - 1)
    steps = [math.prod(sizes[i + 1 :]) for i in range(len(sizes))]
    found = np.empty(len(places[0][0]))

    def along(i: int, offset: int) -> np.ndarray:
        if i == len(places) - 1:
            value = rises[offset:].take(cell)
            value *= fractions[i]
            value += starts[offset:].take(cell)
            return value
        below, above = along(i + 1, offset), along(i + 1, offset + steps[i])
        above -= below
        above *= fractions[i]
        below += above
        return below

    for start in range(0, len(found), _BLOCK):
        block = slice(start, start + _BLOCK)
        fractions = [fraction[block] for _, fraction in places]
        cell = places[-1][0][block].copy()
        for (low, _), step in zip(places[:-1], steps):
            cell += low[block] * step
        found[block] = along(0, 0)
    return found


def _demand_choice(outside: str) -> None:
    if outside not in ("raise", "clamp"):
        raise ValueError(f"outside is {outside!r}; allowed: raise, clamp")


def _inside(points: np.ndarray, x: np.ndarray) -> np.ndarray:
    return (x >= points[0]) & (x <= points[-1])


def _demand_inside(axis: str, points: np.ndarray, x: np.ndarray) -> None:
    mask = ~_inside(points, x)
    if mask.any():
        worst = x[mask][np.argmax(np.abs(x[mask] - np.clip(x[mask], points[0], points[-1])))]
        raise OutOfRange(
            f"{axis} = {worst:.6g} lies outside {points[0]:.6g} ... {points[-1]:.6g} in {int(mask.sum())} of {len(x)} samples, "
            f"first at sample {int(np.argmax(mask))}; extend the table or pass outside='clamp'",
            mask,
        )
