"""Propellers, piston engines and motors in the aircraft file, exchanged and refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import flightmech
from flightmech.aircraft import different_parts, read_aircraft, rescale, swap_parts, write_aircraft
from flightmech.errors import SchemaError

HEAD = """
name = "trainer"
S = "16.2 m2"
cbar = "1.5 m"
b = "11 m"
mass = "1000 kg"
Ixx = 1300.0
Iyy = 1800.0
Izz = 2700.0

[[engine]]
position = ["1.8 m", 0.0, 0.0]

[engine.propeller]
diameter = "75 in"
inertia = 2.26
rpm_high = "2700 rpm"
tables.CT_prop = { J = [0.0, 0.6, 1.2], value = [0.1, 0.05, -0.02] }
tables.CP_prop = { J = [0.0, 0.6, 1.2], value = [0.06, 0.045, -0.01] }
"""
PISTON = """
[engine.piston]
intake_impedance = "0.0002 s"
throttle_impedance = "0.02 s"
tables.bsfc = 8e-8

[engine.piston.tables.corrected_power]
manifold_pressure = ["15 inHg", "28 inHg"]
engine_rpm = ["2000 rpm", "2700 rpm"]
value = [["40 kW", "52 kW"], ["98 kW", "134 kW"]]
"""
MOTOR = """
[engine.motor]
speed_constant = 20.0
motor_resistance = 0.03
capacity = 18000.0
tables.open_voltage = { charge = [0.0, 1.0], value = ["36 V", "50 V"] }
"""


@pytest.fixture
def read(tmp_path):
    def from_text(text: str) -> flightmech.Aircraft:
        path = tmp_path / "craft.toml"
        path.write_text(text)
        return read_aircraft(path)

    return from_text


def test_file_with_a_piston_engine(read):
    (engine,) = read(HEAD + PISTON).engines
    assert engine.propeller is not None
    assert engine.piston is not None
    assert engine.propeller.diameter == pytest.approx(1.905)
    assert engine.propeller.rpm_high == pytest.approx(2700.0 * np.pi / 30.0)
    assert engine.propeller.J_end == 1.2
    power = engine.piston.tables["corrected_power"]["value"]
    assert power.values.tolist() == [[40e3, 52e3], [98e3, 134e3]]
    assert float(power["manifold_pressure"][1]) == pytest.approx(28.0 * 3386.389, rel=1e-6)


def test_fuel_of_a_piston_engine_has_units(read):
    piston = PISTON.replace("bsfc = 8e-8", 'bsfc = "0.45 lb/hp/h"')
    found = read(HEAD + piston).engines[0].piston.tables["bsfc"]["value"].item()
    assert found == pytest.approx(0.45 * 0.45359237 / (745.6998715822702 * 3600.0))


@pytest.mark.slow
@pytest.mark.parametrize("mover", [PISTON, MOTOR], ids=["piston", "motor"])
def test_written_aircraft_is_the_same(read, tmp_path, mover):
    craft = read(HEAD + mover)
    (tmp_path / "out").mkdir()
    again = read_aircraft(write_aircraft(craft, tmp_path / "out" / "again.toml"))
    assert different_parts(craft, again) == []
    assert again.engines[0].propeller.high_pitch == craft.engines[0].propeller.high_pitch


def test_parts_are_exchanged(read):
    craft = read(HEAD + PISTON)
    engine = craft.engines[0]
    other = replace(
        craft,
        engines=(replace(engine, propeller=replace(engine.propeller, inertia=3.0)),),
    )
    assert different_parts(craft, other) == ["engine/propeller"]
    assert swap_parts(craft, other, ["engine/propeller"]).engines[0].propeller.inertia == 3.0


def test_a_similar_aircraft_needs_its_own_propeller(read):
    with pytest.raises(SchemaError, match="laws of similarity do not scale"):
        rescale(read(HEAD + PISTON), 1.2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            HEAD.replace("inertia = 2.26\n", "") + PISTON,
            "engine.1.propeller.inertia: missing; give it",
        ),
        (HEAD, "nothing turns the propeller"),
        (HEAD + PISTON + MOTOR, "piston and motor turn one propeller; keep one"),
        (HEAD.replace("1.2]", "0.7]").replace("-0.02]", "0.03]") + PISTON, "continue both tables"),
        (HEAD + PISTON.replace("tables.bsfc", "tables.bsfe"), "bsfe"),
        (HEAD.replace('"75 in"', '"75 s"') + PISTON, "engine.1.propeller.diameter: unit .s."),
        (HEAD + MOTOR.replace("0.03", '"30 V"'), "engine.1.motor.motor_resistance: unit .V."),
        (HEAD + MOTOR.replace("18000.0", '"50 kW"'), "engine.1.motor.capacity: unit .kW."),
    ],
)
def test_refusals_of_a_file(read, text, message):
    with pytest.raises(SchemaError, match=message):
        read(text)
