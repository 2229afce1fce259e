"""Tanks that feed engines in the aircraft file: what is read, written and refused."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest

import flightmech
from flightmech.aircraft.aircraft_file import aircraft_schema
from flightmech.aircraft.propulsion.fuel_transfer import Transfer
from flightmech.errors import AeromatchWarning, SchemaError

# the engines of the file have no tables
pytestmark = pytest.mark.filterwarnings("ignore:.*burns no fuel")
FILE = """
name = "two_engines"
S = 17.0
cbar = 1.67
b = 10.3
mass = 2300.0
Ixx = 10800.0
Iyy = 8100.0
Izz = 15100.0

[[engine]]
position = [-0.3, -1.0, 0.1]
feed = ["left"]
crossfeed = ["right"]

[[engine]]
position = [-0.3, 1.0, 0.1]
feed = ["right", "tip"]
crossfeed = ["left"]

[fuel]
mass = "300 kg"
tank = [
    { name = "left", position = [0.1, -2.0, 0.1], capacity = "200 kg", content = "150 kg", order = 2 },
    { name = "right", position = [0.1, "200 cm", 0.1], capacity = "200 kg", content = "130 kg", order = 2 },
    { name = "tip", position = [0.1, 4.0, 0.0], capacity = "40 kg", content = "20 kg" },
]
"""


@pytest.fixture
def file(tmp_path: Path):
    def write(*changes: tuple[str, str]) -> Path:
        text = FILE
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "aircraft.toml"
        path.write_text(text)
        return path

    return write


def contents(aircraft: flightmech.Aircraft) -> dict[str, float]:
    return {tank.name: tank.content for tank in aircraft.fuel.tanks}


def test_reading_and_writing_again(file, tmp_path):
    aircraft = flightmech.read_aircraft(file())
    assert contents(aircraft) == {"left": 150.0, "right": 130.0, "tip": 20.0}
    assert [tank.order for tank in aircraft.fuel.tanks] == [2, 2, 1]
    assert aircraft.fuel.tanks[1].position == (0.1, 2.0, 0.1)
    assert aircraft.engines[1].feed == ("right", "tip")
    assert aircraft.engines[0].crossfeed == ("right",)
    again = flightmech.read_aircraft(flightmech.write_aircraft(aircraft, tmp_path / "again.toml"))
    assert again == aircraft
    assert flightmech.aircraft.different_parts(again, aircraft) == []


def test_the_schema_allows_the_file():
    content = tomllib.loads(FILE)
    jsonschema.validate(json.loads(json.dumps(content)), aircraft_schema())


def test_without_contents_the_mass_fills_the_tanks_against_their_order(file):
    none = [(f', content = "{mass} kg"', "") for mass in (150, 130, 20)]
    aircraft = flightmech.read_aircraft(file(*none))
    assert contents(aircraft) == {"left": 150.0, "right": 150.0, "tip": 0.0}
    more = flightmech.read_aircraft(file(*none, ('mass = "300 kg"', 'mass = "420 kg"')))
    assert contents(more) == pytest.approx({"left": 200.0, "right": 200.0, "tip": 20.0})


def test_a_similar_aircraft_has_similar_tanks(file):
    small = flightmech.aircraft.rescale(flightmech.read_aircraft(file()), 0.5)
    tank = small.fuel.tanks[0]
    assert tank.position == pytest.approx((0.05, -1.0, 0.05))
    assert tank.content / small.mass == pytest.approx(150.0 / 2300.0)
    assert tank.capacity / tank.content == pytest.approx(200.0 / 150.0)
    assert small.fuel.mass == pytest.approx(sum(contents(small).values()))
    assert small.engines[1].feed == ("right", "tip")


def test_parts_of_the_fuel_take_the_feeds_along(file):
    fed = flightmech.read_aircraft(file())
    other = flightmech.read_aircraft(
        file(('feed = ["left"]\ncrossfeed = ["right"]', 'feed = ["left", "right"]'))
    )
    assert flightmech.aircraft.different_parts(fed, other) == ["fuel/load"]
    mixed = flightmech.aircraft.swap_parts(other, fed, ["fuel/load"])
    assert mixed.engines[0].crossfeed == ("right",)


PUMPS = """transfer = [
    { source = "tip", target = "right", rate = "360 kg/h", on = true },
    { source = "left", target = "right", rate = 0.2, leave = "10 kg", fill = 180, band = 2.5 },
]
"""


def test_pumps_between_tanks_are_read_and_written_again(file, tmp_path):
    """Without limits the pump fills the target, over what it moves in a second."""
    path = file(('feed = ["right", "tip"]', 'feed = ["right"]'))
    path.write_text(path.read_text() + PUMPS)
    aircraft = flightmech.read_aircraft(path)
    assert aircraft.fuel.transfers == (
        Transfer("tip", "right", 0.1, fill=200.0, band=0.1, on=True),
        Transfer("left", "right", 0.2, fill=180.0, band=2.5, leave=10.0),
    )
    again = flightmech.read_aircraft(flightmech.write_aircraft(aircraft, tmp_path / "again.toml"))
    assert again == aircraft
    small = flightmech.aircraft.rescale(aircraft, 0.25).fuel.transfers[1]
    # a mass over a time: the cube of the length over its root
    assert (small.rate, small.fill, small.leave) == pytest.approx((0.2 / 32, 180 / 64, 10 / 64))
    jsonschema.validate(tomllib.loads(path.read_text()), aircraft_schema())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('source = "tip"', 'source = "tpi"', "'tpi' is not a tank; allowed: left, right, tip"),
        ('source = "tip"', 'source = "right"', "source and target are the same tank; give two"),
        ('"360 kg/h"', "0.0", "transfer tip.right: the rate is 0 kg/s; give a positive flow"),
        ('"360 kg/h"', "nan", "rate: input should be a finite number; found nan"),
        ('"10 kg"', "201.0", "leave is 201 kg; give zero to the capacity of the source, 200 kg"),
        ("180,", "201,", "fill is 201 kg; give more than zero and at most the capacity of the ta"),
        ("2.5 }", "0.01 }", "band is 0.01 kg; give at least what the pump moves in 0.1 s, 0.02 kg"),
        ('source = "left"', 'source = "tip"', "transfer tip.right is there twice; give the pumps"),
        ('target = "right", rate = "', 'target = "tip", rate = "', "the same tank"),
    ],
)
def test_pumps_without_meaning_are_refused(file, old, new, message):
    path = file()
    text = path.read_text() + PUMPS
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(SchemaError) as caught:
        flightmech.read_aircraft(path)
    assert message in str(caught.value)


def test_a_pump_that_fills_a_tank_of_another_unit_fills_it(file):
    """200 kg are 440.92452437 lb: 1e-10 kg more, which the model refused after the file was read."""
    path = file()
    path.write_text(path.read_text() + PUMPS.replace("180,", '"440.92452437 lb",'))
    aircraft = flightmech.read_aircraft(path)
    assert 200.0 in [pump.fill for pump in aircraft.fuel.transfers]


def test_a_pump_to_an_unknown_tank_has_one_problem(file):
    path = file()
    path.write_text(path.read_text() + PUMPS.replace('target = "right"', 'target = "rihgt"'))
    with pytest.raises(SchemaError) as caught:
        flightmech.read_aircraft(path)
    assert "'rihgt' is not a tank; allowed: left, right, tip" in str(caught.value)
    assert "fill is 0 kg" not in str(caught.value)


def test_pumps_of_tanks_that_feed_no_engine_are_refused(file):
    feeds = [
        ('feed = ["left"]\ncrossfeed = ["right"]\n', ""),
        ('feed = ["right", "tip"]\ncrossfeed = ["left"]\n', ""),
        *[(f', content = "{mass} kg"', "") for mass in (150, 130, 20)],
    ]
    path = file(*feeds)
    path.write_text(path.read_text() + PUMPS)
    with pytest.raises(SchemaError, match="transfer needs engines that state what feeds them"):
        flightmech.read_aircraft(path)


def test_a_tank_that_is_pumped_to_none_that_feeds_is_refused(file):
    path = file(('feed = ["right", "tip"]', 'feed = ["right"]'))
    path.write_text(
        path.read_text() + PUMPS.replace('"tip", target = "right"', '"right", target = "tip"')
    )
    with pytest.raises(SchemaError, match="tank tip feeds no engine; name it in a feed or"):
        flightmech.read_aircraft(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'feed = ["left"]\ncross',
            "cross",
            "engine.1.feed: no tank feeds the engine; give one or more of",
        ),
        (
            'feed = ["left"]\ncross',
            'feed = ["lfet"]\ncross',
            "engine.1.feed: lfet is not a tank; allowed: left,",
        ),
        (', "tip"]', "]", "fuel: tank tip feeds no engine; name it in a feed or crossfeed"),
        ('"150 kg"', '"201 kg"', "fuel: 201 kg of fuel do not go into tank left of 200 kg"),
        ('"150 kg"', '"140 kg"', "fuel: the tanks hold 290 kg, mass is 300 kg; give equal numbers"),
        (', content = "20 kg"', "", "fuel: tank.content is given of some tanks; give it of all or"),
        ('name = "tip"', 'name = "left"', "fuel: 2 tanks have the name left; give each its own"),
        ('name = "tip", ', "", "fuel: tank 3 has the name ''; give small letters, digits and _"),
        ('name = "tip"', 'name = "Tip 1"', "fuel: tank 3 has the name 'Tip 1'; give small letters"),
        (
            'name = "tip"',
            r'name = "tip\n"',
            r"fuel: tank 3 has the name 'tip\n'; give small letters",
        ),
    ],
)
def test_feeds_and_contents_that_do_not_fit_are_refused(file, old, new, message):
    with pytest.raises(SchemaError) as caught:
        flightmech.read_aircraft(file((old, new)))
    assert message in str(caught.value)


def test_contents_without_a_feed_are_refused(file):
    feeds = [
        ('feed = ["left"]\ncrossfeed = ["right"]\n', ""),
        ('feed = ["right", "tip"]\ncrossfeed = ["left"]\n', ""),
    ]
    with pytest.raises(SchemaError, match="content needs engines that state what feeds them"):
        flightmech.read_aircraft(file(*feeds))


def test_a_feed_without_fuel_is_refused(file):
    text = FILE[: FILE.index("[fuel]")]
    path = file()
    path.write_text(text)
    with pytest.raises(SchemaError, match="the engines have a feed, but there are no tanks; add"):
        flightmech.read_aircraft(path)


def test_tanks_of_engines_that_burn_nothing_are_named(file):
    """Their fuel would stay as it is in every flight."""
    with pytest.warns(AeromatchWarning, match="tanks feed engine 1, 2, which burns no fuel"):
        flightmech.read_aircraft(file())
