"""Engines and propellers whose numbers are in another unit."""

from dataclasses import replace
from pathlib import Path

import pytest

import flightmech
from flightmech.aircraft import Engine
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
    assert "engine gives 204 kW" in size.text
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


@pytest.mark.parametrize(
    ("part", "changes", "words"),
    [
        (
            "propeller",
            {"inertia": 23000.0},
            "usual is 0.2212 to 36.86 kg m2, as if the number were",
        ),
        ("propeller", {"inertia": 54.6}, "as if the number were in lb ft2"),
        ("propeller", {"feather_pitch": 82.0}, "is 82 rad; usual is -0.9 to 1.8 rad, as if"),
        ("propeller", {"pitch_rate": 10.0}, "as if the number were in deg/s"),
        ("propeller", {"governor_time": 100.0}, "is 100 s; usual is 0.002 to 5 s, as if"),
        ("propeller", {"torque_limit": 1.0}, "as if the number were in kN m"),
        ("piston", {"boost_limit": 35.0}, "as if the number were in inHg or psi"),
        ("piston", {"displacement": 5.4}, "as if the number were in litres"),
        ("piston", {"crank_rpm": 200.0}, "is 200 rad/s; usual is 2 to 120 rad/s, as if"),
    ],
)
def test_constants_in_another_unit(aircraft, part, changes, words):
    engine = aircraft.engines[0]
    wrong = replace(engine, **{part: replace(getattr(engine, part), **changes)})
    (size,) = unusual_sizes(replace(aircraft, engines=(wrong,)))
    assert words in size.text
    assert size.remedy


@pytest.mark.parametrize(
    ("given", "typed", "words"),
    [
        ("inHg", "kPa", "manifold_pressure in the table corrected_power is 30000 Pa; usual is"),
        (" rpm", " rad/s", "is 2500 rad/s; usual is 125.7 to 754 rad/s, as if the number were in"),
    ],
)
def test_the_axis_of_a_chart_in_another_unit(tmp_path, given, typed, words):
    text = (DATA / "c182" / "aircraft.toml").read_text(encoding="utf-8")
    lines = []
    for line in text.splitlines():
        if line.startswith(("manifold_pressure =", "engine_rpm =")):
            line = line.replace(given, typed)
        lines.append(line)
    path = tmp_path / "aircraft.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    (size,) = unusual_sizes(flightmech.read_aircraft(path))
    assert words in size.text


def test_a_thrust_that_falls_with_the_lever(aircraft):
    thrust = {"throttle": [0.0, 1.0], "mach": [0.0, 0.5]}
    engine = Engine((0.0, 0.0, 0.0), thrust=make_term([[200.0, 90.0], [3000.0, 2500.0]], thrust))
    assert unusual_sizes(replace(aircraft, engines=(engine,))) == []
    turned = replace(engine, thrust=make_term([[3000.0, 2500.0], [200.0, 90.0]], thrust))
    (size,) = unusual_sizes(replace(aircraft, engines=(turned,)))
    assert size.text.startswith(
        "engine 1: the table thrust falls from 2750 at throttle 0 to 145 at"
    )
    assert size.remedy == "give the values in the order of the nodes of throttle"
