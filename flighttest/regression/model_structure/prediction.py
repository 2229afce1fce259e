"""Prediction of left-out manoeuvres by a set of terms, with coloured residuals.

The residual of all candidates shows the disturbance. Its autoregression whitens coefficient and
candidates, so that the rows are nearly independent. A model is rated by the probability density
that it gives to the manoeuvres that its estimation did not use [Geisser1979]_. One manoeuvre is cut
into blocks.

With rows z of unit variance and a normal prior of the precision P, far below that of one row, the
density under a model with regressors X is, but for a constant,

    ln m(z) = 1/2 z'X (X'X + P)^-1 X'z - 1/2 ln |X'X + P|

and that of a left-out part is ln m(all) - ln m(all but the part). Sums of products of all parts are
formed once; a model then costs small factorisations only. The level of the disturbance comes from
its spectrum, not from the rows: the band that a low-pass has emptied would make it too small.

References
----------
.. [Geisser1979] Geisser, Eddy, A predictive approach to model selection, J. American Statistical
   Association 74, 1979.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flighttest.regression.model_structure.candidates import CandidateEquations
from flighttest.regression.uncertainty.coloured_residuals import whiten_pieces

PARTS = 8  # parts that are left out in turn, at least, also of few manoeuvres
MOST_PARTS = 24  # manoeuvres beyond this number are left out in groups
_PRIOR = 1e-3  # weight of the prior of a parameter, in rows
# standard deviation of the disturbance, of that of the coefficient, below which it is rounding
_LEAST_NOISE = 1e-5


class WhitenedRows(NamedTuple):
    """Rows with nearly independent errors of unit variance, and the part of each.

    Attributes
    ----------
    X : array (rows, terms)
    z : array (rows,)
    part : array of int (rows,)
    """

    X: np.ndarray
    z: np.ndarray
    part: np.ndarray


def whiten_rows(problem: CandidateEquations, pool: Sequence[int]) -> WhitenedRows:
    """Return coefficient and candidates of a pool without the colour of the disturbance.

    Parameters
    ----------
    problem : CandidateEquations
    pool : sequence of int
        Candidates whose residual shows the disturbance.

    Notes
    -----
    In a frequency band the rows count as independent already. Their parts are bands of frequencies.
    """
    X, z = problem.X[list(pool)].T, problem.z
    v = z - X @ np.linalg.lstsq(X, z, rcond=None)[0]
    least = _LEAST_NOISE * float(np.std(z))
    if problem.band is not None:
        sigma = max(least, float(np.linalg.norm(v)) / np.sqrt(max(1, problem.rows - len(pool))))
        half = max(1, len(z) // 2)  # real parts above imaginary parts
        place = np.arange(len(z)) % half
        return WhitenedRows(X / sigma, z / sigma, np.minimum(PARTS - 1, place * PARTS // half))
    pieces, steps = problem.samples.pieces()
    rows = whiten_pieces(X, v, np.column_stack([X, z]), pieces=pieces, steps=steps, least=least)
    manoeuvre = problem.samples.data["manoeuvre"].values
    owner = np.concatenate(
        [np.full(len(part), manoeuvre[piece.start]) for part, piece in zip(rows, pieces)]
    )
    white = np.concatenate(rows)
    return WhitenedRows(white[:, :-1], white[:, -1], _divide_rows(owner))


def _divide_rows(owner: np.ndarray) -> np.ndarray:
    """Return the part of each row: its manoeuvre, a group of them, or a block of a manoeuvre."""
    numbers, order = np.unique(owner, return_inverse=True)
    count = len(numbers)
    if count >= PARTS:
        return order * min(count, MOST_PARTS) // count
    blocks = -(-PARTS // count)
    part = np.empty(len(owner), int)
    for k in range(count):
        mine = np.flatnonzero(order == k)
        part[mine] = k * blocks + np.arange(len(mine)) * blocks // len(mine)
    return part


class HeldOutPrediction:
    """Logarithms of the densities of left-out parts, of any model of the pool.

    Parameters
    ----------
    rows : WhitenedRows

    Attributes
    ----------
    parts : int
    rows : int
    """

    def __init__(self, rows: WhitenedRows):
        numbers = np.unique(rows.part)
        self.parts, self.rows = len(numbers), len(rows.z)
        size = np.sqrt((rows.X**2).mean(axis=0))
        X = rows.X / np.where(size > 0.0, size, 1.0)
        G, b = [], []
        for number in numbers:
            mine = rows.part == number
            G.append(X[mine].T @ X[mine])
            b.append(X[mine].T @ rows.z[mine])
        # Sums over all parts first, then without each part in turn.
        self._G = _without_each(np.array(G))
        self._G += _PRIOR * np.eye(X.shape[1])
        self._b = _without_each(np.array(b))
        self._known: dict[tuple[int, ...], np.ndarray] = {}

    def densities(self, model: Sequence[int]) -> np.ndarray:
        """Return the logarithm of the density of each left-out part, (parts,)."""
        key = tuple(sorted(model))
        if key not in self._known:
            chosen = np.array(key, int)
            L = np.linalg.cholesky(self._G[:, chosen[:, None], chosen])
            y = np.linalg.solve(L, self._b[:, chosen, None])[:, :, 0]
            half_log_det = np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
            log_m = 0.5 * (y**2).sum(axis=1) - half_log_det
            self._known[key] = log_m[0] - log_m[1:]
        return self._known[key]

    @property
    def rated(self) -> int:
        """Number of models that were rated."""
        return len(self._known)


def _without_each(parts: np.ndarray) -> np.ndarray:
    """Return the sum over parts, then the sums without each part, (1 + parts, ...)."""
    total = parts.sum(axis=0)
    return np.concatenate([total[None], total[None] - parts])
