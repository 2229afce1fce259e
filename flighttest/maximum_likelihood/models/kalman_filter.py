"""Linear models in discrete time, and the steady-state Kalman filter that predicts their outputs in turbulence.

    x' = A x + B u + b + w,  y = C x + D u + v,  z_k = y(t_k) + v_k        w white with intensity Q, v with variance R

Inputs are linear between samples, for which the transition is exact.  The filter's gain K and the variance S of its innovations are
those after which nothing changes any more: P = F P F' + Qd - F P C' S^-1 C P F', S = C P C' + R, K = P C' S^-1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm, solve_discrete_are
from scipy.linalg.lapack import dtbtrs

from .state_space import Matrices


class Filter(NamedTuple):
    """A predictor: x_(k+1) = F (x_k + K e_k) + G0 u_k + G1 u_(k+1) + g, e_k = z_k - C x_k - D u_k, cov(e) = S."""

    F: np.ndarray
    G0: np.ndarray
    G1: np.ndarray
    g: np.ndarray
    C: np.ndarray
    D: np.ndarray
    K: np.ndarray
    S: np.ndarray


def steady_filter(model: Matrices, drift: np.ndarray, intensity: np.ndarray, noise: np.ndarray, step: float) -> Filter:
    """Return the steady-state Kalman filter.

    Parameters
    ----------
    model : Matrices
    drift : array (state,)
        Constant part b of the rates.
    intensity : array (state,)
        Square root of the intensity of w. [unit of the state per square root of second]
    noise : array (output,)
        Standard deviation of v.
    step : float
        Sampling interval. [s]

    Raises
    ------
    LinAlgError
        No filter settles: what grows is not seen in the outputs.

    References
    ----------
    .. [VanLoan1978] Van Loan, Computing integrals involving the matrix exponential, IEEE Trans. Automatic Control 23, 1978.
    """
    A, B, C, D = model
    n, m = B.shape
    # constant and ramp of [u; 1] as further states: the transition over one step holds the integrals
    whole = np.zeros((n + 2 * (m + 1), n + 2 * (m + 1)))
    whole[:n, :n], whole[:n, n : n + m], whole[:n, n + m] = A, B, drift
    whole[n : n + m + 1, n + m + 1 :] = np.eye(m + 1) / step
    made = expm(whole * step)
    F, level, ramp = made[:n, :n], made[:n, n : n + m + 1], made[:n, n + m + 1 :]
    R = np.diag(noise**2)
    if not intensity.any():
        return Filter(F, level[:, :m] - ramp[:, :m], ramp[:, :m], level[:, m], C, D, np.zeros((n, len(C))), R)
    paired = np.zeros((2 * n, 2 * n))
    paired[:n, :n], paired[:n, n:], paired[n:, n:] = -A, np.diag(intensity**2), A.T
    spread = expm(paired * step)
    Q = F @ spread[:n, n:]
    P = solve_discrete_are(F.T, C.T, 0.5 * (Q + Q.T), R)
    S = C @ P @ C.T + R
    K = np.linalg.solve(S, C @ P).T
    return Filter(F, level[:, :m] - ramp[:, :m], ramp[:, :m], level[:, m], C, D, K, 0.5 * (S + S.T))


class Predictor(NamedTuple):
    """One run of a filter: x_(k+1) = M x_k + W [u_k, u_(k+1), 1, z_k], e_k = z_k - N [x_k, u_k, 1]; or the rates of one.

    ``start`` is x_0.
    """

    M: np.ndarray
    W: np.ndarray
    N: np.ndarray
    start: np.ndarray


def predictor(made: Filter, start: np.ndarray, offset: np.ndarray) -> Predictor:
    """Return a filter with its first state (state,) and the errors of the instruments (output,), which are added to y."""
    F, G0, G1, g, C, D, K, _ = made
    gain = F @ K
    return Predictor(F - gain @ C, np.column_stack([G0 - gain @ D, G1, g - gain @ offset, gain]), np.column_stack([C, D, offset]), start)


def innovations(run: Predictor, u: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the innovations (time, output) under inputs u (time, input) and readings z (time, output)."""
    return z - np.column_stack([_states(run, u, z), u, np.ones(len(u))]) @ run.N.T


def innovation_slopes(run: Predictor, up: list[Predictor], down: list[Predictor], width: np.ndarray, u: np.ndarray, z: np.ndarray):
    """Return the slopes of the innovations (unknown, time, output).

    The matrices by differences; of what they make of the record the exact derivative, so that all unknowns share one recursion:
    s_(k+1) = M s_k + M' x_k + W' [u_k, u_(k+1), 1, z_k].

    Parameters
    ----------
    run : Predictor
    up, down : list of Predictor
        After a step of each unknown.
    width : array (unknown,)
        Distance between the two.
    u, z : array (time, input), (time, output)
    """
    M, W, N, start = (np.stack(a) - np.stack(b) for a, b in zip(zip(*up), zip(*down)))
    x = _states(run, u, z)
    drive = np.column_stack([x[:-1], _driving(u, z)]) @ np.concatenate([M, W], axis=2).transpose(0, 2, 1)
    s = recursion(run.M, drive, start)
    seen = np.column_stack([x, u, np.ones(len(u))]) @ N.transpose(0, 2, 1)
    return -(seen + s @ run.N[:, : len(run.M)].T) / width[:, None, None]


def _driving(u: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.column_stack([u[:-1], u[1:], np.ones(len(u) - 1), z[:-1]])


def _states(run: Predictor, u: np.ndarray, z: np.ndarray) -> np.ndarray:
    return recursion(run.M, (_driving(u, z) @ run.W.T)[None], run.start[None])[0]


def recursion(M: np.ndarray, drive: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return x_(k+1) = M x_k + drive_k, x_0 = start, (run, time, state): one triangular banded system for all runs.

    Parameters
    ----------
    M : array (state, state)
    drive : array (run, time - 1, state)
    start : array (run, state)
    """
    runs, steps, n = drive.shape
    band = np.zeros((2 * n, (steps + 1) * n))  # row i - j of the diagonals below the main one, which is of ones
    for i, j in np.ndindex(n, n):
        band[n + i - j, j : steps * n : n] = -M[i, j]
    x = np.concatenate([start[:, None], drive], axis=1).reshape(runs, -1)
    x, _ = dtbtrs(band, x.T, uplo="L", diag="U", overwrite_b=1)
    return x.T.reshape(runs, steps + 1, n)
