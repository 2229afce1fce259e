"""Coefficients and their contributions at given conditions, by the one term definition of `flightmech.terms`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.axes import lift_drag
from flightmech.build_up import levels, used
from flightmech.errors import OutOfRange, SchemaError, UnknownName

from .schema import HINGE, coefficients, terms


def contributions(db: xr.DataTree, coefficient: str, conditions: Mapping[str, Any], outside: str = "raise") -> dict[str, np.ndarray]:
    """Return what each term adds to a coefficient.

    Parameters
    ----------
    db : DataTree
        The database.
    coefficient : str
        One of the database's coefficients, such as ``"CL"``, or a hinge moment, such as ``"Ch_e"``.
    conditions : mapping of str to array
        Every variable the terms need, broadcast against each other; a Dataset of a manoeuvre will do.  Coefficients that the terms
        depend on, such as ``CL`` in a drag polar, may be left out: they are the sums of their own terms then, as in the simulation. [SI]
    outside : {"raise", "clamp"}
        Beyond a table: raise, or follow the rule of the leaf as the simulation does.

    Returns
    -------
    dict of str to array
        By contribution: ``{"basic": ..., "flap": ...}``; each has the shape of the variables that term uses. [1]

    Raises
    ------
    UnknownName
        The coefficient, or a variable that is missing in `conditions`.
    OutOfRange
        With the name of the term, the axis, the range and the mask of samples.
    SchemaError
        Coefficients that are not given depend on each other in a loop, with its path.
    """
    allowed = (*coefficients(db), *HINGE)
    if coefficient not in allowed:
        raise UnknownName(coefficient, allowed, "coefficient")
    leaves = terms(db.children[coefficient]) if coefficient in db.children else {}
    conditions = _with_coefficients(db, leaves, coefficient, conditions, outside)
    found = {}
    places: dict[Any, Any] = {}
    for name, leaf in leaves.items():
        group, _, contribution = name.partition("/")
        if group != coefficient:
            continue
        try:
            found[contribution] = _terms.evaluate(leaf, conditions, outside, places)
        except OutOfRange as error:
            raise OutOfRange(f"{name}: {error}", error.mask) from None
        except UnknownName as error:
            raise UnknownName(error.name, error.allowed, "condition", f"the term {name} needs it; pass it with the conditions") from None
    return found


def _with_coefficients(
    db: xr.DataTree, leaves: Mapping[str, xr.Dataset], coefficient: str, conditions: Mapping[str, Any], outside: str
) -> Mapping[str, Any]:
    """Return conditions with the coefficients that the terms `leaves` of a coefficient depend on and that are not given."""
    wanted = {word for name, leaf in leaves.items() if name.split("/")[0] == coefficient for word in used(leaf)}
    missing = sorted(wanted - {str(name) for name in conditions})
    if not missing:
        return conditions
    _, problems = levels(terms(db), str(db.attrs["force_axes"]))
    if problems:
        raise SchemaError(f"database {db.attrs.get('title', '')!r}", problems)
    found = {str(name): conditions[name] for name in conditions}
    return found | {name: _coefficient(db, name, outside, found) for name in missing}


def _coefficient(db: xr.DataTree, name: str, outside: str, conditions: Mapping[str, Any]) -> np.ndarray:
    """Return a coefficient, lift and drag of a database in body axes from its axial and normal force."""
    if name in coefficients(db):
        return evaluate(db, name, outside, **conditions)
    if "alpha" not in conditions:
        raise UnknownName("alpha", map(str, conditions), "condition", f"{name} is made of CX and CZ with it; pass it with the conditions")
    CX, CZ = (evaluate(db, part, outside, **conditions) for part in ("CX", "CZ"))
    CL, CD = lift_drag(CX, CZ, np.asarray(conditions["alpha"], float))
    return CL if name == "CL" else CD


def evaluate(db: xr.DataTree, coefficient: str, outside: str = "raise", **conditions: Any) -> np.ndarray:
    """Return a coefficient, the sum of its terms.

    Parameters
    ----------
    db, coefficient, outside
        As in `contributions`.
    **conditions : array
        Every variable the terms need. [SI]

    Returns
    -------
    array (broadcast shape of the conditions used)
        The coefficient in the force axes of the database, moments in body axes about the moment reference point. [1]

    Raises
    ------
    UnknownName, OutOfRange
        As in `contributions`.
    """
    parts = contributions(db, coefficient, conditions, outside)
    return np.sum(np.stack(np.broadcast_arrays(*parts.values())), axis=0) if parts else np.zeros(())
