import numpy as np
import pytest
from scipy.linalg import toeplitz

from flighttest.regression.uncertainty.residual_spectrum import Disturbance

FREE = Disturbance(np.array([-0.9, 0.3, 0.2]), 1.0)


def test_the_autocovariance_is_that_of_the_recursion():
    """Yule and Walker: r_k + a_1 r_(k-1) + ... = 0 for k > 0, the variance of the innovation at k =
    0.
    """
    r, a = FREE.autocovariance(40), FREE.coefficients
    for k in range(40):
        total = sum(a[i] * r[abs(k - i)] for i in range(4))
        assert total == pytest.approx(1.0 if k == 0 else 0.0, abs=1e-12)
    np.testing.assert_allclose(FREE.autocovariance(2), r[:2])


@pytest.mark.slow
def test_samples_have_the_autocovariance_from_the_first_on():
    """Four thousand stretches; the covariances scatter by 2.2 % of the variance (one sigma)."""
    rng = np.random.default_rng(0)
    found = np.cov(np.array([FREE.sample(8, rng) for _ in range(4000)]).T)
    r = FREE.autocovariance(8)
    np.testing.assert_allclose(found, toeplitz(r), atol=0.1 * r[0])


def test_the_autoregression_of_an_autocovariance_is_the_one_it_came_from():
    again = Disturbance.of_autocovariance(FREE.autocovariance(6))
    np.testing.assert_allclose(again.reflections, [-0.9, 0.3, 0.2, 0.0, 0.0], atol=1e-12)
    assert again.variance == pytest.approx(1.0)


def test_innovations_of_a_sample_are_white_of_the_stated_variance():
    e = FREE.innovations(FREE.sample(20_000, np.random.default_rng(1)))
    assert np.var(e) == pytest.approx(1.0, rel=0.04)  # four standard deviations
    lags = [abs(e[k:] @ e[:-k]) / (e @ e) for k in range(1, 6)]
    assert max(lags) < 4 / np.sqrt(len(e))


def test_innovations_from_the_first_sample_on_undo_the_covariance():
    """v'R^-1 v of nine samples, and of fewer than the order."""
    for size in (9, 2):
        v = np.random.default_rng(2).normal(size=size)
        assert np.sum(FREE.innovations(v) ** 2) == pytest.approx(
            v @ np.linalg.solve(toeplitz(FREE.autocovariance(size)), v)
        )
