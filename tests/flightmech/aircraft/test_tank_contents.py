"""Mass, centre of gravity and inertia with other contents of the tanks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import flightmech
from flightmech.aircraft.aircraft import tanks_of, with_contents
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.errors import SchemaError, UnknownName

TANKS = (
    Tank((0.1, -2.0, 0.15), 200.0, name="left", content=150.0),
    Tank((0.3, 2.0, 0.10), 200.0, name="right", content=120.0),
)


@pytest.fixture
def craft(plain_aircraft) -> flightmech.Aircraft:
    engine = flightmech.aircraft.Engine((0.0, 0.0, 0.0), feed=("left", "right"))
    plain = plain_aircraft(engines=(engine,), fuel=Fuel(270.0, tanks=TANKS))
    return replace(plain, Ixy=40.0, Ixz=350.0, Iyz=-25.0, cg=(0.06, 0.01, 0.2))


def test_the_moved_fuel_is_that_of_the_simulation(craft, plain):
    """The kernel starts with the same contents from the aircraft as it was weighed."""
    held = {"left": 60.0, "right": 190.0}
    start = {f"init.tank.{name}.fuel": mass for name, mass in held.items()}
    y = flightmech.trim(plain(craft), {"init.V": 90.0, "init.h": 1500.0} | start)
    loaded = with_contents(craft, held)
    for name in ("mass", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"):
        assert float(y[name]) == pytest.approx(getattr(loaded, name), rel=1e-11), name
    found = [float(y[f"{axis}_cg_b"]) for axis in "xyz"]
    np.testing.assert_allclose(found, loaded.cg, rtol=1e-11)
    assert loaded.fuel.mass == 250.0
    back = with_contents(loaded, {"left": 150.0, "right": 120.0})
    assert back.Ixx == pytest.approx(craft.Ixx, rel=1e-14)
    np.testing.assert_allclose(back.cg, craft.cg, rtol=1e-13)


def test_tanks_without_an_entry_keep_their_fuel(craft):
    assert [tank.content for tank in tanks_of(with_contents(craft, {"left": 1.0}))] == [1.0, 120.0]
    without = replace(craft, fuel=None)
    assert tanks_of(without) == ()
    assert with_contents(without, {}) is without


def test_contents_of_no_tank_are_refused(craft):
    with pytest.raises(UnknownName, match="lfet"):
        with_contents(craft, {"lfet": 1.0})
    with pytest.raises(SchemaError, match="201 kg of fuel do not go into tank left of 200 kg"):
        with_contents(craft, {"left": 201.0})
