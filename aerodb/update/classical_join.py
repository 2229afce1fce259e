"""Local submodels joined into tables by regression over incidence and Mach number, configuration by
configuration (LR-743 eq. (12)).

Every test point gave a submodel, C = C0 + C_alpha alpha + C_alpha2 alpha^2 + C_q q c/V + C_delta
delta, whose estimates theta expect H g of the nodes g of the tables (`aerodb.update.tabulation`).
The tables are corrected by few parameters,

    g = g0 + F a + r

with F both kinds of the a-priori error of a term (`aerodb.update.correlation.error_kinds`), that
times incidence and its square, and that times Mach number: a regression over the test points.
Coefficients are those about the moment reference, whatever the centre of gravity of the record was,
so that it is no variable of the regression.  What scatters about it beyond the errors of the
submodels is r, a deviation of the tables in proportion to their a-priori errors, whose size makes
chi-squared of the submodels what it should be [Paule1982].

The clean configuration is the base: the fits that no increment touches determine the terms without
device.  What they expect is subtracted from the other fits, which determine the increments of
flaps, gear, speed brake and ground; the errors of the base count among theirs.

Parameters are estimated by least squares with the covariance of each submodel and with the a-priori
errors of the tables (mixed estimation [Theil1961]): what no test point determines stays with the
handbook.  A term whose correction is larger than its a-priori error allows gets a larger one.
Errors common to all fits are considered.  Beyond the flown range of incidence and Mach number a
table is displaced by the correction at the edge, and its standard error goes back to that of the
handbook, times the same factor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.linalg import block_diag

from aerodb.update.cautions.unplaced_terms import demand_places, unplaced_terms
from aerodb.update.correlation import LENGTHS, PARTS, error_kinds, flown_distance, prior_parts
from aerodb.update.observations import CoefficientTerms, Observation, observe_fits
from aerodb.update.tabulation import (
    FLOWN,
    Tabulation,
    add_cautions,
    compatibility_row,
    contributing_fits,
    merge_tabulations,
    new_leaf,
    point_rows,
    slices_of,
    term_row,
)
from aerodb.update.term_decisions import add_decisions
from flightmech import terms as _terms
from flightmech.errors import IdentificationError

DEVICES = ("delta_f", "gear", "speedbrake", "h_agl")
"""Variables whose terms are increments on the clean configuration."""

_HISTORY = "join_submodels: joined with {} fits"
# a-priori error of the increments over the standard error of an estimate, below which a fit counts
# as clean
_UNTOUCHED = 0.3
_FADE = 2.0  # of the correlation with the flown region, per correlation length
_BEND = (
    0.5  # a-priori size of the parameters of incidence and Mach number, against one of the level
)
_HUBER = 2.5
_ROUNDS = 16  # of factors and weights; scatter in the second half
_SCATTER = (
    0.003,
    4.0,
)  # least and largest variance of r over that of the tables a priori: no aeroplane has curves of few parameters


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
        As that of `tabulate`; the parts of a prior covariance are not learnt (``level reach long
        short`` of ``report`` are NaN), ``prior_inflation`` is the factor on the a-priori errors of
        the term, ``inflation`` of ``compatibility`` is 1, and ``chi2`` is that of the submodels
        without the scatter r.  The joint covariance of the nodes is not kept.

    Raises
    ------
    SchemaError, UnknownName, IdentificationError
        As in `tabulate`.

    Warns
    -----
    AeromatchWarning
        As in `tabulate`.  The chi-squared of the join also counts what curves of few parameters
        leave.

    References
    ----------
    .. [LR743] Delft University of Technology, report LR-743, eq. (12) and section 4.5.
    .. [Theil1961] Theil, Goldberger, On pure and mixed statistical estimation in economics, International Economic Review 2, 1961.
    .. [Paule1982] Paule, Mandel, Consensus values and weighting factors, J. Research of the National Bureau of Standards 87, 1982.
    """
    if not fits:
        raise IdentificationError("no fit; join_submodels needs at least one")
    lengths = {**LENGTHS, **(lengths or {})}
    lost = unplaced_terms(fits, prior, held)
    notices = demand_places(lost, unplaced)
    found = merge_tabulations(
        [_one(known, observed, lengths) for known, observed in observe_fits(fits, prior, held)]
    )
    return add_cautions(found, lost, notices)


@dataclass(frozen=True)
class _JoinedTerm:
    """One term in a regression: its nodes among all, its parameters, its deviation r and its factor
    on the a-priori error.
    """

    nodes: slice
    F: np.ndarray  # (nodes, parameters)
    rough: np.ndarray  # (nodes, nodes): a-priori covariance of r


@dataclass(frozen=True)
class _Stage:
    """What one regression found; arrays by node of all terms, by fit, by table."""

    change: np.ndarray
    root: np.ndarray  # (nodes, parameters): factor of the covariance of F a
    rough: np.ndarray  # (nodes,): standard error of r
    weight: np.ndarray
    distance: np.ndarray
    factors: np.ndarray
    chi2: float


def _one(
    known: CoefficientTerms, observed: Sequence[Observation], lengths: Mapping[str, float]
) -> Tabulation:
    free, slices = known.free, slices_of(known.free.values())
    sampled = np.max([o.sampled for o in observed], axis=0)
    touched = np.any([np.abs(o.H).max(axis=0) > 0 for o in observed], axis=0)
    seen, ranges = sampled * touched, _ranges(observed)
    tables = [
        _table(leaf, at, seen[at], ranges, lengths) for leaf, at in zip(free.values(), slices)
    ]
    increments = [
        bool(set(_terms.list_model_variables(leaf)) & set(DEVICES)) for leaf in free.values()
    ]
    value = np.concatenate([leaf["value"].values.ravel() for leaf in free.values()])
    stages: list[_Stage] = []
    behind: dict[int, list[Observation]] = {}
    variance, factors = np.zeros(len(value)), np.ones(len(tables))
    distance, weight = np.zeros(len(observed)), np.ones(len(observed))
    for fits, members in _order(observed, tables, increments):
        found = _regression(
            [observed[k] for k in fits],
            [tables[k] for k in members],
            value,
            [stage.root for stage in stages],
        )
        value, variance = (
            value + found.change,
            variance + (found.root**2).sum(axis=1) + found.rough**2,
        )
        distance[fits], weight[fits], factors[members] = found.distance, found.weight, found.factors
        behind |= {k: [observed[fit] for fit in fits] for k in members}
        stages.append(found)
    new, places = {}, {}
    for k, ((name, leaf), at, factor) in enumerate(zip(free.items(), slices, factors)):
        if touched[at].any():
            away = flown_distance(leaf, seen[at], lengths)
            sd = np.sqrt(
                variance[at]
                + (factor * leaf["stderr"].values.ravel()) ** 2 * (1.0 - np.exp(-_FADE * away))
            )
            flown = ((sampled >= FLOWN) & touched)[at]
            new[name] = new_leaf(
                leaf, value[at], sd, flown, contributing_fits(behind.get(k, []), at), _HISTORY
            )
            places[name] = flown.reshape(leaf["value"].shape)
    new = add_decisions(known.leaves, new, places)
    inflated = dict(zip(free, factors))
    unlearnt = np.full(len(PARTS), np.nan)
    rows = [
        term_row(name, free[name], leaf, unlearnt).assign(prior_inflation=inflated[name])
        for name, leaf in new.items()
    ]
    points = point_rows(
        known.coefficient, observed, known.leaves, {**known.leaves, **new}, distance, weight
    )
    count, chi2 = sum(len(o.theta) for o in observed), sum(stage.chi2 for stage in stages)
    return Tabulation(
        new, pd.concat(rows), points, compatibility_row(known.coefficient, count, chi2, 1.0)
    )


def _order(
    observed: Sequence[Observation], tables: Sequence[_JoinedTerm], increments: Sequence[bool]
) -> list[tuple[list[int], list[int]]]:
    """Return which fits determine which tables, base first; without a fit of the clean
    configuration all determine all.
    """
    of_device = [table for table, increment in zip(tables, increments) if increment]
    touched = [
        max((_share(o, table) for table in of_device), default=0.0) > _UNTOUCHED for o in observed
    ]
    clean, other = (
        [k for k, one in enumerate(touched) if not one],
        [k for k, one in enumerate(touched) if one],
    )
    if not clean or not other:
        return [(clean or other, list(range(len(tables))))]
    return [
        (clean, [k for k, one in enumerate(increments) if not one]),
        (other, [k for k, one in enumerate(increments) if one]),
    ]


def _share(o: Observation, table: _JoinedTerm) -> float:
    """Return the a-priori error of a table in the estimates of a fit over their standard errors,
    the largest.
    """
    return float(
        (np.linalg.norm(o.H[:, table.nodes] @ table.F, axis=1) / np.sqrt(np.diag(o.C))).max()
    )


def _ranges(observed: Sequence[Observation]) -> dict[str, tuple[float, float]]:
    """Return middle and half the span of the flown incidence and Mach number."""
    found = {}
    for name in ("alpha", "mach"):
        flown = [o.data[name].values for o in observed if name in o.data]
        if flown:
            low, high = min(x.min() for x in flown), max(x.max() for x in flown)
            found[name] = (low + high) / 2.0, max((high - low) / 2.0, 1e-6)
    return found


def _table(
    leaf: xr.Dataset,
    nodes: slice,
    sampled: np.ndarray,
    ranges: Mapping[str, tuple[float, float]],
    lengths: Mapping[str, float],
) -> _JoinedTerm:
    """Return the regression of one term: parameters of one standard error a priori each."""
    kinds = error_kinds(leaf).T
    size = np.linalg.norm(kinds, axis=1)
    grids = np.meshgrid(*(leaf[axis].values for axis in leaf["value"].dims), indexing="ij")
    place = {str(axis): grid.ravel() for axis, grid in zip(leaf["value"].dims, grids)}
    x = {
        name: np.clip((place[name] - middle) / half, -1.0, 1.0)
        for name, (middle, half) in ranges.items()
        if name in place
    }
    bends = [x["alpha"], x["alpha"] ** 2 - 1.0 / 3.0] if "alpha" in x else []
    bends += [x["mach"]] if "mach" in x else []
    F = np.column_stack([kinds, *(_BEND * size * bend for bend in bends)])
    return _JoinedTerm(
        nodes,
        F[:, np.abs(F).max(axis=0) > 0],
        prior_parts(leaf, sampled, lengths)[PARTS.index("short")],
    )


def _regression(
    observed: Sequence[Observation],
    tables: Sequence[_JoinedTerm],
    value: np.ndarray,
    before: Sequence[np.ndarray],
) -> _Stage:
    """Least squares of the parameters of one stage; the errors of the stages before are among the
    common ones.
    """

    H = np.vstack([o.H for o in observed])
    y = np.concatenate([o.theta for o in observed]) - H @ value
    D = np.hstack([np.vstack([o.D for o in observed]), *(H @ root for root in before)])
    parts = [
        slice(a, b) for a, b in pairwise(np.cumsum([0, *(len(o.theta) for o in observed)]).tolist())
    ]
    owner = np.repeat(np.arange(len(tables)), [table.F.shape[1] for table in tables])
    A = np.hstack([H[:, table.nodes] @ table.F for table in tables])
    rough = np.stack([H[:, table.nodes] @ table.rough @ H[:, table.nodes].T for table in tables])
    factors, weight, scatter = np.ones(len(tables)), np.ones(len(observed)), _SCATTER[0]
    for turn in range(_ROUNDS):
        noise = block_diag(*(o.C / w for o, w in zip(observed, weight)))
        own = block_diag(*(D[part] @ D[part].T / w for part, w in zip(parts, weight)))
        deviation = np.einsum("k,kij->ij", factors**2, rough)
        size = factors[owner]
        if 2 * turn >= _ROUNDS:  # what a larger a-priori error explains is no scatter
            scatter = _scatter(y, (A * size) @ (A * size).T + noise + own, deviation)
        S = noise + own + scatter * deviation
        M, gain = _mixed(A * size, S)
        a = gain @ y
        v = y - A @ (size * a)
        distance = np.array(
            [
                np.sqrt(v[part] @ np.linalg.solve(S[part, part], v[part]) / len(v[part]))
                for part in parts
            ]
        )
        weight = np.minimum(1.0, (_HUBER / np.maximum(distance, 1e-12)) ** 2)
        power = (size * a) ** 2 + size**2 * np.diag(M)
        factors = np.array(
            [max(1.0, np.sqrt(power[owner == k].mean())) for k in range(len(tables))]
        )
    covariance = M @ M + gain @ (noise + scatter * deviation) @ gain.T + (gain @ D) @ (gain @ D).T
    own_values, shape = np.linalg.eigh(covariance)
    loose = shape * np.sqrt(np.maximum(own_values, 0.0))
    change, root, deviations = (
        np.zeros(len(value)),
        np.zeros((len(value), len(a))),
        np.zeros(len(value)),
    )
    for k, table in enumerate(tables):
        F = table.F * size[owner == k]
        change[table.nodes], root[table.nodes] = F @ a[owner == k], F @ loose[owner == k]
        deviations[table.nodes] = factors[k] * np.sqrt(scatter * np.diag(table.rough))
    plain = (A * size) @ (A * size).T + noise + own
    return _Stage(
        change, root, deviations, weight, distance, factors, float(y @ np.linalg.solve(plain, y))
    )


def _mixed(A: np.ndarray, S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (A'S^-1 A + I)^-1 and that times A'S^-1."""
    scale = np.sqrt(np.diag(S))
    L = np.linalg.cholesky(S / np.outer(scale, scale))
    white = np.linalg.solve(L, A / scale[:, None])
    M = np.linalg.inv(white.T @ white + np.eye(A.shape[1]))
    return M, M @ (np.linalg.solve(L.T, white) / scale[:, None]).T


def _scatter(y: np.ndarray, S: np.ndarray, deviation: np.ndarray) -> float:
    """Return the variance of the deviations with which chi-squared is the number of estimates, by
    bisection of its logarithm.
    """
    low, high = np.log(_SCATTER)
    for _ in range(40):
        middle = (low + high) / 2.0
        chi2 = y @ np.linalg.solve(S + np.exp(middle) * deviation, y)
        low, high = (middle, high) if chi2 > len(y) else (low, middle)
    return float(np.exp(low))
