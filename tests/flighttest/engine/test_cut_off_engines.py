"""Records of propellers with an engine cut off."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.errors import IdentificationError
from flighttest.submodels.engine.propellers.points import cut_off_samples, propeller_points

DATA = Path(__file__).parents[3] / "data"
TIME = np.arange(0.0, 24.0, 0.1)


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(DATA / "c182" / "aircraft.toml")


def flown(**channels):
    constant = {"V": 55.0, "h": 1500.0, "engine1.rpm": 230.0, "engine1.throttle": 0.6}
    columns = {}
    for name, value in (constant | channels).items():
        columns[name] = "time", np.broadcast_to(value, TIME.shape).astype(float)
    return xr.Dataset(columns, {"time": TIME})


def test_windows_with_an_engine_cut_off_are_no_points(aircraft):
    points = propeller_points([flown(**{"engine1.cutoff": TIME > 13.0})], aircraft)
    assert points.sizes["point"] == 2
    assert points.attrs["left_out"] == "2 windows with an engine cut off"
    with pytest.raises(IdentificationError, match="4 with an engine cut off"):
        propeller_points([flown(**{"engine1.cutoff": 1.0})], aircraft)


def test_a_feathered_propeller_remains(aircraft):
    states = flown(**{"engine1.cutoff": 1.0, "engine1.feather": 1.0})
    assert not cut_off_samples(states, 1).any()
