"""Families of curves of databases as numbers, without a drawing.

A family is a term or a coefficient over one variable (``over``), one curve per value of a second
variable (``by``), with every other variable fixed.  A term is shown as its table with its K-factors
and without its regressors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from aerodb.comparison.conditions import Conditions
from aerodb.figures.curve_sources import (
    CoefficientSource,
    DatabaseCurve,
    TermSource,
    refine_breakpoints,
)
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName

MOST_MEMBERS = 9
# Preferred abscissae.
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
# Variables by which flight samples are assigned to the curves of a coefficient.
_CONFIGURATION = ("mach", "delta_f", "gear", "speedbrake")
_CURVE_FIELDS = ("x", "y", "stderr", "node_source")


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
        Every other variable. [SI]
    regressors : tuple of str
        Variables that multiply the table; empty for a coefficient.
    points : dict of str to array
        Breakpoints by variable, of all databases. [SI]
    curves : dict of str to list of DatabaseCurve or None
        One curve per member for each database, None outside the range of its table.
    power : PowerFactor or None
        The power factor that multiplies the table.
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
        """Whether the family shows a term, and not a whole coefficient."""
        return "/" in self.name

    def place(self, member: int) -> dict[str, float]:
        """Return the variables that are fixed on one curve. [SI]"""
        if not self.by:
            return dict(self.held)
        return {**self.held, self.by: self.members[member]}

    def all_curves(self) -> list[DatabaseCurve]:
        """Return the curves of all databases, without those outside the range of a table."""
        curves = []
        for database_curves in self.curves.values():
            curves += [curve for curve in database_curves if curve is not None]
        return curves


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
        Family variable and abscissa.  The default abscissa is alpha, else a deflection, else Mach
        number.  The default family variable is the cause of a term, else Mach number.
    at : mapping of str to float, optional
        Values of the fixed variables.  By default a coefficient is at rest, in free air, at the
        middle Mach number.  A term is at the values at which its table is largest, at the middle
        Mach number. [SI]

    Raises
    ------
    UnknownName
        No database has the term or coefficient, or it does not depend on a variable.
    SchemaError
        A term has no axis, and therefore no curve, or other regressors in each database.
    """
    source = _open_source(databases, name)
    over, by, fixed = _select_variables(source, by, over, at=at)
    members = thin_breakpoints(source.points[by]) if by else (0.0,)
    # Without a family variable the family has one curve.
    curves: dict[str, list[DatabaseCurve | None]] = {}
    for label in source.labels:
        curves[label] = []
        for member in members:
            conditions = {**fixed, by: member} if by else fixed
            curves[label].append(source.curve(label, over, conditions))
    if by:
        members, curves = _remove_repeated_members(members, curves)
    return _make_family(source, over, by, members=members, fixed=fixed, curves=curves)


def _make_family(
    source: TermSource | CoefficientSource,
    over: str,
    by: str,
    *,
    members: tuple[float, ...],
    fixed: dict[str, float],
    curves: dict[str, list[DatabaseCurve | None]],
) -> Family:
    return Family(
        name=source.name,
        over=over,
        by=by,
        members=members,
        held=fixed,
        regressors=source.regressors,
        points=source.points,
        curves=curves,
        power=source.power,
    )


@dataclass(frozen=True)
class DifferenceSurface:
    """The difference of two databases over two variables.

    Attributes
    ----------
    family : Family
        Names of databases and variables, and the values of the fixed variables.
    x, y : array
        Sides of the grid, of `family.over` and `family.by`. [SI]
    difference : array (y, x)
        Last database minus first; NaN outside the range of a table.
    stderr : array (y, x)
        Standard error of the first database; NaN outside the range of a table.
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
    """Return the difference of the last of several databases from the first over two axes.

    Parameters and other errors are those of `curve_family`.

    Raises
    ------
    SchemaError
        The term has one axis only, or only one database has it.
    """
    source = _open_source(databases, name)
    over, by, fixed = _select_variables(source, by, over, at=at)
    if not by:
        raise SchemaError(name, [f"has the one axis {over}; a map needs two"])
    if len(source.labels) < 2:
        raise SchemaError(name, [f"is in {source.labels[0]} only; a difference needs two"])
    first, last = source.labels[0], source.labels[-1]
    x, y = refine_breakpoints(source.points[over]), refine_breakpoints(source.points[by])
    difference, stderr = np.full((2, len(y), len(x)), np.nan)
    for i, member in enumerate(y):
        conditions = {**fixed, by: float(member)}
        a, b = source.curve(first, over, conditions), source.curve(last, over, conditions)
        if a is None or b is None:
            continue
        # Only where both curves reach.
        inside = (x >= max(a.x[0], b.x[0])) & (x <= min(a.x[-1], b.x[-1]))
        difference[i, inside] = np.interp(x[inside], b.x, b.y) - np.interp(x[inside], a.x, a.y)
        stderr[i, inside] = np.interp(x[inside], a.x, a.stderr)
    no_curves: dict[str, list[DatabaseCurve | None]] = {first: [], last: []}
    family = _make_family(source, over, by, members=(), fixed=fixed, curves=no_curves)
    return DifferenceSurface(family, x, y, difference=difference, stderr=stderr)


def supporting_samples(support: Conditions | None, family: Family, member: int) -> np.ndarray:
    """Return the abscissae of the flight samples that belong to one curve. [SI]

    A sample belongs to the curve if the value of the curve is the nearest breakpoint of each fixed
    variable.
    """
    if support is None or family.over not in support:
        return np.zeros(0)
    x = np.ravel(np.asarray(support[family.over], float))
    belongs = np.isfinite(x)
    for axis, value in family.place(member).items():
        # The other variables of a coefficient do not distinguish its curves.
        is_criterion = family.is_term or axis == family.by or axis in _CONFIGURATION
        if axis not in support or not is_criterion:
            continue
        nodes = np.union1d(family.points[axis], [value])
        if len(nodes) > 1:
            samples = np.ravel(np.asarray(support[axis], float))
            distances = np.abs(np.broadcast_to(samples, x.shape)[:, None] - nodes)
            belongs &= nodes[distances.argmin(axis=1)] == value
    return x[belongs]


def _open_source(databases: Mapping[str, xr.DataTree], name: str) -> TermSource | CoefficientSource:
    return TermSource(databases, name) if "/" in name else CoefficientSource(databases, name)


def _select_variables(
    source: TermSource | CoefficientSource,
    by: str | None,
    over: str | None,
    at: Mapping[str, float] | None,
) -> tuple[str, str, dict[str, float]]:
    """Return abscissa, family variable and the values of the fixed variables."""
    over = _select_axis(over, source.points, _OVER, source.name)
    candidates = {}
    for axis, points in source.points.items():
        # The caller may choose a variable without a table, which is not a default.
        if axis != over and (source.is_axis(axis) or axis == by):
            candidates[axis] = points
    if by is not None and by not in candidates:
        raise UnknownName(
            by, list(candidates), "axis", f"{source.name} has curves by these, over {over}"
        )
    by = _select_axis(by, candidates, source.order, source.name) if candidates else ""
    fixed = {}
    for axis in source.points:
        if axis not in (over, by):
            fixed[axis] = source.fixed_value(axis)
    for axis, value in (at or {}).items():
        if axis not in fixed:
            raise UnknownName(axis, fixed, "variable", f"{source.name} is held at values of these")
        fixed[axis] = float(value)
    return over, by, fixed


def _select_axis(
    requested: str | None, points: Mapping[str, Any], order: Sequence[str], name: str
) -> str:
    """Return the requested axis, or the first one of the preferred order."""
    if requested is None:
        return next((axis for axis in order if axis in points), next(iter(points)))
    if requested not in points:
        raise UnknownName(
            requested, list(points), "axis", f"{name} is drawn over and by its own axes"
        )
    return requested


def thin_breakpoints(points: np.ndarray, most: int = MOST_MEMBERS) -> tuple[float, ...]:
    """Return at most `most` of the breakpoints, evenly distributed."""
    # The first and the last breakpoint are always selected.
    count = min(len(points), most)
    selected = np.unique(np.linspace(0, len(points) - 1, count).round().astype(int))
    return tuple(float(x) for x in points[selected])


def _remove_repeated_members(
    members: tuple[float, ...], curves: dict[str, list[DatabaseCurve | None]]
) -> tuple[tuple[float, ...], dict[str, list[DatabaseCurve | None]]]:
    """Remove members whose curves repeat those of an earlier member in every database."""
    # Each member is compared with those selected so far.
    selected: list[int] = []
    for i in range(len(members)):
        if not any(_are_same_members(curves, i, k) for k in selected):
            selected.append(i)
    distinct = {}
    for label, database_curves in curves.items():
        distinct[label] = [database_curves[i] for i in selected]
    return tuple(members[i] for i in selected), distinct


def _are_same_members(curves: dict[str, list[DatabaseCurve | None]], i: int, k: int) -> bool:
    return all(_are_same_curves(members[i], members[k]) for members in curves.values())


def _are_same_curves(a: DatabaseCurve | None, b: DatabaseCurve | None) -> bool:
    # Two members outside the range of the table are equal.
    if a is None or b is None:
        return a is b
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in _CURVE_FIELDS)
