"""Running estimates: against the regression in frequency at the end, and their standard errors
against the scatter.
"""

import numpy as np
import pytest
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flighttest.flight_programme.planning.recursive_fourier import (
    RunningEstimate,
    may_end,
    running_estimate,
)
from flighttest.regression.equation_error.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel

MODEL = RegressionModel.parse("Cm = 1 + alpha + qhat + delta_e")
TRUTH = {"alpha": -0.6, "qhat": -12.0, "delta_e": -1.2}
BAND, STEP = (0.1, 2.0), 0.02


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
    """The transforms are plain sums and the trend is solved for: at most 0.12 standard errors
    apart, measured.
    """
    data = flown(1)
    last = running_estimate(MODEL, data, BAND, spacing=1 / 30).isel(time=-1)
    whole = regress_frequency(MODEL, data, BAND).estimates.sel(term=last["term"].values)
    assert (np.abs(last["estimate"] - whole["estimate"]) < 0.5 * whole["stderr"]).all()
    np.testing.assert_allclose(last["stderr"], whole["stderr_white"], rtol=0.15)


@pytest.mark.parametrize("duration", [6.0, 12.0, 30.0])
@pytest.mark.slow
def test_standard_errors_are_the_scatter(duration):
    z = []
    for seed in range(40):
        data = flown(seed, duration)
        running = RunningEstimate(MODEL, BAND)
        running.add(data)
        estimate, stderr = running.estimate()
        z.append((estimate - np.array([TRUTH[name] for name in running.terms])) / stderr)
    assert (
        0.75 < np.sqrt(np.mean(np.square(z))) < 1.3
    )  # 120 numbers: 0.94 to 1.06 expected when exact


def test_the_end_is_where_the_errors_stay_below_their_bounds():
    running = running_estimate(MODEL, flown(2), BAND)
    bound = float(running["stderr"].sel(term="qhat").sel(time=15.0, method="nearest"))
    end = may_end(running, {"qhat": bound})
    assert 2.0 < end < 20.0
    assert np.isnan(may_end(running, {"qhat": 1e-9}))
    assert end == may_end(
        running.sel(time=slice(0, end)), {"qhat": bound}
    )  # the future does not matter


def test_parts_of_a_record_add_up_to_the_whole():
    data = flown(3)
    whole, parts = RunningEstimate(MODEL, BAND), RunningEstimate(MODEL, BAND)
    whole.add(data)
    for k in range(0, data.sizes["time"], 100):
        parts.add(data.isel(time=slice(k, k + 100)))
    np.testing.assert_allclose(parts.estimate(), whole.estimate(), rtol=1e-9)


def test_too_little_is_unknown_and_faults_are_stated():
    running = RunningEstimate(MODEL, BAND)
    assert np.isnan(running.estimate()).all()
    running.add(flown(4, 0.5))
    assert np.isnan(running.estimate()).all()
    with pytest.raises(IdentificationError, match="expected 0 < low < high"):
        RunningEstimate(MODEL, (2.0, 0.1))
    with pytest.raises(UnknownName, match="Cm"):
        running.add(flown(4).drop_vars("Cm"))
    with pytest.raises(UnknownName, match="beta"):
        may_end(running_estimate(MODEL, flown(5), BAND), {"beta": 0.1})
