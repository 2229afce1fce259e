"""Equations of one stage of the classical join, solved by iterated weights of the fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from aerodb.update.observations import Observation
from aerodb.update.weights.weight_learning import SCATTER, estimate_mixed, estimate_scatter

_HUBER = 2.5  # distance of a fit, in its standard errors, from which on it loses weight
_ROUNDS = 16  # of factors and weights; the scatter is estimated in the second half


@dataclass(frozen=True)
class StageEquations:
    """Linear equations of one stage, y = A (factors a) + H r + D s + e.

    Parameters of all tables stand side by side; column j of A belongs to the table owner[j].
    """

    y: np.ndarray  # (estimates,): estimates less their expectation with the values before
    A: np.ndarray  # (estimates, parameters)
    D: np.ndarray  # (estimates, common errors)
    owner: np.ndarray  # (parameters,)
    rough: np.ndarray  # (tables, estimates, estimates): a-priori covariance H r r' H'


@dataclass(frozen=True)
class StageSolution:
    """Solution of the equations of one stage; arrays by parameter, estimate, fit or table."""

    a: np.ndarray
    covariance: np.ndarray  # of a
    size: np.ndarray  # (parameters,): factor on the a-priori error of the table of each
    factors: np.ndarray
    scatter: float
    weight: np.ndarray
    distance: np.ndarray
    chi2: float


def solve_stage(equations: StageEquations, observed: Sequence[Observation]) -> StageSolution:
    """Return the parameters of a stage after iterating factors, scatter and weights of the fits."""
    y, A, D, owner = equations.y, equations.A, equations.D, equations.owner
    ends = np.cumsum([0, *(len(fit.theta) for fit in observed)]).tolist()
    rows_of_fits = [slice(first, end) for first, end in pairwise(ends)]
    factors, weight = np.ones(len(equations.rough)), np.ones(len(observed))
    scatter = SCATTER[0]
    for turn in range(_ROUNDS):
        measured = [fit.C / w for fit, w in zip(observed, weight)]
        common = [D[rows] @ D[rows].T / w for rows, w in zip(rows_of_fits, weight)]
        noise, own_errors = scipy.linalg.block_diag(*measured), scipy.linalg.block_diag(*common)
        deviation = np.einsum("k,kij->ij", factors**2, equations.rough)
        size = factors[owner]
        # In the first half the factors converge.  A misfit that a larger a-priori error explains is
        # not scatter.
        if 2 * turn >= _ROUNDS:
            without_scatter = (A * size) @ (A * size).T + noise + own_errors
            scatter = estimate_scatter(y, without_scatter, deviation)
        S = noise + own_errors + scatter * deviation
        M, gain = estimate_mixed(A * size, S)
        a = gain @ y
        distance = _rms_by_fit(y - A @ (size * a), S, rows_of_fits)
        weight = np.minimum(1.0, (_HUBER / np.maximum(distance, 1e-12)) ** 2)
        factors = _inflate_priors(a, M, size, owner, tables=len(factors))
    # Prior (M M), noise and scatter through the gain, and the common errors if all fits share them.
    covariance = M @ M + gain @ (noise + scatter * deviation) @ gain.T + (gain @ D) @ (gain @ D).T
    without_scatter = (A * size) @ (A * size).T + noise + own_errors
    return StageSolution(
        a=a,
        covariance=covariance,
        size=size,
        factors=factors,
        scatter=scatter,
        weight=weight,
        distance=distance,
        chi2=float(y @ np.linalg.solve(without_scatter, y)),
    )


def _inflate_priors(
    a: np.ndarray, M: np.ndarray, size: np.ndarray, owner: np.ndarray, tables: int
) -> np.ndarray:
    """Return the factor on the a-priori error of each table, 1 or more, (tables,)."""
    # Expected square of each parameter: the square of its estimate, and its variance.
    power = (size * a) ** 2 + size**2 * np.diag(M)
    factors = np.ones(tables)
    for k in range(tables):
        # `max` and not `np.maximum`: the mean of a table without parameters is NaN, its factor 1.
        factors[k] = max(1.0, np.sqrt(power[owner == k].mean()))
    return factors


def _rms_by_fit(v: np.ndarray, S: np.ndarray, rows_of_fits: Sequence[slice]) -> np.ndarray:
    """Return the rms residual of each fit in its standard errors, (fits,)."""
    chi2 = [v[rows] @ np.linalg.solve(S[rows, rows], v[rows]) for rows in rows_of_fits]
    return np.sqrt(np.array(chi2) / [len(v[rows]) for rows in rows_of_fits])
