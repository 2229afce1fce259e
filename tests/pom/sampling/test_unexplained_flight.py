"""A flight outside the spread of the draws is stated: their probability is not that of the
flight.
"""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pom.samples import SampledReplay


@pytest.fixture
def samples():
    """Forty draws whose bank angle is at 0.00 to 0.04 of its tolerance."""
    bank = np.linspace(0.0, 0.042, 40)
    ratio = pd.DataFrame({"bank_angle": bank, "airspeed": np.linspace(0.0, 0.5, 40)})
    return SampledReplay(
        seed=1,
        database="final.nc",
        status=("pass",) * 40,
        decides=bank,
        ratio=ratio,
        shares=pd.DataFrame(columns=["criterion", "source", "share"]),
        fan=xr.Dataset(),
    )


def test_a_flight_beyond_the_band_is_stated_with_both_numbers(samples):
    assert samples.probability == 1.0
    text = samples.unexplained({"bank_angle": 0.30, "airspeed": 0.3}, "bank_angle")
    assert text.startswith("the spread of the model does not explain the flight")
    assert "bank_angle 0.30 (0.00 to 0.04)" in text
    assert "airspeed" not in text


def test_a_flight_inside_the_band_is_not_stated(samples):
    assert samples.unexplained({"bank_angle": 0.03, "airspeed": 0.49}, "bank_angle") == ""
    assert samples.unexplained({"bank_angle": np.nan}, "bank_angle") == ""


def test_a_criterion_that_does_not_decide_is_compared_with_all_draws(samples):
    """0.49 is above the 95 % quantile of 0.475, as one of twenty criteria is by chance."""
    assert samples.unexplained({"airspeed": 0.49}, "bank_angle") == ""
    assert samples.unexplained({"airspeed": 0.49}, "airspeed") != ""
    assert "airspeed 0.60" in samples.unexplained({"airspeed": 0.6}, "bank_angle")
    assert samples.unexplained({"altitude": 9.0}, "bank_angle") == ""
