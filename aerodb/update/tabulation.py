"""Local estimates from flight and a prior database joined into tables.

A local estimate theta = (X'X)^-1 X' z of samples that follow the tables, z = B g, has the
expectation H g with H = (X'X)^-1 X' B.  This holds whatever the local model leaves out.  Every fit
is therefore an observation

    theta = H g + D s + e,    s ~ N(0, 1),    e ~ N(0, C)

of the nodes g of all terms of its coefficient at once.  C is the covariance of the fit with
coloured residuals.  D holds the changes of theta by one standard error of every error that fits
share: mass, inertia, thrust, the pick-ups of the surfaces, and the errors of the instruments that
remain in the reconstructed states.  With the prior g ~ N(g0, P) all distributions are Gaussian, and
the nodes have a posterior in closed form.

The common errors s are *considered* [Schmidt1966]; they are not estimated across fits.  The weights
of the fits are computed as if every fit had errors s of its own.  The covariance of the nodes is
that of these weights if all fits share s.  Terms with fixed values are considered likewise, with
their a-priori errors.  A fit that the others contradict loses weight as a whole
(`aerodb.update.weights.weight_learning`).  An estimate that a common error dominates (a damping, by
the lag of the vanes) then does not distort a table, and a result on which all fits agree counts as
measured.  If s were estimated across fits, the shape of a handbook table would decide on an
instrument.  Only that shape separates the bias of an elevator pick-up from a constant pitching
moment.  The standard error of the bias then came out at a third of its true value, and the values
were no better.

The prior covariance of the nodes is a sum of five parts (`aerodb.update.correlation.prior_parts`).
The first is common to the whole table.  The second is common to the flown region and fades with the
distance from it.  The third and the fourth are smooth curves of two lengths.  The fifth is rough.
The weights of the parts, and one factor on C, are learnt for each term by their marginal
likelihood, with lognormal hyperpriors at the a-priori shares
(`aerodb.update.weights.weight_learning`).  A derivative may also have the shape of the handbook:
the last three parts then have no weight (`aerodb.update.weights.weight_likelihood`).  A term that
no fit informs keeps the a-priori shares.

Flights determine the size of a correction only in the flown region.  The second part therefore
follows the fits very little and never has less than its a-priori weight.  Outside the flown region
the standard errors go back to those of the handbook.  The first part is the error of the handbook
method as a whole.  It may grow by much, and it carries a correction to nodes outside the flown
region.  Nodes of different terms are independent a priori, and dependent after the flight.  The
term tables keep their joint covariance (`aerodb.update.posterior`); ``stderr`` is that of single
nodes.

If no fit separates two terms, their priors divide the effect between them.  A fit with one term for
pitch rate and rate of incidence informs ``qhat`` and ``alphadothat`` together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from aerodb.store.schema import terms
from aerodb.update.cautions.control_sizes import control_sizes
from aerodb.update.cautions.unplaced_terms import demand_places, unplaced_terms
from aerodb.update.correlation import LENGTHS, SHARES, flown_distance, prior_parts
from aerodb.update.observations import (
    CoefficientTerms,
    Observation,
    observe_fits,
    observed_nodes,
    sampled_weights,
)
from aerodb.update.posterior import mark_joint, with_posterior
from aerodb.update.shapes import Shape, apply_shapes, demand_shapes
from aerodb.update.tabulation_report import (
    Tabulation,
    add_cautions,
    compatibility_row,
    contributing_fits,
    merge_tabulations,
    new_leaf,
    point_rows,
    term_row,
)
from aerodb.update.term_decisions import add_decisions
from aerodb.update.weights.weight_learning import slices_of_sizes, weigh_fits
from aerodb.update.weights.weight_likelihood import (
    invert_covariance,
    plain_shares,
    updated_variance,
)
from flightmech.errors import IdentificationError

# Least weight that some sample gives to a node from flight: half a cell away on each of two axes.
FLOWN = 0.25


def tabulate(
    fits: Sequence[Any],
    prior: xr.DataTree,
    held: Sequence[str] = (),
    lengths: Mapping[str, float] | None = None,
    shapes: Mapping[str, Sequence[Shape]] | None = None,
    unplaced: str = "raise",
) -> Tabulation:
    """Return the terms of a database after an update with local fits.

    Parameters
    ----------
    fits : sequence of Fit
        Of any coefficients.  The update uses ``estimates`` (``estimate``, ``covariance``,
        ``systematic``; attributes ``coefficient``, ``name``), ``data`` and ``design``.
    prior : DataTree
        The database.  Its leaves need ``stderr``; a node with ``stderr`` 0 keeps its value.  A term
        that the flight is to introduce must be present, as zeros with a wide standard error.
    held : sequence of str
        Terms such as ``"CL/altitude"`` that keep their values.  Their standard errors, if present,
        count among those of the other terms.
    lengths : mapping, optional
        Correlation lengths by axis that differ from `LENGTHS`; ``inf`` for fully correlated. [SI]
    shapes : mapping of str to sequence of Shape, optional
        Shapes of tables by term, such as ``"CL/basic"``: `aerodb.update.Shape`.  The values satisfy
        them; the standard errors do not change.  ``report`` has the number of inequalities at
        their bound (``shape_bounds``) and their effect on the standard errors (``shape_ratio``).
    unplaced : {"raise", "warn"}
        What to do if no table of the database carries a significant term of a fit, such as the
        elevator of a fit if the database comes from a clean listing alone.  ``warn`` continues
        without the estimate.  The control then has no effect in the model, and estimates of
        regressors that move with it are biased.

    Returns
    -------
    Tabulation

    Raises
    ------
    SchemaError
        Terms without standard errors, or force axes other than those of the fits; significant terms
        that no table carries; all faults.
    UnknownName
        A held term or a coefficient that the database does not have, or a variable that a table
        needs and the data of a fit do not hold.
    IdentificationError
        No fit, or the weights of the fits do not converge.

    Warns
    -----
    AeromatchWarning
        Fits that are incompatible with each other and the a-priori tables (probability of
        chi-squared below 1e-6), suspect fits that the others contradict (weight below 0.3), and
        with ``unplaced="warn"`` the significant terms that no table carries.

    Notes
    -----
    A term is significant if its t value is 4.47 or more, the root of the partial F of 20 with which
    a term enters a stepwise regression [Klein2006]_.  The t value is
    |estimate| / hypot(stderr, stderr_systematic).  The errors of the instruments count, so that a
    constant that comes from the bias of a vane is not significant.  A table counts as a place if it
    carries half of the regressor along the flight: it depends on the variables of the term, and the
    flown values lie inside its breakpoints.

    References
    ----------
    .. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, section 5.4: partial F
       of 20.
    .. [Rasmussen2006] Rasmussen, Williams, Gaussian Processes for Machine Learning, MIT Press 2006,
       chapter 2.
    .. [Searle1992] Searle, Casella, McCulloch, Variance Components, Wiley 1992, chapter 8.
    .. [Schmidt1966] Schmidt, Application of state-space methods to navigation problems, Advances in
       Control Systems 3, 1966.
    """
    if not fits:
        raise IdentificationError("There is no fit. tabulate needs at least one.")
    lengths = {**LENGTHS, **(lengths or {})}
    changeable = {name: leaf for name, leaf in terms(prior).items() if name not in held}
    demand_shapes(shapes or {}, changeable)
    without_place = unplaced_terms(fits, prior, held)
    notices = demand_places(without_place, unplaced)
    tabulations = []
    for coefficient_terms, observed in observe_fits(fits, prior, held):
        tabulations.append(join_observations(coefficient_terms, observed, lengths, shapes=shapes))
    samples = [(str(fit.estimates.attrs.get("name", "")), fit.data) for fit in fits]
    sizes = control_sizes(fits, prior, held)
    return add_cautions(merge_tabulations(tabulations), without_place, notices, samples, sizes)


@dataclass(frozen=True)
class _NodePosterior:
    """Posterior of the nodes of one coefficient; arrays by node, then by fit."""

    value: np.ndarray
    stderr: np.ndarray
    weight: np.ndarray
    distance: np.ndarray
    parts: dict[str, np.ndarray]  # weights of the parts of the prior covariance, by term
    inflation: float
    chi2: float
    information_factor: np.ndarray  # (nodes, estimates): W of `aerodb.update.posterior`
    error_factor: np.ndarray  # (nodes, common errors): Z
    errors: list[str]  # names of the common errors


def join_observations(
    coefficient_terms: CoefficientTerms,
    observed: Sequence[Observation],
    lengths: Mapping[str, float],
    shapes: Mapping[str, Sequence[Shape]] | None = None,
    history: str = "tabulate: joined with {} fits",
) -> Tabulation:
    """Return the terms of one coefficient given all observations of it."""
    leaves, free = coefficient_terms.leaves, coefficient_terms.free
    touched, sampled = observed_nodes(observed), sampled_weights(observed)
    posterior = _compute_posterior(observed, free, sampled * touched, lengths)
    new, is_flown = {}, {}
    for (name, leaf), nodes in zip(free.items(), slices_of(free.values())):
        if not touched[nodes].any():
            continue
        flown_nodes = ((sampled >= FLOWN) & touched)[nodes]
        updated = new_leaf(
            leaf,
            value=posterior.value[nodes],
            sd=posterior.stderr[nodes],
            flown=flown_nodes,
            contributors=contributing_fits(observed, nodes),
            history=history,
        )
        new[name] = with_posterior(
            leaf,
            updated,
            weights=posterior.parts[name],
            distance=flown_distance(leaf, (sampled * touched)[nodes], lengths),
            lengths=lengths,
            W=posterior.information_factor[nodes],
            Z=posterior.error_factor[nodes],
            errors=posterior.errors,
        )
        is_flown[name] = flown_nodes.reshape(leaf["value"].shape)
    new, shape_effects = apply_shapes(
        add_decisions(leaves, mark_joint(new), is_flown), shapes or {}
    )
    rows = []
    for name, leaf in new.items():
        row = term_row(name, leaves[name], leaf, posterior.parts[name])
        rows.append(row.assign(**shape_effects.get(name, {})))
    coefficient = coefficient_terms.coefficient
    points = point_rows(
        coefficient,
        observed,
        before=leaves,
        after={**leaves, **new},
        distance=posterior.distance,
        weight=posterior.weight,
    )
    count = sum(len(observation.theta) for observation in observed)
    compatibility = compatibility_row(
        coefficient, count, chi2=posterior.chi2, inflation=posterior.inflation
    )
    return Tabulation(new, pd.concat(rows), points=points, compatibility=compatibility)


@dataclass(frozen=True)
class _PriorCovariance:
    """Parts of the a-priori covariance of the nodes, and of the estimates that they imply."""

    nodes: list[np.ndarray]  # P of each term, (parts, nodes, nodes)
    crossed: list[np.ndarray]  # P H' of each term, (parts, nodes, estimates)
    estimates: np.ndarray  # H P H', (terms x parts, estimates, estimates)


def _compute_posterior(
    observed: Sequence[Observation],
    free: Mapping[str, xr.Dataset],
    sampled: np.ndarray,
    lengths: Mapping[str, float],
) -> _NodePosterior:
    """Return the nodes given the fits, with learnt prior covariance and weights of the fits."""
    H = np.vstack([observation.H for observation in observed])
    D = np.vstack([observation.D for observation in observed])
    g0 = np.concatenate([leaf["value"].values.ravel() for leaf in free.values()])
    y = np.concatenate([observation.theta for observation in observed]) - H @ g0
    prior = _prior_covariance_parts(free, H, sampled, lengths)
    shares = plain_shares(free.values())
    weighing = weigh_fits(y, observed, D, prior.estimates, shares=shares)
    factors, own_errors, noise = weighing.factors, weighing.own_errors, weighing.noise

    # Weights w of the learnt prior: P = sum_k w_k P_k of each term, and P H'.
    weights = factors[:-1].reshape(len(free), -1)
    prior_variances, crossed_parts = [], []
    for w, P, PH in zip(weights, prior.nodes, prior.crossed):
        prior_variances.append(w @ np.diagonal(P, axis1=1, axis2=2))
        crossed_parts.append(np.einsum("k,kij->ij", w, PH))
    crossed, prior_variance = np.vstack(crossed_parts), np.concatenate(prior_variances)

    # The gain K = P H' S^-1 has errors s of each fit's own in S.  The variance that holds if all
    # fits share s replaces these: diag(P - K H P + K D D' K' - K (own errors) K').
    gain = crossed @ weighing.inverse
    expected = np.einsum("k,kij->ij", factors[:-1], prior.estimates)
    shared = expected + noise - own_errors
    variance = updated_variance(prior_variance, crossed, gain, shared)
    variance += ((gain @ D) ** 2).sum(axis=1)
    stderr = np.sqrt(np.maximum(variance, 0.0))
    # The same as factors, V = P - W W' + Z Z'.  W W' is K S K' + K (own errors) K'.  `noise` has
    # the errors of each fit's own already, so that they stand in this sum twice.
    information_factor = gain @ _covariance_root(expected + noise + own_errors)
    acting = np.flatnonzero(D.any(axis=0))
    unnamed = [""] * (D.shape[1] - len(observed[0].errors))
    names = [*observed[0].errors, *unnamed]
    return _NodePosterior(
        value=g0 + gain @ y,
        stderr=stderr,
        weight=weighing.weight,
        distance=weighing.distance,
        parts=dict(zip(free, weights)),
        inflation=float(np.sqrt(factors[-1])),
        chi2=_declared_chi2(y, observed, D, prior.estimates),
        information_factor=information_factor,
        error_factor=gain @ D[:, acting],
        errors=[names[column] for column in acting],
    )


def _prior_covariance_parts(
    free: Mapping[str, xr.Dataset],
    H: np.ndarray,
    sampled: np.ndarray,
    lengths: Mapping[str, float],
) -> _PriorCovariance:
    """Return the parts of the a-priori covariance of all terms that are not fixed."""
    node_parts, crossed_parts, estimate_parts = [], [], []
    for leaf, nodes in zip(free.values(), slices_of(free.values())):
        P = prior_parts(leaf, sampled[nodes], lengths)
        PH = P @ H[:, nodes].T
        node_parts.append(P)
        crossed_parts.append(PH)
        estimate_parts.append(H[:, nodes] @ PH)
    return _PriorCovariance(node_parts, crossed_parts, np.concatenate(estimate_parts))


def _declared_chi2(
    y: np.ndarray, observed: Sequence[Observation], D: np.ndarray, expected: np.ndarray
) -> float:
    """Return chi-squared of the estimates with the a-priori weights and the declared errors."""
    tables = len(expected) // len(SHARES)
    declared = np.einsum("k,kij->ij", np.tile(list(SHARES.values()), tables), expected)
    measured = scipy.linalg.block_diag(*[observation.C for observation in observed])
    return float(y @ invert_covariance(declared + D @ D.T + measured) @ y)


def slices_of(leaves: Iterable[xr.Dataset]) -> list[slice]:
    """Return the range of the nodes of each term among the nodes of all terms."""
    return slices_of_sizes([leaf["value"].size for leaf in leaves])


def _covariance_root(S: np.ndarray) -> np.ndarray:
    """Return the lower Cholesky factor of a covariance, scaled to a unit diagonal first."""
    scale = np.sqrt(np.diag(S))
    return scale[:, None] * np.linalg.cholesky(S / np.outer(scale, scale))
