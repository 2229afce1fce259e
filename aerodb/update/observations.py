"""Local models and samples from flight as linear observations of the nodes of tables
(`aerodb.update.tabulation`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.schema import database_coefficients, terms
from aerodb.update.posterior import joint_covariance
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName

_UNKNOWN = (
    "a table needs it and the data of the fit do not hold it; map its column, or state it "
    "in [constants] of the name map"
)
_AT_REST = ("delta_t", "delta_ta", "delta_tr", "gear", "speedbrake")
_FREE_AIR = 1e4  # h_agl where a fit has no information on the ground [m]
_NEGLIGIBLE = 1e-6  # variance of an error of a held term, over its largest


@dataclass(frozen=True)
class CoefficientTerms:
    """The terms of one coefficient: those that the flights may change, and those that are held with
    their independent errors.
    """

    coefficient: str
    leaves: Mapping[str, xr.Dataset]
    free: Mapping[str, xr.Dataset]
    fixed: Mapping[str, tuple[xr.Dataset, np.ndarray]]

    def bases_at(self, data: xr.Dataset) -> dict[str, Any]:
        """Return the linear maps from the nodes of every term to samples, the free ones first."""
        return {name: basis_at(self.leaves[name], data) for name in (*self.free, *self.fixed)}

    def sampled(self, data: xr.Dataset) -> np.ndarray:
        """Return the largest weight that a sample gives to each free node, (free nodes,)."""
        return np.concatenate([_nearest(leaf, data) for leaf in self.free.values()])


@dataclass(frozen=True)
class Observation:
    """A fit, or directions of the samples of a manoeuvre, as linear in the free nodes."""

    name: str
    data: xr.Dataset
    theta: np.ndarray  # estimates less what the held terms contribute
    H: np.ndarray  # (estimates, free nodes)
    D: np.ndarray  # (estimates, common errors)
    C: np.ndarray  # (estimates, estimates)
    sampled: np.ndarray  # (free nodes,), largest weight of each at a sample
    bases: dict[str, Any]  # of all terms, free and held: (samples, nodes)
    errors: Sequence[
        str
    ]  # names of the common errors, the first columns of D; those of held terms have none


def observe_fits(
    fits: Sequence[Any], prior: xr.DataTree, held: Sequence[str]
) -> Iterator[tuple[CoefficientTerms, list[Observation]]]:
    """Yield the terms of every coefficient and the fits of it; raises as `known_terms` does."""
    for known in known_terms([coefficient_of(fit) for fit in fits], prior, held):
        local = [fit for fit in fits if coefficient_of(fit) == known.coefficient]
        sources = common_errors_of_fits(local)
        yield known, [observe_fit(fit, known, sources) for fit in local]


def common_errors_of_fits(fits: Sequence[Any]) -> list[str]:
    """Return the names of the common errors of fits."""
    return list(dict.fromkeys(str(name) for fit in fits for name in fit.estimates["error"].values))


def observe_fit(fit: Any, known: CoefficientTerms, sources: Sequence[str]) -> Observation:
    """Return what a fit observes of the terms of its coefficient; `sources` are the common errors
    of the first columns of D.
    """
    Q, R = np.linalg.qr(fit.design.values)

    def local(samples: np.ndarray) -> np.ndarray:
        """Return what the local model makes of (columns of) samples."""
        return np.linalg.solve(R, Q.T @ samples)

    bases = known.bases_at(fit.data)
    e = fit.estimates
    theta, common = e["estimate"].values, np.zeros((Q.shape[1], len(sources)))
    common[:, [sources.index(str(name)) for name in e["error"].values]] = e["systematic"].values
    D = [common]
    for name, (leaf, factor) in known.fixed.items():
        theta = theta - local(bases[name] @ leaf["value"].values.ravel())
        D.append(local(bases[name] @ factor))
    H = [np.linalg.solve(R, (bases[name].T @ Q).T) for name in known.free]
    return Observation(
        str(e.attrs.get("name", "")),
        fit.data,
        theta,
        np.hstack(H),
        np.hstack(D),
        e["covariance"].values,
        known.sampled(fit.data),
        bases,
        sources,
    )


def _factor(leaf: xr.Dataset) -> np.ndarray:
    """Return independent errors of a term that is held, (nodes, errors): their covariance is that a
    priori.
    """
    if "stderr" not in leaf:
        return np.zeros((leaf["value"].size, 0))
    size, shape = np.linalg.eigh(joint_covariance({"": leaf})[1])
    known = size > _NEGLIGIBLE * size.max()
    return shape[:, known] * np.sqrt(size[known])


def _nearest(leaf: xr.Dataset, data: xr.Dataset) -> np.ndarray:
    """Return the largest weight that the table gives to each node at a sample inside it: 1 at a
    sample on the node.
    """
    bare = _terms.without_multipliers(leaf)
    B = basis_at(bare, data)[~samples_outside(bare, data)]
    return (
        np.asarray(B.max(axis=0).todense()).ravel() if B.shape[0] else np.zeros(leaf["value"].size)
    )


def known_terms(
    wanted: Iterable[str], prior: xr.DataTree, held: Sequence[str]
) -> list[CoefficientTerms]:
    """Return the terms of every coefficient wanted.

    Raises
    ------
    SchemaError
        Terms without standard errors, or force axes other than those of the flights; all faults.
    UnknownName
        A held term or a coefficient that the database does not have.
    """
    leaves = terms(prior)
    for name in held:
        if name not in leaves:
            raise UnknownName(name, leaves, "held term")
    wanted = list(dict.fromkeys(wanted))
    for name in wanted:
        if name not in database_coefficients(prior):
            raise UnknownName(
                name,
                database_coefficients(prior),
                "coefficient",
                "the database does not hold it with its force axes",
            )
    problems = []
    if prior.attrs["force_axes"] == "wind" and set(wanted) & {"CL", "CD", "CY"}:
        problems.append(
            "force_axes is 'wind', the fits are of stability axes; build the database in "
            "stability axes"
        )
    for name, leaf in leaves.items():
        if name.split("/")[0] in wanted and name not in held and "stderr" not in leaf:
            problems.append(f"{name} has no stderr; give one to every node, or hold the term")
    if problems:
        raise SchemaError("prior", problems)
    found = []
    for coefficient in wanted:
        mine = {name: leaf for name, leaf in leaves.items() if name.startswith(f"{coefficient}/")}
        fixed = {name: (leaf, _factor(leaf)) for name, leaf in mine.items() if name in held}
        found.append(
            CoefficientTerms(
                coefficient,
                mine,
                {name: leaf for name, leaf in mine.items() if name not in held},
                fixed,
            )
        )
    return found


def _conditions(leaf: xr.Dataset, data: xr.Dataset) -> dict[str, Any]:
    """The samples of a fit as conditions of a term; devices that were not recorded are at rest, the
    ground is far.
    """
    found: dict[str, Any] = {}
    for name in _terms.list_model_variables(leaf):
        if name in data:
            found[name] = data[name].values
        elif name in _AT_REST:
            found[name] = np.zeros(data.sizes["sample"])
        elif name == "h_agl":
            found[name] = np.full(data.sizes["sample"], _FREE_AIR)
        else:
            raise UnknownName(name, map(str, data.data_vars), "variable", _UNKNOWN)
    return found


def basis_at(leaf: xr.Dataset, data: xr.Dataset):
    """Return the linear map from the nodes of a term to its contribution at the samples of a fit,
    sparse (sample, node).

    Parameters
    ----------
    leaf : Dataset
        The term.
    data : Dataset (sample,)
        ``Fit.data``; devices that were not recorded are at rest, the ground is far.

    Raises
    ------
    UnknownName
        A variable of the term that the samples do not hold.
    """
    B = _terms.basis(leaf, _conditions(leaf, data), outside="clamp")
    # a single number without axes or regressors has no samples of its own
    return (
        B
        if B.shape[0] == data.sizes["sample"]
        else type(B)(np.repeat(B.toarray(), data.sizes["sample"], axis=0))
    )


def samples_outside(leaf: xr.Dataset, data: xr.Dataset) -> np.ndarray:
    """Samples that lie outside the table on some axis."""
    outside = np.zeros(data.sizes["sample"], bool)
    for table in (leaf[name] for name in ("value", "K1", "K2") if name in leaf):
        for axis in map(str, table.dims):
            if axis in data:
                x, points = data[axis].values, table[axis].values
                outside |= (x < points[0]) | (x > points[-1])
    return outside


def coefficient_of(fit: Any) -> str:
    """Return the coefficient that a fit is of."""
    return str(fit.estimates.attrs["coefficient"])
