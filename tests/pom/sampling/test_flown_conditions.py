"""Variables of terms along a flight, formed from what its states hold."""

import numpy as np
import pytest
import xarray as xr

import aerodb
from flightmech import terms
from pom.diagnosis.sampling.shares import flown_conditions

ROOT = {
    "title": "t",
    "aircraft": "t",
    "S": 16.0,
    "cbar": 1.6,
    "b": 10.0,
    "x_ref": 0.0,
    "y_ref": 0.0,
    "z_ref": 0.0,
}
ROOT |= {"force_axes": "stability", "source": "by hand", "history": "by hand", "absent": ""}


def test_thrust_coefficient_is_that_of_all_engines_over_qbar_and_the_wing():
    power = {"Cm/power": terms.make_term(0.05, regressors=["CT"])}
    db = aerodb.make_database(power, **ROOT)
    time = np.arange(3.0)
    thrust = {"engine1.thrust": [800.0] * 3, "engine2.thrust": [800.0, 0.0, -800.0]}
    flight = {
        "alpha": 0.0 * time,
        "beta": 0.0 * time,
        "V": 50.0 + time,
        "qbar": [1000.0, 2000.0, 4000.0],
        **thrust,
    }
    states = xr.Dataset({name: ("time", x) for name, x in flight.items()}, {"time": time})
    samples = flown_conditions(db, power, states)
    assert samples["CT"] == pytest.approx([1600.0 / 16000.0, 800.0 / 32000.0, 0.0])
