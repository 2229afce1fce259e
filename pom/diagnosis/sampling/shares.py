"""Which term's error makes the spread of a criterion: linear regression of its signed ratio on what
the draws change.

What a draw of a term changes is its contribution along the flight, B dg; its first principal
components over the draws are the regressors of the term, next to the errors of the instruments.
With y = sum b_j x_j + rest, the share of a source is the sum of cov(y, b_j x_j)/var(y) over its
regressors [Li2010]_, which holds for correlated errors too.

.. [Li2010] Li et al., Global Sensitivity Analysis for Systems with Independent and/or Correlated Inputs, J. Phys. Chem. A 114 (2010),
   6022-6032.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
from aerodb.comparison.conditions import fill_missing_devices, select_covered_samples
from aerodb.store.schema import HINGE
from flightmech import terms as _terms

LEAST = 0.01  # of the variance that all terms give a coefficient: components below are left out
COMPONENTS = 3  # of one term
PER_DRAW = 0.25  # regressors for each draw
_SAMPLES = 200  # of a case


def contribution_changes(
    db: xr.DataTree, nodes: Mapping[str, np.ndarray], states: xr.Dataset, hinges: bool
) -> dict[str, np.ndarray]:
    """Return what the draws of every term change in its contribution along a flight.

    Parameters
    ----------
    db : DataTree
    nodes : mapping of str to array (draw, *axes)
        Drawn values by term.
    states : Dataset (time,)
        The flight. [SI]
    hinges : bool
        Whether the case feels hinge moments.

    Returns
    -------
    dict of str to array (draw, samples)
    """
    names = [name for name in nodes if hinges or name.split("/")[0] not in HINGE]
    leaves = {name: leaf for name, leaf in aerodb.terms(db).items() if name in names}
    samples = flown_conditions(db, leaves, states) if leaves else {}
    found = {}
    for name, leaf in leaves.items():
        dg = (nodes[name] - leaf["value"].values).reshape(len(nodes[name]), -1)
        found[name] = (_terms.basis(leaf, samples, "clamp") @ dg.T).T
    return found


def flown_conditions(
    db: xr.DataTree, leaves: Mapping[str, xr.Dataset], states: xr.Dataset
) -> dict[str, np.ndarray]:
    """Return the variables of terms along a flight at about 200 of its samples. [SI]"""
    every = max(1, states.sizes["time"] // _SAMPLES)
    whole, _ = fill_missing_devices(_with_rates(states, db).isel(time=slice(None, None, every)), db)
    return select_covered_samples(whole, leaves.values())[0]


def _with_rates(states: xr.Dataset, db: xr.DataTree) -> xr.Dataset:
    """Return states with the reduced rates and the thrust coefficient that they lack, by the
    reference lengths of the database.
    """
    half, time = 1.0 / (2.0 * np.maximum(states["V"].values, 1.0)), states["time"].values
    lengths = {"p": "b", "q": "cbar", "r": "b", "alpha_dot": "cbar", "beta_dot": "b"}
    rates = {name: states[name].values for name in lengths if name in states}
    rates |= {
        f"{name}_dot": np.gradient(states[name].values, time)
        for name in ("alpha", "beta")
        if f"{name}_dot" not in states
    }
    reduced = {
        f"{name.replace('_', '')}hat": rate * float(db.attrs[lengths[name]]) * half
        for name, rate in rates.items()
    }
    engines = [str(name) for name in states if re.fullmatch(r"engine\d+\.thrust", str(name))]
    if engines and "qbar" in states:
        thrust = sum(states[name].values for name in engines)
        reduced["CT"] = thrust / (np.maximum(states["qbar"].values, 1.0) * float(db.attrs["S"]))
    return states.assign(
        {name: ("time", rate) for name, rate in reduced.items() if name not in states}
    )


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
    total: dict[str, float] = {}
    centred = {name: change - change.mean(axis=0) for name, change in changes.items()}
    for name, change in centred.items():
        coefficient = name.split("/")[0]
        total[coefficient] = total.get(coefficient, 0.0) + float(np.sum(change**2))
    found: list[tuple[float, str, np.ndarray]] = []
    for name, change in centred.items():
        whole = total[name.split("/")[0]]
        if not np.sum(change**2) > LEAST * whole:
            continue
        vectors, values, _ = np.linalg.svd(change, full_matrices=False)
        parts = [
            (float(value**2) / whole, name, vector)
            for value, vector in zip(values, vectors.T, strict=True)
        ]
        found += [part for part in parts[:COMPONENTS] if part[0] > LEAST]
    most = int(PER_DRAW * len(next(iter((*changes.values(), *errors.values())), ())))
    chosen = [(name, x) for _, name, x in sorted(found, key=lambda item: -item[0])[:most]]
    chosen += [(name, x) for name, x in errors.items()][: most - len(chosen)]
    return [(name, (x - x.mean()) / x.std()) for name, x in chosen if x.std() > 0.0]


def variance_shares(
    signed: Mapping[str, np.ndarray], found: list[tuple[str, np.ndarray]]
) -> pd.DataFrame:
    """Return the shares of the sources in the variance of every criterion: ``criterion source
    share``, the largest first.

    Parameters
    ----------
    signed : mapping of str to array (draw,)
        Signed ratio by criterion; draws that are not finite are left out.
    found : list of (str, array (draw,))
        Of `regressors_of_draws`.
    """
    rows = []
    for criterion, values in signed.items():
        good = np.isfinite(values)
        if not found or good.sum() < len(found) + 2 or not np.ptp(values[good]) > 1e-9:
            continue
        y = values[good] - values[good].mean()
        X = np.stack([x[good] for _, x in found], axis=1)
        X = X - X.mean(axis=0)
        # a regressor counts one draw against it: two that are all but the same share what they make
        b = np.linalg.solve(X.T @ X + np.eye(X.shape[1]), X.T @ y)
        parts = (
            pd.Series((X * b).T @ y / (y @ y), index=[name for name, _ in found])
            .groupby(level=0, sort=False)
            .sum()
        )
        rows += [
            (criterion, source, float(share))
            for source, share in parts.sort_values(ascending=False, kind="stable").items()
        ]
    return pd.DataFrame(rows, columns=["criterion", "source", "share"])
