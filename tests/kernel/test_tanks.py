"""Tanks with a state each, that feed engines: sums of masses, flows and the cross-feed by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.aircraft import inertia_tensor
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.errors import SchemaError, SimulationError
from flightmech.simulation.kernel import STATE
from flightmech.simulation.submodels import fuel as fuel_names
from flightmech.terms import make_term

STILL = {"init__V": 0.0, "init__h": 0.0, "mode__earth": 0.0, "mode__engine": 0.0}
FLOW = 2.0  # of each engine that burns [kg/s]
TANKS = (
    Tank((0.1, -2.0, 0.15), 60.0, order=2, name="left", content=50.0),
    Tank((0.1, 2.0, 0.15), 90.0, order=2, name="right", content=70.0),
    Tank((0.8, -0.3, -0.1), 30.0, order=1, name="tip", content=10.0),
)
NAMES = tuple(tank.name for tank in TANKS)
POINTS = np.array([tank.position for tank in TANKS])


def point(m: float, r: np.ndarray) -> np.ndarray:
    """Inertia tensor of a mass point about the origin."""
    return m * ((r @ r) * np.eye(3) - np.outer(r, r))


def counterpart(craft, weighed, held) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, c.g. and inertia about it: the aircraft without what it was weighed with, and what the
    tanks hold.
    """
    cg0, change = np.array(craft.cg), np.subtract(held, weighed)
    mass = craft.mass + change.sum()
    cg = (craft.mass * cg0 + change @ POINTS) / mass
    J = inertia_tensor(craft) + point(craft.mass, cg0) - point(mass, cg)
    for m, r in zip(change, POINTS, strict=True):
        J += point(m, r)
    return mass, cg, J


@pytest.fixture(scope="module")
def craft(make_aircraft):
    deck = EngineDeck(
        {
            "n2_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
            "n2_up_time": make_term(0.5),
            "thrust": make_term([0.0, 4000.0], {"n2": [0.5, 1.0]}),
            "fuel_flow": make_term(FLOW),
        }
    )
    engine = flightmech.aircraft.Engine
    return make_aircraft(
        engines=(
            engine((0.0, -0.5, 0.0), deck=deck, feed=("left", "tip"), crossfeed=("right",)),
            engine((0.0, 0.5, 0.0), deck=deck, feed=("right",), crossfeed=("left",)),
        ),
        fuel=Fuel(130.0, tanks=TANKS),
    )


@pytest.fixture(scope="module")
def sim(craft, make_tree):
    return flightmech.compile(craft, make_tree({"CD/basic": make_term(0.0)}))


def after(sim, run, seconds: float, **inputs: float) -> dict[str, float]:
    """Outputs after so many seconds from the start of a run, the tanks by their names."""
    u = np.zeros(len(sim.inputs))
    for name, value in inputs.items():
        u[sim.inputs.index(name.replace("__", "."))] = value
    run.set_inputs(u)
    run.step(0.0, seconds, u, u)
    y = dict(zip(sim.outputs, run.outputs(), strict=True))
    return y | {name: y[f"tank.{name}.fuel"] for name in NAMES}


def contents(y: dict[str, float]) -> np.ndarray:
    return np.array([y[name] for name in NAMES])


def demand_counterpart(craft, y, weighed) -> None:
    mass, cg, J = counterpart(craft, weighed, contents(y))
    assert y["fuel"] == pytest.approx(contents(y).sum(), rel=1e-14)
    assert y["mass"] == pytest.approx(mass, rel=1e-13)
    np.testing.assert_allclose([y[f"{axis}_cg_b"] for axis in "xyz"], cg, rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose([y["Ixx"], y["Iyy"], y["Izz"]], np.diag(J), rtol=1e-12)
    products = [-y["Ixy"], -y["Ixz"], -y["Iyz"]]
    np.testing.assert_allclose(products, [J[0, 1], J[0, 2], J[1, 2]], rtol=1e-9, atol=1e-9)


def test_each_engine_empties_the_tanks_that_feed_it(sim, start, craft):
    """Engine 1 the tip tank for 5 s, then the left one; engine 2 the right one."""
    y = after(sim, start(sim, **STILL), 12.0)
    assert contents(y) == pytest.approx([36.0, 46.0, 0.0], abs=0.03)  # a step of 10 ms at the end
    assert contents(y).sum() == pytest.approx(130.0 - 2.0 * FLOW * 12.0, abs=0.02)
    demand_counterpart(craft, y, [50.0, 70.0, 10.0])


def test_an_open_crossfeed_feeds_both_engines_from_both_sides(sim, start, craft):
    """The tip tank first, then in proportion to the capacities 60 and 90."""
    y = after(sim, start(sim, **STILL), 4.0, crossfeed=1.0)
    # engine 1 from the tip tank, engine 2 from both of order 2
    own = FLOW * 4.0 * np.array([60.0, 90.0]) / 150.0
    assert contents(y) == pytest.approx([50.0 - own[0], 70.0 - own[1], 2.0], rel=1e-12)
    demand_counterpart(craft, y, [50.0, 70.0, 10.0])


def test_a_tank_that_is_cut_off_feeds_nothing(sim, start):
    y = after(sim, start(sim, **STILL), 4.0, crossfeed=1.0, tank__left__cutoff=1.0)
    assert contents(y) == pytest.approx([50.0, 70.0 - FLOW * 4.0, 2.0], rel=1e-12)
    alone = after(sim, start(sim, **STILL), 4.0, tank__right__cutoff=1.0)
    assert alone["engine2.burning"] < 1e-3
    assert alone["right"] == 70.0
    assert (alone["engine1.burning"], alone["tip"]) == (1.0, pytest.approx(2.0, rel=1e-12))


def test_an_engine_out_moves_the_centre_of_gravity_until_the_crossfeed_is_open(sim, start, craft):
    """y = (m0 y0 + sum of the changes times y) / m."""
    out = {"engine1__cutoff": 1.0, "engine2__throttle": 1.0}
    shut = after(sim, start(sim, **STILL), 30.0, **out)
    crossed = after(sim, start(sim, **STILL), 30.0, crossfeed=1.0, **out)
    used = FLOW * 30.0
    mass = craft.mass - used
    burnt_of_1 = 130.0 - shut["fuel"] - used  # while its flame goes out
    assert burnt_of_1 == pytest.approx(0.0, abs=1.5)
    assert (shut["left"], shut["right"]) == (50.0, pytest.approx(10.0, rel=1e-12))
    assert shut["y_cg_b"] == pytest.approx(
        (craft.mass * craft.cg[1] - used * 2.0 + burnt_of_1 * 0.3) / (mass - burnt_of_1), rel=1e-9
    )
    assert crossed["left"] / crossed["right"] == pytest.approx(26.0 / 34.0, rel=1e-12)
    assert crossed["y_cg_b"] > shut["y_cg_b"] + 0.03
    for y in (shut, crossed):
        demand_counterpart(craft, y, [50.0, 70.0, 10.0])


def test_an_engine_stops_when_the_tanks_that_feed_it_are_empty(sim, start):
    run = start(sim, **STILL)
    y = after(sim, run, 34.0, engine2__throttle=1.0)
    assert (y["engine1.burning"], y["left"]) == (pytest.approx(0.0, abs=1e-3), 0.0)
    assert (y["engine2.burning"], y["right"]) == (1.0, pytest.approx(2.0, rel=1e-9))
    saved = after(sim, start(sim, **STILL), 29.0, crossfeed=1.0)
    assert saved["engine1.burning"] == saved["engine2.burning"] == 1.0


def test_contents_at_the_start_are_apart_from_those_weighed(sim, flown, craft):
    """mass.* hold with mass.tank.*.fuel; the start has init.tank.*.fuel."""
    held = [10.0, 90.0, 0.0]
    loads = {f"init__tank__{name}__fuel": m for name, m in zip(NAMES, held, strict=True)}
    y = flown(sim, **STILL, **loads)
    y |= {name: y[f"tank.{name}.fuel"] for name in NAMES}
    assert contents(y).tolist() == held
    demand_counterpart(craft, y, [50.0, 70.0, 10.0])
    weighed = {f"mass__tank__{name}__fuel": m for name, m in zip(NAMES, held, strict=True)}
    as_weighed = flown(sim, **STILL, **loads, **weighed)
    assert as_weighed["y_cg_b"] == pytest.approx(craft.cg[1], rel=1e-14)
    assert as_weighed["mass"] == craft.mass


def test_states_and_parameters_have_names(sim):
    states = [row.name for row in sim.entries(STATE)]
    assert [name for name in states if "tank" in name] == [f"state.tank.{n}.fuel" for n in NAMES]
    assert {"feed.engine1.left", "feed.engine2.right", "mass.tank.tip.fuel"} <= set(sim.parameters)
    assert "init.fuel" not in sim.parameters


def test_a_feed_can_be_shut(sim, start):
    y = after(sim, start(sim, **STILL, feed__engine1__tip=0.0), 4.0)
    assert contents(y) == pytest.approx([42.0, 62.0, 10.0], rel=1e-12)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"init__tank__left__fuel": 61.0},
            "init.tank.left.fuel is 61; it must be between zero and the capacity of the tank",
        ),
        (
            {"mass__tank__tip__fuel": -1.0},
            "mass.tank.tip.fuel is -1; it must be between zero and the capacity of the tank",
        ),
        ({"tank__left__capacity": 0.0}, "tank.left.capacity is 0; it must be positive"),
        (
            {"feed__engine1__left": 1.5},
            r"feed.engine1.left is 1.5; it must be 0 \(never\), 1 \(always\) or 2",
        ),
        ({"mass__mass": 120.0}, "mass.tank.*.fuel have a sum of 130 kg, mass.mass is 120 kg"),
        ({"mass__Ixx": 100.0}, "without its fuel the aircraft has no positive definite inertia"),
    ],
)
def test_contents_without_meaning_are_refused(sim, flown, changed, message):
    with pytest.raises(SimulationError, match=message):
        flown(sim, **STILL, **changed)


@pytest.mark.parametrize(
    ("feeds", "message"),
    [
        ((("left",), ()), "engine.2.feed: no tank feeds the engine; give one or more of left, ri"),
        ((("left",), ("rihgt",)), "engine.2.feed: rihgt is not a tank; allowed: left, right, tip"),
        ((("left", "left"), ("right",)), "left is there 2 times in feed and crossfeed; keep one"),
        ((("left",), ("right",)), "fuel: tank tip feeds no engine; name it in a feed or crossfeed"),
    ],
)
def test_feeds_that_lead_nowhere_are_refused(craft, make_tree, feeds, message):
    engines = []
    for engine, feed in zip(craft.engines, feeds, strict=True):
        engines.append(replace(engine, feed=feed, crossfeed=()))
    with pytest.raises(SchemaError, match=message):
        flightmech.compile(
            replace(craft, engines=tuple(engines)), make_tree({"CD/basic": make_term(0.0)})
        )


def test_feeds_without_tanks_are_refused(craft, make_tree):
    with pytest.raises(SchemaError, match="the engines have a feed, but there are no tanks; add"):
        flightmech.compile(replace(craft, fuel=None), make_tree({"CD/basic": make_term(0.0)}))


@pytest.mark.parametrize(
    ("tanks", "message"),
    [
        ((replace(TANKS[0], name=""),), "tank 1 has the name ''; give small letters, digits and"),
        ((TANKS[0], TANKS[0]), "2 tanks have the name left; give each its own"),
        ((replace(TANKS[0], content=61.0),), "61 kg of fuel do not go into tank left of 60 kg"),
        ((TANKS[0],), "the tanks hold 50 kg, mass is 130 kg; give equal numbers"),
    ],
)
def test_tanks_without_meaning_are_refused(tanks, message):
    with pytest.raises(SchemaError, match=message):
        Fuel(130.0, tanks=tanks)


def test_runs_side_by_side_have_the_bits_of_one(sim):
    """Contents, cross-feed and cut-off of their own: tanks that run dry next to full ones."""
    runs, time = 11, np.arange(0.0, 3.0, 0.02)
    run = np.arange(runs)
    late = time[None, :] > 0.25 * run[:, None]
    own = {
        "crossfeed": (("run", "time"), 1.0 * (late & (run % 2 == 1)[:, None])),
        "tank.right.cutoff": (("run", "time"), 1.0 * (late & (run % 3 == 0)[:, None])),
    }
    record = xr.Dataset(own, {"time": time})
    loads = {
        "init.tank.left.fuel": np.linspace(0.0, 3.0, runs),
        "init.tank.tip.fuel": np.linspace(10.0, 0.0, runs),
        "tank.left.order": np.where(run == 4, 1.0, 2.0),
        "init.V": np.linspace(60.0, 90.0, runs),
    }
    fixed = {"mode.earth": 0.0, "mode.engine": 0.0}
    flown = [
        flightmech.simulate_batch(sim, record, loads, fixed, lanes=lanes) for lanes in (1, 4, 8)
    ]
    for found in flown[1:]:
        for name in sim.outputs:
            assert found[name].values.tobytes() == flown[0][name].values.tobytes(), name
    burning = flown[0]["engine1.burning"].values[:, -1]
    assert 0 < int((burning < 0.5).sum()) < runs
    assert 0 < int((flown[0]["tank.tip.fuel"].values[:, -1] == 0.0).sum()) < runs


@pytest.mark.parametrize("name", ["1.none", "9.left", "left"])
def test_a_feed_of_a_block_that_leads_nowhere_is_refused(craft, make_tree, monkeypatch, name):
    """The library checks the names of a block, which may come from elsewhere."""
    items = {**fuel_names.items(craft), "feed": (name,)}
    row = fuel_names.make_row(f"feed.engine{name}", "1", "")
    monkeypatch.setattr(fuel_names, "items", lambda _: items)
    monkeypatch.setattr(fuel_names, "_feed_row", lambda *_: row)
    with pytest.raises(SchemaError, match=f"feed {name} leads from no tank, or to no engine"):
        flightmech.compile(craft, make_tree({"CD/basic": make_term(0.0)}))
