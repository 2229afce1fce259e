"""The landing gear of an aircraft file, and its faults."""

from __future__ import annotations

import numpy as np
import pytest

import flightmech
from flightmech.errors import SchemaError
from flightmech.simulation.kernel import PARAMETER
from flightmech.terms import make_term

GEAR_FILE = """
name = "glider"
S = 10.0
cbar = 1.0
b = 15.0
mass = 300.0
Ixx = 900.0
Iyy = 500.0
Izz = 1300.0
[gear]
condition = "wet"
tyre_pressure = "200 psi"
antiskid = 0.5
[gear.steering]
order = "second"
limit = "40 deg"
stiffness = 1500.0
inertia = 0.4
[[gear.contact]]
name = "main"
position = [0.1, 0.0, "60 cm"]
damping = 900.0
strut = { compression = [0.0, "10 cm"], value = [0.0, "1000 lbf"] }
side_stiffness = "40e3 N/m"
cornering_stiffness = 9e3
[[gear.contact]]
name = "tail"
position = [-4.0, 0.0, 0.3]
stiffness = 2e4
side_stiffness = 2e4
friction = 0.3
retracts = false
"""


def test_aircraft_file(tmp_path, make_tree):
    path = tmp_path / "glider.toml"
    path.write_text(GEAR_FILE)
    craft = flightmech.read_aircraft(path)
    assert craft.gear is not None
    assert [c.name for c in craft.gear.contacts] == ["main", "tail"]
    sim = flightmech.compile(craft, make_tree({"CD/basic": make_term(0.02)}))
    rows = {row.name: row for row in sim.entries(PARAMETER)}
    found = {
        name: rows[name].value
        for name in (
            "runway.condition",
            "gear.antiskid",
            "steering.order",
            "gear.main.z",
            "gear.main.damping_ext",
        )
    }
    assert found == {
        "runway.condition": 1.0,
        "gear.antiskid": 0.5,
        "steering.order": 2.0,
        "gear.main.z": 0.6,
        "gear.main.damping_ext": 900.0,
    }
    assert rows["steering.limit"].value == pytest.approx(np.radians(40.0))
    assert rows["runway.mu_wet_0"].value == pytest.approx(0.692)
    assert {"wow_main", "wow_tail", "gear.tail.Fz", "gear.steering"} <= set(sim.outputs)
    assert {"delta_nw", "brake_left", "brake_right"} <= set(sim.inputs)
    assert all(row.description and row.units for kind in range(4) for row in sim.entries(kind))


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('name = "tail"', 'name = "main"', "main is given more than once"),
        ("friction = 0.3", "", "cornering_stiffness for a wheel or friction for a skid"),
        (
            "stiffness = 2e4\nside",
            "preload = 9.0\nstiffness = 2e4\nside",
            "preload needs a tyre_stiffness",
        ),
        ('"60 cm"', '"60 kg"', "gear.contact.0.position"),
        ('value = [0.0, "1000 lbf"]', "value = [0.0]", "strut"),
        ("inertia = 0.4", "", "order second needs an inertia"),
        ('condition = "wet"', 'condition = "damp"', "gear.condition"),
        ("damping = 900.0", "damping = -900.0", "damping must be zero or positive"),
        ("antiskid", "antskid", "unknown key"),
    ],
)
def test_aircraft_file_faults(old, new, text, tmp_path):
    path = tmp_path / "glider.toml"
    assert old in GEAR_FILE
    path.write_text(GEAR_FILE.replace(old, new))
    with pytest.raises(SchemaError, match=text):
        flightmech.read_aircraft(path)
