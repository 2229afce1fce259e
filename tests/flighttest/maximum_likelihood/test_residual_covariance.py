"""Covariance of the maximum of a likelihood for coloured residuals."""

import numpy as np
import scipy

from flighttest.maximum_likelihood.likelihood import CONVERGED, LikelihoodMaximum
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance

STEP, LONG, SHORT = 0.25, 48, (1, 2, 3, 5) * 10


def test_manoeuvres_of_a_few_samples_have_the_memory_of_the_longest_one():
    """A disturbance of 15 s in one stretch of 12 s and in 40 of 0.25 to 1.25 s."""
    rng = np.random.default_rng(7)
    lengths = (LONG, *SHORT)
    slopes, readings = [], []
    for count in lengths:
        # A reading has a constant and a motion, both with a coefficient of one.
        S = np.column_stack([np.ones(count), rng.normal(size=count)])
        pole = np.exp(-STEP / 15.0)
        white = np.sqrt(1.0 - pole**2) * rng.normal(size=count + 400)
        disturbance = scipy.signal.lfilter([1.0], [1.0, -pole], white)[400:]
        slopes.append(S)
        readings.append(S.sum(axis=1) + disturbance + 0.1 * rng.normal(size=count))
    M = sum(S.T @ S for S in slopes)
    theta = np.linalg.solve(M, sum(S.T @ z for S, z in zip(slopes, readings)))
    maximum = LikelihoodMaximum(
        theta=theta,
        residuals=[(z - S @ theta)[:, None] for S, z in zip(slopes, readings)],
        slopes=[S[:, None, :] for S in slopes],
        noise=np.ones((len(lengths), 1)),
        information=M,
        active=np.zeros(2, bool),
        cost=0.0,
        iterations=1,
        stop=CONVERGED,
        remaining=np.zeros(2),
    )
    columns = [np.arange(2)] * len(lengths)
    covariance, (colour,) = coloured_likelihood_covariance(maximum, columns, [STEP] * len(lengths))
    assert colour.disturbance.reflections[0] < -0.9
    # The same sum over all pairs of samples, with the autocovariance of this disturbance.
    r = colour.disturbance.autocovariance(LONG)
    inner = sum(S.T @ scipy.linalg.toeplitz(r[: len(S)]) @ S for S in slopes)
    exact = np.linalg.solve(M, np.linalg.solve(M, inner).T)
    np.testing.assert_allclose(np.diag(covariance), np.diag(exact), rtol=0.05)
