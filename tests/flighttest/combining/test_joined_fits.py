import numpy as np
import pytest
from flown_lift import LIFT, TRUTH, record

from flightmech.errors import IdentificationError
from flighttest.regression.combining.joined_fits import join_fits
from flighttest.regression.combining.pooling import pool
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress


def fits(count=8, **options):
    return [
        regress(LIFT, record(np.random.default_rng(seed), **options), f"run {seed}")
        for seed in range(count)
    ]


@pytest.mark.slow
def test_the_median_is_that_of_gresham_term_by_term():
    runs = fits()
    joined = join_fits(runs, "median")
    values = np.array([fit.estimates["estimate"].values for fit in runs])
    np.testing.assert_allclose(joined.estimates["estimate"], np.median(values, axis=0))
    scatter = 1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0)
    np.testing.assert_allclose(joined.estimates["scatter"], scatter)
    np.testing.assert_allclose(joined.estimates["stderr"], 1.25 * scatter / np.sqrt(8))


@pytest.mark.nightly
def test_the_median_does_not_mind_a_record_that_went_wrong():
    good = fits()
    bad = regress(LIFT, record(np.random.default_rng(50)).assign(alpha=lambda d: 0.5 * d["alpha"]))
    joined = join_fits([*good, bad], "median")
    assert float(joined.estimates["estimate"].sel(term="alpha")) == pytest.approx(5.0, abs=0.15)
    assert any(text.startswith("alpha: two fits are") for text in map(str, joined.remarks))
    assert float(join_fits([*good, bad]).estimates["birge"].sel(term="alpha")) > 5


def test_the_generalised_mean_is_the_sum_of_the_information():
    runs = fits(4)
    joined = join_fits(runs).estimates
    inverse = [np.linalg.inv(fit.estimates["covariance"].values) for fit in runs]
    C = np.linalg.inv(sum(inverse))
    theta = C @ sum(P @ fit.estimates["estimate"].values for P, fit in zip(inverse, runs))
    np.testing.assert_allclose(joined["estimate"], theta, rtol=1e-8)
    inflated = np.sqrt(np.diag(C)) * np.maximum(1.0, joined["birge"])
    np.testing.assert_allclose(joined["stderr"], inflated, rtol=1e-8)
    assert {"estimate", "stderr", "stderr_white", "correlation", "systematic"} <= set(
        joined.data_vars
    )


@pytest.mark.slow
@pytest.mark.nightly
def test_joined_estimates_cover():
    """30 sets of eight records; 0.95 of 120 estimates scatters by 2 to 4 %."""
    inside = []
    for base in range(30):
        runs = [
            regress(LIFT, record(np.random.default_rng(100 * base + k), 15.0)) for k in range(8)
        ]
        e = join_fits(runs).estimates
        inside.append(np.abs(e["estimate"].values - list(TRUTH.values())) < 2 * e["stderr"].values)
    assert np.mean(inside) > 0.88


def test_terms_of_some_fits_and_fits_of_both_domains():
    data = [record(np.random.default_rng(seed)) for seed in range(3)]
    runs = [
        regress(LIFT, data[0]),
        regress_frequency(LIFT, data[1], (0.1, 1.0)),
        regress(RegressionModel.parse("CL = 1 + alpha"), data[2]),
    ]
    joined = join_fits(runs, "inverse_sigma")
    assert joined.estimates["count"].sel(term="qhat") == 2
    values, errors = zip(
        *((float(f.estimates["estimate"][1]), float(f.estimates["stderr"][1])) for f in runs)
    )
    assert float(joined.estimates["estimate"].sel(term="alpha")) == pytest.approx(
        pool(values, errors, "inverse_sigma").value
    )
    assert "3 fits joined by inverse sigma" in joined.report()


def test_what_cannot_be_joined_is_refused():
    with pytest.raises(IdentificationError, match="fits of nothing cannot be joined"):
        join_fits([])
    with pytest.raises(ValueError, match="allowed: inverse_variance, median, inverse_sigma"):
        join_fits(fits(1), "mean")
