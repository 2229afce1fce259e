"""Control circuits in the aircraft file: units, defaults, faults, the length of a sub-step."""

from dataclasses import replace

import numpy as np
import pytest

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.controls import Circuit
from flightmech.errors import SchemaError

G0 = 9.80665
COLUMN = Circuit((-0.15, 0.2), 6.0, inertia=1.0, damping=10.0)


AIRCRAFT = """
name = "craft"
S = 17.0
cbar = 1.67
b = 10.3
mass = 2300.0
Ixx = 10800.0
Iyy = 8100.0
Izz = 15100.0
[control.delta_e]
S_hinge = 1.5
c_hinge = 0.35
gearing = "-86 deg/m"
[control.delta_a]
S_hinge = 0.8
c_hinge = 0.25
gearing = -0.3
"""


def read(tmp_path, text: str):
    path = tmp_path / "craft.toml"
    path.write_text(AIRCRAFT + text)
    return read_aircraft(path)


def test_circuits_of_an_aircraft_file(tmp_path):
    text = """
[circuit.wheel]
stops = ["-70 deg", "70 deg"]
mass = 0.2
friction = "10 lbf in"
[circuit.column]
order = 4
stops = ["-15 cm", "20 cm"]
mass = "6 kg"
inertia = "1.1 kg m2"
cable_stiffness = "120 N/cm"
friction = "5 lbf"
"""
    circuits = read(tmp_path, text).circuits
    assert circuits["column"].friction == pytest.approx(5.0 * 0.45359237 * G0)
    plain = Circuit((-0.15, 0.2), 6.0, order=4, inertia=1.1, cable_stiffness=12e3)
    assert replace(circuits["column"], friction=0.0) == plain
    assert circuits["wheel"].stops == pytest.approx((-np.radians(70.0), np.radians(70.0)))
    assert circuits["wheel"].friction == pytest.approx(10.0 * 0.0254 * 0.45359237 * G0)


def test_faults_of_an_aircraft_file_all_at_once(tmp_path):
    text = """
[circuit.column]
order = 6
stops = [0.2, -0.15]
mass = 6.0
friction = -1.0
[circuit.pedal]
stops = [-0.1, 0.1]
mass = 6.0
"""
    with pytest.raises(SchemaError) as caught:
        read(tmp_path, text)
    assert caught.value.problems == [
        "circuit.column: order is 6; allowed: 2, 4",
        "circuit.column: friction is -1; it must be zero or positive",
        "circuit.column: stops are 0.2 and -0.15; the first must lie below the second",
        "circuit.column: inertia is 0; order 6 needs it",
        "circuit.column: cable_stiffness is 0; order 6 needs it",
        "circuit.pedal: [control.delta_r] with a gearing is missing; give S_hinge, c_hinge "
        "and gearing",
    ]


def test_units_and_keys_of_an_aircraft_file(tmp_path):
    text = """
[circuit.wheel]
stops = ["-15 cm", "70 deg"]
mass = 0.2
frictoin = 1.0
"""
    with pytest.raises(SchemaError) as caught:
        read(tmp_path, text)
    assert len(caught.value.problems) == 2
    assert "circuit.wheel.stops.0: unit 'cm' cannot be converted to 'rad'" in str(caught.value)
    assert "circuit.wheel.frictoin: unknown key; near it: friction" in str(caught.value)


def test_sub_step_follows_the_fastest_mode():
    """A fifth of a radian of the cable's mode, unless 1 ms is shorter or the step is given."""
    stiff = replace(COLUMN, order=4, cable_stiffness=2e6)
    omega = np.sqrt(2e6 * (1.0 / 6.0 + 1.0 / 1.5**2))
    assert stiff.sub_step(-1.5) == pytest.approx(0.2 / omega)
    assert COLUMN.sub_step(-1.5) == 1e-3
    assert replace(stiff, step=5e-4).sub_step(-1.5) == 5e-4
