"""Parts of an aircraft file on the other side than their name states."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

import flightmech
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.tank import Tank
from flighttest.reconstruction.quality.instruments.positions import side_findings

DATA = Path(__file__).parents[4] / "data"


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(DATA / "commuter" / "aircraft.toml")


def with_tanks(aircraft, left, right, feeds=(("left",), ("right",))):
    tanks = (
        Tank((0.1, left, 0.1), 400.0, name="left", content=300.0),
        Tank((0.1, right, 0.1), 400.0, name="right", content=300.0),
    )
    engines = []
    for engine, feed in zip(aircraft.engines, feeds, strict=True):
        engines.append(replace(engine, feed=feed))
    return replace(aircraft, engines=tuple(engines), fuel=Fuel(600.0, tanks=tanks))


@pytest.mark.parametrize("name", ["c182", "commuter", "t37"])
def test_own_aircraft_have_their_parts_on_their_sides(name):
    assert side_findings(flightmech.read_aircraft(DATA / name / "aircraft.toml")) == []


@pytest.mark.filterwarnings("ignore::flightmech.errors.AeromatchWarning")
def test_tanks_on_the_other_side(aircraft):
    assert side_findings(with_tanks(aircraft, -2.8, 2.8)) == []
    left, right = side_findings(with_tanks(aircraft, 2.8, -2.8))
    assert "tank 'left' of the aircraft file is at y = +2.8 m, the right side" in left.text
    assert "a part on the right has a positive y" in right.text
    assert "turn the sign of y of 'left'" in left.remedy


@pytest.mark.filterwarnings("ignore::flightmech.errors.AeromatchWarning")
def test_feeds_from_the_other_side(aircraft):
    crossed = with_tanks(aircraft, -2.8, 2.8, feeds=(("right",), ("left",)))
    first, second = side_findings(crossed)
    assert "engine 1 of the aircraft file is at y = -2.9 m, and its feed, right" in first.text
    assert "y = -2.8 m" in second.text
    # an engine that draws from both sides is a usual one
    both = with_tanks(aircraft, -2.8, 2.8, feeds=(("left", "right"), ("left", "right")))
    assert side_findings(both) == []


def test_a_wheel_on_the_other_side():
    aircraft = flightmech.read_aircraft(DATA / "t37" / "aircraft.toml")
    contacts = []
    for contact in aircraft.gear.contacts:
        x, y, z = contact.position
        contacts.append(replace(contact, position=(x, -y, z)))
    turned = replace(aircraft, gear=replace(aircraft.gear, contacts=tuple(contacts)))
    named = {finding.channels[0] for finding in side_findings(turned)}
    assert named == {"contact left", "contact right", "contact tip_left", "contact tip_right"}


def with_contacts(places):
    """Return an aircraft with a contact at each y. [m]"""
    contacts = [SimpleNamespace(name=name, position=(0.0, y, 1.0)) for name, y in places.items()]
    gear = SimpleNamespace(contacts=contacts)
    return SimpleNamespace(b=11.0, fuel=None, gear=gear, engines=())


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("2L", "2R"),
        ("L2", "R2"),
        ("eng_1_lh", "eng_2_rh"),
        ("MLG-L", "MLG-R"),
        ("mlgl", "mlgr"),
        ("leftMain", "rightMain"),
        ("tipleft", "tipright"),
        ("MainL", "MainR"),
        ("LH_wing", "RH_wing"),
        ("lwing2", "rwing2"),
    ],
)
def test_all_spellings_of_a_side(left, right):
    assert side_findings(with_contacts({left: -2.8, right: 2.8})) == []
    first, second = side_findings(with_contacts({left: 2.8, right: -2.8}))
    assert f"contact {left!r}" in first.text
    assert f"contact {right!r}" in second.text


@pytest.mark.parametrize("name", ["rear", "lower", "upright", "tail", "belly_rear", "aux1", "nlg"])
def test_names_without_a_side(name):
    for y in (-2.8, 2.8):
        assert side_findings(with_contacts({name: y})) == []
