"""Shares of the error sources in the spread of a criterion, by linear regression over the draws.

The signed ratio of a criterion is regressed on the changes by the draws. A drawn term changes its
contribution along the flight by B dg. The first principal components of this change over the draws
are the regressors of the term. The errors of the instruments are further regressors. With
y = sum b_j x_j + residual, the share of a source is the sum of cov(y, b_j x_j)/var(y) over its
regressors [Li2010]_, which holds for correlated errors too.

.. [Li2010] Li et al., Global Sensitivity Analysis for Systems with Independent and/or Correlated
   Inputs, J. Phys. Chem. A 114 (2010), 6022-6032.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
from aerodb.comparison.conditions import select_covered_samples
from aerodb.comparison.record_conditions import fill_missing_devices
from aerodb.store.schema import HINGE
from flightmech import terms as _terms
from flightmech.aircraft.aircraft import Aircraft
from flighttest.reconstruction.dynamics.propeller_loads import with_engine_channels

LEAST = 0.01  # of the variance of a coefficient by all terms: smaller components are left out
COMPONENTS = 3  # of one term
PER_DRAW = 0.25  # regressors for each draw
_SAMPLES = 200  # of a case
_LEAST_SPREAD = 1e-9  # range of a ratio over the draws; smaller ones are rounding errors
_LENGTHS = {"p": "b", "q": "cbar", "r": "b", "alpha_dot": "cbar", "beta_dot": "b"}


def contribution_changes(
    db: xr.DataTree,
    nodes: Mapping[str, np.ndarray],
    states: xr.Dataset,
    hinges: bool,
    aircraft: Aircraft | None = None,
) -> dict[str, np.ndarray]:
    """Return the change of the contribution of every term along a flight, by the draws.

    Parameters
    ----------
    db : DataTree
    nodes : mapping of str to array (draw, *axes)
        Drawn values by term.
    states : Dataset (time,)
        The flight. [SI]
    hinges : bool
        Whether hinge moments matter in the case.
    aircraft : Aircraft or None
        For the thrust of propellers that the record lacks.

    Returns
    -------
    dict of str to array (draw, samples)
    """
    leaves = {}
    for name, leaf in aerodb.terms(db).items():
        if name in nodes and (hinges or name.split("/")[0] not in HINGE):
            leaves[name] = leaf
    if not leaves:
        return {}
    samples = flown_conditions(db, leaves, states, aircraft)
    changes = {}
    for name, leaf in leaves.items():
        # The change of the contribution is B dg, with the interpolation weights B of the nodes.
        dg = (nodes[name] - leaf["value"].values).reshape(len(nodes[name]), -1)
        changes[name] = (_terms.basis(leaf, samples, "clamp") @ dg.T).T
    return changes


def flown_conditions(
    db: xr.DataTree,
    leaves: Mapping[str, xr.Dataset],
    states: xr.Dataset,
    aircraft: Aircraft | None = None,
) -> dict[str, np.ndarray]:
    """Return the variables of terms along a flight, at about 200 of its samples. [SI]

    The propellers of `aircraft` give what terms of the slipstream need from a record without
    thrust.
    """
    if aircraft is not None:
        states = with_engine_channels(states, aircraft)
    every = max(1, states.sizes["time"] // _SAMPLES)
    selected = _add_reduced_rates(states, db).isel(time=slice(None, None, every))
    complete, _ = fill_missing_devices(selected, db)
    return select_covered_samples(complete, leaves.values())[0]


def _add_reduced_rates(states: xr.Dataset, db: xr.DataTree) -> xr.Dataset:
    """Return states with reduced rates, by lengths of the database."""
    half, time = 1.0 / (2.0 * np.maximum(states["V"].values, 1.0)), states["time"].values
    rates = {name: states[name].values for name in _LENGTHS if name in states}
    for name in ("alpha", "beta"):
        if f"{name}_dot" not in states:
            rates[f"{name}_dot"] = np.gradient(states[name].values, time)
    # Reduced rate: rate * length / (2 V).
    reduced = {}
    for name, rate in rates.items():
        length = float(db.attrs[_LENGTHS[name]])
        reduced[f"{name.replace('_', '')}hat"] = rate * length * half
    # Reduced rates of the record have priority.
    new = {}
    for name, rate in reduced.items():
        if name not in states:
            new[name] = ("time", rate)
    return states.assign(new)


def regressors_of_draws(
    changes: Mapping[str, np.ndarray], errors: Mapping[str, np.ndarray]
) -> list[tuple[str, np.ndarray]]:
    """Return the regressors of the draws: (source, array (draw,)), each with mean 0 and variance 1.

    Parameters
    ----------
    changes : mapping of str to array (draw, samples)
        Of `contribution_changes`.
    errors : mapping of str to array (draw,)
        Errors of the instruments by name.
    """
    # Components of all terms, the largest shares of the variance of a coefficient first.
    components = sorted(_principal_components(changes), key=lambda item: -item[0])
    draws = len(next(iter((*changes.values(), *errors.values())), ()))
    most = int(PER_DRAW * draws)
    sources: list[tuple[str, np.ndarray]] = []
    for _, name, vector in components[:most]:
        sources.append((name, vector))
    sources += list(errors.items())[: most - len(sources)]
    regressors = []
    for name, values in sources:
        if values.std() > 0.0:
            regressors.append((name, (values - values.mean()) / values.std()))
    return regressors


def _principal_components(
    changes: Mapping[str, np.ndarray],
) -> list[tuple[float, str, np.ndarray]]:
    """Return share of the variance of the coefficient, term, and component (draw,)."""
    centred = {name: change - change.mean(axis=0) for name, change in changes.items()}
    total: dict[str, float] = {}
    for name, change in centred.items():
        coefficient = name.split("/")[0]
        total[coefficient] = total.get(coefficient, 0.0) + float(np.sum(change**2))
    components = []
    for name, change in centred.items():
        variance = total[name.split("/")[0]]
        if not np.sum(change**2) > LEAST * variance:
            continue
        vectors, values, _ = np.linalg.svd(change, full_matrices=False)
        # Singular values are in falling order.
        for value, vector in zip(values[:COMPONENTS], vectors.T[:COMPONENTS], strict=True):
            share = float(value**2) / variance
            if share > LEAST:
                components.append((share, name, vector))
    return components


def variance_shares(
    signed: Mapping[str, np.ndarray], found: list[tuple[str, np.ndarray]]
) -> pd.DataFrame:
    """Return the shares of the sources in the variance of every criterion.

    Parameters
    ----------
    signed : mapping of str to array (draw,)
        Signed ratio by criterion; draws that are not finite are left out.
    found : list of (str, array (draw,))
        Of `regressors_of_draws`.

    Returns
    -------
    DataFrame
        Columns ``criterion source share``, for each criterion the largest share first.
    """
    rows: list[tuple[str, object, float]] = []
    sources = [name for name, _ in found]
    for criterion, values in signed.items():
        finite = np.isfinite(values)
        if not found or finite.sum() < len(found) + 2:
            continue
        if not np.ptp(values[finite]) > _LEAST_SPREAD:
            continue
        y = values[finite] - values[finite].mean()
        X = np.stack([x[finite] for _, x in found], axis=1)
        X = X - X.mean(axis=0)
        # Ridge regression: the penalty of a regressor is that of one draw. Two regressors that are
        # almost equal then share their effect.
        b = np.linalg.solve(X.T @ X + np.eye(X.shape[1]), X.T @ y)
        parts = pd.Series((X * b).T @ y / (y @ y), index=sources)
        by_source = parts.groupby(level=0, sort=False).sum()
        by_source = by_source.sort_values(ascending=False, kind="stable")
        for source, share in by_source.items():
            rows.append((criterion, source, float(share)))
    return pd.DataFrame(rows, columns=["criterion", "source", "share"])
