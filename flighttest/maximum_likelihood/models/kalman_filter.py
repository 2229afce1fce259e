"""Linear models in discrete time, and the steady-state Kalman filter that predicts their outputs in turbulence.

    x' = A x + B u + b + w,  y = C x + D u + v,  z_k = y(t_k) + v_k        w white with intensity Q, v with variance R

Inputs are linear between samples, for which the transition is exact.  The filter's gain K and the variance S of its innovations are
those after which nothing changes any more: P = F P F' + Qd - F P C' S^-1 C P F', S = C P C' + R, K = P C' S^-1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm, solve_discrete_are

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


def innovations(filters: list[Filter], starts: np.ndarray, offsets: np.ndarray, u: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the innovations of many filters over one record (filter, time, output).

    Parameters
    ----------
    filters : list of Filter
    starts : array (filter, state)
    offsets : array (filter, output)
        Errors of the instruments: added to y.
    u : array (time, input)
    z : array (time, output)
    """
    F, G0, G1, g, C, D, K, _ = (np.stack(items) for items in zip(*filters))
    seen = z[None] - u @ D.transpose(0, 2, 1) - offsets[:, None, :]
    gain = F @ K
    drive = u[:-1] @ G0.transpose(0, 2, 1) + u[1:] @ G1.transpose(0, 2, 1) + g[:, None, :] + seen[:, :-1] @ gain.transpose(0, 2, 1)
    x = recursion(F - gain @ C, drive, starts)
    return seen - x @ C.transpose(0, 2, 1)


def recursion(M: np.ndarray, drive: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return x_(k+1) = M x_k + drive_k (filter, time, state), stretch by stretch: all at once from zero, then their starts."""
    runs, steps, n = drive.shape
    length = max(1, round(np.sqrt(steps)))
    stretches = -(-steps // length)
    parts = np.concatenate([drive, np.zeros((runs, stretches * length - steps, n))], axis=1).reshape(runs, stretches, length, n)
    x, powers = np.zeros((runs, stretches, length + 1, n)), np.empty((length + 1, *M.shape))
    turned = M.transpose(0, 2, 1)
    powers[0] = np.eye(n)
    for k in range(length):
        x[:, :, k + 1] = x[:, :, k] @ turned + parts[:, :, k]
        powers[k + 1] = powers[k] @ M
    first = np.empty((runs, stretches, n))
    first[:, 0] = start
    for k in range(stretches - 1):
        first[:, k + 1] = (powers[length] @ first[:, k, :, None])[:, :, 0] + x[:, k, length]
    x += np.einsum("krij,rsj->rski", powers, first)
    joined = x[:, :, :length].reshape(runs, -1, n)[:, :steps]
    last = x.reshape(runs, -1, n)[:, (steps - 1) // length * (length + 1) + (steps - 1) % length + 1]
    return np.concatenate([joined, last[:, None]], axis=1)
