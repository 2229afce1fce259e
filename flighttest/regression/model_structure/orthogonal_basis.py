"""x."""

from __future__ import annotations
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement
import numpy as np
import xarray as xr
from flightmech.errors import IdentificationError, ParseError
from flightmech.names import lookup
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.frequency_domain import WEIGHTS
from flighttest.regression.equation_error.model import (
    term_powers,
    term_regressors,
    term_text,
    variable_of,
)
from flighttest.regression.equation_error.samples import stack_samples
from flighttest.regression.equation_error.spectral_weights import whitening_weights
from flighttest.regression.equation_error.time_domain import demand_choice
from flighttest.regression.equation_error.transformed_stretches import (
    select_stretches,
    stack_complex,
    transform_columns,
)


_TIE = 1e-9


LEAST = 1e-4  # of a candidate's size that must be left for it to be taken


class OrthogonalBasis:
    """State of a forward selection.

    Parameters
    ----------
    X : array (candidates, rows)
    z : array (rows,)
    """

    def __init__(self, X: np.ndarray, z: np.ndarray):
        self.X, self.z = X, z
        self.size2 = np.einsum("ij,ij->i", X, X)
        self.start(())

    def start(self, taken: Sequence[int]) -> None:
        """Begin anew with given candidates."""
        self.taken: list[int] = []
        self.Q = np.empty((8, len(self.z)))
        self.R: list[np.ndarray] = []
        self.a: list[float] = []
        self.left2 = self.size2.copy()
        self.residual = self.z.copy()
        self.product = self.X @ self.z
        for j in taken:
            self.take(j)

    @property
    def rss(self) -> float:
        """Sum of the squares of the residual."""
        return float(self.residual @ self.residual)

    def gains(self) -> np.ndarray:
        """Return by how much each candidate would lower the sum of squares, (candidates,); zero for
        those it cannot be computed for.
        """
        usable = self.left2 > LEAST**2 * self.size2
        usable[self.taken] = False
        return np.where(usable, self.product**2 / np.where(usable, self.left2, 1.0), 0.0)

    @staticmethod
    def best(gains: np.ndarray) -> int:
        """Return the candidate with the largest gain; of equal ones the first, which a list by
        order has as the simplest.
        """
        return int(np.flatnonzero(gains >= (1.0 - _TIE) * gains.max())[0])

    def take(self, j: int) -> None:
        """Add a candidate; made orthogonal twice, so that rounding does not add up."""
        n = len(self.taken)
        if n == len(self.Q):
            self.Q = np.concatenate([self.Q, np.empty_like(self.Q)])
        known, q, r = self.Q[:n], self.X[j].copy(), np.zeros(n + 1)
        for _ in range(2):
            share = known @ q
            q -= share @ known
            r[:n] += share
        r[n] = np.linalg.norm(q)
        self.Q[n] = q / r[n]
        a = float(self.Q[n] @ self.residual)
        shadow = self.X @ self.Q[n]
        self.left2 -= shadow**2
        self.product -= a * shadow
        self.residual -= a * self.Q[n]
        self.taken.append(j)
        self.R.append(r)
        self.a.append(a)

    @property
    def functions(self) -> np.ndarray:
        """The orthonormal functions, (rows, taken)."""
        return self.Q[: len(self.taken)].T

    @property
    def triangle(self) -> np.ndarray:
        """R with X_taken = Q R, (taken, taken)."""
        n = len(self.taken)
        R = np.zeros((n, n))
        for k, column in enumerate(self.R):
            R[: k + 1, k] = column
        return R

    def estimates(self) -> np.ndarray:
        """Return the parameters of the terms taken, of the orthogonal functions turned back into
        terms.
        """
        return np.linalg.solve(self.triangle, np.array(self.a)) if self.taken else np.zeros(0)

    def losses(self) -> np.ndarray:
        """Return by how much the sum of squares would rise without each of the terms taken,
        (taken,).
        """
        if not self.taken:
            return np.zeros(0)
        return self.estimates() ** 2 / (np.linalg.inv(self.triangle) ** 2).sum(axis=1)

    def exchange(self, places: Sequence[int]) -> tuple[int, int, float]:
        """Return the best exchange of one term taken for one candidate.

        Parameters
        ----------
        places : sequence of int
            Terms taken that may go, by their place in `taken`.

        Returns
        -------
        place, candidate, gain : int, int, float
            The sum of squares would fall by `gain`; zero when no exchange helps.

        Notes
        -----
        A term that goes gives back one direction: the remainder of it when all others are removed.  Along it every
        candidate and the residual have something to regain.
        """
        if not len(places):
            return 0, 0, 0.0
        inverse = np.linalg.inv(self.triangle)[places]
        directions = (inverse / np.linalg.norm(inverse, axis=1, keepdims=True)) @ self.Q[
            : len(self.taken)
        ]
        along, regained = self.X @ directions.T, directions @ self.z
        left2 = self.left2[:, None] + along**2
        usable = left2 > LEAST**2 * self.size2[:, None]
        usable[self.taken] = False
        product = self.product[:, None] + along * regained
        gains = np.where(usable, product**2 / np.where(usable, left2, 1.0), 0.0) - regained**2
        j, k = (int(at) for at in np.unravel_index(int(np.argmax(gains)), gains.shape))
        return places[k], j, max(0.0, float(gains[j, k]))

    def press(self) -> float:
        """Return the sum of squares of the residuals with each row left out in turn, divided by the
        rows.
        """
        leverage = np.einsum("ij,ij->j", self.Q[: len(self.taken)], self.Q[: len(self.taken)])
        return float(np.mean((self.residual / np.maximum(1e-9, 1.0 - leverage)) ** 2))
