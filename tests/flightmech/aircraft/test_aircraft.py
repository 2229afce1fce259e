"""The aircraft file: units, engines, and every problem at once."""

from __future__ import annotations

import numpy as np
import pytest

from flightmech.aircraft.aircraft import inertia_tensor
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import ParseError, SchemaError
from flightmech.terms import evaluate_term, make_term

GOOD = """
name = "trainer"
S = "182 ft2"
cbar = 1.66726
b = "33.83 ft"
reference = [-4.1, 0.0, "1 ft"]
mass = "5000 lb"
Ixx = 10826.0
Iyy = 8135.0
Izz = 15162.0
Ixz = 120.0
cg = [0.0, 0.0, 0.2235]

[[engine]]
position = [0.0, "-30 in", 0.0]
direction = [2.0, 0.0, 0.0]
time_constant = "800 ms"
thrust = { throttle = [0, 1], mach = [0.0, 0.6], value = [[300, 150], ["4559 N", 4100]] }

[[engine]]
position = [0.0, 0.762, 0.0]
thrust_file = "engine.nc"

[limits]
delta_e = ["-20 deg", "17 deg"]

[instruments.imu]
position = [0.9, 0.25, 0.32]
noise = { q = "0.03 deg/s" }
"""


@pytest.fixture
def write(tmp_path):
    def at(text: str):
        path = tmp_path / "aircraft.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return at


def test_a_good_file(write, tmp_path):
    leaf = make_term([100.0, 2000.0], {"throttle": [0.0, 1.0]})
    leaf.to_netcdf(tmp_path / "engine.nc", engine="h5netcdf")
    aircraft = read_aircraft(write(GOOD))
    assert pytest.approx(182.0 * 0.3048**2) == aircraft.S
    assert aircraft.mass == pytest.approx(5000.0 * 0.45359237)
    assert aircraft.reference == (-4.1, 0.0, 0.3048)
    assert aircraft.limits == {"delta_e": pytest.approx((-np.pi / 9.0, np.radians(17.0)))}
    assert aircraft.instruments["imu"]["position"] == [0.9, 0.25, 0.32]
    left, right = aircraft.engines
    assert left.position == (0.0, pytest.approx(-0.762), 0.0)
    assert left.direction == (1.0, 0.0, 0.0)
    assert left.time_constant == pytest.approx(0.8)
    assert evaluate_term(left.thrust, {"throttle": 1.0, "mach": 0.3}) == pytest.approx(
        0.5 * (4559.0 + 4100.0)
    )
    assert evaluate_term(right.thrust, {"throttle": 0.5}) == pytest.approx(1050.0)


def test_inertia_tensor(write):
    text = GOOD.replace('thrust_file = "engine.nc"', "")
    J = inertia_tensor(read_aircraft(write(text)))
    assert J.tolist() == [[10826.0, 0.0, -120.0], [0.0, 8135.0, 0.0], [-120.0, 0.0, 15162.0]]


def test_a_reference_point_in_per_cent_of_the_chord(write):
    text = GOOD.replace('thrust_file = "engine.nc"', "")
    with pytest.raises(SchemaError, match=r"x_ref_mac: .*write 0.2925 or '29.25 %' for 29.25 %"):
        read_aircraft(write(text.replace("[[engine]]", "x_ref_mac = 29.25\n[[engine]]", 1)))
    # a point ahead of the wing, such as the nose, is allowed
    nose = text.replace("[[engine]]", "x_ref_mac = -3.5\n[[engine]]", 1)
    assert read_aircraft(write(nose)).x_ref_mac == -3.5


def test_all_problems_are_reported_at_once(write):
    bad = (
        GOOD.replace('S = "182 ft2"', 'S = "182 ft"')
        .replace("mass =", "maas =")
        .replace("Iyy = 8135.0", "Iyy = -1")
    )
    bad = (
        bad.replace("direction = [2.0", "direction = [0.0")
        .replace("delta_e =", "delta_x =")
        .replace("time_constant", "timeconstant")
    )
    with pytest.raises(SchemaError) as caught:
        read_aircraft(write(bad))
    text = str(caught.value)
    for part in (
        "S: unit 'ft' cannot be converted to 'm2'",
        "mass: missing; give it",
        "maas: unknown key; near it: mass",
        "Iyy: expected a positive number",
        "engine.1.direction: expected a direction with a length",
        "engine.1.timeconstant: unknown key; near it: time_constant",
        "unknown control delta_x; allowed: delta_e",
    ):
        assert part in text, text


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (
            "mach = [0.0, 0.6]",
            "mach = [0.0, 0.6, 0.9]",
            r"value has the shape \(2, 2\), the axes throttle mach have \(2, 3\)",
        ),
        (
            "throttle = [0, 1]",
            "throtle = [0, 1]",
            "unknown key throtle; allowed: throttle, mach, h, value",
        ),
        ("throttle = [0, 1]", "throttle = [1, 0]", "axis throttle does not rise"),
        (
            'thrust_file = "engine.nc"',
            'thrust_file = "none.nc"',
            "engine.2.thrust: no file 'none.nc' in .*; give its path from the aircraft file",
        ),
        ("Ixz = 120.0", "Ixz = 90000.0", "inertia tensor is not positive definite"),
        (
            '["-20 deg", "17 deg"]',
            '["17 deg", "-20 deg"]',
            "low 0.296706 is not below high -0.349066",
        ),
    ],
)
def test_single_faults(write, old, new, text):
    assert old in GOOD
    with pytest.raises(SchemaError, match=text):
        read_aircraft(write(GOOD.replace(old, new)))


def test_a_name_has_200_characters_at_most(write):
    with pytest.raises(SchemaError, match="name: string should have at most 200 characters"):
        read_aircraft(write(GOOD.replace("trainer", "x" * 201)))


def test_text_that_is_no_toml(write):
    with pytest.raises(ParseError, match="line 3"):
        read_aircraft(write('name = "x"\n\nS = = 3\n'))


def test_hinge_geometry(write):
    text = GOOD.replace('thrust_file = "engine.nc"', "")
    good = (
        text + '\n[control.delta_e]\nS_hinge = "17 ft2"\nc_hinge = "1 ft"\ngearing = "-60 deg/m"\n'
    )
    good += "[control.delta_a]\nS_hinge = 1\nc_hinge = 0.2\n"
    controls = read_aircraft(write(good)).controls
    assert controls["delta_e"].S_hinge == pytest.approx(17.0 * 0.3048**2)
    assert controls["delta_e"].gearing == pytest.approx(-np.pi / 3.0)
    assert controls["delta_a"].gearing is None


def test_faults_of_hinge_geometry(write):
    text = GOOD.replace('thrust_file = "engine.nc"', "")
    with pytest.raises(
        SchemaError, match="unknown control delta_f; allowed: delta_e, delta_a, delta_r"
    ):
        read_aircraft(write(text + "\n[control.delta_f]\nS_hinge = 1\nc_hinge = 1\n"))
    with pytest.raises(SchemaError, match="gearing: unit 'deg/s' cannot be converted to 'm-1'"):
        read_aircraft(
            write(text + '\n[control.delta_e]\nS_hinge = 1\nc_hinge = 1\ngearing = "3 deg/s"\n')
        )
    with pytest.raises(SchemaError, match="expected a deflection per travel other than zero"):
        read_aircraft(write(text + "\n[control.delta_e]\nS_hinge = 1\nc_hinge = 1\ngearing = 0\n"))
    with pytest.raises(SchemaError, match=r"control\.delta_e\.S_hinge: expected a positive number"):
        read_aircraft(write(text + "\n[control.delta_e]\nS_hinge = 0\nc_hinge = 1\n"))


def test_a_station_of_the_stall_is_on_the_wing(write):
    """8.5 ft written as a bare 8.5 are metres: beyond the tip of this wing."""
    stall = '[stall]\nstation = 8.5\na1 = 20.0\nalpha_star = "17 deg"\ntau1 = 8.0\ntau2 = 3.0\n'
    text = GOOD.replace('thrust_file = "engine.nc"', "") + "\n" + stall
    with pytest.raises(
        SchemaError, match=r"stall: station is 8.5 m, beyond the wing tip at 5.156 m"
    ):
        read_aircraft(write(text))
    aircraft = read_aircraft(write(text.replace("station = 8.5", 'station = "8.5 ft"')))
    assert aircraft.stall.station == pytest.approx(2.5908)
