"""Gauss-Newton normal equations of a trajectory with constants.

Unknowns are the state x_k at N samples (n each) and nc constants c. Every residual depends on two
neighbouring states at most. The normal matrix is therefore block-tridiagonal with a dense border::

    [ T   G ]   T: N x N blocks of n x n, block-tridiagonal, symmetric
    [ G'  C ]   G: N blocks of n x nc;  C: nc x nc

T is factored by blocks. The constants follow from the Schur complement S = C - G' T^-1 G, whose
inverse is their posterior covariance. One step costs O(N n^2 (n + nc)). On a trajectory this is the
iterated extended Kalman smoother of [Bell1994] without its recursions.

References
----------
.. [Bell1994] Bell, The iterated Kalman smoother as a Gauss-Newton method, SIAM J. Optim. 4, 1994.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from flightmech.errors import IdentificationError
from flightmech.simulation.driven_path import DrivenPath
from flightmech.simulation.normal_sums import Elimination, NormalSums

# Number of directions of the constants that are substituted together. More do not stay in the
# cache.
AT_ONCE = 8
# Part of the information on a constant that is rounding, for each constant.
_LEAST_PART = 8.0 * np.finfo(float).eps
# Part of a constant in an undetermined combination from which it is named.
_NAMED = 0.3


class NormalEquations:
    """Sum of squared, whitened residuals, linearised.

    Parameters
    ----------
    samples, states, constants : int
        N, n and nc.
    names : sequence of str, optional
        Names of the constants, for errors.

    Attributes
    ----------
    D, O : array
        Blocks of T on the diagonal (N, n, n) and next to it.
    G, C : array
        Border and block of the constants.
    gx, gc : array
        Gradient by states (N, n) and constants (nc,).
    """

    def __init__(self, samples: int, states: int, constants: int, names: Sequence[str] = ()):
        self.names = tuple(names)
        self.sums = NormalSums(samples, states, constants)
        self.D, self.O, self.G, self.C = self.sums.D, self.sums.O, self.sums.G, self.sums.C
        self.gx, self.gc = self.sums.gx, self.sums.gc
        self._elimination: Elimination | None = None

    @property
    def cost(self) -> float:
        """Twice the negative log density, without its constant."""
        return self.sums.cost

    def clear(self) -> None:
        """Set all sums to zero, see `NormalSums.clear`."""
        self.sums.clear()
        self._elimination = None

    def reuse_elimination(self, other: NormalEquations) -> None:
        """Reuse the memory of the elimination of equations that are not solved again."""
        self.sums.reuse_elimination(other.sums)
        other._elimination = None

    def add_steps(self, r, A, B, columns, Jc, weight) -> None:
        """Add residuals between neighbouring samples.

        Parameters
        ----------
        r, weight : array (N-1, m)
            Residuals and the factors that whiten them.
        A, B : array (N-1, m, q)
            dr/dx_k and dr/dx_k+1, by the first q variables of the state.
        columns : array of int
            Indices of the constants involved.
        Jc : array (N-1, m, columns)
            Derivative by these constants.
        """
        self.sums.steps(r, weight, A, B, columns=columns, J=Jc)

    def add_path_steps(self, path: DrivenPath, weight, columns) -> None:
        """Add the instrument errors that explain the steps, see `NormalSums.path_steps`."""
        self.sums.path_steps(path, weight, columns)

    def add_samples(self, r, k, f, J, columns, Jc, weight) -> None:
        """Add residuals of outputs at the state (1-f) x_k + f x_k+1.

        Parameters
        ----------
        r : array (M, m)
            Residuals.
        k, f : array (M,)
            Positions of the readings.
        J : array (M, m, n) or (1, m, n)
            Derivative by the state, of each reading or of all.
        columns : array of int
            Indices of the constants involved.
        Jc : array (M, m, columns)
            Derivative by these constants.
        weight : array (m,)
            Factors that whiten the residuals.
        """
        # State variables after the last one with a derivative do not take part.
        involved = np.flatnonzero(J.any(axis=(0, 1)))
        count = 0
        if len(involved):
            count = int(involved[-1] + 1)
        self.sums.readings(r, weight, k, f, A=J[..., :count], columns=columns, J=Jc)

    def add_state(self, k: int, r, weight) -> None:
        """Add a prior on the state of sample k.

        Parameters
        ----------
        k : int
        r : array (n,)
            Residual over its standard error.
        weight : array (n,)
            One over the standard error.
        """
        self.D[k] += np.diag(weight**2)
        self.gx[k] += weight * r
        self.sums.cost += float(r @ r)

    def add_prior(self, deviation, precision) -> None:
        """Add a prior on the constants.

        Parameters
        ----------
        deviation : array (nc,)
            Constants less their prior mean.
        precision : array (nc, nc)
            Inverse of the prior covariance.
        """
        self.C += precision
        self.gc += precision @ deviation
        self.sums.cost += float(deviation @ precision @ deviation)

    def solve(self, free: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the Gauss-Newton step.

        Parameters
        ----------
        free : array of bool (nc,), optional
            Constants that may move; all by default.

        Returns
        -------
        dx : array (N, n)
            Step of the states.
        dc : array (nc,)
            Step of the constants.
        information : array (nc, nc)
            Information on the constants, the Schur complement S.

        Raises
        ------
        IdentificationError
            The normal matrix is singular within rounding: an unknown has neither a reading nor a
            prior, or several do the same.
        """
        elimination = self._elimination = self._eliminate_states()
        # G' T^-1 [G gx]
        border = elimination.border
        schur = self.C - border[:-1, :-1]
        dc = np.zeros(len(self.C))
        movable = np.arange(len(self.C))
        if free is not None:
            movable = np.flatnonzero(free)
        if len(movable):
            # Scaled, because the units of the constants differ by powers of ten.
            own = np.diag(self.C)[movable]
            if not np.all(own > 0.0):
                raise self._undetermined(movable[~(own > 0.0)])
            scale = 1.0 / np.sqrt(own)
            scaled = schur[np.ix_(movable, movable)] * np.outer(scale, scale)
            try:
                root = scipy.linalg.cho_factor(scaled)
            except (np.linalg.LinAlgError, ValueError) as error:
                raise self._undetermined(_weakest(scaled, movable)) from error
            # The square of a pivot is the part of the information on a constant that neither the
            # path nor the constants before it take; a part within rounding is none.
            if np.min(np.diag(root[0]) ** 2) < _LEAST_PART * len(movable):
                raise self._undetermined(_weakest(scaled, movable))
            gradient = (self.gc - border[:-1, -1])[movable]
            dc[movable] = -scale * scipy.linalg.cho_solve(root, scale * gradient)
        # dx = -T^-1 (G dc + gx)
        right_side = -elimination.multiply_columns(np.append(dc, 1.0)[:, None])
        dx = elimination.substitute_back(right_side)
        return dx[..., 0], dc, schur

    def following(self, directions: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the change of the states with the constants, dx/dc = -T^-1 G, along directions.

        The elimination of the last `solve` is used again.

        Parameters
        ----------
        directions : array (nc, m)
            Changes of the constants, one per column.

        Yields
        ------
        array (N, n)
            Change of the states for each direction; every state is contiguous in memory.

        Raises
        ------
        IdentificationError
            As `solve`.
        """
        elimination = self._elimination or self._eliminate_states()
        for first in range(0, directions.shape[1], AT_ONCE):
            batch = directions[:, first : first + AT_ONCE]
            # The last row belongs to the gradient, which takes no part.
            right_side = elimination.multiply_columns(np.vstack([-batch, np.zeros(batch.shape[1])]))
            change = elimination.substitute_back(right_side)
            for by_state in np.ascontiguousarray(change.T):
                yield by_state.T

    def _undetermined(self, constants: np.ndarray) -> IdentificationError:
        """Return the error on constants that the readings and priors do not determine."""
        names = [str(k) for k in constants]
        if self.names:
            names = [self.names[k] for k in constants]
        text = (
            f"the constant {names[0]} is not determined: it has no reading of its own and no prior"
        )
        if len(names) > 1:
            text = (
                f"the constants {', '.join(names)} are not determined: together they have no "
                f"reading and no prior, because they do the same"
            )
        return IdentificationError(
            f"{text}; give one a prior, or a manoeuvre that separates them from the path"
        )

    def _eliminate_states(self) -> Elimination:
        """Factor T and return the elimination of the states."""
        try:
            return self.sums.eliminate()
        except np.linalg.LinAlgError as error:
            k, i = error.args
            raise IdentificationError(
                f"the trajectory is not determined at sample {k}, state {i}; give a sensor "
                f"or a prior for it"
            ) from error


def _weakest(scaled: np.ndarray, constants: np.ndarray) -> np.ndarray:
    """Return the constants of the combination that a scaled information determines least."""
    if not np.isfinite(scaled).all():
        return constants[~np.isfinite(scaled).all(axis=1)]
    _, vectors = np.linalg.eigh(scaled)
    parts = np.abs(vectors[:, 0])
    return constants[parts >= _NAMED * parts.max()]
