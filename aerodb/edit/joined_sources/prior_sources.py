"""A-priori databases of several programs in one form: reference, axes, regressors, range of each.

Every source is a database, whatever made it: DATCOM listings, the outputs of another program, or a
table.  Before two sources are blended, they refer to the same quantities and the same point, and a
term of both has the same regressors.  A derivative with respect to a control becomes a table over
the deflections of the other source; it speaks up to `LINEAR_DEFLECTION`, where it was computed.

Sources have common errors.  Their correlation is that of `COMMON_ERROR`, by judgement: two runs of
one program share its theory and often its geometry, two programs of one theory share the theory.
Two methods share the drawing of the aeroplane and what neither computes: over ten derivatives of
the light aircraft the errors of DATCOM and AVL correlate by 0.49 (`benchmarks/blended_prior.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr

from aerodb.edit.reference_point import move_reference
from aerodb.prior.reference_quantities import FAR, NEAR, describe_other_quantities
from aerodb.store.effects import Effect, change_reference_quantities
from aerodb.store.grids import (
    fold_factors,
    has_same_table,
    same_factors,
    union_axes,
    value_breakpoints,
)
from aerodb.store.schema import make_database, terms
from aerodb.store.undo_history import COLUMNS, edit_rows
from flightmech import terms as _terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.names import REDUCED_RATES
from flightmech.short_text import ShortText

# Theory of each program that is known.  Another program is a method of its own.
METHODS = {
    "Digital DATCOM": "handbook",
    "Missile DATCOM": "handbook",
    "AVL": "potential flow",
    "OptVL": "potential flow",
    "VSPAERO": "potential flow",
    "XFLR5": "potential flow",
    "flow5": "potential flow",
    "Tornado": "potential flow",
    "AeroSandbox": "potential flow",
}
# Programs under another name: their errors are those of one program.
SAME_PROGRAM = {"OptVL": "AVL"}  # AVL as a Python library
# Correlation of the errors of two sources of one program, of two programs of one method, and of two
# methods.
COMMON_ERROR = {"program": 0.9, "method": 0.7, "aeroplane": 0.5}
# A derivative speaks up to this deflection: beyond it the flow over a control separates. [rad]
LINEAR_DEFLECTION = 0.3

# Lines of the history that state a blend, and the place of the verb in such a row.
_JOINERS = ("blend", "blend_sources")
_VERB = COLUMNS.index("verb")
_FLIGHT = _terms.SOURCES.index("flight")
_POINT = ("x_ref", "y_ref", "z_ref")
_LENGTHS = ("S", "cbar", "b")


@dataclass(frozen=True)
class PriorSource(ShortText):
    """A database that takes part in a blend.

    Attributes
    ----------
    label : str
        Name in reports: its program, with a number if two sources have one program.
    program, method : str
    database : DataTree
    """

    label: str
    program: str
    method: str
    database: xr.DataTree

    def error_correlation(self, other: PriorSource) -> float:
        """Return the correlation of the errors of two sources by their method. [1]

        It is 0 for two methods: their difference is not expected to be small.
        """
        names = {SAME_PROGRAM.get(name, name) for name in (self.program, other.program)}
        if len(names) == 1:
            return COMMON_ERROR["program"]
        return COMMON_ERROR["method"] if self.method == other.method else 0.0


@dataclass(frozen=True)
class SourceTable(ShortText):
    """A term of one source, with the regressors that all sources of the term have.

    Attributes
    ----------
    source : PriorSource
    leaf : Dataset
    linear : str
        Axis along which the table is a derivative times the deflection; empty for none.
    """

    source: PriorSource
    leaf: xr.Dataset
    linear: str = ""


def label_sources(
    databases: Sequence[xr.DataTree], methods: Sequence[str] | None = None
) -> list[PriorSource]:
    """Return the sources of databases, labelled by their programs.

    Parameters
    ----------
    databases : sequence of DataTree
        The root attribute ``source`` is the program.
    methods : sequence of str, optional
        Method of each, empty for that of `METHODS`.

    Raises
    ------
    SchemaError
        A database does not state its program, holds nodes that come from flight, or is a
        blend.
    """
    problems = []
    for db in databases:
        title = str(db.attrs.get("title", ""))
        if not db.attrs.get("source"):
            problems.append(f"{title!r} does not state its source; set the root attribute source")
        flown = [name for name, leaf in terms(db).items() if _has_flight_nodes(leaf)]
        if flown:
            problems.append(
                f"{title!r} holds terms from flight ({', '.join(flown[:3])}), so it is not an "
                f"a-priori source; join them with `db edit blend` or `db edit replace`"
            )
        if any(line[_VERB] in _JOINERS for line in edit_rows(db)):
            problems.append(
                f"{title!r} is a blend, whose sources could count twice; give its sources instead"
            )
    if problems:
        raise SchemaError("blend", problems)
    programs = [str(db.attrs["source"]) for db in databases]
    sources: list[PriorSource] = []
    for position, (db, program) in enumerate(zip(databases, programs)):
        label = program
        if programs.count(program) > 1:
            label = f"{program} {programs[:position].count(program) + 1}"
        method = (methods[position] if methods else "") or METHODS.get(program, program)
        sources.append(PriorSource(label, program, method, db))
    return sources


def list_repeated_sources(databases: Sequence[xr.DataTree]) -> list[str]:
    """Return a sentence on each database that repeats all common terms of an earlier one."""
    problems = []
    for (first, db), (second, other) in combinations(enumerate(databases, 1), 2):
        ours, theirs = terms(db), terms(other)
        common = ours.keys() & theirs.keys()
        if common and all(has_same_table(ours[name], theirs[name]) for name in common):
            problems.append(
                f"sources {first} and {second} ({other.attrs.get('title', '')!r}) hold the same "
                f"numbers; a repeated source adds nothing, give it once"
            )
    return problems


def _has_flight_nodes(leaf: xr.Dataset) -> bool:
    return "source" in leaf and bool((leaf["source"].values == _FLIGHT).any())


def refer_to_aircraft(
    db: xr.DataTree, aircraft: Aircraft, point: Sequence[float], move: bool
) -> tuple[xr.DataTree, list[str]]:
    """Return a database about a point with the reference quantities of an aircraft, and remarks.

    Parameters
    ----------
    db : DataTree
    aircraft : Aircraft
    point : (3,)
        Moment reference point, body directions from the drawing datum. [m]
    move : bool
        Permit a distance of more than 0.1 chord.

    Raises
    ------
    SchemaError
        Force axes other than stability axes, or a point that is far away or out of the plane.
    """
    title = str(db.attrs["title"])
    problems = []
    if db.attrs["force_axes"] != "stability":
        problems.append(
            f"{title!r} has forces in {db.attrs['force_axes']} axes; a-priori sources have them "
            f"in stability axes: build it from its table with `db from-estimate`, which turns them"
        )
    old = np.array([float(db.attrs[key]) for key in _POINT])
    new = np.asarray(point, float)
    # A large distance is more often a wrong origin of the drawing than a real one.
    distance = float(np.linalg.norm(new - old)) / aircraft.cbar
    if distance > FAR and not move:
        problems.append(
            f"the moment reference point of {title!r}, {np.round(old, 4).tolist()} m, lies "
            f"{distance:.2g} chords from {np.round(new, 4).tolist()} m; correct the origin of its "
            f"drawing, or state move_reference (--move-reference)"
        )
    if problems:
        raise SchemaError("blend", problems)
    quantities = {name: float(getattr(aircraft, name)) for name in _LENGTHS}
    given = {name: float(db.attrs[name]) for name in _LENGTHS}
    remarks = []
    if text := describe_other_quantities(given, quantities):
        remarks.append(f"{title}: {text}")
    if given != quantities:
        db = _with_quantities(db, given, quantities)
    if distance * aircraft.cbar > NEAR * aircraft.cbar:
        db = move_reference(db, list(new), flow="moved")
        remarks.append(f"{title}: moments moved by {distance:.2g} chords")
    return db, remarks


def _with_quantities(
    db: xr.DataTree, old: Mapping[str, float], new: Mapping[str, float]
) -> xr.DataTree:
    """Return a database for other reference quantities; its tables are multiplied."""
    leaves = {}
    for name, leaf in terms(db).items():
        coefficient, _, contribution = name.partition("/")
        one = {coefficient: xr.DataArray(1.0)}
        # Each regressor may be a reduced rate, which has a length of its own.
        factor = 1.0
        for regressor in _terms.list_regressors(leaf) or ("",):
            effect = Effect(contribution, one, regressor)
            changed = change_reference_quantities(effect, old, new).tables[coefficient]
            factor *= float(changed)
        extra = len(_terms.list_regressors(leaf)) - 1
        if extra > 0:
            # The coefficient itself was changed once for each regressor.
            plain = change_reference_quantities(Effect(contribution, one), old, new)
            factor /= float(plain.tables[coefficient]) ** extra
        leaf = leaf.assign(value=leaf["value"] * factor)
        if "stderr" in leaf:
            leaf["stderr"] = leaf["stderr"] * abs(factor)
        leaves[name] = _with_rate_axes(leaf, old, new)
    attributes = {str(key): item for key, item in db.attrs.items()} | dict(new)
    return make_database(leaves, **attributes)


def _with_rate_axes(
    leaf: xr.Dataset, old: Mapping[str, float], new: Mapping[str, float]
) -> xr.Dataset:
    """Return a leaf whose axes of reduced rates have the new lengths."""
    for rate, (_, length) in REDUCED_RATES.items():
        if rate in leaf.coords:
            attributes = leaf[rate].attrs
            leaf = leaf.assign_coords({rate: leaf[rate].values * new[length] / old[length]})
            leaf[rate].attrs = attributes
    return leaf


def collect_tables(sources: Sequence[PriorSource], name: str) -> list[SourceTable]:
    """Return the tables of one term by source, with equal regressors and factors.

    Raises
    ------
    SchemaError
        A table has no standard errors, or the regressors differ and none is an axis of another.
    """
    tables = []
    for source in sources:
        leaf = terms(source.database).get(name)
        if leaf is not None:
            tables.append(SourceTable(source, leaf))
    if len(tables) < 2:
        return tables
    faults = [t.source.label for t in tables if "stderr" not in t.leaf]
    if faults:
        raise SchemaError("blend", [f"{name}: no standard errors in {', '.join(faults)}"])
    first = tables[0].leaf
    if not all(same_factors(first, table.leaf) for table in tables[1:]):
        tables = [SourceTable(t.source, fold_factors(t.leaf)) for t in tables]
    tables = [_with_control_axis(table, tables) for table in tables]
    kinds = {_terms.list_multipliers(table.leaf) for table in tables}
    if len(kinds) > 1:
        texts = [
            f"{t.source.label} {' '.join(_terms.list_multipliers(t.leaf)) or 'none'}"
            for t in tables
        ]
        raise SchemaError(
            "blend",
            [f"{name}: the regressors differ: {'; '.join(texts)}; take the term of one source"],
        )
    return tables


def _with_control_axis(table: SourceTable, tables: Sequence[SourceTable]) -> SourceTable:
    """Return a table in which a regressor that is an axis of another table is an axis, too."""
    union = union_axes(*(other.leaf for other in tables))
    regressors = list(_terms.list_regressors(table.leaf))
    for regressor in list(regressors):
        if regressor in table.leaf["value"].dims or regressor not in union:
            continue
        regressors.remove(regressor)
        leaf = _multiplied_along(table.leaf, regressor, union[regressor], regressors)
        return SourceTable(table.source, leaf, linear=regressor)
    return table


def _multiplied_along(
    leaf: xr.Dataset, axis: str, points: np.ndarray, regressors: Sequence[str]
) -> xr.Dataset:
    """Return the table of a derivative times its variable, over breakpoints of the variable."""
    factor = xr.DataArray(points, {axis: points}, axis)
    tables: dict[str, Any] = {
        "value": leaf["value"] * factor,
        "stderr": leaf["stderr"] * abs(factor),
        "source": (leaf["source"] * xr.ones_like(factor)).astype(np.uint8),
    }
    new = _terms.make_term(
        tables["value"].values,
        {**value_breakpoints(leaf), axis: points},
        regressors,
        stderr=tables["stderr"].values,
        source="judgement",
    )
    dims = new["value"].dims
    new["source"] = new["source"].copy(data=tables["source"].transpose(*dims).values)
    return new.assign_attrs(leaf.attrs | {"regressors": " ".join(regressors)})
