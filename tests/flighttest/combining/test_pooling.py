import numpy as np
import pytest

from flightmech.errors import IdentificationError
from flighttest.regression.combining.pooling import pool, pool_fits


def test_agreeing_estimates_give_the_inverse_variance_mean():
    joined = pool([1.0, 1.1, 0.95], [0.1, 0.2, 0.1])
    w = np.array([100, 25, 100])
    assert joined.value == pytest.approx((w @ [1.0, 1.1, 0.95]) / w.sum())
    assert joined.stderr == pytest.approx(1 / 15)
    assert joined.birge < 1
    assert not joined.contradictory


def test_contradictory_estimates_widen_the_error_and_are_flagged():
    joined = pool([1.0, 2.0], [0.1, 0.1])
    assert joined.birge == pytest.approx(np.sqrt(50))
    assert joined.stderr == pytest.approx(
        0.5
    )  # half their difference, whatever their own errors are
    assert joined.disagreement == pytest.approx(10 / np.sqrt(2))
    assert joined.contradictory


@pytest.mark.slow
def test_the_pooled_error_is_the_scatter_of_pooled_values():
    """Birge ratio included: 20 estimates each, 2000 times; the mean square of z exceeds 1 by less
    than a tenth.
    """
    rng = np.random.default_rng(2)
    s = rng.uniform(0.5, 2.0, 20)
    z = [(p := pool(s * rng.normal(size=20), s)).value / p.stderr for _ in range(2000)]
    assert 0.75 < np.mean(np.square(z)) < 1.1  # below one because the ratio only ever widens


def test_the_median_does_not_mind_one_outlier():
    joined = pool([1.0, 1.1, 0.9, 1.05, 9.0], [0.1] * 5, "median")
    assert joined.value == 1.05
    assert joined.scatter == pytest.approx(1.4826 * 0.05)
    # the five scatter by chance less than their standard errors of 0.1
    assert joined.stderr == pytest.approx(1.25 * 0.1 / np.sqrt(5))
    wide = pool([1.0, 1.5, 0.4, 1.3, 9.0], [0.1] * 5, "median")
    assert wide.stderr == pytest.approx(1.25 * wide.scatter / np.sqrt(5))
    many = pool([1.0, 1.1, 0.9, 1.05, 9.0, 1.02, 0.98, 1.0], [0.1] * 8, "median")
    assert many.stderr == pytest.approx(1.25 * many.scatter / np.sqrt(8))


def test_the_median_of_few_estimates_has_no_error_of_zero():
    """Two of three estimates are equal: their scatter about the median is zero by chance."""
    joined = pool([1.0, 1.0, 5.0], [0.1, 0.1, 0.1], "median")
    assert joined.scatter == 0.0
    assert joined.stderr == pytest.approx(1.25 * 0.1 / np.sqrt(3))
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(300):
        found = pool(rng.normal(size=3), [1.0] * 3, "median")
        inside += abs(found.value) < 2.0 * found.stderr
    assert inside > 0.93 * 300


def test_what_cannot_be_pooled_is_refused():
    with pytest.raises(IdentificationError, match="one positive standard error per finite value"):
        pool([1.0, 2.0], [0.1, 0.0])
    with pytest.raises(IdentificationError, match="found 0 values"):
        pool([], [])
    with pytest.raises(ValueError, match="allowed: inverse_variance, median, inverse_sigma"):
        pool([1.0], [1.0], "mean")
    with pytest.raises(IdentificationError, match="fits of nothing cannot be pooled"):
        pool_fits([])
