"""Hinge moments of an identified control loading as terms of a database."""

from __future__ import annotations

import numpy as np
import xarray as xr

from aerodb.edit.term_edits import delete_terms, replace_terms
from aerodb.store.identified_terms import stamp_identified
from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.errors import SchemaError
from flighttest.regression.equation_error.model import term_powers
from flighttest.remarks import warn_forbidden
from flighttest.submodels.control_loading.loading import table_basis
from flighttest.submodels.control_loading.result import IdentifiedLoading
from flighttest.submodels.control_loading.table_coverage import find_unsupported


def make_hinge_terms(identified: IdentifiedLoading) -> dict[str, xr.Dataset]:
    """Return the terms of the hinge moment by name, ``Ch_e/alpha`` and so on, with standard errors.

    Raises
    ------
    SchemaError
        A term with a ramp or more than two factors: a leaf multiplies at most two variables.

    Warns
    -----
    AeromatchWarning
        An estimate changes by more than its standard error in the last pass; samples beyond the
        nodes of a table, or a node without samples near it.
    """
    warn_forbidden(identified.remarks, f"hinge moments of the {identified.loading.item}")
    coefficient = identified.loading.model.coefficient
    if identified.loading.over is not None:
        return _make_tables(identified)
    leaves = {}
    for term in identified.loading.model.terms:
        # A power of a variable is a repeated regressor.
        regressors: list[str] = []
        for name, power in term_powers(term).items():
            regressors += [name] * power
        value, stderr = identified.value(identified.loading.term(term))
        if len(regressors) > 2:
            leaves[f"{coefficient}/{_contribution(term)}"] = _tabulated(
                identified, term, value, stderr
            )
            continue
        leaf = _terms.make_term(
            value,
            regressors=regressors,
            stderr=stderr,
            source="flight",
            comment="control loading from flight",
        )
        leaves[f"{coefficient}/{_contribution(term)}"] = leaf
    return leaves


def replace_hinge_moments(database: xr.DataTree, found: IdentifiedLoading) -> xr.DataTree:
    """Return a database whose terms of this hinge moment are those identified.

    Parameters
    ----------
    database : DataTree
    found : IdentifiedLoading
        To weigh flight against DATCOM first, give ``published_fit(model, *found.published()[:2],
        conditions, R)`` to `mixed` or to `aerodb.tabulate`, as any fit.
    """

    note = "control loading identified from flight"
    new = make_hinge_terms(found)
    old = [
        name
        for name in terms(database)
        if name.startswith(f"{found.loading.model.coefficient}/") and name not in new
    ]
    new = {name: stamp_identified(leaf) for name, leaf in new.items()}
    return replace_terms(delete_terms(database, old, note) if old else database, new, note)


def _make_tables(identified: IdentifiedLoading) -> dict[str, xr.Dataset]:
    """Return every term as a table over the nodes of `ControlLoading.over`.

    The standard error of a node without samples near it is at least the largest value of the table:
    that of the extrapolated line does not contain the curvature that nobody has flown.
    """
    loading = identified.loading
    assert loading.over is not None
    variable, nodes = loading.over
    basis = table_basis(variable, nodes)
    x = np.array(nodes)
    # Values of the basis at the nodes, (node, factor).
    B = np.column_stack([np.ones(len(x)), x, *(np.maximum(x - node, 0.0) for node in nodes[1:-1])])
    is_far = np.zeros(len(x), bool)
    if identified.sampled is not None:
        is_far = find_unsupported(nodes, identified.sampled)
    leaves = {}
    # The terms of a table follow each other, in the order of the basis.
    for term in loading.model.terms[:: len(basis)]:
        first = loading.model.terms.index(term)
        rows = [loading.term(name) for name in loading.model.terms[first : first + len(basis)]]
        part = identified.estimates.sel(term=rows, term_=rows)
        values = B @ part["estimate"].values
        variances = np.einsum("ij,jk,ik->i", B, part["covariance"].values, B)
        # Rounding of the products must not make a variance negative.
        variances = np.maximum(variances, 0.0) + np.where(is_far, np.max(values**2), 0.0)
        regressors: list[str] = []
        for name, power in term_powers(term).items():
            regressors += [name] * power
        if len(regressors) > 2:
            raise SchemaError(
                "hinge moments", [f"{term}: a table over {variable} has at most two factors"]
            )
        leaves[f"{loading.model.coefficient}/{_contribution(term)}"] = _terms.make_term(
            values,
            {variable: x},
            regressors,
            stderr=np.sqrt(variances),
            source="flight",
            comment="control loading from flight",
        )
    return leaves


def _contribution(term: str) -> str:
    return "basic" if term == "1" else term.replace("**", "").replace("*", "_")


def _tabulated(identified: IdentifiedLoading, term: str, value: float, stderr: float) -> xr.Dataset:
    """A power of the deflection beyond the second: a table over it times the deflection, up to 0.5
    rad.
    """
    factors = term_powers(term)
    name = identified.loading.deflection
    if set(factors) != {name}:
        raise SchemaError(
            "hinge moments",
            [f"{term}: at most two factors, or a power of {name} alone, fit into a term"],
        )
    x = np.linspace(-0.5, 0.5, 41)
    shape = x ** (factors[name] - 1)
    return _terms.make_term(
        value * shape,
        {name: x},
        [name],
        stderr=stderr * np.abs(shape),
        source="flight",
        comment="control loading from flight",
    )
