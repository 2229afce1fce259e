"""Gauss-Newton normal equations of a trajectory with constants: block-tridiagonal with a dense
border.

Unknowns are the state x_k at N samples (n each) and nc constants c.  Every residual touches two neighbouring states at
most, so the normal matrix is ::

    [ T   G ]   T: N x N blocks of n x n, block-tridiagonal, symmetric
    [ G'  C ]   G: N blocks of n x nc;  C: nc x nc

T is factored by blocks, the constants follow from the Schur complement S = C - G' T^-1 G, whose
inverse is their posterior covariance.  One step costs O(N n^2 (n + nc)).  On a trajectory this is
the iterated extended Kalman smoother of [Bell1994] without its recursions.

References
----------
.. [Bell1994] Bell, The iterated Kalman smoother as a Gauss-Newton method, SIAM J. Optim. 4, 1994.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from flightmech.errors import IdentificationError
from flightmech.simulation.driven_path import DrivenPath
from flightmech.simulation.normal_sums import Elimination, NormalSums

AT_ONCE = 8  # directions of the constants: more do not stay in the cache


class NormalEquations:
    """Sum of squared, whitened residuals, linearised: ``cost``, gradient and normal matrix by
    blocks.

    Parameters
    ----------
    samples, states, constants : int
        N, n and nc.
    """

    def __init__(self, samples: int, states: int, constants: int):
        self.sums = NormalSums(samples, states, constants)
        self.D, self.O, self.G, self.C = self.sums.D, self.sums.O, self.sums.G, self.sums.C
        self.gx, self.gc = self.sums.gx, self.sums.gc
        self._rest: Elimination | None = None

    @property
    def cost(self) -> float:
        """Twice the negative log density, but for a constant."""
        return self.sums.cost

    def clear(self) -> None:
        """Set all sums to zero, see `NormalSums.clear`."""
        self.sums.clear()
        self._rest = None

    def reuse_elimination(self, other: NormalEquations) -> None:
        """Take over the memory of the elimination of equations that are not solved again."""
        self.sums.reuse_elimination(other.sums)
        other._rest = None

    def add_steps(self, r, A, B, columns, Jc, weight) -> None:
        """Add residuals between neighbours, and what they are multiplied by: r, weight (N-1, m), Jc
        (N-1, m, columns).

        A = dr/dx_k and B = dr/dx_k+1 (N-1, m, q) are the derivatives by the first q of the state.
        """
        self.sums.steps(r, weight, A, B, columns, Jc)

    def add_path_steps(self, path: DrivenPath, weight, columns) -> None:
        """Add what the instruments would have to be wrong by between the samples, see
        `NormalSums.path_steps`.
        """
        self.sums.path_steps(path, weight, columns)

    def add_samples(self, r, k, f, J, columns, Jc, weight) -> None:
        """Add residuals of outputs at the state (1-f) x_k + f x_k+1, and what they are multiplied
        by.

        r (M, m), k and f (M,), J (M, m, n) or that of all readings (1, m, n), Jc (M, m, columns),
        weight (m,).
        """
        last = np.flatnonzero(J.any(axis=(0, 1)))[-1:] + 1  # states behind it have no part
        self.sums.readings(r, weight, k, f, J[..., : int(last[0]) if len(last) else 0], columns, Jc)

    def add_state(self, k: int, r, weight) -> None:
        """Add a prior on one state: residual r (n,) already divided by its standard error, weight =
        1/standard error (n,).
        """
        self.D[k] += np.diag(weight**2)
        self.gx[k] += weight * r
        self.sums.cost += float(r @ r)

    def add_prior(self, deviation, precision) -> None:
        """Add a prior on the constants: deviation from its mean (nc,) and the inverse of its
        covariance (nc, nc).
        """
        self.C += precision
        self.gc += precision @ deviation
        self.sums.cost += float(deviation @ precision @ deviation)

    def solve(self, free: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the Gauss-Newton step of states (N, n) and constants (nc,), and the information on
        the constants (nc, nc).

        Parameters
        ----------
        free : array of bool (nc,), optional
            Constants that may move; all without it.

        Raises
        ------
        IdentificationError
            The normal matrix is singular: something is neither measured nor bounded by a prior.
        """

        constants = len(self.C)
        rest = self._rest = self._eliminated()
        border = rest.border
        schur = self.C - border[:-1, :-1]
        dc = np.zeros(constants)
        move = np.arange(constants) if free is None else np.flatnonzero(free)
        if len(move):
            scale = 1.0 / np.sqrt(np.diag(self.C)[move])
            try:
                root = cho_factor(schur[np.ix_(move, move)] * np.outer(scale, scale))
            except np.linalg.LinAlgError as error:
                raise IdentificationError(
                    "the constants are not determined: two of them do the same and have no "
                    "prior; give one a prior"
                ) from error
            dc[move] = -scale * cho_solve(root, scale * (self.gc - border[:-1, -1])[move])
        dx = rest.substitute_back(-rest.multiply_columns(np.append(dc, 1.0)[:, None]))
        return dx[..., 0], dc, schur

    def following(self, directions: np.ndarray) -> Iterator[np.ndarray]:
        """Yield how the states follow the constants, dx/dc = -T^-1 G, along directions of these;
        what `solve` eliminated is used again.

        Parameters
        ----------
        directions : array (nc, m)

        Yields
        ------
        array (N, n)
            For each direction; every state is contiguous in memory.

        Raises
        ------
        IdentificationError
            As `solve`.
        """
        rest = self._rest or self._eliminated()
        for first in range(0, directions.shape[1], AT_ONCE):
            some = directions[:, first : first + AT_ONCE]
            change = rest.substitute_back(
                rest.multiply_columns(np.vstack([-some, np.zeros(some.shape[1])]))
            )
            yield from (item.T for item in np.ascontiguousarray(change.T))

    def _eliminated(self) -> Elimination:
        try:
            return self.sums.eliminate()
        except np.linalg.LinAlgError as error:
            k, i = error.args
            raise IdentificationError(
                f"the trajectory is not determined at sample {k}, state {i}; give a sensor "
                f"or a prior for it"
            ) from error
