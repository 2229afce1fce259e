"""Identified hinge moments as terms of a database, or joined with those of DATCOM."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.errors import SchemaError

from ..equation_error.model import powers
from .result import IdentifiedLoading


def hinge_terms(found: IdentifiedLoading) -> dict[str, xr.Dataset]:
    """Return the terms of the hinge moment by name, ``Ch_e/alpha`` and so on, with standard errors.

    Raises
    ------
    SchemaError
        A term with a ramp or more than two factors: a leaf multiplies at most two variables.
    """
    coefficient = found.loading.model.coefficient
    leaves = {}
    for term in found.loading.model.terms:
        regressors = [name for name, power in powers(term).items() for _ in range(power)]
        value, stderr = found.value(found.loading.term(term))
        if len(regressors) > 2:
            leaves[f"{coefficient}/{_contribution(term)}"] = _tabulated(found, term, value, stderr)
            continue
        leaf = _terms.make(value, regressors=regressors, stderr=stderr, source="flight", comment="control loading from flight")
        leaves[f"{coefficient}/{_contribution(term)}"] = leaf
    return leaves


def replace_hinge_moments(database: xr.DataTree, found: IdentifiedLoading) -> xr.DataTree:
    """Return a database whose terms of this hinge moment are those identified.

    Parameters
    ----------
    database : DataTree
    found : IdentifiedLoading
        To weigh flight against DATCOM first, give ``published_fit(model, *found.published()[:2], conditions, R)`` to `mixed` or to
        `aerodb.tabulate`, as any fit.
    """
    from aerodb import delete_terms, replace_terms
    from aerodb.store.schema import terms

    note = "control loading identified from flight"
    new = hinge_terms(found)
    old = [name for name in terms(database) if name.startswith(f"{found.loading.model.coefficient}/") and name not in new]
    return replace_terms(delete_terms(database, old, note) if old else database, new, note)


def _contribution(term: str) -> str:
    return "basic" if term == "1" else term.replace("**", "").replace("*", "_")


def _tabulated(found: IdentifiedLoading, term: str, value: float, stderr: float) -> xr.Dataset:
    """A power of the deflection beyond the second: a table over it times the deflection, up to 0.5 rad."""
    factors = powers(term)
    name = found.loading.deflection
    if set(factors) != {name}:
        raise SchemaError("hinge moments", [f"{term}: at most two factors, or a power of {name} alone, fit into a term"])
    x = np.linspace(-0.5, 0.5, 41)
    shape = x ** (factors[name] - 1)
    return _terms.make(
        value * shape, {name: x}, [name], stderr=stderr * np.abs(shape), source="flight", comment="control loading from flight"
    )
