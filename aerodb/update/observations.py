"""Local models and samples from flight as linear observations of the nodes of tables.

`aerodb.update.tabulation` defines the observation theta = H g + D s + e.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.schema import database_coefficients, terms
from aerodb.update.posterior import joint_covariance
from flightmech import terms as _terms
from flightmech.aircraft.controls import ICE
from flightmech.errors import SchemaError, UnknownName

_MISSING_VARIABLE = (
    "a table needs it and the data of the fit do not hold it; map its column, or state it "
    "in [constants] of the name map"
)
# Devices that count as neutral if the record does not have them.
_NEUTRAL = ("delta_t", "delta_ta", "delta_tr", "gear", "speedbrake", ICE)
_FREE_AIR = 1e4  # height above ground where a fit has no information on the ground [m]
_NEGLIGIBLE = 1e-6  # variance of an error of a fixed term, relative to its largest


@dataclass(frozen=True)
class CoefficientTerms:
    """The terms of one coefficient: those that flights may change, and those with fixed values.

    Attributes
    ----------
    coefficient : str
    leaves : mapping of str to Dataset
        All terms.
    free : mapping of str to Dataset
        Terms that the flights may change.
    fixed : mapping of str to (Dataset, array (nodes, errors))
        Terms that keep their values, with the independent errors of their nodes.
    """

    coefficient: str
    leaves: Mapping[str, xr.Dataset]
    free: Mapping[str, xr.Dataset]
    fixed: Mapping[str, tuple[xr.Dataset, np.ndarray]]

    def bases_at(self, data: xr.Dataset) -> dict[str, Any]:
        """Return the linear maps from the nodes of every term to samples, the free terms first."""
        return {name: basis_at(self.leaves[name], data) for name in (*self.free, *self.fixed)}

    def sampled(self, data: xr.Dataset) -> np.ndarray:
        """Return the largest weight that a sample gives to each free node, (free nodes,)."""
        return np.concatenate([_largest_weights(leaf, data) for leaf in self.free.values()])


@dataclass(frozen=True)
class Observation:
    """A fit, or directions of the samples of a manoeuvre, linear in the free nodes.

    Attributes
    ----------
    name : str
    data : Dataset (sample,)
    theta : array (estimates,)
        Estimates less the contribution of the fixed terms.
    H : array (estimates, free nodes)
    D : array (estimates, common errors)
    C : array (estimates, estimates)
    sampled : array (free nodes,)
        Largest weight of each node at a sample.
    bases : dict of str to sparse array (samples, nodes)
        Of all terms, free and fixed.
    errors : sequence of str
        Names of the common errors in the first columns of D.  The errors of fixed terms in the
        columns behind them do not have names.
    """

    name: str
    data: xr.Dataset
    theta: np.ndarray
    H: np.ndarray
    D: np.ndarray
    C: np.ndarray
    sampled: np.ndarray
    bases: dict[str, Any]
    errors: Sequence[str]


def observed_nodes(observed: Sequence[Observation]) -> np.ndarray:
    """Return which free nodes enter some estimate, array of bool (free nodes,)."""
    entering = [np.abs(observation.H).max(axis=0) > 0 for observation in observed]
    return np.any(entering, axis=0)


def sampled_weights(observed: Sequence[Observation]) -> np.ndarray:
    """Return the largest weight of each free node at a sample of any observation."""
    return np.max([observation.sampled for observation in observed], axis=0)


def observe_fits(
    fits: Sequence[Any], prior: xr.DataTree, held: Sequence[str]
) -> Iterator[tuple[CoefficientTerms, list[Observation]]]:
    """Yield the terms of every coefficient and the observations by its fits.

    Raises as `known_terms` does.
    """
    for coefficient_terms in known_terms([coefficient_of(fit) for fit in fits], prior, held):
        local = [fit for fit in fits if coefficient_of(fit) == coefficient_terms.coefficient]
        sources = common_errors_of_fits(local)
        yield coefficient_terms, [observe_fit(fit, coefficient_terms, sources) for fit in local]


def common_errors_of_fits(fits: Sequence[Any]) -> list[str]:
    """Return the names of the common errors of fits, each once."""
    names: dict[str, None] = {}
    for fit in fits:
        names.update(dict.fromkeys(map(str, fit.estimates["error"].values)))
    return list(names)


def _demand_no_constraint(fit: Any) -> None:
    """Raise for a fit whose terms follow constraints: tables cannot learn from them separately."""
    attributes = fit.estimates.attrs
    stored = json.loads(str(attributes.get("constraints", "") or "[]"))
    texts = [row["text"] for row in stored if row["active"]]
    if texts:
        raise SchemaError(
            str(attributes.get("name") or attributes["coefficient"]),
            [
                f"the fit holds the constraints {'; '.join(texts)}, and its estimates are not "
                f"those of its samples alone; fit it without constraints, or put the value into "
                f"the database as a prior"
            ],
        )


def observe_fit(
    fit: Any, coefficient_terms: CoefficientTerms, sources: Sequence[str]
) -> Observation:
    """Return the observation of the terms of a coefficient by a fit.

    Parameters
    ----------
    fit : Fit
    coefficient_terms : CoefficientTerms
    sources : sequence of str
        Names of the common errors in the first columns of D.
    """
    _demand_no_constraint(fit)
    # Least squares with the design X = Q R: samples z give the estimates R^-1 Q' z.
    Q, R = np.linalg.qr(fit.design.values)
    bases = coefficient_terms.bases_at(fit.data)
    estimates = fit.estimates
    theta, common = estimates["estimate"].values, np.zeros((Q.shape[1], len(sources)))
    columns = [sources.index(str(name)) for name in estimates["error"].values]
    common[:, columns] = estimates["systematic"].values
    D = [common]
    # Fixed terms: their values are subtracted, their errors are common errors.
    for name, (leaf, factor) in coefficient_terms.fixed.items():
        contribution = bases[name] @ leaf["value"].values.ravel()
        theta = theta - np.linalg.solve(R, Q.T @ contribution)
        D.append(np.linalg.solve(R, Q.T @ (bases[name] @ factor)))
    # H = R^-1 Q' B; B is sparse, hence B' Q.
    H = [np.linalg.solve(R, (bases[name].T @ Q).T) for name in coefficient_terms.free]
    return Observation(
        name=str(estimates.attrs.get("name", "")),
        data=fit.data,
        theta=theta,
        H=np.hstack(H),
        D=np.hstack(D),
        C=estimates["covariance"].values,
        sampled=coefficient_terms.sampled(fit.data),
        bases=bases,
        errors=sources,
    )


def _independent_errors(leaf: xr.Dataset) -> np.ndarray:
    """Return independent errors of a fixed term, (nodes, errors), with its a-priori covariance."""
    if "stderr" not in leaf:
        return np.zeros((leaf["value"].size, 0))
    eigenvalues, vectors = np.linalg.eigh(joint_covariance({"": leaf})[1])
    significant = eigenvalues > _NEGLIGIBLE * eigenvalues.max()
    return vectors[:, significant] * np.sqrt(eigenvalues[significant])


def _largest_weights(leaf: xr.Dataset, data: xr.Dataset) -> np.ndarray:
    """Return the largest weight of each node at a sample inside the table: 1 on the node."""
    table = _terms.without_multipliers(leaf)
    B = basis_at(table, data)[~samples_outside(table, data)]
    if not B.shape[0]:
        return np.zeros(leaf["value"].size)
    return np.asarray(B.max(axis=0).todense()).ravel()


def known_terms(
    wanted: Iterable[str], prior: xr.DataTree, held: Sequence[str]
) -> list[CoefficientTerms]:
    """Return the terms of every coefficient requested.

    Parameters
    ----------
    wanted : iterable of str
        Names of the coefficients; repeated names count once.
    prior : DataTree
        The database.
    held : sequence of str
        Terms with fixed values.

    Raises
    ------
    SchemaError
        Terms without standard errors, or force axes other than those of the flights; all faults.
    UnknownName
        A fixed term or a coefficient that the database does not have.
    """
    leaves = terms(prior)
    for name in held:
        if name not in leaves:
            raise UnknownName(name, leaves, "held term")
    coefficients = list(dict.fromkeys(wanted))
    available = database_coefficients(prior)
    for name in coefficients:
        if name not in available:
            reason = "the database does not hold it with its force axes"
            raise UnknownName(name, available, "coefficient", reason)
    _demand_errors_and_axes(leaves, coefficients, prior, held)
    groups = []
    for coefficient in coefficients:
        of_coefficient, free, fixed = {}, {}, {}
        for name, leaf in leaves.items():
            if not name.startswith(f"{coefficient}/"):
                continue
            of_coefficient[name] = leaf
            if name in held:
                fixed[name] = leaf, _independent_errors(leaf)
            else:
                free[name] = leaf
        groups.append(CoefficientTerms(coefficient, of_coefficient, free=free, fixed=fixed))
    return groups


def _demand_errors_and_axes(
    leaves: Mapping[str, xr.Dataset],
    coefficients: Sequence[str],
    prior: xr.DataTree,
    held: Sequence[str],
) -> None:
    """Raise `SchemaError` for wind axes and for terms without standard errors; all faults."""
    problems = []
    if prior.attrs["force_axes"] == "wind" and set(coefficients) & {"CL", "CD", "CY"}:
        problems.append(
            "force_axes is 'wind', the fits are of stability axes; build the database in "
            "stability axes"
        )
    for name, leaf in leaves.items():
        if name.split("/")[0] in coefficients and name not in held and "stderr" not in leaf:
            problems.append(f"{name} has no stderr; give one to every node, or hold the term")
    if problems:
        raise SchemaError("prior", problems)


def _term_conditions(leaf: xr.Dataset, data: xr.Dataset) -> dict[str, Any]:
    """Return the samples of a fit as conditions of a term."""
    conditions: dict[str, Any] = {}
    for name in _terms.list_model_variables(leaf):
        if name in data:
            conditions[name] = _finite_samples(name, data.variables[name])
        elif name in _NEUTRAL:
            conditions[name] = np.zeros(data.sizes["sample"])
        elif name == "h_agl":
            conditions[name] = np.full(data.sizes["sample"], _FREE_AIR)
        else:
            raise UnknownName(name, map(str, data.data_vars), "variable", _MISSING_VARIABLE)
    return conditions


def _finite_samples(name: str, samples: xr.Variable) -> np.ndarray:
    """Return the samples of a variable that tables depend on; raise unless all are numbers."""
    if samples.dtype.kind not in "iuf" or samples.dims not in ((), ("sample",)):
        problem = f"{name} is not one number for each sample; identify the fit again"
        raise SchemaError("data of a fit", [problem])
    if lost := int((~np.isfinite(samples.values)).sum()):
        problem = (
            f"{name} has {lost} NaN or infinite samples of {samples.size}, and a table of the "
            f"database depends on it; identify the fit without these samples"
        )
        raise SchemaError("data of a fit", [problem])
    return samples.values


def basis_at(leaf: xr.Dataset, data: xr.Dataset) -> Any:
    """Return the linear map from the nodes of a term to its contribution at samples.

    Parameters
    ----------
    leaf : Dataset
        The term.
    data : Dataset (sample,)
        ``Fit.data``.  Devices that it does not have are neutral, and the ground is far away.

    Returns
    -------
    sparse array (samples, nodes)

    Raises
    ------
    UnknownName
        A variable of the term that the samples do not hold.
    """
    B = _terms.basis(leaf, _term_conditions(leaf, data), outside="clamp")
    samples = data.sizes["sample"]
    if B.shape[0] == samples:
        return B
    # A single number without axes or regressors has one row: repeat it for every sample.
    return type(B)(np.repeat(B.toarray(), samples, axis=0))


def samples_outside(leaf: xr.Dataset, data: xr.Dataset) -> np.ndarray:
    """Return which samples lie outside a table of the term on some axis, array of bool."""
    outside = np.zeros(data.sizes["sample"], bool)
    for table in ("value", "K1", "K2"):
        if table not in leaf:
            continue
        for axis in map(str, leaf.variables[table].dims):
            if axis in data:
                x, points = data.variables[axis].values, leaf.variables[axis].values
                outside |= (x < points[0]) | (x > points[-1])
    return outside


def coefficient_of(fit: Any) -> str:
    """Return the coefficient that a fit describes."""
    return str(fit.estimates.attrs["coefficient"])
