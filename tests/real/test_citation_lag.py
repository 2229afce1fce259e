"""Separable least squares on a real record: the roll rate of the Citation II as a first-order
answer to the ailerons.
"""

import numpy as np
import pytest

import flighttest


@pytest.mark.slow
@pytest.mark.parametrize("year", [2018, 2020])
def test_the_roll_rate_lags_behind_the_ailerons(citation, year):
    """0.21 s in both flights; all data changed in the twelfth digit change it as little."""
    t = citation.start(year, "aperiodic_roll")
    data = flighttest.cut(citation.record(year), t - 2.0, t + 8.0, rate=10.0)[["p", "delta_a"]]
    model = flighttest.RegressionModel.parse("p = 1 + lag(delta_a, tau)", {"tau": (0.05, 4.0)})
    fit = flighttest.separable.regress_separable(model, data)
    tau, error = fit.value("tau")
    assert fit.value("lag(delta_a,tau)")[0] < 0.0
    assert 0.15 < tau < 0.3
    assert 0.0 < error < 2.0 * tau
    noise = np.random.default_rng(0).normal(size=data.sizes["time"])
    moved = flighttest.separable.regress_separable(
        model, data.map(lambda v: v * (1.0 + 1e-12 * noise))
    )
    assert moved.value("tau")[0] == pytest.approx(tau, rel=1e-10)
