"""Gauss-Newton normal equations of a trajectory with constants: block-tridiagonal with a dense border.

Unknowns are the state x_k at N samples (n each) and nc constants c.  Every residual touches two neighbouring states at
most, so the normal matrix is ::

    [ T   G ]   T: N x N blocks of n x n, block-tridiagonal, symmetric
    [ G'  C ]   G: N blocks of n x nc;  C: nc x nc

T is factored as a band (LAPACK ``pbtrf``), the constants follow from the Schur complement S = C - G' T^-1 G, whose
inverse is their posterior covariance.  One step costs O(N n^2 (n + nc)).  On a trajectory this is the iterated
extended Kalman smoother of [Bell1994] without its recursions.

References
----------
.. [Bell1994] Bell, The iterated Kalman smoother as a Gauss-Newton method, SIAM J. Optim. 4, 1994.
"""

from __future__ import annotations

import numpy as np

from flightmech.errors import IdentificationError


class NormalEquations:
    """Sum of squared, whitened residuals, linearised: ``cost``, gradient and normal matrix by blocks.

    Parameters
    ----------
    samples, states, constants : int
        N, n and nc.
    """

    def __init__(self, samples: int, states: int, constants: int):
        self.D = np.zeros((samples, states, states))
        self.O = np.zeros((samples - 1, states, states))
        self.G = np.zeros((samples, states, constants))
        self.C = np.zeros((constants, constants))
        self.gx = np.zeros((samples, states))
        self.gc = np.zeros(constants)
        self.cost = 0.0

    def add_steps(self, r, A, B, columns, Jc) -> None:
        """Add residuals between neighbours: r (N-1, m), A = dr/dx_k, B = dr/dx_k+1 (N-1, m, n), Jc (N-1, m, columns)."""
        At, Bt = _t(A), _t(B)
        self.D[:-1] += At @ A
        self.D[1:] += Bt @ B
        self.O += Bt @ A
        self.gx[:-1] += (At @ r[..., None])[..., 0]
        self.gx[1:] += (Bt @ r[..., None])[..., 0]
        self.G[:-1, :, columns] += At @ Jc
        self.G[1:, :, columns] += Bt @ Jc
        self._add_constants(r, columns, Jc)

    def add_samples(self, r, k, f, J, columns, Jc) -> None:
        """Add residuals of outputs at the state (1-f) x_k + f x_k+1: r (M, m), k and f (M,), J (M, m, n), Jc (M, m, columns)."""
        JJ, Jr, JJc = _t(J) @ J, (_t(J) @ r[..., None])[..., 0], _t(J) @ Jc
        for index, weight in ((k, 1.0 - f), (k + 1, f)):
            hit = weight > 0.0
            if not hit.any():
                continue
            chosen = slice(None) if hit.all() else hit
            at, share = index[chosen], weight[chosen]
            add_at(self.D, at, JJ[chosen] * (share**2)[:, None, None])
            add_at(self.gx, at, Jr[chosen] * share[:, None])
            add_at(self.G, at, JJc[chosen] * share[:, None, None], columns)
        between = f * (1.0 - f) > 0.0
        if between.any():
            add_at(self.O, k[between], JJ[between] * (f * (1.0 - f))[between, None, None])
        self._add_constants(r, columns, Jc)

    def add_state(self, k: int, r, weight) -> None:
        """Add a prior on one state: residual r (n,) already divided by its standard error, weight = 1/standard error (n,)."""
        self.D[k] += np.diag(weight**2)
        self.gx[k] += weight * r
        self.cost += float(r @ r)

    def add_prior(self, deviation, precision) -> None:
        """Add a prior on the constants: deviation from its mean (nc,) and the inverse of its covariance (nc, nc)."""
        self.C += precision
        self.gc += precision @ deviation
        self.cost += float(deviation @ precision @ deviation)

    def _add_constants(self, r, columns, Jc) -> None:
        self.cost += float(np.vdot(r, r))
        if len(columns):
            flat = Jc.reshape(-1, len(columns))
            self.C[np.ix_(columns, columns)] += flat.T @ flat
            self.gc[columns] += flat.T @ r.ravel()

    def solve(self, free: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the Gauss-Newton step of states (N, n) and constants (nc,), and the information on the constants (nc, nc).

        Parameters
        ----------
        free : array of bool (nc,), optional
            Constants that may move; all without it.

        Raises
        ------
        IdentificationError
            The normal matrix is singular: something is neither measured nor bounded by a prior.
        """
        from scipy.linalg import cho_factor, cho_solve
        from scipy.linalg.lapack import dtbtrs

        samples, states, constants = self.G.shape
        factor = self._factor()
        right = np.empty((samples * states, constants + 1), order="F")
        right[:, :constants] = self.G.reshape(-1, constants)
        right[:, constants] = self.gx.ravel()
        Y, _ = dtbtrs(factor, right, uplo="L", trans="N", overwrite_b=1)
        YY = Y.T @ Y
        schur = self.C - YY[:-1, :-1]
        dc = np.zeros(constants)
        move = np.arange(constants) if free is None else np.flatnonzero(free)
        if len(move):
            scale = 1.0 / np.sqrt(np.diag(self.C)[move])
            try:
                root = cho_factor(schur[np.ix_(move, move)] * np.outer(scale, scale))
            except np.linalg.LinAlgError as error:
                raise IdentificationError(
                    "the constants are not determined: two of them do the same and have no prior; give one a prior"
                ) from error
            dc[move] = -scale * cho_solve(root, scale * (self.gc - YY[:-1, -1])[move])
        rest = np.asfortranarray((-Y[:, -1] - Y[:, :-1] @ dc)[:, None])
        dx, _ = dtbtrs(factor, rest, uplo="L", trans="T", overwrite_b=1)
        return dx.reshape(samples, states), dc, schur

    def following(self) -> np.ndarray:
        """Return how the states follow the constants, dx/dc = -T^-1 G (N, n, nc).

        Raises
        ------
        IdentificationError
            As `solve`.
        """
        from scipy.linalg.lapack import dpbtrs

        samples, states, constants = self.G.shape
        factor = self._factor()
        follow, _ = dpbtrs(factor, np.asfortranarray(-self.G.reshape(-1, constants)), lower=1, overwrite_b=1)
        return follow.reshape(samples, states, constants)

    def _factor(self) -> np.ndarray:
        """Return the Cholesky factor of T in band storage."""
        from scipy.linalg.lapack import dpbtrf

        states = self.D.shape[1]
        factor, fault = dpbtrf(self._band(), lower=1, overwrite_ab=1)
        if fault:
            k, i = divmod(fault - 1, states)
            raise IdentificationError(f"the trajectory is not determined at sample {k}, state {i}; give a sensor or a prior for it")
        return factor

    def _band(self) -> np.ndarray:
        """Return T in lower band storage: band[i - j, j]."""
        samples, n, _ = self.D.shape
        band = np.zeros((2 * n, samples * n), order="F")
        for i in range(n):
            for j in range(n):
                if i >= j:
                    band[i - j, j::n] = self.D[:, i, j]
                band[n + i - j, j : (samples - 1) * n : n] = self.O[:, i, j]
        return band


def _t(matrices: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrices, -1, -2)


def add_at(target: np.ndarray, index: np.ndarray, values: np.ndarray, columns: np.ndarray | None = None) -> None:
    """Add values at rising indices, which repeat where a sensor is faster than the grid."""
    first = np.concatenate([[True], index[1:] > index[:-1]])
    if not first.all():
        starts = np.flatnonzero(first)
        index, values = index[starts], np.add.reduceat(values, starts, axis=0)
    where = slice(index[0], index[-1] + 1) if index[-1] - index[0] == len(index) - 1 else index
    if columns is None:
        target[where] += values
    else:
        part = target[where]  # a view when the readings are as regular as the grid
        part[..., columns] += values
        if not isinstance(where, slice):
            target[where] = part
