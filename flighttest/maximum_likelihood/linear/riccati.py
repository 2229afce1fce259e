"""Steps of the covariance of a Kalman filter, for many filters at once.

Every array has the filters as its first dimension.

References
----------
.. [Chu2004] Chu, Fan, Lin, Wang, Structure-preserving algorithms for periodic discrete-time
   algebraic Riccati equations, Int. J. Control 77, 2004.
.. [VanLoan1978] Van Loan, Computing integrals involving the matrix exponential, IEEE Trans.
   Automatic Control 23, 1978.
"""

from __future__ import annotations

import numpy as np
import scipy

_DOUBLINGS = 10  # of the steps before the first sample: 2^10 steps
# of the steps of a steady filter, until less than this part of an error remains
_MOST_DOUBLINGS, _FORGOTTEN = 40, 1e-9
_LOG_TERMS = 6  # of the series of the logarithm, in odd powers: the rest is below 1e-9
_INTEGRAL_TERMS = 10  # of the series of the integral of the process noise


def solve_each(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return A^-1 B of each filter; NaN of a filter whose matrix is singular.

    Parameters
    ----------
    A : array (filter, n, n)
    B : array (filter, n, m)
    """
    try:
        return np.linalg.solve(A, B)
    except np.linalg.LinAlgError:
        # One far trial must not end the others.
        X = np.full(B.shape, np.nan)
        for number, (left, right) in enumerate(zip(A, B)):
            try:
                X[number] = np.linalg.solve(left, right)
            except np.linalg.LinAlgError:
                continue
        return X


def noise_of_step(F: np.ndarray, intensity: np.ndarray, step: float) -> np.ndarray:
    """Return the covariance that white noise in the rates adds over one step.

    Q = integral of exp(A s) G G' exp(A' s) over the step [VanLoan1978]_, with A = ln(F) / step.

    Parameters
    ----------
    F : array (filter, state, state)
        Transition over one step.
    intensity : array (filter, state)
        Square roots of the intensities of the noise.
    step : float
        [s]
    """
    # ln F = 2 (Z + Z^3/3 + Z^5/5 + ...) with Z = (F + 1)^-1 (F - 1): a step is short against the
    # time constants, so that Z is small.
    one = np.eye(F.shape[-1])
    Z = solve_each(F + one, F - one)
    square, power, logarithm = Z @ Z, Z, Z.copy()
    for k in range(1, _LOG_TERMS):
        power = power @ square
        logarithm += power / (2 * k + 1)
    A = 2.0 * logarithm
    # The integral is the series of step / (k + 1)! L^k(G G'), with L(X) = A X + X A'.
    term = step * intensity[:, :, None] ** 2 * one
    total = term.copy()
    for k in range(1, _INTEGRAL_TERMS):
        product = A @ term
        term = (product + product.swapaxes(1, 2)) / (k + 1)
        total += term
    return total


def settled_covariance(F: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return the covariance of the predicted state of filters that ran 1024 steps.

    The filters start without error. The result exists for every F, also if a motion that no noise
    drives is not damped.

    Parameters
    ----------
    F, Q : array (filter, state, state)
    H : array (filter, output, state)
    R : array (filter, output)
        Variances of the readings.
    """
    A, G, P = _first_step(F, H, Q, R)
    for _ in range(_DOUBLINGS):
        A, G, P = _double(A, G, P)
    return P


def steady_covariance(F: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return the covariance of the predicted state of filters that ran for ever.

    The solution is the one with a stable filter, as of `scipy.linalg.solve_discrete_are`, which
    finds it where the doubling does not, as of a motion that grows and that no noise drives.

    Parameters
    ----------
    F, H, Q, R : array
        As of `settled_covariance`.

    Raises
    ------
    LinAlgError
        No steady filter exists.
    ValueError
        An element is not finite.
    """
    A, G, P = _first_step(F, H, Q, R)
    with np.errstate(all="ignore"):
        for _ in range(_MOST_DOUBLINGS):
            A, G, P = _double(A, G, P)
            # A is the transition of the errors of the filter: what remains is of its square.
            forgotten = np.abs(A).max(axis=(1, 2)) < _FORGOTTEN
            if forgotten.all() or not np.isfinite(A).all():
                break
    for number in np.flatnonzero(~forgotten):
        P[number] = scipy.linalg.solve_discrete_are(
            F[number].T, H[number].T, Q[number], np.diag(R[number])
        )
    return P


def _first_step(
    F: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the matrices A, G, P of [Chu2004]_ for one step."""
    return F.swapaxes(1, 2), H.swapaxes(1, 2) @ (H / R[:, :, None]), Q


def _double(
    A: np.ndarray, G: np.ndarray, P: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the matrices of [Chu2004]_ for twice as many steps."""
    one = np.eye(A.shape[-1])
    # of both factors (1 + G P)^-1
    W = solve_each(one + G @ P, np.concatenate([A, G], axis=2))
    WA, WG = W[:, :, : len(one)], W[:, :, len(one) :]
    P = P + A.swapaxes(1, 2) @ P @ WA
    G = G + A @ WG @ A.swapaxes(1, 2)
    return A @ WA, 0.5 * (G + G.swapaxes(1, 2)), 0.5 * (P + P.swapaxes(1, 2))


def correct_covariance(P: np.ndarray, K: np.ndarray, H: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return the covariance after readings, in Joseph's form, which stays positive.

    Parameters
    ----------
    P : array (filter, state, state)
    K : array (filter, state, output)
        Gains.
    H : array (filter, output, state)
    R : array (filter, output)
    """
    left = np.eye(P.shape[-1]) - K @ H
    return left @ P @ left.swapaxes(1, 2) + (K * R[:, None, :]) @ K.swapaxes(1, 2)
