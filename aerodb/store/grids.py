"""Leaves on other breakpoints, and sums of leaves over the union of their breakpoints.

Tables are multilinear, so that a grid with all old breakpoints represents a table exactly.  At a
new node the value is that of the simulation.  The standard error is interpolated like the value, as
if neighbouring nodes were fully correlated.  The source is that of the surrounding nodes if they
share one.  Otherwise, and beyond the old table, it is judgement.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.overview import display_text
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import ATTACHED_FLOW, quantity_attributes

JUDGEMENT = _terms.SOURCES.index("judgement")
# Breakpoints closer than this share of the span of an axis are equal.  Conversions of degrees to
# radians differ in their rounding.
_NEAR = 1e-9
_FACTORS = ("K1", "K2")


def neutral_value(name: str, points: np.ndarray) -> float:
    """Return the neutral value of a variable: zero, or the value in range nearest to it. [SI]

    That of `h_agl` is the highest one, free air, that of the flow separation is attached flow.
    """
    if name == "h_agl":
        return float(points[-1])
    return float(np.clip(ATTACHED_FLOW.get(name, 0.0), points[0], points[-1]))


def merge_breakpoints(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the rising union of the breakpoints of two axes.

    Breakpoints of `second` that repeat one of `first` are left out.
    """
    first, second = np.asarray(first, float), np.asarray(second, float)
    # Additional points are farther than rounding from every point of the first axis.
    near = _NEAR * np.ptp(np.concatenate([first, second]))
    additional = second[np.abs(second[:, None] - first).min(axis=1) > near]
    return np.sort(np.concatenate([first, additional]))


def is_within(points: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return which of `x` lie between the first and the last breakpoint."""
    near = _NEAR * np.ptp(np.append(points, x))
    return (x >= points[0] - near) & (x <= points[-1] + near)


def value_breakpoints(leaf: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the breakpoints of the table by axis, in its order."""
    return {str(axis): leaf[axis].values.astype(float) for axis in leaf["value"].dims}


def union_axes(*leaves: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the union of the breakpoints of several tables, by axis."""
    union: dict[str, np.ndarray] = {}
    for leaf in leaves:
        for axis, points in value_breakpoints(leaf).items():
            if axis in union:
                points = merge_breakpoints(union[axis], points)
            union[axis] = points
    return union


def rising_breakpoints(axis: str, points: Any) -> np.ndarray:
    """Return breakpoints as an array; raise `SchemaError` if they do not rise."""
    array = np.asarray(points, float)
    is_valid = array.ndim == 1 and array.size and np.isfinite(array).all()
    if not is_valid or (np.diff(array) <= 0).any():
        raise SchemaError(
            "breakpoints", [f"of {axis} are {points!r}; give finite numbers that rise"]
        )
    return array


def demand_axis(name: str, leaf: xr.Dataset, axis: str) -> None:
    """Raise `UnknownName` if `axis` is not an axis of the table."""
    if axis in leaf["value"].dims:
        return
    hint = f"of the table {name}"
    if axis in factor_axes(leaf):
        hint = "it belongs to a factor; put a changed leaf in with replace_terms"
    raise UnknownName(axis, map(str, leaf["value"].dims), "axis", hint)


def make_table_leaf(
    value: Any, axes: Mapping[str, Any] | None, stderr: Any, what: str
) -> xr.Dataset:
    """Return a number, or a table over axes, as a leaf."""
    shape = tuple(np.size(points) for points in (axes or {}).values())
    requirement = "a number, or axes for it, is needed"
    if axes:
        requirement = f"its axes {', '.join(axes)} need {shape}"
    faults = []
    if np.shape(value) != shape:
        faults.append(f"has the shape {np.shape(value)}; {requirement}")
    if np.shape(stderr) not in ((), shape):
        faults.append(
            f"stderr has the shape {np.shape(stderr)}; a number or the shape {shape} is needed"
        )
    if faults:
        raise SchemaError(what, faults)
    return _terms.make_term(value, axes, stderr=stderr)


def regrid_leaf(leaf: xr.Dataset, points: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Return a leaf with its table on other breakpoints.

    New axes are added.  Factors and attributes do not change.

    Parameters
    ----------
    leaf : Dataset
        The term.
    points : mapping of str to array
        All axes of the new table in order, those of the leaf among them. [SI]
    """
    table = _terms.without_multipliers(leaf[["value"]])
    mesh = {}
    if points:
        mesh = dict(zip(points, np.meshgrid(*points.values(), indexing="ij")))
    # Weights of the old nodes at the new ones: (new nodes, old nodes).
    weights = _terms.basis(table, mesh, "clamp")
    # Errors of neighbouring nodes count as fully correlated: they interpolate like the value.
    new = {"value": _interpolate(leaf, leaf["value"].values, weights, points)}
    if "stderr" in leaf:
        new["stderr"] = _interpolate(leaf, leaf["stderr"].values, abs(weights), points)
    if "source" in leaf:
        new["source"] = _interpolate_source(leaf, abs(weights), points, mesh)
    return with_table(leaf, points, **new)


def _interpolate(
    leaf: xr.Dataset, nodes: np.ndarray, weights: Any, points: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Return node values at the new breakpoints, in the shape of the new table."""
    shape = tuple(len(axis_points) for axis_points in points.values())
    # A table without axes has one value, which is repeated at all new nodes.
    table_shape = shape
    if not leaf["value"].ndim:
        table_shape = ()
    return np.broadcast_to((weights @ nodes.ravel()).reshape(table_shape), shape)


def _interpolate_source(
    leaf: xr.Dataset,
    weights: Any,
    points: Mapping[str, np.ndarray],
    mesh: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Return the sources at the new breakpoints; judgement beyond the old table."""
    codes = leaf["source"].values
    # Weight of the nodes of each source at every new node.
    shares = []
    for code in range(len(_terms.SOURCES)):
        shares.append(_interpolate(leaf, (codes == code).astype(float), weights, points))
    outside = np.zeros(shares[0].shape, bool)
    for axis, old in value_breakpoints(leaf).items():
        outside |= ~is_within(old, mesh[axis])
    return np.where(outside, JUDGEMENT, _single_source(np.array(shares) > _NEAR))


def with_table(
    leaf: xr.Dataset,
    points: Mapping[str, np.ndarray],
    value: Any,
    stderr: Any = None,
    source: Any = None,
) -> xr.Dataset:
    """Return a leaf with another table.

    Factors and attributes do not change.  The result has a standard error and a source only if they
    are given.
    """
    dims = tuple(points)
    tables = {"value": (dims, np.array(value, float), leaf["value"].attrs)}
    if stderr is not None:
        attributes = {}
        if "stderr" in leaf:
            attributes = leaf["stderr"].attrs
        tables["stderr"] = dims, np.array(stderr, float), attributes
    if source is not None:
        flags = _terms.source_attributes(np.asarray(source))
        tables["source"] = dims, np.array(source, np.uint8), flags
    coords = {}
    for axis, axis_points in points.items():
        attributes = quantity_attributes(axis)
        if axis in leaf.coords:
            attributes = dict(leaf[axis].attrs)
        coords[axis] = axis, axis_points, attributes
    new = xr.Dataset(tables, coords, leaf.attrs)
    factors = {key: leaf[key] for key in _FACTORS if key in leaf}
    if not factors:
        return new
    return new.assign(factors)


def fold_factors(leaf: xr.Dataset) -> xr.Dataset:
    """Return a leaf with its factors multiplied into the table.

    It computes the same coefficient.  The axes of the factors become axes of the table.
    """
    factors = [leaf[key] for key in _FACTORS if key in leaf]
    if not factors:
        return leaf
    points = value_breakpoints(leaf)
    for factor in factors:
        for axis in factor.dims:
            points[str(axis)] = factor[axis].values.astype(float)
    shape = [len(axis_points) for axis_points in points.values()]
    ones = xr.DataArray(np.ones(shape), dict(points), tuple(points))
    product = ones
    for factor in factors:
        product = product * factor
    # The sources are only repeated along the new axes.
    multipliers = {"value": product, "stderr": abs(product), "source": ones}
    tables = {}
    for key, multiplier in multipliers.items():
        if key in leaf:
            tables[key] = (leaf[key] * multiplier).transpose(*points).values
    new = with_table(leaf.drop_vars(list(_FACTORS), errors="ignore"), points, **tables)
    faults = _terms.check_term(new)
    if faults:
        raise SchemaError("factors multiplied into the table", faults)
    return new


def without_formula(leaf: xr.Dataset) -> xr.Dataset:
    """Return a leaf whose factors do not state a formula, because their breakpoints changed."""
    changed = {}
    for key in _FACTORS:
        if key in leaf and "formula" in leaf[key].attrs:
            changed[key] = leaf[key].copy()
            del changed[key].attrs["formula"]
    return leaf.assign(changed)


def same_factors(first: xr.Dataset, second: xr.Dataset) -> bool:
    """Return whether two leaves have the same factor tables."""
    for key in _FACTORS:
        if (key in first) != (key in second):
            return False
        if key in first and not first[key].equals(second[key]):
            return False
    return True


def add_leaves(leaf: xr.Dataset, added: xr.Dataset) -> xr.Dataset:
    """Return the sum of two leaves over the union of their breakpoints.

    The same variables must multiply both.  Their errors count as independent.

    Raises
    ------
    SchemaError
        Their factors differ and the table without them has too many axes.
    """
    # Tables with equal factors can be added as they are: K (a + b) = K a + K b.
    if not same_factors(leaf, added):
        leaf, added = fold_factors(leaf), fold_factors(added)
    points = union_axes(leaf, added)
    if len(points) > _terms.MAX_AXES:
        raise SchemaError(
            "sum", [f"has the axes {' '.join(points)}; at most {_terms.MAX_AXES} are allowed"]
        )
    a, b = regrid_leaf(leaf, points), regrid_leaf(added, points)
    value = a["value"].values + b["value"].values
    errors = [part["stderr"].values for part in (a, b) if "stderr" in part]
    stderr = None
    if errors:
        stderr = np.sqrt(sum(sd**2 for sd in errors))
    return with_table(a, points, value=value, stderr=stderr, source=joint_source(a, b))


def joint_source(*parts: xr.Dataset) -> np.ndarray:
    """Return the sources of the nodes of a sum.

    The parts that are not zero decide: their source if they share one, else judgement.
    """
    codes = np.array([known_source(part) for part in parts])
    is_nonzero = np.array([part["value"].values != 0.0 for part in parts])
    present = []
    for code in range(len(_terms.SOURCES)):
        present.append(((codes == code) & is_nonzero).any(axis=0))
    return np.where(is_nonzero.any(axis=0), _single_source(np.array(present)), codes[0])


def known_source(leaf: xr.Dataset) -> np.ndarray:
    """Return the source of every node; judgement if the leaf does not state it."""
    if "source" in leaf:
        return leaf["source"].values
    return np.full(leaf["value"].shape, JUDGEMENT, np.uint8)


def factor_axes(leaf: xr.Dataset) -> set[str]:
    """Return the axes of the factors of a leaf."""
    axes: set[str] = set()
    for key in _FACTORS:
        if key in leaf:
            axes.update(map(str, leaf[key].dims))
    return axes


def node_text(points: Mapping[str, np.ndarray], node: Sequence[int]) -> str:
    """Return the position of a node as a text, such as ``mach 0.2, alpha 8 deg``."""
    texts = []
    for (axis, axis_points), index in zip(points.items(), node):
        texts.append(f"{axis} {display_text(axis, axis_points[index])}")
    return ", ".join(texts) or "its only node"


def _single_source(present: np.ndarray) -> np.ndarray:
    """Return the only source that is present, else judgement: (sources, ...) to (...)."""
    return np.where(present.sum(axis=0) == 1, present.argmax(axis=0), JUDGEMENT)


def has_same_table(first: xr.Dataset, second: xr.Dataset) -> bool:
    """Return whether two leaves hold the same values and standard errors at the same nodes."""
    tables = [key for key in ("value", "stderr") if key in first or key in second]
    return all(key in first and key in second for key in tables) and all(
        first[key].equals(second[key]) for key in tables
    )
