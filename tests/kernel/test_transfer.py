"""Pumps from tank to tank: contents against closed forms, sums, limits, many runs at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.aircraft.propulsion.fuel_transfer import Transfer
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.errors import SchemaError, SimulationError
from flightmech.simulation.submodels import fuel as fuel_names
from flightmech.terms import make_term

STILL = {"init.V": 0.0, "init.h": 0.0, "mode.earth": 0.0, "mode.engine": 0.0}
TANKS = (
    Tank((0.1, -2.0, 0.15), 60.0, name="left", content=20.0),
    Tank((0.1, 2.0, 0.15), 60.0, name="right", content=50.0),
    Tank((-1.8, 0.3, -0.1), 30.0, name="aft", content=24.0),
)
PUMPS = (
    Transfer("aft", "left", rate=0.5, fill=45.0, band=8.0, leave=4.0, on=True),
    Transfer("right", "left", rate=0.25, fill=60.0, band=0.25),
)
TIME = 0.02 * np.arange(1501)
FLOW = 0.125  # of the engine [kg/s]


def compiled(make_aircraft, make_tree, flow: float) -> flightmech.SimModel:
    """A model whose engine burns so much from the left and right tanks."""
    deck = EngineDeck(
        {
            "n2_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
            "n2_up_time": make_term(0.5),
            "thrust": make_term(0.0),
            "fuel_flow": make_term(flow),
        }
    )
    engine = flightmech.aircraft.Engine((0.0, 0.0, 0.0), deck=deck, feed=("left", "right"))
    fuel = Fuel(94.0, tanks=TANKS, transfers=PUMPS)
    craft = make_aircraft(engines=(engine,), fuel=fuel)
    return flightmech.compile(craft, make_tree({"CD/basic": make_term(0.0)}))


@pytest.fixture(scope="module")
def still(make_aircraft, make_tree) -> flightmech.SimModel:
    """The engine burns nothing."""
    return compiled(make_aircraft, make_tree, 0.0)


@pytest.fixture(scope="module")
def burning(make_aircraft, make_tree) -> flightmech.SimModel:
    return compiled(make_aircraft, make_tree, FLOW)


def flown(sim, parameters=(), **inputs: float) -> dict[str, np.ndarray]:
    """Contents, flows and the sum over time; inputs with two underscores for a dot."""
    channels = {}
    for name, value in inputs.items():
        channels[name.replace("__", ".")] = ("time", np.full(TIME.shape, value))
    record = xr.Dataset(channels or {"throttle": ("time", 0.0 * TIME)}, {"time": TIME})
    y = flightmech.simulate(sim, record, STILL | dict(parameters), hold="zero")
    names = {name: f"tank.{name}.fuel" for name in ("left", "right", "aft")}
    names |= {"fuel": "fuel", "flow": "transfer.aft.left.flow"}
    return {name: y[output].values for name, output in names.items()}


def test_a_pump_at_full_flow_moves_its_rate(still):
    """16 kg over the rest of the source, before its inlet takes air: a straight line."""
    y = flown(still, {"init.tank.aft.fuel": 29.0})
    line = 0.5 * TIME
    rising = line <= 29.0 - 4.0 - 8.0
    assert rising.sum() > 1000
    np.testing.assert_allclose(y["left"][rising], 20.0 + line[rising], rtol=1e-12)
    np.testing.assert_allclose(y["aft"][rising], 29.0 - line[rising], rtol=1e-12)
    np.testing.assert_allclose(y["flow"][rising], 0.5, rtol=1e-12)
    assert np.all(y["right"] == 50.0)


def test_a_float_valve_shuts_as_an_exponential(still):
    """m' = rate (fill - m) / band: fill - m = (fill - m0) exp(-rate t / band)."""
    y = flown(still, {"init.tank.left.fuel": 39.0})
    left = 45.0 - 6.0 * np.exp(-0.5 / 8.0 * TIME)
    np.testing.assert_allclose(y["left"], left, rtol=1e-12)
    np.testing.assert_allclose(y["aft"], 24.0 - (left - 39.0), rtol=1e-12)
    np.testing.assert_allclose(y["flow"], 0.5 * (45.0 - left) / 8.0, rtol=1e-10)


def test_a_source_runs_dry_as_an_exponential(still):
    """m' = - rate (m - leave) / band."""
    y = flown(still, {"init.tank.aft.fuel": 11.0})
    aft = 4.0 + 7.0 * np.exp(-0.5 / 8.0 * TIME)
    np.testing.assert_allclose(y["aft"], aft, rtol=1e-12)
    np.testing.assert_allclose(y["left"], 20.0 + 11.0 - aft, rtol=1e-12)


def test_what_a_pump_moves_is_neither_lost_nor_made(burning):
    """Two pumps and an engine: the sum of all tanks falls with its fuel flow alone."""
    y = flown(burning, transfer__right__left__pump=1.0)
    np.testing.assert_allclose(y["fuel"], 94.0 - FLOW * TIME, rtol=1e-12)
    total = y["left"] + y["right"] + y["aft"]
    np.testing.assert_allclose(total, y["fuel"], rtol=1e-14)
    # tanks of equal capacity give equal shares
    np.testing.assert_allclose(y["right"], 50.0 - (0.25 + FLOW / 2.0) * TIME, rtol=1e-12)
    assert y["left"][-1] > 20.0 + 0.25 * 30.0


def test_a_float_valve_holds_a_tank_where_the_flows_are_equal(burning):
    """rate (fill - m) / band = Wf / 2: the left tank stays, the aft one gives what it needs."""
    held = 45.0 - 8.0 * (FLOW / 2.0) / 0.5
    y = flown(burning, {"init.tank.left.fuel": held})
    np.testing.assert_allclose(y["left"], held, rtol=1e-12)
    np.testing.assert_allclose(y["aft"], 24.0 - FLOW / 2.0 * TIME, rtol=1e-12)


def test_a_pump_that_is_off_moves_nothing(still):
    """The aft pump is on where nothing drives its input, the other one is off."""
    y = flown(still, transfer__aft__left__pump=0.0)
    assert (y["left"][-1], y["right"][-1], y["aft"][-1]) == (20.0, 50.0, 24.0)
    assert not y["flow"].any()


def test_runs_side_by_side_have_the_bits_of_one(burning):
    runs = 9
    late = TIME[None, :151] > 0.2 * np.arange(runs)[:, None]
    switch = 1.0 * (late & (np.arange(runs) % 2 == 0)[:, None])
    record = xr.Dataset(
        {"transfer.right.left.pump": (("run", "time"), switch)}, {"time": TIME[:151]}
    )
    loads = {
        "init.tank.aft.fuel": np.linspace(0.0, 24.0, runs),
        "init.tank.left.fuel": np.linspace(60.0, 0.0, runs),
    }
    fixed = {"mode.earth": 0.0, "mode.engine": 0.0, "init.V": 60.0}
    flights = [flightmech.simulate_batch(burning, record, loads, fixed, lanes=n) for n in (1, 4, 8)]
    for found in flights[1:]:
        for name in burning.outputs:
            assert found[name].values.tobytes() == flights[0][name].values.tobytes(), name
    assert len(np.unique(flights[0]["transfer.aft.left.flow"].values[:, -1])) == 4


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"transfer.aft.left.rate": -0.1}, "transfer.aft.left.rate is -0.1; it must be zero or"),
        ({"transfer.aft.left.leave": -1.0}, "transfer.aft.left.leave is -1; it must be zero or"),
        (
            {"transfer.aft.left.fill": 60.5},
            "fill is 60.5; it must be between zero and the capacity of the tank that it fills",
        ),
        (
            {"transfer.aft.left.band": 0.04},
            "band is 0.04; it must be positive, and at least what the pump moves in 0.1 s",
        ),
    ],
)
def test_limits_without_meaning_are_refused(still, changed, message):
    with pytest.raises(SimulationError, match=message):
        flown(still, changed)


@pytest.mark.parametrize("name", ["none.left", "left.none", "left"])
def test_a_transfer_of_a_block_that_leads_nowhere_is_refused(
    make_aircraft, make_tree, monkeypatch, name
):
    """The library checks the names of a block, which may come from elsewhere."""
    named = fuel_names.items

    def items(craft):
        return named(craft) | {"transfer": (name,)}

    monkeypatch.setattr(fuel_names, "items", items)
    row = fuel_names.make_row(f"transfer.{name}.rate", "1", "")
    monkeypatch.setattr(fuel_names, "_transfer_row", lambda *_, **__: row)
    with pytest.raises(SchemaError, match=f"transfer {name} leads from no tank, or to no tank"):
        compiled(make_aircraft, make_tree, 0.0)


def test_pumps_without_tanks_are_refused():
    with pytest.raises(SchemaError, match="transfer needs tanks that feed engines; add tank to"):
        Fuel(94.0, transfers=PUMPS)
    twice = replace(PUMPS[0], rate=0.1)
    with pytest.raises(SchemaError, match=r"transfer aft.left is there twice; give the pumps as"):
        Fuel(94.0, tanks=TANKS, transfers=(PUMPS[0], twice))
