"""Estimates along the short periods of the Citation II, against the regression in frequency of the
whole manoeuvre, and the end that they allow.
"""

import numpy as np
import pytest

from flighttest.flight_programme.planning.manoeuvre_end import may_end, running_estimate
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel

MODEL, BAND = RegressionModel.parse("Cm = 1 + alpha + qhat + delta_e"), (0.1, 1.5)


@pytest.mark.slow
@pytest.mark.parametrize("year", [2018, 2020])
def test_short_period(citation, year):
    data = citation.coefficients(year, "short_period", -3.0, 14.0)
    running = running_estimate(MODEL, data, BAND)
    whole = regress_frequency(MODEL, data, BAND, spacing=0.01).estimates.sel(term=running["term"])
    last = running.isel(time=-1)
    np.testing.assert_allclose(last["estimate"], whole["estimate"], rtol=1e-10)
    np.testing.assert_allclose(last["stderr"], whole["stderr"], rtol=1e-8)
    found = may_end(running, {"delta_e": 0.1, "alpha": 0.1})
    assert found - float(data["time"][0]) == pytest.approx(12.0, abs=0.1)
    assert np.isnan(may_end(running, {"delta_e": 0.05, "alpha": 0.05}))
