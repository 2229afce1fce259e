"""What a fit predicts of other data, and the warning where these leave the samples that were
fitted.
"""

import warnings

import numpy as np
import pytest
import xarray as xr
from flown_lift import LIFT, TRUTH, record

import flighttest
from flightmech.errors import AeromatchWarning, IdentificationError, SchemaError, UnknownName
from flightmech.units import DEGREE


@pytest.fixture(scope="module")
def flown():
    return record(np.random.default_rng(0))


@pytest.fixture(scope="module")
def fit(flown):
    return flighttest.regress(LIFT, flown, "run 1")


def inside(flown):
    """Middle of the fitted range, along another dimension."""
    return xr.Dataset(
        {
            name: ("case", np.quantile(flown[name], [0.3, 0.5, 0.7]))
            for name in ("alpha", "qhat", "delta_e")
        }
    )


def test_the_fitted_samples_are_predicted_without_a_warning(fit, flown):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fit.predict(flown)
    np.testing.assert_allclose(flown["CL"].values - found["CL"].values, fit.residual, atol=1e-14)
    assert found["CL"].dims == ("time",)
    np.testing.assert_array_equal(found["time"], flown["time"])
    assert found["CL"].attrs["units"] == "1"


def test_the_standard_error_is_that_of_the_mean(fit, flown):
    """By hand at one point, and no extrapolation is hidden: twice as far from the mean, almost
    twice the error.
    """
    data = inside(flown)
    x = np.array([1.0, *(float(data[name][1]) for name in ("alpha", "qhat", "delta_e"))])
    e = fit.estimates
    assert e["systematic"].size == 0
    found = fit.predict(data)
    assert found["stderr"].dims == ("case",)
    assert float(found["stderr"][1]) == pytest.approx(
        np.sqrt(x @ e["covariance"].values @ x), rel=1e-12
    )


def test_systematic_errors_of_the_measurement_are_in_the_standard_error(flown):
    data = flown.assign_coords(error=["qbar"]).assign(
        CL_error=(("error", "time"), 0.05 * flown["CL"].values[None])
    )
    found = flighttest.regress(LIFT, data).predict(inside(flown))
    plain = flighttest.regress(LIFT, flown).predict(inside(flown))
    np.testing.assert_allclose(
        found["stderr"] ** 2 - plain["stderr"] ** 2, (0.05 * plain["CL"]) ** 2, rtol=1e-9
    )


@pytest.mark.nightly
def test_two_standard_errors_cover_the_true_mean():
    """40 records, one point each in the middle and at the edge: 95.0 % over 400 records; 80 draws
    scatter by 3 %.
    """
    hit = []
    for seed in range(40):
        flown = record(np.random.default_rng(100 + seed))
        point = xr.Dataset(
            {
                name: ("sample", np.quantile(flown[name], [0.4, 0.95]))
                for name in ("alpha", "qhat", "delta_e")
            }
        )
        found = flighttest.regress(LIFT, flown).predict(point)
        truth = TRUTH["1"] + sum(TRUTH[name] * point[name] for name in point)
        hit.append(np.abs(found["CL"] - truth) < 2 * found["stderr"])
    assert np.mean(hit) > 0.85


def test_variables_outside_the_fitted_range_are_named_with_both_ranges(fit, flown):
    data = inside(flown)
    data["alpha"][2] = 30.0 * DEGREE
    low, high = (float(x) / DEGREE for x in (flown["alpha"].min(), flown["alpha"].max()))
    with pytest.warns(
        AeromatchWarning,
        match="run 1: CL = 1 .* outside the fitted range: alpha is .* 30 deg, fitted over",
    ) as caught:
        fit.predict(data)
    text = str(caught[0].message)
    assert f"fitted over {low:.4g} deg ... {high:.4g} deg (1 of 3 samples outside)" in text
    assert "qhat" not in text.split("range:")[1]
    assert caught[0].filename == __file__


def test_a_product_can_leave_its_range_while_its_variables_do_not(flown):
    """alpha and elevator never were large together."""
    x, y = flown["alpha"].values, flown["delta_e"].values
    apart = flown.isel(time=np.abs(x / np.abs(x).max()) + np.abs(y / np.abs(y).max()) < 0.8)
    fit = flighttest.regress(
        flighttest.RegressionModel.parse("CL = 1 + alpha + delta_e + alpha*delta_e"), apart
    )
    data = xr.Dataset(
        {
            "alpha": ("sample", [apart["alpha"].values.max()]),
            "delta_e": ("sample", [apart["delta_e"].values.max()]),
        }
    )
    with pytest.warns(AeromatchWarning, match=r"range: alpha\*delta_e is") as caught:
        fit.predict(data)
    assert "alpha is" not in str(caught[0].message)


def test_separate_intercepts_ask_which(flown):
    parts = [record(np.random.default_rng(5), 10.0, 0.0, offset) for offset in (0.0, 0.1)]
    fit = flighttest.regress(LIFT, parts, intercepts="separate")
    np.testing.assert_allclose(fit.predict(parts[1], manoeuvre=1)["CL"], parts[1]["CL"], atol=1e-12)
    np.testing.assert_allclose(
        fit.predict(parts[1], manoeuvre=0)["CL"], parts[1]["CL"] - 0.1, atol=1e-12
    )
    with pytest.raises(
        IdentificationError,
        match=r"a constant for each manoeuvre, 1\[0\], 1\[1\]; choose one with manoeuvre=",
    ):
        fit.predict(parts[1])
    with pytest.raises(UnknownName, match=r"unknown intercept '1\[2\]'"):
        fit.predict(parts[1], manoeuvre=2)


def test_a_reference_and_a_frequency_fit_predict_too(flown):
    shifted = flighttest.RegressionModel("CL", LIFT.terms, {"alpha": 0.05})
    found = flighttest.regress(shifted, flown).predict(flown)
    np.testing.assert_allclose(
        found["CL"], flighttest.regress(LIFT, flown).predict(flown)["CL"], atol=1e-12
    )
    band = flighttest.equation_error.regress_frequency(LIFT, flown, (0.1, 1.0))
    np.testing.assert_allclose(
        flown["CL"].values - band.predict(flown)["CL"].values, band.residual, atol=1e-12
    )


def test_scalars_gaps_and_bad_data(fit, flown):
    one = fit.predict(xr.Dataset({"alpha": 0.02, "qhat": 0.0, "delta_e": 0.0}))
    assert float(one["CL"][0]) == pytest.approx(
        float(fit.estimates["estimate"] @ xr.DataArray([1.0, 0.02, 0.0, 0.0], dims="term"))
    )
    gap = flown.copy(deep=True)
    gap["alpha"][3] = np.nan
    found = fit.predict(gap)
    assert np.isnan(found["CL"][3])
    assert int(np.isnan(found["CL"]).sum()) == 1
    with pytest.raises(UnknownName, match="unknown model variable 'qhat'"):
        fit.predict(flown.drop_vars("qhat"))
    with pytest.raises(SchemaError, match="have the dimensions time, run; one is allowed"):
        fit.predict(flown.assign(delta_e=flown["delta_e"] * xr.DataArray([1.0, 2.0], dims="run")))
