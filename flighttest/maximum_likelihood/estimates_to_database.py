"""The database of a fit: estimates of scales, tables, nodes and constants written into its leaves."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from flightmech.errors import UnknownName
from flightmech.names import COEFFICIENTS

if TYPE_CHECKING:
    from .result import OutputError

_PART = re.compile(r"^(term|table|offset|node)\.(\w+)\.(\w+)(?:\[([\d,\s]+)\])?$")
_ORDER = ("node", "table", "offset", "term", "bias")  # as the kernel takes them: (node * table + offset) * term + bias
_FLIGHT = 1  # flag of `source`


def updated_database(db: xr.DataTree, fit: OutputError) -> tuple[xr.DataTree, list[str]]:
    """Return a database with the estimates of a fit in it, and the parameters that have no place there.

    ``term.*`` and ``table.*`` multiply a table, ``offset.*`` is added to it, ``node.*`` takes the place of a node, and ``bias.CL`` ...
    is added to the basic term of its coefficient.  Of a table that is scaled only the estimates' errors remain: its a-priori
    error went into the scale.

    Parameters
    ----------
    db : DataTree
        The one the model of the fit was compiled from; it is left as it is.
    fit : OutputError

    Returns
    -------
    DataTree
        With history, standard errors and ``source`` flight where something was changed.
    list of str
        Starts, instruments, masses, constants of submodels, and what belongs to one manoeuvre alone.

    Raises
    ------
    UnknownName
        A term that the database does not have.
    """
    import aerodb
    from aerodb.store.schema import terms

    known, e = terms(db), fit.estimates
    errors = {str(name): float(x) for name, x in zip(e["parameter"].values, np.nan_to_num(e["stderr"].values))}
    leaves: dict[str, xr.Dataset] = {}
    left = [str(name) for name in e["parameter"].values if str(name) not in fit.parameters]
    for name, value in sorted(fit.parameters.items(), key=lambda item: _rank(item[0])):
        place = _place(name)
        if place is None:
            left.append(name)
            continue
        kind, term, index = place
        if term not in known:
            raise UnknownName(term, known, "term")
        leaf = leaves.get(term, known[term])
        if kind in ("table", "term") and term not in leaves:
            leaf = leaf.drop_vars("stderr", errors="ignore")
        leaves[term] = _changed(leaf, kind, index, value, errors[name])
    note = f"{e.attrs['method']}, {e.attrs['manoeuvres']} manoeuvres"
    return aerodb.replace_terms(db, leaves, note=note) if leaves else db, left


def _rank(name: str) -> int:
    kind = name.partition(".")[0]
    return _ORDER.index(kind) if kind in _ORDER else len(_ORDER)


def _place(name: str) -> tuple[str, str, tuple[int, ...]] | None:
    """Return kind, term and indices of a parameter of the database, None of any other."""
    match = _PART.match(name)
    if match:
        kind, coefficient, contribution, index = match.groups()
        return kind, f"{coefficient}/{contribution}", tuple(int(k) for k in index.split(",")) if index else ()
    kind, _, coefficient = name.partition(".")
    return ("bias", f"{coefficient}/basic", ()) if kind == "bias" and coefficient in COEFFICIENTS else None


def _changed(leaf: xr.Dataset, kind: str, index: tuple[int, ...], value: float, stderr: float) -> xr.Dataset:
    """Return a leaf with one estimate in it."""
    table = leaf["value"].values.astype(float)
    before = leaf["stderr"].values.astype(float) if "stderr" in leaf else np.zeros_like(table)
    moved = np.ones(table.shape, bool)
    if kind in ("term", "table"):
        table, error = value * table, np.hypot(table * stderr, value * before)
    elif kind == "node":
        moved = np.zeros(table.shape, bool)
        moved[index] = True
        table, error = np.where(moved, value, table), np.where(moved, stderr, before)
    else:
        table, error = table + value, np.hypot(before, stderr)
    found = leaf.assign(value=leaf["value"].copy(data=table), stderr=leaf["value"].copy(data=error).assign_attrs(leaf["value"].attrs))
    if "source" in leaf:
        found["source"] = leaf["source"].copy(data=np.where(moved, _FLIGHT, leaf["source"].values).astype(leaf["source"].dtype))
    return found
