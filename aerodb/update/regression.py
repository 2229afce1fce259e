"""Nodes of tables estimated directly from the samples of all manoeuvres.

A piecewise-linear table is linear in its nodes, so samples are

    z = B g + E s + v,    s ~ N(0, 1)

with the nodes g of all terms of one coefficient, changes E by one standard error of the errors that
all samples share, and a disturbance v that is correlated in time.  The nodes are many, and one
manoeuvre contains little information on each.

With the a-priori covariance P = F F' of the nodes that it moves, the singular value decomposition
B F = U S W' gives the combinations theta = U'z.  Their a-priori standard errors are S.  The update
uses the combinations whose a-priori standard error is several times the standard error of U'v.  The
latter follows from the coloured covariance of the residual.  Smaller combinations contain as much
of other effects as of the tables: the bend of the true curves between two nodes, and noise of the
states in step with that of the coefficient.  With a limit of one standard error, the rate of
incidence of the T-37 came out 3.5 of its standard errors wrong.

An observation of directions is then treated like a local fit: the same learnt prior covariance, the
same weights, the same common errors, considered and not estimated (`aerodb.update.tabulation`).
There is no local model between samples and tables.  A model error therefore does not scatter the
estimates, and a term need not be in all manoeuvres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from aerodb.store.schema import terms
from aerodb.update.cautions.control_sizes import control_sizes
from aerodb.update.cautions.unplaced_terms import (
    Covariance,
    demand_places,
    unplaced_controls,
    unplaced_terms,
)
from aerodb.update.correlation import LENGTHS, SHARES, prior_parts
from aerodb.update.observations import (
    CoefficientTerms,
    Observation,
    basis_at,
    coefficient_of,
    common_errors_of_fits,
    known_terms,
    observe_fit,
)
from aerodb.update.shapes import Shape, demand_shapes
from aerodb.update.tabulation import join_observations, slices_of
from aerodb.update.tabulation_report import Tabulation, add_cautions, merge_tabulations
from flightmech import terms as _terms
from flightmech.errors import IdentificationError

# Least a-priori standard error of a direction that is used, over that of its measurement.
KEEP = 4.0
_HISTORY = "regress_tables: from the samples of {} groups of manoeuvres"
_ROUNDING = 1e-6  # singular value over the largest, below which it is rounding
_PORTION = 4_000_000  # numbers (samples times directions) in memory at a time


def regress_tables(
    samples: Sequence[xr.Dataset],
    prior: xr.DataTree,
    covariance: Covariance,
    held: Sequence[str] = (),
    lengths: Mapping[str, float] | None = None,
    fits: Sequence[Any] = (),
    shapes: Mapping[str, Sequence[Shape]] | None = None,
    unplaced: str = "raise",
    local: Sequence[Any] = (),
) -> Tabulation:
    """Return the terms of a database estimated from samples, without local models.

    Parameters
    ----------
    samples : sequence of Dataset (sample,)
        One for every manoeuvre or group of manoeuvres of one disturbance.  It has a coefficient,
        named by the attribute ``coefficient``, and the variables of its terms [SI].  With common
        errors it also has the changes by one standard error of each: ``<coefficient>_error``
        (error, sample) and the same of variables.  The attribute ``name`` is for reports.
    prior : DataTree
        The database; its leaves need ``stderr``, a node with ``stderr`` 0 keeps its value.
    covariance : callable
        ``covariance(samples, X, v)`` returns the covariance of the least-squares estimate with the
        regressors X (sample, term) and the residuals v, such as
        `flighttest.combining.coloured_covariance`.
    held, lengths, shapes
        As in `tabulate`.
    fits : sequence of Fit
        Estimates without samples, such as published values; they count as in `tabulate`.
    unplaced : {"raise", "warn"}
        As in `tabulate`, for the terms of `fits` and `local`.  Samples without a local model are
        checked for their primary controls (elevator of CL and Cm, aileron of Cl, rudder of CY and
        Cn, flaps, gear).  A control that moved and on which no term of the coefficient depends is
        significant if its t value in the residual of the tables is 4.47 or more.
    local : sequence of Fit
        Local models of the same samples.  Their estimates are not used; their terms must have a
        place.

    Returns
    -------
    Tabulation
        As that of `tabulate`; a row of ``points`` for each of `samples`, then of `fits`.

    Raises
    ------
    IdentificationError
        No samples, or fewer in one Dataset than directions in which they move the tables.
    SchemaError, UnknownName
        As in `tabulate`.

    Warns
    -----
    AeromatchWarning
        As in `tabulate`.

    References
    ----------
    .. [Hansen1998] Hansen, Rank-Deficient and Discrete Ill-Posed Problems, SIAM 1998, chapter 3.
    .. [Morelli1997] Morelli, Klein, J. Guidance 20, 1997.
    """
    if not samples:
        raise IdentificationError(
            "There are no samples. regress_tables needs those of at least one manoeuvre."
        )
    lengths = {**LENGTHS, **(lengths or {})}
    changeable = {name: leaf for name, leaf in terms(prior).items() if name not in held}
    demand_shapes(shapes or {}, changeable)
    modelled = {(coefficient_of(fit), str(fit.estimates.attrs.get("name", ""))) for fit in local}
    coefficients = [str(data.attrs["coefficient"]) for data in samples]
    coefficients += [coefficient_of(fit) for fit in fits]
    tabulations, without_place = [], [unplaced_terms([*fits, *local], prior, held)]
    for coefficient_terms in known_terms(coefficients, prior, held):
        sampled, estimates = _observe_coefficient(
            samples, fits, coefficient_terms, covariance=covariance, lengths=lengths
        )
        for observation in sampled:
            if (coefficient_terms.coefficient, observation.name) not in modelled:
                without_place.append(_unplaced_controls(observation, coefficient_terms, covariance))
        observed = [observation.observation for observation in sampled] + estimates
        tabulations.append(
            join_observations(coefficient_terms, observed, lengths, shapes=shapes, history=_HISTORY)
        )
    # Empty tables would change the types of the columns.
    with_rows = [table for table in without_place if len(table)]
    table = pd.concat(with_rows or without_place[:1])
    notices = demand_places(table, unplaced)
    named = [(str(item.attrs.get("name", "")), item) for item in samples]
    named += [(str(fit.estimates.attrs.get("name", "")), fit.data) for fit in fits]
    sizes = control_sizes([*fits, *local], prior, held)
    return add_cautions(merge_tabulations(tabulations), table, notices, named, sizes)


def _unplaced_controls(
    observation: _SampleObservation, coefficient_terms: CoefficientTerms, covariance: Covariance
) -> pd.DataFrame:
    """Return the controls that moved in samples and on which no term depends."""
    return unplaced_controls(
        observation.name,
        observation.data,
        coefficient_terms,
        directions=observation.directions,
        covariance=covariance,
    )


class _SampleObservation(NamedTuple):
    """The observation by one set of samples, and a function that returns its directions.

    The directions are orthonormal, (samples, directions).  The samples move the tables in them.
    """

    observation: Observation
    directions: Callable[[], np.ndarray]

    @property
    def name(self) -> str:
        """Name of the samples."""
        return self.observation.name

    @property
    def data(self) -> xr.Dataset:
        """The samples."""
        return self.observation.data


def _observe_coefficient(
    samples: Sequence[xr.Dataset],
    fits: Sequence[Any],
    coefficient_terms: CoefficientTerms,
    covariance: Covariance,
    lengths: Mapping[str, float],
) -> tuple[list[_SampleObservation], list[Observation]]:
    """Return the observations of one coefficient by its samples and by its fits."""
    coefficient = coefficient_terms.coefficient
    datasets = [data for data in samples if data.attrs["coefficient"] == coefficient]
    local = [fit for fit in fits if coefficient_of(fit) == coefficient]
    sources: dict[str, None] = {}
    for data in datasets:
        if "error" in data.coords:
            sources.update(dict.fromkeys(map(str, data["error"].values)))
    sources.update(dict.fromkeys(common_errors_of_fits(local)))
    flown_data = [*datasets, *(fit.data for fit in local)]
    sampled = np.max([coefficient_terms.sampled(data) for data in flown_data], axis=0)
    free = coefficient_terms.free
    priors = []
    for leaf, nodes in zip(free.values(), slices_of(free.values())):
        priors.append(_declared_covariance(leaf, sampled[nodes], lengths))
    names = list(sources)
    observations = []
    for data in datasets:
        observations.append(
            _observe_samples(data, coefficient_terms, priors, names, covariance=covariance)
        )
    return observations, [observe_fit(fit, coefficient_terms, names) for fit in local]


def _declared_covariance(
    leaf: xr.Dataset, sampled: np.ndarray, lengths: Mapping[str, float]
) -> np.ndarray:
    """Return the covariance of the nodes of a term with the a-priori weights of its parts."""
    return np.einsum("k,kij->ij", list(SHARES.values()), prior_parts(leaf, sampled, lengths))


def _observe_samples(
    samples: xr.Dataset,
    coefficient_terms: CoefficientTerms,
    priors: Sequence[np.ndarray],
    sources: Sequence[str],
    *,
    covariance: Covariance,
) -> _SampleObservation:
    """Return the observation of the nodes by one set of samples."""
    free, fixed = coefficient_terms.free, coefficient_terms.fixed
    name = str(samples.attrs.get("name", ""))
    bases = coefficient_terms.bases_at(samples)
    z = samples[coefficient_terms.coefficient].values.astype(float)
    for term, (leaf, _) in fixed.items():
        z = z - bases[term] @ leaf["value"].values.ravel()
    g0 = np.concatenate([leaf["value"].values.ravel() for leaf in free.values()])
    free_bases = [bases[term] for term in free]
    B = scipy.sparse.hstack(free_bases, format="csr")
    # Only nodes that the samples move: residual r = B F x with x ~ N(0, 1) a priori.
    touched, F = _prior_factor(free_bases, priors)
    product = _NodeProduct(B[:, touched], F)
    r = z - B @ g0
    s, W, U = _select_directions(product, r, lambda X, v: covariance(samples, X, v), name)
    C = covariance(samples, U, r - U @ (U.T @ r))
    # Nodes after this set of samples alone, at which the common errors are linearised.
    nodes = g0.copy()
    nodes[touched] += F @ (W @ (s / (s**2 + np.diag(C)) * (U.T @ r)))
    common = np.zeros((len(s), len(sources)))
    errors, change = _common_changes(samples, coefficient_terms, bases, nodes)
    common[:, [sources.index(error) for error in errors]] = U.T @ change.T
    H = np.zeros((len(s), len(g0)))
    H[:, touched] = (B[:, touched].T @ U).T
    D = [common, *(U.T @ (bases[term] @ factor) for term, (_, factor) in fixed.items())]
    observation = Observation(
        name=name,
        data=samples,
        theta=U.T @ z,
        H=H,
        D=np.hstack(D),
        C=C,
        sampled=coefficient_terms.sampled(samples),
        bases=bases,
        errors=sources,
    )
    return _SampleObservation(observation, product.all_directions)


def _prior_factor(
    bases: Sequence[Any], priors: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes that samples move, among all, and a factor F of their covariance F F'."""
    touched, factors, first = [], [], 0
    for B, P in zip(bases, priors):
        nodes = np.flatnonzero(np.diff(B.tocsc().indptr))
        if len(nodes):
            eigenvalues, vectors = np.linalg.eigh(P[np.ix_(nodes, nodes)])
            significant = eigenvalues > _ROUNDING**2 * max(eigenvalues[-1], 0.0)
            factors.append(vectors[:, significant] * np.sqrt(eigenvalues[significant]))
            touched.append(first + nodes)
        first += B.shape[1]
    return np.concatenate(touched), scipy.linalg.block_diag(*factors)


class _NodeProduct:
    """Sparse B times dense F; the product is never in memory as a whole."""

    def __init__(self, B: Any, F: np.ndarray) -> None:
        self.B, self.F = B, F

    def decompose(self) -> tuple[np.ndarray, np.ndarray]:
        """Return singular values and right singular vectors (columns)."""
        columns = self.F.shape[1]
        rows = max(columns, _PORTION // max(columns, 1))
        # B F = Q R has the singular values of R.  Each portion of rows updates R.
        R = np.zeros((0, columns))
        for start in range(0, self.B.shape[0], rows):
            portion = self.B[start : start + rows] @ self.F
            R = np.asarray(np.linalg.qr(np.vstack([R, portion]), mode="r"))
        _, s, Wt = np.linalg.svd(R, full_matrices=False)
        significant = s > _ROUNDING * s[0]
        return s[significant], Wt[significant].T

    def all_directions(self) -> np.ndarray:
        """Return all left singular vectors, (samples, directions)."""
        return self.directions(*self.decompose())

    def directions(self, s: np.ndarray, W: np.ndarray) -> np.ndarray:
        """Return the left singular vectors U = B F W / S, (samples, directions)."""
        return np.asarray(self.B @ (self.F @ (W / s)))


def _select_directions(
    product: _NodeProduct,
    r: np.ndarray,
    covariance: Callable[[np.ndarray, np.ndarray], np.ndarray],
    name: str,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return S, W and U of the directions that the samples can measure; one at least."""
    s, W = product.decompose()
    if len(s) >= len(r):
        raise IdentificationError(
            f"{name}: {len(r)} samples in {len(s)} directions of the tables; record more, or "
            f"join manoeuvres of one disturbance"
        )
    U = product.directions(s, W)
    power = float(r @ r - (U.T @ r) @ (U.T @ r))
    # The first selection assumes white noise, the next two the coloured covariance.
    noise = np.full(len(s), np.sqrt(max(power, 0.0) / (len(r) - len(s))))
    for _ in range(2):
        selected = _is_measured(s, noise)
        s, W, U = s[selected], W[:, selected], U[:, selected]
        noise = np.sqrt(np.diag(covariance(U, r - U @ (U.T @ r))))
    selected = _is_measured(s, noise)
    return s[selected], W[:, selected], U[:, selected]


def _is_measured(s: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Return which directions exceed their noise by `KEEP`, and always the first."""
    measured = s > KEEP * noise
    measured[0] = True
    return measured


def _common_changes(
    samples: xr.Dataset,
    coefficient_terms: CoefficientTerms,
    bases: Mapping[str, Any],
    nodes: np.ndarray,
) -> tuple[list[str], np.ndarray]:
    """Return the common errors and their changes of measured minus tables, (error, sample)."""
    name = f"{coefficient_terms.coefficient}_error"
    if name not in samples:
        return [], np.zeros((0, samples.sizes["sample"]))
    change = samples[name].values.astype(float)
    free = coefficient_terms.free
    values = {term: nodes[rows] for term, rows in zip(free, slices_of(free.values()))}
    for term, (leaf, _) in coefficient_terms.fixed.items():
        values[term] = leaf["value"].values.ravel()
    # An error of a variable moves the samples along the tables.
    for term, leaf in coefficient_terms.leaves.items():
        variables = _terms.list_model_variables(leaf)
        uncertain = [x for x in variables if f"{x}_error" in samples]
        for error in range(len(change)):
            shifted = {}
            for x in uncertain:
                step = samples[f"{x}_error"].values[error]
                if step.any():
                    shifted[x] = "sample", samples[x].values + step
            if shifted:
                difference = basis_at(leaf, samples.assign(shifted)) - bases[term]
                change[error] -= difference @ values[term]
    return [str(source) for source in samples["error"].values], change
