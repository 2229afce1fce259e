"""Local submodels joined by regression over incidence and Mach number, the classical method.

LR-743 eq. (12): every test point gives a submodel of one configuration,

    C = C0 + C_alpha alpha + C_alpha2 alpha^2 + C_q q c/V + C_delta delta

The expectation of its estimates theta is H g of the nodes g of the tables
(`aerodb.update.tabulation`).  The tables are corrected by few parameters,

    g = g0 + F a + r

The columns of F are both kinds of the a-priori error of a term
(`aerodb.update.correlation.error_kinds`), the same times incidence and its square, and the same
times Mach number.  The parameters a are a regression over the test points.  Coefficients refer to
the moment reference point, whatever the centre of gravity of the record was.  The centre of gravity
is therefore not a variable of the regression.  The deviation r is the scatter about the regression
beyond the errors of the submodels.  It is proportional to the a-priori errors of the tables.  Its
size makes chi-squared of the submodels equal to its expectation (Paule and Mandel 1982).

The clean configuration is the base.  Fits without an increment determine the terms without device.
Their expectation is subtracted from the other fits, which determine the increments of flaps, gear,
speed brake and ground.  The errors of the base count among the errors of the increments.

Parameters are estimated by least squares with the covariance of each submodel and the a-priori
errors of the tables (mixed estimation, Theil and Goldberger 1961).  A parameter that no test point
determines keeps the handbook value.  If the correction of a term is larger than its a-priori error
allows, the a-priori error is increased.  Errors common to all fits are considered.  Beyond the
flown range of incidence and Mach number a table is displaced by the correction at the edge.  Its
standard error goes back to that of the handbook, times the same factor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.update.cautions.control_sizes import control_sizes
from aerodb.update.cautions.unplaced_terms import demand_places, unplaced_terms
from aerodb.update.correlation import LENGTHS, PARTS, error_kinds, flown_distance, prior_parts
from aerodb.update.observations import (
    CoefficientTerms,
    Observation,
    observe_fits,
    observed_nodes,
    sampled_weights,
)
from aerodb.update.stage_solution import StageEquations, solve_stage
from aerodb.update.tabulation import FLOWN, slices_of
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
from flightmech import terms as _terms
from flightmech.aircraft.controls import ICE
from flightmech.errors import IdentificationError

DEVICES = ("delta_f", "gear", "speedbrake", "h_agl", ICE)
"""Variables whose terms are increments on the clean configuration."""

_HISTORY = "join_submodels: joined with {} fits"
# A-priori error of the increments over the standard error of an estimate.  Below it a fit is clean.
_CLEAN = 0.3
_FADE = 2.0  # of the correlation with the flown region, per correlation length
_BEND = 0.5  # a-priori size of the parameters of incidence and Mach number, over that of the level
_LEAST_HALF_SPAN = 1e-6  # of a flown range: a single flown value must not divide by zero


def join_submodels(
    fits: Sequence[Any],
    prior: xr.DataTree,
    held: Sequence[str] = (),
    lengths: Mapping[str, float] | None = None,
    unplaced: str = "raise",
) -> Tabulation:
    """Return the terms of a database by the classical join of local submodels.

    Parameters
    ----------
    fits, prior, held, lengths, unplaced
        As in `tabulate`.

    Returns
    -------
    Tabulation
        As that of `tabulate`, with these differences.  The parts of a prior covariance are not
        learnt (``level reach long medium short`` of ``report`` are NaN).  ``prior_inflation`` is
        the factor on the a-priori errors of the term.  ``inflation`` of ``compatibility`` is 1, and
        ``chi2`` is that of the submodels without the scatter r.  The joint covariance of the nodes
        is not stored.

    Raises
    ------
    SchemaError, UnknownName, IdentificationError
        As in `tabulate`.

    Warns
    -----
    AeromatchWarning
        As in `tabulate`.  The chi-squared of the join also counts the misfit of curves of few
        parameters.

    References
    ----------
    .. [LR743] Delft University of Technology, report LR-743, eq. (12) and section 4.5.
    .. [Theil1961] Theil, Goldberger, On pure and mixed statistical estimation in economics,
       International Economic Review 2, 1961.
    .. [Paule1982] Paule, Mandel, Consensus values and weighting factors, J. Research of the
       National Bureau of Standards 87, 1982.
    """
    if not fits:
        raise IdentificationError("There is no fit. join_submodels needs at least one.")
    lengths = {**LENGTHS, **(lengths or {})}
    without_place = unplaced_terms(fits, prior, held)
    notices = demand_places(without_place, unplaced)
    tabulations = []
    for coefficient_terms, observed in observe_fits(fits, prior, held):
        tabulations.append(_join_coefficient(coefficient_terms, observed, lengths))
    samples = [(str(fit.estimates.attrs.get("name", "")), fit.data) for fit in fits]
    sizes = control_sizes(fits, prior, held)
    return add_cautions(merge_tabulations(tabulations), without_place, notices, samples, sizes)


@dataclass(frozen=True)
class _TermRegression:
    """Regression of one term: its nodes among all nodes, its parameters and its deviation r."""

    nodes: slice
    F: np.ndarray  # (nodes, parameters)
    rough: np.ndarray  # (nodes, nodes): a-priori covariance of r


@dataclass(frozen=True)
class _Stage:
    """Result of one regression; arrays by node of all terms, by fit, by table."""

    change: np.ndarray
    root: np.ndarray  # (nodes, parameters): factor of the covariance of F a
    rough: np.ndarray  # (nodes,): standard error of r
    weight: np.ndarray
    distance: np.ndarray
    factors: np.ndarray
    chi2: float


@dataclass
class _JoinedNodes:
    """Nodes of a coefficient after the stages so far; arrays by node, by table, by fit."""

    value: np.ndarray
    variance: np.ndarray
    factors: np.ndarray
    distance: np.ndarray
    weight: np.ndarray
    informing: dict[int, list[Observation]] = field(default_factory=dict)  # fits of each table
    chi2: float = 0.0


def _join_coefficient(
    coefficient_terms: CoefficientTerms,
    observed: Sequence[Observation],
    lengths: Mapping[str, float],
) -> Tabulation:
    """Return the terms of one coefficient joined from its submodels."""
    leaves, free = coefficient_terms.leaves, coefficient_terms.free
    touched, sampled = observed_nodes(observed), sampled_weights(observed)
    slices = slices_of(free.values())
    ranges = _flown_ranges(observed)
    tables, increments = [], []
    for leaf, nodes in zip(free.values(), slices):
        weights = (sampled * touched)[nodes]
        tables.append(_make_regression(leaf, nodes, weights, ranges=ranges, lengths=lengths))
        increments.append(bool(set(_terms.list_model_variables(leaf)) & set(DEVICES)))
    joined = _join_in_stages(free, observed, tables, increments)
    new, is_flown = {}, {}
    for number, ((name, leaf), nodes) in enumerate(zip(free.items(), slices)):
        if not touched[nodes].any():
            continue
        # Outside the flown region the a-priori error, with its factor, comes back.
        distance = flown_distance(leaf, (sampled * touched)[nodes], lengths)
        prior_stderr = joined.factors[number] * leaf["stderr"].values.ravel()
        unflown_variance = prior_stderr**2 * (1.0 - np.exp(-_FADE * distance))
        flown_nodes = ((sampled >= FLOWN) & touched)[nodes]
        new[name] = new_leaf(
            leaf,
            value=joined.value[nodes],
            sd=np.sqrt(joined.variance[nodes] + unflown_variance),
            flown=flown_nodes,
            contributors=contributing_fits(joined.informing.get(number, []), nodes),
            history=_HISTORY,
        )
        is_flown[name] = flown_nodes.reshape(leaf["value"].shape)
    new = add_decisions(leaves, new, is_flown)
    inflation = dict(zip(free, joined.factors))
    not_learnt = np.full(len(PARTS), np.nan)
    rows = []
    for name, leaf in new.items():
        row = term_row(name, free[name], leaf, not_learnt)
        rows.append(row.assign(prior_inflation=inflation[name]))
    coefficient = coefficient_terms.coefficient
    points = point_rows(
        coefficient,
        observed,
        before=leaves,
        after={**leaves, **new},
        distance=joined.distance,
        weight=joined.weight,
    )
    count = sum(len(observation.theta) for observation in observed)
    compatibility = compatibility_row(coefficient, count, chi2=joined.chi2, inflation=1.0)
    return Tabulation(new, pd.concat(rows), points=points, compatibility=compatibility)


def _join_in_stages(
    free: Mapping[str, xr.Dataset],
    observed: Sequence[Observation],
    tables: Sequence[_TermRegression],
    increments: Sequence[bool],
) -> _JoinedNodes:
    """Return the nodes after the regression of the base and then of the increments."""
    value = np.concatenate([leaf["value"].values.ravel() for leaf in free.values()])
    joined = _JoinedNodes(
        value=value,
        variance=np.zeros(len(value)),
        factors=np.ones(len(tables)),
        distance=np.zeros(len(observed)),
        weight=np.ones(len(observed)),
    )
    roots: list[np.ndarray] = []
    for fits, members in _order_stages(observed, tables, increments):
        fits_of_stage = [observed[fit] for fit in fits]
        stage = _fit_stage(fits_of_stage, [tables[k] for k in members], joined.value, roots)
        joined.value = joined.value + stage.change
        joined.variance = joined.variance + (stage.root**2).sum(axis=1) + stage.rough**2
        joined.distance[fits], joined.weight[fits] = stage.distance, stage.weight
        joined.factors[members] = stage.factors
        joined.informing |= dict.fromkeys(members, fits_of_stage)
        joined.chi2 += stage.chi2
        roots.append(stage.root)
    return joined


def _order_stages(
    observed: Sequence[Observation],
    tables: Sequence[_TermRegression],
    increments: Sequence[bool],
) -> list[tuple[list[int], list[int]]]:
    """Return the fits and tables of each stage, the base first.

    Without fits of both kinds, one stage determines all tables from all fits.
    """
    of_device = [table for table, is_increment in zip(tables, increments) if is_increment]
    clean, extended = [], []
    for number, observation in enumerate(observed):
        if any(_error_share(observation, table) > _CLEAN for table in of_device):
            extended.append(number)
        else:
            clean.append(number)
    if not clean or not extended:
        return [(clean or extended, list(range(len(tables))))]
    base = np.flatnonzero(~np.array(increments, bool)).tolist()
    return [(clean, base), (extended, np.flatnonzero(increments).tolist())]


def _error_share(observation: Observation, table: _TermRegression) -> float:
    """Return the largest a-priori error of a table in the estimates, in their standard errors."""
    errors = np.linalg.norm(observation.H[:, table.nodes] @ table.F, axis=1)
    return float((errors / np.sqrt(np.diag(observation.C))).max())


def _flown_ranges(observed: Sequence[Observation]) -> dict[str, tuple[float, float]]:
    """Return middle and half the span of the flown incidence and Mach number."""
    ranges = {}
    for name in ("alpha", "mach"):
        samples = [fit.data[name].values for fit in observed if name in fit.data]
        if samples:
            low, high = min(map(np.min, samples)), max(map(np.max, samples))
            ranges[name] = (low + high) / 2.0, max((high - low) / 2.0, _LEAST_HALF_SPAN)
    return ranges


def _make_regression(
    leaf: xr.Dataset,
    nodes: slice,
    sampled: np.ndarray,
    ranges: Mapping[str, tuple[float, float]],
    lengths: Mapping[str, float],
) -> _TermRegression:
    """Return the regression of one term; the a-priori standard error of every parameter is 1."""
    kinds = error_kinds(leaf).T
    size = np.linalg.norm(kinds, axis=1)
    axes = leaf["value"].dims
    grids = np.meshgrid(*(leaf[axis].values for axis in axes), indexing="ij")
    # Incidence and Mach number of each node, -1..1 over the flown range and constant beyond it.
    scaled = {}
    for axis, grid in zip(map(str, axes), grids):
        if axis in ranges:
            middle, half = ranges[axis]
            scaled[axis] = np.clip((grid.ravel() - middle) / half, -1.0, 1.0)
    bends = []
    if "alpha" in scaled:
        # Legendre polynomials of degree 1 and 2: the curve does not change the mean level.
        bends += [scaled["alpha"], scaled["alpha"] ** 2 - 1.0 / 3.0]
    if "mach" in scaled:
        bends.append(scaled["mach"])
    F = np.column_stack([kinds, *(_BEND * size * bend for bend in bends)])
    rough = prior_parts(leaf, sampled, lengths)[PARTS.index("short")]
    return _TermRegression(nodes, F[:, np.abs(F).max(axis=0) > 0], rough)


def _fit_stage(
    observed: Sequence[Observation],
    tables: Sequence[_TermRegression],
    value: np.ndarray,
    earlier_roots: Sequence[np.ndarray],
) -> _Stage:
    """Estimate the change of the nodes in one stage by least squares.

    The errors of the earlier stages are among the common errors.
    """
    H = np.vstack([fit.H for fit in observed])
    D = np.vstack([fit.D for fit in observed])
    parameters = [table.F.shape[1] for table in tables]
    equations = StageEquations(
        y=np.concatenate([fit.theta for fit in observed]) - H @ value,
        A=np.hstack([H[:, table.nodes] @ table.F for table in tables]),
        D=np.hstack([D, *(H @ root for root in earlier_roots)]),
        owner=np.repeat(np.arange(len(tables)), parameters),
        rough=np.stack([H[:, table.nodes] @ table.rough @ H[:, table.nodes].T for table in tables]),
    )
    solution = solve_stage(equations, observed)
    eigenvalues, vectors = np.linalg.eigh(solution.covariance)
    covariance_root = vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
    change, root = np.zeros(len(value)), np.zeros((len(value), len(solution.a)))
    deviations = np.zeros(len(value))
    for k, table in enumerate(tables):
        columns = equations.owner == k
        F = table.F * solution.size[columns]
        change[table.nodes] = F @ solution.a[columns]
        root[table.nodes] = F @ covariance_root[columns]
        rough_stderr = np.sqrt(solution.scatter * np.diag(table.rough))
        deviations[table.nodes] = solution.factors[k] * rough_stderr
    return _Stage(
        change=change,
        root=root,
        rough=deviations,
        weight=solution.weight,
        distance=solution.distance,
        factors=solution.factors,
        chi2=solution.chi2,
    )
