"""Families of curves out of databases: what a figure shows, as numbers.

A family is a term or a coefficient over one variable (``over``), one curve per value of a second
one (``by``), every further variable held.  Terms are shown as their tables, K-factors included and
regressors left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from aerodb.comparison.conditions import (
    Conditions,
    coefficient_points,
    leaf_breakpoints,
    merge_leaf_breakpoints,
    neutral_value,
)
from aerodb.store.schema import terms
from aerodb.update.standard_errors import standard_errors
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName

MOST_MEMBERS = 9
# preferred abscissa, first; a family runs over the remaining variables in this order, Mach number
# after the causes
_OVER = (
    "alpha",
    "beta",
    "delta_e",
    "delta_a",
    "delta_r",
    "delta_t",
    "delta_ta",
    "delta_tr",
    "delta_s",
    "delta_d",
    "delta_f",
    "mach",
)
_BY = (
    "h_agl",
    "delta_f",
    "delta_e",
    "delta_a",
    "delta_r",
    "delta_s",
    "delta_d",
    "gear",
    "speedbrake",
    "mach",
    "h",
    "alpha",
)
_FINE = 4  # points per interval of the breakpoints: standard errors bend in between
# what distinguishes configurations when flight samples are sorted to the curves of a coefficient
_CONFIGURATION = ("mach", "delta_f", "gear", "speedbrake")


@dataclass(frozen=True)
class DatabaseCurve:
    """One curve of one database.

    ``x`` [SI], ``y`` and ``stderr`` are (points,), the standard error zero where none is stated;
    ``node_x``, ``node_y`` and ``node_source`` (0 datcom, 1 flight, 2 judgement, -1 not stated) are
    the breakpoints of the table that lie on the curve.
    """

    x: np.ndarray
    y: np.ndarray
    stderr: np.ndarray
    node_x: np.ndarray = field(default_factory=lambda: np.zeros(0))
    node_y: np.ndarray = field(default_factory=lambda: np.zeros(0))
    node_source: np.ndarray = field(default_factory=lambda: np.zeros(0, int))


@dataclass(frozen=True)
class Family:
    """Curves of several databases.

    Attributes
    ----------
    name : str
        Term (``CL/basic``) or coefficient (``CL``).
    over, by : str
        The abscissa, and the variable that distinguishes the curves (empty for a single curve).
    members : tuple of float
        Values of `by`, one curve each. [SI]
    held : dict of str to float
        Every further variable. [SI]
    regressors : tuple of str
        What multiplies the table; empty for a coefficient.
    points : dict of str to array
        Breakpoints by variable, of all databases. [SI]
    curves : dict of str to list of Curve or None
        Database to one curve per member, None where its table does not reach.
    power : Power or None
        The power factor that multiplies the table too.
    """

    name: str
    over: str
    by: str
    members: tuple[float, ...]
    held: dict[str, float]
    regressors: tuple[str, ...]
    points: dict[str, np.ndarray]
    curves: dict[str, list[DatabaseCurve | None]]
    power: _terms.PowerFactor | None = None

    @property
    def is_term(self) -> bool:
        """Whether a term is shown, and not a whole coefficient."""
        return "/" in self.name

    def place(self, member: int) -> dict[str, float]:
        """Return the variables that are fixed on one curve. [SI]"""
        return {**self.held, **({self.by: self.members[member]} if self.by else {})}


def curve_family(
    databases: Mapping[str, xr.DataTree],
    name: str,
    by: str | None = None,
    over: str | None = None,
    at: Mapping[str, float] | None = None,
) -> Family:
    """Return the curves of a term or coefficient.

    Parameters
    ----------
    databases : mapping of str to DataTree
        Name to database.
    name : str
        ``"CL/basic"``, or ``"CL"`` for the whole coefficient.
    by, over : str, optional
        Family variable and abscissa; chosen when left out: over alpha, else a deflection, else Mach
        number, by the cause of a term, else Mach number.
    at : mapping of str to float, optional
        Where the other variables are held. By default: those of a coefficient at rest, in free air,
        at the middle Mach number; those of a term where its table is largest, at the middle Mach
        number. [SI]

    Raises
    ------
    UnknownName
        No database has the term or coefficient, or a variable is none of its own.
    SchemaError
        A term without axes, which has no curve, or one with other regressors in each database.
    """
    source = _source(databases, name)
    over, by, held = _layout(source, by, over, at)
    members = thin_breakpoints(source.points[by]) if by else (0.0,)
    curves = {
        label: [source.curve(label, over, {**held, **({by: x} if by else {})}) for x in members]
        for label in source.labels
    }
    if by:
        members, curves = _distinct(members, curves)
    return Family(
        name, over, by, members, held, source.regressors, source.points, curves, source.power
    )


@dataclass(frozen=True)
class DifferenceSurface:
    """The difference of two databases over two variables.

    ``x`` (of `over`) and ``y`` (of `by`) [SI] are the sides of the grid; ``difference`` (last less
    first) and ``stderr`` (of the first) are (y, x), NaN where a table does not reach; ``family``
    holds the names and what is held.
    """

    family: Family
    x: np.ndarray
    y: np.ndarray
    difference: np.ndarray
    stderr: np.ndarray


def difference_surface(
    databases: Mapping[str, xr.DataTree],
    name: str,
    by: str | None = None,
    over: str | None = None,
    at: Mapping[str, float] | None = None,
) -> DifferenceSurface:
    """Return how the last of several databases differs from the first over two axes; arguments and
    errors as in `family`.

    Raises
    ------
    SchemaError
        One axis only, or the term is in one database only.
    """
    source = _source(databases, name)
    over, by, held = _layout(source, by, over, at)
    if not by:
        raise SchemaError(name, [f"has the one axis {over}; a map needs two"])
    if len(source.labels) < 2:
        raise SchemaError(name, [f"is in {source.labels[0]} only; a difference needs two"])
    first, last = source.labels[0], source.labels[-1]
    x, y = refine_breakpoints(source.points[over]), refine_breakpoints(source.points[by])
    difference, stderr = np.full((2, len(y), len(x)), np.nan)
    for i, member in enumerate(y):
        a, b = (source.curve(label, over, {**held, by: float(member)}) for label in (first, last))
        if a is not None and b is not None:
            inside = (x >= max(a.x[0], b.x[0])) & (x <= min(a.x[-1], b.x[-1]))
            difference[i, inside] = np.interp(x[inside], b.x, b.y) - np.interp(x[inside], a.x, a.y)
            stderr[i, inside] = np.interp(x[inside], a.x, a.stderr)
    lone: dict[str, list[DatabaseCurve | None]] = {label: [] for label in (first, last)}
    return DifferenceSurface(
        Family(name, over, by, (), held, source.regressors, source.points, lone, source.power),
        x,
        y,
        difference,
        stderr,
    )


def supporting_samples(support: Conditions | None, shown: Family, member: int) -> np.ndarray:
    """Return the abscissae of the flight samples that belong to one curve: on every fixed variable
    its node is the nearest. [SI]
    """
    if support is None or shown.over not in support:
        return np.zeros(0)
    place = shown.place(member)
    x = np.ravel(np.asarray(support[shown.over], float))
    near = np.isfinite(x)
    for axis, value in place.items():
        sorts = shown.is_term or axis == shown.by or axis in _CONFIGURATION
        if axis in support and sorts and len(nodes := np.union1d(shown.points[axis], [value])) > 1:
            given = np.broadcast_to(np.ravel(np.asarray(support[axis], float)), x.shape)
            near &= nodes[np.abs(given[:, None] - nodes).argmin(axis=1)] == value
    return x[near]


def _source(databases: Mapping[str, xr.DataTree], name: str) -> _TermSource | _CoefficientSource:
    return _TermSource(databases, name) if "/" in name else _CoefficientSource(databases, name)


def _layout(
    source: _TermSource | _CoefficientSource,
    by: str | None,
    over: str | None,
    at: Mapping[str, float] | None,
) -> tuple[str, str, dict[str, float]]:
    """Return abscissa, family variable and where the others are held."""
    over = _chosen(over, source.points, _OVER, source.name, ())
    others = [
        axis for axis in source.points if axis != over and (source.is_axis(axis) or axis == by)
    ]
    if by is not None and by not in others:
        raise UnknownName(by, others, "axis", f"{source.name} has curves by these, over {over}")
    by = (
        _chosen(
            by, {axis: source.points[axis] for axis in others}, source.order, source.name, (over,)
        )
        if others
        else ""
    )
    held = {axis: source.held(axis) for axis in source.points if axis not in (over, by)}
    for axis, value in (at or {}).items():
        if axis not in held:
            raise UnknownName(axis, held, "variable", f"{source.name} is held at values of these")
        held[axis] = float(value)
    return over, by, held


class _TermSource:
    """Curves of one term."""

    order = _BY

    def __init__(self, databases: Mapping[str, xr.DataTree], name: str):
        found = {label: terms(db) for label, db in databases.items()}
        self.name = name
        self.leaves = {label: leaves[name] for label, leaves in found.items() if name in leaves}
        if not self.leaves:
            raise UnknownName(name, {term for leaves in found.values() for term in leaves}, "term")
        self.labels = list(self.leaves)
        self.points = merge_leaf_breakpoints(self.leaves.values())
        if not self.points:
            raise SchemaError(
                name,
                [
                    "has no axis and therefore no curve; `aeromatch db show --term` prints "
                    "the number"
                ],
            )
        self.regressors = _terms.list_regressors(next(iter(self.leaves.values())))
        self.power = _terms.power_factor(next(iter(self.leaves.values())))
        apart = [
            f"{label} has {' '.join(_terms.list_multipliers(leaf)) or 'none'}"
            for label, leaf in self.leaves.items()
        ]
        if len({text.split(" has ")[1] for text in apart}) > 1:
            raise SchemaError(
                name,
                [
                    f"regressors differ: {', '.join(apart)}; compare the coefficient "
                    f"{name.split('/')[0]} instead"
                ],
            )

    def is_axis(self, axis: str) -> bool:
        return True

    def held(self, axis: str) -> float:
        points = self.points[axis]
        if axis == "mach":
            return float(points[(len(points) - 1) // 2])
        leaf = next(
            leaf for leaf in reversed(self.leaves.values()) if axis in leaf_breakpoints(leaf)
        )
        table = next(
            leaf[name] for name in ("value", "K1", "K2") if name in leaf and axis in leaf[name].dims
        )
        size = (table**2).mean([d for d in table.dims if d != axis])
        return float(table[axis].values[int(np.argmax(size.values))])

    def curve(self, label: str, over: str, place: Mapping[str, float]) -> DatabaseCurve | None:
        leaf = _terms.without_multipliers(self.leaves[label])
        own = leaf_breakpoints(leaf)
        if any(
            not own[axis][0] <= value <= own[axis][-1]
            for axis, value in place.items()
            if axis in own
        ):
            return None
        x = refine_breakpoints(own.get(over, self.points[over][[0, -1]]))
        y, stderr = _values(leaf, {**place, over: x}, len(x))
        nodes = _nodes_on(leaf, over, place)
        return DatabaseCurve(x, y, stderr, *nodes)


class _CoefficientSource:
    """Curves of a whole coefficient, in the range that all databases cover."""

    regressors: tuple[str, ...] = ()
    power: _terms.PowerFactor | None = None
    order = ("mach", *_BY)

    def __init__(self, databases: Mapping[str, xr.DataTree], name: str):
        found = {
            label: [leaf for term, leaf in terms(db).items() if term.split("/")[0] == name]
            for label, db in databases.items()
        }
        self.name = name
        self.leaves = {label: leaves for label, leaves in found.items() if leaves}
        if not self.leaves:
            raise UnknownName(
                name,
                {term.split("/")[0] for db in databases.values() for term in terms(db)},
                "coefficient",
            )
        self.labels = list(self.leaves)
        sides = list(self.leaves.values())
        self.points = coefficient_points(*(sides if len(sides) > 1 else [sides[0], []]))
        apart = [axis for axis, points in self.points.items() if not len(points)]
        if apart:
            raise SchemaError(
                name,
                [f"the databases have no common range of {', '.join(apart)}; show them one by one"],
            )

    def is_axis(self, axis: str) -> bool:
        return any(
            axis in leaf_breakpoints(leaf) for leaves in self.leaves.values() for leaf in leaves
        )

    def held(self, axis: str) -> float:
        points = self.points[axis]
        return (
            float(points[(len(points) - 1) // 2]) if axis == "mach" else neutral_value(axis, points)
        )

    def curve(self, label: str, over: str, place: Mapping[str, float]) -> DatabaseCurve:
        x = refine_breakpoints(self.points[over])
        parts = [_values(leaf, {**place, over: x}, len(x)) for leaf in self.leaves[label]]
        return DatabaseCurve(
            x,
            np.sum([y for y, _ in parts], axis=0),
            np.sqrt(np.sum([s**2 for _, s in parts], axis=0)),
        )


def _values(
    leaf: xr.Dataset, conditions: Mapping[str, Any], count: int
) -> tuple[np.ndarray, np.ndarray]:
    B = _terms.basis(leaf, conditions, "clamp")
    y, stderr = (
        np.broadcast_to(part, (count,))
        for part in (B @ leaf["value"].values.ravel(), standard_errors(B, leaf))
    )
    return y, stderr


def _nodes_on(
    leaf: xr.Dataset, over: str, place: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the nodes of the table that lie on a curve: none when it runs between breakpoints."""
    table = leaf["value"]
    none = np.zeros(0), np.zeros(0), np.zeros(0, int)
    if over not in table.dims:
        return none
    at = {}
    for axis in map(str, table.dims):
        if axis == over:
            continue
        on = np.flatnonzero(np.isclose(table[axis].values, place[axis], rtol=1e-9, atol=1e-12))
        if not len(on):
            return none
        at[axis] = int(on[0])
    x = table[over].values
    y, _ = _values(leaf, {**place, over: x}, len(x))
    return (
        x,
        y,
        leaf["source"].isel(at).values.astype(int) if "source" in leaf else np.full(len(x), -1),
    )


def _chosen(
    wanted: str | None,
    points: Mapping[str, Any],
    order: Sequence[str],
    name: str,
    taken: Sequence[str],
) -> str:
    if wanted is not None:
        if wanted not in points:
            raise UnknownName(
                wanted,
                [axis for axis in points if axis not in taken],
                "axis",
                f"{name} is drawn over and by its own axes",
            )
        return wanted
    return next((axis for axis in order if axis in points), next(iter(points)))


def refine_breakpoints(points: np.ndarray) -> np.ndarray:
    """Return breakpoints with places in between, where standard errors bend."""
    if len(points) == 1:
        return points
    between = [np.linspace(low, high, _FINE, endpoint=False) for low, high in pairwise(points)]
    return np.concatenate([*between, points[-1:]])


def thin_breakpoints(points: np.ndarray, most: int = MOST_MEMBERS) -> tuple[float, ...]:
    """Return breakpoints, at most so many, evenly chosen."""
    kept = np.unique(np.linspace(0, len(points) - 1, min(len(points), most)).round().astype(int))
    return tuple(float(x) for x in points[kept])


def _distinct(
    members: tuple[float, ...], curves: dict[str, list[DatabaseCurve | None]]
) -> tuple[tuple[float, ...], dict[str, list[DatabaseCurve | None]]]:
    """Leave out members whose curves repeat those of an earlier member in every database."""
    kept: list[int] = []
    for i in range(len(members)):
        if not any(all(_alike(found[i], found[k]) for found in curves.values()) for k in kept):
            kept.append(i)
    return tuple(members[i] for i in kept), {
        label: [found[i] for i in kept] for label, found in curves.items()
    }


def _alike(one: DatabaseCurve | None, other: DatabaseCurve | None) -> bool:
    if one is None or other is None:
        return one is other
    return all(
        np.array_equal(getattr(one, what), getattr(other, what))
        for what in ("x", "y", "stderr", "node_source")
    )
