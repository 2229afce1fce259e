"""Running estimates on the short periods of the Citation II, against the regression in frequency of
the whole manoeuvre.
"""

import numpy as np
import pytest

from flighttest.flight_programme.planning.recursive_fourier import may_end, running_estimate
from flighttest.regression.equation_error.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel

MODEL, BAND = RegressionModel.parse("Cm = 1 + alpha + qhat + delta_e"), (0.1, 1.5)


@pytest.mark.slow
@pytest.mark.parametrize(("year", "end"), [(2018, 5.5), (2020, 10.5)])
def test_short_period(citation, year, end):
    data = citation.coefficients(year, "short_period", -3.0, 14.0)
    running = running_estimate(MODEL, data, BAND)
    whole = regress_frequency(MODEL, data, BAND).estimates.sel(term=running["term"].values)
    assert (
        np.abs(running["estimate"].isel(time=-1) - whole["estimate"]) < 1.5 * whole["stderr"]
    ).all()  # 0.93 measured
    # white inside the band: 0.4 to 0.7 of the standard error that follows the spectrum of the
    # residual
    ratio = (running["stderr"].isel(time=-1) / whole["stderr"]).values
    assert (ratio > 0.3).all()
    assert (ratio < 1.0).all()
    found = may_end(running, {"delta_e": 0.05, "alpha": 0.05})
    assert found - float(data["time"][0]) == pytest.approx(end, abs=0.6)
    same = running_estimate(MODEL, data * (1.0 + 1e-12), BAND)
    for name in ("estimate", "stderr"):
        np.testing.assert_allclose(same[name], running[name], rtol=1e-10)
