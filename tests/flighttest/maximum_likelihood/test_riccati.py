"""Steady covariances of many filters, against the algebraic equation of each."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are

from flighttest.maximum_likelihood.linear.riccati import steady_covariance


def test_a_motion_that_grows_without_noise_has_the_stable_filter_of_the_equation():
    """Doubling stays at zero covariance there, and the error would grow; its neighbour is
    stable.
    """
    F = np.array([np.diag([1.02, 0.9]), np.diag([0.8, 0.9])])
    H = np.array([[[1.0, 0.3], [0.0, 1.0]]] * 2)
    Q = np.array([np.diag([0.0, 1e-4]), np.diag([2e-4, 1e-4])])
    R = np.array([[1e-3, 4e-3], [1e-3, 4e-3]])
    P = steady_covariance(F, H, Q, R)
    for number in range(2):
        C, noise = H[number], np.diag(R[number])
        expected = solve_discrete_are(F[number].T, C.T, Q[number], noise)
        np.testing.assert_allclose(P[number], expected, rtol=1e-8, atol=1e-14)
        K = P[number] @ C.T @ np.linalg.inv(C @ P[number] @ C.T + noise)
        error = F[number] @ (np.eye(2) - K @ C)
        assert np.abs(np.linalg.eigvals(error)).max() < 0.99
    # The variance of the growing motion is not the zero of its noise.
    assert P[0, 0, 0] > 1e-5
