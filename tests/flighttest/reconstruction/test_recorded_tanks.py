"""Recorded contents of tanks give mass and centre of gravity where the record has none."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.tank import Tank
from flighttest.reconstruction.path_quantities import _cg_along, _mass_along
from flighttest.reconstruction.problem.record_inputs import RecordInputs
from flighttest.records.sensors.measurements import MeasuredChannels

TANKS = (
    Tank((0.0, -2.0, 0.0), 200.0, name="left", content=150.0),
    Tank((0.0, 2.0, 0.0), 200.0, name="right", content=150.0),
)
TIME = np.arange(0.0, 10.0, 0.5)


@pytest.fixture
def craft() -> flightmech.Aircraft:
    engine = flightmech.aircraft.Engine((0.0, 0.0, 0.0), feed=("left", "right"))
    return flightmech.Aircraft(
        name="tanks",
        S=17.0,
        cbar=1.67,
        b=10.3,
        mass=2300.0,
        Ixx=10800.0,
        Iyy=8100.0,
        Izz=15100.0,
        engines=(engine,),
        fuel=Fuel(300.0, tanks=TANKS),
    )


def test_the_mass_follows_the_contents(craft):
    slow = xr.Dataset({"tank.left.fuel": ("time", 140.0 - TIME)}, {"time": TIME})
    record = xr.DataTree.from_dict({"/slow": slow})
    mass = _mass_along(record, np.array([0.0, 4.25]), craft)
    np.testing.assert_allclose(mass, [2290.0, 2285.75], rtol=1e-14)
    gauged = slow.assign(mass=("time", 2000.0 + 0.0 * TIME))
    record = xr.DataTree.from_dict({"/slow": gauged})
    assert _mass_along(record, TIME, craft) == pytest.approx(2000.0)


def test_the_centre_of_gravity_has_the_mean_contents(craft):
    """50 kg at 2 m on the right in place of the left: y = 2 (150 - 50) / 2250; a gauge of the
    right tank that shows more than full counts as full.
    """
    contents = {"tank.left.fuel": 55.0 - TIME, "tank.right.fuel": 203.0 + 0.0 * TIME}
    slow = xr.Dataset({name: ("time", x) for name, x in contents.items()}, {"time": TIME})
    inputs = object.__new__(RecordInputs)
    inputs.channels = MeasuredChannels(xr.DataTree.from_dict({"/slow": slow}), [(0.0, 9.5)])
    left = 55.0 - float(np.mean(TIME))
    y = 2.0 * (200.0 - left) / (2300.0 - 300.0 + 200.0 + left)
    np.testing.assert_allclose(inputs._expected_cg(craft), (0.0, y, 0.0), rtol=1e-12)
    inputs.channels = MeasuredChannels(xr.DataTree.from_dict({"/slow": slow * 0.0}), [(0.0, 9.5)])
    np.testing.assert_allclose(inputs._expected_cg(craft), (0.0, 0.0, 0.0), atol=1e-15)


def test_the_centre_of_gravity_follows_the_contents(craft):
    """100 kg go from the left to the right: a case starts with the c.g. of its start.

    The mean of the record, 0, would fly the start of the transfer without its imbalance.
    """
    moved = 100.0 * TIME / TIME[-1]
    contents = {"tank.left.fuel": 200.0 - moved, "tank.right.fuel": 100.0 + moved}
    slow = xr.Dataset({name: ("time", x) for name, x in contents.items()}, {"time": TIME})
    record = xr.DataTree.from_dict({"/slow": slow})
    at, mean = np.array([TIME[0], TIME[-1]]), np.array([0.1, 0.0, 0.2])
    cg = _cg_along(record, at, craft, mean=mean)
    y = 2.0 * 100.0 / 2300.0
    np.testing.assert_allclose(cg["y_cg_b"], [-y, y], rtol=1e-12)
    gauged = xr.DataTree.from_dict({"/slow": slow.assign(y_cg_b=("time", 0.01 * TIME))})
    recorded = _cg_along(gauged, at, craft, mean=mean)["y_cg_b"]
    np.testing.assert_allclose(recorded, 0.01 * at, rtol=1e-14)
    blank = xr.DataTree.from_dict({"/slow": slow[[]].assign(x_cg_b=("time", np.nan * TIME))})
    np.testing.assert_allclose(_cg_along(blank, at, craft, mean=mean)["x_cg_b"], 0.1)
    bare = xr.DataTree.from_dict({"/slow": slow[[]]})
    np.testing.assert_allclose(_cg_along(bare, at, craft, mean=mean)["x_cg_b"], 0.1)
