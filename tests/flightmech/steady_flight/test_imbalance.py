"""Fuel on one side: trim and linear model against statics and the motion of a mass point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import flightmech
from flightmech.aircraft import Engine
from flightmech.aircraft.aircraft import inertia_tensor
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.fuel_transfer import Transfer
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.units import G0

TANKS = (
    Tank((0.0, -2.0, 0.0), 200.0, name="left", content=100.0),
    Tank((0.0, 2.0, 0.0), 200.0, name="right", content=100.0),
)
LEVEL = {"init.V": 90.0, "init.h": 1500.0, "mode.earth": 0.0}
LOADS = {"init.tank.left.fuel": 180.0, "init.tank.right.fuel": 20.0}
Y_CG = 2.0 * (20.0 - 180.0) / 2400.0


@pytest.fixture(scope="module")
def craft(plain_aircraft) -> flightmech.Aircraft:
    engine = Engine((0.0, 0.0, 0.0), feed=("left", "right"))
    return plain_aircraft(engines=(engine,), fuel=Fuel(200.0, tanks=TANKS))


@pytest.fixture(scope="module")
def sim(craft, plain) -> flightmech.SimModel:
    return plain(craft)


def test_controls_hold_the_wings_level_against_an_imbalance(sim):
    """CY, Cl and Cn of sideslip, ailerons and rudder against the weight at its distance:
    M = (y W cos(theta), ., y W sin(theta)) / (qbar S b).
    """
    y = flightmech.trim(sim, LEVEL | LOADS)
    assert float(y["y_cg_b"]) == pytest.approx(Y_CG, rel=1e-13)
    assert [float(y[f"tank.{name}.fuel"]) for name in ("left", "right")] == [180.0, 20.0]
    theta = float(y["theta"])
    arm = Y_CG * 2400.0 * G0 / (float(y["qbar"]) * 17.0 * 10.3)
    slopes = [[-0.7, 0.0, 0.17], [-0.09, -0.14, 0.01], [0.1, 0.005, -0.08]]
    wanted = np.linalg.solve(slopes, [0.0, -arm * np.cos(theta), -arm * np.sin(theta)])
    found = [float(y[name]) for name in ("trim.beta", "trim.delta_a", "trim.delta_r")]
    np.testing.assert_allclose(found, wanted, rtol=1e-6)
    assert found[1] < -0.02  # the heavy left wing is held up: delta_a positive rolls left


def test_equal_tanks_need_no_aileron(sim):
    y = flightmech.trim(sim, LEVEL)
    assert abs(float(y["trim.delta_a"])) < 1e-12


def test_a_float_valve_that_shuts_is_a_slope_of_the_linear_model(craft, plain):
    """Rate (fill - m) / band into the right tank: its slope, and none where the pump is at full
    flow.
    """
    pump = Transfer("left", "right", rate=0.5, fill=40.0, band=30.0, on=True)
    sim = plain(replace(craft, fuel=replace(craft.fuel, transfers=(pump,))))
    tanks = ("tank.left.fuel", "tank.right.fuel")
    states = ("V", "alpha", "q", "theta", "beta", "p", "r", "phi", *tanks)
    found = flightmech.linearize(sim, LEVEL | LOADS, states=states)
    A = found["A"].sel(state=list(tanks), state_=list(tanks)).values
    np.testing.assert_allclose(A, 0.5 / 30.0 * np.array([[0.0, 1.0], [0.0, -1.0]]), atol=1e-9)
    assert float(found["x_dot"].sel(state=tanks[1])) == pytest.approx(0.5 * 20.0 / 30.0, rel=1e-12)
    full = LEVEL | {"init.tank.left.fuel": 195.0, "init.tank.right.fuel": 5.0}
    flat = flightmech.linearize(sim, full, states=states)
    assert np.all(flat["A"].sel(state=list(tanks), state_=list(tanks)).values == 0.0)


def test_a_kilogram_in_a_tank_rolls_as_its_weight_does(sim, craft):
    """p' = J^-1 (- dc x F) of a mass at the tank, all in trim before."""
    states = ("V", "alpha", "q", "theta", "beta", "p", "r", "phi", "tank.left.fuel")
    found = flightmech.linearize(sim, LEVEL, states=states)
    y = flightmech.trim(sim, LEVEL)
    force = 2400.0 * np.array([float(y[name]) for name in ("ax", "ay", "az")])
    shift = np.array(TANKS[0].position) / 2400.0
    wanted = np.linalg.solve(inertia_tensor(craft), -np.cross(shift, force))
    column = found["A"].sel(state_="tank.left.fuel")
    for name, rate in zip(("p", "r"), (wanted[0], wanted[2]), strict=True):
        assert float(column.sel(state=name)) == pytest.approx(rate, rel=1e-6)
    assert wanted[0] < -1e-3
    assert found["state_units"].values.tolist()[-1] == "kg"
    assert "fuel" in flightmech.modes(found)["mode"].tolist()
