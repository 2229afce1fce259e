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

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from .errors import OutOfRange, SchemaError, UnknownName
from .names import attrs, lookup

if TYPE_CHECKING:
    from scipy.sparse import csr_array

SOURCES = ("datcom", "flight", "judgement")
MAX_AXES = 4
MAX_REGRESSORS = 2
_TABLES = ("value", "K1", "K2")


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
        leaf["source"].attrs = {"flag_values": "0 1 2", "flag_meanings": " ".join(SOURCES)}
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
        bad = int((~np.isfinite(table.values.astype(float))).sum())
        if bad:
            problems.append(f"{name} holds {bad} NaN or infinite nodes of {table.size}; trim or fill the table first")
    for name in ("stderr", "source"):
        if name in leaf and leaf[name].dims != leaf["value"].dims:
            problems.append(f"{name} has dimensions {leaf[name].dims}, value has {leaf['value'].dims}")
    if "stderr" in leaf and leaf["stderr"].size and not (leaf["stderr"].values >= 0).all():
        problems.append("stderr holds negative or NaN values")
    words = regressors(leaf)
    if len(words) > MAX_REGRESSORS:
        problems.append(f"has {len(words)} regressors ({' '.join(words)}); at most {MAX_REGRESSORS} are allowed")
    for word in words:
        problems += _unknown(word, "regressor")
    if leaf.attrs.get("outside", "hold") not in ("hold", "linear"):
        problems.append(f"attribute outside is {leaf.attrs['outside']!r}; allowed: hold, linear")
    for key, item in leaf.attrs.items():
        if not isinstance(item, str | int | float | np.integer | np.floating):
            problems.append(f"attribute {key} is a {type(item).__name__}; only text and numbers survive in a file")
    return problems


def _check_axis(table: xr.DataArray, axis: str) -> list[str]:
    problems = _unknown(axis, "axis")
    if axis not in table.coords:
        return [*problems, f"axis {axis} has no breakpoints"]
    points = table[axis].values.astype(float)
    if not np.isfinite(points).all():
        problems.append(f"axis {axis} holds NaN or infinite breakpoints")
    elif (np.diff(points) <= 0).any():
        at = int(np.flatnonzero(np.diff(points) <= 0)[0])
        problems.append(f"axis {axis} does not rise: {points[at]:g} is followed by {points[at + 1]:g}")
    return problems


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


def evaluate(leaf: xr.Dataset, conditions: Mapping[str, Any], outside: str = "raise") -> np.ndarray:
    """Return the contribution of a term at given conditions.

    Parameters
    ----------
    leaf : Dataset
        The term.
    conditions : mapping of str to array
        Model variables by name, broadcast against each other; a Dataset of a manoeuvre will do. [SI]
    outside : {"raise", "clamp"}
        What to do beyond the table: raise, or follow the leaf's own rule as the simulation does.

    Returns
    -------
    array (broadcast shape of the variables used)

    Raises
    ------
    OutOfRange
        A value lies outside the table and `outside` is ``"raise"``; ``mask`` marks the samples.
    UnknownName
        A variable of the term is missing in `conditions`.
    """
    shape = _shape(leaf, conditions)
    return (basis(leaf, conditions, outside) @ leaf["value"].values.ravel()).reshape(shape)


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
    if outside not in ("raise", "clamp"):
        raise ValueError(f"outside is {outside!r}; allowed: raise, clamp")
    count = int(np.prod(shape))
    columns, weights = np.zeros((count, 1), np.intp), np.ones((count, 1))
    for axis in map(str, table.dims):
        points = table[axis].values.astype(float)
        x = _values(axis, conditions, shape)
        if outside == "raise":
            _demand_inside(axis, points, x)
        if len(points) == 1:
            low, fraction, step = np.zeros(count, np.intp), np.zeros(count), 0
        else:
            low = np.clip(np.searchsorted(points, x, side="right") - 1, 0, len(points) - 2)
            fraction = (x - points[low]) / (points[low + 1] - points[low])
            if rule == "hold":
                fraction = np.clip(fraction, 0.0, 1.0)
            step = 1
        columns = (columns * len(points))[:, :, None] + np.stack([low, low + step], axis=1)[:, None, :]
        weights = weights[:, :, None] * np.stack([1.0 - fraction, fraction], axis=1)[:, None, :]
        columns, weights = columns.reshape(count, -1), weights.reshape(count, -1)
    return columns, weights


def _demand_inside(axis: str, points: np.ndarray, x: np.ndarray) -> None:
    mask = ~((x >= points[0]) & (x <= points[-1]))
    if mask.any():
        worst = x[mask][np.argmax(np.abs(x[mask] - np.clip(x[mask], points[0], points[-1])))]
        raise OutOfRange(
            f"{axis} = {worst:.6g} lies outside {points[0]:.6g} ... {points[-1]:.6g} in {int(mask.sum())} of {len(x)} samples, "
            f"first at sample {int(np.argmax(mask))}; extend the table or pass outside='clamp'",
            mask,
        )
