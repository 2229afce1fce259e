"""Engines and propellers whose numbers are in another unit."""

from dataclasses import replace
from pathlib import Path

import pytest

import flightmech
from flightmech.terms import make_term
from flighttest.reconstruction.quality.engines.usual_sizes import unusual_sizes

DATA = Path(__file__).parents[4] / "data"


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(DATA / "c182" / "aircraft.toml")


def changed(aircraft, **changes):
    engine = aircraft.engines[0]
    propeller = replace(engine.propeller, **changes)
    return replace(aircraft, engines=(replace(engine, propeller=propeller),))


@pytest.mark.parametrize("name", ["c182", "commuter", "t37"])
def test_sound_aircraft_have_usual_sizes(name):
    assert unusual_sizes(flightmech.read_aircraft(DATA / name / "aircraft.toml")) == []


def test_a_diameter_in_another_unit(aircraft):
    (size,) = unusual_sizes(changed(aircraft, diameter=0.81))
    assert size.name == "propeller_diameter"
    assert "takes 1.08 to 2.84 kW" in size.text
    assert "engine gives 201 kW" in size.text
    assert "as if in were given as cm" in size.text


def test_revolutions_per_minute_as_radians(aircraft):
    (size,) = unusual_sizes(changed(aircraft, rpm_high=2400.0))
    assert size.name == "rpm_high"
    assert "2700 rpm" in size.remedy


def test_consumption_in_pounds_per_horsepower_and_hour(aircraft):
    engine = aircraft.engines[0]
    tables = {**engine.piston.tables, "bsfc": make_term(0.45)}
    thirsty = replace(engine, piston=replace(engine.piston, tables=tables))
    (size,) = unusual_sizes(replace(aircraft, engines=(thirsty,)))
    assert size.name == "bsfc"
    assert "0.45 kg/J; engines have 4e-08 to 4e-07, as if it were in lb/(hp h)" in size.text
    assert "1 lb/(hp h) is 1.69e-7" in size.remedy


@pytest.mark.parametrize(
    ("changes", "name", "text"),
    [
        ({"b": 1.0911}, "reference", "S 16.17 m2 is 9.92 times cbar 1.494 m x b 1.091 m"),
        ({"S": 174.0}, "reference", "is 10.7 times cbar"),
        ({"mass": 103.4}, "mass", "mass 103.4 kg is a wing loading of 62.7 N/m2"),
        ({"Ixx": 128500.0}, "inertia", "is a radius of gyration of 1.02 of the span"),
    ],
)
def test_an_airframe_of_another_size(aircraft, changes, name, text):
    (size,) = unusual_sizes(replace(aircraft, engines=(), **changes))
    assert size.name == name
    assert text in size.text
