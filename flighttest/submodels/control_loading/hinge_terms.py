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

_COMMENT = "control loading from flight"
# A leaf multiplies its table by this many variables at most.
_MOST_REGRESSORS = 2
# Half range [rad] and number of nodes of the table that stands for a power of a deflection. Between
# two nodes, h = 0.025 rad apart, the line is off from x^2 by h^2/8 = 8e-5 at most.
_RANGE, _NODES = 0.5, 41


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
    loading = identified.loading
    warn_forbidden(identified.remarks, f"hinge moments of the {loading.item}")
    if loading.over is not None:
        return _make_tables(identified)
    leaves = {}
    for term in loading.model.terms:
        value, stderr = identified.value(loading.term(term))
        regressors = _list_regressors(term)
        if len(regressors) > _MOST_REGRESSORS:
            leaf = _make_power_table(identified, term, value, stderr)
        else:
            leaf = _terms.make_term(
                value, regressors=regressors, stderr=stderr, source="flight", comment=_COMMENT
            )
        leaves[f"{loading.model.coefficient}/{_contribution(term)}"] = leaf
    return leaves


def replace_hinge_moments(database: xr.DataTree, identified: IdentifiedLoading) -> xr.DataTree:
    """Return a database whose terms of this hinge moment are those identified.

    Terms of the hinge moment that were not identified are deleted.

    Parameters
    ----------
    database : DataTree
    identified : IdentifiedLoading
        To weigh flight against DATCOM first, give
        ``published_fit(model, *identified.published()[:2], conditions, R)`` to `mixed` or to
        `aerodb.tabulate`, as any fit.
    """
    note = "control loading identified from flight"
    leaves = make_hinge_terms(identified)
    prefix = f"{identified.loading.model.coefficient}/"
    obsolete = []
    for name in terms(database):
        if name.startswith(prefix) and name not in leaves:
            obsolete.append(name)
    if obsolete:
        database = delete_terms(database, obsolete, note)
    stamped = {name: stamp_identified(leaf) for name, leaf in leaves.items()}
    return replace_terms(database, stamped, note)


def _list_regressors(term: str) -> list[str]:
    """Return the factors of a term; a power of a variable is a repeated regressor."""
    regressors: list[str] = []
    for name, power in term_powers(term).items():
        regressors += [name] * power
    return regressors


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
    # Basis at the nodes, (node, factor): 1, x, and a ramp from each inner node on.
    ramps = [np.maximum(x - node, 0.0) for node in nodes[1:-1]]
    B = np.column_stack([np.ones(len(x)), x, *ramps])
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
        # Diagonal of B C B', with the covariance C of the factors.
        variances = np.einsum("ij,jk,ik->i", B, part["covariance"].values, B)
        # Rounding of the products must not make a variance negative.
        variances = np.maximum(variances, 0.0) + np.where(is_far, np.max(values**2), 0.0)
        regressors = _list_regressors(term)
        if len(regressors) > _MOST_REGRESSORS:
            raise SchemaError(
                "hinge moments", [f"{term}: a table over {variable} has at most two factors"]
            )
        leaves[f"{loading.model.coefficient}/{_contribution(term)}"] = _terms.make_term(
            values,
            {variable: x},
            regressors,
            stderr=np.sqrt(variances),
            source="flight",
            comment=_COMMENT,
        )
    return leaves


def _contribution(term: str) -> str:
    """Return the name of a term as a contribution: ``alpha*delta_e`` is ``alpha_delta_e``."""
    if term == "1":
        return "basic"
    return term.replace("**", "").replace("*", "_")


def _make_power_table(
    identified: IdentifiedLoading, term: str, value: float, stderr: float
) -> xr.Dataset:
    """Return a power of the deflection above the second, as a table times the deflection.

    value x^n is the table value x^(n - 1) over x, times the regressor x.
    """
    powers = term_powers(term)
    name = identified.loading.deflection
    if set(powers) != {name}:
        raise SchemaError(
            "hinge moments",
            [f"{term}: at most two factors, or a power of {name} alone, fit into a term"],
        )
    x = np.linspace(-_RANGE, _RANGE, _NODES)
    shape = x ** (powers[name] - 1)
    return _terms.make_term(
        value * shape,
        {name: x},
        [name],
        stderr=stderr * np.abs(shape),
        source="flight",
        comment=_COMMENT,
    )
