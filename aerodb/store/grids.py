"""Leaves brought onto other breakpoints, and sums of leaves over the union of their breakpoints.

Tables are multilinear, so a grid that holds all old breakpoints loses nothing.  At a new node the
value is what the simulation computes there; the standard error is interpolated like the value, as
if the errors of neighbouring nodes went together; the source is that of the nodes it comes from
when they share one, else judgement, which is also the source of nodes beyond the old table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.overview import display_text
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import quantity_attributes

JUDGEMENT = _terms.SOURCES.index("judgement")
# of the span of an axis: breakpoints closer than this are the same; degrees come to radians on
# several ways
_NEAR = 1e-9
_FACTORS = ("K1", "K2")


def merge_breakpoints(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the breakpoints of two axes, rising; those of `second` that repeat one of `first` are
    left out.
    """
    first, second = np.asarray(first, float), np.asarray(second, float)
    near = _NEAR * np.ptp(np.concatenate([first, second]))
    fresh = second[np.abs(second[:, None] - first).min(axis=1) > near]
    return np.sort(np.concatenate([first, fresh]))


def is_within(points: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return which of `x` lie between the first and the last breakpoint."""
    near = _NEAR * np.ptp(np.append(points, x))
    return (x >= points[0] - near) & (x <= points[-1] + near)


def value_breakpoints(leaf: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the breakpoints of the table by axis, in its order."""
    return {str(axis): leaf[axis].values.astype(float) for axis in leaf["value"].dims}


def union_axes(*leaves: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the breakpoints of several tables together."""
    points: dict[str, np.ndarray] = {}
    for leaf in leaves:
        for axis, own in value_breakpoints(leaf).items():
            points[axis] = merge_breakpoints(points[axis], own) if axis in points else own
    return points


def rising_breakpoints(axis: str, points: Any) -> np.ndarray:
    """Return breakpoints as an array; a `SchemaError` when they do not rise."""
    found = np.asarray(points, float)
    if (
        found.ndim != 1
        or not found.size
        or not np.isfinite(found).all()
        or (np.diff(found) <= 0).any()
    ):
        raise SchemaError(
            "breakpoints", [f"of {axis} are {points!r}; give finite numbers that rise"]
        )
    return found


def demand_axis(name: str, leaf: xr.Dataset, axis: str) -> None:
    """Raise `UnknownName` when `axis` is none of the table's."""
    if axis not in leaf["value"].dims:
        hint = (
            "it belongs to a factor; put a changed leaf in with replace_terms"
            if axis in factor_axes(leaf)
            else f"of the table {name}"
        )
        raise UnknownName(axis, map(str, leaf["value"].dims), "axis", hint)


def make_table_leaf(
    value: Any, axes: Mapping[str, Any] | None, stderr: Any, what: str
) -> xr.Dataset:
    """Return a number, or a table over axes, as a leaf."""
    shape = tuple(np.size(points) for points in (axes or {}).values())
    over = (
        f"its axes {', '.join(axes)} need {shape}"
        if axes
        else "a number, or axes for it, is needed"
    )
    faults = [f"has the shape {np.shape(value)}; {over}"] if np.shape(value) != shape else []
    if np.shape(stderr) not in ((), shape):
        faults.append(
            f"stderr has the shape {np.shape(stderr)}; a number or the shape {shape} is needed"
        )
    if faults:
        raise SchemaError(what, faults)
    return _terms.make_term(value, axes, stderr=stderr)


def regrid_leaf(leaf: xr.Dataset, points: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Return a leaf with its table on other breakpoints; axes it did not have are added, factors
    and attributes stay.

    Parameters
    ----------
    points : mapping of str to array
        All axes of the new table in order, those of the leaf among them. [SI]
    """
    alone = _terms.without_multipliers(leaf[["value"]])
    mesh = dict(zip(points, np.meshgrid(*points.values(), indexing="ij"))) if points else {}
    shape = tuple(len(p) for p in points.values())
    own = np.broadcast_shapes(*(mesh[axis].shape for axis in value_breakpoints(leaf)), ())
    B = _terms.basis(alone, mesh, "clamp")

    def there(nodes: np.ndarray, weights) -> np.ndarray:
        return np.broadcast_to((weights @ nodes.ravel()).reshape(own), shape)

    new = {"value": there(leaf["value"].values, B)}
    if "stderr" in leaf:
        new["stderr"] = there(leaf["stderr"].values, abs(B))
    if "source" in leaf:
        codes = leaf["source"].values
        shares = np.array(
            [there((codes == code).astype(float), abs(B)) for code in range(len(_terms.SOURCES))]
        )
        beyond = np.zeros(shape, bool)
        for axis, old in value_breakpoints(leaf).items():
            beyond |= ~is_within(old, mesh[axis])
        new["source"] = np.where(beyond, JUDGEMENT, _single(shares > _NEAR, JUDGEMENT))
    return with_table(leaf, points, **new)


def with_table(
    leaf: xr.Dataset, points: Mapping[str, np.ndarray], value, stderr=None, source=None
) -> xr.Dataset:
    """Return a leaf with another table; factors and attributes stay, standard error and source only
    when given.
    """
    dims = tuple(points)
    tables = {"value": (dims, np.array(value, float), leaf["value"].attrs)}
    if stderr is not None:
        tables["stderr"] = (
            dims,
            np.array(stderr, float),
            leaf["stderr"].attrs if "stderr" in leaf else {},
        )
    if source is not None:
        tables["source"] = (
            dims,
            np.array(source, np.uint8),
            {"flag_values": "0 1 2", "flag_meanings": " ".join(_terms.SOURCES)},
        )
    coords = {
        axis: (
            axis,
            own,
            dict(leaf[axis].attrs) if axis in leaf.coords else quantity_attributes(axis),
        )
        for axis, own in points.items()
    }
    new = xr.Dataset(tables, coords, leaf.attrs)
    factors = {key: leaf[key] for key in _FACTORS if key in leaf}
    return new.assign(factors) if factors else new


def fold_factors(leaf: xr.Dataset) -> xr.Dataset:
    """Return a leaf with its factors multiplied into the table, which computes the same: their axes
    are others.
    """
    factors = [leaf[key] for key in _FACTORS if key in leaf]
    if not factors:
        return leaf
    points = value_breakpoints(leaf)
    for factor in factors:
        points |= {str(axis): factor[axis].values.astype(float) for axis in factor.dims}
    one = xr.DataArray(np.ones([len(p) for p in points.values()]), dict(points), tuple(points))
    times = one
    for factor in factors:
        times = times * factor
    scale = {"value": times, "stderr": abs(times), "source": one}
    whole = {
        key: (leaf[key] * scale[key]).transpose(*points).values for key in scale if key in leaf
    }
    new = with_table(leaf.drop_vars(list(_FACTORS), errors="ignore"), points, **whole)
    faults = _terms.check_term(new)
    if faults:
        raise SchemaError("factors multiplied into the table", faults)
    return new


def without_formula(leaf: xr.Dataset) -> xr.Dataset:
    """Return a leaf whose factors no longer state which formula they came from: their breakpoints
    have changed.
    """
    changed = {}
    for key in _FACTORS:
        if key in leaf and "formula" in leaf[key].attrs:
            changed[key] = leaf[key].copy()
            del changed[key].attrs["formula"]
    return leaf.assign(changed)


def same_factors(first: xr.Dataset, second: xr.Dataset) -> bool:
    """Return whether two leaves have the same factor tables."""
    return all(
        (key in first) == (key in second) and (key not in first or first[key].equals(second[key]))
        for key in _FACTORS
    )


def add_leaves(leaf: xr.Dataset, more: xr.Dataset) -> xr.Dataset:
    """Return the sum of two leaves that the same things multiply, over the union of their
    breakpoints; errors count as independent.

    Raises
    ------
    SchemaError
        Their factors differ and the table without them has too many axes.
    """
    if not same_factors(leaf, more):
        leaf, more = fold_factors(leaf), fold_factors(more)
    points = union_axes(leaf, more)
    if len(points) > _terms.MAX_AXES:
        raise SchemaError(
            "sum", [f"has the axes {' '.join(points)}; at most {_terms.MAX_AXES} are allowed"]
        )
    a, b = regrid_leaf(leaf, points), regrid_leaf(more, points)
    value = a["value"].values + b["value"].values
    errors = [part["stderr"].values for part in (a, b) if "stderr" in part]
    stderr = np.sqrt(sum(sd**2 for sd in errors)) if errors else None
    return with_table(a, points, value, stderr, joint_source(a, b))


def joint_source(*parts: xr.Dataset) -> np.ndarray:
    """Return the sources of the nodes of a sum: that of the parts that are not zero when they share
    one, else judgement.
    """
    codes = np.array([known_source(part) for part in parts])
    counts = np.array([part["value"].values != 0.0 for part in parts])
    shares = np.array(
        [((codes == code) & counts).any(axis=0) for code in range(len(_terms.SOURCES))]
    )
    return np.where(counts.any(axis=0), _single(shares, JUDGEMENT), codes[0])


def known_source(leaf: xr.Dataset) -> np.ndarray:
    """Return the source of every node; judgement where the leaf does not state it."""
    return (
        leaf["source"].values
        if "source" in leaf
        else np.full(leaf["value"].shape, JUDGEMENT, np.uint8)
    )


def factor_axes(leaf: xr.Dataset) -> set[str]:
    """Return the axes of the factors of a leaf."""
    return {str(axis) for key in _FACTORS if key in leaf for axis in leaf[key].dims}


def node_text(points: Mapping[str, np.ndarray], node: Sequence[int]) -> str:
    """Return where a node lies as a person reads it: ``mach 0.2, alpha 8 deg``."""
    return (
        ", ".join(
            f"{axis} {display_text(axis, own[i])}" for (axis, own), i in zip(points.items(), node)
        )
        or "its only node"
    )


def _single(present: np.ndarray, otherwise: int) -> np.ndarray:
    """Return the source that is present alone, (sources, ...) to (...)."""
    return np.where(present.sum(axis=0) == 1, present.argmax(axis=0), otherwise)
