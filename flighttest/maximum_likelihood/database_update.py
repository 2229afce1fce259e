"""Database with the estimates of a fit."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
import xarray as xr

import aerodb
from aerodb.store.identified_terms import stamp_identified
from aerodb.store.schema import terms
from flightmech.errors import UnknownName
from flightmech.names import COEFFICIENTS
from flightmech.terms import make_term
from flighttest.maximum_likelihood.result import OutputError

_PART = re.compile(r"^(term|table|offset|node)\.(\w+)\.(\w+)(?:\[([\d,\s]+)\])?$")
# order in which the kernel applies parameters: (node * table + offset) * term + bias
_ORDER = ("node", "table", "offset", "term", "bias")
_FLIGHT = 1  # flag of `source`


class _DatabaseParameter(NamedTuple):
    """A parameter of the database: its kind, its term, and the indices of its node."""

    kind: str
    term: str
    node: tuple[int, ...]


def updated_database(db: xr.DataTree, fit: OutputError) -> tuple[xr.DataTree, list[str]]:
    """Return a database with the estimates of a fit, and the parameters that it cannot contain.

    ``term.*`` and ``table.*`` multiply a table, ``offset.*`` is added to it, ``node.*`` replaces a
    node, and ``bias.CL`` ... is added to the basic term of its coefficient, or is this term where
    the database has none. A scaled table has the
    errors of the estimates alone, because its a-priori error is part of the scale.

    Parameters
    ----------
    db : DataTree
        The database from which the model of the fit was compiled; it is not changed.
    fit : OutputError

    Returns
    -------
    DataTree
        With history, standard errors and ``source`` flight for changed nodes.
    list of str
        Starts, instruments, masses, constants of submodels, and parameters of single manoeuvres.

    Raises
    ------
    UnknownName
        A term that the database does not have.
    """
    tables, e = terms(db), fit.estimates
    names = [str(name) for name in e["parameter"].values]
    stderr_of = dict(zip(names, map(float, np.nan_to_num(e["stderr"].values))))
    values = fit.parameters
    unplaced = [name for name in names if name not in values]
    leaves: dict[str, xr.Dataset] = {}
    for name in sorted(values, key=_application_order):
        parameter = _parse_parameter(name)
        if parameter is None:
            unplaced.append(name)
            continue
        term = parameter.term
        leaf = leaves.get(term, tables.get(term))
        if leaf is None and parameter.kind == "bias":
            # the kernel has a bias of every coefficient; a coefficient may have no basic term
            leaf = make_term(0.0, stderr=0.0, source="flight")
        if leaf is None:
            raise UnknownName(term, tables, "term")
        if parameter.kind in ("table", "term") and term not in leaves:
            # The a-priori error of the table is part of the scale.
            leaf = leaf.drop_vars("stderr", errors="ignore")
        leaves[term] = _apply_estimate(leaf, parameter, value=values[name], stderr=stderr_of[name])
    if not leaves:
        return db, unplaced
    note = f"{e.attrs['method']}, {e.attrs['manoeuvres']} manoeuvres"
    leaves = {name: stamp_identified(leaf) for name, leaf in leaves.items()}
    return aerodb.replace_terms(db, leaves, note=note), unplaced


def _application_order(name: str) -> int:
    """Return the position of a parameter in the order of the kernel."""
    kind = name.partition(".")[0]
    return _ORDER.index(kind) if kind in _ORDER else len(_ORDER)


def _parse_parameter(name: str) -> _DatabaseParameter | None:
    """Return a parameter of the database, None for another parameter."""
    match = _PART.match(name)
    if match:
        kind, coefficient, contribution, indices = match.groups()
        node: tuple[int, ...] = ()
        if indices:
            node = tuple(int(k) for k in indices.split(","))
        return _DatabaseParameter(kind, f"{coefficient}/{contribution}", node)
    kind, _, coefficient = name.partition(".")
    if kind == "bias" and coefficient in COEFFICIENTS:
        return _DatabaseParameter("bias", f"{coefficient}/basic", ())
    return None


def _apply_estimate(
    leaf: xr.Dataset, parameter: _DatabaseParameter, value: float, stderr: float
) -> xr.Dataset:
    """Return a table with one estimate and its standard error."""
    table = leaf["value"].values.astype(float)
    error = np.zeros_like(table)
    if "stderr" in leaf:
        error = leaf["stderr"].values.astype(float)
    is_changed = np.ones(table.shape, bool)
    if parameter.kind in ("term", "table"):
        # product of two uncertain factors
        table, error = value * table, np.hypot(table * stderr, value * error)
    elif parameter.kind == "node":
        is_changed = np.zeros(table.shape, bool)
        is_changed[parameter.node] = True
        table, error = np.where(is_changed, value, table), np.where(is_changed, stderr, error)
    else:
        table, error = table + value, np.hypot(error, stderr)
    changed = leaf.assign(
        value=leaf["value"].copy(data=table),
        stderr=leaf["value"].copy(data=error).assign_attrs(leaf["value"].attrs),
    )
    if "source" in leaf:
        source = np.where(is_changed, _FLIGHT, leaf["source"].values)
        changed["source"] = leaf["source"].copy(data=source.astype(leaf["source"].dtype))
    return changed
