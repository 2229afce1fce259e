"""Orthogonal functions of a forward selection (forward orthogonal least squares).

References
----------
.. [Chen1989] Chen, Billings, Luo, Orthogonal least squares methods and their application to
   non-linear system identification, Int. J. Control 50, 1989.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_TIE = 1e-9  # relative difference of two gains that counts as equal
LEAST = 1e-4  # least length of the independent part of a candidate, of its length
_FIRST_ROWS = 8  # functions for which memory is reserved at the start
_LEAST_FREE = 1e-9  # least share of a row that counts as free of the fit


class OrthogonalBasis:
    """State of a forward selection of candidates [Chen1989]_.

    Parameters
    ----------
    X : array (candidates, rows)
    z : array (rows,)

    Attributes
    ----------
    chosen : list of int
        Candidates in the order of their choice.
    Q : array (at least chosen, rows)
        Orthonormal functions.
    a : list of float
        Coefficients of the functions.
    residual : array (rows,)
    remainder2 : array (candidates,)
        Square of the part of each candidate that is orthogonal to the functions.
    product : array (candidates,)
        Product of each candidate and the residual.
    """

    def __init__(self, X: np.ndarray, z: np.ndarray):
        self.X, self.z = X, z
        self.size2 = np.einsum("ij,ij->i", X, X)
        self.restart(())

    def restart(self, chosen: Sequence[int]) -> None:
        """Start again with given candidates."""
        self.chosen: list[int] = []
        self.Q = np.empty((_FIRST_ROWS, len(self.z)))
        self.R: list[np.ndarray] = []
        self.a: list[float] = []
        self.remainder2 = self.size2.copy()
        self.residual = self.z.copy()
        self.product = self.X @ self.z
        for j in chosen:
            self.add(j)

    @property
    def rss(self) -> float:
        """Sum of the squares of the residual."""
        return float(self.residual @ self.residual)

    def gains(self) -> np.ndarray:
        """Return the decrease of the sum of squares by each candidate, (candidates,).

        The gain is zero for chosen candidates and for candidates without an independent part.
        """
        is_usable = self.remainder2 > LEAST**2 * self.size2
        is_usable[self.chosen] = False
        divisor = np.where(is_usable, self.remainder2, 1.0)
        return np.where(is_usable, self.product**2 / divisor, 0.0)

    @staticmethod
    def best_candidate(gains: np.ndarray) -> int:
        """Return the candidate with the largest gain; of equal gains the first and simplest one."""
        return int(np.flatnonzero(gains >= (1.0 - _TIE) * gains.max())[0])

    def add(self, j: int) -> None:
        """Add a candidate to the functions."""
        n = len(self.chosen)
        if n == len(self.Q):
            self.Q = np.concatenate([self.Q, np.empty_like(self.Q)])
        functions, q, r = self.Q[:n], self.X[j].copy(), np.zeros(n + 1)
        # Gram-Schmidt twice: rounding of the first pass does not accumulate.
        for _ in range(2):
            share = functions @ q
            q -= share @ functions
            r[:n] += share
        r[n] = np.linalg.norm(q)
        self.Q[n] = q / r[n]
        a = float(self.Q[n] @ self.residual)
        # The new function is removed from all candidates and from the residual.
        projection = self.X @ self.Q[n]
        self.remainder2 -= projection**2
        self.product -= a * projection
        self.residual -= a * self.Q[n]
        self.chosen.append(j)
        self.R.append(r)
        self.a.append(a)

    @property
    def functions(self) -> np.ndarray:
        """The orthonormal functions, (rows, chosen)."""
        return self.Q[: len(self.chosen)].T

    @property
    def triangle(self) -> np.ndarray:
        """R with X_chosen = Q R, (chosen, chosen)."""
        n = len(self.chosen)
        R = np.zeros((n, n))
        for k, column in enumerate(self.R):
            R[: k + 1, k] = column
        return R

    def estimates(self) -> np.ndarray:
        """Return the parameters of the chosen terms, R^-1 a, (chosen,)."""
        if not self.chosen:
            return np.zeros(0)
        return np.linalg.solve(self.triangle, np.array(self.a))

    def losses(self) -> np.ndarray:
        """Return the increase of the sum of squares without each chosen term, (chosen,)."""
        if not self.chosen:
            return np.zeros(0)
        # theta_k^2 over the k-th diagonal element of (X'X)^-1 = R^-1 R^-T
        return self.estimates() ** 2 / (np.linalg.inv(self.triangle) ** 2).sum(axis=1)

    def best_exchange(
        self, positions: Sequence[int], allowed: np.ndarray | None = None
    ) -> tuple[int, int, float]:
        """Return the best exchange of one chosen term for one candidate.

        Parameters
        ----------
        positions : sequence of int
            Chosen terms that may be removed, by their position in `chosen`.
        allowed : array of bool (candidates, positions), optional
            Candidates that may replace each of them; default all.

        Returns
        -------
        position, candidate, gain : int, int, float
            The sum of squares decreases by `gain`; zero if no exchange helps.

        Notes
        -----
        A removed term frees one direction: the part of the term that is orthogonal to all other
        chosen terms. Every candidate and the residual may have a component along it.
        """
        if not len(positions):
            return 0, 0, 0.0
        inverse = np.linalg.inv(self.triangle)[positions]
        unit = inverse / np.linalg.norm(inverse, axis=1, keepdims=True)
        directions = unit @ self.Q[: len(self.chosen)]  # (positions, rows)
        component, lost = self.X @ directions.T, directions @ self.z
        # Remainders, products and gains of the candidates (candidates, positions) after the removal
        # of each term. The removal itself increases the sum of squares by lost^2.
        remainder2 = self.remainder2[:, None] + component**2
        is_usable = remainder2 > LEAST**2 * self.size2[:, None]
        is_usable[self.chosen] = False
        product = self.product[:, None] + component * lost
        divisor = np.where(is_usable, remainder2, 1.0)
        gains = np.where(is_usable, product**2 / divisor, 0.0) - lost**2
        if allowed is not None:
            gains = np.where(allowed, gains, 0.0)
        j, k = np.unravel_index(int(np.argmax(gains)), gains.shape)
        return positions[int(k)], int(j), max(0.0, float(gains[j, k]))

    def press(self) -> float:
        """Return the mean square of the residuals with each row left out in turn (PRESS)."""
        functions = self.Q[: len(self.chosen)]
        leverage = np.einsum("ij,ij->j", functions, functions)
        return float(np.mean((self.residual / np.maximum(_LEAST_FREE, 1.0 - leverage)) ** 2))
