"""Output error in time for linear models: against the filter error without gusts, over many
records, and on what records hold.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from test_filter_error import NOISE, STARTS, TRUTH, errors, flight
from test_filter_error import model as model  # the fixture

import flighttest
from flightmech.errors import AeromatchWarning, IdentificationError, SchemaError, UnknownName
from flighttest.maximum_likelihood.unknowns import Unknown


def test_it_is_the_filter_error_without_gusts(model):
    """There the noise is searched for, here it is that of the residuals: one maximum, one set of
    standard errors.
    """
    record = flight(1)
    found, other = (
        flighttest.maximum_likelihood.linear_output_error(model, record, STARTS),
        flighttest.maximum_likelihood.filter_error(model, record, STARTS),
    )
    names = list(TRUTH)
    a, b = (fit.estimates.sel(parameter=names) for fit in (found, other))
    np.testing.assert_allclose(a["estimate"], b["estimate"], atol=0.02 * float(a["stderr"].min()))
    np.testing.assert_allclose(a["stderr"], b["stderr"], rtol=0.02)
    np.testing.assert_allclose(found.noise["stderr"].values[0], NOISE, rtol=0.15)
    assert found.warnings == ()
    assert found.estimates.attrs["method"] == "output error in time, linear model"
    assert list(found.estimates["parameter"].values) == names


def test_without_noise_the_truth_is_found(model):
    record = flight(2, noise=0.0)
    found = flighttest.maximum_likelihood.linear_output_error(model, record, STARTS).parameters
    np.testing.assert_allclose(
        list(found.values()), list(TRUTH.values()), rtol=1e-4
    )  # the record integrates its input in ten steps


@pytest.mark.nightly
def test_two_standard_errors_cover_the_truth(model):
    """25 records, four unknowns; 94.6 % within two standard errors over 200 records."""
    inside = [
        np.abs(
            errors(
                flighttest.maximum_likelihood.linear_output_error(
                    model, flight(seed, duration=12.0), STARTS
                )
            )
        )
        < 2.0
        for seed in range(25)
    ]
    assert np.mean(inside) > 0.88


@pytest.mark.slow
def test_starts_instruments_drift_and_gaps(model):
    """A record cut in mid-motion, one zero off, a constant in a rate, half of the readings of one
    output absent.
    """
    record = flight(6).isel(time=slice(60, None))
    record["nz"] = record["nz"] + 1.0
    record["q"][::2] = np.nan
    free = {"sensor.nz": 0.0, "init.alpha": 0.0, "init.q": 0.0, "drift.q": 0.0}
    fit = flighttest.maximum_likelihood.linear_output_error(model, record, STARTS | free)
    assert np.abs(errors(fit)).max() < 3.0
    assert abs(fit.parameters["sensor.nz"] - 1.0) < 0.02
    assert abs(fit.parameters["drift.q"]) < 3.0 * fit.estimates["stderr"].sel(parameter="drift.q")
    np.testing.assert_array_equal(np.isnan(fit.residuals[0]["q"]), np.isnan(record["q"]))
    whole = flighttest.maximum_likelihood.linear_output_error(
        model, flight(6).isel(time=slice(60, None)), STARTS | {"init.alpha": 0.0, "init.q": 0.0}
    )
    assert float(fit.estimates["stderr_white"].sel(parameter="A[q,q]")) > float(
        whole.estimates["stderr_white"].sel(parameter="A[q,q]")
    )


def test_several_records_with_a_noise_and_a_start_of_their_own(model):
    records = [
        flight(1, duration=12.0),
        flight(2, duration=12.0, noise=3.0).isel(time=slice(50, None)),
    ]
    unknowns = STARTS | {f"init.{name}": Unknown(0.0, own=True) for name in model.states}
    fit = flighttest.maximum_likelihood.linear_output_error(model, records, unknowns, noise="own")
    assert np.abs(errors(fit)).max() < 3.0
    np.testing.assert_allclose(fit.noise["stderr"].values, [NOISE, 3.0 * NOISE], rtol=0.2)
    assert set(fit.of_manoeuvre(2)) == set(STARTS) | {"init.alpha", "init.q"}


def test_a_prior_and_a_bound_hold(model):
    fit = flighttest.maximum_likelihood.linear_output_error(
        model,
        flight(1),
        STARTS
        | {"A[q,q]": (-1.5, 1e-6), "B[q,delta_e]": Unknown(-8.0, high=-9.5, low=-12.0)}
        | {"B[q,delta_e]": Unknown(-10.0, low=-12.0, high=-9.5)},
    )
    assert fit.parameters["A[q,q]"] == pytest.approx(-1.5, abs=1e-5)
    row = fit.estimates.sel(parameter="B[q,delta_e]")
    assert (int(row["active"]), float(row["estimate"])) == (1, -9.5)


def test_turbulence_is_warned_of(model):
    with pytest.warns(
        AeromatchWarning,
        match=r"turbulence or a missing term: .*flighttest\.maximum_likelihood\.filter_error",
    ) as caught:
        fit = flighttest.maximum_likelihood.linear_output_error(model, flight(3, gust=1.0), STARTS)
    assert "turbulence" in fit.report()
    assert caught[0].filename == __file__


def test_bad_requests_are_refused_by_name(model):
    record = flight(1, duration=5.0)
    with pytest.raises(UnknownName, match=r"unknown parameter 'process\.q'"):
        flighttest.maximum_likelihood.linear_output_error(
            model, record, STARTS | {"process.q": 0.01}
        )
    with pytest.raises(UnknownName, match="unknown signal 'nz'"):
        flighttest.maximum_likelihood.linear_output_error(model, record.drop_vars("nz"), STARTS)
    with pytest.raises(IdentificationError, match=r"no output responds to B\[q,delta_e\]"):
        flighttest.maximum_likelihood.linear_output_error(
            model, record.assign(delta_e=0.0 * record["delta_e"]), {"B[q,delta_e]": -8.0}
        )
    few = record.copy(deep=True)
    few["q"][8:] = np.nan
    with pytest.raises(IdentificationError, match="q has fewer than 9 readings"):
        flighttest.maximum_likelihood.linear_output_error(model, few, STARTS)
    record["delta_e"][7] = np.nan
    with pytest.raises(SchemaError, match="delta_e is not finite in 1 samples"):
        flighttest.maximum_likelihood.linear_output_error(model, record, STARTS)
    with pytest.raises(IdentificationError, match="cannot be flown"):
        flighttest.maximum_likelihood.linear_output_error(
            model, flight(1, duration=20.0), STARTS | {"A[q,q]": 1e4}
        )
