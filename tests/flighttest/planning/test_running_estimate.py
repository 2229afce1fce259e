"""Estimates along a manoeuvre: against the regression in frequency, and the end that they allow."""

import numpy as np
import pytest
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flighttest.flight_programme.planning.manoeuvre_end import may_end, running_estimate
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel

MODEL = RegressionModel.parse("Cm = 1 + alpha + qhat + delta_e")
TRUTH = {"alpha": -0.6, "qhat": -12.0, "delta_e": -1.2}
BAND, STEP = (0.2, 2.0), 0.02


def flown(seed, duration=30.0, noise=0.004):
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, STEP)
    lines = np.arange(3, 60) / 30.0

    def multisine(size):
        phase = rng.uniform(0.0, 2.0 * np.pi, len(lines))
        return (
            size * np.cos(2 * np.pi * np.outer(t, lines) + phase).sum(axis=1) / np.sqrt(len(lines))
        )

    d = {
        "alpha": 0.05 + 0.0005 * t + multisine(0.03),
        "qhat": multisine(0.002),
        "delta_e": -0.03 + multisine(0.03),
    }
    d["Cm"] = 0.04 + sum(TRUTH[name] * x for name, x in d.items()) + noise * rng.normal(size=len(t))
    return xr.Dataset({name: ("time", x) for name, x in d.items()}, {"time": t})


def test_at_the_end_it_is_the_regression_in_frequency():
    data = flown(1, 12.0)
    running = running_estimate(MODEL, data, BAND, spacing=1 / 12)
    assert len(np.unique(running["time"])) == 12
    last = running.isel(time=-1)
    whole = regress_frequency(MODEL, data, BAND, spacing=1 / 12).estimates.sel(term=last["term"])
    np.testing.assert_allclose(last["estimate"], whole["estimate"], rtol=1e-10)
    np.testing.assert_allclose(last["stderr"], whole["stderr"], rtol=1e-9)
    # The first estimate comes after one period of 0.2 Hz.
    known = np.isfinite(running["stderr"].sel(term="alpha").values)
    np.testing.assert_array_equal(known, running["time"].values > 4.9)


def test_the_end_is_where_the_errors_stay_below_their_bounds():
    running = running_estimate(MODEL, flown(2), BAND)
    bound = float(running["stderr"].sel(term="qhat").sel(time=15.0, method="nearest"))
    end = may_end(running, {"qhat": bound})
    assert 2.0 < end < 20.0
    assert np.isnan(may_end(running, {"qhat": 1e-9}))
    # the future does not matter
    assert end == may_end(running.sel(time=slice(0, end)), {"qhat": bound})


def test_too_little_is_unknown_and_faults_are_stated():
    assert np.isnan(running_estimate(MODEL, flown(4, 2.5), BAND)["estimate"]).all()
    with pytest.raises(IdentificationError):
        running_estimate(MODEL, flown(4, 2.5), (2.0, 0.1))
    with pytest.raises(UnknownName, match="Cm"):
        running_estimate(MODEL, flown(4, 2.5).drop_vars("Cm"), BAND)
    with pytest.raises(UnknownName, match="beta"):
        may_end(running_estimate(MODEL, flown(5, 6.0), BAND), {"beta": 0.1})
