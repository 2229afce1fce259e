import numpy as np
import pytest
from scipy.linalg import toeplitz

from flighttest.autoregression import Disturbance, disturbance
from flighttest.covariance import coloured, colours

FREE = Disturbance(np.array([-0.9, 0.3, 0.2]), 1.0)


def test_the_autocovariance_is_that_of_the_recursion():
    """Yule and Walker: r_k + a_1 r_(k-1) + ... = 0 for k > 0, the variance of the innovation at k = 0."""
    r, a = FREE.autocovariance(40), FREE.coefficients
    for k in range(40):
        total = sum(a[i] * r[abs(k - i)] for i in range(4))
        assert total == pytest.approx(1.0 if k == 0 else 0.0, abs=1e-12)
    np.testing.assert_allclose(FREE.autocovariance(2), r[:2])


def test_samples_have_the_autocovariance_from_the_first_on():
    """Four thousand stretches; the covariances scatter by 2.2 % of the variance (one sigma)."""
    rng = np.random.default_rng(0)
    found = np.cov(np.array([FREE.sample(8, rng) for _ in range(4000)]).T)
    r = FREE.autocovariance(8)
    np.testing.assert_allclose(found, toeplitz(r), atol=0.1 * r[0])


def test_innovations_of_a_sample_are_white_of_the_stated_variance():
    e = FREE.innovations(FREE.sample(20_000, np.random.default_rng(1)))
    assert np.var(e) == pytest.approx(1.0, rel=0.04)  # four standard deviations
    lags = [abs(e[k:] @ e[:-k]) / (e @ e) for k in range(1, 6)]
    assert max(lags) < 4 / np.sqrt(len(e))


def test_restricted_likelihood_finds_the_slow_part_that_a_fit_has_taken_up():
    """Memory of 1 s in 10 s, intercept and three slow regressors: the residual has lost most of the variance of its mean."""
    truth = Disturbance(np.array([-np.exp(-0.08)]), 1.0 - np.exp(-0.16))  # 0.08 s per sample, variance one
    t = 0.08 * np.arange(125)
    X = np.stack([np.ones(125), np.sin(0.5 * t), np.cos(0.5 * t), np.sin(1.1 * t)], axis=1)
    A = np.linalg.pinv(X)
    expected = (A @ toeplitz(truth.autocovariance(125)) @ A.T)[0, 0]
    found, naive = [], []
    for seed in range(60):
        v = truth.sample(125, np.random.default_rng(seed))
        v = v - X @ (A @ v)
        r = disturbance(X, v, [slice(0, 125)]).autocovariance(125)
        found.append((A @ toeplitz(r) @ A.T)[0, 0])
        windowed = np.array([(v[: 125 - k] @ v[k:]) / 125 * max(0.0, 1 - k / 12) for k in range(125)])
        naive.append((A @ toeplitz(windowed) @ A.T)[0, 0])
    assert np.median(found) > 0.35 * expected  # skewed: some of the sixty see hardly any slow part
    assert np.median(naive) < 0.6 * np.median(found)


def test_no_residual_is_no_disturbance():
    X = np.ones((50, 1))
    nothing = disturbance(X, np.zeros(50), [slice(0, 50)])
    assert not nothing.autocovariance(5).any()
    covariance, offset = coloured(X, np.zeros(50), [slice(0, 50)], [0.02])
    assert covariance[0, 0] == 0.0
    assert offset == 0.0


def test_what_differs_between_stretches_as_a_constant_is_no_slow_disturbance():
    rng = np.random.default_rng(2)
    pieces = [slice(500 * k, 500 * (k + 1)) for k in range(8)]
    v = rng.normal(size=4000) + np.repeat(5.0 * rng.normal(size=8), 500)
    found = colours(np.ones((4000, 1)), v - v.mean(), pieces, [0.02] * 8)
    slow = sum(found[0].model.autocovariance(100)) / found[0].model.autocovariance(1)[0]
    assert slow < 3.0  # white would be one; the offsets would make it near a hundred
    assert coloured(np.ones((4000, 1)), v - v.mean(), pieces, [0.02] * 8)[1] == pytest.approx(5.0, rel=0.6)
