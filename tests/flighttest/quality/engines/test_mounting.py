"""Places, inertias and stops of an aircraft file that no aircraft has."""

from dataclasses import replace
from pathlib import Path

import pytest

import flightmech
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.fuel_transfer import Transfer
from flightmech.aircraft.propulsion.tank import Tank
from flighttest.reconstruction.quality.engines.usual_sizes import unusual_sizes

ROOT = Path(__file__).parents[4]
LEFT, RIGHT = (-3.0, -1.1, -0.5), (-3.0, 1.1, -0.5)


def jet(positions=(LEFT, RIGHT), direction=(1.0, 0.0, 0.0), **changes):
    """Return a light jet with engines at the given places."""
    engines = tuple(Engine(position=place, direction=direction) for place in positions)
    plain = flightmech.Aircraft("jet", 18.1, 1.63, 11.7, 3350.0, 8600.0, 13200.0, 20900.0)
    return replace(plain, engines=engines, **changes)


def pumped(rate):
    """Return the jet with a pump from one of its tanks into the other."""
    tanks = tuple(Tank((0.0, y, 0.0), 200.0, name=name) for name, y in (("l", -2.0), ("r", 2.0)))
    fuel = Fuel(0.0, tanks=tanks, transfers=(Transfer("l", "r", rate, 200.0, 50.0),))
    return jet(fuel=fuel)


def test_a_pump_in_kg_per_hour_is_named():
    assert unusual_sizes(pumped(0.1)) == []
    (size,) = unusual_sizes(pumped(360.0))
    assert size.text.startswith("transfer from l to r: rate 360 kg/s is more than a pump moves")


def test_a_sound_jet_has_no_remark():
    limits = {"delta_e": (-0.45, 0.3), "flaps": (0.0, 40.0)}
    assert unusual_sizes(jet(cg=(0.2, 0.0, 0.1), limits=limits)) == []
    assert unusual_sizes(jet(positions=[(1.5, 0.0, 0.0), (-2.0, 0.0, 0.0)])) == []


@pytest.mark.parametrize(
    ("aircraft", "text"),
    [
        (jet(positions=[(-3000.0, -1100.0, 0.0), RIGHT]), "[-3000, -1100, 0] m is outside of an"),
        (jet(direction=(-1.0, 0.0, 0.0)), "direction = [-1, 0, 0] pushes the aircraft backward"),
        (jet(direction=(0.0, 0.0, -1.0)), "direction = [0, 0, -1] pushes the aircraft more to a"),
        (jet(positions=[LEFT, LEFT]), "all 2 engines are on the left side"),
        (jet(positions=[RIGHT, RIGHT]), "all 2 engines are on the right side"),
        (jet(cg=(-5.3, 0.0, 0.0)), "x = -5.3 m is 3.25 mean chords from the moment reference"),
        (jet(cg=(27.0, 0.0, 0.0)), "x = 27 m is 16.6 mean chords"),
        (jet(Ixx=20900.0, Izz=8600.0, Iyy=11000.0), "is larger than the sum of the two others"),
        (jet(limits={"delta_e": (-25.0, 15.0)}), "limits of delta_e: 25 rad is 1432 deg"),
    ],
)
def test_a_place_or_stop_that_no_aircraft_has_is_named(aircraft, text):
    assert any(text in size.text and size.remedy for size in unusual_sizes(aircraft))


def test_engines_that_are_counted_from_the_nose_are_named():
    nose = {"reference": (-6.2, 0.0, 0.0)}
    assert unusual_sizes(jet(**nose)) == []
    sizes = unusual_sizes(jet(positions=((-9.2, -1.1, -0.5), (-9.2, 1.1, -0.5)), **nose))
    assert len(sizes) == 2
    assert "x = -9.2 m lies behind the tail" in sizes[0].text
    assert "not from the drawing datum" in sizes[0].remedy
    # a datum at the firewall shows nothing
    assert unusual_sizes(jet(positions=((-3.5, 0.0, 0.0),), reference=(-1.1, 0.0, 0.0))) == []


@pytest.mark.slow
def test_a_propeller_behind_the_wing_is_named_unless_stated():
    example = flightmech.read_aircraft(ROOT / "data" / "c182" / "aircraft.toml")
    (engine,) = example.engines
    x, y, z = engine.position
    behind = replace(example, engines=(replace(engine, position=(-x, y, z)),))
    assert unusual_sizes(example) == []
    (size,) = unusual_sizes(behind)
    assert "its propeller stands at x = -2.055 m, 1.4 mean chords behind" in size.text
    assert "turn the sign of x" in size.remedy
    assert unusual_sizes(replace(behind, facts=replace(example.facts, pusher=True))) == []


def test_an_engine_without_one_opposite_to_it_is_named():
    (size,) = unusual_sizes(jet(positions=[(0.0, 1.5, 0.0)]))
    assert "engine 1: y = 1.5 m, and no engine is opposite to it" in size.text
    sizes = unusual_sizes(jet(positions=[LEFT, (-3.0, 1.9, -0.5)]))
    assert [size.text[:10] for size in sizes] == ["engine 1: ", "engine 2: "]
    # three engines, one in the plane of symmetry
    assert unusual_sizes(jet(positions=[LEFT, (-4.0, 0.0, -1.0), RIGHT])) == []
